//! Clouds lit by given point lights from an asset: one picture, and per-cell fields in the layout of `squall solve`.
//!
//! Lights that the asset's rows answer for are split over its virtual point lights and relit; others are solved for on the spot
//! (squall_runtime::clouds), with the discretisation of the rows. Where light that comes straight from the lights is taken
//! from is a choice for assets whose rows hold it ([`DirectFrom`]).
//!
//! | field | rows with direct light, taken from the rows | else |
//! |---|---|---|
//! | phi_dir | never scattered light of the virtual sources, exact | of the lamps themselves, exact |
//! | phi_sc | the rows' fluence rate less the virtual sources' direct light | the rows' fluence rate, and light scattered forward only, of the lamps themselves |
//! | jcam, image | the rows' J | the rows' J without direct light, and that of the lamps themselves |

pub mod compare;

use crate::cloud::automatic_samples;
use crate::cloud::image::{Sampling, shortest};
use crate::error::BakeError;
use crate::fields::Fields;
use crate::progress::Progress;
use crate::response::add_direct;
use glam::DVec3;
use squall_formats::section::response::{DirectTerm, DirectionalBasis};
use squall_formats::sphere;
use squall_runtime::Clouds;
use squall_runtime::RuntimeError;
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::clouds::CloudLight;
use squall_runtime::in_scattered::InScattered;
use squall_runtime::live::DirectCells;
use squall_runtime::relight::{PointLight, RelightBuffers, RelightOptions, Relighter};
use squall_runtime::shade::cloud::direct::ExactDirect;
use squall_runtime::shade::cloud::{
    Cells, CloudMarch, MarchQuality, WideRay, between, corners, direction_to,
};
use squall_runtime::single_scatter::{self, DirectRays, DirectSettings};
use squall_runtime::transport::Cloud;
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

/// Lamps times pixels up to which direct light is followed for every ray of the picture; beyond, it is a mean per cell, which
/// [`RelitReport::exact_direct`] says.
pub const EXACT_WORK: usize = 1 << 18;
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
    /// Lights that no row answers for, solved for on the spot.
    #[serde(rename = "lamps_outside")]
    pub lights_outside: usize,
    /// Virtual sources touched.
    pub sources: usize,
    /// Smallest and largest corner of the box in which lamps can be relit, m; parts of it may not have been baked.
    pub reach_m: [[f64; 3]; 2],
    /// `rows` or `lamps`.
    pub direct: &'static str,
    /// Weights, sum over rows and inverse transforms, ms. The first time rows are read, checksums included.
    pub relight_ms: f64,
    /// Bound of the relit planes' distance from the uncompressed rows, Σ e_l (γ_l + q_l), as an L2 norm over cells and
    /// coefficients relative to the planes' own.
    pub error_bound: f64,
    /// Sweeps and residual of the live solve, and its seconds.
    pub live: Option<LiveReport>,
    /// How gathers went, if there were any.
    pub gathered: Option<GatheredReport>,
    /// Whether direct light was followed for every ray of the picture.
    pub exact_direct: bool,
}

/// How gathers over all light went: [`squall_runtime::clouds::GatherReport`].
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct GatheredReport {
    /// Sweeps whose light was taken.
    pub sweeps: u32,
    /// Residual that the last of them found, above that of the light now.
    pub residual: f64,
    /// Whether sweeps stopped because the light came no closer.
    pub stopped: bool,
}

