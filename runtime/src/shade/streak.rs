//! Rain streaks: a pattern's light, drawn as an oriented kernel that is averaged over every pixel it meets.
//!
//! | symbol | name            | unit   |
//! | u, v   | picture         | 0 to 1 |
//! | n, d   | `across`, `along` | unit vectors in the frame, pixels |
//!
//! The mean over a pixel is a closed form: edges are read from tables of a blurred step seen through a
//! square pixel at that angle, cosines keep their frequency and lose amplitude (see `prepare`). The sum over
//! all pixels is length × width × mean at any size, a tenth of a pixel wide or twenty.
//!
//! Along a line of pixels each phase grows linearly, so cosines are turned, not evaluated: one complex
//! product per term and line, two multiplications per term and pixel.

pub mod choice;
mod column;
mod draw;
mod edge;
mod frame;
mod prepare;
mod profile;
mod thin;
#[cfg(feature = "gpu")]
pub(crate) mod upload;

use crate::rain::kernel::{BLOCK, Ribbon};
use crate::rain::tile_buffer::{Paint, TileBuffer};
use choice::Choice;
use draw::{Lines, Wave, draw};
use edge::EdgeTable;
use frame::{EdgeFrame, ProductFrame};
use prepare::{Cosines, PatternFrame, PatternLight, Prepared};
use profile::{Profile, ProfileRow};
use squall_formats::section::streak::{StreakPattern, StreakSection};
use std::sync::OnceLock;
use thin::ThinPlace;

/// Bodies narrower or shorter than this are drawn in thin form.
const THIN_WIDTH_PX: f32 = 4.0;
const THIN_LENGTH_PX: f32 = 12.0;
/// So are patterns with finer waves than this across, where the whole picture is narrower than tables reach.
const PERIODS_PER_PIXEL: f64 = 0.6;
const THIN_PICTURE_PX: f64 = 16.0;
/// Bodies shorter than this are drawn upright or level: their direction does not show, and a pixel's shadows
/// on the two axes then multiply to the pixel itself.
const DOT_LENGTH_PX: f64 = 3.0;
/// Longest side drawn; beyond it a kernel is not a streak.
const LONGEST_PX: f64 = 1e5;

/// Patterns ready to be drawn.
///
/// A stored pattern is some hundred bytes and what drawing needs of it half a megabyte: it is prepared when it is first
/// drawn, so that a set costs next to nothing to open.
#[derive(Clone, Debug)]
pub struct StreakSet {
    patterns: Vec<(StreakPattern, OnceLock<Prepared>)>,
    edges: EdgeTable,
    choice: OnceLock<Option<Choice>>,
    shortest_aspect: f64,
}

/// One streak in the frame. Pixel (0, 0) has its centre at (½, ½), y points down.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StreakPlacement {
    /// Middle of the streak's body, pixels.
    pub middle: [f32; 2],
    /// Direction of the fall, any length but zero.
    pub direction: [f32; 2],
    /// Length of the body along the direction, pixels.
    pub length: f32,
    /// Width of the body, pixels; any, down to a small fraction of one.
    pub width: f32,
    /// Which pattern.
    pub pattern: u32,
    /// Factor on the pattern's light. `w` makes the sum over all pixels `w` × length × width × mean.
    pub weight: f32,
}

/// A rectangle of a frame that kernels are added to.
#[derive(Debug)]
pub struct Tile<'a> {
    /// Frame coordinates of its top left pixel.
    pub origin: [i32; 2],
    /// Pixels across.
    pub width: usize,
    /// Rows of `width` values.
    pub alpha: &'a mut [f32],
}

/// Working memory of [`StreakSet::add`]; grows to the largest pattern and is then reused.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    waves: Vec<Wave>,
    rows: Vec<[ProfileRow; 2]>,
    mixed: Vec<thin::Four>,
    ribbon: Ribbon,
}

impl Scratch {
    /// Bytes that it holds.
    pub fn bytes(&self) -> usize {
        let rows: usize = self.rows.iter().flatten().map(ProfileRow::bytes).sum();
        let mixed = self.mixed.capacity() * size_of::<thin::Four>() + self.ribbon.bytes();
        let rows = rows + self.rows.capacity() * size_of::<[ProfileRow; 2]>();
        self.waves.capacity() * size_of::<Wave>() + rows + mixed
    }
}

