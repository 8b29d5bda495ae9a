//! Values between cell centres, trilinear.

use crate::transport::{Boundary, Cloud};
use glam::{DVec3, Vec3, Vec4};
use squall_formats::GridShape;

/// Reads cell values between centres, trilinear; beyond the outer centres the nearest counts, or the other side's where the
/// grid repeats.
pub fn between(cloud: &Cloud, values: &[f32], point: DVec3) -> f32 {
    corners(cloud, point).iter().map(|&(cell, weight)| weight * values[cell]).sum()
}

/// The eight cells whose centres surround `point`, and their weights, which sum to 1.
pub fn corners(cloud: &Cloud, point: DVec3) -> [(usize, f32); 8] {
    let counts = cloud.shape.to_array();
    let (mut low, mut high, mut share) = ([0usize; 3], [0usize; 3], [0.0f32; 3]);
    for axis in 0..3 {
        let at = (point[axis] - cloud.origin_m[axis]) / cloud.cell_m[axis] - 0.5;
        if axis < 2 && cloud.boundary == Boundary::PeriodicXy {
            let floor = at.floor();
            low[axis] = (floor as i64).rem_euclid(counts[axis] as i64) as usize;
            high[axis] = (low[axis] + 1) % counts[axis];
            share[axis] = (at - floor) as f32;
            continue;
        }
        let at = at.clamp(0.0, counts[axis] as f64 - 1.0);
        low[axis] = (at as usize).min(counts[axis].saturating_sub(2));
        high[axis] = (low[axis] + 1).min(counts[axis] - 1);
        share[axis] = (at - low[axis] as f64) as f32;
    }
    std::array::from_fn(|corner| {
        let (mut weight, mut cell) = (1.0, [0; 3]);
        for axis in 0..3 {
            let upper = corner >> axis & 1 == 1;
            weight *= if upper { share[axis] } else { 1.0 - share[axis] };
            cell[axis] = if upper { high[axis] } else { low[axis] };
        }
        (cloud.shape.index(cell[0], cell[1], cell[2]), weight)
    })
}

/// Lookups between the centres of one grid without sides that repeat, in single precision, for loops that run while a frame waits.
#[derive(Clone, Copy, Debug)]
pub struct CellCubes {
    shape: GridShape,
    origin: Vec3,
    cell: Vec3,
    /// Index of the last cell along each axis.
    last: Vec3,
}

/// The cube of eight centres around a place.
#[derive(Clone, Copy, Debug)]
pub struct Cube {
    /// The cell of its corner with the smallest coordinates.
    pub index: usize,
    share: Vec3,
}

impl CellCubes {
    /// For `cloud`'s grid.
    pub fn new(cloud: &Cloud) -> Self {
        Self {
            shape: cloud.shape,
            origin: cloud.origin_m.as_vec3(),
            cell: Vec3::from_array(cloud.cell_m.map(|edge| edge as f32)),
            last: Vec3::from_array(cloud.shape.to_array().map(|count| count as f32 - 1.0)),
        }
    }

    /// The cube around a place, m, and the share of its upper sides.
    #[inline]
    pub fn at(&self, point: Vec3) -> Cube {
        let at = ((point - self.origin) / self.cell - 0.5).clamp(Vec3::ZERO, self.last);
        // Of numbers from 0 the whole part is the floor, without a call.
        let cell = at.to_array().map(|at| at as i32);
        let index = cell[0] as usize
            + cell[1] as usize * self.shape.row_stride()
            + cell[2] as usize * self.shape.slab_stride();
        Cube { index, share: at - Vec3::from_array(cell.map(|cell| cell as f32)) }
    }

    /// Weights of the eight centres; those beyond the grid count for the nearest within.
    #[inline]
    pub fn weights(&self, cube: &Cube) -> ([usize; 8], [f32; 8]) {
        // A share above 0 says that there is a centre above.
        let [u, v, w] = cube.share.to_array();
        let right = usize::from(u > 0.0);
        let row = if v > 0.0 { self.shape.row_stride() } else { 0 };
        let slab = if w > 0.0 { self.shape.slab_stride() } else { 0 };
        let base = cube.index;
        let at = [
            base,
            base + right,
            base + row,
            base + row + right,
            base + slab,
            base + slab + right,
            base + slab + row,
            base + slab + row + right,
        ];
        let (a, b, c) = (1.0 - u, 1.0 - v, 1.0 - w);
        (at, [a * b * c, u * b * c, a * v * c, u * v * c, a * b * w, u * b * w, a * v * w, u * v * w])
    }

    /// The first three of four values a cell.
    #[inline]
    pub fn mix_colours(&self, cube: &Cube, cells: &[Vec4]) -> [f32; 3] {
        let (at, weights) = self.weights(cube);
        (0..8).fold(Vec4::ZERO, |sum, i| sum + cells[at[i]] * weights[i]).truncate().to_array()
    }

    /// Where a ray enters and leaves the grid, m from its origin; none that misses it.
    #[inline]
    pub(super) fn span(&self, cloud: &Cloud, from: Vec3, way: Vec3) -> Option<(f32, f32)> {
        // A direction without a component divides to ±∞, and to NaN on a face: min and max then skip it.
        let a = (self.origin - from) / way;
        let b = (cloud.far_corner().as_vec3() - from) / way;
        let near = a.min(b).max_element().max(0.0);
        let far = a.max(b).min_element();
        // Written so that NaN misses it.
        (near < far).then_some((near, far))
    }

    /// Metres from a place along `direction` to where it leaves its cube of centres and all around it that are fewer than `cubes`
    /// steps away.
    #[inline]
    pub fn to_leave(&self, point: Vec3, direction: Vec3, cubes: u8) -> f32 {
        let (at, way) = ((point - self.origin) / self.cell, direction / self.cell);
        let floor = |value: f32| {
            let whole = value as i32 as f32;
            if whole > value { whole - 1.0 } else { whole }
        };
        let (low, cubes) = (Vec3::from_array((at - 0.5).to_array().map(floor)) + 0.5, f32::from(cubes));
        let ahead = Vec3::select(way.cmpgt(Vec3::ZERO), low + cubes - at, low + 1.0 - cubes - at) / way;
        let ahead = Vec3::select(ahead.is_nan_mask(), Vec3::INFINITY, ahead);
        ahead.min_element()
    }
}
