//! Frames: pictures that are changed and written again as they came, with their kind, bit depth, transfer curve and alpha.

use super::layer::{exr_channel, exr_storage};
use super::transfer::{Curve, Transfer};
use super::{PNG_WORKING_BYTES, check_size, is_exr, is_png, rgb_of};
use crate::error::BakeError;
use crate::input::Input;
use crate::picture::{encode_named_channels, encoding_error};
use rayon::prelude::*;
use squall_runtime::picture::Picture;
use std::borrow::Cow;
use std::io::Cursor;

/// Kind of a frame's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameKind {
    /// PNG: samples of a transfer curve.
    Png,
    /// OpenEXR: light.
    Exr,
}

/// A frame, read: linear light, and how to write it as it came.
#[derive(Clone, Debug)]
pub struct FramePicture {
    /// Linear light, row 0 on top. A PNG's colours are not multiplied by its alpha.
    pub picture: Picture,
    /// How samples stand for light, in words.
    pub how: String,
    /// Whether the file leaves that open.
    pub assumed: bool,
    coding: Coding,
}

/// How a frame's file holds it.
#[derive(Clone, Debug)]
struct Coding {
    kind: FrameKind,
    /// 16 bits a sample, where a PNG has 8 or an EXR 32 otherwise.
    sixteen: bool,
    curve: Transfer,
    /// Colour chunks to write again.
    chunks: ColourChunks,
    /// Whether the file has one channel for all colours.
    grey: bool,
    /// Alpha, one a pixel: 0 to 1.
    alpha: Option<Vec<f32>>,
}

/// What a PNG says of its colours.
#[derive(Clone, Debug, Default)]
struct ColourChunks {
    srgb: Option<png::SrgbRenderingIntent>,
    gamma: Option<png::ScaledFloat>,
    chromaticities: Option<png::SourceChromaticities>,
    profile: Option<Vec<u8>>,
    code_points: Option<[u8; 4]>,
}

/// The frame of a file that was read already.
///
/// A PNG's samples become light as its cICP, iCCP, sRGB or gAMA chunk says, and as sRGB where there is none.
///
/// Errors: as [`rgb_of`]; an EXR with light below 0 is none.
pub fn frame_of(input: &Input) -> Result<FramePicture, BakeError> {
    if is_png(input) {
        return read_png(input);
    }
    if !is_exr(input) {
        return Err(BakeError::input(&input.path, "format", "a PNG or OpenEXR picture", input.kind()));
    }
    let taken = rgb_of(input, None)?;
    let (sixteen, alpha) = exr_storage(input)?;
    let alpha = match alpha {
        Some(name) => {
            let (_, _, values) = exr_channel(input, |names| names.contains(&name).then(|| name.clone()))?;
            Some(values).filter(|values| values.len() == taken.picture.pixels.len())
        }
        None => None,
    };
    let coding = Coding {
        kind: FrameKind::Exr,
        sixteen,
        curve: Transfer::Linear,
        chunks: ColourChunks::default(),
        grey: false,
        alpha,
    };
    Ok(FramePicture { picture: taken.picture, how: taken.how, assumed: false, coding })
}

fn read_png(input: &Input) -> Result<FramePicture, BakeError> {
    let path = input.path.as_path();
    let damaged =
        |error: png::DecodingError| BakeError::input(path, "PNG", "a whole, undamaged picture", error);
    let file = Cursor::new(input.bytes.as_slice());
    let mut decoder = png::Decoder::new_with_limits(file, png::Limits { bytes: PNG_WORKING_BYTES });
    decoder.set_transformations(png::Transformations::EXPAND);
    let header = decoder.read_header_info().map_err(damaged)?;
    check_size(path, header.width.into(), header.height.into())?;
    let mut reader = decoder.read_info().map_err(damaged)?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    let (kind, bits) = reader.output_color_type();
    let sixteen = bits == png::BitDepth::Sixteen;
    let Curve { curve, how, assumed } = Curve::of_frame(path, reader.info())?;
    let chunks = ColourChunks::of(reader.info());
    let channels = kind.samples();
    let mut bytes = vec![0; width * height * channels * if sixteen { 2 } else { 1 }];
    reader.next_frame(&mut bytes).map_err(damaged)?;
    let top = if sixteen { 65_535u32 } else { 255 };
    let light: Vec<f32> =
        (0..=top).map(|step| curve.light(f64::from(step) / f64::from(top)) as f32).collect();
    let sample = |at: usize| match sixteen {
        true => usize::from(u16::from_be_bytes([bytes[2 * at], bytes[2 * at + 1]])),
        false => usize::from(bytes[at]),
    };
    let (grey, has_alpha) = (channels < 3, channels % 2 == 0);
    let mut picture = Picture::new(width, height)?;
    for (i, pixel) in picture.pixels.iter_mut().enumerate() {
        for (band, out) in pixel.iter_mut().enumerate() {
            *out = light[sample(i * channels + if grey { 0 } else { band })];
        }
    }
    let alpha = has_alpha.then(|| {
        let of = |i: usize| sample((i + 1) * channels - 1) as f32 / top as f32;
        (0..width * height).map(of).collect()
    });
    let coding = Coding { kind: FrameKind::Png, sixteen, curve, chunks, grey, alpha };
    Ok(FramePicture { picture, how, assumed, coding })
}

