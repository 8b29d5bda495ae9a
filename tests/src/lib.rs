//! Judges.

#[cfg(test)]
mod scenery;
