//! `squall inspect ASSET [--json]`

mod contents;

use super::json;
use super::table::{self, Column};
use glam::DVec3;
use serde_json::{Value, json};
use squall_formats::Tag;
use squall_formats::container::{Entry, FORMAT_VERSION};
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::cloud::CloudSection;
use squall_formats::section::density::{DensitySection, Mode};
use squall_formats::section::place::PlaceSection;
use squall_formats::section::provenance::{BudgetRecord, ProvenanceSection};
use squall_formats::section::rain_place::RainPlaceSection;
use squall_formats::section::response::{
    Codec, DirectTerm, NO_ROW, ResponseHead, ResponseSection, SunDirections,
};
use squall_formats::section::streak::StreakSection;
use squall_formats::section::town::TownSection;
use squall_formats::section::view::ViewSection;
use squall_formats::section::wet_maps::WetMapsSection;
use squall_runtime::relight::share_lit;
use squall_runtime::{Asset, RuntimeError};
use std::fmt::Write;
use std::path::PathBuf;

/// Says what is inside an asset.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// The asset.
    asset: PathBuf,
    /// Print JSON: section table, inputs, budgets, grid, response, strokes, view. docs/json.md says what stands in it.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        self.json
    }
}

/// Only the heads of sections are read, so that the time taken does not depend on the asset's size.
pub fn run(args: Args) -> anyhow::Result<()> {
    let asset = super::asset::open_directory(&args.asset)?;
    let provenance = match asset.directory().find(ProvenanceSection::TAG) {
        Some(_) => Some(asset.section(ProvenanceSection::TAG, "provenance", ProvenanceSection::read)?),
        None => None,
    };
    if args.json {
        let (answer, damage) = in_json(&asset, provenance.as_ref());
        json::answer(&answer)?;
        return damage.map_or(Ok(()), |error| Err(error.into()));
    }
    let (text, damage) = in_words(&asset, provenance.as_ref());
    table::print(&text)?;
    damage.map_or(Ok(()), |error| Err(error.into()))
}

/// The whole answer, and a section that could not be read, if there is one.
fn in_json(asset: &Asset, provenance: Option<&ProvenanceSection>) -> (Value, Option<RuntimeError>) {
    let section = |entry: &Entry| {
        json!({
            "tag": entry.tag.to_string(),
            "version": entry.version,
            "required": entry.required,
            "offset": entry.offset,
            "bytes": entry.length,
            "checksum": format!("{:08x}", entry.checksum),
        })
    };
    let budget = |record: &BudgetRecord| {
        json!({
            "part": record.part,
            "metric": record.metric,
            "asked": record.asked,
            "got": record.got,
            "chosen": record.chosen,
            "next_better": record.next_better,
            "next_cheaper": record.next_cheaper,
        })
    };
    let sections: Vec<Value> = asset.directory().entries.iter().map(section).collect();
    let budgets: Vec<Value> = provenance.iter().flat_map(|p| &p.budgets).map(budget).collect();
    let inputs: Vec<Value> = provenance.iter().flat_map(|p| &p.inputs).map(contents::input).collect();
    let mut damage = None;
    let mut section = |tag: Tag, read: fn(&Asset) -> Result<Value, RuntimeError>| {
        let found = asset.directory().find(tag).map(|_| read(asset));
        found.transpose().unwrap_or_else(|error| {
            damage.get_or_insert(error);
            None
        })
    };
    let answer = json!({
        "command": "inspect",
        "format_version": FORMAT_VERSION,
        "bytes": asset.bytes().len(),
        "tool": provenance.map(|p| &p.tool),
        "recipe_hash": provenance.map(|p| json::hex(&p.recipe_hash)),
        "inputs": inputs,
        "sections": sections,
        "budgets": budgets,
        "grid": section(CloudSection::TAG, contents::grid),
        "response": section(ResponseSection::TAG, contents::response),
        "strokes": section(BoltSection::TAG, contents::strokes),
        "view": section(ViewSection::TAG, contents::view),
    });
    // Sections that the answer does not speak of are read all the same: damage is told in either form.
    let others = asset.directory().entries.iter().find_map(|entry| describe(asset, entry).err());
    (answer, damage.or(others))
}

