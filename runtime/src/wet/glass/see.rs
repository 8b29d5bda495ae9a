//! What drops on a pane show.

use super::{Glass, NANOGRAMS_PER_M3};
use crate::error::RuntimeError;
use crate::wet::material::{WATER_INDEX, fresnel};
use crate::wet::slopes::sobel;
use glam::Vec3;
use std::f64::consts::PI;

/// A pane before a picture: what the renderer has drawn without drops, and what a mirror in the pane shows.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// Width and height of both pictures, which the pane covers from edge to edge.
    pub size: [usize; 2],
    /// Radiance behind the glass, row 0 on top.
    pub behind: &'a [Vec3],
    /// Radiance in front of it, mirrored in the pane.
    pub front: &'a [Vec3],
    /// Distance at which what is behind stands still, over the pane's height: a drop bends rays by (n − 1) times its slope, and they move by that
    /// times this distance. .2 shows what lies near the glass; drops show the world upside down from about 1 on.
    pub distance: f32,
}

impl Glass {
    /// Heights of the water over the glass, m, `per_cell` × `per_cell` values a cell, x fastest. A cell that holds more than a film shows a half ball of its own
    /// mass about its middle, moved down by what it has crossed; of overlapping ones the highest shows. Films lie between cells' middles.
    ///
    /// # Errors
    ///
    /// `per_cell` outside 1 to 8, or not a value for each.
    pub fn heights(&self, per_cell: usize, out: &mut [f32]) -> Result<(), RuntimeError> {
        if !(1..=8).contains(&per_cell) {
            return Err(RuntimeError::argument("per_cell", "1 to 8", per_cell));
        }
        let [width, height] = self.settings.cells.map(|cells| cells * per_cell);
        if out.len() != width * height {
            return Err(RuntimeError::argument("out", format!("{width} x {height} values"), out.len()));
        }
        let drops = self.lay_films(per_cell, out);
        let spacing = self.settings.spacing_m / per_cell as f64;
        for (cell, radius) in drops {
            let (x, y) = (cell % self.settings.cells[0], cell / self.settings.cells[0]);
            let down = f64::from(self.cells.crossed[cell]).min(1.0);
            let middle = [x as f64 + 0.5, y as f64 + 0.5 + down].map(|place| place * per_cell as f64);
            let reach = radius / spacing;
            let span = |middle: f64, most: usize| {
                libm::fmax(0.0, libm::floor(middle - reach)) as usize
                    ..(libm::ceil(middle + reach) as usize).min(most)
            };
            for row in span(middle[1], height) {
                for column in span(middle[0], width) {
                    let [dx, dy] = [column as f64 + 0.5 - middle[0], row as f64 + 0.5 - middle[1]];
                    let square = radius * radius - (dx * dx + dy * dy) * spacing * spacing;
                    let value = &mut out[row * width + column];
                    *value = value.max(libm::sqrt(square.max(0.0)) as f32);
                }
            }
        }
        Ok(())
    }

    /// Films, interpolated between the middles of cells; returns the cells that hold drops, and their half balls' radii, m.
    fn lay_films(&self, per_cell: usize, out: &mut [f32]) -> Vec<(usize, f64)> {
        let [width, height] = self.settings.cells;
        let area = self.settings.spacing_m * self.settings.spacing_m;
        let mut films = vec![0.0; width * height];
        let mut drops = Vec::new();
        for (cell, &mass) in self.cells.mass.iter().enumerate().filter(|&(_, &mass)| mass > 0) {
            let volume = f64::from(mass) / NANOGRAMS_PER_M3;
            let radius = libm::cbrt(1.5 / PI * volume);
            if radius < 0.5 * self.settings.spacing_m {
                films[cell] = (volume / area) as f32;
            } else {
                drops.push((cell, radius));
            }
        }
        // Where a fine value lies: the cell to its left or above, the next one, and the share of that.
        let between = |at: usize, cells: usize| {
            let place = ((at as f32 + 0.5) / per_cell as f32 - 0.5).max(0.0);
            (place as usize, (place as usize + 1).min(cells - 1), place.fract())
        };
        for (y, row) in out.chunks_exact_mut(width * per_cell).enumerate() {
            let (above, below, down) = between(y, height);
            for (x, value) in row.iter_mut().enumerate() {
                let (left, right, along) = between(x, width);
                let line = |y: usize| {
                    films[y * width + left] + along * (films[y * width + right] - films[y * width + left])
                };
                *value = line(above) + down * (line(below) - line(above));
            }
        }
        drops
    }

