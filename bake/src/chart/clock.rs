//! What work costs: processor time of the one thread that does it.

use super::Cost;

/// Seconds that this thread has worked. Where the system does not count them, seconds of the day.
pub fn worked() -> f64 {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
    }
    #[cfg(not(unix))]
    {
        use std::sync::OnceLock;
        use std::time::Instant;
        static START: OnceLock<Instant> = OnceLock::new();
        START.get_or_init(Instant::now).elapsed().as_secs_f64()
    }
}

/// Runs `work` `repeats` times on one thread, all of its parallel parts included, and returns its last result and seconds.
pub fn seconds<T: Send>(repeats: usize, mut work: impl FnMut() -> T + Send) -> (T, Cost) {
    let mut run = || {
        let mut times = Vec::with_capacity(repeats);
        let mut timed = |work: &mut dyn FnMut() -> T| {
            let start = worked();
            let result = work();
            times.push(worked() - start);
            result
        };
        let mut result = timed(&mut work);
        for _ in 1..repeats {
            result = timed(&mut work);
        }
        (result, Cost::of(times))
    };
    match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
        Ok(pool) => pool.install(run),
        // A machine that grants no further thread: the work then shares what there is.
        Err(_) => run(),
    }
}

impl Cost {
    /// What repeats of the same work took; at least one is wanted.
    pub(super) fn of(mut times: Vec<f64>) -> Self {
        times.sort_unstable_by(f64::total_cmp);
        let pick = |share: f64| times[((times.len() - 1) as f64 * share).round() as usize];
        Self { median: pick(0.5), p10: pick(0.1), p90: pick(0.9) }
    }

    /// The same cost in another unit.
    pub fn times(self, factor: f64) -> Self {
        Self { median: self.median * factor, p10: self.p10 * factor, p90: self.p90 * factor }
    }
}
