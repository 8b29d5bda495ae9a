//! The rain in front of a picture: its medium first, its streaks over that.

use super::Memory;
use super::channel::irradiance_at;
use super::cloud_shade::CloudShade;
use super::halos::{self, Halos};
use super::lit_stroke::LitStroke;
use super::rain_sun::{RainSun, SunTable};
use super::sun_shadows::SunShadows;
use crate::camera::{Camera, Ray};
use crate::depth::{DepthBuffer, DepthKind};
use crate::error::RuntimeError;
use crate::frame::Frame;
use crate::medium::{Medium, Outlook, Phase};
use crate::picture::Picture;
use crate::rain::{
    CoveredRain, Covers, MainLight, MapChoice, Rain, RainFan, RainField, RainLight, RainMap, RainPath,
    RainPlace, Scene, Shelter, Shot, SmoothWindow, Workspace,
};
use crate::shade::streak::StreakSet;
use crate::shade::town::Town;
use crate::world::{Beam, InScattering, Sun};
use glam::DVec3;
use squall_formats::section::density::DensitySection;
use squall_formats::section::rain_place::RainPlaceSection;
use squall_formats::section::town::StreetLamp;
use squall_formats::units::Metres;
use std::sync::Arc;

/// What the rain of a picture depends on.
pub struct Task<'a> {
    pub section: &'a DensitySection,
    pub rain: &'a Rain,
    pub patterns: &'a StreakSet,
    pub frame: &'a Frame,
    pub flashes: &'a [LitStroke],
    pub lamps: &'a [StreetLamp],
    pub town: Option<&'a Town>,
    pub place: &'a Place,
    pub has_depth: bool,
    /// A scene of the caller's.
    pub before: Option<&'a super::foreground::Pixels>,
    /// Mean radiance of the whole sphere, the sun left out.
    pub around: [f32; 3],
    /// That of the sky alone, without cloud and flashes.
    pub sky: [f32; 3],
    /// What a drop shows of the world and of the flashes.
    pub drops: &'a InScattering,
    /// What keeps the sun off, where it shines on the eye's surroundings.
    pub sun_shadows: Option<SunShadows<'a>>,
    /// The sun above rain and cloud, and the cloud before it, where the rain dims it; else the medium has it by eq. 12 of \[weber\].
    pub sun: Option<(Sun, Option<&'a CloudShade>)>,
}

/// Share of its cell by which a map of rain moves at once under light that is kept.
const STANDING: f64 = 1.0 / 16.0;

/// Where an asset's rain is.
#[derive(Default)]
pub struct Place {
    map: Option<Arc<RainMap>>,
    farthest: Option<Metres>,
}

impl Place {
    /// What a section says.
    pub fn new(section: &RainPlaceSection) -> Result<Self, RuntimeError> {
        let map = section.map.as_ref().map(RainMap::from_record).transpose()?.map(Arc::new);
        Ok(Self { map, farthest: section.farthest_m.map(Metres) })
    }

    /// The same measured from another point.
    pub fn measured_from(self, point: DVec3) -> Self {
        Self { map: self.map.map(|map| Arc::new(map.measured_from(point))), ..self }
    }

    /// The map that the frame's rain has.
    pub fn map_of<'a>(&'a self, frame: &'a Frame) -> Option<&'a RainMap> {
        match &frame.place.map {
            MapChoice::Asset => self.map.as_deref(),
            MapChoice::Even => None,
            MapChoice::Own(map) => Some(map.as_ref()),
        }
    }

    /// The frame's rain, as its camera sees it.
    pub fn field<'a>(&'a self, frame: &'a Frame) -> RainField<'a> {
        let (weather, place) = (&frame.weather, &frame.place);
        let field = RainField::from(weather.volume).with_farthest(place.farthest.or(self.farthest));
        self.map_of(frame).map_or(field, |map| field.with_map(map, weather.drift, frame.camera.position))
    }

