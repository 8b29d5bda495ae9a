//! `squall render ASSET --frames A..B --fps F -o NAME.####.png`: one process, one opened asset, frame after frame.

use super::backend::Backend;
use super::flashes::Timeline;
use super::layers;
use crate::cli::picture::sky_words;
use crate::cli::progress::Bars;
use squall_bake::BakeError;
use squall_bake::input::picture::{is_exr, picture_file, rgb_of};
use squall_bake::input::sequence::Pattern;
use squall_bake::output::{Output, Place, folder_of, pending, sweep, write_atomically};
use squall_bake::picture::{encode_exr, encode_png8};
use squall_bake::progress::Progress;
use squall_formats::units::Seconds;
use squall_runtime::renderer::{FrameReport, Layer};
use squall_runtime::tone::Tone;
use squall_runtime::{Frame, StormRenderer};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Most frames of one call.
const MOST_FRAMES: u64 = 1 << 20;

/// `A..B`
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// First frame.
    pub first: u64,
    /// The frame after the last.
    pub end: u64,
}

/// Reads A..B. Errors: no range, none or more than 2²⁰ frames in it.
pub fn range(text: &str) -> Result<Range, String> {
    let wanted = || "wanted A..B, two whole numbers, the second larger: frames A to B − 1".to_owned();
    let (first, end) = text.split_once("..").ok_or_else(wanted)?;
    let number = |word: &str| word.trim().parse::<u64>().map_err(|_| wanted());
    let (first, end) = (number(first)?, number(end)?);
    match end.checked_sub(first) {
        Some(1..=MOST_FRAMES) => Ok(Range { first, end }),
        Some(count) if count > MOST_FRAMES => Err(format!("wanted at most {MOST_FRAMES} frames")),
        _ => Err(wanted()),
    }
}

/// What a sequence is and where it goes.
pub struct Sequence<'a> {
    /// Which frames.
    pub range: Range,
    /// Frames a second.
    pub fps: f64,
    /// One animated PNG in place of a file a frame.
    pub animated: bool,
    /// Keep frames that are there, whole.
    pub resume: bool,
    /// A pattern, or the animated picture.
    pub out: &'a Path,
    /// Layers of every frame; none for the picture alone.
    pub layers: &'a [Layer],
}

/// What became of it.
pub struct Made {
    /// Frames that were there already.
    pub kept: u64,
    /// Streaks in the frames that were drawn.
    pub streaks: usize,
    /// What is worth knowing of the sky's light on the cloud, as the first frame that says so has it.
    pub sky: Option<String>,
}

impl Made {
    /// Counts a frame that was drawn; what it says of the sky is told once.
    fn drew(&mut self, report: &FrameReport, bars: &Bars) {
        self.streaks += report.streaks;
        if self.sky.is_none() {
            self.sky = sky_words(report);
            self.sky.iter().for_each(|words| bars.warn(words));
        }
    }
}

/// Form of a frame's file.
#[derive(Clone, Copy, PartialEq)]
enum Form {
    Png,
    Exr,
}

