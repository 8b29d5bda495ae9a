//! What a bake is likely to take, told before it: work is counted from the recipe and its grid, and each kind of work has a price that
//! was measured once. Nothing is solved and no clock is asked, so that the same recipe is told the same on every machine.
//!
//! The number of sweeps that a light takes is the one thing that cannot be counted. It is taken from how far light diffuses in the
//! grid, and that is what makes the figures right within a factor of two and no better. docs/pipeline.md has what was told and taken.

use crate::error::BakeError;
use crate::input::scene::read_scene;
use crate::memory::{Limit, require_bake};
use crate::plan::lights::{Site, in_light_cells};
use crate::plan::sun::usual_sun;
use crate::recipe::{Clouds, Recipe};
use crate::response::BATCH;
use serde::Serialize;
use squall_formats::section::response::{DirectTerm, Stored};
use squall_runtime::transport::Cloud;

/// A bake as it is foreseen.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The cloud's part, if the recipe has one.
    pub clouds: Option<CloudWork>,
    /// Pictures of streaks to fit.
    pub streak_pictures: usize,
    /// Threads that the work is spread over.
    pub threads: usize,
    /// Bytes of memory at once, about.
    pub memory_bytes: u64,
    /// Seconds of one core of some 3 GHz, about.
    pub cpu_seconds: f64,
    /// Seconds on those threads, about.
    pub seconds: f64,
}

/// What a cloud's response has to be solved for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CloudWork {
    /// Cells along x, y and z.
    pub cells: [u32; 3],
    /// Cells that are solved in.
    pub solve_cells: u64,
    /// Directions that are swept along.
    pub directions: usize,
    /// Nodes of the light grid along x, y and z.
    pub light_grid: [usize; 3],
    /// Virtual point lights that rows are baked for.
    pub virtual_lights: usize,
    /// Distant lights.
    pub distant: usize,
    /// Coefficients that a cell holds of every row.
    pub coefficients: usize,
    /// Held-out strokes.
    pub held_out_strokes: usize,
    /// Their points in all.
    pub held_out_points: usize,
    /// Sweeps that sixteen lights side by side take, about.
    pub sweeps: f64,
    /// Seconds of one core for the cloud alone, about.
    pub cpu_seconds: f64,
    /// Whether `[clouds.budget]` chooses settings: the work is then counted for one bake by the recipe's own or usual ones, and the
    /// search comes on top.
    pub chosen_by_budget: bool,
}

/// Seconds that a cell of a sweep takes in one direction for sixteen lights, and for one.
const SWEEP: [f64; 2] = [20e-9, 5e-9];
/// Seconds that a ray takes for a cell, and more where it is collected towards 26 directions.
const RAY: [f64; 2] = [6e-9, 27e-9];
/// Seconds that coding takes for a coefficient.
const CODE: f64 = 20e-9;
/// Seconds of fitting a picture of a streak, and of the tables of counts.
const STREAK: f64 = 0.8;
const DENSITY: f64 = 0.1;
/// Beams that the two halves of the sky are made of.
const BEAMS_OF_SKY: f64 = 36.0;
/// Sweeps over what a diffusion length asks for.
const SWEEPS: f64 = 0.85;

/// What baking `recipe` on this process's threads is likely to take.
///
/// Errors: inputs that are missing or out of range; more virtual lights than days allow.
pub fn estimate(recipe: &Recipe) -> Result<Estimate, BakeError> {
    let threads = rayon::current_num_threads();
    let unlimited = Limit { bytes: u64::MAX, whence: "nobody" };
    let memory = require_bake(recipe, threads as u64, unlimited)?;
    let rain = recipe.rain.as_ref();
    let streak_pictures = rain.map_or(0, |rain| rain.pictures.len());
    let mut cpu_seconds = STREAK * streak_pictures as f64 + if rain.is_some() { DENSITY } else { 0.0 };
    let mut clouds = None;
    if let Some(part) = &recipe.clouds {
        let shown = read_scene(&part.scene, part.optics)?.cloud;
        let cloud = in_light_cells(recipe, part, &shown)?;
        let cloud = cloud.as_ref().unwrap_or(&shown);
        // A fit is of light in the shown cells.
        let solved = if part.response.stored == Stored::Fit { &shown } else { cloud };
        let mut work = work(recipe, part, (cloud, solved))?;
        work.cpu_seconds = work.seconds(part, (cloud, solved));
        cpu_seconds += work.cpu_seconds;
        clouds = Some(work);
    }
    Ok(Estimate {
        clouds,
        streak_pictures,
        threads,
        memory_bytes: memory.map_or(0, |memory| memory.bytes()),
        cpu_seconds,
        seconds: cpu_seconds / threads as f64,
    })
}

