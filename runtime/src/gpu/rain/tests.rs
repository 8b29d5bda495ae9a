use super::*;
use crate::assert_layout;
use crate::camera::Camera;
use crate::gpu::around::Around;
use crate::gpu::clock::Clock;
use crate::gpu::frame::{FrameGroup, FrameUniform};
use crate::gpu::half::value_of;
use crate::gpu::readback::Readback;
use crate::gpu::shader::{RAIN_DRAW, RAIN_FIND, SHOWN};
use crate::gpu::shown::{Moments, ShownPass};
use crate::gpu::test_gpu;
use crate::gpu::town::{TownBox, TownGroup, TownNode, TownPlace};
use crate::load::Asset;
use crate::medium::Phase;
use crate::picture::Picture;
use crate::rain::{
    Ceiling, CoverMap, Covers, Rain, RainField, RainMap, RainVolume, Region, Scene, Shelter, Shot, Streak,
    Weather, Workspace,
};
use crate::shade::streak::StreakSet;
use crate::shade::town::Town;
use crate::shade::town::tests::small_town;
use crate::world::{InScattering, WorldLight};
use glam::{DVec2, DVec3};
use squall_formats::section::density::DensitySection;
use squall_formats::section::streak::StreakSection;
use squall_formats::units::{Degrees, Metres, MillimetresPerHour, Seconds};
use std::collections::BTreeMap;
use std::sync::Arc;

const SIZE: [u32; 2] = [160, 90];

#[test]
fn structs_lie_as_the_shaders_have_them() {
    assert_layout!(
        RAIN_FIND,
        RainLight {
            sun_towards,
            sun,
            flash_towards,
            flash,
            medium_flash_towards,
            medium_flash,
            phases,
            sun_lost
        }
    );
    assert_layout!(
        RAIN_FIND,
        RainFrame {
            exposure,
            still_way,
            world_up,
            wind,
            lens,
            shift,
            lengths,
            counts,
            flags,
            classes,
            near_lamps
        }
    );
    assert_layout!(RAIN_FIND, NearLamp { position, intensity });
    assert_layout!(
        RAIN_FIND,
        RainClass {
            key,
            smallest,
            width,
            base_x,
            base_y,
            base_z,
            crowd,
            floor,
            low,
            first,
            size,
            edge,
            place,
            near,
            far,
            planes
        }
    );
    assert_layout!(RAIN_FIND, PatternHead { body, range, tables, light, kind, sides, ends, softness });
    assert_layout!(
        RAIN_DRAW,
        DrawnStreak { ends, light, id, pattern, kind, place, steps, tables, shares, bounds }
    );
    assert_layout!(RAIN_FIND, TownPlace { hills, counts, top });
    assert_layout!(RAIN_FIND, TownNode { low, first, high, count });
    assert_layout!(RAIN_FIND, TownBox { centre, axis, half, foot, top });
    assert_layout!(SHOWN, Moments { left, sun });
    type RainField = FieldUniform;
    assert_layout!(RAIN_FIND, RainField { ceiling, region, map_place, map_top, has, counts, covers });
    assert_layout!(RAIN_FIND, CoverHead { origin, inverse_cell, size, first, highest });
    type TableSizes = TableUniform;
    assert_layout!(RAIN_DRAW, TableSizes { across, along });
}

fn asset() -> Asset {
    Asset::open(concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall")).unwrap()
}

/// A frame's rain on both.
struct Case {
    camera: Camera,
    weather: Weather,
    map: Option<RainMap>,
    town: Option<Town>,
    roofs: Vec<Arc<CoverMap>>,
    streak_px: [f64; 2],
    metres: f32,
}

impl Case {
    fn new(rate: f64) -> Self {
        let (eye, target) = (DVec3::new(3.0, -20.0, 2.0), DVec3::new(0.0, 60.0, 8.0));
        Self {
            camera: Camera::look_at(eye, target, Degrees(60.0), SIZE).unwrap(),
            weather: Weather::steady(MillimetresPerHour(rate), DVec3::new(3.0, 1.0, 0.0), Seconds(4321.0)),
            map: None,
            town: None,
            roofs: Vec::new(),
            streak_px: [8.0, 100.0],
            metres: 1e30,
        }
    }

    fn shot(&self) -> Shot<'_> {
        let [min_px, max_px] = self.streak_px;
        Shot { min_px, max_px, ..Shot::new(&self.camera, Seconds(0.02)) }
    }

    fn field(&self) -> RainField<'_> {
        let field = RainField::from(self.weather.volume);
        match &self.map {
            Some(map) => field.with_map(map, self.weather.drift, self.camera.position),
            None => field,
        }
    }
}

