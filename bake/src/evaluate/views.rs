//! Where light is compared, and relit light as it is seen there.

use super::RelitError;
use crate::response::{HeldOutStroke, add_direct};
use glam::DVec3;
use squall_formats::section::response::{DirectTerm, DirectionalBasis};
use squall_formats::sphere::{self, MAX_HARMONICS};
use squall_formats::view_region::{ViewRegion, ViewRegionFrame};
use squall_runtime::random::Random;
use squall_runtime::relight::{Relit, basis_factors};
use squall_runtime::single_scatter::add_direct_beam;
use squall_runtime::transport::Cloud;

/// Where light is compared: the cells that can be seen, in the 26 directions or towards viewpoints of a view region.
pub struct Views {
    /// Cells that count.
    cells: Vec<u32>,
    /// Middles of those and directions from them to the viewpoints, viewpoints innermost; nothing for the 26 directions.
    to_viewpoints: Option<Vec<(DVec3, DVec3)>>,
    /// What each view of a cell counts for, summing to 1.
    weights: Vec<f64>,
}

/// Viewpoints that light is compared at.
const VIEWPOINTS: usize = 8;
/// Seed of their places, beside their number.
const VIEWPOINTS_SEED: u64 = 0xe7e5;

/// Factors of a basis in every view: those of a cell's views behind one another, or of one cell's that stand for all.
pub struct ViewFactors {
    count: usize,
    factors: Vec<f32>,
}

