//! The rain in front of a picture: its medium first, its streaks over that.

use super::channel::irradiance_at;
use super::{Flash, FrameMemory};
use crate::camera::{Camera, Ray};
use crate::depth::{DepthBuffer, DepthKind};
use crate::error::RuntimeError;
use crate::medium::{Illumination, Medium, Outlook};
use crate::phase::henyey_greenstein;
use crate::picture::Picture;
use crate::rain::{
    Ceiling, Environment, Light, Rain, RainVolume, Region, Scene, Shot, SmoothWindow, Weather,
};
use crate::shade::sky::Sky;
use crate::shade::streak::StreakSet;
use crate::transport::Cloud;
use glam::DVec3;
use squall_formats::drops::Optics;
use squall_formats::section::density::DensitySection;
use squall_formats::section::town::StreetLamp;
use squall_formats::section::view::{ViewRain, ViewSection};
use squall_formats::units::{Metres, MillimetresPerHour, Seconds};

/// What the rain of a picture depends on.
pub struct Task<'a> {
    pub section: &'a DensitySection,
    pub rain: &'a Rain,
    pub patterns: &'a StreakSet,
    pub view: &'a ViewSection,
    pub camera: &'a Camera,
    pub sky: &'a Sky,
    pub flashes: &'a [Flash<'a>],
    pub cloud: Option<&'a Cloud>,
    pub lamps: &'a [StreetLamp],
    pub has_depth: bool,
    /// The picture's own radiances, before its channels were drawn: a drop's surroundings.
    pub surroundings: Environment,
}

/// Street lamps farther from the eye than this light no drop that is drawn, m.
const LAMP_REACH_M: f64 = 60.0;

/// What drops show: the scene around them, and the street lamps near by.
struct DropLight {
    scene: Environment,
    lamps: Vec<(DVec3, [f32; 3])>,
}

impl Light for DropLight {
    fn radiance(&self, ray: &Ray, distance: f64) -> [f32; 3] {
        let mut light = self.scene.radiance(ray, distance);
        let drop = ray.origin + ray.direction * distance;
        for (lamp, intensity) in &self.lamps {
            let way = drop - *lamp;
            let squared = way.length_squared().max(0.01);
            let cosine = -way.dot(ray.direction) / squared.sqrt();
            let share = henyey_greenstein(Optics::GEOMETRIC.asymmetry, cosine) / squared;
            for band in 0..3 {
                light[band] += (f64::from(intensity[band]) * share) as f32;
            }
        }
        light
    }
}

/// Draws the view's rain over `picture`; returns how many streaks were found.
pub fn draw_rain(
    task: &Task<'_>,
    picture: &mut Picture,
    memory: &mut FrameMemory,
) -> Result<usize, RuntimeError> {
    let (view, camera) = (&task.view.rain, task.camera);
    if view.rate_mm_per_h == 0.0 {
        return Ok(0);
    }
    let rate = MillimetresPerHour(view.rate_mm_per_h);
    let shot = Shot {
        min_px: view.streak_px[0],
        max_px: view.streak_px[1],
        ..Shot::new(camera, Seconds(task.view.camera.exposure_s))
    };
    let wind = DVec3::from_array(view.wind_m_per_s);
    let weather = Weather { volume: volume_of(view), ..Weather::steady(rate, wind, Seconds(view.time_s)) };
    let (irradiance, direction) = irradiance_at(task.flashes, task.cloud, task.sky, camera.position);
    let mut scene = task.surroundings;
    (scene.flash_irradiance, scene.flash_direction) = (irradiance, direction);
    let mean = |a: f32, b: f32| 0.5 * (a + b);
    let ambient: [f32; 3] = std::array::from_fn(|band| mean(scene.above[band], scene.below[band]));
    memory.metres.clear();
    if task.has_depth {
        memory.metres.extend(memory.town.pixels.iter().map(|pixel| pixel.distance));
    } else {
        memory.metres.resize(picture.pixels.len(), f32::INFINITY);
    }
    let depth = DepthBuffer::new(&memory.metres, picture.width, picture.height, DepthKind::Range)?;
    let medium = Medium::beside_streaks(task.section, &shot, rate)?;
    let light = Illumination { irradiance, direction, ambient };
    let outlook = Outlook { camera, volume: weather.volume, light, depth: Some(depth) };
    memory.transmittance.resize(picture.pixels.len(), 0.0);
    medium.apply(&outlook, picture, &mut memory.transmittance)?;
    let found = task.rain.find(&shot, &weather, None, &mut memory.rain)?.len();
    let near = |lamp: &&StreetLamp| {
        DVec3::from_array(lamp.position.map(f64::from)).distance(camera.position) < LAMP_REACH_M
    };
    let lamps = task.lamps.iter().filter(near);
    let lamps = lamps.map(|lamp| (DVec3::from_array(lamp.position.map(f64::from)), lamp.intensity)).collect();
    let light = DropLight { scene, lamps };
    if task.patterns.is_empty() {
        let scene = Scene { depth: Some(depth), kernel: &SmoothWindow, light: &light, gain: view.gain };
        memory.rain.draw(&shot, &scene, picture)?;
    } else {
        let scene = Scene { depth: Some(depth), kernel: task.patterns, light: &light, gain: view.gain };
        memory.rain.draw(&shot, &scene, picture)?;
    }
    Ok(found)
}

fn volume_of(view: &ViewRain) -> RainVolume {
    RainVolume {
        ceiling: view
            .ceiling_m
            .map(|[height, softness]| Ceiling { height: Metres(height), softness: Metres(softness) }),
        region: view.region_m.map(|[x, y, radius, softness]| Region {
            centre: [x, y],
            radius: Metres(radius),
            softness: Metres(softness),
        }),
    }
}
