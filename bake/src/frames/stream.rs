//! Lists of streaks: a line of JSON each, in a file of the frame's own or in one that a whole sequence shares.

use super::journal;
use super::manifest::FrameRecord;
use crate::error::BakeError;
use serde::Serialize;
use squall_runtime::frame_rain::{FrameRain, StreakLabel, TakenFrame};
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A list of streaks that several frames share, in the making.
pub struct Stream {
    part: PathBuf,
    file: File,
    bytes: u64,
}

impl Stream {
    /// Opens the list in the making behind its first `bytes`.
    pub fn open(path: &Path, bytes: u64) -> Result<Self, BakeError> {
        let part = journal::path_of(path);
        let open = || -> std::io::Result<File> {
            let mut file = File::options().create(true).truncate(false).write(true).open(&part)?;
            file.set_len(bytes)?;
            file.seek(SeekFrom::Start(bytes))?;
            Ok(file)
        };
        let file = open().map_err(BakeError::io(&part, "write"))?;
        Ok(Self { part, file, bytes })
    }

    /// Adds lines and answers the length behind them.
    pub fn add(&mut self, path: &Path, text: &[u8]) -> Result<u64, BakeError> {
        self.file.write_all(text).map_err(BakeError::io(path, "write"))?;
        self.bytes += text.len() as u64;
        Ok(self.bytes)
    }

    /// The list is whole: it gets its name.
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
