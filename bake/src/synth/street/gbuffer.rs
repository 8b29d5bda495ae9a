//! The street's own buffers: what a renderer hands over, path-traced with few samples.

mod filter;
mod lights;

use super::detail::{Look, look};
use crate::error::BakeError;
use crate::picture::{ChannelValues, encode_seen_layers};
use crate::progress::Progress;
use glam::{DVec2, DVec3, Vec3};
use lights::Lights;
use rayon::prelude::*;
use squall_runtime::Camera;
use squall_runtime::random::Random;
use squall_runtime::wet::frame::GBuffer;
use squall_scene::light::{around, from_lamp};
use squall_scene::overhead::LAMP_RADIUS_M;
use squall_scene::{Hit, Ray, World};
use std::f32::consts::PI;

/// How buffers are worked out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GBufferSettings {
    /// Paths of a pixel.
    pub samples: u32,
    /// Reflections of diffuse light.
    pub bounces: u32,
    /// Radiance of the night sky, W/(m² sr): clouds over a lit town.
    pub sky: [f32; 3],
    /// Seed.
    pub seed: u64,
}

impl Default for GBufferSettings {
    fn default() -> Self {
        Self { samples: 16, bounces: 2, sky: [1.1e-3, 1.05e-3, 1.2e-3], seed: 1 }
    }
}

/// Reflection of water and glass straight on, and of most that is no metal.
const PLAIN_REFLECTION: f32 = 0.04;
/// Surfaces rougher than this reflect nothing that is told from diffuse light.
const ROUGHEST_MIRROR: f32 = 0.55;
/// Brightest light that a path brings by way of another surface, W/(m² sr): rare bright paths would leave specks.
const BRIGHTEST: f32 = 1.0;

/// One sample of a pixel.
#[derive(Clone, Copy, Default)]
struct Sample {
    /// Light that goes straight to the camera: emission, mirrored light, sky.
    straight: [f32; 3],
    /// Irradiance by lamps, without noise.
    lamps: [f32; 3],
    /// Irradiance by everything else.
    rest: [f32; 3],
    albedo: [f32; 3],
    emission: [f32; 3],
    /// What irradiance is multiplied by: the albedo, or behind glass that of what is there.
    tint: [f32; 3],
    /// Whether what `tint` stands for lies behind glass, where no water darkens it.
    glazed: f32,
}

/// What a pixel shows in its middle.
struct Middle {
    depth: f32,
    normal: Vec3,
    roughness: f32,
}

struct Tracer<'a> {
    world: &'a World,
    lights: Lights,
    settings: GBufferSettings,
}

/// Buffers of a street (of any scene that is lit by its own lamps) from a camera.
///
/// Errors: an interruption.
pub fn render_gbuffer(
    world: &World,
    camera: &Camera,
    settings: GBufferSettings,
    progress: &dyn Progress,
) -> Result<GBuffer, BakeError> {
    let tracer = Tracer { world, lights: Lights::new(world), settings };
    let (width, height) = (camera.width as usize, camera.height as usize);
    progress.begin("picture", height as u64);
    let rows: Result<Vec<Vec<(Sample, Middle)>>, BakeError> = (0..height)
        .into_par_iter()
        .map(|y| {
            progress.check()?;
            let row = (0..width).map(|x| tracer.pixel(camera, x, y)).collect();
            progress.advance(1);
            Ok(row)
        })
        .collect();
    let pixels: Vec<(Sample, Middle)> = rows?.into_iter().flatten().collect();
    let mut buffer = GBuffer {
        size: [width, height],
        depth_m: pixels.iter().map(|(_, middle)| middle.depth).collect(),
        normal: pixels.iter().map(|(_, middle)| middle.normal.to_array()).collect(),
        albedo: Some(pixels.iter().map(|(sample, _)| sample.albedo).collect()),
        roughness: Some(pixels.iter().map(|(_, middle)| middle.roughness).collect()),
        ..GBuffer::default()
    };
    let noisy: Vec<[f32; 3]> = pixels.iter().map(|(sample, _)| sample.rest).collect();
    let calm = filter::smoothed(&buffer, camera, noisy);
    let mut emission = Vec::with_capacity(pixels.len());
    for ((sample, _), rest) in pixels.iter().zip(calm) {
        let diffuse = |band: usize| sample.tint[band] / PI * (sample.lamps[band] + rest[band]);
        buffer.colour.push(std::array::from_fn(|band| sample.straight[band] + diffuse(band)));
        emission.push(std::array::from_fn(|band| sample.emission[band] + sample.glazed * diffuse(band)));
    }
    buffer.emission = Some(emission);
    Ok(buffer)
}

