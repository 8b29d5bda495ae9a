//! Where cameras stood: files of poses as the TUM and KITTI benchmarks write them. Both hold, a line a frame, where a camera is in the
//! world, for a camera whose x points right, y down and z along the view.
//!
//! | format | numbers a line | up in the world |
//! |---|---|---|
//! | TUM | time, x, y, z, and the quaternion x, y, z, w | +z |
//! | KITTI | the first three rows of a 4 × 4 matrix | −y, the first camera's |

use super::Input;
use super::json::read_text_input;
use super::sequence::FrameFile;
use crate::error::BakeError;
use serde::{Deserialize, Serialize};
use squall_runtime::glam::{DMat3, DQuat, DVec3};
use std::path::Path;

/// Most poses of a file.
const MAX_POSES: usize = 1 << 20;
/// A rotation that is off by more than this is none, or another format's.
const SKEW: f64 = 1e-2;
/// A frame's time and its pose's may differ by this, s: half of what a camera of 25 frames a second takes from one to the next.
const MOST_APART_S: f64 = 0.02;

/// One camera's place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Time, where the file has any, s.
    pub time: Option<f64>,
    /// The camera's centre, m, z up.
    pub position: DVec3,
    /// Unit vector along the view.
    pub forward: DVec3,
    /// Unit vector towards the picture's top.
    pub up: DVec3,
}

/// Which way is up in a file of poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpAxis {
    /// As the file's format has it.
    #[default]
    Format,
    /// +y.
    PlusY,
    /// −y.
    MinusY,
    /// +z.
    PlusZ,
    /// −z.
    MinusZ,
}

impl UpAxis {
    /// The axis of this name: y, -y, z or -z.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "y" | "+y" => Some(Self::PlusY),
            "-y" => Some(Self::MinusY),
            "z" | "+z" => Some(Self::PlusZ),
            "-z" => Some(Self::MinusZ),
            _ => None,
        }
    }

    /// Turns the file's world so that its up is +z, and its x stays.
    fn turned(self, v: DVec3) -> DVec3 {
        match self {
            Self::Format | Self::PlusZ => v,
            Self::MinusZ => DVec3::new(v.x, -v.y, -v.z),
            Self::PlusY => DVec3::new(v.x, -v.z, v.y),
            Self::MinusY => DVec3::new(v.x, v.z, -v.y),
        }
    }
}

/// A file of poses.
#[derive(Clone, Debug)]
pub struct Poses {
    /// One a line.
    pub poses: Vec<Pose>,
    /// The file as it was read.
    pub input: Input,
}

/// Reads a file of poses; its lines' length says whose format it has. Lines that begin with # are for people.
///
/// Errors: no text, no poses, more than 2²⁰, lines of another length or of different ones, words that are no finite numbers, numbers that
/// are no rotation.
pub fn read_poses(path: &Path, up: UpAxis) -> Result<Poses, BakeError> {
    let input = read_text_input(path)?;
    let text = input.text("poses (TUM or KITTI)")?;
    let mut poses: Vec<Pose> = Vec::new();
    let mut length = None;
    for (at, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let refused =
            |wanted: &str, found: String| BakeError::input(path, format!("line {}", at + 1), wanted, found);
        let mut numbers = Vec::new();
        for word in line.split_whitespace().take(13) {
            let number = word.parse::<f64>().ok().filter(|number| number.is_finite());
            numbers.push(number.ok_or_else(|| refused("finite numbers", format!("`{word}`")))?);
        }
        if length.is_some_and(|length| length != numbers.len()) {
            return Err(refused("as many numbers as the lines before", numbers.len().to_string()));
        }
        length = Some(numbers.len());
        if poses.len() == MAX_POSES {
            return Err(refused("at most 1048576 poses", "more".into()));
        }
        poses.push(pose(&numbers, up).map_err(|(wanted, found)| refused(wanted, found))?);
    }
    if poses.is_empty() {
        return Err(BakeError::input(path, "poses", "a line a frame", "none"));
    }
    Ok(Poses { poses, input })
}

