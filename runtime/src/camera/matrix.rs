//! Cameras from a renderer's matrices, and back.

use super::{Camera, Projection, SKEW};
use crate::error::RuntimeError;
use glam::{DMat3, DMat4, DVec2, DVec4};
use squall_formats::units::Radians;

impl Camera {
    /// A camera from a right-handed view matrix (world to camera: x right, y up, looking along −z, as glam's `rh::view::look_at_mat4` makes
    /// it) and a projection. Depth conventions do not matter: 0 to 1, −1 to 1, reversed and endless far planes are the same
    /// camera; off-centre projections, pixels that are not square, orthographic projections and y turned down (Vulkan) are read
    /// too. The world is Squall's, z up, in metres: a world with y up has `view * DMat4::from_rotation_x(-FRAC_PI_2)`.
    ///
    /// ```
    /// use squall_runtime::{Camera, glam::{DVec3, dcamera::rh}};
    /// let view = rh::view::look_at_mat4(DVec3::new(0.0, -50.0, 2.0), DVec3::new(0.0, 0.0, 30.0), DVec3::Z);
    /// let lens = rh::proj::directx::perspective_infinite_reverse(1.0, 16.0 / 9.0, 0.1);
    /// let camera = Camera::from_matrices(view, lens, [1280, 720])?;
    /// assert!((camera.position - DVec3::new(0.0, -50.0, 2.0)).length() < 1e-9);
    /// # Ok::<(), squall_runtime::RuntimeError>(())
    /// ```
    ///
    /// Errors: a view that scales, shears or mirrors; a left-handed or degenerate projection; as [`Camera::check`].
    pub fn from_matrices(view: DMat4, projection: DMat4, size: [u32; 2]) -> Result<Self, RuntimeError> {
        let turn = rotation_of(view)?;
        let axis = |row: usize| turn.row(row).normalize();
        let forward = -axis(2);
        // Single precision leaves axes a little skewed: what is passed on is exactly perpendicular.
        let right = forward.cross(axis(1)).normalize();
        let up = right.cross(forward);
        let position = -(turn.transpose() * view.w_axis.truncate());
        let lens = Lens::of(projection)?;
        let [width, height] = size.map(f64::from);
        let pixels = lens.scale * 0.5 * DVec2::new(width, height);
        let shift_px = lens.shift * 0.5 * DVec2::new(width, height);
        let projection = match lens.parallel {
            true => {
                Projection::Orthographic { half_width: 1.0 / lens.scale.x, half_height: 1.0 / lens.scale.y }
            }
            false => Projection::Perspective { vertical_fov: Radians(2.0 * libm::atan(1.0 / lens.scale.y)) },
        };
        // An orthographic camera's half width and height say all of its pixels' shape.
        let pixel_aspect = if lens.parallel { 1.0 } else { pixels.x / pixels.y };
        let [width, height] = size;
        let camera = Self { position, right, up, forward, projection, shift_px, pixel_aspect, width, height };
        camera.check()?;
        Ok(camera)
    }

    /// World to camera, as glam's `rh::view::look_at_mat4` makes it: x right, y up, looking along −z.
    #[must_use]
    pub fn view_matrix(&self) -> DMat4 {
        let rows = DMat3::from_cols(self.right, self.up, -self.forward).transpose();
        let moved = -(rows * self.position);
        DMat4::from_cols(
            rows.x_axis.extend(0.0),
            rows.y_axis.extend(0.0),
            rows.z_axis.extend(0.0),
            moved.extend(1.0),
        )
    }

    /// Camera to clip space: depth 1 at `near` metres falling to 0 without end (reversed) for a perspective camera, 0 at the
    /// camera's plane to 1 at `near` for an orthographic one.
    #[must_use]
    pub fn projection_matrix(&self, near: f64) -> DMat4 {
        let half = self.half_extent();
        let shift = self.shift_px * 2.0 / DVec2::new(f64::from(self.width), f64::from(self.height));
        let columns = match self.projection {
            Projection::Perspective { .. } => [
                DVec4::new(1.0 / half.x, 0.0, 0.0, 0.0),
                DVec4::new(0.0, 1.0 / half.y, 0.0, 0.0),
                DVec4::new(-shift.x, shift.y, 0.0, -1.0),
                DVec4::new(0.0, 0.0, near, 0.0),
            ],
            Projection::Orthographic { .. } => [
                DVec4::new(1.0 / half.x, 0.0, 0.0, 0.0),
                DVec4::new(0.0, 1.0 / half.y, 0.0, 0.0),
                DVec4::new(0.0, 0.0, -1.0 / near, 0.0),
                DVec4::new(shift.x, -shift.y, 0.0, 1.0),
            ],
        };
        DMat4::from_cols(columns[0], columns[1], columns[2], columns[3])
    }
}

