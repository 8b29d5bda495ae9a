//! Light of point sources and beams in a cloud grid by Monte Carlo: photons, followed one by one.
//!
//! A second truth beside the sweep (`cloud.rs`), which shares the scene and the form of its results with it and nothing else:
//! exact paths in place of a swept grid, directions drawn from the phase function itself in place of moments and delta
//! scaling, pictures from scatterings in place of marched rays. What is wrong here is chance alone, and the standard errors
//! say how much. Weights instead of absorption, \[lux-koblinger\]; flights and photons in `photon.rs`, pictures in `image.rs`.
//!
//! Photons run in 32 batches, each with a random stream of its own; means and standard errors come from the batches, in
//! their order, so that the bytes do not depend on the number of threads. Errors of neighbouring cells and pixels are
//! correlated: whole maps are held to the error of their mean in [`MonteCarloReport`], never by an error over √n.
//!
//! | symbol | name | unit |
//! | φ | fluence rate ∫ L dΩ | W/m² |
//! | J | in-scattered radiance ([`squall_formats::basis`]) towards a camera | W/(m² sr) |

mod image;
pub(crate) mod phase;
mod photon;
mod source;
mod traverse;

use crate::error::BakeError;
use crate::fields::{Estimate, Fields, orthographic};
use crate::progress::Progress;
use image::Viewpoint;
use phase::Phase;
use photon::{Power, Scene, Tally};
use rayon::prelude::*;
use source::{Source, Square};
use squall_runtime::RuntimeError;
use squall_runtime::camera::Camera;
use squall_runtime::random::Random;
use squall_runtime::transport::direct::Light;
use squall_runtime::transport::{Boundary, Cloud};
use std::ops::RangeInclusive;
use traverse::Grid;

/// How much chance.
#[derive(Clone, Copy, Debug)]
pub struct MonteCarloSettings {
    /// Photons, within [`PHOTONS`]: the standard error falls with their square root.
    pub photons: u64,
    /// Every seed gives results of its own, the same seed always the same.
    pub seed: u64,
}

impl Default for MonteCarloSettings {
    fn default() -> Self {
        Self { photons: 1_000_000, seed: 1 }
    }
}

/// Photons that can be asked for.
pub const PHOTONS: RangeInclusive<u64> = 100..=100_000_000_000;
/// Independent batches. The standard error of so many is itself known to an eighth.
pub const BATCHES: u64 = 32;
/// Photons between two words of progress.
const STEP: u64 = 256;
/// Most memory that batches in flight may take together, where one fits at all.
const FLIGHT_BYTES: usize = 2 << 30;
/// Most memory in all: two sums, and one batch at least.
const MAX_BYTES: usize = 12 << 30;
/// |cosine| to the vertical below which a beam through a grid without sides is as good as horizontal.
const LEAST_SLOPE: f64 = 1e-3;

/// A number with its standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Measured {
    /// Mean over the batches.
    pub mean: f64,
    /// One standard error of it.
    pub standard_error: f64,
}

/// How it went, and where the energy is.
#[derive(Clone, Debug, serde::Serialize)]
pub struct MonteCarloReport {
    /// Photons started.
    pub samples: u64,
    /// The seed.
    pub seed: u64,
    /// Independent batches behind every standard error.
    pub batches: u64,
    /// Power that meets the grid, W.
    pub power_in_w: f64,
    /// Power absorbed in the grid, W.
    pub absorbed_w: f64,
    /// Power leaving by −x, +x, −y, +y, −z, +z, scattered, W.
    pub scattered_out_w: [f64; 6],
    /// Standard errors of these.
    pub scattered_out_se_w: [f64; 6],
    /// Power leaving unscattered, W.
    pub direct_out_w: f64,
    /// (absorbed + leaving) / in − 1: Russian roulette keeps it on the mean alone, all else exactly.
    pub energy_balance: f64,
    /// One standard error of the energy balance.
    pub energy_balance_se: f64,
    /// Mean of each field over all cells and of each picture over all pixels, by file name.
    pub means: std::collections::BTreeMap<String, Measured>,
}

