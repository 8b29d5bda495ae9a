//! A camera in single precision: places before it, in its own axes (x right, y up, z ahead), and pixels.

use crate::camera::{Camera, Projection};
use glam::{DVec3, Mat3, Vec2, Vec3};

/// A camera ready for many pixels.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Columns: right, up, forward.
    axes: Mat3,
    /// Pixels of a unit of tangent, or of a metre where it is orthographic.
    focal: Vec2,
    /// The axis's pixel.
    middle: Vec2,
    parallel: bool,
    /// Columns and rows.
    pub size: [usize; 2],
    /// The eye, m.
    pub eye: DVec3,
}

impl View {
    /// Of a camera.
    pub fn new(camera: &Camera) -> Self {
        let half = camera.half_extent().as_vec2();
        let size = Vec2::new(camera.width as f32, camera.height as f32);
        Self {
            axes: Mat3::from_cols(camera.right.as_vec3(), camera.up.as_vec3(), camera.forward.as_vec3()),
            focal: size / (2.0 * half),
            middle: 0.5 * size + camera.shift_px.as_vec2(),
            parallel: matches!(camera.projection, Projection::Orthographic { .. }),
            size: [camera.width as usize, camera.height as usize],
            eye: camera.position,
        }
    }

    /// Pixels of a radian at the picture's middle.
    pub fn focal(&self) -> Vec2 {
        self.focal
    }

    /// The axis's place in the picture, px.
    #[cfg(feature = "gpu")]
    pub fn middle(&self) -> Vec2 {
        self.middle
    }

    /// Place of depth `z`, m, in the middle of a pixel, from the eye, in the camera's axes.
    #[inline]
    pub fn place(&self, x: usize, y: usize, z: f32) -> Vec3 {
        let across = (Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - self.middle) / self.focal;
        let scale = if self.parallel { 1.0 } else { z };
        Vec3::new(across.x * scale, -across.y * scale, z)
    }

    /// Place of depth 1 m at pixel coordinates, from the eye, in the camera's axes.
    #[inline]
    pub fn ray(&self, at: [f32; 2]) -> Vec3 {
        let across = (Vec2::from(at) - self.middle) / self.focal;
        Vec3::new(across.x, -across.y, 1.0)
    }

    /// Unit vector from a place to the eye.
    #[inline]
    pub fn to_eye(&self, place: Vec3) -> Vec3 {
        if self.parallel { Vec3::NEG_Z } else { -place.normalize_or(Vec3::Z) }
    }

    /// Pixel of a place of depth above 0.
    #[inline]
    pub fn pixel(&self, place: Vec3) -> Vec2 {
        let across = Vec2::new(place.x, -place.y);
        self.middle + self.focal * if self.parallel { across } else { across / place.z }
    }

    /// A direction of the camera's axes in the world's.
    #[inline]
    pub fn to_world(&self, direction: Vec3) -> Vec3 {
        self.axes * direction
    }

    /// A direction of the world in the camera's axes.
    #[inline]
    pub fn from_world(&self, direction: Vec3) -> Vec3 {
        self.axes.transpose() * direction
    }

    /// Whether rays are parallel.
    pub fn is_parallel(&self) -> bool {
        self.parallel
    }

    /// Width of a pixel at a depth, m.
    #[inline]
    pub fn pixel_m(&self, z: f32) -> f32 {
        if self.parallel { 1.0 / self.focal.y } else { z / self.focal.y }
    }
}
