//! `squall rain` from outside: frames of every kind in, the same bytes out for ever.

use assert_cmd::Command;
use serde_json::Value;
use squall_bake::input::picture::frame::{FrameKind, frame_of};
use squall_bake::input::picture::picture_file;
use squall_bake::picture::{encode_named_channels, write_exr};
use squall_runtime::picture::Picture;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

const WIDTH: usize = 48;
const HEIGHT: usize = 32;
/// Focal length, px, and distance of the cameras of a pair, m.
const FOCAL: f64 = 64.0;
const BASELINE: f64 = 0.5;
/// 0 is the middle of the top left pixel.
const LENS: &str = "64,64,23.5,15.5";

/// A folder with a frame and its depth in every form. Depths are powers of two, so that every form holds them exactly.
struct Place {
    folder: tempfile::TempDir,
}

fn metres(at: usize) -> f64 {
    [1.0, 2.0, 8.0, 32.0][at % WIDTH / 12]
}

/// Samples of the frame: no two rows or columns alike.
fn samples(shift: usize) -> Vec<u8> {
    let pixel = |at: usize| [(at * 5 + shift) % 200 + 20, (at / WIDTH) * 6 + 10, (at % WIDTH) * 4 + 8];
    (0..WIDTH * HEIGHT).flat_map(pixel).map(|value| value as u8).collect()
}

fn png(colour: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, WIDTH as u32, HEIGHT as u32);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(data).unwrap();
    writer.finish().unwrap();
    out
}

fn npy<const N: usize>(descr: &str, value: impl Fn(usize) -> [u8; N]) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({HEIGHT}, {WIDTH}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend((0..WIDTH * HEIGHT).flat_map(value));
    bytes
}

fn depth_png(value: impl Fn(usize) -> f64) -> Vec<u8> {
    let data: Vec<u8> = (0..WIDTH * HEIGHT).flat_map(|at| (value(at) as u16).to_be_bytes()).collect();
    png(png::ColorType::Grayscale, png::BitDepth::Sixteen, &data)
}

fn disparity(at: usize) -> f64 {
    BASELINE * FOCAL / metres(at)
}

impl Place {
    fn new() -> Self {
        let place = Self { folder: tempfile::tempdir().unwrap() };
        place.write("c.png", &png(png::ColorType::Rgb, png::BitDepth::Eight, &samples(0)));
        place.write("d.npy", &npy("<f4", |at| (metres(at) as f32).to_le_bytes()));
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        std::fs::write(self.path(name), bytes).unwrap();
    }

    fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&self.read(name)).unwrap()
    }

    fn squall(&self, words: &str) -> (i32, String, String) {
        let mut call = Command::cargo_bin("squall").unwrap();
        let call = call.current_dir(self.folder.path()).args(words.split_whitespace());
        let output = call.output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
    }

    /// Runs `squall rain` with what every run here says, and more.
    fn rain(&self, words: &str) -> (i32, String, String) {
        self.squall(&format!("rain {words} --intrinsics {LENS} --streak-px 4,200 --quiet"))
    }

    #[track_caller]
    fn done(&self, words: &str) {
        let (code, _, said) = self.rain(words);
        assert_eq!(code, 0, "{words}: {said}");
    }

    /// Four frames with their depths.
    fn sequence(&self) {
        for frame in 0..4 {
            let bytes = png(png::ColorType::Rgb, png::BitDepth::Eight, &samples(3 * frame));
            self.write(&format!("rgb/{frame:04}.png"), &bytes);
            self.write(&format!("z/{frame:04}.npy"), &npy("<f8", |at| metres(at).to_le_bytes()));
        }
    }
}

