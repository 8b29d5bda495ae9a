//! Halos over a picture, tile by tile: strips of 32 × 32 pixels, cut in four where they are not even, down to 8 × 8.
//!
//! Corners can't tell what stands between them. A tile that a light stands in or close beside is cut, and at last that light is worked
//! out pixel by pixel; those farther away lie between the corners even there.

use super::{DEEPEST, Halos, Shape};
use crate::camera::{Camera, Ray};
use crate::parallel::prelude::*;
use crate::picture::Picture;
use crate::shade::adaptive::Spacing;
use glam::Vec2;

/// Edges of the largest tile and of the smallest that is ever asked for, px.
const LARGEST: usize = 32;
const SMALLEST: usize = 8;
/// Most nodes of a tile along its depth.
pub(super) const MOST_DEPTHS: usize = 10;
/// Tolerance from which on a picture is a preview: halos are then told from fewer places.
const COARSE: f32 = 0.1;

/// How finely halos are looked at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fineness {
    /// Edge of the smallest tile, px.
    smallest: usize,
    /// Share by which a halo may differ from what lies between a tile's corners, and share of the tile's darkest light that shows no
    /// difference.
    even: f32,
    unseen: f32,
    /// Distance from a tile's middle, in edges of the tile, from which on a light leaves it even as far as corners can tell.
    aside: f32,
    /// Places between the corners that are compared.
    checks: usize,
    /// Logarithm of the ratio of depths between which light counts as growing evenly.
    depth_step: f32,
    /// A light that adds less than this share of a pixel leaves no halo there.
    pub least: f32,
    /// Pieces of a ray whose ends are asked whether walls stand before a lamp.
    pub pieces: usize,
}

impl From<Spacing> for Fineness {
    fn from(Spacing { pixels, tolerance }: Spacing) -> Self {
        let is_coarse = tolerance >= COARSE;
        Self {
            smallest: (pixels as usize).clamp(SMALLEST, LARGEST),
            even: tolerance,
            unseen: tolerance / 40.0,
            aside: if is_coarse { 1.2 } else { 1.5 },
            checks: if is_coarse { 1 } else { CHECKS.len() },
            depth_step: if is_coarse { 0.8 } else { 0.4 },
            least: if is_coarse { 1e-3 } else { 1e-4 },
            pieces: if is_coarse { 5 } else { 10 },
        }
    }
}

/// Adds the halos to a picture whose things stand `metres` away.
pub(super) fn draw(halos: &Halos<'_>, camera: &Camera, metres: &[f32], picture: &mut Picture) {
    let width = picture.width;
    let secants = camera.secants();
    let places: Vec<[Vec2; 2]> = halos.lights.iter().map(|light| place(&light.shape, camera)).collect();
    let rows = picture.pixels.par_chunks_mut(width * LARGEST).zip(metres.par_chunks(width * LARGEST));
    rows.enumerate().for_each(|(number, (pixels, metres))| {
        let top = number * LARGEST;
        let ray = |x: f64, y: f64| camera.ray_with(&secants, x, top as f64 + y);
        let height = pixels.len() / width;
        let mut strip = Strip { halos, places: &places, ray: &ray, top, width, pixels, metres };
        for left in (0..width).step_by(LARGEST) {
            strip.tile(Tile { left, top: 0, right: (left + LARGEST).min(width), bottom: height });
        }
    });
}

/// Where a light stands in the picture, from one end to the other, px; far outside where it stands behind the camera.
fn place(shape: &Shape, camera: &Camera) -> [Vec2; 2] {
    let ends = match *shape {
        Shape::Lamp(place, _) | Shape::Ball(place, _) => [place; 2],
        Shape::Line(ends) => ends,
    };
    let places = ends.map(|end| camera.project(end).map(|place| place.pixel.as_vec2()));
    match places {
        [Some(from), Some(to)] => [from, to],
        [Some(one), None] | [None, Some(one)] => [one; 2],
        [None, None] => [Vec2::splat(-1e9); 2],
    }
}

/// Some rows of a picture.
struct Strip<'a> {
    halos: &'a Halos<'a>,
    places: &'a [[Vec2; 2]],
    /// The ray through a place of the picture, y from the strip's top.
    ray: &'a (dyn Fn(f64, f64) -> Ray + Sync),
    /// First row in the picture.
    top: usize,
    width: usize,
    pixels: &'a mut [[f32; 3]],
    metres: &'a [f32],
}

/// A rectangle of a strip.
#[derive(Clone, Copy)]
struct Tile {
    left: usize,
    top: usize,
    right: usize,
    bottom: usize,
}

