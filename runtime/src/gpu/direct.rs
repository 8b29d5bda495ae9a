//! Direct light of strokes on the card: [`crate::single_scatter`]'s own rays, added up in whole numbers.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::{Pass, groups_of};
use super::memory::Held;
use super::shader::DIRECT;
use crate::relight::{PointLight, Relighter};
use crate::single_scatter::{DirectSettings, random_turn};
use crate::transport::Cloud;
use crate::transport::direct::fibonacci;
use std::collections::BTreeMap;

/// `Direct` of direct.wgsl.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Direct {
    pub rays: u32,
    pub points: u32,
    pub steps: f32,
    pub pad0: u32,
}

/// `Point` of direct.wgsl.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Point {
    pub place: [f32; 3],
    pub power: f32,
    pub turn: [f32; 4],
    pub first: u32,
    pub direction: u32,
    pub pad0: u32,
    pub pad1: u32,
}

/// Steps from cloud within which cells get direct light. (direct/skip.rs)
const AROUND: u8 = 1;
/// Largest sum of steps in a cell.
const MOST_STEPS: f64 = 2e9;

/// The rays of a stroke, ready for the card.
pub struct Rays {
    points: Vec<Point>,
    directions: Vec<[f32; 4]>,
    uniform: Direct,
}

impl Rays {
    /// The rays that [`crate::single_scatter::add_direct`] would follow for strokes one after the other, of so many of `lights` each.
    pub fn new(cloud: &Cloud, lights: &[PointLight], strokes: &[usize], settings: DirectSettings) -> Self {
        let (mut counts, mut numbers, mut rest) = (Vec::new(), Vec::new(), lights);
        for &stroke in strokes.iter().chain([&lights.len()]) {
            let (own, others) = rest.split_at(stroke.min(rest.len()));
            counts.extend(settings.rays.of(own));
            numbers.extend(0..own.len() as u64);
            rest = others;
        }
        let mut starts: BTreeMap<u32, u32> = BTreeMap::new();
        let (mut directions, mut first) = (Vec::new(), 0u32);
        let mut points = Vec::with_capacity(lights.len());
        for ((light, &count), &number) in lights.iter().zip(&counts).zip(&numbers) {
            let direction = *starts.entry(count).or_insert_with(|| {
                let start = directions.len() as u32;
                let sphere = (0..count as usize).map(|i| fibonacci(i, count as usize));
                directions.extend(sphere.map(|direction| direction.as_vec3().extend(0.0).to_array()));
                start
            });
            let power = light.intensity * 4.0 * std::f64::consts::PI / f64::from(count);
            points.push(Point {
                place: (light.position - cloud.origin_m).as_vec3().to_array(),
                power: (power / cloud.cell_volume()) as f32,
                turn: random_turn(settings.seed, number).as_quat().to_array(),
                first,
                direction,
                ..Point::default()
            });
            first += count;
        }
        let most = most_light(cloud, lights);
        let steps = (MOST_STEPS / most).min(f64::from(f32::MAX)) as f32;
        let uniform = Direct { rays: first, points: points.len() as u32, steps, pad0: 0 };
        Self { points, directions, uniform }
    }

    /// W/(m² sr) that one step stands for.
    pub fn step(&self) -> f32 {
        1.0 / self.uniform.steps
    }
}

/// More than the direct light of any cell, W/(m² sr): a cell sees the points in it and around it along its whole diagonal and at
/// the phase function's peak; others fill less than a sphere's 26th part each way.
pub fn most_light(cloud: &Cloud, lights: &[PointLight]) -> f64 {
    let mut around: BTreeMap<[i64; 3], f64> = BTreeMap::new();
    let mut whole = 0.0;
    for light in lights {
        let power = light.intensity.abs() * 4.0 * std::f64::consts::PI;
        whole += power;
        let at: [i64; 3] = std::array::from_fn(|axis| {
            ((light.position[axis] - cloud.origin_m[axis]) / cloud.cell_m[axis]).floor() as i64
        });
        for i in 0..27 {
            let near = [at[0] + i % 3 - 1, at[1] + i / 3 % 3 - 1, at[2] + i / 9 - 1];
            *around.entry(near).or_default() += power;
        }
    }
    let near = around.values().copied().fold(0.0, f64::max);
    let diagonal = cloud.cell_m.iter().map(|edge| edge * edge).sum::<f64>().sqrt();
    let g = cloud.g.abs();
    let peak = (1.0 + g) / (4.0 * std::f64::consts::PI * (1.0 - g) * (1.0 - g));
    ((near + whole / 26.0) * diagonal * peak / cloud.cell_volume()).max(f64::from(f32::MIN_POSITIVE))
}

