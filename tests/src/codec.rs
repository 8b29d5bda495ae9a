//! What compression does to light: bounds that hold, energy that adds up, and bytes that repeat.

use crate::assert_close;
use glam::DVec3;
use proptest::prelude::*;
use squall_bake::asset::asset_of;
use squall_bake::asset::grid_section;
use squall_bake::compress::compress_row;
use squall_bake::pipeline;
use squall_bake::progress::Quiet;
use squall_bake::recipe::Recipe;
use squall_bake::response::{BakedResponse, Job, ResponseSettings, Sources, WantedLights, bake_response};
use squall_formats::GridShape;
use squall_formats::container::write;
use squall_formats::haar::Haar;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::bolt::StrokeRecord;
use squall_formats::section::response::{
    self, Codec, DirectTerm, DirectionalBasis, DistantKind, RowCode, Stored, accumulate,
};
use squall_runtime::Asset;
use squall_runtime::random::Random;
use squall_runtime::relight::{PointLight, RelightBuffers, RelightOptions, Relighter};
use squall_runtime::stroke::Stroke;
use squall_runtime::transport::lanes::SimdLevel;
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::SolveSettings;
use squall_runtime::transport::{Boundary, Cloud};

/// Single precision: sums of some hundred coefficients and an inverse transform of 9 levels, relative to the light's norm.
const ROUND_OFF: f64 = 2e-6;

/// A small ragged cloud whose sides are no powers of two.
fn cloud() -> Cloud {
    let shape = GridShape::new(9, 7, 5);
    let mut random = Random::new(5);
    let extinction = (0..shape.len())
        .map(|_| if random.unit() < 0.2 { 0.0 } else { (0.01 * libm::exp(random.normal())) as f32 })
        .collect();
    let (cell_m, origin_m) = ([50.0, 40.0, 30.0], DVec3::new(-200.0, -100.0, 500.0));
    Cloud { shape, cell_m, origin_m, extinction, albedo: 0.999, g: 0.85, boundary: Boundary::Open }
}

const LOW: DVec3 = DVec3::new(-200.0, -100.0, 400.0);
const HIGH: DVec3 = DVec3::new(250.0, 180.0, 650.0);

fn sources() -> Sources {
    let grid = LightGrid {
        x_m: vec![LOW.x, 0.0, HIGH.x],
        y_m: vec![LOW.y, 30.0, HIGH.y],
        z_m: vec![LOW.z, 520.0, HIGH.z],
    };
    let lights = WantedLights { grid, wanted: Vec::new() };
    Sources { lights, distant: vec![DistantKind::UpperSky], sun: None }
}

/// Strokes of one to twenty lights anywhere in the bounds, some of them beyond all measure brighter than others.
fn strokes() -> Vec<Vec<PointLight>> {
    let mut random = Random::new(17);
    let stroke = |number: usize| {
        let light = |_| {
            let place = |axis: usize, random: &mut Random| random.range(LOW[axis], HIGH[axis]);
            let position = DVec3::new(place(0, &mut random), place(1, &mut random), place(2, &mut random));
            PointLight { position, intensity: libm::exp(3.0 * random.normal()) }
        };
        (0..1 + 3 * number).map(light).collect()
    };
    (0..7).map(stroke).collect()
}

#[derive(Clone, Copy, Debug)]
struct Case {
    codec: Codec,
    basis: DirectionalBasis,
    direct: DirectTerm,
    error: f64,
}

const HARMONICS: DirectionalBasis = DirectionalBasis::Harmonics { degree: 1 };

fn settings(case: Case) -> ResponseSettings {
    let quadrature = Quadrature::DoubleGauss { polar: 2, azimuths: 8 };
    ResponseSettings {
        basis: case.basis,
        direct: case.direct,
        codec: case.codec,
        finer: 0,
        spacing_m: 0.0,
        relative_error: case.error,
        seen_only: false,
        view_region: None,
        refine: 1,
        stored: Stored::Means,
        error_for: Default::default(),
        samples: 1,
        solve: SolveSettings { quadrature, tolerance: 1e-2, ..SolveSettings::default() },
    }
}

/// An asset with the cloud and its response, and the strokes' light before compression.
struct Baked {
    asset: Asset,
    response: BakedResponse,
}

fn bake(case: Case) -> Baked {
    let (cloud, strokes) = (cloud(), strokes());
    let (sources, settings) = (sources(), settings(case));
    let job = Job {
        cloud: &cloud,
        sources: &sources,
        settings: &settings,
        held_out: &strokes,
        known: None,
        shown: None,
        cache: None,
    };
    let mut response = bake_response(&job, &Quiet).unwrap();
    let grid = grid_section(&cloud);
    let rows = response::write(&response.head, std::mem::take(&mut response.rows));
    let mut bytes = Vec::new();
    write(&mut bytes, &[grid, rows]).unwrap();
    Baked { asset: Asset::from_bytes(&bytes).unwrap(), response }
}

