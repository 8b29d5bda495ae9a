//! Streaks too thin to show what is across them: a few products, across × along.
//!
//! I(u, v) ≈ m(u) L(v) + Σ A_k(u) B_k(v), k = 1, 2, with m the mean light across and L the light of every cross section, which the
//! first product holds exactly. The next two are the singular vectors of what is left as pixels a third of the body's width show it: no two
//! products come closer to that. A pattern that IS two products stays those two. The first product is chosen so that it holds all
//! light along, and the others none.
//!
//! A fourth product is no light's: it is what the drop covers, the column of its disc ([`super::column`]). A width that shows no more of a
//! pattern than that light is somewhere across it has one table across, for light and coverage both.
//!
//! Each factor is averaged over the pixel's shadow on its own axis, and tabulated for sizes and angles once. Across, the axis is the
//! LINE of pixels itself (a row, of a rather upright streak): one pixel is then a whole number of the table's nodes at any angle, all
//! pixels of a line stand at the same share between two nodes, and a table has them side by side: no search and no gathering per
//! pixel. Where lines begin and what they read is worked out for many lines at once; a line then costs one place along the streak and
//! two dozen vector operations for each four pixels.

#[cfg(feature = "gpu")]
pub mod flat;
mod lines;
mod tables;

use super::Pose;
use super::edge::NARROWEST_BOX;
use super::profile::Profile;
use crate::rain::kernel::{BLOCK, Ribbon};
use crate::rain::tile_buffer::{Paint, TileBuffer};
use crate::registers::{self, Plain, Registers};
use lines::{Along, Lay};
use squall_formats::section::streak::Pattern;
use tables::{gather_light, lit, products, tabulate_across, tabulate_along};

/// Products of light; and those of a table, the coverage's as the last.
const LIGHTS: usize = 3;
const RANK: usize = LIGHTS + 1;
/// Those of a width too narrow to show more than where light is along.
const LOW_RANK: usize = 1;
/// Widths tabulated: pixels of the whole picture along a line, 2^(class/4 − 4), to 22.6 px.
const WIDTHS: usize = 35;
const WIDTHS_PER_OCTAVE: f32 = 4.0;
const FIRST_WIDTH_LOG2: f32 = -4.0;
/// Shadows tabulated: how far the next line shifts a streak, px. The least stands in for none.
const SHIFTS: [f64; 4] = [NARROWEST_BOX, 0.5, 0.75, 1.0];
/// Nodes of a pixel.
const PHASES: usize = 16;
/// Lengths tabulated: pixels of the whole picture, 2^(class/2 − 3), to 512 px.
const LENGTHS: usize = 25;
const LENGTHS_PER_OCTAVE: f32 = 2.0;
const FIRST_LENGTH_LOG2: f32 = -3.0;

/// Width of a pixel that products are chosen for, in bodies: thin bodies are up to four pixels wide.
const PIXEL_SHARE: f64 = 1.0 / 3.0;
/// Longest picture whose table along is not stretched.
const STRETCHED_PX: f64 = 2.0;
/// Gain along the streak over a block, px, within which light is linear at a streak's ends, which a pixel blurs.
const GENTLE: f32 = 0.5;
/// How far into the body its ends are soft, px at most.
const ENDS_PX: f32 = 4.0;
/// Lines whose places are worked out together.
const LINES: usize = 16;

/// Coverage that a pixel may have where it needs no cutting at 1, by the peaks of the tables and of what is added along a line of pixels.
const THIN_COVER: f32 = 0.5;

/// Values of all products at one place.
type Packet = [f32; RANK];
/// A place along: its values, and their gain to the next.
type Nodes = [Packet; 2];
/// What is along beyond a table.
const BEYOND: Nodes = [[0.0; RANK]; 2];

/// Four pixels of a line, pixel by pixel the values of all products.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(super) struct Four([f32; BLOCK * RANK]);

/// A width's table across: for every node of a pixel the pixels of a line, and for each of those the products.
#[derive(Clone, Debug)]
struct Across {
    /// Products that show, and blocks of a line.
    rank: usize,
    blocks: usize,
    /// By node (one more than [`PHASES`]), then pixel of the line, the last block padded, then product.
    values: Vec<f32>,
    /// The same with as many products and pixels as the next wider class has, where those are others.
    wider: Option<Vec<f32>>,
}

