//! Reads a `.squall` asset and shades: clouds lit by lightning, rain streaks of the right number and
//! length, the loss of visibility that belongs to the same rain, and the wet ground under them.
//!
//! Everything slow happened when the asset was baked. No globals, no threads but the caller's rayon
//! pool, and no work at load beyond checks.
#![deny(unsafe_code)]

mod audited;
pub mod camera;
pub mod density;
pub mod depth;
pub mod error;
pub mod frame;
pub mod in_scattered;
pub mod load;
pub mod medium;
pub mod noise;
pub mod picture;
pub mod rain;
pub mod random;
pub mod relight;
pub mod shade;
pub mod single_scatter;
pub mod stroke;
pub mod tone;
pub mod verify;

pub use error::RuntimeError;
pub use load::Asset;
pub use relight::PointLight;
pub use squall_transport as transport;
#[cfg(feature = "live")]
pub use squall_transport::live;
pub use squall_transport::{math, parallel, phase};
