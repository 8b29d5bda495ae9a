//! Which shining triangles light a place: lists for the cells of a grid, drawn from by what each would give.

use glam::Vec3;
use squall_runtime::random::Random;
use squall_scene::light::{Shining, shining};
use squall_scene::{Ray, World};

/// Side of a cell, m.
const CELL_M: f32 = 2.0;
/// Triangles that a cell's list has at most.
const LISTED: usize = 96;
/// Share of draws that are from all triangles, whatever the cell's list says.
const ANY: f32 = 0.1;
/// Draws a place.
const DRAWS: u32 = 2;
/// Most cells along a side.
const MOST: f32 = 64.0;

/// A list to draw from: triangles and the sums of what they and those before give.
#[derive(Default)]
struct List {
    which: Vec<u32>,
    sums: Vec<f32>,
}

impl List {
    fn new(weights: impl Iterator<Item = (u32, f32)>) -> Self {
        let mut list = Self::default();
        let mut sum = 0.0;
        for (which, weight) in weights {
            sum += weight;
            list.which.push(which);
            list.sums.push(sum);
        }
        list
    }

    fn whole(&self) -> f32 {
        self.sums.last().copied().unwrap_or(0.0)
    }

    fn draw(&self, at: f32) -> Option<u32> {
        let wanted = at * self.whole();
        let place = self.sums.partition_point(|sum| *sum <= wanted).min(self.sums.len().checked_sub(1)?);
        Some(self.which[place])
    }

    fn share(&self, which: u32) -> f32 {
        let at = self.which.iter().position(|other| *other == which);
        at.map_or(0.0, |at| {
            let before = if at > 0 { self.sums[at - 1] } else { 0.0 };
            (self.sums[at] - before) / self.whole()
        })
    }
}

/// Shining triangles of a scene.
pub(super) struct Lights {
    all: Vec<Shining>,
    every: List,
    cells: Vec<List>,
    low: Vec3,
    cell: Vec3,
    size: [usize; 3],
}

fn power(one: &Shining) -> f32 {
    one.area * squall_scene::light::mean(one.radiance) * if one.two_sided { 2.0 } else { 1.0 }
}

impl Lights {
    pub(super) fn new(world: &World) -> Self {
        let all = shining(world);
        let every = List::new(all.iter().enumerate().map(|(at, one)| (at as u32, power(one))));
        let [low, high] = world.scene().bounds();
        let counts = ((high - low) / CELL_M).ceil().clamp(Vec3::ONE, Vec3::splat(MOST));
        let cell = ((high - low) / counts).max(Vec3::splat(1e-3));
        let size = counts.to_array().map(|count| count as usize);
        let cells = (0..size[0] * size[1] * size[2]).map(|at| {
            let index = [at % size[0], at / size[0] % size[1], at / (size[0] * size[1])];
            let middle = low + cell * (Vec3::from_array(index.map(|k| k as f32)) + 0.5);
            let mut given: Vec<(u32, f32)> = all
                .iter()
                .enumerate()
                .map(|(at, one)| {
                    let way = middle - (one.corners[0] + one.corners[1] + one.corners[2]) / 3.0;
                    // Nearer than a cell is as near as its corner.
                    let squared = way.length_squared().max(0.25 * cell.length_squared());
                    let facing = one.normal.dot(way) / way.length().max(1e-6);
                    let seen = if one.two_sided { facing.abs() } else { facing };
                    // A cell reaches to where a triangle that looks past its middle is seen.
                    (at as u32, power(one) * (seen + 0.6).clamp(0.0, 1.0) / squared)
                })
                .collect();
            given.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
            given.truncate(LISTED);
            List::new(given.into_iter())
        });
        let cells = cells.collect();
        Self { all, every, cells, low, cell, size }
    }

    /// Irradiance of a surface by shining triangles, from a few draws.
    pub(super) fn sampled(&self, world: &World, place: Vec3, normal: Vec3, random: &mut Random) -> [f32; 3] {
        let mut sum = [0.0; 3];
        if self.every.whole() <= 0.0 {
            return sum;
        }
        let at = ((place - self.low) / self.cell).to_array();
        let index: [usize; 3] =
            std::array::from_fn(|axis| (at[axis].max(0.0) as usize).min(self.size[axis] - 1));
        let cell = &self.cells[(index[2] * self.size[1] + index[1]) * self.size[0] + index[0]];
        let any = if cell.whole() > 0.0 { ANY } else { 1.0 };
        for draw in 0..DRAWS {
            let from = (draw as f32 + random.unit() as f32) / DRAWS as f32;
            let (u, v) = (random.unit() as f32, random.unit() as f32);
            let which =
                if from < any { self.every.draw(from / any) } else { cell.draw((from - any) / (1.0 - any)) };
            let Some(which) = which else { continue };
            let chance = any * self.every.share_at(which) + (1.0 - any) * cell.share(which);
            let one = &self.all[which as usize];
            // A point of the triangle, alike everywhere.
            let root = u.sqrt();
            let [a, b, c] = one.corners;
            let way = a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v) - place;
            let far = way.length();
            let towards = way / far;
            let facing = -one.normal.dot(towards);
            let facing = if one.two_sided { facing.abs() } else { facing };
            let cosine = normal.dot(towards);
            if cosine <= 0.0 || facing <= 0.0 || far < 1e-3 || chance <= 0.0 {
                continue;
            }
            if world.blocked(&Ray { origin: place, direction: towards }, far * 0.999 - 1e-3) {
                continue;
            }
            let factor = cosine * facing * one.area / (far * far) / (chance * DRAWS as f32);
            for band in 0..3 {
                sum[band] += factor * one.radiance[band];
            }
        }
        sum
    }
}

impl List {
    /// Share of an entry of a list that has all in order.
    fn share_at(&self, which: u32) -> f32 {
        let at = which as usize;
        let before = if at > 0 { self.sums[at - 1] } else { 0.0 };
        (self.sums[at] - before) / self.whole()
    }
}