    /// Where the map of the frame's rain stands for light that is kept from frame to frame: at the nearest of places a sixteenth of its
    /// cell apart, so that the wind moves it now and then and not with every frame. Zero without a map.
    pub fn standing_drift(&self, frame: &Frame) -> DVec3 {
        self.map_of(frame).map_or(DVec3::ZERO, |map| {
            let step = STANDING * map.cell();
            let drift = frame.weather.drift;
            DVec3::new(libm::rint(drift.x / step) * step, libm::rint(drift.y / step) * step, drift.z)
        })
    }

    /// [`Place::field`] with the map where [`Place::standing_drift`] says.
    pub fn standing_field<'a>(&'a self, frame: &'a Frame) -> RainField<'a> {
        let field =
            RainField::from(frame.weather.volume).with_farthest(frame.place.farthest.or(self.farthest));
        let drift = self.standing_drift(frame);
        self.map_of(frame).map_or(field, |map| field.with_map(map, drift, frame.camera.position))
    }
}

/// Street lamps farther from the eye than this light no drop that is drawn, m.
pub(super) const LAMP_REACH_M: f64 = 60.0;

/// A street lamp near the eye: its number in the town, its place and its intensity.
type NearLamp = (usize, DVec3, [f32; 3]);

/// What drops show: the scene around them, and the street lamps near by.
struct DropLight<'a> {
    world: &'a InScattering,
    lamps: Vec<NearLamp>,
    /// What stands between the lamps and drops.
    walls: Option<&'a Town>,
    /// What stands between the sun and drops.
    sun_shadows: Option<SunShadows<'a>>,
    /// Mean radiance around, and how many times a flash counts when drops pick patterns.
    around: f64,
    lightning_bias: f64,
    /// Whether the world's last beam is the flashes'; without one it may be the sun's.
    has_flash: bool,
}

fn mean(light: &[f32; 3]) -> f64 {
    light.iter().map(|&band| f64::from(band)).sum::<f64>() / 3.0
}

impl DropLight<'_> {
    /// Distant lights that reach a drop: without the sun, which is the first if there is one, in the shadow of towers and hills. The flash's is the
    /// last.
    fn beams_at(&self, drop: DVec3) -> &[Beam] {
        let is_dark = self.sun_shadows.is_some_and(|sun_shadows| sun_shadows.is_dark(drop));
        &self.world.beams()[usize::from(is_dark)..]
    }
}

impl RainLight for DropLight<'_> {
    fn radiance(&self, ray: &Ray, distance: f64) -> [f32; 3] {
        let mut light = self.world.radiance(ray.direction);
        let drop = ray.origin + ray.direction * distance;
        if self.sun_shadows.is_some_and(|sun_shadows| sun_shadows.is_dark(drop)) {
            let sun = self.world.of_sun(ray.direction);
            (0..3).for_each(|band| light[band] = (light[band] - sun[band]).max(0.0));
        }
        for (number, lamp, intensity) in &self.lamps {
            let reaches = self.walls.map_or(1.0, |town| town.lamp_reaches(*number, drop.as_vec3()));
            if reaches == 0.0 {
                continue;
            }
            let way = drop - *lamp;
            let squared = way.length_squared().max(0.01);
            let cosine = -way.dot(ray.direction) / squared.sqrt();
            let share = self.world.phase().values(cosine);
            for band in 0..3 {
                light[band] += reaches * (f64::from(intensity[band]) * share[band] / squared) as f32;
            }
        }
        light
    }

    fn contrast(&self, ray: &Ray, distance: f64) -> f32 {
        let drop = ray.origin + ray.direction * distance;
        let lamp =
            |(_, lamp, intensity): &NearLamp| mean(intensity) / (*lamp - drop).length_squared().max(0.01);
        self.world.contrast_of_beams(self.beams_at(drop), self.lamps.iter().map(lamp).sum())
    }

    fn main_light(&self, ray: &Ray, distance: f64) -> Option<MainLight> {
        let drop = ray.origin + ray.direction * distance;
        let beams = self.beams_at(drop).iter().rev().enumerate();
        let beams = beams.map(|(at, beam)| {
            let bias = if at == 0 && self.has_flash { self.lightning_bias } else { 1.0 };
            (beam.towards, mean(&beam.irradiance) * bias)
        });
        let lamps = self.lamps.iter().map(|(_, lamp, intensity)| {
            let way = *lamp - drop;
            (way.normalize_or_zero(), mean(intensity) / way.length_squared().max(0.01))
        });
        let (towards, irradiance) = beams.chain(lamps).max_by(|a, b| a.1.total_cmp(&b.1))?;
        MainLight::new(towards, irradiance, self.around)
    }
}

