//! Solved light that is kept between bakes: the same bytes with any cache, and no more work than there is.

use super::steps::Workplace;
use serde_json::Value;
use std::path::{Path, PathBuf};

const RESPONSE: &str = "test_strokes = 2\ndistant = [\"upper-sky\"]";
/// Rows of the recipe: 4 × 4 × 4 virtual lights and half a sky.
const ROWS: u64 = 65;

fn stroke(seed: u32) -> String {
    format!(
        "[[strokes]]\nname = \"a\"\nseed = {seed}\nfrom_m = [-150.0, -60.0, 680.0]\nto_m = [140.0, 80.0, 640.0]\n\
         intensity_W_per_sr = 2.0e6\n"
    )
}

/// Bakes r.toml with more options; the asset's bytes and what the cache was good for: rows found and solved, strokes found and solved.
#[track_caller]
fn bake(place: &Workplace, more: &[&str]) -> (Vec<u8>, [u64; 4]) {
    let words = [&["bake", "r.toml", "-o", "r.squall", "--json"], more].concat();
    let (code, out, said) = place.squall(&words);
    assert_eq!(code, 0, "{said}");
    let json: Value = serde_json::from_str(&out).unwrap();
    let counts = ["rows_found", "rows_solved", "strokes_found", "strokes_solved"];
    let counts = counts.map(|name| json["cache"][name].as_u64().unwrap_or(0));
    (std::fs::read(place.path("r.squall")).unwrap(), counts)
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = folder.read_dir().unwrap().map(|entry| entry.unwrap().path()).collect();
    found.sort();
    found
}

#[test]
fn an_asset_has_the_same_bytes_with_a_cold_a_warm_a_half_warm_and_a_spoilt_cache() {
    // Cells that nobody reads, a view region, direct light in rows, all directions: each is kept in its own way.
    let region = "seen_only = true\nbasis = \"view-region-1\"";
    let rows = "basis = \"directions-26\"\ndirect = \"rows\"";
    for response in ["", "seen_only = true", region, rows] {
        let place = Workplace::new(&format!("{RESPONSE}\n{response}"));
        if response == region {
            let recipe = std::fs::read_to_string(place.path("r.toml")).unwrap();
            let region =
                "[clouds.view_region]\nlow_m = [-60.0, -420.0, 0.0]\nhigh_m = [60.0, -380.0, 12.0]\n";
            std::fs::write(place.path("r.toml"), recipe + region).unwrap();
        }
        let (without, _) = bake(&place, &["--no-cache"]);
        let cached = |what: &str, wanted: [u64; 4]| {
            let (bytes, counts) = bake(&place, &["--cache", "cache"]);
            assert_eq!(counts, wanted, "{what}, {response}");
            assert!(bytes == without, "{what}, {response}: other bytes");
        };
        cached("cold", [0, ROWS, 0, 2]);
        cached("warm", [ROWS, 0, 2, 0]);
        let all = entries(&place.path("cache"));
        assert_eq!(all.len() as u64, ROWS + 2);
        // Every third is gone; every third of the others is damaged.
        all.iter().step_by(3).for_each(|file| std::fs::remove_file(file).unwrap());
        let left = entries(&place.path("cache"));
        for file in left.iter().step_by(3) {
            let mut bytes = std::fs::read(file).unwrap();
            let middle = bytes.len() / 2;
            bytes[middle] ^= 4;
            std::fs::write(file, bytes).unwrap();
        }
        let (bytes, [found, solved, ..]) = bake(&place, &["--cache", "cache"]);
        assert!(
            bytes == without && found + solved == ROWS && solved > ROWS / 3,
            "{response}: {found} {solved}"
        );
        cached("mended", [ROWS, 0, 2, 0]);
        all.iter().for_each(|file| std::fs::write(file, b"nothing of the kind").unwrap());
        cached("spoilt", [0, ROWS, 0, 2]);
        std::fs::remove_dir_all(place.path("cache")).unwrap();
        cached("deleted", [0, ROWS, 0, 2]);
    }
}

#[test]
fn twenty_recipes_that_differ_in_a_strokes_seed_solve_the_response_once() {
    let place = Workplace::new(RESPONSE);
    let mut solved = [0, 0];
    for seed in 1..=20 {
        place.write(RESPONSE, &stroke(seed));
        let (_, [found, rows, _, strokes]) = bake(&place, &["--cache", "cache"]);
        assert_eq!(found + rows, ROWS);
        solved = [solved[0] + rows, solved[1] + strokes];
    }
    assert_eq!(solved, [ROWS, 2]);
}

