//! Streaks too thin to show what is across them: a few products, across × along.
//!
//! I(u, v) ≈ m(u) · Σ P_k(u) V_k(v), k = 0 … 3, with m the mean light across, P_k the polynomials that are
//! orthonormal under m, and V_k(v) = ∫ I(u, v) P_k(u) du. The first product holds the light of every cross
//! section exactly, the next ones its centre, width and skewness: all that a few pixels can tell. A pattern that IS
//! two products stays those two.
//!
//! Each factor is averaged over the pixel's shadow on its own axis, and tabulated for sizes and angles once. Across, the axis is the
//! LINE of pixels itself (a row, of a rather upright streak): one pixel is then a whole number of the table's nodes at any angle, all
//! pixels of a line stand at the same share between two nodes, and a table has them side by side: no search and no gathering per
//! pixel. A line costs two places along the streak and a dozen vector operations for each four pixels.

#[cfg(feature = "gpu")]
pub mod tables;

use super::Pose;
use super::edge::{NARROWEST_BOX, split};
use super::profile::Profile;
use squall_formats::section::streak::Pattern;
use std::f64::consts::TAU;

/// Products.
const RANK: usize = 4;
/// Products of a width too narrow to show more, or of a pattern that has no more.
const LOW_RANK: usize = 2;
/// What the last two products may hold of the light's square where they are left out.
const UNSEEN: f64 = 3e-5;
/// Pixels worked on together.
pub const THIN_LANES: usize = 4;
/// Samples of the pattern, across and along.
const SAMPLES: [usize; 2] = [48, 192];
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

/// Longest picture whose table along is not stretched.
const STRETCHED_PX: f64 = 2.0;
/// Gain along the streak over four pixels of a line that is as good as none.
const LEVEL: f32 = 0.25;

/// How far into the body its ends are soft, px at most.
const ENDS_PX: f32 = 4.0;

/// Values of all products at one place.
type Packet = [f32; RANK];

/// A width's table across: for every node of a pixel and every product, the pixels of a line.
#[derive(Clone, Debug)]
struct Across {
    /// Products that show.
    rank: usize,
    /// By node (one more than [`PHASES`]), then product: the pixels of a line, padded to whole lanes.
    values: Vec<f32>,
    /// The same with as many pixels as the next wider class has, where those are others.
    wider: Option<Vec<f32>>,
}

