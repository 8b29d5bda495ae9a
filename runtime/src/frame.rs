//! A whole picture of a storm, from its asset alone: cloud lit by its flashes, sky, town, channel, rain.
//!
//! The order is that of light's way back to the eye: what stands farthest first, each nearer thing over it.
//!
//! 1. The asset's rows become light per cell ([`light`]): the flashes' strokes, the sky's hemispheres, the sun.
//! 2. Sky, with the cloud marched in front of it, at every pixel and in a small map for mirrors.
//! 3. The town, lit by all of that; clear air in front of both.
//! 4. The rain's medium, in front of it the channels of strokes in sight, dimmed by what rain is between ([`channel`]).
//! 5. The rain's streaks ([`rain`]).

mod channel;
mod light;
mod rain;

use crate::camera::{Camera, Projection, Ray};
use crate::error::RuntimeError;
use crate::load::Asset;
use crate::picture::Picture;
use crate::rain::{Rain, Surroundings, Workspace};
use crate::relight::{RelightBuffers, Relighter};
use crate::shade::cloud::{CloudPicture, CloudShape, CloudView};
use crate::shade::detail::{Detail, DetailParameters};
use crate::shade::environment::{Environment, EnvironmentWindow};
use crate::shade::sky::{Sky, SkyParameters};
use crate::shade::streak::StreakSet;
use crate::shade::town::Town;
use crate::shade::town::frame::{Quality, TownFrame};
use crate::shade::town::light::Lighting;
use crate::stroke::{Stroke, flashing, grow_together};
use crate::tone::{Tone, glow::Glow};
use glam::{DVec3, Vec3, Vec4};
use squall_formats::section::bolt::{BoltSection, StrokeRecord};
use squall_formats::section::cloud::CloudSection;
use squall_formats::section::density::DensitySection;
use squall_formats::section::streak::StreakSection;
use squall_formats::section::town::TownSection;
use squall_formats::section::view::{ViewCamera, ViewDetail, ViewSection, ViewSky, ViewTone};
use squall_formats::units::Radians;

/// Heights that clear air is looked through between: the eye's, and the middle of what stands around it or of a cloud, m.
const EYE_M: f64 = 2.0;
const TOWN_M: f64 = 10.0;
const CLOUD_M: f64 = 4_000.0;
/// The mirrors' map: half its width, its top, columns and rows.
const MIRROR_HALF_WIDTH: f64 = 1.1;
const MIRROR_TOP: f64 = 1.2;
const MIRROR_SIZE: [usize; 2] = [400, 240];
/// Beyond this distance the town's ground is as far as the air goes, m.
const FARTHEST_GROUND_M: f32 = 4e4;

/// An asset opened for drawing pictures of its storm. What it lacks is not drawn.
pub struct Storm<'a> {
    cloud: Option<(Relighter<'a>, CloudShape)>,
    asset: &'a Asset,
    strokes: Vec<StrokeRecord>,
    rain: Option<DensitySection>,
    patterns: StreakSet,
    town: Option<Town>,
    view: Option<ViewSection>,
}

/// How finely a picture is worked out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameQuality {
    /// Samples of the town within a pixel, and of its mirrors.
    pub town: Quality,
    /// Rays from each point of a stroke for its direct light.
    pub rays_per_point: u32,
}

impl Default for FrameQuality {
    /// A still picture's.
    fn default() -> Self {
        Self { town: Quality { samples: 2, facets: 3 }, rays_per_point: 1024 }
    }
}

/// Memory for pictures; most of it is kept from one to the next.
#[derive(Default)]
pub struct FrameMemory {
    /// The last picture: linear radiance, W/(m² sr).
    pub picture: Option<Picture>,
    sky: Option<(SkyParameters, Sky)>,
    detail: Option<(DetailParameters, Detail)>,
    relight: RelightBuffers,
    cells: Vec<Vec4>,
    flash_cells: Vec<Vec4>,
    town: TownFrame,
    rain: Workspace,
    transmittance: Vec<f32>,
    metres: Vec<f32>,
}

