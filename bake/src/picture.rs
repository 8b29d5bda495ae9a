//! Pictures into files: PNG to look at, EXR for numbers. Each appears whole or not at all.

use crate::error::BakeError;
use crate::output::write_atomically;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Blocks, Compression, Encoding, FlatSamples, Image, Layer,
    LayerAttributes, LineOrder, Text, WritableImage,
};
use squall_runtime::Camera;
use squall_runtime::glam::DMat4;
use squall_runtime::picture::Picture;
use squall_runtime::tone::Tone;
use std::io::Write;
use std::path::Path;

pub(crate) fn encoding_error(error: impl std::error::Error + Send + Sync + 'static) -> std::io::Error {
    std::io::Error::other(error)
}

/// A line that a picture's file says of itself: a text chunk of a PNG, an attribute of an OpenEXR.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Note<'a> {
    /// Keyword of the chunk, name of the attribute.
    pub keyword: &'a str,
    /// Latin-1 without line breaks.
    pub text: &'a str,
}

fn encode_png(
    picture: &Picture,
    depth: png::BitDepth,
    bytes: &[u8],
    note: Option<Note>,
) -> std::io::Result<Vec<u8>> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, picture.width as u32, picture.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(depth);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    // Half the processor time of a preview went into the last tenth of the file's size.
    encoder.set_compression(png::Compression::Fast);
    if let Some(Note { keyword, text }) = note {
        encoder.add_text_chunk(keyword.to_owned(), text.to_owned()).map_err(encoding_error)?;
    }
    let mut writer = encoder.write_header().map_err(encoding_error)?;
    writer.write_image_data(bytes).map_err(encoding_error)?;
    writer.finish().map_err(encoding_error)?;
    Ok(out)
}

/// Values of one channel of [`encode_layers`].
#[derive(Clone, Debug, PartialEq)]
pub enum ChannelValues {
    /// Numbers.
    Floats(Vec<f32>),
    /// Names.
    Names(Vec<u32>),
}

/// Bytes of an OpenEXR file with these channels, row 0 on top, in 32 bits each; a layer's channels share what stands before their
/// last dot. Errors: a picture without pixels.
pub fn encode_layers(
    size: (usize, usize),
    channels: Vec<(String, ChannelValues)>,
    note: Option<Note>,
) -> std::io::Result<Vec<u8>> {
    encode_seen_layers(size, channels, (note, None))
}

/// [`encode_layers`] with the camera that they were drawn with, as the standard's `worldToCamera` and `worldToNDC`: points are row vectors, x and y from
/// −1 to 1, y up. Errors: a picture without pixels.
pub fn encode_seen_layers(
    size: (usize, usize),
    channels: Vec<(String, ChannelValues)>,
    (note, camera): (Option<Note>, Option<&Camera>),
) -> std::io::Result<Vec<u8>> {
    let channels = channels.into_iter().map(|(name, values)| {
        let samples = match values {
            ChannelValues::Floats(values) => FlatSamples::F32(values),
            ChannelValues::Names(values) => FlatSamples::U32(values),
        };
        AnyChannel::new(name.as_str(), samples)
    });
    write_channels(size, channels.collect(), (note, camera))
}

/// What layers that know their camera say of their writer.
pub const SOFTWARE: &str = "squall";
/// Distance of the plane before a camera that its matrix needs and nobody asks for, m.
const NEAR_M: f64 = 0.1;
/// Largest number of a 16-bit float.
const LARGEST_HALF: f32 = 65_504.0;

fn write_encoded(path: &Path, encoded: std::io::Result<Vec<u8>>) -> Result<(), BakeError> {
    write_atomically(path, |out| out.write_all(&encoded?))
}

/// Bytes of the file that [`write_png8`] writes. Errors: a picture without pixels.
pub fn encode_png8(picture: &Picture, tone: &Tone) -> std::io::Result<Vec<u8>> {
    encode_png8_noted(picture, tone, None)
}

/// [`encode_png8`] with a note. Errors: a picture without pixels, a note that no PNG holds.
pub fn encode_png8_noted(picture: &Picture, tone: &Tone, note: Option<Note>) -> std::io::Result<Vec<u8>> {
    encode_png(picture, png::BitDepth::Eight, tone.to_srgb8(picture).as_flattened(), note)
}

/// A PNG of `width` × `height` sRGB pixels, three bytes each. Errors: a picture without pixels, bytes of another number.
pub fn encode_rgb8([width, height]: [usize; 2], bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    encode_png(&Picture { width, height, pixels: Vec::new() }, png::BitDepth::Eight, bytes, None)
}

/// Bytes of the file that [`write_exr`] writes. Errors: a picture without pixels.
pub fn encode_exr(picture: &Picture) -> std::io::Result<Vec<u8>> {
    encode_exr_noted(picture, None)
}

/// [`encode_exr`] with a note. Errors: a picture without pixels, a note that no OpenEXR holds.
pub fn encode_exr_noted(picture: &Picture, note: Option<Note>) -> std::io::Result<Vec<u8>> {
    let band = |band: usize| picture.pixels.iter().map(|pixel| pixel[band]).collect();
    let channels = vec![("R", band(0)), ("G", band(1)), ("B", band(2))];
    encode_channels((picture.width, picture.height), channels, note)
}

/// An 8-bit sRGB picture, developed with `tone`.
pub fn write_png8(path: &Path, picture: &Picture, tone: &Tone) -> Result<(), BakeError> {
    write_encoded(path, encode_png8(picture, tone))
}

