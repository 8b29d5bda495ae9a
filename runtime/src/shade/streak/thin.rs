//! Streaks too thin to show what is across them: a few products, across × along.
//!
//! I(u, v) ≈ m(u) · Σ P_k(u) V_k(v), k = 0 … 3, with m the mean light across, P_k the polynomials that are
//! orthonormal under m, and V_k(v) = ∫ I(u, v) P_k(u) du. The first product holds the light of every cross
//! section exactly, the next ones its centre, width and skewness: all that a few pixels can tell. Each factor
//! is averaged over the pixel's shadow on its own axis, and tabulated for sizes and angles once, so that a
//! thin streak, and most streaks are thin, costs four interpolations per pixel and next to nothing to begin.

use super::edge::{NARROWEST_BOX, split};
use super::profile::Profile;
use squall_formats::section::streak::Pattern;
use std::f64::consts::{FRAC_PI_4, TAU};

/// Products.
const RANK: usize = 4;
/// Pixels worked on together.
pub const THIN_LANES: usize = 4;
/// Samples of the pattern, across and along.
const SAMPLES: [usize; 2] = [48, 192];
/// Widths tabulated: pixels of the whole picture, 2^(class/4 − 4), to 16 px.
const WIDTHS: usize = 33;
const WIDTHS_PER_OCTAVE: f32 = 4.0;
const FIRST_WIDTH_LOG2: f32 = -4.0;
/// Ratio of neighbouring widths, 2^¼.
const NEXT_WIDTH: f64 = 1.189_207_115_002_721;
/// Angle classes from 0° to 45°.
const ANGLES: usize = 5;
/// Intervals across, a power of two.
const INTERVALS: usize = 64;
/// Lengths tabulated: pixels of the whole picture, 2^(class/2 − 3), to 512 px.
const LENGTHS: usize = 25;
const LENGTHS_PER_OCTAVE: f32 = 2.0;
const FIRST_LENGTH_LOG2: f32 = -3.0;

/// Longest picture whose table along is not stretched.
const STRETCHED_PX: f64 = 2.0;

/// Values of all products at one place.
type Packet = [f32; RANK];

/// A pattern in thin form.
#[derive(Clone, Debug)]
pub struct Thin {
    /// By width, then angle: packets over the picture and half a pixel's diagonal on both sides.
    across: Vec<[Packet; INTERVALS + 1]>,
    /// By length: packets over the picture and half a pixel on both sides.
    along: Vec<Vec<Packet>>,
}

/// A pattern in thin form at the scale of one kernel.
pub struct ThinKernel<'a> {
    across: [Packet; INTERVALS + 1],
    across_radius: f32,
    across_per_pixel: f32,
    along: &'a [Packet],
    along_radius: f32,
    along_per_pixel: f32,
}

/// Largest radius of a pixel's shadow: half a diagonal across; along, half a side and what stands in for
/// none.
const RADIUS_ACROSS: f64 = std::f64::consts::FRAC_1_SQRT_2;
const RADIUS_ALONG: f64 = 0.5 + 0.5 * NARROWEST_BOX;

/// Pixels that a table across spans for a picture `scale` pixels wide, and how many of them come before the
/// picture. Nodes of the narrowest tables divide a pixel evenly: linear tables then share a streak out among
/// the pixels of a lattice line exactly, however thin it is.
fn span_across(scale: f64) -> (f64, f64) {
    let span = (scale + 2.0 * RADIUS_ACROSS).max(2.0);
    (span, 0.5 * (span - scale))
}

