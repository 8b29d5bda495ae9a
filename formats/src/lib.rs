//! What the bytes of a `.squall` asset mean.
//!
//! Bake writes them, the runtime reads them; whatever both need to agree on lives here and nothing else
//! does: the container, one module per section, table axes with their inverses, the Haar transform,
//! direction bases and units. `SPEC.md` beside this crate says the same in words, to the byte.

#![forbid(unsafe_code)]

pub mod basis;
pub mod container;
pub mod drops;
pub mod error;
pub mod grid;
pub mod haar;
pub mod light_grid;
pub mod magic;
pub mod meta;
pub mod section;
pub mod sphere;
pub mod tag;
pub mod units;
pub mod view_region;

pub use error::{Limits, ReadError};
pub use grid::GridShape;
pub use tag::Tag;
