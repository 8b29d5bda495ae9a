//! Where light was baked: the parts of a light grid's box whose nodes all have rows.

use super::corners;
use crate::error::RuntimeError;
use glam::DVec3;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::response::{NO_ROW, SourceBasis};

/// The intervals of an axis, and its nodes, which are intervals of no length: first node, last node.
fn intervals(count: usize) -> impl Iterator<Item = [usize; 2]> + Clone {
    (0..count).flat_map(move |node| [[node, node], [node, node + 1]]).filter(move |[_, last]| *last < count)
}

/// The parts of the grid whose corners all have rows: nodes, edges, faces and cells.
fn parts<'g>(grid: &'g LightGrid, rows: &'g [u32]) -> impl Iterator<Item = [[usize; 2]; 3]> + 'g {
    let [nx, ny, nz] = grid.axes().map(<[f64]>::len);
    let all = intervals(nz)
        .flat_map(move |z| intervals(ny).flat_map(move |y| intervals(nx).map(move |x| [x, y, z])));
    all.filter(move |part| {
        (0..8).all(|corner: usize| {
            let [i, j, k] = [0, 1, 2].map(|axis| part[axis][corner >> axis & 1]);
            rows.get(i + nx * (j + ny * k)).is_some_and(|&row| row != NO_ROW)
        })
    })
}

/// The point nearest to `position` whose light was baked.
pub(super) fn nearest(sources: &SourceBasis, position: DVec3) -> Option<DVec3> {
    let (grid, rows) = sources.light_grid()?;
    if !position.is_finite() {
        return None;
    }
    let axes = grid.axes();
    let inside = |part: [[usize; 2]; 3]| {
        let [low, high] =
            [0, 1].map(|end| DVec3::from_array(std::array::from_fn(|axis| axes[axis][part[axis][end]])));
        position.clamp(low, high)
    };
    let far = |point: &DVec3| point.distance_squared(position);
    parts(grid, rows).map(inside).min_by(|a, b| far(a).total_cmp(&far(b)))
}

/// Share of the grid's box whose light was baked, by volume (by area or length where the box has no more).
pub(super) fn share(sources: &SourceBasis) -> f64 {
    let Some((grid, rows)) = sources.light_grid() else { return 0.0 };
    let axes = grid.axes();
    if grid.is_empty() {
        return 0.0;
    }
    let size = |part: [[usize; 2]; 3]| -> f64 {
        let edge = |axis: usize| {
            let [first, last] = part[axis];
            // An axis of one node has no length to share.
            if axes[axis].len() == 1 { 1.0 } else { axes[axis][last] - axes[axis][first] }
        };
        (0..3).map(edge).product()
    };
    let whole = size(axes.map(|axis| [0, axis.len() - 1]));
    parts(grid, rows).map(size).sum::<f64>() / whole
}

/// Why a light at `position` cannot be relit.
pub(super) fn refusal(sources: &SourceBasis, position: DVec3) -> RuntimeError {
    let field = "point light's position";
    let Some((grid, _)) = sources.light_grid() else {
        return RuntimeError::argument(field, "an asset with a light grid", "another kind of sources");
    };
    let [low, high] = corners(grid);
    if grid.split(position.to_array()).is_none() {
        let wanted =
            format!("a point between {low} and {high} m: no virtual point light stands outside of it");
        return RuntimeError::argument(field, wanted, position);
    }
    let nearest = match nearest(sources, position) {
        Some(point) => format!("the nearest point that is lit is {point} m"),
        None => "no point is lit".into(),
    };
    let wanted = format!(
        "a point whose virtual point lights were baked. Pruned: the recipe kept only lights that its strokes touch \
         ({:.1} % of the box from {low} to {high} m); `prune = false` keeps all; {nearest}",
        100.0 * share(sources)
    );
    RuntimeError::argument(field, wanted, position)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 3 × 2 × 1 nodes; those at x = 0 and 1 have rows, and one at x = 3.
    fn sources() -> SourceBasis {
        let rows = vec![0, 1, NO_ROW, 2, 3, 4];
        let grid = LightGrid { x_m: vec![0.0, 1.0, 3.0], y_m: vec![0.0, 1.0], z_m: vec![5.0] };
        SourceBasis::LightGrid { grid, rows }
    }

    #[test]
    fn the_nearest_lit_point_is_lit_and_no_lit_one_is_nearer() {
        let lit = |point: DVec3| {
            let sources = sources();
            let around = sources.light_grid().and_then(|(grid, _)| grid.nodes_around(point.to_array()));
            around.is_some_and(|nodes| nodes.iter().all(|&node| sources.row_of(node).is_some()))
        };
        for (x, y, z) in
            [(0.5, 0.5, 5.0), (2.0, 0.2, 5.0), (3.0, 0.9, 7.0), (9.0, -4.0, 0.0), (1.4, 0.0, 5.0)]
        {
            let point = DVec3::new(x, y, z);
            let found = nearest(&sources(), point).unwrap();
            assert!(lit(found), "{found}");
            let least = (0..=30).flat_map(|i| (0..=10).map(move |j| [i, j])).map(|[i, j]| {
                let near = DVec3::new(f64::from(i) * 0.1, f64::from(j) * 0.1, 5.0);
                if lit(near) { near.distance(point) } else { f64::INFINITY }
            });
            assert!(found.distance(point) <= least.fold(f64::INFINITY, f64::min) + 1e-12);
        }
        assert_eq!(nearest(&sources(), DVec3::NAN), None);
    }

    #[test]
    fn the_lit_share_is_that_of_cells_whose_nodes_all_have_rows() {
        assert!((share(&sources()) - 1.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_refusal_says_whether_the_point_is_outside_or_pruned_away() {
        let pruned = refusal(&sources(), DVec3::new(2.0, 0.5, 5.0)).to_string();
        assert!(pruned.contains("Pruned") && pruned.contains("prune = false") && pruned.contains("33.3 %"));
        let outside = refusal(&sources(), DVec3::new(9.0, 0.5, 5.0)).to_string();
        assert!(outside.contains("outside") && !outside.contains("Pruned"), "{outside}");
    }
}
