//! `squall solve SCENE.json --lamp NAME -o DIR [--method sweep|monte-carlo …]`

use super::folder::OutputFolder;
use super::progress::Bars;
use anyhow::Result;
use serde_json::{Value, json};
use squall_bake::cloud::{TruthSettings, solve_light};
use squall_bake::fields::{Fields, orthographic};
use squall_bake::input::scene::{Optics, Scene, read_scene};
use squall_bake::output::write_atomically;
use squall_bake::progress::Progress;
use squall_bake::recipe::parse_directions;
use squall_runtime::transport::direct::Light;
use squall_runtime::transport::quadrature::Quadrature;
use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

/// The slow truth: fields and pictures of one light in a scene, without an asset.
#[derive(clap::Args)]
pub struct Args {
    /// The scene (SCENE.json).
    scene: PathBuf,
    /// Name of one of the scene's lights.
    #[arg(long, value_name = "NAME")]
    lamp: String,
    /// Folder for the results; made if missing.
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// How to solve.
    #[arg(long, value_enum, default_value = "sweep")]
    method: Method,
    /// sweep: parts that every cell is cut into along each axis, 1 to 64; left out, as many as its optical depth asks for.
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..=64))]
    refine: Option<u32>,
    /// sweep: direction set, 14, 26, 50 or POLARxAZIMUTHS.
    #[arg(long, default_value = "4x16", value_parser = directions)]
    directions: Quadrature,
    /// sweep: residual, relative to the first scattering, at which the light counts as solved.
    #[arg(long, default_value_t = 1e-4, value_parser = tolerance)]
    tolerance: f64,
    /// sweep: sweeps after which to give up.
    #[arg(long, value_name = "N", default_value_t = 2000)]
    max_sweeps: u32,
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Method {
    /// Discrete ordinates.
    Sweep,
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    let start = Instant::now();
    let scene = read_scene(&args.scene, Optics::default())?;
    let light = scene.light(&args.lamp)?;
    let folder = OutputFolder::prepare(&args.out)?;
    let bars = Bars::new()?;
    let (fields, report, lines) = match args.method {
        Method::Sweep => sweep(&args, &scene, light, &bars)?,
    };
    bars.finish();
    bars.check()?;
    let seconds = start.elapsed().as_secs_f64();
    let mut files = fields.write(folder.path())?;
    let mut summary = json!({
        "tool": format!("squall {}", env!("CARGO_PKG_VERSION")),
        "scene": args.scene,
        "lamp": args.lamp,
        "dims_xyz": scene.cloud.shape.to_array(),
        "seconds": seconds,
        "files": files,
    });
    for (key, value) in report.as_object().into_iter().flatten() {
        summary[key] = value.clone();
    }
    let text = serde_json::to_string_pretty(&summary)? + "\n";
    write_atomically(&folder.path().join("solve.json"), |out| out.write_all(text.as_bytes()))?;
    files.push("solve.json".into());
    println!("{lines}; {seconds:.1} s");
    println!("{}: {}", args.out.display(), files.join(" "));
    folder.keep();
    Ok(())
}

fn sweep(args: &Args, scene: &Scene, light: Light, bars: &Bars) -> Result<(Fields, Value, String)> {
    let mut settings = TruthSettings { refine: args.refine.unwrap_or(0), ..TruthSettings::default() };
    settings.solve.quadrature = args.directions;
    settings.solve.tolerance = args.tolerance;
    settings.solve.max_sweeps = args.max_sweeps;
    let towards: Vec<_> = orthographic(&scene.cameras).map(|(_, camera)| -camera.forward).collect();
    let truth = solve_light(&scene.cloud, light, &towards, &settings, bars)?;
    let fields = Fields::of_truth(&truth, &scene.cameras, bars)?;
    let directions = args.directions.ordinates()?.len();
    let mut report = serde_json::to_value(&truth.report)?;
    report["method"] = json!("sweep");
    report["refinement"] = json!(truth.refine);
    report["solve_cells"] = json!(truth.fine.shape.len());
    report["directions"] = json!(directions);
    report["tolerance"] = json!(args.tolerance);
    let lines = format!(
        "{} lit by {}: {} solve cells (refinement {}), {directions} directions\nresidual {:.1e} after {} sweeps, energy \
         balance {:+.1e}",
        args.scene.display(),
        args.lamp,
        truth.fine.shape.len(),
        truth.refine,
        truth.report.residual,
        truth.report.sweeps,
        truth.report.energy_balance,
    );
    Ok((fields, report, lines))
}

fn directions(name: &str) -> Result<Quadrature, String> {
    let set = parse_directions(name).ok_or("wanted 14, 26, 50 or POLARxAZIMUTHS, such as 4x16")?;
    set.ordinates().map(|_| set).map_err(|error| error.to_string())
}

fn tolerance(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|error| format!("{error}"))?;
    if value > 0.0 && value < 1.0 { Ok(value) } else { Err("wanted a number between 0 and 1".into()) }
}
