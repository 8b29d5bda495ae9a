//! How close a fitted picture is to its source: PSNR and SSIM of linear grey with peak 1, whole picture.

use super::Grey;
use squall_formats::section::streak::PSNR_CAP_DB;

/// Standard deviation of SSIM's Gaussian weights, pixels; the window is 11 × 11.
const SSIM_SIGMA: f64 = 1.5;
const SSIM_SIDE: usize = 11;
/// (K₁ L)² and (K₂ L)² with K₁ = 0.01, K₂ = 0.03 and L = 1.
const SSIM_C1: f64 = 1e-4;
const SSIM_C2: f64 = 9e-4;

/// Peak signal-to-noise ratio, −10 log₁₀ of the mean squared difference, dB; an exact match, or one beyond
/// what an asset stores, gives [`PSNR_CAP_DB`]. The pictures have the same size.
pub fn psnr_db(source: &Grey, fitted: &Grey) -> f64 {
    let squares = source.pixels.iter().zip(&fitted.pixels).map(|(&a, &b)| {
        let difference = f64::from(a) - f64::from(b);
        difference * difference
    });
    let mean = squares.sum::<f64>() / source.pixels.len() as f64;
    if mean > 0.0 { (-10.0 * libm::log10(mean)).min(PSNR_CAP_DB) } else { PSNR_CAP_DB }
}

/// Structural similarity [ssim]: Gaussian weights of 11 × 11 pixels with standard deviation 1.5, averaged
/// over the places where the window lies inside the picture; a side shorter than 11 pixels takes the longest
/// odd window that fits. In [−1, 1].
pub fn ssim(source: &Grey, fitted: &Grey) -> f64 {
    let kernel_x = weights(source.width);
    let kernel_y = weights(source.height);
    let local = |value: &dyn Fn(usize) -> f64| blur(source.width, source.height, &kernel_x, &kernel_y, value);
    let a = |i: usize| f64::from(source.pixels[i]);
    let b = |i: usize| f64::from(fitted.pixels[i]);
    let (mean_a, mean_b) = (local(&a), local(&b));
    let (square_a, square_b) = (local(&|i| a(i) * a(i)), local(&|i| b(i) * b(i)));
    let product = local(&|i| a(i) * b(i));
    let mut sum = 0.0;
    for i in 0..mean_a.len() {
        let (ma, mb) = (mean_a[i], mean_b[i]);
        let (va, vb) = (square_a[i] - ma * ma, square_b[i] - mb * mb);
        let covariance = product[i] - ma * mb;
        sum += (2.0 * ma * mb + SSIM_C1) * (2.0 * covariance + SSIM_C2)
            / ((ma * ma + mb * mb + SSIM_C1) * (va + vb + SSIM_C2));
    }
    sum / mean_a.len() as f64
}

fn weights(side: usize) -> Vec<f64> {
    let length = SSIM_SIDE.min(side - (side + 1) % 2);
    let middle = (length / 2) as f64;
    let raw: Vec<f64> = (0..length)
        .map(|i| {
            let x = (i as f64 - middle) / SSIM_SIGMA;
            libm::exp(-0.5 * x * x)
        })
        .collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|weight| weight / sum).collect()
}

/// Weighted means over all places where both kernels lie inside the picture.
fn blur(width: usize, height: usize, kx: &[f64], ky: &[f64], value: &dyn Fn(usize) -> f64) -> Vec<f64> {
    let out_width = width + 1 - kx.len();
    let mut rows = vec![0.0; out_width * height];
    for y in 0..height {
        let row: Vec<f64> = (0..width).map(|x| value(y * width + x)).collect();
        for x in 0..out_width {
            rows[y * out_width + x] = kx.iter().zip(&row[x..]).map(|(k, v)| k * v).sum();
        }
    }
    let out_height = height + 1 - ky.len();
    let mut out = vec![0.0; out_width * out_height];
    for y in 0..out_height {
        for (j, weight) in ky.iter().enumerate() {
            for x in 0..out_width {
                out[y * out_width + x] += weight * rows[(y + j) * out_width + x];
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_runtime::random::Random;

    fn picture(width: usize, height: usize, mut value: impl FnMut(usize, usize) -> f64) -> Grey {
        let pixels = (0..width * height).map(|i| value(i % width, i / width) as f32).collect();
        Grey { width, height, pixels }
    }

    #[test]
    fn psnr_of_known_noise_is_minus_twenty_log_of_its_deviation() {
        /// Relative scatter of the variance of 40 000 numbers is √(2/40 000) = 0.7 %, 0.03 dB; four of these.
        const FOUR_SIGMA_DB: f64 = 0.12;
        let mut random = Random::new(5);
        let flat = picture(200, 200, |_, _| 0.5);
        let noisy = picture(200, 200, |_, _| 0.5 + 0.01 * random.normal());
        assert!((psnr_db(&flat, &noisy) - 40.0).abs() < FOUR_SIGMA_DB);
        let shifted = picture(200, 200, |_, _| 0.6);
        assert!((psnr_db(&flat, &shifted) - 20.0).abs() < 1e-4);
        assert_eq!(psnr_db(&flat, &flat), PSNR_CAP_DB);
    }

    #[test]
    fn ssim_of_two_flat_pictures_is_the_luminance_term_alone() {
        let (a, b) = (picture(20, 30, |_, _| 0.5), picture(20, 30, |_, _| 0.6));
        let wanted = (2.0 * 0.5 * 0.6 + SSIM_C1) / (0.25 + 0.36 + SSIM_C1);
        assert!((ssim(&a, &b) - wanted).abs() < 1e-6, "single-precision pixels");
        assert!((ssim(&a, &a) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn ssim_falls_with_structure_and_takes_pictures_of_any_size() {
        let stripes = picture(16, 16, |x, _| (x % 4) as f64 / 3.0);
        let inverse = picture(16, 16, |x, _| 1.0 - (x % 4) as f64 / 3.0);
        assert!(ssim(&stripes, &inverse) < -0.5);
        for (width, height) in [(1, 1), (1, 40), (2, 3), (10, 12)] {
            let a = picture(width, height, |x, y| ((x * 7 + y * 3) % 5) as f64 / 4.0);
            assert!((ssim(&a, &a) - 1.0).abs() < 1e-12, "{width} × {height}");
        }
    }
}
