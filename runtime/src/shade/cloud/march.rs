//! The march through a cloud: stretches of even density, light at a place or two of each, laid over one another front to back.

use super::density::{Density, Stretch};
use super::direct::ExactDirect;
use crate::camera::{Camera, Projection, Ray};
use crate::math::exp_neg;
use crate::transport::Cloud;
use glam::DVec3;

/// Shortest distance to a light that counts, m, for rays without a width.
const NEAREST: f64 = 1e-3;

/// Optical depth from which on all of a step's light comes from its nearest place: e^−depth itself would vanish.
const DEEPEST: f64 = 40.0;

/// How closely a march looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarchQuality {
    /// Light behind less than this share is not looked for.
    pub opaque: f64,
    /// Longest step in optical depth over which J counts as even.
    pub step_depth: f64,
    /// Longest step, m: about how fine J is.
    pub longest_step: f64,
    /// Where J is read, as shares of a step.
    places: &'static [f64],
}

impl MarchQuality {
    /// For pictures: a share of light that no eye sees is left out, and the density's own steps are fine enough.
    pub const PICTURE: Self =
        Self { opaque: 2e-3, step_depth: f64::INFINITY, longest_step: f64::INFINITY, places: &[0.5] };

    /// For measurements in which J changes over no less than `longest_step` metres. The two places are those of Gauss's rule.
    pub const fn measured(longest_step: f64) -> Self {
        let places = &[0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
        Self { opaque: 1e-6, step_depth: 0.5, longest_step, places }
    }
}

/// Light in one colour, or in three.
pub trait Radiance: Copy + Default {
    /// Adds `factor` times `light`.
    fn add_scaled(&mut self, light: Self, factor: f64);
    /// Adds the same in every colour.
    fn add_grey(&mut self, light: f64);
}

impl Radiance for f64 {
    #[inline]
    fn add_scaled(&mut self, light: f64, factor: f64) {
        *self += light * factor;
    }

    #[inline]
    fn add_grey(&mut self, light: f64) {
        *self += light;
    }
}

impl Radiance for [f32; 3] {
    #[inline]
    fn add_scaled(&mut self, light: Self, factor: f64) {
        for (sum, light) in self.iter_mut().zip(light) {
            *sum += light * factor as f32;
        }
    }

    #[inline]
    fn add_grey(&mut self, light: f64) {
        self.iter_mut().for_each(|sum| *sum += light as f32);
    }
}

/// What a ray meets in a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudView<J = [f32; 3]> {
    /// Radiance towards the ray's origin, W/(m² sr), in one colour or three.
    pub radiance: J,
    /// Share of what is behind that comes through; 0 where the march stopped looking.
    pub transmittance: f32,
    /// Mean distance of what is seen, m; 0 where nothing is.
    pub distance: f32,
}

/// How much a ray stands for: the edge of its part of the picture, which grows with distance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RayWidth {
    /// At the ray's origin, m.
    pub start: f64,
    /// Growth, m/m.
    pub per_metre: f64,
}

impl RayWidth {
    /// A ray that stands for `share` of a pixel's edge.
    pub fn of(camera: &Camera, share: f64) -> Self {
        let edge = share / camera.pixels_per_metre();
        match camera.projection {
            Projection::Orthographic { .. } => Self { start: edge, per_metre: 0.0 },
            Projection::Perspective { .. } => Self { start: 0.0, per_metre: edge },
        }
    }

    /// Nearest that a ray may come to a light `distance` metres along it.
    ///
    /// A ray that passes the light at b sees π/b; its mean over the part of the picture around the light, a disc of radius ρ,
    /// is 2π/ρ, which is what a ray through the light itself sees when no distance below 2ρ/π counts.
    pub(super) fn nearest(self, distance: f64) -> f64 {
        let edge = self.start + self.per_metre * distance;
        let radius = edge / std::f64::consts::PI.sqrt();
        (radius * std::f64::consts::FRAC_2_PI).max(NEAREST)
    }
}

/// A ray of a picture.
#[derive(Clone, Copy, Debug)]
pub struct WideRay {
    /// Its middle.
    pub ray: Ray,
    /// How much it stands for; this keeps a light in the picture finite.
    pub width: RayWidth,
    /// Whether it sees what lies behind its origin too, as the rays of an orthographic camera do.
    pub backwards: bool,
}

impl WideRay {
    /// A ray of `width` through a camera of `projection`.
    pub fn new(ray: Ray, projection: Projection, width: RayWidth) -> Self {
        Self { ray, width, backwards: matches!(projection, Projection::Orthographic { .. }) }
    }

    /// A line that begins at its origin.
    pub fn thin(ray: Ray) -> Self {
        Self { ray, width: RayWidth::default(), backwards: false }
    }
}

