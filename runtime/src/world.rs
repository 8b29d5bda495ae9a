//! The world's light, as everything that scatters takes it: rain, fog, drops. The picture has no say in it, so that turning
//! the camera changes nothing.
//!
//! What a direction d of rain shows is J(d) = ∫ p(θ) L(ω) dω, cos θ = d · ω: the world's radiance L, blurred by the phase
//! function p. A blur that looks the same in all directions multiplies each degree of spherical harmonics by one number,
//! χ_l = 2π ∫ p(μ) P_l(μ) dμ (g^l for Henyey and Greenstein), so L is projected once per weather and J is a sum. The sun
//! is a beam and has its closed form, E p(θ) (\[weber\] eq. 12); so has a flash.
//!
//! | symbol | name         | unit      |
//! | L, J   | radiance     | W/(m² sr) |
//! | E      | `irradiance` | W/m²      |
//! | p      | [`Phase`]    | 1/sr      |

pub(crate) mod degrees;
mod estimate;
mod stored;
#[cfg(feature = "gpu")]
pub(crate) mod upload;

use crate::camera::Ray;
use crate::medium::Phase;
use crate::octahedron::{fold, unfold};
use crate::parallel::prelude::*;
use crate::rain::RainLight;
use crate::rain::light::contrast_of;
use crate::shade::sky::harmonics::Harmonics;
use degrees::{Basis, COUNT, DEGREE};
use glam::{DVec3, Vec3};
use squall_formats::units::Radians;

/// The sun as things on the ground see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector towards the sun.
    pub towards: Vec3,
    /// Irradiance on a surface facing it, W/m² per colour, at the ground, after air and overcast; zero when it is down.
    pub irradiance: [f32; 3],
    /// Half the angle that its disc covers.
    pub angular_radius: Radians,
}

impl Sun {
    /// Half the angle that the sun covers from the Earth at its mean distance, rad.
    pub const ANGULAR_RADIUS: Radians = Radians(4.65e-3);
}

/// What shines on rain from afar: the radiance of the whole sphere, and the sun.
///
/// ```
/// use squall_runtime::medium::Phase;
/// use squall_runtime::world::WorldLight;
/// use squall_runtime::glam::DVec3;
///
/// // Bright above, dark below: rain before the sky is brighter than rain before the ground.
/// let world = WorldLight::from_radiance(&|d| if d.z > 0.0 { [1.0; 3] } else { [0.1; 3] }, None);
/// let rain = world.in_scattering(&Phase::HenyeyGreenstein(0.77));
/// assert!(rain.radiance(DVec3::Z)[0] > 0.9 && rain.radiance(DVec3::NEG_Z)[0] < 0.2);
/// // Where everything is as bright, nothing can be told from it.
/// let even = WorldLight::uniform([2.0; 3]).in_scattering(&Phase::HenyeyGreenstein(0.77));
/// assert!((even.radiance(DVec3::X)[1] - 2.0).abs() < 1e-5);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct WorldLight {
    /// Radiance of the whole sphere in degrees 0 to 2, world axes, the sun's disc left out.
    pub harmonics: Harmonics,
    /// The sun, where it is up.
    pub sun: Option<Sun>,
    /// Degrees above 2, where the world was sampled finely enough to have them; a horizon needs them.
    finer: Vec<[f32; 3]>,
}

impl Default for WorldLight {
    /// No light.
    fn default() -> Self {
        Self::from_harmonics([[0.0; 3]; 9], None)
    }
}

impl WorldLight {
    /// The light of a world whose radiance from unit direction d is `radiance(d)`, W/(m² sr), the sun's disc left out.
    /// Numbers that are not finite count as dark.
    pub fn from_radiance(radiance: &dyn Fn(Vec3) -> [f32; 3], sun: Option<Sun>) -> Self {
        let all = degrees::project(radiance);
        Self { harmonics: std::array::from_fn(|i| all[i]), sun, finer: all[9..].to_vec() }
    }

    /// The light of a world that is known to degree 2 alone.
    pub fn from_harmonics(harmonics: Harmonics, sun: Option<Sun>) -> Self {
        Self { harmonics, sun, finer: Vec::new() }
    }

    /// The same radiance from everywhere, W/(m² sr).
    pub fn uniform(radiance: [f32; 3]) -> Self {
        let mut harmonics = [[0.0; 3]; 9];
        harmonics[0] = radiance.map(|value| value / crate::shade::sky::harmonics::Y0);
        Self::from_harmonics(harmonics, None)
    }

    /// The same world with another sun.
    #[must_use]
    pub fn with_sun(self, sun: Option<Sun>) -> Self {
        Self { sun, ..self }
    }

