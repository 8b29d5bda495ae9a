//! The script as a child process, and the files that go between.

use super::Peer;
use crate::error::BakeError;
use crate::input::read_json;
use crate::progress::Progress;
use crate::response::SolvedRows;
use serde::{Deserialize, Serialize};
use squall_formats::haar::Haar;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;
use tempfile::TempDir;

/// Runs scripts. A virtual environment that is active puts its own first in the path.
const PYTHON: &str = "python3";
/// Between two looks at a script that runs.
const WAIT: Duration = Duration::from_millis(5);
/// Most of what a script says that is read, bytes.
const MOST_WORDS: u64 = 64 << 10;

/// What a script answers to `list`.
#[derive(Deserialize)]
struct Listed {
    peers: Vec<Peer>,
    absent: Vec<String>,
}

/// Rows as a script is handed them.
#[derive(Serialize)]
struct Task {
    shape: [usize; 4],
    rows: usize,
    relative_l2: f64,
    repeats: usize,
}

/// What coding rows took.
#[derive(Debug, Deserialize)]
pub struct Coded {
    /// Bytes of each row.
    pub bytes: Vec<u64>,
    /// Processor seconds that decoding each row took, a list a repeat; none where they were not taken.
    #[serde(default)]
    pub seconds: Vec<Vec<f64>>,
}

fn folder() -> Result<TempDir, BakeError> {
    let within = std::env::temp_dir();
    tempfile::Builder::new()
        .prefix("squall-peers-")
        .tempdir_in(&within)
        .map_err(BakeError::io(&within, "make a temporary folder in"))
}

/// The codecs that `script` has, and in words those that it lacks.
pub fn list(script: &Path, progress: &dyn Progress) -> Result<(Vec<Peer>, Vec<String>), BakeError> {
    if !script.is_file() {
        return Err(BakeError::input(script, "--peers", "a Python script", "no such file"));
    }
    let folder = folder()?;
    let said = run(script, &["list"], &folder, progress)?;
    let listed: Listed = serde_json::from_str(&said).map_err(|error| {
        let wanted = "{\"peers\": [{\"id\": …, \"name\": …}, …], \"absent\": [words, …]}";
        BakeError::input(script, "list", wanted, error)
    })?;
    Ok((listed.peers, listed.absent))
}

/// Runs `script` to its end, or kills it once somebody wants to stop. Returns what it wrote to standard output.
fn run(
    script: &Path,
    arguments: &[&str],
    folder: &TempDir,
    progress: &dyn Progress,
) -> Result<String, BakeError> {
    // Files and not pipes: a script that says much does not wait for a reader.
    let [out, words] = ["stdout", "stderr"].map(|name| folder.path().join(name));
    let file = |path: &PathBuf| File::create(path).map_err(BakeError::io(path, "write"));
    // An absolute path is never taken for an option.
    let absolute = script.canonicalize().map_err(BakeError::io(script, "read"))?;
    let mut child = Command::new(PYTHON)
        .arg(absolute)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(file(&out)?)
        .stderr(file(&words)?)
        .spawn()
        .map_err(BakeError::io(Path::new(PYTHON), "start"))?;
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) if progress.interrupted() => {
                let _ = child.kill();
                let _ = child.wait();
                return Err(BakeError::Interrupted);
            }
            Ok(None) => std::thread::sleep(WAIT),
            Err(error) => return Err(BakeError::io(script, "wait for")(error)),
        }
    };
    // Ctrl-C reaches the script too, and that is not the script's failure.
    progress.check()?;
    let (out, words) = (text(&out)?, text(&words)?);
    if !status.success() {
        let last = words.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("no word why");
        let found = format!("{status}: {}", last.trim());
        return Err(BakeError::input(script, arguments.join(" "), "exit status 0", found));
    }
    Ok(out)
}

/// The end of a text file, at most [`MOST_WORDS`] of it.
fn text(path: &Path) -> Result<String, BakeError> {
    use std::io::{Seek, SeekFrom};
    let read = || -> std::io::Result<Vec<u8>> {
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(MOST_WORDS)))?;
        let mut bytes = Vec::new();
        file.take(MOST_WORDS).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    let bytes = read().map_err(BakeError::io(path, "read"))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Rows in a folder that a script may read; gone with this value.
pub struct Exchange<'a> {
    script: &'a Path,
    folder: TempDir,
    shape: [usize; 4],
    rows: usize,
}

