//! `squall wet` from outside: buffers in, wet frames and layers out, the same bytes for ever.

use assert_cmd::Command;
use serde_json::Value;
use squall_bake::input::Input;
use squall_bake::input::picture::{exr_channel, picture_file, rgb_of};
use squall_bake::picture::{ChannelValues, encode_layers, encode_seen_layers};
use squall_runtime::Camera;
use squall_runtime::glam::DVec3;
use std::path::PathBuf;

const SIZE: (usize, usize) = (48, 32);

/// A folder with a street's buffers: ground before a wall with a lamp in it, under a dim sky.
struct Place {
    folder: tempfile::TempDir,
}

fn camera() -> Camera {
    let down = DVec3::new(0.0, 20.0, 1.0);
    Camera::look_at(DVec3::Z * 1.6, down, squall_formats::units::Degrees(50.0), [48, 32]).unwrap()
}

/// Channels by name; `lamp` is the wall's brightest light.
fn channels(lamp: f32) -> Vec<(String, ChannelValues)> {
    let camera = camera();
    let mut all: Vec<[f32; 8]> = Vec::new();
    for i in 0..SIZE.0 * SIZE.1 {
        let ray = camera.ray((i % SIZE.0) as f64 + 0.5, (i / SIZE.0) as f64 + 0.5);
        let wall = 20.0 / ray.direction.y;
        let ground = if ray.direction.z < 0.0 { -1.6 / ray.direction.z } else { f64::INFINITY };
        let place = ray.origin + ray.direction * wall.min(ground);
        let is_sky = place.z > 8.0;
        let depth = if is_sky { f32::INFINITY } else { (place - camera.position).dot(camera.forward) as f32 };
        let is_lamp = place.distance(DVec3::new(1.0, 20.0, 4.0)) < 0.8;
        let light = if is_lamp { lamp } else { 0.2 };
        let normal = match (is_sky, wall < ground) {
            (true, _) => [0.0; 3],
            (false, true) => [0.0, -1.0, 0.0],
            (false, false) => [0.0, 0.0, 1.0],
        };
        all.push([light, light, 0.5 * light, depth, normal[0], normal[1], normal[2], 0.15]);
    }
    let names = ["R", "G", "B", "Z", "N.X", "N.Y", "N.Z", "roughness.Y"];
    let channel = |(k, name): (usize, &&str)| {
        ((*name).to_owned(), ChannelValues::Floats(all.iter().map(|pixel| pixel[k]).collect()))
    };
    names.iter().enumerate().map(channel).collect()
}

