//! The loss of visibility: rain too far or too fine for streaks, as a medium. \[weber\] §3.2, corrected.
//!
//! L = L₀ F + L_in, F = e^{−τ}, L_in = J (1 − F). J = p(θ) E for a distant light of irradiance E (p
//! normalised, \[weber\] eq. 12), plus the ambient radiance, which an albedo of 1 hands on as it is.
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
//! | E      | `irradiance`   | W/m² |

use crate::camera::{Camera, Projection, Ray};
use crate::depth::DepthBuffer;
use crate::error::RuntimeError;
use crate::parallel::prelude::*;
use crate::phase::{henyey_greenstein, paper_henyey_greenstein};
use crate::picture::Picture;
use crate::rain::{RainPath, RainVolume, Shot};
use glam::DVec3;
use squall_formats::drops::{self, Optics, paper};
use squall_formats::section::density::{DensitySection, Mode};
use squall_formats::units::{MillimetresPerHour, PerKilometre, PerMetre};

/// How the medium spreads light.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Phase {
    /// Henyey and Greenstein's function with this asymmetry.
    HenyeyGreenstein(f64),
    /// The same as \[weber\] eq. 10 prints it, which loses light.
    Paper(f64),
}

impl Phase {
    /// Value for a cosine between travel directions, 1/sr.
    pub fn value(&self, cos_theta: f64) -> f64 {
        match *self {
            Self::HenyeyGreenstein(g) => henyey_greenstein(g, cos_theta),
            Self::Paper(g) => paper_henyey_greenstein(g, cos_theta),
        }
    }

    /// Legendre moment χ_l = 2π ∫ p(μ) P_l(μ) dμ: what blurring by it leaves of degree l of a function on the sphere.
    pub fn moment(&self, degree: usize) -> f64 {
        let power = |g: f64| (0..degree).fold(1.0, |product, _| product * g);
        match *self {
            Self::HenyeyGreenstein(g) => power(g),
            Self::Paper(g) => power(g) * (1.0 - g) / (1.0 + g),
        }
    }
}

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

/// Light that the medium scatters toward the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Illumination {
    /// Irradiance of a distant light across its beam, W/m² per colour.
    pub irradiance: [f32; 3],
    /// Unit vector in which that light travels.
    pub direction: DVec3,
    /// Radiance that comes from everywhere, W/(m² sr) per colour: an overcast sky's mean.
    pub ambient: [f32; 3],
}

