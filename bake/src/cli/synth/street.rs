//! `squall synth street`: a street block as .glb, and its own buffers.

use super::super::common::Common;
use super::super::progress::Bars;
use super::super::{folder, json};
use glam::DVec3;
use squall_bake::BakeError;
use squall_bake::input::scene::read_camera;
use squall_bake::output::Output;
use squall_bake::synth::street::gbuffer::{GBufferSettings, encode_gbuffer, render_gbuffer};
use squall_bake::synth::street::synth_street;
use squall_formats::units::Degrees;
use squall_runtime::Camera;
use squall_scene::{Read, Scene, SceneError, World};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `squall synth street`.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Street {
    /// The scene, a .glb.
    #[arg(short, long, value_name = "OUT", required_unless_present = "gbuffer")]
    out: Option<PathBuf>,
    /// Buffers of the street from a camera, an .exr: R, G, B, Z, N, albedo, roughness, emission.
    #[arg(long, value_name = "EXR")]
    gbuffer: Option<PathBuf>,
    /// The camera (CAMERA.json) [default: at eye height in the right lane, 60° tall, 1024x768].
    #[arg(long, requires = "gbuffer")]
    camera: Option<PathBuf>,
    /// Width and height of the buffers, px [default: the camera's].
    #[arg(long, value_name = "WxH", value_parser = size, requires = "gbuffer")]
    size: Option<[u32; 2]>,
    /// Paths of a pixel.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=65536), requires = "gbuffer")]
    samples: u32,
    /// Seed; the same seed gives the same bytes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) common: Common,
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let sides: Vec<u32> = text.split('x').map_while(|part| part.trim().parse().ok()).collect();
    match sides[..] {
        [width, height]
            if text.split('x').count() == 2
                && (1..=1 << 26).contains(&(u64::from(width) * u64::from(height))) =>
        {
            Ok([width, height])
        }
        _ => Err("wanted a width and a height such as 1024x768, 1 to 2^26 pixels in all".into()),
    }
}

/// At eye height, looking along the street.
fn usual_camera() -> Result<Camera, BakeError> {
    let (eye, target) = (DVec3::new(-17.5, -0.9, 1.65), DVec3::new(0.0, 0.35, 1.9));
    Ok(Camera::look_at(eye, target, Degrees(60.0), [1024, 768])?)
}

/// Makes the street; its seed and the files that were written.
pub(super) fn run(arguments: &Street, bars: &Bars) -> anyhow::Result<(u64, Vec<PathBuf>)> {
    let outputs: Vec<&Path> = arguments.out.iter().chain(&arguments.gbuffer).map(PathBuf::as_path).collect();
    json::check_stdout(arguments.json, &outputs);
    folder::check_apart(&outputs, arguments.camera.iter())?;
    let scene = arguments.out.as_deref().map(Output::prepare).transpose()?;
    let buffers = arguments.gbuffer.as_deref().map(|path| {
        if path.extension().is_none_or(|end| !end.eq_ignore_ascii_case("exr")) {
            let wanted = "a name that ends in .exr, which holds buffers";
            return Err(BakeError::input(path, "output", wanted, path.display()));
        }
        Output::prepare(path)
    });
    let buffers = buffers.transpose()?;
    let mut camera = match &arguments.camera {
        Some(path) => read_camera(path)?.1,
        None => usual_camera()?,
    };
    if let Some(size) = arguments.size {
        camera = camera.resized(size)?;
    }
    let street = synth_street(arguments.seed);
    let mut files = Vec::new();
    let mut put = |out: &Output, path: &Option<PathBuf>, bytes: &[u8]| -> anyhow::Result<()> {
        out.write(|out| out.write_all(bytes))?;
        files.extend(path.iter().filter(|_| !out.is_stdout()).cloned());
        Ok(())
    };
    if let Some(out) = &buffers {
        let how = Read { normals: true, ..Read::default() };
        let mut alone =
            |name: &str, _: u64| Err(SceneError::input(name, "nothing beside the street", "a file"));
        let read = Scene::read(&street, &mut alone, &how);
        let world = World::new(read.map_err(|error| anyhow::anyhow!("the street: {error}"))?);
        let settings = GBufferSettings {
            samples: arguments.samples,
            seed: arguments.seed,
            ..GBufferSettings::default()
        };
        let buffer = render_gbuffer(&world, &camera, settings, bars)?;
        bars.finish();
        put(out, &arguments.gbuffer, &encode_gbuffer(&buffer, &camera)?)?;
    }
    if let Some(out) = &scene {
        put(out, &arguments.out, &street)?;
    }
    Ok((arguments.seed, files))
}
