//! What can be said of a bake before it: whether recipe and inputs are sound, and what the work is likely to take.

use super::super::{json, table};
use super::Args;
use serde_json::{Value, json};
use squall_bake::BakeError;
use squall_bake::estimate::{Estimate, estimate};
use squall_bake::input::picture::read_grey;
use squall_bake::input::scene::read_scene;
use squall_bake::input::town::read_town;
use squall_bake::provenance::{input_records, tool};
use squall_bake::recipe::Recipe;
use std::fmt::Write;
use std::path::Path;

/// Runs `--check` or `--dry-run`. Errors: as a bake's, up to where its work begins.
pub fn run(args: &Args, recipe: &Recipe) -> anyhow::Result<()> {
    let bars = args.common.start()?;
    check(recipe)?;
    let records = input_records(recipe)?;
    let inputs: Vec<Value> = records
        .iter()
        .map(
            |record| json!({ "name": record.name, "bytes": record.bytes, "blake3": json::hex(&record.hash) }),
        )
        .collect();
    let foreseen = estimate(recipe)?;
    let mode = if args.check { "check" } else { "dry-run" };
    if args.json {
        let mut answer = json!({
            "command": "bake",
            "tool": tool(),
            "mode": mode,
            "recipe": args.recipe.to_string_lossy(),
            "inputs": inputs,
        });
        if args.dry_run {
            answer["estimate"] = serde_json::to_value(&foreseen)?;
        }
        return json::answer(&answer);
    }
    let name = args.recipe.display();
    if args.check {
        bars.say(&format!("{name}: sound, with {} inputs", inputs.len()));
        return Ok(());
    }
    bars.finish();
    table::print(&in_words(&args.recipe, inputs.len(), &foreseen))
}

/// Reads every input as a bake would.
fn check(recipe: &Recipe) -> Result<(), BakeError> {
    if let Some(rain) = &recipe.rain {
        rain.pictures.iter().try_for_each(|path| read_grey(path).map(|_| ()))?;
    }
    if let Some(path) = &recipe.town {
        read_town(path)?;
    }
    #[cfg(feature = "meshes")]
    if let Some(scene) = &recipe.scene {
        squall_bake::input::meshes::read_meshes(&scene.file, &squall_scene::Read::default())?;
        if let Some(mask) = &scene.puddles {
            read_grey(&mask.file)?;
        }
    }
    if let Some(clouds) = &recipe.clouds {
        read_scene(&clouds.scene, clouds.optics)?;
    }
    Ok(())
}

fn in_words(recipe: &Path, inputs: usize, foreseen: &Estimate) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "{}: {inputs} inputs; nothing baked", recipe.display());
    if let Some(clouds) = &foreseen.clouds {
        let [nx, ny, nz] = clouds.cells;
        let _ = writeln!(
            text,
            "cloud: {nx} × {ny} × {nz} cells, solved in {} cells and {} directions",
            table::bytes(clouds.solve_cells),
            clouds.directions
        );
        let [gx, gy, gz] = clouds.light_grid;
        let _ = writeln!(
            text,
            "sources: {} of {gx} × {gy} × {gz} virtual lights and {} distant, {} coefficients a cell; {} held-out strokes of {} points",
            clouds.virtual_lights,
            clouds.distant,
            clouds.coefficients,
            clouds.held_out_strokes,
            clouds.held_out_points
        );
        if clouds.chosen_by_budget {
            text.push_str("settings are left to [clouds.budget]: what follows is one bake with the recipe's own, without the search\n");
        }
    }
    if foreseen.streak_pictures > 0 {
        let _ = writeln!(text, "rain: {} pictures of streaks to fit", foreseen.streak_pictures);
    }
    let Estimate { cpu_seconds, seconds, threads, memory_bytes, .. } = foreseen;
    let _ = writeln!(
        text,
        "about {cpu_seconds:.1} s of processor time, {seconds:.1} s on {threads} threads; about {:.0} MB of memory\n\
         (counted work at calibrated prices, not measured here: right within a factor of two)",
        *memory_bytes as f64 / 1e6
    );
    text
}
