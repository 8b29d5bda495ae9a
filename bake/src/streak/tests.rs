use super::*;
use squall_formats::section::streak::CosinePattern;
use squall_formats::section::streak::{Cosine, PowerWindow, Window};

fn fitted(picture: &Grey, method: Method, cosines: usize) -> Result<StreakPattern, BakeError> {
    fit(&Source { file: Path::new("some/streak.png"), picture, notes: None }, FitSettings { method, cosines })
}

fn picture(width: usize, height: usize, mut light: impl FnMut(f64, f64) -> f64) -> Grey {
    let place = |i: usize, side: usize| (i as f64 + 0.5) / side as f64;
    let mut pixel = |i: usize| light(place(i % width, width), place(i / width, height)) as f32;
    Grey { width, height, pixels: (0..width * height).map(&mut pixel).collect() }
}

/// A streak that some patterns can be exactly: two cosines under a super-Gaussian window.
fn known() -> Grey {
    let window = PowerWindow { centre: [0.5, 0.52], radius: [0.22, 0.4], exponent: [4.0, 8.0] };
    let terms = vec![
        Cosine { across: 1.6, along: 0.7, amplitude: 0.2, phase: 1.0 },
        Cosine { across: 0.5, along: -2.4, amplitude: 0.15, phase: 4.0 },
    ];
    let pattern = CosinePattern { window: Window::Power(window), constant: 0.6, terms };
    let mut known = picture(20, 60, |u, v| pattern.value(u, v));
    let peak = known.pixels.iter().copied().fold(0.0, f32::max);
    known.pixels.iter_mut().for_each(|light| *light /= peak);
    known
}

/// A capsule of light, the plainest streak.
fn capsule() -> Grey {
    picture(16, 64, |u, v| {
        let (x, y) = (16.0 * (u - 0.5), 64.0 * (v - 0.5));
        let beyond = (y.abs() - 20.0).max(0.0);
        (5.0 - libm::sqrt(x * x + beyond * beyond)).clamp(0.0, 1.0)
    })
}

#[test]
fn a_picture_that_is_a_pattern_is_found_again() {
    /// What rounding to an asset's steps leaves.
    const STORED_DB: f64 = 50.0;
    let streak = fitted(&known(), Method::Super, 2).unwrap();
    assert!(streak.psnr_db > STORED_DB && streak.ssim > 0.999, "{} dB, {}", streak.psnr_db, streak.ssim);
    assert_eq!((streak.name.as_str(), streak.pattern.terms(), streak.size_px), ("streak", 2, [20, 60]));
}

#[test]
fn a_transform_kept_whole_is_the_picture() {
    let small = picture(6, 10, |u, v| 0.5 + 0.3 * libm::sin(9.0 * u + 4.0 * v * v) + 0.2 * v);
    // 60 frequencies less the constant, in pairs but for three that are their own conjugates.
    let streak = fitted(&small, Method::Fourier, 31).unwrap();
    assert_eq!(streak.pattern.terms(), 31);
    assert!(streak.psnr_db > 50.0, "{}", streak.psnr_db);
}

#[test]
fn what_a_threshold_leaves_out_is_the_error() {
    /// Terms are not rounded here: only the picture's single precision is left.
    const ROUND_OFF: f64 = 1e-9;
    // Of odd sides, so that no frequency but 0 is its own conjugate and a cosine's mean square is a²/2.
    let (width, height) = (15, 63);
    let round =
        picture(width, height, |u, v| libm::exp(-9.0 * (u - 0.4) * (u - 0.4) - 20.0 * (v - 0.5) * (v - 0.5)));
    let all = fourier::strongest(&round, width * height / 2);
    for kept in [0, 3, 40] {
        let drawn = draw(&Pattern::Cosines(fourier::strongest(&round, kept)), width, height);
        let squares: f64 =
            round.pixels.iter().zip(&drawn.pixels).map(|(&a, &b)| f64::from(a - b) * f64::from(a - b)).sum();
        let left_out: f64 = all.terms[kept..].iter().map(|term| 0.5 * term.amplitude * term.amplitude).sum();
        assert!((squares / 945.0 - left_out).abs() < ROUND_OFF, "{kept}: {squares} {left_out}");
    }
}

#[test]
fn more_terms_are_no_worse() {
    /// What a rough fit of more terms may be worse by: such patterns of released assets stay as they are.
    const ROUGH_DB: f64 = 0.3;
    /// PSNR is stored in hundredths.
    const STORED_DB: f64 = 0.01;
    for method in [Method::Fourier, Method::Windowed, Method::OffGrid, Method::Super, Method::Edges] {
        let (known, mut last) = (known(), 0.0);
        let source = Source { file: Path::new("streak.png"), picture: &known, notes: None };
        let mut fitter = Fitter::new(&source, method).unwrap();
        for cosines in 0..=5 {
            let psnr = fitter.fit(cosines).unwrap().psnr_db;
            let slack = if last < 40.0 { ROUGH_DB } else { STORED_DB };
            assert!(psnr >= last - slack, "{} {cosines}: {psnr} after {last}", method.name());
            last = f64::max(last, psnr);
        }
    }
}

