//! How one streak's coverage lies on pixels.

/// A streak's place in the picture, and nothing else: what a kernel draws.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Where the drop is in the middle of the exposure, px; pixel (i, j) has its centre at (i + ½, j + ½).
    pub centre: [f64; 2],
    /// Unit vector from where the drop was when the shutter opened to where it was when it closed.
    pub axis: [f64; 2],
    /// Path of the drop's centre, px, ≥ 0; the drawn streak is longer by one width.
    pub length: f64,
    /// The drop's diameter, px, > 0; often well below 1.
    pub width: f64,
    /// Which pattern: uniform 32 bits, the same for a drop's whole life.
    pub pattern: u32,
}

/// Draws footprints. The rain multiplies what a kernel returns with the streak's whole coverage, so that a
/// kernel decides where coverage lies and physics how much there is.
pub trait Kernel: Sync {
    /// What is worked out once per streak and tile.
    type Prepared;

    /// Prepares a footprint.
    fn prepare(&self, footprint: &Footprint) -> Self::Prepared;

    /// Half extents of the kernel along and across the axis, px; outside this box it is zero.
    fn reach(&self, prepared: &Self::Prepared) -> [f64; 2];

    /// Share of the streak's coverage on the pixels with centres (x, y), (x + 1, y), …, one per place of
    /// `out`. Already filtered for pixels, ≥ 0; over the whole plane the shares add up to 1. Spans are a few
    /// pixels long; `out` is longer than needed where that makes its length a multiple of four.
    fn span(&self, prepared: &Self::Prepared, x: f64, y: f64, out: &mut [f32]);
}

/// The streak of a drop that neither oscillates nor refracts: even along its path, smooth at its edges.
///
/// Across it is a parabola with the variance of a disc's chord, seen through the tent filter of a pixel, in
/// closed form. Tents of neighbouring pixels add up to 1, so an upright streak, however thin, covers the same
/// wherever it lies between two pixels. Its ends are soft by the same measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SmoothWindow;

impl SmoothWindow {
    /// Half width of the parabola over the drop's width: variances a²/5 and width²/16 agree.
    const PARABOLA: f64 = 0.559_016_994_374_947_4;
    /// ∫ (1 − t²)³ over −1…1.
    const AREA: f64 = 32.0 / 35.0;
    /// A dot is a streak this short, and a drop this thin, px.
    const LEAST: f64 = 1e-3;

    /// Integral of the ends' window (1 − t²)³ from −∞ to t, over its whole area.
    #[inline(always)]
    fn integral(t: f32) -> f32 {
        let t = if t > -1.0 { t } else { -1.0 };
        let t = if t < 1.0 { t } else { 1.0 };
        let t2 = t * t;
        0.5 + t * (1.0 - t2 * (1.0 - t2 * (0.6 - t2 * (1.0 / 7.0)))) * (1.0 / Self::AREA as f32)
    }
}

/// A [`SmoothWindow`]'s footprint with its divisions done.
#[derive(Clone, Copy, Debug)]
pub struct PreparedWindow {
    centre: [f64; 2],
    axis: [f64; 2],
    half_length: f64,
    /// Half width of the ends' window, px, and its inverse.
    end: f64,
    per_end: f64,
    /// How far from the middle the ends' windows begin, in units of them.
    inner: f32,
    /// Half width a of the parabola, px, and the three coefficients of its second integral.
    parabola: [f32; 4],
    /// Coverage per pixel of length.
    peak: f32,
}

impl Kernel for SmoothWindow {
    type Prepared = PreparedWindow;

    fn prepare(&self, footprint: &Footprint) -> PreparedWindow {
        let a = (Self::PARABOLA * footprint.width).max(Self::LEAST);
        // Variances add: end²/9 for the window, a²/5 for the drop, 1/6 for the tent.
        let end = (9.0 * (a * a / 5.0 + 1.0 / 6.0)).sqrt();
        let half_length = 0.5 * footprint.length.max(Self::LEAST);
        let parabola = [a, 3.0 * a / 16.0, 3.0 / (8.0 * a), -1.0 / (16.0 * a * a * a)];
        PreparedWindow {
            centre: footprint.centre,
            axis: footprint.axis,
            half_length,
            end,
            per_end: 1.0 / end,
            inner: (half_length / end - 1.0) as f32,
            parabola: parabola.map(|value| value as f32),
            peak: (0.5 / half_length) as f32,
        }
    }

    fn reach(&self, prepared: &PreparedWindow) -> [f64; 2] {
        [prepared.half_length + prepared.end, f64::from(prepared.parabola[0]) + 1.0]
    }

    #[inline(always)]
    fn span(&self, prepared: &PreparedWindow, x: f64, y: f64, out: &mut [f32]) {
        let [ux, uy] = prepared.axis;
        let (dx, dy) = (x - prepared.centre[0], y - prepared.centre[1]);
        let across = [(dx * uy - dy * ux) as f32, uy as f32];
        // Along the streak in units of its ends' window.
        let along = [(dx * ux + dy * uy) * prepared.per_end, ux * prepared.per_end].map(|v| v as f32);
        // Most spans are one block; the rest is elsewhere, so that no loop over blocks is set up for them.
        match out.split_first_chunk_mut::<LANES>() {
            Some((block, [])) => prepared.fill(across, along, block),
            _ => prepared.fill_all(across, along, out),
        }
    }
}

