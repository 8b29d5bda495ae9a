//! The cloud's light on the card: what of it has to be worked out anew, and into which volumes it goes.
//!
//! Two volumes are marched: the light of sky and sun in three colours, which stays while nothing moves, and up to four strokes of
//! brightness 1 as channels, which a flicker only scales. Of more than four strokes those of one colour share a channel, and of
//! more than four colours three channels are the colours themselves; then brightness is part of the sum.

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
use crate::clouds::{Clouds, LightQuality, LightReport, SunSource, Viewer};
use crate::error::RuntimeError;
use crate::frame::{Flash, Frame};
use crate::place::Place;
use crate::relight::PointLight;
use crate::renderer::FrameReport;
use crate::shade::sky::{Sky, SkyParameters};
use crate::single_scatter::{DirectRays, DirectSettings};
use crate::stroke::Stroke;
use glam::{DVec3, Vec3};
use squall_formats::section::response::DistantKind;
use std::sync::Arc;

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

/// Light that one channel holds: strokes, each with a factor.
#[derive(Clone)]
struct Bundle {
    parts: Vec<(Arc<Stroke>, f64)>,
    rays: DirectRays,
    quality: LightQuality,
}

impl Bundle {
    fn is(&self, other: &Self) -> bool {
        let same = |((a, x), (b, y)): (&(Arc<Stroke>, f64), &(Arc<Stroke>, f64))| {
            x == y && (Arc::ptr_eq(a, b) || a.segments == b.segments)
        };
        (self.rays, self.quality) == (other.rays, other.quality)
            && self.parts.len() == other.parts.len()
            && self.parts.iter().zip(&other.parts).all(same)
    }

    fn lights(&self) -> Vec<PointLight> {
        let of = |(stroke, factor): &(Arc<Stroke>, f64)| {
            let factor = *factor;
            // One point a segment: what the bake prunes its sources to.
            let lights = stroke.lights(0.0).into_iter();
            lights.map(move |light| PointLight { intensity: light.intensity * factor, ..light })
        };
        self.parts.iter().flat_map(of).collect()
    }
}