#[test]
fn noise_far_below_the_error_changes_little_and_more_edged_terms_fit_no_worse() {
    /// What noise of 10⁻⁴ (80 dB) may move a fit of some 60 dB by: rounding to stored numbers decides the rest.
    const SWING_DB: f64 = 6.0;
    const NOISE: f64 = 1e-4;
    const STORED_DB: f64 = 0.01;
    let window = squall_formats::section::streak::EdgeWindow {
        sides: [[0.25, 0.02, -0.03, 0.0], [0.75, -0.02, 0.03, 0.0]],
        ends: [[0.12, 0.0, 0.05], [0.9, 0.0, -0.04]],
        softness: [0.08, 0.08, 0.03, 0.03],
    };
    let terms = vec![
        Cosine { across: 1.3, along: 0.6, amplitude: 0.2, phase: 1.0 },
        Cosine { across: 0.4, along: -2.2, amplitude: 0.15, phase: 4.0 },
    ];
    let pattern = CosinePattern { window: Window::Edges(window), constant: 0.6, terms };
    let noisy = |seed: u64| {
        let mut random = squall_runtime::random::Random::from_parts(&[seed]);
        let amount = if seed == 0 { 0.0 } else { NOISE };
        picture(12, 48, |u, v| (pattern.value(u, v) + amount * random.range(-1.7, 1.7)).max(0.0))
    };
    let figures = |seed: u64| -> Vec<f64> {
        let noisy = noisy(seed);
        let source = Source { file: Path::new("streak.exr"), picture: &noisy, notes: None };
        let mut fitter = Fitter::new(&source, Method::Edges).unwrap();
        (2..=4).map(|cosines| fitter.fit(cosines).unwrap().psnr_db).collect()
    };
    let all: Vec<Vec<f64>> = (0..4).map(figures).collect();
    for figures in &all {
        assert!(figures.windows(2).all(|pair| pair[1] >= pair[0] - STORED_DB), "{all:?}");
        assert!(figures.iter().zip(&all[0]).all(|(a, b)| (a - b).abs() < SWING_DB), "{all:?}");
    }
}

#[test]
fn a_capsule_needs_no_cosine_between_edges() {
    let [edges, power] = [Method::Edges, Method::Super].map(|m| fitted(&capsule(), m, 0).unwrap());
    assert!(edges.psnr_db > 26.0 && edges.psnr_db > power.psnr_db, "{} {}", edges.psnr_db, power.psnr_db);
    // Length 50 and width 10 of 64 and 16 pixels.
    let body = edges.body;
    assert!(
        (body.length() * 64.0 - 50.0).abs() < 1.5 && (body.width() * 16.0 - 10.0).abs() < 1.5,
        "{body:?}"
    );
    let light: f64 = capsule().pixels.iter().map(|&light| f64::from(light)).sum();
    let drawn = edges.mean * body.length() * body.width() * 1024.0;
    assert!((drawn / light - 1.0).abs() < 0.02, "{drawn} for {light}");
}

#[test]
fn quality_is_that_of_the_stored_numbers() {
    let known = known();
    let streak = fitted(&known, Method::Edges, 3).unwrap();
    assert_eq!(streak, streak.quantised());
    let drawn = draw(&streak.pattern, known.width, known.height);
    assert!((quality::psnr_db(&known, &drawn) - streak.psnr_db).abs() < 0.006);
    assert!((quality::ssim(&known, &drawn) - streak.ssim).abs() < 2e-5);
    // A record without notes, the name, four edges, the constant and three terms. SPEC.md, "STRK".
    assert_eq!(streak.stored_bytes(), 19 + "streak".len() + 22 + 5 + 3 * 6);
}

#[test]
fn a_highlight_does_not_hide_the_drop_and_a_grey_border_is_no_drop() {
    let line = |u: f64| f64::from(u8::from((u - 0.5).abs() < 0.06));
    let drop = |u: f64, v: f64| f64::from(u8::from((u - 0.5).abs() < 0.25 && (v - 0.5).abs() < 0.4));
    let lit = picture(32, 100, |u, v| drop(u, v) * (0.02 + 0.98 * line(u)));
    let body = |picture: &Grey| {
        let ends = support(picture, body_floor(picture));
        Body { u: ends[0], v: ends[1] }
    };
    assert_eq!(body(&lit).u, [0.25, 0.75]);
    let grey = picture(32, 100, |u, v| 0.02 + 0.9 * drop(u, v));
    assert_eq!(body(&grey).u, [0.25, 0.75]);
    assert_eq!(body(&picture(4, 4, |_, _| 1.0)), Body::WHOLE);
}

