use super::*;
use crate::assert_layout;
use crate::camera::Camera;
use crate::gpu::clock::Clock;
use crate::gpu::frame::{FrameGroup, FrameUniform};
use crate::gpu::half::{bits_of, value_of};
use crate::gpu::readback::Readback;
use crate::gpu::shader::{BLOOM, TONE};
use crate::gpu::test_gpu;
use crate::picture::Picture;
use glam::DVec3;
use squall_formats::units::Degrees;

#[test]
fn structs_lie_as_the_shaders_have_them() {
    type Bloom = BloomUniform;
    assert_layout!(BLOOM, Bloom { amount, weights });
    type Tone = ToneUniform;
    assert_layout!(TONE, Tone { curve, output });
}

/// A dusk with a channel in it, of an odd size, as halves.
fn picture() -> Picture {
    let (width, height) = (149, 83);
    let mut picture = Picture::new(width, height).unwrap();
    for (i, pixel) in picture.pixels.iter_mut().enumerate() {
        let (x, y) = (i % width, i / width);
        let dusk = 0.002 * (y as f32 + 1.0);
        *pixel = match (x, y) {
            (70, 10..=60) => [400.0, 420.0, 600.0],
            _ => [dusk, 0.7 * dusk, 0.4 + 0.01 * x as f32],
        };
        *pixel = pixel.map(|value| value_of(bits_of(value)));
    }
    picture
}

fn developed(gpu: &Gpu, tone: &Tone, picture: &Picture, what: (Developed, wgpu::TextureFormat)) -> Vec<u8> {
    let size = [picture.width as u32, picture.height as u32];
    let camera = Camera::look_at(DVec3::ZERO, DVec3::Y, Degrees(60.0), size).unwrap();
    let frame = FrameGroup::new(gpu);
    frame.set(gpu, &FrameUniform::of_camera(&camera, 1.0));
    let light = gpu.target("picture", size, LIGHT);
    let texel = |&[r, g, b]: &[f32; 3]| [r, g, b, 1.0].map(bits_of);
    gpu.fill(&light, &picture.pixels.iter().map(texel).collect::<Vec<[u16; 4]>>());
    let mut passes = TonePasses::new(gpu, &frame.layout);
    passes.set_picture(gpu, &light.view, size);
    passes.set(gpu, tone, what).unwrap();
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
    let kind = (wgpu::TextureDimension::D2, what.1);
    let target = gpu.texture("shown", [size[0], size[1], 1], kind, usage);
    let (mut clock, mut back) = (Clock::new(gpu), Readback::new(gpu));
    let mut recorder = clock.record(false);
    passes.record(&mut recorder, &frame.group, (&target.view, what.1));
    back.copy(&mut recorder.encoder, &target);
    recorder.submit();
    back.values().unwrap()
}

#[test]
fn a_developed_picture_is_the_processors_in_every_format_of_a_surface() {
    /// Levels of 255 in root mean square, and share of bands that are more than one level off: half precision of the levels.
    const RMSE: f64 = 0.3;
    const FAR: f64 = 1e-3;
    let Some(gpu) = test_gpu() else { return };
    let picture = picture();
    let plain = Tone::default();
    let mut bare = Tone { exposure: 2.0, dither: false, ..plain };
    bare.bloom.amount = 0.0;
    use wgpu::TextureFormat as F;
    for (tone, format) in [
        (plain, F::Rgba8Unorm),
        (plain, F::Bgra8Unorm),
        (plain, F::Rgba8UnormSrgb),
        (bare, F::Bgra8UnormSrgb),
    ] {
        let wanted = tone.to_srgb8(&picture);
        let found = developed(&gpu, &tone, &picture, (Developed::Signal, format));
        let swapped = matches!(format, F::Bgra8Unorm | F::Bgra8UnormSrgb);
        let (mut squares, mut far) = (0.0, 0);
        for (found, wanted) in found.as_chunks::<4>().0.iter().zip(&wanted) {
            let [a, b, c, _] = *found;
            let found = if swapped { [c, b, a] } else { [a, b, c] };
            for (found, wanted) in found.iter().zip(wanted) {
                let off = i32::from(*found) - i32::from(*wanted);
                squares += f64::from(off * off);
                far += usize::from(off.abs() > 1);
            }
        }
        let count = (3 * wanted.len()) as f64;
        let rmse = (squares / count).sqrt();
        println!("{format:?}: {rmse:.3} of 255, {far} bands more than one level off");
        assert!(rmse < RMSE && far as f64 <= FAR * count, "{format:?}");
    }
}

#[test]
fn radiance_goes_out_as_it_is_and_other_formats_are_refused_by_name() {
    let Some(gpu) = test_gpu() else { return };
    let picture = picture();
    let found =
        developed(&gpu, &Tone::default(), &picture, (Developed::Radiance, wgpu::TextureFormat::Rgba32Float));
    let found: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&found);
    for (found, wanted) in found.iter().zip(&picture.pixels) {
        assert_eq!(found[..3], wanted[..]);
    }
    let frame = FrameGroup::new(&gpu);
    let mut passes = TonePasses::new(&gpu, &frame.layout);
    let what = (Developed::Signal, wgpu::TextureFormat::R8Unorm);
    let error = passes.set(&gpu, &Tone::default(), what).unwrap_err().to_string();
    assert!(error.contains("target texture") && error.contains("R8Unorm"), "{error}");
}