fn work(recipe: &Recipe, clouds: &Clouds, (cloud, solved): (&Cloud, &Cloud)) -> Result<CloudWork, BakeError> {
    let settings = &clouds.response;
    let site = Site::new(recipe, clouds, cloud);
    let (lights, strokes) = site.held_out(site.usual_spacing_m(), 0)?;
    Ok(CloudWork {
        cells: cloud.shape.to_array().map(|count| count as u32),
        solve_cells: solved.shape.len() as u64 * u64::from(settings.refine).pow(3),
        directions: settings.solve.quadrature.ordinates()?.len(),
        light_grid: lights.grid.axes().map(<[f64]>::len),
        virtual_lights: lights.wanted_count(),
        distant: clouds.distant.len() + usual_sun(&site)?.map_or(0, |sun| sun.beams.len()),
        coefficients: settings.basis.count(),
        held_out_strokes: strokes.len(),
        held_out_points: strokes.iter().map(Vec::len).sum(),
        sweeps: sweeps(clouds, solved),
        cpu_seconds: 0.0,
        chosen_by_budget: clouds.budget.needs_held_out(),
    })
}

/// Sweeps until the residual is down: their number goes with how many mean free paths of diffusion the grid is across.
fn sweeps(clouds: &Clouds, cloud: &Cloud) -> f64 {
    let scaled = cloud.scaled(1);
    let counts = cloud.shape.to_array();
    // Optical depth along each axis, mean over the grid's occupied columns.
    let total: f64 = cloud.extinction.iter().map(|&e| f64::from(e)).sum();
    let occupied = cloud.extinction.iter().filter(|&&e| e > 0.0).count().max(1);
    let mean = total / occupied as f64 * scaled.extinction_scale;
    let share = libm::cbrt(occupied as f64 / cloud.shape.len() as f64);
    let depth = (0..3).map(|axis| counts[axis] as f64 * cloud.cell_m[axis]).fold(f64::INFINITY, f64::min);
    let depth = depth * share * mean;
    let escapes = (1.0 - scaled.albedo) + 3.0 / ((depth + 2.0) * (depth + 2.0));
    let tolerance = clouds.response.solve.tolerance;
    (2.0 + SWEEPS * libm::log(2.0 / tolerance) / libm::sqrt(escapes))
        .min(f64::from(clouds.response.solve.max_sweeps))
}

impl CloudWork {
    /// Seconds of one core.
    fn seconds(&self, clouds: &Clouds, (cloud, solved): (&Cloud, &Cloud)) -> f64 {
        let settings = &clouds.response;
        let cells = self.solve_cells as f64;
        let counts = solved.shape.to_array().map(|count| (count as u32 * settings.refine) as f64);
        let [nx, ny, nz] = counts;
        // Rays through every face of the grid's sides, each through about half the grid.
        let samples = f64::from(settings.samples);
        let steps = 2.0 * (nx * ny + ny * nz + nz * nx) * samples * samples * 0.5 * (nx + ny + nz);
        let batches = (self.virtual_lights.div_ceil(BATCH) + self.distant.div_ceil(BATCH)) as f64;
        let cell_directions = cells * self.directions as f64 * self.sweeps;
        let swept =
            SWEEP[0] * batches * cell_directions + SWEEP[1] * self.held_out_strokes as f64 * cell_directions;
        let in_rows = if settings.direct == DirectTerm::InRows { RAY[1] } else { 0.0 };
        let traced = steps * (RAY[0] + in_rows) * self.virtual_lights as f64
            + steps
                * (RAY[0] + RAY[1])
                * (self.held_out_points as f64 + 0.5 * BEAMS_OF_SKY * clouds.distant.len() as f64);
        let rows = (self.virtual_lights + self.distant) as f64;
        let coded = CODE * rows * self.coefficients as f64 * cloud.shape.len() as f64;
        swept + traced + coded
    }
}
