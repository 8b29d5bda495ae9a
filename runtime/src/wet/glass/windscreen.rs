//! A pane between the eye and the scene, a windscreen or a window, in the rain: \[toyshop\] §5 as an effect over a frame.
//!
//! The pane fills the picture at a distance from the lens and goes with the camera. Rain lands on it at a share of the flux that level ground has; the
//! lattice of [`Glass`] is begun at a fixed time and stepped in ticks of fixed length, with the wipers, so that the same time shows the same drops. A ray from
//! the eye goes through the flat side into the water and out at the water's own surface by Snell's law; what it then meets is looked up in the picture, as far
//! off as the scene is there, and beyond the picture in the world's light. Where it can't come out, and by Fresnel's share elsewhere, the water shows what is before the
//! pane. Where the glass is dry the picture keeps its bits.

use super::{Glass, GlassSettings, Wiper};
use crate::error::RuntimeError;
use crate::medium::Phase;
use crate::parallel::prelude::*;
use crate::wet::controls::controls;
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::material::WATER_INDEX;
use crate::wet::reflect::FresnelTable;
use crate::wet::reflect::pyramid::Pyramid;
use crate::wet::reflect::view::View;
use crate::wet::ripples::DropFlux;
use crate::wet::slopes::sobel;
use crate::world::{InScattering, WorldLight};
use glam::{Vec2, Vec3};
use std::f64::consts::TAU;

controls! {
    /// A pane between the eye and the scene.
    pub struct WindscreenControls {
        /// Distance of the pane from the lens.
        distance: 0.7, 0.1..=5.0, "m", "";
        /// How far the pane leans from upright: drops run more slowly on one that lies.
        lean: 30.0, 0.0..=85.0, "deg", "";
        /// Acceleration up the pane that the wind of driving gives drops; more than gravity's share and they run up.
        lift: 0.0, 0.0..=100.0, "m/s2", "";
        /// Drops that hit the pane, over those that hit as much level ground.
        rain: 0.4, 0.0..=10.0, "", "";
        /// Time that it has rained on the pane where a frame's time is 0.
        wets: 12.0, 0.0..=60.0, "s", "";
        /// Side of the cells that drops live in.
        cell: 2.0, 0.5..=10.0, "mm", "";
        /// What holds a drop that stands: difference of the cosines of its contact angles, .1 on clean glass, .5 on dirty.
        hold: 0.2, 0.0..=2.0, "", "F_s";
        /// How much of the film that a running drop draws stays.
        wetting: 0.3, 0.0..=1.0, "", "";
        /// Standard deviation of how well places of the glass hold water: drops meander.
        roughness: 0.25, 0.0..=1.0, "", "k_a";
        /// Sweeps of two wipers, there and back; 0 has none.
        wipers: 0.0, 0.0..=120.0, "1/min", "";
        /// Share of the water that slips under a blade.
        leaves: 0.03, 0.0..=1.0, "", "";
        /// Light before the pane, which water mirrors, over the world's mean.
        front: 0.1, 0.0..=100.0, "", "";
        /// Factor on the bend of rays.
        bend: 1.0, 0.0..=1.0, "", "";
    }
}

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WindscreenReport {
    /// Pixels that show water, or a wiper.
    pub pixels: u64,
    /// Cells with water.
    pub cells: u64,
}

/// Steps a second.
const TICKS_PER_S: f64 = 64.0;
/// The pane is begun anew after so many ticks, ten minutes.
const EPOCH_TICKS: i64 = 64 * 600;
/// Cells of a pane at most.
const CELLS_MOST: f64 = 600_000.0;
/// Largest side of a cell, m.
const CELL_MOST_M: f64 = 0.1;
/// Times farther from 0 than this count as this, s: as far as a command's go.
const TIME_MOST_S: f64 = 1e9;
/// Values of the water's heights at most.
const VALUES_MOST: usize = 4_000_000;
/// Water thinner than this is dry glass, m: a tenth of a wavelength.
const DRY_M: f32 = 5e-8;
/// Steepest slope of a drop's surface: the rim of a half ball stands upright, a drop on glass does not.
const STEEPEST: f32 = 1.4;
/// Share of the picture beyond its edges over which it gives way to the world's light.
const BORDER: f32 = 0.1;
/// Depth that stands for what has none, m.
const FAR_M: f32 = 1e4;

