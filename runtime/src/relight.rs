//! Clouds lit by a stroke: from points of light to virtual point lights to coefficients per cell. \[dobashi\] §7.
//!
//! A stroke's points are split over the virtual sources around them (eq. 6), the sources' rows are summed number by
//! number (eq. 9) and each coefficient is transformed back once (eq. 8). Rows are read as they lie in the asset; those
//! that no point touches are never looked at.

use crate::camera::{Camera, Projection};
use crate::error::RuntimeError;
use crate::load::Asset;
use crate::single_scatter::WantedCells;
use crate::transport::{Boundary, Cloud};
use glam::DVec3;
use squall_formats::ReadError;
use squall_formats::basis::DirectionalBasis;
use squall_formats::haar::Haar;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::cloud::CloudSection;
use squall_formats::section::response::{
    DirectTerm, DistantKind, ResponseHead, ResponseSection, SourceBasis, accumulate, coefficient_planes,
};
use squall_formats::sphere;
use squall_formats::view_region::{ViewRegion, ViewRegionFrame};
pub use squall_transport::PointLight;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// A virtual source's row and the intensity that a stroke gives it, W/sr.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceWeight {
    /// Row of the response.
    pub row: u32,
    /// Intensity e_l, W/sr.
    pub intensity: f32,
}

mod finer;
mod known;
mod lit;
mod response;
mod towards;

pub use response::Response;

/// A response opened for relighting. It holds its asset.
pub struct Relighter {
    asset: Asset,
    response: Response,
    cloud: Cloud,
    /// The grid of the rows where its cells are blocks of the cloud's.
    blocks: Option<Cloud>,
    haar: Haar,
    /// The view region's frame, where rows are towards it alone.
    frame: Option<ViewRegionFrame>,
    /// Rows whose checksum has been seen to be right.
    verified: Vec<AtomicBool>,
    /// Of each finer level its nodes with their rows, nodes rising.
    finer: Vec<Vec<(u32, u32)>>,
    /// Steps from each of the cloud's cells to the nearest with cloud in it, once asked for.
    distances: OnceLock<Vec<u8>>,
    /// Cells within a step of cloud, once asked for.
    near: OnceLock<WantedCells>,
    /// Cells whose light means something, once asked for.
    known: OnceLock<towards::KnownCells>,
    /// What lights share towards the last viewer.
    towards: towards::LastTowards,
}

/// Memory of relighting calls; nothing is allocated once it has grown to a stroke's size.
#[derive(Clone, Debug, Default)]
pub struct RelightBuffers {
    weights: Vec<SourceWeight>,
    parts: Vec<(u32, f64)>,
    coefficients: Vec<f32>,
    scratch: Vec<f32>,
    window: Vec<f32>,
}

impl RelightBuffers {
    /// The rows that the last relighting summed, and their intensities.
    pub fn weights(&self) -> &[SourceWeight] {
        &self.weights
    }
}

/// The coefficients of a relit cloud's in-scattered radiance J ([`squall_formats::basis`]) per cell, W/(m² sr) per unit of basis,
/// one plane a coefficient.
#[derive(Clone, Copy, Debug)]
pub struct Relit<'a> {
    /// What the planes mean.
    pub basis: DirectionalBasis,
    /// The view region's frame, where the light is towards it alone.
    pub frame: Option<ViewRegionFrame>,
    /// Cells per plane.
    pub cells: usize,
    /// `basis.count()` planes of `cells` values, x fastest.
    pub planes: &'a [f32],
}

/// How rows are summed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RelightOptions {
    /// Adds \[dobashi\] eq. 10's ambient term Σ e_l γ_l to every cell. It is there to be compared with: what the codec leaves
    /// out has zero mean, so the term turns an error of a few per cent into a multiple of the light.
    pub paper_ambient: bool,
}

