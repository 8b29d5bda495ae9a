//! `squall wet GBUFFER.exr --rate R … -o OUT`

mod animated;
mod frames;
mod list;
mod output;

use super::common::Common;
use super::render::{Range, range};
use super::{asset, folder, json, number};
use frames::{Made, Sequence};
use serde_json::{Value, json};
use squall_bake::BakeError;
use squall_bake::input::gbuffer::Reading;
use squall_bake::input::gbuffer::roles::Role;
use squall_bake::input::scene::read_camera;
use squall_bake::provenance::tool;
use squall_bake::recipe::read_view;
use squall_formats::section::view::ViewSection;
use squall_formats::units::MillimetresPerHour;
use squall_runtime::wet::draw::{Effect, WetRenderer, WetSettings};
use squall_runtime::wet::maps::WetMaps;
use squall_runtime::{Asset, RuntimeError};
use std::path::{Path, PathBuf};

/// Makes your own renders wet: a renderer's buffers in (OpenEXR); wet surfaces, puddles, rain and glow out.
///
/// Layers are found by the names that Blender, Houdini, Unreal and pbrt write; what is missing is done without, and said. GBUFFER may be a pattern
/// with #### for a frame's number (OUT is then one too).
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// The buffers: an OpenEXR file with layers of colour and depth or places, and as many more as there are; or a pattern of such files.
    #[arg(required_unless_present = "list")]
    gbuffer: Option<PathBuf>,
    /// An asset with the rain's tables, and a view; a small built-in one if left out.
    #[arg(long)]
    asset: Option<PathBuf>,
    /// A view in place of the asset's: a TOML file with the table `view`; its tables `wet`, `rain` and `tone` count.
    #[arg(long, value_name = "VIEW")]
    scene: Option<PathBuf>,
    /// The camera (CAMERA.json); the file's own attributes tell it if left out.
    #[arg(long)]
    camera: Option<PathBuf>,
    /// Rainfall intensity, mm/h; the view's if left out.
    #[arg(long, value_name = "R", value_parser = number::from_zero)]
    rate: Option<f64>,
    /// Time of the (first) frame, s.
    #[arg(long, value_name = "S", value_parser = number::from_to(-1e9, 1e9, "s"))]
    time: Option<f64>,
    /// Frames A to B − 1: of a pattern the files with those numbers; one file is made wet at every one of their times.
    #[arg(long, value_name = "A..B", allow_hyphen_values = true, value_parser = range)]
    frames: Option<Range>,
    /// Frames a second: frame k is k / F seconds after --time.
    #[arg(long, value_name = "F", default_value_t = 30.0, value_parser = number::positive)]
    fps: f64,
    /// Effects to draw, and no others: --list has their names.
    #[arg(long, value_name = "EFFECT,…", value_delimiter = ',', value_parser = effect, conflicts_with = "without")]
    only: Vec<Effect>,
    /// Effects to draw beside those that are on: flicker, drops, layers and glass are off unless a view or this asks for them.
    #[arg(long = "with", value_name = "EFFECT,…", value_delimiter = ',', value_parser = effect, conflicts_with = "only")]
    beside: Vec<Effect>,
    /// Effects to leave out.
    #[arg(long, value_name = "EFFECT,…", value_delimiter = ',', value_parser = effect)]
    without: Vec<Effect>,
    /// Sets a control, such as surface.puddles=0.5; as often as wanted.
    #[arg(long = "set", value_name = "EFFECT.CONTROL=X", value_parser = list::setting)]
    settings: Vec<list::Setting>,
    /// Intensities of lightning from its two key directions, 1 at their brightest.
    #[arg(long, value_name = "L1,L2", default_value = "0,0", value_parser = number::list_from_to::<2>(0.0, 1e6, ""))]
    lightning: [f64; 2],
    /// Wind, m/s: x and y along the ground, z up; the view's if left out.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = number::list_from_to::<3>(-200.0, 200.0, "m/s"))]
    wind: Option<[f64; 3]>,
    /// Another seed is another rain; the view's if left out.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Light: a panorama in latitude and longitude (EXR); estimated once, from the first frame, if left out.
    #[arg(long, value_name = "EXR")]
    environment: Option<PathBuf>,
    /// Names a layer: colour, depth, position, normal, albedo, roughness, emission or wettable, and the file's name for it; "none" leaves it out.
    #[arg(long = "layer", value_name = "BUFFER=NAME", value_parser = layer, help_heading = "Buffers")]
    named: Vec<(Role, String)>,
    /// Which way is up in the file's world; as its writer has it if left out.
    #[arg(long, value_enum, help_heading = "Buffers")]
    up: Option<Up>,
    /// Which hand its world has; as its writer has it if left out.
    #[arg(long, value_enum, help_heading = "Buffers")]
    hand: Option<Hand>,
    /// Metres of a unit of its depth and places: .01 for centimetres; as its writer has it if left out.
    #[arg(long, value_name = "M", value_parser = number::positive, help_heading = "Buffers")]
    unit_m: Option<f64>,
    /// What its normals are measured in; what agrees with depth if left out.
    #[arg(long, value_enum, help_heading = "Buffers")]
    normals: Option<Normals>,
    /// What its depth measures: along the viewing axis, or along each pixel's ray.
    #[arg(long, value_enum, default_value = "planar", help_heading = "Buffers")]
    depth_kind: DepthArg,
    /// Writes every effect as a layer of the .exr, R, G, B and A, beside the picture.
    #[arg(long)]
    layers: bool,
    /// Stops to brighten (or, negative, darken) a .png by.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = number::from_to(-64.0, 64.0, ""))]
    stops: f64,
    /// The wet frame: .png is developed for a display, .exr holds linear light, .apng is animated; or a pattern.
    #[arg(short, long, required_unless_present = "list")]
    out: Option<PathBuf>,
    /// One animated PNG of all frames, which plays for ever; a name that ends in .apng says the same.
    #[arg(long, conflicts_with_all = ["resume", "layers"])]
    apng: bool,
    /// Keeps frames that are there, whole, and were made of the same inputs with these settings.
    #[arg(long)]
    resume: bool,
    /// Ends at the first frame that fails.
    #[arg(long)]
    strict: bool,
    /// Lists the effects and their controls, with units, ranges, usual values and the paper's names and sections.
    #[arg(long)]
    list: bool,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: Common,
}

