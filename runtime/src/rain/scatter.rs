//! Draws streaks: into bands of rows, band by band and tile by tile, so that a pixel is written by one thread
//! and sees its streaks in the order of the list.

use super::kernel::{Clip, Footprint, Kernel, Span};
use super::{RainLight, Shot, Streak, Workspace};
use crate::camera::{Camera, Secants};
use crate::depth::DepthBuffer;
use crate::error::RuntimeError;
use crate::parallel::prelude::*;
use crate::picture::Picture;
use std::any::Any;

/// Tile width and height, px: the accumulators of one tile fit a core's own cache, and a streak of a hundred
/// pixels crosses few of them.
const TILE: [usize; 2] = [32, 32];
/// Pixels that are worked on together, one vector register wide; drawn spans are padded to whole blocks.
const BLOCK: usize = 4;
/// A row of accumulators has room for a block that starts on its last pixel.
const STRIDE: usize = TILE[0] + BLOCK;
const PLANE: usize = STRIDE * TILE[1];
const LANES: [f32; BLOCK] = [0.0, 1.0, 2.0, 3.0];

/// What streaks are drawn with and into.
pub struct Scene<'a, K, L> {
    /// Depth of the scene; `None` is open sky.
    pub depth: Option<DepthBuffer<'a>>,
    /// How a streak lies on pixels.
    pub kernel: &'a K,
    /// What light drops send to the camera.
    pub light: &'a L,
    /// Times the physical coverage: 1 is what a drop covers.
    pub gain: f64,
}

/// Reusable memory for drawing.
#[derive(Debug, Default)]
pub(super) struct Canvas {
    radiance: Vec<[f32; 3]>,
    boxes: Vec<TileBox>,
    /// Where each tile's streaks start in `order`; one more than there are tiles.
    starts: Vec<u32>,
    order: Vec<u32>,
    bands: Vec<Band>,
    mask: Vec<f32>,
}

/// One band's accumulators, for a tile at a time.
#[derive(Debug)]
struct Band {
    /// Four planes: light of the streaks, three colours, and the share of background that they leave.
    layers: Vec<f32>,
    /// The kernel's working memory: whatever type the last kernel had.
    scratch: Box<dyn Any + Send + Sync>,
}

impl Default for Band {
    fn default() -> Self {
        Self { layers: vec![0.0; 4 * PLANE], scratch: Box::new(()) }
    }
}

/// First and last tile along x, then along y, of a streak's box; empty when first > last.
type TileBox = [u32; 4];
const NOWHERE: TileBox = [1, 0, 1, 0];

/// The tiles that a streak's kernel can touch.
fn tiles_of<K: Kernel>(kernel: &K, footprint: &Footprint, grid: [usize; 2]) -> TileBox {
    let Some(Clip { left, top, right, bottom }) = kernel.bounds(footprint) else { return NOWHERE };
    let mut tiles = NOWHERE;
    for (axis, (low, end)) in [(left, right), (top, bottom)].into_iter().enumerate() {
        let (first, last) = (low.max(0) / TILE[axis] as i32, end.saturating_sub(1) / TILE[axis] as i32);
        if end <= low || end <= 0 || first as usize >= grid[axis] {
            return NOWHERE;
        }
        tiles[2 * axis] = first as u32;
        tiles[2 * axis + 1] = (last as u32).min(grid[axis] as u32 - 1);
    }
    tiles
}

fn tiles_in([x0, x1, y0, y1]: TileBox, columns: usize) -> impl Iterator<Item = usize> {
    (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| y as usize * columns + x as usize))
}

impl Workspace {
    /// Coverage α of the last [`Workspace::draw`], in [0, 1], row 0 = top: the share of background that
    /// streaks hide.
    pub fn mask(&self) -> &[f32] {
        &self.canvas.mask
    }

