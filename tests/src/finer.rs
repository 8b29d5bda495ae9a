//! Finer levels of virtual lights, and gathers, from the bytes that ship: against strokes solved directly.

use crate::assert_close;
use glam::DVec3;
use squall_bake::asset::asset_of;
use squall_bake::progress::Quiet;
use squall_bake::recipe::model::ResponseSettings;
use squall_bake::response::{BakedResponse, Job, Sources, WantedLights, bake_response};
use squall_formats::GridShape;
use squall_formats::error::Limits;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::response::{
    self, Codec, DirectTerm, DirectionalBasis, ResponseHead, ResponseSection, SolverRecord, Stored,
};
use squall_formats::sphere::MAX_HARMONICS;
use squall_runtime::clouds::LightQuality;
use squall_runtime::live::LiveSolver;
use squall_runtime::relight::PointLight;
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::SolveSettings;
use squall_runtime::transport::{Boundary, Cloud};
use squall_runtime::{Asset, Clouds};

/// A ball of cloud in air, some seven mean free paths and 440 m across.
fn ball() -> Cloud {
    let shape = GridShape::new(12, 12, 12);
    let mut cloud = Cloud {
        shape,
        cell_m: [50.0; 3],
        origin_m: DVec3::new(-300.0, 1000.0, 200.0),
        extinction: vec![0.0; shape.len()],
        albedo: 0.999,
        g: 0.85,
        boundary: Boundary::Open,
    };
    let middle = 0.5 * (cloud.origin_m + cloud.far_corner());
    for cell in 0..shape.len() {
        if cloud.centre(shape.cell(cell)).distance(middle) < 220.0 {
            cloud.extinction[cell] = 0.015;
        }
    }
    cloud
}

/// Distance between the light grid's virtual lights, m.
const SPACING_M: f64 = 300.0;

fn settings(finer: u32, relative_error: f64) -> ResponseSettings {
    ResponseSettings {
        basis: DirectionalBasis::Harmonics { degree: 1 },
        direct: DirectTerm::AtRunTime,
        codec: Codec::Bytes,
        finer,
        spacing_m: SPACING_M,
        relative_error,
        seen_only: true,
        view_region: None,
        refine: 1,
        stored: Stored::Means,
        error_for: Default::default(),
        samples: 4,
        solve: SolveSettings {
            quadrature: Quadrature::DoubleGauss { polar: 2, azimuths: 8 },
            tolerance: 1e-4,
            ..SolveSettings::default()
        },
    }
}

fn baked(cloud: &Cloud, settings: &ResponseSettings) -> BakedResponse {
    let axis = |low: f64| vec![low, low + SPACING_M, low + 2.0 * SPACING_M];
    let [x_m, y_m, z_m] = cloud.origin_m.to_array().map(axis);
    let lights = WantedLights { grid: LightGrid { x_m, y_m, z_m }, wanted: Vec::new() };
    let sources = Sources { lights, distant: Vec::new(), sun: None };
    let job =
        Job { cloud, sources: &sources, settings, held_out: &[], known: None, shown: None, cache: None };
    bake_response(&job, &Quiet).unwrap()
}

fn asset(cloud: &Cloud, settings: &ResponseSettings) -> (Asset, u64) {
    asset_of(cloud, baked(cloud, settings)).unwrap()
}

/// A zigzag through the ball.
fn stroke() -> Vec<PointLight> {
    let point = |i: usize| {
        let along = i as f64 / 15.0;
        let aside = if i.is_multiple_of(2) { 31.0 } else { -27.0 };
        let position = DVec3::new(-150.0 + 300.0 * along, 1295.0 + aside, 400.0 + 200.0 * along);
        PointLight { position, intensity: 1.0 + along }
    };
    (0..16).map(point).collect()
}

