//! `[clouds.response] sun`: where the sun may stand over the cloud.

use super::model::SunWish;
use super::place::Source;
use crate::error::RecipeError;
use glam::DVec3;
use squall_formats::section::response::towards_sun;
use std::ops::Range;
use toml::{Spanned, Value};

const FIELD: &str = "clouds.response.sun";
const WANTED: &str = "\"anywhere\", \"view\", { azimuth_deg = …, elevation_deg = … }, { path = { latitude_deg = …, date = …, \
                      hours = [from, to] } }, or the direction [x, y, z] in which its light travels";

/// What the recipe says of the sun.
pub(super) fn check(value: &Spanned<Value>, source: &Source) -> Result<SunWish, RecipeError> {
    let span = value.span();
    let typed = Typed { source, span: span.clone() };
    match value.get_ref() {
        Value::String(word) if word == "anywhere" => Ok(SunWish::Anywhere),
        Value::String(word) if word == "view" => Ok(SunWish::View),
        Value::Array(list) => {
            let numbers: Vec<f64> = list.iter().filter_map(number).collect();
            let direction = (numbers.len() == 3 && list.len() == 3)
                .then(|| DVec3::from_slice(&numbers).try_normalize())
                .flatten();
            let found = || source.error(span, FIELD, "three finite numbers, not all zero", value.get_ref());
            direction.map(|travels| SunWish::At(-travels)).ok_or_else(found)
        }
        Value::Table(table) if table.contains_key("path") => {
            let Some(Value::Table(path)) = table.get("path") else {
                return Err(typed.error("path", "a table", &table["path"]));
            };
            typed.known(table, &["path"])?;
            typed.known(path, &["latitude_deg", "date", "hours"])?;
            let latitude_rad = typed.number(path, "latitude_deg", [-90.0, 90.0])?.to_radians();
            Ok(SunWish::Path { latitude_rad, day: typed.day(path)?, hours: typed.hours(path)? })
        }
        Value::Table(table) => {
            typed.known(table, &["azimuth_deg", "elevation_deg"])?;
            let azimuth = typed.number(table, "azimuth_deg", [-5729.5, 5729.5])?.to_radians();
            let elevation = typed.number(table, "elevation_deg", [-17.0, 90.0])?.to_radians();
            Ok(SunWish::At(DVec3::from_array(towards_sun(azimuth, elevation))))
        }
        other => Err(source.error(span, FIELD, WANTED, other)),
    }
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Float(number) => Some(*number),
        Value::Integer(number) => Some(*number as f64),
        _ => None,
    }
}

/// A value that the recipe typed, for making errors.
struct Typed<'a> {
    source: &'a Source<'a>,
    span: Range<usize>,
}

impl Typed<'_> {
    fn error(&self, key: &str, wanted: impl Into<String>, found: impl ToString) -> RecipeError {
        self.source.error(self.span.clone(), format!("{FIELD}: {key}"), wanted, found)
    }

    fn known(&self, table: &toml::Table, keys: &[&str]) -> Result<(), RecipeError> {
        match table.keys().find(|key| !keys.contains(&key.as_str())) {
            Some(other) => Err(self.error("unknown key", format!("one of {}", keys.join(", ")), other)),
            None => Ok(()),
        }
    }

    fn number(&self, table: &toml::Table, key: &str, [low, high]: [f64; 2]) -> Result<f64, RecipeError> {
        let wanted = || format!("{low} to {high} degrees");
        let value = table.get(key).ok_or_else(|| self.error(key, wanted(), "nothing"))?;
        let inside = number(value).filter(|number| (low..=high).contains(number));
        inside.ok_or_else(|| self.error(key, wanted(), value))
    }

    /// The day of the year, from 1.
    fn day(&self, table: &toml::Table) -> Result<f64, RecipeError> {
        let wanted = "a day of the year, 1 to 366, or a date such as \"2026-06-21\"";
        let value = table.get("date").ok_or_else(|| self.error("date", wanted, "nothing"))?;
        let day = match value {
            Value::Integer(day) => Some(*day).filter(|day| (1..=366).contains(day)),
            Value::String(text) => day_of_year(text),
            Value::Datetime(date) => day_of_year(&date.to_string()),
            _ => None,
        };
        day.map(|day| day as f64).ok_or_else(|| self.error("date", wanted, value))
    }

    fn hours(&self, table: &toml::Table) -> Result<[f64; 2], RecipeError> {
        let wanted = "two hours of solar time, 0 to 24, rising";
        let value = table.get("hours").ok_or_else(|| self.error("hours", wanted, "nothing"))?;
        let pair = match value {
            Value::Array(list) if list.len() == 2 => number(&list[0]).zip(number(&list[1])),
            _ => None,
        };
        let rising = pair.filter(|&(from, to)| 0.0 <= from && from < to && to <= 24.0);
        rising.map(|(from, to)| [from, to]).ok_or_else(|| self.error("hours", wanted, value))
    }
}

