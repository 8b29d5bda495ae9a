use super::*;
use crate::wet::draw::flux_of;
use crate::wet::drop::stage::Stage;
use glam::DVec3;
use squall_formats::units::MillimetresPerHour;

/// Single precision.
const ROUND_OFF: f32 = 1e-5;

fn stage() -> Stage {
    let mut stage = Stage::new(DVec3::new(3.0, 0.0, 1.6), DVec3::new(3.0, 5.0, 1.6), [96, 72]);
    stage.flux = flux_of(MillimetresPerHour(5.0));
    stage
}

fn controls() -> WindscreenControls {
    WindscreenControls { cell: 4.0, wets: 2.0, ..WindscreenControls::default() }
}

fn drawn(pane: &mut Windscreen, stage: &Stage, time: f64, controls: &WindscreenControls) -> (Layer, u64) {
    let mut layer = Layer::default();
    let frame = stage.frame(time);
    let report = pane.draw((&frame, frame.colour), controls, &mut layer).unwrap();
    (layer, report.pixels)
}

#[test]
fn a_dry_pane_leaves_the_frame_its_bits_and_so_does_dry_glass_between_drops() {
    let mut dry = stage();
    dry.flux.clear();
    let (layer, pixels) = drawn(&mut Windscreen::new(), &dry, 1.0, &controls());
    assert!(pixels == 0 && layer.alpha.iter().all(|alpha| *alpha == 0.0));
    let stage = stage();
    let (layer, pixels) = drawn(&mut Windscreen::new(), &stage, 1.0, &controls());
    let mut picture = stage.buffer.colour.clone();
    layer.onto(&mut picture).unwrap();
    let kept = picture.iter().zip(&stage.buffer.colour).filter(|(a, b)| a == b).count();
    assert!(pixels > 200 && kept > 200, "{pixels} {kept}");
}

#[test]
fn the_same_time_shows_the_same_drops_whichever_frames_were_before() {
    let stage = stage();
    let straight = drawn(&mut Windscreen::new(), &stage, 2.0, &controls()).0;
    let mut pane = Windscreen::new();
    for time in [0.3, 1.1, 3.0] {
        drawn(&mut pane, &stage, time, &controls());
    }
    assert_eq!(straight, drawn(&mut pane, &stage, 2.0, &controls()).0);
    assert_ne!(straight, drawn(&mut pane, &stage, 2.5, &controls()).0);
}

#[test]
fn wipers_leave_a_clearer_view_in_their_way_and_drops_beside() {
    let mut stage = stage();
    for (k, colour) in stage.buffer.colour.iter_mut().enumerate() {
        *colour = [0.2 + (k % 96) as f32 / 96.0, 0.2 + (k / 96) as f32 / 72.0, 0.3];
    }
    // Blades that let nothing slip: what they leave behind is a film of its own.
    let still = WindscreenControls { rain: 2.0, leaves: 0.0, ..controls() };
    let (wet, _) = drawn(&mut Windscreen::new(), &stage, 0.4, &still);
    let wiped = WindscreenControls { wipers: 60.0, ..still };
    let (wiped, _) = drawn(&mut Windscreen::new(), &stage, 0.4, &wiped);
    // How far light was moved, in a picture that grades from side to side and from above.
    let moved = |layer: &Layer, rows: std::ops::Range<usize>, columns: std::ops::Range<usize>| -> f32 {
        let pixels = rows.flat_map(|y| columns.clone().map(move |x| y * 96 + x));
        let off = |at: usize| (layer.light[at][0] - stage.buffer.colour[at][0]).abs() * layer.alpha[at];
        pixels.map(off).sum()
    };
    // Between the blades, which stand on both sides of it just now; the upper corner to the right is out of reach.
    let [before, after] = [&wet, &wiped].map(|layer| moved(layer, 30..60, 22..48));
    assert!(after < 0.7 * before && before > 0.3, "{before} {after}");
    let [before, after] = [&wet, &wiped].map(|layer| moved(layer, 0..6, 90..96));
    assert!((after / before - 1.0).abs() < 0.5, "{before} {after}");
}

