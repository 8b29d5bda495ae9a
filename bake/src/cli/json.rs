//! One JSON object to standard output in place of words: docs/json.md says what stands in it.

use super::table;
use serde_json::{Value, json};
use squall_bake::output::Place;
use std::path::Path;

/// Prints the answer of a command that was asked for JSON.
///
/// Errors: standard output cannot be written to.
pub fn answer(value: &Value) -> anyhow::Result<()> {
    table::print(&format!("{value:#}\n"))
}

/// Prints what a command failed by, unless its answer is there already.
pub fn failure(command: &str, failure: &anyhow::Error) {
    if table::printed() {
        return;
    }
    let error = json!({ "exit_code": super::exit_code(failure), "message": super::words(failure) });
    // The words on standard error say the same.
    let _ = table::print(&format!("{:#}\n", json!({ "command": command, "error": error })));
}

/// Ends the command as clap does, where more than one of `--json` and the outputs want standard output (exit code 2).
pub fn check_stdout(json: bool, outputs: &[&Path]) {
    let taken = outputs.iter().filter(|path| matches!(Place::of(path), Ok(Place::Stdout))).count();
    match (json, taken) {
        (true, 1..) => usage("--json prints to standard output, which an output is written to already"),
        (false, 2..) => usage("standard output takes one output, and two are to go there"),
        _ => {}
    }
}

/// Ends the command by a usage error (exit code 2).
pub fn usage(words: &str) -> ! {
    clap::Error::raw(clap::error::ErrorKind::ArgumentConflict, format!("{words}\n")).exit()
}

/// Lower-case hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
