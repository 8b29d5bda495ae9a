//! The cloud's light on the card: what of it has to be worked out anew, and into which volumes it goes.
//!
//! Two volumes are marched: the light of sky and sun in three colours, which stays while nothing moves, and up to four strokes of
//! brightness 1 as channels, which a flicker only scales. Of more than four strokes those of one colour share a channel, and of
//! more than four colours three channels are the colours themselves; then brightness is part of the sum.

mod bundle;
mod quiet;

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::Recorder;
use super::cloud::{CloudUniform, counts};
use super::direct::{DirectLight, DirectPass, Rays, most_light};
use super::haar::{HaarPass, RowLight};
use super::memory::{Held, Image};
use super::rows::{RowSum, Rows};
use super::shader::PACK;
use super::targets::LIGHT;
use crate::clouds::card::Scattered;
use crate::clouds::{Clouds, LightReport, SunSource, Viewer};
use crate::error::RuntimeError;
use crate::frame::Frame;
use crate::place::Place;
use crate::renderer::FrameReport;
use crate::shade::sky::{Sky, SkyParameters};
use crate::single_scatter::DirectSettings;
use bundle::{Bundle, bundles};
use glam::{DVec3, Vec3};

/// Strokes with a channel each.
pub const CHANNELS: usize = 4;

/// `Quiet` of pack.wgsl.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Quiet {
    pub upper: [f32; 3],
    pub has_beam: u32,
    pub lower: [f32; 3],
    pub pad0: f32,
    pub travel: [f32; 3],
    pub pad1: f32,
}

/// `Strokes` of pack.wgsl.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Strokes {
    pub steps: [f32; 4],
    pub scales: [f32; 4],
}

/// `Tints` of volume.wgsl: what the channels of the two volumes count.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Tints {
    pub strokes: [[f32; 4]; CHANNELS],
    pub quiet: f32,
    pub pad0: f32,
    pub pad1: f32,
    pub pad2: f32,
}

/// One sum of rows and what it becomes.
struct Sum {
    rows: RowSum,
    light: RowLight,
    /// Whether the sum, and the light towards the viewer, are to be made.
    is_new: bool,
    is_turned: bool,
}

impl Sum {
    fn new(gpu: &Gpu, rows: &Rows, haar: &HaarPass) -> Self {
        let sum = rows.sum(gpu);
        let light = haar.light(gpu, &sum);
        Self { rows: sum, light, is_new: false, is_turned: false }
    }

    fn set(&mut self, gpu: &Gpu, rows: &Rows, scattered: &Scattered) {
        match scattered {
            Scattered::Rows(weights) => {
                rows.weigh(gpu, &self.rows, weights);
                (self.is_new, self.is_turned) = (true, true);
            }
            Scattered::Values(values) => {
                gpu.write(&self.light.light, values);
                (self.is_new, self.is_turned) = (false, false);
            }
        }
    }
}

/// A channel of the strokes' volume.
struct Channel {
    sum: Sum,
    direct: DirectLight,
    bundle: Option<Bundle>,
    /// Whether its light depends on the viewer in a way that only the processor can follow.
    is_solved: bool,
    step: f32,
    /// Stored units of 1 W/(m² sr).
    scale: f32,
    report: LightReport,
    is_followed: bool,
    used: u64,
}

impl Channel {
    fn new(sum: Sum, direct: DirectLight) -> Self {
        Self {
            sum,
            direct,
            bundle: None,
            is_solved: false,
            step: 0.0,
            scale: 0.0,
            report: LightReport::default(),
            is_followed: false,
            used: 0,
        }
    }
}

/// The light of one asset's cloud.
pub struct CloudLights {
    /// The grid and who looks, for every pass that asks.
    pub uniform: Held<wgpu::Buffer>,
    written: Option<CloudUniform>,
    rows: Rows,
    haar: HaarPass,
    direct: DirectPass,
    channels: Vec<Channel>,
    /// Upper and lower hemisphere, sun.
    sky: [Sum; 3],
    beam: Held<wgpu::Buffer>,
    layers: Held<wgpu::Buffer>,
    quiet: Held<wgpu::Buffer>,
    strokes: Held<wgpu::Buffer>,
    kernels: [Kernel; 2],
    groups: [wgpu::BindGroup; 3],
    /// Light of sky and sun in three colours.
    pub quiet_volume: Image,
    /// Light of strokes of brightness 1.
    pub stroke_volume: Image,
    /// What the volumes' channels count in this frame.
    pub tints: Tints,
    viewer: Option<Viewer>,
    lit_by: Option<SkyParameters>,
    sun: Option<(DVec3, SunSource, bool)>,
    sun_is_up: bool,
    quiet_is_new: bool,
    strokes_are_new: bool,
    clock: u64,
}

