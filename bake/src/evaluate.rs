//! How good a response is, as figures: one relative L2, one percentile, and what scores are made of.
//!
//! Held-out strokes, which rows were not baked for, are relit from the bytes that ship and set against their truth. Everything here
//! is a function of the inputs; nothing looks at a clock.

pub mod candidate;
pub mod cost;
pub mod held_out;
pub mod sun;
pub mod views;

/// √(Σ w (x−r)² / Σ w r²), the relative L2 error, summed value by value in double precision.
///
/// Nothing is off from nothing: 0. What is off from nothing, and what is no number, is off beyond any measure: ∞.
#[derive(Clone, Copy, Debug, Default)]
pub struct RelativeL2 {
    off: f64,
    size: f64,
}

impl RelativeL2 {
    /// Takes in a value that differs from `wanted` by `difference` and counts for `weight`.
    pub fn add(&mut self, difference: f64, wanted: f64, weight: f64) {
        self.off += weight * difference * difference;
        self.size += weight * wanted * wanted;
    }

    /// The error, 0 to ∞.
    pub fn value(self) -> f64 {
        let numbers = self.off.is_finite() && self.size.is_finite();
        match numbers {
            true if self.off == 0.0 => 0.0,
            true if self.size > 0.0 => libm::sqrt(self.off / self.size),
            _ => f64::INFINITY,
        }
    }
}

/// [`RelativeL2`] of values that all count alike.
pub fn relative_l2(found: &[f32], wanted: &[f32]) -> f64 {
    let mut sum = RelativeL2::default();
    for (&x, &r) in found.iter().zip(wanted) {
        sum.add(f64::from(x - r), f64::from(r), 1.0);
    }
    sum.value()
}

/// Root mean square; 0 of nothing.
pub fn root_mean_square(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0f64);
    for value in values {
        sum += value * value;
        count += 1.0;
    }
    libm::sqrt(sum / count.max(1.0))
}

/// The value below which `share` of all lie, 0 to 1; 0 of nothing. Reorders `values`; those that are no numbers count as largest.
pub fn percentile(values: &mut [f32], share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let at = ((values.len() as f64 - 1.0) * share) as usize;
    f64::from(*values.select_nth_unstable_by(at, f32::total_cmp).1)
}

/// Errors of relit light against a truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RelitError {
    /// √Σ(x−r)² / √Σr² over cells and views, weighted by what each view counts for.
    pub l2: f64,
    /// 99.9th percentile of |x−r| over the largest r.
    pub tail: f64,
    /// Median of |x−r|/r where r is above 10⁻⁴ of the largest.
    pub median: f64,
}

/// What held-out strokes say of a response.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scores {
    /// Relit from the written bytes, against the same rows before compression.
    pub codec: RelitError,
    /// Relit from the written bytes, against the stroke solved directly; all light, direct light included.
    pub stroke: RelitError,
}

/// What a response gives and takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Errors on strokes, relit from bytes.
    pub scores: Scores,
    /// Bytes of the whole response; of a candidate estimated from those of the tried rows.
    pub bytes: u64,
    /// Milliseconds that relighting a stroke counts for, at most: [`cost`].
    pub relight_ms: f64,
    /// Error under suns that no beam was baked for, where there are several: [`sun`].
    pub sun_l2: Option<f64>,
}

impl RelitError {
    /// Errors of `found` against `wanted`, `weights.len()` values a cell each of which counts for its weight; weights sum to 1.
    pub fn of(found: &[f32], wanted: &[f32], weights: &[f64]) -> Self {
        let peak = wanted.iter().fold(0.0f32, |peak, &v| peak.max(v.abs()));
        let mut l2 = RelativeL2::default();
        let (mut differences, mut relative) = (Vec::with_capacity(wanted.len()), Vec::new());
        for (i, (&x, &r)) in found.iter().zip(wanted).enumerate() {
            l2.add(f64::from(x - r), f64::from(r), weights[i % weights.len()]);
            differences.push((x - r).abs());
            if r > 1e-4 * peak {
                relative.push((x - r).abs() / r);
            }
        }
        let l2 = l2.value();
        // Of nothing, or of what is no number, there are no shares of a peak either.
        if peak == 0.0 || !l2.is_finite() {
            return Self { l2, tail: l2, median: l2 };
        }
        Self {
            l2,
            tail: percentile(&mut differences, 0.999) / f64::from(peak),
            median: percentile(&mut relative, 0.5),
        }
    }

    /// Errors of several strokes as one: the root mean square (L2) and the means (tail, median).
    pub fn mean(each: &[Self]) -> Self {
        let count = each.len().max(1) as f64;
        Self {
            l2: root_mean_square(each.iter().map(|one| one.l2)),
            tail: each.iter().map(|one| one.tail).sum::<f64>() / count,
            median: each.iter().map(|one| one.median).sum::<f64>() / count,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_off_from_nothing_and_what_is_no_number_is_off_beyond_measure() {
        assert_eq!(relative_l2(&[0.0, 0.0], &[0.0, 0.0]), 0.0);
        assert_eq!(relative_l2(&[], &[]), 0.0);
        assert_eq!(relative_l2(&[1.0], &[0.0]), f64::INFINITY);
        for bad in [f32::NAN, f32::INFINITY] {
            assert_eq!(relative_l2(&[bad], &[1.0]), f64::INFINITY);
            assert_eq!(relative_l2(&[1.0], &[bad]), f64::INFINITY);
            assert_eq!(relative_l2(&[bad], &[bad]), f64::INFINITY);
            assert_eq!(RelitError::of(&[bad, 1.0], &[1.0, 1.0], &[1.0]).median, f64::INFINITY);
        }
        assert_eq!(RelitError::of(&[0.0], &[0.0], &[1.0]), RelitError::default());
    }

    #[test]
    fn relative_l2_and_percentiles_are_those_of_their_definitions() {
        assert_eq!(relative_l2(&[3.0, 4.0 + 0.5], &[3.0, 4.0]), 0.1);
        // The second value counts for nothing.
        assert_eq!(RelitError::of(&[2.0, 9.0], &[1.0, 1.0], &[1.0, 0.0]).l2, 1.0);
        let mut values: Vec<f32> = (0..=1000).rev().map(|i| i as f32).collect();
        assert_eq!(
            [0.0, 0.5, 0.999, 1.0].map(|share| percentile(&mut values, share)),
            [0.0, 500.0, 999.0, 1000.0]
        );
        assert_eq!(percentile(&mut [], 0.5), 0.0);
        assert_eq!(root_mean_square([3.0, 4.0, 0.0, 0.0]), 2.5);
    }
}
