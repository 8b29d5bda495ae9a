//! `squall solve --method monte-carlo` against closed forms, published tables, invariants, somebody else's photons, and the
//! sweep.

use crate::transport::{cube, infinite_medium, ragged};
use crate::truth::read_f32;
use crate::{assert_close, reference};
use glam::DVec3;
use squall_bake::cloud::{TruthSettings, solve_light};
use squall_bake::fields::{Estimate, Fields, orthographic};
use squall_bake::input::scene::{Optics, read_scene};
use squall_bake::monte_carlo::{MonteCarloReport, MonteCarloSettings, solve_monte_carlo};
use squall_bake::progress::Quiet;
use squall_formats::GridShape;
use squall_formats::units::Radians;
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::transport::direct::Light;
use squall_runtime::transport::{Boundary, Cloud};
use std::f64::consts::PI;

/// Standard errors that a single comparison may be off: seeds are fixed, so that what passes once passes always, and one in
/// 10⁵ right answers would be called wrong.
const SIGMAS: f64 = 4.5;

fn photons(photons: u64) -> MonteCarloSettings {
    MonteCarloSettings { photons, seed: 1 }
}

fn run(cloud: &Cloud, light: Light, cameras: &[(String, Camera)], count: u64) -> (Fields, MonteCarloReport) {
    solve_monte_carlo(cloud, light, cameras, &photons(count), &Quiet).unwrap()
}

fn lamp(position: DVec3, intensity: f64) -> Light {
    Light::Point { position, intensity }
}

/// Mean squared deviation in units of both errors, over places where each error is below `share` of its value.
fn chi_square(found: &Estimate, wanted: &[f32], errors: &[f32], share: f64) -> (f64, usize) {
    let own = found.error.as_ref().unwrap();
    let (mut sum, mut count) = (0.0, 0usize);
    for i in 0..wanted.len() {
        let [x, dx, r, dr] = [found.mean[i], own[i], wanted[i], errors[i]].map(f64::from);
        if dx < share * x && dr < share * r {
            sum += (x - r) * (x - r) / (dx * dx + dr * dr);
            count += 1;
        }
    }
    (sum / count as f64, count)
}

#[test]
fn photons_in_an_infinite_medium_have_the_closed_form_fluence() {
    /// What the fourth derivative adds to a cell's mean over .3 mean free paths at distance 1, and chance over a shell.
    const TOLERANCE: f64 = 0.01;
    let cell = 0.3;
    let cloud = cube(73, cell, 0.9, 0.0);
    let (fields, _) = run(&cloud, lamp(DVec3::ZERO, 1.0 / (4.0 * PI)), &[], 200_000);
    for (wanted, printed) in [(1.0, 0.143_283_9), (2.0, 0.037_126_4), (5.0, 0.002_915_13)] {
        assert_close(infinite_medium(0.9, wanted), printed, 1e-5, "closed form");
        // Mean over a shell, each cell taken to `wanted` by the closed form's slope and curvature there.
        let step = 0.05;
        let [low, mid, high] = [-step, 0.0, step].map(|off| infinite_medium(0.9, wanted + off));
        let (slope, bend) = ((high - low) / (2.0 * step), (high - 2.0 * mid + low) / (step * step));
        let mean_over_cell = cell * cell / 24.0 * (bend + 2.0 * slope / wanted);
        let (mut sum, mut count) = (0.0, 0.0);
        for index in 0..cloud.shape.len() {
            let off = cloud.centre(cloud.shape.cell(index)).length() - wanted;
            if off.abs() < 0.1 {
                let here = mid + off * slope + 0.5 * off * off * bend + mean_over_cell;
                sum += f64::from(fields.phi_scattered.mean[index] + fields.phi_direct.mean[index]) / here;
                count += 1.0;
            }
        }
        assert!(count >= 12.0);
        assert_close(sum / count, 1.0, TOLERANCE, &format!("fluence over closed form at {wanted}"));
    }
}

