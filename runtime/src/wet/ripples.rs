//! Ripples on standing water: z_tt + λ z_t = c² ∇²z on a lattice, \[toyshop\] §4.
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | z | height over the water at rest | m |
//! | c | `speed_m_per_s`, of the waves (the paper calls it the water's) | m/s |
//! | λ | `damping_per_s`; heights fall as e^(−λt/2) | 1/s |
//! | C | c Δt/Δx, the Courant number | – |
//! | γ | 1 − e^(−λΔt), the damping of a step | – |
//!
//! A step is z⁺ = z + (1 − γ)(z − z⁻) + C² L z. With L's largest eigenvalue −μ it is stable where C² ≤ 2(2 − γ)/μ: μ is 8 for the five
//! points' Laplacian and 16/3 for the nine points', which also spreads rounder. What the paper calls explicit Euler takes L z⁻ in place
//! of L z: stable where γ ≥ μC² alone, so never without damping ([`Scheme::Paper`]).

#[cfg(feature = "gpu")]
pub mod card;
mod impact;
mod step;
mod stretch;

pub use impact::{DropFlux, Impact};

use super::slopes::{sobel, sobel_row};
use crate::error::RuntimeError;
use step::Kernel;
use stretch::{Stretch, longest_step};

/// Cells of a lattice along an axis at most.
pub const CELLS_MAX: usize = 8192;
/// Steps that one call takes at most: some seconds of one core on 256 × 256 cells.
pub const STEPS_MAX: u32 = 50_000;
/// Impacts that one call makes at most.
pub const IMPACTS_MAX: u32 = 1_000_000;
/// Share of the largest stable Courant number that a step takes: round-off must not cross the bound.
const COURANT_SHARE: f64 = 0.95;
/// Share of the longest step that is stepped at least; less waits.
const SHORTEST_SHARE: f64 = 0.01;
/// Impacts are drawn for stretches of time of this length, so that any sequence of frames meets the same drops.
const SLOT_S: f64 = 1.0 / 64.0;

/// How the Laplacian is taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// Nine points, \[1 4 1; 4 −20 4; 1 4 1\]/6: the error of a wave's speed is the same in all directions up to (kΔx)⁴.
    #[default]
    Nine,
    /// Five points.
    Five,
    /// The paper's words taken literally: forward Euler on five points. Grows without bound unless heavily damped; a baseline.
    Paper,
}

/// What happens at the lattice's edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Edges {
    /// The lattice repeats: one tile covers a town.
    #[default]
    Repeat,
    /// Waves are thrown back as by a wall.
    Reflect,
}

/// A lattice and its water.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RippleSettings {
    /// Cells along x and y, 3 to [`CELLS_MAX`].
    pub cells: [usize; 2],
    /// Distance of cells, m, above 0.
    pub spacing_m: f32,
    /// Speed of waves, m/s, above 0. Capillary-gravity waves on deep water are never slower than .23 m/s.
    pub speed_m_per_s: f32,
    /// Damping λ, 1/s, 0 or more: heights fall as e^(−λt/2).
    pub damping_per_s: f32,
    /// Depth of the water, m, above 0: a crater is no deeper.
    pub depth_m: f32,
    /// Depth of the mark that rings begin with over the crater's, 0 to 1: most of a crater's energy goes into its jet and into foam, not into rings.
    pub ring_share: f32,
    /// The Laplacian.
    pub scheme: Scheme,
    /// The edges.
    pub edges: Edges,
}

impl Default for RippleSettings {
    /// The paper's 256 × 256 cells over 2 × 2 m of a puddle 1 cm deep.
    fn default() -> Self {
        Self {
            cells: [256, 256],
            spacing_m: 2.0 / 256.0,
            speed_m_per_s: 0.25,
            damping_per_s: 2.0,
            depth_m: 0.01,
            ring_share: 0.1,
            scheme: Scheme::Nine,
            edges: Edges::Repeat,
        }
    }
}

/// What a call of [`Ripples::advance`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RippleReport {
    /// Steps taken.
    pub steps: u32,
    /// Drops that struck.
    pub impacts: u32,
}

/// A water surface in motion.
///
/// ```
/// use squall_runtime::wet::ripples::{DropFlux, RippleSettings, Ripples};
///
/// let mut water = Ripples::new(RippleSettings::default())?;
/// let rain = [DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 200.0 }];
/// let report = water.advance(1.0 / 30.0, &rain, 7)?;
/// assert!(report.impacts > 0);
/// let [x_slope, y_slope] = water.slope_at([0.31, 0.2]);
/// assert!(x_slope.is_finite() && y_slope.is_finite());
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Ripples {
    settings: RippleSettings,
    /// Heights now and a step ago, each with one cell of margin around; the third is the paper's scheme's alone.
    now: Vec<f32>,
    before: Vec<f32>,
    spare: Vec<f32>,
    time_s: f64,
    /// Time that was too short for a step and waits for more.
    owed_s: f64,
    /// The last step's length, at which `before` was.
    step_s: f64,
}

