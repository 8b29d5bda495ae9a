//! A channel in the picture as points, for a graphics card: the light of each before rain, and before anything that stands in front.

use super::{BLUR_PX, FAINT, MOST_POINTS, SPACING_PX, through};
use crate::camera::{Camera, Projection};
use crate::gpu::spots::SpotSource;
use crate::renderer::lit_stroke::{CLOUD_M, LitStroke, eye_height};
use crate::shade::sky::Sky;
use crate::transport::Cloud;

/// The points that [`super::Channels::draw`] draws, of brightness 1 in white; `number` is what the stroke is told by.
pub fn spots(
    (flash, number): (&LitStroke, u32),
    (camera, sky): (&Camera, &Sky),
    cloud: Option<&Cloud>,
) -> Vec<SpotSource> {
    let Projection::Perspective { .. } = camera.projection else { return Vec::new() };
    let per_metre = camera.pixels_per_metre();
    let mut all = Vec::new();
    for segment in &flash.stroke.segments {
        let middle = 0.5 * (segment.from + segment.to);
        let distance = camera.position.distance(middle).max(1.0);
        let seen = through(cloud, camera.position, middle);
        if seen < FAINT {
            continue;
        }
        let air = sky.air_view(eye_height(camera.position), CLOUD_M, distance).transmittance;
        let long = segment.from.distance(segment.to) * per_metre / distance;
        let count = (long / SPACING_PX).ceil().clamp(1.0, MOST_POINTS);
        let scale =
            (camera.pixel_aspect * per_metre * per_metre / (distance * distance) / count) as f32 * seen;
        // In the middle of a spot of this blur.
        let share = scale / (std::f32::consts::TAU * BLUR_PX * BLUR_PX);
        let light = air.map(|band| segment.intensity as f32 * band * share);
        let point = |i: usize| segment.from.lerp(segment.to, (i as f64 + 0.5) / count);
        // What is behind a camera that turns is left out on the card.
        all.extend((0..count as usize).map(point).map(|place| SpotSource {
            position: place.as_vec3().to_array(),
            stroke: number,
            light,
            sigma: BLUR_PX,
        }));
    }
    all
}
