//! Walls with windows: which are lit, in which colour, averaged over what a pixel covers.

use crate::random::mix;
use glam::Vec2;
use squall_formats::section::town::Windows;

/// What a spot of wall shows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wall {
    /// Radiance of lit windows, W/(m² sr).
    pub emission: [f32; 3],
    /// Share of the spot that is glass, lit or not, in [0, 1].
    pub glass: f32,
}

/// Light of one window, as a factor on the mean radiance of a lit one; 0 when it is dark. Whole storeys of an
/// office are lit together more often than chance would have it.
fn lamp(windows: &Windows, wall: u32, column: i32, storey: i32) -> [f32; 3] {
    let seed = u64::from(windows.seed) << 34 ^ u64::from(wall) << 32;
    let draw = |bits: u64, shift: u32| ((bits >> shift) & 0xFFFF) as f32 / 65_536.0;
    let floor = mix(seed ^ 0xF100_0000_0000_0000 ^ u64::from(storey as u32));
    let own = mix(seed.rotate_left(17) ^ u64::from(column as u32) << 20 ^ u64::from(storey as u32));
    // Storeys differ around the wanted share with mean 1: 4 in 10 nearly dark, 1 in 10 nearly all lit.
    let crowd = match draw(floor, 0) {
        d if d < 0.4 => 0.35,
        d if d < 0.9 => 1.2,
        _ => 2.6,
    };
    if draw(own, 0) >= windows.lit * crowd {
        return [0.0; 3];
    }
    // Brightness spreads around 1; colour from incandescent to cold tubes around the given one.
    let bright = 0.35 + 1.3 * draw(own, 16);
    let cold = draw(own, 32) * draw(own, 32);
    [1.06 - 0.3 * cold, 0.98 + 0.05 * cold, 0.8 + 0.95 * cold].map(|factor| factor * bright)
}

/// Mean of [`lamp`]'s colour factors over all lit windows.
const MEAN_COLOUR: [f32; 3] = [0.96, 0.997, 1.117];
/// A pixel that covers more windows than this along one axis sees their mean.
const MOST: f32 = 6.0;

/// Overlap of [low, high] with the pane of cell `i`, a centred share `pane` of the cell; in cells.
fn overlap(low: f32, high: f32, i: i32, pane: f32) -> f32 {
    let (start, end) = (i as f32 + 0.5 - 0.5 * pane, i as f32 + 0.5 + 0.5 * pane);
    (high.min(end) - low.max(start)).max(0.0)
}

impl Wall {
    /// The wall at `at` (m along it and above its foot), averaged over a square `footprint` m wide.
    ///
    /// `wall` is the side of the box, `size` the wall's length and height: windows keep off its edges.
    pub fn sample(windows: &Windows, wall: u32, at: Vec2, size: Vec2, footprint: f32) -> Self {
        let pitch = Vec2::from_array(windows.pitch);
        // Whole windows only, centred on the wall.
        let counts = (size / pitch).floor();
        let margin = (size - counts * pitch) * 0.5;
        let place = (at - margin) / pitch;
        let half = (0.5 * footprint.max(1e-3)) / pitch;
        let (low, high) = ((place - half).max(Vec2::ZERO), (place + half).min(counts));
        if low.x >= high.x || low.y >= high.y {
            return Self::default();
        }
        let pane = windows.glass.sqrt();
        let area = 4.0 * half.x * half.y;
        if (high - low).max_element() > MOST {
            let covered = (high.x - low.x) * (high.y - low.y) / area;
            let lit = windows.lit * covered * windows.glass;
            return Self {
                emission: std::array::from_fn(|band| lit * windows.radiance[band] * MEAN_COLOUR[band]),
                glass: covered * windows.glass,
            };
        }
        let mut seen = Self::default();
        for storey in low.y.floor() as i32..high.y.ceil() as i32 {
            let tall = overlap(low.y, high.y, storey, pane);
            for column in low.x.floor() as i32..high.x.ceil() as i32 {
                let share = tall * overlap(low.x, high.x, column, pane) / area;
                if share > 0.0 {
                    let lamp = lamp(windows, wall, column, storey);
                    seen.glass += share;
                    for band in 0..3 {
                        seen.emission[band] += share * lamp[band] * windows.radiance[band];
                    }
                }
            }
        }
        seen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn windows(lit: f32) -> Windows {
        Windows { pitch: [3.0, 3.5], glass: 0.49, lit, radiance: [0.4, 0.3, 0.2], seed: 5 }
    }

    const SIZE: Vec2 = Vec2::new(301.0, 354.0);

    #[test]
    fn a_wide_footprint_sees_what_many_narrow_ones_see_on_average() {
        /// Some 10 000 windows of relative deviation near 2, and storeys lit together.
        const SAMPLING: f32 = 0.08;
        let windows = windows(0.3);
        let wide = Wall::sample(&windows, 1, SIZE * 0.5, SIZE, 200.0);
        let mut sum = Wall::default();
        let count = 150 * 150;
        for i in 0..count {
            let at = Vec2::new(52.0 + (i % 150) as f32 * 1.3, 80.0 + (i / 150) as f32 * 1.3);
            let seen = Wall::sample(&windows, 1, at, SIZE, 1.3);
            sum.glass += seen.glass / count as f32;
            for band in 0..3 {
                sum.emission[band] += seen.emission[band] / count as f32;
            }
        }
        assert!((sum.glass / wide.glass - 1.0).abs() < 0.01, "{} {}", sum.glass, wide.glass);
        for band in 0..3 {
            assert!((sum.emission[band] / wide.emission[band] - 1.0).abs() < SAMPLING, "{sum:?} {wide:?}");
        }
    }

    #[test]
    fn dark_houses_are_dark_and_edges_have_no_windows() {
        let dark = Wall::sample(&windows(0.0), 0, SIZE * 0.5, SIZE, 1.0);
        assert_eq!(dark.emission, [0.0; 3]);
        let edge = Wall::sample(&windows(1.0), 0, Vec2::new(0.1, 0.1), SIZE, 0.05);
        assert_eq!(edge, Wall::default());
        let small = Wall::sample(&windows(1.0), 0, Vec2::new(1.0, 1.0), Vec2::new(2.0, 2.0), 0.5);
        assert_eq!(small, Wall::default());
    }
}
