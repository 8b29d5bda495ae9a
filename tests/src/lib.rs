//! Judges.

#[cfg(test)]
mod streaks;