#[test]
fn odd_pictures_are_fitted_by_every_method() {
    let bump = |x: f64| libm::exp(-30.0 * (x - 0.5) * (x - 0.5));
    let saturated = picture(12, 40, |u, v| (3.0 * bump(u) * bump(v)).min(1.0));
    let dot = picture(9, 9, |u, v| f64::from(u8::from((u - 0.5).abs() < 0.05 && (v - 0.5).abs() < 0.05)));
    let odd = [
        ("constant", picture(10, 30, |_, _| 1.0), 25.0),
        ("saturated", saturated, 25.0),
        ("one pixel", picture(1, 1, |_, _| 1.0), 25.0),
        ("one column", picture(1, 50, |_, v| bump(v)), 25.0),
        ("one row", picture(50, 1, |u, _| bump(u)), 25.0),
        ("a dot", dot, 25.0),
        // A frame of light is no streak: it is taken as it comes.
        ("inverted", picture(10, 30, |u, v| 1.0 - bump(u) * bump(v)), 10.0),
    ];
    for (name, picture, least) in &odd {
        for method in Method::ALL {
            let streak = fitted(picture, method, 3).unwrap();
            let fair = streak.psnr_db > *least || matches!(method, Method::Paper | Method::Fourier);
            assert!(fair, "{name}, {}: {} dB", method.name(), streak.psnr_db);
            let drawn = draw(&streak.pattern, picture.width, picture.height);
            assert!(drawn.pixels.iter().all(|light| light.is_finite() && light.abs() < 8.0));
            assert!(streak.body.width() > 0.0 && streak.body.length() > 0.0 && streak.mean > 0.0, "{name}");
        }
    }
}

#[test]
fn pictures_without_light_and_settings_out_of_range_are_refused() {
    let refused = |picture: &Grey, cosines: usize, words: &str| {
        for method in [Method::Edges, Method::Paper, Method::Separable] {
            let error = fitted(picture, method, cosines).unwrap_err();
            assert_eq!(error.exit_code(), 3);
            let text = error.to_string();
            assert!(text.contains(words) && text.contains("streak.png") && !text.contains('\n'), "{text}");
        }
    };
    refused(&picture(4, 9, |_, _| 0.0), 6, "some of it above 0");
    refused(&picture(4, 9, |_, _| f64::NAN), 6, "finite light");
    refused(&picture(4, 9, |_, _| -1.0), 6, "finite light");
    refused(&Grey { width: 4, height: 9, pixels: vec![1.0; 35] }, 6, "finite light");
    refused(&Grey { width: 0, height: 0, pixels: vec![] }, 6, "finite light");
    refused(&known(), 1025, "0 to 1024");
    refused(&Grey { width: 70_000, height: 1, pixels: vec![1.0; 70_000] }, 6, "sides up to 65535 px");
}

#[test]
fn patterns_do_not_depend_on_the_number_of_threads() {
    let pictures = [known(), capsule()];
    let sources: Vec<Source> =
        pictures.iter().map(|picture| Source { file: Path::new("x"), picture, notes: None }).collect();
    let fitted = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fit_all(&sources, FitSettings { method: Method::Edges, cosines: 2 }).unwrap())
    };
    let one = fitted(1);
    assert!(one == fitted(2) && one == fitted(8));
}

#[test]
fn no_light_is_fitted_beyond_a_picture_whose_borders_are_dark() {
    /// Of a pattern's light, what may stand beyond its picture: soft edges near the border. Fits that saw no further than the picture put a third of this one's there.
    const BEYOND: f64 = 0.01;
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/storm/streaks/drop02.png");
    let picture = crate::input::picture::read_grey(&file).unwrap();
    let streak = fitted(&picture, Method::Edges, 6).unwrap();
    let (mut inside, mut beyond) = (0.0, 0.0);
    // Half a picture further on every side, by the midpoint rule.
    let [columns, rows] = [192, 768];
    for row in 0..rows {
        for column in 0..columns {
            let [u, v] =
                [(column, columns), (row, rows)].map(|(at, of)| (at as f64 + 0.5) / of as f64 * 2.0 - 0.5);
            let light = streak.pattern.value(u, v).abs();
            match (0.0..1.0).contains(&u) && (0.0..1.0).contains(&v) {
                true => inside += light,
                false => beyond += light,
            }
        }
    }
    println!("{:.4} of the light stands beyond", beyond / inside);
    assert!(beyond < BEYOND * inside, "{}", beyond / inside);
}