/// Strokes that flash, bundled into channels, each with its colour.
fn bundles(
    lit: &[(Arc<Stroke>, &Flash)],
    (rays, quality): (DirectRays, LightQuality),
) -> Vec<(Bundle, [f32; 3])> {
    if lit.len() <= CHANNELS {
        let own = |(stroke, flash): &(Arc<Stroke>, &Flash)| {
            (Bundle { parts: vec![(stroke.clone(), 1.0)], rays, quality }, flash.scale_of(stroke))
        };
        return lit.iter().map(own).collect();
    }
    let mut colours: Vec<([f32; 3], Bundle)> = Vec::new();
    for (stroke, flash) in lit {
        let colour = flash.color_of(stroke);
        let part = (stroke.clone(), flash.brightness);
        match colours.iter_mut().find(|(known, _)| *known == colour) {
            Some((_, bundle)) => bundle.parts.push(part),
            None => colours.push((colour, Bundle { parts: vec![part], rays, quality })),
        }
    }
    if colours.len() <= CHANNELS {
        return colours.into_iter().map(|(colour, bundle)| (bundle, colour)).collect();
    }
    let band = |band: usize| {
        let part = |(stroke, flash): &(Arc<Stroke>, &Flash)| {
            (stroke.clone(), flash.brightness * f64::from(flash.color_of(stroke)[band]))
        };
        let parts = lit.iter().map(part).filter(|(_, factor)| *factor > 0.0).collect();
        (Bundle { parts, rays, quality }, Vec3::AXES[band].to_array())
    };
    (0..3).map(band).filter(|(bundle, _)| !bundle.parts.is_empty()).collect()
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
        let channels: Vec<Channel> = (0..CHANNELS)
            .map(|_| Channel {
                sum: Sum::new(gpu, &rows, &haar),
                direct: direct.light(gpu),
                bundle: None,
                is_solved: false,
                step: 0.0,
                scale: 0.0,
                report: LightReport::default(),
                is_followed: false,
                used: 0,
            })
            .collect();
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
        let of_sky = [&quiet, &sky[0].light.light, &sky[1].light.light, &sky[2].light.light, &beam, &layers];
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

    fn set_sky(
        &mut self,
        gpu: &Gpu,
        clouds: &mut Clouds,
        (sky, place, parameters): (&Sky, Place, &SkyParameters),
        (viewer, moved): (Viewer, bool),
    ) -> Result<(SunSource, bool), RuntimeError> {
        let kinds = [DistantKind::UpperSky, DistantKind::LowerSky];
        let hemispheres = kinds.map(|kind| clouds.hemisphere(kind));
        let missing = hemispheres.iter().any(Option::is_none);
        if self.lit_by.is_none() {
            for (sum, source) in self.sky.iter_mut().zip(hemispheres) {
                sum.set(gpu, &self.rows, &Scattered::Rows(source.into_iter().collect()));
            }
        }
        let is_new = self.lit_by.as_ref() != Some(parameters);
        if is_new {
            let unit = sky_unit(sky);
            let layers = layers_of(clouds.cloud(), sky, place, unit);
            self.sun_is_up = layers.iter().any(|light| light[..3] != [0.0; 3]);
            let towards = sky.sun_direction().as_dvec3().normalize();
            gpu.write(&self.layers, &layers);
            let known = self.sun.is_some_and(|(known, ..)| known == towards);
            if self.sun_is_up && !known {
                (self.sun, self.lit_by) = (None, None);
                let (source, scattered, has_beam) = clouds.sun_parts(towards, viewer)?;
                self.sky[2].set(gpu, &self.rows, &scattered.unwrap_or(Scattered::Rows(Vec::new())));
                if has_beam {
                    gpu.write(&self.beam, &clouds.beam(towards));
                }
                self.sun = Some((towards, source, has_beam));
            }
            let light = sky.cloud_light(0.0, DVec3::ZERO);
            let stored = |light: [f32; 3]| light.map(|band| band / unit);
            let quiet = Quiet {
                upper: stored(light.upper),
                has_beam: u32::from(self.sun_is_up && self.sun.is_some_and(|(.., has_beam)| has_beam)),
                lower: stored(light.lower),
                travel: (-towards).as_vec3().to_array(),
                ..Quiet::default()
            };
            gpu.write(&self.quiet, &[quiet]);
            self.tints.quiet = unit;
            self.lit_by = Some(parameters.clone());
        } else if moved && let Some((towards, SunSource::Live, _)) = self.sun {
            // The processor knows that light towards one viewer at a time.
            let (_, scattered, _) = clouds.sun_parts(towards, viewer)?;
            self.sky[2].set(gpu, &self.rows, &scattered.unwrap_or(Scattered::Rows(Vec::new())));
        }
        if moved {
            let is_live = matches!(self.sun, Some((_, SunSource::Live, _)));
            for (i, sum) in self.sky.iter_mut().enumerate() {
                sum.is_turned |= !(is_live && i == 2);
            }
        }
        self.quiet_is_new |= moved || is_new;
        let source = self.sun.filter(|_| self.sun_is_up).map_or(SunSource::Down, |(_, source, _)| source);
        Ok((source, missing))
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

/// Largest number of half precision.
const HALF_LARGEST: f32 = 65_504.0;

/// The power of two below `value`, or the nearest that single precision's normal numbers have.
fn power_of_two(value: f32) -> f32 {
    let exponent = libm::floorf(libm::log2f(value)).clamp(-100.0, 100.0);
    libm::ldexpf(1.0, if exponent.is_finite() { exponent as i32 } else { 0 })
}

/// W/(m² sr) that a stored 1 of the quiet light stands for: J is about as bright as what lights it, and at most some times that.
fn sky_unit(sky: &Sky) -> f32 {
    let light = sky.cloud_light(1e5, DVec3::ZERO);
    let brightest =
        [light.upper, light.lower, light.sun_irradiance].into_iter().flatten().fold(0.0, f32::max);
    if brightest > 0.0 { power_of_two(brightest / 64.0) } else { 1.0 }
}

/// The sun's irradiance at the four corners of each layer of the grid, in units of `unit` W/m². (renderer/light.rs, distant_colours)
fn layers_of(cloud: &crate::transport::Cloud, sky: &Sky, from: Place, unit: f32) -> Vec<[f32; 4]> {
    let [nx, ny, nz] = cloud.shape.to_array();
    let corners =
        |z: usize| [(0, 0), (nx - 1, 0), (0, ny - 1), (nx - 1, ny - 1)].map(move |(x, y)| [x, y, z]);
    let light = |cell: [usize; 3]| {
        let place = cloud.centre(cell) - from.origin;
        let [r, g, b] = sky.cloud_light(place.z, place).sun_irradiance.map(|band| band / unit);
        [r, g, b, 0.0]
    };
    (0..nz).flat_map(corners).map(light).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::assert_layout;
    use crate::clouds::f16_value as half;
    use crate::gpu::clock::Clock;
    use crate::gpu::readback::Readback;
    use crate::gpu::test_gpu;
    use crate::load::Asset;
    use crate::renderer::light::{Ambient, light_cells};
    use glam::Vec4;

    #[test]
    fn lights_uniforms_lie_as_the_shader_has_them() {
        assert_layout!(PACK, Quiet { upper, has_beam, lower, pad0, travel, pad1 });
        assert_layout!(PACK, Strokes { steps, scales });
    }

    /// Half precision of the volumes beside rows' and direct light's round-off, as a share of the root mean square.
    const HALF: f64 = 1e-3;
    /// What the codec leaves below zero is cut off a stroke at a time here, and of all strokes of one colour in sum there.
    const CUT: f64 = 1e-2;

    /// The light of every cell as the volumes hold it.
    fn cells(gpu: &Gpu, lights: &mut CloudLights) -> Vec<Vec3> {
        let (mut clock, mut back) = (Clock::new(gpu), Readback::new(gpu));
        let mut read = |image: &Image, recorder: Option<Recorder<'_>>| -> Vec<[u16; 4]> {
            let mut own = Clock::new(gpu);
            let mut recorder = recorder.unwrap_or_else(|| own.record(false));
            back.copy(&mut recorder.encoder, image);
            recorder.submit();
            back.values().unwrap()
        };
        let mut recorder = clock.record(true);
        lights.record(&mut recorder);
        let quiet = read(&lights.quiet_volume, Some(recorder));
        let strokes = read(&lights.stroke_volume, None);
        let tints = lights.tints;
        let one = |(quiet, strokes): (&[u16; 4], &[u16; 4])| {
            let mut sum = Vec3::new(half(quiet[0]), half(quiet[1]), half(quiet[2])) * tints.quiet;
            for (tint, channel) in tints.strokes.iter().zip(strokes) {
                sum += Vec4::from_array(*tint).truncate() * half(*channel);
            }
            sum
        };
        quiet.iter().zip(&strokes).map(one).collect()
    }

    /// A frame that looks at the cloud from where the asset allows.
    pub fn frame_of(asset: &Asset, clouds: &Clouds) -> Frame {
        let own = crate::StormRenderer::new(asset.clone()).unwrap().frame();
        let cloud = clouds.cloud();
        let middle = 0.5 * (cloud.origin_m + cloud.far_corner());
        let eye = match clouds.relighter().view_region() {
            Some(region) => DVec3::from_array(region.centre()),
            None => middle - DVec3::new(1200.0, 900.0, 300.0),
        };
        let camera =
            crate::Camera::look_at(eye, middle, squall_formats::units::Degrees(60.0), [160, 90]).unwrap();
        own.unwrap_or_else(|| Frame::new(camera.clone())).camera(camera)
    }

    /// The asset's strokes, or two sparks where its light was baked.
    pub fn flashes_of(asset: &Asset, clouds: &Clouds) -> Vec<Flash> {
        let strokes = crate::stroke::Strokes::of(asset).unwrap();
        let named: Vec<Flash> =
            strokes.records().iter().map(|record| Flash::named(record.name.as_str())).collect();
        if !named.is_empty() {
            return named;
        }
        let [low, high] = clouds.bounds();
        let spark = |share: f64| {
            let at = clouds.nearest_lit(low + (high - low) * share).unwrap();
            Flash::own(Stroke::from_points(&[at], 1e6, [0.8, 0.7, 1.2]).unwrap())
        };
        vec![spark(0.3), spark(0.6)]
    }

    #[test]
    fn volumes_hold_the_processors_light_of_strokes_sky_and_sun() {
        let Some(gpu) = test_gpu() else { return };
        for name in ["v1/golden.squall", "v2/eyes.squall", "v3/sun.squall"] {
            let path = format!("{}/../data/golden/{name}", env!("CARGO_MANIFEST_DIR"));
            let asset = Asset::open(path).unwrap();
            let mut clouds = Clouds::new(&asset).unwrap();
            let place = Place::of(&asset).unwrap();
            let mut lights = CloudLights::new(&gpu, &clouds).unwrap();
            let grid = CloudUniform::new(clouds.relighter(), place.origin);
            let mut frame = frame_of(&asset, &clouds);
            let flashes = flashes_of(&asset, &clouds);
            // By day, at dusk, and with all strokes flashing, some more often than there are channels.
            for (elevation, times) in [(0.9, 1), (-0.06, 1), (-0.06, 0), (-0.06, 3)] {
                frame.sky.sun_elevation.0 = elevation;
                frame.flashes.clear();
                for i in 0..times {
                    let tint = [1.0 + 0.2 * i as f32, 0.8, 0.5 + 0.1 * i as f32];
                    let lit = if times == 1 { &flashes[..1] } else { &flashes[..] };
                    frame.flashes.extend(lit.iter().map(|flash| {
                        let flash = flash.clone().brightness(0.3 + 0.7 * f64::from(i));
                        if times > 1 { flash.colored(tint) } else { flash }
                    }));
                }
                let sky = Sky::new(&frame.sky).unwrap();
                let (mut wanted, mut flashes) = (Vec::new(), Vec::new());
                let wanted_report = light_cells(
                    &mut clouds,
                    &frame,
                    (&sky, place),
                    &mut Ambient::default(),
                    (&mut wanted, &mut flashes),
                );
                let report = lights.set(&gpu, &mut clouds, &frame, (&sky, place), grid);
                let (Ok(wanted_report), Ok(report)) = (wanted_report, report) else { panic!("{name}") };
                assert_eq!((report.sun, report.sky_missing), (wanted_report.sun, wanted_report.sky_missing));
                let found = cells(&gpu, &mut lights);
                // Cells that a march reads.
                let mut known = clouds.relighter().known_cells();
                let distances = clouds.relighter().cloud_distances();
                known.iter_mut().zip(distances).for_each(|(known, &steps)| *known &= steps <= 1);
                let (mut off, mut all) = (0.0, 0.0);
                for cell in (0..found.len()).filter(|&cell| known[cell]) {
                    off += f64::from((found[cell] - wanted[cell].truncate()).length_squared());
                    all += f64::from(wanted[cell].truncate().length_squared());
                }
                let error = libm::sqrt(off / all);
                let most = if times > 1 { CUT } else { HALF };
                assert!(all > 0.0 && error < most, "{name} {elevation} {times}: {error}");
            }
        }
    }
}
