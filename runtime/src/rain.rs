//! Rain that stands in the world: drops that keep their place and name from frame to frame and from one
//! camera to the next, found without being stored. Sparse convolution of [weber] §3.1, moved from the
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

pub mod kernel;
mod lattice;
pub mod light;
mod scatter;
pub mod shelter;
mod streak;
pub mod volume;

use crate::camera::{Camera, Projection};
use crate::density::check_view;
use crate::error::RuntimeError;
use crate::random::{hash, mix};
use glam::{DVec2, DVec3};
use lattice::{Eye, Piece};
use squall_formats::drops::{self, View};
use squall_formats::section::density::{Class, DensitySection, Mode};
use squall_formats::units::{Metres, Millimetres, MillimetresPerHour, Seconds};
use std::ops::Range;
use streak::{Drop, Lens};

pub use kernel::{Footprint, Kernel, SmoothWindow};
pub use light::{Environment, Light};
pub use scatter::Scene;
pub use shelter::{Shelter, ShelterMap};
pub use streak::Streak;
pub use volume::{Ceiling, RainVolume, Region};

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
    /// A camera at rest and the paper's streaks of 30 to 200 px. [weber] §4.3
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
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    searches: Vec<Search>,
    tasks: Vec<Task>,
    streaks: Vec<Streak>,
    canvas: scatter::Canvas,
}

/// A class of drops in one frame: all that its cells need.
#[derive(Clone, Debug)]
struct Search {
    class: u16,
    /// Hash of the seed and the class.
    key: u64,
    /// The lattice cell that the camera is in, and where in it.
    base: [i64; 3],
    place: DVec3,
    edge: f64,
    piece: Piece,
    /// Smallest diameter and width of the class, mm.
    from: f64,
    width: f64,
    /// Planar depths that any drop of the class can have, m.
    depths: [f64; 2],
    /// Margin around the picture's sides, m.
    margin: f64,
    /// e³ w N0, and Λ: a drop's own threshold is e³ w N0 e^{−ΛD}.
    crowd: f64,
    slope: f64,
    /// e^−(threshold of the class's smallest drop): where a cell's search ends.
    floor: f64,
}

/// Some layers of one class's lattice: what one thread does at a time.
#[derive(Clone, Debug, Default)]
struct Task {
    search: usize,
    layers: Range<i64>,
    found: Vec<Streak>,
}

/// What all classes share in one frame.
struct Frame<'a> {
    camera: &'a Camera,
    lens: Lens,
    exposure: f64,
    /// Projected lengths times depth over pixel length: L focal must lie between z min_px and z max_px.
    lengths: [f64; 2],
    /// Half the exposure's way of a drop with no fall speed, camera space, m.
    still_way: DVec3,
    /// World up in camera space.
    up: DVec3,
    weather: &'a Weather,
    /// Rain is full wherever this frame looks.
    full: bool,
    shelter: Option<&'a dyn Shelter>,
}

