//! One word, one meaning: words that docs/GLOSSARY.md replaced do not come back.

use crate::root;
use std::path::{Path, PathBuf};

/// A word that was retired, what stands in its place, and files whose names end so that must know it: readers of old files, history.
struct Retired {
    word: &'static str,
    instead: &'static str,
    allowed: &'static [&'static str],
}

const fn retired(word: &'static str, instead: &'static str) -> Retired {
    Retired { word, instead, allowed: &[] }
}

/// In lower case. Each is looked for as a whole word, an underscore being part of one.
const RETIRED: [Retired; 21] = [
    Retired {
        word: "eyes",
        instead: "view region, viewpoints",
        // Keys of old recipes, which are still read; names of golden files.
        allowed: &[
            "recipe/clouds.rs",
            "recipe/model.rs",
            "docs/recipe.md",
            "golden.rs",
            "front_door.rs",
            "view_region.rs",
            "town/boxes.rs",
            "SOURCES.md",
            "v2/README.md",
            "tests/src/wasm.rs",
            "v2/eyes.toml",
            "gpu/haar.rs",
            "gpu/light/tests.rs",
            "card/tests.rs",
        ],
    },
    retired("eyebox", "ViewRegion"),
    retired("channelbasis", "DirectionalBasis"),
    retired("lamppoint", "PointLight"),
    retired("lampgrid", "LightGrid"),
    retired("unseen_cells", "hidden cells"),
    retired("unseen strokes", "held-out strokes"),
    retired("unseen stroke", "held-out stroke"),
    retired("jury", "held-out set"),
    retired("verdict", "scores"),
    retired("trial", "candidate"),
    retired("by chance", "Monte Carlo"),
    retired("solve_by_chance", "solve_monte_carlo"),
    retired("veil", "rain medium"),
    retired("books", "energy balance"),
    retired("virtual lamp", "virtual point light"),
    retired("virtual lamps", "virtual point lights"),
    retired("fn reach", "bounds"),
    retired("marchedcloud", "CloudMarch"),
    retired("litcloud", "CloudMarch"),
    retired("framememory", "StormRenderer"),
];

/// Files of the project that people read, but for the history of changes and what lists these words.
fn texts() -> Vec<PathBuf> {
    let mut found = Vec::new();
    let folders = ["bake", "data", "docs", "formats", "runtime", "tests"];
    let mut open: Vec<PathBuf> = folders.iter().map(|name| root().join(name)).collect();
    found.push(root().join("README.md"));
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder).unwrap().map(Result::unwrap) {
            let (path, name) = (entry.path(), entry.file_name());
            if entry.file_type().unwrap().is_dir() {
                if name != "target" && name != "corpus" {
                    open.push(path);
                }
            } else if [".rs", ".md", ".toml"].iter().any(|end| name.to_string_lossy().ends_with(end)) {
                found.push(path);
            }
        }
    }
    let own = Path::new(file!()).file_name().unwrap();
    found.retain(|path| path.file_name() != Some(own));
    found.sort();
    found
}

/// Whether `text`, in lower case, holds `word` with no letter, digit or underscore beside it.
fn has_word(text: &str, word: &str) -> bool {
    let part = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    text.match_indices(word).any(|(at, _)| {
        let before = text[..at].chars().next_back();
        let after = text[at + word.len()..].chars().next();
        !part(before) && !part(after)
    })
}

#[test]
fn retired_words_do_not_come_back() {
    let mut back = Vec::new();
    for path in texts() {
        let name = path.strip_prefix(root()).unwrap().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&path).unwrap().to_lowercase();
        for (number, line) in text.lines().enumerate() {
            for Retired { word, instead, allowed } in &RETIRED {
                if has_word(line, word) && !allowed.iter().any(|end| name.ends_with(end)) {
                    back.push(format!("{name}:{}: \"{word}\", now {instead}", number + 1));
                }
            }
        }
    }
    assert!(back.is_empty(), "{}", back.join("\n"));
}

#[test]
fn a_word_is_found_whole_and_nowhere_inside_another() {
    assert!(has_word("towards eyes, and", "eyes") && has_word("eyes", "eyes"));
    assert!(!has_word("unveiled", "veil") && !has_word("two_eyes", "eyes"));
}

#[test]
fn every_word_of_the_glossary_is_defined_once() {
    let text = std::fs::read_to_string(root().join("docs/GLOSSARY.md")).unwrap();
    let rows = text.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| word"));
    let mut words: Vec<&str> = rows
        .filter_map(|row| row.split('|').nth(1))
        .flat_map(|cell| cell.split(", "))
        .map(str::trim)
        .collect();
    let count = words.len();
    assert!(count > 50, "{count} words");
    words.sort_unstable();
    words.dedup();
    assert_eq!(words.len(), count, "a word stands in the glossary twice");
}
