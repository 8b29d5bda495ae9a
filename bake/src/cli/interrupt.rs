//! Ctrl-C, termination and hang-up: the work is asked to stop, and ended after a moment wherever it is, with nothing half-written.

use super::progress;
use squall_bake::BakeError;
use squall_bake::output::pending;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

static ASKED: AtomicBool = AtomicBool::new(false);
static SAID: AtomicBool = AtomicBool::new(false);

/// What an orderly stop may take: scripts that this process started end in it, and folders for temporary files go.
const GRACE: Duration = Duration::from_millis(300);

/// Takes over INT, TERM and HUP for the whole command. Errors: the system refuses to.
pub fn install() -> anyhow::Result<()> {
    ctrlc::set_handler(|| {
        ASKED.store(true, Ordering::Relaxed);
        std::thread::sleep(GRACE);
        progress::clear();
        let note = pending::discard();
        say(note);
        std::process::exit(i32::from(BakeError::Interrupted.exit_code()));
    })?;
    Ok(())
}

/// Whether somebody wants this process to stop.
pub fn asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}

/// Says that the command was interrupted, and what was left on purpose; once, whoever comes first.
pub fn say(note: Option<String>) {
    if SAID.swap(true, Ordering::Relaxed) {
        return;
    }
    let mut words = match pending::has_written() {
        true => "squall: interrupted; what is whole stays\n".to_owned(),
        false => format!("squall: {}\n", BakeError::Interrupted),
    };
    if let Some(note) = note {
        words = format!("note: {note}\n{words}");
    }
    let _ = std::io::stderr().write_all(words.as_bytes());
}
