//! A disk that is full, a folder that may not be written to, an output that is no file.

use assert_cmd::Command;
use std::path::{Path, PathBuf};

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/golden.toml")
}

/// Exit code and messages of baking the golden recipe into `out`.
fn bake(out: &Path) -> (i32, String) {
    // Bytes that find no place where they should go are kept among temporary files.
    let kept = tempfile::tempdir().unwrap();
    let mut command = Command::cargo_bin("squall").unwrap();
    let output =
        command.env("TMPDIR", kept.path()).arg("bake").arg(golden()).arg("-o").arg(out).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

fn files(folder: &Path) -> Vec<String> {
    let name = |entry: std::io::Result<std::fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
    let mut names: Vec<String> = folder.read_dir().unwrap().map(name).collect();
    names.sort();
    names
}

/// A message that names the output once, says why, and knows nothing of temporary files.
#[track_caller]
fn one_clear_error(message: &str, out: &Path) {
    let name = out.display().to_string();
    assert_eq!(message.matches(&name).count(), 1, "{message}");
    assert!(!message.contains(".part") && message.lines().count() == 1, "{message}");
}

/// A file system of 32 KiB in memory, taken away again when dropped; `None` where this process may not mount.
#[cfg(target_os = "linux")]
struct SmallDisk(tempfile::TempDir);

#[cfg(target_os = "linux")]
impl SmallDisk {
    fn mount() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let mount = std::process::Command::new("mount")
            .args(["-t", "tmpfs", "-o", "size=32k", "squall-test"])
            .arg(folder.path())
            .output();
        mount.is_ok_and(|output| output.status.success()).then_some(Self(folder))
    }
}

#[cfg(target_os = "linux")]
impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = std::process::Command::new("umount").arg(self.0.path()).output();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_bake_with_code_4_and_leaves_nothing_behind() {
    let Some(disk) = SmallDisk::mount() else {
        assert!(std::env::var_os("SQUALL_REQUIRE_MOUNT").is_none(), "mounting a tmpfs is required");
        println!("skipped: no right to mount a small disk");
        return;
    };
    let out = disk.0.path().join("storm.squall");
    let (code, message) = bake(&out);
    assert_eq!(code, 4, "{message}");
    assert!(message.contains("No space left on device"), "{message}");
    one_clear_error(&message, &out);
    assert_eq!(files(disk.0.path()), [""; 0]);
    // What stood there before is still there.
    std::fs::write(&out, b"old").unwrap();
    assert_eq!(bake(&out).0, 4);
    assert_eq!(files(disk.0.path()), ["storm.squall"]);
    assert_eq!(std::fs::read(&out).unwrap(), b"old");
}

#[cfg(target_os = "linux")]
#[test]
fn a_device_is_written_to_and_left_in_its_place() {
    use std::os::unix::fs::FileTypeExt;
    let is_device = |path: &str| std::fs::metadata(path).unwrap().file_type().is_char_device();
    let full = Path::new("/dev/full");
    if full.exists() {
        let (code, message) = bake(full);
        assert_eq!(code, 4, "{message}");
        one_clear_error(&message, full);
        assert!(is_device("/dev/full"));
    }
    assert_eq!(bake(Path::new("/dev/null")).0, 0);
    assert!(is_device("/dev/null"));
}

#[test]
fn a_folder_that_is_missing_or_in_the_way_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("none/storm.squall");
    let (code, message) = bake(&missing);
    assert_eq!(code, 3, "{message}");
    one_clear_error(&message, &missing);
    let (code, message) = bake(folder.path());
    assert_eq!(code, 3, "{message}");
    assert!(message.contains("a folder"), "{message}");
    assert_eq!(files(folder.path()), [""; 0]);
}

#[cfg(unix)]
#[test]
fn a_link_is_followed_and_the_mode_is_that_of_an_ordinary_file() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (file, link) = (folder.path().join("file.squall"), folder.path().join("link.squall"));
    std::fs::write(&file, b"old").unwrap();
    std::os::unix::fs::symlink(&file, &link).unwrap();
    let ordinary = std::fs::metadata(&file).unwrap().permissions().mode();
    assert_eq!(bake(&link).0, 0);
    assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
    assert!(std::fs::read(&file).unwrap().starts_with(b"\x89SQUALL\n"));
    assert_eq!(std::fs::metadata(&file).unwrap().permissions().mode(), ordinary);
    assert_eq!(files(folder.path()), ["file.squall", "link.squall"]);
}
