//! The work itself, frame by frame.

mod again;
mod kept;
mod outputs;
mod taken;

use super::job::{Job, relative};
use super::journal::{self, Entry, Heading, Journal};
use super::layers;
use super::manifest::{AssetRecord, Counts, FileRecord, FrameRecord, Inputs, Manifest, OutputRecord};
use super::place::{NewFolders, check_manifest};
use super::plan::{Key, Kind, Plan, Step, StepCamera};
use super::stream::Stream;
use crate::error::BakeError;
use crate::input::Input;
use crate::input::depth::{DepthFile, DepthForm, DepthReading, depth_file, depth_of};
use crate::input::picture::frame::{FramePicture, frame_of};
use crate::input::picture::picture_file;
use crate::input::pose::{Poses, read_poses, read_times};
use crate::output::pending;
use crate::progress::Progress;
use crate::provenance::{fingerprint, tool};
use squall_formats::units::Seconds;
use squall_runtime::depth::DepthBuffer;
use squall_runtime::frame_rain::{BUILT_IN, FrameRain, TakenFrame};
use squall_runtime::world::WorldLight;
use squall_runtime::{Asset, RuntimeError};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// What a run takes up from an earlier one.
#[derive(Clone, Debug, Default)]
pub struct Given {
    /// Go on where a run with the same settings stopped.
    pub resume: bool,
    /// End at the first frame that fails.
    pub strict: bool,
    /// The run that is to be made again.
    pub again: Option<Manifest>,
}

/// What a run came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Where the manifest is.
    pub manifest: PathBuf,
    /// Every frame at every rate, in order.
    pub records: Vec<FrameRecord>,
    /// How many of them an earlier run had made.
    pub kept: usize,
    /// Where the light is from.
    pub light: String,
    /// What is worth knowing.
    pub notes: Vec<String>,
}

impl Report {
    /// Frames that failed, each with why.
    pub fn failed(&self) -> impl Iterator<Item = (&FrameRecord, &str)> {
        self.records.iter().filter_map(|record| Some((record, record.error.as_deref()?)))
    }
}

/// Rains on the frames of a job.
///
/// A frame that cannot be read is told in the report and in the manifest, and the others go on; a lone frame's error is the run's.
///
/// Errors: settings, paths and assets that cannot be used; a lone or, where asked, any frame that fails; the system's refusals; an
/// interruption.
pub fn run(job: &Job, given: &Given, progress: &dyn Progress) -> Result<Report, BakeError> {
    job.check()?;
    let plan = Plan::new(job)?;
    if let Some(again) = &given.again {
        again::check_frames(again, &plan)?;
    }
    let (rain, asset) = open_rain(job)?;
    let rain_up_to = rain.largest_rate().0;
    if let Some(rate) = job.rates_mm_per_h.iter().find(|rate| **rate > rain_up_to) {
        let wanted = format!("0 to {rain_up_to} mm/h, the range of this rain's tables");
        return Err(BakeError::Setting { field: "--rate", wanted, found: rate.to_string() });
    }
    let poses = job.pose.as_deref().map(|path| read_poses(path, job.pose_up)).transpose()?;
    let times = job.times.as_deref().map(read_times).transpose()?;
    let record =
        |input: &Input| Ok::<_, BakeError>(FileRecord::of(relative(&input.path, &plan.folder)?, input));
    let mut inputs = Inputs {
        pose: poses.as_ref().map(|poses| record(&poses.input)).transpose()?,
        times: times.as_ref().map(|(_, input)| record(input)).transpose()?,
        environment: None,
    };
    let times = times.map(|(times, _)| times);
    let mut work =
        Work { job, plan: &plan, given, poses, times, rain, assumed: false, notes: plan.notes.clone() };
    check_manifest(&plan.manifest)?;
    let mut folders = NewFolders::make(&plan)?;
    let (light, stored) = work.light(&mut inputs)?;
    if let Some(again) = &given.again {
        again::check_inputs(again, &inputs, &plan.manifest)?;
    }
    let asset = AssetRecord { name: name_from(&plan, &asset.0)?, blake3: asset.1 };
    if let Some(again) = &given.again
        && again.asset.blake3 != asset.blake3
    {
        let wanted = format!("the asset that the manifest names, BLAKE3 {}", again.asset.blake3);
        return Err(BakeError::input(Path::new(&asset.name), "asset", wanted, asset.blake3));
    }
    let settings = job.seen_from(&plan.folder)?;
    let heading = Heading { tool: tool(), settings, asset, inputs, light: stored };
    let (records, kept) = work.all(&light, &heading, progress)?;
    folders.keep();
    let from = heading.light.from.clone();
    let manifest = Manifest::new(heading, records);
    // What was to be made again stays the measure of it where it was not.
    let spoilt = given.again.is_some() && manifest.frames.iter().any(|record| record.error.is_some());
    if !(spoilt && plan.manifest.exists()) {
        let text = manifest.text().map_err(BakeError::io(&plan.manifest, "write"))?;
        layers::write(&plan.manifest, text.as_bytes())?;
    }
    // Only now does something else say what the journal does.
    let _ = std::fs::remove_file(journal::path_of(&plan.manifest));
    let notes = work.notes;
    Ok(Report { manifest: plan.manifest.clone(), records: manifest.frames, kept, light: from, notes })
}

