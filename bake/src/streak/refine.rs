//! Least squares over everything a pattern has: window, constant, frequencies and amplitudes at once.
//!
//! Levenberg's and Marquardt's method \[marquardt\] on ½ Σ (picture − W·S)², S = c + Σ a cos θ + b sin θ with
//! θ = 2π(f (u − ½) + g (v − ½)): measured from the middle, so that a change of frequency turns the ends and
//! leaves the middle. A faint spring holds a and b, because terms of neighbouring frequency can otherwise
//! grow without bound against each other, and such sums do not survive rounding.

use super::window::{Extent, Shape};
use super::window_field::{Fields, WindowField};
use squall_formats::section::streak::{Cosine, CosinePattern};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Mean squared error that a squared amplitude of 1 must be worth.
const SPRING: f64 = 1e-6;
/// Pixels taken into the normal equations at once.
const BATCH: usize = 4;
/// Dampings tried before a step is given up.
const TRIES: usize = 7;

/// The picture a fit works on: a grid of samples, which may be a part of the source.
pub struct Samples {
    /// Columns' u and rows' v.
    pub axes: [Vec<f64>; 2],
    /// Light, u fastest.
    pub light: Vec<f64>,
    /// Where the light is, in the whole picture.
    pub extent: Extent,
    /// Windows that were looked at last, at every sample.
    pub fields: Fields,
}

/// Which numbers a refinement may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Free {
    /// The window's.
    pub window: bool,
    /// Frequencies of the terms.
    pub frequencies: bool,
    /// Terms before this one stand still.
    pub first_term: usize,
}

impl Free {
    /// Everything.
    pub const ALL: Self = Self { window: true, frequencies: true, first_term: 0 };
}

/// A term as it is fitted: f, g, a, b.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// Periods over the picture, across and along.
    pub frequency: [f64; 2],
    /// Factors of cosine and sine.
    pub factors: [f64; 2],
}

/// A pattern as it is fitted.
#[derive(Clone, Debug)]
pub struct Model {
    /// Which window.
    pub shape: Shape,
    /// Its free numbers.
    pub window: Vec<f64>,
    /// The constant.
    pub constant: f64,
    /// The terms.
    pub waves: Vec<Wave>,
}

impl Model {
    /// The pattern an asset stores, before rounding.
    pub fn pattern(&self) -> CosinePattern {
        let terms = self.waves.iter().map(Wave::cosine).collect();
        CosinePattern { window: self.shape.window(&self.window), constant: self.constant, terms }
    }

    /// The model of a stored pattern; `None` for a window that is not fitted.
    pub fn from_pattern(pattern: &CosinePattern) -> Option<Self> {
        let (shape, window) = Shape::free(&pattern.window)?;
        let waves = pattern.terms.iter().map(Wave::from_cosine).collect();
        Some(Self { shape, window, constant: pattern.constant, waves })
    }

    /// The picture minus the model at every sample, and the window there.
    pub fn residual(&self, samples: &Samples) -> (Vec<f64>, Arc<WindowField>) {
        let tables = PhaseTables::new(samples, &self.waves);
        let field = samples.field(self.shape, &self.window);
        let mut residual = samples.light.clone();
        for (i, out) in residual.iter_mut().enumerate() {
            let (column, row) = samples.cell(i);
            let mut sum = self.constant;
            for (k, wave) in self.waves.iter().enumerate() {
                let [cos, sin] = tables.phase(k, column, row);
                sum += wave.factors[0] * cos + wave.factors[1] * sin;
            }
            *out -= field.weights[i] * sum;
        }
        (residual, field)
    }
}

impl Wave {
    fn cosine(&self) -> Cosine {
        let ([f, g], [a, b]) = (self.frequency, self.factors);
        // a cos θ + b sin θ = |·| cos(θ − atan2(b, a)); the corner is half a picture before the middle.
        let phase = -libm::atan2(b, a) - 0.5 * TAU * (f + g);
        Cosine { across: f, along: g, amplitude: libm::sqrt(a * a + b * b), phase }.normalised()
    }

