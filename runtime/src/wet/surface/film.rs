//! What the films of a frame mirror, at every other pixel along both axes: looked at at nodes that lie four of these apart, then two, then at each, wherever
//! the nodes around it do not tell.
//!
//! A node tells its neighbours where it lies on their plane under a film as rough, where what the nodes around mirror differs little beside what the pixel shows in all,
//! and where the film blurs as far as the nodes lie apart: a smooth surface's mirror image is looked at everywhere. Bumpy ground whose pixels lean each its own way is
//! told by tables of what facets of every lean mirror ([`Facets`]), 32 pixels apart.

use super::task::Task;
use super::{Film, Ground};
use crate::parallel::prelude::*;
use crate::wet::reflect::Mirrored;
use crate::wet::reflect::facets::{Facets, LEAST_SLOPE};
use glam::Vec3;

/// Levels of nodes: 4, 2 and 1 looks apart.
const LEVELS: usize = 3;
/// How far inverse depth between nodes may be off, as a share: planes are exact.
const APART: f32 = 5e-3;
/// Least cosine between normals of one surface.
const ALIKE: f32 = 0.995;
/// Largest difference of the slopes of one film's facets, as a share.
const AS_ROUGH: f32 = 0.1;
/// Share of a film's blur that nodes may lie apart, and pixels that they may without any.
const OF_BLUR: f32 = 0.5;
const SHARP_PX: f32 = 2.5;

/// Looks from table to table, and the pixels that a film must blur for one.
const SPACING: usize = 16;
const SPACING_PX: f32 = 16.0;
/// Pixels on both sides of a table's that tell the plane which it lies on.
const PLANE_PX: usize = 3;
/// How far a pixel may lie off a table's plane, as a share of its distance: stones stand out of the ground.
const OFF_PLANE: f32 = 6e-3;

/// A table and its place in the camera's axes.
struct Table {
    place: Vec3,
    normal: Vec3,
    facets: Facets,
}

/// Memory of a frame's films.
#[derive(Default)]
pub(super) struct Films {
    tables: Vec<Option<Table>>,
    /// What lies under each look.
    pub(super) grounds: Vec<Ground>,
    levels: [Vec<Mirrored>; LEVELS],
}

impl Films {
    /// Looks at a frame's films; `out` takes what each look's film mirrors.
    pub(super) fn look(&mut self, task: &Task<'_>, out: &mut Vec<Film>) {
        let [width, height] = task.frame.buffer.size;
        let half = [width.div_ceil(2), height.div_ceil(2)];
        self.grounds.clear();
        self.grounds.resize(half[0] * half[1], Ground::default());
        self.grounds.par_chunks_mut(half[0]).enumerate().for_each(|(row, grounds)| {
            for (column, ground) in grounds.iter_mut().enumerate() {
                *ground = task.ground([column, row]);
            }
        });
        self.look_at_tables(task, half);
        let tables = Tables { all: &self.tables, across: half[0].div_ceil(SPACING) + 1 };
        for level in 0..LEVELS {
            let (coarser, finer) = self.levels.split_at_mut(level);
            let step = 1 << (LEVELS - 1 - level);
            let size = half.map(|looks| looks.div_ceil(step));
            let looks = &mut finer[0];
            looks.clear();
            looks.resize(size[0] * size[1], Mirrored::default());
            let known =
                coarser.last().map(|coarser| (coarser.as_slice(), half.map(|n| n.div_ceil(2 * step))));
            let grounds = Grounds { all: &self.grounds, across: half[0], step };
            looks.par_chunks_mut(size[0]).enumerate().for_each(|(row, looks)| {
                for (column, look) in looks.iter_mut().enumerate() {
                    *look = grounds.look((task, &tables), [column, row], known);
                }
            });
        }
        let Some(finest) = self.levels.last() else { return };
        out.clear();
        out.resize(half[0] * half[1], Film::default());
        let rows = out.par_chunks_mut(half[0]).zip(finest.par_chunks(half[0])).enumerate();
        rows.for_each(|(row, (films, finest))| {
            for (column, (film, shown)) in films.iter_mut().zip(finest).enumerate() {
                let ground = &self.grounds[row * half[0] + column];
                *film = Film {
                    standing: task.standing(ground),
                    light: shown.light,
                    fresnel: shown.fresnel,
                    shown: ground.slope >= 0.0,
                    normal: ground.normal,
                    depth: ground.depth,
                };
            }
        });
    }
}

