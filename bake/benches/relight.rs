//! `cargo bench -p squall-bake --bench relight [-- ASSET]`: what relighting a stroke costs, beside how right it is and how
//! many bytes it has to read. Without an asset `data/recipes/paper.toml` is baked first, which takes a minute or two.
//!
//! One thread. The floor is the rows' bytes over the bandwidth of reading memory, measured in the same run.

use squall_bake::evaluate::cost;
use squall_bake::evaluate::held_out::grown_strokes;
use squall_bake::pipeline;
use squall_bake::progress::Quiet;
use squall_bake::recipe::Recipe;
use squall_formats::container;
use squall_formats::section::provenance::ProvenanceSection;
use squall_runtime::Asset;
use squall_runtime::relight::{PointLight, RelightBuffers, RelightOptions, Relighter};
use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

/// Virtual lights that the measured stroke touches, about.
const SOURCES: usize = 100;
const ROUNDS: usize = 41;

/// 10th percentile, median and 90th percentile of a call's milliseconds.
fn milliseconds(mut call: impl FnMut()) -> [f64; 3] {
    let mut times: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let start = Instant::now();
            call();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_unstable_by(f64::total_cmp);
    [ROUNDS / 10, ROUNDS / 2, ROUNDS - 1 - ROUNDS / 10].map(|at| times[at])
}

fn line(what: &str, [low, median, high]: [f64; 3]) {
    println!("{what:<46} {median:>8.3} ms   ({low:.3} to {high:.3})");
}

fn main() {
    let mut folder = None;
    let given = std::env::args().skip(1).find(|argument| !argument.starts_with("--"));
    let path = given.map(PathBuf::from).unwrap_or_else(|| {
        let recipe = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../data/recipes/paper.toml");
        let baked = pipeline::bake(&Recipe::read(&recipe).unwrap(), &Quiet).unwrap();
        let kept = folder.insert(tempfile::tempdir().unwrap());
        let path = kept.path().join("paper.squall");
        container::write(&mut std::fs::File::create(&path).unwrap(), &baked.sections).unwrap();
        path
    });
    line("Asset::open", milliseconds(|| drop(black_box(Asset::open(&path).unwrap()))));
    let asset = Asset::open(&path).unwrap();
    line("Relighter::new", milliseconds(|| drop(black_box(Relighter::new(&asset).unwrap()))));
    let relighter = Relighter::new(&asset).unwrap();

    // The stroke whose points touch a hundred virtual lights, as nearly as random strokes give it.
    let cloud = relighter.cloud();
    let strokes = grown_strokes(cloud, relighter.bounds(), |point| relighter.reaches(point), 40.0, 0..64);
    let mut buffers = RelightBuffers::default();
    let mut touched = |lights: &[PointLight]| relighter.weigh(lights, &mut buffers).unwrap().len();
    let stroke = strokes.iter().min_by_key(|lights| touched(lights).abs_diff(SOURCES)).unwrap();

    let mut buffers = RelightBuffers::default();
    let start = Instant::now();
    relighter.relight(stroke, RelightOptions::default(), &mut buffers).unwrap();
    let first = start.elapsed().as_secs_f64() * 1e3;
    let weights = relighter.weigh(stroke, &mut buffers).unwrap().to_vec();
    let rows = weights.iter().map(|w| relighter.response().row_unchecked(w.row as usize).unwrap());
    let bytes: usize = rows.map(<[u8]>::len).sum();
    println!(
        "stroke of {} points on {} of {} virtual lights, {:.2} MB of rows",
        stroke.len(),
        weights.len(),
        relighter.response().row_count(),
        bytes as f64 / 1e6
    );
    println!("{:<46} {first:>8.3} ms", "first relight, checksums included");
    let warm = milliseconds(|| {
        black_box(relighter.relight(stroke, RelightOptions::default(), &mut buffers).unwrap());
    });
    line("relight", warm);
    let counted = cost::stroke_ms(&relighter, stroke, &mut buffers).unwrap();
    println!("{:<46} {counted:>8.3} ms", "relight, as budgets count it");

    let memory = vec![1u64; 8 << 20];
    let [_, read, _] = milliseconds(|| {
        black_box(memory.iter().fold(0u64, |sum, &value| sum.wrapping_add(value)));
    });
    let bandwidth = (memory.len() * 8) as f64 / read / 1e6;
    let floor = bytes as f64 / bandwidth / 1e6;
    println!(
        "floor: rows at {bandwidth:.1} GB/s {floor:>28.3} ms; relight is {:.1} times that",
        warm[1] / floor
    );
    let Ok(made) = asset.section(ProvenanceSection::TAG, "provenance", ProvenanceSection::read) else {
        return;
    };
    for budget in made.budgets.iter().filter(|budget| budget.part == "response codec") {
        println!("error: {}: {:.2} %", budget.metric, 100.0 * budget.got);
    }
    let relit = relighter.relight(stroke, RelightOptions::default(), &mut buffers).unwrap();
    let norm: f64 = relit.planes.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>().sqrt();
    let bound = relighter.error_bounds(&buffers).iter().map(|b| b * b).sum::<f64>().sqrt();
    println!("error bound of this stroke, over its norm: {:.2} %", 100.0 * bound / norm);
}