fn norm(values: impl Iterator<Item = f64>) -> f64 {
    libm::sqrt(values.map(|v| v * v).sum::<f64>())
}

fn cases() -> [Case; 4] {
    let case = |codec, basis, direct, error| Case { codec, basis, direct, error };
    [
        case(Codec::Bytes, HARMONICS, DirectTerm::AtRunTime, 0.02),
        case(Codec::Bytes, DirectionalBasis::Directions26, DirectTerm::InRows, 0.3),
        case(Codec::Paper, DirectionalBasis::Directions26, DirectTerm::AtRunTime, 0.02),
        case(Codec::Paper, HARMONICS, DirectTerm::InRows, 0.3),
    ]
}

#[test]
fn light_of_any_stroke_is_off_by_no_more_than_the_stored_bounds() {
    for case in cases() {
        let Baked { asset, response } = bake(case);
        let relighter = Relighter::new(&asset).unwrap();
        let mut buffers = RelightBuffers::default();
        // How much of its bound the worst channel uses up: bounds that no stroke comes near would say nothing.
        let mut used = 0.0f64;
        for test in &response.held_out {
            relighter.relight(&test.lights, RelightOptions::default(), &mut buffers).unwrap();
            let bounds = relighter.error_bounds(&buffers);
            let relit = relighter.relight(&test.lights, RelightOptions::default(), &mut buffers).unwrap();
            assert_eq!(bounds.len(), relit.basis.count());
            let planes =
                relit.planes.chunks_exact(relit.cells).zip(test.uncompressed.chunks_exact(relit.cells));
            for ((shown, wanted), bound) in planes.zip(bounds) {
                let error = norm(shown.iter().zip(wanted).map(|(a, b)| f64::from(a - b)));
                let slack = ROUND_OFF * norm(wanted.iter().map(|&v| f64::from(v)));
                assert!(error <= bound + slack, "{case:?}: {error} above {bound}");
                used = used.max(error / bound);
            }
        }
        assert!((0.1..1.0 + 1e-3).contains(&used), "{case:?}: {used} of the bound");
    }
}

#[test]
fn without_a_threshold_nothing_is_lost() {
    for (codec, basis) in [(Codec::Paper, HARMONICS), (Codec::Bytes, DirectionalBasis::Directions26)] {
        let case = Case { codec, basis, direct: DirectTerm::InRows, error: 0.0 };
        let Baked { asset, response } = bake(case);
        let relighter = Relighter::new(&asset).unwrap();
        assert!(relighter.response().bounds.iter().all(|bound| bound.total() == 0.0), "{codec:?}");
        let mut buffers = RelightBuffers::default();
        for test in &response.held_out {
            let relit = relighter.relight(&test.lights, RelightOptions::default(), &mut buffers).unwrap();
            let error = norm(relit.planes.iter().zip(&test.uncompressed).map(|(a, b)| f64::from(a - b)));
            assert!(error <= ROUND_OFF * norm(test.uncompressed.iter().map(|&v| f64::from(v))), "{codec:?}");
        }
    }
}

#[test]
fn with_all_light_as_the_budget_every_plane_is_left_at_its_mean() {
    for codec in [Codec::Paper, Codec::Bytes] {
        let case = Case { codec, basis: HARMONICS, direct: DirectTerm::AtRunTime, error: 1.0 };
        let Baked { asset, response } = bake(case);
        assert_eq!(response.kept, 0);
        let relighter = Relighter::new(&asset).unwrap();
        let mut buffers = RelightBuffers::default();
        for test in &response.held_out {
            let relit = relighter.relight(&test.lights, RelightOptions::default(), &mut buffers).unwrap();
            let cells = relit.cells;
            for (shown, wanted) in relit.planes.chunks_exact(cells).zip(test.uncompressed.chunks_exact(cells))
            {
                let mean = wanted.iter().map(|&v| f64::from(v)).sum::<f64>() / cells as f64;
                let size = norm(wanted.iter().map(|&v| f64::from(v))) / libm::sqrt(cells as f64);
                // A mean is a sum with cancellation; its error goes with the light's size, not its own.
                assert!(shown.iter().all(|&v| (f64::from(v) - mean).abs() <= 10.0 * ROUND_OFF * size));
            }
        }
    }
}

