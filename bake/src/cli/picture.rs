//! Pictures on their way to files.

use squall_bake::BakeError;
use squall_bake::picture::{write_exr, write_png8};
use squall_runtime::picture::Picture;
use squall_runtime::renderer::FrameReport;
use squall_runtime::tone::Tone;
use std::path::Path;

/// Refuses a name that no picture can have, before the work.
pub fn check_name(path: &Path) -> Result<(), BakeError> {
    match path.extension().and_then(|name| name.to_str()) {
        Some("png" | "exr") => Ok(()),
        _ => {
            let found = path.display().to_string();
            Err(BakeError::input(path, "picture", "a name that ends in .png or .exr", found))
        }
    }
}

/// Writes a picture in the form that its name asks for: .png or .exr.
pub fn write(path: &Path, picture: &Picture, tone: &Tone) -> anyhow::Result<()> {
    match path.extension().and_then(|name| name.to_str()) {
        Some("png") => write_png8(path, picture, tone)?,
        Some("exr") => write_exr(path, picture)?,
        _ => check_name(path)?,
    }
    Ok(())
}

/// Says what was drawn.
pub fn say(path: &Path, picture: &Picture, report: &FrameReport, seconds: f64) -> anyhow::Result<()> {
    let [width, height] = [picture.width, picture.height];
    let FrameReport { lights, sources, streaks, lights_live, .. } = *report;
    let mut light = format!("{lights} points of lightning on {sources} baked sources");
    if lights_live > 0 {
        light += &format!(" ({lights_live} solved for on the spot)");
    }
    say!("{}: {width} × {height}, {light}, {streaks} streaks, {seconds:.2} s", path.display());
    Ok(())
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

    /// Writes the sheet. Errors: as for [`write`].
    pub fn write(&self, path: &Path, tone: &Tone) -> anyhow::Result<()> {
        write(path, &self.whole, tone)
    }
}
