//! The life of a photon: where it goes, and what it leaves on its way.
//!
//! Its first flight is followed to the end, and leaves expected values: e^{−τ} of its power arrives at optical depth τ. It is
//! then made to collide inside the grid, with the weight 1 − e^{−τ_total}. From there on every flight is drawn as it comes,
//! and leaves weight times length in each cell passed. A collision takes the absorbed share of the weight; light paths end
//! outside, or by Russian roulette once little is left.

use super::image::Viewpoint;
use super::phase::Phase;
use super::traverse::{Grid, Place};
use crate::progress::Progress;
use glam::DVec3;
use squall_runtime::random::Random;

/// Optical depth beyond which light that was never scattered is not followed: e^−60 is below 10⁻²⁶.
const DARK: f64 = 60.0;
/// Share of its first weight below which a photon plays roulette, and the share that a survivor goes on with.
const ROULETTE: [f64; 2] = [0.1, 0.5];
/// Collisions between two looks at whether to stop.
const PATIENCE: u64 = 1 << 14;

/// What photons are followed through.
pub struct Scene<'a> {
    /// The grid.
    pub grid: Grid<'a>,
    /// Single-scattering albedo.
    pub albedo: f64,
    /// Phase function.
    pub phase: Phase,
    /// Directions that J is gathered towards.
    pub towards: Vec<DVec3>,
    /// Cameras.
    pub view_region: Vec<Viewpoint>,
}

/// Values per cell ahead of J: scattered and never scattered fluence.
pub const FLUENCES: usize = 2;

/// What the photons of one batch leave.
#[derive(Clone, Debug)]
pub struct Tally {
    /// Per cell, innermost: power times length of scattered and of never scattered light, then times p towards each
    /// direction, W·m and W·m/sr.
    pub cells: Vec<f64>,
    /// Radiance per pixel of each camera, W/(m² sr).
    pub images: Vec<Vec<f64>>,
    /// Where the power went.
    pub power: Power,
}

/// Where the power of photons went, W.
#[derive(Clone, Copy, Debug, Default)]
pub struct Power {
    /// Met the grid.
    pub met: f64,
    /// Absorbed.
    pub absorbed: f64,
    /// Left unscattered.
    pub direct_out: f64,
    /// Left scattered, by −x, +x, −y, +y, −z, +z.
    pub scattered_out: [f64; 6],
}

