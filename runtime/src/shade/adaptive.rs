//! Pictures of light that is smooth in most places: worked out at nodes some pixels apart, interpolated where the four nodes around a
//! pixel show nearly the same, and worked out in every other pixel.

use crate::parallel::prelude::*;

/// Rows that one task fills.
const ROWS: usize = 32;

/// How far nodes are apart, and when pixels between them are interpolated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spacing {
    /// Pixels from one node to the next, 1 to 32; with 1 every pixel is worked out.
    pub pixels: u32,
    /// How much light may differ between the nodes around a pixel that is interpolated, as a share of the brightest, in any colour.
    pub tolerance: f32,
}

/// Light of a pixel, by column and row.
pub type LightOf<'a> = dyn Fn(usize, usize) -> [f32; 3] + Sync + 'a;
/// Whether a pixel is asked for, by column and row.
pub type AskedOf<'a> = dyn Fn(usize, usize) -> bool + Sync + 'a;

/// Fills a picture of `size` with `light` of columns and rows, where `is_asked`; other pixels stay as they are. The light is asked for
/// beyond the right and the lower edge too.
///
/// Panics when `pixels` is shorter than the picture.
pub fn fill(
    [width, height]: [usize; 2],
    spacing: Spacing,
    (light, is_asked): (&LightOf<'_>, &AskedOf<'_>),
    pixels: &mut [[f32; 3]],
) {
    let step = spacing.pixels.clamp(1, ROWS as u32) as usize;
    let strip = |(number, rows): (usize, &mut [[f32; 3]])| {
        let from = number * ROWS;
        let across = width.div_ceil(step) + 1;
        let down = (rows.len() / width).div_ceil(step) + 1;
        let node = |at: usize| {
            let (x, y) = (at % across * step, from + at / across * step);
            let near = |at: usize, end: usize| (at + 1).saturating_sub(step)..(at + step).min(end);
            let asked = near(y, height).any(|y| near(x, width).any(|x| is_asked(x, y)));
            asked.then(|| light(x, y))
        };
        let nodes: Vec<Option<[f32; 3]>> = (0..across * down).map(node).collect();
        for (at, pixel) in rows.iter_mut().enumerate() {
            let (x, y) = (at % width, at / width);
            if !is_asked(x, from + y) {
                continue;
            }
            let corner = |dx: usize, dy: usize| nodes[(y / step + dy) * across + x / step + dx];
            let (u, v) = ((x % step) as f32 / step as f32, (y % step) as f32 / step as f32);
            *pixel = match (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)) {
                (Some(a), ..) if u == 0.0 && v == 0.0 => a,
                (Some(a), Some(b), Some(c), Some(d)) if alike(&[a, b, c, d], spacing.tolerance) => {
                    std::array::from_fn(|band| {
                        let top = a[band] + u * (b[band] - a[band]);
                        let bottom = c[band] + u * (d[band] - c[band]);
                        top + v * (bottom - top)
                    })
                }
                _ => light(x, from + y),
            };
        }
    };
    pixels[..width * height].par_chunks_mut(width * ROWS).enumerate().for_each(strip);
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
    use crate::camera::{Camera, Projection};
    use glam::DVec3;
    use squall_formats::units::Radians;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn smooth_skies_are_interpolated_within_the_tolerance_and_edges_are_followed() {
        let projection = Projection::Perspective { vertical_fov: Radians(0.8) };
        let camera = Camera::new(DVec3::ZERO, DVec3::Y, DVec3::Z, projection, [67, 45]).unwrap();
        let rays = AtomicUsize::new(0);
        // A gradient, and a disc four times as bright.
        let beyond = |x: usize, y: usize| {
            rays.fetch_add(1, Ordering::Relaxed);
            let direction = camera.ray(x as f64 + 0.5, y as f64 + 0.5).direction;
            let [x, z] = [direction.x, direction.z].map(|v| v as f32);
            let disc = if x * x + z * z < 0.02 { 4.0 } else { 1.0 };
            [disc * (1.0 + 0.5 * z), disc * (1.0 + 0.3 * x), disc]
        };
        let filled = |spacing| {
            let mut pixels = vec![[-1.0; 3]; 67 * 45];
            rays.store(0, Ordering::Relaxed);
            fill([67, 45], spacing, (&beyond, &|x, _| x != 5), &mut pixels);
            (pixels, rays.load(Ordering::Relaxed))
        };
        let (exact, all) = filled(Spacing { pixels: 1, tolerance: 0.0 });
        for (pixels, tolerance) in [(2, 0.02), (4, 0.1)] {
            let (found, asked) = filled(Spacing { pixels, tolerance });
            assert!(asked < all * 2 / 3, "{asked} of {all}");
            for (at, (found, exact)) in found.iter().zip(&exact).enumerate() {
                assert_eq!(found[0] == -1.0, at % 67 == 5, "what is hidden stays as it is");
                let off = (0..3).map(|band| (found[band] - exact[band]).abs() / exact[band].abs());
                assert!(off.fold(0.0, f32::max) <= tolerance, "{at}: {found:?} {exact:?}");
            }
        }
    }
}
