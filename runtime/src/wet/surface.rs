//! Wet surfaces: what rain darkens, what it covers with a film, what stands in puddles, and what all of it mirrors.
//!
//! A pixel's light is taken apart: what its surface sends of its own stays; what it throws back diffusely falls with its albedo as water fills its pores,
//! and by what the film above reflects before it comes in or goes out; on top comes what the film mirrors ([`super::reflect`]). Where buffers don't tell
//! parts from one another, all of the light counts as diffuse. A pixel that is dry keeps its bits.
//!
//! The film of rough ground is looked at for every eighth pixel along both axes, and nearer together where these looks differ; puddles for every pixel.

mod film;
pub mod lightning;
pub(super) mod nodes;
pub mod puddles;
mod task;
pub mod water;

use super::reflect::march::{March, inverse_of};
use super::reflect::pyramid::Pyramid;
use super::reflect::view::View;
use super::reflect::{FresnelTable, Mirror, Mirrored};
use crate::error::RuntimeError;
use crate::medium::Phase;
use crate::parallel::prelude::*;
use crate::wet::controls::controls;
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::material::{Material, Wetness, WetnessRates, wet_share};
use crate::wet::puddle::RippleLookup;
use crate::wet::ripples::RippleSettings;
use crate::wet::splash::hits::Fall;
use crate::world::{InScattering, WorldLight};
use glam::{DVec3, Vec3};
use puddles::Hollows;
use task::Task;
use water::Water;

controls! {
    /// How rain changes surfaces.
    pub struct SurfaceControls {
        /// Time that it has rained where a frame's time is 0: wetness and puddles grow from there.
        soaked: 1800.0, 0.0..=1e7, "s", "";
        /// Water that a surface holds before the rest runs off.
        holds: 0.5, 0.01..=10.0, "mm", "";
        /// What wet surfaces lose to the air.
        dries: 0.1, 0.0..=100.0, "mm/h", "";
        /// Share of the rain that runs down walls which it doesn't fall on.
        walls: 0.15, 0.0..=1.0, "", "";
        /// Factor on pores, as roughness tells of them: none below .4, full from .8 on.
        porosity: 1.0, 0.0..=1.0, "", "";
        /// Albedo of surfaces whose file has none.
        albedo: 0.2, 0.0..=1.0, "", "";
        /// Roughness of surfaces whose file has none.
        roughness: 0.8, 0.0..=1.0, "", "";
        /// Share of a soaked surface that a film covers, which mirrors.
        film: 0.85, 0.0..=1.0, "", "";
        /// Standard deviation of the film's slopes on rough ground.
        film_slope: 0.11, 0.0..=1.0, "", "";
        /// Share of flat ground under puddles when they are full, where no map was baked.
        puddles: 0.3, 0.0..=1.0, "", "";
        /// Width of a puddle, where no map was baked.
        puddle_size: 3.0, 0.05..=1000.0, "m", "";
        /// Depth of full puddles where they are deepest.
        puddle_depth: 0.02, 0.0001..=2.0, "m", "d_i";
        /// Rain that fills them, run off from around.
        fills: 8.0, 0.01..=1000.0, "mm", "";
        /// Over depth, how far water hides the ground's own unevenness.
        influence: 250.0, 0.0..=1e5, "1/m", "p_i";
        /// Standard deviation of slopes of water that no drop moves: wind.
        puddle_slope: 0.004, 0.0..=0.5, "", "";
        /// Factor on ripples' slopes.
        ripples: 1.0, 0.0..=10.0, "", "";
        /// Metres of the ground that a metre of the lattice of ripples covers.
        ripple_scale: 1.0, 0.01..=100.0, "", "s_o";
        /// Turn of the lattice of ripples.
        ripple_angle: 0.0, -360.0..=360.0, "deg", "θ_o";
        /// Factor on what is mirrored.
        mirror: 1.0, 0.0..=10.0, "", "";
        /// How far mirrored rays are followed.
        reach: 1000.0, 0.1..=1e6, "m", "";
        /// How thick things are behind what the camera sees of them.
        thickness: 2.0, 0.001..=1e4, "m", "";
        /// How far what nodes mirror may differ for what lies between to be told by them, as a share; at 0 every film is looked at.
        tolerance: 0.1, 0.0..=1.0, "", "";
        /// Above ½, streaks are the paper's: a mirror image smeared by distance.
        paper_streaks: 0.0, 0.0..=1.0, "", "";
        /// How many pixels a metre of distance smears them, of a picture of 1080 rows.
        paper_stretch: 1.5, 0.0..=1000.0, "px/m", "";
        /// Above ½, Fresnel's reflection is the paper's .95 (1 − n·v)⁴ + .05.
        paper_fresnel: 0.0, 0.0..=1.0, "", "f";
        /// Exponent of the paper's attenuation at edges, which takes grazing reflection away; 0 leaves it.
        edge_exponent: 0.0, 0.0..=64.0, "", "f_o";
    }
}

