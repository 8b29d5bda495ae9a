//! Drops of one size in a camera's picture: between which distances their streaks have a given length, and
//! how much air the frustum holds there.
//!
//! | symbol | name                           | unit |
//! | L      | `length`, before projection    | m    |
//! | l      | `min_px`, `max_px`, projected  | px   |
//! | h      | `height_px`                    | px   |
//! | z      | planar depth along the view    | m    |
//!
//! z(l) = L h / (2 l tan(fov/2)), \[weber\] eq. 2 with fov vertical. Since z falls as l grows, streaks of
//! l_min … l_max pixels stand between z(l_max) and z(l_min), and the volume of contiguous windows
//! telescopes: it depends on the end points alone.

use crate::units::{Metres, Radians, Seconds};

/// Everything about a camera that a count of streaks depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Full angle between top and bottom edge, in (0, π).
    pub vertical_fov: Radians,
    /// Picture height h, px.
    pub height_px: f64,
    /// Picture width over height.
    pub aspect: f64,
    /// Time that the shutter is open.
    pub exposure: Seconds,
    /// Shortest streak that is drawn, px.
    pub min_px: f64,
    /// Longest streak that is drawn, px.
    pub max_px: f64,
}

/// An argument of a [`View`] outside its range.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewError {
    /// Which field.
    pub field: &'static str,
    /// What it may be.
    pub wanted: &'static str,
    /// What it is.
    pub found: String,
}

impl View {
    /// Checks every field: an angle in (0, π), finite positive sizes and times, `min_px` < `max_px`.
    pub fn check(&self) -> Result<(), ViewError> {
        let error = |field, wanted, found: f64| Err(ViewError { field, wanted, found: found.to_string() });
        let positive = |value: f64| value > 0.0 && value.is_finite();
        if !(self.vertical_fov.0 > 0.0 && self.vertical_fov.0 < std::f64::consts::PI) {
            return error("fov", "an angle in (0, 180) degrees", self.vertical_fov.0.to_degrees());
        }
        for (field, wanted, value) in [
            ("height", "a positive number of pixels", self.height_px),
            ("aspect", "a positive width over height", self.aspect),
            ("min-px", "a positive length in pixels", self.min_px),
            ("max-px", "a positive length in pixels", self.max_px),
        ] {
            if !positive(value) {
                return error(field, wanted, value);
            }
        }
        if !positive(self.exposure.0) {
            return error("exposure-ms", "a positive time in milliseconds", self.exposure.0 * 1e3);
        }
        if self.min_px >= self.max_px {
            let found = format!("{} to {}", self.min_px, self.max_px);
            return Err(ViewError { field: "min-px", wanted: "a length below max-px", found });
        }
        Ok(())
    }

    /// Pixels that one metre covers at one metre of depth: h / (2 tan(fov/2)).
    pub fn focal_px(&self) -> f64 {
        self.height_px / (2.0 * libm::tan(0.5 * self.vertical_fov.0))
    }

    /// Planar depth at which `length` metres cover `px` pixels. \[weber\] eq. 2.
    pub fn distance(&self, length: Metres, px: f64) -> Metres {
        Metres(length.0 * self.focal_px() / px)
    }

    /// Air in the frustum between z(`max_px`) and z(`min_px`) of streaks `length` metres long, m³:
    /// (4/3) aspect tan²(fov/2) (z(min_px)³ − z(max_px)³).
    pub fn shell_volume(&self, length: Metres) -> f64 {
        let tan = libm::tan(0.5 * self.vertical_fov.0);
        let [near, far] = [self.max_px, self.min_px].map(|px| self.distance(length, px).0);
        4.0 / 3.0 * self.aspect * tan * tan * (far * far * far - near * near * near)
    }

    /// [`View::shell_volume`] over length³: aspect h³ / (6 tan(fov/2)) (min_px⁻³ − max_px⁻³), dimensionless.
    /// All of the camera but its exposure is in this one number.
    pub fn shell_factor(&self) -> f64 {
        let cube = |value: f64| value * value * value;
        let tan = libm::tan(0.5 * self.vertical_fov.0);
        self.aspect / (6.0 * tan) * (cube(self.height_px / self.min_px) - cube(self.height_px / self.max_px))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEW: View = View {
        vertical_fov: Radians(2.0),
        height_px: 1080.0,
        aspect: 16.0 / 9.0,
        exposure: Seconds(0.02),
        min_px: 30.0,
        max_px: 200.0,
    };
    /// A dozen products in double precision.
    const ROUND_OFF: f64 = 1e-14;

    #[test]
    fn the_shells_volume_is_its_factor_times_length_cubed() {
        for length in [1e-3, 0.13, 2.0] {
            let volume = VIEW.shell_volume(Metres(length));
            assert!((VIEW.shell_factor() * length * length * length / volume - 1.0).abs() < ROUND_OFF);
        }
    }

    #[test]
    fn windows_of_length_telescope() {
        let windows = [30.0, 50.0, 90.0, 200.0].windows(2).map(<[f64]>::to_vec).collect::<Vec<_>>();
        let sum: f64 =
            windows.iter().map(|w| View { min_px: w[0], max_px: w[1], ..VIEW }.shell_factor()).sum();
        assert!((sum / VIEW.shell_factor() - 1.0).abs() < ROUND_OFF);
    }

    #[test]
    fn a_length_at_its_distance_covers_its_pixels() {
        let depth = VIEW.distance(Metres(0.13), 30.0);
        assert!((0.13 * VIEW.focal_px() / depth.0 - 30.0).abs() < 1e-12);
    }

    #[test]
    fn nonsense_is_refused_field_by_field() {
        let bad = [
            ("fov", View { vertical_fov: Radians(f64::NAN), ..VIEW }),
            ("fov", View { vertical_fov: Radians(std::f64::consts::PI), ..VIEW }),
            ("height", View { height_px: 0.0, ..VIEW }),
            ("aspect", View { aspect: f64::INFINITY, ..VIEW }),
            ("exposure-ms", View { exposure: Seconds(-1.0), ..VIEW }),
            ("min-px", View { min_px: 200.0, ..VIEW }),
            ("max-px", View { max_px: f64::NAN, ..VIEW }),
        ];
        for (field, view) in bad {
            assert_eq!(view.check().unwrap_err().field, field);
        }
        assert!(VIEW.check().is_ok());
    }
}
