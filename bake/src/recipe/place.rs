//! Places in a recipe's text, and errors that point at them.

use crate::error::RecipeError;
use std::ops::Range;
use std::path::Path;
use toml::de::{DeTable, DeValue};

/// Keys of a recipe under which a record's `field` may have been typed, the likeliest first, and what is `wanted` in
/// the units of those keys: records hold radians and seconds, recipes degrees and milliseconds.
fn as_typed<'a>(field: &'a str, wanted: &'a str) -> (Vec<&'a str>, &'a str) {
    /// 100 radians.
    const TURNS: &str = "-5729.5 to 5729.5 degrees";
    match field {
        "heading_rad" => (vec!["heading_deg"], TURNS),
        "pitch_rad" => (vec!["pitch_deg"], "-90 to 90 degrees"),
        "vertical_fov_rad" => (vec!["vertical_fov_deg"], "0.06 to 179.3 degrees"),
        "exposure_s" => (vec!["exposure_ms"], "0.001 to 10000 ms"),
        "sky.sun_azimuth_rad" => (vec!["sky.sun_azimuth_deg"], TURNS),
        "sky.sun_elevation_rad" => (vec!["sky.sun_elevation_deg"], "-17 to 90 degrees"),
        "sky.sun_irradiance_w_per_m2" => (vec!["sky.sun_irradiance_W_per_m2"], wanted),
        "rain.ceiling_m" if wanted.contains("softness") => (vec!["rain.ceiling_softness_m"], "0 to 1e6 m"),
        "rain.region_m" if wanted.contains("centre") => (vec!["rain.centre_m"], "within -1e9 to 1e9 m"),
        "rain.region_m" => (vec!["rain.radius_m", "rain.radius_softness_m"], "0 to 1e7 m"),
        "turn_rad" => (vec!["turn_deg"], "0 to 68.7 degrees"),
        "branch_rad" => (vec!["branch_deg"], "0 to 91.6 degrees"),
        "intensity_w_per_sr" => (vec!["intensity_W_per_sr"], wanted),
        "from_m to to_m" | "from_m, to_m" => (vec!["to_m"], wanted),
        _ => (vec![field], wanted),
    }
}

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
        let (keys, wanted) = as_typed(field, wanted);
        let place = keys.iter().find_map(|name| {
            let path: Vec<&str> = table.iter().copied().chain(name.split('.')).collect();
            Some((path.join("."), self.locate(&path)?))
        });
        match place {
            Some((name, span)) => {
                let found = self.text.get(span.clone()).unwrap_or(&found).to_owned();
                self.error(span, name, wanted, found)
            }
            None => self.error(or_else, format!("{}.{}", table.join("."), keys[0]), wanted, found),
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
        if let Some((kind, wanted, found)) = crate::input::json::unknown(message) {
            return self.error(span, format!("unknown {kind}"), wanted, found);
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
        let found = match squall_formats::magic::kind_of(self.text.as_bytes()) {
            Some(kind) if !kind.starts_with("TOML") && kind != "text" => kind.to_owned(),
            _ => message.replace('\n', "; "),
        };
        self.error(span, "syntax", "a TOML recipe", found)
    }
}