/// What the card made of a case.
struct Made {
    arguments: DrawArguments,
    streaks: Vec<DrawnStreak>,
    /// The layer, as light and cover.
    layer: Vec<[f32; 4]>,
}

fn on_the_card(gpu: &Gpu, case: &Case, (rain, set): (&Rain, &StreakSet), world: &WorldLight) -> Made {
    let tables = set.tables();
    let frame = FrameGroup::new(gpu);
    frame.set(gpu, &FrameUniform::of_camera(&case.camera, 1.0));
    let town = TownGroup::new(gpu, case.town.as_ref());
    let told = gpu.uniform::<Around>("around");
    let deviation = world.spread()[1] as f32;
    gpu.write(
        &told,
        &[Around { mean: world.mean_radiance(), sun_open: 1.0, deviation, ..Around::default() }],
    );
    let mut group = RainGroup::new(gpu, &tables, &told);
    let mut passes = RainPasses::new(gpu, &frame.layout, &town.layout, &group, &tables);
    let (shot, field) = (case.shot(), case.field());
    let mut numbers = Box::<RainFrame>::default();
    (numbers.still_way[3], numbers.wind[3]) = (1.0, 1.0);
    let mut workspace = Workspace::new();
    rain.uniform(&shot, &case.weather, &field, &mut workspace, &mut numbers).unwrap();
    passes.reserve(gpu, rain.most_found(&shot, &workspace).unwrap());
    numbers.counts[1] = passes.capacity;
    numbers.counts[2] = passes.patterns_count;
    numbers.lengths[2] = passes.shortest_aspect;
    numbers.flags[2] = u32::from(case.town.is_some());
    numbers.flags[3] = u32::from(passes.has_choice);
    gpu.write(&group.frame, &[*numbers]);
    let mut place = field.uniform();
    group.set_covers(gpu, &case.roofs, &mut place).unwrap();
    gpu.write(&group.field, &[place]);
    group.set_map(gpu, field.map());
    let phase = Phase::HenyeyGreenstein(0.77);
    let light = RainLight { phases: [phase.numbers(); 3], ..RainLight::default() };
    gpu.write(&group.light, &[light]);
    let harmonics = gpu.storage("harmonics", &world.all_coefficients());
    let mut shown = ShownPass::new(gpu, &frame.layout, &group, &harmonics);
    shown.set_phases(gpu, &group, [&phase; 3]);
    let distance = gpu.target("distance", SIZE, wgpu::TextureFormat::R32Float);
    gpu.fill(&distance, &vec![case.metres; (SIZE[0] * SIZE[1]) as usize]);
    passes.set_scene(gpu, &distance.view);
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
    let kind = (wgpu::TextureDimension::D2, LAYER);
    let layer = gpu.texture("streaks", [SIZE[0], SIZE[1], 1], kind, usage);
    let (mut clock, mut back) = (Clock::new(gpu), Readback::new(gpu));
    let mut recorder = clock.record(true);
    shown.record(&mut recorder, &frame.group);
    passes.find(gpu, &mut recorder, [&frame.group, &town.group, &group.group], numbers.flags[0]);
    passes.draw(&mut recorder, [&frame.group, &group.group], &layer.view);
    back.copy_buffer(&mut recorder.encoder, &passes.arguments);
    recorder.submit();
    println!("{:?}", clock.read().unwrap());
    let arguments = back.values::<DrawArguments>().unwrap()[0];
    let mut recorder = clock.record(false);
    back.copy_buffer(&mut recorder.encoder, &passes.found);
    recorder.submit();
    let mut streaks: Vec<DrawnStreak> = back.values().unwrap();
    streaks.truncate(arguments.found.min(passes.capacity) as usize);
    let mut recorder = clock.record(false);
    back.copy(&mut recorder.encoder, &layer);
    recorder.submit();
    let texels: Vec<[u16; 4]> = back.values().unwrap();
    Made { arguments, streaks, layer: texels.into_iter().map(|texel| texel.map(value_of)).collect() }
}

