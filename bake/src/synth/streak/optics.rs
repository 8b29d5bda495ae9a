//! Light through a drop: rays traced backwards, from the eye through the surface to the surroundings.
//!
//! A ray that meets the drop splits by Fresnel's equations (unpolarised, index 1.333). What enters is followed
//! from wall to wall; at each wall a part leaves toward the surroundings. Radiance over the square of the
//! index is kept along every part, so the eye sees the surroundings' radiance times the shares.

use super::shape::Surface;
use glam::DVec3;

/// Refractive index of water in visible light.
const WATER: f64 = 1.333;
/// Walls that a ray is followed to inside the drop at most, and the share of its light that is followed no
/// further: most rays are done after the second wall.
const WALLS: usize = 6;
const FAINT: f64 = 1e-3;
/// Newton steps to a surface, and how near they end, radii.
const STEPS: usize = 24;
const ON_SURFACE: f64 = 1e-5;

/// Radiance that a ray from outside carries to the eye: `origin` and unit `direction` away from the eye, in radii
/// about the drop's centre. `None` when it misses the drop.
///
/// What is followed no further counts as `mean`, so that a drop in uniform surroundings of that radiance is
/// invisible.
pub fn radiance(
    surface: &Surface,
    origin: DVec3,
    direction: DVec3,
    surroundings: &impl Fn(DVec3) -> f64,
    mean: f64,
) -> Option<f64> {
    let mut place = enter(surface, origin, direction)?;
    let normal = surface.above(place).1.normalize();
    let (reflected, refracted) = split(direction, normal, 1.0 / WATER);
    let mut seen = reflected.share * surroundings(reflected.direction);
    let mut left = 1.0 - reflected.share;
    let Some(mut inside) = refracted else { return Some(seen) };
    for _ in 0..WALLS {
        place = leave(surface, place, inside);
        let normal = -surface.above(place).1.normalize();
        let (reflected, refracted) = split(inside, normal, WATER);
        if let Some(outside) = refracted {
            seen += left * (1.0 - reflected.share) * surroundings(outside);
        }
        left *= reflected.share;
        if left < FAINT {
            break;
        }
        inside = reflected.direction;
    }
    Some(seen + left * mean)
}

struct Reflected {
    direction: DVec3,
    share: f64,
}

/// A ray at an interface: `normal` against it, `ratio` of the index before to the one behind. No refracted ray
/// beyond the critical angle, and all of the light in the reflected one.
fn split(direction: DVec3, normal: DVec3, ratio: f64) -> (Reflected, Option<DVec3>) {
    let before = -direction.dot(normal);
    let mirrored = direction + normal * (2.0 * before);
    let square = 1.0 - ratio * ratio * (1.0 - before * before);
    // Numbers may put a grazing ray behind the surface: it is mirrored whole.
    if square <= 0.0 || before <= 0.0 {
        return (Reflected { direction: mirrored, share: 1.0 }, None);
    }
    let behind = libm::sqrt(square);
    let across = (ratio * before - behind) / (ratio * before + behind);
    let along = (before - ratio * behind) / (before + ratio * behind);
    let share = 0.5 * (across * across + along * along);
    let refracted = direction * ratio + normal * (ratio * before - behind);
    (Reflected { direction: mirrored, share }, Some(refracted.normalize()))
}

/// First point of the surface on a ray from outside.
fn enter(surface: &Surface, origin: DVec3, direction: DVec3) -> Option<DVec3> {
    let bound = surface.bound();
    let middle = -origin.dot(direction);
    let off = (origin + direction * middle).length_squared();
    if off >= bound * bound {
        return None;
    }
    let half = libm::sqrt(bound * bound - off);
    // The height above the surface is nearly convex along a line: Newton's method comes down to the first root
    // from before, and turns upward where there is none.
    let (mut t, end) = (middle - half, middle + half);
    for _ in 0..STEPS {
        let place = origin + direction * t;
        let (height, gradient) = surface.above(place);
        if height < ON_SURFACE {
            return Some(place);
        }
        let slope = gradient.dot(direction);
        t -= height / slope;
        if slope >= 0.0 || t >= end {
            return None;
        }
    }
    // Grazing: the root is double, and the ray as good as past.
    None
}

