//! Layers of rain on a graphics card, over textures of the application's: one submission a frame, nothing read back.
//!
//! Twin: [`super::Layers`]. What a layer is like, its texels' size, how far it has fallen, is the processor's; drops, their water and light on it are the
//! card's.

use super::{LayerControls, Layers, SIDE, sheets};
use crate::error::RuntimeError;
use crate::gpu::Gpu;
use crate::gpu::binding::{Kernel, Slot};
use crate::gpu::clock::{Clock, GpuReport};
use crate::gpu::memory::{Held, Image};
use crate::gpu::readback::Readback;
use crate::gpu::shader::LAYERS;
use crate::wet::card::{self, CardFrame, LAYER};
use crate::wet::drop::card::CardDropLight;
use crate::wet::drop::eye::Eye;
use crate::wet::drop::light::LightControls;
use crate::wet::drop::{self, lightning_bias};
use crate::wet::frame::Layer;
use crate::wet::maps::WetMaps;
use uniforms::{Layers as LayersUniform, Sheet};

mod uniforms {
    use crate::gpu::rain::plain;

    plain! {
        /// `Sheet` of sheet.wgsl.
        Sheet {
            key: [u32; 2], fallen: [u32; 2], cell: [f32; 2], part: f32, depth: f32, radius: f32, way: f32, threshold: u32, blur: f32,
        }
    }
    plain! {
        /// `Layers` of sheet.wgsl.
        Layers {
            along: [f32; 2], count: u32, is_paper: u32, edge_strength: f32, edge_bias: f32, lightning_bias: f32, opacity: f32,
            back_light: f32, milk: f32, pad0: [u32; 2], sheets: [Sheet; 6],
        }
    }
}

/// Layers of rain on a graphics card; keeps its memory between frames.
///
/// ```no_run
/// use squall_runtime::camera::Camera;
/// use squall_runtime::gpu::Gpu;
/// use squall_runtime::wet::card::CardFrame;
/// use squall_runtime::wet::layers::{LayerControls, Layers, card::CardLayers};
/// use squall_runtime::wet::ripples::DropFlux;
/// use squall_runtime::{wgpu, world::WorldLight};
///
/// # fn draw(device: wgpu::Device, queue: wgpu::Queue, views: [&wgpu::TextureView; 2], camera: &Camera)
/// # -> Result<(), squall_runtime::RuntimeError> {
/// // The application's own device, and its own textures on it: light, and depth in metres.
/// let gpu = Gpu::with_device(device, queue)?;
/// let mut rain = CardLayers::new(&gpu, &Layers::new(5));
/// let light = WorldLight::from_harmonics([[0.3; 3]; 9], None);
/// let flux = [DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 200.0 }];
/// let frame = CardFrame { flux: &flux, time_s: 1.5, ..CardFrame::new(camera, &light, views) };
/// // For a pass of one's own: out = layer.rgb + (1 − layer.a) × picture.
/// let layer: &wgpu::TextureView = rain.draw(&frame, &LayerControls::default())?;
/// # let _ = layer;
/// # Ok(())
/// # }
/// ```
pub struct CardLayers {
    gpu: Gpu,
    light: CardDropLight,
    layouts: [wgpu::BindGroupLayout; 2],
    kernel: Kernel,
    uniform: Held<wgpu::Buffer>,
    placement: Held<wgpu::Buffer>,
    /// Of the texture with depths that was bound last.
    bound: Option<(wgpu::TextureView, wgpu::BindGroup)>,
    layer: Option<(Image, wgpu::BindGroup)>,
    clock: Clock,
    is_measured: bool,
    back: Readback,
}

impl CardLayers {
    /// The pipelines, and the placement of drops.
    pub fn new(gpu: &Gpu, layers: &Layers) -> Self {
        let light = CardDropLight::new(gpu);
        let layouts = [
            gpu.layout("layers of rain", &[Slot::Uniform, Slot::Exact, Slot::Read]),
            gpu.layout("layer of rain", &[Slot::Store(LAYER)]),
        ];
        let groups = [None, Some(&layouts[0]), Some(&light.layout), Some(&layouts[1])];
        let kernel = gpu.kernel(&gpu.module(&LAYERS), "lay_sheets", &groups);
        debug_assert_eq!(layers.placement.len() as i64, SIDE * SIDE);
        Self {
            light,
            kernel,
            uniform: gpu.uniform::<LayersUniform>("layers of rain"),
            placement: gpu.storage("placement of drops", &layers.placement),
            layouts,
            bound: None,
            layer: None,
            clock: Clock::new(gpu),
            is_measured: false,
            back: Readback::new(gpu),
            gpu: gpu.clone(),
        }
    }

