//! The three-dimensional Haar transform of a grid of any size, forward beside inverse.
//!
//! Normalisation: orthonormal, so that the energy of coefficients left out is the squared error that leaving
//! them out makes. Coefficient 0 is the sum over all cells divided by √(number of cells): with it kept, what is
//! discarded has zero mean.
//!
//! Each level turns pairs along x, then y, then z into a scaled mean and a scaled difference; means fill the
//! front of the axis, differences its back, and the next level works on the means until every axis is down to
//! one. On an axis of odd length the last entry has no partner and stays a mean of fewer cells than its
//! neighbours; the next pairing weighs the two by how many cells each stands for, which keeps the transform
//! orthonormal and coefficient 0 the mean, on sizes that are no power of two.

use crate::grid::GridShape;

/// One pairing level along an axis: rotation by which entries 2i and 2i+1 become mean and difference.
#[derive(Clone, Copy)]
struct Rotation {
    cos: f32,
    sin: f32,
}

impl Rotation {
    /// Two entries to mean and difference.
    #[inline(always)]
    fn to(self, a: f32, b: f32) -> [f32; 2] {
        [self.cos * a + self.sin * b, self.cos * b - self.sin * a]
    }

    /// Mean and difference back to the two entries.
    #[inline(always)]
    fn back(self, mean: f32, difference: f32) -> [f32; 2] {
        [self.cos * mean - self.sin * difference, self.sin * mean + self.cos * difference]
    }
}

/// The levels of one axis.
struct Axis {
    /// For each level: length before pairing, rotation of ordinary pairs, rotation of the last pair.
    levels: Vec<(usize, Rotation, Rotation)>,
}

impl Axis {
    fn new(length: usize) -> Self {
        let mut levels = Vec::new();
        // Cells behind an ordinary entry and behind the last one; the last may stand for fewer.
        let (mut whole, mut last, mut count) = (1.0f64, 1.0f64, length);
        let rotation = |a: f64, b: f64| Rotation {
            cos: libm::sqrt(a / (a + b)) as f32,
            sin: libm::sqrt(b / (a + b)) as f32,
        };
        while count > 1 {
            levels.push((count, rotation(whole, whole), rotation(whole, last)));
            // An even count pairs the last entry up; an odd one passes it on as it is.
            if count % 2 == 0 {
                last += whole;
            }
            whole *= 2.0;
            count = count.div_ceil(2);
        }
        Self { levels }
    }
}

/// A planned transform for grids of one shape.
///
/// ```
/// use squall_formats::{GridShape, haar::Haar};
///
/// let haar = Haar::new(GridShape::new(3, 2, 1));
/// let cells = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
/// let (mut values, mut scratch) = (cells.to_vec(), Vec::new());
///
/// haar.forward(&mut values, &mut scratch);
/// // Coefficient 0 is the sum over all cells divided by the root of their number, and energy stays what it was.
/// assert!((values[0] - 21.0 / 6f32.sqrt()).abs() < 1e-5);
/// assert!((values.iter().map(|v| v * v).sum::<f32>() - 91.0).abs() < 1e-4);
///
/// haar.inverse(&mut values, &mut scratch);
/// assert!(values.iter().zip(cells).all(|(found, wanted)| (found - wanted).abs() < 1e-5));
/// ```
pub struct Haar {
    shape: [usize; 3],
    axes: [Axis; 3],
}

impl Haar {
    /// Plans the transform of grids of `shape`, which must not be empty.
    pub fn new(shape: GridShape) -> Self {
        let shape = shape.to_array();
        Self { shape, axes: shape.map(Axis::new) }
    }

    /// Number of cells, and of coefficients.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether the grid has no cells; never true of a planned transform.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The pairing levels along `axis` (0 x, 1 y, 2 z), finest first: how many entries are paired, and cosine and sine of the rotation
    /// that pairs ordinary ones, then of the last pair's. [`Haar::inverse`] turns (mean, difference) back into the entries
    /// (cos · mean − sin · difference, sin · mean + cos · difference).
    pub fn rotations(&self, axis: usize) -> impl Iterator<Item = (usize, [f32; 4])> {
        let levels = self.axes[axis].levels.iter();
        levels.map(|(count, pair, last)| (*count, [pair.cos, pair.sin, last.cos, last.sin]))
    }

    fn depth(&self) -> usize {
        self.axes.iter().map(|axis| axis.levels.len()).max().unwrap_or(0)
    }

