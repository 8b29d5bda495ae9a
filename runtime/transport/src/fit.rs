//! Light that was solved in small cells, kept in large ones as what is read between their middles comes closest by least squares.
//!
//! Means of large cells are not what a trilinear reading between the middles should start from: beside a light they flatten it twice. Fitted
//! values bring the reading as near to the small cells as so many numbers can. They may lie below zero where light falls steeply; the mean of
//! the reading over a large cell ([`mean_of_reading`]) is what fluence is read from. Whoever reads light scatters or sees it: what a small
//! cell counts for is its extinction times the share of its light that gets out ([`weights`]).

use crate::cloud::{Boundary, Cloud};
use crate::direct::Tracer;
use crate::error::ArgumentError;
use crate::parallel::prelude::*;
use glam::DVec3;
use squall_formats::GridShape;
use squall_formats::sphere;
use squall_formats::view_region::ViewRegion;

/// What is added to every large cell's own share, over the mean of those: cells of which little is read keep near the mean of that.
const TOWARDS_MEAN: f32 = 3e-3;
/// Residual of the least squares, relative to that of the means.
const TOLERANCE: f64 = 1e-4;
/// Steps of conjugate gradients at most; some fifteen are usual.
const MOST_STEPS: usize = 100;
/// What a cell that no light gets out of counts for: gathers scatter on what it holds.
const UNSEEN: f32 = 0.1;
/// What an empty cell beside cloud counts for, over the mean of cells with cloud: rays read it at the cloud's edge.
const EMPTY: f32 = 0.02;

/// A small cell's place between the large cells' middles along one axis.
#[derive(Clone, Copy, Debug)]
struct Between {
    low: u32,
    high: u32,
    share: f32,
}

/// Small cells, the large cells that their light is kept in, and what each counts for.
#[derive(Clone, Debug)]
pub struct HatFit {
    coarse: GridShape,
    factors: [usize; 3],
    fine: GridShape,
    periodic: bool,
    axes: [Vec<Between>; 3],
    weights: Vec<f32>,
    /// The normal matrix, a row a large cell: its neighbours in the order of [`step`].
    normal: Vec<[f32; 27]>,
    /// Pull of every large cell towards the mean of what is read of it.
    pull: f32,
}

/// A box of large cells whose light is fitted alone: outside it there is none.
#[derive(Clone, Debug)]
pub struct FitWindow<'a> {
    fit: &'a HatFit,
    low: [usize; 3],
    shape: GridShape,
    /// Places of a large cell's neighbours in the box, [`NONE`] where there is none.
    neighbours: Vec<[u32; 27]>,
}

/// No neighbour.
const NONE: u32 = u32::MAX;

/// Offset of neighbour `number` along each axis.
fn step(number: usize) -> [i64; 3] {
    [number % 3, number / 3 % 3, number / 9].map(|at| at as i64 - 1)
}

impl HatFit {
    /// For small cells of `fine`, `factors` to a large cell along x, y and z, each of which counts for its `weights`.
    ///
    /// Errors: factors that do not divide the grid. Panics when `weights` is not one grid long.
    pub fn new(fine: &Cloud, factors: [u32; 3], weights: Vec<f32>) -> Result<Self, ArgumentError> {
        assert_eq!(weights.len(), fine.shape.len());
        let (counts, periodic) = (fine.shape.to_array(), fine.boundary == Boundary::PeriodicXy);
        let factors = factors.map(|factor| factor as usize);
        if (0..3).any(|axis| factors[axis] == 0 || !counts[axis].is_multiple_of(factors[axis])) {
            let wanted = format!("whole blocks of {counts:?} cells");
            return Err(ArgumentError::new("fit of light", wanted, format!("{factors:?}")));
        }
        let large = [0, 1, 2].map(|axis: usize| counts[axis] / factors[axis]);
        let axes = [0, 1, 2].map(|axis: usize| {
            let around = periodic && axis < 2;
            (0..counts[axis]).map(|at| between(at, factors[axis], large[axis], around)).collect()
        });
        let coarse = GridShape::new(large[0] as u32, large[1] as u32, large[2] as u32);
        let normal = vec![[0.0; 27]; coarse.len()];
        let mut fit = Self { coarse, factors, fine: fine.shape, periodic, axes, weights, normal, pull: 0.0 };
        fit.fill_normal();
        let read: Vec<f32> = fit.normal.iter().map(|row| row[13]).filter(|&own| own > 0.0).collect();
        fit.pull = TOWARDS_MEAN * read.iter().sum::<f32>() / read.len().max(1) as f32;
        Ok(fit)
    }

