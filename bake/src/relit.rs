//! Clouds lit by given lamps from an asset: one picture, and per-cell fields in the layout of `squall solve`.
//!
//! Lamps inside the asset's reach are split over its virtual sources and relit; those outside are solved for on the spot
//! (squall_runtime::live), with the discretisation of the rows. Where light that comes straight from the lamps is taken
//! from is a choice for assets whose rows hold it ([`DirectFrom`]).
//!
//! | field | rows with direct light, taken from the rows | else |
//! |---|---|---|
//! | phi_dir | never scattered light of the virtual sources, exact | of the lamps themselves, exact |
//! | phi_sc | the rows' fluence rate less the virtual sources' direct light | the rows' fluence rate, and light scattered forward only, of the lamps themselves |
//! | jcam, image | the rows' J | the rows' J without direct light, and that of the lamps themselves |

use crate::cloud::automatic_samples;
use crate::cloud::image::{Sampling, shortest};
use crate::error::BakeError;
use crate::fields::Fields;
use crate::progress::Progress;
use crate::response::add_direct;
use glam::DVec3;
use squall_formats::section::response::{DirectTerm, DirectionalBasis};
use squall_formats::sphere;
use squall_runtime::RuntimeError;
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::in_scattered::InScattered;
use squall_runtime::live::{DirectCells, LiveLight, LiveSolver};
use squall_runtime::relight::{PointLight, RelightBuffers, RelightOptions, Relighter, Relit};
use squall_runtime::shade::cloud::direct::ExactDirect;
use squall_runtime::shade::cloud::{
    Cells, CloudMarch, MarchQuality, WideRay, between, corners, direction_to,
};
use squall_runtime::single_scatter::{self, DirectSettings};
use squall_runtime::transport::direct::Light;
use std::time::Instant;

/// Where light that comes straight from a lamp is taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DirectFrom {
    /// The rows: that of the virtual sources, compressed with them. Only where they hold it.
    Rows,
    /// The lamps themselves, worked out now.
    Lamps,
}

/// Lamps times pixels up to which direct light is followed for every ray of the picture; beyond, it is a mean per cell.
const EXACT_WORK: usize = 1 << 18;
/// Rays that a perspective picture's direct light per cell is made of, over all lamps, and for one lamp at least and at most.
const CELL_RAYS: usize = 1 << 22;
const CELL_RAYS_PER_LIGHT: [usize; 2] = [1024, 1 << 16];

/// Direct rays per boundary face of the solve grid and axis for light that is taken out of rows: a recipe's usual number has to
/// be met, not bettered.
const SAMPLES_OF_ROWS: u32 = 1;
/// Lamps above which their own light is traced with fewer rays each: what one misses the others see.
const MANY_LAMPS: usize = 64;

/// How a relighting went.
#[derive(Clone, Debug, serde::Serialize)]
pub struct RelitReport {
    /// Lamps in all.
    #[serde(rename = "lamps")]
    pub lights: usize,
    /// Lamps outside the asset's reach, solved for on the spot.
    #[serde(rename = "lamps_outside")]
    pub lights_outside: usize,
    /// Virtual sources touched.
    pub sources: usize,
    /// Smallest and largest corner of the box in which lamps can be relit, m; parts of it may not have been baked.
    pub reach_m: [[f64; 3]; 2],
    /// `rows` or `lights`.
    pub direct: &'static str,
    /// Weights, sum over rows and inverse transforms, ms. The first time rows are read, checksums included.
    pub relight_ms: f64,
    /// Bound of the relit planes' distance from the uncompressed rows, Σ e_l (γ_l + q_l), as an L2 norm over cells and
    /// channels relative to the planes' own.
    pub error_bound: f64,
    /// Sweeps and residual of the live solve, and its seconds.
    pub live: Option<LiveReport>,
    /// Whether direct light was followed for every ray of the picture.
    pub exact_direct: bool,
}

/// How the lamps outside were solved for.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct LiveReport {
    /// Sweeps.
    pub sweeps: u32,
    /// Residual that was left.
    pub residual: f64,
    /// Wall-clock seconds.
    pub seconds: f64,
}