impl<'a> Exchange<'a> {
    /// Writes the rows of `solved` down as light in cells.
    ///
    /// Errors: a folder for temporary files that takes none, no space.
    pub fn new(script: &'a Path, solved: &SolvedRows) -> Result<Self, BakeError> {
        let [nx, ny, nz] = solved.head.shape.to_array();
        let shape = [solved.head.basis.count(), nz, ny, nx];
        let exchange = Self { script, folder: folder()?, shape, rows: solved.planes.len() };
        let haar = Haar::new(solved.head.shape);
        let path = exchange.path("rows.f32");
        let write = || -> std::io::Result<()> {
            let mut out = BufWriter::with_capacity(1 << 20, File::create(&path)?);
            let (mut cells, mut scratch) = (Vec::new(), Vec::new());
            for row in &solved.planes {
                cells.clear();
                cells.extend_from_slice(row);
                cells.chunks_exact_mut(haar.len()).for_each(|plane| haar.inverse(plane, &mut scratch));
                for value in &cells {
                    out.write_all(&value.to_le_bytes())?;
                }
            }
            out.flush()
        };
        write().map_err(BakeError::io(&path, "write"))?;
        Ok(exchange)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Has `peer` code every row so that it is off by at most `relative_l2` of its norm.
    ///
    /// Errors: a script that fails, or reports on other rows than it was handed; an interruption.
    pub fn code(
        &self,
        peer: &Peer,
        relative_l2: f64,
        repeats: usize,
        progress: &dyn Progress,
    ) -> Result<Coded, BakeError> {
        // What an earlier call left is not taken for this one's.
        for name in ["back.f32", "coded.json"] {
            let path = self.path(name);
            if path.exists() {
                std::fs::remove_file(&path).map_err(BakeError::io(&path, "remove"))?;
            }
        }
        let task = Task { shape: self.shape, rows: self.rows, relative_l2, repeats };
        let path = self.path("task.json");
        let text =
            serde_json::to_string(&task).map_err(|error| BakeError::io(&path, "write")(error.into()))?;
        std::fs::write(&path, text).map_err(BakeError::io(&path, "write"))?;
        let folder = self.folder.path().to_str().ok_or_else(|| {
            BakeError::input(self.folder.path(), "temporary folder", "a name in UTF-8", "another")
        })?;
        run(self.script, &["code", &peer.id, folder], &self.folder, progress)?;

        let refuse = |what: &str, wanted: String, found: String| {
            let field = format!("coded.json of {}: {what}", peer.id);
            Err(BakeError::input(self.script, field, wanted, found))
        };
        let path = self.path("coded.json");
        if !path.is_file() {
            return refuse("file", "bytes and seconds of every row".into(), "no file".into());
        }
        let coded: Coded = read_json(&path, "bytes and seconds of every row (coded.json)")?;
        if coded.bytes.len() != self.rows {
            return refuse("bytes", format!("{} rows", self.rows), coded.bytes.len().to_string());
        }
        for times in &coded.seconds {
            if times.len() != self.rows {
                return refuse(
                    "seconds",
                    format!("{} rows in each list", self.rows),
                    times.len().to_string(),
                );
            }
            if let Some(time) = times.iter().find(|time| !(time.is_finite() && **time >= 0.0)) {
                return refuse("seconds", "finite times from 0".into(), time.to_string());
            }
        }
        Ok(coded)
    }

    /// Hands what `peer` made of each row to `take`, in order.
    ///
    /// Errors: a file of another length, a value that is no finite number.
    pub fn read_back(&self, peer: &Peer, mut take: impl FnMut(usize, &[f32])) -> Result<(), BakeError> {
        let path = self.path("back.f32");
        let field = format!("back.f32 of {}", peer.id);
        let length: usize = self.shape.iter().product();
        let wanted = (self.rows * length * size_of::<f32>()) as u64;
        let words = || format!("{wanted} bytes ({} rows of {length} f32)", self.rows);
        let Ok(meta) = std::fs::metadata(&path) else {
            return Err(BakeError::input(self.script, field, words(), "no file"));
        };
        if meta.len() != wanted {
            return Err(BakeError::input(self.script, field, words(), format!("{} bytes", meta.len())));
        }
        let mut file = BufReader::new(File::open(&path).map_err(BakeError::io(&path, "read"))?);
        let mut bytes = vec![0u8; length * size_of::<f32>()];
        let mut values = vec![0.0f32; length];
        for row in 0..self.rows {
            file.read_exact(&mut bytes).map_err(BakeError::io(&path, "read"))?;
            for (at, (value, bytes)) in values.iter_mut().zip(bytes.chunks_exact(4)).enumerate() {
                *value = f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
                if !value.is_finite() {
                    let place = format!("{field}, row {row}, value {at}");
                    return Err(BakeError::input(self.script, place, "a finite number", *value));
                }
            }
            take(row, &values);
        }
        Ok(())
    }
}
