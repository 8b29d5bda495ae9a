//! What README.md says of the command holds: its first lines run, on a small recipe, and every option that it names is there.

use assert_cmd::Command;
use std::path::Path;

const README: &str = include_str!("../../README.md");

/// Runs `squall WORDS` in a folder; it has to go well.
#[track_caller]
fn squall(folder: &Path, words: &[&str]) {
    let output = Command::cargo_bin("squall").unwrap().current_dir(folder).args(words).output().unwrap();
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn the_first_command_bakes_and_renders_and_so_do_those_that_follow_from_it() {
    let line = README.lines().find_map(|line| line.trim().strip_prefix("cargo run --release -- ")).unwrap();
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/golden.toml");
    let golden = golden.to_str().unwrap();
    let words: Vec<&str> =
        line.split_whitespace().map(|word| if word.ends_with(".toml") { golden } else { word }).collect();
    assert_eq!(words.first(), Some(&"bake"));
    let folder = tempfile::tempdir().unwrap();
    squall(folder.path(), &words);
    let there = |name: &str| assert!(folder.path().join(name).metadata().unwrap().len() > 0, "{name}");
    there("storm.squall");
    there("storm.png");
    squall(folder.path(), &["render", "storm.squall", "-o", "again.png"]);
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(read("again.png") == read("storm.png"), "the preview is what render draws");
    squall(folder.path(), &["render", "storm.squall", "-o", "sheet.png", "--contact-sheet"]);
    there("sheet.png");
    squall(folder.path(), &["render", "storm.squall", "-o", "lit.png", "--flash", "inside", "--rate", "5"]);
    there("lit.png");
    squall(folder.path(), &["verify", "storm.squall"]);
    squall(folder.path(), &["inspect", "storm.squall", "--json"]);
    squall(folder.path(), &["diff", "storm.squall", "storm.squall", "--json"]);
}

#[test]
fn every_option_in_the_table_of_commands_is_one_that_the_command_has() {
    let rows = README.lines().filter(|line| line.starts_with("| `squall "));
    let mut options = 0;
    for row in rows {
        // A row may name several commands; its description speaks of the first.
        let mut command = "";
        for piece in row.split('`') {
            let mut words = piece.split_whitespace();
            if words.next() == Some("squall") {
                command = words.next().unwrap();
            }
            for option in piece.split(|c: char| c.is_whitespace() || "[],.".contains(c)) {
                if option.starts_with("--") {
                    let output =
                        Command::cargo_bin("squall").unwrap().arg(command).arg("--help").output().unwrap();
                    let help = String::from_utf8(output.stdout).unwrap();
                    assert!(help.contains(option), "squall {command} has no {option}: {row}");
                    options += 1;
                }
            }
        }
    }
    assert!(options > 10, "{options} options");
}

#[test]
fn the_picture_is_captioned_with_its_recipes_gain() {
    let recipe = include_str!("../../data/storm/storm.toml");
    let gain = recipe.lines().find_map(|line| line.strip_prefix("gain = ")).unwrap();
    let gain: f64 = gain.split_whitespace().next().unwrap().parse().unwrap();
    let (_, behind) = README.split_once("](docs/storm.png)").unwrap();
    let caption = behind.trim_start().split("\n\n").next().unwrap();
    assert!(caption.contains(&format!("gain = {gain}")), "{caption}");
}
