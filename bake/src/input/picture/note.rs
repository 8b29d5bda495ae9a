//! What a picture's file says of itself: a text chunk of a PNG, a text attribute of an OpenEXR.

use super::{is_exr, is_png};
use crate::input::Input;
use exr::prelude::AttributeValue;
use std::io::Cursor;

/// The text under a keyword; `None` where there is none, or the head cannot be read.
pub fn note_of(input: &Input, keyword: &str) -> Option<String> {
    if is_png(input) {
        let reader = png::Decoder::new(Cursor::new(&input.bytes)).read_info().ok()?;
        let chunks = &reader.info().uncompressed_latin1_text;
        return chunks.iter().find(|chunk| chunk.keyword == keyword).map(|chunk| chunk.text.clone());
    }
    if !is_exr(input) {
        return None;
    }
    let head = exr::meta::MetaData::read_from_buffered(Cursor::new(input.bytes.as_slice()), false).ok()?;
    let mut others = head.headers.iter().flat_map(|header| &header.own_attributes.other);
    others.find_map(|(name, value)| match value {
        AttributeValue::Text(text) if name.eq(keyword) => Some(text.to_string()),
        _ => None,
    })
}
