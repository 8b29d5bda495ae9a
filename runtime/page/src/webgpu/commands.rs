//! One frame's commands: copies, compute passes, render passes.

use super::words::{attachment, extent, fields, label, list};
use super::{Named, Object, absent};
use squall_runtime::wgpu::{self, custom};
use std::ops::Range;

/// A texture to copy from or to.
pub fn place(of: wgpu::TexelCopyTextureInfo<'_>) -> String {
    fields([
        ("texture", of.texture.as_custom::<Object>().named()),
        ("mipLevel", of.mip_level.to_string()),
        ("origin", format!("[{},{},{}]", of.origin.x, of.origin.y, of.origin.z)),
    ])
}

fn buffer_named(buffer: &custom::DispatchBuffer) -> String {
    buffer.as_custom::<Object>().named()
}

impl custom::CommandEncoderInterface for Object {
    fn copy_buffer_to_buffer(
        &self,
        source: &custom::DispatchBuffer,
        source_offset: wgpu::BufferAddress,
        destination: &custom::DispatchBuffer,
        destination_offset: wgpu::BufferAddress,
        copy_size: Option<wgpu::BufferAddress>,
    ) {
        let mut said = vec![
            buffer_named(source),
            source_offset.to_string(),
            buffer_named(destination),
            destination_offset.to_string(),
        ];
        said.extend(copy_size.map(|size| size.to_string()));
        self.call("copyBufferToBuffer", &list(said));
    }

    fn copy_buffer_to_texture(
        &self,
        _: wgpu::TexelCopyBufferInfo<'_>,
        _: wgpu::TexelCopyTextureInfo<'_>,
        _: wgpu::Extent3d,
    ) {
        absent("copy of a buffer to a texture")
    }

    fn copy_texture_to_buffer(
        &self,
        source: wgpu::TexelCopyTextureInfo<'_>,
        destination: wgpu::TexelCopyBufferInfo<'_>,
        size: wgpu::Extent3d,
    ) {
        let number = |number: Option<u32>| number.map_or_else(String::new, |number| number.to_string());
        let into = fields([
            ("buffer", destination.buffer.as_custom::<Object>().named()),
            ("offset", destination.layout.offset.to_string()),
            ("bytesPerRow", number(destination.layout.bytes_per_row)),
            ("rowsPerImage", number(destination.layout.rows_per_image)),
        ]);
        self.call("copyTextureToBuffer", &list([place(source), into, extent(size)]));
    }

    fn copy_texture_to_texture(
        &self,
        source: wgpu::TexelCopyTextureInfo<'_>,
        destination: wgpu::TexelCopyTextureInfo<'_>,
        size: wgpu::Extent3d,
    ) {
        self.call("copyTextureToTexture", &list([place(source), place(destination), extent(size)]));
    }

    fn begin_compute_pass(&self, of: &wgpu::ComputePassDescriptor<'_>) -> custom::DispatchComputePass {
        let said = fields([("label", label(of.label))]);
        custom::DispatchComputePass::custom(Pass(self.call("beginComputePass", &list([said]))))
    }

    fn begin_render_pass(&self, of: &wgpu::RenderPassDescriptor<'_>) -> custom::DispatchRenderPass {
        let onto = of
            .color_attachments
            .iter()
            .map(|onto| onto.as_ref().map_or_else(|| "null".to_owned(), attachment));
        let said = fields([("label", label(of.label)), ("colorAttachments", list(onto))]);
        custom::DispatchRenderPass::custom(Pass(self.call("beginRenderPass", &list([said]))))
    }

    fn finish(&mut self) -> custom::DispatchCommandBuffer {
        custom::DispatchCommandBuffer::custom(self.call("finish", "[]"))
    }

    fn clear_texture(&self, _: &custom::DispatchTexture, _: &wgpu::ImageSubresourceRange) {
        absent("cleared texture")
    }

    fn clear_buffer(
        &self,
        buffer: &custom::DispatchBuffer,
        offset: wgpu::BufferAddress,
        size: Option<wgpu::BufferAddress>,
    ) {
        let mut said = vec![buffer_named(buffer), offset.to_string()];
        said.extend(size.map(|size| size.to_string()));
        self.call("clearBuffer", &list(said));
    }

    fn insert_debug_marker(&self, _: &str) {}

    fn push_debug_group(&self, _: &str) {}

    fn pop_debug_group(&self) {}

    fn write_timestamp(&self, _: &custom::DispatchQuerySet, _: u32) {
        absent("clock")
    }

