//! A whole period of cellular noise at once: the points of its cells are hashed once, and a register holds neighbouring places.

use super::{Lattice, tenth};
use crate::parallel::prelude::*;
use glam::Vec3;

impl Lattice {
    /// [`Lattice::cells`] at every place of one period, `EDGE` to a cell along each axis, x fastest; this lattice repeats after 2^`bits`
    /// cells. The same numbers: sums of squares of these places' and points' binary fractions have no round-off.
    pub(crate) fn cells_of_a_period<const EDGE: usize>(&self, bits: u8) -> Vec<f32> {
        let count = 1usize << bits;
        let side = count * EDGE;
        let point = |at: usize| {
            let hash =
                self.hash((at % count) as i32, (at / count % count) as i32, (at / (count * count)) as i32);
            Vec3::new(tenth(hash, 0), tenth(hash, 10), tenth(hash, 20))
        };
        let points: Vec<Vec3> = (0..count * count * count).map(point).collect();
        let share = |at: usize| (at % EDGE) as f32 / EDGE as f32;
        let mut table = vec![0.0; side * side * side];
        table.par_chunks_mut(side).enumerate().for_each(|(row, values)| {
            let (y, z) = (row % side, row / side);
            // The cells before, at and behind this row's along one axis.
            let around = |at: usize| [at + count - 1, at, at + 1].map(|at| at % count);
            let off = |step: usize| step as f32 - 1.0;
            for (x, values) in values.as_chunks_mut::<EDGE>().0.iter_mut().enumerate() {
                let mut nearest = [f32::MAX; EDGE];
                for (k, z_cell) in around(z / EDGE).into_iter().enumerate() {
                    for (j, y_cell) in around(y / EDGE).into_iter().enumerate() {
                        for (i, x_cell) in around(x).into_iter().enumerate() {
                            let point = points[(z_cell * count + y_cell) * count + x_cell];
                            let way = point + Vec3::new(off(i), off(j), off(k))
                                - Vec3::new(0.0, share(y), share(z));
                            let beside = way.y * way.y + way.z * way.z;
                            for (at, nearest) in nearest.iter_mut().enumerate() {
                                let along = way.x - at as f32 / EDGE as f32;
                                let squared = along * along + beside;
                                *nearest = if squared < *nearest { squared } else { *nearest };
                            }
                        }
                    }
                }
                *values = nearest.map(f32::sqrt);
            }
        });
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_period_at_once_is_what_each_place_has() {
        let lattice = Lattice::periodic(7, 2);
        for (at, found) in lattice.cells_of_a_period::<8>(2).into_iter().enumerate() {
            let place = [at % 32, at / 32 % 32, at / 1024].map(|v| v as f32 / 8.0);
            assert_eq!(found, lattice.cells(Vec3::from_array(place)), "{place:?}");
        }
    }
}
