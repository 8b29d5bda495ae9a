//! The medium's point spread: light of points in rain that drops scattered twice and more, seen around lamps and channels.
//!
//! What is scattered once has a closed form, [`crate::airlight`]. What is scattered more often depends, in a medium without end
//! that scatters all it takes, on the optical depth ρ from the light and the angle to the way straight from it alone: its in-scattered
//! radiance is J = I β² f(ρ, α)/ρ, and a Monte Carlo has followed photons for f (`squall synth point-spread`; nodes in [`axes`]).
//! A ray's radiance is the integral of J along it. At optical depth T from the light, looking α beside it, it is I β² M(T, α) for a
//! ray without end; one that ends where the light stands at (T′, α′), s further on, shows M(T, α) − e^{−s} M(T′, α′): a
//! difference of two look-ups, whatever the depth. Short pieces are integrated on the spot.
//!
//! | symbol | name        | unit |
//! | I      | intensity   | W/sr |
//! | β      | extinction  | 1/m  |
//! | T, ρ, s | optical depths | – |

pub mod apsf;
pub mod axes;
#[cfg(feature = "gpu")]
mod upload;

use crate::airlight::PointBeside;
use crate::medium::Phase;
use crate::parallel::prelude::*;
use axes::{ANGLES, ASYMMETRIES, FARTHEST, PHASES, RADII, VALUES};

/// f by phase function, distance and angle, single precision: what `squall synth point-spread` writes.
const SCATTERED: &[u8; 4 * VALUES] = include_bytes!("point_spread/scattered.f32");
/// Nodes over the angle of what is seen.
const SEEN: usize = 41;
/// Panels of Gauss's rule on a ray without end.
const PANELS: usize = 32;
/// The same on a short piece.
const SHORT_PANELS: usize = 3;
/// Optical depth below which a piece is short.
const SHORT: f64 = 0.1;
/// Sine of half the angle beside a light at which it is looked at in the table's first column: a lamp's own size.
const NARROWEST: f64 = 2e-4;

/// f and M of one phase function.
#[derive(Clone, Debug, PartialEq)]
pub struct PointSpread {
    phase: Phase,
    /// ln f by ρ, then angle.
    source: Vec<[f32; 3]>,
    /// ln M by T, then angle.
    seen: Vec<[f32; 3]>,
    /// Largest f from each ρ on, of any angle and colour.
    brightest: Vec<f64>,
    /// Whether colours differ.
    coloured: bool,
}

/// The value number `index` of the shipped table.
fn stored(index: usize) -> f32 {
    let at = 4 * index;
    f32::from_le_bytes([SCATTERED[at], SCATTERED[at + 1], SCATTERED[at + 2], SCATTERED[at + 3]])
}

/// The logarithm of light, which there is some of everywhere.
fn logarithm(light: f32) -> f32 {
    libm::logf(light.max(f32::MIN_POSITIVE))
}

/// ln f of Henyey and Greenstein's function, by ρ, then angle: mixed between the asymmetries beside it, over ln(1 − g).
fn of_asymmetry(g: f64) -> Vec<[f32; 3]> {
    let last = ASYMMETRIES.len() - 1;
    let upper = ASYMMETRIES.iter().position(|&node| node > g).unwrap_or(last).max(1);
    let place = |g: f64| libm::log1p(-g);
    let [low, high] = [upper - 1, upper].map(|i| place(ASYMMETRIES[i]));
    let share = ((place(g.clamp(ASYMMETRIES[0], ASYMMETRIES[last])) - low) / (high - low)) as f32;
    let node = |phase: usize, i: usize| logarithm(stored(phase * RADII * ANGLES + i));
    (0..RADII * ANGLES)
        .map(|i| {
            let [a, b] = [node(upper - 1, i), node(upper, i)];
            [a + share * (b - a); 3]
        })
        .collect()
}

/// Bilinear look-up of logarithms in rows of `columns` values: light falls by powers of the angle and exponentially with the depth.
#[inline]
fn lookup(table: &[[f32; 3]], coloured: bool, columns: usize, (row, column): (f64, f64)) -> [f64; 3] {
    let (i, j) = ((row as usize).min(RADII - 2), (column as usize).min(columns - 2));
    let (v, w) = ((row - i as f64) as f32, (column - j as f64) as f32);
    let at = i * columns + j;
    let (a, b) = (&table[at..at + 2], &table[at + columns..at + columns + 2]);
    let light = |band: usize| {
        let mix = |pair: &[[f32; 3]]| pair[0][band] + w * (pair[1][band] - pair[0][band]);
        f64::from(libm::expf(mix(a) + v * (mix(b) - mix(a))))
    };
    if coloured { std::array::from_fn(light) } else { [light(0); 3] }
}

