//! Bakes storms: cloud grids, pictures of rain and a recipe in; one `.squall` asset out.
//!
//! Inputs → stages → compression → sections → asset. The slow truth behind every table is here under the
//! verb `solve_`, what fills a table under `bake_`; reading it is the runtime's, under `lookup_`.
#![forbid(unsafe_code)]

pub mod error;
pub mod input;
pub mod output;
pub mod picture;
pub mod synth;

pub use error::BakeError;
