//! From a recipe to an asset, stage by stage, in the order of the data: inputs, streaks, density, cloud response, sections.

use crate::density::bake_density;
use crate::error::BakeError;
use crate::input::picture::read_grey;
use crate::input::scene::read_scene;
use crate::input::town::read_town;
use crate::progress::Progress;
use crate::recipe::{Clouds, Rain, Recipe};
use crate::response::judge::{Verdict, judge, test_strokes};
use crate::response::{BakedResponse, LampGrid, LampSpacing, Sources, bake_response, lamp_grid};
use crate::streak;
use glam::DVec3;
use squall_formats::container::{self, OutSection};
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::cloud::{CloudHead, CloudSection};
use squall_formats::section::density::DensitySection;
use squall_formats::section::provenance::{BudgetRecord, InputRecord, ProvenanceSection};
use squall_formats::section::response;
use squall_formats::section::streak::{StreakPattern, StreakSection};
use squall_runtime::Asset;
use squall_runtime::relight::{LampPoint, Relighter};
use squall_runtime::stroke::Stroke;
use squall_runtime::transport::{Boundary, Cloud};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// One line of the closing table.
#[derive(Clone, Debug, PartialEq)]
pub struct StageReport {
    /// Which stage.
    pub stage: &'static str,
    /// What it made, in words.
    pub made: String,
    /// Wall-clock seconds; never inside the asset.
    pub seconds: f64,
    /// Bytes in the asset.
    pub bytes: u64,
    /// Its error, in words with unit.
    pub error: String,
}

/// An asset ready to be written.
pub struct Baked {
    /// Sections in file order.
    pub sections: Vec<OutSection>,
    /// What each stage made.
    pub stages: Vec<StageReport>,
}

/// A stage's clock.
struct Stage(Instant);

impl Stage {
    fn done(self, stage: &'static str, made: String, bytes: u64, error: String) -> StageReport {
        StageReport { stage, made, seconds: self.0.elapsed().as_secs_f64(), bytes, error }
    }
}

/// Bakes a recipe.
///
/// Errors: an input that is missing or out of range, a method that cannot reach what was asked, an interruption.
pub fn bake(recipe: &Recipe, progress: &dyn Progress) -> Result<Baked, BakeError> {
    let mut provenance = ProvenanceSection {
        tool: format!("squall {}", env!("CARGO_PKG_VERSION")),
        recipe_hash: *blake3::hash(recipe.text.as_bytes()).as_bytes(),
        inputs: Vec::new(),
        budgets: Vec::new(),
    };
    let (mut sections, mut stages) = (Vec::new(), Vec::new());
    if let Some(rain) = &recipe.rain {
        bake_rain(recipe, rain, &mut provenance, &mut sections, &mut stages, progress)?;
    }
    if let Some(path) = &recipe.town {
        let start = Stage(Instant::now());
        let town = read_town(path)?;
        record(recipe, path, &mut provenance)?;
        let made = format!("{} blocks, {} lamps", town.blocks.len(), town.lamps.len());
        let section = town.write();
        stages.push(start.done("town", made, section.length(), "as given".into()));
        sections.push(section);
    }
    if let Some(view) = &recipe.view {
        sections.push(view.write());
    }
    if !recipe.strokes.is_empty() {
        sections.push(BoltSection { strokes: recipe.strokes.clone() }.write());
    }
    let mut tests = None;
    if let Some(clouds) = &recipe.clouds {
        tests = Some(bake_clouds(recipe, clouds, &mut provenance, &mut sections, &mut stages, progress)?);
    }
    if let Some(tests) = tests {
        let start = Stage(Instant::now());
        progress.begin("verification", tests.tests.len() as u64);
        let verdict = verify_response(&sections, &tests)?;
        report_response(verdict, &tests, &mut provenance);
        let error = format!(
            "relit L2 {:.2} % from the bytes; stroke L2 {:.1} %, median {:.1} %",
            100.0 * verdict.codec.l2,
            100.0 * verdict.stroke.l2,
            100.0 * verdict.stroke.median
        );
        stages.push(start.done("verification", format!("{} unseen strokes", tests.tests.len()), 0, error));
    }
    sections.insert(0, provenance.write());
    Ok(Baked { sections, stages })
}

/// Records a file's length and hash under the name that the recipe gives it.
fn record(recipe: &Recipe, path: &Path, provenance: &mut ProvenanceSection) -> Result<(), BakeError> {
    let bytes = std::fs::read(path).map_err(BakeError::io(path, "read"))?;
    let folder = recipe.file.parent().unwrap_or(Path::new(""));
    let name = path.strip_prefix(folder).unwrap_or(path).display().to_string();
    let hash = *blake3::hash(&bytes).as_bytes();
    provenance.inputs.push(InputRecord { name, bytes: bytes.len() as u64, hash });
    Ok(())
}