fn lines(text: &[u8]) -> Vec<Value> {
    std::str::from_utf8(text).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn a_run_and_its_manifest_give_the_same_bytes_and_no_input_is_touched() {
    let place = Place::new();
    let before = [place.read("c.png"), place.read("d.npy")];
    let words = "c.png --depth d.npy --rate 60 --seed 7 --wind 1,0.5,0 --gain 3 -o a/r.png --mask a/m.png \
                 --transmittance a/t.exr --in-scattered a/i.exr --streaks a/s.jsonl";
    place.done(words);
    let names = ["r.png", "m.png", "t.exr", "i.exr", "s.jsonl", "manifest.json"];
    let first = names.map(|name| place.read(&format!("a/{name}")));
    assert!(first[0] != before[0], "nothing fell");
    place.done(words);
    let read = || names.map(|name| place.read(&format!("a/{name}")));
    assert!(read() == first, "another time");
    for name in &names[..5] {
        std::fs::remove_file(place.path(&format!("a/{name}"))).unwrap();
    }
    let (code, _, said) = place.squall("rain --manifest a/manifest.json --threads 1");
    assert_eq!(code, 0, "{said}");
    assert!(read() == first, "by the manifest");
    let (code, _, said) = place.squall("rain --manifest a/manifest.json -o b/new.png");
    assert_eq!(code, 0, "{said}");
    assert!(place.read("b/new.png") == first[0] && !place.path("b/m.png").exists());
    assert!([place.read("c.png"), place.read("d.npy")] == before, "an input was touched");
    // Another input is not that run.
    place.write("c.png", &png(png::ColorType::Rgb, png::BitDepth::Eight, &samples(9)));
    let (code, _, said) = place.squall("rain --manifest a/manifest.json");
    assert!(code == 3 && said.contains("c.png") && said.contains("BLAKE3"), "{said}");
}

#[test]
fn every_form_of_depth_gives_the_same_frame() {
    let place = Place::new();
    let exr = encode_named_channels(
        (WIDTH, HEIGHT),
        vec![
            ("R", vec![0.1; WIDTH * HEIGHT]),
            ("Z", (0..WIDTH * HEIGHT).map(|at| metres(at) as f32).collect()),
        ],
        false,
    );
    place.write("z.exr", &exr.unwrap());
    place.write("f8.npy", &npy(">f8", |at| (metres(at) * 1000.0).to_be_bytes()));
    place.write("u2.npy", &npy("<u2", |at| (metres(at) as u16 * 512).to_le_bytes()));
    place.write("kitti.png", &depth_png(|at| metres(at) * 256.0));
    place.write("tum.png", &depth_png(|at| metres(at) * 1000.0));
    place.write("disparity.png", &depth_png(|at| disparity(at) * 256.0));
    place.write("disparity.npy", &npy("<f4", |at| (disparity(at) as f32).to_le_bytes()));
    place.done("c.png --depth d.npy --rate 60 --gain 3 -o first.png");
    let first = place.read("first.png");
    for (depth, words) in [
        ("z.exr", ""),
        ("f8.npy", "--depth-scale 0.001"),
        ("u2.npy", "--depth-scale 512"),
        ("kitti.png", "--depth-scale 256"),
        ("tum.png", "--depth-scale 1000"),
        ("disparity.png", "--depth-kind disparity --baseline 0.5 --depth-scale 256"),
        ("disparity.npy", "--depth-kind disparity --baseline 0.5"),
    ] {
        place.done(&format!("c.png --depth {depth} {words} --rate 60 --gain 3 -o r.png"));
        assert!(place.read("r.png") == first, "{depth}");
    }
    let secant = |at: usize| {
        let across = |pixel: usize, size: usize| (pixel as f64 + 0.5 - size as f64 / 2.0) / FOCAL;
        let (x, y) = (across(at % WIDTH, WIDTH), across(at / WIDTH, HEIGHT));
        (1.0 + x * x + y * y).sqrt()
    };
    place.write("ray.npy", &npy("<f8", |at| (metres(at) * secant(at)).to_le_bytes()));
    place.done("c.png --depth ray.npy --depth-kind ray --rate 60 --gain 3 -o r.png");
    let light = |name: &str| frame_of(&picture_file(&place.path(name)).unwrap()).unwrap().picture.pixels;
    for (a, b) in light("first.png").iter().zip(light("r.png")) {
        // Ranges in single precision are off by round-off, which may turn a step of 1/255.
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.01), "{a:?} {b:?}");
    }
}

