//! Light at the nodes of a strip that changes slowly: worked out at every second node of every second row, and at the others where the
//! nodes around them differ.
//!
//! Shadows of lamps and strokes, and images of points and lines in water, cost most of a node and are smooth across most of it. What
//! the water's facets see is grain and is looked at in every node.

use super::super::Surface;
use super::super::light::Parts;
use super::node::{ROUGHNESS, same_surface, similar};
use super::strip::{Seen, Strip, Task};

/// Share by which the slopes of water may differ whose images stand for one another: a narrow image is as bright as it is narrow.
const AS_ROUGH: f32 = 0.01;
/// Share of the brightest image of a strip below which images may differ.
const FAINT: f32 = 3e-4;

/// A node's own surface, what its facets show and the share that they keep.
pub(super) struct Look<const N: usize> {
    pub seen: Seen,
    pub surface: Surface,
    pub facets: Option<(Parts<N>, f32)>,
}

/// The slow part of a node's light.
#[derive(Clone, Copy)]
pub(super) struct Slow<const N: usize> {
    pub irradiance: Parts<N>,
    pub images: Parts<N>,
}

/// A row of nodes after another, `across` in each.
pub(super) struct Coarse<'a, const N: usize> {
    pub task: Task<'a>,
    pub looks: &'a [Option<Look<N>>],
    pub across: usize,
}

impl<const N: usize> Coarse<'_, N> {
    /// The slow light of every node.
    pub fn fill(&self) -> Vec<Option<Slow<N>>> {
        let at = |number: usize| (number % self.across, number / self.across);
        let every = self.task.quality.slow_spacing.clamp(1, 2) as usize;
        let is_coarse = |number: usize| {
            let (x, y) = at(number);
            x.is_multiple_of(every) && y.is_multiple_of(every)
        };
        let own = |number: usize| self.looks[number].as_ref().map(|look| self.slow(look));
        let mut slow: Vec<Option<Slow<N>>> =
            (0..self.looks.len()).map(|number| is_coarse(number).then(|| own(number)).flatten()).collect();
        let faint = self.brightest(&slow).each(|_, value| FAINT * value);
        for number in (0..self.looks.len()).filter(|&number| !is_coarse(number)) {
            let Some(look) = &self.looks[number] else { continue };
            let known = self.between(look, at(number), &slow, &faint);
            slow[number] = Some(known.unwrap_or_else(|| self.slow(look)));
        }
        slow
    }

    fn slow(&self, look: &Look<N>) -> Slow<N> {
        let Self { task, .. } = self;
        let images = look.facets.map(|(light, _)| task.images(&look.seen, &look.surface, light));
        Slow { irradiance: task.irradiance(&look.seen), images: images.unwrap_or(Parts::NONE) }
    }

    fn brightest(&self, slow: &[Option<Slow<N>>]) -> Parts<N> {
        slow.iter().flatten().fold(Parts::NONE, |most, slow| most.most(slow.images))
    }

    /// The mean of the coarse nodes beside one, where it may stand for the node's own light.
    fn between(
        &self,
        look: &Look<N>,
        (x, y): (usize, usize),
        slow: &[Option<Slow<N>>],
        faint: &Parts<N>,
    ) -> Option<Slow<N>> {
        let beside = |at: usize| [at & !1, (at + 1) & !1];
        let (columns, rows) = (beside(x), beside(y));
        let tolerance = self.task.quality.tolerance;
        // Where anything may differ, any node beside it will do.
        let (any, as_rough) =
            (tolerance == f32::INFINITY, if tolerance == f32::INFINITY { ROUGHNESS } else { AS_ROUGH });
        let (mut sum, mut ends, mut weight) = (Slow::NONE, None, 0.0);
        for (column, row) in rows.into_iter().flat_map(|row| columns.map(|column| (column, row))) {
            let number = row * self.across + column;
            let other = self.looks.get(number).filter(|_| column < self.across).and_then(Option::as_ref);
            let other = other.filter(|other| stands_for(other, look, as_rough));
            let Some(light) = other.and(slow.get(number).copied().flatten()) else {
                if any {
                    continue;
                }
                return None;
            };
            weight += 0.25;
            sum.irradiance.add(0.25, light.irradiance);
            sum.images.add(0.25, light.images);
            let [low, high]: [Slow<N>; 2] = ends.unwrap_or([light; 2]);
            ends = Some([low.zip(light, Parts::least), high.zip(light, Parts::most)]);
        }
        let [low, high]: [Slow<N>; 2] = ends?;
        if any {
            let mean = |light: Parts<N>| light.each(|_, value| value / weight);
            return Some(Slow { irradiance: mean(sum.irradiance), images: mean(sum.images) });
        }
        // Images lie over what the facets show, and are told from it.
        let shown = look.facets.map_or(Parts::NONE, |(light, _)| light);
        let over = |images: Parts<N>| {
            let mut sum = images;
            sum.add(1.0, shown);
            sum
        };
        let is_faint = |band: &[f32; 3], most: &[f32; 3]| band.iter().zip(most).all(|(a, b)| a <= b);
        let images_alike = similar(&over(low.images), &over(high.images), tolerance)
            || is_faint(&high.images.base, &faint.base)
                && high.images.strokes.iter().zip(&faint.strokes).all(|(a, b)| is_faint(a, b));
        (images_alike && similar(&low.irradiance, &high.irradiance, tolerance)).then_some(sum)
    }
}

impl<const N: usize> Slow<N> {
    const NONE: Self = Self { irradiance: Parts::NONE, images: Parts::NONE };

    fn zip(self, other: Self, of: fn(Parts<N>, Parts<N>) -> Parts<N>) -> Self {
        Self { irradiance: of(self.irradiance, other.irradiance), images: of(self.images, other.images) }
    }
}

/// Whether light at `other` may stand for that of `look`, in water whose slope differs by this share at most.
fn stands_for<const N: usize>(other: &Look<N>, look: &Look<N>, as_rough: f32) -> bool {
    let is_as_rough = match (&other.facets, &look.facets) {
        (Some(_), Some(_)) => {
            (other.surface.slope - look.surface.slope).abs() <= as_rough * look.surface.slope
        }
        (None, None) => true,
        _ => false,
    };
    is_as_rough && same_surface(&other.seen.hit, &look.seen.hit)
}

impl<const N: usize> Strip<'_, N> {
    /// What can be told of the node at pixel (x, y) without asking for the slow part of its light.
    pub(super) fn look(task: &Task<'_>, seen: &Seen, [x, y]: [usize; 2]) -> Look<N> {
        let surface = task.whole_surface(seen, x, y);
        let facets = (surface.wet > 0.0).then(|| task.facets(seen, &surface));
        Look { seen: *seen, surface, facets }
    }
}
