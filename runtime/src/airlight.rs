//! Light of points in rain, scattered once into a ray: halos of lamps and of lightning channels.
//!
//! A point of intensity I at distance h from a ray, t₀ along it, in a medium of extinction β that scatters all it takes:
//! L = (β I/h) e^{−β t₀} [F(βh, ψ₁) − F(βh, ψ₀)], F(A, ψ) = ∫ p(cos θ = −sin ψ') e^{−A tan(ψ'/2 + π/4)} dψ' from −π/2 to ψ,
//! where h tan ψ is the place along the ray, counted from the point's foot: ψ₀ at the eye, ψ₁ at what the ray ends on. So a table of
//! two numbers holds every point, ray and depth (Sun et al. 2005 for even scattering, with p in the integral for any). It is kept
//! over s = ((1 − tan(ψ/2))/2)^½, which needs no arc tangent and is fine where rays run away from the point.
//!
//! | symbol | name        | unit |
//! | I      | `intensity` | W/sr |
//! | β      | extinction  | 1/m  |
//! | A      | βh          | –    |

mod past;
#[cfg(feature = "gpu")]
mod upload;

pub(crate) use past::LitPieces;

use crate::medium::Phase;
use glam::DVec3;

/// Nodes over A and over s.
const THICKNESSES: usize = 192;
const PLACES: usize = 257;
/// Largest A in the table; beyond it less than e^−16 of anything is left.
const THICKEST: f64 = 16.0;
/// Nodes below which a piece of ray is integrated without the table.
const FEWEST: f64 = 6.0;
/// Place s of the eye below which a point is well behind it: ψ₀ above 45°.
const BEHIND: f64 = 0.541;
/// Steps of Simpson's rule between two nodes.
const STEPS: usize = 4;

/// F of one phase function.
#[derive(Clone, Debug, PartialEq)]
pub struct Airlight {
    phase: Phase,
    /// F by place, then thickness; per colour.
    table: Vec<[f32; 3]>,
}

/// What a ray sees of a point: where the point stands beside it, and how far the ray goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointBeside {
    /// Distance of the point from the ray's line, m.
    pub h: f64,
    /// Of its foot along the ray from the eye, m; negative behind the eye.
    pub foot: f64,
    /// Where the ray ends, m; may be infinite.
    pub end: f64,
}

impl PointBeside {
    /// The point at `place` beside the ray from `eye` in unit `direction`, no nearer to it than `radius` m.
    pub fn new(place: DVec3, eye: DVec3, direction: DVec3, end: f64, radius: f64) -> Self {
        let way = place - eye;
        let foot = way.dot(direction);
        let h = (way - direction * foot).length().max(radius);
        Self { h, foot, end }
    }
}

/// The thickness of a node: close together where the exponential bends.
fn thickness(node: usize) -> f64 {
    let at = node as f64 / (THICKNESSES - 1) as f64;
    THICKEST * at * at
}

/// tan(ψ/2 + π/4) at a place s, and p dψ/ds there: w = tan(ψ/2) = 1 − 2s², sin ψ = 2w/(1 + w²), dψ = 2 dw/(1 + w²),
/// tan(ψ/2 + π/4) = (1 + w)/(1 − w).
fn density(phase: &Phase, s: f64) -> (f64, [f64; 3]) {
    let w = 1.0 - 2.0 * s * s;
    let share = 2.0 / (1.0 + w * w);
    let rise = if s > 0.0 { (1.0 - s * s) / (s * s) } else { f64::INFINITY };
    (rise, phase.values(-w * share).map(|value| value * share * 4.0 * s))
}

/// s of the place t along the ray from the foot: 1 − t/(r + h), in a form that keeps its digits far from the point.
fn place(h: f64, t: f64) -> f64 {
    if t == f64::INFINITY {
        return 0.0;
    }
    let r = (t * t + h * h).sqrt();
    let rest = if t > 0.0 { h * h / (r + t) } else { r - t };
    (0.5 * (rest + h) / (r + h)).sqrt()
}

