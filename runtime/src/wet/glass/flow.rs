//! One step: forces, the roulette, flows.

use super::{FLOW_MOST, Glass, GlassSettings, NANOGRAMS_PER_M3};
use crate::random::hash;
use std::f64::consts::PI;

/// Surface tension of water at 20 °C, N/m.
const TENSION: f64 = 0.0728;
/// Viscosity of water at 20 °C, Pa s.
const VISCOSITY: f64 = 1.0e-3;
/// Density of water, kg/m³.
const DENSITY: f64 = 1000.0;
/// Capillary length of water, (σ/(ρg))^½, m.
const CAPILLARY_LENGTH: f64 = 2.73e-3;
/// Kilograms in a nanogram.
const NANOGRAM: f64 = 1e-12;

/// Water on its way from one cell to another.
#[derive(Clone, Copy, Debug)]
pub struct Flow {
    /// Where to, or `None` off the pane.
    pub(super) to: Option<usize>,
    pub(super) mass: u32,
    pub(super) speed: f32,
    /// What it has crossed of the new cell already.
    pub(super) crossed: f32,
}

/// Width w of the half ball of a mass, m.
fn width(mass: f64) -> f64 {
    2.0 * libm::cbrt(1.5 / PI * mass * NANOGRAM / DENSITY)
}

/// The mass whose pull is what holds it, ng: M a = k σ w Δ with w³ = 12 M/(πρ), so M² = 12 (k σ Δ/a)³/(πρ).
pub fn lightest(settings: &GlassSettings, affinity: f64) -> u32 {
    let ratio = affinity * TENSION * settings.hold / settings.pull_m_per_s2[1];
    libm::floor(libm::sqrt(12.0 / (PI * DENSITY) * ratio * ratio * ratio) / NANOGRAM) as u32
}

/// The speed at which friction alone balances the pull, m/s.
pub fn last_speed(settings: &GlassSettings, mass: u32, friction: f64) -> f64 {
    let mass = f64::from(mass);
    if mass > 0.0 {
        mass * NANOGRAM * settings.pull_m_per_s2[1]
            / (friction * settings.edge_friction * VISCOSITY * width(mass))
    } else {
        0.0
    }
}

impl Glass {
    /// Steps on by `seconds`; returns how many cells flowed.
    pub(super) fn step(&mut self, seconds: f64) -> u64 {
        let mut flows = std::mem::take(&mut self.flows);
        flows.clear();
        self.fastest = 0.0;
        for cell in 0..self.cells.mass.len() {
            // Most cells are dry, or hold a film that nothing moves.
            if self.cells.mass[cell] > self.cells.lightest || self.cells.speed[cell] > 0.0 {
                flows.extend(self.run(cell, seconds));
                self.fastest = self.fastest.max(self.cells.speed[cell]);
            }
        }
        for flow in &flows {
            self.fastest = self.fastest.max(flow.speed);
            self.arrive(*flow);
        }
        self.steps += 1;
        let count = flows.len() as u64;
        self.flows = flows;
        count
    }

    /// A drop's new speed and way; what leaves its cell.
    fn run(&mut self, cell: usize, seconds: f64) -> Option<Flow> {
        let mass = self.cells.mass[cell];
        let speed = self.new_speed(cell, seconds);
        if mass == 0 || speed <= 0.0 {
            (self.cells.speed[cell], self.cells.crossed[cell]) = (0.0, 0.0);
            return None;
        }
        let crossed = f64::from(self.cells.crossed[cell]) + speed * seconds / self.settings.spacing_m;
        (self.cells.speed[cell], self.cells.crossed[cell]) = (speed as f32, crossed as f32);
        if crossed < 1.0 {
            return None;
        }
        let Some(to) = self.choose(cell) else {
            // All ways are barred: the drop waits at its cell's lower edge.
            (self.cells.speed[cell], self.cells.crossed[cell]) = (0.0, 1.0);
            return None;
        };
        let moved = (mass - self.film(mass, speed)).min(FLOW_MOST);
        self.cells.mass[cell] = mass - moved;
        (self.cells.speed[cell], self.cells.crossed[cell]) = (0.0, 0.0);
        Some(Flow { to, mass: moved, speed: speed as f32, crossed: (crossed - 1.0).min(1.0) as f32 })
    }

