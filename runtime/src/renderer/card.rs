//! A whole picture on a graphics card: the same order as [`super::draw`], one command submission, nothing of a frame back to the
//! processor but its picture, where that is asked for.
//!
//! What stays the same is kept: the sky's picture while camera and sky stay, light while strokes and viewer do, and the picture of sky
//! and cloud while neither light nor anything else of them changes.

mod before;
#[cfg(test)]
mod tests;
mod town;

use super::draw::TOWN_M;
use super::lit_stroke::{CLOUD_M, eye_height};
use super::weather::{Found, Weather};
use super::{FrameReport, Memory, Scene, StormRenderer};
use crate::camera::Camera;
use crate::clouds::f16_value;
use crate::error::RuntimeError;
use crate::frame::Frame;
use crate::gpu::around::AroundPass;
use crate::gpu::clock::Clock;
use crate::gpu::cloud::CloudUniform;
use crate::gpu::compose::ComposePass;
use crate::gpu::frame::{FrameGroup, FrameUniform};
use crate::gpu::light::{CloudLights, Tints};
use crate::gpu::march::MarchPass;
use crate::gpu::memory::Held;
use crate::gpu::rain::DrawArguments;
use crate::gpu::readback::Readback;
use crate::gpu::targets::Targets;
use crate::gpu::tone::{Developed, TonePasses};
use crate::gpu::town::surface::check;
use crate::gpu::volume::Volumes;
use crate::gpu::{Gpu, GpuReport};
use crate::parallel::prelude::*;
use crate::picture::Picture;
use crate::shade::detail::{Detail, DetailParameters};
use crate::shade::sky::{Sky, SkyParameters};
use crate::tone::Tone;
use town::CardTown;

/// What draws.
#[derive(Clone, Default)]
#[non_exhaustive]
pub enum Backend {
    /// The processor: the reference.
    #[default]
    Cpu,
    /// A graphics card.
    Gpu(Gpu),
}

/// A renderer's half on the card.
pub(super) struct Card {
    gpu: Gpu,
    clock: Clock,
    back: Readback,
    frame: FrameGroup,
    volumes: Volumes,
    cloud: Option<Lit>,
    march: MarchPass,
    around: AroundPass,
    compose: ComposePass,
    weather: Weather,
    town: Option<CardTown>,
    tone: TonePasses,
    /// The picture that the tone passes are bound to.
    shown: Option<([u32; 2], bool)>,
    drops: Readback,
    targets: Option<Targets>,
    /// A scene of the caller's.
    before: Option<before::Before>,
    seen: Option<Seen>,
    detail: Option<DetailParameters>,
    is_measured: bool,
    report: GpuReport,
    _nothing: Option<Held<wgpu::Buffer>>,
}

/// The cloud and its light.
struct Lit {
    lights: CloudLights,
    grid: CloudUniform,
}

/// What sky and cloud were last drawn for.
#[derive(Clone, PartialEq)]
struct Seen {
    sky: SkyParameters,
    camera: Camera,
    detail: DetailParameters,
    unit: f32,
    tints: Option<Tints>,
    had_around: bool,
}

/// Where a picture goes.
pub(super) enum Onto<'a> {
    /// Back to the processor.
    Memory,
    /// A texture of the caller's, as linear light, or developed for a display.
    Texture(&'a wgpu::TextureView, wgpu::TextureFormat, Option<&'a Tone>),
}

/// What a stored 1 stands for at night, and where strokes flash, W/(m² sr): half precision then reaches from 10⁻⁶ to 10³, and 16
/// times that.
const NIGHT_UNIT: f32 = 1.0 / 64.0;
const FLASH_UNIT: f32 = 0.25;
/// The sun's disc takes at most this of half precision's largest number.
const DISC: f32 = 32_768.0;

/// Where nothing shines but the sky, its brightest takes at most this share of half precision's normal numbers.
const SKY_ALONE: f32 = 4096.0;

