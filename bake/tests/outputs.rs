//! Where outputs go and how a command stops: rights, links, standard output, signals, memory.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const SQUALL: &str = env!("CARGO_BIN_EXE_squall");

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../data").join(name)
}

fn golden() -> PathBuf {
    data("golden/v1/golden.toml")
}

fn squall(arguments: &[&dyn AsRef<std::ffi::OsStr>]) -> Output {
    let mut command = Command::new(SQUALL);
    arguments.iter().for_each(|argument| _ = command.arg(argument));
    command.stdin(Stdio::null()).output().unwrap()
}

fn words(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[track_caller]
fn refused(output: &Output, code: i32, because: &str) {
    let words = words(output);
    assert_eq!(output.status.code(), Some(code), "{words}");
    assert!(words.contains(because) && words.lines().count() == 1, "{words}");
    // What is refused before the work has no bytes to keep.
    assert!(!words.contains("kept in"), "{words}");
}

fn names(folder: &Path) -> Vec<String> {
    let name = |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
    let mut names: Vec<String> = folder.read_dir().unwrap().map(name).collect();
    names.sort();
    names
}

/// An ordinary user, as whom the superuser's tests of rights run; rights do not bind the superuser.
const NOBODY: u32 = 65534;

/// The command as [`NOBODY`], copied to where that user may run it with the recipe's inputs; `None` where this is not the superuser,
/// or the system cannot change users.
#[cfg(unix)]
struct AsNobody(tempfile::TempDir);

#[cfg(unix)]
impl AsNobody {
    fn new() -> Option<Self> {
        use std::os::unix::fs::{PermissionsExt, chown};
        let folder = tempfile::tempdir().unwrap();
        std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
        for entry in golden().parent().unwrap().read_dir().unwrap() {
            let path = entry.unwrap().path();
            std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
        }
        std::fs::copy(SQUALL, folder.path().join("squall")).unwrap();
        std::fs::create_dir(folder.path().join("own")).unwrap();
        chown(folder.path().join("own"), Some(NOBODY), Some(NOBODY)).ok()?;
        let runs = Self(folder);
        runs.run(&["--version"]).is_some_and(|output| output.status.success()).then_some(runs)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn run(&self, arguments: &[&str]) -> Option<Output> {
        let user = NOBODY.to_string();
        let ids = ["--reuid", &user, "--regid", &user, "--clear-groups"];
        let command = self.path("squall");
        Command::new("setpriv")
            .args(ids)
            .arg(command)
            .args(arguments)
            .current_dir(self.0.path())
            .output()
            .ok()
    }

    fn bake(&self, out: &str) -> Output {
        self.run(&["bake", "golden.toml", "-o", out]).unwrap()
    }
}

#[cfg(unix)]
#[test]
fn rights_are_tried_before_the_work_where_a_link_leads_and_for_the_file_in_the_way() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let Some(nobody) = AsNobody::new() else {
        println!("skipped: no right to run as another user");
        return;
    };
    // A link in a folder of one's own to a folder without rights.
    std::fs::create_dir(nobody.path("locked")).unwrap();
    symlink("../locked/a.squall", nobody.path("own/out.squall")).unwrap();
    refused(&nobody.bake("own/out.squall"), 4, "Permission denied");
    // Another user's file in a sticky folder.
    std::fs::create_dir(nobody.path("sticky")).unwrap();
    std::fs::set_permissions(nobody.path("sticky"), std::fs::Permissions::from_mode(0o1777)).unwrap();
    std::fs::write(nobody.path("sticky/a.squall"), b"theirs").unwrap();
    refused(&nobody.bake("sticky/a.squall"), 4, "not permitted");
    assert_eq!(std::fs::read(nobody.path("sticky/a.squall")).unwrap(), b"theirs");
    assert_eq!(names(&nobody.path("sticky")), ["a.squall"]);
    // The reverse: a link in a folder without rights to a file that may be replaced.
    symlink("../own/b.squall", nobody.path("locked/link.squall")).unwrap();
    let done = nobody.bake("locked/link.squall");
    assert_eq!(done.status.code(), Some(0), "{}", words(&done));
    assert!(std::fs::read(nobody.path("own/b.squall")).unwrap().starts_with(b"\x89SQUALL\n"));
    assert_eq!(names(&nobody.path("own")), ["b.squall", "out.squall"]);
}

#[cfg(unix)]
#[test]
fn an_asset_keeps_the_owner_and_the_mode_of_the_one_it_replaces() {
    use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.squall");
    std::fs::write(&out, b"old").unwrap();
    let given = chown(&out, Some(NOBODY), Some(NOBODY)).is_ok();
    std::fs::set_permissions(&out, std::fs::Permissions::from_mode(0o640)).unwrap();
    let before = out.metadata().unwrap();
    assert!(squall(&[&"bake", &golden(), &"-o", &out]).status.success());
    let after = out.metadata().unwrap();
    assert_eq!(after.mode() & 0o7777, 0o640);
    assert_eq!((after.uid(), after.gid()), (before.uid(), before.gid()));
    if !given {
        println!("skipped: no right to give a file away");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_file_that_cannot_be_changed_is_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.squall");
    std::fs::write(&out, b"old").unwrap();
    let set =
        |flag: &str| Command::new("chattr").arg(flag).arg(&out).output().is_ok_and(|o| o.status.success());
    if !set("+i") {
        println!("skipped: no right or no file system for immutable files");
        return;
    }
    let tried = squall(&[&"bake", &golden(), &"-o", &out]);
    assert!(set("-i"));
    refused(&tried, 4, "not permitted");
    assert_eq!(std::fs::read(&out).unwrap(), b"old");
}

#[cfg(unix)]
#[test]
fn a_name_that_is_too_long_is_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a".repeat(280) + ".squall");
    refused(&squall(&[&"bake", &golden(), &"-o", &out]), 4, "name too long");
    assert_eq!(names(folder.path()), [""; 0]);
}

#[cfg(target_os = "linux")]
#[test]
fn standard_output_gets_the_bytes_of_the_file_and_standard_error_the_words() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.squall");
    let to_file = squall(&[&"bake", &golden(), &"-o", &out]);
    assert!(to_file.stdout.is_empty() && words(&to_file).contains("whole asset"), "{}", words(&to_file));
    let asset = std::fs::read(&out).unwrap();
    for name in ["-", "/dev/stdout", "/dev/fd/1"] {
        let piped = squall(&[&"bake", &golden(), &"-o", &name]);
        assert!(piped.status.success() && piped.stdout == asset, "{name}");
        assert!(words(&piped).contains("whole asset"), "{}", words(&piped));
    }
    // Into a file that the shell has opened, which is not replaced.
    let held = folder.path().join("held");
    let file = std::fs::File::create(&held).unwrap();
    let done =
        Command::new(SQUALL).arg("bake").arg(golden()).args(["-o", "/dev/stdout"]).stdout(file).output();
    assert!(done.unwrap().status.success());
    assert!(std::fs::read(&held).unwrap() == asset);
    // A picture, in the form that is asked for.
    let drawn = squall(&[&"render", &out, &"-o", &"-"]);
    assert!(drawn.stdout.starts_with(b"\x89PNG"), "{}", words(&drawn));
    let drawn = squall(&[&"render", &out, &"-o", &"-", &"--format", &"exr"]);
    assert!(drawn.stdout.starts_with(&[0x76, 0x2f, 0x31, 0x01]), "{}", words(&drawn));
    let town = squall(&[&"synth", &"town", &"-o", &"-"]);
    assert!(serde_json::from_slice::<serde_json::Value>(&town.stdout).is_ok());
    assert_eq!(names(folder.path()), ["a.squall", "held"]);
}

