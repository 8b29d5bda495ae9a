//! Wet frames into files: the picture, and every effect as a layer beside it.

use crate::cli::picture::Format;
use squall_bake::BakeError;
use squall_bake::input::Input;
use squall_bake::input::picture::{exr_channel, is_exr, note_of, picture_file, rgb_of};
use squall_bake::picture::{ChannelValues, Note, encode_layers, encode_png8_noted};
use squall_bake::provenance::tool;
use squall_runtime::picture::Picture;
use squall_runtime::tone::Tone;
use squall_runtime::wet::draw::{WetRenderer, WetSettings};
use squall_runtime::wet::frame::WetFrame;
use std::path::Path;

/// Keyword of a PNG's text chunk, name of an OpenEXR's attribute.
const KEYWORD: &str = "squall wet";

/// What a file is made of: a hash of program, inputs, settings and development, by which `--resume` knows what to keep.
pub struct Mark(String);

impl Mark {
    /// Of a frame whose buffers are `input`. All that is said in `rest` counts as well.
    pub fn of((input, asset): (&Input, &[u8]), settings: &WetSettings, rest: &str) -> Self {
        let mut hasher = blake3::Hasher::new();
        for bytes in [input.bytes.as_slice(), asset] {
            hasher.update(blake3::hash(bytes).as_bytes());
        }
        // Written out, numbers are exact.
        hasher.update(format!("{}\n{settings:?}\n{rest}", tool()).as_bytes());
        Self(hasher.finalize().to_hex().to_string())
    }

    fn note(&self) -> Note<'_> {
        Note { keyword: KEYWORD, text: &self.0 }
    }

    /// Whether a file is there, whole, and bears this mark.
    pub fn is_on(&self, path: &Path) -> bool {
        let Ok(input) = picture_file(path) else { return false };
        if note_of(&input, KEYWORD).as_deref() != Some(&self.0) {
            return false;
        }
        match is_exr(&input) {
            true => exr_channel(&input, |names| names.first().cloned()).is_ok(),
            false => rgb_of(&input, None).is_ok(),
        }
    }
}

/// The last frame that `renderer` drew.
pub fn picture_of(renderer: &WetRenderer, frame: &WetFrame<'_>) -> Picture {
    let [width, height] = frame.buffer.size;
    Picture { width, height, pixels: renderer.picture().to_vec() }
}

/// Bytes of the last frame that `renderer` drew.
///
/// Errors: none that its own picture brings about.
pub fn encode(
    (renderer, frame): (&WetRenderer, &WetFrame<'_>),
    (format, layers): (Format, bool),
    tone: &Tone,
    mark: &Mark,
) -> Result<Vec<u8>, BakeError> {
    let [width, height] = frame.buffer.size;
    let failed = BakeError::io(Path::new("picture"), "encode");
    if format == Format::Png {
        return encode_png8_noted(&picture_of(renderer, frame), tone, Some(mark.note())).map_err(failed);
    }
    let mut channels: Vec<(String, ChannelValues)> = Vec::new();
    let mut add = |name: String, values: Vec<f32>| channels.push((name, ChannelValues::Floats(values)));
    let three = |prefix: &str, pixels: &[[f32; 3]], add: &mut dyn FnMut(String, Vec<f32>)| {
        for (band, letter) in ["R", "G", "B"].into_iter().enumerate() {
            add(format!("{prefix}{letter}"), pixels.iter().map(|pixel| pixel[band]).collect());
        }
    };
    three("", renderer.picture(), &mut add);
    if layers {
        for (effect, layer) in renderer.layers() {
            let prefix = format!("{}.", effect.name());
            three(&prefix, &layer.light, &mut add);
            add(format!("{prefix}A"), layer.alpha.clone());
        }
    }
    encode_layers((width, height), channels, Some(mark.note())).map_err(failed)
}
