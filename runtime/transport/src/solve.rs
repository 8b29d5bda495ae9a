//! Multiple scattering by discrete ordinates: which moments of light in every cell agree with the scattering that
//! they cause.
//!
//! | symbol | name |
//! | φ | moments ∫ Y_lm L dΩ of scattered light, cell means |
//! | S | scattering: σ_s χ_l on the moments of degree l, after delta scaling |
//! | T | streaming: one [`super::sweep`] |
//!
//! The equation is φ = T S (φ + φ_direct). Convergence is judged by its residual, never by the change of an
//! iteration, which at optical depth 80 without absorption still hides a fifth of the answer.
//!
//! Reciprocity makes a short solver possible. With z = |S|^½ φ the equation reads (I − K) z = r; and because a sweep
//! along −Ω is the transpose of the sweep along Ω, E(I − K) is symmetric, where E flips the sign of odd moments (and of
//! those with χ_l < 0). So MINRES applies: one sweep an iteration, three past vectors, the smallest residual that any
//! combination of the sweeps so far can give, and nothing that could divide by zero before it has converged. Every lane
//! is an equation of its own and stops on its own, so that a light's bytes do not depend on its neighbours in the batch.

mod minres;
mod one_sweep;
mod passes;

use crate::cloud::Cloud;
use crate::error::ArgumentError;
use crate::lanes::{F32x16, Lanes, SimdLevel, run};
use crate::phase::DeltaM;
use crate::quadrature::Quadrature;
use crate::sweep::{CellCoefficients, Emission, Leak, SweepBuffers, Sweeper};
use minres::Minres;
pub use one_sweep::{OneSweep, SweepNorms};
use passes::{Gather, Residual};
use squall_formats::section::response::SweepScheme;
use squall_formats::sphere::degree_of;

/// Moments of the scattered light that a solution holds: harmonics up to degree 3.
pub const GATHERED: usize = squall_formats::sphere::MAX_HARMONICS;

/// How to solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolveSettings {
    /// Direction set of the sweeps.
    pub quadrature: Quadrature,
    /// How fluxes are carried through cells.
    pub scheme: SweepScheme,
    /// Cut the forward peak off (delta-M). Without it the phase function's raw moments are used.
    pub delta: bool,
    /// Residual, relative to the first scattering's light, at which a light counts as solved.
    pub tolerance: f64,
    /// Sweeps after which the solver gives up.
    pub max_sweeps: u32,
    /// How solutions are come by.
    pub iteration: Iteration,
    /// Instructions to use; all give the same bytes.
    pub level: SimdLevel,
}

/// How a solve goes from sweep to sweep.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Iteration {
    /// MINRES: of all combinations of the sweeps so far that with the smallest residual.
    #[default]
    Minres,
    /// One order of scattering a sweep, as \[dobashi\] sums them: a baseline. What a sweep adds is then the residual, and in
    /// deep clouds without absorption it is small long before the sum is complete.
    Source,
}

impl Default for SolveSettings {
    fn default() -> Self {
        Self {
            quadrature: Quadrature::Lebedev26,
            scheme: SweepScheme::Weighted,
            delta: true,
            tolerance: 1e-3,
            max_sweeps: 2000,
            iteration: Iteration::Minres,
            level: SimdLevel::Best,
        }
    }
}

