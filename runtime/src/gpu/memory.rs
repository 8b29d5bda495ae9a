//! Buffers and textures that count what they take.

use super::Gpu;
use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A buffer or a texture, counted among the bytes held for as long as it lives.
pub struct Held<T> {
    thing: T,
    bytes: u64,
    total: Arc<AtomicU64>,
}

impl<T> Held<T> {
    fn new(thing: T, bytes: u64, gpu: &Gpu) -> Self {
        gpu.held.fetch_add(bytes, Ordering::Relaxed);
        Self { thing, bytes, total: gpu.held.clone() }
    }
}

impl<T> Deref for Held<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.thing
    }
}

impl<T> Drop for Held<T> {
    fn drop(&mut self) {
        self.total.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}

/// A texture with the one view that passes bind.
pub struct Image {
    /// The texture.
    pub texture: Held<wgpu::Texture>,
    /// All of it.
    pub view: wgpu::TextureView,
}

impl Image {
    /// The view, to be bound.
    pub fn binding(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::TextureView(&self.view)
    }
}

impl Gpu {
    /// A buffer of zeros. A size below 16 becomes 16: a binding must not be empty.
    pub(crate) fn buffer(&self, label: &str, size: u64, usage: wgpu::BufferUsages) -> Held<wgpu::Buffer> {
        let size = size.max(16).next_multiple_of(4);
        let usage = usage | wgpu::BufferUsages::COPY_DST;
        let descriptor =
            wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
        Held::new(self.device.create_buffer(&descriptor), size, self)
    }

    /// A storage buffer that holds `values`, with room for one at least: a binding must not be smaller than what a shader reads.
    pub(crate) fn storage<T: bytemuck::NoUninit>(&self, label: &str, values: &[T]) -> Held<wgpu::Buffer> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let room = bytes.len().max(size_of::<T>()) as u64;
        let buffer = self.buffer(label, room, wgpu::BufferUsages::STORAGE);
        self.write(&buffer, bytes);
        buffer
    }

    /// A uniform buffer for one `T`.
    pub(crate) fn uniform<T>(&self, label: &str) -> Held<wgpu::Buffer> {
        self.buffer(label, size_of::<T>() as u64, wgpu::BufferUsages::UNIFORM)
    }

    /// Writes `values` to the buffer's start before whatever is submitted next.
    pub(crate) fn write<T: bytemuck::NoUninit>(&self, buffer: &wgpu::Buffer, values: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        if bytes.len().is_multiple_of(4) {
            self.queue.write_buffer(buffer, 0, bytes);
        } else {
            let mut padded = bytes.to_vec();
            padded.resize(bytes.len().next_multiple_of(4), 0);
            self.queue.write_buffer(buffer, 0, &padded);
        }
    }

    /// A texture of `size` texels, which passes may sample and read back; the third number is its depth, or its layers.
    pub(crate) fn texture(
        &self,
        label: &str,
        size: [u32; 3],
        (dimension, format): (wgpu::TextureDimension, wgpu::TextureFormat),
        usage: wgpu::TextureUsages,
    ) -> Image {
        let size = size.map(|count| count.max(1));
        let descriptor = wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: size[2] },
            mip_level_count: 1,
            sample_count: 1,
            dimension,
            format,
            usage: usage
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC
                | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        };
        let texture = self.device.create_texture(&descriptor);
        let texel = u64::from(format.block_copy_size(None).unwrap_or(4));
        let bytes = size.iter().map(|&count| u64::from(count)).product::<u64>() * texel;
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Image { texture: Held::new(texture, bytes, self), view }
    }

    /// A flat texture that passes write to: `TEXTURE_BINDING | STORAGE_BINDING`.
    pub(crate) fn target(&self, label: &str, size: [u32; 2], format: wgpu::TextureFormat) -> Image {
        let kind = (wgpu::TextureDimension::D2, format);
        self.texture(label, [size[0], size[1], 1], kind, wgpu::TextureUsages::STORAGE_BINDING)
    }

    /// Fills a texture, texel by texel, x fastest.
    pub(crate) fn fill<T: bytemuck::NoUninit>(&self, image: &Image, texels: &[T]) {
        let size = image.texture.size();
        let texel = size_of::<T>() as u32;
        self.queue.write_texture(
            image.texture.as_image_copy(),
            bytemuck::cast_slice(texels),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(size.width * texel),
                rows_per_image: Some(size.height),
            },
            size,
        );
    }
}
