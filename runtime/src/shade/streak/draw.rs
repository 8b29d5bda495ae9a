//! The inner loops: lines of pixels across a kernel.
//!
//! F = ∫ T(t) W(x − t) S(x − t) dt, T the pixel's shadow, W the window, S the cosines, expanded about the
//! pixel's centre: H·S + ρ·H′·S′, with H = T ∗ W read from tables and S already weakened as T weakens each
//! of its frequencies. ρ H′ is where the visible part of an edge pixel has its centre: σ² for slow waves,
//! and for a wave of frequency k that T weakens to T̂ the ρ = (T̂⁻² − 1)/k² that keeps its whole light.

use super::edge::{LANES, NARROWEST_BOX, PIXEL_VARIANCE};
use super::frame::Weigh;
use super::prepare::{Cosines, Term};
use super::{Pose, Tile};
use std::f64::consts::{PI, TAU};

/// Radians a pixel below which a wave is as good as level.
const SLOW: f64 = 1e-2;
/// Square of the weakest wave whose whole light is kept; patterns that need less are drawn thin.
const FAINTEST: f64 = 0.1;

/// A term along a line of pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wave {
    /// amplitude · e^{iθ} at the first pixel of the line.
    state: [f32; 2],
    /// Turns from one line to the next, without and with one pixel's step along it.
    turns: [[f32; 2]; 2],
    /// e^{i·lane·δ}: cosines, then sines.
    lanes: [[f32; LANES]; 2],
    /// e^{i·LANES·δ}.
    chunk: [f32; 2],
    /// Radians per pixel across, times ρ.
    rate: f32,
}

impl Wave {
    /// A term at the place `start` of a kernel, pixels across and along; lines move by `least_move` pixels or one more.
    fn new(term: &Term, lines: &Lines, pose: &Pose, start: [f64; 2], least_move: i32) -> Self {
        let per_pixel = [0, 1].map(|axis| term.frequency[axis] / pose.scale[axis]);
        let turns = |step: [f64; 2]| per_pixel[0] * step[0] + per_pixel[1] * step[1];
        // Frequency in the frame: what a pixel, a square of side 1, leaves of it.
        let left = sinc(turns(lines.step)) * sinc(turns(lines.line_step));
        // The wave across alone, which meets the sides: what a pixel leaves of it, and where its light is.
        let side = |step: f64| sinc(per_pixel[0] * step);
        let across = side(lines.step[0]) * side(lines.line_step[0]);
        let wave_number = TAU * per_pixel[0];
        let rate = if wave_number.abs() < SLOW {
            wave_number * f64::from(PIXEL_VARIANCE)
        } else {
            (1.0 / (across * across).max(FAINTEST) - 1.0) / wave_number
        };
        let start = unit(turns(start) + term.turns);
        let (fast, slow) = (turns(lines.step), turns(lines.line_step));
        let lane = unit(fast);
        let mut wave = Self {
            state: start.map(|part| part * term.amplitude * left as f32),
            turns: [0, 1].map(|extra| unit(slow + f64::from(least_move + extra) * fast)),
            rate: rate as f32,
            ..Self::default()
        };
        let mut turned = [1.0, 0.0];
        for i in 0..LANES {
            wave.lanes[0][i] = turned[0];
            wave.lanes[1][i] = turned[1];
            turned = product(turned, lane);
        }
        wave.chunk = turned;
        wave
    }
}

/// Where lines of pixels meet a kernel: rows if it is rather upright, columns if it is rather level.
pub(super) struct Lines {
    /// Frame axis along a line, and from line to line.
    fast: usize,
    slow: usize,
    /// Pixels gained across and along per step along a line.
    step: [f64; 2],
    /// The same from line to line.
    line_step: [f64; 2],
    /// Place on the fast axis where line 0 meets the light, and its gain from line to line.
    entry: [f64; 2],
    /// The picture's corner, on the fast and slow axis.
    corner: [f64; 2],
    /// First and one past the last pixel of the clip, on the fast and slow axis.
    clip: [[i32; 2]; 2],
    /// Pixels of the longest line.
    count: usize,
}

impl Lines {
    /// Lines of `clip` (frame axes) that may meet light between the ends `across`, in pixels.
    pub(super) fn new(pose: &Pose, across: [f64; 2], clip: [[i32; 2]; 2]) -> Self {
        let (fast, slow) = if pose.along[1].abs() >= pose.along[0].abs() { (0, 1) } else { (1, 0) };
        let step = [pose.across[fast], pose.along[fast]];
        let line_step = [pose.across[slow], pose.along[slow]];
        let corner = [pose.corner[fast], pose.corner[slow]];
        // A pixel's shadow reaches half of |cos θ| + |sin θ|.
        let shadow = 0.5 * (step[0].abs() + line_step[0].abs().max(NARROWEST_BOX));
        let ends = [across[0] - shadow, across[1] + shadow];
        let nearer = if step[0] > 0.0 { ends[0] } else { ends[1] };
        let move_by = -line_step[0] / step[0];
        let at_line_0 = nearer / step[0] + move_by * (0.5 - corner[1]) + corner[0] - 0.5;
        Self {
            fast,
            slow,
            step,
            line_step,
            entry: [at_line_0, move_by],
            corner,
            clip: [clip[fast], clip[slow]],
            count: ((ends[1] - ends[0]) / step[0].abs()).ceil() as usize,
        }
    }

