//! Where and when drops hit the surfaces that a frame shows: a Poisson process of places and times, hashed by columns of the world, so that a place
//! keeps its hits however the camera moves and whatever was drawn before.
//!
//! Surfaces are put in order by the axis that they face most: floors by z, walls by x or y. Over the plane across that axis lie cells; each cell,
//! class of drops and slot of time has its own stream of numbers, which says where in the cell drops come down and when. Where a drop meets the
//! surface is then asked of the frame's own depth, by following the axis. Drops that fall at f = (wind, −v) hit N |f·n|/|n_axis| times a square metre of that
//! plane a second: streams hold as many as the steepest surface gets, and a number of each hit's own says whether this one does.

use crate::random::Random;
use crate::wet::drop::eye::{Eye, Spot};
use crate::wet::frame::{GBuffer, WetFrame};
use crate::wet::maps::GroundMap;
use crate::wet::ripples::DropFlux;
use glam::{DVec2, DVec3, Vec3};

/// Side of a cell, m.
pub(crate) const CELL_M: f64 = 0.25;
/// Least cosine between a surface's normal and the axis that it is followed along.
const LEAST_ALONG: f32 = 0.5;
/// The largest tangent that goes with it.
const STEEPEST: f64 = 1.733;
/// Surfaces told apart in one column.
const LAYERS: usize = 4;
/// Surfaces of one column nearer to each other than this are one, m.
const APART_M: f32 = 0.15;
/// How far off the frame's surface a hit may come to lie, m, and in pixels.
const OFF_M: f32 = 0.01;
const OFF_PX: f32 = 1.5;
/// Rain is followed upward to what shelters a place in so many cells of the height map at most.
const SHELTER_CELLS: usize = 24;
/// A place this far below the uppermost surface is under it, m.
const UNDER_M: f32 = 0.3;

/// A hit.
#[derive(Clone, Debug)]
pub(crate) struct Hit {
    pub place: DVec3,
    pub offset: Vec3,
    pub normal: Vec3,
    pub spot: Spot,
    pub age_s: f64,
    /// Numbers for its looks.
    pub random: Random,
}

/// A surface in a column: its height along the axis from the eye, and its normal.
#[derive(Clone, Copy, Debug, Default)]
struct Layer {
    height: f32,
    normal: Vec3,
    nearest: f32,
}

/// A column of the world that the frame shows something of.
#[derive(Clone, Debug)]
struct Column {
    axis: usize,
    cell: [i64; 2],
    layers: [Layer; LAYERS],
    count: usize,
    nearest: f32,
}

/// What the frame shows, in columns.
#[derive(Clone, Debug, Default)]
pub(crate) struct Columns {
    list: Vec<Column>,
    /// Open addresses: place in the list plus 1.
    table: Vec<u32>,
}

/// How rain falls and what keeps it off.
pub(crate) struct Fall<'a> {
    wind: DVec3,
    height: Option<&'a GroundMap>,
    top: f32,
}

impl<'a> Fall<'a> {
    /// Reads the whole height map where there is wind: once a frame and effect, not once a class of drops.
    pub fn new(frame: &WetFrame<'a>) -> Self {
        let height = frame.maps.height_m.as_ref();
        let still = frame.wind.truncate().length() == 0.0;
        let top = height.filter(|_| !still).map_or(f32::INFINITY, |map| highest(&map.values));
        Self { wind: frame.wind, height, top }
    }