impl Thin {
    /// Tabulates a pattern whose integral over the plane is `integral`; what the samples miss of it (light
    /// beyond the picture's border) is made up for.
    pub fn new(pattern: &Pattern, integral: f64) -> Self {
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
        let total =
            along_values.iter().map(|values| values[0]).sum::<f64>() / rows as f64 / polynomials[0][0];
        let scale = if total.abs() > 1e-9 { integral / total } else { 1.0 };
        let across: Vec<Profile> = polynomials
            .iter()
            .map(|polynomial| {
                let nodes: Vec<f64> = polynomial.iter().zip(&weight).map(|(p, m)| p * m).collect();
                Profile::new(|u| between(&nodes, u))
            })
            .collect();
        let along: Vec<Profile> = (0..RANK)
            .map(|k| {
                let nodes: Vec<f64> = along_values.iter().map(|values| values[k] * scale).collect();
                Profile::new(|v| between(&nodes, v))
            })
            .collect();
        Self { across: tabulate_across(&across), along: tabulate_along(&along) }
    }

    /// The pattern for a picture of `scale` pixels across and along, upright or level up to an angle whose
    /// tangent is `slope` in [0, 1].
    pub fn kernel(&self, scale: [f64; 2], slope: f32) -> ThinKernel<'_> {
        let angle = (libm::atanf(slope) / FRAC_PI_4 as f32 * (ANGLES - 1) as f32).round() as usize;
        let octave = (libm::log2f(scale[0] as f32) - FIRST_WIDTH_LOG2) * WIDTHS_PER_OCTAVE;
        let place = octave.clamp(0.0, (WIDTHS - 1) as f32 - 1e-3);
        let (class, share) = (place as usize, place - place.floor());
        let at = |class: usize| &self.across[class * ANGLES + angle.min(ANGLES - 1)];
        // What is mixed from two classes, or taken from the narrowest, has their width's light.
        let (width, radius) = span_across(scale[0]);
        let class_width = f64::from(libm::exp2f(class as f32 / WIDTHS_PER_OCTAVE + FIRST_WIDTH_LOG2));
        let lights = [class_width, class_width * NEXT_WIDTH].map(|width| width / span_across(width).0);
        let mixed = lights[0] + (lights[1] - lights[0]) * f64::from(share);
        let narrow = (scale[0] / (width * mixed)) as f32;
        let octave = (libm::log2f(scale[1] as f32) - FIRST_LENGTH_LOG2) * LENGTHS_PER_OCTAVE;
        let length_class = octave.round().clamp(0.0, (LENGTHS - 1) as f32);
        let own_length = libm::exp2(f64::from(length_class / LENGTHS_PER_OCTAVE + FIRST_LENGTH_LOG2));
        let along = self.along[length_class as usize].as_slice();
        // A long table is stretched to this length, the pixel's part of it included; in a short one that part
        // is nearly all, and the light is scaled instead.
        let ratio = scale[1] / own_length;
        let stretch = if scale[1] > STRETCHED_PX { ratio } else { 1.0 };
        let factor = narrow * (ratio / stretch) as f32;
        let table_length = (own_length + 2.0 * RADIUS_ALONG) * stretch;
        let (low, high) = (at(class), at(class + 1));
        let mut across = [[0.0; RANK]; INTERVALS + 1];
        for (out, (a, b)) in across.iter_mut().zip(low.iter().zip(high)) {
            for k in 0..RANK {
                out[k] = (a[k] + (b[k] - a[k]) * share) * factor;
            }
        }
        ThinKernel {
            across,
            across_radius: radius as f32,
            across_per_pixel: (INTERVALS as f64 / width) as f32,
            along,
            along_radius: (RADIUS_ALONG * stretch) as f32,
            along_per_pixel: ((along.len() - 1) as f64 / table_length) as f32,
        }
    }
}

