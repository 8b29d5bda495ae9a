//! Frame after frame: buffers read, made wet, written as soon as each is there.

use super::animated::Animated;
use super::output::{Mark, encode, picture_of};
use super::{Args, Range, json};
use crate::cli::folder::{OutputFolder, check_apart};
use crate::cli::picture::{Format, PictureFile};
use crate::cli::progress::Bars;
use squall_bake::BakeError;
use squall_bake::input::gbuffer::roles::Role;
use squall_bake::input::gbuffer::{Reading, TakenBuffer, Writer, read_gbuffer};
use squall_bake::input::light_probe::read_light_probe;
use squall_bake::input::picture::picture_file;
use squall_bake::input::sequence::{FrameFile, Frames, Pattern, find_frames};
use squall_bake::output::{Place, folder_of, pending, write_atomically};
use squall_bake::progress::Progress;
use squall_formats::section::view::ViewSection;
use squall_formats::units::MillimetresPerHour;
use squall_runtime::camera::Projection;
use squall_runtime::frame::tone_of;
use squall_runtime::glam::DVec3;
use squall_runtime::picture::Picture;
use squall_runtime::tone::Tone;
use squall_runtime::wet::draw::{Effect, EffectReport, WetRenderer, WetSettings, flux_of};
use squall_runtime::wet::frame::WetFrame;
use squall_runtime::wet::maps::WetMaps;
use squall_runtime::wet::ripples::DropFlux;
use squall_runtime::world::WorldLight;
use std::io::Write;
use std::path::{Path, PathBuf};

/// One frame: where from, when, where to.
struct Step {
    input: PathBuf,
    time_s: f64,
    out: PathBuf,
}

/// What is made and how.
pub struct Sequence {
    steps: Vec<Step>,
    many: bool,
    format: Format,
    layers: bool,
    resume: bool,
    strict: bool,
    rate: f64,
    wind: DVec3,
    seed: u64,
    lightning: [f32; 2],
    environment: Option<PathBuf>,
    /// The tone of a view, and whether it is for whatever file.
    tone: Option<(Tone, bool)>,
    stops: f32,
    folder: Option<OutputFolder>,
    single: Option<PictureFile>,
    animated: Option<Animated>,
}

/// What became of it.
#[derive(Default)]
pub struct Made {
    /// Frames that are there.
    pub frames: usize,
    /// Those that an earlier run made.
    pub kept: usize,
    /// Frames that failed, each with why.
    pub failed: Vec<(String, String)>,
    /// What the last frame's effects came to.
    pub effects: Vec<EffectReport>,
    /// Buffers of the first frame that was read.
    pub found: Vec<(Role, String)>,
    /// Who wrote it.
    pub writer: Option<&'static str>,
    /// Where its camera is from.
    pub camera_from: Option<&'static str>,
    /// What is worth knowing of it.
    pub notes: Vec<String>,
}

/// What all frames share, once the first is read.
struct Shared {
    light: WorldLight,
    tone: Tone,
    settings: WetSettings,
}

/// Irradiance of a flash at its brightest, times the exposure, where nobody says another: white ground would show it as 4/π, beyond white, grey ground
/// as two thirds of it.
const FLASH_EXPOSED: f32 = 4.0;
/// Name of the controls that say it.
const FLASH: &str = "flash";

impl Sequence {
    /// Finds the frames and tries their places.
    ///
    /// Errors: no such frames; names that don't go together; outputs that would replace an input; the system's refusals.
    pub fn of(
        args: &Args,
        (gbuffer, out): (&Path, &Path),
        (rate, view): (f64, Option<&(ViewSection, bool)>),
    ) -> Result<Self, BakeError> {
        let start = args.time.or_else(|| view.map(|(view, _)| view.rain.time_s)).unwrap_or(0.0);
        let time = |number: u64| start + number as f64 / args.fps;
        let files = files_of(gbuffer, args.frames)?;
        let many = files.len() > 1 || args.frames.is_some();
        let (mut folder, mut single) = (None, None);
        let animated = args.is_animated().then(|| Animated::of(args, out, many)).transpose()?;
        let format = match many {
            _ if animated.is_some() => Format::Png,
            false => {
                let place = PictureFile::prepare(out, None)?;
                let format = place.format();
                single = Some(place);
                format
            }
            true => format_of(out)?,
        };
        let pattern = if many && animated.is_none() { Some(pattern_of(out)?) } else { None };
        if args.layers && format == Format::Png {
            let wanted = "a name that ends in .exr, which holds layers";
            return Err(BakeError::input(out, "output", wanted, out.display()));
        }
        if pattern.is_some() {
            folder = Some(OutputFolder::prepare(folder_of(out))?);
        }
        let place = |number: Option<u64>| match (&pattern, number) {
            (Some(pattern), Some(number)) => folder_of(out).join(pattern.name(number)),
            _ => out.to_owned(),
        };
        let steps: Vec<Step> = files
            .into_iter()
            .map(|(input, number)| Step { input, time_s: number.map_or(start, time), out: place(number) })
            .collect();
        if many {
            let inputs: Vec<PathBuf> = steps.iter().map(|step| step.input.clone()).collect();
            for step in &steps {
                if animated.is_none() && !matches!(Place::of(&step.out)?, Place::File(_)) {
                    return Err(BakeError::input(&step.out, "output", "a file", "a device or pipe"));
                }
                check_apart(&[step.out.as_path()], inputs.iter())?;
            }
        } else if args.resume {
            json::usage("--resume goes on with a sequence: a pattern, or --frames");
        }
        let rain = view.map(|(view, _)| &view.rain);
        Ok(Self {
            steps,
            many,
            format,
            layers: args.layers,
            resume: args.resume,
            strict: args.strict,
            rate,
            wind: DVec3::from_array(
                args.wind.or_else(|| rain.map(|rain| rain.wind_m_per_s)).unwrap_or_default(),
            ),
            seed: args.seed.or_else(|| rain.map(|rain| rain.seed)).unwrap_or(1),
            lightning: args.lightning.map(|value| value as f32),
            environment: args.environment.clone(),
            tone: view.map(|(view, named)| (tone_of(&view.tone), *named)),
            stops: args.stops as f32,
            folder,
            single,
            animated,
        })
    }