impl ColourChunks {
    fn of(info: &png::Info<'_>) -> Self {
        let code_points = info.coding_independent_code_points.map(|points| {
            let range = u8::from(points.is_video_full_range_image);
            [points.color_primaries, points.transfer_function, points.matrix_coefficients, range]
        });
        Self {
            srgb: info.srgb,
            gamma: info.gama_chunk,
            chromaticities: info.chrm_chunk,
            profile: info.icc_profile.as_ref().map(|profile| profile.to_vec()),
            code_points,
        }
    }
}

impl FramePicture {
    /// Kind of the file that it came in.
    pub fn kind(&self) -> FrameKind {
        self.coding.kind
    }

    /// Bytes of a file with `picture` in place of what was read: a PNG as the one that came, where one came, else 16-bit sRGB; an EXR with
    /// floats as long as those that came. Light that a PNG cannot hold is cut.
    ///
    /// Errors: none that a picture of the frame's own size brings about.
    pub fn encode(&self, picture: &Picture, kind: FrameKind) -> std::io::Result<Vec<u8>> {
        match kind {
            FrameKind::Png => self.encode_png(picture),
            FrameKind::Exr => {
                let band = |band: usize| picture.pixels.iter().map(|pixel| pixel[band]).collect();
                let mut channels = vec![("R", band(0)), ("G", band(1)), ("B", band(2))];
                // OpenEXR holds colours that alpha was multiplied into; a PNG's were not.
                let straight = self.coding.kind == FrameKind::Png;
                if let Some(alpha) = &self.coding.alpha {
                    if straight {
                        for (_, values) in &mut channels {
                            let values: &mut Vec<f32> = values;
                            values.iter_mut().zip(alpha).for_each(|(value, alpha)| *value *= alpha);
                        }
                    }
                    channels.push(("A", alpha.clone()));
                }
                let half = self.coding.sixteen && !straight;
                encode_named_channels((picture.width, picture.height), channels, half)
            }
        }
    }

    fn encode_png(&self, picture: &Picture) -> std::io::Result<Vec<u8>> {
        let Coding { kind, alpha, .. } = &self.coding;
        // Of an EXR, whose light was multiplied by alpha, a PNG shows what it shows over black.
        let came = *kind == FrameKind::Png;
        let sixteen = self.coding.sixteen || !came;
        let curve = if came { self.coding.curve } else { Transfer::Srgb };
        let alpha = alpha.as_ref().filter(|_| came);
        let grey = self.coding.grey && picture.pixels.iter().all(|[r, g, b]| r == g && g == b);
        let bands = if grey { 1 } else { 3 };
        let channels = bands + usize::from(alpha.is_some());
        let top = if sixteen { 65_535.0 } else { 255.0 };
        let bytes_each = if sixteen { 2 } else { 1 };
        let mut bytes = vec![0u8; picture.pixels.len() * channels * bytes_each];
        let steps = |value: f64| (value * top + 0.5) as u16;
        bytes.par_chunks_mut(channels * bytes_each).with_min_len(4096).enumerate().for_each(|(i, out)| {
            for (channel, out) in out.chunks_mut(bytes_each).enumerate() {
                let value = match (channel < bands, alpha) {
                    (true, _) => steps(curve.sample(f64::from(picture.pixels[i][channel]))),
                    (false, Some(alpha)) => steps(f64::from(alpha[i])),
                    (false, None) => 0,
                };
                if sixteen { out.copy_from_slice(&value.to_be_bytes()) } else { out[0] = value as u8 }
            }
        });
        let mut info = png::Info::with_size(picture.width as u32, picture.height as u32);
        info.color_type = match (grey, alpha.is_some()) {
            (true, false) => png::ColorType::Grayscale,
            (true, true) => png::ColorType::GrayscaleAlpha,
            (false, false) => png::ColorType::Rgb,
            (false, true) => png::ColorType::Rgba,
        };
        info.bit_depth = if sixteen { png::BitDepth::Sixteen } else { png::BitDepth::Eight };
        let chunks = &self.coding.chunks;
        if came {
            info.srgb = chunks.srgb;
            info.source_gamma = chunks.gamma;
            info.gama_chunk = chunks.gamma;
            info.source_chromaticities = chunks.chromaticities;
            info.chrm_chunk = chunks.chromaticities;
            // A profile of greys says nothing about colours.
            info.icc_profile = chunks.profile.clone().filter(|_| grey == self.coding.grey).map(Cow::Owned);
        } else {
            info.srgb = Some(png::SrgbRenderingIntent::Perceptual);
        }
        let mut out = Vec::new();
        let encoder = png::Encoder::with_info(&mut out, info).map_err(encoding_error)?;
        let mut writer = encoder.write_header().map_err(encoding_error)?;
        if let Some(points) = chunks.code_points.filter(|_| came) {
            writer.write_chunk(png::chunk::ChunkType(*b"cICP"), &points).map_err(encoding_error)?;
        }
        writer.write_image_data(&bytes).map_err(encoding_error)?;
        writer.finish().map_err(encoding_error)?;
        Ok(out)
    }
}

#[cfg(test)]
mod tests;
