//! The lines of a thin streak: where they begin and what they read, many at once, and their light, line by line.

use super::{BEYOND, BLOCK, Four, GENTLE, LINES, Nodes, PHASES, RANK, Thin, ThinPlace};
use crate::rain::kernel::Ribbon;
use crate::rain::tile_buffer::{Cell, MARGIN, Paint, STRIDE, TileBuffer, flat};
use crate::registers::{Look, Registers, Work};
use glam::Vec4;

/// Places of a block's pixels from its middle.
const PLACES: [f32; BLOCK] = [-1.5, -0.5, 0.5, 1.5];

/// The laying of a streak's lines over a tile buffer.
pub(super) struct Lay<'a> {
    pub thin: &'a Thin,
    pub place: &'a ThinPlace,
    pub mixed: &'a mut Vec<Four>,
    /// First line and the one after the last.
    pub lines: [i32; 2],
    pub paint: &'a Paint,
    pub tile_buffer: &'a mut TileBuffer,
}

impl Work for Lay<'_> {
    #[inline(always)]
    fn run<R: Registers>(self, registers: R) {
        let Self { thin, place, mixed, lines, paint, tile_buffer } = self;
        let blocks = thin.mix(registers, place, paint.strength, mixed);
        let along = Along::new(place, &thin.along[place.length_class as usize]);
        let line = LineOf { mixed, blocks, along: &along, look: &paint.look() };
        // A size that the compiler knows becomes plain vector code.
        match (place.level, blocks) {
            (true, _) => line.lay_columns(registers, place, lines, tile_buffer),
            (false, 1) => LineOf { blocks: 1, ..line }.lay_rows(registers, place, lines, tile_buffer),
            (false, _) => line.lay_rows(registers, place, lines, tile_buffer),
        }
    }
}

/// What all lines of a streak read.
struct LineOf<'a> {
    mixed: &'a [Four],
    blocks: usize,
    along: &'a Along<'a>,
    look: &'a Look,
}

