//! Windows: what ends a pattern's cosines at the outline of the streak.

use super::kind::Kind;
use super::packing::{Cursor, LogLattice, invalid, nearest};
use crate::error::ReadError;

/// Steps of a position, 0 to 1.
const POSITION_STEPS: f64 = 65_535.0;
/// Steps of a radius, 0 to 4.
const RADIUS_STEPS: f64 = 16_384.0;
/// Exponents 0.5 to 126, 2 % apart; 2 itself is not among them, so a Gaussian stays told apart by its kind.
const EXPONENT: LogLattice = LogLattice { steps: 32.0, first: -0.984375 };
/// Softness 2.4e-4 to 15, 4 % apart.
const SOFTNESS: LogLattice = LogLattice { steps: 16.0, first: -12.0 };
/// Steps of a side's bend, −1/8 to 1/8.
const BEND_STEPS: f64 = 1024.0;
/// Steps of an end's tilt and curvature, −1/4 to 1/4.
const CAP_STEPS: f64 = 512.0;

/// What a pattern's cosines are multiplied by.
#[derive(Clone, Debug, PartialEq)]
pub enum Window {
    /// 1 everywhere in the picture.
    Flat,
    /// Gaussian or super-Gaussian.
    Power(PowerWindow),
    /// Four soft edges.
    Edges(EdgeWindow),
}

impl Window {
    /// Weight at (u, v), in [0, 1].
    pub fn value(&self, u: f64, v: f64) -> f64 {
        let inside = (0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v);
        match self {
            Self::Flat => f64::from(u8::from(inside)),
            Self::Power(_) if !inside => 0.0,
            Self::Power(window) => window.value(u, v),
            Self::Edges(window) => window.value(u, v),
        }
    }

    /// Bytes after the name, before the constant: the window's own numbers.
    pub(super) fn read(kind: Kind, pool: &mut Cursor) -> Result<Self, ReadError> {
        match kind {
            Kind::FlatCosines | Kind::Separable => Ok(Self::Flat),
            Kind::GaussianCosines => PowerWindow::read(false, pool).map(Self::Power),
            Kind::PowerCosines => PowerWindow::read(true, pool).map(Self::Power),
            Kind::EdgeCosines => EdgeWindow::read(pool).map(Self::Edges),
        }
    }

    pub(super) fn write(&self, pool: &mut Vec<u8>) {
        match self {
            Self::Flat => {}
            Self::Power(window) => window.write(pool),
            Self::Edges(window) => window.write(pool),
        }
    }
}

/// exp(−|(u − c)/r|^p) across times the same along, cut at the picture's border. p = 2 is a Gaussian with
/// standard deviation r/√2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PowerWindow {
    /// Centre in u and v, 0 to 1.
    pub centre: [f64; 2],
    /// Where the weight is 1/e, in u and v, above 0 up to 4.
    pub radius: [f64; 2],
    /// Exponents in u and v, 0.5 to 125.
    pub exponent: [f64; 2],
}

impl PowerWindow {
    /// Weight at (u, v).
    pub fn value(&self, u: f64, v: f64) -> f64 {
        self.profile(0, u) * self.profile(1, v)
    }

    /// Weight of axis 0 (across) or 1 (along) at `x`.
    pub fn profile(&self, axis: usize, x: f64) -> f64 {
        let distance = ((x - self.centre[axis]) / self.radius[axis]).abs();
        libm::exp(-libm::pow(distance, self.exponent[axis]))
    }

    fn read(free_exponent: bool, pool: &mut Cursor) -> Result<Self, ReadError> {
        let mut position = || pool.u16().map(|step| f64::from(step) / POSITION_STEPS);
        let centre = [position()?, position()?];
        let mut radius = [0.0; 2];
        for value in &mut radius {
            let step = pool.u16()?;
            if step == 0 {
                return Err(invalid("window radius", "above 0", step));
            }
            *value = f64::from(step) / RADIUS_STEPS;
        }
        let mut exponent = [2.0; 2];
        if free_exponent {
            exponent = [EXPONENT.value(pool.u8()?), EXPONENT.value(pool.u8()?)];
        }
        Ok(Self { centre, radius, exponent })
    }

    fn write(&self, pool: &mut Vec<u8>) {
        for centre in self.centre {
            pool.extend((nearest(centre * POSITION_STEPS, 0, 65_535) as u16).to_le_bytes());
        }
        for radius in self.radius {
            pool.extend((nearest(radius * RADIUS_STEPS, 1, 65_535) as u16).to_le_bytes());
        }
        if self.exponent != [2.0; 2] {
            pool.extend(self.exponent.map(|exponent| EXPONENT.code(exponent)));
        }
    }
}

