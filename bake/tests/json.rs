//! `--json`: every answer is one object with the keys and types that docs/json.md promises.

use super::steps::Workplace;
use serde_json::Value;

/// What may stand under a key.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Text,
    Number,
    Bool,
    List,
    Object,
    /// The kind given, or null.
    Maybe(&'static Kind),
}

use Kind::{Bool, List, Maybe, Number, Object, Text};

impl Kind {
    fn holds(self, value: &Value) -> bool {
        match self {
            Text => value.is_string(),
            Number => value.is_number(),
            Bool => value.is_boolean(),
            List => value.is_array(),
            Object => value.is_object(),
            Maybe(kind) => value.is_null() || kind.holds(value),
        }
    }
}

/// Checks an object's keys, all of them, and what stands under each; all of them are in docs/json.md.
#[track_caller]
fn has(value: &Value, keys: &[(&str, Kind)]) {
    let object = value.as_object().unwrap_or_else(|| panic!("no object: {value}"));
    let mut found: Vec<&str> = object.keys().map(String::as_str).collect();
    let mut wanted: Vec<&str> = keys.iter().map(|(key, _)| *key).collect();
    found.sort_unstable();
    wanted.sort_unstable();
    assert_eq!(found, wanted, "{value}");
    let documented = include_str!("../../docs/json.md");
    for (key, kind) in keys {
        assert!(kind.holds(&object[*key]), "{key} is no {kind:?}: {value}");
        assert!(documented.contains(&format!("`{key}`")), "docs/json.md does not tell of `{key}`");
    }
}

/// The object that a command answers, alone on standard output, with this exit code.
#[track_caller]
fn answer(place: &Workplace, code: i32, words: &[&str]) -> Value {
    let (found, out, said) = place.squall(words);
    assert_eq!(found, code, "{words:?}: {said}");
    let value: Value = serde_json::from_str(&out).unwrap_or_else(|error| panic!("{words:?}: {error}: {out}"));
    assert_eq!(value["command"], words[0], "{out}");
    value
}

#[test]
fn bake_answers_what_it_made_and_measured() {
    let place = Workplace::new("test_strokes = 1");
    let keys = [
        ("command", Text),
        ("tool", Text),
        ("mode", Text),
        ("recipe", Text),
        ("asset", Text),
        ("bytes", Number),
        ("seconds", Number),
        ("unchanged", Bool),
        ("stages", List),
        ("metrics", Object),
        ("warnings", List),
        ("preview", Maybe(&Text)),
        ("cache", Maybe(&Object)),
    ];
    let bake = ["bake", "r.toml", "-o", "r.squall", "--preview", "p.png", "--cache", "c", "--json"];
    let baked = answer(&place, 0, &bake);
    has(&baked, &keys);
    let stage = [("stage", Text), ("made", Text), ("seconds", Number), ("bytes", Number), ("error", Text)];
    baked["stages"].as_array().unwrap().iter().for_each(|value| has(value, &stage));
    let metrics: Vec<(&str, Kind)> =
        squall_bake::metrics::METRICS.iter().map(|metric| (metric.name, Maybe(&Number))).collect();
    has(&baked["metrics"], &metrics);
    let cache = [
        ("folder", Text),
        ("rows_found", Number),
        ("rows_solved", Number),
        ("strokes_found", Number),
        ("strokes_solved", Number),
    ];
    has(&baked["cache"], &cache);
    assert_eq!((&baked["preview"], &baked["unchanged"]), (&"p.png".into(), &false.into()));
    assert_eq!(baked["bytes"], std::fs::metadata(place.path("r.squall")).unwrap().len());

    let same = answer(&place, 0, &["bake", "r.toml", "-o", "r.squall", "--if-changed", "--json"]);
    has(&same, &keys);
    assert_eq!((&same["unchanged"], &same["metrics"]), (&true.into(), &baked["metrics"]));

    let input = [("name", Text), ("bytes", Number), ("blake3", Text)];
    let checked = answer(&place, 0, &["bake", "r.toml", "--check", "--json"]);
    let mode = [("command", Text), ("tool", Text), ("mode", Text), ("recipe", Text), ("inputs", List)];
    has(&checked, &mode);
    checked["inputs"].as_array().unwrap().iter().for_each(|value| has(value, &input));
    let foreseen = answer(&place, 0, &["bake", "r.toml", "--dry-run", "--json"]);
    has(&foreseen, &[&mode[..], &[("estimate", Object)]].concat());
    let estimate = [
        ("clouds", Maybe(&Object)),
        ("streak_pictures", Number),
        ("threads", Number),
        ("memory_bytes", Number),
        ("cpu_seconds", Number),
        ("seconds", Number),
    ];
    has(&foreseen["estimate"], &estimate);
    let clouds = [
        ("cells", List),
        ("solve_cells", Number),
        ("directions", Number),
        ("light_grid", List),
        ("virtual_lights", Number),
        ("distant", Number),
        ("coefficients", Number),
        ("held_out_strokes", Number),
        ("held_out_points", Number),
        ("sweeps", Number),
        ("cpu_seconds", Number),
        ("chosen_by_budget", Bool),
    ];
    has(&foreseen["estimate"]["clouds"], &clouds);
}

