//! A contact sheet to look at: each picture, its fit and their difference, side by side.

use super::{Grey, draw};
use squall_formats::section::streak::StreakPattern;
use std::io::Write;

/// Pixels between pictures.
const GAP: usize = 6;
/// Grey of the sheet behind the pictures.
const BACKGROUND: f32 = 0.04;
/// A difference of ± this much is black or white.
const DIFFERENCE_RANGE: f32 = 0.25;

/// Source, fit and difference (mid-grey is none) of every pair, top-aligned, display-encoded, 0 to 1.
pub fn contact_sheet(pictures: &[Grey], patterns: &[StreakPattern]) -> Grey {
    let mut columns = Vec::new();
    for (picture, pattern) in pictures.iter().zip(patterns) {
        let fit = draw(&pattern.pattern, picture.width, picture.height);
        let pairs = picture.pixels.iter().zip(&fit.pixels);
        let difference =
            pairs.map(|(a, b)| (0.5 + 0.5 * (a - b) / DIFFERENCE_RANGE).clamp(0.0, 1.0)).collect();
        columns.push(encode(picture));
        columns.push(encode(&fit));
        columns.push(Grey { pixels: difference, ..*picture });
    }
    sheet(&columns)
}

/// Pictures side by side, top-aligned; values as they are.
pub fn sheet(columns: &[Grey]) -> Grey {
    let width = columns.iter().map(|column| column.width + GAP).sum::<usize>() + GAP;
    let height = columns.iter().map(|column| column.height).max().unwrap_or(0) + 2 * GAP;
    let background = encode_light(BACKGROUND);
    let mut out = Grey { width, height, pixels: vec![background; width * height] };
    let mut left = GAP;
    for column in columns {
        for (y, row) in column.pixels.chunks_exact(column.width).enumerate() {
            out.pixels[(y + GAP) * width + left..][..column.width].copy_from_slice(row);
        }
        left += column.width + GAP;
    }
    out
}

/// A picture with the display's gamma of 2.2.
pub fn encode(picture: &Grey) -> Grey {
    Grey { pixels: picture.pixels.iter().map(|&light| encode_light(light)).collect(), ..*picture }
}

fn encode_light(light: f32) -> f32 {
    libm::powf(light.clamp(0.0, 1.0), 1.0 / 2.2)
}

/// Writes values from 0 to 1 as an 8-bit grey PNG.
pub fn write_png8(picture: &Grey, out: &mut impl Write) -> std::io::Result<()> {
    let bytes: Vec<u8> = picture.pixels.iter().map(|&value| (value * 255.0).round() as u8).collect();
    write_png(picture, png::BitDepth::Eight, (None, None), &bytes, out)
}

/// Writes values from 0 to 1 as a 16-bit grey PNG, linear, with `text` as its description.
pub fn write_png16(
    picture: &Grey,
    text: &str,
    notes: Option<&str>,
    out: &mut impl Write,
) -> std::io::Result<()> {
    let sample = |value: &f32| ((value.clamp(0.0, 1.0) * 65_535.0).round() as u16).to_be_bytes();
    let bytes: Vec<u8> = picture.pixels.iter().flat_map(sample).collect();
    write_png(picture, png::BitDepth::Sixteen, (Some(text), notes), &bytes, out)
}

fn write_png(
    picture: &Grey,
    depth: png::BitDepth,
    (text, notes): (Option<&str>, Option<&str>),
    bytes: &[u8],
    out: &mut impl Write,
) -> std::io::Result<()> {
    let mut encoder = png::Encoder::new(out, picture.width as u32, picture.height as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(depth);
    encoder.set_compression(png::Compression::High);
    if let Some(text) = text {
        encoder.add_text_chunk("Description".into(), text.into())?;
    }
    if let Some(notes) = notes {
        encoder.add_text_chunk(crate::input::streak_notes::KEYWORD.into(), notes.into())?;
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()?;
    Ok(())
}
