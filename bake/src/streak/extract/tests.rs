use super::*;
use crate::input::picture::read_grey;
use crate::streak::quality::psnr_db;
use std::path::Path;

const WIDTH: usize = 300;
const HEIGHT: usize = 360;

fn known() -> Vec<Grey> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/storm/streaks");
    ["drop00.png", "drop04.png", "drop10.png"].map(|name| read_grey(&folder.join(name)).unwrap()).to_vec()
}

/// Hashed noise of deviation 1, or so.
fn noise(at: usize) -> f32 {
    let mut sum = 0.0;
    for k in 0..4u64 {
        let mut bits =
            (at as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ k.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits ^= bits >> 31;
        bits = bits.wrapping_mul(0x94d0_49bb_1331_11eb);
        sum += ((bits >> 40) as f32 / 16_777_216.0 - 0.5) * 1.73;
    }
    sum
}

/// A frame of a textured scene in which one known streak falls: where, at what angle, how long its picture is.
fn frame(number: usize, picture: &Grey, place: [f64; 2], angle: f64, length: f64, grain: f32) -> Grey {
    let (sin, cos) = libm::sincos(angle.to_radians());
    let scale = length / picture.height as f64;
    let value = |at: usize| {
        let (x, y) = (at % WIDTH, at / WIDTH);
        let scene = 0.2 + 0.1 * ((x / 16 + y / 16) % 2) as f32 + 0.001 * x as f32;
        let mut sum = 0.0;
        for i in 0..9 {
            let (dx, dy) = (
                x as f64 + (f64::from(i % 3) + 0.5) / 3.0 - place[0],
                y as f64 + (f64::from(i / 3) + 0.5) / 3.0 - place[1],
            );
            let (across, along) = (dx * cos - dy * sin, dx * sin + dy * cos);
            let u = across / scale + 0.5 * picture.width as f64 - 0.5;
            let v = along / scale + 0.5 * picture.height as f64 - 0.5;
            let at = |du: isize, dv: isize| {
                let (u, v) = (u.floor() as isize + du, v.floor() as isize + dv);
                let inside =
                    u >= 0 && v >= 0 && (u as usize) < picture.width && (v as usize) < picture.height;
                if inside { f64::from(picture.pixels[v as usize * picture.width + u as usize]) } else { 0.0 }
            };
            let (s, t) = (u - u.floor(), v - v.floor());
            sum +=
                (at(0, 0) * (1.0 - s) + at(1, 0) * s) * (1.0 - t) + (at(0, 1) * (1.0 - s) + at(1, 1) * s) * t;
        }
        scene + 0.5 * (sum / 9.0) as f32 + grain * noise(at + number * WIDTH * HEIGHT)
    };
    Grey { width: WIDTH, height: HEIGHT, pixels: (0..WIDTH * HEIGHT).map(value).collect() }
}

fn footage(grain: f32, length: f64) -> (Vec<Grey>, Vec<(usize, f64)>) {
    let pictures = known();
    let mut frames = Vec::new();
    let mut truth = Vec::new();
    for number in 0..6 {
        let which = number % pictures.len();
        let angle = [0.0, 12.0, -20.0, 7.0, -4.0, 30.0][number];
        let place = [110.0 + 15.0 * number as f64, 180.0];
        frames.push(frame(number, &pictures[which], place, angle, length, grain));
        truth.push((which, angle));
    }
    (frames, truth)
}

/// PSNR of each streak against its own picture, and the least of them.
fn scores(grain: f32, length: f64) -> Vec<f64> {
    let (frames, truth) = footage(grain, length);
    let pictures = known();
    let settings = ExtractSettings { least_px: [24.0, 2.0], ..Default::default() };
    let found = extract(&frames, &settings).unwrap();
    assert_eq!(found.len(), frames.len(), "streaks found");
    found
        .iter()
        .map(|streak| {
            let (which, angle) = truth[streak.frame];
            assert!((streak.angle_deg - angle).abs() < 2.0, "{} against {angle}", streak.angle_deg);
            let wanted = normalised(&pictures[which], settings.width).unwrap();
            // Heights follow from measured aspects and differ by some rows; compare over the same shares.
            let height = streak.picture.height;
            let row = |y: usize| y * wanted.height / height;
            let pixels =
                (0..height).flat_map(|y| wanted.pixels[row(y) * 32..(row(y) + 1) * 32].to_vec()).collect();
            psnr_db(&Grey { width: 32, height, pixels }, &streak.picture)
        })
        .collect()
}

#[test]
fn known_streaks_come_back_from_footage() {
    /// Streaks that are 300 px long hold nearly what their pictures of 172 to 492 rows do; of 150 px, the thinnest are 3 px wide. Noise of
    /// 1 % of white hides their soft ends.
    const LEAST_MEAN_DB: [f64; 2] = [21.0, 18.0];
    const LEAST_DB: f64 = 12.0;
    for (length, least) in [300.0, 150.0].into_iter().zip(LEAST_MEAN_DB) {
        for grain in [0.0, 0.01] {
            let scores = scores(grain, length);
            let mean = scores.iter().sum::<f64>() / scores.len() as f64;
            println!("{length} px, noise {grain}: {mean:.1} dB, each {scores:.1?}");
            assert!(
                mean > least && scores.iter().all(|score| *score > LEAST_DB),
                "{length} px, {grain}: {scores:?}"
            );
        }
    }
}

#[test]
fn a_scene_without_rain_has_no_streaks_whatever_its_noise() {
    let pictures = known();
    let dark = Grey { pixels: vec![0.0; pictures[0].pixels.len()], ..pictures[0].clone() };
    for grain in [0.0, 0.02] {
        let frames: Vec<Grey> = (0..5).map(|n| frame(n, &dark, [120.0, 100.0], 0.0, 150.0, grain)).collect();
        assert_eq!(extract(&frames, &ExtractSettings::default()).unwrap(), Vec::new());
    }
}

#[test]
fn frames_that_no_median_can_be_taken_of_are_refused() {
    let (frames, _) = footage(0.0, 150.0);
    let refused = |frames: &[Grey], words: &str| {
        let error = extract(frames, &ExtractSettings::default()).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    refused(&frames[..2], "at least 3");
    let mut mixed = frames.clone();
    mixed[1] = Grey { width: 2, height: 2, pixels: vec![0.0; 4] };
    refused(&mixed, "all of 300 × 360");
}