/// What a pane was made for: another one is begun anew.
#[derive(Clone, Debug, PartialEq)]
struct MadeFor {
    settings: GlassSettings,
    flux: Vec<DropFlux>,
    rain: f32,
    wipers: [f32; 2],
    /// Whether drops run up.
    up: bool,
    begin: i64,
}

/// A wet pane before the eye; keeps its water, and memory, from frame to frame.
#[derive(Default)]
pub struct Windscreen {
    pane: Option<(Glass, MadeFor, i64)>,
    heights: Vec<f32>,
    picture: Pyramid,
    world: Option<(WorldLight, InScattering)>,
    fresnel: FresnelTable,
}

impl Windscreen {
    /// No pane yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Draws the pane's water over `picture`, which is the frame as it is behind the pane.
    ///
    /// # Errors
    ///
    /// A picture or buffers of another size than the camera's, a time that is no number, controls out of their ranges.
    pub fn draw(
        &mut self,
        (frame, picture): (&WetFrame<'_>, &[[f32; 3]]),
        controls: &WindscreenControls,
        out: &mut Layer,
    ) -> Result<WindscreenReport, RuntimeError> {
        frame.check()?;
        controls.check()?;
        let size = frame.buffer.size;
        if picture.len() != size[0] * size[1] {
            let wanted = format!("{} pixels", size[0] * size[1]);
            return Err(RuntimeError::argument("picture", wanted, picture.len()));
        }
        if !frame.time_s.is_finite() {
            return Err(RuntimeError::argument("time_s", "a finite number", frame.time_s));
        }
        out.clear(size);
        let seconds = tick_of(frame.time_s) as f64 / TICKS_PER_S;
        let blades = if controls.wipers > 0.0 { blades(size, seconds, controls) } else { Vec::new() };
        let front = Vec3::from_array(frame.light.mean_radiance()) * controls.front;
        if frame.flux.is_empty() || controls.rain == 0.0 {
            let pixels = if blades.is_empty() { 0 } else { draw_rows(out, size[0], (&blades, front), None) };
            return Ok(WindscreenReport { pixels, cells: 0 });
        }
        let view = View::new(frame.camera);
        let up = controls.lift > gravity(controls);
        let away = if view.is_parallel() { 1.0 } else { controls.distance };
        let height_m = away * size[1] as f32 / view.focal().y;
        let settings = settings(frame, controls, height_m);
        self.advance(frame, controls, settings)?;
        let Some((glass, ..)) = &self.pane else { return Ok(WindscreenReport::default()) };
        let cells = settings.cells;
        let per_cell = size[1].div_ceil(cells[1]).clamp(1, 8);
        let fits = (1..=per_cell).rev().find(|n| cells[0] * cells[1] * n * n <= VALUES_MOST).unwrap_or(1);
        let fine = cells.map(|cells| cells * fits);
        self.heights.resize(fine[0] * fine[1], 0.0);
        glass.heights(fits, &mut self.heights)?;
        self.picture.fill(size, picture);
        let kept = self.world.take().filter(|kept| kept.0 == *frame.light);
        let world = self.world.insert(kept.unwrap_or_else(|| {
            (frame.light.clone(), frame.light.in_scattering(&Phase::HenyeyGreenstein(1.0)))
        }));
        let sight = Sight {
            view: &view,
            picture: &self.picture,
            depth_m: &frame.buffer.depth_m,
            world: &world.1,
            front,
            fresnel: &self.fresnel,
            heights: with_margin(fine, &self.heights, up),
            fine,
            per_m: (fits as f64 / settings.spacing_m) as f32,
            controls,
        };
        let pixels = draw_rows(out, size[0], (&blades, front), Some(&sight));
        Ok(WindscreenReport { pixels, cells: glass.wet_cells() })
    }

    /// Brings the pane to the frame's time.
    fn advance(
        &mut self,
        frame: &WetFrame<'_>,
        controls: &WindscreenControls,
        settings: GlassSettings,
    ) -> Result<(), RuntimeError> {
        let tick = tick_of(frame.time_s);
        // Before time 0 the pane is the first one's, and dry before its rain begins.
        let begin = tick.div_euclid(EPOCH_TICKS).max(0) * EPOCH_TICKS;
        let up = controls.lift > gravity(controls);
        let before = (f64::from(controls.wets) * TICKS_PER_S) as i64;
        let made_for = MadeFor {
            settings,
            flux: frame.flux.to_vec(),
            rain: controls.rain,
            wipers: [controls.wipers, controls.leaves],
            up,
            begin: begin - before,
        };
        let kept = self.pane.take().filter(|(_, known, now)| *known == made_for && *now <= tick);
        let (mut glass, made_for, mut now) = match kept {
            Some(kept) => kept,
            None => (Glass::new(settings)?, made_for, begin - before),
        };
        let wipers = wipers(settings.cells.map(|n| n as f64 * settings.spacing_m), controls.leaves);
        let step = 1.0 / TICKS_PER_S;
        while now < tick {
            for drop in frame.flux {
                let flux = drop.impacts_per_m2_s * f64::from(controls.rain);
                glass.rain(drop.diameter_m.min(super::DIAMETER_MOST), flux, step)?;
            }
            glass.advance(step)?;
            if controls.wipers > 0.0 {
                let [from, to] = [now, now + 1].map(|now| angle(now as f64 * step, controls.wipers, up));
                for wiper in &wipers {
                    let wiper = if up { mirrored(wiper, settings) } else { *wiper };
                    if from != to {
                        glass.wipe(&wiper, from, to)?;
                    }
                }
            }
            now += 1;
        }
        self.pane = Some((glass, made_for, now));
        Ok(())
    }
}

/// Ticks from time 0 to a time, s.
fn tick_of(time_s: f64) -> i64 {
    libm::floor(time_s.clamp(-TIME_MOST_S, TIME_MOST_S) * TICKS_PER_S) as i64
}

/// Draws water, where there is any, and blades over it into a layer of so many columns; pixels that show some.
fn draw_rows(
    out: &mut Layer,
    width: usize,
    (blades, front): (&[Blade], Vec3),
    sight: Option<&Sight<'_>>,
) -> u64 {
    let rows = out.light.par_chunks_mut(width).zip(out.alpha.par_chunks_mut(width)).enumerate();
    let row = |(y, (light, alpha)): (usize, (&mut [[f32; 3]], &mut [f32]))| {
        if let Some(sight) = sight {
            sight.row(y, light, alpha);
        }
        wipe_row(blades, front, y, light, alpha);
        alpha.iter().filter(|alpha| **alpha > 0.0).count() as u64
    };
    rows.map(row).sum()
}

/// Gravity's share along a leaning pane, m/s².
fn gravity(controls: &WindscreenControls) -> f32 {
    9.80665 * libm::cosf(controls.lean.to_radians())
}

/// The lattice of a pane of this height, m. One that would have too many cells of the largest side stands for itself at a smaller scale.
fn settings(frame: &WetFrame<'_>, controls: &WindscreenControls, height_m: f32) -> GlassSettings {
    let [width, height] = frame.buffer.size;
    let height_m = f64::from(height_m);
    let width_m = height_m * width as f64 / height as f64;
    let least = libm::sqrt(width_m * height_m / CELLS_MOST);
    let spacing_m = (f64::from(controls.cell) * 1e-3).max(least).min(height_m / 3.0).clamp(1e-5, CELL_MOST_M);
    let [across, down] = [width_m, height_m].map(|side| libm::ceil(side / spacing_m));
    let share = libm::sqrt(CELLS_MOST / (across * down)).min(1.0);
    let cells = [across, down].map(|side| (libm::floor(side * share) as usize).clamp(3, super::CELLS_MAX));
    let pull = f64::from((gravity(controls) - controls.lift).abs()).max(1e-3);
    let hold = f64::from(controls.hold);
    GlassSettings {
        cells,
        spacing_m,
        pull_m_per_s2: [0.0, pull],
        hold,
        drag: 0.5 * hold,
        wetting: f64::from(controls.wetting),
        roughness: f64::from(controls.roughness),
        seed: frame.seed,
        ..GlassSettings::default()
    }
}

/// Two wipers that turn about pivots below the pane.
fn wipers([width, height]: [f64; 2], leaves: f32) -> [Wiper; 2] {
    [0.18, 0.62].map(|across| Wiper {
        pivot_m: [across * width, 1.06 * height],
        inner_m: 0.2 * height,
        outer_m: 0.98 * height,
        leaves: f64::from(leaves),
    })
}

/// Where blades point at a time: from lying to the right, over upright, to leaning left, and back.
fn angle(seconds: f64, per_minute: f32, up: bool) -> f64 {
    const LIES: f64 = 0.08;
    const SWEEP: f64 = 1.85;
    let turns = seconds * f64::from(per_minute) / 60.0;
    let share = 0.5 - 0.5 * libm::cos(TAU * (turns - libm::floor(turns)));
    let angle = -(LIES + SWEEP * share);
    if up { -angle } else { angle }
}

/// The wiper on a pane whose lattice lies upside down.
fn mirrored(wiper: &Wiper, settings: GlassSettings) -> Wiper {
    let height = settings.cells[1] as f64 * settings.spacing_m;
    Wiper { pivot_m: [wiper.pivot_m[0], height - wiper.pivot_m[1]], ..*wiper }
}

/// Heights with a margin of one value that repeats the edge, turned upside down where drops run up.
fn with_margin(size: [usize; 2], heights: &[f32], up: bool) -> Vec<f32> {
    if !up {
        return super::see::with_margin(size, heights);
    }
    let turned: Vec<f32> = heights.chunks_exact(size[0]).rev().flatten().copied().collect();
    super::see::with_margin(size, &turned)
}

/// What rays through the pane meet.
struct Sight<'a> {
    view: &'a View,
    picture: &'a Pyramid,
    depth_m: &'a [f32],
    world: &'a InScattering,
    front: Vec3,
    fresnel: &'a FresnelTable,
    heights: Vec<f32>,
    fine: [usize; 2],
    per_m: f32,
    controls: &'a WindscreenControls,
}