    fn from_cosine(term: &Cosine) -> Self {
        let (sin, cos) = libm::sincos(term.phase + 0.5 * TAU * (term.across + term.along));
        let factors = [term.amplitude * cos, -term.amplitude * sin];
        Self { frequency: [term.across, term.along], factors }
    }
}

impl Samples {
    /// Column and row of sample `i`.
    pub fn cell(&self, i: usize) -> (usize, usize) {
        (i % self.axes[0].len(), i / self.axes[0].len())
    }

    /// (u, v) of sample `i`.
    pub fn place(&self, i: usize) -> (f64, f64) {
        let (column, row) = self.cell(i);
        (self.axes[0][column], self.axes[1][row])
    }

    /// A window at every sample: worked out once for all the steps that leave it as it is.
    pub fn field(&self, shape: Shape, window: &[f64]) -> Arc<WindowField> {
        self.fields.get(window, || WindowField::new(shape, window, self))
    }
}

/// e^{iθ} of every wave, as a factor per column and a factor per row.
struct PhaseTables {
    columns: Vec<Vec<[f64; 2]>>,
    rows: Vec<Vec<[f64; 2]>>,
}

impl PhaseTables {
    fn new(samples: &Samples, waves: &[Wave]) -> Self {
        let along = |axis: usize| {
            let turn = |wave: &Wave| {
                let turn = |x: &f64| {
                    let (sin, cos) = libm::sincos(TAU * wave.frequency[axis] * (x - 0.5));
                    [cos, sin]
                };
                samples.axes[axis].iter().map(turn).collect()
            };
            waves.iter().map(turn).collect()
        };
        Self { columns: along(0), rows: along(1) }
    }

    fn phase(&self, wave: usize, column: usize, row: usize) -> [f64; 2] {
        let ([ca, sa], [cb, sb]) = (self.columns[wave][column], self.rows[wave][row]);
        [ca * cb - sa * sb, sa * cb + ca * sb]
    }
}

/// Normal equations of one linearisation: JᵀJ (lower triangle, rows of `n`), Jᵀr and the summed squares. While they are summed
/// the window's numbers come last, because most of them are 0 at most pixels; then [`Normal::window_first`].
struct Normal {
    n: usize,
    matrix: Vec<f64>,
    gradient: Vec<f64>,
    cost: f64,
}

/// Refines `model` in place and returns its summed squared error, spring included.
///
/// Stops after `iterations` steps or when a step gains less than a part in `1 / tolerance`.
pub fn refine(model: &mut Model, samples: &Samples, free: Free, iterations: usize, tolerance: f64) -> f64 {
    model.shape.confine(&mut model.window, &samples.extent);
    let mut normal = linearise(model, samples, free);
    let mut damping = 1e-3;
    for _ in 0..iterations {
        let mut better = None;
        for _ in 0..TRIES {
            if let Some(step) = solve(&normal, damping) {
                let mut candidate = model.clone();
                advance(&mut candidate, &step, samples, free);
                let cost = cost(&candidate, samples);
                if cost < normal.cost {
                    better = Some((candidate, cost));
                    break;
                }
            }
            damping *= 4.0;
        }
        let Some((candidate, cost)) = better else { break };
        let gain = (normal.cost - cost) / normal.cost;
        *model = candidate;
        if gain < tolerance || cost <= f64::MIN_POSITIVE {
            return cost;
        }
        damping = (0.2 * damping).max(1e-9);
        normal = linearise(model, samples, free);
    }
    normal.cost
}

/// Summed squared error with the spring's share.
pub fn cost(model: &Model, samples: &Samples) -> f64 {
    let (residual, _) = model.residual(samples);
    residual.iter().map(|r| r * r).sum::<f64>() + spring(samples) * stretched(model)
}

