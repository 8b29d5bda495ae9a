//! Draws streaks: into bands of rows, band by band and tile by tile, so that a pixel is written by one thread
//! and sees its streaks in the order of the list.
//!
//! A tile's streaks are laid over each other in a tile buffer, which fits a core's second cache, and the tile buffer over the picture and into the
//! mask when the tile is done: what a streak costs is its covered pixels and its visits to tiles, of which a streak of a hundred pixels meets two. What a
//! tile needs of its streaks is gathered before they are drawn, so that memory is waited for once and not streak by streak. Long lists are drawn in
//! parts, one after the other, so that memory is bounded; a pixel sees the same streaks in the same order.

mod hidden;

use super::kernel::{Clip, Kernel, Ribbon};
use super::tile_buffer::{Paint, TILE, TileBuffer, Under};
use super::{RainLight, Shot, Streak, Workspace};
use crate::camera::{Camera, Secants};
use crate::depth::DepthBuffer;
use crate::error::RuntimeError;
use crate::parallel::prelude::*;
use crate::picture::Picture;
use hidden::{DepthLine, Reach, Seen};
use std::any::Any;
use std::sync::{Mutex, PoisonError};

/// Streaks that are prepared and sorted into tiles at a time.
const PART: usize = 16_384;
/// Pixels whose depth is looked at together.
const SEEN: usize = 64;

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
#[derive(Debug)]
pub(super) struct Canvas {
    boxes: Vec<TileBox>,
    /// Where each tile's streaks start in `order`; one more than there are tiles.
    starts: Vec<u32>,
    order: Vec<u32>,
    /// Working memory, one for each band: whatever type the last kernel had, and its bytes.
    bands: Vec<Box<dyn Any + Send + Sync>>,
    band_bytes: usize,
    /// What the last kernel made of a part's streaks, of a type of its own too, and its bytes.
    ready: Box<dyn Any + Send + Sync>,
    ready_bytes: usize,
    /// One for each thread: a tile's is used up before the next tile begins.
    tile_buffers: Mutex<Vec<TileBuffer>>,
    mask: Vec<f32>,
}

impl Default for Canvas {
    fn default() -> Self {
        Self {
            boxes: Vec::new(),
            starts: Vec::new(),
            order: Vec::new(),
            bands: Vec::new(),
            band_bytes: 0,
            ready: Box::new(()),
            ready_bytes: 0,
            tile_buffers: Mutex::default(),
            mask: Vec::new(),
        }
    }
}

/// A streak that is ready to be drawn: its place, and what it is laid with.
type Ready<P> = (P, Paint);

/// Working memory of a band, whose kernel has scratch of type `S`.
#[derive(Debug)]
struct Band<S, P> {
    scratch: S,
    ribbon: Ribbon,
    /// A tile's own streaks.
    near: Vec<Ready<P>>,
}

impl<S, P> Band<S, P> {
    fn bytes(&self) -> usize {
        self.ribbon.bytes() + self.near.capacity() * size_of::<Ready<P>>()
    }
}

/// First and last tile along x, then along y, of a streak's box; empty when first > last.
type TileBox = [u32; 4];
const NOWHERE: TileBox = [1, 0, 1, 0];

/// The tiles that a clip touches.
fn tiles_of(Clip { left, top, right, bottom }: Clip, grid: [usize; 2]) -> TileBox {
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
    /// Each streak hides what is there by its coverage α, its drop's disc swept along its path, and shows its own light where its
    /// pattern has it, as far as [`RainLight::contrast`] says; where
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
        self.canvas.draw(camera, scene, (&self.streaks, PART), grid, picture);
        Ok(())
    }
}

impl Canvas {
    fn draw<K: Kernel, L: RainLight>(
        &mut self,
        camera: &Camera,
        scene: &Scene<K, L>,
        (streaks, part): (&[Streak], usize),
        grid: [usize; 2],
        picture: &mut Picture,
    ) {
        let kept = std::mem::replace(&mut self.ready, Box::new(()));
        let mut ready = kept.downcast::<Vec<Ready<K::Placed>>>().unwrap_or_default();
        // The first part clears it, tile by tile.
        self.mask.resize(picture.pixels.len(), 0.0);
        if streaks.is_empty() {
            self.mask.fill(0.0);
        }
        let new = || -> Box<dyn Any + Send + Sync> {
            Box::new(Band::<K::Scratch, K::Placed> {
                scratch: K::Scratch::default(),
                ribbon: Ribbon::default(),
                near: Vec::new(),
            })
        };
        self.bands.resize_with(grid[1].max(self.bands.len()), new);
        for band in &mut self.bands {
            if !band.is::<Band<K::Scratch, K::Placed>>() {
                *band = new();
            }
        }
        for (number, streaks) in streaks.chunks(part).enumerate() {
            self.prepare(camera, scene, streaks, grid, &mut ready);
            self.sort_into_tiles(grid);
            self.paint(camera, scene, &Part { streaks, ready: &ready, is_first: number == 0 }, grid, picture);
        }
        let bytes = |band: &Box<dyn Any + Send + Sync>| {
            band.downcast_ref::<Band<K::Scratch, K::Placed>>().map_or(0, Band::bytes)
        };
        self.band_bytes = self.bands.iter().map(bytes).sum();
        self.ready_bytes = ready.capacity() * size_of::<Ready<K::Placed>>();
        self.ready = ready;
    }