impl Ripples {
    /// Water at rest.
    ///
    /// # Errors
    ///
    /// A setting outside its range, in words.
    pub fn new(settings: RippleSettings) -> Result<Self, RuntimeError> {
        check(&settings)?;
        let cells = (settings.cells[0] + 2) * (settings.cells[1] + 2);
        let spare = if settings.scheme == Scheme::Paper { vec![0.0; cells] } else { Vec::new() };
        Ok(Self {
            settings,
            now: vec![0.0; cells],
            before: vec![0.0; cells],
            spare,
            time_s: 0.0,
            owed_s: 0.0,
            step_s: longest_step(&settings),
        })
    }

    /// The same with its clock at another time than 0, s, 0 or more: the drops of that time are those that strike.
    #[must_use]
    pub fn starting_at(self, time_s: f64) -> Self {
        Self { time_s: if time_s > 0.0 { time_s } else { 0.0 }, ..self }
    }

    /// What the surface was made with.
    pub const fn settings(&self) -> &RippleSettings {
        &self.settings
    }

    /// Time since the water was at rest, s.
    pub const fn time_s(&self) -> f64 {
        self.time_s
    }

    /// The longest step that is stable, s, less a twentieth. For [`Scheme::Paper`] it is the five points' own, which that scheme does not survive.
    pub fn longest_step_s(&self) -> f64 {
        longest_step(&self.settings)
    }

    /// Lets `seconds` go by, in as many equal steps as stability asks for, while `rain` falls. The same seed and times give the same drops
    /// whatever the lengths of the calls.
    ///
    /// # Errors
    ///
    /// `seconds` is negative, not finite, or takes more than [`STEPS_MAX`] steps; a flux is not a number of 0 or more, or comes to more than
    /// [`IMPACTS_MAX`] impacts. Nothing has moved then.
    pub fn advance(
        &mut self,
        seconds: f64,
        rain: &[DropFlux],
        seed: u64,
    ) -> Result<RippleReport, RuntimeError> {
        let clock = (self.time_s, &mut self.owed_s);
        let Some(stretch) = Stretch::new(&self.settings, clock, seconds, (rain, seed))? else {
            return Ok(RippleReport::default());
        };
        let mut coming = stretch.arrivals.iter().peekable();
        for step in 0..stretch.steps {
            let until = stretch.end_of(step);
            while let Some((_, impact)) = coming.next_if(|(time, _)| *time < until) {
                self.strike(impact);
            }
            self.step(until - self.time_s);
            self.time_s = until;
        }
        Ok(stretch.report())
    }

    /// One drop strikes now.
    pub fn strike(&mut self, impact: &Impact) {
        let kernel = Kernel::ring(impact, self.settings.spacing_m);
        kernel.add(&self.settings, &mut [&mut self.now, &mut self.before]);
    }

    /// A body of radius `radius_m` that displaces the water by `draught_m` has moved from one place to another since the last call: water is raised
    /// where it came to and sinks where it left; none is made or lost. Its wake follows.
    pub fn push(&mut self, from_m: [f32; 2], to_m: [f32; 2], radius_m: f32, draught_m: f32) {
        for (mark, sum) in
            step::moved(&self.settings, [from_m, to_m], radius_m, draught_m).into_iter().flatten()
        {
            mark.shift(&self.settings, &mut self.now, sum);
        }
    }

    /// Height at a cell, m.
    pub fn height(&self, x: usize, y: usize) -> f32 {
        self.now[self.index(x, y)]
    }

    /// Slopes of every cell, x fastest, by Sobel's filter.
    ///
    /// # Panics
    ///
    /// `out` has not as many entries as there are cells.
    pub fn slopes(&mut self, out: &mut [[f32; 2]]) {
        let [width, height] = self.settings.cells;
        assert_eq!(out.len(), width * height, "a slope for each cell");
        step::margins(&self.settings, &mut self.now);
        let stride = width + 2;
        let per_spacing = 1.0 / self.settings.spacing_m;
        for (y, row) in out.chunks_exact_mut(width).enumerate() {
            let rows = [0, 1, 2].map(|k| &self.now[(y + k) * stride..][..stride]);
            sobel_row(rows, per_spacing, row);
        }
    }