    /// What shelters.
    pub fn map(&self) -> Option<&'a GroundMap> {
        self.height
    }

    /// The same under rain that falls straight down.
    pub fn calm(&self) -> Self {
        Self { wind: DVec3::ZERO, ..*self }
    }

    /// Where to ask of a surface whether it is sheltered: so far out along its normal that no cell of the height map which holds the surface
    /// itself, up to a wall's parapet or a roof's higher side, lies over it.
    pub fn before(&self, place: DVec3, normal: Vec3) -> DVec3 {
        let Some(map) = self.height else { return place };
        let out = map.cell_m * f64::from(normal.x.abs() + normal.y.abs()) * 1.01;
        place + normal.as_dvec3() * out
    }

    /// Whether something stands between a place and the rain that would fall on it at a speed, m/s. What is over a place that the frame shows
    /// is a lid: rain that wind drives comes in under its edge.
    pub fn sheltered(&self, place: DVec3, speed: f64) -> bool {
        let Some(map) = self.height else { return false };
        let (z, at) = (place.z as f32, place.truncate());
        let mut over = map.at(at);
        let mut under = over.is_some_and(|height| height > z + UNDER_M);
        let lean = DVec2::new(-self.wind.x, -self.wind.y) / speed.max(0.1);
        let across = lean.length();
        if across < 1e-3 {
            return under;
        }
        let rise = map.cell_m / across;
        for step in 1..=SHELTER_CELLS {
            let up = rise * step as f64;
            let (below, height) = (z + (up - rise) as f32, z + up as f32);
            let here = map.at(at + lean * up);
            if under && here.is_none_or(|top| top <= height) {
                // The drop's way came out through the lid, or past its edge.
                if over.is_some_and(|top| top <= height) || here.is_some_and(|top| top > below) {
                    return true;
                }
                under = false;
            } else if !under && here.is_some_and(|top| top > height + UNDER_M) {
                return true;
            }
            if !under && height > self.top {
                return false;
            }
            over = here;
        }
        under
    }

    /// Hits a square metre across `axis` of a surface with this normal, over those of a level floor in still air.
    fn gain(&self, drop: &DropFlux, normal: Vec3, axis: usize) -> f64 {
        let velocity = DVec3::new(self.wind.x, self.wind.y, -drop.speed_m_per_s);
        let facing = (-velocity.dot(normal.as_dvec3())).max(0.0);
        facing / f64::from(normal[axis].abs()).max(1e-3) / drop.speed_m_per_s.max(1e-3)
    }

    /// The largest [`Self::gain`] of any surface that is followed along `axis`.
    fn most(&self, drop: &DropFlux, axis: usize) -> f64 {
        let across = self.wind.truncate().length() / drop.speed_m_per_s.max(1e-3);
        if axis == 2 { 1.0 + STEEPEST * across } else { across * (1.0 + STEEPEST) + STEEPEST }
    }
}

/// The largest of many values, those that are no number left out; −∞ of none. Sixteen at a time: a map has millions.
fn highest(values: &[f32]) -> f32 {
    let mut lanes = [f32::NEG_INFINITY; 16];
    let whole = values.chunks_exact(16);
    let rest = whole.remainder().iter().copied();
    for chunk in whole {
        for (most, value) in lanes.iter_mut().zip(chunk) {
            *most = if *value > *most { *value } else { *most };
        }
    }
    rest.chain(lanes).fold(f32::NEG_INFINITY, f32::max)
}

/// Which axis a normal faces most; floors before walls.
fn axis_of(normal: Vec3) -> Option<usize> {
    if normal.z >= LEAST_ALONG {
        return Some(2);
    }
    if normal.z <= -LEAST_ALONG {
        return None;
    }
    let axis = usize::from(normal.y.abs() > normal.x.abs());
    (normal[axis].abs() >= LEAST_ALONG).then_some(axis)
}

/// The two axes across one.
const fn others(axis: usize) -> [usize; 2] {
    [[1, 2], [0, 2], [0, 1]][axis]
}

fn address(axis: usize, cell: [i64; 2]) -> u64 {
    crate::random::mix(cell[0] as u64 ^ (cell[1] as u64).rotate_left(31) ^ ((axis as u64) << 62))
}

