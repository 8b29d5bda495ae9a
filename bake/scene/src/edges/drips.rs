//! Edges from which water drips: of faces that look up, with air below.

use super::chain::{Piece, joined};
use super::{Edge, Kept, edges_of};
use crate::Progress;
use crate::error::SceneError;
use crate::flow::{AWAY, Flooded, gathered_m2, marked};
use crate::heights::Grid;
use crate::world::{Ray, World};
use glam::{DVec2, Vec3};
use rayon::prelude::*;
use squall_runtime::wet::maps::DripEdge;

/// What counts as an edge that drips.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DripSettings {
    /// Air below, at least, m.
    pub least_fall_m: f32,
    /// Shortest edge, m.
    pub shortest_m: f32,
    /// Least area that drains over an edge, m².
    pub least_area_m2: f32,
    /// Most edges: those that most drains over.
    pub most: usize,
}

impl Default for DripSettings {
    fn default() -> Self {
        Self { least_fall_m: 0.4, shortest_m: 0.05, least_area_m2: 0.01, most: 1 << 14 }
    }
}

/// Least z of the normal of a face that water stands or runs on: steeper than 75° it is a wall.
const LEAST_UP: f32 = 0.26;
/// How far beyond an edge the air is looked for, m.
const BEYOND_M: f32 = 0.02;

/// Edges that drip, with the area that drains over each. Water runs on the uppermost surface alone: what lies under a roof gets none.
///
/// Errors: edges beside more falling cells than [`MOST_NEAR`], or longer in sum than [`MOST_STEPS`]; an interruption.
pub fn bake_drips(
    world: &World,
    flooded: &Flooded,
    settings: &DripSettings,
    progress: &dyn Progress,
) -> Result<Kept<DripEdge>, SceneError> {
    let candidates: Vec<Edge> = edges_of(world.scene(), settings.shortest_m)
        .into_par_iter()
        .filter(|edge| !progress.interrupted() && drips(world, edge, settings.least_fall_m))
        .collect();
    progress.check()?;
    let amounts = drained(&candidates, flooded, settings.least_fall_m, progress)?;
    let pieces = candidates.iter().zip(amounts).map(|(edge, amount)| Piece {
        ends: edge.ends,
        normals: edge.normals,
        amount,
    });
    let mut drips: Vec<DripEdge> = joined(pieces.collect())
        .into_iter()
        .filter(|piece| piece.amount >= f64::from(settings.least_area_m2))
        .map(|piece| DripEdge { ends_m: piece.ends.map(Vec3::as_dvec3), drains_m2: piece.amount as f32 })
        .collect();
    let left_out = drips.len().saturating_sub(settings.most);
    if left_out > 0 {
        drips.sort_by(|a, b| b.drains_m2.total_cmp(&a.drains_m2));
        drips.truncate(settings.most);
    }
    Ok(Kept { edges: drips, left_out })
}

/// Whether one of an edge's faces looks up and ends there, and what falls beyond it falls far enough.
fn drips(world: &World, edge: &Edge, least_fall_m: f32) -> bool {
    let up = edge.normals.map(|normal| normal.z >= LEAST_UP);
    // Within a roof the surface goes on.
    if !edge.convex || !(up[0] || up[1]) || (edge.shared && up[0] && up[1]) {
        return false;
    }
    let outward = edge.outward[if up[0] { 0 } else { 1 }];
    let beyond = outward.with_z(0.0).normalize_or_zero();
    if beyond == Vec3::ZERO {
        return false;
    }
    // At three places along it, so that a pole below its middle does not stop all of it.
    [0.2, 0.5, 0.8].iter().any(|share| {
        let at = edge.ends[0].lerp(edge.ends[1], *share);
        let above = at + Vec3::new(0.0, 0.0, 0.01) - 0.01 * beyond;
        let free = !meets(world, above, beyond, BEYOND_M + 0.01);
        let fall = at + BEYOND_M * beyond;
        free && !meets(world, fall, Vec3::NEG_Z, least_fall_m)
    })
}

fn meets(world: &World, origin: Vec3, direction: Vec3, far: f32) -> bool {
    world.first(&Ray { origin, direction }, far, false).is_some()
}

/// Most pairs of an edge and a falling cell beside it: 512 MB.
pub const MOST_NEAR: usize = 1 << 26;
/// Most half cells along all edges that may drip.
pub const MOST_STEPS: f64 = (1u64 << 31) as f64;

/// Cells from which water falls.
fn falling(flooded: &Flooded, least_fall_m: f32) -> Vec<bool> {
    let grid = flooded.grid;
    let drains = marked(&flooded.drains, grid.cells());
    let falls = |cell: usize| {
        let to = flooded.to[cell];
        let outer = {
            let (x, y) = (cell % grid.size[0], cell / grid.size[0]);
            x == 0 || y == 0 || x + 1 == grid.size[0] || y + 1 == grid.size[1]
        };
        match to {
            // Beside nothing water falls too; at the map's edge, or into a drain, nobody knows.
            AWAY => !outer && !flooded.level[cell].is_nan() && !drains[cell],
            to => flooded.level[cell] - flooded.level[to as usize] >= least_fall_m,
        }
    };
    (0..grid.cells()).map(falls).collect()
}