/// A cloud ready to be followed along rays.
///
/// ```
/// use glam::DVec3;
/// use squall_formats::GridShape;
/// use squall_runtime::camera::Ray;
/// use squall_runtime::shade::cloud::{Cells, CloudMarch, MarchQuality, WideRay};
/// use squall_runtime::transport::{Boundary, Cloud};
///
/// let cloud = Cloud {
///     shape: GridShape::new(4, 4, 4),
///     cell_m: [25.0; 3],
///     origin_m: DVec3::ZERO,
///     extinction: vec![0.02; 64],
///     albedo: 0.9,
///     g: 0.85,
///     boundary: Boundary::Open,
/// };
/// let march = CloudMarch::new(&cloud, Cells, MarchQuality::measured(25.0));
/// let ray = Ray { origin: DVec3::new(-300.0, 40.0, 60.0), direction: DVec3::X };
/// // In even light J = 2 the radiance is ω J (1 − e^−τ), here with τ = 2.
/// let view = march.march(&WideRay::thin(ray), |_| 2.0);
/// let through = libm::exp(-2.0);
/// assert!((f64::from(view.transmittance) - through).abs() < 1e-6);
/// assert!((view.radiance - 0.9 * 2.0 * (1.0 - through)).abs() < 1e-6);
/// ```
#[derive(Clone, Copy)]
pub struct CloudMarch<'a, D> {
    /// Grid and optics.
    pub cloud: &'a Cloud,
    /// Where density comes from.
    pub density: D,
    /// Direct light that is worked out at every step.
    pub exact: Option<ExactDirect<'a>>,
    /// How closely to look.
    pub quality: MarchQuality,
}

impl<'a, D: Density> CloudMarch<'a, D> {
    /// A march in which all light is in J.
    pub fn new(cloud: &'a Cloud, density: D, quality: MarchQuality) -> Self {
        Self { cloud, density, exact: None, quality }
    }

    /// The same with the direct light of some lights worked out at every step; it must not be in J.
    pub fn with_exact(self, exact: ExactDirect<'a>) -> Self {
        Self { exact: (!exact.lights.is_empty()).then_some(exact), ..self }
    }

    /// Follows a ray, with J towards its origin from a function of the place, W/(m² sr).
    pub fn march<J: Radiance>(&self, wide: &WideRay, j: impl Fn(DVec3) -> J) -> CloudView<J> {
        let (cloud, quality) = (self.cloud, self.quality);
        let back = if wide.backwards {
            wide.ray.origin.distance(cloud.origin_m) + cloud.far_corner().distance(cloud.origin_m)
        } else {
            0.0
        };
        let ray = Ray { origin: wide.ray.origin - wide.ray.direction * back, ..wide.ray };
        let point = |at: f64| ray.origin + ray.direction * at;
        let in_scattered = |at: f64| -> J {
            let mut sum = j(point(at));
            if let Some(exact) = self.exact {
                sum.add_grey(exact.in_scattered(cloud, &wide.ray, wide.width, point(at)));
            }
            sum
        };
        let (mut radiance, mut open) = (J::default(), 1.0f64);
        let (mut seen, mut moment) = (0.0f64, 0.0f64);
        self.density.stretches(cloud, &ray, |stretch| {
            let Stretch { start, length, extinction } = stretch;
            let (mut at, end) = (start, start + length);
            while at < end && open > quality.opaque {
                let exact = self.exact.map(|exact| exact.longest_step(&wide.ray, wide.width, point(at)));
                let even = quality.longest_step.min(quality.step_depth / extinction);
                let step = even.min(exact.unwrap_or(f64::INFINITY)).min(end - at);
                // Lost in the last digits of `at` a step would repeat for ever: then the rest is one.
                let step = if at + step > at { step } else { end - at };
                let (gone, through) = shares(step, extinction);
                composite(&mut radiance, quality.places, open * cloud.albedo * gone, |place| {
                    // With one place its weight does not matter.
                    let weight = if quality.places.len() == 1 {
                        1.0
                    } else {
                        weight((extinction * step).min(DEEPEST) * place)
                    };
                    (in_scattered(at + place * step), weight)
                });
                seen += open * gone;
                moment += open * gone * (at + 0.5 * step);
                open *= through;
                at = if step == end - at { end } else { at + step };
            }
            open > quality.opaque
        });
        let distance = if seen > 0.0 { moment / seen - back } else { 0.0 };
        let transmittance = if open > quality.opaque { open as f32 } else { 0.0 };
        CloudView { radiance, transmittance, distance: distance as f32 }
    }
}

/// Adds `factor` times the weighted mean of light at a step's places.
#[inline]
fn composite<J: Radiance>(radiance: &mut J, places: &[f64], factor: f64, light: impl Fn(f64) -> (J, f64)) {
    let (mut sum, mut weights) = (J::default(), 0.0);
    for &place in places {
        let (light, weight) = light(place);
        sum.add_scaled(light, weight);
        weights += weight;
    }
    radiance.add_scaled(sum, factor / weights);
}

/// Share of a place's light that comes out of the step that it is in, `depth` of optical depth away.
fn weight(depth: f64) -> f64 {
    f64::from(exp_neg(depth as f32))
}