/// A grid prepared for solving with `M` source moments: 4 for degree 1, 16 for degree 3.
///
/// ```
/// use glam::DVec3;
/// use squall_formats::GridShape;
/// use squall_transport::direct::{DirectField, Tracer};
/// use squall_transport::solve::{SolveBuffers, SolveSettings, Solver};
/// use squall_transport::{Boundary, Cloud, PointLight};
///
/// // A cloud that absorbs nothing around a light of 1 W/sr.
/// let cloud = Cloud {
///     shape: GridShape::new(6, 6, 6),
///     cell_m: [20.0; 3],
///     origin_m: DVec3::splat(-60.0),
///     extinction: vec![0.03; 216],
///     albedo: 1.0,
///     g: 0.5,
///     boundary: Boundary::Open,
/// };
/// let solver = Solver::<4>::new(&cloud, SolveSettings::default())?;
/// let tracer = Tracer::new(&cloud, solver.scaled().extinction_scale);
/// let mut direct = DirectField::<4>::new(&cloud, &[]);
/// let mut straight = 0.0;
/// let light = PointLight { position: DVec3::new(3.0, 1.0, -2.0), intensity: 1.0 };
/// tracer.rays(light.into(), 4, |ray| straight += tracer.trace(ray, &mut direct).1);
///
/// let volume = cloud.cell_volume() as f32;
/// let moments: Vec<[f32; 4]> = direct.moments.iter().map(|row| row.map(|sum| sum / volume)).collect();
/// let (mut scattered, mut buffers) = (Vec::new(), SolveBuffers::default());
/// let mut leak = std::array::from_fn(|_| vec![0.0]);
/// let report = solver.solve::<f32>(&moments, &mut scattered, &mut buffers, Some(&mut leak));
/// assert!(report.lanes[0].converged);
/// // What leaves, straight or scattered, is what the light gives: 4π W.
/// let leaves = straight + leak.iter().flatten().sum::<f64>();
/// assert!((leaves / (4.0 * std::f64::consts::PI) - 1.0).abs() < 0.005, "{leaves} W");
/// # Ok::<(), squall_transport::ArgumentError>(())
/// ```
pub struct Solver<const M: usize> {
    sweeper: Sweeper,
    cells: CellCoefficients,
    scaled: DeltaM,
    /// √|χ_l| by degree: the factor of a result.
    root_moments: [f32; 4],
    /// √|χ_l| with the sign of χ_l: the factor of a source.
    signed_moments: [f32; 4],
    /// Sign of χ_l times (−1)^l, per moment: the matrix E.
    flip: [f32; M],
    settings: SolveSettings,
}

/// Lanes that a solver with `M` source moments is compiled for: here, once, and not again in every crate that solves.
pub trait Solvable<const M: usize>: Lanes {
    /// [`Solver::solve`].
    fn solve_batch(
        solver: &Solver<M>,
        direct: &[[Self; M]],
        gathered: &mut Vec<[Self; GATHERED]>,
        buffers: &mut SolveBuffers<Self, M>,
        leak: Option<&mut Leak>,
    ) -> BatchReport;
}

macro_rules! solvable {
    ($($lanes:ty, $moments:literal;)*) => {$(
        impl Solvable<$moments> for $lanes {
            fn solve_batch(
                solver: &Solver<$moments>,
                direct: &[[Self; $moments]],
                gathered: &mut Vec<[Self; GATHERED]>,
                buffers: &mut SolveBuffers<Self, $moments>,
                leak: Option<&mut Leak>,
            ) -> BatchReport {
                solver.solve_any(direct, gathered, buffers, leak)
            }
        }
    )*};
}

solvable! { f32, 4; f32, 16; F32x16, 4; }

/// How a lane's solve went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaneReport {
    /// ‖T S (φ + φ_direct) − φ‖ over the same of the first scattering, in the norm weighted by √S; recomputed from the
    /// solution itself.
    pub residual: f64,
    /// Whether the residual is at or below the tolerance. Never true of a value that is not a number.
    pub converged: bool,
}

/// How a batch went.
#[derive(Clone, Debug, PartialEq)]
pub struct BatchReport {
    /// Sweeps, the final gather included.
    pub sweeps: u32,
    /// Per lane.
    pub lanes: Vec<LaneReport>,
    /// Sweeps that each lane was at work in, for each time that MINRES was started; they are the lane's own, whatever its neighbours
    /// are. With [`Iteration::Source`] as if it were started once, and one fewer.
    pub steps: Vec<Vec<u32>>,
}