    fn resolve_query_set(
        &self,
        _: &custom::DispatchQuerySet,
        _: u32,
        _: u32,
        _: &custom::DispatchBuffer,
        _: wgpu::BufferAddress,
    ) {
        absent("clock")
    }

    fn mark_acceleration_structures_built<'a>(
        &self,
        _: &mut dyn Iterator<Item = &'a wgpu::Blas>,
        _: &mut dyn Iterator<Item = &'a wgpu::Tlas>,
    ) {
        absent("acceleration structure")
    }

    fn build_acceleration_structures<'a>(
        &self,
        _: &mut dyn Iterator<Item = &'a wgpu::BlasBuildEntry<'a>>,
        _: &mut dyn Iterator<Item = &'a wgpu::Tlas>,
    ) {
        absent("acceleration structure")
    }

    fn transition_resources<'a>(
        &mut self,
        _: &mut dyn Iterator<Item = wgpu::wgt::BufferTransition<&'a custom::DispatchBuffer>>,
        _: &mut dyn Iterator<Item = wgpu::wgt::TextureTransition<&'a custom::DispatchTexture>>,
    ) {
    }
}

/// A pass, which ends when it goes.
#[derive(Debug)]
struct Pass(Object);

impl Drop for Pass {
    fn drop(&mut self) {
        self.0.call("end", "[]");
    }
}

impl Pass {
    fn bind(&self, index: u32, group: Option<&custom::DispatchBindGroup>, offsets: &[u32]) {
        if !offsets.is_empty() {
            absent("dynamic offset");
        }
        let group = group.and_then(custom::DispatchBindGroup::as_custom::<Object>).named();
        self.0.call("setBindGroup", &list([index.to_string(), group]));
    }

    fn indirect(&self, method: &str, buffer: &custom::DispatchBuffer, offset: wgpu::BufferAddress) {
        self.0.call(method, &list([buffer_named(buffer), offset.to_string()]));
    }
}

impl custom::ComputePassInterface for Pass {
    fn set_pipeline(&mut self, pipeline: &custom::DispatchComputePipeline) {
        self.0.call("setPipeline", &list([pipeline.as_custom::<Object>().named()]));
    }

    fn set_bind_group(&mut self, index: u32, group: Option<&custom::DispatchBindGroup>, offsets: &[u32]) {
        self.bind(index, group, offsets);
    }

    fn set_immediates(&mut self, _: u32, _: &[u8]) {
        absent("immediate")
    }

    fn insert_debug_marker(&mut self, _: &str) {}

    fn push_debug_group(&mut self, _: &str) {}

    fn pop_debug_group(&mut self) {}

    fn write_timestamp(&mut self, _: &custom::DispatchQuerySet, _: u32) {
        absent("clock")
    }

    fn begin_pipeline_statistics_query(&mut self, _: &custom::DispatchQuerySet, _: u32) {
        absent("statistics query")
    }

    fn end_pipeline_statistics_query(&mut self) {
        absent("statistics query")
    }

    fn dispatch_workgroups(&mut self, x: u32, y: u32, z: u32) {
        self.0.call("dispatchWorkgroups", &format!("[{x},{y},{z}]"));
    }

    fn dispatch_workgroups_indirect(&mut self, buffer: &custom::DispatchBuffer, offset: wgpu::BufferAddress) {
        self.indirect("dispatchWorkgroupsIndirect", buffer, offset);
    }

    fn transition_resources<'a>(
        &mut self,
        _: &mut dyn Iterator<Item = wgpu::wgt::BufferTransition<&'a custom::DispatchBuffer>>,
        _: &mut dyn Iterator<Item = wgpu::wgt::TextureTransition<&'a custom::DispatchTextureView>>,
    ) {
    }
}

impl custom::RenderPassInterface for Pass {
    fn set_pipeline(&mut self, pipeline: &custom::DispatchRenderPipeline) {
        self.0.call("setPipeline", &list([pipeline.as_custom::<Object>().named()]));
    }

    fn set_bind_group(&mut self, index: u32, group: Option<&custom::DispatchBindGroup>, offsets: &[u32]) {
        self.bind(index, group, offsets);
    }

    fn set_index_buffer(
        &mut self,
        _: &custom::DispatchBuffer,
        _: wgpu::IndexFormat,
        _: wgpu::BufferAddress,
        _: Option<wgpu::BufferSize>,
    ) {
        absent("index buffer")
    }