impl Place {
    fn new() -> Self {
        let place = Self { folder: tempfile::tempdir().unwrap() };
        let seen = encode_seen_layers(SIZE, channels(20.0), (None, Some(&camera()))).unwrap();
        std::fs::write(place.path("g.exr"), seen).unwrap();
        std::fs::write(place.path("blind.exr"), encode_layers(SIZE, channels(20.0), None).unwrap()).unwrap();
        for frame in 0..3 {
            let bytes =
                encode_seen_layers(SIZE, channels(10.0 + frame as f32), (None, Some(&camera()))).unwrap();
            std::fs::write(place.path(&format!("s.{frame:04}.exr")), bytes).unwrap();
        }
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    fn input(&self, name: &str) -> Input {
        picture_file(&self.path(name)).unwrap()
    }

    fn wet(&self, words: &str) -> (i32, String, String) {
        let mut call = Command::cargo_bin("squall").unwrap();
        let call = call.current_dir(self.folder.path()).arg("wet").args(words.split_whitespace());
        let output = call.output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
    }

    #[track_caller]
    fn answer(&self, words: &str) -> Value {
        let (code, out, said) = self.wet(&format!("{words} --json --quiet"));
        assert_eq!(code, 0, "{words}: {said}");
        serde_json::from_str(&out).unwrap()
    }
}

#[test]
fn buffers_come_out_wet_the_same_bytes_on_any_threads_and_no_input_is_touched() {
    let place = Place::new();
    let before = place.read("g.exr");
    let answer = place.answer("g.exr --rate 25 --time 3 --seed 4 -o a.exr --layers");
    assert_eq!(
        (answer["writer"].as_str(), answer["camera_from"].as_str()),
        (Some("squall"), Some("worldToNDC"))
    );
    assert_eq!(answer["layers"]["roughness"], "roughness");
    let notes = answer["notes"].as_array().unwrap();
    assert!(notes.iter().any(|note| note.as_str().unwrap().starts_with("no albedo")), "{notes:?}");
    place.answer("g.exr --rate 25 --time 3 --seed 4 -o b.exr --layers --threads 1");
    assert_eq!(place.read("a.exr"), place.read("b.exr"));
    assert_eq!(place.read("g.exr"), before);
    let [wet, dry] = ["a.exr", "g.exr"].map(|name| rgb_of(&place.input(name), None).unwrap().picture);
    assert_ne!(wet.pixels, dry.pixels);
    // The frame with its layers laid over it, in order, is the picture.
    let channel = |name: String| {
        exr_channel(&place.input("a.exr"), |all| all.contains(&name).then(|| name.clone())).unwrap().2
    };
    let mut stacked = dry.pixels;
    for report in answer["effects"].as_array().unwrap() {
        let effect = report["effect"].as_str().unwrap();
        let alpha = channel(format!("{effect}.A"));
        for (band, letter) in ["R", "G", "B"].into_iter().enumerate() {
            let light = channel(format!("{effect}.{letter}"));
            for (i, pixel) in stacked.iter_mut().enumerate() {
                if alpha[i] != 0.0 || light[i] != 0.0 {
                    pixel[band] = light[i] + (1.0 - alpha[i]) * pixel[band];
                }
            }
        }
    }
    for (a, b) in stacked.iter().flatten().zip(wet.pixels.iter().flatten()) {
        assert!((a - b).abs() <= 1e-5 * b.abs(), "{a} {b}");
    }
}

#[test]
fn dry_weather_leaves_every_bit_and_effects_go_alone() {
    let place = Place::new();
    place.answer("g.exr --rate 0 -o dry.exr");
    let [dry, given] =
        ["dry.exr", "g.exr"].map(|name| rgb_of(&place.input(name), None).unwrap().picture.pixels);
    assert_eq!(dry, given);
    let one = place.answer("g.exr --rate 25 --only surface -o s.exr");
    assert_eq!(one["effects"].as_array().unwrap().len(), 1);
    let rest = place.answer("g.exr --rate 25 --without surface,rain -o r.exr");
    let names: Vec<&str> =
        rest["effects"].as_array().unwrap().iter().map(|e| e["effect"].as_str().unwrap()).collect();
    assert!(names.contains(&"glow") && !names.contains(&"surface") && !names.contains(&"rain"), "{names:?}");
    place.answer("g.exr --rate 25 --only surface --set surface.puddles=0 --set surface.film=0 -o t.exr");
    assert_ne!(place.read("s.exr"), place.read("t.exr"));
    // A flash lights what rain doesn't.
    place.answer("g.exr --rate 0 --lightning 1,0.5 -o f.exr");
    let flash = rgb_of(&place.input("f.exr"), None).unwrap().picture.pixels;
    assert!(flash.iter().zip(&given).any(|(lit, dark)| lit[2] > dark[2]));
}

#[test]
fn sequences_go_on_and_one_file_is_made_wet_at_many_times() {
    let place = Place::new();
    let all = place.answer("s.####.exr --rate 25 -o w/f.####.png");
    assert_eq!((all["frames"].as_u64(), all["kept"].as_u64()), (Some(3), Some(0)));
    let last = place.read("w/f.0002.png");
    std::fs::remove_file(place.path("w/f.0001.png")).unwrap();
    let again = place.answer("s.####.exr --rate 25 -o w/f.####.png --resume");
    assert_eq!((again["frames"].as_u64(), again["kept"].as_u64()), (Some(3), Some(2)));
    assert_eq!(place.read("w/f.0002.png"), last);
    let other = place.answer("s.####.exr --rate 30 -o w/f.####.png --resume");
    assert_eq!(other["kept"].as_u64(), Some(0));
    let part = place.answer("s.####.exr --frames 1..3 --rate 25 --fps 30 -o p/f.####.png");
    assert_eq!(part["frames"].as_u64(), Some(2));
    // Marks tell of the first frame's light, which is another one's here; what is seen is the same.
    std::fs::write(place.path("last.png"), &last).unwrap();
    let [part, whole] =
        ["p/f.0002.png", "last.png"].map(|name| rgb_of(&place.input(name), None).unwrap().picture.pixels);
    assert_eq!(part, whole);
    let still = place.answer("g.exr --frames 0..2 --fps 10 --rate 25 --without rain -o q/f.####.exr");
    assert_eq!(still["frames"].as_u64(), Some(2));
    assert_ne!(place.read("q/f.0000.exr"), place.read("q/f.0001.exr"));
    // One bad frame doesn't end the others.
    std::fs::write(place.path("s.0001.exr"), b"no picture").unwrap();
    let (code, out, _) = place.wet("s.####.exr --rate 25 -o x/f.####.png --json --quiet");
    let answer: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, answer["frames"].as_u64(), answer["failed"].as_u64()), (1, Some(2), Some(1)));
    assert_eq!(place.wet("s.####.exr --rate 25 -o y/f.####.png --strict").0, 3);
}

