//! What streaks show over a tile of the picture, before it is laid over the picture: light, and how much of what is behind it hides.
//!
//! Streaks are laid over each other here and not in the picture: a tile buffer's pixels are 16 bytes side by side, light and coverage together, so that four of
//! them are one register, and a tile's stay in a core's cache. To lie over another is associative: v' = v (1 − α) + α c for the tile buffer's light and its
//! coverage alike, and once, at the end, L (1 − coverage) + light. The picture is read and written once, row after row.

use super::kernel::{BLOCK, Clip, Ribbon};
use crate::audited::prefetch;
use crate::registers::{self, Look, Plain, Registers, Work, positive};
use glam::Vec4;

/// Widest and highest tile, px.
pub(super) const TILE: [usize; 2] = [128, 128];
/// Pixels beside a tile that lines of pixels may begin or end in, and that nothing reads.
pub(crate) const MARGIN: usize = BLOCK;
/// Pixels from one row to the next: an odd number of lines of the cache, so that rows do not evict each other.
pub(crate) const STRIDE: usize = 140;

/// Pixels that are laid over the picture, or left out, together.
const GROUP: usize = 16;
/// Pixels of 12 bytes in a line of the cache.
const PER_LINE: usize = 5;
/// Rows between the one whose pixels are asked for and the one that is laid over the picture.
const AHEAD: i32 = 8;

/// Red, green, blue and coverage of a pixel.
pub(crate) type Cell = [f32; 4];

/// What a streak is laid with.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Paint {
    /// Its whole coverage, px².
    pub strength: f32,
    /// How far its light follows the pattern, in [0, 1]; the rest follows its coverage.
    pub contrast: f32,
    /// Radiance of its light, W/(m² sr).
    pub colour: [f32; 3],
}

/// A tile's streaks, laid over each other.
#[derive(Clone, Debug, Default)]
pub struct TileBuffer {
    /// Row after row, [`STRIDE`] to a row; nothing where no streak is.
    cells: Vec<Cell>,
    clip: Clip,
    /// First row that may show something, and the one after the last.
    touched: [i32; 2],
}

/// A band of the picture and of its mask.
pub(super) struct Under<'a> {
    pub pixels: &'a mut [[f32; 3]],
    pub mask: &'a mut [f32],
    /// Pixels of a row, and the band's first row.
    pub width: usize,
    pub top: usize,
    /// Whether the mask is still an earlier picture's.
    pub is_first: bool,
}

impl Paint {
    /// Factors of a pixel's coverage and of its pattern's light, four times over.
    #[inline(always)]
    pub(crate) fn look(&self) -> Look {
        let mut look = Look { cover: [1.0; 16], light: [0.0; 16] };
        for at in (0..16).step_by(4) {
            for band in 0..3 {
                look.cover[at + band] = (1.0 - self.contrast) * self.colour[band];
                look.light[at + band] = self.contrast * self.colour[band];
            }
        }
        look
    }

    /// How much of each of four pixels shows the streak's light, and how much is covered.
    #[inline(always)]
    fn over(&self, shares: &[f32; BLOCK], covers: &[f32; BLOCK]) -> [[f32; 4]; 2] {
        let light = positive(Vec4::from_array(*shares) * self.strength);
        let cover = positive(Vec4::from_array(*covers) * self.strength);
        let shown = cover + (light - cover) * self.contrast;
        let alpha = cover.min(Vec4::ONE);
        // A gain may ask for more than all of a pixel: light is then cut as coverage is.
        match cover.cmpgt(Vec4::ONE).any() {
            true => [(shown / cover.max(Vec4::ONE)).to_array(), alpha.to_array()],
            false => [shown.to_array(), alpha.to_array()],
        }
    }

    fn with_one(&self) -> [f32; 4] {
        let [r, g, b] = self.colour;
        [r, g, b, 1.0]
    }
}

impl TileBuffer {
    /// A tile buffer with its memory.
    pub(super) fn new() -> Self {
        Self { cells: vec![[0.0; 4]; TILE[1] * STRIDE], ..Self::default() }
    }

    /// Over a tile's pixels, with nothing on it.
    pub(super) fn begin(&mut self, clip: Clip) {
        (self.clip, self.touched) = (clip, [clip.bottom, clip.top]);
    }