impl Films {
    /// Rays that the last frame's tables, and its looks at all levels, took.
    pub(super) fn rays(&self) -> usize {
        let tables = self.tables.iter().flatten().count() * Facets::RAYS as usize;
        // What a finer level has from a coarser one counts there: copies have no rays.
        tables + self.levels.iter().flatten().map(|look| look.rays as usize).sum::<usize>()
    }

    /// Tables where films blur far enough for them.
    fn look_at_tables(&mut self, task: &Task<'_>, half: [usize; 2]) {
        let [across, down] = half.map(|looks| looks.div_ceil(SPACING) + 1);
        self.tables.clear();
        self.tables.resize_with(across * down, || None);
        if task.controls.tolerance <= 0.0 {
            return;
        }
        let grounds = &self.grounds;
        self.tables.par_chunks_mut(across).enumerate().for_each(|(row, tables)| {
            for (column, table) in tables.iter_mut().enumerate() {
                let [x, y] = [(column * SPACING).min(half[0] - 1), (row * SPACING).min(half[1] - 1)];
                *table = task.table(&grounds[y * half[0] + x]);
            }
        });
    }
}

impl Task<'_> {
    fn table(&self, ground: &Ground) -> Option<Table> {
        if ground.slope < LEAST_SLOPE || self.blur_px(ground) * OF_BLUR + SHARP_PX < SPACING_PX {
            return None;
        }
        let [width, height] = self.frame.buffer.size;
        let [x, y] = ground.pixel;
        let inside = x >= PLANE_PX && y >= PLANE_PX && x + PLANE_PX < width && y + PLANE_PX < height;
        if !inside {
            return None;
        }
        // The plane's own normal, of depth: stones' normals lean about it.
        let at = |x: usize, y: usize| self.view.place(x, y, self.frame.buffer.depth_m[y * width + x]);
        let place = at(x, y);
        let [left, right] = [at(x - PLANE_PX, y), at(x + PLANE_PX, y)];
        let [above, below] = [at(x, y - PLANE_PX), at(x, y + PLANE_PX)];
        let normal = (right - left).cross(above - below).try_normalize()?;
        let to_eye = self.view.to_eye(place);
        let normal = if normal.dot(to_eye) > 0.0 { normal } else { -normal };
        let off = OFF_PLANE * place.length();
        let flat = [left, right, above, below].iter().all(|other| (*other - place).dot(normal).abs() < off);
        let facets = || self.mirror.facets((place, normal, to_eye), self.fresnel);
        flat.then(|| Table { place, normal, facets: facets() })
    }
}

/// Tables over a frame.
struct Tables<'a> {
    all: &'a [Option<Table>],
    across: usize,
}

impl Tables<'_> {
    /// What a look's film mirrors by the tables around it that lie on its plane.
    fn tell(&self, task: &Task<'_>, ground: &Ground, [column, row]: [usize; 2]) -> Option<Mirrored> {
        if ground.slope < LEAST_SLOPE {
            return None;
        }
        let place = task.view.place(ground.pixel[0], ground.pixel[1], ground.depth);
        let (normal, to_eye) = (task.view.from_world(ground.normal), task.view.to_eye(place));
        let part = |at: usize| (at % SPACING) as f32 / SPACING as f32;
        let (u, v) = (part(column), part(row));
        let first = row / SPACING * self.across + column / SPACING;
        let around = [(0, (1.0 - u) * (1.0 - v)), (1, u * (1.0 - v))];
        let around = [around, [(self.across, (1.0 - u) * v), (self.across + 1, u * v)]];
        let off = OFF_PLANE * place.length();
        let (mut all, mut sum) = (Mirrored::default(), 0.0);
        for (step, weight) in around.into_iter().flatten() {
            let Some(Some(table)) = self.all.get(first + step) else { continue };
            if weight <= 0.0 || (place - table.place).dot(table.normal).abs() > off {
                continue;
            }
            let shown = table.facets.shown((normal, to_eye), ground.slope, task.fresnel)?;
            (0..3).for_each(|band| all.light[band] += weight * shown.light[band]);
            all.fresnel += weight * shown.fresnel;
            sum += weight;
        }
        // One corner alone lies too far off.
        let scale = 1.0 / sum;
        (sum > LEAST_SHARE).then(|| Mirrored {
            light: all.light.map(|band| band * scale),
            fresnel: all.fresnel * scale,
            rays: 0,
        })
    }
}

