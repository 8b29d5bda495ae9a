//! Shading: what is read from an asset becomes light in a picture.

pub mod streak;
