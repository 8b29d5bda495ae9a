//! What opening an asset takes: no more than 64 MiB and 64 bytes for each of its own, nor more than a second a megabyte,
//! whatever its numbers ask for.

use peak_alloc::PeakAlloc;
use squall_formats::GridShape;
use squall_formats::basis::DirectionalBasis;
use squall_formats::container::{OutSection, write};
use squall_formats::light_grid::LightGrid;
use squall_formats::section::bolt::{BoltSection, StrokeRecord};
use squall_formats::section::cloud::{CloudHead, CloudSection};
use squall_formats::section::provenance::{InputRecord, ProvenanceSection};
use squall_formats::section::response::{
    self, Codec, DirectTerm, NO_ROW, ResponseHead, ResponseRows, SolverRecord, SourceBasis, SweepScheme,
};
use squall_formats::section::streak::{
    Body, Cosine, CosinePattern, EdgeWindow, Method, Pattern, SeparablePattern, StreakPattern, StreakSection,
    Window,
};
use squall_formats::section::town::{Block, HeightMap, Road, StreetLamp, TownSection, Windows};
use squall_formats::section::view::{ViewFlash, ViewSection};
use squall_runtime::verify::verify;
use squall_runtime::{Asset, Frame, StormRenderer};
use std::sync::{Mutex, MutexGuard};
use std::time::Instant;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Memory is measured for the whole process, so tests take turns.
fn alone() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(|broken| broken.into_inner())
}

/// Seconds that opening may take beside those for its bytes: a start, on a machine that does other things too.
const START_S: f64 = 1.0;

fn bytes_of(sections: &[OutSection]) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(&mut bytes, sections).unwrap();
    bytes
}

/// Fails when `work` on an asset of `given` bytes takes too much.
#[track_caller]
fn bounded<T>(what: &str, given: usize, work: impl FnOnce() -> T) -> T {
    let (before, start) = (MEMORY.current_usage(), Instant::now());
    MEMORY.reset_peak_usage();
    let out = work();
    let (taken, seconds) = (MEMORY.peak_usage().saturating_sub(before), start.elapsed().as_secs_f64());
    println!("{what}: {given} bytes: {taken} bytes of memory, {seconds:.3} s");
    assert!(taken <= (64 << 20) + 64 * given, "{what}: {taken} bytes taken for {given}");
    assert!(seconds <= START_S + given as f64 / 1e6, "{what}: {seconds} s for {given} bytes");
    out
}

/// Opens an asset for drawing, and checks all of it.
#[track_caller]
fn opens_within_bounds(what: &str, sections: &[OutSection]) {
    let bytes = bytes_of(sections);
    bounded(what, bytes.len(), || {
        let asset = Asset::from_bytes(&bytes).unwrap();
        drop(StormRenderer::new(&asset).unwrap());
    });
    bounded(&format!("{what}, verified"), bytes.len(), || {
        verify(&Asset::from_bytes(&bytes).unwrap()).unwrap();
    });
}

/// A stroke whose 145 bytes grow into as many segments as one may have.
fn wild(name: String) -> StrokeRecord {
    StrokeRecord {
        name,
        to_m: [0.0, 0.0, 4000.0],
        segment_m: 1.0,
        branching: 0.5,
        branch_length: 1.0,
        max_order: 8,
        intensity_w_per_sr: 1.0,
        ..StrokeRecord::usual()
    }
}

#[test]
fn a_thousand_strokes_of_the_most_segments_cost_nothing_until_they_flash() {
    let _turn = alone();
    let strokes = (0..1000).map(|number| wild(format!("s{number}"))).collect();
    opens_within_bounds("1000 strokes", &[BoltSection { strokes }.write()]);
}

#[test]
fn strokes_that_flash_together_beyond_the_limit_are_refused_by_picture_and_verify_alike() {
    let _turn = alone();
    let strokes: Vec<StrokeRecord> = (0..1000).map(|number| wild(format!("s{number}"))).collect();
    let flashes = strokes.iter().map(|s| ViewFlash { stroke: s.name.clone(), brightness: 1.0 }).collect();
    let view = ViewSection { flashes, ..ViewSection::default() };
    let bytes = bytes_of(&[BoltSection { strokes }.write(), view.write()]);
    let asset = Asset::from_bytes(&bytes).unwrap();
    // Growing as far as the limit is work, of 2²⁰ segments at most, and memory of as many.
    const GROWN: usize = 1 << 20;
    let refused = |what: &str, work: &dyn Fn() -> String| {
        let message = bounded(what, bytes.len() + 2 * GROWN, work);
        assert!(message.contains("section BOLT: segments of strokes that flash together"), "{message}");
        assert!(message.contains("1048576 allowed"), "{message}");
    };
    refused("1000 flashes, verified", &|| verify(&asset).unwrap_err().to_string());
    refused("1000 flashes, drawn", &|| {
        let mut renderer = StormRenderer::new(&asset).unwrap();
        renderer.render(&Frame::from(&view)).unwrap_err().to_string()
    });
}

fn pattern(number: usize, pattern: Pattern) -> StreakPattern {
    StreakPattern {
        name: format!("p{number}"),
        method: Method::Edges,
        size_px: [10, 40],
        body: Body::WHOLE,
        mean: 0.5,
        psnr_db: 30.0,
        ssim: 0.9,
        notes: None,
        scene: None,
        pattern,
    }
}

