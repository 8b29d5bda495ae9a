//! Sky and cloud behind the town, clear air in front.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::Recorder;
use super::frame::FrameGroup;
use super::shader::COMPOSE;
use super::targets::{LIGHT, Targets};

/// The pass that lays the town before the sky.
pub struct ComposePass {
    kernel: Kernel,
    layout: wgpu::BindGroupLayout,
    kept: Option<([u32; 2], wgpu::BindGroup)>,
}

impl ComposePass {
    /// Compiles the pass.
    pub fn new(gpu: &Gpu, frame: &FrameGroup) -> Self {
        let slots = [Slot::Flat, Slot::Flat, Slot::Exact, Slot::Store(LIGHT)];
        let layout = gpu.layout("compose", &slots);
        let module = gpu.module(&COMPOSE);
        let kernel = gpu.kernel(&module, "compose", &[Some(&frame.layout), None, None, Some(&layout)]);
        Self { kernel, layout, kept: None }
    }

    /// Puts the pass on record, from `targets.beyond` and the town into `targets.picture`.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        (frame, targets): (&FrameGroup, &Targets),
    ) {
        let [width, height] = targets.size;
        if self.kept.as_ref().is_none_or(|(size, _)| *size != targets.size) {
            let images = [&targets.beyond, &targets.town, &targets.town_metres, &targets.picture];
            let group = gpu.group("compose", &self.layout, &images.map(|image| image.binding()));
            self.kept = Some((targets.size, group));
        }
        let Some((_, own)) = &self.kept else { return };
        let groups = [Some(&frame.group), None, None, Some(own)];
        recorder.pass("compose", |pass| {
            pass.run(&self.kernel, &groups, [width.div_ceil(8), height.div_ceil(8), 1]);
        });
    }
}
