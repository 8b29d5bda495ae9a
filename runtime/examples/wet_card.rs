//! What the wet effects take on a graphics card, pass by pass.
//!
//! Concept: each effect that draws on a card is called as an application would call it, with textures of its own device: ripples and a pane's drops over a
//! few hundred frames of a sixtieth of a second, glow and layers of rain over a picture of lamps. Medians of each pass are printed, with the steps that a
//! frame took and the bytes that are held.
//!
//! Usage: `cargo run --release --features gpu --example wet_card -- [FRAMES] [WIDTHxHEIGHT]`

use squall_runtime::camera::Camera;
use squall_runtime::formats::units::Degrees;
use squall_runtime::gpu::{Gpu, GpuReport};
use squall_runtime::wet::card::CardFrame;
use squall_runtime::wet::glass::card::CardGlass;
use squall_runtime::wet::glass::{Glass, GlassSettings};
use squall_runtime::wet::glow::{GlowControls, card::CardGlow};
use squall_runtime::wet::layers::{LayerControls, Layers, card::CardLayers};
use squall_runtime::wet::ripples::card::CardRipples;
use squall_runtime::wet::ripples::{DropFlux, RippleSettings, Ripples};
use squall_runtime::world::WorldLight;
use squall_runtime::{glam::DVec3, wgpu};
use std::collections::BTreeMap;
use std::error::Error;

/// A frame's time, s.
const FRAME_S: f64 = 1.0 / 60.0;
/// Rain of 25 mm/h in four classes.
const RAIN: [DropFlux; 4] = [
    DropFlux { diameter_m: 0.7e-3, speed_m_per_s: 2.9, impacts_per_m2_s: 4200.0 },
    DropFlux { diameter_m: 1.5e-3, speed_m_per_s: 5.4, impacts_per_m2_s: 1000.0 },
    DropFlux { diameter_m: 2.5e-3, speed_m_per_s: 7.4, impacts_per_m2_s: 180.0 },
    DropFlux { diameter_m: 3.5e-3, speed_m_per_s: 8.4, impacts_per_m2_s: 25.0 },
];

/// Medians of passes.
#[derive(Default)]
struct Medians(BTreeMap<&'static str, Vec<f64>>);

impl Medians {
    fn add(&mut self, report: &GpuReport) {
        report.passes.iter().for_each(|pass| self.0.entry(pass.name).or_default().push(pass.ms));
    }

    fn print(&mut self, what: &str, bytes: u64) {
        println!("{what}, {:.1} MB held", bytes as f64 * 1e-6);
        for (name, times) in &mut self.0 {
            times.sort_by(f64::total_cmp);
            println!("  {name}: {:.4} ms", times[times.len() / 2]);
        }
    }
}

fn ripples(gpu: &Gpu, frames: u64) -> Result<(), Box<dyn Error>> {
    let before = gpu.bytes_held();
    let mut water = CardRipples::new(gpu, &Ripples::new(RippleSettings::default())?)?;
    water.set_measured(true);
    let (mut medians, mut steps) = (Medians::default(), 0);
    for _ in 0..frames {
        // Time that is too short for a step waits, and nothing is submitted then.
        steps += water.advance(FRAME_S, &RAIN, 7)?.steps;
        medians.add(&water.report()?);
    }
    let per_frame = f64::from(steps) / frames as f64;
    medians.print(
        &format!("ripples of 256 × 256 cells, {per_frame:.2} steps a frame"),
        gpu.bytes_held() - before,
    );
    Ok(())
}

fn glass(gpu: &Gpu, frames: u64) -> Result<(), Box<dyn Error>> {
    let before = gpu.bytes_held();
    let mut pane = CardGlass::new(gpu, Glass::new(GlassSettings::default())?)?;
    pane.set_measured(true);
    let mut medians = Medians::default();
    for _ in 0..frames {
        pane.rain(2.5e-3, 2000.0, FRAME_S)?;
        pane.advance(FRAME_S)?;
        medians.add(&pane.report()?);
    }
    let steps = pane.read_report()?.steps as f64 / frames as f64;
    let wet = pane.read_water()?.iter().filter(|&&mass| mass > 0).count();
    let what = format!("pane of 512 × 512 cells, {wet} of them wet, {steps:.2} steps a frame");
    medians.print(&what, gpu.bytes_held() - before);
    Ok(())
}

/// A flat texture, filled.
fn texture(
    gpu: &Gpu,
    [width, height]: [u32; 2],
    (format, texel): (wgpu::TextureFormat, usize),
    values: impl Iterator<Item = f32>,
) -> wgpu::TextureView {
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: None,
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let bytes: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
    let bytes_per_row = Some(width * texel as u32);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row, rows_per_image: None };
    gpu.queue().write_texture(texture.as_image_copy(), &bytes, layout, size);
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

fn frames_over_a_picture(gpu: &Gpu, frames: u64, size: [u32; 2]) -> Result<(), Box<dyn Error>> {
    let count = u64::from(size[0]) * u64::from(size[1]);
    let light = |at: u64| if at.is_multiple_of(4001) { 900.0 } else { 0.02 };
    let texels = (0..count).flat_map(|at| [light(at), light(at), 0.7 * light(at), 1.0]);
    let picture = texture(gpu, size, (wgpu::TextureFormat::Rgba32Float, 16), texels);
    let depths = (0..count).map(|at| 2.0 + (at % 97) as f32);
    let depth_m = texture(gpu, size, (wgpu::TextureFormat::R32Float, 4), depths);
    let camera = Camera::look_at(DVec3::ZERO, DVec3::Y, Degrees(60.0), size)?;
    let world = WorldLight::from_radiance(&|d| [0.1 + 0.05 * d.z; 3], None);
    let frame = |number: u64| CardFrame {
        rate_mm_per_h: 25.0,
        flux: &RAIN,
        time_s: number as f64 * FRAME_S,
        ..CardFrame::new(&camera, &world, [&picture, &depth_m])
    };
    let before = gpu.bytes_held();
    let mut glow = CardGlow::new(gpu);
    glow.set_measured(true);
    let mut medians = Medians::default();
    for number in 0..frames {
        glow.draw(&frame(number), &GlowControls::default())?;
        medians.add(&glow.report()?);
    }
    medians.print(&format!("glow at {} × {}", size[0], size[1]), gpu.bytes_held() - before);
    let before = gpu.bytes_held();
    let mut layers = CardLayers::new(gpu, &Layers::new(5));
    layers.set_measured(true);
    let mut medians = Medians::default();
    for number in 0..frames {
        layers.draw(&frame(number), &LayerControls::default())?;
        medians.add(&layers.report()?);
    }
    medians.print(&format!("three layers of rain at {} × {}", size[0], size[1]), gpu.bytes_held() - before);
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let frames = arguments.first().map_or(Ok(240), |text| text.parse::<u64>())?.max(1);
    let size = match arguments.get(1).map(|text| text.split_once('x').ok_or("wanted WIDTHxHEIGHT")) {
        Some(pair) => {
            let (width, height) = pair?;
            [width.parse()?, height.parse()?]
        }
        None => [1920, 1080],
    };
    let gpu = Gpu::open()?;
    println!("{}", gpu.name());
    ripples(&gpu, frames)?;
    glass(&gpu, frames)?;
    frames_over_a_picture(&gpu, frames, size)
}
