//! A camera in single precision, about its own place: projection for what effects draw by the ten thousand.

use crate::camera::{Camera, Projection};
use glam::{DVec3, Vec2, Vec3};

/// A camera, its numbers ready.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eye {
    pub position: DVec3,
    pub right: Vec3,
    pub up: Vec3,
    pub forward: Vec3,
    perspective: bool,
    /// Pixels a unit of tangent (or a metre, orthographic) across and down.
    pub scale: Vec2,
    /// Where the axis meets the picture, px.
    centre: Vec2,
    pub size: [usize; 2],
}

/// Where something lies in the picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    pub x: f32,
    pub y: f32,
    pub depth: f32,
}

/// Nothing nearer than this is drawn, m: a lens has its own width.
pub(crate) const NEAREST: f32 = 0.05;

impl Eye {
    pub fn new(camera: &Camera) -> Self {
        let size = [f64::from(camera.width), f64::from(camera.height)];
        let half = camera.half_extent();
        let scale = [0.5 * size[0] / half.x, 0.5 * size[1] / half.y];
        let centre = [0.5 * size[0] + camera.shift_px.x, 0.5 * size[1] + camera.shift_px.y];
        Self {
            position: camera.position,
            right: camera.right.as_vec3(),
            up: camera.up.as_vec3(),
            forward: camera.forward.as_vec3(),
            perspective: matches!(camera.projection, Projection::Perspective { .. }),
            scale: Vec2::new(scale[0] as f32, scale[1] as f32),
            centre: Vec2::new(centre[0] as f32, centre[1] as f32),
            size: [camera.width as usize, camera.height as usize],
        }
    }

    /// Whether rays meet in the eye.
    #[cfg(feature = "gpu")]
    pub fn is_perspective(&self) -> bool {
        self.perspective
    }

    /// Where the axis meets the picture, px.
    #[cfg(feature = "gpu")]
    pub fn centre(&self) -> Vec2 {
        self.centre
    }

    /// A place as seen from the camera's own.
    pub fn offset(&self, place: DVec3) -> Vec3 {
        (place - self.position).as_vec3()
    }

    /// Where an offset lands; `None` nearer than a hand before the lens, or behind it.
    pub fn see(&self, offset: Vec3) -> Option<Spot> {
        let depth = offset.dot(self.forward);
        if depth.is_nan() || depth <= NEAREST {
            return None;
        }
        let near = if self.perspective { 1.0 / depth } else { 1.0 };
        let x = self.centre.x + self.scale.x * near * offset.dot(self.right);
        let y = self.centre.y - self.scale.y * near * offset.dot(self.up);
        Some(Spot { x, y, depth })
    }

    /// Pixels that a metre covers at a depth.
    pub fn pixels_per_metre(&self, depth: f32) -> f32 {
        if self.perspective { self.scale.y / depth } else { self.scale.y }
    }

    /// The offset of what is seen at pixel coordinates at a depth.
    pub fn at(&self, x: f32, y: f32, depth: f32) -> Vec3 {
        let across = (x - self.centre.x) / self.scale.x;
        let down = (y - self.centre.y) / self.scale.y;
        let side = self.right * across - self.up * down;
        if self.perspective { (self.forward + side) * depth } else { self.forward * depth + side }
    }

    /// Unit direction in which pixel coordinates look.
    pub fn direction(&self, x: f32, y: f32) -> Vec3 {
        if self.perspective { self.at(x, y, 1.0).normalize() } else { self.forward }
    }

    /// Unit direction in which an offset is seen.
    pub fn towards(&self, offset: Vec3) -> Vec3 {
        if self.perspective { offset.normalize_or(self.forward) } else { self.forward }
    }

    /// Pixel coordinates towards which a direction leads at infinity; `None` beside and behind.
    pub fn far(&self, direction: Vec3) -> Option<Vec2> {
        let along = direction.dot(self.forward);
        if !self.perspective || along < 1e-3 {
            return None;
        }
        let x = self.centre.x + self.scale.x * direction.dot(self.right) / along;
        let y = self.centre.y - self.scale.y * direction.dot(self.up) / along;
        Some(Vec2::new(x, y))
    }

    /// Depth beyond which what is so wide, m, is narrower than so many pixels.
    pub fn farthest(&self, width_m: f32, least_px: f32) -> f32 {
        let wide = width_m * self.scale.y / least_px;
        if self.perspective {
            wide
        } else if wide > 1.0 {
            f32::INFINITY
        } else {
            0.0
        }
    }

    /// Length of the ray through the picture's farthest corner up to depth 1; without end where rays are parallel.
    pub fn longest(&self) -> f32 {
        if !self.perspective {
            return f32::INFINITY;
        }
        let [w, h] = self.size.map(|n| n as f32);
        [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]]
            .map(|[x, y]| self.at(x, y, 1.0).length())
            .into_iter()
            .fold(0.0, f32::max)
    }

    /// Whether a box is surely outside what is seen up to a depth: all of it on the outer side of one of its limits.
    pub fn misses(&self, low: DVec3, high: DVec3, far: f32) -> bool {
        let mut outside = [true; 6];
        let [w, h] = self.size.map(|n| n as f32);
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
            let offset = self.offset(DVec3::new(pick(0), pick(1), pick(2)));
            let depth = offset.dot(self.forward);
            let over = if self.perspective { depth } else { 1.0 };
            let x = self.centre.x * over + self.scale.x * offset.dot(self.right);
            let y = self.centre.y * over - self.scale.y * offset.dot(self.up);
            let tests = [x < 0.0, x > w * over, y < 0.0, y > h * over, depth <= NEAREST, depth > far];
            for (all, here) in outside.iter_mut().zip(tests) {
                *all &= here;
            }
        }
        outside.contains(&true)
    }

    /// The pixel of a spot, or `None` outside the picture.
    pub fn pixel(&self, spot: &Spot) -> Option<usize> {
        let inside =
            spot.x >= 0.0 && spot.y >= 0.0 && spot.x < self.size[0] as f32 && spot.y < self.size[1] as f32;
        inside.then(|| spot.y as usize * self.size[0] + spot.x as usize)
    }

    /// Rows and columns that a box about a spot covers.
    pub fn cover(&self, spot: &Spot, reach: f32) -> [std::ops::Range<usize>; 2] {
        let span = |middle: f32, most: usize| {
            let low = (middle - reach).max(0.0) as usize;
            let high = (middle + reach + 1.0).clamp(0.0, most as f32) as usize;
            low..high.max(low)
        };
        [span(spot.y, self.size[1]), span(spot.x, self.size[0])]
    }
}
