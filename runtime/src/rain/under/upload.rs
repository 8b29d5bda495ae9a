//! What is dry around an eye as a graphics card finds it.

use super::Relief;
use crate::camera::Camera;
use crate::rain::Covers;
use glam::DVec3;

/// A relief's numbers: how drops fall, m/s, metres across for a metre of height, the slopes that rays have, spokes around the eye.
pub(crate) struct ReliefNumbers {
    pub fall: [f32; 3],
    pub lean: [f32; 2],
    pub slopes: [f32; 2],
    pub spokes: u32,
}

/// Of what keeps rain off that falls with the mean velocity `fall`, m/s, before `camera`; none where nothing does.
pub(crate) fn relief_of(covers: Covers<'_>, fall: DVec3, camera: &Camera) -> Option<ReliefNumbers> {
    (!covers.is_empty()).then(|| {
        let relief = Relief::new(covers, fall, camera);
        ReliefNumbers {
            fall: relief.fall.as_vec3().to_array(),
            lean: relief.lean.as_vec2().to_array(),
            slopes: relief.slopes.map(|slope| slope as f32),
            spokes: relief.spokes.len() as u32,
        }
    })
}