/// The turning part of a view matrix. Errors: it is not rigid.
fn rotation_of(view: DMat4) -> Result<DMat3, RuntimeError> {
    let turn = DMat3::from_mat4(view);
    let refused = |found: String| {
        let wanted = "a rigid transform from world to camera (a rotation and a translation), right-handed";
        Err(RuntimeError::argument("camera view matrix", wanted, found))
    };
    if !view.is_finite() {
        return refused("numbers that are not finite".into());
    }
    if (view.row(3) - DVec4::W).length() > SKEW {
        return refused(format!("the last row {}", view.row(3)));
    }
    let off = turn * turn.transpose() - DMat3::IDENTITY;
    let most = off.to_cols_array().into_iter().fold(0.0, |most: f64, value| most.max(value.abs()));
    if most > SKEW {
        return refused(format!(
            "axes of lengths {}, {}, {}",
            turn.row(0).length(),
            turn.row(1).length(),
            turn.row(2).length()
        ));
    }
    if turn.determinant() < 0.0 {
        return refused("a mirroring one".into());
    }
    Ok(turn)
}

/// What of a projection matters to a picture.
struct Lens {
    /// Clip coordinates per tangent (or metre) across and up.
    scale: DVec2,
    /// Where the axis lands, in half pictures right and down of the middle.
    shift: DVec2,
    parallel: bool,
}

impl Lens {
    fn of(projection: DMat4) -> Result<Self, RuntimeError> {
        let refused = |wanted: &str, found: String| {
            Err(RuntimeError::argument("camera projection matrix", wanted, found))
        };
        let [x, y, w] = [projection.row(0), projection.row(1), projection.row(3)];
        if ![x, y, w].iter().all(|row| row.is_finite()) {
            return refused("finite numbers", "others".into());
        }
        let parallel = (w - DVec4::W).length() < SKEW;
        // Dividing by clip w > 0 in front of the camera: a scaled matrix is the same projection.
        let (grown, offset) = if parallel { (1.0, [x.w, y.w]) } else { (-w.z, [x.z, y.z]) };
        if !parallel && (w.x != 0.0 || w.y != 0.0 || w.w != 0.0 || grown <= 0.0) {
            let wanted = "a right-handed projection, w = −z (last row 0 0 −1 0), or a parallel one (0 0 0 1)";
            return refused(wanted, format!("the last row {w}"));
        }
        let skewed = x.y != 0.0 || y.x != 0.0;
        // Vulkan's clip space has y down; row 0 of the picture is its top either way.
        let (flip, scale) = (y.y.signum(), DVec2::new(x.x, y.y.abs()) / grown);
        if skewed || !(scale.x > 0.0 && scale.y > 0.0) {
            let wanted = "positive scales across and up, and no shear";
            return refused(wanted, format!("rows {x} and {y}"));
        }
        let at = DVec2::new(offset[0], offset[1] * flip) / grown;
        let shift = if parallel { DVec2::new(at.x, -at.y) } else { DVec2::new(-at.x, at.y) };
        Ok(Self { scale, shift, parallel })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Intrinsics;
    use glam::DVec3;
    use glam::dcamera::rh::proj::{directx, opengl};
    use glam::dcamera::rh::view::look_at_mat4;

    const SIZE: [u32; 2] = [640, 360];
    /// Round-off of a matrix product and a division at distances of a kilometre, px.
    const ROUND_OFF_PX: f64 = 1e-6;

    fn view() -> DMat4 {
        look_at_mat4(DVec3::new(30.0, -50.0, 2.0), DVec3::new(400.0, 900.0, 300.0), DVec3::Z)
    }

    fn pixel(matrix: DMat4, point: DVec3) -> DVec2 {
        let place = matrix.project_point3(point);
        DVec2::new(0.5 * (place.x + 1.0) * 640.0, 0.5 * (1.0 - place.y) * 360.0)
    }

    fn points() -> [DVec3; 3] {
        [DVec3::new(400.0, 900.0, 300.0), DVec3::new(350.0, 1000.0, 100.0), DVec3::new(100.0, 300.0, 150.0)]
    }

    #[test]
    fn a_point_lands_where_the_matrices_put_it() {
        let aspect = 16.0 / 9.0;
        let lenses = [
            directx::perspective(1.0, aspect, 0.1, 1e4),
            opengl::perspective(1.0, aspect, 0.1, 1e4),
            directx::perspective_infinite_reverse(1.0, aspect, 0.1),
            directx::frustum(-0.3, 0.5, -0.1, 0.3, 0.4, 1e4),
            directx::orthographic(-300.0, 500.0, -100.0, 350.0, 0.1, 1e4),
        ];
        for lens in lenses {
            let camera = Camera::from_matrices(view(), lens, SIZE).unwrap();
            for point in points() {
                let found = camera.project(point).unwrap().pixel;
                assert!((found - pixel(lens * view(), point)).length() < ROUND_OFF_PX, "{lens:?}");
            }
        }
        // Vulkan's y down: the same picture.
        let mut down = directx::frustum(-0.3, 0.5, -0.1, 0.3, 0.4, 1e4);
        let up = Camera::from_matrices(view(), down, SIZE).unwrap();
        down.y_axis.y = -down.y_axis.y;
        down.z_axis.y = -down.z_axis.y;
        assert_eq!(Camera::from_matrices(view(), down, SIZE).unwrap(), up);
    }

    #[test]
    fn matrices_there_and_back_are_the_same_camera_rolled_and_shifted() {
        let lens = Intrinsics { fx: 500.0, fy: 520.0, cx: 300.0, cy: 260.0 };
        let camera =
            Camera::pinhole(DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 2.0, 0.3), DVec3::Z, lens, SIZE)
                .unwrap()
                .rolled(Radians(0.4));
        let flat = Projection::Orthographic { half_width: 40.0, half_height: 30.0 };
        let flat = Camera::new(DVec3::ONE, DVec3::X, DVec3::Z, flat, SIZE).unwrap();
        let flat = Camera { shift_px: DVec2::new(3.0, -4.0), ..flat };
        for camera in [camera, flat] {
            let back =
                Camera::from_matrices(camera.view_matrix(), camera.projection_matrix(0.1), SIZE).unwrap();
            assert!((back.position - camera.position).length() < 1e-12);
            for (x, y) in [(0.5, 0.5), (600.0, 100.0)] {
                let (a, b) = (camera.ray(x, y), back.ray(x, y));
                assert!((a.direction - b.direction).length() < 1e-12);
                assert!((a.origin - b.origin).length() < 1e-10);
            }
        }
    }