impl Relighter {
    /// Opens the cloud grid and the response of `asset`.
    ///
    /// Errors: the asset lacks either, or they are damaged.
    pub fn new(asset: &Asset) -> Result<Self, RuntimeError> {
        let grid = asset.section(CloudSection::TAG, "the cloud grid", CloudSection::read)?;
        asset.check_bulk(CloudSection::TAG)?;
        grid.check_values().map_err(|error| asset.wrap(error))?;
        let response = Response::new(asset)?;
        let head = grid.head;
        let blocks = response.blocks(head.shape).map_err(|error| asset.wrap(error))?;
        light_grid(&response.head.sources).map_err(|error| asset.wrap(error))?;
        let cloud = Cloud {
            shape: head.shape,
            cell_m: head.cell_m,
            origin_m: DVec3::from_array(head.origin_m),
            extinction: grid.extinction.values().into_owned(),
            albedo: head.albedo,
            g: head.g,
            boundary: if head.periodic_xy { Boundary::PeriodicXy } else { Boundary::Open },
        };
        let cloud = cloud.checked()?;
        let haar = Haar::new(response.head.shape);
        let blocks = (blocks != [1; 3]).then(|| cloud.coarsened(blocks)).transpose()?;
        let verified = (0..response.row_count()).map(|_| AtomicBool::new(false)).collect();
        let frame =
            response.head.view_region.as_ref().map(|view_region| view_region_frame(view_region, &cloud));
        let finer = finer::nodes_of(&response.head);
        Ok(Self {
            asset: asset.clone(),
            response,
            cloud,
            blocks,
            haar,
            frame,
            verified,
            finer,
            distances: OnceLock::new(),
            near: OnceLock::new(),
            known: OnceLock::new(),
            towards: towards::LastTowards::default(),
        })
    }

    /// The cloud grid.
    pub fn cloud(&self) -> &Cloud {
        &self.cloud
    }

    /// The grid whose cells the rows hold light for: the cloud's, or equal blocks of its cells with their mean extinction.
    pub fn light_cloud(&self) -> &Cloud {
        self.blocks.as_ref().unwrap_or(&self.cloud)
    }

    /// Whether the rows hold light for blocks of the cloud's cells.
    pub fn is_coarse(&self) -> bool {
        self.blocks.is_some()
    }

    /// Values of [`Relighter::light_cloud`]'s cells read in the middles of the cloud's cells, trilinear between centres.
    ///
    /// Panics when an array is not one grid long.
    pub fn spread(&self, light: &[f32], cells: &mut [f32]) {
        assert!(light.len() == self.light_cloud().shape.len() && cells.len() == self.cloud.shape.len());
        let Some(blocks) = &self.blocks else { return cells.copy_from_slice(light) };
        for (cell, value) in cells.iter_mut().enumerate() {
            *value =
                crate::shade::cloud::between(blocks, light, self.cloud.centre(self.cloud.shape.cell(cell)));
        }
    }

    /// A solver with the rows' discretisation, whose light comes out as theirs is stored.
    ///
    /// Errors: no solver can follow their record.
    #[cfg(feature = "live")]
    pub fn live_solver(&self) -> Result<crate::live::LiveSolver, RuntimeError> {
        crate::clouds::solver_of(self)
    }

    /// The response's rows and what they mean.
    pub fn response(&self) -> &Response {
        &self.response
    }

    /// An error of this asset's bytes.
    #[cfg(feature = "gpu")]
    pub(crate) fn wrap(&self, error: ReadError) -> RuntimeError {
        self.asset.wrap(error)
    }

    /// The transform that the rows are in.
    #[cfg(feature = "gpu")]
    pub(crate) fn haar(&self) -> &Haar {
        &self.haar
    }

    /// Whether direct light is left to the caller.
    pub fn direct(&self) -> DirectTerm {
        self.response.head.direct
    }

    /// Extinction after delta scaling over extinction before: what [`crate::single_scatter::add_direct`] needs to know.
    pub fn extinction_scale(&self) -> f64 {
        self.response.head.solver.extinction_scale
    }

