//! `squall rain COLOUR --depth DEPTH … -o OUT`

use super::common::Common;
use super::{json, number};
use serde_json::{Value, json};
use squall_bake::BakeError;
use squall_bake::frames::manifest::{FrameRecord, Manifest};
use squall_bake::frames::{
    Given, Holes, Job, MOST_EXPOSURE_MS, MOST_GAIN, MOST_WIND_M_PER_S, Report, RightCamera, run as rain_on,
};
use squall_bake::input::depth::DepthForm;
use squall_bake::input::pose::UpAxis;
use squall_bake::output::folder_of;
use squall_bake::provenance::tool;
use std::path::PathBuf;

/// Puts rain over your own frames: colour and depth in; rainy frames, masks and lists of streaks out.
///
/// COLOUR and DEPTH are files, or folders and patterns with #### for a frame's number (OUT is then a folder). manifest.json beside the
/// output says what was done; --manifest makes the same bytes again.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
#[command(group(clap::ArgGroup::new("lens").args(["intrinsics", "vertical_fov", "manifest"]).required(true)))]
pub struct Args {
    /// The frame: PNG (sRGB, gAMA, cICP obeyed) or OpenEXR (scene-linear); or a folder or pattern of frames.
    #[arg(required_unless_present = "manifest")]
    colour: Option<PathBuf>,
    /// Its depth: OpenEXR Z, 16-bit PNG or .npy.
    #[arg(long, required_unless_present = "manifest")]
    depth: Option<PathBuf>,
    /// What depth measures: along the viewing axis, along each pixel's ray, or the disparity of a pair.
    #[arg(long, value_enum, default_value = "planar")]
    depth_kind: DepthArg,
    /// Metres (or pixels of disparity) are value / S for integers (KITTI 256, TUM 5000), value · S for floats.
    #[arg(long, value_name = "S", value_parser = number::positive)]
    depth_scale: Option<f64>,
    /// Distance between the cameras of a pair, m: for disparities and --right.
    #[arg(long, value_name = "B", value_parser = number::positive)]
    baseline: Option<f64>,
    /// Focal lengths and axis of the lens, px, as calibrations give them: 0,0 is the middle of the top left pixel.
    #[arg(long, value_name = "FX,FY,CX,CY", value_parser = intrinsics, allow_hyphen_values = true)]
    intrinsics: Option<[f64; 4]>,
    /// Angle from the picture's top to its bottom, degrees, in place of intrinsics.
    #[arg(long, value_name = "DEG", value_parser = number::from_to(0.06, 179.3, "degrees"))]
    vertical_fov: Option<f64>,
    /// Rainfall intensity, mm/h; with several, each has a folder of its own.
    #[arg(long, value_name = "R[,R…]", value_delimiter = ',', value_parser = number::from_zero, allow_hyphen_values = true, required_unless_present = "manifest")]
    rate: Vec<f64>,
    /// An asset with the tables and patterns to use; a small built-in one if left out.
    #[arg(long)]
    asset: Option<PathBuf>,
    /// Time that the shutter is open, ms.
    #[arg(long, value_name = "T", default_value_t = 20.0, value_parser = number::from_to(1e-3, MOST_EXPOSURE_MS, "ms"))]
    exposure_ms: f64,
    /// Time of the (first) frame, s: moves the rain.
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = number::from_to(-1e9, 1e9, "s"))]
    time: f64,
    /// Frames a second, where neither --times nor poses say when a frame was taken.
    #[arg(long, value_name = "F", default_value_t = 30.0, value_parser = number::positive)]
    fps: f64,
    /// Times of the frames, s: a file with a number a line.
    #[arg(long, value_name = "FILE")]
    times: Option<PathBuf>,
    /// Another seed is another rain.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Wind, m/s: x and y along the ground, z up.
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,0", allow_hyphen_values = true, value_parser = number::list_from_to::<3>(-MOST_WIND_M_PER_S, MOST_WIND_M_PER_S, "m/s"))]
    wind: [f64; 3],
    /// Where the camera stood, a line a frame: TUM's or KITTI's format. Without, it is level and looks along y.
    #[arg(long, value_name = "FILE")]
    pose: Option<PathBuf>,
    /// Which way is up in the file of poses: y, -y, z or -z; as its format has it (TUM z, KITTI -y) if left out.
    #[arg(long, value_name = "AXIS", value_parser = up_axis, allow_hyphen_values = true, requires = "pose")]
    pose_up: Option<UpAxis>,
    /// Light: a panorama in latitude and longitude (EXR), or the manifest.json of another run; estimated once, from the first frame, if
    /// left out.
    #[arg(long, value_name = "EXR")]
    environment: Option<PathBuf>,
    /// Factor on what drops cover; 1 is physical.
    #[arg(long, value_name = "G", default_value_t = 1.0, value_parser = number::from_to(0.0, MOST_GAIN, ""))]
    gain: f64,
    /// Shortest and longest streak that is drawn, px; 30,200 on 1080 rows and the same angle on others if left out.
    #[arg(long, value_name = "MIN,MAX", value_parser = lengths, allow_hyphen_values = true)]
    streak_px: Option<[f64; 2]>,
    /// How far the rain reaches, m: what lies beyond, the sky before all, is dimmed over this way.
    #[arg(long, value_name = "M", default_value_t = 1000.0, value_parser = number::positive)]
    sky_distance: f64,
    /// What to make of pixels without a depth: the nearest depth, nothing, or the sky.
    #[arg(long, value_enum, default_value = "fill")]
    holes: HolesArg,
    /// Frames of a second camera, to the right of the first by the baseline: outputs go to left and right.
    #[arg(long, value_name = "COLOUR", requires_all = ["right_depth", "baseline"])]
    right: Option<PathBuf>,
    /// Depth of those frames.
    #[arg(long, value_name = "DEPTH", requires = "right")]
    right_depth: Option<PathBuf>,
    /// The rainy frame, in the same kind and bit depth unless its name says otherwise; or a folder or pattern.
    #[arg(short, long, required_unless_present = "manifest")]
    out: Option<PathBuf>,
    /// Coverage of the streaks, 0 to 1: 16-bit PNG or EXR.
    #[arg(long, value_name = "F")]
    mask: Option<PathBuf>,
    /// Transmittance of the rain between camera and scene, 0 to 1: 16-bit PNG or EXR.
    #[arg(long, value_name = "F")]
    transmittance: Option<PathBuf>,
    /// Light that this rain scatters in: EXR.
    #[arg(long, value_name = "F")]
    in_scattered: Option<PathBuf>,
    /// The streaks, a line of JSON each.
    #[arg(long, value_name = "F.jsonl")]
    streaks: Option<PathBuf>,
    /// Makes again what this manifest says, from the same inputs; -o and the other outputs may be named anew.
    #[arg(long, value_name = "F", conflicts_with_all = ["colour", "depth", "depth_kind", "depth_scale", "baseline", "intrinsics", "vertical_fov", "rate", "asset", "exposure_ms", "time", "fps", "times", "seed", "wind", "pose", "pose_up", "environment", "gain", "streak_px", "sky_distance", "holes", "right", "right_depth"])]
    manifest: Option<PathBuf>,
    /// Goes on where a run with the same settings stopped: frames that are there, whole, are kept.
    #[arg(long)]
    resume: bool,
    /// Ends at the first frame that fails.
    #[arg(long)]
    strict: bool,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: Common,
}