#[test]
fn views_set_effects_and_say_where_they_are_wrong() {
    let place = Place::new();
    let view = |wet: &str| {
        let text = format!(
            "[view]\nposition_m = [0.0, 0.0, 2.0]\nheading_deg = 90.0\nrain = {{ rate_mm_per_h = 25.0 }}\n{wet}"
        );
        std::fs::write(place.path("v.toml"), text).unwrap();
    };
    view("[view.wet.rain]\non = false\n[view.wet.surface]\npuddles = 0\n");
    let answer = place.answer("g.exr --scene v.toml -o v.exr");
    let names: Vec<&str> =
        answer["effects"].as_array().unwrap().iter().map(|e| e["effect"].as_str().unwrap()).collect();
    assert!(!names.contains(&"rain") && answer["rate_mm_per_h"] == 25.0, "{names:?}");
    for (wet, wanted) in [
        ("[view.wet.puddles]\n", "surface"),
        ("[view.wet.surface]\npudles = 0.1\n", "`puddles`"),
        ("[view.wet.surface]\npuddles = 3\n", "wanted 0 to 1, found 3"),
        ("[view.wet.glow]\non = 1\n", "true or false"),
    ] {
        view(wet);
        let (code, _, said) = place.wet("g.exr --scene v.toml -o v.exr");
        assert!(code == 3 && said.contains(wanted) && said.contains("v.toml"), "{wet}: {code} {said}");
    }
}

#[test]
fn the_list_names_every_effect_and_control() {
    let place = Place::new();
    let (code, words, _) = place.wet("--list");
    let listed = place.answer("--list");
    assert_eq!(code, 0);
    for effect in listed["effects"].as_array().unwrap() {
        assert!(words.contains(effect["effect"].as_str().unwrap()), "{effect}");
        for control in effect["controls"].as_array().unwrap() {
            assert!(words.contains(control["name"].as_str().unwrap()), "{control}");
            let documented = include_str!("../../docs/json.md");
            control
                .as_object()
                .unwrap()
                .keys()
                .for_each(|key| assert!(documented.contains(&format!("`{key}`")), "{key}"));
        }
    }
}

#[test]
fn what_cannot_be_done_is_refused_with_the_right_code_and_leaves_nothing() {
    let place = Place::new();
    for (words, code, wanted) in [
        ("g.exr --rate 25 -o g.exr", 3, "input"),
        ("blind.exr --rate 25 -o o.png", 3, "camera: wanted a camera"),
        ("none.exr --rate 25 -o o.png", 3, "none.exr"),
        ("g.exr --rate 25 --layer albedo=wood -o o.png", 3, "--layer albedo"),
        ("g.exr --rate 9999 -o o.png", 3, "--rate"),
        ("g.exr --rate 25 --layers -o o.png", 3, ".exr"),
        ("g.exr --rate 25 -o o.txt", 3, ".png or .exr"),
        ("g.exr -o o.png", 2, "--rate"),
        ("g.exr --rate -1 -o o.png", 2, "0 or more"),
        ("g.exr --rate 25 --only snow -o o.png", 2, "surface"),
        ("g.exr --rate 25 --set surface.puddles=2 -o o.png", 2, "0 to 1"),
        ("g.exr --rate 25 --only glow --without glow -o o.png", 2, "--without"),
        ("g.exr --rate 25 --resume -o o.png", 2, "--resume"),
        ("g.exr --rate 25 --frames 0..2 --fps 4 --resume -o o.apng", 2, "--resume"),
        ("s.####.exr --rate 25 -o o.png", 3, "####"),
        ("s.####.exr --frames 1..9 --rate 25 -o o.####.png", 3, "8 files"),
    ] {
        let (found, _, said) = place.wet(words);
        assert!(found == code && said.contains(wanted), "{words}: {found} {said}");
        assert!(!place.path("o.png").exists() && !place.path("o.txt").exists(), "{words}");
    }
}