/// What a pixel's surface is, before rain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePixel {
    /// Light towards the eye.
    pub colour: [f32; 3],
    /// The part of it that the surface sends of its own.
    pub emission: [f32; 3],
    /// What it is made of.
    pub material: Material,
    /// How wet it is.
    pub wetness: Wetness,
    /// Share under a film or puddle, 0 to 1.
    pub film: f32,
    /// Cosine between normal and eye.
    pub cosine: f32,
}

/// What a pixel's water mirrors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceLight {
    /// Radiance towards the eye of a whole film, Fresnel's reflection in it.
    pub mirrored: [f32; 3],
    /// Fresnel's reflection at the eye's angle.
    pub fresnel: f32,
}

/// A pixel when it is wet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WetPixel {
    /// Share that is left of diffuse light, per colour.
    pub kept: [f32; 3],
    /// What the film mirrors.
    pub mirrored: [f32; 3],
}

impl WetPixel {
    /// Light towards the eye.
    pub fn light(&self, pixel: &SurfacePixel) -> [f32; 3] {
        std::array::from_fn(|band| {
            let (own, all) = (pixel.emission[band], pixel.colour[band]);
            own + (all - own) * self.kept[band] + self.mirrored[band]
        })
    }
}

/// Mean reflection of diffuse light at water, from outside: 1 less it is what [`super::material::wet_albedo`] lets in and, in the mean, out.
const MEAN_REFLECTION: f32 = 0.066_405_8;

/// A pixel's light when its surface is as wet as `pixel` says. Linear in colour, emission and mirrored light; of dry ones nothing changes.
///
/// A film at an angle at which it reflects F lets (1 − F)/(1 − s F̄) of the mean out: F̄ is the mean over all angles, and s the porosity times the
/// wetness, as wet albedo has F̄ in it to that share. On a smooth surface, and on one that is black to diffuse light, 1 − F is left.
pub fn wet_surface(pixel: &SurfacePixel, light: &SurfaceLight) -> WetPixel {
    let film = pixel.film.clamp(0.0, 1.0);
    let soaked = pixel.material.porosity.clamp(0.0, 1.0) * pixel.wetness.share.clamp(0.0, 1.0);
    let out = |soaked: f32| 1.0 - film + film * (1.0 - light.fresnel) / (1.0 - soaked * MEAN_REFLECTION);
    let (above, black) = (out(soaked), out(0.0));
    let kept = std::array::from_fn(|band| {
        let dry = pixel.material.albedo[band];
        let left = 1.0 + soaked * (wet_share(dry) - 1.0);
        (if dry * left > DARKEST { left * above } else { black }).min(1.0)
    });
    WetPixel { kept, mirrored: light.mirrored.map(|value| value * film) }
}

/// Albedo below which a surface is black.
const DARKEST: f32 = 1e-5;

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceReport {
    /// Wet pixels.
    pub wet: usize,
    /// Pixels with water standing.
    pub puddles: usize,
    /// Rays followed.
    pub rays: usize,
}

/// Wet surfaces of frames; keeps memory, ripples and the world's light between them.
pub struct Surface {
    water: Water,
    hollows: Hollows,
    seed: u64,
    picture: Pyramid,
    world: Option<(WorldLight, InScattering)>,
    states: Vec<State>,
    inverse_depth: Vec<f32>,
    nodes: nodes::Nodes<Look>,
    looks: film::Films,
    films: Vec<Film>,
    smear: Smear,
    tables: [FresnelTable; 2],
}

/// The paper's reflection buffer, half the frame's size.
#[derive(Default)]
struct Smear {
    light: Vec<[f32; 3]>,
    wet: Vec<bool>,
    reach: Vec<f32>,
    out: Vec<[f32; 3]>,
}

/// A pixel's water.
#[derive(Clone, Copy, Default)]
struct State {
    wetness: f32,
    /// Share under standing water.
    puddle: f32,
}

/// What lies under a look of two by two pixels.
#[derive(Clone, Copy)]
struct Ground {
    /// The pixel whose film is looked at, and the one whose water is.
    pixel: [usize; 2],
    most: [usize; 2],
    /// Standard deviation of the film's slopes; below 0 there is no film.
    slope: f32,
    normal: Vec3,
    /// 0 where nothing is wet.
    depth: f32,
}

