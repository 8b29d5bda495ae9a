//! Ripples of all puddles: one lattice, advanced to a frame's time from a fixed beginning, and its slopes at all sizes of pixels.
//!
//! Waves die away, so that a lattice which has rained on for some seconds no longer knows when it began. It is begun anew at fixed times and
//! stepped in ticks of fixed length: the same time gives the same water, whichever frames were drawn before. Slopes finer than a pixel are kept as a
//! variance: far puddles are not smooth.

use crate::error::RuntimeError;
use crate::wet::puddle::RippleLookup;
use crate::wet::ripples::{DropFlux, RippleSettings, Ripples};
use glam::{DVec2, Vec2};

/// Steps a second.
const TICKS_PER_S: f64 = 64.0;
/// The lattice begins at a multiple of this, one to two of it before a frame: heights fall to 3·10⁻⁴ in 8 s at the usual damping.
const EPOCH_TICKS: i64 = 512;
/// Ticks that the lattice of the next stretch is stepped by for each tick of this one's, at most: it catches up within a third of a stretch, so that no frame
/// begins one from nothing.
const AHEAD: i64 = 4;
/// Times repeat after so many ticks, 12 days: the lattice's clock must keep its fractions.
const CLOCK_TICKS: i64 = 1 << 26;

/// The lattice at a time.
pub struct Water {
    settings: RippleSettings,
    /// Each with the tick that it was begun at and the one that it is at.
    lattice: Option<(Ripples, i64, i64)>,
    /// The one that the next stretch goes on with, begun with this stretch.
    next: Option<(Ripples, i64, i64)>,
    made_for: Option<(u64, Vec<DropFlux>)>,
    levels: Vec<Level>,
    /// Variance of a slope along an axis.
    variance: f32,
    /// Tick that `levels` are of.
    of_tick: Option<i64>,
    /// Steps of all lattices.
    #[cfg(test)]
    stepped: i64,
}

/// Mean slopes over squares of cells, and the variance that is left within them.
#[derive(Default)]
struct Level {
    side: usize,
    slopes: Vec<[f32; 2]>,
    left: f32,
}

/// Slopes of water over a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WaterSlope {
    /// Mean slope along x and y.
    pub mean: [f32; 2],
    /// Variance along an axis that is finer than the pixel.
    pub variance: f32,
}

impl Water {
    /// Water at rest.
    ///
    /// Errors: as [`Ripples::new`].
    pub fn new(settings: RippleSettings) -> Result<Self, RuntimeError> {
        Ripples::new(settings)?;
        Ok(Self {
            settings,
            lattice: None,
            next: None,
            made_for: None,
            levels: Vec::new(),
            variance: 0.0,
            of_tick: None,
            #[cfg(test)]
            stepped: 0,
        })
    }

    /// Brings the water to a time.
    ///
    /// Errors: as [`Ripples::advance`].
    pub fn advance_to(&mut self, time_s: f64, flux: &[DropFlux], seed: u64) -> Result<(), RuntimeError> {
        if self.made_for.as_ref().is_none_or(|(known, rain)| *known != seed || rain.as_slice() != flux) {
            (self.lattice, self.next, self.of_tick) = (None, None, None);
            self.made_for = Some((seed, flux.to_vec()));
        }
        let tick = (libm::floor(time_s * TICKS_PER_S) as i64).rem_euclid(CLOCK_TICKS);
        if self.of_tick == Some(tick) {
            return Ok(());
        }
        let stretch = tick / EPOCH_TICKS;
        let begin = (stretch - 1).max(0) * EPOCH_TICKS;
        let fits = |kept: &Option<(Ripples, i64, i64)>| {
            kept.as_ref().is_some_and(|(_, known, now)| *known == begin && *now <= tick)
        };
        let kept = if fits(&self.lattice) {
            self.lattice.take()
        } else if fits(&self.next) {
            self.next.take()
        } else {
            None
        };
        let goes_on = kept.is_some();
        let mut lattice = kept.map_or_else(|| self.begun_at(begin), Ok)?;
        let steps = tick - lattice.2;
        self.step(&mut lattice, tick)?;
        // In the first stretch of all the next one's lattice is its own.
        let after = stretch * EPOCH_TICKS;
        if goes_on && after > begin {
            let mut next = match self.next.take() {
                Some(next) if next.1 == after && next.2 <= tick => next,
                _ => self.begun_at(after)?,
            };
            let to = tick.min(next.2 + AHEAD * steps);
            self.step(&mut next, to)?;
            self.next = Some(next);
        }
        self.measure(&mut lattice.0);
        self.lattice = Some(lattice);
        self.of_tick = Some(tick);
        Ok(())
    }

