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
use crate::registers;
use lines::Fill;
use squall_formats::section::streak::Pattern;
use tables::{gather_light, products, tabulate_across, tabulate_along};

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
/// Gain along the streak over a line's pixels that is as good as none, px.
const LEVEL: f32 = 0.25;
/// The same over a block, px, within which light is linear at a streak's ends, which a pixel blurs.
const GENTLE: f32 = 0.5;
/// How far into the body its ends are soft, px at most.
const ENDS_PX: f32 = 4.0;
/// Lines whose places are worked out together.
const LINES: usize = 32;

/// Values of all products at one place.
type Packet = [f32; RANK];
/// Four pixels of a line.
type Block = [f32; BLOCK];

/// A width's table across: for every node of a pixel and every product, the pixels of a line.
#[derive(Clone, Debug)]
struct Across {
    /// Products that show, and blocks of a line.
    rank: usize,
    blocks: usize,
    /// By node (one more than [`PHASES`]), then block of the line, then product: four pixels, the last padded.
    values: Vec<Block>,
    /// The same with as many products and pixels as the next wider class has, where those are others.
    wider: Option<Vec<Block>>,
}

impl Across {
    /// The table that is mixed with the next wider class's.
    #[inline(always)]
    fn as_wide(&self) -> &[Block] {
        self.wider.as_ref().unwrap_or(&self.values)
    }
}

/// A pattern in thin form.
#[derive(Clone, Debug)]
pub struct Thin {
    /// By width, then shift.
    across: Vec<Across>,
    /// By length: packets over the picture and half a pixel on both sides.
    along: Vec<Vec<Packet>>,
    /// The classes' widths and lengths, pixels, and what lies between two lengths.
    widths: [f64; WIDTHS],
    lengths: [f64; LENGTHS],
    length_borders: [f64; LENGTHS - 1],
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

/// How many of ascending `borders` lie at or below `value`.
fn below(borders: &[f64], value: f64) -> usize {
    borders.partition_point(|border| *border <= value)
}

/// Whole pixels on each side of its middle that a class's light reaches at any angle.
fn half_of(class: usize) -> usize {
    (0.5 * class_width(class) + 1.0 - 1e-9).ceil() as usize
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
        Self {
            across: tabulate_across(&across, &energies),
            along: tabulate_along(&along, scale),
            widths: std::array::from_fn(class_width),
            lengths: std::array::from_fn(class_length),
            length_borders: std::array::from_fn(|class| {
                (class_length(class) * class_length(class + 1)).sqrt()
            }),
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
        let class = below(&self.widths[1..WIDTHS - 1], width);
        let [low, high] = [self.widths[class], self.widths[class + 1]];
        // Light grows with width, so that a mixture linear in it has the width's own; beyond the tables it is scaled.
        let share = ((width - low) / (high - low)).clamp(0.0, 1.0);
        let made_up = width / (low + (high - low) * share);
        let length = pose.scale[1];
        let length_class = below(&self.length_borders, length);
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

    /// Fills `ribbon` with the lines of a kernel that meet `clip`, columns and rows of the frame. `mixed` is working memory.
    pub fn fill(&self, place: &ThinPlace, clip: [[i32; 2]; 2], mixed: &mut Vec<Block>, ribbon: &mut Ribbon) {
        let wider = &self.across[(place.class as usize + 1) * SHIFTS.len()];
        let blocks = wider.blocks;
        let [lines, fast] = if place.level { clip } else { [clip[1], clip[0]] };
        ribbon.begin(place.level, place.lines_within(lines, fast, blocks), blocks);
        match wider.rank == LOW_RANK {
            true => registers::run(Fill::<LOW_RANK> { thin: self, place, blocks, mixed, ribbon }),
            false => registers::run(Fill::<RANK> { thin: self, place, blocks, mixed, ribbon }),
        }
    }

    /// The table of a place's own width and slant, seen in the direction of its lines, times its weight: by node, block and product.
    #[inline(always)]
    fn mix<const K: usize>(&self, place: &ThinPlace, blocks: usize, mixed: &mut Vec<Block>) {
        let at = place.class as usize * SHIFTS.len() + place.slant as usize;
        let (narrow, wide) = (self.across[at].as_wide(), &self.across[at + SHIFTS.len()].values);
        mixed.resize(wide.len(), [0.0; BLOCK]);
        let out = mixed.as_flattened_mut();
        for ((out, low), high) in out.iter_mut().zip(narrow.as_flattened()).zip(wide.as_flattened()) {
            *out = (low + (high - low) * place.share) * place.weight;
        }
        if place.slant_share > 0.0 {
            let (narrow, wide) = (self.across[at + 1].as_wide(), &self.across[at + 1 + SHIFTS.len()].values);
            for ((out, low), high) in out.iter_mut().zip(narrow.as_flattened()).zip(wide.as_flattened()) {
                let slanted = (low + (high - low) * place.share) * place.weight;
                *out += (slanted - *out) * place.slant_share;
            }
        }
        if place.mirrored {
            mirror::<K>(mixed, blocks, 2 * half_of(place.class as usize + 1));
        }
    }
}

impl ThinPlace {
    /// Those of `lines` that may meet the pixels `fast`, with `blocks` to a line.
    fn lines_within(&self, lines: [i32; 2], fast: [i32; 2], blocks: usize) -> [i32; 2] {
        /// Below this, pixels a line, a streak meets them with all of its lines or next to none.
        const UPRIGHT: f32 = 1e-2;
        if self.lean.abs() < UPRIGHT {
            return lines;
        }
        let reach = (blocks * BLOCK) as f32 + 1.0;
        let ends = [fast[0] as f32 - reach, fast[1] as f32 + reach];
        let [a, b] = ends.map(|end| (end - self.middle[0]) / self.lean + self.middle[1]);
        // Casts saturate.
        let (first, end) = (a.min(b) as i32, a.max(b) as i32);
        let first = lines[0].max(first.saturating_sub(1));
        [first, lines[1].min(end.saturating_add(2)).max(first)]
    }
}

/// From the last node back to the first, and from the last pixel; what pads stays behind.
fn mirror<const K: usize>(mixed: &mut [Block], blocks: usize, pixels: usize) {
    let mixed = mixed.as_flattened_mut();
    let at = |node: usize, pixel: usize, k: usize| {
        ((node * blocks + pixel / BLOCK) * K + k) * BLOCK + pixel % BLOCK
    };
    for node in 0..=PHASES / 2 {
        for pixel in 0..pixels {
            // The middle node is its own partner.
            if 2 * node < PHASES || 2 * pixel < pixels {
                for k in 0..K {
                    mixed.swap(at(node, pixel, k), at(PHASES - node, pixels - 1 - pixel, k));
                }
            }
        }
    }
}
