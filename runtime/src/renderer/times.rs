//! How long the parts of a picture took, by a clock of the caller's: the runtime asks no system for the time.

/// Seconds that the parts of a picture took; all 0 without a clock.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct FrameTimes {
    /// From the asset's rows and the strokes' direct light to light per cell.
    pub light: f64,
    /// The world around the eye, and what drops make of it.
    pub surroundings: f64,
    /// The town and the map that its mirrors look into.
    pub town: f64,
    /// Sky and cloud behind it, and clear air before it.
    pub sky: f64,
    /// The rain's medium.
    pub medium: f64,
    /// Lamps and channels.
    pub lights_in_view: f64,
    /// The rain's streaks.
    pub streaks: f64,
}

impl FrameTimes {
    /// Every part by its name.
    #[must_use]
    pub fn named(&self) -> [(&'static str, f64); 7] {
        [
            ("light", self.light),
            ("surroundings", self.surroundings),
            ("town", self.town),
            ("sky", self.sky),
            ("medium", self.medium),
            ("lights in view", self.lights_in_view),
            ("streaks", self.streaks),
        ]
    }
}

/// A clock that says seconds since any moment.
pub type Clock = fn() -> f64;

/// A clock being watched.
#[derive(Clone, Copy)]
pub(super) struct Watch {
    clock: Option<Clock>,
    last: f64,
}

impl Watch {
    pub fn new(clock: Option<Clock>) -> Self {
        Self { clock, last: clock.map_or(0.0, |clock| clock()) }
    }

    /// Adds the time since the last lap to `part`.
    pub fn lap(&mut self, part: &mut f64) {
        if let Some(clock) = self.clock {
            let now = clock();
            *part += now - self.last;
            self.last = now;
        }
    }
}
