//! Pictures of a solved cloud: radiance along every pixel's ray, of scattered light alone.

use super::{Truth, scattering_weights};
use rayon::prelude::*;
use squall_runtime::camera::Camera;
use squall_runtime::shade::cloud::{LitCloud, direction_to};

/// Rays per pixel along each axis.
const SUBPIXELS: usize = 2;

/// Radiance per pixel, W/(m² sr), row 0 = top; the mean over the pixel of four rays.
pub fn solve_image(truth: &Truth, camera: &Camera) -> Vec<f32> {
    let scattered: Vec<f32> = (0..truth.moments.len())
        .into_par_iter()
        .map(|cell| {
            let towards = direction_to(camera, truth.fine.centre(truth.fine.shape.cell(cell)));
            let weights = scattering_weights(truth.fine.g, towards);
            truth.moments[cell].iter().zip(&weights).map(|(a, b)| a * b).sum()
        })
        .collect();
    let lit = LitCloud {
        cloud: &truth.fine,
        j: &scattered,
        exact: &[truth.light],
        extinction_scale: truth.extinction_scale,
    };
    picture(&lit, camera)
}

/// Renders a lit cloud alone.
pub fn picture(lit: &LitCloud<'_>, camera: &Camera) -> Vec<f32> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    (0..width * height)
        .into_par_iter()
        .map(|pixel| {
            let (x, y) = (pixel % width, pixel / width);
            let part = |k: usize| (k as f64 + 0.5) / SUBPIXELS as f64;
            let mut sum = 0.0;
            for sub in 0..SUBPIXELS * SUBPIXELS {
                let ray = camera.ray(x as f64 + part(sub % SUBPIXELS), y as f64 + part(sub / SUBPIXELS));
                sum += lit.look(ray, camera.projection).radiance;
            }
            (sum / (SUBPIXELS * SUBPIXELS) as f64) as f32
        })
        .collect()
}
