//! What the device and its queue are asked for.

use super::words::{
    binding, constants, dimension, extent, fields, format_of, label, layout, list, render_pipeline, resource,
    sampler, text,
};
use super::{Named, Object, absent, write_buffer, write_texture};
use squall_runtime::wgpu::{self, custom};
use std::future::ready;
use std::pin::Pin;
use std::sync::Arc;

impl Object {
    /// An object that the device makes of one descriptor.
    fn make(&self, method: &str, descriptor: &str) -> Self {
        self.call(method, &format!("[{descriptor}]"))
    }
}

impl custom::DeviceInterface for Object {
    fn features(&self) -> wgpu::Features {
        wgpu::Features::empty()
    }

    /// What a device has that was asked for nothing: WebGPU's defaults.
    fn limits(&self) -> wgpu::Limits {
        wgpu::Limits::default()
    }

    fn adapter_info(&self) -> wgpu::AdapterInfo {
        wgpu::AdapterInfo::new(wgpu::DeviceType::Other, wgpu::Backend::BrowserWebGpu)
    }

    fn create_shader_module(
        &self,
        of: wgpu::ShaderModuleDescriptor<'_>,
        _: wgpu::ShaderRuntimeChecks,
    ) -> custom::DispatchShaderModule {
        let wgpu::ShaderSource::Wgsl(code) = &of.source else { absent("shader but WGSL") };
        let said = fields([("label", label(of.label)), ("code", text(code))]);
        custom::DispatchShaderModule::custom(self.make("createShaderModule", &said))
    }

    unsafe fn create_shader_module_passthrough(
        &self,
        _: &wgpu::ShaderModuleDescriptorPassthrough<'_>,
    ) -> custom::DispatchShaderModule {
        absent("shader but WGSL")
    }

    fn create_bind_group_layout(
        &self,
        of: &wgpu::BindGroupLayoutDescriptor<'_>,
    ) -> custom::DispatchBindGroupLayout {
        let said = fields([("label", label(of.label)), ("entries", list(of.entries.iter().map(binding)))]);
        custom::DispatchBindGroupLayout::custom(self.make("createBindGroupLayout", &said))
    }

    fn create_bind_group(&self, of: &wgpu::BindGroupDescriptor<'_>) -> custom::DispatchBindGroup {
        let entry = |entry: &wgpu::BindGroupEntry<'_>| {
            fields([("binding", entry.binding.to_string()), ("resource", resource(&entry.resource))])
        };
        let said = fields([
            ("label", label(of.label)),
            ("layout", of.layout.as_custom::<Object>().named()),
            ("entries", list(of.entries.iter().map(entry))),
        ]);
        custom::DispatchBindGroup::custom(self.make("createBindGroup", &said))
    }

    fn create_pipeline_layout(
        &self,
        of: &wgpu::PipelineLayoutDescriptor<'_>,
    ) -> custom::DispatchPipelineLayout {
        let group = |group: &Option<&wgpu::BindGroupLayout>| {
            group.and_then(wgpu::BindGroupLayout::as_custom::<Object>).named()
        };
        let said = fields([
            ("label", label(of.label)),
            ("bindGroupLayouts", list(of.bind_group_layouts.iter().map(group))),
        ]);
        custom::DispatchPipelineLayout::custom(self.make("createPipelineLayout", &said))
    }

    fn create_render_pipeline(
        &self,
        of: &wgpu::RenderPipelineDescriptor<'_>,
    ) -> custom::DispatchRenderPipeline {
        custom::DispatchRenderPipeline::custom(self.make("createRenderPipeline", &render_pipeline(of)))
    }

    fn create_mesh_pipeline(&self, _: &wgpu::MeshPipelineDescriptor<'_>) -> custom::DispatchRenderPipeline {
        absent("mesh shader")
    }

    fn create_compute_pipeline(
        &self,
        of: &wgpu::ComputePipelineDescriptor<'_>,
    ) -> custom::DispatchComputePipeline {
        let compute = fields([
            ("module", of.module.as_custom::<Object>().named()),
            ("entryPoint", label(of.entry_point)),
            ("constants", constants(&of.compilation_options)),
        ]);
        let said = fields([("label", label(of.label)), ("layout", layout(of.layout)), ("compute", compute)]);
        custom::DispatchComputePipeline::custom(self.make("createComputePipeline", &said))
    }

    unsafe fn create_pipeline_cache(
        &self,
        _: &wgpu::PipelineCacheDescriptor<'_>,
    ) -> custom::DispatchPipelineCache {
        absent("cache of pipelines")
    }

    fn create_buffer(&self, of: &wgpu::BufferDescriptor<'_>) -> custom::DispatchBuffer {
        let said = fields([
            ("label", label(of.label)),
            ("size", of.size.to_string()),
            ("usage", of.usage.bits().to_string()),
        ]);
        custom::DispatchBuffer::custom(self.make("createBuffer", &said))
    }

    fn create_texture(&self, of: &wgpu::TextureDescriptor<'_>) -> custom::DispatchTexture {
        let said = fields([
            ("label", label(of.label)),
            ("size", extent(of.size)),
            ("mipLevelCount", of.mip_level_count.to_string()),
            ("sampleCount", of.sample_count.to_string()),
            ("dimension", dimension(of.dimension)),
            ("format", format_of(of.format)),
            ("usage", of.usage.bits().to_string()),
        ]);
        custom::DispatchTexture::custom(self.make("createTexture", &said))
    }

    fn create_external_texture(
        &self,
        _: &wgpu::ExternalTextureDescriptor<'_>,
        _: &[&wgpu::TextureView],
    ) -> custom::DispatchExternalTexture {
        absent("external texture")
    }

    fn create_blas(
        &self,
        _: &wgpu::CreateBlasDescriptor<'_>,
        _: wgpu::BlasGeometrySizeDescriptors,
    ) -> (Option<u64>, custom::DispatchBlas) {
        absent("acceleration structure")
    }

    fn create_tlas(&self, _: &wgpu::CreateTlasDescriptor<'_>) -> custom::DispatchTlas {
        absent("acceleration structure")
    }

    fn create_sampler(&self, of: &wgpu::SamplerDescriptor<'_>) -> custom::DispatchSampler {
        custom::DispatchSampler::custom(self.make("createSampler", &sampler(of)))
    }

    fn create_query_set(&self, _: &wgpu::QuerySetDescriptor<'_>) -> custom::DispatchQuerySet {
        absent("clock")
    }

    fn create_command_encoder(
        &self,
        of: &wgpu::CommandEncoderDescriptor<'_>,
    ) -> custom::DispatchCommandEncoder {
        let said = fields([("label", label(of.label))]);
        custom::DispatchCommandEncoder::custom(self.make("createCommandEncoder", &said))
    }

    fn create_render_bundle_encoder(
        &self,
        _: &wgpu::RenderBundleEncoderDescriptor<'_>,
    ) -> custom::DispatchRenderBundleEncoder {
        absent("bundle")
    }

    /// The host hears of it, and draws on the processor from then on.
    fn set_device_lost_callback(&self, _: custom::BoxDeviceLostCallback) {}

    /// As of a loss.
    fn on_uncaptured_error(&self, _: Arc<dyn wgpu::UncapturedErrorHandler>) {}

    fn push_error_scope(&self, _: wgpu::ErrorFilter) -> u32 {
        0
    }

    fn pop_error_scope(&self, _: u32) -> Pin<Box<dyn custom::PopErrorScopeFuture>> {
        Box::pin(ready(None))
    }

    unsafe fn start_graphics_debugger_capture(&self) {}

    unsafe fn stop_graphics_debugger_capture(&self) {}

    /// Nothing is waited for in a page.
    fn poll(&self, _: wgpu::wgt::PollType<u64>) -> Result<wgpu::PollStatus, wgpu::PollError> {
        Ok(wgpu::PollStatus::QueueEmpty)
    }

    fn get_internal_counters(&self) -> wgpu::InternalCounters {
        wgpu::InternalCounters::default()
    }

    fn generate_allocator_report(&self) -> Option<wgpu::AllocatorReport> {
        None
    }

    fn destroy(&self) {
        self.call("destroy", "[]");
    }
}