#[test]
fn the_papers_ambient_adds_the_bounds_of_what_was_left_out() {
    let case = Case { codec: Codec::Paper, basis: HARMONICS, direct: DirectTerm::AtRunTime, error: 0.3 };
    let Baked { asset, response } = bake(case);
    let relighter = Relighter::new(&asset).unwrap();
    let mut buffers = RelightBuffers::default();
    for test in &response.held_out {
        let plain = relighter.relight(&test.lights, RelightOptions::default(), &mut buffers).unwrap();
        let (plain, cells) = (plain.planes.to_vec(), plain.cells);
        let weights = relighter.weigh(&test.lights, &mut buffers).unwrap().to_vec();
        let options = RelightOptions { paper_ambient: true };
        let ambient = relighter.relight(&test.lights, options, &mut buffers).unwrap();
        for channel in 0..ambient.basis.count() {
            let gamma = |row: u32| f64::from(relighter.response().bounds_of(row as usize)[channel].discarded);
            let wanted: f64 = weights.iter().map(|w| f64::from(w.intensity) * gamma(w.row)).sum();
            assert!(wanted > 0.0);
            for cell in channel * cells..(channel + 1) * cells {
                let added = f64::from(ambient.planes[cell]) - f64::from(plain[cell]);
                // The sum rounds in its last place.
                let last_place = 1e-6 * f64::from(plain[cell].abs());
                assert!((added - wanted).abs() <= 1e-5 * wanted + last_place, "{added} {wanted}");
            }
        }
    }
}

#[test]
fn a_strokes_weights_sum_to_its_energy() {
    let case = Case { codec: Codec::Bytes, basis: HARMONICS, direct: DirectTerm::AtRunTime, error: 0.9 };
    let Baked { asset, .. } = bake(case);
    let relighter = Relighter::new(&asset).unwrap();
    let mut buffers = RelightBuffers::default();
    for (seed, spacing) in [(1, 5.0), (2, 60.0), (3, 1e6)] {
        let record = StrokeRecord {
            name: "test".into(),
            seed,
            from_m: [-60.0, -30.0, 560.0],
            to_m: [80.0, 60.0, 470.0],
            segment_m: 6.0,
            turn_rad: 0.28,
            wander: 0.15,
            branching: 0.15,
            branch_rad: 0.6,
            branch_length: 0.4,
            max_order: 2,
            branch_intensity: 0.4,
            intensity_w_per_sr: 3e7,
            color: [1.0; 3],
        };
        let stroke = Stroke::grow(&record);
        // Some hundred additions in double precision, then one rounding a row to single.
        assert_close(stroke.intensity(), 3e7, 1e-12, "segments");
        let lights = stroke.lights(spacing);
        assert_close(lights.iter().map(|light| light.intensity).sum(), 3e7, 1e-12, "points of light");
        let weights = relighter.weigh(&lights, &mut buffers).unwrap();
        let sum: f64 = weights.iter().map(|weight| f64::from(weight.intensity)).sum();
        assert_close(sum, 3e7, 1e-7, "virtual sources");
        assert!(weights.iter().all(|weight| weight.intensity >= 0.0));
        assert!(weights.windows(2).all(|pair| pair[0].row < pair[1].row), "each row once");
    }
}

#[test]
fn lamps_on_nodes_between_them_and_outside_split_as_they_should() {
    let case = Case { codec: Codec::Bytes, basis: HARMONICS, direct: DirectTerm::AtRunTime, error: 0.9 };
    let Baked { asset, .. } = bake(case);
    let relighter = Relighter::new(&asset).unwrap();
    let mut buffers = RelightBuffers::default();
    let mut weigh = |position: DVec3, intensity: f64| -> Option<Vec<f32>> {
        let light = PointLight { position, intensity };
        let weights = relighter.weigh(std::slice::from_ref(&light), &mut buffers).ok()?;
        Some(weights.iter().map(|weight| weight.intensity).collect())
    };
    // A node is its own source; halfway along an axis two share alike; in the middle of a box eight do.
    assert_eq!(weigh(DVec3::new(0.0, 30.0, 520.0), 2.0), Some(vec![2.0]));
    assert_eq!(weigh(HIGH, 2.0), Some(vec![2.0]));
    assert_eq!(weigh(DVec3::new(-100.0, 30.0, 520.0), 2.0), Some(vec![1.0, 1.0]));
    assert_eq!(weigh(DVec3::new(-100.0, -35.0, 460.0), 8.0), Some(vec![1.0; 8]));
    for outside in [LOW - 1e-6, HIGH + 1e-6, DVec3::splat(f64::NAN)] {
        assert_eq!(weigh(outside, 1.0), None, "{outside}");
    }
    assert_eq!(weigh(HIGH, f64::INFINITY), None);
}

