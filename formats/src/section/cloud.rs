//! `CLDG` v1: the cloud grid. Bytes: SPEC.md, "CLDG".

use crate::container::OutSection;
use crate::error::{Limits, ReadError};
use crate::grid::GridShape;
use crate::meta::{self, check_version, join_head, split_head};
use crate::tag::Tag;
use serde::{Deserialize, Serialize};

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

/// A cloud grid: a view into the asset's bytes.
#[derive(Clone, Debug)]
pub struct CloudSection<'a> {
    /// Shape, place and optics.
    pub head: CloudHead,
    /// Extinction per cell, 1/m, x fastest; piecewise constant, zero outside the grid.
    pub extinction: &'a [f32],
}

impl<'a> CloudSection<'a> {
    /// The section's tag.
    pub const TAG: Tag = Tag(*b"CLDG");
    /// Version that this build writes, and the newest that it reads.
    pub const VERSION: u16 = 1;

    /// Reads the head and views the grid. The values themselves are bulk: see [`CloudSection::check_values`].
    pub fn read(bytes: &'a [u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        check_version(Self::TAG, version, Self::VERSION)?;
        let (head, bulk) = split_head(Self::TAG, bytes)?;
        let head: CloudHead = meta::decode(Self::TAG, head, limits)?;
        let invalid = |field, wanted, found: String| ReadError::Invalid {
            section: Self::TAG,
            offset: None,
            field,
            wanted,
            found,
        };
        let cells = head
            .shape
            .checked_len()
            .ok_or_else(|| invalid("shape", "1 to 2^32 cells", format!("{:?}", head.shape)))?;
        if cells as u64 > limits.cells {
            let (wanted, allowed) = (cells as u64, limits.cells);
            return Err(ReadError::OverLimit { section: Self::TAG, field: "cells", wanted, allowed });
        }
        if !head.cell_m.iter().all(|edge| edge.is_finite() && *edge > 0.0) {
            return Err(invalid("cell_m", "positive metres", format!("{:?}", head.cell_m)));
        }
        if !head.origin_m.iter().all(|v| v.is_finite()) {
            return Err(invalid("origin_m", "finite metres", format!("{:?}", head.origin_m)));
        }
        if !(0.0..=1.0).contains(&head.albedo) {
            return Err(invalid("albedo", "0 to 1", head.albedo.to_string()));
        }
        if !(head.g > -1.0 && head.g < 1.0) {
            return Err(invalid("g", "between -1 and 1", head.g.to_string()));
        }
        let extinction: &[f32] = bytemuck::try_cast_slice(bulk)
            .map_err(|error| invalid("extinction", "an aligned array of f32", error.to_string()))?;
        if extinction.len() != cells {
            return Err(invalid("extinction", "one value a cell", format!("{} values", extinction.len())));
        }
        Ok(Self { head, extinction })
    }

    /// Checks every value: one pass over the grid, for those who are about to use it all.
    pub fn check_values(&self) -> Result<(), ReadError> {
        let head = join_head(&meta::encode(&self.head)).len() as u64;
        match self.extinction.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            None => Ok(()),
            Some(at) => Err(ReadError::Invalid {
                section: Self::TAG,
                offset: Some(head + at as u64 * 4),
                field: "extinction",
                wanted: "finite and not negative",
                found: self.extinction[at].to_string(),
            }),
        }
    }

    /// The section's bytes.
    pub fn write(&self) -> OutSection {
        let head = join_head(&meta::encode(&self.head));
        OutSection {
            tag: Self::TAG,
            version: Self::VERSION,
            required: true,
            head_length: head.len() as u64,
            parts: vec![head, bytemuck::cast_slice(self.extinction).to_vec()],
        }
    }
}
