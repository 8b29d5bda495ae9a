//! Judges.

#[cfg(test)]
mod rain;
#[cfg(test)]
mod rain_picture;
