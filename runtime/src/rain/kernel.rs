//! How one streak's coverage lies on pixels: the seam between drops and patterns.

use super::tile_buffer::{Paint, TileBuffer};

/// A streak's place in the picture, and nothing else: what a kernel draws.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Footprint {
    /// Middle of the drawn path, px; pixel (i, j) has its centre at (i + ½, j + ½).
    pub centre: [f64; 2],
    /// Unit vector from where the drop was when the shutter opened to where it was when it closed.
    pub axis: [f64; 2],
    /// Path of the drop's centre, px, ≥ 0; the drawn streak is longer by one width.
    pub length: f64,
    /// The drop's diameter, px, > 0; often well below 1.
    pub width: f64,
    /// Which pattern: uniform 32 bits, the same for a drop's whole life.
    pub pattern: u32,
    /// The drop's diameter, mm; 0 where it is not known.
    pub diameter_mm: f64,
    /// Elevation of the line of sight, degrees.
    pub elevation_deg: f64,
    /// Share of one light in all that lights the drop, and the angle between the line of sight and the way to it, degrees.
    pub light: [f64; 2],
}

/// A rectangle of pixels, right and bottom excluded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Clip {
    /// First column.
    pub left: i32,
    /// First row.
    pub top: i32,
    /// Column after the last.
    pub right: i32,
    /// Row after the last.
    pub bottom: i32,
}

/// Some pixels of one row, on their way from a kernel into the picture.
#[derive(Clone, Copy, Debug)]
pub struct Span<'a> {
    /// Column of the first pixel.
    pub x: i32,
    /// Row.
    pub y: i32,
    /// How many pixels are meant, ≥ 1, all of them inside the clip.
    pub count: usize,
    /// Their shares of the streak's light, padded to a multiple of four; what pads is not read.
    pub shares: &'a [f32],
    /// Their shares of the streak's coverage, padded likewise; `None` where they are those of its light.
    pub covers: Option<&'a [f32]>,
}

/// Pixels that are worked on together.
pub const BLOCK: usize = 4;

/// A streak's lines inside a clip, side by side: what a kernel hands over at once where it can.
///
/// All lines have the same number of blocks of [`BLOCK`] pixels, and may begin before the clip and end beyond it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ribbon {
    /// Whether lines are columns of pixels; rows otherwise.
    pub columns: bool,
    /// Row (or column) of the first line.
    pub line: i32,
    /// Blocks of a line.
    pub blocks: usize,
    /// Column (or row) of each line's first pixel.
    pub first: Vec<i32>,
    /// Shares as in [`Span::shares`], line by line and block by block; what is below 0 is none.
    pub shares: Vec<[f32; BLOCK]>,
    /// Shares of the coverage, in the same order.
    pub covers: Vec<[f32; BLOCK]>,
}

impl Ribbon {
    /// Makes room for the lines from `lines[0]` to before `lines[1]`; what they hold is then to be written.
    pub fn begin(&mut self, columns: bool, lines: [i32; 2], blocks: usize) {
        let count = usize::try_from(lines[1].saturating_sub(lines[0])).unwrap_or(0);
        (self.columns, self.line, self.blocks) = (columns, lines[0], blocks);
        self.first.resize(count, 0);
        self.shares.resize(count * blocks, [0.0; BLOCK]);
        self.covers.resize(count * blocks, [0.0; BLOCK]);
    }

    /// Its lines: row (or column), first pixel, shares of light and of coverage.
    pub fn lines(&self) -> impl Iterator<Item = (i32, i32, [&[[f32; BLOCK]]; 2])> {
        let numbered = (self.line..).zip(&self.first);
        // No blocks, no lines.
        let [shares, covers] =
            [&self.shares, &self.covers].map(|blocks| blocks.chunks_exact(self.blocks.max(1)));
        numbered
            .zip(shares.zip(covers))
            .map(|((line, &first), (shares, covers))| (line, first, [shares, covers]))
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> usize {
        self.first.capacity() * size_of::<i32>()
            + (self.shares.capacity() + self.covers.capacity()) * size_of::<[f32; BLOCK]>()
    }
}

/// Draws footprints. The rain multiplies what a kernel returns with the streak's whole coverage, so that a
/// kernel decides where coverage and light lie and physics how much there is.
///
/// A drop hides what is behind its whole disc and sends its light from parts of it: coverage is the disc swept along the path, and
/// light what a pattern says.
pub trait Kernel: Sync {
    /// Working memory, one per thread, kept from frame to frame.
    type Scratch: Default + Send + Sync + 'static;

    /// What is worked out of a footprint once, for however many clips.
    type Placed: Copy + Default + Send + Sync + 'static;

    /// A footprint ready to be drawn, and the pixels that it may touch; `None` when it draws nothing.
    fn place(&self, footprint: &Footprint) -> Option<(Clip, Self::Placed)>;

    /// Hands the footprint's part inside `clip` to `put`, each pixel once, in any order.
    ///
    /// A share is the mean over the pixel of the kernel's density, per square pixel, ≥ 0; over the whole
    /// plane shares of light, and those of coverage, add up to 1. The same footprint gives the same shares, to round-off, however it is cut
    /// into clips.
    fn draw(
        &self,
        placed: &Self::Placed,
        clip: Clip,
        scratch: &mut Self::Scratch,
        put: &mut impl FnMut(Span),
    );

    /// Whether [`Kernel::place`] looks at a footprint's line of sight and light, which cost some to work out.
    fn sees_light(&self) -> bool {
        true
    }

    /// [`Kernel::draw`] where a footprint's part inside `clip` is lines of one length: fills `ribbon` and answers true, or answers false and is
    /// asked to [`Kernel::draw`]. What lies outside the clip is not read.
    fn ribbon(
        &self,
        _placed: &Self::Placed,
        _clip: Clip,
        _scratch: &mut Self::Scratch,
        _ribbon: &mut Ribbon,
    ) -> bool {
        false
    }

    /// [`Kernel::draw`] of streaks that nothing hides: lays them over `tile buffer`'s tile by itself, one after the other, and answers how many; the next one, if
    /// any is left, is then asked to [`Kernel::ribbon`].
    fn lay(
        &self,
        _streaks: &[(Self::Placed, Paint)],
        _scratch: &mut Self::Scratch,
        _tile_buffer: &mut TileBuffer,
    ) -> usize {
        0
    }
}
