//! Silhouettes on which drops burst: convex edges that rain reaches.

use super::chain::{Piece, joined};
use super::{Edge, Kept, edges_of};
use crate::Progress;
use crate::error::SceneError;
use crate::world::{Ray, World};
use glam::Vec3;
use rayon::prelude::*;
use squall_runtime::wet::maps::Fin;

/// What counts as an edge on which drops burst.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FinSettings {
    /// Least angle between the two normals, rad.
    pub least_angle_rad: f32,
    /// Shortest edge, m, after pieces of one were put together.
    pub shortest_m: f32,
    /// Most edges: the longest.
    pub most: usize,
}

impl Default for FinSettings {
    fn default() -> Self {
        Self { least_angle_rad: 0.14, shortest_m: 0.1, most: 1 << 14 }
    }
}

/// Shortest piece of an edge that is looked at, m.
const SHORTEST_PIECE_M: f32 = 0.02;
/// How far from an edge the air around it is looked for, m.
const AROUND_M: f32 = 0.03;

/// Silhouettes: convex edges from beside which the sky straight above is free.
///
/// Errors: an interruption.
pub fn bake_fins(
    world: &World,
    settings: &FinSettings,
    progress: &dyn Progress,
) -> Result<Kept<Fin>, SceneError> {
    let bent = libm::cosf(settings.least_angle_rad);
    let pieces: Vec<Piece> = edges_of(world.scene(), SHORTEST_PIECE_M)
        .into_par_iter()
        // Slivers that single precision gives no normal have no sides either.
        .filter(|edge| edge.normals.iter().all(|normal| normal.is_normalized()))
        .filter(|edge| edge.convex && (!edge.shared || edge.normals[0].dot(edge.normals[1]) < bent))
        .filter(|edge| !progress.interrupted() && is_free(world, edge) && is_rained_on(world, edge))
        .map(|edge| {
            // A sheet's edge has its two sides for faces.
            let other = if edge.shared { edge.normals[1] } else { -edge.normals[0] };
            Piece { ends: edge.ends, normals: [edge.normals[0], other], amount: 0.0 }
        })
        .collect();
    progress.check()?;
    let mut fins: Vec<Fin> = joined(pieces)
        .into_iter()
        .filter(|piece| piece.ends[0].distance(piece.ends[1]) >= settings.shortest_m)
        .map(|piece| Fin {
            ends_m: piece.ends.map(Vec3::as_dvec3),
            normals: piece.normals.map(Vec3::as_dvec3),
        })
        .collect();
    let left_out = fins.len().saturating_sub(settings.most);
    if left_out > 0 {
        let length = |fin: &Fin| fin.ends_m[0].distance_squared(fin.ends_m[1]);
        fins.sort_by(|a, b| length(b).total_cmp(&length(a)));
        fins.truncate(settings.most);
    }
    Ok(Kept { edges: fins, left_out })
}

/// Whether an edge is one: nothing goes on where its faces end. Meshes of one surface need not share corners, and boxes stand on ground that
/// their feet are no part of.
fn is_free(world: &World, edge: &Edge) -> bool {
    let at = edge.middle();
    let sides = if edge.shared { 2 } else { 1 };
    (0..sides).all(|side| {
        let (normal, outward) = (edge.normals[side], edge.outward[side]);
        let above = at + 0.3 * AROUND_M * normal - 0.3 * AROUND_M * outward;
        let beyond = above + 1.3 * AROUND_M * outward;
        let ahead = Ray { origin: above, direction: outward };
        let below = Ray { origin: beyond, direction: -normal };
        // Just beyond the edge, at the height of the face, there is nothing.
        world.first(&ahead, 1.3 * AROUND_M, false).is_none()
            && world.first(&below, 0.6 * AROUND_M, false).is_none()
    })
}

