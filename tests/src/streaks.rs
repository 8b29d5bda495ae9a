//! Streaks from picture to pixels: fitted by bake, stored by formats, drawn by the runtime.

use squall_bake::input::picture::{Grey, read_grey};
use squall_bake::streak::{self, FitSettings, Method, Source};
use squall_bake::synth::streak::synth_streak;
use squall_formats::section::streak::StreakPattern;
use squall_formats::section::streak::StreakSection;
use squall_runtime::shade::streak::{Kernel, Scratch, StreakSet, Tile};
use std::path::{Path, PathBuf};

/// The reference pictures, or `None` with a word where they are not at hand.
fn reference() -> Option<Vec<(PathBuf, Grey)>> {
    let folder = crate::reference("streaks")?;
    let read = |i: usize| {
        let path = folder.join(format!("s{i:02}.png"));
        let picture = read_grey(&path).unwrap();
        (path, picture)
    };
    Some((0..6).map(read).collect())
}

fn fit(pictures: &[(PathBuf, Grey)], method: Method, cosines: usize) -> Vec<StreakPattern> {
    let source =
        |(file, picture): &'_ (PathBuf, Grey)| -> (PathBuf, Grey) { (file.clone(), picture.clone()) };
    let owned: Vec<_> = pictures.iter().map(source).collect();
    let sources: Vec<Source> =
        owned.iter().map(|(file, picture)| Source { file, picture, notes: None }).collect();
    streak::fit_all(&sources, FitSettings { method, cosines }).unwrap()
}

/// A pattern's whole picture, `length` pixels long, its middle off the lattice, at `degrees` from upright.
fn kernel_of(pattern: &StreakPattern, length: f64, degrees: f64) -> Kernel {
    let aspect = f64::from(pattern.size_px[0]) / f64::from(pattern.size_px[1]);
    let (sin, cos) = libm::sincos(degrees.to_radians());
    Kernel {
        middle: [120.3, 120.6],
        direction: [sin as f32, cos as f32],
        length: (length * pattern.body.length()) as f32,
        width: (length * aspect * pattern.body.width()) as f32,
        pattern: 0,
        weight: 1.0,
    }
}

const SIDE: usize = 240;

fn draw(pattern: &StreakPattern, kernel: &Kernel) -> Vec<f32> {
    let set = StreakSet::new(&StreakSection { patterns: vec![pattern.clone()] });
    let mut alpha = vec![0.0; SIDE * SIDE];
    let mut tile = Tile { origin: [0, 0], width: SIDE, alpha: &mut alpha };
    set.add(kernel, &mut tile, &mut Scratch::default());
    alpha
}

/// The pattern's definition averaged over `count` × `count` points of every pixel.
fn supersample(pattern: &StreakPattern, kernel: &Kernel, count: usize) -> Vec<f32> {
    let [dx, dy] = kernel.direction.map(f64::from);
    let norm = libm::sqrt(dx * dx + dy * dy);
    let (along, across) = ([dx / norm, dy / norm], [dy / norm, -dx / norm]);
    let body = pattern.body;
    let value = |x: f64, y: f64| {
        let offset = [x - f64::from(kernel.middle[0]), y - f64::from(kernel.middle[1])];
        let dot = |axis: [f64; 2]| offset[0] * axis[0] + offset[1] * axis[1];
        let u = 0.5 * (body.u[0] + body.u[1]) + dot(across) * body.width() / f64::from(kernel.width);
        let v = 0.5 * (body.v[0] + body.v[1]) + dot(along) * body.length() / f64::from(kernel.length);
        if (-0.3..1.3).contains(&u) && (-0.3..1.3).contains(&v) { pattern.pattern.value(u, v) } else { 0.0 }
    };
    let pixel = |i: usize| {
        let mut sum = 0.0;
        for s in 0..count * count {
            let x = (i % SIDE) as f64 + ((s % count) as f64 + 0.5) / count as f64;
            let y = (i / SIDE) as f64 + ((s / count) as f64 + 0.5) / count as f64;
            sum += value(x, y);
        }
        (sum / (count * count) as f64) as f32
    };
    (0..SIDE * SIDE).map(pixel).collect()
}

/// dB over the area of the kernel's picture, and relative error of the sum.
fn compare(pattern: &StreakPattern, kernel: &Kernel, drawn: &[f32], truth: &[f32]) -> (f64, f64) {
    let area = f64::from(kernel.length * kernel.width) / (pattern.body.length() * pattern.body.width());
    let squares: f64 = drawn
        .iter()
        .zip(truth)
        .map(|(a, b)| {
            let d = f64::from(a - b);
            d * d
        })
        .sum();
    let sum = |values: &[f32]| values.iter().map(|&value| f64::from(value)).sum::<f64>();
    (-10.0 * libm::log10(squares / area), sum(drawn) / sum(truth) - 1.0)
}

/// Seed of the sample's pictures, and the shortest of them.
const SAMPLE_SEED: u64 = 2;
const SHORTEST: usize = 10;

#[test]
fn the_committed_streaks_are_what_their_command_makes() {
    let stored = read_grey(&crate::root().join(format!("data/storm/streaks/drop{SHORTEST:02}.png"))).unwrap();
    let made = synth_streak(SAMPLE_SEED, SHORTEST).picture;
    let sample = |light: &f32| (light * 65_535.0).round() as u16;
    assert_eq!([stored.width, stored.height], [made.width, made.height]);
    let differ = stored.pixels.iter().zip(&made.pixels).filter(|(a, b)| sample(a) != sample(b)).count();
    assert_eq!(differ, 0);
}
