//! A picture and copies of it, each half as large: means over squares.

use crate::parallel::prelude::*;
use glam::{Vec2, Vec3};

/// Copies at most.
const LEVELS: usize = 8;

/// A picture and its coarser copies. Its memory is kept.
#[derive(Clone, Debug, Default)]
pub struct Pyramid {
    levels: Vec<Level>,
}

#[derive(Clone, Debug, Default)]
struct Level {
    size: [usize; 2],
    pixels: Vec<[f32; 3]>,
}

impl Level {
    /// Between four pixels' middles; beyond the outer ones the nearest.
    #[inline]
    fn between(&self, at: Vec2) -> Vec3 {
        let [width, height] = self.size;
        let x = (at.x - 0.5).clamp(0.0, (width - 1) as f32);
        let y = (at.y - 0.5).clamp(0.0, (height - 1) as f32);
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let (u, v) = (x - left as f32, y - top as f32);
        let pixel = |x: usize, y: usize| Vec3::from_array(self.pixels[y * width + x]);
        let above = pixel(left, top).lerp(pixel(right, top), u);
        above.lerp(pixel(left, bottom).lerp(pixel(right, bottom), u), v)
    }
}

impl Pyramid {
    /// Takes a picture of this size.
    pub fn fill(&mut self, size: [usize; 2], picture: &[[f32; 3]]) {
        self.levels.resize_with(LEVELS + 1, Level::default);
        let first = &mut self.levels[0];
        first.size = size;
        first.pixels.clear();
        first.pixels.extend_from_slice(picture);
        for number in 1..=LEVELS {
            let (fine, coarse) = self.levels.split_at_mut(number);
            halve(&fine[number - 1], &mut coarse[0]);
        }
    }

    /// Mean light around a pixel over squares of 2^`level` px.
    #[inline]
    pub fn at(&self, at: Vec2, level: f32) -> Vec3 {
        let level = level.clamp(0.0, LEVELS as f32);
        let low = (level as usize).min(LEVELS - 1);
        let share = level - low as f32;
        let look = |number: usize| {
            let level = &self.levels[number];
            // Sizes are rounded up: pixels stay where they were.
            level.between(at / (1u32 << number) as f32)
        };
        if share < 1e-3 { look(low) } else { look(low).lerp(look(low + 1), share) }
    }
}

/// Means of two by two pixels; at odd borders of what there is.
fn halve(fine: &Level, coarse: &mut Level) {
    let [width, height] = fine.size;
    coarse.size = [width.div_ceil(2), height.div_ceil(2)];
    coarse.pixels.resize(coarse.size[0] * coarse.size[1], [0.0; 3]);
    let row = |(y, out): (usize, &mut [[f32; 3]])| {
        let rows = [2 * y, (2 * y + 1).min(height - 1)].map(|y| &fine.pixels[y * width..][..width]);
        for (x, out) in out.iter_mut().enumerate() {
            let (left, right) = (2 * x, (2 * x + 1).min(width - 1));
            for (band, out) in out.iter_mut().enumerate() {
                *out = 0.25
                    * (rows[0][left][band]
                        + rows[0][right][band]
                        + rows[1][left][band]
                        + rows[1][right][band]);
            }
        }
    };
    coarse.pixels.par_chunks_mut(coarse.size[0]).enumerate().for_each(row);
}
