//! `CLDG` v1 and v2: the cloud grid. Bytes: SPEC.md, "CLDG".

use crate::container::OutSection;
use crate::error::{Limits, ReadError};
use crate::grid::GridShape;
use crate::meta::{self, check_version, join_head, split_head};
use crate::tag::Tag;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// What the grid is and how its cells scatter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CloudHead {
    /// Cells along x, y, z.
    pub shape: GridShape,
    /// Cell edges along x, y, z, m.
    pub cell_m: [f64; 3],
    /// Corner of the first cell with the smallest coordinates, m.
    pub origin_m: [f64; 3],
    /// Single-scattering albedo, 0 to 1.
    pub albedo: f64,
    /// Asymmetry parameter of the Henyey–Greenstein phase function, −1 to 1, ends excluded.
    pub g: f64,
    /// Whether the grid repeats along x and y.
    pub periodic_xy: bool,
}

/// Extinction per cell, 1/m, x fastest, as it lies in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Extinction<'a> {
    /// A value a cell: version 1.
    Every(&'a [f32]),
    /// Values of the cells that are not empty: version 2.
    NotEmpty {
        /// Cells of the grid.
        cells: usize,
        /// A bit a cell, lowest first, up to a multiple of four bytes: whether it has a value.
        bits: &'a [u8],
        /// Those values, in the order of their cells.
        values: &'a [f32],
    },
}

impl<'a> From<&'a [f32]> for Extinction<'a> {
    fn from(values: &'a [f32]) -> Self {
        Self::Every(values)
    }
}

impl<'a> Extinction<'a> {
    /// A value a cell, 1/m. Of a grid that [`CloudSection::check_values`] has not passed, a cell without a value of its own is empty.
    pub fn values(&self) -> Cow<'a, [f32]> {
        match *self {
            Self::Every(values) => Cow::Borrowed(values),
            Self::NotEmpty { cells, bits, values } => {
                let mut values = values.iter();
                let value = |cell: usize| match bits[cell / 8] >> (cell % 8) & 1 {
                    1 => values.next().copied().unwrap_or_default(),
                    _ => 0.0,
                };
                Cow::Owned((0..cells).map(value).collect())
            }
        }
    }

    /// Bytes that it takes in a file.
    pub fn bytes(&self) -> u64 {
        match *self {
            Self::Every(values) => size_of_val(values) as u64,
            Self::NotEmpty { bits, values, .. } => (bits.len() + size_of_val(values)) as u64,
        }
    }
}

/// Bytes of the bits of so many cells.
fn bytes_of_bits(cells: usize) -> usize {
    cells.div_ceil(32) * 4
}

/// A cloud grid: a view into the asset's bytes.
#[derive(Clone, Debug)]
pub struct CloudSection<'a> {
    /// Shape, place and optics.
    pub head: CloudHead,
    /// Extinction per cell, 1/m, x fastest; piecewise constant, zero outside the grid.
    pub extinction: Extinction<'a>,
}

impl<'a> CloudSection<'a> {
    /// The section's tag.
    pub const TAG: Tag = Tag(*b"CLDG");
    /// Newest version that this build writes and reads.
    pub const VERSION: u16 = 2;

    /// Reads the head and views the grid. The values themselves are bulk: see [`CloudSection::check_values`].
    pub fn read(bytes: &'a [u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        check_version(Self::TAG, version, Self::VERSION)?;
        let (head, bulk) = split_head(Self::TAG, bytes)?;
        let (head, filled): (CloudHead, Option<u32>) = match version {
            1 => (meta::decode(Self::TAG, head, limits)?, None),
            _ => {
                let (head, filled) = meta::decode(Self::TAG, head, limits)?;
                (head, Some(filled))
            }
        };
        let cells = head.checked_cells(limits)?;
        let extinction = match filled {
            None => {
                let values: &[f32] = floats(bulk)?;
                if values.len() != cells {
                    return Err(invalid(
                        "extinction",
                        "one value a cell",
                        format!("{} values", values.len()),
                    ));
                }
                Extinction::Every(values)
            }
            Some(filled) => {
                let (filled, bits) = (filled as usize, bytes_of_bits(cells));
                let wanted =
                    "a bit a cell, up to a multiple of four bytes, and one value a cell that is not empty";
                let length = bits as u64 + 4 * filled as u64;
                let (bits, values) = bulk
                    .split_at_checked(bits)
                    .filter(|_| bulk.len() as u64 == length)
                    .ok_or_else(|| invalid("extinction", wanted, format!("{} bytes", bulk.len())))?;
                Extinction::NotEmpty { cells, bits, values: floats(values)? }
            }
        };
        Ok(Self { head, extinction })
    }

