//! Pictures into textures of the caller's.

use super::Gpu;
use super::binding::Slot;
use super::clock::Recorder;
use super::frame::FrameGroup;
use super::shader::SHOW;
use super::targets::Targets;

/// The pass that hands linear light over.
pub struct ShowPass {
    module: wgpu::ShaderModule,
    layout: wgpu::BindGroupLayout,
    pipeline_layout: wgpu::PipelineLayout,
    /// One a format that was asked for.
    pipelines: Vec<(wgpu::TextureFormat, wgpu::RenderPipeline)>,
    kept: Option<([u32; 2], wgpu::BindGroup)>,
}

impl ShowPass {
    /// Compiles the pass.
    pub fn new(gpu: &Gpu, frame: &FrameGroup) -> Self {
        let layout = gpu.layout("show", &[Slot::Flat]);
        let groups = [Some(&frame.layout), None, None, Some(&layout)];
        let pipeline_layout = gpu.pipeline_layout("show", &groups);
        Self { module: gpu.module(&SHOW), layout, pipeline_layout, pipelines: Vec::new(), kept: None }
    }

    /// Puts the pass on record: `targets.picture` onto `view` of `format`, pixel by pixel.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        (frame, targets): (&FrameGroup, &Targets),
        (view, format): (&wgpu::TextureView, wgpu::TextureFormat),
    ) {
        if self.kept.as_ref().is_none_or(|(size, _)| *size != targets.size) {
            let group = gpu.group("show", &self.layout, &[targets.picture.binding()]);
            self.kept = Some((targets.size, group));
        }
        if !self.pipelines.iter().any(|(known, _)| *known == format) {
            self.pipelines.push((format, self.pipeline(gpu, format)));
        }
        let pipeline = self.pipelines.iter().find(|(known, _)| *known == format);
        let (Some((_, pipeline)), Some((_, own))) = (pipeline, &self.kept) else { return };
        let target = wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                store: wgpu::StoreOp::Store,
            },
        };
        recorder.draw("show", &[Some(target)], |pass| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &frame.group, &[]);
            pass.set_bind_group(3, own, &[]);
            pass.draw(0..3, 0..1);
        });
    }

    fn pipeline(&self, gpu: &Gpu, format: wgpu::TextureFormat) -> wgpu::RenderPipeline {
        gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("show"),
            layout: Some(&self.pipeline_layout),
            vertex: wgpu::VertexState {
                module: &self.module,
                entry_point: Some("cover"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &self.module,
                entry_point: Some("show_light"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(wgpu::ColorTargetState {
                    format,
                    blend: None,
                    write_mask: wgpu::ColorWrites::ALL,
                })],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}
