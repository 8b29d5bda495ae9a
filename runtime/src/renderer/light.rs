//! From the asset's rows to light per cell, in three colours, towards one viewer.

use super::{FrameReport, FrameTimes};
use crate::camera::Ray;
use crate::clouds::{Clouds, DirectExtent, SunSource, Viewer, with_extinction};
use crate::error::RuntimeError;
use crate::frame::Frame;
use crate::parallel::prelude::*;
use crate::place::Place;
use crate::shade::cloud::CloudPicture;
use crate::shade::sky::{CloudLight, Sky, SkyParameters};
use crate::shade::town::light::GlowLight;
use crate::transport::Cloud;
use glam::{DVec3, Vec3, Vec4};
use squall_formats::section::response::DistantKind;

/// Cells that one thread takes at a time.
const CELLS_AT_ONCE: usize = 1 << 14;
/// Rays that measure what the lit cloud sheds on the ground: columns and rows over half the sphere.
const GLOW_RAYS: [usize; 2] = [96, 32];

/// J of the sky's light per cell, for the sky and the viewer that it was last worked out for.
#[derive(Default)]
pub struct Ambient {
    made_for: Option<(SkyParameters, Viewer)>,
    light: Vec<Vec3>,
    report: SkyReport,
}

/// What of the sky's light there was.
#[derive(Clone, Copy, Default)]
struct SkyReport {
    sun: SunSource,
    /// Whether both hemispheres light the cloud.
    whole: bool,
}

impl Ambient {
    fn of(
        &mut self,
        clouds: &mut Clouds,
        (sky, parameters): ((&Sky, Place), &SkyParameters),
        viewer: Viewer,
    ) -> Result<(&[Vec3], SkyReport), RuntimeError> {
        if self.made_for.as_ref().is_some_and(|(known, seen)| known == parameters && *seen == viewer) {
            return Ok((&self.light, self.report));
        }
        self.made_for = None;
        self.light.clear();
        self.light.resize(clouds.cloud().shape.len(), Vec3::ZERO);
        let grid = clouds.shared();
        let (grid, light) = (grid.cloud(), &mut self.light);
        let whole = clouds.hemispheres(viewer, |kind, j| {
            let upper = kind == DistantKind::UpperSky;
            let of = if upper { |light: CloudLight| light.upper } else { |light: CloudLight| light.lower };
            add_distant(grid, &distant_colours(grid, sky, of), j, light);
        })?;
        let colours = distant_colours(grid, sky, |light| light.sun_irradiance);
        let mut sun = SunSource::Down;
        if colours.iter().flatten().any(|colour| *colour != Vec3::ZERO) {
            let mut j = vec![0.0; light.len()];
            let towards = sky.0.sun_direction().as_dvec3().normalize();
            sun = clouds.sun_in(towards, (viewer, DirectExtent::NearCloud), &mut j)?;
            add_distant(grid, &colours, &j, light);
        }
        self.report = SkyReport { sun, whole };
        self.made_for = Some((parameters.clone(), viewer));
        Ok((&self.light, self.report))
    }
}

/// J of every light of the frame into the first cells, that of the flashes alone into the second; each with the cell's
/// extinction behind it.
pub fn light_cells(
    clouds: &mut Clouds,
    frame: &Frame,
    sky: (&Sky, Place),
    ambient: &mut Ambient,
    (cells, flash_cells): (&mut Vec<Vec4>, &mut Vec<Vec4>),
) -> Result<FrameReport, RuntimeError> {
    let viewer = Viewer::from(&frame.camera);
    clouds.set_rays(frame.quality.rays);
    clouds.set_quality(frame.quality.light)?;
    let mut light = vec![Vec3::ZERO; clouds.cloud().shape.len()];
    let lit = clouds.add_flashes(&frame.flashes, (viewer, DirectExtent::NearCloud), &mut light)?;
    with_extinction(clouds.cloud(), &light, flash_cells);
    let (ambient, of_sky) = ambient.of(clouds, (sky, &frame.sky), viewer)?;
    light.par_chunks_mut(CELLS_AT_ONCE).zip(ambient.par_chunks(CELLS_AT_ONCE)).for_each(
        |(light, ambient)| {
            light.iter_mut().zip(ambient).for_each(|(sum, &ambient)| *sum += ambient);
        },
    );
    with_extinction(clouds.cloud(), &light, cells);
    Ok(FrameReport {
        lights: lit.lights,
        sources: lit.sources,
        lights_live: lit.live,
        strokes_kept: lit.kept,
        gather_residual: lit.residual,
        streaks: 0,
        sun: of_sky.sun,
        sky_missing: !of_sky.whole,
        times: FrameTimes::default(),
    })
}

