//! A whole picture of the town: light, cover and depth for every pixel.

mod coarse;
mod node;
mod quality;
mod spots;
mod strip;
mod tiles;

pub use quality::Quality;

use super::Town;
use super::light::Lighting;
use crate::camera::{Camera, Lens, Projection};
use crate::parallel::prelude::*;
use crate::picture::Picture;
use glam::{DVec3, Vec3};
use strip::{ROWS, Strip, Task};

/// What a pixel shows of the town.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TownPixel {
    /// Radiance of the town's share of the pixel, W/(m² sr), already times `cover`, without the lamps themselves. A
    /// picture is `radiance + (1 − cover) · sky`.
    pub radiance: [f32; 3],
    /// Share of the pixel that the town and its ground cover, in [0, 1].
    pub cover: f32,
    /// From the eye along the ray through the pixel's centre, m; infinity where it leaves.
    pub distance: f32,
    /// The same along the camera's axis (planar depth), m.
    pub depth: f32,
    /// Normal at the centre, zero where the ray leaves.
    pub normal: Vec3,
}

/// A picture of the town; kept between frames, it is allocated once.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TownFrame {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `width * height` pixels, row 0 = top, x fastest.
    pub pixels: Vec<TownPixel>,
    /// Radiance of each stroke of [`Lighting::strokes`] that was told apart, `width * height` pixels each; not in `pixels`.
    pub strokes: Vec<Vec<[f32; 3]>>,
}

/// Most strokes that are told apart in one picture.
pub const MOST_STROKES: usize = 4;

const SKY: TownPixel = TownPixel {
    radiance: [0.0; 3],
    cover: 0.0,
    distance: f32::INFINITY,
    depth: f32::INFINITY,
    normal: Vec3::ZERO,
};

/// Radius of a lamp's glass, m.
pub(crate) const LAMP_RADIUS: f32 = 0.15;

impl Town {
    /// Renders what `camera` sees into `frame`.
    ///
    /// Strips of rows are independent; with feature `rayon` they run on the caller's pool, and any number of threads
    /// gives the same bytes.
    pub fn render(&self, camera: &Camera, lighting: &Lighting, quality: Quality, frame: &mut TownFrame) {
        // Most frames tell no stroke apart and pay for none.
        match lighting.strokes.len() {
            0 => self.render_parts::<0>(camera, lighting, quality, frame),
            1 => self.render_parts::<1>(camera, lighting, quality, frame),
            2..MOST_STROKES => self.render_parts::<{ MOST_STROKES - 1 }>(camera, lighting, quality, frame),
            _ => self.render_parts::<MOST_STROKES>(camera, lighting, quality, frame),
        }
    }

    fn render_parts<const N: usize>(
        &self,
        camera: &Camera,
        lighting: &Lighting,
        quality: Quality,
        frame: &mut TownFrame,
    ) {
        (frame.width, frame.height) = (camera.width as usize, camera.height as usize);
        let (width, count) = (frame.width, frame.width * frame.height);
        frame.pixels.resize(count, SKY);
        let told = lighting.strokes.len().min(N);
        frame.strokes = (0..told).map(|_| vec![[0.0; 3]; count]).collect();
        let task = Task { town: self, lens: Lens::new(camera), lighting, quality };
        let mut apart: Vec<_> =
            frame.strokes.iter_mut().map(|picture| picture.chunks_mut(width * ROWS)).collect();
        let rows = frame.pixels.chunks_mut(width * ROWS).enumerate();
        let mut strips: Vec<_> = rows
            .map(|rows| (rows, apart.iter_mut().filter_map(Iterator::next).collect::<Vec<_>>()))
            .collect();
        strips.par_iter_mut().for_each(|((number, rows), apart)| {
            let from = *number * ROWS;
            let strip = Strip::<N>::new(task, from, from + rows.len() / width);
            for (at, pixel) in rows.iter_mut().enumerate() {
                let strokes;
                (*pixel, strokes) = strip.pixel(at % width, from + at / width);
                apart.iter_mut().zip(strokes).for_each(|(picture, light)| picture[at] = light);
            }
        });
    }

    /// Adds the street lamps that are in view to a picture, as small round spots that carry all their light; `left` is the share per
    /// colour that gets from a place to the eye, through whatever is between: a lamp is as far as it is, not as what stands behind.
    pub fn draw_lamps(&self, camera: &Camera, left: &dyn Fn(DVec3) -> [f32; 3], picture: &mut Picture) {
        for lamp in &self.lamps {
            let position = Vec3::from_array(lamp.position);
            let Some(place) = camera.project(position.as_dvec3()) else { continue };
            let eye = match camera.projection {
                Projection::Perspective { .. } => camera.position,
                Projection::Orthographic { .. } => DVec3::from(position) - camera.forward * place.depth,
            };
            if place.depth <= 0.0 || self.is_blocked(eye.as_vec3(), position) {
                continue;
            }
            let left = left(position.as_dvec3());
            let intensity: [f32; 3] = std::array::from_fn(|band| lamp.intensity[band] * left[band]);
            lamp_spot(camera, position.as_dvec3(), intensity, picture);
        }
    }
}

