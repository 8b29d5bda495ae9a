use super::*;
use crate::wet::drop::stage::Stage;

fn stage() -> Stage {
    Stage::new(DVec3::new(3.0, 0.0, 1.6), DVec3::new(3.0, 5.0, 1.6), [320, 240])
}

fn draw(stage: &Stage, time: f64, controls: &LayerControls) -> (Layer, LayerReport) {
    let mut layer = Layer::default();
    let report = Layers::new(5).draw(&stage.frame(time), controls, &mut layer).unwrap();
    (layer, report)
}

#[test]
fn no_drops_come_again_within_a_view() {
    // A quarter of a million texels against themselves a texture's width on: bytes that are unrelated correlate as 1/√n does.
    let layers = Layers::new(5);
    let correlation = |key: u64, step: [i64; 2]| {
        let (mut sum, count) = (0.0, 512i64);
        for k in 0..count * count {
            let [x, y] = [k % count - 256, k / count - 256];
            let one = f64::from(layers.byte(key, x, y)) - 127.5;
            sum += one * (f64::from(layers.byte(key, x + step[0], y + step[1])) - 127.5);
        }
        sum / (count * count) as f64 / (256.0 * 256.0 / 12.0)
    };
    for step in [[256, 0], [0, 256], [256, 256], [-256, 512], [1, 0], [0, 1]] {
        assert!(correlation(7, step).abs() < 0.01, "{step:?} {}", correlation(7, step));
    }
    assert!(correlation(0, [256, 0]) > 0.99, "the paper's one texture comes again");
}

#[test]
fn a_picture_of_rain_is_like_itself_nowhere_else() {
    let (layer, report) = draw(&stage(), 3.0, &LayerControls::default());
    assert!(report.pixels > 2000, "{report:?}");
    let mean = layer.alpha.iter().sum::<f32>() / layer.alpha.len() as f32;
    let at = |x: usize, y: usize| layer.alpha[y * 320 + x] - mean;
    let likeness = |dx: usize, dy: usize| {
        let mut sum = 0.0;
        for y in 0..240 - dy {
            for x in 0..320 - dx {
                sum += at(x, y) * at(x + dx, y + dy);
            }
        }
        sum / ((240 - dy) * (320 - dx)) as f32
    };
    let own = likeness(0, 0);
    let most = (12..160).map(|dx| likeness(dx, 0).max(likeness(dx, 60)) / own).fold(0.0, f32::max);
    assert!(most < 0.15, "{most}");
}

#[test]
fn rain_falls_by_the_time_that_has_gone_and_near_layers_faster() {
    let stage = stage();
    let eye = Eye::new(&stage.camera);
    let sheets_at =
        |time: f64| sheets(&stage.frame(time).weather(), &eye, &LayerControls::default()).unwrap().1;
    let (now, later) = (sheets_at(100.0), sheets_at(100.001));
    let gone = |k: usize| {
        let texels = |sheet: &Sheet| sheet.fallen.0 as f32 + sheet.fallen.1;
        (later[k].fallen.0 - now[k].fallen.0) as f32 * now[k].cell.y
            + (texels(&later[k]) - texels(&now[k]) - (later[k].fallen.0 - now[k].fallen.0) as f32)
                * now[k].cell.y
    };
    // Single precision of a thousandth of a second's fall.
    assert!((gone(0) / gone(1) - 2.0).abs() < 0.1, "{} {}", gone(0), gone(1));
    let (first, again) =
        (draw(&stage, 9.0, &LayerControls::default()), draw(&stage, 9.0, &LayerControls::default()));
    assert_eq!(first, again);
}

#[test]
fn as_many_drops_cover_the_picture_as_the_air_holds() {
    let mut stage = stage();
    let covered = |stage: &Stage| {
        let (layer, _) = draw(stage, 2.0, &LayerControls::default());
        layer.alpha.iter().map(|&alpha| f64::from(alpha)).sum::<f64>()
    };
    let once = covered(&stage);
    stage.flux.iter_mut().for_each(|drop| drop.impacts_per_m2_s *= 0.5);
    let half = covered(&stage);
    // Some hundred drops.
    assert!((half / once - 0.5).abs() < 0.12, "{half} {once}");
    stage.flux.clear();
    let (layer, report) = draw(&stage, 2.0, &LayerControls::default());
    assert_eq!(report, LayerReport::default());
    let mut picture = stage.buffer.colour.clone();
    layer.onto(&mut picture).unwrap();
    assert_eq!(picture, stage.buffer.colour);
}

#[test]
fn what_is_nearer_than_a_layer_hides_it() {
    let mut stage = stage();
    stage.buffer.depth_m.fill(0.5);
    assert_eq!(draw(&stage, 2.0, &LayerControls::default()).1.pixels, 0);
}

#[test]
fn the_papers_coordinates_stand_still() {
    // Whatever the time, one frame's step gives one place; and twice the speed goes four times as far.
    let once = paper_coordinates(Vec2::new(0.0, -2.0), 0.016, 1.0, 0.5);
    assert_eq!(paper_coordinates(Vec2::new(0.0, -4.0), 0.016, 1.0, 0.5), 4.0 * once);
    assert!(!paper_coordinates(Vec2::NEG_Y, 0.016, 1.0, 0.0).is_finite());
}

#[test]
fn controls_out_of_their_ranges_are_refused() {
    let (stage, mut layer) = (stage(), Layer::default());
    for layers in [0.0, 40.0, f32::NAN] {
        let controls = LayerControls { layers, ..LayerControls::default() };
        assert!(Layers::new(5).draw(&stage.frame(1.0), &controls, &mut layer).is_err());
    }
}

#[test]
fn the_papers_water_looks_otherwise() {
    let stage = stage();
    let paper = draw(&stage, 3.0, &LayerControls { paper: 1.0, ..LayerControls::default() }).0;
    assert!(paper.alpha.iter().all(|alpha| (0.0..=1.0).contains(alpha)));
    assert_ne!(paper, draw(&stage, 3.0, &LayerControls::default()).0);
}
