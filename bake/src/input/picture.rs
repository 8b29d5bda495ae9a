//! Pictures: PNG of any colour type and depth, OpenEXR with RGB or Y.
//!
//! A picture is what it shows over black, in linear light. PNG holds straight alpha, which multiplies; OpenEXR holds
//! colour that alpha was multiplied into already, which is taken as it is. Sizes are checked before anything is
//! allocated, and every sample is checked before it is used.

pub mod frame;
mod layer;
mod note;
mod transfer;

use super::{Input, MAX_PICTURE_BYTES};
use crate::error::BakeError;
pub use layer::exr_channel;
pub use note::note_of;
use squall_runtime::picture::Picture;
use std::io::Cursor;
use std::path::Path;
use transfer::Curve;
pub use transfer::srgb_to_linear;

/// Most pixels of a picture: 8192 × 8192.
pub const MAX_PIXELS: u64 = 1 << 26;
const PNG_SIGNATURE: [u8; 8] = *b"\x89PNG\r\n\x1a\n";
const EXR_SIGNATURE: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
/// What a PNG decoder may allocate beside the picture itself: ancillary chunks and a row.
const PNG_WORKING_BYTES: usize = 64 << 20;
/// Luminance of linear Rec. 709 primaries.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Linear grey, row 0 = top, x fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Grey {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `width * height` values, none negative, the largest 1.
    pub pixels: Vec<f32>,
}

/// A picture as it was read, and how its samples became light.
#[derive(Clone, Debug)]
pub struct Taken<T> {
    /// The picture.
    pub picture: T,
    /// How it was taken, in words: its transfer curve and what says so, or its layer.
    pub how: String,
    /// Whether the file leaves that open, so that it is an assumption.
    pub assumed: bool,
}

/// Reads a picture as linear grey scaled to a peak of 1, whole: the input of a streak fit.
///
/// Errors: [`rgb_of`]'s, a negative sample, a picture without light.
pub fn read_grey(path: &Path) -> Result<Grey, BakeError> {
    Ok(grey_of(&picture_file(path)?, None)?.picture)
}

/// Reads a picture's file, of at most 2 GiB. Of a file that is no picture by its first bytes, nothing else is read.
///
/// Errors: no such file, a longer one, the system's refusal.
pub fn picture_file(path: &Path) -> Result<Input, BakeError> {
    let is_picture = |start: &[u8]| start.starts_with(&PNG_SIGNATURE) || start.starts_with(&EXR_SIGNATURE);
    Input::read_if(path, MAX_PICTURE_BYTES, is_picture)
}

/// The grey picture, scaled to a peak of 1, of a file that was read already. Colours count with Rec. 709 luminance. `layer` names
/// a layer of an EXR.
///
/// Errors: [`rgb_of`]'s, a negative sample, a picture without light.
pub fn grey_of(input: &Input, layer: Option<&str>) -> Result<Taken<Grey>, BakeError> {
    let path = input.path.as_path();
    let Taken { picture: colour, how, assumed } = rgb_of(input, layer)?;
    let mut grey = Vec::with_capacity(colour.pixels.len());
    let mut peak = 0.0;
    for (i, pixel) in colour.pixels.iter().enumerate() {
        if pixel.iter().any(|&sample| sample < 0.0) {
            let place = format!("pixel ({}, {})", i % colour.width, i / colour.width);
            return Err(BakeError::input(path, place, "light of 0 or more", format!("{pixel:?}")));
        }
        let light: f64 = pixel.iter().zip(LUMINANCE).map(|(&sample, share)| f64::from(sample) * share).sum();
        peak = f64::max(peak, light);
        grey.push(light);
    }
    if peak <= 0.0 {
        return Err(BakeError::input(path, "picture", "some light", "every pixel black or transparent"));
    }
    let pixels = grey.iter().map(|light| (light / peak) as f32).collect();
    Ok(Taken { picture: Grey { width: colour.width, height: colour.height, pixels }, how, assumed })
}

