//! Light of point sources and beams in a cloud grid, scattered any number of times: the slow truth behind the tables.
//!
//! The solve grid cuts every cell of the scene into `refine`³ equal parts that inherit its extinction; results are plain
//! means over the scene's own cells. Direct light is traced exactly, the rest swept (squall_runtime::transport). What comes
//! of it on the reference scenes, and the defaults' reasons, are in docs/transport.md.
//!
//! | symbol | name | unit |
//! | φ | fluence rate ∫ L dΩ | W/m² |
//! | J | in-scattered radiance ([`squall_formats::basis`]) towards a camera | W/(m² sr) |

pub mod image;

use crate::error::BakeError;
use crate::progress::Progress;
use glam::DVec3;
use squall_formats::sphere::{MAX_HARMONICS, degree_of, harmonics};
use squall_runtime::RuntimeError;
use squall_runtime::transport::cloud::CoarseIndex;
use squall_runtime::transport::direct::{DirectField, Light, Tracer};
use squall_runtime::transport::lanes::SimdLevel;
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::{BatchReport, Solvable, SolveBuffers, SolveSettings, Solver};
use squall_runtime::transport::sweep::Leak;
use squall_runtime::transport::{Boundary, Cloud};

/// How finely to solve.
#[derive(Clone, Copy, Debug)]
pub struct TruthSettings {
    /// Every cell is cut into this many parts along each axis; 0 leaves it to [`automatic_refinement`].
    pub refine: u32,
    /// Rays per boundary face of the solve grid and axis, for direct light; 0 leaves it to [`automatic_samples`].
    pub samples: u32,
    /// Sources of degree 3 in place of 1: slower, for sharp phase functions.
    pub high_degree: bool,
    /// The sweeps.
    pub solve: SolveSettings,
}

impl Default for TruthSettings {
    fn default() -> Self {
        Self {
            refine: 0,
            samples: 0,
            high_degree: true,
            solve: SolveSettings {
                quadrature: Quadrature::DoubleGauss { polar: 4, azimuths: 16 },
                tolerance: 1e-4,
                level: SimdLevel::Best,
                ..SolveSettings::default()
            },
        }
    }
}

/// Optical depth of a solve cell, after delta scaling and along its longest edge, that automatic refinement aims at: the
/// reference scenes' fields and pictures then come out within a few per cent (docs/transport.md).
const SUB_CELL_DEPTH: f64 = 0.3;
/// Deepest solve cell, after delta scaling and along its SHORTEST edge, that automatic refinement puts up with: the light that
/// a deep slab without absorption lets through is then half too much (docs/stability.md), and more beyond.
const DEEPEST_SUB_CELL: f64 = 2.0;
/// Share of the light that may be missing from a solve's energy balance, or be too much in it, beside ten times its tolerance.
const BALANCE: f64 = 0.01;
/// Least automatic refinement: at 1 a lamp's brightest light is averaged over its cell, and at 2 a lamp in the middle of a cell
/// stands on the corner of eight sub-cells, which is no better.
const LEAST_REFINEMENT: u32 = 3;
/// Most automatic refinement.
const MOST_REFINEMENT: u32 = 8;
/// Most solve cells that automatic refinement makes of a grid: some 1.5 GB and a few minutes.
const AUTOMATIC_CELLS: usize = 1 << 21;

/// Refinement for a cloud that nobody chose one for: the least from 3 to 8 whose densest sub-cell is at most .3 deep after
/// delta scaling (degree 3), or the largest below it that makes at most 2²¹ sub-cells; 1 where even 3 would make more.
pub fn automatic_refinement(cloud: &Cloud) -> u32 {
    let densest = cloud.extinction.iter().fold(0.0f32, |most, &e| most.max(e));
    let edge = cloud.cell_m.iter().fold(0.0f64, |most, &e| most.max(e));
    let depth = f64::from(densest) * edge * cloud.scaled(3).extinction_scale;
    let wanted = (depth / SUB_CELL_DEPTH).ceil().clamp(1.0, f64::from(MOST_REFINEMENT)) as u32;
    let fits = |&refine: &u32| cloud.shape.len() * (refine * refine * refine) as usize <= AUTOMATIC_CELLS;
    (LEAST_REFINEMENT..=wanted.max(LEAST_REFINEMENT)).rev().find(fits).unwrap_or(1)
}

/// Optical depth of the densest solve cell along its shortest edge when each is cut into `refine` parts, after delta scaling
/// (degree 3).
fn sub_cell_depth(cloud: &Cloud, refine: u32) -> f64 {
    let densest = cloud.extinction.iter().fold(0.0f32, |most, &e| most.max(e));
    let edge = cloud.cell_m.iter().fold(f64::INFINITY, |least, &e| least.min(e));
    f64::from(densest) * edge * cloud.scaled(3).extinction_scale / f64::from(refine)
}

