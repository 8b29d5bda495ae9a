//! Cameras: where a pixel looks, and where a point lands.
//!
//! Right-handed world, z up; the camera looks along `forward`, `right` points to the right of the picture
//! and `up` to its top. Pixel (0, 0) is the top left corner of the top left pixel, so that pixel (i, j)
//! has its centre at (i + ½, j + ½) and row 0 is the top. Depth is planar: metres along `forward`.
//!
//! A camera comes from a direction ([`Camera::new`]), a target ([`Camera::look_at`]), a renderer's matrices
//! ([`Camera::from_matrices`]) or a calibrated lens ([`Camera::pinhole`]); [`Camera::rolled`] tilts any of them.

mod lens;
mod matrix;
mod pinhole;

pub(crate) use lens::Lens;
pub use pinhole::Intrinsics;

use crate::error::RuntimeError;
use glam::{DVec2, DVec3};
use squall_formats::units::Radians;

/// How rays leave a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// All rays through one point.
    Perspective {
        /// Full angle between the picture's top and bottom edge, in (0, π).
        vertical_fov: Radians,
    },
    /// Parallel rays that start on a plane through the camera's position.
    Orthographic {
        /// Half the picture's width, m.
        half_width: f64,
        /// Half the picture's height, m.
        half_height: f64,
    },
}

/// A camera and the size of its picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Eye point, or the centre of an orthographic camera's plane, m.
    pub position: DVec3,
    /// Unit vector to the right of the picture.
    pub right: DVec3,
    /// Unit vector to the top of the picture.
    pub up: DVec3,
    /// Unit viewing direction.
    pub forward: DVec3,
    /// Perspective or orthographic.
    pub projection: Projection,
    /// Where the axis `forward` meets the picture, from its middle to the right and down, px; 0 for a centred lens.
    pub shift_px: DVec2,
    /// Pixels per angle across over pixels per angle down, fx/fy; 1 for square pixels.
    pub pixel_aspect: f64,
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
}

/// A ray in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Start, m.
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}

/// A point's place in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projected {
    /// Pixel coordinates, fractions included.
    pub pixel: DVec2,
    /// Planar depth along the viewing direction, m.
    pub depth: f64,
}

/// A camera's secants, by pixel; see [`Camera::secants`].
#[derive(Clone, Copy, Debug)]
pub struct Secants {
    half: DVec2,
    step: DVec2,
    shift: DVec2,
}

impl Secants {
    /// Metres along the ray through pixel coordinates (x, y) per metre of planar depth: 1/cos of the ray's
    /// angle to the view, and 1 for an orthographic camera.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        let across = (DVec2::new(x, y) - self.shift) * self.step - self.half;
        (1.0 + across.length_squared()).sqrt()
    }
}

impl Camera {
    /// A camera at `position` that looks along `direction`, upright with respect to `up`.
    ///
    /// ```
    /// use glam::DVec3;
    /// use squall_formats::units::Radians;
    /// use squall_runtime::camera::{Camera, Projection};
    ///
    /// let projection = Projection::Perspective { vertical_fov: Radians(0.8) };
    /// let camera = Camera::new(DVec3::new(0.0, 0.0, 2.0), DVec3::Y, DVec3::Z, projection, [640, 360])?;
    /// // A ray through a pixel, and back from a point on it to the pixel.
    /// let ray = camera.ray(100.5, 200.5);
    /// let found = camera.project(ray.origin + 50.0 * ray.direction).expect("a point in front");
    /// assert!((found.pixel.x - 100.5).abs() < 1e-9 && (found.pixel.y - 200.5).abs() < 1e-9);
    /// # Ok::<(), squall_runtime::RuntimeError>(())
    /// ```
    ///
    /// Errors: a zero or non-finite vector, `up` along the view, an angle outside (0, π), an empty picture.
    pub fn new(
        position: DVec3,
        direction: DVec3,
        up: DVec3,
        projection: Projection,
        size: [u32; 2],
    ) -> Result<Self, RuntimeError> {
        if !position.is_finite() {
            return Err(RuntimeError::argument("camera position", "three finite numbers", position));
        }
        let forward = direction.try_normalize().filter(|v| v.is_finite());
        let forward = forward.ok_or_else(|| {
            RuntimeError::argument("camera direction", "a finite vector that is not zero", direction)
        })?;
        let right = forward.cross(up).try_normalize().filter(|v| v.is_finite());
        let right =
            right.ok_or_else(|| RuntimeError::argument("camera up", "a vector not along the view", up))?;
        check_projection(projection)?;
        check_size(size)?;
        let up = right.cross(forward);
        let [width, height] = size;
        let (shift_px, pixel_aspect) = (DVec2::ZERO, 1.0);
        Ok(Self { position, right, up, forward, projection, shift_px, pixel_aspect, width, height })
    }

