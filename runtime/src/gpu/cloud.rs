//! The cloud's grid as shaders see it, and the cells whose light anybody can see.

use crate::clouds::Viewer;
use crate::relight::Relighter;
use crate::shade::cloud::density;
use crate::shade::detail::DetailParameters;
use crate::transport::{Boundary, Cloud};
use glam::{DVec3, UVec3};
use squall_formats::GridShape;

/// `Cloud` of cloud.wgsl.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct CloudUniform {
    pub origin: [f32; 3],
    pub albedo: f32,
    pub cell: [f32; 3],
    pub g: f32,
    pub counts: [u32; 3],
    pub periodic: u32,
    pub light_counts: [u32; 3],
    pub extinction_unit: f32,
    pub blocks: [f32; 3],
    pub extinction_scale: f32,
    pub viewer: [f32; 3],
    pub viewer_is_far: u32,
    pub fine: f32,
    pub shortest: f32,
    pub amplitude: f32,
    pub fibres_from: f32,
    pub voxels_per_metre: f32,
    pub pad: [f32; 3],
}

impl CloudUniform {
    /// Of the asset's cloud, whose grid is measured from `place`; nobody looks at it yet, and it has no billows.
    pub fn new(relighter: &Relighter, place: DVec3) -> Self {
        let (cloud, light) = (relighter.cloud(), relighter.light_cloud());
        let edges = cloud.cell_m.map(|edge| edge as f32);
        let largest = cloud.extinction.iter().copied().fold(0.0, f32::max);
        let shortest = cloud.cell_m.into_iter().fold(f64::INFINITY, f64::min) as f32;
        Self {
            origin: (cloud.origin_m - place).as_vec3().to_array(),
            albedo: cloud.albedo as f32,
            cell: edges,
            g: cloud.g as f32,
            counts: counts(cloud.shape),
            periodic: u32::from(cloud.boundary == Boundary::PeriodicXy),
            light_counts: counts(light.shape),
            extinction_unit: if largest > 0.0 { largest } else { 1.0 },
            blocks: (UVec3::from(counts(cloud.shape)) / UVec3::from(counts(light.shape)))
                .as_vec3()
                .to_array(),
            extinction_scale: relighter.extinction_scale() as f32,
            fine: shortest / density::STEPS_PER_CELL,
            shortest,
            fibres_from: f32::MAX,
            ..Self::default()
        }
    }

    /// The same with billows.
    #[must_use]
    pub fn with_detail(self, detail: &DetailParameters, voxels_per_metre: f32) -> Self {
        let billow = if detail.amplitude > 0.0 { detail.size / density::STEPS_PER_BILLOW } else { f32::MAX };
        Self {
            fine: billow.min(self.shortest / density::STEPS_PER_CELL),
            amplitude: detail.amplitude,
            // No infinity goes to a shader.
            fibres_from: detail.fibres_from.clamp(f32::MIN, f32::MAX),
            voxels_per_metre,
            ..self
        }
    }

    /// The same seen by `viewer`, whose place is in the asset's coordinates.
    #[must_use]
    pub fn seen_by(self, cloud: &Cloud, viewer: Viewer) -> Self {
        let (viewer, viewer_is_far) = match viewer {
            Viewer::At(place) => (place - cloud.origin_m, 0),
            Viewer::Along(direction) => (direction, 1),
        };
        Self { viewer: viewer.as_vec3().to_array(), viewer_is_far, ..self }
    }
}

/// Cells along each axis.
pub fn counts(shape: GridShape) -> [u32; 3] {
    shape.to_array().map(|count| count as u32)
}
