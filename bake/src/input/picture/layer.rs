//! Layers of OpenEXR files: parts of a file, and channels that share a prefix ("diffuse.R").

use super::{Taken, check_size};
use crate::error::BakeError;
use crate::input::Input;
use exr::meta::header::Header;
use exr::prelude::{ReadChannels, ReadLayers, ReadSpecificChannel};
use squall_runtime::picture::Picture;
use std::io::Cursor;
use std::path::Path;

/// Channels that make a picture: R, G and B, or Y.
#[derive(Clone, Debug, PartialEq)]
struct Layer {
    /// Which part of the file.
    part: usize,
    /// The part's own name.
    part_name: Option<String>,
    /// What stands before the channels' letters, without its last dot.
    prefix: String,
    /// Names of three channels or one.
    channels: Vec<String>,
    /// The name to ask for it by.
    name: String,
}

/// Every layer that makes a picture, in the file's order.
fn layers(headers: &[Header]) -> Vec<Layer> {
    let mut found = Vec::new();
    for (part, header) in headers.iter().enumerate().filter(|(_, header)| !header.deep) {
        let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
        let part_name = header.own_attributes.layer_name.as_ref().map(ToString::to_string);
        let mut prefixes = vec![""];
        for name in &names {
            let prefix = name.rfind('.').map_or("", |dot| &name[..=dot]);
            if !prefixes.contains(&prefix) {
                prefixes.push(prefix);
            }
        }
        for prefix in prefixes {
            let named = |letters: &[&str]| {
                letters.iter().map(|letter| format!("{prefix}{letter}")).collect::<Vec<_>>()
            };
            let whole = [named(&["R", "G", "B"]), named(&["Y"])]
                .into_iter()
                .find(|channels| channels.iter().all(|channel| names.contains(channel)));
            let Some(channels) = whole else { continue };
            let prefix = prefix.trim_end_matches('.').to_owned();
            let own = match (&part_name, headers.len()) {
                (Some(name), _) => name.clone(),
                (None, 1) => String::new(),
                (None, _) => format!("part {part}"),
            };
            let name = match (own.as_str(), prefix.as_str()) {
                (own, "") => own.to_owned(),
                ("", prefix) => prefix.to_owned(),
                (_, prefix) if headers.len() == 1 => prefix.to_owned(),
                (own, prefix) => format!("{own}.{prefix}"),
            };
            found.push(Layer { part, part_name: part_name.clone(), prefix, channels, name });
        }
    }
    found
}

/// The layer to read, and whether nobody named it among several.
fn choose(path: &Path, headers: &[Header], asked: Option<&str>) -> Result<(Layer, bool), BakeError> {
    let all = layers(headers);
    let listed = || {
        let shown = |layer: &Layer| match layer.name.as_str() {
            "" => "the layer without a name".to_owned(),
            name => format!("\"{name}\""),
        };
        all.iter().map(shown).collect::<Vec<_>>().join(", ")
    };
    if all.is_empty() {
        let found = headers.iter().flat_map(|header| &header.channels.list);
        let found = found.map(|channel| channel.name.to_string()).collect::<Vec<_>>().join(", ");
        if headers.iter().any(|header| header.deep) {
            return Err(BakeError::input(path, "EXR", "flat pixels", "deep data"));
        }
        return Err(BakeError::input(path, "EXR", "a layer with channels R, G and B, or Y", found));
    }
    if let Some(asked) = asked {
        let exact = all.iter().find(|layer| layer.name == asked);
        let loose = || {
            let mut same = all.iter().filter(|layer| {
                layer.prefix == asked || layer.prefix.is_empty() && layer.part_name.as_deref() == Some(asked)
            });
            same.next().filter(|_| same.next().is_none())
        };
        let layer = exact.or_else(loose).cloned();
        let refused = || BakeError::input(path, "EXR layer", listed(), format!("\"{asked}\""));
        return layer.map(|layer| (layer, false)).ok_or_else(refused);
    }
    if let [only] = all.as_slice() {
        return Ok((only.clone(), false));
    }
    // Channels without a prefix are a file's main layer, whatever else it carries.
    if let (1, Some(main)) = (headers.len(), all.iter().find(|layer| layer.prefix.is_empty())) {
        return Ok((main.clone(), true));
    }
    let wanted = format!("one layer, named by --layer or rain.streaks.layer: {}", listed());
    Err(BakeError::input(path, "EXR layer", wanted, format!("{} that fit", all.len())))
}

