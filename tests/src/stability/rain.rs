//! Rain at the edges of its range: rates, lenses, exposures, hours, depth; and whole pictures at the ends of a view's ranges.

use crate::frame::{asset, sections};
use crate::rain::{T20, find, level, rain, rate, tables};
use glam::DVec3;
use squall_bake::density::solve_counts;
use squall_formats::drops;
use squall_formats::section::density::Mode;
use squall_formats::section::view::ViewSection;
use squall_formats::units::{Metres, Seconds};
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::density::lookup_counts;
use squall_runtime::depth::{DepthBuffer, DepthHoles, DepthKind};
use squall_runtime::medium::{Medium, Outlook};
use squall_runtime::picture::Picture;
use squall_runtime::rain::{RainVolume, Scene, Shot, SmoothWindow, Surroundings, Weather, Workspace};
use squall_runtime::tone::Tone;
use squall_runtime::world::WorldLight;
use squall_runtime::{Frame, StormRenderer};

#[test]
fn rates_from_nothing_to_a_cloudburst_have_their_drops_or_are_refused_with_the_range() {
    let camera = level(60.0);
    let shot = Shot { min_px: 12.0, ..Shot::new(&camera, T20) };
    println!("| R, mm/h | expected | found | table | extinction beside streaks over direct |");
    for mm_h in [0.0, 1e-9, 0.001, 0.01, 0.1, 200.0, 200.1, 300.0, 1e9] {
        let weather = Weather::steady(rate(mm_h), DVec3::ZERO, Seconds(3.0));
        let mut workspace = Workspace::new();
        let found =
            rain().find(&shot, &weather, None, &mut workspace).map(<[_]>::len).map_err(|e| e.to_string());
        let table = lookup_counts(tables(), Mode::Default, &shot.view().unwrap(), rate(mm_h))
            .map(|c| c.iter().sum::<f64>())
            .map_err(|e| e.to_string());
        let medium = Medium::beside_streaks(tables(), &shot, rate(mm_h)).map_err(|e| e.to_string());
        if mm_h > 200.0 {
            for refused in [found.unwrap_err(), medium.unwrap_err(), table.unwrap_err()] {
                assert!(refused.contains("200 mm/h"), "{refused}");
            }
            continue;
        }
        let medium = medium.unwrap();
        let depth = medium.optical_depth(1000.0, 1.2);
        assert!(
            (0.0..=1.2 * 1000.0 * medium.extinction().0 * (1.0 + 1e-12)).contains(&depth),
            "{mm_h}: {depth}"
        );
        let wanted = if mm_h == 0.0 {
            0.0
        } else {
            solve_counts(Mode::Default, &[drops::DEFAULT_DIAMETERS], &shot.view().unwrap(), rate(mm_h))
                .unwrap()[0]
        };
        let count = workspace.streaks().iter().filter(|s| s.inside).count() as f64;
        println!("| {mm_h} | {wanted:.3} | {count} | {table:?} | {depth:.3e} |");
        assert!((count - wanted).abs() <= 5.0 * wanted.sqrt() + 1.0, "R {mm_h}: {count} for {wanted}");
        assert_eq!(table.is_ok(), mm_h >= 0.1, "{mm_h}");
    }
}

#[test]
fn exposures_from_a_microsecond_to_ten_seconds_are_drawn_or_refused_with_what_helps() {
    let camera = level(60.0);
    println!("| T, s | shortest streak, px | streaks or refusal |");
    for (exposure, min_px) in [
        (0.0, 30.0),
        (-1.0, 30.0),
        (1e-6, 30.0),
        (1e-4, 30.0),
        (0.02, 30.0),
        (0.1, 30.0),
        (1.0, 30.0),
        (10.0, 30.0),
        (1.0, 1080.0),
    ] {
        let shot = Shot { min_px, max_px: 4e4, ..Shot::new(&camera, Seconds(exposure)) };
        let weather = Weather::steady(rate(2.0), DVec3::ZERO, Seconds(3.0));
        let mut workspace = Workspace::new();
        let found = rain().find(&shot, &weather, None, &mut workspace).map(<[_]>::len);
        println!("| {exposure} | {min_px} | {found:?} |");
        match found {
            Ok(_) => {
                let edges = [drops::DEFAULT_DIAMETERS];
                let wanted =
                    solve_counts(Mode::Default, &edges, &shot.view().unwrap(), weather.rate).unwrap()[0];
                let count = workspace.streaks().iter().filter(|s| s.inside).count() as f64;
                assert!(
                    (count - wanted).abs() <= 5.0 * wanted.sqrt() + 1.0,
                    "T {exposure}: {count} for {wanted}"
                );
                let finite = workspace
                    .streaks()
                    .iter()
                    .all(|s| s.ends.iter().flatten().all(|v| v.is_finite()) && s.coverage.is_finite());
                assert!(finite, "T {exposure}");
            }
            Err(error) => {
                let text = error.to_string();
                if exposure <= 0.0 {
                    assert!(text.contains("exposure-ms: wanted a positive time"), "{text}");
                    continue;
                }
                // The setting that it names works.
                let named = text
                    .split("raise the shortest of streak_px to ")
                    .nth(1)
                    .and_then(|rest| rest.split(',').next());
                let nearest =
                    Shot { min_px: named.unwrap_or_else(|| panic!("{text}")).parse().unwrap(), ..shot };
                assert!(rain().find(&nearest, &weather, None, &mut workspace).is_ok(), "{text}");
            }
        }
    }
}

