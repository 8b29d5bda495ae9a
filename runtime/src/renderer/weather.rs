//! Everything of a picture that lies before sky, cloud and town, on a graphics card: the rain's medium with its halos, lamps and
//! channels, streaks over those. The order is that of [`super::draw`]; what is asked of the card comes from the frame alone, and from
//! what the card itself found around the eye.

use super::Scene;
use super::channel;
use super::cloud_shade::CloudShade;
use super::draw::TOWN_M;
use super::halos::{Halos, Spreading, stands_within};
use super::lit_stroke::{LitStroke, eye_height};
use super::rain::{self, shot_of};
use super::rain_sun::{RainSun, SunTable, around_eye, depth_to_sun};
use crate::camera::Projection;
use crate::error::RuntimeError;
use crate::frame::{Flash, Frame};
use crate::gpu::Gpu;
use crate::gpu::clock::Recorder;
use crate::gpu::medium::MediumPass;
use crate::gpu::memory::Image;
use crate::gpu::rain::{LAYER, NEAR_LAMPS, NearLamp, RainFrame, RainGroup, RainLight, RainPasses};
use crate::gpu::relief::ReliefPass;
use crate::gpu::shown::ShownPass;
use crate::gpu::spots::{NO_STROKE, SpotPasses, SpotSource};
use crate::gpu::targets::Targets;
use crate::gpu::town::TownGroup;
use crate::medium::{Medium, Phase};
use crate::rain::{Rain, RainField, RainPath, Workspace};
use crate::shade::sky::{Sky, SkyParameters};
use crate::shade::town::light::StrokeLights;
use crate::stroke::Stroke;
use crate::world::Beam;
use glam::{DVec3, Vec3};
use squall_formats::section::town::StreetLamp;
use std::sync::Arc;

/// The passes of one asset's weather.
pub struct Weather {
    pub town: TownGroup,
    pub group: RainGroup,
    rain: RainPasses,
    shown: ShownPass,
    relief: ReliefPass,
    medium: MediumPass,
    spots: SpotPasses,
    frame: Box<RainFrame>,
    spreading: Option<Spreading>,
    cloud_shade: Option<CloudShade>,
    sized: Option<Sized>,
    placed_for: Option<PlacedFor>,
    strokes: Vec<KeptStroke>,
    rains: bool,
}

/// A stroke as it was seen from an eye under a sky: growing it and looking for it through the cloud takes milliseconds.
struct KeptStroke {
    /// As the asset or the caller has it, and measured from the scene's place.
    own: Arc<Stroke>,
    moved: Arc<Stroke>,
    eye: DVec3,
    sky: SkyParameters,
    lights: StrokeLights,
}

/// Most strokes that flash together, and most of those that went out and are kept: they may come back.
const STROKES: usize = 64;

/// Pictures of one size.
struct Sized {
    size: [u32; 2],
    of: wgpu::TextureView,
    /// Metres to what is seen.
    metres: wgpu::TextureView,
    layer: Image,
    /// What the medium makes of the picture.
    picture: Image,
}

/// What lights in view were placed for.
#[derive(PartialEq)]
struct PlacedFor {
    eye: DVec3,
    rows: f64,
    sky: SkyParameters,
    strokes: Vec<usize>,
}

/// Groups of passes that come from others: the frame's, and what the card finds around the eye.
#[derive(Clone, Copy)]
pub struct Found<'a> {
    /// The frame's layout.
    pub frame: &'a wgpu::BindGroupLayout,
    /// The world's harmonics.
    pub harmonics: &'a wgpu::Buffer,
    /// An [`crate::gpu::around::Around`].
    pub told: &'a wgpu::Buffer,
}