impl CloudLights {
    /// Brings the rows of `clouds` to the card; its grid is measured from `place` there.
    ///
    /// Errors: a damaged row; an asset that is larger than the card's bindings.
    pub fn new(gpu: &Gpu, clouds: &Clouds) -> Result<Self, RuntimeError> {
        let relighter = clouds.relighter();
        let uniform = gpu.uniform::<CloudUniform>("cloud");
        let rows = Rows::new(gpu, relighter)?;
        let haar = HaarPass::new(gpu, relighter, &rows, &uniform);
        let direct = DirectPass::new(gpu, relighter, &uniform);
        let shape = clouds.cloud().shape;
        let channel = |_| Channel::new(Sum::new(gpu, &rows, &haar), direct.light(gpu));
        let channels: Vec<Channel> = (0..CHANNELS).map(channel).collect();
        let sky = [(); 3].map(|()| Sum::new(gpu, &rows, &haar));
        let usage = wgpu::BufferUsages::STORAGE;
        let beam = gpu.buffer("sun's beam", 8 * shape.len() as u64, usage);
        let layers = gpu.buffer("sun by layer", 64 * u64::from(counts(shape)[2]), usage);
        let (quiet, strokes) = (gpu.uniform::<Quiet>("quiet light"), gpu.uniform::<Strokes>("strokes"));
        let volume = |label: &str| {
            let kind = (wgpu::TextureDimension::D3, LIGHT);
            gpu.texture(label, counts(shape), kind, wgpu::TextureUsages::STORAGE_BINDING)
        };
        let (quiet_volume, stroke_volume) = (volume("quiet light"), volume("light of strokes"));
        let volumes = [&quiet_volume, &stroke_volume];
        let (kernels, groups) =
            packing(gpu, &uniform, [&quiet, &strokes], (&channels, &sky, [&beam, &layers]), volumes);
        Ok(Self {
            uniform,
            written: None,
            rows,
            haar,
            direct,
            channels,
            sky,
            beam,
            layers,
            quiet,
            strokes,
            kernels,
            groups,
            quiet_volume,
            stroke_volume,
            tints: Tints::default(),
            viewer: None,
            lit_by: None,
            sun: None,
            sun_is_up: false,
            quiet_is_new: false,
            strokes_are_new: false,
            clock: 0,
        })
    }

    /// Tells the next submission what lights the cloud in `frame`, which is in the asset's coordinates, under `sky`; `grid` is the
    /// cloud's grid with the frame's billows.
    ///
    /// Errors: as [`crate::StormRenderer::render`] of the cloud's light.
    pub fn set(
        &mut self,
        gpu: &Gpu,
        clouds: &mut Clouds,
        frame: &Frame,
        (sky, place): (&Sky, Place),
        grid: CloudUniform,
    ) -> Result<FrameReport, RuntimeError> {
        let viewer = Viewer::from(&frame.camera);
        let strokes = clouds.strokes_of(&frame.flashes, viewer)?;
        let grid = grid.seen_by(clouds.cloud(), viewer);
        if self.written != Some(grid) {
            gpu.write(&self.uniform, &[grid]);
            self.written = Some(grid);
        }
        let moved = self.viewer != Some(viewer);
        if moved {
            self.haar.look(gpu, clouds.relighter(), viewer);
            self.viewer = Some(viewer);
        }
        let lit = strokes.into_iter().zip(&frame.flashes).filter(|(_, flash)| flash.brightness > 0.0);
        let lit: Vec<_> = lit.collect();
        let mut report = FrameReport::default();
        clouds.set_quality(frame.quality.light)?;
        let lit = bundles(&lit, (frame.quality.rays, frame.quality.light));
        self.set_strokes(gpu, clouds, lit, (viewer, moved), &mut report)?;
        let sky = (sky, place, &frame.sky);
        (report.sun, report.sky_missing) = self.set_sky(gpu, clouds, sky, (viewer, moved))?;
        Ok(report)
    }

