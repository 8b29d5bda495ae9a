//! Noise of few paths, smoothed along surfaces \[dammertz\]: neighbours count by how nearly they lie in the same plane and look the same way.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use squall_runtime::Camera;
use squall_runtime::wet::frame::GBuffer;

/// Passes, each twice as wide as the one before.
const PASSES: u32 = 5;
/// Weights of the five taps along a side.
const TAPS: [f32; 5] = [1.0 / 16.0, 0.25, 0.375, 0.25, 1.0 / 16.0];

/// Irradiance without most of its noise.
pub(super) fn smoothed(buffer: &GBuffer, camera: &Camera, mut light: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
    let [width, height] = buffer.size;
    let places: Vec<Option<(DVec3, Vec3)>> = (0..width * height)
        .map(|pixel| {
            let place = buffer.place(camera, pixel % width, pixel / width)?;
            Some((place, buffer.unit_normal(pixel)?))
        })
        .collect();
    for pass in 0..PASSES {
        let step = 1isize << pass;
        let next = (0..width * height).into_par_iter().map(|pixel| {
            let Some((place, normal)) = places[pixel] else { return light[pixel] };
            let (x, y) = ((pixel % width) as isize, (pixel / width) as isize);
            let mut sum = [0.0f32; 3];
            let mut whole = 0.0f32;
            let reach = 0.004 * (place - camera.position).length() + 0.01;
            for (dy, row) in (-2..=2).zip(TAPS) {
                for (dx, column) in (-2..=2).zip(TAPS) {
                    let (x, y) = (x + dx * step, y + dy * step);
                    if x < 0 || y < 0 || x >= width as isize || y >= height as isize {
                        continue;
                    }
                    let other = y as usize * width + x as usize;
                    let Some((there, looks)) = places[other] else { continue };
                    let off = ((there - place).dot(normal.as_dvec3()) / reach) as f32;
                    let alike = normal.dot(looks).max(0.0);
                    let alike = alike * alike * alike * alike;
                    let weight = row * column * alike * alike / (1.0 + off * off * off * off);
                    whole += weight;
                    for (sum, light) in sum.iter_mut().zip(light[other]) {
                        *sum += weight * light;
                    }
                }
            }
            if whole > 0.0 { sum.map(|sum| sum / whole) } else { light[pixel] }
        });
        light = next.collect();
    }
    light
}