    /// Makes every frame.
    ///
    /// Errors: a lone frame that fails, or with `--strict` any; the system's refusals; an interruption.
    pub fn run(
        mut self,
        (renderer, settings): (&mut WetRenderer, &WetSettings),
        reading: &Reading,
        (asset, maps): (&[u8], &WetMaps),
        bars: &Bars,
    ) -> anyhow::Result<Made> {
        let (mut made, mut shared) = (Made::default(), None);
        let mut animated = self.animated.take();
        let count = self.steps.len();
        bars.begin("frames", count as u64);
        let flux = flux_of(MillimetresPerHour(self.rate));
        let said = format!(
            "{reading:?} {} {:?} {} {:?} {:?} {} {} {:?}",
            self.rate, self.wind, self.seed, self.lightning, self.tone, self.stops, self.layers, self.format
        );
        let mut taken: Option<(PathBuf, TakenBuffer)> = None;
        for number in 0..count {
            bars.check()?;
            let step = &self.steps[number];
            let animated = &mut animated;
            let result = self.frame(
                (step, &flux, &said),
                (renderer, settings, reading, (asset, maps)),
                (&mut taken, &mut shared, &mut made, animated),
            );
            match result {
                Ok(()) => {
                    made.frames += 1;
                    if let Some(folder) = &mut self.folder {
                        folder.keep();
                    }
                    if animated.is_none() {
                        pending::note_written();
                        let there = number + 1;
                        pending::set_note(Some(format!(
                            "{there} of {count} frames are there; --resume goes on"
                        )));
                    }
                }
                Err(error) => {
                    let bad_frame = crate::cli::exit_code(&error) == 3;
                    if !bad_frame || !self.many || self.strict || animated.is_some() {
                        return Err(error);
                    }
                    let name = self.steps[number].input.display().to_string();
                    made.failed.push((name, crate::cli::words(&error)));
                }
            }
            bars.advance(1);
        }
        pending::set_note(None);
        if let Some(animated) = animated {
            animated.end()?;
        }
        Ok(made)
    }

    fn frame(
        &self,
        (step, flux, said): (&Step, &[DropFlux], &str),
        (renderer, settings, reading, (asset, maps)): (
            &mut WetRenderer,
            &WetSettings,
            &Reading,
            (&[u8], &WetMaps),
        ),
        (taken, shared, made, animated): (
            &mut Option<(PathBuf, TakenBuffer)>,
            &mut Option<Shared>,
            &mut Made,
            &mut Option<Animated>,
        ),
    ) -> anyhow::Result<()> {
        let input = picture_file(&step.input)?;
        let read = |taken: &mut Option<(PathBuf, TakenBuffer)>| -> Result<(), BakeError> {
            if taken.as_ref().is_none_or(|(path, _)| *path != step.input) {
                *taken = Some((step.input.clone(), read_gbuffer(&input, reading)?));
            }
            Ok(())
        };
        // The first frame's light is the whole sequence's: it is read whatever is there, and every mark holds what came of it.
        if shared.is_none() {
            read(taken)?;
            let Some((_, buffers)) = taken.as_ref() else { return Ok(()) };
            *shared = Some(self.shared(buffers, settings)?);
            made.found.clone_from(&buffers.found);
            made.notes.clone_from(&buffers.notes);
            (made.writer, made.camera_from) = (Some(buffers.writer.name()), Some(buffers.camera_from));
        }
        let Some(all) = shared.as_ref() else { return Ok(()) };
        let light = format!("{said} {} {:?} {:?}", step.time_s, all.light, all.tone);
        let mark = Mark::of((&input, asset), &all.settings, &light);
        if self.resume && mark.is_on(&step.out) {
            made.kept += 1;
            return Ok(());
        }
        read(taken)?;
        let Some((_, buffers)) = taken.as_ref() else { return Ok(()) };
        let parallel = matches!(buffers.camera.projection, Projection::Orthographic { .. });
        if parallel && self.rate > 0.0 && all.settings.is_on(Effect::Rain) {
            let wanted = "a perspective one, as rain is drawn for no other; --without rain leaves it out";
            return Err(BakeError::input(&step.input, "camera", wanted, "an orthographic one").into());
        }
        let frame = WetFrame {
            buffer: &buffers.buffer,
            colour: &buffers.buffer.colour,
            camera: &buffers.camera,
            maps,
            light: &all.light,
            rate_mm_per_h: self.rate,
            flux,
            wind: self.wind,
            time_s: step.time_s,
            seed: self.seed,
            lightning: self.lightning,
        };
        made.effects = renderer.draw(&frame, &all.settings)?.effects;
        if let Some(animated) = animated {
            let developed = all.tone.to_srgb8(&picture_of(renderer, &frame));
            return Ok(animated.add((frame.buffer.size, &developed), self.steps.len())?);
        }
        let bytes = encode((renderer, &frame), (self.format, self.layers), &all.tone, &mark)?;
        match &self.single {
            Some(place) => place.write_bytes(&bytes),
            None => Ok(write_atomically(&step.out, |out| out.write_all(&bytes))?),
        }
    }

