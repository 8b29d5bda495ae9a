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
            let mut extent = self.extent(level);
            for axis in 0..3 {
                if let Some(&(count, pair, last)) = self.axes[axis].levels.get(level) {
                    self.lines(values, scratch, axis, extent, |entry, line, half, stride| {
                        let mean = |i: usize| i * stride;
                        for i in 0..count / 2 {
                            let r = if 2 * i + 2 == count { last } else { pair };
                            for s in 0..stride {
                                let (a, b) = (entry[mean(2 * i) + s], entry[mean(2 * i + 1) + s]);
                                line[mean(i) + s] = r.cos * a + r.sin * b;
                                line[mean(half + i) + s] = r.cos * b - r.sin * a;
                            }
                        }
                        if count % 2 == 1 {
                            line[mean(half - 1)..mean(half)]
                                .copy_from_slice(&entry[mean(count - 1)..mean(count)]);
                        }
                    });
                    extent[axis] = count;
                }
            }
        }
    }

    /// Coefficients to cell values, in place: the transpose of [`Haar::forward`] and its inverse.
    ///
    /// Panics when `values` is not one grid long.
    pub fn inverse(&self, values: &mut [f32], scratch: &mut Vec<f32>) {
        assert_eq!(values.len(), self.len());
        for level in (0..self.depth()).rev() {
            let extent = self.extent(level);
            for axis in (0..3).rev() {
                if let Some(&(count, pair, last)) = self.axes[axis].levels.get(level) {
                    self.lines(values, scratch, axis, extent, |entry, line, half, stride| {
                        let at = |i: usize| i * stride;
                        for i in 0..count / 2 {
                            let r = if 2 * i + 2 == count { last } else { pair };
                            for s in 0..stride {
                                let (mean, difference) = (entry[at(i) + s], entry[at(half + i) + s]);
                                line[at(2 * i) + s] = r.cos * mean - r.sin * difference;
                                line[at(2 * i + 1) + s] = r.sin * mean + r.cos * difference;
                            }
                        }
                        if count % 2 == 1 {
                            line[at(count - 1)..at(count)].copy_from_slice(&entry[at(half - 1)..at(half)]);
                        }
                    });
                }
            }
        }
    }

    /// Runs `step(entries, results, half, stride)` over every bundle of lines along `axis` inside `extent`. A
    /// bundle is what lies together in memory: one line along x, a whole plane's rows along y or z.
    fn lines(
        &self,
        values: &mut [f32],
        scratch: &mut Vec<f32>,
        axis: usize,
        extent: [usize; 3],
        step: impl Fn(&[f32], &mut [f32], usize, usize),
    ) {
        let [nx, ny, _] = self.shape;
        let strides = [1, nx, nx * ny];
        let count = extent[axis];
        let half = count.div_ceil(2);
        // Entries beside each other in x move together, except along x itself.
        let stride = if axis == 0 { 1 } else { extent[0] };
        scratch.resize(2 * count * stride, 0.0);
        let (entries, results) = scratch.split_at_mut(count * stride);
        let (outer_axis, outer_count) = match axis {
            0 => (1, extent[1]),
            1 => (2, extent[2]),
            _ => (1, extent[1]),
        };
        let second = if axis == 0 { extent[2] } else { 1 };
        for outer in 0..outer_count {
            for inner in 0..second {
                let base = outer * strides[outer_axis] + inner * strides[2];
                for i in 0..count {
                    let from = base + i * strides[axis];
                    entries[i * stride..(i + 1) * stride].copy_from_slice(&values[from..from + stride]);
                }
                step(entries, results, half, stride);
                for i in 0..count {
                    let to = base + i * strides[axis];
                    values[to..to + stride].copy_from_slice(&results[i * stride..(i + 1) * stride]);
                }
            }
        }
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
