//! The cloud's part of a bake: settings that the recipe leaves to its budgets are chosen, rows baked, the written bytes judged by
//! strokes that the choice did not see.

use super::{Stage, StageReport, record};
use crate::budget::clouds::{Choice, Margins, STROKES, choose};
use crate::budget::cost;
use crate::candidate::grid_section;
use crate::error::BakeError;
use crate::input::scene::read_scene;
use crate::progress::Progress;
use crate::recipe::{Clouds, Recipe};
use crate::response::evaluate::{Scores, evaluate, shifted_strokes, test_strokes};
use crate::response::{BakedResponse, LightSpacing, Sources, WantedLights, bake_response, light_grid};
use glam::DVec3;
use squall_formats::container::{self, OutSection};
use squall_formats::section::provenance::{BudgetRecord, ProvenanceSection};
use squall_formats::section::response;
use squall_runtime::Asset;
use squall_runtime::relight::{PointLight, Relighter};
use squall_runtime::stroke::Stroke;
use squall_runtime::transport::Cloud;
use std::path::Path;
use std::time::Instant;

/// Rounds of choosing, baking and judging before a budget is given up; each asks for more than the one before.
const ROUNDS: usize = 6;
/// How much further than the last figures tell the second and later rounds aim.
const TIGHTER: f64 = 0.985;

pub(super) fn bake_clouds(
    recipe: &Recipe,
    clouds: &Clouds,
    provenance: &mut ProvenanceSection,
    sections: &mut Vec<OutSection>,
    stages: &mut Vec<StageReport>,
    progress: &dyn Progress,
) -> Result<(), BakeError> {
    let start = Stage(Instant::now());
    let scene = read_scene(&clouds.scene, clouds.optics)?;
    record(recipe, &clouds.scene, provenance)?;
    for path in &scene.inputs {
        record(recipe, path, provenance)?;
    }
    let cloud = &scene.cloud;
    let grid = grid_section(cloud);
    let [nx, ny, nz] = cloud.shape.to_array();
    let made = format!("{nx} × {ny} × {nz} cells");
    stages.push(start.done("cloud grid", made, grid.length(), "as given".into()));
    sections.push(grid);

    let mut margins = Margins { errors: 1.0, costs: 1.0 };
    let done = stages.len();
    for round in 1.. {
        let start = Stage(Instant::now());
        let choice = choose(recipe, clouds, cloud, margins, progress)?;
        // What an earlier round made is gone.
        stages.truncate(done);
        if choice.tried > 0 {
            let made = format!("{} settings tried", choice.tried);
            stages.push(start.done("budgets", made, 0, choice.words()));
        }
        let start = Stage(Instant::now());
        let lights = place_lights(recipe, clouds, cloud, choice.spacing_m)?;
        // Behind the strokes that choose, and in every round others.
        let count = clouds.test_strokes as usize;
        let first = if clouds.budget.judges() { STROKES[1] + (round - 1) * count } else { 0 };
        let strokes = strokes_for(recipe, clouds, cloud, &lights, choice.spacing_m, first..first + count);
        let sources = Sources { lights, distant: clouds.distant.clone() };
        let mut baked = bake_response(cloud, &sources, &choice.settings, &strokes, progress)?;
        let rows = std::mem::take(&mut baked.rows);
        let made = format!(
            "{} sources × {} channels, {} coefficients",
            rows.rows.len(),
            baked.head.basis.count(),
            baked.kept
        );
        let section = response::write(&baked.head, rows);
        let solver = &baked.head.solver;
        let error = format!("residual {:.1e}, {} sweeps at most", solver.worst_residual, solver.most_sweeps);
        stages.push(start.done("cloud response", made, section.length(), error));
        let section_bytes = section.length();
        sections.push(section);

        if baked.tests.is_empty() {
            if clouds.budget.judges() {
                return Err(BakeError::NotReached {
                    what: "clouds.budget".into(),
                    wanted: "unseen strokes to judge by".into(),
                    reached: "none that the lamps reach".into(),
                    hint: "test_strokes above 0, or strokes in the recipe, would give some".into(),
                });
            }
            let words = "no unseen strokes".to_owned();
            stages.push(Stage(Instant::now()).done("verification", words, 0, "not measured".into()));
            report_solver(&baked, &choice, provenance);
            return Ok(());
        }
        let start = Stage(Instant::now());
        progress.begin("verification", baked.tests.len() as u64);
        let (scores, relight_ms) = verify(recipe, sections, &baked, round as u64)?;
        let error = format!(
            "relit L2 {:.2} % from the bytes; stroke L2 {:.1} %, median {:.1} %",
            100.0 * scores.codec.l2,
            100.0 * scores.stroke.l2,
            100.0 * scores.stroke.median
        );
        stages.push(start.done("verification", format!("{} unseen strokes", baked.tests.len()), 0, error));
        let over = clouds.budget.over(&scores);
        let cost = (section_bytes, relight_ms);
        let over_cost = clouds.budget.over_cost(section_bytes, relight_ms);
        if over <= 1.0 && over_cost <= 1.0 {
            report(scores, cost, &baked, clouds, &choice, provenance);
            return Ok(());
        }
        if round == ROUNDS || choice.tried == 0 {
            return Err(not_met(clouds, &scores, cost, &choice));
        }
        // Unseen strokes are worse off than those that chose, or rows larger: ask for more, and bake once more.
        if over > 1.0 {
            margins.errors *= TIGHTER / over;
        }
        if over_cost > 1.0 {
            margins.costs *= TIGHTER / over_cost;
        }
        sections.pop();
    }
    Ok(())
}

