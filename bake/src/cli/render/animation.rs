//! All frames of a sequence in one animated PNG.

use super::backend::Backend;
use super::sequence::{Made, Sequence};
use crate::cli::progress::Bars;
use squall_bake::BakeError;
use squall_bake::input::sequence::Pattern;
use squall_bake::output::{Output, Place, folder_of};
use squall_bake::progress::Progress;
use squall_runtime::tone::Tone;
use squall_runtime::{Frame, StormRenderer};
use std::fs::File;
use std::io::{BufWriter, Seek};
use std::path::Path;

impl Sequence<'_> {
    /// Draws all frames into one animated PNG, each encoded as it comes: memory does not grow with their number.
    pub(super) fn animate(
        &self,
        (renderer, backend): (&mut StormRenderer, &mut Backend),
        still: &Frame,
        at: impl Fn(u64) -> Frame,
        tone: &Tone,
        bars: &Bars,
    ) -> anyhow::Result<Made> {
        let delay = self.check_animated()?;
        let output = Output::prepare(self.out)?;
        let count = self.range.end - self.range.first;
        bars.begin("frames", count);
        let mut made = Made::default();
        let scratch = scratch_for(self.out)?;
        let size = [still.camera.width, still.camera.height];
        let animation = Animation::begin(&scratch, size, count as u32, delay);
        let mut animation = animation.map_err(BakeError::io(self.out, "write"))?;
        for number in self.range.first..self.range.end {
            bars.check()?;
            backend.render(renderer, &at(number))?;
            made.drew(&renderer.report(), bars);
            animation.add(&tone.to_srgb8(renderer.picture())).map_err(BakeError::io(self.out, "write"))?;
            bars.advance(1);
        }
        animation.end().map_err(BakeError::io(self.out, "write"))?;
        output.write(|out| {
            let mut whole = &scratch;
            whole.rewind()?;
            std::io::copy(&mut whole, out).map(|_| ())
        })?;
        Ok(made)
    }

    /// How long a frame of an animated picture stands. Errors: a name that is not one PNG's; a rate that the format has no time for.
    fn check_animated(&self) -> Result<(u16, u16), BakeError> {
        delay_of(self.out, self.fps)
    }
}

/// How long a frame of an animated picture stands, as two numbers of 16 bits. Errors: a name that is not one PNG's; a rate that the format has no time for.
pub(in crate::cli) fn delay_of(out: &Path, fps: f64) -> Result<(u16, u16), BakeError> {
    let bad = |wanted: &str| BakeError::input(out, "output", wanted, out.display());
    if Pattern::of(out)?.is_some() {
        return Err(bad("a name without #, as every frame goes into one animated picture"));
    }
    let end = out.extension().and_then(|end| end.to_str());
    if matches!(Place::of(out)?, Place::File(_)) && !matches!(end, Some("png" | "apng")) {
        return Err(bad("a name that ends in .png or .apng for an animated picture"));
    }
    delay(fps).ok_or_else(|| BakeError::Setting {
        field: "--fps",
        wanted: "1/65535 to 60000 frames a second, which an animated PNG can hold".into(),
        found: fps.to_string(),
    })
}

/// Where an animated picture for `out` is put together. Errors: the system's refusal.
pub(in crate::cli) fn scratch_for(out: &Path) -> Result<File, BakeError> {
    // A name in its folder would be swept by nobody: the file has none.
    let scratch = match Place::of(out)? {
        Place::File(file) => tempfile::tempfile_in(folder_of(&file)),
        Place::Stdout | Place::Stream(_) => tempfile::tempfile(),
    };
    scratch.map_err(BakeError::io(out, "write"))
}

/// How long a frame of an animated PNG stands, s, as two numbers of 16 bits; `None` where they hold no such time.
fn delay(fps: f64) -> Option<(u16, u16)> {
    // 1/60000 s holds the times of 24, 25, 30, 50 and 60 a second and their thousand-and-oneths; longer times need longer steps.
    let steps = (f64::from(u16::MAX) * fps).floor().min(60_000.0);
    let count = (steps / fps).round();
    (steps >= 1.0 && fps <= 60_000.0).then_some((count as u16, steps as u16))
}

/// An animated PNG that plays for ever, in the making.
pub(in crate::cli) struct Animation(png::Writer<BufWriter<File>>);

impl Animation {
    pub(in crate::cli) fn begin(
        file: &File,
        [width, height]: [u32; 2],
        frames: u32,
        (numerator, denominator): (u16, u16),
    ) -> std::io::Result<Self> {
        let mut encoder = png::Encoder::new(BufWriter::new(file.try_clone()?), width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_compression(png::Compression::High);
        encoder.set_animated(frames, 0).map_err(std::io::Error::other)?;
        encoder.set_frame_delay(numerator, denominator).map_err(std::io::Error::other)?;
        Ok(Self(encoder.write_header().map_err(std::io::Error::other)?))
    }

    pub(in crate::cli) fn add(&mut self, frame: &[[u8; 3]]) -> std::io::Result<()> {
        self.0.write_image_data(frame.as_flattened()).map_err(std::io::Error::other)
    }

    pub(in crate::cli) fn end(self) -> std::io::Result<()> {
        self.0.finish().map_err(std::io::Error::other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_an_animated_picture_stand_as_long_as_they_last() {
        /// Half a step of the coarsest count, which is the 65535th part of a delay, or of one at 60 a second, the 1000th.
        const HALF_STEP: f64 = 5e-4;
        assert_eq!((delay(24.0), delay(30.0 / 1.001)), (Some((2500, 60_000)), Some((2002, 60_000))));
        for fps in [60.0, 25.0, 1.0, 0.916, 0.9, 0.5, 1.0 / 3.0, 0.1, 1e-3, 1.0 / 65_000.0] {
            let (count, steps) = delay(fps).unwrap();
            let found = f64::from(count) / f64::from(steps);
            assert!((found * fps - 1.0).abs() < HALF_STEP, "{fps}: {count}/{steps}");
        }
        assert_eq!((delay(1e-5), delay(1e5)), (None, None));
    }
}
