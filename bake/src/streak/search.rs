//! Where to start: which frequency is added next, and whether a term is better placed elsewhere.
//!
//! The gain of a wave of any frequency on top of what is fitted is read off two Fourier transforms, of
//! residual × window and of window²; the few highest peaks are tried. After the last term each term in turn
//! is taken out and looked for anew, because a greedy choice is rarely the best one in hindsight.

use super::refine::{Free, Model, Samples, Wave, refine};
use rustfft::FftPlannerScalar;
use rustfft::num_complex::Complex;
use std::cmp::Ordering;

/// How long a search may look.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Peaks tried per added term.
    pub peaks: usize,
    /// Steps of refinement after each added term.
    pub steps: usize,
    /// Rounds of taking out and replacing every term.
    pub rounds: usize,
}

/// Steps of the window alone, and of what is left when a term is taken out.
const FIRST_STEPS: usize = 20;
const LETTING_GO_STEPS: usize = 2;
/// Relative gain of a round that makes another one worth its time.
const WORTHWHILE: f64 = 2e-3;
/// Steps with the other terms held, for a newly placed term.
const SETTLING_STEPS: usize = 6;
/// Relative gain below which refinement stops while searching.
const COARSE: f64 = 1e-3;

/// Adds waves until the model has `count`, each where it helps most, refining what `free` lets move.
/// Stops early when nothing is left to explain. Returns the summed squared error.
pub fn grow(model: &mut Model, samples: &Samples, count: usize, free: Free, effort: Effort) -> f64 {
    let mut error = refine(model, samples, free, effort.steps.max(FIRST_STEPS), COARSE);
    while model.waves.len() < count {
        match best_placement(model, samples, free, effort) {
            Some((better, reached)) if reached < error => (*model, error) = (better, reached),
            _ => break,
        }
    }
    for _ in 0..effort.rounds {
        let before = error;
        for _ in 0..model.waves.len() {
            // The oldest term leaves and a new one joins at the end: a round visits every term once.
            let mut without = model.clone();
            let oldest = without.waves.remove(0);
            refine(&mut without, samples, Free { frequencies: false, ..free }, LETTING_GO_STEPS, COARSE);
            match best_placement(&without, samples, free, effort) {
                Some((better, reached)) if reached < error => (*model, error) = (better, reached),
                _ => {
                    model.waves.remove(0);
                    model.waves.push(oldest);
                }
            }
        }
        if before - error < WORTHWHILE * before {
            break;
        }
    }
    error
}

/// The model with one more wave, refined from each of the most promising places; the best of them.
fn best_placement(model: &Model, samples: &Samples, free: Free, effort: Effort) -> Option<(Model, f64)> {
    let tried = placements(model, samples, free, effort.peaks).into_iter().map(|mut candidate| {
        let reached = refine(&mut candidate, samples, free, effort.steps, COARSE);
        (candidate, reached)
    });
    tried.min_by(|a, b| a.1.partial_cmp(&b.1).unwrap_or(Ordering::Equal))
}

/// The model with one more wave, at each of the most promising frequencies.
fn placements(model: &Model, samples: &Samples, free: Free, peaks: usize) -> Vec<Model> {
    let candidates = promising(model, samples, peaks * 2, !free.frequencies);
    let mut placed: Vec<(Model, f64)> = Vec::new();
    for frequency in candidates {
        let mut candidate = model.clone();
        candidate.waves.push(Wave { frequency, factors: [0.0; 2] });
        let only_new = Free { window: false, first_term: model.waves.len(), frequencies: false };
        refine(&mut candidate, samples, only_new, 1, COARSE);
        let error = refine(
            &mut candidate,
            samples,
            Free { frequencies: free.frequencies, ..only_new },
            SETTLING_STEPS,
            COARSE,
        );
        placed.push((candidate, error));
    }
    placed.sort_by(|a, b| a.1.partial_cmp(&b.1).unwrap_or(Ordering::Equal));
    placed.truncate(peaks);
    placed.into_iter().map(|(model, _)| model).collect()
}

