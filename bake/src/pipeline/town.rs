//! What is stored as it was given: the town, the recipe's picture, its strokes.

use super::stage::{Clock, StageOutput};
use crate::error::BakeError;
use crate::input::json::read_text_input;
use crate::input::town::town_of;
use crate::provenance::input_record;
use crate::recipe::model::Recipe;
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::place::PlaceSection;

/// The town's section, if the recipe names one.
///
/// Errors: a town that is missing or out of range.
pub(super) fn town(recipe: &Recipe) -> Result<StageOutput, BakeError> {
    let Some(path) = &recipe.town else { return Ok(StageOutput::default()) };
    let clock = Clock::start();
    let input = read_text_input(path)?;
    let town = town_of(&input)?;
    let inputs = vec![input_record(recipe, &input.fingerprint())];
    let made = format!("{} blocks, {} street lamps", town.blocks.len(), town.lamps.len());
    let section = town.write();
    let report = clock.report("town", made, section.length(), "as given".into());
    Ok(StageOutput { sections: vec![section], inputs, reports: vec![report], ..StageOutput::default() })
}

/// The recipe's picture, strokes and place.
pub(super) fn scenery(recipe: &Recipe) -> StageOutput {
    let view = recipe.view.iter().map(|view| view.write());
    let strokes =
        (!recipe.strokes.is_empty()).then(|| BoltSection { strokes: recipe.strokes.clone() }.write());
    let place = recipe.place_m.map(|origin_m| PlaceSection { origin_m }.write());
    StageOutput { sections: view.chain(strokes).chain(place).collect(), ..StageOutput::default() }
}
