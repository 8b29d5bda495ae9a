//! Streaks from picture to pixels: fitted by bake, stored by formats, drawn by the runtime.

use squall_bake::input::picture::{Grey, read_grey};
use squall_bake::streak::{self, FitSettings, Method, Source};
use squall_formats::section::streak::StreakPattern;
use squall_formats::section::streak::StreakSection;
use squall_runtime::shade::streak::{Kernel, Scratch, StreakSet, Tile};
use std::path::PathBuf;

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

#[test]
fn probe() {
    let Some(pictures) = reference() else { return };
    for method in [Method::Edges, Method::Super] {
        let patterns = fit(&pictures, method, 6);
        for length in [30.0, 60.0, 100.0, 200.0] {
            let (mut point, mut ours, mut energy, mut pe) = (0.0, 0.0, 0.0f64, 0.0f64);
            let mut each = vec![];
            let mut n = 0.0;
            for pattern in &patterns {
                for degrees in [0.0, 13.0, 45.0, 100.0] {
                    let kernel = kernel_of(pattern, length, degrees);
                    let truth = supersample(pattern, &kernel, (1200.0 / length).clamp(8.0, 32.0) as usize);
                    let sampled = supersample(pattern, &kernel, 1);
                    let drawn = draw(pattern, &kernel);
                    let (a, b) = compare(pattern, &kernel, &drawn, &truth);
                    let (p, q) = compare(pattern, &kernel, &sampled, &truth);
                    point += p;
                    ours += a;
                    each.push(format!("{a:.1}/{:.2}%", 100.0 * b));
                    energy = energy.max(b.abs());
                    pe = pe.max(q.abs());
                    n += 1.0;
                }
            }
            eprintln!(
                "{} {length}: point {:.1} ours {:.1} energy {:.4} point {:.4} {each:?}",
                method.name(),
                point / n,
                ours / n,
                energy,
                pe
            );
        }
    }
}
#[test]
fn dbg() {
    let Some(pictures) = reference() else { return };
    let mut p = fit(&pictures[..1], Method::Edges, 6).remove(0);
    let show = |p: &StreakPattern, tag: &str| {
        let kernel = kernel_of(p, 200.0, 0.0);
        let truth = supersample(p, &kernel, 8);
        let drawn = draw(p, &kernel);
        eprintln!("{tag} {:?}", compare(p, &kernel, &drawn, &truth));
        for y in [40usize, 60, 120, 180] {
            let row = |v: &[f32]| {
                v[y * SIDE + 100..y * SIDE + 142]
                    .iter()
                    .step_by(3)
                    .map(|x| format!("{x:.2}"))
                    .collect::<Vec<_>>()
                    .join(" ")
            };
            eprintln!("{y}: {}\n     {}", row(&truth), row(&drawn));
        }
    };
    show(&p, "all");
    if let squall_formats::section::streak::Pattern::Cosines(c) = &mut p.pattern {
        eprintln!("{c:?}");
        c.terms.clear();
        c.constant = 1.0;
    }
    show(&p, "window");
}