impl Sight<'_> {
    fn row(&self, y: usize, light: &mut [[f32; 3]], alpha: &mut [f32]) {
        let mut before: Option<Vec2> = None;
        for (x, (light, alpha)) in light.iter_mut().zip(alpha).enumerate() {
            let Some(slope) = self.slope(x, y) else {
                before = None;
                continue;
            };
            let (shown, at) = self.through([x, y], slope, before);
            before = at;
            (*light, *alpha) = (shown.max(Vec3::ZERO).into(), 1.0);
        }
    }

    /// Slope of the water over a pixel, to the right and up; `None` where the glass is dry, or even.
    fn slope(&self, x: usize, y: usize) -> Option<Vec2> {
        let [width, height] = self.view.size;
        let place = |at: usize, pixels: usize, values: usize| {
            let at = (at as f32 + 0.5) / pixels as f32 * values as f32 - 0.5;
            let at = at.clamp(0.0, (values - 1) as f32);
            (at as usize, at - libm::floorf(at))
        };
        let ((column, u), (row, v)) = (place(x, width, self.fine[0]), place(y, height, self.fine[1]));
        let stride = self.fine[0] + 2;
        let mut sum = Vec2::ZERO;
        for (dx, dy, weight) in
            [(0, 0, (1.0 - u) * (1.0 - v)), (1, 0, u * (1.0 - v)), (0, 1, (1.0 - u) * v), (1, 1, u * v)]
        {
            let (column, row) = ((column + dx).min(self.fine[0] - 1), (row + dy).min(self.fine[1] - 1));
            let rows = [0, 1, 2].map(|k| &self.heights[(row + k) * stride..][..stride]);
            if weight > 0.0 && rows[1][column + 1] > DRY_M {
                let [right, down] = sobel(rows, column, self.per_m);
                sum += weight * Vec2::new(right, -down);
            }
        }
        (sum != Vec2::ZERO).then(|| sum.clamp_length_max(STEEPEST))
    }

    /// What a pixel shows through water of a slope, and where in the picture that is.
    fn through(&self, [x, y]: [usize; 2], slope: Vec2, before: Option<Vec2>) -> (Vec3, Option<Vec2>) {
        let straight = self.view.ray([x as f32 + 0.5, y as f32 + 0.5]);
        let from = self.view.place(x, y, self.controls.distance);
        let direction = if self.view.is_parallel() { Vec3::Z } else { straight.normalize() };
        // Into the water at the flat side, out of it at its own.
        let inside = bent(direction, Vec3::Z, 1.0 / WATER_INDEX as f32).unwrap_or(direction);
        let outwards = Vec3::new(-slope.x, -slope.y, 1.0).normalize();
        let cosine = inside.dot(outwards);
        let Some(exit) = bent(inside, outwards, WATER_INDEX as f32).filter(|exit| exit.z > 0.02) else {
            return (self.front, None);
        };
        let exit = direction.lerp(exit, self.controls.bend).normalize();
        // Light that comes out at a cosine is reflected there as light that goes in at the other side's.
        let mirrored = self.fresnel.at(if cosine > 0.0 { exit.dot(outwards).max(0.0) } else { 0.0 });
        let width = self.view.size[0];
        let depth = self.depth_m[y * width + x];
        let depth = if depth > 0.0 { depth.min(FAR_M) } else { FAR_M };
        let along = ((depth - from.z) / exit.z).max(0.0);
        let at = self.view.pixel(from + exit * along);
        let world = || Vec3::from_array(self.world.diffuse(self.view.to_world(exit)));
        // Beyond its edges the picture goes on as its edge for a little, and gives way to the world.
        let size = Vec2::new(self.view.size[0] as f32, self.view.size[1] as f32);
        let beyond = ((at - at.clamp(Vec2::ZERO, size)) / size).abs().max_element() / BORDER;
        let seen = if beyond < 1.0 {
            // As wide as what neighbours show lies apart.
            let apart = before.map_or(2.0, |before| before.distance(at));
            let shown = self.picture.at(at, libm::log2f(apart.clamp(1.0, 64.0)));
            if beyond > 0.0 { shown.lerp(world(), beyond) } else { shown }
        } else {
            world()
        };
        (seen.lerp(self.front, mirrored), Some(at))
    }
}

