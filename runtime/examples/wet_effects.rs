//! What rain does where it lands: each effect over one frame of a street corner at night, and what it costs.
//!
//! Concept: an effect is told of a frame by [`WetFrame`](squall_runtime::wet::frame::WetFrame): the renderer's buffers, what was baked of the
//! scene, the rain. It draws a [`Layer`], which lies over the frame. The same time gives the same picture.
//!
//! Usage: `cargo run --release --example wet_effects -- [FOLDER] [EFFECT…] [--rate MM_PER_H] [--view street|ground|ledge|car|wall] [--size WxH]`

#[path = "shared/street.rs"]
mod street;

use squall_runtime::RuntimeError;
use squall_runtime::glam::DVec3;
use squall_runtime::wet::drip::{DripControls, Drips};
use squall_runtime::wet::drop::{DropControls, Drops};
use squall_runtime::wet::frame::{Layer, WetFrame};
use squall_runtime::wet::glass::{Glass, GlassSettings, GlassShadows, Pane, PaneLight, ShadowControls};
use squall_runtime::wet::halo::{HaloControls, Halos};
use squall_runtime::wet::layers::{LayerControls, Layers};
use squall_runtime::wet::splash::{SplashControls, Splashes};
use squall_runtime::wet::splatter::{SplatterControls, Splatters};
use std::error::Error;
use std::path::Path;
use street::Street;

type Draw = Box<dyn FnMut(&WetFrame<'_>, &mut Layer) -> Result<String, RuntimeError>>;

/// An effect by name, with its usual controls.
macro_rules! effect {
    ($name:literal, $new:expr, $controls:expr) => {{
        let mut effect = $new;
        let draw: Draw = Box::new(move |frame, out| {
            effect.draw(frame, &$controls, out).map(|report| format!("{report:?}"))
        });
        ($name, draw)
    }};
}

/// Every effect.
fn effects() -> Vec<(&'static str, Draw)> {
    vec![
        ("shadows", shadows()),
        effect!("splatters", Splatters::new(), SplatterControls::default()),
        effect!("splashes", Splashes::new(), SplashControls::default()),
        effect!("halos", Halos::new(), HaloControls::default()),
        effect!("drips", Drips::new(), DripControls::default()),
        effect!("drops", Drops::new(), DropControls::default()),
        effect!("layers", Layers::new(1), LayerControls::default()),
    ]
}

/// A wet pane before the street's wall, and what a lamp shines through it.
fn shadows() -> Draw {
    let mut glass =
        Glass::new(GlassSettings { cells: [300, 300], spacing_m: 1e-3, ..GlassSettings::default() })
            .expect("a pane of usual glass");
    for _ in 0..20 {
        glass.rain(3.2e-3, 60.0, 1.0).and_then(|_| glass.advance(0.1)).expect("a shower");
    }
    let pane = Pane {
        corner_m: DVec3::new(0.85, 8.985, 1.5),
        across_m: DVec3::new(0.3, 0.0, 0.0),
        down_m: DVec3::new(0.0, 0.0, -0.3),
    };
    let lamp = PaneLight::Lamp(DVec3::new(-5.5, 3.0, 4.2));
    let mut shadows = GlassShadows::new();
    Box::new(move |frame, out| {
        let report = shadows.draw(
            (&glass, &pane, &lamp),
            frame,
            &ShadowControls { far_m: 0.2, ..ShadowControls::default() },
            out,
        )?;
        Ok(format!("{report:?}"))
    })
}

/// Nanoseconds that this thread has had a processor for, where the system says so.
fn processor_ns() -> f64 {
    let said = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    said.split(' ').next().and_then(|text| text.parse().ok()).unwrap_or(0.0)
}

/// Saves light as it would look to a camera.
fn save(path: &Path, size: [usize; 2], light: &[[f32; 3]]) -> std::io::Result<()> {
    let byte = |value: f32| {
        let shown = 1.0 - libm::expf(-2.4 * value.max(0.0));
        (255.0 * libm::powf(shown, 1.0 / 2.2) + 0.5) as u8
    };
    let mut bytes = format!("P6\n{} {}\n255\n", size[0], size[1]).into_bytes();
    bytes.extend(light.iter().flatten().map(|&value| byte(value)));
    std::fs::write(path, bytes)
}

fn main() -> Result<(), Box<dyn Error>> {
    let (mut folder, mut only, mut rate, mut size) = (None, Vec::new(), 25.0, [1024, 768]);
    let mut view = "street".to_owned();
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match word.as_str() {
            "--rate" => rate = words.next().ok_or("--rate wants mm/h")?.parse()?,
            "--view" => view = words.next().ok_or("--view wants a name")?,
            "--size" => {
                let text = words.next().ok_or("--size wants WxH")?;
                let (width, height) = text.split_once('x').ok_or("--size wants WxH")?;
                size = [width.parse()?, height.parse()?];
            }
            _ if folder.is_none() => folder = Some(word),
            _ => only.push(word),
        }
    }
    let folder = folder.unwrap_or_else(|| ".".to_owned());
    let (eye, target) = match view.as_str() {
        "street" => (DVec3::new(-1.2, 0.0, 1.6), DVec3::new(0.2, 8.0, 1.3)),
        "ground" => (DVec3::new(3.9, 4.6, 0.55), DVec3::new(3.3, 6.2, 0.2)),
        "ledge" => (DVec3::new(-0.6, 6.4, 2.2), DVec3::new(-1.5, 7.8, 2.2)),
        "car" => (DVec3::new(-0.2, 3.4, 1.25), DVec3::new(1.9, 6.2, 0.95)),
        "wall" => (DVec3::new(0.9, 8.55, 1.33), DVec3::new(1.02, 9.0, 1.34)),
        _ => return Err("--view wants street, ground, ledge, car or wall".into()),
    };
    let street = Street::new(eye, target, size, rate)?;
    let frame = street.frame(1.234);
    let mut layer = Layer::default();
    save(&Path::new(&folder).join("frame.ppm"), street.buffer.size, &street.buffer.colour)?;
    let mut all = street.buffer.colour.clone();
    for (name, mut draw) in effects() {
        if !only.is_empty() && !only.iter().any(|wanted| wanted == name) {
            continue;
        }
        // The first call makes what stays.
        draw(&frame, &mut layer)?;
        let mut best = f64::INFINITY;
        let mut report = String::new();
        for _ in 0..5 {
            let begin = processor_ns();
            report = draw(&frame, &mut layer)?;
            best = best.min((processor_ns() - begin) * 1e-6);
        }
        let mut picture = street.buffer.colour.clone();
        layer.onto(&mut picture)?;
        save(&Path::new(&folder).join(format!("{name}.ppm")), street.buffer.size, &picture)?;
        // Layers are another way to draw what drops are.
        if name != "layers" {
            layer.onto(&mut all)?;
        }
        println!("{name:10} {best:7.1} ms  {report}");
    }
    save(&Path::new(&folder).join("all.ppm"), street.buffer.size, &all)?;
    Ok(())
}
