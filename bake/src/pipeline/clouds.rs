//! The cloud's part of a bake: settings that the recipe leaves to its budgets are planned, rows baked, the written bytes scored by
//! held-out strokes that the plan did not see.

use super::records::{records, solver_records, sun_record};
use super::stage::{Clock, StageOutput, StageReport};
use super::{blocks, gathered};
use crate::asset::{grid_section, in_memory};
use crate::error::BakeError;
use crate::evaluate::held_out::evaluate;
use crate::evaluate::sun::SunSet;
use crate::evaluate::{Outcome, cost, root_mean_square};
use crate::input::scene::read_scene;
use crate::plan::budget::{Excess, Margins, not_met};
use crate::plan::lights::{Site, in_light_cells};
use crate::plan::sun::held_out_suns;
use crate::plan::{Plan, plan};
use crate::progress::Progress;
use crate::provenance::input_record;
use crate::recipe::model::Recipe;
use crate::response::cache::ResponseCache;
use crate::response::{HeldOutStroke, Job, Sources, bake_response};
use squall_formats::container::OutSection;
use squall_formats::section::provenance::BudgetRecord;
use squall_formats::section::response::{self, ResponseHead};
use squall_runtime::relight::Relighter;

/// Iterations of planning, baking and scoring before a budget is given up; each asks for more than the one before.
const ITERATIONS: usize = 6;

/// Sections of the cloud, if the recipe has one.
///
/// Errors: a scene that is missing or out of range, a budget out of reach, a solve that does not converge, an interruption.
pub(super) fn clouds(
    recipe: &Recipe,
    cache: Option<&ResponseCache>,
    progress: &dyn Progress,
) -> Result<StageOutput, BakeError> {
    let Some(clouds) = &recipe.clouds else { return Ok(StageOutput::default()) };
    let clock = Clock::start();
    let scene = read_scene(&clouds.scene, clouds.optics)?;
    let inputs = scene.inputs.iter().map(|input| input_record(recipe, input)).collect();
    let [nx, ny, nz] = scene.cloud.shape.to_array();
    let made = format!("{nx} × {ny} × {nz} cells");
    let mut grid = clock.report("cloud grid", made, 0, scene.grid_made.clone());
    let light_cells = in_light_cells(recipe, clouds, &scene.cloud)?;
    let mut site = Site::new(recipe, clouds, light_cells.as_ref().unwrap_or(&scene.cloud));
    site.cache = cache;
    site.shown = &scene.cloud;
    let baked = bake_to_budget(&site, progress)?;
    grid.bytes = baked.sections[0].length();
    let reports = std::iter::once(grid).chain(baked.reports).collect();
    Ok(StageOutput { inputs, reports, ..baked })
}

/// Plans, bakes and scores until the budget is met.
fn bake_to_budget(site: &Site<'_>, progress: &dyn Progress) -> Result<StageOutput, BakeError> {
    let budget = &site.clouds.budget;
    let mut margins = Margins::default();
    let mut iteration = 0;
    loop {
        let mut made = Made::new(site, plan_within(site, margins, progress)?, iteration, progress)?;
        iteration += 1;
        if made.held_out.is_empty() && budget.sun_l2.is_none() {
            return made.unmeasured(site, iteration, progress);
        }
        let measured = made.measure(site, iteration, progress)?;
        let excess = Excess::of(budget, &measured);
        if excess.within(Margins::default()) {
            let mut budgets = records(budget, &made.head, &made.plan, &measured);
            budgets.extend(made.blocks_record(site, progress)?);
            budgets.extend(made.gathered_records(progress)?);
            return Ok(made.output(budgets));
        }
        let chosen = made.plan.tried > 0 || excess.sun > 1.0;
        if iteration == ITERATIONS || !chosen {
            return Err(not_met(budget, &measured, &made.plan));
        }
        // Held-out strokes are worse off than those that chose, or rows larger: ask for more, and bake once more.
        margins = margins.tightened(excess);
    }
}

