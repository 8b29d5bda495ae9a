//! Pictures: PNG of any colour type and depth, OpenEXR with RGB(A) or Y.
//!
//! Sizes are checked before anything is allocated, and every sample is checked before it is used. Alpha
//! multiplies: a picture is what it shows over black.

use crate::error::BakeError;
use exr::prelude::{ReadChannels, ReadLayers, ReadSpecificChannel};
use squall_runtime::picture::Picture;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

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

/// How a PNG's samples stand for light. EXR is linear by definition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// Samples are proportional to light.
    Linear,
    /// Samples are sRGB-encoded.
    Srgb,
    /// 16 bits are linear, as this project writes them; fewer are sRGB, as cameras and painters write them.
    ByDepth,
}

/// Reads a picture as linear grey scaled to a peak of 1, whole: the input of a streak fit.
///
/// Samples of a PNG are taken as they are stored, whatever its depth or gamma tag: streak pictures are data,
/// and a fit must answer for the numbers it was given. Colours count with Rec. 709 luminance.
///
/// Errors: [`read_rgb`]'s, a negative sample, a picture without light.
pub fn read_grey(path: &Path) -> Result<Grey, BakeError> {
    let colour = read_rgb(path, Transfer::Linear)?;
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
    Ok(Grey { width: colour.width, height: colour.height, pixels })
}

/// Reads a picture as linear RGB, alpha multiplied in. An EXR gives the first layer that has R, G and B or
/// Y, its data window alone; negative samples pass, as filters of renderers make them.
///
/// Errors: no PNG and no EXR by its first bytes, damaged or cut short, empty, above [`MAX_PIXELS`], deep or
/// subsampled EXR, samples that are no finite numbers.
pub fn read_rgb(path: &Path, transfer: Transfer) -> Result<Picture, BakeError> {
    let mut file = BufReader::new(File::open(path).map_err(BakeError::io(path, "open"))?);
    let mut signature = Vec::with_capacity(8);
    file.by_ref().take(8).read_to_end(&mut signature).map_err(BakeError::io(path, "read"))?;
    file.seek(SeekFrom::Start(0)).map_err(BakeError::io(path, "read"))?;
    if signature == PNG_SIGNATURE {
        return read_png(path, file, transfer);
    }
    if signature.starts_with(&EXR_SIGNATURE) {
        return read_exr(path, file);
    }
    let found = format!("a file that starts with {:?}", signature.escape_ascii().to_string());
    Err(BakeError::input(path, "format", "a PNG or OpenEXR picture", found))
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

fn read_png(path: &Path, file: BufReader<File>, transfer: Transfer) -> Result<Picture, BakeError> {
    let damaged = |error: png::DecodingError| match error {
        png::DecodingError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            BakeError::io(path, "read")(source)
        }
        error => BakeError::input(path, "PNG", "a whole, undamaged picture", error),
    };
    let mut decoder = png::Decoder::new_with_limits(file, png::Limits { bytes: PNG_WORKING_BYTES });
    // Palettes become colours, a transparent colour becomes alpha, fewer than 8 bits become 8.
    decoder.set_transformations(png::Transformations::EXPAND);
    let header = decoder.read_header_info().map_err(damaged)?;
    check_size(path, header.width.into(), header.height.into())?;
    let mut reader = decoder.read_info().map_err(damaged)?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    let wide = reader.output_color_type().1 == png::BitDepth::Sixteen;
    let channels = reader.output_color_type().0.samples();
    let size = reader.output_buffer_size();
    let size =
        size.ok_or_else(|| BakeError::input(path, "PNG", "a picture that fits in memory", "a larger one"))?;
    let mut bytes = vec![0; size];
    reader.next_frame(&mut bytes).map_err(damaged)?;

    let curve = match transfer {
        Transfer::Linear => false,
        Transfer::Srgb => true,
        Transfer::ByDepth => !wide,
    };
    let depth = if wide { 2 } else { 1 };
    let sample = |at: usize| {
        if wide {
            f64::from(u16::from_be_bytes([bytes[2 * at], bytes[2 * at + 1]])) / 65_535.0
        } else {
            f64::from(bytes[at]) / 255.0
        }
    };
    let light = |at: usize| if curve { srgb_to_linear(sample(at)) } else { sample(at) };
    debug_assert_eq!(bytes.len(), width * height * channels * depth);
    let mut picture = Picture::new(width, height)?;
    for (i, pixel) in picture.pixels.iter_mut().enumerate() {
        let at = i * channels;
        let alpha = if channels % 2 == 0 { sample(at + channels - 1) } else { 1.0 };
        for (c, out) in pixel.iter_mut().enumerate() {
            let colour = if channels > 2 { c } else { 0 };
            *out = (light(at + colour) * alpha) as f32;
        }
    }
    Ok(picture)
}

