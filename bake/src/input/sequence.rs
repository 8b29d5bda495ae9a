//! Sequences of frames: one file, a folder, or a pattern in which #### stands for a frame's number.

use crate::error::BakeError;
use std::collections::HashMap;
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

/// The frames that `path` stands for: a file or folder that is there, else a pattern; of a folder, the files whose names end in one of `extensions`.
///
/// Errors: no such file or folder, a folder or pattern without frames, more than 2²⁰, a name in it that is no UTF-8.
pub fn find_frames(path: &Path, extensions: &[&str]) -> Result<Frames, BakeError> {
    // What is there goes before what a name with # might stand for.
    let there = path.metadata();
    if there.as_ref().is_ok_and(|found| !found.is_dir()) {
        return Ok(Frames::One(frame(path.to_owned(), None)));
    }
    let is_folder = there.is_ok();
    let pattern = if is_folder { None } else { Pattern::of(path)? };
    if let (None, Err(error)) = (&pattern, there) {
        return Err(BakeError::io(path, "read")(error));
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

/// By what the files of two folders belong together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// The name before its ending.
    Name,
    /// The number in it.
    Number,
    /// Some by one, some by the other.
    NameOrNumber,
    /// The place among as many.
    Order,
}

impl Rule {
    /// The rule in words, behind "by".
    pub fn words(self) -> &'static str {
        match self {
            Self::Name => "name",
            Self::Number => "number",
            Self::NameOrNumber => "name, else by number",
            Self::Order => "order: no name or number is the same",
        }
    }
}

/// The files that belong to a sequence's frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Partners<'a> {
    /// One for each frame that has one.
    pub files: Vec<Option<&'a FrameFile>>,
    /// How they were found; `None` for one file that belongs to one frame, and where nothing belongs together.
    pub rule: Option<Rule>,
}

impl<'a> Partners<'a> {
    /// The files of `others` that belong to `frames`: by name, else by number; in order only where no frame of the whole sequence has its
    /// name or number among them and there are as many. (Where some have, order would give a frame another one's file.)
    pub fn find(frames: &[Option<&FrameFile>], others: &'a Frames) -> Self {
        let many = match others {
            Frames::One(one) => {
                let files = frames.iter().map(|frame| frame.filter(|_| frames.len() == 1).map(|_| one));
                return Self { files: files.collect(), rule: None };
            }
            Frames::Many(many) => many,
        };
        let mut names: HashMap<&str, &FrameFile> = HashMap::new();
        let mut numbers: HashMap<u64, Option<&FrameFile>> = HashMap::new();
        for other in many {
            names.entry(&other.stem).or_insert(other);
            if let Some(number) = other.number {
                // A number that two are called by is nobody's.
                numbers.entry(number).and_modify(|known| *known = None).or_insert(Some(other));
            }
        }
        let (mut by_name, mut by_number) = (false, false);
        let mut of = |frame: &FrameFile| {
            let named = names.get(frame.stem.as_str()).copied();
            let numbered = || numbers.get(&frame.number?).copied().flatten();
            let found = named.or_else(numbered);
            by_name |= named.is_some();
            by_number |= named.is_none() && found.is_some();
            found
        };
        let files: Vec<_> = frames.iter().map(|frame| frame.and_then(&mut of)).collect();
        let rule = match (by_name, by_number) {
            (true, true) => Some(Rule::NameOrNumber),
            (true, false) => Some(Rule::Name),
            (false, true) => Some(Rule::Number),
            (false, false) if many.len() == frames.len() => {
                let files = frames.iter().zip(many).map(|(frame, other)| frame.map(|_| other)).collect();
                return Self { files, rule: Some(Rule::Order) };
            }
            (false, false) => None,
        };
        Self { files, rule }
    }
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
    fn partners_share_a_name_or_a_number_and_a_place_only_where_no_frame_shares_either() {
        let of = |names: &[&str]| -> Vec<FrameFile> {
            names.iter().map(|name| frame(PathBuf::from(name), None)).collect()
        };
        let check = |frames: &[&str], others: &[&str], rule: Option<Rule>, wanted: &[Option<&str>]| {
            let (frames, others) = (of(frames), Frames::Many(of(others)));
            let all: Vec<Option<&FrameFile>> = frames.iter().map(Some).collect();
            let found = Partners::find(&all, &others);
            let names: Vec<_> = found.files.iter().map(|file| file.as_ref()?.path.to_str()).collect();
            assert_eq!((names.as_slice(), found.rule), (wanted, rule), "{frames:?} {others:?}");
        };
        let frames = ["1.png", "2.png", "3.png"];
        check(&frames, &["2.npy", "3.npy"], Some(Rule::Name), &[None, Some("2.npy"), Some("3.npy")]);
        check(&frames, &["d3.npy", "d1.npy"], Some(Rule::Number), &[Some("d1.npy"), None, Some("d3.npy")]);
        check(
            &frames,
            &["1.npy", "d3.npy"],
            Some(Rule::NameOrNumber),
            &[Some("1.npy"), None, Some("d3.npy")],
        );
        let order = [Some("x.npy"), Some("y.npy"), Some("z.npy")];
        check(&frames, &["x.npy", "y.npy", "z.npy"], Some(Rule::Order), &order);
        check(&frames, &["x.npy", "y.npy"], None, &[None; 3]);
        // As many, but one of them is another frame's: the frame without a depth has none, and not its neighbour's.
        check(&frames, &["1.npy", "3.npy", "4.npy"], Some(Rule::Name), &[Some("1.npy"), None, Some("3.npy")]);
        check(&["1.png"], &["a1.npy", "b1.npy"], None, &[None]);
        let (one, two) = (Frames::One(frame(PathBuf::from("d.npy"), None)), of(&["a.png", "b.png"]));
        let all: Vec<Option<&FrameFile>> = two.iter().map(Some).collect();
        assert_eq!(Partners::find(&all[..1], &one).files[0].unwrap().path, Path::new("d.npy"));
        assert_eq!(Partners::find(&all, &one).files, [None, None]);
    }
}
