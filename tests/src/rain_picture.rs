//! Rain in the picture judged from outside: streaks against the extinction of the same drops, depth, roofs,
//! bounds, and bytes that do not depend on threads.

use crate::assert_close;
use crate::rain::{T20, camera, level, place, rain, rate, tables};
use glam::DVec3;
use squall_bake::input::picture::Grey;
use squall_bake::streak::{FitSettings, Method, Source, fit_all};
use squall_formats::drops;
use squall_formats::section::streak::StreakSection;
use squall_formats::units::{Metres, Millimetres, Seconds};
use squall_runtime::depth::{DepthBuffer, DepthKind};
use squall_runtime::medium::Medium;
use squall_runtime::picture::Picture;
use squall_runtime::rain::{
    Ceiling, Clip, Footprint, Kernel, RainVolume, Region, Scene, Shelter, ShelterMap, Shot, SmoothWindow,
    Span, Surroundings, Weather, Workspace,
};
use squall_runtime::shade::streak::StreakSet;
use std::path::Path;

#[test]
fn threads_change_neither_the_list_nor_a_pixel() {
    let camera = camera(DVec3::Z * 2.0, DVec3::new(1.0, 0.3, 0.4), DVec3::Z, 70.0, [701, 397]);
    let weather = Weather::steady(rate(60.0), DVec3::X, Seconds(40.0));
    let shot = Shot { min_px: 12.0, ..Shot::new(&camera, T20) };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut workspace = Workspace::new();
            let mut picture = Picture::new(701, 397).unwrap();
            let light = Surroundings { above: [1.0; 3], below: [0.1; 3], ..Default::default() };
            let scene = Scene { depth: None, kernel: &SmoothWindow, light: &light, gain: 2.0 };
            let streaks = rain().find(&shot, &weather, None, &mut workspace).unwrap().to_vec();
            workspace.draw(&shot, &scene, &mut picture).unwrap();
            (streaks, workspace.mask().to_vec(), picture)
        })
    };
    let one = run(1);
    assert!(one.0.len() > 1000 && one.2.pixels.iter().any(|pixel| pixel[0] > 0.0));
    assert!(one == run(2) && one == run(8));
}

#[test]
fn a_second_frame_of_the_same_kind_takes_no_memory() {
    let camera = level(90.0);
    let shot = Shot::new(&camera, T20);
    let rain = rain();
    let mut workspace = Workspace::new();
    let mut picture = Picture::new(1920, 1080).unwrap();
    let light = Surroundings { above: [1.0; 3], ..Default::default() };
    let scene = Scene { depth: None, kernel: &SmoothWindow, light: &light, gain: 1.0 };
    let mut frame = |time: f64, workspace: &mut Workspace| {
        let weather = Weather::steady(rate(25.0), DVec3::X, Seconds(time));
        rain.find(&shot, &weather, None, workspace).unwrap();
        workspace.draw(&shot, &scene, &mut picture).unwrap();
        workspace.bytes()
    };
    let warm = (0..6).map(|i| frame(f64::from(i), &mut workspace)).max().unwrap();
    assert!((0..6).all(|i| frame(f64::from(i), &mut workspace) == warm));
}

