//! Strokes that flash in a frame, as its parts share them.

use crate::shade::town::light::StrokeLights;
use crate::stroke::{Segment, Stroke};
use glam::DVec3;
use std::sync::Arc;

/// Height of the middle of a cloud, that clear air is looked through to, m.
pub(crate) const CLOUD_M: f64 = 4_000.0;
/// Highest eye that clear air's density is known for, m.
const HIGHEST_EYE_M: f64 = 1e5;

/// Height above the ground of an eye that is measured from the scene's place, m.
pub(crate) fn eye_height(eye: DVec3) -> f64 {
    eye.z.clamp(0.0, HIGHEST_EYE_M)
}

/// A stroke that flashes.
pub(crate) struct LitStroke {
    pub stroke: Arc<Stroke>,
    /// Colour times brightness.
    pub scale: [f32; 3],
    /// The stroke as points around the eye, of brightness 1 in white.
    pub lights: StrokeLights,
}

impl LitStroke {
    /// The stroke's pieces.
    pub fn segments(&self) -> &[Segment] {
        &self.stroke.segments
    }

    /// Radiant intensity per colour of a piece of the stroke, W/sr.
    pub fn intensity(&self, intensity: f64) -> [f32; 3] {
        self.scale.map(|band| (f64::from(band) * intensity) as f32)
    }
}
