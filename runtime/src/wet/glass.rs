//! Drops on a pane of glass: they wait until they are heavy enough, run, merge, leave a film behind, and are wiped away. \[toyshop\] §5 after
//! \[kaneda\], with forces in newtons in place of an artist's.
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | M | mass of a cell's water, whole nanograms, so that moving it loses none | ng |
//! | w | width of the half ball that holds it, 2 (3M/2πρ)^⅓ | m |
//! | F_s, F_t | what holds it: σ w (cos θ_r − cos θ_a), standing and running (\[furmidge\]) | N |
//! | F_df | friction of the running drop's edge: ζ η w v | N |
//! | k_a | `affinity` of a cell: scales what holds a drop there, and draws running drops | – |
//! | k_f | `friction` of a cell: scales F_df | – |
//!
//! A drop waits while M·pull < k_a F_s: drops of some 3 mm begin to run on clean glass. Running, v' = v + Δt F/M with F_df taken at the new speed,
//! so that no step overshoots; when it has crossed its cell it flows to one of the three cells below, chosen by roulette over affinity, wetness
//! and direction. On the way it leaves the film that a plate drawn out of water keeps, .94 ℓ (ηv/σ)^⅔ thick (\[landau-levich\]), times a
//! wetting of the glass. Cells that meet become one drop, momentum kept.

#[cfg(feature = "gpu")]
pub mod card;
mod cast;
mod cells;
mod flow;
mod see;
mod shadow;
mod windscreen;
mod wiper;

pub use cast::{GlassShadows, Pane, PaneLight, ShadowControls, ShadowReport};
pub use see::Seen;
pub use windscreen::{Windscreen, WindscreenControls, WindscreenReport};
pub use wiper::Wiper;

use crate::error::RuntimeError;
use crate::random::Random;
use cells::Cells;

/// Cells of a pane along an axis at most.
pub const CELLS_MAX: usize = 8192;
/// Steps that one call takes at most.
pub const STEPS_MAX: u32 = 200_000;
/// Most that flows from a cell at once, ng; a cell that holds as much takes no more in. Three such fit 32 bits beside what is there.
const FLOW_MOST: u32 = 1 << 29;
/// Water in a cubic metre, ng.
const NANOGRAMS_PER_M3: f64 = 1e15;
/// Diameter of a drop that a pane takes in at most, m: rain has none larger.
const DIAMETER_MOST: f64 = 8e-3;

/// A pane and its glass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlassSettings {
    /// Cells across and down, 3 to [`CELLS_MAX`].
    pub cells: [usize; 2],
    /// Distance of cells, m.
    pub spacing_m: f64,
    /// What pulls drops along the pane, across and down, m/s²: gravity times the sine of the pane's slope, and what air drag adds. The second is
    /// above 0: a windscreen up which drops run is given upside down.
    pub pull_m_per_s2: [f64; 2],
    /// cos θ_r − cos θ_a of a drop that stands, 0 to 2: .1 for clean glass, .5 for dirty.
    pub hold: f64,
    /// The same of one that runs, no more than `hold`.
    pub drag: f64,
    /// ζ of the running edge: of order 100 for water on glass.
    pub edge_friction: f64,
    /// How much of the drawn film stays, 0 to 1: 0 for glass that water does not wet.
    pub wetting: f64,
    /// How much more a wet cell draws a drop than a dry one.
    pub wet_preference: f64,
    /// Standard deviation of affinities about 1, 0 to 1: scratches and dirt make drops meander.
    pub roughness: f64,
    /// Seed of affinities, roulette and arrivals.
    pub seed: u64,
}

impl Default for GlassSettings {
    /// Half a metre of upright clean glass in millimetres.
    fn default() -> Self {
        Self {
            cells: [512, 512],
            spacing_m: 1e-3,
            pull_m_per_s2: [0.0, 9.80665],
            hold: 0.2,
            drag: 0.1,
            edge_friction: 100.0,
            wetting: 0.5,
            wet_preference: 4.0,
            roughness: 0.25,
            seed: 0,
        }
    }
}