    fn set_strokes(
        &mut self,
        gpu: &Gpu,
        clouds: &mut Clouds,
        bundles: Vec<(Bundle, [f32; 3])>,
        (viewer, moved): (Viewer, bool),
        report: &mut FrameReport,
    ) -> Result<(), RuntimeError> {
        self.clock += 1;
        self.tints.strokes = [[0.0; 4]; CHANNELS];
        let mut placed = Vec::new();
        for (bundle, tint) in bundles {
            let same = |channel: &Channel| channel.bundle.as_ref().is_some_and(|known| known.is(&bundle));
            let known =
                (0..CHANNELS).find(|&i| same(&self.channels[i]) && self.channels[i].used != self.clock);
            if let Some(at) = known {
                self.channels[at].used = self.clock;
            }
            placed.push((known, bundle, tint));
        }
        for (known, bundle, tint) in placed {
            let free = (0..CHANNELS).min_by_key(|&i| self.channels[i].used).unwrap_or(0);
            let at = known.unwrap_or(free);
            let channel = &mut self.channels[at];
            channel.used = self.clock;
            let is_old = known.is_some() && !(moved && channel.is_solved);
            if !is_old {
                // Whatever goes wrong, what is there is not this light.
                channel.bundle = None;
                let lights = bundle.lights();
                let parts = clouds.parts_of(&lights, viewer)?;
                channel.is_solved = matches!(parts.scattered, Scattered::Values(_));
                channel.sum.set(gpu, &self.rows, &parts.scattered);
                let settings = DirectSettings { rays: bundle.rays, ..DirectSettings::default() };
                // Each stroke sends its own rays, whoever shares its channel.
                let strokes: Vec<usize> =
                    bundle.parts.iter().map(|(stroke, _)| stroke.lights(0.0).len()).collect();
                let is_whole = parts.direct.len() == lights.len();
                let strokes = if is_whole { strokes.as_slice() } else { &[] };
                let rays = Rays::new(clouds.cloud(), &parts.direct, strokes, settings);
                self.direct.set(gpu, &mut channel.direct, &rays);
                channel.step = rays.step();
                // Half precision holds 9 decades above its smallest normal number: the brightest cell takes the uppermost.
                channel.scale = power_of_two(HALF_LARGEST / most_light(clouds.cloud(), &lights) as f32);
                channel.report = parts.report;
                channel.bundle = Some(bundle);
            } else {
                report.strokes_kept += 1;
                if moved {
                    channel.sum.is_turned = true;
                }
            }
            if !is_old || moved {
                (channel.is_followed, self.strokes_are_new) = (true, true);
            }
            report.lights += channel.report.lights;
            report.sources += channel.report.sources;
            report.lights_live += channel.report.live;
            let residuals = report.gather_residual.into_iter().chain(channel.report.residual);
            report.gather_residual = residuals.reduce(f64::max);
            self.tints.strokes[at] =
                Vec3::from_array(tint).extend(0.0).to_array().map(|band| band / channel.scale);
        }
        if self.strokes_are_new {
            let of = |value: fn(&Channel) -> f32| std::array::from_fn(|i| value(&self.channels[i]));
            gpu.write(&self.strokes, &[Strokes { steps: of(|c| c.step), scales: of(|c| c.scale) }]);
        }
        Ok(())
    }