/// The rain of a job, and its asset's path and hash.
fn open_rain(job: &Job) -> Result<(FrameRain, (Option<PathBuf>, String)), BakeError> {
    let Some(path) = &job.asset else {
        let hash = blake3::hash(BUILT_IN).to_hex().to_string();
        return Ok((FrameRain::built_in()?, (None, hash)));
    };
    let rain = FrameRain::new(&Asset::open(path)?)?;
    let hash = blake3::Hash::from(fingerprint(path)?.hash).to_hex().to_string();
    Ok((rain, (Some(path.clone()), hash)))
}

fn name_from(plan: &Plan<'_>, path: &Option<PathBuf>) -> Result<String, BakeError> {
    Ok(match path {
        Some(path) => relative(path, &plan.folder)?.to_string_lossy().into_owned(),
        None => "built-in".into(),
    })
}

struct Work<'a> {
    job: &'a Job,
    plan: &'a Plan<'a>,
    given: &'a Given,
    poses: Option<Poses>,
    times: Option<Vec<f64>>,
    rain: FrameRain,
    /// Whether a note says that samples were taken as sRGB.
    assumed: bool,
    notes: Vec<String>,
}

/// A frame with its depth, as they were read.
struct Pair {
    frame: FramePicture,
    depth: DepthFile,
    colour_file: Input,
    depth_file: Input,
}

