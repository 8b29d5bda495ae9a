//! A cloud as transport sees it: extinction per cell, one albedo and one asymmetry parameter.

use crate::error::ArgumentError;
use crate::phase::DeltaM;
use glam::DVec3;
use squall_formats::GridShape;

/// What lies beyond the grid's sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boundary {
    /// Empty space on all six sides.
    Open,
    /// The grid repeats along x and y; empty space above and below.
    PeriodicXy,
}

/// A grid of extinction, piecewise constant per cell, and empty space around it.
///
/// ```
/// use glam::DVec3;
/// use squall_formats::GridShape;
/// use squall_transport::{Boundary, Cloud};
///
/// // A ball of cloud, 100 m across, in cells of 10 m.
/// let shape = GridShape::new(12, 12, 12);
/// let mut cloud = Cloud {
///     shape,
///     cell_m: [10.0; 3],
///     origin_m: DVec3::splat(-60.0),
///     extinction: vec![0.0; shape.len()],
///     albedo: 0.999,
///     g: 0.85,
///     boundary: Boundary::Open,
/// };
/// for index in 0..shape.len() {
///     if cloud.centre(shape.cell(index)).length() < 50.0 {
///         cloud.extinction[index] = 0.02;
///     }
/// }
/// let cloud = cloud.checked()?;
/// assert_eq!(cloud.far_corner(), DVec3::splat(60.0));
/// // Whatever no solver can work with is refused, and the message names it.
/// let wrong = Cloud { albedo: 1.5, ..cloud }.checked().unwrap_err();
/// assert_eq!(wrong.to_string(), "cloud albedo: wanted 0 to 1, found 1.5");
/// # Ok::<(), squall_transport::ArgumentError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Cloud {
    /// Number of cells.
    pub shape: GridShape,
    /// Cell edges along x, y, z, m; need not be equal.
    pub cell_m: [f64; 3],
    /// Corner of cell (0, 0, 0) with the smallest coordinates, m.
    pub origin_m: DVec3,
    /// Extinction per cell, 1/m, x fastest.
    pub extinction: Vec<f32>,
    /// Single-scattering albedo, 0 to 1.
    pub albedo: f64,
    /// Asymmetry parameter of the Henyey–Greenstein phase function, between −1 and 1, ends excluded.
    pub g: f64,
    /// What lies beyond the sides.
    pub boundary: Boundary,
}

impl Cloud {
    /// Checks everything that transport relies on.
    ///
    /// Errors: an empty or oversized grid, an array of another length, extinction that is negative or not finite,
    /// cell edges that are not positive, albedo outside [0, 1], g outside (−1, 1).
    pub fn checked(self) -> Result<Self, ArgumentError> {
        let cells = self.shape.checked_len();
        let Some(cells) = cells else {
            return Err(ArgumentError::new("cloud grid", "1 to 2^32 cells", format!("{:?}", self.shape)));
        };
        if self.extinction.len() != cells {
            let found = format!("{} values", self.extinction.len());
            return Err(ArgumentError::new("cloud extinction", format!("{cells} values"), found));
        }
        if let Some(at) = self.extinction.iter().position(|e| !(e.is_finite() && *e >= 0.0)) {
            let found = format!("{} in cell {:?}", self.extinction[at], self.shape.cell(at));
            return Err(ArgumentError::new("cloud extinction", "finite and not negative, 1/m", found));
        }
        if !self.cell_m.iter().all(|edge| edge.is_finite() && *edge > 0.0) || !self.origin_m.is_finite() {
            let found = format!("cell {:?} at {}", self.cell_m, self.origin_m);
            return Err(ArgumentError::new("cloud cell and origin", "positive and finite metres", found));
        }
        if !(0.0..=1.0).contains(&self.albedo) {
            return Err(ArgumentError::new("cloud albedo", "0 to 1", self.albedo));
        }
        if !(self.g > -1.0 && self.g < 1.0) {
            return Err(ArgumentError::new("cloud g", "between -1 and 1, ends excluded", self.g));
        }
        Ok(self)
    }

    /// The same cloud with every cell cut into `factors` along x, y, z; sub-cells inherit their extinction.
    ///
    /// Errors: a zero factor, or more cells than a grid can have.
    pub fn refined(&self, factors: [u32; 3]) -> Result<Self, ArgumentError> {
        let shape = self.shape.refined(factors).ok_or_else(|| {
            ArgumentError::new("refinement", "factors from 1, fewer than 2^32 cells", format!("{factors:?}"))
        })?;
        let parent = CoarseIndex::new(shape, factors);
        let extinction = (0..shape.len()).map(|i| self.extinction[parent.of(i)]).collect();
        let cell_m = std::array::from_fn(|axis| self.cell_m[axis] / f64::from(factors[axis]));
        Ok(Self { shape, cell_m, extinction, ..self.clone() })
    }