    /// Mean radiance of the whole sphere, the sun's disc left out, W/(m² sr).
    pub fn mean_radiance(&self) -> [f32; 3] {
        self.harmonics[0].map(|value| value * crate::shade::sky::harmonics::Y0)
    }

    /// What scatterers with this phase function show of the world, prepared for many directions; nothing stands between them and the sun.
    pub fn in_scattering(&self, phase: &Phase) -> InScattering {
        self.in_scattering_behind(phase, 0.0)
    }

    /// The same of scatterers that the sun's light reaches through rain of optical depth `depth` ≥ 0: straight, and scattered
    /// ([`Phase::values_behind`]), the latter to degree [`HIGHEST_DEGREE`].
    pub fn in_scattering_behind(&self, phase: &Phase, depth: f64) -> InScattering {
        let mut blurred = [[0.0f32; 3]; COUNT];
        for (i, value) in self.harmonics.iter().chain(&self.finer).enumerate() {
            let moments = phase.moments(degrees::degree_of(i));
            blurred[i] = std::array::from_fn(|band| value[band] * moments[band] as f32);
        }
        let mut count = if self.finer.is_empty() { 9 } else { COUNT };
        let sun = self.sun.filter(|sun| sun.irradiance != [0.0; 3]);
        let sun = sun.map(|sun| Beam { towards: sun.towards.as_dvec3(), irradiance: sun.irradiance });
        if let Some(sun) = sun.filter(|_| depth > 0.0) {
            let values = Basis::new().values(sun.towards);
            let moments: [f64; HIGHEST_DEGREE + 1] = std::array::from_fn(|l| phase.moments_again(depth, l));
            for (i, value) in blurred.iter_mut().enumerate() {
                let share = (values[i] * moments[degrees::degree_of(i)]) as f32;
                (0..3).for_each(|band| value[band] += share * sun.irradiance[band]);
            }
            count = COUNT;
        }
        let straight = libm::exp(-depth) as f32;
        let dimmed = |sun: Beam| Beam { irradiance: sun.irradiance.map(|band| band * straight), ..sun };
        InScattering {
            map: Map::new(&blurred[..count]),
            phase: phase.clone(),
            beams: sun.into_iter().map(dimmed).collect(),
            sun: sun.map(|sun| (sun, depth)),
            spread: self.spread(),
        }
    }

    /// Mean radiance of the whole sphere and its standard deviation, the sun left out, W/(m² sr), of the three colours' mean.
    pub(crate) fn spread(&self) -> [f64; 2] {
        let grey = |value: &[f32; 3]| value.iter().map(|&band| f64::from(band)).sum::<f64>() / 3.0;
        // Harmonics are orthonormal: squares add up to the square's integral over the sphere.
        let rest = self.harmonics[1..].iter().chain(&self.finer);
        let square: f64 = rest.map(|value| grey(value) * grey(value)).sum();
        [grey(&self.mean_radiance()), (square / (4.0 * std::f64::consts::PI)).sqrt()]
    }
}

/// A distant light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Unit vector towards it.
    pub towards: DVec3,
    /// Irradiance across its beam, W/m² per colour.
    pub irradiance: [f32; 3],
}

/// J: the radiance that fully opaque rain shows in every direction, and that a single drop shows; single scattering of
/// everything that is far away.
///
/// A drop sends E π D²/4 p(θ) per steradian out of its disc of π D²/4: so the radiance of a drop's disc is the medium's J
/// with the phase function of Q = 1.
#[derive(Clone, Debug, PartialEq)]
pub struct InScattering {
    map: Map,
    phase: Phase,
    beams: Vec<Beam>,
    /// The sun before the rain on its way, and the depth of that.
    sun: Option<(Beam, f64)>,
    /// Mean and standard deviation of the world's radiance, beams left out.
    spread: [f64; 2],
}

impl InScattering {
    /// Of a world without light, or of one that nothing looks at through rain.
    pub(crate) fn dark(phase: &Phase) -> Self {
        let side = Map::STEPS + 1;
        let map = Map { texels: vec![[0.0; 3]; side * side] };
        Self { map, phase: phase.clone(), beams: Vec::new(), sun: None, spread: [0.0; 2] }
    }

    /// The same with one more distant light: a flash.
    #[must_use]
    pub fn with_beam(mut self, beam: Beam) -> Self {
        if beam.irradiance != [0.0; 3] {
            self.beams.push(beam);
        }
        self
    }

    /// Radiance along a ray from the eye in unit `direction`, W/(m² sr) per colour.
    pub fn radiance(&self, direction: DVec3) -> [f32; 3] {
        let mut sum = self.map.lookup(direction.as_vec3());
        for beam in &self.beams {
            // Light from `towards` travels against it, and what reaches the eye against `direction`.
            let share = self.phase.values(direction.dot(beam.towards));
            (0..3).for_each(|band| sum[band] += share[band] as f32 * beam.irradiance[band]);
        }
        sum
    }

