//! The uppermost surface over the ground: what rain hits first.

use crate::Progress;
use crate::error::SceneError;
use crate::scene::Scene;
use glam::{DVec2, Vec2, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Most cells along a side of a map.
pub const MOST_CELLS: usize = 4096;

/// A grid over the ground: cells of one size, x first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Corner with the smallest x and y, m.
    pub origin_m: DVec2,
    /// Side of a cell, m.
    pub cell_m: f64,
    /// Cells along x and y.
    pub size: [usize; 2],
}

impl Grid {
    /// The grid over a rectangle, low corner to high one.
    ///
    /// Errors: a rectangle without area; more cells than [`MOST_CELLS`] a side.
    pub fn over(low: DVec2, high: DVec2, cell_m: f64) -> Result<Self, SceneError> {
        let side = high - low;
        if !(side.x > 0.0 && side.y > 0.0 && side.x < 1e7 && side.y < 1e7) {
            let found = format!("{low} to {high}");
            return Err(SceneError::input(
                "region_m",
                "a rectangle with an area, at most 10⁷ m a side",
                found,
            ));
        }
        // A length of whole cells but for rounding has that many.
        let size = [side.x, side.y].map(|side| (side / cell_m - 1e-6).ceil().max(1.0));
        if size.iter().any(|cells| *cells > MOST_CELLS as f64) {
            let least = side.max_element() / MOST_CELLS as f64;
            let wanted = format!("at least {least:.3} m, {MOST_CELLS} cells along the longer side");
            return Err(SceneError::input("cell_m", wanted, cell_m));
        }
        Ok(Self { origin_m: low, cell_m, size: size.map(|cells| cells as usize) })
    }

    /// Cells.
    pub fn cells(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Middle of a cell, m.
    pub fn middle(&self, x: usize, y: usize) -> DVec2 {
        self.origin_m + self.cell_m * DVec2::new(x as f64 + 0.5, y as f64 + 0.5)
    }

    /// The cell that a place lies in, or `None` outside.
    pub fn cell(&self, place: DVec2) -> Option<usize> {
        let at = (place - self.origin_m) / self.cell_m;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.size[0] as f64 && at.y < self.size[1] as f64;
        inside.then(|| at.y as usize * self.size[0] + at.x as usize)
    }
}

/// The uppermost surface, cell by cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Heights {
    /// Where the cells are.
    pub grid: Grid,
    /// Height of the highest point in a cell, m: never below what stands there. NaN where there is nothing.
    pub highest: Vec<f32>,
    /// Height over a cell's middle, m; NaN where there is nothing.
    pub middle: Vec<f32>,
}

/// Bands of rows that are filled at the same time; the result does not depend on it.
const BANDS: usize = 16;

/// Most cells that all triangles together are compared with: some ten minutes of one core.
pub const MOST_COVERED: f64 = (1u64 << 36) as f64;
/// Cells and triangles between two looks at whether somebody wants to stop.
const WORK_A_LOOK: usize = 1 << 18;

/// Heights of a scene over a grid.
///
/// Errors: triangles that lie over more than [`MOST_COVERED`] cells in sum; an interruption.
pub fn bake_heights(scene: &Scene, grid: Grid, progress: &dyn Progress) -> Result<Heights, SceneError> {
    few_enough(covered(scene, &grid), MOST_COVERED, &grid)?;
    let [width, height] = grid.size;
    let rows = height.div_ceil(BANDS);
    let mut highest = vec![f32::NEG_INFINITY; width * height];
    let mut middle = highest.clone();
    let bands = highest.par_chunks_mut(width * rows).zip(middle.par_chunks_mut(width * rows)).enumerate();
    bands.try_for_each(|(band, (highest, middle))| {
        let first = band * rows;
        let rows = first..first + highest.len() / width;
        let mut work = WORK_A_LOOK;
        for triangle in &scene.triangles {
            if work >= WORK_A_LOOK {
                progress.check()?;
                work = 0;
            }
            work += 1 + fill(&grid, triangle, rows.clone(), highest, middle);
        }
        Ok(())
    })?;
    for value in highest.iter_mut().chain(&mut middle).filter(|value| **value == f32::NEG_INFINITY) {
        *value = f32::NAN;
    }
    Ok(Heights { grid, highest, middle })
}