impl ThinKernel<'_> {
    /// V at `along` pixels from the picture's corner, times `weight`.
    #[inline]
    pub fn along(&self, along: f32, weight: f32) -> Packet {
        let last = self.along.len() - 2;
        let place = (along + self.along_radius) * self.along_per_pixel;
        let (index, share) = split(place.clamp(0.0, (last + 1) as f32), last);
        let (low, high) = (&self.along[index], &self.along[index + 1]);
        let mut packet = [0.0; RANK];
        for k in 0..RANK {
            packet[k] = (low[k] + (high[k] - low[k]) * share) * weight;
        }
        packet
    }

    /// V of [`THIN_LANES`] pixels, `from` at the first and `to` one after the last: linear between.
    #[inline]
    pub fn between(from: &Packet, to: &Packet) -> [Packet; THIN_LANES] {
        let (mut values, mut value) = ([[0.0; RANK]; THIN_LANES], *from);
        let mut gain = [0.0; RANK];
        for k in 0..RANK {
            gain[k] = (to[k] - from[k]) * (1.0 / THIN_LANES as f32);
        }
        for lane in &mut values {
            *lane = value;
            for k in 0..RANK {
                value[k] += gain[k];
            }
        }
        values
    }

    /// Light of [`THIN_LANES`] pixels, the first `across` pixels across from the picture's corner, the others
    /// further steps of `step`: m·P times V. Zero outside the picture.
    #[inline]
    pub fn at(&self, across: f32, step: f32, values: &[Packet; THIN_LANES]) -> [f32; THIN_LANES] {
        // Plain loops over arrays, which become vector instructions.
        let (mut indices, mut shares) = ([0; THIN_LANES], [0.0; THIN_LANES]);
        for lane in 0..THIN_LANES {
            let place = (across + step * lane as f32 + self.across_radius) * self.across_per_pixel;
            (indices[lane], shares[lane]) = split(place.clamp(0.0, INTERVALS as f32), INTERVALS - 1);
        }
        let mut lights = [0.0; THIN_LANES];
        for lane in 0..THIN_LANES {
            let index = indices[lane];
            let (low, high) = (&self.across[index], &self.across[index + 1]);
            let mut products = [0.0; RANK];
            for k in 0..RANK {
                products[k] = (low[k] + (high[k] - low[k]) * shares[lane]) * values[lane][k];
            }
            lights[lane] = (products[0] + products[2]) + (products[1] + products[3]);
        }
        lights
    }
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

fn tabulate_across(profiles: &[Profile]) -> Vec<[Packet; INTERVALS + 1]> {
    let mut tables = Vec::with_capacity(WIDTHS * ANGLES);
    for class in 0..WIDTHS {
        let scale = libm::exp2(f64::from(class as f32 / WIDTHS_PER_OCTAVE + FIRST_WIDTH_LOG2));
        for angle in 0..ANGLES {
            let (sin, cos) = libm::sincos(FRAC_PI_4 * angle as f64 / (ANGLES - 1) as f64);
            let (width, radius) = span_across(scale);
            let place = |i: usize| width * i as f64 / INTERVALS as f64 - radius;
            // The outermost nodes stay zero, and so does every place beyond them.
            let mut table = [[0.0; RANK]; INTERVALS + 1];
            for (i, packet) in table.iter_mut().enumerate().skip(1).take(INTERVALS - 1) {
                let mean = |profile: &Profile| profile.mean_over_pixel(place(i), scale, [cos, sin]) as f32;
                *packet = std::array::from_fn(|k| mean(&profiles[k]));
            }
            tables.push(table);
        }
    }
    tables
}

fn tabulate_along(profiles: &[Profile]) -> Vec<Vec<Packet>> {
    let table = |class: usize| {
        let scale = libm::exp2(f64::from(class as f32 / LENGTHS_PER_OCTAVE + FIRST_LENGTH_LOG2));
        let length = scale + 2.0 * RADIUS_ALONG;
        let intervals = ((3.0 * length) as usize).clamp(24, 512);
        let place = |i: usize| length * i as f64 / intervals as f64 - RADIUS_ALONG;
        let packet = |i: usize| {
            if i == 0 || i == intervals {
                return [0.0; RANK];
            }
            std::array::from_fn(|k| profiles[k].mean_over_pixel(place(i), scale, [1.0, 0.0]) as f32)
        };
        (0..=intervals).map(packet).collect()
    };
    (0..LENGTHS).map(table).collect()
}
