//! Progress on a terminal: a bar a stage with the time left; silent when stderr is not a terminal. Ctrl-C asks the work to stop.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use squall_bake::progress::Progress;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// Bars for the stages of one command.
pub struct Bars {
    bar: Mutex<ProgressBar>,
    stop: Arc<AtomicBool>,
}

impl Bars {
    /// Takes over Ctrl-C and termination: the first asks for an orderly stop.
    pub fn new() -> anyhow::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let asked = stop.clone();
        ctrlc::set_handler(move || asked.store(true, Ordering::Relaxed))?;
        Ok(Self { bar: Mutex::new(ProgressBar::hidden()), stop })
    }

    /// Takes the last bar away.
    pub fn finish(&self) {
        if let Ok(bar) = self.bar.lock() {
            bar.finish_and_clear();
        }
    }
}

impl Progress for Bars {
    fn begin(&self, stage: &str, total: u64) {
        let template = "{prefix:>16} {wide_bar} {pos}/{len} {elapsed} gone, {eta} left";
        let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        // indicatif draws nothing where stderr is no terminal.
        let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr()).with_style(style);
        bar.set_prefix(stage.to_owned());
        bar.tick();
        if let Ok(mut present) = self.bar.lock() {
            present.finish_and_clear();
            *present = bar;
        }
    }

    fn advance(&self, steps: u64) {
        if let Ok(bar) = self.bar.lock() {
            bar.inc(steps);
        }
    }

    fn interrupted(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}