#[test]
fn a_step_of_a_day_leaves_the_same_rain_and_a_camera_at_any_speed_finite_streaks() {
    let camera = level(60.0);
    let wanted = solve_counts(
        Mode::Default,
        &[drops::DEFAULT_DIAMETERS],
        &Shot::new(&camera, T20).view().unwrap(),
        rate(25.0),
    )
    .unwrap()[0];
    println!("| time, s | speed, m/s | streaks | expected |");
    for time in [0.0, 86_400.0, 86_400.0 * 3650.0, -86_400.0] {
        for speed in [0.0, 340.0, 9999.0] {
            let shot = Shot { velocity: camera.forward * speed, ..Shot::new(&camera, T20) };
            if speed > 0.0 && time != 0.0 {
                continue;
            }
            let mut workspace = Workspace::new();
            let found = rain().find(
                &shot,
                &Weather::steady(rate(25.0), DVec3::X * 3.0, Seconds(time)),
                None,
                &mut workspace,
            );
            let Ok(streaks) = found else {
                println!("| {time} | {speed} | {} |", found.unwrap_err());
                continue;
            };
            let inside = streaks.iter().filter(|s| s.inside).count() as f64;
            println!("| {time} | {speed} | {inside} | {wanted:.0} |");
            assert!((inside - wanted).abs() < 5.0 * wanted.sqrt(), "{time} {speed}: {inside}");
            assert!(
                streaks.iter().all(|s| s.ends.iter().flatten().all(|v| v.is_finite())
                    && s.end_depths.iter().all(|d| *d > 0.0))
            );
            let mut picture = Picture::new(1920, 1080).unwrap();
            let light = Surroundings { above: [1.0; 3], ..Default::default() };
            workspace
                .draw(
                    &shot,
                    &Scene { depth: None, kernel: &SmoothWindow, light: &light, gain: 1.0 },
                    &mut picture,
                )
                .unwrap();
            assert!(picture.pixels.iter().flatten().all(|v| v.is_finite() && (0.0..=1.001).contains(v)));
        }
    }
    assert!(
        !find(&Shot::new(&camera, T20), &Weather::steady(rate(25.0), DVec3::ZERO, Seconds(0.0))).is_empty()
    );
}

#[test]
fn depth_of_zero_and_of_no_number_is_left_alone_and_of_infinity_is_endless_rain() {
    let projection = Projection::Perspective { vertical_fov: squall_formats::units::Degrees(60.0).into() };
    let camera = Camera::new(DVec3::Z * 2.0, DVec3::X, DVec3::Z, projection, [4, 2]).unwrap();
    let metres = [0.0, f32::NAN, -1.0, f32::NEG_INFINITY, f32::INFINITY, 1e-30, 1e30, 100.0];
    let medium = Medium::whole(rate(25.0));
    let light = medium.in_scattering(&WorldLight::uniform([1.0; 3]));
    println!("| holes at | transmittance of 0, NaN, −1, −∞, ∞, 1e-30, 1e30, 100 m |");
    for (unknown, hole) in [(f64::INFINITY, 0.0), (f64::NAN, 1.0), (-5.0, 1.0), (0.0, 1.0), (1e-9, 1.0)] {
        for kind in [DepthKind::Planar, DepthKind::Range] {
            let holes = DepthHoles::At(Metres(unknown));
            let depth = DepthBuffer::new(&metres, 4, 2, kind).unwrap().with_holes(holes);
            let outlook =
                Outlook { camera: &camera, volume: RainVolume::default(), light: &light, depth: Some(depth) };
            let mut picture = Picture::new(4, 2).unwrap();
            picture.pixels.fill([f32::INFINITY; 3]);
            picture.pixels[7] = [3.0; 3];
            let mut left = [f32::NAN; 8];
            assert_eq!(medium.apply(&outlook, &mut picture, &mut left).unwrap(), 4);
            println!("| {unknown} | {left:?} |");
            assert!(left[..4].iter().all(|&v| v == hole), "{unknown}: {left:?}");
            assert_eq!(left[4..7], [0.0, 1.0, 0.0]);
            let secant = if kind == DepthKind::Planar { camera.secants().at(3.5, 1.5) } else { 1.0 };
            let wanted = libm::exp(-medium.extinction().0 * 100.0 * secant);
            assert!(
                (f64::from(left[7]) - wanted).abs() < 1e-6
                    && picture.pixels.iter().flatten().all(|v| !v.is_nan())
            );
        }
    }
}

