//! What stands before the tiles of some rows of a picture: each tile asks the town's tree once for all rays of its pixels.

use super::super::boxes::beam::{Ahead, Bundle};
use super::super::{Hit, Town};
use crate::camera::{Lens, Projection};
use glam::Vec3;

/// Edge of a tile, px.
const EDGE: usize = 16;

/// A tile's part of the town.
pub(super) struct View {
    boxes: Ahead,
    /// Whether any of its rays may meet hills.
    hills: bool,
}

/// The tiles of rows from `first` on; none for cameras whose rays don't come from one point.
pub(super) struct Views {
    first: usize,
    across: usize,
    tiles: Vec<View>,
}

impl Views {
    /// Looks for what stands before rows `first` to `last` − 1.
    pub fn new(town: &Town, lens: &Lens<'_>, first: usize, last: usize) -> Self {
        let camera = lens.camera;
        let (width, rows) = (camera.width as usize, last.saturating_sub(first));
        let across = width.div_ceil(EDGE);
        let mut views = Self { first, across, tiles: Vec::new() };
        if matches!(camera.projection, Projection::Orthographic { .. }) {
            return views;
        }
        for tile in 0..across * rows.div_ceil(EDGE) {
            let (left, top) = (tile % across * EDGE, first + tile / across * EDGE);
            let corners = [(0, 0), (EDGE, 0), (0, EDGE), (EDGE, EDGE)];
            let ways = corners.map(|(x, y)| {
                let direction = lens.ray((left + x) as f64, (top + y) as f64).direction;
                // One metre along the camera's axis each: between the corners these are linear.
                (direction / direction.dot(camera.forward)).as_vec3()
            });
            let bundle = Bundle::new(camera.position.as_vec3(), &ways);
            views.tiles.push(View { boxes: town.boxes.ahead(&bundle), hills: town.has_hills_ahead(&bundle) });
        }
        views
    }

    /// The tile of a place of the picture, px.
    fn of(&self, x: f64, y: f64) -> Option<&View> {
        let (column, row) = (x.max(0.0) as usize / EDGE, (y as usize).checked_sub(self.first)? / EDGE);
        (column < self.across).then(|| self.tiles.get(row * self.across + column)).flatten()
    }

    /// The first thing along the ray through a place of the picture.
    pub fn trace(&self, town: &Town, (x, y): (f64, f64), origin: Vec3, direction: Vec3) -> Option<Hit> {
        match self.of(x, y) {
            Some(view) => town.trace_ahead(&view.boxes, view.hills, origin, direction),
            None => town.trace(origin, direction, f32::MAX),
        }
    }
}

impl Town {
    /// Whether rays of a bundle may meet hills.
    pub(in crate::shade::town) fn has_hills_ahead(&self, bundle: &Bundle) -> bool {
        self.hills.as_ref().is_some_and(|hills| {
            let [low, high] = hills.bounds();
            bundle.may_meet(low, high)
        })
    }

    /// [`Town::trace`] without limit for a ray before which nothing else stands.
    fn trace_ahead(&self, boxes: &Ahead, hills: bool, origin: Vec3, direction: Vec3) -> Option<Hit> {
        let hills = self.hills.as_ref().filter(|_| hills);
        let boxes = |limit: f32| self.boxes.meet_ahead(boxes, origin, direction, limit);
        Self::first_of(hills, boxes, (origin, direction, f32::MAX))
    }
}
