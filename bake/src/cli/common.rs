//! Options that every command which works has.

use super::progress::Bars;
use squall_bake::BakeError;
use squall_bake::memory::{Limit, parse_size};
use squall_bake::output::{Place, folder_of};
use squall_bake::response::cache::ResponseCache;
use std::path::{Path, PathBuf};

/// Most threads that may be asked for: more than any machine has cores, fewer than systems refuse.
const MOST_THREADS: i64 = 1024;

/// `--quiet` and `--threads`.
#[derive(clap::Args)]
pub struct Common {
    /// Say nothing but warnings and errors.
    #[arg(short, long)]
    quiet: bool,
    /// Threads to work with; as many as the machine has cores if left out. Results do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=MOST_THREADS))]
    threads: Option<u16>,
}

impl Common {
    /// Whether nothing but warnings and errors is said.
    pub fn is_quiet(&self) -> bool {
        self.quiet
    }

    /// Sets the number of threads, and begins to report progress.
    ///
    /// Errors (exit code 4): the system refuses the threads.
    pub fn start(&self) -> anyhow::Result<Bars> {
        if let Some(threads) = self.threads {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
            let refused =
                |error| BakeError::io(Path::new("--threads"), "start")(std::io::Error::other(error));
            pool.map_err(refused)?;
        }
        Ok(Bars::new(self.quiet))
    }
}

/// `--memory`
#[derive(clap::Args)]
pub struct Memory {
    /// Most memory that the work may take, such as 8G; what is free on the machine if left out. Work that would take more is refused
    /// before it begins.
    #[arg(long, value_name = "SIZE", value_parser = size)]
    memory: Option<u64>,
}

impl Memory {
    /// The smaller of what was asked for and what there is.
    pub fn limit(&self) -> Limit {
        Limit::new(self.memory)
    }
}

/// `--cache`, `--no-cache` and `--cache-size`
#[derive(clap::Args)]
pub struct CacheArgs {
    /// Keeps solved light in DIR, and takes from there what an earlier bake solved. If left out, bakes that take long keep it in
    /// .squall-cache beside the asset.
    #[arg(long, value_name = "DIR", conflicts_with = "no_cache")]
    cache: Option<PathBuf>,
    /// Solves everything anew, and keeps nothing.
    #[arg(long)]
    no_cache: bool,
    /// Most that the folder may take, such as 512M; what was used least recently goes first.
    #[arg(long, value_name = "SIZE", value_parser = size, default_value = "2G", conflicts_with = "no_cache")]
    cache_size: u64,
}

/// Processor time of a cloud's response from which a bake keeps what it solved without being asked, s.
const WORTH_KEEPING: f64 = 2.0;

impl CacheArgs {
    /// The cache of a bake of `cpu_seconds` or so whose asset goes to `out`, if it is to have one.
    pub fn open(
        &self,
        out: &Path,
        cpu_seconds: impl FnOnce() -> Result<f64, BakeError>,
    ) -> Result<Option<ResponseCache>, BakeError> {
        if self.no_cache {
            return Ok(None);
        }
        let folder = match (&self.cache, Place::of(out)?) {
            (Some(folder), _) => folder.clone(),
            (None, Place::File(asset)) if cpu_seconds()? >= WORTH_KEEPING => {
                folder_of(&asset).join(".squall-cache")
            }
            (None, _) => return Ok(None),
        };
        Ok(Some(ResponseCache::new(&folder, self.cache_size)))
    }
}

fn size(text: &str) -> Result<u64, String> {
    parse_size(text).ok_or_else(|| "wanted a size such as 8G, 512M or a number of bytes".into())
}
