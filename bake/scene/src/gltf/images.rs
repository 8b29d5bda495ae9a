//! Textures of base colours, PNG and JPEG, as linear light that a triangle's mean is taken of.

use super::{File, buffers};
use crate::error::SceneError;
use crate::scene::Beside;
use gltf::json::texture::WrappingMode;
use gltf::json::validation::Checked;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::rc::Rc;

/// A picture's texels, sRGB.
struct Picture {
    width: usize,
    height: usize,
    texels: Vec<[u8; 3]>,
    /// Mean of all of them in linear light.
    mean: [f32; 3],
}

/// Pictures that were decoded: materials share them, and limits hold for all together.
pub(super) struct Images {
    known: BTreeMap<usize, Result<Rc<Picture>, String>>,
    bytes_left: u64,
    pixels_left: u64,
}

impl Images {
    pub(super) fn new(file: &File<'_>) -> Self {
        let (bytes_left, pixels_left) = (file.buffers.left, file.how.limits.pixels);
        Self { known: BTreeMap::new(), bytes_left, pixels_left }
    }

    /// The picture of that index, decoded unless it was before. Errors as of [`Paint::read`].
    fn picture(
        &mut self,
        file: &File<'_>,
        index: usize,
        image: &gltf::json::Image,
        beside: &mut Beside<'_>,
    ) -> Result<Result<Rc<Picture>, String>, SceneError> {
        if let Some(known) = self.known.get(&index) {
            return Ok(known.clone());
        }
        let place = format!("images[{index}]");
        let read;
        let bytes: &[u8] = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => {
                read = buffers::named(uri, &place, self.bytes_left, beside)?;
                self.bytes_left = self.bytes_left.checked_sub(read.len() as u64).ok_or_else(|| {
                    let wanted =
                        format!("at most {} bytes in all buffers and pictures", file.how.limits.bytes);
                    SceneError::input(place.clone(), wanted, "more")
                })?;
                &read
            }
            (None, Some(view)) => file.buffers.view(view.value(), &place)?.0,
            (None, None) => return Err(SceneError::input(place, "a uri or a bufferView", "neither")),
        };
        let decoded = if bytes.starts_with(b"\x89PNG") {
            png(bytes, self.pixels_left)
        } else if bytes.starts_with(b"\xff\xd8") {
            jpeg(bytes, self.pixels_left)
        } else {
            Err("neither PNG nor JPEG".into())
        };
        let picture = decoded.map(|(width, height, texels)| {
            self.pixels_left -= (texels.len() as u64).min(self.pixels_left);
            let mean = mean_light(&texels);
            Rc::new(Picture { width, height, texels, mean })
        });
        let picture = picture.map_err(|why| format!("{place}: {why}"));
        self.known.insert(index, picture.clone());
        Ok(picture)
    }
}

/// A texture: a picture, and how it is looked up.
pub(super) struct Paint {
    picture: Rc<Picture>,
    wrap: [WrappingMode; 2],
    /// Set of coordinates, offset, scale and turn (KHR_texture_transform).
    pub(super) set: u32,
    transform: Option<([f32; 2], [f32; 2], f32)>,
}

/// Points of a triangle that its mean is taken of: the centres of 16 like parts.
const PARTS: usize = 4;

impl Paint {
    /// The texture of that information. The inner error says why it can't be read, the outer one why the file is refused.
    pub(super) fn read(
        file: &File<'_>,
        images: &mut Images,
        info: &gltf::json::texture::Info,
        beside: &mut Beside<'_>,
    ) -> Result<Result<Self, String>, SceneError> {
        let field = format!("textures[{}]", info.index.value());
        let there = |what: &str| SceneError::input(field.clone(), format!("{what} that is there"), "none");
        let texture = file.root.textures.get(info.index.value()).ok_or_else(|| there("a texture"))?;
        let Some(image) = file.root.images.get(texture.source.value()) else {
            return Ok(Err(format!("{field} has no PNG or JPEG picture")));
        };
        let picture = match images.picture(file, texture.source.value(), image, beside)? {
            Ok(picture) => picture,
            Err(why) => return Ok(Err(why)),
        };
        let sampler = texture.sampler.and_then(|sampler| file.root.samplers.get(sampler.value()));
        let mode = |mode: Checked<WrappingMode>| match mode {
            Checked::Valid(mode) => mode,
            Checked::Invalid => WrappingMode::Repeat,
        };
        let wrap =
            sampler.map_or([WrappingMode::Repeat; 2], |sampler| [mode(sampler.wrap_s), mode(sampler.wrap_t)]);
        let transform = info.extensions.as_ref().and_then(|extensions| extensions.texture_transform.as_ref());
        let set = transform.and_then(|transform| transform.tex_coord).unwrap_or(info.tex_coord);
        let transform =
            transform.map(|transform| (transform.offset.0, transform.scale.0, transform.rotation.0));
        Ok(Ok(Self { picture, wrap, set, transform }))
    }

    /// Mean of the whole picture in linear light, whatever its coordinates are.
    pub(super) fn whole_mean(&self) -> [f32; 3] {
        self.picture.mean
    }

