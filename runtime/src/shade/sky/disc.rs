//! The sun itself: what of it reaches the ground, and the disc that stands in the sky.

use super::atmosphere::SUN_HALF_ANGLE;
use super::{EYE, Sky};
use crate::camera::{Camera, Lens, Projection};
use crate::world::Sun;
use glam::{DVec3, Vec3};
use squall_formats::units::Radians;
use std::f64::consts::PI;

/// Exponent α of the disc's darkening towards its limb, I(μ) = I(1) μ^α, with μ the cosine of the angle between line of sight
/// and the sun's surface: −0.023 + 0.292 µm/λ at the middles of the bands, 0.615, 0.535 and 0.465 µm. \[hestroffer\]
pub(super) const LIMB: [f32; 3] = [0.452, 0.523, 0.605];
/// Half widths of the disc that a pixel is wide beyond which samples are not asked: two whole discs.
const WIDE: f64 = 4.0;
/// Samples along each side of a pixel that the disc's edge may cross.
const SUBPIXELS: u32 = 8;

impl Sky {
    /// The sun as it shines on the ground: dimmed by the air, by thin high cloud in front of it and by the share of the sky that is
    /// overcast. `None` where nothing of it arrives: it is down, or the whole sky is grey.
    pub fn sun(&self) -> Option<Sun> {
        let towards = self.sun_direction();
        let open = self.open_to_the_sun();
        let share = self.air.sunlight(0.0, self.sun.z);
        let irradiance: [f32; 3] = std::array::from_fn(|band| (share[band] * self.scale[band]) as f32 * open);
        let shines = irradiance.iter().any(|&band| band > 0.0);
        shines.then_some(Sun { towards, irradiance, angular_radius: Radians(SUN_HALF_ANGLE) })
    }

    /// Share of the sun's light that overcast and high cloud let through.
    pub(super) fn open_to_the_sun(&self) -> f32 {
        (1.0 - self.overcast) * (1.0 - self.high_cloud_opacity(self.sun_direction()))
    }

    /// Radiance of the sun's disc in `direction` (unit), W/(m² sr) per colour: brightest in its middle, darker and redder towards
    /// its limb, redder towards the horizon, and 0 beside it and below the horizon. [`Sky::radiance`] leaves it out. Over the
    /// whole disc it sums to [`Sky::sun`]'s irradiance, as far as the air over a quarter of a degree is the same.
    pub fn disc(&self, direction: Vec3) -> [f32; 3] {
        let towards = self.sun_direction();
        if direction.z <= 0.0 || direction.dot(towards) <= 0.0 {
            return [0.0; 3];
        }
        let size = libm::sin(SUN_HALF_ANGLE);
        // The cross product is good to the last digits where a cosine would be lost near 1.
        let from_middle = f64::from(direction.cross(towards).length()) / size;
        if from_middle >= 1.0 {
            return [0.0; 3];
        }
        let cosine = libm::sqrt(1.0 - from_middle * from_middle) as f32;
        let air = self.air.transmittance(EYE, f64::from(direction.z));
        let open = self.open_to_the_sun();
        std::array::from_fn(|band| {
            // The mean of μ^α over the disc is 2/(α + 2).
            let middle =
                self.scale[band] * air[band] / (PI * size * size) * f64::from(0.5 * LIMB[band] + 1.0);
            middle as f32 * libm::powf(cosine, LIMB[band]) * open
        })
    }

    /// Squared distance between a unit direction in the middle of a pixel of `lens` and the sun's, beyond which [`Sky::disc_in_pixel`] is
    /// black; none where the sun is below every horizon.
    pub(crate) fn disc_reach(&self, lens: &Lens<'_>) -> Option<f64> {
        let reach = SUN_HALF_ANGLE + lens.pixel_diagonal();
        (self.sun.z > -reach).then_some(reach * reach)
    }

    /// The sun's direction in double precision.
    pub(crate) fn sun_way(&self) -> DVec3 {
        self.sun
    }