    fn begun_at(&self, begin: i64) -> Result<(Ripples, i64, i64), RuntimeError> {
        Ok((Ripples::new(self.settings)?.starting_at(begin as f64 / TICKS_PER_S), begin, begin))
    }

    /// Steps a lattice to a tick.
    fn step(&mut self, (lattice, _, now): &mut (Ripples, i64, i64), tick: i64) -> Result<(), RuntimeError> {
        let Some((seed, flux)) = &self.made_for else { return Ok(()) };
        while *now < tick {
            *now += 1;
            // To the tick itself, so that its round-off is the same on every way.
            let seconds = *now as f64 / TICKS_PER_S - lattice.time_s();
            lattice.advance(seconds, flux, *seed)?;
            #[cfg(test)]
            {
                self.stepped += 1;
            }
        }
        Ok(())
    }

    /// Slopes of every cell and of squares of cells.
    fn measure(&mut self, lattice: &mut Ripples) {
        let side = self.settings.cells[0];
        let count = side.ilog2() as usize + 1;
        self.levels.resize_with(count, Level::default);
        let first = &mut self.levels[0];
        first.side = side;
        first.slopes.resize(side * self.settings.cells[1], [0.0; 2]);
        lattice.slopes(&mut first.slopes);
        let square = |slopes: &[[f32; 2]]| {
            let sum: f64 = slopes.iter().flatten().map(|&s| f64::from(s) * f64::from(s)).sum();
            (sum / (2.0 * slopes.len() as f64)) as f32
        };
        self.variance = square(&self.levels[0].slopes);
        for number in 1..count {
            let (fine, coarse) = self.levels.split_at_mut(number);
            let (fine, coarse) = (&fine[number - 1], &mut coarse[0]);
            coarse.side = fine.side / 2;
            coarse.slopes.resize(coarse.side * coarse.side, [0.0; 2]);
            for (i, out) in coarse.slopes.iter_mut().enumerate() {
                let at = (2 * (i / coarse.side)) * fine.side + 2 * (i % coarse.side);
                let four = [at, at + 1, at + fine.side, at + fine.side + 1].map(|at| fine.slopes[at]);
                *out =
                    [0, 1].map(|axis| 0.25 * (four[0][axis] + four[1][axis] + four[2][axis] + four[3][axis]));
            }
            coarse.left = (self.variance - square(&coarse.slopes)).max(0.0);
        }
    }

