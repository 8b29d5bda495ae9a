//! The surface of a falling raindrop: its equilibrium shape and its oscillations.
//!
//! | symbol | name          | unit |
//! | a      | `radius`      | m, of the sphere of the same volume |
//! | r      | `height`      | radii a, from the centre to the surface |
//! | c_k    | `EQUILIBRIUM` | –, of cos kθ, θ from straight down |
//! | A_nm   | `amplitude`   | –, of a surface harmonic of degree n and order m |
//! | ω_n    | `frequency`   | rad/s |
//!
//! r = s·[1 + Σ c_k cos kθ + Σ A_nm sin(ω_n t + φ_nm) Y_nm], with s such that the volume stays that of the
//! sphere. The c_k are Beard and Chuang's \[beard-chuang\], ω_n² = n(n − 1)(n + 2) σ/(ρ a³) is Rayleigh's and
//! Lamb's \[lamb\], n = 2 and 3 are the degrees that falling drops show \[garg-nayar\]. The Y_nm are Schmidt's
//! seminormalised harmonics, root mean square (2n + 1)^−½ each.
//!
//! Amplitudes do not decay: viscosity takes a²/5ν, 0.1 s and more, and the wake keeps the drop oscillating.

use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Surface tension σ, N/m, and density ρ, kg/m³, of water at 20 °C.
const SURFACE_TENSION: f64 = 0.072_75;
const DENSITY: f64 = 998.2;

/// Degree of the equilibrium's cosine series.
const DEGREE: usize = 10;
/// Diameters of the table below: 2 to 6 mm in steps of 0.5.
const TABLE_FIRST_MM: f64 = 2.0;
const TABLE_STEP_MM: f64 = 0.5;
/// c_0 … c_10 in units of 10⁻⁴. \[beard-chuang\] Table 1.
const EQUILIBRIUM: [[f64; DEGREE + 1]; 9] = [
    [-131.0, -120.0, -376.0, -96.0, -4.0, 15.0, 5.0, 0.0, -2.0, 0.0, 1.0],
    [-201.0, -172.0, -567.0, -137.0, 3.0, 29.0, 8.0, -2.0, -4.0, 0.0, 1.0],
    [-282.0, -230.0, -779.0, -175.0, 21.0, 46.0, 11.0, -6.0, -7.0, 0.0, 3.0],
    [-369.0, -285.0, -998.0, -207.0, 48.0, 68.0, 13.0, -13.0, -10.0, 0.0, 5.0],
    [-458.0, -335.0, -1211.0, -227.0, 83.0, 89.0, 12.0, -21.0, -13.0, 1.0, 8.0],
    [-549.0, -377.0, -1421.0, -240.0, 126.0, 110.0, 9.0, -31.0, -16.0, 4.0, 11.0],
    [-644.0, -416.0, -1629.0, -246.0, 176.0, 131.0, 2.0, -44.0, -18.0, 9.0, 14.0],
    [-742.0, -454.0, -1837.0, -244.0, 234.0, 150.0, -7.0, -58.0, -19.0, 15.0, 19.0],
    [-840.0, -480.0, -2034.0, -237.0, 297.0, 166.0, -21.0, -72.0, -19.0, 24.0, 23.0],
];

/// c_k of a drop of `diameter` mm, in [0, 6]: linear between the table's rows; below 2 mm the first row shrinks
/// with the square of the diameter, as the pressures that deform a drop do beside its surface tension.
fn equilibrium(diameter: f64) -> [f64; DEGREE + 1] {
    let place = ((diameter - TABLE_FIRST_MM) / TABLE_STEP_MM).clamp(0.0, (EQUILIBRIUM.len() - 1) as f64);
    let index = (place as usize).min(EQUILIBRIUM.len() - 2);
    let share = place - index as f64;
    let small = (diameter / TABLE_FIRST_MM).min(1.0);
    std::array::from_fn(|k| {
        let (low, high) = (EQUILIBRIUM[index][k], EQUILIBRIUM[index + 1][k]);
        1e-4 * small * small * (low + (high - low) * share)
    })
}

/// One standing wave of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// n, 2 or 3.
    pub degree: u32,
    /// m, 0 to 2: 0 is symmetric about the fall, 1 leans, 2 squeezes from the sides.
    pub order: u32,
    /// Where around the fall it stands, rad.
    pub azimuth: f64,
    /// A_nm, radii.
    pub amplitude: f64,
    /// φ_nm, rad.
    pub phase: f64,
}

