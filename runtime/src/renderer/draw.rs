//! A whole picture of a storm.
//!
//! The order is that of light's way back to the eye: what stands farthest first, each nearer thing over it.
//!
//! 1. The asset's rows become light per cell ([`super::light`]): the flashes' strokes, the sky's hemispheres, the sun.
//! 2. Sky, with the cloud marched in front of it, at every pixel and in a small map for mirrors.
//! 3. The town, lit by all of that; clear air in front of both.
//! 4. The rain's medium, in front of it street lamps and the channels of strokes in sight, each dimmed by the rain on its own way
//!    ([`super::channel`]).
//! 5. The rain's streaks ([`super::rain`]).

use super::cloud_shade::CloudShade;
use super::lit_stroke::{CLOUD_M, LitStroke, eye_height};
use super::panes::PaneLights;
use super::sun_shadows::SunShadows;
use super::times::Watch;
use super::town_rain::TownRain;
use super::world::SunSeen;
use super::{FrameReport, Memory, Scene, SceneCloud, channel, light, rain, rain_sun, town, world};
use crate::camera::{Camera, Lens, Ray};
use crate::error::RuntimeError;
use crate::frame::{Flash, Frame};
use crate::medium::Phase;
use crate::parallel::prelude::*;
use crate::picture::Picture;
use crate::rain::{DryAir, DryTiles, Rain, RainField};
use crate::shade::adaptive::{self, Spacing};
use crate::shade::cloud::{CloudPicture, CloudView};
use crate::shade::detail::Detail;
use crate::shade::environment::{Environment, EnvironmentWindow};
use crate::shade::sky::{AirBetween, Sky};
use crate::shade::town::frame::TownFrame;
use crate::shade::town::light::{Lighting, StrokeLights};
use crate::shade::town::line::Images;
use crate::stroke::Stroke;
use crate::transport::Cloud;
use crate::world::{InScattering, Sun};
use glam::{DVec3, Vec3, Vec4};
use squall_formats::units::Radians;
use std::sync::Arc;

/// Height of the middle of what stands around the eye, that clear air is looked through to, m.
pub(crate) const TOWN_M: f64 = 10.0;
/// The mirrors' map: half its width, its top, columns and rows.
pub(crate) const MIRROR_HALF_WIDTH: f64 = 1.1;
pub(crate) const MIRROR_TOP: f64 = 1.2;
pub(crate) const MIRROR_SIZE: [usize; 2] = [400, 240];
/// Beyond this distance the town's ground is as far as the air goes, m.
const FARTHEST_GROUND_M: f32 = 4e4;

/// Radiance of sky and cloud along a ray, W/(m² sr).
pub(super) type Beyond<'a> = dyn Fn(&Ray) -> [f32; 3] + Sync + 'a;
/// Mean radiance of the sun's disc over pixel (x, y), W/(m² sr).
type Disc<'a> = dyn Fn(usize, usize, &Lens<'_>) -> [f32; 3] + Sync + 'a;

impl Scene {
    /// Draws `frame`, which was checked, into `memory.picture`.
    ///
    /// Everything but the cloud's rows is drawn in coordinates from the scene's place.
    pub(super) fn draw(&self, asked: &Frame, memory: &mut Memory) -> Result<FrameReport, RuntimeError> {
        let frame = &self.place.frame(asked);
        rain::check(self.rain.as_ref(), frame, &mut memory.rain)?;
        let sky = match memory.sky.take() {
            Some((known, sky)) if known == frame.sky => sky,
            _ => Sky::new(&frame.sky)?,
        };
        let detail = match memory.detail.take() {
            Some((known, detail)) if known == frame.detail => detail,
            _ => Detail::new(&frame.detail)?,
        };
        let drawn = self.draw_under((frame, asked), (&sky, &detail), memory);
        memory.sky = Some((frame.sky.clone(), sky));
        memory.detail = Some((frame.detail, detail));
        drawn
    }

