//! Edges of meshes: where water drips, and where silhouettes may be.

mod chain;
pub mod drips;
pub mod fins;

use crate::scene::Scene;
use glam::Vec3;
use rayon::prelude::*;

/// An edge of one triangle or two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Its ends, m.
    pub ends: [Vec3; 2],
    /// Unit normals of its triangles; one alone counts twice.
    pub normals: [Vec3; 2],
    /// Unit vectors in the triangles' planes, square to the edge and away from the triangle; that of one alone counts twice.
    pub outward: [Vec3; 2],
    /// Whether two triangles meet in it.
    pub shared: bool,
    /// Whether they meet as a ridge does: each lies behind the other's front.
    pub convex: bool,
}

impl Edge {
    /// Its middle, m.
    pub fn middle(&self) -> Vec3 {
        0.5 * (self.ends[0] + self.ends[1])
    }

    /// Its length, m.
    pub fn length(&self) -> f32 {
        self.ends[0].distance(self.ends[1])
    }
}

/// Edges of one kind, and how many more there were than a map holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Kept<T> {
    /// The edges.
    pub edges: Vec<T>,
    /// Edges that were left out.
    pub left_out: usize,
}

/// Corners nearer than this are one, m.
const WELD_M: f32 = 1e-4;

/// A corner's cell of the grid on which corners are told apart.
fn welded(corner: Vec3) -> [i64; 3] {
    (corner / WELD_M).to_array().map(|at| at.round() as i64)
}

/// A triangle's side on its way to its neighbour.
#[derive(Clone, Copy)]
struct Side {
    key: u64,
    triangle: u32,
    side: u8,
}

/// All edges at least `shortest_m` long, in the order of their triangles. More than two triangles of one edge are taken by pairs in their
/// order, the last alone.
pub fn edges_of(scene: &Scene, shortest_m: f32) -> Vec<Edge> {
    let mut sides: Vec<Side> = (0..scene.triangles.len() as u32)
        .into_par_iter()
        .flat_map_iter(|triangle| {
            let corners = scene.triangles[triangle as usize];
            (0..3u8).filter_map(move |side| {
                let [a, b] = [corners[usize::from(side)], corners[usize::from(side + 1) % 3]];
                (a.distance(b) >= shortest_m).then(|| {
                    let [low, high] = {
                        let (a, b) = (welded(a), welded(b));
                        if a <= b { [a, b] } else { [b, a] }
                    };
                    let parts =
                        [low, high].as_flattened().iter().map(|part| *part as u64).collect::<Vec<_>>();
                    Side { key: squall_runtime::random::hash(&parts), triangle, side }
                })
            })
        })
        .collect();
    sides.par_sort_unstable_by_key(|side| (side.key, side.triangle, side.side));
    let mut edges: Vec<(u32, u8, Edge)> = sides
        .par_chunk_by(|a, b| a.key == b.key)
        .flat_map_iter(|group| {
            group.chunks(2).map(|pair| {
                let edge = joined(scene, pair[0], pair.get(1).copied());
                (pair[0].triangle, pair[0].side, edge)
            })
        })
        .collect();
    edges.par_sort_unstable_by_key(|(triangle, side, _)| (*triangle, *side));
    edges.into_iter().map(|(_, _, edge)| edge).collect()
}

/// Normal of a triangle, a side's ends and the vector away from the triangle.
fn beside(scene: &Scene, side: Side) -> (Vec3, [Vec3; 2], Vec3) {
    let corners = scene.triangles[side.triangle as usize];
    let at = usize::from(side.side);
    let (a, b, opposite) = (corners[at], corners[(at + 1) % 3], corners[(at + 2) % 3]);
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
    let along = (b - a).normalize_or_zero();
    let away = along.cross(normal);
    // Counter-clockwise corners lie to the left of their sides; rounding of slivers must not turn that round.
    let away = if away.dot(opposite - a) > 0.0 { -away } else { away };
    (normal, [a, b], away)
}

fn joined(scene: &Scene, one: Side, other: Option<Side>) -> Edge {
    let (normal, ends, outward) = beside(scene, one);
    let Some(other) = other else {
        return Edge { ends, normals: [normal; 2], outward: [outward; 2], shared: false, convex: true };
    };
    let (other_normal, _, other_outward) = beside(scene, other);
    // A triangle that is seen from behind along its neighbour's front is turned: sheets whose sides disagree.
    Edge {
        ends,
        normals: [normal, other_normal],
        outward: [outward, other_outward],
        shared: true,
        convex: normal.dot(-other_outward) < 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{cuboid, quad};

    #[test]
    fn a_box_has_twelve_convex_edges_and_six_flat_ones() {
        let mut scene = Scene::default();
        cuboid(&mut scene, [0.0; 3], [1.0, 2.0, 3.0], 0);
        let edges = edges_of(&scene, 0.0);
        let flat = |edge: &&Edge| edge.normals[0].dot(edge.normals[1]) > 0.999;
        assert_eq!((edges.len(), edges.iter().filter(flat).count()), (18, 6));
        for edge in edges.iter().filter(|edge| !flat(edge)) {
            assert!(edge.convex && edge.shared, "{edge:?}");
            assert!(edge.outward[0].distance(edge.normals[1]) < 1e-6);
        }
    }

    #[test]
    fn a_valley_is_not_convex_and_an_open_sheet_has_edges_of_its_own() {
        let mut scene = Scene::default();
        quad(&mut scene, [0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 0);
        quad(&mut scene, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0);
        let edges = edges_of(&scene, 0.0);
        let bent = edges.iter().filter(|e| e.shared && e.normals[0].dot(e.normals[1]).abs() < 0.1);
        assert!(bent.clone().count() == 1 && bent.clone().all(|edge| !edge.convex));
        assert_eq!(edges.iter().filter(|edge| !edge.shared).count(), 6);
    }
}
