//! Some rows of a picture of the town, on their own: what every pixel's middle meets, light at nodes, then pixels.

use super::super::grain::grain;
use super::super::light::{Lighting, Mirror, Parts, Shading};
use super::super::{Hit, Surface, Thing, Town};
use super::coarse::{Coarse, Look, Slow};
use super::node::{Node, same_surface, similar};
use super::quality::Quality;
use super::spots::{Place, Spots};
use super::tiles::Views;
use super::{SKY, TownPixel};
use crate::camera::{Lens, Projection};
use glam::Vec3;

/// Rows of a strip: a multiple of any sensible spacing of nodes, so that no row of nodes is worked out twice but the last.
pub(super) const ROWS: usize = 32;

/// What a ray met, and the ray.
#[derive(Clone, Copy)]
pub(super) struct Seen {
    pub direction: Vec3,
    pub hit: Hit,
}

/// What all strips of a picture share.
#[derive(Clone, Copy)]
pub(super) struct Task<'a> {
    pub town: &'a Town,
    pub lens: Lens<'a>,
    pub lighting: &'a Lighting<'a>,
    pub quality: Quality,
}

/// Rows `from` to `to` − 1 with what is around them.
pub(super) struct Strip<'a, const N: usize> {
    task: Task<'a>,
    views: Views,
    width: usize,
    spacing: usize,
    from: usize,
    /// First row of `seen`, and what the middle of each pixel sees from there on.
    first: usize,
    seen: Vec<Option<Seen>>,
    /// Rows of nodes from `from` on, each with a node at every `spacing`-th pixel that sees anything.
    nodes: Vec<Option<Node<N>>>,
    nodes_across: usize,
    spots: Spots<N>,
}

impl<'a> Task<'a> {
    /// Follows the ray through a place of the picture, px.
    fn look(&self, views: &Views, x: f64, y: f64) -> Option<Seen> {
        let ray = self.lens.ray(x, y);
        let direction = ray.direction.as_vec3();
        let hit = views.trace(self.town, (x, y), ray.origin.as_vec3(), direction)?;
        Some(Seen { direction, hit })
    }

    /// The same where the ray is known to meet the flat surface that `on` lies on.
    fn look_at_plane(&self, x: f64, y: f64, on: &Hit) -> Option<Seen> {
        let ray = self.lens.ray(x, y);
        let (origin, direction) = (ray.origin.as_vec3(), ray.direction.as_vec3());
        let distance = (on.point - origin).dot(on.normal) / direction.dot(on.normal);
        // At grazing the plane may be met anywhere.
        if !(distance > 0.0 && (distance - on.distance).abs() < 0.5 * on.distance) {
            return None;
        }
        let point = origin + direction * distance;
        let thing = match on.thing {
            Thing::Block(number, wall, on_wall) => {
                let off = point - on.point;
                let along = on.normal.truncate().perp().dot(off.truncate());
                Thing::Block(number, wall, on_wall + glam::Vec2::new(along, off.z))
            }
            other => other,
        };
        Some(Seen { direction, hit: Hit { distance, point, thing, ..*on } })
    }

    /// Width of a pixel where a ray ended, m: a slanted surface is covered by an ellipse, whose mean width stands for it.
    fn footprint(&self, seen: &Seen) -> f32 {
        let width = match self.lens.camera.projection {
            Projection::Perspective { .. } => self.angle() * seen.hit.distance,
            Projection::Orthographic { .. } => 1.0 / self.lens.pixels_per_metre as f32,
        };
        let slant = -seen.direction.dot(seen.hit.normal);
        width / slant.max(0.01).sqrt()
    }

    /// Angle that a pixel covers, rad.
    fn angle(&self) -> f32 {
        match self.lens.camera.projection {
            Projection::Perspective { .. } => 1.0 / self.lens.pixels_per_metre as f32,
            Projection::Orthographic { .. } => 0.0,
        }
    }

    /// Places of a pixel's samples.
    fn samples(&self, x: usize, y: usize) -> impl Iterator<Item = [f64; 2]> + use<> {
        let per_side = self.quality.per_side();
        let at = move |index: u32| (f64::from(index) + 0.5) / f64::from(per_side);
        (0..per_side * per_side)
            .map(move |sample| [x as f64 + at(sample % per_side), y as f64 + at(sample / per_side)])
    }

