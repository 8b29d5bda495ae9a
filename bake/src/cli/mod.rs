//! One file per subcommand; no mathematics in any of them.

/// Prints a line to standard output; a reader that has heard enough is no error, a full disk is.
macro_rules! say {
    ($($part:tt)*) => { $crate::cli::table::print(&format!("{}\n", format_args!($($part)*)))? };
}

mod asset;
mod bake;
mod camera;
mod chart;
mod common;
mod depfile;
mod diff;
mod export;
mod folder;
mod inspect;
pub mod interrupt;
pub mod json;
mod light_quality;
mod limits;
mod number;
mod page;
mod picture;
pub mod progress;
mod query;
mod rain;
mod relight;
mod render;
mod sky;
mod solve;
mod streaks;
mod synth;
mod table;
mod verify;
mod wet;

use squall_bake::error::{self, BakeError};
use squall_runtime::RuntimeError;

/// Bakes storms: cloud grids, pictures of rain and a recipe in; one .squall asset out.
#[derive(clap::Parser)]
#[command(name = "squall", version, about, propagate_version = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Bake(bake::Args),
    Render(Box<render::Args>),
    Rain(Box<rain::Args>),
    Wet(Box<wet::Args>),
    Relight(relight::Args),
    Solve(solve::Args),
    Query(query::Args),
    Inspect(inspect::Args),
    Verify(verify::Args),
    Diff(diff::Args),
    Chart(chart::Args),
    Page(page::Args),
    Export(export::Args),
    /// Turns pictures of streaks into cosines, and says how well.
    #[command(subcommand)]
    Streaks(streaks::Command),
    /// Makes inputs from seeds.
    #[command(subcommand)]
    Synth(synth::Synth),
}

impl Cli {
    /// Name of the command, if its answer is to be JSON.
    pub fn json(&self) -> Option<&'static str> {
        let (name, json) = match &self.command {
            Command::Bake(args) => ("bake", args.json()),
            Command::Render(args) => ("render", args.json()),
            Command::Rain(args) => ("rain", args.json()),
            Command::Wet(args) => ("wet", args.json()),
            Command::Relight(args) => ("relight", args.json()),
            Command::Solve(args) => ("solve", args.json()),
            Command::Query(args) => ("query", args.json()),
            Command::Inspect(args) => ("inspect", args.json()),
            Command::Verify(args) => ("verify", args.json()),
            Command::Diff(args) => ("diff", args.json()),
            Command::Chart(_) => ("chart", false),
            Command::Page(args) => ("page", args.json()),
            Command::Export(args) => ("export", args.json()),
            Command::Streaks(command) => (command.name(), command.json()),
            Command::Synth(command) => command.json(),
        };
        json.then_some(name)
    }
}

/// Runs the chosen subcommand.
pub fn run(cli: Cli) -> anyhow::Result<()> {
    match cli.command {
        Command::Bake(args) => bake::run(args),
        Command::Render(args) => render::run(*args),
        Command::Rain(args) => rain::run(*args),
        Command::Wet(args) => wet::run(*args),
        Command::Relight(args) => relight::run(args),
        Command::Solve(args) => solve::run(args),
        Command::Query(args) => query::run(args),
        Command::Inspect(args) => inspect::run(args),
        Command::Verify(args) => verify::run(args),
        Command::Diff(args) => diff::run(args),
        Command::Chart(args) => chart::run(args),
        Command::Page(args) => page::run(args),
        Command::Export(args) => export::run(args),
        Command::Streaks(command) => streaks::run(command),
        Command::Synth(command) => synth::run(command),
    }
}

/// An error in words, with causes that it does not tell already.
pub fn words(failure: &anyhow::Error) -> String {
    let mut text = failure.to_string();
    for cause in failure.chain().skip(1) {
        let cause = cause.to_string();
        if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// Exit code of an error: the innermost one that knows its own, else 3 (bad input).
pub fn exit_code(failure: &anyhow::Error) -> u8 {
    for cause in failure.chain() {
        if let Some(error) = cause.downcast_ref::<BakeError>() {
            return error.exit_code();
        }
        if let Some(error) = cause.downcast_ref::<RuntimeError>() {
            return error::runtime_exit_code(error);
        }
        if let Some(error) = cause.downcast_ref::<std::io::Error>() {
            return error::io_exit_code(error);
        }
    }
    3
}
