use super::*;
use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, Layer, WritableImage};
use png::{BitDepth, ColorType};
use std::path::PathBuf;

/// Round-off of a division and a product in single precision.
const ROUND_OFF: f32 = 1e-6;

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

fn png_bytes(
    size: [u32; 2],
    colour: ColorType,
    depth: BitDepth,
    data: &[u8],
    set: impl FnOnce(&mut png::Encoder<&mut Vec<u8>>),
) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, size[0], size[1]);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    set(&mut encoder);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(data).unwrap();
    writer.finish().unwrap();
    bytes
}

fn exr_file(folder: &Folder, size: [usize; 2], channels: &[(&str, Vec<f32>)]) -> PathBuf {
    let path = folder.0.path().join("picture.exr");
    let list = channels.iter().map(|(name, values)| AnyChannel::new(*name, FlatSamples::F32(values.clone())));
    let layer = Layer::new(
        (size[0], size[1]),
        exr::prelude::LayerAttributes::named("layer"),
        exr::prelude::Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(list.collect()),
    );
    Image::from_layer(layer).write().to_file(&path).unwrap();
    path
}

fn refused(result: Result<impl std::fmt::Debug, BakeError>, words: &str) {
    let error = result.unwrap_err();
    assert!(matches!(error, BakeError::Input { .. }), "{error:?}");
    assert_eq!(error.exit_code(), 3);
    assert!(error.to_string().contains(words), "{error}");
}

#[test]
fn every_png_colour_type_and_depth_reads_as_the_same_grey() {
    let folder = Folder::new();
    let plain = |_: &mut png::Encoder<&mut Vec<u8>>| {};
    let eight = [0u8, 51, 102, 255];
    let wide: Vec<u8> = eight.iter().flat_map(|&v| (u16::from(v) * 257).to_be_bytes()).collect();
    let each = |copies: usize, alpha: Option<u8>| -> Vec<u8> {
        eight.iter().flat_map(|&v| std::iter::repeat_n(v, copies).chain(alpha)).collect()
    };
    let palette = |encoder: &mut png::Encoder<&mut Vec<u8>>| {
        encoder.set_palette([0, 0, 0, 51, 51, 51, 102, 102, 102, 255, 255, 255].as_slice());
    };
    let files = [
        ("grey8", png_bytes([2, 2], ColorType::Grayscale, BitDepth::Eight, &eight, plain)),
        ("grey16", png_bytes([2, 2], ColorType::Grayscale, BitDepth::Sixteen, &wide, plain)),
        ("rgb8", png_bytes([2, 2], ColorType::Rgb, BitDepth::Eight, &each(3, None), plain)),
        ("rgba8", png_bytes([2, 2], ColorType::Rgba, BitDepth::Eight, &each(3, Some(255)), plain)),
        ("greya8", png_bytes([2, 2], ColorType::GrayscaleAlpha, BitDepth::Eight, &each(1, Some(255)), plain)),
        // 2 bits: 0, 1, 2, 3 in two rows of one byte each.
        (
            "palette2",
            png_bytes([2, 2], ColorType::Indexed, BitDepth::Two, &[0b0001_0000, 0b1011_0000], palette),
        ),
    ];
    for (name, bytes) in files {
        let grey = read_grey(&folder.write(name, &bytes)).unwrap();
        assert_eq!((grey.width, grey.height), (2, 2));
        for (got, wanted) in grey.pixels.iter().zip([0.0, 0.2, 0.4, 1.0]) {
            assert!((got - wanted).abs() < ROUND_OFF, "{name}: {got} for {wanted}");
        }
    }
}

#[test]
fn alpha_of_any_kind_multiplies() {
    let folder = Folder::new();
    let data = [255, 255, 255, 128, 0, 51];
    let alpha = png_bytes([3, 1], ColorType::GrayscaleAlpha, BitDepth::Eight, &data, |_| {});
    let grey = read_grey(&folder.write("alpha", &alpha)).unwrap();
    assert!((grey.pixels[1] - 128.0 / 255.0).abs() < ROUND_OFF);
    assert_eq!(grey.pixels[2], 0.0);

    let transparent = png_bytes([2, 1], ColorType::Indexed, BitDepth::Eight, &[0, 1], |encoder| {
        encoder.set_palette([200, 200, 200, 200, 200, 200].as_slice());
        encoder.set_trns([0, 255].as_slice());
    });
    assert_eq!(read_grey(&folder.write("trns", &transparent)).unwrap().pixels, [0.0, 1.0]);
}

#[test]
fn encoded_samples_become_light_only_when_asked() {
    let folder = Folder::new();
    let bytes = png_bytes([1, 1], ColorType::Grayscale, BitDepth::Eight, &[188], |_| {});
    let path = folder.write("grey", &bytes);
    let stored = read_rgb(&path, Transfer::Linear).unwrap().pixels[0][0];
    assert!((stored - 188.0 / 255.0).abs() < ROUND_OFF);
    // sRGB 188 is 0.5029 of white.
    for transfer in [Transfer::Srgb, Transfer::ByDepth] {
        assert!((read_rgb(&path, transfer).unwrap().pixels[0][1] - 0.5029).abs() < 1e-4);
    }
    let wide = png_bytes([1, 1], ColorType::Grayscale, BitDepth::Sixteen, &[128, 0], |_| {});
    let linear = read_rgb(&folder.write("wide", &wide), Transfer::ByDepth).unwrap().pixels[0][2];
    assert!((linear - 32_768.0 / 65_535.0).abs() < ROUND_OFF);
}

