//! How closely the light of strokes is worked out: gathers at run time, and how coarsely live light is solved for.

#[cfg(feature = "live")]
use super::CloudLight;
use super::Clouds;
use crate::error::RuntimeError;
#[cfg(feature = "live")]
use crate::{
    live::LiveSolver,
    parallel::prelude::*,
    relight::{PointLight, Relighter},
    shade::cloud::corners,
    single_scatter::{DirectSettings, WantedCells, add_direct_moments},
    transport::cloud::CoarseIndex,
    transport::direct::distances,
    transport::gather::GatherBuffers,
};
#[cfg(feature = "live")]
use squall_formats::{
    section::response::{DirectTerm, DirectionalBasis, SolverRecord},
    sphere::{self, MAX_HARMONICS},
};

/// Most gathers: what is still wrong after so many a solve is right about sooner.
pub const MOST_GATHERS: u32 = 64;
/// Coarsest live solve, in cells of the asset's along each axis.
pub const COARSEST: u32 = 16;

/// How closely the light of strokes is worked out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LightQuality {
    /// Transport sweeps over the light of rows and of live solves, with the strokes' own direct light: what is wrong on the scale of cells
    /// and of virtual lights' distances goes, and the last sweep says how wrong the light was. 0 to 64; above 0 feature `live` is
    /// needed, and of rows light in all directions, harmonics of degree 1 or more or 26 directions, without direct light in it.
    pub gathers: u32,
    /// Edge of the cells that live light is solved for in, in cells of the rows', 1 to 16; a larger one is taken down until it divides the
    /// grid. What a solve in cells of 2 or 4 lacks a gather or two bring back, in a fraction of the time. 1: in the rows' own
    /// discretisation.
    pub live_cells: u32,
}

impl LightQuality {
    /// Light as rows and live solves in the rows' own discretisation have it.
    pub const PLAIN: Self = Self { gathers: 0, live_cells: 1 };

    /// Refuses numbers out of range, and gathers that this build cannot do.
    ///
    /// Errors: the first of those, by name.
    pub fn check(self) -> Result<(), RuntimeError> {
        if self.gathers > MOST_GATHERS {
            let wanted = format!("0 to {MOST_GATHERS}");
            return Err(RuntimeError::argument("quality.light.gathers", wanted, self.gathers));
        }
        if !(1..=COARSEST).contains(&self.live_cells) {
            let wanted = format!("1 to {COARSEST}");
            return Err(RuntimeError::argument("quality.light.live_cells", wanted, self.live_cells));
        }
        if self.gathers > 0 && cfg!(not(feature = "live")) {
            let wanted = "0: gathers are of feature `live` of squall-runtime";
            return Err(RuntimeError::argument("quality.light.gathers", wanted, self.gathers));
        }
        Ok(())
    }
}

impl Default for LightQuality {
    /// [`LightQuality::PLAIN`].
    fn default() -> Self {
        Self::PLAIN
    }
}

impl Clouds {
    /// How closely the light of strokes is worked out, [`LightQuality::PLAIN`] unless set.
    ///
    /// Errors: numbers out of range, or gathers without feature `live`.
    pub fn set_quality(&mut self, quality: LightQuality) -> Result<(), RuntimeError> {
        quality.check()?;
        if quality != self.quality {
            self.quality = quality;
            // Light that was kept is of another quality.
            self.kept = Default::default();
            #[cfg(feature = "live")]
            {
                self.gatherer = None;
            }
        }
        Ok(())
    }
}

/// What gathers and coarse live solves need of a cloud.
#[cfg(feature = "live")]
pub(super) struct Gatherer {
    /// On the cloud's cells (of rows for those: on the rows' solve grid), read where the asset's light is.
    solver: LiveSolver,
    /// Steps from each solve cell to the nearest with cloud.
    distances: Vec<u8>,
    coarse: Option<Coarse>,
    buffers: GatherBuffers,
    /// Cells whose direct light is scattered on; for coarse solves those beside cloud too, which larger cells are means of.
    wanted: [WantedCells; 2],
    /// The cloud's cells whose light is read.
    read: Vec<bool>,
}

/// A solve in larger cells.
#[cfg(feature = "live")]
struct Coarse {
    solver: LiveSolver,
    /// From cells of the fine solve grid to these.
    index: CoarseIndex,
}