    /// Mean over a triangle of texture coordinates, as square roots over 255. Coordinates beyond 0 to 1 wrap as the sampler says.
    pub(super) fn mean(&self, corners: [[f32; 2]; 3]) -> [u8; 3] {
        let corners = corners.map(|corner| self.turned(corner));
        let mut sum = [0.0f32; 3];
        let parts = PARTS as f32;
        for row in 0..PARTS {
            for place in 0..2 * (PARTS - row) - 1 {
                // Upright and inverted parts take turns along a row.
                let (half, inverted) = (place / 2, place % 2 == 1);
                let third = if inverted { 2.0 / 3.0 } else { 1.0 / 3.0 };
                let (u, v) = ((half as f32 + third) / parts, (row as f32 + third) / parts);
                let at: [f32; 2] = std::array::from_fn(|axis| {
                    let [a, b, c] = corners.map(|corner| corner[axis]);
                    a + u * (b - a) + v * (c - a)
                });
                for (sum, texel) in sum.iter_mut().zip(self.texel(at)) {
                    *sum += linear(texel);
                }
            }
        }
        sum.map(|sum| ((sum / (parts * parts)).sqrt() * 255.0 + 0.5) as u8)
    }

    fn turned(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        let Some((offset, scale, turn)) = self.transform else { return [u, v] };
        let (sin, cos) = (libm::sinf(turn), libm::cosf(turn));
        let (u, v) = (u * scale[0], v * scale[1]);
        [cos * u + sin * v + offset[0], cos * v - sin * u + offset[1]]
    }

    fn texel(&self, at: [f32; 2]) -> [u8; 3] {
        let axis = |at: f32, size: usize, mode: WrappingMode| {
            let at = if at.is_finite() { at } else { 0.0 };
            let at = match mode {
                WrappingMode::Repeat => at - at.floor(),
                WrappingMode::ClampToEdge => at.clamp(0.0, 1.0),
                WrappingMode::MirroredRepeat => {
                    let twice = at - 2.0 * (0.5 * at).floor();
                    if twice > 1.0 { 2.0 - twice } else { twice }
                }
            };
            ((at * size as f32) as usize).min(size - 1)
        };
        let picture = &*self.picture;
        let x = axis(at[0], picture.width, self.wrap[0]);
        let y = axis(at[1], picture.height, self.wrap[1]);
        picture.texels[y * picture.width + x]
    }
}

/// Linear light of an 8-bit sRGB sample.
fn linear(sample: u8) -> f32 {
    let value = f32::from(sample) / 255.0;
    if value <= 0.040_45 { value / 12.92 } else { libm::powf((value + 0.055) / 1.055, 2.4) }
}

/// Mean of all texels in linear light.
fn mean_light(texels: &[[u8; 3]]) -> [f32; 3] {
    let mut counts = [[0u64; 3]; 256];
    for texel in texels {
        for (band, sample) in texel.iter().enumerate() {
            counts[usize::from(*sample)][band] += 1;
        }
    }
    let mut sum = [0.0f64; 3];
    for (sample, counts) in counts.iter().enumerate() {
        let light = f64::from(linear(sample as u8));
        for (sum, count) in sum.iter_mut().zip(counts) {
            *sum += light * *count as f64;
        }
    }
    sum.map(|sum| (sum / texels.len().max(1) as f64) as f32)
}

type Decoded = Result<(usize, usize, Vec<[u8; 3]>), String>;

fn checked_size(width: usize, height: usize, most: u64) -> Result<(), String> {
    match (width as u64).checked_mul(height as u64) {
        Some(1..) if (width as u64 * height as u64) <= most => Ok(()),
        _ => Err(format!("{width} × {height} pixels, where all textures may have {most} more")),
    }
}

fn png(bytes: &[u8], most: u64) -> Decoded {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    checked_size(width, height, most)?;
    let mut samples = vec![0; reader.output_buffer_size().ok_or("too large")?];
    let frame = reader.next_frame(&mut samples).map_err(|error| error.to_string())?;
    let channels = frame.color_type.samples();
    let texels = samples[..frame.buffer_size()].chunks_exact(channels).map(|texel| match texel {
        [red, green, blue, ..] => [*red, *green, *blue],
        _ => [texel[0]; 3],
    });
    let texels: Vec<_> = texels.collect();
    if texels.len() != width * height {
        return Err("cut short".into());
    }
    Ok((width, height, texels))
}

fn jpeg(bytes: &[u8], most: u64) -> Decoded {
    use zune_jpeg::zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions};
    let options = DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = zune_jpeg::JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|error| error.to_string())?;
    let (width, height) = decoder.dimensions().ok_or("no size")?;
    checked_size(width, height, most)?;
    let samples = decoder.decode().map_err(|error| error.to_string())?;
    let texels: Vec<[u8; 3]> = samples.chunks_exact(3).map(|texel| [texel[0], texel[1], texel[2]]).collect();
    if texels.len() != width * height {
        return Err("cut short".into());
    }
    Ok((width, height, texels))
}
