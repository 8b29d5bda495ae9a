use super::*;

fn names(folder: &Path) -> Vec<String> {
    let name = |entry: io::Result<std::fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
    let mut names: Vec<String> = folder.read_dir().unwrap().map(name).collect();
    names.sort();
    names
}

#[test]
fn a_failed_write_leaves_the_old_file_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("asset");
    write_atomically(&path, |out| out.write_all(b"old")).unwrap();
    let failed = write_atomically(&path, |out| {
        out.write_all(b"half")?;
        Err(io::Error::other("disk full"))
    });
    assert_eq!(failed.unwrap_err().exit_code(), 4);
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    assert_eq!(names(folder.path()), ["asset"]);
}

#[test]
fn a_refusal_names_the_file_asked_for_once_and_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("none/asset");
    let message = write_atomically(&path, |_| Ok(())).unwrap_err().to_string();
    assert_eq!(message.matches(&path.display().to_string()).count(), 1, "{message}");
    assert!(!message.contains(".part"), "{message}");
}

#[test]
fn a_rename_that_fails_after_the_work_keeps_the_bytes_and_says_where() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("asset");
    let output = Output::prepare(&path).unwrap();
    // While the work goes on, a folder takes the name.
    std::fs::create_dir(&path).unwrap();
    let error = output.write(|out| out.write_all(b"hours of work")).unwrap_err();
    let kept = folder.path().join("asset.kept-1");
    assert_eq!(error.exit_code(), 4, "{error}");
    assert!(error.to_string().ends_with(&format!("are kept in {}", kept.display())), "{error}");
    assert_eq!(std::fs::read(&kept).unwrap(), b"hours of work");
    assert_eq!(names(folder.path()), ["asset", "asset.kept-1"]);
}

#[test]
fn a_folder_that_is_gone_after_the_work_sends_the_bytes_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    std::fs::create_dir(&inner).unwrap();
    let output = Output::prepare(&inner.join("a.squall")).unwrap();
    std::fs::remove_dir(&inner).unwrap();
    let error = output.write(|out| out.write_all(b"hours of work")).unwrap_err();
    let words = error.to_string();
    assert_eq!(error.exit_code(), 4, "{words}");
    let kept = PathBuf::from(words.rsplit_once("are kept in ").unwrap().1);
    assert_eq!(std::fs::read(&kept).unwrap(), b"hours of work");
    assert_eq!(kept.extension().unwrap(), "squall");
    std::fs::remove_file(kept).unwrap();
}

#[test]
fn parts_of_the_dead_are_swept_and_those_of_the_living_stay() {
    let folder = tempfile::tempdir().unwrap();
    let [dead, alive] = ["dead", "live"].map(|name| folder.path().join(format!(".squall-{name}.part")));
    std::fs::write(&dead, b"half").unwrap();
    let held = File::create(&alive).unwrap();
    held.lock().unwrap();
    Output::prepare(&folder.path().join("asset")).unwrap();
    assert_eq!(names(folder.path()), [".squall-live.part"]);
    drop(held);
    Output::prepare(&folder.path().join("asset")).unwrap();
    assert_eq!(names(folder.path()), [""; 0]);
}

#[test]
fn many_writers_and_sweepers_of_one_file_never_lose_a_part() {
    const WRITERS: usize = 6;
    const TIMES: usize = 50;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("asset");
    std::thread::scope(|scope| {
        for _ in 0..WRITERS {
            scope.spawn(|| {
                for _ in 0..TIMES {
                    let output = Output::prepare(&path).unwrap();
                    output.write(|out| out.write_all(b"whole")).unwrap();
                }
            });
        }
    });
    assert_eq!(std::fs::read(&path).unwrap(), b"whole");
    assert_eq!(names(folder.path()), ["asset"]);
}

#[cfg(unix)]
#[test]
fn a_dangling_link_is_followed_and_a_circle_is_refused() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    symlink("second", at("first")).unwrap();
    symlink("file", at("second")).unwrap();
    write_atomically(&at("first"), |out| out.write_all(b"new")).unwrap();
    assert_eq!(std::fs::read(at("file")).unwrap(), b"new");
    assert!(at("first").symlink_metadata().unwrap().is_symlink());
    symlink("round", at("about")).unwrap();
    symlink("about", at("round")).unwrap();
    let error = Output::prepare(&at("round")).unwrap_err();
    assert_eq!(error.exit_code(), 3, "{error}");
    assert!(error.to_string().contains("leads in a circle"), "{error}");
    assert!(at("round").symlink_metadata().unwrap().is_symlink());
}

#[cfg(unix)]
#[test]
fn what_takes_a_files_place_takes_its_mode() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("asset");
    for mode in [0o640, 0o600, 0o664] {
        std::fs::write(&path, b"old").unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
        write_atomically(&path, |out| out.write_all(b"new")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(path.metadata().unwrap().permissions().mode() & 0o7777, mode);
    }
}

#[test]
fn a_name_like_a_folders_is_refused_and_dash_is_standard_output() {
    let error = Output::prepare(Path::new("new/")).unwrap_err();
    assert_eq!(error.exit_code(), 3, "{error}");
    assert_eq!(Place::of(Path::new("-")).unwrap(), Place::Stdout);
    assert_eq!(Place::of_name(Path::new("-")).unwrap(), Place::File("-".into()));
    #[cfg(unix)]
    for name in ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"] {
        assert_eq!(Place::of(Path::new(name)).unwrap(), Place::Stdout);
    }
}
