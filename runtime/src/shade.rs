//! From tables and light to pixels.

pub mod cloud;