fn not_met(clouds: &Clouds, scores: &Scores, (bytes, ms): (u64, f64), choice: &Choice) -> BakeError {
    let asked = |name: &str, value: Option<f64>| value.map(|v| format!("{name} {v}"));
    let budget = &clouds.budget;
    let most = budget.bytes.map(|bytes| format!("{bytes} bytes"));
    let wanted = [
        asked("stroke_l2", budget.stroke_l2),
        asked("relit_l2", budget.relit_l2),
        most,
        asked("relight_ms", budget.relight_ms),
    ];
    BakeError::NotReached {
        what: "clouds.budget on unseen strokes".into(),
        wanted: wanted.into_iter().flatten().collect::<Vec<_>>().join(" and "),
        reached: format!(
            "stroke_l2 {:.4}, relit_l2 {:.4}, {bytes} bytes, relight_ms {ms:.3} with {}",
            scores.stroke.l2,
            scores.codec.l2,
            choice.words()
        ),
        hint: "ask for less, or leave more of spacing_m, channels and error to the budget".into(),
    }
}

/// Relights the test strokes from the sections as they will be written; eyes of round 0 are those that chose.
fn verify(
    recipe: &Recipe,
    sections: &[OutSection],
    baked: &BakedResponse,
    round: u64,
) -> Result<(Scores, f64), BakeError> {
    let mut bytes = Vec::new();
    container::write(&mut bytes, sections).map_err(BakeError::io(Path::new("(memory)"), "write"))?;
    let asset = Asset::from_bytes(&bytes)?;
    let relighter = Relighter::new(&asset)?;
    let flashes = cost::flashes(recipe);
    let strokes = baked.tests.iter().map(|test| &test.lights).chain(&flashes).map(Vec::as_slice);
    Ok((evaluate(&relighter, &baked.tests, round)?, cost::most_ms(&relighter, strokes)?))
}

