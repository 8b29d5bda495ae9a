//! Light of a cloud grid along a ray: radiance ∫ σ_s J e^{−τ} ds and what the cloud lets through.
//!
//! There is one march, [`CloudMarch`]. It is told where density comes from, [`density::Cells`] as the solver saw it or
//! [`density::Billows`] as a picture shows it, whether the direct light of some lights is worked out at every step, and how
//! closely to look, [`MarchQuality`]. J is read between cell centres, and in empty cells too, where it exists as well: setting it to
//! zero there would darken every edge.

pub mod density;
pub mod direct;
pub mod lookup;
pub mod march;
mod picture;

pub use density::{Billows, Cells, CloudShape};
pub use lookup::{between, corners};
pub use march::{CloudMarch, CloudView, MarchQuality, Radiance, RayWidth, WideRay};

use crate::camera::{Camera, Projection};
use crate::shade::detail::Detail;
use crate::transport::Cloud;
use glam::{DVec3, Vec4};

/// The direction from each place towards a camera.
pub fn direction_to(camera: &Camera, point: DVec3) -> DVec3 {
    match camera.projection {
        Projection::Orthographic { .. } => -camera.forward,
        Projection::Perspective { .. } => {
            (camera.position - point).try_normalize().unwrap_or(-camera.forward)
        }
    }
}

/// A cloud and its light in three colours towards one viewpoint, for pictures.
pub struct CloudPicture<'a> {
    cloud: &'a Cloud,
    billows: Billows<'a>,
    /// Per cell: J towards the viewpoint in three colours, W/(m² sr), and extinction, 1/m.
    cells: &'a [Vec4],
}

impl<'a> CloudPicture<'a> {
    /// `cells` holds J in three colours and the cell's extinction, 1/m; `billow` is the diameter of billows, m, if there are any.
    ///
    /// Panics when `cells` is not one grid long.
    pub fn new(
        cloud: &'a Cloud,
        shape: &'a CloudShape,
        cells: &'a [Vec4],
        detail: &'a Detail,
        billow: Option<f32>,
    ) -> Self {
        assert_eq!(cells.len(), cloud.shape.len());
        Self { cloud, billows: Billows { shape, detail, billow }, cells }
    }

    /// Follows `ray` until it leaves the grid or sees no further.
    pub fn march(&self, ray: &crate::camera::Ray) -> CloudView {
        self.billows.picture(self.cloud, self.cells, ray)
    }
}
