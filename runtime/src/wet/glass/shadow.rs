//! Shadows of drops on a pane, and the light that they gather: what a lamp throws through wet glass, \[toyshop\] §5.
//!
//! The paper takes a drop's mass for a shadow and, above a threshold, puts a highlight into the shadow's middle: [`Glass::paper_shadow`]. Here light goes where water
//! sends it: each small piece of the pane bends its light by (n − 1) times the slope of the water on it, towards where that is thicker, lets through what Fresnel leaves, and
//! lands on a screen at a distance behind. Where drops focus is bright, where they took light from is dark, and nothing is gained: the sum
//! over a screen is what came through. A pane whose water is even is the identity, to the bit.

use super::{Glass, NANOGRAMS_PER_M3};
use crate::error::RuntimeError;
use crate::wet::material::{WATER_INDEX, fresnel};
use crate::wet::slopes::sobel;

/// Values per cell of a pane's screen at most.
const PER_CELL_MOST: usize = 8;

impl Glass {
    /// Light on a screen behind the pane over that behind a dry one, for parallel light along the pane's normal: `per_cell` × `per_cell` values a cell, x fastest.
    /// Light that leaves the screen is lost to it.
    ///
    /// # Errors
    ///
    /// `per_cell` outside 1 to 8, not a value for each, or a distance outside 0 to 100 m.
    pub fn screen(&self, per_cell: usize, distance_m: f64, out: &mut [f32]) -> Result<(), RuntimeError> {
        self.screens(per_cell, &[distance_m], &mut [out])
    }

    /// The same at several distances.
    pub(super) fn screens(
        &self,
        per_cell: usize,
        distances_m: &[f64],
        outs: &mut [&mut [f32]],
    ) -> Result<(), RuntimeError> {
        let per_m = per_cell as f64 / self.settings().spacing_m;
        let mut reaches = Vec::with_capacity(outs.len());
        for (distance_m, out) in distances_m.iter().zip(outs.iter_mut()) {
            self.fine(per_cell, out)?;
            if !(0.0..=100.0).contains(distance_m) {
                return Err(RuntimeError::argument("distance_m", "0 to 100", distance_m));
            }
            out.fill(0.0);
            reaches.push(((WATER_INDEX - 1.0) * distance_m * per_m) as f32);
        }
        let [width, height] = self.settings().cells.map(|cells| cells * per_cell);
        let mut heights = vec![0.0; width * height];
        self.heights(per_cell, &mut heights)?;
        let heights = super::see::with_margin([width, height], &heights);
        let straight = 1.0 - fresnel(1.0, WATER_INDEX) as f32;
        for y in 0..height {
            let rows = [0, 1, 2].map(|k| &heights[(y + k) * (width + 2)..][..width + 2]);
            for x in 0..width {
                let slope = sobel(rows, x, per_m as f32);
                if slope == [0.0; 2] {
                    outs.iter_mut().for_each(|out| out[y * width + x] += 1.0);
                    continue;
                }
                let steep = libm::sqrtf(1.0 + slope[0] * slope[0] + slope[1] * slope[1]);
                let through = (1.0 - fresnel(f64::from(1.0 / steep), WATER_INDEX) as f32) / straight;
                for (reach, out) in reaches.iter().zip(outs.iter_mut()) {
                    let bend = reach / steep;
                    land(
                        [x as f32 + bend * slope[0], y as f32 + bend * slope[1]],
                        through,
                        [width, height],
                        out,
                    );
                }
            }
        }
        Ok(())
    }

    /// The paper's shadow, \[toyshop\] §5: light falls as `darkness` times the mass of a cell over `threshold_ng`, at most to 1 − `darkness`, and a cell that holds more than
    /// the threshold has `highlight` of light put into the middle of its shadow. Sizes as for [`Self::screen`]. No distance is in it, and light is made.
    ///
    /// # Errors
    ///
    /// `per_cell` outside 1 to 8, not a value for each, a darkness or highlight that is no number of 0 or more.
    pub fn paper_shadow(
        &self,
        per_cell: usize,
        threshold_ng: u32,
        [darkness, highlight]: [f32; 2],
        out: &mut [f32],
    ) -> Result<(), RuntimeError> {
        let [width, _] = self.fine(per_cell, out)?;
        if !(0.0..=1.0).contains(&darkness) || !(0.0..=1e6).contains(&highlight) {
            let found = format!("{darkness}, {highlight}");
            return Err(RuntimeError::argument("darkness, highlight", "0 to 1, 0 to 1e6", found));
        }
        let mut heights = vec![0.0; out.len()];
        self.heights(per_cell, &mut heights)?;
        let threshold = f64::from(threshold_ng.max(1)) / NANOGRAMS_PER_M3;
        let radius = libm::cbrt(1.5 / std::f64::consts::PI * threshold) as f32;
        for (value, height) in out.iter_mut().zip(&heights) {
            *value = 1.0 - darkness * (height / radius).min(1.0);
        }
        let columns = self.settings().cells[0];
        for (cell, &mass) in self.cells.mass.iter().enumerate().filter(|(_, mass)| **mass > threshold_ng) {
            let _ = mass;
            let middle = [cell % columns, cell / columns].map(|at| at * per_cell + per_cell / 2);
            if let Some(value) = out.get_mut(middle[1] * width + middle[0]) {
                *value += highlight;
            }
        }
        Ok(())
    }

    fn fine(&self, per_cell: usize, out: &[f32]) -> Result<[usize; 2], RuntimeError> {
        if !(1..=PER_CELL_MOST).contains(&per_cell) {
            return Err(RuntimeError::argument("per_cell", format!("1 to {PER_CELL_MOST}"), per_cell));
        }
        let [width, height] = self.settings().cells.map(|cells| cells * per_cell);
        if out.len() != width * height {
            return Err(RuntimeError::argument("out", format!("{width} x {height} values"), out.len()));
        }
        Ok([width, height])
    }
}

/// Shares light between the four values around a place.
fn land(at: [f32; 2], light: f32, [width, height]: [usize; 2], out: &mut [f32]) {
    let low = at.map(libm::floorf);
    let part = [at[0] - low[0], at[1] - low[1]];
    for corner in 0..4usize {
        let step = [corner & 1, corner >> 1];
        let weight = [0, 1].map(|k| if step[k] == 1 { part[k] } else { 1.0 - part[k] });
        let [x, y] = [0, 1].map(|k| low[k] + step[k] as f32);
        if x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32 {
            out[y as usize * width + x as usize] += light * weight[0] * weight[1];
        }
    }
}
