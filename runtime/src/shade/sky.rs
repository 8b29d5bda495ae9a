//! The sky at dusk: radiance by direction, and what it sheds on ground, walls and clouds.
//!
//! Clear air is solved once per sky ([`atmosphere`]) into a table over elevation and azimuth from the sun;
//! afterglow, the teal band, the blue zenith (ozone) and the Earth's shadow with the Belt of Venus opposite the
//! sun come out of it. An overcast share and thin high cloud are laid over it. No stars.
//!
//! Radiance is in W/(m² sr) per colour. The colours red, green and blue are three broad bands of the
//! spectrum; a picture takes them as its primaries.

pub mod atmosphere;
#[cfg(feature = "gpu")]
pub(crate) mod card;
mod disc;
pub mod harmonics;

use crate::error::RuntimeError;
use crate::noise::{Lattice, smoothstep};
use crate::parallel::prelude::*;
use atmosphere::{Atmosphere, Bands};
use glam::{DVec3, Vec3};
use harmonics::{Harmonics, Y0, Y1, irradiance_from, project};
use squall_formats::units::Radians;
use std::f64::consts::{FRAC_PI_2, PI};

const AZIMUTHS: usize = 49;
const ELEVATIONS: usize = 64;
/// Eye height in the table, m.
const EYE: f64 = 10.0;
/// Height of the thin cloud layer, m.
const HIGH_CLOUD: f64 = 9_500.0;
/// Below the horizon the sky turns into ground over this sine of the elevation.
const HORIZON_BLEND: f32 = 0.01;

/// What kind of sky.
#[derive(Clone, Debug, PartialEq)]
pub struct SkyParameters {
    /// Where the sun is or went down, from +x towards +y.
    pub sun_azimuth: Radians,
    /// The sun above the horizon, in [−17°, 90°]; negative after sunset.
    pub sun_elevation: Radians,
    /// Aerosol as a multiple of clear weather's, in [0, 50].
    pub haze: f64,
    /// Share of the sky under grey cloud, in [0, 1].
    pub overcast: f64,
    /// Thin streaky cloud at 9.5 km, 0 none to 1 a dense sheet.
    pub high_cloud: f64,
    /// Irradiance of the sun outside the air on a surface facing it, W/m² per colour. About 180 each is the
    /// real sun's in three bands of 100 nm; other values scale everything with them.
    pub sun_irradiance: [f64; 3],
    /// Factor per colour on everything the sky sends: a white balance.
    pub tint: [f64; 3],
    /// Share of light that the ground at large reflects, in [0, 1].
    pub ground_albedo: f64,
    /// Seed of the high cloud's pattern.
    pub seed: u32,
}

impl Default for SkyParameters {
    /// Twenty minutes after sunset in clean air, the sun gone down in the north-west (y is north).
    fn default() -> Self {
        Self {
            sun_azimuth: Radians(2.4),
            sun_elevation: Radians(-0.07),
            haze: 1.5,
            overcast: 0.0,
            high_cloud: 0.35,
            sun_irradiance: [180.0; 3],
            tint: [1.0; 3],
            ground_albedo: 0.15,
            seed: 1,
        }
    }
}

/// What lights a cloud when nothing flashes, at one altitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudLight {
    /// Mean radiance of the upper hemisphere, W/(m² sr).
    pub upper: [f32; 3],
    /// Mean radiance of the lower hemisphere, W/(m² sr): ground and low air.
    pub lower: [f32; 3],
    /// Unit vector towards the sun.
    pub sun_direction: Vec3,
    /// Irradiance of the direct sun on a surface facing it, W/m²; zero where the Earth hides the sun.
    pub sun_irradiance: [f32; 3],
}

/// Clear air between an eye and something: what it keeps of that thing's light, and what it adds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AirView {
    /// Share that arrives, in [0, 1] per colour.
    pub transmittance: [f32; 3],
    /// Radiance that the air adds, W/(m² sr).
    pub added: [f32; 3],
}

/// A sky ready to be looked at.
pub struct Sky {
    air: Atmosphere,
    sun: DVec3,
    overcast: f32,
    high_cloud: f32,
    scale: Bands,
    /// Optical depth of a metre of the clear air below the thin cloud layer.
    high_air: Bands,
    table: Vec<[f32; 3]>,
    grey: [f32; 3],
    ground: [f32; 3],
    harmonics: Harmonics,
    lattice: Lattice,
}