impl Across {
    /// Largest value of the coverage's.
    fn peak(&self) -> f32 {
        self.values.chunks_exact(self.rank).map(|packet| packet[self.rank - 1]).fold(0.0, f32::max)
    }

    /// The table that is mixed with the next wider class's.
    #[inline(always)]
    fn as_wide(&self) -> &[f32] {
        self.wider.as_ref().unwrap_or(&self.values)
    }
}

/// A pattern in thin form.
#[derive(Clone, Debug)]
pub struct Thin {
    /// By width, then shift.
    across: Vec<Across>,
    /// By length: packets over the picture and half a pixel on both sides.
    along: Vec<Vec<Nodes>>,
    /// Where each of them has light.
    along_lit: Vec<[f32; 2]>,
    /// Largest value of each one's coverage, and of each table's across.
    along_peaks: Vec<f32>,
    across_peaks: Vec<f32>,
    /// The classes' widths and lengths, pixels, and whole pixels on each side that a width's light reaches.
    widths: [f64; WIDTHS],
    halves: [u16; WIDTHS],
    lengths: [f64; LENGTHS],
}

/// A thin kernel's place: what is worked out once, for however many clips.
#[derive(Clone, Copy, Debug, Default)]
pub struct ThinPlace {
    /// Tables: width, shift, length; and the shares of the next wider one and the next more slanted one.
    class: u16,
    slant: u16,
    length_class: u16,
    share: f32,
    slant_share: f32,
    /// Whole pixels on each side of its middle.
    half: u16,
    /// Whether lines are columns, and whether u falls along them.
    pub level: bool,
    mirrored: bool,
    /// The streak's middle on the lines' axis and across lines; gain of the former from line to line.
    middle: [f32; 2],
    lean: f32,
    /// Pixels along the streak from its picture's beginning at the middle; gain per line, and along a line.
    along_steps: [f32; 2],
    /// Between these, pixels along, light changes slowly along the streak.
    inner: [f32; 2],
    along_radius: f32,
    along_per_pixel: f32,
    weight: f32,
}

/// Largest radius of a pixel's shadow along: half a side and what stands in for none.
const RADIUS_ALONG: f64 = 0.5 + 0.5 * NARROWEST_BOX;

fn class_width(class: usize) -> f64 {
    libm::exp2(f64::from(class as f32 / WIDTHS_PER_OCTAVE + FIRST_WIDTH_LOG2))
}

fn class_length(class: usize) -> f64 {
    libm::exp2(f64::from(class as f32 / LENGTHS_PER_OCTAVE + FIRST_LENGTH_LOG2))
}

/// The class whose width is at or below `width`, the narrowest and the last but one at the ends.
fn class_at(width: f64) -> usize {
    let (octave, mantissa) = octave_of(width);
    let quarters = QUARTERS.map(|border| i64::from(mantissa >= border));
    let class = WIDTHS_PER_OCTAVE as i64 * (octave - FIRST_WIDTH_LOG2 as i64) + quarters.iter().sum::<i64>();
    class.clamp(0, WIDTHS as i64 - 2) as usize
}

/// The class of length that is nearest to `length`, in octaves.
fn length_class_at(length: f64) -> usize {
    let (octave, mantissa) = octave_of(length);
    let [first, _, third] = QUARTERS.map(|border| i64::from(mantissa >= border));
    let class = LENGTHS_PER_OCTAVE as i64 * (octave - FIRST_LENGTH_LOG2 as i64) + first + third;
    class.clamp(0, LENGTHS as i64 - 1) as usize
}

/// A quarter, a half and three quarters of an octave above 1.
const QUARTERS: [f64; 3] = [1.189_207_115_002_721_1, std::f64::consts::SQRT_2, 1.681_792_830_507_429];

/// A number is 2^octave times one from 1 to below 2: what its bits say, where it is above 0.
fn octave_of(number: f64) -> (i64, f64) {
    let bits = number.to_bits();
    let octave = (bits >> 52 & 0x7FF) as i64 - 1023;
    (octave, f64::from_bits(bits & 0x000F_FFFF_FFFF_FFFF | 1.0f64.to_bits()))
}

/// Whole pixels on each side of its middle that a class's light reaches at any angle, `reach` of its picture's width to each side.
fn half_of(class: usize, reach: f64) -> usize {
    (reach * class_width(class) + 1.0 - 1e-9).ceil() as usize
}

