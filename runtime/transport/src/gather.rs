//! Gathers: transport sweeps at run time that bring light which is nearly right closer to what the transport equation asks for.
//!
//! With T streaming and S scattering, light φ is right where φ = T S (φ + φ_direct). A gather puts the right side in the place of φ. What
//! is wrong on a scale of cells, as light that was split over a few virtual lights or solved for in larger cells is, is gone after a sweep
//! or two; what is wrong over many free paths takes many, and is what rows and coarse solves are good at. A solution is left alone.
//! What a sweep changes is the residual of the light before it: an estimate of its error that costs nothing.
//!
//! | symbol | name | unit |
//! | φ | moments ∫ Y_m L dΩ of scattered light | W/m² |
//! | J | in-scattered radiance; J_m = g^l φ_m | W/(m² sr) |

use crate::live::LiveSolver;
use crate::solve::{GATHERED, OneSweep};
use squall_formats::sphere::{MAX_HARMONICS, degree_of};

/// |g| below which light of degree 1 cannot be told from J, and what of it is scattered on is nothing.
const EVEN: f64 = 1e-6;

/// How gathers went.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GatherReport {
    /// Sweeps whose light was taken.
    pub sweeps: u32,
    /// What the last of them changed over what it left, weighted by what is scattered: the residual of the light before it, which is
    /// above that of the light after it.
    pub residual: f64,
    /// A sweep changed more than the one before, or left what is no number: its light was not taken, and no more were done. No medium
    /// that scatters at most what it takes out brings this about, but light that is no light may.
    pub stopped: bool,
}

/// Memory of [`LiveSolver::gather`].
#[derive(Clone, Debug, Default)]
pub struct GatherBuffers {
    light: Vec<[f32; GATHERED]>,
    swept: Vec<[f32; GATHERED]>,
    sweep: OneSweep,
}

impl LiveSolver {
    /// Brings `coefficients`, J's 16 harmonic coefficients a cell of scattered light beyond its direct part, closer to a solution by
    /// `sweeps` sweeps. `direct` holds what [`LiveSolver::solve_moments`] takes.
    ///
    /// The same bytes come out for any number of threads. Panics when an array is not one grid long.
    pub fn gather(
        &self,
        direct: &[[f32; 4]],
        sweeps: u32,
        coefficients: &mut Vec<f32>,
        buffers: &mut GatherBuffers,
    ) -> GatherReport {
        self.take(coefficients, &mut buffers.light);
        self.gather_on(direct, sweeps, coefficients, buffers)
    }

    /// [`LiveSolver::gather`] of light given by the first four of J's coefficients, those of degree 0 and 1 which are all that is scattered on,
    /// a row a solve cell. `coefficients` receives all, and is left as it is where no sweep was taken.
    ///
    /// Panics when an array is not one grid long.
    pub fn gather_from(
        &self,
        (direct, start): (&[[f32; 4]], &[[f32; 4]]),
        sweeps: u32,
        coefficients: &mut Vec<f32>,
        buffers: &mut GatherBuffers,
    ) -> GatherReport {
        assert_eq!(start.len(), self.fine.shape.len());
        let back = self.back();
        buffers.light.clear();
        buffers.light.extend(start.iter().map(|row| moments(row, back)));
        self.gather_on(direct, sweeps, coefficients, buffers)
    }

    /// Sweeps over the light that `buffers` hold.
    fn gather_on(
        &self,
        direct: &[[f32; 4]],
        sweeps: u32,
        coefficients: &mut Vec<f32>,
        buffers: &mut GatherBuffers,
    ) -> GatherReport {
        let GatherBuffers { light, swept, sweep } = buffers;
        let (mut report, mut before) = (GatherReport::default(), f64::INFINITY);
        while report.sweeps < sweeps {
            let norms = self.solver.sweep_once(light, direct, swept, sweep);
            // Written so that what is no number stops it too.
            if !(norms.change.is_finite() && norms.size.is_finite() && norms.change <= before) {
                report.stopped = true;
                break;
            }
            std::mem::swap(light, swept);
            before = norms.change;
            report.sweeps += 1;
            report.residual = if norms.change > 0.0 { norms.change / norms.size } else { 0.0 };
        }
        if report.sweeps > 0 {
            // Cells that nobody reads hold what was left there.
            if let Some(read) = &self.read {
                let hidden = light.iter_mut().zip(read).filter(|(_, read)| !**read);
                hidden.for_each(|(row, _)| *row = [0.0; GATHERED]);
            }
            *coefficients = self.coefficients(light);
        }
        report
    }