/// Bytes of an OpenEXR file of buffers: R, G, B; Z; N.X, N.Y, N.Z; albedo and emission with .R, .G, .B; roughness.Y; row 0 on top, numbers of 32 bits, and
/// the camera as the standard's matrices.
///
/// Errors: a picture without pixels.
pub fn encode_gbuffer(buffer: &GBuffer, camera: &Camera) -> std::io::Result<Vec<u8>> {
    let mut channels = vec![("Z".to_owned(), ChannelValues::Floats(buffer.depth_m.clone()))];
    let sets: [([&str; 3], Option<&Vec<[f32; 3]>>); 4] = [
        (["R", "G", "B"], Some(&buffer.colour)),
        (["N.X", "N.Y", "N.Z"], Some(&buffer.normal)),
        (["albedo.R", "albedo.G", "albedo.B"], buffer.albedo.as_ref()),
        (["emission.R", "emission.G", "emission.B"], buffer.emission.as_ref()),
    ];
    for (names, values) in sets {
        let Some(values) = values else { continue };
        for (band, name) in names.into_iter().enumerate() {
            let band = values.iter().map(|value| value[band]).collect();
            channels.push((name.to_owned(), ChannelValues::Floats(band)));
        }
    }
    if let Some(roughness) = &buffer.roughness {
        channels.push(("roughness.Y".to_owned(), ChannelValues::Floats(roughness.clone())));
    }
    encode_seen_layers((buffer.size[0], buffer.size[1]), channels, (None, Some(camera)))
}