/// Rays for direct light, per boundary face of a solve grid and axis, where nobody chose: at least 2, and 8 to a face of the
/// scene's own cells. A lamp far outside lights a cell through its face alone, by nearly parallel rays: 1, 2, 4 and 8 of them an
/// edge leave 28, 14, 6 and 2 % in cells' never scattered light, a quarter of that in scattered light.
pub fn automatic_samples(refine: u32) -> u32 {
    8u32.div_ceil(refine).max(2)
}

/// Everything that one light does in a cloud, on the solve grid.
#[derive(Clone, Debug)]
pub struct Truth {
    /// The scene's own grid.
    pub cloud: Cloud,
    /// The solve grid.
    pub fine: Cloud,
    /// From the solve grid back to the scene's cells.
    pub parent: CoarseIndex,
    /// Never scattered fluence rate, mean per solve cell.
    pub unscattered: Vec<f32>,
    /// Fluence rate of what the delta-scaled medium counts as unscattered.
    pub scaled: Vec<f32>,
    /// ∫ p L dΩ of all direct light towards each asked direction, directions innermost.
    pub direct_towards: Vec<f32>,
    /// Harmonic moments of the rest.
    pub moments: Vec<[f32; MAX_HARMONICS]>,
    /// Extinction scale 1 − ωf.
    pub extinction_scale: f64,
    /// The light solved for.
    pub light: Light,
    /// Parts that every cell was cut into along each axis.
    pub refine: u32,
    /// How it went.
    pub report: TruthReport,
}

/// How a solve went, and where the energy is.
#[derive(Clone, Debug, serde::Serialize)]
pub struct TruthReport {
    /// Final residual of the transport equation, relative to the first scattering.
    pub residual: f64,
    /// Sweeps through the grid.
    pub sweeps: u32,
    /// Power that meets the grid, W.
    pub power_in_w: f64,
    /// Power absorbed in the grid, W.
    pub absorbed_w: f64,
    /// Power leaving by −x, +x, −y, +y, −z, +z, scattered, W.
    pub scattered_out_w: [f64; 6],
    /// Power leaving unscattered (in the delta-scaled medium), W.
    pub direct_out_w: f64,
    /// (absorbed + leaving) / in − 1.
    pub energy_balance: f64,
    /// Optical depth of the densest solve cell, after delta scaling and along its shortest edge: what deep parts let through is
    /// right from .3 down, and a tenth too much at 1.
    pub deepest_cell: f64,
}

/// Solves for one light.
///
/// Light that the delta-scaled medium counts as unscattered, but was scattered forward, scatters on by the phase
/// function's convolution with itself; the rest by the Legendre series of its moments up to degree 3. Towards each
/// of `directions` (unit vectors of travel) the direct part of J is collected ray by ray.
///
/// Errors: settings out of range, a light that no ray can stand for, cells too deep for automatic refinement, a residual above
/// the tolerance after the allowed sweeps, light that gets lost or is made on the way, an interruption.
pub fn solve_light(
    cloud: &Cloud,
    light: Light,
    directions: &[DVec3],
    settings: &TruthSettings,
    progress: &dyn Progress,
) -> Result<Truth, BakeError> {
    if let (Light::Beam { direction, .. }, Boundary::PeriodicXy) = (light, cloud.boundary)
        && direction.z.abs() < LEAST_SLOPE
    {
        let wanted = "a beam that comes down or up through a grid without sides";
        return Err(RuntimeError::argument("beam direction", wanted, direction).into());
    }
    if settings.high_degree {
        solve_with_degree::<MAX_HARMONICS>(cloud, light, directions, settings, progress)
    } else {
        solve_with_degree::<4>(cloud, light, directions, settings, progress)
    }
}

/// |cosine| to the vertical below which a beam through a grid without sides is as good as horizontal: it would pass hundreds
/// of grid widths before it leaves.
const LEAST_SLOPE: f64 = 1e-3;