#[test]
fn water_with_an_even_surface_bends_nothing_and_a_drops_lower_rim_looks_up() {
    let index = WATER_INDEX as f32;
    let direction = Vec3::new(0.3, -0.2, 0.8).normalize();
    let inside = bent(direction, Vec3::Z, 1.0 / index).unwrap();
    assert!((inside.truncate() * index - direction.truncate()).length() < ROUND_OFF, "Snell's law");
    assert!(bent(inside, Vec3::Z, index).unwrap().distance(direction) < ROUND_OFF);
    // At the lower rim water grows thicker upwards: its surface looks down there, and the ray goes up.
    let outwards = Vec3::new(0.0, -0.5, 1.0).normalize();
    assert!(bent(Vec3::Z, outwards, index).unwrap().y > 0.1);
    assert_eq!(bent(Vec3::Z, Vec3::new(0.0, -1.3, 1.0).normalize(), index), None, "total reflection");
}

#[test]
fn before_time_0_the_pane_is_the_first_ones_and_dry_before_its_rain() {
    let stage = stage();
    let mut pane = Windscreen::new();
    for time in [-1e300, -3.0] {
        assert_eq!(drawn(&mut pane, &stage, time, &controls()).1, 0);
    }
    let (early, pixels) = drawn(&mut pane, &stage, -0.1, &controls());
    assert!(pixels > 0);
    assert_eq!(early, drawn(&mut Windscreen::new(), &stage, -0.1, &controls()).0);
    let later = drawn(&mut pane, &stage, 0.3, &controls()).0;
    assert_eq!(later, drawn(&mut Windscreen::new(), &stage, 0.3, &controls()).0);
}

#[test]
fn no_pane_has_too_many_cells_and_blades_sweep_a_dry_one() {
    let mut stage = stage();
    for (distance, height_m) in [(0.7, 0.8), (5.0, 5.8), (5.0, 1640.0), (5.0, 1e6)] {
        let controls = WindscreenControls { distance, cell: 0.5, ..controls() };
        let settings = settings(&stage.frame(0.0), &controls, height_m);
        assert!((settings.cells[0] * settings.cells[1]) as f64 <= CELLS_MOST, "{height_m}");
        assert!(Glass::new(settings).is_ok(), "{height_m}");
    }
    stage.flux.clear();
    let (layer, pixels) =
        drawn(&mut Windscreen::new(), &stage, 0.4, &WindscreenControls { wipers: 60.0, ..controls() });
    assert!(pixels > 50 && layer.alpha.contains(&1.0), "{pixels}");
}

#[test]
fn drops_run_up_where_the_wind_of_driving_lifts_them() {
    let (stage, still) = (stage(), controls());
    // As strong a pull the other way: the same water, upside down.
    let lifted = WindscreenControls { lift: 2.0 * gravity(&still), ..still };
    // Long enough that what runs has come to the pane's end.
    let [falls, rises] =
        [still, lifted].map(|controls| drawn(&mut Windscreen::new(), &stage, 10.0, &controls).0);
    let bands =
        |layer: &Layer| -> Vec<f32> { layer.alpha.chunks(96 * 12).map(|band| band.iter().sum()).collect() };
    let (falls, rises) = (bands(&falls), bands(&rises));
    assert!(falls[5] > 1.2 * falls[0], "water gathers below: {falls:?}");
    assert_eq!(rises.iter().rev().copied().collect::<Vec<f32>>(), falls);
    for wrong in
        [WindscreenControls { distance: 0.0, ..still }, WindscreenControls { hold: f32::NAN, ..still }]
    {
        let mut layer = Layer::default();
        let frame = stage.frame(1.0);
        assert!(Windscreen::new().draw((&frame, frame.colour), &wrong, &mut layer).is_err());
    }
}
