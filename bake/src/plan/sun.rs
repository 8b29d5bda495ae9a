//! Directions that the sun's beams are baked for: as many as the recipe's budget asks for, over all that it allows.
//!
//! Candidates are tried on suns of their own, never on the held-out ones that confirm the result.

use super::budget::SAFETY;
use super::lights::Site;
use crate::asset::{asset_of, in_memory};
use crate::error::BakeError;
use crate::evaluate::root_mean_square;
use crate::evaluate::sun::SunSet;
use crate::progress::{Progress, Quiet};
use crate::recipe::model::{ResponseSettings, SunWish};
use crate::recipe::sun_at;
use crate::response::{Job, Sources, WantedLights, bake_response};
use glam::DVec3;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::response::{DistantKind, SunDirections, towards_sun};
use squall_runtime::place::Place;
use squall_runtime::random::Random;
use squall_runtime::relight::Relighter;
use squall_runtime::shade::sky::atmosphere::EARTH_RADIUS;

/// Angles between neighbouring beams that a budget chooses among, degrees, from coarse to fine.
const STEPS_DEG: [f64; 8] = [60.0, 45.0, 30.0, 20.0, 15.0, 10.0, 7.0, 5.0];
/// The angle where no budget asks, and the same along a path, whose beams are few.
const USUAL_STEP_DEG: f64 = 20.0;
const USUAL_PATH_STEP_DEG: f64 = 10.0;
/// Suns that candidates are tried on, and as many held-out ones; along a path, where one number says where a sun stands in place of two,
/// half as many see as much. Each is a direct solve.
pub const TRIED_SUNS: usize = 8;
const TRIED_SUNS_OF_PATH: usize = TRIED_SUNS / 2;
/// Seed of their places, beside their number.
const SEED: u64 = 0x50_1A12;
/// What the sun's disc and the width of a cloud add to the dip of the horizon, rad.
const BELOW_DIP: f64 = 0.012;
/// Steps in which a path is followed.
const PATH_STEPS: usize = 2000;

/// Beams of the sun.
#[derive(Clone, Debug, PartialEq)]
pub struct SunPlan {
    /// What they cover.
    pub directions: SunDirections,
    /// One each, in order.
    pub beams: Vec<DistantKind>,
    /// Angle between neighbours, degrees; 0 of one alone.
    pub step_deg: f64,
    /// The next finer angle and its error on the suns that chose; the next coarser.
    pub neighbours: [Option<String>; 2],
}

impl std::fmt::Display for SunPlan {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let count = self.beams.len();
        match &self.directions {
            SunDirections::Rings { .. } => write!(f, "{count} beams, {}° apart", self.step_deg),
            SunDirections::Path if count == 1 => f.write_str("one beam"),
            SunDirections::Path => write!(f, "{count} beams along a path, {}° apart", self.step_deg),
        }
    }
}

/// Lowest elevation at which a sun reaches any part of the recipe's cloud, rad.
///
/// Errors: none that a checked recipe brings about.
pub fn lowest_sun(site: &Site<'_>) -> Result<f64, BakeError> {
    let recipe = site.recipe;
    let mut sections = vec![crate::asset::grid_section(site.cloud)];
    sections.extend(recipe.view.iter().map(|view| view.write()));
    if !recipe.strokes.is_empty() {
        sections.push(BoltSection { strokes: recipe.strokes.clone() }.write());
    }
    let place = match (recipe.place_m, &recipe.town) {
        (Some(origin), _) => Place { origin: DVec3::from_array(origin) },
        (None, Some(_)) => Place::default(),
        (None, None) => Place::of(&in_memory(&sections)?)?,
    };
    let height = (site.cloud.far_corner().z - place.origin.z).max(0.0);
    let dip = libm::acos(EARTH_RADIUS / (EARTH_RADIUS + height));
    Ok((-dip - BELOW_DIP).max((-17f64).to_radians()))
}

/// What the recipe's beams may cover: a part of the sky, or a line in it.
enum Allowed {
    Sky(f64),
    Line(Vec<DVec3>),
}

