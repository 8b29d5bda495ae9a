//! `squall chart --peers` from outside: what scripts are handed, what is made of their answers, and which are refused.

use assert_cmd::Command;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command as Program;

/// Light goes through the Haar transform and back before a script has it: some additions in single precision.
const ROUNDING: f64 = 1e-6;

/// Beginning of a script that needs nothing but Python: what `list` answers, and the rows and the task for `code`.
const SCRIPT: &str = r#"
import array, json, sys
if sys.argv[1] == "list":
    print(json.dumps({"peers": PEERS, "absent": ["brick: no module"]}))
    sys.exit()
folder = sys.argv[3] + "/"
task = json.load(open(folder + "task.json"))
rows = array.array("f", open(folder + "rows.f32", "rb").read())
count, (channels, z, y, x) = task["rows"], task["shape"]
assert len(rows) == count * channels * z * y * x
def answer(rows, bytes, seconds):
    open(folder + "back.f32", "wb").write(rows.tobytes())
    json.dump({"bytes": bytes, "seconds": seconds}, open(folder + "coded.json", "w"))
"#;

fn python() -> bool {
    let found = Program::new("python3").arg("--version").output().is_ok_and(|output| output.status.success());
    if !found {
        println!("skipped: no python3");
    }
    found
}

/// A script with peers of these names in the place that is returned.
fn script(folder: &Path, names: &[&str], code: &str) -> PathBuf {
    let peers: Vec<Value> =
        names.iter().map(|name| serde_json::json!({"id": name, "name": format!("{name} 1.0")})).collect();
    let path = folder.join("peers.py");
    std::fs::write(&path, SCRIPT.replace("PEERS", &Value::from(peers).to_string()) + code).unwrap();
    path
}

fn arguments(out: &Path, more: &[&str]) -> Vec<String> {
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/golden.toml");
    let mut all = vec!["chart".to_owned(), recipe.display().to_string()];
    all.extend(["-o".to_owned(), out.display().to_string(), "--quick".to_owned()]);
    all.extend(more.iter().map(|&word| word.to_owned()));
    all
}

/// Sweeps compression; temporary files go to `folder`/tmp, of which nothing may be left. Exit code, rows, standard error.
fn compression(folder: &Path, peers: Option<&Path>) -> (i32, Vec<Value>, String) {
    let (out, temporary) = (folder.join("out"), folder.join("tmp"));
    std::fs::create_dir_all(&temporary).unwrap();
    let mut more = vec!["--only", "compression"];
    more.extend(peers.iter().flat_map(|path| ["--peers", path.to_str().unwrap()]));
    let mut call = Command::cargo_bin("squall").unwrap();
    let output = call.args(arguments(&out, &more)).env("TMPDIR", &temporary).output().unwrap();
    assert_eq!(temporary.read_dir().unwrap().count(), 0, "temporary files are left");
    let rows = match std::fs::read(out.join("data.json")) {
        Ok(text) => serde_json::from_slice(&text).unwrap(),
        Err(_) => Vec::new(),
    };
    (output.status.code().unwrap(), rows, String::from_utf8(output.stderr).unwrap())
}