fn found_by(rain: &Rain, case: &Case) -> Vec<Streak> {
    let mut workspace = Workspace::new();
    let first = case.town.as_ref().map(|town| town as &dyn Shelter);
    let covers = Covers { first, maps: &case.roofs };
    rain.find_in(&case.shot(), &case.weather, &case.field(), Some(&covers), &mut workspace).unwrap().to_vec()
}

fn section() -> DensitySection {
    asset().section(DensitySection::TAG, "density", DensitySection::read).unwrap()
}

fn patterns() -> StreakSet {
    StreakSet::new(&asset().section(StreakSection::TAG, "streaks", StreakSection::read).unwrap())
}

fn world() -> WorldLight {
    WorldLight::from_radiance(&|d| [0.2 + 0.8 * d.z.max(0.0), 0.3, 0.9 - 0.4 * d.x], None)
}

#[test]
fn drops_are_the_processors_own_drops_in_the_open_under_roofs_in_bounds_and_in_a_map() {
    /// Drops at the edge of single precision: of what is found.
    const MAY_DIFFER: f64 = 1e-4;
    /// Single precision of places in the picture, px, and of inverse depths and coverage.
    const PLACE_PX: f32 = 0.01;
    const SHARE: f32 = 1e-3;
    let Some(gpu) = test_gpu() else { return };
    let (rain, set) = (Rain::new(&section(), 5), patterns());
    let most = section().largest_rate().0;
    let mut cases =
        [Case::new(most), Case::new(0.3 * most), Case::new(0.7 * most), Case::new(most), Case::new(most)];
    cases[1].town = Some(small_town());
    cases[2].weather.volume = RainVolume {
        ceiling: Some(Ceiling { height: Metres(4.0), softness: Metres(5.0) }),
        region: Some(Region { centre: [2.0, -8.0], radius: Metres(9.0), softness: Metres(6.0) }),
    };
    let rates = [1.0, 0.2, 0.0, 0.7, 1.0, 0.4, 0.0, 0.9, 0.6].map(|share| (share * most) as f32);
    cases[3].weather.drift = DVec3::ZERO;
    cases[3].map = Some(RainMap::new(DVec2::new(-18.0, -30.0), Metres(12.0), [3, 3], &rates, None).unwrap());
    // Two roofs, one with holes, over a part of what is seen.
    let tops: Vec<f32> = (0..48).map(|i| if i % 5 == 2 { f32::NAN } else { 2.5 + 0.05 * i as f32 }).collect();
    let undersides = tops.iter().map(|top| top - 0.3).collect();
    let corner = DVec3::new(3.0, -20.5, 0.2);
    let pillar = CoverMap::solid(DVec3::new(2.2, -19.4, 0.0), Metres(0.4), [1, 2], vec![5.0, 2.5]);
    cases[4].roofs = vec![
        Arc::new(CoverMap::roofs(corner, Metres(0.5), [8, 6], undersides, tops).unwrap()),
        Arc::new(pillar.unwrap()),
    ];
    assert!(
        found_by(&rain, &cases[4]).len() < found_by(&rain, &Case::new(most)).len(),
        "the roofs keep nothing off"
    );
    for (number, case) in cases.iter().enumerate() {
        let wanted = found_by(&rain, case);
        let made = on_the_card(&gpu, case, (&rain, &set), &world());
        let by_name: BTreeMap<u64, &Streak> = wanted.iter().map(|streak| (streak.id, streak)).collect();
        let name = |streak: &DrawnStreak| u64::from(streak.id[1]) << 32 | u64::from(streak.id[0]);
        let extra = made.streaks.iter().filter(|streak| !by_name.contains_key(&name(streak))).count();
        let missed = wanted.len() + extra - made.streaks.len();
        println!("case {number}: {} drops, {missed} missed, {extra} too many", wanted.len());
        assert!(wanted.len() > 300 && made.arguments.found as usize == made.streaks.len());
        assert!((missed + extra) as f64 <= (MAY_DIFFER * wanted.len() as f64).max(1.0), "case {number}");
        for streak in &made.streaks {
            let Some(twin) = by_name.get(&name(streak)) else { continue };
            for (found, wanted) in streak.ends.iter().zip(twin.ends.as_flattened()) {
                assert!(
                    (found - wanted).abs() < PLACE_PX * (1.0 + wanted.abs() * 0.01),
                    "{streak:?} {twin:?}"
                );
            }
            assert!((streak.light[3] / twin.coverage - 1.0).abs() < SHARE);
            assert!(streak.kind & 8 != 0 || streak.pattern == twin.pattern % set.len() as u32);
            let [near, far] = twin.end_depths;
            let inverse = 0.5 * (1.0 / near + 1.0 / far);
            assert!((streak.shares[2] / inverse - 1.0).abs() < SHARE);
        }
    }
}

