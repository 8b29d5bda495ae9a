use super::*;
use crate::assert_layout;
use crate::camera::Camera;
use crate::depth::{DepthBuffer, DepthKind};
use crate::gpu::around::Around;
use crate::gpu::clock::Clock;
use crate::gpu::frame::{FrameGroup, FrameUniform};
use crate::gpu::half::{bits_of, value_of};
use crate::gpu::rain::RainLight;
use crate::gpu::readback::Readback;
use crate::gpu::relief::ReliefPass;
use crate::gpu::shader::SPOTS_PLACE;
use crate::gpu::shown::ShownPass;
use crate::gpu::spots::{Spot, SpotFrame, SpotSource};
use crate::gpu::test_gpu;
use crate::gpu::town::TownGroup;
use crate::load::Asset;
use crate::medium::{Outlook, Phase, PhaseTable};
use crate::picture::Picture;
use crate::rain::{
    Ceiling, CoverMap, CoveredRain, Covers, RainField, RainMap, RainPath, RainVolume, Region, Shelter, Shot,
};
use crate::renderer::halos::Halos;
use crate::renderer::lit_stroke::LitStroke;
use crate::shade::streak::StreakSet;
use crate::shade::town::Town;
use crate::shade::town::light::StrokeLights;
use crate::shade::town::line::LineLight;
use crate::shade::town::tests::small_town;
use crate::stroke::Stroke;
use crate::world::{InScattering, Sun, WorldLight};
use glam::{DVec2, DVec3, Vec3};
use squall_formats::section::density::DensitySection;
use squall_formats::section::streak::StreakSection;
use squall_formats::section::town::{Block, Ground, StreetLamp, TownSection};
use squall_formats::units::{Degrees, Metres, MillimetresPerHour, Seconds};
use std::sync::Arc;

const SIZE: [u32; 2] = [160, 90];

#[test]
fn structs_lie_as_the_shaders_have_them() {
    assert_layout!(MEDIUM, MediumFrame { medium, counts, relief, shells });
    assert_layout!(MEDIUM, HaloLight { start, radius, end, shape, intensity, extinction, most, number });
    assert_layout!(SPOTS_PLACE, SpotSource { position, stroke, light, sigma });
    assert_layout!(SPOTS_PLACE, Spot { pixel, sigma, reach, light });
    assert_layout!(SPOTS_PLACE, SpotFrame { counts });
}

fn camera() -> Camera {
    let (eye, target) = (DVec3::new(3.0, -20.0, 2.0), DVec3::new(0.0, 60.0, 8.0));
    Camera::look_at(eye, target, Degrees(60.0), SIZE).unwrap()
}

/// Metres to a scene: ground below, a wall, sky.
fn metres(x: usize, y: usize) -> f32 {
    match (x, y) {
        (_, 60..) => 2.0 / (y as f32 - 44.0) * 90.0,
        (40..80, _) => 300.0,
        _ => 1e30,
    }
}

fn behind(x: usize, y: usize) -> [f32; 3] {
    [0.2 + 0.01 * x as f32, 0.5, 0.03 * y as f32]
}

struct Case {
    name: &'static str,
    volume: RainVolume,
    map: Option<RainMap>,
    farthest: Option<f64>,
    phase: Phase,
    halos: bool,
    /// Blocks, masts and lamps that stand in it; a roof of the caller's; metres across that drops fall for each metre down.
    town: Option<Town>,
    roof: Option<Arc<CoverMap>>,
    lean: [f64; 2],
}