/// Solves for one light by following photons: fields, J towards the orthographic ones of `cameras`, and a picture of each.
///
/// Errors: photons out of range, a beam that is level in a grid without sides, cameras that `image.rs` cannot serve there, more
/// memory than it may take, an interruption.
pub fn solve_monte_carlo(
    cloud: &Cloud,
    light: Light,
    cameras: &[(String, Camera)],
    settings: &MonteCarloSettings,
    progress: &dyn Progress,
) -> Result<(Fields, MonteCarloReport), BakeError> {
    if !PHOTONS.contains(&settings.photons) {
        let wanted = format!("{} to {} photons", PHOTONS.start(), PHOTONS.end());
        return Err(RuntimeError::argument("samples", wanted, settings.photons).into());
    }
    if let (Light::Beam { direction, .. }, Boundary::PeriodicXy) = (light, cloud.boundary)
        && direction.z.abs() < LEAST_SLOPE
    {
        let wanted = "a beam that comes down or up through a grid without sides";
        return Err(RuntimeError::argument("beam direction", wanted, direction).into());
    }
    let grid = Grid::new(cloud);
    let view_region =
        cameras.iter().map(|(name, camera)| Viewpoint::new(&grid, name, camera)).collect::<Result<_, _>>()?;
    let towards = orthographic(cameras).map(|(_, camera)| -camera.forward).collect();
    let scene = Scene { grid, albedo: cloud.albedo, phase: Phase::new(cloud.g), towards, view_region };
    let cells = cloud.shape.len();
    let pixels: usize = scene.view_region.iter().map(Viewpoint::pixels).sum();
    let batch_bytes = (cells * scene.stride() + pixels) * size_of::<f64>();
    if 3 * batch_bytes > MAX_BYTES {
        let wanted = format!("at most {} values of cells and pixels", MAX_BYTES / 3 / size_of::<f64>());
        return Err(RuntimeError::argument("scene", wanted, batch_bytes / size_of::<f64>()).into());
    }
    let together = (FLIGHT_BYTES / batch_bytes.max(1)).clamp(1, BATCHES as usize) as u64;
    let source = Source::new(&scene.grid, light);
    progress.begin("photons", settings.photons);
    let mut sums = Sums::new(&scene, cells);
    for first in (0..BATCHES).step_by(together as usize) {
        let batches = (first..BATCHES.min(first + together)).into_par_iter();
        let run = |batch| run_batch(&scene, &source, settings, (batch, cells), progress);
        let tallies = batches.map(run).collect::<Result<Vec<Tally>, BakeError>>()?;
        // In the order of the batches, whoever was done first.
        tallies.iter().for_each(|tally| sums.add(tally));
    }
    Ok(sums.results(cloud, cameras, settings))
}

/// Follows the photons of one batch.
fn run_batch(
    scene: &Scene<'_>,
    source: &Source,
    settings: &MonteCarloSettings,
    (batch, cells): (u64, usize),
    progress: &dyn Progress,
) -> Result<Tally, BakeError> {
    let photons = settings.photons / BATCHES + u64::from(batch < settings.photons % BATCHES);
    let mut random = Random::from_parts(&[settings.seed, batch]);
    let mut square = Square::new(&mut random);
    let mut tally = scene.tally(cells);
    // Every batch carries the whole power of the light, and estimates everything whole.
    let power = source.power / photons as f64;
    for photon in 0..photons {
        if photon % STEP == 0 {
            progress.check()?;
            progress.advance(STEP.min(photons - photon));
        }
        let start = source.start(&scene.grid, square.point());
        if !scene.follow(start, power, &mut random, &mut tally, progress) {
            return Err(BakeError::Interrupted);
        }
    }
    Ok(tally)
}

/// Mean and squared deviations, taken in one after another (Welford).
#[derive(Clone, Debug)]
pub(crate) struct Moments {
    mean: Vec<f64>,
    square: Vec<f64>,
}

impl Moments {
    pub(crate) fn new(count: usize) -> Self {
        Self { mean: vec![0.0; count], square: vec![0.0; count] }
    }

    /// Takes in the values of batch number `count`, from 1.
    pub(crate) fn add(&mut self, values: &[f64], count: f64) {
        let both = self.mean.par_iter_mut().zip(&mut self.square).with_min_len(1 << 14);
        both.zip(values).for_each(|((mean, square), value)| {
            let off = value - *mean;
            *mean += off / count;
            *square += off * (value - *mean);
        });
    }

    pub(crate) fn measured(&self, index: usize) -> Measured {
        let count = BATCHES as f64;
        let standard_error = (self.square[index] / (count * (count - 1.0))).sqrt();
        Measured { mean: self.mean[index], standard_error }
    }