impl Weather {
    /// Compiles the passes and brings the asset's patterns and town to the card.
    pub fn new(gpu: &Gpu, scene: &Scene, found: Found<'_>) -> Self {
        let tables = scene.patterns.tables();
        let town = TownGroup::new(gpu, scene.town.as_ref());
        let group = RainGroup::new(gpu, &tables, found.told);
        let rain = RainPasses::new(gpu, found.frame, &town.layout, &group, &tables);
        let shown = ShownPass::new(gpu, found.frame, &group, found.harmonics);
        let layouts = [found.frame, &town.layout];
        let relief = ReliefPass::new(gpu, layouts, &group);
        let others = [&relief.heights.view, &town.reach.view];
        let medium = MediumPass::new(gpu, found.frame, &group, others);
        let spots = SpotPasses::new(gpu, layouts, &group, (&medium.uniform, &relief.heights.view));
        Self {
            town,
            group,
            rain,
            shown,
            relief,
            medium,
            spots,
            frame: Box::default(),
            spreading: None,
            cloud_shade: None,
            sized: None,
            placed_for: None,
            strokes: Vec::new(),
            rains: false,
        }
    }

    /// Tells the next submission what weather the frame has, which is in the scene's coordinates.
    ///
    /// Errors: rain that is refused ([`Rain::find`]); what only the processor can draw, by name.
    pub fn set(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        (frame, sky): (&Frame, &Sky),
        flashes: &[LitStroke],
        (workspace, targets): (&mut Workspace, &Targets),
    ) -> Result<(), RuntimeError> {
        self.rains = frame.weather.rate.0 > 0.0;
        if flashes.len() > STROKES {
            let wanted = format!("at most {STROKES} strokes that flash together on a graphics card");
            return Err(RuntimeError::argument("flashes", wanted, flashes.len()));
        }
        self.resize(gpu, targets);
        self.set_spots(gpu, scene, (frame, sky), flashes, targets.scene.is_some());
        let section = scene.rain.as_ref().filter(|_| self.rains);
        let Some(section) = section else { return self.medium.set(gpu, None, (&[], None), [0.0; 4]) };
        let field = scene.rain_place.field(frame);
        let mut uniform = field.uniform();
        self.group.set_covers(gpu, &frame.place.covers, &mut uniform)?;
        gpu.write(&self.group.field, &[uniform]);
        self.group.set_map(gpu, field.map());
        let (shot, eye) = (shot_of(frame), frame.camera.position);
        let medium = frame.medium.medium(section, &shot, field.rate(frame.weather.rate))?;
        let undrawn = frame.medium.undrawn(field.rate(frame.weather.rate));
        let drops = frame.medium.drop_phase();
        self.shown.set_phases(gpu, &self.group, [&drops, medium.phase(), undrawn.phase()]);
        // As [`super::rain::medium`] has it: within the same rain as the eye a light has its halo, from beyond it is a beam.
        let full = field.filled_radius(eye).min(field.farthest());
        let near = |flash: &LitStroke| stands_within(flash, eye, full);
        let all = rain::flash_at(flashes, eye, |_| false);
        let far = rain::flash_at(flashes, eye, near);
        let lost = self.set_sun(gpu, scene, (frame, sky), (&medium, &field));
        self.set_light(gpu, sky, ([&drops, medium.phase(), undrawn.phase()], lost), [all, far]);
        let rate = field.rate(frame.weather.rate);
        let fall = frame.weather.wind - DVec3::Z * Medium::fall_speed(section, rate)?;
        let relief =
            self.relief.set(gpu, rain::covers_of(scene.town.as_ref(), &frame.place), fall, &frame.camera);
        self.set_medium(gpu, scene, (&medium, &field, eye), flashes, (relief, near))?;
        self.set_drops(gpu, scene, (section, frame), workspace)
    }

