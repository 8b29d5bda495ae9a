//! A frame's pixels: what each surface is made of, what its film and its puddle mirror, how both lie over it.

use super::water::Water;
use super::{
    Film, Ground, POROUS, PUDDLE, SHARED_M, Smear, State, SurfaceControls, SurfaceLight, SurfacePixel,
    wet_surface,
};
use crate::parallel::prelude::*;
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::material::{FILM_ROUGHNESS, Material, Wetness, paper_edge_attenuation};
use crate::wet::puddle::{RippleLookup, normal_of, wet_normal};
use crate::wet::reflect::view::View;
use crate::wet::reflect::{FresnelTable, Mirror, Mirrored, paper};
use glam::Vec3;

/// A frame on its way.
pub(super) struct Task<'a> {
    pub(super) frame: &'a WetFrame<'a>,
    pub(super) controls: &'a SurfaceControls,
    pub(super) view: &'a View,
    pub(super) water: &'a Water,
    pub(super) states: &'a [State],
    pub(super) mirror: Mirror<'a>,
    pub(super) fresnel: &'a FresnelTable,
    pub(super) lookup: RippleLookup,
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

    /// What lies under a look of two by two pixels: of those that are wet the one with least water shows the film, the one with most the water.
    pub(super) fn ground(&self, [column, row]: [usize; 2]) -> Ground {
        let [width, height] = self.frame.buffer.size;
        let (mut least, mut most) = (None, None);
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| (2 * column + x, 2 * row + y)) {
            if x >= width || y >= height || self.states[y * width + x].wetness <= 0.0 {
                continue;
            }
            let puddle = self.states[y * width + x].puddle;
            if puddle < low {
                (low, least) = (puddle, Some([x, y]));
            }
            if puddle >= high {
                (high, most) = (puddle, Some([x, y]));
            }
        }
        let (Some(pixel), Some(most)) = (least, most) else { return Ground::default() };
        let at = pixel[1] * width + pixel[0];
        let normal = self.frame.buffer.unit_normal(at).unwrap_or(Vec3::Z);
        // Under deep water there is no film; the paper's is a mirror.
        let slope = if low >= 1.0 {
            -1.0
        } else if self.controls.paper_streaks > 0.5 {
            0.0
        } else {
            self.film_slope(self.material(at).roughness)
        };
        Ground { pixel, most, slope, normal, depth: self.frame.buffer.depth_m[at] }
    }

    /// What the film of a look mirrors.
    pub(super) fn film(&self, ground: &Ground) -> Mirrored {
        let place = self.view.place(ground.pixel[0], ground.pixel[1], ground.depth);
        let normal = self.view.from_world(ground.normal);
        self.mirror.fan((place, normal, self.view.to_eye(place)), ground.slope, self.fresnel)
    }

    /// Share of a look's pixel that its film covers.
    pub(super) fn film_share(&self, ground: &Ground) -> f32 {
        let at = ground.pixel[1] * self.frame.buffer.size[0] + ground.pixel[0];
        self.controls.film * self.states[at].wetness * ground.normal.z.abs().max(self.controls.walls)
    }

    /// The brightest band of what a look's pixel shows when dry.
    pub(super) fn brightest(&self, ground: &Ground) -> f32 {
        let [red, green, blue] =
            self.frame.colour[ground.pixel[1] * self.frame.buffer.size[0] + ground.pixel[0]];
        red.max(green).max(blue).max(0.0)
    }

    /// How far facets that lean aside blur what a look's film shows, px.
    pub(super) fn blur_px(&self, ground: &Ground) -> f32 {
        let place = self.view.place(ground.pixel[0], ground.pixel[1], ground.depth);
        let facing = self.view.from_world(ground.normal).dot(self.view.to_eye(place)).max(0.0);
        2.0 * ground.slope * facing * self.view.focal().x
    }

    /// What standing water mirrors under a look, where it is so far away that neighbours need no look of their own.
    pub(super) fn standing(&self, ground: &Ground) -> Mirrored {
        let buffer = self.frame.buffer;
        let [x, y] = ground.most;
        let at = y * buffer.size[0] + x;
        let puddle = self.states[at].puddle;
        if ground.depth == 0.0 || puddle <= PUDDLE {
            return Mirrored::default();
        }
        let place = self.view.place(x, y, buffer.depth_m[at]);
        let (normal, to_eye) = (buffer.unit_normal(at).unwrap_or(Vec3::Z), self.view.to_eye(place));
        if self.footprint(place, normal, to_eye) <= SHARED_M {
            return Mirrored::default();
        }
        self.puddle((place, normal, to_eye), (puddle, self.material(at).roughness))
    }

    /// How much of the ground a pixel covers, m: more along the view than across.
    fn footprint(&self, place: Vec3, normal: Vec3, to_eye: Vec3) -> f32 {
        let facing = normal.dot(self.view.to_world(to_eye)).max(0.05);
        self.view.pixel_m(place.z) / facing.sqrt()
    }

    /// Smears the films as the paper does: by the distance of what each shows.
    pub(super) fn smear(&self, films: &mut [Film], memory: &mut Smear) {
        let [width, height] = self.frame.buffer.size;
        let half = [width.div_ceil(2), height.div_ceil(2)];
        let scale = 0.5 * self.controls.paper_stretch * height as f32 / 1080.0;
        memory.light.clear();
        memory.wet.clear();
        memory.reach.clear();
        for (at, film) in films.iter().enumerate() {
            memory.light.push(film.light);
            memory.wet.push(film.shown);
            let (x, y) = ((2 * (at % half[0])).min(width - 1), (2 * (at / half[0])).min(height - 1));
            let reach = if film.shown { scale * self.shown_m((x, y), film) } else { 0.0 };
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
    pub(super) fn lay(&self, films: &[Film], out: &mut Layer) -> usize {
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
        let emission = std::array::from_fn(|band| own[band].min(self.frame.colour[at][band]).max(0.0));
        let pixel = SurfacePixel {
            colour: self.frame.colour[at],
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
        let inverse = 1.0 / depth;
        for (row, wy) in taps(y, half[1]) {
            for (column, wx) in taps(x, half[0]) {
                let film = &films[row * half[0] + column];
                if !film.shown {
                    continue;
                }
                let apart = (film.depth * inverse - 1.0).abs();
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
