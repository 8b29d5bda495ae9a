//! Light of points that no row answers for, solved for on the spot with the rows' discretisation.

use super::light::LiveReport;
use crate::error::RuntimeError;
use crate::live::LiveSolver;
use crate::relight::{PointLight, Relighter};
use crate::transport::direct::Light;
use glam::DVec3;
use squall_formats::section::response::Stored;
use std::collections::BTreeMap;

/// Points above which their own light is traced with fewer rays each: what one misses the others see.
const MANY_LIGHTS: usize = 64;

/// Rays per boundary face of the solve grid and axis for direct light that a live solve starts from: about 8 a cell of the asset's
/// grid, and 2 at least; 2 where there are many points.
pub(super) fn samples_of(relighter: &Relighter, lights: usize) -> u32 {
    let refine = relighter.response().head.solver.refine.into_iter().min().unwrap_or(1);
    let fine = 8u32.div_ceil(refine.max(1)).max(2);
    if lights <= MANY_LIGHTS { fine } else { fine.min(2) }
}

/// A solver with the rows' discretisation, whose light comes out as theirs is stored. Errors: no solver can follow their record.
pub(crate) fn solver_of(relighter: &Relighter) -> Result<LiveSolver, RuntimeError> {
    let head = &relighter.response().head;
    Ok(match head.stored {
        Stored::Means => LiveSolver::new(relighter.light_cloud(), &head.solver)?,
        Stored::Fit => {
            let cells = (relighter.light_cloud(), relighter.cloud());
            LiveSolver::fitted(cells, &head.solver, relighter.view_region())?
        }
    })
}

/// J's harmonic coefficients per cell of what `lights` scatter, beyond their direct light.
///
/// Points in one solve cell start as one, at their centre of intensity: what they scatter is an answer per cell anyway.
pub(super) fn scattered(
    relighter: &Relighter,
    solver: &LiveSolver,
    lights: &[PointLight],
    watch: &mut dyn FnMut(f64) -> bool,
) -> Result<(Vec<f32>, LiveReport), RuntimeError> {
    let gathered = gathered(relighter, lights);
    let direct = solver.direct(&gathered, &[], samples_of(relighter, gathered.len()));
    let live = solver.solve(&direct, watch)?;
    Ok((live.coefficients, LiveReport { sweeps: live.sweeps, residual: live.residual }))
}

/// J's harmonic coefficients per cell of what a sun of irradiance 1 W/m² in direction `towards` scatters beyond its direct light.
pub(super) fn scattered_sun(
    relighter: &Relighter,
    solver: &LiveSolver,
    towards: DVec3,
) -> Result<Vec<f32>, RuntimeError> {
    let beam = Light::Beam { direction: -towards, irradiance: 1.0 };
    let direct = solver.direct_of(&[beam], &[], samples_of(relighter, 1));
    Ok(solver.solve(&direct, &mut |_| true)?.coefficients)
}

/// The points of one solve cell. What takes light away counts for their place as what adds some does.
#[derive(Default)]
struct Gathered {
    intensity: f64,
    size: f64,
    moment: DVec3,
}

fn gathered(relighter: &Relighter, lights: &[PointLight]) -> Vec<PointLight> {
    if lights.len() <= 1 {
        return lights.to_vec();
    }
    let cloud = relighter.light_cloud();
    let refine = relighter.response().head.solver.refine.map(f64::from);
    let edge = DVec3::from_array(cloud.cell_m) / DVec3::from_array(refine);
    let mut cells: BTreeMap<[i64; 3], Gathered> = BTreeMap::new();
    for light in lights {
        let at = ((light.position - cloud.origin_m) / edge).floor();
        let cell = cells.entry([at.x as i64, at.y as i64, at.z as i64]).or_default();
        cell.intensity += light.intensity;
        cell.size += light.intensity.abs();
        cell.moment += light.intensity.abs() * light.position;
    }
    let whole = cells.into_values().filter(|cell| cell.size > 0.0);
    let light = |cell: Gathered| PointLight { position: cell.moment / cell.size, intensity: cell.intensity };
    whole.map(light).collect()
}
