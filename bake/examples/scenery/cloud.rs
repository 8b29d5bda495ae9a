//! A stand-in for the cloud renderer, good enough to judge shapes and framing: single scattering, and higher
//! orders as octaves of ever weaker extinction and ever rounder phase function. Not for anything that ships.

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use squall_bake::synth::cloud::SynthCloud;
use squall_formats::GridShape;
use squall_runtime::camera::Ray;
use squall_runtime::shade::detail::{Detail, ceilings};
use squall_runtime::shade::sky::Sky;

/// A flash inside the cloud: where, and its radiant intensity per channel, W/sr.
pub struct Flash {
    pub position: Vec3,
    pub intensity: [f32; 3],
}

pub struct Cloud {
    shape: GridShape,
    cell: Vec3,
    origin: Vec3,
    kappa: f32,
    density: Vec<f32>,
    ceiling: Vec<f32>,
    /// Per cell: optical depth towards the sun, upwards, downwards.
    depths: Vec<[f32; 3]>,
    /// Per cell: mean radiance of the flashes' scattered light.
    flash: Vec<[f32; 3]>,
    sun: Vec3,
    detail: Detail,
}

fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + t * (b - a)
}

impl Cloud {
    pub fn new(made: &SynthCloud, detail: Detail, sun: Vec3, flashes: &[Flash]) -> Self {
        let vector = |v: [f64; 3]| DVec3::from_array(v).as_vec3();
        let mut cloud = Self {
            shape: made.shape,
            cell: vector(made.cell),
            origin: vector(made.origin),
            kappa: made.kappa as f32,
            ceiling: ceilings(made.shape, &made.density),
            density: made.density.clone(),
            depths: Vec::new(),
            flash: Vec::new(),
            sun,
            detail,
        };
        let fan = |axis: f32| -> [Vec3; 4] {
            [(0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)].map(|(x, y)| Vec3::new(x, y, axis).normalize())
        };
        cloud.depths = (0..made.shape.len())
            .into_par_iter()
            .map(|index| {
                let centre = cloud.centre(index);
                let towards = |d: Vec3| cloud.depth(centre, centre + d * 8_000.0, 120.0);
                let mean = |fan: [Vec3; 4]| {
                    -libm::logf(fan.iter().map(|&d| libm::expf(-0.2 * towards(d))).sum::<f32>() / 4.0) / 0.2
                };
                [towards(cloud.sun), mean(fan(1.0)), mean(fan(-1.0))]
            })
            .collect();
        cloud.flash = (0..made.shape.len())
            .into_par_iter()
            .map(|index| {
                let centre = cloud.centre(index);
                let mut sum = [0.0f32; 3];
                for flash in flashes {
                    let away = centre - flash.position;
                    let squared = away.length_squared().max(150.0 * 150.0);
                    let depth = cloud.depth(centre, flash.position, 150.0);
                    // Diffusion: what is scattered piles up as 3σ'/(4πr) on its way out.
                    let reduced = 0.15 * depth;
                    let share = libm::expf(-0.35 * reduced) * (1.0 + 3.0 * reduced) + libm::expf(-depth);
                    for band in 0..3 {
                        sum[band] += flash.intensity[band] * share / (12.57 * squared);
                    }
                }
                sum
            })
            .collect();
        cloud
    }

    fn centre(&self, index: usize) -> Vec3 {
        let [x, y, z] = self.shape.cell(index);
        self.origin + (Vec3::new(x as f32, y as f32, z as f32) + 0.5) * self.cell
    }

    fn weights(&self, point: Vec3) -> Option<(usize, Vec3)> {
        let at = (point - self.origin) / self.cell - 0.5;
        let top = Vec3::from_array(self.shape.to_array().map(|n| n as f32 - 1.001));
        if at.cmplt(Vec3::ZERO).any() || at.cmpgt(top).any() {
            return None;
        }
        let low = at.floor();
        Some((self.shape.index(low.x as usize, low.y as usize, low.z as usize), at - low))
    }

