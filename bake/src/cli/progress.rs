//! How far a command is, on standard error: a bar a stage with the time left on a terminal, a line every half minute elsewhere.

use super::interrupt;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use squall_bake::progress::Progress;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time between two lines where standard error is no terminal.
const BETWEEN_LINES: Duration = Duration::from_secs(30);

/// The bar on the terminal, which an interruption takes away.
static BAR: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// Takes the bar away, unless another thread is drawing at this moment.
pub fn clear() {
    if let Ok(mut bar) = BAR.try_lock()
        && let Some(bar) = bar.take()
    {
        bar.finish_and_clear();
    }
}

/// Progress of one command, and its closing words.
pub struct Bars {
    quiet: bool,
    lines: Option<Lines>,
}

impl Bars {
    /// Reports to standard error, or not at all.
    pub fn new(quiet: bool) -> Self {
        let to_lines = !quiet && !std::io::stderr().is_terminal();
        Self { quiet, lines: to_lines.then(|| Lines::start(BETWEEN_LINES, to_stderr)) }
    }

    /// Takes the last bar away.
    pub fn finish(&self) {
        clear();
    }

    /// Words that are worth knowing whether or not anybody wants to hear of progress, on standard error.
    pub fn warn(&self, words: &str) {
        self.finish();
        to_stderr(&format!("warning: {words}"));
    }

    /// Words for whoever waits, on standard error: standard output is for data alone.
    pub fn say(&self, words: &str) {
        self.finish();
        if !self.quiet {
            to_stderr(words);
        }
    }
}

/// A reader of words that has gone is no error.
fn to_stderr(words: &str) {
    let _ = std::io::stderr().write_all(format!("{}\n", words.trim_end()).as_bytes());
}

impl Progress for Bars {
    fn begin(&self, stage: &str, total: u64) {
        if let Some(lines) = &self.lines {
            lines.stage.begin(stage, total);
        }
        if self.quiet || self.lines.is_some() {
            return;
        }
        let template = "{prefix:>16} {wide_bar} {pos}/{len} {elapsed} gone, {eta} left";
        let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr()).with_style(style);
        bar.set_prefix(stage.to_owned());
        bar.tick();
        let before = BAR.lock().unwrap_or_else(PoisonError::into_inner).replace(bar);
        if let Some(before) = before {
            before.finish_and_clear();
        }
    }

    fn advance(&self, steps: u64) {
        match &self.lines {
            Some(lines) => _ = lines.stage.done.fetch_add(steps, Ordering::Relaxed),
            None => {
                if let Some(bar) = &*BAR.lock().unwrap_or_else(PoisonError::into_inner) {
                    bar.inc(steps);
                }
            }
        }
    }

    fn interrupted(&self) -> bool {
        interrupt::asked()
    }
}

/// The present stage: its name, steps and start.
struct Stage {
    named: Mutex<(String, u64, Instant)>,
    done: AtomicU64,
}

impl Stage {
    fn begin(&self, stage: &str, total: u64) {
        *self.named.lock().unwrap_or_else(PoisonError::into_inner) =
            (stage.to_owned(), total, Instant::now());
        self.done.store(0, Ordering::Relaxed);
    }

    /// One line, such as `cloud response: 12 of 100, 61 s`; none before the first stage.
    fn line(&self) -> Option<String> {
        let (name, total, start) = &*self.named.lock().unwrap_or_else(PoisonError::into_inner);
        let done = self.done.load(Ordering::Relaxed);
        (!name.is_empty()).then(|| format!("{name}: {done} of {total}, {} s", start.elapsed().as_secs()))
    }
}

/// A thread that says from time to time where the work is.
struct Lines {
    stage: Arc<Stage>,
    /// Dropped, it ends the thread.
    _alive: Sender<()>,
}

impl Lines {
    fn start(between: Duration, say: impl Fn(&str) + Send + 'static) -> Self {
        let named = Mutex::new((String::new(), 0, Instant::now()));
        let stage = Arc::new(Stage { named, done: AtomicU64::new(0) });
        let (alive, ended) = channel::<()>();
        let of = stage.clone();
        std::thread::spawn(move || {
            while ended.recv_timeout(between) == Err(RecvTimeoutError::Timeout) {
                if let Some(line) = of.line() {
                    say(&line);
                }
            }
        });
        Self { stage, _alive: alive }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_terminal_a_line_says_from_time_to_time_where_the_work_is() {
        let (sender, lines) = channel();
        let work = Lines::start(Duration::from_millis(5), move |line: &str| {
            let _ = sender.send(line.to_owned());
        });
        work.stage.begin("cloud response", 100);
        work.stage.done.fetch_add(12, Ordering::Relaxed);
        // The first line may have been made before the steps were.
        let line = lines.iter().find(|line| line.contains("12 of"));
        assert_eq!(line.as_deref(), Some("cloud response: 12 of 100, 0 s"));
        drop(work);
        // The thread ends, and with it the channel.
        assert_eq!(lines.iter().find(|line| line.contains("13 of")), None);
    }
}