/// A 16-bit sRGB picture, developed with `tone`.
pub fn write_png16(path: &Path, picture: &Picture, tone: &Tone) -> Result<(), BakeError> {
    let bytes: Vec<u8> = tone.to_srgb16(picture).iter().flatten().flat_map(|v| v.to_be_bytes()).collect();
    write_encoded(path, encode_png(picture, png::BitDepth::Sixteen, &bytes, None))
}

/// The radiance itself, 32-bit float channels R, G, B, ZIP-compressed; no tone mapping.
pub fn write_exr(path: &Path, picture: &Picture) -> Result<(), BakeError> {
    write_encoded(path, encode_exr(picture))
}

/// One float channel named `Y` (a field, a depth, a grey image), row 0 = top, `width * height` values.
pub fn write_grey_exr(path: &Path, width: usize, height: usize, values: &[f32]) -> Result<(), BakeError> {
    assert_eq!(values.len(), width * height, "one value a pixel");
    write_encoded(path, encode_channels((width, height), vec![("Y", values.to_vec())], None))
}

fn encode_channels(
    size: (usize, usize),
    channels: Vec<(&str, Vec<f32>)>,
    note: Option<Note>,
) -> std::io::Result<Vec<u8>> {
    let channels = channels.into_iter().map(|(name, values)| AnyChannel::new(name, FlatSamples::F32(values)));
    write_channels(size, channels.collect(), (note, None))
}

/// Bytes of an OpenEXR file with these channels, each `width * height` values, row 0 on top; in 16-bit floats, cut to what they hold, or
/// in 32-bit ones. Errors: a picture without pixels.
pub fn encode_named_channels(
    size: (usize, usize),
    channels: Vec<(&str, Vec<f32>)>,
    half: bool,
) -> std::io::Result<Vec<u8>> {
    let narrow = |value: f32| exr::prelude::f16::from_f32(value.clamp(-LARGEST_HALF, LARGEST_HALF));
    let channels = channels.into_iter().map(|(name, values)| {
        let samples = match half {
            true => FlatSamples::F16(values.into_iter().map(narrow).collect()),
            false => FlatSamples::F32(values),
        };
        AnyChannel::new(name, samples)
    });
    write_channels(size, channels.collect(), (None, None))
}

fn write_channels(
    size: (usize, usize),
    channels: Vec<AnyChannel<FlatSamples>>,
    (note, camera): (Option<Note>, Option<&Camera>),
) -> std::io::Result<Vec<u8>> {
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let mut attributes = LayerAttributes::default();
    if let Some(Note { keyword, text }) = note {
        attributes.other.insert(exr_text(keyword)?, AttributeValue::Text(exr_text(text)?));
    }
    if let Some(camera) = camera {
        // A glam matrix's columns, one after another, are its rows as row vectors have it.
        let stored = |matrix: DMat4| matrix.to_cols_array().map(|value| value as f32);
        let view = camera.view_matrix();
        attributes.software_name = Some(exr_text(SOFTWARE)?);
        attributes.world_to_camera = Some(stored(view));
        attributes.world_to_normalized_device = Some(stored(camera.projection_matrix(NEAR_M) * view));
    }
    let image = Image::from_layer(Layer::new(size, attributes, encoding, channels));
    let mut bytes = std::io::Cursor::new(Vec::new());
    // One thread: the order of compressed blocks, and so the bytes, repeat.
    image.write().non_parallel().to_buffered(&mut bytes).map_err(encoding_error)?;
    Ok(bytes.into_inner())
}

fn exr_text(text: &str) -> std::io::Result<Text> {
    Text::new_or_none(text).ok_or_else(|| std::io::Error::other("a text that OpenEXR cannot hold"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::*;

    fn sample() -> Picture {
        let pixels = (0..35).map(|i| [i as f32, 0.25 * i as f32, 1e4 / (1.0 + i as f32)]).collect();
        Picture { width: 7, height: 5, pixels }
    }

    #[test]
    fn exr_keeps_every_bit_and_the_top_row_on_top() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write_exr(&path, &sample()).unwrap();
        let image = read_first_rgba_layer_from_file(
            &path,
            |size, _| vec![[0f32; 3]; size.area()],
            |pixels, at, (r, g, b, _): (f32, f32, f32, f32)| pixels[at.y() * 7 + at.x()] = [r, g, b],
        )
        .unwrap();
        assert_eq!(image.layer_data.channel_data.pixels, sample().pixels);
        let again = folder.path().join("b.exr");
        write_exr(&again, &sample()).unwrap();
        assert_eq!(std::fs::read(path).unwrap(), std::fs::read(again).unwrap());
    }

    #[test]
    fn png_holds_the_developed_picture_in_both_depths() {
        let folder = tempfile::tempdir().unwrap();
        let tone = Tone::default();
        let read = |name: &str| {
            let file = std::io::BufReader::new(std::fs::File::open(folder.path().join(name)).unwrap());
            let mut reader = png::Decoder::new(file).read_info().unwrap();
            let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut bytes).unwrap();
            bytes
        };
        write_png8(&folder.path().join("8.png"), &sample(), &tone).unwrap();
        assert_eq!(read("8.png"), tone.to_srgb8(&sample()).as_flattened());
        write_png16(&folder.path().join("16.png"), &sample(), &tone).unwrap();
        let wide = read("16.png");
        let first = u16::from_be_bytes([wide[0], wide[1]]);
        assert_eq!(first, tone.to_srgb16(&sample())[0][0]);
    }

    #[test]
    fn a_folder_that_is_not_there_is_refused_and_nothing_appears() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("none/picture.exr");
        assert!(write_exr(&path, &sample()).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
