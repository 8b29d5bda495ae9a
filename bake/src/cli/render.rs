//! `squall render ASSET -o PICTURE`, or of many frames: `--frames A..B --fps F -o NAME.####.png`

pub(super) mod animation;
mod backend;
mod flashes;
mod layers;
mod mark;
mod sequence;
mod weather;

use super::asset;
use super::common::Common;
use super::folder;
use super::json;
use super::light_quality::LightArgs;
use super::number;
use super::picture::{Format, PictureFile, Sheet, sky_words};
use super::progress::Bars;
use super::sky::SkyArgs;
use backend::{Backend, Choice};
use flashes::Timeline;
use sequence::Sequence;
pub use sequence::{Range, range};
use serde_json::{Value, json};
use squall_bake::BakeError;
use squall_bake::input::scene::read_camera;
use squall_bake::progress::Progress;
use squall_bake::provenance::tool;
use squall_bake::recipe::read_view;
use squall_formats::section::density::DensitySection;
use squall_formats::section::view::{ViewFlash, ViewSection};
use squall_formats::units::{MillimetresPerHour, Seconds};
use squall_runtime::density::read_density;
use squall_runtime::frame::{FrameQuality, tone_of};
use squall_runtime::picture::Picture;
use squall_runtime::renderer::{FrameReport, Layer};
use squall_runtime::tone::Tone;
use squall_runtime::{Asset, Camera, Frame, RuntimeError, StormRenderer};
use std::path::{Path, PathBuf};

/// Draws a picture from an asset alone: .png is developed for a display, .exr holds linear radiance.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// The asset.
    asset: PathBuf,
    /// The picture to write; - is standard output.
    #[arg(short, long)]
    out: PathBuf,
    /// Form of the picture where its name does not tell; png if left out.
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// A view in place of the asset's own: a TOML file with the table `view` and those under it, as in a recipe.
    #[arg(long)]
    scene: Option<PathBuf>,
    /// A camera (CAMERA.json) in place of the view's: one camera object of a scene.
    #[arg(long)]
    camera: Option<PathBuf>,
    /// Rainfall intensity, mm/h.
    #[arg(long, value_parser = number::from_zero)]
    rate: Option<f64>,
    /// Name of a stroke that flashes, once for each; "none" for a dark picture.
    #[arg(long = "flash")]
    flashes: Vec<String>,
    /// Time of the exposure, s: moves the rain.
    #[arg(long, value_parser = number::from_to(-1e9, 1e9, "s"))]
    time: Option<f64>,
    /// Width and height, px: 1 to 2^26 pixels in all.
    #[arg(long, num_args = 2, action = clap::ArgAction::Set, value_names = ["WIDTH", "HEIGHT"])]
    size: Option<Vec<u32>>,
    /// Stops to brighten (or, negative, darken) a .png by.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = stops)]
    stops: f32,
    #[command(flatten)]
    sky: SkyArgs,
    /// How finely it is worked out.
    #[arg(long, value_enum, default_value_t = Quality::Still)]
    quality: Quality,
    #[command(flatten)]
    light: LightArgs,
    /// Samples along each side of a pixel of the town, in place of the quality's: 2 of a still picture, 1 of a preview.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=8))]
    samples: Option<u32>,
    /// Draws a sheet of eight instead: no rain, 2, 25 and 75 mm/h across; flashes off and on down, and four more at gain 1 where the
    /// view's is another.
    #[arg(long, conflicts_with_all = ["rate", "flashes"])]
    contact_sheet: bool,
    /// Time that the shutter is open, ms; the view's if left out.
    #[arg(long, value_name = "T", value_parser = number::from_to(1e-3, 1e4, "ms"))]
    exposure_ms: Option<f64>,
    /// Frames A to B − 1 of a sequence: frame k is k / F seconds after the view's time, and its flashes are curves in time.
    #[arg(long, value_name = "A..B", allow_hyphen_values = true, value_parser = sequence::range, requires = "fps", conflicts_with_all = ["contact_sheet", "format"])]
    frames: Option<sequence::Range>,
    /// Frames a second.
    #[arg(long, value_name = "F", value_parser = rate, requires = "frames")]
    fps: Option<f64>,
    /// One animated PNG of all frames; a name that ends in .apng says the same.
    #[arg(long, requires = "frames")]
    apng: bool,
    /// Keep frames that are there, whole, and were drawn with these very settings; draw the others.
    #[arg(long, requires = "frames", conflicts_with = "apng")]
    resume: bool,
    /// Keys of flashes in place of the view's (JSON): docs/sequences.md.
    #[arg(long = "flashes", value_name = "KEYS", requires = "frames", conflicts_with = "flashes")]
    keys: Option<PathBuf>,
    /// Seed of the view's flash.
    #[arg(long, value_name = "N", default_value_t = 1, requires = "frames", conflicts_with = "keys")]
    flash_seed: u64,
    /// When its first return stroke begins, s after frame 0.
    #[arg(long, value_name = "S", default_value_t = 0.1, value_parser = number::from_to(-1e9, 1e9, "s"), requires = "frames", conflicts_with = "keys")]
    flash_at: f64,
    /// Takes all water off the town's ground and lets no rain fall: a picture for `squall wet`.
    #[arg(long, conflicts_with_all = ["rate", "contact_sheet"])]
    dry: bool,
    /// Layers of an .exr, with commas between them: beauty, cloud, direct, streak-alpha, transmittance, depth, normal, albedo, roughness,
    /// emission, wettable, ids.
    #[arg(long, value_name = "LAYERS", value_delimiter = ',', value_parser = layers::layer, conflicts_with = "contact_sheet")]
    layers: Vec<Layer>,
    /// What draws: the processor, a graphics card, or a card where one can: docs/gpu.md.
    #[arg(long, value_enum, default_value_t)]
    backend: Choice,
    /// Write what the last picture took: ms a part, adapter, bytes (JSON).
    #[arg(long, value_name = "REPORT")]
    report: Option<PathBuf>,
    #[command(flatten)]
    weather: weather::Weather,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: Common,
}

