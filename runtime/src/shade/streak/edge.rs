//! A soft edge seen through a pixel: tables over angle and softness, made once for all patterns.
//!
//! A pixel is a unit square. Across a line at angle θ its shadow is a trapezoid, two boxes of width |cos θ|
//! and |sin θ| convolved, so a blurred step seen through it is the second difference of the step's second
//! integral. Shadows of all pixels of a lattice add up to a constant across any lattice line, which is what
//! keeps the light of a streak thinner than a pixel the same wherever it falls.

#[cfg(feature = "gpu")]
mod nodes;

/// Pixels worked on together.
pub(super) const LANES: usize = 8;
/// Angle classes from 0° to 45°, and softness classes, 2^(class/4 − 4) pixels.
const ANGLES: usize = 5;
const SOFTNESSES: usize = 37;
const SOFTNESS_PER_OCTAVE: f32 = 4.0;
const SOFTEST_LOG2: f32 = -4.0;
/// Table intervals from one end of the transition to the other, a power of two.
const INTERVALS: usize = 32;
/// A blurred step is 0 or 1 to single precision this many softnesses from its place.
const RADIUS: f64 = 3.6;
/// The narrower of a pixel's two boxes is kept this wide, so that a second difference stays one and linear
/// tables can follow it. The wider box alone makes sums over the lattice constant there, and the added
/// variance is a sixteenth of the pixel's own.
pub const NARROWEST_BOX: f64 = 0.25;
/// Variance of a pixel's shadow at any angle, square pixels.
pub const PIXEL_VARIANCE: f32 = 1.0 / 12.0;

/// Second integral of ½(1 + erf x).
fn second_integral(x: f64) -> f64 {
    const HALF_OVER_ROOT_PI: f64 = 0.25 * std::f64::consts::FRAC_2_SQRT_PI;
    if x > 6.0 {
        return 0.5 * x * x + 0.25;
    }
    if x < -6.0 {
        return 0.0;
    }
    0.5 * ((0.5 * x * x + 0.25) * (1.0 + libm::erf(x)) + x * libm::exp(-x * x) * HALF_OVER_ROOT_PI)
}

/// One transition from 0 to 1, read linearly.
#[derive(Clone, Debug)]
struct Transition {
    /// Half its length, pixels.
    radius: f32,
    /// One more than [`INTERVALS`] values.
    values: [f32; INTERVALS + 1],
}

/// All transitions.
#[derive(Clone, Debug)]
pub struct EdgeTable {
    transitions: Vec<Transition>,
}

/// A transition at the scale of one streak.
#[derive(Clone, Copy, Debug)]
pub struct Edge<'a> {
    values: &'a [f32; INTERVALS + 1],
    /// Table intervals per pixel.
    per_pixel: f32,
    /// Half the transition's length, pixels.
    pub radius: f32,
}

impl EdgeTable {
    /// Computes every class.
    pub fn new() -> Self {
        let mut transitions = Vec::with_capacity(ANGLES * SOFTNESSES);
        for angle in 0..ANGLES {
            let (sin, cos) = libm::sincos(std::f64::consts::FRAC_PI_4 * angle as f64 / (ANGLES - 1) as f64);
            let boxes = [cos, sin.max(NARROWEST_BOX)];
            for class in 0..SOFTNESSES {
                let octave = class as f32 / SOFTNESS_PER_OCTAVE + SOFTEST_LOG2;
                transitions.push(transition(boxes, libm::exp2(f64::from(octave))));
            }
        }
        Self { transitions }
    }

    /// The edge of softness `softness` pixels across a line whose direction has components of ratio
    /// `slope` = smaller/larger, in [0, 1]. Between classes the nearest is stretched to the right variance.
    pub fn edge(&self, slope: f32, softness: f32) -> Edge<'_> {
        let angle = libm::atanf(slope) * (4.0 * std::f32::consts::FRAC_1_PI) * (ANGLES - 1) as f32;
        let octave = libm::log2f(softness.max(1e-6));
        let class =
            ((octave - SOFTEST_LOG2) * SOFTNESS_PER_OCTAVE).round().clamp(0.0, (SOFTNESSES - 1) as f32);
        let own = libm::exp2f(class / SOFTNESS_PER_OCTAVE + SOFTEST_LOG2);
        let variance = |softness: f32| 0.5 * softness * softness + PIXEL_VARIANCE;
        let stretch = libm::sqrtf(variance(softness) / variance(own));
        let transition =
            &self.transitions[(angle.round() as usize).min(ANGLES - 1) * SOFTNESSES + class as usize];
        let radius = transition.radius * stretch;
        Edge { values: &transition.values, per_pixel: INTERVALS as f32 / (2.0 * radius), radius }
    }
}

