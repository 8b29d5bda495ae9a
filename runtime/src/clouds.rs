//! The asset's cloud in the light of strokes, as data: in-scattered radiance towards a viewer, and fluence, per cell.
//!
//! A stroke's points are split over the asset's virtual point lights and their rows are summed ([`crate::relight`]); light that
//! comes straight from the stroke is added to that. Where virtual point lights were pruned or never stood, feature `live`
//! solves for the light on the spot with the rows' own discretisation, which takes seconds; without it such a stroke is refused
//! by name of the reason.
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | J | in-scattered radiance ∫ p(ω·ω') L(ω') dω', light scattered per unit of scattering coefficient | W/(m² sr) |
//! | φ | fluence rate ∫ L dω | W/m² |
//!
//! Light is linear: what a stroke of brightness 1 does towards a viewer is kept, and brightness and colour scale it.

#[cfg(feature = "gpu")]
pub(crate) mod card;
mod gather;
mod half;
mod kept;
mod light;
mod sky;
#[cfg(feature = "live")]
mod solve;

pub use gather::LightQuality;
pub use half::f16_bits;
#[cfg(feature = "gpu")]
pub(crate) use half::f16_value;
pub(crate) use light::DirectExtent;
pub use light::{CloudLight, LiveReport, Viewer};
pub use sky::SunSource;
#[cfg(feature = "live")]
pub(crate) use solve::solver_of;
#[cfg(feature = "live")]
pub use squall_transport::gather::GatherReport;

use crate::error::RuntimeError;
use crate::frame::Flash;
use crate::load::Asset;
use crate::parallel::prelude::*;
use crate::relight::{BRIGHTEST, PointLight, RelightBuffers, RelightOptions, Relighter};
use crate::single_scatter::{DirectRays, DirectSettings};
use crate::stroke::Strokes;
use crate::transport::Cloud;
use glam::{DVec3, Vec3, Vec4};
use kept::{Kept, MadeFor};
use squall_formats::section::response::DirectTerm;
use std::sync::Arc;

/// A cloud whose light can be asked for. It holds its asset, and keeps the light of strokes that it has seen.
///
/// ```
/// use squall_runtime::{Asset, Clouds, Flash, Stroke, glam::DVec3};
/// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
/// let mut clouds = Clouds::new(&Asset::open(path)?)?;
/// let [low, high] = clouds.bounds();
/// let spark = Stroke::from_points(&[0.5 * (low + high)], 1e6, [0.8, 0.75, 1.28])?;
/// let mut cells = vec![[0.0; 4]; clouds.cloud().shape.len()];
/// clouds.radiance(&[Flash::own(spark)], DVec3::ZERO, &mut cells)?;
/// assert!(cells.iter().any(|[_, _, blue, extinction]| *blue > 0.0 && *extinction > 0.0));
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
pub struct Clouds {
    relighter: Arc<Relighter>,
    strokes: Arc<Strokes>,
    buffers: RelightBuffers,
    kept: Kept,
    rays: DirectRays,
    quality: LightQuality,
    #[cfg(feature = "live")]
    solver: Option<crate::live::LiveSolver>,
    #[cfg(feature = "live")]
    gatherer: Option<gather::Gatherer>,
}

/// Cells that one thread takes at a time.
const CELLS_AT_ONCE: usize = 1 << 14;

/// What one call's light came from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct LightReport {
    pub lights: usize,
    pub sources: usize,
    pub live: usize,
    pub kept: usize,
    /// Largest residual that the last gather of a stroke's found.
    pub residual: Option<f64>,
}

impl LightReport {
    /// Takes in how far a stroke's light came.
    fn take_residual(&mut self, residual: Option<f64>) {
        self.residual = self.residual.into_iter().chain(residual).reduce(f64::max);
    }
}

impl Clouds {
    /// Opens the cloud of `asset`.
    ///
    /// Errors: the asset has no cloud or no response, or they are damaged.
    pub fn new(asset: &Asset) -> Result<Self, RuntimeError> {
        Self::with_strokes(asset, Arc::new(Strokes::of(asset)?))
    }

    pub(crate) fn with_strokes(asset: &Asset, strokes: Arc<Strokes>) -> Result<Self, RuntimeError> {
        Ok(Self {
            relighter: Arc::new(Relighter::new(asset)?),
            strokes,
            buffers: RelightBuffers::default(),
            kept: Kept::default(),
            rays: DirectRays::STILL,
            quality: LightQuality::PLAIN,
            #[cfg(feature = "live")]
            solver: None,
            #[cfg(feature = "live")]
            gatherer: None,
        })
    }