impl std::fmt::Display for GatheredReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} gathers, the last of which found a residual of {:.3} %",
            self.sweeps,
            100.0 * self.residual
        )?;
        if self.stopped { f.write_str("; light came no closer with more") } else { Ok(()) }
    }
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
    clouds: &mut Clouds,
    lights: &[PointLight],
    (name, camera): (&str, &Camera),
    direct_from: Option<DirectFrom>,
    cells: bool,
    progress: &dyn Progress,
) -> Result<(Fields, RelitReport), BakeError> {
    let from = direct_source(clouds.relighter(), camera, direct_from, cells)?;
    let (inside, outside): (Vec<PointLight>, Vec<PointLight>) =
        lights.iter().partition(|light| clouds.is_lit(light.position));
    let rows = RowCost::measure(clouds.relighter(), &inside)?;
    let (mut light, live) = lit(clouds, lights, progress)?;
    let relighter = clouds.relighter();
    let head = &relighter.response().head;

    let solver = relighter.live_solver()?;
    let samples = match automatic_samples(head.solver.refine.into_iter().min().unwrap_or(1)) {
        fine if lights.len() <= MANY_LAMPS => fine,
        fine => fine.min(2),
    };
    let directions = sphere::directions_26().map(DVec3::from_array);
    let strip = |planes: &mut [f32]| {
        let direct = solver.direct(&rows.virtual_lights, &directions, SAMPLES_OF_ROWS);
        add_direct(head.basis, &direct.towards, -1.0, planes);
    };
    if head.direct == DirectTerm::InRows && from == DirectFrom::Lamps {
        strip(light.planes_mut());
    }
    progress.check()?;

    let towards = towards_camera(camera);
    let rays = if from == DirectFrom::Lamps { lights } else { &outside };
    let exact = is_exact(rays, camera);
    // Direct light of the lamps that the rows do not answer for, towards an orthographic camera.
    let cell_direct =
        (cells || !exact && !towards.is_empty()).then(|| solver.direct(rays, &towards, samples));
    progress.check()?;
    let mut fields = Fields::default();
    if cells && let Some(direct) = &cell_direct {
        // Without what the rows hold of direct light, and that light apart.
        let mut light = light.on_rows_grid();
        let mut planes = light.relit().planes.to_vec();
        let mut known = direct.clone();
        if from == DirectFrom::Rows {
            strip(&mut planes);
            known.add(&solver.direct(&rows.virtual_lights, &[], SAMPLES_OF_ROWS));
        }
        light.planes_mut().swap_with_slice(&mut planes);
        fluence_fields(relighter, &light, &known, &mut fields);
        light.planes_mut().swap_with_slice(&mut planes);
        if let Some(&towards) = towards.first() {
            towards_field(relighter, (&light, &direct.towards), (name, towards), &mut fields);
        }
    }

    let direct = match cell_direct {
        _ if exact => Vec::new(),
        Some(direct) if !towards.is_empty() => direct.towards,
        _ => towards_viewer((light.cells(), relighter.extinction_scale()), rays, camera),
    };
    let exact_lights: Vec<Light> = rays.iter().filter(|_| exact).map(|&light| light.into()).collect();
    progress.begin("image", u64::from(camera.height));
    let gathered = light.gather_report();
    // An orthographic camera's means per cell are on the rows' grid; beside them so is all light.
    let apart = !direct.is_empty() && direct.len() != light.cells().shape.len();
    let light = if apart { light.on_rows_grid() } else { light };
    let lit = InScattered { direct: &direct, ..light.in_scattered() };
    let image = picture((relighter, light.cells()), &lit, &exact_lights, camera, progress)?;
    fields.images.push((name.to_owned(), camera.width as usize, image.into()));
    let report = RelitReport {
        lights: lights.len(),
        lights_outside: outside.len(),
        sources: rows.virtual_lights.len(),
        reach_m: relighter.bounds().map(|corner| corner.to_array()),
        direct: if from == DirectFrom::Rows { "rows" } else { "lamps" },
        relight_ms: rows.milliseconds,
        error_bound: rows.error_bound,
        live,
        gathered: gathered.map(|report| GatheredReport {
            sweeps: report.sweeps,
            residual: report.residual,
            stopped: report.stopped,
        }),
        exact_direct: exact,
    };
    Ok((fields, report))
}

/// The direction from the cloud to an orthographic camera; none of a perspective one.
fn towards_camera(camera: &Camera) -> Vec<DVec3> {
    match camera.projection {
        Projection::Orthographic { .. } => vec![-camera.forward],
        Projection::Perspective { .. } => Vec::new(),
    }
}

/// Whether direct light of `lights` is followed for every ray of the camera's picture.
fn is_exact(lights: &[PointLight], camera: &Camera) -> bool {
    lights.len() * (camera.width * camera.height) as usize <= EXACT_WORK
}

/// Where direct light is to come from. Errors: what the asset was not baked for.
fn direct_source(
    relighter: &Relighter,
    camera: &Camera,
    asked: Option<DirectFrom>,
    cells: bool,
) -> Result<DirectFrom, BakeError> {
    let head = &relighter.response().head;
    relighter.check_camera(camera)?;
    if let (true, DirectionalBasis::ViewRegion { .. }) = (cells, head.basis) {
        let wanted = "a basis over the whole sphere: the asset's rows hold light towards its view region alone, and pictures can be made of them";
        return Err(RuntimeError::argument("fields", wanted, "fluence per cell asked for").into());
    }
    let in_rows = head.direct == DirectTerm::InRows;
    let from = asked.unwrap_or(if in_rows { DirectFrom::Rows } else { DirectFrom::Lamps });
    if from == DirectFrom::Rows && !in_rows {
        let (wanted, found) = ("\"lamps\": the asset's rows hold no direct light", "\"rows\"");
        return Err(RuntimeError::argument("direct light", wanted, found).into());
    }
    Ok(from)
}

/// What summing the rows takes, and how far it may be off.
struct RowCost {
    milliseconds: f64,
    error_bound: f64,
    virtual_lights: Vec<PointLight>,
}

