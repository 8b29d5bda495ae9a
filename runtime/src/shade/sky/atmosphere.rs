//! Clear air lit by the sun on a round Earth: single scattering exactly, higher orders as one isotropic term.
//! \[hillaire\], with the densities and cross-sections of \[bruneton\]; our changes: the finite solar disc, which
//! makes the Earth's shadow soft, and bands where a camera's are instead of single wavelengths.
//!
//! | symbol | name            | unit |
//! | h      | `altitude`      | m    |
//! | μ      | `cosine`        | –, of the angle to the local zenith |
//! | T      | `transmittance` | –    |
//! | Ψ      | `echo`          | 1/sr, radiance per unit irradiance of the sun outside the air |

use crate::parallel::prelude::*;
use glam::DVec3;
use std::f64::consts::PI;

/// Three broad bands, red, green, blue: about 580–650, 500–570 and 440–490 nm, where a camera's colours and the
/// primaries of a display are.
pub type Bands = [f64; 3];

/// Radius of the Earth, m.
pub const EARTH_RADIUS: f64 = 6_360_000.0;
/// Height above which no air is counted, m.
const TOP: f64 = 100_000.0;
/// Half the angle that the sun's disc covers, rad.
pub const SUN_HALF_ANGLE: f64 = 0.004_65;

/// Scattering of molecules at sea level, 1/m (1.24062e-6 λ⁻⁴, λ in µm, at 0.615, 0.535 and 0.465), and their scale
/// height, m. \[bruneton\]
const MOLECULES: Bands = [8.67e-6, 15.14e-6, 26.54e-6];
const MOLECULES_HEIGHT: f64 = 8_000.0;
/// Scattering and absorption of haze at sea level in clear weather, 1/m, and its scale height, m. \[bruneton\]
const HAZE_SCATTERING: f64 = 3.996e-6;
const HAZE_ABSORPTION: f64 = 0.444e-6;
const HAZE_HEIGHT: f64 = 1_200.0;
/// Mean cosine of haze scattering.
const HAZE_ASYMMETRY: f64 = 0.8;
/// Peak absorption of ozone, 1/m, at 25 km, falling linearly to zero 15 km above and below: the band means of
/// \[bruneton\]'s cross-sections times 300 Dobson units.
const OZONE: Bands = [2.03e-6, 1.58e-6, 0.262e-6];

const ALTITUDES: usize = 48;
const COSINES: usize = 96;
const ECHO_ALTITUDES: usize = 12;
const ECHO_COSINES: usize = 40;
/// How strongly the echo table crowds around a sun on the horizon.
const ECHO_CROWDING: f64 = 4.0;
/// Lowest sun that the echo table holds: 17.5° below the horizon.
const ECHO_LOWEST: f64 = -0.3;
const ECHO_DIRECTIONS: usize = 32;

/// What a cubic metre of air does to light, per metre.
struct Local {
    molecules: Bands,
    haze: f64,
    extinction: Bands,
}

/// Transmittance and echo tables of one kind of air.
pub struct Atmosphere {
    haze: f64,
    ground_albedo: f64,
    transmittance: Vec<Bands>,
    echo: Vec<Bands>,
    /// sinh of the echo table's crowding, and asinh of that times the lowest sun.
    crowding: [f64; 2],
}

/// A table of `rows` and `columns` of what `value` says.
fn filled(rows: usize, columns: usize, value: &(dyn Fn(usize, usize) -> Bands + Sync)) -> Vec<Bands> {
    let mut table = vec![[0.0; 3]; rows * columns];
    table.par_chunks_mut(columns).enumerate().for_each(|(row, values)| {
        values.iter_mut().enumerate().for_each(|(column, entry)| *entry = value(row, column));
    });
    table
}

/// A position in a table axis of `count` entries: lower entry and weight of the next.
fn place(at: f64, count: usize) -> (usize, f64) {
    let at = at.clamp(0.0, 1.0) * (count - 1) as f64;
    let low = (at as usize).min(count - 2);
    (low, at - low as f64)
}

fn bilinear(table: &[Bands], columns: usize, row: (usize, f64), column: (usize, f64)) -> Bands {
    std::array::from_fn(|band| {
        let at = |r: usize, c: usize| table[r * columns + c][band];
        let low = at(row.0, column.0) * (1.0 - column.1) + at(row.0, column.0 + 1) * column.1;
        let high = at(row.0 + 1, column.0) * (1.0 - column.1) + at(row.0 + 1, column.0 + 1) * column.1;
        low * (1.0 - row.1) + high * row.1
    })
}