#[test]
fn several_files_do_not_go_to_standard_output() {
    let scene = data("input/layer32.json");
    let inside = tempfile::tempdir().unwrap();
    let run = |arguments: &[&dyn AsRef<std::ffi::OsStr>]| {
        let mut command = Command::new(SQUALL);
        arguments.iter().for_each(|argument| _ = command.arg(argument));
        command.current_dir(inside.path()).output().unwrap()
    };
    refused(&run(&[&"solve", &scene, &"--lamp", &lamp(&scene), &"-o", &"-"]), 3, "standard output");
    refused(&run(&[&"chart", &golden(), &"-o", &"-"]), 3, "standard output");
    refused(&run(&[&"synth", &"cloud", &"-o", &"-"]), 3, "standard output");
    refused(&run(&[&"synth", &"streaks", &"-o", &"-"]), 3, "standard output");
    refused(&run(&[&"bake", &golden(), &"-o", &"-", &"--preview", &"/dev/stdout"]), 2, "standard output");
    assert_eq!(names(inside.path()), [""; 0]);
}

/// Name of a scene's first light.
fn lamp(scene: &Path) -> String {
    let scene: serde_json::Value = serde_json::from_slice(&std::fs::read(scene).unwrap()).unwrap();
    scene["lights"][0]["name"].as_str().unwrap().to_owned()
}

