//! The cells of a lattice that a piece of a frustum meets.
//!
//! Everything is in lattice units (one cell = 1) relative to the cell that the camera is in, so that the
//! numbers are small whatever the hour and wherever the camera.

#[cfg(feature = "gpu")]
mod upload;

use glam::{DVec2, DVec3};
use std::ops::Range;

/// The part of a frustum between two planar depths, its sides moved outward by a margin: a convex body
/// with eight corners and six planes n·p ≤ d.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrustumPiece {
    corners: [DVec3; 8],
    planes: [(DVec3, f64); 6],
}

/// Pairs of corners that an edge joins: those whose index differs in one bit.
const EDGES: [[usize; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

/// A camera in a lattice's units.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Viewpoint {
    pub position: DVec3,
    pub right: DVec3,
    pub up: DVec3,
    pub forward: DVec3,
    /// Half extents of the picture at unit depth.
    pub tangent: DVec2,
}

impl FrustumPiece {
    /// The frustum of `eye` between depths `near` and `far`, its four sides `margin` further out.
    pub fn new(eye: &Viewpoint, near: f64, far: f64, margin: f64) -> Self {
        let Viewpoint { position, right, up, forward, tangent } = *eye;
        let secant = DVec2::new((1.0 + tangent.x * tangent.x).sqrt(), (1.0 + tangent.y * tangent.y).sqrt());
        let corners = std::array::from_fn(|i| {
            let depth = if i & 4 == 0 { near } else { far };
            let half = tangent * depth + secant * margin;
            let x = if i & 1 == 0 { -half.x } else { half.x };
            let y = if i & 2 == 0 { -half.y } else { half.y };
            position + right * x + up * y + forward * depth
        });
        let side = |axis: DVec3, tangent: f64, secant: f64| {
            let normal = (axis - forward * tangent) / secant;
            (normal, normal.dot(position) + margin)
        };
        let planes = [
            (-forward, -forward.dot(position) - near),
            (forward, forward.dot(position) + far),
            side(right, tangent.x, secant.x),
            side(-right, tangent.x, secant.x),
            side(up, tangent.y, secant.y),
            side(-up, tangent.y, secant.y),
        ];
        Self { corners, planes }
    }

    /// Layers of cells along z that the body meets.
    pub fn layers(&self) -> Range<i64> {
        let (low, high) = self.extent(|corner| corner.z);
        cells(low, high)
    }

    /// Distance from `centre` to the farthest point of the body.
    pub fn radius(&self, centre: DVec3) -> f64 {
        self.corners.iter().map(|corner| corner.distance(centre)).fold(0.0, f64::max)
    }

    /// How many rows a box around the body has; an upper bound on the rows that are visited.
    pub fn rows_in_box(&self) -> f64 {
        let (y0, y1) = self.extent(|corner| corner.y);
        let (z0, z1) = self.extent(|corner| corner.z);
        (y1 - y0 + 2.0) * (z1 - z0 + 2.0)
    }

    /// Rows of cells along y in a layer that the body meets.
    pub fn rows(&self, layer: i64) -> Range<i64> {
        let (bottom, top) = (layer as f64, layer as f64 + 1.0);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for [a, b] in EDGES {
            let (a, b) = (self.corners[a], self.corners[b]);
            let (a, b) = if a.z <= b.z { (a, b) } else { (b, a) };
            if b.z < bottom || a.z > top {
                continue;
            }
            let at = |z: f64| if b.z > a.z { a.y + (b.y - a.y) * ((z - a.z) / (b.z - a.z)) } else { a.y };
            for y in [if a.z >= bottom { a.y } else { at(bottom) }, if b.z <= top { b.y } else { at(top) }] {
                low = low.min(y);
                high = high.max(y);
            }
        }
        if low > high { 0..0 } else { cells(low, high) }
    }

    /// Cells along x of a row that the body may meet: none that it does meet is left out.
    pub fn cells(&self, layer: i64, row: i64) -> Range<i64> {
        let (y, z) = (row as f64, layer as f64);
        let (mut low, mut high) = self.extent(|corner| corner.x);
        for (normal, bound) in self.planes {
            // The row's most favourable point for this plane.
            let least = |n: f64, from: f64| if n > 0.0 { n * from } else { n * (from + 1.0) };
            let room = bound - least(normal.y, y) - least(normal.z, z);
            if normal.x > PARALLEL {
                high = high.min(room / normal.x);
            } else if normal.x < -PARALLEL {
                low = low.max(room / normal.x);
            } else if room < -PARALLEL * high.abs().max(low.abs()) {
                return 0..0;
            }
        }
        if low > high { 0..0 } else { cells(low, high) }
    }

    fn extent(&self, coordinate: impl Fn(&DVec3) -> f64) -> (f64, f64) {
        self.corners
            .iter()
            .map(coordinate)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
    }
}

/// A plane this close to a row's direction does not bound it along the row.
const PARALLEL: f64 = 1e-12;

/// Cells from the one that holds `low` to the one that holds `high`; a hair wider, for round-off.
fn cells(low: f64, high: f64) -> Range<i64> {
    const HAIR: f64 = 1e-9;
    (low - HAIR).floor() as i64..(high + HAIR).floor() as i64 + 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn eye(random: &mut Random) -> Viewpoint {
        let forward = random.direction();
        let right = forward.cross(random.direction()).normalize();
        let up = right.cross(forward);
        let tangent = DVec2::new(random.range(0.01, 3.0), random.range(0.01, 3.0));
        let position = DVec3::new(random.unit(), random.unit(), random.unit());
        Viewpoint { position, right, up, forward, tangent }
    }

    #[test]
    fn every_cell_with_a_point_of_the_body_is_visited_once() {
        let mut random = Random::new(11);
        for _ in 0..200 {
            let eye = eye(&mut random);
            let (near, far) = (random.range(0.0, 2.0), random.range(2.0, 12.0));
            let margin = random.range(0.0, 0.5);
            let piece = FrustumPiece::new(&eye, near, far, margin);
            let mut visited = std::collections::HashSet::new();
            for layer in piece.layers() {
                for row in piece.rows(layer) {
                    for cell in piece.cells(layer, row) {
                        assert!(visited.insert([cell, row, layer]));
                    }
                }
            }
            for _ in 0..500 {
                let depth = random.range(near, far);
                let across = DVec2::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0));
                let half = across * (eye.tangent * depth + DVec2::splat(margin));
                let point = eye.position + eye.right * half.x + eye.up * half.y + eye.forward * depth;
                let cell = point.to_array().map(|value| value.floor() as i64);
                assert!(visited.contains(&cell), "{point} of {eye:?}");
            }
        }
    }

    #[test]
    fn few_cells_are_visited_in_vain() {
        let mut random = Random::new(12);
        let (mut visited, mut volume) = (0.0, 0.0);
        for _ in 0..100 {
            let eye = Viewpoint { tangent: DVec2::new(1.0, 0.6), ..eye(&mut random) };
            let piece = FrustumPiece::new(&eye, 2.0, 20.0, 0.0);
            for layer in piece.layers() {
                for row in piece.rows(layer) {
                    visited += (piece.cells(layer, row).end - piece.cells(layer, row).start) as f64;
                }
            }
            volume += 4.0 / 3.0 * 0.6 * (8000.0 - 8.0);
        }
        // A body 20 cells deep touches about 1.3 times as many cells as it is large.
        assert!(visited / volume < 1.45, "{}", visited / volume);
    }
}
