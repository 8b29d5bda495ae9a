//! NumPy's array files (.npy): a header in Python's own notation, then the numbers. Read strictly, as far as numbers of pictures and
//! grids need.

use super::Input;
use super::picture::MAX_PIXELS;
use crate::error::BakeError;

const SIGNATURE: [u8; 6] = *b"\x93NUMPY";
/// Longest header read, bytes; one of a plain array has some eighty.
const MAX_HEADER_BYTES: usize = 1 << 16;

/// What an array's numbers are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Number {
    /// 16-bit floats.
    F16,
    /// 32-bit floats.
    F32,
    /// 64-bit floats.
    F64,
    /// 16-bit integers, not negative.
    U16,
}

impl Number {
    fn bytes(self) -> usize {
        match self {
            Self::F16 | Self::U16 => 2,
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// A picture's worth of numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// What the numbers were in the file.
    pub number: Number,
    /// Row 0 first, columns fastest.
    pub values: Vec<f64>,
}

/// Whether the file begins as NumPy's do.
pub fn is_npy(input: &Input) -> bool {
    input.bytes.starts_with(&SIGNATURE)
}

/// Reads an array of rows and columns (a further axis of length 1 is passed over), of f4, f8 or u2 in either byte order.
///
/// Errors: a header that is longer than 64 KiB or not understood, another type or shape, more than [`MAX_PIXELS`] numbers, a file that is
/// not exactly as long as they take.
pub fn read_npy(input: &Input) -> Result<Array, BakeError> {
    let header =
        Header::read(input, &[Number::F32, Number::F64, Number::U16], "f4, f8 or u2, such as '<f4'")?;
    let shape = &header.shape;
    let sides: Vec<u64> = shape.iter().copied().filter(|&side| side != 1).collect();
    let (height, width) = match (shape.as_slice(), sides.as_slice()) {
        (&[height, width], _) | (&[height, width, 1] | &[1, height, width], _) => (height, width),
        _ => return Err(refused(input, "shape", "rows and columns", format!("{shape:?}"))),
    };
    let count = header.checked_count(input, &[height, width], MAX_PIXELS)?;
    let mut values: Vec<f64> = header.values(input, count)?.collect();
    let (width, height) = (width as usize, height as usize);
    if header.by_columns {
        values = (0..count).map(|at| values[at % width * height + at / width]).collect();
    }
    Ok(Array { width, height, number: header.number, values })
}

/// A box of numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Box3 {
    /// Cells along the array's axes 0, 1 and 2.
    pub counts: [usize; 3],
    /// The values, axis 0 fastest, whatever the file's order.
    pub values: Vec<f32>,
}

/// Reads an array of three axes, of f2, f4 or f8 in either byte order, C's or Fortran's; at most `most` numbers.
///
/// Errors: as of [`read_npy`].
pub fn read_npy_box(input: &Input, most: u64) -> Result<Box3, BakeError> {
    let header =
        Header::read(input, &[Number::F16, Number::F32, Number::F64], "f2, f4 or f8, such as '<f4'")?;
    let &[nx, ny, nz] = header.shape.as_slice() else {
        return Err(refused(input, "shape", "three axes: x, y, z", format!("{:?}", header.shape)));
    };
    let count = header.checked_count(input, &[nx, ny, nz], most)?;
    let mut values: Vec<f32> = header.values(input, count)?.map(|value| value as f32).collect();
    let counts = [nx, ny, nz].map(|side| side as usize);
    if !header.by_columns {
        let [nx, ny, nz] = counts;
        let stored = |at: usize| (at % nx * ny + at / nx % ny) * nz + at / (nx * ny);
        values = (0..count).map(|at| values[stored(at)]).collect();
    }
    Ok(Box3 { counts, values })
}

fn refused(input: &Input, field: &str, wanted: impl ToString, found: String) -> BakeError {
    BakeError::input(&input.path, format!("npy {field}"), wanted.to_string(), found)
}

/// What stands before the numbers.
struct Header {
    number: Number,
    big_endian: bool,
    by_columns: bool,
    shape: Vec<u64>,
    /// Bytes before the numbers.
    length: usize,
}

impl Header {
    /// Reads it; numbers are one of `allowed`, in words.
    fn read(input: &Input, allowed: &[Number], words: &str) -> Result<Self, BakeError> {
        let bytes = input.bytes.as_slice();
        let length_bytes = match bytes.get(6..8) {
            Some([1, _]) => 2,
            Some([2 | 3, _]) => 4,
            Some([version, _]) => return Err(refused(input, "version", "1, 2 or 3", version.to_string())),
            _ => return Err(refused(input, "header", "a whole one", "the end of the file".into())),
        };
        let cut = || refused(input, "header", "a whole one", "the end of the file".into());
        let length = bytes.get(8..8 + length_bytes).ok_or_else(cut)?;
        let length = length.iter().rev().fold(0usize, |sum, &byte| sum << 8 | usize::from(byte));
        if length > MAX_HEADER_BYTES {
            return Err(refused(input, "header", "at most 65536 bytes", format!("{length} bytes")));
        }
        let start = 8 + length_bytes;
        let header = bytes.get(start..start + length).ok_or_else(cut)?;
        let header = std::str::from_utf8(header);
        let header =
            header.map_err(|_| refused(input, "header", "text", "bytes that are no UTF-8".into()))?;
        let (descr, by_columns, shape) = parse(header).ok_or_else(|| {
            let shown: String = header.chars().take(120).collect();
            let wanted = "{'descr': …, 'fortran_order': …, 'shape': …}";
            refused(input, "header", wanted, shown.trim_end().to_owned())
        })?;
        let number = match descr.get(1..) {
            Some("f2") => Some(Number::F16),
            Some("f4") => Some(Number::F32),
            Some("f8") => Some(Number::F64),
            Some("u2") => Some(Number::U16),
            _ => None,
        };
        let big_endian = descr.starts_with('>');
        match number.filter(|number| allowed.contains(number) && (big_endian || descr.starts_with('<'))) {
            Some(number) => Ok(Self { number, big_endian, by_columns, shape, length: start + length }),
            None => Err(refused(input, "descr", words, format!("'{descr}'"))),
        }
    }