impl Airlight {
    /// Works the table out, some milliseconds.
    pub fn new(phase: &Phase) -> Self {
        let mut table = vec![[0.0f32; 3]; THICKNESSES * PLACES];
        // Simpson's nodes over s, from 1 down to 0.
        let fine = (PLACES - 1) * 2 * STEPS;
        let nodes: Vec<(f64, [f64; 3])> =
            (0..=fine).map(|i| density(phase, 1.0 - i as f64 / fine as f64)).collect();
        let step = 1.0 / fine as f64;
        for k in 0..THICKNESSES {
            let thickness = thickness(k);
            let at = |i: usize| {
                let (rise, value) = &nodes[i];
                // Nothing dims a ray in a medium of no thickness, however long.
                let left = if thickness == 0.0 { 1.0 } else { libm::exp(-thickness * rise) };
                value.map(|value| value * left)
            };
            let mut sum = [0.0f64; 3];
            for place in 1..PLACES {
                for i in (place - 1) * STEPS..place * STEPS {
                    let [a, b, c] = [at(2 * i), at(2 * i + 1), at(2 * i + 2)];
                    (0..3).for_each(|band| sum[band] += step / 3.0 * (a[band] + 4.0 * b[band] + c[band]));
                }
                table[place * THICKNESSES + k] = sum.map(|value| value as f32);
            }
        }
        Self { phase: phase.clone(), table }
    }

    /// The phase function.
    pub fn phase(&self) -> &Phase {
        &self.phase
    }

    /// F of a whole line in a medium of no thickness, its largest, of the brightest colour: a bound on what a ray sees.
    pub fn most(&self) -> f64 {
        let whole = self.table[(PLACES - 1) * THICKNESSES];
        f64::from(whole[0].max(whole[1]).max(whole[2]))
    }

    /// F between two places s, for an A within the table.
    fn between(&self, thickness: f64, from: f64, to: f64) -> [f64; 3] {
        // Between nodes the table knows F's mean slope only, and far behind the eye F falls too fast: Gauss's rule instead.
        if (from - to) * ((PLACES - 1) as f64) < FEWEST {
            return self.by_rule(thickness, from, to, 1);
        }
        if from < BEHIND {
            return self.by_rule(thickness, from, to, 12);
        }
        let node = (thickness / THICKEST).sqrt() * (THICKNESSES - 1) as f64;
        // A parabola in A through three nodes.
        let k = (node as usize).clamp(1, THICKNESSES - 2) - 1;
        let [a, b, c] = [k, k + 1, k + 2].map(self::thickness);
        let weights = [
            (thickness - b) * (thickness - c) / ((a - b) * (a - c)),
            (thickness - a) * (thickness - c) / ((b - a) * (b - c)),
            (thickness - a) * (thickness - b) / ((c - a) * (c - b)),
        ];
        let at = |s: f64| -> [f64; 3] {
            let place = (1.0 - s.clamp(0.0, 1.0)) * (PLACES - 1) as f64;
            let i = (place as usize).min(PLACES - 2);
            let v = place - i as f64;
            let value = |i: usize, band: usize| -> f64 {
                let row = i * THICKNESSES + k;
                (0..3).map(|at| weights[at] * f64::from(self.table[row + at][band])).sum()
            };
            std::array::from_fn(|band| value(i, band) + v * (value(i + 1, band) - value(i, band)))
        };
        let (far, near) = (at(to), at(from));
        std::array::from_fn(|band| (far[band] - near[band]).max(0.0))
    }

    /// The same by Gauss's rule of three points in each of some equal panels.
    fn by_rule(&self, thickness: f64, from: f64, to: f64, panels: usize) -> [f64; 3] {
        let size = (from - to) / panels as f64;
        let mut sum = [0.0; 3];
        for panel in 0..panels {
            let middle = to + size * (panel as f64 + 0.5);
            for (weight, off) in [(5.0, -0.5), (8.0, 0.0), (5.0, 0.5)] {
                let (rise, value) = density(&self.phase, middle + off * size * 0.6f64.sqrt());
                let left = if thickness == 0.0 { 1.0 } else { libm::exp(-thickness * rise) };
                (0..3).for_each(|band| sum[band] += size * weight / 18.0 * value[band] * left);
            }
        }
        sum
    }

