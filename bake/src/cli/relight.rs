//! `squall relight ASSET --lamps LAMPS.json --camera CAMERA.json -o IMAGE [--field DIR] [--compare DIR]`

mod compare;

use super::asset;
use super::camera::CameraArgs;
use super::common::Common;
use super::folder::{OutputFolder, check_apart};
use super::json as answer;
use super::light_quality::LightArgs;
use super::picture::{Format, PictureFile};
use serde_json::{Value, json};
use squall_bake::BakeError;
use squall_bake::fields::{Estimate, Fields, grey_picture};
use squall_bake::input::scene::read_lights;
use squall_bake::output::write_atomically;
use squall_bake::progress::Progress;
use squall_bake::provenance::tool;
use squall_bake::relit::{DirectFrom, EXACT_WORK, RelitReport, relight};
use squall_formats::section::response::DirectionalBasis;
use squall_runtime::Clouds;
use squall_runtime::camera::Camera;
use squall_runtime::tone::Tone;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Clouds lit by given lamps, from an asset: a picture of the scattered light, and per-cell fields on request.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// The asset.
    asset: PathBuf,
    /// The lamps (LAMPS.json): a list of {"position_m", "intensity_W_per_sr"}.
    #[arg(long)]
    lamps: PathBuf,
    #[command(flatten)]
    camera: CameraArgs,
    /// The picture to write: .exr holds linear radiance, .png is developed for a display; - is standard output.
    #[arg(short, long, value_name = "IMAGE")]
    out: PathBuf,
    /// Form of the picture where its name does not tell; png if left out.
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// Folder for per-cell fields in the layout of `squall solve`, and relight.json; made if missing.
    #[arg(long, value_name = "DIR")]
    field: Option<PathBuf>,
    /// Folder for the same lamps' light solved for directly, single scattering alone, differences, a section and figures; made if
    /// missing. The solve takes seconds to minutes.
    #[arg(long, value_name = "DIR")]
    compare: Option<PathBuf>,
    /// Factor on radiance for a .png, m² sr/W; left out, the brightest hundredth of the lit pixels comes out bright.
    #[arg(long, value_name = "FACTOR", value_parser = exposure)]
    exposure: Option<f32>,
    /// Where light straight from the lamps is taken from; left out, from the rows where they hold it, else from the lamps.
    #[arg(long, value_enum)]
    direct: Option<Direct>,
    #[command(flatten)]
    light: LightArgs,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: Common,
}

impl Args {
    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        self.json
    }
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Direct {
    /// The asset's rows, compressed with the rest.
    Rows,
    /// The lamps themselves, worked out now.
    Lamps,
}

/// Runs the command.
pub fn run(args: Args) -> anyhow::Result<()> {
    answer::check_stdout(args.json, &[&args.out]);
    let start = Instant::now();
    let out = PictureFile::prepare(&args.out, args.format)?;
    let asset = asset::open(&args.asset)?;
    let mut clouds = Clouds::new(&asset)?;
    clouds.set_quality(args.light.quality())?;
    let lamps = read_lights(&args.lamps)?;
    let (name, camera) = args.camera.read(&asset)?;
    let towards_region =
        matches!(clouds.relighter().response().head.basis, DirectionalBasis::ViewRegion { .. });
    let Folders { fields: folder, beside } = Folders::prepare(&args, &name, !towards_region)?;
    let bars = args.common.start()?;
    let direct = args.direct.map(|direct| match direct {
        Direct::Rows => DirectFrom::Rows,
        Direct::Lamps => DirectFrom::Lamps,
    });
    let (fields, report) = relight(&mut clouds, &lamps, (&name, &camera), direct, folder.is_some(), &bars)?;
    bars.finish();
    bars.check()?;
    let gathered = report.gathered.as_ref().map(ToString::to_string);
    let notes = [note_live(&report, &clouds), gathered, note_means(&report, &camera)];
    notes.into_iter().flatten().for_each(|note| bars.say(&note));
    let (_, width, image) = fields.images.first().ok_or(BakeError::NoPicture)?;
    let shown = grey_picture(*width, &image.mean);
    let exposure = args.exposure.unwrap_or_else(|| Tone::exposure_for(&shown));
    let tone = Tone { exposure, ..Tone::default() };
    out.write(&shown, &tone)?;
    bars.say(&format!(
        "{}: {} {} on {} virtual sources in {:.2} ms, {}, exposure {exposure:.3e}; {:.2} s",
        out.name(),
        report.lights,
        if report.lights == 1 { "lamp" } else { "lamps" },
        report.sources,
        report.relight_ms,
        bound(&report),
        start.elapsed().as_secs_f64(),
    ));
    let mut summary = json!({
        "tool": tool(),
        "asset": args.asset.to_string_lossy(),
        "dims_xyz": clouds.cloud().shape.to_array(),
        "exposure": exposure,
        "seconds": start.elapsed().as_secs_f64(),
        "files": [],
    });
    for (key, value) in serde_json::to_value(&report)?.as_object().into_iter().flatten() {
        summary[key] = value.clone();
    }
    if let (Some(folder), Some(place)) = (folder, &args.field) {
        let files = write_fields(folder, &fields, &summary)?;
        bars.say(&format!("{}: {}", place.display(), files.join(" ")));
        summary["files"] = json!(files);
    }
    if let (Some(beside), Some(place)) = (beside, &args.compare) {
        let bars = args.common.start()?;
        let found =
            squall_bake::relit::compare::compare(&mut clouds, &lamps, (&name, &camera), direct, &bars)?;
        bars.finish();
        bars.check()?;
        if towards_region {
            bars.say("note: no section: the asset's rows hold light towards its view region alone");
        }
        summary["compare"] = compare::write(beside, &found, &tone)?;
        bars.say(&format!("{}:\n{}", place.display(), compare::words(&found)));
    }
    if !args.json {
        return Ok(());
    }
    summary["command"] = json!("relight");
    summary["picture"] = json!(args.out.to_string_lossy());
    summary["fields"] = json!(args.field.as_ref().map(|field| field.to_string_lossy()));
    answer::answer(&summary)
}

