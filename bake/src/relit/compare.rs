//! Relit light beside the same lights solved for directly, and beside single scattering alone.
//!
//! \[dobashi\] Fig. 6 sets single beside multiple scattering; here stand both beside the asset's light, in pictures, in a cross-section of
//! fluence and in figures.

use super::{DirectFrom, RelitReport, is_exact, picture, relight, towards_camera, towards_viewer};
use crate::cloud::automatic_samples;
use crate::error::BakeError;
use crate::evaluate::relative_l2;
use crate::progress::Progress;
use glam::DVec3;
use squall_formats::section::response::{DirectionalBasis, SolverRecord};
use squall_runtime::Clouds;
use squall_runtime::camera::Camera;
use squall_runtime::in_scattered::InScattered;
use squall_runtime::live::{DirectCells, LiveSolver};
use squall_runtime::relight::{PointLight, Relit};
use squall_runtime::transport::cloud::CoarseIndex;
use squall_runtime::transport::{Cloud, direct::Light};

/// Directions of the solve that relit light is compared with: polar nodes per hemisphere and azimuths, twice as many each way as rows
/// usually have.
const DIRECTIONS: [u8; 2] = [4, 16];
/// Residual of that solve, far below what is compared.
const TOLERANCE: f64 = 1e-4;
/// Lights whose direct light is followed between two looks at whether somebody wants to stop.
const LIGHTS_AT_ONCE: usize = 8;
/// Share of pixels, the brightest of the truth, that one figure leaves out: a few pixels beside a light may hold most of Σr².
const BRIGHTEST: f64 = 0.01;
/// Pixels dimmer than this share of the truth's brightest have no part in a median: what is next to nothing is off by any factor.
const DIMMEST: f32 = 1e-4;

/// How far values x lie from the truth r.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Distance {
    /// √Σ(x−r)² / √Σr².
    pub l2: f64,
    /// The same without the hundredth of values whose truth is brightest.
    pub l2_without_brightest: f64,
    /// Median of |x−r|/r where r is above 10⁻⁴ of the largest.
    pub median: f64,
    /// Σx / Σr − 1; 0 where both are nothing, infinite where the truth alone is.
    pub mean: f64,
}

impl Distance {
    /// Distance of `found` from `wanted`, value by value.
    ///
    /// ```
    /// use squall_bake::relit::compare::Distance;
    /// let distance = Distance::of(&[1.0, 4.0], &[1.0, 3.0]);
    /// assert_eq!((distance.median, distance.mean), (0.0, 0.25));
    /// ```
    pub fn of(found: &[f32], wanted: &[f32]) -> Self {
        let mut order: Vec<usize> = (0..wanted.len().min(found.len())).collect();
        order.sort_by(|&a, &b| wanted[b].total_cmp(&wanted[a]));
        let brightest = libm::ceil(order.len() as f64 * BRIGHTEST) as usize;
        let rest = &order[brightest.min(order.len())..];
        let of = |values: &[f32]| rest.iter().map(|&at| values[at]).collect::<Vec<f32>>();
        let peak = order.first().map_or(0.0, |&at| wanted[at]);
        let mut off: Vec<f64> = order
            .iter()
            .filter(|&&at| wanted[at] > DIMMEST * peak)
            .map(|&at| f64::from((found[at] - wanted[at]).abs()) / f64::from(wanted[at]))
            .collect();
        off.sort_by(f64::total_cmp);
        let sum = |values: &[f32]| values.iter().map(|&value| f64::from(value)).sum::<f64>();
        let (all, truth) = (sum(found), sum(wanted));
        Self {
            l2: relative_l2(found, wanted),
            l2_without_brightest: relative_l2(&of(found), &of(wanted)),
            median: off.get(off.len().saturating_sub(1) / 2).copied().unwrap_or_default(),
            mean: match truth > 0.0 {
                true => all / truth - 1.0,
                false if all == 0.0 => 0.0,
                false => f64::INFINITY,
            },
        }
    }
}

/// A comparison's figures.
#[derive(Clone, Debug, serde::Serialize)]
pub struct CompareReport {
    /// The asset's picture, all light.
    pub whole: Distance,
    /// The asset's picture less light scattered once, against the truth less the same.
    pub scattered_again: Distance,
    /// Single scattering alone, against the whole truth: what leaving out the rest costs.
    pub single: Distance,
    /// Fluence rate per cell of the rows' grid, all light; none where the asset knows light towards its view region alone.
    pub fluence: Option<Distance>,
    /// The truth's directions, polar nodes per hemisphere and azimuths.
    pub truth_directions: [u8; 2],
    /// The truth's residual and sweeps.
    pub truth_residual: f64,
    /// Sweeps that it took.
    pub truth_sweeps: u32,
    /// How the relighting went.
    pub relit: RelitReport,
}