/// Cells from which water falls beside edges: pairs of cell and edge in their order, at most so many.
fn beside(
    edges: &[Edge],
    grid: &Grid,
    falls: &[bool],
    most: usize,
    progress: &dyn Progress,
) -> Result<Vec<(u32, u32)>, SceneError> {
    let too_many = |wanted: String, found: String| SceneError::input("cell_m", wanted, found);
    let halves = |edge: &Edge| {
        let [a, b] = edge.ends.map(|end| end.truncate().as_dvec2());
        ((a.distance(b) / (0.5 * grid.cell_m)) as usize).min(4 * crate::heights::MOST_CELLS)
    };
    let steps: f64 = edges.iter().map(|edge| 1.0 + halves(edge) as f64).sum();
    if steps > MOST_STEPS {
        let wanted =
            format!("larger cells: edges that may drip of at most {MOST_STEPS:.1e} half cells in sum");
        return Err(too_many(wanted, format!("{steps:.1e}")));
    }
    let (mut near, mut here) = (Vec::new(), Vec::new());
    for (index, edge) in edges.iter().enumerate() {
        if index % EDGES_A_LOOK == 0 {
            progress.check()?;
        }
        let [a, b] = edge.ends.map(|end| end.truncate().as_dvec2());
        let steps = halves(edge);
        here.clear();
        for step in 0..=steps {
            let at = a.lerp(b, step as f64 / steps.max(1) as f64);
            // The nine cells around: where an edge lies on their border rounding may take it for either's.
            let at = (at - grid.origin_m) / grid.cell_m;
            let range = |at: f64, cells: usize| {
                ((at - 1.0).max(0.0) as usize)..((at + 2.0).clamp(0.0, cells as f64) as usize)
            };
            for y in range(at.y, grid.size[1]) {
                let cells = range(at.x, grid.size[0]).map(|x| y * grid.size[0] + x);
                here.extend(cells.filter(|cell| falls[*cell]).map(|cell| (cell as u32, index as u32)));
            }
        }
        here.sort_unstable();
        here.dedup();
        near.append(&mut here);
        if near.len() > most {
            let wanted =
                format!("larger cells: at most {most} pairs of an edge and a cell from which water falls");
            return Err(too_many(wanted, "more".into()));
        }
    }
    near.par_sort_unstable();
    Ok(near)
}

/// Edges between two looks at whether somebody wants to stop.
const EDGES_A_LOOK: usize = 256;

/// Area that drains over each edge: what gathers in cells from which water falls, given to the edge that is nearest to the fall.
fn drained(
    edges: &[Edge],
    flooded: &Flooded,
    least_fall_m: f32,
    progress: &dyn Progress,
) -> Result<Vec<f64>, SceneError> {
    let mut amounts = vec![0.0; edges.len()];
    if edges.is_empty() {
        return Ok(amounts);
    }
    let (grid, area) = (flooded.grid, gathered_m2(flooded));
    let near = beside(edges, &grid, &falling(flooded, least_fall_m), MOST_NEAR, progress)?;
    let reach = 1.5 * grid.cell_m;
    for pairs in near.chunk_by(|a, b| a.0 == b.0) {
        let cell = pairs[0].0 as usize;
        let middle = grid.middle(cell % grid.size[0], cell / grid.size[0]);
        let to = match flooded.to[cell] {
            AWAY => middle,
            to => grid.middle(to as usize % grid.size[0], to as usize / grid.size[0]),
        };
        let crossing = 0.5 * (middle + to);
        let level = flooded.level[cell];
        let nearest = pairs
            .iter()
            .map(|&(_, index)| {
                let edge = &edges[index as usize];
                (distance(crossing, edge), (edge.middle().z - level).abs(), index)
            })
            // An edge far below or above is another storey's.
            .filter(|(far, apart, _)| *far <= reach && *apart < 0.5 + 2.0 * grid.cell_m as f32)
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
        if let Some((_, _, index)) = nearest {
            amounts[index as usize] += area[cell];
        }
    }
    Ok(amounts)
}