/// Cells that lie in the boxes of all triangles, one triangle after the other.
fn covered(scene: &Scene, grid: &Grid) -> f64 {
    let cells = grid.size.map(|cells| 0..cells);
    let of = |triangle: &[Vec3; 3]| {
        let [low, high] = bounds(&in_cells(grid, triangle));
        let [x, y] = [0, 1].map(|axis| span(low[axis], high[axis], cells[axis].clone()).len());
        x as f64 * y as f64
    };
    scene.triangles.iter().map(of).sum()
}

/// Refuses a map over which triangles lie too often, with a cell that would do.
fn few_enough(covered: f64, most: f64, grid: &Grid) -> Result<(), SceneError> {
    if covered <= most {
        return Ok(());
    }
    let least = (1e3 * grid.cell_m * (covered / most).sqrt()).ceil() / 1e3;
    let wanted = format!("at least {least:.3} m, or triangles over at most {most:.1e} cells in sum");
    Err(SceneError::input("cell_m", wanted, format!("{} m, {covered:.1e} cells", grid.cell_m)))
}

/// A triangle in cells from the grid's corner, heights in m.
fn in_cells(grid: &Grid, triangle: &[Vec3; 3]) -> [Vec3; 3] {
    triangle.map(|corner| {
        let at = (corner.truncate().as_dvec2() - grid.origin_m) / grid.cell_m;
        at.as_vec2().extend(corner.z)
    })
}

/// Smallest and largest corner.
fn bounds([a, b, c]: &[Vec3; 3]) -> [Vec3; 2] {
    [a.min(b.min(*c)), a.max(b.max(*c))]
}

/// Cells of a range that lie between two places.
fn span(low: f32, high: f32, cells: Range<usize>) -> Range<usize> {
    let from = low.floor().max(cells.start as f32);
    let to = (high.floor() + 1.0).min(cells.end as f32);
    if from < to { from as usize..to as usize } else { 0..0 }
}

/// Brings one triangle into rows of both maps; how many cells it was compared with.
fn fill(
    grid: &Grid,
    triangle: &[Vec3; 3],
    rows: Range<usize>,
    highest: &mut [f32],
    middle: &mut [f32],
) -> usize {
    let corners = in_cells(grid, triangle);
    let [low, high] = bounds(&corners);
    let width = grid.size[0];
    let inner = Inner::new(&corners);
    let (across, along) = (span(low.x, high.x, 0..width), span(low.y, high.y, rows.clone()));
    for y in along.clone() {
        for x in across.clone() {
            let at = (y - rows.start) * width + x;
            if highest[at] < high.z
                && let Some(top) = highest_in_cell(&corners, Vec2::new(x as f32, y as f32))
            {
                highest[at] = highest[at].max(top);
            }
            if let Some(height) = inner.height(Vec2::new(x as f32 + 0.5, y as f32 + 0.5)) {
                middle[at] = middle[at].max(height.clamp(low.z, high.z));
            }
        }
    }
    across.len() * along.len()
}

/// A triangle seen from above.
struct Inner {
    corners: [Vec3; 3],
    inverse: f32,
}

impl Inner {
    fn new(corners: &[Vec3; 3]) -> Self {
        let [a, b, c] = corners.map(Vec3::truncate);
        Self { corners: *corners, inverse: 1.0 / (b - a).perp_dot(c - a) }
    }

    /// Height where a vertical line meets it.
    fn height(&self, at: Vec2) -> Option<f32> {
        /// Weights beyond 0 to 1 that still count: a seam leaves no hole.
        const EDGE: f32 = 1e-5;
        let [a, b, c] = self.corners;
        let from = at - a.truncate();
        let u = from.perp_dot((c - a).truncate()) * self.inverse;
        let v = (b - a).truncate().perp_dot(from) * self.inverse;
        // NaN, of a triangle that stands upright, is in no range.
        let inside = u >= -EDGE && v >= -EDGE && u + v <= 1.0 + EDGE;
        inside.then_some(a.z + u * (b.z - a.z) + v * (c.z - a.z))
    }
}

