//! Where the table of scattered light has its nodes, and for which phase functions.
//!
//! Distances from the light are optical depths ρ, on y = ln ρ + ρ/2: close together near the light, where scattered light runs
//! as 1/ρ, and no farther apart than half a depth far from it, where it falls exponentially. Directions are told by q = sin(α/2),
//! α between the way that light travels and the way straight from its source, on x = ln(1 + q/q₀): light near the lamp itself
//! rises as −ln α.

/// Nodes over ρ.
pub const RADII: usize = 56;
/// Nodes over q.
pub const ANGLES: usize = 33;
/// ρ of the first shell's near edge: nearer to the light, its scattered light runs as 1/ρ.
pub const NEAREST: f64 = 0.004;
/// ρ of the last shell's far edge, where the medium ends.
pub const FARTHEST: f64 = 16.0;
/// Sine of half the angle at which nodes of direction begin to spread.
const NARROW: f64 = 0.01;
/// Asymmetries of Henyey and Greenstein's function that the table holds; beyond the ends it answers as at them.
pub const ASYMMETRIES: [f64; 10] = [-0.5, 0.0, 0.3, 0.5, 0.65, 0.77, 0.83, 0.884, 0.92, 0.95];
/// Phase functions in all: those, then the drops' in red, green and blue.
pub const PHASES: usize = ASYMMETRIES.len() + 3;
/// Values in all: by phase function, then ρ, then q.
pub const VALUES: usize = PHASES * RADII * ANGLES;

/// Places y of [`NEAREST`] and [`FARTHEST`], and ln(1 + 1/q₀): look-ups have no time to work them out.
const NEAREST_PLACE: f64 = -5.521460917862246 + 0.5 * NEAREST;
const FARTHEST_PLACE: f64 = 2.772588722239781 + 0.5 * FARTHEST;
const WIDE: f64 = 4.61512051684126;

/// Place y of an optical depth.
pub fn place(depth: f64) -> f64 {
    libm::log(depth) + 0.5 * depth
}

/// The optical depth of a place y.
fn depth(place: f64) -> f64 {
    // Newton's rule in ln ρ, where y is convex: from above it comes down without fail.
    let mut log = place.min(libm::log(FARTHEST) + 1.0);
    for _ in 0..60 {
        let half = 0.5 * libm::exp(log);
        log -= (log + half - place) / (1.0 + half);
    }
    libm::exp(log)
}

/// Width of a shell in y.
pub fn step() -> f64 {
    (FARTHEST_PLACE - NEAREST_PLACE) / RADII as f64
}

/// Optical depth of edge `index` of the shells, 0 to [`RADII`].
pub fn edge(index: usize) -> f64 {
    depth(NEAREST_PLACE + step() * index as f64)
}

/// Optical depth in the middle of a shell: a node.
pub fn radius(index: usize) -> f64 {
    depth(NEAREST_PLACE + step() * (index as f64 + 0.5))
}

/// Place of an optical depth among the nodes, from 0 to the last.
pub fn radius_place(depth: f64) -> f64 {
    ((place(depth.max(1e-9)) - NEAREST_PLACE) / step() - 0.5).clamp(0.0, (RADII - 1) as f64)
}

/// Place of q among `count` nodes from 0 to 1, as a real number from 0 to `count` − 1.
pub fn angle_place(sine: f64, count: usize) -> f64 {
    let share = libm::log1p(sine.clamp(0.0, 1.0) / NARROW) / WIDE;
    share * (count - 1) as f64
}

/// q at a place among `count` nodes.
pub fn sine(place: f64, count: usize) -> f64 {
    NARROW * libm::expm1(place / (count - 1) as f64 * WIDE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_nodes_are_each_others_inverse() {
        /// Logarithms and exponentials of numbers near 10.
        const ROUND_OFF: f64 = 1e-9;
        assert!((place(NEAREST) - NEAREST_PLACE).abs() < ROUND_OFF);
        assert!((place(FARTHEST) - FARTHEST_PLACE).abs() < ROUND_OFF);
        assert!((libm::log1p(1.0 / NARROW) - WIDE).abs() < ROUND_OFF);
        for i in 0..RADII {
            assert!((radius_place(radius(i)) - i as f64).abs() < ROUND_OFF, "{i}");
            assert!(edge(i) < radius(i) && radius(i) < edge(i + 1));
        }
        assert!(
            (edge(0) / NEAREST - 1.0).abs() < ROUND_OFF && (edge(RADII) / FARTHEST - 1.0).abs() < ROUND_OFF
        );
        for j in 0..ANGLES {
            let sine = sine(j as f64, ANGLES);
            assert!((angle_place(sine, ANGLES) - j as f64).abs() < ROUND_OFF);
        }
    }
}