/// What a picture took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameReport {
    /// Points of light on the flashing strokes.
    pub lights: usize,
    /// Baked sources that they were split over.
    pub sources: usize,
    /// Rain streaks found.
    pub streaks: usize,
}

impl<'a> Storm<'a> {
    /// Opens every part of `asset` that pictures need.
    ///
    /// Errors: a part that is there and damaged.
    pub fn new(asset: &'a Asset) -> Result<Self, RuntimeError> {
        let has = |tag| asset.directory().find(tag).is_some();
        let cloud = if has(CloudSection::TAG) {
            let relighter = Relighter::new(asset)?;
            let shape = CloudShape::new(relighter.cloud());
            Some((relighter, shape))
        } else {
            None
        };
        let mut strokes = Vec::new();
        if has(BoltSection::TAG) {
            let section = asset.section(BoltSection::TAG, "the strokes", BoltSection::read)?;
            strokes = section.strokes;
        }
        let rain = if has(DensitySection::TAG) {
            Some(asset.section(DensitySection::TAG, "the rain's density", DensitySection::read)?)
        } else {
            None
        };
        let patterns = if has(StreakSection::TAG) {
            asset.section(StreakSection::TAG, "streak patterns", StreakSection::read)?
        } else {
            StreakSection { patterns: Vec::new() }
        };
        let town = if has(TownSection::TAG) {
            Some(Town::new(&asset.section(TownSection::TAG, "the town", TownSection::read)?))
        } else {
            None
        };
        let view = if has(ViewSection::TAG) {
            Some(asset.section(ViewSection::TAG, "the view", ViewSection::read)?)
        } else {
            None
        };
        Ok(Self { cloud, asset, strokes, rain, patterns: StreakSet::new(&patterns), town, view })
    }

    /// The view that the asset brings.
    pub fn view(&self) -> Option<&ViewSection> {
        self.view.as_ref()
    }

    /// The asset's strokes, as the numbers that grow them: a stroke grows when it flashes.
    pub fn strokes(&self) -> &[StrokeRecord] {
        &self.strokes
    }

    /// Draws `view` into `memory.picture`.
    ///
    /// Errors: a view out of range, a stroke that the asset does not have or whose light was not baked, rain where the
    /// asset has none, a damaged row.
    pub fn draw(
        &self,
        view: &ViewSection,
        quality: FrameQuality,
        memory: &mut FrameMemory,
    ) -> Result<FrameReport, RuntimeError> {
        view.check().map_err(|(field, wanted, found)| RuntimeError::argument(field, wanted, found))?;
        let camera = camera_of(&view.camera)?;
        let parameters = sky_of(&view.sky);
        let sky = match memory.sky.take() {
            Some((known, sky)) if known == parameters => sky,
            _ => Sky::new(&parameters)?,
        };
        let billows = detail_of(&view.detail);
        let detail = match memory.detail.take() {
            Some((known, detail)) if known == billows => detail,
            _ => Detail::new(&billows)?,
        };
        let drawn = self.draw_with(view, &camera, (&sky, &detail), quality, memory);
        memory.sky = Some((parameters, sky));
        memory.detail = Some((billows, detail));
        drawn
    }