impl Default for EdgeTable {
    fn default() -> Self {
        Self::new()
    }
}

fn transition(boxes: [f64; 2], softness: f64) -> Transition {
    let [a, b] = boxes;
    let radius = 0.5 * (a + b) + RADIUS * softness;
    let mut values = [0.0; INTERVALS + 1];
    for (i, value) in values.iter_mut().enumerate() {
        let x = radius * (2.0 * i as f64 / INTERVALS as f64 - 1.0);
        let at = |offset: f64| second_integral((x + offset) / softness);
        let (sum, difference) = (0.5 * (a + b), 0.5 * (a - b));
        let second = at(sum) - at(difference) - at(-difference) + at(-sum);
        *value = (second * softness * softness / (a * b)) as f32;
    }
    // The last interval ends where the step has: no jump when reading beyond it.
    values[0] = 0.0;
    values[INTERVALS] = 1.0;
    Transition { radius: radius as f32, values }
}

impl Edge<'_> {
    /// Share of each pixel that lies beyond the edge, at `distances` pixels past it, 0 to 1; and its slope per
    /// pixel.
    #[inline]
    pub fn at_all(&self, distances: &[f32; LANES]) -> [[f32; LANES]; 2] {
        // A plain loop over arrays, which becomes vector instructions.
        let (mut indices, mut shares) = ([0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let place = (distances[lane] + self.radius) * self.per_pixel;
            (indices[lane], shares[lane]) = split(place.clamp(0.0, INTERVALS as f32), INTERVALS - 1);
        }
        let mut read = [[0.0; LANES]; 2];
        for lane in 0..LANES {
            let low = self.values[indices[lane]];
            let rise = self.values[indices[lane] + 1] - low;
            read[0][lane] = low + rise * shares[lane];
            read[1][lane] = rise * self.per_pixel;
        }
        read
    }
}

/// Interval of a place in [0, `last` + 1], 0 to `last`, and how far into it, 0 to 1.
///
/// Adding 2²³ leaves the nearest whole number in the last bits of a single-precision number: a conversion
/// without the branches of a saturating cast. A whole number may give the interval before it, with a share
/// of 1: the same value.
#[inline]
pub fn split(place: f32, last: usize) -> (usize, f32) {
    const WHOLE: f32 = 8_388_608.0;
    let shifted = (place - 0.5).clamp(0.0, last as f32) + WHOLE;
    let index = (shifted.to_bits() & 0x7F_FFFF).min(last as u32);
    (index as usize, place - (shifted - WHOLE))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(edge: &Edge, distance: f32) -> f32 {
        edge.at_all(&[distance; LANES])[0][0]
    }

    #[test]
    fn a_place_splits_into_interval_and_share() {
        for step in 0..=3200 {
            let place = step as f32 * 0.01;
            let (index, share) = split(place, 31);
            assert!(index < 32 && (0.0..=1.0).contains(&share), "{place}: {index} {share}");
            assert_eq!(index as f32 + share, place);
        }
    }

    #[test]
    fn a_hard_edge_along_the_lattice_is_covered_in_proportion() {
        /// The narrow box that stands in for none, and the class of softness 2⁻⁴, blur the kinks.
        const BLUR: f32 = 0.05;
        let table = EdgeTable::new();
        let edge = table.edge(0.0, 1e-4);
        for step in -10..=10 {
            let distance = 0.1 * step as f32;
            assert!((at(&edge, distance) - (0.5 + distance).clamp(0.0, 1.0)).abs() < BLUR, "at {distance}");
        }
    }

    #[test]
    fn pixels_of_a_lattice_share_out_a_line_completely() {
        /// Linear interpolation where a lattice line's pixels change hands within a quarter of a pixel.
        const SHARED: f32 = 5e-3;
        let table = EdgeTable::new();
        // Lines along (1, 0), (1, 1) and (2, 1): pixel centres stand 1, 1/√2 and 1/√5 apart across them.
        for (slope, spacing) in [(0.0, 1.0f32), (1.0, std::f32::consts::FRAC_1_SQRT_2), (0.5, 0.447_213_6)] {
            for softness in [0.01, 0.2, 1.0] {
                let edge = table.edge(slope, softness);
                for shift in 0..8 {
                    let width = 1.5;
                    let offset = spacing * shift as f32 / 8.0;
                    let cover = |i: i32| {
                        let x = i as f32 * spacing + offset;
                        at(&edge, x + 0.5 * width) - at(&edge, x - 0.5 * width)
                    };
                    let sum: f32 = (-40..=40).map(cover).sum::<f32>() * spacing / width;
                    assert!((sum - 1.0).abs() < SHARED, "slope {slope}, softness {softness}: {sum}");
                }
            }
        }
    }
}
