use super::hits::{Class, Columns, Fall, Hit};
use super::*;
use crate::wet::drop::stage::Stage;
use crate::wet::ripples::DropFlux;
use glam::DVec3;

/// Poisson: five standard deviations.
const SIGMAS: f64 = 5.0;

fn looking_down() -> Stage {
    Stage::new(DVec3::new(3.0, -1.0, 3.0), DVec3::new(3.0, 1.5, 0.0), [160, 120])
}

fn hits(stage: &Stage, drop: &DropFlux, life_s: f64, time_s: f64) -> Vec<Hit> {
    let frame = stage.frame(time_s);
    let (eye, fall) = (Eye::new(&stage.camera), Fall::new(&frame));
    let mut columns = Columns::default();
    columns.read(&stage.buffer, &eye, 100.0, true);
    let class = Class { drop, stream: 0, life_s, far_m: 100.0, fall: &fall };
    let mut all = Vec::new();
    columns.hits(&frame, &eye, &class, |hit| all.push(hit.clone()));
    all
}

/// Area of the ground that the frame shows, m²: what each pixel's rays span.
fn area(stage: &Stage) -> f64 {
    let eye = Eye::new(&stage.camera);
    let pixel = |k: usize| {
        let (x, y) = ((k % 160) as f32, (k / 160) as f32);
        let corner = |x: f32, y: f32| {
            let d = eye.direction(x, y);
            (d * (-3.0 / d.z)).as_dvec3()
        };
        let (a, b, c) = (corner(x, y), corner(x + 1.0, y), corner(x, y + 1.0));
        (b - a).cross(c - a).length()
    };
    let ground = |k: usize| {
        let place = stage.buffer.place(&stage.camera, k % 160, k / 160);
        place.is_some_and(|place| place.z < 0.01)
    };
    (0..160 * 120).filter(|&k| ground(k)).map(pixel).sum()
}

#[test]
fn as_many_drops_hit_the_ground_as_the_flux_brings() {
    let stage = looking_down();
    let drop = DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 900.0 };
    let seen = |hit: &Hit| hit.place.z < 0.01 && Eye::new(&stage.camera).pixel(&hit.spot).is_some();
    let found: usize = (0..20)
        .map(|k| hits(&stage, &drop, 0.1, 0.1 * f64::from(k)).iter().filter(|hit| seen(hit)).count())
        .sum();
    let expected = 20.0 * 0.1 * 900.0 * area(&stage);
    assert!((found as f64 - expected).abs() < SIGMAS * expected.sqrt(), "{found} of {expected}");
}

#[test]
fn wind_brings_walls_what_it_takes_past_their_edges() {
    // Rain that falls as fast as it is blown hits a wall across the wind as often as the ground.
    let mut stage = Stage::new(DVec3::new(0.0, 1.0, 0.5), DVec3::new(0.0, 4.0, 0.5), [64, 48]);
    stage.wind = DVec3::new(0.0, 6.5, 0.0);
    let drop = DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 900.0 };
    let inside = |hit: &Hit| {
        hit.normal.y < -0.5 && hit.place.x.abs() < 0.75 && hit.place.z > 0.25 && hit.place.z < 0.75
    };
    let found: usize = (0..40)
        .map(|k| hits(&stage, &drop, 0.1, 0.1 * f64::from(k)).iter().filter(|hit| inside(hit)).count())
        .sum();
    let expected = 40.0 * 0.1 * 900.0 * 1.5 * 0.5;
    assert!((found as f64 - expected).abs() < SIGMAS * expected.sqrt(), "{found} of {expected}");
    stage.wind = DVec3::ZERO;
    assert!(!hits(&stage, &drop, 0.1, 0.3).iter().any(|hit| hit.normal.y < -0.5));
}

#[test]
fn under_a_roof_nothing_is_hit() {
    let mut stage = looking_down();
    stage.roof(3.0, 4.0);
    let drop = DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 900.0 };
    let all = hits(&stage, &drop, 0.1, 0.7);
    assert!(!all.is_empty() && all.iter().all(|hit| hit.place.x >= 3.0));
    // Wind from the open side carries rain under it: as far as the roof is high over the drops' speed.
    stage.wind = DVec3::new(-6.5, 0.0, 0.0);
    let least = hits(&stage, &drop, 0.1, 0.7).iter().map(|hit| hit.place.x).fold(f64::INFINITY, f64::min);
    assert!(least < 1.0, "{least}");
}