    /// Where the viewpoint may be; anywhere where `None`.
    pub fn view_region(&self) -> Option<&ViewRegion> {
        self.response.head.view_region.as_ref()
    }

    /// The view region's frame, where rows are for that alone.
    pub(crate) fn view_region_frame(&self) -> Option<ViewRegionFrame> {
        self.frame
    }

    /// Whether the light holds for what `camera` sees.
    ///
    /// Errors: it is outside the view region that the asset was baked for; an orthographic camera has no viewpoint and is outside of any.
    pub fn check_camera(&self, camera: &Camera) -> Result<(), RuntimeError> {
        self.check_viewer(match camera.projection {
            Projection::Perspective { .. } => Some(camera.position),
            Projection::Orthographic { .. } => None,
        })
    }

    /// The same for somebody at `position`, or infinitely far away.
    pub(crate) fn check_viewer(&self, position: Option<DVec3>) -> Result<(), RuntimeError> {
        let Some(view_region) = self.view_region() else { return Ok(()) };
        if position.is_some_and(|position| view_region.contains(position.to_array())) {
            return Ok(());
        }
        let [low, high] = [view_region.low_m, view_region.high_m].map(DVec3::from_array);
        let wanted =
            format!("a viewpoint between {low} and {high} m: the asset's cloud was baked for those alone");
        let found = position.map_or("an orthographic camera".into(), |position| position.to_string());
        Err(RuntimeError::argument("camera position", wanted, found))
    }

    /// Whether a light at `position` can be split over the virtual point lights that were baked.
    pub fn reaches(&self, position: DVec3) -> bool {
        let sources = &self.response.head.sources;
        let around = sources.light_grid().and_then(|(grid, _)| grid.nodes_around(position.to_array()));
        around.is_some_and(|nodes| nodes.iter().all(|&node| sources.row_of(node).is_some()))
    }

    /// The box that virtual point lights span, smallest and largest corner, m: an outer bound. Of a pruned asset only a small part of
    /// it is lit: see [`Relighter::share_lit`] and [`Relighter::nearest_lit`].
    pub fn bounds(&self) -> [DVec3; 2] {
        corners(self.light_grid())
    }