/// What direct light of one asset is followed through.
pub struct DirectPass {
    kernel: Kernel,
    layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
    _buffers: [Held<wgpu::Buffer>; 2],
    cells: usize,
}

/// Direct light of one stroke.
pub struct DirectLight {
    /// Steps per cell, x fastest.
    pub sums: Held<wgpu::Buffer>,
    uniform: Held<wgpu::Buffer>,
    points: Held<wgpu::Buffer>,
    directions: Held<wgpu::Buffer>,
    group: wgpu::BindGroup,
    rays: u32,
}

impl DirectPass {
    /// Prepares the asset's cloud; `cloud` is its uniform buffer.
    pub fn new(gpu: &Gpu, relighter: &Relighter, cloud: &wgpu::Buffer) -> Self {
        // Beyond the first cells around cloud no lookup between centres reads.
        let (mut known, distances) = (relighter.known_cells(), relighter.cloud_distances());
        known.iter_mut().zip(distances).for_each(|(known, &steps)| *known &= steps <= AROUND);
        let word = |cells: &[bool]| {
            (0..).zip(cells).fold(0u32, |word, (bit, &known)| word | u32::from(known) << bit)
        };
        let seen: Vec<u32> = known.chunks(32).map(word).collect();
        let buffers = [
            gpu.storage("extinction", &relighter.cloud().extinction),
            gpu.storage("seen cells' bits", &seen),
        ];
        let asset = gpu.layout("cells", &[Slot::Uniform, Slot::Read, Slot::Read]);
        let layout = gpu.layout("direct light", &[Slot::Uniform, Slot::Read, Slot::Read, Slot::Write]);
        let resources = [cloud, &buffers[0], &buffers[1]].map(|buffer| buffer.as_entire_binding());
        let group = gpu.group("cells", &asset, &resources);
        let kernel = gpu.kernel(&gpu.module(&DIRECT), "follow_rays", &[None, Some(&asset), Some(&layout)]);
        Self { kernel, layout, group, _buffers: buffers, cells: known.len() }
    }

    /// Room for one stroke's light.
    pub fn light(&self, gpu: &Gpu) -> DirectLight {
        use wgpu::BufferUsages as Use;
        let sums = gpu.buffer("direct light", 4 * self.cells as u64, Use::STORAGE | Use::COPY_SRC);
        let (points, directions) =
            (gpu.storage::<Point>("points", &[]), gpu.storage::<[f32; 4]>("directions", &[]));
        let uniform = gpu.uniform::<Direct>("direct light");
        let group = self.group(gpu, [&uniform, &points, &directions, &sums]);
        DirectLight { sums, uniform, points, directions, group, rays: 0 }
    }

    fn group(&self, gpu: &Gpu, buffers: [&wgpu::Buffer; 4]) -> wgpu::BindGroup {
        gpu.group("direct light", &self.layout, &buffers.map(|buffer| buffer.as_entire_binding()))
    }

    /// Tells the next submission which rays to follow. Memory grows to the largest stroke seen.
    pub fn set(&self, gpu: &Gpu, light: &mut DirectLight, rays: &Rays) {
        let fits = |buffer: &wgpu::Buffer, bytes: usize| buffer.size() >= bytes as u64;
        if !fits(&light.points, size_of_val(rays.points.as_slice()))
            || !fits(&light.directions, size_of_val(rays.directions.as_slice()))
        {
            light.points = gpu.storage("points", &rays.points);
            light.directions = gpu.storage("directions", &rays.directions);
            light.group = self.group(gpu, [&light.uniform, &light.points, &light.directions, &light.sums]);
        } else {
            gpu.write(&light.points, &rays.points);
            gpu.write(&light.directions, &rays.directions);
        }
        gpu.write(&light.uniform, &[rays.uniform]);
        light.rays = rays.uniform.rays;
    }

