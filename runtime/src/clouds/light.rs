//! The light of some points in a cloud, before anyone looks at it.

use crate::camera::{Camera, Projection};
use crate::error::RuntimeError;
use crate::in_scattered::InScattered;
use crate::relight::{PointLight, Relighter, Relit};
use crate::single_scatter::{DirectRays, DirectSettings, add_direct, add_direct_fluence, add_direct_near};
use crate::transport::Cloud;
use crate::transport::fit::mean_of_reading;
use glam::DVec3;
use squall_formats::section::response::{DirectionalBasis, Stored};
use std::sync::Arc;

/// Rays that direct light's fluence is made of, over all lights, and of one light at least and at most.
const FLUENCE_RAYS: usize = 1 << 22;
const FLUENCE_RAYS_PER_LIGHT: [usize; 2] = [1024, 1 << 16];

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

    /// The unit direction from the middle of each of `cloud`'s cells to the viewer.
    pub(super) fn ways(self, cloud: &Cloud) -> Vec<[f32; 3]> {
        let way = |cell| self.direction_from(cloud.centre(cloud.shape.cell(cell))).as_vec3().to_array();
        (0..cloud.shape.len()).map(way).collect()
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

/// Where direct light is worked out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DirectExtent {
    /// In every cell, air too: light as data.
    Everywhere,
    /// In cloud and one cell around it: all that a march through the cloud reads.
    NearCloud,
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
    #[cfg(feature = "live")]
    pub(super) gathered: Option<super::GatherReport>,
    pub(super) lights: usize,
    pub(super) lights_outside: usize,
    pub(super) sources: usize,
}

impl CloudLight {
    /// The grid that the light is known on: the rows', or where it was gathered the cloud's own.
    pub fn cells(&self) -> &Cloud {
        #[cfg(feature = "live")]
        if self.gathered.is_some() {
            return self.relighter.cloud();
        }
        self.relighter.light_cloud()
    }

    /// Whether the light is known on larger cells than the cloud's.
    fn is_coarse(&self) -> bool {
        self.cells().shape != self.relighter.cloud().shape
    }

    /// Whether cells hold light that was fitted to be read between their middles, and not its means.
    fn holds_fits(&self) -> bool {
        let in_rows = self.relighter.response().head.stored == Stored::Fit;
        #[cfg(feature = "live")]
        return in_rows && !(self.gathered.is_some() && self.relighter.is_coarse());
        #[cfg(not(feature = "live"))]
        in_rows
    }

    /// Means over cells of what [`CloudLight::cells`] hold, `width` values each.
    fn means(&self, values: &[f32], width: usize) -> Vec<f32> {
        let refine = self.relighter.response().head.solver.refine;
        mean_of_reading(self.cells(), refine, values, width)
    }

    /// The same light on the rows' grid, as means over its cells.
    #[cfg(feature = "live")]
    #[doc(hidden)]
    #[must_use]
    pub fn on_rows_grid(&self) -> Self {
        let (rows, cells) = (self.relighter.light_cloud().shape, self.cells().shape);
        let down = [0, 1, 2].map(|axis: usize| (cells.to_array()[axis] / rows.to_array()[axis]) as u32);
        let index = crate::transport::cloud::CoarseIndex::new(cells, down);
        let fits = self.holds_fits();
        let means = |values: &[f32], width: usize| match fits {
            true => self.means(values, width),
            false => index.means(values, width),
        };
        let plane = |plane: &[f32]| means(plane, 1);
        Self {
            relighter: self.relighter.clone(),
            basis: self.basis,
            planes: self.planes.chunks_exact(cells.len()).flat_map(plane).collect(),
            direct: self.direct.clone(),
            live: if self.live.is_empty() { Vec::new() } else { means(&self.live, 16) },
            live_report: self.live_report,
            gathered: None,
            lights: self.lights,
            lights_outside: self.lights_outside,
            sources: self.sources,
        }
    }