/// Fluence rate in a vertical section through the lights' middle, all light, W/m², row 0 = top.
#[derive(Clone, Debug)]
pub struct Section {
    /// Axis that the section stands across, 0 = x, 1 = y.
    pub across: usize,
    /// Middle of its cells along that axis, m.
    pub at_m: f64,
    /// Cells along a row.
    pub width: usize,
    /// Edges of a cell along and up, m.
    pub cell_m: [f64; 2],
    /// Of the asset, a value a cell.
    pub relit: Vec<f32>,
    /// Of the truth.
    pub truth: Vec<f32>,
}

/// Pictures of the same lights, radiance per pixel in W/(m² sr), row 0 = top.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// Pixels a row.
    pub width: usize,
    /// From the asset.
    pub relit: Vec<f32>,
    /// Solved for directly on the cloud's own cells.
    pub truth: Vec<f32>,
    /// Light scattered once alone.
    pub single: Vec<f32>,
    /// Where the asset knows fluence.
    pub section: Option<Section>,
    /// Figures.
    pub report: CompareReport,
}

/// Relights the asset's cloud by `lights` as `camera` sees it, solves for the same lights on the cloud's own cells, and compares.
///
/// Errors: as [`relight`]; a solve that does not converge.
pub fn compare(
    clouds: &mut Clouds,
    lights: &[PointLight],
    (name, camera): (&str, &Camera),
    direct_from: Option<DirectFrom>,
    progress: &dyn Progress,
) -> Result<Comparison, BakeError> {
    let towards_region =
        matches!(clouds.relighter().response().head.basis, DirectionalBasis::ViewRegion { .. });
    let (fields, relit) = relight(clouds, lights, (name, camera), direct_from, !towards_region, progress)?;
    let image = fields.images.into_iter().next().ok_or(BakeError::NoPicture)?.2.mean;

    let relighter = clouds.relighter();
    let cloud = relighter.cloud();
    let record = SolverRecord {
        refine: [1; 3],
        directions: DIRECTIONS,
        tolerance: TOLERANCE,
        ..relighter.response().head.solver.clone()
    };
    let solver = LiveSolver::new(cloud, &record).map_err(squall_runtime::RuntimeError::from)?;
    let exact = is_exact(lights, camera);
    let towards = if exact { Vec::new() } else { towards_camera(camera) };
    let direct = direct_cells(&solver, lights, &towards, progress)?;
    progress.begin("solve to compare with", 1);
    let solved = solver.solve(&direct, &mut |_| !progress.interrupted());
    progress.check()?;
    let solved = solved.map_err(squall_runtime::RuntimeError::from)?;

    let dark = vec![0.0; cloud.shape.len()];
    let none = Relit {
        basis: DirectionalBasis::Harmonics { degree: 0 },
        frame: None,
        cells: cloud.shape.len(),
        planes: &dark,
    };
    let means = match (exact, towards.is_empty()) {
        (true, _) => Vec::new(),
        (false, false) => direct.towards.clone(),
        (false, true) => towards_viewer((cloud, solver.extinction_scale()), lights, camera),
    };
    let exact: Vec<Light> = lights.iter().filter(|_| exact).map(|&light| light.into()).collect();
    let lit = InScattered { rows: none, live: &solved.coefficients, direct: &means };
    progress.begin("image to compare with", u64::from(camera.height));
    let truth = picture((relighter, cloud), &lit, &exact, camera, progress)?;
    progress.begin("image of single scattering", u64::from(camera.height));
    let single = picture((relighter, cloud), &InScattered { live: &[], ..lit }, &exact, camera, progress)?;

    let fluence = (!towards_region).then(|| {
        let rows = relighter.light_cloud();
        let all: Vec<f32> = (0..cloud.shape.len())
            .map(|cell| lit.fluence(cell) + direct.forward[cell] + direct.unscattered[cell])
            .collect();
        let counts = [cloud.shape.to_array(), rows.shape.to_array()];
        let factors = std::array::from_fn(|axis| (counts[0][axis] / counts[1][axis]) as u32);
        let truth = CoarseIndex::new(cloud.shape, factors).means(&all, 1);
        let found: Vec<f32> =
            fields.phi_scattered.mean.iter().zip(&fields.phi_direct.mean).map(|(a, b)| a + b).collect();
        let known = relighter.known_light_cells();
        let kept = |values: &[f32]| -> Vec<f32> {
            values.iter().zip(&known).filter(|(_, known)| **known).map(|(&value, _)| value).collect()
        };
        (Distance::of(&kept(&found), &kept(&truth)), section(rows, lights, camera, &found, &truth))
    });
    let again = |image: &[f32]| image.iter().zip(&single).map(|(all, once)| all - once).collect::<Vec<f32>>();
    let report = CompareReport {
        whole: Distance::of(&image, &truth),
        scattered_again: Distance::of(&again(&image), &again(&truth)),
        single: Distance::of(&single, &truth),
        fluence: fluence.as_ref().map(|(distance, _)| *distance),
        truth_directions: DIRECTIONS,
        truth_residual: solved.residual,
        truth_sweeps: solved.sweeps,
        relit,
    };
    let section = fluence.and_then(|(_, section)| section);
    Ok(Comparison { width: camera.width as usize, relit: image, truth, single, section, report })
}

