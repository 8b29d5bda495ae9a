//! The phase function of raindrops by geometric optics: rays through spheres of water, with Fresnel's shares at every surface,
//! diffraction left out (Q = 1).
//!
//! A ray that meets a sphere at b of its radius turns by 2(i − r) after two refractions and by π − 2r more for each reflection inside,
//! sin i = b, sin r = b/n. Drops above .1 mm are so large beside a wavelength that their size drops out, but for the fine
//! structure of the bow, which the sun's disc and the spread of sizes smear: rays are counted in bins of half a degree and
//! smoothed over the sun's. The primary bow stands at 138°, 42° from the point opposite the sun, the secondary at 129°
//! (51°); each colour at its own, for its own refractive index.

#[cfg(feature = "gpu")]
mod upload;

use std::f64::consts::PI;

/// Bins over the angle θ, half a degree each.
const BINS: usize = 360;
/// Rays over b², evenly spread over the sphere's disc.
const RAYS: usize = 100_000;
/// Reflections inside that are followed; what is left after them, some ten-thousandths, goes to the last.
const ORDERS: usize = 8;
/// Refractive indices of water at 20 °C in the middles of the red, green and blue bands, 630, 540 and 460 nm \[hale-querry\].
const WATER: [f64; 3] = [1.3317, 1.3341, 1.3379];
/// Legendre moments that are kept.
const MOMENTS: usize = 21;

/// A phase function by angle, per colour.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseTable {
    /// 1/sr in the middle of every bin.
    values: Vec<[f64; 3]>,
    moments: [[f64; 3]; MOMENTS],
}

/// Share of unpolarised light that a surface reflects, at cosines outside and inside, in each polarisation.
fn fresnel(outside: f64, inside: f64, index: f64) -> [f64; 2] {
    let across = (outside - index * inside) / (outside + index * inside);
    let along = (index * outside - inside) / (index * outside + inside);
    [across * across, along * along]
}

impl PhaseTable {
    /// Raindrops without diffraction.
    pub fn drops() -> Self {
        let mut power = vec![[0.0f64; 3]; BINS];
        for band in 0..3 {
            for (bin, value) in power.iter_mut().zip(trace(WATER[band])) {
                bin[band] = value;
            }
        }
        Self::from_power(&smoothed(&power))
    }

    /// A table from the power that every bin of half a degree takes, in any unit.
    fn from_power(power: &[[f64; 3]]) -> Self {
        let edge = |i: usize| libm::cos(PI * i as f64 / BINS as f64);
        let mut total = [0.0f64; 3];
        power.iter().for_each(|bin| (0..3).for_each(|band| total[band] += bin[band]));
        let values: Vec<[f64; 3]> = power
            .iter()
            .enumerate()
            .map(|(i, bin)| {
                let solid_angle = 2.0 * PI * (edge(i) - edge(i + 1));
                std::array::from_fn(|band| bin[band] / (total[band] * solid_angle))
            })
            .collect();
        let mut table = Self { values, moments: [[0.0; 3]; MOMENTS] };
        table.normalise();
        table
    }

    /// Scales the interpolated function to 1 over the sphere and works out its moments.
    fn normalise(&mut self) {
        let count = 20 * BINS;
        let mut moments = [[0.0f64; 3]; MOMENTS];
        for i in 0..count {
            let (sin, cos) = libm::sincos(PI * (i as f64 + 0.5) / count as f64);
            let value = self.values(cos);
            let (mut below, mut own) = (1.0, cos);
            for (l, moment) in moments.iter_mut().enumerate() {
                let legendre = match l {
                    0 => 1.0,
                    1 => cos,
                    _ => {
                        let lf = l as f64;
                        (below, own) = (own, ((2.0 * lf - 1.0) * cos * own - (lf - 1.0) * below) / lf);
                        own
                    }
                };
                let share = 2.0 * PI * sin * PI / count as f64 * legendre;
                (0..3).for_each(|band| moment[band] += share * value[band]);
            }
        }
        let whole = moments[0];
        for row in self.values.iter_mut().chain(&mut moments) {
            (0..3).for_each(|band| row[band] /= whole[band]);
        }
        self.moments = moments;
    }

    /// Value for a cosine between travel directions, 1/sr per colour.
    pub fn values(&self, cos_theta: f64) -> [f64; 3] {
        let place = libm::acos(cos_theta.clamp(-1.0, 1.0)) / PI * BINS as f64 - 0.5;
        let i = (place.max(0.0) as usize).min(BINS - 2);
        let v = (place - i as f64).clamp(0.0, 1.0);
        let (a, b) = (self.values[i], self.values[i + 1]);
        std::array::from_fn(|band| a[band] + v * (b[band] - a[band]))
    }

