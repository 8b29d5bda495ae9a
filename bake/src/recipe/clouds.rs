//! `[clouds]` of a recipe, as it is typed and checked.

use super::model::{
    CloudBudget, Clouds, ErrorFor, Given, Keys, Optics, ResponseSettings, SunWish, VirtualLights,
};
use super::number::Number;
use super::place::Source;
use crate::error::RecipeError;
use serde::Deserialize;
use squall_formats::section::response::{
    Codec, DirectTerm, DirectionalBasis, DistantKind, Stored, SweepScheme,
};
use squall_formats::view_region::ViewRegion;
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::SolveSettings;
use std::path::PathBuf;
use toml::Spanned;

/// Largest coordinate of a corner, m: those of map grids are some 10⁷.
const FARTHEST_M: f64 = 1e9;

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
    view_region: Option<Spanned<ViewRegionFile>>,
    /// The older name of `view_region`.
    eyes: Option<Spanned<ViewRegionFile>>,
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
    sun_l2: Option<Number>,
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
    #[serde(rename = "where")]
    place: Option<Spanned<PlaceName>>,
    levels: Option<Number>,
}

/// Where strokes may be.
#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
enum PlaceName {
    Strokes,
    Cloud,
    Box,
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
    basis: Option<Spanned<BasisName>>,
    /// The older name of `basis`.
    channels: Option<Spanned<BasisName>>,
    direct: Option<DirectName>,
    codec: Option<CodecName>,
    error: Option<Number>,
    distant: Option<Vec<DistantName>>,
    sun: Option<Spanned<toml::Value>>,
    /// One direction, all its light in one row: as recipes had it before `sun`.
    sun_direction: Option<Spanned<[f64; 3]>>,
    cells: Option<Spanned<[u32; 3]>>,
    stored: Option<Spanned<StoredName>>,
    error_for: Option<Spanned<ErrorForName>>,
    test_strokes: Option<Number>,
    seen_only: Option<bool>,
}

#[derive(Clone, Copy, Deserialize)]
enum BasisName {
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
    #[serde(rename = "view-region-0", alias = "eyes-0")]
    ViewRegion0,
    #[serde(rename = "view-region-1", alias = "eyes-1")]
    ViewRegion1,
    #[serde(rename = "view-region-2", alias = "eyes-2")]
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
    Entropy,
    Bytes,
    Paper,
}

#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
enum ErrorForName {
    Viewers,
    Gathers,
}

#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "kebab-case")]
enum StoredName {
    Means,
    Fit,
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

/// The direction set that a recipe names.
fn directions(value: &Spanned<String>, source: &Source) -> Result<Quadrature, RecipeError> {
    parse_directions(value.get_ref()).ok_or_else(|| {
        let wanted = "\"14\", \"26\" or \"50\" (Lebedev), or polar nodes × azimuths, such as \"4x16\"";
        source.error(value.span(), "clouds.transport.directions", wanted, format!("\"{}\"", value.get_ref()))
    })
}

impl CloudsFile {
    /// `has_strokes`: whether the recipe has strokes that virtual lights can be pruned to.
    pub(super) fn check(self, has_strokes: bool, source: &Source) -> Result<Clouds, RecipeError> {
        let optics = Optics {
            albedo: source.optional("clouds.albedo", &self.albedo, [0.0, 1.0], "")?,
            g: source.optional("clouds.g", &self.g, [-0.999, 0.999], "")?,
            kappa_per_m: source.optional("clouds.kappa_per_m", &self.kappa_per_m, [0.0, 1e12], "1/m")?,
        };
        let keys = self.keys(source)?;
        let budget = self.budget.check(source)?;
        let mut lights = self.lightning.check(source)?;
        let mut settings = self.settings(source)?;
        settings.view_region = self.view_region(&keys, source)?;
        self.check_basis(&settings, &keys, source)?;
        // Rows of two bytes a coefficient are read fastest, and milliseconds were asked for.
        if budget.relight_ms.is_some() && self.response.codec.is_none() {
            settings.codec = Codec::Bytes;
        }
        // A recipe that says what is good enough, or from where it is looked at, has no use for what nobody can reach.
        if let (ErrorFor::Gathers, Some(name)) = (settings.error_for, &self.response.error_for)
            && budget.needs_held_out()
        {
            let wanted =
                "\"viewers\", or no budget that chooses beside it: budgets judge light as viewers do";
            return Err(source.error(name.span(), "clouds.response.error_for", wanted, "\"gathers\""));
        }
        self.check_finer(&lights, &settings, &budget, source)?;
        (settings.finer, settings.spacing_m) = (lights.levels, lights.spacing_m);
        if budget.needs_held_out() || settings.view_region.is_some() {
            let boxed = lights.low_m.is_some() || lights.high_m.is_some();
            if self.lightning.place.is_none() {
                lights.prune = self.lightning.prune.unwrap_or(has_strokes && !boxed);
            }
        }
        let held_out = &self.response.test_strokes;
        Ok(Clouds {
            scene: source.beside("clouds.scene", &self.scene)?,
            optics,
            lights,
            distant: self.response.distant(source)?,
            sun: self.response.sun(source)?,
            light_cells: self.response.light_cells(source)?,
            response: settings,
            held_out_strokes: source.count("clouds.response.test_strokes", held_out, 8, [0, 64])?,
            budget,
            given: Given {
                spacing: self.lightning.spacing_m.is_some(),
                basis: self.basis().is_some(),
                error: self.response.error.is_some(),
                solver: self.transport.directions.is_some() || self.transport.refine.is_some(),
                sky: self.response.distant.is_some()
                    || self.response.sun.is_some()
                    || self.response.sun_direction.is_some(),
            },
            keys,
        })
    }