/// Light and cover of the streaks alone, over black.
fn layer_by(rain: &Rain, case: &Case, set: &StreakSet, light: &InScattering) -> (Picture, Vec<f32>) {
    use crate::depth::{DepthBuffer, DepthKind};
    let (shot, mut workspace) = (case.shot(), Workspace::new());
    let shelter = case.town.as_ref().map(|town| town as &dyn Shelter);
    rain.find_in(&shot, &case.weather, &case.field(), shelter, &mut workspace).unwrap();
    let mut picture = Picture::new(SIZE[0] as usize, SIZE[1] as usize).unwrap();
    let metres = vec![case.metres; picture.pixels.len()];
    let depth = DepthBuffer::new(&metres, picture.width, picture.height, DepthKind::Range).unwrap();
    let scene = Scene { depth: Some(depth), kernel: set, light, gain: 1.0 };
    workspace.draw(&shot, &scene, &mut picture).unwrap();
    let mask = workspace.mask().to_vec();
    (picture, mask)
}

#[test]
fn the_layer_of_streaks_is_the_processors_thin_broad_and_hidden_ones_alike() {
    /// What the layer may be off by, relative L2: half precision, and light of streaks that overlap.
    const LAYER_ERROR: f64 = 1e-2;
    let Some(gpu) = test_gpu() else { return };
    let (rain, world) = (Rain::new(&section(), 5), world());
    let light = world.in_scattering(&Phase::HenyeyGreenstein(0.77));
    let most = section().largest_rate().0;
    let every_kind = StreakSet::new(&crate::shade::streak::tests::every_kind());
    let plain = StreakSet::new(&StreakSection::default());
    let sets = [patterns(), every_kind, plain];
    let mut most_broad = 0;
    for set in &sets {
        for (streak_px, metres) in
            [([8.0, 100.0], 1e30), ([30.0, 600.0], 1e30), ([100.0, 9000.0], 1e30), ([8.0, 100.0], 3.0)]
        {
            let mut case = Case { streak_px, metres, ..Case::new(most) };
            if streak_px[0] > 99.0 {
                // A long lens brings near drops to where their width shows.
                let (eye, target) = (case.camera.position, case.camera.position + case.camera.forward);
                case.camera = Camera::look_at(eye, target, Degrees(4.0), SIZE).unwrap();
            }
            let (wanted, mask) = layer_by(&rain, &case, set, &light);
            let made = on_the_card(&gpu, &case, (&rain, set), &world);
            // As streaks_over.wgsl undoes it.
            let unit = 1.0 / (0.3 * world.mean_radiance().iter().sum::<f32>());
            let broad = made.streaks.iter().filter(|streak| streak.kind & 0xFFFF == 0).count();
            let (mut miss, mut whole, mut cover_miss, mut cover) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
            for ((found, wanted), mask) in made.layer.iter().zip(&wanted.pixels).zip(&mask) {
                let shown = 1.0 - libm::expf(-found[3] / 2048.0);
                for band in 0..3 {
                    let light =
                        if found[3] > 0.0 { found[band] / found[3] * 32.0 / unit * shown } else { 0.0 };
                    miss += f64::from((light - wanted[band]) * (light - wanted[band]));
                    whole += f64::from(wanted[band] * wanted[band]);
                }
                cover_miss += f64::from((shown - mask) * (shown - mask));
                cover += f64::from(mask * mask);
            }
            let (light, cover) = ((miss / whole).sqrt(), (cover_miss / cover).sqrt());
            println!(
                "{} patterns, {streak_px:?} px: {broad} broad, light {light:.1e}, cover {cover:.1e}",
                set.len()
            );
            assert!(light < LAYER_ERROR && cover < LAYER_ERROR);
            most_broad = most_broad.max(broad);
        }
    }
    assert!(most_broad >= 3, "{most_broad} streaks are resolved");
}
