//! What runs while a frame waits: light, surfaces and air into pixels.

pub mod detail;
pub mod sky;