    /// The picture through the pane: each pixel shows the world behind where the water's slope bends its ray to, and by Fresnel's share the world in front. Where
    /// the glass is dry the picture behind is left as it is, bit by bit.
    ///
    /// # Errors
    ///
    /// Pictures that have not a pixel for each of `size`, sizes of 0, or a distance that is no number.
    pub fn refract(&self, seen: &Seen, out: &mut [Vec3]) -> Result<(), RuntimeError> {
        let [width, height] = seen.size;
        for (field, pixels) in
            [("behind", seen.behind.len()), ("front", seen.front.len()), ("out", out.len())]
        {
            if width.checked_mul(height) != Some(pixels) || pixels == 0 {
                return Err(RuntimeError::argument(
                    field,
                    format!("{width} x {height} pixels, above 0"),
                    pixels,
                ));
            }
        }
        if !seen.distance.is_finite() {
            return Err(RuntimeError::argument("distance", "a finite number", seen.distance));
        }
        let per_cell = height.div_ceil(self.settings.cells[1]).clamp(1, 4);
        let fine = self.settings.cells.map(|cells| cells * per_cell);
        let mut heights = vec![0.0; fine[0] * fine[1]];
        self.heights(per_cell, &mut heights)?;
        let heights = with_margin(fine, &heights);
        let per_spacing = (per_cell as f64 / self.settings.spacing_m) as f32;
        for (pixel, value) in out.iter_mut().enumerate() {
            let (x, y) = (pixel % width, pixel / width);
            let at = [(x * fine[0] + fine[0] / 2) / width, (y * fine[1] + fine[1] / 2) / height];
            let rows =
                [0, 1, 2].map(|k| &heights[(at[1].min(fine[1] - 1) + k) * (fine[0] + 2)..][..fine[0] + 2]);
            let slope = sobel(rows, at[0].min(fine[0] - 1), per_spacing);
            *value = if slope == [0.0; 2] { seen.behind[pixel] } else { seen.through([x, y], slope) };
        }
        Ok(())
    }
}

impl Seen<'_> {
    fn through(&self, [x, y]: [usize; 2], slope: [f32; 2]) -> Vec3 {
        let [width, height] = self.size;
        // Steep edges bend as far as light can be bent: the slope's sine, not its tangent, sets the angle.
        let steep = libm::sqrtf(1.0 + slope[0] * slope[0] + slope[1] * slope[1]);
        let bend = (WATER_INDEX as f32 - 1.0) * self.distance * height as f32 / steep;
        // Towards where the water is thicker, as a lens bends.
        let behind = self.behind_at(x as f32 + bend * slope[0], y as f32 + bend * slope[1]);
        let mirrored = fresnel(f64::from(1.0 / steep), WATER_INDEX) as f32;
        behind.lerp(self.front[y * width + x], mirrored)
    }

    /// The picture behind between the four pixels around a place; beyond its edges the edge's.
    fn behind_at(&self, x: f32, y: f32) -> Vec3 {
        let [width, height] = self.size;
        let (x, y) = (x.clamp(0.0, (width - 1) as f32), y.clamp(0.0, (height - 1) as f32));
        let (left, top) = (x as usize, y as usize);
        let (right, under) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let row = |y: usize| self.behind[y * width + left].lerp(self.behind[y * width + right], x.fract());
        row(top).lerp(row(under), y.fract())
    }
}

/// Heights with a margin of one value that repeats the edge.
pub(super) fn with_margin(size: [usize; 2], heights: &[f32]) -> Vec<f32> {
    let [width, height] = size;
    let at = |x: usize, y: usize| heights[y.min(height - 1) * width + x.min(width - 1)];
    let lines = 0..height + 2;
    lines.flat_map(|y| (0..width + 2).map(move |x| at(x.saturating_sub(1), y.saturating_sub(1)))).collect()
}
