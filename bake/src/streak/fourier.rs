//! The paper's way: threshold the discrete Fourier transform, then multiply a Gaussian. \[weber\] §3.1.
//!
//! Kept as it was published, wrap and ringing included, because charts compare with it. A kept pair of
//! conjugate coefficients F at frequency (f, g), sums over pixel centres, is one cosine of amplitude
//! 2|F|/pixels; a frequency that is its own conjugate (Nyquist) has half of that.

use super::Grey;
use super::search::transform_plane;
use rustfft::num_complex::Complex;
use squall_formats::section::streak::{Cosine, CosinePattern, PowerWindow, Window};
use std::cmp::Ordering;
use std::f64::consts::TAU;

/// Standard deviations tried for the paper's window, as shares of the side: it must fall off at all, so the
/// widest leaves e^−½ at the border.
const WINDOW_STEPS: usize = 36;
const WIDEST: f64 = 0.5;

/// The constant and the `count` strongest pairs; fewer where the picture has fewer. No window.
pub fn strongest(picture: &Grey, count: usize) -> CosinePattern {
    let (width, height) = (picture.width, picture.height);
    let pixels = (width * height) as f64;
    let mut plane: Vec<Complex<f64>> =
        picture.pixels.iter().map(|&light| Complex::from(f64::from(light))).collect();
    transform_plane(&mut plane, [width, height]);
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let mirror = ((width - x) % width, (height - y) % height);
            if (x, y) != (0, 0) && (y, x) <= (mirror.1, mirror.0) {
                let single = if mirror == (x, y) { 0.5 } else { 1.0 };
                pairs.push((single * plane[y * width + x].norm(), x, y));
            }
        }
    }
    pairs.sort_by(|a, b| b.0.partial_cmp(&a.0).unwrap_or(Ordering::Equal).then((a.2, a.1).cmp(&(b.2, b.1))));
    pairs.truncate(count);
    let signed = |bin: usize, side: usize| if bin > side / 2 { bin as f64 - side as f64 } else { bin as f64 };
    let terms = pairs.iter().map(|&(strength, x, y)| {
        let (across, along) = (signed(x, width), signed(y, height));
        let value = plane[y * width + x];
        // Sample i stands at (i + ½)/width, so the transform's origin is half a pixel inside the corner.
        let to_corner = -0.5 * TAU * (across / width as f64 + along / height as f64);
        let phase = libm::atan2(value.im, value.re) + to_corner;
        Cosine { across, along, amplitude: 2.0 * strength / pixels, phase }.normalised()
    });
    CosinePattern { window: Window::Flat, constant: plane[0].re / pixels, terms: terms.collect() }
}

/// [`strongest`] with the Gaussian multiplied on afterwards. The paper gives no width: of widths up to half
/// a side, each axis gets the one that costs the fit least.
pub fn strongest_windowed(picture: &Grey, count: usize) -> CosinePattern {
    let mut pattern = strongest(picture, count);
    let (width, height) = (picture.width, picture.height);
    let bare: Vec<f64> = (0..width * height)
        .map(|i| {
            pattern.value(
                (i % width) as f64 / width as f64 + 0.5 / width as f64,
                (i / width) as f64 / height as f64 + 0.5 / height as f64,
            )
        })
        .collect();
    let gaussian = |side: usize, deviation: f64| -> Vec<f64> {
        let place = |i: usize| ((i as f64 + 0.5) / side as f64 - 0.5) / deviation;
        (0..side).map(|i| libm::exp(-0.5 * place(i) * place(i))).collect()
    };
    let error = |deviations: [f64; 2]| -> f64 {
        let (across, along) = (gaussian(width, deviations[0]), gaussian(height, deviations[1]));
        let miss = |i: usize| f64::from(picture.pixels[i]) - bare[i] * across[i % width] * along[i / width];
        (0..width * height).map(|i| miss(i) * miss(i)).sum()
    };
    let mut deviations = [WIDEST; 2];
    for axis in [0, 1, 0, 1] {
        let tried = (1..=WINDOW_STEPS).map(|step| WIDEST * step as f64 / WINDOW_STEPS as f64);
        let scored = tried.map(|deviation| {
            let mut candidate = deviations;
            candidate[axis] = deviation;
            (error(candidate), deviation)
        });
        let best = scored.min_by(|a, b| a.0.partial_cmp(&b.0).unwrap_or(Ordering::Equal));
        deviations[axis] = best.map_or(WIDEST, |(_, deviation)| deviation);
    }
    pattern.window = Window::Power(PowerWindow {
        centre: [0.5; 2],
        radius: deviations.map(|deviation| deviation * std::f64::consts::SQRT_2),
        exponent: [2.0; 2],
    });
    pattern
}
