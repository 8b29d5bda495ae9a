//! What is to be done: every setting of a run, as the command line gives it and the manifest keeps it.

use crate::error::BakeError;
use crate::input::depth::DepthForm;
use crate::input::pose::UpAxis;
use serde::{Deserialize, Serialize};
use squall_formats::units::{Metres, MillimetresPerHour, Seconds};
use squall_runtime::depth::DepthHoles;
use squall_runtime::frame_rain::FrameRainSettings;
use squall_runtime::glam::DVec3;
use std::path::{Path, PathBuf};

/// Longest exposure, ms: the view's of a recipe.
pub const MOST_EXPOSURE_MS: f64 = 1e4;
/// Largest factor on what drops cover: the view's of a recipe.
pub const MOST_GAIN: f64 = 1000.0;
/// Strongest wind along an axis, m/s: the view's of a recipe.
pub const MOST_WIND_M_PER_S: f64 = 200.0;

/// What to make of pixels without a depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Holes {
    /// The depth of the nearest pixel that has one.
    #[default]
    Fill,
    /// The medium leaves them as they are; streaks are drawn over them.
    Leave,
    /// As far as the sky.
    Sky,
}

impl Holes {
    /// The same for the runtime.
    pub fn runtime(self) -> DepthHoles {
        match self {
            Self::Fill => DepthHoles::FillFromNeighbours,
            Self::Leave => DepthHoles::LeaveAlone,
            Self::Sky => DepthHoles::At(Metres(f64::INFINITY)),
        }
    }
}

/// The second camera of a pair, to the right of the first by the baseline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RightCamera {
    /// Its frames.
    pub colour: PathBuf,
    /// Their depth.
    pub depth: PathBuf,
}

/// Settings of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Job {
    /// A frame, a folder or a pattern.
    pub colour: PathBuf,
    /// Its depth: a file, a folder or a pattern.
    pub depth: PathBuf,
    /// What depth measures.
    pub depth_kind: DepthForm,
    /// Steps a metre or pixel of integers; metres or pixels a unit of floats.
    pub depth_scale: Option<f64>,
    /// Distance between the cameras of a pair.
    pub baseline_m: Option<f64>,
    /// fx, fy, cx, cy in pixels; (0, 0) is the middle of the top left pixel.
    pub intrinsics_px: Option<[f64; 4]>,
    /// In place of intrinsics.
    pub vertical_fov_deg: Option<f64>,
    /// Rainfall intensities; a folder for each where there are several.
    pub rates_mm_per_h: Vec<f64>,
    /// Whose rain; the built-in one's if left out.
    pub asset: Option<PathBuf>,
    /// Time that the shutter is open.
    pub exposure_ms: f64,
    /// Time of the first frame.
    pub time_s: f64,
    /// Frames a second, where neither `times` nor poses have a frame's time.
    pub fps: f64,
    /// Times of frames, a number a line.
    pub times: Option<PathBuf>,
    /// Another seed is another rain.
    pub seed: u64,
    /// Wind that has blown the same since time 0.
    pub wind_m_per_s: [f64; 3],
    /// Where cameras stood: a file as TUM's or KITTI's.
    pub pose: Option<PathBuf>,
    /// Which way is up in it.
    pub pose_up: UpAxis,
    /// Light: a panorama, or the manifest of another run; estimated from the first frame if left out.
    pub environment: Option<PathBuf>,
    /// Factor on what drops cover.
    pub gain: f64,
    /// Shortest and longest streak drawn; by the picture's height if left out.
    pub streak_px: Option<[f64; 2]>,
    /// How far the rain reaches.
    pub sky_distance_m: f64,
    /// What to make of pixels without a depth.
    pub holes: Holes,
    /// The second camera of a pair.
    pub right: Option<RightCamera>,
    /// The rainy frames.
    pub out: PathBuf,
    /// Coverage of the streaks.
    pub mask: Option<PathBuf>,
    /// Transmittance of the medium.
    pub transmittance: Option<PathBuf>,
    /// Light that the medium scatters in.
    pub in_scattered: Option<PathBuf>,
    /// Lists of streaks.
    pub streaks: Option<PathBuf>,
}