    /// Bytes that it holds.
    pub(super) fn bytes(&self) -> usize {
        self.cells.capacity() * size_of::<Cell>()
    }

    /// The tile that it lies over.
    #[inline(always)]
    pub fn clip(&self) -> Clip {
        self.clip
    }

    /// The rows from `rows[0]` to before `rows[1]`, which lie in the tile, [`STRIDE`] pixels each; the first of a row stands [`MARGIN`] left of the tile.
    #[inline(always)]
    pub(crate) fn rows(&mut self, rows: [i32; 2]) -> &mut [Cell] {
        if rows[0] >= rows[1] {
            return &mut [];
        }
        self.touched = [self.touched[0].min(rows[0]), self.touched[1].max(rows[1])];
        let (from, to) = (rows[0] - self.clip.top, rows[1] - self.clip.top);
        &mut self.cells[from as usize * STRIDE..to as usize * STRIDE]
    }

    /// A pixel of the tile.
    fn at(&self, x: i32, y: i32) -> usize {
        (y - self.clip.top) as usize * STRIDE + (x - self.clip.left) as usize + MARGIN
    }

    /// Four pixels of a column from one of its tile's rows, or from above it, on; what lies outside is nothing. None where all of it does.
    #[inline(always)]
    pub(crate) fn column(&mut self, [x, first]: [i32; 2]) -> Option<[Cell; BLOCK]> {
        let (from, to) = (first.max(self.clip.top), first.saturating_add(BLOCK as i32).min(self.clip.bottom));
        if from >= to || x < self.clip.left || x >= self.clip.right {
            return None;
        }
        self.touched = [self.touched[0].min(from), self.touched[1].max(to)];
        if to - from == BLOCK as i32 {
            let at = self.at(x, from);
            let own = self.cells.get(at..=at + 3 * STRIDE)?;
            return Some([own[0], own[STRIDE], own[2 * STRIDE], own[3 * STRIDE]]);
        }
        let mut four = [[0.0; 4]; BLOCK];
        for y in from..to {
            four[(y - first) as usize] = self.cells[self.at(x, y)];
        }
        Some(four)
    }

    /// Writes what [`TileBuffer::column`] read.
    #[inline(always)]
    pub(crate) fn set_column(&mut self, [x, y]: [i32; 2], four: &[Cell; BLOCK]) {
        if y >= self.clip.top && y <= self.clip.bottom - BLOCK as i32 {
            let at = self.at(x, y);
            if let Some(cells) = self.cells.get_mut(at..=at + 3 * STRIDE) {
                [cells[0], cells[STRIDE], cells[2 * STRIDE], cells[3 * STRIDE]] = *four;
            }
            return;
        }
        for (own, y) in four.iter().zip(y..) {
            if y >= self.clip.top && y < self.clip.bottom {
                let at = self.at(x, y);
                self.cells[at] = *own;
            }
        }
    }

    /// Lays a ribbon's part inside the tile.
    pub(super) fn lay_ribbon(&mut self, ribbon: &Ribbon, paint: Paint) {
        registers::run(Lay { tile_buffer: self, ribbon, paint });
    }

    /// [`TileBuffer::lay_ribbon`] of lines that are rows.
    #[inline(always)]
    fn lay_rows(&mut self, registers: impl Registers, ribbon: &Ribbon, paint: &Paint) {
        let (colour, left) = (paint.with_one(), self.clip.left);
        let lines = [ribbon.line, ribbon.line.saturating_add(ribbon.first.len() as i32)];
        let [from, to] = lines.map(|line| line.clamp(self.clip.top, self.clip.bottom));
        let rows = self.rows([from, to]).chunks_exact_mut(STRIDE);
        for (row, (_, first, [shares, covers])) in rows.zip(ribbon.lines().skip((from - lines[0]) as usize)) {
            for (block, (shares, covers)) in shares.iter().zip(covers).enumerate() {
                // What lies outside of the row wraps far beyond it.
                let at =
                    first.wrapping_sub(left).wrapping_add((block * BLOCK + MARGIN) as i32) as u32 as usize;
                if let Some(cells) = row.get_mut(at..).and_then(<[Cell]>::first_chunk_mut::<BLOCK>) {
                    registers.lay(flat(cells), paint.over(shares, covers), &colour);
                }
            }
        }
    }

