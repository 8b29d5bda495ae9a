//! `squall synth …`: inputs from seeds.

#[cfg(feature = "meshes")]
mod street;

use super::common::Common;
use super::folder::OutputFolder;
use super::json;
use serde_json::json;
use squall_bake::BakeError;
use squall_bake::input;
use squall_bake::output::{Output, Place, folder_of};
use squall_bake::point_spread::{SpreadSettings, bake_point_spread};
use squall_bake::provenance::tool;
use squall_bake::synth::cloud::{CloudKind, synth_cloud};
use squall_bake::synth::streak::scene::Scene;
use squall_bake::synth::streak::write_streaks;
use squall_bake::synth::stroke::stroke_json;
use squall_bake::synth::town::synth_town;
use squall_formats::GridShape;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Makes inputs from seeds, so that a storm can be baked with nothing but this program.
#[derive(clap::Subcommand)]
pub enum Synth {
    /// A cloud: a density grid (OUT.f32) with its scene file (OUT.json).
    Cloud(Cloud),
    /// A small town with a wet road, lamps and hills, as JSON.
    Town(Town),
    /// A lightning stroke as points of light (LAMPS.json), for `squall relight`.
    Stroke(StrokeArgs),
    /// A street block as one sees it close up, as .glb; its own buffers from a camera, as .exr.
    #[cfg(feature = "meshes")]
    Street(street::Street),
    /// Pictures of streaks of raindrops that oscillate and refract (DIR/drop00.png and so on).
    Streaks(Streaks),
    /// The table of light that rain scatters more than once, as the runtime ships it.
    PointSpread(PointSpread),
}

/// Arguments of `squall synth point-spread`.
#[derive(clap::Args)]
pub struct PointSpread {
    /// The file: single-precision numbers, little-endian.
    #[arg(short, long, value_name = "OUT")]
    out: PathBuf,
    /// Seed; the same seed gives the same bytes. The shipped table's is 1.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Photons for each phase function; the shipped table's million takes two minutes of processor time.
    #[arg(long, default_value_t = 1_000_000)]
    photons: u64,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: Common,
}

/// Arguments of `squall synth stroke`.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct StrokeArgs {
    /// The JSON file.
    #[arg(short, long, value_name = "OUT")]
    out: PathBuf,
    /// Seed; the same seed gives the same bytes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Where the main channel starts, m.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    from: [f64; 3],
    /// Where it ends, m.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    to: [f64; 3],
    /// Radiant intensity of the whole stroke, W/sr.
    #[arg(long, default_value_t = 1.0)]
    intensity: f64,
    /// Distance between points, m: 0 makes one of every segment.
    #[arg(long, default_value_t = 0.0)]
    spacing: f64,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: Common,
}

/// Arguments of `squall synth streaks`.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Streaks {
    /// Folder for the pictures; made if missing.
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Seed; the same seed gives the same bytes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// What they show: level views in any light, or sets of one kind for drops to choose from: overcast, backlit, lamp, up.
    #[arg(long, default_value = "mixed", value_parser = ["mixed", "overcast", "backlit", "lamp", "up"])]
    scene: String,
    /// How many pictures; the first ones are the same for any number.
    #[arg(long, default_value_t = 12)]
    count: usize,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: Common,
}

/// Arguments of `squall synth cloud`.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Cloud {
    /// Name of the two files, without extension or with .json.
    #[arg(short, long, value_name = "OUT")]
    out: PathBuf,
    /// What kind of cloud.
    #[arg(long, value_enum, default_value_t = Kind::Storm)]
    kind: Kind,
    /// Seed; the same seed gives the same bytes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Cells along x, y and z [default: 96x64x48 for a storm, 32x32x4 for a layer].
    #[arg(long, value_name = "NXxNYxNZ", value_parser = parse_cells)]
    cells: Option<GridShape>,
    /// Middle of the grid on the ground, m.
    #[arg(long, value_name = "X,Y", value_parser = parse_place, default_value = "0,0", allow_hyphen_values = true)]
    centre: [f64; 2],
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: Common,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Kind {
    /// A thunderstorm: flat base, towers, anvil.
    Storm,
    /// A broken stratocumulus layer.
    Layer,
}

/// Arguments of `squall synth town`.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Town {
    /// The JSON file.
    #[arg(short, long, value_name = "OUT")]
    out: PathBuf,
    /// Seed; the same seed gives the same bytes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: Common,
}

fn parse_cells(text: &str) -> Result<GridShape, String> {
    let counts: Vec<u32> = text.split('x').map_while(|part| part.trim().parse().ok()).collect();
    match counts[..] {
        [nx, ny, nz] if text.split('x').count() == 3 => Ok(GridShape::new(nx, ny, nz)),
        _ => Err("wanted three counts such as 96x64x48".into()),
    }
}

fn parse_point(text: &str) -> Result<[f64; 3], String> {
    let parts: Vec<f64> = text.split(',').map_while(|part| part.trim().parse().ok()).collect();
    match parts[..] {
        [x, y, z] if text.split(',').count() == 3 => Ok([x, y, z]),
        _ => Err("wanted three distances in metres, such as 0,13000,6000".into()),
    }
}

