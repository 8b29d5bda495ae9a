//! Chart `transport`: how far a solved field is off an independent Monte Carlo, against processor time a light.

use super::clock::seconds;
use super::scene::chart_scene;
use super::{Cost, Point, Sweep};
use crate::cloud::{TruthSettings, solve_light};
use crate::error::BakeError;
use crate::evaluate::RelativeL2;
use crate::input::scene::{Optics, read_scene};
use crate::monte_carlo::{MonteCarloSettings, solve_monte_carlo};
use crate::progress::{Progress, Quiet};
use crate::recipe::parse_directions;
use squall_formats::section::response::SweepScheme;
use squall_runtime::transport::Cloud;
use squall_runtime::transport::direct::Light;
use squall_runtime::transport::solve::{Iteration, SolveSettings};
use std::path::Path;

const RMSE: &str = "scattered fluence rate, relative RMSE";
const MEDIAN: &str = "scattered fluence rate, median cell";
const TIME: &str = "CPU s a light";
const SWEEPS: &str = "sweeps";

pub const PAIRS: &[(&str, &str)] = &[(RMSE, TIME), (MEDIAN, TIME), (RMSE, SWEEPS)];

/// A light in a cloud and what an independent method makes of it.
struct Case {
    words: String,
    cloud: Cloud,
    light: Light,
    wanted: Vec<f32>,
    errors: Vec<f32>,
}

/// Series of the recipe's own setting.
const OWN: &str = "the recipe's";
/// Errors of the truth above this share of it take a cell out of the median.
const SURE: f64 = 0.03;

pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let mut cases = Vec::new();
    if let Some(folder) = &task.reference {
        let all = [("layer32", "near"), ("slab32", "below"), ("layer32", "inside")];
        for (scene, light) in &all[..if task.quick { 1 } else { all.len() }] {
            cases.push(reference_case(folder, scene, light)?);
        }
    }
    cases.extend(own_case(task, progress)?);
    let mut variants = variants(task.quick);
    if let Some(clouds) = &task.recipe.clouds {
        let own = &clouds.response;
        let settings =
            TruthSettings { refine: own.refine, samples: own.samples, high_degree: false, solve: own.solve };
        let words = format!("as the recipe has it, residual {:e}", own.solve.tolerance);
        variants.push((OWN.into(), words, settings, false));
    }
    progress.begin("chart transport", (cases.len() * variants.len()) as u64);
    let mut points = Vec::new();
    for case in &cases {
        for (series, setting, settings, baseline) in &variants {
            progress.check()?;
            progress.advance(1);
            let (solved, cost) = seconds(if task.quick { 1 } else { 3 }, || {
                solve_light(&case.cloud, case.light, &[], settings, &Quiet)
            });
            // What does not converge has no error to show; the stability page says where that is.
            let truth = match solved {
                Err(BakeError::NotReached { .. }) => continue,
                other => other?,
            };
            let (rmse, median) = case.score(&truth.phi_scattered());
            points.push(Point {
                series: series.clone(),
                setting: setting.clone(),
                truth: case.words.clone(),
                errors: vec![(RMSE, rmse), (MEDIAN, median)],
                costs: vec![(TIME, cost), (SWEEPS, Cost::exact(f64::from(truth.report.sweeps)))],
                bytes: None,
                chosen: series == OWN,
                baseline: *baseline,
            });
        }
    }
    Ok(points)
}

impl Case {
    /// Relative RMSE and median pointwise error over cells with density.
    fn score(&self, found: &[f32]) -> (f64, f64) {
        let (mut rmse, mut pointwise) = (RelativeL2::default(), Vec::new());
        for cell in (0..found.len()).filter(|&cell| self.cloud.extinction[cell] > 0.0) {
            let (x, r) = (f64::from(found[cell]), f64::from(self.wanted[cell]));
            rmse.add(x - r, r, 1.0);
            if f64::from(self.errors[cell]) < SURE * r {
                pointwise.push((x - r).abs() / r);
            }
        }
        pointwise.sort_unstable_by(f64::total_cmp);
        let median = pointwise.get(pointwise.len() / 2).copied().unwrap_or(f64::NAN);
        (rmse.value(), median)
    }

    /// RMSE that the truth's own standard errors account for.
    fn noise(wanted: &[f32], errors: &[f32], cloud: &Cloud) -> f64 {
        let mut noise = RelativeL2::default();
        for ((&error, &wanted), _) in
            errors.iter().zip(wanted).zip(&cloud.extinction).filter(|(_, extinction)| **extinction > 0.0)
        {
            noise.add(f64::from(error), f64::from(wanted), 1.0);
        }
        noise.value()
    }
}

