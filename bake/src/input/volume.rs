//! Grids as files hold them: raw numbers, NumPy's arrays, OpenVDB's trees; brought to another grid with their mass.

use super::npy::{is_npy, read_npy_box};
use super::vdb::{Up, is_vdb, read_vdb};
use super::{Fingerprint, Input};
use crate::error::BakeError;
use glam::DVec3;
use squall_formats::GridShape;
use std::path::Path;

/// More cells than this are refused before memory is taken.
pub const MAX_CELLS: usize = 1 << 28;
/// Longest OpenVDB file read, bytes (2 GiB).
const MAX_VDB_BYTES: u64 = 2 << 30;

/// A grid and where it lies.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// Cells along x, y, z.
    pub shape: GridShape,
    /// Edges of a cell, m.
    pub cell_m: [f64; 3],
    /// The low corner, m.
    pub origin_m: DVec3,
    /// A value per cell, x fastest.
    pub values: Vec<f32>,
}

/// What a grid's file is, by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Little-endian f32 without a header.
    Raw,
    /// NumPy's, three axes.
    Npy,
    /// OpenVDB's.
    Vdb,
}

/// What kind of grid a file starts. Errors: no such file, a folder, the system's refusal.
pub fn kind_of_grid(path: &Path) -> Result<Kind, BakeError> {
    if !std::fs::metadata(path).map_err(BakeError::io(path, "read"))?.is_file() {
        // Pipes are read once; what comes out of one are plain numbers.
        return Ok(Kind::Raw);
    }
    let start = Input::read_if(path, 0, |_| false)?;
    Ok(match () {
        () if is_vdb(&start) => Kind::Vdb,
        () if is_npy(&start) => Kind::Npy,
        () => Kind::Raw,
    })
}

/// Reads an OpenVDB grid: [`read_vdb`] says which.
///
/// Errors: those of [`read_vdb`], and a value that is not finite or below zero.
pub fn read_vdb_file(
    path: &Path,
    name: Option<&str>,
    up: Up,
    metres_per_unit: f64,
) -> Result<(Volume, Fingerprint), BakeError> {
    let input = Input::read(path, MAX_VDB_BYTES)?;
    let volume = read_vdb(&input, name, up, metres_per_unit)?;
    check(path, &volume.values)?;
    Ok((volume, input.fingerprint()))
}

/// Reads a NumPy array of three axes, x, y and z.
///
/// Errors: those of [`read_npy_box`], and a value that is not finite or below zero.
pub fn read_npy_file(path: &Path) -> Result<(GridShape, Vec<f32>, Fingerprint), BakeError> {
    let header = 1 << 17;
    let input = Input::read(path, MAX_CELLS as u64 * 8 + header)?;
    let read = read_npy_box(&input, MAX_CELLS as u64)?;
    check(path, &read.values)?;
    let [nx, ny, nz] = read.counts.map(|count| count as u32);
    Ok((GridShape::new(nx, ny, nz), read.values, input.fingerprint()))
}

fn check(path: &Path, values: &[f32]) -> Result<(), BakeError> {
    match values.iter().position(|value| !(value.is_finite() && *value >= 0.0)) {
        None => Ok(()),
        Some(at) => Err(BakeError::input(path, format!("value {at}"), "finite and not negative", values[at])),
    }
}

impl Volume {
    /// The same box in other cells: each holds the mean over it, so that Σ value · volume stays. An axis at a time.
    #[must_use]
    pub fn resampled(&self, shape: GridShape) -> Self {
        let (from, to) = (self.shape.to_array(), shape.to_array());
        let mut counts = from;
        let mut values: Vec<f64> = self.values.iter().map(|&value| f64::from(value)).collect();
        for axis in 0..3 {
            values = along(axis, &values, counts, to[axis]);
            counts[axis] = to[axis];
        }
        let cell_m = [0, 1, 2].map(|axis| self.cell_m[axis] * from[axis] as f64 / to[axis] as f64);
        let values = values.into_iter().map(|value| value as f32).collect();
        Self { shape, cell_m, origin_m: self.origin_m, values }
    }

    /// Σ value · volume, in m³ times the values' unit.
    pub fn mass(&self) -> f64 {
        let sum: f64 = self.values.iter().map(|&value| f64::from(value)).sum();
        sum * self.cell_m.iter().product::<f64>()
    }
}

/// Means over `count` equal parts of an axis.
fn along(axis: usize, values: &[f64], counts: [usize; 3], count: usize) -> Vec<f64> {
    let old = counts[axis];
    if old == count {
        return values.to_vec();
    }
    // Numbers between neighbours along the axis, and rows along it.
    let stride: usize = counts[..axis].iter().product();
    let blocks: usize = counts[axis + 1..].iter().product();
    let mut out = vec![0.0; stride * count * blocks];
    let width = old as f64 / count as f64;
    for part in 0..count {
        let ends = [part as f64 * width, (part + 1) as f64 * width];
        let last = (ends[1].ceil() as usize).min(old);
        for cell in ends[0] as usize..last {
            let covered = ends[1].min(cell as f64 + 1.0) - ends[0].max(cell as f64);
            let share = covered.max(0.0) / width;
            for block in 0..blocks {
                let (read, write) = ((block * old + cell) * stride, (block * count + part) * stride);
                let pairs = out[write..write + stride].iter_mut().zip(&values[read..read + stride]);
                pairs.for_each(|(sum, value)| *sum += share * value);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of sums of some hundred f32.
    const ROUNDING: f64 = 1e-6;

    fn ramp(nx: u32, ny: u32, nz: u32) -> Volume {
        let shape = GridShape::new(nx, ny, nz);
        let values = (0..shape.len()).map(|at| (at * 7 % 13) as f32).collect();
        Volume { shape, cell_m: [2.0, 3.0, 5.0], origin_m: DVec3::new(-1.0, 4.0, 9.0), values }
    }

    #[test]
    fn mass_and_box_stay_whatever_the_new_cells() {
        let given = ramp(6, 5, 7);
        for to in [[3, 5, 7], [1, 1, 1], [4, 3, 2], [12, 10, 14], [6, 5, 7], [5, 11, 3]] {
            let new = given.resampled(GridShape::new(to[0], to[1], to[2]));
            assert!((new.mass() / given.mass() - 1.0).abs() < ROUNDING, "{to:?}");
            let size = |volume: &Volume| {
                [0, 1, 2].map(|axis| volume.cell_m[axis] * volume.shape.to_array()[axis] as f64)
            };
            assert!(size(&new).iter().zip(size(&given)).all(|(a, b)| (a - b).abs() < 1e-9));
        }
    }

    #[test]
    fn a_cell_cut_in_two_halves_keeps_its_value_and_two_joined_have_their_mean() {
        let given = ramp(4, 1, 1);
        let finer = given.resampled(GridShape::new(8, 1, 1)).values;
        assert_eq!(finer, given.values.iter().flat_map(|&v| [v, v]).collect::<Vec<_>>());
        let coarser = given.resampled(GridShape::new(2, 1, 1)).values;
        assert_eq!(coarser, given.values.chunks(2).map(|v| (v[0] + v[1]) / 2.0).collect::<Vec<_>>());
    }

    #[test]
    fn an_axis_stays_where_it_was() {
        let mut given = ramp(2, 2, 2);
        given.values = vec![0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0];
        assert_eq!(given.resampled(GridShape::new(2, 1, 1)).values, [0.0, 1.0]);
        assert_eq!(given.resampled(GridShape::new(1, 2, 1)).values, [0.5, 0.5]);
    }
}
