//! What a drop mirrors and refracts: overcast sky, wet ground, a dark skyline between them and some lights.
//!
//! Radiance is relative to the sky's zenith. World: x right, y away from the eye, z up.

use glam::DVec3;
use squall_runtime::random::Random;
use std::f64::consts::TAU;

/// Sectors of the skyline.
const SECTORS: usize = 28;

/// Radiance from every direction.
#[derive(Clone, Debug, PartialEq)]
pub struct Surroundings {
    /// Share of light that the ground returns.
    albedo: f64,
    /// Radiance of what stands before the sky.
    dark: f64,
    /// Its height per sector, sine of the elevation.
    skyline: [f64; SECTORS],
    /// Discs before everything else.
    lights: Vec<Disc>,
    /// Excess radiance of the sky around the first light, and its concentration.
    glow: [f64; 2],
}

/// A light as it is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Disc {
    toward: DVec3,
    /// Cosine of the angular radius.
    rim: f64,
    radiance: f64,
}

/// Where a light stands and how strong it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightPlace {
    /// From straight behind the drop toward the right, rad.
    pub azimuth: f64,
    /// Above the horizon, rad.
    pub elevation: f64,
    /// Angular radius, rad.
    pub radius: f64,
    /// Irradiance across its beam over that of a sky of radiance 1, π.
    pub strength: f64,
}

impl LightPlace {
    fn disc(&self) -> Disc {
        let (sin_azimuth, cos_azimuth) = libm::sincos(self.azimuth);
        let (sin, cos) = libm::sincos(self.elevation);
        let rim = libm::cos(self.radius);
        // ∫ cos over a disc of radius ρ is π sin²ρ.
        let radiance = self.strength / (1.0 - rim * rim);
        Disc { toward: DVec3::new(sin_azimuth * cos, cos_azimuth * cos, sin), rim, radiance }
    }
}

impl Surroundings {
    /// Ground and skyline from `random`, with the lights where they are told.
    pub fn new(random: &mut Random, lights: &[LightPlace]) -> Self {
        let albedo = random.range(0.06, 0.22);
        let dark = random.range(0.03, 0.12);
        let tall = random.range(0.1, 0.75);
        let mut skyline = [0.0; SECTORS];
        for height in &mut skyline {
            // Half of the horizon is low, some of it stands out.
            *height = 0.03 + tall * random.unit() * random.unit();
        }
        let glow = [random.range(0.0, 0.8), random.range(4.0, 20.0)];
        Self { albedo, dark, skyline, lights: lights.iter().map(LightPlace::disc).collect(), glow }
    }

    /// Radiance from the unit vector `direction`, away from the drop.
    pub fn radiance(&self, direction: DVec3) -> f64 {
        for light in &self.lights {
            if direction.dot(light.toward) > light.rim {
                return light.radiance;
            }
        }
        let z = direction.z;
        let turn = libm::atan2(direction.x, direction.y) / TAU;
        let sector = ((turn - turn.floor()) * SECTORS as f64) as usize;
        if z < self.skyline[sector.min(SECTORS - 1)] && z > -self.skyline[sector.min(SECTORS - 1)] * 0.3 {
            return self.dark;
        }
        if z < 0.0 {
            // Under an overcast sky of zenith radiance 1 the ground receives 7π/9.
            return self.albedo * 7.0 / 9.0;
        }
        // The CIE's overcast sky \[moon-spencer\], brighter about the light.
        let near = self.lights.first().map_or(-1.0, |light| direction.dot(light.toward));
        (1.0 + 2.0 * z) / 3.0 + self.glow[0] * libm::exp(self.glow[1] * (near - 1.0))
    }

    /// Mean over all directions, by the midpoint rule over 64 × 128 cells; lights count by their
    /// solid angle.
    pub fn mean(&self) -> f64 {
        const CELLS: [usize; 2] = [64, 128];
        let without = Self { lights: vec![], ..self.clone() };
        let mut sum = 0.0;
        for i in 0..CELLS[0] {
            let z = (i as f64 + 0.5) * 2.0 / CELLS[0] as f64 - 1.0;
            for j in 0..CELLS[1] {
                let (sin, cos) = libm::sincos((j as f64 + 0.5) * TAU / CELLS[1] as f64);
                let level = libm::sqrt(1.0 - z * z);
                sum += without.radiance(DVec3::new(level * sin, level * cos, z));
            }
        }
        let lit = self.lights.iter().map(|light| 0.5 * (1.0 - light.rim) * light.radiance);
        sum / (CELLS[0] * CELLS[1]) as f64 + lit.sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_brings_the_irradiance_it_is_said_to() {
        let place = LightPlace { azimuth: 0.4, elevation: 0.5, radius: 0.06, strength: 0.2 };
        let all = Surroundings::new(&mut Random::new(3), &[place]);
        let Disc { toward, rim, .. } = all.lights[0];
        let (around, _) = toward.any_orthonormal_pair();
        // Midpoint rule over the disc, in equal solid angles.
        const RINGS: usize = 200;
        let mut sum = 0.0;
        for ring in 0..RINGS {
            let cos = 1.0 - (1.0 - rim) * (ring as f64 + 0.5) / RINGS as f64;
            let sin = libm::sqrt(1.0 - cos * cos);
            let direction = toward * cos + around * sin;
            sum += all.radiance(direction) * cos * TAU * (1.0 - rim) / RINGS as f64;
        }
        assert!((sum / std::f64::consts::PI - 0.2).abs() < 1e-6, "{sum}");
    }

    #[test]
    fn sky_is_bright_and_ground_and_horizon_are_dark() {
        let place = LightPlace { azimuth: 0.4, elevation: 0.5, radius: 0.06, strength: 0.2 };
        let all = Surroundings::new(&mut Random::new(4), &[place]);
        assert!(all.radiance(DVec3::Z) >= 1.0 && all.radiance(-DVec3::Z) < 0.2);
        assert!(all.radiance(DVec3::Y) < 0.2, "the skyline hides the horizon");
    }
}
