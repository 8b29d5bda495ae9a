//! Cameras: where a pixel looks, and where a point lands.
//!
//! Right-handed world, z up; the camera looks along `forward`, `right` points to the right of the picture
//! and `up` to its top. Pixel (0, 0) is the top left corner of the top left pixel, so that pixel (i, j)
//! has its centre at (i + ½, j + ½) and row 0 is the top. Depth is planar: metres along `forward`.

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
}

impl Secants {
    /// Metres along the ray through pixel coordinates (x, y) per metre of planar depth: 1/cos of the ray's
    /// angle to the view, and 1 for an orthographic camera.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        let across = DVec2::new(x, y) * self.step - self.half;
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
        match projection {
            Projection::Perspective { vertical_fov } => {
                if !(vertical_fov.0 > 0.0 && vertical_fov.0 < std::f64::consts::PI) {
                    let found = format!("{}°", vertical_fov.0.to_degrees());
                    return Err(RuntimeError::argument(
                        "camera vertical fov",
                        "an angle in (0°, 180°)",
                        found,
                    ));
                }
            }
            Projection::Orthographic { half_width, half_height } => {
                if !(half_width > 0.0 && half_height > 0.0 && (half_width + half_height).is_finite()) {
                    let found = format!("{half_width} × {half_height}");
                    return Err(RuntimeError::argument(
                        "camera half width and height",
                        "positive metres",
                        found,
                    ));
                }
            }
        }
        if size[0] == 0 || size[1] == 0 || u64::from(size[0]) * u64::from(size[1]) > 1 << 28 {
            let found = format!("{} × {}", size[0], size[1]);
            return Err(RuntimeError::argument("picture size", "1 to 2^28 pixels", found));
        }
        let up = right.cross(forward);
        Ok(Self { position, right, up, forward, projection, width: size[0], height: size[1] })
    }

    /// Picture width over height.
    pub fn aspect(&self) -> f64 {
        f64::from(self.width) / f64::from(self.height)
    }

    /// Half the picture's width and height: at unit depth for a perspective camera, in metres for an
    /// orthographic one.
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
        Secants { half, step }
    }

    /// [`Camera::ray`] of a perspective camera, for pixel after pixel.
    pub fn ray_with(&self, secants: &Secants, x: f64, y: f64) -> Ray {
        let across = DVec2::new(x, y) * secants.step - secants.half;
        let direction = (self.forward + self.right * across.x - self.up * across.y).normalize();
        Ray { origin: self.position, direction }
    }

    /// The ray through pixel coordinates (x, y).
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let half = self.half_extent();
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
        let offset = point - self.position;
        let depth = offset.dot(self.forward);
        let scale = match self.projection {
            Projection::Perspective { .. } if depth > 0.0 => 1.0 / depth,
            Projection::Perspective { .. } => return None,
            Projection::Orthographic { .. } => 1.0,
        };
        let half = self.half_extent();
        let x = 0.5 * (offset.dot(self.right) * scale / half.x + 1.0) * f64::from(self.width);
        let y = 0.5 * (1.0 - offset.dot(self.up) * scale / half.y) * f64::from(self.height);
        Some(Projected { pixel: DVec2::new(x, y), depth })
    }
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