/// Four soft edges: a left and a right side that sway along the fall, a top and a bottom end that tilt and
/// curve across it, as the path of an oscillating drop does.
///
/// W = ½[E((u − l(v))/s₀) − E((u − r(v))/s₁)] · ½[E((v − t(x))/s₂) − E((v − b(x))/s₃)], E the error function;
/// y = 2v − 1 and x = (2u − l₀ − r₀)/(r₀ − l₀), both held to [−1, 1]. Every factor is a difference of
/// blurred steps, whose integral over a pixel is known in closed form at any width.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeWindow {
    /// l(y) and r(y) as coefficients of the Chebyshev polynomials T₀…T₃: the first 0 to 1, l₀ < r₀, the
    /// others −1/8 to 1/8.
    pub sides: [[f64; 4]; 2],
    /// t(x) and b(x) as coefficients of 1, x, x²: the first 0 to 1, t₀ < b₀, the others −1/4 to 1/4.
    pub ends: [[f64; 3]; 2],
    /// s of the left, right, top and bottom edge: √2 standard deviations of the blur, in u and v.
    pub softness: [f64; 4],
}

impl EdgeWindow {
    /// Weight at (u, v); the window fades by itself and is not cut at the picture's border.
    pub fn value(&self, u: f64, v: f64) -> f64 {
        let [left, right] = self.sides_at(v);
        let [top, bottom] = self.ends_at(u);
        let [soft_left, soft_right, soft_top, soft_bottom] = self.softness;
        let across = libm::erf((u - left) / soft_left) - libm::erf((u - right) / soft_right);
        let along = libm::erf((v - top) / soft_top) - libm::erf((v - bottom) / soft_bottom);
        0.25 * across * along
    }

    /// Where the left and right side stand at `v`.
    pub fn sides_at(&self, v: f64) -> [f64; 2] {
        let y = (2.0 * v - 1.0).clamp(-1.0, 1.0);
        let (t2, t3) = (2.0 * y * y - 1.0, y * (4.0 * y * y - 3.0));
        self.sides.map(|c| c[0] + c[1] * y + c[2] * t2 + c[3] * t3)
    }

    /// Where the top and bottom end stand at `u`.
    pub fn ends_at(&self, u: f64) -> [f64; 2] {
        let (left, right) = (self.sides[0][0], self.sides[1][0]);
        let x = ((2.0 * u - left - right) / (right - left)).clamp(-1.0, 1.0);
        self.ends.map(|c| c[0] + x * (c[1] + c[2] * x))
    }

    fn read(pool: &mut Cursor) -> Result<Self, ReadError> {
        let mut position = || pool.u16().map(|step| f64::from(step) / POSITION_STEPS);
        let first = [position()?, position()?, position()?, position()?];
        let [left, right, top, bottom] = first;
        if !(left < right && top < bottom) {
            return Err(invalid("window edges", "left < right and top < bottom", format!("{first:?}")));
        }
        let mut sides = [[left, 0.0, 0.0, 0.0], [right, 0.0, 0.0, 0.0]];
        for bend in sides.iter_mut().flat_map(|side| &mut side[1..]) {
            *bend = f64::from(pool.i8()?) / BEND_STEPS;
        }
        let mut ends = [[top, 0.0, 0.0], [bottom, 0.0, 0.0]];
        for bend in ends.iter_mut().flat_map(|end| &mut end[1..]) {
            *bend = f64::from(pool.i8()?) / CAP_STEPS;
        }
        let softness = pool.array::<4>()?.map(|code| SOFTNESS.value(code));
        Ok(Self { sides, ends, softness })
    }

    fn write(&self, pool: &mut Vec<u8>) {
        let pair = |low: f64, high: f64| {
            let low = nearest(low * POSITION_STEPS, 0, 65_534) as u16;
            (low, (nearest(high * POSITION_STEPS, 1, 65_535) as u16).max(low + 1))
        };
        let (left, right) = pair(self.sides[0][0], self.sides[1][0]);
        let (top, bottom) = pair(self.ends[0][0], self.ends[1][0]);
        for position in [left, right, top, bottom] {
            pool.extend(position.to_le_bytes());
        }
        let bend = |value: f64, steps: f64| (nearest(value * steps, -128, 127) as i8).to_le_bytes();
        for side in &self.sides {
            pool.extend(side[1..].iter().flat_map(|&value| bend(value, BEND_STEPS)));
        }
        for end in &self.ends {
            pool.extend(end[1..].iter().flat_map(|&value| bend(value, CAP_STEPS)));
        }
        pool.extend(self.softness.map(|softness| SOFTNESS.code(softness)));
    }
}
