use super::light::{TownLights, TownSource, TownView};
use super::passes::{TownPasses, TownTargets};
use super::surface::{MAPS_ACROSS, TownGround, TownPart, TownWall, check};
use super::*;
use crate::assert_layout;
use crate::camera::Camera;
use crate::gpu::around::Around;
use crate::gpu::clock::Clock;
use crate::gpu::frame::{FrameGroup, FrameUniform};
use crate::gpu::half::value_of;
use crate::gpu::memory::Image;
use crate::gpu::rain::{RainGroup, RainLight};
use crate::gpu::readback::Readback;
use crate::gpu::shader::{TOWN_NODES, TOWN_REST};
use crate::gpu::shown::ShownPass;
use crate::gpu::targets::{LIGHT, METRES};
use crate::gpu::test_gpu;
use crate::load::Asset;
use crate::medium::{Medium, Phase};
use crate::rain::{Ceiling, RainField, RainMap, RainVolume};
use crate::renderer::town_rain::TownRain;
use crate::shade::environment::{Environment, EnvironmentWindow};
use crate::shade::sky::harmonics::{Harmonics, irradiance_from, project};
use crate::shade::streak::StreakSet;
use crate::shade::town::frame::{Quality, TownFrame};
use crate::shade::town::light::{GlowLight, Lighting, SceneLight};
use crate::shade::town::line::{Images, LineLight};
use crate::world::{InScattering, Sun, WorldLight};
use glam::{DVec2, DVec3, Vec3};
use squall_formats::section::streak::StreakSection;
use squall_formats::section::town::{StreetLamp, TownSection};
use squall_formats::units::{Degrees, Metres, MillimetresPerHour, Radians};

const SIZE: [u32; 2] = [160, 90];

#[test]
fn structs_lie_as_the_shaders_have_them() {
    assert_layout!(
        TOWN_REST,
        TownView { counts, lines, steps, measures, ambient, sun_towards, sun, mirror, around }
    );
    assert_layout!(TOWN_NODES, TownSource { start, share, end, pad, intensity, pad1 });
    assert_layout!(TOWN_NODES, TownWall { albedo, glass, radiance, seed, pitch, lit, pad, counts });
    assert_layout!(TOWN_NODES, TownPart { a, b, c });
    assert_layout!(
        TOWN_NODES,
        TownGround { albedo, wetness, shores, puddle_size, ripple, seed, roads, lamps }
    );
}

/// The town of a golden asset, with more lamps along its road and the wet lawn that its house stands on.
fn section() -> TownSection {
    let asset = Asset::open(concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall")).unwrap();
    let mut section: TownSection = asset.section(TownSection::TAG, "town", TownSection::read).unwrap();
    for i in 0..12u8 {
        let place = [f32::from(i % 2) * 14.0 - 4.0, f32::from(i) * 22.0 - 20.0, 8.0];
        section.lamps.push(StreetLamp { position: place, intensity: [20.0, 14.0, 6.0] });
    }
    section
}

/// What lights a picture, and what falls on the ways.
struct Case {
    name: &'static str,
    sky: f32,
    sun: Option<Sun>,
    points: Vec<SceneLight>,
    images: Images,
    glow: Option<GlowLight>,
    rate: f64,
    volume: RainVolume,
    map: Option<RainMap>,
}

impl Case {
    fn dusk(name: &'static str) -> Self {
        Self {
            name,
            sky: 0.2,
            sun: None,
            points: Vec::new(),
            images: Images::from(Vec::new()),
            glow: None,
            rate: 0.0,
            volume: RainVolume::default(),
            map: None,
        }
    }

    fn flash(name: &'static str) -> Self {
        let place = |i: f32| Vec3::new(220.0 + 30.0 * libm::sinf(i * 1.7), 700.0 + 3.0 * i, 800.0 - 40.0 * i);
        let line = |i: u8| LineLight {
            from: place(f32::from(i)),
            to: place(f32::from(i) + 1.0),
            intensity: [9e4, 1e5, 1.2e5],
            visibility: 0.9,
        };
        let lines: Vec<LineLight> = (0..20).map(line).collect();
        let point = |i: f32| SceneLight { position: place(i), intensity: [6e5, 7e5, 8e5], visibility: 0.9 };
        Self {
            points: vec![point(3.0), point(10.0), point(17.0)],
            images: Images::from(lines),
            glow: Some(GlowLight {
                centre: Vec3::new(500.0, 3e3, 2e3),
                radius: 900.0,
                radiance: [0.4, 0.45, 0.5],
            }),
            ..Self::dusk(name)
        }
    }

    fn sky_light(&self, d: Vec3) -> [f32; 3] {
        let up = d.z.max(0.0);
        [0.5 + 0.5 * d.x, 0.6 + 0.3 * up, 1.0 - 0.4 * d.y * up].map(|value| self.sky * value)
    }

    fn harmonics(&self) -> Harmonics {
        project(|d| self.sky_light(d))
    }

    fn field(&self, eye: DVec3) -> RainField<'_> {
        let field = RainField::from(self.volume);
        match &self.map {
            Some(map) => field.with_map(map, DVec3::ZERO, eye).with_farthest(Some(Metres(3e3))),
            None => field,
        }
    }

    fn medium(&self) -> Medium {
        Medium::geometric(MillimetresPerHour(self.rate))
    }
}