    /// Moments of light on the solve grid from J's coefficients on the cloud's.
    fn take(&self, coefficients: &[f32], light: &mut Vec<[f32; GATHERED]>) {
        assert_eq!(coefficients.len(), self.parent.coarse().len() * MAX_HARMONICS);
        let back = self.back();
        let between = self.fit.as_ref().map(|fit| fit.read(coefficients, MAX_HARMONICS));
        let rows = between.as_deref().unwrap_or(coefficients).as_chunks::<MAX_HARMONICS>().0;
        light.clear();
        light.extend(
            (0..self.fine.shape.len()).map(|cell| {
                moments(&rows[if between.is_some() { cell } else { self.parent.of(cell) }], back)
            }),
        );
    }

    /// Moments of light over J's coefficients of degree 0 and 1.
    fn back(&self) -> [f64; 2] {
        let g = self.fine.g;
        [1.0, if g.abs() < EVEN { 0.0 } else { 1.0 / g }]
    }
}

/// Moments of light from J's first coefficients.
fn moments(coefficients: &[f32], back: [f64; 2]) -> [f32; GATHERED] {
    let mut moments = [0.0; GATHERED];
    for m in 0..4 {
        moments[m] = (f64::from(coefficients[m]) * back[degree_of(m)]) as f32;
    }
    moments
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{Boundary, Cloud};
    use crate::light::PointLight;
    use glam::DVec3;
    use squall_formats::GridShape;
    use squall_formats::section::response::{SolverRecord, SweepScheme};

    /// Two blobs of cloud with air between and around.
    fn blobs(albedo: f64, g: f64) -> Cloud {
        let shape = GridShape::new(18, 12, 10);
        let dense = |index: usize| {
            let [x, y, z] = shape.cell(index);
            matches!((x, y, z), (2..=6, 3..=8, 2..=6) | (11..=15, 5..=9, 4..=8))
        };
        let extinction = (0..shape.len()).map(|i| if dense(i) { 0.02 } else { 0.0 }).collect();
        let (cell_m, origin_m) = ([50.0, 60.0, 55.0], DVec3::new(-500.0, 100.0, 900.0));
        Cloud { shape, cell_m, origin_m, extinction, albedo, g, boundary: Boundary::Open }
    }

    fn record(cloud: &Cloud, directions: [u8; 2], refine: u32) -> SolverRecord {
        SolverRecord {
            refine: [refine; 3],
            directions,
            scheme: SweepScheme::Weighted,
            extinction_scale: cloud.scaled(1).extinction_scale,
            tolerance: 1e-5,
            worst_residual: 0.0,
            most_sweeps: 0,
        }
    }

    fn lamp(cloud: &Cloud) -> [PointLight; 1] {
        [PointLight { position: cloud.centre([4, 5, 4]) + DVec3::splat(9.0), intensity: 3.0 }]
    }

    fn norm(values: impl Iterator<Item = f32>) -> f64 {
        values.map(|v| f64::from(v) * f64::from(v)).sum::<f64>().sqrt()
    }

    fn off(found: &[f32], wanted: &[f32], read: &[bool]) -> f64 {
        let each = || (0..found.len()).filter(|i| read[i / MAX_HARMONICS]);
        norm(each().map(|i| found[i] - wanted[i])) / norm(each().map(|i| wanted[i]))
    }

    #[test]
    fn a_solution_is_left_alone_and_any_other_light_comes_closer_with_every_gather() {
        /// The residual that the solve leaves, and single precision.
        const LEFT_ALONE: f64 = 2e-5;
        for (g, albedo) in [(0.85, 0.999), (0.0, 1.0), (-0.3, 0.9)] {
            let cloud = blobs(albedo, g);
            let solver = LiveSolver::new(&cloud, &record(&cloud, [2, 8], 1)).unwrap();
            let direct = solver.direct(&lamp(&cloud), &[], 4);
            let truth = solver.solve(&direct, &mut |_| true).unwrap().coefficients;
            let all = vec![true; cloud.shape.len()];
            let mut buffers = GatherBuffers::default();
            let mut light = truth.clone();
            let report = solver.gather(&direct.moments, 3, &mut light, &mut buffers);
            assert!(report.sweeps == 3 && !report.stopped && report.residual < LEFT_ALONE, "{report:?}");
            assert!(off(&light, &truth, &all) < LEFT_ALONE, "g {g}");
            // From no light at all, one order of scattering a gather.
            let (mut error, mut residual) = (1.0, f64::INFINITY);
            for sweeps in [1, 2, 4, 8] {
                let mut light = vec![0.0; truth.len()];
                let report = solver.gather(&direct.moments, sweeps, &mut light, &mut buffers);
                let now = off(&light, &truth, &all);
                assert!(now < 0.9 * error && report.residual < residual, "g {g}: {now} {report:?}");
                (error, residual) = (now, report.residual);
            }
        }
    }

    #[test]
    fn sweeps_that_step_over_air_gather_and_solve_the_same_bytes_where_light_is_read() {
        let cloud = blobs(0.999, 0.85);
        let read = cloud.shaded();
        for directions in [[2, 8], [0, 26], [0, 50]] {
            let record = record(&cloud, directions, 1);
            let whole = LiveSolver::new(&cloud, &record).unwrap();
            let near = LiveSolver::new(&cloud, &record).unwrap().read_in(&read);
            assert!(near.share_visited() < 0.6, "{}", near.share_visited());
            let direct = whole.direct(&lamp(&cloud), &[], 4);
            let same = |a: &[f32], b: &[f32]| {
                (0..a.len()).all(|i| !read[i / MAX_HARMONICS] || a[i].to_bits() == b[i].to_bits())
            };
            let solved = [&whole, &near].map(|s| s.solve(&direct, &mut |_| true).unwrap().coefficients);
            assert!(same(&solved[0], &solved[1]), "solved by {directions:?}");
            // The same memory twice: nothing of the first light is left in the second.
            let mut memory = [GatherBuffers::default(), GatherBuffers::default()];
            for start in [0.7f32, 0.0] {
                let gathered: Vec<Vec<f32>> = [&whole, &near]
                    .iter()
                    .zip(&mut memory)
                    .map(|(solver, memory)| {
                        let mut light: Vec<f32> = solved[0].iter().map(|v| v * start).collect();
                        solver.gather(&direct.moments, 2, &mut light, memory);
                        light
                    })
                    .collect();
                assert!(same(&gathered[0], &gathered[1]), "gathered by {directions:?}");
                let hidden = (0..gathered[1].len()).filter(|i| !read[i / MAX_HARMONICS]);
                assert!(hidden.into_iter().all(|i| gathered[1][i] == 0.0));
            }
        }
    }

    #[test]
    fn gathers_of_what_is_no_light_stop_and_keep_what_was() {
        let cloud = blobs(1.0, 0.85);
        let solver = LiveSolver::new(&cloud, &record(&cloud, [2, 8], 1)).unwrap();
        let direct = solver.direct(&lamp(&cloud), &[], 2);
        let mut light = vec![0.0; cloud.shape.len() * MAX_HARMONICS];
        let at = cloud.shape.index(4, 5, 4) * MAX_HARMONICS;
        light[at] = f32::NAN;
        let before = light.clone();
        let report = solver.gather(&direct.moments, 3, &mut light, &mut GatherBuffers::default());
        assert_eq!((report.sweeps, report.stopped), (0, true));
        assert!(light.iter().zip(&before).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}
