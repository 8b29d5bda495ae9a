//! Lightning channels: as lines of light in the picture, and as points that light the town and stand in its water.

#[cfg(feature = "gpu")]
mod spots;

#[cfg(feature = "gpu")]
pub use spots::spots;

use super::lit_stroke::{CLOUD_M, LitStroke, eye_height};
use crate::camera::{Camera, Lens, Projection};
use crate::math::exp_neg;
use crate::picture::Picture;
use crate::shade::sky::Sky;
use crate::shade::town::Town;
use crate::shade::town::light::{SceneLight, StrokeLights};
use crate::shade::town::line::LineLight;
use crate::stroke::{Segment, Stroke};
use crate::transport::Cloud;
use crate::transport::direct::Tracer;
use glam::{DVec3, Vec2, Vec3};

/// Standard deviation of a channel's line in the picture, px: a lens's.
const BLUR_PX: f32 = 0.62;
/// Pixels around a point that its blur reaches.
const REACH_PX: f32 = 4.0;
/// Points of a channel are drawn this far apart, px.
pub(super) const SPACING_PX: f64 = 0.7;
/// Most points that a segment is drawn with.
pub(super) const MOST_POINTS: f64 = 4096.0;
/// Light that less than this share of arrives is left out.
const FAINT: f32 = 1e-4;
/// Points of each stroke that light surfaces with shadows, and that stand in the water.
const SHADOW_POINTS: f32 = 3.0;
/// Lines of each stroke whose image stands in the water: some of its length each, and every branch its own.
const IMAGE_LINES: f64 = 160.0;

/// Share of a point's light that reaches the eye through the cloud.
pub(super) fn through(cloud: Option<&Cloud>, from: DVec3, to: DVec3) -> f32 {
    cloud.map_or(1.0, |cloud| exp_neg(Tracer::new(cloud, 1.0).optical_depth(from, to)))
}

/// A stroke of brightness 1 in white as points of light around `eye`; what the cloud hides is left out, since its glow is a light
/// of its own.
pub fn town_lights(
    stroke: &Stroke,
    cloud: Option<&Cloud>,
    eye: DVec3,
    air: &dyn Fn(f64) -> [f32; 3],
) -> StrokeLights {
    let length: f64 = stroke.segments.iter().map(|s| s.from.distance(s.to)).sum();
    let images: Vec<LineLight> = lines(stroke, length / IMAGE_LINES)
        .into_iter()
        .map(|line| {
            let middle = 0.5 * (line.from + line.to);
            let visibility = through(cloud, eye, middle);
            let intensity = air(eye.distance(middle)).map(|band| band * line.intensity as f32);
            LineLight { from: line.from.as_vec3(), to: line.to.as_vec3(), intensity, visibility }
        })
        .collect();
    let point = |line: &LineLight| SceneLight {
        position: line.middle(),
        intensity: line.intensity,
        visibility: line.visibility,
    };
    let points: Vec<SceneLight> = images.iter().map(point).collect();
    let light = |point: &SceneLight| point.visibility * point.intensity.iter().sum::<f32>();
    let total: f32 = points.iter().map(light).sum();
    let bare: f32 = points.iter().map(|point| point.intensity.iter().sum::<f32>()).sum();
    if total <= FAINT * bare {
        return StrokeLights::default();
    }
    StrokeLights { images: images.into(), points: gathered(points, light, total) }
}

/// A stroke as straight lines of about `spacing` m; no line goes from one branch to another, and together they have all its light.
fn lines(stroke: &Stroke, spacing: f64) -> Vec<Segment> {
    let mut lines: Vec<Segment> = Vec::new();
    let mut length = f64::INFINITY;
    let mut last = DVec3::NAN;
    for segment in &stroke.segments {
        let own = segment.from.distance(segment.to);
        match lines.last_mut() {
            Some(line) if length < spacing && last == segment.from && line.order == segment.order => {
                line.to = segment.to;
                line.intensity += segment.intensity;
                length += own;
            }
            _ => {
                lines.push(*segment);
                length = own;
            }
        }
        last = segment.to;
    }
    lines.retain(|line| line.intensity > 0.0);
    lines
}

/// A few points in place of many: equal shares of the light from the top down, each at its middle.
fn gathered(mut points: Vec<SceneLight>, light: impl Fn(&SceneLight) -> f32, total: f32) -> Vec<SceneLight> {
    points.sort_by(|a, b| b.position.z.total_cmp(&a.position.z));
    let mut few = Vec::new();
    let (mut sum, mut middle, mut bands) = (0.0f32, Vec3::ZERO, Vec3::ZERO);
    for (i, point) in points.iter().enumerate() {
        sum += light(point);
        middle += point.position * light(point);
        bands += Vec3::from_array(point.intensity) * point.visibility;
        if sum >= total / SHADOW_POINTS || (i + 1 == points.len() && sum > 0.0) {
            let position = middle / sum;
            few.push(SceneLight { position, intensity: bands.to_array(), visibility: 1.0 });
            (sum, middle, bands) = (0.0, Vec3::ZERO, Vec3::ZERO);
        }
    }
    few
}

