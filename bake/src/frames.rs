//! Rain over somebody's own frames, from files to files: what `squall rain` does. What falls on a frame is
//! [`squall_runtime::frame_rain`]'s to say; here are sequences, places, the light's one estimate, the manifest and going on.

mod job;
mod journal;
mod layers;
pub mod manifest;
mod place;
mod plan;
mod run;
mod stream;

pub use job::{Holes, Job, MOST_EXPOSURE_MS, MOST_GAIN, MOST_WIND_M_PER_S, RightCamera};
pub use run::{Given, Report, run};
