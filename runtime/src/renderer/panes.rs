//! Street lamps, channels and the sun as panes of glass show them: each dimmed over its own way to the glass and on to the eye.

use super::channel::{self, MOST_POINTS, SPACING_PX};
use super::draw::TOWN_M;
use super::foreground::Pixels;
use super::lit_stroke::{CLOUD_M, LitStroke, eye_height};
use super::town_rain::TownRain;
use crate::camera::{Camera, Lens, Projection};
use crate::picture::Picture;
use crate::shade::sky::Sky;
use crate::shade::town::Town;
use crate::shade::town::frame::{LAMP_RADIUS, lamp_spot};
use crate::shade::town::panes::{PaneImage, PaneView, PaneWall};
use crate::shade::town::rain::RainBetween;
use crate::stroke::Segment;
use crate::transport::Cloud;
use crate::world::Sun;
use glam::DVec3;

/// Segments of a stroke that are asked together whether a wall may show them.
const TOGETHER: usize = 16;
/// Farther than any town, m: as far as the sun is for a pane's picture.
const FAR_M: f64 = 1e6;

/// What images in panes depend on.
pub struct PaneLights<'a> {
    pub town: &'a Town,
    pub camera: &'a Camera,
    pub sky: &'a Sky,
    pub cloud: Option<&'a Cloud>,
    pub flashes: &'a [LitStroke],
    /// The sun as it shines on the town, the storm's cloud before it.
    pub sun: Option<Sun>,
    /// Rain between the glass and the light.
    pub wet: &'a TownRain<'a>,
    /// A scene of the caller's.
    pub before: Option<&'a Pixels>,
}

/// Segments of one flash close to each other.
struct Part<'a> {
    flash: &'a LitStroke,
    segments: &'a [Segment],
    centre: DVec3,
    radius: f64,
}