    fn draw_under(
        &self,
        (frame, asked): (&Frame, &Frame),
        (sky, detail): (&Sky, &Detail),
        memory: &mut Memory,
    ) -> Result<FrameReport, RuntimeError> {
        let mut watch = Watch::new(memory.clock);
        let camera = &frame.camera;
        let before = memory.scene_before(camera)?;
        let flashes = self.lit_strokes(frame, sky)?;
        memory.fit(camera)?;
        let mut report = FrameReport::default();
        if let Some(clouds) = &mut memory.clouds {
            let cells = (&mut memory.cells, &mut memory.flash_cells);
            report = light::light_cells(clouds, asked, (sky, self.place), &mut memory.ambient, cells)?;
        }
        watch.lap(&mut report.times.light);
        let clouds = Clouds { scene: self, frame, detail };
        let cloud = clouds.marched(&memory.cells);
        let eye = camera.position;
        let air = sky.air_between(eye_height(eye), CLOUD_M);
        let beyond = |ray: &Ray| {
            let view = cloud.as_ref().map(|cloud| cloud.march(ray));
            // Nobody sees the sky behind a cloud that lets nothing through.
            let is_open = view.is_none_or(|view| view.transmittance > 0.0);
            let mut light = if is_open { sky.radiance(ray.direction.as_vec3()) } else { [0.0; 3] };
            if let Some(view) = view {
                cover(&mut light, view, &air);
            }
            light
        };
        let closely = (eye, world::spacing_of(frame.quality.sky));
        let seen_for = (&frame.sky, &frame.detail, closely, memory.cells.as_slice());
        let look = || world::seen((sky, cloud.as_ref()), closely, &beyond);
        // Only rain and a town's mirrors ask what is all around.
        let is_wet = frame.weather.rate.0 > 0.0;
        let mut surrounding = (is_wet || self.town.is_some())
            .then(|| world::Surrounding::of(memory.surrounding.take(), seen_for, look));
        let field = self.rain_place.standing_field(frame);
        let sun_above = (is_wet && frame.medium.dims_sun()).then(|| sky.sun()).flatten();
        let flash = rain::flash_at_eye(&flashes, eye);
        let seen = surrounding.as_mut().filter(|_| is_wet).map(|seen| (seen, sun_above, flash));
        let (drops, own, undrawn) = rain_sun::shown_around_eye(frame, &field, seen);
        let dry = self.dry_air(frame, &field, memory.dry.take())?;
        let sun = surrounding.as_ref().and_then(|seen| seen.light.sun);
        let sun_shadows = SunShadows::new(self.town.as_ref(), sun);
        if let Some(sun) = sun_above {
            memory.cloud_shade = CloudShade::of(memory.cloud_shade.take(), self.cloud_grid(), sun.towards);
        }
        let wet = TownRain::new(undrawn, field, own.as_ref().unwrap_or(&drops));
        let wet = wet.under(dry.as_ref()).shaded_by(sun_shadows);
        let wet = self.tabulated(wet, frame, &flashes);
        watch.lap(&mut report.times.surroundings);
        if let Some(surrounding) = &surrounding {
            self.render_town(
                (frame, sky),
                &flashes,
                (&beyond, &surrounding.around, clouds.marched(&memory.flash_cells)),
                (surrounding.light.sun, &wet),
                &mut memory.town,
            );
        }
        watch.lap(&mut report.times.town);
        let disc_reach = sky.disc_reach(&Lens::new(camera));
        let disc = |x: usize, y: usize, lens: &Lens<'_>| {
            let Some(reach) = disc_reach else { return [0.0; 3] };
            let ray = lens.ray(x as f64 + 0.5, y as f64 + 0.5);
            let is_near = ray.direction.distance_squared(sky.sun_way()) <= reach;
            if is_near { disc_behind((sky, cloud.as_ref()), camera, [x, y], &ray) } else { [0.0; 3] }
        };
        self.compose(
            (camera, frame.quality.sky),
            sky,
            (&beyond, &disc),
            memory.town.frame(),
            &mut memory.picture,
        );
        if let Some(before) = &before {
            self.stand_before(before, (camera, sky), memory.town.frame(), &mut memory.picture);
        }
        watch.lap(&mut report.times.sky);
        let around = surrounding.as_ref().map_or([0.0; 3], |seen| seen.light.mean_radiance());
        // Where it is dimmed, the medium has the sun along each ray.
        let seen = if sun_above.is_some() { SunSeen::Apart } else { SunSeen::Behind(0.0) };
        let in_rain = |phase: &Phase| match &mut surrounding {
            Some(surrounding) => surrounding.in_scattering(phase, seen),
            None => InScattering::dark(phase),
        };
        let mirrored = (sun, sun_above, &wet);
        self.draw_rain(frame, (sky, around, in_rain, &drops), mirrored, &flashes, (memory, &mut report))?;
        memory.surrounding = surrounding;
        memory.dry = dry.map(DryAir::into_tiles);
        Ok(report)
    }

    /// What of the air the frame's rain doesn't reach, for rays of mirrors; none where it doesn't rain or nothing keeps it off.
    fn dry_air<'a>(
        &'a self,
        frame: &'a Frame,
        field: &RainField<'_>,
        kept: Option<DryTiles>,
    ) -> Result<Option<DryAir<'a>>, RuntimeError> {
        let covers = rain::covers_of(self.town.as_ref(), &frame.place);
        let (Some(section), false) = (&self.rain, frame.weather.rate.0 == 0.0 || covers.is_empty()) else {
            return Ok(None);
        };
        let fall = rain::fall_of(section, (frame, field))?;
        Ok(Some(DryAir::new(covers, fall, frame.camera.position, kept)))
    }

    /// The town's rain, its depths from tables where it has a map.
    fn tabulated<'a>(&self, wet: TownRain<'a>, frame: &Frame, flashes: &[LitStroke]) -> TownRain<'a> {
        if self.town.is_none() || self.rain_place.map_of(frame).is_none() {
            return wet;
        }
        let pieces = |flash: &LitStroke| {
            let points = flash.lights.points.iter().map(|point| point.position);
            points.chain(flash.lights.images.centres()).collect::<Vec<_>>()
        };
        wet.tabulated(frame.camera.position, flashes.iter().flat_map(pieces))
    }

    /// The town, lit by sky, cloud and channels.
    fn render_town(
        &self,
        (frame, sky): (&Frame, &Sky),
        flashes: &[LitStroke],
        (beyond, around, lit): (&Beyond<'_>, &Environment, Option<CloudPicture<'_>>),
        (sun, wet): (Option<Sun>, &TownRain<'_>),
        out: &mut town::Kept,
    ) {
        let Some(town) = &self.town else { return };
        let camera = &frame.camera;
        let eye = camera.position;
        let window = EnvironmentWindow {
            heading: heading_of(camera),
            half_width: Radians(MIRROR_HALF_WIDTH),
            bottom: Radians(0.0),
            top: Radians(MIRROR_TOP),
            // Half as fine for nodes that stand twice as far apart and more.
            size: MIRROR_SIZE.map(|count| count * 2 / (frame.quality.town.spacing as usize).clamp(2, 4)),
        };
        let from_eye = |direction: Vec3| Ray { origin: eye, direction: direction.as_dvec3() };
        let mirror =
            Environment::looked_at(window, frame.quality.sky, &|direction| beyond(&from_eye(direction)));
        // A cloud that no stroke lights sheds nothing: its rays are not followed.
        let lit = lit.filter(|_| !flashes.is_empty());
        let glows = lit.as_ref().map(|cloud| light::glow_of(cloud, eye)).unwrap_or_default();
        let ambient = |normal: Vec3| sky.ambient_irradiance(normal);
        let leaves = |_: Vec3, direction: Vec3| {
            // Finely where the picture's own puddles look, coarsely all around.
            if mirror.holds(direction) { mirror.lookup(direction) } else { around.lookup(direction) }
        };
        let lighting = Lighting {
            ambient: &ambient,
            points: &[],
            images: Images::NONE,
            strokes: &[],
            glows: &glows,
            leaves: &leaves,
            sun,
            rain: wet,
        };
        out.render(town, (frame, self.rain_place.standing_drift(frame)), flashes, lighting);
    }

    /// The rain's medium over the picture, channels in front of it, streaks in front of those.
    fn draw_rain(
        &self,
        frame: &Frame,
        (sky, around, in_rain, drops): (&Sky, [f32; 3], impl FnMut(&Phase) -> InScattering, &InScattering),
        (sun, sun_above, wet): (Option<Sun>, Option<Sun>, &TownRain<'_>),
        flashes: &[LitStroke],
        (memory, report): (&mut Memory, &mut FrameReport),
    ) -> Result<(), RuntimeError> {
        let mut watch = Watch::new(memory.clock);
        let (camera, cloud, town) = (&frame.camera, self.cloud_grid(), self.town.as_ref());
        let before = memory.scene_before(camera)?;
        let before = before.as_deref();
        let channels = channel::Channels { flashes, camera, sky, cloud, town, before };
        // A lamp is looked at through the air and the rain before it, whatever stands or doesn't stand behind it.
        let lamps = |left: &dyn Fn(DVec3) -> f32, picture: &mut Picture| {
            let Some(town) = town else { return };
            let through = |point: DVec3| {
                if before.is_some_and(|before| before.hides(camera, point)) {
                    return [0.0; 3];
                }
                let distance = camera.position.distance(point);
                let air = sky.air_view(eye_height(camera.position), TOWN_M, distance).transmittance;
                air.map(|share| share * left(point))
            };
            town.draw_lamps(camera, &through, picture);
            let panes = PaneLights { town, camera, sky, cloud, flashes, sun, wet, before };
            panes.draw(left, picture);
        };
        let Some(section) = &self.rain else {
            lamps(&|_| 1.0, &mut memory.picture);
            channels.draw(&|_| 1.0, &mut memory.picture);
            watch.lap(&mut report.times.lights_in_view);
            return Ok(());
        };
        let rain = Rain::new(section, frame.streaks.seed);
        let shade = memory.cloud_shade.take();
        let task = rain::Task {
            section,
            rain: &rain,
            patterns: &self.patterns,
            frame,
            flashes,
            lamps: town.map_or(&[], |town| town.lamps()),
            town,
            place: &self.rain_place,
            has_depth: town.is_some(),
            before,
            around,
            sky: sky.mean_radiance(),
            drops,
            sun_shadows: SunShadows::new(town, sun),
            sun: sun_above.and_then(|above| match (&shade, cloud) {
                // A cloud without an end shades all rain as it shades the eye.
                (None, Some(_)) => sun.map(|sun| (sun, None)),
                (shade, _) => Some((above, shade.as_ref())),
            }),
        };
        let medium = rain::medium(&task, in_rain, memory)?;
        watch.lap(&mut report.times.medium);
        lamps(&|point| medium.left(camera, point), &mut memory.picture);
        channels.draw(&|point| medium.left(camera, point), &mut memory.picture);
        watch.lap(&mut report.times.lights_in_view);
        report.streaks = rain::streaks(&task, &medium, memory)?;
        memory.cloud_shade = shade;
        watch.lap(&mut report.times.streaks);
        Ok(())
    }

    /// A scene of the caller's, before sky, cloud and what of the town is farther.
    fn stand_before(
        &self,
        before: &super::foreground::Pixels,
        (camera, sky): (&Camera, &Sky),
        town: &TownFrame,
        picture: &mut Picture,
    ) {
        let (width, has_town) = (picture.width, self.town.is_some());
        let metres =
            |x: usize, y: usize| if has_town { town.pixels[y * width + x].distance } else { f32::INFINITY };
        let through = |metres: f32| {
            let distance = f64::from(metres.min(FARTHEST_GROUND_M));
            let air = sky.air_view(eye_height(camera.position), TOWN_M, distance);
            (air.transmittance, air.added)
        };
        before.compose(camera, &metres, &through, picture);
    }

    pub(super) fn cloud_grid(&self) -> Option<&Cloud> {
        self.cloud.as_ref().map(SceneCloud::grid)
    }

    /// The strokes that the frame lets flash, each with its factor.
    pub(super) fn lit_strokes(&self, frame: &Frame, sky: &Sky) -> Result<Vec<LitStroke>, RuntimeError> {
        let eye = frame.camera.position;
        let lit = frame.flashes.iter().filter(|flash| flash.brightness > 0.0);
        let strokes = self.strokes.find(lit.clone())?;
        let lit_by = |(flash, stroke): (&Flash, Arc<Stroke>)| {
            let stroke = self.place.stroke(stroke);
            let lights = self.town_lights(&stroke, eye, sky);
            LitStroke { scale: flash.scale_of(&stroke), stroke, lights }
        };
        Ok(lit.zip(strokes).map(lit_by).collect())
    }

    /// A stroke's light as an eye sees it, [`channel::town_lights`].
    pub(super) fn town_lights(&self, stroke: &Stroke, eye: DVec3, sky: &Sky) -> StrokeLights {
        let air = |distance: f64| sky.air_view(eye_height(eye), CLOUD_M, distance).transmittance;
        channel::town_lights(stroke, self.cloud_grid(), eye, &air)
    }

    /// Sky and cloud behind the town, clear air in front.
    fn compose(
        &self,
        (camera, spacing): (&Camera, Spacing),
        sky: &Sky,
        (beyond, disc): (&Beyond<'_>, &Disc<'_>),
        town: &TownFrame,
        picture: &mut Picture,
    ) {
        let (width, has_town) = (picture.width, self.town.is_some());
        let cover = |x: usize, y: usize| if has_town { town.pixels[y * width + x].cover } else { 0.0 };
        let size = [picture.width, picture.height];
        let (lens, air) = (Lens::new(camera), sky.air_between(eye_height(camera.position), TOWN_M));
        let behind = |x: usize, y: usize| beyond(&lens.ray(x as f64 + 0.5, y as f64 + 0.5));
        adaptive::fill(size, spacing, (&behind, &|x, y| cover(x, y) < 1.0), &mut picture.pixels);
        let row = |(y, row): (usize, &mut [[f32; 3]])| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let cover = cover(x, y);
                if cover < 1.0 {
                    let disc = disc(x, y, &lens);
                    (0..3).for_each(|band| pixel[band] = (pixel[band] + disc[band]) * (1.0 - cover));
                } else {
                    *pixel = [0.0; 3];
                }
                if !has_town {
                    continue;
                }
                let seen = &town.pixels[y * width + x];
                if seen.cover == 0.0 {
                    continue;
                }
                let distance = f64::from(seen.distance.min(FARTHEST_GROUND_M));
                let air = air.view(distance);
                for band in 0..3 {
                    pixel[band] += seen.radiance[band] * air.transmittance[band] + air.added[band] * cover;
                }
            }
        };
        picture.pixels.par_chunks_mut(width).enumerate().for_each(row);
    }
}

