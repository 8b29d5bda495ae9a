//! Light that a lens spreads around bright things, its bloom: a mixture of wide, round kernels that sums to 1. It knows no rain: what
//! rain scatters around a light is [`crate::airlight`] and [`crate::point_spread`].
//!
//! Each level halves the picture with the weights [1 3 3 1]/8 along both axes and comes back doubled with
//! [3 1]/4; the mixture over levels approximates the long tail of glass and sensor at the cost of
//! one third more pixels, as Kawase's repeated blur does \[toyshop\] §6.2. Both steps share light out without
//! gain or loss, so the bloom moves energy and makes none.

use crate::parallel::prelude::*;
use crate::picture::Picture;

/// How much light is spread, and how far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bloom {
    /// Share of the light that leaves its pixel, in [0, 1].
    pub amount: f32,
    /// Widest level: its kernel is about 2^levels pixels wide. At most 12.
    pub levels: u32,
    /// Weight of a level relative to the next finer one; 1 spreads far, 0.5 stays close.
    pub reach: f32,
}

impl Default for Bloom {
    fn default() -> Self {
        Self { amount: 0.08, levels: 7, reach: 0.8 }
    }
}

/// One image row or column, halved: outputs 2i from inputs 2i−1 … 2i+2, edges repeated.
pub(crate) fn halved(length: usize) -> usize {
    length.div_ceil(2)
}

/// Inputs of output i of a row or column of `length` values that is halved.
fn taps(i: usize, length: usize) -> [usize; 4] {
    let last = length - 1;
    [(2 * i).saturating_sub(1), (2 * i).min(last), (2 * i + 1).min(last), (2 * i + 2).min(last)]
}

/// Their mean.
#[inline(always)]
fn blended([a, b, c, d]: [f32; 4]) -> f32 {
    0.125 * (a + d) + 0.375 * (b + c)
}

pub(crate) fn halve(source: &Picture) -> Picture {
    let (width, height) = (halved(source.width), halved(source.height));
    let mut pixels = vec![[0.0; 3]; width * height];
    pixels.par_chunks_mut(width).enumerate().for_each(|(y, pixels)| {
        let [a, b, c, d] = taps(y, source.height).map(|row| source.row(row).as_flattened());
        let down = a.iter().zip(b).zip(c.iter().zip(d));
        let tall: Vec<f32> = down.map(|((&a, &b), (&c, &d))| blended([a, b, c, d])).collect();
        let (row, _) = tall.as_chunks::<3>();
        let of = |taps: [usize; 4]| -> [f32; 3] {
            let [a, b, c, d] = taps.map(|at| row[at]);
            std::array::from_fn(|band| blended([a[band], b[band], c[band], d[band]]))
        };
        for (x, pixel) in pixels.iter_mut().enumerate() {
            *pixel = of(taps(x, source.width));
        }
    });
    Picture { width, height, pixels }
}

/// Adds `coarse`, doubled, to `fine` times `weight`.
pub(crate) fn add_doubled(fine: &Picture, weight: f32, coarse: &Picture) -> Picture {
    // Output 2i lies a quarter step before coarse i, output 2i + 1 a quarter step behind it.
    let taps = |i: usize, length: usize| {
        let near = (i / 2).min(length - 1);
        let far = if i.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(length - 1) };
        (near, far)
    };
    let mut pixels = vec![[0.0; 3]; fine.pixels.len()];
    let rows = pixels.par_chunks_mut(fine.width.max(1)).enumerate();
    rows.for_each(|(y, pixels)| {
        let (near, far) = taps(y, coarse.height);
        let [near, far] = [near, far].map(|row| coarse.row(row).as_flattened());
        let mixed: Vec<f32> = near.iter().zip(far).map(|(near, far)| 0.75 * near + 0.25 * far).collect();
        let (row, _) = mixed.as_chunks::<3>();
        let last = row.len() - 1;
        let pairs = pixels.chunks_mut(2).zip(fine.row(y).chunks(2)).enumerate();
        for (x, (pixels, fine)) in pairs {
            let (before, near, behind) =
                (&row[x.saturating_sub(1)], &row[x.min(last)], &row[(x + 1).min(last)]);
            for ((pixel, fine), far) in pixels.iter_mut().zip(fine).zip([before, behind]) {
                for band in 0..3 {
                    pixel[band] = weight * fine[band] + 0.75 * near[band] + 0.25 * far[band];
                }
            }
        }
    });
    Picture { width: fine.width, height: fine.height, pixels }
}

impl Bloom {
    /// The picture with its bloom: (1 − amount) of each pixel's light where it was, the rest around it.
    pub fn spread(&self, picture: &Picture) -> Picture {
        let amount = self.amount.clamp(0.0, 1.0);
        let mut levels = Vec::new();
        while levels.len() < self.levels.min(12) as usize {
            let finest = levels.last().unwrap_or(picture);
            if finest.width < 2 && finest.height < 2 {
                break;
            }
            levels.push(halve(finest));
        }
        if amount == 0.0 || levels.is_empty() {
            return picture.clone();
        }
        let mut weights: Vec<f32> = Vec::with_capacity(levels.len());
        let mut weight = 1.0;
        for _ in &levels {
            weights.push(weight);
            weight *= self.reach.clamp(0.0, 2.0);
        }
        let total: f32 = weights.iter().sum();
        for weight in &mut weights {
            *weight *= amount / total;
        }
        let coarsest = levels.len() - 1;
        let mut spread = levels[coarsest].clone();
        for pixel in spread.pixels.iter_mut().flatten() {
            *pixel *= weights[coarsest];
        }
        for level in (0..coarsest).rev() {
            spread = add_doubled(&levels[level], weights[level], &spread);
        }
        add_doubled(picture, 1.0 - amount, &spread)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Single-precision sums over some ten thousand pixels.
    const ROUND_OFF: f32 = 1e-4;

    #[test]
    fn the_kernel_sums_to_one() {
        let mut picture = Picture { width: 256, height: 128, pixels: vec![[0.0; 3]; 256 * 128] };
        picture.pixels[64 * 256 + 131] = [1000.0, 10.0, 1.0];
        let bloom = Bloom { amount: 0.3, levels: 5, reach: 0.8 };
        let spread = bloom.spread(&picture);
        for (band, wanted) in [1000.0, 10.0, 1.0].into_iter().enumerate() {
            let sum: f32 = spread.pixels.iter().map(|pixel| pixel[band]).sum();
            assert!((sum / wanted - 1.0).abs() < ROUND_OFF, "colour {band}: {sum}");
        }
        assert!(spread.pixels[64 * 256 + 131][0] < 1000.0 && spread.pixels[64 * 256 + 100][0] > 0.0);
    }

    #[test]
    fn an_even_picture_of_any_size_stays_as_it_is() {
        for (width, height) in [(1, 1), (7, 5), (64, 33), (1, 40)] {
            let picture = Picture { width, height, pixels: vec![[0.7; 3]; width * height] };
            let spread = Bloom { amount: 1.0, levels: 12, reach: 1.0 }.spread(&picture);
            assert!(spread.pixels.iter().flatten().all(|v| (v - 0.7).abs() < ROUND_OFF));
        }
    }
}