    /// A camera at `eye` that looks at `target` with z up, `vertical_fov` from the picture's top to its bottom.
    ///
    /// ```
    /// use squall_runtime::{Camera, glam::DVec3, formats::units::Degrees};
    /// let camera = Camera::look_at(DVec3::ZERO, DVec3::new(0.0, 100.0, 20.0), Degrees(60.0), [640, 360])?;
    /// let middle = camera.project(DVec3::new(0.0, 100.0, 20.0)).unwrap().pixel;
    /// assert!((middle.x - 320.0).abs() < 1e-9 && (middle.y - 180.0).abs() < 1e-9);
    /// # Ok::<(), squall_runtime::RuntimeError>(())
    /// ```
    ///
    /// Errors: as [`Camera::new`]; a target straight above or below the eye, where z is no "up".
    pub fn look_at(
        eye: DVec3,
        target: DVec3,
        vertical_fov: impl Into<Radians>,
        size: [u32; 2],
    ) -> Result<Self, RuntimeError> {
        let projection = Projection::Perspective { vertical_fov: vertical_fov.into() };
        Self::new(eye, target - eye, DVec3::Z, projection, size)
    }

    /// The same camera turned about its own axis: positive angles tip its top to the right, and the world to the left.
    #[must_use]
    pub fn rolled(self, roll: impl Into<Radians>) -> Self {
        let (sin, cos) = libm::sincos(roll.into().0);
        let (right, up) = (self.right * cos - self.up * sin, self.up * cos + self.right * sin);
        Self { right, up, ..self }
    }

    /// The same camera with a picture of another size: the vertical field of view stays, and so does an off-centre axis'
    /// share of the picture.
    ///
    /// Errors: an empty picture, or one of more than 2²⁸ pixels.
    pub fn resized(self, size: [u32; 2]) -> Result<Self, RuntimeError> {
        check_size(size)?;
        let scale = DVec2::new(
            f64::from(size[0]) / f64::from(self.width),
            f64::from(size[1]) / f64::from(self.height),
        );
        Ok(Self { width: size[0], height: size[1], shift_px: self.shift_px * scale, ..self })
    }

    /// Refuses a camera whose public fields were set to what no camera is.
    ///
    /// Errors: numbers that are not finite, axes that are not three perpendicular unit vectors of a right-handed world, a field
    /// of view outside (0°, 180°), an axis farther from the picture than ten of its sizes, an empty picture.
    pub fn check(&self) -> Result<(), RuntimeError> {
        if !self.position.is_finite() {
            return Err(RuntimeError::argument("camera position", "three finite numbers", self.position));
        }
        let [right, up, forward] = [self.right, self.up, self.forward];
        let off = |found: f64, wanted: f64| {
            (found - wanted).abs().partial_cmp(&SKEW).is_none_or(|order| order.is_gt())
        };
        let skewed = off(right.dot(up), 0.0)
            || off(up.length(), 1.0)
            || off(right.length(), 1.0)
            || off(right.cross(forward).dot(up), 1.0);
        if skewed {
            let found = format!("right {right}, up {up}, forward {forward}");
            let wanted = "perpendicular unit vectors, up = right × forward";
            return Err(RuntimeError::argument("camera axes", wanted, found));
        }
        check_projection(self.projection)?;
        check_size([self.width, self.height])?;
        let share = self.shift_px.abs() / DVec2::new(f64::from(self.width), f64::from(self.height));
        if share.max_element().partial_cmp(&FARTHEST_AXIS).is_none_or(|order| order.is_gt()) {
            let wanted = format!("an axis within {FARTHEST_AXIS} pictures of the picture's middle");
            return Err(RuntimeError::argument("camera shift", wanted, format!("{} px", self.shift_px)));
        }
        let [low, high] = PIXEL_ASPECTS;
        if !(low..=high).contains(&self.pixel_aspect) {
            let wanted = format!("{low} to {high}");
            return Err(RuntimeError::argument("camera pixel aspect (fx/fy)", wanted, self.pixel_aspect));
        }
        Ok(())
    }