/// Reads the channels of one part alone.
struct OfPart<C> {
    channels: C,
    name: Option<String>,
    wanted: Vec<String>,
}

impl<'s, C: ReadChannels<'s>> ReadChannels<'s> for OfPart<C> {
    type Reader = C::Reader;

    fn create_channels_reader(&'s self, header: &Header) -> exr::error::Result<Self::Reader> {
        let name = header.own_attributes.layer_name.as_ref().map(ToString::to_string);
        let has = |wanted: &String| header.channels.list.iter().any(|c| c.name.to_string() == *wanted);
        if name != self.name || !self.wanted.iter().all(has) {
            return Err(exr::error::Error::Invalid("another part of the file".into()));
        }
        self.channels.create_channels_reader(header)
    }
}

pub(super) fn read_exr(input: &Input, asked: Option<&str>) -> Result<Taken<Picture>, BakeError> {
    let path = input.path.as_path();
    let damaged =
        |error: exr::error::Error| BakeError::input(path, "EXR", "a whole, undamaged picture", error);
    let chunks = exr::block::read(Cursor::new(input.bytes.as_slice()), false).map_err(damaged)?;
    let (layer, assumed) = choose(path, chunks.headers(), asked)?;
    let header = &chunks.headers()[layer.part];
    check_size(path, header.layer_size.0 as u64, header.layer_size.1 as u64)?;
    let mut used = header.channels.list.iter().filter(|c| layer.channels.contains(&c.name.to_string()));
    if used.any(|channel| channel.sampling != exr::math::Vec2(1, 1)) {
        return Err(BakeError::input(path, "EXR", "every channel at full resolution", "subsampled channels"));
    }
    let (width, height) = (header.layer_size.0, header.layer_size.1);
    let mut picture = Picture::new(width, height)?;
    let flat = exr::prelude::read().no_deep_data().largest_resolution_level();
    let blank = move || vec![[0.0f32; 3]; width * height];
    let place = move |at: exr::math::Vec2<usize>| at.1 * width + at.0;
    let (name, wanted) = (layer.part_name.clone(), layer.channels.clone());
    // Alpha is not asked for: it is in the colours already.
    let pixels = match layer.channels.as_slice() {
        [r, g, b] => {
            let channels = flat
                .specific_channels()
                .required(r.as_str())
                .required(g.as_str())
                .required(b.as_str())
                .collect_pixels(
                    move |_, _| blank(),
                    move |pixels, at, (r, g, b): (f32, f32, f32)| pixels[place(at)] = [r, g, b],
                );
            let part = OfPart { channels, name, wanted }.first_valid_layer().all_attributes();
            part.from_chunks(chunks).map_err(damaged)?.layer_data.channel_data.pixels
        }
        grey => {
            let channels = flat.specific_channels().required(grey[0].as_str()).collect_pixels(
                move |_, _| blank(),
                move |pixels, at, (y,): (f32,)| pixels[place(at)] = [y; 3],
            );
            let part = OfPart { channels, name, wanted }.first_valid_layer().all_attributes();
            part.from_chunks(chunks).map_err(damaged)?.layer_data.channel_data.pixels
        }
    };
    for (i, (out, colour)) in picture.pixels.iter_mut().zip(&pixels).enumerate() {
        if !colour.iter().all(|sample| sample.is_finite()) {
            let place = format!("pixel ({}, {})", i % width, i / width);
            return Err(BakeError::input(path, place, "finite samples", format!("{colour:?}")));
        }
        *out = *colour;
    }
    let how = match layer.name.as_str() {
        "" => "linear light, the layer without a name".to_owned(),
        name => format!("linear light, layer \"{name}\""),
    };
    Ok(Taken { picture, how, assumed })
}

