//! A sky as a graphics card looks at it: the table, and what the rest is worked out from.

use super::atmosphere::SUN_HALF_ANGLE;
use super::disc::LIMB;
use super::{AZIMUTHS, ELEVATIONS, EYE, HIGH_CLOUD, Sky};
use crate::camera::{Camera, Projection};
use glam::DVec3;
use std::f64::consts::PI;

/// Entries of the sunlight on the thin cloud layer, by the cosine of the sun's zenith angle there.
pub(crate) const HIGH: usize = 256;
/// Entries of the disc's radiance, by height in the sky.
pub(crate) const DISC: usize = 16;
/// How far the sun's cosine over the layer is from its cosine here, where the layer can be seen.
const HIGH_REACH: f64 = 0.042;
/// The same of heights of directions within the disc.
const DISC_REACH: f64 = 0.005;

/// `Sky` of sky.wgsl.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct SkyUniform {
    pub sun: [f32; 3],
    pub overcast: f32,
    pub grey: [f32; 3],
    pub high_cloud: f32,
    pub ground: [f32; 3],
    pub seed: u32,
    pub mean: [f32; 3],
    pub level: f32,
    pub upper: [f32; 3],
    pub cosine_low: f32,
    pub lower: [f32; 3],
    pub cosine_scale: f32,
    pub air_cloud: [f32; 3],
    pub disc_low: f32,
    pub air_town: [f32; 3],
    pub disc_scale: f32,
    pub air_high: [f32; 3],
    pub has_disc: u32,
    pub irradiance: [f32; 3],
    pub half_angle: f32,
    pub sun_pixel: [f32; 2],
    pub pad: [f32; 2],
    pub high: [[f32; 4]; HIGH],
    pub disc: [[f32; 4]; DISC],
    pub harmonics: [[f32; 4]; 9],
}

impl SkyUniform {
    /// Brightest that the sun's disc is, W/(m² sr).
    pub fn brightest(&self) -> f32 {
        let disc = self.disc.iter().flatten().copied().fold(0.0, f32::max);
        if self.has_disc == 1 { disc } else { 0.0 }
    }

    /// Columns and rows of the table.
    pub const TABLE: [u32; 2] = [AZIMUTHS as u32, ELEVATIONS as u32];
}

fn four([r, g, b]: [f32; 3]) -> [f32; 4] {
    [r, g, b, 0.0]
}

impl Sky {
    /// Radiance by azimuth from the sun and root of the elevation, azimuths fastest.
    pub(crate) fn table(&self) -> Vec<[f32; 4]> {
        self.table.iter().copied().map(four).collect()
    }

    /// What a card knows of this sky from an eye at `eye_height` m, which looks through clear air at clouds around `cloud_m` m and at
    /// things around `town_m` m.
    pub(crate) fn uniform(
        &self,
        camera: &Camera,
        eye_height: f64,
        [cloud_m, town_m]: [f64; 2],
    ) -> SkyUniform {
        let air = |from: f64, to: f64| self.air.optical_depth(from, to, 1.0).map(|band| band as f32);
        let above = self.light_above(HIGH_CLOUD, DVec3::ZERO);
        let at = |i: usize, count: usize, reach: f64| {
            self.sun.z - reach + 2.0 * reach * i as f64 / (count - 1) as f64
        };
        let high = std::array::from_fn(|i| {
            let share = self.air.sunlight(f64::from(HIGH_CLOUD as f32), at(i, HIGH, HIGH_REACH));
            four(std::array::from_fn(|band| (share[band] * self.scale[band]) as f32))
        });
        let size = libm::sin(SUN_HALF_ANGLE);
        let open = self.open_to_the_sun();
        // Of a sun below the ground nothing is seen, and no light has to be stored as coarsely as its disc's.
        let is_up = self.sun.z > -size && self.scale != [0.0; 3];
        let disc = std::array::from_fn(|i| {
            let air = self.air.transmittance(EYE, at(i, DISC, DISC_REACH).max(0.0));
            four(std::array::from_fn(|band| {
                let mean = self.scale[band] * air[band] / (PI * size * size);
                (mean * f64::from(0.5 * LIMB[band] + 1.0)) as f32 * open
            }))
        });
        let sun = self.sun();
        let is_perspective = matches!(camera.projection, Projection::Perspective { .. });
        // As far away as keeps the eye's own place from counting.
        let place = camera.project(camera.position + self.sun_direction().as_dvec3() * 1e6);
        let per = |reach: f64, count: usize| ((count - 1) as f64 / (2.0 * reach)) as f32;
        SkyUniform {
            sun: self.sun.as_vec3().to_array(),
            overcast: self.overcast,
            grey: self.grey,
            high_cloud: self.high_cloud,
            ground: self.ground,
            seed: self.lattice.seed(),
            mean: self.mean_radiance(),
            level: libm::hypot(self.sun.x, self.sun.y).max(1e-9) as f32,
            upper: above.upper,
            cosine_low: at(0, HIGH, HIGH_REACH) as f32,
            lower: above.lower,
            cosine_scale: per(HIGH_REACH, HIGH),
            air_cloud: air(eye_height, cloud_m),
            disc_low: at(0, DISC, DISC_REACH) as f32,
            air_town: air(eye_height, town_m),
            disc_scale: per(DISC_REACH, DISC),
            air_high: air(EYE, HIGH_CLOUD),
            has_disc: u32::from(is_up && is_perspective && place.is_some() && open > 0.0),
            irradiance: sun.map_or([0.0; 3], |sun| sun.irradiance),
            half_angle: SUN_HALF_ANGLE as f32,
            sun_pixel: place.map_or([-1e9; 2], |place| place.pixel.as_vec2().to_array()),
            pad: [0.0; 2],
            high,
            disc,
            harmonics: self.harmonics.map(four),
        }
    }
}
