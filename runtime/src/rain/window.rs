//! The kernel for an asset without patterns: a plain streak.

use super::kernel::{Clip, Footprint, Kernel, Span};

/// The streak of a drop that neither oscillates nor refracts: even along its path, smooth at its edges.
///
/// Across it is a parabola with the variance of a disc's chord, seen through the tent filter of a pixel, in
/// closed form. Tents of neighbouring pixels add up to 1, so an upright streak, however thin, covers the same
/// wherever it lies between two pixels. Its ends are those of a swept disc: at each place across, the chord there and a
/// pixel, by their variances; a drop nearer than its streak is long has round ends, and the light of every column is exact.
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
struct FootprintWindow {
    half_length: f64,
    /// Half width of the ends' window in the middle, px, and the square of the drop's radius.
    end: f64,
    radius2: f32,
    /// How far from the middle the ends' windows begin, px.
    inner: f32,
    /// Half width a of the parabola, px, and the three coefficients of its second integral.
    parabola: [f32; 4],
    /// Coverage per pixel of length.
    peak: f32,
}

impl Kernel for SmoothWindow {
    type Scratch = ();

    type Placed = Footprint;

    fn place(&self, footprint: &Footprint) -> Option<(Clip, Footprint)> {
        let [ux, uy] = footprint.axis.map(f64::abs);
        let [along, across] = FootprintWindow::new(footprint).radii();
        let half = [along * ux + across * uy, along * uy + across * ux];
        // Casts saturate; a pixel more on each side covers their rounding toward zero.
        let edge = |axis: usize, side: f64| (footprint.centre[axis] + side * (half[axis] + 1.0)) as i32;
        let clip =
            Clip { left: edge(0, -1.0), top: edge(1, -1.0), right: edge(0, 1.0), bottom: edge(1, 1.0) };
        Some((clip, *footprint))
    }

    fn sees_light(&self) -> bool {
        false
    }

    #[inline(always)]
    fn draw(&self, footprint: &Footprint, clip: Clip, _: &mut (), put: &mut impl FnMut(Span)) {
        let window = FootprintWindow::new(footprint);
        let [ux, uy] = footprint.axis;
        let (left, top) = (f64::from(clip.left) + 0.5, f64::from(clip.top) + 0.5);
        let mut intervals = Intervals::new(footprint, window.radii(), clip);
        let mut shares = [0.0; LONGEST];
        for row in intervals.first_row..intervals.end_row {
            let (mut first, end) = intervals.next_row();
            while first < end {
                let count = (end - first).min(LONGEST as i32);
                let dx = left + f64::from(first) - footprint.centre[0];
                let dy = top + f64::from(row) - footprint.centre[1];
                let across = [(dx * uy - dy * ux) as f32, uy as f32];
                let along = [(dx * ux + dy * uy) as f32, ux as f32];
                let (x, y) = (clip.left + first, clip.top + row);
                // Most spans are one block. Longer ones go elsewhere, so that the compiler does not set up a
                // loop over many blocks for each of them.
                if count as usize <= LANES {
                    let mut block = [0.0; LANES];
                    window.fill(across, along, &mut block);
                    put(Span { x, y, count: count as usize, shares: &block, covers: None });
                } else {
                    window.fill_all(across, along, count as usize, &mut shares);
                    put(Span { x, y, count: count as usize, shares: &shares, covers: None });
                }
                first += count;
            }
        }
    }
}

/// Pixels that one pass of the compiled code works on.
const LANES: usize = 4;
/// Longest span, a multiple of [`LANES`].
const LONGEST: usize = 64;

impl FootprintWindow {
    fn new(footprint: &Footprint) -> Self {
        let a = (SmoothWindow::PARABOLA * footprint.width).max(SmoothWindow::LEAST);
        // Variances add: end²/9 for the window, a third of the half chord's square for the drop, 1/6 for the tent.
        let radius2 = 0.25 * footprint.width * footprint.width;
        let end = (9.0 * (radius2 / 3.0 + 1.0 / 6.0)).sqrt();
        let half_length = 0.5 * footprint.length.max(SmoothWindow::LEAST);
        let parabola = [a, 3.0 * a / 16.0, 3.0 / (8.0 * a), -1.0 / (16.0 * a * a * a)];
        Self {
            half_length,
            end,
            radius2: radius2 as f32,
            inner: (half_length - end) as f32,
            parabola: parabola.map(|value| value as f32),
            peak: (0.5 / half_length) as f32,
        }
    }

    /// Half extents along and across the streak, px.
    fn radii(&self) -> [f64; 2] {
        [self.half_length + self.end, f64::from(self.parabola[0]) + 1.0]
    }