/// A plan, and its line of the closing table where it had to choose.
fn plan_within(
    site: &Site<'_>,
    margins: Margins,
    progress: &dyn Progress,
) -> Result<(Plan, Option<StageReport>), BakeError> {
    let clock = Clock::start();
    let plan = plan(site, margins, progress)?;
    let made = format!("{} settings tried", plan.tried);
    let report = (plan.tried > 0).then(|| clock.report("budgets", made, 0, plan.to_string()));
    Ok((plan, report))
}

/// A response as it was planned and baked.
struct Made {
    plan: Plan,
    head: ResponseHead,
    held_out: Vec<HeldOutStroke>,
    /// Grid and response.
    sections: [OutSection; 2],
    reports: Vec<StageReport>,
}

impl Made {
    /// Bakes rows. Held-out strokes are others in every iteration, counted from 0.
    fn new(
        site: &Site<'_>,
        (plan, planned): (Plan, Option<StageReport>),
        iteration: usize,
        progress: &dyn Progress,
    ) -> Result<Self, BakeError> {
        let clock = Clock::start();
        let (lights, strokes) = site.held_out(plan.spacing_m, iteration)?;
        let mut distant = site.clouds.distant.clone();
        distant.extend(plan.sun.iter().flat_map(|sun| &sun.beams));
        let sources = Sources { lights, distant, sun: plan.sun.as_ref().map(|sun| sun.directions.clone()) };
        let job = Job {
            cloud: site.cloud,
            sources: &sources,
            settings: &plan.settings,
            held_out: &strokes,
            known: None,
            shown: Some(site.shown),
            cache: site.cache,
        };
        let baked = bake_response(&job, progress)?;
        let (sources, coefficients) = (baked.rows.rows.len(), baked.head.basis.count());
        let made = format!("{sources} sources × {coefficients} coefficients a cell, {} kept", baked.kept);
        let section = response::write_beside(&baked.head, baked.rows, site.shown.shape);
        let solver = &baked.head.solver;
        let error = format!("residual {:.1e}, {} sweeps at most", solver.worst_residual, solver.most_sweeps);
        let report = clock.report("cloud response", made, section.length(), error);
        Ok(Self {
            plan,
            head: baked.head,
            held_out: baked.held_out,
            sections: [grid_section(site.shown), section],
            reports: planned.into_iter().chain([report]).collect(),
        })
    }

    /// Relights the held-out strokes from the sections as they will be written; viewpoints of iteration 0 are those that chose.
    fn measure(
        &mut self,
        site: &Site<'_>,
        iteration: usize,
        progress: &dyn Progress,
    ) -> Result<Outcome, BakeError> {
        let clock = Clock::start();
        progress.begin("verification", self.held_out.len() as u64);
        let asset = in_memory(&self.sections)?;
        let relighter = Relighter::new(&asset)?;
        let scores = evaluate(&relighter, &self.held_out, iteration as u64)?;
        let strokes =
            self.held_out.iter().map(|stroke| &stroke.lights).chain(&site.flashes).map(Vec::as_slice);
        let relight_ms = cost::most_ms(&relighter, strokes)?;
        let error = format!(
            "relit L2 {:.2} % from the bytes; stroke L2 {:.1} %, median {:.1} %",
            100.0 * scores.codec.l2,
            100.0 * scores.stroke.l2,
            100.0 * scores.stroke.median
        );
        let made = format!("{} held-out strokes", self.held_out.len());
        self.reports.push(clock.report("verification", made, 0, error));
        let sun_l2 = self.measure_sun(&relighter, site, iteration, progress)?;
        Ok(Outcome { scores, bytes: self.sections[1].length(), relight_ms, sun_l2 })
    }

