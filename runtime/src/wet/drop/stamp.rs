//! A drop in a picture, over the time that a shutter is open.
//!
//! A ball of radius 1 that moves by L covers a place at (x, y) from the middle of its way, y along it, while its middle is between y − h and y + h,
//! h = √(1 − x²): so coverage, and the mean of the normals that pass there, have closed forms. A still ball and a long streak are their ends.

use super::ball::Ball;
use super::eye::{Eye, Spot};
use super::light::glint;
use super::look::{Opacity, milky};
use crate::wet::frame::{GBuffer, Layer};
use crate::wet::material::{WATER_INDEX, fresnel};
use glam::{Vec2, Vec3};

/// A drop's way through a picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stamp {
    /// The middle of the way.
    pub spot: Spot,
    /// Unit direction of the way in the picture, to the right and up.
    pub along: Vec2,
    /// Half its width across the way, px.
    pub radius_px: f32,
    /// Half its length along the way over half its width.
    pub stretch: f32,
    /// Length of the way, px.
    pub way_px: f32,
}

/// What a drop is painted with.
pub(crate) struct Paint<'a> {
    pub ball: Ball<'a>,
    /// Light of beams, and where it comes from.
    pub beams: (Vec3, Vec2),
    pub opacity: Opacity,
    /// Opacity of the shape.
    pub alpha: f32,
    pub milk: f32,
    /// Levels that the velocity adds to the normals' blur.
    pub blur: f32,
}

/// Share of the time that a ball of radius 1 on a way of length `way`, both in the same unit, covers (x, y); and the first and last y of the normals
/// that pass there.
pub(crate) fn covered(x: f32, y: f32, way: f32) -> Option<(f32, [f32; 2])> {
    let chord = 1.0 - x * x;
    if chord <= 0.0 {
        return None;
    }
    let half = chord.sqrt();
    if way < 1e-3 {
        return (y.abs() < half).then_some((1.0, [y, y]));
    }
    // The ball's middle s passes from −way/2 to way/2; the normal there is y − s.
    let low = (y - half).max(-0.5 * way);
    let high = (y + half).min(0.5 * way);
    (high > low).then(|| ((high - low) / way, [y - high, y - low]))
}

/// Smallest half width that a drop is drawn with, px; a narrower one is as much fainter.
const LEAST_PX: f32 = 0.6;

impl Stamp {
    /// Lays the drop over a layer, before what the frame shows farther away; returns pixels touched.
    pub fn draw(&self, eye: &Eye, buffer: &GBuffer, paint: &Paint<'_>, out: &mut Layer) -> u64 {
        let radius = self.radius_px.max(LEAST_PX);
        let thin = self.radius_px / radius;
        let long = radius * self.stretch;
        let way = self.way_px / long;
        let across = Vec2::new(self.along.y, -self.along.x);
        let reach = Vec2::new(
            radius * across.x.abs() + (long + 0.5 * self.way_px) * self.along.x.abs(),
            radius * across.y.abs() + (long + 0.5 * self.way_px) * self.along.y.abs(),
        );
        let [_, columns] = eye.cover(&self.spot, reach.x + 0.5);
        let [rows, _] = eye.cover(&self.spot, reach.y + 0.5);
        let mut touched = 0;
        for row in rows {
            for column in columns.clone() {
                let pixel = row * eye.size[0] + column;
                if buffer.depth_m[pixel] < self.spot.depth {
                    continue;
                }
                let at = Vec2::new(column as f32 + 0.5 - self.spot.x, self.spot.y - row as f32 - 0.5);
                let (x, y) = (at.dot(across) / radius, at.dot(self.along) / long);
                // Edges are a pixel wide: the shape is asked a quarter of one inside.
                let inside = 1.0 - 0.25 / radius;
                let Some((share, normals)) = covered(x * inside, y * inside, way) else { continue };
                let edge = ((1.0 - x.abs()) * radius + 0.5).clamp(0.0, 1.0);
                let (colour, reflected) = self.colour([x * inside, across.x, across.y], normals, paint);
                let shape = share * edge * thin * thin.max(0.3);
                let alpha = paint.opacity.of(paint.alpha * shape, reflected);
                if alpha > 0.0 {
                    out.over(pixel, (colour * alpha).into(), alpha);
                    touched += 1;
                }
            }
        }
        touched
    }