    /// [`TileBuffer::lay_ribbon`] of lines that are columns.
    #[inline(always)]
    fn lay_columns(&mut self, ribbon: &Ribbon, paint: &Paint) {
        let (clip, colour) = (self.clip, paint.with_one());
        for (x, first, [shares, covers]) in ribbon.lines() {
            let end = first.saturating_add((ribbon.blocks * BLOCK) as i32);
            let (from, to) = (first.max(clip.top), end.min(clip.bottom));
            if from >= to || x < clip.left || x >= clip.right {
                continue;
            }
            self.touched = [self.touched[0].min(from), self.touched[1].max(to)];
            let some = (from - first) as usize..(to - first) as usize;
            let own = shares.as_flattened()[some.clone()].iter().zip(&covers.as_flattened()[some]);
            for (y, (&share, &cover)) in (from..).zip(own) {
                let [shown, alpha] = paint.over(&[share; BLOCK], &[cover; BLOCK]);
                let at = self.at(x, y);
                lay_pixel(&mut self.cells[at], [shown[0], alpha[0]], &colour);
            }
        }
    }

    /// Lays the first `count` of a row's shares, which are padded to whole blocks, from the pixel (x, y) on, inside the tile.
    #[inline(always)]
    pub(super) fn lay_span(
        &mut self,
        [x, y]: [i32; 2],
        count: usize,
        [shares, covers]: [&[f32]; 2],
        paint: &Paint,
    ) {
        self.touched = [self.touched[0].min(y), self.touched[1].max(y + 1)];
        let at = self.at(x, y);
        let Some(cells) = self.cells.get_mut(at..at + count) else { return };
        let ((shares, _), (covers, _)) = (shares.as_chunks::<BLOCK>(), covers.as_chunks::<BLOCK>());
        let colour = paint.with_one();
        let (blocks, rest) = cells.as_chunks_mut::<BLOCK>();
        let whole = blocks.len();
        for (cells, own) in blocks.iter_mut().zip(shares.iter().zip(covers)) {
            Plain.lay(flat(cells), paint.over(own.0, own.1), &colour);
        }
        if let (Some(shares), Some(covers)) = (shares.get(whole), covers.get(whole)) {
            let [shown, alpha] = paint.over(shares, covers);
            for (cell, own) in rest.iter_mut().zip(shown.into_iter().zip(alpha)) {
                lay_pixel(cell, own.into(), &colour);
            }
        }
    }

    /// Lays all of it over the picture and into the mask, and takes it away.
    pub(super) fn uncover(&mut self, under: &mut Under) {
        registers::run(Uncover { tile_buffer: self, under });
    }

    #[inline(always)]
    fn uncover_in(&mut self, registers: impl Registers, under: &mut Under) {
        let clip = self.clip;
        let count = (clip.right - clip.left) as usize;
        let at = |y: i32| (y as usize - under.top) * under.width + clip.left as usize;
        let [first, end] = std::mem::replace(&mut self.touched, [clip.bottom, clip.top]);
        if under.is_first {
            for y in (clip.top..first.min(clip.bottom)).chain(end.max(clip.top)..clip.bottom) {
                under.mask[at(y)..at(y) + count].fill(0.0);
            }
        }
        // Which groups of a row show anything. Their pixels are asked for some rows ahead: row by row each would wait for its own.
        let mut ahead = [0u32; AHEAD as usize];
        for y in first..end.max(first) + AHEAD {
            let shown = std::mem::take(&mut ahead[y.rem_euclid(AHEAD) as usize]);
            if y < end {
                let row = (y - clip.top) as usize * STRIDE + MARGIN;
                let pixels = at(y)..at(y) + count;
                let own = (&under.pixels[pixels.clone()], &under.mask[pixels]);
                ahead[y.rem_euclid(AHEAD) as usize] = ask_for(&self.cells[row..row + count], own);
            }
            if (first + AHEAD..end + AHEAD).contains(&y) {
                let row = (y - AHEAD - clip.top) as usize * STRIDE;
                let pixels = at(y - AHEAD)..at(y - AHEAD) + count;
                let own = (&mut under.pixels[pixels.clone()], &mut under.mask[pixels]);
                uncover_row(registers, (&mut self.cells[row..row + STRIDE], shown), own, under.is_first);
            }
        }
    }
}

