//! Rain that stands in the world: drops that keep their place and name from frame to frame and from one
//! camera to the next, found without being stored. Sparse convolution of \[weber\] §3.1, moved from the
//! screen into space.
//!
//! 1. Each class of drops has a frame that moves with it, by the wind and its own fall speed: in that frame
//!    its drops stand still.
//! 2. A fixed lattice divides the frame. A cell's number (with the class's and the seed) is hashed, and the
//!    hash yields a Poisson process of drops: positions, diameters, names. Nothing is stored, nothing
//!    respawns, and no change of rate, exposure, lens or picture moves a drop.
//! 3. A cell's drops come as arrivals s₁ < s₂ < … of a process with unit rate, each with a diameter D uniform in
//!    its class of width w. A drop falls at rate R if s < e³ w N(D, R), e the cell's edge: exactly Marshall
//!    and Palmer's distribution at every R, and N grows with R, so more rain adds drops and removes none.
//! 4. Only cells that meet the piece of the frustum between the distances of the longest and the shortest
//!    streak are looked at.
//!
//! | symbol | name        | unit      |
//! | R      | `rate`      | mm/h      |
//! | T      | `exposure`  | s         |
//! | V      | `velocity`  | m/s       |
//! | L      | D + vT, length before projection | m |

pub mod cover;
mod dry;
pub mod fan;
pub mod field;
pub mod kernel;
mod lattice;
pub mod light;
pub mod map;
mod pattern;
pub mod place;
mod scatter;
mod search;
pub mod shelter;
mod streak;
pub mod tile_buffer;
pub mod under;
#[cfg(feature = "gpu")]
mod upload;
pub mod volume;
mod window;

use crate::camera::{Camera, Projection};
use crate::density::check_view;
use crate::error::RuntimeError;
use crate::parallel::prelude::*;
use glam::DVec3;
use search::{Search, ShotFrame};
use squall_formats::drops::View;
use squall_formats::section::density::{Class, DensitySection, Mode};
use squall_formats::units::{MillimetresPerHour, Seconds};
use std::ops::Range;
use streak::Lens;

pub use cover::{CoverMap, Covers};
pub(crate) use dry::{DryAir, DryTiles};
pub use fan::RainFan;
pub use field::{RainField, RainPath};
pub use kernel::{Clip, Footprint, Kernel, Ribbon, Span};
pub use light::{MainLight, RainLight, Surroundings};
pub use map::RainMap;
pub use pattern::PatternScratch;
pub use place::{MapChoice, RainPlace};
pub use scatter::Scene;
pub use shelter::{Shelter, ShelterMap};
pub use streak::Streak;
pub use under::CoveredRain;
#[cfg(feature = "gpu")]
pub(crate) use under::relief_of;
pub use volume::{Ceiling, RainVolume, Region};
pub use window::SmoothWindow;

/// The weather at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weather {
    /// Rainfall intensity, from 0 to the asset's largest rate.
    pub rate: MillimetresPerHour,
    /// Wind now, m/s: what the drops' streaks lean with.
    pub wind: DVec3,
    /// Where the wind has carried the air since time 0, m: its integral over time. A wind that changes
    /// must change this smoothly, or the drops jump.
    pub drift: DVec3,
    /// Time of the middle of the exposure.
    pub time: Seconds,
    /// Where it rains.
    pub volume: RainVolume,
}

impl Weather {
    /// Rain everywhere, in a wind that has blown the same since time 0.
    pub fn steady(rate: MillimetresPerHour, wind: DVec3, time: Seconds) -> Self {
        Self { rate, wind, drift: wind * time.0, time, volume: RainVolume::default() }
    }
}

