//! Where a scene stands: the point of the ground that everything is measured from while a picture is drawn.
//!
//! An asset's coordinates may be those of a map, thousands of kilometres from their origin (UTM, national grids). What depends on
//! where the ground is, or has to be near zero to keep its digits in single precision, takes coordinates from this point instead:
//! heights in the air, the Earth's curvature, the town, billows, drops. So moving a whole scene changes nothing but round-off.

use crate::error::RuntimeError;
use crate::frame::Frame;
use crate::load::Asset;
use crate::rain::MapChoice;
use crate::stroke::{Segment, Stroke};
use glam::DVec3;
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::cloud::CloudSection;
use squall_formats::section::place::PlaceSection;
use squall_formats::section::response::ResponseSection;
use squall_formats::section::town::TownSection;
use squall_formats::section::view::ViewSection;
use squall_transport::Cloud;
use std::sync::Arc;

/// A point of the ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Where it is in the asset's coordinates, m. A sky's sun has its stated elevation here.
    pub origin: DVec3,
}

impl Place {
    /// The place of `asset`'s scene.
    ///
    /// It is the one that the recipe states, where it does. A town without that stands on the ground at its own origin, (0, 0, 0). Without a town the place lies in the middle of the cloud's grid (of the view's
    /// camera where there is no cloud), as high as the lowest thing that is known: the foot of a stroke, the view's camera, the
    /// floor of the view region, the base of the grid.
    ///
    /// Errors: a damaged section.
    pub fn of(asset: &Asset) -> Result<Self, RuntimeError> {
        let has = |tag| asset.directory().find(tag).is_some();
        if has(PlaceSection::TAG) {
            let section = asset.section(PlaceSection::TAG, "the place", PlaceSection::read)?;
            return Ok(Self { origin: DVec3::from_array(section.origin_m) });
        }
        if has(TownSection::TAG) {
            return Ok(Self::default());
        }
        let (mut level, mut heights) = (None, Vec::new());
        if has(ViewSection::TAG) {
            let view = asset.section(ViewSection::TAG, "the view", ViewSection::read)?;
            let [x, y, z] = view.camera.position_m;
            level = Some([x, y]);
            heights.push(z);
        }
        if has(CloudSection::TAG) {
            let head = asset.section(CloudSection::TAG, "the cloud grid", CloudSection::read)?.head;
            let counts = head.shape.to_array();
            level = Some(
                [0, 1].map(|axis: usize| head.origin_m[axis] + 0.5 * counts[axis] as f64 * head.cell_m[axis]),
            );
            heights.push(head.origin_m[2]);
        }
        if has(ResponseSection::TAG) {
            let head = asset.section(ResponseSection::TAG, "the response", ResponseSection::read)?.head;
            heights.extend(head.view_region.map(|region| region.low_m[2]));
        }
        if has(BoltSection::TAG) {
            let strokes = asset.section(BoltSection::TAG, "the strokes", BoltSection::read)?.strokes;
            heights.extend(strokes.iter().flat_map(|stroke| [stroke.from_m[2], stroke.to_m[2]]));
        }
        let [x, y] = level.unwrap_or_default();
        let z = heights.into_iter().reduce(f64::min).unwrap_or(0.0);
        Ok(Self { origin: DVec3::new(x, y, z) })
    }

    /// `frame` with everything but its flashes measured from here; those are the asset's or the caller's.
    pub(crate) fn frame(&self, frame: &Frame) -> Frame {
        let mut moved = frame.clone();
        moved.camera.position -= self.origin;
        if let Some(ceiling) = &mut moved.weather.volume.ceiling {
            ceiling.height.0 -= self.origin.z;
        }
        if let Some(region) = &mut moved.weather.volume.region {
            region.centre[0] -= self.origin.x;
            region.centre[1] -= self.origin.y;
        }
        if self.origin != DVec3::ZERO {
            if let MapChoice::Own(map) = &mut moved.place.map {
                *map = Arc::new(map.measured_from(self.origin));
            }
            for cover in &mut moved.place.covers {
                *cover = Arc::new(cover.measured_from(self.origin));
            }
        }
        moved.detail.fibres_from = (f64::from(moved.detail.fibres_from) - self.origin.z) as f32;
        moved
    }

    /// `stroke` measured from here.
    pub(crate) fn stroke(&self, stroke: Arc<Stroke>) -> Arc<Stroke> {
        if self.origin == DVec3::ZERO {
            return stroke;
        }
        let moved = |segment: &Segment| Segment {
            from: segment.from - self.origin,
            to: segment.to - self.origin,
            ..*segment
        };
        Arc::new(Stroke { segments: stroke.segments.iter().map(moved).collect(), color: stroke.color })
    }

    /// `cloud` measured from here; nothing where that is where it stands.
    pub(crate) fn cloud(&self, cloud: &Cloud) -> Option<Cloud> {
        let origin_m = cloud.origin_m - self.origin;
        (origin_m != cloud.origin_m).then(|| Cloud { origin_m, ..cloud.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::container::{OutSection, write};
    use squall_formats::section::bolt::StrokeRecord;
    use squall_formats::section::view::{ViewCamera, ViewSection};

    fn place(sections: &[OutSection]) -> DVec3 {
        let mut bytes = Vec::new();
        write(&mut bytes, sections).unwrap();
        Place::of(&Asset::from_bytes(&bytes).unwrap()).unwrap().origin
    }

    #[test]
    fn a_scene_stands_on_its_lowest_thing_and_moves_along_with_it() {
        let strokes = |offset: f64| {
            let stroke = StrokeRecord {
                from_m: [0.0, 0.0, 900.0 + offset],
                to_m: [0.0, 0.0, 310.0 + offset],
                segment_m: 10.0,
                ..StrokeRecord::usual()
            };
            BoltSection { strokes: vec![stroke] }.write()
        };
        let view = |x: f64, z: f64| {
            let camera = ViewCamera { position_m: [x, 40.0, z], ..ViewCamera::default() };
            ViewSection { camera, ..ViewSection::default() }.write()
        };
        assert_eq!(place(&[]), DVec3::ZERO);
        assert_eq!(place(&[strokes(0.0)]), DVec3::new(0.0, 0.0, 310.0));
        assert_eq!(place(&[view(7.0, 2.0), strokes(0.0)]), DVec3::new(7.0, 40.0, 2.0));
        assert_eq!(place(&[view(3e5 + 7.0, 202.0), strokes(200.0)]), DVec3::new(3e5 + 7.0, 40.0, 202.0));
    }
}