/// A streak whose place is worked out.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlacedStreak {
    pattern: u32,
    /// Pixels that it may touch: left, top, right, bottom.
    pub(crate) bounds: [i32; 4],
    form: Form,
}

/// How a streak is drawn.
#[derive(Clone, Copy, Debug)]
enum Form {
    /// Too thin to show what is across it.
    Thin(ThinPlace),
    /// Resolved.
    Wide(StreakPlacement),
}

impl Default for Form {
    fn default() -> Self {
        Self::Wide(StreakPlacement::default())
    }
}

/// A kernel's frame of reference.
struct Pose {
    /// Unit vectors of u and v in the frame.
    across: [f64; 2],
    along: [f64; 2],
    /// Pixels of the whole picture along u and v.
    scale: [f64; 2],
    /// Frame coordinates of the picture's corner u = v = 0.
    corner: [f64; 2],
    weight: f32,
}

impl Tile<'_> {
    /// Columns and rows of the frame that both the tile and a box of pixels have; none where there are none.
    fn clip(&self, bounds: [i32; 4]) -> Option<[[i32; 2]; 2]> {
        let size = [self.width, self.alpha.len().checked_div(self.width)?].map(|side| side as i32);
        let clip = [0, 1].map(|axis| {
            let low = bounds[axis].max(self.origin[axis]);
            [low, bounds[axis + 2].min(self.origin[axis].saturating_add(size[axis]))]
        });
        clip.iter().all(|[low, high]| low < high).then_some(clip)
    }

    /// Adds the part of a ribbon's light, or with `which` 1 of its coverage, that lies in `clip`, columns and rows of the frame inside
    /// the tile.
    fn add_ribbon(&mut self, ribbon: &Ribbon, clip: [[i32; 2]; 2], which: usize) {
        let [low, high] = clip[usize::from(ribbon.columns)];
        let stride = if ribbon.columns { self.width } else { 1 };
        for (line, first, blocks) in ribbon.lines() {
            let (from, to) = (first.max(low), first.saturating_add((ribbon.blocks * BLOCK) as i32).min(high));
            if from >= to {
                continue;
            }
            let [x, y] = if ribbon.columns { [line, from] } else { [from, line] };
            let at = (y - self.origin[1]) as usize * self.width + (x - self.origin[0]) as usize;
            let lights = &blocks[which].as_flattened()[(from - first) as usize..(to - first) as usize];
            let pixels = self.alpha[at..].iter_mut().step_by(stride);
            pixels.zip(lights).for_each(|(pixel, light)| *pixel += light);
        }
    }
}

impl StreakSet {
    /// The patterns of a section; each is prepared when it is first drawn.
    pub fn new(section: &StreakSection) -> Self {
        let aspect = |pattern: &StreakPattern| {
            let [width, length] = pattern.size_px.map(f64::from);
            length * pattern.body.length() / (width * pattern.body.width())
        };
        let shortest_aspect = section.patterns.iter().map(aspect).fold(f64::INFINITY, f64::min);
        let patterns = section.patterns.iter().map(|pattern| (pattern.clone(), OnceLock::new())).collect();
        Self { patterns, edges: EdgeTable::new(), choice: OnceLock::new(), shortest_aspect }
    }

    fn prepared(&self, pattern: u32) -> Option<&Prepared> {
        let (stored, prepared) = self.patterns.get(pattern as usize)?;
        Some(prepared.get_or_init(|| Prepared::new(stored)))
    }

    /// Which pattern a drop takes by how it is seen; `None` where the set does not say what its pictures show.
    pub(crate) fn choice(&self) -> Option<&Choice> {
        let sorted = || Choice::new(&self.patterns.iter().map(|(stored, _)| stored).collect::<Vec<_>>());
        self.choice.get_or_init(sorted).as_ref()
    }

    /// Length over width of the shortest pattern's body, as its picture shows it; +∞ of an empty set.
    pub(crate) fn shortest_aspect(&self) -> f64 {
        self.shortest_aspect
    }

    /// Number of patterns.
    pub fn len(&self) -> usize {
        self.patterns.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.patterns.is_empty()
    }

    /// Mean light of a pattern over its body; 0 for a pattern that does not exist.
    pub fn mean(&self, pattern: u32) -> f32 {
        self.patterns.get(pattern as usize).map_or(0.0, |(stored, _)| stored.mean as f32)
    }