    /// Draws the streaks of the last [`super::Rain::find`] over `picture` and into [`Workspace::mask`].
    ///
    /// Each streak lies over what is there with its coverage α and shows its own light in its place; where
    /// streaks overlap, later ones of the list lie over earlier ones. Pixels whose scene is nearer than the
    /// streak at that pixel stay as they are. `shot` is the one that was found.
    ///
    /// Errors: a picture or depth buffer of another size than the camera's, a gain that is negative or not
    /// finite.
    pub fn draw<K: Kernel, L: RainLight>(
        &mut self,
        shot: &Shot,
        scene: &Scene<K, L>,
        picture: &mut Picture,
    ) -> Result<(), RuntimeError> {
        let camera = shot.camera;
        let size = [camera.width as usize, camera.height as usize];
        if [picture.width, picture.height] != size || picture.pixels.len() != size[0] * size[1] {
            let found = format!("{} × {}", picture.width, picture.height);
            let wanted = format!("the camera's {} × {}", size[0], size[1]);
            return Err(RuntimeError::argument("picture", wanted, found));
        }
        if let Some(depth) = &scene.depth {
            depth.check_size(size[0], size[1])?;
        }
        if !(scene.gain >= 0.0 && scene.gain.is_finite()) {
            return Err(RuntimeError::argument("gain", "a finite number from 0", scene.gain));
        }
        let grid = [size[0].div_ceil(TILE[0]), size[1].div_ceil(TILE[1])];
        self.canvas.prepare(camera, scene, &self.streaks, grid);
        self.canvas.sort_into_tiles(grid);
        self.canvas.bands.resize_with(grid[1].max(self.canvas.bands.len()), Band::default);
        self.canvas.mask.resize(size[0] * size[1], 0.0);

        let Canvas { radiance, starts, order, bands, mask, .. } = &mut self.canvas;
        let list = TileList { streaks: &self.streaks, radiance, starts, order };
        let rows = size[0] * TILE[1];
        let secants = camera.secants();
        let paint = |(index, ((band, pixels), mask)): Job| {
            let Band { layers, scratch } = band;
            if !scratch.is::<K::Scratch>() {
                *scratch = Box::new(K::Scratch::default());
            }
            let Some(scratch) = scratch.downcast_mut::<K::Scratch>() else { return };
            let mut brush = Brush { layers, scratch, secants: &secants, scene };
            for column in 0..grid[0] {
                let tile = TilePlace {
                    x: column * TILE[0],
                    y: index * TILE[1],
                    width: TILE[0].min(size[0] - column * TILE[0]),
                    height: pixels.len() / size[0],
                };
                let mine = list.of(index * grid[0] + column);
                brush.paint_tile(&list, mine, tile);
                brush.apply(tile, size[0], pixels, mask);
            }
        };
        let pixels = picture.pixels.par_chunks_mut(rows);
        bands.par_iter_mut().zip(pixels).zip(mask.par_chunks_mut(rows)).enumerate().for_each(paint);
        Ok(())
    }
}

/// A band's number, its accumulators, its pixels and its part of the mask.
type Job<'a> = (usize, ((&'a mut Band, &'a mut [[f32; 3]]), &'a mut [f32]));

#[derive(Clone, Copy)]
struct TilePlace {
    x: usize,
    y: usize,
    width: usize,
    height: usize,
}

impl TilePlace {
    fn clip(self) -> Clip {
        // Pictures have at most 2²⁸ pixels.
        let [left, top] = [self.x as i32, self.y as i32];
        Clip { left, top, right: left + self.width as i32, bottom: top + self.height as i32 }
    }
}

/// Streaks with their light, and who is in which tile.
struct TileList<'a> {
    streaks: &'a [Streak],
    radiance: &'a [[f32; 3]],
    starts: &'a [u32],
    order: &'a [u32],
}

impl<'a> TileList<'a> {
    fn of(&self, tile: usize) -> &'a [u32] {
        &self.order[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }
}

impl Canvas {
    pub(super) fn bytes(&self) -> usize {
        self.radiance.capacity() * size_of::<[f32; 3]>()
            + self.boxes.capacity() * size_of::<TileBox>()
            + (self.starts.capacity() + self.order.capacity() + self.mask.capacity()) * 4
            + self.bands.capacity() * (size_of::<Band>() + 4 * PLANE * size_of::<f32>())
    }