/// Frequencies whose wave would explain most of the residual, best first; integers only if asked.
fn promising(model: &Model, samples: &Samples, count: usize, integers: bool) -> Vec<[f64; 2]> {
    let (residual, field) = model.residual(samples);
    let weights = &field.weights;
    let counts = [samples.axes[0].len(), samples.axes[1].len()];
    let sides = counts.map(|count| (2 * count).next_power_of_two());
    let transform = |value: &dyn Fn(usize) -> f64| {
        let mut plane = vec![Complex::default(); sides[0] * sides[1]];
        for i in 0..samples.light.len() {
            let (column, row) = samples.cell(i);
            plane[row * sides[0] + column].re = value(i);
        }
        transform_plane(&mut plane, sides);
        plane
    };
    let projected = transform(&|i| residual[i] * weights[i]);
    let squared = transform(&|i| weights[i] * weights[i]);
    let total = squared[0].re;
    // A bin is a whole number of periods over the padded grid; the picture holds more or fewer.
    let periods = [0, 1].map(|axis| {
        let axis_samples = samples.axes[axis].as_slice();
        let spacing = match axis_samples {
            [first, .., last] => (last - first) / (axis_samples.len() - 1) as f64,
            _ => 1.0,
        };
        1.0 / (spacing * sides[axis] as f64)
    });
    let signed = |bin: usize, side: usize| if bin > side / 2 { bin as f64 - side as f64 } else { bin as f64 };
    let mut gains: Vec<(f64, usize)> = Vec::new();
    let gain = |x: usize, y: usize| {
        let double = squared[(2 * y % sides[1]) * sides[0] + 2 * x % sides[0]];
        let bin = projected[y * sides[0] + x];
        // Normal equations of cosine and sine under the window, in the grid's own origin.
        let ridge = 1e-2 * total;
        let cc = 0.5 * (total + double.re) + ridge;
        let ss = 0.5 * (total - double.re) + ridge;
        let cs = -0.5 * double.im;
        let (c, s) = (bin.re, -bin.im);
        (c * c * ss - 2.0 * c * s * cs + s * s * cc) / (cc * ss - cs * cs)
    };
    let half = sides[0] / 2;
    let plane: Vec<f64> =
        (0..sides[1]).flat_map(|y| (0..=half).map(move |x| (x, y))).map(|(x, y)| gain(x, y)).collect();
    for y in 0..sides[1] {
        for x in 0..=half {
            let here = plane[y * (half + 1) + x];
            let mut peak = here > 0.0 && (x, y) != (0, 0);
            for (dx, dy) in [(-1i64, -1i64), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)] {
                let nx = x as i64 + dx;
                let ny = (y as i64 + dy).rem_euclid(sides[1] as i64) as usize;
                if (0..=half as i64).contains(&nx) {
                    peak &= plane[ny * (half + 1) + nx as usize] <= here;
                }
            }
            if peak {
                gains.push((here, y * (half + 1) + x));
            }
        }
    }
    gains.sort_by(|a, b| b.0.partial_cmp(&a.0).unwrap_or(Ordering::Equal).then(a.1.cmp(&b.1)));
    let mut found: Vec<[f64; 2]> = Vec::new();
    for (_, place) in gains {
        let (x, y) = (place % (half + 1), place / (half + 1));
        let mut frequency = [signed(x, sides[0]) * periods[0], signed(y, sides[1]) * periods[1]];
        if integers {
            frequency = frequency.map(f64::round);
            let taken = |f: &[f64; 2]| *f == frequency || *f == frequency.map(|f| -f);
            if frequency == [0.0; 2]
                || found.iter().any(taken)
                || model.waves.iter().any(|w| taken(&w.frequency))
            {
                continue;
            }
        }
        found.push(frequency);
        if found.len() == count {
            break;
        }
    }
    found
}

/// Forward transform of a plane, rows then columns, unnormalised, zero frequency first.
pub fn transform_plane(plane: &mut [Complex<f64>], sides: [usize; 2]) {
    // The scalar planner: the vectorised ones round differently on different processors.
    let mut planner = FftPlannerScalar::new();
    let (across, along) = (planner.plan_fft_forward(sides[0]), planner.plan_fft_forward(sides[1]));
    across.process(plane);
    let mut column = vec![Complex::default(); sides[1]];
    for x in 0..sides[0] {
        for (y, value) in column.iter_mut().enumerate() {
            *value = plane[y * sides[0] + x];
        }
        along.process(&mut column);
        for (y, value) in column.iter().enumerate() {
            plane[y * sides[0] + x] = *value;
        }
    }
}