    fn draw_with(
        &self,
        view: &ViewSection,
        camera: &Camera,
        (sky, detail): (&Sky, &Detail),
        quality: FrameQuality,
        memory: &mut FrameMemory,
    ) -> Result<FrameReport, RuntimeError> {
        let mut report = FrameReport::default();
        let flashing = self.flashing(view)?;
        let grown = grow_together(flashing.iter().map(|&(record, _)| record), self.asset.limits())
            .map_err(|error| self.asset.wrap(error))?;
        let flash = |(&(record, brightness), stroke)| Flash { record, stroke, brightness };
        let flashes: Vec<Flash<'_>> = flashing.iter().zip(&grown).map(flash).collect();
        let size = [camera.width as usize, camera.height as usize];
        let mut picture = match memory.picture.take() {
            Some(picture) if [picture.width, picture.height] == size => picture,
            _ => Picture::new(size[0], size[1])?,
        };
        if let Some((relighter, _)) = &self.cloud {
            report = light::light_cells(relighter, camera, sky, &flashes, quality.rays_per_point, memory)?;
        }
        let billow = (view.detail.amplitude > 0.0).then_some(view.detail.size_m as f32);
        let marched = |cells| {
            let (relighter, shape) = self.cloud.as_ref()?;
            Some(CloudPicture::new(relighter.cloud(), shape, cells, detail, billow))
        };
        let cloud = marched(memory.cells.as_slice());
        let beyond = |ray: &Ray| {
            let mut light = sky.radiance(ray.direction.as_vec3());
            if let Some(cloud) = &cloud {
                cover(&mut light, cloud.march(ray), sky);
            }
            light
        };
        let eye = camera.position;
        if let Some(town) = &self.town {
            let window = EnvironmentWindow {
                heading: Radians(view.camera.heading_rad),
                half_width: Radians(MIRROR_HALF_WIDTH),
                top: Radians(MIRROR_TOP),
                size: MIRROR_SIZE,
            };
            let from_eye = |direction: Vec3| Ray { origin: eye, direction: direction.as_dvec3() };
            let mirror = Environment::new(window, &|direction| beyond(&from_eye(direction)));
            let lit = marched(memory.flash_cells.as_slice());
            let glows = lit.as_ref().map(|cloud| light::glow_of(cloud, eye)).unwrap_or_default();
            let air = |distance: f64| sky.air_view(EYE_M, CLOUD_M, distance).transmittance;
            let cloud_grid = self.cloud.as_ref().map(|(relighter, _)| relighter.cloud());
            let points = channel::town_lights(&flashes, cloud_grid, eye, &air);
            let ambient = |normal: Vec3| sky.ambient_irradiance(normal);
            let leaves = |_: Vec3, direction: Vec3| mirror.lookup(direction);
            let lighting = Lighting {
                ambient: &ambient,
                points: &points.shadows,
                images: &points.images,
                glows: &glows,
                leaves: &leaves,
            };
            town.render(camera, &lighting, quality.town, &mut memory.town);
        }
        self.compose(camera, sky, &beyond, &memory.town, &mut picture);
        let surroundings = Surroundings::from_picture(&picture);
        let channels = channel::Channels {
            flashes: &flashes,
            camera,
            sky,
            cloud: self.cloud_grid(),
            town: self.town.as_ref(),
        };
        if let Some(section) = &self.rain {
            let rain = Rain::new(section, view.rain.seed);
            let task = rain::Task {
                section,
                rain: &rain,
                patterns: &self.patterns,
                view,
                camera,
                sky,
                flashes: &flashes,
                cloud: self.cloud_grid(),
                lamps: self.town.as_ref().map_or(&[], |town| town.lamps()),
                has_depth: self.town.is_some(),
                surroundings,
            };
            let veil = rain::veil(&task, &mut picture, memory)?;
            channels.draw(&|point| veil.left(camera, point), &mut picture);
            report.streaks = rain::streaks(&task, &veil, &mut picture, memory)?;
        } else if view.rain.rate_mm_per_h > 0.0 {
            let found = format!("{} mm/h", view.rain.rate_mm_per_h);
            return Err(RuntimeError::argument("rain.rate_mm_per_h", "0: this asset has no rain", found));
        } else {
            channels.draw(&|_| 1.0, &mut picture);
        }
        memory.picture = Some(picture);
        Ok(report)
    }

    fn cloud_grid(&self) -> Option<&crate::transport::Cloud> {
        self.cloud.as_ref().map(|(relighter, _)| relighter.cloud())
    }

    /// The strokes that the view lets flash, each with its factor.
    fn flashing(&self, view: &ViewSection) -> Result<Vec<(&StrokeRecord, f64)>, RuntimeError> {
        flashing(&view.flashes, &self.strokes).map_err(|unknown| {
            let names: Vec<&str> = self.strokes.iter().take(64).map(|record| record.name.as_str()).collect();
            let known = format!("the name of one of the asset's strokes ({})", names.join(", "));
            RuntimeError::argument("flashes.stroke", known, unknown)
        })
    }