#[test]
fn monte_carlo_collisions_lie_at_the_mean_squared_distance_of_the_closed_form() {
    /// The cube ends 24 mean free paths out, where some .5 % of the second moment is still to come; chance adds .3 %.
    const TOLERANCE: f64 = 0.015;
    for (albedo, g) in [(0.8, 0.5), (0.8, -0.6), (0.6, 0.9)] {
        let cloud = cube(49, 1.0, albedo, g);
        let (fields, _) = run(&cloud, lamp(DVec3::ZERO, 1.0), &[], 200_000);
        let (mut sum, mut second) = (0.0, 0.0);
        for cell in 0..cloud.shape.len() {
            let fluence = f64::from(fields.phi_scattered.mean[cell] + fields.phi_direct.mean[cell]);
            sum += fluence;
            // Sheppard's correction: what moves a cell's light to its centre adds a twelfth of an edge squared per axis.
            second += fluence * (cloud.centre(cloud.shape.cell(cell)).length_squared() - 0.25);
        }
        let wanted = 2.0 / ((1.0 - albedo) * (1.0 - albedo * g));
        assert_close(second / sum, wanted, TOLERANCE, &format!("albedo {albedo}, g {g}"));
    }
}

#[test]
fn light_never_scattered_falls_as_the_inverse_square_and_as_e_to_the_minus_depth() {
    /// Relative standard error up to which single cells are judged.
    const ERROR: f64 = 0.05;
    /// What 20³ points leave of a cell's mean beyond two edges from the lamp.
    const QUADRATURE: f64 = 1e-3;
    /// Mean square of deviations over standard errors: the starts are even, so that errors are less alike than by pure chance.
    const CHI_SQUARE: f64 = 2.0;
    let cloud = cube(9, 0.5, 0.7, 0.3);
    let base = cloud.origin_m.z;
    // Inside a cell, on a cell's corner, on the cube's face, under it, and on its last corner.
    for from in [[0.0; 3], [0.25; 3], [-2.25, 0.1, 0.3], [0.3, 0.2, -4.0], [2.25; 3]].map(DVec3::from_array) {
        let (fields, _) = run(&cloud, lamp(from, 2.0), &[], 60_000);
        let errors = fields.phi_direct.error.as_ref().unwrap();
        let (mut judged, mut square) = (0.0, 0.0);
        for cell in 0..cloud.shape.len() {
            let (value, error) = (f64::from(fields.phi_direct.mean[cell]), f64::from(errors[cell]));
            let centre = cloud.centre(cloud.shape.cell(cell));
            // From under the cube, only light that comes in by the base has the same share of every way inside.
            let foot = from + (centre - from) * ((base - from.z) / (centre.z - from.z));
            let by_side = from.z < base && foot.x.abs().max(foot.y.abs()) > 1.8;
            if error > ERROR * value || centre.distance(from) < 1.0 || by_side {
                continue;
            }
            let mut sum = 0.0;
            for i in 0..8000 {
                let at = |k: i32| 0.5 * ((f64::from(k % 20) + 0.5) / 20.0 - 0.5);
                let point = centre + DVec3::new(at(i), at(i / 20), at(i / 400));
                let offset = point - from;
                let inside = if from.z < base { (point.z - base) / offset.z } else { 1.0 };
                sum += 2.0 * libm::exp(-inside * offset.length()) / offset.length_squared();
            }
            let wanted = sum / 8000.0;
            let off = (value - wanted) / error.max(QUADRATURE * value);
            square += off * off;
            judged += 1.0;
        }
        assert!(judged > 200.0, "{from}: {judged}");
        let mean = square / judged;
        assert!(mean < CHI_SQUARE, "{from}: χ² {mean} a cell over {judged}");
    }
}