    /// First pixel of a line: where the line meets the nearer end of the light.
    fn entry(&self, line: i32) -> i32 {
        let place = self.entry[0] + self.entry[1] * f64::from(line);
        let whole = place as i32;
        whole + i32::from(place > f64::from(whole))
    }

    /// Pixels across and along, from the picture's corner to the centre of a pixel.
    fn place(&self, pixel: i32, line: i32) -> [f64; 2] {
        let at = [f64::from(pixel) + 0.5 - self.corner[0], f64::from(line) + 0.5 - self.corner[1]];
        [0, 1].map(|axis| self.step[axis] * at[0] + self.line_step[axis] * at[1])
    }

    /// Where in the tile pixel `from` of a line is, and how far it is to the next one.
    fn index(&self, tile: &Tile, line: i32, from: i32) -> (usize, usize) {
        let strides = [1, tile.width];
        let along = (from - tile.origin[self.fast]) as usize * strides[self.fast];
        (along + (line - tile.origin[self.slow]) as usize * strides[self.slow], strides[self.fast])
    }
}

#[inline]
fn add_to_line(pixels: &mut [f32], stride: usize, lights: &[f32]) {
    if stride == 1 {
        pixels.iter_mut().zip(lights).for_each(|(pixel, light)| *pixel += light);
    } else {
        pixels.iter_mut().step_by(stride).zip(lights).for_each(|(pixel, light)| *pixel += light);
    }
}

/// Draws a kernel whose width is resolved.
pub(super) fn draw<W: Weigh>(
    lines: &Lines,
    pose: &Pose,
    cosines: Option<&Cosines>,
    frame: &W,
    tile: &mut Tile,
    waves: &mut Vec<Wave>,
) {
    let chunks = lines.count.div_ceil(LANES);
    let first_line = lines.clip[1][0];
    let mut begin = lines.entry(first_line);
    let least_move = lines.entry[1].floor() as i32;
    waves.clear();
    let mut constant = 1.0;
    if let Some(cosines) = cosines {
        constant = cosines.constant;
        let start = lines.place(begin, first_line);
        waves.extend(cosines.terms.iter().map(|term| Wave::new(term, lines, pose, start, least_move)));
    }
    let [across_step, along_step] = lines.step.map(|step| step as f32);
    for line in first_line..lines.clip[1][1] {
        let [across, along] = lines.place(begin, line).map(|place| place as f32);
        let last = begin.saturating_add(lines.count as i32).min(lines.clip[0][1]);
        for chunk in 0..chunks {
            let left = begin + (chunk * LANES) as i32;
            let (from, to) = (lines.clip[0][0].max(left), last.min(left + LANES as i32));
            if from >= to {
                continue;
            }
            let mut sums = [constant; LANES];
            let mut slopes = [0.0; LANES];
            for wave in waves.iter() {
                let mut state = wave.state;
                for _ in 0..chunk {
                    state = product(state, wave.chunk);
                }
                let [cos, sin] = &wave.lanes;
                let turned = [-wave.rate * state[1], wave.rate * state[0]];
                for lane in 0..LANES {
                    sums[lane] += state[0] * cos[lane] - state[1] * sin[lane];
                    slopes[lane] += turned[0] * cos[lane] - turned[1] * sin[lane];
                }
            }
            let offset = (chunk * LANES) as f32;
            let place = [across + across_step * offset, along + along_step * offset];
            let [weights, rises] = frame.weights(place, [across_step, along_step]);
            for lane in 0..LANES {
                sums[lane] = pose.weight * (weights[lane] * sums[lane] + rises[lane] * slopes[lane]);
            }
            let (index, stride) = lines.index(tile, line, from);
            let lanes = (from - left) as usize..(to - left) as usize;
            add_to_line(&mut tile.alpha[index..], stride, &sums[lanes]);
        }
        // On to the next line: the entry moves by one of two whole numbers of pixels. Held to them, so that
        // the pixel and the phase cannot part where a division rounds to the other side of a whole number.
        let extra = usize::from(lines.entry(line + 1) - begin > least_move);
        for wave in waves.iter_mut() {
            wave.state = product(wave.state, wave.turns[extra]);
        }
        begin += least_move + extra as i32;
    }
}

/// e^{2πi·turns}.
fn unit(turns: f64) -> [f32; 2] {
    let (sin, cos) = libm::sincosf((TAU * (turns - turns.round())) as f32);
    [cos, sin]
}

#[inline]
fn product(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

/// sin(πx)/(πx).
fn sinc(x: f64) -> f64 {
    let y = PI * x;
    if y.abs() < 1e-4 { 1.0 - y * y / 6.0 } else { libm::sin(y) / y }
}