fn allowed(site: &Site<'_>) -> Result<Option<Allowed>, BakeError> {
    let Some(wish) = site.clouds.sun else { return Ok(None) };
    let lowest = lowest_sun(site)?;
    let high_enough = |sun: &DVec3| libm::asin(sun.z.clamp(-1.0, 1.0)) >= lowest;
    let line = match wish {
        SunWish::Anywhere => return Ok(Some(Allowed::Sky(lowest))),
        // Of the view's sun the recipe's text was made before: without a view there is none.
        SunWish::View => Vec::new(),
        SunWish::At(towards) => vec![towards],
        SunWish::Path { latitude_rad, day, hours: [from, to] } => {
            let hour = |i: usize| from + (to - from) * i as f64 / PATH_STEPS as f64;
            (0..=PATH_STEPS).map(|i| sun_at(latitude_rad, day, hour(i))).collect()
        }
    };
    // Hours of one day rise: what of them is day is one stretch around noon.
    let line: Vec<DVec3> = line.into_iter().filter(high_enough).collect();
    Ok((!line.is_empty()).then_some(Allowed::Line(line)))
}

impl Allowed {
    fn usual_step_deg(&self) -> f64 {
        match self {
            Self::Sky(_) => USUAL_STEP_DEG,
            Self::Line(_) => USUAL_PATH_STEP_DEG,
        }
    }

    /// Beams that are about `step_deg` apart.
    fn beams(&self, step_deg: f64) -> SunPlan {
        let step = step_deg.to_radians();
        let (directions, suns) = match self {
            Self::Sky(lowest) => {
                let top = std::f64::consts::FRAC_PI_2;
                let rings = ((top - lowest) / step).ceil().max(1.0) as usize;
                let elevations_rad: Vec<f64> =
                    (0..=rings).map(|ring| lowest + (top - lowest) * ring as f64 / rings as f64).collect();
                let count = |(ring, elevation): (usize, &f64)| match ring == rings {
                    true => 1,
                    false => {
                        ((2.0 * std::f64::consts::PI * libm::cos(*elevation) / step).round() as u32).max(3)
                    }
                };
                let counts = elevations_rad.iter().enumerate().map(count).collect();
                let rings = SunDirections::Rings { elevations_rad, counts };
                let suns = rings.of_rings();
                (rings, suns)
            }
            Self::Line(line) => (SunDirections::Path, along(line, step)),
        };
        let beam = |sun: &[f64; 3]| DistantKind::Sun { direction: sun.map(|value| -value) };
        let beams: Vec<DistantKind> = suns.iter().map(beam).collect();
        let step_deg = if beams.len() == 1 { 0.0 } else { step_deg };
        SunPlan { directions, beams, step_deg, neighbours: [None, None] }
    }

    /// Suns of another number, none of them a beam's.
    fn unseen(&self, number: u64) -> Vec<DVec3> {
        let mut random = Random::from_parts(&[SEED, number]);
        let mut draw = |i: usize, of: usize| (i as f64 + random.unit()) / of as f64;
        match self {
            Self::Sky(lowest) => {
                let sun = |i: usize| {
                    // Even in elevation: low suns are what pictures are made under, and where light changes fastest.
                    let elevation = lowest + (std::f64::consts::FRAC_PI_2 - lowest) * draw(i, TRIED_SUNS);
                    let azimuth = 2.0 * std::f64::consts::PI * draw(i * 5 % TRIED_SUNS, TRIED_SUNS);
                    DVec3::from_array(towards_sun(azimuth, elevation))
                };
                (0..TRIED_SUNS).map(sun).collect()
            }
            Self::Line(line) if line.len() == 1 => Vec::new(),
            Self::Line(line) => (0..TRIED_SUNS_OF_PATH)
                .map(|i| draw(i, TRIED_SUNS_OF_PATH) * line.len() as f64)
                .map(|at| line[(at as usize).min(line.len() - 1)])
                .collect(),
        }
    }
}

/// Points of a line, its ends among them, at most `step` rad apart.
fn along(line: &[DVec3], step: f64) -> Vec<[f64; 3]> {
    let lengths: Vec<f64> = line.windows(2).map(|pair| pair[0].angle_between(pair[1])).collect();
    let length: f64 = lengths.iter().sum();
    let count = (length / step - 1e-9).ceil().max(if line.len() > 1 { 1.0 } else { 0.0 }) as usize;
    let (mut points, mut walked) = (vec![line[0].to_array()], 0.0);
    for (at, part) in lengths.iter().enumerate() {
        walked += part;
        let reached = |points: &Vec<[f64; 3]>| walked >= length * points.len() as f64 / count as f64 - 1e-12;
        if points.len() <= count && (reached(&points) || at + 1 == lengths.len()) {
            points.push(line[at + 1].to_array());
        }
    }
    points
}

/// The sun's beams where no budget chooses them.
///
/// Errors: as [`lowest_sun`].
pub fn usual_sun(site: &Site<'_>) -> Result<Option<SunPlan>, BakeError> {
    Ok(allowed(site)?.map(|allowed| allowed.beams(allowed.usual_step_deg())))
}

