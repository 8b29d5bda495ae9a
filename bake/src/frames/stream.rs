//! Lists of streaks: a line of JSON each, in a file of the frame's own or in one that a whole sequence shares.

use super::journal;
use super::manifest::FrameRecord;
use crate::error::BakeError;
use serde::Serialize;
use squall_runtime::frame_rain::{FrameRain, StreakLabel, TakenFrame};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A list of streaks that several frames share, in the making.
pub struct Stream {
    part: PathBuf,
    file: File,
    bytes: u64,
}

impl Stream {
    /// Opens the list in the making behind its first `bytes`; from 0 it is a new one.
    ///
    /// Errors: the system's refusals; a list that is shorter, which would have to grow by bytes that nothing wrote.
    pub fn open(path: &Path, bytes: u64) -> Result<Self, BakeError> {
        let part = journal::path_of(path);
        let open = || -> std::io::Result<File> {
            let mut file = File::options().create(bytes == 0).truncate(false).write(true).open(&part)?;
            let found = file.metadata()?.len();
            if found < bytes {
                let words = format!("it holds {found} of the {bytes} bytes that are kept");
                return Err(std::io::Error::new(std::io::ErrorKind::UnexpectedEof, words));
            }
            file.set_len(bytes)?;
            file.seek(SeekFrom::Start(bytes))?;
            Ok(file)
        };
        let file = open().map_err(BakeError::io(&part, "write"))?;
        Ok(Self { part, file, bytes })
    }

    /// Whether the list of `path`, in the making, has lines of this hash at `range`.
    pub fn holds(path: &Path, range: Range<u64>, blake3: &str) -> bool {
        let read = || -> std::io::Result<bool> {
            let mut file = File::open(journal::path_of(path))?;
            if range.start > range.end || file.metadata()?.len() < range.end {
                return Ok(false);
            }
            file.seek(SeekFrom::Start(range.start))?;
            let mut text = Vec::new();
            file.take(range.end - range.start).read_to_end(&mut text)?;
            Ok(blake3::hash(&text).to_hex().as_str() == blake3)
        };
        read().unwrap_or(false)
    }

    /// Adds lines and answers the length behind them.
    pub fn add(&mut self, path: &Path, text: &[u8]) -> Result<u64, BakeError> {
        self.file.write_all(text).map_err(BakeError::io(path, "write"))?;
        self.bytes += text.len() as u64;
        Ok(self.bytes)
    }

    /// The list is not to be: what was written of it goes.
    ///
    /// Errors: the system's refusals.
    pub fn drop_part(self, path: &Path) -> Result<(), BakeError> {
        std::fs::remove_file(&self.part).map_err(BakeError::io(path, "remove what was written beside"))
    }

    /// The list is whole: it takes its name.
    ///
    /// Errors: the system's refusals.
    pub fn end(self, path: &Path) -> Result<(), BakeError> {
        self.file.sync_all().map_err(BakeError::io(path, "write"))?;
        std::fs::rename(&self.part, path).map_err(BakeError::io(path, "rename into place"))
    }
}

/// A streak as a line of a list.
#[derive(Serialize)]
struct Line<'a> {
    frame: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    camera: Option<&'a str>,
    id: String,
    diameter_mm: f32,
    distance_m: f32,
    depth_m: f32,
    ends_px: [[f32; 2]; 2],
    width_px: f32,
    alpha: f32,
    visible: f32,
}

/// The streaks of a frame that was just rained on.
pub fn lines(rain: &FrameRain, taken: &TakenFrame<'_>, record: &FrameRecord) -> std::io::Result<String> {
    let mut text = String::new();
    for label in rain.labels(taken) {
        let StreakLabel { id, diameter_mm, distance_m, depth_m, ends_px, width_px, alpha, visible } = label;
        let line = Line {
            frame: &record.frame,
            camera: record.camera.as_deref(),
            // More bits than a number of JSON holds.
            id: format!("{id:016x}"),
            diameter_mm: diameter_mm as f32,
            distance_m: distance_m as f32,
            depth_m: depth_m as f32,
            ends_px: ends_px.map(|end| end.map(|value| value as f32)),
            width_px: width_px as f32,
            alpha: alpha as f32,
            visible: visible as f32,
        };
        text += &serde_json::to_string(&line)?;
        text.push('\n');
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_goes_on_behind_what_is_kept_and_never_grows_by_bytes_that_nothing_wrote() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("all.jsonl");
        std::fs::write(journal::path_of(&path), b"one\ntwo\nthr").unwrap();
        let hash = |text: &[u8]| blake3::hash(text).to_hex().to_string();
        assert!(Stream::holds(&path, 4..8, &hash(b"two\n")) && !Stream::holds(&path, 0..4, &hash(b"two\n")));
        assert!(!Stream::holds(&path, 8..12, &hash(b"thr")));
        let mut stream = Stream::open(&path, 4).unwrap();
        assert_eq!(stream.add(&path, b"2\n").unwrap(), 6);
        stream.end(&path).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one\n2\n");
        // Its part has gone: nothing can stand in the place of what it held.
        assert!(Stream::open(&path, 6).is_err());
        std::fs::write(journal::path_of(&path), b"one\n").unwrap();
        assert!(Stream::open(&path, 6).is_err_and(|error| error.to_string().contains("4 of the 6 bytes")));
        assert_eq!(std::fs::read(&path).unwrap(), b"one\n2\n");
    }
}
