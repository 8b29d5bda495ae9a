//! Sky and cloud behind the town, clear air in front; a scene of the caller's where that is nearer.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::Recorder;
use super::frame::FrameGroup;
use super::memory::Held;
use super::rain::plain;
use super::shader::COMPOSE;
use super::targets::{LIGHT, METRES, Targets};

plain! {
    /// `SceneUniform` of compose.wgsl.
    SceneUniform { is_planar: u32, has_light: u32, pad0: u32, pad1: u32 }
}

/// A scene of the caller's: metres, light where it has some, and whether metres are along the viewing axis.
#[derive(Clone, PartialEq)]
pub struct SceneViews {
    pub metres: wgpu::TextureView,
    pub light: Option<wgpu::TextureView>,
    pub is_planar: bool,
}

/// The pass that lays the town before the sky.
pub struct ComposePass {
    kernels: [Kernel; 2],
    layouts: [wgpu::BindGroupLayout; 2],
    uniform: Held<wgpu::Buffer>,
    /// For what it was bound: a picture, and a scene.
    kept: Option<(wgpu::TextureView, Option<SceneViews>, wgpu::BindGroup)>,
}

impl ComposePass {
    /// Compiles the pass.
    pub fn new(gpu: &Gpu, frame: &FrameGroup) -> Self {
        let slots = [Slot::Flat, Slot::Flat, Slot::Exact, Slot::Store(LIGHT)];
        let own = [Slot::Uniform, Slot::Exact, Slot::Exact, Slot::Store(METRES), Slot::Store(METRES)];
        let layouts =
            [gpu.layout("compose", &slots), gpu.layout("compose with a scene", &[&slots[..], &own].concat())];
        let module = gpu.module(&COMPOSE);
        let kernel =
            |entry, layout| gpu.kernel(&module, entry, &[Some(&frame.layout), None, None, Some(layout)]);
        let kernels = [kernel("compose", &layouts[0]), kernel("compose_scene", &layouts[1])];
        Self { kernels, layouts, uniform: gpu.uniform::<SceneUniform>("scene"), kept: None }
    }

    /// Binds `targets`, and the scene that stands before them.
    pub fn set(&mut self, gpu: &Gpu, targets: &Targets, scene: Option<SceneViews>) {
        let same = |(picture, known, _): &(wgpu::TextureView, Option<SceneViews>, wgpu::BindGroup)| {
            *picture == targets.picture.view && *known == scene
        };
        if self.kept.as_ref().is_some_and(same) {
            return;
        }
        use wgpu::BindingResource::TextureView;
        let images = [&targets.beyond, &targets.town, &targets.town_metres, &targets.picture];
        let mut all: Vec<_> = images.iter().map(|image| image.binding()).collect();
        let mut layout = &self.layouts[0];
        if let (Some(scene), Some([nearest, own])) = (&scene, &targets.scene) {
            let (is_planar, has_light) = (u32::from(scene.is_planar), u32::from(scene.light.is_some()));
            gpu.write(&self.uniform, &[SceneUniform { is_planar, has_light, ..SceneUniform::default() }]);
            // Light that is not looked at is bound as what is at hand.
            let light = scene.light.as_ref().unwrap_or(&scene.metres);
            all.extend([self.uniform.as_entire_binding(), TextureView(light), TextureView(&scene.metres)]);
            all.extend([nearest.binding(), own.binding()]);
            layout = &self.layouts[1];
        }
        let group = gpu.group("compose", layout, &all);
        self.kept = Some((targets.picture.view.clone(), scene, group));
    }

    /// Puts the pass on record, from `beyond`, the town and the scene into the picture.
    pub fn record(&self, recorder: &mut Recorder<'_>, frame: &wgpu::BindGroup, [width, height]: [u32; 2]) {
        let Some((_, scene, own)) = &self.kept else { return };
        let kernel = &self.kernels[usize::from(scene.is_some())];
        let groups = [Some(frame), None, None, Some(own)];
        recorder.pass("compose", |pass| {
            pass.run(kernel, &groups, [width.div_ceil(8), height.div_ceil(8), 1]);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assert_layout;

    #[test]
    fn a_scenes_uniform_lies_as_the_shader_has_it() {
        assert_layout!(COMPOSE, SceneUniform { is_planar, has_light, pad0, pad1 });
    }
}