/// Adds a lamp that is seen at `position` to a picture, as a small round spot: radiance times the area that it covers is its intensity.
pub(crate) fn lamp_spot(camera: &Camera, position: DVec3, intensity: [f32; 3], picture: &mut Picture) {
    let Some(place) = camera.project(position) else { return };
    let per_metre = match camera.projection {
        Projection::Perspective { .. } => camera.pixels_per_metre() / camera.position.distance(position),
        Projection::Orthographic { .. } => camera.pixels_per_metre(),
    } as f32;
    // Over a disc not below a pixel's own blur.
    let sigma = (LAMP_RADIUS * per_metre).max(0.6);
    let (cx, cy) = (place.pixel.x as f32, place.pixel.y as f32);
    let radius = (3.0 * sigma).ceil();
    let range = |middle: f32, count: usize| {
        let low = (middle - radius).max(0.0) as usize;
        let high = (middle + radius + 1.0).clamp(0.0, count as f32) as usize;
        low..high
    };
    let scale = camera.pixel_aspect as f32 * per_metre * per_metre / (std::f32::consts::TAU * sigma * sigma);
    for y in range(cy, picture.height) {
        for x in range(cx, picture.width) {
            let (dx, dy) = (x as f32 + 0.5 - cx, y as f32 + 0.5 - cy);
            let share = scale * libm::expf(-(dx * dx + dy * dy) / (2.0 * sigma * sigma));
            let pixel = &mut picture.pixels[y * picture.width + x];
            for band in 0..3 {
                pixel[band] += intensity[band] * share;
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::shade::town::light::{GlowLight, SceneLight};
    use crate::shade::town::line::{Images, LineLight};
    use crate::shade::town::rain::NoRain;
    use crate::shade::town::tests::small_town;
    use squall_formats::units::Radians;

    pub(super) fn camera() -> Camera {
        let projection = Projection::Perspective { vertical_fov: Radians(0.9) };
        Camera::new(DVec3::new(0.0, -20.0, 3.0), DVec3::new(0.0, 1.0, 0.1), DVec3::Z, projection, [64, 48])
            .unwrap()
    }

    pub(super) fn lighting<'a>() -> Lighting<'a> {
        Lighting {
            ambient: &|_| [0.1, 0.15, 0.3],
            points: &[],
            images: Images::NONE,
            strokes: &[],
            glows: &[],
            leaves: &|_, direction| [direction.z; 3],
            sun: None,
            rain: &NoRain,
        }
    }

    #[test]
    fn depth_is_infinite_in_the_sky_and_right_on_the_ground() {
        let (town, camera) = (small_town(), camera());
        let mut frame = TownFrame::default();
        town.render(&camera, &lighting(), Quality::default(), &mut frame);
        let top = &frame.pixels[0];
        assert_eq!((top.cover, top.depth, top.distance), (0.0, f32::INFINITY, f32::INFINITY));
        let at = frame.pixels.len() - 60;
        let bottom = &frame.pixels[at];
        assert_eq!((bottom.cover, bottom.normal), (1.0, Vec3::Z));
        let ray = camera.ray(4.5, 47.5);
        let wanted = -3.0 / ray.direction.z;
        assert!((f64::from(bottom.distance) / wanted - 1.0).abs() < 1e-5);
        let planar = wanted * ray.direction.dot(camera.forward);
        assert!((f64::from(bottom.depth) / planar - 1.0).abs() < 1e-5);
        assert!(frame.pixels.iter().all(|p| p.radiance.iter().all(|v| v.is_finite() && *v >= 0.0)));
    }

    #[test]
    fn rays_along_the_horizon_see_finite_light_however_flat_they_are() {
        let town = small_town();
        let glow = GlowLight { centre: Vec3::new(0.0, 9e3, 4e3), radius: 2e3, radiance: [1.0; 3] };
        let bolt = SceneLight { position: Vec3::new(50.0, 3e3, 900.0), intensity: [1e6; 3], visibility: 1.0 };
        let line = LineLight {
            from: bolt.position,
            to: bolt.position + Vec3::Z * 300.0,
            intensity: bolt.intensity,
            visibility: 1.0,
        };
        let images = Images::from(vec![line]);
        let lighting = Lighting { points: &[bolt], images: &images, glows: &[glow], ..lighting() };
        for power in 0..40 {
            // Beside the tower, downwards and upwards.
            for down in [1.0, -1.0, 0.0] {
                let way = DVec3::new(-1.0, 1.0, -down * libm::pow(10.0, -f64::from(power)));
                let projection = Projection::Perspective { vertical_fov: Radians(1e-3) };
                let camera =
                    Camera::new(DVec3::new(0.0, -20.0, 3.0), way, DVec3::Z, projection, [1, 1]).unwrap();
                let mut frame = TownFrame::default();
                town.render(
                    &camera,
                    &lighting,
                    Quality { samples: 1, facets: 3, ..Quality::default() },
                    &mut frame,
                );
                let seen = &frame.pixels[0];
                assert!(seen.radiance.iter().all(|v| v.is_finite() && *v >= 0.0), "{way}: {seen:?}");
            }
        }
    }

    /// Wet ground under a sky that brightens to one side; what one facet a sample shows, less what many show: grain and nothing else.
    fn grain_of_wet_ground(eye: DVec3) -> (Camera, TownFrame, Vec<f64>) {
        let projection = Projection::Perspective { vertical_fov: Radians(0.9) };
        let camera = Camera::new(eye, DVec3::new(0.0, 1.0, -0.9), DVec3::Z, projection, [96, 64]).unwrap();
        let slanted = |_: Vec3, direction: Vec3| [2.0 + direction.x + direction.y; 3];
        let lighting = Lighting { ambient: &|_| [0.0; 3], leaves: &slanted, ..lighting() };
        let town = small_town();
        let [one, many] = [1, 64].map(|facets| {
            let mut frame = TownFrame::default();
            town.render(
                &camera,
                &lighting,
                Quality { samples: 1, facets, spacing: 1, ..Quality::default() },
                &mut frame,
            );
            frame
        });
        let grain = one.pixels.iter().zip(&many.pixels);
        let grain = grain.map(|(one, many)| f64::from(one.radiance[0]) - f64::from(many.radiance[0]));
        let grain = grain.collect();
        (camera, one, grain)
    }

    #[test]
    fn the_grain_of_water_stands_in_the_world_while_the_camera_moves() {
        /// Of grain at the same places of the ground, where these went on by three pixels; places near the edge of a cell come into
        /// another. Three pixels apart, one frame's grain has a correlation near 0.
        const KEPT: f64 = 0.6;
        let (start, before, grain) = grain_of_wet_ground(DVec3::new(0.0, -20.0, 3.0));
        let (camera, _, after) = grain_of_wet_ground(DVec3::new(0.15, -20.0, 3.0));
        let (mut pairs, mut swum) = (Vec::new(), Vec::new());
        // The nearer half: far away a cell is several pixels wide and a fraction of one high.
        for y in 32..64 {
            for x in 0..96 {
                let seen = &before.pixels[y * 96 + x];
                if seen.normal != Vec3::Z || seen.cover < 1.0 {
                    continue;
                }
                let ray = start.ray(x as f64 + 0.5, y as f64 + 0.5);
                let point = ray.origin + ray.direction * f64::from(seen.distance);
                let Some(place) = camera.project(point) else { continue };
                let pixel = place.pixel.floor();
                let off = (place.pixel - pixel - 0.5).abs();
                // Where the same place of the ground is in the middle of a pixel in both pictures.
                if off.max_element() > 0.1
                    || !(0.0..96.0).contains(&pixel.x)
                    || !(0.0..64.0).contains(&pixel.y)
                {
                    continue;
                }
                let again = after[pixel.y as usize * 96 + pixel.x as usize];
                pairs.push([grain[y * 96 + x], again]);
                swum.push([grain[y * 96 + x], after[y * 96 + x]]);
            }
        }
        let correlation = |pairs: &[[f64; 2]]| {
            let count = pairs.len() as f64;
            let mean = [0, 1].map(|i| pairs.iter().map(|pair| pair[i]).sum::<f64>() / count);
            let product = |i: usize, j: usize| {
                pairs.iter().map(|pair| (pair[i] - mean[i]) * (pair[j] - mean[j])).sum::<f64>()
            };
            product(0, 1) / (product(0, 0) * product(1, 1)).sqrt()
        };
        let (kept, lost) = (correlation(&pairs), correlation(&swum));
        println!("{} places: {kept:.3} at the place, {lost:.3} at the pixel", pairs.len());
        assert!(
            pairs.len() > 60 && kept > KEPT && kept > lost + 0.3,
            "{} places, {kept} {lost}",
            pairs.len()
        );
    }

    #[test]
    fn a_lamp_adds_its_whole_light_to_the_picture() {
        /// The spot is cut at three standard deviations.
        const CUT: f32 = 0.02;
        let (town, camera) = (small_town(), camera());
        let mut picture = Picture::new(64, 48).unwrap();
        town.draw_lamps(&camera, &|_| [0.5, 1.0, 1.0], &mut picture);
        let sum: f32 = 2.0 * picture.pixels.iter().map(|pixel| pixel[0]).sum::<f32>();
        // Each pixel near the axis covers 1/f² steradian at unit distance.
        let per_metre = camera.pixels_per_metre() as f32;
        let way = Vec3::new(4.0, 50.0, 5.0);
        let wanted = 10.0 * per_metre * per_metre / way.length_squared();
        assert!((sum / wanted - 1.0).abs() < CUT, "{sum} against {wanted}");
    }

    #[cfg(feature = "rayon")]
    #[test]
    fn any_number_of_threads_gives_the_same_bytes() {
        let render = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut frame = TownFrame::default();
            pool.install(|| {
                small_town().render(&camera(), &lighting(), Quality::default(), &mut frame);
            });
            frame
        };
        assert_eq!(render(1), render(8));
    }
}