fn camera() -> Camera {
    let (eye, target) = (DVec3::new(1.0, -12.0, 2.0), DVec3::new(14.0, 110.0, 8.0));
    Camera::look_at(eye, target, Degrees(55.0), SIZE).unwrap()
}

fn windows() -> [EnvironmentWindow; 2] {
    let mirror = EnvironmentWindow {
        heading: Radians(1.4),
        half_width: Radians(1.1),
        bottom: Radians(0.0),
        top: Radians(1.2),
        size: [100, 60],
    };
    let around = EnvironmentWindow {
        heading: Radians(0.0),
        half_width: Radians(std::f64::consts::PI),
        bottom: Radians(-std::f64::consts::FRAC_PI_2),
        top: Radians(std::f64::consts::FRAC_PI_2),
        size: [97, 49],
    };
    [mirror, around]
}

fn maps(case: &Case) -> [Environment; 2] {
    windows().map(|window| Environment::new(window, &|d| case.sky_light(d)))
}

/// The world's light on the rain.
fn world(case: &Case) -> (WorldLight, InScattering) {
    let world = WorldLight::from_radiance(&|d| case.sky_light(d), case.sun);
    let shown = case.medium().in_scattering(&world);
    (world, shown)
}

fn by_the_processor(case: &Case, town: &Town, quality: Quality) -> TownFrame {
    let (camera, harmonics, [mirror, around]) = (camera(), case.harmonics(), maps(case));
    let (_, shown) = world(case);
    let rain = TownRain::new(case.medium(), case.field(camera.position), &shown);
    let leaves = |_: Vec3, d: Vec3| if mirror.holds(d) { mirror.lookup(d) } else { around.lookup(d) };
    let glows: Vec<GlowLight> = case.glow.into_iter().collect();
    let lighting = Lighting {
        ambient: &|normal| irradiance_from(&harmonics, normal),
        points: &case.points,
        images: &case.images,
        strokes: &[],
        glows: &glows,
        leaves: &leaves,
        sun: case.sun,
        rain: &rain,
    };
    let mut frame = TownFrame::default();
    town.render(&camera, &lighting, quality, &mut frame);
    frame
}

struct Drawn {
    /// Light and cover.
    town: Vec<[f32; 4]>,
    metres: Vec<f32>,
    /// Pixels that were worked out on their own.
    alone: u32,
}

/// Everything that draws on the card, for all cases: shaders are compiled once.
struct Card {
    gpu: Gpu,
    frame: FrameGroup,
    rain: RainGroup,
    harmonics: Held<wgpu::Buffer>,
    told: Held<wgpu::Buffer>,
    shown: ShownPass,
    passes: TownPasses,
    maps: [Image; 2],
    picture: Image,
    metres: Image,
    clock: Clock,
    back: Readback,
}

