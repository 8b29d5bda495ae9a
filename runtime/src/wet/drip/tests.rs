use super::*;
use crate::wet::drop::stage::Stage;

fn edge() -> DripEdge {
    DripEdge { ends_m: [DVec3::new(-1.0, 3.0, 2.0), DVec3::new(1.0, 3.0, 2.0)], drains_m2: 3.0 }
}

fn stage() -> Stage {
    let mut stage = Stage::new(DVec3::new(0.0, 0.5, 1.2), DVec3::new(0.0, 3.0, 1.3), [200, 150]);
    stage.maps.drips = vec![edge()];
    stage
}

/// Every drop of the edge.
fn every_drop(stage: &Stage, time: f64, controls: &DripControls, mut each: impl FnMut(Drop)) {
    let (frame, mut spots) = (stage.frame(time), Vec::new());
    assert!(!spouts(&[edge()], &frame, &Eye::new(&stage.camera), controls, &mut spots));
    spots.iter().for_each(|spout| each_drop(spout, 1.0, &frame, controls, &mut each));
}

#[test]
fn as_much_water_drips_as_drains() {
    let (stage, controls) = (stage(), DripControls { amount: 1.0, ..DripControls::default() });
    let wanted = drops_per_s(&edge(), 25.0, &controls);
    let volume = PI / 6.0 * 5e-3f64 * 5e-3 * 5e-3;
    assert!((wanted * volume - 25e-3 / 3600.0 * 3.0).abs() < 1e-12);
    // Drops younger than a tenth of a second, over many times: each is let go once.
    let mut young = 0;
    for k in 0..200 {
        every_drop(&stage, 0.1 * f64::from(k), &controls, |one| {
            young += usize::from(!one.hangs && one.velocity.z > -0.9768);
        });
    }
    // A spot is cut where it would drip faster than a thread breaks: none here. Unrest moves a few drops over the ends.
    let expected = wanted * 200.0 * 0.1;
    assert!((young as f64 / expected - 1.0).abs() < 0.03, "{young} {expected}");
}

#[test]
fn no_rain_drips_nothing_and_leaves_the_frame_its_bits() {
    let stage = stage();
    let mut layer = Layer::default();
    let dry = WetFrame { rate_mm_per_h: 0.0, ..stage.frame(3.0) };
    assert_eq!(Drips::new().draw(&dry, &DripControls::default(), &mut layer).unwrap(), DripReport::default());
    let mut picture = stage.buffer.colour.clone();
    layer.onto(&mut picture).unwrap();
    assert_eq!(picture, stage.buffer.colour);
}

#[test]
fn drops_behind_what_is_nearer_are_hidden() {
    let mut stage = stage();
    let (mut layer, controls) = (Layer::default(), DripControls::default());
    let seen = Drips::new().draw(&stage.frame(3.0), &controls, &mut layer).unwrap();
    assert!(seen.falling > 20 && seen.hanging > 2, "{seen:?}");
    stage.buffer.depth_m.fill(1.0);
    assert_eq!(Drips::new().draw(&stage.frame(3.0), &controls, &mut layer).unwrap().pixels, 0);
}

#[test]
fn the_same_time_gives_the_same_drops_and_wind_takes_them_along() {
    let mut stage = stage();
    let (mut first, mut second, controls) = (Layer::default(), Layer::default(), DripControls::default());
    let mut drips = Drips::new();
    drips.draw(&stage.frame(3.0), &controls, &mut first).unwrap();
    drips.draw(&stage.frame(-7.0), &controls, &mut second).unwrap();
    drips.draw(&stage.frame(3.0), &controls, &mut second).unwrap();
    assert_eq!(first, second);
    let mean = |stage: &Stage| {
        let (mut sum, mut count) = (0.0, 0.0);
        every_drop(stage, 3.0, &controls, |one| {
            (sum, count) = (sum + one.place.x, count + 1.0);
        });
        sum / count
    };
    let still = mean(&stage);
    stage.wind = DVec3::new(5.0, 0.0, 0.0);
    assert!(mean(&stage) > still + 0.02);
}

#[test]
fn what_drips_is_opaque_no_more_than_wholly() {
    let stage = stage();
    let mut layer = Layer::default();
    let controls = DripControls { edge_strength: 10.0, edge_bias: 10.0, ..DripControls::default() };
    Drips::new().draw(&stage.frame(3.0), &controls, &mut layer).unwrap();
    assert!(layer.alpha.iter().all(|alpha| (0.0..=1.0).contains(alpha)));
    assert!(layer.light.iter().flatten().all(|light| light.is_finite() && *light >= 0.0));
}

