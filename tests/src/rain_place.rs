//! Rain in its place: roofs that keep it off, a map that thins it, a sky that is seen through it.

use crate::rain::{T20, camera, level, place, rain, rate, tables};
use glam::{DVec2, DVec3};
use squall_formats::drops;
use squall_formats::section::density::Mode;
use squall_formats::units::{Metres, Millimetres, MillimetresPerHour, Seconds};
use squall_runtime::camera::Ray;
use squall_runtime::density::lookup_counts;
use squall_runtime::medium::{Medium, Outlook};
use squall_runtime::picture::Picture;
use squall_runtime::rain::{
    CoverMap, Covers, RainField, RainMap, RainPath, RainVolume, Shot, Streak, Weather, Workspace,
};
use squall_runtime::world::WorldLight;
use std::collections::HashSet;
use std::sync::Arc;

const WIND: DVec3 = DVec3::new(1.5, 4.0, 0.0);

fn weather(mm_h: f64, wind: DVec3) -> Weather {
    Weather::steady(rate(mm_h), wind, Seconds(30.0))
}

fn expected(shot: &Shot, rate: MillimetresPerHour) -> f64 {
    lookup_counts(tables(), Mode::Default, &shot.view().unwrap(), rate).unwrap().iter().sum()
}

/// A roof from 3 m to 3.2 m above the ground over x, y within `half` m of (x, y).
fn roof(x: f64, y: f64, half: f64) -> Arc<CoverMap> {
    let origin = DVec3::new(x - half, y - half, 0.0);
    let size = [(2.0 * half) as usize; 2];
    let count = size[0] * size[1];
    Arc::new(CoverMap::roofs(origin, Metres(1.0), size, vec![3.0; count], vec![3.2; count]).unwrap())
}

fn under(roof: Arc<CoverMap>, shot: &Shot, weather: &Weather) -> Vec<Streak> {
    let covers = Covers { first: None, maps: &[roof] };
    rain().find(shot, weather, Some(&covers), &mut Workspace::new()).unwrap().to_vec()
}

#[test]
fn below_a_roof_there_is_no_streak_and_beside_it_as_many_as_the_table_says() {
    /// Standard deviations of a Poisson number.
    const SCATTER: f64 = 4.5;
    let looking_down =
        camera(DVec3::new(3.0, -2.0, 1.7), DVec3::new(1.0, 0.0, -0.9), DVec3::Z, 40.0, [1920, 1080]);
    let short = Shot { min_px: 60.0, ..Shot::new(&looking_down, T20) };
    let weather = weather(25.0, WIND);
    let open = rain().find(&short, &weather, None, &mut Workspace::new()).unwrap().to_vec();
    let inside = |streaks: &[Streak]| streaks.iter().filter(|streak| streak.inside).count() as f64;
    let wanted = expected(&short, weather.rate);
    assert!(wanted > 300.0 && (inside(&open) - wanted).abs() < SCATTER * wanted.sqrt());
    // Everything that this camera sees lies under a roof 100 m wide, and none of it under one 200 m off.
    assert!(under(roof(3.0, -2.0, 50.0), &short, &weather).is_empty());
    let beside = under(roof(203.0, -2.0, 50.0), &short, &weather);
    assert!(beside == open, "{} of {}", beside.len(), open.len());
}

#[test]
fn each_drop_comes_in_under_the_edge_as_its_own_speed_and_the_wind_say() {
    /// Drops this near to the edge's shadow, m, may fall on either side: places are kept in single precision.
    const EDGE_M: f64 = 1e-3;
    let camera = level(60.0);
    let shot = Shot::new(&camera, T20);
    let weather = weather(25.0, WIND);
    let open = rain().find(&shot, &weather, None, &mut Workspace::new()).unwrap().to_vec();
    // The roof covers y < −2, the camera's own place, 400 m around.
    let covered = roof(3.0, -202.0, 200.0);
    let found: HashSet<u64> = under(covered, &shot, &weather).iter().map(|streak| streak.id).collect();
    let (mut dry, mut by_wind) = (0, 0);
    for streak in &open {
        let point = place(&camera, streak);
        let speed = drops::fall_speed(Millimetres(f64::from(streak.diameter))).0;
        // Where its way back passes the roof's underside and its top.
        let [low, high] = [3.0, 3.2].map(|height| point.y - WIND.y / speed * (height - point.z).max(0.0));
        if (low + 2.0).abs().min((high + 2.0).abs()) < EDGE_M || point.z > 3.0 {
            continue;
        }
        let kept = low.min(high) > -2.0;
        assert_eq!(found.contains(&streak.id), kept, "{point} at {speed} m/s");
        dry += usize::from(!kept);
        by_wind += usize::from(kept != (point.y > -2.0));
    }
    assert!(dry > 1000 && by_wind > 20, "{dry} {by_wind}");
}

