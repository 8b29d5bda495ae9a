use super::*;
use std::path::PathBuf;

/// A PNG of these samples, with what `set` makes of its header and chunks behind it.
fn png(
    (colour, depth): (png::ColorType, png::BitDepth),
    samples: &[u16],
    set: impl Fn(&mut png::Info<'_>),
    chunk: Option<[u8; 4]>,
) -> Input {
    let channels = colour.samples();
    let mut info = png::Info::with_size((samples.len() / channels) as u32, 1);
    (info.color_type, info.bit_depth) = (colour, depth);
    set(&mut info);
    let mut bytes = Vec::new();
    let mut writer = png::Encoder::with_info(&mut bytes, info).unwrap().write_header().unwrap();
    if let Some(points) = chunk {
        writer.write_chunk(png::chunk::ChunkType(*b"cICP"), &points).unwrap();
    }
    let data: Vec<u8> = match depth {
        png::BitDepth::Sixteen => samples.iter().flat_map(|v| v.to_be_bytes()).collect(),
        _ => samples.iter().map(|&v| v as u8).collect(),
    };
    writer.write_image_data(&data).unwrap();
    writer.finish().unwrap();
    Input { path: PathBuf::from("a.png"), bytes }
}

fn samples_of(bytes: &[u8]) -> (png::ColorType, png::BitDepth, Vec<u16>) {
    let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
    let mut data = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut data).unwrap();
    let (colour, depth) = reader.output_color_type();
    let samples = match depth {
        png::BitDepth::Sixteen => data.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect(),
        _ => data.into_iter().map(u16::from).collect(),
    };
    (colour, depth, samples)
}

#[test]
fn every_sample_comes_back_as_it_was_by_every_curve_in_both_depths() {
    let srgb = |info: &mut png::Info<'_>| info.srgb = Some(png::SrgbRenderingIntent::Perceptual);
    let gamma = |info: &mut png::Info<'_>| {
        info.source_gamma = Some(png::ScaledFloat::from_scaled(45_455));
    };
    let nothing = |_: &mut png::Info<'_>| {};
    let eight: Vec<u16> = (0..=255).collect();
    let sixteen: Vec<u16> = (0..=65_535).collect();
    for (depth, samples) in [(png::BitDepth::Eight, &eight), (png::BitDepth::Sixteen, &sixteen)] {
        let form = (png::ColorType::Grayscale, depth);
        for input in [
            png(form, samples, srgb, None),
            png(form, samples, gamma, None),
            png(form, samples, nothing, None),
            png(form, samples, nothing, Some([1, 16, 0, 1])),
            png(form, samples, nothing, Some([1, 1, 0, 1])),
        ] {
            let frame = frame_of(&input).unwrap();
            let bytes = frame.encode(&frame.picture, FrameKind::Png).unwrap();
            let (colour, bits, back) = samples_of(&bytes);
            let wrong = back.iter().zip(samples).find(|(a, b)| a != b);
            assert_eq!((colour, bits, wrong), (form.0, form.1, None), "{}", frame.how);
            // What is written is read by the same curve.
            let again = frame_of(&Input { bytes, ..input }).unwrap();
            assert!((&again.how, &again.picture) == (&frame.how, &frame.picture), "{}", frame.how);
        }
    }
}

#[test]
fn a_frame_without_chunks_is_srgb_and_says_that_this_is_assumed() {
    let input = png((png::ColorType::Rgb, png::BitDepth::Eight), &[188; 3], |_| {}, None);
    let frame = frame_of(&input).unwrap();
    assert!(frame.assumed && frame.how.contains("sRGB"), "{}", frame.how);
    // Half the light is sample 188.
    assert!((frame.picture.pixels[0][0] - 0.503).abs() < 1e-3);
}

#[test]
fn alpha_comes_back_and_colours_are_not_multiplied_by_it() {
    let samples = [200, 100, 50, 128, 10, 20, 30, 0];
    let input = png((png::ColorType::Rgba, png::BitDepth::Eight), &samples, |_| {}, None);
    let frame = frame_of(&input).unwrap();
    let bytes = frame.encode(&frame.picture, FrameKind::Png).unwrap();
    assert_eq!(samples_of(&bytes).2, samples);
    // In an EXR they are.
    let exr = frame.encode(&frame.picture, FrameKind::Exr).unwrap();
    let exr = frame_of(&Input { path: PathBuf::from("a.exr"), bytes: exr }).unwrap();
    assert!((exr.picture.pixels[0][0] - frame.picture.pixels[0][0] * 128.0 / 255.0).abs() < 1e-6);
    assert_eq!(exr.picture.pixels[1], [0.0; 3]);
    assert_eq!(exr.coding.alpha, frame.coding.alpha);
}

#[test]
fn a_grey_frame_stays_grey_until_colour_falls_on_it() {
    let input = png((png::ColorType::Grayscale, png::BitDepth::Sixteen), &[9, 900], |_| {}, None);
    let frame = frame_of(&input).unwrap();
    let mut picture = frame.picture.clone();
    picture.pixels[0][2] = 0.5;
    let form = |picture: &Picture| {
        let (colour, depth, _) = samples_of(&frame.encode(picture, FrameKind::Png).unwrap());
        (colour, depth)
    };
    assert_eq!(form(&frame.picture), (png::ColorType::Grayscale, png::BitDepth::Sixteen));
    assert_eq!(form(&picture), (png::ColorType::Rgb, png::BitDepth::Sixteen));
}

#[test]
fn an_exr_comes_back_with_floats_of_the_length_that_it_had() {
    let values = vec![0.5f32, 2.0, 65_000.0];
    for half in [true, false] {
        let channels = ["R", "G", "B"].map(|name| (name, values.clone())).to_vec();
        let bytes = encode_named_channels((3, 1), channels, half).unwrap();
        let frame = frame_of(&Input { path: PathBuf::from("a.exr"), bytes: bytes.clone() }).unwrap();
        assert_eq!((frame.kind(), frame.coding.sixteen), (FrameKind::Exr, half));
        let written = frame.encode(&frame.picture, FrameKind::Exr).unwrap();
        assert!(written == bytes, "{half}");
        let mut bright = frame.picture.clone();
        bright.pixels[0][0] = 1e6;
        let written = frame.encode(&bright, FrameKind::Exr).unwrap();
        let again = frame_of(&Input { path: PathBuf::from("a.exr"), bytes: written }).unwrap();
        assert_eq!(again.picture.pixels[0][0], if half { 65_504.0 } else { 1e6 });
    }
}

#[test]
fn what_is_no_picture_is_refused_by_what_it_is() {
    let refused = |bytes: &[u8], words: &str| {
        let error =
            frame_of(&Input { path: PathBuf::from("a"), bytes: bytes.to_vec() }).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    refused(b"\xff\xd8\xff\xe0", "a JPEG picture");
    refused(b"", "an empty file");
    let whole = png((png::ColorType::Rgb, png::BitDepth::Eight), &[7; 300], |_| {}, None).bytes;
    for length in (8..whole.len() - 12).step_by(7) {
        let cut = Input { path: PathBuf::from("a.png"), bytes: whole[..length].to_vec() };
        assert!(frame_of(&cut).is_err(), "{length}");
    }
}