/// The lights' own light per cell, some lights at a time. Errors: an interruption.
fn direct_cells(
    solver: &LiveSolver,
    lights: &[PointLight],
    towards: &[DVec3],
    progress: &dyn Progress,
) -> Result<DirectCells, BakeError> {
    let samples = automatic_samples(1);
    let mut sum = solver.direct(&[], towards, samples);
    progress.begin("direct light to compare with", lights.len() as u64);
    for some in lights.chunks(LIGHTS_AT_ONCE) {
        progress.check()?;
        sum.add(&solver.direct(some, towards, samples));
        progress.advance(some.len() as u64);
    }
    Ok(sum)
}

/// The section that faces the camera and goes through the lights' centre of intensity, or the grid's middle without any. None of an
/// empty grid.
fn section(
    cloud: &Cloud,
    lights: &[PointLight],
    camera: &Camera,
    relit: &[f32],
    truth: &[f32],
) -> Option<Section> {
    let sum = lights.iter().map(|light| light.intensity.abs()).sum::<f64>();
    let middle = match sum > 0.0 {
        true => lights.iter().map(|light| light.intensity.abs() / sum * light.position).sum(),
        false => (cloud.origin_m + cloud.far_corner()) / 2.0,
    };
    let across = usize::from(camera.forward.y.abs() >= camera.forward.x.abs());
    let counts = cloud.shape.to_array();
    let along = 1 - across;
    let at = ((middle - cloud.origin_m)[across] / cloud.cell_m[across]).floor();
    let at = at.clamp(0.0, counts[across] as f64 - 1.0) as usize;
    let cells: Vec<usize> = (0..counts[2])
        .rev()
        .flat_map(|z| (0..counts[along]).map(move |x| (x, z)))
        .map(|(x, z)| {
            let mut cell = [0, 0, z];
            (cell[across], cell[along]) = (at, x);
            cloud.shape.index(cell[0], cell[1], cell[2])
        })
        .collect();
    let of =
        |values: &[f32]| cells.iter().map(|&cell| values.get(cell).copied()).collect::<Option<Vec<f32>>>();
    Some(Section {
        across,
        at_m: cloud.centre(cloud.shape.cell(*cells.first()?))[across],
        width: counts[along],
        cell_m: [cloud.cell_m[along], cloud.cell_m[2]],
        relit: of(relit)?,
        truth: of(truth)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_distance_is_what_its_definition_says() {
        // A hundred and one values: the two brightest count for the whole alone.
        let wanted: Vec<f32> = (0..101).map(|i| if i < 2 { 100.0 } else { 1.0 }).collect();
        let mut found = wanted.clone();
        (found[0], found[50]) = (110.0, 1.5);
        let distance = Distance::of(&found, &wanted);
        let l2 = |a: f64, b: f64| (a / b).sqrt();
        assert!((distance.l2 - l2(100.25, 20_099.0)).abs() < 1e-12);
        assert!((distance.l2_without_brightest - l2(0.25, 99.0)).abs() < 1e-12);
        assert_eq!(distance.median, 0.0);
        assert!((distance.mean - 10.5 / 299.0).abs() < 1e-12);
    }

    #[test]
    fn nothing_is_no_way_off_nothing() {
        for values in [&[][..], &[0.0; 4]] {
            let distance = Distance::of(values, values);
            assert_eq!((distance.median, distance.mean), (0.0, 0.0));
            assert!(distance.l2 == 0.0 && distance.l2_without_brightest == 0.0, "{distance:?}");
        }
    }

    #[test]
    fn a_section_goes_through_the_lights_and_its_top_row_is_the_top() {
        let shape = squall_formats::GridShape::new(4, 3, 2);
        let cloud = Cloud {
            shape,
            cell_m: [10.0, 20.0, 30.0],
            origin_m: DVec3::ZERO,
            extinction: vec![0.0; shape.len()],
            albedo: 1.0,
            g: 0.0,
            boundary: squall_runtime::transport::Boundary::Open,
        };
        let lights = [PointLight { position: DVec3::new(5.0, 50.0, 10.0), intensity: 2.0 }];
        let values: Vec<f32> = (0..shape.len()).map(|cell| cell as f32).collect();
        let look = |forward: DVec3| {
            let projection =
                squall_runtime::camera::Projection::Orthographic { half_width: 10.0, half_height: 10.0 };
            Camera::new(DVec3::ZERO, forward, DVec3::Z, projection, [8, 8]).unwrap()
        };
        let ahead = section(&cloud, &lights, &look(DVec3::Y), &values, &values).unwrap();
        assert_eq!((ahead.across, ahead.at_m, ahead.width), (1, 50.0, 4));
        assert_eq!(ahead.relit, [20.0, 21.0, 22.0, 23.0, 8.0, 9.0, 10.0, 11.0]);
        let aside = section(&cloud, &lights, &look(DVec3::X), &values, &values).unwrap();
        assert_eq!((aside.across, aside.width, aside.cell_m), (0, 3, [20.0, 30.0]));
        assert_eq!(aside.relit, [12.0, 16.0, 20.0, 0.0, 4.0, 8.0]);
    }
}
