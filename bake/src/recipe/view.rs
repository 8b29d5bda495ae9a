//! The recipe's picture as it is typed: `[view]` and the tables under it.

use super::place::Source;
use crate::error::RecipeError;
use serde::Deserialize;
use squall_formats::section::view::{
    ViewCamera, ViewDetail, ViewEffect, ViewFlash, ViewForm, ViewMedium, ViewPhase, ViewRain, ViewSection,
    ViewSky, ViewTone,
};
use squall_runtime::wet::draw::{Effect, WetSettings};
use std::collections::BTreeMap;
use std::ops::Range;
use toml::Spanned;

/// `[view]`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewFile {
    position_m: [f64; 3],
    heading_deg: f64,
    pitch_deg: Option<f64>,
    vertical_fov_deg: Option<f64>,
    size_px: Option<[u32; 2]>,
    exposure_ms: Option<f64>,
    flashes: Option<Vec<Spanned<FlashFile>>>,
    #[serde(default)]
    rain: RainFile,
    #[serde(default)]
    sky: SkyFile,
    #[serde(default)]
    detail: DetailFile,
    #[serde(default)]
    tone: ToneFile,
    #[serde(default)]
    wet: WetFile,
}

/// `[view.wet.EFFECT]`: `on`, and controls by name.
type WetFile = BTreeMap<Spanned<String>, BTreeMap<Spanned<String>, Spanned<toml::Value>>>;

/// A stroke's name, or its name and a factor.
#[derive(Deserialize)]
#[serde(untagged)]
enum FlashFile {
    Name(String),
    Factor { stroke: String, brightness: f64 },
}

/// The medium's forms by name.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum FormName {
    BesideStreaks,
    Whole,
    Paper,
}