    /// Pixels that a kernel may touch: [left, top, right, bottom), or `None` for one that draws nothing: an
    /// unknown pattern, a number that is not finite, no length, no width or no direction.
    pub fn bounds(&self, kernel: &StreakPlacement) -> Option<[i32; 4]> {
        let prepared = self.prepared(kernel.pattern)?;
        Some(Pose::new(kernel, prepared)?.bounds(prepared))
    }

    /// A kernel ready to be drawn into however many clips; `None` as in [`StreakSet::bounds`].
    pub(crate) fn placed(&self, kernel: &StreakPlacement) -> Option<PlacedStreak> {
        let prepared = self.prepared(kernel.pattern)?;
        let pose = Pose::new(kernel, prepared)?;
        let narrowest = (prepared.finest / PERIODS_PER_PIXEL).min(THIN_PICTURE_PX);
        let is_thin =
            kernel.width < THIN_WIDTH_PX || kernel.length < THIN_LENGTH_PX || pose.scale[0] < narrowest;
        let form = match is_thin {
            true => Form::Thin(prepared.thin.place(&pose, prepared.body.v)),
            false => Form::Wide(*kernel),
        };
        Some(PlacedStreak { pattern: kernel.pattern, form, bounds: pose.bounds(prepared) })
    }

    /// Fills `ribbon` with a thin streak's lines inside `clip`, rows or columns of the frame. Says whether the streak is one.
    #[inline]
    pub(crate) fn fill_ribbon(
        &self,
        placed: &PlacedStreak,
        clip: [[i32; 2]; 2],
        scratch: &mut Scratch,
        ribbon: &mut Ribbon,
    ) -> bool {
        let Form::Thin(thin) = &placed.form else { return false };
        let Some(prepared) = self.prepared(placed.pattern) else { return false };
        prepared.thin.fill(thin, clip, &mut scratch.mixed, ribbon);
        true
    }

    /// Lays a thin streak's lines inside `clip` over a tile buffer; answers false, and does nothing, of any that is not simply thin.
    #[inline]
    pub(crate) fn lay_thin(
        &self,
        placed: &PlacedStreak,
        clip: [[i32; 2]; 2],
        scratch: &mut Scratch,
        paint: &Paint,
        tile_buffer: &mut TileBuffer,
    ) -> bool {
        let Form::Thin(thin) = &placed.form else { return false };
        let Some(prepared) = self.prepared(placed.pattern) else { return false };
        prepared.thin.lay(thin, clip, &mut scratch.mixed, paint, tile_buffer)
    }

    /// The kernel of a streak whose width is resolved.
    pub(crate) fn resolved(placed: &PlacedStreak) -> Option<&StreakPlacement> {
        match &placed.form {
            Form::Wide(kernel) => Some(kernel),
            Form::Thin(_) => None,
        }
    }

    /// Adds a kernel's light to a tile: each pixel gains the pattern's mean over its square, times the weight.
    ///
    /// Adding tile by tile gives the same values as adding to the whole frame, to single precision. Draws
    /// nothing where [`StreakSet::bounds`] says so.
    pub fn add(&self, kernel: &StreakPlacement, tile: &mut Tile, scratch: &mut Scratch) {
        if let Some(placed) = self.placed(kernel) {
            self.add_placed(&placed, tile, scratch);
        }
    }

    /// [`StreakSet::add`] of a thin streak that is ready, and what its drop covers into `column`, a tile of the same place.
    pub(crate) fn add_thin(
        &self,
        placed: &PlacedStreak,
        tile: &mut Tile,
        column: &mut [f32],
        scratch: &mut Scratch,
    ) {
        let (Form::Thin(thin), Some(clip)) = (&placed.form, tile.clip(placed.bounds)) else { return };
        let Some(prepared) = self.prepared(placed.pattern) else { return };
        let Scratch { mixed, ribbon, .. } = scratch;
        prepared.thin.fill(thin, clip, mixed, ribbon);
        tile.add_ribbon(ribbon, clip, 0);
        Tile { alpha: column, ..*tile }.add_ribbon(ribbon, clip, 1);
    }

