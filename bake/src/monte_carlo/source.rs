//! Where photons start: directions from a point lamp, or places on the faces that a beam falls on.
//!
//! Starts are even in the square of two numbers: R2, the additive sequence of the plastic number, shifted at random for each
//! batch. Every start alone is uniform, so that means are unbiased; together they leave far less noise in light that was
//! never scattered than independent ones would, and batches with shifts of their own still tell the standard error.

use super::phase::around;
use super::traverse::Grid;
use glam::DVec3;
use squall_runtime::random::Random;
use squall_runtime::transport::direct::Light;
use std::f64::consts::TAU;

/// A light's photons.
#[derive(Clone, Debug)]
pub struct Source {
    /// Power of all photons together, those that miss the grid included, W.
    pub power: f64,
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    /// Uniform over a cap of the sphere around `axis` whose 1 − cosine is `depth` at most.
    Cap { from: DVec3, axis: DVec3, depth: f64 },
    /// Uniform over the faces that the beam falls on, by projected area: axis, and share of the power up to this face.
    Faces { direction: DVec3, faces: Vec<(usize, f64)> },
}

impl Source {
    /// The photons of `light` that can meet `grid`.
    pub fn new(grid: &Grid<'_>, light: Light) -> Self {
        match light {
            Light::Point { position, intensity } => {
                let (axis, depth) = cap(grid, position);
                Self { power: intensity * TAU * depth, kind: Kind::Cap { from: position, axis, depth } }
            }
            Light::Beam { direction, irradiance } => {
                let size = grid.size();
                let area = |axis: usize| direction[axis].abs() * size[(axis + 1) % 3] * size[(axis + 2) % 3];
                let axes: Vec<usize> =
                    (0..3).filter(|&axis| !grid.repeats(axis) && direction[axis] != 0.0).collect();
                let total: f64 = axes.iter().map(|&axis| area(axis)).sum();
                let mut sum = 0.0;
                let upto = |&axis: &usize| {
                    sum += area(axis) / total;
                    (axis, sum)
                };
                let faces = axes.iter().map(upto).collect();
                Self { power: irradiance * total, kind: Kind::Faces { direction, faces } }
            }
        }
    }

    /// Start and direction of the photon at (u, v) in the unit square.
    pub fn start(&self, grid: &Grid<'_>, [u, v]: [f64; 2]) -> (DVec3, DVec3) {
        match &self.kind {
            Kind::Cap { from, axis, depth } => {
                // 1 − cosine, so that the cap of a lamp far away keeps its digits.
                let less = u * depth;
                let rho = (less * (2.0 - less)).max(0.0).sqrt();
                let (sin, cos) = libm::sincos(TAU * v);
                (*from, around(*axis, 1.0 - less, rho * cos, rho * sin).normalize())
            }
            Kind::Faces { direction, faces } => {
                let last = faces.len() - 1;
                let face = faces.iter().position(|&(_, upto)| u < upto).unwrap_or(last);
                let before = if face == 0 { 0.0 } else { faces[face - 1].1 };
                let (axis, upto) = faces[face];
                let share = [(u - before) / (upto - before), v];
                let mut at = DVec3::ZERO;
                at[axis] = if direction[axis] > 0.0 { 0.0 } else { grid.size()[axis] };
                for (k, share) in share.into_iter().enumerate() {
                    let across = (axis + 1 + k) % 3;
                    at[across] = share * grid.size()[across];
                }
                (grid.origin() + at, *direction)
            }
        }
    }
}

/// The smallest cap of directions known to hold all from `light` to the grid: its axis, and 1 − cosine at its rim.
fn cap(grid: &Grid<'_>, light: DVec3) -> (DVec3, f64) {
    let (low, high) = (grid.origin(), grid.origin() + grid.size());
    let (mut axis, mut depth) = (DVec3::Z, 2.0);
    for side in (0..3).filter(|&side| !grid.repeats(side)) {
        let towards = f64::from(light[side] < low[side]) - f64::from(light[side] > high[side]);
        if towards != 0.0 {
            // Outside this side: the half space that faces the grid.
            (axis, depth) = (DVec3::ZERO, 1.0);
            axis[side] = towards;
        }
    }
    let offset = 0.5 * (low + high) - light;
    let (distance, radius) = (offset.length(), 0.5 * grid.size().length());
    if !grid.repeats(0) && distance > radius {
        // The cone around the sphere around the grid.
        let sine = radius / distance;
        let around_sphere = sine * sine / (1.0 + (1.0 - sine * sine).sqrt());
        if around_sphere < depth {
            return (offset / distance, around_sphere);
        }
    }
    (axis, depth)
}

