//! What the films of a frame mirror, at every other pixel along both axes: looked at at nodes that lie four of these apart, then two, then at each, wherever
//! the nodes around it do not tell.
//!
//! A node tells its neighbours where it lies on their plane under a film as rough, where what both mirror is alike, and where the film blurs as far as the nodes lie
//! apart: a smooth surface's mirror image is looked at everywhere.

use super::task::Task;
use super::{Film, Ground};
use crate::parallel::prelude::*;
use crate::wet::reflect::Mirrored;

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

/// Memory of a frame's films.
#[derive(Default)]
pub(super) struct Films {
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
        for level in 0..LEVELS {
            let (coarser, finer) = self.levels.split_at_mut(level);
            let step = 1 << (LEVELS - 1 - level);
            let size = half.map(|looks| looks.div_ceil(step));
            let looks = &mut finer[0];
            looks.clear();
            looks.resize(size[0] * size[1], Mirrored::default());
            let known = coarser.last().map(|coarser| (coarser.as_slice(), half.map(|n| n.div_ceil(2 * step))));
            let grounds = Grounds { all: &self.grounds, across: half[0], step };
            looks.par_chunks_mut(size[0]).enumerate().for_each(|(row, looks)| {
                for (column, look) in looks.iter_mut().enumerate() {
                    *look = grounds.look(task, [column, row], known);
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
                    rays: shown.rays,
                };
            }
        });
    }
}

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
        task: &Task<'_>,
        [column, row]: [usize; 2],
        known: Option<(&[Mirrored], [usize; 2])>,
    ) -> Mirrored {
        let ground = self.at([column, row]);
        if ground.slope < 0.0 {
            return Mirrored::default();
        }
        let Some((coarser, size)) = known else { return task.film(ground) };
        if column % 2 == 0 && row % 2 == 0 {
            return Mirrored { rays: 0, ..coarser[row / 2 * size[0] + column / 2] };
        }
        self.told(task, ground, [column, row], (coarser, size)).unwrap_or_else(|| task.film(ground))
    }

    /// The mean of the coarser nodes around a look where they tell it.
    fn told(
        &self,
        task: &Task<'_>,
        ground: &Ground,
        [column, row]: [usize; 2],
        (coarser, size): (&[Mirrored], [usize; 2]),
    ) -> Option<Mirrored> {
        let [right, below] = [(column + 1) / 2, (row + 1) / 2];
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
        let brightest = sum[0].max(sum[1]).max(sum[2]);
        let alike = (0..3).all(|band| high[band] - low[band] <= tolerance * brightest);
        alike.then_some(Mirrored { light: sum, fresnel, rays: 0 })
    }
}