/// Shares of light that a step takes out and lets through.
fn shares(length: f64, extinction: f64) -> (f64, f64) {
    let depth = extinction * length;
    if depth < 0.02 {
        // The difference from 1 would lose its digits.
        let gone = depth * (1.0 - depth * (0.5 - depth / 6.0));
        return (gone, 1.0 - gone);
    }
    let through = f64::from(exp_neg(depth as f32));
    (1.0 - through, through)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shade::cloud::{CloudPicture, CloudShape};
    use crate::shade::detail::Detail;
    use crate::shade::detail::DetailParameters;
    use crate::transport::Boundary;
    use glam::Vec4;
    use squall_formats::GridShape;

    fn uniform(extinction: f32, shape: GridShape) -> Cloud {
        Cloud {
            shape,
            cell_m: [20.0, 30.0, 40.0],
            origin_m: DVec3::new(-100.0, -90.0, 50.0),
            extinction: vec![extinction; shape.len()],
            albedo: 0.9,
            g: 0.85,
            boundary: Boundary::Open,
        }
    }

    fn march(cloud: &Cloud, ray: Ray) -> CloudView {
        let shape = CloudShape::new(cloud);
        let detail = Detail::new(&DetailParameters::default()).unwrap();
        let cells: Vec<Vec4> = cloud.extinction.iter().map(|&e| Vec4::new(1.0, 2.0, 3.0, e)).collect();
        CloudPicture::new(cloud, &shape, &cells, &detail, None).march(&ray)
    }

    /// Single precision over some hundred steps.
    const ROUND_OFF: f32 = 1e-4;

    #[test]
    fn a_uniform_cloud_in_uniform_light_shows_what_beer_and_lambert_say() {
        let cloud = uniform(0.004, GridShape::new(10, 6, 5));
        let ray = Ray { origin: DVec3::new(-500.0, 7.0, 141.0), direction: DVec3::X };
        let view = march(&cloud, ray);
        let through = libm::expf(-0.004 * 200.0);
        assert!((view.transmittance - through).abs() < ROUND_OFF);
        assert!((view.radiance[1] - 2.0 * 0.9 * (1.0 - through)).abs() < ROUND_OFF);
        assert!(view.distance > 400.0 && view.distance < 600.0);
    }

    #[test]
    fn clouds_in_which_a_step_is_shorter_than_the_distances_last_digit_are_opaque() {
        for extinction in [1e4, 1e6, 1e9, 1e12, 1e30] {
            let cloud = uniform(extinction, GridShape::new(10, 6, 5));
            let march = CloudMarch::new(&cloud, crate::shade::cloud::Cells, MarchQuality::measured(10.0));
            for away in [150.0, 1e7] {
                let ray = Ray { origin: DVec3::new(-away, 7.0, 141.0), direction: DVec3::X };
                let view = march.march(&WideRay::thin(ray), |_| 2.0);
                assert_eq!(view.transmittance, 0.0, "{extinction} {away}");
                assert!((view.radiance - 1.8).abs() < 1e-5, "{extinction} {away}: {view:?}");
            }
        }
    }

    #[test]
    fn a_single_cell_and_a_ray_along_a_face_are_no_trouble() {
        let cloud = uniform(0.01, GridShape::new(1, 1, 1));
        let inside = march(&cloud, Ray { origin: DVec3::new(-90.0, -75.0, 0.0), direction: DVec3::Z });
        assert!((inside.transmittance - libm::expf(-0.4)).abs() < ROUND_OFF);
        let along = march(&cloud, Ray { origin: DVec3::new(-100.0, -75.0, 0.0), direction: DVec3::Z });
        assert!(along.transmittance.is_finite() && along.radiance[0].is_finite());
        let beside = march(&cloud, Ray { origin: DVec3::new(0.0, 0.0, 0.0), direction: DVec3::Z });
        assert_eq!(beside, CloudView { radiance: [0.0; 3], transmittance: 1.0, distance: 0.0 });
    }

    #[test]
    fn empty_cubes_are_skipped_and_what_stands_behind_them_is_not() {
        let shape = GridShape::new(40, 5, 5);
        let mut cloud = uniform(0.0, shape);
        for index in 0..shape.len() {
            if shape.cell(index)[0] == 31 {
                cloud.extinction[index] = 0.01;
            }
        }
        let ray = Ray { origin: DVec3::new(-500.0, 0.0, 150.0), direction: DVec3::X };
        // Between centres the one layer is a tent two cells wide, with the same optical depth.
        let view = march(&cloud, ray);
        /// The midpoint rule on a tent with seven steps a side.
        const MARCHING: f32 = 0.01;
        assert!((view.transmittance - libm::expf(-0.2)).abs() < MARCHING, "{view:?}");
        assert!((view.distance - (400.0 + 31.5 * 20.0)).abs() < 20.0, "{view:?}");
    }
}