fn check(field: &'static str, value: f64, low: f64, high: f64) -> Result<(), RuntimeError> {
    if value >= low && value <= high {
        return Ok(());
    }
    Err(RuntimeError::argument(field, format!("a number in [{low}, {high}]"), value))
}

impl Sky {
    /// Solves a sky, some tens of milliseconds. Errors: a parameter outside its documented range.
    pub fn new(parameters: &SkyParameters) -> Result<Self, RuntimeError> {
        check("sky sun azimuth", parameters.sun_azimuth.0, -100.0, 100.0)?;
        check("sky sun elevation", parameters.sun_elevation.0, (-17.0f64).to_radians(), FRAC_PI_2)?;
        check("sky haze", parameters.haze, 0.0, 50.0)?;
        check("sky overcast", parameters.overcast, 0.0, 1.0)?;
        check("sky high cloud", parameters.high_cloud, 0.0, 1.0)?;
        check("sky ground albedo", parameters.ground_albedo, 0.0, 1.0)?;
        for band in 0..3 {
            check("sky sun irradiance", parameters.sun_irradiance[band], 0.0, 1e12)?;
            check("sky tint", parameters.tint[band], 0.0, 1e6)?;
        }
        let air = Atmosphere::new(parameters.haze, parameters.ground_albedo);
        let (sin_e, cos_e) = libm::sincos(parameters.sun_elevation.0);
        let (sin_a, cos_a) = libm::sincos(parameters.sun_azimuth.0);
        let scale: Bands = std::array::from_fn(|b| parameters.sun_irradiance[b] * parameters.tint[b]);
        let sun = DVec3::new(cos_e, 0.0, sin_e);
        let mut table = vec![[0.0; 3]; AZIMUTHS * ELEVATIONS];
        table.par_chunks_mut(AZIMUTHS).enumerate().for_each(|(row, values)| {
            let up = row as f64 / (ELEVATIONS - 1) as f64;
            let (sin, cos) = libm::sincos(FRAC_PI_2 * up * up);
            for (column, value) in values.iter_mut().enumerate() {
                let (s, c) = libm::sincos(PI * column as f64 / (AZIMUTHS - 1) as f64);
                // The sun stands in the plane y = 0; azimuth is measured from it.
                let radiance = air.solve_radiance(EYE, DVec3::new(cos * c, cos * s, sin), sun);
                *value = std::array::from_fn(|band| (radiance[band] * scale[band]) as f32);
            }
        });
        let high_air = air.optical_depth(EYE, HIGH_CLOUD, 1.0);
        let mut sky = Self {
            air,
            high_air,
            sun: DVec3::new(cos_e * cos_a, cos_e * sin_a, sin_e),
            overcast: parameters.overcast as f32,
            high_cloud: parameters.high_cloud as f32,
            scale,
            table,
            grey: [0.0; 3],
            ground: [0.0; 3],
            harmonics: [[0.0; 3]; 9],
            lattice: Lattice::new(parameters.seed),
        };
        sky.settle(parameters.ground_albedo as f32);
        Ok(sky)
    }

    /// The quantities that need the clear sky first: the grey of an overcast, the ground's radiance and the
    /// harmonics of the whole sphere.
    fn settle(&mut self, ground_albedo: f32) {
        let clear = project(|direction| if direction.z > 0.0 { self.clear(direction) } else { [0.0; 3] });
        let share = self.air.sunlight(0.0, self.sun.z);
        let direct: [f32; 3] =
            std::array::from_fn(|band| (share[band] * self.scale[band] * self.sun.z.max(0.0)) as f32);
        let diffuse = irradiance_from(&clear, Vec3::Z);
        let level: [f32; 3] = std::array::from_fn(|band| diffuse[band] + direct[band]);
        // Under thick cloud about 30 % of the light of sky and sun arrives, its colours mixed half to grey.
        let mean = (level[0] + level[1] + level[2]) / 3.0;
        self.grey = level.map(|value| 0.3 * (0.5 * value + 0.5 * mean) / std::f32::consts::PI);
        let upper = project(|direction| if direction.z > 0.0 { self.covered(direction) } else { [0.0; 3] });
        let (sky, sunny) = (irradiance_from(&upper, Vec3::Z), 1.0 - self.overcast);
        self.ground = std::array::from_fn(|band| {
            (sky[band] + sunny * direct[band]) * ground_albedo / std::f32::consts::PI
        });
        self.harmonics =
            project(|direction| if direction.z > 0.0 { self.covered(direction) } else { self.ground });
    }