/// How finely a picture is worked out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Quality {
    /// As finely as a picture that is looked at for long.
    Still,
    /// One sample a pixel, mirrors at an eighth of the size, fewer rays of direct light: in a fraction of the time.
    Preview,
}

impl From<Quality> for FrameQuality {
    fn from(quality: Quality) -> Self {
        match quality {
            Quality::Still => Self::STILL,
            Quality::Preview => Self::PREVIEW,
        }
    }
}

impl Args {
    /// Whether the frames of a sequence go into one picture.
    fn animated(&self) -> bool {
        self.apng || self.out.extension().is_some_and(|end| end == "apng")
    }

    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        self.json
    }
}

impl Args {
    /// Ends the command (exit code 2) where options do not go together.
    fn check_usage(&self) {
        let outputs: Vec<&Path> =
            std::iter::once(&self.out).chain(&self.report).map(PathBuf::as_path).collect();
        json::check_stdout(self.json, &outputs);
        if self.frames.is_some() && self.animated() {
            if !self.layers.is_empty() {
                json::usage("--layers go into .exr files, not into an animated picture");
            }
            if self.resume {
                json::usage(
                    "--resume keeps frames that are files of their own, and an animated picture is one file",
                );
            }
        }
        if let Some([width, height]) = self.size.as_deref()
            && !(1..=1 << 26).contains(&(u64::from(*width) * u64::from(*height)))
        {
            json::usage(&format!("--size: wanted 1 to 2^26 pixels in all, found {width} × {height}"));
        }
        if self.stops != 0.0
            && (self.format == Some(Format::Exr) || self.out.extension() == Some("exr".as_ref()))
        {
            json::usage("--stops brightens a .png; an .exr holds radiance as it is");
        }
        if self.flashes.iter().any(|name| name == "none") && self.flashes.len() > 1 {
            json::usage("--flash none is a dark picture, and goes with no other --flash");
        }
        for (at, name) in self.flashes.iter().enumerate() {
            if self.flashes[..at].contains(name) {
                json::usage(&format!("--flash {name}: wanted every stroke once, found twice"));
            }
        }
        for (at, layer) in self.layers.iter().enumerate() {
            if self.layers[..at].contains(layer) {
                json::usage(&format!("--layers: wanted every layer once, found {} twice", layer.name()));
            }
        }
    }

