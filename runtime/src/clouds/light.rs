//! The light of some points in a cloud, before anyone looks at it.

use crate::camera::{Camera, Projection};
use crate::error::RuntimeError;
use crate::flash::{DirectSettings, add_direct, add_direct_fluence};
use crate::relight::{PointLight, Relighter, Relit};
use crate::transport::Cloud;
use glam::DVec3;
use squall_formats::section::response::DirectionalBasis;
use squall_formats::sphere::{self, MAX_HARMONICS};
use std::sync::Arc;

/// Rays that direct light's fluence is made of, over all lights, and of one light at least and at most.
const FLUENCE_RAYS: usize = 1 << 22;
const FLUENCE_RAYS_PER_LIGHT: [usize; 2] = [1024, 1 << 16];
/// Cells that one thread takes at a time.
const PIECE: usize = 4096;

/// Whom light is scattered towards.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Viewer {
    /// Somebody at this point, m.
    At(DVec3),
    /// Somebody far away: the unit direction from the cloud to them.
    Along(DVec3),
}

impl From<DVec3> for Viewer {
    fn from(position: DVec3) -> Self {
        Self::At(position)
    }
}

impl From<&Camera> for Viewer {
    fn from(camera: &Camera) -> Self {
        match camera.projection {
            Projection::Perspective { .. } => Self::At(camera.position),
            Projection::Orthographic { .. } => Self::Along(-camera.forward),
        }
    }
}

impl Viewer {
    /// The unit direction from `point` to the viewer.
    #[must_use]
    pub fn direction_from(self, point: DVec3) -> DVec3 {
        match self {
            Self::At(position) => (position - point).try_normalize().unwrap_or(DVec3::NEG_Z),
            Self::Along(direction) => direction,
        }
    }

    /// Refuses a viewer whom the asset's light was not baked for.
    pub(super) fn check(self, relighter: &Relighter) -> Result<(), RuntimeError> {
        let (Self::At(vector) | Self::Along(vector)) = self;
        if !vector.is_finite() {
            return Err(RuntimeError::argument("viewer", "three finite numbers", vector));
        }
        relighter.check_viewer(match self {
            Self::At(position) => Some(position),
            Self::Along(_) => None,
        })
    }
}

/// How a live solve went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LiveReport {
    /// Sweeps.
    pub sweeps: u32,
    /// Residual that was left.
    pub residual: f64,
}

/// The light of some points in a cloud: everything that in-scattered radiance and fluence are made of. It holds its cloud.
pub struct CloudLight {
    pub(super) relighter: Arc<Relighter>,
    pub(super) basis: DirectionalBasis,
    /// The rows' coefficients, one plane of cells each.
    pub(super) planes: Vec<f32>,
    /// Points whose direct light is in neither planes nor live coefficients.
    pub(super) direct: Vec<PointLight>,
    /// J's 16 harmonic coefficients per cell of live light; empty where nothing was solved for.
    pub(super) live: Vec<f32>,
    pub(super) live_report: Option<LiveReport>,
    pub(super) lights: usize,
    pub(super) lights_outside: usize,
    pub(super) sources: usize,
}

/// What turns planes and live coefficients into J in one direction; planes that do not count are left out.
pub struct Factors {
    planes: Vec<(usize, f32)>,
    live: [f32; MAX_HARMONICS],
}

