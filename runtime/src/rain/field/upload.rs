//! Where it rains as a graphics card asks for it.

use super::RainField;
use crate::gpu::rain::FieldUniform;
use crate::rain::RainMap;

/// What stands for no bound at all.
const ENDLESS: f32 = 1e30;

impl<'a> RainField<'a> {
    /// The map, where there is one.
    pub(crate) fn map(&self) -> Option<&'a RainMap> {
        self.map.map(|placed| placed.map)
    }

    /// Its numbers.
    pub(crate) fn uniform(&self) -> FieldUniform {
        let mut out = FieldUniform::default();
        out.ceiling[3] = self.farthest.map_or(ENDLESS, |farthest| farthest.0 as f32);
        if let Some(ceiling) = self.volume.ceiling {
            out.ceiling[..3].copy_from_slice(&[ceiling.height.0 as f32, ceiling.softness.0 as f32, 1.0]);
        }
        if let Some(region) = self.volume.region {
            let [x, y] = region.centre;
            out.region = [x, y, region.radius.0, region.softness.0].map(|value| value as f32);
            out.has[0] = 1;
        }
        let Some(placed) = self.map else { return out };
        let (origin, cell, size) = placed.map.grid();
        let origin = origin + placed.drift;
        out.map_place = [origin.x, origin.y, 1.0 / cell, placed.reference].map(|value| value as f32);
        (out.has[1], out.has[2], out.has[3]) = (1, size[0], size[1]);
        if let Some(top) = placed.map.top() {
            out.map_top[..3].copy_from_slice(&[top.height.0 as f32, top.softness.0 as f32, 1.0]);
        }
        out
    }
}