    /// [`Scene::lit_strokes`], of which what stays is kept.
    ///
    /// Errors: as there.
    pub fn lit_strokes(
        &mut self,
        scene: &Scene,
        frame: &Frame,
        sky: &Sky,
    ) -> Result<Vec<LitStroke>, RuntimeError> {
        let eye = frame.camera.position;
        let lit: Vec<&Flash> = frame.flashes.iter().filter(|flash| flash.brightness > 0.0).collect();
        let strokes = scene.strokes.find(lit.iter().copied())?;
        let mut kept = std::mem::take(&mut self.strokes);
        let mut all = Vec::with_capacity(lit.len());
        for (flash, own) in lit.into_iter().zip(strokes) {
            let same =
                |known: &KeptStroke| Arc::ptr_eq(&known.own, &own) || known.own.segments == own.segments;
            let known = kept.iter().position(same).map(|at| kept.swap_remove(at));
            let still = known.filter(|known| known.eye == eye && known.sky == frame.sky);
            let now = still.unwrap_or_else(|| {
                let moved = scene.place.stroke(own.clone());
                let lights = scene.town_lights(&moved, eye, sky);
                KeptStroke { own, moved, eye, sky: frame.sky.clone(), lights }
            });
            let (stroke, lights) = (now.moved.clone(), now.lights.clone());
            all.push(LitStroke { scale: flash.scale_of(&now.own), stroke, lights });
            self.strokes.push(now);
        }
        // A flash that goes out may come back: a few that are dark now stay.
        kept.truncate(STROKES);
        self.strokes.append(&mut kept);
        self.strokes.truncate(2 * STROKES);
        Ok(all)
    }

    fn resize(&mut self, gpu: &Gpu, targets: &Targets) {
        let size = targets.size;
        let [metres, own_metres] = targets.metres();
        // Pictures of the same size may be others: their views are kept, and compared.
        let same =
            |sized: &Sized| sized.size == size && sized.of == targets.picture.view && sized.metres == *metres;
        if !self.sized.as_ref().is_some_and(same) {
            let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
            let kind = (wgpu::TextureDimension::D2, LAYER);
            let layer = gpu.texture("streaks", [size[0], size[1], 1], kind, usage);
            let picture = gpu.picture_target("picture in rain", size);
            self.medium.set_targets(gpu, [&targets.picture.view, metres, &picture.view], size);
            self.spots.set_layer(gpu, &layer.view, own_metres);
            self.rain.set_scene(gpu, metres);
            let of = targets.picture.view.clone();
            self.sized = Some(Sized { size, of, metres: metres.clone(), layer, picture });
        }
    }