    /// [`StreakSet::add`] of a kernel that is ready.
    pub(crate) fn add_placed(&self, placed: &PlacedStreak, tile: &mut Tile, scratch: &mut Scratch) {
        let PlacedStreak { pattern, bounds, form } = placed;
        let Some(clip) = tile.clip(*bounds) else { return };
        let Some(prepared) = self.prepared(*pattern) else { return };
        let kernel = match form {
            Form::Wide(kernel) => kernel,
            Form::Thin(thin) => {
                let Scratch { mixed, ribbon, .. } = scratch;
                prepared.thin.fill(thin, clip, mixed, ribbon);
                return tile.add_ribbon(ribbon, clip, 0);
            }
        };
        let Some(pose) = Pose::new(kernel, prepared) else { return };
        let across = prepared.range[0].map(|u| u * pose.scale[0]);
        let lines = Lines::new(&pose, across, clip);
        let Scratch { waves, rows, .. } = scratch;
        let cosines = prepared.cosines();
        match &prepared.light {
            PatternLight::Cosines(Cosines { frame: PatternFrame::Edges(window), .. }) => {
                draw(&lines, &pose, cosines, &EdgeFrame::new(&self.edges, window, &pose), tile, waves);
            }
            PatternLight::Cosines(Cosines { frame: PatternFrame::Profiles(profiles), .. }) => {
                let rows = pose.fill_rows(std::slice::from_ref(profiles), rows);
                draw(&lines, &pose, cosines, &ProductFrame { rows }, tile, waves);
            }
            PatternLight::Products(products) => {
                let rows = pose.fill_rows(products, rows);
                draw(&lines, &pose, cosines, &ProductFrame { rows }, tile, waves);
            }
        }
    }
}

impl Pose {
    fn new(kernel: &StreakPlacement, prepared: &Prepared) -> Option<Self> {
        let [x, y] = kernel.direction.map(f64::from);
        let norm = libm::sqrt(x * x + y * y);
        let (length, width) = (f64::from(kernel.length), f64::from(kernel.width));
        let drawable = |value: f64| value > 0.0 && value < LONGEST_PX;
        let finite = kernel.middle.iter().all(|value| value.is_finite()) && kernel.weight.is_finite();
        if !(norm > 0.0 && norm.is_finite() && drawable(length) && drawable(width) && finite) {
            return None;
        }
        let mut along = [x / norm, y / norm];
        if length < DOT_LENGTH_PX {
            let upright = along[1].abs() >= along[0].abs();
            along = if upright { [0.0, along[1].signum()] } else { [along[0].signum(), 0.0] };
        }
        let across = [along[1], -along[0]];
        let body = &prepared.body;
        let scale = [width / body.width(), length / body.length()];
        let middle = [0.5 * (body.u[0] + body.u[1]) * scale[0], 0.5 * (body.v[0] + body.v[1]) * scale[1]];
        let corner = [0, 1]
            .map(|axis| f64::from(kernel.middle[axis]) - across[axis] * middle[0] - along[axis] * middle[1]);
        Some(Self { across, along, scale, corner, weight: kernel.weight })
    }

    /// Pixels that the light of `prepared` may touch: left, top, right, bottom.
    fn bounds(&self, prepared: &Prepared) -> [i32; 4] {
        let range = prepared.range;
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for u in range[0] {
            for v in range[1] {
                for axis in 0..2 {
                    let at = self.corner[axis]
                        + self.across[axis] * u * self.scale[0]
                        + self.along[axis] * v * self.scale[1];
                    low[axis] = low[axis].min(at);
                    high[axis] = high[axis].max(at);
                }
            }
        }
        // Pixels whose square meets the range: a pixel's shadow reaches half a pixel along either axis. Casts round toward zero.
        let floor = |value: f64| {
            let whole = value.clamp(-1e9, 1e9) as i32;
            whole - i32::from(f64::from(whole) > value)
        };
        let ceil = |value: f64| -floor(-value);
        [floor(low[0] - 0.5), floor(low[1] - 0.5), ceil(high[0] + 0.5), ceil(high[1] + 0.5)]
    }

    /// Profiles across and along, seen through this kernel's pixels. Rows of earlier kernels keep their memory.
    fn fill_rows<'r>(
        &self,
        profiles: &[[Profile; 2]],
        rows: &'r mut Vec<[ProfileRow; 2]>,
    ) -> &'r [[ProfileRow; 2]] {
        rows.resize_with(profiles.len().max(rows.len()), Default::default);
        let directions = [self.across, self.along].map(|axis| axis.map(f64::abs));
        for (row, profile) in rows.iter_mut().zip(profiles) {
            for axis in 0..2 {
                profile[axis].fill_row(self.scale[axis], directions[axis], &mut row[axis]);
            }
        }
        &rows[..profiles.len()]
    }
}

#[cfg(test)]
pub(crate) mod tests;
