//! `squall streaks fit PICTURE… [--method M] [--cosines N] [--json] [--preview PICTURE]` and `squall streaks extract FRAME… -o DIR`

mod extract;

use super::common::Common;
use super::folder::check_apart;
use super::json;
use super::picture::{Format, PictureFile};
use squall_bake::BakeError;
use squall_bake::input::picture::{grey_of, picture_file};
use squall_bake::output::Place;
use squall_bake::progress::Progress;
use squall_bake::streak::{self, FitSettings, Method, Source, preview};
use std::path::{Path, PathBuf};

/// What `squall streaks` can do.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Fits pictures of streaks, each as a pattern of an asset, and reports how close each comes.
    Fit(Fit),
    /// Cuts streaks out of footage of rain, as pictures that `[rain.streaks] pictures` and `streaks fit` read.
    Extract(extract::Args),
}

/// `squall streaks fit`
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Fit {
    /// Pictures, PNG or OpenEXR. Samples become light as a PNG's colour chunks say; without any they are light.
    #[arg(required = true)]
    pictures: Vec<PathBuf>,
    /// Layer of OpenEXR pictures, where several would do: a part's name, or what stands before R, G and B.
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// How to fit.
    #[arg(long, default_value = "edges", value_parser = method)]
    method: Method,
    /// Oscillating terms per pattern; the constant and the window come on top.
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u8).range(0..=64))]
    cosines: u8,
    /// Print one JSON list instead of a table.
    #[arg(long)]
    json: bool,
    /// Write a PNG with source, fit and difference of every picture side by side.
    #[arg(long, value_name = "PICTURE")]
    preview: Option<PathBuf>,
    #[command(flatten)]
    common: Common,
}

impl Command {
    /// Its name in words.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Fit(_) => "streaks fit",
            Self::Extract(_) => "streaks extract",
        }
    }

    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        match self {
            Self::Fit(args) => args.json,
            Self::Extract(args) => args.json(),
        }
    }
}

fn method(name: &str) -> Result<Method, String> {
    let known = || Method::ALL.map(Method::name).join(", ");
    Method::from_name(name).ok_or_else(|| format!("wanted one of {}", known()))
}

/// Runs the chosen subcommand.
pub fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Fit(args) => fit(&args),
        Command::Extract(args) => extract::run(&args),
    }
}

/// Where a sheet of streaks goes, tried before the work. Errors: a name that is no PNG's; as [`PictureFile::prepare`].
fn preview_file(path: &Path) -> Result<PictureFile, BakeError> {
    PictureFile::prepare(path, Some(Format::Png)).map_err(|error| match error {
        BakeError::Input { file, found, .. } if path.extension().is_some_and(|end| end == "exr") => {
            BakeError::input(&file, "--preview", "a name that ends in .png", found)
        }
        other => other,
    })
}

/// Standard output has the table, or the object in its place, and takes no sheet beside it.
fn check_table(outputs: &[&Path]) {
    if outputs.iter().any(|path| matches!(Place::of(path), Ok(Place::Stdout))) {
        json::usage("standard output has the table of streaks: --preview takes a file");
    }
}

fn fit(args: &Fit) -> anyhow::Result<()> {
    let outputs: Vec<&Path> = args.preview.iter().map(PathBuf::as_path).collect();
    check_table(&outputs);
    check_apart(&outputs, args.pictures.iter())?;
    let preview = args.preview.as_deref().map(preview_file).transpose()?;
    let bars = args.common.start()?;
    let mut pictures = Vec::new();
    for path in &args.pictures {
        bars.check()?;
        let one = grey_of(&picture_file(path)?, args.layer.as_deref())?;
        if one.assumed {
            bars.say(&format!("note: {}: taken as {}", path.display(), one.how));
        }
        pictures.push(one.picture);
    }
    let sources: Vec<Source> = args
        .pictures
        .iter()
        .zip(&pictures)
        .map(|(file, picture)| Source { file, picture, notes: None })
        .collect();
    let settings = FitSettings { method: args.method, cosines: args.cosines.into() };
    let patterns = streak::fit_all(&sources, settings)?;
    bars.check()?;
    if let Some(file) = &preview {
        let sheet = preview::contact_sheet(&pictures, &patterns);
        let mut bytes = Vec::new();
        preview::write_png8(&sheet, &mut bytes)?;
        file.write_bytes(&bytes)?;
    }
    let lines = sources.iter().zip(&patterns);
    if args.json {
        let rows: Vec<serde_json::Value> = lines
            .map(|(source, pattern)| {
                serde_json::json!({
                    "file": source.file.to_string_lossy(),
                    "method": pattern.method.name(),
                    "terms": pattern.pattern.terms(),
                    "psnr_db": pattern.psnr_db,
                    "ssim": pattern.ssim,
                    "bytes": pattern.stored_bytes(),
                })
            })
            .collect();
        say!("{}", serde_json::to_string_pretty(&rows)?);
        return Ok(());
    }
    say!("{:>9}  {:>5}  {:>7}  {:>6}  {:>5}  picture", "method", "terms", "PSNR dB", "SSIM", "bytes");
    for (source, pattern) in lines {
        say!(
            "{:>9}  {:>5}  {:>7.2}  {:>6.3}  {:>5}  {}",
            pattern.method.name(),
            pattern.pattern.terms(),
            pattern.psnr_db,
            pattern.ssim,
            pattern.stored_bytes(),
            source.file.display()
        );
    }
    Ok(())
}