/// A drop that oscillates.
#[derive(Clone, Debug, PartialEq)]
pub struct DropShape {
    /// Diameter of the sphere of the same volume, mm.
    pub diameter_mm: f64,
    /// What it does.
    pub modes: Vec<Mode>,
    /// 1 + Σ c_k cos kθ as a polynomial of cos θ.
    profile: [f64; DEGREE + 1],
}

/// ω_n of a drop of `diameter` mm, rad/s; `degree` ≥ 2.
pub fn frequency(degree: u32, diameter: f64) -> f64 {
    let (n, radius) = (f64::from(degree), 0.5e-3 * diameter);
    libm::sqrt(n * (n - 1.0) * (n + 2.0) * SURFACE_TENSION / (DENSITY * radius * radius * radius))
}

impl DropShape {
    /// A drop of `diameter` mm, up to 6.
    pub fn new(diameter_mm: f64, modes: Vec<Mode>) -> Self {
        Self { diameter_mm, modes, profile: to_powers(&equilibrium(diameter_mm)) }
    }

    /// The surface `time` seconds into the exposure.
    pub fn at(&self, time: f64) -> Surface {
        let mut waves = Waves::default();
        for mode in &self.modes {
            let angle = frequency(mode.degree, self.diameter_mm) * time + mode.phase;
            waves.add(mode, mode.amplitude * libm::sin(angle));
        }
        let mut surface = Surface { scale: 1.0, bound: 0.0, profile: self.profile, waves };
        surface.scale = 1.0 / libm::cbrt(surface.volume());
        // A margin over the highest of the sampled heights covers what lies between them.
        surface.bound = 1.02 * surface.highest();
        surface
    }
}

/// 1 + Σ c_k T_k(x) as coefficients of powers of x.
fn to_powers(cosines: &[f64; DEGREE + 1]) -> [f64; DEGREE + 1] {
    let mut powers = [0.0; DEGREE + 1];
    let (mut last, mut this) = ([0.0; DEGREE + 1], [0.0; DEGREE + 1]);
    this[0] = 1.0;
    powers[0] = 1.0;
    for (k, c) in cosines.iter().enumerate() {
        for (power, t) in powers.iter_mut().zip(&this) {
            *power += c * t;
        }
        // T_1 = x T_0, and T_{k+1} = 2x T_k − T_{k−1} from there.
        let factor = if k == 0 { 1.0 } else { 2.0 };
        let next = std::array::from_fn(|i| if i > 0 { factor * this[i - 1] } else { 0.0 } - last[i]);
        (last, this) = (this, next);
    }
    powers
}

/// Displacements by degree and order; pairs are along and a quarter period around.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Waves {
    w20: f64,
    w21: [f64; 2],
    w22: [f64; 2],
    w30: f64,
    w31: [f64; 2],
    w32: [f64; 2],
}

const ROOT_3: f64 = 1.732_050_807_568_877_2;
const ROOT_15: f64 = 3.872_983_346_207_417;
const ROOT_6: f64 = 2.449_489_742_783_178;

impl Waves {
    fn add(&mut self, mode: &Mode, displacement: f64) {
        let (sin, cos) = libm::sincos(f64::from(mode.order) * mode.azimuth);
        let pair = [displacement * cos, displacement * sin];
        let add = |to: &mut [f64; 2]| to.iter_mut().zip(pair).for_each(|(to, part)| *to += part);
        match (mode.degree, mode.order) {
            (2, 0) => self.w20 += displacement,
            (2, 1) => add(&mut self.w21),
            (2, _) => add(&mut self.w22),
            (_, 0) => self.w30 += displacement,
            (_, 1) => add(&mut self.w31),
            _ => add(&mut self.w32),
        }
    }