/// Cosine of the horizon's zenith angle seen from `altitude`, ≤ 0.
fn horizon(altitude: f64) -> f64 {
    let ratio = EARTH_RADIUS / (EARTH_RADIUS + altitude);
    -libm::sqrt((1.0 - ratio * ratio).max(0.0))
}

/// Distance from `altitude` along a ray of zenith cosine `cosine` to the sphere of radius `sphere`; the far
/// crossing for a sphere around the start, the near one for a sphere below. `None`: the ray misses it.
fn distance_to(altitude: f64, cosine: f64, sphere: f64) -> Option<f64> {
    let radius = EARTH_RADIUS + altitude;
    let under_root = radius * radius * (cosine * cosine - 1.0) + sphere * sphere;
    if under_root < 0.0 {
        return None;
    }
    let root = libm::sqrt(under_root);
    if radius <= sphere { Some(-radius * cosine + root) } else { Some(-radius * cosine - root) }
}

fn rayleigh_phase(cosine: f64) -> f64 {
    3.0 / (16.0 * PI) * (1.0 + cosine * cosine)
}

/// Cornette and Shanks' phase function: Henyey and Greenstein's with a Rayleigh-like backward half.
fn haze_phase(cosine: f64) -> f64 {
    let g = HAZE_ASYMMETRY;
    let base = 1.0 + g * g - 2.0 * g * cosine;
    3.0 / (8.0 * PI) * (1.0 - g * g) / (2.0 + g * g) * (1.0 + cosine * cosine) / (base * libm::sqrt(base))
}

impl Atmosphere {
    /// Fills both tables. `haze` multiplies the clear-weather aerosol, ≥ 0.
    pub fn new(haze: f64, ground_albedo: f64) -> Self {
        let scale = libm::sinh(ECHO_CROWDING);
        let crowding = [scale, libm::asinh(ECHO_LOWEST * scale)];
        let (transmittance, echo) = (Vec::new(), Vec::new());
        let mut air = Self { haze, ground_albedo, transmittance, echo, crowding };
        air.transmittance = filled(ALTITUDES, COSINES, &|row, column| {
            let altitude = Self::table_altitude(row, ALTITUDES);
            let at = column as f64 / (COSINES - 1) as f64;
            let lowest = horizon(altitude);
            air.integrate_transmittance(altitude, lowest + (1.0 - lowest) * at * at)
        });
        air.echo = filled(ECHO_ALTITUDES, ECHO_COSINES, &|row, column| {
            let altitude = Self::table_altitude(row, ECHO_ALTITUDES);
            let at = column as f64 / (ECHO_COSINES - 1) as f64;
            let lowest = crowding[1] / ECHO_CROWDING;
            let at = lowest + (1.0 - lowest) * at;
            air.integrate_echo(altitude, libm::sinh(ECHO_CROWDING * at) / scale)
        });
        air
    }

    fn table_altitude(row: usize, rows: usize) -> f64 {
        let at = row as f64 / (rows - 1) as f64;
        TOP * at * at
    }

    fn local(&self, altitude: f64) -> Local {
        let air = libm::exp(-altitude / MOLECULES_HEIGHT);
        let haze = self.haze * libm::exp(-altitude / HAZE_HEIGHT);
        let ozone = (1.0 - (altitude - 25_000.0).abs() / 15_000.0).max(0.0);
        let molecules = MOLECULES.map(|coefficient| coefficient * air);
        let extinction = std::array::from_fn(|band| {
            molecules[band] + haze * (HAZE_SCATTERING + HAZE_ABSORPTION) + ozone * OZONE[band]
        });
        Local { molecules, haze: haze * HAZE_SCATTERING, extinction }
    }

    fn integrate_transmittance(&self, altitude: f64, cosine: f64) -> Bands {
        const STEPS: usize = 40;
        let length = distance_to(altitude, cosine, EARTH_RADIUS + TOP).unwrap_or(0.0);
        let mut depth = [0.0; 3];
        for step in 0..STEPS {
            // Steps grow with distance: the dense air is where a ray starts.
            let edge = |s: usize| length * (s * s) as f64 / (STEPS * STEPS) as f64;
            let (near, far) = (edge(step), edge(step + 1));
            let here = self.local(altitude_along(altitude, cosine, 0.5 * (near + far)));
            for band in 0..3 {
                depth[band] += here.extinction[band] * (far - near);
            }
        }
        depth.map(|depth| libm::exp(-depth))
    }