/// J's coefficients up to degree 1 of what a stroke scatters, solved directly, in cells that rays shade with.
fn solved(cloud: &Cloud, record: &SolverRecord, lights: &[PointLight]) -> Vec<f32> {
    let solver = LiveSolver::new(cloud, record).unwrap();
    let direct = solver.direct(lights, &[], 4);
    first_four(cloud, &solver.solve(&direct, &mut |_| true).unwrap().coefficients)
}

fn first_four(cloud: &Cloud, coefficients: &[f32]) -> Vec<f32> {
    let shaded = cloud.shaded();
    let rows = coefficients.as_chunks::<MAX_HARMONICS>().0;
    rows.iter().zip(shaded).filter(|(_, shaded)| *shaded).flat_map(|(row, _)| row[..4].to_vec()).collect()
}

/// The same from an asset.
fn lit(clouds: &mut Clouds, lights: &[PointLight], quality: LightQuality) -> Vec<f32> {
    clouds.set_quality(quality).unwrap();
    let light = clouds.light(lights).unwrap();
    let (cloud, parts) = (light.cells().clone(), light.in_scattered());
    let mut all = vec![0.0; cloud.shape.len() * MAX_HARMONICS];
    for (cell, row) in all.as_chunks_mut::<MAX_HARMONICS>().0.iter_mut().enumerate() {
        for m in 0..4 {
            let plane = parts.rows.planes.get(m * cloud.shape.len() + cell);
            let live = parts.live.get(cell * MAX_HARMONICS + m);
            row[m] = plane.copied().unwrap_or_default() + live.copied().unwrap_or_default();
        }
    }
    first_four(&cloud, &all)
}

fn off(found: &[f32], wanted: &[f32]) -> f64 {
    squall_bake::evaluate::relative_l2(found, wanted)
}

const PLAIN: LightQuality = LightQuality::PLAIN;

#[test]
fn a_light_on_a_finer_node_is_relit_as_it_was_solved() {
    /// What windows leave out and two residuals of 10⁻⁴; without finer levels it is some 40 %.
    const LEFT: f64 = 0.01;
    let cloud = ball();
    let (asset, _) = asset(&cloud, &settings(2, 0.0));
    let mut clouds = Clouds::new(&asset).unwrap();
    let record = clouds.relighter().response().head.solver.clone();
    // Of level 1 and of level 2.
    for place in [DVec3::new(-150.0, 1300.0, 500.0), DVec3::new(75.0, 1225.0, 425.0)] {
        let light = [PointLight { position: place, intensity: 2.5 }];
        let wanted = solved(&cloud, &record, &light);
        let error = off(&lit(&mut clouds, &light, PLAIN), &wanted);
        assert!(error < LEFT, "{place}: {error}");
    }
}

#[test]
fn strokes_come_closer_with_every_level_and_with_every_gather() {
    let cloud = ball();
    let mut before: Option<Vec<f64>> = None;
    for finer in 0..2 {
        let (asset, _) = asset(&cloud, &settings(finer, 1e-3));
        let mut clouds = Clouds::new(&asset).unwrap();
        let record = clouds.relighter().response().head.solver.clone();
        let wanted = solved(&cloud, &record, &stroke());
        let errors: Vec<f64> = (0..3)
            .map(|gathers| off(&lit(&mut clouds, &stroke(), LightQuality { gathers, ..PLAIN }), &wanted))
            .collect();
        println!("{finer} levels: {errors:.4?}");
        // The rays of direct light at run time are not those of the truth: 1 % of what they scatter.
        assert!(errors.windows(2).all(|pair| pair[1] < 0.7 * pair[0] + 0.01), "{errors:?}");
        if let Some(before) = before {
            // First order in the distance: light has a kink at the lamp.
            assert!(errors[0] < 0.8 * before[0], "{errors:?} after {before:?}");
        }
        before = Some(errors);
    }
}

