//! Rain judged from outside: density tables against quadrature, drops in the world against the tables,
//! streaks against the extinction of the same drops.

use glam::{DVec2, DVec3};
use proptest::prelude::*;
use squall_bake::density::{DensitySpec, solve_counts};
use squall_bake::plan::density::bake_density;
use squall_formats::drops::{self, View};
use squall_formats::section::density::{DensitySection, Mode};
use squall_formats::units::{Degrees, MillimetresPerHour, Radians, Seconds};
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::density::{lookup_counts, read_density};
use squall_runtime::rain::{Rain, Shot, Streak, Weather, Workspace};
use squall_runtime::random::Random;
use squall_runtime::{Asset, RuntimeError};
use std::collections::HashMap;
use std::sync::OnceLock;

pub(crate) fn tables() -> &'static DensitySection {
    static TABLES: OnceLock<DensitySection> = OnceLock::new();
    TABLES.get_or_init(|| bake_density(&DensitySpec::default()).unwrap())
}

pub(crate) fn rain() -> Rain {
    Rain::new(tables(), 7)
}

pub(crate) fn camera(position: DVec3, direction: DVec3, up: DVec3, fov_deg: f64, size: [u32; 2]) -> Camera {
    let projection = Projection::Perspective { vertical_fov: Degrees(fov_deg).into() };
    Camera::new(position, direction, up, projection, size).unwrap()
}

pub(crate) fn level(fov_deg: f64) -> Camera {
    camera(DVec3::new(3.0, -2.0, 1.7), DVec3::X, DVec3::Z, fov_deg, [1920, 1080])
}

pub(crate) const T20: Seconds = Seconds(0.02);

pub(crate) fn rate(value: f64) -> MillimetresPerHour {
    MillimetresPerHour(value)
}

pub(crate) fn find(shot: &Shot, weather: &Weather) -> Vec<Streak> {
    rain().find(shot, weather, None, &mut Workspace::new()).unwrap().to_vec()
}

fn expected(shot: &Shot, weather: &Weather) -> f64 {
    lookup_counts(tables(), Mode::Default, &shot.view().unwrap(), weather.rate).unwrap().iter().sum()
}

fn inside(streaks: &[Streak]) -> usize {
    streaks.iter().filter(|streak| streak.inside).count()
}

proptest! {
    /// Half a percent would do; the tables promise 1e-5 of every class. Doubled, since probes
    /// between nodes do not hit the worst place exactly.
    #[test]
    fn lookup_is_within_the_promised_error_of_quadrature_everywhere(
        log_rate in -2.302f64..5.298, fov in 20.0f64..140.0, exposure_ms in 1.0f64..33.0,
        a in 10.0f64..200.0, b in 10.0f64..200.0, height in 100.0f64..5000.0, aspect in 0.3f64..4.0,
    ) {
        prop_assume!((a - b).abs() > 0.1);
        let view = View {
            vertical_fov: Degrees(fov).into(), height_px: height, aspect,
            exposure: Seconds(exposure_ms / 1e3), min_px: a.min(b), max_px: a.max(b),
        };
        let rate = MillimetresPerHour(libm::exp(log_rate).clamp(0.1, 200.0));
        for mode in Mode::ALL {
            let classes: Vec<_> = tables().table(mode).classes.iter().map(|class| class.diameter).collect();
            let exact = solve_counts(mode, &classes, &view, rate).unwrap();
            let found = lookup_counts(tables(), mode, &view, rate).unwrap();
            for (found, exact) in found.iter().zip(exact) {
                prop_assert!((found / exact - 1.0).abs() < 2.0 * tables().asked_error, "{mode:?} {found} {exact}");
            }
        }
    }
}

#[test]
fn damaged_tables_are_refused_and_the_rest_of_the_asset_still_opens() {
    let mut bytes = Vec::new();
    squall_formats::container::write(&mut bytes, &[tables().to_section()]).unwrap();
    assert_eq!(&read_density(&Asset::from_bytes(&bytes).unwrap()).unwrap(), tables());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rain.squall");
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    assert!(Asset::open(&path).is_err());
    let asset = Asset::open_directory(&path).unwrap();
    assert!(matches!(read_density(&asset), Err(RuntimeError::Asset { .. })));
}

/// A pose of the statistics: anywhere, looking anywhere but straight up or down, any wind, any hour.
fn random_pose(random: &mut Random, fov_deg: f64) -> (Camera, Weather, DVec3) {
    let position =
        DVec3::new(random.range(-500.0, 500.0), random.range(-500.0, 500.0), random.range(0.0, 80.0));
    let camera = camera(position, random.direction(), random.direction(), fov_deg, [1920, 1080]);
    let wind = DVec3::new(random.range(-10.0, 10.0), random.range(-10.0, 10.0), random.range(-1.0, 1.0));
    let weather = Weather::steady(rate(1.0), wind, Seconds(random.range(0.0, 3600.0)));
    let right = camera.right;
    (camera, weather, right)
}