/// Light of an sRGB sample (IEC 61966-2-1), both in [0, 1].
pub fn srgb_to_linear(sample: f64) -> f64 {
    if sample <= 0.040_45 { sample / 12.92 } else { libm::pow((sample + 0.055) / 1.055, 2.4) }
}

fn read_exr(path: &Path, file: BufReader<File>) -> Result<Picture, BakeError> {
    let damaged = |error: exr::error::Error| match error {
        exr::error::Error::Io(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            BakeError::io(path, "read")(source)
        }
        error => BakeError::input(path, "EXR", "a whole, undamaged picture", error),
    };
    let chunks = exr::block::read(file, false).map_err(damaged)?;
    if chunks.headers().iter().any(|header| header.deep) {
        return Err(BakeError::input(path, "EXR", "flat pixels", "deep data"));
    }
    let Some((header, colours, alpha)) = chunks.headers().iter().find_map(|header| {
        let names: Vec<String> =
            header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
        usable_channels(&names).map(|(colours, alpha)| (header, colours, alpha))
    }) else {
        let found = chunks.headers().iter().flat_map(|header| &header.channels.list);
        let found = found.map(|channel| channel.name.to_string()).collect::<Vec<_>>().join(", ");
        return Err(BakeError::input(path, "EXR", "a layer with channels R, G and B, or Y", found));
    };
    check_size(path, header.layer_size.0 as u64, header.layer_size.1 as u64)?;
    if header.channels.list.iter().any(|channel| channel.sampling != exr::math::Vec2(1, 1)) {
        return Err(BakeError::input(path, "EXR", "every channel at full resolution", "subsampled channels"));
    }
    let (width, height) = (header.layer_size.0, header.layer_size.1);
    let mut picture = Picture::new(width, height)?;
    let flat = exr::prelude::read().no_deep_data().largest_resolution_level();
    let blank = move || vec![[0.0f32; 4]; width * height];
    let place = move |at: exr::math::Vec2<usize>| at.1 * width + at.0;
    let pixels = match <[String; 3]>::try_from(colours) {
        Ok([r, g, b]) => {
            flat.specific_channels()
                .required(r.as_str())
                .required(g.as_str())
                .required(b.as_str())
                .optional(alpha.as_str(), 1.0f32)
                .collect_pixels(
                    move |_, _| blank(),
                    move |pixels, at, (r, g, b, a): (f32, f32, f32, f32)| {
                        pixels[place(at)] = [r, g, b, a];
                    },
                )
                .first_valid_layer()
                .all_attributes()
                .from_chunks(chunks)
                .map_err(damaged)?
                .layer_data
                .channel_data
                .pixels
        }
        Err(grey) => {
            flat.specific_channels()
                .required(grey[0].as_str())
                .optional(alpha.as_str(), 1.0f32)
                .collect_pixels(
                    move |_, _| blank(),
                    move |pixels, at, (y, a): (f32, f32)| pixels[place(at)] = [y, y, y, a],
                )
                .first_valid_layer()
                .all_attributes()
                .from_chunks(chunks)
                .map_err(damaged)?
                .layer_data
                .channel_data
                .pixels
        }
    };
    for (i, (out, &[r, g, b, a])) in picture.pixels.iter_mut().zip(&pixels).enumerate() {
        let colour = [r * a, g * a, b * a];
        if !colour.iter().all(|sample| sample.is_finite()) {
            let place = format!("pixel ({}, {})", i % width, i / width);
            return Err(BakeError::input(path, place, "finite samples", format!("{:?}", [r, g, b, a])));
        }
        *out = colour;
    }
    Ok(picture)
}

/// Names of the colour channels (three or one) and of the alpha that belongs to them: without a prefix if
/// possible, else those of the first layer prefix ("diffuse.R") that has them.
fn usable_channels(names: &[String]) -> Option<(Vec<String>, String)> {
    let prefixes = names.iter().map(|name| name.rfind('.').map_or("", |dot| &name[..=dot]));
    let has = |name: &String| names.contains(name);
    std::iter::once("").chain(prefixes).find_map(|prefix| {
        let named =
            |letters: &[&str]| letters.iter().map(|letter| format!("{prefix}{letter}")).collect::<Vec<_>>();
        [named(&["R", "G", "B"]), named(&["Y"])]
            .into_iter()
            .find(|channels| channels.iter().all(has))
            .map(|channels| (channels, format!("{prefix}A")))
    })
}

#[cfg(test)]
mod tests;