    /// Share of sunlight that reaches `altitude` when the sun stands at zenith cosine `cosine`, in [0, 1].
    /// The Earth hides the disc gradually.
    pub fn sunlight(&self, altitude: f64, cosine: f64) -> Bands {
        let altitude = altitude.clamp(0.0, TOP);
        let lowest = horizon(altitude);
        let risen = ((cosine - lowest) / (2.0 * SUN_HALF_ANGLE) + 0.5).clamp(0.0, 1.0);
        if risen == 0.0 {
            return [0.0; 3];
        }
        let disc = risen * risen * (3.0 - 2.0 * risen);
        self.transmittance(altitude, cosine).map(|share| share * disc)
    }

    /// Share of light that comes from outside the air to `altitude` at zenith cosine `cosine`, in [0, 1]; from below the horizon what
    /// comes along it.
    pub fn transmittance(&self, altitude: f64, cosine: f64) -> Bands {
        let altitude = altitude.clamp(0.0, TOP);
        let lowest = horizon(altitude);
        let row = place(libm::sqrt(altitude / TOP), ALTITUDES);
        let column = place(libm::sqrt(((cosine - lowest) / (1.0 - lowest)).max(0.0)), COSINES);
        bilinear(&self.transmittance, COSINES, row, column)
    }

    fn echo(&self, altitude: f64, cosine: f64) -> Bands {
        let [scale, lowest] = self.crowding;
        let at = (libm::asinh(cosine * scale) - lowest) / (ECHO_CROWDING - lowest);
        let row = place(libm::sqrt((altitude / TOP).clamp(0.0, 1.0)), ECHO_ALTITUDES);
        bilinear(&self.echo, ECHO_COSINES, row, place(at, ECHO_COSINES))
    }

    /// All orders from the second on, taken as isotropic: a geometric series over the share that air passes
    /// on to air. \[hillaire\] eq. 5–10.
    fn integrate_echo(&self, altitude: f64, sun_cosine: f64) -> Bands {
        let sun = DVec3::new(libm::sqrt((1.0 - sun_cosine * sun_cosine).max(0.0)), 0.0, sun_cosine);
        let (mut second, mut passed_on) = ([0.0; 3], [0.0; 3]);
        for i in 0..ECHO_DIRECTIONS {
            // Fibonacci's spiral: equal solid angles, no clumps.
            let z = 1.0 - (2 * i + 1) as f64 / ECHO_DIRECTIONS as f64;
            let (sin, cos) = libm::sincos(i as f64 * 2.399_963_229_728_653);
            let rho = libm::sqrt((1.0 - z * z).max(0.0));
            let walk = self.walk(altitude.max(1.0), DVec3::new(rho * cos, rho * sin, z), sun, 20, true);
            for band in 0..3 {
                second[band] += walk.light[band] / ECHO_DIRECTIONS as f64;
                passed_on[band] += walk.scattered[band] / ECHO_DIRECTIONS as f64;
            }
        }
        std::array::from_fn(|band| second[band] / (1.0 - passed_on[band]))
    }

    /// Radiance of clear air along `direction` from `altitude`, per unit irradiance of the sun outside.
    pub fn solve_radiance(&self, altitude: f64, direction: DVec3, sun: DVec3) -> Bands {
        self.walk(altitude, direction, sun, 48, false).light
    }