#[cfg(feature = "live")]
impl Gatherer {
    /// Errors: a record that no solver can follow.
    fn new(relighter: &Relighter, live_cells: u32) -> Result<Self, RuntimeError> {
        let (cloud, rows, record) =
            (relighter.cloud(), relighter.light_cloud(), &relighter.response().head.solver);
        let mut read = relighter.known_cells();
        // Live light is needed wherever rays shade, though rows may leave out what their viewers cannot see.
        read.iter_mut().zip(cloud.shaded()).for_each(|(read, shaded)| *read |= shaded);
        let once = |record: &SolverRecord| SolverRecord { refine: [1; 3], ..record.clone() };
        // Cells that rows hold light for in blocks are finer than the rows' own.
        let solver = match relighter.is_coarse() {
            true => LiveSolver::new(cloud, &once(record))?,
            false => super::solve::solver_of(relighter)?,
        };
        let solver = solver.read_in(&read);
        let fine = solver.solve_grid();
        let distances = distances(fine.shape, fine.extinction.iter().map(|&value| value > 0.0));
        let counts = rows.shape.to_array();
        let factor = |axis: usize| (1..=live_cells).rev().find(|&f| counts[axis].is_multiple_of(f as usize));
        let factors = [0, 1, 2].map(|axis| factor(axis).unwrap_or(1));
        let is_whole = factors == [1; 3] && !relighter.is_coarse();
        let coarse = if is_whole {
            None
        } else {
            let large = rows.coarsened(factors)?;
            let shaded = large.shaded();
            let size = |axis: usize| fine.shape.to_array()[axis] / large.shape.to_array()[axis];
            let down = [0, 1, 2].map(|axis| size(axis) as u32);
            let solver = LiveSolver::new(&large, &once(record))?.read_in(&shaded);
            Some(Coarse { solver, index: CoarseIndex::new(fine.shape, down) })
        };
        let wanted = [0, 1].map(|farthest| WantedCells::new(&distances, farthest));
        Ok(Self { solver, distances, coarse, buffers: GatherBuffers::default(), wanted, read })
    }

    /// Adds direct light's moments on the fine solve grid, in cells up to `farthest` steps from cloud.
    fn add_direct(
        &self,
        lights: &[PointLight],
        settings: DirectSettings,
        farthest: usize,
        moments: &mut [[f32; 4]],
    ) {
        let near = (self.solver.solve_grid(), self.solver.extinction_scale(), &self.distances[..]);
        add_direct_moments(near, &self.wanted[farthest], lights, settings, moments);
    }
}

/// How far live light or gathered light came.
#[cfg(feature = "live")]
impl Clouds {
    /// Whether light has to be worked out beyond rows and plain live solves.
    pub(super) fn gathers(&self) -> bool {
        self.quality.gathers > 0
    }

    /// Whether live light is solved for in larger cells than the rows'.
    fn solves_coarsely(&self) -> bool {
        self.quality.live_cells > 1
    }

    /// Live light of `outside`, and gathers over all: what [`Clouds::light_watched`] adds to rows.
    pub(super) fn finish(
        &mut self,
        (inside, outside): (&[PointLight], &[PointLight]),
        watch: &mut dyn FnMut(f64) -> bool,
        light: &mut CloudLight,
    ) -> Result<(), RuntimeError> {
        let coarsely = self.solves_coarsely() && !outside.is_empty();
        if !outside.is_empty() && !coarsely {
            self.solve_outside(outside, watch, light)?;
        }
        if !coarsely && !self.gathers() || inside.is_empty() && outside.is_empty() {
            return Ok(());
        }
        if self.gathers() && !inside.is_empty() {
            check_rows(&self.relighter)?;
        }
        let mut gatherer = match self.gatherer.take() {
            Some(gatherer) => gatherer,
            None => Gatherer::new(&self.relighter, self.quality.live_cells)?,
        };
        let settings = DirectSettings { rays: self.rays.for_gathers(), ..DirectSettings::default() };
        let mut direct = vec![[0.0; 4]; gatherer.solver.solve_grid().shape.len()];
        gatherer.add_direct(outside, settings, usize::from(coarsely), &mut direct);
        let solved = if coarsely { self.solve_coarsely(&gatherer, &direct, watch, light) } else { Ok(()) };
        if solved.is_ok() && self.gathers() {
            gatherer.add_direct(inside, settings, 0, &mut direct);
            self.gather(&mut gatherer, &direct, light);
        }
        self.gatherer = Some(gatherer);
        solved
    }

    /// Solves for `direct`'s light in large cells; it comes out on the rows' grid.
    fn solve_coarsely(
        &self,
        gatherer: &Gatherer,
        direct: &[[f32; 4]],
        watch: &mut dyn FnMut(f64) -> bool,
        light: &mut CloudLight,
    ) -> Result<(), RuntimeError> {
        let Gatherer { coarse, solver, .. } = gatherer;
        let live = match coarse {
            Some(Coarse { solver, index }) => {
                let means = index.means(direct.as_flattened(), 4);
                solver.solve_moments(means.as_chunks::<4>().0, watch)?
            }
            // A grid that no larger cell divides.
            None => solver.solve_moments(direct, watch)?,
        };
        light.live_report = Some(super::LiveReport { sweeps: live.sweeps, residual: live.residual });
        light.live = match coarse {
            Some(coarse) => {
                let rows = self.relighter.light_cloud();
                let from = (coarse.solver.solve_grid(), &live.coefficients[..]);
                spread::<MAX_HARMONICS>(from, (rows, &rows.shaded())).into_flattened()
            }
            None => live.coefficients,
        };
        Ok(())
    }

