//! Light of a point that walls keep from parts of a ray.

use super::{Airlight, PointBeside};

/// Most pieces of a ray whose ends are looked at, equal in the tangent of half the angle at the point.
const PIECES: usize = 10;
/// How often a piece between light and shadow is halved.
const HALVES: usize = 5;
/// Shares that count as the same.
const ALIKE: f64 = 0.1;

impl Airlight {
    /// [`Airlight::of_point`], which is `whole`, where only a share `reaches(t)` of the point's light gets to the place t m along the ray.
    ///
    /// The share is asked for at the ends of some pieces, 1 to 10, about equal in angle as seen from the point, and between two that differ
    /// by halves, so that with ten an edge of a shadow is found within a three-hundredth of that angle. Shadows that fit into a piece
    /// are not seen.
    pub fn of_point_past(
        &self,
        extinction: f64,
        beside: &PointBeside,
        whole: [f64; 3],
        (reaches, pieces): (&dyn Fn(f64) -> f64, usize),
    ) -> [f64; 3] {
        let pieces = pieces.clamp(1, PIECES);
        if whole.iter().all(|band| *band <= 0.0) {
            return whole;
        }
        let PointBeside { h, foot, end } = *beside;
        // The tangent of half the angle at the point, from −1 to 1, which needs no arc tangent.
        let half = |t: f64| if t == f64::INFINITY { 1.0 } else { t / ((t * t + h * h).sqrt() + h) };
        let [first, last] = [half(-foot), half(end - foot)];
        let step = (last - first) / pieces as f64;
        let off = |w: f64| h * 2.0 * w / (1.0 - w * w).max(1e-12);
        let share = |w: f64| reaches((foot + off(w)).clamp(0.0, end));
        let mut shares = [0.0; PIECES + 1];
        let shares = &mut shares[..=pieces];
        shares.iter_mut().enumerate().for_each(|(i, own)| *own = share(first + step * i as f64));
        let [least, most] = [f64::min, f64::max].map(|end| shares.iter().copied().fold(shares[0], end));
        if least >= 1.0 || most <= 0.0 {
            return if least >= 1.0 { whole } else { [0.0; 3] };
        }
        let growth = libm::exp(-extinction * foot);
        if !growth.is_finite() {
            return whole;
        }
        // As `place` has it: w = 1 − 2s².
        let at = |w: f64| (0.5 * (1.0 - w)).max(0.0).sqrt();
        let mut sum = [0.0; 3];
        let mut light_up = |[from, to, share]: [f64; 3]| {
            let light = self.between(extinction * h, at(from), at(to));
            (0..3).for_each(|band| sum[band] += share * light[band]);
        };
        // Pieces in even light that touch are one: a long one is read from the table.
        let mut run: Option<[f64; 3]> = None;
        let mut add = |from: f64, to: f64, share: f64| {
            if share <= 0.0 || to <= from {
                return;
            }
            match &mut run {
                Some([_, end, own]) if *end == from && *own == share => *end = to,
                run => {
                    if let Some(before) = run.replace([from, to, share]) {
                        light_up(before);
                    }
                }
            }
        };
        for i in 0..pieces {
            let (mut from, mut to) = (first + step * i as f64, first + step * (i + 1) as f64);
            if i + 1 == pieces {
                to = last;
            }
            let (mut low, mut high) = (shares[i], shares[i + 1]);
            for _ in 0..HALVES {
                if (low - high).abs() <= ALIKE {
                    break;
                }
                let middle = 0.5 * (from + to);
                let own = share(middle);
                // The half with less of a change counts as even; the other one is halved on.
                if (own - low).abs() <= (own - high).abs() {
                    add(from, middle, 0.5 * (low + own));
                    (from, low) = (middle, own);
                } else {
                    add(middle, to, 0.5 * (own + high));
                    (to, high) = (middle, own);
                }
            }
            add(from, to, 0.5 * (low + high));
        }
        if let Some(last) = run {
            light_up(last);
        }
        // Sums of pieces may be off by what the table is.
        let factor = extinction / h * growth;
        std::array::from_fn(|band| (sum[band] * factor).min(whole[band]))
    }
}
