//! Wet surfaces: what rain darkens, what it covers with a film, what stands in puddles, and what all of it mirrors.
//!
//! A pixel's light is taken apart: what its surface sends of its own stays; what it throws back diffusely falls with its albedo as water fills its pores,
//! and by what the film above reflects before it comes in or goes out; on top comes what the film mirrors ([`super::reflect`]). Where buffers don't tell
//! parts from one another, all of the light counts as diffuse. A pixel that is dry keeps its bits.
//!
//! The film of rough ground is looked at for every other pixel along both axes, puddles for every one.

pub mod lightning;
pub mod puddles;
pub mod water;

use super::reflect::march::{March, inverse_of};
use super::reflect::pyramid::Pyramid;
use super::reflect::view::View;
use super::reflect::{FresnelTable, Mirror, Mirrored, paper};
use crate::error::RuntimeError;
use crate::medium::Phase;
use crate::parallel::prelude::*;
use crate::wet::controls::controls;
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::material::{FILM_ROUGHNESS, Material, Wetness, WetnessRates, paper_edge_attenuation};
use crate::wet::puddle::{RippleLookup, normal_of, wet_normal};
use crate::wet::ripples::RippleSettings;
use crate::world::{InScattering, WorldLight};
use glam::{DVec3, Vec3};
use puddles::Hollows;
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
/// A film at an angle at which it reflects F lets (1 − F)/(1 − F̄) of the mean out, F̄ the mean over all angles, which wet albedo has in it.
pub fn wet_surface(pixel: &SurfacePixel, light: &SurfaceLight) -> WetPixel {
    let wet = pixel.material.wet(pixel.wetness);
    let film = pixel.film.clamp(0.0, 1.0);
    let out = 1.0 - film + film * (1.0 - light.fresnel) / (1.0 - MEAN_REFLECTION);
    let kept = std::array::from_fn(|band| {
        let dry = pixel.material.albedo[band].max(DARKEST);
        let wet = if wet.albedo[band] > DARKEST { wet.albedo[band] / dry } else { 1.0 };
        (wet * out).min(1.0)
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

/// What the film of every other pixel mirrors.
#[derive(Clone, Copy, Default)]
struct Film {
    /// What standing water in the same pixel mirrors, where it is so far away that neighbours need no look of their own.
    standing: Mirrored,
    light: [f32; 3],
    fresnel: f32,
    normal: Vec3,
    depth: f32,
    rays: u32,
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
        buffer.check(frame.camera)?;
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
        self.picture.fill(buffer.size, &buffer.colour);
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
        task.films(&mut self.films);
        if controls.paper_streaks > 0.5 {
            task.smear(&mut self.films, &mut self.smear);
        }
        let rays = task.lay(&self.films, out)
            + self.films.iter().map(|film| (film.rays + film.standing.rays) as usize).sum::<usize>();
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
        let falls = falls(frame);
        let (width, hollows) = (buffer.size[0], &self.hollows);
        let row = |(y, states): (usize, &mut [State])| {
            for (x, state) in states.iter_mut().enumerate() {
                let at = y * width + x;
                let depth = buffer.depth_m[at];
                let open = buffer.wettable.as_ref().map_or(1.0, |mask| mask[at]).clamp(0.0, 1.0);
                if !(depth > 0.0 && depth.is_finite() && open > 0.0) {
                    continue;
                }
                let Some(normal) = buffer.unit_normal(at) else { continue };
                // Rain on a slope falls on more or less of it; walls get what runs down.
                let share = (-normal.dot(falls)).max(controls.walls * (1.0 - normal.z.abs()));
                let place = view.eye + view.to_world(view.place(x, y, depth)).as_dvec3();
                let dry = overhead(frame, place);
                state.wetness = wetness(share * open * dry);
                if state.wetness > 0.0 {
                    let water = hollows.depth_m(
                        (place.truncate(), normal),
                        (frame.maps, full * open * dry),
                        controls,
                    );
                    state.puddle = (water * controls.influence).clamp(0.0, 1.0);
                }
            }
        };
        self.states.par_chunks_mut(width).enumerate().for_each(row);
        let wet = self.states.iter().filter(|state| state.wetness > 0.0).count();
        (wet, self.states.iter().filter(|state| state.puddle > PUDDLE).count())
    }
}

/// Rain's way down over its speed down: on level ground its product with the normal is −1.
fn falls(frame: &WetFrame<'_>) -> Vec3 {
    let (sum, weight) = frame.flux.iter().fold((0.0, 0.0), |(sum, weight), flux| {
        let volume = flux.diameter_m * flux.diameter_m * flux.diameter_m * flux.impacts_per_m2_s;
        (sum + volume * flux.speed_m_per_s, weight + volume)
    });
    let speed = if weight > 0.0 { sum / weight } else { 6.0 };
    let way = DVec3::new(frame.wind.x, frame.wind.y, -speed.max(0.1));
    (way / -way.z).as_vec3()
}

/// Share of the rain that reaches a place: none under what the height map has above it.
fn overhead(frame: &WetFrame<'_>, place: DVec3) -> f32 {
    /// Height maps are means over cells: what is less above a place is the place itself, m.
    const ROOF_M: f64 = 1.0;
    let map = frame.maps.height_m.as_ref().and_then(|map| map.at(place.truncate()));
    map.map_or(1.0, |height| if f64::from(height) > place.z + ROOF_M { 0.0 } else { 1.0 })
}

/// A frame on its way.
struct Task<'a> {
    frame: &'a WetFrame<'a>,
    controls: &'a SurfaceControls,
    view: &'a View,
    water: &'a Water,
    states: &'a [State],
    mirror: Mirror<'a>,
    fresnel: &'a FresnelTable,
    lookup: RippleLookup,
}

impl Task<'_> {
    fn material(&self, at: usize) -> Material {
        let buffer = self.frame.buffer;
        let roughness = buffer.roughness.as_ref().map_or(self.controls.roughness, |values| values[at]);
        let pores = ((roughness - POROUS[0]) / (POROUS[1] - POROUS[0])).clamp(0.0, 1.0);
        Material {
            albedo: buffer.albedo.as_ref().map_or([self.controls.albedo; 3], |values| values[at]),
            roughness,
            porosity: self.controls.porosity * pores,
        }
    }

    /// Slopes of the film on a surface of this roughness.
    fn film_slope(&self, roughness: f32) -> f32 {
        // A smooth surface's film is no rougher than a closed film is; α of a perceptual roughness is its square.
        let smooth = FILM_ROUGHNESS * FILM_ROUGHNESS;
        smooth.max(self.controls.film_slope * (roughness / POROUS[1]).min(1.0))
    }

    /// Films of every other pixel.
    fn films(&self, films: &mut Vec<Film>) {
        let [width, height] = self.frame.buffer.size;
        let half = [width.div_ceil(2), height.div_ceil(2)];
        films.clear();
        films.resize(half[0] * half[1], Film::default());
        let row = |(row, films): (usize, &mut [Film])| {
            for (column, film) in films.iter_mut().enumerate() {
                // Of its four pixels the one with least water shows the film, the one with most the water.
                let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| (2 * column + x, 2 * row + y));
                let wet = || four.into_iter().filter(|&(x, y)| x < width && y < height);
                let wet = || wet().filter(|&(x, y)| self.states[y * width + x].wetness > 0.0);
                let puddle = |(x, y): &(usize, usize)| self.states[y * width + x].puddle;
                let ends = (
                    wet().min_by(|a, b| puddle(a).total_cmp(&puddle(b))),
                    wet().max_by(|a, b| puddle(a).total_cmp(&puddle(b))),
                );
                if let (Some(least), Some(most)) = ends {
                    *film = self.film(least, most);
                }
            }
        };
        films.par_chunks_mut(half[0]).enumerate().for_each(row);
    }

    /// What the film mirrors in one pixel, and standing water in another, where that is far away.
    fn film(&self, (x, y): (usize, usize), most: (usize, usize)) -> Film {
        let buffer = self.frame.buffer;
        let width = buffer.size[0];
        let geometry = |(x, y): (usize, usize)| {
            let at = y * width + x;
            let place = self.view.place(x, y, buffer.depth_m[at]);
            (at, place, buffer.unit_normal(at).unwrap_or(Vec3::Z), self.view.to_eye(place))
        };
        let (at, place, normal, to_eye) = geometry(most);
        let puddle = self.states[at].puddle;
        let shares = puddle > PUDDLE && self.footprint(place, normal, to_eye) > SHARED_M;
        let standing = match shares {
            true => self.puddle((place, normal, to_eye), (puddle, self.material(at).roughness)),
            false => Mirrored::default(),
        };
        let (at, place, normal, to_eye) = geometry((x, y));
        let film = if self.states[at].puddle < 1.0 {
            let is_paper = self.controls.paper_streaks > 0.5;
            let slope = if is_paper { 0.0 } else { self.film_slope(self.material(at).roughness) };
            self.mirror.fan((place, self.view.from_world(normal), to_eye), slope, self.fresnel)
        } else {
            // Under deep water there is no film.
            Mirrored::default()
        };
        let Mirrored { light, fresnel, rays } = film;
        Film { standing, light, fresnel, normal, depth: buffer.depth_m[at], rays }
    }

    /// How much of the ground a pixel covers, m: more along the view than across.
    fn footprint(&self, place: Vec3, normal: Vec3, to_eye: Vec3) -> f32 {
        let facing = normal.dot(self.view.to_world(to_eye)).max(0.05);
        self.view.pixel_m(place.z) / facing.sqrt()
    }

    /// Smears the films as the paper does: by the distance of what each shows.
    fn smear(&self, films: &mut [Film], memory: &mut Smear) {
        let [width, height] = self.frame.buffer.size;
        let half = [width.div_ceil(2), height.div_ceil(2)];
        let scale = 0.5 * self.controls.paper_stretch * height as f32 / 1080.0;
        memory.light.clear();
        memory.wet.clear();
        memory.reach.clear();
        for (at, film) in films.iter().enumerate() {
            memory.light.push(film.light);
            memory.wet.push(film.rays > 0);
            let (x, y) = ((2 * (at % half[0])).min(width - 1), (2 * (at / half[0])).min(height - 1));
            let reach = if film.rays > 0 { scale * self.shown_m((x, y), film) } else { 0.0 };
            memory.reach.push(reach.min(0.25 * height as f32));
        }
        paper::smear(half, (&memory.light, &memory.wet, &memory.reach), &mut memory.out);
        films.iter_mut().zip(&memory.out).for_each(|(film, light)| film.light = *light);
    }

    /// Distance of what a film shows from the eye, m; the reach where nothing stands there.
    fn shown_m(&self, (x, y): (usize, usize), film: &Film) -> f32 {
        let place = self.view.place(x, y, film.depth);
        let to_eye = self.view.to_eye(place);
        let normal = self.view.from_world(film.normal);
        let ray = normal * (2.0 * normal.dot(to_eye)) - to_eye;
        let end = self.mirror.march.end(place, ray).pixel();
        let depth = end.map_or(f32::INFINITY, |at| {
            let [width, height] = self.view.size;
            let (x, y) = ((at.x.max(0.0) as usize).min(width - 1), (at.y.max(0.0) as usize).min(height - 1));
            self.frame.buffer.depth_m[y * width + x]
        });
        if depth.is_finite() { depth } else { self.controls.reach }
    }

    /// Lays every wet pixel into the layer; rays followed.
    fn lay(&self, films: &[Film], out: &mut Layer) -> usize {
        let width = self.frame.buffer.size[0];
        let rows = out.light.par_chunks_mut(width).zip(out.alpha.par_chunks_mut(width)).enumerate();
        let row = |(y, (light, alpha)): (usize, (&mut [[f32; 3]], &mut [f32]))| {
            let mut rays = 0;
            for (x, (light, alpha)) in light.iter_mut().zip(alpha).enumerate() {
                if self.states[y * width + x].wetness > 0.0 {
                    rays += self.pixel((x, y), films, (light, alpha));
                }
            }
            rays
        };
        rows.map(row).sum()
    }

    fn pixel(
        &self,
        (x, y): (usize, usize),
        films: &[Film],
        (light, alpha): (&mut [f32; 3], &mut f32),
    ) -> usize {
        let buffer = self.frame.buffer;
        let at = y * buffer.size[0] + x;
        let state = self.states[at];
        let Some(normal) = buffer.unit_normal(at) else { return 0 };
        let place = self.view.place(x, y, buffer.depth_m[at]);
        let to_eye = self.view.to_eye(place);
        let material = self.material(at);
        // Water runs off what is steep: a wall's film is as little as its share of the rain.
        let film = self.controls.film * state.wetness * normal.z.abs().max(self.controls.walls);
        let mut rays = 0;
        // Film beside puddle: shares of one pixel.
        let mut mirrored = self.film_around((x, y), films, normal);
        if state.puddle > PUDDLE {
            let half = self.frame.buffer.size[0].div_ceil(2);
            let shared = films[(y / 2) * half + x / 2].standing;
            let standing = if shared.rays > 0 && self.footprint(place, normal, to_eye) > SHARED_M {
                shared
            } else {
                let own = self.puddle((place, normal, to_eye), (state.puddle, material.roughness));
                rays = own.rays as usize;
                own
            };
            let share = state.puddle;
            let film_share = film * (1.0 - share) / (film * (1.0 - share) + share).max(1e-6);
            mirrored.fresnel = standing.fresnel + film_share * (mirrored.fresnel - standing.fresnel);
            for band in 0..3 {
                mirrored.light[band] =
                    standing.light[band] + film_share * (mirrored.light[band] - standing.light[band]);
            }
        }
        let covered = film + (1.0 - film) * state.puddle;
        let cosine = self.view.from_world(normal).dot(to_eye).max(0.0);
        let exponent = f64::from(self.controls.edge_exponent);
        let edges =
            if exponent > 0.0 { paper_edge_attenuation(f64::from(cosine), exponent) as f32 } else { 1.0 };
        let scale = self.controls.mirror * edges;
        // Air between may have taken a little of it: no more than there is.
        let own = buffer.emission.as_ref().map_or([0.0; 3], |values| values[at]);
        let emission = std::array::from_fn(|band| own[band].min(buffer.colour[at][band]).max(0.0));
        let pixel = SurfacePixel {
            colour: buffer.colour[at],
            emission,
            material,
            wetness: Wetness { share: state.wetness.max(state.puddle) },
            film: covered,
            cosine,
        };
        let shown =
            SurfaceLight { mirrored: mirrored.light.map(|value| value * scale), fresnel: mirrored.fresnel };
        let wet = wet_surface(&pixel, &shown);
        // The layer hides what is lost of all colours, and adds what the others keep.
        let least = wet.kept[0].min(wet.kept[1]).min(wet.kept[2]);
        *alpha = 1.0 - least;
        *light = std::array::from_fn(|band| {
            let (own, all) = (pixel.emission[band], pixel.colour[band]);
            (all - own) * (wet.kept[band] - least) + own * (1.0 - least) + wet.mirrored[band]
        });
        rays
    }

    /// What standing water mirrors: the ground's normal gives way to the water's.
    fn puddle(
        &self,
        (place, normal, to_eye): (Vec3, Vec3, Vec3),
        (share, roughness): (f32, f32),
    ) -> Mirrored {
        let world = self.view.eye + self.view.to_world(place).as_dvec3();
        let footprint = self.footprint(place, normal, to_eye);
        let ripples = self.water.slope(world.truncate(), footprint, &self.lookup);
        let factor = self.controls.ripples;
        let water = normal_of(ripples.mean.map(|slope| slope * factor));
        let shown = self.view.from_world(wet_normal(normal, water, share, 1.0));
        let still = self.controls.puddle_slope;
        let calm = (still * still + factor * factor * ripples.variance).sqrt();
        let slope = calm + (1.0 - share) * (self.film_slope(roughness) - calm).max(0.0);
        self.mirror.fan((place, shown, to_eye), slope, self.fresnel)
    }

    /// The films around a pixel that lie on the same surface, between their middles.
    fn film_around(&self, (x, y): (usize, usize), films: &[Film], normal: Vec3) -> Mirrored {
        let [width, height] = self.frame.buffer.size;
        let half = [width.div_ceil(2), height.div_ceil(2)];
        let depth = self.frame.buffer.depth_m[y * width + x];
        let taps = |at: usize, count: usize| {
            let near = at / 2;
            let far = if at.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(count - 1) };
            [(near, 0.75f32), (far, 0.25)]
        };
        let (mut light, mut fresnel, mut weight) = (Vec3::ZERO, 0.0, 0.0);
        for (row, wy) in taps(y, half[1]) {
            for (column, wx) in taps(x, half[0]) {
                let film = &films[row * half[0] + column];
                if film.rays == 0 {
                    continue;
                }
                let apart = (film.depth / depth - 1.0).abs();
                let same = film.normal.dot(normal).max(0.0);
                let kept = wx * wy * same * same * (1.0 - 10.0 * apart).max(0.0) + 1e-6;
                light += Vec3::from_array(film.light) * kept;
                fresnel += film.fresnel * kept;
                weight += kept;
            }
        }
        if weight == 0.0 {
            return Mirrored::default();
        }
        Mirrored { light: (light / weight).to_array(), fresnel: fresnel / weight, rays: 0 }
    }
}

#[cfg(test)]
mod tests;
