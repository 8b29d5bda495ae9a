//! `[clouds]` of a recipe, as it is typed and checked.

use super::file::Number;
use super::place::Source;
use super::{Clouds, Lamps, RecipeError};
use crate::budget::clouds::{CloudBudget, Given};
use crate::input::scene::Optics;
use crate::response::ResponseSettings;
use serde::Deserialize;
use squall_formats::section::response::{Codec, DirectTerm, DirectionalBasis, DistantKind, SweepScheme};
use squall_formats::view_region::ViewRegion;
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::SolveSettings;
use std::path::PathBuf;
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CloudsFile {
    scene: Spanned<PathBuf>,
    kappa_per_m: Option<Number>,
    albedo: Option<Number>,
    g: Option<Number>,
    #[serde(default)]
    lightning: LightningFile,
    #[serde(default)]
    transport: TransportFile,
    #[serde(default)]
    response: ResponseFile,
    #[serde(default)]
    budget: BudgetFile,
    #[serde(rename = "eyes")]
    view_region: Option<ViewRegionFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewRegionFile {
    low_m: Spanned<[f64; 3]>,
    high_m: Spanned<[f64; 3]>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct BudgetFile {
    stroke_l2: Option<Number>,
    relit_l2: Option<Number>,
    solver_l2: Option<Number>,
    bytes: Option<Number>,
    relight_ms: Option<Number>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct LightningFile {
    low_m: Option<Spanned<[f64; 3]>>,
    high_m: Option<Spanned<[f64; 3]>>,
    spacing_m: Option<Number>,
    epsilon_per_m2: Option<Number>,
    longest_m: Option<Number>,
    prune: Option<bool>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct TransportFile {
    directions: Option<Spanned<String>>,
    scheme: Option<SchemeName>,
    delta_m: Option<bool>,
    refine: Option<Number>,
    samples: Option<Number>,
    tolerance: Option<Number>,
    max_sweeps: Option<Number>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum SchemeName {
    Weighted,
    Diamond,
    Step,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ResponseFile {
    channels: Option<Spanned<ChannelsName>>,
    direct: Option<DirectName>,
    codec: Option<CodecName>,
    error: Option<Number>,
    distant: Option<Vec<DistantName>>,
    sun_direction: Option<Spanned<[f64; 3]>>,
    test_strokes: Option<Number>,
    seen_only: Option<bool>,
}

#[derive(Clone, Copy, Deserialize)]
enum ChannelsName {
    #[serde(rename = "directions-26")]
    Directions26,
    #[serde(rename = "harmonics-0")]
    Harmonics0,
    #[serde(rename = "harmonics-1")]
    Harmonics1,
    #[serde(rename = "harmonics-2")]
    Harmonics2,
    #[serde(rename = "harmonics-3")]
    Harmonics3,
    #[serde(rename = "eyes-0")]
    ViewRegion0,
    #[serde(rename = "eyes-1")]
    ViewRegion1,
    #[serde(rename = "eyes-2")]
    ViewRegion2,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum DirectName {
    Rows,
    RunTime,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum CodecName {
    Bytes,
    Paper,
}

#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
enum DistantName {
    UpperSky,
    LowerSky,
}

/// A direction set from its name: 14, 26, 50, or polar nodes per hemisphere × azimuths.
pub fn parse_directions(name: &str) -> Option<Quadrature> {
    let set = match name {
        "14" => Quadrature::Lebedev14,
        "26" => Quadrature::Lebedev26,
        "50" => Quadrature::Lebedev50,
        other => {
            let (polar, azimuths) = other.split_once('x')?;
            Quadrature::DoubleGauss { polar: polar.parse().ok()?, azimuths: azimuths.parse().ok()? }
        }
    };
    set.ordinates().ok().map(|_| set)
}

impl CloudsFile {
    /// `has_strokes`: whether the recipe has strokes that lamps can be pruned to.
    pub(super) fn check(self, has_strokes: bool, source: &Source) -> Result<Clouds, RecipeError> {
        let optics = Optics {
            albedo: source.optional("clouds.albedo", &self.albedo, [0.0, 1.0], "")?,
            g: source.optional("clouds.g", &self.g, [-0.999, 0.999], "")?,
            kappa_per_m: source.optional("clouds.kappa_per_m", &self.kappa_per_m, [0.0, 1e12], "1/m")?,
        };
        let response = &self.response;
        let mut distant: Vec<DistantKind> = response
            .distant
            .iter()
            .flatten()
            .map(|name| match name {
                DistantName::UpperSky => DistantKind::UpperSky,
                DistantName::LowerSky => DistantKind::LowerSky,
            })
            .collect();
        if let Some(sun) = &response.sun_direction {
            let direction = glam::DVec3::from_array(*sun.get_ref()).try_normalize();
            let field = "clouds.response.sun_direction";
            let direction = direction.ok_or_else(|| {
                source.error(
                    sun.span(),
                    field,
                    "a finite vector that is not zero",
                    format!("{:?}", sun.get_ref()),
                )
            })?;
            distant.push(DistantKind::Beam { direction: direction.to_array() });
        }
        let budget = CloudBudget {
            stroke_l2: source.optional("clouds.budget.stroke_l2", &self.budget.stroke_l2, [1e-4, 1.0], "")?,
            relit_l2: source.optional("clouds.budget.relit_l2", &self.budget.relit_l2, [1e-5, 1.0], "")?,
            solver_l2: source.optional("clouds.budget.solver_l2", &self.budget.solver_l2, [1e-4, 1.0], "")?,
            bytes: source
                .optional("clouds.budget.bytes", &self.budget.bytes, [1e3, 1e12], "")?
                .map(|v| v as u64),
            relight_ms: source.optional(
                "clouds.budget.relight_ms",
                &self.budget.relight_ms,
                [1e-3, 1e5],
                "ms",
            )?,
        };
        let mut lights = self.lightning.check(source)?;
        let mut settings = self.settings(source)?;
        settings.view_region = self.view_region(source)?;
        if let (DirectionalBasis::ViewRegion { .. }, Some(name)) = (settings.channels, &response.channels) {
            let wanted = match (settings.view_region, settings.direct) {
                (None, _) => Some(("[clouds.eyes] beside channels towards eyes", "none")),
                (_, DirectTerm::InRows) => {
                    Some(("direct = \"run-time\" beside channels towards eyes", "\"rows\""))
                }
                _ => None,
            };
            if let Some((wanted, found)) = wanted {
                return Err(source.error(name.span(), "clouds.response.channels", wanted, found));
            }
        }
        // Whoever says what is good enough, or who looks, has no use for what nobody can reach.
        if budget.judges() || settings.view_region.is_some() {
            settings.seen_only = response.seen_only.unwrap_or(true);
            let boxed = lights.low_m.is_some() || lights.high_m.is_some();
            lights.prune = self.lightning.prune.unwrap_or(has_strokes && !boxed);
        }
        Ok(Clouds {
            scene: source.beside("clouds.scene", &self.scene)?,
            optics,
            lights,
            distant,
            response: settings,
            test_strokes: source.count("clouds.response.test_strokes", &response.test_strokes, 8, [0, 64])?,
            budget,
            given: Given {
                spacing: self.lightning.spacing_m.is_some(),
                channels: response.channels.is_some(),
                error: response.error.is_some(),
                solver: self.transport.directions.is_some() || self.transport.refine.is_some(),
            },
        })
    }

    fn view_region(&self, source: &Source) -> Result<Option<ViewRegion>, RecipeError> {
        let Some(view_region) = &self.view_region else { return Ok(None) };
        let ViewRegionFile { low_m, high_m } = view_region;
        for (field, corner) in [("clouds.eyes.low_m", low_m), ("clouds.eyes.high_m", high_m)] {
            // Written so that NaN is refused too.
            if !corner.get_ref().iter().all(|v| v.abs() <= 1e6) {
                let found = format!("{:?}", corner.get_ref());
                return Err(source.error(corner.span(), field, "three numbers, -1e6 to 1e6 m", found));
            }
        }
        let (low, high) = (*low_m.get_ref(), *high_m.get_ref());
        if (0..3).any(|axis| low[axis] > high[axis]) {
            let found = format!("{high:?} beside low_m {low:?}");
            return Err(source.error(high_m.span(), "clouds.eyes.high_m", "no less than low_m", found));
        }
        Ok(Some(ViewRegion { low_m: low, high_m: high }))
    }

    fn settings(&self, source: &Source) -> Result<ResponseSettings, RecipeError> {
        let (transport, response) = (&self.transport, &self.response);
        let quadrature = match &transport.directions {
            Some(value) => source.directions(value)?,
            None => Quadrature::DoubleGauss { polar: 2, azimuths: 8 },
        };
        let solve = SolveSettings {
            quadrature,
            scheme: match transport.scheme.unwrap_or(SchemeName::Weighted) {
                SchemeName::Weighted => SweepScheme::Weighted,
                SchemeName::Diamond => SweepScheme::Diamond,
                SchemeName::Step => SweepScheme::Step,
            },
            delta: transport.delta_m.unwrap_or(true),
            tolerance: source.number(
                "clouds.transport.tolerance",
                &transport.tolerance,
                1e-3,
                [1e-6, 0.5],
                "",
            )?,
            max_sweeps: source.count(
                "clouds.transport.max_sweeps",
                &transport.max_sweeps,
                2000,
                [4, 100_000],
            )?,
            ..SolveSettings::default()
        };
        Ok(ResponseSettings {
            channels: match response
                .channels
                .as_ref()
                .map_or(ChannelsName::Harmonics1, |name| *name.get_ref())
            {
                ChannelsName::Directions26 => DirectionalBasis::Directions26,
                ChannelsName::Harmonics0 => DirectionalBasis::Harmonics { degree: 0 },
                ChannelsName::Harmonics1 => DirectionalBasis::Harmonics { degree: 1 },
                ChannelsName::Harmonics2 => DirectionalBasis::Harmonics { degree: 2 },
                ChannelsName::Harmonics3 => DirectionalBasis::Harmonics { degree: 3 },
                ChannelsName::ViewRegion0 => DirectionalBasis::ViewRegion { degree: 0 },
                ChannelsName::ViewRegion1 => DirectionalBasis::ViewRegion { degree: 1 },
                ChannelsName::ViewRegion2 => DirectionalBasis::ViewRegion { degree: 2 },
            },
            direct: match response.direct.unwrap_or(DirectName::RunTime) {
                DirectName::Rows => DirectTerm::InRows,
                DirectName::RunTime => DirectTerm::AtRunTime,
            },
            codec: match response.codec.unwrap_or(CodecName::Bytes) {
                CodecName::Bytes => Codec::Bytes,
                CodecName::Paper => Codec::Paper,
            },
            relative_error: source.number(
                "clouds.response.error",
                &response.error,
                0.01,
                [0.0, 0.9],
                "of a lamp's light",
            )?,
            // Set where budget and eyes are known.
            seen_only: response.seen_only.unwrap_or(false),
            view_region: None,
            refine: source.count("clouds.transport.refine", &transport.refine, 1, [1, 16])?,
            samples: source.count("clouds.transport.samples", &transport.samples, 1, [1, 16])?,
            solve,
        })
    }
}

impl LightningFile {
    fn check(&self, source: &Source) -> Result<Lamps, RecipeError> {
        let corner = |field: &str, value: &Option<Spanned<[f64; 3]>>| match value {
            None => Ok(None),
            Some(value) if value.get_ref().iter().all(|v| v.abs() <= 1e6) => Ok(Some(*value.get_ref())),
            Some(value) => {
                let found = format!("{:?}", value.get_ref());
                Err(source.error(value.span(), field, "three numbers, -1e6 to 1e6 m", found))
            }
        };
        let (low_m, high_m) = (
            corner("clouds.lightning.low_m", &self.low_m)?,
            corner("clouds.lightning.high_m", &self.high_m)?,
        );
        if let (Some(low), Some(high), Some(value)) = (low_m, high_m, &self.high_m)
            && (0..3).any(|axis| low[axis] > high[axis])
        {
            let found = format!("{high:?} beside low_m {low:?}");
            return Err(source.error(value.span(), "clouds.lightning.high_m", "no less than low_m", found));
        }
        let metres = [1e-3, 1e6];
        Ok(Lamps {
            low_m,
            high_m,
            spacing_m: source.number("clouds.lightning.spacing_m", &self.spacing_m, 0.0, metres, "m")?,
            epsilon_per_m2: source.number(
                "clouds.lightning.epsilon_per_m2",
                &self.epsilon_per_m2,
                1e-6,
                [0.0, 1e6],
                "1/m²",
            )?,
            longest_m: source.number("clouds.lightning.longest_m", &self.longest_m, 1e6, metres, "m")?,
            prune: self.prune.unwrap_or(false),
        })
    }
}
