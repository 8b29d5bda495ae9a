//! An asset in memory: what is measured is what ships.

use crate::error::BakeError;
use crate::response::BakedResponse;
use squall_formats::container::{self, OutSection};
use squall_formats::section::cloud::{CloudHead, CloudSection};
use squall_formats::section::response;
use squall_runtime::Asset;
use squall_runtime::transport::{Boundary, Cloud};
use std::path::Path;

/// A cloud's grid as a section.
pub fn grid_section(cloud: &Cloud) -> OutSection {
    let head = CloudHead {
        shape: cloud.shape,
        cell_m: cloud.cell_m,
        origin_m: cloud.origin_m.to_array(),
        albedo: cloud.albedo,
        g: cloud.g,
        periodic_xy: cloud.boundary == Boundary::PeriodicXy,
    };
    CloudSection::write_smallest(&head, &cloud.extinction)
}

/// An asset in memory with a cloud and its response, and the response's bytes.
///
/// Errors: none that a response from [`crate::response`] brings about.
pub fn asset_of(cloud: &Cloud, baked: BakedResponse) -> Result<(Asset, u64), BakeError> {
    let section = response::write(&baked.head, baked.rows);
    let bytes = section.length();
    Ok((in_memory(&[grid_section(cloud), section])?, bytes))
}

/// An asset of these sections.
///
/// Errors: sections that a reader refuses.
pub fn in_memory(sections: &[OutSection]) -> Result<Asset, BakeError> {
    let mut out = Vec::new();
    container::write(&mut out, sections).map_err(BakeError::io(Path::new("(memory)"), "write"))?;
    Ok(Asset::from_bytes(&out)?)
}