/// Sweeps that lanes with these [`BatchReport::steps`] take side by side.
pub fn sweeps_together<'a>(lanes: impl Iterator<Item = &'a [u32]>) -> u32 {
    let mut longest: Vec<u32> = Vec::new();
    for steps in lanes {
        longest.resize(longest.len().max(steps.len()), 0);
        longest.iter_mut().zip(steps).for_each(|(most, &steps)| *most = steps.max(*most));
    }
    // A residual before each start and behind the last, and the final gather.
    2 + longest.len() as u32 + longest.iter().sum::<u32>()
}

/// Vectors of a solve, kept between batches so that nothing is allocated per batch.
#[derive(Clone, Debug, Default)]
pub struct SolveBuffers<P, const M: usize> {
    faces: SweepBuffers<P>,
    /// |S|^½ times the direct moments.
    direct: Vec<[P; M]>,
    /// |S|^½ times the scattered moments: z.
    solution: Vec<[P; M]>,
    /// Lanczos vectors: the newest, the one before, and what a sweep makes of the newest.
    newest: Vec<[P; M]>,
    before: Vec<[P; M]>,
    swept: Vec<[P; M]>,
    /// Search directions: the newest and the one before.
    search: Vec<[P; M]>,
    search_before: Vec<[P; M]>,
}

impl<const M: usize> Solver<M> {
    /// Degree of the source moments: 1 for 4 of them, 3 for 16.
    pub const DEGREE: usize = degree_of(M - 1);

    /// Prepares `cloud`, whose cells are the solver's.
    ///
    /// Errors: settings outside their ranges.
    pub fn new(cloud: &Cloud, settings: SolveSettings) -> Result<Self, ArgumentError> {
        if settings.tolerance.is_nan() || settings.tolerance <= 0.0 {
            return Err(ArgumentError::new("solver tolerance", "above 0", settings.tolerance));
        }
        let scaled = if settings.delta {
            cloud.scaled(Self::DEGREE)
        } else {
            DeltaM::unscaled(cloud.albedo, cloud.g, Self::DEGREE)
        };
        let sweeper = Sweeper::new(cloud, settings.quadrature, settings.scheme, settings.level)?;
        let scale = scaled.extinction_scale as f32;
        let extinction: Vec<f32> = cloud.extinction.iter().map(|e| e * scale).collect();
        let albedo = scaled.albedo as f32;
        let root_scattering = extinction.iter().map(|e| (e * albedo).sqrt()).collect();
        let sign = |value: f64| if value < 0.0 { -1.0 } else { 1.0 };
        let parity = |degree: usize| if degree % 2 == 1 { -1.0 } else { 1.0 };
        Ok(Self {
            sweeper,
            cells: CellCoefficients { extinction, root_scattering },
            scaled,
            root_moments: scaled.moments.map(|m| m.abs().sqrt() as f32),
            signed_moments: scaled.moments.map(|m| (sign(m) * m.abs().sqrt()) as f32),
            flip: std::array::from_fn(|m| (sign(scaled.moments[degree_of(m)]) * parity(degree_of(m))) as f32),
            settings,
        })
    }

    /// The same solver where only the cells `wanted` are read: [`Sweeper::read_in`]. Cells that neither are read nor lie on the way of
    /// light to such hold no light; the others hold the same bytes. `cloud` is the one that it was made for.
    ///
    /// Panics when `wanted` is not one grid long.
    #[must_use]
    pub fn read_in(self, cloud: &Cloud, wanted: &[bool]) -> Self {
        Self { sweeper: self.sweeper.read_in(cloud, wanted), ..self }
    }

    /// Share of all cells that a sweep visits, 0 to 1.
    pub fn share_visited(&self) -> f64 {
        self.sweeper.share_visited()
    }

    /// The delta scaling in use.
    pub fn scaled(&self) -> DeltaM {
        self.scaled
    }