    /// Mean colour of the normals that pass, by Gauss's two points along the way, and the share of light reflected there.
    fn colour(&self, [x, ax, ay]: [f32; 3], normals: [f32; 2], paint: &Paint<'_>) -> (Vec3, f32) {
        let middle = 0.5 * (normals[0] + normals[1]);
        let half = 0.5 * (normals[1] - normals[0]);
        let ends = [middle - 0.577_35 * half, middle + 0.577_35 * half];
        let (mut colour, mut reflected) = (Vec3::ZERO, 0.0);
        for y in ends {
            let flat = (Vec2::new(ax, ay) * x + self.along * y).clamp_length_max(0.999);
            let cosine = (1.0 - flat.length_squared()).sqrt();
            reflected += 0.5 * fresnel(f64::from(cosine), WATER_INDEX) as f32;
            let beams = paint.beams.0 * glint(flat, paint.beams.1);
            colour += 0.5 * (paint.ball.radiance(flat, paint.blur + 1.5 * half) + beams);
        }
        (milky(colour * paint.opacity.lightning_bias, paint.milk), reflected)
    }
}

/// Height over width of a drop that falls at its own speed, 1.03 − .062 D with D in mm (\[pruppacher-beard\]), at most 1.
pub fn flatness(diameter_m: f64) -> f32 {
    (1.03 - 62.0 * diameter_m).clamp(0.4, 1.0) as f32
}

/// How fast a drop swings between long and flat, rad/s: the lowest note of a free ball of water, √(8σ/(ρR³)), Rayleigh 1879. `diameter_m` is 2R, m; below a hundredth of
/// a millimetre it counts as that.
pub fn swing_rate(diameter_m: f64) -> f64 {
    /// Surface tension of water at 20 °C, N/m, and its density, kg/m³.
    const TENSION: f64 = 0.0728;
    const DENSITY: f64 = 1000.0;
    let radius = 0.5 * diameter_m.max(1e-5);
    (8.0 * TENSION / (DENSITY * radius * radius * radius)).sqrt()
}

/// Levels of blur for a way of so many widths: one for each doubling, as a picture's levels have.
pub(crate) fn velocity_blur(way_px: f32, radius_px: f32) -> f32 {
    0.5 * libm::log2f(1.0 + way_px / (2.0 * radius_px).max(0.1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moving_ball_covers_its_disc_whatever_the_way() {
        /// A rule of midpoints over the disc's edge.
        const RULE: f32 = 5e-3;
        for way in [0.0f32, 0.5, 3.0, 20.0] {
            let cells = 400;
            let (high, step) = (1.0 + 0.5 * way, 2.0 / cells as f32);
            let lines = (2.0 * high / step) as usize;
            let mut sum = 0.0f64;
            for row in 0..lines {
                for column in 0..cells {
                    let (x, y) = ((column as f32 + 0.5) * step - 1.0, (row as f32 + 0.5) * step - high);
                    sum += covered(x, y, way).map_or(0.0, |(share, _)| f64::from(share * step * step));
                }
            }
            assert!((sum as f32 / std::f32::consts::PI - 1.0).abs() < RULE, "{way} {sum}");
        }
    }

    #[test]
    fn normals_that_pass_are_those_of_the_ball() {
        let (_, [first, last]) = covered(0.6, 0.0, 10.0).unwrap();
        assert!((first + 0.8).abs() < 1e-6 && (last - 0.8).abs() < 1e-6, "all of the chord passes");
        assert_eq!(covered(0.3, 0.4, 0.0), Some((1.0, [0.4, 0.4])));
        assert_eq!(covered(1.0, 0.0, 5.0), None);
    }

    #[test]
    fn drops_swing_at_rayleighs_note() {
        // √(8 · .0728/(1000 · (2.5·10⁻³)³)) = 193.07 rad/s, 30.7 Hz.
        assert!((swing_rate(5e-3) - 193.066).abs() < 1e-2, "{}", swing_rate(5e-3));
        assert!((swing_rate(2e-3) / swing_rate(8e-3) - 8.0).abs() < 1e-12);
        assert!(swing_rate(0.0).is_finite());
    }

    #[test]
    fn raindrops_are_flatter_the_larger_they_are() {
        assert_eq!(flatness(0.3e-3), 1.0);
        assert!((flatness(4e-3) - 0.782).abs() < 1e-5);
        assert!(flatness(5e-3) < flatness(2e-3));
    }
}
