//! Which of a rough surface's facets a sample shows: anchored to the world, so that nothing boils while the camera stands and nothing
//! swims while it moves.
//!
//! The surface is divided into cells about as wide as a pixel is there, of sides that are powers of two. A cell has a hash, its own place
//! in the unit square; a sample takes the facets of the part of the cell that it lies in. As a pixel grows with distance, cells pass to
//! the next power one by one, each at a share of the way that its own hash says, and not all at one distance.

use crate::random::mix;
use glam::{IVec2, Vec2, Vec3};

/// A sample's place among a cell's, and the cell's own in the unit square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grain {
    /// Which of the cell's parts the sample lies in.
    pub part: u32,
    /// The cell's place in the unit square.
    pub shift: Vec2,
}

fn hash(cell: IVec2, level: i32) -> u64 {
    mix(mix((cell.x as u32 as u64) << 32 | cell.y as u32 as u64) ^ (level as u32 as u64).rotate_left(48))
}

/// A surface point's coordinates along the two world axes that it faces least.
fn flat(point: Vec3, normal: Vec3) -> Vec2 {
    let facing = normal.abs();
    if facing.z >= facing.x && facing.z >= facing.y {
        Vec2::new(point.x, point.y)
    } else if facing.x >= facing.y {
        Vec2::new(point.y, point.z)
    } else {
        Vec2::new(point.x, point.z)
    }
}

/// The grain at a point of a surface where a pixel is `width` metres wide; cells have `parts` × `parts` parts.
pub fn grain(point: Vec3, normal: Vec3, width: f32, parts: u32) -> Grain {
    let at = flat(point, normal);
    let level = libm::log2f(width.clamp(1e-4, 1e4));
    let (fine, share) = (level.floor() as i32, level - level.floor());
    let cell = |level: i32| (at * libm::exp2f(-level as f32)).floor().as_ivec2();
    // The coarser cell decides for the finer ones in it.
    let coarse = cell(fine + 1);
    let turn = (hash(coarse, fine + 1) >> 8 & 0xFFFF) as f32 / 65_536.0;
    let level = if share > turn { fine + 1 } else { fine };
    let own = cell(level);
    let bits = hash(own, level);
    let shift = Vec2::new((bits >> 40) as f32, (bits >> 8 & 0xFF_FFFF) as f32) * (1.0 / 16_777_216.0);
    let within = at * libm::exp2f(-level as f32) - own.as_vec2();
    let part = (within * parts as f32).floor().clamp(Vec2::ZERO, Vec2::splat(parts as f32 - 1.0));
    Grain { part: part.y as u32 * parts + part.x as u32, shift }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_keeps_its_grain_while_a_pixel_there_hardly_changes() {
        let mut kept = 0;
        for i in 0..1000 {
            let point = Vec3::new(i as f32 * 0.37 - 100.0, i as f32 * 0.91, 0.0);
            let [a, b] = [0.0300, 0.0303].map(|width| grain(point, Vec3::Z, width, 2));
            kept += usize::from(a == b);
        }
        // A step of one per cent in width is a seventieth of the way to the next power.
        assert!(kept > 970, "{kept} of 1000");
    }

    #[test]
    fn parts_of_a_cell_are_all_met_and_cells_differ() {
        let mut seen = std::collections::HashSet::new();
        let mut shifts = std::collections::HashSet::new();
        for i in 0..64 {
            let point = Vec3::new((i % 8) as f32 * 0.5 + 0.25, (i / 8) as f32 * 0.5 + 0.25, 0.0);
            let grain = grain(point, Vec3::Z, 1.0, 2);
            seen.insert(grain.part);
            shifts.insert(grain.shift.x.to_bits());
        }
        assert_eq!(seen.len(), 4);
        assert!(shifts.len() > 8);
        // Walls have grain along both of their own directions.
        let wall = |x: f32, z: f32| grain(Vec3::new(x, 5.0, z), Vec3::Y, 1.0, 2);
        assert!(wall(0.2, 0.2) != wall(3.2, 0.2) && wall(0.2, 0.2) != wall(0.2, 3.2));
    }
}