    /// Legendre moment of a degree, 0 above the twentieth.
    pub fn moments(&self, degree: usize) -> [f64; 3] {
        self.moments.get(degree).copied().unwrap_or_default()
    }
}

/// Power by angle of rays through a sphere of this refractive index; they sum to 1.
fn trace(index: f64) -> Vec<f64> {
    let mut bins = vec![0.0; BINS];
    for ray in 0..RAYS {
        let squared = (ray as f64 + 0.5) / RAYS as f64;
        let b = squared.sqrt();
        let (i, r) = (libm::asin(b), libm::asin(b / index));
        let reflected = fresnel((1.0 - squared).sqrt(), (1.0 - squared / (index * index)).sqrt(), index);
        for share in reflected {
            let mut add = |turn: f64, power: f64| {
                // Into [0, π]: what turns past a half turn comes back on the other side.
                let turn = turn.rem_euclid(2.0 * PI);
                let angle = if turn > PI { 2.0 * PI - turn } else { turn };
                bins[((angle / PI * BINS as f64) as usize).min(BINS - 1)] += 0.5 * power / RAYS as f64;
            };
            add(PI - 2.0 * i, share);
            let mut inside = 1.0 - share;
            for order in 0..=ORDERS {
                let out = if order == ORDERS { inside } else { inside * (1.0 - share) };
                add(2.0 * (i - r) + order as f64 * (PI - 2.0 * r), out);
                inside -= out;
            }
        }
    }
    bins
}

/// A running mean over three bins: rays of the sun come from half a degree, and drops differ.
fn smoothed(power: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let at = |i: usize, band: usize| {
        let solid_angle =
            libm::cos(PI * i as f64 / BINS as f64) - libm::cos(PI * (i + 1) as f64 / BINS as f64);
        (power[i][band], solid_angle)
    };
    (0..BINS)
        .map(|i| {
            std::array::from_fn(|band| {
                let (mut sum, mut size) = (0.0, 0.0);
                for (weight, k) in [(0.25, i.saturating_sub(1)), (0.5, i), (0.25, (i + 1).min(BINS - 1))] {
                    let (power, solid_angle) = at(k, band);
                    sum += weight * power;
                    size += weight * solid_angle;
                }
                sum / size * at(i, band).1
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drops_scatter_all_and_forward_as_mie_says_without_diffraction() {
        let table = PhaseTable::drops();
        for band in 0..3 {
            assert!((table.moments(0)[band] - 1.0).abs() < 1e-9);
            // The pair of Q = 1: .884 with Q = 2 is .77 when the half that is diffracted straight on is left out.
            assert!((table.moments(1)[band] - 0.77).abs() < 0.01, "{:?}", table.moments(1));
        }
        assert!((table.moments(1)[0] - table.moments(1)[2]) > 0.0, "red is bent less");
    }

    #[test]
    fn bows_stand_where_descartes_puts_them_and_red_is_outermost() {
        /// Half a bin, and a smoothed caustic's own width.
        const PLACE: f64 = 0.8;
        let table = PhaseTable::drops();
        let most = |band: usize, range: std::ops::Range<usize>| {
            let value = |i: &usize| table.values[*i][band];
            let bin = range.max_by(|a, b| value(a).total_cmp(&value(b))).unwrap();
            (bin as f64 + 0.5) * 180.0 / BINS as f64
        };
        for band in 0..3 {
            // Least turns: cos² i = (n² − 1)/3 once reflected, (n² − 1)/8 twice.
            let least = |inner: f64| {
                let cos = ((WATER[band] * WATER[band] - 1.0) / (inner * (inner + 2.0))).sqrt();
                let (i, r) = (libm::acos(cos), libm::asin((1.0 - cos * cos).sqrt() / WATER[band]));
                (2.0 * (i - r) + inner * (PI - 2.0 * r)).to_degrees()
            };
            let (primary, secondary) = (least(1.0), 360.0 - least(2.0));
            println!("band {band}: bows at {primary:.2}° and {secondary:.2}°");
            assert!((most(band, 264..300) - primary).abs() < PLACE, "{}", most(band, 264..300));
            assert!((most(band, 240..264) - secondary).abs() < PLACE, "{}", most(band, 240..264));
        }
        // 42° from the antisolar point: red at the smaller turn, blue inside; the second bow the other way round.
        assert!(most(0, 264..300) < most(2, 264..300) && most(0, 240..264) > most(2, 240..264));
        // Alexander's band between them is darker than either side.
        let at = |degrees: usize| table.values[2 * degrees][1];
        assert!(at(133) < 0.5 * at(145) && at(133) < 0.8 * at(122));
    }
}
