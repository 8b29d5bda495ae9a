//! Which cells a sweep has to visit when only some are asked for.
//!
//! Light of a direction reaches a cell only from cells with cloud upstream of it, and is asked for only where a wanted cell lies
//! downstream. Everything else is dark, or nobody's light. Along a row both hold from some cell on and up to some cell, so that what has
//! to be visited is one stretch of every row; what comes of the visited cells is the same bytes as of a sweep through all.

use crate::cloud::Cloud;
use squall_formats::GridShape;

/// Steps along a row, in the order in which light goes: the first, and the one behind the last.
pub(crate) type Stretch = [u32; 2];

/// The stretches of all rows, for the eight ways that light can go through the grid.
#[derive(Clone, Debug)]
pub(crate) struct Spans {
    octants: [Vec<Stretch>; 8],
    /// Wanted cells of each row: the first along x, and the one behind the last.
    wanted: Vec<Stretch>,
}

/// The number of the octant whose light goes `forward` along x, y, z.
pub(crate) fn octant_of(forward: [bool; 3]) -> usize {
    (0..3).map(|axis| usize::from(!forward[axis]) << axis).sum()
}

impl Spans {
    /// For sweeps through `cloud` of which only the cells `wanted` count.
    pub(crate) fn new(cloud: &Cloud, wanted: &[bool]) -> Self {
        let shape = cloud.shape;
        let dense = ends(shape, |index| cloud.extinction[index] > 0.0);
        let wanted = ends(shape, |index| wanted[index]);
        let octants = std::array::from_fn(|octant| stretches(shape, octant, &dense, &wanted));
        Self { octants, wanted }
    }

    /// The stretch of row `row` for light of `octant`.
    #[inline(always)]
    pub(crate) fn stretch(&self, octant: usize, row: usize) -> [usize; 2] {
        self.octants[octant][row].map(|step| step as usize)
    }

    /// Steps of row `row` that light going forward along x needs or light going back, `octants` one and the other.
    #[inline(always)]
    pub(crate) fn both(&self, octants: [usize; 2], row: usize) -> [usize; 2] {
        let [a, b] = octants.map(|octant| self.stretch(octant, row));
        match (a[0] < a[1], b[0] < b[1]) {
            (true, true) => [a[0].min(b[0]), a[1].max(b[1])],
            (false, _) => b,
            _ => a,
        }
    }

    /// Wanted cells of row `row`: from the first along x to behind the last.
    pub(crate) fn wanted(&self, row: usize) -> [usize; 2] {
        self.wanted[row].map(|cell| cell as usize)
    }

    /// Share of all cells and ways that a sweep visits, 0 to 1.
    pub(crate) fn share(&self, shape: GridShape) -> f64 {
        let visited: u64 =
            self.octants.iter().flatten().map(|[first, end]| u64::from(end.saturating_sub(*first))).sum();
        visited as f64 / (8 * shape.len()) as f64
    }
}

/// For each row the first cell along x that is `marked` and the one behind the last; first beyond last where there is none.
fn ends(shape: GridShape, marked: impl Fn(usize) -> bool) -> Vec<Stretch> {
    let nx = shape.nx as usize;
    let row = |row: usize| {
        let is = |x: &usize| marked(row * nx + x);
        match ((0..nx).find(is), (0..nx).rev().find(is)) {
            (Some(first), Some(last)) => [first as u32, last as u32 + 1],
            _ => [u32::MAX, 0],
        }
    };
    (0..shape.len() / nx).map(row).collect()
}

fn stretches(shape: GridShape, octant: usize, dense: &[Stretch], wanted: &[Stretch]) -> Vec<Stretch> {
    let [nx, ny, nz] = shape.to_array();
    let back: [bool; 3] = std::array::from_fn(|axis| octant >> axis & 1 == 1);
    // Rows in the order in which light meets them.
    let row = |y: usize, z: usize| {
        let (y, z) = (if back[1] { ny - 1 - y } else { y }, if back[2] { nz - 1 - z } else { z });
        y + ny * z
    };
    // In steps along the row.
    let turned = |[first, end]: Stretch| match first < end {
        true if back[0] => [nx as u32 - end, nx as u32 - first],
        _ => [first, end],
    };
    let mut out = vec![[u32::MAX, 0]; ny * nz];
    for z in 0..nz {
        for y in 0..ny {
            let mut first = turned(dense[row(y, z)])[0];
            if y > 0 {
                first = first.min(out[row(y - 1, z)][0]);
            }
            if z > 0 {
                first = first.min(out[row(y, z - 1)][0]);
            }
            out[row(y, z)][0] = first;
        }
    }
    for z in (0..nz).rev() {
        for y in (0..ny).rev() {
            let mut end = turned(wanted[row(y, z)])[1];
            if y + 1 < ny {
                end = end.max(out[row(y + 1, z)][1]);
            }
            if z + 1 < nz {
                end = end.max(out[row(y, z + 1)][1]);
            }
            out[row(y, z)][1] = end;
        }
    }
    out.into_iter().map(|[first, end]| if first < end { [first, end] } else { [0, 0] }).collect()
}