#[test]
fn four_hundred_poses_see_as_many_drops_as_the_tables_say() {
    const POSES: usize = 400;
    let rain = rain();
    let mut workspace = Workspace::new();
    for (mm_h, fov, wanted) in
        [(2.0, 120.0, 1012.4), (25.0, 120.0, 6690.0), (75.0, 120.0, 13801.6), (75.0, 60.0, 41404.9)]
    {
        let mut random = Random::new(hash(mm_h, fov));
        let (mut sum, mut squares) = (0.0, 0.0);
        let (mut kept, mut kept_aside, mut seen) = (0, 0, 0);
        for pose in 0..POSES {
            let (camera, mut weather, right) = random_pose(&mut random, fov);
            weather.rate = rate(mm_h);
            let shot = Shot::new(&camera, T20);
            let streaks = rain.find(&shot, &weather, None, &mut workspace).unwrap();
            let count = inside(streaks) as f64;
            sum += count;
            squares += (count - wanted) * (count - wanted);
            if pose % 20 == 0 {
                let names: std::collections::HashSet<u64> =
                    streaks.iter().filter(|s| s.inside).map(|s| s.id).collect();
                assert_eq!(names.len() as f64, count, "names are unique");
                seen += names.len();
                let mut later = weather;
                later.time.0 += 1.0 / 60.0;
                later.drift += later.wind / 60.0;
                let again =
                    |streaks: &[Streak]| streaks.iter().filter(|s| s.inside && names.contains(&s.id)).count();
                kept += again(rain.find(&shot, &later, None, &mut workspace).unwrap());
                let mut aside = camera.clone();
                aside.position += right * 0.05;
                kept_aside +=
                    again(rain.find(&Shot::new(&aside, T20), &weather, None, &mut workspace).unwrap());
            }
        }
        let mean = sum / POSES as f64;
        // The mean of 400 Poisson numbers scatters by √(wanted/400)/wanted, 0.16 % at the smallest count.
        let scatter = (wanted / POSES as f64).sqrt() / wanted;
        let (ratio, dispersion) = (mean / wanted, squares / POSES as f64 / wanted);
        println!(
            "R {mm_h} fov {fov}: expected {wanted}, mean {mean:.1} ({:+.3} %, 1σ {:.3} %), variance/mean {dispersion:.3}, \
             kept after 1/60 s {:.1} %, after 5 cm aside {:.1} %",
            100.0 * (ratio - 1.0),
            100.0 * scatter,
            100.0 * kept as f64 / seen as f64,
            100.0 * kept_aside as f64 / seen as f64,
        );
        assert!((ratio - 1.0).abs() < 0.003_f64.max(3.0 * scatter), "{ratio}");
        assert!((0.8..1.2).contains(&dispersion), "{dispersion}");
        assert!(kept as f64 > 0.75 * seen as f64 && kept_aside as f64 > 0.95 * seen as f64);
    }
}

fn hash(a: f64, b: f64) -> u64 {
    squall_runtime::random::hash(&[a.to_bits(), b.to_bits()])
}

#[test]
fn more_rain_adds_drops_and_removes_or_moves_none() {
    let camera = level(60.0);
    let shot = Shot::new(&camera, T20);
    let mut fewer: Option<HashMap<u64, Streak>> = None;
    for mm_h in [0.01, 0.1, 2.0, 25.0, 200.0] {
        let weather = Weather::steady(rate(mm_h), DVec3::new(1.0, 2.0, 0.0), Seconds(500.0));
        let now: HashMap<u64, Streak> = find(&shot, &weather).into_iter().map(|s| (s.id, s)).collect();
        for (id, streak) in fewer.iter().flatten() {
            assert_eq!(now.get(id), Some(streak), "R {mm_h}");
        }
        fewer = Some(now);
    }
}

/// World position of a streak's drop, from what the list says of it.
pub(crate) fn place(camera: &Camera, streak: &Streak) -> DVec3 {
    let [a, b] = streak.ends.map(|end| DVec2::new(f64::from(end[0]), f64::from(end[1])));
    let [da, db] = streak.end_depths.map(f64::from);
    let at = |pixel: DVec2, depth: f64| {
        let ray = camera.ray(pixel.x, pixel.y);
        ray.origin + ray.direction * (depth / ray.direction.dot(camera.forward))
    };
    (at(a, da) + at(b, db)) * 0.5
}