    /// Light, development and flashes of the whole sequence, by its first frame.
    fn shared(&self, taken: &TakenBuffer, given: &WetSettings) -> Result<Shared, BakeError> {
        let [width, height] = taken.buffer.size;
        let picture = Picture { width, height, pixels: taken.buffer.colour.clone() };
        let light = match &self.environment {
            Some(path) => read_light_probe(path)?.0,
            None => WorldLight::estimate(&without_lamps(&picture), &taken.camera),
        };
        let tone = match self.tone {
            // An asset's view knows the unit of its own pictures alone.
            Some((tone, named)) if named || taken.writer == Writer::Squall => tone,
            _ => Tone { exposure: Tone::exposure_for(&picture), ..Tone::default() },
        };
        // A flash is as bright as the frame can show, in whatever unit its light is.
        let mut settings = given.clone();
        let most = (FLASH_EXPOSED / tone.exposure).clamp(0.0, 1e6);
        for effect in Effect::ALL {
            let has = effect.parameters().iter().any(|parameter| parameter.name == FLASH);
            if has && !given.is_said(effect, FLASH) {
                settings.set(effect, FLASH, most)?;
            }
        }
        Ok(Shared { light, tone: tone.brighter(self.stops), settings })
    }
}

/// Files of buffers and their frames' numbers; a lone file without a range has none.
fn files_of(gbuffer: &Path, frames: Option<Range>) -> Result<Vec<(PathBuf, Option<u64>)>, BakeError> {
    let files = match (find_frames(gbuffer, &["exr"])?, frames) {
        (Frames::One(file), None) => vec![(file.path, None)],
        (Frames::One(file), Some(range)) => {
            (range.first..range.end).map(|number| (file.path.clone(), Some(number))).collect()
        }
        (Frames::Many(files), None) => files.into_iter().enumerate().map(numbered).collect(),
        (Frames::Many(files), Some(range)) => {
            let all: Vec<_> = files.into_iter().enumerate().map(numbered).collect();
            let wanted = range.first..range.end;
            let within: Vec<_> =
                all.into_iter().filter(|(_, n)| n.is_some_and(|n| wanted.contains(&n))).collect();
            let count = range.end - range.first;
            if within.len() as u64 != count {
                let wanted = format!("{count} files with the numbers {} to {}", range.first, range.end - 1);
                return Err(BakeError::input(gbuffer, "frames", wanted, within.len()));
            }
            within
        }
    };
    Ok(files)
}

/// A picture whose brightest fiftieth counts as bright as the dimmest of it: lamps light what is near them, not the whole world.
fn without_lamps(picture: &Picture) -> Picture {
    let sum = |pixel: &[f32; 3]| pixel.iter().map(|band| band.max(0.0)).sum::<f32>();
    let mut all: Vec<f32> = picture.pixels.iter().map(sum).collect();
    let at = all.len() - 1 - all.len() / 50;
    let (_, most, _) = all.select_nth_unstable_by(at, f32::total_cmp);
    let most = *most;
    let cut = |pixel: &[f32; 3]| {
        let scale = if sum(pixel) > most { most / sum(pixel) } else { 1.0 };
        pixel.map(|band| band * scale)
    };
    Picture { pixels: picture.pixels.iter().map(cut).collect(), ..*picture }
}

fn numbered((at, file): (usize, FrameFile)) -> (PathBuf, Option<u64>) {
    (file.path, Some(file.number.unwrap_or(at as u64)))
}

fn format_of(out: &Path) -> Result<Format, BakeError> {
    match out.extension().and_then(|end| end.to_str()) {
        Some("png") => Ok(Format::Png),
        Some("exr") => Ok(Format::Exr),
        _ => Err(BakeError::input(out, "output", "a name that ends in .png or .exr", out.display())),
    }
}

fn pattern_of(out: &Path) -> Result<Pattern, BakeError> {
    let wanted = "a name with #### for the frames' numbers";
    Pattern::of(out)?.ok_or_else(|| BakeError::input(out, "output", wanted, out.display()))
}