/// How far from its middle a picture has light or covers, in pictures, from products across and the squares that they hold along.
fn reach_of(across: &[Profile], energies: &[f64]) -> f64 {
    /// Share of the brightest of a cross section below which light counts as none.
    const FAINT: f64 = 1e-3;
    let brightness = |at: usize| -> f64 {
        across.iter().zip(energies).map(|(own, energy)| own.values()[at].abs() * energy.sqrt()).sum()
    };
    let count = across.first().map_or(0, |own| own.values().len());
    let most = (0..count).map(brightness).fold(0.0, f64::max);
    let middle = 0.5 * (count as f64 - 1.0);
    let lit = (0..count).filter(|at| brightness(*at) > FAINT * most);
    let reach = lit.map(|at| (at as f64 - middle).abs() + 1.0).fold(0.0, f64::max) / (2.0 * middle);
    if reach > 0.0 { reach.min(0.5) } else { 0.5 }
}

/// Blocks of a line's pixels.
fn blocks_of(half: usize) -> usize {
    (2 * half).div_ceil(BLOCK)
}

impl Thin {
    /// Tabulates a pattern whose integral over the plane is `integral`; what the samples miss of it (light
    /// beyond the picture's border) is made up for. `body_width` is the body's in pictures.
    pub fn new(
        pattern: &Pattern,
        (integral, body_width): (f64, f64),
        [disc_across, disc_along]: [Profile; 2],
    ) -> Self {
        let (mut across, mut along) = match pattern {
            Pattern::Separable(tables) if tables.rank() <= LIGHTS => {
                let ranks = 0..tables.rank();
                let across: Vec<Profile> =
                    ranks.clone().map(|k| Profile::new(|u| tables.across_at(k, u))).collect();
                (across, ranks.map(|k| Profile::new(|v| tables.along_at(k, v))).collect())
            }
            _ => products(pattern, PIXEL_SHARE * body_width),
        };
        gather_light(&mut across, &mut along);
        let none = Profile::new(|_| 0.0);
        across.resize(LIGHTS, none.clone());
        along.resize(LIGHTS, none);
        let total: f64 = across.iter().zip(&along).map(|(a, b)| a.integral() * b.integral()).sum();
        let scale: f64 = if f64::abs(total) > 1e-9 { integral / total } else { 1.0 };
        across.push(disc_across);
        along.push(disc_along.plus(integral / scale, 0.0, &disc_along));
        let energies: Vec<f64> = along.iter().map(Profile::square).collect();
        let along = tabulate_along(&along, scale);
        let reach = reach_of(&across, &energies);
        let halves: [usize; WIDTHS] = std::array::from_fn(|class| half_of(class, reach));
        let across_tables = tabulate_across(&across, &energies, &halves);
        let peak = |table: &Vec<Nodes>| table.iter().map(|[value, _]| value[LIGHTS]).fold(0.0, f32::max);
        Self {
            along_lit: along.iter().map(|table| lit(table)).collect(),
            along_peaks: along.iter().map(peak).collect(),
            across_peaks: across_tables.iter().map(Across::peak).collect(),
            across: across_tables,
            along,
            widths: std::array::from_fn(class_width),
            halves: halves.map(|half| half as u16),
            lengths: std::array::from_fn(class_length),
        }
    }

