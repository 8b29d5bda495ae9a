//! What a ball of water shows: the world through it, upside down, and mirrored in it, by exact Fresnel.
//!
//! A ray that meets a ball with direction d enters along t and leaves along e = 2 (d·t) t − d: it is bent as much on its way out as on its way
//! in. So a drop shows some 165° of the world. What it shows depends on the normal where the ray meets it, and hardly on where in a small part
//! of the picture the drop is: a table over the normal, a tile of the picture each, made when a drop first asks for it. Between tiles' middles drops show
//! the mean of the four around, by how near they are, so that nothing changes at a tile's border.

use super::eye::Eye;
use super::light::Surroundings;
use crate::wet::material::{WATER_INDEX, fresnel};
use glam::{Vec2, Vec3};

/// Tiles across and down a picture.
const TILES: [usize; 2] = [16, 12];
/// Entries along an axis of the finest level; each further level has half as many.
const SIDE: usize = 16;
/// Levels: 16, 8, 4, 2, 1 entries along an axis.
pub(crate) const LEVELS: usize = 5;
const ENTRIES: usize = 256 + 64 + 16 + 4 + 1;

/// Direction of a ray through a ball, and the share of its light that comes through, from the ray's unit direction and the unit normal where it
/// meets the ball.
pub fn through_ball(direction: Vec3, normal: Vec3) -> (Vec3, f32) {
    let cosine = (-direction.dot(normal)).clamp(0.0, 1.0);
    let ratio = 1.0 / WATER_INDEX as f32;
    let inside = (1.0 - ratio * ratio * (1.0 - cosine * cosine)).sqrt();
    let within = direction * ratio + normal * (ratio * cosine - inside);
    let kept = 1.0 - fresnel(f64::from(cosine), WATER_INDEX) as f32;
    (2.0 * direction.dot(within) * within - direction, kept * kept)
}

/// The paper's way: one refraction, from air to water, and no way out.
pub fn paper_through(direction: Vec3, normal: Vec3) -> Vec3 {
    let cosine = (-direction.dot(normal)).clamp(0.0, 1.0);
    let ratio = 1.0 / WATER_INDEX as f32;
    let inside = (1.0 - ratio * ratio * (1.0 - cosine * cosine)).sqrt();
    direction * ratio + normal * (ratio * cosine - inside)
}

/// [`paper_through`], and the share of light that comes through the one surface.
fn once(direction: Vec3, normal: Vec3) -> (Vec3, f32) {
    let kept = 1.0 - fresnel(f64::from((-direction.dot(normal)).clamp(0.0, 1.0)), WATER_INDEX) as f32;
    (paper_through(direction, normal), kept)
}

/// What drops show, a tile of the picture each. Its memory is kept.
#[derive(Clone, Debug, Default)]
pub(crate) struct BallMap {
    /// Where a tile's table lies in `tables`; [`NONE`] where no drop has asked for it.
    tiles: Vec<usize>,
    tables: Vec<Table>,
    /// Tables of this frame.
    used: usize,
    paper: bool,
}

/// A tile without a table.
const NONE: usize = usize::MAX;

/// Radiance by the normal, level after level.
type Table = [Vec3; ENTRIES];