    /// Solves for the light that the direct light scatters, any number of times.
    ///
    /// `direct` holds moments ∫ Y_m L dΩ of light unscattered in the scaled medium, mean per cell: see
    /// [`super::direct::DirectField::moments`]. `gathered` receives the same moments of scattered light, up to degree 3.
    /// A lane that does not converge is reported so and holds its best iterate. `leak`, if given, is added the scattered
    /// light that leaves the grid, W.
    ///
    /// Panics when `direct` is not one grid long.
    pub fn solve<P: Solvable<M>>(
        &self,
        direct: &[[P; M]],
        gathered: &mut Vec<[P; GATHERED]>,
        buffers: &mut SolveBuffers<P, M>,
        leak: Option<&mut Leak>,
    ) -> BatchReport {
        P::solve_batch(self, direct, gathered, buffers, leak)
    }

    fn solve_any<P: Lanes>(
        &self,
        direct: &[[P; M]],
        gathered: &mut Vec<[P; GATHERED]>,
        buffers: &mut SolveBuffers<P, M>,
        leak: Option<&mut Leak>,
    ) -> BatchReport {
        self.solve_watched(direct, gathered, buffers, leak, &mut |_| true)
    }

    /// [`Solver::solve`] for those who want to see it come closer, or to stop it: `watch` is told after each sweep the
    /// largest residual over its goal among the lanes still at work, and ends the solve with `false`. The lanes then hold
    /// what they had reached.
    pub fn solve_watched<P: Lanes>(
        &self,
        direct: &[[P; M]],
        gathered: &mut Vec<[P; GATHERED]>,
        buffers: &mut SolveBuffers<P, M>,
        leak: Option<&mut Leak>,
        watch: &mut dyn FnMut(f64) -> bool,
    ) -> BatchReport {
        let count = self.cells.extinction.len();
        assert_eq!(direct.len(), count);
        buffers.reset(count);
        let units = units(direct);
        self.take_direct(direct, &units, buffers);
        let mut sweeps = 0;
        let mut steps = vec![Vec::new(); P::COUNT];
        let mut scale: Option<Vec<f64>> = None;
        loop {
            let residual = run(self.settings.level, Residual { solver: self, buffers });
            sweeps += 1;
            let scale = scale.get_or_insert_with(|| residual.clone());
            let goals: Vec<f64> = scale.iter().map(|s| s * self.settings.tolerance).collect();
            let done = residual.iter().zip(&goals).all(|(r, goal)| r <= goal);
            // The gather below is a sweep too; another round needs two at least.
            let budget = self.settings.max_sweeps.saturating_sub(sweeps + 2);
            if done || budget == 0 {
                break;
            }
            let mut stopped = false;
            let mut seen = |over: f64| {
                stopped |= !watch(over);
                !stopped
            };
            let watch: &mut dyn FnMut(f64) -> bool = &mut seen;
            if self.settings.iteration == Iteration::Source {
                self.add_order(buffers, &residual, &goals);
                for (lane, steps) in steps.iter_mut().enumerate() {
                    if residual[lane] > goals[lane] && residual[lane].is_finite() {
                        match steps.first_mut() {
                            Some(orders) => *orders += 1,
                            None => steps.push(0),
                        }
                    }
                }
                if !watch(worst_over(&residual, &goals)) {
                    break;
                }
                continue;
            }
            let round = Minres { solver: self, buffers, residual: &residual, goals: &goals, budget, watch };
            let worked = run(self.settings.level, round);
            let used = worked.iter().copied().max().unwrap_or(0);
            steps.iter_mut().zip(worked).for_each(|(steps, own)| steps.extend((own > 0).then_some(own)));
            sweeps += used;
            if used == 0 || stopped {
                break;
            }
        }
        gathered.clear();
        gathered.resize(count, [P::splat(0.0); GATHERED]);
        let mut own: Leak = std::array::from_fn(|_| vec![0.0; P::COUNT]);
        let counted = if leak.is_some() { Some(&mut own) } else { None };
        let left = run(self.settings.level, Gather { solver: self, buffers, gathered, leak: counted });
        if let Some(leak) = leak {
            for (sums, own) in leak.iter_mut().zip(&own) {
                for lane in 0..P::COUNT {
                    sums[lane] += own[lane] / f64::from(units[lane]);
                }
            }
        }
        if units[..P::COUNT].iter().any(|&unit| unit != 1.0) {
            for value in gathered.as_flattened_mut() {
                *value = P::from_fn(|lane| value.lane(lane) / units[lane]);
            }
        }
        let lanes = left.iter().zip(scale.unwrap_or_default()).map(|(&left, scale)| {
            let residual = if scale == 0.0 { 0.0 } else { left / scale };
            LaneReport { residual, converged: residual <= self.settings.tolerance }
        });
        BatchReport { sweeps: sweeps + 1, lanes: lanes.collect(), steps }
    }

