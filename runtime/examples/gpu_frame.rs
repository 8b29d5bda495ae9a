//! What frames take on a graphics card, pass by pass.
//!
//! Concept: a card is asked for the same frame under changes that cost differently: a flash that flickers, rain that falls on, a stroke
//! that is new, a viewer who moves. Medians over many frames are printed for each pass, with the bytes that are held, the time from
//! nothing to the first frame, and how far the card's picture is from the processor's.
//!
//! Usage: `cargo run --release --features gpu --example gpu_frame -- ASSET [FRAMES] [WIDTHxHEIGHT …]`

use squall_runtime::gpu::{Gpu, GpuReport};
use squall_runtime::renderer::Backend;
use squall_runtime::{Flash, Frame, StormRenderer, Stroke, formats::units::Seconds, wgpu};
use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::time::Instant;

/// Size of the picture that is compared with the processor's.
const COMPARED: [u32; 2] = [640, 360];
/// Sizes that are measured unless others are given.
const SIZES: [[u32; 2]; 3] = [[1280, 720], [1920, 1080], [3840, 2160]];

/// What changes from one frame to the next.
#[derive(Clone, Copy, Debug)]
enum Change {
    /// Nothing: everything is kept.
    Nothing,
    /// The flash's brightness.
    Brightness,
    /// Time: rain falls on.
    Time,
    /// The stroke is another one.
    Stroke,
    /// The viewer moves by a millimetre.
    Viewer,
}

impl Change {
    const ALL: [Self; 5] = [Self::Nothing, Self::Brightness, Self::Time, Self::Stroke, Self::Viewer];

    fn name(self) -> &'static str {
        match self {
            Self::Nothing => "nothing changes",
            Self::Brightness => "the flash flickers",
            Self::Time => "rain falls on",
            Self::Stroke => "a new stroke",
            Self::Viewer => "the viewer moves",
        }
    }

    /// The frame `number` steps on.
    fn frame(self, base: &Frame, strokes: &[Stroke], number: usize) -> Frame {
        let mut frame = base.clone();
        let step = number as f64;
        match self {
            Self::Nothing => {}
            Self::Brightness => {
                frame.flashes.iter_mut().for_each(|flash| flash.brightness = 1.0 - 1e-3 * step)
            }
            Self::Time => frame = frame.time(Seconds(base.weather.time.0 + step / 60.0)),
            Self::Stroke => {
                // Another stroke for whoever keeps light, in the same place: one of its segments is a little brighter.
                for (flash, stroke) in frame.flashes.iter_mut().zip(strokes) {
                    let mut own = stroke.clone();
                    own.segments[0].intensity *= 1.0 + 1e-3 * (step + 1.0);
                    *flash = Flash { stroke: Flash::own(own).stroke, ..flash.clone() };
                }
            }
            Self::Viewer => frame.camera.position.x += 1e-3 * step,
        }
        frame
    }
}

/// A texture to draw into, as an application's would be.
fn texture(gpu: &Gpu, size: [u32; 2]) -> wgpu::Texture {
    gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: Some("the caller's"),
        size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    })
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Prints a line a pass, in the order in which passes were met first.
fn print_passes(reports: &[GpuReport], wall: &mut [f64]) {
    let (mut order, mut times): (Vec<&str>, BTreeMap<&str, Vec<f64>>) = (Vec::new(), BTreeMap::new());
    for pass in reports.iter().flat_map(|report| &report.passes) {
        if !order.contains(&pass.name) {
            order.push(pass.name);
        }
        times.entry(pass.name).or_default().push(pass.ms);
    }
    for name in order {
        let own = times.entry(name).or_default();
        let often =
            if own.len() < reports.len() { format!(" in {} frames", own.len()) } else { String::new() };
        println!("    {name:<14} {:8.3} ms{often}", median(own));
    }
    let mut all: Vec<f64> = reports.iter().map(GpuReport::ms).collect();
    println!("    {:<14} {:8.3} ms on the card, {:.3} ms by the wall", "all", median(&mut all), median(wall));
}

/// How far the card's picture is from the processor's: root mean square and worst of sRGB's 255, and the share within 2.
fn compare(found: &[[u8; 3]], wanted: &[[u8; 3]]) -> (f64, u8, f64) {
    let (mut sum, mut worst, mut near) = (0.0, 0, 0usize);
    for (found, wanted) in found.iter().flatten().zip(wanted.iter().flatten()) {
        let off = found.abs_diff(*wanted);
        sum += f64::from(off) * f64::from(off);
        worst = worst.max(off);
        near += usize::from(off <= 2);
    }
    let count = (3 * wanted.len()).max(1) as f64;
    ((sum / count).sqrt(), worst, near as f64 / count)
}

