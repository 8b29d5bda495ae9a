//! The lines of a thin streak: where they begin and what they read, many at once, and their light, line by line.

use super::{
    BLOCK, Block, GENTLE, LEVEL, LIGHTS, LINES, LOW_RANK, PHASES, Packet, RANK, Thin, ThinPlace, half_of,
};
use crate::rain::kernel::Ribbon;
use crate::registers::{Registers, Work};
use glam::{Mat4, Vec4};

/// The filling of a ribbon with lines of `K` products.
pub(super) struct Fill<'a, const K: usize> {
    pub thin: &'a Thin,
    pub place: &'a ThinPlace,
    pub blocks: usize,
    pub mixed: &'a mut Vec<Block>,
    pub ribbon: &'a mut Ribbon,
}

impl<const K: usize> Work for Fill<'_, K> {
    #[inline(always)]
    fn run<R: Registers>(self, registers: R) {
        let Self { thin, place, blocks, mixed, ribbon } = self;
        thin.mix::<K>(place, blocks, mixed);
        let along = Along::new(place, &thin.along[place.length_class as usize], blocks);
        // Sizes that the compiler knows become plain vector code.
        match (blocks, along.level) {
            (1, true) => fill::<K, true>(registers, place, &along, (mixed, 1), ribbon),
            (1, false) => fill::<K, false>(registers, place, &along, (mixed, 1), ribbon),
            (_, true) => fill::<K, true>(registers, place, &along, (mixed, blocks), ribbon),
            (_, false) => fill::<K, false>(registers, place, &along, (mixed, blocks), ribbon),
        }
    }
}

/// Fills a ribbon from a table across of so many blocks a line.
#[inline(always)]
fn fill<const K: usize, const LEVEL: bool>(
    registers: impl Registers,
    place: &ThinPlace,
    along: &Along,
    (mixed, blocks): (&[Block], usize),
    ribbon: &mut Ribbon,
) {
    let mut starts = Starts::default();
    let mut from = ribbon.line;
    let Ribbon { first, shares, covers, .. } = ribbon;
    let chunks = shares.chunks_mut(LINES * blocks).zip(covers.chunks_mut(LINES * blocks));
    for (firsts, (shares, covers)) in first.chunks_mut(LINES).zip(chunks) {
        starts.fill::<LEVEL>(place, along, from);
        firsts.copy_from_slice(&starts.first[..firsts.len()]);
        let lines = shares.chunks_exact_mut(blocks).zip(covers.chunks_exact_mut(blocks));
        for (i, (light, cover)) in lines.enumerate() {
            let at = starts.node[i] as usize * blocks * K;
            let Some(nodes) = mixed.get(at..at + 2 * blocks * K) else { continue };
            let line = Line {
                nodes,
                share: starts.share[i],
                along: starts.along[i],
                along_node: starts.along_node[i],
                along_share: starts.along_share[i],
            };
            line.fill::<K, LEVEL>(registers, along, light, cover);
        }
        from += LINES as i32;
    }
}

/// Where some lines begin and what they read, one number a line.
#[derive(Default)]
struct Starts {
    /// First pixel.
    first: [i32; LINES],
    /// Node of the table across, and the share of the next.
    node: [i32; LINES],
    share: [f32; LINES],
    /// Place in the table along of the middle of a level line, of the first block's middle otherwise; its node, and the share of the
    /// next.
    along: [f32; LINES],
    along_node: [i32; LINES],
    along_share: [f32; LINES],
}

