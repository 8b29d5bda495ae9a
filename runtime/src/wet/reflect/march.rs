//! Rays followed over a depth buffer.

use super::view::View;
use glam::{Vec2, Vec3};

/// Steps of a ray at most.
const STEPS: usize = 18;
/// Halvings that find where a step crossed something.
const HALVINGS: usize = 5;
/// Depth of the plane before the eye at which rays towards it end, m.
const NEAR_M: f32 = 0.02;
/// A ray is behind something where it is deeper by this share.
const BEHIND: f32 = 1e-3;
/// Share of the picture along its borders over which what is seen gives way to the world's light.
const BORDER: f32 = 0.06;

/// A depth buffer and how rays go over it.
#[derive(Clone, Copy, Debug)]
pub struct March<'a> {
    /// The camera.
    pub view: &'a View,
    /// Inverse of planar depth, 1/m; 0 for sky and holes ([`inverse_of`]).
    pub inverse_depth: &'a [f32],
    /// How far rays go, m.
    pub reach_m: f32,
    /// How thick things are taken to be, m: behind them rays go on.
    pub thickness_m: f32,
}

/// Where a ray ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum End {
    /// At a pixel of the picture: on something, or where it would be seen far away.
    Seen(Vec2),
    /// Beyond the picture, where it would be seen far away if the picture were larger.
    Beyond(Vec2),
    /// Behind the eye.
    Behind,
}

impl End {
    /// The pixel, which may be beyond the picture.
    pub fn pixel(self) -> Option<Vec2> {
        match self {
            Self::Seen(at) | Self::Beyond(at) => Some(at),
            Self::Behind => None,
        }
    }
}

/// Inverses of planar depths; 0 for the sky and for holes.
pub fn inverse_of(depth_m: &[f32], out: &mut Vec<f32>) {
    out.clear();
    out.extend(depth_m.iter().map(|&depth| if depth > 0.0 { 1.0 / depth } else { 0.0 }));
}

