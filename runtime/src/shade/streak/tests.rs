use super::*;
use proptest::prelude::*;
use squall_formats::section::streak::{
    Body, Cosine, CosinePattern, EdgeWindow, Method, Pattern, PowerWindow, SeparablePattern, StreakPattern,
    Window,
};

const SIDE: usize = 160;
/// Linear tables over angle, softness and place; a streak's light may be off by this at any width.
const ENERGY: f64 = 1e-2;

fn terms() -> Vec<Cosine> {
    let term = |across, along, amplitude, phase| Cosine { across, along, amplitude, phase };
    vec![term(2.1, -1.5, 0.13, 1.2), term(0.4, 2.9, 0.2, 4.0), term(4.0, 0.1, 0.1, 0.3)]
}

fn edge_window() -> Window {
    Window::Edges(EdgeWindow {
        sides: [[0.3, 0.02, -0.01, 0.015], [0.7, -0.02, 0.01, 0.0]],
        ends: [[0.08, 0.01, 0.02], [0.94, 0.0, -0.03]],
        softness: [0.04, 0.06, 0.03, 0.02],
    })
}

fn streak(pattern: Pattern) -> StreakPattern {
    let body = Body { u: [0.25, 0.75], v: [0.05, 0.97] };
    const CELLS: usize = 400;
    let place = |i: usize| (i as f64 + 0.5) * 1.4 / CELLS as f64 - 0.2;
    let sum: f64 = (0..CELLS * CELLS).map(|i| pattern.value(place(i % CELLS), place(i / CELLS))).sum();
    let integral = sum * 1.4 * 1.4 / (CELLS * CELLS) as f64;
    StreakPattern {
        name: "test".into(),
        method: Method::Edges,
        size_px: [32, 300],
        body,
        mean: integral / (body.width() * body.length()),
        psnr_db: 0.0,
        ssim: 0.0,
        notes: None,
        scene: None,
        pattern,
    }
}

/// One pattern of every kind.
pub(crate) fn every_kind() -> StreakSection {
    let cosines = |window| Pattern::Cosines(CosinePattern { window, constant: 0.6, terms: terms() });
    let power = |exponent| PowerWindow { centre: [0.5, 0.52], radius: [0.2, 0.4], exponent };
    let table = |count: usize, bump: f64| -> Vec<f64> {
        (0..count)
            .map(|i| {
                let x = (i as f64 + 0.5) / count as f64 - 0.5;
                libm::exp(-x * x * 30.0) * (1.0 + bump * x)
            })
            .collect()
    };
    let separable = SeparablePattern {
        across: vec![table(32, 0.3), table(32, -2.0)],
        along: vec![table(64, 1.0), table(64, 3.0)],
    };
    StreakSection {
        patterns: vec![
            streak(cosines(edge_window())),
            streak(cosines(Window::Power(power([2.0; 2])))),
            streak(cosines(Window::Power(power([6.0, 14.0])))),
            streak(cosines(Window::Flat)),
            streak(Pattern::Separable(separable)),
        ],
    }
}

/// A pattern whose light is one fine line along its middle, as that of a drop before the sun is.
pub(crate) fn fine_line() -> StreakSection {
    // A twentieth of the body's width.
    let across = (0..32).map(|i| libm::exp(-((i as f64 - 15.5) / 0.8) * ((i as f64 - 15.5) / 0.8))).collect();
    let along = (0..64).map(|i| if (4..61).contains(&i) { 1.0 } else { 0.0 }).collect();
    let pattern = Pattern::Separable(SeparablePattern { across: vec![across], along: vec![along] });
    StreakSection { patterns: vec![streak(pattern)] }
}

fn kernel(pattern: u32, length: f32, width: f32, degrees: f32, shift: f32) -> StreakPlacement {
    let (sin, cos) = libm::sincosf(degrees.to_radians());
    let middle = [80.0 + shift, 79.6 + 0.7 * shift];
    StreakPlacement { middle, direction: [sin, cos], length, width, pattern, weight: 1.0 }
}

fn draw_all(set: &StreakSet, kernel: &StreakPlacement) -> Vec<f32> {
    let mut alpha = vec![0.0; SIDE * SIDE];
    set.add(kernel, &mut Tile { origin: [0, 0], width: SIDE, alpha: &mut alpha }, &mut Scratch::default());
    alpha
}

fn sum(values: &[f32]) -> f64 {
    values.iter().map(|&value| f64::from(value)).sum()
}