/// The whole report, and the first section that could not be read.
fn in_words(asset: &Asset, provenance: Option<&ProvenanceSection>) -> (String, Option<RuntimeError>) {
    let (mut text, mut damage) = (String::new(), None);
    let bytes = table::bytes(asset.bytes().len() as u64);
    let _ = writeln!(text, "{}: format {FORMAT_VERSION}, {bytes} bytes", asset.path().display());
    if let Some(provenance) = provenance {
        let tool = table::plain(&provenance.tool);
        let _ = writeln!(text, "baked by {tool} from recipe {}", json::hex(&provenance.recipe_hash));
    }
    let mut sections = Vec::new();
    for entry in &asset.directory().entries {
        let holds = match describe(asset, entry) {
            Ok(holds) => holds,
            Err(error) => {
                let words = "cannot be read".to_owned();
                damage.get_or_insert(error);
                words
            }
        };
        sections.push(vec![
            entry.tag.to_string(),
            entry.version.to_string(),
            if entry.required { "yes" } else { "no" }.to_owned(),
            table::bytes(entry.offset),
            table::bytes(entry.length),
            format!("{:08x}", entry.checksum),
            holds,
        ]);
    }
    let columns = [
        Column::left("section"),
        Column::right("version"),
        Column::left("required"),
        Column::right("offset"),
        Column::right("bytes"),
        Column::left("checksum"),
        Column::left("holds"),
    ];
    let _ = write!(text, "\n{}", table::layout(&columns, &sections));
    if let Some(provenance) = provenance {
        if !provenance.inputs.is_empty() {
            let columns = [Column::left("input"), Column::right("bytes"), Column::left("BLAKE3")];
            let rows = provenance.inputs.iter();
            let rows = rows.map(|i| vec![table::plain(&i.name), table::bytes(i.bytes), json::hex(&i.hash)]);
            let _ = write!(text, "\n{}", table::layout(&columns, &rows.collect::<Vec<_>>()));
        }
        if !provenance.budgets.is_empty() {
            let columns = [
                Column::left("budget"),
                Column::left("metric"),
                Column::right("asked"),
                Column::right("got"),
                Column::left("chosen"),
            ];
            let rows: Vec<_> = provenance.budgets.iter().flat_map(budget_rows).collect();
            let _ = write!(text, "\n{}", table::layout(&columns, &rows));
        }
    }
    (text, damage)
}

/// A budget's line, and one for each neighbouring setting that is noted.
fn budget_rows(record: &BudgetRecord) -> Vec<Vec<String>> {
    let asked = record.asked.map_or("–".into(), table::figure);
    let (part, metric) = (table::plain(&record.part), table::plain(&record.metric));
    let mut rows = vec![vec![part, metric, asked, table::figure(record.got), table::plain(&record.chosen)]];
    for (name, other) in [("next better", &record.next_better), ("next cheaper", &record.next_cheaper)] {
        if let Some(other) = other {
            let blank = String::new;
            rows.push(vec![blank(), blank(), blank(), blank(), format!("{name}: {}", table::plain(other))]);
        }
    }
    rows
}

/// What a section holds, in words.
fn describe(asset: &Asset, entry: &Entry) -> Result<String, RuntimeError> {
    Ok(match entry.tag {
        ProvenanceSection::TAG => {
            let section = asset.section(entry.tag, "provenance", ProvenanceSection::read)?;
            format!("provenance: {} inputs, {} figures", section.inputs.len(), section.budgets.len())
        }
        CloudSection::TAG => {
            let head = asset.section(entry.tag, "the cloud grid", CloudSection::read)?.head;
            let [nx, ny, nz] = head.shape.to_array();
            let [hx, hy, hz] = head.cell_m;
            let edges = if head.periodic_xy { ", periodic in x and y" } else { "" };
            format!(
                "cloud: {nx} × {ny} × {nz} cells of {hx} × {hy} × {hz} m, albedo {}, g {}{edges}",
                head.albedo, head.g
            )
        }
        ResponseSection::TAG => {
            let section = asset.section(entry.tag, "the cloud's response", ResponseSection::read)?;
            describe_response(&section.head)
        }
        BoltSection::TAG => {
            let section = asset.section(entry.tag, "strokes", BoltSection::read)?;
            let names: Vec<_> = section.strokes.iter().map(|stroke| table::plain(&stroke.name)).collect();
            format!("{} strokes: {}", names.len(), names.join(", "))
        }
        DensitySection::TAG => {
            let section = asset.section(entry.tag, "rain density tables", DensitySection::read)?;
            let [low, high] = section.ranges.rate.map(|rate| rate.0);
            format!(
                "rain: {} rates from {low} to {high} mm/h, {} classes of drops",
                section.rates.len(),
                section.table(Mode::Default).classes.len()
            )
        }
        StreakSection::TAG => {
            let section = asset.section(entry.tag, "streak patterns", StreakSection::read)?;
            let terms: usize = section.patterns.iter().map(|pattern| pattern.pattern.terms()).sum();
            format!("streaks: {} patterns, {terms} terms", section.patterns.len())
        }
        PlaceSection::TAG => {
            let [x, y, z] = asset.section(entry.tag, "the place", PlaceSection::read)?.origin_m;
            format!("place: the ground at ({x}, {y}, {z}) m")
        }
        RainPlaceSection::TAG => {
            let place = asset.section(entry.tag, "the place of rain", RainPlaceSection::read)?;
            let map = place.map.map_or_else(
                || "no map".to_owned(),
                |map| {
                    let [nx, ny] = map.size;
                    format!("{nx} × {ny} cells of {} m, to {} mm/h", map.cell_m, map.heaviest_mm_per_h)
                },
            );
            let seen = place.farthest_m.map_or_else(String::new, |far| format!(", seen to {far} m"));
            format!("place of rain: {map}{seen}")
        }
        TownSection::TAG => {
            let town = asset.section(entry.tag, "the ground and what stands on it", TownSection::read)?;
            let hills = if town.hills.is_some() { ", hills" } else { "" };
            let (blocks, roads) = (town.blocks.len(), town.ground.roads.len());
            format!("town: {blocks} blocks, {} lamps, {roads} roads{hills}", town.lamps.len())
        }
        ViewSection::TAG => {
            let view = asset.section(entry.tag, "the view", ViewSection::read)?;
            let [width, height] = view.camera.size_px;
            let (rate, flashes) = (view.rain.rate_mm_per_h, view.flashes.len());
            format!("view: {width} × {height}, {rate} mm/h, {flashes} strokes flash")
        }
        WetMapsSection::TAG => {
            let maps = asset.section(entry.tag, "maps of a scene", WetMapsSection::read)?;
            let cells = maps.height.or(maps.water).map_or_else(
                || "none".to_owned(),
                |map| format!("{} × {} cells of {} m", map.size[0], map.size[1], map.cell_m),
            );
            let (drips, fins) = (maps.drips.ends.len(), maps.fins.ends.len());
            let lightning = maps.lightning.map_or_else(String::new, |volume| {
                let [nx, ny, nz] = volume.size;
                format!(", lightning from {} sides at {nx} × {ny} × {nz} nodes", volume.directions.len())
            });
            format!("maps of a scene: {cells}, {drips} edges drip, {fins} silhouettes{lightning}")
        }
        _ => "unknown to this build".into(),
    })
}