    /// Radiance per unit of the point's intensity that a medium of this extinction, 1/m, scatters into a ray, 1/m² per colour. Within
    /// 1 % of quadrature, wherever more than a millionth arrives of what a clear way would let through.
    pub fn of_point(&self, extinction: f64, beside: &PointBeside) -> [f64; 3] {
        let PointBeside { h, foot, end } = *beside;
        let thickness = extinction * h;
        if thickness >= THICKEST || end <= 0.0 || extinction <= 0.0 {
            return [0.0; 3];
        }
        // Far behind the eye F falls faster than a double can hold, and the factor before it grows as fast: light
        // that comes through a depth of e^−709 is none.
        let growth = libm::exp(-extinction * foot);
        if !growth.is_finite() {
            return [0.0; 3];
        }
        let share = extinction / h * growth;
        self.between(thickness, place(h, -foot), place(h, end - foot)).map(|value| value * share)
    }

    /// The same of a line between two ends, per unit of the whole line's intensity: points no farther apart than half the line's least
    /// distance from the ray, but 16 at most; each then counts as a ball as large as its piece.
    pub fn of_line(
        &self,
        extinction: f64,
        [from, to]: [DVec3; 2],
        eye: DVec3,
        direction: DVec3,
        end: f64,
    ) -> [f64; 3] {
        let length = from.distance(to);
        let nearest = least_distance([from, to], eye, direction);
        let count = (2.0 * length / nearest.max(1e-9)).ceil().clamp(1.0, 16.0);
        // A point counts as a ball of the piece that it stands for.
        let radius = 0.5 * length / count;
        let mut sum = [0.0; 3];
        for i in 0..count as usize {
            let place = from.lerp(to, (i as f64 + 0.5) / count);
            let own = self.of_point(extinction, &PointBeside::new(place, eye, direction, end, radius));
            (0..3).for_each(|band| sum[band] += own[band] / count);
        }
        sum
    }
}

