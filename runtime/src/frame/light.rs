//! From the asset's rows to light per cell, in three channels, towards one eye.

use super::{Flash, FrameMemory, FrameReport};
use crate::camera::{Camera, Ray};
use crate::error::RuntimeError;
use crate::in_scattered::InScattered;
use crate::relight::{PointLight, RelightOptions, Relighter, Relit};
use crate::shade::cloud::{CloudPicture, direction_to};
use crate::shade::sky::Sky;
use crate::shade::town::light::GlowLight;
use crate::single_scatter::{DirectSettings, add_direct};
use crate::transport::Cloud;
use glam::{DVec3, Vec3, Vec4};
use squall_formats::section::response::{DirectTerm, DistantKind};

/// Rays that measure what the lit cloud sheds on the ground: columns and rows over half the sphere.
const GLOW_RAYS: [usize; 2] = [96, 32];

/// J of every light of the frame per cell into `memory.cells`, that of the flashes alone into `memory.flash_cells`; each
/// with the cell's extinction behind it.
pub fn light_cells(
    relighter: &Relighter<'_>,
    camera: &Camera,
    sky: &Sky,
    flashes: &[Flash<'_>],
    rays_per_point: u32,
    memory: &mut FrameMemory,
) -> Result<FrameReport, RuntimeError> {
    relighter.check_camera(camera)?;
    let cloud = relighter.cloud();
    let mut report = FrameReport::default();
    let view_region: Vec<[f32; 3]> = (0..cloud.shape.len())
        .map(|i| direction_to(camera, cloud.centre(cloud.shape.cell(i))).as_vec3().to_array())
        .collect();
    let towards_each = |relit: Relit<'_>, j: &mut [f32]| {
        let towards = |cell: usize, _: DVec3| Vec3::from_array(view_region[cell]).as_dvec3();
        InScattered::of(relit).towards_each(cloud, towards, j);
    };
    let mut light: Vec<Vec3> = vec![Vec3::ZERO; view_region.len()];
    let mut j = vec![0.0f32; view_region.len()];
    for group in flashes.chunk_by(|a, b| a.record.color == b.record.color) {
        let mut lights: Vec<PointLight> = Vec::new();
        for flash in group {
            // One point a segment: what the bake prunes its sources to.
            let points = flash.stroke.lights(0.0);
            lights.extend(
                points.iter().map(|p| PointLight { intensity: p.intensity * flash.brightness, ..*p }),
            );
        }
        let sources = relighter.weigh(&lights, &mut memory.relight)?.len();
        let relit = relighter.relight(&lights, RelightOptions::default(), &mut memory.relight)?;
        towards_each(relit, &mut j);
        if relighter.direct() == DirectTerm::AtRunTime {
            let settings = DirectSettings { rays_per_point, ..DirectSettings::default() };
            add_direct(cloud, relighter.extinction_scale(), &lights, &view_region, settings, &mut j);
        }
        let color = Vec3::from_array(group[0].record.color);
        light.iter_mut().zip(&j).for_each(|(sum, &j)| *sum += color * j.max(0.0));
        report.lights += lights.len();
        report.sources += sources;
    }
    with_extinction(cloud, &light, &mut memory.flash_cells);
    for kind in relighter.response().head.distant.iter().map(|source| source.kind) {
        let Some(relit) = relighter.distant(kind, &mut memory.relight)? else { continue };
        towards_each(relit, &mut j);
        let colours = distant_colours(cloud, sky, kind);
        light.iter_mut().zip(&j).zip(&colours).for_each(|((sum, &j), &colour)| *sum += colour * j.max(0.0));
    }
    with_extinction(cloud, &light, &mut memory.cells);
    Ok(report)
}

fn with_extinction(cloud: &Cloud, light: &[Vec3], cells: &mut Vec<Vec4>) {
    cells.clear();
    cells.extend(light.iter().zip(&cloud.extinction).map(|(j, &extinction)| j.extend(extinction)));
}

/// Strength of distant light per cell: radiance of a hemisphere, W/(m² sr), or irradiance of the sun, W/m².
///
/// The sun's rows are those of a beam that fills all space; where the Earth's shadow cuts it, at dusk, each cell is lit by
/// what reaches its own height. Light that is scattered across the shadow's edge, within the cloud, is taken from the
/// wrong side of it: at most some mean free paths of a ramp that is kilometres wide.
fn distant_colours(cloud: &Cloud, sky: &Sky, kind: DistantKind) -> Vec<Vec3> {
    let [nx, ny, nz] = cloud.shape.to_array();
    let mut colours = Vec::with_capacity(cloud.shape.len());
    for z in 0..nz {
        let at = |x: usize, y: usize| {
            let place = cloud.centre([x, y, z]);
            let light = sky.cloud_light(place.z, place);
            Vec3::from_array(match kind {
                DistantKind::UpperSky => light.upper,
                DistantKind::LowerSky => light.lower,
                DistantKind::Beam { .. } => light.sun_irradiance,
            })
        };
        // Within a layer it is linear across tens of kilometres.
        let corners = [at(0, 0), at(nx - 1, 0), at(0, ny - 1), at(nx - 1, ny - 1)];
        for y in 0..ny {
            let v = y as f32 / (ny - 1).max(1) as f32;
            let (left, right) = (corners[0].lerp(corners[2], v), corners[1].lerp(corners[3], v));
            colours.extend((0..nx).map(|x| left.lerp(right, x as f32 / (nx - 1).max(1) as f32)));
        }
    }
    colours
}

/// The lit cloud as one light on the town: a ball with the irradiance, direction and spread that rays from `eye` measure.
pub fn glow_of(cloud: &CloudPicture<'_>, eye: DVec3) -> Vec<GlowLight> {
    let [columns, rows] = GLOW_RAYS;
    let (mut flux, mut sum, mut moment, mut away) = (Vec3::ZERO, 0.0f32, Vec3::ZERO, 0.0f32);
    for row in 0..rows {
        let rise = (row as f64 + 0.5) / rows as f64;
        let level = libm::sqrt(1.0 - rise * rise);
        for column in 0..columns {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * (column as f64 + 0.5) / columns as f64);
            let direction = DVec3::new(level * cos, level * sin, rise);
            let view = cloud.march(&Ray { origin: eye, direction });
            let radiance = Vec3::from_array(view.radiance);
            let weight = radiance.element_sum();
            flux += radiance;
            sum += weight;
            moment += direction.as_vec3() * weight;
            away += view.distance * weight;
        }
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