impl PointSpread {
    /// Works the tables of a phase function out, some ten milliseconds. The paper's function as printed loses nearly all light at each
    /// scattering; nothing is left of it after two.
    pub fn new(phase: &Phase) -> Self {
        let source = match phase {
            &Phase::HenyeyGreenstein(g) => of_asymmetry(g),
            Phase::Table(_) => {
                let band =
                    |band: usize, i: usize| logarithm(stored((PHASES - 3 + band) * RADII * ANGLES + i));
                (0..RADII * ANGLES).map(|i| std::array::from_fn(|b| band(b, i))).collect()
            }
            Phase::Paper(_) => Vec::new(),
        };
        Self::of_logarithms(phase, source)
    }

    /// The same of an f from elsewhere: [`axes::RADII`] × [`axes::ANGLES`] values.
    ///
    /// # Panics
    ///
    /// With another number of values.
    #[doc(hidden)]
    pub fn of_source(phase: &Phase, source: &[[f32; 3]]) -> Self {
        assert_eq!(source.len(), RADII * ANGLES, "values of scattered light");
        Self::of_logarithms(phase, source.iter().map(|light| light.map(logarithm)).collect())
    }

    fn of_logarithms(phase: &Phase, source: Vec<[f32; 3]>) -> Self {
        let coloured = source.iter().any(|light| light[0] != light[1] || light[0] != light[2]);
        let mut brightest: Vec<f64> = source
            .chunks(ANGLES)
            .map(|row| row.iter().flatten().fold(0.0, |most: f64, &log| most.max(libm::exp(f64::from(log)))))
            .collect();
        for i in (1..brightest.len()).rev() {
            brightest[i - 1] = brightest[i - 1].max(brightest[i]);
        }
        let mut spread = Self { phase: phase.clone(), source, seen: Vec::new(), brightest, coloured };
        if spread.is_dark() {
            return spread;
        }
        let mut seen = vec![[0.0; 3]; RADII * SEEN];
        seen.par_chunks_mut(SEEN).enumerate().for_each(|(i, row)| {
            let depth = axes::radius(i);
            for (j, value) in row.iter_mut().enumerate() {
                let sine = axes::sine(j as f64, SEEN).clamp(NARROWEST, 1.0);
                // cos α and sin α from sin(α/2).
                let cos = 1.0 - 2.0 * sine * sine;
                let across = 2.0 * sine * (1.0 - sine * sine).max(NARROWEST * NARROWEST).sqrt();
                let beside = PointBeside { h: depth * across, foot: depth * cos, end: f64::INFINITY };
                *value = spread.by_rule(1.0, &beside, PANELS).map(|value| logarithm(value as f32));
            }
        });
        spread.seen = seen;
        spread
    }

    /// The phase function.
    pub fn phase(&self) -> &Phase {
        &self.phase
    }

    /// Whether it holds no light at all, as of the paper's phase function.
    pub fn is_dark(&self) -> bool {
        self.source.is_empty()
    }

    /// ρ J / (I β²) at optical depth `depth` from the light, for light that travels at an angle of this sine of its half to the way
    /// straight from it; per colour, 1/sr.
    pub fn lookup_scattered(&self, depth: f64, half_sine: f64) -> [f64; 3] {
        if self.is_dark() || depth >= FARTHEST {
            return [0.0; 3];
        }
        lookup(
            &self.source,
            self.coloured,
            ANGLES,
            (axes::radius_place(depth), axes::angle_place(half_sine, ANGLES)),
        )
    }

    /// M at an optical depth from the light, looking beside it by an angle of this sine of its half.
    pub fn lookup_seen(&self, depth: f64, half_sine: f64) -> [f64; 3] {
        if self.is_dark() || depth >= FARTHEST {
            return [0.0; 3];
        }
        lookup(
            &self.seen,
            self.coloured,
            SEEN,
            (axes::radius_place(depth), axes::angle_place(half_sine, SEEN)),
        )
    }