    /// Unit vector towards the sun.
    pub fn sun_direction(&self) -> Vec3 {
        self.sun.as_vec3()
    }

    /// Radiance of the whole sphere, the sun's disc and thin high cloud left out, as nine harmonics per colour.
    pub fn harmonics(&self) -> &Harmonics {
        &self.harmonics
    }

    /// Radiance from `direction` (unit), W/(m² sr). Below the horizon: the ground's mean radiance. The sun's disc is not in it:
    /// [`Sky::disc`].
    pub fn radiance(&self, direction: Vec3) -> [f32; 3] {
        let above = smoothstep(-HORIZON_BLEND, 0.0, direction.z);
        if above == 0.0 {
            return self.ground;
        }
        let mut sky = self.covered(direction);
        if self.high_cloud > 0.0 {
            sky = self.with_high_cloud(direction, sky);
        }
        std::array::from_fn(|band| self.ground[band] + above * (sky[band] - self.ground[band]))
    }

    /// Clear sky and overcast, without high cloud.
    fn covered(&self, direction: Vec3) -> [f32; 3] {
        let clear = self.clear(direction);
        if self.overcast == 0.0 {
            return clear;
        }
        // Moon and Spencer's overcast: three times as bright overhead as at the horizon.
        let shape = (1.0 + 2.0 * direction.z.max(0.0)) * (3.0 / 7.0);
        std::array::from_fn(|band| clear[band] + self.overcast * (self.grey[band] * shape - clear[band]))
    }

    fn clear(&self, direction: Vec3) -> [f32; 3] {
        let elevation = libm::asinf(direction.z.clamp(0.0, 1.0)) / std::f32::consts::FRAC_PI_2;
        let row = elevation.sqrt() * (ELEVATIONS - 1) as f32;
        let flat = libm::sqrtf(direction.x * direction.x + direction.y * direction.y).max(1e-9);
        let level = libm::hypot(self.sun.x, self.sun.y).max(1e-9) as f32;
        let away = (direction.x * self.sun.x as f32 + direction.y * self.sun.y as f32) / (flat * level);
        let column = libm::acosf(away.clamp(-1.0, 1.0)) / std::f32::consts::PI * (AZIMUTHS - 1) as f32;
        let (r, c) = ((row as usize).min(ELEVATIONS - 2), (column as usize).min(AZIMUTHS - 2));
        let (u, v) = (row - r as f32, column - c as f32);
        let at = |r: usize, c: usize| self.table[r * AZIMUTHS + c];
        let (a, b, d, e) = (at(r, c), at(r, c + 1), at(r + 1, c), at(r + 1, c + 1));
        std::array::from_fn(|i| (a[i] * (1.0 - v) + b[i] * v) * (1.0 - u) + (d[i] * (1.0 - v) + e[i] * v) * u)
    }

    /// Share that thin ice cloud in `direction` (unit) takes from what is behind it, in [0, 1): streaks drawn out along one wind. An
    /// overcast hides it.
    fn high_cloud_opacity(&self, direction: Vec3) -> f32 {
        if direction.z < 0.02 || self.high_cloud == 0.0 {
            return 0.0;
        }
        let point = direction * self.high_cloud_distance(direction.z);
        // Kilometres; the streaks run along x, bent by a slow swirl.
        let (x, y) = (point.x * 1e-3, point.y * 1e-3);
        let swirl = self.lattice.gradient(Vec3::new(x / 30.0, y / 30.0, 7.5)) * 6.0;
        let broad = self.lattice.fractal(Vec3::new(x / 34.0, (y + swirl) / 12.0, 1.5), 3, 0.5);
        let fine = self.lattice.fractal(Vec3::new(x / 12.0, (y + 1.6 * swirl) / 1.6, 3.5), 4, 0.55);
        let cover = smoothstep(-0.1, 0.45, broad + 0.5 * fine) * self.high_cloud;
        // Perspective crowds streaks together towards the horizon, where air hides them.
        let depth = 0.9 * cover * smoothstep(0.02, 0.16, direction.z);
        (1.0 - libm::expf(-depth)) * (1.0 - self.overcast)
    }

