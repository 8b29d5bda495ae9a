//! Light of a cloud grid along a ray: radiance ∫ σ_s J e^{−τ} ds and what the cloud lets through.
//!
//! Extinction is that of the cell (piecewise constant); J is read between cell centres, and in empty cells too, where it
//! exists as well: setting it to zero there would darken every edge. Near a lamp J changes within a cell: light that comes
//! straight from the lamp can be worked out at every step instead, and steps then shorten towards the lamp.

pub mod march;

use crate::camera::{Camera, Projection, Ray};
use crate::math::exp_neg;
use crate::phase::henyey_greenstein;
use crate::transport::direct::{Light, Tracer};
use crate::transport::{Boundary, Cloud};
use glam::DVec3;

/// Longest step beside a lamp, as a share of the distance to it: with two points a step, 1/r² is then off by .1 %.
const STEP_PER_DISTANCE: f64 = 1.0 / 3.0;
/// Longest step in optical depth.
const STEP_DEPTH: f64 = 0.5;
/// Shortest distance to a lamp that counts, m, for rays without a width.
const NEAREST: f64 = 1e-3;
/// Places of the two-point Gauss rule in a step of length 1.
const GAUSS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
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
    /// Lights whose direct part is not in the J that is handed over and is worked out at every step.
    pub exact: &'a [Light],
    /// Extinction scale 1 − ωf of the transport that made J: what it counts as unscattered belongs to the direct part.
    pub extinction_scale: f64,
    /// Longest step, m: about how fine J is.
    pub longest_step: f64,
}

/// How much a ray stands for: the edge of its part of the picture, which grows with distance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RayWidth {
    /// At the ray's origin, m.
    pub start: f64,
    /// Growth, m/m.
    pub per_metre: f64,
}

impl RayWidth {
    /// A ray that stands for `share` of a pixel's edge.
    pub fn of(camera: &Camera, share: f64) -> Self {
        let edge = share / camera.pixels_per_metre();
        match camera.projection {
            Projection::Orthographic { .. } => Self { start: edge, per_metre: 0.0 },
            Projection::Perspective { .. } => Self { start: 0.0, per_metre: edge },
        }
    }

    /// Nearest that a ray may come to a lamp `distance` metres along it.
    ///
    /// A ray that passes the lamp at b sees π/b; its mean over the part of the picture around the lamp, a disc of radius ρ,
    /// is 2π/ρ, which is what a ray through the lamp itself sees when no distance below 2ρ/π counts.
    fn nearest(self, distance: f64) -> f64 {
        let edge = self.start + self.per_metre * distance;
        let radius = edge / std::f64::consts::PI.sqrt();
        (radius * std::f64::consts::FRAC_2_PI).max(NEAREST)
    }
}

impl LitCloud<'_> {
    /// Follows `ray`, with J towards its origin from a function of the place, W/(m² sr). An orthographic camera sees what lies
    /// behind its plane too: pass its projection. The ray's width keeps a lamp in the picture finite.
    pub fn look(
        &self,
        ray: Ray,
        projection: Projection,
        width: RayWidth,
        j: impl Fn(DVec3) -> f32,
    ) -> CloudSample {
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
        let nearest = |light: &Light| match light {
            Light::Point { position, .. } => width.nearest((*position - ray.origin).dot(ray.direction).abs()),
            Light::Beam { .. } => 0.0,
        };
        let all = |at: f64| -> f64 {
            let point = origin + ray.direction * at;
            let exact = self.exact.iter();
            exact.map(|light| self.direct(&tracer, *light, point, towards, nearest(light))).sum::<f64>()
                + f64::from(j(point))
        };
        let (mut radiance, mut open, mut at) = (0.0f64, 1.0f64, start);
        tracer.walk(origin, ray.direction, start, stop, |_, length, extinction| {
            let (extinction, end) = (f64::from(extinction), at + f64::from(length));
            while extinction > 0.0 && at < end && open > OPAQUE {
                let step = self.step(origin + ray.direction * at, extinction, nearest).min(end - at);
                let (gone, through) = shares(step, extinction);
                let weights = GAUSS.map(|place| f64::from(exp_neg((extinction * step * place) as f32)));
                let sum: f64 = GAUSS.iter().zip(weights).map(|(place, w)| w * all(at + place * step)).sum();
                radiance += open * cloud.albedo * gone * sum / (weights[0] + weights[1]);
                open *= through;
                // A last step lost in round-off must not repeat for ever.
                at = if step < 1e-9 * (end - start) { end } else { at + step };
            }
            at = end;
            open > OPAQUE
        });
        CloudSample { radiance, transmittance: open }
    }

    /// Longest step from `point` that sees J and every exact light evenly.
    fn step(&self, point: DVec3, extinction: f64, nearest: impl Fn(&Light) -> f64) -> f64 {
        let mut step = self.longest_step.min(STEP_DEPTH / extinction);
        for light in self.exact {
            if let Light::Point { position, .. } = light {
                step = step.min(STEP_PER_DISTANCE * point.distance(*position).max(nearest(light)));
            }
        }
        step
    }

    /// J of one light's direct part at a point: light never scattered, and light scattered forward only, whose next
    /// scattering spreads by the phase function's convolution with itself. Distances below `nearest` count as that.
    fn direct(&self, tracer: &Tracer<'_>, light: Light, point: DVec3, towards: DVec3, nearest: f64) -> f64 {
        let cloud = self.cloud;
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
        let depth = tracer.optical_depth(from, point);
        let open = f64::from(exp_neg(depth));
        let scaled = f64::from(exp_neg(depth * self.extinction_scale as f32));
        let (g, cos) = (cloud.g, travel.dot(towards));
        flux * (open * henyey_greenstein(g, cos) + (scaled - open) * henyey_greenstein(g * g, cos))
    }
}

/// Shares of light that a chord takes out and lets through.
fn shares(length: f64, extinction: f64) -> (f64, f64) {
    let depth = extinction * length;
    if depth < 0.02 {
        // The difference from 1 would lose its digits.
        let gone = depth * (1.0 - depth * (0.5 - depth / 6.0));
        return (gone, 1.0 - gone);
    }
    let through = f64::from(exp_neg(depth as f32));
    (1.0 - through, through)
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
