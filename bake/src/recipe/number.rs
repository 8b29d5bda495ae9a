//! Numbers and files of a recipe, checked where they stand.

use super::place::Source;
use crate::error::RecipeError;
use crate::input::scene::beside;
use std::path::PathBuf;
use toml::Spanned;

pub(super) type Number = Spanned<f64>;

impl Source<'_> {
    /// `value` if it lies in [low, high], or `default`.
    pub(super) fn number(
        &self,
        field: &str,
        value: &Option<Number>,
        default: f64,
        [low, high]: [f64; 2],
        unit: &str,
    ) -> Result<f64, RecipeError> {
        let Some(value) = value else { return Ok(default) };
        let number = *value.get_ref();
        if number >= low && number <= high {
            return Ok(number);
        }
        let wanted = format!("{low} to {high}{}{unit}", if unit.is_empty() { "" } else { " " });
        Err(self.error(value.span(), field, wanted, number))
    }

    /// Like [`Source::number`], nothing where the recipe says nothing.
    pub(super) fn optional(
        &self,
        field: &str,
        value: &Option<Number>,
        range: [f64; 2],
        unit: &str,
    ) -> Result<Option<f64>, RecipeError> {
        value.as_ref().map(|_| self.number(field, value, 0.0, range, unit)).transpose()
    }

    /// Like [`Source::number`], for whole numbers.
    pub(super) fn count(
        &self,
        field: &str,
        value: &Option<Number>,
        default: u32,
        [low, high]: [u32; 2],
    ) -> Result<u32, RecipeError> {
        let number = self.number(field, value, f64::from(default), [f64::from(low), f64::from(high)], "")?;
        match value {
            Some(value) if number != number.floor() => {
                Err(self.error(value.span(), field, "a whole number", number))
            }
            _ => Ok(number as u32),
        }
    }

    /// A rising pair inside [low, high], or `default`.
    pub(super) fn range(
        &self,
        field: &str,
        value: &Option<Spanned<[f64; 2]>>,
        default: [f64; 2],
        [low, high]: [f64; 2],
        unit: &str,
    ) -> Result<[f64; 2], RecipeError> {
        let Some(value) = value else { return Ok(default) };
        let pair = *value.get_ref();
        if low <= pair[0] && pair[0] < pair[1] && pair[1] <= high {
            return Ok(pair);
        }
        let wanted = format!("two rising numbers within {low} to {high} {unit}");
        Err(self.error(value.span(), field, wanted, format!("{pair:?}")))
    }

    /// A file beside the recipe, which must be there.
    pub(super) fn beside(&self, field: &str, name: &Spanned<PathBuf>) -> Result<PathBuf, RecipeError> {
        let path = beside(self.file, name.get_ref());
        if path.is_file() {
            return Ok(path);
        }
        let why = match std::fs::metadata(&path) {
            Ok(metadata) if metadata.is_dir() => "a folder",
            Ok(_) => "neither a file nor a folder",
            Err(error) if error.kind() == std::io::ErrorKind::PermissionDenied => {
                "out of reach (no permission)"
            }
            Err(_) => "not there",
        };
        Err(self.error(name.span(), field, "a file", format!("{}, which is {why}", path.display())))
    }
}