#[test]
fn a_map_thins_the_same_drops_to_the_table_of_the_rate_that_is_there() {
    const SCATTER: f64 = 4.5;
    let camera = level(90.0);
    let shot = Shot::new(&camera, T20);
    let weather = weather(50.0, WIND);
    // Everywhere the fifth of the heaviest rain, which is far away.
    let mut rates = vec![10.0f32; 400];
    rates[0] = 50.0;
    let map = RainMap::new(DVec2::splat(-20_000.0), Metres(2000.0), [20, 20], &rates, None).unwrap();
    let field = RainField::default().with_map(&map, weather.drift, camera.position);
    assert!((field.rate(weather.rate).0 - 10.0).abs() < 1e-3);
    let mut workspace = Workspace::new();
    let all = rain().find(&shot, &weather, None, &mut workspace).unwrap().to_vec();
    let thinned = rain().find_in(&shot, &weather, &field, None, &mut workspace).unwrap().to_vec();
    let even = rain().find(&shot, &Weather { rate: rate(10.0), ..weather }, None, &mut workspace).unwrap();
    // The very drops that fall in even rain of 10 mm/h, but for what single precision rounds.
    let names = |streaks: &[Streak]| streaks.iter().map(|streak| streak.id).collect::<HashSet<u64>>();
    let (all, even, thin) = (names(&all), names(even), names(&thinned));
    assert!(thin.is_subset(&all) && thin.symmetric_difference(&even).count() <= 2);
    let count = thinned.iter().filter(|streak| streak.inside).count() as f64;
    let wanted = expected(&shot, rate(10.0));
    assert!((count - wanted).abs() < SCATTER * wanted.sqrt(), "{count} for {wanted}");
}

#[test]
fn a_drop_of_a_map_that_the_wind_carries_belongs_to_the_rain_all_its_life() {
    let camera = level(90.0);
    let shot = Shot::new(&camera, T20);
    // Cells of 2 m, so that drops in sight stand in light and heavy rain, and the wind carries borders past the camera.
    let rates: Vec<f32> = (0..10_000).map(|i| ((i * 7919) % 50) as f32).collect();
    let origin = DVec2::new(-100.0, -100.0) - (WIND * 30.0).truncate();
    let map = RainMap::new(origin, Metres(2.0), [100, 100], &rates, None).unwrap();
    let seen = |time: f64, mapped: bool| -> HashSet<u64> {
        let weather = Weather::steady(rate(50.0), WIND, Seconds(time));
        let even = RainField::default();
        let field = if mapped { even.with_map(&map, weather.drift, camera.position) } else { even };
        let mut workspace = Workspace::new();
        let found = rain().find_in(&shot, &weather, &field, None, &mut workspace).unwrap();
        found.iter().map(|streak| streak.id).collect()
    };
    let (before, after) = (seen(30.0, true), seen(30.03, true));
    let (all_before, all_after) = (seen(30.0, false), seen(30.03, false));
    let in_both: HashSet<u64> = all_before.intersection(&all_after).copied().collect();
    assert!(before.len() > 1000 && before.len() < all_before.len() * 9 / 10 && in_both.len() > before.len());
    for id in &in_both {
        assert_eq!(before.contains(id), after.contains(id));
    }
}

