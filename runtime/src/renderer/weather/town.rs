//! The town of a picture on a graphics card, lit by sky, cloud and channels as [`super::super::town`] has it.

use crate::camera::Camera;
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::gpu::around::AroundPass;
use crate::gpu::clock::Recorder;
use crate::gpu::targets::Targets;
use crate::gpu::town::light::TownLights;
use crate::gpu::town::passes::{TownPasses, TownTargets};
use crate::medium::{Medium, MediumChoice};
use crate::rain::{RainPlace, RainVolume};
use crate::renderer::draw::{MIRROR_HALF_WIDTH, MIRROR_SIZE, MIRROR_TOP, heading_of};
use crate::renderer::lit_stroke::LitStroke;
use crate::renderer::world::SIZE;
use crate::shade::environment::EnvironmentWindow;
use crate::shade::sky::{Sky, SkyParameters};
use crate::shade::town::frame::Quality;
use crate::shade::town::light::SceneLight;
use crate::shade::town::line::{Images, LineLight};
use glam::DVec3;
use squall_formats::units::{MillimetresPerHour, Radians};
use std::f64::consts::{FRAC_PI_2, PI};

/// The town's passes, and what their last picture was made for.
pub struct CardTown {
    passes: TownPasses,
    made_for: Option<MadeFor>,
    is_stale: bool,
}

/// What the town's light depends on beside the cloud's.
#[derive(Clone, PartialEq)]
struct MadeFor {
    camera: Camera,
    sky: SkyParameters,
    quality: Quality,
    rain: Option<(MillimetresPerHour, MediumChoice, RainVolume, RainPlace, DVec3)>,
    /// Strokes by their place in memory, with their factors.
    flashes: Vec<(usize, [f32; 3])>,
}

fn windows(camera: &Camera) -> [EnvironmentWindow; 2] {
    let mirror = EnvironmentWindow {
        heading: heading_of(camera),
        half_width: Radians(MIRROR_HALF_WIDTH),
        bottom: Radians(0.0),
        top: Radians(MIRROR_TOP),
        size: MIRROR_SIZE,
    };
    let around = EnvironmentWindow {
        heading: Radians(0.0),
        half_width: Radians(PI),
        bottom: Radians(-FRAC_PI_2),
        top: Radians(FRAC_PI_2),
        size: SIZE,
    };
    [mirror, around]
}

impl CardTown {
    /// Passes that have drawn nothing yet.
    pub fn new(passes: TownPasses) -> Self {
        Self { passes, made_for: None, is_stale: true }
    }

    /// Tells the next submission how the town is lit; `undrawn` is the rain between its places, and `has_map` whether it moves.
    pub fn set(
        &mut self,
        gpu: &Gpu,
        (frame, sky): (&Frame, &Sky),
        flashes: &[LitStroke],
        (undrawn, has_map): (Option<&Medium>, bool),
        (around, targets): (&AroundPass, &Targets),
    ) {
        let camera = &frame.camera;
        let weather = &frame.weather;
        let drift = if has_map { weather.drift } else { DVec3::ZERO };
        let rain = (weather.rate, frame.medium.clone(), weather.volume, frame.place.clone(), drift);
        let of = |flash: &LitStroke| (std::sync::Arc::as_ptr(&flash.stroke) as usize, flash.scale);
        let key = MadeFor {
            camera: camera.clone(),
            sky: frame.sky.clone(),
            quality: frame.quality.town,
            rain: undrawn.map(|_| rain),
            flashes: flashes.iter().map(of).collect(),
        };
        if self.made_for.as_ref() == Some(&key) {
            return;
        }
        let scaled = |scale: [f32; 3], light: [f32; 3]| std::array::from_fn(|band| scale[band] * light[band]);
        let points: Vec<SceneLight> = flashes
            .iter()
            .flat_map(|flash| flash.lights.points.iter().map(|light| (flash.scale, light)))
            .map(|(scale, light)| SceneLight { intensity: scaled(scale, light.intensity), ..*light })
            .collect();
        let lines: Vec<LineLight> = flashes
            .iter()
            .flat_map(|flash| flash.lights.images.iter().map(|line| (flash.scale, line)))
            .map(|(scale, line)| LineLight { intensity: scaled(scale, line.intensity), ..*line })
            .collect();
        let images = Images::from(lines);
        let lights = TownLights {
            ambient: sky.harmonics(),
            points: &points,
            images: &images,
            sun: sky.sun(),
            rain_extinction: undrawn.map_or(0.0, |medium| medium.extinction().0 as f32),
            windows: windows(camera),
        };
        self.passes.set(gpu, camera, frame.quality.town, &lights);
        if self.passes.wants_targets() {
            self.passes.set_targets(
                gpu,
                &TownTargets {
                    maps: [&around.mirror.view, &around.around.view],
                    town: &targets.town.view,
                    metres: &targets.town_metres.view,
                },
            );
        }
        (self.made_for, self.is_stale) = (Some(key), true);
    }

    /// Draws the town, unless it is as it was; `is_new` says that cloud or sky around it are others.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        [frame, rain]: [&wgpu::BindGroup; 2],
        (around, is_new): (&AroundPass, bool),
    ) {
        if is_new || self.is_stale {
            let bytes = self.passes.glow.size().min(around.told.size());
            recorder.encoder.copy_buffer_to_buffer(&around.told, 0, &self.passes.glow, 0, bytes);
            self.passes.record(gpu, recorder, [frame, rain]);
            self.is_stale = false;
        }
    }
}
