//! What rays meet: a bounding volume hierarchy over a scene's triangles.

mod build;

use crate::scene::Scene;
use glam::Vec3;

/// A ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts, m.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Along the ray, m.
    pub distance: f32,
    /// Which triangle.
    pub triangle: u32,
    /// Weights of the second and third corner.
    pub weights: [f32; 2],
}

/// A box of the hierarchy. An inner box's first half stands behind it, its second half `link` boxes on; a leaf has `count` triangles from `link`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Node {
    low: Vec3,
    link: u32,
    high: Vec3,
    count: u32,
}

/// Boxes that a walk may have put off: deeper hierarchies are not built.
const STACK: usize = 96;

/// A scene that rays can ask. Its triangles are in the order of the hierarchy.
pub struct World {
    scene: Scene,
    nodes: Vec<Node>,
}

impl World {
    /// Builds the hierarchy; the scene's triangles are sorted by it. The same scene gives the same order for any number of threads.
    pub fn new(mut scene: Scene) -> Self {
        let (nodes, order) = build::build(&scene.triangles);
        let sorted = |at: &u32| *at as usize;
        scene.triangles = order.iter().map(sorted).map(|at| scene.triangles[at]).collect();
        scene.material = order.iter().map(sorted).map(|at| scene.material[at]).collect();
        if !scene.paint.is_empty() {
            scene.paint = order.iter().map(sorted).map(|at| scene.paint[at]).collect();
        }
        if !scene.normals.is_empty() {
            scene.normals = order.iter().map(sorted).map(|at| scene.normals[at]).collect();
        }
        if !scene.second_uv.is_empty() {
            scene.second_uv = order.iter().map(sorted).map(|at| scene.second_uv[at]).collect();
        }
        Self { scene, nodes }
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Unit normal of a triangle's front.
    pub fn normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.scene.triangles[triangle as usize];
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// Whether light passes through a triangle.
    fn clear(&self, triangle: usize) -> bool {
        self.scene.materials[self.scene.material[triangle] as usize].clear
    }

    /// The first triangle that a ray meets before `far`; with `light`, what light passes through is no obstacle.
    pub fn first(&self, ray: &Ray, far: f32, light: bool) -> Option<Hit> {
        let mut best = None;
        self.walk(ray, far, |hit, far| {
            if light && self.clear(hit.triangle as usize) {
                return false;
            }
            *far = hit.distance;
            best = Some(hit);
            false
        });
        best
    }

    /// Whether light is kept from going along a ray as far as `far`.
    pub fn blocked(&self, ray: &Ray, far: f32) -> bool {
        let mut blocked = false;
        self.walk(ray, far, |hit, _| {
            blocked = !self.clear(hit.triangle as usize);
            blocked
        });
        blocked
    }

    /// A place a little off a surface, on the side of `normal`, from which rays do not meet the surface itself.
    pub fn off(place: Vec3, normal: Vec3) -> Vec3 {
        /// Round-off of places in single precision, relative, several times over.
        const SHARE: f32 = 4e-6;
        /// A fifth of a millimetre: nearer than any two surfaces that are to be told apart.
        const LEAST: f32 = 2e-4;
        place + normal * (LEAST + SHARE * place.abs().max_element())
    }

    /// Meets triangles along a ray in no order; `meet` may bring `far` nearer, and stops the walk by saying so.
    fn walk(&self, ray: &Ray, mut far: f32, mut meet: impl FnMut(Hit, &mut f32) -> bool) {
        let inverse = ray.direction.recip();
        let mut stack = [(0u32, 0.0f32); STACK];
        let mut waiting = 0;
        let enter = |node: &Node, far: f32| {
            let (a, b) = ((node.low - ray.origin) * inverse, (node.high - ray.origin) * inverse);
            let near = a.min(b).max_element().max(0.0);
            // A little beyond the box: rounding must not lose what lies in its face.
            let end = a.max(b).min_element() * 1.000_001 + 1e-6;
            if near <= end && near <= far { near } else { f32::INFINITY }
        };
        let Some(first) = self.nodes.first() else { return };
        if enter(first, far) == f32::INFINITY {
            return;
        }
        let mut at = 0u32;
        loop {
            let node = &self.nodes[at as usize];
            let mut next = None;
            if node.count > 0 {
                for triangle in node.link..node.link + node.count {
                    if let Some((distance, weights)) =
                        meets(ray, &self.scene.triangles[triangle as usize], far)
                        && meet(Hit { distance, triangle, weights }, &mut far)
                    {
                        return;
                    }
                }
            } else {
                let pair = [at + 1, at + node.link];
                let [a, b] = pair.map(|child| enter(&self.nodes[child as usize], far));
                let (nearer, farther) = if a <= b { (0, 1) } else { (1, 0) };
                let distance = [a, b];
                if distance[nearer] < f32::INFINITY {
                    next = Some(pair[nearer]);
                    if distance[farther] < f32::INFINITY {
                        stack[waiting] = (pair[farther], distance[farther]);
                        waiting += 1;
                    }
                }
            }
            at = match next {
                Some(next) => next,
                None => loop {
                    if waiting == 0 {
                        return;
                    }
                    waiting -= 1;
                    let (node, near) = stack[waiting];
                    if near <= far {
                        break node;
                    }
                },
            };
        }
    }
}

/// Distance and weights of corners where a ray meets a triangle \[moller-trumbore\], from either side.
fn meets(ray: &Ray, [a, b, c]: &[Vec3; 3], far: f32) -> Option<(f32, [f32; 2])> {
    /// Weights beyond 0 to 1 that still count: neighbours leave no gap between them.
    const EDGE: f32 = 1e-6;
    let (first, second) = (*b - *a, *c - *a);
    let across = ray.direction.cross(second);
    let determinant = first.dot(across);
    if determinant == 0.0 {
        return None;
    }
    let inverse = 1.0 / determinant;
    let from = ray.origin - *a;
    let u = from.dot(across) * inverse;
    if !(-EDGE..=1.0 + EDGE).contains(&u) {
        return None;
    }
    let around = from.cross(first);
    let v = ray.direction.dot(around) * inverse;
    if v < -EDGE || u + v > 1.0 + EDGE {
        return None;
    }
    let distance = second.dot(around) * inverse;
    (distance > 0.0 && distance < far).then_some((distance, [u, v]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{cloud_of_triangles, quad};
    use squall_runtime::random::Random;

    /// Two ways of the same sums in single precision.
    const ROUND_OFF: f32 = 1e-5;

    #[test]
    fn the_hierarchy_finds_what_trying_every_triangle_finds() {
        let world = World::new(cloud_of_triangles(700, 3));
        let mut random = Random::new(9);
        let mut met = 0;
        for _ in 0..500 {
            let place = (random.direction() * 4.0).as_vec3();
            let ray = Ray { origin: place, direction: random.direction().as_vec3() };
            let all = world.scene.triangles.iter().filter_map(|t| meets(&ray, t, f32::INFINITY));
            let nearest = all.map(|(distance, _)| distance).fold(f32::INFINITY, f32::min);
            match world.first(&ray, f32::INFINITY, true) {
                Some(hit) => {
                    assert!((hit.distance - nearest).abs() <= ROUND_OFF * nearest);
                    assert!(world.blocked(&ray, nearest * 1.001) && !world.blocked(&ray, nearest * 0.999));
                    met += 1;
                }
                None => assert_eq!(nearest, f32::INFINITY),
            }
        }
        assert!(met > 50, "{met} of 500 rays met something");
    }

    #[test]
    fn a_ray_along_the_seam_of_two_triangles_is_stopped() {
        let mut scene = Scene::default();
        quad(&mut scene, [-1.0, -1.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], 0);
        let world = World::new(scene);
        for step in -99..100 {
            let at = step as f32 / 100.0;
            let ray = Ray { origin: Vec3::new(at, at, 3.0), direction: Vec3::NEG_Z };
            assert!(world.blocked(&ray, 10.0), "{at}");
            assert!(!world.blocked(&ray, 2.9));
        }
    }

    #[test]
    fn the_order_does_not_depend_on_threads() {
        let orders = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| World::new(cloud_of_triangles(20_000, 5)).scene.triangles)
        });
        assert!(orders[0] == orders[1]);
    }
}