fn reference_case(folder: &Path, name: &str, light: &str) -> Result<Case, BakeError> {
    let scene = read_scene(&folder.join(format!("clouds/scenes/{name}.json")), Optics::default())?;
    let read = |end: &str| -> Result<Vec<f32>, BakeError> {
        let path = folder.join(format!("clouds/fields/{name}__{light}.phi_sc{end}.f32"));
        crate::input::read_grid(&path, scene.cloud.shape.len())
    };
    let (wanted, errors) = (read("")?, read("_se")?);
    let noise = Case::noise(&wanted, &errors, &scene.cloud);
    Ok(Case {
        words: format!("reference {name}, light {light} (its noise {:.1} %)", 100.0 * noise),
        light: scene.light(light)?,
        cloud: scene.cloud,
        wanted,
        errors,
    })
}

/// The recipe's own cloud, with our own Monte Carlo as its truth.
fn own_case(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Option<Case>, BakeError> {
    const SEED: u64 = 1;
    let (most, photons) = if task.quick { (1 << 11, 400_000) } else { (1 << 13, 40_000_000) };
    let Some(scene) = chart_scene(task.recipe, most)? else { return Ok(None) };
    let light = scene.light();
    let light = Light::Point { position: light.position, intensity: light.intensity };
    let (fields, _) =
        solve_monte_carlo(&scene.cloud, light, &[], &MonteCarloSettings { photons, seed: SEED }, progress)?;
    let (wanted, errors) = (fields.phi_scattered.mean, fields.phi_scattered.error.unwrap_or_default());
    let noise = Case::noise(&wanted, &errors, &scene.cloud);
    let words = format!("{}: Monte Carlo (its noise {:.1} %)", scene.words, 100.0 * noise);
    Ok(Some(Case { words, cloud: scene.cloud, light, wanted, errors }))
}

/// Series, setting, settings, and whether it is a paper's.
type Variant = (String, String, TruthSettings, bool);

fn variants(quick: bool) -> Vec<Variant> {
    let mut list = Vec::new();
    let base = |refine: u32, directions: &str| {
        let usual = TruthSettings::default();
        let quadrature = parse_directions(directions).unwrap_or(usual.solve.quadrature);
        let solve = SolveSettings { quadrature, tolerance: 1e-3, ..usual.solve };
        TruthSettings { refine, samples: 0, high_degree: false, solve }
    };
    let refinements: &[u32] = if quick { &[1, 2] } else { &[1, 2, 3, 4] };
    let sets: &[&str] = if quick { &["26", "2x8"] } else { &["14", "26", "50", "2x8", "3x12", "4x16"] };
    for &set in sets {
        for &refine in refinements {
            let words = format!("{set} directions, refinement {refine}");
            list.push((format!("{set} directions"), words, base(refine, set), false));
        }
    }
    for &refine in refinements {
        let settings = TruthSettings { high_degree: true, ..base(refine, "4x16") };
        let words = format!("4x16 directions, degree 3, refinement {refine}");
        list.push(("degree 3 (squall solve)".into(), words, settings, false));
    }
    for &refine in refinements {
        let mut settings = base(refine, "26");
        settings.solve.delta = false;
        let words = format!("26 directions, raw phase function, refinement {refine}");
        list.push(("without delta-M".into(), words, settings, true));
    }
    for (name, scheme) in [("diamond", SweepScheme::Diamond), ("step", SweepScheme::Step)] {
        for &refine in refinements {
            let mut settings = base(refine, "2x8");
            settings.solve.scheme = scheme;
            list.push((
                format!("scheme {name}"),
                format!("2x8, {name}, refinement {refine}"),
                settings,
                false,
            ));
        }
    }
    let tolerances: &[f64] = if quick { &[1e-2] } else { &[0.3, 0.1, 3e-2, 1e-2, 5e-3, 1e-3, 1e-4] };
    for (name, iteration) in [("MINRES", Iteration::Minres), ("source iteration", Iteration::Source)] {
        for &tolerance in tolerances {
            for refine in if quick { vec![1] } else { vec![1, 2] } {
                let mut settings = base(refine, "2x8");
                settings.solve.tolerance = tolerance;
                settings.solve.iteration = iteration;
                let words = format!("2x8, refinement {refine}, residual {tolerance:e}");
                let series = format!("{name}, refinement {refine}");
                list.push((series, words, settings, iteration == Iteration::Source));
            }
        }
    }
    list
}
