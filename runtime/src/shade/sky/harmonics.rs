//! A function on the sphere as nine numbers per channel: enough for what a sky sheds on matt surfaces. \[ramamoorthi\]

use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// Coefficients of orders 0, 1 and 2 per channel: 1, y, z, x, xy, yz, 3z²−1, xz, x²−y².
pub type Harmonics = [[f32; 3]; 9];

/// The constant harmonic.
pub const Y0: f32 = 0.282_094_8;
/// Factor of the linear harmonics.
pub const Y1: f32 = 0.488_602_5;

/// Real spherical harmonics up to order 2, orthonormal: 1, y, z, x, xy, yz, 3z²−1, xz, x²−y².
fn basis(d: Vec3) -> [f32; 9] {
    [
        Y0,
        Y1 * d.y,
        Y1 * d.z,
        Y1 * d.x,
        1.092_548_4 * d.x * d.y,
        1.092_548_4 * d.y * d.z,
        0.315_391_57 * (3.0 * d.z * d.z - 1.0),
        1.092_548_4 * d.x * d.z,
        0.546_274_2 * (d.x * d.x - d.y * d.y),
    ]
}

/// Harmonic coefficients of a function on the sphere: midpoints of 32 equal-area bands of 64 azimuths.
pub fn project(value: impl Fn(Vec3) -> [f32; 3]) -> Harmonics {
    const RINGS: usize = 32;
    const SPOKES: usize = 64;
    let mut sums = [[0.0f64; 3]; 9];
    for ring in 0..RINGS {
        let z = 1.0 - (2 * ring + 1) as f64 / RINGS as f64;
        let rho = libm::sqrt(1.0 - z * z);
        for spoke in 0..SPOKES {
            let (sin, cos) = libm::sincos(2.0 * PI * (spoke as f64 + 0.5) / SPOKES as f64);
            let direction = DVec3::new(rho * cos, rho * sin, z).as_vec3();
            let radiance = value(direction);
            for (sum, value) in sums.iter_mut().zip(basis(direction)) {
                for band in 0..3 {
                    sum[band] += f64::from(value) * f64::from(radiance[band]);
                }
            }
        }
    }
    let solid_angle = 4.0 * PI / (RINGS * SPOKES) as f64;
    sums.map(|sum| sum.map(|value| (value * solid_angle) as f32))
}

/// Irradiance on a surface of unit `normal`: each order weighted by the clamped cosine's own. \[ramamoorthi\]
pub fn irradiance_from(coefficients: &Harmonics, normal: Vec3) -> [f32; 3] {
    use std::f32::consts::PI;
    const ORDERS: [f32; 9] = {
        let (one, two) = (2.0 * PI / 3.0, 0.25 * PI);
        [PI, one, one, one, two, two, two, two, two]
    };
    let basis = basis(normal);
    std::array::from_fn(|band| {
        (0..9).map(|i| ORDERS[i] * basis[i] * coefficients[i][band]).sum::<f32>().max(0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_sky_sheds_pi_times_its_radiance() {
        /// Midpoint rule over 2048 directions in single precision.
        const QUADRATURE: f32 = 2e-3;
        let coefficients = project(|_| [2.0; 3]);
        for normal in [Vec3::Z, Vec3::X, Vec3::new(0.6, 0.0, -0.8)] {
            let found = irradiance_from(&coefficients, normal)[1];
            let wanted = 2.0 * std::f32::consts::PI;
            assert!((found - wanted).abs() < QUADRATURE * wanted, "{found}");
        }
    }
}
