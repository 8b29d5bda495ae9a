//! `squall solve SCENE.json --lamp NAME -o DIR [--method sweep|monte-carlo …]`

use super::common::{Common, Memory};
use super::folder::OutputFolder;
use super::json as answer;
use super::progress::Bars;
use anyhow::Result;
use serde_json::{Value, json};
use squall_bake::cloud::{TruthSettings, automatic_refinement, solve_light};
use squall_bake::fields::{Estimate, Fields, orthographic};
use squall_bake::input::scene::{Optics, Scene, read_scene};
use squall_bake::memory;
use squall_bake::monte_carlo::{MonteCarloSettings, PHOTONS, solve_monte_carlo};
use squall_bake::output::write_atomically;
use squall_bake::progress::Progress;
use squall_bake::provenance::tool;
use squall_bake::recipe::parse_directions;
use squall_runtime::transport::direct::Light;
use squall_runtime::transport::quadrature::Quadrature;
use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

/// The slow truth: fields and pictures of one light in a scene, without an asset.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
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
    /// sweep: direction set, 14, 26, 50 or POLARxAZIMUTHS; 4x16 if left out.
    #[arg(long, value_name = "SET", value_parser = directions)]
    directions: Option<Quadrature>,
    /// sweep: residual, relative to the first scattering, at which the light counts as solved; 1e-4 if left
    /// out.
    #[arg(long, value_parser = tolerance)]
    tolerance: Option<f64>,
    /// sweep: sweeps after which to give up, 4 to 100 000; 2000 if left out.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..=100_000))]
    max_sweeps: Option<u32>,
    /// monte-carlo: photons, 100 to 10^11; a million if left out. Standard errors fall with their square root.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(PHOTONS))]
    samples: Option<u64>,
    /// monte-carlo: seed of the random numbers; 1 if left out.
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    common: Common,
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Method {
    /// Discrete ordinates.
    Sweep,
    /// Photons, with standard errors: shares nothing with the sweep but the scene.
    MonteCarlo,
}

impl Args {
    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        self.json
    }

    /// Options of one method do not go with the other.
    fn checked(&self) -> std::result::Result<(), clap::Error> {
        let sweep = [
            ("--refine", self.refine.is_some()),
            ("--directions", self.directions.is_some()),
            ("--tolerance", self.tolerance.is_some()),
            ("--max-sweeps", self.max_sweeps.is_some()),
        ];
        let chance = [("--samples", self.samples.is_some()), ("--seed", self.seed.is_some())];
        let (method, foreign) = match self.method {
            Method::Sweep => ("sweep", &chance[..]),
            Method::MonteCarlo => ("monte-carlo", &sweep[..]),
        };
        match foreign.iter().find(|(_, given)| *given) {
            None => Ok(()),
            Some((option, _)) => {
                let words = format!("{option} does not go with --method {method}\n");
                Err(clap::Error::raw(clap::error::ErrorKind::ArgumentConflict, words))
            }
        }
    }
}

/// Runs the command.
pub fn run(args: Args) -> Result<()> {
    if let Err(error) = args.checked() {
        error.exit();
    }
    let start = Instant::now();
    if let (Method::Sweep, Some(cells)) = (args.method, memory::cells_of(&args.scene)) {
        // Before the cells are read; what refinement makes of them is known only then.
        memory::of_solve(cells, args.refine.unwrap_or(1), 0).require(&args.scene, args.memory.limit(), "")?;
    }
    let scene = read_scene(&args.scene, Optics::default())?;
    let light = scene.light(&args.lamp)?;
    let mut folder = OutputFolder::prepare(&args.out)?;
    folder.expect(file_names(&args, &scene).iter().map(String::as_str).chain(["solve.json"]))?;
    let bars = args.common.start()?;
    let (fields, report, lines) = match args.method {
        Method::Sweep => sweep(&args, &scene, light, &bars)?,
        Method::MonteCarlo => monte_carlo(&args, &scene, light, &bars)?,
    };
    bars.finish();
    bars.check()?;
    let seconds = start.elapsed().as_secs_f64();
    let mut summary = json!({
        "tool": tool(),
        "scene": args.scene.to_string_lossy(),
        "lamp": args.lamp,
        "dims_xyz": scene.cloud.shape.to_array(),
        "seconds": seconds,
        "files": [],
    });
    for (key, value) in report.as_object().into_iter().flatten() {
        summary[key] = value.clone();
    }
    let files = folder.write(|folder| {
        let mut files = fields.write(folder)?;
        let mut summary = summary.clone();
        summary["files"] = json!(files);
        let text = serde_json::to_string_pretty(&summary)? + "\n";
        write_atomically(&folder.join("solve.json"), |out| out.write_all(text.as_bytes()))?;
        files.push("solve.json".into());
        Ok(files)
    })?;
    bars.say(&format!("{lines}; {seconds:.1} s\n{}: {}", args.out.display(), files.join(" ")));
    if !args.json {
        return Ok(());
    }
    summary["files"] = json!(files);
    summary["command"] = json!("solve");
    summary["folder"] = json!(args.out.to_string_lossy());
    answer::answer(&summary)
}

