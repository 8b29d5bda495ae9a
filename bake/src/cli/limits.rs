//! `--max-error METRIC=VALUE`: bounds on measured figures, and warnings about figures that nobody bounded.

use glam::DVec3;
use squall_bake::BakeError;
use squall_bake::metrics::{Figures, METRICS, Metric, metric};
use squall_bake::recipe::{Clouds, Recipe};
use squall_formats::section::response::{DistantKind, SUN_TOLERANCE_RAD, towards_sun};

/// A stroke's error above this is worth a warning: a quarter of its light is somewhere else.
const WORTH_A_WARNING: f64 = 0.25;

/// A bound on one figure.
#[derive(Clone, Copy, Debug)]
pub struct Limit {
    metric: &'static Metric,
    most: f64,
}

/// Reads METRIC=VALUE. Errors: a metric that there is not, with those that there are; no number at least 0.
pub fn parse(text: &str) -> Result<Limit, String> {
    let (name, value) = text.split_once('=').ok_or("wanted METRIC=VALUE, such as stroke_l2=0.25")?;
    let found = metric(name.trim()).ok_or_else(|| {
        let names: Vec<_> = METRICS.iter().map(|metric| metric.name).collect();
        format!("no metric `{name}`; there are {}", names.join(", "))
    })?;
    let most: f64 = value.trim().parse().map_err(|_| format!("wanted a number, found `{value}`"))?;
    if most >= 0.0 && most.is_finite() {
        return Ok(Limit { metric: found, most });
    }
    Err(format!("wanted a number of at least 0, found `{value}`"))
}

/// Errors (exit code 1): a figure above its bound, or not measured.
pub fn check(limits: &[Limit], figures: &Figures, asset: &str) -> Result<(), BakeError> {
    let over = |limit: &Limit| {
        let (name, most) = (limit.metric.name, limit.most);
        match figures.value(limit.metric) {
            Some(value) if value <= most => None,
            Some(value) => Some(format!("{name} is {value}, wanted at most {most}")),
            None => Some(format!("{name} was not measured: that takes {}", limit.metric.measured_with)),
        }
    };
    let found: Vec<String> = limits.iter().filter_map(over).collect();
    if found.is_empty() {
        return Ok(());
    }
    Err(BakeError::OverLimit { asset: asset.to_owned(), found })
}

/// What is worth knowing of a bake that nobody asked about, each with what would help.
pub fn warnings(recipe: &Recipe, figures: &Figures) -> Vec<String> {
    let Some(clouds) = &recipe.clouds else { return Vec::new() };
    stroke_warning(recipe, clouds, figures).into_iter().chain(sky_warning(recipe, clouds)).collect()
}

/// A picture whose sky does not light its cloud.
fn sky_warning(recipe: &Recipe, clouds: &Clouds) -> Option<String> {
    let sky = &recipe.view.as_ref()?.sky;
    let whole =
        [DistantKind::UpperSky, DistantKind::LowerSky].iter().all(|kind| clouds.distant.contains(kind));
    if !whole {
        return Some(
            "the view's sky does not light the cloud: distant = [\"upper-sky\", \"lower-sky\"] and sun = \"view\" in \
             [clouds.response] would"
                .into(),
        );
    }
    if sky.sun_elevation_rad <= 0.0 || clouds.sun.is_some() {
        return None;
    }
    let beams = clouds.distant.iter().filter_map(|kind| match kind {
        DistantKind::Beam { direction } => Some(-DVec3::from_array(*direction)),
        _ => None,
    });
    let towards = DVec3::from_array(towards_sun(sky.sun_azimuth_rad, sky.sun_elevation_rad));
    let away = beams.map(|beam| beam.angle_between(towards)).reduce(f64::min);
    if let Some(away) = away {
        return (away > SUN_TOLERANCE_RAD).then(|| {
            format!(
                "the view's sun stands {:.1}° from that of sun_direction, and its light on the cloud is solved for whenever the \
                 view is drawn: sun = \"view\" in its place would bake it",
                away.to_degrees()
            )
        });
    }
    Some({
        "the view's sun does not light the cloud: sun = \"view\", a path or \"anywhere\" in [clouds.response] would".into()
    })
}

fn stroke_warning(recipe: &Recipe, clouds: &Clouds, figures: &Figures) -> Option<String> {
    let stroke = metric("stroke_l2").and_then(|metric| figures.value(metric));
    let warning = match stroke {
        None => format!("the stroke error was not measured; {}", measuring(recipe, clouds)),
        Some(error) if error <= WORTH_A_WARNING => return None,
        Some(error) => {
            let percent = 100.0 * error;
            format!(
                "the measured stroke error of {percent:.1} % is above {:.0} %; {}",
                100.0 * WORTH_A_WARNING,
                bettering(clouds)
            )
        }
    };
    Some(warning)
}

fn measuring(recipe: &Recipe, clouds: &Clouds) -> &'static str {
    if clouds.held_out_strokes == 0 {
        "test_strokes above 0 in [clouds.response] would measure it"
    } else if clouds.lights.prune && recipe.strokes.is_empty() {
        "[[strokes]] in the recipe, or prune = false in [clouds.lightning], would give strokes to measure it by"
    } else {
        "no stroke was found that the virtual lights reach: larger bounds in [clouds.lightning], or other [[strokes]], help"
    }
}

fn bettering(clouds: &Clouds) -> String {
    let spacing = match clouds.lights.spacing_m {
        0.0 => String::new(),
        stated => format!(" (now {stated} m)"),
    };
    format!(
        "a smaller spacing_m in [clouds.lightning]{spacing} and a richer {} lower it, or stroke_l2 in \
         [clouds.budget] chooses both; test_strokes (now {}) say how surely it is measured",
        clouds.keys.basis, clouds.held_out_strokes
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::section::provenance::BudgetRecord;

    #[test]
    fn a_bound_is_a_known_metric_and_a_number() {
        let limit = parse("stroke_l2=0.25").unwrap();
        assert_eq!((limit.metric.name, limit.most), ("stroke_l2", 0.25));
        for (text, words) in [
            ("stroke=0.25", "stroke_l2, stroke_median"),
            ("stroke_l2", "METRIC=VALUE"),
            ("stroke_l2=much", "`much`"),
            ("stroke_l2=-1", "at least 0"),
            ("stroke_l2=nan", "at least 0"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(words), "{text}: {error}");
        }
    }

    #[test]
    fn what_is_no_number_or_not_measured_is_over_every_bound() {
        let limits = [parse("stroke_l2=1e9").unwrap()];
        let mut figures = Figures::default();
        let said = check(&limits, &figures, "a").unwrap_err().to_string();
        assert!(said.contains("not measured") && said.contains("test_strokes"), "{said}");
        figures.budgets.push(BudgetRecord {
            part: "lightning grid".into(),
            metric: "stroke L2 over 26 directions".into(),
            asked: None,
            got: f64::NAN,
            chosen: String::new(),
            next_better: None,
            next_cheaper: None,
        });
        assert!(check(&limits, &figures, "a").unwrap_err().to_string().contains("NaN"));
        figures.budgets[0].got = 0.5;
        check(&limits, &figures, "a").unwrap();
    }
}