    /// Refuses finer virtual lights where they cannot be solved for, or where a budget would have to choose them.
    fn check_finer(
        &self,
        lights: &VirtualLights,
        settings: &ResponseSettings,
        budget: &CloudBudget,
        source: &Source,
    ) -> Result<(), RecipeError> {
        if lights.levels == 0 {
            return Ok(());
        }
        let span = source.locate(&["clouds", "lightning", "levels"]).unwrap_or(0..0);
        let refused = |wanted: &str, found: &str| {
            Err(source.error(span.clone(), "clouds.lightning.levels", wanted, found))
        };
        match (settings.basis, settings.direct) {
            (DirectionalBasis::Harmonics { .. }, DirectTerm::AtRunTime) => {}
            (DirectionalBasis::Harmonics { .. }, _) => {
                return refused("0, or direct = \"run-time\" in [clouds.response]", "\"rows\"");
            }
            (basis, _) => {
                return refused("0, or a basis \"harmonics-…\" in [clouds.response]", &basis.name());
            }
        }
        if self.lightning.spacing_m.is_none() {
            return refused("0, or clouds.lightning.spacing_m beside it", "none");
        }
        if budget.needs_held_out() {
            return refused("0, or no budget that chooses: only sun_l2", "a budget that chooses");
        }
        Ok(())
    }

    /// The names under which keys with two are typed. One may not be typed twice.
    fn keys(&self, source: &Source) -> Result<Keys, RecipeError> {
        let mut keys = Keys::default();
        if let Some(eyes) = &self.eyes {
            keys.view_region = "clouds.eyes";
            if self.view_region.is_some() {
                let wanted = "no second name of [clouds.view_region] beside it";
                return Err(source.error(eyes.span(), keys.view_region, wanted, "both"));
            }
        }
        if let Some(channels) = &self.response.channels {
            keys.basis = "clouds.response.channels";
            if self.response.basis.is_some() {
                let wanted = "no second name of clouds.response.basis beside it";
                return Err(source.error(channels.span(), keys.basis, wanted, "both"));
            }
        }
        Ok(keys)
    }

    fn basis(&self) -> Option<&Spanned<BasisName>> {
        self.response.basis.as_ref().or(self.response.channels.as_ref())
    }

    /// Refuses a basis towards a view region where there is none, or where rows hold light that it cannot.
    fn check_basis(
        &self,
        settings: &ResponseSettings,
        keys: &Keys,
        source: &Source,
    ) -> Result<(), RecipeError> {
        let (DirectionalBasis::ViewRegion { .. }, Some(name)) = (settings.basis, self.basis()) else {
            return Ok(());
        };
        let refused = |wanted: String, found: &str| Err(source.error(name.span(), keys.basis, wanted, found));
        match (settings.view_region, settings.direct) {
            (None, _) => {
                refused(format!("[{}] beside a basis towards a view region", keys.view_region), "none")
            }
            (_, DirectTerm::InRows) => {
                refused("direct = \"run-time\" beside a basis towards a view region".into(), "\"rows\"")
            }
            _ => Ok(()),
        }
    }

