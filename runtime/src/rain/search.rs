//! One class of drops in one frame: its lattice's cells, and the drops that a cell's hash yields.

#[cfg(feature = "gpu")]
mod upload;

use super::lattice::{FrustumPiece, Viewpoint};
use super::streak::{Drop, Lens};
use super::{RainField, Shelter, Shot, Streak, Weather};
use crate::camera::Camera;
use crate::error::RuntimeError;
use crate::random::{hash, mix};
use glam::{DVec2, DVec3};
use squall_formats::drops::{self, View};
use squall_formats::section::density::Class;
use squall_formats::units::{Metres, Millimetres};
use std::ops::Range;

/// A class of drops in one frame: all that its cells need.
#[derive(Clone, Debug)]
pub(super) struct Search {
    class: u16,
    /// Hash of the seed and the class.
    key: u64,
    /// The lattice cell that the camera is in, and where in it.
    base: [i64; 3],
    place: DVec3,
    edge: f64,
    piece: FrustumPiece,
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

/// What all classes share in one frame.
pub(super) struct ShotFrame<'a> {
    pub camera: &'a Camera,
    pub lens: Lens,
    pub exposure: f64,
    /// Projected lengths times depth over pixel length: L focal must lie between z min_px and z max_px.
    pub lengths: [f64; 2],
    /// Half the exposure's way of a drop with no fall speed, camera space, m.
    pub still_way: DVec3,
    /// World up in camera space.
    pub up: DVec3,
    pub weather: &'a Weather,
    pub field: &'a RainField<'a>,
    /// Rain is full wherever this frame looks.
    pub full: bool,
    pub shelter: Option<&'a dyn Shelter>,
}

/// Lattice coordinates stay exact in double precision up to here.
const MOST_REMOTE: f64 = 4e15;

impl Search {
    /// Prepares class number `index` for a frame. Errors: a time or place so far that cells lose their numbers.
    pub fn new(
        seed: u64,
        index: usize,
        class: &Class,
        shot: &Shot,
        weather: &Weather,
    ) -> Result<Self, RuntimeError> {
        let camera = shot.camera;
        let view = shot.view()?;
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
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let soft = DVec2::new(8.0 / size.x, 8.0 / size.y);
        let eye = Viewpoint {
            position: place,
            right: camera.right,
            up: camera.up,
            forward: camera.forward,
            // A lattice's frustum is symmetric: with an off-centre axis it reaches to the farther side.
            tangent: half * (DVec2::ONE + soft + 2.0 * camera.shift_px.abs() / size),
        };
        let width = to.0 - from.0;
        let slope = drops::slope(weather.rate);
        Ok(Self {
            class: index as u16,
            key: hash(&[seed, index as u64]),
            base: [cell.x as i64, cell.y as i64, cell.z as i64],
            place,
            edge,
            piece: FrustumPiece::new(&eye, depths[0] / edge, depths[1] / edge, margin / edge),
            from: from.0,
            width,
            depths,
            margin,
            crowd: edge * edge * edge * width * drops::INTERCEPT,
            slope,
            floor: libm::exp(-class.candidates_per_cell(weather.rate)),
        })
    }

    /// Layers of cells to look at.
    pub fn layers(&self) -> Range<i64> {
        self.piece.layers()
    }

    /// Farthest from the camera that a drop of this class can be and be looked at, m.
    pub fn radius(&self) -> f64 {
        self.piece.radius(self.place) * self.edge
    }

    /// Upper bounds of the drops and cells that this class's search touches: the piece of the frustum with a
    /// cell's diagonal around it, whole from the eye on.
    pub fn work(&self, view: &View) -> [f64; 2] {
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

    /// All streaks of one layer of cells, appended to `found`.
    pub fn scan_layer(&self, frame: &ShotFrame, layer: i64, found: &mut Vec<Streak>) {
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
    fn scan_cell(&self, frame: &ShotFrame, key: u64, corner: DVec3, found: &mut Vec<Streak>) {
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
            if let Some(streak) = self.evaluate(frame, id, arrival, diameter, corner) {
                found.push(streak);
            }
        }
    }

    /// One drop: in the frustum's piece, in the rain at this rate, under no roof?
    #[inline]
    fn evaluate(
        &self,
        frame: &ShotFrame,
        id: u64,
        arrival: f64,
        diameter: f64,
        corner: DVec3,
    ) -> Option<Streak> {
        let ShotFrame { camera, lens, .. } = frame;
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
        let [within, slope] = match frame.full {
            true => [1.0, self.slope],
            false => {
                let [within, factor] = frame.field.thinning(camera.position + offset)?;
                [within, self.slope * factor]
            }
        };
        let expected = within * self.crowd * libm::exp(-slope * diameter);
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