#[test]
fn views_at_the_ends_of_their_ranges_are_drawn_with_finite_light_or_refused_by_name() {
    let asset = asset(sections());
    let mut renderer = StormRenderer::new(&asset).unwrap();
    type Change = fn(&mut ViewSection);
    let cases: [(&str, Change); 24] = [
        ("fov 1°", |v| v.camera.vertical_fov_rad = 0.01745),
        ("fov .06°", |v| v.camera.vertical_fov_rad = 1e-3),
        ("fov 179°", |v| v.camera.vertical_fov_rad = 3.1241),
        ("fov 179.3°", |v| v.camera.vertical_fov_rad = 3.13),
        ("exposure 0", |v| v.camera.exposure_s = 0.0),
        ("exposure 1 µs", |v| v.camera.exposure_s = 1e-6),
        ("exposure 1 s", |v| v.camera.exposure_s = 1.0),
        ("exposure 10 s", |v| v.camera.exposure_s = 10.0),
        ("rate 0", |v| v.rain.rate_mm_per_h = 0.0),
        ("rate .01", |v| v.rain.rate_mm_per_h = 0.01),
        ("rate 300", |v| v.rain.rate_mm_per_h = 300.0),
        ("straight up", |v| v.camera.pitch_rad = std::f64::consts::FRAC_PI_2),
        ("straight down", |v| v.camera.pitch_rad = -std::f64::consts::FRAC_PI_2),
        ("one pixel", |v| v.camera.size_px = [1, 1]),
        ("one column", |v| v.camera.size_px = [1, 60]),
        ("ten thousand kilometres away", |v| v.camera.position_m = [1e7, -1e7, 1e7]),
        ("a day later", |v| v.rain.time_s = 86_400.0),
        ("thirty years later", |v| v.rain.time_s = 1e9),
        ("a wind of 200 m/s", |v| v.rain.wind_m_per_s = [200.0, -200.0, 200.0]),
        ("brightness 1e12", |v| v.flashes[0].brightness = 1e12),
        ("haze 50", |v| v.sky.haze = 50.0),
        ("sun at the zenith", |v| v.sky.sun_elevation_rad = std::f64::consts::FRAC_PI_2),
        ("no softness", |v| v.rain.ceiling_m = Some([900.0, 0.0])),
        ("rain within 0 m", |v| v.rain.region_m = Some([0.0, 0.0, 0.0, 0.0])),
    ];
    println!("| view | light or refusal |");
    for (name, change) in cases {
        let mut view = renderer.view().unwrap().clone();
        view.camera.size_px = [48, 32];
        view.rain.rate_mm_per_h = 10.0;
        change(&mut view);
        let mut frame = Frame::from(&view);
        frame.quality.rays = squall_runtime::single_scatter::DirectRays::PerPoint(64);
        match renderer.render(&frame) {
            Ok(picture) => {
                let bad = picture.pixels.iter().flatten().filter(|v| !(v.is_finite() && **v >= 0.0)).count();
                let sum: f64 = picture.pixels.iter().flatten().map(|&v| f64::from(v)).sum();
                println!("| {name} | {:.3e}, {bad} bad |", sum / (3.0 * picture.pixels.len() as f64));
                assert_eq!(bad, 0, "{name}");
                let shown = Tone::default().to_srgb8(picture);
                assert_eq!(shown.len(), picture.pixels.len());
            }
            Err(error) => {
                println!("| {name} | {error} |");
                assert!(name.starts_with("exposure") || name.starts_with("rate 300"), "{name}: {error}");
            }
        }
    }
}