    /// The sun's part of [`InScattering::radiance`].
    pub(crate) fn of_sun(&self, direction: DVec3) -> [f32; 3] {
        let Some((sun, depth)) = &self.sun else { return [0.0; 3] };
        let share = self.phase.values_behind(*depth, direction.dot(sun.towards));
        std::array::from_fn(|band| share[band] as f32 * sun.irradiance[band])
    }

    /// The part that comes from everywhere, the beams left out; smooth in `direction`, which may have any length.
    pub(crate) fn diffuse(&self, direction: Vec3) -> [f32; 3] {
        self.map.lookup(direction)
    }

    /// Nodes along a side of the map that [`Self::diffuse`] looks up, on the unfolded octahedron.
    #[cfg(feature = "gpu")]
    pub(crate) const MAP_SIDE: usize = Map::STEPS + 1;

    /// Radiance at those nodes, row by row.
    #[cfg(feature = "gpu")]
    pub(crate) fn texels(&self) -> &[[f32; 3]] {
        &self.map.texels
    }

    /// How far drops show their patterns in it, beside lights near by that come to `irradiance` together ([`RainLight::contrast`]).
    pub(crate) fn contrast_beside(&self, irradiance: f64) -> f32 {
        self.contrast_of_beams(&self.beams, irradiance)
    }

    /// The same where only some of its beams reach.
    pub(crate) fn contrast_of_beams(&self, beams: &[Beam], irradiance: f64) -> f32 {
        let beam = |beam: &Beam| beam.irradiance.iter().map(|&band| f64::from(band)).sum::<f64>() / 3.0;
        let beams: f64 = beams.iter().map(beam).sum();
        contrast_of(self.spread[0], self.spread[1], beams + irradiance)
    }

    /// The phase function.
    pub fn phase(&self) -> &Phase {
        &self.phase
    }

    /// The distant lights: the sun first, where it is up, as bright as it comes straight.
    pub fn beams(&self) -> &[Beam] {
        &self.beams
    }
}

impl RainLight for InScattering {
    fn radiance(&self, ray: &Ray, _distance: f64) -> [f32; 3] {
        self.radiance(ray.direction)
    }

    fn contrast(&self, _ray: &Ray, _distance: f64) -> f32 {
        self.contrast_beside(0.0)
    }
}

/// A smooth function on the sphere, on the unfolded octahedron: directions without a sine, and no poles.
#[derive(Clone, Debug, PartialEq)]
struct Map {
    texels: Vec<[f32; 3]>,
}

impl Map {
    /// Steps along the side of the unfolded octahedron; even, so that its folds lie on nodes.
    const STEPS: usize = 160;

    fn new(coefficients: &[[f32; 3]]) -> Self {
        let basis = Basis::new();
        let side = Self::STEPS + 1;
        let texel = |i: usize| {
            let [x, y] = [i % side, i / side].map(|at| 2.0 * at as f64 / Self::STEPS as f64 - 1.0);
            // Blurred harmonics of a positive world are positive but for what the degrees above the last would add.
            basis.sum(coefficients, unfold(x, y)).map(|value| value.max(0.0))
        };
        let mut texels = vec![[0.0; 3]; side * side];
        let row = |(row, texels): (usize, &mut [[f32; 3]])| {
            texels.iter_mut().enumerate().for_each(|(i, value)| *value = texel(row * side + i));
        };
        texels.par_chunks_mut(side).enumerate().for_each(row);
        Self { texels }
    }

    fn lookup(&self, direction: Vec3) -> [f32; 3] {
        let [x, y] = fold(direction);
        let place = |v: f32| (v * 0.5 + 0.5).clamp(0.0, 1.0) * Self::STEPS as f32;
        let (x, y) = (place(x), place(y));
        let [column, row] = [x, y].map(|v| (v as usize).min(Self::STEPS - 1));
        let (u, v) = (x - column as f32, y - row as f32);
        let at = |i: usize| self.texels[row * (Self::STEPS + 1) + column + i];
        let (a, b, c, d) = (at(0), at(1), at(Self::STEPS + 1), at(Self::STEPS + 2));
        std::array::from_fn(|i| {
            let (low, high) = (a[i] + u * (b[i] - a[i]), c[i] + u * (d[i] - c[i]));
            low + v * (high - low)
        })
    }
}

/// Highest degree that a sampled world keeps.
pub const HIGHEST_DEGREE: usize = DEGREE;

#[cfg(test)]
mod tests;