    fn set_vertex_buffer(
        &mut self,
        _: u32,
        _: Option<&custom::DispatchBuffer>,
        _: wgpu::BufferAddress,
        _: Option<wgpu::BufferSize>,
    ) {
        absent("vertex buffer")
    }

    fn set_immediates(&mut self, _: u32, _: &[u8]) {
        absent("immediate")
    }

    fn set_blend_constant(&mut self, color: wgpu::Color) {
        let wgpu::Color { r, g, b, a } = color;
        self.0.call("setBlendConstant", &format!("[[{r},{g},{b},{a}]]"));
    }

    fn set_scissor_rect(&mut self, x: u32, y: u32, width: u32, height: u32) {
        self.0.call("setScissorRect", &format!("[{x},{y},{width},{height}]"));
    }

    fn set_viewport(&mut self, x: f32, y: f32, width: f32, height: f32, near: f32, far: f32) {
        self.0.call("setViewport", &format!("[{x},{y},{width},{height},{near},{far}]"));
    }

    fn set_stencil_reference(&mut self, _: u32) {
        absent("stencil")
    }

    fn draw(&mut self, vertices: Range<u32>, instances: Range<u32>) {
        let (first, count) = (vertices.start, vertices.len());
        let said = format!("[{count},{},{first},{}]", instances.len(), instances.start);
        self.0.call("draw", &said);
    }

    fn draw_indexed(&mut self, _: Range<u32>, _: i32, _: Range<u32>) {
        absent("index buffer")
    }

    fn draw_mesh_tasks(&mut self, _: u32, _: u32, _: u32) {
        absent("mesh shader")
    }

    fn draw_indirect(&mut self, buffer: &custom::DispatchBuffer, offset: wgpu::BufferAddress) {
        self.indirect("drawIndirect", buffer, offset);
    }

    fn draw_indexed_indirect(&mut self, _: &custom::DispatchBuffer, _: wgpu::BufferAddress) {
        absent("index buffer")
    }

    fn draw_mesh_tasks_indirect(&mut self, _: &custom::DispatchBuffer, _: wgpu::BufferAddress) {
        absent("mesh shader")
    }

    fn multi_draw_indirect(&mut self, _: &custom::DispatchBuffer, _: wgpu::BufferAddress, _: u32) {
        absent("multiple draw")
    }

    fn multi_draw_indexed_indirect(&mut self, _: &custom::DispatchBuffer, _: wgpu::BufferAddress, _: u32) {
        absent("multiple draw")
    }

    fn multi_draw_indirect_count(
        &mut self,
        _: &custom::DispatchBuffer,
        _: wgpu::BufferAddress,
        _: &custom::DispatchBuffer,
        _: wgpu::BufferAddress,
        _: u32,
    ) {
        absent("multiple draw")
    }

    fn multi_draw_mesh_tasks_indirect(&mut self, _: &custom::DispatchBuffer, _: wgpu::BufferAddress, _: u32) {
        absent("mesh shader")
    }

    fn multi_draw_indexed_indirect_count(
        &mut self,
        _: &custom::DispatchBuffer,
        _: wgpu::BufferAddress,
        _: &custom::DispatchBuffer,
        _: wgpu::BufferAddress,
        _: u32,
    ) {
        absent("multiple draw")
    }

    fn multi_draw_mesh_tasks_indirect_count(
        &mut self,
        _: &custom::DispatchBuffer,
        _: wgpu::BufferAddress,
        _: &custom::DispatchBuffer,
        _: wgpu::BufferAddress,
        _: u32,
    ) {
        absent("mesh shader")
    }

    fn insert_debug_marker(&mut self, _: &str) {}

    fn push_debug_group(&mut self, _: &str) {}

    fn pop_debug_group(&mut self) {}

    fn write_timestamp(&mut self, _: &custom::DispatchQuerySet, _: u32) {
        absent("clock")
    }

    fn begin_occlusion_query(&mut self, _: u32) {
        absent("occlusion query")
    }

    fn end_occlusion_query(&mut self) {
        absent("occlusion query")
    }

    fn begin_pipeline_statistics_query(&mut self, _: &custom::DispatchQuerySet, _: u32) {
        absent("statistics query")
    }

    fn end_pipeline_statistics_query(&mut self) {
        absent("statistics query")
    }

    fn execute_bundles(&mut self, _: &mut dyn Iterator<Item = &custom::DispatchRenderBundle>) {
        absent("bundle")
    }
}