fn bake_rain(
    recipe: &Recipe,
    rain: &Rain,
    provenance: &mut ProvenanceSection,
    sections: &mut Vec<OutSection>,
    stages: &mut Vec<StageReport>,
    progress: &dyn Progress,
) -> Result<(), BakeError> {
    if !rain.pictures.is_empty() {
        let start = Stage(Instant::now());
        progress.begin("streaks", rain.pictures.len() as u64);
        let patterns = fit_streaks(rain, progress)?;
        for path in &rain.pictures {
            record(recipe, path, provenance)?;
        }
        let worst = patterns.iter().map(|p| p.psnr_db).fold(f64::INFINITY, f64::min);
        let mean = patterns.iter().map(|p| p.psnr_db).sum::<f64>() / patterns.len() as f64;
        provenance.budgets.push(BudgetRecord {
            part: "streaks".into(),
            metric: "mean PSNR after quantisation, dB".into(),
            asked: None,
            got: mean,
            chosen: format!("{}, {} cosines", rain.fit.method.name(), rain.fit.cosines),
            next_better: None,
            next_cheaper: None,
        });
        let made = format!("{} patterns of {} cosines", patterns.len(), rain.fit.cosines);
        let section = StreakSection { patterns };
        let section = OutSection::small(StreakSection::TAG, StreakSection::VERSION, false, section.write());
        let error = format!("PSNR {mean:.1} dB, worst {worst:.1} dB");
        stages.push(start.done("streaks", made, section.length(), error));
        sections.push(section);
    }
    let start = Stage(Instant::now());
    progress.begin("density tables", 1);
    let density = bake_density(&rain.density)?;
    progress.advance(1);
    provenance.budgets.push(BudgetRecord {
        part: "density".into(),
        metric: "largest relative error of a class's count between nodes".into(),
        asked: Some(rain.density.relative_error),
        got: density.measured_error,
        chosen: format!("{} classes", rain.density.classes),
        next_better: None,
        next_cheaper: None,
    });
    let section = density.to_section();
    let error = format!("counts within {:.4} %", 100.0 * density.measured_error);
    let made = format!("{} classes, {} modes", rain.density.classes, 3);
    stages.push(start.done("density tables", made, section.length(), error));
    let _: &DensitySection = &density;
    sections.push(section);
    Ok(())
}

fn fit_streaks(rain: &Rain, progress: &dyn Progress) -> Result<Vec<StreakPattern>, BakeError> {
    use rayon::prelude::*;
    let fitted: Vec<Result<StreakPattern, BakeError>> = rain
        .pictures
        .par_iter()
        .map(|path: &PathBuf| {
            progress.check()?;
            let picture = read_grey(path)?;
            let pattern =
                streak::fit(&streak::Source { file: path, picture: &picture, notes: None }, rain.fit)?;
            progress.advance(1);
            Ok(pattern)
        })
        .collect();
    fitted.into_iter().collect()
}

fn bake_clouds(
    recipe: &Recipe,
    clouds: &Clouds,
    provenance: &mut ProvenanceSection,
    sections: &mut Vec<OutSection>,
    stages: &mut Vec<StageReport>,
    progress: &dyn Progress,
) -> Result<BakedResponse, BakeError> {
    let start = Stage(Instant::now());
    let scene = read_scene(&clouds.scene, clouds.optics)?;
    record(recipe, &clouds.scene, provenance)?;
    for path in &scene.inputs {
        record(recipe, path, provenance)?;
    }
    let cloud = &scene.cloud;
    let grid = CloudSection {
        head: CloudHead {
            shape: cloud.shape,
            cell_m: cloud.cell_m,
            origin_m: cloud.origin_m.to_array(),
            albedo: cloud.albedo,
            g: cloud.g,
            periodic_xy: cloud.boundary == Boundary::PeriodicXy,
        },
        extinction: &cloud.extinction,
    }
    .write();
    let [nx, ny, nz] = cloud.shape.to_array();
    let made = format!("{nx} × {ny} × {nz} cells");
    stages.push(start.done("cloud grid", made, grid.length(), "as given".into()));
    sections.push(grid);

    let start = Stage(Instant::now());
    let lamps = place_lamps(recipe, clouds, cloud)?;
    let reach = [
        DVec3::new(lamps.x_m[0], lamps.y_m[0], lamps.z_m[0]),
        DVec3::new(last(&lamps.x_m), last(&lamps.y_m), last(&lamps.z_m)),
    ];
    let spacing = 0.5 * clouds.lamps.spacing_m;
    let usable = |point: DVec3| touches_wanted(&lamps, point);
    let strokes = test_strokes(cloud, reach, usable, spacing, clouds.test_strokes as usize);
    let sources = Sources { lamps, distant: clouds.distant.clone() };
    let mut baked = bake_response(cloud, &sources, &clouds.response, &strokes, progress)?;
    let rows = std::mem::take(&mut baked.rows);
    let count = rows.rows.len();
    let section = response::write(&baked.head, rows);
    let channels = baked.head.channels.count();
    let made = format!("{count} sources × {channels} channels, {} coefficients", baked.kept);
    let error = format!(
        "residual {:.1e}, {} sweeps at most",
        baked.head.solver.worst_residual, baked.head.solver.most_sweeps
    );
    stages.push(start.done("cloud response", made, section.length(), error));
    sections.push(section);
    Ok(baked)
}