    fn view_region(&self, keys: &Keys, source: &Source) -> Result<Option<ViewRegion>, RecipeError> {
        let Some(view_region) = self.view_region.as_ref().or(self.eyes.as_ref()) else { return Ok(None) };
        let ViewRegionFile { low_m, high_m } = view_region.get_ref();
        let corner = |name: &str| format!("{}.{name}", keys.view_region);
        for (name, value) in [("low_m", low_m), ("high_m", high_m)] {
            // Written so that NaN is refused too.
            if !value.get_ref().iter().all(|v| v.abs() <= FARTHEST_M) {
                let found = format!("{:?}", value.get_ref());
                return Err(source.error(value.span(), corner(name), "three numbers, -1e9 to 1e9 m", found));
            }
        }
        let (low, high) = (*low_m.get_ref(), *high_m.get_ref());
        if (0..3).any(|axis| low[axis] > high[axis]) {
            let found = format!("{high:?} beside low_m {low:?}");
            return Err(source.error(high_m.span(), corner("high_m"), "no less than low_m", found));
        }
        Ok(Some(ViewRegion { low_m: low, high_m: high }))
    }

    fn settings(&self, source: &Source) -> Result<ResponseSettings, RecipeError> {
        let (transport, response) = (&self.transport, &self.response);
        let quadrature = match &transport.directions {
            Some(value) => directions(value, source)?,
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
            basis: self.basis().map_or(BasisName::Harmonics1, |name| *name.get_ref()).basis(),
            direct: match response.direct.unwrap_or(DirectName::RunTime) {
                DirectName::Rows => DirectTerm::InRows,
                DirectName::RunTime => DirectTerm::AtRunTime,
            },
            codec: match response.codec.unwrap_or(CodecName::Entropy) {
                CodecName::Entropy => Codec::Entropy,
                CodecName::Bytes => Codec::Bytes,
                CodecName::Paper => Codec::Paper,
            },
            relative_error: source.number(
                "clouds.response.error",
                &response.error,
                0.01,
                [0.0, 0.9],
                "of a source's light",
            )?,
            // Air costs next to nothing, but in the papers' own layout, which has every cell.
            seen_only: response.seen_only.unwrap_or(!matches!(response.codec, Some(CodecName::Paper))),
            // Set where it is known.
            view_region: None,
            stored: response.stored(transport, source)?,
            error_for: response.error_for(source)?,
            refine: source.count("clouds.transport.refine", &transport.refine, 1, [1, 16])?,
            samples: source.count("clouds.transport.samples", &transport.samples, 1, [1, 16])?,
            // Set where virtual lights are known.
            finer: 0,
            spacing_m: 0.0,
            solve,
        })
    }
}

impl BasisName {
    fn basis(self) -> DirectionalBasis {
        match self {
            Self::Directions26 => DirectionalBasis::Directions26,
            Self::Harmonics0 => DirectionalBasis::Harmonics { degree: 0 },
            Self::Harmonics1 => DirectionalBasis::Harmonics { degree: 1 },
            Self::Harmonics2 => DirectionalBasis::Harmonics { degree: 2 },
            Self::Harmonics3 => DirectionalBasis::Harmonics { degree: 3 },
            Self::ViewRegion0 => DirectionalBasis::ViewRegion { degree: 0 },
            Self::ViewRegion1 => DirectionalBasis::ViewRegion { degree: 1 },
            Self::ViewRegion2 => DirectionalBasis::ViewRegion { degree: 2 },
        }
    }
}

