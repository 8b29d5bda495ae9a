use super::*;
use crate::depth::{DepthBuffer, DepthHoles, DepthKind};
use squall_formats::units::Degrees;
use std::collections::HashMap;

const SIZE: [u32; 2] = [160, 120];
const PIXELS: usize = (SIZE[0] * SIZE[1]) as usize;

fn camera_at(x: f64) -> Camera {
    let eye = DVec3::new(x, 0.0, 1.6);
    Camera::look_at(eye, eye + DVec3::Y * 9.0, Degrees(60.0), SIZE).unwrap()
}

fn grey(light: f32) -> Picture {
    let mut picture = Picture::new(SIZE[0] as usize, SIZE[1] as usize).unwrap();
    picture.pixels.fill([light; 3]);
    picture
}

fn heavy() -> FrameRainSettings {
    FrameRainSettings { rate: MillimetresPerHour(75.0), lengths_px: Some([6.0, 200.0]), ..Default::default() }
}

fn moment<'a>(camera: &'a Camera, light: &'a WorldLight, depth: Option<DepthBuffer<'a>>) -> TakenFrame<'a> {
    TakenFrame { camera, velocity: DVec3::ZERO, time: Seconds(3.0), depth, light }
}

fn planar(metres: &[f32]) -> DepthBuffer<'_> {
    DepthBuffer::new(metres, SIZE[0] as usize, SIZE[1] as usize, DepthKind::Planar).unwrap()
}

#[test]
fn no_rain_changes_no_bit_of_a_frame() {
    let (camera, mut picture) = (camera_at(0.0), grey(0.3));
    picture.pixels[7] = [f32::INFINITY, 0.1, 1e-30];
    let before = picture.clone();
    let light = WorldLight::estimate(&grey(0.3), &camera);
    let mut rain = FrameRain::built_in().unwrap();
    let frame = moment(&camera, &light, None);
    let report = rain.rain_on(&FrameRainSettings::default(), &frame, &mut picture).unwrap();
    assert_eq!(picture, before);
    assert_eq!((report.streaks, report.mean_alpha, report.mean_transmittance), (0, 0.0, 1.0));
}

#[test]
fn the_layers_are_what_the_picture_is_made_of() {
    /// Single precision.
    const ROUND_OFF: f32 = 1e-5;
    let (camera, mut picture) = (camera_at(0.0), grey(0.3));
    let light = WorldLight::estimate(&grey(0.8), &camera);
    let metres = vec![60.0; PIXELS];
    let mut rain = FrameRain::built_in().unwrap();
    let frame = moment(&camera, &light, Some(planar(&metres)));
    let report = rain.rain_on(&heavy(), &frame, &mut picture).unwrap();
    assert!(report.streaks > 100 && report.mean_alpha > 0.0, "{report:?}");
    for (at, pixel) in picture.pixels.iter().enumerate() {
        let (alpha, left) = (rain.mask()[at], rain.transmittance()[at]);
        assert!((0.0..=1.0).contains(&alpha) && (0.0..1.0).contains(&left));
        let through = 0.3 * left + rain.in_scattered()[at][1];
        // The light around is one everywhere, and so is what every drop shows.
        let shown = through * (1.0 - alpha) + 0.8 * alpha;
        assert!((pixel[1] - shown).abs() < ROUND_OFF, "{at}: {} {shown}", pixel[1]);
    }
}

#[test]
fn the_sky_is_dimmed_over_the_rains_extent_as_beer_and_lambert_say() {
    /// What streaks replace of the medium near by, of an optical depth of .15 over 100 m; see the medium's own tests.
    const NEAR_SHELLS: f64 = 0.01;
    let (camera, light) = (camera_at(0.0), WorldLight::estimate(&grey(0.5), &camera_at(0.0)));
    let mut rain = FrameRain::built_in().unwrap();
    let settings = FrameRainSettings { extent: Metres(100.0), ..heavy() };
    rain.rain_on(&settings, &moment(&camera, &light, None), &mut grey(0.5)).unwrap();
    let wanted = libm::exp(-0.1 * Medium::geometric(settings.rate).extinction_per_km().0);
    for &left in rain.transmittance() {
        assert!(
            (f64::from(left) - wanted).abs() < NEAR_SHELLS && f64::from(left) >= wanted,
            "{left} {wanted}"
        );
    }
    for extent in [0.0, -1.0, f64::NAN] {
        let settings = FrameRainSettings { extent: Metres(extent), ..settings };
        let error = rain.rain_on(&settings, &moment(&camera, &light, None), &mut grey(0.5)).unwrap_err();
        assert!(error.to_string().contains("extent"), "{error}");
    }
}