impl Columns {
    /// Reads a frame's surfaces nearer than `far` metres; walls too where `walls` says so. Every `stride`-th pixel of a row is asked.
    pub fn read(&mut self, buffer: &GBuffer, eye: &Eye, far: f32, walls: bool) {
        self.list.clear();
        self.table.clear();
        self.table.resize(1 << 12, 0);
        for y in 0..eye.size[1] {
            // Columns of pixels are offset row by row, so that no narrow thing is missed by all.
            let mut last = (usize::MAX, [0; 2], 0.0f32);
            for x in ((y % 3)..eye.size[0]).step_by(3) {
                let pixel = y * eye.size[0] + x;
                let depth = buffer.depth_m[pixel];
                if !(depth > 0.0 && depth < far) {
                    continue;
                }
                let normal = Vec3::from(buffer.normal[pixel]);
                if !(0.8..1.2).contains(&normal.length_squared()) {
                    continue;
                }
                let Some(axis) = axis_of(normal).filter(|axis| walls || *axis == 2) else { continue };
                let offset = eye.at(x as f32 + 0.5, y as f32 + 0.5, depth);
                let cell = others(axis).map(|k| floor((eye.position[k] + f64::from(offset[k])) / CELL_M));
                if last.0 == axis && last.1 == cell && (last.2 - offset[axis]).abs() < 0.5 * APART_M {
                    continue;
                }
                last = (axis, cell, offset[axis]);
                self.add(axis, cell, Layer { height: offset[axis], normal, nearest: depth });
            }
        }
    }

    fn add(&mut self, axis: usize, cell: [i64; 2], layer: Layer) {
        if self.list.len() * 2 >= self.table.len() {
            self.grow();
        }
        let mask = self.table.len() - 1;
        let mut at = address(axis, cell) as usize & mask;
        loop {
            let entry = self.table[at];
            if entry == 0 {
                let mut layers = [Layer::default(); LAYERS];
                layers[0] = layer;
                self.list.push(Column { axis, cell, layers, count: 1, nearest: layer.nearest });
                self.table[at] = self.list.len() as u32;
                return;
            }
            let column = &mut self.list[entry as usize - 1];
            if column.axis == axis && column.cell == cell {
                column.nearest = column.nearest.min(layer.nearest);
                let known = column.layers[..column.count].iter_mut().find(|known| {
                    (known.height - layer.height).abs() < APART_M && known.normal.dot(layer.normal) > 0.3
                });
                if known.is_none() && column.count < LAYERS {
                    column.layers[column.count] = layer;
                    column.count += 1;
                }
                return;
            }
            at = (at + 1) & mask;
        }
    }

    fn grow(&mut self) {
        let size = self.table.len() * 2;
        self.table.clear();
        self.table.resize(size, 0);
        for (k, column) in self.list.iter().enumerate() {
            let mut at = address(column.axis, column.cell) as usize & (size - 1);
            while self.table[at] != 0 {
                at = (at + 1) & (size - 1);
            }
            self.table[at] = k as u32 + 1;
        }
    }

    /// Every hit of drops of one class no older than `life_s`, on surfaces nearer than `far`.
    pub fn hits(&self, frame: &WetFrame<'_>, eye: &Eye, class: &Class<'_>, mut each: impl FnMut(&Hit)) {
        let slot_now = floor(frame.time_s / class.life_s);
        for column in self.list.iter().filter(|column| column.nearest < class.far_m) {
            let most = class.fall.most(class.drop, column.axis);
            let mean = class.drop.impacts_per_m2_s * most * CELL_M * CELL_M * class.life_s;
            for slot in [slot_now - 1, slot_now] {
                let seeds = [frame.seed, class.stream, column.axis as u64, slot as u64];
                let cell = column.cell.map(|k| k as u64);
                let mut random =
                    Random::from_parts(&[seeds[0], seeds[1], seeds[2], cell[0], cell[1], seeds[3]]);
                for _ in 0..random.poisson(mean) {
                    let own = Random::new(random.bits());
                    column.hit(frame, eye, class, most, slot, own, &mut each);
                }
            }
        }
    }
}

/// Drops of one size, and how far away their hits are asked for.
pub(crate) struct Class<'a> {
    pub drop: &'a DropFlux,
    pub stream: u64,
    pub life_s: f64,
    pub far_m: f32,
    pub fall: &'a Fall<'a>,
}

fn floor(value: f64) -> i64 {
    libm::floor(value) as i64
}