impl ResponseFile {
    fn distant(&self, source: &Source) -> Result<Vec<DistantKind>, RecipeError> {
        let mut distant: Vec<DistantKind> = self
            .distant
            .iter()
            .flatten()
            .map(|name| match name {
                DistantName::UpperSky => DistantKind::UpperSky,
                DistantName::LowerSky => DistantKind::LowerSky,
            })
            .collect();
        if let Some(sun) = &self.sun_direction {
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
        Ok(distant)
    }

    fn sun(&self, source: &Source) -> Result<Option<SunWish>, RecipeError> {
        let Some(sun) = &self.sun else { return Ok(None) };
        if let Some(old) = &self.sun_direction {
            let wanted = "no older form of clouds.response.sun beside it";
            return Err(source.error(old.span(), "clouds.response.sun_direction", wanted, "both"));
        }
        super::sun::check(sun, source).map(Some)
    }

    /// What cells hold; a fit where light is solved for in smaller ones.
    fn stored(&self, transport: &TransportFile, source: &Source) -> Result<Stored, RecipeError> {
        let Some(name) = self.stored.as_ref().filter(|name| *name.get_ref() == StoredName::Fit) else {
            return Ok(Stored::Means);
        };
        if self.cells.is_none() && transport.refine.is_none() {
            let wanted = "\"means\", or clouds.response.cells or clouds.transport.refine beside it: a fit is of light in smaller cells than \
                          those that are stored";
            return Err(source.error(name.span(), "clouds.response.stored", wanted, "\"fit\""));
        }
        Ok(Stored::Fit)
    }

    /// Whom the error is about; gathers where rows hold what a gather reads and no more.
    fn error_for(&self, source: &Source) -> Result<ErrorFor, RecipeError> {
        let Some(name) = self.error_for.as_ref().filter(|name| *name.get_ref() == ErrorForName::Gathers)
        else {
            return Ok(ErrorFor::Viewers);
        };
        let basis = self
            .basis
            .as_ref()
            .or(self.channels.as_ref())
            .map_or(BasisName::Harmonics1, |name| *name.get_ref())
            .basis();
        let direct = self.direct.unwrap_or(DirectName::RunTime);
        if basis != (DirectionalBasis::Harmonics { degree: 1 }) || matches!(direct, DirectName::Rows) {
            let wanted =
                "\"viewers\", or basis \"harmonics-1\" and direct \"run-time\" beside it: what gathers read";
            return Err(source.error(name.span(), "clouds.response.error_for", wanted, "\"gathers\""));
        }
        Ok(ErrorFor::Gathers)
    }

    fn light_cells(&self, source: &Source) -> Result<Option<[u32; 3]>, RecipeError> {
        let Some(cells) = &self.cells else { return Ok(None) };
        if cells.get_ref().contains(&0) {
            let found = format!("{:?}", cells.get_ref());
            return Err(source.error(cells.span(), "clouds.response.cells", "three counts from 1", found));
        }
        Ok(Some(*cells.get_ref()))
    }
}

impl BudgetFile {
    fn check(&self, source: &Source) -> Result<CloudBudget, RecipeError> {
        Ok(CloudBudget {
            stroke_l2: source.optional("clouds.budget.stroke_l2", &self.stroke_l2, [1e-4, 1.0], "")?,
            relit_l2: source.optional("clouds.budget.relit_l2", &self.relit_l2, [1e-5, 1.0], "")?,
            sun_l2: source.optional("clouds.budget.sun_l2", &self.sun_l2, [1e-4, 1.0], "")?,
            solver_l2: source.optional("clouds.budget.solver_l2", &self.solver_l2, [1e-4, 1.0], "")?,
            bytes: source.optional("clouds.budget.bytes", &self.bytes, [1e3, 1e12], "")?.map(|v| v as u64),
            relight_ms: source.optional("clouds.budget.relight_ms", &self.relight_ms, [1e-3, 1e5], "ms")?,
        })
    }
}

impl LightningFile {
    fn check(&self, source: &Source) -> Result<VirtualLights, RecipeError> {
        let corner = |field: &str, value: &Option<Spanned<[f64; 3]>>| match value {
            None => Ok(None),
            Some(value) if value.get_ref().iter().all(|v| v.abs() <= FARTHEST_M) => {
                Ok(Some(*value.get_ref()))
            }
            Some(value) => {
                let found = format!("{:?}", value.get_ref());
                Err(source.error(value.span(), field, "three numbers, -1e9 to 1e9 m", found))
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
        if let (Some(place), Some(_)) = (&self.place, self.prune) {
            let wanted = "no older form of clouds.lightning.where beside it";
            return Err(source.error(place.span(), "clouds.lightning.prune", wanted, "both"));
        }
        let place = self.place.as_ref().map(|place| *place.get_ref());
        let metres = [1e-3, 1e6];
        Ok(VirtualLights {
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
            prune: self.prune.unwrap_or(place == Some(PlaceName::Strokes)),
            in_cloud: place == Some(PlaceName::Cloud),
            levels: source.count("clouds.lightning.levels", &self.levels, 0, [0, 4])?,
        })
    }
}
