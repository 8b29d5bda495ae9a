//! What a run takes over from an earlier one that was stopped.

use super::{Key, Work, key};
use crate::error::BakeError;
use crate::frames::journal::{self, Entry, Heading};
use crate::frames::manifest::{FileRecord, FrameRecord, Manifest};
use crate::frames::plan::{Kind, Step, StepCamera};
use crate::frames::stream::Stream;
use crate::provenance::fingerprint;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

impl Work<'_> {
    /// What an earlier run of the same settings made of the same inputs and is still there, whole.
    pub fn earlier(&mut self, journal: &Path, heading: &Heading) -> Vec<Entry> {
        let entries = self.earlier_whole(journal, heading);
        if entries.is_empty() && self.plan.is_shared(Kind::Streaks) && self.plan.manifest.exists() {
            self.notes.push(
                "nothing is kept of a run that came to its end beside one list of streaks for all frames"
                    .into(),
            );
        }
        entries
    }

    fn earlier_whole(&self, journal: &Path, heading: &Heading) -> Vec<Entry> {
        let mut entries = journal::read(journal, heading);
        let shared = self.plan.is_shared(Kind::Streaks);
        if entries.is_empty()
            && !shared
            && let Ok(done) = Manifest::read(&self.plan.manifest)
            && done.tool == heading.tool
            && (&done.settings, &done.asset, &done.inputs, &done.light)
                == (&heading.settings, &heading.asset, &heading.inputs, &heading.light)
        {
            entries.extend(done.frames.into_iter().map(|record| Entry { record, stream_bytes: None }));
        }
        let planned: HashMap<Key, (&Step, &StepCamera)> =
            self.plan.cells().map(|cell| (cell.key(), (cell.step, cell.camera))).collect();
        let mut ends = HashMap::new();
        let mut whole = |entry: &Entry| {
            let Some(&(step, camera)) = planned.get(&key(&entry.record)) else { return false };
            entry.record.error.is_none()
                && self.reads_the_same(&entry.record, step, camera)
                && self.wrote_the_same(entry, &mut ends)
        };
        match shared {
            // Lines of a shared list follow each other: what comes behind a gap is made again.
            true => entries.into_iter().take_while(|entry| whole(entry)).collect(),
            false => entries.into_iter().filter(|entry| whole(entry)).collect(),
        }
    }

    /// Whether a frame would be made of the very bytes that it was made of, at the same time.
    fn reads_the_same(&self, record: &FrameRecord, step: &Step, camera: &StepCamera) -> bool {
        let same = |known: &Option<FileRecord>, now: &Option<PathBuf>| {
            known.as_ref().zip(now.as_ref()).is_some_and(|(known, now)| has_hash(now, &known.blake3))
        };
        let time = self.time(step).is_ok_and(|time| time.to_bits() == record.time_s.to_bits());
        time && same(&record.colour, &camera.colour) && same(&record.depth, &camera.depth)
    }

    /// Whether what was written for a frame is there, its lines in a shared list of streaks among it. `ends` has, by list, where the lines
    /// of the frames before it end.
    fn wrote_the_same(&self, entry: &Entry, ends: &mut HashMap<PathBuf, u64>) -> bool {
        let shared = self.plan.is_shared(Kind::Streaks);
        entry.record.outputs.iter().all(|output| {
            if !(shared && output.kind == Kind::Streaks.name()) {
                return has_hash(&self.plan.folder.join(&output.name), &output.blake3);
            }
            let (Some(end), Some(list)) = (entry.stream_bytes, self.stream_of(&entry.record)) else {
                return false;
            };
            let start = ends.insert(list.clone(), end).unwrap_or(0);
            Stream::holds(&list, start..end, &output.blake3)
        })
    }

    /// Shared lists of streaks, open behind what is kept of them.
    pub fn streams(&self, entries: &[Entry]) -> Result<HashMap<PathBuf, Stream>, BakeError> {
        let mut streams = HashMap::new();
        if !self.plan.is_shared(Kind::Streaks) {
            return Ok(streams);
        }
        for (kind, path) in self.plan.all_places()? {
            if kind != Kind::Streaks || streams.contains_key(&path) {
                continue;
            }
            let of_path = |entry: &&Entry| self.stream_of(&entry.record).as_ref() == Some(&path);
            let length = entries.iter().filter(of_path).filter_map(|entry| entry.stream_bytes).next_back();
            streams.insert(path.clone(), Stream::open(&path, length.unwrap_or(0))?);
        }
        Ok(streams)
    }

    fn stream_of(&self, record: &FrameRecord) -> Option<PathBuf> {
        let step = self.plan.steps.first()?;
        self.plan.place(Kind::Streaks, step, &step.cameras[0], record.rate_mm_per_h).ok()?
    }
}

fn has_hash(path: &Path, blake3: &str) -> bool {
    fingerprint(path).is_ok_and(|print| blake3::Hash::from(print.hash).to_hex().as_str() == blake3)
}
