//! Light solved for in a cloud's own cells and fitted to blocks of them, from the bytes that ship.

use glam::DVec3;
use squall_bake::asset::{grid_section, in_memory};
use squall_bake::evaluate::relative_l2;
use squall_bake::progress::Quiet;
use squall_bake::recipe::model::ResponseSettings;
use squall_bake::response::{Job, Sources, WantedLights, bake_response};
use squall_formats::GridShape;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::response::{self, Codec, DirectTerm, DirectionalBasis, Stored};
use squall_formats::sphere::MAX_HARMONICS;
use squall_runtime::Clouds;
use squall_runtime::clouds::LightQuality;
use squall_runtime::live::LiveSolver;
use squall_runtime::relight::PointLight;
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::SolveSettings;
use squall_runtime::transport::{Boundary, Cloud};

/// A ragged ball of cloud in air, some nine mean free paths across.
fn ball() -> Cloud {
    let shape = GridShape::new(16, 16, 12);
    let mut cloud = Cloud {
        shape,
        cell_m: [40.0; 3],
        origin_m: DVec3::new(-320.0, 1000.0, 200.0),
        extinction: vec![0.0; shape.len()],
        albedo: 0.999,
        g: 0.85,
        boundary: Boundary::Open,
    };
    let middle = 0.5 * (cloud.origin_m + cloud.far_corner());
    for cell in 0..shape.len() {
        if cloud.centre(shape.cell(cell)).distance(middle) < 230.0 {
            cloud.extinction[cell] = 0.01 + 0.0005 * ((cell * 7) % 31) as f32;
        }
    }
    cloud
}

/// A light on a node of the light grid below: rows are its light, without interpolation.
fn lamp(cloud: &Cloud) -> [PointLight; 1] {
    [PointLight { position: cloud.origin_m + DVec3::new(300.0, 330.0, 250.0), intensity: 3.0 }]
}

/// The cloud with rows for blocks of eight of its cells, one level of finer virtual lights behind the light grid.
fn clouds(stored: Stored, refine: u32, blocks: u32) -> (Clouds, u16) {
    let cloud = ball();
    let large = cloud.coarsened([blocks; 3]).unwrap();
    let settings = ResponseSettings {
        basis: DirectionalBasis::Harmonics { degree: 1 },
        direct: DirectTerm::AtRunTime,
        codec: Codec::Entropy,
        finer: 1,
        spacing_m: 200.0,
        relative_error: 1e-3,
        seen_only: true,
        view_region: None,
        refine,
        error_for: Default::default(),
        stored,
        samples: 2,
        solve: SolveSettings {
            quadrature: Quadrature::DoubleGauss { polar: 2, azimuths: 8 },
            tolerance: 1e-4,
            ..SolveSettings::default()
        },
    };
    let node = lamp(&cloud)[0].position;
    let axis = |at: f64| vec![at - 100.0, at, at + 100.0];
    let [x_m, y_m, z_m] = node.to_array().map(axis);
    let lights = WantedLights { grid: LightGrid { x_m, y_m, z_m }, wanted: Vec::new() };
    let sources = Sources { lights, distant: Vec::new(), sun: None };
    let shown = Some(&cloud);
    let job = Job {
        cloud: &large,
        sources: &sources,
        settings: &settings,
        held_out: &[],
        known: None,
        shown,
        cache: None,
    };
    let baked = bake_response(&job, &Quiet).unwrap();
    let section = response::write_beside(&baked.head, baked.rows, cloud.shape);
    let version = section.version;
    let asset = in_memory(&[grid_section(&cloud), section]).unwrap();
    (Clouds::new(&asset).unwrap(), version)
}

