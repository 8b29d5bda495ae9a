//! Covers of the caller's own as a graphics card asks for them.

use super::CoverMap;
use crate::gpu::rain::CoverHead;
use std::sync::Arc;

impl CoverMap {
    /// Underside and top of each cell, m above the origin, x fastest; a top below its underside is a hole.
    pub(crate) fn cells(&self) -> impl Iterator<Item = [f32; 2]> {
        (0..self.tops.len()).map(|at| {
            let top = self.tops[at];
            let under = self.undersides.as_ref().map_or(-1e30, |undersides| undersides[at].max(-1e30));
            if top.is_finite() && !under.is_nan() { [under, top] } else { [1.0, 0.0] }
        })
    }

    /// Its place, and where its cells begin among all.
    pub(crate) fn head(&self, first: u32) -> CoverHead {
        CoverHead {
            origin: self.origin.as_vec3().to_array(),
            inverse_cell: (1.0 / self.cell) as f32,
            size: self.size.map(|count| count as u32),
            first,
            highest: self.highest.max(-1e30) as f32,
        }
    }

    /// Whether both are of the same cells, wherever they stand.
    pub(crate) fn has_cells_of(&self, other: &Self) -> bool {
        let same = |a: &Arc<[f32]>, b: &Arc<[f32]>| Arc::ptr_eq(a, b);
        let undersides = match (&self.undersides, &other.undersides) {
            (Some(a), Some(b)) => same(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
        same(&self.tops, &other.tops) && undersides && self.size == other.size
    }
}