/// `--depth-kind`
#[derive(Clone, Copy, clap::ValueEnum)]
enum DepthArg {
    /// Along the viewing axis.
    Planar,
    /// Along each pixel's own ray.
    Ray,
    /// Pixels between the pictures of a pair.
    Disparity,
}

/// `--holes`
#[derive(Clone, Copy, clap::ValueEnum)]
enum HolesArg {
    /// The depth of the nearest pixel that has one.
    Fill,
    /// The medium leaves them as they are.
    Leave,
    /// As far as the sky.
    Sky,
}

fn intrinsics(text: &str) -> Result<[f64; 4], String> {
    let found = number::list::<4>(text).ok().filter(|[fx, fy, ..]| *fx > 0.0 && *fy > 0.0);
    found.ok_or_else(|| "wanted FX,FY,CX,CY, finite, FX and FY above 0".into())
}

fn lengths(text: &str) -> Result<[f64; 2], String> {
    let found = number::list::<2>(text).ok().filter(|[low, high]| *low >= 1.0 && high > low);
    found.ok_or_else(|| "wanted MIN,MAX of 1 px or more, the longest above the shortest".into())
}

fn up_axis(text: &str) -> Result<UpAxis, String> {
    UpAxis::from_name(text).ok_or_else(|| "wanted y, -y, z or -z".into())
}