/// The least distance between a line's pieces and the straight line through a ray, m.
fn least_distance([from, to]: [DVec3; 2], eye: DVec3, direction: DVec3) -> f64 {
    let across = |vector: DVec3| vector - direction * vector.dot(direction);
    let (start, way) = (across(from - eye), across(to - from));
    let share = (-start.dot(way) / way.length_squared().max(1e-30)).clamp(0.0, 1.0);
    (start + way * share).length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// The integral itself, by midpoints in the angle at the point.
    fn integral(phase: &Phase, extinction: f64, beside: &PointBeside) -> f64 {
        let PointBeside { h, foot, end } = *beside;
        let angle = |t: f64| libm::atan2(t, h);
        let (low, high) =
            (angle(-foot), if end.is_finite() { angle(end - foot) } else { std::f64::consts::FRAC_PI_2 });
        let count = 40_000;
        let step = (high - low) / f64::from(count);
        let at = |i: i32| {
            let psi = low + (f64::from(i) + 0.5) * step;
            let (sin, cos) = libm::sincos(psi);
            let along = foot + h * sin / cos;
            phase.values(-sin)[0] * libm::exp(-extinction * (h / cos + along))
        };
        (0..count).map(at).sum::<f64>() * step * extinction / h
    }

    #[test]
    fn the_table_is_within_a_per_cent_of_quadrature() {
        /// What is asked for.
        const ALLOWED: f64 = 0.01;
        let mut random = Random::new(6);
        let drops = Phase::Table(std::sync::Arc::new(crate::medium::PhaseTable::drops()));
        let even = [0.0, 0.77, 0.9].map(Phase::HenyeyGreenstein);
        for phase in even.into_iter().chain([drops]) {
            let airlight = Airlight::new(&phase);
            let mut worst = 0.0f64;
            for i in 0..400 {
                let extinction = 1e-4 * libm::pow(1e3, random.unit());
                let h = 0.1 * libm::pow(2e4, random.unit());
                let foot = random.range(-200.0, 2000.0);
                // Cut in front of the point, behind it, or not at all.
                let end = match i % 3 {
                    0 => f64::INFINITY,
                    1 => (foot + h).max(50.0),
                    _ => (foot - h).max(30.0),
                };
                let beside = PointBeside { h, foot, end };
                let whole = integral(&phase, extinction, &PointBeside { end: f64::INFINITY, ..beside });
                let (found, wanted) =
                    (airlight.of_point(extinction, &beside)[0], integral(&phase, extinction, &beside));
                // A millionth of what the light would scatter on a clear way is seen by no one.
                let clear = airlight.most() * extinction / h;
                if wanted < 1e-3 * whole || wanted < 1e-6 * clear {
                    continue;
                }
                worst = worst.max((found / wanted - 1.0).abs());
                assert!(
                    (found / wanted - 1.0).abs() < ALLOWED,
                    "g {:.2}, {extinction} {beside:?}: {found} {wanted}",
                    phase.moments(1)[0]
                );
            }
            println!("g {:.2}: worst {worst:.1e}", phase.moments(1)[0]);
        }
    }

    #[test]
    fn two_halves_of_a_line_are_the_line_and_a_short_one_is_a_point() {
        let airlight = Airlight::new(&Phase::HenyeyGreenstein(0.77));
        let (eye, direction) = (DVec3::ZERO, DVec3::new(0.0, 1.0, 0.1).normalize());
        let (a, b) = (DVec3::new(120.0, 1000.0, 0.0), DVec3::new(140.0, 1000.0, 200.0));
        let line = |a, b| airlight.of_line(1e-3, [a, b], eye, direction, 3000.0)[0];
        let middle = 0.5 * (a + b);
        let halves = 0.5 * (line(a, middle) + line(middle, b));
        /// A sum of points half their distance from the ray apart.
        const RULE: f64 = 0.02;
        assert!((line(a, b) / halves - 1.0).abs() < RULE, "{} {halves}", line(a, b));
        let point = airlight.of_point(1e-3, &PointBeside::new(middle, eye, direction, 3000.0, 0.0))[0];
        /// A centimetre at a hundred metres.
        const SHORT: f64 = 1e-3;
        assert!((line(middle, middle + DVec3::Z * 0.01) / point - 1.0).abs() < SHORT);
    }

    #[test]
    fn a_line_one_of_whose_ends_comes_near_the_ray_is_its_quadrature() {
        /// Points at half the least distance; where 16 are too few for that, balls as large as their pieces.
        const RULE: f64 = 0.03;
        let airlight = Airlight::new(&Phase::HenyeyGreenstein(0.77));
        let (eye, direction) = (DVec3::ZERO, DVec3::Y);
        // The near end 20 m beside the ray, the middle farther away than the line is long.
        for (near, far) in [
            (DVec3::new(20.0, 800.0, 0.0), DVec3::new(150.0, 800.0, 0.0)),
            (DVec3::new(20.0, 800.0, 5.0), DVec3::new(60.0, 700.0, 120.0)),
            (DVec3::new(-80.0, 500.0, 20.0), DVec3::new(80.0, 900.0, 20.0)),
        ] {
            let count = 4000;
            let piece = 0.5 * near.distance(far) / f64::from(count);
            let place = |i: i32| near.lerp(far, (f64::from(i) + 0.5) / f64::from(count));
            let point = |i: i32| PointBeside::new(place(i), eye, direction, 3000.0, piece);
            let whole =
                (0..count).map(|i| airlight.of_point(1e-3, &point(i))[0]).sum::<f64>() / f64::from(count);
            let found = airlight.of_line(1e-3, [near, far], eye, direction, 3000.0)[0];
            assert!((found / whole - 1.0).abs() < RULE, "{near} {far}: {found} {whole}");
        }
    }

    #[test]
    fn thin_rain_scatters_in_proportion_and_none_scatters_nothing() {
        let airlight = Airlight::new(&Phase::HenyeyGreenstein(0.5));
        let beside = PointBeside { h: 3.0, foot: 20.0, end: 60.0 };
        let [one, two] = [1e-7, 2e-7].map(|extinction| airlight.of_point(extinction, &beside)[1]);
        assert!((two / one - 2.0).abs() < 1e-4);
        assert_eq!(airlight.of_point(0.0, &beside), [0.0; 3]);
    }

    #[test]
    fn a_point_far_behind_the_eye_adds_nothing_rather_than_no_number() {
        let airlight = Airlight::new(&Phase::HenyeyGreenstein(0.77));
        // Optical depths between eye and point of 600 to 1e6: beyond 709 their exponential is infinite.
        for behind in [6e4, 7.2e4, 1e5, 1e8] {
            for end in [1.0, 3000.0, f64::INFINITY] {
                let found = airlight.of_point(1e-2, &PointBeside { h: 100.0, foot: -behind, end });
                assert!(found.iter().all(|band| (0.0..1e-100).contains(band)), "{behind} {end}: {found:?}");
            }
        }
    }
}
