//! Judges.

#[cfg(test)]
mod rain;