/// The rain's medium in front of a picture, and the light that it and its drops are in.
pub struct RainMedium<'a> {
    medium: Option<Medium>,
    field: RainField<'a>,
    /// The same under the covers, as the eye sees it.
    covered: Option<CoveredRain<'a, RainFan<'a>>>,
    light: DropLight<'a>,
}

impl RainMedium<'_> {
    /// Share of a point's light that reaches the camera through the rain.
    pub fn left(&self, camera: &Camera, point: DVec3) -> f32 {
        let Some(medium) = &self.medium else { return 1.0 };
        let offset = point - camera.position;
        let Some(direction) = offset.try_normalize() else { return 1.0 };
        let secant = 1.0 / direction.dot(camera.forward).max(1e-6);
        let ray = Ray { origin: camera.position, direction };
        let depth = offset.length() / secant;
        let found = match &self.covered {
            Some(covered) => medium.optical_depth_in(covered, &ray, depth, secant),
            None => medium.optical_depth_in(&self.field, &ray, depth, secant),
        };
        libm::exp(-found) as f32
    }
}

pub(super) fn shot_of(frame: &Frame) -> Shot<'_> {
    let [min_px, max_px] = frame.streaks.length_px;
    Shot { min_px, max_px, ..Shot::new(&frame.camera, frame.exposure) }
}

/// Refuses rain that cannot be drawn, before anything is.
///
/// Errors: rain where the asset has none; as [`Rain::find`].
pub fn check(
    section: Option<&DensitySection>,
    frame: &Frame,
    workspace: &mut Workspace,
) -> Result<(), RuntimeError> {
    let rate = frame.weather.rate.0;
    if rate == 0.0 {
        return Ok(());
    }
    let Some(section) = section else {
        let (field, wanted) = ("rain.rate_mm_per_h", "0: this asset has no rain");
        return Err(RuntimeError::argument(field, wanted, format!("{rate} mm/h")));
    };
    Rain::new(section, frame.streaks.seed).check(&shot_of(frame), &frame.weather, workspace)
}

fn depth_of<'a>(metres: &'a [f32], picture: &Picture) -> Result<DepthBuffer<'a>, RuntimeError> {
    DepthBuffer::new(metres, picture.width, picture.height, DepthKind::Range)
}

/// The flashes at the eye, as one distant light; those with halos of their own are left out.
pub(super) fn flash_at(flashes: &[LitStroke], eye: DVec3, leave_out: impl Fn(&LitStroke) -> bool) -> Beam {
    let (irradiance, direction) = irradiance_at(flashes.iter().filter(|flash| !leave_out(flash)), eye);
    Beam { towards: -direction, irradiance }
}

/// The flashes at the eye, as one distant light.
pub fn flash_at_eye(flashes: &[LitStroke], eye: DVec3) -> Beam {
    flash_at(flashes, eye, |_| false)
}