/// Points of the unit square, one after another.
#[derive(Clone, Debug)]
pub struct Square {
    at: [u64; 2],
}

impl Square {
    /// Shifted by what `random` says.
    pub fn new(random: &mut Random) -> Self {
        Self { at: [random.bits(), random.bits()] }
    }

    /// The next point; whole turns fall off the 64 bits.
    pub fn point(&mut self) -> [f64; 2] {
        // 2⁶⁴ times 1/p and 1/p², p³ = p + 1.
        const STEP: [u64; 2] = [0xC13F_A9A9_02A6_328F, 0x91E1_0DA5_C79E_7B1D];
        std::array::from_fn(|k| {
            self.at[k] = self.at[k].wrapping_add(STEP[k]);
            (self.at[k] >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::GridShape;
    use squall_runtime::transport::{Boundary, Cloud};

    fn cloud() -> Cloud {
        let shape = GridShape::new(4, 2, 3);
        let (cell_m, origin_m) = ([10.0, 30.0, 5.0], DVec3::new(-20.0, -30.0, 100.0));
        let extinction = vec![0.0; shape.len()];
        Cloud { shape, cell_m, origin_m, extinction, albedo: 1.0, g: 0.0, boundary: Boundary::Open }
    }

    #[test]
    fn the_share_of_a_lamps_light_that_meets_the_grid_does_not_depend_on_the_cap() {
        /// Evenly spread points against the solid angle from 400² independent ones over the sphere: three standard errors of the
        /// latter at the smallest share.
        const TOLERANCE: f64 = 0.06;
        let cloud = cloud();
        let grid = Grid::new(&cloud);
        let mut random = Random::new(2);
        for light in [
            [0.0, 0.0, 107.0],
            [0.0, 0.0, 95.0],
            [-20.0, 0.0, 100.0],
            [60.0, -50.0, 150.0],
            [0.0, 0.0, 300.0],
        ] {
            let from = DVec3::from_array(light);
            let source = Source::new(&grid, Light::Point { position: from, intensity: 1.0 });
            let mut square = Square::new(&mut random);
            let count = 160_000;
            let hits = (0..count).filter(|_| {
                let (start, direction) = source.start(&grid, square.point());
                assert!((direction.length() - 1.0).abs() < 1e-14);
                grid.enter(start, direction).is_some()
            });
            let found = source.power * hits.count() as f64 / f64::from(count);
            let plain = (0..count).filter(|_| grid.enter(from, random.direction()).is_some()).count();
            let wanted = 2.0 * TAU * plain as f64 / f64::from(count);
            assert!((found / wanted - 1.0).abs() < TOLERANCE, "{light:?}: {found} {wanted}");
        }
    }

    #[test]
    fn a_beam_lights_every_face_by_its_projected_area() {
        let cloud = cloud();
        let grid = Grid::new(&cloud);
        let direction = DVec3::new(0.48, -0.6, -0.64);
        let source = Source::new(&grid, Light::Beam { direction, irradiance: 2.0 });
        let wanted = 2.0 * (0.48 * 60.0 * 15.0 + 0.6 * 40.0 * 15.0 + 0.64 * 40.0 * 60.0);
        assert!((source.power / wanted - 1.0).abs() < 1e-14);
        let mut square = Square::new(&mut Random::new(1));
        let mut counts = [0u32; 3];
        for _ in 0..10_000 {
            let (start, direction) = source.start(&grid, square.point());
            assert!(grid.enter(start, direction).is_some());
            let at = start - grid.origin();
            let on = [at.x == 0.0, at.y == 60.0, at.z == 15.0];
            counts[on.iter().position(|on| *on).unwrap()] += 1;
        }
        let top = 2.0 * 0.64 * 40.0 * 60.0 / wanted;
        assert!((f64::from(counts[2]) / 10_000.0 - top).abs() < 1e-3, "{counts:?}");
    }
}
