//! Directions: the bases in which a stored quantity depends on direction, and reading between them.
//!
//! | symbol | name | unit |
//! | Y_lm | real spherical harmonics, orthonormal over the sphere: ∫ Y² dΩ = 1 | sr^−½ |

/// Highest degree of the harmonics here.
pub const MAX_DEGREE: usize = 3;
/// Number of harmonics up to [`MAX_DEGREE`].
pub const MAX_HARMONICS: usize = 16;

/// Number of harmonics of degree 0 to `degree`.
pub const fn harmonic_count(degree: usize) -> usize {
    (degree + 1) * (degree + 1)
}

/// Degree l of the harmonic with index `l² + l + m`.
pub const fn degree_of(index: usize) -> usize {
    match index {
        0 => 0,
        1..=3 => 1,
        4..=8 => 2,
        _ => 3,
    }
}

/// The 16 real orthonormal harmonics of degree 0 to 3 in unit direction (x, y, z), at index `l² + l + m`.
///
/// Degree 1 is √(3/4π) (y, z, x), the usual order m = −1, 0, 1.
pub fn harmonics(direction: [f64; 3]) -> [f64; MAX_HARMONICS] {
    let [x, y, z] = direction;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    const Y0: f64 = 0.282_094_791_773_878_14; // √(1/4π)
    const Y1: f64 = 0.488_602_511_902_919_9; // √(3/4π)
    const Y2A: f64 = 1.092_548_430_592_079_2; // √(15/4π)
    const Y2B: f64 = 0.315_391_565_252_520_05; // √(5/16π)
    const Y2C: f64 = 0.546_274_215_296_039_6; // √(15/16π)
    const Y3A: f64 = 0.590_043_589_926_643_5; // √(35/32π)
    const Y3B: f64 = 2.890_611_442_640_554; // √(105/4π)
    const Y3C: f64 = 0.457_045_799_464_465_8; // √(21/32π)
    const Y3D: f64 = 0.373_176_332_590_115_4; // √(7/16π)
    const Y3E: f64 = 1.445_305_721_320_277; // √(105/16π)
    [
        Y0,
        Y1 * y,
        Y1 * z,
        Y1 * x,
        Y2A * x * y,
        Y2A * y * z,
        Y2B * (3.0 * zz - 1.0),
        Y2A * x * z,
        Y2C * (xx - yy),
        Y3A * y * (3.0 * xx - yy),
        Y3B * x * y * z,
        Y3C * y * (5.0 * zz - 1.0),
        Y3D * z * (5.0 * zz - 3.0),
        Y3C * x * (5.0 * zz - 1.0),
        Y3E * z * (xx - yy),
        Y3A * x * (xx - 3.0 * yy),
    ]
}

/// The 26 directions of the Lebedev set of degree 7, the "26 directions" of \[dobashi\]: 6 along the axes,
/// 12 towards the edges and 8 towards the corners of a cube, in that order.
///
/// Axes: +x, −x, +y, −y, +z, −z. Edges: planes xy, xz, yz, each with signs ++, +−, −+, −−. Corners: signs
/// of (x, y, z) counted in binary, x slowest, + before −.
pub fn directions_26() -> [[f64; 3]; 26] {
    let (edge, corner) = (libm::sqrt(0.5), libm::sqrt(1.0 / 3.0));
    let sign = |bit: usize| if bit == 0 { 1.0 } else { -1.0 };
    let mut out = [[0.0; 3]; 26];
    for i in 0..6 {
        out[i][i / 2] = sign(i % 2);
    }
    for i in 0..12 {
        let (a, b) = [(0, 1), (0, 2), (1, 2)][i / 4];
        out[6 + i][a] = edge * sign(i / 2 % 2);
        out[6 + i][b] = edge * sign(i % 2);
    }
    for i in 0..8 {
        out[18 + i] = [corner * sign(i / 4), corner * sign(i / 2 % 2), corner * sign(i % 2)];
    }
    out
}

/// Quadrature weights of [`directions_26`], summing to 1.
pub fn weights_26() -> [f64; 26] {
    std::array::from_fn(|i| match i {
        0..6 => 1.0 / 21.0,
        6..18 => 4.0 / 105.0,
        _ => 9.0 / 280.0,
    })
}

/// Reading between the 26 directions: the three whose spherical triangle holds `direction`, with weights
/// that are not negative and sum to 1; exact at the directions themselves and continuous everywhere.
///
/// Every direction has one axis, one edge and one corner around it, found by sorting |x|, |y|, |z|.
pub fn interpolate_26(direction: [f64; 3]) -> [(usize, f64); 3] {
    let mut order = [0usize, 1, 2];
    order.sort_by(|&a, &b| direction[b].abs().total_cmp(&direction[a].abs()));
    let [p, q, r] = order;
    let (big, middle, small) = (direction[p].abs(), direction[q].abs(), direction[r].abs());
    let bit = |axis: usize| usize::from(direction[axis] < 0.0);
    let axis = 2 * p + bit(p);
    let (a, b) = (p.min(q), p.max(q));
    let plane = a + b - 1;
    let edge = 6 + 4 * plane + 2 * bit(a) + bit(b);
    let corner = 18 + 4 * bit(0) + 2 * bit(1) + bit(2);
    let weights = [big - middle, libm::sqrt(2.0) * (middle - small), libm::sqrt(3.0) * small];
    let sum: f64 = weights.iter().sum();
    [(axis, weights[0] / sum), (edge, weights[1] / sum), (corner, weights[2] / sum)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Round-off of a sum of 26 products of numbers near 1.
    const ROUND_OFF: f64 = 1e-13;

    #[test]
    fn harmonics_up_to_degree_three_are_orthonormal_under_the_26_directions() {
        // Degree 7 integrates products up to degree 3 + 3 exactly.
        let (directions, weights) = (directions_26(), weights_26());
        for i in 0..MAX_HARMONICS {
            for j in 0..MAX_HARMONICS {
                let product: f64 = (0..26)
                    .map(|d| weights[d] * harmonics(directions[d])[i] * harmonics(directions[d])[j])
                    .sum::<f64>()
                    * 4.0
                    * std::f64::consts::PI;
                let wanted = if i == j { 1.0 } else { 0.0 };
                assert!((product - wanted).abs() < ROUND_OFF, "harmonics {i} and {j}: {product}");
            }
        }
    }

    #[test]
    fn interpolation_is_exact_at_the_directions_and_a_partition_of_one_between() {
        for (i, direction) in directions_26().into_iter().enumerate() {
            let found: f64 =
                interpolate_26(direction).iter().filter(|(index, _)| *index == i).map(|(_, w)| w).sum();
            assert!((found - 1.0).abs() < ROUND_OFF, "direction {i}");
        }
        for direction in [[0.36, 0.48, -0.8], [-0.6, 0.0, 0.8], [0.48, -0.6, 0.64]] {
            let parts = interpolate_26(direction);
            assert!(parts.iter().all(|(_, w)| *w >= 0.0));
            let mut mean = [0.0; 3];
            for (index, weight) in parts {
                for axis in 0..3 {
                    mean[axis] += weight * directions_26()[index][axis];
                }
            }
            let length = libm::sqrt(mean.iter().map(|v| v * v).sum());
            for axis in 0..3 {
                assert!((mean[axis] / length - direction[axis]).abs() < ROUND_OFF);
            }
        }
    }
}
