//! What light a drop sends to the camera.

use crate::camera::Ray;
use crate::phase::henyey_greenstein;
use glam::DVec3;
use squall_formats::drops::Optics;

/// Answers what radiance a drop shows. Closures of the same shape are lights too.
pub trait RainLight: Sync {
    /// Radiance of a drop at `distance` metres along the camera's ray, W/(m² sr) per colour.
    fn radiance(&self, ray: &Ray, distance: f64) -> [f32; 3];

    /// How far a drop there shows its pattern: 0 in an even world, where a drop cannot be seen, to 1, where its light is as uneven as
    /// the scenes that patterns are made in. The rest of its light is even over its disc. A light that says nothing of it has 1.
    fn contrast(&self, _ray: &Ray, _distance: f64) -> f32 {
        1.0
    }

    /// The one light that counts most for the look of a drop there; none under an even sky. It picks patterns, and adds no light.
    fn main_light(&self, _ray: &Ray, _distance: f64) -> Option<MainLight> {
        None
    }
}

/// The least deviation of a world's radiance over its mean at which drops show all of their patterns: that of a sky three times as
/// bright as the ground, less than any overcast sky has over soil or asphalt.
pub const UNEVEN: f64 = 0.5;

/// [`RainLight::contrast`] of a world whose radiance has this mean and standard deviation over the sphere, and of lights that come
/// to `irradiance` together.
pub(crate) fn contrast_of(mean: f64, deviation: f64, irradiance: f64) -> f32 {
    let around = std::f64::consts::PI * mean.max(0.0);
    let all = around + irradiance;
    if all <= 0.0 || !all.is_finite() {
        return 1.0;
    }
    let world = if mean > 0.0 { (deviation / (UNEVEN * mean)).min(1.0) } else { 0.0 };
    ((irradiance + around * world) / all) as f32
}

/// A light among all that lights a drop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MainLight {
    /// Unit vector from the drop to it.
    pub towards: DVec3,
    /// Its share in the irradiance of all, 0 to 1.
    pub share: f64,
}

impl MainLight {
    /// A light of `irradiance` under an even sky of mean radiance `around`; none where it has no share.
    pub fn new(towards: DVec3, irradiance: f64, around: f64) -> Option<Self> {
        let share = irradiance / (irradiance + std::f64::consts::PI * around.max(0.0));
        (share > 0.0 && share.is_finite()).then_some(Self { towards, share })
    }
}

impl<F: Fn(&Ray, f64) -> [f32; 3] + Sync> RainLight for F {
    fn radiance(&self, ray: &Ray, distance: f64) -> [f32; 3] {
        self(ray, distance)
    }
}

/// A scene in three radiances and a flash, for frames whose world nobody knows better; where one does, a
/// [`crate::world::InScattering`] lights drops and medium alike.
///
/// A drop is a strong, upside-down wide-angle lens: half of its disc shows what lies within 25° of the line of
/// sight, 80 % what lies within 45°, the rim what lies beyond. This environment keeps of that what a streak
/// shows after blurring: a level view mixes the scene behind the drop with sky and ground, a view up or down
/// sees nothing but sky or ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Surroundings {
    /// Radiance from above the horizon, W/(m² sr).
    pub above: [f32; 3],
    /// Radiance from below it, W/(m² sr).
    pub below: [f32; 3],
    /// Radiance of what stands around the horizon, behind the rain, W/(m² sr).
    pub behind: [f32; 3],
    /// Irradiance of a flash or the sun across its beam, W/m².
    pub flash_irradiance: [f32; 3],
    /// Unit vector in which the flash's light travels.
    pub flash_direction: DVec3,
}

impl Surroundings {
    /// Share of a level streak that shows what stands around the horizon; the rest is half sky, half ground.
    const HORIZON_SHARE: f64 = 0.4;
}

fn mean(light: &[f32; 3]) -> f64 {
    light.iter().map(|&band| f64::from(band)).sum::<f64>() / 3.0
}

