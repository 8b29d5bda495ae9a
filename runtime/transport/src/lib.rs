//! Light transport in a cloud grid: what a flash becomes after many scatterings.
//!
//! Direct light is followed exactly along rays ([`direct`]); the rest obeys the discrete-ordinates form of the
//! transport equation, whose streaming part is a sweep through the grid per direction and whose scattering couples
//! directions through a few moments per cell (feature `sweeps`: modules `solve` and `sweep`, and `live` on top of them). The
//! forward peak of the phase function counts as unscattered (delta-M, [`phase::DeltaM`]); \[dobashi\] eq. 1 with its
//! point-to-point kernels loses energy and is not used here.
#![deny(unsafe_code)]

pub mod cloud;
pub mod direct;
pub mod error;
pub mod fit;
#[cfg(feature = "sweeps")]
pub mod gather;
#[cfg(feature = "sweeps")]
pub mod lanes;
pub mod light;
#[cfg(feature = "sweeps")]
pub mod live;
pub mod math;
pub mod parallel;
pub mod phase;
#[cfg(feature = "sweeps")]
pub mod quadrature;
#[cfg(feature = "sweeps")]
pub mod solve;
#[cfg(feature = "sweeps")]
pub mod sweep;

pub use cloud::{Boundary, Cloud};
pub use error::ArgumentError;
pub use light::PointLight;