#[test]
fn resumed_frames_are_made_again_where_the_first_frame_or_the_panorama_was_changed() {
    let place = Place::new();
    let kept = |words: &str| place.answer(words)["kept"].as_u64().unwrap();
    let panorama = |value: f32| {
        let channel = |name: &str| (name.to_owned(), ChannelValues::Floats(vec![value; 16 * 8]));
        let bytes = encode_layers((16, 8), ["R", "G", "B"].map(channel).to_vec(), None).unwrap();
        std::fs::write(place.path("sky.exr"), bytes).unwrap();
    };
    panorama(0.3);
    let words = "s.####.exr --rate 25 --environment sky.exr -o e/f.####.png --resume";
    assert_eq!((kept(words), kept(words)), (0, 3));
    panorama(0.4);
    assert_eq!((kept(words), kept(words)), (0, 3));
    // Light and exposure of all frames are the first one's.
    let words = "s.####.exr --rate 25 -o f/f.####.png --resume";
    assert_eq!((kept(words), kept(words)), (0, 3));
    let mut brighter = channels(10.0);
    for (name, values) in &mut brighter {
        if let (true, ChannelValues::Floats(values)) = (name.len() == 1 && name != "Z", values) {
            values.iter_mut().for_each(|value| *value *= 3.0);
        }
    }
    let bytes = encode_seen_layers(SIZE, brighter, (None, Some(&camera()))).unwrap();
    std::fs::write(place.path("s.0000.exr"), bytes).unwrap();
    assert_eq!((kept(words), kept(words)), (0, 3));
}

#[test]
fn what_is_said_counts_though_it_is_usual_and_what_changes_nothing_is_noted() {
    let place = Place::new();
    let picture = |set: &str| {
        place.answer(&format!("g.exr --rate 25 --only lightning --lightning 1,0 {set} -o l.exr"));
        place.read("l.exr")
    };
    let (unsaid, usual) = (picture(""), picture("--set lightning.flash=10"));
    assert_ne!(unsaid, usual);
    let names = |answer: &Value, of: &str| -> Vec<String> {
        let all = answer[of].as_array().unwrap().iter();
        all.map(|value| value["effect"].as_str().or(value.as_str()).unwrap().to_owned()).collect()
    };
    let off = place.answer("g.exr --rate 25 --set drops.flash=2 -o o.exr");
    assert!(names(&off, "notes").iter().any(|note| note.contains("drops is off")), "{off}");
    let on = place.answer("g.exr --rate 25 --with drops,layers --set drops.flash=2 -o o.exr");
    assert!(!names(&on, "notes").iter().any(|note| note.contains("is off")), "{on}");
    for name in ["surface", "drops", "layers"] {
        assert!(names(&on, "effects").contains(&name.to_owned()), "{on}");
    }
    assert_eq!(place.wet("g.exr --rate 25 --with drops --without drops -o o.exr").0, 2);
    assert_eq!(place.wet("g.exr --rate 25 --with drops --only rain -o o.exr").0, 2);
    let listed = place.answer("--list");
    for effect in listed["effects"].as_array().unwrap() {
        let off = ["flicker", "drops", "layers", "glass"].contains(&effect["effect"].as_str().unwrap());
        assert_eq!(effect["on"].as_bool(), Some(!off), "{effect}");
    }
}

#[test]
fn frames_go_into_one_animated_picture_and_the_pane_before_them_has_drops_and_wipers() {
    let place = Place::new();
    let words = "g.exr --rate 25 --with glass --set glass.wipers=60 --set glass.wets=1 --fps 12";
    let answer = place.answer(&format!("{words} --frames 0..3 -o loop.apng"));
    assert_eq!(answer["frames"], 3);
    let bytes = place.read("loop.apng");
    let decoder = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
    let animation = decoder.info().animation_control.unwrap();
    assert_eq!((animation.num_frames, animation.num_plays), (3, 0));
    let glass =
        answer["effects"].as_array().unwrap().iter().find(|effect| effect["effect"] == "glass").unwrap();
    assert!(glass["pixels"].as_u64().unwrap() > 50, "{glass}");
    // The name says it, or the option; one frame, a pattern and layers do not go with it.
    place.answer(&format!("{words} --frames 0..2 --apng -o same.png"));
    assert_eq!(place.wet("g.exr --rate 25 -o one.apng").0, 2);
    assert_eq!(place.wet("g.exr --rate 25 --frames 0..2 --apng -o s.####.png").0, 3);
    assert_eq!(place.wet("g.exr --rate 25 --frames 0..2 --apng --layers -o s.png").0, 2);
}

#[test]
fn an_orthographic_camera_is_told_how_to_go_on_without_rain() {
    let place = Place::new();
    let camera = r#""type": "orthographic", "target_m": [0, 8, 3], "direction": [0, 1, -0.4]"#;
    let camera =
        format!("{{{camera}, \"half_width_m\": 6, \"half_height_m\": 4, \"width\": 48, \"height\": 32}}");
    std::fs::write(place.path("o.json"), camera).unwrap();
    let words = "blind.exr --camera o.json --rate 25 -o o.exr";
    let (code, _, said) = place.wet(words);
    assert_eq!(code, 3, "{said}");
    assert!(said.contains("--without rain") && said.contains("camera"), "{said}");
    place.answer(&format!("{words} --without rain"));
}
