//! The cloud in the light of the sky: its two hemispheres, and the sun wherever it stands.
//!
//! Of the sun an asset holds what the cloud scatters beyond direct light, for beams from a set of directions; light of a sun between
//! them is mixed from theirs, and direct light is followed through the grid. A sun that no beam covers is solved for on the spot
//! with feature `live`, and refused without it. Assets from before there were such beams hold one beam at most, all its light in
//! one row.

use super::light::spread_towards;
use super::{Clouds, DirectExtent, Viewer};
use crate::error::RuntimeError;
use crate::in_scattered::InScattered;
use crate::single_scatter::{add_direct_beam, add_direct_beam_near};
use glam::DVec3;
use squall_formats::section::response::{DistantKind, SUN_TOLERANCE_RAD};

/// Where the sun's light on a cloud came from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum SunSource {
    /// No sun reaches the cloud.
    #[default]
    Down,
    /// Mixed from the asset's beams.
    Baked,
    /// Solved for on the spot: no beam covers it.
    Live,
    /// The asset holds one beam, from another direction, so many degrees away; its light was shown.
    Elsewhere(f64),
    /// The asset holds no light of the sun, or none of any sky: the cloud was left without.
    Missing,
}

impl Clouds {
    /// In-scattered radiance J per cell of a sun in direction `towards` (unit), direct light included, towards `viewer`, for an irradiance
    /// of 1 W/m² on a surface that faces it, W/(m² sr), into `out`; never negative.
    ///
    /// Says where the light came from. Errors: a direction that is no unit vector; without feature `live` a sun that none of the asset's
    /// beams of it covers; a viewer outside the asset's view region; a damaged row; a live solve that does not converge; `out`
    /// is not one grid long.
    pub fn sun(
        &mut self,
        towards: DVec3,
        viewer: impl Into<Viewer>,
        out: &mut [f32],
    ) -> Result<SunSource, RuntimeError> {
        self.sun_in(towards, (viewer.into(), DirectExtent::Everywhere), out)
    }

    /// [`Clouds::sun`] with direct light in a part of the cells.
    pub(crate) fn sun_in(
        &mut self,
        towards: DVec3,
        (viewer, extent): (Viewer, DirectExtent),
        out: &mut [f32],
    ) -> Result<SunSource, RuntimeError> {
        self.check_length(out.len())?;
        if !towards.is_normalized() {
            return Err(RuntimeError::argument("sun", "a unit vector towards it", towards));
        }
        viewer.check(&self.relighter)?;
        let source = self.scattered_sun(towards, viewer, out)?;
        if let SunSource::Baked | SunSource::Live = source {
            let cloud = self.relighter.cloud();
            // Old beams have their direct light inside.
            if self.old_beam().is_none() || source == SunSource::Live {
                let scale = self.relighter.extinction_scale();
                match extent {
                    DirectExtent::Everywhere => {
                        add_direct_beam(cloud, scale, -towards, &viewer.ways(cloud), out);
                    }
                    DirectExtent::NearCloud => {
                        let near = (cloud, scale, self.relighter.cloud_distances());
                        let seen = self.relighter.seen_by(viewer);
                        let cells = (self.relighter.near_cells(), seen.ways.as_slice());
                        add_direct_beam_near(near, -towards, cells, out);
                    }
                }
            }
        }
        out.iter_mut().for_each(|value| *value = value.max(0.0));
        Ok(source)
    }

    /// A beam of the sun with its direct light inside, and the direction towards that sun.
    pub(super) fn old_beam(&self) -> Option<(DistantKind, DVec3)> {
        let beam = |kind: DistantKind| match kind {
            DistantKind::Beam { direction } => Some((kind, -DVec3::from_array(direction))),
            _ => None,
        };
        self.relighter.response().head.distant.iter().find_map(|source| beam(source.kind))
    }