/// What a call of [`Glass::advance`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GlassReport {
    /// Steps taken, so that no drop crosses more than a cell in one.
    pub steps: u32,
    /// Flows from a cell to one below.
    pub flows: u64,
}

/// A pane with its water.
///
/// ```
/// use squall_runtime::wet::glass::{Glass, GlassSettings};
///
/// let mut pane = Glass::new(GlassSettings { cells: [64, 64], ..GlassSettings::default() })?;
/// for x in [10, 31, 50] {
///     pane.wet([x, 5], 4e-3)?;
/// }
/// pane.advance(1.0)?;
/// assert_eq!(pane.water_ng() + pane.drained_ng(), pane.received_ng());
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Glass {
    settings: GlassSettings,
    cells: Cells,
    flows: Vec<flow::Flow>,
    steps: u64,
    /// Of any drop after the last step, m/s.
    fastest: f32,
    arrivals: u64,
    received: u64,
    drained: u64,
}

impl Glass {
    /// A dry pane, whose affinities are drawn from a normal distribution about 1 (those below a tenth are a tenth).
    ///
    /// # Errors
    ///
    /// A setting outside its range, in words.
    pub fn new(settings: GlassSettings) -> Result<Self, RuntimeError> {
        check(&settings)?;
        let cells = Cells::new(&settings);
        Ok(Self {
            settings,
            cells,
            flows: Vec::new(),
            steps: 0,
            fastest: 0.0,
            arrivals: 0,
            received: 0,
            drained: 0,
        })
    }

    /// What the pane was made with.
    pub const fn settings(&self) -> &GlassSettings {
        &self.settings
    }

    /// The user's own affinities and frictions, x fastest, each .01 to 100, in place of those drawn.
    ///
    /// # Errors
    ///
    /// Not a value for each cell, or one outside its range.
    pub fn set_surface(&mut self, affinity: &[f32], friction: &[f32]) -> Result<(), RuntimeError> {
        for (field, values) in [("affinity", affinity), ("friction", friction)] {
            if values.len() != self.cells.mass.len() {
                return Err(RuntimeError::argument(
                    field,
                    format!("{} cells", self.cells.mass.len()),
                    values.len(),
                ));
            }
            if let Some(value) = values.iter().find(|value| !(0.01..=100.0).contains(*value)) {
                return Err(RuntimeError::argument(field, "0.01 to 100", value));
            }
        }
        self.cells.affinity.copy_from_slice(affinity);
        self.cells.friction.copy_from_slice(friction);
        self.cells.find_lightest(&self.settings);
        Ok(())
    }

    /// Cells that no drop enters, true, x fastest: frames, seals, stickers. What rain lands there drains off; water that is there already runs out.
    ///
    /// # Errors
    ///
    /// Not a value for each cell.
    pub fn set_obstacles(&mut self, obstacles: &[bool]) -> Result<(), RuntimeError> {
        if obstacles.len() != self.cells.mass.len() {
            return Err(RuntimeError::argument(
                "obstacles",
                format!("{} cells", self.cells.mass.len()),
                obstacles.len(),
            ));
        }
        self.cells.blocked.copy_from_slice(obstacles);
        Ok(())
    }

    /// A drop of a diameter, m, lands in a cell.
    ///
    /// # Errors
    ///
    /// The cell is not on the pane, or the diameter not above 0 and at most 8 mm.
    pub fn wet(&mut self, cell: [usize; 2], diameter_m: f64) -> Result<(), RuntimeError> {
        let (cell, mass) = landing(&self.settings, cell, diameter_m)?;
        self.land(cell, mass);
        Ok(())
    }