/// Which groups of a row's pixels show anything, a bit each; what is theirs of the picture and the mask is asked for.
#[inline(always)]
fn ask_for(cells: &[Cell], (pixels, mask): (&[[f32; 3]], &[f32])) -> u32 {
    let mut shown = 0;
    let groups = cells.chunks(GROUP).zip(pixels.chunks(GROUP)).zip(mask.chunks(GROUP));
    for (group, ((cells, pixels), mask)) in groups.enumerate() {
        let any = cells.as_flattened().iter().fold(0, |any, value| any | value.to_bits());
        if any != 0 {
            shown |= 1 << group;
            pixels.iter().step_by(PER_LINE).for_each(prefetch);
            prefetch(&mask[0]);
        }
    }
    shown
}

/// Lays the groups of a row that are `shown` over the picture's pixels and into the mask, and takes them away.
#[inline(always)]
fn uncover_row(
    registers: impl Registers,
    (row, shown): (&mut [Cell], u32),
    (pixels, mask): (&mut [[f32; 3]], &mut [f32]),
    is_first: bool,
) {
    let count = pixels.len();
    let groups = row[MARGIN..MARGIN + count].chunks_mut(GROUP);
    let groups = groups.zip(pixels.chunks_mut(GROUP).zip(mask.chunks_mut(GROUP)));
    for (group, (cells, (pixels, mask))) in groups.enumerate() {
        if is_first {
            mask.fill(0.0);
        }
        if shown >> group & 1 == 1 {
            lay_over(registers, cells, pixels, mask);
            cells.fill([0.0; 4]);
        }
    }
    // What lines of pixels left beside the tile.
    row[..MARGIN].fill([0.0; 4]);
    row[MARGIN + count..].fill([0.0; 4]);
}

/// Lays some of a tile buffer's pixels over the picture's and into the mask.
#[inline(always)]
fn lay_over(registers: impl Registers, cells: &[Cell], pixels: &mut [[f32; 3]], mask: &mut [f32]) {
    let (blocks, rest) = cells.as_chunks::<BLOCK>();
    let (pixels, last_pixels) = pixels.as_chunks_mut::<BLOCK>();
    let (mask, last_mask) = mask.as_chunks_mut::<BLOCK>();
    for ((cells, pixels), mask) in blocks.iter().zip(pixels).zip(mask) {
        let (cells, pixels) =
            (cells.as_flattened().first_chunk(), pixels.as_flattened_mut().first_chunk_mut());
        if let (Some(cells), Some(pixels)) = (cells, pixels) {
            registers.uncover(cells, pixels, mask);
        }
    }
    for ((cell, pixel), mask) in rest.iter().zip(last_pixels).zip(last_mask) {
        let keep = 1.0 - cell[3];
        pixel.iter_mut().zip(cell).for_each(|(light, own)| *light = *light * keep + own);
        *mask = *mask * keep + cell[3];
    }
}

/// Four pixels' numbers, one after the other.
#[inline(always)]
pub(crate) fn flat(cells: &mut [Cell; BLOCK]) -> &mut [f32; 4 * BLOCK] {
    bytemuck::cast_mut(cells)
}

/// One pixel.
#[inline(always)]
fn lay_pixel(cell: &mut Cell, [shown, alpha]: [f32; 2], colour: &[f32; 4]) {
    let own = Vec4::splat(shown).with_w(alpha) * Vec4::from_array(*colour);
    *cell = (Vec4::from_array(*cell) * (1.0 - alpha) + own).to_array();
}

/// The laying of a ribbon.
struct Lay<'a> {
    tile_buffer: &'a mut TileBuffer,
    ribbon: &'a Ribbon,
    paint: Paint,
}

impl Work for Lay<'_> {
    #[inline(always)]
    fn run<R: Registers>(self, registers: R) {
        let Self { tile_buffer, ribbon, paint } = self;
        match ribbon.columns {
            true => tile_buffer.lay_columns(ribbon, &paint),
            false => tile_buffer.lay_rows(registers, ribbon, &paint),
        }
    }
}

/// The laying of a tile buffer over its picture.
struct Uncover<'a, 'b> {
    tile_buffer: &'a mut TileBuffer,
    under: &'a mut Under<'b>,
}

impl Work for Uncover<'_, '_> {
    #[inline(always)]
    fn run<R: Registers>(self, registers: R) {
        self.tile_buffer.uncover_in(registers, self.under);
    }
}
