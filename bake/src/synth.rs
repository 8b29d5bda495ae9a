//! Inputs made from seeds, so that a storm can be baked with nothing but this program.

pub mod cloud;
pub mod streak;
pub mod stroke;
pub mod town;
