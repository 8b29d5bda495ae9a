//! `squall streaks extract FRAME… -o DIR`

use crate::cli::common::Common;
use crate::cli::folder::{OutputFolder, check_apart};
use crate::cli::json;
use crate::cli::table::{Column, layout, print};
use serde_json::json;
use squall_bake::BakeError;
use squall_bake::input::picture::frame::frame_of;
use squall_bake::input::picture::{Grey, picture_file};
use squall_bake::input::sequence::{Frames, find_frames};
use squall_bake::output::write_atomically;
use squall_bake::progress::Progress;
use squall_bake::provenance::tool;
use squall_bake::streak::extract::{ExtractSettings, Extracted, FEWEST_FRAMES, extract};
use squall_bake::streak::preview::{sheet, write_png8, write_png16};
use std::path::{Path, PathBuf};

/// Luminance of linear Rec. 709 primaries.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// `squall streaks extract`
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// Frames of rain before a scene that stands still, three or more: pictures, folders or patterns with ####. PNG as its colour chunks say, sRGB
    /// without any; OpenEXR.
    #[arg(required = true)]
    frames: Vec<PathBuf>,
    /// The folder for the pictures: streak00.png and so on, 16-bit grey.
    #[arg(short, long)]
    out: PathBuf,
    /// Deviations of the noise that a streak's light exceeds.
    #[arg(long, default_value_t = ExtractSettings::default().threshold, value_parser = positive)]
    threshold: f64,
    /// Shortest streak, px.
    #[arg(long, value_name = "PX", default_value_t = ExtractSettings::default().least_px[0], value_parser = positive)]
    least_length: f64,
    /// Narrowest streak, px: thinner ones show no pattern.
    #[arg(long, value_name = "PX", default_value_t = ExtractSettings::default().least_px[1], value_parser = positive)]
    least_width: f64,
    /// Most streaks; those that show most come first.
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u16).range(1..=1000))]
    most: u16,
    /// Write a PNG with all of them side by side.
    #[arg(long, value_name = "PICTURE")]
    preview: Option<PathBuf>,
    /// Print one JSON object instead of a table.
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

fn positive(text: &str) -> Result<f64, String> {
    let found = text.parse::<f64>().ok().filter(|value| *value > 0.0 && value.is_finite());
    found.ok_or_else(|| "wanted a number above 0".into())
}

/// Runs it.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let mut paths = Vec::new();
    for path in &args.frames {
        match find_frames(path, &["png", "exr"])? {
            Frames::One(one) => paths.push(one.path),
            Frames::Many(many) => paths.extend(many.into_iter().map(|frame| frame.path)),
        }
    }
    if paths.len() < FEWEST_FRAMES {
        let wanted = format!("at least {FEWEST_FRAMES} frames");
        return Err(BakeError::input(&paths[0], "frames", wanted, paths.len()).into());
    }
    let mut folder = OutputFolder::prepare(&args.out)?;
    // How many there will be is not known: none of the names that may be written is one that is read.
    let possible: Vec<String> = (0..usize::from(args.most)).map(name_of).collect();
    let places: Vec<PathBuf> = possible.iter().map(|name| args.out.join(name)).collect();
    let outputs: Vec<&Path> = places.iter().chain(&args.preview).map(PathBuf::as_path).collect();
    super::check_table(&outputs);
    check_apart(&outputs, paths.iter())?;
    folder.expect(possible.iter().map(String::as_str))?;
    let preview = args.preview.as_deref().map(super::preview_file).transpose()?;
    let bars = args.common.start()?;
    bars.begin("frames", paths.len() as u64);
    let frames = read_frames(&paths, &bars)?;
    let settings = ExtractSettings {
        threshold: args.threshold,
        least_px: [args.least_length, args.least_width],
        most: args.most.into(),
        ..ExtractSettings::default()
    };
    let streaks = extract(&frames, &settings)?;
    bars.check()?;
    let names: Vec<String> = (0..streaks.len()).map(name_of).collect();
    folder.write(|folder| {
        for (name, streak) in names.iter().zip(&streaks) {
            let frame = paths[streak.frame].file_name().unwrap_or_default().to_string_lossy();
            let text = format!("cut out of {frame} by squall streaks extract");
            write_atomically(&folder.join(name), |out| write_png16(&streak.picture, &text, None, out))?;
        }
        Ok(())
    })?;
    if let Some(file) = &preview {
        let columns: Vec<Grey> = streaks.iter().map(|streak| streak.picture.clone()).collect();
        let mut bytes = Vec::new();
        write_png8(&sheet(&columns), &mut bytes)?;
        file.write_bytes(&bytes)?;
    }
    bars.finish();
    if args.json {
        let list = names.iter().zip(&streaks).map(|(name, streak)| {
            json!({
                "file": name,
                "frame": paths[streak.frame].to_string_lossy(),
                "centre_px": streak.centre_px,
                "angle_deg": streak.angle_deg,
                "length_px": streak.length_px,
                "width_px": streak.width_px,
                "contrast": streak.contrast,
            })
        });
        let list: Vec<_> = list.collect();
        return json::answer(&json!({
            "command": "streaks extract",
            "tool": tool(),
            "folder": args.out.to_string_lossy(),
            "frames": paths.len(),
            "streaks": list,
        }));
    }
    if streaks.is_empty() {
        bars.warn("no streak was found; a lower --threshold, --least-length or --least-width finds more");
    }
    print_table(&names, &streaks, &paths)
}

/// Name of the picture of streak `at`.
fn name_of(at: usize) -> String {
    format!("streak{at:02}.png")
}

fn print_table(names: &[String], streaks: &[Extracted], paths: &[PathBuf]) -> anyhow::Result<()> {
    let columns = [
        Column::left("picture"),
        Column::right("length px"),
        Column::right("width px"),
        Column::right("angle °"),
        Column::right("contrast"),
        Column::left("frame"),
    ];
    let rows = names.iter().zip(streaks).map(|(name, streak)| {
        vec![
            name.clone(),
            format!("{:.1}", streak.length_px),
            format!("{:.1}", streak.width_px),
            format!("{:.1}", streak.angle_deg),
            format!("{:.0}", streak.contrast),
            paths[streak.frame].display().to_string(),
        ]
    });
    let rows: Vec<Vec<String>> = rows.collect();
    print(&layout(&columns, &rows))
}

/// The frames' luminance.
///
/// Errors: a damaged picture, one of another size than the first, an interruption.
fn read_frames(paths: &[PathBuf], progress: &dyn Progress) -> anyhow::Result<Vec<Grey>> {
    let mut frames: Vec<Grey> = Vec::new();
    for path in paths {
        progress.check()?;
        let picture = frame_of(&picture_file(path)?)?.picture;
        if let Some(first) = frames.first()
            && (first.width, first.height) != (picture.width, picture.height)
        {
            let wanted = format!("{} × {}, as {} has", first.width, first.height, paths[0].display());
            let found = format!("{} × {}", picture.width, picture.height);
            return Err(BakeError::input(path, "picture size", wanted, found).into());
        }
        let grey = |pixel: &[f32; 3]| {
            pixel.iter().zip(LUMINANCE).map(|(value, share)| f64::from(*value) * share).sum::<f64>() as f32
        };
        let pixels = picture.pixels.iter().map(grey).collect();
        frames.push(Grey { width: picture.width, height: picture.height, pixels });
        progress.advance(1);
    }
    Ok(frames)
}