    /// Puts on record what [`CloudLights::set`] found to be made anew.
    ///
    /// Says whether there was anything.
    pub fn record(&mut self, recorder: &mut Recorder<'_>) -> bool {
        let is_new = self.quiet_is_new || self.strokes_are_new;
        let sums = || self.sky.iter().chain(self.channels.iter().map(|channel| &channel.sum));
        if sums().any(|sum| sum.is_new) {
            recorder.pass("rows", |pass| {
                sums().filter(|sum| sum.is_new).for_each(|sum| self.rows.run(pass, &sum.rows));
            });
        }
        if sums().any(|sum| sum.is_turned) {
            recorder.pass("transform", |pass| {
                sums().filter(|sum| sum.is_turned).for_each(|sum| self.haar.run(pass, &sum.light));
            });
        }
        let followed = || self.channels.iter().filter(|channel| channel.is_followed);
        if followed().next().is_some() {
            followed().for_each(|channel| self.direct.clear(&mut recorder.encoder, &channel.direct));
            recorder.pass("direct", |pass| {
                followed().for_each(|channel| self.direct.run(pass, &channel.direct));
            });
        }
        let size = self.quiet_volume.texture.size();
        let groups = [size.width, size.height, size.depth_or_array_layers].map(|count| count.div_ceil(4));
        if self.quiet_is_new || self.strokes_are_new {
            let [grid, quiet, strokes] = &self.groups;
            recorder.pass("pack", |pass| {
                if self.quiet_is_new {
                    pass.run(&self.kernels[0], &[None, Some(grid), Some(quiet)], groups);
                }
                if self.strokes_are_new {
                    pass.run(&self.kernels[1], &[None, Some(grid), None, Some(strokes)], groups);
                }
            });
        }
        let sums = self.channels.iter_mut().map(|channel| &mut channel.sum).chain(&mut self.sky);
        sums.for_each(|sum| (sum.is_new, sum.is_turned) = (false, false));
        self.channels.iter_mut().for_each(|channel| channel.is_followed = false);
        (self.quiet_is_new, self.strokes_are_new) = (false, false);
        is_new
    }
}

/// The passes that put sums and direct light into the two volumes, and what they are given: the grid, the quiet light, the strokes.
fn packing(
    gpu: &Gpu,
    uniform: &wgpu::Buffer,
    [quiet, strokes]: [&wgpu::Buffer; 2],
    (channels, sky, [beam, layers]): (&[Channel], &[Sum; 3], [&wgpu::Buffer; 2]),
    [quiet_volume, stroke_volume]: [&Image; 2],
) -> ([Kernel; 2], [wgpu::BindGroup; 3]) {
    let layouts = [
        gpu.layout("grid", &[Slot::Uniform]),
        gpu.layout(
            "quiet light",
            &[
                Slot::Uniform,
                Slot::Read,
                Slot::Read,
                Slot::Read,
                Slot::Read,
                Slot::Read,
                Slot::StoreVolume(LIGHT),
            ],
        ),
        gpu.layout(
            "light of strokes",
            &[&[Slot::Uniform][..], &[Slot::Read; 8], &[Slot::StoreVolume(LIGHT)]].concat(),
        ),
    ];
    let mut all: Vec<_> = vec![strokes.as_entire_binding()];
    all.extend(channels.iter().map(|channel| channel.sum.light.light.as_entire_binding()));
    all.extend(channels.iter().map(|channel| channel.direct.sums.as_entire_binding()));
    all.push(stroke_volume.binding());
    let of_sky = [quiet, &*sky[0].light.light, &*sky[1].light.light, &*sky[2].light.light, beam, layers];
    let mut of_sky: Vec<_> = of_sky.iter().map(|buffer| buffer.as_entire_binding()).collect();
    of_sky.push(quiet_volume.binding());
    let groups = [
        gpu.group("grid", &layouts[0], &[uniform.as_entire_binding()]),
        gpu.group("quiet light", &layouts[1], &of_sky),
        gpu.group("light of strokes", &layouts[2], &all),
    ];
    let module = gpu.module(&PACK);
    let kernels = [
        gpu.kernel(&module, "pack_quiet", &[None, Some(&layouts[0]), Some(&layouts[1])]),
        gpu.kernel(&module, "pack_strokes", &[None, Some(&layouts[0]), None, Some(&layouts[2])]),
    ];
    (kernels, groups)
}

/// Largest number of half precision.
const HALF_LARGEST: f32 = 65_504.0;

/// The power of two below `value`, or the nearest that single precision's normal numbers have.
fn power_of_two(value: f32) -> f32 {
    let exponent = libm::floorf(libm::log2f(value)).clamp(-100.0, 100.0);
    libm::ldexpf(1.0, if exponent.is_finite() { exponent as i32 } else { 0 })
}

#[cfg(test)]
pub(crate) mod tests;