fn describe_response(head: &ResponseHead) -> String {
    let lights = head.sources.light_grid().map_or_else(String::new, |(grid, rows)| {
        let baked = rows.iter().filter(|&&row| row != NO_ROW).count();
        let [x, y, z] = grid.axes().map(<[f64]>::len);
        let lit = match baked == rows.len() {
            true => "not pruned: the whole box is lit".to_owned(),
            false => format!("pruned: {:.1} % of the box is lit", 100.0 * share_lit(&head.sources)),
        };
        let finer = head.finer.iter().enumerate().map(|(level, finer)| {
            let (rows, windows, parts) = (finer.nodes.len(), finer.windows.len(), 2u32 << level);
            format!("{rows} between them 1/{parts} as far apart, in {windows} windows of cells, ")
        });
        let finer: String = finer.collect();
        format!("{baked} of {x} × {y} × {z} virtual lights ({lit}), {finer}")
    });
    let basis = head.basis.name();
    let cells = head.shape.len();
    let seen = match (0..cells).filter(|&cell| head.sees(cell)).count() {
        all if all == cells => String::new(),
        seen => format!(", light in {seen} of {cells} cells"),
    };
    let view_region = head.view_region.as_ref().map_or_else(String::new, |view_region| {
        let [low, high] = [view_region.low_m, view_region.high_m].map(DVec3::from_array);
        format!(", for viewpoints between {low} and {high} m")
    });
    let codec = match head.codec {
        Codec::Paper => "index and value",
        Codec::Bytes => "two bytes a coefficient",
        Codec::Entropy => "entropy-coded",
    };
    let direct = match head.direct {
        DirectTerm::InRows => "direct light inside",
        DirectTerm::AtRunTime => "direct light at run time",
    };
    let [nx, ny, nz] = head.shape.to_array();
    format!(
        "response: {nx} × {ny} × {nz} cells, {lights}{} distant lights{}, {basis}, {codec}, {direct}{seen}{view_region}",
        head.distant.len(),
        sun_in_words(head)
    )
}

/// Where the sun may stand.
fn sun_in_words(head: &ResponseHead) -> String {
    let suns = head.suns();
    let elevation = |sun: &[f64; 3]| libm::asin(sun[2].clamp(-1.0, 1.0)).to_degrees();
    match (&head.sun, suns.as_slice()) {
        (None, _) | (_, []) => String::new(),
        (Some(SunDirections::Rings { elevations_rad, .. }), suns) => {
            let lowest = elevations_rad.first().map_or(0.0, |ring| ring.to_degrees());
            format!(" ({} of the sun, anywhere above {lowest:.1}°)", suns.len())
        }
        (Some(SunDirections::Path), [sun]) => {
            let azimuth = libm::atan2(sun[1], sun[0]).to_degrees();
            format!(" (1 of the sun, at azimuth {azimuth:.1}°, elevation {:.1}°)", elevation(sun))
        }
        (Some(SunDirections::Path), suns) => {
            let (from, to) = (elevation(&suns[0]), elevation(&suns[suns.len() - 1]));
            format!(" ({} of the sun, along a path from elevation {from:.1}° to {to:.1}°)", suns.len())
        }
    }
}