    /// The grid: shape, cells, extinction, optics.
    pub fn cloud(&self) -> &Cloud {
        self.relighter.cloud()
    }

    pub(crate) fn shared(&self) -> Arc<Relighter> {
        self.relighter.clone()
    }

    /// What the rows mean, and the rows themselves.
    pub fn relighter(&self) -> &Relighter {
        &self.relighter
    }

    /// The box that virtual point lights span, smallest and largest corner, m: an outer bound. A pruned asset lights a small part of
    /// it from its rows; ask [`Clouds::is_lit`] and [`Clouds::nearest_lit`].
    pub fn bounds(&self) -> [DVec3; 2] {
        self.relighter.bounds()
    }

    /// Whether a point light at `position` is lit from the rows alone.
    pub fn is_lit(&self, position: DVec3) -> bool {
        self.relighter.reaches(position)
    }

    /// The point nearest to `position` that is lit from the rows alone, m.
    ///
    /// ```
    /// use squall_runtime::{Asset, Clouds, glam::DVec3};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
    /// let clouds = Clouds::new(&Asset::open(path)?)?;
    /// let far = DVec3::new(1e5, 0.0, 0.0);
    /// assert!(!clouds.is_lit(far) && clouds.is_lit(clouds.nearest_lit(far).unwrap()));
    /// # Ok::<(), squall_runtime::RuntimeError>(())
    /// ```
    pub fn nearest_lit(&self, position: DVec3) -> Option<DVec3> {
        self.relighter.nearest_lit(position)
    }

    /// Share of the box of [`Clouds::bounds`] that is lit from the rows alone, 0 to 1.
    pub fn share_lit(&self) -> f64 {
        self.relighter.share_lit()
    }

    /// Rays of a stroke's direct light, [`DirectRays::STILL`] unless set.
    pub fn set_rays(&mut self, rays: DirectRays) {
        self.rays = rays;
    }

    /// The light of given points: scattered light of all orders from the rows (and, with feature `live`, solved for where there
    /// are none), and the points themselves for what comes straight from them.
    ///
    /// Errors: a point that is not finite or too bright; without feature `live` one that no row answers for, with the reason; a
    /// damaged row; a live solve that does not converge.
    pub fn light(&mut self, lights: &[PointLight]) -> Result<CloudLight, RuntimeError> {
        self.light_watched(lights, &mut |_| true)
    }

    /// [`Clouds::light`], with an eye on a live solve: `watch` sees the residual over its goal after each sweep and stops it with
    /// `false`, which is an error.
    pub fn light_watched(
        &mut self,
        lights: &[PointLight],
        watch: &mut dyn FnMut(f64) -> bool,
    ) -> Result<CloudLight, RuntimeError> {
        let (inside, outside): (Vec<PointLight>, Vec<PointLight>) =
            lights.iter().partition(|light| self.relighter.reaches(light.position));
        // Written so that NaN is refused too.
        let usable = |l: &&PointLight| l.position.is_finite() && l.intensity.abs() <= BRIGHTEST;
        if let Some(light) = outside.iter().find(|light| !usable(light)) {
            let found = format!("{} with {} W/sr", light.position, light.intensity);
            let wanted = format!("a finite place and at most {BRIGHTEST:e} W/sr");
            return Err(RuntimeError::argument("point light", wanted, found));
        }
        let relit = self.relighter.relight(&inside, RelightOptions::default(), &mut self.buffers)?;
        let (basis, planes) = (relit.basis, relit.planes.to_vec());
        let sources = self.buffers.weights().len();
        let in_rows = self.relighter.direct() == DirectTerm::InRows;
        let mut light = CloudLight {
            relighter: self.relighter.clone(),
            basis,
            planes,
            direct: if in_rows { outside.clone() } else { lights.to_vec() },
            live: Vec::new(),
            live_report: None,
            #[cfg(feature = "live")]
            gathered: None,
            lights: lights.len(),
            lights_outside: outside.len(),
            sources,
        };
        self.finish((&inside, &outside), watch, &mut light)?;
        Ok(light)
    }