/// Distance over the ground of a place from an edge, m.
fn distance(place: DVec2, edge: &Edge) -> f64 {
    let [a, b] = edge.ends.map(|end| end.truncate().as_dvec2());
    let along = b - a;
    let share = ((place - a).dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
    place.distance(a + share * along)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quiet;
    use crate::flow::bake_flooded;
    use crate::heights::bake_heights;
    use crate::scene::Scene;
    use crate::testing::{StopsAfter, cuboid, quad};

    fn flooded_of(scene: Scene) -> (World, Flooded) {
        let world = World::new(scene);
        let grid = Grid::over(DVec2::splat(-8.0), DVec2::splat(8.0), 0.1).unwrap();
        let heights = bake_heights(world.scene(), grid, &Quiet).unwrap();
        let flooded = bake_flooded(&heights, 0.3, &Quiet).unwrap();
        (world, flooded)
    }

    fn drips_of(scene: Scene) -> Vec<DripEdge> {
        let (world, flooded) = flooded_of(scene);
        bake_drips(&world, &flooded, &DripSettings::default(), &Quiet).unwrap().edges
    }

    fn ground() -> Scene {
        let mut scene = Scene::default();
        quad(&mut scene, [-8.0, -8.0, 0.0], [16.0, 0.0, 0.0], [0.0, 16.0, 0.0], 0);
        scene
    }

    #[test]
    fn a_plane_drips_nowhere_and_neither_does_a_kerb() {
        assert_eq!(drips_of(ground()), []);
        let mut scene = ground();
        cuboid(&mut scene, [-4.0, -4.0, 0.0], [4.0, 4.0, 0.15], 0);
        assert_eq!(drips_of(scene), []);
    }

    #[test]
    fn a_pitched_roof_drips_from_its_eaves_all_that_falls_on_it() {
        let mut scene = ground();
        cuboid(&mut scene, [-2.5, -3.5, 0.0], [2.5, 3.5, 3.0], 0);
        // Two slopes 6 m across and 8 m long over the walls.
        quad(&mut scene, [0.0, -4.0, 5.0], [3.0, 0.0, -1.5], [0.0, 8.0, 0.0], 0);
        quad(&mut scene, [-3.0, -4.0, 3.5], [3.0, 0.0, 1.5], [0.0, 8.0, 0.0], 0);
        let drips = drips_of(scene);
        assert_eq!(drips.len(), 2, "{drips:?}");
        for drip in &drips {
            assert!((drip.ends_m[0].z - 3.5).abs() < 1e-6 && (drip.ends_m[0].x.abs() - 3.0).abs() < 1e-6);
            assert!((drip.drains_m2 - 24.0).abs() < 0.5, "{drip:?}");
        }
    }

    #[test]
    fn an_awning_drips_from_its_outer_edge() {
        let mut scene = ground();
        cuboid(&mut scene, [-6.0, 2.0, 0.0], [6.0, 7.0, 6.0], 0);
        // A sheet that leans from the wall: 4 m wide, 1.5 m deep over the ground.
        quad(&mut scene, [-2.0, 0.5, 2.5], [4.0, 0.0, 0.0], [0.0, 1.5, 0.5], 0);
        let drips = drips_of(scene);
        let outer: Vec<_> = drips.iter().filter(|drip| drip.ends_m[0].z < 2.6).collect();
        assert_eq!(outer.len(), 1, "{drips:?}");
        // Its own 6 m², and what the wall's flat roof sheds above it.
        assert!(outer[0].drains_m2 > 5.5, "{:?}", outer[0]);
        assert!((outer[0].ends_m[0].distance(outer[0].ends_m[1]) - 4.0).abs() < 1e-5);
    }

    #[test]
    fn edges_beyond_the_most_are_counted_and_bounds_and_interruptions_hold() {
        let mut scene = ground();
        cuboid(&mut scene, [-2.0, -3.0, 0.0], [2.0, 3.0, 3.0], 0);
        let (world, flooded) = flooded_of(scene);
        let all = bake_drips(&world, &flooded, &DripSettings::default(), &Quiet).unwrap();
        assert_eq!((all.edges.len(), all.left_out), (4, 0));
        let one = DripSettings { most: 1, ..DripSettings::default() };
        let one = bake_drips(&world, &flooded, &one, &Quiet).unwrap();
        assert_eq!((one.edges.len(), one.left_out), (1, 3));
        assert!(all.edges.iter().all(|edge| edge.drains_m2 <= one.edges[0].drains_m2));
        let stopped = bake_drips(&world, &flooded, &DripSettings::default(), &StopsAfter::new(0));
        assert_eq!(stopped.unwrap_err(), SceneError::Interrupted);
        // Pairs are of falling cells alone, in their order, and no more than allowed.
        let falls = falling(&flooded, 0.4);
        let edges = edges_of(world.scene(), 0.05);
        let near = beside(&edges, &flooded.grid, &falls, MOST_NEAR, &Quiet).unwrap();
        assert!(near.is_sorted() && near.windows(2).all(|pair| pair[0] != pair[1]));
        assert!(near.len() > 100 && near.iter().all(|(cell, _)| falls[*cell as usize]));
        assert!(beside(&edges, &flooded.grid, &falls, near.len(), &Quiet).is_ok());
        let error = beside(&edges, &flooded.grid, &falls, near.len() - 1, &Quiet).unwrap_err().to_string();
        assert!(error.contains("pairs of an edge and a cell"), "{error}");
    }
}