impl Default for Ground {
    /// Dry, or sky: without a film.
    fn default() -> Self {
        Self { pixel: [0; 2], most: [0; 2], slope: -1.0, normal: Vec3::ZERO, depth: 0.0 }
    }
}

/// What the film of every other pixel mirrors.
#[derive(Clone, Copy, Default)]
struct Film {
    /// What standing water in the same pixel mirrors, where it is so far away that neighbours need no look of their own.
    standing: Mirrored,
    light: [f32; 3],
    fresnel: f32,
    /// Whether there is a film.
    shown: bool,
    normal: Vec3,
    depth: f32,
}

/// What a place is told of the rain and of water.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Look {
    /// Whether rain comes there, and whether it would without wind.
    open: bool,
    open_when_calm: bool,
    /// Depth of water when puddles are full, and where its own puddle is deepest, m.
    basin: [f32; 2],
}

impl Look {
    /// Between nodes that agree.
    fn between(around: &nodes::Around<'_, Self>) -> Option<Self> {
        let mut all: Option<Self> = None;
        for (node, weight) in around.told() {
            let [depth, deepest] = node.value.basin;
            let part = weight * depth;
            match &mut all {
                None => all = Some(Self { basin: [part, deepest], ..node.value }),
                Some(all) => {
                    let (open, calm) =
                        (all.open == node.value.open, all.open_when_calm == node.value.open_when_calm);
                    if !(open && calm && all.basin[1] == deepest) {
                        return None;
                    }
                    all.basin[0] += part;
                }
            }
        }
        all
    }
}

/// Roughness from which surfaces have pores, and from which they are full of them.
const POROUS: [f32; 2] = [0.4, 0.8];
/// Pixels that cover so much of the ground share what standing water mirrors with their neighbours, m: a lattice's cells are finer.
const SHARED_M: f32 = 0.02;
/// Puddles cover a pixel from this share on for itself; below, the film shows.
const PUDDLE: f32 = 0.02;

impl Surface {
    /// Nothing drawn yet; `seed` draws hollows where no map of puddles was baked.
    ///
    /// Errors: none that its own numbers bring about.
    pub fn new(seed: u64) -> Result<Self, RuntimeError> {
        Ok(Self {
            water: Water::new(RippleSettings::default())?,
            hollows: Hollows::new(seed),
            seed,
            picture: Pyramid::default(),
            world: None,
            states: Vec::new(),
            inverse_depth: Vec::new(),
            nodes: nodes::Nodes::default(),
            looks: film::Films::default(),
            films: Vec::new(),
            smear: Smear::default(),
            tables: [FresnelTable::water(), FresnelTable::paper()],
        })
    }

    /// Draws a frame's wet surfaces as a layer over it.
    ///
    /// Errors: buffers of another size than the camera's; a time or flux that is none.
    pub fn draw(
        &mut self,
        frame: &WetFrame<'_>,
        controls: &SurfaceControls,
        out: &mut Layer,
    ) -> Result<SurfaceReport, RuntimeError> {
        let buffer = frame.buffer;
        frame.check()?;
        if !frame.time_s.is_finite() {
            return Err(RuntimeError::argument("time_s", "a finite number", frame.time_s));
        }
        out.clear(buffer.size);
        if self.seed != frame.seed {
            (self.hollows, self.seed) = (Hollows::new(frame.seed), frame.seed);
        }
        let view = View::new(frame.camera);
        let (wet, puddles) = self.soak(frame, &view, controls);
        if wet == 0 {
            return Ok(SurfaceReport::default());
        }
        if puddles > 0 {
            self.water.advance_to(frame.time_s, frame.flux, frame.seed)?;
        }
        self.picture.fill(buffer.size, frame.colour);
        inverse_of(&buffer.depth_m, &mut self.inverse_depth);
        let world = match self.world.take() {
            Some(known) if known.0 == *frame.light => known.1,
            // Asymmetry 1 leaves the world as sharp as its degrees have it.
            _ => frame.light.in_scattering(&Phase::HenyeyGreenstein(1.0)),
        };
        let task = Task {
            frame,
            controls,
            view: &view,
            water: &self.water,
            states: &self.states,
            mirror: Mirror {
                view: &view,
                picture: &self.picture,
                march: March {
                    view: &view,
                    inverse_depth: &self.inverse_depth,
                    reach_m: controls.reach,
                    thickness_m: controls.thickness,
                },
                world: &world,
            },
            fresnel: &self.tables[usize::from(controls.paper_fresnel > 0.5)],
            lookup: RippleLookup {
                scale: controls.ripple_scale,
                angle: controls.ripple_angle.to_radians(),
                origin_m: [0.0; 2],
            },
        };
        self.looks.look(&task, &mut self.films);
        if controls.paper_streaks > 0.5 {
            task.smear(&mut self.films, &mut self.smear);
        }
        let rays = task.lay(&self.films, out)
            + self.looks.rays()
            + self.films.iter().map(|film| film.standing.rays as usize).sum::<usize>();
        self.world = Some((frame.light.clone(), world));
        Ok(SurfaceReport { wet, puddles, rays })
    }