/// Relights the asset's cloud by `lights`, as `camera` sees it; with `cells` the per-cell fields too.
///
/// Errors: rows without direct light asked for theirs, a camera or fields that the asset was not baked for, a damaged row, a live
/// solve that does not converge, an interruption.
pub fn relight(
    relighter: &Relighter<'_>,
    lights: &[PointLight],
    (name, camera): (&str, &Camera),
    direct_from: Option<DirectFrom>,
    cells: bool,
    progress: &dyn Progress,
) -> Result<(Fields, RelitReport), BakeError> {
    let (cloud, head) = (relighter.cloud(), &relighter.response().head);
    relighter.check_camera(camera)?;
    if let (true, DirectionalBasis::ViewRegion { .. }) = (cells, head.basis) {
        let wanted = "channels over the whole sphere: the asset's hold light towards eyes alone, and pictures can be made of them";
        return Err(RuntimeError::argument("fields", wanted, "fluence per cell asked for").into());
    }
    let in_rows = head.direct == DirectTerm::InRows;
    let from = direct_from.unwrap_or(if in_rows { DirectFrom::Rows } else { DirectFrom::Lamps });
    if from == DirectFrom::Rows && !in_rows {
        let (wanted, found) = ("\"lamps\": the asset's rows hold no direct light", "\"rows\"");
        return Err(RuntimeError::argument("direct light", wanted, found).into());
    }
    let (inside, outside): (Vec<PointLight>, Vec<PointLight>) =
        lights.iter().partition(|light| relighter.reaches(light.position));

    let start = Instant::now();
    let mut buffers = RelightBuffers::default();
    let relit = relighter.relight(&inside, RelightOptions::default(), &mut buffers)?;
    let relight_ms = start.elapsed().as_secs_f64() * 1e3;
    let (basis, frame, mut planes) = (relit.basis, relit.frame, relit.planes.to_vec());
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    let size = norm(&mut planes.iter().map(|&v| f64::from(v)));
    let bound = norm(&mut relighter.error_bounds(&buffers).into_iter());
    let virtual_lights = relighter.virtual_lights(&buffers);

    let solver = LiveSolver::new(cloud, &head.solver)?;
    let samples = match automatic_samples(head.solver.refine.into_iter().min().unwrap_or(1)) {
        fine if lights.len() <= MANY_LAMPS => fine,
        fine => fine.min(2),
    };
    let directions = sphere::directions_26().map(DVec3::from_array);
    let strip = |planes: &mut [f32]| {
        add_direct(
            basis,
            &solver.direct(&virtual_lights, &directions, SAMPLES_OF_ROWS).towards,
            -1.0,
            planes,
        );
    };
    if in_rows && from == DirectFrom::Lamps {
        strip(&mut planes);
    }
    progress.check()?;

    let towards: Vec<DVec3> = match camera.projection {
        Projection::Orthographic { .. } => vec![-camera.forward],
        Projection::Perspective { .. } => Vec::new(),
    };
    let outside_direct = solver.direct(&outside, &towards, samples);
    let live = match outside.is_empty() {
        true => None,
        false => Some(solve_outside(&solver, &outside_direct, progress)?),
    };
    let rays = if from == DirectFrom::Lamps { lights } else { &outside };
    let exact = rays.len() * (camera.width * camera.height) as usize <= EXACT_WORK;

    let mut fields = Fields::default();
    let rows = Relit { basis, frame, cells: cloud.shape.len(), planes: &planes };
    let live_coefficients = live.as_ref().map_or(&[][..], |(live, _)| &live.coefficients);
    let mut lit = InScattered { rows, live: live_coefficients, direct: &[] };
    // Direct light of the lamps that the rows do not answer for, towards an orthographic camera.
    let cell_direct = (cells || !exact && !towards.is_empty()).then(|| {
        let mut sum = outside_direct.clone();
        if from == DirectFrom::Lamps {
            sum.add(&solver.direct(&inside, &towards, samples));
        }
        sum
    });
    progress.check()?;
    if cells && let Some(direct) = &cell_direct {
        let mut bare = planes.clone();
        let mut known = direct.clone();
        if from == DirectFrom::Rows {
            strip(&mut bare);
            known.add(&solver.direct(&virtual_lights, &[], SAMPLES_OF_ROWS));
        }
        let bare = InScattered { rows: Relit { planes: &bare, ..rows }, ..lit };
        // In cells that no ray shades with the rows hold what codes best, which is nobody's light.
        let known_cells = relighter.known_cells();
        let known_in = |cell: usize, value: f32| if known_cells[cell] { value } else { 0.0 };
        let scattered =
            (0..cloud.shape.len()).map(|cell| known_in(cell, bare.fluence(cell) + known.forward[cell]));
        fields.phi_scattered = scattered.collect::<Vec<f32>>().into();
        fields.phi_direct = known.unscattered.into();
        if let Some(&towards) = towards.first() {
            let mut j = vec![0.0; cloud.shape.len()];
            lit.towards_each(cloud, |_, _| towards, &mut j);
            j.iter_mut().zip(&direct.towards).for_each(|(sum, value)| *sum += value);
            j.iter_mut().enumerate().for_each(|(cell, value)| *value = known_in(cell, *value));
            fields.towards.push((name.to_owned(), j.into()));
        }
        if known_cells.contains(&false) {
            let seen = known_cells.iter().map(|&known| f32::from(u8::from(known)));
            fields.seen = Some(seen.collect::<Vec<f32>>().into());
        }
    }

    let lights: Vec<Light> = rays.iter().filter(|_| exact).map(|&light| light.into()).collect();
    let direct = match cell_direct {
        _ if exact => Vec::new(),
        Some(direct) if !towards.is_empty() => direct.towards,
        _ => towards_viewer(relighter, rays, camera),
    };
    lit.direct = &direct;
    progress.begin("image", u64::from(camera.height));
    let image = picture(relighter, &lit, &lights, camera, progress)?;
    // A codec's error may leave a dark pixel below zero; radiance is not.
    let image: Vec<f32> = image.into_iter().map(|value| value.max(0.0)).collect();
    fields.images.push((name.to_owned(), camera.width as usize, image.into()));
    let report = RelitReport {
        lights: lights.len(),
        lights_outside: outside.len(),
        sources: virtual_lights.len(),
        reach_m: relighter.reach().map(|corner| corner.to_array()),
        direct: if from == DirectFrom::Rows { "rows" } else { "lamps" },
        relight_ms,
        error_bound: if size > 0.0 { bound / size } else { 0.0 },
        live: live.as_ref().map(|&(_, report)| report),
        exact_direct: exact,
    };
    Ok((fields, report))
}