fn parse_place(text: &str) -> Result<[f64; 2], String> {
    let parts: Vec<f64> = text.split(',').map_while(|part| part.trim().parse().ok()).collect();
    match parts[..] {
        [x, y] if text.split(',').count() == 2 && x.abs() <= 1e6 && y.abs() <= 1e6 => Ok([x, y]),
        _ => Err("wanted two distances in metres within 1000 km, such as 0,13000".into()),
    }
}

impl Synth {
    /// What the command is called in its answer, and whether that is to be JSON.
    pub fn json(&self) -> (&'static str, bool) {
        match self {
            Self::Cloud(arguments) => ("synth cloud", arguments.json),
            Self::Town(arguments) => ("synth town", arguments.json),
            Self::Stroke(arguments) => ("synth stroke", arguments.json),
            #[cfg(feature = "meshes")]
            Self::Street(arguments) => ("synth street", arguments.json),
            Self::Streaks(arguments) => ("synth streaks", arguments.json),
            Self::PointSpread(arguments) => ("synth point-spread", arguments.json),
        }
    }
}

impl Synth {
    fn common(&self) -> &Common {
        match self {
            Self::Cloud(arguments) => &arguments.common,
            Self::Town(arguments) => &arguments.common,
            Self::Stroke(arguments) => &arguments.common,
            #[cfg(feature = "meshes")]
            Self::Street(arguments) => &arguments.common,
            Self::Streaks(arguments) => &arguments.common,
            Self::PointSpread(arguments) => &arguments.common,
        }
    }
}

/// Runs the chosen maker.
pub fn run(command: Synth) -> anyhow::Result<()> {
    let (name, in_json) = command.json();
    let quiet = command.common().is_quiet();
    let bars = command.common().start()?;
    let (seed, files) = match command {
        Synth::Cloud(arguments) => {
            let kind = match arguments.kind {
                Kind::Storm => CloudKind::Storm,
                Kind::Layer => CloudKind::Layer,
            };
            json::check_stdout(in_json, &[&arguments.out]);
            check_cloud(&arguments.out)?;
            let cloud = synth_cloud(kind, arguments.seed, arguments.cells)?.centred_on(arguments.centre);
            let scene = cloud.write(&arguments.out)?;
            // In words the scene alone is named: it names the other.
            let grid = in_json.then(|| scene.with_extension("f32"));
            (arguments.seed, std::iter::once(scene).chain(grid).collect())
        }
        Synth::Town(arguments) => {
            json::check_stdout(in_json, &[&arguments.out]);
            let note = format!("squall synth town --seed {}", arguments.seed);
            let text = input::town::town_json(&synth_town(arguments.seed), &note);
            (arguments.seed, write_text(&arguments.out, &text)?)
        }
        Synth::Stroke(arguments) => {
            let StrokeArgs { out, seed, from, to, intensity, spacing, .. } = arguments;
            json::check_stdout(in_json, &[&out]);
            let text = stroke_json(seed, [from, to], intensity, spacing)?;
            (seed, write_text(&out, &text)?)
        }
        #[cfg(feature = "meshes")]
        Synth::Street(arguments) => street::run(&arguments, &bars)?,
        Synth::Streaks(arguments) => {
            let Streaks { out, scene, seed, count, .. } = arguments;
            let scene = Scene::from_name(&scene).unwrap_or(Scene::Mixed);
            let files = OutputFolder::prepare(&out)?
                .write(|out| Ok(write_streaks(out, scene, seed, count, &bars)?))?;
            bars.finish();
            (seed, files)
        }
        Synth::PointSpread(arguments) => {
            let PointSpread { out, seed, photons, .. } = arguments;
            json::check_stdout(in_json, &[&out]);
            let file = Output::prepare(&out)?;
            let table = bake_point_spread(&SpreadSettings { photons, seed }, &bars)?;
            bars.finish();
            file.write(|out| out.write_all(&table))?;
            (seed, if file.is_stdout() { Vec::new() } else { vec![out] })
        }
    };
    if in_json {
        let names: Vec<_> = files.iter().map(|file| file.to_string_lossy()).collect();
        let answer = json!({ "command": name, "tool": tool(), "seed": seed, "files": names });
        return json::answer(&answer);
    }
    for file in files.iter().filter(|_| !quiet) {
        say!("{}", file.display());
    }
    Ok(())
}

/// Writes a text to a file, whose name comes back, or to standard output itself.
fn write_text(path: &Path, text: &str) -> anyhow::Result<Vec<PathBuf>> {
    let out = Output::prepare(path)?;
    out.write(|out| out.write_all(text.as_bytes()))?;
    Ok(if out.is_stdout() { Vec::new() } else { vec![path.to_owned()] })
}

/// Refuses a name that two files cannot be made from, before the work. Errors: as [`Output::prepare`].
fn check_cloud(out: &Path) -> Result<(), BakeError> {
    if !matches!(Place::of(out)?, Place::File(_)) {
        return Err(BakeError::input(out, "output", "a name for two files", "standard output or a device"));
    }
    let stem = if out.extension().is_some_and(|e| e == "json") { out.with_extension("") } else { out.into() };
    let name = stem.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let names = ["f32", "json"].map(|extension| format!("{name}.{extension}"));
    names.iter().try_for_each(|name| Output::prepare(&folder_of(out).join(name)).map(|_| ()))
}
