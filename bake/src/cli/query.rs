//! `squall query ASSET density …`: one number out of an asset's tables.

use super::number;
use anyhow::Result;
use serde_json::json;
use squall_bake::density::solve_counts;
use squall_formats::drops::View;
use squall_formats::section::density::Mode;
use squall_formats::units::{Degrees, MillimetresPerHour, Seconds};
use squall_runtime::density::{lookup_counts, read_density};
use std::path::PathBuf;

/// Reads one number out of an asset's tables.
#[derive(clap::Args)]
pub struct Args {
    /// The asset; only the section that holds the answer is read.
    asset: PathBuf,
    #[command(subcommand)]
    what: What,
}

impl Args {
    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        match &self.what {
            What::Density(density) => density.json,
        }
    }
}

#[derive(clap::Subcommand)]
enum What {
    /// Expected number of visible rain streaks in a picture, in all and by class of drops.
    Density(Density),
}

#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
struct Density {
    /// Rainfall intensity, mm/h.
    #[arg(long, value_name = "MM/H", value_parser = number::from_zero)]
    rate: f64,
    /// Vertical field of view, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 60.0, value_parser = number::between(0.0, 180.0, "degrees"))]
    fov: f64,
    /// Picture height, pixels.
    #[arg(long, value_name = "PX", default_value_t = 1080.0, value_parser = number::positive)]
    height: f64,
    /// Exposure, milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 20.0, value_parser = number::positive)]
    exposure_ms: f64,
    /// Picture width over height, as 16:9 or as 1.7778.
    #[arg(long, value_name = "W:H", default_value = "16:9", value_parser = parse_aspect, allow_hyphen_values = true)]
    aspect: f64,
    /// Shortest streak that counts, pixels.
    #[arg(long, value_name = "PX", default_value_t = 30.0, value_parser = number::positive)]
    min_px: f64,
    /// Longest streak that counts, pixels.
    #[arg(long, value_name = "PX", default_value_t = 200.0, value_parser = number::positive)]
    max_px: f64,
    /// How drops are counted: default (corrected), paper-exact (the paper's classes, integrated exactly) or paper (as printed).
    #[arg(long, default_value = "default", value_parser = parse_mode)]
    mode: Mode,
    /// Also evaluate the formula itself.
    #[arg(long)]
    direct: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Prints the answer.
pub fn run(args: Args) -> Result<()> {
    match args.what {
        What::Density(density) => run_density(&args.asset, &density),
    }
}

fn run_density(path: &std::path::Path, args: &Density) -> Result<()> {
    if args.max_px <= args.min_px {
        super::json::usage(&format!(
            "--max-px: wanted more than --min-px {}, found {}",
            args.min_px, args.max_px
        ));
    }
    let asset = super::asset::open_directory(path)?;
    let section = read_density(&asset)?;
    let rate = MillimetresPerHour(args.rate);
    let view = View {
        vertical_fov: Degrees(args.fov).into(),
        height_px: args.height,
        aspect: args.aspect,
        exposure: Seconds(args.exposure_ms / 1e3),
        min_px: args.min_px,
        max_px: args.max_px,
    };
    let counts = lookup_counts(&section, args.mode, &view, rate)?;
    let edges: Vec<_> = section.table(args.mode).classes.iter().map(|class| class.diameter).collect();
    let direct = if args.direct { Some(solve_counts(args.mode, &edges, &view, rate)?) } else { None };
    let total: f64 = counts.iter().sum();
    let direct_total: Option<f64> = direct.as_ref().map(|counts| counts.iter().sum());

    if args.json {
        let classes: Vec<_> = edges
            .iter()
            .enumerate()
            .map(|(i, [from, to])| {
                let mut class = json!({ "diameter_mm": [from.0, to.0], "count": counts[i] });
                if let Some(direct) = &direct {
                    class["direct"] = json!(direct[i]);
                }
                class
            })
            .collect();
        let mut answer = json!({ "total": total, "classes": classes });
        if let Some(direct) = direct_total {
            answer["direct"] = json!(direct);
        }
        say!("{answer}");
        return Ok(());
    }
    say!("{:>17}  {:>12}{}", "diameter, mm", "streaks", if args.direct { "      formula" } else { "" });
    let line = |name: String, count: f64, direct: Option<f64>| -> anyhow::Result<()> {
        let direct = direct.map_or(String::new(), |direct| format!(" {direct:>12.4}"));
        say!("{name:>17}  {count:>12.4}{direct}");
        Ok(())
    };
    for (i, [from, to]) in edges.iter().enumerate() {
        line(format!("{:.3} – {:.3}", from.0, to.0), counts[i], direct.as_ref().map(|counts| counts[i]))?;
    }
    line("all".into(), total, direct_total)
}

fn parse_mode(text: &str) -> Result<Mode, String> {
    Mode::from_name(text).ok_or_else(|| format!("wanted {}", Mode::ALL.map(Mode::name).join(", ")))
}

fn parse_aspect(text: &str) -> Result<f64, String> {
    let found = match text.split_once(':') {
        Some((width, height)) => {
            number::positive(width).and_then(|width| Ok(width / number::positive(height)?))
        }
        None => number::positive(text),
    };
    found.map_err(|_| "wanted a width and a height above 0 such as 16:9, or their ratio".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_aspect_is_a_ratio_or_a_number() {
        assert_eq!(parse_aspect("16:9"), Ok(16.0 / 9.0));
        assert_eq!(parse_aspect("1.7778"), Ok(1.7778));
        assert!(parse_aspect("16:").is_err() && parse_aspect("wide").is_err());
    }
}