impl Sequence<'_> {
    /// Draws every frame of `still`, with the flashes of `timeline`, and writes each as soon as it is drawn.
    ///
    /// Errors: a name without ####, or one that is neither .png nor .exr; as [`StormRenderer::render`]; the system's refusals; an interruption.
    pub fn run(
        &self,
        (renderer, backend): (&mut StormRenderer, &mut Backend),
        still: &Frame,
        (timeline, tone): (&Timeline, &Tone),
        bars: &Bars,
    ) -> anyhow::Result<Made> {
        let count = self.range.end - self.range.first;
        let start = still.weather.time.0;
        let at = |number: u64| {
            let time = number as f64 / self.fps;
            let opens = Seconds(time - 0.5 * still.exposure.0);
            let frame = still.clone().time(Seconds(start + time)).dark();
            timeline.seen(opens, still.exposure).into_iter().fold(frame, Frame::flash)
        };
        let mut made = Made { kept: 0, streaks: 0, sky: None };
        if self.animated {
            let delay = self.check_animated()?;
            let output = Output::prepare(self.out)?;
            bars.begin("frames", count);
            let size = [still.camera.width, still.camera.height];
            let mut frames = Vec::new();
            for number in self.range.first..self.range.end {
                bars.check()?;
                backend.render(renderer, &at(number))?;
                made.drew(&renderer.report(), bars);
                frames.push(tone.to_srgb8(renderer.picture()));
                bars.advance(1);
            }
            let bytes = encode_animation(size, &frames, delay)?;
            output.write(|out| out.write_all(&bytes))?;
            return Ok(made);
        }
        let places = self.places()?;
        bars.begin("frames", count);
        for (done, (number, (path, form))) in (self.range.first..self.range.end).zip(places).enumerate() {
            bars.check()?;
            let frame = at(number);
            if self.resume && is_whole(&path, [frame.camera.width, frame.camera.height], self.layers) {
                made.kept += 1;
                bars.advance(1);
                continue;
            }
            backend.render(renderer, &frame)?;
            made.drew(&renderer.report(), bars);
            let bytes = match form {
                Form::Png => encode_png8(renderer.picture(), tone)?,
                Form::Exr if self.layers.is_empty() => encode_exr(renderer.picture())?,
                Form::Exr => layers::encode(renderer, &frame, self.layers)?,
            };
            write_atomically(&path, |out| out.write_all(&bytes))?;
            pending::note_written();
            pending::set_note(Some(format!("{} of {count} frames are there; --resume goes on", done + 1)));
            bars.advance(1);
        }
        pending::set_note(None);
        Ok(made)
    }

    /// How long a frame of an animated picture stands. Errors: a name that is not one PNG's; a rate that the format has no time for.
    fn check_animated(&self) -> Result<(u16, u16), BakeError> {
        let bad = |wanted: &str| BakeError::input(self.out, "output", wanted, self.out.display());
        if Pattern::of(self.out)?.is_some() {
            return Err(bad("a name without #, as every frame goes into one animated picture"));
        }
        let end = self.out.extension().and_then(|end| end.to_str());
        if matches!(Place::of(self.out)?, Place::File(_)) && !matches!(end, Some("png" | "apng")) {
            return Err(bad("a name that ends in .png or .apng for an animated picture"));
        }
        delay(self.fps).ok_or_else(|| BakeError::Setting {
            field: "--fps",
            wanted: "1/65535 to 60000 frames a second, which an animated PNG can hold".into(),
            found: self.fps.to_string(),
        })
    }

    /// Every frame's file; the folder is tried.
    fn places(&self) -> Result<Vec<(PathBuf, Form)>, BakeError> {
        let bad = |wanted: &str| BakeError::input(self.out, "output", wanted, self.out.display());
        let pattern =
            Pattern::of(self.out)?.ok_or_else(|| bad("a name with #### for the frames' numbers"))?;
        let form = match self.out.extension().and_then(|end| end.to_str()) {
            Some("png") => Form::Png,
            Some("exr") => Form::Exr,
            _ => return Err(bad("a name that ends in .png or .exr")),
        };
        if form == Form::Png && !self.layers.is_empty() {
            return Err(bad("a name that ends in .exr, which holds layers"));
        }
        let folder = folder_of(self.out);
        sweep(folder);
        tempfile::tempfile_in(folder).map_err(BakeError::io(folder, "write into the folder"))?;
        let mut places = Vec::new();
        for number in self.range.first..self.range.end {
            let path = folder.join(pattern.name(number));
            if !matches!(Place::of(&path)?, Place::File(_)) {
                return Err(BakeError::input(&path, "output", "a file", "a device or pipe"));
            }
            places.push((path, form));
        }
        Ok(places)
    }
}

/// Whether a file holds a whole picture of this size, with these layers.
fn is_whole(path: &Path, [width, height]: [u32; 2], layers: &[Layer]) -> bool {
    let Ok(input) = picture_file(path) else { return false };
    // Files of layers have no layer without a name where beauty was not asked for: their sizes are in their heads.
    if is_exr(&input) {
        use squall_bake::input::picture::exr_channel;
        let whole =
            exr_channel(&input, |names| names.first().filter(|_| layers::are_among(layers, names)).cloned());
        return whole.is_ok_and(|(w, h, _)| (w, h) == (width as usize, height as usize));
    }
    rgb_of(&input, None)
        .is_ok_and(|taken| (taken.picture.width, taken.picture.height) == (width as usize, height as usize))
}

/// How long a frame of an animated PNG stands, s, as two numbers of 16 bits; `None` where they hold no such time.
fn delay(fps: f64) -> Option<(u16, u16)> {
    // 1/60000 s holds the times of 24, 25, 30, 50 and 60 a second and their thousand-and-oneths; longer times need longer steps.
    let steps = (f64::from(u16::MAX) * fps).floor().min(60_000.0);
    let count = (steps / fps).round();
    (steps >= 1.0 && fps <= 60_000.0).then_some((count as u16, steps as u16))
}

/// An animated PNG that plays for ever.
fn encode_animation(
    [width, height]: [u32; 2],
    frames: &[Vec<[u8; 3]>],
    (numerator, denominator): (u16, u16),
) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_compression(png::Compression::High);
    encoder.set_animated(frames.len() as u32, 0).map_err(std::io::Error::other)?;
    encoder.set_frame_delay(numerator, denominator).map_err(std::io::Error::other)?;
    let mut writer = encoder.write_header().map_err(std::io::Error::other)?;
    for frame in frames {
        writer.write_image_data(frame.as_flattened()).map_err(std::io::Error::other)?;
    }
    writer.finish().map_err(std::io::Error::other)?;
    Ok(bytes)
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

    #[test]
    fn a_range_is_two_numbers_with_frames_between_them() {
        assert_eq!(range("0..24"), Ok(Range { first: 0, end: 24 }));
        assert_eq!(range("100..101"), Ok(Range { first: 100, end: 101 }));
        for wrong in ["", "5", "5..5", "6..5", "a..b", "-1..5", "0..99999999", "0..=5"] {
            assert!(range(wrong).is_err(), "{wrong}");
        }
    }
}
