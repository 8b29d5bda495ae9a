//! Cameras by a calibrated lens's numbers.

use super::{Camera, Projection};
use crate::error::RuntimeError;
use glam::{DVec2, DVec3};
use squall_formats::units::Radians;

/// A pinhole lens as calibration programs write it down, without distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Focal length across, px.
    pub fx: f64,
    /// Focal length down, px.
    pub fy: f64,
    /// Column in which the optical axis meets the picture, px; 0 is the left edge of the leftmost pixel. Programs that put 0 in
    /// that pixel's middle (OpenCV) give a number smaller by ½.
    pub cx: f64,
    /// Row in which it does, from the top, px; with the same edge.
    pub cy: f64,
}

impl Camera {
    /// A camera with a calibrated lens, at `position`, that looks along `direction` with `up` at the picture's top.
    ///
    /// ```
    /// use squall_runtime::{Camera, camera::Intrinsics, glam::DVec3};
    /// let lens = Intrinsics { fx: 615.1, fy: 615.3, cx: 321.3, cy: 238.9 };
    /// let camera = Camera::pinhole(DVec3::ZERO, DVec3::Y, DVec3::Z, lens, [640, 480])?;
    /// let ahead = camera.project(DVec3::new(0.0, 5.0, 0.0)).unwrap();
    /// assert!((ahead.pixel.x - 321.3).abs() < 1e-9 && (ahead.pixel.y - 238.9).abs() < 1e-9);
    /// # Ok::<(), squall_runtime::RuntimeError>(())
    /// ```
    ///
    /// Errors: as [`Camera::new`]; focal lengths that are not positive or differ by more than a factor of 4, an axis farther
    /// from the picture than ten of its sizes.
    pub fn pinhole(
        position: DVec3,
        direction: DVec3,
        up: DVec3,
        lens: Intrinsics,
        size: [u32; 2],
    ) -> Result<Self, RuntimeError> {
        let Intrinsics { fx, fy, cx, cy } = lens;
        if !(fx > 0.0 && fy > 0.0 && fx.is_finite() && fy.is_finite()) {
            let found = format!("fx {fx}, fy {fy}");
            return Err(RuntimeError::argument("camera focal lengths", "positive pixels", found));
        }
        let [width, height] = size.map(f64::from);
        let vertical_fov = Radians(2.0 * libm::atan(0.5 * height / fy));
        let projection = Projection::Perspective { vertical_fov };
        let camera = Self::new(position, direction, up, projection, size)?;
        let shift_px = DVec2::new(cx - 0.5 * width, cy - 0.5 * height);
        let camera = Self { shift_px, pixel_aspect: fx / fy, ..camera };
        camera.check()?;
        Ok(camera)
    }

    /// The lens's numbers; `None` for an orthographic camera.
    pub fn intrinsics(&self) -> Option<Intrinsics> {
        let Projection::Perspective { .. } = self.projection else { return None };
        let fy = self.pixels_per_metre();
        let middle = 0.5 * DVec2::new(f64::from(self.width), f64::from(self.height)) + self.shift_px;
        Some(Intrinsics { fx: fy * self.pixel_aspect, fy, cx: middle.x, cy: middle.y })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: Intrinsics = Intrinsics { fx: 500.0, fy: 520.0, cx: 300.0, cy: 260.0 };
    /// Round-off of an arc tangent and a tangent, in pixels.
    const ROUND_OFF_PX: f64 = 1e-9;

    fn camera() -> Camera {
        Camera::pinhole(DVec3::new(1.0, 2.0, 3.0), DVec3::X, DVec3::Z, LENS, [640, 480]).unwrap()
    }

    #[test]
    fn a_pinhole_projects_as_its_numbers_say() {
        let camera = camera();
        // 2 m ahead, .3 m to the right (−y), .1 m up.
        let place = camera.project(DVec3::new(3.0, 1.7, 3.1)).unwrap();
        let wanted = DVec2::new(300.0 + 500.0 * 0.15, 260.0 - 520.0 * 0.05);
        assert!((place.pixel - wanted).length() < ROUND_OFF_PX, "{place:?}");
    }

    #[test]
    fn rays_of_a_shifted_lens_land_where_they_left() {
        let camera = camera();
        for (x, y) in [(0.5, 0.5), (600.0, 100.0), (300.0, 260.0)] {
            for ray in [camera.ray(x, y), camera.ray_with(&camera.secants(), x, y)] {
                let landed = camera.project(ray.origin + ray.direction * 40.0).unwrap();
                assert!((landed.pixel - DVec2::new(x, y)).length() < ROUND_OFF_PX);
                let secant = camera.secants().at(x, y);
                assert!((secant * ray.direction.dot(camera.forward) - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn intrinsics_come_back_and_impossible_ones_are_refused() {
        let found = camera().intrinsics().unwrap();
        for (a, b) in [(found.fx, 500.0), (found.fy, 520.0), (found.cx, 300.0), (found.cy, 260.0)] {
            assert!((a - b).abs() < ROUND_OFF_PX);
        }
        let make = |lens| Camera::pinhole(DVec3::ZERO, DVec3::X, DVec3::Z, lens, [640, 480]);
        for lens in [
            Intrinsics { fx: 0.0, ..LENS },
            Intrinsics { fy: f64::NAN, ..LENS },
            Intrinsics { fx: 5000.0, ..LENS },
            Intrinsics { cx: f64::INFINITY, ..LENS },
            Intrinsics { cy: 1e5, ..LENS },
        ] {
            assert!(make(lens).is_err(), "{lens:?}");
        }
    }
}