#[test]
fn an_edge_that_is_nowhere_is_refused() {
    let stage = stage();
    let broken = DripEdge { drains_m2: f32::NAN, ..edge() };
    let mut layer = Layer::default();
    assert!(
        Drips::new().draw_from(&[broken], &stage.frame(0.0), &DripControls::default(), &mut layer).is_err()
    );
    // As long as the world, and as wet: bounded work.
    let long = DripEdge { ends_m: [DVec3::ZERO, DVec3::new(1e9, 0.0, 2.0)], drains_m2: 1e9 };
    assert!(Drips::new().draw_from(&[long], &stage.frame(0.0), &DripControls::default(), &mut layer).is_ok());
}

#[test]
fn a_thousand_edges_of_any_wetness_are_followed_in_bounded_number() {
    let stage = stage();
    let (eye, frame) = (Eye::new(&stage.camera), stage.frame(3.0));
    let wet = |k: usize| {
        let y = 2.5 + 1e-3 * k as f64;
        DripEdge { ends_m: [DVec3::new(-4.0, y, 2.0), DVec3::new(4.0, y, 2.0)], drains_m2: 1e9 }
    };
    let edges: Vec<_> = (0..1000).map(wet).collect();
    let mut drips = Drips::new();
    assert!(drips.find(&edges, &frame, &eye, &DripControls::default()));
    assert!(drips.spots.len() as f64 <= ALL_SPOTS);
    // Most of what is followed is in the picture; single drops come and go.
    assert!(
        (DROPS_MOST * 0.1..DROPS_MOST * 1.05).contains(&(drips.drops.len() as f64)),
        "{}",
        drips.drops.len()
    );
    // So long that spots have to be fewer.
    let long = |k: usize| {
        let DripEdge { ends_m: [from, to], drains_m2 } = wet(k);
        DripEdge { ends_m: [from * DVec3::new(100.0, 1.0, 1.0), to * DVec3::new(100.0, 1.0, 1.0)], drains_m2 }
    };
    let edges: Vec<_> = (0..1000).map(long).collect();
    assert!(drips.find(&edges, &frame, &eye, &DripControls::default()));
    assert!(drips.spots.len() as f64 <= ALL_SPOTS && !drips.drops.is_empty());
    let mut layer = Layer::default();
    let (all, controls) = (vec![edge(); EDGES_MOST + 1], DripControls::default());
    assert!(Drips::new().draw_from(&all, &frame, &controls, &mut layer).is_err());
}

#[test]
fn edges_out_of_sight_cost_the_ones_in_sight_nothing() {
    let stage = stage();
    let (mut one, mut other, controls) = (Layer::default(), Layer::default(), DripControls::default());
    let alone = Drips::new().draw(&stage.frame(3.0), &controls, &mut one).unwrap();
    let behind =
        DripEdge { ends_m: [DVec3::new(-90.0, -60.0, 3.0), DVec3::new(90.0, -60.0, 3.0)], drains_m2: 1e9 };
    let mut edges = vec![behind; 200];
    edges[0] = edge();
    let with = Drips::new().draw_from(&edges, &stage.frame(3.0), &controls, &mut other).unwrap();
    assert_eq!((alone, &one), (with, &other));
    assert!(!alone.thinned && alone.falling > 20);
}

#[test]
fn drops_fall_from_high_eaves_to_the_ground() {
    let mut stage = stage();
    let high =
        DripEdge { ends_m: [DVec3::new(-1.0, 3.0, 60.0), DVec3::new(1.0, 3.0, 60.0)], drains_m2: 30.0 };
    stage.maps.drips = vec![high];
    let (mut layer, controls) = (Layer::default(), DripControls::default());
    // Sixty metres take some seven seconds.
    let open = Drips::new().draw(&stage.frame(3.0), &controls, &mut layer).unwrap();
    assert!(open.falling > 20, "{open:?}");
    // Ground at one metre of height ends them there, though the picture goes on below.
    stage.maps.height_m = Some(crate::wet::maps::GroundMap {
        origin_m: glam::DVec2::new(-5.0, 0.0),
        cell_m: 1.0,
        size: [10, 10],
        values: vec![1.0; 100],
    });
    let mut drips = Drips::new();
    drips.find(&stage.maps.drips, &stage.frame(3.0), &Eye::new(&stage.camera), &controls);
    assert!(!drips.drops.is_empty() && drips.drops.iter().all(|(_, one)| one.place.z > 1.0));
}

#[test]
fn the_papers_drops_look_otherwise_and_controls_are_held_to_their_ranges() {
    let stage = stage();
    let (mut one, mut other) = (Layer::default(), Layer::default());
    let paper = DripControls { paper: 1.0, ..DripControls::default() };
    Drips::new().draw(&stage.frame(3.0), &paper, &mut one).unwrap();
    Drips::new().draw(&stage.frame(3.0), &DripControls::default(), &mut other).unwrap();
    assert_ne!(one, other);
    assert!(one.alpha.iter().all(|alpha| (0.0..=1.0).contains(alpha)));
    let wrong = DripControls { spacing_m: 0.0, ..DripControls::default() };
    assert!(Drips::new().draw(&stage.frame(3.0), &wrong, &mut one).is_err());
}