/// Pixels and depths are kept in single precision: a ten-thousandth of a pixel at a few metres.
const PLACE_ERROR: f64 = 2e-6;

#[test]
fn zoom_exposure_and_a_second_camera_see_the_same_drops_in_the_same_places() {
    let left = level(60.0);
    let mut right = left.clone();
    right.position += left.right * 0.065;
    let zoomed = level(40.0);
    let weather = Weather::steady(rate(25.0), DVec3::new(-2.0, 1.0, 0.0), Seconds(123.0));
    let shot = Shot::new(&left, T20);
    let base: HashMap<u64, DVec3> = find(&shot, &weather).iter().map(|s| (s.id, place(&left, s))).collect();
    for (name, other, least) in [
        ("stereo", Shot::new(&right, T20), 0.9),
        ("zoom", Shot::new(&zoomed, T20), 0.2),
        ("shutter", Shot::new(&left, Seconds(0.015)), 0.3),
        ("lengths", Shot { min_px: 20.0, ..shot }, 0.99),
    ] {
        let seen = find(&other, &weather);
        let mut shared = 0;
        for streak in &seen {
            if let Some(wanted) = base.get(&streak.id) {
                let error = (place(other.camera, streak) - *wanted).length();
                assert!(error < PLACE_ERROR, "{name}: {error} m");
                shared += 1;
            }
        }
        assert!(shared as f64 > least * base.len() as f64, "{name}: {shared} of {}", base.len());
    }
}

#[test]
fn after_a_day_drops_still_move_by_their_speed_and_nothing_else() {
    let camera = level(60.0);
    let shot = Shot::new(&camera, T20);
    let wind = DVec3::new(3.0, -4.0, 0.5);
    let speeds: Vec<f64> = tables().table(Mode::Default).classes.iter().map(|c| c.fall_speed.0).collect();
    for hours in [0.0, 24.0, 24.0 * 365.0] {
        let start = Seconds(3600.0 * hours);
        let step = 1.0 / 128.0;
        let at = |time: f64| find(&shot, &Weather::steady(rate(25.0), wind, Seconds(time)));
        let first: HashMap<u64, DVec3> = at(start.0).iter().map(|s| (s.id, place(&camera, s))).collect();
        let mut followed = 0;
        for streak in at(start.0 + step) {
            let Some(before) = first.get(&streak.id) else { continue };
            let moved = place(&camera, &streak) - *before;
            let wanted = (wind - DVec3::Z * speeds[streak.class as usize]) * step;
            // A year of fall is 3e8 m, of which a double keeps 3e-8 m.
            assert!((moved - wanted).length() < 2.0 * PLACE_ERROR, "{hours} h: {moved} for {wanted}");
            followed += 1;
        }
        assert!(followed > 2000, "{hours} h: {followed}");
    }
}

#[test]
fn no_rain_has_no_streaks_and_nonsense_is_refused_by_name() {
    let camera = level(60.0);
    let shot = Shot::new(&camera, T20);
    let calm = Weather::steady(rate(2.0), DVec3::ZERO, Seconds(0.0));
    assert!(find(&shot, &Weather { rate: rate(0.0), ..calm }).is_empty());
    let parallel = Camera {
        projection: Projection::Orthographic { half_width: 1.0, half_height: 1.0 },
        ..camera.clone()
    };
    let nan = DVec3::new(f64::NAN, 0.0, 0.0);
    let mut workspace = Workspace::new();
    for (field, shot, weather) in [
        ("rate", shot, Weather { rate: rate(-1.0), ..calm }),
        ("rate", shot, Weather { rate: rate(f64::NAN), ..calm }),
        ("rate", shot, Weather { rate: rate(201.0), ..calm }),
        ("wind", shot, Weather { wind: nan, ..calm }),
        ("wind", shot, Weather { wind: DVec3::X * 2e4, ..calm }),
        ("drift", shot, Weather { drift: nan, ..calm }),
        ("time, drift and camera position", shot, Weather { drift: DVec3::X * 1e300, ..calm }),
        ("time", shot, Weather { time: Seconds(f64::INFINITY), ..calm }),
        ("time, drift and camera position", shot, Weather { time: Seconds(1e30), ..calm }),
        ("camera velocity", Shot { velocity: nan, ..shot }, calm),
        ("exposure-ms", Shot { exposure: Seconds(0.0), ..shot }, calm),
        ("min-px", Shot { min_px: 300.0, ..shot }, calm),
        ("rain camera", Shot { camera: &parallel, ..shot }, calm),
        ("rain", Shot { min_px: 0.01, ..shot }, calm),
        ("rain", Shot { exposure: Seconds(1e6), ..shot }, calm),
    ] {
        match rain().find(&shot, &weather, None, &mut workspace) {
            Err(RuntimeError::Argument { field: found, .. }) => assert_eq!(found, field),
            other => panic!("{field}: {:?}", other.map(<[Streak]>::len)),
        }
    }
}