    /// The box of means that level `level` works on.
    fn extent(&self, level: usize) -> [usize; 3] {
        std::array::from_fn(|axis| self.axes[axis].levels.get(level).map_or(1, |step| step.0))
    }

    /// Cell values to coefficients, in place. `scratch` is grown to one grid and reused.
    ///
    /// Panics when `values` is not one grid long.
    pub fn forward(&self, values: &mut [f32], scratch: &mut Vec<f32>) {
        assert_eq!(values.len(), self.len());
        for level in 0..self.depth() {
            for axis in 0..3 {
                self.turn(values, level, axis, scratch, Way::Forward);
            }
        }
    }

    /// Coefficients to cell values, in place: the transpose of [`Haar::forward`] and its inverse.
    ///
    /// Panics when `values` is not one grid long.
    pub fn inverse(&self, values: &mut [f32], scratch: &mut Vec<f32>) {
        assert_eq!(values.len(), self.len());
        for level in (0..self.depth()).rev() {
            for axis in (0..3).rev() {
                self.turn(values, level, axis, scratch, Way::Inverse);
            }
        }
    }

    /// Turns all pairs of one level along one axis.
    ///
    /// Relighting spends its time here, so lines are not gathered one by one: pairs along x are turned where they lie, and
    /// along y and z whole rows together.
    fn turn(&self, values: &mut [f32], level: usize, axis: usize, scratch: &mut Vec<f32>, way: Way) {
        let Some(step) = self.axes[axis].levels.get(level) else { return };
        let extent = self.extent(level);
        let [nx, ny, _] = self.shape;
        match axis {
            0 => {
                for slab in values.chunks_exact_mut(nx * ny).take(extent[2]) {
                    for row in slab.chunks_exact_mut(nx).take(extent[1]) {
                        match way {
                            Way::Forward => forward_line(&mut row[..extent[0]], step, scratch),
                            Way::Inverse => inverse_line(&mut row[..extent[0]], step, scratch),
                        }
                    }
                }
            }
            1 => {
                for slab in values.chunks_exact_mut(nx * ny).take(extent[2]) {
                    turn_rows(slab, step, nx, extent[0], scratch, way);
                }
            }
            _ => {
                // Whole slabs where the box is as wide as the grid, else its rows one after the other.
                let (rows, width) =
                    if extent[..2] == [nx, ny] { (1, nx * ny) } else { (extent[1], extent[0]) };
                for y in 0..rows {
                    turn_rows(&mut values[y * nx..], step, nx * ny, width, scratch, way);
                }
            }
        }
    }
}

/// Which way pairs are turned.
#[derive(Clone, Copy)]
enum Way {
    Forward,
    Inverse,
}

/// Neighbours become means in front and differences behind, along one line.
#[inline]
fn forward_line(
    line: &mut [f32],
    &(count, pair, last): &(usize, Rotation, Rotation),
    scratch: &mut Vec<f32>,
) {
    scratch.clear();
    scratch.extend_from_slice(line);
    let half = count.div_ceil(2);
    let (means, differences) = line.split_at_mut(half);
    let (pairs, single) = scratch.as_chunks::<2>();
    for ((mean, difference), &[a, b]) in means.iter_mut().zip(&mut *differences).zip(pairs) {
        [*mean, *difference] = pair.to(a, b);
    }
    match single {
        [single] => means[half - 1] = *single,
        _ => {
            let [a, b] = pairs[half - 1];
            [means[half - 1], differences[half - 1]] = last.to(a, b);
        }
    }
}

/// Means in front and differences behind become neighbours, along one line.
#[inline]
fn inverse_line(
    line: &mut [f32],
    &(count, pair, last): &(usize, Rotation, Rotation),
    scratch: &mut Vec<f32>,
) {
    scratch.clear();
    scratch.extend_from_slice(line);
    let (means, differences) = scratch.split_at(count.div_ceil(2));
    let (pairs, single) = line.as_chunks_mut::<2>();
    for ((pair_out, &mean), &difference) in pairs.iter_mut().zip(means).zip(differences) {
        *pair_out = pair.back(mean, difference);
    }
    match single {
        [single] => *single = means[means.len() - 1],
        _ => pairs[count / 2 - 1] = last.back(means[count / 2 - 1], differences[count / 2 - 1]),
    }
}