/// The frame's unit: a power of two. `lights` are lamps, windows or a scene of the caller's.
fn unit_of(brightest: f32, [flashes, lights]: [bool; 2]) -> f32 {
    let least = match (flashes, lights) {
        (true, _) => FLASH_UNIT,
        (false, true) => NIGHT_UNIT,
        (false, false) if brightest > 0.0 => {
            NIGHT_UNIT.min(libm::exp2f(libm::ceilf(libm::log2f(brightest / SKY_ALONE)).max(-100.0)))
        }
        (false, false) => NIGHT_UNIT,
    };
    let disc = brightest / DISC;
    if disc <= least { least } else { libm::exp2f(libm::ceilf(libm::log2f(disc))) }
}

impl Card {
    fn new(gpu: &Gpu, scene: &Scene, memory: &Memory) -> Result<Self, RuntimeError> {
        scene.town.as_ref().map_or(Ok(()), check)?;
        let frame = FrameGroup::new(gpu);
        let (mut cloud, mut nothing) = (None, None);
        let volumes = match (&memory.clouds, &scene.cloud) {
            (Some(clouds), Some(own)) => {
                let lights = CloudLights::new(gpu, clouds)?;
                let grid = CloudUniform::new(clouds.relighter(), scene.place.origin);
                let shape = (clouds.cloud(), &own.shape, grid.extinction_unit);
                let volumes = Volumes::new(gpu, shape, &lights);
                cloud = Some(Lit { lights, grid });
                volumes
            }
            _ => {
                let (volumes, uniform) = Volumes::none(gpu);
                nothing = Some(uniform);
                volumes
            }
        };
        let around = AroundPass::new(gpu, &frame, &volumes);
        let found = Found { frame: &frame.layout, harmonics: &around.harmonics, told: &around.told };
        let weather = Weather::new(gpu, scene, found);
        let town = CardTown::new(gpu, scene, &frame, &weather)?;
        Ok(Self {
            clock: Clock::new(gpu),
            back: Readback::new(gpu),
            march: MarchPass::new(gpu, &frame, &volumes),
            around,
            compose: ComposePass::new(gpu, &frame),
            weather,
            town,
            tone: TonePasses::new(gpu, &frame.layout),
            shown: None,
            drops: Readback::new(gpu),
            gpu: gpu.clone(),
            frame,
            volumes,
            cloud,
            targets: None,
            before: None,
            seen: None,
            detail: None,
            is_measured: false,
            report: GpuReport { adapter: gpu.name().to_owned(), ..GpuReport::default() },
            _nothing: nothing,
        })
    }

    /// Draws `asked`, which was checked.
    fn draw(
        &mut self,
        scene: &Scene,
        asked: &Frame,
        memory: &mut Memory,
        onto: &Onto<'_>,
    ) -> Result<FrameReport, RuntimeError> {
        let frame = &scene.place.frame(asked);
        super::rain::check(scene.rain.as_ref(), frame, &mut memory.rain)?;
        let sky = match memory.sky.take() {
            Some((known, sky)) if known == frame.sky => sky,
            _ => Sky::new(&frame.sky)?,
        };
        let detail = match memory.detail.take() {
            Some((known, detail)) if known == frame.detail => detail,
            _ => Detail::new(&frame.detail)?,
        };
        let drawn = self.draw_under(scene, (frame, asked), (&sky, &detail), memory, onto);
        memory.sky = Some((frame.sky.clone(), sky));
        memory.detail = Some((frame.detail, detail));
        drawn
    }