/// One channel of an EXR, by the name that `choose` picks among those of the first part that has one: columns, rows and values, which
/// may be infinite or no number.
///
/// Errors: damaged or cut short, deep or subsampled, more than [`super::MAX_PIXELS`], no channel that `choose` takes.
pub fn exr_channel(
    input: &Input,
    choose: impl Fn(&[String]) -> Option<String>,
) -> Result<(usize, usize, Vec<f32>), BakeError> {
    let path = input.path.as_path();
    let damaged =
        |error: exr::error::Error| BakeError::input(path, "EXR", "a whole, undamaged picture", error);
    let chunks = exr::block::read(Cursor::new(input.bytes.as_slice()), false).map_err(damaged)?;
    let names = |header: &Header| -> Vec<String> {
        header.channels.list.iter().map(|channel| channel.name.to_string()).collect()
    };
    let flat = chunks.headers().iter().filter(|header| !header.deep);
    let found = flat.filter_map(|header| Some((header, choose(&names(header))?))).next();
    let Some((header, channel)) = found else {
        let found = chunks.headers().iter().flat_map(names).collect::<Vec<_>>().join(", ");
        return Err(BakeError::input(path, "EXR", "a flat part with a channel Z", found));
    };
    let (width, height) = (header.layer_size.0, header.layer_size.1);
    check_size(path, width as u64, height as u64)?;
    let sampled = header.channels.list.iter().find(|found| found.name.to_string() == channel);
    if sampled.is_some_and(|channel| channel.sampling != exr::math::Vec2(1, 1)) {
        return Err(BakeError::input(path, "EXR", "every channel at full resolution", "subsampled channels"));
    }
    let name = header.own_attributes.layer_name.as_ref().map(ToString::to_string);
    let read = exr::prelude::read().no_deep_data().largest_resolution_level();
    let channels = read.specific_channels().required(channel.as_str()).collect_pixels(
        move |_, _| vec![0.0f32; width * height],
        move |pixels, at: exr::math::Vec2<usize>, (value,): (f32,)| pixels[at.1 * width + at.0] = value,
    );
    let part = OfPart { channels, name, wanted: vec![channel] }.first_valid_layer().all_attributes();
    let values = part.from_chunks(chunks).map_err(damaged)?.layer_data.channel_data.pixels;
    Ok((width, height, values))
}

/// Whether every colour channel of a picture's layer is stored in 16-bit floats, and the name of its alpha channel, if it has one.
///
/// Errors: as [`read_exr`].
pub(super) fn exr_storage(input: &Input) -> Result<(bool, Option<String>), BakeError> {
    let path = input.path.as_path();
    let damaged =
        |error: exr::error::Error| BakeError::input(path, "EXR", "a whole, undamaged picture", error);
    let chunks = exr::block::read(Cursor::new(input.bytes.as_slice()), false).map_err(damaged)?;
    let (layer, _) = choose(path, chunks.headers(), None)?;
    let list = &chunks.headers()[layer.part].channels.list;
    let of_layer = |channel: &&exr::meta::attribute::ChannelDescription| {
        layer.channels.contains(&channel.name.to_string())
    };
    let half = list
        .iter()
        .filter(of_layer)
        .all(|channel| channel.sample_type == exr::meta::attribute::SampleType::F16);
    let alpha = if layer.prefix.is_empty() { "A".to_owned() } else { format!("{}.A", layer.prefix) };
    let has_alpha = list.iter().any(|channel| channel.name.to_string() == alpha);
    Ok((half, has_alpha.then_some(alpha)))
}