    /// Where a lone picture goes, tried. Errors: as [`PictureFile::prepare`]; layers into a .png.
    fn picture(&self) -> Result<PictureFile, BakeError> {
        let out = PictureFile::prepare(&self.out, self.format)?;
        if !self.layers.is_empty() && out.format() != Format::Exr {
            let wanted = "a name that ends in .exr, which holds layers (or --format exr)";
            return Err(BakeError::input(&self.out, "output", wanted, self.out.display()));
        }
        Ok(out)
    }
}

fn stops(text: &str) -> Result<f32, String> {
    let wanted = "wanted a number from -64 to 64";
    let value: f32 = text.parse().map_err(|_| wanted.to_owned())?;
    if value.abs() <= 64.0 { Ok(value) } else { Err(wanted.into()) }
}

fn rate(text: &str) -> Result<f64, String> {
    let found = text.parse::<f64>().ok().filter(|rate| *rate > 0.0 && *rate <= 1e6);
    found.ok_or_else(|| "wanted frames a second above 0, a million at most".into())
}

/// Rainfall intensities of a contact sheet, mm/h.
const SHEET_RATES: [f64; 4] = [0.0, 2.0, 25.0, 75.0];

pub fn run(args: Args) -> anyhow::Result<()> {
    args.check_usage();
    let start = std::time::Instant::now();
    let out = match args.frames {
        Some(_) => None,
        None => Some(args.picture()?),
    };
    let inputs = std::iter::once(&args.asset).chain(&args.scene).chain(&args.camera).chain(&args.keys);
    let results: Vec<&Path> = std::iter::once(&args.out).chain(&args.report).map(PathBuf::as_path).collect();
    folder::check_apart(&results, inputs)?;
    let mut renderer = StormRenderer::new(asset::open(&args.asset)?)?;
    if args.dry {
        renderer.dry_ground()?;
    }
    let camera = args.camera.as_deref().map(read_camera).transpose()?;
    let camera = camera.map(|(_, camera)| camera);
    let mut view = view_of(&args, camera.as_ref(), &renderer)?;
    args.weather.set_view(&mut view);
    view.check().map_err(|(field, wanted, found)| RuntimeError::argument(field, wanted, found))?;
    let mut frame = Frame::from(&view);
    if args.dry {
        frame = frame.rain(MillimetresPerHour(0.0));
    }
    if let Some(camera) = camera {
        frame.camera = camera.resized(view.camera.size_px)?;
    }
    frame.quality = args.quality.into();
    frame.quality.light = args.light.quality();
    if let Some(samples) = args.samples {
        frame.quality.town.samples = samples;
    }
    if let Some(milliseconds) = args.exposure_ms {
        frame.exposure = Seconds(milliseconds * 1e-3);
        frame.check()?;
    }
    let tone = tone_of(&view.tone).brighter(args.stops);
    let bars = args.common.start()?;
    let asks = (args.report.is_some(), !args.layers.is_empty());
    let mut backend = Backend::set(args.backend, &mut renderer, asks)?;
    let Some(out) = out else {
        return draw_frames(&args, (&mut renderer, &mut backend), (&frame, &view), &tone, (&bars, start));
    };
    if args.contact_sheet {
        let mut physical = frame.clone();
        physical.streaks.gain = 1.0;
        let mut rows = vec![frame.clone().dark(), frame.clone()];
        if frame.streaks.gain != 1.0 {
            rows.push(physical);
        }
        let count = rows.len() * SHEET_RATES.len();
        bars.begin("pictures", count as u64);
        let mut sheet = Sheet::new(SHEET_RATES.len(), rows.len(), view.camera.size_px)?;
        for (row, frame) in rows.iter().enumerate() {
            for (column, rate) in SHEET_RATES.into_iter().enumerate() {
                let one = frame.clone().rain(MillimetresPerHour(rate));
                sheet.place(column, row, backend.render(&mut renderer, &one)?);
                bars.check()?;
                bars.advance(1);
            }
        }
        out.write(sheet.picture(), &tone)?;
        let seconds = start.elapsed().as_secs_f64();
        let sky = sky_words(&renderer.report());
        let said = sky.as_ref().map_or_else(String::new, |words| format!(", {words}"));
        bars.say(&format!("{}: {count} pictures{said}, {seconds:.2} s", out.name()));
        told(&args, &backend, &renderer, &bars)?;
        return answer(&args, sheet.picture(), (None, count), (&Value::Null, sky, seconds));
    }
    bars.begin("picture", 1);
    backend.render(&mut renderer, &frame)?;
    if args.layers.is_empty() {
        out.write(renderer.picture(), &tone)?;
    } else {
        out.write_bytes(&layers::encode(&renderer, &frame, &args.layers, None)?)?;
    }
    let (report, seconds) = (renderer.report(), start.elapsed().as_secs_f64());
    bars.say(&out.words(renderer.picture(), &report, seconds));
    told(&args, &backend, &renderer, &bars)?;
    let heard = view.flashes.iter().map(|flash| {
        let thunder = flashes::thunder(&renderer, &flash.stroke, frame.camera.position)?;
        Ok(json!({ "stroke": flash.stroke, "span_s": null, "return_strokes": [], "thunder": thunder }))
    });
    let heard = heard.collect::<Result<Vec<_>, RuntimeError>>()?;
    answer(&args, renderer.picture(), (Some(&report), 1), (&heard.into(), sky_words(&report), seconds))
}

