//! Sky and cloud at every pixel.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::Recorder;
use super::frame::FrameGroup;
use super::memory::Image;
use super::shader::MARCH;
use super::targets::{LIGHT, Targets};
use super::volume::Volumes;

/// The passes of sky and cloud.
pub struct MarchPass {
    kernels: [Kernel; 2],
    layouts: [wgpu::BindGroupLayout; 2],
    kept: Option<Kept>,
}

/// What belongs to one picture size.
struct Kept {
    size: [u32; 2],
    _sky: Image,
    groups: [wgpu::BindGroup; 2],
}

impl MarchPass {
    /// Compiles the passes.
    pub fn new(gpu: &Gpu, frame: &FrameGroup, volumes: &Volumes) -> Self {
        let kept = gpu.layout("sky", &[Slot::Store(LIGHT)]);
        let beyond = gpu.layout("beyond", &[Slot::Flat, Slot::Store(LIGHT)]);
        let module = gpu.module(&MARCH);
        let [cloud, light] = &volumes.layouts;
        let kernels = [
            gpu.kernel(&module, "draw_sky", &[Some(&frame.layout), None, None, Some(&kept)]),
            gpu.kernel(
                &module,
                "draw_beyond",
                &[Some(&frame.layout), Some(cloud), Some(light), Some(&beyond)],
            ),
        ];
        Self { kernels, layouts: [kept, beyond], kept: None }
    }

    /// Puts sky and cloud on record, into `targets.beyond`; the sky only where it `is_new`, or the size is.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        (frame, volumes): (&FrameGroup, &Volumes),
        (targets, is_new): (&Targets, bool),
    ) {
        let size = targets.size;
        let is_new = is_new || self.kept.as_ref().is_none_or(|kept| kept.size != size);
        if self.kept.as_ref().is_none_or(|kept| kept.size != size) {
            let sky = gpu.target("sky", size, LIGHT);
            let beyond = gpu.group("beyond", &self.layouts[1], &[sky.binding(), targets.beyond.binding()]);
            let own = gpu.group("sky", &self.layouts[0], &[sky.binding()]);
            self.kept = Some(Kept { size, _sky: sky, groups: [own, beyond] });
        }
        let Some(kept) = &self.kept else { return };
        let groups = [size[0].div_ceil(8), size[1].div_ceil(8), 1];
        if is_new {
            recorder.pass("sky", |pass| {
                pass.run(&self.kernels[0], &[Some(&frame.group), None, None, Some(&kept.groups[0])], groups);
            });
        }
        recorder.pass("march", |pass| {
            let [cloud, light] = &volumes.groups;
            let all = [Some(&frame.group), Some(cloud), Some(light), Some(&kept.groups[1])];
            pass.run(&self.kernels[1], &all, groups);
        });
    }
}