    /// Mean radiance of the sun's disc over pixel (`x`, `y`) of `camera`, W/(m² sr) per colour: a disc smaller than a pixel loses none
    /// of its light, and its edge is smooth.
    pub fn disc_in_pixel(&self, camera: &Camera, x: usize, y: usize) -> [f32; 3] {
        let Projection::Perspective { .. } = camera.projection else { return [0.0; 3] };
        let lens = Lens::new(camera);
        let ray = |u: f64, v: f64| lens.ray(x as f64 + u, y as f64 + v).direction;
        let middle = ray(0.5, 0.5);
        let reach = SUN_HALF_ANGLE + ray(0.0, 0.0).distance(ray(1.0, 1.0));
        if middle.distance_squared(self.sun) > reach * reach {
            return [0.0; 3];
        }
        let sides = [ray(1.0, 0.5) - ray(0.0, 0.5), ray(0.5, 1.0) - ray(0.5, 0.0)];
        if sides.iter().any(|side| side.length() > WIDE * SUN_HALF_ANGLE) {
            return self.disc_in_wide_pixel(camera, [x, y], sides);
        }
        let mut sum = [0.0f32; 3];
        for i in 0..SUBPIXELS * SUBPIXELS {
            let [u, v] =
                [i % SUBPIXELS, i / SUBPIXELS].map(|at| (f64::from(at) + 0.5) / f64::from(SUBPIXELS));
            let disc = self.disc(ray(u, v).as_vec3());
            (0..3).for_each(|band| sum[band] += disc[band]);
        }
        sum.map(|band| band / (SUBPIXELS * SUBPIXELS) as f32)
    }
}

