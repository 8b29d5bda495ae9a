//! Which frames there are, and where each output of each frame goes. Everything is named before anything is written.

use super::job::Job;
use super::layers::{Ending, ending};
use super::manifest::NAME;
use crate::error::BakeError;
use crate::input::sequence::{FrameFile, Frames, Partners, Pattern, find_frames};
use crate::output::{Place, folder_of};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

/// Ends of names that a folder of frames, and one of their depth, is looked through for.
const COLOUR_ENDINGS: [&str; 2] = ["png", "exr"];
const DEPTH_ENDINGS: [&str; 3] = ["png", "exr", "npy"];

/// One moment of a sequence.
pub struct Step {
    /// Its place in the sequence.
    pub index: usize,
    /// The first camera's file.
    pub frame: FrameFile,
    /// The cameras that saw it: one, or left and right.
    pub cameras: Vec<StepCamera>,
}

/// What one camera saw of a moment.
pub struct StepCamera {
    /// "left" or "right" of a pair.
    pub name: Option<&'static str>,
    /// Its frame; nothing where the right camera has none.
    pub colour: Option<PathBuf>,
    /// The frame's depth, if one was found.
    pub depth: Option<PathBuf>,
}

/// What can be written for a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The rainy frame.
    Frame,
    /// Coverage of streaks.
    Mask,
    /// Transmittance of the medium.
    Transmittance,
    /// Light that it scatters in.
    InScattered,
    /// The list of streaks.
    Streaks,
}

impl Kind {
    /// Every kind, in the order in which they are written.
    pub const ALL: [Self; 5] =
        [Self::Frame, Self::Mask, Self::Transmittance, Self::InScattered, Self::Streaks];

    /// Its name in a manifest.
    pub fn name(self) -> &'static str {
        match self {
            Self::Frame => "frame",
            Self::Mask => "mask",
            Self::Transmittance => "transmittance",
            Self::InScattered => "in_scattered",
            Self::Streaks => "streaks",
        }
    }

    /// End of the names of its files where a folder is given.
    fn ending(self) -> Option<&'static str> {
        match self {
            Self::Frame => None,
            Self::Mask | Self::Transmittance => Some("png"),
            Self::InScattered => Some("exr"),
            Self::Streaks => Some("jsonl"),
        }
    }
}

/// A run's frames and places.
pub struct Plan<'a> {
    job: &'a Job,
    /// Moments in order.
    pub steps: Vec<Step>,
    /// Whether colour is a folder or a pattern.
    pub many: bool,
    /// The folder of the outputs.
    pub folder: PathBuf,
    /// The manifest.
    pub manifest: PathBuf,
    /// How frames of several folders were brought together.
    pub notes: Vec<String>,
}

/// What tells a frame from all others: its name, the bits of its rate, its camera.
pub type Key = (String, u64, Option<String>);

/// A frame of one camera at one rate.
pub struct Cell<'a> {
    /// Its moment.
    pub step: &'a Step,
    /// Its camera.
    pub camera: &'a StepCamera,
    /// Its rate, mm/h.
    pub rate: f64,
}

impl Cell<'_> {
    /// What tells it from all others.
    pub fn key(&self) -> Key {
        (self.step.frame.stem.clone(), self.rate.to_bits(), self.camera.name.map(str::to_owned))
    }
}

impl<'a> Plan<'a> {
    /// Finds the frames and names every output.
    ///
    /// Errors: no frames, two frames of one name before its ending, depth that is one file for several frames, an output that would replace an input or another output, a name
    /// without an ending that tells its form.
    pub fn new(job: &'a Job) -> Result<Self, BakeError> {
        let colour = find_frames(&job.colour, &COLOUR_ENDINGS)?;
        let depth = find_frames(&job.depth, &DEPTH_ENDINGS)?;
        let right = match &job.right {
            Some(right) => {
                let colour = find_frames(&right.colour, &COLOUR_ENDINGS)?;
                Some((colour, find_frames(&right.depth, &DEPTH_ENDINGS)?))
            }
            None => None,
        };
        let many = matches!(colour, Frames::Many(_));
        let frames = match colour {
            Frames::One(one) => vec![one],
            Frames::Many(many) => many,
        };
        if many && let Frames::One(_) = depth {
            let wanted = "a folder or pattern, as the frames are";
            return Err(BakeError::input(&job.depth, "depth", wanted, "one file"));
        }
        check_names(&job.colour, &frames)?;
        let mut notes = Vec::new();
        let mut of = |what: &str, frames: &[Option<&FrameFile>], others: &Frames| -> Vec<Option<FrameFile>> {
            let found = Partners::find(frames, others);
            notes.extend(found.rule.map(|rule| format!("{what} belong to frames by {}", rule.words())));
            found.files.into_iter().map(|file| file.cloned()).collect()
        };
        let all: Vec<Option<&FrameFile>> = frames.iter().map(Some).collect();
        let depths = of("depths", &all, &depth);
        let right = right.map(|(colour, depth)| {
            let colours = of("the right camera's frames", &all, &colour);
            let seen: Vec<Option<&FrameFile>> = colours.iter().map(Option::as_ref).collect();
            let depths = of("the right camera's depths", &seen, &depth);
            (colours, depths)
        });
        let path = |files: &[Option<FrameFile>], index: usize| {
            files[index].as_ref().map(|file: &FrameFile| file.path.clone())
        };
        let mut steps = Vec::new();
        for (index, frame) in frames.into_iter().enumerate() {
            let mut cameras = vec![StepCamera {
                name: right.as_ref().map(|_| "left"),
                colour: Some(frame.path.clone()),
                depth: path(&depths, index),
            }];
            if let Some((colours, depths)) = &right {
                let (colour, depth) = (path(colours, index), path(depths, index));
                cameras.push(StepCamera { name: Some("right"), colour, depth });
            }
            steps.push(Step { index, frame, cameras });
        }
        let folder = match job.out_is_folder(many) {
            true => job.out.clone(),
            false => folder_of(&job.out).to_owned(),
        };
        let plan = Self { job, steps, many, manifest: folder.join(NAME), folder, notes };
        plan.check_apart()?;
        Ok(plan)
    }

