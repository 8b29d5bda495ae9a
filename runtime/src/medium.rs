//! The loss of visibility: rain too far or too fine for streaks, as a medium. \[weber\] §3.2, corrected.
//!
//! L = L₀ F + L_in, F = e^{−τ}, L_in = J (1 − F). J is the world's radiance blurred by the phase function, the sun's by \[weber\]
//! eq. 12, p(θ) E with p normalised ([`crate::world`]), or behind rain of its own: [`Phase::values_behind`].
//!
//! Streaks and medium are the same drops. A streak's coverage is a drop's disc, so its expected optical depth is
//! the extinction with Q = 1; beside drawn streaks the medium uses Q = 1 too and leaves out, class by class,
//! the shell of distances in which streaks are drawn. Shells are bounded by planar depth, so for every
//! pixel the same function of planar depth, times the secant of the pixel's ray, is the optical depth.
//!
//! | symbol | name           | unit |
//! | τ      | optical depth  | –    |
//! | β      | `extinction`   | 1/m  |
//! | z      | planar depth   | m    |

mod apply;
mod beam;
mod choice;
mod drops;
mod phase;
#[cfg(feature = "gpu")]
mod upload;

pub use choice::{MediumChoice, MediumForm, PhaseChoice};
pub use drops::PhaseTable;
pub use phase::Phase;

use crate::camera::{Camera, Ray};
use crate::depth::DepthBuffer;
use crate::error::RuntimeError;
use crate::rain::{RainPath, RainVolume, Shot};
use crate::world::{InScattering, WorldLight};
use squall_formats::drops::{self as rain_drops, Optics, paper};
use squall_formats::section::density::{AxisPlace, DensitySection, Mode};
use squall_formats::units::{MillimetresPerHour, PerKilometre, PerMetre, Seconds};

/// One class's shell of depths in which its drops are drawn as streaks, and the extinction they would have had.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shell {
    extinction: f64,
    near: f64,
    far: f64,
}

/// Rain as a medium.
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    extinction: PerMetre,
    phase: Phase,
    drawn: Vec<Shell>,
}

/// What a camera sees through the medium, and in what light.
#[derive(Clone, Debug)]
pub struct Outlook<'a, V = RainVolume> {
    /// The camera.
    pub camera: &'a Camera,
    /// Where it rains.
    pub volume: V,
    /// What light the rain is in: [`Medium::in_scattering`] of the world's.
    pub light: &'a InScattering,
    /// Depth of the scene; `None` is open sky.
    pub depth: Option<DepthBuffer<'a>>,
}

impl Medium {
    /// All rain as medium, no streaks beside it: Q = 2 and its asymmetry.
    pub fn whole(rate: MillimetresPerHour) -> Self {
        Self::of(rate, Optics::WHOLE)
    }

    /// All rain as medium without diffraction, which no pixel resolves: Q = 1 and its asymmetry.
    pub fn geometric(rate: MillimetresPerHour) -> Self {
        Self::of(rate, Optics::GEOMETRIC)
    }

    fn of(rate: MillimetresPerHour, optics: Optics) -> Self {
        Self {
            extinction: rain_drops::extinction(rate, optics.efficiency).into(),
            phase: Phase::HenyeyGreenstein(optics.asymmetry),
            drawn: Vec::new(),
        }
    }

    /// The paper's medium: \[weber\] eq. 9 for the extinction and eq. 10 as printed, with the reader's own g.
    pub fn paper(rate: MillimetresPerHour, g: f64) -> Self {
        Self { extinction: paper::extinction(rate).into(), phase: Phase::Paper(g), drawn: Vec::new() }
    }

    /// The medium beside the streaks that `shot` draws at `rate`: Q = 1, less each class's drawn shell.
    ///
    /// What a class leaves out in all is exact for its continuous sizes; inside its shell its drops share
    /// one near and one far distance. Errors: as [`Shot::view`]; a rate outside 0 to the table's largest.
    pub fn beside_streaks(
        section: &DensitySection,
        shot: &Shot,
        rate: MillimetresPerHour,
    ) -> Result<Self, RuntimeError> {
        let view = shot.view()?;
        let mut medium = Self::geometric(rate);
        if rate.0 == 0.0 {
            return Ok(medium);
        }
        let place = placed(section, rate)?;
        let table = section.table(Mode::Default);
        for class in 0..table.classes.len() {
            let moments = table.moments(&place, class);
            // mm² per m³ is 1e-6 per metre.
            let extinction = std::f64::consts::FRAC_PI_4 * moments.area * 1e-6;
            if extinction <= 0.0 {
                continue;
            }
            // The length that, times the class's area, is ∫ N D² L dD: then thickness × extinction is exact.
            let length = moments.area_times_length(shot.exposure) / moments.area;
            let [near, far] = [shot.max_px, shot.min_px].map(|px| length * view.focal_px() / px);
            medium.drawn.push(Shell { extinction, near, far });
        }
        Ok(medium)
    }

