//! What README.md says of the command holds: its first lines run, on a small recipe, and every option that it names is there.

use super::steps::Workplace;
use assert_cmd::Command;

const README: &str = include_str!("../../README.md");

#[test]
fn the_first_command_bakes_and_renders_and_so_do_those_that_follow_from_it() {
    let line = README.lines().find_map(|line| line.trim().strip_prefix("cargo run --release -- ")).unwrap();
    let words: Vec<&str> =
        line.split_whitespace().map(|word| if word.ends_with(".toml") { "r.toml" } else { word }).collect();
    assert_eq!(words.first(), Some(&"bake"));
    let place = Workplace::new("test_strokes = 1");
    let squall = |words: &[&str]| {
        let (code, _, said) = place.squall(words);
        assert_eq!(code, 0, "{words:?}: {said}");
    };
    squall(&words);
    let there = |name: &str| assert!(place.path(name).metadata().unwrap().len() > 0, "{name}");
    there("storm.squall");
    there("storm.png");
    squall(&["render", "storm.squall", "-o", "again.png", "--quality", "preview"]);
    let read = |name: &str| std::fs::read(place.path(name)).unwrap();
    assert!(read("again.png") == read("storm.png"), "the preview is what render draws of that quality");
    squall(&["render", "storm.squall", "-o", "sheet.png", "--contact-sheet"]);
    there("sheet.png");
    squall(&["render", "storm.squall", "-o", "lit.png", "--flash", "a", "--rate", "5"]);
    there("lit.png");
    squall(&["verify", "storm.squall"]);
    squall(&["inspect", "storm.squall", "--json"]);
    squall(&["diff", "storm.squall", "storm.squall", "--json"]);
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
