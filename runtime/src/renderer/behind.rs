//! Sky and cloud behind everything, pixel by pixel: followed at nodes some pixels apart, interpolated where the nodes around a pixel show
//! nearly the same, and followed in every other pixel. A clear sky is smooth; a cloud's billows are not.

use super::draw::Beyond;
use crate::camera::Camera;
use crate::parallel::prelude::*;

/// Rows that one task fills.
const ROWS: usize = 32;

/// How closely sky and cloud are looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkyQuality {
    /// Pixels from one node to the next, 1 to 32; with 1 every pixel is followed.
    pub spacing: u32,
    /// How much light may differ between the nodes around a pixel that is interpolated, as a share of the brightest, in any colour.
    pub tolerance: f32,
}

impl SkyQuality {
    /// A still picture's.
    pub const STILL: Self = Self { spacing: 2, tolerance: 0.02 };
    /// A preview's.
    pub const PREVIEW: Self = Self { spacing: 4, tolerance: 0.1 };
}

/// Fills `pixels` with what is `beyond`, where `is_open` says that anything of it shows; others stay as they are.
pub(super) fn fill(
    camera: &Camera,
    quality: SkyQuality,
    (beyond, is_open): (&Beyond<'_>, &(dyn Fn(usize, usize) -> bool + Sync)),
    pixels: &mut [[f32; 3]],
) {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let spacing = quality.spacing.clamp(1, ROWS as u32) as usize;
    let follow = |x: usize, y: usize| beyond(&camera.ray(x as f64 + 0.5, y as f64 + 0.5));
    let strip = |(number, rows): (usize, &mut [[f32; 3]])| {
        let from = number * ROWS;
        let across = width.div_ceil(spacing) + 1;
        let down = (rows.len() / width).div_ceil(spacing) + 1;
        // Nodes beyond the picture's right and lower edge are looked at like others.
        let node = |at: usize| {
            let (x, y) = (at % across * spacing, from + at / across * spacing);
            let near = |at: usize, end: usize| at.saturating_sub(spacing - 1)..(at + spacing).min(end);
            let asked = near(y, height).any(|y| near(x, width).any(|x| is_open(x, y)));
            asked.then(|| follow(x, y))
        };
        let nodes: Vec<Option<[f32; 3]>> = (0..across * down).map(node).collect();
        for (at, pixel) in rows.iter_mut().enumerate() {
            let (x, y) = (at % width, at / width);
            if !is_open(x, from + y) {
                continue;
            }
            let (column, row) = (x / spacing, y / spacing);
            let corner = |dx: usize, dy: usize| nodes[(row + dy) * across + column + dx];
            let (u, v) = ((x % spacing) as f32 / spacing as f32, (y % spacing) as f32 / spacing as f32);
            *pixel = match (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)) {
                (Some(a), ..) if u == 0.0 && v == 0.0 => a,
                (Some(a), Some(b), Some(c), Some(d)) if alike(&[a, b, c, d], quality.tolerance) => {
                    std::array::from_fn(|band| {
                        let (top, bottom) =
                            (a[band] + u * (b[band] - a[band]), c[band] + u * (d[band] - c[band]));
                        top + v * (bottom - top)
                    })
                }
                _ => follow(x, from + y),
            };
        }
    };
    pixels.par_chunks_mut(width * ROWS).enumerate().for_each(strip);
}

/// Whether lights differ by `tolerance` of the brightest at most, in every colour.
fn alike(lights: &[[f32; 3]; 4], tolerance: f32) -> bool {
    (0..3).all(|band| {
        let values = lights.map(|light| light[band]);
        let (low, high) = values.iter().fold((f32::INFINITY, 0.0f32), |(l, h), &v| (l.min(v), h.max(v)));
        high - low <= tolerance * high
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Projection, Ray};
    use glam::DVec3;
    use squall_formats::units::Radians;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn smooth_skies_are_interpolated_within_the_tolerance_and_edges_are_followed() {
        let projection = Projection::Perspective { vertical_fov: Radians(0.8) };
        let camera = Camera::new(DVec3::ZERO, DVec3::Y, DVec3::Z, projection, [67, 45]).unwrap();
        let rays = AtomicUsize::new(0);
        // A gradient, and a disc four times as bright.
        let beyond = |ray: &Ray| {
            rays.fetch_add(1, Ordering::Relaxed);
            let [x, z] = [ray.direction.x, ray.direction.z].map(|v| v as f32);
            let disc = if x * x + z * z < 0.02 { 4.0 } else { 1.0 };
            [disc * (1.0 + 0.5 * z), disc * (1.0 + 0.3 * x), disc]
        };
        let filled = |quality| {
            let mut pixels = vec![[-1.0; 3]; 67 * 45];
            rays.store(0, Ordering::Relaxed);
            fill(&camera, quality, (&beyond, &|x, _| x != 5), &mut pixels);
            (pixels, rays.load(Ordering::Relaxed))
        };
        let (exact, all) = filled(SkyQuality { spacing: 1, tolerance: 0.0 });
        for quality in [SkyQuality::STILL, SkyQuality::PREVIEW] {
            let (found, asked) = filled(quality);
            assert!(asked < all * 2 / 3, "{asked} of {all}");
            for (at, (found, exact)) in found.iter().zip(&exact).enumerate() {
                assert_eq!(found[0] == -1.0, at % 67 == 5, "what is hidden stays as it is");
                let off = (0..3).map(|band| (found[band] - exact[band]).abs() / exact[band].abs());
                assert!(off.fold(0.0, f32::max) <= quality.tolerance, "{at}: {found:?} {exact:?}");
            }
        }
    }
}