    /// How fast drops of this rain fall, the mean over what they cover, m/s; nothing where there is no rain.
    ///
    /// Errors: as [`Medium::beside_streaks`].
    pub fn fall_speed(section: &DensitySection, rate: MillimetresPerHour) -> Result<f64, RuntimeError> {
        if rate.0 == 0.0 {
            return Ok(0.0);
        }
        let place = placed(section, rate)?;
        let table = section.table(Mode::Default);
        let (mut covered, mut fallen) = (0.0, 0.0);
        for class in 0..table.classes.len() {
            let moments = table.moments(&place, class);
            let length = |seconds: f64| moments.area_times_length(Seconds(seconds));
            covered += moments.area;
            fallen += length(1.0) - length(0.0);
        }
        Ok(if covered > 0.0 { fallen / covered } else { 0.0 })
    }

    /// Extinction where nothing is drawn.
    pub fn extinction(&self) -> PerMetre {
        self.extinction
    }

    /// The same in the unit that rain papers print.
    pub fn extinction_per_km(&self) -> PerKilometre {
        self.extinction.into()
    }

    /// Optical depth of unbounded rain between the camera and planar depth `depth` on a ray whose length is
    /// `secant` times its planar depth; +∞ for a ray that never ends.
    pub fn optical_depth(&self, depth: f64, secant: f64) -> f64 {
        // With no extinction an endless path is still clear: 0 × ∞ is no number.
        if self.extinction.0 == 0.0 || depth <= 0.0 {
            return 0.0;
        }
        // Shells hold less than all drops, so only round-off can fall below zero.
        (secant * (self.extinction.0 * depth - self.drawn_in_even_rain(depth))).max(0.0)
    }

    /// Optical depth of the drops that are drawn, straight ahead up to planar depth `depth` in unbounded rain.
    fn drawn_in_even_rain(&self, depth: f64) -> f64 {
        self.drawn.iter().map(|s| s.extinction * (depth.min(s.far) - s.near).max(0.0)).sum()
    }

    /// The same in bounded rain, along `ray` from the camera to distance `secant * depth`.
    fn drawn_in<V: RainPath>(&self, volume: &V, ray: &Ray, depth: f64, secant: f64) -> f64 {
        match self.drawn.iter().map(|shell| shell.far).fold(0.0, f64::max) {
            0.0 => 0.0,
            far if volume.fills(ray.origin, far * secant) => secant * self.drawn_in_even_rain(depth),
            _ => {
                let distance = depth * secant;
                let piece = |s: &Shell| [s.extinction, s.near * secant, distance.min(s.far * secant)];
                volume.weighted(ray, &mut self.drawn.iter().map(piece))
            }
        }
    }

    /// [`Medium::optical_depth`] in bounded rain, along `ray` from the camera to distance `secant * depth`.
    pub fn optical_depth_in<V: RainPath>(&self, volume: &V, ray: &Ray, depth: f64, secant: f64) -> f64 {
        if volume.is_everywhere() {
            return self.optical_depth(depth, secant);
        }
        if self.extinction.0 == 0.0 || depth <= 0.0 {
            return 0.0;
        }
        let drawn = self.drawn_in(volume, ray, depth, secant);
        (self.extinction.0 * volume.path(ray, 0.0, depth * secant) - drawn).max(0.0)
    }

    /// What the medium shows of the world's light, for all directions; the sun and the sky's harmonics in it.
    pub fn in_scattering(&self, world: &WorldLight) -> InScattering {
        world.in_scattering(&self.phase)
    }

    /// How it spreads light.
    pub fn phase(&self) -> &Phase {
        &self.phase
    }

    /// The same medium with another phase function.
    #[must_use]
    pub fn with_phase(self, phase: Phase) -> Self {
        Self { phase, ..self }
    }
}