    /// Drops of one diameter arrive for `seconds` at `impacts_per_m2_s` of the pane's own area, at places drawn from the seed. Returns how many.
    ///
    /// # Errors
    ///
    /// As [`Self::wet`]; or a flux or time that is no number of 0 or more, or that comes to more than a million drops. Nothing has landed then.
    pub fn rain(
        &mut self,
        diameter_m: f64,
        impacts_per_m2_s: f64,
        seconds: f64,
    ) -> Result<u32, RuntimeError> {
        let rain = (diameter_m, impacts_per_m2_s, seconds);
        let landings = arrivals(&self.settings, &mut self.arrivals, rain)?;
        for &(cell, mass) in &landings {
            self.land(cell, mass);
        }
        Ok(landings.len() as u32)
    }

    /// Water of the pane, ng.
    pub fn water_ng(&self) -> u64 {
        self.cells.mass.iter().map(|&mass| u64::from(mass)).sum()
    }

    /// Cells that hold water.
    pub fn wet_cells(&self) -> u64 {
        self.cells.mass.iter().filter(|&&mass| mass > 0).count() as u64
    }

    /// Water that has landed, ng. What is on the pane and what has left it come to this, to the nanogram.
    pub const fn received_ng(&self) -> u64 {
        self.received
    }

    /// Water that ran off the pane, or was wiped off, ng.
    pub const fn drained_ng(&self) -> u64 {
        self.drained
    }

    /// Water of a cell, ng.
    pub fn mass_ng(&self, x: usize, y: usize) -> u32 {
        self.cells.mass[y * self.settings.cells[0] + x]
    }

    /// Speed of a cell's drop down the pane, m/s.
    pub fn speed_m_per_s(&self, x: usize, y: usize) -> f32 {
        self.cells.speed[y * self.settings.cells[0] + x]
    }

    /// The longest time that one call takes, s: [`STEPS_MAX`] steps beside the fastest drop that a cell lets go, of half a gram.
    pub fn longest_call_s(&self) -> f64 {
        f64::from(STEPS_MAX) * self.step_beside(self.speed_most())
    }

    /// Lets time go by, in steps in which no drop crosses more than a cell.
    ///
    /// # Errors
    ///
    /// `seconds` is negative, no number, or more than [`Self::longest_call_s`]. Nothing has moved then.
    pub fn advance(&mut self, seconds: f64) -> Result<GlassReport, RuntimeError> {
        let most = self.longest_call_s();
        if !(0.0..=most).contains(&seconds) {
            return Err(RuntimeError::argument("seconds", format!("0 to {most:.3}"), seconds));
        }
        let mut report = GlassReport::default();
        let (mut left, speed_most) = (seconds, self.speed_most());
        while left > 0.0 {
            let longest = self.step_beside(f64::from(self.fastest).min(speed_most));
            // What is left is shared evenly, so that no last step is a crumb.
            let step = left / libm::ceil(left / longest);
            report.flows += self.step(step);
            report.steps += 1;
            left = if step < left { left - step } else { 0.0 };
        }
        Ok(report)
    }

    /// A step in which a drop of speed v that nothing holds crosses a cell at most: (v + a t) t = Δx.
    fn step_beside(&self, speed: f64) -> f64 {
        let (pull, spacing) = (self.settings.pull_m_per_s2[1], self.settings.spacing_m);
        2.0 * spacing / (speed + libm::sqrt(speed * speed + 4.0 * pull * spacing))
    }

    /// The speed that half a gram comes to where friction is least, m/s.
    fn speed_most(&self) -> f64 {
        flow::last_speed(&self.settings, FLOW_MOST, self.slipperiest())
    }

    /// The least friction of a cell.
    fn slipperiest(&self) -> f64 {
        f64::from(self.cells.friction.iter().fold(f32::INFINITY, |least, &friction| least.min(friction)))
    }

