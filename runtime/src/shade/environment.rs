//! A small picture of everything beyond the town, by direction: what reflections look into.
//!
//! Marching a cloud for every mirrored ray would cost more than the picture itself; a few ten thousand rays into a
//! window of azimuth and elevation, read back bilinearly, cost little and blur nothing that ripples leave sharp.

#[cfg(all(test, feature = "gpu"))]
mod upload;

use super::adaptive::{self, Spacing};
use glam::Vec3;
use squall_formats::units::Radians;

/// Which directions the picture holds, and how finely.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnvironmentWindow {
    /// Middle, from +x towards +y.
    pub heading: Radians,
    /// Half the width in azimuth, in (0, π].
    pub half_width: Radians,
    /// Lowest elevation, in [−π/2, π/2).
    pub bottom: Radians,
    /// Highest elevation, in (bottom, π/2].
    pub top: Radians,
    /// Columns and rows, at least 2 each.
    pub size: [usize; 2],
}

/// The picture. Directions outside its window read its nearest edge.
pub struct Environment {
    window: EnvironmentWindow,
    pixels: Vec<[f32; 3]>,
}

impl Environment {
    /// Fills the picture with `radiance` of unit directions, row by row.
    pub fn new(window: EnvironmentWindow, radiance: &(dyn Fn(Vec3) -> [f32; 3] + Sync)) -> Self {
        Self::looked_at(window, Spacing { pixels: 1, tolerance: 0.0 }, radiance)
    }

    /// The same where directions are interpolated as `spacing` allows.
    pub fn looked_at(
        window: EnvironmentWindow,
        spacing: Spacing,
        radiance: &(dyn Fn(Vec3) -> [f32; 3] + Sync),
    ) -> Self {
        let window = EnvironmentWindow { size: window.size.map(|count| count.max(2)), ..window };
        let ([columns, rows], bottom) = (window.size, window.bottom.0);
        let mut pixels = vec![[0.0; 3]; columns * rows];
        let at = |x: usize, y: usize| {
            let (rise, level) = libm::sincos(bottom + (window.top.0 - bottom) * y as f64 / (rows - 1) as f64);
            let across = 2.0 * x as f64 / (columns - 1) as f64 - 1.0;
            let (sin, cos) = libm::sincos(window.heading.0 + across * window.half_width.0);
            radiance(Vec3::new((level * cos) as f32, (level * sin) as f32, rise as f32))
        };
        adaptive::fill(window.size, spacing, (&at, &|_, _| true), &mut pixels);
        Self { window, pixels }
    }

    /// Whether unit `direction` is inside the window.
    pub fn holds(&self, direction: Vec3) -> bool {
        let [across, up] = self.place(direction);
        (0.0..=1.0).contains(&across) && (0.0..=1.0).contains(&up)
    }

    /// Place in the window, in [0, 1] where it is inside.
    fn place(&self, direction: Vec3) -> [f64; 2] {
        let azimuth = libm::atan2f(direction.y, direction.x);
        let off = f64::from(azimuth) - self.window.heading.0;
        let off = off - std::f64::consts::TAU * libm::rint(off / std::f64::consts::TAU);
        let elevation = f64::from(libm::asinf(direction.z.clamp(-1.0, 1.0)));
        let bottom = self.window.bottom.0;
        [0.5 + 0.5 * off / self.window.half_width.0, (elevation - bottom) / (self.window.top.0 - bottom)]
    }

    /// Radiance from unit `direction`, bilinear.
    pub fn lookup(&self, direction: Vec3) -> [f32; 3] {
        let [columns, rows] = self.window.size;
        let [across, up] = self.place(direction);
        let across = across.clamp(0.0, 1.0) * (columns - 1) as f64;
        let up = up.clamp(0.0, 1.0) * (rows - 1) as f64;
        let (x, y) = ((across as usize).min(columns - 2), (up as usize).min(rows - 2));
        let (u, v) = ((across - x as f64) as f32, (up - y as f64) as f32);
        let at = |x: usize, y: usize| self.pixels[x + columns * y];
        let (a, b, c, d) = (at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1));
        std::array::from_fn(|band| {
            let low = a[band] + u * (b[band] - a[band]);
            let high = c[band] + u * (d[band] - c[band]);
            low + v * (high - low)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smooth_sky_reads_back_and_outside_reads_the_edge() {
        /// Bilinear interpolation of a linear function of z on 64 rows, second order in the step.
        const INTERPOLATION: f32 = 1e-3;
        let window = EnvironmentWindow {
            heading: Radians(3.0),
            half_width: Radians(1.0),
            bottom: Radians(0.0),
            top: Radians(0.8),
            size: [64, 64],
        };
        let environment = Environment::new(window, &|d| [d.z, d.x, 1.0]);
        for (azimuth, elevation) in [(2.2f32, 0.1f32), (3.0, 0.5), (-2.6, 0.7)] {
            let (sa, ca) = libm::sincosf(azimuth);
            let (se, ce) = libm::sincosf(elevation);
            let read = environment.lookup(Vec3::new(ce * ca, ce * sa, se));
            assert!((read[0] - se).abs() < INTERPOLATION && (read[1] - ce * ca).abs() < INTERPOLATION);
            assert_eq!(read[2], 1.0);
        }
        assert!(environment.holds(Vec3::new(-1.0, 0.1, 0.2).normalize()) && !environment.holds(Vec3::X));
        let edge = environment.lookup(Vec3::Z)[0];
        assert!((edge - libm::sinf(0.8)).abs() < INTERPOLATION, "{edge}");
    }
}