    /// Checks every value: one pass over the grid, for those who are about to use it all.
    pub fn check_values(&self) -> Result<(), ReadError> {
        let at_fault = |offset: usize, field, wanted, found| {
            let head = self.encoded_head().len() as u64;
            let offset = Some(head + offset as u64);
            Err(ReadError::Invalid { section: Self::TAG, offset, field, wanted, found })
        };
        match self.extinction {
            Extinction::Every(values) => match values.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
                None => Ok(()),
                Some(at) => at_fault(4 * at, "extinction", "finite and not negative", values[at].to_string()),
            },
            Extinction::NotEmpty { cells, bits, values } => {
                let set = bits.iter().map(|byte| byte.count_ones() as usize).sum::<usize>();
                if set != values.len() {
                    let wanted = "as many bits as values";
                    return at_fault(
                        0,
                        "cells that are not empty",
                        wanted,
                        format!("{set} for {}", values.len()),
                    );
                }
                let beyond = (cells..8 * bits.len()).find(|cell| bits[cell / 8] >> (cell % 8) & 1 == 1);
                if let Some(cell) = beyond {
                    let wanted = "no bit beyond the grid's cells";
                    return at_fault(cell / 8, "cells that are not empty", wanted, format!("cell {cell}"));
                }
                match values.iter().position(|v| !(v.is_finite() && *v > 0.0)) {
                    None => Ok(()),
                    Some(at) => {
                        let offset = bits.len() + 4 * at;
                        at_fault(offset, "extinction", "finite and above 0", values[at].to_string())
                    }
                }
            }
        }
    }

    /// The section's bytes, in the version that it was read in.
    pub fn write(&self) -> OutSection {
        let head = self.encoded_head();
        let (version, mut parts) = match self.extinction {
            Extinction::Every(values) => (1, vec![bytemuck::cast_slice(values).to_vec()]),
            Extinction::NotEmpty { bits, values, .. } => {
                (2, vec![bits.to_vec(), bytemuck::cast_slice(values).to_vec()])
            }
        };
        let head_length = head.len() as u64;
        parts.insert(0, head);
        OutSection { tag: Self::TAG, version, required: true, head_length, parts }
    }

    /// The bytes of a grid with these values, in whichever version takes fewer.
    ///
    /// ```
    /// use squall_formats::section::cloud::{CloudHead, CloudSection};
    /// use squall_formats::{GridShape, error::Limits};
    ///
    /// let shape = GridShape::new(40, 40, 40);
    /// let mut extinction = vec![0.0; shape.len()];
    /// extinction[1234] = 0.02;
    /// let head = CloudHead {
    ///     shape, cell_m: [50.0; 3], origin_m: [0.0; 3], albedo: 0.999, g: 0.85, periodic_xy: false,
    /// };
    /// let section = CloudSection::write_smallest(&head, &extinction);
    /// assert_eq!(section.version, 2);
    /// let bytes = section.to_bytes();
    /// assert!(bytes.len() < extinction.len());
    /// let back = CloudSection::read(&bytes, 2, &Limits::default())?;
    /// assert_eq!(back.extinction.values()[..], extinction[..]);
    /// # Ok::<(), squall_formats::error::ReadError>(())
    /// ```
    pub fn write_smallest(head: &CloudHead, extinction: &[f32]) -> OutSection {
        let head = head.clone();
        let mut bits = vec![0u8; bytes_of_bits(extinction.len())];
        let mut values = Vec::new();
        for (cell, &value) in extinction.iter().enumerate() {
            // A zero with a sign is as empty as one without.
            if value != 0.0 {
                bits[cell / 8] |= 1 << (cell % 8);
                values.push(value);
            }
        }
        let sparse = Extinction::NotEmpty { cells: extinction.len(), bits: &bits, values: &values };
        let every = Extinction::Every(extinction);
        let extinction = if sparse.bytes() < every.bytes() { sparse } else { every };
        CloudSection { head, extinction }.write()
    }

    fn encoded_head(&self) -> Vec<u8> {
        join_head(&match self.extinction {
            Extinction::Every(_) => meta::encode(&self.head),
            Extinction::NotEmpty { values, .. } => meta::encode(&(&self.head, values.len() as u32)),
        })
    }
}

impl CloudHead {
    /// Cells of the grid. Errors: a field out of range, more cells than `limits` allow.
    fn checked_cells(&self, limits: &Limits) -> Result<usize, ReadError> {
        let shape = self.shape;
        let cells =
            shape.checked_len().ok_or_else(|| invalid("shape", "1 to 2^32 cells", format!("{shape:?}")))?;
        if cells as u64 > limits.cells {
            let (section, wanted, allowed) = (CloudSection::TAG, cells as u64, limits.cells);
            return Err(ReadError::OverLimit { section, field: "cells", wanted, allowed });
        }
        if !self.cell_m.iter().all(|edge| edge.is_finite() && *edge > 0.0) {
            return Err(invalid("cell_m", "positive metres", format!("{:?}", self.cell_m)));
        }
        if !self.origin_m.iter().all(|v| v.is_finite()) {
            return Err(invalid("origin_m", "finite metres", format!("{:?}", self.origin_m)));
        }
        if !(0.0..=1.0).contains(&self.albedo) {
            return Err(invalid("albedo", "0 to 1", self.albedo.to_string()));
        }
        if !(self.g > -1.0 && self.g < 1.0) {
            return Err(invalid("g", "between -1 and 1", self.g.to_string()));
        }
        Ok(cells)
    }
}

fn invalid(field: &'static str, wanted: &'static str, found: String) -> ReadError {
    ReadError::Invalid { section: CloudSection::TAG, offset: None, field, wanted, found }
}

fn floats(bytes: &[u8]) -> Result<&[f32], ReadError> {
    bytemuck::try_cast_slice(bytes)
        .map_err(|error| invalid("extinction", "an aligned array of f32", error.to_string()))
}
