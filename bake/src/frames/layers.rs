//! Masks and other layers into files: 16-bit PNG or OpenEXR by the name's end.

use crate::error::BakeError;
use crate::output::write_atomically;
use crate::picture::{encode_named_channels, encoding_error};
use std::io::Write;
use std::path::Path;

/// Bytes of shares in [0, 1], row 0 on top, in the form that the name says: grey 16-bit PNG whose samples are the shares (linear, and
/// said so), or an EXR with channel Y.
///
/// Errors: another end of the name.
pub fn encode_share_file(path: &Path, size: (usize, usize), shares: &[f32]) -> std::io::Result<Vec<u8>> {
    match ending(path).map_err(encoding_error)? {
        Ending::Exr => encode_named_channels(size, vec![("Y", shares.to_vec())], false),
        Ending::Png => encode_shares(size, shares),
    }
}

/// Bytes of light, row 0 on top: an EXR with R, G and B. Errors: a picture without pixels.
pub fn encode_light(size: (usize, usize), light: &[[f32; 3]]) -> std::io::Result<Vec<u8>> {
    let band = |band: usize| light.iter().map(|pixel| pixel[band]).collect();
    encode_named_channels(size, vec![("R", band(0)), ("G", band(1)), ("B", band(2))], false)
}

/// Writes bytes, whole or not at all. Errors: what the system refuses.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), BakeError> {
    write_atomically(path, |out| out.write_all(bytes))
}

/// Kind of a layer's file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ending {
    /// .png
    Png,
    /// .exr
    Exr,
}

/// Kind of the file that a name stands for. Errors: another end than .png and .exr.
pub fn ending(path: &Path) -> Result<Ending, BakeError> {
    let end = path.extension().and_then(|end| end.to_str()).unwrap_or_default().to_ascii_lowercase();
    match end.as_str() {
        "png" => Ok(Ending::Png),
        "exr" => Ok(Ending::Exr),
        _ => {
            let wanted = "a name that ends in .png or .exr";
            Err(BakeError::input(path, "output", wanted, path.display()))
        }
    }
}

fn encode_shares(size: (usize, usize), shares: &[f32]) -> std::io::Result<Vec<u8>> {
    let mut info = png::Info::with_size(size.0 as u32, size.1 as u32);
    (info.color_type, info.bit_depth) = (png::ColorType::Grayscale, png::BitDepth::Sixteen);
    let linear = Some(png::ScaledFloat::from_scaled(100_000));
    (info.source_gamma, info.gama_chunk) = (linear, linear);
    let step = |share: &f32| (f64::from(share.clamp(0.0, 1.0)) * 65_535.0 + 0.5) as u16;
    let bytes: Vec<u8> = shares.iter().flat_map(|share| step(share).to_be_bytes()).collect();
    let mut out = Vec::new();
    let encoder = png::Encoder::with_info(&mut out, info).map_err(encoding_error)?;
    let mut writer = encoder.write_header().map_err(encoding_error)?;
    writer.write_image_data(&bytes).map_err(encoding_error)?;
    writer.finish().map_err(encoding_error)?;
    Ok(out)
}