    #[cfg(not(feature = "live"))]
    fn finish(
        &self,
        (_, outside): (&[PointLight], &[PointLight]),
        watch: &mut dyn FnMut(f64) -> bool,
        light: &mut CloudLight,
    ) -> Result<(), RuntimeError> {
        self.solve_outside(outside, watch, light)
    }

    /// Whether rows alone are not what light is made of.
    #[cfg(all(feature = "gpu", not(feature = "live")))]
    fn gathers(&self) -> bool {
        false
    }

    #[cfg(not(feature = "live"))]
    fn solve_outside(
        &self,
        outside: &[PointLight],
        _: &mut dyn FnMut(f64) -> bool,
        _: &mut CloudLight,
    ) -> Result<(), RuntimeError> {
        match outside.iter().find_map(|light| self.relighter.why_dark(light.position)) {
            Some(RuntimeError::Argument { field, wanted, found }) => {
                let wanted =
                    format!("{wanted}. Feature `live` of squall-runtime solves for such light on the spot");
                Err(RuntimeError::argument(field, wanted, found))
            }
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    #[cfg(feature = "live")]
    fn solve_outside(
        &mut self,
        outside: &[PointLight],
        watch: &mut dyn FnMut(f64) -> bool,
        light: &mut CloudLight,
    ) -> Result<(), RuntimeError> {
        let solver = match self.solver.take() {
            Some(solver) => solver,
            None => solve::solver_of(&self.relighter)?,
        };
        let solved = solve::scattered(&self.relighter, &solver, outside, watch);
        self.solver = Some(solver);
        let (live, report) = solved?;
        (light.live, light.live_report) = (live, Some(report));
        Ok(())
    }

    /// In-scattered radiance J of `flashes` towards `viewer` per cell, direct light included, W/(m² sr) in red, green and blue,
    /// and the cell's extinction, 1/m, behind it, into `out`: what a renderer that marches the cloud itself needs (radiance
    /// along a ray is ∫ albedo · extinction · J · transmittance). Never negative. Every cell has its direct light, air too; in cells
    /// whose scattered light the asset left out, because no viewer of its view region shades with them
    /// ([`Relighter::known_cells`]), it is alone.
    ///
    /// Errors: as [`Clouds::light`]; a viewer outside the asset's view region; a stroke that the asset lacks; `out` is not one
    /// grid long.
    pub fn radiance(
        &mut self,
        flashes: &[Flash],
        viewer: impl Into<Viewer>,
        out: &mut [[f32; 4]],
    ) -> Result<(), RuntimeError> {
        self.check_length(out.len())?;
        let mut light = vec![Vec3::ZERO; out.len()];
        self.add_flashes(flashes, (viewer.into(), DirectExtent::Everywhere), &mut light)?;
        for ((value, light), &extinction) in out.iter_mut().zip(light).zip(&self.cloud().extinction) {
            *value = light.extend(extinction).to_array();
        }
        Ok(())
    }

    /// [`Clouds::radiance`] in half precision, as the bits of IEEE binary16 (a texture of four 16-bit floats); light above 65504
    /// W/(m² sr) is stored as that.
    pub fn radiance_f16(
        &mut self,
        flashes: &[Flash],
        viewer: impl Into<Viewer>,
        out: &mut [[u16; 4]],
    ) -> Result<(), RuntimeError> {
        let mut whole = vec![[0.0; 4]; out.len()];
        self.radiance(flashes, viewer, &mut whole)?;
        out.iter_mut().zip(whole).for_each(|(out, value)| *out = value.map(f16_bits));
        Ok(())
    }

    /// Fluence rate φ of `flashes` per cell, W/m² in red, green and blue: light of all orders, direct light included; never
    /// negative.
    ///
    /// Errors: as [`Clouds::light`]; an asset baked for a view region, whose rows hold light towards that alone; `out` is not one
    /// grid long.
    pub fn fluence(&mut self, flashes: &[Flash], out: &mut [[f32; 3]]) -> Result<(), RuntimeError> {
        self.check_length(out.len())?;
        // Asked before any light is solved for.
        light::check_fluence(self.relighter.response().head.basis)?;
        out.fill([0.0; 3]);
        let mut own = vec![0.0; out.len()];
        for (flash, stroke) in flashes.iter().zip(self.strokes.find(flashes)?) {
            stroke.check()?;
            flash.check_brightness(&stroke)?;
            self.light(&stroke.lights(0.0))?.fluence(&mut own)?;
            let scale = flash.scale_of(&stroke);
            for (sum, &value) in out.iter_mut().zip(&own) {
                (0..3).for_each(|band| sum[band] += scale[band] * value);
            }
        }
        Ok(())
    }

    fn check_length(&self, found: usize) -> Result<(), RuntimeError> {
        let cells = self.cloud().shape.len();
        if found == cells {
            return Ok(());
        }
        Err(RuntimeError::argument("cells", format!("{cells} values, one a cell of the cloud's grid"), found))
    }

    /// Adds J of `flashes` towards `viewer` to `light`, W/(m² sr). Each stroke's light is worked out once and kept.
    pub(crate) fn add_flashes(
        &mut self,
        flashes: &[Flash],
        (viewer, extent): (Viewer, DirectExtent),
        light: &mut [Vec3],
    ) -> Result<LightReport, RuntimeError> {
        viewer.check(&self.relighter)?;
        let mut report = LightReport::default();
        let made_for = MadeFor { viewer, rays: self.rays, extent };
        let mut sum = vec![0.0f32; light.len()];
        let resolved: Vec<_> = self.strokes.find(flashes)?.into_iter().zip(flashes).collect();
        for (stroke, flash) in &resolved {
            flash.check_brightness(stroke)?;
        }
        // Strokes of one colour are summed before what the codec left below zero is cut off.
        for group in resolved.chunk_by(|(a, x), (b, y)| x.color_of(a) == y.color_of(b)) {
            sum.fill(0.0);
            for (stroke, flash) in group.iter().filter(|(_, flash)| flash.brightness > 0.0) {
                let entry = self.stroke_light(stroke, made_for, &mut report)?;
                let brightness = flash.brightness as f32;
                sum.par_chunks_mut(CELLS_AT_ONCE).zip(entry.par_chunks(CELLS_AT_ONCE)).for_each(
                    |(sum, j)| {
                        sum.iter_mut().zip(j).for_each(|(sum, j)| *sum += brightness * j);
                    },
                );
            }
            let color = Vec3::from_array(group[0].1.color_of(&group[0].0));
            light.par_chunks_mut(CELLS_AT_ONCE).zip(sum.par_chunks(CELLS_AT_ONCE)).for_each(|(light, j)| {
                light.iter_mut().zip(j).for_each(|(light, j)| *light += color * j.max(0.0));
            });
        }
        Ok(report)
    }

    /// J of a stroke of brightness 1 towards a viewer, direct light included, from memory where it is the last frames'.
    fn stroke_light(
        &mut self,
        stroke: &Arc<crate::stroke::Stroke>,
        made_for: MadeFor,
        report: &mut LightReport,
    ) -> Result<&[f32], RuntimeError> {
        let MadeFor { viewer, rays, extent } = made_for;
        let at = match self.kept.find(stroke, made_for) {
            Some(at) => {
                report.kept += 1;
                at
            }
            None => {
                stroke.check()?;
                // One point a segment: what the bake prunes its sources to.
                let light = self.light(&stroke.lights(0.0))?;
                let mut j = vec![0.0; self.cloud().shape.len()];
                let settings = DirectSettings { rays, ..DirectSettings::default() };
                light.towards(viewer, (settings, extent), &mut j);
                let own = LightReport {
                    lights: light.lights,
                    sources: light.sources,
                    live: light.lights_outside,
                    kept: 0,
                    residual: light.residual(),
                };
                self.kept.insert(stroke.clone(), made_for, (j, own))
            }
        };
        let (j, own) = self.kept.at(at);
        report.lights += own.lights;
        report.sources += own.sources;
        report.live += own.live;
        report.take_residual(own.residual);
        Ok(j)
    }
}

/// Light per cell with the cell's extinction behind it.
pub(crate) fn with_extinction(cloud: &Cloud, light: &[Vec3], cells: &mut Vec<Vec4>) {
    cells.resize(light.len(), Vec4::ZERO);
    let parts = cells.par_chunks_mut(CELLS_AT_ONCE).zip(light.par_chunks(CELLS_AT_ONCE));
    parts.zip(cloud.extinction.par_chunks(CELLS_AT_ONCE)).for_each(|((cells, light), extinction)| {
        for (cell, (j, &extinction)) in cells.iter_mut().zip(light.iter().zip(extinction)) {
            *cell = j.extend(extinction);
        }
    });
}