fn solve_with_degree<const M: usize>(
    cloud: &Cloud,
    light: Light,
    directions: &[DVec3],
    settings: &TruthSettings,
    progress: &dyn Progress,
) -> Result<Truth, BakeError>
where
    f32: Solvable<M>,
{
    let (refine, depth) = checked_refinement::<M>(cloud, settings)?;
    let factors = [refine; 3];
    let fine = cloud.refined(factors)?;
    let solver = Solver::<M>::new(&fine, settings.solve)?;
    let scaled = solver.scaled();
    let samples = if settings.samples == 0 { automatic_samples(refine) } else { settings.samples };
    let tracer = Tracer::new(&fine, scaled.extinction_scale);
    let (direct, power) = trace_light::<M>(&tracer, &fine, light, samples, directions, progress)?;
    let volume = fine.cell_volume() as f32;
    let mean = |sum: f32| sum / volume;
    let sources: Vec<[f32; M]> = direct.moments.iter().map(|row| row.map(mean)).collect();
    let (moments, leak, solved) = solve_scattered(&solver, &sources, settings.solve.tolerance, progress)?;
    let y0 = harmonics([0.0, 0.0, 1.0])[0];
    let absorption = scaled.extinction_scale * (1.0 - scaled.albedo);
    let absorbed: f64 = (0..fine.shape.len())
        .map(|cell| {
            let fluence = (f64::from(sources[cell][0]) + f64::from(moments[cell][0])) / y0;
            absorption * f64::from(fine.extinction[cell]) * fluence * f64::from(volume)
        })
        .sum();
    let scattered_out: [f64; 6] = std::array::from_fn(|side| leak[side][0]);
    let energy_balance = balance(power, absorbed, scattered_out, settings.solve.tolerance)?;
    Ok(Truth {
        cloud: cloud.clone(),
        parent: CoarseIndex::new(fine.shape, factors),
        unscattered: direct.fluence.iter().map(|&v| mean(v)).collect(),
        scaled: sources.iter().map(|row| row[0] / y0 as f32).collect(),
        direct_towards: direct.towards.iter().map(|&v| mean(v)).collect(),
        moments,
        extinction_scale: scaled.extinction_scale,
        light,
        refine,
        report: TruthReport {
            residual: solved.lanes[0].residual,
            sweeps: solved.sweeps,
            power_in_w: power.entered,
            absorbed_w: absorbed,
            scattered_out_w: scattered_out,
            direct_out_w: power.passed,
            energy_balance,
            deepest_cell: depth,
        },
        fine,
    })
}

/// The refinement asked for, or the automatic one, and the depth of its deepest sub-cell.
///
/// Errors: sub-cells too deep to be solved rightly, or more than memory has room for.
fn checked_refinement<const M: usize>(
    cloud: &Cloud,
    settings: &TruthSettings,
) -> Result<(u32, f64), BakeError> {
    let refine = if settings.refine == 0 { automatic_refinement(cloud) } else { settings.refine };
    let depth = sub_cell_depth(cloud, refine);
    if settings.refine == 0 && depth > DEEPEST_SUB_CELL {
        let wanted = format!(
            "solve cells at most {DEEPEST_SUB_CELL} deep after delta scaling, which takes cells of the scene {:.1} times \
             smaller; --refine {refine} solves as they are, with fluxes through deep parts too large",
            depth / DEEPEST_SUB_CELL
        );
        return Err(RuntimeError::argument("optical depth of a cell", wanted, format!("{depth:.3}")).into());
    }
    let most = MAX_SOLVE_BYTES / (9 * M * size_of::<f32>());
    let cells = (0..3).try_fold(cloud.shape.len(), |cells, _| cells.checked_mul(refine as usize));
    if cells.is_none_or(|cells| cells > most) {
        let found = format!("{} × {refine}³", cloud.shape.len());
        return Err(RuntimeError::argument("solve grid", format!("at most {most} cells"), found).into());
    }
    Ok((refine, depth))
}

/// Power of direct light, W.
#[derive(Clone, Copy)]
struct DirectPower {
    /// What enters the grid.
    entered: f64,
    /// What leaves it without having been scattered.
    passed: f64,
}

/// Direct light in every solve cell.
///
/// Errors: an interruption.
fn trace_light<const M: usize>(
    tracer: &Tracer<'_>,
    fine: &Cloud,
    light: Light,
    samples: u32,
    directions: &[DVec3],
    progress: &dyn Progress,
) -> Result<(DirectField<M>, DirectPower), BakeError> {
    let mut direct = DirectField::<M>::new(fine, directions);
    let mut power = DirectPower { entered: 0.0, passed: 0.0 };
    progress.begin("direct light", 1);
    let (mut rays, mut stopped) = (0u64, false);
    tracer.rays(light, samples, |ray| {
        rays += 1;
        // Asking for every ray would cost as much as a short one.
        stopped = stopped || rays % 1024 == 0 && progress.interrupted();
        if stopped {
            return;
        }
        power.entered += ray.power;
        let (_, left) = tracer.trace(ray, &mut direct);
        power.passed += left;
    });
    progress.check()?;
    Ok((direct, power))
}

/// Moments of scattered light a cell, what leaks through the sides, and how the solve went.
type Scattered = (Vec<[f32; MAX_HARMONICS]>, Leak, BatchReport);