#[test]
fn quiet_says_nothing_and_any_number_of_threads_bakes_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let bake = |name: &str, threads: &str| {
        let out = folder.path().join(name);
        let done = squall(&[&"bake", &golden(), &"-o", &out, &"--quiet", &"--threads", &threads]);
        assert!(
            done.status.success() && done.stdout.is_empty() && done.stderr.is_empty(),
            "{}",
            words(&done)
        );
        std::fs::read(out).unwrap()
    };
    assert!(bake("one", "1") == bake("three", "3"));
    let none = squall(&[&"bake", &golden(), &"-o", &folder.path().join("none"), &"--threads", &"0"]);
    assert_eq!(none.status.code(), Some(2));
}

#[cfg(unix)]
#[test]
fn a_limit_on_the_size_of_files_is_an_error_that_leaves_no_part() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.squall");
    // Two blocks of 512 bytes, which no asset fits in.
    let limited = "ulimit -f 2; exec \"$0\" bake \"$1\" -o \"$2\" --quiet";
    let done = Command::new("sh").args(["-c", limited, SQUALL]).arg(golden()).arg(&out).output().unwrap();
    assert_eq!(done.status.code(), Some(4), "{}", words(&done));
    assert!(words(&done).contains("File too large"), "{}", words(&done));
    assert_eq!(names(folder.path()), [""; 0]);
}

/// What an interruption may take on a busy machine; it takes some .35 s on an idle one.
#[cfg(unix)]
const AT_ONCE: Duration = Duration::from_secs(2);

/// Sends `signal` to a command that works for minutes, after `after`, and waits for its end.
#[cfg(unix)]
#[track_caller]
fn interrupted(arguments: &[&str], folder: &Path, signal: &str, after: Duration) {
    let before = names(folder);
    let mut child = Command::new(SQUALL);
    let mut child = child.args(arguments).current_dir(folder).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(after);
    assert!(child.try_wait().unwrap().is_none(), "{arguments:?} was done before it was interrupted");
    let start = Instant::now();
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert!(start.elapsed() < AT_ONCE, "{arguments:?}: {:?}", start.elapsed());
    assert_eq!(output.status.code(), Some(130), "{arguments:?}: {}", words(&output));
    assert_eq!(words(&output), "squall: interrupted; nothing was written\n", "{arguments:?}");
    assert_eq!(names(folder), before, "{arguments:?}");
}

/// A recipe "storm.toml" whose bake takes minutes, and its cloud of so many cells.
#[cfg(unix)]
fn long_bake(folder: &Path, cells: &str) {
    let storm = folder.join("storm");
    assert!(squall(&[&"synth", &"cloud", &"-o", &storm, &"--cells", &cells]).status.success());
    let text = "[clouds]\nscene = \"storm.json\"\n[clouds.lightning]\nspacing_m = 4000.0\n[clouds.response]\nchannels = \
                \"harmonics-3\"\ncodec = \"bytes\"\ndirect = \"run-time\"\nerror = 0.1\ntest_strokes = 2\n";
    std::fs::write(folder.join("storm.toml"), text).unwrap();
}

#[cfg(unix)]
#[test]
fn an_interrupted_bake_says_where_what_it_solved_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    long_bake(folder.path(), "48x48x16");
    let bake = |command: &mut Command| {
        command.args(["bake", "storm.toml", "-o", "new.squall"]).current_dir(folder.path());
        command.stderr(Stdio::piped()).spawn().unwrap()
    };
    let mut child = bake(&mut Command::new(SQUALL));
    let kept = folder.path().join(".squall-cache");
    while !kept.read_dir().is_ok_and(|mut rows| rows.any(|row| row.is_ok())) {
        assert!(child.try_wait().unwrap().is_none(), "done before anything was kept");
        std::thread::sleep(Duration::from_millis(5));
    }
    // The first row is there whole, or about to be.
    std::thread::sleep(Duration::from_millis(100));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", words(&output));
    let wanted = "note: ./.squall-cache keeps what was solved, for the next bake\nsquall: interrupted; nothing was written\n";
    assert_eq!(words(&output), wanted);
    assert_eq!(names(folder.path()), [".squall-cache", "storm.f32", "storm.json", "storm.toml"]);
}

