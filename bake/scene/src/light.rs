//! Light of a scene: lamps and shining triangles on a surface, and paths of reflected light.

use crate::scene::{Lamp, LampKind, Scene};
use crate::world::{Hit, Ray, World};
use glam::{DVec3, Vec3};
use squall_runtime::random::Random;
use std::f32::consts::PI;

/// Light that a lamp alone would send through a place: unit direction towards it, distance in m (infinite where it is far away), and
/// irradiance across that direction, W/m². `None` where it sends none.
pub fn from_lamp(lamp: &Lamp, place: DVec3) -> Option<(Vec3, f32, [f32; 3])> {
    /// Nearer than a centimetre a lamp is no point.
    const NEAREST_SQUARED: f64 = 1e-4;
    if let LampKind::Distant { towards } = lamp.kind {
        return Some((towards.as_vec3(), f32::INFINITY, lamp.power.map(|band| band as f32)));
    }
    let way = lamp.position_m - place;
    let squared = way.length_squared().max(NEAREST_SQUARED);
    let towards = way / squared.sqrt();
    let mut share = 1.0 / squared;
    if let LampKind::Spot { direction, cosines: [inner, outer] } = lamp.kind {
        // The extension's own recommendation for the edge of a cone.
        let within = ((-towards).dot(direction) - outer) / (inner - outer).max(1e-3);
        let within = within.clamp(0.0, 1.0);
        share *= within * within;
    }
    (share > 0.0)
        .then(|| (towards.as_vec3(), squared.sqrt() as f32, lamp.power.map(|band| (band * share) as f32)))
}

/// A triangle that shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shining {
    /// Its number.
    pub triangle: u32,
    /// Corners, m.
    pub corners: [Vec3; 3],
    /// Unit normal of its front.
    pub normal: Vec3,
    /// Area, m².
    pub area: f32,
    /// Radiance, W/(m² sr).
    pub radiance: [f32; 3],
    /// Whether its back shines too.
    pub two_sided: bool,
}

/// All triangles that shine, in their order.
pub fn shining(world: &World) -> Vec<Shining> {
    let scene = world.scene();
    let all = 0..scene.triangles.len();
    let lit = all.filter(|at| scene.materials[scene.material[*at] as usize].shines());
    lit.map(|at| {
        let [a, b, c] = scene.triangles[at];
        let material = &scene.materials[scene.material[at] as usize];
        Shining {
            triangle: at as u32,
            corners: [a, b, c],
            normal: (b - a).cross(c - a).normalize_or_zero(),
            area: 0.5 * (b - a).cross(c - a).length(),
            radiance: material.emission,
            two_sided: material.two_sided,
        }
    })
    .collect()
}

/// Irradiance over radiance that an unhidden polygon gives a surface at `place` with unit normal `normal` \[lambert\]: the part above the
/// surface's plane, from the polygon's front or, with `two_sided`, from either side.
pub fn irradiance_of_polygon(
    place: Vec3,
    normal: Vec3,
    corners: &[Vec3; 3],
    front: Vec3,
    two_sided: bool,
) -> f32 {
    let facing = (place - corners[0]).dot(front);
    if facing <= 0.0 && !two_sided {
        return 0.0;
    }
    // Cut at the surface's plane: four corners at most.
    let mut part = [Vec3::ZERO; 4];
    let mut count = 0;
    for at in 0..3 {
        let (here, next) = (corners[at] - place, corners[(at + 1) % 3] - place);
        let (a, b) = (here.dot(normal), next.dot(normal));
        if a >= 0.0 {
            part[count] = here;
            count += 1;
        }
        if (a >= 0.0) != (b >= 0.0) {
            part[count] = here + (next - here) * (a / (a - b));
            count += 1;
        }
    }
    let mut sum = 0.0f64;
    for at in 0..count {
        let (here, next) = (part[at].as_dvec3(), part[(at + 1) % count].as_dvec3());
        let across = here.cross(next);
        let length = across.length();
        if length > 0.0 {
            let angle = libm::atan2(length, here.dot(next));
            sum += angle * across.dot(normal.as_dvec3()) / length;
        }
    }
    (0.5 * sum.abs()) as f32
}

/// Unit vectors square to a unit vector and to each other.
pub fn beside(normal: Vec3) -> [Vec3; 2] {
    let first = normal.any_orthonormal_vector();
    [first, normal.cross(first)]
}

/// A direction around `normal`, as often as its cosine; `u` and `v` lie in [0, 1).
pub fn around(normal: Vec3, [u, v]: [f32; 2]) -> Vec3 {
    let (sin, cos) = libm::sincosf(2.0 * PI * v);
    let radius = u.sqrt();
    let [x, y] = beside(normal);
    (x * (radius * cos) + y * (radius * sin) + normal * (1.0 - u).max(0.0).sqrt()).normalize()
}

/// What light comes from, as paths ask it: what a surface sends on of light that comes to it directly, and what comes from where nothing is.
pub trait Source: Sync {
    /// Radiance that a surface reflects or emits directly, where albedo (0 to 1) is its share of reflected light and `normal` the side that is looked at.
    fn surface(&self, world: &World, hit: &Hit, place: Vec3, normal: Vec3, random: &mut Random) -> [f32; 3];
    /// Radiance of a ray that meets nothing.
    fn beyond(&self, direction: Vec3) -> [f32; 3];
}