#[test]
fn a_frame_comes_out_in_the_kind_and_depth_that_it_came_in_unless_its_new_name_says_otherwise() {
    let place = Place::new();
    let wide: Vec<u8> = samples(0).iter().flat_map(|&value| [value, 77]).collect();
    place.write("wide.png", &png(png::ColorType::Rgb, png::BitDepth::Sixteen, &wide));
    let light =
        |band: usize| (0..WIDTH * HEIGHT).map(|at| (at % 7 + band) as f32 * 0.5).collect::<Vec<f32>>();
    let channels = || vec![("R", light(0)), ("G", light(1)), ("B", light(2))];
    place.write("half.exr", &encode_named_channels((WIDTH, HEIGHT), channels(), true).unwrap());
    place.write("full.exr", &encode_named_channels((WIDTH, HEIGHT), channels(), false).unwrap());
    for name in ["c.png", "wide.png", "half.exr", "full.exr"] {
        // Without rain nothing changes but how the file is packed.
        place.done(&format!("{name} --depth d.npy --rate 0 -o out/{name}"));
        let [a, b] = [place.path(name), place.path(&format!("out/{name}"))]
            .map(|path| frame_of(&picture_file(&path).unwrap()).unwrap());
        assert_eq!((a.kind(), &a.how, &a.picture), (b.kind(), &b.how, &b.picture), "{name}");
        let packed = |name: &str| a.encode(&a.picture, a.kind()).unwrap() == place.read(name);
        assert!(packed(&format!("out/{name}")), "{name}");
    }
    place.done("c.png --depth d.npy --rate 20 -o out/linear.exr");
    place.done("half.exr --depth d.npy --rate 20 -o out/shown.png");
    let kind = |name: &str| frame_of(&picture_file(&place.path(name)).unwrap()).unwrap().kind();
    assert_eq!([kind("out/linear.exr"), kind("out/shown.png")], [FrameKind::Exr, FrameKind::Png]);
}

