//! One file per subcommand; no mathematics in any of them.

mod bake;
mod folder;
mod picture;
mod progress;
mod query;
mod relight;
mod render;
mod solve;
mod streaks;
mod synth;
mod table;

use squall_bake::BakeError;
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
    Render(render::Args),
    Relight(relight::Args),
    Solve(solve::Args),
    Query(query::Args),
    /// Turns pictures of streaks into cosines, and says how well.
    #[command(subcommand)]
    Streaks(streaks::Command),
    /// Makes inputs from seeds.
    #[command(subcommand)]
    Synth(synth::Synth),
}

/// Runs the chosen subcommand.
pub fn run(cli: Cli) -> anyhow::Result<()> {
    match cli.command {
        Command::Bake(args) => bake::run(args),
        Command::Render(args) => render::run(args),
        Command::Relight(args) => relight::run(args),
        Command::Solve(args) => solve::run(args),
        Command::Query(args) => query::run(args),
        Command::Streaks(command) => streaks::run(command),
        Command::Synth(command) => synth::run(command),
    }
}

/// Exit code of an error: the innermost one that knows its own, else 3 (bad input).
pub fn exit_code(error: &anyhow::Error) -> u8 {
    for cause in error.chain() {
        if let Some(error) = cause.downcast_ref::<BakeError>() {
            return error.exit_code();
        }
        if let Some(error) = cause.downcast_ref::<RuntimeError>() {
            return match error {
                RuntimeError::Io { source, .. } if source.kind() != std::io::ErrorKind::NotFound => 4,
                _ => 3,
            };
        }
    }
    3
}
