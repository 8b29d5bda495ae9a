//! Readers: what people hand in, checked and in the units of the inside.

pub mod town;
