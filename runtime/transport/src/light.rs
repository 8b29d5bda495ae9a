//! Sources of light in and around a cloud.

use glam::DVec3;

/// A point of light: a piece of a stroke, or a virtual point light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointLight {
    /// Where, m.
    pub position: DVec3,
    /// Radiant intensity, the same in every direction, W/sr.
    pub intensity: f64,
}

/// A source of direct light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// The same radiant intensity in every direction, from a point.
    Point {
        /// Where, m.
        position: DVec3,
        /// Radiant intensity, W/sr.
        intensity: f64,
    },
    /// Parallel light that fills space.
    Beam {
        /// Unit direction of travel.
        direction: DVec3,
        /// Power through a unit of area across the beam, W/m².
        irradiance: f64,
    },
}

impl From<PointLight> for Light {
    fn from(light: PointLight) -> Self {
        Self::Point { position: light.position, intensity: light.intensity }
    }
}