/// Folders that were asked for, tried before the work.
struct Folders {
    fields: Option<OutputFolder>,
    beside: Option<OutputFolder>,
}

impl Folders {
    /// Errors: an output that replaces an input or another output; as [`OutputFolder::prepare`].
    fn prepare(args: &Args, camera: &str, section: bool) -> Result<Self, BakeError> {
        let (field_names, names) = (field_names(camera), compare::names(section));
        let in_fields = args.field.iter().flat_map(|place| field_names.iter().map(|file| place.join(file)));
        let in_beside = args.compare.iter().flat_map(|place| names.iter().map(|file| place.join(file)));
        let outputs: Vec<PathBuf> =
            std::iter::once(args.out.clone()).chain(in_fields).chain(in_beside).collect();
        let outputs: Vec<&Path> = outputs.iter().map(PathBuf::as_path).collect();
        check_apart(&outputs, [&args.asset, &args.lamps].into_iter().chain(args.camera.files()))?;
        let mut folders = Self {
            fields: args.field.as_deref().map(OutputFolder::prepare).transpose()?,
            beside: args.compare.as_deref().map(OutputFolder::prepare).transpose()?,
        };
        if let Some(fields) = &mut folders.fields {
            fields.expect(field_names.iter().map(String::as_str))?;
        }
        if let Some(beside) = &mut folders.beside {
            beside.expect(names)?;
        }
        Ok(folders)
    }
}

/// Writes `--field`'s folder and returns the files' names.
fn write_fields(folder: OutputFolder, fields: &Fields, summary: &Value) -> anyhow::Result<Vec<String>> {
    folder.write(|folder| {
        let mut files = fields.write(folder)?;
        let mut summary = summary.clone();
        summary["files"] = json!(files);
        let text = serde_json::to_string_pretty(&summary)? + "\n";
        write_atomically(&folder.join("relight.json"), |out| out.write_all(text.as_bytes()))?;
        files.push("relight.json".into());
        Ok(files)
    })
}

/// Names of the files that `--field` may make.
fn field_names(camera: &str) -> Vec<String> {
    let all = Fields {
        seen: Some(Estimate::default()),
        towards: vec![(camera.to_owned(), Estimate::default())],
        images: vec![(camera.to_owned(), 0, Estimate::default())],
        ..Fields::default()
    };
    let mut names = all.file_names();
    names.push("relight.json".into());
    names
}

/// That direct light was not followed for every ray, in words, if it was not.
fn note_means(report: &RelitReport, camera: &Camera) -> Option<String> {
    let pixels = u64::from(camera.width) * u64::from(camera.height);
    (!report.exact_direct).then(|| {
        format!(
            "note: direct light is read from means per cell: lamps outside of what was baked, of {} in all, times {pixels} pixels are more \
             than {EXACT_WORK}, up to which it is followed for every ray",
            report.lights
        )
    })
}

/// How far off the light may be, in words: the bound is of light from rows alone, and holds neither for lamps that were solved for nor
/// for light that was gathered anew.
fn bound(report: &RelitReport) -> String {
    match (&report.gathered, &report.live) {
        (Some(_), _) => "gathered anew".into(),
        (None, Some(live)) => format!("solved live to a residual of {:.1e}", live.residual),
        (None, None) => format!("error bound {:.2} %", 100.0 * report.error_bound),
    }
}

/// What was solved for on the spot, in words, if anything was.
fn note_live(report: &RelitReport, clouds: &Clouds) -> Option<String> {
    let live = report.live?;
    let [low, high] = clouds.bounds();
    Some(format!(
        "note: {} of {} lamps lie outside what was baked ({:.1} % of the box from {low} to {high} m); solved for on the spot, {} \
         sweeps, {:.2} s",
        report.lights_outside,
        report.lights,
        100.0 * clouds.share_lit(),
        live.sweeps,
        live.seconds
    ))
}

fn exposure(text: &str) -> Result<f32, String> {
    let value: f32 = text.parse().map_err(|error| format!("{error}"))?;
    if value > 0.0 && value.is_finite() { Ok(value) } else { Err("wanted a number above 0".into()) }
}