    /// Forgets the light of an earlier stroke or viewer; goes before the pass of [`DirectPass::run`].
    pub fn clear(&self, encoder: &mut wgpu::CommandEncoder, light: &DirectLight) {
        encoder.clear_buffer(&light.sums, 0, None);
    }

    /// Puts one stroke's rays on record.
    pub fn run(&self, pass: &mut Pass<'_>, light: &DirectLight) {
        if light.rays > 0 {
            let size = groups_of(light.rays, 64);
            pass.run(&self.kernel, &[None, Some(&self.group), Some(&light.group)], size);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::cloud::CloudUniform;
    use super::*;
    use crate::assert_layout;
    use crate::clouds::{Clouds, Viewer};
    use crate::gpu::clock::Clock;
    use crate::gpu::readback::Readback;
    use crate::gpu::test_gpu;
    use crate::load::Asset;
    use crate::random::Random;
    use crate::single_scatter::{DirectRays, add_direct_near};
    use glam::DVec3;

    #[test]
    fn points_of_light_lie_as_the_shader_has_them() {
        assert_layout!(DIRECT, Direct { rays, points, steps, pad0 });
        assert_layout!(DIRECT, Point { place, power, turn, first, direction, pad0, pad1 });
    }

    #[test]
    fn direct_light_is_the_processors_and_the_same_bits_every_time() {
        /// Cells that a ray cuts at a corner, and single precision along it, as a share of the light's root mean square.
        const ROUND_OFF: f64 = 1e-4;
        let Some(gpu) = test_gpu() else { return };
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
        let clouds = Clouds::new(&Asset::open(path).unwrap()).unwrap();
        let (relighter, cloud) = (clouds.relighter(), clouds.cloud());
        let mut random = Random::new(5);
        let [low, high] = clouds.bounds();
        let lights: Vec<PointLight> = (0..40)
            .map(|_| PointLight {
                position: low + (high - low) * DVec3::from_array([0; 3].map(|_| random.unit())),
                intensity: random.range(-0.1, 1.0) * 1e6,
            })
            .collect();
        let viewer = Viewer::At(DVec3::new(30.0, -700.0, 2.0));
        let settings = DirectSettings { rays: DirectRays::PerStroke(1 << 14), seed: 3 };
        let seen = relighter.seen_by(viewer);
        let mut wanted = vec![0.0; cloud.shape.len()];
        let near = (cloud, relighter.extinction_scale(), relighter.cloud_distances());
        add_direct_near(near, (relighter.near_cells(), &seen.ways), &lights, settings, &mut wanted);
        let uniform = gpu.uniform::<CloudUniform>("cloud");
        gpu.write(&uniform, &[CloudUniform::new(relighter, DVec3::ZERO).seen_by(cloud, viewer)]);
        let pass = DirectPass::new(&gpu, relighter, &uniform);
        let mut light = pass.light(&gpu);
        let rays = Rays::new(cloud, &lights, &[], settings);
        pass.set(&gpu, &mut light, &rays);
        let (mut clock, mut back) = (Clock::new(&gpu), Readback::new(&gpu));
        let mut run = || -> Vec<i32> {
            let mut recorder = clock.record(true);
            pass.clear(&mut recorder.encoder, &light);
            recorder.pass("direct", |own| pass.run(own, &light));
            back.copy_buffer(&mut recorder.encoder, &light.sums);
            recorder.submit();
            back.values().unwrap()
        };
        let (found, again) = (run(), run());
        assert_eq!(found, again);
        let known = relighter.known_cells();
        let (mut off, mut all) = (0.0, 0.0);
        for cell in (0..found.len()).filter(|&cell| known[cell]) {
            let own = found[cell] as f32 * rays.step();
            off += crate::gpu::square(own - wanted[cell]);
            all += crate::gpu::square(wanted[cell]);
        }
        assert!(all > 0.0 && (off / all).sqrt() < ROUND_OFF, "{}", (off / all).sqrt());
    }
}
