//! Sequences of frames: one file, a folder, or a pattern in which #### stands for a frame's number.

use crate::error::BakeError;
use std::path::{Path, PathBuf};

/// Most frames of a sequence.
const MAX_FRAMES: usize = 1 << 20;

/// One frame's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameFile {
    /// The file.
    pub path: PathBuf,
    /// Its name without the extension.
    pub stem: String,
    /// The number that it is called by: a pattern's, or the digits that its name ends with.
    pub number: Option<u64>,
}

/// What a path stands for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Frames {
    /// One file.
    One(FrameFile),
    /// A folder's files, by name, or a pattern's, by number.
    Many(Vec<FrameFile>),
}

/// A name with one run of # in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    before: String,
    digits: usize,
    after: String,
}

impl Pattern {
    /// The pattern that a file name is; `None` for a name without #.
    ///
    /// Errors: several runs of #, more than 18 in one.
    pub fn of(path: &Path) -> Result<Option<Self>, BakeError> {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let Some(start) = name.find('#') else { return Ok(None) };
        let digits = name[start..].chars().take_while(|&c| c == '#').count();
        let (before, after) = (name[..start].to_owned(), name[start + digits..].to_owned());
        if after.contains('#') || digits > 18 {
            let wanted = "one run of at most 18 # in a name";
            return Err(BakeError::input(path, "pattern", wanted, format!("\"{name}\"")));
        }
        Ok(Some(Self { before, digits, after }))
    }

    /// The name of frame `number`, padded with zeros to as many digits as there are #.
    pub fn name(&self, number: u64) -> String {
        let digits = self.digits;
        format!("{}{number:0digits$}{}", self.before, self.after)
    }

    /// The number that a name holds in the place of #; `None` for another name. More digits than # are a number too large for them.
    pub fn number(&self, name: &str) -> Option<u64> {
        let digits = name.strip_prefix(self.before.as_str())?.strip_suffix(self.after.as_str())?;
        let whole = digits.len() == self.digits || digits.len() > self.digits && !digits.starts_with('0');
        (whole && digits.bytes().all(|byte| byte.is_ascii_digit())).then(|| digits.parse().ok())?
    }
}

fn frame(path: PathBuf, number: Option<u64>) -> FrameFile {
    let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let digits = stem.len() - stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    let number = number.or_else(|| stem[stem.len() - digits..].parse().ok());
    FrameFile { path, stem, number }
}

/// The frames that `path` stands for; of a folder, the files whose names end in one of `extensions`.
///
/// Errors: no such folder, a folder or pattern without frames, more than 2²⁰, a name in it that is no UTF-8.
pub fn find_frames(path: &Path, extensions: &[&str]) -> Result<Frames, BakeError> {
    let pattern = Pattern::of(path)?;
    let is_folder = pattern.is_none() && path.is_dir();
    if pattern.is_none() && !is_folder {
        return Ok(Frames::One(frame(path.to_owned(), None)));
    }
    let folder = if is_folder { path } else { crate::output::folder_of(path) };
    let mut found = Vec::new();
    for entry in folder.read_dir().map_err(BakeError::io(folder, "list"))? {
        let entry = entry.map_err(BakeError::io(folder, "list"))?;
        let name = entry.file_name();
        let Some(name) = name.to_str() else { continue };
        let number = match &pattern {
            Some(pattern) => match pattern.number(name) {
                Some(number) => Some(number),
                None => continue,
            },
            None => {
                let extension = name.rsplit_once('.').map_or("", |(_, end)| end).to_ascii_lowercase();
                if name.starts_with('.') || !extensions.contains(&extension.as_str()) {
                    continue;
                }
                None
            }
        };
        if found.len() == MAX_FRAMES {
            return Err(BakeError::input(path, "frames", "at most 1048576", "more"));
        }
        found.push(frame(folder.join(name), number));
    }
    if pattern.is_some() {
        found.sort_by(|a, b| (a.number, &a.stem).cmp(&(b.number, &b.stem)));
    } else {
        found.sort_by(|a, b| a.path.cmp(&b.path));
    }
    if found.is_empty() {
        let wanted = match &pattern {
            Some(_) => "files with numbers in the place of #".to_owned(),
            None => format!("files that end in .{}", extensions.join(" or .")),
        };
        return Err(BakeError::input(path, "frames", wanted, "none"));
    }
    Ok(Frames::Many(found))
}