impl Args {
    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        self.json
    }

    /// Ends the command (exit code 2) where an option would have no effect.
    fn check_usage(&self) {
        let pair = self.right.is_some() || matches!(self.depth_kind, DepthArg::Disparity);
        if self.baseline.is_some() && !pair {
            json::usage(
                "--baseline is the distance of a pair: it goes with --depth-kind disparity or --right",
            );
        }
    }

    /// The job of the command line, and what it takes up.
    fn job(&self) -> anyhow::Result<(Job, Given)> {
        let mut given = Given { resume: self.resume, strict: self.strict, again: None };
        if let Some(path) = &self.manifest {
            let manifest = Manifest::read(path)?;
            let mut job = manifest.settings.brought_from(folder_of(path));
            if let Some(out) = &self.out {
                job.out.clone_from(out);
                (job.mask, job.transmittance, job.in_scattered, job.streaks) = (None, None, None, None);
            }
            let named = [
                (&mut job.mask, &self.mask),
                (&mut job.transmittance, &self.transmittance),
                (&mut job.in_scattered, &self.in_scattered),
                (&mut job.streaks, &self.streaks),
            ];
            named.into_iter().filter(|(_, new)| new.is_some()).for_each(|(old, new)| old.clone_from(new));
            given.again = Some(manifest);
            return Ok((job, given));
        }
        let right = self.right.as_ref().zip(self.right_depth.as_ref());
        let job = Job {
            colour: self.colour.clone().unwrap_or_default(),
            depth: self.depth.clone().unwrap_or_default(),
            depth_kind: match self.depth_kind {
                DepthArg::Planar => DepthForm::Planar,
                DepthArg::Ray => DepthForm::Ray,
                DepthArg::Disparity => DepthForm::Disparity,
            },
            depth_scale: self.depth_scale,
            baseline_m: self.baseline,
            intrinsics_px: self.intrinsics,
            vertical_fov_deg: self.vertical_fov,
            rates_mm_per_h: self.rate.clone(),
            asset: self.asset.clone(),
            exposure_ms: self.exposure_ms,
            time_s: self.time,
            fps: self.fps,
            times: self.times.clone(),
            seed: self.seed,
            wind_m_per_s: self.wind,
            pose: self.pose.clone(),
            pose_up: self.pose_up.unwrap_or_default(),
            environment: self.environment.clone(),
            gain: self.gain,
            streak_px: self.streak_px,
            sky_distance_m: self.sky_distance,
            holes: match self.holes {
                HolesArg::Fill => Holes::Fill,
                HolesArg::Leave => Holes::Leave,
                HolesArg::Sky => Holes::Sky,
            },
            right: right.map(|(colour, depth)| RightCamera { colour: colour.clone(), depth: depth.clone() }),
            out: self.out.clone().unwrap_or_default(),
            mask: self.mask.clone(),
            transmittance: self.transmittance.clone(),
            in_scattered: self.in_scattered.clone(),
            streaks: self.streaks.clone(),
        };
        Ok((job, given))
    }
}

pub fn run(args: Args) -> anyhow::Result<()> {
    args.check_usage();
    let start = std::time::Instant::now();
    let (job, given) = args.job()?;
    let bars = args.common.start()?;
    let tool_now = tool();
    if let Some(again) = given.again.as_ref().filter(|again| again.tool != tool_now) {
        bars.warn(&format!("the manifest is of {}, this is {tool_now}: bytes may differ", again.tool));
    }
    let report = rain_on(&job, &given, &bars)?;
    for note in &report.notes {
        bars.say(&format!("note: {note}"));
    }
    for (record, error) in report.failed() {
        bars.warn(&format!("{}: {error}", record.frame));
    }
    let seconds = start.elapsed().as_secs_f64();
    bars.say(&words(&job, &report, seconds));
    if args.json {
        json::answer(&answer(&job, &report, seconds))?;
    }
    let failed: Vec<&str> = report.failed().map(|(_, error)| error).collect();
    match failed.first() {
        Some(first) => {
            let (failed, of, first) = (failed.len(), report.records.len(), (*first).to_owned());
            Err(BakeError::Frames { failed, of, first }.into())
        }
        None => Ok(()),
    }
}

/// Sum of a count over all frames that were made.
fn sum(report: &Report, of: impl Fn(&FrameRecord) -> usize) -> usize {
    report.records.iter().map(of).sum()
}

fn words(job: &Job, report: &Report, seconds: f64) -> String {
    let made = report.records.len() - report.failed().count();
    let streaks = sum(report, |record| record.counts.map_or(0, |counts| counts.streaks));
    let inside = sum(report, |record| record.counts.map_or(0, |counts| counts.inside));
    let holes = sum(report, |record| record.counts.map_or(0, |counts| counts.holes));
    let frames = if made == 1 { "frame" } else { "frames" };
    let kept = if report.kept > 0 { format!(" ({} kept)", report.kept) } else { String::new() };
    let rates: Vec<String> = job.rates_mm_per_h.iter().map(|rate| format!("rate-{rate}")).collect();
    // Several rates have a folder each, between the output's folder and its name.
    let folders = if rates.len() > 1 { format!(" in {}", rates.join(", ")) } else { String::new() };
    let streaks = format!("{streaks} streaks drawn, {inside} with their drop inside the frame");
    let out = job.out.display();
    format!(
        "{out}{folders}: {made} {frames}{kept}, {streaks}, {holes} pixels without a depth, {seconds:.2} s"
    )
}

fn answer(job: &Job, report: &Report, seconds: f64) -> Value {
    let errors = report.failed().map(|(record, error)| {
        json!({
            "frame": record.frame,
            "rate_mm_per_h": record.rate_mm_per_h,
            "camera": record.camera,
            "error": error,
        })
    });
    let errors: Vec<Value> = errors.collect();
    json!({
        "command": "rain",
        "tool": tool(),
        "out": job.out.to_string_lossy(),
        "manifest": report.manifest.to_string_lossy(),
        "frames": report.records.len() - errors.len(),
        "kept": report.kept,
        "failed": errors.len(),
        "errors": errors,
        "rates_mm_per_h": job.rates_mm_per_h,
        "streaks": sum(report, |record| record.counts.map_or(0, |counts| counts.streaks)),
        "inside": sum(report, |record| record.counts.map_or(0, |counts| counts.inside)),
        "holes": sum(report, |record| record.counts.map_or(0, |counts| counts.holes)),
        "light": report.light,
        "notes": report.notes,
        "seconds": seconds,
    })
}
