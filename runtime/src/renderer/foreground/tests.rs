use super::*;
use crate::frame::Frame;
use crate::renderer::Layer;
use squall_formats::units::{MillimetresPerHour, Seconds};

const SIZE: [u32; 2] = [160, 90];

fn renderer() -> StormRenderer {
    StormRenderer::open(concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall")).unwrap()
}

/// The asset's own flash at dusk, in so much rain.
fn dusk(renderer: &StormRenderer, rate: f64) -> Frame {
    let view = renderer.frame().unwrap();
    let camera = view.camera.clone().resized(SIZE).unwrap();
    let mut frame = view.camera(camera).rain(MillimetresPerHour(rate)).time(Seconds(2.5));
    frame.sky.sun_elevation.0 = -0.05;
    frame
}

/// A scene whose depth and light are functions of the pixel.
fn scene(
    depth: impl Fn(u32, u32) -> f32,
    light: impl Fn(u32, u32) -> [f32; 3],
    kind: DepthKind,
) -> Foreground {
    let pixels = || (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y)));
    let mut picture = Picture::new(SIZE[0] as usize, SIZE[1] as usize).unwrap();
    picture.pixels = pixels().map(|(x, y)| light(x, y)).collect();
    let metres = pixels().map(|(x, y)| depth(x, y)).collect();
    Foreground::pixels(Some(picture), metres, SIZE, kind).unwrap()
}

#[test]
fn a_scene_without_end_or_without_depth_leaves_every_bit_of_a_picture() {
    let mut renderer = renderer();
    let frame = dusk(&renderer, 20.0);
    let bare = renderer.render(&frame).unwrap().clone();
    for depth in [f32::INFINITY, 0.0, -1.0, f32::NAN] {
        renderer.set_foreground(Some(scene(|_, _| depth, |_, _| [9.0; 3], DepthKind::Planar)));
        assert!(renderer.render(&frame).unwrap().pixels == bare.pixels, "{depth}");
    }
}

#[test]
fn a_wall_before_the_eye_hides_the_storm_and_its_channels_and_air_dims_it_by_its_distance() {
    /// Clear air over a metre, and single precision.
    const CLEAR: f32 = 1e-3;
    let mut renderer = renderer();
    let frame = dusk(&renderer, 0.0);
    let light = [0.5, 0.25, 0.125];
    renderer.set_foreground(Some(scene(|_, _| 1.0, |_, _| light, DepthKind::Range)));
    let lit = renderer.render(&frame).unwrap().clone();
    for pixel in &lit.pixels {
        let off = (0..3).map(|band| (pixel[band] / light[band] - 1.0).abs()).fold(0.0, f32::max);
        assert!(off < CLEAR, "{pixel:?}");
    }
    assert!(renderer.render(&frame.clone().dark()).unwrap().pixels == lit.pixels, "a channel shines through");
    // Twice as far, the air's optical depth is twice as large: from 10 and 20 km.
    let mut left = |metres: f32, light: f32| {
        renderer.set_foreground(Some(scene(|_, _| metres, |_, _| [light; 3], DepthKind::Range)));
        renderer.render(&frame).unwrap().pixels[0][0]
    };
    // The town of this asset stands at the ground: the uppermost pixel sees none of it.
    let share = |metres: f32, left: &mut dyn FnMut(f32, f32) -> f32| left(metres, 1.0) - left(metres, 0.0);
    let (once, twice) = (share(1e4, &mut left), share(2e4, &mut left));
    assert!(once < 1.0 && (once * once / twice - 1.0).abs() < CLEAR, "{once} {twice}");
}

#[test]
fn a_scene_of_another_size_or_layers_that_know_nothing_of_it_are_refused_by_name() {
    let mut renderer = renderer();
    let frame = dusk(&renderer, 20.0);
    renderer.set_foreground(Some(Foreground::pixels(None, vec![1.0; 12], [4, 3], DepthKind::Range).unwrap()));
    let refused = renderer.render(&frame).unwrap_err().to_string();
    assert_eq!(refused, "foreground: wanted the frame's 160 × 90, found 4 × 3");
    assert!(Foreground::pixels(None, vec![1.0; 11], [4, 3], DepthKind::Range).is_err());
    let picture = Picture::new(2, 2).unwrap();
    assert!(Foreground::pixels(Some(picture), vec![1.0; 12], [4, 3], DepthKind::Range).is_err());
    renderer.set_foreground(Some(scene(|_, _| 9.0, |_, _| [1.0; 3], DepthKind::Range)));
    renderer.render(&frame).unwrap();
    let refused = renderer.layer(&frame, Layer::Depth).unwrap_err().to_string();
    assert!(refused.contains("foreground"), "{refused}");
    assert!(renderer.layer(&frame, Layer::Transmittance).is_ok());
}

#[cfg(feature = "gpu")]
mod card {
    use super::*;
    use crate::gpu::test_gpu;
    use crate::renderer::Backend;
    use crate::renderer::weather::tests::apart;
    use crate::tone::Tone;

    /// Of the display's 255 levels: root mean square, and share of bands that are at most two levels off.
    const RMSE: f64 = 0.5;
    const WITHIN_TWO: f64 = 0.999;

    #[test]
    fn a_scene_of_the_callers_on_the_card_is_the_processors() {
        let Some(gpu) = test_gpu() else { return };
        let mut renderer = renderer();
        let frame = dusk(&renderer, 20.0);
        // From 3 m at the left to 300 m, below a slope; a hole in it; brighter to the top.
        let depth = |x: u32, y: u32| match (x, y) {
            (60..70, _) => 0.0,
            (x, y) if y + x / 4 > 50 => 3.0 + 0.0117 * (x * x) as f32,
            _ => f32::INFINITY,
        };
        let light = |_: u32, y: u32| [0.002 * y as f32, 0.02, 0.0005 * y as f32];
        let scenes = [Some(DepthKind::Planar), Some(DepthKind::Range), None]
            .map(|kind| kind.map(|kind| scene(depth, light, kind)));
        let mut wanted = Vec::new();
        for scene in &scenes {
            renderer.set_foreground(scene.clone());
            wanted.push(renderer.render(&frame).unwrap().clone());
        }
        renderer.set_backend(Backend::Gpu(gpu)).unwrap();
        for (number, (scene, wanted)) in scenes.iter().zip(&wanted).enumerate() {
            renderer.set_foreground(scene.clone());
            let found = renderer.render(&frame).unwrap().clone();
            let tone = Tone { exposure: Tone::exposure_for(wanted), ..renderer.tone() };
            let (rmse, near) = apart(&tone, &found, wanted);
            println!("scene {number}: {rmse:.3} of 255, {near:.5} within 2");
            assert!(rmse <= RMSE && near >= WITHIN_TWO, "{number}: {rmse} {near}");
        }
        let (seen, bare) = (&wanted[0], &wanted[2]);
        assert!(apart(&renderer.tone(), seen, bare).0 > 1.0, "the scene is not seen");
    }
}