/// Phase functions by name.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum PhaseName {
    Hg,
    Drops,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct RainFile {
    rate_mm_per_h: Option<f64>,
    wind_m_per_s: Option<[f64; 3]>,
    time_s: Option<f64>,
    seed: Option<u64>,
    streak_px: Option<[f64; 2]>,
    gain: Option<f64>,
    medium: Option<FormName>,
    phase: Option<PhaseName>,
    g: Option<f64>,
    ceiling_m: Option<f64>,
    ceiling_softness_m: Option<f64>,
    centre_m: Option<[f64; 2]>,
    radius_m: Option<f64>,
    radius_softness_m: Option<f64>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct SkyFile {
    sun_azimuth_deg: Option<f64>,
    sun_elevation_deg: Option<f64>,
    haze: Option<f64>,
    overcast: Option<f64>,
    high_cloud: Option<f64>,
    #[serde(rename = "sun_irradiance_W_per_m2")]
    sun_irradiance: Option<[f64; 3]>,
    tint: Option<[f64; 3]>,
    ground_albedo: Option<f64>,
    seed: Option<u32>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct DetailFile {
    amplitude: Option<f64>,
    size_m: Option<f64>,
    fibres_from_m: Option<f64>,
    seed: Option<u32>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ToneFile {
    exposure: Option<f64>,
    contrast: Option<f64>,
    // The name of recipes from before rain had a point spread of its own.
    #[serde(alias = "glow_amount")]
    bloom_amount: Option<f64>,
    #[serde(alias = "glow_levels")]
    bloom_levels: Option<u32>,
    #[serde(alias = "glow_reach")]
    bloom_reach: Option<f64>,
}

impl ViewFile {
    /// The view that it says; `strokes` are the names that may flash, all of them where none is listed.
    pub fn check(
        self,
        source: &Source,
        span: Range<usize>,
        strokes: &[String],
    ) -> Result<ViewSection, RecipeError> {
        let usual = ViewCamera::default();
        let camera = ViewCamera {
            position_m: self.position_m,
            heading_rad: self.heading_deg.to_radians(),
            pitch_rad: self.pitch_deg.map_or(usual.pitch_rad, f64::to_radians),
            vertical_fov_rad: self.vertical_fov_deg.map_or(usual.vertical_fov_rad, f64::to_radians),
            size_px: self.size_px.unwrap_or(usual.size_px),
            exposure_s: self.exposure_ms.map_or(usual.exposure_s, |ms| ms / 1000.0),
        };
        let flashes = match self.flashes {
            None => strokes.iter().map(|name| ViewFlash { stroke: name.clone(), brightness: 1.0 }).collect(),
            Some(list) => {
                let mut flashes: Vec<ViewFlash> = Vec::new();
                for flash in list {
                    let at = flash.span();
                    let flash = match flash.into_inner() {
                        FlashFile::Name(stroke) => ViewFlash { stroke, brightness: 1.0 },
                        FlashFile::Factor { stroke, brightness } => ViewFlash { stroke, brightness },
                    };
                    if !strokes.contains(&flash.stroke) {
                        let wanted = format!("the name of a stroke of this recipe: {}", strokes.join(", "));
                        let found = format!("`{}`", flash.stroke);
                        return Err(source.error(at, "view.flashes", wanted, found));
                    }
                    flashes.push(flash);
                }
                flashes
            }
        };
        let medium = self.rain.medium().map_err(|(field, wanted, found)| {
            source.refused(&["view"], field, wanted, found, span.clone())
        })?;
        let view = ViewSection {
            wet: wet_effects(self.wet, source)?,
            camera,
            medium,
            rain: self.rain.record(),
            sky: self.sky.record(),
            detail: self.detail.record(),
            flashes,
            tone: self.tone.record(),
        };
        view.check().map_err(|(field, wanted, found)| {
            let field = field.strip_prefix("camera.").unwrap_or(field);
            source.refused(&["view"], field, wanted, found, span)
        })?;
        Ok(view)
    }
}

/// The nearest of some names to one that is none of them.
fn nearest<'a>(found: &str, known: impl Iterator<Item = &'a str>) -> String {
    let known: Vec<&str> = known.collect();
    let nearest =
        known.iter().max_by(|a, b| strsim::jaro_winkler(found, a).total_cmp(&strsim::jaro_winkler(found, b)));
    format!("`{}`; all: {}", nearest.copied().unwrap_or_default(), known.join(", "))
}

/// What a view says of the wet city's effects.
fn wet_effects(file: WetFile, source: &Source) -> Result<Vec<ViewEffect>, RecipeError> {
    let mut all = Vec::new();
    let mut settings = WetSettings::default();
    for (name, controls) in file {
        let Some(effect) = Effect::from_name(name.get_ref()) else {
            let known = nearest(name.get_ref(), Effect::ALL.into_iter().map(Effect::name));
            return Err(source.error(name.span(), "view.wet", known, format!("`{}`", name.get_ref())));
        };
        let mut said = ViewEffect { effect: effect.name().into(), on: true, controls: Vec::new() };
        for (key, value) in controls {
            let field = format!("view.wet.{}.{}", effect.name(), key.get_ref());
            let refused = |wanted: String| {
                let found = source.text.get(value.span()).unwrap_or_default().to_owned();
                source.error(value.span(), field.clone(), wanted, found)
            };
            if key.get_ref() == "on" {
                said.on = value.get_ref().as_bool().ok_or_else(|| refused("true or false".into()))?;
                continue;
            }
            let names = || effect.parameters().iter().map(|parameter| parameter.name);
            let Some(parameter) = effect.parameters().iter().find(|known| known.name == key.get_ref()) else {
                let known = nearest(key.get_ref(), names().chain(["on"]));
                let field = format!("view.wet.{}", effect.name());
                return Err(source.error(key.span(), field, known, format!("`{}`", key.get_ref())));
            };
            let number =
                value.get_ref().as_float().or_else(|| value.get_ref().as_integer().map(|n| n as f64));
            let [low, high] = parameter.range;
            let wanted = || format!("{low} to {high} {}", parameter.unit).trim_end().to_owned();
            let number = number.ok_or_else(|| refused(wanted()))?;
            settings.set(effect, parameter.name, number as f32).map_err(|_| refused(wanted()))?;
            said.controls.push((parameter.name.to_owned(), number));
        }
        all.push(said);
    }
    Ok(all)
}

impl RainFile {
    /// The medium, or what doesn't go together.
    fn medium(&self) -> Result<ViewMedium, (&'static str, &'static str, String)> {
        let form = match self.medium {
            None | Some(FormName::BesideStreaks) => ViewForm::BesideStreaks,
            Some(FormName::Whole) => ViewForm::Whole,
            Some(FormName::Paper) => ViewForm::Paper,
        };
        let phase = match (self.phase, self.g) {
            (Some(PhaseName::Drops), Some(g)) => {
                return Err(("rain.g", "no g beside phase = \"drops\", which has its own", g.to_string()));
            }
            (Some(PhaseName::Drops), None) => ViewPhase::Drops,
            (_, Some(g)) => ViewPhase::Asymmetry(g),
            (_, None) => ViewPhase::OfForm,
        };
        Ok(ViewMedium { form, phase })
    }

    fn record(self) -> ViewRain {
        let usual = ViewRain::default();
        ViewRain {
            rate_mm_per_h: self.rate_mm_per_h.unwrap_or(usual.rate_mm_per_h),
            wind_m_per_s: self.wind_m_per_s.unwrap_or(usual.wind_m_per_s),
            time_s: self.time_s.unwrap_or(usual.time_s),
            seed: self.seed.unwrap_or(usual.seed),
            streak_px: self.streak_px.unwrap_or(usual.streak_px),
            gain: self.gain.unwrap_or(usual.gain),
            ceiling_m: self.ceiling_m.map(|height| [height, self.ceiling_softness_m.unwrap_or(0.0)]),
            region_m: self.radius_m.map(|radius| {
                let [x, y] = self.centre_m.unwrap_or([0.0; 2]);
                [x, y, radius, self.radius_softness_m.unwrap_or(0.0)]
            }),
        }
    }
}

impl SkyFile {
    fn record(self) -> ViewSky {
        let usual = ViewSky::default();
        ViewSky {
            sun_azimuth_rad: self.sun_azimuth_deg.map_or(usual.sun_azimuth_rad, f64::to_radians),
            sun_elevation_rad: self.sun_elevation_deg.map_or(usual.sun_elevation_rad, f64::to_radians),
            haze: self.haze.unwrap_or(usual.haze),
            overcast: self.overcast.unwrap_or(usual.overcast),
            high_cloud: self.high_cloud.unwrap_or(usual.high_cloud),
            sun_irradiance_w_per_m2: self.sun_irradiance.unwrap_or(usual.sun_irradiance_w_per_m2),
            tint: self.tint.unwrap_or(usual.tint),
            ground_albedo: self.ground_albedo.unwrap_or(usual.ground_albedo),
            seed: self.seed.unwrap_or(usual.seed),
        }
    }
}

impl DetailFile {
    fn record(self) -> ViewDetail {
        let usual = ViewDetail::default();
        ViewDetail {
            amplitude: self.amplitude.unwrap_or(usual.amplitude),
            size_m: self.size_m.unwrap_or(usual.size_m),
            fibres_from_m: self.fibres_from_m.unwrap_or(usual.fibres_from_m),
            seed: self.seed.unwrap_or(usual.seed),
        }
    }
}

impl ToneFile {
    fn record(self) -> ViewTone {
        let usual = ViewTone::default();
        ViewTone {
            exposure: self.exposure.unwrap_or(usual.exposure),
            contrast: self.contrast.unwrap_or(usual.contrast),
            bloom_amount: self.bloom_amount.unwrap_or(usual.bloom_amount),
            bloom_levels: self.bloom_levels.unwrap_or(usual.bloom_levels),
            bloom_reach: self.bloom_reach.unwrap_or(usual.bloom_reach),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lens_bloom_is_read_by_its_name_and_by_the_one_it_had_before_but_not_by_both() {
        let read = |text: &str| toml::from_str::<ToneFile>(text).map(ToneFile::record);
        let new = read("bloom_amount = 0.2\nbloom_levels = 5\nbloom_reach = 0.9").unwrap();
        assert_eq!((new.bloom_amount, new.bloom_levels, new.bloom_reach), (0.2, 5, 0.9));
        assert_eq!(read("glow_amount = 0.2\nglow_levels = 5\nglow_reach = 0.9").unwrap(), new);
        let both = read("bloom_amount = 0.2\nglow_amount = 0.2").unwrap_err().to_string();
        assert!(both.contains("bloom_amount"), "{both}");
        assert!(read("glow = 0.2").is_err());
    }
}
