//! The light of strokes that were asked for before: J per cell of a stroke of brightness 1, towards a viewer.

use super::{DirectExtent, LightReport, Viewer};
use crate::single_scatter::DirectRays;
use crate::stroke::Stroke;
use std::sync::Arc;

/// Bytes that kept light may take, the last stroke asked for aside; those that were not asked for longest go first.
const MOST_BYTES: usize = 64 << 20;

/// What a stroke's light depends on beside the stroke.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MadeFor {
    pub viewer: Viewer,
    pub rays: DirectRays,
    pub extent: DirectExtent,
}

#[derive(Default)]
pub(super) struct Kept {
    entries: Vec<Entry>,
    clock: u64,
}

struct Entry {
    stroke: Arc<Stroke>,
    made_for: MadeFor,
    light: (Vec<f32>, LightReport),
    used: u64,
}

impl Kept {
    /// Where the light of `stroke` is kept, if it is.
    pub fn find(&mut self, stroke: &Arc<Stroke>, made_for: MadeFor) -> Option<usize> {
        self.clock += 1;
        // The segments decide: the colour scales light as brightness does.
        let same = |entry: &Entry| {
            entry.made_for == made_for
                && (Arc::ptr_eq(&entry.stroke, stroke) || entry.stroke.segments == stroke.segments)
        };
        let at = self.entries.iter().position(same)?;
        self.entries[at].used = self.clock;
        Some(at)
    }

    /// Keeps the light of `stroke`, and answers where.
    pub fn insert(
        &mut self,
        stroke: Arc<Stroke>,
        made_for: MadeFor,
        light: (Vec<f32>, LightReport),
    ) -> usize {
        let bytes = |entry: &Entry| size_of_val(entry.light.0.as_slice());
        let own = size_of_val(light.0.as_slice());
        while self.entries.iter().map(bytes).sum::<usize>() + own > MOST_BYTES {
            let Some(oldest) = (0..self.entries.len()).min_by_key(|&at| self.entries[at].used) else { break };
            self.entries.swap_remove(oldest);
        }
        self.entries.push(Entry { stroke, made_for, light, used: self.clock });
        self.entries.len() - 1
    }

    pub fn at(&self, at: usize) -> (&[f32], LightReport) {
        let (j, report) = &self.entries[at].light;
        (j, *report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn seen_from(position: DVec3) -> MadeFor {
        let (rays, extent) = (DirectRays::PerPoint(8), DirectExtent::NearCloud);
        MadeFor { viewer: Viewer::At(position), rays, extent }
    }

    #[test]
    fn light_is_found_again_for_the_same_stroke_and_viewer_alone() {
        let stroke = |x: f64| Arc::new(Stroke::from_points(&[DVec3::X * x], 1.0, [1.0; 3]).unwrap());
        let here = seen_from(DVec3::ZERO);
        let mut kept = Kept::default();
        let at = kept.insert(stroke(1.0), here, (vec![3.0], LightReport::default()));
        assert_eq!(kept.at(at).0, [3.0]);
        assert_eq!(kept.find(&stroke(1.0), here), Some(at));
        let red = Arc::new((*stroke(1.0)).clone().colored([3.0, 0.0, 0.0]));
        assert_eq!(kept.find(&red, here), Some(at));
        assert_eq!(kept.find(&stroke(2.0), here), None);
        assert_eq!(kept.find(&stroke(1.0), seen_from(DVec3::ONE)), None);
        let finer = MadeFor { rays: DirectRays::PerPoint(9), ..here };
        assert_eq!(kept.find(&stroke(1.0), finer), None);
        // A frame's light has none in air, and data is complete.
        let everywhere = MadeFor { extent: DirectExtent::Everywhere, ..here };
        assert_eq!(kept.find(&stroke(1.0), everywhere), None);
    }

    #[test]
    fn memory_is_bounded_and_the_longest_unused_goes_first() {
        let stroke = |x: f64| Arc::new(Stroke::from_points(&[DVec3::X * x], 1.0, [1.0; 3]).unwrap());
        let here = seen_from(DVec3::ZERO);
        let mut kept = Kept::default();
        let third = || vec![0.0; MOST_BYTES / 12];
        for x in [1.0, 2.0, 3.0] {
            assert_eq!(kept.find(&stroke(x), here), None);
            kept.insert(stroke(x), here, (third(), LightReport::default()));
        }
        assert!(kept.find(&stroke(1.0), here).is_some());
        kept.insert(stroke(4.0), here, (third(), LightReport::default()));
        let found = [1.0, 2.0, 3.0, 4.0].map(|x| kept.find(&stroke(x), here).is_some());
        assert_eq!(found, [true, false, true, true]);
    }
}
