//! What is baked from a scene's meshes, for effects that must know more than a camera sees.

use glam::{DVec2, DVec3, Vec3};
use squall_formats::sphere::{degree_of, harmonics};

/// Values over the ground: cells of one size, x first; a value belongs to its cell's middle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GroundMap {
    /// Corner with the smallest x and y, m.
    pub origin_m: DVec2,
    /// Side of a cell, m, above 0.
    pub cell_m: f64,
    /// Cells along x and y.
    pub size: [usize; 2],
    /// `size[0] * size[1]` values; NaN where there is nothing.
    pub values: Vec<f32>,
}

impl GroundMap {
    /// The cell that a place lies in, or `None` outside.
    pub fn cell(&self, place: DVec2) -> Option<[usize; 2]> {
        let at = (place - self.origin_m) / self.cell_m;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.size[0] as f64 && at.y < self.size[1] as f64;
        inside.then_some([at.x as usize, at.y as usize])
    }

    /// Value of the cell that a place lies in.
    pub fn at(&self, place: DVec2) -> Option<f32> {
        let [x, y] = self.cell(place)?;
        self.values.get(y * self.size[0] + x).copied()
    }

    /// Value between cells' middles, bilinear; beyond the outer middles the nearest. `None` outside the map.
    pub fn between(&self, place: DVec2) -> Option<f32> {
        self.cell(place)?;
        let at = (place - self.origin_m) / self.cell_m - 0.5;
        let axis = |at: f64, cells: usize| {
            let low = at.clamp(0.0, (cells - 1) as f64);
            let first = (low as usize).min(cells.saturating_sub(2));
            (first, (first + 1).min(cells - 1), (low - first as f64) as f32)
        };
        let (x0, x1, u) = axis(at.x, self.size[0]);
        let (y0, y1, v) = axis(at.y, self.size[1]);
        let value = |x: usize, y: usize| self.values[y * self.size[0] + x];
        let low = value(x0, y0) + u * (value(x1, y0) - value(x0, y0));
        let high = value(x0, y1) + u * (value(x1, y1) - value(x0, y1));
        Some(low + v * (high - low))
    }
}

/// An edge from which water drips: a ledge, a gutter, an awning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DripEdge {
    /// Its ends, m.
    pub ends_m: [DVec3; 2],
    /// Area of roof or ledge that drains over it, m²: drops a second are R times that over a drop's volume.
    pub drains_m2: f32,
}

/// A silhouette on which drops burst into mist, and which way is outwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fin {
    /// Its ends, m.
    pub ends_m: [DVec3; 2],
    /// Unit normals of the two faces that meet in it.
    pub normals: [DVec3; 2],
}

/// Irradiance of lightning from key directions: a volume of spherical harmonics.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightningVolume {
    /// Corner with the smallest coordinates, m.
    pub origin_m: DVec3,
    /// Side of a cell, m, above 0.
    pub cell_m: f64,
    /// Nodes along x, y and z.
    pub size: [usize; 3],
    /// Unit vectors towards the light, one a key direction.
    pub directions: Vec<DVec3>,
    /// Of each key direction, of each node (x first): nine real orthonormal harmonics, l² + l + m, of the radiance that arrives, for a beam of
    /// irradiance 1; direct light left out. The three colours' mean.
    pub harmonics: Vec<[f32; 9]>,
}

impl LightningVolume {
    /// Harmonics at a place, between the eight nodes around it; beyond the outer nodes theirs. `None` for a key direction that there is
    /// none of, or a place that is no number.
    pub fn harmonics_at(&self, direction: usize, place: DVec3) -> Option<[f32; 9]> {
        let count: usize = self.size.iter().product();
        let nodes = self.harmonics.get(direction * count..(direction + 1) * count)?;
        let at = (place - self.origin_m) / self.cell_m;
        if count == 0 || !at.is_finite() {
            return None;
        }
        let mut first = [0usize; 3];
        let mut share = [0.0f32; 3];
        for axis in 0..3 {
            let last = self.size[axis] - 1;
            let along = at[axis].clamp(0.0, last as f64);
            first[axis] = (along as usize).min(last.saturating_sub(1));
            share[axis] = (along - first[axis] as f64) as f32;
        }
        let mut sum = [0.0f32; 9];
        for corner in 0..8usize {
            let mut weight = 1.0;
            let mut node = 0;
            for axis in (0..3).rev() {
                let far = corner >> axis & 1;
                weight *= if far == 1 { share[axis] } else { 1.0 - share[axis] };
                node = node * self.size[axis] + (first[axis] + far).min(self.size[axis] - 1);
            }
            if weight > 0.0 {
                for (sum, light) in sum.iter_mut().zip(&nodes[node]) {
                    *sum += weight * light;
                }
            }
        }
        Some(sum)
    }

    /// Irradiance of a surface with unit normal `normal` by reflected light \[ramamoorthi\], W/m² for a beam of 1 W/m² from that key
    /// direction; at least 0. `None` as [`LightningVolume::harmonics_at`].
    pub fn irradiance(&self, direction: usize, place: DVec3, normal: Vec3) -> Option<f32> {
        use std::f32::consts::PI;
        let light = self.harmonics_at(direction, place)?;
        let basis = harmonics(normal.to_array().map(f64::from));
        // What a cosine lobe keeps of each degree.
        let kept = |index: usize| [PI, 2.0 * PI / 3.0, 0.25 * PI][degree_of(index)];
        let terms = light.iter().zip(basis).enumerate();
        Some(terms.map(|(index, (light, basis))| kept(index) * light * basis as f32).sum::<f32>().max(0.0))
    }
}

/// What was baked from meshes; all of it may be absent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WetMaps {
    /// Height of the highest point in each cell, m: what rain hits first, never below what stands there.
    pub height_m: Option<GroundMap>,
    /// Depth of standing water when puddles are full, m.
    pub water_m: Option<GroundMap>,
    /// Light that falls on an upward surface from lamps overhead, red, green and blue, W/m².
    pub overhead: Option<[GroundMap; 3]>,
    /// Where water drips from.
    pub drips: Vec<DripEdge>,
    /// Silhouettes.
    pub fins: Vec<Fin>,
    /// Light of lightning by global illumination.
    pub lightning: Option<LightningVolume>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Single precision.
    const ROUND_OFF: f32 = 1e-6;

    #[test]
    fn a_plane_is_found_again_between_the_middles_of_cells() {
        let mut map =
            GroundMap { origin_m: DVec2::new(-2.0, 1.0), cell_m: 0.5, size: [4, 3], values: Vec::new() };
        let plane = |x: f64, y: f64| (3.0 + 2.0 * x - y) as f32;
        for y in 0..3 {
            for x in 0..4 {
                map.values.push(plane(-1.75 + 0.5 * x as f64, 1.25 + 0.5 * y as f64));
            }
        }
        assert!((map.between(DVec2::new(-1.1, 1.9)).unwrap() - plane(-1.1, 1.9)).abs() < ROUND_OFF);
        assert_eq!(map.at(DVec2::new(-1.9, 1.1)), Some(map.values[0]));
        assert_eq!(map.between(DVec2::new(0.1, 1.1)), None);
        assert_eq!(map.at(DVec2::new(f64::NAN, 1.1)), None);
    }
}