    /// Splits a stroke's points over virtual sources; the intensities sum to the stroke's.
    ///
    /// Errors: a point that is not finite or whose light was not baked.
    pub fn weigh<'b>(
        &self,
        lights: &[PointLight],
        buffers: &'b mut RelightBuffers,
    ) -> Result<&'b [SourceWeight], RuntimeError> {
        split_into((&self.response.head, &self.finer), lights, buffers)?;
        Ok(&buffers.weights)
    }

    /// The point nearest to `position` whose light was baked, m; `None` where nothing was, or of a place that is not finite.
    pub fn nearest_lit(&self, position: DVec3) -> Option<DVec3> {
        lit::nearest(&self.response.head.sources, position)
    }

    /// Share of the box of [`Relighter::bounds`] in which light was baked, 0 to 1.
    pub fn share_lit(&self) -> f64 {
        share_lit(&self.response.head.sources)
    }

    /// Why a point light at `position` cannot be relit from rows; `None` where it can.
    pub fn why_dark(&self, position: DVec3) -> Option<RuntimeError> {
        (!self.reaches(position)).then(|| lit::refusal(&self.response.head.sources, position))
    }

    /// Relights the cloud by a stroke's points.
    ///
    /// Errors: a point whose light was not baked, or a damaged row.
    pub fn relight<'b>(
        &self,
        lights: &[PointLight],
        options: RelightOptions,
        buffers: &'b mut RelightBuffers,
    ) -> Result<Relit<'b>, RuntimeError> {
        split_into((&self.response.head, &self.finer), lights, buffers)?;
        self.sum_rows(options, buffers)
    }

    /// The cloud in distant light of unit strength; `None` where the asset has no row for it.
    ///
    /// Errors: a damaged row.
    pub fn distant<'b>(
        &self,
        kind: DistantKind,
        buffers: &'b mut RelightBuffers,
    ) -> Result<Option<Relit<'b>>, RuntimeError> {
        let Some(source) = self.response.head.distant.iter().find(|source| source.kind == kind) else {
            return Ok(None);
        };
        buffers.weights.clear();
        buffers.weights.push(SourceWeight { row: source.row, intensity: 1.0 });
        self.sum_rows(RelightOptions::default(), buffers).map(Some)
    }

    /// What the cloud scatters of a sun of irradiance 1 W/m² in direction `towards` (unit) beyond its direct light; `None` where the
    /// asset holds no beams of the sun, or none for a sun there.
    ///
    /// Errors: a damaged row.
    pub fn sun<'b>(
        &self,
        towards: DVec3,
        buffers: &'b mut RelightBuffers,
    ) -> Result<Option<Relit<'b>>, RuntimeError> {
        let head = &self.response.head;
        let Some(directions) = &head.sun else { return Ok(None) };
        let Some(weights) = directions.weights(&head.suns(), towards.to_array()) else {
            return Ok(None);
        };
        let beams = head.distant.iter().filter(|source| matches!(source.kind, DistantKind::Sun { .. }));
        let rows: Vec<u32> = beams.map(|source| source.row).collect();
        buffers.weights.clear();
        buffers.weights.extend(
            weights.iter().map(|&(beam, weight)| SourceWeight { row: rows[beam], intensity: weight as f32 }),
        );
        self.sum_rows(RelightOptions::default(), buffers).map(Some)
    }

    /// J towards `viewer` in every cell of [`Relighter::light_cloud`], of rows with these weights.
    #[cfg(all(test, feature = "gpu"))]
    pub(crate) fn towards_for_tests(
        &self,
        sources: &[SourceWeight],
        viewer: crate::clouds::Viewer,
    ) -> Vec<f32> {
        let mut buffers = RelightBuffers { weights: sources.to_vec(), ..RelightBuffers::default() };
        let Ok(rows) = self.sum_rows(RelightOptions::default(), &mut buffers) else { return Vec::new() };
        let mut j = vec![0.0; self.light_cloud().shape.len()];
        let towards = |_: usize, middle: DVec3| viewer.direction_from(middle);
        crate::in_scattered::InScattered::of(rows).towards_each(self.light_cloud(), towards, &mut j);
        j
    }

    /// Sums the rows that `buffers.weights` names and transforms every coefficient back.
    fn sum_rows<'b>(
        &self,
        options: RelightOptions,
        buffers: &'b mut RelightBuffers,
    ) -> Result<Relit<'b>, RuntimeError> {
        let (cells, basis) = (self.haar.len(), self.response.head.basis);
        let count = basis.count();
        buffers.coefficients.clear();
        buffers.coefficients.resize(cells * count, 0.0);
        self.response.fetch(buffers.weights.iter().map(|weight| weight.row as usize))?;
        // Rows in windows stand behind all others, and weights are sorted by row.
        let full = self.response.head.finer.first().map_or(u32::MAX, |level| level.first_row);
        let (whole, windowed) =
            buffers.weights.split_at(buffers.weights.partition_point(|weight| weight.row < full));
        for weight in whole {
            self.add_row(weight, &mut buffers.coefficients)?;
        }
        for (number, plane) in buffers.coefficients.chunks_exact_mut(cells).enumerate() {
            self.haar.inverse(plane, &mut buffers.scratch);
            if options.paper_ambient {
                let bound = |w: &SourceWeight| self.response.bounds_of(w.row as usize).get(number).copied();
                let ambient: f32 = buffers
                    .weights
                    .iter()
                    .map(|w| w.intensity * bound(w).unwrap_or_default().discarded)
                    .sum();
                plane.iter_mut().for_each(|value| *value += ambient);
            }
        }
        self.add_windows(windowed, (&mut buffers.window, &mut buffers.scratch), &mut buffers.coefficients)?;
        Ok(Relit { basis, frame: self.frame, cells, planes: &buffers.coefficients })
    }

    /// Adds a row's coefficients to those of `sums`, as many planes as the basis has.
    fn add_row(&self, weight: &SourceWeight, sums: &mut [f32]) -> Result<(), RuntimeError> {
        let (row, head) = (weight.row as usize, &self.response.head);
        let (count, cells) = (head.basis.count(), sums.len() / head.basis.count());
        let known = self.verified[row].load(Ordering::Relaxed);
        let bytes = if known { self.response.row_unchecked(row) } else { self.response.row(row) };
        let parts = coefficient_planes(bytes?, count).map_err(|error| self.asset.wrap(error))?;
        self.verified[row].store(true, Ordering::Relaxed);
        for (coefficients, sums) in parts.iter().zip(sums.chunks_exact_mut(cells)) {
            accumulate(coefficients, &self.response.code, weight.intensity, sums)
                .map_err(|error| self.asset.wrap(error))?;
        }
        Ok(())
    }

    /// The virtual point lights that the stroke last weighed was split over, each where it was baked.
    pub fn virtual_lights(&self, buffers: &RelightBuffers) -> Vec<PointLight> {
        let Some((grid, rows)) = self.response.head.sources.light_grid() else { return Vec::new() };
        let weight = |row: u32| buffers.weights.iter().find(|weight| weight.row == row);
        let lit = rows.iter().enumerate().filter_map(|(node, &row)| Some((node, weight(row)?)));
        lit.map(|(node, weight)| PointLight {
            position: DVec3::from_array(grid.position(node)),
            intensity: f64::from(weight.intensity),
        })
        .collect()
    }

    /// The grid of the virtual lights, which [`Relighter::new`] made sure of.
    fn light_grid(&self) -> &LightGrid {
        static NONE: LightGrid = LightGrid { x_m: Vec::new(), y_m: Vec::new(), z_m: Vec::new() };
        self.response.head.sources.light_grid().map_or(&NONE, |(grid, _)| grid)
    }

    /// How far each coefficient of the stroke last weighed can be from what was solved, as an L2 norm over cells: Σ |e_l| (γ_l + q_l).
    pub fn error_bounds(&self, buffers: &RelightBuffers) -> Vec<f64> {
        let mut sums = vec![0.0; self.response.head.basis.count()];
        for weight in &buffers.weights {
            for (sum, bound) in sums.iter_mut().zip(self.response.bounds_of(weight.row as usize)) {
                *sum += f64::from(weight.intensity.abs()) * f64::from(bound.total());
            }
        }
        sums
    }
}