/// A unit direction bent at a surface with a unit normal that looks the way the light goes; `index` is the side's that it comes from over the other's. `None` is total
/// reflection.
fn bent(direction: Vec3, normal: Vec3, index: f32) -> Option<Vec3> {
    let cosine = direction.dot(normal);
    let rest = 1.0 - index * index * (1.0 - cosine * cosine);
    (rest > 0.0).then(|| direction * index + normal * (rest.sqrt() - index * cosine))
}

/// A blade in the picture: its ends, px, and half its width at each.
struct Blade {
    ends: [Vec2; 2],
    half_px: f32,
}

/// Blades as the eye sees them.
fn blades([width, height]: [usize; 2], seconds: f64, controls: &WindscreenControls) -> Vec<Blade> {
    let size = [width as f64, height as f64];
    let turn = angle(seconds, controls.wipers, false);
    let (sin, cos) = libm::sincos(turn);
    wipers(size, controls.leaves)
        .into_iter()
        .map(|wiper| {
            let at = |radius: f64| {
                Vec2::new((wiper.pivot_m[0] + radius * cos) as f32, (wiper.pivot_m[1] + radius * sin) as f32)
            };
            Blade { ends: [at(0.0), at(wiper.outer_m)], half_px: 0.008 * height as f32 }
        })
        .collect()
}

/// Lays blades over a row: dark rubber, out of focus.
fn wipe_row(blades: &[Blade], front: Vec3, y: usize, light: &mut [[f32; 3]], alpha: &mut [f32]) {
    for blade in blades {
        let [a, b] = blade.ends;
        let way = b - a;
        for (x, (light, alpha)) in light.iter_mut().zip(alpha.iter_mut()).enumerate() {
            let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - a;
            let along = (at.dot(way) / way.length_squared()).clamp(0.0, 1.0);
            let away = at.distance(way * along) / blade.half_px;
            let cover = (1.5 - away).clamp(0.0, 1.0);
            if cover > 0.0 {
                let dark = front * (0.3 * cover);
                *light = (Vec3::from_array(*light) * (1.0 - cover) + dark).into();
                *alpha = cover + (1.0 - cover) * *alpha;
            }
        }
    }
}

#[cfg(test)]
mod tests;
