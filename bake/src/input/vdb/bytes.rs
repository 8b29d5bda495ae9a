//! Numbers out of bytes, within bounds.

use super::{Read, Refusal};

/// A place in a file's bytes.
pub(super) struct Bytes<'a> {
    all: &'a [u8],
    at: usize,
}

impl<'a> Bytes<'a> {
    /// Errors: a place beyond the end.
    pub fn new(all: &'a [u8], at: u64) -> Read<Self> {
        let found = || Refusal::new("offset", format!("within the file's {} bytes", all.len()), at);
        let at = usize::try_from(at).ok().filter(|&at| at <= all.len()).ok_or_else(found)?;
        Ok(Self { all, at })
    }

    pub fn position(&self) -> u64 {
        self.at as u64
    }

    /// The next `count` bytes.
    pub fn take(&mut self, count: usize) -> Read<&'a [u8]> {
        let end = self.at.checked_add(count).filter(|&end| end <= self.all.len());
        let Some(end) = end else {
            let wanted = format!("{count} more bytes at byte {}", self.at);
            return Err(Refusal::new("length", wanted, format!("{}", self.all.len() - self.at)));
        };
        let taken = &self.all[self.at..end];
        self.at = end;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Read<[u8; N]> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        Ok(bytes)
    }

    pub fn u8(&mut self) -> Read<u8> {
        Ok(self.array::<1>()?[0])
    }

    pub fn u32(&mut self) -> Read<u32> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub fn i32(&mut self) -> Read<i32> {
        Ok(i32::from_le_bytes(self.array()?))
    }

    pub fn i64(&mut self) -> Read<i64> {
        Ok(i64::from_le_bytes(self.array()?))
    }

    pub fn f64(&mut self) -> Read<f64> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    pub fn vector(&mut self) -> Read<[f64; 3]> {
        Ok([self.f64()?, self.f64()?, self.f64()?])
    }

    pub fn place(&mut self) -> Read<[i32; 3]> {
        Ok([self.i32()?, self.i32()?, self.i32()?])
    }

    /// A text: its length, then its bytes; what is no UTF-8 is shown as such.
    pub fn text(&mut self) -> Read<String> {
        let length = self.u32()? as usize;
        Ok(String::from_utf8_lossy(self.take(length)?).into_owned())
    }
}
