//! Directions on the unfolded octahedron: a square without poles, and no sine to work out.

use glam::{DVec3, Vec3};

/// Place of a direction of any length, both in [−1, 1].
#[inline]
pub fn fold(d: Vec3) -> [f32; 2] {
    let size = d.x.abs() + d.y.abs() + d.z.abs();
    let (x, y) = (d.x / size, d.y / size);
    match d.z >= 0.0 {
        true => [x, y],
        false => [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)],
    }
}

/// The unit direction at a place.
pub fn unfold(x: f64, y: f64) -> DVec3 {
    let z = 1.0 - x.abs() - y.abs();
    let flat = if z >= 0.0 { [x, y] } else { [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)] };
    DVec3::new(flat[0], flat[1], z).normalize()
}