fn last(axis: &[f64]) -> f64 {
    axis.last().copied().unwrap_or(0.0)
}

/// The lamp grid of a recipe, over the reach that it names or the cloud's box down to its strokes' lowest point.
fn place_lamps(recipe: &Recipe, clouds: &Clouds, cloud: &Cloud) -> Result<LampGrid, BakeError> {
    let strokes: Vec<LampPoint> =
        recipe.strokes.iter().flat_map(|record| Stroke::grow(record).lamps(0.0)).collect();
    let (mut low, mut high) = (cloud.origin_m, cloud.far_corner());
    for lamp in &strokes {
        low = low.min(lamp.position);
        high = high.max(lamp.position);
    }
    let low = clouds.lamps.low_m.map_or(low, DVec3::from_array);
    let high = clouds.lamps.high_m.map_or(high, DVec3::from_array);
    let occupied = cloud.extinction.iter().position(|&e| e > 0.0);
    let base = occupied
        .map_or(cloud.origin_m.z, |at| cloud.origin_m.z + cloud.shape.cell(at)[2] as f64 * cloud.cell_m[2]);
    let size = high - low;
    let base_m =
        if clouds.lamps.spacing_m > 0.0 { clouds.lamps.spacing_m } else { size.max_element() / 12.0 };
    let nodes = (size / base_m).ceil() + DVec3::ONE;
    if nodes.x * nodes.y * nodes.z > MAX_LAMPS {
        let wanted = format!("at most {MAX_LAMPS} virtual lamps");
        let found = format!("about {} × {} × {}", nodes.x, nodes.y, nodes.z);
        return Err(BakeError::input(&recipe.file, "clouds.lightning.spacing_m", wanted, found));
    }
    let spacing =
        LampSpacing { base_m, epsilon: clouds.lamps.epsilon_per_m2, longest_m: clouds.lamps.longest_m };
    let mut grid = lamp_grid(low, high, base, spacing);
    if clouds.lamps.prune {
        grid.wanted = vec![false; grid.len()];
        for lamp in &strokes {
            for node in grid.around(lamp.position).into_iter().flatten() {
                grid.wanted[node] = true;
            }
        }
    }
    Ok(grid)
}

/// More virtual lamps than this would take days: a typing error in the spacing, most likely.
const MAX_LAMPS: f64 = 2e6;

/// Whether a lamp at `point` splits over nodes that are baked.
fn touches_wanted(grid: &LampGrid, point: DVec3) -> bool {
    grid.around(point)
        .is_some_and(|nodes| grid.wanted.is_empty() || nodes.iter().all(|&node| grid.wanted[node]))
}

/// Relights the test strokes from the sections as they will be written.
fn verify_response(sections: &[OutSection], baked: &BakedResponse) -> Result<Verdict, BakeError> {
    let mut bytes = Vec::new();
    container::write(&mut bytes, sections).map_err(BakeError::io(Path::new("(memory)"), "write"))?;
    let asset = Asset::from_bytes(&bytes)?;
    let relighter = Relighter::new(&asset)?;
    judge(&relighter, &baked.tests)
}

fn report_response(verdict: Verdict, baked: &BakedResponse, provenance: &mut ProvenanceSection) {
    let mut report = |part: &str, metric: &str, got: f64, chosen: &str| {
        provenance.budgets.push(BudgetRecord {
            part: part.into(),
            metric: metric.into(),
            asked: None,
            got,
            chosen: chosen.into(),
            next_better: None,
            next_cheaper: None,
        });
    };
    let codec = format!("{:?}", baked.head.codec);
    report(
        "response codec",
        "relit L2 on unseen strokes, against the same rows uncompressed",
        verdict.codec.l2,
        &codec,
    );
    report(
        "response codec",
        "99.9th percentile of the relit error, over the peak",
        verdict.codec.tail,
        &codec,
    );
    report("response codec", "median pointwise relit error", verdict.codec.median, &codec);
    let response::SourceBasis::LampGrid { x_m, y_m, z_m, .. } = &baked.head.sources;
    let grid = format!("{} × {} × {} lamps", x_m.len(), y_m.len(), z_m.len());
    report(
        "lightning grid",
        "stroke L2 over 26 directions, against the stroke solved directly",
        verdict.stroke.l2,
        &grid,
    );
    report("lightning grid", "median pointwise stroke error", verdict.stroke.median, &grid);
    let solver = format!("{:?} {:?}", baked.head.solver.directions, baked.head.solver.scheme);
    report("transport", "largest residual", baked.head.solver.worst_residual, &solver);
}