    /// Width over height of what the picture shows at any depth; of its pixels' counts where pixels are square.
    pub fn aspect(&self) -> f64 {
        f64::from(self.width) / f64::from(self.height) / self.pixel_aspect
    }

    /// Half of what the picture spans across and down: at unit depth for a perspective camera, in metres for an
    /// orthographic one. A shifted axis moves the span and leaves its size.
    pub fn half_extent(&self) -> DVec2 {
        match self.projection {
            Projection::Perspective { vertical_fov } => {
                let tan = libm::tan(0.5 * vertical_fov.0);
                DVec2::new(tan * self.aspect(), tan)
            }
            Projection::Orthographic { half_width, half_height } => DVec2::new(half_width, half_height),
        }
    }

    /// Pixels that one metre covers vertically at unit depth (perspective) or anywhere (orthographic).
    pub fn pixels_per_metre(&self) -> f64 {
        f64::from(self.height) / (2.0 * self.half_extent().y)
    }

    /// The part of a ray that one asks for pixel after pixel, with its trigonometry done.
    pub fn secants(&self) -> Secants {
        let half = match self.projection {
            Projection::Perspective { .. } => self.half_extent(),
            Projection::Orthographic { .. } => DVec2::ZERO,
        };
        let step = half * 2.0 / DVec2::new(f64::from(self.width), f64::from(self.height));
        Secants { half, step, shift: self.shift_px }
    }

    /// Tangents of the angles to the right of and below a perspective camera's axis at pixel coordinates (x, y).
    pub(crate) fn tangents(&self, x: f64, y: f64) -> DVec2 {
        let Secants { half, step, shift } = self.secants();
        (DVec2::new(x, y) - shift) * step - half
    }

    /// [`Camera::ray`] of a perspective camera, for pixel after pixel.
    pub fn ray_with(&self, secants: &Secants, x: f64, y: f64) -> Ray {
        let across = (DVec2::new(x, y) - secants.shift) * secants.step - secants.half;
        let direction = (self.forward + self.right * across.x - self.up * across.y).normalize();
        Ray { origin: self.position, direction }
    }

    /// The ray through pixel coordinates (x, y).
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let half = self.half_extent();
        let (x, y) = (x - self.shift_px.x, y - self.shift_px.y);
        let across = self.right * ((2.0 * x / f64::from(self.width) - 1.0) * half.x)
            + self.up * ((1.0 - 2.0 * y / f64::from(self.height)) * half.y);
        match self.projection {
            Projection::Perspective { .. } => {
                Ray { origin: self.position, direction: (self.forward + across).normalize() }
            }
            Projection::Orthographic { .. } => {
                Ray { origin: self.position + across, direction: self.forward }
            }
        }
    }

    /// Where `point` lands; `None` at or behind a perspective camera's plane.
    pub fn project(&self, point: DVec3) -> Option<Projected> {
        self.project_between(self.half_extent(), point)
    }

    /// The same of a camera whose [`Camera::half_extent`] is `half`.
    fn project_between(&self, half: DVec2, point: DVec3) -> Option<Projected> {
        let offset = point - self.position;
        let depth = offset.dot(self.forward);
        let scale = match self.projection {
            Projection::Perspective { .. } if depth > 0.0 => 1.0 / depth,
            Projection::Perspective { .. } => return None,
            Projection::Orthographic { .. } => 1.0,
        };
        let x = 0.5 * (offset.dot(self.right) * scale / half.x + 1.0) * f64::from(self.width);
        let y = 0.5 * (1.0 - offset.dot(self.up) * scale / half.y) * f64::from(self.height);
        Some(Projected { pixel: DVec2::new(x, y) + self.shift_px, depth })
    }
}

/// How far from perpendicular unit vectors a camera's axes may be: single precision's round-off, a few times over.
const SKEW: f64 = 1e-4;
/// Farthest that the axis may be from the picture's middle, in pictures.
const FARTHEST_AXIS: f64 = 10.0;
/// Narrowest and widest pixels.
const PIXEL_ASPECTS: [f64; 2] = [0.25, 4.0];

