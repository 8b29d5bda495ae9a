//! What runs while a frame waits: light, surfaces and air into pixels.

pub mod detail;
pub mod environment;
pub mod sky;
pub mod town;
pub mod water;