    /// Σ A Y at a unit vector, and a gradient whose tangential part is the sum's own.
    #[inline]
    fn at(&self, n: DVec3) -> (f64, DVec3) {
        let DVec3 { x, y, z } = n;
        let (zz, square, cross) = (z * z, x * x - y * y, 2.0 * x * y);
        let lean = |pair: [f64; 2]| pair[0] * x + pair[1] * y;
        let (lean2, lean3) = (ROOT_3 * lean(self.w21), 0.25 * ROOT_6 * lean(self.w31));
        let squeeze = |pair: [f64; 2]| pair[0] * square + pair[1] * cross;
        let (squeeze2, squeeze3) = (0.5 * ROOT_3 * squeeze(self.w22), 0.5 * ROOT_15 * squeeze(self.w32));
        let even = self.w20 * (1.5 * zz - 0.5) + z * lean2 + squeeze2;
        let odd = self.w30 * (2.5 * zz - 1.5) * z + (5.0 * zz - 1.0) * lean3 + z * squeeze3;
        let by_z = 3.0 * self.w20 * z + lean2 + self.w30 * (7.5 * zz - 1.5) + 10.0 * z * lean3 + squeeze3;
        // x and y enter by lean (constant slope) and by squeeze (2x, −2y; 2y, 2x).
        let a = [0, 1].map(|i| ROOT_3 * z * self.w21[i] + 0.25 * ROOT_6 * (5.0 * zz - 1.0) * self.w31[i]);
        let b = [0, 1].map(|i| ROOT_3 * self.w22[i] + ROOT_15 * z * self.w32[i]);
        let gradient = DVec3::new(a[0] + b[0] * x + b[1] * y, a[1] - b[0] * y + b[1] * x, by_z);
        (even + odd, gradient)
    }
}

/// A drop's surface at one moment, in radii a about its centre, z up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    scale: f64,
    bound: f64,
    profile: [f64; DEGREE + 1],
    waves: Waves,
}

/// Cells of the sums over the sphere, down and around.
const CELLS: [usize; 2] = [48, 16];

impl Surface {
    /// Radius of a ball that holds the drop.
    pub fn bound(&self) -> f64 {
        self.bound
    }

    /// Distance from the centre to the surface along the unit vector `n`, and a gradient of it by `n` whose
    /// tangential part alone means something.
    #[inline]
    pub fn height(&self, n: DVec3) -> (f64, DVec3) {
        // Angles count from straight down.
        let x = -n.z;
        let (mut value, mut slope) = (self.profile[DEGREE], 0.0);
        for &coefficient in self.profile[..DEGREE].iter().rev() {
            slope = slope * x + value;
            value = value * x + coefficient;
        }
        let (wave, gradient) = self.waves.at(n);
        (self.scale * (value + wave), self.scale * (gradient - DVec3::new(0.0, 0.0, slope)))
    }

    /// How far `p` lies above the surface along its own radius, radii, and the gradient of that: outward, not of
    /// unit length.
    #[inline]
    pub fn above(&self, p: DVec3) -> (f64, DVec3) {
        let distance = p.length().max(1e-9);
        let n = p / distance;
        let (height, slope) = self.height(n);
        let tangential = slope - n * slope.dot(n);
        (distance - height, n - tangential / distance)
    }

    /// Unit vectors and solid angles of cells that cover the sphere.
    fn cells() -> impl Iterator<Item = (DVec3, f64)> {
        let [down, around] = CELLS;
        (0..down * around).map(move |i| {
            let z = ((i / around) as f64 + 0.5) * 2.0 / down as f64 - 1.0;
            let (sin, cos) = libm::sincos(((i % around) as f64 + 0.5) * TAU / around as f64);
            let level = libm::sqrt(1.0 - z * z);
            (DVec3::new(level * cos, level * sin, z), 4.0 * PI / (down * around) as f64)
        })
    }

    /// Volume over that of the sphere of radius a.
    pub fn volume(&self) -> f64 {
        let cone = |(n, angle): (DVec3, f64)| {
            let height = self.height(n).0;
            height * height * height * angle
        };
        Self::cells().map(cone).sum::<f64>() / (4.0 * PI)
    }