impl RowCost {
    fn measure(relighter: &Relighter, inside: &[PointLight]) -> Result<Self, BakeError> {
        let start = Instant::now();
        let mut buffers = RelightBuffers::default();
        let relit = relighter.relight(inside, RelightOptions::default(), &mut buffers)?;
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
        let size = norm(&mut relit.planes.iter().map(|&v| f64::from(v)));
        let bound = norm(&mut relighter.error_bounds(&buffers).into_iter());
        let error_bound = if size > 0.0 { bound / size } else { 0.0 };
        Ok(Self { milliseconds, error_bound, virtual_lights: relighter.virtual_lights(&buffers) })
    }
}

/// The lamps' light: of rows, and solved for where no row answers.
fn lit(
    clouds: &mut Clouds,
    lights: &[PointLight],
    progress: &dyn Progress,
) -> Result<(CloudLight, Option<LiveReport>), BakeError> {
    let start = Instant::now();
    if lights.iter().any(|light| !clouds.is_lit(light.position)) {
        progress.begin("live solve", 1);
    }
    let light = clouds.light_watched(lights, &mut |_| !progress.interrupted());
    progress.check()?;
    let light = light?;
    let seconds = start.elapsed().as_secs_f64();
    let report = |live: squall_runtime::clouds::LiveReport| LiveReport {
        sweeps: live.sweeps,
        residual: live.residual,
        seconds,
    };
    let live = light.live_report().map(report);
    Ok((light, live))
}

/// Fluence of light that holds no direct part, and of that part.
fn fluence_fields(relighter: &Relighter, light: &CloudLight, known: &DirectCells, fields: &mut Fields) {
    // In cells that no ray shades with the rows hold what codes best, which is nobody's light.
    let (lit, known_cells) = (light.in_scattered(), relighter.known_light_cells());
    let scattered = (0..known_cells.len()).map(|cell| match known_cells[cell] {
        true => lit.fluence(cell) + known.forward[cell],
        false => 0.0,
    });
    fields.phi_scattered = scattered.collect::<Vec<f32>>().into();
    fields.phi_direct = known.unscattered.clone().into();
    if known_cells.contains(&false) {
        let seen = known_cells.iter().map(|&known| f32::from(u8::from(known)));
        fields.seen = Some(seen.collect::<Vec<f32>>().into());
    }
}

/// J towards an orthographic camera.
fn towards_field(
    relighter: &Relighter,
    (light, direct): (&CloudLight, &[f32]),
    (name, towards): (&str, DVec3),
    fields: &mut Fields,
) {
    let mut j = vec![0.0; direct.len()];
    light.in_scattered().towards_each(relighter.light_cloud(), |_, _| towards, &mut j);
    for ((value, direct), known) in j.iter_mut().zip(direct).zip(relighter.known_light_cells()) {
        *value = if known { *value + direct } else { 0.0 };
    }
    fields.towards.push((name.to_owned(), j.into()));
}

/// J of direct light towards a perspective camera, mean per cell.
fn towards_viewer(
    (cloud, extinction_scale): (&Cloud, f64),
    lights: &[PointLight],
    camera: &Camera,
) -> Vec<f32> {
    let to_viewer: Vec<[f32; 3]> = (0..cloud.shape.len())
        .map(|cell| direction_to(camera, cloud.centre(cloud.shape.cell(cell))).as_vec3().to_array())
        .collect();
    let [fewest, most] = CELL_RAYS_PER_LIGHT;
    let rays_per_point = (CELL_RAYS / lights.len().max(1)).clamp(fewest, most) as u32;
    let settings = DirectSettings { rays: DirectRays::PerPoint(rays_per_point), ..DirectSettings::default() };
    let mut j = vec![0.0; cloud.shape.len()];
    single_scatter::add_direct(cloud, extinction_scale, lights, &to_viewer, settings, &mut j);
    j
}

/// The picture: radiance per pixel, never negative.
fn picture(
    (relighter, grid): (&Relighter, &Cloud),
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
            let mut j = vec![0.0; grid.shape.len()];
            lit.towards_each(grid, |_, middle| direction_to(camera, middle), &mut j);
            Some(j)
        }
    };
    let image = Sampling::new(camera, cloud, lights).picture(progress, |x, y, width| {
        let ray = WideRay::new(camera.ray(x, y), camera.projection, width);
        match &even {
            Some(j) => march.march(&ray, |point| f64::from(between(grid, j, point))),
            None => {
                let factors = lit.factors(DVec3::ZERO, -ray.ray.direction);
                march.march(&ray, |point| {
                    let corners = corners(grid, point).into_iter();
                    let sum: f32 = corners.map(|(cell, weight)| weight * lit.value(cell, &factors)).sum();
                    f64::from(sum)
                })
            }
        }
        .radiance
    })?;
    // A codec's error may leave a dark pixel below zero; radiance is not.
    Ok(image.into_iter().map(|value| value.max(0.0)).collect())
}
