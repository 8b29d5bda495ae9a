//! Pictures of a solved cloud: radiance along every pixel's ray, of scattered light alone.
//!
//! Where rays go depends on the grid, the camera and the lamps' places, never on the light: pictures add up as their light does.

use super::{Truth, dot, scattering_weights};
use crate::error::BakeError;
use crate::progress::Progress;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use squall_formats::sphere::MAX_HARMONICS;
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::shade::cloud::direct::ExactDirect;
use squall_runtime::shade::cloud::{Cells, CloudMarch, MarchQuality, RayWidth, WideRay, between, corners};
use squall_runtime::transport::Cloud;
use squall_runtime::transport::direct::Light;

/// Rays across a cell of the grid: density jumps from cell to cell, and pixels that see none of the jumps need few.
const RAYS_PER_CELL: f64 = 16.0;
/// Fewest and most rays per pixel and axis.
const PER_EDGE: [f64; 2] = [2.0, 16.0];
/// Fewest rays per axis of a part of a pixel.
const PER_PART: usize = 3;
/// Halvings of a pixel at most beside a lamp, where radiance goes as 1 / distance.
const DEEPEST: u32 = 7;

/// Radiance per pixel, W/(m² sr), row 0 = top, mean over the pixel.
///
/// Errors: an interruption.
pub fn solve_image(truth: &Truth, camera: &Camera, progress: &dyn Progress) -> Result<Vec<f32>, BakeError> {
    let exact = [truth.light];
    // Extinction is that of the scene's own cells, which are fewer to pass than the solve grid's.
    let (cloud, extinction_scale) = (&truth.cloud, truth.extinction_scale);
    let longest_step = shortest(truth.fine.cell_m);
    let march = CloudMarch::new(cloud, Cells, MarchQuality::measured(longest_step))
        .with_exact(ExactDirect { lights: &exact, extinction_scale });
    let sampling = Sampling::new(camera, cloud, &exact);
    match camera.projection {
        Projection::Orthographic { .. } => {
            let weights = scattering_weights(cloud.g, -camera.forward);
            let j: Vec<f32> = truth.moments.iter().map(|row| dot(row, &weights)).collect();
            sampling.picture(progress, |x, y, width| {
                let ray = WideRay::new(camera.ray(x, y), camera.projection, width);
                march.march(&ray, |point| f64::from(between(&truth.fine, &j, point))).radiance
            })
        }
        // Towards an eye nearby, or inside the cloud, light in one cell goes many ways: each ray takes its own.
        Projection::Perspective { .. } => sampling.picture(progress, |x, y, width| {
            let ray = camera.ray(x, y);
            let weights = scattering_weights(cloud.g, -ray.direction);
            let j = |point: DVec3| -> f64 {
                let mut row = [0.0f32; MAX_HARMONICS];
                for (cell, weight) in corners(&truth.fine, point) {
                    for (sum, value) in row.iter_mut().zip(&truth.moments[cell]) {
                        *sum += weight * value;
                    }
                }
                f64::from(dot(&row, &weights))
            };
            march.march(&WideRay::new(ray, camera.projection, width), j).radiance
        }),
    }
}

/// Shortest edge of a cell, m.
pub fn shortest(cell_m: [f64; 3]) -> f64 {
    cell_m.into_iter().fold(f64::INFINITY, f64::min)
}

/// Where the rays of a picture go.
pub struct Sampling<'a> {
    camera: &'a Camera,
    /// Rays per pixel and axis.
    per_edge: usize,
    /// Where lamps are in the picture, pixels.
    lights: Vec<DVec2>,
}

impl<'a> Sampling<'a> {
    /// For a picture of `cloud` in which `lights` are followed exactly.
    pub fn new(camera: &'a Camera, cloud: &Cloud, lights: &[Light]) -> Self {
        let pixel = match camera.projection {
            Projection::Orthographic { .. } => 1.0 / camera.pixels_per_metre(),
            Projection::Perspective { .. } => {
                let nearest = camera.position.clamp(cloud.origin_m, cloud.far_corner());
                nearest.distance(camera.position) / camera.pixels_per_metre()
            }
        };
        let cell = shortest(cloud.cell_m);
        let [fewest, most] = PER_EDGE;
        let per_edge = (RAYS_PER_CELL * pixel / cell).ceil().clamp(fewest, most) as usize;
        let place = |light: &Light| match light {
            Light::Point { position, .. } => camera.project(*position).map(|at| at.pixel),
            Light::Beam { .. } => None,
        };
        Self { camera, per_edge, lights: lights.iter().filter_map(place).collect() }
    }

    /// Means over pixels of `radiance(x, y, width)`, the radiance at a place of the picture for a ray of that width. Rows run in
    /// parallel.
    ///
    /// Errors: an interruption.
    pub fn picture(
        &self,
        progress: &dyn Progress,
        radiance: impl Fn(f64, f64, RayWidth) -> f64 + Sync,
    ) -> Result<Vec<f32>, BakeError> {
        let (columns, rows) = (self.camera.width as usize, self.camera.height as usize);
        let rows: Vec<Vec<f32>> = (0..rows)
            .into_par_iter()
            .map(|y| {
                progress.check()?;
                let pixel = |x: usize| {
                    let corner = DVec2::new(x as f64, y as f64);
                    self.mean(corner, 0, &radiance) as f32
                };
                let row = (0..columns).map(pixel).collect();
                progress.advance(1);
                Ok(row)
            })
            .collect::<Result<_, BakeError>>()?;
        Ok(rows.concat())
    }

    /// Mean over a square of 2^−depth pixels an edge; what is near a lamp, for its size, is halved and halved again.
    fn mean(&self, corner: DVec2, depth: u32, radiance: &impl Fn(f64, f64, RayWidth) -> f64) -> f64 {
        let edge = 1.0 / f64::from(1u32 << depth);
        let away = |light: &DVec2| (corner - *light).max(*light - corner - edge).max_element();
        if depth < DEEPEST && self.lights.iter().any(|light| away(light) < 0.5 * edge) {
            let quarter = |at: usize| corner + 0.5 * edge * DVec2::new((at % 2) as f64, (at / 2) as f64);
            return 0.25 * (0..4).map(|at| self.mean(quarter(at), depth + 1, radiance)).sum::<f64>();
        }
        let per_edge = if depth == 0 { self.per_edge } else { PER_PART.max(self.per_edge >> depth) };
        let width = RayWidth::of(self.camera, edge / per_edge as f64);
        let count = per_edge * per_edge;
        let ray = |ray: usize| {
            let place = corner + edge * lattice(ray, count);
            radiance(place.x, place.y, width)
        };
        (0..count).map(ray).sum::<f64>() / count as f64
    }
}

/// Point `index` of `count` in the unit square, on a golden-section lattice: seen along either axis no two points coincide, so
/// that an edge of the grid that runs along the picture's is met as exactly as `count` points allow, not as its root.
fn lattice(index: usize, count: usize) -> DVec2 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let along = index as f64 + 0.5;
    DVec2::new(along / count as f64, (along * GOLDEN).fract())
}