impl Scene<'_> {
    /// Values per cell.
    pub fn stride(&self) -> usize {
        FLUENCES + self.towards.len()
    }

    /// An empty tally.
    pub fn tally(&self, cells: usize) -> Tally {
        let images = self.view_region.iter().map(|eye| vec![0.0; eye.pixels()]).collect();
        Tally { cells: vec![0.0; cells * self.stride()], images, power: Power::default() }
    }

    /// Follows one photon of `power` from `start`. Gives `false` when somebody wants to stop.
    pub fn follow(
        &self,
        (start, direction): (DVec3, DVec3),
        power: f64,
        random: &mut Random,
        tally: &mut Tally,
        progress: &dyn Progress,
    ) -> bool {
        let Some(mut place) = self.grid.enter(start, direction) else { return true };
        tally.power.met += power;
        let (depth, open) = self.first_flight(place, direction, power, &mut tally.cells);
        tally.power.direct_out += power * open;
        let first = -power * libm::expm1(-depth);
        if first <= 0.0 {
            return true;
        }
        // A depth below the total, with the density e^−τ there; round-off must not carry it past the last cell.
        let drawn = -libm::log1p(random.unit() * libm::expm1(-depth));
        let reached = collision(drawn.min(depth * (1.0 - 1e-12)));
        if self.grid.walk(&mut place, direction, reached).is_some() {
            // A depth of so few digits that it cannot be undercut: next to nothing, and it leaves.
            tally.power.direct_out += first;
            return true;
        }
        self.scatter_on((place, direction), first, random, tally, progress)
    }

    /// Leaves expected values of light that was never scattered along the whole way. Gives the optical depth of the way, and
    /// the share that leaves.
    fn first_flight(&self, start: Place, direction: DVec3, power: f64, cells: &mut [f64]) -> (f64, f64) {
        let (mut place, mut depth, mut open) = (start, 0.0f64, 1.0f64);
        let stride = self.stride();
        let phases: &[f64] = &self.phases(direction);
        let left = self.grid.walk(&mut place, direction, |cell, length, extinction| {
            let passed = extinction * length;
            let gone = open * gone(passed);
            // ∫ e^{−τ} ds over the cell: what is gone over the extinction, or the length where nothing is.
            let light = power * if passed > 1e-12 { gone / extinction } else { open * length };
            let tally = &mut cells[cell * stride..(cell + 1) * stride];
            tally[1] += light;
            for (j, phase) in tally[FLUENCES..].iter_mut().zip(phases) {
                *j += light * phase;
            }
            depth += passed;
            open -= gone;
            (depth > DARK).then_some(length)
        });
        (depth, if left.is_some() { libm::exp(-depth) } else { 0.0 })
    }

    /// p from `direction` towards each direction asked for.
    fn phases(&self, direction: DVec3) -> Phases {
        match self.towards.as_slice() {
            [] => Phases::None,
            [one] => Phases::One([self.phase.value(direction, *one)]),
            many => Phases::Many(many.iter().map(|to| self.phase.value(direction, *to)).collect()),
        }
    }

    /// From a collision at `place` to the end.
    fn scatter_on(
        &self,
        (mut place, mut direction): (Place, DVec3),
        first: f64,
        random: &mut Random,
        tally: &mut Tally,
        progress: &dyn Progress,
    ) -> bool {
        let (mut weight, mut collisions) = (first, 0u64);
        let stride = self.stride();
        loop {
            tally.power.absorbed += weight * (1.0 - self.albedo);
            weight *= self.albedo;
            if weight == 0.0 {
                return true;
            }
            for (eye, image) in self.view_region.iter().zip(&mut tally.images) {
                eye.gather(&self.grid, &self.phase, (&place, direction), weight, image);
            }
            let [low, survivor] = ROULETTE;
            if weight < low * first {
                if random.unit() * survivor * first >= weight {
                    return true;
                }
                weight = survivor * first;
            }
            collisions += 1;
            if collisions % PATIENCE == 0 && progress.interrupted() {
                return false;
            }
            direction = self.phase.scatter(direction, random);
            let phases: &[f64] = &self.phases(direction);
            let (cells, mut collision) = (&mut tally.cells, collision(random.exponential()));
            let left = self.grid.walk(&mut place, direction, |cell, length, extinction| {
                let stop = collision(cell, length, extinction);
                let light = weight * stop.unwrap_or(length);
                let tally = &mut cells[cell * stride..(cell + 1) * stride];
                tally[0] += light;
                for (j, phase) in tally[FLUENCES..].iter_mut().zip(phases) {
                    *j += light * phase;
                }
                stop
            });
            if let Some(side) = left {
                tally.power.scattered_out[side] += weight;
                return true;
            }
        }
    }
}

/// Stops a walk at optical depth `wanted`.
fn collision(wanted: f64) -> impl FnMut(usize, f64, f64) -> Option<f64> {
    let mut depth = 0.0;
    move |_, length, extinction| {
        let next = depth + extinction * length;
        // An empty cell adds nothing, and stops nothing even where nothing was wanted.
        if next > wanted {
            return Some(((wanted - depth) / extinction).clamp(0.0, length));
        }
        depth = next;
        None
    }
}

/// 1 − e^−x for x ≥ 0.
#[inline]
fn gone(x: f64) -> f64 {
    if x > 0.5 { 1.0 - libm::exp(-x) } else { -libm::expm1(-x) }
}

/// Phase function values, one heap allocation less for the usual one camera.
enum Phases {
    None,
    One([f64; 1]),
    Many(Vec<f64>),
}

impl std::ops::Deref for Phases {
    type Target = [f64];
    fn deref(&self) -> &[f64] {
        match self {
            Self::None => &[],
            Self::One(one) => one,
            Self::Many(many) => many,
        }
    }
}
