//! Pictures by Monte Carlo: at every scattering, what of it goes straight to each camera.
//!
//! Light of power w that scatters at a place sends w p e^{−τ} per steradian towards the camera, τ the optical depth on the way.
//! A pixel's mean radiance, over the pixel's part of the picture, gains
//! - orthographic: w p e^{−τ} / a, a the pixel's area, m²;
//! - perspective: w p e^{−τ} r / (z³ a), r the distance, z the planar depth, a the pixel's area at unit depth.
//!
//! The first has no singularity. The second has one at the camera: with an eye inside the cloud the mean is still right, but
//! single scatterings beside the eye weigh as 1/r², the variance is infinite, and the standard error is no bound. The lamp
//! may be anywhere: no path is ever joined to it.

use super::phase::Phase;
use super::traverse::{Grid, Place};
use crate::error::BakeError;
use glam::{DVec2, DVec3};
use squall_runtime::RuntimeError;
use squall_runtime::camera::{Camera, Projection};

/// Optical depth from which nothing is worth adding: e^−60 is below 10⁻²⁶.
const DARK: f64 = 60.0;
/// Most copies of a repeating grid in one picture.
const MOST_COPIES: f64 = 65_536.0;
/// |cosine| to the vertical below which a camera looks level through a grid without sides.
const LEAST_SLOPE: f64 = 1e-3;

/// A camera that gathers scattered light.
#[derive(Clone, Debug)]
pub struct Viewpoint {
    camera: Camera,
    /// Pixels per unit of depth (perspective) or per metre (orthographic), right and up.
    scale: DVec2,
    orthographic: bool,
    /// Steps from copy to copy of a repeating grid, in pixels, along its x and y.
    copies: Option<[DVec2; 2]>,
}

impl Viewpoint {
    /// For the camera called `name`.
    ///
    /// Errors, where the grid repeats: a perspective camera, one that looks level, more than 65 536 copies in the picture.
    pub fn new(grid: &Grid<'_>, name: &str, camera: &Camera) -> Result<Self, BakeError> {
        let scale =
            0.5 * DVec2::new(f64::from(camera.width), f64::from(camera.height)) / camera.half_extent();
        let orthographic = matches!(camera.projection, Projection::Orthographic { .. });
        let mut eye = Self { camera: camera.clone(), scale, orthographic, copies: None };
        if grid.repeats(0) {
            let refused = |found: &str| {
                let wanted = "an orthographic camera that looks up or down, where a grid without sides is solved by Monte Carlo";
                RuntimeError::argument("camera", wanted, format!("\"{name}\", {found}"))
            };
            if !orthographic {
                return Err(refused("a perspective one").into());
            }
            if camera.forward.z.abs() < LEAST_SLOPE {
                return Err(refused("which looks level").into());
            }
            let across = |axis: DVec3| eye.across(axis);
            let steps = [across(DVec3::X * grid.size().x), across(DVec3::Y * grid.size().y)];
            let pixels = f64::from(camera.width) * f64::from(camera.height);
            if pixels > MOST_COPIES * steps[0].perp_dot(steps[1]).abs() {
                return Err(refused("which sees more than 65536 copies of the grid").into());
            }
            eye.copies = Some(steps);
        }
        Ok(eye)
    }

    /// Pixels of the picture.
    pub fn pixels(&self) -> usize {
        self.camera.width as usize * self.camera.height as usize
    }

    /// A vector's extent in the picture, in pixels to the right and down per unit of depth.
    fn across(&self, vector: DVec3) -> DVec2 {
        DVec2::new(vector.dot(self.camera.right), -vector.dot(self.camera.up)) * self.scale
    }

    fn pixel(&self, at: DVec2) -> Option<usize> {
        let inside = at.x >= 0.0
            && at.y >= 0.0
            && at.x < f64::from(self.camera.width)
            && at.y < f64::from(self.camera.height);
        inside.then(|| at.x as usize + self.camera.width as usize * at.y as usize)
    }

    /// Adds what light of `power` that came along `direction` and scatters at `place` sends to the camera.
    pub fn gather(
        &self,
        grid: &Grid<'_>,
        phase: &Phase,
        (place, direction): (&Place, DVec3),
        power: f64,
        image: &mut [f64],
    ) {
        let offset = grid.point(place) - self.camera.position;
        let middle = 0.5 * DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        let per_area = power * self.scale.x * self.scale.y;
        if self.orthographic {
            let towards = -self.camera.forward;
            let at = middle + self.across(offset);
            let light = || {
                let depth = grid.depth(place, towards, f64::INFINITY, DARK);
                per_area * phase.value(direction, towards) * libm::exp(-depth)
            };
            match self.copies {
                None => {
                    if let Some(pixel) = self.pixel(at) {
                        image[pixel] += light();
                    }
                }
                Some(steps) => {
                    // The way out is the same from every copy.
                    let light = light();
                    self.each_copy(at, steps, |pixel| image[pixel] += light);
                }
            }
            return;
        }
        let (depth, distance) = (offset.dot(self.camera.forward), offset.length());
        // A depth whose cube is no number is a place on the eye itself, which has no direction.
        if depth <= 1e-100 {
            return;
        }
        let Some(pixel) = self.pixel(middle + self.across(offset) / depth) else { return };
        let towards = -offset / distance;
        let way = grid.depth(place, towards, distance, DARK);
        image[pixel] +=
            per_area * phase.value(direction, towards) * libm::exp(-way) * distance / (depth * depth * depth);
    }

    /// Calls `visit` for the pixel of every copy of the point `at` that lies in the picture.
    fn each_copy(&self, at: DVec2, steps: [DVec2; 2], mut visit: impl FnMut(usize)) {
        let size = DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        // at + i a + j b in the picture: i and j lie between those of its corners.
        let [a, b] = steps;
        let area = a.perp_dot(b);
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for corner in [DVec2::ZERO, DVec2::new(size.x, 0.0), DVec2::new(0.0, size.y), size] {
            let to = corner - at;
            let steps = DVec2::new(to.perp_dot(b), a.perp_dot(to)) / area;
            (low, high) = (low.min(steps), high.max(steps));
        }
        for j in low.y.ceil() as i64..=high.y.floor() as i64 {
            for i in low.x.ceil() as i64..=high.x.floor() as i64 {
                if let Some(pixel) = self.pixel(at + a * i as f64 + b * j as f64) {
                    visit(pixel);
                }
            }
        }
    }
}