#[test]
fn rows_that_come_back_are_judged_as_ours_are_with_the_bytes_and_times_that_the_script_gives() {
    if !python() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let code = r#"
if sys.argv[2] == "loud":
    rows = array.array("f", (1.125 * value for value in rows))
answer(rows, [100] * count, [[0.25] * count] * 3 if sys.argv[2] == "copy" else [])
"#;
    let script = script(folder.path(), &["copy", "loud"], code);
    let (code, rows, error) = compression(folder.path(), Some(&script));
    assert_eq!(code, 0, "{error}");
    assert!(error.contains("note: ") && error.contains("brick: no module"), "{error}");
    let of = |series: &str, cost: &str| -> Vec<&Value> {
        let mine = rows.iter().filter(|row| row["series"] == series);
        mine.filter(|row| row["cost_metric"].as_str().unwrap().starts_with(cost)).collect()
    };
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap();
    let (copied, loud) = (of("copy 1.0", "bytes"), of("loud 1.0", "bytes"));
    // Three kinds of rows, two errors asked for, three measures.
    assert_eq!((copied.len(), loud.len()), (18, 18));
    for row in copied {
        assert!(number(row, "error") < ROUNDING, "{row}");
        // Streams, and a share of the section's head and index.
        assert!((100.0..300.0).contains(&number(row, "cost_median")), "{row}");
    }
    for row in loud {
        // An eighth too much everywhere is an eighth in L2 and in the median, and at most that over the peak.
        let error = number(row, "error");
        let exact = row["error_metric"] != "relit, 99.9th percentile over the peak";
        assert!(error < 0.125 + ROUNDING && (!exact || error > 0.125 - ROUNDING), "{row}");
    }
    let times = of("copy 1.0", "relight");
    assert_eq!(times.len(), 6);
    for row in times {
        // Whole rows of a quarter of a second each, a mean over two strokes, and far less than a millisecond for adding them up.
        let eighths = number(row, "cost_median") / 125e3;
        assert!(eighths >= 2.0 && (0.0..0.008).contains(&(eighths - eighths.floor())), "{row}");
    }
    assert!(of("loud 1.0", "relight").is_empty(), "a cost that was not measured is shown");
}

#[test]
fn without_any_peer_the_chart_is_as_it_was() {
    if !python() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let script = script(folder.path(), &[], "");
    let points = |peers: Option<&Path>| {
        let (code, rows, error) = compression(folder.path(), peers);
        assert_eq!(code, 0, "{error}");
        let said = ["series", "setting", "error_metric", "cost_metric", "bytes"];
        let points = rows.iter().map(|row| said.map(|key| row[key].clone()));
        let errors: Vec<String> = rows.iter().map(|row| row["error"].to_string()).collect();
        (points.collect::<Vec<_>>(), errors)
    };
    let alone = points(None);
    assert!(!alone.0.is_empty());
    assert!(points(Some(&script)) == alone);
}

#[test]
fn answers_that_do_not_fit_are_refused_and_leave_nothing() {
    if !python() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("peers.py");
    let refused = |code: &str, words: &[&str]| {
        let (exit, rows, error) = compression(folder.path(), Some(&path));
        assert!(exit == 3 && rows.is_empty() && !folder.path().join("out").exists(), "{code}: {error}");
        for word in words.iter().chain(&["peers.py"]) {
            assert!(error.contains(word), "{code}: {word} is missing in: {error}");
        }
    };
    let one = |code: &str, words: &[&str]| {
        script(folder.path(), &["brick"], code);
        refused(code, words);
    };
    one("answer(rows[:-3], [1] * count, [])", &["back.f32 of brick", "wanted", "found", "bytes"]);
    one("answer(rows, [1], [])", &["coded.json of brick: bytes", "found 1"]);
    one("answer(rows, [1] * count, [[1.0]])", &["coded.json of brick: seconds", "found 1"]);
    one("rows[7] = float('nan')\nanswer(rows, [1] * count, [])", &["row 0, value 7", "finite", "NaN"]);
    one("", &["coded.json of brick", "no file"]);
    one("raise SystemExit('no clay')", &["code brick", "exit status 0", "no clay"]);
    std::fs::write(&path, "print('bricks')").unwrap();
    refused("list", &["list", "\"peers\""]);
    std::fs::remove_file(&path).unwrap();
    refused("missing", &["--peers", "no such file"]);
}

