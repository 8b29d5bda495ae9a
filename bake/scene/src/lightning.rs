//! Lightning's light after it was reflected: path-traced into a volume of harmonics, one set for each key direction.

use crate::error::SceneError;
use crate::light::grey;
use crate::world::{Ray, World};
use crate::{Progress, light};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use squall_formats::sphere::{degree_of, harmonics};
use squall_runtime::random::Random;
use squall_runtime::wet::maps::LightningVolume;

/// How lightning's light is worked out.
#[derive(Clone, Debug, PartialEq)]
pub struct LightningSettings {
    /// Unit vectors towards the light.
    pub directions: Vec<DVec3>,
    /// Distance between nodes, m.
    pub cell_m: f64,
    /// Paths of each node.
    pub paths: u32,
    /// Reflections of a path: 1 is light that comes off one surface.
    pub bounces: u32,
    /// Seed.
    pub seed: u64,
}

/// Most nodes along a side, and in all.
pub const MOST_NODES: [usize; 2] = [512, 1 << 20];

/// Nodes over a box, low corner to high one.
///
/// Errors: too many.
pub fn nodes_over(low: DVec3, high: DVec3, cell_m: f64) -> Result<[usize; 3], SceneError> {
    let side = (high - low).to_array();
    let size = side.map(|side| (side / cell_m - 1e-6).ceil().max(1.0) + 1.0);
    let all: f64 = size.iter().product();
    if size.iter().any(|nodes| *nodes > MOST_NODES[0] as f64) || all > MOST_NODES[1] as f64 {
        let wanted = format!("at most {} nodes a side and {} in all", MOST_NODES[0], MOST_NODES[1]);
        let found = format!("{cell_m} m: {} × {} × {}", size[0], size[1], size[2]);
        return Err(SceneError::input("lightning.cell_m", wanted, found));
    }
    Ok(size.map(|nodes| nodes as usize))
}

/// A node's harmonics, and the share of its rays that met backs of surfaces: where that is large, it lies inside something.
type Node = (Vec<[f32; 9]>, f32);

/// Share of rays to backs of surfaces beyond which a node lies inside something.
const INSIDE: f32 = 0.25;

/// Light of lightning in a box: of a beam of irradiance 1 from each key direction, what arrives after one reflection or more, as nine
/// harmonics of radiance. Direct light is left out. Nodes inside walls take what nodes beside them have, so that mixing in front of a wall
/// does not darken it.
///
/// Errors: too many nodes; more rays than [`MOST_RAYS`]; an interruption.
pub fn bake_lightning(
    world: &World,
    [low, high]: [DVec3; 2],
    settings: &LightningSettings,
    progress: &dyn Progress,
) -> Result<LightningVolume, SceneError> {
    let size = nodes_over(low, high, settings.cell_m)?;
    let count = size[0] * size[1] * size[2];
    few_rays(rays(count, settings))?;
    let towards: Vec<Vec3> = settings.directions.iter().map(|direction| direction.as_vec3()).collect();
    let nodes: Result<Vec<Node>, SceneError> = (0..count)
        .into_par_iter()
        .map(|index| {
            let at = [index % size[0], index / size[0] % size[1], index / (size[0] * size[1])];
            let place = low + settings.cell_m * DVec3::from_array(at.map(|at| at as f64));
            let node = node(world, place.as_vec3(), &towards, settings, index as u64, progress)?;
            progress.advance(1);
            Ok(node)
        })
        .collect();
    let mut nodes = nodes?;
    fill_insides(&mut nodes, size);
    let harmonics =
        (0..towards.len()).flat_map(|direction| nodes.iter().map(move |node| node.0[direction])).collect();
    Ok(LightningVolume {
        origin_m: low,
        cell_m: settings.cell_m,
        size,
        directions: settings.directions.clone(),
        harmonics,
    })
}

/// Most rays of all nodes: some days of one core.
pub const MOST_RAYS: f64 = (1u64 << 38) as f64;
/// Paths between two looks at whether somebody wants to stop.
const PATHS_A_LOOK: u32 = 1024;

/// Rays of so many nodes at most: a path's own, and at each surface one towards each key direction.
fn rays(nodes: usize, settings: &LightningSettings) -> f64 {
    let paths = nodes as f64 * f64::from(settings.paths);
    paths * f64::from(settings.bounces) * (1.0 + settings.directions.len() as f64)
}