    /// Where a kernel lies.
    pub fn place(&self, pose: &Pose, body: [f64; 2]) -> ThinPlace {
        let level = pose.along[1].abs() < pose.along[0].abs();
        let (fast, slow) = if level { (1, 0) } else { (0, 1) };
        let step = [pose.across[fast], pose.along[fast]];
        let cosine = step[0].abs();
        let slope = (pose.along[fast] / pose.along[slow]).abs();
        // A mixture linear in the square has the shadow's own variance.
        let shift = slope.max(NARROWEST_BOX);
        let slant = SHIFTS[1..SHIFTS.len() - 1].iter().filter(|node| **node < shift).count();
        let [near, far] = [SHIFTS[slant], SHIFTS[slant + 1]].map(|node| node * node);
        let slant_share = ((shift * shift - near) / (far - near)).clamp(0.0, 1.0);
        let width = pose.scale[0] / cosine;
        let class = class_at(width);
        let [low, high] = [self.widths[class], self.widths[class + 1]];
        // Light grows with width, so that a mixture linear in it has the width's own; beyond the tables it is scaled.
        let share = ((width - low) / (high - low)).clamp(0.0, 1.0);
        let made_up = width / (low + (high - low) * share);
        let length = pose.scale[1];
        let length_class = length_class_at(length);
        let own_length = self.lengths[length_class];
        // A long table is stretched to this length, the pixel's part of it included; in a short one that part
        // is nearly all, and the light is scaled instead.
        let ratio = length / own_length;
        let stretch = if length > STRETCHED_PX { ratio } else { 1.0 };
        let table_length = (own_length + 2.0 * RADIUS_ALONG) * stretch;
        let intervals = self.along[length_class].len() - 1;
        // From the corner to the picture's middle across, on the streak's axis where v = 0.
        let corner = [0, 1].map(|axis| pose.corner[axis] + 0.5 * pose.scale[0] * pose.across[axis]);
        let lean = pose.along[fast] / pose.along[slow];
        let ends = body.map(|end| (end * length) as f32);
        ThinPlace {
            class: class as u16,
            half: self.halves[class + 1],
            slant: slant as u16,
            slant_share: slant_share as f32,
            length_class: length_class as u16,
            share: share as f32,
            level,
            mirrored: step[0] < 0.0,
            middle: [corner[fast] as f32, corner[slow] as f32],
            lean: lean as f32,
            inner: [ends[0] + ENDS_PX, ends[1] - ENDS_PX],
            along_steps: [(1.0 / pose.along[slow]) as f32, step[1] as f32],
            along_radius: (RADIUS_ALONG * stretch) as f32,
            along_per_pixel: (intervals as f64 / table_length) as f32,
            weight: (f64::from(pose.weight) * made_up * ratio / stretch) as f32,
        }
    }

    /// Lays a kernel's lines over a tile buffer; answers false, and does nothing, where a pixel's coverage may need cutting.
    pub(super) fn lay(
        &self,
        place: &ThinPlace,
        clip: [[i32; 2]; 2],
        mixed: &mut Vec<Four>,
        paint: &Paint,
        tile_buffer: &mut TileBuffer,
    ) -> bool {
        let at = place.class as usize * SHIFTS.len() + place.slant as usize;
        let tables = [at, at + 1, at + SHIFTS.len(), at + SHIFTS.len() + 1].map(|at| self.across_peaks[at]);
        let peak = tables.into_iter().fold(0.0, f32::max) * self.along_peaks[place.length_class as usize];
        // A NaN is not.
        let is_thin = peak * place.weight * paint.strength <= THIN_COVER;
        if !is_thin {
            return false;
        }
        let [lines, fast] = if place.level { clip } else { [clip[1], clip[0]] };
        let lines = place.lines_within(lines, fast, self.along_lit[place.length_class as usize]);
        registers::run(Lay { thin: self, place, mixed, lines, paint, tile_buffer });
        true
    }

    /// Fills `ribbon` with the lines of a kernel that meet `clip`, columns and rows of the frame. `mixed` is working memory.
    pub(super) fn fill(
        &self,
        place: &ThinPlace,
        clip: [[i32; 2]; 2],
        mixed: &mut Vec<Four>,
        ribbon: &mut Ribbon,
    ) {
        let blocks = self.mix(Plain, place, 1.0, mixed);
        let [lines, fast] = if place.level { clip } else { [clip[1], clip[0]] };
        ribbon.begin(
            place.level,
            place.lines_within(lines, fast, self.along_lit[place.length_class as usize]),
            blocks,
        );
        let along = Along::new(place, &self.along[place.length_class as usize]);
        lines::fill(place, &along, (mixed, blocks), ribbon);
    }

    /// The table of a place's own width and slant, seen in the direction of its lines, times its weight and `strength`: by node and block; how many blocks to a node.
    #[inline(always)]
    fn mix(
        &self,
        registers: impl Registers,
        place: &ThinPlace,
        strength: f32,
        mixed: &mut Vec<Four>,
    ) -> usize {
        let at = place.class as usize * SHIFTS.len() + place.slant as usize;
        let weight = place.weight * strength;
        let (narrow, wide) = ((1.0 - place.share) * weight, place.share * weight);
        let (low, high) = (self.across[at].as_wide(), &self.across[at + SHIFTS.len()]);
        let (blocks, is_whole) = (high.blocks, high.rank == RANK);
        mixed.resize((PHASES + 1) * blocks, Four::default());
        let high = &high.values;
        // Of an upright streak the second two are the first again, with no weight.
        let next = at + usize::from(place.slant_share > 0.0);
        let slanted = [self.across[next].as_wide(), &self.across[next + SHIFTS.len()].values];
        let (upright, share) = (1.0 - place.slant_share, place.slant_share);
        let weights = [narrow * upright, wide * upright, narrow * share, wide * share];
        mix_tables(registers, mixed, is_whole, [low, high, slanted[0], slanted[1]], weights);
        if place.mirrored {
            mirror(mixed, blocks, 2 * usize::from(place.half));
        }
        blocks
    }
}