/// Pixels that are printed where the pictures are farthest apart.
const FARTHEST: usize = 6;

/// Prints the pixels where the pictures are farthest apart: column, row, what the card has and what the processor.
fn print_farthest(found: &[[u8; 3]], wanted: &[[u8; 3]]) {
    let off = |at: &usize| (0..3).map(|band| found[*at][band].abs_diff(wanted[*at][band])).max();
    let mut places: Vec<usize> = (0..wanted.len()).collect();
    places.sort_by_key(|at| std::cmp::Reverse(off(at)));
    let columns = COMPARED[0] as usize;
    for &at in places.iter().take(FARTHEST) {
        println!("    ({}, {}): {:?} for {:?}", at % columns, at / columns, found[at], wanted[at]);
    }
}

/// Measures `frames` frames of each size under each change, of the view that `asset` brings.
pub fn run(asset: &Path, frames: usize, sizes: &[[u32; 2]]) -> Result<(), Box<dyn Error>> {
    let mut renderer = StormRenderer::open(asset)?;
    let mut base = renderer.frame().ok_or("the asset brings no view")?;
    if base.flashes.is_empty() {
        base.flashes.extend(renderer.strokes().first().map(|stroke| Flash::named(stroke.name.as_str())));
    }
    let named = renderer.strokes().to_vec();
    let strokes: Vec<Stroke> = named.iter().take(base.flashes.len()).map(Stroke::grow).collect();
    (base.camera.width, base.camera.height) = (COMPARED[0], COMPARED[1]);

    let clock = Instant::now();
    renderer.render(&base)?;
    let seconds = clock.elapsed().as_secs_f64();
    println!("processor, {} × {}: {:.0} ms for the first frame", COMPARED[0], COMPARED[1], seconds * 1e3);
    let tone = renderer.tone();
    let wanted = tone.to_srgb8(renderer.picture());

    let clock = Instant::now();
    let gpu = Gpu::open()?;
    let opened = clock.elapsed().as_secs_f64();
    let mut renderer = StormRenderer::open(asset)?;
    renderer.set_backend(Backend::Gpu(gpu.clone()))?;
    let prepared = clock.elapsed().as_secs_f64();
    let found = tone.to_srgb8(renderer.render(&base)?);
    let first = clock.elapsed().as_secs_f64();
    println!("card: {}", gpu.name());
    println!(
        "first frame after {:.0} ms: device {:.0}, asset and pipelines {:.0}, frame {:.0}",
        first * 1e3,
        opened * 1e3,
        (prepared - opened) * 1e3,
        (first - prepared) * 1e3
    );
    let (rms, worst, near) = compare(&found, &wanted);
    println!(
        "against the processor: RMSE {rms:.3} of 255, worst {worst}, {:.3} % within 2; {} bytes held",
        near * 100.0,
        gpu.bytes_held()
    );

    print_farthest(&found, &wanted);

    renderer.measure(true);
    let streaks = base.streaks;
    for &size in sizes {
        (base.camera.width, base.camera.height) = (size[0], size[1]);
        // As whoever draws in real time has them: a large picture shows no more drops than one of 720 rows.
        base.streaks = streaks.for_rows(size[1].max(720));
        let target = texture(&gpu, size);
        let view = target.create_view(&wgpu::TextureViewDescriptor::default());
        for change in Change::ALL {
            let (mut reports, mut wall) = (Vec::new(), Vec::new());
            for number in 0..=frames {
                let frame = change.frame(&base, &strokes, number);
                let clock = Instant::now();
                renderer.render_into(&frame, &view, target.format())?;
                gpu.wait()?;
                // The first frame of a change makes what the others keep.
                if number > 0 {
                    wall.push(clock.elapsed().as_secs_f64() * 1e3);
                    reports.extend(renderer.gpu_report().cloned());
                }
            }
            println!("{} × {}, {}:", size[0], size[1], change.name());
            print_passes(&reports, &mut wall);
        }
        println!("  {:.1} MB held", gpu.bytes_held() as f64 * 1e-6);
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let asset = arguments.next().ok_or("which asset?")?;
    let frames = arguments.next().map_or(Ok(60), |count| count.parse())?;
    let size = |text: String| -> Result<[u32; 2], Box<dyn Error>> {
        let (width, height) = text.split_once('x').ok_or("a size is WIDTHxHEIGHT")?;
        Ok([width.parse()?, height.parse()?])
    };
    let sizes: Vec<[u32; 2]> = arguments.map(size).collect::<Result<_, _>>()?;
    run(Path::new(&asset), frames, if sizes.is_empty() { &SIZES } else { &sizes })
}