fn few_rays(rays: f64) -> Result<(), SceneError> {
    if rays <= MOST_RAYS {
        return Ok(());
    }
    let wanted = format!("nodes × paths × bounces × (1 + directions) of at most {MOST_RAYS:.1e}");
    Err(SceneError::input("lightning.paths", wanted, format!("{rays:.1e}")))
}

/// Light at one node, of all key directions along the same paths.
fn node(
    world: &World,
    place: Vec3,
    towards: &[Vec3],
    settings: &LightningSettings,
    index: u64,
    progress: &dyn Progress,
) -> Result<Node, SceneError> {
    let mut random = Random::from_parts(&[settings.seed, index]);
    let turn = [random.unit(), random.unit()];
    let mut sums = vec![[0.0f64; 9]; towards.len()];
    let mut backs = 0u32;
    let mut light = vec![0.0f32; towards.len()];
    for path in 0..settings.paths {
        if path % PATHS_A_LOOK == 0 {
            progress.check()?;
        }
        let direction = spread(path, settings.paths, turn);
        let ray = Ray { origin: place, direction: direction.as_vec3() };
        backs += u32::from(trace(world, ray, towards, settings.bounces, &mut random, &mut light));
        let basis = harmonics(direction.to_array());
        for (sum, light) in sums.iter_mut().zip(&light) {
            for (sum, basis) in sum.iter_mut().zip(basis) {
                *sum += basis * f64::from(*light);
            }
        }
    }
    // Every direction stands for its share of the sphere.
    let share = 4.0 * std::f64::consts::PI / f64::from(settings.paths);
    let harmonics = sums.iter().map(|sum| sum.map(|sum| (sum * share) as f32)).collect();
    Ok((harmonics, backs as f32 / settings.paths as f32))
}

/// Directions spread evenly over the sphere along a spiral \[fibonacci\], turned and shifted by two numbers in [0, 1).
fn spread(path: u32, paths: u32, [shift, turn]: [f64; 2]) -> DVec3 {
    const GOLDEN: f64 = 0.618_033_988_749_894_8;
    let z = 1.0 - 2.0 * (f64::from(path) + shift) / f64::from(paths);
    let (sin, cos) = libm::sincos(std::f64::consts::TAU * (f64::from(path) * GOLDEN + turn));
    let radius = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(radius * cos, radius * sin, z)
}

/// Radiance along one path for every key direction, into `light`; whether the path's first surface was seen from behind.
fn trace(
    world: &World,
    mut ray: Ray,
    towards: &[Vec3],
    bounces: u32,
    random: &mut Random,
    light: &mut [f32],
) -> bool {
    light.fill(0.0);
    let mut share = 1.0f32;
    let mut behind = false;
    for bounce in 0..bounces {
        let Some(hit) = world.first(&ray, f32::INFINITY, true) else { break };
        let front = world.normal(hit.triangle);
        let two_sided = {
            let scene = world.scene();
            scene.materials[scene.material[hit.triangle as usize] as usize].two_sided
        };
        let back = front.dot(ray.direction) > 0.0;
        behind |= bounce == 0 && back && !two_sided;
        let normal = if back { -front } else { front };
        let place = World::off(ray.origin + ray.direction * hit.distance, normal);
        share *= grey(world.scene(), hit.triangle);
        if share == 0.0 {
            break;
        }
        for (light, &towards) in light.iter_mut().zip(towards) {
            let cosine = normal.dot(towards);
            if cosine > 0.0 && !world.blocked(&Ray { origin: place, direction: towards }, f32::INFINITY) {
                *light += share * cosine / std::f32::consts::PI;
            }
        }
        let pair = [random.unit() as f32, random.unit() as f32];
        ray = Ray { origin: place, direction: light::around(normal, pair) };
    }
    behind
}