/// Layers of a class go to this many tasks, so that eight threads share even the largest class.
const SLABS: i64 = 8;
/// The most lattice cells and rows that one frame may visit.
const MOST_CELLS: f64 = 1e8;
/// Lattice coordinates stay exact in double precision up to here.
const MOST_REMOTE: f64 = 4e15;

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
        let view = shot.view()?;
        self.check_weather(shot, weather)?;
        workspace.streaks.clear();
        workspace.searches.clear();
        if weather.rate.0 == 0.0 {
            return Ok(&workspace.streaks);
        }
        let camera = shot.camera;
        let (mut drops, mut cells, mut reach) = (0.0, 0.0, 0.0_f64);
        for (index, class) in self.classes.iter().enumerate() {
            let search = self.search(index, class, shot, weather, &view)?;
            let [work_drops, work_cells] = search.work(&view);
            drops += work_drops;
            cells += work_cells;
            reach = reach.max(search.depths[1]);
            workspace.searches.push(search);
        }
        let allowed = (0.0..=self.most_drops).contains(&drops) && (0.0..=MOST_CELLS).contains(&cells);
        if !allowed {
            return Err(RuntimeError::argument(
                "rain",
                format!("a shot that searches at most {} drops and {MOST_CELLS} cells", self.most_drops),
                format!(
                    "{drops:.3e} drops in {cells:.3e} cells; raise min_px, shorten the exposure or widen the lens"
                ),
            ));
        }
        let relative = |v: DVec3| DVec3::new(v.dot(camera.right), v.dot(camera.up), v.dot(camera.forward));
        let half = camera.half_extent();
        let focal = camera.pixels_per_metre();
        let ball = reach * (1.0 + half.length_squared()).sqrt();
        let frame = Frame {
            camera,
            lens: Lens {
                focal,
                half_width: 0.5 * f64::from(camera.width),
                half_height: 0.5 * f64::from(camera.height),
                tangent: half,
            },
            exposure: shot.exposure.0,
            lengths: [shot.min_px / focal, shot.max_px / focal],
            still_way: relative(weather.wind - shot.velocity) * (0.5 * shot.exposure.0),
            up: relative(DVec3::Z),
            weather,
            full: weather.volume.fills(camera.position, 2.0 * ball),
            shelter,
        };
        workspace.plan();
        let Workspace { searches, tasks, streaks, .. } = workspace;
        let run = |task: &mut Task| {
            let search = &searches[task.search];
            for layer in task.layers.clone() {
                search.scan_layer(&frame, layer, &mut task.found);
            }
        };
        #[cfg(feature = "rayon")]
        {
            use rayon::prelude::*;
            tasks.par_iter_mut().for_each(run);
        }
        #[cfg(not(feature = "rayon"))]
        tasks.iter_mut().for_each(run);
        for task in tasks.iter() {
            streaks.extend_from_slice(&task.found);
        }
        Ok(streaks)
    }

    fn check_weather(&self, shot: &Shot, weather: &Weather) -> Result<(), RuntimeError> {
        let largest = self.largest_rate.0;
        if !(0.0..=largest).contains(&weather.rate.0) {
            let wanted = format!("0 to {largest} mm/h, the range of this asset's rain");
            return Err(RuntimeError::argument("rate", wanted, weather.rate.0));
        }
        for (field, vector) in
            [("wind", weather.wind), ("drift", weather.drift), ("camera velocity", shot.velocity)]
        {
            // A squared length that overflows is no wind.
            if !vector.length_squared().is_finite() {
                return Err(RuntimeError::argument(field, "three finite numbers", vector));
            }
        }
        if !weather.time.0.is_finite() {
            return Err(RuntimeError::argument("time", "finite seconds", weather.time.0));
        }
        Ok(())
    }

    fn search(
        &self,
        index: usize,
        class: &Class,
        shot: &Shot,
        weather: &Weather,
        view: &View,
    ) -> Result<Search, RuntimeError> {
        let camera = shot.camera;
        let edge = class.edge().0;
        // The camera in the class's own frame. The edge is a power of two: dividing by it is exact, and so is
        // splitting off the whole cells, so that a drop's place in the picture has the precision of the
        // camera's own place, after a day as in the first second.
        let fallen = DVec3::Z * (class.fall_speed.0 * weather.time.0);
        let remote = (camera.position - weather.drift + fallen) / edge;
        if !(0.0..MOST_REMOTE).contains(&remote.abs().max_element()) {
            return Err(RuntimeError::argument(
                "time, drift and camera position",
                "a sum within 4e15 lattice cells",
                remote,
            ));
        }
        let cell = remote.floor();
        let place = remote - cell;
        let length = |diameter: Millimetres| {
            drops::streak_length(diameter, drops::fall_speed(diameter), shot.exposure)
        };
        let [from, to] = class.diameter;
        let depths = [view.distance(length(from), shot.max_px).0, view.distance(length(to), shot.min_px).0];
        // Half of the longest way in the picture, and the drop's own size on both sides.
        let speeds = [from, to].map(|diameter| {
            let velocity = weather.wind - DVec3::Z * drops::fall_speed(diameter).0 - shot.velocity;
            velocity.length()
        });
        let margin = 0.5 * speeds[0].max(speeds[1]) * shot.exposure.0 + Metres::from(to).0;
        let half = camera.half_extent();
        // A few pixels for the soft edge of kernels.
        let soft = DVec2::new(8.0 / f64::from(camera.width), 8.0 / f64::from(camera.height));
        let eye = Eye {
            position: place,
            right: camera.right,
            up: camera.up,
            forward: camera.forward,
            tangent: half * (DVec2::ONE + soft),
        };
        let width = to.0 - from.0;
        let slope = drops::slope(weather.rate);
        Ok(Search {
            class: index as u16,
            key: hash(&[self.seed, index as u64]),
            base: [cell.x as i64, cell.y as i64, cell.z as i64],
            place,
            edge,
            piece: Piece::new(&eye, depths[0] / edge, depths[1] / edge, margin / edge),
            from: from.0,
            width,
            depths,
            margin,
            crowd: edge * edge * edge * width * drops::INTERCEPT,
            slope,
            floor: libm::exp(-class.candidates_per_cell(weather.rate)),
        })
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
            + self.tasks.capacity() * size_of::<Task>()
            + (self.streaks.capacity() + found) * size_of::<Streak>()
            + self.canvas.bytes()
    }

    /// Divides every class's layers among its tasks; their lists keep the memory of earlier frames.
    fn plan(&mut self) {
        let count = self.searches.len() * SLABS as usize;
        self.tasks.resize_with(count.max(self.tasks.len()), Task::default);
        for (index, task) in self.tasks.iter_mut().enumerate() {
            task.found.clear();
            task.layers = 0..0;
            if index >= count {
                continue;
            }
            task.search = index / SLABS as usize;
            let layers = self.searches[task.search].piece.layers();
            let (slab, total) = (index as i64 % SLABS, layers.end - layers.start);
            task.layers = layers.start + total * slab / SLABS..layers.start + total * (slab + 1) / SLABS;
        }
    }
}

