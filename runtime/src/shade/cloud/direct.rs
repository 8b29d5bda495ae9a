//! Direct light worked out where a ray is, not read from cells: near a light J changes within a cell.

use super::march::RayWidth;
use crate::camera::Ray;
use crate::math::exp_neg;
use crate::phase::henyey_greenstein;
use crate::transport::direct::{Light, Tracer};
use crate::transport::{Boundary, Cloud};
use glam::DVec3;

/// Longest step beside a light, as a share of the distance to it: with two points a step, 1/r² is then off by .1 %.
const STEP_PER_DISTANCE: f64 = 1.0 / 3.0;

/// Lights whose direct part is followed exactly.
#[derive(Clone, Copy, Debug)]
pub struct ExactDirect<'a> {
    /// The lights. Their direct part must not be in the J that cells hold.
    pub lights: &'a [Light],
    /// Extinction scale 1 − ωf of the transport that made J: what it counts as unscattered belongs to the direct part.
    pub extinction_scale: f64,
}

impl ExactDirect<'_> {
    /// Nearest that `ray` may come to `light`, m.
    fn nearest(light: &Light, ray: &Ray, width: RayWidth) -> f64 {
        match light {
            Light::Point { position, .. } => width.nearest((*position - ray.origin).dot(ray.direction).abs()),
            Light::Beam { .. } => 0.0,
        }
    }

    /// Longest step from `point` that sees every light evenly, m.
    pub(super) fn longest_step(&self, ray: &Ray, width: RayWidth, point: DVec3) -> f64 {
        let mut step = f64::INFINITY;
        for light in self.lights {
            if let Light::Point { position, .. } = light {
                let distance = point.distance(*position).max(Self::nearest(light, ray, width));
                step = step.min(STEP_PER_DISTANCE * distance);
            }
        }
        step
    }

    /// J of all lights' direct part at a point towards the ray's origin, W/(m² sr).
    pub(super) fn in_scattered(&self, cloud: &Cloud, ray: &Ray, width: RayWidth, point: DVec3) -> f64 {
        let one =
            |light: &Light| self.one(cloud, *light, point, -ray.direction, Self::nearest(light, ray, width));
        self.lights.iter().map(one).sum()
    }

    /// J of one light's direct part: light never scattered, and light scattered forward only, whose next scattering spreads by the
    /// phase function's convolution with itself. Distances below `nearest` count as that.
    fn one(&self, cloud: &Cloud, light: Light, point: DVec3, towards: DVec3, nearest: f64) -> f64 {
        let (from, travel, flux) = match light {
            Light::Point { position, intensity } => {
                let offset = point - position;
                let travel = offset.try_normalize().unwrap_or(towards);
                (position, travel, intensity / offset.length_squared().max(nearest * nearest))
            }
            Light::Beam { direction, irradiance } => {
                let height = cloud.far_corner().z - cloud.origin_m.z;
                let back = match cloud.boundary {
                    Boundary::Open => {
                        cloud.far_corner().distance(cloud.origin_m) + point.distance(cloud.origin_m)
                    }
                    Boundary::PeriodicXy => height / direction.z.abs(),
                };
                (point - direction * back, direction, irradiance)
            }
        };
        let depth = Tracer::new(cloud, self.extinction_scale).optical_depth(from, point);
        let open = f64::from(exp_neg(depth));
        let scaled = f64::from(exp_neg(depth * self.extinction_scale as f32));
        let (g, cos) = (cloud.g, travel.dot(towards));
        flux * (open * henyey_greenstein(g, cos) + (scaled - open) * henyey_greenstein(g * g, cos))
    }
}