fn spring(samples: &Samples) -> f64 {
    SPRING * samples.light.len() as f64
}

fn stretched(model: &Model) -> f64 {
    model.waves.iter().map(|wave| wave.factors[0] * wave.factors[0] + wave.factors[1] * wave.factors[1]).sum()
}

fn linearise(model: &Model, samples: &Samples, free: Free) -> Normal {
    let window = if free.window { model.window.len() } else { 0 };
    let per_wave = if free.frequencies { 4 } else { 2 };
    let moving = &model.waves[free.first_term..];
    let n = window + 1 + per_wave * moving.len();
    let mut normal = Normal { n, matrix: vec![0.0; n * n], gradient: vec![0.0; n], cost: 0.0 };
    let tables = PhaseTables::new(samples, &model.waves);
    let field = samples.field(model.shape, &model.window);
    let mut batch = Batch::new(n);
    for i in 0..samples.light.len() {
        let weight = field.weights[i];
        if field.dark[i] {
            let miss = samples.light[i] - weight * model.constant;
            normal.cost += miss * miss;
            continue;
        }
        let (u, v) = samples.place(i);
        let (column, row) = samples.cell(i);
        let derivatives = batch.next();
        let mut sum = model.constant;
        let mut at = 1;
        for (k, wave) in model.waves.iter().enumerate() {
            let [cos, sin] = tables.phase(k, column, row);
            sum += wave.factors[0] * cos + wave.factors[1] * sin;
            if k < free.first_term {
                continue;
            }
            if free.frequencies {
                let turn = weight * TAU * (wave.factors[1] * cos - wave.factors[0] * sin);
                derivatives[at] = turn * (u - 0.5);
                derivatives[at + 1] = turn * (v - 0.5);
                at += 2;
            }
            derivatives[at] = weight * cos;
            derivatives[at + 1] = weight * sin;
            at += 2;
        }
        derivatives[0] = weight;
        for (out, slope) in derivatives[at..].iter_mut().zip(field.slopes_at(i)) {
            *out = slope * sum;
        }
        if batch.full(samples.light[i] - weight * sum) {
            normal.add(&mut batch);
        }
    }
    if batch.filled > 0 {
        normal.add(&mut batch);
    }
    normal.window_first(window);
    let spring = spring(samples);
    normal.cost += spring * stretched(model);
    for (k, wave) in moving.iter().enumerate() {
        let at = window + 1 + per_wave * k + per_wave - 2;
        for part in 0..2 {
            normal.matrix[(at + part) * n + at + part] += spring;
            normal.gradient[at + part] -= spring * wave.factors[part];
        }
    }
    normal
}

/// Derivatives of a few pixels, a row of them each, and what the model misses there.
struct Batch {
    n: usize,
    rows: Vec<f64>,
    misses: [f64; BATCH],
    filled: usize,
}

impl Batch {
    fn new(n: usize) -> Self {
        Self { n, rows: vec![0.0; BATCH * n], misses: [0.0; BATCH], filled: 0 }
    }

    /// The next pixel's derivatives, to be written.
    fn next(&mut self) -> &mut [f64] {
        &mut self.rows[self.filled * self.n..][..self.n]
    }

    /// Ends a pixel; whether the batch is full.
    fn full(&mut self, miss: f64) -> bool {
        self.misses[self.filled] = miss;
        self.filled += 1;
        self.filled == BATCH
    }
}

