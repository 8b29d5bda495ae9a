//! Arrays of values as nodes hold them: compressed, and with inactive ones left out.

use super::bytes::Bytes;
use super::tree::Value;
use super::{Read, Refusal};
use flate2::bufread::ZlibDecoder;

/// How a grid's arrays are compressed.
#[derive(Clone, Copy)]
pub(super) struct Compression {
    zip: bool,
    active_mask: bool,
    blosc: bool,
}

impl Compression {
    pub fn read(at: &mut Bytes<'_>) -> Read<Self> {
        let flags = at.u32()?;
        if flags & !7 != 0 {
            return Err(Refusal::new(
                "compression",
                "zip (1), active masks (2), Blosc (4) or sums of them",
                flags,
            ));
        }
        Ok(Self { zip: flags & 1 != 0, active_mask: flags & 2 != 0, blosc: flags & 4 != 0 })
    }

    /// The next `count` bytes of an array, decompressed.
    fn bytes(self, at: &mut Bytes<'_>, count: usize) -> Read<Vec<u8>> {
        if !(self.zip || self.blosc) {
            return Ok(at.take(count)?.to_vec());
        }
        let stored = at.i64()?;
        if stored <= 0 {
            if stored.unsigned_abs() != count as u64 {
                return Err(Refusal::new("array", format!("{count} bytes"), stored.unsigned_abs()));
            }
            return Ok(at.take(count)?.to_vec());
        }
        let short = || Refusal::new("array", "a length within the file", stored);
        let packed = at.take(usize::try_from(stored).map_err(|_| short())?)?;
        if self.blosc { blosc(packed, count) } else { zlib(packed, count) }
    }

    /// Numbers of a type.
    fn numbers(self, at: &mut Bytes<'_>, value: Value, count: usize) -> Read<Vec<f32>> {
        if count == 0 && value == Value::SavedAsHalf {
            return Ok(Vec::new());
        }
        let bytes = self.bytes(at, count * value.stored_bytes())?;
        Ok(bytes.chunks_exact(value.stored_bytes()).map(|bytes| value.stored(bytes)).collect())
    }
}

/// What a node's array says of its inactive values.
mod inactive {
    pub const MINUS_BACKGROUND: u8 = 1;
    pub const ONE: u8 = 2;
    pub const MASK: u8 = 3;
    pub const MASK_AND_ONE: u8 = 4;
    pub const MASK_AND_TWO: u8 = 5;
    pub const ALL_VALUES: u8 = 6;
}

/// Whether the bit of place `at` is set.
pub(super) fn is_on(mask: &[u8], at: usize) -> bool {
    mask[at / 8] >> (at % 8) & 1 == 1
}

fn count_on(mask: &[u8]) -> usize {
    mask.iter().map(|byte| byte.count_ones() as usize).sum()
}

/// A node's values, one for every bit of its mask of active values.
pub(super) fn values(
    at: &mut Bytes<'_>,
    value: Value,
    compression: Compression,
    active: &[u8],
    background: f32,
) -> Read<Vec<f32>> {
    let said = at.u8()?;
    if said > inactive::ALL_VALUES {
        return Err(Refusal::new("inactive values", "0 to 6", said));
    }
    let one = matches!(said, inactive::ONE | inactive::MASK_AND_ONE | inactive::MASK_AND_TWO);
    let mut first = if one { value.full(at)? } else { background };
    if matches!(said, inactive::MINUS_BACKGROUND | inactive::MASK) {
        first = -background;
    }
    let second = if said == inactive::MASK_AND_TWO { value.full(at)? } else { background };
    let masked = (inactive::MASK..=inactive::MASK_AND_TWO).contains(&said);
    let selection = if masked { at.take(active.len())? } else { &[] };
    let all = active.len() * 8;
    if !compression.active_mask || said == inactive::ALL_VALUES {
        return compression.numbers(at, value, all);
    }
    let kept = compression.numbers(at, value, count_on(active))?;
    let mut kept = kept.into_iter();
    let inactive = |place: usize| if masked && is_on(selection, place) { second } else { first };
    Ok((0..all).map(|i| if is_on(active, i) { kept.next().unwrap_or(first) } else { inactive(i) }).collect())
}

