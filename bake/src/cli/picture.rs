//! Pictures on their way to files.

use squall_bake::BakeError;
use squall_bake::output::{Output, Place};
use squall_bake::picture::{encode_exr, encode_png8};
use squall_runtime::clouds::SunSource;
use squall_runtime::picture::Picture;
use squall_runtime::renderer::FrameReport;
use squall_runtime::tone::Tone;
use std::io::Write;
use std::path::Path;

/// Form of a picture's file.
#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
pub enum Format {
    /// Developed for a display, 8 bits.
    Png,
    /// Linear radiance, 32-bit floats.
    Exr,
}

/// Where a picture goes and in what form, found and tried before the work.
pub struct PictureFile {
    output: Output,
    format: Format,
}

impl PictureFile {
    /// The form is that of the name's end, .png or .exr. Standard output, devices and pipes have no such names: PNG, or as given.
    ///
    /// Errors: a name that no picture can have, or one of the other form (exit code 3); as [`Output::prepare`].
    pub fn prepare(path: &Path, given: Option<Format>) -> Result<Self, BakeError> {
        let named = match path.extension().and_then(|name| name.to_str()) {
            Some("png") => Some(Format::Png),
            Some("exr") => Some(Format::Exr),
            _ => None,
        };
        let format = match (named, given) {
            (Some(named), Some(given)) if named != given => {
                let wanted = "a name that ends as --format says";
                return Err(BakeError::input(path, "picture", wanted, path.display()));
            }
            (Some(format), _) => format,
            (None, given) => match Place::of(path)? {
                Place::File(_) => {
                    let wanted = "a name that ends in .png or .exr";
                    return Err(BakeError::input(path, "picture", wanted, path.display()));
                }
                Place::Stdout | Place::Stream(_) => given.unwrap_or(Format::Png),
            },
        };
        Ok(Self { output: Output::prepare(path)?, format })
    }

    /// What it is called in words.
    pub fn name(&self) -> String {
        self.output.name()
    }

    /// Writes the picture; `tone` develops a PNG. Errors: as [`Output::write`].
    pub fn write(&self, picture: &Picture, tone: &Tone) -> anyhow::Result<()> {
        let bytes = match self.format {
            Format::Png => encode_png8(picture, tone)?,
            Format::Exr => encode_exr(picture)?,
        };
        self.write_bytes(&bytes)
    }

    /// Form of its file.
    pub fn format(&self) -> Format {
        self.format
    }

    /// Writes a file that was encoded elsewhere. Errors: as [`Output::write`].
    pub fn write_bytes(&self, bytes: &[u8]) -> anyhow::Result<()> {
        Ok(self.output.write(|out| out.write_all(bytes))?)
    }

    /// What was drawn, in words.
    pub fn words(&self, picture: &Picture, report: &FrameReport, seconds: f64) -> String {
        let [width, height] = [picture.width, picture.height];
        let FrameReport { lights, sources, streaks, lights_live, .. } = *report;
        let mut light = format!("{lights} points of lightning on {sources} baked sources");
        if lights_live > 0 {
            light += &format!(" ({lights_live} solved for on the spot)");
        }
        if let Some(residual) = report.gather_residual {
            light += &format!(", gathered to a residual of {:.2} %", 100.0 * residual);
        }
        let sky = sky_words(report).map_or_else(String::new, |words| format!(", {words}"));
        format!("{}: {width} × {height}, {light}{sky}, {streaks} streaks, {seconds:.2} s", self.name())
    }
}

/// What is worth knowing of the sky's light on the cloud; nothing where it is all there, from the asset.
pub fn sky_words(report: &FrameReport) -> Option<String> {
    let sun = match report.sun {
        SunSource::Live => Some("sun solved for on the spot: no baked beam covers it".to_owned()),
        SunSource::Elsewhere(degrees) => {
            Some(format!("cloud lit by the asset's one sun, {degrees:.0}° from the sky's"))
        }
        SunSource::Missing => Some("cloud not lit by the sun: the asset holds none".to_owned()),
        _ => None,
    };
    let sky =
        report.sky_missing.then(|| "cloud not lit by the sky: the asset holds none of its light".to_owned());
    let words: Vec<String> = sun.into_iter().chain(sky).collect();
    (!words.is_empty()).then(|| words.join(", "))
}

/// Several pictures of one size in one, each half as large again as nothing is between them.
pub struct Sheet {
    whole: Picture,
    tile: [usize; 2],
}

/// A tile is its picture shrunk by this.
const SHRINK: usize = 2;

impl Sheet {
    /// An empty sheet. Errors: more pixels than a picture may have.
    pub fn new(columns: usize, rows: usize, size_px: [u32; 2]) -> anyhow::Result<Self> {
        let tile = size_px.map(|count| (count as usize / SHRINK).max(1));
        Ok(Self { whole: Picture::new(columns * tile[0], rows * tile[1])?, tile })
    }

    /// Puts a picture in its place, every two by two of its pixels averaged.
    pub fn place(&mut self, column: usize, row: usize, picture: &Picture) {
        for y in 0..self.tile[1] {
            for x in 0..self.tile[0] {
                let mut sum = [0.0f32; 3];
                for (i, j) in (0..SHRINK).flat_map(|i| (0..SHRINK).map(move |j| (i, j))) {
                    let from = [x * SHRINK + i, y * SHRINK + j];
                    let pixel = picture.row(from[1].min(picture.height - 1))[from[0].min(picture.width - 1)];
                    for band in 0..3 {
                        sum[band] += pixel[band] / (SHRINK * SHRINK) as f32;
                    }
                }
                let at = (row * self.tile[1] + y) * self.whole.width + column * self.tile[0] + x;
                self.whole.pixels[at] = sum;
            }
        }
    }

    /// The whole sheet.
    pub fn picture(&self) -> &Picture {
        &self.whole
    }
}