/// One cell without sides, and a beam of 1 W/m² across it that comes down at `mu`.
fn slab(depth: f64, albedo: f64, g: f64, mu: f64) -> (Cloud, Light) {
    let cloud = Cloud {
        shape: GridShape::new(1, 1, 1),
        cell_m: [0.5, 2.0, 1.0],
        origin_m: DVec3::new(3.0, 4.0, 5.0),
        extinction: vec![depth as f32],
        albedo,
        g,
        boundary: Boundary::PeriodicXy,
    };
    let direction = DVec3::new((1.0 - mu * mu).sqrt(), 0.0, -mu);
    (cloud, Light::Beam { direction, irradiance: 1.0 })
}

#[test]
fn slabs_reflect_and_transmit_as_discrete_ordinates_of_64_streams() {
    // Beam flux π on the horizontal: flux up at the top, diffuse flux down at the bottom.
    for (depth, albedo, g, mu, up, down) in [
        (0.031_25, 0.2, 0.0, 0.1, 0.079_871_9, 0.079_358_6),
        (32.0, 0.99, 0.0, 0.1, 2.756_78, 0.002_448_20),
        (1.0, 1.0, 0.75, 1.0, 0.247_368, PI * (1.0 - libm::exp(-1.0)) - 0.247_368),
        (8.0, 1.0, 0.75, 1.0, 1.590_95, 1.549_59),
    ] {
        let (cloud, light) = slab(depth, albedo, g, mu);
        let (_, report) = run(&cloud, light, &[], 200_000);
        assert_close(report.power_in_w, mu, 1e-12, "beam on a square metre");
        // Extinction is stored in single precision; beyond 60 depths nothing is followed.
        let through = libm::exp(-depth / mu);
        let direct = report.direct_out_w / mu;
        assert!((direct - through).abs() < 1e-6 * through + 1e-26, "{direct} {through}");
        for (side, wanted) in [(5, up), (4, down)] {
            let found = report.scattered_out_w[side] / mu * PI;
            let error = report.scattered_out_se_w[side] / mu * PI;
            assert!(error < 0.01 * wanted || wanted < 0.01, "depth {depth}: {found} ± {error}");
            assert!((found - wanted).abs() < SIGMAS * error, "depth {depth}: {found} ± {error}, {wanted}");
        }
    }
}

#[test]
fn the_step_cloud_of_i3rc_reflects_in_monte_carlo_as_its_consensus() {
    /// One standard error of the published consensus.
    const CONSENSUS: f64 = 1e-4;
    for (albedo, reflected, transmitted) in [(1.0, 0.327_63, 0.672_37), (0.99, 0.260_99, 0.598_05)] {
        let depth = |x: usize| if x < 16 { 2.0 } else { 18.0 };
        let cloud = Cloud {
            shape: GridShape::new(32, 1, 1),
            cell_m: [500.0 / 32.0, 1e5, 250.0],
            origin_m: DVec3::ZERO,
            extinction: (0..32).map(|i| (depth(i) / 250.0) as f32).collect(),
            albedo,
            g: 0.85,
            boundary: Boundary::PeriodicXy,
        };
        let light = Light::Beam { direction: DVec3::NEG_Z, irradiance: 1.0 };
        let (_, report) = run(&cloud, light, &[], 200_000);
        let (up, down) = (report.scattered_out_w[5], report.scattered_out_w[4] + report.direct_out_w);
        for (found, error, wanted) in
            [(up, report.scattered_out_se_w[5], reflected), (down, report.scattered_out_se_w[4], transmitted)]
        {
            let [found, error] = [found, error].map(|value| value / report.power_in_w);
            assert!(error < 2e-3);
            assert!((found - wanted).abs() < SIGMAS * (error + CONSENSUS), "{found} ± {error}, {wanted}");
        }
    }
}