    fn highest(&self) -> f64 {
        Self::cells().map(|(n, _)| self.height(n).0).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn modes(amplitude: f64) -> Vec<Mode> {
        let mode = |(degree, order): (u32, u32)| Mode {
            degree,
            order,
            azimuth: 0.7 + f64::from(order),
            amplitude,
            phase: 1.0 + f64::from(degree + order),
        };
        [(2, 0), (2, 1), (2, 2), (3, 0), (3, 1), (3, 2)].map(mode).to_vec()
    }

    #[test]
    fn equilibrium_shapes_have_the_volume_of_their_sphere_and_the_published_axis_ratio() {
        /// The table is printed to 10⁻⁴.
        const VOLUME: f64 = 5e-4;
        /// How far the authors' own polynomial lies from their table.
        const RATIO: f64 = 3.5e-3;
        for row in 0..EQUILIBRIUM.len() {
            let d = TABLE_FIRST_MM + TABLE_STEP_MM * row as f64;
            let shape = DropShape::new(d, vec![]);
            let raw = Surface { scale: 1.0, ..shape.at(0.0) };
            assert!((raw.volume() - 1.0).abs() < VOLUME, "{d} mm: {}", raw.volume());
            let (mut tall, mut wide) = ([0.0f64; 2], 0.0f64);
            for step in 0..=2000 {
                let (sin, cos) = libm::sincos(PI * f64::from(step) / 2000.0);
                let r = raw.height(DVec3::new(sin, 0.0, cos)).0;
                tall = [tall[0].min(r * cos), tall[1].max(r * cos)];
                wide = wide.max(r * sin);
            }
            let ratio = (tall[1] - tall[0]) / (2.0 * wide);
            let wanted = 1.0048 + d * (0.000_57 + d * (-0.026_28 + d * (0.003_682 - d * 0.000_167_7)));
            assert!((ratio - wanted).abs() < RATIO, "{d} mm: {ratio} for {wanted}");
        }
    }

    #[test]
    fn the_flat_side_is_below() {
        let surface = DropShape::new(5.0, vec![]).at(0.0);
        assert!(surface.height(-DVec3::Z).0 < surface.height(DVec3::Z).0 - 0.1);
    }

    #[test]
    fn oscillation_keeps_the_volume() {
        /// Sums over 768 cells, normalised with themselves: only round-off is left.
        const ROUND_OFF: f64 = 1e-12;
        let shape = DropShape::new(2.4, modes(0.08));
        for step in 0..20 {
            assert!((shape.at(1e-3 * f64::from(step)).volume() - 1.0).abs() < ROUND_OFF);
        }
    }

    #[test]
    fn two_millimetres_swing_at_120_hertz_and_degree_three_faster_by_the_root_of_thirty_eighths() {
        assert!((frequency(2, 2.0) / TAU - 121.5).abs() < 0.1);
        let ratio = frequency(3, 2.0) / frequency(2, 2.0);
        assert!((ratio * ratio - 30.0 / 8.0).abs() < 1e-12);
        // f ∝ D^−3/2.
        assert!((frequency(2, 1.0) / frequency(2, 4.0) - 8.0).abs() < 1e-12);
    }

    #[test]
    fn a_period_later_a_mode_is_back() {
        let mode = Mode { degree: 2, order: 0, azimuth: 0.0, amplitude: 0.1, phase: 0.3 };
        let shape = DropShape::new(1.5, vec![mode]);
        let period = TAU / frequency(2, 1.5);
        for n in [DVec3::Z, DVec3::X, DVec3::new(0.6, 0.0, -0.8)] {
            let [a, b, half] = [0.0, period, 0.5 * period].map(|time| shape.at(time).height(n).0);
            assert!((a - b).abs() < 1e-9 && (a - half).abs() > 1e-3);
        }
    }

    #[test]
    fn harmonics_have_their_norm_and_gradients_agree_with_differences() {
        /// Sums over 768 cells, by the midpoint rule down the sphere.
        const CELL_ERROR: f64 = 2e-3;
        for mode in modes(1.0) {
            let mut waves = Waves::default();
            waves.add(&mode, 1.0);
            let square = |(n, angle): (DVec3, f64)| waves.at(n).0 * waves.at(n).0 * angle;
            let mean = Surface::cells().map(square).sum::<f64>() / (4.0 * PI);
            let wanted = 1.0 / f64::from(2 * mode.degree + 1);
            assert!((mean - wanted).abs() < CELL_ERROR, "{mode:?}: {mean}");
        }
        let surface = DropShape::new(3.0, modes(0.05)).at(0.002);
        for p in [DVec3::new(0.3, -0.5, 0.9), DVec3::new(-1.0, 0.2, -0.4)] {
            let (_, gradient) = surface.above(p);
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let step = 1e-6;
                let [high, low] = [p + axis * step, p - axis * step].map(|p| surface.above(p).0);
                assert!((gradient.dot(axis) - (high - low) / (2.0 * step)).abs() < 1e-8);
            }
        }
    }
}