/// Irradiance of the strokes' own light at the eye, W/m² per colour, and the direction that it travels in.
pub fn irradiance_at<'a>(flashes: impl Iterator<Item = &'a LitStroke>, eye: DVec3) -> ([f32; 3], DVec3) {
    let (mut sum, mut way) = ([0.0f32; 3], DVec3::ZERO);
    for flash in flashes {
        for point in &flash.lights.points {
            let offset = eye - point.position.as_dvec3();
            let share = point.visibility / offset.length_squared().max(1.0) as f32;
            let light: [f32; 3] =
                std::array::from_fn(|band| flash.scale[band] * point.intensity[band] * share);
            for band in 0..3 {
                sum[band] += light[band];
            }
            way += offset.normalize_or(DVec3::NEG_Z) * f64::from(light.iter().sum::<f32>());
        }
    }
    (sum, way.normalize_or(DVec3::NEG_Z))
}

/// What channels in a picture depend on.
pub struct Channels<'a> {
    pub flashes: &'a [LitStroke],
    pub camera: &'a Camera,
    pub sky: &'a Sky,
    pub cloud: Option<&'a Cloud>,
    pub town: Option<&'a Town>,
    /// A scene of the caller's.
    pub before: Option<&'a super::foreground::Pixels>,
}

impl Channels<'_> {
    /// Adds the channels to a picture: every piece's light, spread over a lens's blur. `left` is the share of a point's
    /// light that comes through the rain.
    pub fn draw(&self, left: &dyn Fn(DVec3) -> f32, picture: &mut Picture) {
        let Self { camera, sky, cloud, town, before, .. } = *self;
        let Projection::Perspective { .. } = camera.projection else { return };
        let lens = Lens::new(camera);
        let per_metre = lens.pixels_per_metre;
        for flash in self.flashes {
            for segment in &flash.stroke.segments {
                let middle = 0.5 * (segment.from + segment.to);
                let distance = camera.position.distance(middle).max(1.0);
                let seen = through(cloud, camera.position, middle) * left(middle);
                if seen < FAINT {
                    continue;
                }
                let air = sky.air_view(eye_height(camera.position), CLOUD_M, distance).transmittance;
                let long = segment.from.distance(segment.to) * per_metre / distance;
                let count = (long / SPACING_PX).ceil().clamp(1.0, MOST_POINTS);
                // A source of I W/sr at distance d has irradiance I/d² at the eye: radiance times solid angle, and a
                // pixel's solid angle is one over pixels per radian squared.
                let scale = (camera.pixel_aspect * per_metre * per_metre / (distance * distance) / count)
                    as f32
                    * seen;
                let light = flash.intensity(segment.intensity);
                let light: [f32; 3] = std::array::from_fn(|band| light[band] * air[band] * scale);
                for i in 0..count as usize {
                    let point = segment.from.lerp(segment.to, (i as f64 + 0.5) / count);
                    let Some(place) = lens.project(point) else { continue };
                    let eye = camera.position.as_vec3();
                    if before.is_some_and(|before| before.hides(camera, point)) {
                        continue;
                    }
                    if !town.is_some_and(|town| town.is_blocked(eye, point.as_vec3())) {
                        spot(picture, place.pixel.as_vec2(), light);
                    }
                }
            }
        }
    }
}

/// Adds a point's light, blurred; all of it arrives on an endless picture.
pub(super) fn spot(picture: &mut Picture, place: Vec2, light: [f32; 3]) {
    let range = |middle: f32, count: usize| {
        let [low, high] = [middle - REACH_PX, middle + REACH_PX].map(|v| v.clamp(0.0, count as f32) as usize);
        low..high
    };
    let width = picture.width;
    for y in range(place.y, picture.height) {
        for x in range(place.x, width) {
            let (dx, dy) = (x as f32 + 0.5 - place.x, y as f32 + 0.5 - place.y);
            let share = libm::expf(-(dx * dx + dy * dy) / (2.0 * BLUR_PX * BLUR_PX))
                / (std::f32::consts::TAU * BLUR_PX * BLUR_PX);
            for band in 0..3 {
                picture.pixels[y * width + x][band] += light[band] * share;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_keep_twigs_apart_and_have_all_of_a_strokes_light() {
        /// Sums of some thousand numbers.
        const ROUND_OFF: f64 = 1e-12;
        let ends = [DVec3::new(0.0, 0.0, 900.0), DVec3::new(100.0, 40.0, 0.0)];
        let stroke = Stroke::between(ends[0], ends[1], 3, 1e6).unwrap();
        let sum = |segments: &[Segment]| segments.iter().map(|s| s.intensity).sum::<f64>();
        let orders = |segments: &[Segment]| segments.iter().map(|s| s.order).max().unwrap();
        for spacing in [1.0, 40.0, 1e9] {
            let found = lines(&stroke, spacing);
            assert!((sum(&found) / sum(&stroke.segments) - 1.0).abs() < ROUND_OFF);
            assert_eq!(orders(&found), orders(&stroke.segments));
            // The main channel reaches the ground: its image begins at its foot.
            assert!(found.iter().any(|line| line.to.distance(ends[1]) < 1e-9));
        }
        assert!(lines(&stroke, 1e9).len() < stroke.segments.len() / 4);
    }
}