#[test]
fn the_mediums_optical_depth_is_the_integral_of_the_extinction_of_the_rate_along_the_ray() {
    /// The midpoint rule over 20 000 places, bilinear between cells.
    const SUM: f64 = 1e-4;
    let rates: Vec<f32> = (0..64).map(|i| ((i * 37) % 64) as f32).collect();
    let map = RainMap::new(DVec2::ZERO, Metres(500.0), [8, 8], &rates, None).unwrap();
    for (eye, direction) in [
        (DVec3::new(-3000.0, 900.0, 20.0), DVec3::new(1.0, 0.3, 0.0)),
        (DVec3::new(2100.0, 1700.0, 2.0), DVec3::new(-0.3, 1.0, 0.1)),
    ] {
        let direction = direction.normalize();
        let field = RainField::default().with_map(&map, DVec3::ZERO, eye);
        let medium = Medium::geometric(field.rate(map.heaviest()));
        let found = medium.optical_depth_in(&field, &Ray { origin: eye, direction }, 8000.0, 1.0);
        let step = 8000.0 / 20_000.0;
        let at = |i: i32| (eye + direction * ((f64::from(i) + 0.5) * step)).truncate();
        let extinction = |i| Medium::geometric(map.rate_at(at(i))).extinction().0;
        let wanted: f64 = (0..20_000).map(extinction).sum::<f64>() * step;
        assert!(wanted > 0.5 && (found / wanted - 1.0).abs() < SUM, "{found} {wanted}");
    }
}

#[test]
fn a_sphere_of_the_sky_leaves_its_gradients_and_rain_without_end_does_not() {
    let camera = camera(DVec3::Z * 2.0, DVec3::new(1.0, 0.0, 0.4), DVec3::Z, 60.0, [40, 90]);
    let medium = Medium::whole(rate(25.0));
    let seen = |field: RainField| -> Vec<f32> {
        let mut picture = Picture::new(40, 90).unwrap();
        for (i, pixel) in picture.pixels.iter_mut().enumerate() {
            *pixel = [1.0 + (i / 40) as f32 * 0.05; 3];
        }
        let light = medium.in_scattering(&WorldLight::uniform([0.7; 3]));
        let outlook = Outlook { camera: &camera, volume: field, light: &light, depth: None };
        medium.apply(&outlook, &mut picture, &mut vec![0.0; 3600]).unwrap();
        (0..90).map(|row| picture.pixels[row * 40 + 20][0]).collect()
    };
    let distinct = |column: &[f32]| column.iter().map(|light| light.to_bits()).collect::<HashSet<_>>().len();
    let endless = seen(RainVolume::default().into());
    assert_eq!(distinct(&endless), 1);
    let sphere = seen(RainField::default().with_farthest(Some(Metres(1500.0))));
    assert!(distinct(&sphere) > 80 && sphere.windows(2).all(|pair| pair[0] < pair[1]));
    // The sphere is one distance for every pixel: Beer and Lambert's factor is the same all over the sky.
    let factor = libm::exp(-medium.extinction().0 * 1500.0);
    let wanted = 1.0 * factor + 0.7 * (1.0 - factor);
    assert!((f64::from(sphere[0]) - wanted).abs() < 1e-5);
    let field = RainField::default().with_farthest(Some(Metres(1500.0)));
    assert!(field.fills(DVec3::ZERO, 1500.0) && !field.fills(DVec3::ZERO, 1501.0) && !field.is_everywhere());
}

#[test]
fn a_frames_cover_keeps_its_streaks_off_and_one_elsewhere_does_not() {
    let golden = crate::root().join("data/golden/v1/golden.squall");
    let mut renderer = squall_runtime::StormRenderer::open(golden).unwrap();
    let frame = renderer.frame().unwrap().rain(rate(20.0)).dark();
    let eye = frame.camera.position;
    let mut streaks = |frame: &squall_runtime::Frame| {
        renderer.render(frame).unwrap();
        renderer.report().streaks
    };
    let lid = |x: f64, y: f64, z: f64| {
        let origin = DVec3::new(x - 200.0, y - 200.0, z);
        CoverMap::roofs(origin, Metres(100.0), [4, 4], vec![0.0; 16], vec![1.0; 16]).unwrap()
    };
    let mut open = frame.clone();
    open.place.town_covers = false;
    let all = streaks(&open);
    assert!(all > 20, "{all}");
    assert_eq!(streaks(&open.clone().cover(lid(eye.x, eye.y, eye.z + 150.0))), 0);
    assert_eq!(streaks(&open.clone().cover(lid(eye.x + 5000.0, eye.y, eye.z + 150.0))), all);
    // The town takes no more than there are, and its own roofs alone.
    assert!(streaks(&frame) <= all);
}