    /// Error of the written bytes under suns that no beam was baked for; nothing where there are none.
    fn measure_sun(
        &mut self,
        relighter: &Relighter,
        site: &Site<'_>,
        iteration: usize,
        progress: &dyn Progress,
    ) -> Result<Option<f64>, BakeError> {
        let Some(plan) = &self.plan.sun else { return Ok(None) };
        let clock = Clock::start();
        let suns = held_out_suns(site, iteration)?;
        if suns.is_empty() {
            return Ok(None);
        }
        progress.begin("unseen suns", suns.len() as u64);
        let set = SunSet::solve(
            (site.cloud, Some(site.shown)),
            &self.plan.settings,
            &suns,
            (iteration as u64, site.cache),
            progress,
        )?;
        let error = root_mean_square(set.errors(relighter)?);
        let words = format!("L2 {:.2} % under {} unseen suns", 100.0 * error, suns.len());
        self.reports.push(clock.report("sun", plan.to_string(), 0, words));
        Ok(Some(error))
    }

    /// What light on blocks of cells costs: a held-out stroke relit from the bytes, against the same solved on the cells that are shown.
    fn blocks_record(
        &mut self,
        site: &Site<'_>,
        progress: &dyn Progress,
    ) -> Result<Option<BudgetRecord>, BakeError> {
        let Some(stroke) = self.held_out.first().filter(|_| site.shown.shape != site.cloud.shape) else {
            return Ok(None);
        };
        let clock = Clock::start();
        progress.begin("light on blocks of cells", 1);
        let relighter = Relighter::new(&in_memory(&self.sections)?)?;
        let error = blocks::error_of(&relighter, &self.plan.settings, &stroke.lights, progress)?;
        let [nx, ny, nz] = site.cloud.shape.to_array();
        let made = format!("light in {nx} × {ny} × {nz} cells");
        self.reports.push(clock.report(
            "light cells",
            made.clone(),
            0,
            format!("L2 {:.1} % against the shown cells", 100.0 * error),
        ));
        Ok(Some(blocks::record(error, made)))
    }

    /// What a gather or two at run time leave of the error, where virtual lights have finer levels: they are baked for gathers to finish.
    fn gathered_records(&mut self, progress: &dyn Progress) -> Result<Vec<BudgetRecord>, BakeError> {
        if self.head.finer.is_empty() {
            return Ok(Vec::new());
        }
        let clock = Clock::start();
        let asset = in_memory(&self.sections)?;
        let errors = gathered::errors(&asset, (&self.plan.settings, &self.held_out), progress)?;
        let words = gathered::words(&errors);
        let made = format!("{} held-out strokes", self.held_out.len());
        self.reports.push(clock.report("gathers", made, 0, words));
        Ok(gathered::records(&errors))
    }

    /// What a response without held-out strokes leaves behind.
    ///
    /// Errors: the budget has nothing to be confirmed by.
    fn unmeasured(
        mut self,
        site: &Site<'_>,
        iteration: usize,
        progress: &dyn Progress,
    ) -> Result<StageOutput, BakeError> {
        if site.clouds.budget.needs_held_out() {
            return Err(BakeError::NotReached {
                what: "clouds.budget".into(),
                wanted: "held-out strokes to confirm it".into(),
                reached: "none that the virtual lights cover".into(),
                hint: "test_strokes above 0, or strokes in the recipe, would give some".into(),
            });
        }
        let made = "no held-out strokes".to_owned();
        self.reports.push(Clock::start().report("verification", made, 0, "not measured".into()));
        let mut budgets = solver_records(&self.head, &self.plan);
        if self.plan.sun.is_some() {
            let relighter = Relighter::new(&in_memory(&self.sections)?)?;
            let sun_l2 = self.measure_sun(&relighter, site, iteration, progress)?;
            budgets.extend(sun_record(&site.clouds.budget, &self.plan, sun_l2));
        }
        Ok(self.output(budgets))
    }

    fn output(self, budgets: Vec<BudgetRecord>) -> StageOutput {
        StageOutput { sections: self.sections.into(), inputs: Vec::new(), budgets, reports: self.reports }
    }
}