fn is_rained_on(world: &World, edge: &Edge) -> bool {
    let out =
        if edge.shared { (edge.normals[0] + edge.normals[1]).normalize_or_zero() } else { edge.outward[0] };
    let ray = Ray { origin: edge.middle() + AROUND_M * out, direction: Vec3::Z };
    world.first(&ray, f32::INFINITY, false).is_none()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quiet;
    use crate::scene::Scene;
    use crate::testing::{StopsAfter, cuboid, quad};

    fn fins_of(scene: Scene) -> Vec<Fin> {
        bake_fins(&World::new(scene), &FinSettings::default(), &Quiet).unwrap().edges
    }

    #[test]
    fn a_box_on_the_ground_has_eight_silhouettes_and_none_at_its_foot() {
        let mut scene = Scene::default();
        quad(&mut scene, [-9.0, -9.0, 0.0], [18.0, 0.0, 0.0], [0.0, 18.0, 0.0], 0);
        cuboid(&mut scene, [-1.0, -1.0, 0.0], [1.0, 1.0, 2.0], 0);
        let fins = fins_of(scene);
        let on_box = fins.iter().filter(|fin| fin.ends_m[0].abs().max_element() < 5.0);
        assert_eq!(on_box.clone().count(), 8, "{fins:?}");
        assert!(on_box.clone().all(|fin| fin.ends_m[0].z > 1.9 || fin.ends_m[1].z > 1.9));
        assert!(on_box.clone().all(|fin| fin.normals[0].dot(fin.normals[1]).abs() < 1e-6));
        // The ground's own rim is a sheet's edge.
        assert_eq!(fins.len(), 12);
    }

    #[test]
    fn under_a_roof_drops_burst_on_the_roof_alone() {
        let mut scene = Scene::default();
        cuboid(&mut scene, [-1.0, -1.0, 0.0], [1.0, 1.0, 2.0], 0);
        cuboid(&mut scene, [-3.0, -3.0, 4.0], [3.0, 3.0, 4.2], 0);
        let fins = fins_of(scene);
        assert!(fins.len() >= 8 && fins.iter().all(|fin| fin.ends_m[0].z >= 4.0), "{fins:?}");
    }

    #[test]
    fn an_edge_in_pieces_is_one() {
        let mut scene = Scene::default();
        for step in 0..10 {
            let x = 0.3 * step as f32;
            quad(&mut scene, [x, 0.0, 1.0], [0.3, 0.0, 0.0], [0.0, 1.0, 0.0], 0);
            quad(&mut scene, [x, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.0, 1.0], 0);
        }
        let fins = fins_of(scene);
        let ridge = fins.iter().filter(|fin| fin.ends_m.iter().all(|end| end.z == 1.0 && end.y == 0.0));
        assert_eq!(ridge.clone().count(), 1, "{fins:?}");
        let fin = ridge.clone().next().unwrap();
        assert!((fin.ends_m[0].distance(fin.ends_m[1]) - 3.0).abs() < 1e-5);
    }

    #[test]
    fn silhouettes_beyond_the_most_are_counted_and_the_longest_stay() {
        let mut scene = Scene::default();
        cuboid(&mut scene, [-1.0, -1.0, 0.0], [1.0, 1.0, 5.0], 0);
        let world = World::new(scene);
        let all = bake_fins(&world, &FinSettings::default(), &Quiet).unwrap();
        let some = FinSettings { most: 3, ..FinSettings::default() };
        let some = bake_fins(&world, &some, &Quiet).unwrap();
        assert_eq!((some.edges.len(), some.left_out, all.left_out), (3, all.edges.len() - 3, 0));
        assert!(some.edges.iter().all(|fin| fin.ends_m[0].distance(fin.ends_m[1]) > 4.9), "{some:?}");
        let stopped = bake_fins(&world, &FinSettings::default(), &StopsAfter::new(0));
        assert_eq!(stopped.unwrap_err(), SceneError::Interrupted);
    }

    #[test]
    fn a_triangle_without_a_normal_has_no_silhouettes() {
        let mut scene = Scene::default();
        quad(&mut scene, [0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], 0);
        // Corners of one line, as rounding leaves them far from the origin.
        scene.triangles.push([5.0, 6.0, 7.0].map(|x| Vec3::new(x, 5.0, 0.0)));
        scene.material.push(0);
        let fins = fins_of(scene);
        assert_eq!(fins.len(), 4, "{fins:?}");
        assert!(fins.iter().flat_map(|fin| fin.normals).all(|normal| normal.is_normalized()));
    }
}