/// Composites the frame's medium over the picture; `in_rain` says what a phase function shows of the world, without flashes, and without the
/// sun where the task has it.
pub fn medium<'a>(
    task: &Task<'a>,
    mut in_rain: impl FnMut(&Phase) -> InScattering,
    memory: &mut Memory,
) -> Result<RainMedium<'a>, RuntimeError> {
    let (weather, camera) = (&task.frame.weather, &task.frame.camera);
    let field = task.place.field(task.frame);
    let place = |lamp: &StreetLamp| DVec3::from_array(lamp.position.map(f64::from));
    let near = |(_, lamp): &(usize, &StreetLamp)| place(lamp).distance(camera.position) < LAMP_REACH_M;
    let lamps = task.lamps.iter().enumerate().filter(near);
    let lamps = lamps.map(|(number, lamp)| (number, place(lamp), lamp.intensity)).collect();
    let brightness: f64 = task.frame.flashes.iter().map(|flash| flash.brightness).sum();
    let lightning_bias = 1.0 + task.frame.streaks.lightning_bias * brightness;
    let around = mean(&task.around);
    let has_flash = flash_at_eye(task.flashes, camera.position).irradiance != [0.0; 3];
    let light = DropLight {
        world: task.drops,
        lamps,
        walls: task.town,
        sun_shadows: task.sun_shadows,
        around,
        lightning_bias,
        has_flash,
    };
    if weather.rate.0 == 0.0 {
        return Ok(RainMedium { medium: None, field, covered: None, light });
    }
    memory.metres.clear();
    if task.has_depth {
        memory.metres.extend(memory.town.frame().pixels.iter().map(|pixel| pixel.distance));
    } else {
        memory.metres.resize(memory.picture.pixels.len(), f32::INFINITY);
    }
    if let Some(before) = task.before {
        before.shorten(camera, &mut memory.metres);
    }
    let depth = Some(depth_of(&memory.metres, &memory.picture)?);
    let medium = task.frame.medium.medium(task.section, &shot_of(task.frame), field.rate(weather.rate))?;
    // Within the same rain as the eye, a light has its halo; from beyond, it is a beam.
    let eye = camera.position;
    let full = field.filled_radius(eye).min(field.farthest());
    let near = |flash: &LitStroke| halos::stands_within(flash, eye, full);
    let own = in_rain(medium.phase()).with_beam(flash_at(task.flashes, eye, near));
    let fall = fall_of(task.section, (task.frame, &field))?;
    let covers = covers_of(task.town, &task.frame.place);
    let covered = CoveredRain::new(RainFan::new(field, camera), covers, fall, camera);
    let outlook = Outlook { camera, volume: &covered, light: &own, depth };
    memory.transmittance.resize(memory.picture.pixels.len(), 0.0);
    // The town's own depth has no holes.
    medium.apply(&outlook, &mut memory.picture, &mut memory.transmittance)?;
    draw_sun(task, (&medium, &field, &covered), memory);
    let spreading = halos::Spreading::of(memory.spreading.take(), medium.phase());
    let lamps = halos::kept::Lamps {
        frame: task.frame,
        lamps: task.lamps,
        walls: task.town,
        metres: &memory.metres,
        sky: task.sky,
        drift: task.place.standing_drift(task.frame),
    };
    memory.lamp_halos = lamps.draw(memory.lamp_halos.take(), &mut memory.picture, |dark, own| {
        // All of it where the map stands for light that is kept.
        let standing = task.place.standing_field(task.frame);
        let rate = standing.rate(weather.rate);
        let medium = task.frame.medium.medium(task.section, &shot_of(task.frame), rate)?;
        let fall = fall_of(task.section, (task.frame, &standing))?;
        let covers = covers_of(task.town, &task.frame.place);
        let fan = RainFan::new(standing, camera);
        let covered = CoveredRain::new(&fan, covers, fall, camera);
        let mut halos = Halos::new(&spreading, &medium, &fan)
            .with_walls(task.town)
            .with_spacing(task.frame.quality.halos)
            .under(&covered)
            .before(dark);
        halos.add_lamps(task.lamps, eye);
        halos.draw(camera, &memory.metres, own);
        Ok(())
    })?;
    let mut halos =
        Halos::new(&spreading, &medium, &field).with_spacing(task.frame.quality.halos).under(&covered);
    task.flashes.iter().filter(|flash| near(flash)).for_each(|flash| halos.add_stroke(flash, eye));
    halos.draw(camera, &memory.metres, &mut memory.picture);
    memory.spreading = Some(spreading);
    Ok(RainMedium { medium: Some(medium), field, covered: Some(covered), light })
}