fn pose(numbers: &[f64], up: UpAxis) -> Result<Pose, (&'static str, String)> {
    let (time, position, rotation, up) = match *numbers {
        [time, x, y, z, qx, qy, qz, qw] => {
            let quaternion = DQuat::from_xyzw(qx, qy, qz, qw);
            if (quaternion.length() - 1.0).abs() > SKEW {
                return Err(("a quaternion of length 1", format!("{}", quaternion.length())));
            }
            (Some(time), DVec3::new(x, y, z), DMat3::from_quat(quaternion.normalize()), up)
        }
        [a, b, c, x, d, e, f, y, g, h, i, z] => {
            let rotation = DMat3::from_cols(DVec3::new(a, d, g), DVec3::new(b, e, h), DVec3::new(c, f, i));
            let off = rotation.transpose() * rotation - DMat3::IDENTITY;
            let skew = off.to_cols_array().iter().fold(0.0, |most: f64, value| most.max(value.abs()));
            if !(skew <= SKEW && rotation.determinant() > 0.0) {
                return Err(("a rotation in columns 1 to 3", "a matrix that is none".into()));
            }
            let up = if up == UpAxis::Format { UpAxis::MinusY } else { up };
            (None, DVec3::new(x, y, z), rotation, up)
        }
        _ => {
            let wanted = "8 numbers (TUM: time, position, quaternion) or 12 (KITTI: three rows of a matrix)";
            return Err((wanted, format!("{} or more", numbers.len())));
        }
    };
    Ok(Pose {
        time,
        position: up.turned(position),
        forward: up.turned(rotation * DVec3::Z),
        up: up.turned(rotation * -DVec3::Y),
    })
}

impl Poses {
    /// Whether `count` frames find their poses by number, so that a number's distance from another one is a time.
    pub fn by_number(&self, count: usize) -> bool {
        self.poses.len() > 1 && self.poses.len() != count && self.poses[0].time.is_none()
    }

    /// The pose of the `index`-th of `count` frames: a lone pose is every frame's, as many poses as frames are theirs in order; of more,
    /// TUM's are found by the time that a frame is called by, KITTI's by its number from 0.
    ///
    /// Errors: no pose for the frame.
    pub fn of(&self, index: usize, count: usize, frame: &FrameFile) -> Result<&Pose, BakeError> {
        if let [only] = self.poses.as_slice() {
            return Ok(only);
        }
        if self.poses.len() == count {
            return Ok(&self.poses[index]);
        }
        let name = frame.path.display();
        let lines = self.poses.len();
        if self.poses[0].time.is_some() {
            let wanted = format!("one of {count} poses, or one at the time that {name} is called by");
            let refused = |found: String| BakeError::input(&self.input.path, "poses", wanted.clone(), found);
            let time: f64 =
                frame.stem.parse().map_err(|_| refused(format!("{lines}, and a name that is no time")))?;
            let apart = |pose: &Pose| pose.time.map_or(f64::INFINITY, |own| (own - time).abs());
            let nearest = self.poses.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)));
            return match nearest {
                Some(pose) if apart(pose) <= MOST_APART_S => Ok(pose),
                _ => Err(refused(format!("none within {MOST_APART_S} s"))),
            };
        }
        let found = frame.number.and_then(|number| self.poses.get(usize::try_from(number).ok()?));
        found.ok_or_else(|| {
            let wanted = format!("{count} poses, or a line for the number of {name}");
            BakeError::input(&self.input.path, "poses", wanted, format!("{lines} lines"))
        })
    }
}