/// One exposure of one camera.
#[derive(Clone, Copy, Debug)]
pub struct Shot<'a> {
    /// The camera in the middle of the exposure.
    pub camera: &'a Camera,
    /// How it moves, m/s. Its turning during the exposure is not modelled.
    pub velocity: DVec3,
    /// Time that the shutter is open.
    pub exposure: Seconds,
    /// Shortest streak that is drawn, px; shorter ones belong to the medium.
    pub min_px: f64,
    /// Longest streak that is drawn, px.
    pub max_px: f64,
}

impl<'a> Shot<'a> {
    /// A camera at rest and the paper's streaks of 30 to 200 px. \[weber\] §4.3
    pub fn new(camera: &'a Camera, exposure: Seconds) -> Self {
        Self { camera, velocity: DVec3::ZERO, exposure, min_px: 30.0, max_px: 200.0 }
    }

    /// What a count of streaks depends on. Errors: an orthographic camera, in which no distance belongs to a
    /// length; an exposure or lengths that are not positive; an inverted range of lengths.
    pub fn view(&self) -> Result<View, RuntimeError> {
        let Projection::Perspective { vertical_fov } = self.camera.projection else {
            return Err(RuntimeError::argument("rain camera", "a perspective camera", "an orthographic one"));
        };
        let view = View {
            vertical_fov,
            height_px: f64::from(self.camera.height),
            aspect: self.camera.aspect(),
            exposure: self.exposure,
            min_px: self.min_px,
            max_px: self.max_px,
        };
        check_view(&view)?;
        Ok(view)
    }
}

/// An asset's rain, ready to be looked at.
#[derive(Clone, Debug, PartialEq)]
pub struct Rain {
    classes: Vec<Class>,
    largest_rate: MillimetresPerHour,
    seed: u64,
    /// The most drops that one frame may search through; a shot that would need more is refused. 2²³ by
    /// default, some tenths of a second.
    pub most_drops: f64,
}

/// Memory for one camera's frames: a frame allocates nothing that an earlier one of its kind has left here.
#[derive(Debug, Default)]
pub struct Workspace {
    searches: Vec<Search>,
    tasks: Vec<SearchTask>,
    streaks: Vec<Streak>,
    canvas: scatter::Canvas,
}

/// Some layers of one class's lattice: what one thread does at a time.
#[derive(Clone, Debug, Default)]
struct SearchTask {
    search: usize,
    layers: Range<i64>,
    found: Vec<Streak>,
}

/// Layers of a class go to this many tasks, so that many threads share even the largest class.
const SLABS: usize = 64;
/// Tasks that run at a time: what they find is listed before the next ones begin, so that no drop is held twice for long.
const AT_ONCE: usize = 16;
/// The most lattice cells and rows that one frame may visit.
const MOST_CELLS: f64 = 1e8;

/// Faster than this, m/s, is a mistake of units; it also keeps streaks within numbers.
const MOST_SPEED: f64 = 1e4;

impl Rain {
    /// The rain of an asset's density tables (their default mode). Another seed is another rain.
    pub fn new(section: &DensitySection, seed: u64) -> Self {
        let classes = section.table(Mode::Default).classes.clone();
        Self { classes, largest_rate: section.largest_rate(), seed, most_drops: 8_388_608.0 }
    }