    /// That cloud in front of `behind`, lit by the low sun and the sky.
    fn with_high_cloud(&self, direction: Vec3, behind: [f32; 3]) -> [f32; 3] {
        let opacity = self.high_cloud_opacity(direction);
        if opacity == 0.0 {
            return behind;
        }
        let distance = self.high_cloud_distance(direction.z);
        let point = direction * distance;
        // Above an overcast, which dims nothing up there.
        let light = self.light_above(f64::from(HIGH_CLOUD as f32), point.as_dvec3());
        let towards = direction.dot(light.sun_direction);
        // Ice crystals send most light forward; a two-lobe Henyey–Greenstein, mean cosine about .6.
        let lobe = |g: f32| (1.0 - g * g) / (12.566_37 * libm::powf(1.0 + g * g - 2.0 * g * towards, 1.5));
        let phase = 0.7 * lobe(0.8) + 0.3 * lobe(0.1);
        let air = AirBetween { per_metre: self.high_air, mean: self.mean_radiance() };
        let air = air.view(f64::from(distance));
        std::array::from_fn(|band| {
            let ambient = 0.5 * (light.upper[band] + light.lower[band]);
            let own = ambient + light.sun_irradiance[band] * phase;
            let seen = own * air.transmittance[band] + behind[band] * (1.0 - air.transmittance[band]);
            behind[band] + opacity * (seen - behind[band])
        })
    }

    /// Along a ray of sine `up`, over a round Earth, m.
    fn high_cloud_distance(&self, up: f32) -> f32 {
        let (radius, up) = (atmosphere::EARTH_RADIUS, f64::from(up));
        let top = radius + HIGH_CLOUD;
        (-radius * up + libm::sqrt(radius * radius * up * up + top * top - radius * radius)) as f32
    }

    /// Irradiance on a surface of unit `normal` from the whole sphere (sky above, ground below), W/m².
    /// Nine harmonics, whose error for a cosine-weighted hemisphere of a dusk sky is a few per cent
    /// \[ramamoorthi\]; a constant sky of radiance L gives π L exactly.
    pub fn ambient_irradiance(&self, normal: Vec3) -> [f32; 3] {
        irradiance_from(&self.harmonics, normal)
    }

    /// Mean radiance over the whole sphere, W/(m² sr).
    pub fn mean_radiance(&self) -> [f32; 3] {
        self.harmonics[0].map(|value| value * Y0)
    }

    /// What lights a cloud `altitude` metres above the ground when nothing flashes: the two hemispheres' mean radiance and the direct
    /// sun, dimmed by the share of the sky that is overcast and by high cloud above. `position` is measured from the place on the
    /// ground where the sun has its stated elevation, m; its x and y move the cloud into or out of the Earth's shadow.
    pub fn cloud_light(&self, altitude: f64, position: DVec3) -> CloudLight {
        let light = self.light_above(altitude, position);
        // High cloud hangs over what is lower, the same over all of it as over the place that the sky is seen from.
        let veiled = altitude < HIGH_CLOUD;
        let sunny = if veiled { self.open_to_the_sun() } else { 1.0 - self.overcast };
        CloudLight { sun_irradiance: light.sun_irradiance.map(|band| band * sunny), ..light }
    }

    /// The same above the overcast.
    fn light_above(&self, altitude: f64, position: DVec3) -> CloudLight {
        let zenith =
            DVec3::new(position.x, position.y, atmosphere::EARTH_RADIUS + altitude.max(0.0)).normalize();
        let share = self.air.sunlight(altitude.max(0.0), zenith.dot(self.sun));
        // Mean over a hemisphere of an order-2 expansion: constant term and the linear one along its axis.
        let half = |sign: f32| {
            std::array::from_fn(|band| {
                (self.harmonics[0][band] * Y0 + sign * 0.5 * self.harmonics[2][band] * Y1).max(0.0)
            })
        };
        CloudLight {
            upper: half(1.0),
            lower: half(-1.0),
            sun_direction: self.sun.as_vec3(),
            sun_irradiance: std::array::from_fn(|band| (share[band] * self.scale[band]) as f32),
        }
    }

