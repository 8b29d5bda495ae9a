//! Pictures of light that is smooth in most places: worked out at nodes some pixels apart, interpolated where the nodes around pixels tell
//! what is between them, and at nodes half as far apart where they don't, down to every pixel.

use crate::parallel::prelude::*;

/// Rows that one task fills.
const ROWS: usize = 32;
/// How many times the tolerance the corners of a wide tile may differ by, where its middle lies between them.
const SLOPE: f32 = 4.0;
/// Share of the tolerance by which the middle may lie beside the corners' mean.
const BEND: f32 = 0.25;
/// Tolerance from which on nodes two pixels apart tell whatever is between them: a preview.
const COARSE: f32 = 0.1;
/// Tiles from this many pixels on have the middles of their sides looked at too.
const WIDE: usize = 8;

/// How far nodes are apart, and when pixels between them are interpolated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spacing {
    /// Pixels between nodes where light is smoothest, 1 to 32, rounded down to a power of two; with 1 every pixel is worked out.
    pub pixels: u32,
    /// How much light may differ between nodes two pixels apart that the pixel between them is interpolated from, as a share of the
    /// brightest, in any colour. Nodes farther apart may differ by four times that where what is worked out in their middle lies
    /// between them, within a fourth of it. From a tenth on nothing is worked out between nodes two pixels apart.
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
    let step = 1usize << spacing.pixels.clamp(1, ROWS as u32).ilog2();
    let strip = |(number, rows): (usize, &mut [[f32; 3]])| {
        let from = number * ROWS;
        let across = width.next_multiple_of(step) + 1;
        let down = (rows.len() / width).next_multiple_of(step) + 1;
        let light = |x: usize, y: usize| light(x, from + y);
        let is_asked = |x: usize, y: usize| is_asked(x, from + y);
        let nodes = Nodes { light: &light, across, known: vec![None; across * down] };
        let mut strip = Strip { width, tolerance: spacing.tolerance, is_asked: &is_asked, nodes, rows };
        for y in (0..down - 1).step_by(step) {
            (0..across - 1).step_by(step).for_each(|x| strip.tile([x, y], step));
        }
    };
    pixels[..width * height].par_chunks_mut(width * ROWS).enumerate().for_each(strip);
}

/// Light of pixels, each worked out once.
struct Nodes<'a> {
    light: &'a dyn Fn(usize, usize) -> [f32; 3],
    across: usize,
    known: Vec<Option<[f32; 3]>>,
}

impl Nodes<'_> {
    fn at(&mut self, x: usize, y: usize) -> [f32; 3] {
        *self.known[y * self.across + x].get_or_insert_with(|| (self.light)(x, y))
    }
}

/// Some rows of a picture.
struct Strip<'a> {
    width: usize,
    tolerance: f32,
    is_asked: &'a dyn Fn(usize, usize) -> bool,
    nodes: Nodes<'a>,
    rows: &'a mut [[f32; 3]],
}

impl Strip<'_> {
    /// Fills `size` × `size` pixels from (x, y) on.
    fn tile(&mut self, [x, y]: [usize; 2], size: usize) {
        let (right, bottom) = ((x + size).min(self.width), (y + size).min(self.rows.len() / self.width));
        if !(y..bottom).any(|y| (x..right).any(|x| (self.is_asked)(x, y))) {
            return;
        }
        if size == 1 {
            self.rows[y * self.width + x] = self.nodes.at(x, y);
            return;
        }
        let corners = [(x, y), (x + size, y), (x, y + size), (x + size, y + size)];
        let corners = corners.map(|(x, y)| self.nodes.at(x, y));
        if !self.tells(corners, [x, y], size) {
            let half = size / 2;
            for [dx, dy] in [[0, 0], [half, 0], [0, half], [half, half]] {
                self.tile([x + dx, y + dy], half);
            }
            return;
        }
        for py in y..bottom {
            for px in (x..right).filter(|&px| (self.is_asked)(px, py)) {
                let [u, v] = [px - x, py - y].map(|off| off as f32 / size as f32);
                self.rows[py * self.width + px] = between(&corners, u, v);
            }
        }
    }

    /// Whether the corners of a tile tell what is between them.
    fn tells(&mut self, corners: [[f32; 3]; 4], [x, y]: [usize; 2], size: usize) -> bool {
        if size == 2 {
            return self.tolerance >= COARSE || alike(&corners, self.tolerance);
        }
        let half = size / 2;
        let sides = [[half, half], [half, 0], [0, half], [size, half], [half, size]];
        let checks = if size < WIDE { &sides[..1] } else { &sides[..] };
        let bend = BEND * self.tolerance;
        alike(&corners, SLOPE * self.tolerance)
            && checks.iter().all(|&[dx, dy]| {
                let found = between(&corners, dx as f32 / size as f32, dy as f32 / size as f32);
                let wanted = self.nodes.at(x + dx, y + dy);
                (0..3).all(|band| (found[band] - wanted[band]).abs() <= bend * wanted[band].abs())
            })
    }
}

/// Light at a share of a tile's width and height.
fn between([a, b, c, d]: &[[f32; 3]; 4], u: f32, v: f32) -> [f32; 3] {
    std::array::from_fn(|band| {
        let top = a[band] + u * (b[band] - a[band]);
        let bottom = c[band] + u * (d[band] - c[band]);
        top + v * (bottom - top)
    })
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
        for (pixels, tolerance) in [(2, 0.02), (4, 0.09), (8, 0.02), (11, 0.02)] {
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
