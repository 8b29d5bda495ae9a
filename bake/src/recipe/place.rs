//! Places in a recipe's text, and errors that point at them.

use crate::error::RecipeError;
use std::ops::Range;
use std::path::Path;
use toml::de::{DeTable, DeValue};

/// A recipe's text, for making errors.
pub(super) struct Source<'a> {
    pub file: &'a Path,
    pub text: &'a str,
}

impl Source<'_> {
    /// Where the value of a key stands, found by its path through tables and arrays.
    pub fn locate(&self, path: &[&str]) -> Option<Range<usize>> {
        let (whole, _) = DeTable::parse_recoverable(self.text);
        let (first, rest) = path.split_first()?;
        let mut value = whole.get_ref().get(*first)?;
        for key in rest {
            value = match value.get_ref() {
                DeValue::Table(table) => table.get(*key)?,
                DeValue::Array(list) => list.get(key.parse::<usize>().ok()?)?,
                _ => return None,
            };
        }
        Some(value.span())
    }

    /// Refuses a number that a record's own check found out of range. `keys` are the names under which the record's
    /// `field` may have been typed; what stands there is shown as it was typed.
    pub fn refused(
        &self,
        table: &[&str],
        field: &str,
        wanted: &str,
        found: String,
        or_else: Range<usize>,
    ) -> RecipeError {
        let typed = [field.to_owned(), field.replace("_rad", "_deg"), field.replace("_s", "_ms")];
        let place = typed.iter().find_map(|name| {
            let path: Vec<&str> = table.iter().copied().chain(name.split('.')).collect();
            Some((path.join("."), self.locate(&path)?))
        });
        match place {
            Some((name, span)) => {
                let found = self.text.get(span.clone()).unwrap_or(&found).to_owned();
                self.error(span, name, wanted, found)
            }
            None => self.error(or_else, format!("{}.{field}", table.join(".")), wanted, found),
        }
    }

    /// An error at `span`.
    pub fn error(
        &self,
        span: Range<usize>,
        field: impl Into<String>,
        wanted: impl Into<String>,
        found: impl ToString,
    ) -> RecipeError {
        RecipeError {
            file: self.file.into(),
            text: self.text.into(),
            span,
            field: field.into(),
            wanted: wanted.into(),
            found: found.to_string(),
        }
    }

    /// Puts what the TOML reader refuses into the recipe's own words: an unknown key names the nearest known one.
    pub fn refused_text(&self, error: &toml::de::Error) -> RecipeError {
        let span = error.span().unwrap_or(0..0);
        let message = error.message().trim();
        let names: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
        if message.starts_with("unknown field") || message.starts_with("unknown variant") {
            let known = names.get(1..).unwrap_or_default();
            let found = names.first().copied().unwrap_or_default();
            let near = known
                .iter()
                .max_by(|a, b| strsim::jaro_winkler(a, found).total_cmp(&strsim::jaro_winkler(b, found)));
            let what = if message.starts_with("unknown field") { "key" } else { "value" };
            let wanted = match near {
                Some(near) if strsim::jaro_winkler(near, found) > 0.6 => {
                    format!("a known {what}; the nearest is `{near}`")
                }
                _ => format!("a known {what}: {}", known.join(", ")),
            };
            return self.error(span, format!("unknown {what}"), wanted, format!("`{found}`"));
        }
        if let Some(name) = message.strip_prefix("missing field") {
            return self.error(span, name.trim().trim_matches('`'), "a value", "nothing");
        }
        if let Some((found, wanted)) =
            message.strip_prefix("invalid type: ").and_then(|rest| rest.split_once(", expected "))
        {
            let line = &self.text[..span.start.min(self.text.len())];
            let key =
                line.rsplit('\n').next().unwrap_or_default().split('=').next().unwrap_or_default().trim();
            return self.error(span, if key.is_empty() { "value" } else { key }, wanted, found);
        }
        self.error(span, "syntax", "a TOML recipe", message.replace('\n', "; "))
    }
}