#[test]
fn a_place_keeps_its_hits_as_the_camera_moves() {
    let drop = DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 300.0 };
    let inside = |hit: &Hit| (hit.place - DVec3::new(3.0, 1.5, 0.0)).length() < 0.5;
    let places = |stage: &Stage| {
        let mut all: Vec<[i64; 3]> = hits(stage, &drop, 0.1, 5.03)
            .iter()
            .filter(|hit| inside(hit))
            .map(|hit| {
                [
                    (hit.place.x * 1e4).round() as i64,
                    (hit.place.y * 1e4).round() as i64,
                    (hit.age_s * 1e6) as i64,
                ]
            })
            .collect();
        all.sort_unstable();
        all
    };
    let here = places(&looking_down());
    let moved = Stage::new(DVec3::new(1.0, 0.4, 2.0), DVec3::new(3.2, 1.6, 0.0), [200, 140]);
    assert!(here.len() > 10);
    assert_eq!(here, places(&moved));
}

#[test]
fn without_rain_the_frame_keeps_its_bits() {
    let mut stage = looking_down();
    stage.flux = vec![DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 0.0 }];
    let (mut splashes, mut layer) = (Splashes::new(), Layer::default());
    let report = splashes.draw(&stage.frame(1.0), &SplashControls::default(), &mut layer).unwrap();
    assert_eq!(report, SplashReport::default());
    let mut picture = stage.buffer.colour.clone();
    layer.onto(&mut picture).unwrap();
    assert_eq!(picture, stage.buffer.colour);
}

#[test]
fn drawn_one_by_one_or_as_haze_splashes_cover_as_much() {
    /// Some thousand splashes of random size: their sum scatters by a few hundredths; a table of three elevations; half an octave of distances.
    const SHARE: f64 = 0.12;
    let mut stage = looking_down();
    // Thin enough that hardly two overlap.
    stage.flux = vec![DropFlux { diameter_m: 3e-3, speed_m_per_s: 8.0, impacts_per_m2_s: 60.0 }];
    let mut splashes = Splashes::new();
    let mut covered = |smallest_px: f32| {
        let controls = SplashControls { smallest_px, ..SplashControls::default() };
        let mut layer = Layer::default();
        let sum = |layer: &Layer| layer.alpha.iter().map(|&alpha| f64::from(alpha)).sum::<f64>();
        let times = 0..60;
        times
            .map(|k| {
                splashes.draw(&stage.frame(0.21 * f64::from(k)), &controls, &mut layer).unwrap();
                sum(&layer)
            })
            .sum::<f64>()
    };
    let (drawn, haze) = (covered(1.0), covered(64.0));
    assert!((drawn / haze - 1.0).abs() < SHARE, "{drawn} {haze}");
}

#[test]
fn the_same_time_gives_the_same_splashes_whatever_was_drawn_before() {
    let stage = looking_down();
    let (mut one, mut two) = (Splashes::new(), Splashes::new());
    let (mut first, mut second) = (Layer::default(), Layer::default());
    let controls = SplashControls { smallest_px: 1.0, ..SplashControls::default() };
    let report = one.draw(&stage.frame(-2.5), &controls, &mut first).unwrap();
    two.draw(&stage.frame(9.0), &controls, &mut second).unwrap();
    two.draw(&stage.frame(-2.5), &controls, &mut second).unwrap();
    assert_eq!(first, second);
    assert!(report.splashes > 10 && report.pixels > 100);
}

#[test]
fn light_behind_a_splash_brightens_it_more_than_light_before_it() {
    use crate::world::Sun;
    let lit = |towards: glam::Vec3| {
        let mut stage = looking_down();
        let sun = Sun { towards, irradiance: [3.0; 3], angular_radius: Sun::ANGULAR_RADIUS };
        stage.light = stage.light.with_sun(Some(sun));
        let mut layer = Layer::default();
        Splashes::new().draw(&stage.frame(1.0), &SplashControls::default(), &mut layer).unwrap();
        layer.light.iter().map(|light| f64::from(light[1])).sum::<f64>()
    };
    let low = glam::Vec3::new(0.0, 0.9, 0.4).normalize();
    assert!(lit(low) > 1.5 * lit(glam::Vec3::new(0.0, -low.y, low.z)));
}

#[test]
fn rain_that_is_no_rain_is_refused() {
    let mut stage = looking_down();
    stage.flux[0].impacts_per_m2_s = f64::NAN;
    let mut layer = Layer::default();
    assert!(Splashes::new().draw(&stage.frame(1.0), &SplashControls::default(), &mut layer).is_err());
    let stage = looking_down();
    let beyond = WetFrame { time_s: f64::INFINITY, ..stage.frame(0.0) };
    assert!(Splashes::new().draw(&beyond, &SplashControls::default(), &mut layer).is_err());
}

#[test]
fn controls_out_of_their_ranges_are_refused() {
    let (stage, mut layer) = (looking_down(), Layer::default());
    for smallest_px in [0.0, f32::NAN, 1e9] {
        let controls = SplashControls { smallest_px, ..SplashControls::default() };
        assert!(Splashes::new().draw(&stage.frame(1.0), &controls, &mut layer).is_err());
    }
}
