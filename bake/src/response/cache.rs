//! Solved rows and held-out strokes, kept between bakes: what is the same in two recipes is solved once.
//!
//! A row is kept under a hash of all that it depends on: the grid, its optics, how light is solved and stored by cell and direction,
//! the light itself, and the very program that solved it. It is kept as it was solved, before coding, in the cells that are read,
//! so that an asset has the same bytes whether its rows were solved now or before. Of the sweeps that it took its own are
//! kept: how many a batch takes together follows from those ([`sweeps_together`](squall_runtime::transport::solve::sweeps_together)).

mod piece;
mod store;

use super::job::{HeldOutStroke, Job};
use crate::output::sweep;
use crate::provenance::tool;
use squall_formats::section::response::{DirectionalBasis, Stored};
use squall_runtime::relight::PointLight;
use squall_runtime::transport::Boundary;
use squall_runtime::transport::direct::Light;
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::Iteration;
use std::io::Read;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use store::{Key, Store};

/// Bytes that a cache takes at most, unless somebody says otherwise.
pub const USUAL_BYTES: u64 = 2 << 30;

/// A folder of solved rows. Several bakes may use it at once; deleting it, or any file in it, at any time does no harm.
#[derive(Debug)]
pub struct ResponseCache {
    store: Store,
    found: [AtomicU64; 2],
    solved: [AtomicU64; 2],
}

/// What a cache was good for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CacheReport {
    /// Rows that were there.
    pub rows_found: u64,
    /// Rows that had to be solved.
    pub rows_solved: u64,
    /// Held-out strokes that were there.
    pub strokes_found: u64,
    /// Held-out strokes that had to be solved.
    pub strokes_solved: u64,
    /// Why no more could be kept.
    pub trouble: Option<String>,
}

/// Index of rows in counts.
const ROWS: usize = 0;
/// Index of held-out strokes in counts.
const STROKES: usize = 1;

impl ResponseCache {
    /// A cache in `folder`, made when the first row is kept, of about `most_bytes` bytes: what was used least recently goes first.
    pub fn new(folder: &Path, most_bytes: u64) -> Self {
        let store = Store::new(folder, most_bytes);
        // What a killed bake left half-written, and what another bound has left.
        sweep(folder);
        store.trim();
        Self { store, found: Default::default(), solved: Default::default() }
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        self.store.folder()
    }

    /// What it was good for since it was opened.
    pub fn report(&self) -> CacheReport {
        let read = |counts: &[AtomicU64; 2], kind: usize| counts[kind].load(Ordering::Relaxed);
        CacheReport {
            rows_found: read(&self.found, ROWS),
            rows_solved: read(&self.solved, ROWS),
            strokes_found: read(&self.found, STROKES),
            strokes_solved: read(&self.solved, STROKES),
            trouble: self.store.trouble(),
        }
    }
}

/// A row as it was solved.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct KeptRow {
    /// Residual that was left.
    pub(super) residual: f64,
    /// The row's own sweeps.
    pub(super) steps: Vec<u32>,
    /// Coefficients of the cells that are read, one plane after the other.
    pub(super) values: Vec<f32>,
}

/// A cache as one job uses it.
pub(super) struct JobCache<'a> {
    cache: &'a ResponseCache,
    /// Hash of what all lights of the job have in common.
    common: blake3::Hasher,
    basis: DirectionalBasis,
    /// Which cells are read; all where `None`.
    seen: Option<Vec<bool>>,
    cells: usize,
}

impl<'a> JobCache<'a> {
    /// The job's cache; nothing where it has none, or solves in a way that is not kept.
    pub(super) fn new(job: &Job<'a>, seen: Option<&[bool]>) -> Option<Self> {
        let cache = job.cache.filter(|_| job.settings.solve.iteration == Iteration::Minres)?;
        let common = common_hash(job);
        let (seen, cells) = (seen.map(<[bool]>::to_vec), job.cloud.shape.len());
        Some(Self { cache, common, basis: job.settings.basis, seen, cells })
    }

    /// Name of a row.
    fn row_key(&self, lights: &[Light], in_rows: bool) -> Key {
        let mut hasher = self.common.clone();
        hasher.update(b"row");
        hasher.update(&basis_bytes(self.basis));
        hasher.update(&[u8::from(in_rows)]);
        for light in lights {
            let (kind, place, strength) = match *light {
                Light::Point { position, intensity } => (0, position, intensity),
                Light::Beam { direction, irradiance } => (1, direction, irradiance),
            };
            hasher.update(&[kind]);
            for value in [place.x, place.y, place.z, strength] {
                hasher.update(&value.to_le_bytes());
            }
        }
        *hasher.finalize().as_bytes()
    }