    /// The product of `sides`, from 1 to `most`.
    fn checked_count(&self, input: &Input, sides: &[u64], most: u64) -> Result<usize, BakeError> {
        let count = sides.iter().try_fold(1u64, |product, &side| product.checked_mul(side));
        count.filter(|count| (1..=most).contains(count)).map(|count| count as usize).ok_or_else(|| {
            let found: Vec<String> = sides.iter().map(u64::to_string).collect();
            refused(input, "shape", format!("1 to {most} numbers"), found.join(" × "))
        })
    }

    /// The numbers, in the file's order.
    fn values<'a>(
        &self,
        input: &'a Input,
        count: usize,
    ) -> Result<impl Iterator<Item = f64> + use<'a>, BakeError> {
        let data = &input.bytes[self.length..];
        let wanted = count * self.number.bytes();
        if data.len() != wanted {
            let found = data.len().to_string();
            return Err(refused(input, "length", format!("{wanted} bytes of numbers"), found));
        }
        let (number, big_endian) = (self.number, self.big_endian);
        Ok(data.chunks_exact(number.bytes()).map(move |bytes| value(number, big_endian, bytes)))
    }
}

fn value(number: Number, big_endian: bool, bytes: &[u8]) -> f64 {
    let mut ordered = [0u8; 8];
    for (i, &byte) in bytes.iter().enumerate() {
        ordered[if big_endian { bytes.len() - 1 - i } else { i }] = byte;
    }
    let [a, b, c, d, ..] = ordered;
    match number {
        Number::F16 => f64::from(half::f16::from_le_bytes([a, b]).to_f32()),
        Number::U16 => f64::from(u16::from_le_bytes([a, b])),
        Number::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
        Number::F64 => f64::from_le_bytes(ordered),
    }
}

/// Type, whether columns come first, and shape, of a header such as `{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }`.
fn parse(header: &str) -> Option<(String, bool, Vec<u64>)> {
    let mut rest = header.trim().strip_prefix('{')?.trim_end().strip_suffix('}')?.trim();
    let (mut descr, mut by_columns, mut shape) = (None, None, None);
    while !rest.is_empty() {
        let (key, after) = quoted(rest)?;
        let after = after.trim_start().strip_prefix(':')?.trim_start();
        rest = match key {
            "descr" if descr.is_none() => {
                let (text, after) = quoted(after)?;
                descr = Some(text.to_owned());
                after
            }
            "fortran_order" if by_columns.is_none() => {
                let (value, after) = match after.strip_prefix("True") {
                    Some(after) => (true, after),
                    None => (false, after.strip_prefix("False")?),
                };
                by_columns = Some(value);
                after
            }
            "shape" if shape.is_none() => {
                let (inside, after) = after.strip_prefix('(')?.split_once(')')?;
                let sides = inside.split(',').map(str::trim).filter(|side| !side.is_empty());
                shape = Some(sides.map(|side| side.parse().ok()).collect::<Option<Vec<u64>>>()?);
                after
            }
            _ => return None,
        };
        rest = rest.trim_start();
        rest = match rest.strip_prefix(',') {
            Some(rest) => rest.trim_start(),
            None if rest.is_empty() => rest,
            None => return None,
        };
    }
    Some((descr?, by_columns?, shape?))
}

