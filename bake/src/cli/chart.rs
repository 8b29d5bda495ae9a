//! `squall chart RECIPE -o DIR [--quick]`

mod page;
mod svg;

use super::common::Common;
use super::folder::{OutputFolder, check_apart};
use super::progress::Bars;
use squall_bake::BakeError;
use squall_bake::chart::{CHARTS, Peers, Row, Sweep, sweep};
use squall_bake::input::read_json;
use squall_bake::output::{pending, write_atomically};
use squall_bake::recipe::Recipe;
use std::io::Write;
use std::path::PathBuf;

/// Plots error against cost, knob by knob: data.csv, data.json, an SVG a chart and one page that shows all of it.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// The recipe, TOML.
    recipe: PathBuf,
    /// Folder for the results; made if missing.
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Fewer settings on smaller scenes: minutes instead of an hour.
    #[arg(long)]
    quick: bool,
    /// Only these charts; several with commas between them.
    #[arg(long, value_name = "IDS", value_delimiter = ',', value_parser = id)]
    only: Vec<String>,
    /// Goes on where an interrupted sweep of the same recipe into the same folder ended.
    #[arg(long, conflicts_with = "redraw")]
    resume: bool,
    /// Sweeps nothing, and draws again what an earlier sweep left in the folder's data.json.
    #[arg(long, conflicts_with_all = ["quick", "only", "reference", "peers"])]
    redraw: bool,
    /// Folder of independent reference data (fields, streak pictures), for the series that have it as their truth.
    #[arg(long, value_name = "DIR")]
    reference: Option<PathBuf>,
    /// Python script that codes rows with outside codecs, for the chart compression: data/peers/compress.py knows zfp and SZ3,
    /// and leaves out what is not installed.
    #[arg(long, value_name = "SCRIPT")]
    peers: Option<PathBuf>,
    #[command(flatten)]
    common: Common,
}

fn id(text: &str) -> Result<String, String> {
    let known: Vec<&str> = CHARTS.iter().map(|(id, _)| *id).collect();
    if known.contains(&text) { Ok(text.into()) } else { Err(format!("wanted one of {}", known.join(", "))) }
}

pub fn run(args: Args) -> anyhow::Result<()> {
    let start = std::time::Instant::now();
    let recipe = Recipe::read(&args.recipe)?;
    if let Some(folder) = &args.reference
        && !folder.join("clouds/scenes").is_dir()
    {
        let wanted = "a folder with clouds/scenes, clouds/fields and streaks";
        return Err(BakeError::input(folder, "--reference", wanted, "none of these").into());
    }
    let names = CHARTS.iter().flat_map(|(id, _)| [format!("{id}.svg"), format!("{id}-card.svg")]);
    let names: Vec<String> = names.collect();
    let names: Vec<&str> =
        names.iter().map(String::as_str).chain(["data.csv", "data.json", "index.html"]).collect();
    let outputs: Vec<PathBuf> = names.iter().map(|name| args.out.join(name)).collect();
    check_apart(
        &outputs.iter().map(PathBuf::as_path).collect::<Vec<_>>(),
        recipe.inputs()?.iter().chain(&args.peers),
    )?;
    let mut folder = OutputFolder::prepare(&args.out)?;
    folder.expect(names)?;
    let bars = args.common.start()?;
    let rows = if args.redraw {
        read_json(&args.out.join("data.json"), "rows of an earlier sweep (data.json)")?
    } else {
        sweep_all(&args, &recipe, &bars)?
    };
    let seconds = start.elapsed().as_secs_f64();

    let mut texts = vec![
        ("data.csv".to_owned(), csv(&rows)?),
        ("data.json".to_owned(), serde_json::to_string_pretty(&rows)? + "\n"),
    ];
    let mut figures = Vec::new();
    for (id, question) in CHARTS {
        let mine: Vec<&Row> = rows.iter().filter(|row| row.chart == id).collect();
        if mine.is_empty() {
            continue;
        }
        let picture = svg::draw(id, question, &mine, usize::MAX)?;
        texts.push((format!("{id}.svg"), picture.clone()));
        // The first panel alone, for pages with little room.
        texts.push((format!("{id}-card.svg"), svg::draw(id, question, &mine, 1)?));
        figures.push(page::Figure { id, question, picture, rows: mine });
    }
    let how = format!(
        "{}{}; {} points{}; squall {}",
        args.recipe.display(),
        if args.quick { ", quick" } else { "" },
        rows.len(),
        if args.redraw { String::new() } else { format!(" in {seconds:.0} s") },
        env!("CARGO_PKG_VERSION")
    );
    texts.push(("index.html".to_owned(), page::page(&how, &figures)));
    folder.write(|folder| {
        for (name, text) in &texts {
            write_atomically(&folder.join(name), |out| out.write_all(text.as_bytes()))?;
        }
        Ok(())
    })?;
    bars.say(&format!("{}: {how}", args.out.join("index.html").display()));
    for figure in &figures {
        let front = figure.rows.iter().filter(|row| row.pareto).count();
        bars.say(&format!("{:<16} {:>5} points, {front} on the front", figure.id, figure.rows.len()));
    }
    Ok(())
}