impl Column {
    /// One drop of a stream: met by each surface of the column that is there.
    #[allow(clippy::too_many_arguments, reason = "what a stream says of one drop")]
    fn hit(
        &self,
        frame: &WetFrame<'_>,
        eye: &Eye,
        class: &Class<'_>,
        most: f64,
        slot: i64,
        mut random: Random,
        each: &mut impl FnMut(&Hit),
    ) {
        let at = self.cell.map(|k| (k as f64 + random.unit()) * CELL_M);
        let age_s = frame.time_s - (slot as f64 + random.unit()) * class.life_s;
        let chance = random.unit() * most;
        if !(0.0..class.life_s).contains(&age_s) {
            return;
        }
        let mut met = [f32::NAN; LAYERS];
        for (k, layer) in self.layers[..self.count].iter().enumerate() {
            let Some((offset, normal, spot, pixel)) = self.settle(frame.buffer, eye, at, layer) else {
                continue;
            };
            let height = offset[self.axis];
            if met[..k].iter().any(|other| (other - height).abs() < 0.02) {
                continue;
            }
            met[k] = height;
            let mut gain = class.fall.gain(class.drop, normal, self.axis);
            if let (Some(pixel), Some(mask)) = (pixel, &frame.buffer.wettable) {
                gain *= f64::from(mask[pixel].clamp(0.0, 1.0));
            }
            if chance >= gain {
                continue;
            }
            let place = eye.position + offset.as_dvec3();
            if !class.fall.sheltered(place, class.drop.speed_m_per_s) {
                each(&Hit { place, offset, normal, spot, age_s, random: random.clone() });
            }
        }
    }

    /// Where the line along the axis through a place of the cell meets the surface near a layer, by the frame's own depth.
    fn settle(
        &self,
        buffer: &GBuffer,
        eye: &Eye,
        at: [f64; 2],
        layer: &Layer,
    ) -> Option<(Vec3, Vec3, Spot, Option<usize>)> {
        let [a, b] = others(self.axis);
        let mut offset = Vec3::ZERO;
        offset[a] = (at[0] - eye.position[a]) as f32;
        offset[b] = (at[1] - eye.position[b]) as f32;
        offset[self.axis] = layer.height;
        let mut normal = layer.normal;
        let mut spot = eye.see(offset)?;
        for _ in 0..4 {
            let Some(pixel) = eye.pixel(&spot) else {
                // Beyond the picture's edge the column's own surface goes on.
                return Some((offset, normal, spot, None));
            };
            let depth = buffer.depth_m[pixel];
            let here = Vec3::from(buffer.normal[pixel]);
            let known = depth > 0.0 && depth.is_finite() && (0.8..1.2).contains(&here.length_squared());
            if !known {
                return None;
            }
            let side = [pixel % eye.size[0], pixel / eye.size[0]].map(|n| n as f32 + 0.5);
            let seen = eye.at(side[0], side[1], depth);
            if axis_of(here) != Some(self.axis) {
                return None;
            }
            normal = here;
            let gap = (seen - offset).dot(here);
            offset[self.axis] += gap / here[self.axis];
            spot = eye.see(offset)?;
            let close = OFF_M.min(0.3 / eye.pixels_per_metre(depth));
            if gap.abs() < close * 0.1 {
                let away = (seen - offset).dot(eye.forward).abs();
                let steep = here.dot(eye.towards(seen)).abs().max(0.02);
                let allowed = OFF_M + OFF_PX / (eye.pixels_per_metre(depth) * steep);
                return (away < allowed).then_some((offset, normal, spot, Some(pixel)));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::highest;

    #[test]
    fn the_highest_of_a_map_is_found_wherever_it_lies_and_holes_are_none() {
        for place in 0..53 {
            let mut values = vec![f32::NAN; 53];
            values[place] = 3.0;
            values[(place + 20) % 53] = -7.0;
            assert_eq!(highest(&values), 3.0);
        }
        assert_eq!(highest(&[]), f32::NEG_INFINITY);
    }
}