/// `--up`
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Up {
    /// The third axis.
    Z,
    /// The second.
    Y,
}

/// `--hand`
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Hand {
    /// As Blender and Houdini have it.
    Right,
    /// As Unreal and pbrt have it.
    Left,
}

/// `--normals`
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Normals {
    /// The world.
    World,
    /// The camera.
    Camera,
}

/// `--depth-kind`
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum DepthArg {
    /// Along the viewing axis.
    Planar,
    /// Along each pixel's own ray.
    Ray,
}

fn effect(name: &str) -> Result<Effect, String> {
    let known = || Effect::ALL.map(Effect::name).join(", ");
    Effect::from_name(name.trim()).ok_or_else(|| format!("wanted some of {}", known()))
}

fn layer(text: &str) -> Result<(Role, String), String> {
    let roles = || Role::ALL.map(Role::name).join(", ");
    let wanted = || format!("wanted BUFFER=NAME, BUFFER one of {}", roles());
    let (role, name) = text.split_once('=').ok_or_else(wanted)?;
    Ok((Role::from_name(role.trim()).ok_or_else(wanted)?, name.to_owned()))
}

impl Args {
    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        self.json
    }

    /// Ends the command (exit code 2) where options do not go together.
    fn check_usage(&self) {
        if let Some(out) = &self.out {
            json::check_stdout(self.json, &[out.as_path()]);
            if self.stops != 0.0 && out.extension() == Some("exr".as_ref()) {
                json::usage("--stops brightens a .png; an .exr holds light as it is");
            }
        }
        if self.resume && self.is_animated() {
            json::usage(
                "--resume keeps frames that are files of their own, and an animated picture is one file",
            );
        }
        if let Some(effect) = self.beside.iter().find(|effect| self.without.contains(effect)) {
            json::usage(&format!("{}: --with turns it on, --without off; wanted one of them", effect.name()));
        }
        for (at, (role, _)) in self.named.iter().enumerate() {
            if self.named[..at].iter().any(|(other, _)| other == role) {
                json::usage(&format!("--layer {}: wanted every buffer once, found twice", role.name()));
            }
        }
    }

    /// Whether all frames go into one animated picture.
    fn is_animated(&self) -> bool {
        let named = |out: &PathBuf| out.extension().is_some_and(|end| end.eq_ignore_ascii_case("apng"));
        self.apng || self.out.as_ref().is_some_and(named)
    }

    /// What is said of the buffers. Errors: a camera that cannot be read.
    fn reading(&self) -> Result<Reading, BakeError> {
        let camera = self.camera.as_deref().map(read_camera).transpose()?;
        Ok(Reading {
            layers: self.named.clone(),
            y_up: self.up.map(|up| up == Up::Y),
            left_handed: self.hand.map(|hand| hand == Hand::Left),
            metres: self.unit_m,
            world_normals: self.normals.map(|space| space == Normals::World),
            ray_depth: self.depth_kind == DepthArg::Ray,
            camera: camera.map(|(_, camera)| camera),
        })
    }

    /// Effects and controls: the view's, then the command line's. Errors: a view that this build cannot draw by.
    fn settings(&self, view: Option<&ViewSection>) -> Result<WetSettings, RuntimeError> {
        let mut settings =
            view.map_or_else(|| Ok(WetSettings::default()), |view| WetSettings::of_view(&view.wet))?;
        for setting in &self.settings {
            settings.set(setting.effect, setting.control, setting.value)?;
        }
        self.beside.iter().for_each(|effect| settings.turn(*effect, true));
        if !self.only.is_empty() {
            settings.only(&self.only);
        }
        self.without.iter().for_each(|effect| settings.turn(*effect, false));
        Ok(settings)
    }
}