/// What drops at one place of the picture show, by the normal: the tables of four tiles, and how much each counts.
#[derive(Clone, Copy)]
pub(crate) struct Ball<'a> {
    tables: [(f32, &'a Table); 4],
}

impl BallMap {
    /// Forgets the last frame; `paper` says that rays are bent as the paper prints it.
    pub fn clear(&mut self, paper: bool) {
        self.paper = paper;
        self.tiles.clear();
        self.tiles.resize(TILES[0] * TILES[1], NONE);
        self.used = 0;
    }

    /// What drops at pixel coordinates show.
    pub fn at(&mut self, eye: &Eye, world: &Surroundings<'_>, x: f32, y: f32) -> Ball<'_> {
        let (left, u) = between(x, eye.size[0], TILES[0]);
        let (top, v) = between(y, eye.size[1], TILES[1]);
        let first = top * TILES[0] + left;
        let around = [first, first + 1, first + TILES[0], first + TILES[0] + 1];
        let places = around.map(|index| self.table(index, eye, world));
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        Ball { tables: std::array::from_fn(|k| (weights[k], &self.tables[places[k]])) }
    }

    /// Where the table of a tile lies; it is made when it is first asked for.
    fn table(&mut self, index: usize, eye: &Eye, world: &Surroundings<'_>) -> usize {
        if self.tiles[index] == NONE {
            let [column, row] = [index % TILES[0], index / TILES[0]];
            let middle =
                |k: usize, axis: usize| (k as f32 + 0.5) / TILES[axis] as f32 * eye.size[axis] as f32;
            let table = fill(eye, world, eye.direction(middle(column, 0), middle(row, 1)), self.paper);
            match self.tables.get_mut(self.used) {
                Some(old) => *old = table,
                None => self.tables.push(table),
            }
            self.tiles[index] = self.used;
            self.used += 1;
        }
        self.tiles[index]
    }
}

/// The tile whose middle lies before a coordinate, of all but the last, and how far the coordinate is on its way to the next one's.
fn between(at: f32, size: usize, tiles: usize) -> (usize, f32) {
    let place = (at / size as f32 * tiles as f32 - 0.5).max(0.0).min((tiles - 1) as f32);
    let low = (place as usize).min(tiles - 2);
    (low, place - low as f32)
}

/// Axes across a view: to its right, and up.
pub(crate) fn across(eye: &Eye, direction: Vec3) -> [Vec3; 2] {
    let right = direction.cross(eye.up).normalize_or(eye.right);
    [right, right.cross(direction)]
}

fn fill(eye: &Eye, world: &Surroundings<'_>, direction: Vec3, paper: bool) -> Table {
    let [right, up] = across(eye, direction);
    let mut entries = [Vec3::ZERO; ENTRIES];
    let mut weights = [0.0f32; SIDE * SIDE];
    for (k, (entry, weight)) in entries[..SIDE * SIDE].iter_mut().zip(&mut weights).enumerate() {
        let place = |k: usize| (2 * k + 1) as f32 / SIDE as f32 - 1.0;
        let flat = Vec2::new(place(k % SIDE), place(k / SIDE));
        // Corners beyond the disc repeat its rim, so that what is between the two is the rim's.
        *weight = if flat.length_squared() < 1.0 { 1.0 } else { 1e-3 };
        let flat = flat.clamp_length_max(0.995);
        let normal = right * flat.x + up * flat.y - direction * (1.0 - flat.length_squared()).sqrt();
        let (exit, kept) = if paper { once(direction, normal) } else { through_ball(direction, normal) };
        let mirror = direction - 2.0 * direction.dot(normal) * normal;
        let share = fresnel(f64::from(-direction.dot(normal)), WATER_INDEX) as f32;
        *entry = kept * world.radiance(exit) + share * world.radiance(mirror);
    }
    let (mut from, mut side) = (0, SIDE);
    let mut weights = weights.to_vec();
    while side > 1 {
        let half = side / 2;
        let mut coarser = vec![0.0; half * half];
        for k in 0..half * half {
            let corner = (k / half) * 2 * side + (k % half) * 2;
            let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
            for at in [corner, corner + 1, corner + side, corner + side + 1] {
                sum += weights[at] * entries[from + at];
                weight += weights[at];
            }
            entries[from + side * side + k] = sum / weight;
            coarser[k] = weight;
        }
        weights = coarser;
        from += side * side;
        side = half;
    }
    entries
}

impl Ball<'_> {
    /// Radiance where the normal leans by `flat` (right and up, length at most 1), blurred by `level` of [`LEVELS`]; between entries and levels.
    pub fn radiance(&self, flat: Vec2, level: f32) -> Vec3 {
        let level = level.clamp(0.0, (LEVELS - 1) as f32);
        let fine = level as usize;
        let share = level - fine as f32;
        let here = self.level(flat, fine);
        if share > 0.02 { here.lerp(self.level(flat, fine + 1), share) } else { here }
    }

    /// Mean over the drop's disc.
    pub fn mean(&self) -> Vec3 {
        self.tables.iter().map(|(weight, entries)| *weight * entries[ENTRIES - 1]).sum()
    }

    fn level(&self, flat: Vec2, level: usize) -> Vec3 {
        const BEGIN: [usize; LEVELS] = [0, 256, 320, 336, 340];
        let side = SIDE >> level;
        if side == 1 {
            return self.mean();
        }
        let most = (side - 1) as f32;
        let x = ((flat.x * 0.5 + 0.5) * side as f32 - 0.5).clamp(0.0, most);
        let y = ((flat.y * 0.5 + 0.5) * side as f32 - 0.5).clamp(0.0, most);
        let (column, row) = ((x as usize).min(side - 2), (y as usize).min(side - 2));
        let (u, v) = (x - column as f32, y - row as f32);
        let corner = BEGIN[level] + row * side + column;
        let shares = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        let corners = [corner, corner + 1, corner + side, corner + side + 1];
        let mut sum = Vec3::ZERO;
        for (weight, entries) in &self.tables {
            for k in 0..4 {
                sum += *weight * shares[k] * entries[corners[k]];
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wet::drop::eye::Spot;
    use crate::wet::drop::light::{LightControls, LightMemory};
    use crate::wet::drop::stage::Stage;
    use glam::DVec3;

    /// Single precision through a few square roots.
    const ROUND_OFF: f32 = 1e-5;

    #[test]
    fn a_ball_bends_light_by_twice_the_difference_of_its_angles() {
        let d = Vec3::Y;
        for x in [0.0f32, 0.2, 0.5, 0.9, 0.999] {
            let normal = Vec3::new(x, -(1.0 - x * x).sqrt(), 0.0);
            let (exit, kept) = through_ball(d, normal);
            let (outside, inside) = (libm::asinf(x), libm::asinf(x / WATER_INDEX as f32));
            // Towards the ball's axis, and away from the side that it came in on.
            let bent = libm::atan2f(-exit.x, exit.y);
            assert!((bent - 2.0 * (outside - inside)).abs() < 30.0 * ROUND_OFF, "{x} {bent}");
            assert!((exit.length() - 1.0).abs() < ROUND_OFF);
            let once = 1.0 - fresnel(f64::from((1.0 - x * x).sqrt()), WATER_INDEX) as f32;
            assert!((kept - once * once).abs() < ROUND_OFF);
        }
    }

    #[test]
    fn what_a_drop_shows_does_not_change_at_a_tiles_border() {
        /// A hundredth of a pixel, of light that grades over a picture.
        const STEP: f32 = 1e-3;
        let mut stage = Stage::new(DVec3::new(3.0, 0.0, 1.6), DVec3::new(3.0, 5.0, 1.6), [320, 240]);
        for (k, colour) in stage.buffer.colour.iter_mut().enumerate() {
            *colour = [0.2 + (k % 320) as f32 / 320.0, 0.2 + (k / 320) as f32 / 240.0, 0.3];
        }
        let (frame, eye, mut memory) = (stage.frame(0.0), Eye::new(&stage.camera), LightMemory::default());
        let controls = LightControls { flash: 0.0, lamp_height_m: 5.0, paper: false };
        let mut light = memory.prepare(&frame, &eye, &controls);
        let mut shown = |x: f32, y: f32| {
            let ball = light.ball(&Spot { x, y, depth: 2.0 });
            [Vec2::ZERO, Vec2::new(0.5, -0.3), Vec2::new(-0.7, 0.6)]
                .map(|flat| ball.radiance(flat, 0.7))
                .into_iter()
                .chain([ball.mean()])
                .collect::<Vec<_>>()
        };
        for k in 1..12 {
            let (x, y) = (20.0 * k as f32, 20.0 * k as f32);
            let sides = [shown(x - 0.005, y - 0.005), shown(x + 0.005, y + 0.005)];
            let step =
                sides[0].iter().zip(&sides[1]).map(|(one, other)| one.distance(*other)).fold(0.0, f32::max);
            assert!(step < STEP, "{k} {step}");
        }
        assert!(shown(10.0, 120.0)[3].distance(shown(310.0, 120.0)[3]) > 0.1, "there is something to tell");
    }

    #[test]
    fn the_papers_ray_stays_in_the_water() {
        let normal = Vec3::new(0.6, -0.8, 0.0);
        let within = paper_through(Vec3::Y, normal);
        let sine = within.cross(normal).length();
        assert!((sine - 0.6 / WATER_INDEX as f32).abs() < ROUND_OFF);
        // Half as far as light is bent that comes out again.
        let (exit, _) = through_ball(Vec3::Y, normal);
        let angle = |v: Vec3| libm::acosf(v.y.min(1.0));
        assert!((2.0 * angle(within) - angle(exit)).abs() < 30.0 * ROUND_OFF);
    }
}