impl RainLight for Surroundings {
    fn main_light(&self, _ray: &Ray, _distance: f64) -> Option<MainLight> {
        let around = 0.5 * (mean(&self.above) + mean(&self.below));
        MainLight::new(-self.flash_direction, mean(&self.flash_irradiance), around)
    }

    fn contrast(&self, _ray: &Ray, _distance: f64) -> f32 {
        let [above, below, behind, flash] =
            [&self.above, &self.below, &self.behind, &self.flash_irradiance].map(mean);
        let middle = (above + below + behind) / 3.0;
        let square = |value: f64| (value - middle) * (value - middle);
        let deviation = ((square(above) + square(below) + square(behind)) / 3.0).sqrt();
        contrast_of(middle, deviation, flash)
    }

    fn radiance(&self, ray: &Ray, _distance: f64) -> [f32; 3] {
        let rise = ray.direction.z.clamp(-1.0, 1.0);
        let horizon = Self::HORIZON_SHARE * (1.0 - rise * rise);
        let above = 0.5 * (1.0 + rise) * (1.0 - horizon);
        let below = 0.5 * (1.0 - rise) * (1.0 - horizon);
        // A drop scatters E π D²/4 p(θ) per steradian out of its disc of π D²/4.
        let flash = if self.flash_irradiance == [0.0; 3] {
            0.0
        } else {
            henyey_greenstein(Optics::GEOMETRIC.asymmetry, -ray.direction.dot(self.flash_direction))
        };
        std::array::from_fn(|i| {
            (above * f64::from(self.above[i])
                + below * f64::from(self.below[i])
                + horizon * f64::from(self.behind[i])
                + flash * f64::from(self.flash_irradiance[i])) as f32
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drop_radiance(environment: &Surroundings, direction: DVec3) -> f32 {
        environment.radiance(&Ray { origin: DVec3::ZERO, direction }, 1.0)[0]
    }

    #[test]
    fn in_an_even_scene_drops_are_invisible() {
        let even = Surroundings { above: [2.0; 3], below: [2.0; 3], behind: [2.0; 3], ..Default::default() };
        for direction in [DVec3::X, DVec3::Z, -DVec3::Z, DVec3::new(0.6, 0.0, 0.8)] {
            assert!((drop_radiance(&even, direction) - 2.0).abs() < 1e-6);
        }
    }

    #[test]
    fn looking_up_shows_sky_alone_and_a_flash_is_brightest_against_the_light() {
        let scene = Surroundings { above: [3.0; 3], below: [1.0; 3], behind: [0.5; 3], ..Default::default() };
        assert_eq!(drop_radiance(&scene, DVec3::Z), 3.0);
        assert_eq!(drop_radiance(&scene, -DVec3::Z), 1.0);
        let flash =
            Surroundings { flash_irradiance: [1.0; 3], flash_direction: DVec3::X, ..Default::default() };
        assert!(drop_radiance(&flash, -DVec3::X) > 10.0 * drop_radiance(&flash, DVec3::X));
    }

    #[test]
    fn an_even_world_shows_no_pattern_and_a_lone_light_all_of_it() {
        assert_eq!(contrast_of(2.0, 0.0, 0.0), 0.0);
        assert_eq!(contrast_of(0.0, 0.0, 3.0), 1.0);
        // A sky three times as bright as the ground has a deviation of half its mean.
        assert_eq!(contrast_of(2.0, 1.0, 0.0), 1.0);
        assert!((contrast_of(2.0, 0.5, 0.0) - 0.5).abs() < 1e-6);
        // Half of a sun's light and half of an even sky's: half of the pattern.
        assert!((contrast_of(1.0, 0.0, std::f64::consts::PI) - 0.5).abs() < 1e-6);
        let world =
            crate::world::WorldLight::from_radiance(&|d| [if d.z > 0.0 { 3.0 } else { 1.0 }; 3], None);
        let seen = world.in_scattering(&crate::medium::Phase::HenyeyGreenstein(0.77));
        // Degree 20 keeps all but 1 % of a horizon's square.
        assert!((seen.contrast_beside(0.0) - 1.0).abs() < 0.02, "{}", seen.contrast_beside(0.0));
    }
}
