//! Scenes of known answers, for tests.

use crate::Progress;
use crate::scene::{Material, Scene};
use glam::Vec3;
use squall_runtime::random::Random;
use std::sync::atomic::{AtomicI64, Ordering};

/// Adds a parallelogram from a corner along two sides; its front is where the first side turns counter-clockwise into the second.
pub fn quad(scene: &mut Scene, corner: [f32; 3], first: [f32; 3], second: [f32; 3], material: u32) {
    let [corner, first, second] = [corner, first, second].map(Vec3::from_array);
    let (a, b, c, d) = (corner, corner + first, corner + first + second, corner + second);
    while scene.materials.len() <= material as usize {
        scene.materials.push(Material::default());
    }
    scene.triangles.extend([[a, b, c], [a, c, d]]);
    scene.material.extend([material; 2]);
}

/// Adds a box with its six faces outwards.
pub fn cuboid(scene: &mut Scene, low: [f32; 3], high: [f32; 3], material: u32) {
    let [dx, dy, dz] = [0, 1, 2].map(|axis| {
        let mut side = [0.0; 3];
        side[axis] = high[axis] - low[axis];
        side
    });
    let at = |x: bool, y: bool, z: bool| {
        [if x { high[0] } else { low[0] }, if y { high[1] } else { low[1] }, if z { high[2] } else { low[2] }]
    };
    quad(scene, at(false, false, false), dy, dx, material);
    quad(scene, at(false, false, true), dx, dy, material);
    quad(scene, at(false, false, false), dx, dz, material);
    quad(scene, at(false, true, false), dz, dx, material);
    quad(scene, at(false, false, false), dz, dy, material);
    quad(scene, at(true, false, false), dy, dz, material);
}

/// Small triangles anywhere in a cube of 6 m.
pub fn cloud_of_triangles(count: usize, seed: u64) -> Scene {
    let mut random = Random::new(seed);
    let mut point = |radius: f64| (random.direction() * radius * random.unit()).as_vec3();
    let triangles: Vec<[Vec3; 3]> = (0..count)
        .map(|_| {
            let middle = point(3.0);
            [middle, middle + point(1.5), middle + point(1.5)]
        })
        .collect();
    let material = vec![0; triangles.len()];
    Scene { triangles, material, materials: vec![Material::default()], ..Scene::default() }
}

/// Wants to stop once it was asked more than so many times.
pub struct StopsAfter(AtomicI64);

impl StopsAfter {
    /// One that lets so many looks pass.
    pub fn new(looks: i64) -> Self {
        Self(AtomicI64::new(looks))
    }
}

impl Progress for StopsAfter {
    fn begin(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
    fn interrupted(&self) -> bool {
        self.0.fetch_sub(1, Ordering::Relaxed) <= 0
    }
}