    /// Gathers over all light, on the cloud's own cells.
    fn gather(&self, gatherer: &mut Gatherer, direct: &[[f32; 4]], light: &mut CloudLight) {
        let rows = self.relighter.light_cloud();
        let mut all = std::mem::take(&mut light.live);
        all.resize(rows.shape.len() * MAX_HARMONICS, 0.0);
        add_rows(light, &mut all);
        let Gatherer { solver, buffers, read, .. } = gatherer;
        let gathers = self.quality.gathers;
        light.gathered = Some(match self.relighter.is_coarse() {
            false => solver.gather(direct, gathers, &mut all, buffers),
            true => {
                let cloud = self.relighter.cloud();
                // What is scattered on has no more than degree 1.
                let start: Vec<[f32; 4]> = spread((rows, &all), (cloud, read));
                let report = solver.gather_from((direct, &start), gathers, &mut all, buffers);
                if report.sweeps == 0 {
                    all = spread::<MAX_HARMONICS>((rows, &all), (cloud, read)).into_flattened();
                }
                report
            }
        });
        light.live = all;
        light.basis = DirectionalBasis::Harmonics { degree: 0 };
        light.planes = vec![0.0; read.len()];
    }
}

/// Refuses rows whose light cannot be scattered on.
#[cfg(feature = "live")]
fn check_rows(relighter: &Relighter) -> Result<(), RuntimeError> {
    let head = &relighter.response().head;
    let refused = |found: &str| {
        let wanted = "0, or an asset whose rows hold light in all directions, without direct light and in all cells with cloud: basis \
                      \"harmonics-1\" or more or \"directions-26\", direct = \"run-time\", no view region";
        Err(RuntimeError::argument("quality.light.gathers", wanted, found))
    };
    match head.basis {
        DirectionalBasis::ViewRegion { .. } => return refused("light towards a view region"),
        DirectionalBasis::Harmonics { degree: 0 } => return refused("light without its direction"),
        _ => {}
    }
    if head.direct == DirectTerm::InRows {
        return refused("direct light in the rows");
    }
    let known = relighter.known_light_cells();
    let dark = |(&extinction, known): (&f32, &bool)| extinction > 0.0 && !known;
    if relighter.light_cloud().extinction.iter().zip(&known).any(dark) {
        return refused("cells with cloud whose light was left out");
    }
    Ok(())
}

/// Adds the rows' J to 16 harmonic coefficients a cell.
#[cfg(feature = "live")]
fn add_rows(light: &CloudLight, coefficients: &mut [f32]) {
    if light.sources == 0 {
        // Nothing of it is from rows, whatever they hold.
        return;
    }
    let cells = coefficients.len() / MAX_HARMONICS;
    let rows = coefficients.as_chunks_mut::<MAX_HARMONICS>().0;
    match light.basis {
        DirectionalBasis::Directions26 => {
            let (directions, weights) = (sphere::directions_26(), sphere::weights_26());
            for (plane, direction) in light.planes.chunks_exact(cells).zip(directions).zip(weights).map(
                |((plane, direction), weight)| {
                    let factor = 4.0 * std::f64::consts::PI * weight;
                    (plane, sphere::harmonics(direction).map(|y| (factor * y) as f32))
                },
            ) {
                for (row, value) in rows.iter_mut().zip(plane) {
                    row.iter_mut().zip(direction).for_each(|(sum, y)| *sum += y * value);
                }
            }
        }
        _ => {
            for (m, plane) in light.planes.chunks_exact(cells).enumerate() {
                rows.iter_mut().zip(plane).for_each(|(row, value)| row[m] += value);
            }
        }
    }
}

/// The first `N` coefficients of a coarse grid's cells, which hold 16, read between their middles in those of `cloud`'s that are read.
#[cfg(feature = "live")]
fn spread<const N: usize>(
    (coarse, coefficients): (&crate::transport::Cloud, &[f32]),
    (cloud, read): (&crate::transport::Cloud, &[bool]),
) -> Vec<[f32; N]> {
    /// Cells that one thread takes at a time.
    const AT_ONCE: usize = 4096;
    let from = coefficients.as_chunks::<MAX_HARMONICS>().0;
    let mut out = vec![[0.0f32; N]; cloud.shape.len()];
    out.par_chunks_mut(AT_ONCE).enumerate().for_each(|(number, values)| {
        for (at, to) in values.iter_mut().enumerate() {
            let cell = number * AT_ONCE + at;
            if !read[cell] {
                continue;
            }
            for (near, weight) in corners(coarse, cloud.centre(cloud.shape.cell(cell))) {
                to.iter_mut().zip(&from[near]).for_each(|(sum, value)| *sum += weight * value);
            }
        }
    });
    out
}