/// Where a rate lies in a section's tables.
///
/// Errors: a rate outside of them.
fn placed(section: &DensitySection, rate: MillimetresPerHour) -> Result<AxisPlace, RuntimeError> {
    section.place(rate).ok_or_else(|| {
        let wanted = format!("0 to {} mm/h, the range of this asset's rain", section.largest_rate().0);
        RuntimeError::argument("rate", wanted, rate.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Projection;
    use crate::picture::Picture;
    use crate::rain::Ceiling;
    use crate::world::Beam;
    use glam::DVec3;
    use squall_formats::units::{Metres, Radians};

    const HEAVY: MillimetresPerHour = MillimetresPerHour(25.0);

    fn camera() -> Camera {
        let projection = Projection::Perspective { vertical_fov: Radians(1.0) };
        Camera::new(DVec3::Z * 2.0, DVec3::X, DVec3::Z, projection, [40, 30]).unwrap()
    }

    fn apply(medium: &Medium, volume: &RainVolume, metres: &[f32]) -> (Picture, Vec<f32>) {
        use crate::depth::DepthKind;
        let light = medium.in_scattering(&WorldLight::uniform([1.0; 3]));
        let camera = camera();
        let mut picture = Picture::new(40, 30).unwrap();
        picture.pixels.fill([5.0; 3]);
        let mut left = vec![0.0; 1200];
        let depth = DepthBuffer::new(metres, 40, 30, DepthKind::Range).unwrap();
        let outlook = Outlook { camera: &camera, volume: *volume, light: &light, depth: Some(depth) };
        medium.apply(&outlook, &mut picture, &mut left).unwrap();
        (picture, left)
    }

    #[test]
    fn a_kilometre_of_heavy_rain_leaves_what_beer_and_lambert_say() {
        let (picture, left) = apply(&Medium::whole(HEAVY), &RainVolume::default(), &[1000.0; 1200]);
        let wanted = libm::exp(-2.7707);
        for (pixel, left) in picture.pixels.iter().zip(left) {
            assert!((f64::from(left) / wanted - 1.0).abs() < 1e-4);
            assert!((pixel[0] - (5.0 * left + 1.0 - left)).abs() < 1e-6);
        }
        assert!((Medium::paper(HEAVY, 0.9).extinction_per_km().0 - 2.70).abs() < 5e-3);
        assert!((Medium::geometric(HEAVY).extinction().0 * 2.0 - 2.7707e-3).abs() < 1e-6);
    }

    #[test]
    fn endless_rain_hides_the_sky_and_a_ceiling_leaves_some() {
        let sky = vec![f32::INFINITY; 1200];
        let (picture, left) = apply(&Medium::whole(HEAVY), &RainVolume::default(), &sky);
        assert!(left.iter().all(|&v| v == 0.0) && picture.pixels.iter().all(|p| (p[0] - 1.0).abs() < 1e-6));
        let ceiling = Some(Ceiling { height: Metres(500.0), softness: Metres(100.0) });
        let (_, left) = apply(&Medium::whole(HEAVY), &RainVolume { ceiling, region: None }, &sky);
        assert!(left[20] > 0.0 && left[20 + 29 * 40] == 0.0 && left[20] > left[20 + 10 * 40]);
    }

    #[test]
    fn no_rain_changes_nothing_even_without_end() {
        let sky = vec![f32::INFINITY; 1200];
        let (picture, left) = apply(&Medium::whole(MillimetresPerHour(0.0)), &RainVolume::default(), &sky);
        assert!(left.iter().all(|&v| v == 1.0) && picture.pixels.iter().all(|p| *p == [5.0; 3]));
    }

    #[test]
    fn light_from_ahead_is_scattered_on_and_light_from_behind_is_not() {
        let medium = Medium::geometric(HEAVY);
        let lit = |medium: &Medium, towards| {
            let beam = Beam { towards, irradiance: [1.0; 3] };
            medium.in_scattering(&WorldLight::default()).with_beam(beam).radiance(DVec3::X)[0]
        };
        let [ahead, behind] = [DVec3::X, -DVec3::X].map(|towards| lit(&medium, towards));
        assert!(ahead > 100.0 * behind);
        // [weber] eq. 10 as printed loses a factor (1 + g)/(1 − g), 19 at g = 0.9.
        let printed = medium.clone().with_phase(Phase::Paper(0.9));
        let right = medium.with_phase(Phase::HenyeyGreenstein(0.9));
        assert!((lit(&right, DVec3::Y) / lit(&printed, DVec3::Y) - 19.0).abs() < 1e-3);
    }

    #[test]
    fn a_shell_is_left_out_as_far_as_the_ray_goes() {
        let drawn = vec![Shell { extinction: 0.5, near: 2.0, far: 6.0 }];
        let medium = Medium { extinction: PerMetre(1.0), phase: Phase::HenyeyGreenstein(0.0), drawn };
        assert_eq!(medium.optical_depth(1.0, 1.0), 1.0);
        assert_eq!(medium.optical_depth(4.0, 1.5), 1.5 * (4.0 - 1.0));
        assert_eq!(medium.optical_depth(10.0, 1.0), 10.0 - 2.0);
        assert_eq!(medium.optical_depth(f64::INFINITY, 1.0), f64::INFINITY);
        let ray = Ray { origin: DVec3::ZERO, direction: DVec3::X };
        for height in [1000.0, 0.5] {
            let ceiling = Some(Ceiling { height: Metres(height), softness: Metres(0.0) });
            let volume = RainVolume { ceiling, region: None };
            let found = medium.optical_depth_in(&volume, &ray, 4.0, 1.5);
            assert!((found - medium.optical_depth(4.0, 1.5)).abs() < 1e-12);
        }
    }
}