    /// Finds all streaks that touch the picture, into `workspace`, and returns them: class by class, in an
    /// order that depends on neither threads nor their number.
    ///
    /// The number of streaks with `inside` set is a Poisson number whose mean is the density table's count.
    /// Work grows with that number; with feature `rayon` it is spread over the caller's pool.
    ///
    /// Errors: an orthographic camera, an impossible shot, a rate that is negative or above the asset's
    /// range, numbers that are not finite, a shot that asks for more than [`Rain::most_drops`].
    pub fn find<'w>(
        &self,
        shot: &Shot,
        weather: &Weather,
        shelter: Option<&dyn Shelter>,
        workspace: &'w mut Workspace,
    ) -> Result<&'w [Streak], RuntimeError> {
        self.find_in(shot, weather, &weather.volume.into(), shelter, workspace)
    }

    /// [`Rain::find`] in rain that has a place: `field` in the stead of the weather's volume, whose rate is that of the field's
    /// heaviest rain. A map thins the same drops that fall without one, and moves none.
    ///
    /// Errors: as [`Rain::find`].
    pub fn find_in<'w>(
        &self,
        shot: &Shot,
        weather: &Weather,
        field: &RainField,
        shelter: Option<&dyn Shelter>,
        workspace: &'w mut Workspace,
    ) -> Result<&'w [Streak], RuntimeError> {
        workspace.streaks.clear();
        let radius = self.plan(shot, weather, &mut workspace.searches)?;
        if workspace.searches.is_empty() {
            return Ok(&workspace.streaks);
        }
        let camera = shot.camera;
        let relative = |v: DVec3| DVec3::new(v.dot(camera.right), v.dot(camera.up), v.dot(camera.forward));
        let half = camera.half_extent();
        let focal = camera.pixels_per_metre();
        let frame = ShotFrame {
            camera,
            lens: Lens {
                focal,
                half_width: 0.5 * f64::from(camera.width),
                half_height: 0.5 * f64::from(camera.height),
                tangent: half,
                shift: camera.shift_px,
                stretch: camera.pixel_aspect,
            },
            exposure: shot.exposure.0,
            lengths: [shot.min_px / focal, shot.max_px / focal],
            still_way: relative(weather.wind - shot.velocity) * (0.5 * shot.exposure.0),
            up: relative(DVec3::Z),
            weather,
            field,
            full: field.fills(camera.position, radius),
            shelter,
        };
        workspace.tasks.resize_with(AT_ONCE, SearchTask::default);
        let Workspace { searches, tasks, streaks, .. } = workspace;
        let run = |task: &mut SearchTask| {
            let search = &searches[task.search];
            for layer in task.layers.clone() {
                search.scan_layer(&frame, layer, &mut task.found);
            }
        };
        for first in (0..searches.len() * SLABS).step_by(AT_ONCE) {
            for (at, task) in tasks.iter_mut().enumerate() {
                task.plan(searches, first + at);
            }
            tasks.par_iter_mut().for_each(run);
            let found: usize = tasks.iter().map(|task| task.found.len()).sum();
            reserve(streaks, found);
            tasks.iter().for_each(|task| streaks.extend_from_slice(&task.found));
        }
        Ok(streaks)
    }

    /// Refuses what [`Rain::find`] would refuse, and looks for nothing.
    pub(crate) fn check(
        &self,
        shot: &Shot,
        weather: &Weather,
        workspace: &mut Workspace,
    ) -> Result<(), RuntimeError> {
        self.plan(shot, weather, &mut workspace.searches).map(|_| ())
    }

    /// The searches of a frame, one a class (none without rain); returns how far from the camera any of them looks, m.
    ///
    /// Errors: as [`Rain::find`].
    fn plan(&self, shot: &Shot, weather: &Weather, searches: &mut Vec<Search>) -> Result<f64, RuntimeError> {
        let view = shot.view()?;
        self.check_weather(shot, weather)?;
        searches.clear();
        if weather.rate.0 == 0.0 {
            return Ok(0.0);
        }
        let (mut drops, mut cells, mut radius) = (0.0, 0.0, 0.0_f64);
        for (index, class) in self.classes.iter().enumerate() {
            let search = Search::new(self.seed, index, class, shot, weather)?;
            let [work_drops, work_cells] = search.work(&view);
            drops += work_drops;
            cells += work_cells;
            radius = radius.max(search.radius());
            searches.push(search);
        }
        let allowed = (0.0..=self.most_drops).contains(&drops) && (0.0..=MOST_CELLS).contains(&cells);
        if allowed {
            return Ok(radius);
        }
        Err(RuntimeError::argument(
            "rain",
            format!("a shot that searches at most {} drops and {MOST_CELLS} cells", self.most_drops),
            format!("{drops:.3e} drops in {cells:.3e} cells; {}", self.nearest(shot, weather)),
        ))
    }

    /// What would make a shot possible that asks for too much.
    fn nearest(&self, shot: &Shot, weather: &Weather) -> String {
        let possible = |min_px: f64| {
            let shot = Shot { min_px, ..*shot };
            let (mut drops, mut cells) = (0.0, 0.0);
            for (index, class) in self.classes.iter().enumerate() {
                let (Ok(search), Ok(view)) =
                    (Search::new(self.seed, index, class, &shot, weather), shot.view())
                else {
                    return false;
                };
                let [work_drops, work_cells] = search.work(&view);
                drops += work_drops;
                cells += work_cells;
            }
            drops <= self.most_drops && cells <= MOST_CELLS
        };
        // Steps of a fifth: near enough for a hint.
        let longer = (1..60).map(|step| shot.min_px * libm::pow(1.2, f64::from(step)));
        match longer.take_while(|px| *px < shot.max_px).find(|px| possible(*px)) {
            Some(px) => {
                format!("raise the shortest of streak_px to {px:.0}, shorten the exposure or widen the lens")
            }
            None => "raise both ends of streak_px, shorten the exposure or widen the lens".into(),
        }
    }

    fn check_weather(&self, shot: &Shot, weather: &Weather) -> Result<(), RuntimeError> {
        let largest = self.largest_rate.0;
        if !(0.0..=largest).contains(&weather.rate.0) {
            let wanted = format!("0 to {largest} mm/h, the range of this asset's rain");
            return Err(RuntimeError::argument("rate", wanted, weather.rate.0));
        }
        for (field, vector) in [("wind", weather.wind), ("camera velocity", shot.velocity)] {
            if !(0.0..=MOST_SPEED).contains(&vector.length()) {
                return Err(RuntimeError::argument(field, format!("at most {MOST_SPEED} m/s"), vector));
            }
        }
        if !weather.drift.is_finite() {
            return Err(RuntimeError::argument("drift", "three finite numbers", weather.drift));
        }
        if !weather.time.0.is_finite() {
            return Err(RuntimeError::argument("time", "finite seconds", weather.time.0));
        }
        Ok(())
    }
}