impl Tracer<'_> {
    fn pixel(&self, camera: &Camera, x: usize, y: usize) -> (Sample, Middle) {
        let pixel = y as u64 * u64::from(camera.width) + x as u64;
        let mut random = Random::from_parts(&[self.settings.seed, pixel]);
        let mut mean = Sample::default();
        let side = (f64::from(self.settings.samples)).sqrt().floor().max(1.0);
        for number in 0..self.settings.samples {
            // Samples lie in a square's cells; what does not fill the square lies anywhere.
            let cell = f64::from(number);
            let within =
                DVec2::new(cell - side * (cell / side).floor(), ((cell / side).floor()).min(side - 1.0));
            let at = (within + DVec2::new(random.unit(), random.unit())) / side;
            let sample = self.sample(camera, DVec2::new(x as f64, y as f64) + at, &mut random);
            let share = 1.0 / self.settings.samples as f32;
            let sets = [
                (&mut mean.straight, sample.straight),
                (&mut mean.lamps, sample.lamps),
                (&mut mean.rest, sample.rest),
                (&mut mean.albedo, sample.albedo),
                (&mut mean.emission, sample.emission),
                (&mut mean.tint, sample.tint),
            ];
            for (sum, value) in sets {
                add(sum, value, share);
            }
            mean.glazed += share * sample.glazed;
        }
        (mean, self.middle(camera, DVec2::new(x as f64 + 0.5, y as f64 + 0.5)))
    }

    fn middle(&self, camera: &Camera, at: DVec2) -> Middle {
        let eye = camera.ray(at.x, at.y);
        let ray = Ray { origin: eye.origin.as_vec3(), direction: eye.direction.as_vec3() };
        match self.world.first(&ray, f32::INFINITY, false) {
            None => Middle { depth: f32::INFINITY, normal: Vec3::ZERO, roughness: 1.0 },
            Some(hit) => {
                let look = self.look(&ray, &hit, footprint(camera, hit.distance));
                let depth = hit.distance * camera.forward.dot(eye.direction) as f32;
                Middle { depth, normal: look.normal, roughness: look.roughness }
            }
        }
    }

    /// The surface where a ray meets it, with its smooth normal and its material's pattern, facing the ray.
    fn look(&self, ray: &Ray, hit: &Hit, footprint: f64) -> Look {
        let scene = self.world.scene();
        let flat = self.world.normal(hit.triangle);
        let turn = if flat.dot(ray.direction) > 0.0 { -1.0 } else { 1.0 };
        let [u, v] = hit.weights;
        let smooth = scene
            .normals
            .get(hit.triangle as usize)
            .map_or(Vec3::ZERO, |[a, b, c]| *a * (1.0 - u - v) + *b * u + *c * v);
        let normal = turn * smooth.try_normalize().unwrap_or(flat);
        // A smooth normal may look away from a ray that meets its triangle.
        let normal = if normal.dot(ray.direction) > -0.02 { turn * flat } else { normal };
        let material = &scene.materials[scene.material[hit.triangle as usize] as usize];
        let own = Look { base: scene.base(hit.triangle as usize), roughness: material.roughness, normal };
        let place = (ray.origin + ray.direction * hit.distance).as_dvec3();
        let mut look = look(&material.name, place, own, footprint);
        look.roughness = look.roughness.clamp(0.02, 1.0);
        look
    }

    fn sample(&self, camera: &Camera, at: DVec2, random: &mut Random) -> Sample {
        let eye = camera.ray(at.x, at.y);
        let mut ray = Ray { origin: eye.origin.as_vec3(), direction: eye.direction.as_vec3() };
        let mut sample = Sample::default();
        let mut share = 1.0f32;
        // Behind glass its light is its own, which no water on it darkens.
        let mut glazed = false;
        for _ in 0..3 {
            let Some(hit) = self.world.first(&ray, f32::INFINITY, false) else {
                add(&mut sample.straight, self.settings.sky, share);
                return sample;
            };
            let scene = self.world.scene();
            let material = &scene.materials[scene.material[hit.triangle as usize] as usize];
            let look = self.look(&ray, &hit, footprint(camera, hit.distance));
            let place = World::off(ray.origin + ray.direction * hit.distance, look.normal);
            if material.clear {
                let mirrored = fresnel(PLAIN_REFLECTION, -look.normal.dot(ray.direction));
                let out = ray.direction - 2.0 * ray.direction.dot(look.normal) * look.normal;
                let light = self.along(Ray { origin: place, direction: out }, random);
                let light = light.map(|band| band.min(2.0 * BRIGHTEST));
                add(&mut sample.straight, light, share * 2.0 * mirrored);
                share *= 1.0 - 2.0 * mirrored.min(0.5);
                let behind = World::off(ray.origin + ray.direction * hit.distance, -look.normal);
                ray.origin = behind;
                glazed = true;
                continue;
            }
            let shown = self.surface(&ray, place, &look, (material.metal, material.emission), random);
            if glazed {
                // Behind glass a mirror's glint is a speck.
                let glint = |band: usize| (shown.straight[band] - shown.emission[band]).min(BRIGHTEST * 0.1);
                let straight = std::array::from_fn(|band| shown.emission[band] + glint(band));
                add(&mut sample.straight, straight, share);
                add(&mut sample.emission, straight, share);
                sample.albedo = [0.03; 3];
                (sample.tint, sample.glazed) = (shown.albedo.map(|band| band * share), 1.0);
                (sample.lamps, sample.rest) = (shown.lamps, shown.rest);
                return sample;
            }
            return shown;
        }
        sample
    }

    /// Light of a surface: what it emits and mirrors, what falls on it.
    fn surface(
        &self,
        ray: &Ray,
        place: Vec3,
        look: &Look,
        (metal, emission): (f32, [f32; 3]),
        random: &mut Random,
    ) -> Sample {
        let albedo = look.base.map(|band| band * (1.0 - metal));
        let mut sample = Sample { straight: emission, emission, albedo, tint: albedo, ..Sample::default() };
        if look.roughness < ROUGHEST_MIRROR {
            let light = self.mirrored(ray, place, look, metal, random);
            add(&mut sample.straight, light, 1.0);
        }
        sample.lamps = self.by_lamps(place, look.normal);
        sample.rest = self.lights.sampled(self.world, place, look.normal, random);
        let pair = [random.unit() as f32, random.unit() as f32];
        let out = around(look.normal, pair);
        let light = self.diffuse(Ray { origin: place, direction: out }, self.settings.bounces, random);
        add(&mut sample.rest, light, PI);
        sample
    }

    /// Light that a glossy surface mirrors, spread by its roughness.
    fn mirrored(&self, ray: &Ray, place: Vec3, look: &Look, metal: f32, random: &mut Random) -> [f32; 3] {
        let alpha = look.roughness * look.roughness;
        // Facets of Trowbridge and Reitz's distribution.
        let (u, v) = (random.unit() as f32, random.unit() as f32);
        let tilt = alpha * (u / (1.0 - u).max(1e-4)).sqrt();
        let (sin, cos) = libm::sincosf(2.0 * PI * v);
        let [x, y] = squall_scene::light::beside(look.normal);
        let facet = (look.normal + x * (tilt * cos) + y * (tilt * sin)).normalize();
        let out = ray.direction - 2.0 * ray.direction.dot(facet) * facet;
        if out.dot(look.normal) <= 0.0 {
            return [0.0; 3];
        }
        let light = self.along(Ray { origin: place, direction: out }, random);
        // What a rough facet throws far aside is a speck, too.
        let most = if look.roughness > 0.2 { BRIGHTEST } else { f32::INFINITY };
        let light = light.map(|band| band.min(most));
        let cosine = -facet.dot(ray.direction);
        std::array::from_fn(|band| {
            let straight = PLAIN_REFLECTION + metal * (look.base[band] - PLAIN_REFLECTION);
            light[band] * fresnel(straight, cosine)
        })
    }

    /// Light along a mirrored ray: emission is seen, surfaces are diffuse.
    fn along(&self, ray: Ray, random: &mut Random) -> [f32; 3] {
        let Some(hit) = self.world.first(&ray, f32::INFINITY, true) else { return self.settings.sky };
        let scene = self.world.scene();
        let mut light = scene.materials[scene.material[hit.triangle as usize] as usize].emission;
        let shown = self.reflected(&ray, &hit, 1, random);
        add(&mut light, shown, 1.0);
        light
    }

    /// Diffuse light along a ray with so many further reflections, without what the first surface emits, which was asked for already.
    fn diffuse(&self, ray: Ray, bounces: u32, random: &mut Random) -> [f32; 3] {
        let Some(hit) = self.world.first(&ray, f32::INFINITY, true) else { return self.settings.sky };
        self.reflected(&ray, &hit, bounces, random).map(|band| band.min(BRIGHTEST))
    }

    fn reflected(&self, ray: &Ray, hit: &Hit, bounces: u32, random: &mut Random) -> [f32; 3] {
        let normal = self.world.normal(hit.triangle);
        let normal = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
        let place = World::off(ray.origin + ray.direction * hit.distance, normal);
        let albedo = self.world.scene().base(hit.triangle as usize);
        let mut falls = self.by_lamps(place, normal);
        let others = self.lights.sampled(self.world, place, normal, random);
        add(&mut falls, others.map(|band| band.min(BRIGHTEST)), 1.0);
        if bounces > 1 {
            let pair = [random.unit() as f32, random.unit() as f32];
            let next = Ray { origin: place, direction: around(normal, pair) };
            let light = self.diffuse(next, bounces - 1, random);
            add(&mut falls, light, PI);
        } else {
            add(&mut falls, self.settings.sky, PI);
        }
        std::array::from_fn(|band| albedo[band] / PI * falls[band])
    }

    /// Irradiance by the lamps.
    fn by_lamps(&self, place: Vec3, normal: Vec3) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for lamp in &self.world.scene().lamps {
            let Some((towards, far, power)) = from_lamp(lamp, place.as_dvec3()) else { continue };
            let cosine = towards.dot(normal);
            if cosine <= 0.0 || power[0].max(power[1]).max(power[2]) * cosine < 1e-6 {
                continue;
            }
            if !self.world.blocked(&Ray { origin: place, direction: towards }, far - LAMP_RADIUS_M) {
                add(&mut sum, power, cosine);
            }
        }
        sum
    }
}

fn add(sum: &mut [f32; 3], light: [f32; 3], share: f32) {
    for band in 0..3 {
        sum[band] += share * light[band];
    }
}

/// Side of what a pixel covers at a distance, m.
fn footprint(camera: &Camera, distance: f32) -> f64 {
    let middle = DVec2::new(0.5 * f64::from(camera.width), 0.5 * f64::from(camera.height));
    let [a, b]: [DVec3; 2] = [0.0, 1.0].map(|step| camera.ray(middle.x + step, middle.y).direction);
    a.distance(b) * f64::from(distance)
}

/// Schlick's share of mirrored light.
fn fresnel(straight: f32, cosine: f32) -> f32 {
    let left = (1.0 - cosine).clamp(0.0, 1.0);
    let squared = left * left;
    straight + (1.0 - straight) * squared * squared * left
}

#[cfg(test)]
mod tests;