/// Least share that the tables on a look's plane have of those around it.
const LEAST_SHARE: f32 = 0.3;

/// Grounds of the looks of one level.
struct Grounds<'a> {
    all: &'a [Ground],
    across: usize,
    step: usize,
}

impl Grounds<'_> {
    fn at(&self, [column, row]: [usize; 2]) -> &Ground {
        &self.all[row * self.step * self.across + column * self.step]
    }

    /// What one look's film mirrors: told by coarser nodes, or looked at.
    fn look(
        &self,
        (task, tables): (&Task<'_>, &Tables<'_>),
        [column, row]: [usize; 2],
        known: Option<(&[Mirrored], [usize; 2])>,
    ) -> Mirrored {
        let ground = self.at([column, row]);
        if ground.slope < 0.0 {
            return Mirrored::default();
        }
        let at = [column, row].map(|at| at * self.step);
        let own = || tables.tell(task, ground, at).unwrap_or_else(|| task.film(ground));
        let Some((coarser, size)) = known else { return own() };
        if column % 2 == 0 && row % 2 == 0 {
            return Mirrored { rays: 0, ..coarser[row / 2 * size[0] + column / 2] };
        }
        self.told(task, ground, [column, row], (coarser, size)).unwrap_or_else(own)
    }

    /// The mean of the coarser nodes around a look where they tell it.
    fn told(
        &self,
        task: &Task<'_>,
        ground: &Ground,
        [column, row]: [usize; 2],
        (coarser, size): (&[Mirrored], [usize; 2]),
    ) -> Option<Mirrored> {
        let [right, below] = [column.div_ceil(2), row.div_ceil(2)];
        if right >= size[0] || below >= size[1] {
            return None;
        }
        // Of an even column or row both are the same.
        let around = [[column / 2, row / 2], [right, row / 2], [column / 2, below], [right, below]];
        let (apart, tolerance) = (4.0 * self.step as f32, task.controls.tolerance);
        if tolerance <= 0.0 || apart > task.blur_px(ground) * OF_BLUR + SHARP_PX {
            return None;
        }
        let (mut inverse, mut fresnel) = (0.0, 0.0);
        let (mut sum, mut low, mut high) = ([0.0f32; 3], [f32::INFINITY; 3], [0.0f32; 3]);
        for place in around {
            let node = self.at(place.map(|at| 2 * at));
            let smooth = (node.slope - ground.slope).abs() > AS_ROUGH * ground.slope;
            if node.slope < 0.0 || smooth || node.normal.dot(ground.normal) < ALIKE {
                return None;
            }
            inverse += 0.25 / node.depth;
            let shown = &coarser[place[1] * size[0] + place[0]];
            fresnel += 0.25 * shown.fresnel;
            for band in 0..3 {
                sum[band] += 0.25 * shown.light[band];
                low[band] = low[band].min(shown.light[band]);
                high[band] = high[band].max(shown.light[band]);
            }
        }
        if (inverse * ground.depth - 1.0).abs() > APART {
            return None;
        }
        // Of what the pixel shows in all, its film's light is a part: on walls a small one.
        let film = task.film_share(ground);
        let shown = film * sum[0].max(sum[1]).max(sum[2]) + task.brightest(ground);
        let alike = (0..3).all(|band| film * (high[band] - low[band]) <= tolerance * shown);
        alike.then_some(Mirrored { light: sum, fresnel, rays: 0 })
    }
}