impl Workspace {
    /// An empty workspace.
    pub fn new() -> Self {
        Self::default()
    }

    /// The streaks that the last [`Rain::find`] found.
    pub fn streaks(&self) -> &[Streak] {
        &self.streaks
    }

    /// Bytes of memory that it holds: what later frames of the same kind will not allocate again.
    pub fn bytes(&self) -> usize {
        let found: usize = self.tasks.iter().map(|task| task.found.capacity()).sum();
        self.searches.capacity() * size_of::<Search>()
            + self.tasks.capacity() * size_of::<SearchTask>()
            + (self.streaks.capacity() + found) * size_of::<Streak>()
            + self.canvas.bytes()
    }
}

impl SearchTask {
    /// Sets out on task number `number` of all classes' layers; its list keeps the memory of earlier ones.
    fn plan(&mut self, searches: &[Search], number: usize) {
        self.found.clear();
        self.search = number / SLABS;
        self.layers = 0..0;
        if let Some(search) = searches.get(self.search) {
            let (layers, slabs, slab) = (search.layers(), SLABS as i64, (number % SLABS) as i64);
            let total = layers.end - layers.start;
            self.layers = layers.start + total * slab / slabs..layers.start + total * (slab + 1) / slabs;
        }
    }
}

/// Makes room for `more` streaks, and for a sixteenth of all of them beyond, where a vector alone would double.
fn reserve(streaks: &mut Vec<Streak>, more: usize) {
    let wanted = streaks.len() + more;
    if wanted > streaks.capacity() {
        streaks.reserve_exact(wanted + wanted / 16 - streaks.len());
    }
}