/// The same for rows of `width` values that lie `stride` apart: rows 2i and 2i + 1 belong to row i and row half + i.
#[inline]
fn turn_rows(
    values: &mut [f32],
    &(count, pair, last): &(usize, Rotation, Rotation),
    stride: usize,
    width: usize,
    scratch: &mut Vec<f32>,
    way: Way,
) {
    scratch.clear();
    for i in 0..count {
        scratch.extend_from_slice(&values[i * stride..][..width]);
    }
    let half = count.div_ceil(2);
    let entry = |i: usize| &scratch[i * width..][..width];
    for i in 0..count / 2 {
        let rotation = if 2 * i + 2 == count { last } else { pair };
        let (low, high) = match way {
            Way::Forward => (i, half + i),
            Way::Inverse => (2 * i, 2 * i + 1),
        };
        let (front, back) = values[low * stride..].split_at_mut((high - low) * stride);
        let outputs = front[..width].iter_mut().zip(&mut back[..width]);
        match way {
            Way::Forward => {
                for ((mean, difference), (&a, &b)) in outputs.zip(entry(2 * i).iter().zip(entry(2 * i + 1))) {
                    [*mean, *difference] = rotation.to(a, b);
                }
            }
            Way::Inverse => {
                for ((a, b), (&mean, &difference)) in outputs.zip(entry(i).iter().zip(entry(half + i))) {
                    [*a, *b] = rotation.back(mean, difference);
                }
            }
        }
    }
    if count % 2 == 1 {
        let (from, to) = match way {
            Way::Forward => (count - 1, half - 1),
            Way::Inverse => (half - 1, count - 1),
        };
        values[to * stride..][..width].copy_from_slice(entry(from));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Single precision through at most 3 × 6 rotations of values near 1.
    const ROUND_OFF: f32 = 4e-6;

    fn grid() -> impl Strategy<Value = (GridShape, Vec<f32>)> {
        (1u32..14, 1u32..14, 1u32..14).prop_flat_map(|(x, y, z)| {
            let shape = GridShape::new(x, y, z);
            (Just(shape), proptest::collection::vec(-1.0f32..1.0, shape.len()))
        })
    }

    proptest! {
        #[test]
        fn haar_with_all_coefficients_is_exact((shape, values) in grid()) {
            let (haar, mut scratch) = (Haar::new(shape), Vec::new());
            let mut work = values.clone();
            haar.forward(&mut work, &mut scratch);
            haar.inverse(&mut work, &mut scratch);
            for (back, value) in work.iter().zip(&values) {
                prop_assert!((back - value).abs() < ROUND_OFF);
            }
        }

        #[test]
        fn energy_is_kept_and_coefficient_zero_is_the_mean((shape, values) in grid()) {
            let (haar, mut scratch) = (Haar::new(shape), Vec::new());
            let mut work = values.clone();
            haar.forward(&mut work, &mut scratch);
            let energy = |v: &[f32]| v.iter().map(|&x| f64::from(x) * f64::from(x)).sum::<f64>();
            prop_assert!((energy(&work) - energy(&values)).abs() <= f64::from(ROUND_OFF) * energy(&values));
            let mean = values.iter().map(|&x| f64::from(x)).sum::<f64>() / libm::sqrt(values.len() as f64);
            prop_assert!((f64::from(work[0]) - mean).abs() < 1e-5);
        }

        #[test]
        fn discarded_energy_is_the_squared_error((shape, values) in grid(), threshold in 0.01f32..0.5) {
            let (haar, mut scratch) = (Haar::new(shape), Vec::new());
            let mut work = values.clone();
            haar.forward(&mut work, &mut scratch);
            let mut discarded = 0.0;
            for value in &mut work {
                if value.abs() <= threshold {
                    discarded += f64::from(*value) * f64::from(*value);
                    *value = 0.0;
                }
            }
            haar.inverse(&mut work, &mut scratch);
            let error: f64 = work.iter().zip(&values).map(|(a, b)| f64::from(a - b) * f64::from(a - b)).sum();
            prop_assert!((error - discarded).abs() <= 1e-5 * (discarded + 1e-3));
        }
    }

    #[test]
    fn a_constant_grid_has_one_coefficient_on_any_size() {
        for shape in [GridShape::new(32, 32, 4), GridShape::new(7, 5, 3), GridShape::new(1, 1, 1)] {
            let haar = Haar::new(shape);
            let mut values = vec![2.0f32; shape.len()];
            haar.forward(&mut values, &mut Vec::new());
            let mean = 2.0 * libm::sqrtf(shape.len() as f32);
            assert!((values[0] - mean).abs() < ROUND_OFF * mean);
            assert!(values[1..].iter().all(|v| v.abs() < ROUND_OFF));
        }
    }
}