/// Decides on the sun's beams; nothing where the recipe has none. `margin` is the share of the budget that may be used.
///
/// Errors: a budget out of reach, a solve that does not converge, an interruption.
pub fn plan_sun(
    site: &Site<'_>,
    settings: &ResponseSettings,
    margin: f64,
    progress: &dyn Progress,
) -> Result<Option<SunPlan>, BakeError> {
    let Some(allowed) = allowed(site)? else { return Ok(None) };
    let tried = allowed.unseen(0);
    let Some(asked) = site.clouds.budget.sun_l2.filter(|_| !tried.is_empty()) else {
        return Ok(Some(allowed.beams(allowed.usual_step_deg())));
    };
    progress.begin("beams of the sun", STEPS_DEG.len() as u64);
    let truth = SunSet::solve((site.cloud, Some(site.shown)), settings, &tried, (0, site.cache), &Quiet)?;
    let mut coarser: Option<String> = None;
    for step_deg in STEPS_DEG {
        progress.check()?;
        let plan = allowed.beams(step_deg);
        let error = root_mean_square(truth.errors(&baked_alone(site, settings, &plan)?)?);
        progress.advance(1);
        let words = format!("{plan}: L2 {:.2} %", 100.0 * error);
        if error <= asked * margin * SAFETY {
            let finer = STEPS_DEG.into_iter().find(|&finer| finer < step_deg);
            let finer = finer.map(|finer| format!("{}", allowed.beams(finer)));
            return Ok(Some(SunPlan { neighbours: [finer, coarser], ..plan }));
        }
        coarser = Some(words);
    }
    Err(BakeError::NotReached {
        what: "clouds.budget.sun_l2".into(),
        wanted: format!("{asked}"),
        reached: coarser.unwrap_or_default(),
        hint: "ask for less, allow fewer suns, or take a smaller clouds.response.error and a richer basis"
            .into(),
    })
}

/// An asset that holds the beams of `plan` alone.
fn baked_alone(site: &Site<'_>, settings: &ResponseSettings, plan: &SunPlan) -> Result<Relighter, BakeError> {
    let grid = LightGrid { x_m: vec![0.0], y_m: vec![0.0], z_m: vec![0.0] };
    let lights = WantedLights { grid, wanted: vec![false] };
    let sources = Sources { lights, distant: plan.beams.clone(), sun: Some(plan.directions.clone()) };
    let job = Job {
        cloud: site.cloud,
        sources: &sources,
        settings,
        held_out: &[],
        known: None,
        shown: Some(site.shown),
        cache: site.cache,
    };
    let (asset, _) = asset_of(site.cloud, bake_response(&job, &Quiet)?)?;
    Ok(Relighter::new(&asset)?)
}

/// Suns that confirm what was baked, others in every iteration; nothing where there is only one sun.
///
/// Errors: as [`plan_sun`].
pub fn held_out_suns(site: &Site<'_>, iteration: usize) -> Result<Vec<DVec3>, BakeError> {
    Ok(allowed(site)?.map(|allowed| allowed.unseen(1 + iteration as u64)).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beams_cover_the_sky_they_are_for() {
        let sky = Allowed::Sky(-0.05);
        let plan = sky.beams(20.0);
        let suns: Vec<[f64; 3]> = plan.directions.of_rings();
        assert_eq!(suns.len(), plan.beams.len());
        for number in 0..20 {
            for sun in sky.unseen(number) {
                assert!(plan.directions.weights(&suns, sun.to_array()).is_some(), "{sun}");
            }
        }
        assert!(sky.beams(10.0).beams.len() > 3 * plan.beams.len());
    }

    #[test]
    fn beams_along_a_path_begin_and_end_with_it() {
        let line: Vec<DVec3> =
            (0..=PATH_STEPS).map(|i| sun_at(0.9, 172.0, 12.0 + i as f64 * 0.004)).collect();
        let path = Allowed::Line(line.clone());
        let plan = path.beams(10.0);
        let suns: Vec<[f64; 3]> = along(&line, 10f64.to_radians());
        assert!(suns.len() == plan.beams.len() && (8..16).contains(&suns.len()), "{}", suns.len());
        assert_eq!((suns[0], suns[suns.len() - 1]), (line[0].to_array(), line[PATH_STEPS].to_array()));
        for sun in path.unseen(3) {
            assert!(plan.directions.weights(&suns, sun.to_array()).is_some(), "{sun}");
        }
        assert_eq!(Allowed::Line(line[..1].to_vec()).beams(10.0).beams.len(), 1);
    }
}