    fn fill_normal(&mut self) {
        let mut normal = std::mem::take(&mut self.normal);
        for (index, &weight) in self.weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0) {
            let corners = self.corners(index);
            for (a, &(cell, hat)) in corners.iter().enumerate() {
                let row = &mut normal[self.coarse.index(cell[0], cell[1], cell[2])];
                for (b, &(_, other)) in corners.iter().enumerate() {
                    let bit = |corner: usize, axis: usize| corner >> axis & 1;
                    let along = |axis: usize| 1 + bit(b, axis) - bit(a, axis);
                    row[along(0) + 3 * along(1) + 9 * along(2)] += weight * hat * other;
                }
            }
        }
        self.normal = normal;
    }

    /// The grid of large cells.
    pub fn coarse(&self) -> GridShape {
        self.coarse
    }

    /// What small cells count for.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// The large cells around a small one and their hats there.
    fn corners(&self, index: usize) -> [([usize; 3], f32); 8] {
        let cell = self.fine.cell(index);
        let at = [0, 1, 2].map(|axis: usize| self.axes[axis][cell[axis]]);
        std::array::from_fn(|corner| {
            let (mut place, mut hat) = ([0; 3], 1.0);
            for axis in 0..3 {
                let Between { low, high, share } = at[axis];
                let upper = corner >> axis & 1 == 1;
                place[axis] = if upper { high } else { low } as usize;
                hat *= if upper { share } else { 1.0 - share };
            }
            (place, hat)
        })
    }

    /// `width` interleaved values a large cell, read in the middles of the small ones that count; 0 in the others.
    pub fn read(&self, values: &[f32], width: usize) -> Vec<f32> {
        let mut out = vec![0.0f32; self.fine.len() * width];
        let cells = self.weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0);
        for (index, _) in cells {
            let to = &mut out[index * width..(index + 1) * width];
            for (cell, hat) in self.corners(index) {
                let from = self.coarse.index(cell[0], cell[1], cell[2]) * width;
                to.iter_mut().zip(&values[from..from + width]).for_each(|(sum, value)| *sum += hat * value);
            }
        }
        out
    }

    /// Fits `width` interleaved values a small cell over the whole grid.
    ///
    /// Panics when `values` is not one grid long.
    pub fn fit(&self, values: &[f32], width: usize) -> Vec<f32> {
        self.within([0; 3], self.coarse).fit(values, width)
    }

    /// A box of large cells: its first, and their number. Of grids that repeat the whole alone.
    #[must_use]
    pub fn within(&self, low: [usize; 3], shape: GridShape) -> FitWindow<'_> {
        let (size, around) = (shape.to_array(), self.periodic && shape == self.coarse);
        let neighbours = (0..shape.len()).map(|index| {
            let cell = shape.cell(index);
            std::array::from_fn(|number| {
                let (step, mut place) = (step(number), [0; 3]);
                for axis in 0..3 {
                    let (at, count) = (cell[axis] as i64 + step[axis], size[axis] as i64);
                    place[axis] = match (0..count).contains(&at) {
                        true => at as usize,
                        false if around && axis < 2 => at.rem_euclid(count) as usize,
                        false => return NONE,
                    };
                }
                shape.index(place[0], place[1], place[2]) as u32
            })
        });
        FitWindow { fit: self, low, shape, neighbours: neighbours.collect() }
    }
}

/// Where small cell `at` of `factor` to a large one lies between the middles of `count` of those.
fn between(at: usize, factor: usize, count: usize, around: bool) -> Between {
    let place = (at as f64 + 0.5) / factor as f64 - 0.5;
    if around {
        let floor = place.floor();
        let low = (floor as i64).rem_euclid(count as i64) as u32;
        return Between { low, high: (low + 1) % count as u32, share: (place - floor) as f32 };
    }
    let place = place.clamp(0.0, count as f64 - 1.0);
    let low = (place as usize).min(count.saturating_sub(2));
    Between { low: low as u32, high: (low + 1).min(count - 1) as u32, share: (place - low as f64) as f32 }
}

