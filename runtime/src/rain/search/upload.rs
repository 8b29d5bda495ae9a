//! A class's search as a graphics card does it: a thread for each cell of a box around the frustum's piece.

use super::Search;
use crate::gpu::rain::RainClass;
use glam::{DVec3, IVec3};

/// A 64-bit number in its halves.
fn halves(value: i64) -> [u32; 2] {
    [value as u32, (value >> 32) as u32]
}

impl Search {
    /// The class's numbers; its first thread is number `first`. Returns its threads too.
    pub fn uniform(&self, first: u32) -> (RainClass, u64) {
        let (low, high) = self.piece.bounds();
        let (low, high) = (low.floor().as_ivec3(), high.floor().as_ivec3() + IVec3::ONE);
        let size = (high - low).max(IVec3::ONE).as_uvec3();
        let threads = size.to_array().iter().map(|&side| u64::from(side)).product();
        let base = |axis: usize| halves(self.base[axis].wrapping_add(i64::from(low[axis])));
        let class = RainClass {
            key: [self.key as u32, (self.key >> 32) as u32],
            smallest: self.from as f32,
            width: self.width as f32,
            base_x: base(0),
            base_y: base(1),
            base_z: base(2),
            crowd: self.crowd as f32,
            floor: self.floor as f32,
            low: low.to_array(),
            first,
            size: size.to_array(),
            edge: self.edge as f32,
            place: self.place.as_vec3().to_array(),
            near: self.depths[0] as f32,
            far: self.depths[1] as f32,
            pad: [0.0; 3],
            planes: self.piece.planes().map(|(normal, bound): (DVec3, f64)| {
                let [x, y, z] = normal.as_vec3().to_array();
                [x, y, z, bound as f32]
            }),
        };
        (class, threads)
    }
}