impl Tile {
    /// Its four quarters; of one that is narrow or low some are empty.
    fn quarters(self) -> [Self; 4] {
        let half = |low: usize, high: usize| low + (high - low).next_power_of_two().max(2 * SMALLEST) / 2;
        let (x, y) =
            (half(self.left, self.right).min(self.right), half(self.top, self.bottom).min(self.bottom));
        [
            Self { right: x, bottom: y, ..self },
            Self { left: x, bottom: y, ..self },
            Self { right: x, top: y, ..self },
            Self { left: x, top: y, ..self },
        ]
    }

    fn edge(self) -> usize {
        (self.right - self.left).max(self.bottom - self.top)
    }

    /// Place at a share of its width and height, px.
    fn at(self, [u, v]: [f64; 2]) -> [f64; 2] {
        let between = |low: usize, high: usize, share: f64| low as f64 + share * (high - low) as f64;
        [between(self.left, self.right, u), between(self.top, self.bottom, v)]
    }
}

const CORNERS: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
/// Where light between the corners is compared: in the middle, and in the middle of each side.
const CHECKS: [[f64; 2]; 5] = [[0.5, 0.5], [0.5, 0.0], [0.0, 0.5], [1.0, 0.5], [0.5, 1.0]];

/// Lights of a tile at its corners and at some depths.
struct Nodes {
    depths: Depths,
    lights: Vec<[[f32; 3]; 4]>,
}

impl Strip<'_> {
    fn tile(&mut self, tile: Tile) {
        if tile.left >= tile.right || tile.top >= tile.bottom {
            return;
        }
        let beside = self.lights_beside(tile);
        let is_small = tile.edge() <= self.halos.fineness.smallest;
        if beside.is_empty() || is_small {
            let others = (0..self.places.len()).filter(|number| beside.binary_search(number).is_err());
            let others: Vec<usize> = others.collect();
            match self.nodes(tile, &others) {
                Some(nodes) => return self.fill(tile, &nodes, &beside),
                None if is_small => return self.each(tile),
                None => {}
            }
        }
        tile.quarters().into_iter().for_each(|quarter| self.tile(quarter));
    }

    /// Numbers of the lights that stand in a tile or close beside it, rising.
    fn lights_beside(&self, tile: Tile) -> Vec<usize> {
        let [x, y] = tile.at([0.5; 2]);
        let middle = Vec2::new(x as f32, (self.top as f64 + y) as f32);
        let reach = self.halos.fineness.aside * tile.edge() as f32;
        let is_beside = |[from, to]: [Vec2; 2]| {
            let way = to - from;
            let along = ((middle - from).dot(way) / way.length_squared().max(1e-12)).clamp(0.0, 1.0);
            (from + way * along).distance_squared(middle) < reach * reach
        };
        (0..self.places.len()).filter(|&number| is_beside(self.places[number])).collect()
    }

    /// Nearest and farthest end of a tile's rays, and its darkest light.
    fn extremes(&self, tile: Tile) -> (f32, f32, [f32; 3]) {
        let (mut near, mut far, mut darkest) = (f32::INFINITY, 0.0f32, [f32::INFINITY; 3]);
        for y in tile.top..tile.bottom {
            for at in y * self.width + tile.left..y * self.width + tile.right {
                let metres = self.ends(self.metres[at]);
                (near, far) = (near.min(metres), far.max(metres));
                (0..3).for_each(|band| darkest[band] = darkest[band].min(self.pixels[at][band]));
            }
        }
        (0..3).for_each(|band| darkest[band] = darkest[band].max(self.halos.behind[band]));
        (near, far, darkest)
    }

    /// What some lights show at a tile's corners, where that tells what they show between.
    fn nodes(&self, tile: Tile, lights: &[usize]) -> Option<Nodes> {
        let (near, far, darkest) = self.extremes(tile);
        let fineness = &self.halos.fineness;
        let depths = Depths::between((near, far), fineness.depth_step)?;
        let mut ends = [0.0; MOST_DEPTHS];
        ends.iter_mut().enumerate().for_each(|(i, end)| *end = f64::from(depths.node(i)));
        let ends = &ends[..depths.count];
        let farthest = ends[ends.len() - 1];
        let at = |share: [f64; 2], ends: &[f64], found: &mut [[f32; 3]]| {
            let ([x, y], lights) = (tile.at(share), lights.iter().copied());
            self.halos.add_radiance(lights, &(self.ray)(x, y), (ends, farthest), darkest, found);
        };
        let mut nodes = Nodes { lights: vec![[[0.0; 3]; 4]; depths.count], depths };
        for (corner, share) in CORNERS.into_iter().enumerate() {
            let mut found = [[0.0; 3]; MOST_DEPTHS];
            at(share, ends, &mut found);
            nodes.lights.iter_mut().zip(found).for_each(|(node, light)| node[corner] = light);
        }
        // At the depth midway between two nodes a mixture is farthest off.
        let end = nodes.depths.node_at(0.5 * (nodes.depths.count - 1) as f32);
        let is_even = |share: [f64; 2]| {
            let mut wanted = [[0.0; 3]];
            at(share, &[f64::from(end)], &mut wanted);
            let (found, [wanted]) = (nodes.mix(end, share.map(|v| v as f32)), wanted);
            (0..3).all(|band| {
                let allowed = fineness.even * wanted[band].abs() + fineness.unseen * darkest[band];
                (found[band] - wanted[band]).abs() <= allowed
            })
        };
        CHECKS.into_iter().take(fineness.checks).all(is_even).then_some(nodes)
    }

    /// Adds what lies between a tile's corners, and each pixel's own light of those `beside`.
    fn fill(&mut self, tile: Tile, nodes: &Nodes, beside: &[usize]) {
        let size = [tile.right - tile.left, tile.bottom - tile.top].map(|edge| edge as f32);
        for y in tile.top..tile.bottom {
            for x in tile.left..tile.right {
                let at = y * self.width + x;
                let share = [(x - tile.left) as f32 + 0.5, (y - tile.top) as f32 + 0.5];
                let share = [share[0] / size[0], share[1] / size[1]];
                let halo = nodes.mix(self.ends(self.metres[at]), share);
                let own = self.pixel(beside.iter().copied(), x, y);
                (0..3).for_each(|band| self.pixels[at][band] += halo[band] + own[band]);
            }
        }
    }

    /// Where a ray ends as far as halos tell: behind this optical depth nothing comes to the eye.
    fn ends(&self, metres: f32) -> f32 {
        metres.min(DEEPEST / self.halos.extinction as f32)
    }

    /// What some lights add to a pixel.
    fn pixel(&self, lights: impl ExactSizeIterator<Item = usize>, x: usize, y: usize) -> [f32; 3] {
        if lights.len() == 0 {
            return [0.0; 3];
        }
        let at = y * self.width + x;
        let ray = (self.ray)(x as f64 + 0.5, y as f64 + 0.5);
        let behind = self.halos.behind;
        let pixel = std::array::from_fn(|band| self.pixels[at][band].max(behind[band]));
        self.halos.radiance_of(lights, &ray, f64::from(self.metres[at]), pixel)
    }

    /// Adds the halo of every pixel of a tile.
    fn each(&mut self, tile: Tile) {
        for y in tile.top..tile.bottom {
            for x in tile.left..tile.right {
                let halo = self.pixel(0..self.places.len(), x, y);
                (0..3).for_each(|band| self.pixels[y * self.width + x][band] += halo[band]);
            }
        }
    }
}

