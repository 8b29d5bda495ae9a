//! NumPy's array files (.npy) of 32-bit floats, version 1.

use std::io::{self, Write};

/// Writes `values`, the first axis of `shape` fastest (Fortran's order).
///
/// Errors: the writer's.
pub fn write_npy(
    shape: &[usize],
    values: impl Iterator<Item = f32>,
    out: &mut (impl Write + ?Sized),
) -> io::Result<()> {
    let sides: Vec<String> = shape.iter().map(usize::to_string).collect();
    let shape = sides.join(", ") + if sides.len() == 1 { "," } else { "" };
    let mut header = format!("{{'descr': '<f4', 'fortran_order': True, 'shape': ({shape}), }}");
    // Numbers begin at a multiple of 64 bytes, behind a new line.
    let start = 10;
    let padded = (start + header.len() + 1).next_multiple_of(64) - start;
    header.extend(std::iter::repeat_n(' ', padded - header.len() - 1));
    header.push('\n');
    out.write_all(b"\x93NUMPY\x01\x00")?;
    out.write_all(&(padded as u16).to_le_bytes())?;
    out.write_all(header.as_bytes())?;
    for value in values {
        out.write_all(&value.to_le_bytes())?;
    }
    Ok(())
}