#[test]
fn pictures_of_a_slab_have_the_radiances_of_van_de_hulsts_table() {
    // Table 12: isotropic, albedo .8, depth 2, seen at μ = .5: radiance is R μ0 E / π, above and below.
    for (mu, reflected, transmitted) in
        [(1.0, 0.286_16, 0.148_64), (0.5, 0.391_02, 0.122_22), (0.1, 0.532_14, 0.066_01)]
    {
        let (cloud, light) = slab(2.0, 0.8, 0.0, mu);
        let camera = |z: f64| {
            // Several copies of the cell a pixel, and parts of them at the edges.
            let projection = Projection::Orthographic { half_width: 2.3, half_height: 1.9 };
            let direction = DVec3::new(0.4, (0.75f64 - 0.16).sqrt(), z);
            Camera::new(DVec3::ZERO, direction, DVec3::Z, projection, [3, 2]).unwrap()
        };
        let cameras = [("above".into(), camera(-0.5)), ("below".into(), camera(0.5))];
        let (fields, _) = run(&cloud, light, &cameras, 50_000);
        for ((_, _, image), wanted) in fields.images.iter().zip([reflected, transmitted]) {
            for (value, error) in image.mean.iter().zip(image.error.as_ref().unwrap()) {
                let [found, error] = [value, error].map(|v| f64::from(*v) * PI / mu);
                assert!(error < 0.02 * wanted, "{found} ± {error}");
                assert!((found - wanted).abs() < SIGMAS * error, "μ0 {mu}: {found} ± {error}, {wanted}");
            }
        }
    }
}

#[test]
fn power_is_absorbed_or_leaves_within_what_roulette_adds() {
    // Round-off of some 10⁵ additions, where roulette plays no part.
    const ROUND_OFF: f64 = 1e-11;
    for (albedo, g) in [(1.0, 0.0), (1.0, 0.999), (0.5, -0.999), (0.9, 0.85), (0.0, 0.5)] {
        let cloud = ragged(albedo, g);
        let corner = cloud.origin_m + DVec3::new(100.0, 80.0, 60.0);
        for from in
            [corner, cloud.origin_m, cloud.far_corner(), cloud.origin_m - DVec3::new(300.0, 40.0, 0.0)]
        {
            let (fields, report) = run(&cloud, lamp(from, 3.0), &[], 5_000);
            let allowed = ROUND_OFF + SIGMAS * report.energy_balance_se;
            assert!(report.energy_balance.abs() <= allowed, "{albedo} {g} {from}: {report:?}");
            assert!(report.energy_balance_se < 0.01);
            assert!(from != corner || (report.power_in_w / (12.0 * PI) - 1.0).abs() < 1e-12);
            // What is absorbed is also extinction times fluence: two estimators of one number.
            let volume = cloud.cell_volume();
            let absorbed: f64 = (0..cloud.shape.len())
                .map(|i| {
                    let fluence = f64::from(fields.phi_scattered.mean[i] + fields.phi_direct.mean[i]);
                    f64::from(cloud.extinction[i]) * (1.0 - albedo) * fluence * volume
                })
                .sum();
            let scale = report.absorbed_w.max(1e-12 * report.power_in_w);
            assert!((absorbed - report.absorbed_w).abs() < 0.05 * scale, "{absorbed} {}", report.absorbed_w);
        }
    }
    // Empty, opaque and one-cell clouds: all finite, all power found again.
    for extinction in [0.0, 1e-9, 1e3, 1e30] {
        let mut cloud = cube(1, 2.0, 0.9, 0.5);
        cloud.extinction = vec![extinction];
        let (fields, report) = run(&cloud, lamp(DVec3::splat(0.1), 1.0), &[], 1_000);
        assert!(report.energy_balance.abs() <= ROUND_OFF + SIGMAS * report.energy_balance_se, "{report:?}");
        assert!(fields.phi_direct.mean[0].is_finite() && fields.phi_scattered.mean[0].is_finite());
    }
}