/// The frame of `others` that belongs to `frame`, the `index`-th of `count`: by name, by number, or, of as many, by order.
pub fn partner<'a>(
    frame: &FrameFile,
    index: usize,
    count: usize,
    others: &'a Frames,
) -> Option<&'a FrameFile> {
    let many = match others {
        Frames::One(one) => return (count == 1).then_some(one),
        Frames::Many(many) => many,
    };
    let named = many.iter().find(|other| other.stem == frame.stem);
    let numbered = || {
        let number = frame.number?;
        let mut same = many.iter().filter(|other| other.number == Some(number));
        same.next().filter(|_| same.next().is_none())
    };
    named.or_else(numbered).or_else(|| if many.len() == count { many.get(index) } else { None })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            std::fs::write(folder.path().join(name), b"").unwrap();
        }
        folder
    }

    fn names(frames: &Frames) -> Vec<String> {
        let Frames::Many(many) = frames else { return Vec::new() };
        many.iter().map(|frame| frame.path.file_name().unwrap().to_str().unwrap().to_owned()).collect()
    }

    #[test]
    fn a_pattern_takes_numbers_in_their_order_and_no_other_name() {
        let folder = folder(&[
            "f0010.png",
            "f0009.png",
            "f10000.png",
            "f00011.png",
            "f001.png",
            "fx010.png",
            "f0010.exr",
        ]);
        let found = find_frames(&folder.path().join("f####.png"), &["png"]).unwrap();
        assert_eq!(names(&found), ["f0009.png", "f0010.png", "f10000.png"]);
        let pattern = Pattern::of(Path::new("a/f####.png")).unwrap().unwrap();
        assert_eq!((pattern.name(7), pattern.name(123_456)), ("f0007.png".into(), "f123456.png".into()));
        assert!(Pattern::of(Path::new("a##b#.png")).is_err());
        assert_eq!(Pattern::of(Path::new("a#/b.png")).unwrap(), None);
    }

    #[test]
    fn a_folder_takes_its_pictures_by_name_and_nothing_else() {
        let folder = folder(&["b2.png", "a10.PNG", "notes.txt", ".hidden.png", "c.exr"]);
        let found = find_frames(folder.path(), &["png", "exr"]).unwrap();
        assert_eq!(names(&found), ["a10.PNG", "b2.png", "c.exr"]);
        let Frames::Many(many) = &found else { panic!() };
        assert_eq!(many.iter().map(|frame| frame.number).collect::<Vec<_>>(), [Some(10), Some(2), None]);
        let error = find_frames(folder.path(), &["npy"]).unwrap_err().to_string();
        assert!(error.contains(".npy") && error.contains("found none"), "{error}");
    }

    #[test]
    fn partners_share_a_name_a_number_or_a_place() {
        let of = |names: &[&str]| {
            Frames::Many(names.iter().map(|name| frame(PathBuf::from(name), None)).collect())
        };
        let a = frame(PathBuf::from("rgb/000002.png"), None);
        let path = |others: &Frames, index, count| {
            partner(&a, index, count, others).map(|found| found.path.to_str().unwrap().to_owned())
        };
        assert_eq!(path(&of(&["000001.npy", "000002.npy"]), 0, 9).as_deref(), Some("000002.npy"));
        assert_eq!(path(&of(&["depth1.npy", "depth2.npy"]), 0, 9).as_deref(), Some("depth2.npy"));
        assert_eq!(path(&of(&["x.npy", "y.npy", "z.npy"]), 1, 3).as_deref(), Some("y.npy"));
        assert_eq!(path(&of(&["x.npy", "y.npy"]), 1, 3), None);
        let one = Frames::One(frame(PathBuf::from("d.npy"), None));
        assert_eq!((path(&one, 0, 1).as_deref(), path(&one, 0, 2)), (Some("d.npy"), None));
    }
}