impl PaneLights<'_> {
    /// Adds the images to a picture; `left` is the share of a point's light that comes through the rain before the eye.
    pub fn draw(&self, left: &dyn Fn(DVec3) -> f32, picture: &mut Picture) {
        let view = PaneView::new(self.town, self.camera);
        let parts = self.parts();
        for wall in view.walls() {
            self.draw_lamps(&view, &wall, left, picture);
            if let Projection::Perspective { .. } = self.camera.projection {
                self.draw_channels(&view, &wall, &parts, left, picture);
                self.draw_sun(&view, &wall, left, picture);
            }
        }
    }

    /// Whether a scene of the caller's stands before the glass.
    fn is_hidden(&self, image: &PaneImage) -> bool {
        self.before.is_some_and(|before| before.hides(self.camera, image.at))
    }

    fn air(&self, middle: f64, metres: f64) -> [f32; 3] {
        self.sky.air_view(eye_height(self.camera.position), middle, metres).transmittance
    }

    fn draw_lamps(
        &self,
        view: &PaneView<'_>,
        wall: &PaneWall,
        left: &dyn Fn(DVec3) -> f32,
        picture: &mut Picture,
    ) {
        for lamp in self.town.lamps() {
            let place = DVec3::from_array(lamp.position.map(f64::from));
            let Some(image) = view.image(wall, place, f64::from(LAMP_RADIUS)) else { continue };
            if self.is_hidden(&image) {
                continue;
            }
            let between = self.wet.left(image.start.as_vec3(), place.as_vec3());
            let share = image.share * left(image.at) * between;
            let air = self.air(TOWN_M, self.camera.position.distance(image.behind));
            let light = std::array::from_fn(|band| lamp.intensity[band] * air[band] * share);
            lamp_spot(self.camera, image.behind, light, picture);
        }
    }

    /// The channels' segments, some neighbours together.
    fn parts(&self) -> Vec<Part<'_>> {
        let chunks = |flash| LitStroke::segments(flash).chunks(TOGETHER).map(move |part| (flash, part));
        let parts = self.flashes.iter().flat_map(chunks).map(|(flash, segments)| {
            let ends = || segments.iter().flat_map(|segment| [segment.from, segment.to]);
            let (low, high) = ends().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), end| {
                (low.min(end), high.max(end))
            });
            let centre = 0.5 * (low + high);
            let radius = ends().map(|end| end.distance(centre)).fold(0.0, f64::max);
            Part { flash, segments, centre, radius }
        });
        parts.collect()
    }

    fn draw_channels(
        &self,
        view: &PaneView<'_>,
        wall: &PaneWall,
        parts: &[Part<'_>],
        left: &dyn Fn(DVec3) -> f32,
        picture: &mut Picture,
    ) {
        let (camera, lens) = (self.camera, Lens::new(self.camera));
        let per_metre = lens.pixels_per_metre;
        let eye = camera.position;
        for Part { flash, segments, centre, radius } in parts {
            if !wall.may_show(eye, *centre, *radius) {
                continue;
            }
            for segment in *segments {
                let (middle, long) = (0.5 * (segment.from + segment.to), segment.from.distance(segment.to));
                if !wall.may_show(eye, middle, 0.5 * long) {
                    continue;
                }
                let distance = eye.distance(wall.behind(middle)).max(1.0);
                let count = (long * per_metre / distance / SPACING_PX).ceil().clamp(1.0, MOST_POINTS);
                let air = self.air(CLOUD_M, distance);
                let scale = camera.pixel_aspect * per_metre * per_metre / count;
                let light = flash.intensity(segment.intensity);
                // Rain and cloud before a segment are those before the first of its points that is seen.
                let mut dimmed = None;
                for i in 0..count as usize {
                    let point = segment.from.lerp(segment.to, (i as f64 + 0.5) / count);
                    let Some(image) = view.image(wall, point, 0.0) else { continue };
                    let Some(place) = lens.project(image.behind) else { continue };
                    if self.is_hidden(&image) {
                        continue;
                    }
                    let dimmed = *dimmed.get_or_insert_with(|| {
                        let [start, point] = [image.start, point].map(|place| place.as_vec3());
                        let rain = left(image.at) * self.wet.left(start, point);
                        rain * channel::through(self.cloud, image.start, middle)
                    });
                    let share = (scale / eye.distance_squared(image.behind)) as f32 * image.share * dimmed;
                    let light = std::array::from_fn(|band| light[band] * air[band] * share);
                    channel::spot(picture, place.pixel.as_vec2(), light);
                }
            }
        }
    }

    /// The sun's disc: the same in all panes of one direction, and so in few pixels of each wall.
    fn draw_sun(
        &self,
        view: &PaneView<'_>,
        wall: &PaneWall,
        left: &dyn Fn(DVec3) -> f32,
        picture: &mut Picture,
    ) {
        let (Some(sun), Some(clear)) = (&self.sun, self.sky.sun()) else { return };
        let (camera, eye) = (self.camera, self.camera.position);
        let towards = sun.towards.as_dvec3();
        let Some(onward) = wall.image_of_direction(towards) else { return };
        let Some(place) = camera.project(eye + onward * FAR_M) else { return };
        let Some([columns, rows]) = self.around(place.pixel.to_array(), onward, picture) else { return };
        if !wall.may_show(eye, eye + wall.reflected(onward) * FAR_M, 2.0 * sun.angular_radius.0 * FAR_M) {
            return;
        }
        let mirrored = wall.mirrored_camera(camera);
        let share_of = |band: usize| {
            if clear.irradiance[band] > 0.0 { sun.irradiance[band] / clear.irradiance[band] } else { 0.0 }
        };
        let open: [f32; 3] = std::array::from_fn(share_of);
        let width = picture.width;
        for (y, x) in rows.flat_map(|y| columns.clone().map(move |x| (y, x))) {
            let disc = self.sky.disc_in_pixel(&mirrored, x, y);
            if disc == [0.0; 3] {
                continue;
            }
            let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
            let Some(image) = view.seen(wall, eye, ray.direction, 0.0) else { continue };
            if self.is_hidden(&image) || !view.sees_sky(image.start, towards) {
                continue;
            }
            let [rain, _] = self.wet.of_beam(image.start.as_vec3(), sun.towards, 0.0);
            let air = self.air(TOWN_M, eye.distance(image.at));
            let share = image.share * rain * left(image.at);
            let pixel = &mut picture.pixels[y * width + x];
            (0..3).for_each(|band| pixel[band] += disc[band] * open[band] * air[band] * share);
        }
    }

    /// Columns and rows that the sun's image around a pixel may reach; none outside the picture.
    fn around(
        &self,
        pixel: [f64; 2],
        onward: DVec3,
        picture: &Picture,
    ) -> Option<[std::ops::Range<usize>; 2]> {
        // A perspective picture is stretched by up to the square of a secant away from its axis.
        let secant = 1.0 / onward.dot(self.camera.forward).max(1e-3);
        let stretch = self.camera.pixel_aspect.max(1.0) * secant * secant;
        let reach = 1.1 * Sun::ANGULAR_RADIUS.0 * self.camera.pixels_per_metre() * stretch + 2.0;
        let range = |middle: f64, count: usize| {
            let [low, high] = [middle - reach, middle + reach].map(|v| v.clamp(0.0, count as f64) as usize);
            (low < high).then_some(low..high)
        };
        Some([range(pixel[0], picture.width)?, range(pixel[1], picture.height)?])
    }
}

#[cfg(test)]
mod tests;
