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
    /// `out`. Already filtered for pixels, ≥ 0; over the whole plane the shares add up to 1.
    fn span(&self, prepared: &Self::Prepared, x: f64, y: f64, out: &mut [f32]);
}

/// The streak of a drop that neither oscillates nor refracts: even along its path, smooth at its edges.
///
/// Across it is the window (1 − t²)³, which has the variance of a disc's chord plus that of a pixel filter.
/// Its half width never falls below [`SmoothWindow::MIN_REACH`], where the window's spectrum has its zero at
/// one cycle per pixel: then the samples add up to the same wherever the streak lies between two pixels, and
/// to within 3 % for wider ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SmoothWindow;

impl SmoothWindow {
    /// First zero of the window's spectrum, that of the spherical Bessel function j₃: 6.988 / 2π pixels.
    pub const MIN_REACH: f64 = 1.1122;
    /// ∫ (1 − t²)³ over −1…1.
    const AREA: f64 = 32.0 / 35.0;
    /// A dot is a streak this short, px.
    const LEAST_LENGTH: f64 = 1e-3;

    /// Integral of the window from −∞ to t, over its whole area.
    fn integral(t: f32) -> f32 {
        let t = t.clamp(-1.0, 1.0);
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
    reach: f64,
    per_reach: f64,
    /// Coverage per square pixel on the axis, halfway.
    peak: f64,
}

impl Kernel for SmoothWindow {
    type Prepared = PreparedWindow;

    fn prepare(&self, footprint: &Footprint) -> PreparedWindow {
        let length = footprint.length.max(Self::LEAST_LENGTH);
        // Variances add: reach²/9 for the window, width²/16 for a disc's chord.
        let chord2 = 9.0 / 16.0 * footprint.width * footprint.width;
        let reach = (Self::MIN_REACH * Self::MIN_REACH + chord2).sqrt();
        PreparedWindow {
            centre: footprint.centre,
            axis: footprint.axis,
            half_length: 0.5 * length,
            reach,
            per_reach: 1.0 / reach,
            peak: 1.0 / (length * reach * Self::AREA),
        }
    }

    fn reach(&self, prepared: &PreparedWindow) -> [f64; 2] {
        [prepared.half_length + prepared.reach, prepared.reach]
    }

    #[inline(always)]
    fn span(&self, prepared: &PreparedWindow, x: f64, y: f64, out: &mut [f32]) {
        let PreparedWindow { centre, axis: [ux, uy], half_length, per_reach, peak, .. } = *prepared;
        let (dx, dy) = (x - centre[0], y - centre[1]);
        // In units of the reach, where single precision has room to spare.
        let across = ((dx * uy - dy * ux) * per_reach) as f32;
        let along = ((dx * ux + dy * uy) * per_reach) as f32;
        let [across_step, along_step] = [(uy * per_reach) as f32, (ux * per_reach) as f32];
        let half = (half_length * per_reach) as f32;
        let peak = peak as f32;
        for (i, out) in out.iter_mut().enumerate() {
            let t = across + i as f32 * across_step;
            let window = (1.0 - t * t).max(0.0);
            *out = peak * window * window * window;
        }
        let last = along + (out.len() as f32 - 1.0) * along_step;
        if along.abs().max(last.abs()) > half - 1.0 {
            for (i, out) in out.iter_mut().enumerate() {
                let s = (along + i as f32 * along_step).abs();
                *out *= Self::integral(s + half) - Self::integral(s - half);
            }
        }
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
            // A dot samples the window along both axes, each with its 3 %.
            assert!((sum(&footprint) - 1.0).abs() < 0.06, "{footprint:?}: {}", sum(&footprint));
        }
    }

    #[test]
    fn an_upright_thin_streak_never_flickers_as_it_moves_sideways() {
        for width in [0.05, 0.4, 0.8, 1.6, 4.0] {
            let mut mean = 0.0;
            for step in 0..10 {
                let centre = [200.0 + 0.1 * f64::from(step), 200.3];
                let footprint = Footprint { centre, axis: [0.0, 1.0], length: 50.0, width, pattern: 0 };
                let sum = sum(&footprint);
                assert!((sum - 1.0).abs() < 0.03, "width {width}, step {step}: {sum}");
                mean += 0.1 * sum;
            }
            // Over all places between two pixels nothing is left but the ends, and round-off of f32.
            assert!((mean - 1.0).abs() < 5e-4, "width {width}: {mean}");
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
                assert!(value >= 0.0 && !(outside && value > 0.0));
            }
        }
    }
}