    fn draw_under(
        &mut self,
        scene: &Scene,
        (frame, asked): (&Frame, &Frame),
        (sky, detail): (&Sky, &Detail),
        memory: &mut Memory,
        onto: &Onto<'_>,
    ) -> Result<FrameReport, RuntimeError> {
        // Anything that fails leaves a picture of nothing known behind.
        let seen = self.seen.take();
        self.set_foreground(memory.foreground.as_ref(), &frame.camera)?;
        let (mut report, tints) = self.set_light(scene, (frame, asked), (sky, detail), memory)?;
        let unit = self.set_frame(scene, (frame, sky), seen.as_ref());
        let camera = &frame.camera;
        let size = [camera.width, camera.height];
        let is_wet = frame.weather.rate.0 > 0.0;
        let has_around = is_wet || scene.town.is_some();
        let are_new = self.resize(size);
        let gpu = self.gpu.clone();
        let Some(targets) = &self.targets else { return Ok(report) };
        let lit = self.weather.lit_strokes(scene, frame, sky)?;
        self.weather.set(&gpu, scene, (frame, sky), &lit, (&mut memory.rain, targets))?;
        if let Some(town) = &mut self.town {
            town.set(&gpu, scene, (frame, sky), &lit, (targets, &self.around, are_new))?;
        }
        self.compose.set(&gpu, targets, self.before.as_ref().map(|before| before.views.clone()));
        self.set_tone(&gpu, size, is_wet, onto)?;
        let (sky, detail) = (frame.sky.clone(), frame.detail);
        let now = Seen { sky, camera: camera.clone(), detail, unit, tints, had_around: has_around };
        self.record(scene.town.is_some(), seen.as_ref(), &now, onto);
        self.seen = Some(now);
        self.report.bytes_held = gpu.bytes_held();
        if let Onto::Memory = onto {
            read(&mut self.back, size, unit, &mut memory.picture)?;
            if is_wet {
                report.streaks = self.found()?;
            }
        }
        if self.is_measured {
            self.report.passes = self.clock.read()?;
        }
        Ok(report)
    }

    /// Tells the next submission what lights the cloud, and what its billows are.
    fn set_light(
        &mut self,
        scene: &Scene,
        (frame, asked): (&Frame, &Frame),
        (sky, detail): (&Sky, &Detail),
        memory: &mut Memory,
    ) -> Result<(FrameReport, Option<Tints>), RuntimeError> {
        let (Some(lit), Some(clouds)) = (&mut self.cloud, &mut memory.clouds) else {
            return Ok((FrameReport::default(), None));
        };
        let (_, _, voxels_per_metre) = detail.table();
        let grid = lit.grid.with_detail(&frame.detail, voxels_per_metre);
        let report = lit.lights.set(&self.gpu, clouds, asked, (sky, scene.place), grid)?;
        self.volumes.tint(&self.gpu, &lit.lights.tints);
        if self.detail != Some(frame.detail) {
            self.volumes.set_detail(&self.gpu, &lit.lights.uniform, detail);
            self.detail = Some(frame.detail);
        }
        Ok((report, Some(lit.lights.tints)))
    }

    /// Tells the next submission who looks, under which sky; what a stored 1 stands for, W/(m² sr).
    fn set_frame(&mut self, scene: &Scene, (frame, sky): (&Frame, &Sky), seen: Option<&Seen>) -> f32 {
        let camera = &frame.camera;
        let uniform = sky.uniform(camera, eye_height(camera.position), [CLOUD_M, TOWN_M]);
        let flashes = frame.flashes.iter().any(|flash| flash.brightness > 0.0);
        // No part of a sky is sixteen times as bright as its mean but for the sun's own place.
        let sky_light = sky.mean_radiance().into_iter().fold(0.0, f32::max);
        let bright = uniform.brightest().max(16.0 * sky_light);
        let unit = unit_of(bright, [flashes, scene.town.is_some() || self.before.is_some()]);
        let is_other_sky = seen.is_none_or(|seen| seen.sky != frame.sky);
        self.frame.set(&self.gpu, &FrameUniform::new(frame, unit));
        self.frame.set_sky(&self.gpu, &uniform, is_other_sky.then_some(sky));
        self.around.set(&self.gpu, camera);
        unit
    }

    /// Has pictures of this size; says whether they were made anew.
    fn resize(&mut self, size: [u32; 2]) -> bool {
        let are_new = self.targets.as_ref().is_none_or(|targets| targets.size != size);
        if are_new {
            let targets = Targets::new(&self.gpu, size);
            // Without a town nothing stands before the sky.
            self.gpu.fill(&targets.town_metres, &vec![NO_END_M; (size[0] * size[1]) as usize]);
            (self.targets, self.shown) = (Some(targets), None);
        }
        if let Some(targets) = &mut self.targets {
            if targets.scene.is_some() != self.before.is_some() {
                // Passes after it are bound anew, and make pictures of their own.
                self.shown = None;
            }
            match self.before {
                Some(_) => targets.with_scene(&self.gpu),
                None => targets.scene = None,
            }
        }
        are_new
    }

