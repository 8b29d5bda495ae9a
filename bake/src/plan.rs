//! Plans: the recipe says how good is good enough, measured errors and counts of bytes say what is cheapest. No clock decides, so
//! that the same recipe gives the same asset.

pub mod budget;
mod candidates;
pub mod density;
pub mod lights;
mod search;
mod solver;
pub mod streaks;
pub mod sun;

use crate::error::BakeError;
use crate::progress::Progress;
use crate::recipe::model::ResponseSettings;
use crate::response::visibility::stand_apart;
use budget::Margins;
use candidates::setting;
use lights::Site;
use search::Search;
use solver::choose_solver;
use squall_formats::section::provenance::BudgetRecord;
use squall_formats::section::response::DirectionalBasis;
use sun::{SunPlan, plan_sun};

/// What a response is baked by: what the recipe states, and what was chosen where it leaves that to its budget.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Distance between virtual lights, m.
    pub spacing_m: f64,
    /// How rows are solved and stored.
    pub settings: ResponseSettings,
    /// Candidates that were tried; 0 where there was nothing to choose.
    pub tried: usize,
    /// The cheapest candidate that is better, in words.
    pub next_better: Option<String>,
    /// The best candidate that is cheaper, in words.
    pub next_cheaper: Option<String>,
    /// What was chosen of the solver.
    pub solver: Option<BudgetRecord>,
    /// Beams of the sun, where the recipe has one.
    pub sun: Option<SunPlan>,
}

impl std::fmt::Display for Plan {
    /// The setting in words.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&setting(self.spacing_m, self.settings.basis, self.settings.relative_error))
    }
}

/// Decides what the recipe leaves open of its cloud.
///
/// Errors: a basis towards a view region that is too near; a budget that no candidate meets, with the best; a solve that does not
/// converge; an interruption.
pub fn plan(site: &Site<'_>, margins: Margins, progress: &dyn Progress) -> Result<Plan, BakeError> {
    check_view_region(site)?;
    let clouds = site.clouds;
    let mut plan = Plan {
        spacing_m: site.usual_spacing_m(),
        settings: clouds.response,
        tried: 0,
        next_better: None,
        next_cheaper: None,
        solver: None,
        sun: None,
    };
    if let (Some(asked), false) = (clouds.budget.solver_l2, clouds.given.solver) {
        let chosen = choose_solver(site, &plan.settings, asked, progress)?;
        plan.settings = chosen.settings;
        plan.solver = Some(chosen.record);
        plan.tried += chosen.tried;
    }
    if clouds.budget.chooses() {
        let mut search = Search::new(site, &plan.settings, margins);
        let best = search.best(progress)?;
        plan.tried += search.tried();
        plan.spacing_m = best.spacing_m;
        plan.settings.basis = best.basis;
        plan.settings.relative_error = best.error;
        [plan.next_better, plan.next_cheaper] = search.neighbours(&best);
    }
    plan.sun = plan_sun(site, &plan.settings, margins.sun, progress)?;
    Ok(plan)
}

/// A basis towards a view region fits only where that stands apart from the cloud.
fn check_view_region(site: &Site<'_>) -> Result<(), BakeError> {
    let clouds = site.clouds;
    let (DirectionalBasis::ViewRegion { .. }, Some(view_region)) =
        (clouds.response.basis, &clouds.response.view_region)
    else {
        return Ok(());
    };
    if stand_apart(site.cloud, view_region) {
        return Ok(());
    }
    let wanted = format!(
        "harmonics: the box of [{}] is too near the cloud, or the cloud repeats without end",
        clouds.keys.view_region
    );
    let found =
        format!("a basis towards viewpoints between {:?} and {:?} m", view_region.low_m, view_region.high_m);
    let (file, field) = (site.recipe.file.clone(), clouds.keys.basis.into());
    Err(BakeError::Input { file, field, wanted, found })
}
