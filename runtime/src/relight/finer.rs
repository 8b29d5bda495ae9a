//! Finer levels of virtual lights: what a stroke's light has beyond the mix of the light grid's, in windows of cells.

use super::{PointLight, Relighter, SourceWeight};
use crate::error::RuntimeError;
use squall_formats::haar::Haar;
use squall_formats::section::response::{ResponseHead, Window};

/// Of each finer level its nodes with their rows, nodes rising.
pub(super) fn nodes_of(head: &ResponseHead) -> Vec<Vec<(u32, u32)>> {
    head.finer.iter().map(|level| level.rows_by_node()).collect()
}

/// Adds the rows of finer levels that `light` takes part of, with its share of each. A node without a row has nothing to add.
pub(super) fn split_into(
    (head, nodes): (&ResponseHead, &[Vec<(u32, u32)>]),
    light: &PointLight,
    parts: &mut Vec<(u32, f64)>,
) {
    for (level, rows) in head.finer.iter().zip(nodes) {
        let around = level.grid.split(light.position.to_array()).into_iter().flatten();
        for (node, share) in around.filter(|(_, share)| *share > 0.0) {
            if let Ok(at) = rows.binary_search_by_key(&(node as u32), |&(node, _)| node) {
                parts.push((rows[at].1, share * light.intensity));
            }
        }
    }
}

impl Relighter {
    #[cfg(feature = "gpu")]
    /// Whether there are virtual lights finer than the light grid's.
    pub(crate) fn has_finer(&self) -> bool {
        !self.response().head.finer.is_empty()
    }

    /// Adds the light of rows in windows to planes of cells. `weights` are sorted by row.
    pub(super) fn add_windows(
        &self,
        mut weights: &[SourceWeight],
        (window, scratch): (&mut Vec<f32>, &mut Vec<f32>),
        planes: &mut [f32],
    ) -> Result<(), RuntimeError> {
        let head = &self.response().head;
        let count = head.basis.count();
        for level in &head.finer {
            let mut end = level.first_row;
            for place in &level.windows {
                end += place.rows;
                let (own, rest) = weights.split_at(weights.partition_point(|weight| weight.row < end));
                weights = rest;
                if own.is_empty() {
                    continue;
                }
                let cells = place.shape.len();
                window.clear();
                window.resize(cells * count, 0.0);
                for weight in own {
                    self.add_row(weight, window)?;
                }
                let haar = Haar::new(place.shape);
                let grids = planes.chunks_exact_mut(head.shape.len());
                for (light, plane) in window.chunks_exact_mut(cells).zip(grids) {
                    haar.inverse(light, scratch);
                    add_box(light, place, head.shape.to_array(), plane);
                }
            }
        }
        Ok(())
    }
}

/// Adds a window's cells to a grid's.
fn add_box(light: &[f32], window: &Window, [nx, ny, _]: [usize; 3], plane: &mut [f32]) {
    let [low_x, low_y, low_z] = window.low.map(|cell| cell as usize);
    let [wide, deep, _] = window.shape.to_array();
    for (row, values) in light.chunks_exact(wide).enumerate() {
        let (y, z) = (low_y + row % deep, low_z + row / deep);
        let start = low_x + nx * (y + ny * z);
        plane[start..start + wide].iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
    }
}