/// Strength of distant light in the corners of each layer of cells: radiance of a hemisphere, W/(m² sr), or irradiance of the sun, W/m²;
/// `of` picks it.
///
/// The sun's rows are those of a beam that fills all space; where the Earth's shadow cuts it, at dusk, each cell is lit by
/// what reaches its own height. Light that is scattered across the shadow's edge, within the cloud, is taken from the
/// wrong side of it: at most some mean free paths of a ramp that is kilometres wide.
fn distant_colours(
    cloud: &Cloud,
    (sky, from): (&Sky, Place),
    of: fn(CloudLight) -> [f32; 3],
) -> Vec<[Vec3; 4]> {
    let [nx, ny, nz] = cloud.shape.to_array();
    let at = |x: usize, y: usize, z: usize| {
        let place = cloud.centre([x, y, z]) - from.origin;
        Vec3::from_array(of(sky.cloud_light(place.z, place)))
    };
    (0..nz).map(|z| [at(0, 0, z), at(nx - 1, 0, z), at(0, ny - 1, z), at(nx - 1, ny - 1, z)]).collect()
}

/// Adds J of distant light, per unit of its strength, times that strength: within a layer it is linear across tens of kilometres.
fn add_distant(cloud: &Cloud, colours: &[[Vec3; 4]], j: &[f32], light: &mut [Vec3]) {
    let [nx, ny, _] = cloud.shape.to_array();
    let layers = light.par_chunks_mut(nx * ny).zip(j.par_chunks(nx * ny));
    layers.zip(colours.par_iter()).for_each(|((light, j), corners)| {
        for (y, (light, j)) in light.chunks_mut(nx).zip(j.chunks(nx)).enumerate() {
            let v = y as f32 / (ny - 1).max(1) as f32;
            let (left, right) = (corners[0].lerp(corners[2], v), corners[1].lerp(corners[3], v));
            for (x, (sum, &j)) in light.iter_mut().zip(j).enumerate().filter(|(_, (_, j))| **j > 0.0) {
                *sum += left.lerp(right, x as f32 / (nx - 1).max(1) as f32) * j;
            }
        }
    });
}

/// The lit cloud as one light on the town: a ball with the irradiance, direction and spread that rays from `eye` measure.
pub fn glow_of(cloud: &CloudPicture<'_>, eye: DVec3) -> Vec<GlowLight> {
    let [columns, rows] = GLOW_RAYS;
    let mut seen = vec![(DVec3::ZERO, Vec3::ZERO, 0.0f32); columns * rows];
    seen.par_chunks_mut(columns).enumerate().for_each(|(row, seen)| {
        let rise = (row as f64 + 0.5) / rows as f64;
        let level = libm::sqrt(1.0 - rise * rise);
        for (column, seen) in seen.iter_mut().enumerate() {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * (column as f64 + 0.5) / columns as f64);
            let direction = DVec3::new(level * cos, level * sin, rise);
            let view = cloud.march(&Ray { origin: eye, direction });
            *seen = (direction, Vec3::from_array(view.radiance), view.distance);
        }
    });
    let (mut flux, mut sum, mut moment, mut away) = (Vec3::ZERO, 0.0f32, Vec3::ZERO, 0.0f32);
    for (direction, radiance, distance) in seen {
        let weight = radiance.element_sum();
        flux += radiance;
        sum += weight;
        moment += direction.as_vec3() * weight;
        away += distance * weight;
    }
    if sum <= 0.0 {
        return Vec::new();
    }
    // Rays are evenly spread in solid angle. The length of the mean direction tells how widely light comes in: for a
    // cap of half angle a it is (1 + cos a)/2.
    let share = std::f32::consts::TAU / (columns * rows) as f32;
    let (mean, distance) = (moment / sum, away / sum);
    let cos = (2.0 * mean.length() - 1.0).clamp(0.0, 0.999);
    let sin = (1.0 - cos * cos).sqrt();
    let radius = distance * sin;
    // The ball fills a cap of that half angle; its radiance is what gives the flux.
    let radiance = flux * share / (std::f32::consts::TAU * (1.0 - cos));
    let centre = eye.as_vec3() + mean.normalize() * distance;
    vec![GlowLight { centre, radius, radiance: radiance.to_array() }]
}