    /// Paints some streaks that are prepared and sorted into tiles.
    fn paint<K: Kernel, L: RainLight>(
        &mut self,
        camera: &Camera,
        scene: &Scene<K, L>,
        part: &Part<K::Placed>,
        grid: [usize; 2],
        picture: &mut Picture,
    ) {
        let Self { starts, order, bands, mask, tile_buffers, .. } = self;
        let wanted = threads().min(grid[1]);
        let tile_buffers = &*tile_buffers;
        let pool = || tile_buffers.lock().unwrap_or_else(PoisonError::into_inner);
        let held = pool().len();
        pool().resize_with(wanted.max(held), TileBuffer::new);
        let list = TileList { starts, order };
        let width = picture.width;
        let rows = width * TILE[1];
        let secants = camera.secants();
        let paint = |(index, ((band, pixels), mask)): Job| {
            let Some(band) = band.downcast_mut::<Band<K::Scratch, K::Placed>>() else { return };
            let top = index * TILE[1];
            let height = pixels.len() / width;
            let is_first = part.is_first;
            let mut under = Under { pixels, mask, width, top, is_first };
            // Never none: no more bands are painted at a time than there are threads.
            let own = pool().pop();
            let mut tile_buffer = own.unwrap_or_else(TileBuffer::new);
            let mut brush = Brush { band, tile_buffer: &mut tile_buffer, secants: &secants, scene };
            for column in 0..grid[0] {
                let (left, right) = (column * TILE[0], width.min((column + 1) * TILE[0]));
                // Pictures have at most 2²⁸ pixels.
                let [left, top, right, bottom] = [left, top, right, top + height].map(|side| side as i32);
                let mine = list.of(index * grid[0] + column);
                if is_first || !mine.is_empty() {
                    brush.paint_tile(part, mine, Clip { left, top, right, bottom });
                    brush.tile_buffer.uncover(&mut under);
                }
            }
            pool().push(tile_buffer);
        };
        let pixels = picture.pixels.par_chunks_mut(rows);
        bands.par_iter_mut().zip(pixels).zip(mask.par_chunks_mut(rows)).enumerate().for_each(paint);
    }
}

/// Threads that bands are painted on.
fn threads() -> usize {
    #[cfg(feature = "rayon")]
    return rayon::current_num_threads();
    #[cfg(not(feature = "rayon"))]
    return 1;
}

/// A band's number, its working memory, its pixels and its part of the mask.
type Job<'a> = (usize, ((&'a mut Box<dyn Any + Send + Sync>, &'a mut [[f32; 3]]), &'a mut [f32]));

/// Some streaks, ready to be drawn.
struct Part<'a, P> {
    streaks: &'a [Streak],
    ready: &'a [Ready<P>],
    /// Whether nothing has been drawn before them: what the mask holds is an earlier picture's.
    is_first: bool,
}

/// Who is in which tile.
struct TileList<'a> {
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
        self.boxes.capacity() * size_of::<TileBox>()
            + (self.starts.capacity() + self.order.capacity() + self.mask.capacity()) * 4
            + self.bands.capacity() * size_of::<Box<dyn Any>>()
            + self.band_bytes
            + self.ready_bytes
            + self
                .tile_buffers
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .iter()
                .map(TileBuffer::bytes)
                .sum::<usize>()
    }

    /// Each streak's place, light and tiles.
    fn prepare<K: Kernel, L: RainLight>(
        &mut self,
        camera: &Camera,
        scene: &Scene<K, L>,
        streaks: &[Streak],
        grid: [usize; 2],
        ready: &mut Vec<Ready<K::Placed>>,
    ) {
        self.boxes.resize(streaks.len(), NOWHERE);
        ready.resize(streaks.len(), Ready::default());
        let secants = camera.secants();
        let sees_light = scene.kernel.sees_light();
        let prepare = |((ready, tiles), streak): Prepare<K::Placed>| {
            let mut footprint = streak.footprint();
            *tiles = NOWHERE;
            let ray = camera.ray_with(&secants, footprint.centre[0], footprint.centre[1]);
            let distance = f64::from(streak.depth) / ray.direction.dot(camera.forward);
            if sees_light {
                footprint.elevation_deg = libm::asin(ray.direction.z.clamp(-1.0, 1.0)).to_degrees();
                footprint.light = scene.light.main_light(&ray, distance).map_or([0.0, 90.0], |light| {
                    let cosine = light.towards.dot(ray.direction).clamp(-1.0, 1.0);
                    [light.share, libm::acos(cosine).to_degrees()]
                });
            }
            let Some((clip, placed)) = scene.kernel.place(&footprint) else { return };
            *tiles = tiles_of(clip, grid);
            let paint = Paint {
                strength: (f64::from(streak.coverage) * scene.gain) as f32,
                contrast: scene.light.contrast(&ray, distance).clamp(0.0, 1.0),
                colour: scene.light.radiance(&ray, distance),
            };
            *ready = (placed, paint);
        };
        ready.par_iter_mut().zip(&mut self.boxes).zip(streaks).for_each(prepare);
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

/// A streak, and what is worked out of it: its tiles and the rest.
type Prepare<'a, P> = ((&'a mut Ready<P>, &'a mut TileBox), &'a Streak);