/// Strokes of the given numbers that try or judge a response: the recipe's own, moved, where lamps were pruned to those; else
/// grown at random in the reach. A number always gives the same stroke, if it gives one.
pub(crate) fn strokes_for(
    recipe: &Recipe,
    clouds: &Clouds,
    cloud: &Cloud,
    lights: &WantedLights,
    spacing_m: f64,
    numbers: std::ops::Range<usize>,
) -> Vec<Vec<PointLight>> {
    let reach = lights.grid.bounds().map(DVec3::from_array);
    let usable = |point: DVec3| lights.reaches(point);
    if clouds.lights.prune {
        let own: Vec<Vec<PointLight>> = recipe.strokes.iter().map(|r| Stroke::grow(r).lights(0.0)).collect();
        shifted_strokes(&own, usable, 0.5 * spacing_m, numbers)
    } else {
        // Their points lie no closer where lamps do: strokes are the same for every spacing.
        let spacing_m =
            if clouds.given.spacing { 0.5 * spacing_m } else { (reach[1] - reach[0]).max_element() / POINTS };
        test_strokes(cloud, reach, usable, spacing_m, numbers)
    }
}

/// Points along the reach's longest side of strokes grown at random, where the recipe states no spacing.
const POINTS: f64 = 24.0;

/// The box that lamps have to fill: as the recipe names it, or the cloud's own down to the strokes' lowest point.
pub(crate) fn reach_of(recipe: &Recipe, clouds: &Clouds, cloud: &Cloud) -> [DVec3; 2] {
    let (mut low, mut high) = (cloud.origin_m, cloud.far_corner());
    for light in recipe.strokes.iter().flat_map(|record| Stroke::grow(record).lights(0.0)) {
        low = low.min(light.position);
        high = high.max(light.position);
    }
    [clouds.lights.low_m.map_or(low, DVec3::from_array), clouds.lights.high_m.map_or(high, DVec3::from_array)]
}

/// The lamp grid of a recipe at a spacing, m.
pub(crate) fn place_lights(
    recipe: &Recipe,
    clouds: &Clouds,
    cloud: &Cloud,
    spacing_m: f64,
) -> Result<WantedLights, BakeError> {
    let [low, high] = reach_of(recipe, clouds, cloud);
    let occupied = cloud.extinction.iter().position(|&e| e > 0.0);
    let base = occupied
        .map_or(cloud.origin_m.z, |at| cloud.origin_m.z + cloud.shape.cell(at)[2] as f64 * cloud.cell_m[2]);
    let size = high - low;
    let nodes = (size / spacing_m).ceil() + DVec3::ONE;
    if nodes.x * nodes.y * nodes.z > MAX_LIGHTS {
        let wanted = format!("at most {MAX_LIGHTS} virtual lamps");
        let found = format!("about {} × {} × {}", nodes.x, nodes.y, nodes.z);
        return Err(BakeError::input(&recipe.file, "clouds.lightning.spacing_m", wanted, found));
    }
    let spacing = LightSpacing {
        base_m: spacing_m,
        epsilon: clouds.lights.epsilon_per_m2,
        longest_m: clouds.lights.longest_m,
    };
    let mut grid = light_grid(low, high, base, spacing);
    if clouds.lights.prune {
        grid.wanted = vec![false; grid.len()];
        for light in recipe.strokes.iter().flat_map(|record| Stroke::grow(record).lights(0.0)) {
            for node in grid.around(light.position).into_iter().flatten() {
                grid.wanted[node] = true;
            }
        }
    }
    Ok(grid)
}

/// More virtual lamps than this would take days: a typing error in the spacing, most likely.
const MAX_LIGHTS: f64 = 2e6;

