//! `squall render ASSET --frames A..B --fps F -o NAME.####.png`: one process, one opened asset, frame after frame.

use super::backend::Backend;
use super::flashes::Timeline;
use super::layers;
use super::mark::{Mark, Marks};
use crate::cli::folder::OutputFolder;
use crate::cli::picture::sky_words;
use crate::cli::progress::Bars;
use squall_bake::BakeError;
use squall_bake::input::Input;
use squall_bake::input::picture::{exr_channel, is_exr, picture_file, rgb_of};
use squall_bake::input::sequence::Pattern;
use squall_bake::output::{Place, folder_of, pending, write_atomically};
use squall_bake::picture::{encode_exr_noted, encode_png8_noted};
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
    /// Whether the ground was dried.
    pub dry: bool,
    /// A pattern, or the animated picture.
    pub out: &'a Path,
    /// Layers of every frame; none for the picture alone.
    pub layers: &'a [Layer],
}

/// What became of it.
#[derive(Default)]
pub struct Made {
    /// Frames that were there already.
    pub kept: u64,
    /// Frames that were there, whole, but drawn with other settings, and were drawn again.
    pub redrawn: u64,
    /// Streaks in the frames that were drawn.
    pub streaks: usize,
    /// What is worth knowing of the sky's light on the cloud, as the first frame that says so has it.
    pub sky: Option<String>,
}

impl Made {
    /// Counts a frame that was drawn; what it says of the sky is told once.
    pub(super) fn drew(&mut self, report: &FrameReport, bars: &Bars) {
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
        if self.animated {
            return self.animate((renderer, backend), still, at, tone, bars);
        }
        let mut made = Made::default();
        let (mut folder, places) = self.places()?;
        let marks = Marks::new(renderer.asset().bytes(), tone, self.dry);
        bars.begin("frames", count);
        for (done, (number, (path, form))) in (self.range.first..self.range.end).zip(places).enumerate() {
            bars.check()?;
            let frame = at(number);
            let mark = marks.of(&frame);
            if self.resume {
                match kept(&path, &frame, (&mark, self.layers)) {
                    Kept::Same => {
                        folder.keep();
                        made.kept += 1;
                        bars.advance(1);
                        continue;
                    }
                    Kept::Otherwise => made.redrawn += 1,
                    Kept::No => {}
                }
            }
            backend.render(renderer, &frame)?;
            made.drew(&renderer.report(), bars);
            let note = Some(mark.note());
            let bytes = match form {
                Form::Png => encode_png8_noted(renderer.picture(), tone, note)?,
                Form::Exr if self.layers.is_empty() => encode_exr_noted(renderer.picture(), note)?,
                Form::Exr => layers::encode(renderer, &frame, self.layers, note)?,
            };
            write_atomically(&path, |out| out.write_all(&bytes))?;
            folder.keep();
            pending::note_written();
            pending::set_note(Some(format!("{} of {count} frames are there; --resume goes on", done + 1)));
            bars.advance(1);
        }
        pending::set_note(None);
        Ok(made)
    }

    /// Every frame's file; the folder is made where it is missing, and tried.
    fn places(&self) -> Result<(OutputFolder, Vec<(PathBuf, Form)>), BakeError> {
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
        let output = OutputFolder::prepare(folder)?;
        let mut places = Vec::new();
        for number in self.range.first..self.range.end {
            let path = folder.join(pattern.name(number));
            if !matches!(Place::of(&path)?, Place::File(_)) {
                return Err(BakeError::input(&path, "output", "a file", "a device or pipe"));
            }
            places.push((path, form));
        }
        Ok((output, places))
    }
}

/// What stands in a frame's place.
enum Kept {
    /// The very frame, whole.
    Same,
    /// A picture that was drawn with other settings.
    Otherwise,
    /// No whole picture.
    No,
}

/// What stands in the place of `frame`.
fn kept(path: &Path, frame: &Frame, (mark, layers): (&Mark, &[Layer])) -> Kept {
    let Ok(input) = picture_file(path) else { return Kept::No };
    let whole = is_whole(&input, [frame.camera.width, frame.camera.height], layers);
    match (mark.is_on(&input), whole) {
        (true, true) => Kept::Same,
        // Cut off behind its head.
        (true, false) => Kept::No,
        (false, _) => Kept::Otherwise,
    }
}

/// Whether a file holds a whole picture of this size, with these layers.
fn is_whole(input: &Input, [width, height]: [u32; 2], layers: &[Layer]) -> bool {
    // Files of layers have no layer without a name where beauty was not asked for: their sizes are in their heads.
    if is_exr(input) {
        let whole =
            exr_channel(input, |names| names.first().filter(|_| layers::are_among(layers, names)).cloned());
        return whole.is_ok_and(|(w, h, _)| (w, h) == (width as usize, height as usize));
    }
    rgb_of(input, None)
        .is_ok_and(|taken| (taken.picture.width, taken.picture.height) == (width as usize, height as usize))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_is_two_numbers_with_frames_between_them() {
        assert_eq!(range("0..24"), Ok(Range { first: 0, end: 24 }));
        assert_eq!(range("100..101"), Ok(Range { first: 100, end: 101 }));
        for wrong in ["", "5", "5..5", "6..5", "a..b", "-1..5", "0..99999999", "0..=5"] {
            assert!(range(wrong).is_err(), "{wrong}");
        }
    }
}
