use super::light::{TownGlow, TownLights, TownSource, TownView};
use super::passes::{TownPasses, TownTargets};
use super::surface::{TownGround, TownPart, TownWall};
use super::*;
use crate::assert_layout;
use crate::camera::Camera;
use crate::gpu::clock::Clock;
use crate::gpu::frame::{FrameGroup, FrameUniform};
use crate::gpu::half::value_of;
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
        TownView { counts, lines, measures, ambient, sun_towards, sun, mirror, around }
    );
    assert_layout!(TOWN_NODES, TownSource { start, share, end, pad, intensity, pad1 });
    assert_layout!(TOWN_NODES, TownGlow { mean, sun_left, centre, radius, radiance, pad0 });
    assert_layout!(TOWN_NODES, TownWall { albedo, glass, radiance, seed, pitch, lit, pad, counts });
    assert_layout!(TOWN_NODES, TownPart { a, b, c });
    assert_layout!(
        TOWN_NODES,
        TownGround { albedo, wetness, shores, puddle_size, ripple, seed, roads, lamps, maps_across }
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
        let place = |i: f32| Vec3::new(220.0 + 30.0 * (i * 1.7).sin(), 700.0 + 3.0 * i, 800.0 - 40.0 * i);
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

fn on_the_card(gpu: &Gpu, case: &Case, town: &Town, quality: Quality) -> Drawn {
    let camera = camera();
    let frame = FrameGroup::new(gpu);
    frame.set(gpu, &FrameUniform::of_camera(&camera, 1.0));
    let rays = TownGroup::new(gpu, Some(town));
    let told = gpu.uniform::<crate::gpu::around::Around>("around");
    gpu.write(&told, &[crate::gpu::around::Around { sun_open: 1.0, ..Default::default() }]);
    let mut rain = RainGroup::new(gpu, &StreakSet::new(&StreakSection::default()).tables(), &told);
    let field = case.field(camera.position);
    gpu.write(&rain.field, &[field.uniform()]);
    rain.set_map(gpu, field.map());
    let (medium, (world, _)) = (case.medium(), world(case));
    let phase: &Phase = medium.phase();
    let mut light = RainLight { phases: [phase.numbers(); 3], ..RainLight::default() };
    if let Some(sun) = case.sun {
        light.sun_towards[..3].copy_from_slice(&sun.towards.to_array());
        light.sun[..3].copy_from_slice(&sun.irradiance);
    }
    gpu.write(&rain.light, &[light]);
    let harmonics = gpu.storage("harmonics", &world.all_coefficients());
    let mut shown = ShownPass::new(gpu, &frame.layout, &rain, &harmonics);
    shown.set_phases(gpu, &rain, [phase; 3]);

    let mut passes = TownPasses::new(gpu, &frame, (town, &rays), &rain).unwrap();
    let maps = maps(case).map(|map| {
        let (window, texels) = map.texels();
        let size = window.size.map(|count| count as u32);
        let image = gpu.target("map", size, wgpu::TextureFormat::Rgba32Float);
        gpu.fill(&image, &texels.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect::<Vec<[f32; 4]>>());
        image
    });
    let lights = TownLights {
        ambient: &case.harmonics(),
        points: &case.points,
        images: &case.images,
        sun: case.sun,
        rain_extinction: medium.extinction().0 as f32,
        windows: windows(),
    };
    passes.set(gpu, &camera, quality, &lights);
    gpu.write(&passes.glow, &[TownGlow::new(case.glow.as_ref(), 1.0)]);
    let (picture, metres) = (gpu.target("town", SIZE, LIGHT), gpu.target("metres", SIZE, METRES));
    assert!(passes.wants_targets());
    let [mirror, around] = &maps;
    passes.set_targets(
        gpu,
        &TownTargets { maps: [&mirror.view, &around.view], town: &picture.view, metres: &metres.view },
    );
    let (mut clock, mut back) = (Clock::new(gpu), Readback::new(gpu));
    let mut recorder = clock.record(false);
    shown.record(&mut recorder, &frame.group);
    passes.record(gpu, &mut recorder, [&frame.group, &rain.group]);
    back.copy(&mut recorder.encoder, &picture);
    recorder.submit();
    let town = back.values::<[u16; 4]>().unwrap().iter().map(|texel| texel.map(value_of)).collect();
    let mut recorder = clock.record(false);
    back.copy(&mut recorder.encoder, &metres);
    recorder.submit();
    let metres = back.values().unwrap();
    let mut recorder = clock.record(false);
    back.copy_buffer(&mut recorder.encoder, passes.rest().unwrap());
    recorder.submit();
    let list: Vec<u32> = back.values().unwrap();
    Drawn { town, metres, alone: list[3] }
}

/// Relative L2 of the light, share of pixels whose cover differs, share whose distance does.
fn apart(wanted: &TownFrame, found: &Drawn) -> [f64; 3] {
    let (mut miss, mut whole, mut covers, mut far) = (0.0, 0.0, 0.0, 0.0);
    for (i, pixel) in wanted.pixels.iter().enumerate() {
        for band in 0..3 {
            miss += f64::from(found.town[i][band] - pixel.radiance[band]).powi(2);
            whole += f64::from(pixel.radiance[band]).powi(2);
        }
        covers += f64::from(u8::from((found.town[i][3] - pixel.cover).abs() > 1e-3));
        let wanted = pixel.distance.min(3e38);
        far += f64::from(u8::from((found.metres[i] - wanted).abs() > 1e-4 * wanted));
    }
    let count = wanted.pixels.len() as f64;
    [(miss / whole).sqrt(), covers / count, far / count]
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
    /// Half precision of light at nodes and in the picture; a facet of a place at a cell's border is another's.
    const LIGHT_ERROR: f64 = 1e-3;
    /// Pixels whose samples pass an edge within round-off.
    const EDGES: f64 = 1e-3;
    let Some(gpu) = test_gpu() else { return };
    let town = Town::new(&section());
    for case in cases() {
        // Nodes at every second pixel, as a still picture has them, and at every pixel.
        for spacing in [2, 1] {
            let quality = Quality { spacing, ..Quality::STILL };
            let wanted = by_the_processor(&case, &town, quality);
            let found = on_the_card(&gpu, &case, &town, quality);
            let [light, covers, far] = apart(&wanted, &found);
            if std::env::var("ZZ_WORST").is_ok() {
                let mut all: Vec<(f32, usize)> = (0..wanted.pixels.len())
                    .map(|i| ((found.town[i][1] - wanted.pixels[i].radiance[1]).abs(), i))
                    .collect();
                all.sort_by(|a, b| b.0.total_cmp(&a.0));
                let sum: f32 = all.iter().map(|a| a.0 * a.0).sum();
                let mut so = 0.0;
                for (off, i) in &all[..14] {
                    so += off * off;
                    let p = &wanted.pixels[*i];
                    println!(
                        "  {} {}: {:.4} for {:.4}, share {:.3}, {:.1} m, n {:.2}",
                        i % 160,
                        i / 160,
                        found.town[*i][1],
                        p.radiance[1],
                        so / sum,
                        p.distance,
                        p.normal
                    );
                }
                let dump = |name: &str, values: Vec<f32>| {
                    std::fs::write(format!("/tmp/zz_{name}_{spacing}.f32"), bytemuck::cast_slice(&values))
                        .unwrap()
                };
                dump(
                    &format!("{}_wanted", case.name.replace(' ', "_")),
                    wanted.pixels.iter().flat_map(|p| p.radiance).collect(),
                );
                dump(
                    &format!("{}_found", case.name.replace(' ', "_")),
                    found.town.iter().flat_map(|p| [p[0], p[1], p[2]]).collect(),
                );
            }
            println!(
                "{}, {spacing}: light {light:.1e}, cover {covers:.1e}, distance {far:.1e}, {} pixels alone",
                case.name, found.alone
            );
            if std::env::var("ZZ_WORST").is_ok() {
                continue;
            }
            assert!(light < LIGHT_ERROR && covers <= EDGES && far <= EDGES, "{}", case.name);
        }
    }
}
