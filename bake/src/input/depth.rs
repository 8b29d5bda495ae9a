//! Depth of frames: OpenEXR, 16-bit PNG, NumPy arrays; along the viewing axis, along each pixel's ray, or as disparities of a pair.
//!
//! | form | metres |
//! |---|---|
//! | 16-bit PNG, .npy of u2 | value / S |
//! | EXR, .npy of f4 and f8 | value · S |
//! | disparity | baseline · fx / pixels, pixels by the row above |

use super::npy::{Number, is_npy, read_npy};
use super::picture::{MAX_PIXELS, exr_channel, is_exr, is_png};
use super::{Input, MAX_PICTURE_BYTES};
use crate::error::BakeError;
use serde::{Deserialize, Serialize};
use squall_runtime::depth::DepthKind;
use std::io::Cursor;
use std::path::Path;

/// What the numbers of a depth file measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DepthForm {
    /// Along the viewing axis: z buffers and depth cameras.
    #[default]
    Planar,
    /// Along each pixel's own ray: ray tracers and laser scanners.
    Ray,
    /// Pixels between the places of a point in both pictures of a pair.
    Disparity,
}

/// How to read a depth file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DepthReading {
    /// What its numbers measure.
    pub form: DepthForm,
    /// S of the table above. Floats are metres or pixels without it; integers say nothing without it.
    pub scale: Option<f64>,
    /// Distance between the cameras of a pair times focal length, m px: what a disparity needs.
    pub baseline_focal: f64,
}

/// A depth file, read.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthFile {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Metres, row 0 on top; +∞ is sky; 0 and NaN are holes.
    pub metres: Vec<f32>,
    /// What they measure: a disparity gives planar depth.
    pub kind: DepthKind,
}

/// What a PNG decoder may allocate beside the picture itself.
const PNG_WORKING_BYTES: usize = 64 << 20;

/// Reads a file that may be a depth. Of one that is none by its first bytes, nothing else is read.
///
/// Errors: no such file, one of more than 2 GiB.
pub fn depth_file(path: &Path) -> Result<Input, BakeError> {
    let may_be = |start: &[u8]| {
        let start = Input { path: path.to_owned(), bytes: start.to_vec() };
        is_png(&start) || is_exr(&start) || is_npy(&start)
    };
    Input::read_if(path, MAX_PICTURE_BYTES, may_be)
}

/// Metres of a depth file that was read already.
///
/// Errors: no EXR, PNG or .npy by its first bytes, damaged or cut short; a PNG that is not 16-bit grey; an EXR without a channel that
/// can be depth; integers without a scale; a scale that is not above 0; nothing but holes.
pub fn depth_of(input: &Input, reading: &DepthReading) -> Result<DepthFile, BakeError> {
    let path = input.path.as_path();
    if let Some(scale) = reading.scale
        && !(scale > 0.0 && scale.is_finite())
    {
        return Err(BakeError::input(path, "--depth-scale", "a number above 0", scale));
    }
    let (width, height, whole, values) = if is_png(input) {
        let (width, height, values) = png_values(input)?;
        (width, height, true, values)
    } else if is_exr(input) {
        let (width, height, values) = exr_channel(input, depth_channel)?;
        (width, height, false, values.into_iter().map(f64::from).collect())
    } else if is_npy(input) {
        let array = read_npy(input)?;
        (array.width, array.height, array.number == Number::U16, array.values)
    } else {
        let wanted = "a depth: OpenEXR, 16-bit PNG or .npy";
        return Err(BakeError::input(path, "format", wanted, input.kind()));
    };
    let factor = match (whole, reading.scale) {
        (true, Some(scale)) => 1.0 / scale,
        (true, None) => {
            let wanted = "--depth-scale: how many of its steps are one metre or pixel (KITTI and Cityscapes 256, TUM 5000, millimetres 1000)";
            return Err(BakeError::input(path, "depth", wanted, "integers without a scale"));
        }
        (false, scale) => scale.unwrap_or(1.0),
    };
    let metres: Vec<f32> = values.iter().map(|value| metres(value * factor, reading)).collect();
    if !metres.iter().any(|&value| value > 0.0) {
        return Err(BakeError::input(
            path,
            "depth",
            "some pixel with a depth",
            "holes alone (0, negative or NaN)",
        ));
    }
    let kind = if reading.form == DepthForm::Ray { DepthKind::Range } else { DepthKind::Planar };
    Ok(DepthFile { width, height, metres, kind })
}

fn metres(value: f64, reading: &DepthReading) -> f32 {
    // Holes are 0 whatever they were; beyond single precision is as far as the sky.
    match reading.form {
        _ if value.is_nan() || value <= 0.0 => 0.0,
        DepthForm::Disparity => (reading.baseline_focal / value) as f32,
        DepthForm::Planar | DepthForm::Ray => value as f32,
    }
}

/// Values of a 16-bit grey PNG.
fn png_values(input: &Input) -> Result<(usize, usize, Vec<f64>), BakeError> {
    let path = input.path.as_path();
    let damaged =
        |error: png::DecodingError| BakeError::input(path, "PNG", "a whole, undamaged picture", error);
    let file = Cursor::new(input.bytes.as_slice());
    let mut decoder = png::Decoder::new_with_limits(file, png::Limits { bytes: PNG_WORKING_BYTES });
    decoder.set_transformations(png::Transformations::IDENTITY);
    let header = decoder.read_header_info().map_err(damaged)?;
    let (width, height) = (header.width, header.height);
    let count = u64::from(width) * u64::from(height);
    if count > MAX_PIXELS {
        let wanted = format!("1 to {MAX_PIXELS} pixels");
        return Err(BakeError::input(path, "picture size", wanted, format!("{width} × {height}")));
    }
    let (colour, depth) = (header.color_type, header.bit_depth);
    if (colour, depth) != (png::ColorType::Grayscale, png::BitDepth::Sixteen) {
        let found = format!("{} bits, {colour:?}", depth as u8);
        return Err(BakeError::input(path, "depth PNG", "16-bit grey", found));
    }
    let mut reader = decoder.read_info().map_err(damaged)?;
    let mut bytes = vec![0; 2 * count as usize];
    reader.next_frame(&mut bytes).map_err(damaged)?;
    let values = bytes.chunks_exact(2).map(|b| f64::from(u16::from_be_bytes([b[0], b[1]]))).collect();
    Ok((width as usize, height as usize, values))
}

/// Which of an EXR's channels is depth: Z, one that ends in .Z, one of a depth layer, a lone Y or any lone channel.
fn depth_channel(names: &[String]) -> Option<String> {
    let exact = |wanted: &str| names.iter().find(|name| name.as_str() == wanted);
    let only = |test: &dyn Fn(&str) -> bool| {
        let mut found = names.iter().filter(|name| test(name));
        found.next().filter(|_| found.next().is_none())
    };
    let of_depth = |name: &str| {
        let lower = name.to_ascii_lowercase();
        lower == "depth"
            || lower.ends_with("depth.v")
            || lower.ends_with("depth.y")
            || lower.ends_with(".depth")
    };
    // A layer of normals has a Z too.
    let named = |name: &str| name.to_ascii_lowercase().ends_with("depth.z");
    let found = exact("Z").or_else(|| only(&named)).or_else(|| only(&|name| name.ends_with(".Z")));
    let found = found.or_else(|| only(&of_depth)).or_else(|| exact("Y")).or_else(|| exact("V"));
    found.or_else(|| (names.len() == 1).then(|| &names[0])).cloned()
}

#[cfg(test)]
mod tests;