#[cfg(unix)]
#[test]
fn an_interruption_stops_the_script_and_what_was_finished_waits() {
    use std::time::{Duration, Instant};
    /// Far more than stopping takes, and far less than the script would sleep.
    const SOON: Duration = Duration::from_secs(30);
    if !python() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (out, temporary) = (folder.path().join("out"), folder.path().join("tmp"));
    std::fs::create_dir_all(&temporary).unwrap();
    std::fs::create_dir_all(&out).unwrap();
    let begun = temporary.join("begun");
    let code = format!("open({begun:?}, 'w')\nimport time\ntime.sleep(300)");
    let script = script(folder.path(), &["slow"], &code);
    let more = ["--only", "density,compression", "--peers", script.to_str().unwrap()];
    let mut call = Program::new(assert_cmd::cargo::cargo_bin("squall"));
    let mut child = call.args(arguments(&out, &more)).env("TMPDIR", &temporary).spawn().unwrap();
    let start = Instant::now();
    while !begun.exists() && child.try_wait().unwrap().is_none() && start.elapsed() < 4 * SOON {
        std::thread::sleep(Duration::from_millis(5));
    }
    let start = Instant::now();
    // To the program alone: a terminal would stop the script too.
    Program::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(start.elapsed() < SOON);
    std::fs::remove_file(&begun).unwrap();
    assert_eq!(temporary.read_dir().unwrap().count(), 0, "temporary files are left");
    let left = || {
        let names = out.read_dir().unwrap().map(|file| file.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.starts_with(".density-")).count()
    };
    assert_eq!(left(), 1);
    // Another script is no reason to sweep the other charts again.
    std::fs::write(
        &script,
        std::fs::read_to_string(&script).unwrap().replace("time.sleep(300)", "answer(rows, [1] * count, [])"),
    )
    .unwrap();
    let mut call = Command::cargo_bin("squall").unwrap();
    let output =
        call.args(arguments(&out, &more)).arg("--resume").env("TMPDIR", &temporary).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(left(), 0, "an earlier density was not taken");
    assert!(std::fs::read_to_string(out.join("data.csv")).unwrap().contains("slow 1.0"));
}

/// `data/peers/compress.py` by itself, on waves that fall off: each row within what was asked, in fewer bytes for more error.
#[test]
fn zfp_and_sz3_keep_the_error_that_they_are_asked_for_where_they_are_installed() {
    const SHAPE: [usize; 4] = [4, 6, 8, 10];
    const ROWS: usize = 2;
    if !python() {
        return;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/peers/compress.py");
    let call = |arguments: &[&str]| {
        let output = Program::new("python3").arg(&script).args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    let listed: Value = serde_json::from_slice(&call(&["list"])).unwrap();
    let peers = listed["peers"].as_array().unwrap();
    if peers.is_empty() {
        println!("skipped: no zfpy, no pysz: {}", listed["absent"]);
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let length: usize = SHAPE.iter().product();
    let wave = |i: usize| libm::exp(-(i as f64) * 1e-3) * (2.0 + libm::sin(i as f64 * 0.3));
    let rows: Vec<f32> = (0..ROWS * length).map(|i| wave(i) as f32).collect();
    let raw: Vec<u8> = rows.iter().flat_map(|value| value.to_le_bytes()).collect();
    std::fs::write(folder.path().join("rows.f32"), raw).unwrap();
    for peer in peers {
        let mut before = 0;
        for asked in [0.1, 1e-2, 1e-4] {
            let task = serde_json::json!({"shape": SHAPE, "rows": ROWS, "relative_l2": asked, "repeats": 2});
            std::fs::write(folder.path().join("task.json"), task.to_string()).unwrap();
            call(&["code", peer["id"].as_str().unwrap(), folder.path().to_str().unwrap()]);
            let back = std::fs::read(folder.path().join("back.f32")).unwrap();
            let back: Vec<f32> =
                back.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
            assert_eq!(back.len(), rows.len());
            for (found, wanted) in back.chunks(length).zip(rows.chunks(length)) {
                let square = |values: &mut dyn Iterator<Item = f32>| -> f64 {
                    values.map(|value| f64::from(value) * f64::from(value)).sum()
                };
                let off = square(&mut found.iter().zip(wanted).map(|(a, b)| a - b));
                let relative = libm::sqrt(off / square(&mut wanted.iter().copied()));
                // A bound is halved at worst, and zfp's error with it.
                assert!(relative <= asked && relative > asked / 10.0, "{peer}, {asked}: {relative}");
            }
            let coded: Value =
                serde_json::from_slice(&std::fs::read(folder.path().join("coded.json")).unwrap()).unwrap();
            let bytes: u64 = coded["bytes"].as_array().unwrap().iter().map(|b| b.as_u64().unwrap()).sum();
            assert!(bytes > before, "{peer}, {asked}: {bytes} bytes after {before}");
            before = bytes;
            let seconds = coded["seconds"].as_array().unwrap();
            assert!(
                seconds.len() == 2 && seconds.iter().all(|times| times.as_array().unwrap().len() == ROWS)
            );
        }
    }
}