impl Normal {
    /// Adds a batch and empties it.
    fn add(&mut self, batch: &mut Batch) {
        let n = self.n;
        batch.rows[batch.filled * n..].fill(0.0);
        batch.misses[batch.filled..].fill(0.0);
        let misses = batch.misses;
        let (first, second) = batch.rows.split_at(2 * n);
        let ((b0, b1), (b2, b3)) = (first.split_at(n), second.split_at(n));
        for i in 0..n {
            let a = [b0[i], b1[i], b2[i], b3[i]];
            if a == [0.0; BATCH] {
                continue;
            }
            // Along a row of the matrix the four pixels lie side by side: plain loops, which become vectors.
            let row = &mut self.matrix[i * n..][..=i];
            for ((((out, b0), b1), b2), b3) in row.iter_mut().zip(b0).zip(b1).zip(b2).zip(b3) {
                *out += a[0] * b0 + a[1] * b1 + (a[2] * b2 + a[3] * b3);
            }
            self.gradient[i] += a[0] * misses[0] + a[1] * misses[1] + (a[2] * misses[2] + a[3] * misses[3]);
        }
        self.cost += misses.iter().map(|miss| miss * miss).sum::<f64>();
        batch.filled = 0;
    }

    /// Moves the last `window` numbers to the front, where a model has them.
    fn window_first(&mut self, window: usize) {
        let n = self.n;
        let mut moved = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                let (a, b) = ((i + window) % n, (j + window) % n);
                moved[a.max(b) * n + a.min(b)] = self.matrix[i * n + j];
            }
        }
        self.matrix = moved;
        self.gradient.rotate_right(window);
    }
}

/// (JᵀJ + damping · its diagonal) step = Jᵀr; `None` when the matrix is not positive definite.
fn solve(normal: &Normal, damping: f64) -> Option<Vec<f64>> {
    let n = normal.n;
    let mut matrix = normal.matrix.clone();
    let floor = (0..n).map(|i| matrix[i * n + i]).fold(0.0, f64::max) * 1e-12;
    for i in 0..n {
        matrix[i * n + i] += damping * matrix[i * n + i] + floor;
    }
    solve_positive(&mut matrix, normal.gradient.clone())
}

/// x of matrix · x = right by Cholesky's factors, which replace the matrix; its lower triangle alone is
/// read. `None` when it is not positive definite.
pub fn solve_positive(matrix: &mut [f64], right: Vec<f64>) -> Option<Vec<f64>> {
    let n = right.len();
    let mut x = right;
    for i in 0..n {
        for j in 0..=i {
            let (above, row) = matrix.split_at(i * n);
            let other = if j < i { &above[j * n..j * n + j] } else { &row[..j] };
            let dot: f64 = row[..j].iter().zip(other).map(|(a, b)| a * b).sum();
            let value = matrix[i * n + j] - dot;
            if j < i {
                matrix[i * n + j] = value / matrix[j * n + j];
            } else if value > 0.0 && value.is_finite() {
                matrix[i * n + i] = libm::sqrt(value);
            } else {
                return None;
            }
        }
        let known: f64 = (0..i).map(|j| matrix[i * n + j] * x[j]).sum();
        x[i] = (x[i] - known) / matrix[i * n + i];
    }
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|j| matrix[j * n + i] * x[j]).sum();
        x[i] = (x[i] - known) / matrix[i * n + i];
    }
    x.iter().all(|value| value.is_finite()).then_some(x)
}

/// Most a window's number may move in one step.
const WINDOW_STEP: f64 = 0.5;

fn advance(model: &mut Model, step: &[f64], samples: &Samples, free: Free) {
    let mut step = step.iter().copied();
    let mut next = || step.next().unwrap_or(0.0);
    if free.window {
        model.window.iter_mut().for_each(|value| *value += next().clamp(-WINDOW_STEP, WINDOW_STEP));
        model.shape.confine(&mut model.window, &samples.extent);
    }
    model.constant = (model.constant + next()).clamp(-7.9, 7.9);
    for wave in &mut model.waves[free.first_term..] {
        if free.frequencies {
            for axis in 0..2 {
                let most = 0.5 * samples.extent.size[axis];
                wave.frequency[axis] = (wave.frequency[axis] + next()).clamp(-most, most);
            }
        }
        wave.factors.iter_mut().for_each(|factor| *factor += next());
    }
}