    /// The same cloud in cells `factors` times as large along x, y and z, each with the mean extinction of the cells in it.
    ///
    /// Errors: factors that do not divide the grid.
    pub fn coarsened(&self, factors: [u32; 3]) -> Result<Self, ArgumentError> {
        let counts = self.shape.to_array();
        let fits = |axis: usize| factors[axis] > 0 && counts[axis].is_multiple_of(factors[axis] as usize);
        if !(0..3).all(fits) {
            let wanted = format!("whole blocks of {counts:?} cells");
            return Err(ArgumentError::new("blocks of cells", wanted, format!("{factors:?}")));
        }
        let index = CoarseIndex::new(self.shape, factors);
        let extinction = index.means(&self.extinction, 1);
        let cell_m = std::array::from_fn(|axis| self.cell_m[axis] * f64::from(factors[axis]));
        Ok(Self { shape: index.coarse(), cell_m, extinction, ..self.clone() })
    }

    /// The cells of `marked`, and the 26 around each; across the sides too where the grid repeats.
    ///
    /// Panics when `marked` is not one grid long.
    pub fn beside(&self, marked: &[bool]) -> Vec<bool> {
        assert_eq!(marked.len(), self.shape.len());
        let size = self.shape.to_array();
        let mut out = vec![false; marked.len()];
        for index in (0..marked.len()).filter(|&index| marked[index]) {
            let cell = self.shape.cell(index);
            for step in 0..27usize {
                let offset = [step % 3, step / 3 % 3, step / 9];
                let near: [Option<usize>; 3] = std::array::from_fn(|axis| {
                    let at = cell[axis] + offset[axis];
                    let around = axis < 2 && self.boundary == Boundary::PeriodicXy;
                    match at {
                        0 => around.then_some(size[axis] - 1),
                        at if at - 1 < size[axis] => Some(at - 1),
                        _ => around.then_some(0),
                    }
                });
                if let [Some(x), Some(y), Some(z)] = near {
                    out[self.shape.index(x, y, z)] = true;
                }
            }
        }
        out
    }

    /// Cells that rays shade with: light is read between the middles of eight cells, and only where there is density.
    pub fn shaded(&self) -> Vec<bool> {
        let dense: Vec<bool> = self.extinction.iter().map(|&extinction| extinction > 0.0).collect();
        self.beside(&dense)
    }

    /// Corner of the grid with the largest coordinates, m.
    pub fn far_corner(&self) -> DVec3 {
        let [nx, ny, nz] = self.shape.to_array().map(|n| n as f64);
        self.origin_m + DVec3::new(nx * self.cell_m[0], ny * self.cell_m[1], nz * self.cell_m[2])
    }

    /// Volume of a cell, m³.
    pub fn cell_volume(&self) -> f64 {
        self.cell_m.iter().product()
    }

    /// Centre of cell (x, y, z), m.
    pub fn centre(&self, cell: [usize; 3]) -> DVec3 {
        let at = |axis: usize| self.origin_m[axis] + (cell[axis] as f64 + 0.5) * self.cell_m[axis];
        DVec3::new(at(0), at(1), at(2))
    }

    /// Albedo and phase function scaled for a solver of `degree`.
    pub fn scaled(&self, degree: usize) -> DeltaM {
        DeltaM::new(self.albedo, self.g, degree)
    }
}

/// From an index of a refined grid to the index of the coarse cell that holds it.
#[derive(Clone, Copy, Debug)]
pub struct CoarseIndex {
    fine: GridShape,
    coarse: GridShape,
    factors: [usize; 3],
}

impl CoarseIndex {
    /// For grid `fine` whose cells are `factors` times smaller along each axis than the coarse ones.
    pub fn new(fine: GridShape, factors: [u32; 3]) -> Self {
        let coarse = GridShape::new(fine.nx / factors[0], fine.ny / factors[1], fine.nz / factors[2]);
        Self { fine, coarse, factors: factors.map(|f| f as usize) }
    }

    /// The coarse grid.
    pub fn coarse(&self) -> GridShape {
        self.coarse
    }

    /// Index of the coarse cell around fine cell `index`.
    pub fn of(&self, index: usize) -> usize {
        let [x, y, z] = self.fine.cell(index);
        self.coarse.index(x / self.factors[0], y / self.factors[1], z / self.factors[2])
    }

    /// Plain means of `width` interleaved values over the fine cells of each coarse cell, summed in index order in
    /// double precision.
    pub fn means(&self, fine: &[f32], width: usize) -> Vec<f32> {
        let mut sums = vec![0.0f64; self.coarse.len() * width];
        for (index, values) in fine.chunks_exact(width).enumerate() {
            let to = self.of(index) * width;
            for (sum, value) in sums[to..to + width].iter_mut().zip(values) {
                *sum += f64::from(*value);
            }
        }
        let share = 1.0 / self.factors.iter().product::<usize>() as f64;
        sums.into_iter().map(|sum| (sum * share) as f32).collect()
    }
}
