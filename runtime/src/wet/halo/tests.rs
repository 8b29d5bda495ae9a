use super::*;
use crate::wet::drop::stage::{HIGH, LOW, Stage};
use crate::wet::maps::Fin;

fn stage() -> Stage {
    Stage::new(DVec3::new(0.0, 0.0, 1.15), DVec3::new(0.0, 5.0, 0.9), [240, 180])
}

/// The upper edges of the stage's box.
fn fins() -> Vec<Fin> {
    let corner = |x: f64, y: f64| DVec3::new(x, y, HIGH.z);
    let corners =
        [corner(LOW.x, LOW.y), corner(HIGH.x, LOW.y), corner(HIGH.x, HIGH.y), corner(LOW.x, HIGH.y)];
    let sides = [DVec3::NEG_Y, DVec3::X, DVec3::Y, DVec3::NEG_X];
    (0..4)
        .map(|k| Fin { ends_m: [corners[k], corners[(k + 1) % 4]], normals: [DVec3::Z, sides[k]] })
        .collect()
}

fn covered(stage: &Stage, controls: &HaloControls) -> (f64, HaloReport) {
    let mut layer = Layer::default();
    let report = Halos::new().draw(&stage.frame(1.0), controls, &mut layer).unwrap();
    (layer.alpha.iter().map(|&alpha| f64::from(alpha)).sum(), report)
}

#[test]
fn mist_is_as_dense_as_the_rain_brings() {
    /// Thin mist: 1 − e^{−τ} is τ within a twentieth.
    const THIN: f64 = 0.05;
    let mut stage = stage();
    let controls = HaloControls { flicker: 0.0, amount: 1.0, ..HaloControls::default() };
    let (once, report) = covered(&stage, &controls);
    assert!(report.edges > 50 && report.fins == 0);
    stage.flux.iter_mut().for_each(|drop| drop.impacts_per_m2_s *= 2.0);
    let (twice, _) = covered(&stage, &controls);
    assert!((twice / once - 2.0).abs() < 2.0 * THIN, "{once} {twice}");
}

#[test]
fn fins_and_edges_of_depth_show_the_same_mist() {
    /// Rows of pixels begin at an edge or half of one off; fins know the sides that a column misses.
    const ALIKE: f64 = 0.25;
    let mut stage = stage();
    let controls = HaloControls { flicker: 0.0, ..HaloControls::default() };
    let (by_depth, _) = covered(&stage, &controls);
    stage.maps.fins = fins();
    let (by_fins, report) = covered(&stage, &controls);
    // The far edge and both sides are silhouettes; the near edge is not.
    assert_eq!(report.fins, 3);
    assert!((by_fins / by_depth - 1.0).abs() < ALIKE, "{by_fins} {by_depth}");
}

#[test]
fn mist_flickers_about_its_mean_and_keeps_its_place() {
    let stage = stage();
    let (mean, _) = covered(&stage, &HaloControls { flicker: 0.0, ..HaloControls::default() });
    let draw = |time: f64| {
        let mut layer = Layer::default();
        Halos::new().draw(&stage.frame(time), &HaloControls::default(), &mut layer).unwrap();
        layer
    };
    let sums: Vec<f64> =
        (0..12).map(|k| draw(f64::from(k)).alpha.iter().map(|&alpha| f64::from(alpha)).sum()).collect();
    let average = sums.iter().sum::<f64>() / 12.0;
    assert!((average / mean - 1.0).abs() < 0.1, "{average} {mean}");
    assert_eq!(draw(3.0), draw(3.0));
    assert_ne!(draw(3.0), draw(4.0));
}

#[test]
fn there_is_no_mist_without_rain_or_under_a_roof() {
    let mut stage = stage();
    stage.roof(9.9, 4.0);
    assert_eq!(covered(&stage, &HaloControls::default()).0, 0.0);
    stage.maps.fins = fins();
    assert_eq!(covered(&stage, &HaloControls::default()).0, 0.0);
    stage.maps.height_m = None;
    stage.flux.clear();
    let mut layer = Layer::default();
    Halos::new().draw(&stage.frame(1.0), &HaloControls::default(), &mut layer).unwrap();
    let mut picture = stage.buffer.colour.clone();
    layer.onto(&mut picture).unwrap();
    assert_eq!(picture, stage.buffer.colour);
}

#[test]
fn a_light_behind_makes_a_brighter_halo_than_one_before() {
    use crate::world::Sun;
    let lit = |y: f32| {
        let mut stage = stage();
        let towards = Vec3::new(0.0, y, 0.3).normalize();
        let sun = Sun { towards, irradiance: [2.0; 3], angular_radius: Sun::ANGULAR_RADIUS };
        stage.light = stage.light.with_sun(Some(sun));
        let mut layer = Layer::default();
        Halos::new().draw(&stage.frame(1.0), &HaloControls::default(), &mut layer).unwrap();
        layer.light.iter().map(|light| f64::from(light[1])).sum::<f64>()
    };
    assert!(lit(1.0) > 2.0 * lit(-1.0));
}

#[test]
fn mist_stands_as_high_as_droplets_are_on_the_mean() {
    /// A rule of midpoints for a parabola.
    const RULE: f64 = 1e-6;
    let (speed, steps) = (1.7, 2000);
    let flight = 2.0 * speed / GRAVITY;
    let height = |k: u32| {
        let t = (f64::from(k) + 0.5) / f64::from(steps) * flight;
        speed * t - 0.5 * GRAVITY * t * t
    };
    let mean = (0..steps).map(height).sum::<f64>() / f64::from(steps);
    assert!((mean_height_m(speed) / mean - 1.0).abs() < RULE);
}

#[test]
fn controls_out_of_their_ranges_are_refused() {
    let (stage, mut layer) = (stage(), Layer::default());
    let controls = HaloControls { throw_m_per_s: 0.0, ..HaloControls::default() };
    assert!(Halos::new().draw(&stage.frame(1.0), &controls, &mut layer).is_err());
}