impl Sky {
    /// The same where a pixel is so wide that samples in it would miss the disc: the sun's irradiance over the pixel's solid angle,
    /// shared among the pixels that a square around the disc lies in. `sides` are the pixel's, between unit vectors.
    fn disc_in_wide_pixel(&self, camera: &Camera, pixel: [usize; 2], sides: [DVec3; 2]) -> [f32; 3] {
        let Some(sun) = self.sun() else { return [0.0; 3] };
        let towards = self.sun_direction().as_dvec3();
        // As far away as keeps the eye's own place from counting.
        let Some(place) = camera.project(camera.position + towards * 1e6) else { return [0.0; 3] };
        let share = |axis: usize| {
            let (middle, reach) = (place.pixel[axis], SUN_HALF_ANGLE / sides[axis].length());
            let low = (pixel[axis] as f64).max(middle - reach);
            let high = (pixel[axis] as f64 + 1.0).min(middle + reach);
            (high - low).max(0.0) / (2.0 * reach)
        };
        let per_steradian = share(0) * share(1) / sides[0].cross(sides[1]).length();
        sun.irradiance.map(|band| band * per_steradian as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::super::SkyParameters;
    use super::*;
    use squall_formats::units::Degrees;

    fn sky(elevation_deg: f64, overcast: f64) -> Sky {
        let parameters = SkyParameters {
            sun_azimuth: Radians(0.7),
            sun_elevation: Radians(elevation_deg.to_radians()),
            overcast,
            high_cloud: 0.0,
            ..SkyParameters::default()
        };
        Sky::new(&parameters).unwrap()
    }

    #[test]
    fn high_cloud_dims_the_sun_on_clouds_below_it_as_on_the_ground_and_not_above() {
        /// Single precision.
        const ROUND_OFF: f32 = 1e-5;
        let mut least = 1.0f32;
        for (i, overcast) in [0.0, 0.0, 0.0, 0.0, 0.5, 0.5].into_iter().enumerate() {
            let (azimuth, elevation) = (i as f64, 25.0 + 10.0 * i as f64);
            let with = |high_cloud: f64| {
                let parameters = SkyParameters {
                    sun_azimuth: Radians(azimuth),
                    sun_elevation: Radians(elevation.to_radians()),
                    overcast,
                    high_cloud,
                    ..SkyParameters::default()
                };
                Sky::new(&parameters).unwrap()
            };
            let (clear, veiled) = (with(0.0), with(1.0));
            let ground = veiled.sun().unwrap().irradiance[1] / clear.sun().unwrap().irradiance[1];
            let on_cloud = |altitude: f64| {
                let light = |sky: &Sky| sky.cloud_light(altitude, DVec3::ZERO).sun_irradiance[1];
                light(&veiled) / light(&clear)
            };
            least = least.min(ground);
            assert!((on_cloud(3e3) - ground).abs() < ROUND_OFF, "{elevation}: {} {ground}", on_cloud(3e3));
            assert!((on_cloud(11e3) - 1.0).abs() < ROUND_OFF, "{elevation}: {}", on_cloud(11e3));
        }
        // The sun stands behind a streak in some of these.
        assert!(least < 0.9, "{least}");
    }

    #[test]
    fn the_disc_sums_to_the_suns_irradiance() {
        /// 200 × 200 midpoints over a disc whose edge they cut, and air that changes across it.
        const QUADRATURE: f32 = 0.01;
        for elevation in [8.0, 35.0, 89.9] {
            let sky = sky(elevation, 0.0);
            let sun = sky.sun().unwrap();
            let across = sun.towards.any_orthonormal_vector();
            let along = sun.towards.cross(across);
            let (mut sum, step) = ([0.0f32; 3], 2.2 * SUN_HALF_ANGLE as f32 / 200.0);
            for i in 0..200 * 200 {
                let [u, v] = [i % 200, i / 200].map(|at| (at as f32 - 99.5) * step);
                let disc = sky.disc((sun.towards + across * u + along * v).normalize());
                (0..3).for_each(|band| sum[band] += disc[band] * step * step);
            }
            for band in 0..3 {
                assert!(
                    (sum[band] / sun.irradiance[band] - 1.0).abs() < QUADRATURE,
                    "{elevation}: {sum:?} {sun:?}"
                );
            }
        }
    }

    #[test]
    fn the_limb_is_darker_and_redder_than_the_middle() {
        let sky = sky(40.0, 0.0);
        let towards = sky.sun_direction();
        let aside = |share: f32| {
            let across = towards.any_orthonormal_vector();
            sky.disc((towards + across * (share * SUN_HALF_ANGLE as f32)).normalize())
        };
        let (middle, limb) = (aside(0.0), aside(0.95));
        assert!(limb[1] < 0.6 * middle[1] && limb[1] > 0.3 * middle[1], "{limb:?} {middle:?}");
        assert!(limb[0] / limb[2] > 1.1 * middle[0] / middle[2]);
        assert_eq!(aside(1.05), [0.0; 3]);
        assert_eq!(sky.disc(-towards), [0.0; 3]);
    }

    #[test]
    fn pixels_smaller_and_larger_than_the_disc_hold_the_same_light() {
        /// 64 samples in a pixel that the disc fills a third of, or that its edge cuts.
        const SAMPLING: f64 = 0.06;
        let sky = sky(30.0, 0.0);
        let flux = |size: u32| {
            let target = sky.sun_direction().as_dvec3() * 1e3;
            let camera = Camera::look_at(DVec3::ZERO, target, Degrees(4.0), [size, size]).unwrap();
            let per_pixel = 1.0 / (camera.pixels_per_metre() * camera.pixels_per_metre());
            let pixels = (0..size as usize).flat_map(|y| (0..size as usize).map(move |x| (x, y)));
            pixels.map(|(x, y)| f64::from(sky.disc_in_pixel(&camera, x, y)[1]) * per_pixel).sum::<f64>()
        };
        let wanted = f64::from(sky.sun().unwrap().irradiance[1]);
        for size in [5, 64] {
            assert!((flux(size) / wanted - 1.0).abs() < SAMPLING, "{size}: {} for {wanted}", flux(size));
        }
    }

    #[test]
    fn pixels_of_five_degrees_lose_none_of_the_sun() {
        /// Chords for arcs of 5°, and two equal pixels that the disc is shared by though one is a little smaller.
        const CHORDS: f64 = 0.01;
        let sky = sky(30.0, 0.0);
        let (sun, wanted) = (sky.sun_direction().as_dvec3(), f64::from(sky.sun().unwrap().irradiance[1]));
        for aside in [0.0, 0.03, 0.044, 0.2, 0.31] {
            let target = (sun + DVec3::new(aside, -0.6 * aside, 0.3 * aside)) * 1e3;
            let camera = Camera::look_at(DVec3::Z * 2.0, target, Degrees(60.0), [13, 13]).unwrap();
            let at_axis = 1.0 / (camera.pixels_per_metre() * camera.pixels_per_metre());
            let mut flux = 0.0;
            for (x, y) in (0..13).flat_map(|y| (0..13).map(move |x| (x, y))) {
                let secant = camera.secants().at(x as f64 + 0.5, y as f64 + 0.5);
                flux += f64::from(sky.disc_in_pixel(&camera, x, y)[1]) * at_axis / (secant * secant * secant);
            }
            assert!((flux / wanted - 1.0).abs() < CHORDS, "{aside}: {flux} for {wanted}");
        }
    }

    #[test]
    fn overcast_dims_the_sun_everywhere_alike() {
        let (clear, half, grey) = (sky(30.0, 0.0), sky(30.0, 0.5), sky(30.0, 1.0));
        let on_cloud = |sky: &Sky| sky.cloud_light(2e3, DVec3::ZERO).sun_irradiance[1];
        let at_ground = |sky: &Sky| sky.sun().map_or(0.0, |sun| sun.irradiance[1]);
        for light in [on_cloud, at_ground] {
            assert!((light(&half) / light(&clear) - 0.5).abs() < 1e-6);
            assert_eq!(light(&grey), 0.0);
        }
        assert!(grey.sun().is_none() && grey.disc(grey.sun_direction()) == [0.0; 3]);
    }

    #[test]
    fn a_set_sun_shines_on_nobody_at_the_ground() {
        let sky = sky(-2.0, 0.0);
        assert!(sky.sun().is_none());
        assert_eq!(sky.disc(sky.sun_direction()), [0.0; 3]);
    }
}
