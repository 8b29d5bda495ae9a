//! Streak fits of pictures that are no streaks.

use squall_bake::error::BakeError;
use squall_bake::streak::{self, FitSettings, Grey, Method, Source};
use squall_formats::section::streak::StreakPattern;
use std::path::Path;

fn picture(width: usize, height: usize, light: impl Fn(usize, usize) -> f64) -> Grey {
    Grey { width, height, pixels: (0..width * height).map(|i| light(i % width, i / width) as f32).collect() }
}

fn fit(picture: &Grey, method: Method) -> Result<StreakPattern, BakeError> {
    streak::fit(
        &Source { file: Path::new("odd.png"), picture, notes: None },
        FitSettings { method, cosines: 3 },
    )
}

#[test]
fn pictures_that_are_no_streaks_are_fitted_with_finite_numbers_by_every_method() {
    let noise = |x: usize, y: usize| {
        (squall_runtime::random::mix((x * 977 + y) as u64) >> 40) as f64 / (1u64 << 24) as f64
    };
    let odd = [
        ("black but for one pixel", picture(12, 40, |x, y| f64::from(u8::from((x, y) == (0, 39))))),
        ("white but for one pixel", picture(12, 40, |x, y| f64::from(u8::from((x, y) != (5, 20))))),
        ("chequers", picture(12, 40, |x, y| f64::from(u8::from((x + y) % 2 == 0)))),
        ("noise", picture(12, 40, noise)),
        ("black or white noise", picture(12, 40, |x, y| noise(x, y).round())),
        ("one pixel wide and long", picture(1, 1000, |_, y| if (300..700).contains(&y) { 1.0 } else { 0.0 })),
        ("one pixel high", picture(300, 1, |x, _| if x > 100 { 1.0 } else { 0.0 })),
        ("two pixels", picture(2, 1, |x, _| x as f64)),
        ("almost dark", picture(12, 40, |x, y| if (x, y) == (6, 20) { 1.0 } else { 1e-30 })),
    ];
    println!("| picture | dB: {} |", Method::ALL.map(|method| method.name()).join(", "));
    for (name, picture) in &odd {
        let found = Method::ALL.map(|method| {
            let pattern =
                fit(picture, method).unwrap_or_else(|error| panic!("{name}, {}: {error}", method.name()));
            let drawn = streak::draw(&pattern.pattern, picture.width, picture.height);
            assert!(
                drawn.pixels.iter().all(|v| v.is_finite() && v.abs() < 16.0),
                "{name}, {}",
                method.name()
            );
            assert!(
                pattern.mean.is_finite() && pattern.psnr_db.is_finite() && pattern.ssim.is_finite(),
                "{name}, {}",
                method.name()
            );
            assert_eq!(pattern, pattern.quantised());
            format!("{:.0}", pattern.psnr_db)
        });
        println!("| {name} | {} |", found.join(", "));
    }
}

#[test]
fn a_picture_whose_light_is_not_scaled_is_refused_and_told_how() {
    for peak in [1e-30, 1e-3, 0.1, 10.0, 1e30] {
        for method in Method::ALL {
            let error =
                fit(&picture(12, 40, |x, y| if x > 3 && y > 9 { peak } else { 0.0 }), method).unwrap_err();
            assert!(error.to_string().contains("scaled to a peak of 1"), "{error}");
        }
    }
}
