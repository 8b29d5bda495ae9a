//! Where it rains: everywhere, or below a ceiling, or within a radius, each with a soft edge.
//!
//! The share of full rain is a product of two ramps, one linear in height and one linear in horizontal
//! distance from a centre. Along a ray both are elementary, so the length of rain that a ray crosses has a
//! closed form: no marching, and the same number whatever the distance.

use crate::camera::Ray;
use glam::DVec3;
use squall_formats::units::Metres;

/// Rain only below a height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ceiling {
    /// Full rain below this height z.
    pub height: Metres,
    /// Rain fades to nothing over this much above, ≥ 0.
    pub softness: Metres,
}

/// Rain only within a vertical cylinder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Axis of the cylinder, x and y in m.
    pub centre: [f64; 2],
    /// Full rain within this radius.
    pub radius: Metres,
    /// Rain fades to nothing over this much outside, ≥ 0.
    pub softness: Metres,
}

/// Where it rains; everywhere by default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RainVolume {
    /// Upper bound, if any.
    pub ceiling: Option<Ceiling>,
    /// Horizontal bound, if any.
    pub region: Option<Region>,
}

/// A factor along one piece of a ray: c0 + c1 s + c2 r(s), r the distance from the region's axis.
#[derive(Clone, Copy)]
struct RayPiece {
    constant: f64,
    linear: f64,
    radial: f64,
}

const NOTHING: RayPiece = RayPiece { constant: 0.0, linear: 0.0, radial: 0.0 };
const FULL: RayPiece = RayPiece { constant: 1.0, linear: 0.0, radial: 0.0 };

/// r(s)² = a s² + 2 b s + c along a ray, or its shape after completing the square.
#[derive(Clone, Copy)]
struct Radius {
    a: f64,
    b: f64,
    c: f64,
}

impl RainVolume {
    /// Whether there is no bound at all.
    pub fn is_everywhere(&self) -> bool {
        self.ceiling.is_none() && self.region.is_none()
    }

    /// Share of full rain at `point`, in [0, 1].
    pub fn density(&self, point: DVec3) -> f64 {
        let ramp = |value: f64, full: f64, softness: f64| {
            if value <= full {
                1.0
            } else if softness > 0.0 {
                (1.0 - (value - full) / softness).max(0.0)
            } else {
                0.0
            }
        };
        let below = self.ceiling.map_or(1.0, |c| ramp(point.z, c.height.0, c.softness.0));
        let inside = self.region.map_or(1.0, |r| {
            let (x, y) = (point.x - r.centre[0], point.y - r.centre[1]);
            ramp((x * x + y * y).sqrt(), r.radius.0, r.softness.0)
        });
        below * inside
    }

    /// Whether rain is full throughout the ball around `centre`.
    pub fn fills(&self, centre: DVec3, radius: f64) -> bool {
        radius <= self.filled_radius(centre)
    }

    /// Largest radius of a ball around `centre` in which rain is full; negative where it is not full at the centre itself, and
    /// infinite without bounds.
    pub fn filled_radius(&self, centre: DVec3) -> f64 {
        let below = self.ceiling.map_or(f64::INFINITY, |c| c.height.0 - centre.z);
        let inside = self.region.map_or(f64::INFINITY, |r| {
            let (x, y) = (centre.x - r.centre[0], centre.y - r.centre[1]);
            r.radius.0 - (x * x + y * y).sqrt()
        });
        below.min(inside)
    }

    /// Metres of full rain on the ray between the distances `from` ≥ 0 and `to`: ∫ density ds, exact up to
    /// round-off; `to` may be infinite, and then so may the answer.
    pub fn path(&self, ray: &Ray, from: f64, to: f64) -> f64 {
        if from.is_nan() || to.is_nan() || from >= to {
            return 0.0;
        }
        if self.is_everywhere() {
            return to - from;
        }
        let radius = self.radius(ray);
        let mut cuts = [f64::INFINITY; 8];
        cuts[0] = from;
        cuts[1] = to;
        let mut count = 2;
        let mut cut = |s: f64| {
            if s > from && s < to {
                cuts[count] = s;
                count += 1;
            }
        };
        if let Some(Ceiling { height, softness }) = self.ceiling {
            for z in [height.0, height.0 + softness.0] {
                cut((z - ray.origin.z) / ray.direction.z);
            }
        }
        if let Some(Region { radius: full, softness, .. }) = self.region {
            for r in [full.0, full.0 + softness.0] {
                for s in radius.crossings(r) {
                    cut(s);
                }
            }
        }
        let cuts = &mut cuts[..count];
        cuts.sort_unstable_by(f64::total_cmp);
        let mut sum = 0.0;
        for pair in cuts.windows(2) {
            sum += self.piece_path(ray, radius, pair[0], pair[1]);
        }
        sum
    }

