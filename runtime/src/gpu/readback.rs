//! The way back: one kept buffer that everything read is copied to. Made anew for every frame it would cost seven times as much.

use super::Gpu;
use super::clock::map;
use super::memory::{Held, Image};
use crate::error::RuntimeError;

/// Rows of a copied texture begin at multiples of this, bytes.
const ROW: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;

/// A buffer to read from, kept and only ever grown.
pub struct Readback {
    gpu: Gpu,
    buffer: Option<Held<wgpu::Buffer>>,
    /// Bytes of a row of what was copied last, with and without what fills it up.
    rows: (usize, usize),
    bytes: u64,
}

impl Readback {
    /// Nothing yet.
    pub fn new(gpu: &Gpu) -> Self {
        Self { gpu: gpu.clone(), buffer: None, rows: (0, 0), bytes: 0 }
    }

    fn room(&mut self, bytes: u64) -> &wgpu::Buffer {
        let bytes = bytes.next_multiple_of(4);
        if self.buffer.as_ref().is_none_or(|buffer| buffer.size() < bytes) {
            self.buffer = None;
        }
        self.bytes = bytes;
        let gpu = &self.gpu;
        self.buffer.get_or_insert_with(|| gpu.buffer("read back", bytes, wgpu::BufferUsages::MAP_READ))
    }

    /// Puts the copy of a texture into a frame.
    pub fn copy(&mut self, encoder: &mut wgpu::CommandEncoder, image: &Image) {
        let size = image.texture.size();
        let texel = image.texture.format().block_copy_size(None).unwrap_or(4);
        let (row, padded) = (size.width * texel, (size.width * texel).next_multiple_of(ROW));
        let height = size.height * size.depth_or_array_layers;
        self.rows = (padded as usize, row as usize);
        let buffer = self.room(u64::from(padded) * u64::from(height));
        encoder.copy_texture_to_buffer(
            image.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(padded),
                    rows_per_image: Some(size.height),
                },
            },
            size,
        );
    }

    /// Puts the copy of a buffer into a frame.
    pub fn copy_buffer(&mut self, encoder: &mut wgpu::CommandEncoder, from: &wgpu::Buffer) {
        let bytes = from.size();
        self.rows = (bytes as usize, bytes as usize);
        let buffer = self.room(bytes);
        encoder.copy_buffer_to_buffer(from, 0, buffer, 0, bytes);
    }

    /// Waits for the frame and shows its copy, and how many bytes apart its rows begin.
    ///
    /// Errors: the device is lost.
    pub fn show(&mut self, look: impl FnOnce(&[u8], usize)) -> Result<(), RuntimeError> {
        let Some(buffer) = &self.buffer else { return Ok(()) };
        map(&self.gpu, buffer, self.bytes, |bytes| look(bytes, self.rows.0))
    }

    /// Waits for the frame and shows its copy, row by row.
    ///
    /// Errors: the device is lost.
    pub fn read(&mut self, mut row: impl FnMut(usize, &[u8])) -> Result<(), RuntimeError> {
        let Some(buffer) = &self.buffer else { return Ok(()) };
        let (padded, used) = self.rows;
        map(&self.gpu, buffer, self.bytes, |bytes| {
            bytes.chunks(padded).enumerate().for_each(|(y, bytes)| row(y, &bytes[..used.min(bytes.len())]));
        })
    }

    /// The same as values, all rows one after the other.
    ///
    /// Errors: the device is lost.
    pub fn values<T: bytemuck::AnyBitPattern>(&mut self) -> Result<Vec<T>, RuntimeError> {
        let mut values = Vec::new();
        self.read(|_, bytes| {
            values.extend(bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned::<T>))
        })?;
        Ok(values)
    }
}