impl March<'_> {
    /// Follows a ray from a place, in the camera's axes, in unit `direction`.
    pub fn end(&self, from: Vec3, direction: Vec3) -> End {
        self.end_within(from, direction, HALVINGS)
    }

    /// The same, where it comes behind something found by so many halvings of a step.
    pub fn end_within(&self, from: Vec3, direction: Vec3, halvings: usize) -> End {
        let length = if direction.z < 0.0 {
            self.reach_m.min((NEAR_M - from.z) / direction.z).max(0.0)
        } else {
            self.reach_m
        };
        let to = from + direction * length;
        let (a, b) = (self.view.pixel(from), self.view.pixel(to));
        let inside = self.share_inside(a, b);
        // Depth is linear along the way of parallel rays, its inverse along that of others.
        let parallel = self.view.is_parallel();
        let [za, zb] = if parallel { [from.z, to.z] } else { [1.0 / from.z, 1.0 / to.z] };
        let depth = |u: f32| {
            let value = za + u * (zb - za);
            if parallel { value } else { 1.0 / value }
        };
        let way = b - a;
        let span = way.abs().max_element() * inside;
        let steps = ((span / 1.5).ceil() as usize).clamp(1, STEPS);
        // Along the picture's axis that a ray mostly follows, looks fall on pixels' middles: depth needs no mixing there.
        let axis = usize::from(way.y.abs() > way.x.abs());
        let per_pixel = 1.0 / way[axis];
        let mut before = 0.0;
        let (scale, least) = (inside / (steps * steps) as f32, 0.25 * steps as f32);
        for step in 1..=steps {
            // Short steps where a thing stands on what mirrors it.
            let step = step as f32;
            let u = scale * step * (least + 0.75 * step);
            let u = if span > 1.0 {
                ((a[axis] + u * way[axis]) as i32 as f32 + 0.5 - a[axis]) * per_pixel
            } else {
                u
            };
            if u <= before {
                continue;
            }
            let value = za + u * (zb - za);
            let scene = self.nearest(a + way * u);
            // Of parallel rays `value` is depth, of others its inverse, as the scene's is.
            let behind = if parallel { value * scene > 1.0 + BEHIND } else { value * (1.0 + BEHIND) < scene };
            if behind {
                let (z, scene) = (depth(u), 1.0 / scene);
                if z - scene < self.thickness_m + (z - depth(before)).abs() {
                    return self.found((a, b), (before, u), halvings, &depth);
                }
            }
            before = u;
        }
        match (direction.z > 0.0 || parallel, inside < 1.0) {
            (false, _) => End::Behind,
            (true, false) => End::Seen(b),
            (true, true) => {
                // What stands at the border goes on beyond it.
                let scene = self.scene(a.lerp(b, inside));
                let length = (scene - from.z) / direction.z.max(1e-6);
                let goes_on = scene.is_finite() && length > 0.0;
                let beyond = if goes_on { self.view.pixel(from + direction * length) } else { b };
                End::Beyond(beyond)
            }
        }
    }

    /// How far from a place a ray in a unit direction ended, m: as far as rays go where it met nothing.
    pub fn distance(&self, from: Vec3, direction: Vec3, end: End) -> f32 {
        let End::Seen(at) = end else { return self.reach_m };
        let depth = self.scene(at);
        let place = self.view.ray(at.to_array());
        let place = if self.view.is_parallel() { place.with_z(depth) } else { place * depth };
        let length = (place - from).dot(direction);
        if length > 0.0 { length.min(self.reach_m) } else { self.reach_m }
    }

    /// Where a ray in a unit direction is seen to end that goes so far, m, whatever stands in its way.
    pub fn end_at(&self, from: Vec3, direction: Vec3, distance: f32) -> End {
        let place = from + direction * distance;
        if place.z <= NEAR_M {
            return End::Behind;
        }
        let at = self.view.pixel(place);
        let [width, height] = self.view.size.map(|pixels| pixels as f32);
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x <= width && at.y <= height;
        if inside { End::Seen(at) } else { End::Beyond(at) }
    }

    /// Where between two steps a ray came behind something.
    fn found(
        &self,
        (a, b): (Vec2, Vec2),
        (mut low, mut high): (f32, f32),
        halvings: usize,
        depth: &impl Fn(f32) -> f32,
    ) -> End {
        for _ in 0..halvings {
            let middle = 0.5 * (low + high);
            if depth(middle) > self.scene(a.lerp(b, middle)) * (1.0 + BEHIND) {
                high = middle;
            } else {
                low = middle;
            }
        }
        End::Seen(a.lerp(b, high))
    }

    /// Inverse depth of the pixel that a place lies in.
    #[inline]
    fn nearest(&self, at: Vec2) -> f32 {
        let [width, height] = self.view.size;
        let (x, y) = ((at.x.max(0.0) as usize).min(width - 1), (at.y.max(0.0) as usize).min(height - 1));
        self.inverse_depth[y * width + x]
    }

    /// Depth at a pixel, between four pixels' middles: inverse depth is linear over planes, so that a ray which leaves one doesn't meet it again.
    #[inline]
    fn scene(&self, at: Vec2) -> f32 {
        let [width, height] = self.view.size;
        let x = (at.x - 0.5).clamp(0.0, (width - 1) as f32);
        let y = (at.y - 0.5).clamp(0.0, (height - 1) as f32);
        let (left, top) = (x as usize, y as usize);
        let (u, v) = (x - left as f32, y - top as f32);
        let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let (above, below) = (top * width, bottom * width);
        let inverse = |at: usize| self.inverse_depth[at];
        let upper = inverse(above + left) + u * (inverse(above + right) - inverse(above + left));
        let lower = inverse(below + left) + u * (inverse(below + right) - inverse(below + left));
        1.0 / (upper + v * (lower - upper))
    }

    /// Share of the way from one pixel to another that is inside the picture.
    pub fn share_inside(&self, a: Vec2, b: Vec2) -> f32 {
        let size = Vec2::new(self.view.size[0] as f32, self.view.size[1] as f32);
        let way = b - a;
        let mut share = 1.0f32;
        for axis in 0..2 {
            let (from, along, end) = (a[axis], way[axis], size[axis]);
            if along > 0.0 && from + along > end {
                share = share.min((end - from) / along);
            } else if along < 0.0 && from + along < 0.0 {
                share = share.min(-from / along);
            }
        }
        share.max(0.0)
    }

    /// Share that a pixel has of the answer: 1 inside, falling to 0 at the borders.
    pub fn share(&self, at: Vec2) -> f32 {
        let size = Vec2::new(self.view.size[0] as f32, self.view.size[1] as f32);
        let edge = (at / size).min(1.0 - at / size).min_element();
        let t = (edge / BORDER).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }
}