    /// A cell takes water in; what it can't hold runs off at once.
    /// What meets an obstacle is gone from the pane too. A running drop keeps its momentum, and slows.
    fn land(&mut self, cell: usize, mass: u32) {
        self.received += u64::from(mass);
        let here = self.cells.mass[cell];
        let room = if self.cells.blocked[cell] { 0 } else { (FLOW_MOST * 2).saturating_sub(here) };
        let taken = mass.min(room);
        self.drained += u64::from(mass - taken);
        self.cells.mass[cell] = here + taken;
        if taken > 0 {
            self.cells.speed[cell] *= (f64::from(here) / (f64::from(here) + f64::from(taken))) as f32;
        }
    }
}

/// The number of a cell and a drop's mass, ng.
///
/// Errors: as [`Glass::wet`].
fn landing(
    settings: &GlassSettings,
    cell: [usize; 2],
    diameter_m: f64,
) -> Result<(usize, u32), RuntimeError> {
    let [width, height] = settings.cells;
    if cell[0] >= width || cell[1] >= height {
        return Err(RuntimeError::argument("cell", format!("below {width}, {height}"), format!("{cell:?}")));
    }
    if !(diameter_m > 0.0 && diameter_m <= DIAMETER_MOST) {
        return Err(RuntimeError::argument(
            "diameter_m",
            format!("above 0, at most {DIAMETER_MOST}"),
            diameter_m,
        ));
    }
    let cube = diameter_m * diameter_m * diameter_m;
    let mass = libm::round(std::f64::consts::PI / 6.0 * cube * NANOGRAMS_PER_M3) as u32;
    Ok((cell[1] * width + cell[0], mass))
}

/// Drops of a diameter, m, at a flux, 1/(m² s), over so many seconds: their cells and masses, ng. `calls` counts the calls of a pane, each of which has a
/// stream of its own.
///
/// Errors: as [`Glass::rain`].
fn arrivals(
    settings: &GlassSettings,
    calls: &mut u64,
    (diameter_m, impacts_per_m2_s, seconds): (f64, f64, f64),
) -> Result<Vec<(usize, u32)>, RuntimeError> {
    let [width, height] = settings.cells;
    let spacing = settings.spacing_m;
    let expected = impacts_per_m2_s * seconds * (width * height) as f64 * spacing * spacing;
    if !(impacts_per_m2_s >= 0.0 && seconds >= 0.0 && expected <= 1e6) {
        return Err(RuntimeError::argument(
            "impacts_per_m2_s",
            "a flux of at most a million drops in the time",
            impacts_per_m2_s,
        ));
    }
    let mut random = Random::from_parts(&[settings.seed, 1, *calls]);
    *calls += 1;
    let (mut gone, mut landings) = (0.0, Vec::new());
    loop {
        gone -= libm::log(1.0 - random.unit());
        if gone >= expected {
            return Ok(landings);
        }
        let cell = [random.below(width as u64) as usize, random.below(height as u64) as usize];
        landings.push(landing(settings, cell, diameter_m)?);
    }
}

fn check(settings: &GlassSettings) -> Result<(), RuntimeError> {
    for cells in settings.cells {
        if !(3..=CELLS_MAX).contains(&cells) {
            return Err(RuntimeError::argument("cells", format!("3 to {CELLS_MAX} along each axis"), cells));
        }
    }
    let ranges = [
        ("spacing_m", settings.spacing_m, 1e-5..=0.1),
        ("pull_m_per_s2", settings.pull_m_per_s2[1], 1e-3..=1e3),
        ("pull_m_per_s2", settings.pull_m_per_s2[0], -1e3..=1e3),
        ("hold", settings.hold, 0.0..=2.0),
        ("drag", settings.drag, 0.0..=settings.hold),
        ("edge_friction", settings.edge_friction, 1.0..=1e5),
        ("wetting", settings.wetting, 0.0..=1.0),
        ("wet_preference", settings.wet_preference, 0.0..=1e3),
        ("roughness", settings.roughness, 0.0..=1.0),
    ];
    for (field, value, range) in ranges {
        if !range.contains(&value) {
            return Err(RuntimeError::argument(
                field,
                format!("{} to {}", range.start(), range.end()),
                value,
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