impl LineOf<'_> {
    #[inline(always)]
    fn lay_rows(
        self,
        registers: impl Registers,
        place: &ThinPlace,
        rows: [i32; 2],
        tile_buffer: &mut TileBuffer,
    ) {
        let (left, steps) = (tile_buffer.clip().left - MARGIN as i32, self.along.steps());
        let mut starts = Starts::default();
        let lines = tile_buffer.rows(rows).chunks_mut(LINES * STRIDE).zip((rows[0]..).step_by(LINES));
        for (lines, from) in lines {
            starts.fill(place, self.along, from);
            for (i, line) in lines.chunks_exact_mut(STRIDE).enumerate().take(LINES) {
                // What begins left of the margin wraps far beyond the row.
                let first = starts.first[i].wrapping_sub(left) as u32;
                for block in 0..self.blocks {
                    let cells = line.get_mut(first.wrapping_add((block * BLOCK) as u32) as usize..);
                    if let Some(cells) = cells.and_then(<[Cell]>::first_chunk_mut::<BLOCK>) {
                        self.lay_block(registers, &starts, [i, block], &steps, flat(cells));
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn lay_columns(
        self,
        registers: impl Registers,
        place: &ThinPlace,
        columns: [i32; 2],
        tile_buffer: &mut TileBuffer,
    ) {
        let steps = self.along.steps();
        let mut starts = Starts::default();
        for from in (columns[0]..columns[1]).step_by(LINES) {
            starts.fill(place, self.along, from);
            for (i, x) in (from..columns[1]).enumerate().take(LINES) {
                for block in 0..self.blocks {
                    let y = starts.first[i].saturating_add((block * BLOCK) as i32);
                    if let Some(mut cells) = tile_buffer.column([x, y]) {
                        self.lay_block(registers, &starts, [i, block], &steps, flat(&mut cells));
                        tile_buffer.set_column([x, y], &cells);
                    }
                }
            }
        }
    }

    /// One block of a line.
    #[inline(always)]
    fn lay_block(
        &self,
        registers: impl Registers,
        starts: &Starts,
        [i, block]: [usize; 2],
        steps: &[f32; 4 * BLOCK],
        cells: &mut [f32; 4 * BLOCK],
    ) {
        let Self { mixed, blocks, along, look } = *self;
        let at = starts.node[i] as usize * blocks + block;
        let (Some(low), Some(high)) = (mixed.get(at), mixed.get(at + blocks)) else { return };
        let nodes = [&low.0, &high.0];
        let node = starts.along[i] + (block * BLOCK) as f32 * along.step;
        let share = starts.share[i];
        if along.is_calm(node) {
            let (own, at) = match block {
                0 => (along.nodes_at(starts.along_node[i]), starts.along_share[i]),
                _ => along.at(node),
            };
            registers.lay_line(cells, nodes, share, (own, at, steps), look);
        } else {
            // An array's `map` would not be inlined.
            let a = along.at(node + PLACES[0] * along.step);
            let b = along.at(node + PLACES[1] * along.step);
            let c = along.at(node + PLACES[2] * along.step);
            let own = [a, b, c, along.at(node + PLACES[3] * along.step)];
            registers.lay_end(cells, nodes, share, own, look);
        }
    }
}

/// Fills a ribbon with the lines of a streak.
pub(super) fn fill(place: &ThinPlace, along: &Along, (mixed, blocks): (&[Four], usize), ribbon: &mut Ribbon) {
    let mut starts = Starts::default();
    let mut from = ribbon.line;
    let Ribbon { first, shares, covers, .. } = ribbon;
    let chunks = shares.chunks_mut(LINES * blocks).zip(covers.chunks_mut(LINES * blocks));
    for (firsts, (shares, covers)) in first.chunks_mut(LINES).zip(chunks) {
        starts.fill(place, along, from);
        firsts.copy_from_slice(&starts.first[..firsts.len()]);
        let lines = shares.chunks_exact_mut(blocks).zip(covers.chunks_exact_mut(blocks));
        for (i, (light, cover)) in lines.enumerate() {
            for (block, (light, cover)) in light.iter_mut().zip(cover).enumerate() {
                let at = starts.node[i] as usize * blocks + block;
                let (Some(low), Some(high)) = (mixed.get(at), mixed.get(at + blocks)) else { continue };
                let node = starts.along[i] + (block * BLOCK) as f32 * along.step;
                let own = if along.is_calm(node) {
                    let (own, at) = along.at(node);
                    PLACES.map(|place| (own, at + place * along.step))
                } else {
                    PLACES.map(|place| along.at(node + place * along.step))
                };
                [*light, *cover] = block_of(low, high, starts.share[i], own);
            }
        }
        from += LINES as i32;
    }
}

/// Light and coverage of four pixels, each at its own place along.
#[inline(always)]
fn block_of(low: &Four, high: &Four, share: f32, along: [(&Nodes, f32); BLOCK]) -> [[f32; BLOCK]; 2] {
    let [low, high] = [low, high].map(|cell| cell.0.as_chunks::<RANK>().0);
    let mut out = [[0.0; BLOCK]; 2];
    for pixel in 0..BLOCK {
        let ([value, gain], at) = along[pixel];
        let near = Vec4::from_array(low[pixel]);
        let across = near + (Vec4::from_array(high[pixel]) - near) * share;
        let products = across * (Vec4::from_array(*value) + Vec4::from_array(*gain) * at);
        out[0][pixel] = (products.x + products.y) + products.z;
        out[1][pixel] = products.w;
    }
    out
}

/// Where some lines begin and what they read, one number a line.
#[derive(Default)]
struct Starts {
    /// First pixel.
    first: [i32; LINES],
    /// Node of the table across, and the share of the next.
    node: [i32; LINES],
    share: [f32; LINES],
    /// Place of the first block's middle in the table along; its node, and the share of the next.
    along: [f32; LINES],
    along_node: [i32; LINES],
    along_share: [f32; LINES],
}

impl Starts {
    /// The lines from `line` on.
    #[inline(always)]
    fn fill(&mut self, place: &ThinPlace, along: &Along, line: i32) {
        let reach = f32::from(place.half) + 0.5;
        let per_line = place.along_steps[0] * place.along_per_pixel;
        let per_pixel = place.along_steps[1] * place.along_per_pixel;
        let shift = place.along_radius * place.along_per_pixel;
        let block_middle = 0.5 * BLOCK as f32;
        let last = (along.table.len() - 2) as f32;
        for i in 0..LINES {
            // Of the line alone, not of where a tile begins.
            let down = (line + i as i32) as f32 + 0.5 - place.middle[1];
            let middle = place.middle[0] + place.lean * down;
            let start = middle - reach;
            let rounded = (start + ROUND) - ROUND;
            let first = if rounded < start { rounded + 1.0 } else { rounded };
            self.first[i] = whole_of(first + ROUND);
            (self.node[i], self.share[i]) = node_at((first - start) * PHASES as f32, (PHASES - 1) as f32);
            let node = per_line * down + per_pixel * (first + block_middle - middle) + shift;
            self.along[i] = node;
            (self.along_node[i], self.along_share[i]) = node_at(node, last);
        }
    }
}

/// Adding it rounds to a whole number, which its last bits then hold.
const ROUND: f32 = 12_582_912.0;

/// The whole number that something rounded holds.
#[inline(always)]
fn whole_of(rounded: f32) -> i32 {
    (rounded.to_bits() as i32).wrapping_sub(ROUND.to_bits() as i32)
}

/// The interval that a place is in, from 0 to `last`, and the share of its upper node; a NaN is the first.
#[inline(always)]
fn node_at(place: f32, last: f32) -> (i32, f32) {
    // Rounding to the nearest of one half less is the interval.
    let whole = between(place - 0.5, 0.0, last) + ROUND;
    (whole_of(whole), between(place, 0.0, last + 1.0) - (whole - ROUND))
}

/// `value` within two ends; a NaN is the lower.
#[inline(always)]
fn between(value: f32, low: f32, high: f32) -> f32 {
    let value = if value > low { value } else { low };
    if value < high { value } else { high }
}

/// A table along at the scale of one kernel.
pub(super) struct Along<'a> {
    table: &'a [Nodes],
    /// Nodes from one pixel of a line to the next.
    step: f32,
    /// Whether light is linear over a block even at the ends.
    gentle: bool,
    /// Between these nodes light changes slowly over a block.
    inner: [f32; 2],
}

impl<'a> Along<'a> {
    #[inline(always)]
    pub(super) fn new(place: &ThinPlace, table: &'a [Nodes]) -> Self {
        let step = place.along_steps[1];
        let reach = 0.5 * BLOCK as f32 * step.abs();
        let node = |pixels: f32| (pixels + place.along_radius) * place.along_per_pixel;
        Self {
            table,
            step: step * place.along_per_pixel,
            gentle: (step * BLOCK as f32).abs() < GENTLE,
            inner: [node(place.inner[0] + reach), node(place.inner[1] - reach)],
        }
    }

    /// From a block's middle to its pixels, four times each.
    #[inline(always)]
    fn steps(&self) -> [f32; 4 * BLOCK] {
        let mut steps = [0.0; 4 * BLOCK];
        for (at, step) in steps.iter_mut().enumerate() {
            *step = PLACES[at / 4] * self.step;
        }
        steps
    }

    /// Whether light is linear over a block whose middle stands there.
    #[inline(always)]
    fn is_calm(&self, node: f32) -> bool {
        self.gentle || node > self.inner[0] && node < self.inner[1]
    }

    /// The node at or before a place, and the share of the way to the next.
    #[inline(always)]
    fn at(&self, place: f32) -> (&'a Nodes, f32) {
        let (node, share) = node_at(place, (self.table.len() - 2) as f32);
        (self.nodes_at(node), share)
    }

    #[inline(always)]
    fn nodes_at(&self, node: i32) -> &'a Nodes {
        self.table.get(node as usize).unwrap_or(&BEYOND)
    }
}