    /// Brings what was baked of lamps overhead and lightning to the card; without it there is none. Call it when that changes.
    ///
    /// # Errors
    ///
    /// Maps of lamps that lie otherwise in one band than in another, or of more than a binding holds.
    pub fn set_maps(&mut self, maps: &WetMaps) -> Result<(), RuntimeError> {
        self.light.set_maps(maps)
    }

    /// Draws layers of rain, each before what lies behind it: a texture of the camera's size, rgba32float, light and in the fourth number the share of what
    /// is below that the layers hide.
    ///
    /// # Errors
    ///
    /// Textures of another size than the camera's, numbers of the frame outside what effects take, or controls out of their ranges.
    pub fn draw(
        &mut self,
        frame: &CardFrame<'_>,
        controls: &LayerControls,
    ) -> Result<&wgpu::TextureView, RuntimeError> {
        frame.camera.check()?;
        frame.check()?;
        drop::check_weather(&frame.weather(), frame.lightning)?;
        controls.check()?;
        let eye = Eye::new(frame.camera);
        let lights = LightControls {
            flash: controls.flash,
            lamp_height_m: controls.lamp_height_m,
            paper: controls.paper > 0.5,
        };
        self.light.prepare(frame, &eye, &lights);
        self.gpu.write(&self.uniform, &[uniform_of(frame, &eye, controls)]);
        if self.bound.as_ref().is_none_or(|(known, _)| known != frame.depth_m) {
            let depth = wgpu::BindingResource::TextureView(frame.depth_m);
            let resources = [self.uniform.as_entire_binding(), depth, self.placement.as_entire_binding()];
            let group = self.gpu.group("layers of rain", &self.layouts[0], &resources);
            self.bound = Some((frame.depth_m.clone(), group));
        }
        let size = frame.size();
        let layer = match self.layer.take() {
            Some(layer) if [layer.0.texture.width(), layer.0.texture.height()] == size => layer,
            _ => {
                let image = self.gpu.target("layer of rain", size, LAYER);
                let group = self.gpu.group("layer of rain", &self.layouts[1], &[image.binding()]);
                (image, group)
            }
        };
        let mut recorder = self.clock.record(self.is_measured);
        if let (Some(light), Some((_, bound))) = (self.light.record(&mut recorder), &self.bound) {
            let groups = [None, Some(bound), Some(light), Some(&layer.1)];
            let [x, y] = size.map(|side| side.div_ceil(8));
            recorder.pass("layers of rain", |pass| pass.run(&self.kernel, &groups, [x, y, 1]));
        }
        recorder.submit();
        Ok(&self.layer.insert(layer).0.view)
    }

    /// The layer last drawn, waited for; an empty one where none was.
    ///
    /// # Errors
    ///
    /// The device is lost.
    pub fn read(&mut self) -> Result<Layer, RuntimeError> {
        let Some((layer, _)) = &self.layer else { return Ok(Layer::default()) };
        card::read_layer(&self.gpu, &mut self.back, layer)
    }

    /// Has every frame's passes timed, where the device has a clock.
    pub const fn set_measured(&mut self, is_measured: bool) {
        self.is_measured = is_measured;
    }

    /// What the last frame took, waited for.
    ///
    /// # Errors
    ///
    /// The device is lost.
    pub fn report(&mut self) -> Result<GpuReport, RuntimeError> {
        card::report(&self.gpu, &mut self.clock)
    }
}

/// The layers of a frame; none where no rain is.
fn uniform_of(frame: &CardFrame<'_>, eye: &Eye, controls: &LayerControls) -> LayersUniform {
    let Some((along, sheets)) = sheets(&frame.weather(), eye, controls) else {
        return LayersUniform::default();
    };
    let halves = |bits: u64| [bits as u32, (bits >> 32) as u32];
    let mut uniform = LayersUniform {
        along: along.to_array(),
        count: sheets.len() as u32,
        is_paper: u32::from(controls.paper > 0.5),
        edge_strength: controls.edge_strength,
        edge_bias: controls.edge_bias,
        lightning_bias: lightning_bias(controls.contrast, frame.lightning),
        opacity: controls.opacity,
        back_light: controls.back_light,
        milk: controls.milk,
        ..LayersUniform::default()
    };
    for (slot, sheet) in uniform.sheets.iter_mut().zip(&sheets) {
        *slot = Sheet {
            key: halves(sheet.key),
            fallen: halves(sheet.fallen.0 as u64),
            cell: sheet.cell.to_array(),
            part: sheet.fallen.1,
            depth: sheet.depth,
            radius: sheet.radius,
            way: sheet.way,
            threshold: sheet.threshold,
            blur: controls.blur * drop::velocity_blur(sheet.way, sheet.radius),
        };
    }
    uniform
}

#[cfg(test)]
mod tests;
