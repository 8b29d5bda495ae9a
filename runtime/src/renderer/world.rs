//! The world around the eye, looked at in all directions: what rain, drops and mirrors are lit by.

use super::draw::Beyond;
use crate::camera::Ray;
use crate::medium::Phase;
use crate::shade::adaptive::Spacing;
use crate::shade::cloud::CloudPicture;
use crate::shade::detail::DetailParameters;
use crate::shade::environment::{Environment, EnvironmentWindow};
use crate::shade::sky::{Sky, SkyParameters};
use crate::world::{InScattering, Sun, WorldLight};
use glam::{DVec3, Vec3, Vec4};
use squall_formats::units::Radians;
use std::f64::consts::{FRAC_PI_2, PI};

/// The map of all directions: columns and rows, 1.9° apart.
pub(crate) const SIZE: [usize; 2] = [193, 97];

/// Sky, cloud and ground in all directions from `eye`, coarsely; `spacing` says where directions may be interpolated.
pub fn look_around(eye: DVec3, spacing: Spacing, beyond: &Beyond<'_>) -> Environment {
    let window = EnvironmentWindow {
        heading: Radians(0.0),
        half_width: Radians(PI),
        bottom: Radians(-FRAC_PI_2),
        top: Radians(FRAC_PI_2),
        size: SIZE,
    };
    let from_eye = |direction: Vec3| beyond(&Ray { origin: eye, direction: direction.as_dvec3() });
    Environment::looked_at(window, spacing, &from_eye)
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

/// The world around `eye`, and what the rain is lit by.
pub fn seen(
    (sky, cloud): (&Sky, Option<&CloudPicture<'_>>),
    (eye, spacing): (DVec3, Spacing),
    beyond: &Beyond<'_>,
) -> (Environment, WorldLight) {
    let around = look_around(eye, spacing, beyond);
    let light = light_of(&around, sun_of(sky, cloud, eye));
    (around, light)
}

/// How closely a frame looks at the world around: what rain shows of it is blurred, but all of it is.
pub fn spacing_of(sky: Spacing) -> Spacing {
    Spacing { tolerance: 0.25 * sky.tolerance, ..sky }
}

/// What a world was looked at for: sky, billows, eye and how closely, and the cloud's lit cells.
type SeenFor<'a> = (&'a SkyParameters, &'a DetailParameters, (DVec3, Spacing), &'a [Vec4]);

/// The world around the eye, kept while nothing of it changes: rain falls and streets shine under the same light for many frames.
pub struct Surrounding {
    sky: SkyParameters,
    detail: DetailParameters,
    eye: (DVec3, Spacing),
    cells: Vec<Vec4>,
    /// The map of all directions.
    pub around: Environment,
    /// What the rain is lit by.
    pub light: WorldLight,
    /// What a phase function makes of it and of the sun, without flashes; the last few.
    spread: Vec<(SunSeen, InScattering)>,
}

/// How the sun is seen from the rain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SunSeen {
    /// Behind rain of this optical depth.
    Behind(f64),
    /// Not at all: it is looked for along each ray.
    Apart,
}

/// Phase functions that are kept: the drops', the mirrors' where they have another, and the medium's without the sun.
const MOST_PHASES: usize = 3;

impl Surrounding {
    /// The world as `look` sees it, or `kept` if that was seen for the same.
    pub fn of(
        kept: Option<Self>,
        (sky, detail, eye, cells): SeenFor<'_>,
        look: impl FnOnce() -> (Environment, WorldLight),
    ) -> Self {
        let same = |kept: &Self| {
            kept.sky == *sky && kept.detail == *detail && kept.eye == eye && kept.cells == cells
        };
        match kept {
            Some(kept) if same(&kept) => kept,
            _ => {
                let (around, light) = look();
                let (sky, cells) = (sky.clone(), cells.to_vec());
                Self { sky, detail: *detail, eye, cells, around, light, spread: Vec::new() }
            }
        }
    }

    /// What scatterers with this phase function show of it, without flashes.
    pub fn in_scattering(&mut self, phase: &Phase, sun: SunSeen) -> InScattering {
        let same = |known: &&(SunSeen, InScattering)| known.0 == sun && known.1.phase() == phase;
        if let Some((_, known)) = self.spread.iter().find(same) {
            return known.clone();
        }
        if self.spread.len() == MOST_PHASES {
            self.spread.remove(0);
        }
        let new = match sun {
            SunSeen::Behind(depth) => self.light.in_scattering_behind(phase, depth),
            SunSeen::Apart => self.light.clone().with_sun(None).in_scattering(phase),
        };
        self.spread.push((sun, new.clone()));
        new
    }
}