#[test]
fn expected_coverage_is_the_extinction_of_the_drawn_shell() {
    const FRAMES: usize = 40;
    let rain = rain();
    let mut workspace = Workspace::new();
    let black = Surroundings::default();
    let scene = Scene { depth: None, kernel: &SmoothWindow, light: &black, gain: 1.0 };
    for fov in [60.0, 120.0] {
        let camera = camera(DVec3::Z, DVec3::X, DVec3::Z, fov, [640, 360]);
        let shot = Shot { min_px: 8.0, max_px: 60.0, ..Shot::new(&camera, T20) };
        let weather = |time| Weather::steady(rate(75.0), DVec3::ZERO, Seconds(time));
        let (mut left, mut pixels) = (0.0, 0.0);
        for frame in 0..FRAMES {
            rain.find(&shot, &weather(10.0 * frame as f64), None, &mut workspace).unwrap();
            let mut picture = Picture::new(640, 360).unwrap();
            workspace.draw(&shot, &scene, &mut picture).unwrap();
            left += workspace.mask().iter().map(|&alpha| 1.0 - f64::from(alpha)).sum::<f64>();
            pixels += workspace.mask().len() as f64;
        }
        let [all, rest] =
            [Medium::geometric(rate(75.0)), Medium::beside_streaks(tables(), &shot, rate(75.0)).unwrap()];
        let (mut wanted, mut secant_sum) = (0.0, 0.0);
        let secants = camera.secants();
        for y in 0..360 {
            for x in 0..640 {
                let secant = secants.at(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let depth = 1e3;
                let drawn = all.optical_depth(depth, secant) - rest.optical_depth(depth, secant);
                wanted += libm::exp(-drawn) / (640.0 * 360.0);
                secant_sum += secant / (640.0 * 360.0);
            }
        }
        let [found, wanted] = [left / pixels, wanted].map(|share| -libm::log(share));
        println!("fov {fov}: coverage {found:.6}, extinction {wanted:.6}, mean secant {secant_sum:.3}");
        // A million short streaks, whose areas scatter by a few times their mean: a few tenths of a percent.
        assert!((found / wanted - 1.0).abs() < 0.01, "{found} {wanted}");
        let printed = if fov == 60.0 { 1.20 } else { 2.17 };
        assert!((secant_sum - printed).abs() < 0.01);
    }
}

#[test]
fn the_medium_beside_streaks_leaves_out_exactly_the_drawn_drops() {
    let camera = level(60.0);
    let shot = Shot::new(&camera, T20);
    let view = shot.view().unwrap();
    for mm_h in [0.02, 2.0, 25.0, 75.0] {
        let rate = rate(mm_h);
        let [all, rest] = [Medium::geometric(rate), Medium::beside_streaks(tables(), &shot, rate).unwrap()];
        let found = all.optical_depth(500.0, 1.3) - rest.optical_depth(500.0, 1.3);
        // ∫ N π D²/4 (z(30 px) − z(200 px)) dD, 20 000 midpoints.
        let [from, to] = drops::DEFAULT_DIAMETERS.map(|d| d.0);
        let step = (to - from) / 20_000.0;
        let shell = |i: usize| {
            let diameter = Millimetres(from + (i as f64 + 0.5) * step);
            let length = drops::streak_length(diameter, drops::fall_speed(diameter), T20);
            let thickness = view.distance(length, 30.0).0 - view.distance(length, 200.0).0;
            let disc = std::f64::consts::FRAC_PI_4 * diameter.0 * diameter.0 * 1e-6;
            drops::number_density(diameter, rate) * disc * thickness * step
        };
        let wanted = 1.3 * (0..20_000).map(shell).sum::<f64>();
        // Below the table's first node the moments go on as a power of R: a fifth of it costs 3 %.
        let tolerance = if mm_h < 0.1 { 0.03 } else { 2e-5 };
        assert!((found / wanted - 1.0).abs() < tolerance, "R {mm_h}: {found} {wanted}");
        assert!(rest.optical_depth(0.3, 1.0) > 0.0);
    }
}

fn draw(depth: Option<DepthBuffer>, gain: f64) -> (Picture, f64) {
    let camera = camera(DVec3::Z, DVec3::X, DVec3::Z, 60.0, [320, 180]);
    let shot = Shot { min_px: 8.0, ..Shot::new(&camera, T20) };
    let weather = Weather::steady(rate(75.0), DVec3::ZERO, Seconds(1.0));
    let mut workspace = Workspace::new();
    rain().find(&shot, &weather, None, &mut workspace).unwrap();
    let mut picture = Picture::new(320, 180).unwrap();
    let light = Surroundings { above: [1.0; 3], below: [1.0; 3], behind: [1.0; 3], ..Default::default() };
    let scene = Scene { depth, kernel: &SmoothWindow, light: &light, gain };
    workspace.draw(&shot, &scene, &mut picture).unwrap();
    let sum = workspace.mask().iter().map(|&alpha| f64::from(alpha)).sum();
    (picture, sum)
}

#[test]
fn walls_hide_what_is_behind_them_and_holes_hide_nothing() {
    let open = draw(None, 1.0);
    for nothing in [f32::INFINITY, 0.0, f32::NAN, -3.0] {
        let metres = [nothing; 320 * 180];
        let buffer = DepthBuffer::new(&metres, 320, 180, DepthKind::Planar).unwrap();
        assert_eq!(draw(Some(buffer), 1.0).0, open.0);
    }
    let mut before = 0.0;
    for wall in [0.2f32, 0.6, 1.5, 4.0, 50.0] {
        let metres = [wall; 320 * 180];
        let planar = DepthBuffer::new(&metres, 320, 180, DepthKind::Planar).unwrap();
        let sum = draw(Some(planar), 1.0).1;
        assert!(sum >= before, "{wall} m");
        before = sum;
    }
    assert_eq!(before, open.1);
    let metres = [0.01f32; 320 * 180];
    let range = DepthBuffer::new(&metres, 320, 180, DepthKind::Range).unwrap();
    assert_eq!(draw(Some(range), 1.0).1, 0.0);
}

#[test]
fn gain_scales_coverage_and_zero_gain_changes_no_pixel() {
    let (picture, sum) = draw(None, 0.0);
    assert!(sum == 0.0 && picture.pixels.iter().all(|pixel| *pixel == [0.0; 3]));
    // Overlaps and the cut at 1 cost a little.
    let ratio = draw(None, 2.0).1 / draw(None, 1.0).1;
    assert!(ratio > 1.97 && ratio <= 2.0, "{ratio}");
    // Streaks of light 1 over black show their own coverage.
    let (picture, sum) = draw(None, 1.0);
    let light: f64 = picture.pixels.iter().map(|pixel| f64::from(pixel[1])).sum();
    assert!((light / sum - 1.0).abs() < 1e-5);
}

#[test]
fn it_does_not_rain_under_a_roof_nor_above_the_ceiling() {
    let camera = level(60.0);
    let shot = Shot::new(&camera, T20);
    let weather = Weather::steady(rate(25.0), DVec3::ZERO, Seconds(5.0));
    let rain = rain();
    let mut workspace = Workspace::new();
    let open = rain.find(&shot, &weather, None, &mut workspace).unwrap().to_vec();
    // A roof 3 m above ground over the half space y < −2, the camera's place.
    let size = [200, 200];
    let heights = (0..200 * 200).map(|i| if i / 200 < 98 { 3.0 } else { f32::NEG_INFINITY }).collect();
    let origin = DVec3::new(-100.0, -100.0, 0.0);
    let map = ShelterMap::new(origin, -DVec3::Z, Metres(1.0), size, heights).unwrap();
    let sheltered = rain.find(&shot, &weather, Some(&map), &mut workspace).unwrap().to_vec();
    let wanted: Vec<_> = open.iter().copied().filter(|s| map.reaches(place(&camera, s), -DVec3::Z)).collect();
    // Drops within rounding of the roof's edge may fall on either side.
    assert!(sheltered.len().abs_diff(wanted.len()) <= 1);
    assert!(sheltered.len() > open.len() / 3 && sheltered.len() < 2 * open.len() / 3);
    let none = |_: DVec3, _: DVec3| false;
    assert!(rain.find(&shot, &weather, Some(&none), &mut workspace).unwrap().is_empty());

    let ceiling = |height: f64, softness: f64| {
        let ceiling = Some(Ceiling { height: Metres(height), softness: Metres(softness) });
        Weather { volume: RainVolume { ceiling, region: None }, ..weather }
    };
    assert!(rain.find(&shot, &ceiling(-20.0, 1.0), None, &mut workspace).unwrap().is_empty());
    let below = rain.find(&shot, &ceiling(1.7, 0.0), None, &mut workspace).unwrap().to_vec();
    assert!(below.iter().all(|s| place(&camera, s).z < 1.7 + 1e-3));
    // The camera stands in the middle of a soft edge 40 m deep: near it, half of all drops fall.
    let half = rain.find(&shot, &ceiling(-18.3, 40.0), None, &mut workspace).unwrap().len();
    assert!((half as f64 / open.len() as f64 - 0.5).abs() < 0.05);
    let region = Some(Region { centre: [500.0, 0.0], radius: Metres(100.0), softness: Metres(50.0) });
    let elsewhere = Weather { volume: RainVolume { ceiling: None, region }, ..weather };
    assert!(rain.find(&shot, &elsewhere, None, &mut workspace).unwrap().is_empty());
}

/// A kernel of another kind: an even box over its bounds, worked out in a patch of memory of its own.
struct Patch;

impl Kernel for Patch {
    type Scratch = Vec<f32>;

    type Placed = Footprint;

    fn place(&self, footprint: &Footprint) -> Option<(Clip, Footprint)> {
        let half = [0, 1].map(|axis| 0.5 * footprint.length * footprint.axis[axis].abs() + 1.0);
        let edge = |axis: usize, side: f64| libm::floor(footprint.centre[axis] + side * half[axis]) as i32;
        let [left, top, right, bottom] = [edge(0, -1.0), edge(1, -1.0), edge(0, 1.0) + 1, edge(1, 1.0) + 1];
        Some((Clip { left, top, right, bottom }, *footprint))
    }

    fn draw(&self, footprint: &Footprint, clip: Clip, scratch: &mut Vec<f32>, put: &mut impl FnMut(Span)) {
        let Some((Clip { left, top, right, bottom }, _)) = self.place(footprint) else { return };
        let share = 1.0 / ((right - left) * (bottom - top)) as f32;
        let (x, end) = (left.max(clip.left), right.min(clip.right));
        if x >= end {
            return;
        }
        let count = (end - x) as usize;
        scratch.clear();
        scratch.resize(count.next_multiple_of(4), share);
        for y in top.max(clip.top)..bottom.min(clip.bottom) {
            put(Span { x, y, count, shares: scratch, covers: None });
        }
    }
}

/// Fitted patterns of three drawn pictures: two bright bands that cross, on a body with soft ends.
fn patterns() -> StreakSet {
    let picture = |index: usize| {
        let light = |i: usize| {
            let (u, v) = ((i % 16) as f64 / 15.0 - 0.5, (i / 16) as f64 / 79.0 - 0.5);
            let edge = |x: f64, half: f64| 0.5 * libm::erfc((x.abs() - half) * 25.0);
            let band = libm::exp(-libm::pow(12.0 * (u - (0.2 + 0.1 * index as f64) * v), 2.0));
            (edge(u, 0.25) * edge(v, 0.42) * (0.5 + 0.5 * band)) as f32
        };
        Grey { width: 16, height: 80, pixels: (0..16 * 80).map(light).collect() }
    };
    let pictures: Vec<Grey> = (0..3).map(picture).collect();
    let file = Path::new("band.png");
    let sources: Vec<Source> = pictures.iter().map(|picture| Source { file, picture, notes: None }).collect();
    let settings = FitSettings { method: Method::Super, cosines: 3 };
    StreakSet::new(&StreakSection { patterns: fit_all(&sources, settings).unwrap() })
}

#[test]
fn coverage_is_the_drops_whatever_the_kernel() {
    fn sum<K: Kernel>(kernel: &K, gain: f64) -> f64 {
        let camera = camera(DVec3::Z, DVec3::new(1.0, 0.0, 0.3), DVec3::Z, 50.0, [320, 180]);
        let shot = Shot { min_px: 8.0, ..Shot::new(&camera, T20) };
        let mut workspace = Workspace::new();
        let weather = Weather::steady(rate(50.0), DVec3::ZERO, Seconds(1.0));
        rain().find(&shot, &weather, None, &mut workspace).unwrap();
        let mut picture = Picture::new(320, 180).unwrap();
        let scene = Scene { depth: None, kernel, light: &Surroundings::default(), gain };
        workspace.draw(&shot, &scene, &mut picture).unwrap();
        workspace.mask().iter().map(|&alpha| f64::from(alpha)).sum()
    }
    // What the picture's border cuts off differs between kernels; a small gain keeps overlaps from counting.
    const BORDER: f64 = 0.01;
    let plain = sum(&SmoothWindow, 0.01);
    assert_close(sum(&Patch, 0.01), plain, BORDER, "boxes");
    assert_close(sum(&patterns(), 0.01), plain, BORDER, "patterns");
}

#[test]
fn threads_change_no_pixel_of_patterns() {
    let camera = camera(DVec3::Z * 2.0, DVec3::new(1.0, 0.3, 0.4), DVec3::Z, 70.0, [301, 197]);
    let shot = Shot { min_px: 8.0, ..Shot::new(&camera, T20) };
    let set = patterns();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut workspace = Workspace::new();
            let weather = Weather::steady(rate(60.0), DVec3::X, Seconds(40.0));
            rain().find(&shot, &weather, None, &mut workspace).unwrap();
            let mut picture = Picture::new(301, 197).unwrap();
            let light = Surroundings { above: [1.0; 3], below: [0.1; 3], ..Default::default() };
            let scene = Scene { depth: None, kernel: &set, light: &light, gain: 2.0 };
            workspace.draw(&shot, &scene, &mut picture).unwrap();
            picture
        })
    };
    let one = run(1);
    assert!(one.pixels.iter().any(|pixel| pixel[0] > 0.0));
    assert!(one == run(2) && one == run(8));
}