impl Job {
    /// Refuses numbers that no run has; assets and frames are looked at later.
    ///
    /// Errors: the first one, by its option.
    pub fn check(&self) -> Result<(), BakeError> {
        let bad = |field: &'static str, wanted: &str, found: String| {
            Err(BakeError::Setting { field, wanted: wanted.into(), found })
        };
        let within = |value: f64, low: f64, high: f64| (low..=high).contains(&value);
        let positive = |value: f64| value > 0.0 && value.is_finite();
        if self.rates_mm_per_h.is_empty() {
            return bad("--rate", "at least one rate in mm/h", "none".into());
        }
        for (at, rate) in self.rates_mm_per_h.iter().enumerate() {
            if !(*rate >= 0.0 && rate.is_finite()) {
                return bad("--rate", "rates of 0 mm/h or more", rate.to_string());
            }
            if self.rates_mm_per_h[..at].contains(rate) {
                return bad("--rate", "every rate once", format!("{rate} twice"));
            }
        }
        match (self.intrinsics_px, self.vertical_fov_deg) {
            (Some([fx, fy, cx, cy]), None) => {
                if !(positive(fx) && positive(fy) && cx.is_finite() && cy.is_finite()) {
                    let found = format!("{fx},{fy},{cx},{cy}");
                    return bad("--intrinsics", "FX and FY above 0, and finite CX and CY", found);
                }
            }
            (None, Some(fov)) if fov > 0.0 && fov < 180.0 => {}
            (None, Some(fov)) => return bad("--vertical-fov", "degrees between 0 and 180", fov.to_string()),
            _ => {
                return bad(
                    "--intrinsics",
                    "either --intrinsics or --vertical-fov",
                    "both or neither".into(),
                );
            }
        }
        if !within(self.exposure_ms, 1e-3, MOST_EXPOSURE_MS) {
            return bad("--exposure-ms", "0.001 to 10000 ms", self.exposure_ms.to_string());
        }
        if !within(self.time_s, -1e9, 1e9) {
            return bad("--time", "-1e9 to 1e9 s", self.time_s.to_string());
        }
        if !positive(self.fps) {
            return bad("--fps", "frames a second above 0", self.fps.to_string());
        }
        if !self.wind_m_per_s.iter().all(|value| value.abs() <= MOST_WIND_M_PER_S) {
            return bad("--wind", "three numbers from -200 to 200 m/s", format!("{:?}", self.wind_m_per_s));
        }
        if !within(self.gain, 0.0, MOST_GAIN) {
            return bad("--gain", "0 to 1000", self.gain.to_string());
        }
        if let Some([low, high]) = self.streak_px
            && !(low >= 1.0 && high > low && high.is_finite())
        {
            return bad("--streak-px", "1 or more, the longest above the shortest", format!("{low},{high}"));
        }
        if !positive(self.sky_distance_m) {
            return bad("--sky-distance", "metres above 0", self.sky_distance_m.to_string());
        }
        if let Some(baseline) = self.baseline_m
            && !positive(baseline)
        {
            return bad("--baseline", "metres above 0", baseline.to_string());
        }
        let pair = self.right.is_some() || self.depth_kind == DepthForm::Disparity;
        if pair && self.baseline_m.is_none() {
            return bad("--baseline", "metres, which a disparity or a right camera needs", "nothing".into());
        }
        Ok(())
    }

    /// What falls at one of the rates.
    pub fn settings(&self, rate: f64) -> FrameRainSettings {
        FrameRainSettings {
            rate: MillimetresPerHour(rate),
            exposure: Seconds(self.exposure_ms * 1e-3),
            wind: DVec3::from_array(self.wind_m_per_s),
            seed: self.seed,
            gain: self.gain,
            lengths_px: self.streak_px,
            extent: Metres(self.sky_distance_m),
        }
    }

    /// Every path, with whether it is read.
    fn paths(&mut self) -> Vec<(&mut PathBuf, bool)> {
        let mut paths = vec![(&mut self.colour, true), (&mut self.depth, true), (&mut self.out, false)];
        let inputs = [&mut self.asset, &mut self.times, &mut self.pose, &mut self.environment];
        paths.extend(inputs.into_iter().flatten().map(|path| (path, true)));
        let outputs = [&mut self.mask, &mut self.transmittance, &mut self.in_scattered, &mut self.streaks];
        paths.extend(outputs.into_iter().flatten().map(|path| (path, false)));
        if let Some(right) = &mut self.right {
            paths.push((&mut right.colour, true));
            paths.push((&mut right.depth, true));
        }
        paths
    }

    /// The same job with paths as they read from `folder`.
    ///
    /// Errors: a name that is no UTF-8, which a manifest cannot hold.
    pub fn seen_from(&self, folder: &Path) -> Result<Self, BakeError> {
        let mut job = self.clone();
        for (path, _) in job.paths() {
            *path = relative(path, folder)?;
        }
        Ok(job)
    }

    /// The same job with paths that were written as they read from `folder`.
    #[must_use]
    pub fn brought_from(&self, folder: &Path) -> Self {
        let mut job = self.clone();
        for (path, _) in job.paths() {
            *path = tidy(&folder.join(&*path));
        }
        job
    }
}

/// A path as it reads from `folder`, both looked at from where this process stands; kept whole where the two share no root.
///
/// Errors: a name that is no UTF-8.
pub fn relative(path: &Path, folder: &Path) -> Result<PathBuf, BakeError> {
    if path.to_str().is_none() {
        return Err(BakeError::input(path, "name", "UTF-8, which a manifest can hold", "other bytes"));
    }
    let whole = |path: &Path| -> Result<PathBuf, BakeError> {
        let whole = std::path::absolute(path).map_err(BakeError::io(path, "find"))?;
        Ok(tidy(&whole))
    };
    let (path, folder) = (whole(path)?, whole(folder)?);
    let shared = path.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    if shared == 0 {
        return Ok(path);
    }
    let up = folder.components().skip(shared).map(|_| std::path::Component::ParentDir);
    let down = path.components().skip(shared);
    let found: PathBuf = up.chain(down).collect();
    Ok(if found.as_os_str().is_empty() { PathBuf::from(".") } else { found })
}

/// A path without `.` and without `a/..`.
fn tidy(path: &Path) -> PathBuf {
    use std::path::Component;
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if matches!(out.components().next_back(), Some(Component::Normal(_))) => {
                out.pop();
            }
            part => out.push(part),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_read_from_a_folder_leads_back_to_the_same_file() {
        for (path, folder, wanted) in [
            ("/a/b/c.png", "/a/b", "c.png"),
            ("/a/b/c.png", "/a/d/e", "../../b/c.png"),
            ("/a/./x/../b", "/a", "b"),
            ("/a", "/a", "."),
        ] {
            let found = relative(Path::new(path), Path::new(folder)).unwrap();
            assert_eq!(found, Path::new(wanted));
            assert_eq!(tidy(&Path::new(folder).join(found)), tidy(Path::new(path)));
        }
        assert_eq!(tidy(Path::new("../x/./y/..")), Path::new("../x"));
    }
}
