//! All frames of a wet sequence in one animated PNG, each encoded as it comes.

use super::{Args, json};
use crate::cli::render::animation::{Animation, delay_of, scratch_for};
use squall_bake::BakeError;
use squall_bake::output::Output;
use std::fs::File;
use std::io::Seek;
use std::path::{Path, PathBuf};

/// One picture for all frames.
pub struct Animated {
    output: Output,
    out: PathBuf,
    delay: (u16, u16),
    /// Begun with the first frame, whose size all have.
    begun: Option<(File, Animation, [usize; 2])>,
}

impl Animated {
    /// Tries its place. Errors: a name that no animated PNG has, a rate that the format has no time for; the system's refusals. Ends the command where there is one frame.
    pub fn of(args: &Args, out: &Path, many: bool) -> Result<Self, BakeError> {
        if !many {
            json::usage("an animated picture has many frames: --frames A..B, or a pattern of buffers");
        }
        let delay = delay_of(out, args.fps)?;
        Ok(Self { output: Output::prepare(out)?, out: out.to_owned(), delay, begun: None })
    }

    /// Takes a developed frame, one of `count`. Errors: one of another size than the first; the system's refusals.
    pub fn add(&mut self, (size, pixels): ([usize; 2], &[[u8; 3]]), count: usize) -> Result<(), BakeError> {
        let failed = || BakeError::io(&self.out, "write");
        if self.begun.is_none() {
            let file = scratch_for(&self.out)?;
            let sides = size.map(|side| side as u32);
            let animation = Animation::begin(&file, sides, count as u32, self.delay).map_err(failed())?;
            self.begun = Some((file, animation, size));
        }
        let failed = BakeError::io(&self.out, "write");
        let Some((_, animation, first)) = &mut self.begun else { return Ok(()) };
        if *first != size {
            let wanted = format!("{} × {} px as the first frame has", first[0], first[1]);
            return Err(BakeError::input(&self.out, "frame", wanted, format!("{} × {}", size[0], size[1])));
        }
        animation.add(pixels).map_err(failed)
    }

    /// Writes the picture. Errors: the system's refusals.
    pub fn end(self) -> Result<(), BakeError> {
        let Some((file, animation, _)) = self.begun else { return Ok(()) };
        animation.end().map_err(BakeError::io(&self.out, "write"))?;
        self.output.write(|out| {
            let mut whole = &file;
            whole.rewind()?;
            std::io::copy(&mut whole, out).map(|_| ())
        })
    }
}
