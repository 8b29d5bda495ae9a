//! Finer levels of a light grid: rows of surplus light, each in a window of cells.
//!
//! A row of a finer level is the answer to a virtual light less the mix of coarser ones that stands for it. It falls off within some
//! hundred metres, so it is held in a box of cells around its node alone.

use super::head::{NO_ROW, ResponseHead, TAG, invalid};
use crate::error::{Limits, ReadError};
use crate::grid::GridShape;
use crate::light_grid::LightGrid;
use serde::{Deserialize, Serialize};

/// Most levels: each halves the distance between virtual lights.
pub const MOST_LEVELS: usize = 8;

/// A level of virtual lights between those of the light grid and of the levels before.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FinerLevel {
    /// Where nodes stand. A light is split over those around it as over the light grid's; nodes without a row take no part.
    pub grid: LightGrid,
    /// Number of its first row; the others follow, window by window.
    pub first_row: u32,
    /// Boxes of cells that rows hold light in.
    pub windows: Vec<Window>,
    /// Node of each row.
    pub nodes: Vec<u32>,
}

/// A box of cells, and how many rows hold light in it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Window {
    /// Its first cell along x, y, z.
    pub low: [u32; 3],
    /// How many cells it has.
    pub shape: GridShape,
    /// Number of its rows.
    pub rows: u32,
}

impl FinerLevel {
    /// Nodes with their rows, nodes rising.
    pub fn rows_by_node(&self) -> Vec<(u32, u32)> {
        let mut rows: Vec<(u32, u32)> = self.nodes.iter().copied().zip(self.first_row..).collect();
        rows.sort_unstable();
        rows
    }

    /// The window of each row, in row order.
    pub fn windows_of_rows(&self) -> impl Iterator<Item = &Window> {
        self.windows.iter().flat_map(|window| std::iter::repeat_n(window, window.rows as usize))
    }
}

impl ResponseHead {
    /// Number of cells that row `row` holds light in.
    pub fn row_cells(&self, row: u32) -> usize {
        self.window_of(row).map_or(self.shape.len(), |window| window.shape.len())
    }

    /// The window of row `row`; `None` of one that holds light in all cells.
    pub fn window_of(&self, row: u32) -> Option<&Window> {
        self.finer.iter().find_map(|level| {
            let mut place = row.checked_sub(level.first_row)?;
            level.windows.iter().find(|window| {
                let own = place < window.rows;
                place = place.wrapping_sub(window.rows);
                own
            })
        })
    }

    /// Finer levels: their grids, windows and nodes; the number of their rows.
    pub(super) fn check_finer(&self, limits: &Limits, first: usize) -> Result<usize, ReadError> {
        if self.finer.len() > MOST_LEVELS {
            return Err(invalid(None, "finer levels", "at most 8", self.finer.len().to_string()));
        }
        let mut rows = first;
        for level in &self.finer {
            let nodes = super::head::check_axes(&level.grid)?;
            let wanted = nodes.max(rows as u64 + level.nodes.len() as u64);
            if wanted > limits.sources {
                let allowed = limits.sources;
                return Err(ReadError::OverLimit { section: TAG, field: "virtual sources", wanted, allowed });
            }
            if level.first_row as usize != rows {
                let found = format!("{} for {rows}", level.first_row);
                return Err(invalid(None, "first row of a finer level", "behind all rows before it", found));
            }
            let held: u64 = level.windows.iter().map(|window| u64::from(window.rows)).sum();
            if held != level.nodes.len() as u64 {
                let found = format!("{held} for {}", level.nodes.len());
                return Err(invalid(None, "rows of windows", "one a node of the finer level", found));
            }
            level.windows.iter().try_for_each(|window| self.check_window(window))?;
            let mut named = vec![false; nodes as usize];
            for &node in &level.nodes {
                match named.get_mut(node as usize) {
                    Some(slot) if !*slot && node != NO_ROW => *slot = true,
                    _ => {
                        return Err(invalid(
                            None,
                            "nodes of a finer level",
                            "each node once",
                            node.to_string(),
                        ));
                    }
                }
            }
            rows += level.nodes.len();
        }
        Ok(rows - first)
    }

    fn check_window(&self, window: &Window) -> Result<(), ReadError> {
        let (size, counts) = (self.shape.to_array(), window.shape.to_array());
        let inside = |axis: usize| {
            counts[axis] >= 1 && (window.low[axis] as usize).saturating_add(counts[axis]) <= size[axis]
        };
        if (0..3).all(inside) && window.rows > 0 {
            return Ok(());
        }
        let wanted = "cells of the grid, with rows";
        Err(invalid(None, "window of a finer level", wanted, format!("{window:?}")))
    }
}