impl FitWindow<'_> {
    /// Fits `width` interleaved values a small cell of the box.
    ///
    /// Panics when `values` is not one box of small cells long.
    pub fn fit(&self, values: &[f32], width: usize) -> Vec<f32> {
        let (mut found, mut residual) = self.means_and_sums(values, width);
        // Where anything is read, the mean of that.
        for (index, (mean, sums)) in
            found.chunks_exact_mut(width).zip(residual.chunks_exact(width)).enumerate()
        {
            let row = self.row(index);
            if row[13] > 0.0 {
                let whole = row.iter().sum::<f32>();
                mean.iter_mut().zip(sums).for_each(|(mean, sum)| *mean = sum / whole);
            }
        }
        self.add_normal(&found, width, -1.0, &mut residual);
        self.solve(&mut found, residual, width);
        found
    }

    /// Means over large cells, and what the least squares ask for: sums of weights times hats times values.
    fn means_and_sums(&self, values: &[f32], width: usize) -> (Vec<f32>, Vec<f32>) {
        let fit = self.fit;
        let size = self.shape.to_array();
        let small = [0, 1, 2].map(|axis: usize| size[axis] * fit.factors[axis]);
        assert_eq!(values.len(), small.iter().product::<usize>() * width);
        let (mut means, mut sums) =
            (vec![0.0f32; self.shape.len() * width], vec![0.0f32; self.shape.len() * width]);
        let share = 1.0 / fit.factors.iter().product::<usize>() as f32;
        for (number, values) in values.chunks_exact(width).enumerate() {
            let at = [number % small[0], number / small[0] % small[1], number / small[0] / small[1]];
            let own = [0, 1, 2].map(|axis: usize| at[axis] / fit.factors[axis]);
            let mean = self.shape.index(own[0], own[1], own[2]) * width;
            means[mean..mean + width].iter_mut().zip(values).for_each(|(sum, value)| *sum += share * value);
            let [x, y, z] = [0, 1, 2].map(|axis: usize| at[axis] + self.low[axis] * fit.factors[axis]);
            let index = fit.fine.index(x, y, z);
            let weight = fit.weights[index];
            if weight <= 0.0 {
                continue;
            }
            for (cell, hat) in fit.corners(index) {
                let inside = [0, 1, 2].map(|axis: usize| cell[axis].wrapping_sub(self.low[axis]));
                if (0..3).any(|axis| inside[axis] >= size[axis]) {
                    continue;
                }
                let to = self.shape.index(inside[0], inside[1], inside[2]) * width;
                let sums = sums[to..to + width].iter_mut().zip(values);
                sums.for_each(|(sum, value)| *sum += weight * hat * value);
            }
        }
        (means, sums)
    }

    /// The normal matrix' row of a cell of the box.
    fn row(&self, index: usize) -> &[f32; 27] {
        let cell = self.shape.cell(index);
        let [x, y, z] = [0, 1, 2].map(|axis: usize| cell[axis] + self.low[axis]);
        &self.fit.normal[self.fit.coarse.index(x, y, z)]
    }

    /// Adds `sign` times the normal matrix times `values` to `sums`.
    fn add_normal(&self, values: &[f32], width: usize, sign: f32, sums: &mut [f32]) {
        for (index, (sums, neighbours)) in sums.chunks_exact_mut(width).zip(&self.neighbours).enumerate() {
            let row = self.row(index);
            if row[13] <= 0.0 {
                continue;
            }
            for (&factor, &near) in row.iter().zip(neighbours) {
                if near == NONE || factor == 0.0 {
                    continue;
                }
                let from = &values[near as usize * width..(near as usize + 1) * width];
                sums.iter_mut().zip(from).for_each(|(sum, value)| *sum += sign * factor * value);
            }
        }
    }

    /// Conjugate gradients from `found` on, each of the `width` values by itself; `residual` is that of `found`.
    fn solve(&self, found: &mut [f32], mut residual: Vec<f32>, width: usize) {
        let diagonal: Vec<f32> = (0..self.shape.len()).map(|index| self.row(index)[13]).collect();
        let over = |residual: &[f32]| -> Vec<f32> {
            let cells = residual.chunks_exact(width).zip(&diagonal);
            cells
                .flat_map(|(row, &d)| {
                    let share = if d > 0.0 { 1.0 / (d + self.fit.pull) } else { 0.0 };
                    row.iter().map(move |value| share * value)
                })
                .collect()
        };
        let dots = |a: &[f32], b: &[f32]| -> Vec<f64> {
            let mut sums = vec![0.0f64; width];
            for (a, b) in a.chunks_exact(width).zip(b.chunks_exact(width)) {
                (0..width).for_each(|k| sums[k] += f64::from(a[k]) * f64::from(b[k]));
            }
            sums
        };
        let mut search = over(&residual);
        let mut size = dots(&residual, &search);
        let goal: Vec<f64> = size.iter().map(|size| size * TOLERANCE * TOLERANCE).collect();
        for _ in 0..MOST_STEPS {
            if size.iter().zip(&goal).all(|(size, goal)| size <= goal) {
                return;
            }
            let mut image = vec![0.0f32; found.len()];
            self.add_normal(&search, width, 1.0, &mut image);
            for ((image, search), &d) in
                image.chunks_exact_mut(width).zip(search.chunks_exact(width)).zip(&diagonal)
            {
                let pull = if d > 0.0 { self.fit.pull } else { 0.0 };
                image.iter_mut().zip(search).for_each(|(sum, value)| *sum += pull * value);
            }
            let bend = dots(&search, &image);
            let step: Vec<f32> = (0..width)
                .map(|k| if size[k] > goal[k] && bend[k] > 0.0 { (size[k] / bend[k]) as f32 } else { 0.0 })
                .collect();
            for at in 0..found.len() {
                found[at] += step[at % width] * search[at];
                residual[at] -= step[at % width] * image[at];
            }
            let newest = over(&residual);
            let newer = dots(&residual, &newest);
            let keep: Vec<f32> =
                (0..width).map(|k| if size[k] > 0.0 { (newer[k] / size[k]) as f32 } else { 0.0 }).collect();
            size = newer;
            for at in 0..search.len() {
                search[at] = newest[at] + keep[at % width] * search[at];
            }
        }
    }
}