/// Reads times of frames, s: a number a line, as KITTI's times.txt has them.
///
/// Errors: no text, none or more than 2²⁰, words that are no finite numbers.
pub fn read_times(path: &Path) -> Result<(Vec<f64>, Input), BakeError> {
    let input = read_text_input(path)?;
    let mut times = Vec::new();
    for (at, line) in input.text("times, a number a line")?.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let time = line.parse::<f64>().ok().filter(|time| time.is_finite());
        let refused = || {
            BakeError::input(
                path,
                format!("line {}", at + 1),
                "a finite number of seconds",
                format!("`{line}`"),
            )
        };
        times.push(time.ok_or_else(refused)?);
        if times.len() > MAX_POSES {
            return Err(BakeError::input(path, "times", "at most 1048576", "more"));
        }
    }
    if times.is_empty() {
        return Err(BakeError::input(path, "times", "a number a line", "none"));
    }
    Ok((times, input))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    /// Printed digits of a benchmark's file.
    const DIGITS: f64 = 1e-6;

    fn read(text: &str, up: UpAxis) -> Result<Poses, BakeError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.txt");
        std::fs::write(&path, text).unwrap();
        read_poses(&path, up)
    }

    fn frame(name: &str, number: Option<u64>) -> FrameFile {
        FrameFile { path: PathBuf::from(format!("{name}.png")), stem: name.into(), number }
    }

    fn near(a: DVec3, b: DVec3) -> bool {
        (a - b).length() < DIGITS
    }

    #[test]
    fn both_formats_of_one_camera_give_the_same_pose() {
        // A level camera at (1, 2, 3) that looks along the world's y with z up: x right, −z down, y ahead.
        let tum =
            read("# time x y z qx qy qz qw\n0.5 1 2 3 -0.70710678 0 0 0.70710678\n", UpAxis::Format).unwrap();
        let kitti = read("1 0 0 1 0 0 1 2 0 -1 0 3\n", UpAxis::PlusZ).unwrap();
        for poses in [&tum, &kitti] {
            let pose = poses.poses[0];
            assert!(near(pose.position, DVec3::new(1.0, 2.0, 3.0)), "{pose:?}");
            assert!(near(pose.forward, DVec3::Y) && near(pose.up, DVec3::Z), "{pose:?}");
        }
        assert_eq!((tum.poses[0].time, kitti.poses[0].time), (Some(0.5), None));
    }

    #[test]
    fn kittis_first_camera_is_level_and_the_world_turns_with_the_axis_that_is_up() {
        let pose = read("1 0 0 2 0 1 0 -1 0 0 1 5", UpAxis::Format).unwrap().poses[0];
        assert!(near(pose.forward, DVec3::Y) && near(pose.up, DVec3::Z));
        assert!(near(pose.position, DVec3::new(2.0, 5.0, 1.0)));
        for (name, right_up) in [("y", -DVec3::Z), ("-y", DVec3::Z), ("z", -DVec3::Y), ("-z", DVec3::Y)] {
            let pose = read("1 0 0 0 0 1 0 0 0 0 1 0", UpAxis::from_name(name).unwrap()).unwrap().poses[0];
            assert!(near(pose.up, right_up), "{name}: {pose:?}");
            // A turn, not a mirror.
            assert!(near(pose.forward.cross(pose.up), DVec3::X), "{name}");
        }
        assert_eq!(UpAxis::from_name("up"), None);
    }

    #[test]
    fn frames_find_their_poses_in_order_by_time_or_by_number() {
        let tum =
            read("1.00 0 0 0 0 0 0 1\n1.03 1 0 0 0 0 0 1\n1.06 2 0 0 0 0 0 1\n", UpAxis::Format).unwrap();
        assert_eq!(tum.of(1, 3, &frame("a", None)).unwrap().position.x, 1.0);
        assert_eq!(tum.of(0, 2, &frame("1.055", None)).unwrap().position.x, 2.0);
        assert!(tum.of(0, 2, &frame("1.2", None)).unwrap_err().to_string().contains("within"));
        assert!(tum.of(0, 2, &frame("a", None)).is_err());
        let kitti = read("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 4 0 1 0 0 0 0 1 0\n", UpAxis::Format).unwrap();
        assert_eq!(kitti.of(0, 1, &frame("000001", Some(1))).unwrap().position.x, 4.0);
        assert!(kitti.of(0, 1, &frame("000002", Some(2))).is_err());
    }

    #[test]
    fn what_is_no_pose_is_refused_by_its_line() {
        for (text, words) in [
            ("", "none"),
            ("# nothing\n", "none"),
            ("1 2 3\n", "line 1: wanted 8 numbers"),
            ("1 2 3 4 5 6 7 8 9 10 11 12 13 14\n", "line 1: wanted 8 numbers"),
            ("0 0 0 0 0 0 0 1\n0 0 x 0 0 0 0 1\n", "line 2: wanted finite numbers, found `x`"),
            ("0 0 nan 0 0 0 0 1\n", "`nan`"),
            ("0 0 0 0 0 0 0 1\n1 0 0 0 0 1 0 0 0 0 1 0\n", "as many numbers"),
            ("0 0 0 0 0 0 0 0.5\n", "length 1"),
            ("2 0 0 0 0 1 0 0 0 0 1 0\n", "a rotation"),
            ("-1 0 0 0 0 1 0 0 0 0 1 0\n", "a rotation"),
        ] {
            let error = read(text, UpAxis::Format).unwrap_err().to_string();
            assert!(error.contains(words), "{text:?}: {error}");
        }
    }
}
