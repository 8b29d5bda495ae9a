//! When, from where and in what light a frame was taken.

use super::Work;
use crate::error::BakeError;
use crate::frames::job::relative;
use crate::frames::manifest::{FileRecord, Inputs, Manifest, StoredLight};
use crate::frames::plan::{Step, StepCamera};
use crate::input::light_probe::read_light_probe;
use crate::input::picture::frame::frame_of;
use crate::input::picture::picture_file;
use crate::input::pose::Pose;
use crate::provenance::fingerprint;
use squall_formats::units::{Degrees, Metres};
use squall_runtime::Camera;
use squall_runtime::camera::{Intrinsics, Projection};
use squall_runtime::glam::DVec3;
use squall_runtime::world::WorldLight;
use std::path::Path;

/// Height of a camera whose pose nothing tells, m: a person's.
const EYE: Metres = Metres(1.6);

/// When and where a frame was taken.
pub struct Moment {
    pub camera: Camera,
    pub velocity: DVec3,
    pub time: f64,
}

impl Work<'_> {
    /// The light of the whole run: the manifest's that is made again, the environment's, or what the first readable frame shows.
    ///
    /// The file that it is from, where one was given, is noted in `inputs`.
    pub fn light(&mut self, inputs: &mut Inputs) -> Result<(WorldLight, StoredLight), BakeError> {
        let folder = &self.plan.folder;
        if let Some(again) = &self.given.again {
            if let Some(path) = &self.job.environment {
                let print = fingerprint(path)?;
                inputs.environment = Some(FileRecord::of_print(relative(path, folder)?, &print));
            }
            return Ok((again.light.world(&self.plan.manifest)?, again.light.clone()));
        }
        if let Some(path) = &self.job.environment {
            let name = relative(path, folder)?;
            if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("json")) {
                let light = Manifest::read(path)?.light;
                inputs.environment = Some(FileRecord::of_print(name, &fingerprint(path)?));
                return Ok((light.world(path)?, light));
            }
            let (light, input) = read_light_probe(path)?;
            let record = FileRecord::of(name, &input);
            let from = format!("{}, BLAKE3 {}", record.name.display(), record.blake3);
            inputs.environment = Some(record);
            let stored = StoredLight::of(&light, from);
            return Ok((light, stored));
        }
        let mut first = None;
        for step in &self.plan.steps {
            let camera = &step.cameras[0];
            let estimate = || -> Result<WorldLight, BakeError> {
                let colour = camera.colour.as_ref().unwrap_or(&step.frame.path);
                let frame = frame_of(&picture_file(colour)?)?;
                let size = [frame.picture.width as u32, frame.picture.height as u32];
                let moment = self.moment(step, camera, size)?;
                Ok(WorldLight::estimate(&frame.picture, &moment.camera))
            };
            match estimate() {
                Ok(light) => {
                    let stored = StoredLight::of(&light, format!("estimated from {}", step.frame.stem));
                    return Ok((light, stored));
                }
                Err(error) if error.exit_code() == 3 && self.plan.many && !self.given.strict => {
                    first = first.or(Some(error));
                }
                Err(error) => return Err(error),
            }
        }
        Err(first.unwrap_or(BakeError::NoPicture))
    }

    /// Camera, motion and time of a frame.
    pub fn moment(&self, step: &Step, camera: &StepCamera, size: [u32; 2]) -> Result<Moment, BakeError> {
        let time = self.time(step)?;
        let pose = self.pose(step)?;
        let around = |offset: isize| {
            let index = step.index.checked_add_signed(offset)?;
            let other = self.plan.steps.get(index)?;
            Some((self.pose(other).ok()?.position, self.time(other).ok()?))
        };
        // Central differences; at the ends of a sequence, one-sided ones.
        let (before, after) = (around(-1), around(1));
        let own = (pose.position, time);
        let ((a, start), (b, end)) = (before.unwrap_or(own), after.unwrap_or(own));
        let velocity = if end > start { (b - a) / (end - start) } else { DVec3::ZERO };
        let right = pose.forward.cross(pose.up).normalize();
        let aside = if camera.name == Some("right") { self.job.baseline_m.unwrap_or(0.0) } else { 0.0 };
        let position = pose.position + right * aside;
        let camera = match (self.job.intrinsics_px, self.job.vertical_fov_deg) {
            (Some([fx, fy, cx, cy]), _) => {
                // Calibrations count from the middle of the top left pixel, the runtime from its corner.
                let lens = Intrinsics { fx, fy, cx: cx + 0.5, cy: cy + 0.5 };
                Camera::pinhole(position, pose.forward, pose.up, lens, size)?
            }
            (None, fov) => {
                let vertical_fov = Degrees(fov.unwrap_or(60.0)).into();
                let projection = Projection::Perspective { vertical_fov };
                Camera::new(position, pose.forward, pose.up, projection, size)?
            }
        };
        Ok(Moment { camera, velocity, time })
    }

    fn pose(&self, step: &Step) -> Result<Pose, BakeError> {
        match &self.poses {
            Some(poses) => poses.of(step.index, self.plan.steps.len(), &step.frame).copied(),
            // Level, at a person's height, along y.
            None => {
                let position = DVec3::Z * EYE.0;
                Ok(Pose { time: None, position, forward: DVec3::Y, up: DVec3::Z })
            }
        }
    }

    /// Time of a frame: the file of times'; its pose's, from the first one that there is; or by the number of frames a second, which counts
    /// what frames are called by where poses do, and frames where nothing does.
    pub fn time(&self, step: &Step) -> Result<f64, BakeError> {
        let start = self.job.time_s;
        if let Some(times) = &self.times {
            let by_number = || times.get(usize::try_from(step.frame.number?).ok()?);
            let found =
                if times.len() == self.plan.steps.len() { times.get(step.index) } else { by_number() };
            let path = self.job.times.as_deref().unwrap_or(Path::new("--times"));
            let wanted = format!("a time for {}", step.frame.stem);
            let missing = || BakeError::input(path, "times", wanted, format!("{} lines", times.len()));
            return found.map(|time| start + time).ok_or_else(missing);
        }
        let steps = &self.plan.steps;
        if self.poses.as_ref().is_some_and(|poses| poses.by_number(steps.len())) {
            // Frames that a sequence leaves out take their time all the same: poses, and so velocities, are by number.
            let first = steps.iter().find_map(|step| step.frame.number);
            if let Some((first, own)) = first.zip(step.frame.number) {
                return Ok(start + (own as f64 - first as f64) / self.job.fps);
            }
        }
        let first = steps.iter().find_map(|step| self.pose(step).ok()?.time);
        match (first, self.pose(step).ok().and_then(|pose| pose.time)) {
            (Some(first), Some(own)) if self.plan.many => Ok(start + (own - first)),
            _ => Ok(start + step.index as f64 / self.job.fps),
        }
    }
}
