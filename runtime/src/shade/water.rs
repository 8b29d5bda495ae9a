//! Mirrors of water: exact Fresnel reflectance, and the highlight of a point light on a rippled surface.
//!
//! | symbol | name       | unit |
//! | n      | `WATER`    | –, refractive index |
//! | σ      | `slope`    | –, root mean square slope along one axis |
//! | h      | `half`     | –, unit vector halfway between light and eye |

use glam::Vec3;

/// Refractive index of water in visible light.
pub const WATER: f32 = 1.333;

/// Refractive index of window glass.
pub const GLASS: f32 = 1.52;

/// Slope below which a surface counts as no smoother: its highlight is then narrower than the sun's disc.
pub(super) const SMOOTHEST: f32 = 1e-3;

/// Tilt of a facet, tan² over 2σ², beyond which it shows nothing.
const STEEPEST: f32 = 25.0;

/// tan² of the facet's tilt beyond which [`rippled_highlight`] shows nothing, with some more than round-off.
pub(super) fn widest_spread(slope: f32) -> f32 {
    let slope = slope.max(SMOOTHEST);
    1.01 * STEEPEST * 2.0 * slope * slope + 1e-5
}

/// Share of unpolarised light that a plane water surface reflects, in [0.02, 1]; `cosine` of the angle between
/// ray and normal, in [0, 1].
pub fn water_reflectance(cosine: f32) -> f32 {
    fresnel_reflectance(cosine, WATER)
}

/// Share of unpolarised light that a plane surface of refractive index `index` ≥ 1 reflects, in [0, 1]. Fresnel's
/// equations, exact for real n.
pub fn fresnel_reflectance(cosine: f32, index: f32) -> f32 {
    let c = cosine.clamp(0.0, 1.0);
    let inside = (1.0 - (1.0 - c * c) / (index * index)).max(0.0).sqrt();
    let across = (c - index * inside) / (c + index * inside).max(1e-12);
    let along = (index * c - inside) / (index * c + inside).max(1e-12);
    0.5 * (across * across + along * along)
}

/// Radiance towards the eye per unit irradiance at normal incidence (so per W/m² of I/d²) from one point light on
/// rippled water, 1/sr.
///
/// Beckmann's slope distribution and the V-groove masking of Torrance and Sparrow \[cook-torrance\]; the cosine
/// of incidence is included. Zero when light or eye is below the surface.
pub fn rippled_highlight(normal: Vec3, to_light: Vec3, to_viewer: Vec3, slope: f32) -> f32 {
    let (light, eye) = (normal.dot(to_light), normal.dot(to_viewer));
    if light <= 0.0 || eye <= 0.0 {
        return 0.0;
    }
    let sum = to_light + to_viewer;
    let (squared, height) = (sum.length_squared(), normal.dot(sum));
    // tan² of the facet's tilt over 2σ²: beyond e⁻²⁵ nothing shows. Water without ripples has a highlight without size.
    let slope = slope.max(SMOOTHEST);
    let spread = 2.0 * slope * slope;
    let tilt = (squared / (height * height) - 1.0) / spread;
    if tilt > STEEPEST {
        return 0.0;
    }
    let half = sum / squared.sqrt();
    let up = normal.dot(half);
    let facets = libm::expf(-tilt) / (std::f32::consts::PI * spread * up * up * up * up);
    let facet = to_viewer.dot(half).max(1e-4);
    let masking = (2.0 * up * eye / facet).min(2.0 * up * light / facet).min(1.0);
    water_reflectance(facet) * facets * masking / (4.0 * eye)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_normal_incidence_two_per_cent_are_reflected_and_all_at_grazing() {
        /// Single-precision round-off on the closed form ((n − 1)/(n + 1))².
        const ROUND_OFF: f32 = 1e-6;
        let closed = ((WATER - 1.0) / (WATER + 1.0)) * ((WATER - 1.0) / (WATER + 1.0));
        assert!((water_reflectance(1.0) - closed).abs() < ROUND_OFF);
        assert!((water_reflectance(1.0) - 0.0204).abs() < 1e-4);
        assert!((water_reflectance(0.0) - 1.0).abs() < ROUND_OFF);
    }

    #[test]
    fn the_hemispheric_mean_is_six_point_six_per_cent() {
        /// The published mean is given to three digits.
        const PRINTED: f64 = 5e-4;
        let steps = 20_000;
        let mean: f64 = (0..steps)
            .map(|i| {
                let cosine = (i as f64 + 0.5) / f64::from(steps);
                2.0 * cosine * f64::from(water_reflectance(cosine as f32)) / f64::from(steps)
            })
            .sum();
        assert!((mean - 0.066).abs() < PRINTED, "{mean}");
    }

    #[test]
    fn a_highlight_carries_as_much_light_as_a_flat_mirror() {
        // Seen from straight above, a light at normal incidence: the integral over eye directions of
        // radiance × cosine must be the Fresnel share of the irradiance; masking takes a little.
        /// Facets tilted by σ = .1 see the light at up to .2 rad; Fresnel hardly changes there.
        const MASKED: f64 = 0.02;
        let (mut flux, rings, spokes) = (0.0f64, 2000, 8);
        for ring in 0..rings {
            let cosine = (f64::from(ring) + 0.5) / f64::from(rings);
            let sine = libm::sqrt(1.0 - cosine * cosine);
            for spoke in 0..spokes {
                let (s, c) = libm::sincos(std::f64::consts::TAU * f64::from(spoke) / f64::from(spokes));
                let eye = Vec3::new((sine * c) as f32, (sine * s) as f32, cosine as f32);
                let radiance = f64::from(rippled_highlight(Vec3::Z, Vec3::Z, eye, 0.1));
                flux += radiance * cosine * std::f64::consts::TAU / f64::from(rings * spokes);
            }
        }
        assert!((flux / 0.0204 - 1.0).abs() < MASKED, "{flux}");
    }
}