/// The sun's disc in a pixel, behind the cloud. It is no part of the sky's radiance: mirrors and drops have it as a light of its own.
fn disc_behind(
    (sky, cloud): (&Sky, Option<&CloudPicture<'_>>),
    camera: &Camera,
    [x, y]: [usize; 2],
    ray: &Ray,
) -> [f32; 3] {
    let disc = sky.disc_in_pixel(camera, x, y);
    let cloud = cloud.filter(|_| disc != [0.0; 3]);
    let open = cloud.map_or(1.0, |cloud| cloud.march(ray).transmittance);
    disc.map(|value| value * open)
}

/// The cloud as one frame marches it.
pub(super) struct Clouds<'a> {
    pub scene: &'a Scene,
    pub frame: &'a Frame,
    pub detail: &'a Detail,
}

impl<'a> Clouds<'a> {
    pub fn marched(&self, cells: &'a [Vec4]) -> Option<CloudPicture<'a>> {
        let cloud = self.scene.cloud.as_ref()?;
        let billow = self.frame.detail;
        let billow = (billow.amplitude > 0.0).then_some(billow.size);
        Some(CloudPicture::new(cloud.grid(), &cloud.shape, cells, self.detail, billow))
    }
}

/// Share of a cloud's light that comes through the clear air between it and the eye.
pub(super) fn cloud_air(sky: &Sky, eye: DVec3, distance: f64) -> [f32; 3] {
    sky.air_view(eye_height(eye), CLOUD_M, distance).transmittance
}

/// Composites a cloud over the sky behind it, through the clear air in front of it.
pub(super) fn cover(light: &mut [f32; 3], cloud: CloudView, air: &AirBetween) {
    if cloud.transmittance == 1.0 {
        return;
    }
    let air = air.view(f64::from(cloud.distance));
    for band in 0..3 {
        light[band] = light[band] * cloud.transmittance
            + cloud.radiance[band] * air.transmittance[band]
            + air.added[band] * (1.0 - cloud.transmittance);
    }
}

/// The direction that a camera looks in over the ground, from +x towards +y; of one that looks straight up or down, where its
/// picture's top or bottom points.
pub(crate) fn heading_of(camera: &Camera) -> Radians {
    let level = |v: DVec3| DVec3::new(v.x, v.y, 0.0);
    let way = level(camera.forward);
    let way = if way.length_squared() > 1e-12 { way } else { level(camera.up) * -camera.forward.z.signum() };
    Radians(libm::atan2(way.y, way.x))
}