/// What paints one band, tile by tile.
struct Brush<'a, K: Kernel, L> {
    band: &'a mut Band<K::Scratch, K::Placed>,
    tile_buffer: &'a mut TileBuffer,
    secants: &'a Secants,
    scene: &'a Scene<'a, K, L>,
}

impl<K: Kernel, L> Brush<'_, K, L> {
    /// Lays a tile's streaks over each other.
    fn paint_tile(&mut self, part: &Part<K::Placed>, mine: &[u32], clip: Clip) {
        self.tile_buffer.begin(clip);
        if mine.is_empty() {
            return;
        }
        // Gathered first, so that memory is waited for once and not streak by streak.
        self.band.near.clear();
        self.band.near.extend(mine.iter().map(|&index| part.ready[index as usize]));
        let reach =
            self.scene.depth.as_ref().map_or(Reach::OPEN, |buffer| Reach::new(buffer, self.secants, clip));
        let (kernel, mut at) = (self.scene.kernel, 0);
        while at < self.band.near.len() {
            let Band { scratch, ribbon, near } = &mut *self.band;
            let streak = &part.streaks[mine[at] as usize];
            let (seen, run) = match self.scene.depth.is_some() {
                true => (reach.of(streak), at + 1),
                false => (Seen::Everywhere, near.len()),
            };
            let laid = match seen {
                Seen::Nowhere => 1,
                Seen::Everywhere => kernel.lay(&near[at..run], scratch, self.tile_buffer),
                Seen::InPlaces => 0,
            };
            at += laid;
            if at == run {
                continue;
            }
            let (streak, (placed, paint)) = (&part.streaks[mine[at] as usize], near[at]);
            at += 1;
            if !kernel.ribbon(&placed, clip, scratch, ribbon) {
                self.paint_spans(streak, &placed, clip, &paint);
                continue;
            }
            if matches!(seen, Seen::InPlaces) {
                self.hide(streak, clip);
            }
            self.tile_buffer.lay_ribbon(&self.band.ribbon, paint);
        }
    }

    /// A streak whose kernel hands on spans.
    fn paint_spans(&mut self, streak: &Streak, placed: &K::Placed, clip: Clip, paint: &Paint) {
        let Self { band, tile_buffer, secants, scene } = self;
        let scratch = &mut band.scratch;
        let Some(buffer) = &scene.depth else {
            return scene.kernel.draw(placed, clip, scratch, &mut |span| {
                let blocks = [span.shares, span.covers.unwrap_or(span.shares)];
                tile_buffer.lay_span([span.x, span.y], span.count, blocks, paint);
            });
        };
        let line = DepthLine::new(streak, &streak.footprint());
        scene.kernel.draw(placed, clip, scratch, &mut |span| {
            for start in (0..span.count).step_by(SEEN) {
                let count = (span.count - start).min(SEEN);
                let mut seen = [[0.0; SEEN]; 2];
                let covers = span.covers.unwrap_or(span.shares);
                for i in 0..count {
                    let (x, y) = (span.x as usize + start + i, span.y as usize);
                    let own = [span.shares[start + i], covers[start + i]];
                    if (own[0] > 0.0 || own[1] > 0.0) && !line.hidden(secants, buffer, x, y) {
                        [seen[0][i], seen[1][i]] = own;
                    }
                }
                tile_buffer.lay_span([span.x + start as i32, span.y], count, [&seen[0], &seen[1]], paint);
            }
        });
    }

    /// Takes from the ribbon what the scene hides.
    fn hide(&mut self, streak: &Streak, clip: Clip) {
        let Some(buffer) = &self.scene.depth else { return };
        let depth = DepthLine::new(streak, &streak.footprint());
        let [low, high] =
            if self.band.ribbon.columns { [clip.top, clip.bottom] } else { [clip.left, clip.right] };
        let Ribbon { columns, line, blocks, first, shares, covers } = &mut self.band.ribbon;
        let numbered = (*line..).zip(first.iter());
        let blocks = (*blocks).max(1);
        let own = shares.chunks_exact_mut(blocks).zip(covers.chunks_exact_mut(blocks));
        for ((line, &first), (shares, covers)) in numbered.zip(own) {
            let own = shares.as_flattened_mut().iter_mut().zip(covers.as_flattened_mut());
            for (place, (share, cover)) in (first..).zip(own) {
                if place >= low && place < high && (*share > 0.0 || *cover > 0.0) {
                    let [x, y] = if *columns { [line, place] } else { [place, line] };
                    if depth.hidden(self.secants, buffer, x as usize, y as usize) {
                        (*share, *cover) = (0.0, 0.0);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