/// Gives nodes inside things the mean of their neighbours that are not, from the outside inwards, over at most so many nodes.
fn fill_insides(nodes: &mut [Node], size: [usize; 3]) {
    const ROUNDS: usize = 3;
    let steps = [1, size[0], size[0] * size[1]];
    let mut good: Vec<bool> = nodes.iter().map(|node| node.1 <= INSIDE).collect();
    for _ in 0..ROUNDS {
        let mut filled = Vec::new();
        for index in (0..nodes.len()).filter(|index| !good[*index]) {
            let at = [index % size[0], index / size[0] % size[1], index / steps[2]];
            let mut sums = vec![[0.0f32; 9]; nodes[index].0.len()];
            let mut count = 0;
            for axis in 0..3 {
                let before = (at[axis] > 0).then(|| index - steps[axis]);
                let behind = (at[axis] + 1 < size[axis]).then(|| index + steps[axis]);
                for next in before.into_iter().chain(behind).filter(|next| good[*next]) {
                    count += 1;
                    for (sum, light) in sums.as_flattened_mut().iter_mut().zip(nodes[next].0.as_flattened()) {
                        *sum += light;
                    }
                }
            }
            if count > 0 {
                sums.as_flattened_mut().iter_mut().for_each(|sum| *sum /= count as f32);
                filled.push((index, sums));
            }
        }
        for (index, sums) in filled {
            nodes[index].0 = sums;
            good[index] = true;
        }
    }
}

