//! The world around the eye on the card: maps of directions, its harmonics, the lit cloud as one light. Nothing of it comes back to the processor inside a frame.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::Recorder;
use super::frame::FrameGroup;
use super::memory::{Held, Image};
use super::shader::{AROUND, LOOK};
use super::targets::LIGHT;
use super::volume::Volumes;
use crate::camera::Camera;
use crate::renderer::draw::{MIRROR_HALF_WIDTH, MIRROR_SIZE, MIRROR_TOP, heading_of};
use crate::renderer::world::SIZE;
use crate::world::degrees::{Basis, COUNT, DEGREE, RINGS, SPOKES, rings};
use std::f32::consts::{FRAC_PI_2, PI};

/// Rays of the glow and the one towards the sun.
const GLOW_RAYS: u32 = 96 * 32 + 1;
/// Cosines and sines of a ring.
const WAVES: usize = 2 * DEGREE + 1;
/// Pairs of a degree and an order from 0.
const PAIRS: usize = (DEGREE + 1) * (DEGREE + 2) / 2;

/// `Window` of look.wgsl: directions that a map holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Window {
    pub heading: f32,
    pub half_width: f32,
    pub bottom: f32,
    pub top: f32,
    pub columns: u32,
    pub rows: u32,
    pub pad0: u32,
    pub pad1: u32,
}

impl Window {
    /// All directions.
    fn whole() -> Self {
        let [columns, rows] = SIZE.map(|count| count as u32);
        Self { half_width: PI, bottom: -FRAC_PI_2, top: FRAC_PI_2, columns, rows, ..Self::default() }
    }

    /// 8 × 8 tiles of its map.
    fn tiles(self) -> u32 {
        self.columns.div_ceil(8) * self.rows.div_ceil(8)
    }

    /// Where the mirrors of what `camera` sees look.
    fn mirrored(camera: &Camera) -> Self {
        let [columns, rows] = MIRROR_SIZE.map(|count| count as u32);
        let (heading, top) = (heading_of(camera).0 as f32, MIRROR_TOP as f32);
        Self { heading, half_width: MIRROR_HALF_WIDTH as f32, top, columns, rows, ..Self::default() }
    }
}

/// `Around` of around.wgsl: what other passes are told.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Around {
    pub mean: [f32; 3],
    pub sun_open: f32,
    pub glow_centre: [f32; 3],
    pub glow_radius: f32,
    pub glow_radiance: [f32; 3],
    pub deviation: f32,
}

/// The world around the eye.
pub struct AroundPass {
    kernels: [Kernel; 4],
    /// All directions, in the frame's unit: azimuth from −π to π, elevation from −π/2 to π/2, on the outer texels' middles.
    pub around: Image,
    /// Where mirrors look, in the frame's unit; its window is the one that [`AroundPass::windows`] holds second.
    pub mirror: Image,
    /// Two [`Window`]s, all directions and the mirrors', a uniform buffer.
    pub windows: Held<wgpu::Buffer>,
    /// The [`Around`] of the frame, a storage buffer.
    pub told: Held<wgpu::Buffer>,
    /// The world's harmonics, four numbers each in the order l² + l + m, a storage buffer.
    pub harmonics: Held<wgpu::Buffer>,
    mirror_tiles: u32,
    groups: Groups,
    _buffers: Vec<Held<wgpu::Buffer>>,
}

struct Groups {
    maps: wgpu::BindGroup,
    read: wgpu::BindGroup,
    written: wgpu::BindGroup,
}

/// Legendre's functions at the rings, each with its ring's share, and behind them the rings' heights.
fn legendre(basis: &Basis) -> Vec<f32> {
    let mut table = vec![0.0f32; RINGS * (PAIRS + 1)];
    for (ring, [z, weight]) in rings().enumerate() {
        let share = weight * 2.0 * std::f64::consts::PI / SPOKES as f64;
        let rho = (1.0 - z * z).sqrt();
        table[RINGS * PAIRS + ring] = z as f32;
        let mut power = 1.0;
        for m in 0..=DEGREE {
            let scale = share * power * if m > 0 { std::f64::consts::SQRT_2 } else { 1.0 };
            let (mut below, mut own) = (0.0, basis.step(m, m).1);
            for l in m..=DEGREE {
                if l > m {
                    let ([a, ab], _) = basis.step(l, m);
                    (below, own) = (own, a * z * own - ab * below);
                }
                table[ring * PAIRS + l * (l + 1) / 2 + m] = (scale * own) as f32;
            }
            power *= rho;
        }
    }
    table
}

