//! What `squall solve` makes of the reference scenes, against fields and pictures of an independent Monte Carlo.
//!
//! `cargo test --release -p squall-tests reference_scenes -- --nocapture` prints the table of docs/transport.md.

use crate::reference;
use squall_bake::cloud::{TruthSettings, solve_light};
use squall_bake::fields::{Fields, orthographic};
use squall_bake::input::scene::{Optics, Scene, read_scene};
use squall_bake::progress::Quiet;

/// A field's three scores: mean, relative RMSE, median pointwise.
#[derive(Clone, Copy, Debug)]
pub struct Score {
    /// Σx / Σr − 1.
    pub mean: f64,
    /// √Σ(x − r)² / √Σr².
    pub rmse: f64,
    /// Median of |x − r|/r where the reference's own error is under 3 %.
    pub median: f64,
}

/// Scores `found` against `wanted`, whose standard errors are `errors`, over the places that `counts` names.
pub fn score(found: &[f32], wanted: &[f32], errors: &[f32], counts: impl Fn(usize) -> bool) -> Score {
    let (mut sum, mut wanted_sum, mut square, mut wanted_square) = (0.0, 0.0, 0.0, 0.0);
    let mut pointwise = Vec::new();
    assert_eq!(found.len(), wanted.len());
    for cell in (0..found.len()).filter(|&cell| counts(cell)) {
        let (x, r) = (f64::from(found[cell]), f64::from(wanted[cell]));
        sum += x;
        wanted_sum += r;
        square += (x - r) * (x - r);
        wanted_square += r * r;
        if f64::from(errors[cell]) < 0.03 * r {
            pointwise.push((x - r).abs() / r);
        }
    }
    pointwise.sort_by(f64::total_cmp);
    assert!(!pointwise.is_empty());
    let median = pointwise[pointwise.len() / 2];
    Score { mean: sum / wanted_sum - 1.0, rmse: (square / wanted_square).sqrt(), median }
}

pub fn read_f32(name: &str) -> Option<Vec<f32>> {
    Some(bytemuck::allocation::pod_collect_to_vec(&std::fs::read(reference(name)?).unwrap()))
}

/// Scores of everything that the reference has for one light: fields over cells with density, pictures over all pixels.
fn scores(scene: &Scene, name: &str, lamp: &str, fields: &Fields) -> Option<Vec<(String, Score)>> {
    let mut scores = Vec::new();
    let camera = |i: usize| &fields.towards[i].1.mean;
    for (field, found) in
        [("phi_sc", &fields.phi_scattered.mean), ("phi_dir", &fields.phi_direct.mean), ("jcam", camera(0))]
    {
        let file = |end: &str| read_f32(&format!("clouds/fields/{name}__{lamp}.{field}{end}.f32"));
        let filled = |cell: usize| scene.cloud.extinction[cell] > 0.0;
        scores.push((field.to_owned(), score(found, &file("")?, &file("_se")?, filled)));
    }
    for (camera, _, image) in &fields.images {
        let file = |end: &str| read_f32(&format!("clouds/images/{name}__{lamp}__{camera}.adjoint.{end}.f32"));
        scores.push((format!("image {camera}"), score(&image.mean, &file("mean")?, &file("se")?, |_| true)));
    }
    Some(scores)
}

#[test]
fn solving_the_reference_scenes_at_default_settings_agrees_with_an_independent_monte_carlo() {
    // What is promised of fields at default settings; pictures keep it too.
    const MEAN: f64 = 0.03;
    const RMSE: f64 = 0.15;
    const MEDIAN: f64 = 0.08;
    println!("| scene | lamp | refinement | what | mean | relative RMSE | median |");
    println!("|---|---|---|---|---|---|---|");
    for (name, lamp) in [
        ("slab32", "below"),
        ("layer32", "below"),
        ("layer32", "near"),
        ("layer32", "inside"),
        ("sphere32vox_a1_g0", "centre"),
    ] {
        let Some(path) = reference(&format!("clouds/scenes/{name}.json")) else { return };
        let scene = read_scene(&path, Optics::default()).unwrap();
        let light = scene.light(lamp).unwrap();
        let towards: Vec<_> = orthographic(&scene.cameras).map(|(_, camera)| -camera.forward).collect();
        let truth = solve_light(&scene.cloud, light, &towards, &TruthSettings::default(), &Quiet).unwrap();
        let fields = Fields::of_truth(&truth, &scene.cameras, &Quiet).unwrap();
        for (what, Score { mean, rmse, median }) in scores(&scene, name, lamp, &fields).unwrap() {
            let (a, b, c) = (100.0 * mean, 100.0 * rmse, 100.0 * median);
            println!("| {name} | {lamp} | {} | {what} | {a:+.1} % | {b:.1} % | {c:.1} % |", truth.refine);
            let good = mean.abs() <= MEAN && rmse <= RMSE && median <= MEDIAN;
            assert!(good, "{name} {lamp} {what}: {a:+.1} % {b:.1} % {c:.1} %");
        }
    }
}