#[test]
fn inspect_answers_what_is_inside() {
    let place = Workplace::new("test_strokes = 1\ndistant = [\"upper-sky\"]");
    place.bake(&[]);
    let found = answer(&place, 0, &["inspect", "r.squall", "--json"]);
    let keys = [
        ("command", Text),
        ("format_version", Number),
        ("bytes", Number),
        ("tool", Maybe(&Text)),
        ("recipe_hash", Maybe(&Text)),
        ("inputs", List),
        ("sections", List),
        ("budgets", List),
        ("grid", Maybe(&Object)),
        ("response", Maybe(&Object)),
        ("strokes", Maybe(&List)),
        ("view", Maybe(&Object)),
    ];
    has(&found, &keys);
    let grid = [
        ("cells", List),
        ("cell_m", List),
        ("origin_m", List),
        ("albedo", Number),
        ("g", Number),
        ("periodic_xy", Bool),
    ];
    has(&found["grid"], &grid);
    let response = [
        ("light_grid", Maybe(&List)),
        ("bounds_m", Maybe(&List)),
        ("virtual_lights", Maybe(&Number)),
        ("prune", Maybe(&Bool)),
        ("share_of_bounds", Maybe(&Number)),
        ("distant", List),
        ("basis", Text),
        ("degree", Maybe(&Number)),
        ("coefficients", Number),
        ("direct", Text),
        ("codec", Text),
        ("view_region", Maybe(&Object)),
        ("sun", Maybe(&Object)),
        ("light_cells", List),
        ("cells", Number),
        ("lit_cells", Number),
        ("finer_levels", List),
    ];
    has(&found["response"], &response);
    let names: Vec<&str> =
        found["inputs"].as_array().unwrap().iter().map(|i| i["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["streak0.png", "town.json", "cloud.json", "cloud.f32"]);
    let hash = blake3::hash(&std::fs::read(place.path("cloud.f32")).unwrap()).to_hex();
    assert_eq!(found["inputs"][3]["blake3"], hash.as_str());
    assert_eq!(found["strokes"][0]["name"], "a");
    assert_eq!(found["view"]["camera"]["position_m"][1], -400.0);
    assert_eq!(
        (&found["response"]["prune"], &found["response"]["share_of_bounds"]),
        (&false.into(), &1.0.into())
    );
}

#[test]
fn verify_answers_whether_an_asset_is_whole() {
    let place = Workplace::new("test_strokes = 0");
    place.bake(&[]);
    let keys = [
        ("command", Text),
        ("tool", Text),
        ("asset", Text),
        ("whole", Bool),
        ("bytes", Maybe(&Number)),
        ("sections", Maybe(&Number)),
        ("unknown", Maybe(&Number)),
        ("rows", Maybe(&Number)),
        ("damage", Maybe(&Text)),
    ];
    let whole = answer(&place, 0, &["verify", "r.squall", "--json"]);
    has(&whole, &keys);
    // 64 virtual lights, and the two hemispheres of the sky that the view shows; its sun is down.
    assert_eq!((&whole["whole"], &whole["rows"]), (&true.into(), &66.into()));
    let mut bytes = std::fs::read(place.path("r.squall")).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(place.path("r.squall"), bytes).unwrap();
    let damaged = answer(&place, 1, &["verify", "r.squall", "--json"]);
    has(&damaged, &keys);
    assert!(damaged["whole"] == false && damaged["damage"].is_string(), "{damaged}");
}

#[test]
fn render_and_relight_answer_what_was_drawn() {
    let place = Workplace::new("test_strokes = 0");
    place.bake(&[]);
    let keys = [
        ("command", Text),
        ("tool", Text),
        ("asset", Text),
        ("picture", Text),
        ("size_px", List),
        ("frames", Number),
        ("lights", Maybe(&Number)),
        ("lights_live", Maybe(&Number)),
        ("gather_residual", Maybe(&Number)),
        ("sources", Maybe(&Number)),
        ("streaks", Maybe(&Number)),
        ("kept", Number),
        ("sky", Maybe(&Text)),
        ("flashes", Maybe(&List)),
        ("seconds", Number),
    ];
    let frame = answer(&place, 0, &["render", "r.squall", "-o", "p.png", "--json"]);
    has(&frame, &keys);
    assert!(frame["lights"].as_u64() > Some(0) && frame["size_px"] == serde_json::json!([32, 18]), "{frame}");
    let sheet = answer(&place, 0, &["render", "r.squall", "-o", "p.png", "--contact-sheet", "--json"]);
    has(&sheet, &keys);
    assert_eq!((&sheet["frames"], &sheet["lights"]), (&8.into(), &Value::Null));

    let lamps = r#"[{"position_m": [0, 0, 600], "intensity_W_per_sr": 1000}]"#;
    std::fs::write(place.path("lamps.json"), lamps).unwrap();
    let camera = r#"{"name": "side", "type": "perspective", "origin_m": [0, -900, 500], "target_m": [0, 0, 500],
        "up": [0, 0, 1], "horizontal_fov_deg": 60, "width": 16, "height": 9}"#;
    std::fs::write(place.path("camera.json"), camera).unwrap();
    let relight = ["relight", "r.squall", "--lamps", "lamps.json", "--camera", "camera.json", "-o", "p.exr"];
    let keys = [
        ("command", Text),
        ("tool", Text),
        ("asset", Text),
        ("picture", Text),
        ("fields", Maybe(&Text)),
        ("files", List),
        ("dims_xyz", List),
        ("exposure", Number),
        ("seconds", Number),
        ("lamps", Number),
        ("lamps_outside", Number),
        ("sources", Number),
        ("reach_m", List),
        ("direct", Text),
        ("relight_ms", Number),
        ("error_bound", Number),
        ("live", Maybe(&Object)),
        ("gathered", Maybe(&Object)),
        ("exact_direct", Bool),
    ];
    let lit = answer(&place, 0, &[&relight[..], &["--json"]].concat());
    has(&lit, &keys);
    let lit = answer(&place, 0, &[&relight[..], &["--field", "fields", "--json"]].concat());
    has(&lit, &keys);
    assert!(lit["files"].as_array().unwrap().contains(&"relight.json".into()), "{lit}");
}

#[test]
fn solve_and_synth_answer_which_files_they_wrote() {
    let place = Workplace::new("test_strokes = 0");
    let cloud = ["synth", "cloud", "-o", "c", "--kind", "layer", "--cells", "4x4x2", "--json"];
    let keys = [("command", Text), ("tool", Text), ("seed", Number), ("files", List)];
    let from = ["--from", "0,0,0", "--to", "0,0,100"];
    for (words, files) in [
        (&cloud[..], &["c.json", "c.f32"][..]),
        (&["synth", "town", "-o", "t.json", "--json"], &["t.json"]),
        (&[&["synth", "stroke", "-o", "s.json", "--json"], &from[..]].concat(), &["s.json"]),
        (&["synth", "streaks", "-o", "d", "--count", "1", "--json"], &["d/drop00.png"]),
    ] {
        let (code, out, said) = place.squall(words);
        assert_eq!(code, 0, "{said}");
        let value: Value = serde_json::from_str(&out).unwrap();
        has(&value, &keys);
        assert_eq!(value["command"], words[..2].join(" "));
        let found: Vec<&str> =
            value["files"].as_array().unwrap().iter().map(|file| file.as_str().unwrap()).collect();
        assert_eq!(found, files);
        assert!(files.iter().all(|file| place.path(file).exists()), "{files:?}");
    }
    let scene = std::fs::read_to_string(place.path("cloud.json")).unwrap();
    let mut scene: Value = serde_json::from_str(&scene).unwrap();
    scene["lights"] = serde_json::json!([{ "name": "l", "type": "point", "position_m": [0, 0, 500], "intensity_W_per_sr": 1 }]);
    std::fs::write(place.path("cloud.json"), scene.to_string()).unwrap();
    let solve = ["solve", "cloud.json", "--lamp", "l", "-o", "out", "--json"];
    let both = [
        ("command", Text),
        ("tool", Text),
        ("folder", Text),
        ("scene", Text),
        ("lamp", Text),
        ("method", Text),
        ("dims_xyz", List),
        ("seconds", Number),
        ("files", List),
        ("refinement", Number),
        ("residual", Maybe(&Number)),
        ("sweeps", Maybe(&Number)),
    ];
    for method in ["sweep", "monte-carlo"] {
        let solved = answer(&place, 0, &[&solve[..], &["--method", method]].concat());
        for (key, kind) in both {
            assert!(kind.holds(&solved[key]), "{method}: {key}: {solved}");
        }
        // What the method says beyond that is what solve.json says.
        let kept = std::fs::read(place.path("out/solve.json")).unwrap();
        let kept: Value = serde_json::from_slice(&kept).unwrap();
        for (key, value) in kept.as_object().unwrap() {
            assert!(key == "files" || solved[key] == *value, "{key}");
        }
    }
}

#[test]
fn what_went_wrong_is_told_in_json_too_and_in_words_as_ever() {
    let place = Workplace::new("test_strokes = 1");
    for (words, code) in [
        (&["bake", "none.toml", "-o", "r.squall", "--json"][..], 3),
        (&["bake", "r.toml", "-o", "r.squall", "--max-error", "stroke_l2=0", "--json"], 1),
        (&["verify", "r.toml", "--json"], 3),
        (&["render", "none.squall", "-o", "p.png", "--json"], 3),
        (&["inspect", "none.squall", "--json"], 3),
        (&["solve", "none.json", "--lamp", "l", "-o", "out", "--json"], 3),
        (&["bake", "r.toml", "-o", "none/r.squall", "--json"], 3),
    ] {
        let failed = answer(&place, code, words);
        has(&failed, &[("command", Text), ("error", Object)]);
        has(&failed["error"], &[("exit_code", Number), ("message", Text)]);
        assert_eq!(failed["error"]["exit_code"], code);
        let without: Vec<&str> = words.iter().copied().filter(|word| *word != "--json").collect();
        let (_, out, said) = place.squall(&without);
        let message = failed["error"]["message"].as_str().unwrap();
        assert!(out.is_empty() && said.trim_end().ends_with(&format!("squall: {message}")), "{said}");
    }
}