    /// The sun as the rain dims it: tables for rays of the eye, and for drops and mirrors what of it comes to the eye. Answers what the rain takes
    /// of its straight beam ([`RainLight`]).
    fn set_sun(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        (frame, sky): (&Frame, &Sky),
        (medium, field): (&Medium, &RainField<'_>),
    ) -> [f32; 4] {
        let Some(sun) = sky.sun().filter(|_| frame.medium.dims_sun()) else {
            self.medium.set_sun(gpu, None);
            self.shown.set_sun(gpu, Vec3::Z, [0.0; 3]);
            return [0.0; 4];
        };
        let cloud = scene.cloud_grid();
        self.cloud_shade = CloudShade::of(self.cloud_shade.take(), cloud, sun.towards);
        let (extinction, shade) = (medium.extinction().0, self.cloud_shade.as_ref());
        let in_rain = RainSun { field: *field, extinction, phase: medium.phase(), sun, shade };
        self.medium.set_sun(gpu, Some(&SunTable::new(&in_rain, &frame.camera)));
        let standing = scene.rain_place.standing_field(frame);
        let depth =
            |medium: &Medium| depth_to_sun(&standing, medium.extinction().0, (frame.camera.position, sun));
        let [drops, undrawn] = around_eye(frame, &standing).map(|medium| depth(&medium));
        self.shown.set_sun(gpu, sun.towards, [drops, 0.0, undrawn]);
        let lost = |depth: f64| -libm::expm1(-depth) as f32;
        // A cloud without an end shades all rain as it shades the eye.
        let as_the_eye = cloud.is_some() && self.cloud_shade.is_none();
        [lost(drops), 1.0, lost(undrawn), if as_the_eye { 1.0 } else { 0.0 }]
    }

    fn set_light(
        &self,
        gpu: &Gpu,
        sky: &Sky,
        (phases, sun_lost): ([&Phase; 3], [f32; 4]),
        [all, far]: [Beam; 2],
    ) {
        let mut light = RainLight { phases: phases.map(Phase::numbers), sun_lost, ..RainLight::default() };
        let four = |[x, y, z]: [f32; 3]| [x, y, z, 0.0];
        if let Some(sun) = sky.sun() {
            (light.sun_towards, light.sun) = (four(sun.towards.to_array()), four(sun.irradiance));
        }
        let beam = |beam: Beam| (four(beam.towards.as_vec3().to_array()), four(beam.irradiance));
        (light.flash_towards, light.flash) = beam(all);
        (light.medium_flash_towards, light.medium_flash) = beam(far);
        gpu.write(&self.group.light, &[light]);
    }

    fn set_medium(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        (medium, field, eye): (&Medium, &dyn RainPath, DVec3),
        flashes: &[LitStroke],
        (relief, near): ([f32; 4], impl Fn(&LitStroke) -> bool),
    ) -> Result<(), RuntimeError> {
        let lamps = scene.town.as_ref().map_or(&[][..], |town| town.lamps());
        if lamps.is_empty() && !flashes.iter().any(&near) {
            return self.medium.set(gpu, Some(medium), (&[], None), relief);
        }
        let spreading = Spreading::of(self.spreading.take(), medium.phase());
        let mut halos = Halos::new(&spreading, medium, field).with_walls(scene.town.as_ref());
        halos.add_lamps(lamps, eye);
        flashes.iter().filter(|flash| near(flash)).for_each(|flash| halos.add_stroke(flash, eye));
        let set = self.medium.set(gpu, Some(medium), (&halos.list(), Some(&spreading)), relief);
        self.spreading = Some(spreading);
        set
    }

    fn set_drops(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        (section, frame): (&squall_formats::section::density::DensitySection, &Frame),
        workspace: &mut Workspace,
    ) -> Result<(), RuntimeError> {
        let (shot, field) = (shot_of(frame), scene.rain_place.field(frame));
        let own = &mut *self.frame;
        let brightness: f64 = frame.flashes.iter().map(|flash| flash.brightness).sum();
        own.still_way[3] = frame.streaks.gain as f32;
        own.wind[3] = (1.0 + frame.streaks.lightning_bias * brightness) as f32;
        let rain = Rain::new(section, frame.streaks.seed);
        rain.uniform(&shot, &frame.weather, &field, workspace, own)?;
        self.rain.reserve(gpu, rain.most_found(&shot, workspace)?);
        own.counts[1] = self.rain.capacity;
        own.counts[2] = self.rain.patterns_count;
        own.lengths[2] = self.rain.shortest_aspect;
        own.flags[2] = u32::from(scene.town.is_some() && frame.place.town_covers);
        own.flags[3] = u32::from(self.rain.has_choice);
        // Of more lamps than there is room for, the nearest light the drops.
        let lamps = scene.town.as_ref().map_or(&[][..], |town| town.lamps());
        let away = |place: [f32; 3]| DVec3::from_array(place.map(f64::from)).distance(frame.camera.position);
        let lamps = lamps.iter().enumerate().map(|lamp| (away(lamp.1.position), lamp));
        let mut near: Vec<(f64, (usize, &StreetLamp))> =
            lamps.filter(|(distance, _)| *distance < rain::LAMP_REACH_M).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(NEAR_LAMPS);
        own.counts[3] = near.len() as u32;
        let four = |[x, y, z]: [f32; 3]| [x, y, z, 0.0];
        for (slot, (_, (number, lamp))) in own.near_lamps.iter_mut().zip(near) {
            let [x, y, z] = lamp.position;
            *slot = NearLamp { position: [x, y, z, number as f32], intensity: four(lamp.intensity) };
        }
        gpu.write(&self.group.frame, &[*own]);
        Ok(())
    }

    /// Lamps and channels in view: placed anew where eye, sky or strokes are others, else only as bright as they are now.
    fn set_spots(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        (frame, sky): (&Frame, &Sky),
        flashes: &[LitStroke],
        has_scene: bool,
    ) {
        let camera = &frame.camera;
        let scales: Vec<[f32; 3]> = flashes.iter().map(|flash| flash.scale).collect();
        let key = PlacedFor {
            eye: camera.position,
            rows: camera.pixels_per_metre() * camera.pixel_aspect,
            sky: frame.sky.clone(),
            strokes: flashes
                .iter()
                .map(|flash| Arc::as_ptr(&flash.stroke).cast::<Stroke>() as usize)
                .collect(),
        };
        if self.placed_for.as_ref() != Some(&key) {
            let mut sources = lamp_spots(scene, (frame, sky));
            for (number, flash) in flashes.iter().enumerate() {
                let spots = channel::spots((flash, number as u32), (camera, sky), scene.cloud_grid());
                sources.extend(spots);
            }
            self.spots.set_sources(gpu, &sources);
            self.placed_for = Some(key);
        }
        self.spots.set_frame(gpu, &scales, [self.rains, scene.town.is_some(), has_scene]);
    }

    /// Puts on record what rain shows of the world: the town's mirrors look through rain.
    pub fn record_shown(&self, recorder: &mut Recorder<'_>, frame: &wgpu::BindGroup) {
        if self.rains {
            self.shown.record(recorder, frame);
        }
    }

    /// Puts the weather on record, over `targets.picture`; after [`Weather::record_shown`].
    pub fn record(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        targets: &Targets,
    ) {
        if self.rain.wants_scene() {
            self.rain.set_scene(gpu, targets.metres()[0]);
        }
        let Some(sized) = &self.sized else { return };
        let (town, rain) = (&self.town.group, &self.group.group);
        if self.rains {
            self.rain.find(gpu, recorder, [frame, town, rain], self.frame.flags[0]);
            self.rain.draw(recorder, [frame, rain], &sized.layer.view);
            self.relief.record(recorder, [frame, town, rain]);
            self.medium.record(recorder, [frame, rain]);
        }
        self.spots.place(recorder, [frame, town, rain]);
        let picture = if self.rains { &sized.picture } else { &targets.picture };
        self.spots.draw(recorder, [frame, rain], &picture.view, self.rains);
    }

    /// The whole picture, after [`Weather::record`].
    pub fn picture<'a>(&'a self, targets: &'a Targets) -> &'a Image {
        match &self.sized {
            Some(sized) if self.rains => &sized.picture,
            _ => &targets.picture,
        }
    }

    /// How the draw of streaks was told: how many were found, for whoever reads it back.
    pub fn drops(&self) -> &wgpu::Buffer {
        &self.rain.arguments
    }

    /// Streaks that there is room for.
    pub fn room(&self) -> u32 {
        self.rain.capacity
    }
}

/// Lamps in view, as `Town::draw_lamps` draws them.
fn lamp_spots(scene: &Scene, (frame, sky): (&Frame, &Sky)) -> Vec<SpotSource> {
    /// Radius of a lamp's glass, m, and the least standard deviation of its spot, px.
    const LAMP_RADIUS: f32 = 0.15;
    const LEAST_PX: f32 = 0.6;
    let camera = &frame.camera;
    let lamps = scene.town.as_ref().map_or(&[][..], |town| town.lamps());
    let spot = |lamp: &squall_formats::section::town::StreetLamp| {
        let position = DVec3::from_array(lamp.position.map(f64::from));
        let through = camera.position.distance(position);
        let air = sky.air_view(eye_height(camera.position), TOWN_M, through).transmittance;
        let per_metre = match camera.projection {
            Projection::Perspective { .. } => camera.pixels_per_metre() / through.max(1e-3),
            Projection::Orthographic { .. } => camera.pixels_per_metre(),
        } as f32;
        let sigma = (LAMP_RADIUS * per_metre).max(LEAST_PX);
        let aspect = camera.pixel_aspect as f32;
        let scale = aspect * per_metre * per_metre / (std::f32::consts::TAU * sigma * sigma);
        let light = std::array::from_fn(|band| lamp.intensity[band] * air[band] * scale);
        SpotSource { position: lamp.position, stroke: NO_STROKE, light, sigma }
    };
    lamps.iter().map(spot).collect()
}

#[cfg(test)]
pub(super) mod tests;