impl Search {
    /// Upper bounds of the drops and cells that this class's search touches: the piece of the frustum with a
    /// cell's diagonal around it, whole from the eye on.
    fn work(&self, view: &View) -> [f64; 2] {
        let diagonal = self.edge * 3.0_f64.sqrt();
        let tangent = libm::tan(0.5 * view.vertical_fov.0);
        // Half extents a0 + a1 z, b0 + b1 z.
        let side = |tangent: f64| [self.margin * (1.0 + tangent * tangent).sqrt() + diagonal, tangent];
        let [[a0, a1], [b0, b1]] = [side(tangent * view.aspect), side(tangent)];
        let far = self.depths[1];
        let integral = far * (a0 * b0 + far * (0.5 * (a0 * b1 + a1 * b0) + far * a1 * b1 / 3.0));
        let cap = 2.0 * diagonal * (a0 + a1 * far) * (b0 + b1 * far);
        let cells = 4.0 * (integral + cap) / (self.edge * self.edge * self.edge);
        let drops = cells * self.crowd * libm::exp(-self.slope * self.from);
        [drops, cells.max(self.piece.rows_in_box())]
    }

    fn scan_layer(&self, frame: &Frame, layer: i64, found: &mut Vec<Streak>) {
        let layer_key = mix(self.key ^ mix((self.base[2].wrapping_add(layer)) as u64));
        for row in self.piece.rows(layer) {
            let row_key = mix(layer_key ^ (self.base[1].wrapping_add(row)) as u64);
            for cell in self.piece.cells(layer, row) {
                let key = mix(row_key ^ (self.base[0].wrapping_add(cell)) as u64);
                let corner = DVec3::new(cell as f64, row as f64, layer as f64) - self.place;
                self.scan_cell(frame, key, corner, found);
            }
        }
    }

    /// The drops of one cell. `corner` is the cell's own, relative to the camera, in cells.
    #[inline]
    fn scan_cell(&self, frame: &Frame, key: u64, corner: DVec3, found: &mut Vec<Streak>) {
        const STEP: u64 = 0x9E37_79B9_7F4A_7C15;
        const HALF_BITS: f64 = 1.0 / (1u64 << 32) as f64;
        let mut state = key;
        // e^{−s} of the drop at hand: arrivals are sums of exponentials, so this is a product of uniforms.
        let mut arrival = 1.0;
        loop {
            state = state.wrapping_add(STEP);
            let bits = mix(state);
            arrival *= ((bits >> 32) as f64 + 0.5) * HALF_BITS;
            if arrival <= self.floor {
                return;
            }
            state = state.wrapping_add(STEP);
            let id = mix(state);
            let diameter = self.from + self.width * ((bits & 0xFFFF_FFFF) as f64 + 0.5) * HALF_BITS;
            if let Some(streak) = self.judge(frame, id, arrival, diameter, corner) {
                found.push(streak);
            }
        }
    }

    /// One drop: in the frustum's piece, in the rain at this rate, under no roof?
    #[inline]
    fn judge(&self, frame: &Frame, id: u64, arrival: f64, diameter: f64, corner: DVec3) -> Option<Streak> {
        let Frame { camera, lens, .. } = frame;
        const THIRD_BITS: f64 = 1.0 / (1u64 << 21) as f64;
        let part = |shift: u32| ((id >> shift & 0x1F_FFFF) as f64 + 0.5) * THIRD_BITS;
        let offset = (corner + DVec3::new(part(0), part(21), part(42))) * self.edge;
        let depth = offset.dot(camera.forward);
        if !(depth >= self.depths[0] && depth <= self.depths[1]) {
            return None;
        }
        let centre = DVec3::new(offset.dot(camera.right), offset.dot(camera.up), depth);
        let speed = drops::fall_speed(Millimetres(diameter)).0;
        let length = diameter * 1e-3 + speed * frame.exposure;
        if !(length >= depth * frame.lengths[0] && length < depth * frame.lengths[1]) {
            return None;
        }
        let mut expected = self.crowd * libm::exp(-self.slope * diameter);
        if !frame.full {
            expected *= frame.weather.volume.density(camera.position + offset);
        }
        if arrival <= libm::exp(-expected) {
            return None;
        }
        if let Some(shelter) = frame.shelter {
            let velocity = frame.weather.wind - DVec3::Z * speed;
            if !shelter.reaches(camera.position + offset, velocity) {
                return None;
            }
        }
        let half_way = frame.still_way - frame.up * (0.5 * speed * frame.exposure);
        lens.streak(&Drop { id, class: self.class, diameter, centre, half_way })
    }
}