impl Args {
    /// What was set of effects that are off: each once.
    fn unheard(&self, settings: &WetSettings) -> Vec<String> {
        let mut off: Vec<Effect> = Vec::new();
        for setting in &self.settings {
            if !settings.is_on(setting.effect) && !off.contains(&setting.effect) {
                off.push(setting.effect);
            }
        }
        let note = |effect: Effect| {
            let name = effect.name();
            format!("--set {name}.… changes nothing: {name} is off (--with {name} turns it on)")
        };
        off.into_iter().map(note).collect()
    }
}

/// The view that counts, and whether it is one that was named: a TOML's, or the asset's.
fn view_of(args: &Args, asset: Option<&Asset>) -> Result<Option<(ViewSection, bool)>, BakeError> {
    let names = |asset: &Asset| -> Result<Vec<String>, RuntimeError> {
        use squall_formats::section::bolt::BoltSection;
        if asset.directory().find(BoltSection::TAG).is_none() {
            return Ok(Vec::new());
        }
        let section = asset.section(BoltSection::TAG, "the strokes", BoltSection::read)?;
        Ok(section.strokes.into_iter().map(|record| record.name).collect())
    };
    if let Some(path) = &args.scene {
        let strokes = asset.map(names).transpose()?.unwrap_or_default();
        return Ok(Some((read_view(path, &strokes)?, true)));
    }
    match asset.filter(|asset| asset.directory().find(ViewSection::TAG).is_some()) {
        Some(asset) => Ok(Some((asset.section(ViewSection::TAG, "the view", ViewSection::read)?, false))),
        None => Ok(None),
    }
}