    fn mix(&self, (index, f): (usize, Vec3), value: impl Fn(usize) -> f32) -> f32 {
        let (row, slab) = (self.shape.row_stride(), self.shape.slab_stride());
        let along = |i: usize| lerp(value(i), value(i + 1), f.x);
        let plane = |i: usize| lerp(along(i), along(i + row), f.y);
        lerp(plane(index), plane(index + slab), f.z)
    }

    fn coarse(&self, point: Vec3) -> f32 {
        self.weights(point).map_or(0.0, |at| self.mix(at, |i| self.density[i]))
    }

    fn fine(&self, point: Vec3) -> f32 {
        let Some(at) = self.weights(point) else { return 0.0 };
        let coarse = self.mix(at, |i| self.density[i]);
        if coarse <= 0.0 {
            return 0.0;
        }
        self.detail.modulate(point, coarse, self.mix(at, |i| self.ceiling[i]))
    }

    fn depth(&self, from: Vec3, to: Vec3, step: f32) -> f32 {
        let steps = ((to - from).length() / step).ceil().max(1.0) as usize;
        let length = (to - from).length() / steps as f32;
        let walk = (to - from) / steps as f32;
        (0..steps).map(|i| self.coarse(from + walk * (i as f32 + 0.5))).sum::<f32>() * length * self.kappa
    }

    /// Radiance towards the eye and the share of the background that comes through.
    pub fn look(&self, ray: Ray, sky: &Sky) -> ([f32; 3], f32, f32) {
        let (from, way) = (ray.origin.as_vec3(), ray.direction.as_vec3());
        let size = self.cell * Vec3::from_array(self.shape.to_array().map(|n| n as f32));
        let (a, b) = ((self.origin - from) / way, (self.origin + size - from) / way);
        let near = a.min(b).max_element().max(0.0);
        let far = a.max(b).min_element();
        let (mut light, mut through, mut mean, mut weight) = ([0.0f32; 3], 1.0f32, 0.0, 0.0);
        let step = 45.0;
        let mut t = near + step * 0.5;
        let cosine = way.dot(self.sun);
        let lobe = |g: f32| (1.0 - g * g) / (12.566 * libm::powf(1.0 + g * g - 2.0 * g * cosine, 1.5));
        while t < far && through > 0.004 {
            let point = from + way * t;
            let Some(at) = self.weights(point) else {
                t += step;
                continue;
            };
            if self.ceiling[at.0] == 0.0 {
                t += 2.0 * step;
                continue;
            }
            let density = self.fine(point);
            if density > 0.0 {
                let opacity = 1.0 - libm::expf(-density * self.kappa * step);
                let close = (self.fine(point + self.sun * 60.0) + self.fine(point + self.sun * 160.0) * 1.6)
                    * 60.0
                    * self.kappa;
                let smooth = self.mix(at, |i| self.depths[i][0]);
                let sun_depth = smooth.max(close) + 0.5 * close;
                let phase: f32 = (0..5)
                    .map(|n| {
                        let fade = libm::powf(0.5, n as f32);
                        fade * lobe(0.85 * fade) * libm::expf(-sun_depth * libm::powf(0.35, n as f32))
                    })
                    .sum();
                let up = libm::expf(-0.12 * self.mix(at, |i| self.depths[i][1]));
                let down = libm::expf(-0.12 * self.mix(at, |i| self.depths[i][2]));
                let lit = sky.cloud_light(f64::from(point.z), point.as_dvec3());
                for band in 0..3 {
                    let flash = self.mix(at, |i| self.flash[i][band]);
                    let ambient = 0.5 * (lit.upper[band] * up + lit.lower[band] * down);
                    let source = 3.0 * phase * lit.sun_irradiance[band] + ambient + flash;
                    light[band] += through * opacity * source;
                }
                mean += through * opacity * t;
                weight += through * opacity;
                through *= 1.0 - opacity;
            }
            t += step;
        }
        (light, through, if weight > 0.0 { mean / weight } else { 0.0 })
    }
}