impl Starts {
    /// The lines from `line` on.
    #[inline(always)]
    fn fill<const LEVEL: bool>(&mut self, place: &ThinPlace, along: &Along, line: i32) {
        let base = line as f32 + 0.5 - place.middle[1];
        let reach = half_of(place.class as usize + 1) as f32 + 0.5;
        let [per_line, per_pixel] = place.along_steps.map(|step| step * place.along_per_pixel);
        let shift = place.along_radius * place.along_per_pixel;
        // A level line is looked up at the streak's middle, any other at the middle of its first block.
        let slope = if LEVEL { 0.0 } else { per_pixel };
        let block_middle = 0.5 * BLOCK as f32;
        let last = (along.table.len() - 2) as f32;
        for i in 0..LINES {
            let down = base + i as f32;
            let middle = place.middle[0] + place.lean * down;
            let start = middle - reach;
            let rounded = (start + ROUND) - ROUND;
            let first = if rounded < start { rounded + 1.0 } else { rounded };
            self.first[i] = whole_of(first + ROUND);
            (self.node[i], self.share[i]) = node_at((first - start) * PHASES as f32, (PHASES - 1) as f32);
            let node = per_line * down + slope * (first + block_middle - middle) + shift;
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
struct Along<'a> {
    table: &'a [Packet],
    /// Nodes from one pixel of a line to the next.
    step: f32,
    /// Whether all pixels of a line are as good as at one place, and whether light is linear over a block even at the ends.
    level: bool,
    gentle: bool,
    /// Between these nodes light changes slowly over a block.
    inner: [f32; 2],
}

impl<'a> Along<'a> {
    fn new(place: &ThinPlace, table: &'a [Packet], blocks: usize) -> Self {
        let step = place.along_steps[1];
        let reach = 0.5 * BLOCK as f32 * step.abs();
        let node = |pixels: f32| (pixels + place.along_radius) * place.along_per_pixel;
        Self {
            table,
            step: step * place.along_per_pixel,
            level: (step * (BLOCK * blocks) as f32).abs() < LEVEL,
            gentle: (step * BLOCK as f32).abs() < GENTLE,
            inner: [node(place.inner[0] + reach), node(place.inner[1] - reach)],
        }
    }

    /// The values at a place, and their gain to the next node.
    #[inline(always)]
    fn at(&self, place: f32) -> [Vec4; 2] {
        let (node, share) = node_at(place, (self.table.len() - 2) as f32);
        self.at_node(node, share)
    }

    /// The same at a share of the way from a node to the next.
    #[inline(always)]
    fn at_node(&self, node: i32, share: f32) -> [Vec4; 2] {
        let Some([low, high]) = self.table.get(node as usize..).and_then(<[Packet]>::first_chunk::<2>) else {
            return [Vec4::ZERO; 2];
        };
        let (low, high) = (Vec4::from_array(*low), Vec4::from_array(*high));
        let gain = high - low;
        [low + gain * share, gain]
    }
}

/// One line's part of the tables.
struct Line<'a> {
    /// Two nodes of the table across: blocks, then products.
    nodes: &'a [Block],
    share: f32,
    /// Place along, its node and the share of the next.
    along: f32,
    along_node: i32,
    along_share: f32,
}

impl Line<'_> {
    /// All pixels: of a level line at one place along, of any other each block at its own, and near the streak's ends each pixel.
    #[inline(always)]
    fn fill<const K: usize, const LEVEL: bool>(
        &self,
        registers: impl Registers,
        along: &Along,
        light: &mut [Block],
        cover: &mut [Block],
    ) {
        let (low, high) = self.nodes.split_at(self.nodes.len() / 2);
        let out = light.iter_mut().zip(cover);
        let blocks = out.zip(low.chunks_exact(K).zip(high.chunks_exact(K)));
        for (block, ((light, cover), (low, high))) in blocks.enumerate() {
            if LEVEL {
                let [values, _] = along.at_node(self.along_node, self.along_share);
                let factors = [values.to_array(), [0.0; RANK]];
                [*light, *cover] = products::<K>(registers, (low, high), self.share, 0.0, &factors);
                continue;
            }
            let node = self.along + (block * BLOCK) as f32 * along.step;
            [*light, *cover] = if along.gentle || node > along.inner[0] && node < along.inner[1] {
                let [values, gain] = match block {
                    0 => along.at_node(self.along_node, self.along_share),
                    _ => along.at(node),
                };
                let factors = [values.to_array(), gain.to_array()];
                products::<K>(registers, (low, high), self.share, along.step, &factors)
            } else {
                self.near_an_end::<K>(along, node, low, high)
            };
        }
    }

    /// A block at `node` of a leaning streak, each pixel at its own place along.
    #[inline(always)]
    fn near_an_end<const K: usize>(
        &self,
        along: &Along,
        node: f32,
        low: &[Block],
        high: &[Block],
    ) -> [Block; 2] {
        let [a, _] = along.at(node - 1.5 * along.step);
        let [b, _] = along.at(node - 0.5 * along.step);
        let [c, _] = along.at(node + 0.5 * along.step);
        let [d, _] = along.at(node + 1.5 * along.step);
        // From a row a pixel to a row a product.
        let values = Mat4::from_cols(a, b, c, d).transpose();
        let across = |k: usize| {
            let near = Vec4::from_array(low[k]);
            near + (Vec4::from_array(high[k]) - near) * self.share
        };
        if K == LOW_RANK {
            let across = across(0);
            return [across * values.x_axis, across * values.w_axis].map(|four| four.to_array());
        }
        let mut sum = Vec4::ZERO;
        for k in 0..LIGHTS {
            sum += across(k) * values.col(k);
        }
        [sum, across(LIGHTS) * values.w_axis].map(|four| four.to_array())
    }
}

/// A block's light and coverage of `K` products, whose factors gain `step` times the second ones from pixel to pixel.
#[inline(always)]
fn products<const K: usize>(
    registers: impl Registers,
    (low, high): (&[Block], &[Block]),
    share: f32,
    step: f32,
    factors: &[Packet; 2],
) -> [Block; 2] {
    // Nothing here may be a closure: what is not inlined leaves the registers.
    if K == LOW_RANK {
        if let (Some(low), Some(high)) = (low.first(), high.first()) {
            return registers.one(low, high, share, step, factors);
        }
    } else if let (Some(low), Some(high)) = (low.first_chunk(), high.first_chunk()) {
        return registers.four(low, high, share, step, factors);
    }
    [[0.0; BLOCK]; 2]
}
