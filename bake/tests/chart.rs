//! `squall chart` from outside: files, columns, and a page that a real browser opens.

use assert_cmd::Command;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::process::Command as Program;

const COLUMNS: [&str; 14] = [
    "chart",
    "series",
    "setting",
    "truth",
    "error_metric",
    "error",
    "cost_metric",
    "cost_median",
    "cost_p10",
    "cost_p90",
    "bytes",
    "pareto",
    "chosen",
    "baseline",
];
const IDS: [&str; 10] = [
    "streaks",
    "density",
    "transport",
    "lightning-grid",
    "gathers",
    "compression",
    "end-to-end",
    "frame",
    "rain-frame",
    "rain-table",
];

fn recipe() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/golden.toml")
}

fn chart(folder: &Path, more: &[&str]) -> (i32, String) {
    let mut call = Command::cargo_bin("squall").unwrap();
    let output =
        call.arg("chart").arg(recipe()).arg("-o").arg(folder).arg("--quick").args(more).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

/// A browser that can do without a screen, if there is one.
fn browser() -> Option<&'static str> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let found = names.into_iter().find(|name| Program::new(name).arg("--version").output().is_ok());
    if found.is_none() {
        assert!(
            std::env::var_os("SQUALL_REQUIRE_BROWSER").is_none(),
            "SQUALL_REQUIRE_BROWSER is set, and there is none"
        );
        println!("skipped: no browser");
    }
    found
}

/// The page as a browser of some width has it once its script has run.
fn opened(browser: &str, page: &Path, width: u32) -> String {
    let output = Program::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=2000", "--dump-dom"])
        .arg(format!("--window-size={width},900"))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn a_quick_sweep_writes_every_chart_its_data_and_a_page_that_a_browser_shows() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("charts");
    let (code, error) = chart(&out, &[]);
    assert_eq!(code, 0, "{error}");

    let rows: Vec<serde_json::Value> =
        serde_json::from_slice(&std::fs::read(out.join("data.json")).unwrap()).unwrap();
    let csv = std::fs::read_to_string(out.join("data.csv")).unwrap();
    assert_eq!(csv.lines().next().unwrap(), COLUMNS.join(","));
    assert_eq!(csv.lines().count(), rows.len() + 1, "a line a row");
    let charts: HashSet<&str> = rows.iter().map(|row| row["chart"].as_str().unwrap()).collect();
    assert_eq!(charts, HashSet::from(IDS));
    for id in IDS {
        let mine: Vec<_> = rows.iter().filter(|row| row["chart"] == id).collect();
        // The paper's table 1 has times without errors: nothing there is better than another.
        let has_front = mine.iter().any(|row| row["pareto"] == true);
        assert_eq!(has_front, id != "rain-table", "{id}");
        let series: HashSet<&str> = mine.iter().map(|row| row["series"].as_str().unwrap()).collect();
        assert!(series.len() > 1, "{id}: {series:?}");
        let svg = std::fs::read_to_string(out.join(format!("{id}.svg"))).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), "{id}");
        assert_eq!(svg.matches("class=\"point\"").count(), mine.len(), "{id}");
    }
    for id in IDS {
        assert!(
            rows.iter().any(|row| row["chart"] == id && row["chosen"] == true),
            "{id} has nothing chosen"
        );
    }
    assert!(rows.iter().any(|row| row["chart"] == "streaks" && row["baseline"] == true));

    let page = std::fs::read_to_string(out.join("index.html")).unwrap();
    let namespace = "http://www.w3.org/2000/svg";
    assert!(!page.replace(namespace, "").contains("http"), "the page wants the network");
    assert!(page.contains("prefers-color-scheme: dark") && page.contains("width=device-width"));
    let Some(browser) = browser() else { return };
    // A desk's screen and a telephone's.
    for width in [1200, 390] {
        let shown = opened(browser, &out.join("index.html"), width);
        assert!(shown.contains(&format!("data-points=\"{}\"", rows.len())), "the script did not run");
        assert!(shown.contains("data-fits=\"true\""), "wider than a window of {width} px");
        assert_eq!(shown.matches("<table").count(), IDS.len());
    }
}

#[test]
fn only_the_charts_asked_for_are_made() {
    let folder = tempfile::tempdir().unwrap();
    let (code, error) = chart(folder.path(), &["--only", "density"]);
    assert_eq!(code, 0, "{error}");
    assert!(folder.path().join("density.svg").is_file() && !folder.path().join("streaks.svg").exists());
    let (code, error) = chart(folder.path(), &["--only", "colour"]);
    assert!(code == 2 && error.contains("rain-frame"), "{error}");
}

#[test]
fn reference_data_that_is_not_there_is_bad_input_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("charts");
    let (code, error) = chart(&out, &["--reference", "no/such/folder"]);
    assert_eq!(code, 3, "{error}");
    assert!(error.contains("no/such/folder") && !out.exists(), "{error}");
}

#[test]
fn an_earlier_sweep_is_drawn_again_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(chart(folder.path(), &["--only", "density"]).0, 0);
    let files =
        ["data.csv", "data.json", "density.svg", "density-card.svg"].map(|name| folder.path().join(name));
    let before: Vec<Vec<u8>> = files.iter().map(|file| std::fs::read(file).unwrap()).collect();
    let mut call = Command::cargo_bin("squall").unwrap();
    let output =
        call.arg("chart").arg(recipe()).arg("-o").arg(folder.path()).arg("--redraw").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for (file, before) in files.iter().zip(before) {
        assert!(std::fs::read(file).unwrap() == before, "{}", file.display());
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_sweep_goes_on_with_the_charts_that_it_had_finished() {
    use std::time::{Duration, Instant};
    let folder = tempfile::tempdir().unwrap();
    let start = || {
        let mut call = Program::new(assert_cmd::cargo::cargo_bin("squall"));
        call.arg("chart").arg(recipe()).arg("-o").arg(folder.path()).arg("--quick");
        call
    };
    let parts = || {
        let names =
            folder.path().read_dir().unwrap().map(|file| file.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.starts_with('.') && name.ends_with(".json")).collect::<Vec<_>>()
    };
    let mut child = start().args(["--only", "density,transport"]).spawn().unwrap();
    let begun = Instant::now();
    while parts().is_empty()
        && child.try_wait().unwrap().is_none()
        && begun.elapsed() < Duration::from_secs(60)
    {
        std::thread::sleep(Duration::from_millis(5));
    }
    Program::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let code = child.wait().unwrap().code();
    if code == Some(0) {
        println!("skipped: the sweep was over before it could be interrupted");
        return;
    }
    assert_eq!(code, Some(130));
    let left = parts();
    assert!(left.iter().any(|name| name.contains("density")) && !folder.path().join("data.csv").exists());
    // What was finished is taken as it was left: a mark in it shows in the result.
    let file = folder.path().join(left.iter().find(|name| name.contains("density")).unwrap());
    let text = std::fs::read_to_string(&file).unwrap().replace("16 classes", "sixteen classes");
    std::fs::write(&file, text).unwrap();
    assert!(start().args(["--only", "density,transport", "--resume"]).status().unwrap().success());
    assert!(parts().is_empty());
    let csv = std::fs::read_to_string(folder.path().join("data.csv")).unwrap();
    assert!(csv.contains("transport") && csv.contains("sixteen classes"), "{csv}");
}