/// The sun in the medium, where the medium does not have it yet, and shadows in that.
fn draw_sun(
    task: &Task<'_>,
    (medium, field, covered): (&Medium, &RainField<'_>, &CoveredRain<'_, RainFan<'_>>),
    memory: &mut Memory,
) {
    let camera = &task.frame.camera;
    let (metres, left) = (&memory.metres, &memory.transmittance);
    let table = task.sun.map(|(sun, shade)| {
        let sun =
            RainSun { field: *field, extinction: medium.extinction().0, phase: medium.phase(), sun, shade };
        let table = SunTable::new(&sun, camera);
        table.draw(&sun, camera, (metres, left), &mut memory.picture);
        table
    });
    let sun_shadows = match task.sun {
        Some((sun, _)) => SunShadows::new(task.town, Some(sun)),
        None => task.sun_shadows,
    };
    if let Some(sun_shadows) = sun_shadows {
        let how = (task.frame.quality.halos, table.as_ref());
        sun_shadows.draw((medium, covered), camera, (metres, left), how, &mut memory.picture);
    }
}

/// How the frame's drops fall, the mean over what they cover, m/s.
pub(super) fn fall_of(
    section: &DensitySection,
    (frame, field): (&Frame, &RainField<'_>),
) -> Result<DVec3, RuntimeError> {
    Ok(frame.weather.wind - DVec3::Z * Medium::fall_speed(section, field.rate(frame.weather.rate))?)
}

/// What keeps the frame's rain off.
pub(super) fn covers_of<'a>(town: Option<&'a Town>, place: &'a RainPlace) -> Covers<'a> {
    let town = town.filter(|_| place.town_covers).map(|town| town as &dyn Shelter);
    Covers { first: town, maps: &place.covers }
}

/// Draws the frame's streaks over the picture; returns how many were found.
pub fn streaks(task: &Task<'_>, medium: &RainMedium<'_>, memory: &mut Memory) -> Result<usize, RuntimeError> {
    if medium.medium.is_none() {
        return Ok(0);
    }
    let (shot, gain) = (shot_of(task.frame), task.frame.streaks.gain);
    let weather = &task.frame.weather;
    let covers = covers_of(task.town, &task.frame.place);
    let shelter = (!covers.is_empty()).then_some(&covers as &dyn Shelter);
    let found = task.rain.find_in(&shot, weather, &medium.field, shelter, &mut memory.rain)?.len();
    let (depth, light) = (Some(depth_of(&memory.metres, &memory.picture)?), &medium.light);
    if task.patterns.is_empty() {
        let scene = Scene { depth, kernel: &SmoothWindow, light, gain };
        memory.rain.draw(&shot, &scene, &mut memory.picture)?;
    } else {
        let scene = Scene { depth, kernel: task.patterns, light, gain };
        memory.rain.draw(&shot, &scene, &mut memory.picture)?;
    }
    Ok(found)
}

#[cfg(test)]
mod ways;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::{Sun, WorldLight};
    use glam::Vec3;

    #[test]
    fn the_lightning_bias_counts_for_flashes_and_never_for_the_sun() {
        let sun = Sun { towards: Vec3::X, irradiance: [2.0; 3], angular_radius: Sun::ANGULAR_RADIUS };
        let world = WorldLight::default().with_sun(Some(sun));
        let phase = Phase::HenyeyGreenstein(0.5);
        let ray = Ray { origin: DVec3::ZERO, direction: DVec3::Y };
        let main = |flash: f32, has_flash| {
            let beam = Beam { towards: DVec3::Z, irradiance: [flash; 3] };
            let world = &world.in_scattering(&phase).with_beam(beam);
            let light = DropLight {
                world,
                lamps: Vec::new(),
                walls: None,
                sun_shadows: None,
                around: 1.0,
                lightning_bias: 10.0,
                has_flash,
            };
            light.main_light(&ray, 1.0).unwrap()
        };
        let share = |irradiance: f64| irradiance / (irradiance + std::f64::consts::PI);
        // A flash that nothing of arrives leaves no beam.
        let dark = main(0.0, false);
        assert!(dark.towards == DVec3::X && (dark.share - share(2.0)).abs() < 1e-12, "{dark:?}");
        let lit = main(1.0, true);
        assert!(lit.towards == DVec3::Z && (lit.share - share(10.0)).abs() < 1e-12, "{lit:?}");
    }
}