    /// Every frame of every camera at every rate, in order.
    pub fn cells(&self) -> impl Iterator<Item = Cell<'_>> {
        self.steps.iter().flat_map(move |step| {
            step.cameras.iter().flat_map(move |camera| {
                self.job.rates_mm_per_h.iter().map(move |&rate| Cell { step, camera, rate })
            })
        })
    }

    /// Where the frames were looked for.
    pub fn colour(&self) -> &Path {
        &self.job.colour
    }

    /// Number of frames that will be written.
    pub fn count(&self) -> usize {
        self.steps.iter().map(|step| step.cameras.len()).sum::<usize>() * self.job.rates_mm_per_h.len()
    }

    /// Where an output goes; `None` where it was not asked for.
    pub fn place(
        &self,
        kind: Kind,
        step: &Step,
        camera: &StepCamera,
        rate: f64,
    ) -> Result<Option<PathBuf>, BakeError> {
        let base = match kind {
            Kind::Frame => Some(&self.job.out),
            Kind::Mask => self.job.mask.as_ref(),
            Kind::Transmittance => self.job.transmittance.as_ref(),
            Kind::InScattered => self.job.in_scattered.as_ref(),
            Kind::Streaks => self.job.streaks.as_ref(),
        };
        let Some(base) = base else { return Ok(None) };
        let pattern = Pattern::of(base)?;
        let named = base.extension().is_some() && !names_folder(base);
        let own = || {
            let colour = camera.colour.as_ref().unwrap_or(&step.frame.path);
            let name = PathBuf::from(colour.file_name().unwrap_or_default());
            kind.ending().map_or(name.clone(), |end| PathBuf::from(&step.frame.stem).with_added(end))
        };
        let (folder, name) = match &pattern {
            Some(pattern) => {
                let number = step.frame.number.unwrap_or(step.index as u64);
                (folder_of(base).to_owned(), PathBuf::from(pattern.name(number)))
            }
            None if named && (!self.many || self.is_shared(kind)) => {
                (folder_of(base).to_owned(), PathBuf::from(base.file_name().unwrap_or_default()))
            }
            None if self.is_single() && !names_folder(base) => {
                (folder_of(base).to_owned(), PathBuf::from(base.file_name().unwrap_or_default()))
            }
            None => (base.clone(), own()),
        };
        let mut path = match folder.as_os_str() == "." && !base.starts_with(".") {
            true => PathBuf::new(),
            false => folder,
        };
        if self.job.rates_mm_per_h.len() > 1 {
            path.push(format!("rate-{rate}"));
        }
        if let Some(camera) = camera.name.filter(|_| !self.is_shared(kind)) {
            path.push(camera);
        }
        path.push(name);
        if kind != Kind::Streaks {
            let found = ending(&path)?;
            if kind == Kind::InScattered && found == Ending::Png {
                return Err(BakeError::input(&path, "--in-scattered", "a name that ends in .exr", "a PNG"));
            }
        }
        Ok(Some(path))
    }

    /// Whether there is one frame, one camera and one rate.
    pub fn is_single(&self) -> bool {
        !self.many && self.count() == 1
    }

    /// Whether several frames share one list of streaks.
    pub fn is_shared(&self, kind: Kind) -> bool {
        let cameras = self.steps.iter().map(|step| step.cameras.len()).sum::<usize>();
        let named = |path: &PathBuf| {
            path.extension().is_some() && !names_folder(path) && matches!(Pattern::of(path), Ok(None))
        };
        kind == Kind::Streaks && (self.many || cameras > 1) && self.job.streaks.as_ref().is_some_and(named)
    }

    /// Every output of every frame.
    pub fn all_places(&self) -> Result<Vec<(Kind, PathBuf)>, BakeError> {
        let mut places = Vec::new();
        for step in &self.steps {
            for camera in &step.cameras {
                for &rate in &self.job.rates_mm_per_h {
                    for kind in Kind::ALL {
                        places.extend(self.place(kind, step, camera, rate)?.map(|path| (kind, path)));
                    }
                }
            }
        }
        Ok(places)
    }

    /// Refuses outputs that would replace an input or each other.
    fn check_apart(&self) -> Result<(), BakeError> {
        let job = self.job;
        let mut inputs: HashSet<PathBuf> = HashSet::new();
        let others = [&job.asset, &job.times, &job.pose, &job.environment];
        inputs.extend(others.into_iter().flatten().map(|path| real(path)));
        for camera in self.steps.iter().flat_map(|step| &step.cameras) {
            inputs.extend(camera.colour.iter().chain(&camera.depth).map(|path| real(path)));
        }
        let sources = [Some(&job.colour), Some(&job.depth), job.right.as_ref().map(|right| &right.colour)];
        for source in sources.into_iter().flatten().filter(|source| source.is_dir()) {
            if real(source) == real(&self.folder)
                && self.many
                && job.rates_mm_per_h.len() == 1
                && job.right.is_none()
            {
                let wanted = "a folder that holds none of the frames that are read";
                return Err(BakeError::input(&job.out, "output", wanted, "the same folder"));
            }
        }
        let mut outputs = HashSet::from([real(&self.manifest)]);
        let refused =
            |path: &Path, wanted: &str, found: &str| Err(BakeError::input(path, "output", wanted, found));
        if inputs.contains(&real(&self.manifest)) {
            let wanted = "a manifest that is not read: put the output into another folder";
            return refused(&self.manifest, wanted, "one of the inputs");
        }
        for (kind, path) in self.all_places()? {
            if path == Path::new("-") || !matches!(Place::of(&path)?, Place::File(_)) {
                return refused(&path, "a file, which a manifest stands beside", "a stream");
            }
            let place = real(&path);
            if inputs.contains(&place) {
                return refused(&path, "a file that is not read", "one of the inputs");
            }
            if !outputs.insert(place) && !self.is_shared(kind) {
                return refused(&path, "a file of its own", "another output");
            }
        }
        Ok(())
    }
}

