//! What a graphics card has to know of strokes and suns: which rows light the cloud, how brightly, and what comes straight.

use super::{Clouds, LightReport, SunSource, Viewer};
use crate::error::RuntimeError;
use crate::frame::Flash;
use crate::in_scattered::InScattered;
use crate::relight::{PointLight, SourceWeight};
use crate::single_scatter::beam_shares;
use crate::stroke::Stroke;
use glam::DVec3;
use squall_formats::section::response::{DirectTerm, DistantKind, SUN_TOLERANCE_RAD};
use std::sync::Arc;

/// Where scattered light comes from.
pub(crate) enum Scattered {
    /// Sums of rows.
    Rows(Vec<SourceWeight>),
    /// J towards the viewer in every cell of the rows' grid: some of it no row answers for, and was solved for.
    Values(Vec<f32>),
}

/// The light of points.
pub(crate) struct Parts {
    pub scattered: Scattered,
    /// Points whose direct light is not in it.
    pub direct: Vec<PointLight>,
    pub report: LightReport,
}

impl Clouds {
    /// The strokes of `flashes`, as far as they can be seen by `viewer`.
    ///
    /// Errors: as [`Clouds::add_flashes`], light that is solved for aside.
    pub(crate) fn strokes_of(
        &self,
        flashes: &[Flash],
        viewer: Viewer,
    ) -> Result<Vec<Arc<Stroke>>, RuntimeError> {
        viewer.check(&self.relighter)?;
        let strokes = self.strokes.find(flashes)?;
        for (stroke, flash) in strokes.iter().zip(flashes) {
            flash.check_brightness(stroke)?;
            if flash.brightness > 0.0 {
                stroke.check()?;
            }
        }
        Ok(strokes)
    }

    /// What the light of `lights` is made of.
    ///
    /// Errors: as [`Clouds::light`].
    pub(crate) fn parts_of(&mut self, lights: &[PointLight], viewer: Viewer) -> Result<Parts, RuntimeError> {
        let inside = !self.gathers()
            && !self.relighter.has_finer()
            && lights.iter().all(|light| self.relighter.reaches(light.position));
        if !inside {
            let light = self.light(lights)?;
            let report = LightReport {
                lights: light.lights(),
                sources: light.sources(),
                live: light.lights_outside(),
                kept: 0,
                residual: light.residual(),
            };
            // The card reads light on the rows' grid.
            #[cfg(feature = "live")]
            let light = if self.gathers() { light.on_rows_grid() } else { light };
            let scattered = Scattered::Values(self.values_towards(&light.in_scattered(), viewer));
            return Ok(Parts { scattered, direct: light.direct, report });
        }
        let weights = self.relighter.weigh(lights, &mut self.buffers)?.to_vec();
        let report =
            LightReport { lights: lights.len(), sources: weights.len(), live: 0, kept: 0, residual: None };
        let in_rows = self.relighter.direct() == DirectTerm::InRows;
        let direct = if in_rows { Vec::new() } else { lights.to_vec() };
        Ok(Parts { scattered: Scattered::Rows(weights), direct, report })
    }

    fn values_towards(&self, light: &InScattered<'_>, viewer: Viewer) -> Vec<f32> {
        let grid = self.relighter.light_cloud();
        let mut values = vec![0.0; grid.shape.len()];
        light.towards_each(grid, |_, middle| viewer.direction_from(middle), &mut values);
        values
    }

    /// The row of a hemisphere of the sky.
    pub(crate) fn hemisphere(&self, kind: DistantKind) -> Option<SourceWeight> {
        let source = self.relighter.response().head.distant.iter().find(|source| source.kind == kind);
        source.map(|source| SourceWeight { row: source.row, intensity: 1.0 })
    }

    /// What a sun of 1 W/m² in direction `towards` (unit) lights the cloud by, where that came from, and whether its direct light is
    /// still to be added ([`Clouds::beam`]).
    ///
    /// Errors: as [`Clouds::sun`].
    pub(crate) fn sun_parts(
        &mut self,
        towards: DVec3,
        viewer: Viewer,
    ) -> Result<(SunSource, Option<Scattered>, bool), RuntimeError> {
        let relighter = self.relighter.clone();
        let head = &relighter.response().head;
        if head.distant.is_empty() {
            return Ok((SunSource::Missing, None, false));
        }
        let old = self.old_beam();
        if relighter.sun(towards, &mut self.buffers)?.is_some() {
            let weights = self.buffers.weights().to_vec();
            return Ok((SunSource::Baked, Some(Scattered::Rows(weights)), old.is_none()));
        }
        if let Some((kind, beam)) = old
            && head.sun.is_none()
            && let Some(row) = self.hemisphere(kind)
        {
            let away = beam.angle_between(towards);
            let near = away <= SUN_TOLERANCE_RAD;
            if near || !cfg!(feature = "live") {
                let source = if near { SunSource::Baked } else { SunSource::Elsewhere(away.to_degrees()) };
                return Ok((source, Some(Scattered::Rows(vec![row])), false));
            }
        }
        self.solved_sun(towards, viewer)
    }

    #[cfg(not(feature = "live"))]
    fn solved_sun(
        &mut self,
        towards: DVec3,
        viewer: Viewer,
    ) -> Result<(SunSource, Option<Scattered>, bool), RuntimeError> {
        // It says what is missing, and solves for nothing.
        let mut none = vec![0.0; self.cloud().shape.len()];
        Ok((self.solve_sun(towards, viewer, &mut none)?, None, false))
    }

    #[cfg(feature = "live")]
    fn solved_sun(
        &mut self,
        towards: DVec3,
        viewer: Viewer,
    ) -> Result<(SunSource, Option<Scattered>, bool), RuntimeError> {
        let solver = match self.solver.take() {
            Some(solver) => solver,
            None => super::solve::solver_of(&self.relighter)?,
        };
        let solved = super::solve::scattered_sun(&self.relighter, &solver, towards);
        self.solver = Some(solver);
        let live = solved?;
        let basis = self.relighter.response().head.basis;
        let cells = self.relighter.light_cloud().shape.len();
        let planes = vec![0.0; cells * basis.count()];
        let frame = self.relighter.view_region_frame();
        let rows = crate::relight::Relit { basis, frame, cells, planes: &planes };
        let values = self.values_towards(&InScattered { rows, live: &live, direct: &[] }, viewer);
        Ok((SunSource::Live, Some(Scattered::Values(values)), true))
    }

    /// Direct light of a sun of 1 W/m² in direction `towards`, per cell: what was never scattered, and that with what was scattered
    /// forward alone, W/m² over 1.
    pub(crate) fn beam(&self, towards: DVec3) -> Vec<[f32; 2]> {
        beam_shares(self.cloud(), self.relighter.extinction_scale(), -towards)
    }
}
