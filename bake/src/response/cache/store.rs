//! Blobs by key in a folder that several processes share: whole or not there, bounded in size, deleted without harm.

use crate::output::{pending, write_scratch};
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

/// Names a blob: a hash of everything that its content depends on.
pub type Key = [u8; 32];

/// First bytes of every file; another number stands for another layout.
const MAGIC: &[u8; 8] = b"SQUCACH1";
/// Bytes of magic, key and checksum.
const HEAD: usize = 8 + 32 + 32;
/// End of the names of entries.
const SUFFIX: &str = ".row";
/// This share of the bound may be written before the folder is looked through again.
const BETWEEN_TRIMS: u64 = 8;

/// A folder of blobs.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    most_bytes: u64,
    /// Bytes written since the folder was last looked through.
    fresh: AtomicU64,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    /// Files that this process wrote.
    written: Vec<PathBuf>,
    /// Why nothing more is written.
    trouble: Option<String>,
    /// Whether this process made the folder.
    made: bool,
}

impl Store {
    /// A store in `folder`, which is made when the first blob is written, of about `most_bytes` bytes.
    pub fn new(folder: &Path, most_bytes: u64) -> Self {
        Self { folder: folder.to_owned(), most_bytes, fresh: AtomicU64::new(0), state: Mutex::default() }
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Why nothing more is written, if that is so.
    pub fn trouble(&self) -> Option<String> {
        self.state().trouble.clone()
    }

    /// The blob of a key; nothing where there is none, or what is there is damaged, of another key or longer than `most`.
    pub fn get(&self, key: &Key, most: usize) -> Option<Vec<u8>> {
        let mut file = File::open(self.path(key)).ok()?;
        let length = file.metadata().ok().filter(|found| found.is_file())?.len();
        if length < HEAD as u64 || length > (HEAD + most) as u64 {
            return None;
        }
        let mut head = [0; HEAD];
        file.read_exact(&mut head).ok()?;
        let mut blob = Vec::with_capacity(length as usize - HEAD);
        file.by_ref().take(length).read_to_end(&mut blob).ok()?;
        if head[..8] != *MAGIC || head[8..40] != *key || head[40..] != *blake3::hash(&blob).as_bytes() {
            return None;
        }
        // What was used last goes last; where the time cannot be set, what was written last does.
        let _ = file.set_modified(SystemTime::now());
        Some(blob)
    }

    /// Keeps a blob. Trouble ends the writing, and is no error: what was kept can be made again.
    pub fn put(&self, key: &Key, blob: &[u8]) {
        if self.state().trouble.is_some() || (HEAD + blob.len()) as u64 > self.most_bytes / BETWEEN_TRIMS {
            return;
        }
        if let Err(error) = self.write(key, blob) {
            self.give_up(&error);
            return;
        }
        let length = (HEAD + blob.len()) as u64;
        let fresh = self.fresh.fetch_add(length, Ordering::Relaxed) + length;
        if fresh > self.most_bytes / BETWEEN_TRIMS {
            self.fresh.store(0, Ordering::Relaxed);
            self.trim();
        }
    }

    fn write(&self, key: &Key, blob: &[u8]) -> io::Result<()> {
        let head = [&MAGIC[..], key, blake3::hash(blob).as_bytes()].concat();
        let path = self.path(key);
        let attempt = || write_scratch(&path, &[&head, blob]);
        match attempt() {
            // Nothing here yet, or somebody deleted all of it meanwhile.
            Err(error) if error.kind() == ErrorKind::NotFound => {
                std::fs::create_dir_all(&self.folder)?;
                self.state().made = true;
                attempt()?;
            }
            done => done?,
        }
        self.state().written.push(path);
        pending::note_kept(&self.folder);
        Ok(())
    }

    /// Writes no more. Where the disk is full, what this process wrote goes: the asset needs the room more.
    fn give_up(&self, error: &io::Error) {
        let mut state = self.state();
        state.trouble.get_or_insert_with(|| error.to_string());
        if matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded) {
            for path in std::mem::take(&mut state.written) {
                let _ = std::fs::remove_file(path);
            }
            if state.made {
                let _ = std::fs::remove_dir(&self.folder);
            }
        }
    }