/// Refuses frames that only their endings tell apart: depths, lists of streaks and the manifest go by the name before it.
fn check_names(colour: &Path, frames: &[FrameFile]) -> Result<(), BakeError> {
    let mut known: HashMap<&str, &FrameFile> = HashMap::new();
    for frame in frames {
        if let Some(other) = known.insert(&frame.stem, frame) {
            let name = |file: &FrameFile| file.path.file_name().unwrap_or_default().display().to_string();
            let found = format!("{} and {}", name(other), name(frame));
            return Err(BakeError::input(colour, "frames", "one frame of a name before its ending", found));
        }
    }
    Ok(())
}

impl Job {
    /// Whether the output's name is a folder's.
    fn out_is_folder(&self, many: bool) -> bool {
        let pattern = matches!(Pattern::of(&self.out), Ok(Some(_)));
        let several = many || self.rates_mm_per_h.len() > 1 || self.right.is_some();
        names_folder(&self.out) || !pattern && several && (many || self.out.extension().is_none())
    }
}

/// Whether a name is a folder's: one that is there, or that ends like one.
fn names_folder(path: &Path) -> bool {
    path.is_dir() || path.as_os_str().to_string_lossy().ends_with(['/', std::path::MAIN_SEPARATOR])
}

trait WithAdded {
    fn with_added(self, end: &str) -> PathBuf;
}

impl WithAdded for PathBuf {
    /// The name with an ending behind it: dots of the name stay.
    fn with_added(self, end: &str) -> PathBuf {
        let mut name = self.into_os_string();
        name.push(".");
        name.push(end);
        PathBuf::from(name)
    }
}

/// A path by which two names of one file are the same; the file need not be there.
fn real(path: &Path) -> PathBuf {
    if let Ok(path) = path.canonicalize() {
        return path;
    }
    let mut missing = Vec::new();
    for above in path.ancestors() {
        let above = if above.as_os_str().is_empty() { Path::new(".") } else { above };
        if let Ok(whole) = above.canonicalize() {
            return missing.into_iter().rev().fold(whole, |path, name: std::ffi::OsString| path.join(name));
        }
        match above.file_name() {
            Some(name) => missing.push(name.to_owned()),
            None => break,
        }
    }
    path.to_owned()
}