/// Sums of four tables with their weights.
#[inline(always)]
fn mix_tables(
    registers: impl Registers,
    out: &mut [Four],
    is_whole: bool,
    [a, b, c, d]: [&[f32]; 4],
    weights: [f32; 4],
) {
    if is_whole {
        let tables = whole(a).iter().zip(whole(b)).zip(whole(c).iter().zip(whole(d)));
        for (out, ((a, b), (c, d))) in out.iter_mut().zip(tables) {
            registers.mix(&mut out.0, [a, b, c, d], weights);
        }
    } else {
        let tables = single(a).iter().zip(single(b)).zip(single(c).iter().zip(single(d)));
        for (out, ((a, b), (c, d))) in out.iter_mut().zip(tables) {
            registers.mix_one(&mut out.0, [a, b, c, d], weights);
        }
    }
}

/// Four pixels of all products.
#[inline(always)]
fn whole(table: &[f32]) -> &[[f32; BLOCK * RANK]] {
    table.as_chunks().0
}

/// Four pixels of the one product that is light's first and coverage's.
#[inline(always)]
fn single(table: &[f32]) -> &[[f32; BLOCK]] {
    table.as_chunks().0
}

impl ThinPlace {
    /// Those of `lines` that may meet the pixels `fast` and have light between the nodes `lit` along.
    fn lines_within(&self, lines: [i32; 2], fast: [i32; 2], lit: [f32; 2]) -> [i32; 2] {
        /// Below this, pixels a line, a streak meets them with all of its lines or next to none.
        const UPRIGHT: f32 = 1e-2;
        let half = f32::from(self.half);
        // Pixels beside the streak's middle stand at other places along it than the middle does.
        let beside = (half + 1.0) * self.along_steps[1].abs();
        let [near, far] = [-beside, beside].map(|side| side - self.along_radius);
        let per_line = 1.0 / self.along_steps[0];
        let (near, far) = (
            (lit[0] / self.along_per_pixel + near) * per_line,
            (lit[1] / self.along_per_pixel + far) * per_line,
        );
        let mut ends = [near.min(far) + self.middle[1], near.max(far) + self.middle[1]];
        if self.lean.abs() >= UPRIGHT {
            let reach = 2.0 * half + BLOCK as f32 + 1.0;
            let per_pixel = 1.0 / self.lean;
            let [a, b] = [fast[0] as f32 - reach, fast[1] as f32 + reach]
                .map(|end| (end - self.middle[0]) * per_pixel + self.middle[1]);
            ends = [ends[0].max(a.min(b)), ends[1].min(a.max(b))];
        }
        // Casts saturate.
        let first = lines[0].max((ends[0] as i32).saturating_sub(1));
        [first, lines[1].min((ends[1] as i32).saturating_add(2)).max(first)]
    }
}

/// From the last node back to the first, and from the last pixel; what pads stays behind.
fn mirror(mixed: &mut [Four], blocks: usize, pixels: usize) {
    let mut swap = |[node, pixel]: [usize; 2], [other_node, other_pixel]: [usize; 2]| {
        for k in 0..RANK {
            let at = |node: usize, pixel: usize| [node * blocks + pixel / BLOCK, pixel % BLOCK * RANK + k];
            let ([a, i], [b, j]) = (at(node, pixel), at(other_node, other_pixel));
            (mixed[a].0[i], mixed[b].0[j]) = (mixed[b].0[j], mixed[a].0[i]);
        }
    };
    for node in 0..=PHASES / 2 {
        for pixel in 0..pixels {
            // The middle node is its own partner.
            if 2 * node < PHASES || 2 * pixel < pixels {
                swap([node, pixel], [PHASES - node, pixels - 1 - pixel]);
            }
        }
    }
}