/// What a camera sees through the medium, and in what light.
#[derive(Clone, Debug)]
pub struct Outlook<'a, V = RainVolume> {
    /// The camera.
    pub camera: &'a Camera,
    /// Where it rains.
    pub volume: V,
    /// What light the rain is in.
    pub light: Illumination,
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
            extinction: drops::extinction(rate, optics.efficiency).into(),
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
        let place = section.place(rate).ok_or_else(|| {
            let wanted = format!("0 to {} mm/h, the range of this asset's rain", section.largest_rate().0);
            RuntimeError::argument("rate", wanted, rate.0)
        })?;
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
        let drawn: f64 = self.drawn.iter().map(|s| s.extinction * (depth.min(s.far) - s.near).max(0.0)).sum();
        // Shells hold less than all drops, so only round-off can fall below zero.
        (secant * (self.extinction.0 * depth - drawn)).max(0.0)
    }

    /// [`Medium::optical_depth`] in bounded rain, along `ray` from the camera to distance `secant * depth`.
    pub fn optical_depth_in<V: RainPath>(&self, volume: &V, ray: &Ray, depth: f64, secant: f64) -> f64 {
        if volume.is_everywhere() {
            return self.optical_depth(depth, secant);
        }
        if self.extinction.0 == 0.0 || depth <= 0.0 {
            return 0.0;
        }
        let distance = depth * secant;
        let drawn: f64 = match self.drawn.iter().map(|shell| shell.far).fold(0.0, f64::max) {
            0.0 => 0.0,
            far if volume.fills(ray.origin, far * secant) => {
                let shells = self.drawn.iter();
                secant * shells.map(|s| s.extinction * (depth.min(s.far) - s.near).max(0.0)).sum::<f64>()
            }
            _ => {
                let path = |s: &Shell| volume.path(ray, s.near * secant, distance.min(s.far * secant));
                self.drawn.iter().map(|s| s.extinction * path(s)).sum()
            }
        };
        (self.extinction.0 * volume.path(ray, 0.0, distance) - drawn).max(0.0)
    }

    /// The light that fully opaque rain would show along a ray: J, W/(m² sr) per colour.
    pub fn source(&self, light: &Illumination, view: DVec3) -> [f32; 3] {
        // Scattered light travels against the viewing direction.
        let phase =
            if light.irradiance == [0.0; 3] { 0.0 } else { self.phase.value(-view.dot(light.direction)) };
        std::array::from_fn(|i| (phase * f64::from(light.irradiance[i]) + f64::from(light.ambient[i])) as f32)
    }

    /// Attenuates `picture` and adds the light scattered in; writes each pixel's transmittance F.
    ///
    /// Without a depth buffer, all is sky; sky is infinitely far, so in rain without bounds it vanishes and
    /// in a finite `volume` it does not. Rows are spread over the caller's rayon pool.
    ///
    /// Where the depth buffer has holes ([`crate::depth::DepthHoles`]) that are to be left alone, the pixel keeps its light and F
    /// is 1. Answers how many holes there were, filled ones included.
    ///
    /// Errors: an orthographic camera; a picture, depth buffer or transmittance of another size than the
    /// camera's.
    pub fn apply<V: RainPath>(
        &self,
        outlook: &Outlook<V>,
        picture: &mut Picture,
        transmittance: &mut [f32],
    ) -> Result<usize, RuntimeError> {
        let Outlook { camera, volume, light, depth } = outlook;
        let (width, height) = (camera.width as usize, camera.height as usize);
        if !matches!(camera.projection, Projection::Perspective { .. }) {
            return Err(RuntimeError::argument("rain camera", "a perspective camera", "an orthographic one"));
        }
        if (picture.width, picture.height) != (width, height) || picture.pixels.len() != width * height {
            let found = format!("{} × {}", picture.width, picture.height);
            return Err(RuntimeError::argument("picture", format!("the camera's {width} × {height}"), found));
        }
        if transmittance.len() != width * height {
            let wanted = format!("{} pixels", width * height);
            return Err(RuntimeError::argument("transmittance", wanted, transmittance.len()));
        }
        if let Some(depth) = depth {
            depth.check_size(width, height)?;
        }
        let secants = camera.secants();
        let row = |(y, (pixels, transmittance)): (usize, (&mut [[f32; 3]], &mut [f32]))| {
            for (x, (pixel, transmittance)) in pixels.iter_mut().zip(transmittance).enumerate() {
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let secant = secants.at(px, py);
                let planar = match depth {
                    Some(depth) => depth.known(x, y, || secant),
                    None => Some(f64::INFINITY),
                };
                let Some(planar) = planar else {
                    *transmittance = 1.0;
                    continue;
                };
                let ray = camera.ray_with(&secants, px, py);
                let left = libm::exp(-self.optical_depth_in(volume, &ray, planar, secant)) as f32;
                let source = self.source(light, ray.direction);
                for colour in 0..3 {
                    // A hidden sky contributes nothing, even where it is infinitely bright.
                    let behind = if left > 0.0 { pixel[colour] * left } else { 0.0 };
                    pixel[colour] = behind + source[colour] * (1.0 - left);
                }
                *transmittance = left;
            }
        };
        let rows = picture.pixels.par_chunks_mut(width).zip(transmittance.par_chunks_mut(width));
        rows.enumerate().for_each(row);
        Ok(depth.as_ref().map_or(0, DepthBuffer::holes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rain::Ceiling;
    use squall_formats::units::{Metres, Radians};

    const HEAVY: MillimetresPerHour = MillimetresPerHour(25.0);

    fn camera() -> Camera {
        let projection = Projection::Perspective { vertical_fov: Radians(1.0) };
        Camera::new(DVec3::Z * 2.0, DVec3::X, DVec3::Z, projection, [40, 30]).unwrap()
    }

    fn apply(medium: &Medium, volume: &RainVolume, metres: &[f32]) -> (Picture, Vec<f32>) {
        use crate::depth::DepthKind;
        let light = Illumination { ambient: [1.0; 3], ..Default::default() };
        let camera = camera();
        let mut picture = Picture::new(40, 30).unwrap();
        picture.pixels.fill([5.0; 3]);
        let mut left = vec![0.0; 1200];
        let depth = DepthBuffer::new(metres, 40, 30, DepthKind::Range).unwrap();
        let outlook = Outlook { camera: &camera, volume: *volume, light, depth: Some(depth) };
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
        assert!(left.iter().all(|&v| v == 0.0) && picture.pixels.iter().all(|p| p[0] == 1.0));
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
        let beam = |direction| Illumination { irradiance: [1.0; 3], direction, ambient: [0.0; 3] };
        let [ahead, behind] = [-DVec3::X, DVec3::X].map(|d| medium.source(&beam(d), DVec3::X)[0]);
        assert!(ahead > 100.0 * behind);
        // [weber] eq. 10 as printed loses a factor (1 + g)/(1 − g), 19 at g = 0.9.
        let printed = Medium { phase: Phase::Paper(0.9), ..medium.clone() };
        let right = Medium { phase: Phase::HenyeyGreenstein(0.9), ..medium };
        let ratio = right.source(&beam(DVec3::Y), DVec3::X)[0] / printed.source(&beam(DVec3::Y), DVec3::X)[0];
        assert!((ratio - 19.0).abs() < 1e-3);
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
