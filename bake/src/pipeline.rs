//! From a recipe to an asset: each stage makes its sections, and they are assembled once, in file order.

mod blocks;
mod clouds;
mod gathered;
mod rain;
mod rain_map;
mod records;
#[cfg(feature = "meshes")]
mod scene;
mod stage;
mod town;

use crate::error::BakeError;
use crate::progress::Progress;
use crate::provenance;
use crate::recipe::model::Recipe;
use crate::response::cache::ResponseCache;
use squall_formats::container::OutSection;
use squall_formats::section::provenance::ProvenanceSection;
use stage::StageOutput;
pub use stage::StageReport;

/// An asset ready to be written.
pub struct Baked {
    /// Sections in file order.
    pub sections: Vec<OutSection>,
    /// What each stage made.
    pub stages: Vec<StageReport>,
    /// What it was made from, and the figures measured: as in the sections.
    pub provenance: ProvenanceSection,
}

/// Bakes a recipe.
///
/// Errors: an input that is missing or out of range, a method that cannot reach what was asked, an interruption.
pub fn bake(recipe: &Recipe, progress: &dyn Progress) -> Result<Baked, BakeError> {
    bake_with(recipe, None, progress)
}

/// [`bake`], with a cache of rows that were solved before. The asset has the same bytes with any cache and without one.
///
/// Errors: as [`bake`].
pub fn bake_with(
    recipe: &Recipe,
    cache: Option<&ResponseCache>,
    progress: &dyn Progress,
) -> Result<Baked, BakeError> {
    let mut output = rain::rain(recipe, progress)?;
    output.append(town::town(recipe)?);
    output.append(town::scenery(recipe));
    #[cfg(feature = "meshes")]
    output.append(scene::scene(recipe, cache, progress)?);
    output.append(clouds::clouds(recipe, cache, progress)?);
    let StageOutput { mut sections, inputs, budgets, reports } = output;
    let made_from = ProvenanceSection {
        tool: provenance::tool(),
        recipe_hash: provenance::recipe_hash(recipe),
        inputs,
        budgets,
    };
    let mut all = vec![made_from.write()];
    all.append(&mut sections);
    Ok(Baked { sections: all, stages: reports, provenance: made_from })
}
