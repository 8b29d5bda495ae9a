//! The command from outside, one module a subject. One program for all, because each is linked with everything.

mod backend;
mod cache;
mod camera;
mod chart;
mod diff;
mod disk;
mod export;
mod help;
mod inputs;
mod inspect;
mod json;
mod monte_carlo;
mod outputs;
mod page;
mod peers;
mod query;
mod rain;
mod readme;
mod recipe;
mod relight;
mod sequence;
mod solve;
mod steps;
mod streaks;
mod synth;
mod usage;
mod wet;

/// Cargo looks for no tests by itself here (`autotests`), so a file that is not named above would never run.
#[test]
fn every_file_beside_this_one_is_named_in_it() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    for file in folder.read_dir().unwrap() {
        let path = file.unwrap().path();
        if path.is_dir() {
            continue;
        }
        let name = path.file_stem().unwrap().to_str().unwrap();
        let line = format!("\nmod {name};\n");
        assert!(name == "cli" || include_str!("cli.rs").contains(&line), "tests/cli.rs lacks `mod {name};`");
    }
}