/// A text in quotes, and what follows it.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|&c| c == '\'' || c == '"')?;
    text[1..].split_once(quote)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    fn file(header: &str, data: &[u8]) -> Input {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        Input { path: PathBuf::from("a.npy"), bytes }
    }

    fn floats(values: &[f32]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    #[test]
    fn arrays_of_every_type_order_and_layout_hold_the_same_numbers() {
        let wanted = [1.0f64, 2.0, 3.0, 4.0, 5.0, 6.0];
        let shape = "'fortran_order': False, 'shape': (2, 3), }";
        let small = file(&format!("{{'descr': '<f4', {shape}"), &floats(&wanted.map(|v| v as f32)));
        let wide: Vec<u8> = wanted.iter().flat_map(|v| v.to_be_bytes()).collect();
        let wide = file(&format!("{{\"descr\": '>f8', {shape}   \n"), &wide);
        let whole: Vec<u8> = wanted.iter().flat_map(|&v| (v as u16).to_le_bytes()).collect();
        let whole = file(&format!("{{'descr': '<u2', {shape}"), &whole);
        let columns = floats(&[1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
        let columns = file("{'shape': (2, 3, 1), 'fortran_order': True, 'descr': '<f4'}", &columns);
        let mut long = file("", &[]);
        long.bytes = b"\x93NUMPY\x02\x00".to_vec();
        let header = format!("{{'descr': '<f4', {shape}");
        long.bytes.extend((header.len() as u32).to_le_bytes());
        long.bytes.extend(header.as_bytes());
        long.bytes.extend(floats(&wanted.map(|v| v as f32)));
        for input in [small, wide, whole, columns, long] {
            let array = read_npy(&input).unwrap();
            assert_eq!((array.width, array.height, array.values.as_slice()), (3, 2, wanted.as_slice()));
        }
    }

    #[test]
    fn a_file_cut_anywhere_is_refused() {
        let whole = file("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3)}", &floats(&[0.5; 6]));
        assert!(read_npy(&whole).is_ok());
        for length in 0..whole.bytes.len() {
            let cut = Input { bytes: whole.bytes[..length].to_vec(), ..whole.clone() };
            assert!(read_npy(&cut).is_err(), "{length}");
        }
    }

    #[test]
    fn hostile_headers_are_refused_before_memory_is_taken() {
        let of = |descr: &str, shape: &str| {
            file(&format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}}}"), &[0; 24])
        };
        for (input, words) in [
            (of("<f4", "(4294967296, 4294967296)"), "4294967296 × 4294967296"),
            (of("<f4", "(18446744073709551616, 2)"), "{'descr'"),
            (of("<f4", "(0, 3)"), "0 × 3"),
            (of("<f4", "(6,)"), "[6]"),
            (of("<f4", "(2, 3, 4)"), "[2, 3, 4]"),
            (of("<f4", "(2, -3)"), "{'descr'"),
            (of("<i4", "(2, 3)"), "'<i4'"),
            (of("|O", "(2, 3)"), "'|O'"),
            (of("<f4", "(2, 4)"), "32 bytes"),
            (file("{'descr': '<f4'}", &[]), "{'descr'"),
            (file("{'descr': '<f4', 'descr': '<f4'}", &[]), "{'descr'"),
            (file("import os", &[]), "import os"),
        ] {
            let error = read_npy(&input).unwrap_err().to_string();
            assert!(error.contains(words) && error.starts_with("a.npy: npy "), "{error}");
        }
        let mut endless = file("", &[]);
        endless.bytes = b"\x93NUMPY\x03\x00\xff\xff\xff\xff".to_vec();
        assert!(read_npy(&endless).unwrap_err().to_string().contains("65536"));
    }
}