/// Solves for what `sources` scatter.
///
/// Errors: a solve that does not converge, an interruption.
fn solve_scattered<const M: usize>(
    solver: &Solver<M>,
    sources: &[[f32; M]],
    tolerance: f64,
    progress: &dyn Progress,
) -> Result<Scattered, BakeError>
where
    f32: Solvable<M>,
{
    let mut leak: Leak = std::array::from_fn(|_| vec![0.0]);
    let mut moments = Vec::new();
    let mut buffers = SolveBuffers::default();
    progress.begin("scattered light", STEPS);
    let mut shown = 0;
    let mut watch = |over: f64| {
        // Residuals fall about as fast in every sweep, on a logarithmic scale.
        let left = (libm::log(over.max(1.0)) / libm::log(1.0 / tolerance.min(0.5))).clamp(0.0, 1.0);
        let step = ((1.0 - left) * STEPS as f64) as u64;
        progress.advance(step.saturating_sub(shown));
        shown = shown.max(step);
        !progress.interrupted()
    };
    let report =
        solver.solve_watched::<f32>(sources, &mut moments, &mut buffers, Some(&mut leak), &mut watch);
    progress.check()?;
    let lane = report.lanes[0];
    if !lane.converged {
        return Err(BakeError::NotReached {
            what: "transport solve".into(),
            wanted: format!("residual {tolerance:e}"),
            reached: format!("{:e} after {} sweeps", lane.residual, report.sweeps),
            hint: "a larger --max-sweeps or --tolerance helps".into(),
        });
    }
    Ok((moments, leak, report))
}

/// How far what leaves and is absorbed is off what entered, relative to that.
///
/// Errors: too far for the tolerance of the solve.
fn balance(
    power: DirectPower,
    absorbed: f64,
    scattered_out: [f64; 6],
    tolerance: f64,
) -> Result<f64, BakeError> {
    let out = absorbed + power.passed + scattered_out.iter().sum::<f64>();
    let balance = if power.entered > 0.0 { out / power.entered - 1.0 } else { 0.0 };
    let allowed = BALANCE + 10.0 * tolerance;
    if balance.is_nan() || balance.abs() > allowed {
        return Err(BakeError::NotReached {
            what: "transport solve".into(),
            wanted: format!("energy in balance within {allowed}"),
            reached: format!("{balance:e}"),
            hint: "cells of a periodic grid that are wider than a tenth of their height, or a smaller --tolerance, help".into(),
        });
    }
    Ok(balance)
}

/// Steps of the progress that a solve reports.
const STEPS: u64 = 100;
/// Most memory that a solve may take; it holds about nine vectors of its source moments.
const MAX_SOLVE_BYTES: usize = 12 << 30;

impl Truth {
    /// Scattered fluence rate per cell of the scene, W/m².
    pub fn phi_scattered(&self) -> Vec<f32> {
        let y0 = harmonics([0.0, 0.0, 1.0])[0] as f32;
        // What the scaled medium counts as unscattered is at least what was: less is round-off of the sums.
        let forward = |cell: usize| (self.scaled[cell] - self.unscattered[cell]).max(0.0);
        let fine: Vec<f32> =
            (0..self.moments.len()).map(|cell| self.moments[cell][0] / y0 + forward(cell)).collect();
        self.parent.means(&fine, 1)
    }

    /// Never scattered fluence rate per cell of the scene, W/m².
    pub fn phi_direct(&self) -> Vec<f32> {
        self.parent.means(&self.unscattered, 1)
    }

    /// J per cell of the scene towards the asked direction number `index`, W/(m² sr), all orders.
    pub fn towards(&self, index: usize, direction: DVec3) -> Vec<f32> {
        let count = self.direct_towards.len() / self.moments.len();
        let weights = scattering_weights(self.fine.g, direction);
        let fine: Vec<f32> = (0..self.moments.len())
            .map(|cell| self.direct_towards[cell * count + index] + dot(&self.moments[cell], &weights))
            .collect();
        self.parent.means(&fine, 1)
    }
}

/// Weights that turn moments of light into light scattered towards `direction`: g^l Y_lm.
pub fn scattering_weights(g: f64, direction: DVec3) -> [f32; MAX_HARMONICS] {
    let basis = harmonics(direction.to_array());
    let powers = [1.0, g, g * g, g * g * g];
    std::array::from_fn(|m| (powers[degree_of(m)] * basis[m]) as f32)
}

fn dot(moments: &[f32; MAX_HARMONICS], weights: &[f32; MAX_HARMONICS]) -> f32 {
    moments.iter().zip(weights).map(|(a, b)| a * b).sum()
}