/// The grid that virtual lights stand on. Errors: sources of a kind that this build cannot weigh.
fn light_grid(sources: &SourceBasis) -> Result<&LightGrid, ReadError> {
    sources.light_grid().map(|(grid, _)| grid).ok_or_else(|| ReadError::Invalid {
        section: ResponseSection::TAG,
        offset: None,
        field: "sources",
        wanted: "a light grid",
        found: "another kind".into(),
    })
}

/// Share of the box that a response's virtual point lights span in which all that a light needs was baked, 0 to 1.
pub fn share_lit(sources: &SourceBasis) -> f64 {
    lit::share(sources)
}

fn corners(grid: &LightGrid) -> [DVec3; 2] {
    grid.bounds().map(DVec3::from_array)
}

/// The weights that a response gives a stroke's points, rows rising. \[dobashi\] eq. 6.
///
/// Errors: a point that is not finite or whose light was not baked.
pub fn split_lights(head: &ResponseHead, lights: &[PointLight]) -> Result<Vec<SourceWeight>, RuntimeError> {
    let mut buffers = RelightBuffers::default();
    split_into((head, &finer::nodes_of(head)), lights, &mut buffers)?;
    Ok(buffers.weights)
}

/// Largest radiant intensity of a point, W/sr: times any row's light it stays within single precision.
pub(crate) const BRIGHTEST: f64 = 1e25;

