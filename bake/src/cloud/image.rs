//! Pictures of a solved cloud: radiance along every pixel's ray, of scattered light alone.

use super::{Truth, scattering_weights};
use crate::error::BakeError;
use crate::progress::Progress;
use glam::DVec3;
use rayon::prelude::*;
use squall_formats::sphere::MAX_HARMONICS;
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::shade::cloud::{LitCloud, RayWidth, between, corners};

/// Share of a pixel's value by which its centre may differ from the mean of its four quarters, weighed by its area, before the
/// quarters are looked at alike.
const ROUGHNESS: f64 = 0.01;
/// Halvings of a pixel at most: a lamp in the picture may cover a 64th of its edge.
const DEEPEST: u32 = 6;

/// Radiance per pixel, W/(m² sr), row 0 = top, mean over the pixel: five rays where it is even, more where it is not.
///
/// Errors: an interruption.
pub fn solve_image(truth: &Truth, camera: &Camera, progress: &dyn Progress) -> Result<Vec<f32>, BakeError> {
    let exact = [truth.light];
    let lit = |j| LitCloud { cloud: &truth.fine, j, exact: &exact, extinction_scale: truth.extinction_scale };
    match camera.projection {
        Projection::Orthographic { .. } => {
            let weights = scattering_weights(truth.fine.g, -camera.forward);
            let j: Vec<f32> = truth.moments.iter().map(|row| super::dot(row, &weights)).collect();
            let lit = lit(&j);
            picture(camera, progress, |x, y, share| {
                let width = RayWidth::of(camera, share);
                let j = |point| between(&truth.fine, &j, point);
                lit.march(camera.ray(x, y), camera.projection, width, j).radiance
            })
        }
        // Towards an eye nearby, or inside the cloud, light in one cell goes many ways: each ray takes its own.
        Projection::Perspective { .. } => {
            let lit = lit(&[]);
            picture(camera, progress, |x, y, share| {
                let ray = camera.ray(x, y);
                let weights = scattering_weights(truth.fine.g, -ray.direction);
                let j = |point: DVec3| -> f32 {
                    let mut row = [0.0f32; MAX_HARMONICS];
                    for (cell, weight) in corners(&truth.fine, point) {
                        for (sum, value) in row.iter_mut().zip(&truth.moments[cell]) {
                            *sum += weight * value;
                        }
                    }
                    super::dot(&row, &weights)
                };
                lit.march(ray, camera.projection, RayWidth::of(camera, share), j).radiance
            })
        }
    }
}

/// Means over pixels of `look(x, y, share)`, the radiance at a place of the picture for a ray that stands for a square of
/// `share` pixels an edge. Rows run in parallel.
///
/// Errors: an interruption.
pub fn picture(
    camera: &Camera,
    progress: &dyn Progress,
    look: impl Fn(f64, f64, f64) -> f64 + Sync,
) -> Result<Vec<f32>, BakeError> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let rows: Vec<Vec<f32>> = (0..height)
        .into_par_iter()
        .map(|y| {
            progress.check()?;
            let row = (0..width).map(|x| {
                let (x, y) = (x as f64 + 0.5, y as f64 + 0.5);
                let centre = look(x, y, 1.0);
                mean(&look, Square { x, y, share: 1.0, value: centre }, None, 0) as f32
            });
            let row = row.collect();
            progress.advance(1);
            Ok(row)
        })
        .collect::<Result<_, BakeError>>()?;
    Ok(rows.concat())
}

/// A part of a pixel: centre and edge in pixels, and the radiance at its centre.
#[derive(Clone, Copy)]
struct Square {
    x: f64,
    y: f64,
    share: f64,
    value: f64,
}

/// Mean over a square whose pixel comes to about `pixel`, if that is known yet.
fn mean(look: &impl Fn(f64, f64, f64) -> f64, square: Square, pixel: Option<f64>, depth: u32) -> f64 {
    let Square { x, y, share, value } = square;
    let (half, shift) = (0.5 * share, 0.25 * share);
    let quarters = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].map(|(right, down)| {
        let (x, y) = (x + right * shift, y + down * shift);
        Square { x, y, share: half, value: look(x, y, half) }
    });
    let finer = 0.25 * quarters.iter().map(|quarter| quarter.value).sum::<f64>();
    let pixel = pixel.unwrap_or(finer);
    let area = share * share;
    let even = (finer - value).abs() * area <= ROUGHNESS * pixel.abs().max(finer.abs() * area);
    if even || depth == DEEPEST {
        return finer;
    }
    0.25 * quarters.iter().map(|quarter| mean(look, *quarter, Some(pixel), depth + 1)).sum::<f64>()
}