/// Day of the year of "YYYY-MM-DD", from 1.
fn day_of_year(text: &str) -> Option<i64> {
    let parts: Vec<i64> = text.split('-').map(str::parse).collect::<Result<_, _>>().ok()?;
    let &[year, month, day] = parts.as_slice() else { return None };
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let days = [31, 28 + i64::from(leap), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let month = usize::try_from(month).ok().filter(|month| (1..=12).contains(month))?;
    (1..=days[month - 1]).contains(&day).then(|| days[..month - 1].iter().sum::<i64>() + day)
}

/// Unit vector towards the sun, x east and y north, at an hour of local solar time (12 when it is highest). The declination is
/// \[spencer\]'s, within .04°.
pub fn sun_at(latitude_rad: f64, day: f64, hour: f64) -> DVec3 {
    let year = 2.0 * std::f64::consts::PI * (day - 1.0 + (hour - 12.0) / 24.0) / 365.0;
    let harmonic = |order: f64| libm::sincos(order * year);
    let ((s1, c1), (s2, c2), (s3, c3)) = (harmonic(1.0), harmonic(2.0), harmonic(3.0));
    let declination = 0.006918 - 0.399912 * c1 + 0.070257 * s1 - 0.006758 * c2 + 0.000907 * s2
        - 0.002697 * c3
        + 0.00148 * s3;
    let (sin_d, cos_d) = libm::sincos(declination);
    let (sin_l, cos_l) = libm::sincos(latitude_rad);
    let (sin_h, cos_h) = libm::sincos((hour - 12.0) * std::f64::consts::PI / 12.0);
    DVec3::new(-cos_d * sin_h, cos_l * sin_d - sin_l * cos_d * cos_h, sin_l * sin_d + cos_l * cos_d * cos_h)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sun_stands_where_almanacs_have_it() {
        /// Degrees: Spencer's series, and days that begin at noon.
        const ALMANAC: f64 = 0.3;
        let elevation = |sun: DVec3| libm::asin(sun.z).to_degrees();
        // At the solstices 23.44° on either side of the equator's noon; at the equinox due east at six.
        let noon = |day| elevation(sun_at(50f64.to_radians(), day, 12.0));
        assert!((noon(172.0) - 63.44).abs() < ALMANAC && (noon(355.0) - 16.56).abs() < ALMANAC);
        assert!((noon(80.0) - 40.0).abs() < ALMANAC);
        let morning = sun_at(0.9, 80.0, 6.0);
        assert!(morning.x > 0.999 && morning.z.abs() < 0.01, "{morning}");
        assert!(sun_at(0.9, 172.0, 15.0).x < 0.0 && (sun_at(0.9, 172.0, 15.0).length() - 1.0).abs() < 1e-12);
        assert_eq!(day_of_year("2026-06-21"), Some(172));
        assert_eq!((day_of_year("2024-12-31"), day_of_year("2026-02-29")), (Some(366), None));
    }
}