/// zlib's stream of exactly `count` bytes.
fn zlib(packed: &[u8], count: usize) -> Read<Vec<u8>> {
    use std::io::Read as _;
    let mut out = Vec::with_capacity(count);
    let read = ZlibDecoder::new(packed).take(count as u64 + 1).read_to_end(&mut out);
    match read {
        Ok(length) if length == count => Ok(out),
        Ok(_) => Err(Refusal::new("zip", format!("an array of {count} bytes"), "another length")),
        Err(error) => Err(Refusal::new("zip", format!("an array of {count} bytes"), error)),
    }
}

/// A chunk of Blosc 1: a header of 16 bytes, where each block lies, blocks of one or several streams, bytes of a type shuffled.
/// Source: c-blosc's README_HEADER.rst and blosc_d.
fn blosc(chunk: &[u8], count: usize) -> Read<Vec<u8>> {
    let bad = |what: &str| Refusal::new("Blosc", format!("a chunk of {count} bytes"), what);
    let mut at = Bytes::new(chunk, 0)?;
    let (_version, _codec_version, flags, size) = (at.u8()?, at.u8()?, at.u8()?, usize::from(at.u8()?));
    let [length, block, _packed] = [at.u32()?, at.u32()?, at.u32()?].map(|number| number as usize);
    if length != count {
        return Err(bad(&format!("one of {length}")));
    }
    if flags & 2 != 0 {
        return Ok(at.take(count)?.to_vec());
    }
    if flags & 4 != 0 {
        return Err(bad("shuffled bits"));
    }
    if block == 0 || size == 0 {
        return Err(bad("blocks of 0 bytes"));
    }
    let mut out = Vec::with_capacity(count);
    for start in (0..count).step_by(block) {
        let place = at.i32()?;
        let here = block.min(count - start);
        // Streams, one a byte of the type, are not made of a block's rest, nor of what is small.
        let split = flags & 16 == 0 && size <= 16 && block / size >= 128 && here == block;
        let streams = if split { size } else { 1 };
        let mut stream =
            Bytes::new(chunk, u64::try_from(place).map_err(|_| bad("a block before its start"))?)?;
        let mut bytes = Vec::with_capacity(here);
        for _ in 0..streams {
            let wanted = here / streams;
            let stored = usize::try_from(stream.i32()?).map_err(|_| bad("a stream below 0 bytes"))?;
            let packed = stream.take(stored)?;
            if stored == wanted {
                bytes.extend_from_slice(packed);
            } else {
                bytes.extend(blosc_stream(flags >> 5, packed, wanted)?);
            }
        }
        if bytes.len() != here {
            return Err(bad("a block that its streams do not fill"));
        }
        if flags & 1 != 0 && size > 1 {
            out.extend(unshuffled(&bytes, size));
        } else {
            out.extend(bytes);
        }
    }
    Ok(out)
}

fn blosc_stream(codec: u8, packed: &[u8], count: usize) -> Read<Vec<u8>> {
    const LZ4: u8 = 1;
    const ZLIB: u8 = 3;
    match codec {
        LZ4 => {
            let mut out = vec![0; count];
            match lz4_flex::block::decompress_into(packed, &mut out) {
                Ok(length) if length == count => Ok(out),
                Ok(length) => Err(Refusal::new("LZ4", format!("{count} bytes"), length)),
                Err(error) => Err(Refusal::new("LZ4", format!("{count} bytes"), error)),
            }
        }
        ZLIB => zlib(packed, count),
        other => {
            let names = ["BloscLZ", "LZ4", "Snappy", "zlib", "Zstandard"];
            let found = names.get(usize::from(other)).copied().unwrap_or("another");
            Err(Refusal::new("Blosc", "LZ4 or zlib within it, as OpenVDB writes it", found))
        }
    }
}

/// First bytes of all values, then second ones, and so on; a rest shorter than a value stands last as it is.
fn unshuffled(bytes: &[u8], size: usize) -> Vec<u8> {
    let count = bytes.len() / size;
    let mut out = vec![0; bytes.len()];
    for at in 0..count {
        for byte in 0..size {
            out[at * size + byte] = bytes[byte * count + at];
        }
    }
    out[count * size..].copy_from_slice(&bytes[count * size..]);
    out
}