    /// Clear air along `distance` m between two altitudes, lit by the sky's mean radiance.
    pub fn air_view(&self, from_altitude: f64, to_altitude: f64, distance: f64) -> AirView {
        self.air_between(from_altitude, to_altitude).view(distance)
    }

    /// The same for many distances.
    pub(crate) fn air_between(&self, from_altitude: f64, to_altitude: f64) -> AirBetween {
        let per_metre = self.air.optical_depth(from_altitude, to_altitude, 1.0);
        AirBetween { per_metre, mean: self.mean_radiance() }
    }
}

/// Clear air between two altitudes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AirBetween {
    per_metre: Bands,
    mean: [f32; 3],
}

impl AirBetween {
    /// So many metres of it.
    pub fn view(&self, distance: f64) -> AirView {
        let transmittance = self.per_metre.map(|depth| libm::exp(-depth * distance) as f32);
        AirView {
            transmittance,
            added: std::array::from_fn(|band| self.mean[band] * (1.0 - transmittance[band])),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dusk() -> Sky {
        let degrees = |d: f64| Radians(d.to_radians());
        let parameters = SkyParameters {
            sun_azimuth: degrees(0.0),
            sun_elevation: degrees(-4.0),
            high_cloud: 0.0,
            ..SkyParameters::default()
        };
        Sky::new(&parameters).unwrap()
    }

    fn towards(azimuth_deg: f32, elevation_deg: f32) -> Vec3 {
        let (sa, ca) = libm::sincosf(azimuth_deg.to_radians());
        let (se, ce) = libm::sincosf(elevation_deg.to_radians());
        Vec3::new(ce * ca, ce * sa, se)
    }

    #[test]
    fn civil_twilight_is_as_bright_as_meteorologists_say() {
        // Horizontal illuminance of a clear evening falls from 410–585 lx at sunset to 2–3.5 lx at −6° [ams].
        // The bands stand for 100 nm each; of the eye's response they hold 46, 57 and 3 nm.
        let lux = |elevation: f64| {
            let parameters = SkyParameters {
                sun_elevation: Radians(elevation.to_radians()),
                haze: 1.0,
                high_cloud: 0.0,
                ..SkyParameters::default()
            };
            let [r, g, b] = Sky::new(&parameters).unwrap().ambient_irradiance(Vec3::Z);
            683.0 * (0.46 * r + 0.57 * g + 0.03 * b)
        };
        let (sunset, end) = (lux(-0.83), lux(-6.0));
        /// Three bands, one isotropic term for all higher orders, no refraction.
        const FACTOR: f32 = 2.0;
        assert!(sunset > 410.0 / FACTOR && sunset < 585.0 * FACTOR, "{sunset} lx at sunset");
        assert!(end > 2.0 / FACTOR && end < 3.5 * FACTOR, "{end} lx at −6°");
    }

    #[test]
    fn afterglow_is_warm_and_the_zenith_blue() {
        let sky = dusk();
        let (glow, zenith) = (sky.radiance(towards(0.0, 3.0)), sky.radiance(Vec3::Z));
        assert!(glow[0] > 1.5 * glow[2], "afterglow {glow:?}");
        assert!(zenith[2] > 1.5 * zenith[0], "zenith {zenith:?}");
        let opposite = sky.radiance(towards(180.0, 3.0));
        assert!(glow[1] > 5.0 * opposite[1], "{glow:?} against {opposite:?}");
    }

    #[test]
    fn the_earths_shadow_lies_under_the_belt_of_venus() {
        let sky = dusk();
        let ratio = |elevation: f32| {
            let radiance = sky.radiance(towards(180.0, elevation));
            radiance[0] / radiance[2]
        };
        let belt = (6..20).map(|e| ratio(e as f32)).fold(0.0, f32::max);
        assert!(belt > 1.15 * ratio(1.0), "belt {belt}, shadow {}", ratio(1.0));
        assert!(belt > 1.15 * ratio(60.0), "belt {belt}, above {}", ratio(60.0));
    }

    #[test]
    fn the_table_reads_what_was_solved() {
        /// Bilinear interpolation between 64 elevations and 49 azimuths.
        const INTERPOLATION: f32 = 0.02;
        let sky = dusk();
        let sun = DVec3::new(libm::cos(-4f64.to_radians()), 0.0, libm::sin(-4f64.to_radians()));
        for azimuth in [1.0, 37.0, 92.0, 178.0] {
            for elevation in [0.3, 2.0, 7.7, 31.0, 88.0] {
                let direction = towards(azimuth, elevation);
                let solved = sky.air.solve_radiance(EYE, direction.as_dvec3(), sun);
                let read = sky.radiance(direction);
                for band in 0..3 {
                    let wanted = (solved[band] * sky.scale[band]) as f32;
                    let off = (read[band] / wanted - 1.0).abs();
                    assert!(off < INTERPOLATION, "{azimuth}° {elevation}°: {} against {wanted}", read[band]);
                }
            }
        }
    }

    #[test]
    fn overcast_dims_and_greys_and_nothing_is_negative_or_infinite() {
        for overcast in [0.0, 0.6, 1.0] {
            let sky = Sky::new(&SkyParameters { overcast, ..SkyParameters::default() }).unwrap();
            for azimuth in 0..36 {
                for elevation in -18..=18 {
                    let radiance = sky.radiance(towards(azimuth as f32 * 10.0, elevation as f32 * 5.0));
                    assert!(radiance.iter().all(|v| v.is_finite() && *v >= 0.0), "{radiance:?}");
                }
            }
        }
        let level = |overcast| {
            let sky = Sky::new(&SkyParameters { overcast, ..SkyParameters::default() }).unwrap();
            sky.ambient_irradiance(Vec3::Z)[1]
        };
        assert!(level(1.0) < 0.5 * level(0.0));
    }

    #[test]
    fn an_overcast_noon_lets_thirty_percent_of_sky_and_sun_through() {
        /// Colours mix to grey around their mean, and nine harmonics project Moon and Spencer's sky.
        const GREYING: f32 = 0.02;
        let sky = |overcast| {
            let sun_elevation = Radians(50f64.to_radians());
            let parameters =
                SkyParameters { sun_elevation, overcast, high_cloud: 0.0, ..SkyParameters::default() };
            Sky::new(&parameters).unwrap()
        };
        let mean = |[r, g, b]: [f32; 3]| (r + g + b) / 3.0;
        let (clear, grey) = (sky(0.0), sky(1.0));
        let sun = clear.sun().unwrap();
        let global = mean(clear.ambient_irradiance(Vec3::Z)) + mean(sun.irradiance) * sun.towards.z;
        let share = mean(grey.ambient_irradiance(Vec3::Z)) / global;
        assert!((share - 0.3).abs() < GREYING, "{share}");
        // What the ground sends back is its albedo's share of the same light.
        let ground = mean(clear.radiance(Vec3::NEG_Z)) * std::f32::consts::PI;
        assert!((ground / global - 0.15).abs() < 0.15 * GREYING * 2.0, "{}", ground / global);
    }

    #[test]
    fn the_sun_has_left_the_base_of_a_tall_cloud_but_not_its_top() {
        let sky = dusk();
        assert_eq!(sky.cloud_light(1_500.0, DVec3::ZERO).sun_irradiance, [0.0; 3]);
        assert!(sky.cloud_light(16_000.0, DVec3::ZERO).sun_irradiance[0] > 0.0);
        let light = sky.cloud_light(3_000.0, DVec3::ZERO);
        assert!(light.upper[2] > light.lower[2]);
    }

    #[test]
    fn parameters_out_of_range_are_refused_by_name() {
        let bad = SkyParameters { haze: f64::NAN, ..SkyParameters::default() };
        assert!(Sky::new(&bad).err().is_some_and(|error| error.to_string().contains("haze")));
        let bad = SkyParameters { sun_elevation: Radians(-1.0), ..SkyParameters::default() };
        assert!(Sky::new(&bad).is_err());
    }
}