fn cases() -> Vec<Case> {
    let hg = Phase::HenyeyGreenstein(0.77);
    let plain = |name| Case {
        name,
        volume: RainVolume::default(),
        map: None,
        farthest: None,
        phase: hg.clone(),
        halos: false,
        town: None,
        roof: None,
        lean: [0.0; 2],
    };
    let ceiling = Some(Ceiling { height: Metres(120.0), softness: Metres(60.0) });
    let region = Some(Region { centre: [30.0, 150.0], radius: Metres(90.0), softness: Metres(80.0) });
    let rates = [40.0, 4.0, 0.0, 30.0, 50.0, 20.0, 0.0, 0.0, 50.0];
    let top = Some(Ceiling { height: Metres(400.0), softness: Metres(150.0) });
    let map = RainMap::new(DVec2::new(-400.0, -300.0), Metres(300.0), [3, 3], &rates, top).unwrap();
    vec![
        plain("endless rain"),
        Case { volume: RainVolume { ceiling, region: None }, ..plain("under a ceiling") },
        Case { volume: RainVolume { ceiling, region }, ..plain("in a region under a ceiling") },
        Case { map: Some(map), farthest: Some(900.0), ..plain("in a map") },
        Case { phase: Phase::Table(Arc::new(PhaseTable::drops())), ..plain("drops with a bow") },
        Case { halos: true, ..plain("with halos") },
        Case {
            halos: true,
            volume: RainVolume { ceiling, region: None },
            ..plain("with halos under a ceiling")
        },
        Case { town: Some(small_town()), lean: [0.2, -0.7], ..plain("in the lee of a tower") },
        Case {
            town: Some(small_town()),
            volume: RainVolume { ceiling, region },
            lean: [-0.3, 0.4],
            ..plain("in the lee of a tower in bounds")
        },
        Case { roof: Some(roof()), lean: [0.5, 0.3], ..plain("under a roof of the caller's") },
        Case { halos: true, town: Some(walled_lamp()), ..plain("with walls before lamps") },
    ]
}

/// A lamp behind a low wall, and one beside it.
fn walled_lamp() -> Town {
    let wall = Block {
        centre: [2.0, 14.0],
        half: [4.0, 0.5],
        foot: 0.0,
        height: 6.0,
        yaw: 0.3,
        albedo: [0.3; 3],
        windows: None,
    };
    let lamps = [[2.0, 20.0, 5.0], [-6.0, 12.0, 5.0]];
    let lamps = lamps.map(|position| StreetLamp { position, intensity: [90.0, 70.0, 30.0] }).to_vec();
    Town::new(&TownSection { ground: Ground::default(), blocks: vec![wall], lamps, hills: None })
}

/// A roof 30 m wide and 40 m long that the camera looks under, with a hole in it.
fn roof() -> Arc<CoverMap> {
    let tops: Vec<f32> = (0..12).map(|i| if i == 5 { f32::NAN } else { 12.0 + i as f32 }).collect();
    let undersides = tops.iter().map(|top| top - 0.5).collect();
    let corner = DVec3::new(-15.0, -5.0, 0.0);
    Arc::new(CoverMap::roofs(corner, Metres(10.0), [3, 4], undersides, tops).unwrap())
}

/// Lamps near and far, one of them behind the eye, and a stroke in sight.
fn lamps() -> Vec<StreetLamp> {
    let places = [[2.0, 12.0, 6.0], [-30.0, 80.0, 6.0], [5.0, -60.0, 6.0]];
    places.map(|position| StreetLamp { position, intensity: [90.0, 70.0, 30.0] }).to_vec()
}

fn stroke() -> LitStroke {
    let ends = [DVec3::new(200.0, 900.0, 700.0), DVec3::new(210.0, 910.0, 0.0)];
    let stroke = Arc::new(Stroke::between(ends[0], ends[1], 3, 1e6).unwrap());
    let line = |a: DVec3, b: DVec3| LineLight {
        from: a.as_vec3(),
        to: b.as_vec3(),
        intensity: [2e5, 2e5, 3e5],
        visibility: 0.8,
    };
    let middle = DVec3::new(230.0, 880.0, 300.0);
    let images = vec![line(ends[0], middle), line(middle, ends[1])].into();
    LitStroke { stroke, scale: [1.0, 0.5, 2.0], lights: StrokeLights { images, points: Vec::new() } }
}

/// What keeps a case's rain off.
fn covers_of<'a>(case: &'a Case, roofs: &'a [Arc<CoverMap>]) -> Covers<'a> {
    Covers { first: case.town.as_ref().filter(|_| !case.halos).map(|town| town as &dyn Shelter), maps: roofs }
}

