//! Inputs made from seeds, so that a storm can be baked with nothing but this program.

pub mod cloud;
pub mod streak;
#[cfg(feature = "meshes")]
pub mod street;
pub mod stroke;
pub mod town;