    /// Puts the frame on record and sends it off.
    fn record(&mut self, has_town: bool, seen: Option<&Seen>, now: &Seen, onto: &Onto<'_>) {
        let Some(targets) = &self.targets else { return };
        let gpu = &self.gpu;
        let mut recorder = self.clock.record(self.is_measured);
        let is_lit = self.cloud.as_mut().is_some_and(|lit| lit.lights.record(&mut recorder));
        let is_other = is_lit || seen != Some(now);
        if is_other {
            let same =
                |seen: &Seen| (&seen.sky, &seen.camera, seen.unit) == (&now.sky, &now.camera, now.unit);
            let is_new = !seen.is_some_and(same);
            self.march.record(gpu, &mut recorder, (&self.frame, &self.volumes), (targets, is_new));
            if now.had_around {
                self.around.record(&mut recorder, (&self.frame, &self.volumes), has_town);
            }
        }
        self.weather.record_shown(&mut recorder, &self.frame.group);
        if let Some(town) = &mut self.town {
            let groups = [&self.frame.group, &self.weather.group.group];
            town.record(gpu, &mut recorder, groups, is_other);
        }
        self.compose.record(&mut recorder, &self.frame.group, targets.size);
        self.weather.record(gpu, &mut recorder, &self.frame.group, targets);
        match onto {
            Onto::Memory => {
                self.back.copy(&mut recorder.encoder, self.weather.picture(targets));
                self.drops.copy_buffer(&mut recorder.encoder, self.weather.drops());
            }
            Onto::Texture(view, format, _) => {
                self.tone.record(&mut recorder, &self.frame.group, (view, *format));
            }
        }
        recorder.submit();
    }
}

impl Card {
    /// Binds the tone passes to the picture that is shown, and tells them how.
    fn set_tone(
        &mut self,
        gpu: &Gpu,
        size: [u32; 2],
        is_wet: bool,
        onto: &Onto<'_>,
    ) -> Result<(), RuntimeError> {
        let (Onto::Texture(_, format, tone), Some(targets)) = (onto, &self.targets) else { return Ok(()) };
        if self.shown != Some((size, is_wet)) {
            self.tone.set_picture(gpu, &self.weather.picture(targets).view, size);
            self.shown = Some((size, is_wet));
        }
        let developed = if tone.is_some() { Developed::Signal } else { Developed::Radiance };
        self.tone.set(gpu, &tone.copied().unwrap_or_default(), (developed, *format))
    }

    /// How many streaks the last picture has.
    ///
    /// Errors: the device is lost; more than there was room for.
    fn found(&mut self) -> Result<usize, RuntimeError> {
        let found = self.drops.values::<DrawArguments>()?.first().map_or(0, |told| told.found);
        let room = self.weather.room();
        if found > room {
            let wanted = format!("a frame of at most {room} streaks on a graphics card");
            return Err(RuntimeError::argument("rain", wanted, found));
        }
        Ok(found as usize)
    }
}

/// What stands for sky among distances, m.
const NO_END_M: f32 = 1e30;

/// Reads the picture back, in W/(m² sr).
fn read(back: &mut Readback, size: [u32; 2], unit: f32, picture: &mut Picture) -> Result<(), RuntimeError> {
    let [width, height] = size.map(|count| count as usize);
    if [picture.width, picture.height] != [width, height] {
        *picture = Picture::new(width, height)?;
    }
    back.show(|bytes, padded| {
        let row = |(y, row): (usize, &mut [[f32; 3]])| {
            let texels = bytes[y * padded..].as_chunks::<8>().0;
            for (pixel, texel) in row.iter_mut().zip(texels) {
                *pixel = std::array::from_fn(|band| {
                    f16_value(u16::from_le_bytes([texel[2 * band], texel[2 * band + 1]])) * unit
                });
            }
        };
        picture.pixels.par_chunks_mut(width).enumerate().for_each(row);
    })
}

