//! Channels of an OpenEXR file, of any part, layer and kind of sample, placed into its display window.

use crate::error::BakeError;
use crate::input::Input;
use crate::input::picture::MAX_PIXELS;
use exr::block::UncompressedBlock;
use exr::block::reader::ChunksReader;
use exr::meta::attribute::{AttributeValue, SampleType};
use exr::meta::header::Header;
use std::io::Cursor;
use std::path::Path;

/// Most samples that are taken from one file: sixteen buffers of three channels of the largest picture.
const MOST_SAMPLES: u64 = 48 * MAX_PIXELS;

/// A channel as the file names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Which part.
    part: usize,
    /// Its place in the part's list.
    index: usize,
    /// What it belongs to: the part's name and what stands before the channel's last dot, without saying anything twice.
    pub layer: String,
    /// What stands behind the last dot; the whole name where there is no dot.
    pub letter: String,
    /// The whole name, the part's before it.
    pub name: String,
}

/// What a file says of itself.
pub struct Contents<'a> {
    input: &'a Input,
    headers: Vec<Header>,
    /// Its channels, in the file's order; those of deep parts left out.
    pub channels: Vec<Channel>,
    /// Columns and rows of the display window.
    pub size: [usize; 2],
}

/// Values of a channel over the display window, row 0 on top, and which of them the file has.
pub type Plane = Vec<f32>;

fn damaged(path: &Path) -> impl Fn(exr::error::Error) -> BakeError {
    move |error| BakeError::input(path, "EXR", "a whole, undamaged picture", error)
}

impl<'a> Contents<'a> {
    /// Reads the heads of a file.
    ///
    /// Errors: no EXR, damaged, larger than a picture may be, deep parts alone.
    pub fn of(input: &'a Input) -> Result<Self, BakeError> {
        let path = input.path.as_path();
        if !crate::input::picture::is_exr(input) {
            return Err(BakeError::input(path, "format", "an OpenEXR file with layers", input.kind()));
        }
        let reader = exr::block::read(Cursor::new(input.bytes.as_slice()), false).map_err(damaged(path))?;
        let headers: Vec<Header> = reader.headers().to_vec();
        let Some(first) = headers.first() else {
            return Err(BakeError::input(path, "EXR", "a part", "none"));
        };
        let window = first.shared_attributes.display_window.size;
        if (window.0 as u64)
            .checked_mul(window.1 as u64)
            .is_none_or(|count| !(1..=MAX_PIXELS).contains(&count))
        {
            let found = format!("{} × {}", window.0, window.1);
            return Err(BakeError::input(path, "picture size", format!("1 to {MAX_PIXELS} pixels"), found));
        }
        let flat = headers.iter().enumerate().filter(|(_, header)| !header.deep);
        let channels: Vec<Channel> = flat
            .flat_map(|(part, header)| {
                let list = header.channels.list.iter().enumerate();
                list.map(move |(index, channel)| named(part, index, header, &channel.name.to_string()))
            })
            .collect();
        if channels.is_empty() {
            return Err(BakeError::input(path, "EXR", "flat pixels", "deep data alone"));
        }
        Ok(Self { input, headers, channels, size: [window.0, window.1] })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.input.path
    }

    /// The first part's attribute of this name as a text; numbers are written out.
    pub fn text(&self, name: &str) -> Option<String> {
        let attributes = self.headers.iter().flat_map(|header| {
            header.own_attributes.other.iter().chain(header.shared_attributes.other.iter())
        });
        let own =
            attributes.into_iter().find(|(known, _)| **known == *name).and_then(|(_, value)| match value {
                AttributeValue::Text(text) => Some(text.to_string()),
                AttributeValue::F32(value) => Some(value.to_string()),
                AttributeValue::F64(value) => Some(value.to_string()),
                AttributeValue::I32(value) => Some(value.to_string()),
                _ => None,
            });
        let software = || self.headers.iter().find_map(|header| header.own_attributes.software_name.clone());
        own.or_else(|| if name == "software" { software().map(|text| text.to_string()) } else { None })
    }

