//! What one submission does to a lattice: steps, and marks sorted by the tiles of the lattice that they meet.

use super::super::step::{self, Kernel};
use super::super::{Edges, Impact, RippleSettings, Scheme};
use crate::gpu::rain::plain;

/// Steps of one submission at most.
pub const STEPS: usize = 64;
/// Marks, meetings of a mark with a tile, and tiles of one submission at most. A mark alone takes 172² meetings on the smallest lattice, and
/// 67² tiles on one that is wider than the mark.
pub const MARKS: usize = 2048;
pub const ENTRIES: usize = 32_768;
pub const TILES: usize = 8192;
/// Cells along a tile's side.
pub const TILE: usize = 8;
/// Places beyond so many cells are further apart than a cell in single precision: no mark is made there.
const FARTHEST: f32 = 8_388_608.0;

plain! {
    /// `RippleStep` of step.wgsl.
    RippleStep {
        cells: [u32; 2], edges: u32, scheme: u32, keep: f32, square: f32, ratio: f32, per_spacing: f32, first: u32, pad0: u32,
    }
}
plain! {
    /// A step's numbers as far apart as bindings into one buffer have to be.
    Slot { step: RippleStep, pad0: [[u32; 27]; 2] }
}

const _: () = assert!(size_of::<Slot>() == 256);

plain! {
    /// `Mark` of step.wgsl.
    Mark { middle: [f32; 2], radius: f32, height: f32, rim: f32, mend: f32, both: f32, pad0: f32 }
}

impl Mark {
    /// A drop's ring, on the surface now and on that of a step ago.
    pub fn ring(settings: &RippleSettings, impact: &Impact) -> Self {
        let kernel = Kernel::ring(impact, settings.spacing_m);
        let mend = kernel.mend(settings);
        Self { mend, both: 1.0, ..Self::of(&kernel, kernel.height) }
    }

    /// Water that a body moves: `sum` in the kernel's shape.
    pub fn moved(settings: &RippleSettings, kernel: &Kernel, sum: f64) -> Option<Self> {
        Some(Self::of(kernel, kernel.scale(settings, sum)?))
    }

    fn of(kernel: &Kernel, height: f32) -> Self {
        let Kernel { middle, radius, rim, .. } = *kernel;
        Self { middle, radius, height, rim, ..Self::default() }
    }

    /// The mark in the lattice itself rather than in one of its repeats; `None` where it is nowhere.
    fn folded(mut self, settings: &RippleSettings) -> Option<Self> {
        if self.height == 0.0 || self.middle.iter().any(|place| place.abs() > FARTHEST) {
            return None;
        }
        if settings.edges == Edges::Repeat {
            for (place, cells) in self.middle.iter_mut().zip(settings.cells) {
                let (whole, count) = (f64::from(*place), cells as f64);
                *place = (whole - count * libm::floor(whole / count)) as f32;
            }
        }
        Some(self)
    }
}

/// A stretch of tiles along an axis, with how far the repeat that is met is away, cells.
struct Reach {
    tiles: std::ops::RangeInclusive<i64>,
    shift: i64,
}

/// What a mark meets along one axis.
fn reaches(middle: f32, radius: f32, cells: usize, edges: Edges) -> impl Iterator<Item = Reach> + Clone {
    let (span, count) = (step::span(middle, radius), cells as i64);
    let repeats = match edges {
        Edges::Repeat => span.start().div_euclid(count)..=span.end().div_euclid(count),
        Edges::Reflect => 0..=0,
    };
    repeats.filter_map(move |repeat| {
        let shift = repeat * count;
        let (from, to) = ((span.start() - shift).max(0), (span.end() - shift).min(count - 1));
        (from <= to).then(|| Reach { tiles: from / TILE as i64..=to / TILE as i64, shift })
    })
}

/// What one step does.
#[derive(Clone, Copy, Debug)]
pub struct Job {
    /// Tiles that have marks before it.
    pub tiles: u32,
    /// Whether there is a step behind them.
    pub steps: bool,
}

