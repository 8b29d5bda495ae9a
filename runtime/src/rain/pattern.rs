//! The kernel for an asset with patterns: each drop's streak is one of the asset's pictures.

use super::kernel::{BLOCK, Clip, Footprint, Kernel, Ribbon, Span};
use super::tile_buffer::{Paint, TileBuffer};
use super::window::SmoothWindow;
use crate::shade::streak::choice::Conditions;
use crate::shade::streak::{self, StreakSet, Tile};

/// Share of the shortest pattern's length over its width below which none of them stands for a streak.
const TOO_SHORT: f64 = 0.5;

/// Working memory for drawing patterns; grows to the largest tile and is then reused.
#[derive(Clone, Debug, Default)]
pub struct PatternScratch {
    /// Light and coverage.
    patch: Vec<f32>,
    column: Vec<f32>,
    streak: streak::Scratch,
}

impl PatternScratch {
    /// Bytes that it holds.
    pub fn bytes(&self) -> usize {
        (self.patch.capacity() + self.column.capacity()) * size_of::<f32>() + self.streak.bytes()
    }
}

/// Draws a footprint as the pattern that [`crate::shade::streak::choice`] picks, or, of a set that says nothing of its pictures, as
/// pattern number `footprint.pattern` modulo their number: the pattern's body takes the
/// drop's whole path, from a radius before its first place to a radius after its last, and its width.
///
/// The pattern's light is divided by its sum, so that shares add up to 1 at any size; what cosines undershoot
/// below zero, a few parts in a thousand of the light, is cut off. Coverage is the drop's disc swept along its path, whatever the
/// pattern: a streak whose light is a fine line hides what is behind all of its band. A set without light is drawn as
/// [`SmoothWindow`]s.
impl Kernel for StreakSet {
    type Scratch = PatternScratch;
    type Placed = PlacedPattern;

    fn place(&self, footprint: &Footprint) -> Option<(Clip, PlacedPattern)> {
        let Some(kernel) = self.of_footprint(footprint) else {
            let (clip, plain) = SmoothWindow.place(footprint)?;
            return Some((clip, PlacedPattern::Plain(plain)));
        };
        let streak = self.placed(&kernel)?;
        let [left, top, right, bottom] = bounds_of(&streak);
        Some((Clip { left, top, right, bottom }, PlacedPattern::Streak(streak)))
    }

    fn draw(
        &self,
        placed: &PlacedPattern,
        clip: Clip,
        scratch: &mut PatternScratch,
        put: &mut impl FnMut(Span),
    ) {
        let streak = match placed {
            PlacedPattern::Plain(plain) => return SmoothWindow.draw(plain, clip, &mut (), put),
            PlacedPattern::Streak(streak) => streak,
        };
        let [left, top, right, bottom] = bounds_of(streak);
        let origin = [left.max(clip.left), top.max(clip.top)];
        let end = [right.min(clip.right), bottom.min(clip.bottom)];
        if end[0] <= origin[0] || end[1] <= origin[1] {
            return;
        }
        self.draw_patch(streak, origin, end, scratch, put);
    }

    fn sees_light(&self) -> bool {
        self.choice().is_some()
    }

    fn ribbon(
        &self,
        placed: &PlacedPattern,
        clip: Clip,
        scratch: &mut PatternScratch,
        ribbon: &mut Ribbon,
    ) -> bool {
        let PlacedPattern::Streak(streak) = placed else { return false };
        self.fill_ribbon(streak, within(streak, clip), &mut scratch.streak, ribbon)
    }

    fn lay(
        &self,
        streaks: &[(PlacedPattern, Paint)],
        scratch: &mut PatternScratch,
        tile_buffer: &mut TileBuffer,
    ) -> usize {
        let clip = tile_buffer.clip();
        let mut lay = |(placed, paint): &(PlacedPattern, Paint)| match placed {
            PlacedPattern::Streak(streak) => {
                self.lay_thin(streak, within(streak, clip), &mut scratch.streak, paint, tile_buffer)
            }
            PlacedPattern::Plain(_) => false,
        };
        streaks.iter().position(|streak| !lay(streak)).unwrap_or(streaks.len())
    }
}

/// Columns and rows that a clip has of a streak's.
fn within(streak: &streak::PlacedStreak, clip: Clip) -> [[i32; 2]; 2] {
    let [left, top, right, bottom] = streak.bounds;
    [[left.max(clip.left), right.min(clip.right)], [top.max(clip.top), bottom.min(clip.bottom)]]
}

