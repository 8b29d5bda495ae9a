//! What tells a frame that was drawn with these settings from any other: a hash in its file, by which `--resume` knows what to keep.

use squall_bake::input::Input;
use squall_bake::input::picture::note_of;
use squall_bake::picture::Note;
use squall_bake::provenance::tool;
use squall_runtime::Frame;
use squall_runtime::tone::Tone;

/// Keyword of a PNG's text chunk, name of an OpenEXR's attribute.
const KEYWORD: &str = "squall frame";

/// Hashes all that a frame's light follows from: program, asset, development, and the frame itself with its weather and flashes.
/// Layers are not among it: which a file has, its channels say. Nor is what draws: a graphics card draws the same picture within its tolerances.
pub struct Marks(blake3::Hasher);

impl Marks {
    /// Takes in what all frames share. `asset` is its bytes, `dry` whether its ground was dried.
    pub fn new(asset: &[u8], tone: &Tone, dry: bool) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(blake3::hash(asset).as_bytes());
        hasher.update(format!("{}\n{tone:?}\n", tool()).as_bytes());
        if dry {
            hasher.update(b"dry ground");
        }
        Self(hasher)
    }

    /// The mark of one frame.
    pub fn of(&self, frame: &Frame) -> Mark {
        let mut hasher = self.0.clone();
        // Written out, numbers are exact: two that differ are written differently.
        hasher.update(format!("{frame:?}").as_bytes());
        Mark(hasher.finalize().to_hex().to_string())
    }
}

/// What stands in a frame's file.
pub struct Mark(String);

impl Mark {
    /// As a note of a picture's file.
    pub fn note(&self) -> Note<'_> {
        Note { keyword: KEYWORD, text: &self.0 }
    }

    /// Whether a picture bears it.
    pub fn is_on(&self, input: &Input) -> bool {
        note_of(input, KEYWORD).as_deref() == Some(&self.0)
    }
}
