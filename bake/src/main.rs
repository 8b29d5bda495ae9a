//! The command `squall`: parse, dispatch, exit code.

mod cli;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    match cli::run(cli::Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("squall: {}", cli::words(&error));
            ExitCode::from(cli::exit_code(&error))
        }
    }
}