    #[test]
    fn single_precision_matrices_of_an_engine_are_accepted() {
        let view = view().as_mat4().as_dmat4();
        let lens = glam::camera::rh::proj::directx::perspective_infinite_reverse(1.0, 1.7777, 0.1).as_dmat4();
        assert!(Camera::from_matrices(view, lens, SIZE).unwrap().check().is_ok());
    }

    #[test]
    fn what_is_no_rigid_view_or_no_lens_is_refused() {
        let lens = directx::perspective(1.0, 1.5, 0.1, 100.0);
        let refused = |view: DMat4, lens: DMat4, words: &str| {
            let text = Camera::from_matrices(view, lens, SIZE).unwrap_err().to_string();
            assert!(text.contains(words), "{text}");
        };
        refused(view() * DMat4::from_scale(DVec3::splat(2.0)), lens, "rigid");
        refused(DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)) * view(), lens, "mirror");
        refused(DMat4::ZERO, lens, "rigid");
        refused(DMat4::NAN, lens, "finite");
        refused(view(), glam::dcamera::lh::proj::directx::perspective(1.0, 1.5, 0.1, 100.0), "right-handed");
        refused(view(), DMat4::ZERO, "projection");
        refused(view(), DMat4::from_diagonal(DVec4::new(0.0, 1.0, 1.0, 1.0)), "scales");
    }

    #[test]
    fn a_roll_of_a_quarter_turn_puts_the_right_side_at_the_bottom() {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::Y, Radians(1.0), SIZE).unwrap();
        let rolled = camera.rolled(Radians(std::f64::consts::FRAC_PI_2));
        assert!((rolled.up - DVec3::X).length() < 1e-12 && (rolled.right + DVec3::Z).length() < 1e-12);
        assert!(rolled.check().is_ok());
    }
}