/// Sweeps chart by chart. Each leaves its rows in the folder until all are done, for [`Args::resume`].
fn sweep_all(args: &Args, recipe: &Recipe, bars: &Bars) -> anyhow::Result<Vec<Row>> {
    let peers = match &args.peers {
        Some(script) => Some(Peers::ask(script, bars)?),
        None => None,
    };
    for absent in peers.iter().flat_map(|peers| &peers.absent) {
        eprintln!("note: left out of the chart compression: {absent}");
    }
    let (mut rows, mut finished) = (Vec::new(), Vec::new());
    for (id, _) in CHARTS.iter().filter(|(id, _)| args.only.is_empty() || args.only.iter().any(|o| o == id)) {
        let mut of = blake3::Hasher::new();
        of.update(
            format!("{} {id} {} {:?}", env!("CARGO_PKG_VERSION"), args.quick, args.reference).as_bytes(),
        );
        if let (Some(peers), Some(script), "compression") = (&peers, &args.peers, *id) {
            of.update(format!("{:?}", peers.found).as_bytes());
            of.update(&std::fs::read(script).map_err(BakeError::io(script, "read"))?);
        }
        for input in recipe.inputs()? {
            of.update(&std::fs::read(&input).map_err(BakeError::io(&input, "read"))?);
        }
        // The name tells what was swept: another recipe's rows, or a quick sweep's, are not taken for these.
        let file = args.out.join(format!(".{id}-{}.json", &of.finalize().to_hex()[..16]));
        let one: Vec<Row> = if args.resume && file.is_file() {
            read_json(&file, "rows of an interrupted sweep")?
        } else {
            let only = vec![(*id).to_owned()];
            let (reference, peers) = (args.reference.clone(), peers.clone());
            let task = Sweep { recipe, quick: args.quick, reference, peers, only };
            let one = sweep(&task, bars)?;
            let text = serde_json::to_string(&one)?;
            write_atomically(&file, |out| out.write_all(text.as_bytes()))?;
            one
        };
        rows.extend(one);
        finished.push(file);
        let (done, folder) = (finished.len(), args.out.display());
        pending::set_note(Some(format!("{done} finished charts wait in {folder} for --resume")));
    }
    bars.finish();
    pending::set_note(None);
    for file in finished {
        std::fs::remove_file(&file).map_err(BakeError::io(&file, "remove"))?;
    }
    Ok(rows)
}

fn csv(rows: &[Row]) -> anyhow::Result<String> {
    let mut out = csv::Writer::from_writer(Vec::new());
    for row in rows {
        out.serialize(row)?;
    }
    Ok(String::from_utf8(out.into_inner()?)?)
}
