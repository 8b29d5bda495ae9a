//! A window's or a table's profile along one axis, with its second integral, so that its mean over a pixel's
//! shadow is a second difference at any scale. For windows that have no closed form.

#[cfg(feature = "gpu")]
mod nodes;

use super::edge::NARROWEST_BOX;

/// Intervals of the stored integrals over [0, 1].
const INTERVALS: usize = 512;
/// Fewest and most intervals of a row made for one streak.
const ROW_FEWEST: usize = 48;
const ROW_MOST: usize = 512;
/// Row intervals per pixel.
const ROW_PER_PIXEL: f64 = 4.0;

/// A function on [0, 1], zero outside, by its integrals.
#[derive(Clone, Debug)]
pub struct Profile {
    values: Vec<f64>,
    first: Vec<f64>,
    second: Vec<f64>,
}

/// A profile seen through the pixels of one streak, read linearly.
#[derive(Clone, Debug, Default)]
pub struct ProfileRow {
    start: f32,
    per_pixel: f32,
    values: Vec<f32>,
}

impl Profile {
    /// Tabulates `value`. Trapezoid sums, whose error falls with the square of 1/512.
    pub fn new(value: impl Fn(f64) -> f64) -> Self {
        let step = 1.0 / INTERVALS as f64;
        let values: Vec<f64> = (0..=INTERVALS).map(|i| value(i as f64 * step)).collect();
        let (mut first, mut second) = (vec![0.0], vec![0.0]);
        for i in 0..INTERVALS {
            let (a, b) = (values[i], values[i + 1]);
            second.push(second[i] + step * first[i] + step * step * (2.0 * a + b) / 6.0);
            first.push(first[i] + 0.5 * step * (a + b));
        }
        Self { values, first, second }
    }

    /// This profile, `own` times, and `factor` times another.
    pub fn plus(&self, own: f64, factor: f64, other: &Self) -> Self {
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| own * a + factor * b).collect();
        Self {
            values: sum(&self.values, &other.values),
            first: sum(&self.first, &other.first),
            second: sum(&self.second, &other.second),
        }
    }

    /// Values from 0 to 1, evenly.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Integral over [0, 1].
    pub fn integral(&self) -> f64 {
        self.first[INTERVALS]
    }

    /// Mean square over [0, 1].
    pub fn square(&self) -> f64 {
        self.values.iter().map(|value| value * value).sum::<f64>() / self.values.len() as f64
    }

    /// Second integral from 0 to `x`, any `x`: cubic between nodes, exact outside.
    fn second_integral(&self, x: f64) -> f64 {
        if x <= 0.0 {
            return 0.0;
        }
        if x >= 1.0 {
            return self.second[INTERVALS] + self.first[INTERVALS] * (x - 1.0);
        }
        let step = 1.0 / INTERVALS as f64;
        let index = ((x * INTERVALS as f64) as usize).min(INTERVALS - 1);
        let t = x - index as f64 * step;
        let slope = (self.values[index + 1] - self.values[index]) * INTERVALS as f64;
        self.second[index] + t * (self.first[index] + t * (0.5 * self.values[index] + t * slope / 6.0))
    }

    /// Mean over the shadow of the pixel whose centre is `place` pixels from 0, for an axis of `scale` pixels
    /// per unit with direction components `direction` (absolute) in the lattice.
    pub fn mean_over_pixel(&self, place: f64, scale: f64, direction: [f64; 2]) -> f64 {
        let a = direction[0].max(direction[1]);
        let b = direction[0].min(direction[1]).max(NARROWEST_BOX);
        let at = |offset: f64| self.second_integral((place + offset) / scale);
        let (sum, difference) = (0.5 * (a + b), 0.5 * (a - b));
        let second = at(sum) - at(difference) - at(-difference) + at(-sum);
        second * scale * scale / (a * b)
    }

    /// Fills `row` with [`Profile::mean_over_pixel`] at every place where it is not zero.
    pub fn fill_row(&self, scale: f64, direction: [f64; 2], row: &mut ProfileRow) {
        let radius = 0.5 * (direction[0] + direction[1]) + 0.5 * NARROWEST_BOX;
        let length = scale + 2.0 * radius;
        let intervals = ((length * ROW_PER_PIXEL) as usize).clamp(ROW_FEWEST, ROW_MOST);
        row.start = -radius as f32;
        row.per_pixel = (intervals as f64 / length) as f32;
        row.values.clear();
        let place = |i: usize| length * i as f64 / intervals as f64 - radius;
        row.values.extend((0..=intervals).map(|i| self.mean_over_pixel(place(i), scale, direction) as f32));
    }
}

impl ProfileRow {
    /// Bytes that it holds beside itself.
    pub fn bytes(&self) -> usize {
        self.values.capacity() * size_of::<f32>()
    }

    /// Mean over the pixel whose centre is `distance` pixels from the picture's beginning, and its slope per
    /// pixel; zero far outside.
    #[inline]
    pub fn at(&self, distance: f32) -> [f32; 2] {
        let place = (distance - self.start) * self.per_pixel;
        let last = self.values.len() - 1;
        if !(place > 0.0 && place < last as f32) {
            return [0.0; 2];
        }
        let index = (place as usize).min(last - 1);
        let low = self.values[index];
        let rise = self.values[index + 1] - low;
        [low + rise * (place - index as f32), rise * self.per_pixel]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_hold_the_profiles_whole_integral_at_any_scale() {
        /// Rows have four intervals a pixel.
        const ROW_ERROR: f64 = 2e-3;
        let profile = Profile::new(|x| 1.0 - x);
        let mut row = ProfileRow::default();
        for scale in [0.05, 0.7, 3.0, 60.0] {
            profile.fill_row(scale, [1.0, 0.0], &mut row);
            let sum: f64 = (-2..70).map(|i| f64::from(row.at(i as f32 + 0.3)[0])).sum();
            assert!((sum / (0.5 * scale) - 1.0).abs() < ROW_ERROR * 5.0, "scale {scale}: {sum}");
        }
    }

    #[test]
    fn a_wide_profile_reads_as_itself() {
        let profile = Profile::new(|x| x);
        let mut row = ProfileRow::default();
        profile.fill_row(100.0, [0.8, 0.6], &mut row);
        assert!((row.at(50.0)[0] - 0.5).abs() < 1e-4);
        assert_eq!(row.at(-3.0), [0.0; 2]);
        assert_eq!(row.at(103.0), [0.0; 2]);
    }
}
