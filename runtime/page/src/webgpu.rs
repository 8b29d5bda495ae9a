//! A page's own WebGPU device as a device of wgpu's: each call goes to the browser's object of the same name, descriptors as JSON.
//!
//! wgpu's interface for backends of one's own (its feature `custom`) needs no generated glue, so that the module stays one file which
//! plain JavaScript starts. The host (`web/gpu.js`) holds the objects, numbers them, and answers four functions. Only what a frame
//! needs is passed on; what WebGPU lacks is refused by name.
//!
//! Unsafe is only that the host's functions are declared: they read the module's memory and write nothing in it.
#![allow(unsafe_code)]

mod commands;
mod device;
mod words;

use squall_runtime::wgpu;
use wgpu::custom;

// SAFETY: the host answers these names and no other (`web/gpu.js`); it reads the bytes that an address and a length name before it
// returns, and never writes.
#[link(wasm_import_module = "webgpu")]
unsafe extern "C" {
    /// Calls `method` of an object with a JSON list of arguments; the number of the object that it answers with, or 0.
    safe fn call(object: u32, method: *const u8, length: usize, arguments: *const u8, bytes: usize) -> u32;
    /// `GPUQueue.writeBuffer`: bytes from byte `offset` of the buffer on.
    safe fn write_buffer(buffer: u32, offset: f64, from: *const u8, bytes: usize);
    /// `GPUQueue.writeTexture` with a JSON list of its arguments but the bytes.
    safe fn write_texture(arguments: *const u8, length: usize, from: *const u8, bytes: usize);
    /// Forgets an object.
    safe fn release(object: u32);
}

/// The host's numbers of the device and its queue.
const DEVICE: u32 = 1;
const QUEUE: u32 = 2;

/// The page's device and its queue, where the host has opened them.
pub(crate) fn device() -> (wgpu::Device, wgpu::Queue) {
    (wgpu::Device::from_custom(Object(DEVICE)), wgpu::Queue::from_custom(Object(QUEUE)))
}

/// The host's number of a texture.
pub(crate) fn number_of(texture: &wgpu::Texture) -> u32 {
    texture.as_custom::<Object>().map_or(0, |object| object.0)
}

/// An object of the host's.
#[derive(Debug)]
struct Object(u32);

impl Object {
    fn call(&self, method: &str, arguments: &str) -> Self {
        Self(call(self.0, method.as_ptr(), method.len(), arguments.as_ptr(), arguments.len()))
    }
}

impl Drop for Object {
    fn drop(&mut self) {
        if self.0 > QUEUE {
            release(self.0);
        }
    }
}

/// The JSON by which the host finds an object.
trait Named {
    fn named(&self) -> String;
}

impl Named for Option<&Object> {
    fn named(&self) -> String {
        self.map_or_else(|| "null".to_owned(), |object| format!("{{\"object\":{}}}", object.0))
    }
}

/// What the runtime never asks of a device, since WebGPU lacks it or frames don't need it.
fn absent(what: &str) -> ! {
    panic!("a page's device has no {what}")
}

impl custom::ShaderModuleInterface for Object {
    fn get_compilation_info(&self) -> std::pin::Pin<Box<dyn custom::ShaderCompilationInfoFuture>> {
        Box::pin(std::future::ready(wgpu::CompilationInfo { messages: Vec::new() }))
    }
}

impl custom::BindGroupLayoutInterface for Object {}
impl custom::BindGroupInterface for Object {}
impl custom::TextureViewInterface for Object {}
impl custom::SamplerInterface for Object {}
impl custom::PipelineLayoutInterface for Object {}
impl custom::CommandBufferInterface for Object {}

impl custom::QuerySetInterface for Object {
    fn destroy(&self) {
        self.call("destroy", "[]");
    }
}

impl custom::RenderPipelineInterface for Object {
    fn get_bind_group_layout(&self, index: u32) -> custom::DispatchBindGroupLayout {
        custom::DispatchBindGroupLayout::custom(self.call("getBindGroupLayout", &format!("[{index}]")))
    }
}

impl custom::ComputePipelineInterface for Object {
    fn get_bind_group_layout(&self, index: u32) -> custom::DispatchBindGroupLayout {
        custom::DispatchBindGroupLayout::custom(self.call("getBindGroupLayout", &format!("[{index}]")))
    }
}

impl custom::BufferInterface for Object {
    /// A module never waits, so that no buffer is read in it: the host reads pictures.
    fn map_async(
        &self,
        _: wgpu::MapMode,
        _: std::ops::Range<wgpu::BufferAddress>,
        callback: custom::BufferMapCallback,
    ) {
        callback(Err(wgpu::BufferAsyncError));
    }

    fn get_mapped_range(
        &self,
        _: std::ops::Range<wgpu::BufferAddress>,
    ) -> Result<custom::DispatchBufferMappedRange, wgpu::MapRangeError> {
        absent("mapped buffer")
    }

    fn unmap(&self) {
        self.call("unmap", "[]");
    }

    fn destroy(&self) {
        self.call("destroy", "[]");
    }
}

impl custom::TextureInterface for Object {
    /// A view of all of the texture: frames ask for no other.
    fn create_view(&self, _: &wgpu::TextureViewDescriptor<'_>) -> custom::DispatchTextureView {
        custom::DispatchTextureView::custom(self.call("createView", "[]"))
    }

    fn destroy(&self) {
        self.call("destroy", "[]");
    }
}