/// The picture in linear RGB, as it shows over black, of a file that was read already.
///
/// A PNG's samples become light as its cICP, iCCP, sRGB or gAMA chunk says, the first of these that it has; samples of one
/// without are taken as they are stored, because streak pictures are data. An EXR gives the layer called `layer`, its data window
/// alone; negative samples pass, as filters of renderers make them.
///
/// Errors: no PNG and no EXR by its first bytes, damaged or cut short, empty, above [`MAX_PIXELS`], deep or
/// subsampled EXR, samples that are no finite numbers, a layer that is not there, several layers and none named, a transfer curve
/// that this build does not know.
pub fn rgb_of(input: &Input, layer: Option<&str>) -> Result<Taken<Picture>, BakeError> {
    let path = input.path.as_path();
    if input.bytes.starts_with(&PNG_SIGNATURE) {
        if let Some(layer) = layer {
            let wanted = "an OpenEXR picture with layers";
            return Err(BakeError::input(path, "layer", wanted, format!("a PNG, for layer \"{layer}\"")));
        }
        return read_png(input);
    }
    if input.bytes.starts_with(&EXR_SIGNATURE) {
        return layer::read_exr(input, layer);
    }
    Err(BakeError::input(path, "format", "a PNG or OpenEXR picture", input.kind()))
}

/// Whether a file is a PNG by its first bytes.
pub fn is_png(input: &Input) -> bool {
    input.bytes.starts_with(&PNG_SIGNATURE)
}

/// Whether a file is an OpenEXR picture by its first bytes.
pub fn is_exr(input: &Input) -> bool {
    input.bytes.starts_with(&EXR_SIGNATURE)
}

fn check_size(path: &Path, width: u64, height: u64) -> Result<(), BakeError> {
    match width.checked_mul(height) {
        Some(1..=MAX_PIXELS) => Ok(()),
        _ => {
            let found = format!("{width} × {height}");
            Err(BakeError::input(path, "picture size", format!("1 to {MAX_PIXELS} pixels"), found))
        }
    }
}

fn read_png(input: &Input) -> Result<Taken<Picture>, BakeError> {
    let path = input.path.as_path();
    let damaged =
        |error: png::DecodingError| BakeError::input(path, "PNG", "a whole, undamaged picture", error);
    let file = Cursor::new(input.bytes.as_slice());
    let mut decoder = png::Decoder::new_with_limits(file, png::Limits { bytes: PNG_WORKING_BYTES });
    // Palettes become colours, a transparent colour becomes alpha, fewer than 8 bits become 8.
    decoder.set_transformations(png::Transformations::EXPAND);
    let header = decoder.read_header_info().map_err(damaged)?;
    check_size(path, header.width.into(), header.height.into())?;
    let mut reader = decoder.read_info().map_err(damaged)?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    let wide = reader.output_color_type().1 == png::BitDepth::Sixteen;
    let Curve { curve, how, assumed } = Curve::of(path, reader.info())?;
    let channels = reader.output_color_type().0.samples();
    let size = reader.output_buffer_size();
    let size =
        size.ok_or_else(|| BakeError::input(path, "PNG", "a picture that fits in memory", "a larger one"))?;
    let mut bytes = vec![0; size];
    reader.next_frame(&mut bytes).map_err(damaged)?;

    let depth = if wide { 2 } else { 1 };
    let sample = |at: usize| {
        if wide {
            f64::from(u16::from_be_bytes([bytes[2 * at], bytes[2 * at + 1]])) / 65_535.0
        } else {
            f64::from(bytes[at]) / 255.0
        }
    };
    debug_assert_eq!(bytes.len(), width * height * channels * depth);
    let mut picture = Picture::new(width, height)?;
    for (i, pixel) in picture.pixels.iter_mut().enumerate() {
        let at = i * channels;
        let alpha = if channels % 2 == 0 { sample(at + channels - 1) } else { 1.0 };
        for (c, out) in pixel.iter_mut().enumerate() {
            let colour = if channels > 2 { c } else { 0 };
            *out = (curve.light(sample(at + colour)) * alpha) as f32;
        }
    }
    Ok(Taken { picture, how, assumed })
}

#[cfg(test)]
mod tests;
