//! Where methods fail, and what is done there: the tests behind docs/stability.md.
//!
//! `cargo test --release -p squall-tests stability -- --nocapture` prints the figures of that page.

mod cloud;
mod codec;
mod rain;
mod streak;
mod transport;

use std::collections::BTreeSet;
use std::path::Path;

/// Names of all tests in the `.rs` files below `folder`.
fn tests_below(folder: &Path, names: &mut BTreeSet<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() && path.file_name().is_some_and(|name| name != "target") {
            tests_below(&path, names);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            let mut lines = text.lines().map(str::trim);
            while let Some(line) = lines.next() {
                // A test of proptest! has its documentation between the attribute and the name.
                let mut next = || lines.by_ref().find(|l| !(l.starts_with("#[") || l.starts_with("//")));
                let name = if line == "#[test]" { next() } else { None };
                let name =
                    name.and_then(|line| line.strip_prefix("fn ")).and_then(|rest| rest.split('(').next());
                names.extend(name.map(str::to_owned));
            }
        }
    }
}

/// Names between back quotes in the table's last column.
fn cited() -> BTreeSet<String> {
    let page = std::fs::read_to_string(crate::root().join("docs/stability.md")).unwrap();
    let mut names = BTreeSet::new();
    for row in page.lines().filter(|line| line.starts_with('|')) {
        let last = row.trim_end_matches('|').rsplit('|').next().unwrap_or_default();
        names.extend(last.split('`').skip(1).step_by(2).filter(|name| name.contains('_')).map(str::to_owned));
    }
    names
}

#[test]
fn every_row_of_the_stability_page_names_tests_that_exist_and_every_test_here_has_its_row() {
    let (cited, mut all, mut ours) = (cited(), BTreeSet::new(), BTreeSet::new());
    for room in ["formats", "runtime", "bake", "tests"] {
        tests_below(&crate::root().join(room), &mut all);
    }
    tests_below(&crate::root().join("tests/src/stability"), &mut ours);
    assert!(cited.len() > 30 && ours.len() > 15, "{} cited, {} here", cited.len(), ours.len());
    let missing: Vec<_> = cited.difference(&all).collect();
    assert!(missing.is_empty(), "named and not there: {missing:?}");
    let silent: Vec<_> = ours.difference(&cited).collect();
    assert!(silent.is_empty(), "there and not named: {silent:?}");
}
