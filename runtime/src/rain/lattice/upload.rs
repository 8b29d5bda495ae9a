//! A frustum's piece as a graphics card tests cells against it.

use super::FrustumPiece;
use glam::DVec3;

impl FrustumPiece {
    /// Lowest and highest corner of a box around it, in cells.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let corners = self.corners.iter();
        corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), corner| {
            (low.min(*corner), high.max(*corner))
        })
    }

    /// Its planes n·p ≤ d.
    pub fn planes(&self) -> [(DVec3, f64); 6] {
        self.planes
    }
}