/// Says who drew, where that is not who was asked, and writes what the last picture took.
///
/// Of frames that were all kept nothing was drawn, and no report is written.
fn told(args: &Args, backend: &Backend, renderer: &StormRenderer, bars: &Bars) -> anyhow::Result<()> {
    if let Some(words) = backend.words() {
        bars.say(&words);
    }
    args.report.as_deref().map_or(Ok(()), |path| backend.report(path, renderer))
}

/// Draws the frames of a sequence.
fn draw_frames(
    args: &Args,
    (renderer, backend): (&mut StormRenderer, &mut Backend),
    (frame, view): (&Frame, &ViewSection),
    tone: &Tone,
    (bars, start): (&Bars, std::time::Instant),
) -> anyhow::Result<()> {
    let (Some(range), Some(fps)) = (args.frames, args.fps) else { return Ok(()) };
    let mut timeline = match &args.keys {
        Some(path) => Timeline::read(path, renderer.strokes())?,
        None => Timeline::natural(&view.flashes, args.flash_seed, args.flash_at),
    };
    let (animated, layers) = (args.animated(), args.layers.as_slice());
    let sequence =
        Sequence { range, fps, animated, resume: args.resume, dry: args.dry, out: &args.out, layers };
    timeline.run_along(renderer, frame.exposure)?;
    let made = sequence.run((renderer, backend), frame, (&timeline, tone), bars)?;
    let (count, seconds) = (range.end - range.first, start.elapsed().as_secs_f64());
    let kept = if made.kept > 0 { format!(" ({} kept)", made.kept) } else { String::new() };
    if made.redrawn > 0 {
        let were = if made.redrawn == 1 { "frame was" } else { "frames were" };
        let words = "there, not drawn with these settings: drawn again";
        bars.warn(&format!("{}: {} {were} {words}", args.out.display(), made.redrawn));
    }
    bars.say(&format!(
        "{}: {count} frames{kept}, {} streaks, {seconds:.2} s",
        args.out.display(),
        made.streaks
    ));
    if made.kept < count {
        told(args, backend, renderer, bars)?;
    } else if let Some(report) = &args.report {
        bars.warn(&format!("{}: not written, as nothing was drawn", report.display()));
    }
    if !args.json {
        return Ok(());
    }
    json::answer(&json!({
        "command": "render",
        "tool": tool(),
        "asset": args.asset.to_string_lossy(),
        "picture": args.out.to_string_lossy(),
        "size_px": [frame.camera.width, frame.camera.height],
        "frames": count,
        "kept": made.kept,
        "lights": null,
        "lights_live": null,
        "gather_residual": null,
        "sources": null,
        "streaks": made.streaks,
        "sky": made.sky,
        "flashes": timeline.data(renderer, frame.camera.position)?,
        "seconds": seconds,
    }))
}