    /// Each streak's light and tiles.
    fn prepare<K: Kernel, L: RainLight>(
        &mut self,
        camera: &Camera,
        scene: &Scene<K, L>,
        streaks: &[Streak],
        grid: [usize; 2],
    ) {
        self.radiance.resize(streaks.len(), [0.0; 3]);
        self.boxes.resize(streaks.len(), NOWHERE);
        let secants = camera.secants();
        let prepare = |((radiance, tiles), streak): ((&mut [f32; 3], &mut TileBox), &Streak)| {
            let footprint = streak.footprint();
            let ray = camera.ray_with(&secants, footprint.centre[0], footprint.centre[1]);
            let distance = f64::from(streak.depth) / ray.direction.dot(camera.forward);
            *radiance = scene.light.radiance(&ray, distance);
            *tiles = tiles_of(scene.kernel, &footprint, grid);
        };
        let out = self.radiance.par_iter_mut().zip(&mut self.boxes);
        out.zip(streaks).for_each(prepare);
    }

    /// Counting sort: streaks into tiles, in the order of the list within each tile.
    fn sort_into_tiles(&mut self, grid: [usize; 2]) {
        let tiles = grid[0] * grid[1];
        self.starts.clear();
        self.starts.resize(tiles + 1, 0);
        for &tile_box in &self.boxes {
            for tile in tiles_in(tile_box, grid[0]) {
                self.starts[tile + 1] += 1;
            }
        }
        for tile in 1..=tiles {
            self.starts[tile] += self.starts[tile - 1];
        }
        self.order.clear();
        self.order.resize(self.starts[tiles] as usize, 0);
        for (index, &tile_box) in self.boxes.iter().enumerate() {
            for tile in tiles_in(tile_box, grid[0]) {
                let place = &mut self.starts[tile];
                self.order[*place as usize] = index as u32;
                *place += 1;
            }
        }
        // Each start has moved to the next tile's; move them back.
        self.starts.copy_within(0..tiles, 1);
        self.starts[0] = 0;
    }
}

/// What paints one band, tile by tile.
struct Brush<'a, K: Kernel, L> {
    layers: &'a mut Vec<f32>,
    scratch: &'a mut K::Scratch,
    secants: &'a Secants,
    scene: &'a Scene<'a, K, L>,
}

impl<K: Kernel, L> Brush<'_, K, L> {
    fn paint_tile(&mut self, list: &TileList, mine: &[u32], tile: TilePlace) {
        let Self { layers, scratch, secants, scene } = self;
        let (light, kept) = layers.split_at_mut(3 * PLANE);
        light.fill(0.0);
        kept.fill(1.0);
        let clip = tile.clip();
        for &index in mine {
            let streak = &list.streaks[index as usize];
            let radiance = list.radiance[index as usize];
            let footprint = streak.footprint();
            let strength = (f64::from(streak.coverage) * scene.gain) as f32;
            let layers = layers.as_mut_slice();
            let at = |span: &Span| (span.y - clip.top) as usize * STRIDE + (span.x - clip.left) as usize;
            match &scene.depth {
                None => scene.kernel.draw(&footprint, clip, scratch, &mut |span| {
                    lay(layers, at(&span), span.count, span.shares, strength, radiance);
                }),
                Some(buffer) => {
                    let line = DepthLine::new(streak, &footprint);
                    scene.kernel.draw(&footprint, clip, scratch, &mut |span| {
                        let mut seen = [0.0; TILE[0]];
                        for (i, (seen, &share)) in
                            seen.iter_mut().zip(span.shares).take(span.count).enumerate()
                        {
                            let (x, y) = (span.x as usize + i, span.y as usize);
                            if share > 0.0 && !line.hidden(secants, buffer, x, y) {
                                *seen = share;
                            }
                        }
                        lay(layers, at(&span), span.count, &seen, strength, radiance);
                    });
                }
            }
        }
    }

    /// Puts the finished tile over the picture and into the mask.
    fn apply(&self, tile: TilePlace, width: usize, pixels: &mut [[f32; 3]], mask: &mut [f32]) {
        for row in 0..tile.height {
            let from = row * width + tile.x;
            for column in 0..tile.width {
                let at = row * STRIDE + column;
                let kept = self.layers[3 * PLANE + at];
                mask[from + column] = 1.0 - kept;
                // Where nothing was drawn the pixel stays as it is, infinite or not.
                if kept < 1.0 {
                    let pixel = &mut pixels[from + column];
                    for colour in 0..3 {
                        pixel[colour] = pixel[colour] * kept + self.layers[colour * PLANE + at];
                    }
                }
            }
        }
    }
}