/// Pixels that one pass of the compiled code works on.
const LANES: usize = 4;

impl PreparedWindow {
    #[inline(always)]
    fn fill(&self, across: [f32; 2], along: [f32; 2], block: &mut [f32; LANES]) {
        for lane in 0..LANES {
            block[lane] = self.cross(across[0] + lane as f32 * across[1]);
        }
        let last = along[0] + LANES as f32 * along[1];
        if along[0].abs() > self.inner || last.abs() > self.inner {
            for lane in 0..LANES {
                block[lane] *= self.cut(along[0] + lane as f32 * along[1]);
            }
        }
    }

    #[inline(never)]
    fn fill_all(&self, mut across: [f32; 2], mut along: [f32; 2], out: &mut [f32]) {
        for chunk in out.chunks_mut(LANES) {
            let mut block = [0.0; LANES];
            self.fill(across, along, &mut block);
            chunk.copy_from_slice(&block[..chunk.len()]);
            across[0] += LANES as f32 * across[1];
            along[0] += LANES as f32 * along[1];
        }
    }

    /// Share of the streak's full coverage `along` from its middle: 1 but for the soft ends.
    #[inline(always)]
    fn cut(&self, along: f32) -> f32 {
        let (along, half) = (along.abs(), self.inner + 1.0);
        SmoothWindow::integral(along + half) - SmoothWindow::integral(along - half)
    }

    /// The streak's cross-section `y` pixels off its axis: the tent is the second difference of the second
    /// integral.
    #[inline(always)]
    fn cross(&self, y: f32) -> f32 {
        let value = self.second(y - 1.0) - 2.0 * self.second(y) + self.second(y + 1.0);
        // Round-off must not go below zero.
        if value > 0.0 { self.peak * value } else { 0.0 }
    }

    /// Second integral of the parabola of unit area: 3a/16 + 3y²/(8a) − y⁴/(16a³) for |y| ≤ a, |y|/2 beyond.
    #[inline(always)]
    fn second(&self, y: f32) -> f32 {
        let [a, c0, c2, c4] = self.parabola;
        let y = y.abs();
        let inner = if y < a { y } else { a };
        let square = inner * inner;
        c0 + square * (c2 + square * c4) + 0.5 * (y - inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn sum(footprint: &Footprint) -> f64 {
        let prepared = SmoothWindow.prepare(footprint);
        let mut row = vec![0.0f32; 400];
        let mut sum = 0.0;
        for y in 0..400 {
            SmoothWindow.span(&prepared, 0.5, f64::from(y) + 0.5, &mut row);
            sum += row.iter().map(|&v| f64::from(v)).sum::<f64>();
        }
        sum
    }

    #[test]
    fn coverage_adds_up_to_one_wherever_the_streak_lies() {
        let mut random = Random::new(3);
        for _ in 0..300 {
            let angle = random.range(0.0, 7.0);
            let footprint = Footprint {
                centre: [random.range(199.0, 201.0), random.range(199.0, 201.0)],
                axis: [libm::cos(angle), libm::sin(angle)],
                length: random.range(0.0, 200.0),
                width: random.range(0.1, 9.0),
                pattern: 0,
            };
            // Tents add up exactly along the pixel axes alone; a turned dot is the worst.
            assert!((sum(&footprint) - 1.0).abs() < 0.03, "{footprint:?}: {}", sum(&footprint));
        }
    }

    #[test]
    fn an_upright_thin_streak_never_flickers_as_it_moves_sideways() {
        for width in [0.01, 0.4, 0.8, 1.6, 4.0] {
            for step in 0..10 {
                let centre = [200.0 + 0.1 * f64::from(step), 200.3];
                let footprint = Footprint { centre, axis: [0.0, 1.0], length: 50.0, width, pattern: 0 };
                let sum = sum(&footprint);
                // Only the soft ends are sampled inexactly, and numbers are single precision.
                assert!((sum - 1.0).abs() < 1e-3, "width {width}, step {step}: {sum}");
            }
        }
    }

    #[test]
    fn nothing_lies_outside_the_reach() {
        let footprint =
            Footprint { centre: [200.0, 200.0], axis: [0.6, 0.8], length: 80.0, width: 3.0, pattern: 0 };
        let prepared = SmoothWindow.prepare(&footprint);
        let [along, across] = SmoothWindow.reach(&prepared);
        let mut row = vec![0.0f32; 400];
        for y in 0..400 {
            SmoothWindow.span(&prepared, 0.5, f64::from(y) + 0.5, &mut row);
            for (x, &value) in row.iter().enumerate() {
                let (dx, dy) = (x as f64 - 199.5, f64::from(y) - 199.5);
                let outside = (dx * 0.6 + dy * 0.8).abs() > along || (dx * 0.8 - dy * 0.6).abs() > across;
                // A second difference leaves round-off of single precision.
                assert!(value >= 0.0 && !(outside && value > 1e-7));
            }
        }
    }
}