    /// Light of the sun but for what [`Clouds::sun`] adds.
    fn scattered_sun(
        &mut self,
        towards: DVec3,
        viewer: Viewer,
        out: &mut [f32],
    ) -> Result<SunSource, RuntimeError> {
        let relighter = self.relighter.clone();
        if relighter.response().head.distant.is_empty() {
            // Baked to be seen by its own flashes alone.
            out.fill(0.0);
            return Ok(SunSource::Missing);
        }
        if let Some(relit) = relighter.sun(towards, &mut self.buffers)? {
            spread_towards(&relighter, &InScattered::of(relit), viewer, out);
            return Ok(SunSource::Baked);
        }
        let old = self.old_beam().map(|(kind, beam)| (kind, beam.angle_between(towards)));
        if let Some((kind, away)) = old
            && (away <= SUN_TOLERANCE_RAD || !cfg!(feature = "live"))
            && relighter.response().head.sun.is_none()
            && let Some(relit) = relighter.distant(kind, &mut self.buffers)?
        {
            spread_towards(&relighter, &InScattered::of(relit), viewer, out);
            let near = away <= SUN_TOLERANCE_RAD;
            return Ok(if near { SunSource::Baked } else { SunSource::Elsewhere(away.to_degrees()) });
        }
        self.solve_sun(towards, viewer, out)
    }

    #[cfg(not(feature = "live"))]
    pub(super) fn solve_sun(
        &self,
        towards: DVec3,
        _: Viewer,
        out: &mut [f32],
    ) -> Result<SunSource, RuntimeError> {
        if self.relighter.response().head.sun.is_none() {
            out.fill(0.0);
            return Ok(SunSource::Missing);
        }
        let wanted = "a sun that the asset's beams cover (see `squall inspect`). Feature `live` of squall-runtime solves for any other on \
                      the spot";
        let elevation = libm::asin(towards.z.clamp(-1.0, 1.0)).to_degrees();
        let azimuth = libm::atan2(towards.y, towards.x).to_degrees();
        Err(RuntimeError::argument(
            "sky sun",
            wanted,
            format!("azimuth {azimuth:.1}°, elevation {elevation:.1}°"),
        ))
    }

    #[cfg(feature = "live")]
    fn solve_sun(
        &mut self,
        towards: DVec3,
        viewer: Viewer,
        out: &mut [f32],
    ) -> Result<SunSource, RuntimeError> {
        let solver = match self.solver.take() {
            Some(solver) => solver,
            None => super::solve::solver_of(&self.relighter)?,
        };
        let solved = super::solve::scattered_sun(&self.relighter, &solver, towards);
        self.solver = Some(solver);
        let live = solved?;
        let cells = self.relighter.light_cloud().shape.len();
        // No row takes part.
        let planes = vec![0.0; cells * self.relighter.response().head.basis.count()];
        let rows = crate::relight::Relit {
            basis: self.relighter.response().head.basis,
            frame: self.relighter.view_region_frame(),
            cells,
            planes: &planes,
        };
        spread_towards(&self.relighter, &InScattered { rows, live: &live, direct: &[] }, viewer, out);
        Ok(SunSource::Live)
    }

    /// The light of the two hemispheres of the sky towards `viewer`, J per unit of radiance, one after the other as far as the asset
    /// holds them; whether it holds both.
    pub(crate) fn hemispheres(
        &mut self,
        viewer: Viewer,
        mut each: impl FnMut(DistantKind, &[f32]),
    ) -> Result<bool, RuntimeError> {
        let relighter = self.relighter.clone();
        let mut j = vec![0.0; relighter.cloud().shape.len()];
        let mut found = 0;
        for kind in [DistantKind::UpperSky, DistantKind::LowerSky] {
            let Some(relit) = relighter.distant(kind, &mut self.buffers)? else { continue };
            spread_towards(&relighter, &InScattered::of(relit), viewer, &mut j);
            each(kind, &j);
            found += 1;
        }
        Ok(found == 2)
    }

    /// Whether a sun in direction `towards` (unit) is covered by what the asset holds.
    pub fn holds_sun(&self, towards: DVec3) -> bool {
        let head = &self.relighter.response().head;
        match &head.sun {
            Some(sun) => sun.weights(&head.suns(), towards.to_array()).is_some(),
            None => self.old_beam().is_some_and(|(_, beam)| beam.angle_between(towards) <= SUN_TOLERANCE_RAD),
        }
    }
}