/// Relative L2 error of the irradiance that a volume gives, over all nodes, key directions and normals of surfaces: harmonics are orthonormal,
/// so that it is the root of summed squares of A_l times the harmonics' differences over that of the truth's.
pub fn relative_l2(found: &LightningVolume, truth: &LightningVolume) -> f64 {
    // What a cosine lobe keeps of each degree, over π.
    const KEPT: [f64; 3] = [1.0, 2.0 / 3.0, 0.25];
    let (mut off, mut all) = (0.0f64, 0.0f64);
    for (a, b) in found.harmonics.iter().zip(&truth.harmonics) {
        for (index, (a, b)) in a.iter().zip(b).enumerate() {
            let kept = KEPT[degree_of(index)];
            let (a, b) = (kept * f64::from(*a), kept * f64::from(*b));
            off += (a - b) * (a - b);
            all += b * b;
        }
    }
    (off / all.max(f64::MIN_POSITIVE)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quiet;
    use crate::scene::{Material, Scene};
    use crate::testing::{cuboid, quad};

    fn settings(paths: u32) -> LightningSettings {
        let directions = vec![DVec3::Z, DVec3::new(0.6, 0.0, 0.8)];
        LightningSettings { directions, cell_m: 2.0, paths, bounces: 3, seed: 7 }
    }

    fn plane(albedo: f32) -> Scene {
        let materials = vec![Material { base: [albedo; 3], ..Material::default() }];
        let mut scene = Scene { materials, ..Scene::default() };
        quad(&mut scene, [-900.0, -900.0, 0.0], [1800.0, 0.0, 0.0], [0.0, 1800.0, 0.0], 0);
        scene
    }

    #[test]
    fn a_plane_under_lightning_sends_up_albedo_times_cosine_over_pi() {
        let world = World::new(plane(0.5));
        let box_m = [DVec3::new(-1.0, -1.0, 2.0), DVec3::new(1.0, 1.0, 4.0)];
        let volume = bake_lightning(&world, box_m, &settings(4096), &Quiet).unwrap();
        assert_eq!(volume.size, [2, 2, 2]);
        for (direction, cosine) in [(0, 1.0), (1, 0.8)] {
            // The hemisphere below has radiance ρ c / π: downward irradiance ρ c, upward none.
            let place = DVec3::new(0.3, -0.2, 3.1);
            let down = volume.irradiance(direction, place, Vec3::NEG_Z).unwrap();
            assert!((down / (0.5 * cosine) - 1.0).abs() < 0.01, "{down}");
            // Nine harmonics of a hemisphere are some 3 % of it off upwards.
            let up = volume.irradiance(direction, place, Vec3::Z).unwrap();
            assert!(up.abs() < 0.04 * down, "{up}");
        }
    }

    #[test]
    fn reflections_in_a_corner_add_up_as_a_geometric_series() {
        // Two half planes that meet in a right angle see each other with a form factor of one half, wherever one looks. Lit alike by a beam
        // along their bisector they send on ρ c (1 + ρ/2 + (ρ/2)² + …).
        let materials = vec![Material { base: [0.8; 3], ..Material::default() }];
        let mut scene = Scene { materials, ..Scene::default() };
        quad(&mut scene, [-900.0, 0.0, 0.0], [1800.0, 0.0, 0.0], [0.0, 900.0, 0.0], 0);
        quad(&mut scene, [-900.0, 0.0, 0.0], [0.0, 0.0, 900.0], [1800.0, 0.0, 0.0], 0);
        let world = World::new(scene);
        let slant = std::f64::consts::FRAC_1_SQRT_2;
        let directions = vec![DVec3::new(0.0, slant, slant)];
        let corner = [DVec3::new(0.0, 1.0, 1.0), DVec3::new(1.0, 2.0, 2.0)];
        let irradiance = |bounces: u32| {
            let towards = directions[0].as_vec3();
            let directions = directions.clone();
            let settings = LightningSettings { directions, cell_m: 1.0, paths: 4096, bounces, seed: 3 };
            let volume = bake_lightning(&world, corner, &settings, &Quiet).unwrap();
            volume.irradiance(0, DVec3::splat(1.5), -towards).unwrap()
        };
        let once = irradiance(1);
        // Nine harmonics of three quarters of a sphere.
        assert!((once / (0.8 * slant as f32) - 1.0).abs() < 0.03, "{once}");
        for (bounces, wanted) in [(2, 1.4), (3, 1.56)] {
            let ratio = irradiance(bounces) / once;
            assert!((ratio / wanted - 1.0).abs() < 0.01, "{bounces}: {ratio}");
        }
    }

    fn yard() -> World {
        let mut scene = plane(0.3);
        cuboid(&mut scene, [-6.0, -3.0, 0.0], [-3.0, 3.0, 6.0], 0);
        cuboid(&mut scene, [3.0, -3.0, 0.0], [6.0, 3.0, 6.0], 0);
        World::new(scene)
    }

    #[test]
    fn usual_numbers_of_paths_are_within_three_percent_of_sixty_four_times_as_many() {
        let world = yard();
        let box_m = [DVec3::new(-4.0, -2.0, 0.5), DVec3::new(4.0, 2.0, 4.5)];
        let few = bake_lightning(&world, box_m, &settings(512), &Quiet).unwrap();
        let many = LightningSettings { seed: 99, ..settings(64 * 512) };
        let many = bake_lightning(&world, box_m, &many, &Quiet).unwrap();
        let l2 = relative_l2(&few, &many);
        assert!(l2 <= 0.03, "{l2}");
    }

    #[test]
    fn nodes_inside_walls_are_as_light_as_those_beside_them_and_threads_change_nothing() {
        let world = yard();
        let box_m = [DVec3::new(-5.0, -2.0, 1.0), DVec3::new(5.0, 2.0, 3.0)];
        let volumes = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| bake_lightning(&world, box_m, &settings(128), &Quiet).unwrap())
        });
        assert_eq!(volumes[0], volumes[1]);
        let light = |node: usize| volumes[0].harmonics[node][0];
        // Nodes at x = −5 lie in a wall whose neighbours at −3 lie in its face or in the open.
        assert!(light(0) > 0.1 * light(2), "{} {}", light(0), light(2));
    }

    #[test]
    fn more_rays_than_days_allow_are_refused_and_a_node_stops_when_it_is_told_to() {
        let mut settings = LightningSettings {
            directions: vec![DVec3::Z; 2],
            cell_m: 1.0,
            paths: 4096,
            bounces: 3,
            seed: 1,
        };
        assert_eq!(rays(10, &settings), 10.0 * 4096.0 * 9.0);
        assert!(few_rays(rays(MOST_NODES[1], &settings)).is_ok());
        settings.paths = 1 << 20;
        let error = few_rays(rays(MOST_NODES[1], &settings)).unwrap_err().to_string();
        assert!(error.contains("lightning.paths: wanted nodes × paths"), "{error}");
        let world = World::new(crate::testing::cloud_of_triangles(10, 1));
        let stops = crate::testing::StopsAfter::new(2);
        // Of its eight nodes none is begun after the second look, which is within the first two.
        settings.paths = 4096;
        let stopped = bake_lightning(&world, [DVec3::ZERO, DVec3::ONE], &settings, &stops);
        assert_eq!(stopped.unwrap_err(), SceneError::Interrupted);
    }
}
