//! The sources that light everything in a picture, whatever the camera looks at.

use glam::Vec3;
use squall_formats::units::Radians;

/// The sun as a surface at the ground has it: after the air, and after what an overcast takes away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector to the sun's middle.
    pub towards: Vec3,
    /// Irradiance on a surface that faces it, W/m² per colour.
    pub irradiance: [f32; 3],
    /// Half the angle that the disc covers.
    pub angular_radius: Radians,
}