    /// Where a ray enters and leaves the region's full rain and its edge; NaN or ∞ where it does not.
    pub(super) fn region_cuts(&self, ray: &Ray) -> [f64; 4] {
        let Some(Region { radius: full, softness, .. }) = self.region else { return [f64::INFINITY; 4] };
        let radius = self.radius(ray);
        let ([a, b], [c, d]) = (radius.crossings(full.0), radius.crossings(full.0 + softness.0));
        [a, b, c, d]
    }

    fn radius(&self, ray: &Ray) -> Radius {
        let centre = self.region.map_or([0.0; 2], |r| r.centre);
        let (x, y) = (ray.origin.x - centre[0], ray.origin.y - centre[1]);
        let d = ray.direction;
        Radius { a: d.x * d.x + d.y * d.y, b: x * d.x + y * d.y, c: x * x + y * y }
    }

    /// The path on a stretch that no ramp's end falls into.
    fn piece_path(&self, ray: &Ray, radius: Radius, from: f64, to: f64) -> f64 {
        // A far end decides nothing but which side of each ramp the stretch is on.
        let middle = if to.is_finite() { 0.5 * (from + to) } else { from + 1.0 };
        let below = self.ceiling.map_or(FULL, |Ceiling { height, softness }| {
            let z = ray.origin.z + middle * ray.direction.z;
            if z <= height.0 {
                FULL
            } else if z >= height.0 + softness.0 {
                NOTHING
            } else {
                let constant = 1.0 + (height.0 - ray.origin.z) / softness.0;
                RayPiece { constant, linear: -ray.direction.z / softness.0, radial: 0.0 }
            }
        });
        let inside = self.region.map_or(FULL, |Region { radius: full, softness, .. }| {
            let r = radius.at(middle);
            if r <= full.0 {
                FULL
            } else if r >= full.0 + softness.0 {
                NOTHING
            } else {
                RayPiece { constant: 1.0 + full.0 / softness.0, linear: 0.0, radial: -1.0 / softness.0 }
            }
        });
        let share =
            (below.constant + below.linear * middle) * (inside.constant + inside.radial * radius.at(middle));
        if share <= 0.0 {
            return 0.0;
        }
        if to.is_infinite() {
            return f64::INFINITY;
        }
        // (b0 + b1 s)(i0 + i2 r): the four integrals 1, s, r, s r.
        let length = to - from;
        let plain = below.constant * length + below.linear * length * 0.5 * (from + to);
        let mut sum = inside.constant * plain;
        if inside.radial != 0.0 {
            let [r, sr] = radius.integrals(from, to);
            sum += inside.radial * (below.constant * r + below.linear * sr);
        }
        sum.clamp(0.0, length)
    }
}

impl Radius {
    fn at(self, s: f64) -> f64 {
        (self.c + s * (2.0 * self.b + s * self.a)).max(0.0).sqrt()
    }

    /// Where r(s) = `wanted`; NaN, which no comparison lets through, where it never does.
    fn crossings(self, wanted: f64) -> [f64; 2] {
        let root = (self.b * self.b - self.a * (self.c - wanted * wanted)).sqrt();
        [(-self.b - root) / self.a, (-self.b + root) / self.a]
    }