/// A footprint's streak.
#[derive(Clone, Copy, Debug)]
pub enum PlacedPattern {
    /// A pattern's.
    Streak(streak::PlacedStreak),
    /// A plain one, where no pattern has light or fits.
    Plain(Footprint),
}

impl Default for PlacedPattern {
    fn default() -> Self {
        Self::Streak(streak::PlacedStreak::default())
    }
}

/// The disc of a drop whose width is resolved, and its path.
fn disc_of(kernel: &streak::StreakPlacement) -> Footprint {
    let direction = kernel.direction.map(f64::from);
    let norm = libm::hypot(direction[0], direction[1]);
    let (length, width) = (f64::from(kernel.length), f64::from(kernel.width));
    Footprint {
        centre: kernel.middle.map(f64::from),
        axis: direction.map(|part| part / norm),
        length: (length - width).max(0.0),
        width,
        ..Footprint::default()
    }
}

/// Pixels that a streak's light or its drop may touch: left, top, right, bottom.
fn bounds_of(placed: &streak::PlacedStreak) -> [i32; 4] {
    let [left, top, right, bottom] = placed.bounds;
    let disc = StreakSet::resolved(placed).and_then(|kernel| SmoothWindow.place(&disc_of(kernel)));
    disc.map_or(placed.bounds, |(own, _)| {
        [left.min(own.left), top.min(own.top), right.max(own.right), bottom.max(own.bottom)]
    })
}

impl StreakSet {
    /// Draws a streak into patches of memory, its light into one and what its drop covers into the other, and hands them on row by row.
    fn draw_patch(
        &self,
        placed: &streak::PlacedStreak,
        origin: [i32; 2],
        end: [i32; 2],
        scratch: &mut PatternScratch,
        put: &mut impl FnMut(Span),
    ) {
        let [width, height] = [0, 1].map(|axis| (end[axis] - origin[axis]) as usize);
        let PatternScratch { patch, column, streak, .. } = scratch;
        for patch in [&mut *patch, &mut *column] {
            patch.clear();
            // The last span's padding may reach past the last row.
            patch.resize(width * height + BLOCK, 0.0);
        }
        match Self::resolved(placed) {
            Some(kernel) => {
                let tile = &mut Tile { origin, width, alpha: &mut patch[..width * height] };
                self.add_placed(placed, tile, streak);
                let clip = Clip { left: origin[0], top: origin[1], right: end[0], bottom: end[1] };
                SmoothWindow.draw(&disc_of(kernel), clip, &mut (), &mut |span| {
                    let at = (span.y - origin[1]) as usize * width + (span.x - origin[0]) as usize;
                    column[at..at + span.count].copy_from_slice(&span.shares[..span.count]);
                });
            }
            None => {
                let tile = &mut Tile { origin, width, alpha: &mut patch[..width * height] };
                self.add_thin(placed, tile, &mut column[..width * height], streak);
            }
        }
        for (row, y) in (0..height).zip(origin[1]..) {
            let line = row * width..(row + 1) * width;
            let (light, cover) = (&patch[line.clone()], &column[line]);
            // A leaning streak is a narrow part of its box.
            let lit = |at: &usize| light[*at] > 0.0 || cover[*at] > 0.0;
            let (Some(first), Some(last)) = ((0..width).find(lit), (0..width).rfind(lit)) else { continue };
            let count = last + 1 - first;
            let from = row * width + first;
            let padded = from..from + count.next_multiple_of(BLOCK);
            // What cosines undershoot below zero is cut off.
            patch[from..from + count].iter_mut().for_each(|share| *share = share.max(0.0));
            column[from..from + count].iter_mut().for_each(|share| *share = share.max(0.0));
            let covers = Some(&column[padded.clone()]);
            put(Span { x: origin[0] + first as i32, y, count, shares: &patch[padded], covers });
        }
    }