#[cfg(unix)]
#[test]
fn every_command_stops_at_once_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    long_bake(folder.path(), "96x96x32");
    assert!(squall(&[&"bake", &golden(), &"-o", &folder.path().join("a.squall")]).status.success());
    let light = lamp(&folder.path().join("storm.json"));
    let second = Duration::from_secs(1);
    // Whatever a fast machine has solved by then would be kept, which the next test is about.
    let bake = ["bake", "storm.toml", "-o", "new.squall", "--no-cache"];
    interrupted(&bake, folder.path(), "-INT", second);
    interrupted(&bake, folder.path(), "-TERM", 3 * second);
    let solve = ["solve", "storm.json", "--lamp", &light, "-o", "new/folder", "--refine", "2"];
    interrupted(&solve, folder.path(), "-HUP", second);
    let photons = [&solve[..6], &["--method", "monte-carlo", "--samples", "1000000000"]].concat();
    interrupted(&photons, folder.path(), "-INT", second);
    let render =
        ["render", "a.squall", "-o", "new.png", "--size", "8000", "6000", "--samples", "8", "--rate", "0"];
    interrupted(&render, folder.path(), "-TERM", second);
    interrupted(
        &["chart", "storm.toml", "-o", "charts", "--only", "transport"],
        folder.path(),
        "-INT",
        second,
    );
}

#[test]
fn parts_that_a_killed_bake_left_are_gone_after_the_next() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(".squall-killed.part"), b"half an asset").unwrap();
    assert!(squall(&[&"bake", &golden(), &"-o", &folder.path().join("a.squall")]).status.success());
    assert_eq!(names(folder.path()), ["a.squall"]);
}

#[test]
fn six_bakes_at_once_into_one_folder_all_come_through() {
    let folder = tempfile::tempdir().unwrap();
    let out = |bake: usize| folder.path().join(format!("{}.squall", bake / 2));
    let start = |bake| {
        let mut command = Command::new(SQUALL);
        command.arg("bake").arg(golden()).arg("-o").arg(out(bake)).arg("--quiet").spawn().unwrap()
    };
    let bakes: Vec<_> = (0..6).map(start).collect();
    assert!(bakes.into_iter().all(|mut bake| bake.wait().unwrap().success()));
    assert_eq!(names(folder.path()), ["0.squall", "1.squall", "2.squall"]);
    assert!(std::fs::read(out(0)).unwrap() == std::fs::read(out(5)).unwrap());
}

#[test]
fn work_that_takes_more_memory_than_there_is_is_refused_before_it_begins() {
    let folder = tempfile::tempdir().unwrap();
    let scene = data("input/layer32.json");
    let out = folder.path().join("solved");
    let solve = |memory: &str| {
        squall(&[&"solve", &scene, &"--lamp", &lamp(&scene), &"-o", &out, &"--quiet", &"--memory", &memory])
    };
    refused(&solve("20M"), 3, "would fit");
    assert!(words(&solve("20M")).contains("(--memory)"));
    assert_eq!(solve("much").status.code(), Some(2));
    assert_eq!(names(folder.path()), [""; 0]);
    // 2^28 cells, more than any machine of these days solves for: refused by the counts alone, the grid is not there.
    let text = "{\"dims_xyz\": [1024, 1024, 256], \"cell_m\": 1.0, \"origin_m\": [0, 0, 0], \"density_file\": \"none.f32\", \
                \"kappa_per_m\": 0.01, \"albedo\": 0.9, \"g\": 0.8}";
    std::fs::write(folder.path().join("huge.json"), text).unwrap();
    let recipe = folder.path().join("huge.toml");
    std::fs::write(&recipe, "[clouds]\nscene = \"huge.json\"\n").unwrap();
    refused(&squall(&[&"bake", &recipe, &"-o", &out, &"--memory", &"100G"]), 3, "268435456 cells");
}