    /// Direct light into the solver's own units and form.
    fn take_direct<P: Lanes>(&self, direct: &[[P; M]], units: &[f32], buffers: &mut SolveBuffers<P, M>) {
        for (cell, (to, from)) in buffers.direct.iter_mut().zip(direct).enumerate() {
            let root = self.root(cell);
            for m in 0..M {
                to[m] = P::from_fn(|lane| from[m].lane(lane) * units[lane] * root[m]);
            }
        }
    }

    /// Adds the order of scattering that `newest` holds, E times over, to the lanes that are above their goals.
    fn add_order<P: Lanes>(&self, buffers: &mut SolveBuffers<P, M>, residual: &[f64], goals: &[f64]) {
        let unfinished = |lane: usize| residual[lane] > goals[lane] && residual[lane].is_finite();
        for (z, order) in buffers.solution.iter_mut().zip(&buffers.newest) {
            for m in 0..M {
                let add = |lane| if unfinished(lane) { order[m].lane(lane) * self.flip[m] } else { 0.0 };
                z[m] = P::from_fn(|lane| z[m].lane(lane) + add(lane));
            }
        }
    }

    /// What a sweep of `source` starts from.
    fn emission<'a, P>(&'a self, source: &'a [[P; M]]) -> Emission<'a, P, M> {
        Emission { cells: &self.cells, root_moments: self.signed_moments, source }
    }

    /// |S|^½ of a cell, per moment.
    #[inline(always)]
    fn root(&self, cell: usize) -> [f32; M] {
        let root = self.cells.root_scattering[cell];
        std::array::from_fn(|m| root * self.root_moments[degree_of(m)])
    }
}

/// Light within these bounds is solved for as it is: neither it nor its square leaves the range of single precision, after a
/// fall by many powers of ten.
const DIM: f32 = 1e-9;
const BRIGHT: f32 = 1e9;

/// Per lane, the power of two by which its light is multiplied while it is solved for: norms are sums of squares, and those of
/// a very dim light are zero, as if there were nothing left to solve. 1 within [`DIM`] to [`BRIGHT`]; exact in every case.
fn units<P: Lanes, const M: usize>(direct: &[[P; M]]) -> [f32; 16] {
    let mut units = [1.0; 16];
    for (lane, unit) in units.iter_mut().enumerate().take(P::COUNT) {
        let largest =
            direct.as_flattened().iter().fold(0.0f32, |most, value| most.max(value.lane(lane).abs()));
        if largest > 0.0 && largest.is_finite() && !(DIM..=BRIGHT).contains(&largest) {
            // 2^−exponent, within the range of normal numbers.
            let exponent = ((largest.to_bits() >> 23) as i32 - 127).clamp(-126, 126);
            *unit = f32::from_bits(((127 - exponent) as u32) << 23);
        }
    }
    units
}

/// The largest residual over its goal.
fn worst_over(residual: &[f64], goals: &[f64]) -> f64 {
    residual.iter().zip(goals).map(|(r, goal)| if r > goal { r / goal } else { 0.0 }).fold(0.0, f64::max)
}

impl<P: Lanes, const M: usize> SolveBuffers<P, M> {
    fn reset(&mut self, count: usize) {
        let zero = [P::splat(0.0); M];
        for vector in [
            &mut self.direct,
            &mut self.solution,
            &mut self.newest,
            &mut self.before,
            &mut self.swept,
            &mut self.search,
            &mut self.search_before,
        ] {
            vector.clear();
            vector.resize(count, zero);
        }
    }
}
