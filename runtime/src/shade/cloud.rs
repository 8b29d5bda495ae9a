//! Light of a cloud grid along a ray: radiance ∫ σ_s J e^{−τ} ds and what the cloud lets through.
//!
//! Extinction is that of the cell (piecewise constant); J is read between cell centres, and in empty cells too, where it
//! exists as well: setting it to zero there would darken every edge. Near a lamp J changes within a cell: light that comes
//! straight from the lamp can be worked out at every step instead.

pub mod march;

use crate::camera::{Camera, Projection, Ray};
use crate::math::exp_neg;
use crate::phase::henyey_greenstein;
use crate::transport::Cloud;
use crate::transport::direct::{Light, Tracer};
use glam::DVec3;

/// Most parts that one cell's chord is cut into near a lamp.
const MAX_PARTS: usize = 64;
/// Light behind less than this share is not looked for.
const OPAQUE: f64 = 1e-6;

/// What a ray meets in a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudSample {
    /// Radiance towards the ray's origin, W/(m² sr).
    pub radiance: f64,
    /// Share of what is behind that comes through.
    pub transmittance: f64,
}

/// A cloud with its light, ready to be looked at.
#[derive(Clone, Copy)]
pub struct LitCloud<'a> {
    /// Grid and optics.
    pub cloud: &'a Cloud,
    /// J per cell towards the eye, W/(m² sr), x fastest.
    pub j: &'a [f32],
    /// Lights whose direct part is not in `j` and is worked out at every step.
    pub exact: &'a [Light],
    /// Extinction scale 1 − ωf of the transport that made `j`: what it counts as unscattered belongs to the direct part.
    pub extinction_scale: f64,
}

impl LitCloud<'_> {
    /// Follows `ray`. An orthographic camera sees what lies behind its plane too: pass its projection.
    pub fn look(&self, ray: Ray, projection: Projection) -> CloudSample {
        let cloud = self.cloud;
        let tracer = Tracer::new(cloud, self.extinction_scale);
        let back = match projection {
            Projection::Orthographic { .. } => {
                ray.origin.distance(cloud.origin_m) + cloud.far_corner().distance(cloud.origin_m)
            }
            Projection::Perspective { .. } => 0.0,
        };
        let origin = ray.origin - ray.direction * back;
        let nothing = CloudSample { radiance: 0.0, transmittance: 1.0 };
        let Some((start, stop)) = tracer.span(origin, ray.direction) else { return nothing };
        let towards = -ray.direction;
        let (mut radiance, mut open, mut at) = (0.0f64, 1.0f64, start);
        tracer.walk(origin, ray.direction, start, stop, |_, length, extinction| {
            let length = f64::from(length);
            if extinction > 0.0 {
                let parts = self.parts(origin + ray.direction * (at + 0.5 * length), length);
                let step = length / parts as f64;
                let through = f64::from(exp_neg((f64::from(extinction) * step) as f32));
                for part in 0..parts {
                    let point = origin + ray.direction * (at + (part as f64 + 0.5) * step);
                    let mut j = f64::from(between(cloud, self.j, point));
                    for &light in self.exact {
                        j += self.direct(&tracer, light, point, towards);
                    }
                    radiance += open * cloud.albedo * j * (1.0 - through);
                    open *= through;
                }
            }
            at += length;
            open > OPAQUE
        });
        CloudSample { radiance, transmittance: open }
    }

    /// Steps for a chord: more where a lamp is near.
    fn parts(&self, middle: DVec3, length: f64) -> usize {
        let mut parts = 1;
        for light in self.exact {
            parts = parts.max(match light {
                Light::Point { position, .. } => {
                    let distance = (middle.distance(*position) - 0.5 * length).max(1e-3);
                    ((4.0 * length / distance).ceil() as usize).clamp(1, MAX_PARTS)
                }
                Light::Beam { .. } => 2,
            });
        }
        parts
    }

    /// J of one light's direct part at a point: light never scattered, and light scattered forward only, whose next
    /// scattering spreads by the phase function's convolution with itself.
    fn direct(&self, tracer: &Tracer<'_>, light: Light, point: DVec3, towards: DVec3) -> f64 {
        let g = self.cloud.g;
        let (from, travel, flux) = match light {
            Light::Point { position, intensity } => {
                let offset = point - position;
                // A millimetre keeps a sample that hits the lamp itself finite.
                let squared = offset.length_squared().max(1e-6);
                (position, offset / squared.sqrt(), intensity / squared)
            }
            Light::Beam { direction, irradiance } => {
                let size = self.cloud.far_corner().distance(self.cloud.origin_m);
                (point - direction * (size + point.distance(self.cloud.origin_m)), direction, irradiance)
            }
        };
        let depth = tracer.optical_depth(from, point);
        let open = f64::from(exp_neg(depth));
        let scaled = f64::from(exp_neg(depth * self.extinction_scale as f32));
        let cos = travel.dot(towards);
        flux * (open * henyey_greenstein(g, cos) + (scaled - open) * henyey_greenstein(g * g, cos))
    }
}

/// The direction from each place towards a camera.
pub fn direction_to(camera: &Camera, point: DVec3) -> DVec3 {
    match camera.projection {
        Projection::Orthographic { .. } => -camera.forward,
        Projection::Perspective { .. } => {
            (camera.position - point).try_normalize().unwrap_or(-camera.forward)
        }
    }
}

/// Reads cell values between centres, trilinear; beyond the outer centres the nearest counts.
pub fn between(cloud: &Cloud, values: &[f32], point: DVec3) -> f32 {
    let counts = cloud.shape.to_array();
    let (mut low, mut high, mut share) = ([0usize; 3], [0usize; 3], [0.0f32; 3]);
    for axis in 0..3 {
        let at = (point[axis] - cloud.origin_m[axis]) / cloud.cell_m[axis] - 0.5;
        let at = at.clamp(0.0, counts[axis] as f64 - 1.0);
        low[axis] = (at as usize).min(counts[axis].saturating_sub(2));
        high[axis] = (low[axis] + 1).min(counts[axis] - 1);
        share[axis] = (at - low[axis] as f64) as f32;
    }
    let mut sum = 0.0;
    for corner in 0..8 {
        let (mut weight, mut cell) = (1.0, [0; 3]);
        for axis in 0..3 {
            let upper = corner >> axis & 1 == 1;
            weight *= if upper { share[axis] } else { 1.0 - share[axis] };
            cell[axis] = if upper { high[axis] } else { low[axis] };
        }
        sum += weight * values[cloud.shape.index(cell[0], cell[1], cell[2])];
    }
    sum
}