impl StormRenderer {
    /// Chooses what draws from now on. A card is given the asset: its rows, its cloud, its shaders, once.
    ///
    /// Errors: a damaged row; an asset that is larger than a card within WebGPU's default limits can hold.
    pub fn set_backend(&mut self, backend: Backend) -> Result<(), RuntimeError> {
        self.card = match backend {
            Backend::Cpu => None,
            Backend::Gpu(gpu) => Some(Card::new(&gpu, &self.scene, &self.memory)?),
        };
        Ok(())
    }

    /// Whether a card measures its passes: [`StormRenderer::gpu_report`] then has them, and every frame is waited for.
    pub fn measure(&mut self, is_measured: bool) {
        if let Some(card) = &mut self.card {
            card.is_measured = is_measured;
        }
    }

    /// What the last frame took on a card; `None` where the processor draws.
    #[must_use]
    pub fn gpu_report(&self) -> Option<&GpuReport> {
        self.card.as_ref().map(|card| &card.report)
    }

    /// Draws `frame` on the card into `view`, a texture of the caller's device of the frame's size and of `format`, as linear radiance,
    /// W/(m² sr). Nothing is waited for: what the caller submits to the same queue afterwards sees the picture.
    ///
    /// Errors: as [`StormRenderer::render`]; the processor draws.
    pub fn render_into(
        &mut self,
        frame: &Frame,
        view: &wgpu::TextureView,
        format: wgpu::TextureFormat,
    ) -> Result<FrameReport, RuntimeError> {
        self.draw_into(frame, &Onto::Texture(view, format, None))
    }

    /// [`StormRenderer::render_into`] developed for a display: the lens's bloom, exposure and curve, sRGB, dither. `format` is that of a
    /// surface, bgra8 or rgba8, with or without sRGB.
    ///
    /// Errors: as there; a format that no picture is shown in.
    pub fn develop_into(
        &mut self,
        frame: &Frame,
        tone: &Tone,
        view: &wgpu::TextureView,
        format: wgpu::TextureFormat,
    ) -> Result<FrameReport, RuntimeError> {
        self.draw_into(frame, &Onto::Texture(view, format, Some(tone)))
    }

    fn draw_into(&mut self, frame: &Frame, onto: &Onto<'_>) -> Result<FrameReport, RuntimeError> {
        frame.check()?;
        let Some(card) = &mut self.card else {
            let wanted = "a renderer on a graphics card (StormRenderer::set_backend)";
            return Err(RuntimeError::argument("backend", wanted, "the processor"));
        };
        self.report = card.draw(&self.scene, frame, &mut self.memory, onto)?;
        Ok(self.report)
    }

    /// Opens another device in place of one of our own that was lost, once.
    ///
    /// Errors: the second time; there is no other; as [`StormRenderer::set_backend`].
    #[cfg(not(target_family = "wasm"))]
    fn recover(&mut self, error: RuntimeError) -> Result<(), RuntimeError> {
        let Some(lost) = self.card.as_ref().filter(|card| !card.report.recovered) else { return Err(error) };
        let is_measured = lost.is_measured;
        let mut card = Card::new(&Gpu::open()?, &self.scene, &self.memory)?;
        (card.is_measured, card.report.recovered) = (is_measured, true);
        self.card = Some(card);
        Ok(())
    }

    /// A page opens devices without waiting: there the loss is the caller's to mend.
    #[cfg(target_family = "wasm")]
    fn recover(&mut self, error: RuntimeError) -> Result<(), RuntimeError> {
        Err(error)
    }

    /// The device that draws.
    #[cfg(test)]
    pub(super) fn device(&self) -> Option<&Gpu> {
        self.card.as_ref().map(|card| &card.gpu)
    }

    /// [`StormRenderer::render`] on the card.
    pub(super) fn render_on_card(&mut self, frame: &Frame) -> Result<bool, RuntimeError> {
        let Some(card) = &mut self.card else { return Ok(false) };
        let drawn = card.draw(&self.scene, frame, &mut self.memory, &Onto::Memory);
        self.report = match drawn {
            Err(error) if card.gpu.lost().is_some() => {
                self.recover(error)?;
                let Some(card) = &mut self.card else { return Ok(false) };
                card.draw(&self.scene, frame, &mut self.memory, &Onto::Memory)?
            }
            drawn => drawn?,
        };
        Ok(true)
    }
}
