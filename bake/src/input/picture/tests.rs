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
fn alpha_of_a_png_of_any_kind_multiplies() {
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

/// The first pixel's red, and whether it was an assumption how it was taken.
fn light_of(folder: &Folder, bytes: &[u8]) -> (f32, bool) {
    let taken = rgb_of(&picture_file(&folder.write("light.png", bytes)).unwrap(), None).unwrap();
    (taken.picture.pixels[0][0], taken.assumed)
}

/// A PNG with a chunk of its own behind IHDR.
fn with_chunk(png: &[u8], tag: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let body = [&tag[..], data].concat();
    let chunk = [&(data.len() as u32).to_be_bytes()[..], &body, &crc(&body).to_be_bytes()].concat();
    [&png[..33], &chunk, &png[33..]].concat()
}

#[test]
fn a_pngs_colour_chunks_are_obeyed_in_their_order() {
    let folder = Folder::new();
    // sRGB 188 is 0.5029 of white; BT.709's is 0.5097; 2.2 gives 0.5115.
    let eight = png_bytes([1, 1], ColorType::Grayscale, BitDepth::Eight, &[188], |_| {});
    let stored = 188.0 / 255.0;
    let gamma_22: &[u8] = &45_455u32.to_be_bytes();
    let gamma_1: &[u8] = &100_000u32.to_be_bytes();
    type Chunk<'a> = (&'a [u8; 4], &'a [u8]);
    let chunks: [(&[Chunk<'_>], f32, bool); 8] = [
        (&[], stored, true),
        (&[(b"gAMA", gamma_1)], stored, false),
        (&[(b"gAMA", gamma_22)], libm::powf(stored, 2.2), false),
        (&[(b"sRGB", &[0])], 0.5029, false),
        (&[(b"sRGB", &[0]), (b"gAMA", gamma_22)], 0.5029, false),
        (&[(b"cICP", &[1, 8, 0, 1]), (b"sRGB", &[0])], stored, false),
        (&[(b"cICP", &[1, 13, 0, 1])], 0.5029, false),
        (&[(b"cICP", &[9, 13, 0, 1])], 0.5029, true),
    ];
    for (chunks, wanted, assumed) in chunks {
        let bytes = chunks.iter().rev().fold(eight.clone(), |png, (tag, data)| with_chunk(&png, tag, data));
        let (light, open) = light_of(&folder, &bytes);
        assert!((light - wanted).abs() < 1e-4 && open == assumed, "{chunks:?}: {light} for {wanted}, {open}");
    }
    for bad in [[1, 99, 0, 1], [1, 13, 0, 0]] {
        refused(read_grey(&folder.write("cicp", &with_chunk(&eight, b"cICP", &bad))), "cICP");
    }
    let wide = png_bytes([1, 1], ColorType::Grayscale, BitDepth::Sixteen, &[128, 0], |_| {});
    let (light, open) = light_of(&folder, &wide);
    assert!((light - 32_768.0 / 65_535.0).abs() < ROUND_OFF && !open);
    // The case that led here: the same light, as 16 linear bits and as 8 bits of sRGB.
    let (light, _) = light_of(&folder, &with_chunk(&eight, b"sRGB", &[0]));
    let linear = (light * 65_535.0).round() as u16;
    let wide = png_bytes([1, 1], ColorType::Grayscale, BitDepth::Sixteen, &linear.to_be_bytes(), |_| {});
    assert!((light_of(&folder, &wide).0 - light).abs() < 1e-4);
}

fn colours(path: &std::path::Path, layer: Option<&str>) -> Result<Vec<[f32; 3]>, BakeError> {
    Ok(rgb_of(&picture_file(path)?, layer)?.picture.pixels)
}

#[test]
fn exr_gives_colour_as_it_is_stored_whatever_its_alpha() {
    let folder = Folder::new();
    let luminance = exr_file(&folder, [2, 1], &[("Y", vec![1.0, 4.0]), ("Z", vec![9.0, 9.0])]);
    assert_eq!(read_grey(&luminance).unwrap().pixels, [0.25, 1.0]);
    // Alpha is in the colours already; a glow has light where it covers nothing.
    let colour = [("R", vec![1.0, 0.5]), ("G", vec![2.0, 0.5]), ("B", vec![3.0, 0.5]), ("A", vec![1.0, 0.0])];
    let read = colours(&exr_file(&folder, [2, 1], &colour), None).unwrap();
    assert_eq!(read, [[1.0, 2.0, 3.0], [0.5; 3]]);
    let grey = exr_file(&folder, [2, 1], &[("Y", vec![1.0, 1.0]), ("A", vec![1.0, 0.25])]);
    assert_eq!(read_grey(&grey).unwrap().pixels, [1.0, 1.0]);
    refused(read_grey(&exr_file(&folder, [1, 1], &[("Z", vec![1.0])])), "R, G and B, or Y");
}

#[test]
fn an_exr_layer_is_named_or_the_only_one() {
    let folder = Folder::new();
    let letters = |prefix: &str, first: f32| {
        ["R", "G", "B"]
            .iter()
            .zip(0u8..)
            .map(|(c, i)| (format!("{prefix}{c}"), vec![first + f32::from(i)]))
            .collect()
    };
    let file = |layers: &[(&str, f32)]| {
        let list: Vec<(String, Vec<f32>)> = layers
            .iter()
            .flat_map(|(prefix, first)| -> Vec<(String, Vec<f32>)> { letters(prefix, *first) })
            .collect();
        let list: Vec<(&str, Vec<f32>)> =
            list.iter().map(|(name, values)| (name.as_str(), values.clone())).collect();
        exr_file(&folder, [1, 1], &list)
    };
    assert_eq!(colours(&file(&[("left.", 1.0)]), None).unwrap(), [[1.0, 2.0, 3.0]]);
    let two = file(&[("Albedo.", 1.0), ("Combined.", 5.0)]);
    refused(colours(&two, None), "\"Albedo\", \"Combined\"");
    refused(colours(&two, Some("Diffuse")), "\"Albedo\", \"Combined\"");
    assert_eq!(colours(&two, Some("Combined")).unwrap(), [[5.0, 6.0, 7.0]]);
    assert_eq!(colours(&two, Some("Albedo")).unwrap(), [[1.0, 2.0, 3.0]]);
    // Channels without a prefix are the main layer, which is said.
    let main = file(&[("", 1.0), ("Combined.", 5.0)]);
    assert_eq!(colours(&main, None).unwrap(), [[1.0, 2.0, 3.0]]);
    assert!(rgb_of(&picture_file(&main).unwrap(), None).unwrap().assumed);
    assert_eq!(colours(&main, Some("Combined")).unwrap(), [[5.0, 6.0, 7.0]]);
    let png = png_bytes([1, 1], ColorType::Grayscale, BitDepth::Eight, &[9], |_| {});
    refused(colours(&folder.write("png", &png), Some("Combined")), "a PNG");
}

#[test]
fn a_part_of_an_exr_of_several_is_read_by_its_name() {
    let folder = Folder::new();
    let part = |name: &str, value: f32| {
        let channel = |letter: &str| AnyChannel::new(letter, FlatSamples::F32(vec![value]));
        Layer::new(
            (1, 1),
            exr::prelude::LayerAttributes::named(name),
            exr::prelude::Encoding::SMALL_LOSSLESS,
            AnyChannels::sort(["R", "G", "B"].map(channel).into_iter().collect()),
        )
    };
    let path = folder.0.path().join("parts.exr");
    let attributes = exr::prelude::ImageAttributes::new(exr::prelude::IntegerBounds::from_dimensions((1, 1)));
    let image = Image::empty(attributes).with_layer(part("diffuse", 1.0)).with_layer(part("glow", 2.0));
    image.write().to_file(&path).unwrap();
    refused(colours(&path, None), "\"diffuse\", \"glow\"");
    assert_eq!(colours(&path, Some("glow")).unwrap(), [[2.0; 3]]);
    assert_eq!(colours(&path, Some("diffuse")).unwrap(), [[1.0; 3]]);
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
    assert_eq!(colours(&path, None).unwrap()[0], [-0.5; 3]);
}

#[test]
fn a_picture_without_light_a_wrong_format_and_no_file_are_refused() {
    let folder = Folder::new();
    let black = png_bytes([2, 2], ColorType::Grayscale, BitDepth::Eight, &[0; 4], |_| {});
    refused(read_grey(&folder.write("black", &black)), "some light");
    refused(read_grey(&folder.write("empty", b"")), "PNG or OpenEXR");
    refused(read_grey(&folder.write("gif", b"GIF89a, or so")), "a GIF picture");
    refused(read_grey(&folder.write("other", b"\x01\x02\x03")), "\\x01\\x02");
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