#[test]
fn a_sequence_at_several_rates_has_a_folder_a_rate_and_one_light() {
    let place = Place::new();
    place.sequence();
    place.done("rgb/####.png --depth z/####.npy --rate 5,25.5 -o out --mask out/mask --streaks out/s.jsonl");
    for rate in ["rate-5", "rate-25.5"] {
        for frame in 0..4 {
            assert!(place.path(&format!("out/{rate}/{frame:04}.png")).is_file());
            assert!(place.path(&format!("out/mask/{rate}/{frame:04}.png")).is_file());
        }
        let frames: Vec<String> = lines(&place.read(&format!("out/{rate}/s.jsonl")))
            .iter()
            .map(|line| line["frame"].to_string())
            .collect();
        assert!(frames.is_sorted() && frames.first() != frames.last(), "{rate}");
    }
    let manifest = place.json("out/manifest.json");
    let frames = manifest["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 8);
    assert_eq!(manifest["light"]["from"], "estimated from 0000");
    assert!(frames[0]["counts"]["streaks"].as_u64() < frames[1]["counts"]["streaks"].as_u64());
    assert!((frames[7]["time_s"].as_f64().unwrap() - 0.1).abs() < 1e-12);
    // The same as folders, frame by frame.
    place.done("rgb --depth z --rate 5 -o folder");
    assert!(place.read("folder/0003.png") == place.read("out/rate-5/0003.png"));
    place
        .done("rgb/0003.png --depth z/0003.npy --rate 5 --time 0.1 -o lone/ --environment out/manifest.json");
    assert!(place.read("lone/0003.png") == place.read("folder/0003.png"));
    place.done("rgb --depth z --rate 5 -o named/r##.exr");
    assert!(place.path("named/r03.exr").is_file() && place.path("named/manifest.json").is_file());
}

#[test]
fn a_bad_frame_is_told_and_the_others_go_on_unless_strict() {
    let place = Place::new();
    place.sequence();
    let whole = place.read("rgb/0002.png");
    place.write("rgb/0002.png", &whole[..whole.len() / 2]);
    std::fs::remove_file(place.path("z/0001.npy")).unwrap();
    let (code, said, words) = place.rain("rgb/####.png --depth z/####.npy --rate 20 -o out --json");
    let answer: Value = serde_json::from_str(&said).unwrap();
    assert_eq!((code, &answer["frames"], &answer["failed"]), (1, &2.into(), &2.into()), "{words}");
    assert!(
        words.contains("0001") && words.contains("0002") && words.contains("2 of 4 frames failed"),
        "{words}"
    );
    assert_eq!(answer["errors"][1]["frame"], "0002");
    assert!(place.path("out/0003.png").is_file() && !place.path("out/0002.png").exists());
    let records = place.json("out/manifest.json");
    assert!(records["frames"][1]["error"].as_str().unwrap().contains("a depth"));
    let (code, _, words) = place.rain("rgb/####.png --depth z/####.npy --rate 20 -o strict --strict");
    assert!(code == 3 && words.contains("0001"), "{words}");
    assert!(place.path("strict/0000.png").is_file() && !place.path("strict/0003.png").exists());
}

#[test]
fn half_a_sequence_goes_on_and_ends_with_the_same_bytes() {
    let place = Place::new();
    place.sequence();
    let words = "rgb/####.png --depth z/####.npy --rate 20 --streaks S --strict -o";
    let shared = words.replace('S', "all.jsonl");
    place.done(&format!("{shared} whole"));
    let list = place.read("all.jsonl");
    let whole = place.read("rgb/0002.png");
    place.write("rgb/0002.png", &whole[..40]);
    assert_eq!(place.rain(&format!("{shared} half")).0, 3);
    assert!(place.path("half/manifest.json.partial").is_file() && !place.path("half/manifest.json").exists());
    // A line that was being written when the process ended, and lines of streaks behind the last frame that counts.
    let mut journal = place.read("half/manifest.json.partial");
    journal.extend(b"{\"record\": {\"frame\": \"00");
    place.write("half/manifest.json.partial", &journal);
    place.write("rgb/0002.png", &whole);
    let (code, said, failed) = place.rain(&format!("{shared} half --resume --json"));
    let answer: Value = serde_json::from_str(&said).unwrap();
    assert_eq!((code, &answer["kept"], &answer["frames"]), (0, &2.into(), &4.into()), "{failed}");
    assert!(place.read("all.jsonl") == list && !place.path("half/manifest.json.partial").exists());
    for frame in 0..4 {
        let name = format!("{frame:04}.png");
        assert!(place.read(&format!("half/{name}")) == place.read(&format!("whole/{name}")));
    }
    // What is there and not whole is made again, and other settings are another run.
    let own = words.replace('S', "own");
    place.done(&format!("{own} whole"));
    let third = place.read("whole/0003.png");
    place.write("whole/0003.png", &third[..60]);
    let kept = |words: &str| {
        let (code, said, failed) = place.rain(words);
        assert_eq!(code, 0, "{failed}");
        serde_json::from_str::<Value>(&said).unwrap()["kept"].as_u64().unwrap()
    };
    assert_eq!(kept(&format!("{own} whole --resume --json")), 3);
    assert!(place.read("whole/0003.png") == third);
    assert_eq!(kept(&format!("{own} whole --resume --json --gain 2")), 0);
}

#[test]
fn a_shared_list_goes_on_only_behind_lines_that_are_there() {
    let place = Place::new();
    place.sequence();
    let words = "rgb/####.png --depth z/####.npy --rate 20 --streaks all.jsonl -o out --json";
    place.done(words);
    let list = place.read("all.jsonl");
    let whole = place.read("rgb/0002.png");
    place.write("rgb/0002.png", &whole[..40]);
    assert_eq!(place.rain(&format!("{words} --strict")).0, 3);
    let (part, journal) = (place.read("all.jsonl.partial"), place.read("out/manifest.json.partial"));
    place.write("rgb/0002.png", &whole);
    let first = list.len() - lines(&list).len();
    assert!(part.len() < first && list.starts_with(&part));
    let of_first = lines(&part).iter().filter(|line| line["frame"] == "0000").count();
    let end = part.iter().enumerate().filter(|(_, byte)| **byte == b'\n').nth(of_first - 1).unwrap().0 + 1;
    let mut changed = part.clone();
    changed[end - 3] ^= 1;
    for (part, kept) in [
        (Some(&part[..]), 2),
        (Some(&part[..part.len() - 1]), 1),
        (Some(&part[..end]), 1),
        (Some(&part[..end - 1]), 0),
        (Some(&changed[..]), 0),
        // The list had its name already, and the manifest was not yet written.
        (None, 0),
    ] {
        place.write("out/manifest.json.partial", &journal);
        match part {
            Some(part) => place.write("all.jsonl.partial", part),
            None => assert!(!place.path("all.jsonl.partial").exists()),
        }
        let (code, said, failed) = place.rain(&format!("{words} --resume"));
        let answer: Value = serde_json::from_str(&said).unwrap();
        assert_eq!((code, &answer["kept"]), (0, &kept.into()), "{failed}");
        assert!(place.read("all.jsonl") == list && !place.path("out/manifest.json.partial").exists());
    }
}

#[test]
fn frames_of_other_inputs_are_not_kept() {
    let place = Place::new();
    place.sequence();
    place.write("times.txt", b"0\n0.1\n0.2\n0.3\n");
    let words = "rgb --depth z --rate 20 --times times.txt -o out --resume --json";
    let kept = || {
        let (code, said, failed) = place.rain(words);
        assert_eq!(code, 0, "{failed}");
        serde_json::from_str::<Value>(&said).unwrap()["kept"].as_u64().unwrap()
    };
    assert_eq!((kept(), kept()), (0, 4));
    place.write("rgb/0001.png", &png(png::ColorType::Rgb, png::BitDepth::Eight, &samples(50)));
    assert_eq!(kept(), 3);
    place.write("z/0002.npy", &npy("<f8", |at| (2.0 * metres(at)).to_le_bytes()));
    assert_eq!((kept(), kept()), (3, 4));
    place.write("times.txt", b"0\n0.1\n0.2\n0.4\n");
    assert_eq!(kept(), 0);
}

#[test]
fn a_manifest_is_made_again_from_all_that_it_was_made_from_and_nothing_else() {
    let place = Place::new();
    place.sequence();
    place.write("poses.txt", b"1 0 0 0 0 1 0 0 0 0 1 0\n");
    place.write("times.txt", b"0\n0.1\n0.2\n0.3\n");
    place.done("rgb/0000.png --depth z/0000.npy --rate 5 -o light/a.png");
    place.done(
        "rgb --depth z --rate 20 --pose poses.txt --times times.txt --environment light/manifest.json -o out",
    );
    let names = ["poses.txt", "times.txt", "light/manifest.json"];
    let inputs = &place.json("out/manifest.json")["inputs"];
    for (field, name) in ["pose", "times", "environment"].into_iter().zip(names) {
        assert_eq!(inputs[field]["name"], format!("../{name}"));
        assert_eq!(inputs[field]["blake3"], blake3::hash(&place.read(name)).to_hex().as_str());
    }
    let again = || place.squall("rain --manifest out/manifest.json --quiet");
    assert_eq!(again().0, 0);
    for name in names {
        let bytes = place.read(name);
        place.write(name, &[&bytes[..], b"\n"].concat());
        let (code, _, said) = again();
        assert!(code == 3 && said.contains(name) && said.contains("BLAKE3"), "{name}: {code}: {said}");
        place.write(name, &bytes);
    }
    let frame = place.read("rgb/0003.png");
    place.write("rgb/0004.png", &frame);
    let (code, _, said) = again();
    assert!(code == 3 && said.contains("found 0004 at 20 mm/h beside them"), "{said}");
    for name in ["rgb/0003.png", "rgb/0004.png"] {
        std::fs::remove_file(place.path(name)).unwrap();
    }
    let (code, _, said) = again();
    assert!(code == 3 && said.contains("found none of 0003 at 20 mm/h"), "{said}");
    place.write("rgb/0003.png", &frame);
    let mut manifest = place.json("out/manifest.json");
    manifest["frames"][1]["time_s"] = 0.125.into();
    place.write("out/manifest.json", manifest.to_string().as_bytes());
    let (code, _, said) = again();
    assert!(code == 1 && said.contains("0001: time: wanted 0.125 s"), "{code}: {said}");
}

#[test]
fn frames_that_are_left_out_take_their_time_where_poses_go_by_number() {
    let place = Place::new();
    place.sequence();
    std::fs::remove_file(place.path("rgb/0001.png")).unwrap();
    let pose = |x: usize| format!("1 0 0 {x} 0 1 0 0 0 0 1 0\n");
    place.write("kitti.txt", (0..6).map(pose).collect::<String>().as_bytes());
    let times = |folder: &str| -> Vec<f64> {
        let manifest = place.json(&format!("{folder}/manifest.json"));
        manifest["frames"].as_array().unwrap().iter().map(|frame| frame["time_s"].as_f64().unwrap()).collect()
    };
    place.done("rgb --depth z --rate 20 --fps 10 --pose kitti.txt -o kitti");
    assert_eq!(times("kitti"), [0.0, 0.2, 0.3]);
    place.done("rgb --depth z --rate 20 --fps 10 -o order");
    assert_eq!(times("order"), [0.0, 0.1, 0.2]);
    // TUM's begin with the first frame that has a pose.
    for (from, to) in [("0000", "1.0"), ("0002", "1.5"), ("0003", "1.75")] {
        place.write(&format!("named/{to}.png"), &place.read(&format!("rgb/{from}.png")));
        place.write(&format!("depth/{to}.npy"), &place.read("z/0000.npy"));
    }
    let pose = |time: f64| format!("{time} 0 0 0 -0.70710678 0 0 0.70710678\n");
    place.write("tum.txt", [1.5, 1.75, 2.0, 2.25].map(pose).concat().as_bytes());
    let (code, _, said) = place.rain("named --depth depth --rate 20 --pose tum.txt -o tum");
    assert!(code == 1 && said.contains("1 of 3 frames failed"), "{said}");
    assert_eq!(times("tum")[1..], [0.0, 0.25]);
}

#[test]
fn a_depth_that_is_missing_is_its_frames_error_and_not_its_neighbours_depth() {
    let place = Place::new();
    place.sequence();
    std::fs::rename(place.path("z/0001.npy"), place.path("z/0009.npy")).unwrap();
    let (code, said, words) = place.rain("rgb --depth z --rate 20 -o out --json");
    let answer: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(
        (code, &answer["failed"], &answer["errors"][0]["frame"]),
        (1, &1.into(), &"0001".into()),
        "{words}"
    );
    assert!(answer["notes"][0] == "depths belong to frames by name", "{said}");
}

#[cfg(unix)]
#[test]
fn a_frame_that_fails_behind_its_first_output_leaves_none() {
    let place = Place::new();
    place.write("out/keep.txt", b"");
    std::os::unix::fs::symlink("none/m.png", place.path("out/m.png")).unwrap();
    let (code, _, said) = place.rain("c.png --depth d.npy --rate 20 -o out/r.png --mask out/m.png");
    assert!(code == 3 && said.contains("m.png"), "{code}: {said}");
    assert!(!place.path("out/r.png").exists());
}

#[test]
fn a_pair_of_cameras_sees_streaks_at_the_disparity_of_their_depth() {
    /// Pictures' places are printed in single precision, px.
    const ROUND_OFF_PX: f64 = 1e-3;
    let place = Place::new();
    place.done(&format!(
        "c.png --depth d.npy --right c.png --right-depth d.npy --baseline {BASELINE} --rate 100 -o pair --streaks pair/s.jsonl"
    ));
    assert!(place.path("pair/left/c.png").is_file() && place.path("pair/right/c.png").is_file());
    let all = lines(&place.read("pair/s.jsonl"));
    let of = |camera: &str| -> HashMap<String, Value> {
        let own = all.iter().filter(|line| line["camera"] == camera);
        own.map(|line| (line["id"].to_string(), line.clone())).collect()
    };
    let (left, right) = (of("left"), of("right"));
    let (mut pairs, at) =
        (0, |line: &Value, end: usize, axis: usize| line["ends_px"][end][axis].as_f64().unwrap());
    for (id, line) in &left {
        let Some(other) = right.get(id) else { continue };
        pairs += 1;
        let wanted = FOCAL * BASELINE / line["depth_m"].as_f64().unwrap();
        for end in 0..2 {
            assert!(
                (at(line, end, 0) - at(other, end, 0) - wanted).abs() < ROUND_OFF_PX * (1.0 + wanted),
                "{line} {other}"
            );
            assert!((at(line, end, 1) - at(other, end, 1)).abs() < ROUND_OFF_PX * 10.0);
        }
        assert_eq!(line["diameter_mm"], other["diameter_mm"]);
    }
    assert!(pairs > 20, "{pairs} of {}", left.len());
    // The same by two poses, one a run, in the light of the first.
    place.write("left.txt", b"1 0 0 0 0 1 0 0 0 0 1 0\n");
    place.write("right.txt", b"1 0 0 0.5 0 1 0 0 0 0 1 0\n");
    place.done("c.png --depth d.npy --pose left.txt --rate 100 -o l/c.png --streaks l/s.jsonl");
    place.done("c.png --depth d.npy --pose right.txt --environment l/manifest.json --rate 100 -o r/c.png --streaks r/s.jsonl");
    assert_eq!(place.json("l/manifest.json")["light"], place.json("r/manifest.json")["light"]);
    let ids = |name: &str| -> Vec<String> {
        lines(&place.read(name)).iter().map(|line| line["id"].to_string()).collect()
    };
    let (l, r) = (ids("l/s.jsonl"), ids("r/s.jsonl"));
    assert!(l.iter().filter(|id| r.contains(id)).count() > 20);
}

#[test]
fn streaks_take_their_light_from_the_panorama() {
    let place = Place::new();
    let mut picture = Picture::new(32, 16).unwrap();
    picture.pixels.fill([0.0, 0.0, 4.0]);
    write_exr(&place.path("blue.exr"), &picture).unwrap();
    place
        .done("c.png --depth d.npy --rate 100 --gain 5 --environment blue.exr -o r.exr --in-scattered i.exr");
    let pixels = |name: &str| frame_of(&picture_file(&place.path(name)).unwrap()).unwrap().picture.pixels;
    assert!(pixels("i.exr").iter().all(|[r, g, b]| *r == 0.0 && *g == 0.0 && *b > 0.0));
    let (before, after) = (pixels("c.png"), pixels("r.exr"));
    let sum =
        |pixels: &[[f32; 3]], band: usize| pixels.iter().map(|pixel| f64::from(pixel[band])).sum::<f64>();
    assert!(sum(&after, 2) > sum(&before, 2) && sum(&after, 0) < sum(&before, 0));
}

#[test]
fn what_cannot_be_rained_on_is_refused_in_words_before_anything_is_written() {
    let place = Place::new();
    place.write("small.npy", &npy("<f4", |at| (metres(at) as f32).to_le_bytes())[..100]);
    place.write("scaleless.png", &depth_png(|at| metres(at) * 256.0));
    place.write("text.txt", b"not a picture\n");
    place.write("poses.txt", b"1 2 3\n");
    place.write(
        "sixteen.npy",
        b"\x93NUMPY\x01\x00\x46\x00{'descr': '<f4', 'fortran_order': False, 'shape': (4, 4)}             \n",
    );
    place.sequence();
    place.write("twice/a.png", &place.read("c.png"));
    place.write("twice/a.exr", b"");
    let base = "c.png --depth d.npy --rate 20 -o out/r.png";
    for (words, code, said) in [
        ("c.png --depth none.npy --rate 20 -o out/r.png", 3, "none.npy"),
        ("none.png --depth d.npy --rate 20 -o out/r.png", 3, "none.png"),
        ("text.txt --depth d.npy --rate 20 -o out/r.png", 3, "a PNG or OpenEXR picture"),
        ("c.png --depth text.txt --rate 20 -o out/r.png", 3, "OpenEXR, 16-bit PNG or .npy"),
        ("c.png --depth small.npy --rate 20 -o out/r.png", 3, "npy"),
        ("c.png --depth scaleless.png --rate 20 -o out/r.png", 3, "--depth-scale"),
        ("c.png --depth c.png --depth-scale 256 --rate 20 -o out/r.png", 3, "16-bit grey"),
        ("c.png --depth d.npy --depth-kind disparity --rate 20 -o out/r.png", 3, "--baseline"),
        ("c.png --depth d.npy --rate 20 -o c.png", 3, "one of the inputs"),
        ("c.png --depth d.npy --rate 20 -o out/r.png --mask d.npy", 3, "d.npy"),
        ("c.png --depth d.npy --rate 20 -o out/r.png --mask out/r.png", 3, "another output"),
        ("c.png --depth d.npy --rate 20 -o out/r.jpg", 3, ".png or .exr"),
        ("c.png --depth d.npy --rate 20 -o -", 3, "a name that ends"),
        ("c.png --depth d.npy --rate 900 -o out/r.png", 3, "200 mm/h"),
        ("c.png --depth d.npy --rate -1 -o out/r.png", 2, "0 or more"),
        ("c.png --depth d.npy --rate nan -o out/r.png", 2, "0 or more"),
        ("c.png --depth d.npy --rate 5,5 -o out", 3, "5 twice"),
        ("rgb --depth z --rate 5 -o rgb", 3, "none of the frames"),
        ("twice --depth z --rate 5 -o out", 3, "a.exr and a.png"),
        ("rgb --depth d.npy --rate 5 -o out", 3, "one file"),
        ("rgb/##.png --depth z --rate 5 -o out", 3, "found none"),
        (&format!("{base} --gain -1"), 2, "--gain"),
        (&format!("{base} --exposure-ms 0"), 2, "--exposure-ms"),
        (&format!("{base} --time inf"), 2, "--time"),
        (&format!("{base} --sky-distance 0"), 2, "--sky-distance"),
        (&format!("{base} --pose poses.txt"), 3, "line 1"),
        (&format!("{base} --environment c.png"), 3, "an OpenEXR panorama"),
        (&format!("{base} --asset c.png"), 3, "c.png"),
        (&format!("{base} --in-scattered out/i.png"), 3, ".exr"),
        (&format!("{base} --vertical-fov 60"), 2, "cannot be used with"),
        (&format!("{base} --wind 1,2"), 2, "3 numbers"),
        (&format!("{base} --right c.png"), 2, "--right-depth"),
        ("c.png --depth d.npy -o out/r.png", 2, "--rate"),
    ] {
        let (found, _, text) = place.rain(words);
        assert!(found == code && text.contains(said), "{words}: {found}: {text}");
        assert!(!text.contains("panicked"), "{text}");
        assert!(!place.path("out").exists(), "{words}");
    }
    place.write("out/manifest.json", b"{\"name\": \"a web app\"}");
    let (code, _, text) = place.rain(base);
    assert!(code == 3 && text.contains("no manifest of squall rain"), "{text}");
}

#[test]
fn the_built_in_rain_is_what_its_recipe_bakes() {
    use squall_bake::input::picture::read_grey;
    use squall_bake::recipe::Recipe;
    use squall_bake::streak::{Source, fit};
    use squall_formats::section::density::DensitySection;
    use squall_formats::section::streak::StreakSection;
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/rain");
    let recipe = Recipe::read(&folder.join("built-in.toml")).unwrap();
    let asset = squall_runtime::Asset::read(folder.join("built-in.squall")).unwrap();
    assert!(asset.bytes() == squall_runtime::frame_rain::BUILT_IN);
    let rain = recipe.rain.as_ref().unwrap();
    let table = squall_runtime::density::read_density(&asset).unwrap();
    assert!(
        squall_bake::plan::density::bake_density(&rain.density).unwrap() == table,
        "the tables differ; bake it again"
    );
    let stored = asset.section(StreakSection::TAG, "patterns", StreakSection::read).unwrap();
    assert_eq!(stored.patterns.len(), rain.pictures.len());
    // One of the patterns; all of them take a minute.
    let picture = read_grey(&rain.pictures[0]).unwrap();
    let source = Source { file: &rain.pictures[0], picture: &picture, notes: None };
    let fitted = fit(&source, rain.fit).unwrap();
    assert!(fitted == stored.patterns[0], "the patterns differ; bake it again");
    assert_eq!(asset.directory().entries.len(), 3, "{:?}", DensitySection::TAG);
}

#[test]
fn a_manifest_whose_settings_give_other_bytes_fails_its_check_and_replaces_nothing() {
    let place = Place::new();
    place.done("c.png --depth d.npy --rate 60 --gain 3 -o a/r.png --mask a/m.png");
    let text = String::from_utf8(place.read("a/manifest.json")).unwrap();
    let edited = text.replace("\"gain\": 3.0", "\"gain\": 9.0");
    assert!(edited != text);
    place.write("a/manifest.json", edited.as_bytes());
    let before = ["a/r.png", "a/m.png", "a/manifest.json"].map(|name| place.read(name));
    let (code, _, said) = place.squall("rain --manifest a/manifest.json");
    assert!(code == 1 && said.contains("differs and is not written"), "{code} {said}");
    assert!(["a/r.png", "a/m.png", "a/manifest.json"].map(|name| place.read(name)) == before);
    // Elsewhere, nothing of the frame appears.
    assert_eq!(place.squall("rain --manifest a/manifest.json -o b/r.png").0, 1);
    assert!(!place.path("b").exists());

    place.sequence();
    place.done("rgb --depth z --rate 60 --gain 3 -o out");
    let text = String::from_utf8(place.read("out/manifest.json")).unwrap();
    let edited = text.replace("\"gain\": 3.0", "\"gain\": 9.0");
    place.write("out/manifest.json", edited.as_bytes());
    let before = place.read("out/0001.png");
    let (code, _, said) = place.squall("rain --manifest out/manifest.json");
    assert!(code == 1 && said.contains("4 of 4 frames failed"), "{code} {said}");
    assert!(place.read("out/0001.png") == before && place.read("out/manifest.json") == edited.as_bytes());
}

#[test]
fn a_finished_run_beside_a_shared_list_says_that_nothing_of_it_is_kept() {
    let place = Place::new();
    place.sequence();
    let words =
        "rain rgb --depth z --rate 60 -o out --streaks out/all.jsonl --vertical-fov 30 --streak-px 4,200";
    assert_eq!(place.squall(words).0, 0);
    let (code, _, said) = place.squall(&format!("{words} --resume"));
    assert!(code == 0 && said.contains("nothing is kept of a run that came to its end"), "{code} {said}");
}
