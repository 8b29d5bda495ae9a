//! How water that stands on an object comes to its normal, \[toyshop\] §4.

use glam::{Vec2, Vec3};

/// Where an object looks up the one lattice of ripples: the paper's scale s_o and angle θ_o, so that neighbours don't repeat each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RippleLookup {
    /// Metres of the world that a metre of the lattice covers, above 0; heights grow with it, slopes stay.
    pub scale: f32,
    /// Turn of the lattice in the ground's plane, radians, counter-clockwise.
    pub angle: f32,
    /// The lattice's corner, m.
    pub origin_m: [f32; 2],
}

impl Default for RippleLookup {
    fn default() -> Self {
        Self { scale: 1.0, angle: 0.0, origin_m: [0.0; 2] }
    }
}

impl RippleLookup {
    /// A place of the ground in the lattice, m.
    pub fn place(&self, ground_m: [f32; 2]) -> [f32; 2] {
        let offset = Vec2::from(ground_m) - Vec2::from(self.origin_m);
        (Vec2::new(libm::cosf(self.angle), -libm::sinf(self.angle)).rotate(offset) / self.scale).into()
    }

    /// Slopes found in the lattice, turned into the ground's axes.
    pub fn slope(&self, lattice: [f32; 2]) -> [f32; 2] {
        Vec2::new(libm::cosf(self.angle), libm::sinf(self.angle)).rotate(Vec2::from(lattice)).into()
    }
}

/// Upward unit normal of a surface with these slopes, z up.
pub fn normal_of(slope: [f32; 2]) -> Vec3 {
    Vec3::new(-slope[0], -slope[1], 1.0).normalize()
}

/// Normal of an object under water: between its own and the water's by depth times influence, the paper's d_i p_i. Depth is in metres, influence in
/// 1/m: water as deep as 1/influence hides what is below. Where there is no water the object's own normal is left as it is, bit by bit.
pub fn wet_normal(object: Vec3, water: Vec3, depth_m: f32, influence_per_m: f32) -> Vec3 {
    let share = (depth_m * influence_per_m).clamp(0.0, 1.0);
    if share > 0.0 { object.lerp(water, share).normalize_or(water) } else { object }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Single precision.
    const ROUND_OFF: f32 = 1e-6;

    #[test]
    fn no_water_leaves_the_normal_alone_and_deep_water_replaces_it() {
        let (object, water) = (Vec3::new(0.36, 0.48, 0.8), normal_of([0.1, -0.2]));
        assert_eq!(wet_normal(object, water, 0.0, 100.0), object);
        assert_eq!(wet_normal(object, water, f32::NAN, 100.0), object);
        assert!(wet_normal(object, water, 0.02, 100.0).distance(water) < ROUND_OFF);
        let half = wet_normal(object, water, 0.005, 100.0);
        assert!((half.dot(object) - half.dot(water)).abs() < ROUND_OFF);
    }

    #[test]
    fn a_turned_lattice_slopes_as_the_turned_surface() {
        // The surface z = a·p of the lattice, seen from the ground, has the gradient turned by the lattice's angle.
        let lookup = RippleLookup { scale: 3.0, angle: 0.7, origin_m: [5.0, -2.0] };
        let gradient = [0.3, 0.1];
        let height = |ground: [f32; 2]| {
            let [x, y] = lookup.place(ground);
            lookup.scale * (gradient[0] * x + gradient[1] * y)
        };
        let slope = lookup.slope(gradient);
        for (axis, step) in [[0.5, 0.0], [0.0, 0.5]].iter().enumerate() {
            let rise = height([7.0 + step[0], 1.0 + step[1]]) - height([7.0 - step[0], 1.0 - step[1]]);
            assert!((rise - slope[axis]).abs() < 10.0 * ROUND_OFF, "{rise} {slope:?}");
        }
    }
}