/// What cells of `cloud` count for in a fit: extinction times the share of light that gets out of the middle, mean over the 26 directions, or
/// towards the middle and the corners of a view region; a tenth of the extinction beside it, since gathers scatter everywhere. Empty cells
/// beside cloud count a little, all others nothing.
#[must_use]
pub fn weights(cloud: &Cloud, view_region: Option<&ViewRegion>) -> Vec<f32> {
    let tracer = Tracer::new(cloud, 1.0);
    let reach = 2.0 * (cloud.far_corner() - cloud.origin_m).length();
    let cloudy = cloud.extinction.iter().filter(|&&extinction| extinction > 0.0).count().max(1);
    let empty = EMPTY * cloud.extinction.iter().sum::<f32>() / cloudy as f32;
    let views: Vec<DVec3> = match view_region {
        None => sphere::directions_26().map(DVec3::from_array).to_vec(),
        Some(region) => {
            let corner =
                |corner: usize| [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 });
            let corners = (0..8).map(corner).chain([[0.0; 3]]);
            corners.map(|at| DVec3::from_array(region.point(at))).collect()
        }
    };
    let seen = |middle: DVec3| -> f32 {
        let share = |&view: &DVec3| {
            let to = if view_region.is_some() { view } else { middle + reach * view };
            crate::math::exp_neg(tracer.optical_depth(middle, to))
        };
        views.iter().map(share).sum::<f32>() / views.len() as f32
    };
    let shaded = cloud.shaded();
    let mut out = vec![0.0f32; shaded.len()];
    /// Cells that one thread takes at a time.
    const AT_ONCE: usize = 1024;
    out.par_chunks_mut(AT_ONCE).enumerate().for_each(|(number, values)| {
        for (at, value) in values.iter_mut().enumerate() {
            let index = number * AT_ONCE + at;
            if shaded[index] {
                let middle = cloud.centre(cloud.shape.cell(index));
                *value = (cloud.extinction[index] + empty) * (seen(middle) + UNSEEN);
            }
        }
    });
    out
}

/// Means over large cells of what is read between their middles, of `width` interleaved values a cell fitted with `factors` small cells along
/// each axis.
///
/// Panics when `values` is not one grid long.
#[must_use]
pub fn mean_of_reading(cloud: &Cloud, factors: [u32; 3], values: &[f32], width: usize) -> Vec<f32> {
    let (counts, mut now) = (cloud.shape.to_array(), values.to_vec());
    assert_eq!(values.len(), cloud.shape.len() * width);
    let strides = [1, cloud.shape.row_stride(), cloud.shape.slab_stride()];
    for axis in 0..3 {
        // Mean over the small cells of one side of the neighbour's hat: Σ (½ − (i + ½)/K)/K for those below the middle.
        let k = f64::from(factors[axis]);
        let side = if factors[axis].is_multiple_of(2) { 0.125 } else { 0.125 * (1.0 - 1.0 / (k * k)) } as f32;
        let around = axis < 2 && cloud.boundary == Boundary::PeriodicXy;
        let mut next = vec![0.0f32; now.len()];
        for cell in 0..cloud.shape.len() {
            let at = cloud.shape.cell(cell)[axis];
            let (first, last) = (at == 0, at + 1 == counts[axis]);
            let wrap = strides[axis] * (counts[axis] - 1);
            let below = match first {
                false => cell - strides[axis],
                true if around => cell + wrap,
                true => cell,
            };
            let above = match last {
                false => cell + strides[axis],
                true if around => cell - wrap,
                true => cell,
            };
            for k in 0..width {
                let [own, below, above] = [cell, below, above].map(|cell| now[cell * width + k]);
                next[cell * width + k] = own + side * (below + above - 2.0 * own);
            }
        }
        now = next;
    }
    now
}

#[cfg(test)]
mod tests;