#[test]
fn a_streak_of_any_width_and_angle_holds_its_light() {
    let set = StreakSet::new(&every_kind());
    // What a flat window cuts off hard rings in a lattice sum along the streak, where one pixel is much.
    let allowed = [ENERGY, ENERGY, ENERGY, 4.0 * ENERGY, ENERGY];
    for pattern in 0..set.len() as u32 {
        for width in [0.03, 0.3, 0.9, 2.0, 3.9, 4.1, 9.0] {
            for degrees in [0.0, 7.0, 45.0, 90.0, 200.0] {
                for shift in [0.0, 0.3, 0.5] {
                    let drawn = sum(&draw_all(&set, &kernel(pattern, 60.0, width, degrees, shift)));
                    let wanted = 60.0 * f64::from(width) * f64::from(set.mean(pattern));
                    let miss = drawn / wanted - 1.0;
                    assert!(
                        miss.abs() < allowed[pattern as usize],
                        "pattern {pattern}, width {width}, {degrees}°, shift {shift}: {miss}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_short_streak_holds_its_light_too() {
    let set = StreakSet::new(&every_kind());
    for (length, width) in [(0.2, 0.2), (2.0, 0.5), (5.0, 6.0), (11.0, 3.0)] {
        let drawn = sum(&draw_all(&set, &kernel(0, length, width, 30.0, 0.2)));
        let wanted = f64::from(length * width * set.mean(0));
        assert!((drawn / wanted - 1.0).abs() < 4.0 * ENERGY, "{length} × {width}: {drawn} for {wanted}");
    }
}

/// Mean of the definition over a pixel, by `count` × `count` points.
fn truth(streak: &StreakPattern, kernel: &StreakPlacement, count: usize) -> Vec<f32> {
    let [dx, dy] = kernel.direction.map(f64::from);
    let (body, points) = (streak.body, (count * count) as f64);
    let value = |x: f64, y: f64| {
        let offset = [x - f64::from(kernel.middle[0]), y - f64::from(kernel.middle[1])];
        let across = offset[0] * dy - offset[1] * dx;
        let along = offset[0] * dx + offset[1] * dy;
        let u = 0.5 * (body.u[0] + body.u[1]) + across * body.width() / f64::from(kernel.width);
        let v = 0.5 * (body.v[0] + body.v[1]) + along * body.length() / f64::from(kernel.length);
        streak.pattern.value(u, v)
    };
    let place = |index: usize, step: usize| index as f64 + (step as f64 + 0.5) / count as f64;
    let pixel = |i: usize| {
        let total: f64 =
            (0..count * count).map(|s| value(place(i % SIDE, s % count), place(i / SIDE, s / count))).sum();
        (total / points) as f32
    };
    (0..SIDE * SIDE).map(pixel).collect()
}

#[test]
fn drawing_agrees_with_supersampling_at_every_size_and_angle() {
    /// Root mean square over the picture's area, as a share of the brightest light 1: 42 dB. Most is what three
    /// products leave of a streak 2.5 pixels wide, and tables' steps at its ends.
    const ROOT_MEAN_SQUARE: f64 = 8e-3;
    let section = every_kind();
    let set = StreakSet::new(&section);
    for (index, streak) in section.patterns.iter().enumerate() {
        // A hard end that is not a lattice line is a staircase to both.
        if streak.pattern == section.patterns[3].pattern {
            continue;
        }
        for (length, width) in [(30.0, 0.7), (60.0, 2.5), (90.0, 5.0), (120.0, 12.0)] {
            for degrees in [0.0, 20.0, 130.0] {
                let kernel = kernel(index as u32, length, width, degrees, 0.37);
                let (drawn, wanted) = (draw_all(&set, &kernel), truth(streak, &kernel, 8));
                let squares: f64 =
                    drawn.iter().zip(&wanted).map(|(a, b)| f64::from(a - b) * f64::from(a - b)).sum();
                let area = f64::from(length * width) / (streak.body.width() * streak.body.length());
                let error = libm::sqrt(squares / area);
                assert!(error < ROOT_MEAN_SQUARE, "pattern {index}, {length} × {width}, {degrees}°: {error}");
            }
        }
    }
}

#[test]
fn a_quarter_turn_of_the_streak_is_a_quarter_turn_of_its_picture() {
    /// Lines of pixels begin at the other side, so that what is linear over a few pixels is so over others.
    const LINES: f32 = 3e-3;
    let set = StreakSet::new(&every_kind());
    for (length, width) in [(50.0, 1.0), (60.0, 8.0)] {
        let upright = StreakPlacement {
            middle: [80.3, 70.2],
            direction: [0.1, 1.0],
            length,
            width,
            pattern: 0,
            weight: 1.0,
        };
        // (x, y) → (y, side − x).
        let turned =
            StreakPlacement { middle: [70.2, SIDE as f32 - 80.3], direction: [1.0, -0.1], ..upright };
        let (a, b) = (draw_all(&set, &upright), draw_all(&set, &turned));
        for y in 0..SIDE {
            for x in 0..SIDE {
                let (here, there) = (a[y * SIDE + x], b[(SIDE - 1 - x) * SIDE + y]);
                assert!((here - there).abs() < LINES, "{x}, {y}: {here} {there}");
            }
        }
    }
}

#[test]
fn tiles_add_up_to_the_frame_and_bounds_hold_every_touched_pixel() {
    /// Phases are turned along different numbers of lines.
    const ROUND_OFF: f32 = 2e-5;
    let set = StreakSet::new(&every_kind());
    let mut scratch = Scratch::default();
    for (pattern, width, degrees) in [(0, 1.5, 20.0), (0, 7.0, -35.0), (2, 6.0, 80.0), (4, 5.0, 10.0)] {
        let kernel = kernel(pattern, 70.0, width, degrees, 0.4);
        let whole = draw_all(&set, &kernel);
        let mut tiled = vec![0.0; SIDE * SIDE];
        let (wide, high) = (48, 32);
        for top in (0..SIDE).step_by(high) {
            for left in (0..SIDE).step_by(wide) {
                let (w, h) = (wide.min(SIDE - left), high.min(SIDE - top));
                let mut alpha = vec![0.0; w * h];
                let origin = [left as i32, top as i32];
                set.add(&kernel, &mut Tile { origin, width: w, alpha: &mut alpha }, &mut scratch);
                for (i, value) in alpha.iter().enumerate() {
                    tiled[(top + i / w) * SIDE + left + i % w] = *value;
                }
            }
        }
        let [left, top, right, bottom] = set.bounds(&kernel).unwrap();
        for (i, (a, b)) in whole.iter().zip(&tiled).enumerate() {
            assert!((a - b).abs() < ROUND_OFF, "pixel {i}: {a} {b}");
            let (x, y) = ((i % SIDE) as i32, (i / SIDE) as i32);
            let inside = (left..right).contains(&x) && (top..bottom).contains(&y);
            assert!(inside || *a == 0.0, "pixel {x}, {y} outside the bounds");
        }
    }
}

#[test]
fn what_cannot_be_drawn_draws_nothing() {
    let set = StreakSet::new(&every_kind());
    let good = kernel(0, 40.0, 2.0, 0.0, 0.0);
    let bad = [
        StreakPlacement { pattern: 9, ..good },
        StreakPlacement { length: 0.0, ..good },
        StreakPlacement { width: f32::NAN, ..good },
        StreakPlacement { width: f32::INFINITY, ..good },
        StreakPlacement { direction: [0.0; 2], ..good },
        StreakPlacement { direction: [f32::INFINITY, 1.0], ..good },
        StreakPlacement { middle: [f32::NAN, 0.0], ..good },
        StreakPlacement { weight: f32::INFINITY, ..good },
    ];
    for kernel in bad {
        assert!(set.bounds(&kernel).is_none());
        assert!(draw_all(&set, &kernel).iter().all(|&value| value == 0.0));
    }
    assert!(
        draw_all(&set, &StreakPlacement { middle: [-1e6, 3.0], ..good }).iter().all(|&value| value == 0.0)
    );
    assert_eq!(set.mean(9), 0.0);
    let empty = StreakSet::new(&StreakSection::default());
    assert!(empty.is_empty() && empty.bounds(&good).is_none());
}

proptest! {
    #[test]
    fn no_kernel_panics_or_writes_what_is_not_a_number(
        middle in prop::array::uniform2(-1e3f32..1e3),
        direction in prop::array::uniform2(-1f32..1.0),
        length in 1e-3f32..3e3,
        width in 1e-3f32..3e3,
        pattern in 0u32..6,
    ) {
        thread_local! {
            static SET: StreakSet = StreakSet::new(&every_kind());
        }
        let kernel = StreakPlacement { middle, direction, length, width, pattern, weight: 1.0 };
        let drawn = SET.with(|set| draw_all(set, &kernel));
        prop_assert!(drawn.iter().all(|value| value.is_finite()));
    }
}