    /// A row that was kept, its planes one grid long with zeros in hidden cells, which are filled anew.
    pub(super) fn row(&self, lights: &[Light], in_rows: bool) -> Option<KeptRow> {
        let values = self.basis.count() * self.read_cells();
        let blob = self.cache.store.get(&self.row_key(lights, in_rows), 12 + 4 * (MOST_STARTS + values))?;
        let mut row = decode(&blob, values)?;
        row.values = self.spread(&row.values, 1);
        self.cache.found[ROWS].fetch_add(1, Ordering::Relaxed);
        Some(row)
    }

    /// Keeps a row; `planes` are its coefficients, one grid long each.
    pub(super) fn keep_row(
        &self,
        lights: &[Light],
        in_rows: bool,
        residual: f64,
        steps: &[u32],
        planes: &[f32],
    ) {
        self.cache.solved[ROWS].fetch_add(1, Ordering::Relaxed);
        if steps.len() <= MOST_STARTS {
            let blob = encode(residual, steps, &self.gather(planes, 1));
            self.cache.store.put(&self.row_key(lights, in_rows), &blob);
        }
    }

    fn stroke_key(&self, lights: &[PointLight], to_viewers: bool) -> Key {
        let mut hasher = self.common.clone();
        hasher.update(b"stroke");
        hasher.update(&[u8::from(to_viewers)]);
        for light in lights {
            let PointLight { position, intensity } = light;
            for value in [position.x, position.y, position.z, *intensity] {
                hasher.update(&value.to_le_bytes());
            }
        }
        *hasher.finalize().as_bytes()
    }

    /// A held-out stroke with its truth that was kept; the truth is zero in hidden cells, where nothing is compared. `to_viewers`
    /// says whether direct light towards the view region belongs to it.
    pub(super) fn stroke(
        &self,
        lights: &[PointLight],
        to_viewers: bool,
        seen: &Arc<[bool]>,
    ) -> Option<HeldOutStroke> {
        let each = self.read_cells();
        let values = each * (2 * DIRECTIONS + usize::from(to_viewers));
        let blob = self.cache.store.get(&self.stroke_key(lights, to_viewers), 12 + 4 * values)?;
        let KeptRow { values, .. } = decode(&blob, values)?;
        let (truth, rest) = values.split_at(each * DIRECTIONS);
        let (direct, viewers) = rest.split_at(each * DIRECTIONS);
        self.cache.found[STROKES].fetch_add(1, Ordering::Relaxed);
        Some(HeldOutStroke {
            lights: lights.to_vec(),
            truth: self.spread(truth, DIRECTIONS),
            direct: self.spread(direct, DIRECTIONS),
            direct_to_viewers: if to_viewers { self.spread(viewers, 1) } else { Vec::new() },
            uncompressed: Vec::new(),
            seen: seen.clone(),
        })
    }

    /// Keeps a held-out stroke.
    pub(super) fn keep_stroke(&self, stroke: &HeldOutStroke, to_viewers: bool) {
        self.cache.solved[STROKES].fetch_add(1, Ordering::Relaxed);
        let parts =
            [(&stroke.truth, DIRECTIONS), (&stroke.direct, DIRECTIONS), (&stroke.direct_to_viewers, 1)];
        let values: Vec<f32> = parts.iter().flat_map(|(values, each)| self.gather(values, *each)).collect();
        self.cache.store.put(&self.stroke_key(&stroke.lights, to_viewers), &encode(0.0, &[], &values));
    }

    fn read_cells(&self) -> usize {
        self.seen.as_ref().map_or(self.cells, |seen| seen.iter().filter(|&&seen| seen).count())
    }

    /// Values of the cells that are read; `each` values a cell behind one another, grid after grid.
    fn gather(&self, values: &[f32], each: usize) -> Vec<f32> {
        let Some(seen) = &self.seen else { return values.to_vec() };
        let read = |(at, _): &(usize, &[f32])| seen[at % self.cells];
        values.chunks_exact(each).enumerate().filter(read).flat_map(|(_, values)| values).copied().collect()
    }

    /// The reverse of [`JobCache::gather`], with zeros in the other cells.
    fn spread(&self, values: &[f32], each: usize) -> Vec<f32> {
        let Some(seen) = &self.seen else { return values.to_vec() };
        let grids = values.len() / (self.read_cells() * each).max(1);
        let mut out = vec![0.0; grids * self.cells * each];
        let cells = out.chunks_exact_mut(each).enumerate().filter(|(at, _)| seen[at % self.cells]);
        for ((_, to), from) in cells.zip(values.chunks_exact(each)) {
            to.copy_from_slice(from);
        }
        out
    }
}

