//! Bakes storms: cloud grids, pictures of rain and a recipe in; one `.squall` asset out.
//!
//! The recipe says, the plan decides, the stage makes: inputs → stages → compression → sections → asset. The slow truth behind every table is here under the
//! verb `solve_`, what fills a table under `bake_`; reading it is the runtime's, under `lookup_`.
#![forbid(unsafe_code)]

pub mod asset;
pub mod chart;
pub mod cloud;
pub mod compress;
pub mod density;
pub mod diff;
pub mod error;
pub mod estimate;
pub mod evaluate;
pub mod fields;
pub mod frames;
pub mod input;
pub mod memory;
pub mod metrics;
pub mod monte_carlo;
pub mod output;
pub mod picture;
pub mod pipeline;
pub mod plan;
pub mod point_spread;
pub mod progress;
pub mod provenance;
pub mod recipe;
pub mod relit;
pub mod response;
pub mod streak;
pub mod synth;

pub use error::BakeError;