impl CloudLight {
    /// The light as the rows hold it.
    pub fn relit(&self) -> Relit<'_> {
        Relit {
            basis: self.basis,
            frame: self.relighter.view_region_frame(),
            cells: self.relighter.cloud().shape.len(),
            planes: &self.planes,
        }
    }

    /// The rows' coefficients, for those who take something out of them.
    pub fn planes_mut(&mut self) -> &mut [f32] {
        &mut self.planes
    }

    /// Points of light in all.
    pub fn lights(&self) -> usize {
        self.lights
    }

    /// Points that no row answers for, whose scattered light was solved for on the spot.
    pub fn lights_outside(&self) -> usize {
        self.lights_outside
    }

    /// Virtual point lights that the others were split over.
    pub fn sources(&self) -> usize {
        self.sources
    }

    /// How the live solve went, if there was one.
    pub fn live_report(&self) -> Option<LiveReport> {
        self.live_report
    }

    /// In-scattered radiance J towards `viewer` per cell, direct light included, W/(m² sr), into `out`; never negative.
    ///
    /// Errors: a viewer outside the asset's view region; `out` is not one grid long.
    pub fn radiance(&self, viewer: impl Into<Viewer>, out: &mut [f32]) -> Result<(), RuntimeError> {
        let viewer = viewer.into();
        viewer.check(&self.relighter)?;
        self.check_length(out.len())?;
        self.towards(viewer, self.settings(), out);
        out.iter_mut().for_each(|value| *value = value.max(0.0));
        Ok(())
    }

    /// Fluence rate φ per cell, W/m², into `out`: light of all orders, direct light included; never negative. 0 in cells whose light
    /// the asset left out because no ray shades with them.
    ///
    /// Errors: an asset baked for a view region, whose rows hold light towards that alone; `out` is not one grid long.
    pub fn fluence(&self, out: &mut [f32]) -> Result<(), RuntimeError> {
        self.check_length(out.len())?;
        if let DirectionalBasis::ViewRegion { .. } = self.basis {
            let wanted = "an asset with light in all directions: this one was baked for a view region, and its rows hold light \
                          towards that alone (bake without it, with channels \"harmonics-…\" or \"directions-26\")";
            return Err(RuntimeError::argument("fluence", wanted, "light towards a view region"));
        }
        let relighter = &self.relighter;
        out.fill(0.0);
        add_direct_fluence(
            relighter.cloud(),
            relighter.extinction_scale(),
            &self.direct,
            self.settings(),
            out,
        );
        let known = relighter.known_cells();
        for (cell, value) in out.iter_mut().enumerate() {
            // A codec's error may leave a dark cell below zero; fluence is not. Cut off with the direct light there, it moves the
            // mean least.
            let whole = (*value + self.scattered_fluence(cell)).max(0.0);
            *value = if known[cell] { whole } else { 0.0 };
        }
        Ok(())
    }

    fn settings(&self) -> DirectSettings {
        let [fewest, most] = FLUENCE_RAYS_PER_LIGHT;
        let rays_per_point = (FLUENCE_RAYS / self.direct.len().max(1)).clamp(fewest, most) as u32;
        DirectSettings { rays_per_point, ..DirectSettings::default() }
    }

    fn check_length(&self, found: usize) -> Result<(), RuntimeError> {
        let cells = self.relighter.cloud().shape.len();
        if found == cells {
            return Ok(());
        }
        Err(RuntimeError::argument("cells", format!("{cells} values, one a cell of the cloud's grid"), found))
    }

    /// J towards a viewer that was checked, as it is: the codec may leave it below zero.
    pub(super) fn towards(&self, viewer: Viewer, settings: DirectSettings, out: &mut [f32]) {
        let cloud = self.relighter.cloud();
        self.scattered(|middle| viewer.direction_from(middle), out);
        if !self.direct.is_empty() {
            let middle = |cell: usize| cloud.centre(cloud.shape.cell(cell));
            let ways: Vec<[f32; 3]> =
                (0..out.len()).map(|cell| viewer.direction_from(middle(cell)).as_vec3().to_array()).collect();
            add_direct(cloud, self.relighter.extinction_scale(), &self.direct, &ways, settings, out);
        }
    }

    /// J of rows and live light in every cell, without direct light that is in neither, in a direction that may depend on the
    /// cell's middle.
    ///
    /// Panics when `out` is longer than the grid.
    pub fn scattered(&self, direction: impl Fn(DVec3) -> DVec3 + Sync, out: &mut [f32]) {
        let cloud = self.relighter.cloud();
        in_pieces(out, |cell, factors| {
            let middle = cloud.centre(cloud.shape.cell(cell));
            self.relit().factors(middle, direction(middle), factors);
            let rows = self.relit().value(cell, factors);
            rows + self.live_value(cell, || sphere::harmonics(direction(middle).to_array()).map(|v| v as f32))
        });
    }

    fn live_value(&self, cell: usize, factors: impl Fn() -> [f32; MAX_HARMONICS]) -> f32 {
        match self.live.get(cell * MAX_HARMONICS..(cell + 1) * MAX_HARMONICS) {
            Some(row) => row.iter().zip(&factors()).map(|(a, b)| a * b).sum(),
            None => 0.0,
        }
    }

    /// Factors in direction `towards`, the same in every cell. Of light towards a view region they are 0.
    pub fn factors(&self, towards: DVec3) -> Factors {
        let mut all = Vec::new();
        self.relit().factors(DVec3::ZERO, towards, &mut all);
        let planes = all.into_iter().enumerate().filter(|(_, factor)| *factor != 0.0).collect();
        Factors { planes, live: sphere::harmonics(towards.to_array()).map(|v| v as f32) }
    }

    /// J of rows and live light in one cell.
    pub fn value(&self, cell: usize, factors: &Factors) -> f32 {
        let Relit { cells, planes, .. } = self.relit();
        let rows: f32 = factors.planes.iter().map(|(plane, f)| f * planes[plane * cells + cell]).sum();
        rows + self.live_value(cell, || factors.live)
    }

    /// Fluence rate of rows and live light in one cell, as it is; 0 of light towards a view region.
    pub fn scattered_fluence(&self, cell: usize) -> f32 {
        let live = self.live.get(cell * MAX_HARMONICS).copied().unwrap_or_default();
        self.relit().fluence(cell).unwrap_or_default() + live * libm::sqrtf(4.0 * std::f32::consts::PI)
    }
}

/// J of relit coefficients in each cell's own direction to the viewer.
pub(super) fn towards(relit: &Relit<'_>, cloud: &Cloud, viewer: Viewer, j: &mut [f32]) {
    in_pieces(j, |cell, factors| {
        let middle = cloud.centre(cloud.shape.cell(cell));
        relit.factors(middle, viewer.direction_from(middle), factors);
        relit.value(cell, factors)
    });
}

/// Fills `values` cell by cell; each thread keeps its own memory for factors.
fn in_pieces(values: &mut [f32], value: impl Fn(usize, &mut Vec<f32>) -> f32 + Sync) {
    let piece = |(start, part): (usize, &mut [f32])| {
        let mut factors = Vec::new();
        for (i, out) in part.iter_mut().enumerate() {
            *out = value(start * PIECE + i, &mut factors);
        }
    };
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        values.par_chunks_mut(PIECE).enumerate().for_each(piece);
    }
    #[cfg(not(feature = "rayon"))]
    values.chunks_mut(PIECE).enumerate().for_each(piece);
}