/// What one submission does; memory is kept.
#[derive(Debug, Default)]
pub struct Lists {
    pub slots: Vec<Slot>,
    pub jobs: Vec<Job>,
    pub marks: Vec<Mark>,
    pub entries: Vec<[u32; 2]>,
    pub tiles: Vec<[u32; 4]>,
    /// Meetings of marks before the step that comes: tile and entry.
    found: Vec<(u32, [u32; 2])>,
}

impl Lists {
    /// Forgets everything.
    pub fn clear(&mut self) {
        self.slots.clear();
        self.jobs.clear();
        self.marks.clear();
        self.entries.clear();
        self.tiles.clear();
    }

    /// Adds a mark before the step that comes; false, and nothing is added, where there is no more room.
    pub fn mark(&mut self, settings: &RippleSettings, mark: Mark) -> bool {
        let Some(mark) = mark.folded(settings) else { return true };
        let across = settings.cells.map(|cells| cells.div_ceil(TILE));
        let [columns, rows] =
            [0, 1].map(|axis| reaches(mark.middle[axis], mark.radius, settings.cells[axis], settings.edges));
        let number = self.marks.len() as u32;
        let begin = self.found.len();
        for row in rows {
            for column in columns.clone() {
                let [x_shift, y_shift] =
                    [column.shift, row.shift].map(|cells| u32::from(cells as i16 as u16));
                for y in row.tiles.clone() {
                    let first = y as usize * across[0];
                    let entry = [number, x_shift | y_shift << 16];
                    self.found.extend(column.tiles.clone().map(|x| ((first + x as usize) as u32, entry)));
                }
            }
        }
        let tiles = self.found.len().min(across[0] * across[1]);
        let fits = self.marks.len() < MARKS
            && self.entries.len() + self.found.len() <= ENTRIES
            && self.tiles.len() + tiles <= TILES;
        if fits {
            self.marks.push(mark);
        } else {
            self.found.truncate(begin);
        }
        fits
    }

    /// Ends what was marked, with a step or without one; true where the submission is full.
    pub fn end(&mut self, settings: &RippleSettings, step: RippleStep, steps: bool) -> bool {
        if self.found.is_empty() && !steps {
            return self.jobs.len() == STEPS;
        }
        // Stable: marks of one tile stay in their order.
        self.found.sort_by_key(|(tile, _)| *tile);
        let across = settings.cells[0].div_ceil(TILE) as u32;
        let first = self.tiles.len();
        for list in self.found.chunk_by(|a, b| a.0 == b.0) {
            let begin = self.entries.len() as u32;
            self.entries.extend(list.iter().map(|(_, entry)| *entry));
            let tile = list[0].0;
            self.tiles.push([tile % across, tile / across, begin, self.entries.len() as u32]);
        }
        self.found.clear();
        self.slots.push(Slot { step: RippleStep { first: first as u32, ..step }, ..Slot::default() });
        self.jobs.push(Job { tiles: (self.tiles.len() - first) as u32, steps });
        self.jobs.len() == STEPS
    }
}

/// A step's numbers but for its marks: of no time where `seconds` is 0.
pub fn numbers(settings: &RippleSettings, seconds: f64, ratio: f64) -> RippleStep {
    let courant = f64::from(settings.speed_m_per_s) * seconds / f64::from(settings.spacing_m);
    let square = (courant * courant) as f32;
    let is_nine = settings.scheme == Scheme::Nine;
    RippleStep {
        cells: settings.cells.map(|cells| cells as u32),
        edges: u32::from(settings.edges == Edges::Reflect),
        scheme: u32::from(!is_nine),
        keep: (1.0 - step::damping(settings, seconds)) as f32,
        square: if is_nine { square * (1.0 / 6.0) } else { square },
        ratio: ratio as f32,
        per_spacing: 1.0 / settings.spacing_m,
        ..RippleStep::default()
    }
}