    /// Values `offset`, `offset + stride` …, divided by `unit`.
    fn estimate(&self, offset: usize, stride: usize, unit: f64) -> Estimate {
        let values = (offset..self.mean.len()).step_by(stride).map(|index| self.measured(index));
        let (mean, error) =
            values.map(|value| ((value.mean / unit) as f32, (value.standard_error / unit) as f32)).unzip();
        Estimate { mean, error: Some(error) }
    }
}

/// What all batches so far say.
struct Sums {
    cells: Moments,
    images: Vec<Moments>,
    /// Means over a map of each value per cell, and of each picture.
    maps: Moments,
    /// Met, absorbed, unscattered out, six sides, energy balance.
    power: Moments,
    stride: usize,
    count: f64,
}

impl Sums {
    fn new(scene: &Scene<'_>, cells: usize) -> Self {
        let stride = scene.stride();
        Self {
            cells: Moments::new(cells * stride),
            images: scene.view_region.iter().map(|eye| Moments::new(eye.pixels())).collect(),
            maps: Moments::new(stride + scene.view_region.len()),
            power: Moments::new(10),
            stride,
            count: 0.0,
        }
    }

    fn add(&mut self, tally: &Tally) {
        self.count += 1.0;
        self.cells.add(&tally.cells, self.count);
        let mut maps = vec![0.0; self.stride];
        for cell in tally.cells.chunks_exact(self.stride) {
            for (sum, value) in maps.iter_mut().zip(cell) {
                *sum += value;
            }
        }
        let cells = (tally.cells.len() / self.stride) as f64;
        maps.iter_mut().for_each(|sum| *sum /= cells);
        for (sums, image) in self.images.iter_mut().zip(&tally.images) {
            sums.add(image, self.count);
            maps.push(image.iter().sum::<f64>() / image.len() as f64);
        }
        self.maps.add(&maps, self.count);
        let Power { met, absorbed, direct_out, scattered_out } = tally.power;
        let out = absorbed + direct_out + scattered_out.iter().sum::<f64>();
        let [a, b, c, d, e, f] = scattered_out;
        self.power.add(&[met, absorbed, direct_out, a, b, c, d, e, f, out - met], self.count);
    }

    fn results(
        &self,
        cloud: &Cloud,
        cameras: &[(String, Camera)],
        settings: &MonteCarloSettings,
    ) -> (Fields, MonteCarloReport) {
        let volume = cloud.cell_volume();
        let field = |offset: usize| self.cells.estimate(offset, self.stride, volume);
        let names: Vec<&String> = orthographic(cameras).map(|(name, _)| name).collect();
        let towards = names.iter().enumerate();
        let fields = Fields {
            phi_scattered: field(0),
            phi_direct: field(1),
            seen: None,
            towards: towards.map(|(i, name)| ((*name).clone(), field(photon::FLUENCES + i))).collect(),
            images: cameras
                .iter()
                .zip(&self.images)
                .map(|((name, camera), image)| {
                    (name.clone(), camera.width as usize, image.estimate(0, 1, 1.0))
                })
                .collect(),
        };
        let file_names = ["phi_sc".to_owned(), "phi_dir".to_owned()]
            .into_iter()
            .chain(names.iter().map(|name| format!("jcam_{name}")))
            .map(|name| (name, volume))
            .chain(cameras.iter().map(|(name, _)| (format!("image_{name}"), 1.0)));
        let means = file_names.enumerate().map(|(index, (name, unit))| {
            let Measured { mean, standard_error } = self.maps.measured(index);
            (name, Measured { mean: mean / unit, standard_error: standard_error / unit })
        });
        let power = |index: usize| self.power.measured(index);
        let met = power(0).mean;
        let share = |value: f64| if met > 0.0 { value / met } else { 0.0 };
        let report = MonteCarloReport {
            samples: settings.photons,
            seed: settings.seed,
            batches: BATCHES,
            power_in_w: met,
            absorbed_w: power(1).mean,
            scattered_out_w: std::array::from_fn(|side| power(3 + side).mean),
            scattered_out_se_w: std::array::from_fn(|side| power(3 + side).standard_error),
            direct_out_w: power(2).mean,
            energy_balance: share(power(9).mean),
            energy_balance_se: share(power(9).standard_error),
            means: means.collect(),
        };
        (fields, report)
    }
}