impl Card {
    fn new(gpu: &Gpu, town: &Town) -> Self {
        let frame = FrameGroup::new(gpu);
        frame.set(gpu, &FrameUniform::of_camera(&camera(), 1.0));
        let rays = TownGroup::new(gpu, Some(town));
        let told = gpu.uniform::<Around>("around");
        let rain = RainGroup::new(gpu, &StreakSet::new(&StreakSection::default()).tables(), &told);
        let harmonics = gpu.storage("harmonics", &WorldLight::default().all_coefficients());
        let shown = ShownPass::new(gpu, &frame.layout, &rain, &harmonics);
        let passes = TownPasses::new(gpu, &frame, (town, &rays), &rain).unwrap();
        let map = |window: EnvironmentWindow| {
            gpu.target("map", window.size.map(|count| count as u32), wgpu::TextureFormat::Rgba32Float)
        };
        Self {
            gpu: gpu.clone(),
            frame,
            rain,
            harmonics,
            told,
            shown,
            passes,
            maps: windows().map(map),
            picture: gpu.target("town", SIZE, LIGHT),
            metres: gpu.target("metres", SIZE, METRES),
            clock: Clock::new(gpu),
            back: Readback::new(gpu),
        }
    }

    fn light(&mut self, case: &Case, quality: Quality) {
        let (gpu, camera) = (&self.gpu, camera());
        let field = case.field(camera.position);
        gpu.write(&self.rain.field, &[field.uniform()]);
        self.rain.set_map(gpu, field.map());
        let (medium, (world, _)) = (case.medium(), world(case));
        let phase: &Phase = medium.phase();
        let mut light = RainLight {
            phases: [phase.numbers(); 3],
            sun_lost: [0.0, 1.0, 0.0, 0.0],
            ..RainLight::default()
        };
        if let Some(sun) = case.sun {
            light.sun_towards[..3].copy_from_slice(&sun.towards.to_array());
            light.sun[..3].copy_from_slice(&sun.irradiance);
        }
        gpu.write(&self.rain.light, &[light]);
        gpu.write(&self.harmonics, &world.all_coefficients());
        self.shown.set_phases(gpu, &self.rain, [phase; 3]);
        for (image, map) in self.maps.iter().zip(maps(case)) {
            let (_, texels) = map.texels();
            gpu.fill(image, &texels.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect::<Vec<[f32; 4]>>());
        }
        let lights = TownLights {
            ambient: &case.harmonics(),
            points: &case.points,
            images: &case.images,
            sun: case.sun,
            rain_extinction: medium.extinction().0 as f32,
            windows: windows(),
        };
        self.passes.set(gpu, &camera, quality, &lights).unwrap();
        let mut told = Around { sun_open: 1.0, ..Around::default() };
        if let Some(glow) = &case.glow {
            (told.glow_centre, told.glow_radius) = (glow.centre.to_array(), glow.radius);
            told.glow_radiance = glow.radiance;
        }
        gpu.write(&self.told, &[told]);
        if self.passes.wants_targets() {
            let maps = self.maps.each_ref().map(|map| &map.view);
            let (town, metres) = (&self.picture.view, &self.metres.view);
            self.passes.set_targets(gpu, &TownTargets { maps, town, metres });
        }
    }

    fn draw(&mut self, case: &Case, quality: Quality) -> Drawn {
        self.light(case, quality);
        let mut recorder = self.clock.record(false);
        self.shown.record(&mut recorder, &self.frame.group);
        self.passes.record(&self.gpu, &mut recorder, [&self.frame.group, &self.rain.group], true);
        self.back.copy(&mut recorder.encoder, &self.picture);
        recorder.submit();
        let texels = self.back.values::<[u16; 4]>().unwrap();
        let town = texels.iter().map(|texel| texel.map(value_of)).collect();
        let mut recorder = self.clock.record(false);
        self.back.copy(&mut recorder.encoder, &self.metres);
        recorder.submit();
        let metres = self.back.values().unwrap();
        let mut recorder = self.clock.record(false);
        self.back.copy_buffer(&mut recorder.encoder, self.passes.rest().unwrap());
        recorder.submit();
        let list: Vec<u32> = self.back.values().unwrap();
        Drawn { town, metres, alone: list[3] }
    }
}

/// Share of pixels that may show other facets: where a place is at the border of the water's grain, round-off decides.
const OTHER_FACETS: f64 = 1e-3;

