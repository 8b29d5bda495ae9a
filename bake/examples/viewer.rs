//! A storm in a window: `cargo run --release --example viewer -- storm.squall`.
//!
//! What a window needs is heavy, and its crate a workspace of its own, runtime/viewer: this builds that one and hands it the arguments.

use std::process::{Command, ExitCode};

fn main() -> ExitCode {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let manifest = concat!(env!("CARGO_MANIFEST_DIR"), "/../runtime/viewer/Cargo.toml");
    let started = Command::new(&cargo)
        .args(["run", "--release", "--manifest-path", manifest, "--"])
        .args(std::env::args_os().skip(1))
        .status();
    match started {
        // A window that a signal ended has no code.
        Ok(status) => ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(4)),
        Err(error) => {
            eprintln!("viewer: {}: {error}", cargo.to_string_lossy());
            ExitCode::from(4)
        }
    }
}