fn cosines(count: usize) -> Pattern {
    let window = Window::Edges(EdgeWindow {
        sides: [[0.2, 0.0, 0.0, 0.0], [0.8, 0.0, 0.0, 0.0]],
        ends: [[0.1, 0.0, 0.0], [0.9, 0.0, 0.0]],
        softness: [0.05; 4],
    });
    let term = Cosine { across: 1.0, along: 2.0, amplitude: 0.1, phase: 0.5 };
    Pattern::Cosines(CosinePattern { window, constant: 0.5, terms: vec![term; count] })
}

#[test]
fn the_most_streak_patterns_with_the_most_terms_open_within_bounds_and_one_more_term_is_refused() {
    let _turn = alone();
    let streaks = |patterns: Vec<StreakPattern>| {
        let section = StreakSection { patterns };
        OutSection::small(StreakSection::TAG, section.version(), false, section.write())
    };
    opens_within_bounds("4096 patterns", &[streaks((0..4096).map(|i| pattern(i, cosines(64))).collect())]);
    let products = SeparablePattern { across: vec![vec![1.0; 4]; 8], along: vec![vec![1.0; 4]; 8] };
    let products = (0..4096).map(|i| pattern(i, Pattern::Separable(products.clone()))).collect();
    opens_within_bounds("4096 products", &[streaks(products)]);
    let one_more = (0..4096).map(|i| pattern(i, cosines(if i == 7 { 65 } else { 64 }))).collect();
    let bytes = bytes_of(&[streaks(one_more)]);
    let asset = Asset::from_bytes(&bytes).unwrap();
    let message = StormRenderer::new(&asset).err().unwrap().to_string();
    assert!(message.contains("STRK") && message.contains("262145 wanted, 262144 allowed"), "{message}");
    assert_eq!(verify(&asset).unwrap_err().to_string(), message);
}

#[test]
fn a_large_grid_in_clear_air_with_many_nodes_without_rows_opens_within_bounds() {
    let _turn = alone();
    let shape = GridShape::new(128, 128, 16);
    let head =
        CloudHead { shape, cell_m: [50.0; 3], origin_m: [0.0; 3], albedo: 1.0, g: 0.85, periodic_xy: false };
    let cloud = CloudSection::write_smallest(&head, &vec![0.01; shape.len()]);
    let axis = |count: u32| (0..count).map(f64::from).collect();
    let grid = LightGrid { x_m: axis(100), y_m: axis(100), z_m: axis(100) };
    let rows = vec![NO_ROW; grid.len()];
    let head = ResponseHead {
        shape,
        sources: SourceBasis::LightGrid { grid, rows },
        distant: Vec::new(),
        basis: DirectionalBasis::Directions26,
        direct: DirectTerm::InRows,
        codec: Codec::Bytes,
        solver: SolverRecord {
            refine: [1; 3],
            directions: [2, 8],
            scheme: SweepScheme::Weighted,
            extinction_scale: 0.5,
            tolerance: 1e-3,
            worst_residual: 1e-3,
            most_sweeps: 1,
        },
        view_region: None,
        seen: None,
        sun: None,
        entropy: None,
        stored: Default::default(),
        finer: Vec::new(),
    };
    let response = response::write(&head, ResponseRows::default());
    opens_within_bounds("grid and nodes", &[cloud, response]);
}

#[test]
fn long_lists_of_every_kind_open_within_bounds() {
    let _turn = alone();
    const MANY: usize = 1 << 16;
    let windows = Windows { pitch: [0.1; 2], glass: 1.0, lit: 1.0, radiance: [1.0; 3], seed: 1 };
    let block = |i: usize| Block {
        centre: [i as f32, -(i as f32)],
        half: [500.0; 2],
        foot: 0.0,
        height: 1e4,
        yaw: 0.5,
        albedo: [0.5; 3],
        windows: Some(windows.clone()),
    };
    let far = 1e6;
    let road = Road { from: [-far; 2], to: [far; 2], half_width: far, albedo: [0.1; 3] };
    let mut town = TownSection {
        blocks: (0..MANY).map(block).collect(),
        lamps: vec![StreetLamp { position: [0.0; 3], intensity: [1.0; 3] }; MANY],
        hills: Some(HeightMap {
            origin: [-far; 2],
            cell: [0.001; 2],
            counts: [1000, 1000],
            step: 0.15,
            heights: (0..1_000_000u32).map(|i| (i * 40_503) as u16).collect(),
        }),
        ..TownSection::default()
    };
    town.ground.roads = vec![road; MANY];
    opens_within_bounds("a town", &[town.write()]);
    let strokes = vec![StrokeRecord { segment_m: 4000.0, ..wild("one".into()) }; MANY];
    let flashes = vec![ViewFlash { stroke: "one".into(), brightness: 1.0 }; MANY];
    let view = ViewSection { flashes, ..ViewSection::default() };
    opens_within_bounds("strokes and flashes", &[BoltSection { strokes }.write(), view.write()]);
    let input = InputRecord { name: String::new(), bytes: 0, hash: [0; 32] };
    let provenance = ProvenanceSection {
        tool: String::new(),
        recipe_hash: [0; 32],
        inputs: vec![input; MANY],
        budgets: Vec::new(),
    };
    opens_within_bounds("provenance", &[provenance.write()]);
}

#[test]
fn bytes_for_a_place_that_nobody_asked_for_are_refused_however_far_it_is() {
    let mut opening = squall_runtime::ranges::Opening::new("storm.squall");
    for at in [1, u64::MAX - 7, u64::MAX] {
        let error = opening.give(at, &[0; 16]).unwrap_err().to_string();
        assert!(error.contains("range"), "{at}: {error}");
    }
}