fn check_projection(projection: Projection) -> Result<(), RuntimeError> {
    let (field, wanted, found) = match projection {
        Projection::Perspective { vertical_fov } => {
            if vertical_fov.0 > 0.0 && vertical_fov.0 < std::f64::consts::PI {
                return Ok(());
            }
            let found = format!("{}°", vertical_fov.0.to_degrees());
            ("camera vertical fov", "an angle in (0°, 180°)", found)
        }
        Projection::Orthographic { half_width, half_height } => {
            if half_width > 0.0 && half_height > 0.0 && (half_width + half_height).is_finite() {
                return Ok(());
            }
            ("camera half width and height", "positive metres", format!("{half_width} × {half_height}"))
        }
    };
    Err(RuntimeError::argument(field, wanted, found))
}

fn check_size(size: [u32; 2]) -> Result<(), RuntimeError> {
    if size[0] == 0 || size[1] == 0 || u64::from(size[0]) * u64::from(size[1]) > 1 << 28 {
        let found = format!("{} × {}", size[0], size[1]);
        return Err(RuntimeError::argument("picture size", "1 to 2^28 pixels", found));
    }
    Ok(())
}

/// Vertical fov of a picture whose horizontal fov is known; both in (0, π).
pub fn vertical_from_horizontal(horizontal_fov: Radians, aspect: f64) -> Radians {
    Radians(2.0 * libm::atan(libm::tan(0.5 * horizontal_fov.0) / aspect))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Round-off of a few products of numbers near 1000 in double precision, in pixels.
    const ROUND_OFF_PX: f64 = 1e-9;

    fn camera(projection: Projection) -> Camera {
        let position = DVec3::new(10.0, -20.0, 3.0);
        Camera::new(position, DVec3::new(1.0, 2.0, 0.2), DVec3::Z, projection, [640, 480]).unwrap()
    }

    #[test]
    fn a_point_on_a_pixels_ray_projects_to_that_pixel() {
        let perspective = Projection::Perspective { vertical_fov: Radians(1.0) };
        let orthographic = Projection::Orthographic { half_width: 40.0, half_height: 30.0 };
        for camera in [camera(perspective), camera(orthographic)] {
            for (x, y) in [(0.5, 0.5), (320.0, 240.0), (639.0, 17.25)] {
                let ray = camera.ray(x, y);
                let landed = camera.project(ray.origin + ray.direction * 123.0).unwrap();
                assert!((landed.pixel - DVec2::new(x, y)).length() < ROUND_OFF_PX);
            }
        }
    }

    #[test]
    fn a_secant_is_range_over_depth() {
        let perspective = camera(Projection::Perspective { vertical_fov: Radians(1.0) });
        let ray = perspective.ray(17.0, 400.0);
        let secant = perspective.secants().at(17.0, 400.0);
        assert!((secant * ray.direction.dot(perspective.forward) - 1.0).abs() < 1e-14);
        let again = perspective.ray_with(&perspective.secants(), 17.0, 400.0);
        assert!((again.direction - ray.direction).length() < 1e-15);
        let parallel = camera(Projection::Orthographic { half_width: 40.0, half_height: 30.0 });
        assert_eq!(parallel.secants().at(17.0, 400.0), 1.0);
    }

    #[test]
    fn row_zero_is_the_top_and_a_point_behind_has_no_place() {
        let camera = camera(Projection::Perspective { vertical_fov: Radians(1.0) });
        let above = camera.position + camera.forward * 10.0 + camera.up;
        assert!(camera.project(above).unwrap().pixel.y < 240.0);
        assert!(camera.project(camera.position - camera.forward).is_none());
    }

    #[test]
    fn a_degenerate_camera_is_refused() {
        let fov = |degrees: f64| Projection::Perspective { vertical_fov: Radians(degrees.to_radians()) };
        let make =
            |direction, up, projection, size| Camera::new(DVec3::ZERO, direction, up, projection, size);
        assert!(make(DVec3::ZERO, DVec3::Z, fov(60.0), [4, 4]).is_err());
        assert!(make(DVec3::Z, DVec3::Z, fov(60.0), [4, 4]).is_err());
        assert!(make(DVec3::X, DVec3::Z, fov(0.0), [4, 4]).is_err());
        assert!(make(DVec3::X, DVec3::Z, fov(180.0), [4, 4]).is_err());
        assert!(make(DVec3::X, DVec3::Z, fov(f64::NAN), [4, 4]).is_err());
        assert!(make(DVec3::X, DVec3::Z, fov(60.0), [0, 4]).is_err());
    }
}