impl AroundPass {
    /// Compiles the passes.
    pub fn new(gpu: &Gpu, frame: &FrameGroup, volumes: &Volumes) -> Self {
        use wgpu::BufferUsages as Use;
        let floats =
            |label: &str, count: usize| gpu.buffer(label, 4 * count as u64, Use::STORAGE | Use::COPY_SRC);
        let flat = |label: &str, size: [u32; 2]| gpu.target(label, size, LIGHT);
        let around = flat("around", SIZE.map(|count| count as u32));
        let mirror = flat("mirrors' map", MIRROR_SIZE.map(|count| count as u32));
        let windows = gpu.uniform::<[Window; 2]>("windows");
        let rays = floats("glow", 4 * GLOW_RAYS as usize);
        // Passes of the weather are told it as uniforms.
        let told = gpu.buffer("around", 48, Use::STORAGE | Use::UNIFORM | Use::COPY_SRC);
        let basis = Basis::new();
        let table = gpu.storage("Legendre's functions", &legendre(&basis));
        let (turned, harmonics) = (floats("rings", 4 * RINGS * WAVES), floats("harmonics", 4 * COUNT));

        let slots = [Slot::Uniform, Slot::Store(LIGHT), Slot::Store(LIGHT), Slot::Write];
        let look = gpu.layout("maps", &slots);
        let read = gpu.layout("what is around", &[Slot::Flat, Slot::Read, Slot::Read]);
        let written = gpu.layout("what it comes to", &[Slot::Write, Slot::Write, Slot::Write]);
        let maps =
            [windows.as_entire_binding(), around.binding(), mirror.binding(), rays.as_entire_binding()];
        let all = [around.binding(), rays.as_entire_binding(), table.as_entire_binding()];
        let sums = [&turned, &harmonics, &told].map(|buffer| buffer.as_entire_binding());
        let groups = Groups {
            maps: gpu.group("maps", &look, &maps),
            read: gpu.group("what is around", &read, &all),
            written: gpu.group("what it comes to", &written, &sums),
        };
        let [cloud, light] = &volumes.layouts;
        let looking = [Some(&frame.layout), Some(cloud), Some(light), Some(&look)];
        let summing = [Some(&frame.layout), Some(&read), Some(&written)];
        let (looks, sums) = (gpu.module(&LOOK), gpu.module(&AROUND));
        let kernels = [
            gpu.kernel(&looks, "look_around", &looking),
            gpu.kernel(&sums, "turn_rings", &summing),
            gpu.kernel(&sums, "project_harmonics", &summing),
            gpu.kernel(&sums, "sum_glow", &summing),
        ];
        let buffers = vec![rays, table, turned];
        Self { kernels, around, mirror, windows, told, harmonics, mirror_tiles: 0, groups, _buffers: buffers }
    }

    /// Tells the next submission where mirrors look.
    pub fn set(&mut self, gpu: &Gpu, camera: &Camera) {
        let mirrored = Window::mirrored(camera);
        gpu.write(&self.windows, &[Window::whole(), mirrored]);
        self.mirror_tiles = mirrored.tiles();
    }

    /// Puts the maps and what they come to on record; mirrors only where something mirrors.
    pub fn record(
        &self,
        recorder: &mut Recorder<'_>,
        (frame, volumes): (&FrameGroup, &Volumes),
        has_mirrors: bool,
    ) {
        let [look, turn, project, glow] = &self.kernels;
        let [cloud, light] = &volumes.groups;
        let own = Some(&frame.group);
        recorder.pass("around", |pass| {
            let groups = [own, Some(cloud), Some(light), Some(&self.groups.maps)];
            let mirrors = if has_mirrors { self.mirror_tiles } else { 0 };
            pass.run(look, &groups, [GLOW_RAYS.div_ceil(64) + Window::whole().tiles() + mirrors, 1, 1]);
        });
        recorder.pass("harmonics", |pass| {
            let groups = [own, Some(&self.groups.read), Some(&self.groups.written)];
            pass.run(turn, &groups, [RINGS as u32, 1, 1]);
            pass.run(project, &groups, [(COUNT as u32).div_ceil(64), 1, 1]);
            pass.run(glow, &groups, [1, 1, 1]);
        });
    }
}