/// Depths of a tile's things, and nodes between them at equal ratios.
struct Depths {
    near: f32,
    /// Logarithm of the ratio of one node to the one before.
    step: f32,
    count: usize,
}

impl Depths {
    /// Nodes from `near` to `far`; none where they would be so many that each pixel by itself is cheaper.
    fn between((near, far): (f32, f32), depth_step: f32) -> Option<Self> {
        // What stands at the lens has no ratio to anything.
        let near = near.max(f32::MIN_POSITIVE);
        let span = libm::logf(far.max(near) / near);
        let count = 1 + libm::ceilf(span / depth_step) as usize;
        let step = if count > 1 { span / (count - 1) as f32 } else { 0.0 };
        (count <= MOST_DEPTHS).then_some(Self { near, step, count })
    }

    fn node(&self, i: usize) -> f32 {
        self.node_at(i as f32)
    }

    fn node_at(&self, place: f32) -> f32 {
        self.near * libm::expf(self.step * place)
    }
}

impl Nodes {
    /// Light at a depth and a share of the tile's width and height, of what its corners have at each node.
    fn mix(&self, metres: f32, [u, v]: [f32; 2]) -> [f32; 3] {
        let corners = |nodes: &[[f32; 3]; 4], band: usize| {
            let [a, b, c, d] = nodes.map(|corner| corner[band]);
            let (top, bottom) = (a + u * (b - a), c + u * (d - c));
            top + v * (bottom - top)
        };
        let Self { depths, lights } = self;
        if depths.count == 1 {
            return std::array::from_fn(|band| corners(&lights[0], band));
        }
        let i = ((libm::logf((metres / depths.near).max(1.0)) / depths.step) as usize).min(depths.count - 2);
        // Light grows with the ray's length and not with its logarithm.
        let [from, to] = [depths.node(i), depths.node(i + 1)];
        let share = ((metres - from) / (to - from)).clamp(0.0, 1.0);
        std::array::from_fn(|band| {
            let near = corners(&lights[i], band);
            near + share * (corners(&lights[i + 1], band) - near)
        })
    }
}