    /// Removes what was used least recently until the rest is within the bound. Other processes may do the same at the same time.
    pub fn trim(&self) {
        let Ok(folder) = self.folder.read_dir() else { return };
        let mut found: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
        for entry in folder.flatten() {
            let path = entry.path();
            let is_ours = path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(SUFFIX));
            let Ok(file) = entry.metadata() else { continue };
            if is_ours && file.is_file() {
                let used = file.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                found.push((used, file.len(), path));
            }
        }
        let mut bytes: u64 = found.iter().map(|(_, length, _)| length).sum();
        found.sort();
        for (_, length, path) in found {
            if bytes <= self.most_bytes {
                return;
            }
            let _ = std::fs::remove_file(path);
            bytes -= length;
        }
    }

    fn path(&self, key: &Key) -> PathBuf {
        let name: String = key.iter().map(|byte| format!("{byte:02x}")).collect();
        self.folder.join(name + SUFFIX)
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Large enough for any blob below.
    const ROOMY: u64 = 1 << 20;

    fn key(number: u8) -> Key {
        [number; 32]
    }

    #[test]
    fn a_blob_comes_back_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::new(&folder.path().join("a/b"), ROOMY);
        assert_eq!(store.get(&key(1), 100), None);
        store.put(&key(1), b"light");
        assert_eq!(store.get(&key(1), 100).as_deref(), Some(&b"light"[..]));
        assert_eq!(store.get(&key(1), 4), None, "longer than it may be");
        let file = store.path(&key(1));
        let bytes = std::fs::read(&file).unwrap();
        for at in 0..bytes.len() {
            let mut spoilt = bytes.clone();
            spoilt[at] ^= 1;
            std::fs::write(&file, &spoilt).unwrap();
            assert_eq!(store.get(&key(1), 100), None, "byte {at}");
        }
        for length in 0..bytes.len() {
            std::fs::write(&file, &bytes[..length]).unwrap();
            assert_eq!(store.get(&key(1), 100), None, "{length} bytes");
        }
        // Under another key's name it is not that one's.
        std::fs::write(store.path(&key(2)), &bytes).unwrap();
        assert_eq!(store.get(&key(2), 100), None);
        store.put(&key(1), b"light");
        assert_eq!(store.get(&key(1), 100).as_deref(), Some(&b"light"[..]));
    }

    #[test]
    fn a_folder_that_is_deleted_meanwhile_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::new(&folder.path().join("cache"), ROOMY);
        store.put(&key(1), b"light");
        std::fs::remove_dir_all(store.folder()).unwrap();
        assert_eq!(store.get(&key(1), 100), None);
        store.put(&key(2), b"dark");
        assert_eq!((store.get(&key(2), 100).as_deref(), store.trouble()), (Some(&b"dark"[..]), None));
    }

    #[test]
    fn the_bound_is_kept_and_what_was_used_last_stays() {
        let folder = tempfile::tempdir().unwrap();
        let blob = vec![7; 1000];
        let store = Store::new(folder.path(), 10 * (1000 + HEAD as u64));
        let second = |seconds| SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(seconds);
        for number in 0..10 {
            store.put(&key(number), &blob);
            let file = File::options().write(true).open(store.path(&key(number))).unwrap();
            file.set_modified(second(u64::from(number))).unwrap();
        }
        // The oldest is used once more, and two come in.
        assert!(store.get(&key(0), 2000).is_some());
        std::fs::write(folder.path().join("notes.txt"), b"not ours").unwrap();
        store.put(&key(10), &blob);
        store.put(&key(11), &blob);
        store.trim();
        let kept: Vec<u8> = (0..12).filter(|&number| store.path(&key(number)).exists()).collect();
        assert_eq!(kept, [0, 3, 4, 5, 6, 7, 8, 9, 10, 11]);
        assert!(folder.path().join("notes.txt").exists());
    }

    #[test]
    fn a_place_that_cannot_be_written_to_is_trouble_and_no_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, b"in the way").unwrap();
        let store = Store::new(&file, ROOMY);
        store.put(&key(1), b"light");
        assert!(store.trouble().is_some());
        assert_eq!(store.get(&key(1), 100), None);
        assert_eq!(std::fs::read(&file).unwrap(), b"in the way");
    }
}