#[test]
fn the_reference_fields_and_pictures_are_met_within_their_standard_errors() {
    /// Mean squared deviation in standard errors: 1 for exact errors, 31/29 for errors from 32 batches, more where few photons
    /// make single values skew; neighbours move together, so that a map scatters by .1.
    const CHI_SQUARE: [f64; 2] = [0.8, 1.4];
    for (name, lamp) in [("layer32", "near"), ("slab32", "below")] {
        let Some(path) = reference(&format!("clouds/scenes/{name}.json")) else { return };
        let index = reference("clouds/index.json").unwrap();
        let index: serde_json::Value = serde_json::from_slice(&std::fs::read(index).unwrap()).unwrap();
        let scene = read_scene(&path, Optics::default()).unwrap();
        let light = scene.light(lamp).unwrap();
        let (fields, report) = run(&scene.cloud, light, &scene.cameras, 600_000);
        let judged = |what: &str, found: &Estimate, file: &str, mean: f64, error: f64| {
            let own = report.means[what];
            let off = (own.mean - mean) / (own.standard_error * own.standard_error + error * error).sqrt();
            let (wanted, errors) =
                (read_f32(&format!("{file}.f32")), read_f32(&format!("{}.f32", error_file(file))));
            let (chi, count) = chi_square(found, &wanted.unwrap(), &errors.unwrap(), 0.15);
            println!(
                "{name} {lamp} {what}: mean off by {off:.2} standard errors, χ² {chi:.2} a value over {count}"
            );
            assert!(off.abs() < SIGMAS, "{name} {what}: mean off by {off} standard errors");
            assert!(own.standard_error < 0.01 * own.mean, "{name} {what}: {own:?}");
            assert!(
                count > 100 && chi > CHI_SQUARE[0] && chi < CHI_SQUARE[1],
                "{name} {what}: χ² {chi} over {count}"
            );
        };
        for (what, short, found) in
            [("phi_sc", "phi_sc", &fields.phi_scattered), ("jcam_top", "jcam", &fields.towards[0].1)]
        {
            let file = format!("clouds/fields/{name}__{lamp}.{short}");
            let wanted = read_f32(&format!("{file}.f32")).unwrap();
            let mean = wanted.iter().map(|&v| f64::from(v)).sum::<f64>() / wanted.len() as f64;
            let error =
                index["fields"][format!("{name}__{lamp}")][format!("{short}_mean_se")].as_f64().unwrap();
            judged(what, found, &file, mean, error);
        }
        for (camera, _, found) in &fields.images {
            let key = format!("{name}__{lamp}__{camera}.adjoint");
            let mean = &index["images"][&key]["mean_radiance"];
            let file = format!("clouds/images/{key}.mean");
            judged(
                &format!("image_{camera}"),
                found,
                &file,
                mean[0].as_f64().unwrap(),
                mean[1].as_f64().unwrap(),
            );
        }
    }
}

fn error_file(file: &str) -> String {
    match file.strip_suffix(".mean") {
        Some(image) => format!("{image}.se"),
        None => format!("{file}_se"),
    }
}

/// A small cloud with an eye on each side of it.
fn small() -> (Cloud, Vec<(String, Camera)>) {
    let mut cloud = ragged(0.95, 0.5);
    cloud.shape = GridShape::new(6, 5, 4);
    cloud.extinction =
        (0..120).map(|i| if i % 4 == 1 { 0.0 } else { 0.003 * (1 + i * 37 % 5) as f32 }).collect();
    let middle = 0.5 * (cloud.origin_m + cloud.far_corner());
    let orthographic = Projection::Orthographic { half_width: 220.0, half_height: 180.0 };
    let top = Camera::new(middle, DVec3::NEG_Z, DVec3::Y, orthographic, [8, 6]).unwrap();
    let perspective = Projection::Perspective { vertical_fov: Radians(0.7) };
    let from = middle + DVec3::new(300.0, -400.0, 150.0);
    let eye = Camera::new(from, middle - from, DVec3::Z, perspective, [8, 6]).unwrap();
    (cloud, vec![("top".into(), top), ("eye".into(), eye)])
}

