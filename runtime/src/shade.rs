//! From tables and light to pixels: each room takes plain data and writes radiance.

pub mod adaptive;
pub mod cloud;
pub mod detail;
pub mod environment;
pub mod sky;
pub mod streak;
pub mod town;
pub mod water;