/// Highest point of the part of a triangle that lies in a cell: it is cut by the cell's four sides \[sutherland\].
fn highest_in_cell(corners: &[Vec3; 3], cell: Vec2) -> Option<f32> {
    // A triangle cut by four sides has seven corners at most.
    let mut part = [Vec3::ZERO; 8];
    part[..3].copy_from_slice(corners);
    let mut count = 3;
    for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
        let bound = if sign > 0.0 { cell[axis] } else { cell[axis] + 1.0 };
        let inside = |corner: Vec3| sign * (corner[axis] - bound);
        let whole = part;
        let mut kept = 0;
        for k in 0..count {
            let (here, next) = (whole[k], whole[(k + 1) % count]);
            let (a, b) = (inside(here), inside(next));
            if a >= 0.0 {
                part[kept] = here;
                kept += 1;
            }
            if (a >= 0.0) != (b >= 0.0) {
                part[kept] = here + (next - here) * (a / (a - b));
                kept += 1;
            }
        }
        count = kept;
        if count == 0 {
            return None;
        }
    }
    part[..count].iter().map(|corner| corner.z).reduce(f32::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quiet;
    use crate::testing::StopsAfter;
    use crate::testing::{cuboid, quad};

    /// Single precision at some 100 cells.
    const ROUND_OFF: f32 = 1e-4;

    fn grid(cell_m: f64) -> Grid {
        Grid::over(DVec2::new(-4.0, -2.0), DVec2::new(4.0, 2.0), cell_m).unwrap()
    }

    #[test]
    fn a_slope_is_found_over_middles_and_its_highest_corner_is_the_cells_height() {
        let mut scene = Scene::default();
        // z = 5 + x/2 + y/4.
        quad(&mut scene, [-4.0, -2.0, 2.5], [8.0, 0.0, 4.0], [0.0, 4.0, 1.0], 0);
        let heights = bake_heights(&scene, grid(0.25), &Quiet).unwrap();
        for y in 0..16 {
            for x in 0..32 {
                let middle = heights.grid.middle(x, y).as_vec2();
                let plane = 5.0 + 0.5 * middle.x + 0.25 * middle.y;
                let at = y * 32 + x;
                assert!((heights.middle[at] - plane).abs() < ROUND_OFF);
                let corner = plane + 0.125 * 0.75;
                assert!((heights.highest[at] - corner).abs() < ROUND_OFF, "{} {corner}", heights.highest[at]);
            }
        }
    }

    #[test]
    fn what_is_thinner_than_a_cell_is_in_the_highest_and_nothing_is_no_number() {
        let mut scene = Scene::default();
        // A mast between two middles, and a fence without thickness.
        cuboid(&mut scene, [0.01, 0.01, 0.0], [0.05, 0.05, 6.0], 0);
        quad(&mut scene, [-3.9, -0.6, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0], 0);
        let heights = bake_heights(&scene, grid(0.5), &Quiet).unwrap();
        let at = |x: f64, y: f64| heights.grid.cell(DVec2::new(x, y)).unwrap();
        assert_eq!((heights.highest[at(0.1, 0.1)], heights.highest[at(-3.0, -0.6)]), (6.0, 2.0));
        assert!(heights.middle[at(0.1, 0.1)].is_nan() && heights.highest[at(3.0, 1.0)].is_nan());
    }

    #[test]
    fn a_map_of_more_cells_than_are_held_is_refused_with_a_cell_that_would_do() {
        let error = Grid::over(DVec2::ZERO, DVec2::new(1000.0, 10.0), 0.1).unwrap_err().to_string();
        assert!(error.contains("at least 0.244 m"), "{error}");
        assert!(Grid::over(DVec2::ZERO, DVec2::new(1000.0, 0.0), 0.1).is_err());
        assert!(Grid::over(DVec2::ZERO, DVec2::new(f64::NAN, 1.0), 0.1).is_err());
    }

    #[test]
    fn triangles_over_too_many_cells_are_refused_and_filling_stops_when_it_is_told_to() {
        let mut scene = Scene::default();
        for _ in 0..20 {
            quad(&mut scene, [-9.0, -9.0, 0.0], [18.0, 0.0, 0.0], [0.0, 18.0, 0.0], 0);
        }
        // Forty triangles over all of 32 × 16 cells; none over cells outside.
        let grid = grid(0.25);
        assert_eq!(covered(&scene, &grid), 40.0 * 512.0);
        assert!(few_enough(20_480.0, 20_480.0, &grid).is_ok());
        let error = few_enough(20_480.0, 5120.0, &grid).unwrap_err().to_string();
        assert!(error.contains("cell_m: wanted at least 0.500 m"), "{error}");
        // Each of the bands looks before its first triangle, and all again after some 2¹⁸ cells.
        let stopped = |looks| bake_heights(&scene, grid, &StopsAfter::new(looks));
        assert_eq!(stopped(0).unwrap_err(), SceneError::Interrupted);
        let fine = Grid::over(DVec2::splat(-8.0), DVec2::splat(8.0), 0.01).unwrap();
        let late = bake_heights(&scene, fine, &StopsAfter::new(BANDS as i64));
        assert_eq!(late.unwrap_err(), SceneError::Interrupted);
    }
}
