//! Options that every command which works has.

use super::progress::Bars;
use squall_bake::BakeError;
use squall_bake::memory::{Limit, parse_size};
use std::path::Path;

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

fn size(text: &str) -> Result<u64, String> {
    parse_size(text).ok_or_else(|| "wanted a size such as 8G, 512M or a number of bytes".into())
}
