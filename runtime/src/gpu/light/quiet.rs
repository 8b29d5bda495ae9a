//! The light of sky and sun, which stays while nothing moves.

use super::{CloudLights, Quiet, power_of_two};
use crate::clouds::card::Scattered;
use crate::clouds::{Clouds, SunSource, Viewer};
use crate::error::RuntimeError;
use crate::gpu::Gpu;
use crate::place::Place;
use crate::shade::sky::{Sky, SkyParameters};
use glam::DVec3;
use squall_formats::section::response::DistantKind;

impl CloudLights {
    pub(super) fn set_sky(
        &mut self,
        gpu: &Gpu,
        clouds: &mut Clouds,
        (sky, place, parameters): (&Sky, Place, &SkyParameters),
        (viewer, moved): (Viewer, bool),
    ) -> Result<(SunSource, bool), RuntimeError> {
        let kinds = [DistantKind::UpperSky, DistantKind::LowerSky];
        let hemispheres = kinds.map(|kind| clouds.hemisphere(kind));
        let missing = hemispheres.iter().any(Option::is_none);
        if self.lit_by.is_none() {
            for (sum, source) in self.sky.iter_mut().zip(hemispheres) {
                sum.set(gpu, &self.rows, &Scattered::Rows(source.into_iter().collect()));
            }
        }
        let is_new = self.lit_by.as_ref() != Some(parameters);
        if is_new {
            let unit = sky_unit(sky);
            let layers = layers_of(clouds.cloud(), sky, place, unit);
            self.sun_is_up = layers.iter().any(|light| light[..3] != [0.0; 3]);
            let towards = sky.sun_direction().as_dvec3().normalize();
            gpu.write(&self.layers, &layers);
            let known = self.sun.is_some_and(|(known, ..)| known == towards);
            if self.sun_is_up && !known {
                (self.sun, self.lit_by) = (None, None);
                let (source, scattered, has_beam) = clouds.sun_parts(towards, viewer)?;
                self.sky[2].set(gpu, &self.rows, &scattered.unwrap_or(Scattered::Rows(Vec::new())));
                if has_beam {
                    gpu.write(&self.beam, &clouds.beam(towards));
                }
                self.sun = Some((towards, source, has_beam));
            }
            let light = sky.cloud_light(0.0, DVec3::ZERO);
            let stored = |light: [f32; 3]| light.map(|band| band / unit);
            let quiet = Quiet {
                upper: stored(light.upper),
                has_beam: u32::from(self.sun_is_up && self.sun.is_some_and(|(.., has_beam)| has_beam)),
                lower: stored(light.lower),
                travel: (-towards).as_vec3().to_array(),
                ..Quiet::default()
            };
            gpu.write(&self.quiet, &[quiet]);
            self.tints.quiet = unit;
            self.lit_by = Some(parameters.clone());
        } else if moved && let Some((towards, SunSource::Live, _)) = self.sun {
            // The processor knows that light towards one viewer at a time.
            let (_, scattered, _) = clouds.sun_parts(towards, viewer)?;
            self.sky[2].set(gpu, &self.rows, &scattered.unwrap_or(Scattered::Rows(Vec::new())));
        }
        if moved {
            let is_live = matches!(self.sun, Some((_, SunSource::Live, _)));
            for (i, sum) in self.sky.iter_mut().enumerate() {
                sum.is_turned |= !(is_live && i == 2);
            }
        }
        self.quiet_is_new |= moved || is_new;
        let source = self.sun.filter(|_| self.sun_is_up).map_or(SunSource::Down, |(_, source, _)| source);
        Ok((source, missing))
    }
}

/// W/(m² sr) that a stored 1 of the quiet light stands for: J is about as bright as what lights it, and at most some times that.
fn sky_unit(sky: &Sky) -> f32 {
    let light = sky.cloud_light(1e5, DVec3::ZERO);
    let brightest =
        [light.upper, light.lower, light.sun_irradiance].into_iter().flatten().fold(0.0, f32::max);
    if brightest > 0.0 { power_of_two(brightest / 64.0) } else { 1.0 }
}

/// The sun's irradiance at the four corners of each layer of the grid, in units of `unit` W/m². (renderer/light.rs, distant_colours)
fn layers_of(cloud: &crate::transport::Cloud, sky: &Sky, from: Place, unit: f32) -> Vec<[f32; 4]> {
    let [nx, ny, nz] = cloud.shape.to_array();
    let corners =
        |z: usize| [(0, 0), (nx - 1, 0), (0, ny - 1), (nx - 1, ny - 1)].map(move |(x, y)| [x, y, z]);
    let light = |cell: [usize; 3]| {
        let place = cloud.centre(cell) - from.origin;
        let [r, g, b] = sky.cloud_light(place.z, place).sun_irradiance.map(|band| band / unit);
        [r, g, b, 0.0]
    };
    (0..nz).flat_map(corners).map(light).collect()
}