#[test]
fn the_sweep_and_the_photons_agree() {
    /// The sweep's promise for means at this refinement; chance adds half a per cent.
    const TOLERANCE: f64 = 0.03;
    let (cloud, cameras) = small();
    let light = lamp(cloud.origin_m + DVec3::new(120.0, 90.0, 70.0), 5.0);
    let (photons, _) = run(&cloud, light, &cameras, 400_000);
    let towards: Vec<DVec3> = orthographic(&cameras).map(|(_, camera)| -camera.forward).collect();
    let settings = TruthSettings { refine: 4, ..TruthSettings::default() };
    let truth = solve_light(&cloud, light, &towards, &settings, &Quiet).unwrap();
    let sweep = Fields::of_truth(&truth, &cameras, &Quiet).unwrap();
    let sum = |estimate: &Estimate| estimate.mean.iter().map(|&v| f64::from(v)).sum::<f64>();
    let pairs = [
        ("phi_sc", &photons.phi_scattered, &sweep.phi_scattered),
        ("phi_dir", &photons.phi_direct, &sweep.phi_direct),
        ("jcam", &photons.towards[0].1, &sweep.towards[0].1),
        ("top", &photons.images[0].2, &sweep.images[0].2),
        ("eye", &photons.images[1].2, &sweep.images[1].2),
    ];
    for (what, a, b) in pairs {
        assert_close(sum(a), sum(b), TOLERANCE, what);
    }
}

#[test]
fn bytes_depend_on_the_seed_and_not_on_the_number_of_threads() {
    let (cloud, cameras) = small();
    let light = lamp(cloud.origin_m + DVec3::new(120.0, 90.0, 70.0), 5.0);
    let on = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let settings = MonteCarloSettings { photons: 40_001, seed };
        pool.install(|| solve_monte_carlo(&cloud, light, &cameras, &settings, &Quiet).unwrap().0)
    };
    let one = on(1, 1);
    assert!(one == on(2, 1) && one == on(5, 1));
    let other = on(2, 2);
    let pairs = [
        (&one.phi_scattered, &other.phi_scattered),
        (&one.towards[0].1, &other.towards[0].1),
        (&one.images[0].2, &other.images[0].2),
        (&one.images[1].2, &other.images[1].2),
    ];
    for (a, b) in pairs {
        assert!(a != b);
        let (chi, count) = chi_square(a, &b.mean, b.error.as_ref().unwrap(), 0.3);
        // Over 19 to 120 values that move together: the eye's picture shows the cloud in 19 of its pixels.
        assert!(count >= 19 && (0.5..2.0).contains(&chi), "χ² {chi} over {count}");
    }
}

#[test]
fn what_photons_cannot_answer_is_refused_with_the_reason() {
    let (cloud, cameras) = small();
    let light = lamp(cloud.origin_m, 1.0);
    let refused = |cloud: &Cloud, light: Light, cameras: &[(String, Camera)], count: u64, words: &str| {
        let error = solve_monte_carlo(cloud, light, cameras, &photons(count), &Quiet).unwrap_err();
        assert_eq!(error.exit_code(), 3);
        assert!(error.to_string().contains(words), "{error}");
    };
    refused(&cloud, light, &cameras, 99, "samples: wanted 100 to 100000000000 photons, found 99");
    let periodic = Cloud { boundary: Boundary::PeriodicXy, ..cloud };
    let level = Light::Beam { direction: DVec3::X, irradiance: 1.0 };
    refused(&periodic, level, &[], 1000, "beam direction");
    refused(&periodic, light, &cameras, 1000, "\"eye\", a perspective one");
    let orthographic = Projection::Orthographic { half_width: 1.0, half_height: 1.0 };
    let side = Camera::new(DVec3::ZERO, DVec3::X, DVec3::Z, orthographic, [4, 4]).unwrap();
    refused(&periodic, light, &[("side".into(), side)], 1000, "which looks level");
    let wide = Projection::Orthographic { half_width: 1e6, half_height: 1e6 };
    let far = Camera::new(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, wide, [4, 4]).unwrap();
    refused(&periodic, light, &[("far".into(), far)], 1000, "more than 65536 copies");
}