/// The same picture, and what is left of it.
fn by_the_processor<V: RainPath>(
    camera: &Camera,
    (medium, field, light): (&Medium, V, &InScattering),
    ranges: &[f32],
    halos: &Halos<'_>,
) -> (Vec<[f32; 3]>, Vec<f32>) {
    let (width, height) = (SIZE[0] as usize, SIZE[1] as usize);
    let mut picture = Picture::new(width, height).unwrap();
    picture.pixels.iter_mut().enumerate().for_each(|(i, pixel)| *pixel = behind(i % width, i / width));
    let endless: Vec<f32> =
        ranges.iter().map(|&range| if range >= 1e30 { f32::INFINITY } else { range }).collect();
    let depth = Some(DepthBuffer::new(&endless, width, height, DepthKind::Range).unwrap());
    let mut left = vec![0.0; ranges.len()];
    medium.apply(&Outlook { camera, volume: field, light, depth }, &mut picture, &mut left).unwrap();
    for (i, pixel) in picture.pixels.iter_mut().enumerate() {
        let ray = camera.ray((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let halo = halos.radiance(&ray, f64::from(endless[i]), *pixel);
        (0..3).for_each(|band| pixel[band] += halo[band]);
    }
    (picture.pixels, left)
}

/// What the card would find around the eye: all of the sun.
fn told(gpu: &Gpu) -> wgpu::Buffer {
    let told = gpu.uniform::<Around>("around");
    gpu.write(&told, &[Around { sun_open: 1.0, ..Around::default() }]);
    told.clone()
}

/// What the card makes of the picture, and what of it is left.
fn by_the_card(
    gpu: &Gpu,
    (camera, world, sun): (&Camera, &WorldLight, Sun),
    (medium, field, phase): (&Medium, RainField<'_>, &Phase),
    ranges: &[f32],
    (halos, spreading): (&Halos<'_>, &Spreading),
    (case, fall): (&Case, DVec3),
) -> (Vec<[u16; 4]>, Vec<f32>) {
    let frame = FrameGroup::new(gpu);
    frame.set(gpu, &FrameUniform::of_camera(camera, 1.0));
    let mut group = RainGroup::new(gpu, &StreakSet::new(&StreakSection::default()).tables(), &told(gpu));
    let roofs: Vec<Arc<CoverMap>> = case.roof.iter().cloned().collect();
    let mut place = field.uniform();
    group.set_covers(gpu, &roofs, &mut place).unwrap();
    gpu.write(&group.field, &[place]);
    group.set_map(gpu, field.map());
    let town = TownGroup::new(gpu, case.town.as_ref());
    let mut relief = ReliefPass::new(gpu, [&frame.layout, &town.layout], &group);
    let dry = relief.set(gpu, covers_of(case, &roofs), fall, camera);
    let mut uniform = RainLight { phases: [phase.numbers(); 3], ..RainLight::default() };
    let [x, y, z] = sun.towards.to_array();
    let [r, g, b] = sun.irradiance;
    (uniform.sun_towards, uniform.sun) = ([x, y, z, 0.0], [r, g, b, 0.0]);
    gpu.write(&group.light, &[uniform]);
    let harmonics = gpu.storage("harmonics", &world.all_coefficients());
    let mut shown = ShownPass::new(gpu, &frame.layout, &group, &harmonics);
    shown.set_phases(gpu, &group, [phase; 3]);
    let others = [&relief.heights.view, &town.reach.view];
    let mut pass = MediumPass::new(gpu, &frame.layout, &group, others);
    pass.set(gpu, Some(medium), (&halos.list(), Some(spreading)), dry).unwrap();
    let picture = gpu.target("picture", SIZE, LIGHT);
    let (width, height) = (SIZE[0] as usize, SIZE[1] as usize);
    let each = (0..width * height).map(|i| (i % width, i / width));
    let texel = |(x, y)| {
        let [r, g, b] = behind(x, y);
        [r, g, b, 1.0].map(bits_of)
    };
    gpu.fill(&picture, &each.map(texel).collect::<Vec<[u16; 4]>>());
    let distance = gpu.target("metres", SIZE, METRES);
    gpu.fill(&distance, ranges);
    let out = gpu.target("out", SIZE, LIGHT);
    pass.set_targets(gpu, [&picture.view, &distance.view, &out.view], SIZE);
    let (mut clock, mut back) = (Clock::new(gpu), Readback::new(gpu));
    let mut recorder = clock.record(false);
    shown.record(&mut recorder, &frame.group);
    relief.record(&mut recorder, [&frame.group, &town.group, &group.group]);
    pass.record(&mut recorder, [&frame.group, &group.group]);
    back.copy(&mut recorder.encoder, pass.left.as_ref().unwrap());
    recorder.submit();
    let left: Vec<f32> = back.values().unwrap();
    let mut recorder = clock.record(false);
    back.copy(&mut recorder.encoder, &out);
    recorder.submit();
    let texels: Vec<[u16; 4]> = back.values().unwrap();
    (texels, left)
}

#[test]
fn a_picture_behind_rain_is_the_processors_in_every_kind_of_rain() {
    /// Nodes of the processor's J, half precision, relative L2.
    const LIGHT_ERROR: f64 = 5e-3;
    /// Transmittance of a pixel: numerical integrals of bounds, single precision.
    const LEFT: f32 = 2e-3;
    let Some(gpu) = test_gpu() else { return };
    let asset = Asset::open(concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall")).unwrap();
    let section: DensitySection =
        asset.section(DensitySection::TAG, "density", DensitySection::read).unwrap();
    let camera = camera();
    let sun = Sun {
        towards: Vec3::new(0.3, 0.9, 0.25).normalize(),
        irradiance: [1.5, 1.0, 0.5],
        angular_radius: Sun::ANGULAR_RADIUS,
    };
    let world = WorldLight::from_radiance(&|d| [0.2 + 0.8 * d.z.max(0.0), 0.3, 0.9 - 0.4 * d.x], Some(sun));
    for case in cases() {
        let field = RainField::from(case.volume).with_farthest(case.farthest.map(Metres));
        let field = match &case.map {
            Some(map) => field.with_map(map, DVec3::ZERO, camera.position),
            None => field,
        };
        let shot = Shot { min_px: 8.0, max_px: 100.0, ..Shot::new(&camera, Seconds(0.02)) };
        let rate = field.rate(MillimetresPerHour(section.largest_rate().0));
        let medium = Medium::beside_streaks(&section, &shot, rate).unwrap().with_phase(case.phase.clone());
        let light = medium.in_scattering(&world);
        let spreading = Spreading::of(None, medium.phase());
        let mut halos = Halos::new(&spreading, &medium, &field).with_walls(case.town.as_ref());
        if case.halos {
            let own = lamps();
            halos.add_lamps(case.town.as_ref().map_or(&own[..], |town| town.lamps()), camera.position);
            halos.add_stroke(&stroke(), camera.position);
        }

        if let Some(town) = case.town.as_ref().filter(|_| case.halos) {
            let lamps_of = |walls| {
                let mut lit = Halos::new(&spreading, &medium, &field).with_walls(walls);
                lit.add_lamps(town.lamps(), camera.position);
                lit
            };
            let [walled, open] = [Some(town), None].map(lamps_of);
            let light = |halos: &Halos<'_>, i: u32| {
                let ray = camera.ray(f64::from(i % SIZE[0]), f64::from(i / SIZE[0]));
                halos.radiance(&ray, 300.0, [0.1; 3])[0]
            };
            let is_shaded = |i: &u32| light(&walled, *i) < 0.9 * light(&open, *i);
            let shaded = (0..SIZE[0] * SIZE[1]).filter(is_shaded).count();
            assert!(shaded > 500, "walls shade {shaded} pixels alone");
        }
        let (width, height) = (SIZE[0] as usize, SIZE[1] as usize);
        let each = || (0..width * height).map(|i| (i % width, i / width));
        let ranges: Vec<f32> = each().map(|(x, y)| metres(x, y)).collect();
        let fall = DVec3::new(case.lean[0], case.lean[1], -1.0) * 6.0;
        let roofs: Vec<Arc<CoverMap>> = case.roof.iter().cloned().collect();
        let covered = CoveredRain::new(field, covers_of(&case, &roofs), fall, &camera);
        let (wanted, wanted_left) = by_the_processor(&camera, (&medium, covered, &light), &ranges, &halos);
        if case.town.is_some() && !case.halos || case.roof.is_some() {
            let (_, open) = by_the_processor(&camera, (&medium, field, &light), &ranges, &halos);
            let more = open.iter().zip(&wanted_left).filter(|(open, left)| **left > **open + 2.0 * LEFT);
            assert!(more.count() > 100, "{}: nothing is dry", case.name);
        }

        let of = (&medium, field, &case.phase);
        let lights = (&halos, &spreading);
        let (texels, left) = by_the_card(&gpu, (&camera, &world, sun), of, &ranges, lights, (&case, fall));
        let (mut miss, mut whole, mut worst) = (0.0, 0.0, 0.0f32);
        for (i, wanted) in wanted.iter().enumerate() {
            worst = worst.max((left[i] - wanted_left[i]).abs());
            for band in 0..3 {
                let found = f64::from(value_of(texels[i][band]));
                miss += (found - f64::from(wanted[band])) * (found - f64::from(wanted[band]));
                whole += crate::gpu::square(wanted[band]);
            }
        }
        let error = f64::sqrt(miss / whole);
        println!("{}: light {error:.1e}, left {worst:.1e}", case.name);
        assert!(error < LIGHT_ERROR && worst < LEFT, "{}", case.name);
    }
}