#[test]
fn any_lens_from_a_telescope_to_a_half_sphere_sees_its_expected_drops() {
    for (fov, mm_h) in [(1.0, 0.5), (20.0, 25.0), (150.0, 25.0), (179.0, 200.0)] {
        let directions = [DVec3::X, DVec3::Z, -DVec3::Z, DVec3::new(1.0, 2.0, -3.0)];
        for (i, direction) in directions.into_iter().enumerate() {
            let up = if direction.x == 0.0 { DVec3::Y } else { DVec3::Z };
            let camera = camera(DVec3::new(0.0, 0.0, 50.0), direction, up, fov, [1920, 1080]);
            let shot = Shot::new(&camera, T20);
            let weather = Weather::steady(rate(mm_h), DVec3::X, Seconds(60.0 * i as f64));
            let streaks = find(&shot, &weather);
            let edges = [drops::DEFAULT_DIAMETERS];
            let wanted = solve_counts(Mode::Default, &edges, &shot.view().unwrap(), weather.rate).unwrap()[0];
            let count = inside(&streaks) as f64;
            assert!((count - wanted).abs() < 5.0 * wanted.sqrt() + 1.0, "fov {fov}: {count} of {wanted}");
            for streak in &streaks {
                assert!(streak.ends.iter().flatten().all(|v| v.is_finite()) && streak.end_depths[0] > 0.0);
                assert!(streak.coverage > 0.0 && streak.coverage.is_finite() && streak.end_depths[1] > 0.0);
            }
        }
    }
}

#[test]
fn a_camera_faster_than_rain_sees_longer_streaks_of_the_same_drops() {
    let camera = level(60.0);
    let at_rest = Shot::new(&camera, T20);
    let weather = Weather::steady(rate(25.0), DVec3::ZERO, Seconds(9.0));
    let slow: HashMap<u64, Streak> = find(&at_rest, &weather).into_iter().map(|s| (s.id, s)).collect();
    for velocity in [camera.right * 40.0, camera.forward * 40.0, camera.forward * -300.0, DVec3::Z * -6.0] {
        let fast = find(&Shot { velocity, ..at_rest }, &weather);
        // The drops are the same; only streaks that reach in from outside come and go.
        let same: Vec<_> = fast.iter().filter(|s| s.inside).collect();
        assert_eq!(same.len(), slow.values().filter(|s| s.inside).count());
        for streak in same {
            assert_eq!(streak.depth, slow[&streak.id].depth);
            assert!(streak.ends.iter().flatten().all(|v| v.is_finite()));
        }
    }
    let length =
        |streaks: &[Streak]| streaks.iter().map(|s| s.footprint().length).sum::<f64>() / streaks.len() as f64;
    let sideways = find(&Shot { velocity: camera.right * 40.0, ..at_rest }, &weather);
    let still: Vec<Streak> = slow.into_values().collect();
    assert!(length(&sideways) > 4.0 * length(&still));
}

#[test]
fn counts_follow_the_tables_class_by_class() {
    let camera = level(60.0);
    let shot = Shot { min_px: 15.0, ..Shot::new(&camera, T20) };
    let mut found = vec![0.0; tables().table(Mode::Default).classes.len()];
    let frames = 30;
    for frame in 0..frames {
        let weather = Weather::steady(rate(25.0), DVec3::X, Seconds(17.0 * f64::from(frame)));
        for streak in find(&shot, &weather) {
            found[streak.class as usize] += if streak.inside { 1.0 } else { 0.0 };
        }
    }
    let weather = Weather::steady(rate(25.0), DVec3::X, Seconds(0.0));
    let wanted = lookup_counts(tables(), Mode::Default, &shot.view().unwrap(), weather.rate).unwrap();
    for (found, wanted) in found.iter().zip(wanted) {
        let wanted = wanted * f64::from(frames);
        assert!((found - wanted).abs() < 5.0 * wanted.sqrt() + 1.0, "{found} {wanted}");
    }
    let total = expected(&shot, &weather) * f64::from(frames);
    assert!((found.iter().sum::<f64>() / total - 1.0).abs() < 0.005);
    assert!(Radians::from(Degrees(60.0)) == shot.view().unwrap().vertical_fov);
}