pub fn run(args: Args) -> anyhow::Result<()> {
    if args.list {
        return list::print(args.json);
    }
    args.check_usage();
    let start = std::time::Instant::now();
    let (Some(gbuffer), Some(out)) = (&args.gbuffer, &args.out) else { return Ok(()) };
    let named = [&args.asset, &args.scene, &args.camera, &args.environment];
    let inputs: Vec<PathBuf> = named.into_iter().flatten().cloned().chain([gbuffer.clone()]).collect();
    folder::check_apart(&[out.as_path()], inputs.iter())?;
    let asset = args.asset.as_deref().map(asset::open).transpose()?;
    let view = view_of(&args, asset.as_ref())?;
    let settings = args.settings(view.as_ref().map(|(view, _)| view))?;
    let rate = args.rate.or_else(|| view.as_ref().map(|(view, _)| view.rain.rate_mm_per_h));
    let Some(rate) = rate else {
        json::usage("--rate R, or a view that has one (--scene, --asset): wanted one of them, found neither");
    };
    let mut renderer = match &asset {
        Some(asset) => WetRenderer::new(asset)?,
        None => WetRenderer::built_in()?,
    };
    if MillimetresPerHour(rate).0 > renderer.largest_rate().0 {
        let wanted = format!("0 to {} mm/h, the range of this rain's tables", renderer.largest_rate().0);
        return Err(BakeError::Setting { field: "--rate", wanted, found: rate.to_string() }.into());
    }
    renderer.set_clock(Some(seconds));
    let bars = args.common.start()?;
    let reading = args.reading()?;
    let sequence = Sequence::of(&args, (gbuffer, out), (rate, view.as_ref()))?;
    let asset_bytes = asset.as_ref().map_or(&b""[..], Asset::bytes);
    let maps = asset.as_ref().map_or_else(|| Ok(WetMaps::default()), WetMaps::of)?;
    let mut made = sequence.run((&mut renderer, &settings), &reading, (asset_bytes, &maps), &bars)?;
    made.notes.splice(0..0, args.unheard(&settings));
    for note in &made.notes {
        bars.say(&format!("note: {note}"));
    }
    for (frame, words) in &made.failed {
        bars.warn(&format!("{frame}: {words}"));
    }
    let seconds = start.elapsed().as_secs_f64();
    bars.say(&words(out, &made, seconds));
    if args.json {
        json::answer(&answer(out, rate, &made, seconds))?;
    }
    match made.failed.first() {
        Some((_, first)) => {
            let (failed, of, first) = (made.failed.len(), made.failed.len() + made.frames, first.clone());
            Err(BakeError::Frames { failed, of, first }.into())
        }
        None => Ok(()),
    }
}

/// Seconds since the process asked first.
fn seconds() -> f64 {
    use std::sync::LazyLock;
    use std::time::Instant;
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    START.elapsed().as_secs_f64()
}

fn words(out: &Path, made: &Made, seconds: f64) -> String {
    let frames = if made.frames == 1 { "frame" } else { "frames" };
    let kept = if made.kept > 0 { format!(" ({} kept)", made.kept) } else { String::new() };
    let effects: Vec<String> = made
        .effects
        .iter()
        .map(|report| format!("{} {:.0} ms {} px", report.effect.name(), report.seconds * 1e3, report.pixels))
        .collect();
    let effects = if effects.is_empty() { String::new() } else { format!(", {}", effects.join(", ")) };
    format!("{}: {} {frames}{kept}{effects}, {seconds:.2} s", out.display(), made.frames)
}

fn answer(out: &Path, rate: f64, made: &Made, seconds: f64) -> Value {
    let layers: serde_json::Map<String, Value> =
        made.found.iter().map(|(role, name)| (role.name().to_owned(), json!(name))).collect();
    let effects: Vec<Value> = made
        .effects
        .iter()
        .map(|report| {
            json!({
                "effect": report.effect.name(),
                "milliseconds": report.seconds * 1e3,
                "pixels": report.pixels,
                "count": report.count,
            })
        })
        .collect();
    let errors: Vec<Value> =
        made.failed.iter().map(|(frame, error)| json!({ "frame": frame, "error": error })).collect();
    json!({
        "command": "wet",
        "tool": tool(),
        "out": out.to_string_lossy(),
        "frames": made.frames,
        "kept": made.kept,
        "failed": made.failed.len(),
        "errors": errors,
        "rate_mm_per_h": rate,
        "writer": made.writer,
        "camera_from": made.camera_from,
        "layers": layers,
        "effects": effects,
        "notes": made.notes,
        "seconds": seconds,
    })
}