    /// The light as the rows hold it; nothing where it went into gathers ([`super::LightQuality::gathers`]).
    pub fn relit(&self) -> Relit<'_> {
        Relit {
            basis: self.basis,
            frame: self.relighter.view_region_frame(),
            cells: self.cells().shape.len(),
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

    /// How gathers went, if there were any. The light of rows and live solves is one then.
    #[cfg(feature = "live")]
    pub fn gather_report(&self) -> Option<super::GatherReport> {
        self.gathered
    }

    /// In-scattered radiance J towards `viewer` per cell, direct light included, W/(m² sr), into `out`; never negative. Direct light
    /// alone in cells whose scattered light the asset left out ([`Relighter::known_cells`]).
    ///
    /// Errors: a viewer outside the asset's view region; `out` is not one grid long.
    pub fn radiance(&self, viewer: impl Into<Viewer>, out: &mut [f32]) -> Result<(), RuntimeError> {
        let viewer = viewer.into();
        viewer.check(&self.relighter)?;
        self.check_length(out.len())?;
        self.towards(viewer, (self.settings(), DirectExtent::Everywhere), out);
        out.iter_mut().for_each(|value| *value = value.max(0.0));
        Ok(())
    }

    /// Fluence rate φ per cell, W/m², into `out`: light of all orders, direct light included; never negative. 0 in cells whose light
    /// the asset left out because no ray shades with them.
    ///
    /// Errors: an asset baked for a view region, whose rows hold light towards that alone; `out` is not one grid long.
    pub fn fluence(&self, out: &mut [f32]) -> Result<(), RuntimeError> {
        self.check_length(out.len())?;
        check_fluence(self.relighter.response().head.basis)?;
        let lit = self.in_scattered();
        let relighter = &self.relighter;
        out.fill(0.0);
        add_direct_fluence(
            relighter.cloud(),
            relighter.extinction_scale(),
            &self.direct,
            self.settings(),
            out,
        );
        let mut spread: Vec<f32> = (0..self.cells().shape.len()).map(|cell| lit.fluence(cell)).collect();
        if self.is_coarse() {
            let scattered = std::mem::replace(&mut spread, vec![0.0; out.len()]);
            relighter.spread(&scattered, &mut spread);
        } else if self.holds_fits() {
            spread = self.means(&spread, 1);
        }
        let known = relighter.known_cells();
        for (cell, value) in out.iter_mut().enumerate() {
            // A codec's error may leave a dark cell below zero; fluence is not. Cut off with the direct light there, it moves the
            // mean least.
            let whole = (*value + spread[cell]).max(0.0);
            *value = if known[cell] { whole } else { 0.0 };
        }
        Ok(())
    }

    /// The residual that the last gather found, if there was any.
    pub(super) fn residual(&self) -> Option<f64> {
        #[cfg(feature = "live")]
        return self.gathered.map(|report| report.residual);
        #[cfg(not(feature = "live"))]
        None
    }

    fn settings(&self) -> DirectSettings {
        let [fewest, most] = FLUENCE_RAYS_PER_LIGHT;
        let rays_per_point = (FLUENCE_RAYS / self.direct.len().max(1)).clamp(fewest, most) as u32;
        DirectSettings { rays: DirectRays::PerPoint(rays_per_point), ..DirectSettings::default() }
    }

    fn check_length(&self, found: usize) -> Result<(), RuntimeError> {
        let cells = self.relighter.cloud().shape.len();
        if found == cells {
            return Ok(());
        }
        Err(RuntimeError::argument("cells", format!("{cells} values, one a cell of the cloud's grid"), found))
    }

    /// J towards a viewer that was checked, as it is: the codec may leave it below zero.
    pub(super) fn towards(
        &self,
        viewer: Viewer,
        (settings, extent): (DirectSettings, DirectExtent),
        out: &mut [f32],
    ) {
        let (cloud, scale) = (self.relighter.cloud(), self.relighter.extinction_scale());
        if self.is_coarse() || !self.relighter.is_coarse() {
            spread_towards(&self.relighter, &self.in_scattered(), viewer, out);
        } else {
            // Gathered on the cloud's own cells.
            let towards = |middle: DVec3| viewer.direction_from(middle);
            self.in_scattered().towards_known(cloud, &self.relighter.known_cells(), towards, out);
        }
        if extent == DirectExtent::Everywhere && self.relighter.is_coarse() {
            // Blocks that nobody sees hold what codes best, which is nobody's light; between blocks it was read too.
            let known = self.relighter.known_cells();
            out.iter_mut().zip(known).filter(|(_, known)| !known).for_each(|(value, _)| *value = 0.0);
        }
        if self.direct.is_empty() {
            return;
        }
        match extent {
            DirectExtent::Everywhere => {
                add_direct(cloud, scale, &self.direct, &viewer.ways(cloud), settings, out);
            }
            DirectExtent::NearCloud => {
                let near = (cloud, scale, self.relighter.cloud_distances());
                let seen = self.relighter.seen_by(viewer);
                let cells = (self.relighter.near_cells(), seen.ways.as_slice());
                add_direct_near(near, cells, &self.direct, settings, out);
            }
        }
    }

    /// J of rows and live light, without direct light that is in neither.
    pub fn in_scattered(&self) -> InScattered<'_> {
        InScattered { rows: self.relit(), live: &self.live, direct: &[] }
    }
}

/// Refuses fluence of rows that do not hold it.
pub(super) fn check_fluence(basis: DirectionalBasis) -> Result<(), RuntimeError> {
    let DirectionalBasis::ViewRegion { .. } = basis else { return Ok(()) };
    let wanted = "an asset with light in all directions: this one was baked for a view region, and its rows hold light \
                  towards that alone (bake without it, with basis \"harmonics-…\" or \"directions-26\")";
    Err(RuntimeError::argument("fluence", wanted, "light towards a view region"))
}

/// J in each of the cloud's cells in its own direction to the viewer, spread from the cells that the light is known for.
pub(super) fn spread_towards(relighter: &Relighter, light: &InScattered<'_>, viewer: Viewer, j: &mut [f32]) {
    let towards = |middle: DVec3| viewer.direction_from(middle);
    if !relighter.is_coarse() {
        let of_rows = light.live.is_empty() && light.direct.is_empty();
        if of_rows && relighter.known_towards(&relighter.seen_by(viewer), light.rows.planes, j) {
            return;
        }
        return light.towards_known(relighter.cloud(), &relighter.known_light_cells(), towards, j);
    }
    let towards = |_: usize, middle: DVec3| viewer.direction_from(middle);
    let grid = relighter.light_cloud();
    let mut coarse = vec![0.0; grid.shape.len()];
    light.towards_each(grid, towards, &mut coarse);
    relighter.spread(&coarse, j);
}
