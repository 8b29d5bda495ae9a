//! Readers of what people bring: each turns one file into plain numbers or one clear error.

pub mod picture;
