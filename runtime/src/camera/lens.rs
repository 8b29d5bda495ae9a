//! A camera whose opening is worked out once, for loops over pixels: the tangent of its angle costs more than the rest of a ray.

use super::{Camera, Projected, Projection, Ray, Secants};
use glam::{DVec2, DVec3};

/// A camera and what all of its rays share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lens<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// [`Camera::secants`].
    pub secants: Secants,
    /// [`Camera::pixels_per_metre`].
    pub pixels_per_metre: f64,
    half: DVec2,
}

impl<'a> Lens<'a> {
    /// What `camera`'s rays share.
    pub fn new(camera: &'a Camera) -> Self {
        let (secants, pixels_per_metre) = (camera.secants(), camera.pixels_per_metre());
        Self { camera, secants, pixels_per_metre, half: camera.half_extent() }
    }

    /// [`Camera::ray`].
    #[inline]
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        match self.camera.projection {
            Projection::Perspective { .. } => self.camera.ray_with(&self.secants, x, y),
            Projection::Orthographic { .. } => self.camera.ray(x, y),
        }
    }

    /// [`Camera::project`].
    #[inline]
    pub fn project(&self, point: DVec3) -> Option<Projected> {
        self.camera.project_between(self.half, point)
    }

    /// Most that the directions of a pixel's two farthest corners differ by; 0 of an orthographic camera.
    pub fn pixel_diagonal(&self) -> f64 {
        self.secants.step.length()
    }
}