    fn surface(&self, seen: &Seen) -> Surface {
        self.town.surface(&seen.hit, self.footprint(seen) / self.quality.per_side() as f32)
    }

    /// The surface of a whole pixel whose middle is `seen` and that lies on one plane.
    pub(super) fn whole_surface(&self, seen: &Seen, x: usize, y: usize) -> Surface {
        if self.quality.per_side() == 1 {
            return self.surface(seen);
        }
        // A pixel is as long on the ground as it is seen slanted.
        let footprint = self.footprint(seen);
        let extent = footprint / (-seen.direction.dot(seen.hit.normal)).max(1e-4).sqrt();
        let of_one = footprint / self.quality.per_side() as f32;
        if let Some(even) = self.town.even_surface(&seen.hit, of_one, extent) {
            return even;
        }
        let samples = self
            .samples(x, y)
            .map(|[x, y]| self.surface(&self.look_at_plane(x, y, &seen.hit).unwrap_or(*seen)));
        Surface::mean(samples)
    }

    fn mirror(&self, seen: &Seen) -> Mirror {
        // By the place and not by the pixel: the water's grain stands still while the camera moves.
        let width = self.footprint(seen) * self.quality.spacing.max(1) as f32;
        let shift = grain(seen.hit.point, seen.hit.normal, width, 1).shift;
        Mirror { facets: self.quality.facets, sample: [0, 1], shift, angle: self.angle(), points: 1.0 }
    }

    pub(super) fn irradiance<const N: usize>(&self, seen: &Seen) -> Parts<N> {
        self.town.irradiance(&seen.hit, self.lighting)
    }

    fn pane<const N: usize>(&self, seen: &Seen) -> Parts<N> {
        self.town.pane(seen.direction, &seen.hit, self.footprint(seen), self.lighting)
    }

    fn mirrored<const N: usize>(&self, seen: &Seen, surface: &Surface) -> (Parts<N>, f32) {
        self.town.mirrored(seen.direction, &seen.hit, surface, self.lighting, self.mirror(seen))
    }

    pub(super) fn facets<const N: usize>(&self, seen: &Seen, surface: &Surface) -> (Parts<N>, f32) {
        self.town.facets(seen.direction, &seen.hit, surface, self.lighting, self.mirror(seen))
    }

    pub(super) fn images<const N: usize>(
        &self,
        seen: &Seen,
        surface: &Surface,
        facets: Parts<N>,
    ) -> Parts<N> {
        let by = (self.lighting, self.mirror(seen));
        self.town.images(seen.direction, &seen.hit, surface, by, facets)
    }
}