    /// Sky and cloud behind the town, clear air in front.
    fn compose(
        &self,
        camera: &Camera,
        sky: &Sky,
        beyond: &(dyn Fn(&Ray) -> [f32; 3] + Sync),
        town: &TownFrame,
        picture: &mut Picture,
    ) {
        let (width, has_town) = (picture.width, self.town.is_some());
        let row = |(y, row): (usize, &mut [[f32; 3]])| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let seen = has_town.then(|| town.pixels[y * width + x]);
                let cover = seen.map_or(0.0, |seen| seen.cover);
                *pixel = [0.0; 3];
                if cover < 1.0 {
                    let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
                    *pixel = beyond(&ray).map(|value| value * (1.0 - cover));
                }
                let Some(seen) = seen else { continue };
                let air = sky.air_view(EYE_M, TOWN_M, f64::from(seen.distance.min(FARTHEST_GROUND_M)));
                for band in 0..3 {
                    pixel[band] += seen.radiance[band] * air.transmittance[band] + air.added[band] * cover;
                }
            }
        };
        #[cfg(feature = "rayon")]
        {
            use rayon::prelude::*;
            picture.pixels.par_chunks_mut(width).enumerate().for_each(row);
        }
        #[cfg(not(feature = "rayon"))]
        picture.pixels.chunks_mut(width).enumerate().for_each(row);
    }
}

/// A stroke that flashes.
#[derive(Clone, Copy)]
struct Flash<'a> {
    record: &'a StrokeRecord,
    stroke: &'a Stroke,
    brightness: f64,
}

impl Flash<'_> {
    /// Radiant intensity per channel of a piece of the stroke, W/sr.
    fn intensity(&self, intensity: f64) -> [f32; 3] {
        self.record.color.map(|band| (f64::from(band) * intensity * self.brightness) as f32)
    }
}

/// Lays a cloud over the sky behind it, through the clear air in front of it.
fn cover(light: &mut [f32; 3], cloud: CloudView, sky: &Sky) {
    if cloud.transmittance == 1.0 {
        return;
    }
    let air = sky.air_view(EYE_M, CLOUD_M, f64::from(cloud.distance));
    for band in 0..3 {
        light[band] = light[band] * cloud.transmittance
            + cloud.radiance[band] * air.transmittance[band]
            + air.added[band] * (1.0 - cloud.transmittance);
    }
}

/// The camera of a view.
///
/// Errors: a degenerate one.
pub fn camera_of(view: &ViewCamera) -> Result<Camera, RuntimeError> {
    let (sin_h, cos_h) = libm::sincos(view.heading_rad);
    let (sin_p, cos_p) = libm::sincos(view.pitch_rad);
    let forward = DVec3::new(cos_h * cos_p, sin_h * cos_p, sin_p);
    // Straight up or down, the top of the picture is where the heading points or comes from.
    let up = DVec3::new(-cos_h * sin_p, -sin_h * sin_p, cos_p);
    let projection = Projection::Perspective { vertical_fov: Radians(view.vertical_fov_rad) };
    Camera::new(DVec3::from_array(view.position_m), forward, up, projection, view.size_px)
}

/// How a view's light becomes a picture.
pub fn tone_of(view: &ViewTone) -> Tone {
    let glow =
        Glow { amount: view.glow_amount as f32, levels: view.glow_levels, reach: view.glow_reach as f32 };
    Tone { exposure: view.exposure as f32, contrast: view.contrast as f32, glow, ..Tone::default() }
}

fn sky_of(view: &ViewSky) -> SkyParameters {
    SkyParameters {
        sun_azimuth: Radians(view.sun_azimuth_rad),
        sun_elevation: Radians(view.sun_elevation_rad),
        haze: view.haze,
        overcast: view.overcast,
        high_cloud: view.high_cloud,
        sun_irradiance: view.sun_irradiance_w_per_m2,
        tint: view.tint,
        ground_albedo: view.ground_albedo,
        seed: view.seed,
    }
}

fn detail_of(view: &ViewDetail) -> DetailParameters {
    DetailParameters {
        amplitude: view.amplitude as f32,
        size: view.size_m as f32,
        fibres_from: view.fibres_from_m as f32,
        seed: view.seed,
    }
}
