//! Light transport in a cloud grid: what a flash becomes after many scatterings.
//!
//! Direct light is followed exactly along rays ([`direct`]); the rest obeys the discrete-ordinates form of the
//! transport equation, whose streaming part is a [`sweep`] through the grid per direction and whose scattering
//! couples directions through a few moments per cell ([`solve`]). The forward peak of the phase function counts as
//! unscattered (delta-M, [`crate::phase::DeltaM`]); \[dobashi\] eq. 1 with its point-to-point kernels loses energy
//! and is not used here.

pub mod cloud;
pub mod direct;
pub mod lanes;
pub mod quadrature;
pub mod solve;
pub mod sweep;
mod sweep_one;

pub use cloud::{Boundary, Cloud};
