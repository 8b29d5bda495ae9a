//! The thread that holds the storm and draws.

use squall_page::{CONTROLS, Player};
use squall_runtime::Asset;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

enum Ask {
    Set(&'static str, f64),
    Strike(f64, f64),
    Draw(u32, u32),
}

/// What the thread answers.
pub enum Answer {
    /// A picture.
    Drawn(Drawn),
    /// Metres that a stroke stands beside where it was meant.
    Moved(f64),
    /// Why something is not done.
    Refused(String),
}

/// A picture: RGBA, 8 bits, row 0 on top.
pub struct Drawn {
    pub width: u32,
    pub height: u32,
    pub pixels: Vec<u8>,
    pub took: Duration,
    streaks: usize,
}

impl Drawn {
    /// What it took, in words.
    pub fn words(&self) -> String {
        format!(
            "{} × {} px in {:.0} ms on the processor, {} streaks",
            self.width,
            self.height,
            self.took.as_secs_f64() * 1e3,
            self.streaks
        )
    }
}

/// The window's end of the thread, which ends with it.
pub struct Drawer {
    asks: Sender<Ask>,
    answers: Receiver<Answer>,
    values: BTreeMap<&'static str, f64>,
}

impl Drawer {
    /// Opens an asset and starts the thread.
    ///
    /// Errors: those of opening, in words.
    pub fn open(path: &Path) -> Result<Self, String> {
        let mut player = Player::default();
        Asset::open(path).and_then(|asset| player.start(asset)).map_err(|error| error.to_string())?;
        let mut value = |name| player.get(name).unwrap_or(0.0);
        let values = CONTROLS.iter().map(|control| (control.name, value(control.name))).collect();
        let (asks, asked) = channel();
        let (answer, answers) = channel();
        std::thread::spawn(move || {
            while let Ok(ask) = asked.recv() {
                if let Some(done) = answered(&mut player, ask)
                    && answer.send(done).is_err()
                {
                    return;
                }
            }
        });
        Ok(Self { asks, answers, values })
    }

    /// Every control's value in the asset's own view.
    pub fn values(&self) -> &BTreeMap<&'static str, f64> {
        &self.values
    }

    // The thread ends only with its senders: what is asked for always arrives.
    fn ask(&self, ask: Ask) {
        let _ = self.asks.send(ask);
    }

    pub fn set(&self, name: &'static str, value: f64) {
        self.ask(Ask::Set(name, value));
    }

    pub fn strike(&self, x: f64, y: f64) {
        self.ask(Ask::Strike(x, y));
    }

    pub fn draw(&self, width: u32, height: u32) {
        self.ask(Ask::Draw(width, height));
    }

    /// What has been answered since the last call.
    pub fn answers(&self) -> Vec<Answer> {
        self.answers.try_iter().collect()
    }
}

fn answered(player: &mut Player, ask: Ask) -> Option<Answer> {
    let start = Instant::now();
    let done = match ask {
        Ask::Set(name, value) => player.set(name, value).map(|()| None),
        Ask::Strike(x, y) => player.strike(x, y).map(|metres| Some(Answer::Moved(metres))),
        Ask::Draw(width, height) => player.draw(width, height).map(<[u8]>::to_vec).map(|pixels| {
            let (took, streaks) = (start.elapsed(), player.streaks());
            Some(Answer::Drawn(Drawn { width, height, pixels, took, streaks }))
        }),
    };
    done.unwrap_or_else(|error| Some(Answer::Refused(error.to_string())))
}