/// Lays the first `count` shares of a span over the accumulators from place `from` on.
///
/// Most spans are one block. Longer ones go elsewhere, so that the compiler does not set up a loop over many
/// blocks for each of them.
#[inline(always)]
fn lay(layers: &mut [f32], from: usize, count: usize, shares: &[f32], strength: f32, radiance: [f32; 3]) {
    lay_block(layers, from, count, shares, strength, radiance);
    if count > BLOCK {
        lay_more(layers, from, count, shares, strength, radiance);
    }
}

#[inline(never)]
fn lay_more(
    layers: &mut [f32],
    from: usize,
    count: usize,
    shares: &[f32],
    strength: f32,
    radiance: [f32; 3],
) {
    for start in (BLOCK..count).step_by(BLOCK) {
        let rest = shares.get(start..).unwrap_or_default();
        lay_block(layers, from + start, count - start, rest, strength, radiance);
    }
}

#[inline(always)]
fn lay_block(
    layers: &mut [f32],
    from: usize,
    count: usize,
    shares: &[f32],
    strength: f32,
    radiance: [f32; 3],
) {
    let layers = layers.get_mut(from..).and_then(<[f32]>::first_chunk_mut::<{ 3 * PLANE + BLOCK }>);
    let (Some(shares), Some(layers)) = (shares.first_chunk::<BLOCK>(), layers) else { return };
    let left = count as u32 as f32;
    let mut alpha = [0.0; BLOCK];
    for lane in 0..BLOCK {
        // A kernel's NaN fails the comparison and draws nothing; so does what pads the block.
        let value = strength * shares[lane];
        let value = if value > 0.0 { value } else { 0.0 };
        let value = if value < 1.0 { value } else { 1.0 };
        alpha[lane] = if LANES[lane] < left { value } else { 0.0 };
    }
    for lane in 0..BLOCK {
        let keep = 1.0 - alpha[lane];
        layers[lane] = layers[lane] * keep + alpha[lane] * radiance[0];
        layers[PLANE + lane] = layers[PLANE + lane] * keep + alpha[lane] * radiance[1];
        layers[2 * PLANE + lane] = layers[2 * PLANE + lane] * keep + alpha[lane] * radiance[2];
        layers[3 * PLANE + lane] *= keep;
    }
}

/// Inverse depth along a streak: linear in the picture.
struct DepthLine {
    centre: [f64; 2],
    axis: [f64; 2],
    half: f64,
    middle: f64,
    rise: f64,
}

impl DepthLine {
    fn new(streak: &Streak, footprint: &Footprint) -> Self {
        let Footprint { centre, axis, length, .. } = *footprint;
        let [a, b] = streak.end_depths.map(|depth| 1.0 / f64::from(depth));
        let rise = if length > 0.0 { (b - a) / length } else { 0.0 };
        Self { centre, axis, half: 0.5 * length, middle: 0.5 * (a + b), rise }
    }

    fn hidden(&self, secants: &Secants, buffer: &DepthBuffer, x: usize, y: usize) -> bool {
        let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
        let along = (px - self.centre[0]) * self.axis[0] + (py - self.centre[1]) * self.axis[1];
        let inverse = self.middle + self.rise * along.clamp(-self.half, self.half);
        buffer.planar(x, y, || secants.at(px, py)) * inverse < 1.0
    }
}
