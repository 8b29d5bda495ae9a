//! A scene that the caller has drawn, in the place of a town: sky behind it, air, rain and streaks in front.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::Recorder;
use super::memory::Held;
use super::rain::plain;
use super::shader::TAKE;
use super::targets::{LIGHT, METRES, Targets};
use crate::depth::DepthKind;

plain! {
    /// `Take` of take.wgsl.
    Take { planar: u32, pad0: u32, pad1: u32, pad2: u32 }
}

/// A picture of the caller's on the renderer's own device, as large as the frames that are drawn over it.
#[derive(Clone)]
pub struct CardScene {
    /// Linear radiance, W/(m² sr): a texture of floats.
    pub light: wgpu::TextureView,
    /// Metres to what stands in each pixel, r32float. Infinity, or more than 10²⁹, is sky; what is not above 0 is not known, and rain's
    /// medium leaves it as it is.
    pub metres: wgpu::TextureView,
    /// Along the viewing axis, or along each pixel's own ray.
    pub kind: DepthKind,
}

/// The pass that takes a scene over.
pub struct TakePass {
    kernel: Kernel,
    layout: wgpu::BindGroupLayout,
    uniform: Held<wgpu::Buffer>,
    group: Option<wgpu::BindGroup>,
}

impl TakePass {
    /// Compiles the pass.
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout) -> Self {
        let slots = [Slot::Uniform, Slot::Exact, Slot::Exact, Slot::Store(LIGHT), Slot::Store(METRES)];
        let layout = gpu.layout("scene of the caller's", &slots);
        let kernel = gpu.kernel(&gpu.module(&TAKE), "take_scene", &[Some(frame), Some(&layout)]);
        Self { kernel, layout, uniform: gpu.uniform::<Take>("scene of the caller's"), group: None }
    }

    /// Binds a scene and the pictures that it goes into.
    pub fn set(&mut self, gpu: &Gpu, scene: &CardScene, targets: &Targets) {
        let planar = u32::from(scene.kind == DepthKind::Planar);
        gpu.write(&self.uniform, &[Take { planar, ..Take::default() }]);
        use wgpu::BindingResource::TextureView;
        let resources = [
            self.uniform.as_entire_binding(),
            TextureView(&scene.light),
            TextureView(&scene.metres),
            TextureView(&targets.town.view),
            TextureView(&targets.town_metres.view),
        ];
        self.group = Some(gpu.group("scene of the caller's", &self.layout, &resources));
    }

    /// Takes the scene over.
    pub fn record(&self, recorder: &mut Recorder<'_>, frame: &wgpu::BindGroup, size: [u32; 2]) {
        let Some(own) = &self.group else { return };
        let groups = [size[0].div_ceil(8), size[1].div_ceil(8), 1];
        recorder.pass("scene", |pass| pass.run(&self.kernel, &[Some(frame), Some(own)], groups));
    }
}