/// A pattern in thin form.
#[derive(Clone, Debug)]
pub struct Thin {
    /// By width, then shift.
    across: Vec<Across>,
    /// By length: packets over the picture and half a pixel on both sides.
    along: Vec<Vec<Packet>>,
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

/// Whole pixels on each side of its middle that a class's light reaches at any angle.
fn half_of(class: usize) -> usize {
    (0.5 * class_width(class) + 1.0 - 1e-9).ceil() as usize
}

fn lanes_of(half: usize) -> usize {
    (2 * half).next_multiple_of(THIN_LANES)
}

impl Thin {
    /// Tabulates a pattern whose integral over the plane is `integral`; what the samples miss of it (light
    /// beyond the picture's border) is made up for.
    pub fn new(pattern: &Pattern, integral: f64) -> Self {
        let (across, along, total) = match pattern {
            Pattern::Separable(tables) if tables.rank() <= LOW_RANK => {
                let ranks = 0..tables.rank();
                let across: Vec<Profile> =
                    ranks.clone().map(|k| Profile::new(|u| tables.across_at(k, u))).collect();
                let along: Vec<Profile> = ranks.map(|k| Profile::new(|v| tables.along_at(k, v))).collect();
                let total = across.iter().zip(&along).map(|(a, b)| a.integral() * b.integral()).sum();
                (across, along, total)
            }
            _ => moments(pattern),
        };
        let scale: f64 = if f64::abs(total) > 1e-9 { integral / total } else { 1.0 };
        let energies: Vec<f64> = along.iter().map(Profile::square).collect();
        Self { across: tabulate_across(&across, &energies), along: tabulate_along(&along, scale) }
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
        let octave = (libm::log2f(width as f32) - FIRST_WIDTH_LOG2) * WIDTHS_PER_OCTAVE;
        let class = octave.clamp(0.0, (WIDTHS - 2) as f32) as usize;
        let [low, high] = [class_width(class), class_width(class + 1)];
        // Light grows with width, so that a mixture linear in it has the width's own; beyond the tables it is scaled.
        let share = ((width - low) / (high - low)).clamp(0.0, 1.0);
        let made_up = width / (low + (high - low) * share);
        let length = pose.scale[1];
        let octave = (libm::log2f(length as f32) - FIRST_LENGTH_LOG2) * LENGTHS_PER_OCTAVE;
        let length_class = octave.round().clamp(0.0, (LENGTHS - 1) as f32);
        let own_length = libm::exp2(f64::from(length_class / LENGTHS_PER_OCTAVE + FIRST_LENGTH_LOG2));
        // A long table is stretched to this length, the pixel's part of it included; in a short one that part
        // is nearly all, and the light is scaled instead.
        let ratio = length / own_length;
        let stretch = if length > STRETCHED_PX { ratio } else { 1.0 };
        let table_length = (own_length + 2.0 * RADIUS_ALONG) * stretch;
        let intervals = self.along[length_class as usize].len() - 1;
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

    /// Hands each line of a kernel inside `clip` (first and end pixel of a line, first and end line) to `put`: line, first pixel, how
    /// many, and their light, padded to whole lanes. `mixed` is working memory.
    pub fn lines(
        &self,
        place: &ThinPlace,
        clip: [[i32; 2]; 2],
        mixed: &mut Vec<f32>,
        put: &mut impl FnMut(i32, i32, usize, &mut [f32]),
    ) {
        let half = half_of(place.class as usize + 1);
        let lanes = lanes_of(half);
        self.mix(place, (half, lanes), mixed);
        let low_rank = self.across[(place.class as usize + 1) * SHIFTS.len()].rank == LOW_RANK;
        // Sizes that the compiler knows become plain vector code.
        match (low_rank, lanes) {
            (true, THIN_LANES) => self.rank_lines::<LOW_RANK, THIN_LANES>(place, clip, half, mixed, put),
            (true, _) => self.rank_lines::<LOW_RANK, 0>(place, clip, half, mixed, put),
            (false, THIN_LANES) => self.rank_lines::<RANK, THIN_LANES>(place, clip, half, mixed, put),
            (false, _) => self.rank_lines::<RANK, 0>(place, clip, half, mixed, put),
        }
    }

    /// [`Thin::lines`] of `K` products and `L` pixels a line; 0 where those are more than one block.
    #[inline(always)]
    fn rank_lines<const K: usize, const L: usize>(
        &self,
        place: &ThinPlace,
        clip: [[i32; 2]; 2],
        half: usize,
        mixed: &[f32],
        put: &mut impl FnMut(i32, i32, usize, &mut [f32]),
    ) {
        let lanes = if L == 0 { lanes_of(half) } else { L };
        let table = self.along[place.length_class as usize].as_slice();
        let step = place.along_steps[1];
        let level = (step * lanes as f32).abs() < LEVEL;
        let mut lights = [0.0f32; MOST_LANES + THIN_LANES];
        for line in clip[1][0]..clip[1][1] {
            let down = line as f32 + 0.5 - place.middle[1];
            let middle = place.middle[0] + place.lean * down;
            let start = middle - half as f32 - 0.5;
            // Casts round toward zero; the first pixel lies at or beyond the start.
            let whole = start as i32;
            let first = whole + i32::from(start > whole as f32);
            let (from, to) = (first.max(clip[0][0]), first.saturating_add(lanes as i32).min(clip[0][1]));
            if from >= to {
                continue;
            }
            let node = ((first as f32 - start) * PHASES as f32).clamp(0.0, PHASES as f32);
            let (index, share) = split(node, PHASES - 1);
            let nodes = &mixed[index * RANK * lanes..(index + 2) * RANK * lanes];
            let (low, high) = nodes.split_at(RANK * lanes);
            let along = place.along_steps[0] * down;
            if level {
                let here = place.along_at(table, along);
                for block in (0..lanes).step_by(THIN_LANES) {
                    let [sums, _] = products::<K>(low, high, (block, lanes), share, &here, &here);
                    put_block(&mut lights, block, sums, place.weight);
                }
            } else {
                // Near its ends a leaning streak is looked up pixel by pixel; elsewhere it is linear over a block.
                let begin = along + step * (first as f32 + 0.5 - middle);
                let end = begin + step * lanes as f32;
                let inner = begin.min(end) > place.inner[0] && begin.max(end) < place.inner[1];
                let mut here = place.along_at(table, begin);
                for block in (0..lanes).step_by(THIN_LANES) {
                    let at = begin + step * block as f32;
                    let mut sums = [0.0; THIN_LANES];
                    if inner {
                        let next = place.along_at(table, at + step * THIN_LANES as f32);
                        let mut gain = [0.0; RANK];
                        for k in 0..RANK {
                            gain[k] = (next[k] - here[k]) * (1.0 / THIN_LANES as f32);
                        }
                        let [values, gains] = products::<K>(low, high, (block, lanes), share, &here, &gain);
                        for lane in 0..THIN_LANES {
                            sums[lane] = values[lane] + LANES[lane] * gains[lane];
                        }
                        here = next;
                    } else {
                        for lane in 0..THIN_LANES {
                            let own = place.along_at(table, at + step * lane as f32);
                            let (low, high) = (&low[block + lane..], &high[block + lane..]);
                            for k in 0..K {
                                let (a, b) = (low[k * lanes], high[k * lanes]);
                                sums[lane] += (a + (b - a) * share) * own[k];
                            }
                        }
                    }
                    put_block(&mut lights, block, sums, place.weight);
                }
            }
            let (skipped, count) = ((from - first) as usize, (to - from) as usize);
            put(line, from, count, &mut lights[skipped..skipped + count.next_multiple_of(THIN_LANES)]);
        }
    }

    /// The table of a place's own width and slant, seen in the direction of its lines.
    fn mix(&self, place: &ThinPlace, (half, lanes): (usize, usize), mixed: &mut Vec<f32>) {
        let tables = |slant: usize| {
            let at = place.class as usize * SHIFTS.len() + slant;
            let low = &self.across[at];
            (low.wider.as_ref().unwrap_or(&low.values), &self.across[at + SHIFTS.len()].values)
        };
        let (low, high) = tables(place.slant as usize);
        mixed.resize(high.len(), 0.0);
        for ((out, a), b) in mixed.iter_mut().zip(low).zip(high) {
            *out = a + (b - a) * place.share;
        }
        if place.slant_share > 0.0 {
            let (low, high) = tables(place.slant as usize + 1);
            for ((out, a), b) in mixed.iter_mut().zip(low).zip(high) {
                let next = a + (b - a) * place.share;
                *out += (next - *out) * place.slant_share;
            }
        }
        if place.mirrored {
            // From the last node back to the first, and from the last pixel; what pads stays behind.
            let pixels = 2 * half;
            for node in 0..=PHASES / 2 {
                for k in 0..RANK {
                    let [here, there] = [node, PHASES - node].map(|node| (node * RANK + k) * lanes);
                    for pixel in 0..pixels {
                        // The middle node is its own partner.
                        if here < there || 2 * pixel < pixels {
                            mixed.swap(here + pixel, there + pixels - 1 - pixel);
                        }
                    }
                }
            }
        }
    }
}

const LANES: [f32; THIN_LANES] = [0.0, 1.0, 2.0, 3.0];

/// A block of the table across, between two nodes, times values along; and the same times gains along.
#[inline(always)]
fn products<const K: usize>(
    low: &[f32],
    high: &[f32],
    (block, lanes): (usize, usize),
    share: f32,
    values: &Packet,
    gains: &Packet,
) -> [[f32; THIN_LANES]; 2] {
    let mut sums = [[0.0f32; THIN_LANES]; 2];
    for k in 0..K {
        let at = k * lanes + block;
        let (Some(a), Some(b)) = (
            low.get(at..).and_then(<[f32]>::first_chunk::<THIN_LANES>),
            high.get(at..).and_then(<[f32]>::first_chunk::<THIN_LANES>),
        ) else {
            return sums;
        };
        for lane in 0..THIN_LANES {
            let across = a[lane] + (b[lane] - a[lane]) * share;
            sums[0][lane] += across * values[k];
            sums[1][lane] += across * gains[k];
        }
    }
    sums
}

#[inline(always)]
fn put_block(
    lights: &mut [f32; MOST_LANES + THIN_LANES],
    block: usize,
    sums: [f32; THIN_LANES],
    weight: f32,
) {
    if let Some(out) = lights.get_mut(block..).and_then(<[f32]>::first_chunk_mut::<THIN_LANES>) {
        for lane in 0..THIN_LANES {
            out[lane] = sums[lane] * weight;
        }
    }
}

/// Most pixels of a line, padded.
const MOST_LANES: usize = 28;

impl ThinPlace {
    /// V at `along` pixels from the picture's beginning.
    #[inline(always)]
    fn along_at(&self, table: &[Packet], along: f32) -> Packet {
        let last = table.len() - 2;
        let place = (along + self.along_radius) * self.along_per_pixel;
        let (index, share) = split(place.clamp(0.0, (last + 1) as f32), last);
        let (low, high) = (&table[index], &table[index + 1]);
        let mut packet = [0.0; RANK];
        for k in 0..RANK {
            packet[k] = low[k] + (high[k] - low[k]) * share;
        }
        packet
    }
}

/// Profiles across and along of a pattern by moments, and their integral.
fn moments(pattern: &Pattern) -> (Vec<Profile>, Vec<Profile>, f64) {
    let [columns, rows] = SAMPLES;
    let light = sample(pattern);
    let mut weight: Vec<f64> = (0..columns)
        .map(|i| (0..rows).map(|j| light[j * columns + i].abs()).sum::<f64>() / rows as f64)
        .collect();
    if weight.iter().all(|&value| value <= 0.0) {
        weight.fill(1.0);
    }
    let polynomials = orthonormal(&weight);
    let du = 1.0 / columns as f64;
    let mut along_values = vec![[0.0; RANK]; rows];
    for (j, out) in along_values.iter_mut().enumerate() {
        let section = &light[j * columns..][..columns];
        for (value, polynomial) in out.iter_mut().zip(&polynomials) {
            *value = section.iter().zip(polynomial).map(|(a, b)| a * b).sum::<f64>() * du;
        }
    }
    // ∫ m P_0 du is P_0⁻¹ by orthonormality, and P_0 is a constant.
    let total = along_values.iter().map(|values| values[0]).sum::<f64>() / rows as f64 / polynomials[0][0];
    let across = polynomials.iter().map(|polynomial| {
        let nodes: Vec<f64> = polynomial.iter().zip(&weight).map(|(p, m)| p * m).collect();
        Profile::new(|u| between(&nodes, u))
    });
    let along = (0..RANK).map(|k| {
        let nodes: Vec<f64> = along_values.iter().map(|values| values[k]).collect();
        Profile::new(|v| between(&nodes, v))
    });
    (across.collect(), along.collect(), total)
}

/// The pattern at the middles of a grid of cells, u fastest.
fn sample(pattern: &Pattern) -> Vec<f64> {
    let [columns, rows] = SAMPLES;
    let place = |index: usize, count: usize| (index as f64 + 0.5) / count as f64;
    let cells = (0..columns * rows).map(|i| (i % columns, i / columns));
    let Pattern::Cosines(cosines) = pattern else {
        return cells.map(|(i, j)| pattern.value(place(i, columns), place(j, rows))).collect();
    };
    // A term is a factor per column times a factor per row: no cosine per cell.
    let unit = |turns: f64| {
        let (sin, cos) = libm::sincos(TAU * (turns - turns.floor()));
        [cos, sin]
    };
    let mut sums = vec![cosines.constant; columns * rows];
    for term in &cosines.terms {
        let across: Vec<[f64; 2]> =
            (0..columns).map(|i| unit(term.across * place(i, columns) + term.phase / TAU)).collect();
        for j in 0..rows {
            let [cos, sin] = unit(term.along * place(j, rows)).map(|part| part * term.amplitude);
            for (sum, [a, b]) in sums[j * columns..][..columns].iter_mut().zip(&across) {
                *sum += a * cos - b * sin;
            }
        }
    }
    cells
        .zip(sums)
        .map(|((i, j), sum)| sum * cosines.window.value(place(i, columns), place(j, rows)))
        .collect()
}

/// Values at the cells' middles of polynomials of degree 0, 1, … that are orthonormal under `weight`.
fn orthonormal(weight: &[f64]) -> Vec<Vec<f64>> {
    let step = 1.0 / weight.len() as f64;
    let dot = |a: &[f64], b: &[f64]| -> f64 {
        a.iter().zip(b).zip(weight).map(|((a, b), m)| a * b * m).sum::<f64>() * step
    };
    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(RANK);
    for degree in 0..RANK {
        let mut next: Vec<f64> = match basis.last() {
            None => vec![1.0; weight.len()],
            Some(last) => last.iter().enumerate().map(|(i, p)| p * ((i as f64 + 0.5) * step - 0.5)).collect(),
        };
        // Twice, because once leaves round-off behind.
        for _ in 0..2 {
            for other in &basis {
                let share = dot(&next, other);
                next.iter_mut().zip(other).for_each(|(value, other)| *value -= share * other);
            }
        }
        let norm = libm::sqrt(dot(&next, &next));
        // Light in fewer columns than degrees leaves nothing for the higher ones to say.
        let factor = if norm > 1e-9 || degree == 0 { 1.0 / norm.max(1e-12) } else { 0.0 };
        next.iter_mut().for_each(|value| *value *= factor);
        basis.push(next);
    }
    basis
}

/// Linear between the middles of cells, constant in the outer half cells.
fn between(nodes: &[f64], x: f64) -> f64 {
    let place = (x * nodes.len() as f64 - 0.5).clamp(0.0, (nodes.len() - 1) as f64);
    let index = (place as usize).min(nodes.len() - 2);
    nodes[index] + (nodes[index + 1] - nodes[index]) * (place - index as f64)
}

/// Tables across of every width and shift. `energies` are the squares that the products hold along.
fn tabulate_across(profiles: &[Profile], energies: &[f64]) -> Vec<Across> {
    let mut tables = Vec::with_capacity(WIDTHS * SHIFTS.len());
    for class in 0..WIDTHS {
        for shift in SHIFTS {
            let width = class_width(class);
            let half = half_of(class);
            let values = tabulate(profiles, (width, shift), half);
            let next = half_of((class + 1).min(WIDTHS - 1));
            let wider = (next != half).then(|| tabulate(profiles, (width, shift), next));
            let lanes = lanes_of(half);
            let mut squares = [0.0; RANK];
            for (at, value) in values.iter().enumerate() {
                squares[at / lanes % RANK] += f64::from(*value) * f64::from(*value);
            }
            let held = |from: usize| {
                squares.iter().zip(energies).skip(from).map(|(across, along)| across * along).sum::<f64>()
            };
            let rank = if held(LOW_RANK) <= UNSEEN * held(0) { LOW_RANK } else { RANK };
            tables.push(Across { rank, values, wider });
        }
    }
    tables
}

/// Pixels of a line at every node: means over the shadow of a pixel on the line, a box of its own side and one of what the next lines
/// shift the streak by.
fn tabulate(profiles: &[Profile], (width, shift): (f64, f64), half: usize) -> Vec<f32> {
    let lanes = lanes_of(half);
    let mut values = vec![0.0; (PHASES + 1) * RANK * lanes];
    for node in 0..=PHASES {
        for (k, profile) in profiles.iter().enumerate() {
            let row = &mut values[(node * RANK + k) * lanes..][..2 * half];
            for (pixel, out) in row.iter_mut().enumerate() {
                let place = node as f64 / PHASES as f64 + pixel as f64 - half as f64 + 0.5 * width;
                *out = profile.mean_over_pixel(place, width, [1.0, shift]) as f32;
            }
        }
    }
    values
}

/// Packets along, for every length.
fn tabulate_along(profiles: &[Profile], light: f64) -> Vec<Vec<Packet>> {
    let table = |class: usize| {
        let scale = libm::exp2(f64::from(class as f32 / LENGTHS_PER_OCTAVE + FIRST_LENGTH_LOG2));
        let length = scale + 2.0 * RADIUS_ALONG;
        let intervals = ((3.0 * length) as usize).clamp(24, 512);
        let place = |i: usize| length * i as f64 / intervals as f64 - RADIUS_ALONG;
        let packet = |i: usize| {
            let mut packet = [0.0; RANK];
            if i > 0 && i < intervals {
                for (value, profile) in packet.iter_mut().zip(profiles) {
                    *value = (light * profile.mean_over_pixel(place(i), scale, [1.0, 0.0])) as f32;
                }
            }
            packet
        };
        (0..=intervals).map(packet).collect()
    };
    (0..LENGTHS).map(table).collect()
}
