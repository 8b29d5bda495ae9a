//! What a pass is given: explicit layouts, bind groups, compute pipelines.
//!
//! Groups: 0 the frame, 1 the asset, 2 the flashes, 3 the targets. A layout lists its slots in order, so that the number of
//! a binding is its place in the list. No stage sees more than eight storage buffers.

use super::Gpu;
use super::compile::Compiled;
use super::shader::Shader;
use std::collections::HashMap;
use std::sync::{Arc, MutexGuard, PoisonError};

/// What a binding is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Slot {
    /// A uniform buffer.
    Uniform,
    /// A storage buffer that is only read.
    Read,
    /// A storage buffer that is written.
    Write,
    /// A flat texture of floats that a sampler may filter.
    Flat,
    /// A flat texture of 32-bit floats, which none may.
    Exact,
    /// A flat texture of unsigned integers.
    Whole,
    /// A volume of floats that a sampler may filter.
    Volume,
    /// A volume of unsigned integers.
    WholeVolume,
    /// A sampler.
    Sampler,
    /// A flat texture that is written.
    Store(wgpu::TextureFormat),
    /// A volume that is written.
    StoreVolume(wgpu::TextureFormat),
}

impl Slot {
    fn kind(self) -> wgpu::BindingType {
        let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
        let texture = |sample_type, view_dimension| wgpu::BindingType::Texture {
            sample_type,
            view_dimension,
            multisampled: false,
        };
        let store = |format, view_dimension| wgpu::BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::WriteOnly,
            format,
            view_dimension,
        };
        use wgpu::TextureSampleType::{Float, Uint};
        use wgpu::TextureViewDimension::{D2, D3};
        match self {
            Self::Uniform => buffer(wgpu::BufferBindingType::Uniform),
            Self::Read => buffer(wgpu::BufferBindingType::Storage { read_only: true }),
            Self::Write => buffer(wgpu::BufferBindingType::Storage { read_only: false }),
            Self::Flat => texture(Float { filterable: true }, D2),
            Self::Exact => texture(Float { filterable: false }, D2),
            Self::Whole => texture(Uint, D2),
            Self::Volume => texture(Float { filterable: true }, D3),
            Self::WholeVolume => texture(Uint, D3),
            Self::Sampler => wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
            Self::Store(format) => store(format, D2),
            Self::StoreVolume(format) => store(format, D3),
        }
    }

    fn visibility(self) -> wgpu::ShaderStages {
        match self {
            Self::Write | Self::Store(_) | Self::StoreVolume(_) => wgpu::ShaderStages::COMPUTE,
            _ => wgpu::ShaderStages::COMPUTE | wgpu::ShaderStages::VERTEX_FRAGMENT,
        }
    }
}

/// The pipelines of a device, by what they are called.
#[derive(Default)]
pub struct Pipelines {
    compute: HashMap<&'static str, Arc<Compiled>>,
    render: HashMap<String, wgpu::RenderPipeline>,
}

/// A compute pipeline.
pub struct Kernel {
    pipeline: Arc<Compiled>,
    /// Its entry point, which names it in reports.
    pub name: &'static str,
}

impl Kernel {
    /// The pipeline, waited for.
    pub fn pipeline(&self) -> &wgpu::ComputePipeline {
        self.pipeline.get()
    }
}

impl Gpu {
    /// A layout whose bindings are `slots` in order.
    pub(crate) fn layout(&self, label: &str, slots: &[Slot]) -> wgpu::BindGroupLayout {
        let entry = |(binding, slot): (usize, &Slot)| wgpu::BindGroupLayoutEntry {
            binding: binding as u32,
            visibility: slot.visibility(),
            ty: slot.kind(),
            count: None,
        };
        let entries: Vec<_> = slots.iter().enumerate().map(entry).collect();
        self.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(label),
            entries: &entries,
        })
    }

    /// A bind group whose bindings are `resources` in order.
    pub(crate) fn group(
        &self,
        label: &str,
        layout: &wgpu::BindGroupLayout,
        resources: &[wgpu::BindingResource<'_>],
    ) -> wgpu::BindGroup {
        let entries: Vec<_> = (0..)
            .zip(resources)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource: resource.clone() })
            .collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(label),
            layout,
            entries: &entries,
        })
    }

    /// The layout of a pipeline with these groups.
    pub(crate) fn pipeline_layout(
        &self,
        label: &str,
        groups: &[Option<&wgpu::BindGroupLayout>],
    ) -> wgpu::PipelineLayout {
        self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(label),
            bind_group_layouts: groups,
            immediate_size: 0,
        })
    }

    /// A shader, compiled.
    pub(crate) fn module(&self, shader: &Shader) -> wgpu::ShaderModule {
        self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(shader.name),
            source: wgpu::ShaderSource::Wgsl(shader.source().into()),
        })
    }

    /// One entry point of a shader as a compute pipeline.
    pub(crate) fn kernel(
        &self,
        module: &wgpu::ShaderModule,
        entry: &'static str,
        groups: &[Option<&wgpu::BindGroupLayout>],
    ) -> Kernel {
        if let Some(pipeline) = self.pipelines().compute.get(entry) {
            return Kernel { pipeline: pipeline.clone(), name: entry };
        }
        let layout = self.pipeline_layout(entry, groups);
        let (device, module) = (self.device.clone(), module.clone());
        let make = move || {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: Some(&layout),
                module: &module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions {
                    zero_initialize_workgroup_memory: false,
                    ..Default::default()
                },
                cache: None,
            })
        };
        let pipeline = Arc::new(self.compiled(Arc::new(make)));
        self.pipelines().compute.insert(entry, pipeline.clone());
        Kernel { pipeline, name: entry }
    }

    /// The render pipeline of this name, made where there is none yet.
    pub(crate) fn render_pipeline(
        &self,
        name: String,
        make: impl FnOnce(&wgpu::Device) -> wgpu::RenderPipeline,
    ) -> wgpu::RenderPipeline {
        if let Some(pipeline) = self.pipelines().render.get(&name) {
            return pipeline.clone();
        }
        let pipeline = make(&self.device);
        self.pipelines().render.insert(name, pipeline.clone());
        pipeline
    }

    fn pipelines(&self) -> MutexGuard<'_, Pipelines> {
        // Whoever panicked while it held them left a map that is whole.
        self.pipelines.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