    /// Slopes at a place, m from the lattice's corner, between the four cells around. Beyond the edges the lattice repeats or mirrors itself,
    /// as its [`Edges`] say.
    pub fn slope_at(&self, place_m: [f32; 2]) -> [f32; 2] {
        let [x, y] = place_m.map(|value| value / self.settings.spacing_m - 0.5);
        let (left, top) = (libm::floorf(x), libm::floorf(y));
        let (fx, fy) = (x - left, y - top);
        let mut slope = [0.0; 2];
        for (k, weight) in
            [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy].iter().enumerate()
        {
            let here = self.cell_slope([left + (k % 2) as f32, top + (k / 2) as f32]);
            slope = [slope[0] + weight * here[0], slope[1] + weight * here[1]];
        }
        slope
    }

    fn cell_slope(&self, cell: [f32; 2]) -> [f32; 2] {
        let at = |dx: f32, dy: f32| {
            let fold = |value: f32, cells: usize| self.settings.edges.fold(f64::from(value), cells);
            self.height(
                fold(cell[0] + dx, self.settings.cells[0]),
                fold(cell[1] + dy, self.settings.cells[1]),
            )
        };
        let rows = [-1.0, 0.0, 1.0].map(|dy| [at(-1.0, dy), at(0.0, dy), at(1.0, dy)]);
        sobel([&rows[0], &rows[1], &rows[2]], 0, 1.0 / self.settings.spacing_m)
    }

    /// Water above rest, m³: 0 but for round-off, as every drop and body moves water and brings none.
    pub fn volume_m3(&self) -> f64 {
        let spacing = f64::from(self.settings.spacing_m);
        self.sum(|height| height) * spacing * spacing
    }

    /// Mean square height, m².
    pub fn mean_square_m2(&self) -> f64 {
        self.sum(|height| height * height) / (self.settings.cells[0] * self.settings.cells[1]) as f64
    }

    fn sum(&self, of: impl Fn(f64) -> f64) -> f64 {
        let [width, height] = self.settings.cells;
        (0..height).map(|y| (0..width).map(|x| of(f64::from(self.height(x, y)))).sum::<f64>()).sum()
    }

    fn index(&self, x: usize, y: usize) -> usize {
        (y + 1) * (self.settings.cells[0] + 2) + x + 1
    }

    fn step(&mut self, seconds: f64) {
        let ratio = seconds / self.step_s;
        if (ratio - 1.0).abs() > 1e-9 {
            // z⁻ is where the surface was a step ago: a step of another length had it nearer or farther.
            for (before, now) in self.before.iter_mut().zip(&self.now) {
                *before = now - (now - *before) * ratio as f32;
            }
            self.step_s = seconds;
        }
        step::step(&self.settings, seconds, &mut self.now, &mut self.before, &mut self.spare);
    }
}

impl Edges {
    /// The cell inside the lattice that a cell outside stands for.
    fn fold(self, cell: f64, cells: usize) -> usize {
        let count = cells as f64;
        let period = if self == Self::Repeat { count } else { 2.0 * count };
        let inside = (cell - period * libm::floor(cell / period)) as usize;
        if inside < cells { inside } else { (2 * cells - 1).saturating_sub(inside).min(cells - 1) }
    }
}

fn check(settings: &RippleSettings) -> Result<(), RuntimeError> {
    for cells in settings.cells {
        if !(3..=CELLS_MAX).contains(&cells) {
            return Err(RuntimeError::argument("cells", format!("3 to {CELLS_MAX} along each axis"), cells));
        }
    }
    let positive = [
        ("spacing_m", settings.spacing_m),
        ("speed_m_per_s", settings.speed_m_per_s),
        ("depth_m", settings.depth_m),
    ];
    for (field, value) in positive {
        if !(1e-6..=1e6).contains(&value) {
            return Err(RuntimeError::argument(field, "1e-6 to 1e6", value));
        }
    }
    if !(0.0..=1e3).contains(&settings.damping_per_s) {
        return Err(RuntimeError::argument("damping_per_s", "0 to 1000", settings.damping_per_s));
    }
    if !(0.0..=1.0).contains(&settings.ring_share) {
        return Err(RuntimeError::argument("ring_share", "0 to 1", settings.ring_share));
    }
    Ok(())
}

/// A number that stands for a surface's heights, bit by bit.
#[cfg(test)]
fn fingerprint(water: &Ripples) -> u64 {
    water.now.iter().fold(0, |state, height| crate::random::hash(&[state, u64::from(height.to_bits())]))
}

#[cfg(test)]
mod tests;