impl custom::QueueInterface for Object {
    fn write_buffer(&self, buffer: &custom::DispatchBuffer, offset: wgpu::BufferAddress, data: &[u8]) {
        let number = buffer.as_custom::<Object>().map_or(0, |object| object.0);
        write_buffer(number, offset as f64, data.as_ptr(), data.len());
    }

    fn create_staging_buffer(&self, _: wgpu::BufferSize) -> Option<custom::DispatchQueueWriteBuffer> {
        None
    }

    fn validate_write_buffer(
        &self,
        _: &custom::DispatchBuffer,
        _: wgpu::BufferAddress,
        _: wgpu::BufferSize,
    ) -> Option<()> {
        None
    }

    fn write_staging_buffer(
        &self,
        _: &custom::DispatchBuffer,
        _: wgpu::BufferAddress,
        _: &custom::DispatchQueueWriteBuffer,
    ) {
        absent("staging buffer")
    }

    fn write_texture(
        &self,
        into: wgpu::TexelCopyTextureInfo<'_>,
        data: &[u8],
        of: wgpu::TexelCopyBufferLayout,
        size: wgpu::Extent3d,
    ) {
        let number = |number: Option<u32>| number.map_or_else(String::new, |number| number.to_string());
        let layout = fields([
            ("offset", of.offset.to_string()),
            ("bytesPerRow", number(of.bytes_per_row)),
            ("rowsPerImage", number(of.rows_per_image)),
        ]);
        let said = list([super::commands::place(into), layout, extent(size)]);
        write_texture(said.as_ptr(), said.len(), data.as_ptr(), data.len());
    }

    fn submit(&self, buffers: &mut dyn Iterator<Item = custom::DispatchCommandBuffer>) -> u64 {
        let buffers: Vec<_> = buffers.collect();
        let named = list(buffers.iter().map(|buffer| buffer.as_custom::<Object>().named()));
        self.call("submit", &list([named]));
        0
    }

    fn get_timestamp_period(&self) -> f32 {
        1.0
    }

    fn on_submitted_work_done(&self, _: custom::BoxSubmittedWorkDoneCallback) {
        absent("callback of work done")
    }

    fn compact_blas(&self, _: &custom::DispatchBlas) -> (Option<u64>, custom::DispatchBlas) {
        absent("acceleration structure")
    }

    fn present(&self, _: &custom::DispatchSurfaceOutputDetail) {
        absent("surface")
    }
}