impl Views {
    /// Views of the cells that are `seen`: the 26 directions without a `view_region`, else towards viewpoints drawn at random from
    /// it. Another `number` draws others.
    pub fn new(
        cloud: &Cloud,
        view_region: Option<&ViewRegion>,
        number: u64,
        seen: impl Fn(usize) -> bool,
    ) -> Self {
        let cells: Vec<u32> =
            (0..cloud.shape.len()).filter(|&cell| seen(cell)).map(|cell| cell as u32).collect();
        let Some(view_region) = view_region else {
            return Self { cells, to_viewpoints: None, weights: sphere::weights_26().to_vec() };
        };
        let mut random = Random::from_parts(&[VIEWPOINTS_SEED, number]);
        let places: [DVec3; VIEWPOINTS] = std::array::from_fn(|_| {
            let at = [random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0)];
            DVec3::from_array(view_region.point(at))
        });
        let towards = |&cell: &u32| {
            let middle = cloud.centre(cloud.shape.cell(cell as usize));
            places.map(|viewpoint| (middle, (viewpoint - middle).try_normalize().unwrap_or(DVec3::Z)))
        };
        Self {
            to_viewpoints: Some(cells.iter().flat_map(towards).collect()),
            cells,
            weights: vec![1.0 / VIEWPOINTS as f64; VIEWPOINTS],
        }
    }

    /// Errors of `found` against `wanted`, values of these views both.
    pub fn compare(&self, found: &[f32], wanted: &[f32]) -> RelitError {
        RelitError::of(found, wanted, &self.weights)
    }

    /// Factors of `basis`; with its frame where it is towards a view region.
    pub fn factors(&self, basis: DirectionalBasis, frame: Option<&ViewRegionFrame>) -> ViewFactors {
        let mut factors = Vec::new();
        let mut one = Vec::new();
        match &self.to_viewpoints {
            None => {
                for direction in sphere::directions_26() {
                    basis_factors(basis, None, DVec3::from_array(direction), &mut one);
                    factors.extend_from_slice(&one);
                }
            }
            Some(to_viewpoints) => {
                for &(middle, towards) in to_viewpoints {
                    basis_factors(basis, frame.map(|frame| (frame, middle)), towards, &mut one);
                    factors.extend_from_slice(&one);
                }
            }
        }
        ViewFactors { count: basis.count(), factors }
    }

    /// Relit light, a value a cell and view, views innermost.
    pub fn light(&self, relit: &Relit<'_>, factors: &ViewFactors) -> Vec<f32> {
        let (views, count) = (self.weights.len(), factors.count);
        let mut out = Vec::with_capacity(self.cells.len() * views);
        for (place, &cell) in self.cells.iter().enumerate() {
            let first = if self.to_viewpoints.is_some() { place * views } else { 0 };
            let rows = factors.factors[first * count..].chunks_exact(count).take(views);
            out.extend(rows.map(|row| relit.value(cell as usize, row)));
        }
        out
    }

    /// Errors of relit light against other light in the same basis.
    pub fn errors(&self, found: &Relit<'_>, wanted: &Relit<'_>, factors: &ViewFactors) -> RelitError {
        self.compare(&self.light(found, factors), &self.light(wanted, factors))
    }

    /// Light in the 26 directions, read between them.
    fn between(&self, values: &[f32]) -> Vec<f32> {
        let Some(to_viewpoints) = &self.to_viewpoints else {
            let of_cell = |&cell: &u32| &values[26 * cell as usize..26 * (cell as usize + 1)];
            return self.cells.iter().flat_map(of_cell).copied().collect();
        };
        let mut out = Vec::with_capacity(to_viewpoints.len());
        for (place, (_, towards)) in to_viewpoints.iter().enumerate() {
            let cell = 26 * self.cells[place / VIEWPOINTS] as usize;
            let near = sphere::interpolate_26(towards.to_array());
            out.push(near.iter().map(|&(direction, weight)| weight as f32 * values[cell + direction]).sum());
        }
        out
    }

    /// Light in the 26 directions that has no more than degree 3 in it.
    fn smooth(&self, values: &[f32]) -> Vec<f32> {
        if self.to_viewpoints.is_none() {
            return self.between(values);
        }
        let (basis, cells) = (DirectionalBasis::Harmonics { degree: 3 }, values.len() / 26);
        let mut planes = vec![0.0; MAX_HARMONICS * cells];
        add_direct(basis, values, 1.0, &mut planes);
        self.light(&Relit { basis, frame: None, cells, planes: &planes }, &self.factors(basis, None))
    }

    /// A held-out stroke's direct light.
    fn direct(&self, stroke: &HeldOutStroke) -> Vec<f32> {
        if self.to_viewpoints.is_none() || stroke.direct_to_viewers.is_empty() {
            return self.between(&stroke.direct);
        }
        let cells = self.cells.iter();
        cells.flat_map(|&cell| [stroke.direct_to_viewers[cell as usize]; VIEWPOINTS]).collect()
    }

    /// J of a beam's direct light for an irradiance of 1 W/m², `direction` the way it travels.
    pub fn direct_beam(&self, cloud: &Cloud, extinction_scale: f64, direction: DVec3) -> Vec<f32> {
        let views = self.weights.len();
        let mut out = vec![0.0; self.cells.len() * views];
        let directions = sphere::directions_26();
        for view in 0..views {
            let mut ways = vec![[0.0, 0.0, 1.0]; cloud.shape.len()];
            match &self.to_viewpoints {
                None => ways.fill(DVec3::from_array(directions[view]).as_vec3().to_array()),
                Some(to) => {
                    for (place, &cell) in self.cells.iter().enumerate() {
                        ways[cell as usize] = to[place * views + view].1.as_vec3().to_array();
                    }
                }
            }
            let mut j = vec![0.0; cloud.shape.len()];
            add_direct_beam(cloud, extinction_scale, direction, &ways, &mut j);
            for (place, &cell) in self.cells.iter().enumerate() {
                out[place * views + view] = j[cell as usize];
            }
        }
        out
    }

    /// A held-out stroke's light, solved directly, and the part of it that the runtime adds itself.
    pub fn truth(&self, stroke: &HeldOutStroke, direct_term: DirectTerm) -> (Vec<f32>, Vec<f32>) {
        // Light that was scattered on its way has no more than the solver's degree in it, direct light has.
        let rest: Vec<f32> =
            stroke.truth.iter().zip(&stroke.direct).map(|(all, direct)| all - direct).collect();
        let (mut truth, mut direct) = (self.smooth(&rest), self.direct(stroke));
        truth.iter_mut().zip(&direct).for_each(|(sum, direct)| *sum += direct);
        if direct_term == DirectTerm::InRows {
            direct.fill(0.0);
        }
        (truth, direct)
    }
}