/// J towards the side in cells that rays shade with: as rows or gathers have it, read in the cloud's cells, and as it was solved there.
fn seen(clouds: &mut Clouds, lights: &[PointLight], gathers: u32) -> [Vec<f32>; 2] {
    clouds.set_quality(LightQuality { gathers, ..LightQuality::PLAIN }).unwrap();
    let light = clouds.light(lights).unwrap();
    let (parts, grid) = (light.in_scattered(), light.cells().clone());
    let mut j = vec![0.0; grid.shape.len()];
    parts.towards_each(&grid, |_, _| DVec3::NEG_Y, &mut j);
    let cloud = clouds.cloud().clone();
    let mut cells = j.clone();
    if grid.shape != cloud.shape {
        cells = vec![0.0; cloud.shape.len()];
        clouds.relighter().spread(&j, &mut cells);
    }
    let mut record = clouds.relighter().response().head.solver.clone();
    record.refine = [1; 3];
    let solver = LiveSolver::new(&cloud, &record).unwrap();
    let direct = solver.direct(lights, &[], 4);
    let solved = solver.solve(&direct, &mut |_| true).unwrap().coefficients;
    let harmonics = squall_formats::sphere::harmonics([0.0, -1.0, 0.0]);
    // Up to degree 1, which is what rows hold.
    let value = |row: &[f32]| (0..4).map(|m| row[m] * harmonics[m] as f32).sum::<f32>();
    let all: Vec<f32> = solved.as_chunks::<MAX_HARMONICS>().0.iter().map(|row| value(row)).collect();
    if gathers > 0 {
        cells = parts.live.as_chunks::<MAX_HARMONICS>().0.iter().map(|row| value(row)).collect();
    }
    let shaded = cloud.shaded();
    [cells, all]
        .map(|values| values.iter().zip(&shaded).filter(|(_, seen)| **seen).map(|(v, _)| *v).collect())
}

#[test]
fn fitted_light_is_nearer_to_the_cells_that_it_was_solved_in_than_means_and_one_gather_finishes_it() {
    /// Light beside a lamp falls within a block, which no eight numbers a block say.
    const FITTED: f64 = 0.25;
    /// Rays of direct light, codec and windows.
    const GATHERED: f64 = 0.03;
    let error = |stored: Stored, gathers: u32| {
        let (mut clouds, _) = clouds(stored, 1, 2);
        let lights = lamp(clouds.cloud());
        let [found, wanted] = seen(&mut clouds, &lights, gathers);
        relative_l2(&found, &wanted)
    };
    let [means, fitted] =
        [Stored::Means, Stored::Fit].map(|stored| [0, 1].map(|gathers| error(stored, gathers)));
    println!("means {means:.4?}, fitted {fitted:.4?}");
    assert!(fitted[0] < 0.8 * means[0] && fitted[0] < FITTED, "{fitted:?} for {means:?}");
    assert!(fitted[1] < 0.8 * means[1] && fitted[1] < GATHERED, "{fitted:?} for {means:?}");
}

#[test]
fn a_light_that_no_row_answers_for_is_solved_for_and_fitted_as_rows_are() {
    /// The codec, and 64 rays a face for 4.
    const ALIKE: f64 = 0.02;
    let (mut lit, version) = clouds(Stored::Fit, 1, 2);
    assert_eq!(version, 5);
    let lights = lamp(lit.cloud());
    let rows = lit.light(&lights).unwrap();
    assert_eq!(rows.lights_outside(), 0);
    let solver = lit.relighter().live_solver().unwrap();
    let live = solver.solve(&solver.direct(&lights, &[], 4), &mut |_| true).unwrap().coefficients;
    let known = lit.relighter().known_light_cells();
    let count = known.len();
    let (mut found, mut wanted) = (Vec::new(), Vec::new());
    for cell in (0..count).filter(|&cell| known[cell]) {
        for m in 0..4 {
            found.push(rows.relit().planes[m * count + cell]);
            wanted.push(live[cell * MAX_HARMONICS + m]);
        }
    }
    let error = relative_l2(&found, &wanted);
    assert!(error < ALIKE, "{error}");
}

#[test]
fn fluence_of_fitted_light_is_the_cells_mean_and_never_negative() {
    /// Means of the reading are not quite those of the cells.
    const SUM: f64 = 0.02;
    let sums = [Stored::Means, Stored::Fit].map(|stored| {
        // Solved in eighths of the cloud's own cells.
        let (mut lit, _) = clouds(stored, 2, 1);
        let lights = lamp(lit.cloud());
        let mut fluence = vec![0.0; lit.cloud().shape.len()];
        lit.light(&lights).unwrap().fluence(&mut fluence).unwrap();
        assert!(fluence.iter().all(|&value| value >= 0.0));
        let cells = fluence.iter().zip(&lit.cloud().extinction);
        cells.map(|(&phi, &extinction)| f64::from(phi * extinction)).sum::<f64>()
    });
    assert!((sums[1] / sums[0] - 1.0).abs() < SUM, "{sums:?}");
}

#[test]
fn a_fit_of_the_cells_themselves_is_what_they_hold_and_no_new_version() {
    let (lit, version) = clouds(Stored::Fit, 1, 1);
    assert_eq!(version, 4);
    assert_eq!(lit.relighter().response().head.stored, Stored::Means);
}
