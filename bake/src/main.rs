//! The command `squall`: parse, dispatch, exit code.

mod cli;

use clap::Parser;
use squall_bake::BakeError;
use squall_bake::output::pending;
use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = cli::Cli::parse();
    let json = cli.json();
    match cli::interrupt::install().and_then(|()| cli::run(cli)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            cli::progress::clear();
            match error.downcast_ref() {
                Some(BakeError::Interrupted) => cli::interrupt::say(pending::note()),
                // Nobody may be left to read it.
                _ => {
                    let _ = writeln!(std::io::stderr(), "squall: {}", cli::words(&error));
                    if let Some(command) = json {
                        cli::json::failure(command, &error);
                    }
                }
            }
            ExitCode::from(cli::exit_code(&error))
        }
    }
}
