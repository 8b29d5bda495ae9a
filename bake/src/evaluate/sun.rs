//! Suns that no beam was baked for, and what they say of a response's bytes.

use super::views::Views;
use crate::error::BakeError;
use crate::progress::Progress;
use crate::recipe::model::ResponseSettings;
use crate::response::cache::ResponseCache;
use crate::response::{Job, Sources, WantedLights, solve_rows};
use glam::DVec3;
use rayon::prelude::*;
use squall_formats::haar::Haar;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::response::{DirectTerm, DirectionalBasis, DistantKind, SunDirections};
use squall_runtime::relight::{RelightBuffers, Relighter, Relit, view_region_frame};
use squall_runtime::transport::Cloud;

/// Suns with the cloud's light under them as it is seen, solved directly.
pub struct SunSet {
    views: Views,
    suns: Vec<DVec3>,
    /// Light of each sun beyond its direct light, and that.
    light: Vec<(Vec<f32>, Vec<f32>)>,
}

impl SunSet {
    /// Solves in `cloud`'s cells, or in `shown`'s whose blocks those are ([`Job::shown`]), for `suns` (unit vectors towards them) as `settings` says that rows are, in all degrees that the solver has. Viewpoints are
    /// those of `number`.
    ///
    /// Errors: a solve that does not converge, an interruption.
    pub fn solve(
        (cloud, shown): (&Cloud, Option<&Cloud>),
        settings: &ResponseSettings,
        suns: &[DVec3],
        (number, cache): (u64, Option<&ResponseCache>),
        progress: &dyn Progress,
    ) -> Result<Self, BakeError> {
        let basis = DirectionalBasis::Harmonics { degree: 3 };
        let settings = ResponseSettings { basis, direct: DirectTerm::AtRunTime, ..*settings };
        let grid = LightGrid { x_m: vec![0.0], y_m: vec![0.0], z_m: vec![0.0] };
        let lights = WantedLights { grid, wanted: vec![false] };
        let beam = |sun: &DVec3| DistantKind::Sun { direction: (-*sun).to_array() };
        let distant = suns.iter().map(beam).collect();
        let sources = Sources { lights, distant, sun: Some(SunDirections::Path) };
        let job =
            Job { cloud, sources: &sources, settings: &settings, held_out: &[], known: None, shown, cache };
        let solved = solve_rows(&job, progress)?;
        let head = &solved.head;
        let views = Views::new(cloud, settings.view_region.as_ref(), number, |cell| head.sees(cell));
        let (factors, haar) = (views.factors(basis, None), Haar::new(cloud.shape));
        let scale = head.solver.extinction_scale;
        let one = |(sun, planes): (&DVec3, &Vec<f32>)| {
            let (mut planes, mut scratch) = (planes.clone(), Vec::new());
            planes.chunks_exact_mut(haar.len()).for_each(|plane| haar.inverse(plane, &mut scratch));
            let relit = Relit { basis, frame: None, cells: haar.len(), planes: &planes };
            (views.light(&relit, &factors), views.direct_beam(cloud, scale, -*sun))
        };
        let light = suns.par_iter().zip(&solved.planes).map(one).collect();
        Ok(Self { views, suns: suns.to_vec(), light })
    }

    /// Relative L2 error of each sun's light from `relighter`'s bytes, direct light included on both sides.
    ///
    /// Errors: a sun that its beams do not cover is off beyond any measure; a damaged row.
    pub fn errors(&self, relighter: &Relighter) -> Result<Vec<f64>, BakeError> {
        let frame = relighter.view_region().map(|region| view_region_frame(region, relighter.light_cloud()));
        let factors = self.views.factors(relighter.response().head.basis, frame.as_ref());
        let mut buffers = RelightBuffers::default();
        let mut errors = Vec::with_capacity(self.suns.len());
        for (sun, (scattered, direct)) in self.suns.iter().zip(&self.light) {
            let Some(relit) = relighter.sun(*sun, &mut buffers)? else {
                errors.push(f64::INFINITY);
                continue;
            };
            errors.push(self.off(self.views.light(&relit, &factors), scattered, direct));
        }
        Ok(errors)
    }

    /// Error of light beyond direct light.
    fn off(&self, mut found: Vec<f32>, scattered: &[f32], direct: &[f32]) -> f64 {
        let sum = |light: &mut [f32]| light.iter_mut().zip(direct).for_each(|(sum, value)| *sum += value);
        let mut wanted = scattered.to_vec();
        sum(&mut found);
        sum(&mut wanted);
        self.views.compare(&found, &wanted).l2
    }

    /// The suns.
    pub fn suns(&self) -> &[DVec3] {
        &self.suns
    }

    /// The error of sun number `at` of a mix of beams: their places among the asset's distant lights, and weights.
    ///
    /// Errors: a damaged row.
    pub fn error_of_mix(
        &self,
        relighter: &Relighter,
        at: usize,
        mix: &[(DistantKind, f64)],
    ) -> Result<f64, BakeError> {
        let frame = relighter.view_region().map(|region| view_region_frame(region, relighter.light_cloud()));
        let factors = self.views.factors(relighter.response().head.basis, frame.as_ref());
        let (scattered, direct) = &self.light[at];
        let mut found = vec![0.0f32; scattered.len()];
        let mut buffers = RelightBuffers::default();
        for &(kind, weight) in mix {
            let Some(relit) = relighter.distant(kind, &mut buffers)? else { continue };
            let light = self.views.light(&relit, &factors);
            found.iter_mut().zip(light).for_each(|(sum, value)| *sum += weight as f32 * value);
        }
        Ok(self.off(found, scattered, direct))
    }
}