proptest! {
    /// Through the transform, a channel's stored bound γ is the L2 norm of what leaving coefficients out does to its cells.
    #[test]
    fn discarded_energy_is_the_squared_error_in_the_cells_of_each_channel(
        seed: u64, error in 0.01..0.9f64, size in (1u32..12, 1u32..12, 1u32..6),
    ) {
        let shape = GridShape::new(size.0, size.1, size.2);
        let (haar, mut scratch) = (Haar::new(shape), Vec::new());
        let mut random = Random::new(seed);
        let values: Vec<f32> = (0..2 * shape.len()).map(|_| libm::exp(random.normal()) as f32).collect();
        let mut planes = values.clone();
        for plane in planes.chunks_exact_mut(shape.len()) {
            haar.forward(plane, &mut scratch);
        }
        let row = compress_row(&planes, 2, Codec::Paper, error);
        let basis = response::coefficient_planes(&row.bytes, 2).unwrap();
        for ((channel, wanted), bound) in basis.iter().zip(values.chunks_exact(shape.len())).zip(&row.bounds) {
            let mut cells = vec![0.0; shape.len()];
            accumulate(channel, &RowCode::plain(Codec::Paper), 1.0, &mut cells).unwrap();
            haar.inverse(&mut cells, &mut scratch);
            let squared: f64 = cells.iter().zip(wanted).map(|(a, b)| f64::from(a - b) * f64::from(a - b)).sum();
            let gamma = f64::from(bound.discarded) * f64::from(bound.discarded);
            let total: f64 = wanted.iter().map(|&v| f64::from(v) * f64::from(v)).sum();
            prop_assert!((squared - gamma).abs() <= 4.0 * ROUND_OFF * total, "{} {}", squared, gamma);
            prop_assert_eq!(bound.quantised, 0.0);
        }
    }
}

/// The golden recipe's bytes as baked by a pool of `threads`.
fn golden_bytes(threads: usize, level: SimdLevel) -> Vec<u8> {
    let path = crate::root().join("data/golden/v1/golden.toml");
    let mut recipe = Recipe::read(&path).unwrap();
    let clouds = recipe.clouds.as_mut().unwrap();
    clouds.response.solve.level = level;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let baked = pool.install(|| pipeline::bake(&recipe, &Quiet)).unwrap();
    let mut bytes = Vec::new();
    write(&mut bytes, &baked.sections).unwrap();
    bytes
}

#[test]
fn one_two_and_eight_threads_and_every_simd_level_bake_the_same_bytes() {
    let wanted = golden_bytes(1, SimdLevel::Baseline);
    for threads in [2, 8] {
        assert!(golden_bytes(threads, SimdLevel::Best) == wanted, "{threads} threads");
    }
    assert!(golden_bytes(1, SimdLevel::Avx2) == wanted, "AVX2");
}

#[test]
fn leaving_hidden_cells_out_changes_no_light_that_a_ray_shades_with_and_takes_fewer_bytes() {
    // All density in one corner: most of the grid is far from any.
    let mut cloud = cloud();
    for index in 0..cloud.shape.len() {
        if cloud.shape.cell(index).iter().any(|&at| at > 2) {
            cloud.extinction[index] = 0.0;
        }
    }
    let case = Case { codec: Codec::Bytes, basis: HARMONICS, direct: DirectTerm::AtRunTime, error: 0.0 };
    let strokes = strokes();
    let bake = |seen_only: bool, error: f64| {
        let settings = ResponseSettings { seen_only, relative_error: error, ..settings(case) };
        let sources = sources();
        let job = Job {
            cloud: &cloud,
            sources: &sources,
            settings: &settings,
            held_out: &strokes,
            known: None,
            shown: None,
            cache: None,
        };
        asset_of(&cloud, bake_response(&job, &Quiet).unwrap()).unwrap()
    };
    let [(all, _), (seen, _)] = [bake(false, 0.0), bake(true, 0.0)];
    let [all, seen] = [&all, &seen].map(|asset| Relighter::new(asset).unwrap());
    let (mut a, mut b) = (RelightBuffers::default(), RelightBuffers::default());
    for lights in &strokes {
        let [all, seen] = [
            all.relight(lights, RelightOptions::default(), &mut a).unwrap(),
            seen.relight(lights, RelightOptions::default(), &mut b).unwrap(),
        ];
        let size = norm(all.planes.iter().map(|&v| f64::from(v)));
        let shape = cloud.shape;
        for (plane, (x, y)) in all.planes.chunks(all.cells).zip(seen.planes.chunks(all.cells)).enumerate() {
            for cell in (0..all.cells).filter(|&cell| shape.cell(cell).iter().all(|&at| at < 4)) {
                let off = f64::from(x[cell] - y[cell]).abs();
                assert!(off <= ROUND_OFF * size, "plane {plane}, cell {cell}: {off} of {size}");
            }
        }
    }
    let [(_, all), (_, seen)] = [bake(false, 0.01), bake(true, 0.01)];
    println!("{all} bytes with all cells, {seen} with those seen");
    assert!(10 * seen < 7 * all, "{seen} of {all}");
}