#[test]
fn pruned_variants_share_the_rows_that_both_touch() {
    let pruned = |seed| {
        let recipe = format!(
            "{RESPONSE}\n[clouds.view_region]\nlow_m = [-60.0, -420.0, 0.0]\nhigh_m = [60.0, -380.0, 12.0]"
        );
        let lightning = "[clouds.lightning]\nprune = true\n";
        (recipe, stroke(seed), lightning)
    };
    let place = Workplace::new(RESPONSE);
    let write = |seed| {
        let (response, stroke, lightning) = pruned(seed);
        place.write(&response, &stroke);
        let recipe = std::fs::read_to_string(place.path("r.toml")).unwrap();
        std::fs::write(place.path("r.toml"), recipe.replace("[clouds.lightning]\n", lightning)).unwrap();
    };
    write(1);
    let (_, [_, first, ..]) = bake(&place, &["--cache", "cache"]);
    assert!(first < ROWS, "{first} rows, pruned");
    write(2);
    let (bytes, [found, solved, ..]) = bake(&place, &["--cache", "cache"]);
    assert!(found > 0 && solved < first, "{found} found, {solved} solved, {first} at first");
    assert!(bytes == bake(&place, &["--no-cache"]).0);
}

#[test]
fn whatever_light_depends_on_parts_one_recipes_rows_from_anothers() {
    let place = Workplace::new(RESPONSE);
    bake(&place, &["--cache", "cache"]);
    let first = std::fs::read_to_string(place.path("r.toml")).unwrap();
    let other = |what: &str, change: &dyn Fn(&str) -> String| {
        std::fs::write(place.path("r.toml"), change(&first)).unwrap();
        let (_, [found, solved, ..]) = bake(&place, &["--cache", "cache"]);
        assert_eq!((found, solved), (0, ROWS), "{what}");
    };
    let transport = |line: &'static str| move |recipe: &str| format!("{recipe}[clouds.transport]\n{line}\n");
    other("tolerance", &transport("tolerance = 2e-3"));
    other("directions", &transport("directions = \"14\""));
    other("scheme", &transport("scheme = \"step\""));
    other("delta", &transport("delta_m = false"));
    other("samples", &transport("samples = 2"));
    other("basis", &|recipe| recipe.replace("test_strokes", "basis = \"harmonics-2\"\ntest_strokes"));
    let optics =
        |line: &'static str| move |recipe: &str| recipe.replace("[clouds]\n", &format!("[clouds]\n{line}\n"));
    other("albedo", &optics("albedo = 0.9"));
    other("g", &optics("g = 0.7"));
    other("kappa", &optics("kappa_per_m = 0.05"));
    // How rows are coded is not what they depend on.
    std::fs::write(place.path("r.toml"), first.replace("test_strokes", "error = 0.2\ntest_strokes")).unwrap();
    assert_eq!(bake(&place, &["--cache", "cache"]).1, [ROWS, 0, 2, 0]);
    let mut grid = std::fs::read(place.path("cloud.f32")).unwrap();
    grid[400..404].copy_from_slice(&0.5f32.to_le_bytes());
    std::fs::write(place.path("cloud.f32"), grid).unwrap();
    other("grid", &str::to_owned);
}

#[test]
fn six_bakes_at_once_share_a_cache_and_make_the_same_asset() {
    let place = Workplace::new(RESPONSE);
    let (wanted, _) = bake(&place, &["--no-cache"]);
    let names: Vec<String> = (0..6).map(|number| format!("{number}.squall")).collect();
    std::thread::scope(|scope| {
        for name in &names {
            scope.spawn(|| {
                // A folder that is too small for all: each removes what others wrote.
                let words = ["bake", "r.toml", "-o", name, "--cache", "cache", "--cache-size", "400K"];
                let (code, _, said) = place.squall(&words);
                assert_eq!(code, 0, "{said}");
            });
        }
    });
    for name in names {
        assert!(std::fs::read(place.path(&name)).unwrap() == wanted, "{name}");
    }
    let left = entries(&place.path("cache"));
    assert!(left.iter().all(|file| file.extension().is_some_and(|end| end == "row")), "{left:?}");
}

#[test]
fn a_cache_that_cannot_be_written_to_is_warned_of_and_does_no_harm() {
    let place = Workplace::new(RESPONSE);
    std::fs::write(place.path("cache"), b"a file").unwrap();
    let (code, _, said) = place.squall(&["bake", "r.toml", "-o", "r.squall", "--cache", "cache"]);
    assert!(code == 0 && said.contains("warning: cache: solved light cannot be kept there"), "{said}");
    assert_eq!(std::fs::read(place.path("cache")).unwrap(), b"a file");
}

#[test]
fn a_bake_of_a_moment_keeps_nothing_unless_it_is_asked_to() {
    let place = Workplace::new(RESPONSE);
    place.bake(&[]);
    assert!(!place.path(".squall-cache").exists());
}
