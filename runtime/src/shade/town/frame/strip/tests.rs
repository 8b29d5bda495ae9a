use super::super::tests::{camera, lighting};
use super::super::{Quality, TownFrame};
use crate::shade::town::light::{GlowLight, Lighting, SceneLight, StrokeLights};
use crate::shade::town::tests::small_town;
use glam::Vec3;

fn rendered(lighting: &Lighting, quality: Quality) -> TownFrame {
    let mut frame = TownFrame::default();
    small_town().render(&camera(), lighting, quality, &mut frame);
    frame
}

#[test]
fn light_at_nodes_stands_for_that_between_them_and_outlines_stay_where_they_are() {
    /// Of the picture's mean light.
    const KEPT: f64 = 0.03;
    /// Root mean square over the mean: outlines that still water mirrors are softened over the way from node to node, and on 64 × 48
    /// pixels much is outline.
    const SOFTENED: f64 = 0.35;
    let bolt = SceneLight { position: Vec3::new(60.0, 300.0, 400.0), intensity: [1e5; 3], visibility: 1.0 };
    let glow = GlowLight { centre: Vec3::new(0.0, 9e3, 4e3), radius: 2e3, radiance: [1.0; 3] };
    let stroke = StrokeLights { points: vec![bolt], ..StrokeLights::default() };
    let lit = Lighting { glows: &[glow], strokes: std::slice::from_ref(&stroke), ..lighting() };
    let quality = Quality { samples: 2, facets: 64, spacing: 1, tolerance: 0.05, slow_spacing: 2, spot: 1 };
    let exact = rendered(&lit, quality);
    for spacing in [2, 3] {
        let found = rendered(&lit, Quality { spacing, ..quality });
        for (found, exact) in found.pixels.iter().zip(&exact.pixels) {
            assert_eq!(
                (found.cover, found.distance, found.depth, found.normal),
                (exact.cover, exact.distance, exact.depth, exact.normal)
            );
        }
        let of = |frame: &TownFrame| {
            let town: Vec<f32> = frame.pixels.iter().flat_map(|pixel| pixel.radiance).collect();
            [town, frame.strokes[0].as_flattened().to_vec()]
        };
        for (found, exact) in of(&found).iter().zip(&of(&exact)) {
            let mean = exact.iter().map(|v| f64::from(*v)).sum::<f64>() / exact.len() as f64;
            let off = found.iter().zip(exact).map(|(a, b)| f64::from(a - b) * f64::from(a - b)).sum::<f64>();
            let off = (off / exact.len() as f64).sqrt();
            let kept = found.iter().map(|v| f64::from(*v)).sum::<f64>() / exact.len() as f64 / mean;
            println!("{spacing}: {off:.4} of {mean:.4}, {kept:.4} of it kept");
            assert!(
                mean > 0.0 && (kept - 1.0).abs() < KEPT && off < SOFTENED * mean,
                "{off} of {mean}, {kept}"
            );
        }
    }
}
