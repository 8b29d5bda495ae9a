//! JSON inputs: unknown keys are refused with the nearest known one, places by line and column.

use super::{Input, MAX_TEXT_BYTES, may_be_text};
use crate::error::BakeError;
use std::path::Path;

/// Reads a JSON file as `T`; what does not fit is refused with line and column. `what` says what was expected.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path, what: &str) -> Result<T, BakeError> {
    parse_json(&read_text_input(path)?, what)
}

/// Reads a text file of at most 64 MiB; of what is no text, its start alone.
pub(crate) fn read_text_input(path: &Path) -> Result<Input, BakeError> {
    Input::read_if(path, MAX_TEXT_BYTES, may_be_text)
}

/// Reads JSON that is in memory already.
pub fn parse_json<T: serde::de::DeserializeOwned>(input: &Input, what: &str) -> Result<T, BakeError> {
    let text = input.text(what)?;
    serde_json::from_str(text).map_err(|error| {
        let place = format!("line {} column {}", error.line(), error.column());
        let message = error.to_string();
        let message = message.split(" at line ").next().unwrap_or_default();
        if let Some((kind, wanted, found)) = unknown(message) {
            return BakeError::input(&input.path, format!("{place}: unknown {kind}"), wanted, found);
        }
        let kind = squall_formats::magic::kind_of(&input.bytes);
        let found = match kind {
            Some(kind) if error.is_syntax() && kind != "JSON text" && error.line() == 1 => {
                format!("{kind} ({message})")
            }
            _ => message.to_owned(),
        };
        BakeError::input(&input.path, place, what, found)
    })
}

/// What a reader's message about an unknown key or value means: "key" or "value", what is wanted, with the nearest that is
/// known, and what was found. `None` for other messages.
pub(crate) fn unknown(message: &str) -> Option<(&'static str, String, String)> {
    let what = match message {
        _ if message.starts_with("unknown field") => "key",
        _ if message.starts_with("unknown variant") => "value",
        _ => return None,
    };
    let mut names = message.split('`').skip(1).step_by(2);
    let found = names.next().unwrap_or_default();
    let known: Vec<&str> = names.collect();
    let likeness = |name: &str| strsim::jaro_winkler(name, found);
    let near = known.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
    let wanted = match near {
        Some(near) if likeness(near) > LIKE => format!("a known {what}; the nearest is `{near}`"),
        _ => format!("a known {what}: {}", known.join(", ")),
    };
    Some((what, wanted, format!("`{found}`")))
}

/// Jaro-Winkler likeness above which a known name is worth being named alone.
const LIKE: f64 = 0.6;