fn split_into(
    (head, finer): (&ResponseHead, &[Vec<(u32, u32)>]),
    lights: &[PointLight],
    buffers: &mut RelightBuffers,
) -> Result<(), RuntimeError> {
    buffers.parts.clear();
    buffers.weights.clear();
    let Some((grid, _)) = head.sources.light_grid() else {
        return Err(RuntimeError::argument("sources", "a light grid", "another kind"));
    };
    for light in lights {
        // Written so that NaN is refused too.
        if light.intensity.abs().partial_cmp(&BRIGHTEST).is_none_or(|order| order.is_gt()) {
            let wanted = format!("at most {BRIGHTEST:e} W/sr");
            return Err(RuntimeError::argument("point light's intensity", wanted, light.intensity));
        }
        let parts = grid.split(light.position.to_array());
        // A node of share 0 takes no part, and needs no row.
        let mut covered = parts.is_some();
        for (node, share) in parts.into_iter().flatten().filter(|(_, share)| *share > 0.0) {
            match head.sources.row_of(node) {
                Some(row) => buffers.parts.push((row, share * light.intensity)),
                None => covered = false,
            }
        }
        if !covered {
            return Err(lit::refusal(&head.sources, light.position));
        }
        finer::split_into((head, finer), light, &mut buffers.parts);
    }
    // Sorted by share too, so that the order of summing does not depend on the sort's inner workings.
    buffers.parts.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    for group in buffers.parts.chunk_by(|a, b| a.0 == b.0) {
        let intensity = group.iter().map(|&(_, share)| share).sum::<f64>() as f32;
        buffers.weights.push(SourceWeight { row: group[0].0, intensity });
    }
    Ok(())
}

/// The frame of `view_region` for a cloud's grid.
pub fn view_region_frame(view_region: &ViewRegion, cloud: &Cloud) -> ViewRegionFrame {
    ViewRegionFrame::new(view_region, (0.5 * (cloud.origin_m + cloud.far_corner())).to_array())
}

/// Factors of each coefficient in direction `towards`: J(towards) = Σ factor × plane; [`DirectionalBasis::factors`] by the
/// vectors of this crate.
pub fn basis_factors(
    basis: DirectionalBasis,
    view_region: Option<(&ViewRegionFrame, DVec3)>,
    towards: DVec3,
    factors: &mut Vec<f32>,
) {
    let view = view_region.map(|(frame, cell)| (frame, cell.to_array()));
    basis.factors(towards.to_array(), view, factors);
}

impl Relit<'_> {
    /// J in cell `cell` towards the direction that `factors` were made for.
    pub fn value(&self, cell: usize, factors: &[f32]) -> f32 {
        factors.iter().enumerate().map(|(plane, f)| f * self.planes[plane * self.cells + cell]).sum()
    }

    /// Factors of each coefficient at a cell whose middle is `cell_m`, m, in direction `towards`: [`basis_factors`].
    pub fn factors(&self, cell_m: DVec3, towards: DVec3, factors: &mut Vec<f32>) {
        basis_factors(self.basis, self.frame.as_ref().map(|frame| (frame, cell_m)), towards, factors);
    }

    /// Fluence rate in cell `cell`, W/m²: J summed over the sphere; `None` where only light towards a view region is known.
    pub fn fluence(&self, cell: usize) -> Option<f32> {
        Some(match self.basis {
            DirectionalBasis::ViewRegion { .. } => return None,
            DirectionalBasis::Directions26 => {
                let weights = sphere::weights_26();
                let mean: f64 =
                    (0..26).map(|d| weights[d] * f64::from(self.planes[d * self.cells + cell])).sum();
                (mean * 4.0 * std::f64::consts::PI) as f32
            }
            DirectionalBasis::Harmonics { .. } => self.planes[cell] * libm::sqrtf(4.0 * std::f32::consts::PI),
        })
    }
}