    /// ∫ r ds and ∫ s r ds between two distances.
    fn integrals(self, from: f64, to: f64) -> [f64; 2] {
        // A vertical ray keeps its radius.
        if self.a < 1e-24 {
            let r = self.at(0.5 * (from + to));
            return [r * (to - from), r * 0.5 * (to * to - from * from)];
        }
        // r = √a √(σ² + δ²) with σ = s + b/a.
        let shift = self.b / self.a;
        let delta2 = ((self.c - self.b * shift) / self.a).max(0.0);
        let root_a = self.a.sqrt();
        let at = |s: f64| {
            let sigma = s + shift;
            let root = (sigma * sigma + delta2).sqrt();
            // σ + √(σ² + δ²), which loses no digits on either side.
            let sum = if sigma < 0.0 { delta2 / (root - sigma) } else { sigma + root };
            [sigma * root, root * root * root / 3.0, sum]
        };
        let [[plain1, cube1, sum1], [plain0, cube0, sum0]] = [at(to), at(from)];
        // The difference of two inverse hyperbolic sines is one logarithm.
        // A ray through the axis itself has none of it.
        let log = if delta2 > 1e-100 { delta2 * libm::log(sum1 / sum0) } else { 0.0 };
        let r = 0.5 * (plain1 - plain0 + log);
        [root_a * r, root_a * (cube1 - cube0 - shift * r)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const VOLUME: RainVolume = RainVolume {
        ceiling: Some(Ceiling { height: Metres(300.0), softness: Metres(100.0) }),
        region: Some(Region { centre: [50.0, -20.0], radius: Metres(400.0), softness: Metres(250.0) }),
    };

    /// 20 000 midpoints over piecewise smooth ramps.
    fn marched(volume: &RainVolume, ray: &Ray, from: f64, to: f64) -> f64 {
        let count = 20_000;
        let step = (to - from) / f64::from(count);
        let at = |i| volume.density(ray.origin + ray.direction * (from + step * (f64::from(i) + 0.5)));
        (0..count).map(at).sum::<f64>() * step
    }

    #[test]
    fn the_closed_form_is_the_integral_for_rays_of_every_kind() {
        let mut random = Random::new(5);
        let hard = RainVolume {
            ceiling: Some(Ceiling { height: Metres(300.0), softness: Metres(0.0) }),
            region: Some(Region { centre: [50.0, -20.0], radius: Metres(400.0), softness: Metres(0.0) }),
        };
        let no_region = RainVolume { region: None, ..VOLUME };
        let no_ceiling = RainVolume { ceiling: None, ..VOLUME };
        for i in 0..400 {
            let direction = match i % 5 {
                0 => DVec3::Z,
                1 => DVec3::X,
                2 => DVec3::new(1.0, 0.5, 1e-9).normalize(),
                _ => random.direction(),
            };
            let origin = DVec3::new(
                random.range(-900.0, 900.0),
                if i % 7 == 0 { -20.0 } else { random.range(-900.0, 900.0) },
                random.range(0.0, 500.0),
            );
            let ray = Ray { origin, direction };
            let from = random.range(0.0, 50.0);
            let to = from + random.range(0.0, 2000.0);
            for volume in [VOLUME, hard, no_region, no_ceiling] {
                let (found, wanted) = (volume.path(&ray, from, to), marched(&volume, &ray, from, to));
                // A hard edge costs the midpoint rule half a step, 0.05 m; soft ones far less.
                assert!((found - wanted).abs() < 0.15, "{i} {ray:?} {volume:?}: {found} {wanted}");
            }
        }
    }

    #[test]
    fn endless_rays_leave_bounded_rain_and_never_leave_the_unbounded() {
        let up = Ray { origin: DVec3::ZERO, direction: DVec3::Z };
        let level = Ray { origin: DVec3::ZERO, direction: DVec3::X };
        assert_eq!(RainVolume::default().path(&up, 0.0, f64::INFINITY), f64::INFINITY);
        // Half of the soft 100 m counts.
        assert!((VOLUME.path(&up, 0.0, f64::INFINITY) - 350.0).abs() < 1e-9);
        assert!(VOLUME.path(&level, 0.0, f64::INFINITY) < 800.0);
        let slab = RainVolume { region: None, ..VOLUME };
        assert_eq!(slab.path(&level, 0.0, f64::INFINITY), f64::INFINITY);
        let above = Ray { origin: DVec3::Z * 500.0, direction: DVec3::X };
        assert_eq!(slab.path(&above, 0.0, f64::INFINITY), 0.0);
    }

    #[test]
    fn density_is_one_inside_and_zero_outside() {
        assert_eq!(VOLUME.density(DVec3::ZERO), 1.0);
        assert_eq!(VOLUME.density(DVec3::Z * 350.0), 0.5);
        assert_eq!(VOLUME.density(DVec3::Z * 400.0), 0.0);
        assert_eq!(VOLUME.density(DVec3::X * 5000.0), 0.0);
        assert!(VOLUME.fills(DVec3::ZERO, 100.0) && !VOLUME.fills(DVec3::ZERO, 400.0));
    }
}