#[test]
fn a_pair_of_cameras_sees_the_same_drops_at_the_disparity_of_their_depth() {
    /// Positions in a picture are stored in single precision, px.
    const ROUND_OFF_PX: f64 = 1e-3;
    const BASELINE: f64 = 0.54;
    let [left, right] = [camera_at(0.0), camera_at(BASELINE)];
    let light = WorldLight::estimate(&grey(0.5), &left);
    let mut rain = FrameRain::built_in().unwrap();
    let mut labels = [&left, &right].map(|camera| {
        let frame = moment(camera, &light, None);
        rain.rain_on(&heavy(), &frame, &mut grey(0.5)).unwrap();
        rain.labels(&frame).collect::<Vec<_>>()
    });
    let seen_right: HashMap<u64, StreakLabel> = labels[1].drain(..).map(|label| (label.id, label)).collect();
    let focal = left.pixels_per_metre();
    let mut pairs = 0;
    for label in &labels[0] {
        let Some(other) = seen_right.get(&label.id) else { continue };
        pairs += 1;
        for end in 0..2 {
            // Both ends: rain that falls straight down keeps its depth.
            let disparity = label.ends_px[end][0] - other.ends_px[end][0];
            assert!(
                (disparity - focal * BASELINE / label.depth_m).abs() < ROUND_OFF_PX,
                "{label:?} {other:?}"
            );
            assert!((label.ends_px[end][1] - other.ends_px[end][1]).abs() < ROUND_OFF_PX);
        }
        assert!((label.diameter_mm - other.diameter_mm).abs() < 1e-6);
    }
    assert!(pairs > 100, "{pairs} of {}", labels[0].len());
}

#[test]
fn a_wall_hides_the_streaks_behind_it_and_the_labels_say_so() {
    let (camera, light) = (camera_at(0.0), WorldLight::estimate(&grey(0.5), &camera_at(0.0)));
    let mut rain = FrameRain::built_in().unwrap();
    // A wall on the left half, so near that few drops are in front of it.
    let metres: Vec<f32> =
        (0..PIXELS).map(|at| if at % (SIZE[0] as usize) < 80 { 0.3 } else { f32::INFINITY }).collect();
    let frame = moment(&camera, &light, Some(planar(&metres)));
    rain.rain_on(&heavy(), &frame, &mut grey(0.5)).unwrap();
    let labels: Vec<StreakLabel> = rain.labels(&frame).collect();
    for label in &labels {
        let [a, b] = label.ends_px;
        let within = |low: f64, high: f64| [a, b].iter().all(|end| end[0] >= low && end[0] < high);
        if within(0.0, 79.0) && label.depth_m > 0.31 {
            assert_eq!(label.visible, 0.0, "{label:?}");
        }
        if within(81.0, 160.0) && [a, b].iter().all(|end| end[1] > 0.0 && end[1] < 120.0) {
            assert_eq!(label.visible, 1.0, "{label:?}");
        }
        assert!((0.0..=1.0).contains(&label.alpha) && label.distance_m >= label.depth_m);
    }
    let left: f32 = (0..PIXELS).filter(|at| at % 160 < 76).map(|at| rain.mask()[at]).sum();
    let right: f32 = (0..PIXELS).filter(|at| at % 160 >= 84).map(|at| rain.mask()[at]).sum();
    assert!(right > 1.5 * left, "{left} {right}");
}

#[test]
fn holes_are_counted_and_kept_as_they_were_told() {
    let (camera, light) = (camera_at(0.0), WorldLight::estimate(&grey(0.9), &camera_at(0.0)));
    let mut metres = vec![500.0; PIXELS];
    metres[..800].fill(0.0);
    let settings = FrameRainSettings { gain: 0.0, ..heavy() };
    let mut rain = FrameRain::built_in().unwrap();
    let mut alone = grey(0.2);
    let frame = moment(&camera, &light, Some(planar(&metres)));
    assert_eq!(rain.rain_on(&settings, &frame, &mut alone).unwrap().holes, 800);
    assert_eq!((alone.pixels[0], rain.transmittance()[0]), ([0.2; 3], 1.0));
    let filled = planar(&metres).with_holes(DepthHoles::FillFromNeighbours);
    let mut picture = grey(0.2);
    rain.rain_on(&settings, &moment(&camera, &light, Some(filled)), &mut picture).unwrap();
    assert!(rain.transmittance()[0] < 0.9 && picture.pixels[0][0] > 0.2);
}

#[test]
fn a_picture_of_another_size_is_refused_and_lengths_keep_the_count_at_any_resolution() {
    let (camera, light) = (camera_at(0.0), WorldLight::estimate(&grey(0.5), &camera_at(0.0)));
    let mut rain = FrameRain::built_in().unwrap();
    let mut small = Picture::new(8, 8).unwrap();
    let error = rain.rain_on(&heavy(), &moment(&camera, &light, None), &mut small).unwrap_err();
    assert!(error.to_string().contains("160 × 120"), "{error}");
    assert_eq!(usual_lengths(1080), [30.0, 200.0]);
    assert_eq!(usual_lengths(2160), [60.0, 400.0]);
    assert_eq!(usual_lengths(540), [15.0, 200.0]);
    assert_eq!(usual_lengths(120), [8.0, 200.0]);
}