    /// The integral itself by Gauss's rule of three points in each of some panels, over u,
    /// t = h sinh u, where dt/ρ is even and sin²(α/2) = 1/(1 + e^−2u).
    fn by_rule(&self, extinction: f64, beside: &PointBeside, panels: usize) -> [f64; 3] {
        let PointBeside { h, foot, end } = *beside;
        let thickness = extinction * h;
        if thickness >= FARTHEST {
            return [0.0; 3];
        }
        let last = (FARTHEST * FARTHEST - thickness * thickness).sqrt() / extinction;
        let [from, to] = [(-foot).max(-last), (end - foot).min(last)].map(|t| libm::asinh(t / h));
        if from >= to {
            return [0.0; 3];
        }
        let size = (to - from) / panels as f64;
        let mut sum = [0.0; 3];
        for panel in 0..panels {
            let middle = from + size * (panel as f64 + 0.5);
            for (weight, off) in [(5.0, -0.5), (8.0, 0.0), (5.0, 0.5)] {
                let grown = libm::exp(middle + off * size * 0.6f64.sqrt());
                let (sinh, cosh) = (0.5 * (grown - 1.0 / grown), 0.5 * (grown + 1.0 / grown));
                let sine = (grown * grown / (1.0 + grown * grown)).sqrt();
                let left = size * weight / 18.0 * libm::exp(-extinction * foot - thickness * sinh);
                let light = self.lookup_scattered(thickness * cosh, sine);
                (0..3).for_each(|band| sum[band] += left * light[band]);
            }
        }
        sum
    }

    /// The slow truth of [`PointSpread::of_point`]: by so many panels that more change nothing, 1/m² per colour.
    pub fn solve_point(&self, extinction: f64, beside: &PointBeside) -> [f64; 3] {
        self.by_rule(extinction, beside, 5_000).map(|value| value * extinction * extinction)
    }

    /// Largest radiance per unit of intensity, 1/m², that any ray sees from a distance of a point, m: straight towards it, of the
    /// brightest colour.
    pub fn most_at(&self, extinction: f64, distance: f64) -> f64 {
        let light = self.lookup_seen(extinction * distance, 0.0);
        light[0].max(light[1]).max(light[2]) * extinction * extinction
    }

    /// Largest radiance per unit of intensity, 1/m², that `length` m of a ray show none of which is nearer to a point than `near` m,
    /// `length` and `near` above 0: light within a depth of any ray falls with the distance from its source.
    pub(crate) fn most_of_piece(&self, extinction: f64, near: f64, length: f64) -> f64 {
        let depth = extinction * near;
        if self.is_dark() || depth >= FARTHEST {
            return 0.0;
        }
        // The node below has the brighter light.
        let node = (axes::radius_place(depth) as usize).min(RADII - 1);
        self.brightest[node] / depth * extinction * extinction * extinction * length
    }

    /// Radiance per unit of the point's intensity that a medium of this extinction, 1/m, scatters twice and more into a ray, 1/m² per
    /// colour. Within 1.5 % of the integral along the ray, of the whole ray's where it is cut.
    pub fn of_point(&self, extinction: f64, beside: &PointBeside) -> [f64; 3] {
        let PointBeside { h, foot, end } = *beside;
        // Written so that NaN is nothing too.
        let lit = extinction > 0.0 && end > 0.0;
        if self.is_dark() || !lit {
            return [0.0; 3];
        }
        let squared = extinction * extinction;
        if extinction * end < SHORT {
            return self.by_rule(extinction, beside, SHORT_PANELS).map(|value| value * squared);
        }
        let (distance, sine) = seen_from(h, foot);
        let whole = self.lookup_seen(extinction * distance, sine);
        let left = libm::exp(-extinction * end);
        if left == 0.0 {
            return whole.map(|value| value * squared);
        }
        let (distance, sine) = seen_from(h, foot - end);
        let beyond = self.lookup_seen(extinction * distance, sine);
        std::array::from_fn(|band| (whole[band] - left * beyond[band]).max(0.0) * squared)
    }
}

/// Distance of a point and the sine of half the angle to it, from a place with its foot `foot` ahead and `h` beside.
fn seen_from(h: f64, foot: f64) -> (f64, f64) {
    let distance = (h * h + foot * foot).sqrt();
    // (1 − cos α)/2, in a form that keeps its digits straight ahead.
    let less = if foot > 0.0 { h * h / (distance + foot) } else { distance - foot };
    (distance, (0.5 * less / distance).sqrt())
}

#[cfg(test)]
mod tests;
