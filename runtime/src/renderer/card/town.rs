//! The town in a picture of the card: its passes, what lights them, and when they are drawn anew.

#[cfg(test)]
mod tests;

use super::super::Scene;
use super::super::draw::{MIRROR_HALF_WIDTH, MIRROR_SIZE, MIRROR_TOP, heading_of};
use super::super::lit_stroke::LitStroke;
use super::super::town::{MadeFor, together};
use super::super::weather::Weather;
use super::super::world::SIZE;
use crate::camera::Camera;
use crate::error::RuntimeError;
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::gpu::around::AroundPass;
use crate::gpu::clock::Recorder;
use crate::gpu::frame::FrameGroup;
use crate::gpu::targets::Targets;
use crate::gpu::town::light::TownLights;
use crate::gpu::town::passes::{TownPasses, TownTargets};
use crate::shade::environment::EnvironmentWindow;
use crate::shade::sky::Sky;
use squall_formats::units::Radians;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

/// The town of an asset on a card.
pub struct CardTown {
    passes: TownPasses,
    made_for: Option<(MadeFor, Vec<(usize, [f32; 3])>)>,
    is_other: bool,
}

/// Directions that the maps of `camera` hold: where mirrors look, and all.
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
    /// The passes of the scene's town; none where it has none.
    ///
    /// Errors: a town that doesn't fit WebGPU's default limits.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        frame: &FrameGroup,
        weather: &Weather,
    ) -> Result<Option<Self>, RuntimeError> {
        let Some(town) = &scene.town else { return Ok(None) };
        let passes = TownPasses::new(gpu, frame, (town, &weather.town), &weather.group)?;
        Ok(Some(Self { passes, made_for: None, is_other: true }))
    }

    /// Tells the next submission who looks and what shines; `are_new` says whether `targets` were made anew.
    ///
    /// Errors: a picture that is larger than a card's list of pixels.
    pub fn set(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        (frame, sky): (&Frame, &Sky),
        flashes: &[LitStroke],
        (targets, around, are_new): (&Targets, &AroundPass, bool),
    ) -> Result<(), RuntimeError> {
        let (points, images) = together(flashes.iter());
        let rate = scene.rain_place.field(frame).rate(frame.weather.rate);
        let lights = TownLights {
            ambient: sky.harmonics(),
            points: &points,
            images: &images,
            sun: sky.sun(),
            rain_extinction: frame.medium.undrawn(rate).extinction().0 as f32,
            windows: windows(&frame.camera),
        };
        self.passes.set(gpu, &frame.camera, frame.quality.town, &lights)?;
        if are_new || self.passes.wants_targets() {
            let maps = [&around.mirror.view, &around.around.view];
            let (town, metres) = (&targets.town.view, &targets.town_metres.view);
            self.passes.set_targets(gpu, &TownTargets { maps, town, metres });
        }
        let has_map = scene.rain_place.map_of(frame).is_some();
        // A flicker that no cloud shows is one all the same.
        let lit = |flash: &LitStroke| (Arc::as_ptr(&flash.stroke) as usize, flash.scale);
        let now = Some((MadeFor::of(frame, has_map), flashes.iter().map(lit).collect()));
        self.is_other = self.made_for != now;
        self.made_for = now;
        Ok(())
    }

    /// Draws the town, unless the kept picture is that of this frame; `relit` says whether what is around the eye was looked at anew.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        groups: [&wgpu::BindGroup; 2],
        relit: bool,
    ) {
        self.passes.record(gpu, recorder, groups, relit || self.is_other);
    }
}