    /// v' of a drop, 0 or more. The edge's friction is taken at v' itself.
    fn new_speed(&self, cell: usize, seconds: f64) -> f64 {
        let settings = &self.settings;
        let (ng, speed) = (f64::from(self.cells.mass[cell]), f64::from(self.cells.speed[cell]));
        let (mass, width) = (ng * NANOGRAM, width(ng));
        let held = TENSION * width * f64::from(self.cells.affinity[cell]);
        let pull = mass * settings.pull_m_per_s2[1];
        if speed == 0.0 && pull <= held * settings.hold {
            return 0.0;
        }
        let friction = f64::from(self.cells.friction[cell]) * settings.edge_friction * VISCOSITY * width;
        let push = speed * mass + seconds * (pull - held * settings.drag);
        (push / (mass + seconds * friction)).max(0.0)
    }

    /// What stays behind, ng: the drawn film over the width of the drop and the length of its cell.
    fn film(&self, mass: u32, speed: f64) -> u32 {
        let capillary = VISCOSITY * speed / TENSION;
        let thickness = 0.94 * CAPILLARY_LENGTH * libm::cbrt(capillary * capillary);
        let volume = self.settings.wetting * thickness * width(f64::from(mass)) * self.settings.spacing_m;
        // Half at most: a thin drop is no film of its own.
        (volume * NANOGRAMS_PER_M3).min(f64::from(mass / 2)) as u32
    }

    /// The cell below that the roulette finds, `Some(None)` off the pane, `None` where all are barred.
    fn choose(&self, cell: usize) -> Option<Option<usize>> {
        let [width, height] = self.settings.cells;
        let (x, y) = (cell % width, cell / width);
        if y + 1 == height {
            return Some(None);
        }
        let [across, down] = self.settings.pull_m_per_s2;
        // A drop pulled aside by a slope s meets the cells to that side s times as often, and straight ones as much less.
        let aside = (across / down).clamp(-1.0, 1.0);
        let mut areas = [0.0; 3];
        for (k, area) in areas.iter_mut().enumerate() {
            let Some(column) = (x + k).checked_sub(1).filter(|&column| column < width) else { continue };
            let to = (y + 1) * width + column;
            if self.cells.blocked[to] || self.cells.mass[to] >= FLOW_MOST {
                continue;
            }
            let direction =
                [0.25 - 0.5 * aside.min(0.5), 1.0 - aside.abs(), 0.25 + 0.5 * aside.max(-0.5)][k].max(0.0);
            // A cell counts as wet by the film it may hold: a tenth of a millimetre.
            let full = 1e-4 * self.settings.spacing_m * self.settings.spacing_m * NANOGRAMS_PER_M3;
            let wet = (f64::from(self.cells.mass[to]) / full).min(1.0);
            *area =
                direction * f64::from(self.cells.affinity[to]) * (1.0 + self.settings.wet_preference * wet);
        }
        let all = areas.iter().sum::<f64>();
        if all <= 0.0 {
            return None;
        }
        let parts = [self.settings.seed, 2, self.steps, cell as u64];
        let mut ball = (hash(&parts) >> 11) as f64 / (1u64 << 53) as f64 * all;
        let last = areas.iter().rposition(|&area| area > 0.0)?;
        let k = areas.iter().position(|&area| {
            ball -= area;
            ball < 0.0
        });
        Some(Some((y + 1) * width + x + k.unwrap_or(last) - 1))
    }

    /// Drops that meet are one, with their momentum.
    pub(super) fn arrive(&mut self, flow: Flow) {
        let Some(to) = flow.to else {
            self.drained += u64::from(flow.mass);
            return;
        };
        let (here, moved) = (self.cells.mass[to], flow.mass);
        let both = f64::from(here) + f64::from(moved);
        let momentum =
            f64::from(here) * f64::from(self.cells.speed[to]) + f64::from(moved) * f64::from(flow.speed);
        if moved >= here {
            self.cells.crossed[to] = flow.crossed;
        }
        self.cells.speed[to] = if both > 0.0 { (momentum / both) as f32 } else { 0.0 };
        // A cell holds less than FLOW_MOST when it is chosen, and three flows of at most as much can come: 31 bits.
        self.cells.mass[to] = here + moved;
    }
}

/// Properties of water, as a shader has to have them.
#[cfg(all(test, feature = "gpu"))]
pub fn water() -> [(&'static str, f64); 3] {
    [("TENSION", TENSION), ("VISCOSITY", VISCOSITY), ("CAPILLARY_LENGTH", CAPILLARY_LENGTH)]
}
