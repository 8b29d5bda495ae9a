//! A world's light as numbers: to be kept beside a sequence and taken up again.

use super::degrees::COUNT;
use super::{Sun, WorldLight};
use crate::error::RuntimeError;

impl WorldLight {
    /// Coefficients of the radiance of the whole sphere, W/(m² sr) per colour: real spherical harmonics, orthonormal, world axes, number
    /// l² + l + m, m from −l to l; of degrees 0 to 2, or to [`super::HIGHEST_DEGREE`] where the light has more.
    pub fn coefficients(&self) -> Vec<[f32; 3]> {
        self.harmonics.iter().chain(&self.finer).copied().collect()
    }

    /// The light of [`WorldLight::coefficients`] and a sun.
    ///
    /// Errors: another number of coefficients, numbers that are not finite, a sun without a direction or with less than no light.
    pub fn from_coefficients(coefficients: &[[f32; 3]], sun: Option<Sun>) -> Result<Self, RuntimeError> {
        let refused = |wanted: String, found: String| RuntimeError::argument("light", wanted, found);
        if ![9, COUNT].contains(&coefficients.len()) {
            let wanted = format!("9 or {COUNT} coefficients");
            return Err(refused(wanted, coefficients.len().to_string()));
        }
        if !coefficients.iter().flatten().all(|value| value.is_finite()) {
            return Err(refused("finite coefficients".into(), "one that is not".into()));
        }
        if let Some(sun) = &sun {
            let directed = (sun.towards.length() - 1.0).abs() < 1e-3;
            let lit = sun.irradiance.iter().all(|value| *value >= 0.0 && value.is_finite());
            if !(directed && lit) {
                return Err(refused(
                    "a sun with a unit vector and light of 0 or more".into(),
                    format!("{sun:?}"),
                ));
            }
        }
        let harmonics = std::array::from_fn(|i| coefficients[i]);
        Ok(Self { harmonics, sun, finer: coefficients[9..].to_vec() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn a_light_comes_back_from_its_numbers_and_what_is_none_is_refused() {
        let sun = Sun { towards: Vec3::Z, irradiance: [3.0; 3], angular_radius: Sun::ANGULAR_RADIUS };
        let fine = WorldLight::from_radiance(&|d| [d.z.max(0.0), 1.0, 0.5], Some(sun));
        for light in [fine, WorldLight::uniform([2.0; 3])] {
            let again = WorldLight::from_coefficients(&light.coefficients(), light.sun).unwrap();
            assert_eq!(again, light);
        }
        assert!(WorldLight::from_coefficients(&[[1.0; 3]; 10], None).is_err());
        assert!(WorldLight::from_coefficients(&[[f32::NAN; 3]; 9], None).is_err());
        let dark = Sun { irradiance: [-1.0; 3], ..sun };
        assert!(WorldLight::from_coefficients(&[[1.0; 3]; 9], Some(dark)).is_err());
    }
}