#[test]
fn a_picture_that_says_what_it_shows_becomes_a_pattern_that_says_it_and_others_stay_silent() {
    use squall_bake::pipeline::bake;
    use squall_bake::progress::Quiet;
    use squall_bake::recipe::Recipe;
    use squall_bake::synth::streak::scene::Scene;
    use squall_bake::synth::streak::{fall_of, scene_streak, write_streaks};
    use squall_formats::section::streak::StreakSection;
    let folder = tempfile::tempdir().unwrap();
    // The shortest of a few, which is soon traced.
    let fall = |seed: u64| fall_of(Scene::Backlit, seed, 0);
    let seed = (0..40).min_by(|a, b| fall(*a).total_cmp(&fall(*b))).unwrap();
    let files = write_streaks(folder.path(), Scene::Backlit, seed, 1, &Quiet).unwrap();
    let name = files[0].file_name().unwrap().to_str().unwrap();
    assert_eq!(name, "backlit00.png");
    let silent = crate::root().join("data/golden/v1/streak0.png");
    std::fs::copy(silent, folder.path().join("silent.png")).unwrap();
    let sections = |pictures: &str| {
        let file = folder.path().join("recipe.toml");
        let text = format!("[rain.streaks]\npictures = [{pictures}]\nmethod = \"separable\"\n");
        std::fs::write(&file, text).unwrap();
        let baked = bake(&Recipe::read(&file).unwrap(), &Quiet).unwrap();
        baked.sections.into_iter().find(|section| section.tag == StreakSection::TAG).unwrap()
    };
    let silent = sections("\"silent.png\"");
    assert_eq!(silent.version, 1);
    let both = sections(&format!("\"{name}\", \"silent.png\""));
    assert_eq!(both.version, 2);
    let read = StreakSection::read(&both.to_bytes(), 2, &Default::default()).unwrap();
    assert!(read.patterns[1].scene.is_none() && read.patterns[1].notes.is_none());
    let made = scene_streak(Scene::Backlit, seed, 0);
    let (notes, scene) = (read.patterns[0].notes.unwrap(), read.patterns[0].scene.unwrap());
    assert!((notes.diameter_mm - made.drop.diameter_mm()).abs() < 1e-3);
    assert!(
        scene.light_azimuth_deg.abs() <= 25.0
            && scene.light_share > 0.3
            && scene.view_elevation_deg.abs() <= 12.0
    );
    // A chunk that lies is refused with the file.
    let png = std::fs::read(&files[0]).unwrap();
    let at = png.windows(13).position(|window| window == b"light_share\":").unwrap() + 13;
    let mut broken = png.clone();
    broken[at] = b'7';
    std::fs::write(folder.path().join("broken.png"), mended(broken)).unwrap();
    let file = folder.path().join("recipe.toml");
    std::fs::write(&file, "[rain.streaks]\npictures = [\"broken.png\"]\nmethod = \"separable\"\n").unwrap();
    let error = bake(&Recipe::read(&file).unwrap(), &Quiet).err().unwrap().to_string();
    assert!(error.contains("broken.png") && error.contains("light_share from 0 to 1"), "{error}");
}

/// A PNG whose chunks have their checksums again.
fn mended(mut png: Vec<u8>) -> Vec<u8> {
    let mut at = 8;
    while at + 12 <= png.len() {
        let length = u32::from_be_bytes(png[at..at + 4].try_into().unwrap()) as usize;
        let end = at + 8 + length;
        let mut crc = u32::MAX;
        for &byte in &png[at + 4..end] {
            crc ^= u32::from(byte);
            for _ in 0..8 {
                crc = if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 };
            }
        }
        png[end..end + 4].copy_from_slice(&(!crc).to_be_bytes());
        at = end + 4;
    }
    png
}
