//! Light of a point that walls keep from parts of a ray.

use super::{Airlight, PointBeside};

/// Most pieces of a ray whose ends are looked at, equal in the tangent of half the angle at the point.
const PIECES: usize = 10;
/// How often a piece between light and shadow is halved.
const HALVES: usize = 5;
/// Shares that count as the same.
const ALIKE: f64 = 0.1;

/// What of a ray a point lights, whatever the ray ends on: pieces by the tangent of half the angle at the point, from the eye on, each with the
/// share of light that gets to it; between them there is none.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LitPieces {
    /// Whether all of the ray is lit, and no pieces are told apart.
    is_whole: bool,
    /// Both ends and the share, ascending.
    pieces: [[f64; 3]; MOST_PIECES],
    /// How many there are.
    count: usize,
}

/// Most pieces: each of some is halved and leaves one behind every time.
const MOST_PIECES: usize = PIECES * (HALVES + 1);

/// The tangent of half the angle at a point h from the ray, at t along it from the point's foot: −1 to 1, without an arc tangent.
fn half(h: f64, t: f64) -> f64 {
    if t == f64::INFINITY { 1.0 } else { t / ((t * t + h * h).sqrt() + h) }
}

impl LitPieces {
    /// Of a ray where only a share `reaches(t)` of the point's light gets to the place t m along it.
    ///
    /// The share is asked for at the ends of some pieces, 1 to 10, about equal in angle as seen from the point, and between two that differ
    /// by halves, so that with ten an edge of a shadow is found within a three-hundredth of that angle. Shadows that fit into a piece
    /// are not seen.
    pub fn of(beside: &PointBeside, (reaches, pieces): (&dyn Fn(f64) -> f64, usize)) -> Self {
        let pieces = pieces.clamp(1, PIECES);
        let PointBeside { h, foot, end } = *beside;
        let [first, last] = [half(h, -foot), half(h, end - foot)];
        let step = (last - first) / pieces as f64;
        let off = |w: f64| h * 2.0 * w / (1.0 - w * w).max(1e-12);
        let share = |w: f64| reaches((foot + off(w)).clamp(0.0, end));
        let mut shares = [0.0; PIECES + 1];
        let shares = &mut shares[..=pieces];
        shares.iter_mut().enumerate().for_each(|(i, own)| *own = share(first + step * i as f64));
        let [least, most] = [f64::min, f64::max].map(|end| shares.iter().copied().fold(shares[0], end));
        if least >= 1.0 || most <= 0.0 {
            return Self { is_whole: least >= 1.0, pieces: [[0.0; 3]; MOST_PIECES], count: 0 };
        }
        let (mut found, mut count) = ([[0.0; 3]; MOST_PIECES], 0);
        // Pieces in even light that touch are one: a long one is read from the table.
        let mut add = |from: f64, to: f64, share: f64| {
            if share <= 0.0 || to <= from {
                return;
            }
            match found[..count].last_mut() {
                Some([_, end, own]) if *end == from && *own == share => *end = to,
                _ => {
                    found[count] = [from, to, share];
                    count += 1;
                }
            }
        };
        for i in 0..pieces {
            let (mut from, mut to) = (first + step * i as f64, first + step * (i + 1) as f64);
            if i + 1 == pieces {
                to = last;
            }
            let (mut low, mut high) = (shares[i], shares[i + 1]);
            let mut behind = [[0.0; 3]; HALVES];
            let mut halves = 0;
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
                    behind[halves] = [middle, to, 0.5 * (own + high)];
                    halves += 1;
                    (to, high) = (middle, own);
                }
            }
            add(from, to, 0.5 * (low + high));
            behind[..halves].iter().rev().for_each(|[from, to, share]| add(*from, *to, *share));
        }
        Self { is_whole: false, pieces: found, count }
    }
}

impl Airlight {
    /// [`Airlight::of_point`], which is `whole`, where of the ray only `lit` pieces are; these are of this ray or of one that goes on.
    pub(crate) fn of_point_past(
        &self,
        extinction: f64,
        beside: &PointBeside,
        whole: [f64; 3],
        lit: &LitPieces,
    ) -> [f64; 3] {
        if lit.is_whole || lit.count == 0 {
            return if lit.is_whole { whole } else { [0.0; 3] };
        }
        let PointBeside { h, foot, end } = *beside;
        let growth = libm::exp(-extinction * foot);
        if !growth.is_finite() {
            return whole;
        }
        let last = half(h, end - foot);
        // As `place` has it: w = 1 − 2s².
        let at = |w: f64| (0.5 * (1.0 - w)).max(0.0).sqrt();
        let mut sum = [0.0; 3];
        for &[from, to, share] in lit.pieces[..lit.count].iter().take_while(|[from, ..]| *from < last) {
            let light = self.between(extinction * h, at(from), at(to.min(last)));
            (0..3).for_each(|band| sum[band] += share * light[band]);
        }
        // Sums of pieces may be off by what the table is.
        let factor = extinction / h * growth;
        std::array::from_fn(|band| (sum[band] * factor).min(whole[band]))
    }
}
