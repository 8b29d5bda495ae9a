//! A frame whose buffers are on a graphics card, for effects that draw there.

use crate::camera::Camera;
use crate::error::RuntimeError;
use crate::gpu::Gpu;
use crate::gpu::clock::{Clock, GpuReport};
use crate::gpu::memory::Image;
use crate::gpu::readback::Readback;
use crate::wet::drop::Weather;
use crate::wet::frame::Layer;
use crate::wet::ripples::DropFlux;
use crate::world::WorldLight;
use glam::DVec3;

/// What effects on a card are told of a frame. Textures are the application's own: flat, of the camera's size, bound as floats that need no filter, so
/// that any float format will do.
#[derive(Clone, Copy, Debug)]
pub struct CardFrame<'a> {
    /// The camera that the buffers were drawn with.
    pub camera: &'a Camera,
    /// Light of the world around, in the picture's unit of radiance.
    pub light: &'a WorldLight,
    /// Rainfall intensity, mm/h.
    pub rate_mm_per_h: f64,
    /// Drops that reach the ground, by size: Σ N v is their number a square metre and second.
    pub flux: &'a [DropFlux],
    /// Wind, m/s.
    pub wind: DVec3,
    /// Time, s, from any beginning: the same time gives the same frame.
    pub time_s: f64,
    /// Another seed is another rain.
    pub seed: u64,
    /// Intensities L1 and L2 of the two key directions of lightning, 1 at their brightest.
    pub lightning: [f32; 2],
    /// Light towards the camera, scene-linear.
    pub picture: &'a wgpu::TextureView,
    /// Depth along the viewing axis, m, in the first channel: +∞ is sky, NaN a hole.
    pub depth_m: &'a wgpu::TextureView,
}

impl<'a> CardFrame<'a> {
    /// A camera's frame in still air without rain and lightning, with the textures `[picture, depth_m]`.
    pub const fn new(
        camera: &'a Camera,
        light: &'a WorldLight,
        [picture, depth_m]: [&'a wgpu::TextureView; 2],
    ) -> Self {
        let (flux, wind, lightning): (&[DropFlux], _, _) = (&[], DVec3::ZERO, [0.0; 2]);
        Self {
            camera,
            light,
            rate_mm_per_h: 0.0,
            flux,
            wind,
            time_s: 0.0,
            seed: 0,
            lightning,
            picture,
            depth_m,
        }
    }

    /// What falls in it, and when.
    pub(crate) const fn weather(&self) -> Weather<'a> {
        let &Self { flux, rate_mm_per_h, wind, time_s, seed, .. } = self;
        Weather { flux, rate_mm_per_h, wind, time_s, seed }
    }

    /// The camera's columns and rows.
    pub const fn size(&self) -> [u32; 2] {
        [self.camera.width, self.camera.height]
    }

    /// Checks that both textures have the camera's size.
    ///
    /// # Errors
    ///
    /// One of another size, by name.
    pub fn check(&self) -> Result<(), RuntimeError> {
        let [width, height] = self.size();
        for (name, view) in [("picture", self.picture), ("depth_m", self.depth_m)] {
            let size = view.texture().size();
            if [size.width, size.height] != [width, height] {
                let found = format!("{} × {}", size.width, size.height);
                return Err(RuntimeError::argument(name, format!("the camera's {width} × {height}"), found));
            }
        }
        Ok(())
    }
}

/// What effects draw into: light and, in the fourth number, the share of what is below that it hides.
pub(crate) const LAYER: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// A layer's texture, waited for.
///
/// Errors: the device is lost.
pub(crate) fn read_layer(gpu: &Gpu, back: &mut Readback, layer: &Image) -> Result<Layer, RuntimeError> {
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    back.copy(&mut encoder, layer);
    gpu.queue.submit([encoder.finish()]);
    let texels: Vec<[f32; 4]> = back.values()?;
    let size = layer.texture.size();
    Ok(Layer {
        size: [size.width as usize, size.height as usize],
        light: texels.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
        alpha: texels.iter().map(|texel| texel[3]).collect(),
    })
}

/// What the last submission took, waited for.
///
/// Errors: the device is lost.
pub(crate) fn report(gpu: &Gpu, clock: &mut Clock) -> Result<GpuReport, RuntimeError> {
    let (adapter, bytes_held) = (gpu.name().to_owned(), gpu.bytes_held());
    Ok(GpuReport { adapter, passes: clock.read()?, bytes_held, recovered: false })
}

/// A frame's buffers as textures, for tests.
#[cfg(test)]
pub(crate) fn textures(gpu: &Gpu, buffer: &crate::wet::frame::GBuffer) -> [Image; 2] {
    use wgpu::TextureFormat::{R32Float, Rgba32Float};
    let size = [buffer.size[0] as u32, buffer.size[1] as u32, 1];
    let texture = |label: &str, format| {
        gpu.texture(label, size, (wgpu::TextureDimension::D2, format), wgpu::TextureUsages::empty())
    };
    let (picture, metres) = (texture("picture", Rgba32Float), texture("depth", R32Float));
    let texels: Vec<[f32; 4]> = buffer.colour.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    gpu.fill(&picture, &texels);
    gpu.fill(&metres, &buffer.depth_m);
    [picture, metres]
}

/// How far a layer is from another: its light relative to the root mean square, and its cover in the mean.
#[cfg(test)]
pub(crate) fn differences(found: &Layer, wanted: &Layer) -> [f64; 2] {
    use crate::gpu::square;
    assert_eq!((found.size, found.light.len()), (wanted.size, wanted.light.len()));
    let pairs = || found.light.as_flattened().iter().zip(wanted.light.as_flattened());
    let off: f64 = pairs().map(|(found, wanted)| square(found - wanted)).sum();
    let all: f64 = pairs().map(|(_, wanted)| square(*wanted)).sum();
    assert!(all > 0.0, "there is something to tell");
    let covers = found.alpha.iter().zip(&wanted.alpha);
    let cover: f64 = covers.map(|(found, wanted)| square(found - wanted)).sum();
    [(off / all).sqrt(), (cover / wanted.alpha.len() as f64).sqrt()]
}
