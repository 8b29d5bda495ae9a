//! How a town is looked at and what lights it, as its passes take it.

use crate::camera::{Camera, Projection};
use crate::gpu::rain::plain;
use crate::shade::environment::EnvironmentWindow;
use crate::shade::sky::harmonics::Harmonics;
use crate::shade::town::frame::Quality;
use crate::shade::town::light::SceneLight;
use crate::shade::town::line::Images;
use crate::world::Sun;

plain! {
    /// `TownView` of town_view.wgsl.
    TownView {
        counts: [u32; 4],
        lines: [u32; 4],
        steps: [f32; 4],
        measures: [f32; 4],
        ambient: [[f32; 4]; 9],
        sun_towards: [f32; 4],
        sun: [f32; 4],
        mirror: [f32; 4],
        around: [f32; 4],
    }
}
plain! {
    /// `TownSource` of town_light.wgsl.
    TownSource {
        start: [f32; 3],
        share: f32,
        end: [f32; 3],
        pad: f32,
        intensity: [f32; 3],
        pad1: f32,
    }
}
/// Everything that shines on a town from outside but for the lit cloud's glow, which the card finds itself.
pub struct TownLights<'a> {
    /// The sky's harmonics, W/(m² sr).
    pub ambient: &'a Harmonics,
    /// Points that light surfaces and cast shadows.
    pub points: &'a [SceneLight],
    /// Lines whose image stands in the water.
    pub images: &'a Images,
    /// The sun before the storm's cloud.
    pub sun: Option<Sun>,
    /// Extinction of the rain on the ways, none of whose drops is drawn, 1/m.
    pub rain_extinction: f32,
    /// Where the map lies that mirrors look into, and that of all directions.
    pub windows: [EnvironmentWindow; 2],
}

fn four([x, y, z]: [f32; 3], w: f32) -> [f32; 4] {
    [x, y, z, w]
}

impl TownView {
    /// A camera's view of a town that nothing lights yet.
    pub fn of_camera(camera: &Camera, quality: Quality) -> Self {
        let width = 1.0 / camera.pixels_per_metre() as f32;
        let angle = match camera.projection {
            Projection::Perspective { .. } => width,
            Projection::Orthographic { .. } => 0.0,
        };
        Self {
            steps: Images::STEPS,
            counts: [quality.samples.clamp(1, 64), quality.facets.max(1), quality.spacing.clamp(1, 32), 0],
            // No infinity goes to a shader.
            measures: [quality.tolerance.min(1e30), angle, width, 0.0],
            ..Self::default()
        }
    }

    /// The same in light.
    #[must_use]
    pub fn lit_by(mut self, lights: &TownLights<'_>) -> Self {
        self.counts[3] = lights.points.len() as u32;
        self.lines[0] = lights.images.len() as u32;
        self.measures[3] = lights.rain_extinction;
        self.ambient = lights.ambient.map(|light| four(light, 0.0));
        if let Some(sun) = lights.sun {
            self.sun_towards = four(sun.towards.to_array(), sun.angular_radius.0 as f32);
            self.sun = four(sun.irradiance, 0.0);
        }
        [self.mirror, self.around] = lights.windows.map(|window| {
            [window.heading, window.half_width, window.bottom, window.top].map(|angle| angle.0 as f32)
        });
        self
    }
}

impl TownLights<'_> {
    /// Points, balls around lines, lines.
    pub fn sources(&self) -> Vec<TownSource> {
        let point = |light: &SceneLight| TownSource {
            start: light.position.to_array(),
            share: light.visibility,
            end: light.position.to_array(),
            intensity: light.intensity,
            ..TownSource::default()
        };
        let mut sources: Vec<TownSource> = self.points.iter().map(point).collect();
        sources.extend(self.images.sources());
        sources
    }
}