#[test]
fn light_solved_for_in_larger_cells_comes_closer_with_every_gather() {
    let cloud = ball();
    let (asset, _) = asset(&cloud, &settings(0, 0.01));
    let mut clouds = Clouds::new(&asset).unwrap();
    let record = clouds.relighter().response().head.solver.clone();
    // Beside the box of virtual lights: no row answers for it.
    let lights = [PointLight { position: DVec3::new(30.0, 1300.0, 190.0), intensity: 4.0 }];
    let wanted = solved(&cloud, &record, &lights);
    let error = |clouds: &mut Clouds, gathers, live_cells| {
        off(&lit(clouds, &lights, LightQuality { gathers, live_cells }), &wanted)
    };
    let errors = [0, 1, 2, 4].map(|gathers| error(&mut clouds, gathers, 2));
    println!("{errors:.4?}");
    assert!(errors.windows(2).all(|pair| pair[1] < 0.8 * pair[0] + 0.01), "{errors:?}");
    // What does not divide the grid is taken down until it does.
    assert_eq!(error(&mut clouds, 0, 5).to_bits(), error(&mut clouds, 0, 4).to_bits());
}

#[test]
fn gathers_bring_light_of_blocks_of_cells_to_the_cells() {
    let cloud = ball();
    let large = cloud.coarsened([2; 3]).unwrap();
    let baked = baked(&large, &settings(1, 1e-3));
    let section = response::write_beside(&baked.head, baked.rows, cloud.shape);
    let asset = squall_bake::asset::in_memory(&[squall_bake::asset::grid_section(&cloud), section]).unwrap();
    let mut clouds = Clouds::new(&asset).unwrap();
    let record = clouds.relighter().response().head.solver.clone();
    let viewer = DVec3::new(0.0, -3000.0, 100.0);
    let solver = LiveSolver::new(&cloud, &record).unwrap();
    let direct = solver.direct(&stroke(), &[], 4);
    let solved = solver.solve(&direct, &mut |_| true).unwrap().coefficients;
    let shaded = cloud.shaded();
    let error = |clouds: &mut Clouds, gathers| {
        clouds.set_quality(LightQuality { gathers, ..PLAIN }).unwrap();
        let light = clouds.light(&stroke()).unwrap();
        let (parts, grid) = (light.in_scattered(), light.cells().clone());
        let mut j = vec![0.0; grid.shape.len()];
        let towards = |_: usize, middle: DVec3| (viewer - middle).normalize();
        parts.towards_each(&grid, towards, &mut j);
        let mut cells = vec![0.0; cloud.shape.len()];
        if gathers == 0 {
            clouds.relighter().spread(&j, &mut cells)
        } else {
            cells = j
        }
        let wanted = |cell: usize| {
            let harmonics = squall_formats::sphere::harmonics(
                towards(0, cloud.centre(cloud.shape.cell(cell))).to_array(),
            );
            let row = &solved[cell * MAX_HARMONICS..(cell + 1) * MAX_HARMONICS];
            row.iter().zip(harmonics).map(|(v, y)| v * y as f32).sum::<f32>()
        };
        let read: Vec<usize> = (0..cells.len()).filter(|&cell| shaded[cell]).collect();
        let found: Vec<f32> = read.iter().map(|&cell| cells[cell]).collect();
        off(&found, &read.into_iter().map(wanted).collect::<Vec<f32>>())
    };
    let errors = [0, 1, 2].map(|gathers| error(&mut clouds, gathers));
    println!("{errors:.4?}");
    assert!(errors.windows(2).all(|pair| pair[1] < 0.8 * pair[0] + 0.01), "{errors:?}");
}

#[test]
fn finer_levels_and_gathers_are_the_same_bytes_for_any_number_of_threads() {
    let cloud = ball();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (asset, _) = asset(&cloud, &settings(1, 0.02));
            let mut clouds = Clouds::new(&asset).unwrap();
            let light = lit(&mut clouds, &stroke(), LightQuality { gathers: 2, ..PLAIN });
            (asset.bytes().to_vec(), light)
        })
    };
    let (one, three) = (with(1), with(3));
    assert!(one.0 == three.0, "bytes");
    assert!(one.1.iter().zip(&three.1).all(|(a, b)| a.to_bits() == b.to_bits()), "light");
}