#[test]
fn exr_gives_colour_luminance_and_prefixed_layers() {
    let folder = Folder::new();
    let luminance = exr_file(&folder, [2, 1], &[("Y", vec![1.0, 4.0]), ("Z", vec![9.0, 9.0])]);
    assert_eq!(read_grey(&luminance).unwrap().pixels, [0.25, 1.0]);
    let colour = [("R", vec![1.0, 0.5]), ("G", vec![2.0, 0.5]), ("B", vec![3.0, 0.5]), ("A", vec![1.0, 0.5])];
    let read = read_rgb(&exr_file(&folder, [2, 1], &colour), Transfer::ByDepth).unwrap();
    assert_eq!(read.pixels, [[1.0, 2.0, 3.0], [0.25; 3]]);
    let prefixed = [("left.R", vec![1.0]), ("left.G", vec![2.0]), ("left.B", vec![3.0])];
    let read = read_rgb(&exr_file(&folder, [1, 1], &prefixed), Transfer::ByDepth).unwrap();
    assert_eq!(read.pixels, [[1.0, 2.0, 3.0]]);
    refused(read_grey(&exr_file(&folder, [1, 1], &[("Z", vec![1.0])])), "R, G and B, or Y");
}

#[test]
fn samples_that_are_no_light_are_refused_with_their_place() {
    let folder = Folder::new();
    for (value, words) in [(f32::NAN, "finite"), (f32::INFINITY, "finite"), (-1.0, "0 or more")] {
        let path = exr_file(&folder, [3, 1], &[("Y", vec![1.0, value, 1.0])]);
        refused(read_grey(&path), words);
        refused(read_grey(&path), "pixel (1, 0)");
    }
    // Filters of renderers undershoot: colour passes, as it is.
    let path = exr_file(&folder, [1, 1], &[("Y", vec![-0.5])]);
    assert_eq!(read_rgb(&path, Transfer::ByDepth).unwrap().pixels[0], [-0.5; 3]);
}

#[test]
fn a_picture_without_light_a_wrong_format_and_no_file_are_refused() {
    let folder = Folder::new();
    let black = png_bytes([2, 2], ColorType::Grayscale, BitDepth::Eight, &[0; 4], |_| {});
    refused(read_grey(&folder.write("black", &black)), "some light");
    refused(read_grey(&folder.write("empty", b"")), "PNG or OpenEXR");
    refused(read_grey(&folder.write("text", b"GIF89a, or so")), "GIF89a");
    let missing = read_grey(&folder.0.path().join("missing")).unwrap_err();
    assert_eq!(missing.exit_code(), 3);
}

#[test]
fn a_png_that_claims_to_be_huge_is_refused_before_memory_is_taken() {
    let folder = Folder::new();
    let small = png_bytes([2, 2], ColorType::Grayscale, BitDepth::Eight, &[1, 2, 3, 4], |_| {});
    for [width, height] in [[100_000u32, 100_000], [0, 5], [1 << 30, 1 << 30]] {
        let mut bytes = small.clone();
        bytes[16..20].copy_from_slice(&width.to_be_bytes());
        bytes[20..24].copy_from_slice(&height.to_be_bytes());
        let checksum = crc(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
        let error = read_grey(&folder.write("huge", &bytes)).unwrap_err();
        assert!(matches!(error, BakeError::Input { .. }), "{error}");
    }
}

#[test]
fn a_picture_cut_or_damaged_anywhere_is_refused_or_read_and_never_panics() {
    let folder = Folder::new();
    let data: Vec<u8> = (0..64).collect();
    let whole = png_bytes([8, 8], ColorType::Grayscale, BitDepth::Eight, &data, |_| {});
    let exr = exr_file(&folder, [4, 4], &[("Y", (0..16).map(|v| v as f32).collect())]);
    let exr = std::fs::read(exr).unwrap();
    // The last chunk of a PNG holds nothing: a file without it is still whole.
    let needed = [whole.len() - 12, exr.len()];
    for (bytes, needed) in [&whole, &exr].into_iter().zip(needed) {
        for cut in 0..needed {
            assert!(
                read_grey(&folder.write("cut", &bytes[..cut])).is_err(),
                "cut at {cut} of {}",
                bytes.len()
            );
        }
        for at in 0..bytes.len() {
            let mut bad = bytes.clone();
            bad[at] ^= 0x55;
            let _ = read_grey(&folder.write("bad", &bad));
        }
    }
}

/// CRC-32 of PNG chunks, bit by bit.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg()))
    })
}