/// Radiance along a ray, with so many reflections: every surface is diffuse. `first` is the ray's first hit, where it is known already.
pub fn radiance(
    world: &World,
    source: &dyn Source,
    mut ray: Ray,
    bounces: u32,
    random: &mut Random,
) -> [f32; 3] {
    let mut sum = [0.0f32; 3];
    let mut share = [1.0f32; 3];
    for bounce in 0..=bounces {
        let Some(hit) = world.first(&ray, f32::INFINITY, true) else {
            let sky = source.beyond(ray.direction);
            for band in 0..3 {
                sum[band] += share[band] * sky[band];
            }
            break;
        };
        let normal = world.normal(hit.triangle);
        let normal = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
        let place = World::off(ray.origin + ray.direction * hit.distance, normal);
        let direct = source.surface(world, &hit, place, normal, random);
        let albedo = world.scene().base(hit.triangle as usize);
        for band in 0..3 {
            sum[band] += share[band] * direct[band];
            share[band] *= albedo[band];
        }
        if bounce == bounces || share == [0.0; 3] {
            break;
        }
        let pair = [random.unit() as f32, random.unit() as f32];
        ray = Ray { origin: place, direction: around(normal, pair) };
    }
    sum
}

/// Mean of the three colours.
pub fn mean(light: [f32; 3]) -> f32 {
    (light[0] + light[1] + light[2]) / 3.0
}

/// Mean albedo of a triangle.
pub fn grey(scene: &Scene, triangle: u32) -> f32 {
    mean(scene.base(triangle as usize))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Scene};
    use crate::testing::cuboid;

    struct Bright;

    impl Source for Bright {
        fn surface(&self, _: &World, _: &Hit, _: Vec3, _: Vec3, _: &mut Random) -> [f32; 3] {
            [0.0; 3]
        }
        fn beyond(&self, _: Vec3) -> [f32; 3] {
            [1.0; 3]
        }
    }

    #[test]
    fn white_things_in_a_white_furnace_are_not_seen() {
        let mut scene = Scene { materials: vec![Material::default()], ..Scene::default() };
        cuboid(&mut scene, [-1.0; 3], [1.0; 3], 0);
        cuboid(&mut scene, [-3.0, -3.0, -1.4], [3.0, 3.0, -1.2], 0);
        let world = World::new(scene);
        let mut random = Random::new(4);
        for _ in 0..200 {
            let origin = (random.direction() * 6.0).as_vec3();
            let ray = Ray { origin, direction: random.direction().as_vec3() };
            // Light that is reflected more often than 60 times is still on its way: none here, between two convex things.
            assert_eq!(radiance(&world, &Bright, ray, 60, &mut random), [1.0; 3]);
        }
    }

    #[test]
    fn a_polygon_straight_above_gives_the_form_factor_of_the_tables() {
        // A square of side 2a at height h over a point below its middle: F = 4/(2π) · 2 · a/√(h²+a²) · atan(a/√(h²+a²)).
        let (a, h) = (1.5f32, 2.0f32);
        let corner = |x: f32, y: f32| Vec3::new(x * a, y * a, h);
        let halves = [
            [corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0)],
            [corner(-1.0, -1.0), corner(1.0, 1.0), corner(1.0, -1.0)],
        ];
        let sum: f32 = halves
            .iter()
            .map(|half| irradiance_of_polygon(Vec3::ZERO, Vec3::Z, half, Vec3::NEG_Z, false))
            .sum();
        let slant = (h * h + a * a).sqrt();
        let wanted = 4.0 * (a / slant) * libm::atanf(a / slant);
        assert!((sum / wanted - 1.0).abs() < 1e-5, "{sum} {wanted}");
        let behind = irradiance_of_polygon(Vec3::ZERO, Vec3::Z, &halves[0], Vec3::Z, false);
        let both = irradiance_of_polygon(Vec3::ZERO, Vec3::Z, &halves[0], Vec3::Z, true);
        assert!(behind == 0.0 && (both / (0.5 * wanted) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn a_polygon_through_the_horizon_gives_its_upper_part() {
        // An upright strip from far below to far above the horizon gives what its upper half alone gives.
        let whole = [Vec3::new(1.0, -1.0, -1.0), Vec3::new(1.0, 1.0, -1.0), Vec3::new(1.0, 0.0, 1.0)];
        let upper = [Vec3::new(1.0, -0.5, 0.0), Vec3::new(1.0, 0.5, 0.0), Vec3::new(1.0, 0.0, 1.0)];
        let [a, b] = [whole, upper]
            .map(|corners| irradiance_of_polygon(Vec3::ZERO, Vec3::Z, &corners, Vec3::NEG_X, false));
        assert!(a > 0.05 && (a / b - 1.0).abs() < 1e-5, "{a} {b}");
    }

    #[test]
    fn a_spot_lights_its_cone_and_a_point_falls_off_by_the_square() {
        let kind = LampKind::Spot { direction: DVec3::NEG_Z, cosines: [0.9, 0.8] };
        let mut lamp =
            Lamp { name: String::new(), position_m: DVec3::new(0.0, 0.0, 4.0), power: [8.0; 3], kind };
        let power = |lamp: &Lamp, place| from_lamp(lamp, place).map_or(0.0, |(_, _, power)| power[0]);
        assert_eq!(power(&lamp, DVec3::ZERO), 0.5);
        assert_eq!(power(&lamp, DVec3::new(9.0, 0.0, 0.0)), 0.0);
        lamp.kind = LampKind::Point;
        assert_eq!(power(&lamp, DVec3::new(0.0, 4.0, 4.0)), 0.5);
    }
}
