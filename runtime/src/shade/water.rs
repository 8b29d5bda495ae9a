//! Mirrors of water: exact Fresnel reflectance, and the highlight of a point light on a rippled surface.
//!
//! | symbol | name       | unit |
//! | n      | `WATER`    | –, refractive index |
//! | σ      | `slope`    | –, root mean square slope along one axis |
//! | h      | `half`     | –, unit vector halfway between light and eye |

use crate::math::exp_neg;
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
    let facets = exp_neg(tilt) / (std::f32::consts::PI * spread * up * up * up * up);
    let facet = to_viewer.dot(half).max(1e-4);
    let masking = (2.0 * up * eye / facet).min(2.0 * up * light / facet).min(1.0);
    water_reflectance(facet) * facets * masking / (4.0 * eye)
}

/// Lights looked at side by side by [`rippled_highlights`].
pub(super) const LANES: usize = 8;

/// [`rippled_highlight`] over squared distance for lights at these ways from the surface, x, y and z of each, m: without branches, so that
/// registers hold several.
#[inline]
pub(super) fn rippled_highlights(
    normal: Vec3,
    [x, y, z]: [[f32; LANES]; 3],
    to_viewer: Vec3,
    slope: f32,
) -> [f32; LANES] {
    let eye = normal.dot(to_viewer);
    let slope = slope.max(SMOOTHEST);
    let spread = 2.0 * slope * slope;
    let mut found = [0.0; LANES];
    for lane in 0..LANES {
        let squared = x[lane] * x[lane] + y[lane] * y[lane] + z[lane] * z[lane];
        let squared = if squared > 1e-4 { squared } else { 1e-4 };
        let near = 1.0 / squared.sqrt();
        let [a, b, c] = [x[lane] * near, y[lane] * near, z[lane] * near];
        let light = normal.x * a + normal.y * b + normal.z * c;
        let sum = [a + to_viewer.x, b + to_viewer.y, c + to_viewer.z];
        let long = sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2];
        let height = normal.x * sum[0] + normal.y * sum[1] + normal.z * sum[2];
        let tilt = (long / (height * height) - 1.0) / spread;
        let length = long.sqrt();
        let up = height / length;
        let shown = if tilt < STEEPEST { tilt } else { STEEPEST };
        let facets = exp_neg(if shown > 0.0 { shown } else { 0.0 })
            / (std::f32::consts::PI * spread * up * up * up * up);
        let facet = (to_viewer.x * sum[0] + to_viewer.y * sum[1] + to_viewer.z * sum[2]) / length;
        let facet = if facet > 1e-4 { facet } else { 1e-4 };
        let less = if eye < light { eye } else { light };
        let masking = 2.0 * up * less / facet;
        let masking = if masking < 1.0 { masking } else { 1.0 };
        let cosine = if facet < 1.0 { facet } else { 1.0 };
        let inside = (1.0 - (1.0 - cosine * cosine) / (WATER * WATER)).sqrt();
        let across = (cosine - WATER * inside) / (cosine + WATER * inside);
        let along = (WATER * cosine - inside) / (WATER * cosine + inside);
        let mirrored = 0.5 * (across * across + along * along);
        let whole = mirrored * facets * masking / (4.0 * eye * squared);
        found[lane] = if (light > 0.0) & (eye > 0.0) & (tilt <= STEEPEST) { whole } else { 0.0 };
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn highlights_side_by_side_are_those_one_by_one() {
        /// Single precision, in another order.
        const ROUND_OFF: f32 = 1e-4;
        let mut random = crate::random::Random::new(2);
        let mut met = 0;
        for i in 0..4000 {
            let slope = [0.0, 0.004, 0.03, 0.11][i % 4];
            let eye = (random.direction().as_vec3() + Vec3::Z * 0.6).normalize();
            let ways: [Vec3; LANES] = std::array::from_fn(|lane| {
                // Near where a mirror would show it, and anywhere.
                let mirrored =
                    Vec3::new(-eye.x, -eye.y, eye.z) + random.direction().as_vec3() * 0.1 * lane as f32;
                mirrored * random.range(1.0, 900.0) as f32
            });
            let axes = [0, 1, 2].map(|axis: usize| ways.map(|way| way[axis]));
            let found = rippled_highlights(Vec3::Z, axes, eye, slope);
            for (way, found) in ways.into_iter().zip(found) {
                let squared = way.length_squared();
                // A light right behind the surface's edge: the sum of the two directions has no digit left.
                if (way / squared.sqrt() + eye).length_squared() < 0.01 {
                    continue;
                }
                let wanted = rippled_highlight(Vec3::Z, way / squared.sqrt(), eye, slope) / squared;
                // A narrow highlight's tilt is a small difference.
                let lost = if slope < 0.01 { 0.02 } else { ROUND_OFF };
                // At its end a highlight falls to nothing from e^−25 of its peak.
                let end = 1e-10 / (slope.max(SMOOTHEST) * slope.max(SMOOTHEST) * squared);
                assert!(
                    (found - wanted).abs() <= lost * wanted + end,
                    "{way} {eye} {slope}: {found} {wanted}"
                );
                met += usize::from(wanted > 0.0);
            }
        }
        assert!(met > 2000, "{met}");
    }

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