/// Writes down what was asked, got and chosen.
fn report(
    scores: Scores,
    (bytes, relight_ms): (u64, f64),
    baked: &BakedResponse,
    clouds: &Clouds,
    choice: &Choice,
    provenance: &mut ProvenanceSection,
) {
    let mut add = |part: &str, metric: &str, asked: Option<f64>, got: f64, chosen: &str, neighbours: bool| {
        provenance.budgets.push(BudgetRecord {
            part: part.into(),
            metric: metric.into(),
            asked,
            got,
            chosen: chosen.into(),
            next_better: choice.next_better.clone().filter(|_| neighbours),
            next_cheaper: choice.next_cheaper.clone().filter(|_| neighbours),
        });
    };
    let budget = &clouds.budget;
    let name = match baked.head.codec {
        response::Codec::Bytes => "bytes",
        response::Codec::Paper => "paper",
    };
    let codec = format!("codec {name}, error {:.3e}", choice.settings.relative_error);
    let codec_error = scores.codec;
    let chose_codec = budget.relit_l2.is_some() && budget.stroke_l2.is_none();
    let metric = "relit L2 on unseen strokes, against the same rows uncompressed";
    add("response codec", metric, budget.relit_l2, codec_error.l2, &codec, chose_codec);
    let metric = "99.9th percentile of the relit error, over the peak";
    add("response codec", metric, None, codec_error.tail, &codec, false);
    add("response codec", "median pointwise relit error", None, codec_error.median, &codec, false);
    let (nodes, baked_lights) = baked.head.sources.light_grid().map_or(([0; 3], 0), |(grid, rows)| {
        let baked = rows.iter().filter(|&&row| row != response::NO_ROW).count();
        (grid.axes().map(<[f64]>::len), baked)
    });
    let grid = format!(
        "{baked_lights} of {} × {} × {} lamps, {} channels",
        nodes[0],
        nodes[1],
        nodes[2],
        baked.head.basis.count()
    );
    let views = if baked.head.view_region.is_some() { "unseen eyes" } else { "26 directions" };
    let metric = format!("stroke L2 over {views}, against the stroke solved directly");
    add("lightning grid", &metric, budget.stroke_l2, scores.stroke.l2, &grid, budget.stroke_l2.is_some());
    add("lightning grid", "median pointwise stroke error", None, scores.stroke.median, &grid, false);
    let alone = budget.stroke_l2.is_none() && budget.relit_l2.is_none() && budget.chooses();
    if let Some(most) = budget.bytes {
        add("response", "bytes", Some(most as f64), bytes as f64, &choice.words(), alone);
    }
    let metric = "relighting the most that flashes at once, on one core, ms as counted (docs/recipe.md)";
    add(
        "relighting",
        metric,
        budget.relight_ms,
        relight_ms,
        &choice.words(),
        alone && budget.bytes.is_none(),
    );
    let [seen, cells] = cells_seen(&baked.head);
    if seen < cells {
        let (chosen, got) = (format!("{seen} of {cells} cells hold light"), seen as f64 / cells as f64);
        let view_region = if baked.head.view_region.is_some() { "an eye of the recipe" } else { "any eye" };
        let metric = format!("share of cells that {view_region} can shade with");
        add("cells", &metric, None, got, &chosen, false);
    }
    report_solver(baked, choice, provenance);
}

/// Cells whose light means something, and all.
fn cells_seen(head: &response::ResponseHead) -> [usize; 2] {
    let cells = head.shape.len();
    [(0..cells).filter(|&cell| head.sees(cell)).count(), cells]
}

fn report_solver(baked: &BakedResponse, choice: &Choice, provenance: &mut ProvenanceSection) {
    let record = &baked.head.solver;
    let solver = format!(
        "refinement {}, {} directions, {} scheme",
        choice.settings.refine,
        choice.settings.solve.quadrature.ordinates().map_or(0, |set| set.len()),
        format!("{:?}", record.scheme).to_lowercase()
    );
    provenance.budgets.push(BudgetRecord {
        part: "transport".into(),
        metric: "largest residual".into(),
        asked: Some(record.tolerance),
        got: record.worst_residual,
        chosen: solver,
        next_better: None,
        next_cheaper: None,
    });
    if let Some(chosen) = &choice.solver {
        provenance.budgets.push(chosen.clone());
    }
}