    /// How wet every pixel is; counts of wet pixels and of those with water standing.
    fn soak(&mut self, frame: &WetFrame<'_>, view: &View, controls: &SurfaceControls) -> (usize, usize) {
        let buffer = frame.buffer;
        self.states.clear();
        self.states.resize(buffer.pixels(), State::default());
        let rained = (f64::from(controls.soaked) + frame.time_s).max(0.0);
        let rates = WetnessRates { holds_mm: controls.holds, dries_mm_per_h: controls.dries };
        let wetness = |share: f32| {
            Wetness::default().after(rained, frame.rate_mm_per_h * f64::from(share), &rates).share
        };
        // By how much of the rain comes: a table, as every pixel has its own.
        let table: [f32; 65] = std::array::from_fn(|i| wetness(i as f32 / 32.0));
        let wetness = |share: f32| {
            let at = (share * 32.0).clamp(0.0, 64.0);
            let low = (at as usize).min(63);
            table[low] + (at - low as f32) * (table[low + 1] - table[low])
        };
        let full = (frame.rate_mm_per_h * rained / 3600.0 / f64::from(controls.fills)).min(1.0) as f32;
        let (falls, speed) = falls(frame);
        let fall = Fall::new(frame);
        let calm = fall.calm();
        self.hollows.know(frame.maps.water_m.as_ref());
        let (width, hollows) = (buffer.size[0], &self.hollows);
        let look = |pixel: [usize; 2], offset: Vec3, normal: Vec3| {
            // Water stands where the ground is level: the ground, not each of its stones.
            let level = nodes::mean_normal(buffer, pixel, normal);
            let place = view.eye + offset.as_dvec3();
            let before = fall.before(place, normal);
            Look {
                open: !fall.sheltered(before, speed),
                open_when_calm: !calm.sheltered(before, speed),
                basin: hollows.basin((place.truncate(), level), frame.maps, controls),
            }
        };
        self.nodes.fill(buffer, view, look);
        let nodes = &self.nodes;
        let row = |(y, states): (usize, &mut [State])| {
            for (x, state) in states.iter_mut().enumerate() {
                let at = y * width + x;
                let depth = buffer.depth_m[at];
                let wets = buffer.wettable.as_ref().map_or(1.0, |mask| mask[at]).clamp(0.0, 1.0);
                if !(depth > 0.0 && depth.is_finite() && wets > 0.0) {
                    continue;
                }
                let Some(normal) = buffer.unit_normal(at) else { continue };
                let offset = view.to_world(view.place(x, y, depth));
                let told = nodes.around([x, y], offset, normal);
                let told = told.and_then(|around| Look::between(&around));
                let told = told.unwrap_or_else(|| look([x, y], offset, normal));
                // Rain on a slope falls on more or less of it; walls get what runs down, in the lee too.
                let met = if told.open { (-normal.dot(falls)).max(0.0) } else { 0.0 };
                let runs = controls.walls * (1.0 - normal.z.abs());
                let runs = if told.open_when_calm { runs } else { 0.0 };
                state.wetness = wetness(met.max(runs) * wets);
                if state.wetness > 0.0 {
                    let water = puddles::depth_m(told.basin, full * wets);
                    state.puddle = (water * controls.influence).clamp(0.0, 1.0);
                }
            }
        };
        self.states.par_chunks_mut(width).enumerate().for_each(row);
        let wet = self.states.iter().filter(|state| state.wetness > 0.0).count();
        (wet, self.states.iter().filter(|state| state.puddle > PUDDLE).count())
    }
}

/// Rain's way down over its speed down, so that on level ground its product with the normal is −1; and that speed, m/s.
fn falls(frame: &WetFrame<'_>) -> (Vec3, f64) {
    let (sum, weight) = frame.flux.iter().fold((0.0, 0.0), |(sum, weight), flux| {
        let volume = flux.diameter_m * flux.diameter_m * flux.diameter_m * flux.impacts_per_m2_s;
        (sum + volume * flux.speed_m_per_s, weight + volume)
    });
    let speed = if weight > 0.0 { sum / weight } else { 6.0 };
    let way = DVec3::new(frame.wind.x, frame.wind.y, -speed.max(0.1));
    ((way / -way.z).as_vec3(), -way.z)
}

#[cfg(test)]
mod tests;