    #[inline(always)]
    fn fill(&self, across: [f32; 2], along: [f32; 2], block: &mut [f32; LANES]) {
        for lane in 0..LANES {
            block[lane] = self.cross(across[0] + lane as f32 * across[1]);
        }
        let last = along[0] + LANES as f32 * along[1];
        if along[0].abs() > self.inner || last.abs() > self.inner {
            for lane in 0..LANES {
                let offset = lane as f32;
                block[lane] *= self.cut(across[0] + offset * across[1], along[0] + offset * along[1]);
            }
        }
    }

    #[inline(never)]
    fn fill_all(&self, across: [f32; 2], along: [f32; 2], count: usize, out: &mut [f32; LONGEST]) {
        let (blocks, _) = out.as_chunks_mut::<LANES>();
        for (index, block) in blocks.iter_mut().take(count.div_ceil(LANES)).enumerate() {
            let first = (index * LANES) as f32;
            self.fill(
                [across[0] + first * across[1], across[1]],
                [along[0] + first * along[1], along[1]],
                block,
            );
        }
    }

    /// Share of the streak's full coverage `across` and `along` from its middle: 1 but for the soft ends.
    #[inline(always)]
    fn cut(&self, across: f32, along: f32) -> f32 {
        let (along, half) = (along.abs(), self.half_length as f32);
        let chord2 = self.radius2 - across * across;
        let chord2 = if chord2 > 0.0 { chord2 } else { 0.0 };
        let per_end = 1.0 / (3.0 * chord2 + 1.5).sqrt();
        let left = SmoothWindow::integral((along + half) * per_end)
            - SmoothWindow::integral((along - half) * per_end);
        // Round-off must not go below zero.
        if left > 0.0 { left } else { 0.0 }
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

/// Columns of a clip that a turned box covers, row after row, in fixed point: no rounding of a float per row.
///
/// The box is the overlap of two strips, along and across the streak; each strip's overlap with a row is an
/// interval whose two ends move by the same slope from row to row.
struct Intervals {
    first_row: i32,
    end_row: i32,
    width: i64,
    /// Per strip: first x and end x in the row at hand, and their slope.
    strips: [[i64; 3]; 2],
}

impl Intervals {
    /// Fraction bits; what is left of 64 holds 5e11 pixels, more than a strip almost along the rows can reach.
    const BITS: u32 = 24;
    const ONE: f64 = (1u64 << Self::BITS) as f64;
    const FARTHEST: f64 = 1e11;

    fn new(footprint: &Footprint, [along, across]: [f64; 2], clip: Clip) -> Self {
        let [ux, uy] = footprint.axis;
        let (x, y) = (footprint.centre[0] - f64::from(clip.left), footprint.centre[1] - f64::from(clip.top));
        let [width, height] = [clip.right - clip.left, clip.bottom - clip.top].map(|size| size.max(0));
        let half_height = along * uy.abs() + across * ux.abs();
        // Rows whose centres lie within the box: casts round toward zero, so from zero up they round down.
        let row = |y: f64| (y + 0.5).clamp(0.0, f64::from(height)) as i32;
        let (first_row, end_row) = (row(y - half_height), row(y + half_height));
        let dy = f64::from(first_row) + 0.5 - y;
        // |n dx + m dy| ≤ radius
        let strip = |n: f64, m: f64, radius: f64| {
            let per_n = 1.0 / n;
            // Along the rows a strip bounds nothing that the rows do not.
            let (slope, half) =
                if n.abs() > 1e-6 { (-m * per_n, radius * per_n.abs()) } else { (0.0, Self::FARTHEST) };
            let middle = x + slope * dy;
            let far = |value: f64| value.clamp(-2.0 * Self::FARTHEST, 2.0 * Self::FARTHEST);
            [far(middle - half + 0.5), far(middle + half + 0.5), slope]
                .map(|value| (value * Self::ONE) as i64)
        };
        Self {
            first_row,
            end_row,
            width: i64::from(width),
            strips: [strip(uy, -ux, across), strip(ux, uy, along)],
        }
    }

    /// First and end column of the row at hand, and on to the next row.
    #[inline(always)]
    fn next_row(&mut self) -> (i32, i32) {
        let [[first, end, slope], [first2, end2, slope2]] = &mut self.strips;
        let low = (*first).max(*first2) >> Self::BITS;
        let high = (*end).min(*end2) >> Self::BITS;
        *first += *slope;
        *end += *slope;
        *first2 += *slope2;
        *end2 += *slope2;
        // Within the clip's width, and so within 32 bits; an empty interval stays empty.
        (low.clamp(0, self.width) as i32, high.clamp(0, self.width) as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const ALL: Clip = Clip { left: 0, top: 0, right: 400, bottom: 400 };

    /// What lands in a picture of 400 × 400 pixels; each pixel may be put once.
    fn pixels(footprint: &Footprint, clip: Clip) -> Vec<f32> {
        let mut pixels = vec![f32::NAN; 400 * 400];
        SmoothWindow.draw(footprint, clip, &mut (), &mut |span| {
            assert!(
                span.x >= clip.left && span.x + span.count as i32 <= clip.right && span.shares.len() % 4 == 0
            );
            for (i, &share) in span.shares[..span.count].iter().enumerate() {
                let pixel = &mut pixels[span.y as usize * 400 + span.x as usize + i];
                assert!(pixel.is_nan());
                *pixel = share;
            }
        });
        pixels.into_iter().map(|value| if value.is_nan() { 0.0 } else { value }).collect()
    }

    fn sum(footprint: &Footprint) -> f64 {
        pixels(footprint, ALL).iter().map(|&v| f64::from(v)).sum()
    }

    #[test]
    fn a_short_streak_of_a_wide_drop_is_a_swept_disc_with_round_ends() {
        /// Of the disc's own: a window of the chord's variance in place of the chord's hard ends, and a parabola in place of a root.
        const SHAPE: f64 = 0.2;
        /// Light of a corner of the box over that of the middle; a rectangle has about one there.
        const CORNER: f64 = 0.1;
        let (radius, path) = (14.0, 40.0);
        for angle in [0.0, 0.6] {
            let axis = [libm::sin(angle), libm::cos(angle)];
            let footprint = Footprint {
                centre: [200.3, 199.8],
                axis,
                length: path,
                width: 2.0 * radius,
                ..Footprint::default()
            };
            let drawn = pixels(&footprint, ALL);
            // How long the disc stands over a place, over the whole of that for all places.
            let truth = |x: f64, y: f64| {
                let (dx, dy) = (x - 200.3, y - 199.8);
                let (across, along) = (dx * axis[1] - dy * axis[0], dx * axis[0] + dy * axis[1]);
                let chord = (radius * radius - across * across).max(0.0).sqrt();
                let stay = (along + chord).min(0.5 * path) - (along - chord).max(-0.5 * path);
                stay.max(0.0) / (path * std::f64::consts::PI * radius * radius)
            };
            let (mut miss, mut whole) = (0.0, 0.0);
            for (i, &share) in drawn.iter().enumerate() {
                let wanted: f64 = (0..16)
                    .map(|s| {
                        truth(
                            (i % 400) as f64 + (s % 4) as f64 * 0.25 + 0.125,
                            (i / 400) as f64 + (s / 4) as f64 * 0.25 + 0.125,
                        )
                    })
                    .sum::<f64>()
                    / 16.0;
                miss += (f64::from(share) - wanted) * (f64::from(share) - wanted);
                whole += wanted * wanted;
            }
            assert!((miss / whole).sqrt() < SHAPE, "{}", (miss / whole).sqrt());
            let at = |across: f64, along: f64| {
                let x = 200.3 + across * axis[1] + along * axis[0];
                let y = 199.8 - across * axis[0] + along * axis[1];
                f64::from(drawn[y as usize * 400 + x as usize])
            };
            for (side, end) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
                let corner = at(side * 0.85 * radius, end * (0.5 * path + 0.85 * radius));
                assert!(corner < CORNER * at(0.0, 0.0), "{corner}");
            }
        }
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
                ..Footprint::default()
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
                let footprint = Footprint {
                    centre,
                    axis: [0.0, 1.0],
                    length: 50.0,
                    width,
                    pattern: 0,
                    ..Footprint::default()
                };
                let sum = sum(&footprint);
                // Only the soft ends are sampled inexactly, and numbers are single precision.
                assert!((sum - 1.0).abs() < 1e-3, "width {width}, step {step}: {sum}");
            }
        }
    }

    #[test]
    fn a_streak_cut_into_tiles_is_the_same_streak_and_stays_within_its_bounds() {
        let mut random = Random::new(4);
        for _ in 0..50 {
            let angle = random.range(0.0, 7.0);
            let footprint = Footprint {
                centre: [random.range(150.0, 250.0), random.range(150.0, 250.0)],
                axis: [libm::cos(angle), libm::sin(angle)],
                length: random.range(0.0, 90.0),
                width: random.range(0.1, 30.0),
                pattern: 0,
                ..Footprint::default()
            };
            let whole = pixels(&footprint, ALL);
            let mut tiled = vec![0.0; whole.len()];
            for (left, top) in (0..100).map(|i| (40 * (i % 10), 40 * (i / 10))) {
                let tile = pixels(&footprint, Clip { left, top, right: left + 40, bottom: top + 40 });
                tiled.iter_mut().zip(tile).for_each(|(sum, value)| *sum += value);
            }
            let bounds = SmoothWindow.place(&footprint).unwrap().0;
            for (i, (&a, &b)) in whole.iter().zip(&tiled).enumerate() {
                let (x, y) = (i as i32 % 400, i as i32 / 400);
                let within = x >= bounds.left && x < bounds.right && y >= bounds.top && y < bounds.bottom;
                // Steps from another start round differently in single precision.
                assert!((a - b).abs() < 2e-6 && (within || a == 0.0), "{footprint:?} {x} {y}: {a} {b}");
            }
        }
    }
}
