//! Time per pixel and per streak of drawing streaks, thin and wide: `cargo bench -p squall-runtime`.

use squall_formats::section::streak::StreakSection;
use squall_formats::section::streak::{
    Body, Cosine, CosinePattern, EdgeWindow, Method, Pattern, PowerWindow, StreakPattern, Window,
};
use squall_runtime::random::Random;
use squall_runtime::shade::streak::{Scratch, StreakPlacement, StreakSet, Tile};
use std::time::Instant;

/// A tile that stays in the cache: a whole frame would measure its memory.
const FRAME: [usize; 2] = [256, 256];
const KERNELS: usize = 4000;
const ROUNDS: usize = 5;

fn pattern(terms: usize, window: Window) -> StreakPattern {
    let mut random = Random::new(3);
    let mut cosine = |_| Cosine {
        across: random.range(0.0, 5.0),
        along: random.range(-3.0, 3.0),
        amplitude: random.range(0.02, 0.5),
        phase: random.range(0.0, 6.0),
    };
    let terms = (0..terms).map(&mut cosine).collect();
    StreakPattern {
        name: "bench".into(),
        method: Method::Edges,
        size_px: [32, 300],
        body: Body { u: [0.25, 0.75], v: [0.02, 0.98] },
        mean: 0.6,
        psnr_db: 0.0,
        ssim: 0.0,
        notes: None,
        scene: None,
        pattern: Pattern::Cosines(CosinePattern { window, constant: 0.6, terms }),
    }
}

fn main() {
    let edges = EdgeWindow {
        sides: [[0.29, 0.02, -0.006, 0.02], [0.71, -0.03, 0.004, -0.02]],
        ends: [[0.06, 0.01, 0.01], [0.95, 0.01, -0.02]],
        softness: [0.04, 0.05, 0.02, 0.02],
    };
    let power = PowerWindow { centre: [0.5; 2], radius: [0.22, 0.47], exponent: [5.0, 16.0] };
    println!(
        "{:<14} {:>5} {:>7} {:>7} {:>10} {:>10} {:>9}",
        "window", "terms", "length", "width", "px/streak", "ns/streak", "ns/pixel"
    );
    for (name, window) in [("edges", Window::Edges(edges)), ("super-Gaussian", Window::Power(power))] {
        for terms in [1, 6, 12] {
            let begun = Instant::now();
            let set = StreakSet::new(&StreakSection { patterns: vec![pattern(terms, window.clone())] });
            let prepared = begun.elapsed().as_secs_f64();
            for (length, width) in [(40.0, 0.8), (80.0, 2.0), (120.0, 5.0), (200.0, 10.0)] {
                let (pixels, seconds) = measure(&set, length, width);
                println!(
                    "{name:<14} {terms:>5} {length:>7} {width:>7} {pixels:>10.0} {:>10.0} {:>9.2}",
                    1e9 * seconds,
                    1e9 * seconds / pixels
                );
            }
            println!("{name:<14} {terms:>5} prepared in {:.2} ms", 1e3 * prepared);
        }
    }
}

/// Pixels and seconds per kernel; the fastest of a few rounds.
fn measure(set: &StreakSet, length: f32, width: f32) -> (f64, f64) {
    let mut random = Random::new(1);
    let kernels: Vec<StreakPlacement> = (0..KERNELS)
        .map(|_| StreakPlacement {
            middle: [random.range(100.0, 156.0) as f32, random.range(110.0, 146.0) as f32],
            direction: [random.range(-0.2, 0.2) as f32, 1.0],
            length,
            width,
            pattern: 0,
            weight: 0.01,
        })
        .collect();
    let mut alpha = vec![0.0f32; FRAME[0] * FRAME[1]];
    let mut scratch = Scratch::default();
    let mut touched = 0;
    for kernel in &kernels[..50] {
        alpha.fill(0.0);
        set.add(kernel, &mut Tile { origin: [0, 0], width: FRAME[0], alpha: &mut alpha }, &mut scratch);
        touched += alpha.iter().filter(|&&value| value != 0.0).count();
    }
    let mut best = f64::INFINITY;
    for _ in 0..ROUNDS {
        let begun = Instant::now();
        for kernel in &kernels {
            set.add(kernel, &mut Tile { origin: [0, 0], width: FRAME[0], alpha: &mut alpha }, &mut scratch);
        }
        best = best.min(begun.elapsed().as_secs_f64());
    }
    (touched as f64 / 50.0, best / KERNELS as f64)
}