    /// Slopes over a pixel of `footprint` m at a place of the ground.
    pub fn slope(&self, place: DVec2, footprint: f32, lookup: &RippleLookup) -> WaterSlope {
        let Some(finest) = self.levels.first() else { return WaterSlope::default() };
        let spacing = self.settings.spacing_m * lookup.scale;
        // Tiles repeat: double precision is spent before single begins.
        let tile = f64::from(spacing) * finest.side as f64;
        let (sin, cos) = libm::sincos(f64::from(lookup.angle));
        let turned = DVec2::new(cos * place.x + sin * place.y, cos * place.y - sin * place.x);
        let within = Vec2::new(
            (turned.x / tile - libm::floor(turned.x / tile)) as f32,
            (turned.y / tile - libm::floor(turned.y / tile)) as f32,
        );
        let level = libm::log2f((footprint / spacing).max(1.0));
        let number = (level as usize).min(self.levels.len() - 1);
        let level = &self.levels[number];
        let at = within * level.side as f32 - 0.5;
        let (x, y) = (libm::floorf(at.x), libm::floorf(at.y));
        let (u, v) = (at.x - x, at.y - y);
        let cell = |dx: i64, dy: i64| {
            let fold =
                |value: f32, offset: i64| (value as i64 + offset).rem_euclid(level.side as i64) as usize;
            Vec2::from(level.slopes[fold(y, dy) * level.side + fold(x, dx)])
        };
        let mean = cell(0, 0).lerp(cell(1, 0), u).lerp(cell(0, 1).lerp(cell(1, 1), u), v);
        let mean = lookup.slope(mean.to_array());
        WaterSlope { mean, variance: if number == 0 { 0.0 } else { level.left } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rain() -> Vec<DropFlux> {
        vec![DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 150.0 }]
    }

    fn small() -> RippleSettings {
        RippleSettings { cells: [32, 32], ..RippleSettings::default() }
    }

    #[test]
    fn the_same_time_has_the_same_water_whichever_frames_were_before() {
        let lookup = RippleLookup::default();
        let look = |times: &[f64]| {
            let mut water = Water::new(small()).unwrap();
            times.iter().for_each(|&time| water.advance_to(time, &rain(), 3).unwrap());
            (0..40).map(|i| water.slope(DVec2::splat(f64::from(i) * 0.013), 0.0, &lookup)).collect::<Vec<_>>()
        };
        let straight = look(&[20.3]);
        assert_eq!(straight, look(&[19.9, 20.0, 20.1, 20.2, 20.3]));
        assert_eq!(straight, look(&[40.0, 20.3]));
        assert!(straight.iter().any(|slope| slope.mean[0].abs() > 1e-3));
        assert_eq!(look(&[-7.0]).len(), 40);
    }

    #[test]
    fn water_goes_on_where_the_lattice_is_begun_anew() {
        /// Waves of eight seconds before, e^−8, beside those of now.
        const FORGOTTEN: f32 = 0.02;
        let mut water = Water::new(small()).unwrap();
        let lookup = RippleLookup::default();
        let mut look = |time: f64| {
            water.advance_to(time, &rain(), 3).unwrap();
            (0..200)
                .map(|i| water.slope(DVec2::new(f64::from(i) * 0.0171, 0.1), 0.0, &lookup).mean)
                .collect::<Vec<_>>()
        };
        let (before, after) = (look(23.99), look(24.0));
        let change: f32 = before.iter().zip(&after).map(|(a, b)| (a[0] - b[0]) * (a[0] - b[0])).sum();
        let whole: f32 = before.iter().map(|a| a[0] * a[0]).sum();
        // A tick's own motion is most of it: the same as between two ticks of one lattice.
        let (one, two) = (look(22.99), look(23.0));
        let usual: f32 = one.iter().zip(&two).map(|(a, b)| (a[0] - b[0]) * (a[0] - b[0])).sum();
        assert!(change < 3.0 * usual + FORGOTTEN * whole, "{change} {usual} {whole}");
    }

    #[test]
    fn no_frame_but_the_first_begins_a_lattice_from_nothing() {
        let mut water = Water::new(small()).unwrap();
        let look = |water: &Water| water.slope(DVec2::splat(0.13), 0.0, &RippleLookup::default());
        let mut most = 0;
        // Four stretches at 32 frames a second, from late in one.
        for frame in 0..832 {
            let before = water.stepped;
            water.advance_to(14.0 + f64::from(frame) / 32.0, &rain(), 3).unwrap();
            most = if frame > 0 { most.max(water.stepped - before) } else { most };
            if frame % 200 == 100 {
                let mut other = Water::new(small()).unwrap();
                other.advance_to(14.0 + f64::from(frame) / 32.0, &rain(), 3).unwrap();
                assert_eq!(look(&water), look(&other));
            }
        }
        // Two ticks of its own a frame, and four times as many of the next lattice's.
        assert!(most <= 2 * (1 + AHEAD), "{most}");
    }

    #[test]
    fn far_water_is_as_rough_as_near_water() {
        /// A tile's mean slope is 0: all of its variance is within the coarsest cell.
        const ROUND_OFF: f32 = 1e-4;
        let mut water = Water::new(small()).unwrap();
        water.advance_to(9.0, &rain(), 1).unwrap();
        let far = water.slope(DVec2::new(5.0, 7.0), 100.0, &RippleLookup::default());
        assert!(water.variance > 0.0 && (far.variance / water.variance - 1.0).abs() < ROUND_OFF);
        assert!(far.mean[0].abs() < ROUND_OFF);
    }
}
