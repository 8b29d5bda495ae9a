//! Buffers: the binary chunk, files beside the scene, and base64.

use crate::error::SceneError;
use crate::scene::{Beside, Limits};
use gltf::json::{Root, buffer::View};
use std::borrow::Cow;

/// Bytes of all buffers.
pub(super) struct Buffers<'a> {
    bytes: Vec<Cow<'a, [u8]>>,
    views: &'a [View],
    /// Bytes that pictures beside the file may still have.
    pub(super) left: u64,
}

impl<'a> Buffers<'a> {
    pub(super) fn read(
        root: &'a Root,
        blob: Option<&'a [u8]>,
        beside: &mut Beside<'_>,
        limits: &Limits,
    ) -> Result<Self, SceneError> {
        let mut left = limits.bytes;
        let mut bytes = Vec::new();
        for (number, buffer) in root.buffers.iter().enumerate() {
            let field = format!("buffers[{number}]");
            let wanted = buffer.byte_length.0;
            if wanted > left {
                let allowed = format!("at most {} bytes in all buffers and pictures", limits.bytes);
                return Err(SceneError::input(field, allowed, format!("{wanted} more")));
            }
            let content = match (&buffer.uri, blob) {
                (Some(uri), _) => Cow::Owned(named(uri, &field, left, beside)?),
                (None, Some(blob)) if number == 0 => Cow::Borrowed(blob),
                (None, _) => return Err(SceneError::input(field, "a uri, or a binary chunk", "neither")),
            };
            if (content.len() as u64) < wanted {
                let words = format!("{wanted} bytes, as it says");
                return Err(SceneError::input(field, words, content.len()));
            }
            left -= (content.len() as u64).min(left);
            bytes.push(content);
        }
        Ok(Self { bytes, views: &root.buffer_views, left })
    }

    /// Bytes of a view, and its stride where it has one.
    pub(super) fn view(&self, index: usize, field: &str) -> Result<(&[u8], Option<usize>), SceneError> {
        let wrong = |wanted: &str, found: String| {
            SceneError::input(format!("{field}: bufferViews[{index}]"), wanted, found)
        };
        let view = self.views.get(index).ok_or_else(|| wrong("a view that is there", "none".into()))?;
        let bytes = self.bytes.get(view.buffer.value());
        let bytes = bytes.ok_or_else(|| wrong("a buffer that is there", view.buffer.value().to_string()))?;
        let (from, length) = (view.byte_offset.map_or(0, |offset| offset.0), view.byte_length.0);
        let part = from.checked_add(length).filter(|end| *end <= bytes.len() as u64);
        let Some(end) = part else {
            let found = format!("bytes {from} to {from} + {length} of {}", bytes.len());
            return Err(wrong("a part of its buffer", found));
        };
        let stride = view.byte_stride.map(|stride| stride.0).filter(|stride| *stride > 0);
        Ok((&bytes[from as usize..end as usize], stride))
    }
}

/// Bytes of a uri: base64 in it, or a file beside the scene.
pub(super) fn named(
    uri: &str,
    field: &str,
    most: u64,
    beside: &mut Beside<'_>,
) -> Result<Vec<u8>, SceneError> {
    if let Some(data) = uri.strip_prefix("data:") {
        let Some((_, text)) = data.split_once(";base64,") else {
            return Err(SceneError::input(format!("{field}.uri"), "base64 data", "another data uri"));
        };
        return base64(text)
            .ok_or_else(|| SceneError::input(format!("{field}.uri"), "base64 data", "other characters"));
    }
    let scheme = uri.split(['/', '?', '#']).next().is_some_and(|start| start.contains(':'));
    if scheme || uri.starts_with('/') || uri.contains('\0') {
        return Err(SceneError::input(format!("{field}.uri"), "a file beside the scene", uri));
    }
    let name = percent_decoded(uri)
        .ok_or_else(|| SceneError::input(format!("{field}.uri"), "UTF-8 behind its percent signs", uri))?;
    beside(&name, most)
}

pub(super) fn percent_decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'%' {
            bytes.push(byte);
            continue;
        }
        let digits = [rest.next()?, rest.next()?];
        bytes.push(u8::from_str_radix(std::str::from_utf8(&digits).ok()?, 16).ok()?);
    }
    String::from_utf8(bytes).ok()
}

fn base64(text: &str) -> Option<Vec<u8>> {
    let digit = |byte: u8| match byte {
        b'A'..=b'Z' => Some(byte - b'A'),
        b'a'..=b'z' => Some(byte - b'a' + 26),
        b'0'..=b'9' => Some(byte - b'0' + 52),
        b'+' => Some(62),
        b'/' => Some(63),
        _ => None,
    };
    let text = text.trim_end_matches('=');
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 3);
    for group in text.as_bytes().chunks(4) {
        if group.len() == 1 {
            return None;
        }
        let mut word = 0u32;
        for place in 0..4 {
            word = word << 6 | u32::from(digit(*group.get(place).unwrap_or(&b'A'))?);
        }
        bytes.extend_from_slice(&word.to_be_bytes()[1..group.len()]);
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_and_percent_signs_are_read_as_their_standards_say() {
        for (text, wanted) in [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYg", "foob")] {
            assert_eq!(base64(text).unwrap(), wanted.as_bytes());
        }
        assert_eq!((base64("Zm9v!"), base64("Z")), (None, None));
        assert_eq!(percent_decoded("a%20b%C3%A4").unwrap(), "a bä");
        assert_eq!((percent_decoded("%4"), percent_decoded("%FF")), (None, None));
    }
}