impl Work<'_> {
    /// Every frame at every rate, and how many an earlier run had made.
    fn all(
        &mut self,
        light: &WorldLight,
        heading: &Heading,
        progress: &dyn Progress,
    ) -> Result<(Vec<FrameRecord>, usize), BakeError> {
        let journal_path = journal::path_of(&self.plan.manifest);
        let entries = if self.given.resume { self.earlier(&journal_path, heading) } else { Vec::new() };
        let mut journal =
            (!self.plan.is_single()).then(|| Journal::begin(journal_path, heading, &entries)).transpose()?;
        let mut streams = self.streams(&entries)?;
        let kept = entries.len();
        let known: HashMap<Key, FrameRecord> =
            entries.into_iter().map(|entry| (key(&entry.record), entry.record)).collect();
        progress.begin("frames", self.plan.count() as u64);
        let mut records = Vec::new();
        for step in &self.plan.steps {
            for camera in &step.cameras {
                let rates: Vec<f64> = self.job.rates_mm_per_h.clone();
                let find = |rate: f64| {
                    known.get(&(step.frame.stem.clone(), rate.to_bits(), camera.name.map(str::to_owned)))
                };
                let missing = rates.iter().any(|&rate| find(rate).is_none());
                let pair = missing.then(|| self.read(step, camera));
                for rate in rates {
                    progress.check()?;
                    let record = match (find(rate), &pair) {
                        (Some(record), _) => record.clone(),
                        (None, Some(pair)) => {
                            let (record, stream_bytes) =
                                self.frame((step, camera, rate), pair, light, &mut streams)?;
                            if let Some(journal) = &mut journal {
                                journal.add(&Entry { record: record.clone(), stream_bytes })?;
                            }
                            record
                        }
                        (None, None) => continue,
                    };
                    records.push(record);
                    progress.advance(1);
                    if journal.is_some() {
                        let words = format!(
                            "{} of {} frames are done; --resume goes on from there",
                            records.len(),
                            self.plan.count()
                        );
                        pending::set_note(Some(words));
                        pending::note_written();
                    }
                }
            }
        }
        for (path, stream) in streams {
            // A list that lacks a frame's lines is not what the manifest says, and takes no other's place.
            if self.given.again.is_some() && records.iter().any(|record| record.error.is_some()) {
                stream.drop_part(&path)?;
            } else {
                stream.end(&path)?;
            }
        }
        pending::set_note(None);
        Ok((records, kept))
    }

    fn read(&self, step: &Step, camera: &StepCamera) -> Result<Pair, BakeError> {
        let missing = |what: &str, beside: &Path| {
            BakeError::input(
                beside,
                step.frame.stem.clone(),
                format!("{what} of that name, number or place"),
                "none",
            )
        };
        let right = self.job.right.as_ref().filter(|_| camera.name == Some("right"));
        let (colours, depths) = match right {
            Some(right) => (&right.colour, &right.depth),
            None => (&self.job.colour, &self.job.depth),
        };
        let colour = camera.colour.as_ref().ok_or_else(|| missing("a frame", colours))?;
        let depth = camera.depth.as_ref().ok_or_else(|| missing("a depth", depths))?;
        let colour_file = picture_file(colour)?;
        let frame = frame_of(&colour_file)?;
        let depth_input = depth_file(depth)?;
        let fx = match (self.job.intrinsics_px, self.job.vertical_fov_deg) {
            (Some([fx, ..]), _) => fx,
            (None, fov) => {
                let half = 0.5 * fov.unwrap_or(60.0).to_radians();
                0.5 * frame.picture.height as f64 / libm::tan(half)
            }
        };
        let form = self.job.depth_kind;
        let baseline_focal =
            if form == DepthForm::Disparity { self.job.baseline_m.unwrap_or(0.0) * fx } else { 0.0 };
        let reading = DepthReading { form, scale: self.job.depth_scale, baseline_focal };
        let depth = depth_of(&depth_input, &reading)?;
        let size = [frame.picture.width, frame.picture.height];
        if [depth.width, depth.height] != size {
            let wanted = format!("{} × {}, the size of {}", size[0], size[1], colour.display());
            let found = format!("{} × {}", depth.width, depth.height);
            return Err(BakeError::input(&depth_input.path, "depth", wanted, found));
        }
        Ok(Pair { frame, depth, colour_file, depth_file: depth_input })
    }

    /// Rains on one frame at one rate: its record, and the length of the shared list of streaks behind it.
    fn frame(
        &mut self,
        (step, camera, rate): (&Step, &StepCamera, f64),
        pair: &Result<Pair, BakeError>,
        light: &WorldLight,
        streams: &mut HashMap<PathBuf, Stream>,
    ) -> Result<(FrameRecord, Option<u64>), BakeError> {
        let mut record = FrameRecord {
            frame: step.frame.stem.clone(),
            rate_mm_per_h: rate,
            camera: camera.name.map(str::to_owned),
            time_s: self.time(step).unwrap_or(self.job.time_s),
            colour: None,
            depth: None,
            transfer: None,
            outputs: Vec::new(),
            counts: None,
            error: None,
        };
        let made = match pair {
            Ok(pair) => self.rain_on((step, camera, rate), pair, light, (&mut record, streams)),
            Err(error) => Err(Refusal::of(error)),
        };
        match made {
            Ok(stream_bytes) => Ok((record, stream_bytes)),
            Err(refusal) => {
                self.remove(&record.outputs);
                // An input that is none, or outputs that are not the manifest's.
                let bad_frame = matches!(refusal.exit_code, 1 | 3);
                if !bad_frame || !self.plan.many || self.given.strict {
                    return Err(refusal.error());
                }
                record.outputs.clear();
                record.error = Some(refusal.words);
                Ok((record, None))
            }
        }
    }

    /// Removes what was written for a frame that failed after it; lists that frames share keep what they hold.
    fn remove(&self, outputs: &[OutputRecord]) {
        let own = |output: &&OutputRecord| {
            !(output.kind == Kind::Streaks.name() && self.plan.is_shared(Kind::Streaks))
        };
        for output in outputs.iter().filter(own) {
            let _ = std::fs::remove_file(self.plan.folder.join(&output.name));
        }
    }

    fn rain_on(
        &mut self,
        (step, camera, rate): (&Step, &StepCamera, f64),
        pair: &Pair,
        light: &WorldLight,
        (record, streams): (&mut FrameRecord, &mut HashMap<PathBuf, Stream>),
    ) -> Result<Option<u64>, Refusal> {
        let folder = &self.plan.folder;
        record.colour = Some(FileRecord::of(relative(&pair.colour_file.path, folder)?, &pair.colour_file));
        record.depth = Some(FileRecord::of(relative(&pair.depth_file.path, folder)?, &pair.depth_file));
        record.transfer = Some(pair.frame.how.clone());
        self.check_again(record)?;
        if pair.frame.assumed && !self.assumed {
            self.assumed = true;
            self.notes.push(format!(
                "{}: samples taken as {}",
                pair.colour_file.path.display(),
                pair.frame.how
            ));
        }
        let size = (pair.frame.picture.width, pair.frame.picture.height);
        let moment = self.moment(step, camera, [size.0 as u32, size.1 as u32])?;
        let depth = DepthBuffer::new(&pair.depth.metres, size.0, size.1, pair.depth.kind)?;
        let depth = depth.with_holes(self.job.holes.runtime());
        let taken = TakenFrame {
            camera: &moment.camera,
            velocity: moment.velocity,
            time: Seconds(moment.time),
            depth: Some(depth),
            light,
        };
        let mut picture = pair.frame.picture.clone();
        let report = self.rain.rain_on(&self.job.settings(rate), &taken, &mut picture)?;
        let made = self.encode((step, camera, rate), pair, &taken, (&picture, record))?;
        self.check_outputs(record, &made)?;
        let stream_bytes = self.write(made, record, streams)?;
        record.counts = Some(Counts {
            streaks: report.streaks,
            inside: report.inside,
            holes: report.holes,
            mean_alpha: report.mean_alpha,
            mean_transmittance: report.mean_transmittance,
        });
        Ok(stream_bytes)
    }
}

fn key(record: &FrameRecord) -> Key {
    (record.frame.clone(), record.rate_mm_per_h.to_bits(), record.camera.clone())
}

/// An error that several frames may share, and the run may need.
struct Refusal {
    exit_code: u8,
    words: String,
    own: Option<Box<BakeError>>,
}

impl Refusal {
    fn of(error: &BakeError) -> Self {
        Self { exit_code: error.exit_code(), words: error.to_string(), own: None }
    }

    /// The error itself, or one that says and does the same.
    fn error(self) -> BakeError {
        match (self.own, self.exit_code) {
            (Some(own), _) => *own,
            (None, 130) => BakeError::Interrupted,
            (None, exit_code) => BakeError::Told { exit_code, words: self.words },
        }
    }
}

impl From<BakeError> for Refusal {
    fn from(error: BakeError) -> Self {
        Self { exit_code: error.exit_code(), words: error.to_string(), own: Some(Box::new(error)) }
    }
}

impl From<RuntimeError> for Refusal {
    fn from(error: RuntimeError) -> Self {
        BakeError::from(error).into()
    }
}
