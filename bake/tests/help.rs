//! What `--help` says and what shape `inspect --json` has, held as text files: a change of either is to be seen, and meant.
//! `SQUALL_UPDATE=1 cargo test -p squall-bake --test cli help` writes the files anew.

use assert_cmd::Command;
use serde_json::Value;
use std::path::{Path, PathBuf};

fn snapshot(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/snapshots").join(name)
}

/// Compares a text with its file, or writes the file where that was asked for.
#[track_caller]
fn same(name: &str, text: &str) {
    let path = snapshot(name);
    if std::env::var_os("SQUALL_UPDATE").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        return;
    }
    let wanted = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(text == wanted, "{} differs; SQUALL_UPDATE=1 writes it anew. Now:\n{text}", path.display());
}

const COMMANDS: [&str; 22] = [
    "",
    "bake",
    "render",
    "rain",
    "wet",
    "relight",
    "solve",
    "query",
    "inspect",
    "page",
    "export",
    "verify",
    "diff",
    "chart",
    "streaks",
    "streaks fit",
    "streaks extract",
    "synth cloud",
    "synth town",
    "synth stroke",
    "synth streaks",
    "synth point-spread",
];

#[test]
fn every_commands_help_is_what_its_file_says() {
    for command in COMMANDS {
        let mut call = Command::cargo_bin("squall").unwrap();
        // Lines break where a terminal's do.
        call.env("COLUMNS", "100").env_remove("CLICOLOR_FORCE");
        let output = call.args(command.split_whitespace()).arg("--help").output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        let name = if command.is_empty() { "squall".to_owned() } else { command.replace(' ', "-") };
        let plain: Vec<&str> = text.lines().map(str::trim_end).collect();
        same(&format!("help-{name}.txt"), &(plain.join("\n") + "\n"));
    }
}

/// A value's shape: keys with what stands under them, lists with the shape of their first item.
fn shape(value: &Value, indent: usize, out: &mut String) {
    let gap = "  ".repeat(indent);
    match value {
        Value::Null => out.push_str("null\n"),
        Value::Bool(_) => out.push_str("bool\n"),
        Value::Number(_) => out.push_str("number\n"),
        Value::String(_) => out.push_str("text\n"),
        Value::Array(items) => {
            out.push_str("list of ");
            match items.first() {
                Some(item) => shape(item, indent, out),
                None => out.push_str("nothing\n"),
            }
        }
        Value::Object(entries) => {
            out.push_str("object\n");
            for (key, value) in entries {
                out.push_str(&format!("{gap}  {key}: "));
                shape(value, indent + 1, out);
            }
        }
    }
}

#[test]
fn the_shape_of_inspects_json_is_what_its_file_says() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/golden.squall");
    let output = Command::cargo_bin("squall").unwrap().arg("inspect").arg(golden).arg("--json").output();
    let value: Value = serde_json::from_slice(&output.unwrap().stdout).unwrap();
    let mut text = String::new();
    shape(&value, 0, &mut text);
    same("inspect-json.txt", &text);
}