/// Says in JSON, where that was asked for, what was drawn: one frame with its report, or a sheet of several.
fn answer(
    args: &Args,
    picture: &Picture,
    (report, frames): (Option<&FrameReport>, usize),
    (flashes, sky, seconds): (&Value, Option<String>, f64),
) -> anyhow::Result<()> {
    if !args.json {
        return Ok(());
    }
    let count = |of: fn(&FrameReport) -> usize| report.map_or(Value::Null, |report| json!(of(report)));
    json::answer(&json!({
        "command": "render",
        "tool": tool(),
        "asset": args.asset.to_string_lossy(),
        "picture": args.out.to_string_lossy(),
        "size_px": [picture.width, picture.height],
        "frames": frames,
        "lights": count(|report| report.lights),
        "lights_live": count(|report| report.lights_live),
        "gather_residual": report.and_then(|report| report.gather_residual),
        "sources": count(|report| report.sources),
        "streaks": count(|report| report.streaks),
        "kept": 0,
        "sky": sky,
        "flashes": flashes,
        "seconds": seconds,
    }))
}

/// The view to draw: the asset's own or a given one, with what the command line says of it.
fn view_of(args: &Args, camera: Option<&Camera>, renderer: &StormRenderer) -> anyhow::Result<ViewSection> {
    let strokes: Vec<String> = renderer.strokes().iter().map(|record| record.name.clone()).collect();
    let mut view = match (&args.scene, renderer.view()) {
        (Some(path), _) => read_view(path, &strokes)?,
        (None, Some(view)) => view.clone(),
        (None, None) if camera.is_some() => {
            let all = strokes.into_iter().map(|stroke| ViewFlash { stroke, brightness: 1.0 });
            ViewSection { flashes: all.collect(), ..ViewSection::default() }
        }
        (None, None) => {
            let wanted = "a section VIEW, --scene with a view, or --camera";
            return Err(BakeError::input(&args.asset, "view", wanted, "none of them").into());
        }
    };
    args.sky.apply(&mut view.sky);
    if let Some(rate) = args.rate {
        view.rain.rate_mm_per_h = rate;
        check_rate(args, rate, renderer.asset())?;
    }
    if let Some(time) = args.time {
        view.rain.time_s = time;
    }
    if let Some(camera) = camera {
        view.camera.size_px = [camera.width, camera.height];
    }
    if let Some([width, height]) = args.size.as_deref() {
        view.camera.size_px = [*width, *height];
    }
    if !args.flashes.is_empty() {
        let known = std::mem::take(&mut view.flashes);
        let lit = args.flashes.iter().filter(|name| *name != "none");
        view.flashes = lit
            .map(|name| {
                let own = known.iter().find(|flash| flash.stroke == *name);
                own.cloned().unwrap_or(ViewFlash { stroke: name.clone(), brightness: 1.0 })
            })
            .collect();
    }
    Ok(view)
}

/// Refuses a rate beyond the asset's own tables, in words of the option. An asset without tables of rain says so where it is drawn.
fn check_rate(args: &Args, rate: f64, asset: &Asset) -> Result<(), BakeError> {
    if asset.directory().find(DensitySection::TAG).is_none() {
        return Ok(());
    }
    let most = read_density(asset)?.largest_rate().0;
    if rate <= most {
        return Ok(());
    }
    let wanted = format!("0 to {most} mm/h, the range of this asset's rain");
    Err(BakeError::input(&args.asset, "--rate", wanted, rate))
}