    fn walk(&self, altitude: f64, direction: DVec3, sun: DVec3, steps: usize, isotropic: bool) -> Walk {
        let cosine = direction.z;
        let ground =
            if cosine < horizon(altitude) { distance_to(altitude, cosine, EARTH_RADIUS) } else { None };
        let length = ground.or_else(|| distance_to(altitude, cosine, EARTH_RADIUS + TOP)).unwrap_or(0.0);
        let towards_sun = direction.dot(sun);
        let (rayleigh, haze) = if isotropic {
            (0.25 / PI, 0.25 / PI)
        } else {
            (rayleigh_phase(towards_sun), haze_phase(towards_sun))
        };
        let start = DVec3::new(0.0, 0.0, EARTH_RADIUS + altitude);
        let (mut through, mut light, mut scattered) = ([1.0; 3], [0.0; 3], [0.0; 3]);
        for step in 0..steps {
            let edge = |s: usize| length * (s * s) as f64 / (steps * steps) as f64;
            let (near, far) = (edge(step), edge(step + 1));
            let point = start + direction * (0.5 * (near + far));
            let radius = point.length();
            let here = self.local(radius - EARTH_RADIUS);
            let sun_cosine = point.dot(sun) / radius;
            let direct = self.sunlight(radius - EARTH_RADIUS, sun_cosine);
            let echo = if isotropic { [0.0; 3] } else { self.echo(radius - EARTH_RADIUS, sun_cosine) };
            for band in 0..3 {
                let all = here.molecules[band] + here.haze;
                let source =
                    (here.molecules[band] * rayleigh + here.haze * haze) * direct[band] + all * echo[band];
                let kept = libm::exp(-here.extinction[band] * (far - near));
                let weight = through[band] * (1.0 - kept) / here.extinction[band].max(1e-12);
                light[band] += source * weight;
                scattered[band] += all * weight;
                through[band] *= kept;
            }
        }
        if let Some(distance) = ground {
            let point = start + direction * distance;
            let sun_cosine = point.dot(sun) / point.length();
            let direct = self.sunlight(0.0, sun_cosine);
            for band in 0..3 {
                light[band] += through[band] * self.ground_albedo / PI * sun_cosine.max(0.0) * direct[band];
            }
        }
        Walk { light, scattered }
    }

    /// Extinction of a straight path of `length` m between two altitudes near the ground, per band: optical
    /// depth, dimensionless. Exact for exponential air on a flat Earth; ozone lies above all weather.
    pub fn optical_depth(&self, from: f64, to: f64, length: f64) -> Bands {
        let mean = |height: f64| {
            let (a, b) = (from.max(0.0) / height, to.max(0.0) / height);
            if (b - a).abs() < 1e-6 { libm::exp(-a) } else { (libm::exp(-a) - libm::exp(-b)) / (b - a) }
        };
        let haze = self.haze * (HAZE_SCATTERING + HAZE_ABSORPTION) * mean(HAZE_HEIGHT);
        let air = mean(MOLECULES_HEIGHT);
        MOLECULES.map(|coefficient| (coefficient * air + haze) * length)
    }
}

fn altitude_along(altitude: f64, cosine: f64, distance: f64) -> f64 {
    let radius = EARTH_RADIUS + altitude;
    let squared = radius * radius + distance * distance + 2.0 * radius * distance * cosine;
    libm::sqrt(squared) - EARTH_RADIUS
}

struct Walk {
    light: Bands,
    scattered: Bands,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Midpoint rule with growing steps over exponential air, and the table's bilinear error.
    const TABLE_ERROR: f64 = 0.01;

    #[test]
    fn the_zenith_sun_is_dimmed_by_the_columns_optical_depth() {
        let air = Atmosphere::new(1.0, 0.3);
        let column = |coefficient: f64, height: f64| coefficient * height * (1.0 - libm::exp(-TOP / height));
        for band in 0..3 {
            let depth = column(MOLECULES[band], MOLECULES_HEIGHT)
                + column(HAZE_SCATTERING + HAZE_ABSORPTION, HAZE_HEIGHT)
                + OZONE[band] * 15_000.0;
            let wanted = libm::exp(-depth);
            let found = air.sunlight(0.0, 1.0)[band];
            assert!((found - wanted).abs() < TABLE_ERROR * wanted, "band {band}: {found} against {wanted}");
        }
    }

    #[test]
    fn a_set_sun_still_lights_high_air_and_reddens_it() {
        let air = Atmosphere::new(1.0, 0.3);
        let cosine = libm::sin((-3.0f64).to_radians());
        assert_eq!(air.sunlight(0.0, cosine), [0.0; 3]);
        let high = air.sunlight(12_000.0, cosine);
        assert!(high[0] > 3.0 * high[2] && high[0] > 0.01, "{high:?}");
    }

    #[test]
    fn a_level_path_has_the_product_of_extinction_and_length() {
        /// Round-off of a product.
        const ROUND_OFF: f64 = 1e-12;
        let air = Atmosphere::new(0.0, 0.0);
        let depth = air.optical_depth(0.0, 0.0, 10_000.0);
        assert!((depth[1] - MOLECULES[1] * 10_000.0).abs() < ROUND_OFF);
    }
}