#[test]
fn an_asset_without_finer_levels_is_written_as_before_and_one_with_them_is_version_4() {
    let cloud = ball();
    for (finer, version) in [(0, 2), (1, 4)] {
        let baked = baked(&cloud, &settings(finer, 0.05));
        let section = response::write(&baked.head, baked.rows);
        assert_eq!(section.version, version);
        let bytes = section.to_bytes();
        let read = ResponseSection::read(&bytes, version, &Limits::default()).unwrap();
        assert_eq!(read.head.finer.len(), finer as usize);
        assert_eq!(read.head, baked.head);
    }
}

#[test]
fn each_damaged_field_of_a_finer_level_is_named() {
    type Spoil = fn(&mut ResponseHead);
    let damage: [(&str, Spoil); 10] = [
        ("finer levels", |head| head.finer = vec![head.finer[0].clone(); 9]),
        ("light grid axis", |head| head.finer[0].grid.x_m[1] = f64::NAN),
        ("first row of a finer level", |head| head.finer[0].first_row += 1),
        ("rows of windows", |head| head.finer[0].windows[0].rows += 1),
        ("rows of windows", |head| head.finer[0].nodes.truncate(1)),
        ("nodes of a finer level", |head| head.finer[0].nodes[1] = head.finer[0].nodes[0]),
        ("nodes of a finer level", |head| head.finer[0].nodes[0] = u32::MAX),
        ("window of a finer level", |head| head.finer[0].windows[0].low[2] = u32::MAX),
        ("window of a finer level", |head| head.finer[0].windows[0].shape.ny = 0),
        ("window of a finer level", |head| head.finer[0].windows[0].shape.nx = 17),
    ];
    let good = baked(&ball(), &settings(1, 0.3));
    for (field, spoil) in damage {
        let mut head = good.head.clone();
        spoil(&mut head);
        let bytes = response::write(&head, good.rows.clone()).to_bytes();
        let error = ResponseSection::read(&bytes, 4, &Limits::default()).unwrap_err().to_string();
        assert!(error.contains(field), "{field}: {error}");
    }
}

#[test]
fn gathers_are_refused_of_rows_that_light_cannot_be_scattered_on_from() {
    let cloud = ball();
    let rows = ResponseSettings { direct: DirectTerm::InRows, ..settings(0, 0.1) };
    let even = ResponseSettings { basis: DirectionalBasis::Harmonics { degree: 0 }, ..settings(0, 0.1) };
    for (settings, reason) in [(rows, "direct light in the rows"), (even, "light without its direction")] {
        let (asset, _) = asset(&cloud, &settings);
        let mut clouds = Clouds::new(&asset).unwrap();
        clouds.set_quality(LightQuality { gathers: 1, ..PLAIN }).unwrap();
        let error = clouds.light(&stroke()).err().unwrap().to_string();
        assert!(error.contains("quality.light.gathers") && error.contains(reason), "{error}");
    }
    let (asset, _) = asset(&cloud, &settings(0, 0.1));
    let mut clouds = Clouds::new(&asset).unwrap();
    for quality in [LightQuality { gathers: 65, ..PLAIN }, LightQuality { live_cells: 0, ..PLAIN }] {
        assert!(clouds.set_quality(quality).is_err());
    }
    // Light is linear, gathered or not.
    let quality = LightQuality { gathers: 1, ..PLAIN };
    let one = lit(&mut clouds, &stroke(), quality);
    let twice: Vec<PointLight> =
        stroke().into_iter().map(|light| PointLight { intensity: 2.0 * light.intensity, ..light }).collect();
    let both = lit(&mut clouds, &twice, quality);
    let sum = |values: &[f32]| values.iter().map(|&v| f64::from(v)).sum::<f64>();
    assert_close(sum(&both), 2.0 * sum(&one), 1e-5, "twice the light");
}