    /// Names of attributes that no standard has.
    pub fn attributes(&self) -> impl Iterator<Item = String> + '_ {
        let all = self.headers.iter().flat_map(|header| {
            header.own_attributes.other.keys().chain(header.shared_attributes.other.keys())
        });
        all.map(ToString::to_string)
    }

    /// The standard's matrices, as their sixteen numbers stand in the file: world to camera, world to normalised device coordinates.
    pub fn matrices(&self) -> [Option<[f32; 16]>; 2] {
        let first = |of: fn(&Header) -> Option<[f32; 16]>| self.headers.iter().find_map(of);
        [
            first(|header| header.own_attributes.world_to_camera),
            first(|header| header.own_attributes.world_to_normalized_device),
        ]
    }

    /// Width of the screen at distance 1, where the file says another than the usual 1.
    pub fn screen_width(&self) -> Option<f32> {
        let width = self.headers.first().map(|header| header.own_attributes.screen_window_width);
        width.filter(|width| *width > 0.0 && *width != 1.0)
    }

    /// Width of a pixel over its height.
    pub fn pixel_aspect(&self) -> f32 {
        self.headers.first().map_or(1.0, |header| header.shared_attributes.pixel_aspect)
    }

    /// Reads channels; what a data window leaves of the display window is NaN, what lies outside it is left out.
    ///
    /// Errors: damaged, subsampled, more samples than any buffers need, channels of unequal windows.
    pub fn read(&self, wanted: &[&Channel]) -> Result<Vec<Plane>, BakeError> {
        let path = self.path();
        self.check_windows(wanted)?;
        let count = self.size[0] * self.size[1];
        if count as u64 * wanted.len() as u64 > MOST_SAMPLES {
            let found = format!("{} channels of {} × {}", wanted.len(), self.size[0], self.size[1]);
            return Err(BakeError::input(path, "EXR", format!("at most {MOST_SAMPLES} samples"), found));
        }
        let mut planes = vec![vec![f32::NAN; count]; wanted.len()];
        let mut seen = vec![0usize; self.headers.len()];
        let reader =
            exr::block::read(Cursor::new(self.input.bytes.as_slice()), false).map_err(damaged(path))?;
        let chunks = reader.filter_chunks(false, |_, tile, block| {
            tile.is_largest_resolution_level() && wanted.iter().any(|channel| channel.part == block.layer)
        });
        chunks
            .map_err(damaged(path))?
            .decompress_sequential(false, |_, block| {
                seen[block.index.layer] += block.index.pixel_size.0 * block.index.pixel_size.1;
                self.place(&block, wanted, &mut planes)
            })
            .map_err(damaged(path))?;
        for channel in wanted {
            let size = self.headers[channel.part].layer_size;
            if seen[channel.part] < size.0 * size.1 {
                let found = format!("{} of {} pixels", seen[channel.part], size.0 * size.1);
                return Err(BakeError::input(path, "EXR", "a whole, undamaged picture", found));
            }
        }
        Ok(planes)
    }

    fn place(
        &self,
        block: &UncompressedBlock,
        wanted: &[&Channel],
        planes: &mut [Plane],
    ) -> exr::error::UnitResult {
        let header = &self.headers[block.index.layer];
        let corner = header.own_attributes.layer_position - header.shared_attributes.display_window.position;
        let [width, height] = self.size;
        for line in block.lines(&header.channels) {
            let at = line.location;
            let Some(number) =
                wanted.iter().position(|channel| channel.part == at.layer && channel.index == at.channel)
            else {
                continue;
            };
            let row = at.position.1 as i64 + i64::from(corner.1);
            let Some(row) = usize::try_from(row).ok().filter(|row| *row < height) else { continue };
            let left = at.position.0 as i64 + i64::from(corner.0);
            let out = &mut planes[number][row * width..][..width];
            let mut put = |(column, value): (usize, f32)| {
                let column = usize::try_from(left + column as i64).ok().filter(|column| *column < width);
                if let Some(column) = column {
                    out[column] = value;
                }
            };
            match header.channels.list[at.channel].sample_type {
                SampleType::F16 => line
                    .read_samples::<half::f16>()
                    .enumerate()
                    .try_for_each(|(i, value)| value.map(|value| put((i, value.to_f32()))))?,
                SampleType::F32 => line
                    .read_samples::<f32>()
                    .enumerate()
                    .try_for_each(|(i, value)| value.map(|value| put((i, value))))?,
                SampleType::U32 => line
                    .read_samples::<u32>()
                    .enumerate()
                    .try_for_each(|(i, value)| value.map(|value| put((i, value as f32))))?,
            }
        }
        Ok(())
    }

    /// Refuses channels at less than full resolution, and channels whose parts cover unequal windows.
    fn check_windows(&self, wanted: &[&Channel]) -> Result<(), BakeError> {
        let path = self.path();
        let window = |channel: &Channel| {
            let header = &self.headers[channel.part];
            (header.layer_size, header.own_attributes.layer_position)
        };
        for channel in wanted {
            let list = &self.headers[channel.part].channels.list;
            if list.iter().any(|channel| channel.sampling != exr::math::Vec2(1, 1)) {
                let wanted = "every channel at full resolution";
                return Err(BakeError::input(path, "EXR", wanted, "subsampled channels"));
            }
            let (first, own) = (window(wanted[0]), window(channel));
            if first != own {
                let words = |(size, at): (exr::math::Vec2<usize>, exr::math::Vec2<i32>)| {
                    format!("{} × {} at ({}, {})", size.0, size.1, at.0, at.1)
                };
                let wanted = format!("the window of {}, {}", wanted[0].name, words(first));
                return Err(BakeError::input(path, format!("layer {}", channel.name), wanted, words(own)));
            }
        }
        Ok(())
    }
}

/// A channel's layer and letter. Parts of many-part files are layers of their own.
fn named(part: usize, index: usize, header: &Header, channel: &str) -> Channel {
    let own = header.own_attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
    let (prefix, letter) = channel.rsplit_once('.').unwrap_or(("", channel));
    let says =
        prefix == own || prefix.starts_with(&format!("{own}.")) || own.ends_with(&format!(".{prefix}"));
    let layer = match (own.as_str(), prefix) {
        ("", prefix) => prefix.to_owned(),
        (own, "") => own.to_owned(),
        (own, prefix) if says => if own.len() > prefix.len() { own } else { prefix }.to_owned(),
        (own, prefix) => format!("{own}.{prefix}"),
    };
    let name = if layer.is_empty() { letter.to_owned() } else { format!("{layer}.{letter}") };
    Channel { part, index, layer, letter: letter.to_owned(), name }
}