/// Where a ray from the surface inward meets the surface again: Newton's method from beyond, kept between a
/// point inside and one outside.
fn leave(surface: &Surface, from: DVec3, direction: DVec3) -> DVec3 {
    let bound = surface.bound();
    let middle = -from.dot(direction);
    let off = (from + direction * middle).length_squared();
    let far = middle + libm::sqrt((bound * bound - off).max(0.0));
    let (mut inside, mut outside) = (0.0, far);
    let mut t = far;
    for _ in 0..STEPS {
        let (height, gradient) = surface.above(from + direction * t);
        if height.abs() < ON_SURFACE {
            break;
        }
        if height > 0.0 {
            outside = t;
        } else {
            inside = t;
        }
        t -= height / gradient.dot(direction);
        if !(t > inside && t < outside) {
            t = 0.5 * (inside + outside);
        }
    }
    from + direction * t
}

#[cfg(test)]
mod tests {
    use super::super::shape::{DropShape, Mode};
    use super::*;
    use std::cell::RefCell;

    fn sphere() -> Surface {
        DropShape::new(0.0, vec![]).at(0.0)
    }

    fn wobbling() -> Surface {
        let mode = |degree, order, amplitude, phase| Mode { degree, order, azimuth: 0.8, amplitude, phase };
        DropShape::new(3.0, vec![mode(2, 0, 0.1, 1.2), mode(3, 1, 0.08, 0.4), mode(2, 2, 0.05, 2.0)]).at(0.0)
    }

    #[test]
    fn in_uniform_surroundings_a_drop_is_invisible() {
        /// Sums of shares that are 1 but for round-off.
        const ROUND_OFF: f64 = 1e-12;
        for surface in [sphere(), wobbling()] {
            let mut met = 0;
            for step in 0..400 {
                let (x, z) = (0.13 * f64::from(step % 20) - 1.2, 0.13 * f64::from(step / 20) - 1.2);
                let origin = DVec3::new(x, -3.0, z);
                if let Some(seen) = radiance(&surface, origin, DVec3::Y, &|_| 0.7, 0.7) {
                    assert!((seen - 0.7).abs() < ROUND_OFF, "{x}, {z}: {seen}");
                    met += 1;
                }
            }
            assert!((150..250).contains(&met), "{met}");
        }
    }

    #[test]
    fn a_sphere_turns_light_by_descartes_angles() {
        /// Points on the surface are found to 10⁻⁵ radii; a grazing normal turns faster.
        const ANGLE: f64 = 3e-4;
        let surface = sphere();
        for step in 1..20 {
            let b = 0.05 * f64::from(step);
            let seen = RefCell::new(vec![]);
            let note = |direction: DVec3| {
                seen.borrow_mut().push(direction);
                1.0
            };
            radiance(&surface, DVec3::new(b, -3.0, 0.0), DVec3::Y, &note, 1.0).unwrap();
            let (i, r) = (libm::asin(b), libm::asin(b / WATER));
            // Mirrored, straight through, then once and twice mirrored inside: deviations modulo a turn.
            let turned = [std::f64::consts::PI - 2.0 * i, 2.0 * (i - r)];
            let more = [1.0, 2.0].map(|k| 2.0 * (i - r) + k * (std::f64::consts::PI - 2.0 * r));
            for (direction, wanted) in seen.borrow().iter().zip(turned.into_iter().chain(more)) {
                let cosine = direction.dot(DVec3::Y);
                assert!((cosine - libm::cos(wanted)).abs() < ANGLE, "b = {b}: {cosine} for {wanted}");
            }
        }
    }

    #[test]
    fn the_rainbow_stands_at_138_degrees() {
        let surface = sphere();
        let mut least = f64::INFINITY;
        for step in 0..1000 {
            let order = RefCell::new(0);
            let turned = RefCell::new(0.0);
            let note = |direction: DVec3| {
                *order.borrow_mut() += 1;
                if *order.borrow() == 3 {
                    *turned.borrow_mut() = libm::acos(direction.dot(DVec3::Y)).to_degrees();
                }
                1.0
            };
            let origin = DVec3::new(0.001 * f64::from(step), -3.0, 0.0);
            if radiance(&surface, origin, DVec3::Y, &note, 1.0).is_some() {
                least = least.min(*turned.borrow());
            }
        }
        // Descartes' ray for n = 1.333: 137.92°.
        assert!((least - 137.92).abs() < 0.02, "{least}");
    }
}
