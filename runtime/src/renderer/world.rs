//! The world around the eye, looked at in all directions: what rain, drops and mirrors are lit by.

use super::draw::Beyond;
use crate::camera::Ray;
use crate::shade::cloud::CloudPicture;
use crate::shade::environment::{Environment, EnvironmentWindow};
use crate::shade::sky::Sky;
use crate::world::{Sun, WorldLight};
use glam::{DVec3, Vec3};
use squall_formats::units::Radians;
use std::f64::consts::{FRAC_PI_2, PI};

/// The map of all directions: columns and rows, 1.9° apart.
const SIZE: [usize; 2] = [193, 97];

/// Sky, cloud and ground in all directions from `eye`, coarsely.
pub fn look_around(eye: DVec3, beyond: &Beyond<'_>) -> Environment {
    let window = EnvironmentWindow {
        heading: Radians(0.0),
        half_width: Radians(PI),
        bottom: Radians(-FRAC_PI_2),
        top: Radians(FRAC_PI_2),
        size: SIZE,
    };
    Environment::new(window, &|direction| beyond(&Ray { origin: eye, direction: direction.as_dvec3() }))
}

/// The sun on the ground around `eye`: after air, overcast and the storm's cloud.
pub fn sun_of(sky: &Sky, cloud: Option<&CloudPicture<'_>>, eye: DVec3) -> Option<Sun> {
    let sun = sky.sun()?;
    let ray = Ray { origin: eye, direction: sun.towards.as_dvec3() };
    let open = cloud.map_or(1.0, |cloud| cloud.march(&ray).transmittance);
    (open > 0.0).then(|| Sun { irradiance: sun.irradiance.map(|band| band * open), ..sun })
}

/// What the rain is lit by: everything in the map and the sun.
pub fn light_of(around: &Environment, sun: Option<Sun>) -> WorldLight {
    WorldLight::from_radiance(&|direction: Vec3| around.lookup(direction), sun)
}