/// Relative L2 of the light but for [`OTHER_FACETS`], share of pixels whose cover differs, share whose distance does.
fn apart(wanted: &TownFrame, found: &Drawn) -> [f64; 3] {
    let (mut misses, mut whole, mut covers, mut far) = (Vec::new(), 0.0, 0.0, 0.0);
    for (i, pixel) in wanted.pixels.iter().enumerate() {
        let off = |band: usize| crate::gpu::square(found.town[i][band] - pixel.radiance[band]);
        misses.push((0..3).map(off).sum::<f64>());
        whole += pixel.radiance.iter().map(|&value| crate::gpu::square(value)).sum::<f64>();
        covers += f64::from(u8::from((found.town[i][3] - pixel.cover).abs() > 1e-3));
        let wanted = pixel.distance.min(1e30);
        far += f64::from(u8::from((found.metres[i] - wanted).abs() > 1e-4 * wanted));
    }
    misses.sort_by(f64::total_cmp);
    let count = misses.len() as f64;
    misses.truncate(misses.len() - (OTHER_FACETS * count) as usize);
    [(misses.iter().sum::<f64>() / whole).sqrt(), covers / count, far / count]
}

fn cases() -> Vec<Case> {
    let sun = Sun {
        towards: Vec3::new(-0.5, 0.6, 0.35).normalize(),
        irradiance: [3.0, 2.5, 2.0],
        angular_radius: Sun::ANGULAR_RADIUS,
    };
    let ceiling = Some(Ceiling { height: Metres(300.0), softness: Metres(80.0) });
    let rates = [40.0, 4.0, 10.0, 30.0, 50.0, 20.0, 60.0, 0.0, 50.0];
    let top = Some(Ceiling { height: Metres(900.0), softness: Metres(150.0) });
    let map = RainMap::new(DVec2::new(-900.0, -800.0), Metres(600.0), [3, 3], &rates, top).unwrap();
    let rainy = Case { rate: 40.0, ..Case::flash("rain in a flash") };
    vec![
        Case::dusk("dusk"),
        Case { sun: Some(sun), ..Case::dusk("day") },
        Case::flash("flash"),
        Case { sun: Some(sun), ..rainy },
        Case {
            rate: 40.0,
            volume: RainVolume { ceiling, region: None },
            ..Case::flash("rain under a ceiling")
        },
        Case { rate: 40.0, map: Some(map), ..Case::flash("rain in a map") },
    ]
}

#[test]
fn the_town_on_the_card_is_the_processors_in_every_light() {
    /// Half precision of light at nodes and in the picture.
    const LIGHT_ERROR: f64 = 1e-3;
    /// Pixels whose samples pass an edge within round-off.
    const EDGES: f64 = 1e-3;
    let Some(gpu) = test_gpu() else { return };
    let town = Town::new(&section());
    let mut card = Card::new(&gpu, &town);
    for case in cases() {
        // Nodes at every second pixel, as a still picture has them, and at every pixel.
        for spacing in [2, 1] {
            let quality = Quality { spacing, slow_spacing: 1, ..Quality::STILL };
            let wanted = by_the_processor(&case, &town, quality);
            let found = card.draw(&case, quality);
            let [light, covers, far] = apart(&wanted, &found);
            println!(
                "{}, {spacing}: light {light:.1e}, cover {covers:.1e}, distance {far:.1e}, {} pixels alone",
                case.name, found.alone
            );
            assert!(light < LIGHT_ERROR && covers <= EDGES && far <= EDGES, "{}", case.name);
        }
    }
}

#[test]
fn a_town_with_more_lamps_than_a_texture_has_maps_for_is_refused_by_name() {
    let lamp = StreetLamp { position: [0.0, 0.0, 8.0], intensity: [1.0; 3] };
    let town = |lamps: usize| Town::new(&TownSection { lamps: vec![lamp.clone(); lamps], ..section() });
    let most = MAPS_ACROSS * MAPS_ACROSS;
    check(&town(most)).unwrap();
    let error = check(&town(most + 1)).unwrap_err().to_string();
    assert!(error.contains("at most 16384 lamps") && error.contains("16385"), "{error}");
}
