//! Rays that together carry all of a source's light that meets the grid.

use super::{PowerRay, Tracer};
use crate::cloud::Boundary;
use crate::light::{Light, PointLight};
use glam::DVec3;

/// Largest share of the sphere that one ray stands for, sr: a face right beside the source fills half the sphere, and a ray
/// through its middle would graze it.
const WIDEST: f64 = 0.02;
/// Halvings of a face at most.
const DEEPEST: u32 = 24;

/// A side of the grid by which light leaves, cut into rectangles.
struct Side {
    /// Axis that the side stands across, and the two that span it.
    axes: [usize; 3],
    /// −1 at the smaller coordinates, 1 at the larger.
    sign: f64,
    /// Coordinate of the side along its axis, m.
    plane: f64,
    /// Edges of a rectangle, m.
    step: [f64; 2],
    /// How many rectangles there are.
    count: [usize; 2],
}

impl Tracer<'_> {
    /// Calls `emit` for rays that together carry all of `light` that meets the grid, `samples`² through every cell face
    /// by which light can leave.
    pub fn rays(&self, light: Light, samples: u32, mut emit: impl FnMut(PowerRay)) {
        let counts = self.cloud.shape.to_array();
        let periodic = self.cloud.boundary == Boundary::PeriodicXy;
        if let (true, Light::Point { position, intensity }) = (periodic, light) {
            // Seen from inside a grid without sides, there is no last face: even shares of the sphere instead.
            let count = (counts[0] * counts[1]).max(1024) * (samples * samples) as usize * 4;
            let power = intensity * 4.0 * std::f64::consts::PI / count as f64;
            for i in 0..count {
                emit(PowerRay { origin: position, direction: fibonacci(i, count), power });
            }
            return;
        }
        for axis in if periodic { 2 } else { 0 }..3 {
            for sign in [-1.0, 1.0] {
                let side = self.side(axis, sign, samples);
                match light {
                    Light::Point { position, intensity } => {
                        self.point_rays(&side, PointLight { position, intensity }, &mut emit);
                    }
                    Light::Beam { direction, irradiance } => {
                        self.beam_rays(&side, direction, irradiance, &mut emit);
                    }
                }
            }
        }
    }

    fn side(&self, axis: usize, sign: f64, samples: u32) -> Side {
        let (cloud, counts) = (self.cloud, self.cloud.shape.to_array());
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        Side {
            axes: [axis, u, v],
            sign,
            plane: if sign < 0.0 { cloud.origin_m[axis] } else { self.far[axis] },
            step: [cloud.cell_m[u] / f64::from(samples), cloud.cell_m[v] / f64::from(samples)],
            count: [counts[u] * samples as usize, counts[v] * samples as usize],
        }
    }

    fn point_rays(&self, side: &Side, light: PointLight, emit: &mut impl FnMut(PowerRay)) {
        let PointLight { position, intensity } = light;
        let ([axis, u, v], step, [columns, rows]) = (side.axes, side.step, side.count);
        // Light leaves by a face only if the source lies on its inner side.
        let distance = (side.plane - position[axis]) * side.sign;
        if distance <= 0.0 {
            return;
        }
        // The light's coordinates within the plane are the origin.
        let edge =
            |axis: usize, i: usize, step: f64| self.cloud.origin_m[axis] + i as f64 * step - position[axis];
        let corner = |i, j| corner(edge(u, i, step[0]), edge(v, j, step[1]), distance);
        let mut below: Vec<f64> = (0..=columns).map(|i| corner(i, 0)).collect();
        for j in 0..rows {
            let above: Vec<f64> = (0..=columns).map(|i| corner(i, j + 1)).collect();
            for i in 0..columns {
                let solid_angle = above[i + 1] - above[i] - below[i + 1] + below[i];
                let face = Face {
                    u: [edge(u, i, step[0]), edge(u, i + 1, step[0])],
                    v: [edge(v, j, step[1]), edge(v, j + 1, step[1])],
                    distance,
                };
                face.split(solid_angle, 0, &mut |face, solid_angle| {
                    let mut direction = DVec3::ZERO;
                    direction[axis] = distance * side.sign;
                    direction[u] = 0.5 * (face.u[0] + face.u[1]);
                    direction[v] = 0.5 * (face.v[0] + face.v[1]);
                    emit(PowerRay {
                        origin: position,
                        direction: direction.normalize(),
                        power: intensity * solid_angle,
                    });
                });
            }
            below = above;
        }
    }

    fn beam_rays(&self, side: &Side, direction: DVec3, irradiance: f64, emit: &mut impl FnMut(PowerRay)) {
        let (cloud, [axis, u, v], step) = (self.cloud, side.axes, side.step);
        let through = direction[axis] * side.sign;
        if through <= 0.0 {
            return;
        }
        let power = irradiance * through * step[0] * step[1];
        // Back along the beam to before the grid.
        let back = match cloud.boundary {
            Boundary::PeriodicXy => (self.far.z - cloud.origin_m.z) / direction.z.abs(),
            Boundary::Open => 2.0 * (self.far - cloud.origin_m).length(),
        };
        for j in 0..side.count[1] {
            for i in 0..side.count[0] {
                let mut target = DVec3::ZERO;
                target[axis] = side.plane;
                target[u] = cloud.origin_m[u] + (i as f64 + 0.5) * step[0];
                target[v] = cloud.origin_m[v] + (j as f64 + 0.5) * step[1];
                emit(PowerRay { origin: target - direction * back, direction, power });
            }
        }
    }
}

/// A rectangle in a plane `distance` from a source, with the source's foot as origin.
#[derive(Clone, Copy)]
struct Face {
    u: [f64; 2],
    v: [f64; 2],
    distance: f64,
}

/// Solid angle of the rectangle between the foot and corner (a, b).
fn corner(a: f64, b: f64, distance: f64) -> f64 {
    libm::atan(a * b / (distance * (a * a + b * b + distance * distance).sqrt()))
}

impl Face {
    fn solid_angle(&self) -> f64 {
        let corner = |i: usize, j: usize| corner(self.u[i], self.v[j], self.distance);
        corner(1, 1) - corner(0, 1) - corner(1, 0) + corner(0, 0)
    }

    /// Calls `emit` for parts of the face none of which looks wide from the source.
    fn split(self, solid_angle: f64, depth: u32, emit: &mut impl FnMut(Face, f64)) {
        if solid_angle <= WIDEST || depth == DEEPEST {
            if solid_angle > 0.0 {
                emit(self, solid_angle);
            }
            return;
        }
        let halves = |range: [f64; 2]| {
            let middle = 0.5 * (range[0] + range[1]);
            [[range[0], middle], [middle, range[1]]]
        };
        for v in halves(self.v) {
            for u in halves(self.u) {
                let part = Face { u, v, ..self };
                part.split(part.solid_angle(), depth + 1, emit);
            }
        }
    }
}

/// Point `index` of `count` on a golden-angle spiral: nearly even shares of the sphere.
pub fn fibonacci(index: usize, count: usize) -> DVec3 {
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    let z = 1.0 - (2.0 * index as f64 + 1.0) / count as f64;
    let (sin, cos) = libm::sincos(GOLDEN_ANGLE * index as f64);
    let rho = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(rho * cos, rho * sin, z)
}