/// Names of the fields and pictures that a solve will write.
fn file_names(args: &Args, scene: &Scene) -> Vec<String> {
    let error = (args.method == Method::MonteCarlo).then(Vec::new);
    let one = Estimate { mean: Vec::new(), error };
    let towards = orthographic(&scene.cameras).map(|(name, _)| (name.clone(), one.clone())).collect();
    let images = scene.cameras.iter().map(|(name, _)| (name.clone(), 0, one.clone())).collect();
    Fields { phi_scattered: one.clone(), phi_direct: one.clone(), towards, seen: None, images }.file_names()
}

fn sweep(args: &Args, scene: &Scene, light: Light, bars: &Bars) -> Result<(Fields, Value, String)> {
    let cells = scene.cloud.shape.len() as u64;
    let refine = args.refine.unwrap_or_else(|| automatic_refinement(&scene.cloud));
    let directions = orthographic(&scene.cameras).count() as u64;
    let remedy = if refine > 1 { ", or a smaller --refine" } else { "" };
    memory::of_solve(cells, refine, directions).require(&args.scene, args.memory.limit(), remedy)?;
    let mut settings = TruthSettings { refine: args.refine.unwrap_or(0), ..TruthSettings::default() };
    settings.solve.quadrature = args.directions.unwrap_or(settings.solve.quadrature);
    settings.solve.tolerance = args.tolerance.unwrap_or(settings.solve.tolerance);
    settings.solve.max_sweeps = args.max_sweeps.unwrap_or(settings.solve.max_sweeps);
    let towards: Vec<_> = orthographic(&scene.cameras).map(|(_, camera)| -camera.forward).collect();
    let truth = solve_light(&scene.cloud, light, &towards, &settings, bars)?;
    let fields = Fields::of_truth(&truth, &scene.cameras, bars)?;
    let directions = settings.solve.quadrature.ordinates()?.len();
    let mut report = serde_json::to_value(&truth.report)?;
    report["method"] = json!("sweep");
    report["refinement"] = json!(truth.refine);
    report["solve_cells"] = json!(truth.fine.shape.len());
    report["directions"] = json!(directions);
    report["tolerance"] = json!(settings.solve.tolerance);
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

fn monte_carlo(args: &Args, scene: &Scene, light: Light, bars: &Bars) -> Result<(Fields, Value, String)> {
    let defaults = MonteCarloSettings::default();
    let settings = MonteCarloSettings {
        photons: args.samples.unwrap_or(defaults.photons),
        seed: args.seed.unwrap_or(defaults.seed),
    };
    let (fields, report) = solve_monte_carlo(&scene.cloud, light, &scene.cameras, &settings, bars)?;
    let lines = format!(
        "{} lit by {}: {} photons, seed {}\nmean scattered fluence rate {:.4e} ± {:.1e} W/m², energy balance {:+.1e} ± {:.1e}",
        args.scene.display(),
        args.lamp,
        settings.photons,
        settings.seed,
        report.means["phi_sc"].mean,
        report.means["phi_sc"].standard_error,
        report.energy_balance,
        report.energy_balance_se,
    );
    let mut report = serde_json::to_value(&report)?;
    report["method"] = json!("monte-carlo");
    // Cells stay whole, and nothing is iterated.
    report["refinement"] = json!(1);
    report["residual"] = Value::Null;
    report["sweeps"] = Value::Null;
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
