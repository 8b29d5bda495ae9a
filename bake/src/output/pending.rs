//! What has to go again if the process ends now: temporary files, results that are not whole, folders made for them.
//!
//! Files are made, renamed and forgotten under one lock. [`discard`] takes the lock for good, so that nothing new appears behind it.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

#[derive(Default)]
struct Pending {
    files: Vec<PathBuf>,
    folders: Vec<PathBuf>,
    note: Option<String>,
}

static PENDING: Mutex<Pending> = Mutex::new(Pending { files: Vec::new(), folders: Vec::new(), note: None });

/// A thread that makes or renames a file holds the lock for so long at most, unless the disk hangs.
const PATIENCE: Duration = Duration::from_millis(200);

fn lock() -> MutexGuard<'static, Pending> {
    PENDING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file that is removed if the process is interrupted while this value lives.
pub(crate) struct PendingFile(PathBuf);

impl PendingFile {
    /// Makes a file and takes note of it in one step. Errors: those of `make`.
    pub(crate) fn make<T>(
        make: impl FnOnce() -> std::io::Result<T>,
        path: impl FnOnce(&T) -> &Path,
    ) -> std::io::Result<(T, Self)> {
        let mut pending = lock();
        let made = make()?;
        let path = path(&made).to_owned();
        pending.files.push(path.clone());
        Ok((made, Self(path)))
    }

    /// Ends the wait with `done`, a rename: either it has happened when an interruption comes, or it never will.
    pub(crate) fn end<T>(&self, done: impl FnOnce() -> T) -> T {
        let mut pending = lock();
        let result = done();
        pending.files.retain(|path| *path != self.0);
        result
    }
}

impl Drop for PendingFile {
    fn drop(&mut self) {
        lock().files.retain(|path| *path != self.0);
    }
}

/// Results in a folder, and folders made for them, that go again if the process is interrupted before [`forget_folder`].
pub fn expect_folder(folders: &[PathBuf], results: &[PathBuf]) {
    let mut pending = lock();
    pending.folders.extend_from_slice(folders);
    pending.files.extend_from_slice(results);
}

/// What [`expect_folder`] announced stays, or is gone.
pub fn forget_folder(folders: &[PathBuf], results: &[PathBuf]) {
    let mut pending = lock();
    pending.folders.retain(|path| !folders.contains(path));
    pending.files.retain(|path| !results.contains(path));
}

/// Whether results that are whole stay although the work is not at its end: frames of a sequence.
static WRITTEN: AtomicBool = AtomicBool::new(false);

/// Takes note that a result is whole and stays, whatever comes.
pub fn note_written() {
    WRITTEN.store(true, Ordering::Relaxed);
}

/// Whether [`note_written`] was called.
pub fn has_written() -> bool {
    WRITTEN.load(Ordering::Relaxed)
}

/// A sentence that whoever interrupts should read: what is left on purpose.
pub fn set_note(note: Option<String>) {
    lock().note = note;
}

/// Takes note of a folder that keeps what was solved, unless another sentence is there already.
pub fn note_kept(folder: &Path) {
    let words = || format!("{} keeps what was solved, for the next bake", folder.display());
    lock().note.get_or_insert_with(words);
}

/// The sentence of [`set_note`].
pub fn note() -> Option<String> {
    lock().note.clone()
}

/// Removes everything that is pending, and keeps this process from making or renaming more: for the moment before its end. Whoever
/// takes note of anything afterwards, or asks for the sentence of [`set_note`], waits for ever; it is returned here.
pub fn discard() -> Option<String> {
    let start = Instant::now();
    let pending = loop {
        match PENDING.try_lock() {
            Ok(pending) => break pending,
            Err(std::sync::TryLockError::Poisoned(poisoned)) => break poisoned.into_inner(),
            Err(std::sync::TryLockError::WouldBlock) if start.elapsed() < PATIENCE => {
                std::thread::sleep(Duration::from_millis(1));
            }
            Err(std::sync::TryLockError::WouldBlock) => return None,
        }
    };
    for file in &pending.files {
        let _ = std::fs::remove_file(file);
    }
    for folder in pending.folders.iter().rev() {
        let _ = std::fs::remove_dir(folder);
    }
    let note = pending.note.clone();
    std::mem::forget(pending);
    note
}
