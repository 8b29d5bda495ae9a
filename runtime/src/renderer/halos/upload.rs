//! Lights with halos as a graphics card takes them.

use super::{Halos, LAMP_RADIUS_M, Shape, Spreading};
use crate::gpu::medium::HaloLight;

/// How shapes are told apart there.
const LAMP: f32 = 0.0;
const LINE: f32 = 1.0;
const BALL: f32 = 2.0;
/// What no walls stand before.
const NO_LAMP: u32 = u32::MAX;

impl Spreading {
    /// The tables: what is scattered once; the source of what is scattered more often, and what is seen of that.
    pub(crate) fn texels(&self) -> [Vec<[f32; 4]>; 3] {
        let [source, seen] = self.more.texels();
        [self.once.texels(), source, seen]
    }
}

impl Halos<'_> {
    /// The lights.
    pub(crate) fn list(&self) -> Vec<HaloLight> {
        let each = self.lights.iter().map(|halo| {
            let (ends, radius, shape) = match halo.shape {
                Shape::Lamp(place, _) => ([place; 2], LAMP_RADIUS_M, LAMP),
                Shape::Line(ends) => (ends, 0.5 * ends[0].distance(ends[1]), LINE),
                Shape::Ball(place, radius) => ([place; 2], radius, BALL),
            };
            let number = match halo.shape {
                Shape::Lamp(_, number) if self.walls.is_some() => number as u32,
                _ => NO_LAMP,
            };
            let [start, end] = ends.map(|end| end.as_vec3().to_array());
            HaloLight {
                start,
                radius: radius as f32,
                end,
                shape,
                intensity: halo.intensity,
                extinction: halo.extinction as f32,
                most: halo.most.map(|most| most.min(1e30) as f32),
                number,
                pad: 0,
            }
        });
        each.collect()
    }
}
