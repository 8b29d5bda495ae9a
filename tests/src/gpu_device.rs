//! A renderer on a graphics card of the caller's: its device, its queue, its texture.

use crate::{root, skip};
use squall_runtime::gpu::Gpu;
use squall_runtime::renderer::Backend;
use squall_runtime::{StormRenderer, wgpu};
use std::sync::mpsc;

fn card() -> Option<Gpu> {
    match Gpu::open() {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            assert!(error.to_string().starts_with("graphics device: wanted"), "{error}");
            skip("SQUALL_REQUIRE_GPU", "no graphics adapter");
            None
        }
    }
}

fn renderer(gpu: &Gpu) -> StormRenderer {
    let mut renderer = StormRenderer::open(root().join("data/golden/v1/golden.squall")).unwrap();
    renderer.set_backend(Backend::Gpu(gpu.clone())).unwrap();
    renderer
}

/// The texels of a texture of four 32-bit floats, read by the application's own means.
fn read(gpu: &Gpu, texture: &wgpu::Texture) -> Vec<[f32; 4]> {
    let size = texture.size();
    let padded = (size.width * 16).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(padded * size.height),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(padded),
        rows_per_image: Some(size.height),
    };
    let into = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), into, size);
    gpu.queue().submit([encoder.finish()]);
    let (told, done) = mpsc::channel();
    buffer.slice(..).map_async(wgpu::MapMode::Read, move |result| told.send(result).unwrap());
    gpu.wait().unwrap();
    done.recv().unwrap().unwrap();
    let bytes = buffer.slice(..).get_mapped_range().unwrap();
    let row = |row: &[u8]| -> Vec<[f32; 4]> {
        row[..16 * size.width as usize]
            .as_chunks::<16>()
            .0
            .iter()
            .map(|texel| bytemuck::pod_read_unaligned(texel))
            .collect()
    };
    bytes.chunks(padded as usize).flat_map(row).collect()
}

#[test]
fn a_frame_goes_into_the_callers_texture_as_the_one_that_is_read_back() {
    let Some(gpu) = card() else { return };
    // As an application has them: the renderer is given its device and opens none.
    let gpu = Gpu::with_device(gpu.device().clone(), gpu.queue().clone()).unwrap();
    let mut renderer = renderer(&gpu);
    let frame = renderer.frame().unwrap();
    let wanted = renderer.render(&frame).unwrap().pixels.clone();
    let format = wgpu::TextureFormat::Rgba32Float;
    let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d {
            width: frame.camera.width,
            height: frame.camera.height,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    renderer.render_into(&frame, &view, format).unwrap();
    let found = read(&gpu, &texture);
    assert!(wanted.iter().flatten().any(|light| *light > 0.0));
    for (found, wanted) in found.iter().zip(&wanted) {
        assert_eq!(found[..3], *wanted);
    }
}

#[test]
fn frames_and_reports_of_a_card_name_it_and_hold_the_same_bytes_from_frame_to_frame() {
    let Some(gpu) = card() else { return };
    let mut renderer = renderer(&gpu);
    renderer.measure(true);
    let mut frame = renderer.frame().unwrap();
    renderer.render(&frame).unwrap();
    let first = renderer.gpu_report().unwrap().clone();
    assert_eq!(first.adapter, gpu.name());
    let has_clock = gpu.device().features().contains(wgpu::Features::TIMESTAMP_QUERY);
    assert_eq!(first.passes.is_empty(), !has_clock, "{first:?}");
    for step in 1..4 {
        frame.camera.position.x += f64::from(step);
        frame.flashes[0].brightness = 1.0 / f64::from(step);
        renderer.render(&frame).unwrap();
        assert_eq!(renderer.gpu_report().unwrap().bytes_held, first.bytes_held);
    }
    drop(renderer);
    assert_eq!(gpu.bytes_held(), 0);
}

#[test]
fn a_texture_is_drawn_into_by_a_card_alone() {
    let mut plain = StormRenderer::open(root().join("data/golden/v1/golden.squall")).unwrap();
    assert!(plain.gpu_report().is_none());
    let Some(gpu) = card() else { return };
    let frame = plain.frame().unwrap();
    let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    let refused = plain.render_into(&frame, &view, texture.format()).unwrap_err().to_string();
    assert!(refused.contains("backend") && refused.contains("set_backend"), "{refused}");
}
