//! Integers with a step: rounding on the way in, a cursor on the way out.

use crate::error::ReadError;
use crate::tag::Tag;

/// The section's tag.
pub(super) const TAG: Tag = Tag(*b"STRK");

pub(super) fn invalid(field: &'static str, wanted: &'static str, found: impl ToString) -> ReadError {
    ReadError::Invalid { section: TAG, offset: None, field, wanted, found: found.to_string() }
}

/// Nearest integer in [low, high]; not-a-number gives the end nearer to zero.
pub(super) fn nearest(value: f64, low: i64, high: i64) -> i64 {
    if value.is_nan() {
        return 0.clamp(low, high);
    }
    (value.round() as i64).clamp(low, high)
}

/// A number on a logarithmic lattice: 2^(code / steps + first), code 0 to 255.
#[derive(Clone, Copy)]
pub(super) struct LogLattice {
    /// Codes per doubling.
    pub steps: f64,
    /// Base-2 logarithm of the value of code 0.
    pub first: f64,
}

impl LogLattice {
    pub(super) fn code(self, value: f64) -> u8 {
        let octaves = libm::log2(value.max(f64::MIN_POSITIVE)) - self.first;
        nearest(octaves * self.steps, 0, 255) as u8
    }

    pub(super) fn value(self, code: u8) -> f64 {
        libm::exp2(f64::from(code) / self.steps + self.first)
    }
}

/// Reads little-endian integers from the front of bytes; every read is checked.
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    pub(super) fn take(&mut self, count: usize) -> Result<&'a [u8], ReadError> {
        let left = self.bytes.len() - self.at;
        if count > left {
            return Err(ReadError::Truncated {
                section: TAG,
                offset: self.bytes.len() as u64,
                missing: (count - left) as u64,
            });
        }
        let taken = &self.bytes[self.at..self.at + count];
        self.at += count;
        Ok(taken)
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], ReadError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    pub(super) fn u8(&mut self) -> Result<u8, ReadError> {
        Ok(u8::from_le_bytes(self.array()?))
    }

    pub(super) fn i8(&mut self) -> Result<i8, ReadError> {
        Ok(i8::from_le_bytes(self.array()?))
    }

    pub(super) fn u16(&mut self) -> Result<u16, ReadError> {
        Ok(u16::from_le_bytes(self.array()?))
    }

    pub(super) fn i16(&mut self) -> Result<i16, ReadError> {
        Ok(i16::from_le_bytes(self.array()?))
    }

    /// A stored single-precision number; refused unless finite.
    pub(super) fn finite(&mut self, field: &'static str) -> Result<f64, ReadError> {
        let value = f32::from_le_bytes(self.array()?);
        if !value.is_finite() {
            return Err(invalid(field, "a finite number", value));
        }
        Ok(f64::from(value))
    }

    /// Refuses bytes left over.
    pub(super) fn finish(self) -> Result<(), ReadError> {
        let left = self.bytes.len() - self.at;
        if left != 0 {
            return Err(invalid("pool", "no byte after the last pattern", format!("{left} more")));
        }
        Ok(())
    }
}
