//! Options that every command which works has.

use super::progress::Bars;
use squall_bake::BakeError;
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
