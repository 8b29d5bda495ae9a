//! What is written for a frame: encoded first, all of it, so that what is not to be written is known before anything is.

use super::{Pair, Refusal, Work, key};
use crate::error::BakeError;
use crate::frames::job::relative;
use crate::frames::layers::{self, Ending, encode_light, encode_share_file, ending};
use crate::frames::manifest::{FrameRecord, OutputRecord};
use crate::frames::plan::{Kind, Step, StepCamera};
use crate::frames::stream::{Stream, lines};
use crate::input::picture::frame::FrameKind;
use squall_runtime::frame_rain::TakenFrame;
use squall_runtime::picture::Picture;
use std::collections::HashMap;
use std::path::PathBuf;

/// An output in memory.
pub struct Made {
    kind: Kind,
    path: PathBuf,
    bytes: Vec<u8>,
    record: OutputRecord,
}

impl Work<'_> {
    /// Every output of the frame that was rained on last. Errors: names that tell no form.
    pub(super) fn encode(
        &self,
        (step, camera, rate): (&Step, &StepCamera, f64),
        pair: &Pair,
        taken: &TakenFrame<'_>,
        (picture, record): (&Picture, &FrameRecord),
    ) -> Result<Vec<Made>, BakeError> {
        let size = (picture.width, picture.height);
        let mut all = Vec::new();
        for kind in Kind::ALL {
            let Some(path) = self.plan.place(kind, step, camera, rate)? else { continue };
            let bytes = match kind {
                Kind::Frame => {
                    let form = match ending(&path)? {
                        Ending::Png => FrameKind::Png,
                        Ending::Exr => FrameKind::Exr,
                    };
                    pair.frame.encode(picture, form)
                }
                Kind::Mask => encode_share_file(&path, size, self.rain.mask()),
                Kind::Transmittance => encode_share_file(&path, size, self.rain.transmittance()),
                Kind::InScattered => encode_light(size, self.rain.in_scattered()),
                Kind::Streaks => lines(&self.rain, taken, record).map(String::into_bytes),
            };
            let bytes = bytes.map_err(BakeError::io(&path, "encode"))?;
            let record = OutputRecord {
                kind: kind.name().into(),
                name: relative(&path, &self.plan.folder)?,
                blake3: blake3::hash(&bytes).to_hex().to_string(),
            };
            all.push(Made { kind, path, bytes, record });
        }
        Ok(all)
    }

    /// Refuses outputs with other bytes than the manifest which is made again says. Outputs that it has none of, or in another form, it
    /// says nothing about.
    ///
    /// Errors (exit code 1): the first that differs.
    pub(super) fn check_outputs(&self, record: &FrameRecord, made: &[Made]) -> Result<(), BakeError> {
        let Some(again) = &self.given.again else { return Ok(()) };
        let Some(known) = again.frames.iter().find(|known| key(known) == key(record)) else { return Ok(()) };
        for Made { path, record: now, .. } in made {
            let same_form =
                |told: &&OutputRecord| told.kind == now.kind && told.name.extension() == now.name.extension();
            let Some(told) = known.outputs.iter().find(same_form) else { continue };
            if told.blake3 != now.blake3 {
                let what = format!(
                    "{} differs and is not written: the manifest has BLAKE3 {}, its settings give {}",
                    now.kind, told.blake3, now.blake3
                );
                return Err(BakeError::Different { a: self.plan.manifest.clone(), b: path.clone(), what });
            }
        }
        Ok(())
    }

    /// Writes them, notes each in `record`, and answers the length of the shared list of streaks behind the frame.
    pub(super) fn write(
        &self,
        made: Vec<Made>,
        record: &mut FrameRecord,
        streams: &mut HashMap<PathBuf, Stream>,
    ) -> Result<Option<u64>, Refusal> {
        let mut stream_bytes = None;
        for Made { kind, path, bytes, record: output } in made {
            match streams.get_mut(&path).filter(|_| kind == Kind::Streaks) {
                Some(stream) => stream_bytes = Some(stream.add(&path, &bytes)?),
                None => layers::write(&path, &bytes)?,
            }
            record.outputs.push(output);
        }
        Ok(stream_bytes)
    }
}