/// Directions of a held-out stroke's truth.
const DIRECTIONS: usize = 26;
/// Starts of MINRES that a kept row may have taken; more are not kept.
const MOST_STARTS: usize = 64;

fn encode(residual: f64, steps: &[u32], values: &[f32]) -> Vec<u8> {
    let mut blob = Vec::with_capacity(12 + 4 * (steps.len() + values.len()));
    blob.extend_from_slice(&residual.to_le_bytes());
    blob.extend_from_slice(&(steps.len() as u32).to_le_bytes());
    steps.iter().for_each(|step| blob.extend_from_slice(&step.to_le_bytes()));
    values.iter().for_each(|value| blob.extend_from_slice(&value.to_le_bytes()));
    blob
}

fn decode(blob: &[u8], count: usize) -> Option<KeptRow> {
    let (residual, rest) = blob.split_first_chunk::<8>()?;
    let (starts, rest) = rest.split_first_chunk::<4>()?;
    let starts = u32::from_le_bytes(*starts) as usize;
    if starts > MOST_STARTS || rest.len() != 4 * (starts + count) {
        return None;
    }
    let (steps, values) = rest.split_at(4 * starts);
    let four = |bytes: &[u8]| [bytes[0], bytes[1], bytes[2], bytes[3]];
    Some(KeptRow {
        residual: f64::from_le_bytes(*residual),
        steps: steps.chunks_exact(4).map(|bytes| u32::from_le_bytes(four(bytes))).collect(),
        values: values.chunks_exact(4).map(|bytes| f32::from_le_bytes(four(bytes))).collect(),
    })
}

/// Hash of the program, the grid and the way of solving.
fn common_hash(job: &Job<'_>) -> blake3::Hasher {
    let (cloud, settings) = (job.cloud, job.settings);
    let mut hasher = blake3::Hasher::new();
    hasher.update(tool().as_bytes());
    hasher.update(program());
    for count in cloud.shape.to_array() {
        hasher.update(&(count as u64).to_le_bytes());
    }
    let origin = cloud.origin_m.to_array();
    for value in cloud.cell_m.iter().chain(&origin).chain([&cloud.albedo, &cloud.g]) {
        hasher.update(&value.to_le_bytes());
    }
    hasher.update(&[match cloud.boundary {
        Boundary::Open => 0,
        Boundary::PeriodicXy => 1,
    }]);
    hasher.update(bytemuck::cast_slice(&cloud.extinction));
    if let (Stored::Fit, Some(shown)) = (settings.stored, job.shown) {
        for count in shown.shape.to_array() {
            hasher.update(&(count as u64).to_le_bytes());
        }
        hasher.update(bytemuck::cast_slice(&shown.extinction));
    }
    hasher.update(&[settings.stored as u8]);
    let solve = &settings.solve;
    hasher.update(&match solve.quadrature {
        Quadrature::Lebedev14 => [14, 0, 0],
        Quadrature::Lebedev26 => [26, 0, 0],
        Quadrature::Lebedev50 => [50, 0, 0],
        Quadrature::DoubleGauss { polar, azimuths } => [1, polar, azimuths],
    });
    hasher.update(&[solve.scheme as u8, u8::from(solve.delta), u8::from(settings.seen_only)]);
    hasher.update(&solve.tolerance.to_le_bytes());
    for count in [solve.max_sweeps, settings.refine, settings.samples] {
        hasher.update(&count.to_le_bytes());
    }
    if let Some(region) = &settings.view_region {
        for value in region.low_m.iter().chain(&region.high_m) {
            hasher.update(&value.to_le_bytes());
        }
    }
    hasher
}

fn basis_bytes(basis: DirectionalBasis) -> [u8; 2] {
    match basis {
        DirectionalBasis::Directions26 => [0, 0],
        DirectionalBasis::Harmonics { degree } => [1, degree],
        DirectionalBasis::ViewRegion { degree } => [2, degree],
    }
}

/// Hash of this process's own program: two builds of one version may solve differently. Nothing where it cannot be read.
fn program() -> &'static [u8] {
    static PROGRAM: OnceLock<Vec<u8>> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let read = || -> std::io::Result<Vec<u8>> {
            let mut file = std::fs::File::open(std::env::current_exe()?)?;
            let (mut hasher, mut buffer) = (blake3::Hasher::new(), vec![0; 1 << 20]);
            loop {
                match file.read(&mut buffer)? {
                    0 => return Ok(hasher.finalize().as_bytes().to_vec()),
                    read => hasher.update(&buffer[..read]),
                };
            }
        };
        read().unwrap_or_default()
    })
}
