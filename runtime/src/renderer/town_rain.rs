//! The frame's rain between places of the town, and on the way of lamps to the eye.

use crate::camera::Ray;
use crate::math::exp_neg;
use crate::medium::Medium;
use crate::rain::{RainField, RainPath};
use crate::shade::town::rain::RainBetween;
use crate::world::InScattering;
use glam::{DVec3, Vec3};
use squall_formats::units::MillimetresPerHour;

/// Rain of a frame, none of whose drops is drawn on the ways that it is asked for.
pub struct TownRain<'a> {
    medium: Medium,
    field: RainField<'a>,
    light: &'a InScattering,
}

impl<'a> TownRain<'a> {
    /// Rain of this rate in this field, lit by the world as the frame's medium is.
    pub fn new(rate: MillimetresPerHour, field: RainField<'a>, light: &'a InScattering) -> Self {
        Self { medium: Medium::geometric(field.rate(rate)), field, light }
    }

    fn share(&self, from: DVec3, direction: DVec3, metres: f64) -> f32 {
        let extinction = self.medium.extinction().0;
        if extinction == 0.0 {
            return 1.0;
        }
        let ray = Ray { origin: from, direction };
        let depth = match metres <= self.field.filled_radius(from) && metres <= self.field.farthest() {
            true => extinction * metres,
            false => self.medium.optical_depth_in(&self.field, &ray, metres, 1.0),
        };
        exp_neg(depth as f32)
    }
}

impl RainBetween for TownRain<'_> {
    fn left(&self, from: Vec3, to: Vec3) -> f32 {
        let way = to.as_dvec3() - from.as_dvec3();
        let metres = way.length();
        if metres == 0.0 { 1.0 } else { self.share(from.as_dvec3(), way / metres, metres) }
    }

    fn along(&self, from: Vec3, direction: Vec3, metres: f32) -> (f32, [f32; 3]) {
        let direction = direction.as_dvec3();
        let left = self.share(from.as_dvec3(), direction, f64::from(metres));
        let added = if left < 1.0 { self.light.radiance(direction) } else { [0.0; 3] };
        (left, added.map(|value| value * (1.0 - left)))
    }
}
