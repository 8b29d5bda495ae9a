//! Codes of a map's cells: differences from the cell before, a byte where they are small.

/// A row's first cell is told from the cell below it, every other from the one on its left; the first of all from 0.
fn told_from(codes: &[u16], at: usize, width: usize) -> u16 {
    match (at % width, at) {
        (0, 0) => 0,
        (0, _) => codes[at - width],
        _ => codes[at - 1],
    }
}

/// Bytes of codes in rows of `width`: the difference d from the code told from, modulo 2¹⁶, as 2d or −2d − 1, in groups of seven bits, the
/// lowest first, with the eighth bit set where more follow.
pub fn encode(codes: &[u16], width: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(codes.len() + codes.len() / 4);
    for (at, code) in codes.iter().enumerate() {
        let difference = code.wrapping_sub(told_from(codes, at, width)) as i16;
        let mut word = ((difference << 1) ^ (difference >> 15)) as u16;
        while word > 0x7F {
            bytes.push(word as u8 | 0x80);
            word >>= 7;
        }
        bytes.push(word as u8);
    }
    bytes
}

/// Codes of bytes. Takes no more memory than two bytes a byte.
///
/// Errors: too few or too many bytes for so many cells, a group that says too much.
pub fn decode(bytes: &[u8], [width, height]: [usize; 2]) -> Result<Vec<u16>, &'static str> {
    let Some(cells) = width.checked_mul(height).filter(|cells| *cells <= bytes.len()) else {
        return Err("at least a byte a cell");
    };
    let mut codes = Vec::with_capacity(cells);
    let mut rest = bytes.iter();
    for at in 0..cells {
        let mut word = 0u32;
        let mut shift = 0;
        loop {
            let byte = *rest.next().ok_or("as many differences as cells")?;
            word |= u32::from(byte & 0x7F) << shift;
            shift += 7;
            if byte & 0x80 == 0 {
                break;
            }
            if shift > 14 {
                return Err("differences of 16 bits");
            }
        }
        let word = u16::try_from(word).map_err(|_| "differences of 16 bits")?;
        let difference = (word >> 1) ^ (word & 1).wrapping_neg();
        codes.push(told_from(&codes, at, width).wrapping_add(difference));
    }
    if rest.next().is_some() {
        return Err("as many differences as cells");
    }
    Ok(codes)
}