    /// The streak that stands for a footprint; `None` where there is no light to draw it with.
    fn of_footprint(&self, footprint: &Footprint) -> Option<streak::StreakPlacement> {
        let pattern = match self.choice() {
            // A long pattern squeezed into a few diameters is a flat rectangle: a swept disc is nearer.
            None if 1.0 + footprint.length / footprint.width < TOO_SHORT * self.shortest_aspect() => {
                return None;
            }
            None => footprint.pattern.checked_rem(self.len() as u32)?,
            Some(choice) => {
                let [light_share, light_angle_deg] = footprint.light;
                let conditions = Conditions {
                    aspect: 1.0 + footprint.length / footprint.width,
                    diameter_mm: footprint.diameter_mm,
                    view_elevation_deg: footprint.elevation_deg,
                    light_share,
                    light_angle_deg,
                };
                choice.pick(&conditions, footprint.pattern)
            }
        };
        let mean = self.mean(pattern);
        let (length, width) = (footprint.length + footprint.width, footprint.width);
        let weight = (1.0 / (length * width * f64::from(mean))) as f32;
        (mean > 0.0 && weight.is_finite()).then(|| streak::StreakPlacement {
            middle: footprint.centre.map(|place| place as f32),
            direction: footprint.axis.map(|part| part as f32),
            length: length as f32,
            width: width as f32,
            pattern,
            weight,
        })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::random::Random;
    use crate::shade::streak::tests::every_kind;
    use squall_formats::section::streak::{Pattern, StreakSection};

    const SIDE: i32 = 320;
    const ALL: Clip = Clip { left: 0, top: 0, right: SIDE, bottom: SIDE };
    /// Linear tables over angle, softness and place, and what is cut off below zero.
    const ENERGY: f64 = 2e-2;

    /// Every kind but the flat window, whose hard border no lattice sums exactly.
    pub(in crate::rain) fn set() -> StreakSet {
        let mut section = every_kind();
        section.patterns.retain(|streak| match &streak.pattern {
            Pattern::Cosines(cosines) => cosines.window != squall_formats::section::streak::Window::Flat,
            Pattern::Separable(_) => true,
        });
        StreakSet::new(&section)
    }

    /// What lands in the picture; each pixel may be put once, inside the clip, and padded.
    fn pixels(set: &StreakSet, footprint: &Footprint, clip: Clip, scratch: &mut PatternScratch) -> Vec<f32> {
        let mut pixels = vec![f32::NAN; (SIDE * SIDE) as usize];
        let Some((_, placed)) = set.place(footprint) else { return vec![0.0; pixels.len()] };
        Kernel::draw(set, &placed, clip, scratch, &mut |span| {
            assert!(span.count >= 1 && span.shares.len() % BLOCK == 0 && span.shares.len() >= span.count);
            assert!(span.x >= clip.left && span.x + span.count as i32 <= clip.right);
            assert!((clip.top..clip.bottom).contains(&span.y));
            for (i, &share) in span.shares[..span.count].iter().enumerate() {
                let pixel = &mut pixels[(span.y * SIDE + span.x) as usize + i];
                assert!(pixel.is_nan() && share >= 0.0);
                *pixel = share;
            }
        });
        pixels.into_iter().map(|value| if value.is_nan() { 0.0 } else { value }).collect()
    }

    fn sum(values: &[f32]) -> f64 {
        values.iter().map(|&value| f64::from(value)).sum()
    }

    fn footprint(random: &mut Random, length: f64, width: f64) -> Footprint {
        let angle = random.range(0.0, 7.0);
        Footprint {
            centre: [random.range(159.0, 161.0), random.range(159.0, 161.0)],
            axis: [libm::cos(angle), libm::sin(angle)],
            length,
            width,
            pattern: random.bits() as u32,
            ..Footprint::default()
        }
    }

    #[test]
    fn shares_of_any_streak_add_up_to_one() {
        let (set, mut random, mut scratch) = (set(), Random::new(5), PatternScratch::default());
        for _ in 0..300 {
            let (length, width) = (random.range(20.0, 180.0), libm::exp2(random.range(-5.0, 4.0)));
            let footprint = footprint(&mut random, length, width);
            let total = sum(&pixels(&set, &footprint, ALL, &mut scratch));
            assert!((total - 1.0).abs() < ENERGY, "{footprint:?}: {total}");
        }
    }

    #[test]
    fn a_streak_narrower_than_a_pixel_shares_itself_between_the_columns_it_stands_in() {
        /// Tables along have three nodes a pixel.
        const TABLE: f64 = 5e-3;
        /// How near to a border a pixel's edge is soft: half of the narrowest box that stands for none.
        const SOFT: f64 = 0.125;
        let (set, mut scratch) = (set(), PatternScratch::default());
        for width in [0.02, 0.1, 0.4] {
            for step in 0..=10 {
                // From the middle of column 159 to the middle of column 160.
                let centre = [159.5 + 0.1 * f64::from(step), 160.2];
                let footprint = Footprint {
                    centre,
                    axis: [0.0, 1.0],
                    length: 60.0,
                    width,
                    pattern: 0,
                    ..Footprint::default()
                };
                let drawn = pixels(&set, &footprint, ALL, &mut scratch);
                let column =
                    |x: i32| (0..SIDE).map(|y| f64::from(drawn[(y * SIDE + x) as usize])).sum::<f64>();
                // All of it stands in one column unless the border runs through it.
                let border = 160.0 - centre[0];
                if border.abs() > width + SOFT {
                    let here = column(if border > 0.0 { 159 } else { 160 });
                    assert!((here - 1.0).abs() < TABLE, "width {width}, step {step}: {here}");
                } else {
                    let both = column(159) + column(160);
                    assert!((both - 1.0).abs() < TABLE, "width {width}, step {step}: {both}");
                }
            }
        }
    }

    #[test]
    fn a_streak_cut_into_tiles_is_the_same_streak_and_stays_within_its_bounds() {
        /// Of the largest share: light along a thin streak is linear over four pixels, counted from the clip.
        const LINES: f32 = 1e-3;
        let (set, mut random, mut scratch) = (set(), Random::new(6), PatternScratch::default());
        for _ in 0..24 {
            let (length, width) = (random.range(20.0, 90.0), libm::exp2(random.range(-3.0, 4.0)));
            let footprint = footprint(&mut random, length, width);
            let whole = pixels(&set, &footprint, ALL, &mut scratch);
            let mut tiled = vec![0.0; whole.len()];
            for (left, top) in (0..64).map(|i| (40 * (i % 8), 40 * (i / 8))) {
                let clip = Clip { left, top, right: left + 40, bottom: top + 40 };
                let tile = pixels(&set, &footprint, clip, &mut scratch);
                tiled.iter_mut().zip(tile).for_each(|(sum, value)| *sum += value);
            }
            let allowed = LINES * whole.iter().copied().fold(0.0, f32::max);
            let bounds = set.place(&footprint).unwrap().0;
            for (i, (&a, &b)) in whole.iter().zip(&tiled).enumerate() {
                let (x, y) = (i as i32 % SIDE, i as i32 / SIDE);
                let within = x >= bounds.left && x < bounds.right && y >= bounds.top && y < bounds.bottom;
                assert!((a - b).abs() <= allowed && (within || a == 0.0), "{footprint:?} {x} {y}: {a} {b}");
            }
        }
    }

    #[test]
    fn working_memory_stops_growing() {
        let (set, mut scratch) = (set(), PatternScratch::default());
        let round = |scratch: &mut PatternScratch| {
            let mut random = Random::new(7);
            for _ in 0..50 {
                let (length, width) = (random.range(20.0, 90.0), libm::exp2(random.range(-3.0, 4.0)));
                let footprint = footprint(&mut random, length, width);
                let (_, placed) = set.place(&footprint).unwrap();
                Kernel::draw(&set, &placed, ALL, scratch, &mut |_| ());
            }
            scratch.bytes()
        };
        let warm = round(&mut scratch);
        assert!(warm > 0 && round(&mut scratch) == warm);
    }

    #[test]
    fn a_set_without_light_is_drawn_plainly() {
        let mut dark = every_kind();
        dark.patterns.truncate(1);
        dark.patterns[0].mean = 0.0;
        for section in [StreakSection::default(), dark] {
            let set = StreakSet::new(&section);
            let footprint = footprint(&mut Random::new(8), 50.0, 1.0);
            let mut plain = vec![];
            SmoothWindow.draw(&footprint, ALL, &mut (), &mut |span| plain.push((span.x, span.y, span.count)));
            let mut drawn = vec![];
            let scratch = &mut PatternScratch::default();
            let (clip, placed) = set.place(&footprint).unwrap();
            Kernel::draw(&set, &placed, ALL, scratch, &mut |span| drawn.push((span.x, span.y, span.count)));
            assert!(!plain.is_empty() && plain == drawn);
            assert_eq!(clip, SmoothWindow.place(&footprint).unwrap().0);
        }
    }
}