/// Solves for what lamps that no row answers for scatter.
fn solve_outside(
    solver: &LiveSolver,
    direct: &DirectCells,
    progress: &dyn Progress,
) -> Result<(LiveLight, LiveReport), BakeError> {
    let start = Instant::now();
    progress.begin("live solve", 1);
    let solved = solver.solve(direct, &mut |_| !progress.interrupted());
    progress.check()?;
    let live = solved?;
    let seconds = start.elapsed().as_secs_f64();
    let report = LiveReport { sweeps: live.sweeps, residual: live.residual, seconds };
    Ok((live, report))
}

/// J of direct light towards a perspective camera, mean per cell.
fn towards_viewer(relighter: &Relighter<'_>, lights: &[PointLight], camera: &Camera) -> Vec<f32> {
    let cloud = relighter.cloud();
    let to_viewer: Vec<[f32; 3]> = (0..cloud.shape.len())
        .map(|cell| direction_to(camera, cloud.centre(cloud.shape.cell(cell))).as_vec3().to_array())
        .collect();
    let [fewest, most] = CELL_RAYS_PER_LIGHT;
    let rays_per_point = (CELL_RAYS / lights.len().max(1)).clamp(fewest, most) as u32;
    let settings = DirectSettings { rays_per_point, ..DirectSettings::default() };
    let mut j = vec![0.0; cloud.shape.len()];
    single_scatter::add_direct(cloud, relighter.extinction_scale(), lights, &to_viewer, settings, &mut j);
    j
}

/// The picture: radiance per pixel.
fn picture(
    relighter: &Relighter<'_>,
    lit: &InScattered<'_>,
    lights: &[Light],
    camera: &Camera,
    progress: &dyn Progress,
) -> Result<Vec<f32>, BakeError> {
    let cloud = relighter.cloud();
    let exact = ExactDirect { lights, extinction_scale: relighter.extinction_scale() };
    let march =
        CloudMarch::new(cloud, Cells, MarchQuality::measured(shortest(cloud.cell_m))).with_exact(exact);
    // Light towards a view region alone is that of each cell towards this viewpoint.
    let for_view_region = matches!(lit.rows.basis, DirectionalBasis::ViewRegion { .. });
    let even = match camera.projection {
        Projection::Perspective { .. } if !for_view_region => None,
        _ => {
            let mut j = vec![0.0; cloud.shape.len()];
            lit.towards_each(cloud, |_, middle| direction_to(camera, middle), &mut j);
            Some(j)
        }
    };
    Sampling::new(camera, cloud, lights).picture(progress, |x, y, width| {
        let ray = WideRay::new(camera.ray(x, y), camera.projection, width);
        match &even {
            Some(j) => march.march(&ray, |point| f64::from(between(cloud, j, point))),
            None => {
                let factors = lit.factors(DVec3::ZERO, -ray.ray.direction);
                march.march(&ray, |point| {
                    let corners = corners(cloud, point).into_iter();
                    let sum: f32 = corners.map(|(cell, weight)| weight * lit.value(cell, &factors)).sum();
                    f64::from(sum)
                })
            }
        }
        .radiance
    })
}