impl<'a, const N: usize> Strip<'a, N> {
    /// Looks at rows `from` to `to` − 1 and what is beside them.
    pub fn new(task: Task<'a>, from: usize, to: usize) -> Self {
        let (width, height) = (task.lens.camera.width as usize, task.lens.camera.height as usize);
        let spacing = task.quality.spacing.clamp(1, ROWS as u32) as usize;
        let first = from.saturating_sub(1);
        // The first row of nodes below, and what the last row of pixels stands beside.
        let last = (from + (to - from).next_multiple_of(spacing) + 1).min(height);
        let views = Views::new(task.town, &task.lens, first, last);
        let middle = |at: usize| task.look(&views, (at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
        let seen = (first * width..last * width).map(middle).collect();
        let nodes_across = width.div_ceil(spacing);
        let mut strip = Self {
            task,
            views,
            width,
            spacing,
            from,
            first,
            seen,
            nodes: Vec::new(),
            nodes_across,
            spots: Spots::new(task.quality.spot as usize, [width, to - from]),
        };
        let rows = (from..last).step_by(spacing);
        let looks: Vec<Option<Look<N>>> = rows
            .flat_map(|y| (0..nodes_across).map(move |column| [column * spacing, y]))
            .map(|[x, y]| strip.seen(x, y).map(|seen| Self::look(&task, seen, [x, y])))
            .collect();
        let slow = Coarse { task, looks: &looks, across: nodes_across }.fill();
        strip.nodes =
            looks.into_iter().zip(slow).map(|(look, slow)| Some(strip.node(look?, &slow?))).collect();
        strip
    }

    fn seen(&self, x: usize, y: usize) -> Option<&Seen> {
        self.seen[(y - self.first) * self.width + x].as_ref()
    }

    fn node(&self, Look { seen, surface, facets }: Look<N>, slow: &Slow<N>) -> Node<N> {
        let task = &self.task;
        Node {
            hit: seen.hit,
            surface,
            irradiance: slow.irradiance,
            pane: task.town.has_panes(&seen.hit).then(|| task.pane(&seen)),
            mirrored: facets.map(|(mut light, share)| {
                light.add(1.0, slow.images);
                (light, share)
            }),
        }
    }

    /// The nodes around a pixel, each with its weight.
    fn around(&self, x: usize, y: usize) -> [(Option<&Node<N>>, f32); 4] {
        let spacing = self.spacing;
        let (column, row) = (x / spacing, (y - self.from) / spacing);
        let (u, v) =
            ((x % spacing) as f32 / spacing as f32, ((y - self.from) % spacing) as f32 / spacing as f32);
        let node = |across: usize, down: usize| {
            let (column, row) = (column + across, row + down);
            let at = row * self.nodes_across + column;
            // Beyond the picture's edge there is none.
            (column < self.nodes_across).then(|| self.nodes.get(at)).flatten().and_then(Option::as_ref)
        };
        [
            (node(0, 0), (1.0 - u) * (1.0 - v)),
            (node(1, 0), u * (1.0 - v)),
            (node(0, 1), (1.0 - u) * v),
            (node(1, 1), u * v),
        ]
    }

    /// Whether the pixels beside one see the same flat surface.
    fn is_within(&self, seen: &Seen, x: usize, y: usize) -> bool {
        let rows = self.seen.len() / self.width + self.first;
        let beside = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
        beside.into_iter().all(|(x, y)| {
            x >= self.width
                || !(self.first..rows).contains(&y)
                || self.seen(x, y).is_some_and(|other| same_surface(&seen.hit, &other.hit))
        })
    }

    /// Whether none of the pixels beside one sees anything.
    fn is_sky(&self, x: usize, y: usize) -> bool {
        let rows = self.seen.len() / self.width + self.first;
        let beside = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
        beside
            .into_iter()
            .all(|(x, y)| x >= self.width || !(self.first..rows).contains(&y) || self.seen(x, y).is_none())
    }

    /// The light at a place of pixel (x, y): from the nodes around it where they may stand for it, on the spot elsewhere. At an `edge`
    /// few nodes are on its surface; any will do.
    fn shading(&self, seen: &Seen, surface: &Surface, [x, y]: [usize; 2], edge: bool) -> Shading<N> {
        let task = &self.task;
        let around = self.around(x, y);
        let tolerance = if edge { f32::INFINITY } else { task.quality.tolerance };
        let on_surface = |node: &&Node<N>| same_surface(&seen.hit, &node.hit);
        // Where much may differ, a part of the nodes may stand for all.
        let all = if tolerance == f32::INFINITY { 1e-6 } else { (1.0 - tolerance).clamp(0.2, 0.999) };
        // Weights of an edge's nodes count for how near they are, the node's own pixel most.
        let mix = |of: &dyn Fn(&Node<N>) -> Option<Parts<N>>, tolerance: f32, least: f32| {
            let (mut sum, mut weight) = (Parts::NONE, 0.0);
            let mut ends: Option<[Parts<N>; 2]> = None;
            for (node, share) in around {
                let share = if edge { share + 0.01 } else { share };
                if share <= 0.0 {
                    continue;
                }
                let Some(light) = node.filter(on_surface).and_then(of) else { continue };
                sum.add(share, light);
                weight += share;
                ends = Some(match ends {
                    None => [light; 2],
                    Some([low, high]) => [low.least(light), high.most(light)],
                });
            }
            let [low, high] = ends?;
            let whole = weight >= least && similar(&low, &high, tolerance);
            whole.then(|| sum.each(|_, value| value / weight))
        };
        let place = Place { pixel: [x, y - self.from], hit: &seen.hit, surface };
        let irradiance = mix(&|node| Some(node.irradiance), tolerance, all)
            .unwrap_or_else(|| self.spots.irradiance(place, || task.irradiance(seen)));
        let pane = (surface.glass > 0.0).then(|| {
            mix(&|node| node.pane, tolerance, all)
                .unwrap_or_else(|| self.spots.pane(place, || task.pane(seen)))
        });
        let mirrored = (surface.wet > 0.0).then(|| {
            // Of rough water one node beside the pixel is enough: shores are many.
            let some = all.min(0.2);
            let rough = |node: &Node<N>| node.mirrored.filter(|_| node.is_as_rough(surface));
            let light = mix(&|node| rough(node).map(|(light, _)| light), f32::INFINITY, some);
            let share = mix(&|node| rough(node).map(|(_, share)| Parts::of([share; 3])), f32::INFINITY, some);
            match (light, share) {
                (Some(light), Some(share)) => (light, share.base[0]),
                _ => self.spots.mirrored(place, || task.mirrored(seen, surface)),
            }
        });
        Shading { irradiance, pane, mirrored }
    }

    /// One pixel.
    pub fn pixel(&self, x: usize, y: usize) -> (TownPixel, [[f32; 3]; N]) {
        let task = &self.task;
        let middle = self.seen(x, y);
        let mut pixel = SKY;
        if let Some(seen) = middle {
            pixel.distance = seen.hit.distance;
            pixel.depth = seen.hit.distance * seen.direction.as_dvec3().dot(task.lens.camera.forward) as f32;
            pixel.normal = seen.hit.normal;
        }
        let light = match middle {
            None if self.is_sky(x, y) => return (pixel, [[0.0; 3]; N]),
            Some(seen) if self.is_within(seen, x, y) => {
                pixel.cover = 1.0;
                self.inside(seen, x, y)
            }
            _ => self.edge(&mut pixel, x, y),
        };
        pixel.radiance = light.base;
        (pixel, light.strokes)
    }

    /// A pixel within one surface.
    fn inside(&self, seen: &Seen, x: usize, y: usize) -> Parts<N> {
        if x.is_multiple_of(self.spacing)
            && (y - self.from).is_multiple_of(self.spacing)
            && let (Some(node), _) = self.around(x, y)[0]
        {
            return self.task.town.composed(seen.direction, &seen.hit, &node.surface, &node.shading());
        }
        let surface = self.task.whole_surface(seen, x, y);
        let shading = self.shading(seen, &surface, [x, y], false);
        self.task.town.composed(seen.direction, &seen.hit, &surface, &shading)
    }

    /// A pixel where surfaces meet: each sample sees its own.
    fn edge(&self, pixel: &mut TownPixel, x: usize, y: usize) -> Parts<N> {
        let task = &self.task;
        let share = 1.0 / (task.quality.per_side() * task.quality.per_side()) as f32;
        let mut light = Parts::NONE;
        let mut known: Vec<(Hit, Surface, Shading<N>)> = Vec::new();
        for [u, v] in task.samples(x, y) {
            let Some(seen) = task.look(&self.views, u, v) else { continue };
            let surface = task.surface(&seen);
            let serves = |(hit, other, shading): &&(Hit, Surface, Shading<N>)| {
                same_surface(&seen.hit, hit)
                    && (surface.glass == 0.0 || shading.pane.is_some())
                    && (surface.wet == 0.0 || shading.mirrored.is_some() && surface.is_as_rough(other))
            };
            let shading = match known.iter().find(serves) {
                Some((.., shading)) => *shading,
                None => {
                    let shading = self.shading(&seen, &surface, [x, y], true);
                    known.push((seen.hit, surface, shading));
                    shading
                }
            };
            light.add(share, task.town.composed(seen.direction, &seen.hit, &surface, &shading));
            pixel.cover += share;
        }
        light
    }
}

#[cfg(test)]
mod tests;
