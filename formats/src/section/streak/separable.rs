//! Products of a table across and a table along: Σ A_k(u) · B_k(v).

use super::packing::{Cursor, invalid, nearest};
use crate::error::ReadError;

/// Largest number of products.
const MAX_RANK: usize = 8;

/// Tables of equal length per axis, values at the middles of equal cells, linear between them, constant in
/// the outer half cells, zero outside the picture. Stored in 8 bits, each table with its own two ends.
#[derive(Clone, Debug, PartialEq)]
pub struct SeparablePattern {
    /// A_k: `rank` tables across.
    pub across: Vec<Vec<f64>>,
    /// B_k: `rank` tables along.
    pub along: Vec<Vec<f64>>,
}

impl SeparablePattern {
    /// Number of products.
    pub fn rank(&self) -> usize {
        self.across.len()
    }

    /// Light at (u, v).
    pub fn value(&self, u: f64, v: f64) -> f64 {
        if !((0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v)) {
            return 0.0;
        }
        (0..self.rank()).map(|k| self.across_at(k, u) * self.along_at(k, v)).sum()
    }

    /// A_k at `u` in [0, 1].
    pub fn across_at(&self, k: usize, u: f64) -> f64 {
        interpolate(&self.across[k], u)
    }

    /// B_k at `v` in [0, 1].
    pub fn along_at(&self, k: usize, v: f64) -> f64 {
        interpolate(&self.along[k], v)
    }

    pub(super) fn read(rank: usize, pool: &mut Cursor) -> Result<Self, ReadError> {
        if rank == 0 || rank > MAX_RANK {
            return Err(invalid("products of tables", "1 to 8", rank));
        }
        let counts = [usize::from(pool.u8()?), usize::from(pool.u8()?)];
        if counts.contains(&0) {
            return Err(invalid("table length", "1 to 255", format!("{counts:?}")));
        }
        let mut table = |count: usize| {
            let (low, high) = (pool.finite("table's low end")?, pool.finite("table's high end")?);
            if !(low.abs() <= 1e6 && high.abs() <= 1e6) {
                return Err(invalid("table's ends", "-1e6 to 1e6", format!("{low}, {high}")));
            }
            let step = (high - low) / 255.0;
            Ok(pool.take(count)?.iter().map(|&code| low + f64::from(code) * step).collect())
        };
        let across = (0..rank).map(|_| table(counts[0])).collect::<Result<_, _>>()?;
        let along = (0..rank).map(|_| table(counts[1])).collect::<Result<_, _>>()?;
        Ok(Self { across, along })
    }

    pub(super) fn write(&self, pool: &mut Vec<u8>) {
        let count = |tables: &[Vec<f64>]| tables.first().map_or(0, |table| table.len().min(255));
        let counts = [count(&self.across), count(&self.along)];
        pool.extend(counts.map(|count| count as u8));
        let tables =
            self.across.iter().map(|t| (t, counts[0])).chain(self.along.iter().map(|t| (t, counts[1])));
        for (table, count) in tables {
            // The ends are rounded first, so that codes refer to the ends as they are read back.
            let low = f64::from(table.iter().copied().fold(f64::INFINITY, f64::min) as f32);
            let high = f64::from(table.iter().copied().fold(f64::NEG_INFINITY, f64::max) as f32);
            pool.extend((low as f32).to_le_bytes());
            pool.extend((high as f32).to_le_bytes());
            let step = if high > low { (high - low) / 255.0 } else { 1.0 };
            let code =
                |index: usize| nearest((table.get(index).copied().unwrap_or(low) - low) / step, 0, 255);
            pool.extend((0..count).map(|index| code(index) as u8));
        }
    }
}

/// Value of a table at `x` in [0, 1].
fn interpolate(table: &[f64], x: f64) -> f64 {
    let place = (x * table.len() as f64 - 0.5).clamp(0.0, (table.len() - 1) as f64);
    let index = (place as usize).min(table.len().saturating_sub(2));
    let next = (index + 1).min(table.len() - 1);
    let share = place - index as f64;
    table[index] + (table[next] - table[index]) * share
}
