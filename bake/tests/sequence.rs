//! `squall render --frames` from outside: frames, layers, animated pictures and flashes in time.

use assert_cmd::Command;
use serde_json::Value;
use squall_bake::input::picture::{picture_file, rgb_of};
use std::path::{Path, PathBuf};

struct Place {
    folder: tempfile::TempDir,
    asset: String,
    stroke: String,
}

impl Place {
    fn new() -> Self {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/golden.squall");
        let mut place = Self {
            folder: tempfile::tempdir().unwrap(),
            asset: golden.to_str().unwrap().to_owned(),
            stroke: String::new(),
        };
        let answer = place.answer("render ASSET -o first.png --json");
        place.stroke = answer["flashes"][0]["stroke"].as_str().unwrap().to_owned();
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn squall(&self, words: &str) -> (i32, String, String) {
        let mut call = Command::cargo_bin("squall").unwrap();
        let words = words.replace("ASSET", &self.asset);
        let call = call.current_dir(self.folder.path()).args(words.split_whitespace());
        let output = call.output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
    }

    #[track_caller]
    fn answer(&self, words: &str) -> Value {
        let (code, out, said) = self.squall(words);
        assert_eq!(code, 0, "{words}: {said}");
        serde_json::from_str(&out).unwrap_or_else(|error| panic!("{words}: {error}: {out}"))
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    fn light(&self, name: &str, layer: Option<&str>) -> Vec<[f32; 3]> {
        rgb_of(&picture_file(&self.path(name)).unwrap(), layer).unwrap().picture.pixels
    }
}

#[test]
fn frames_are_numbered_from_the_first_and_do_not_depend_on_where_the_call_begins() {
    let place = Place::new();
    let whole = place.answer("render ASSET --frames 0..5 --fps 20 --exposure-ms 50 -o a.####.png --json");
    assert_eq!((&whole["frames"], &whole["kept"]), (&5.into(), &0.into()));
    place.answer("render ASSET --frames 2..4 --fps 20 --exposure-ms 50 -o b##.png --json");
    let mut names: Vec<String> = place
        .folder
        .path()
        .read_dir()
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let wanted = [
        "a.0000.png",
        "a.0001.png",
        "a.0002.png",
        "a.0003.png",
        "a.0004.png",
        "b02.png",
        "b03.png",
        "first.png",
    ];
    assert_eq!(names, wanted);
    assert!(
        place.bytes("a.0002.png") == place.bytes("b02.png")
            && place.bytes("a.0003.png") == place.bytes("b03.png")
    );
    assert!(place.bytes("a.0000.png") != place.bytes("a.0002.png"), "a flash at .1 s changes the picture");
}

#[test]
fn half_a_sequence_goes_on_with_what_is_whole() {
    let place = Place::new();
    let words = "render ASSET --frames 0..4 --fps 20 --exposure-ms 50 --json -o";
    place.answer(&format!("{words} whole.##.png"));
    let all = [0, 1, 2, 3].map(|frame| place.bytes(&format!("whole.0{frame}.png")));
    std::fs::remove_file(place.path("whole.01.png")).unwrap();
    std::fs::write(place.path("whole.02.png"), &all[2][..all[2].len() / 2]).unwrap();
    assert_eq!(place.answer(&format!("{words} whole.##.png --resume"))["kept"], 2);
    assert!([0, 1, 2, 3].map(|frame| place.bytes(&format!("whole.0{frame}.png"))) == all);
    assert_eq!(place.answer(&format!("{words} whole.##.png --resume --size 32 18"))["kept"], 0);
}

#[test]
fn frames_without_a_layer_that_is_asked_for_are_drawn_again() {
    let place = Place::new();
    let words = "render ASSET --frames 0..2 --fps 10 --rate 0 -o s#.exr --json --layers";
    place.answer(&format!("{words} beauty"));
    assert_eq!(place.answer(&format!("{words} beauty --resume"))["kept"], 2);
    assert_eq!(place.answer(&format!("{words} beauty,depth --resume"))["kept"], 0);
    assert_eq!(place.answer(&format!("{words} depth --resume"))["kept"], 2);
    // A frame without layers is the picture itself.
    place.answer(&format!("{words} depth"));
    assert_eq!(
        place.answer("render ASSET --frames 0..2 --fps 10 --rate 0 -o s#.exr --json --resume")["kept"],
        0
    );
}

#[test]
fn a_sequence_says_once_what_a_picture_says_of_the_skys_light() {
    let place = Place::new();
    let alone = place.answer("render ASSET --sun 105,40 -o p.png --json");
    assert!(alone["sky"].as_str().is_some_and(|words| words.contains("sun")), "{alone}");
    for out in ["f#.png", "f.apng"] {
        let (code, answer, said) =
            place.squall(&format!("render ASSET --sun 105,40 --frames 0..3 --fps 10 -o {out} --json"));
        let answer: Value = serde_json::from_str(&answer).unwrap();
        assert_eq!(
            (code, &answer["sky"], said.matches("warning: ").count()),
            (0, &alone["sky"], 1),
            "{said}"
        );
    }
}

#[test]
fn an_animated_picture_holds_every_frame_at_its_time() {
    let place = Place::new();
    place.answer("render ASSET --frames 0..4 --fps 25 --exposure-ms 40 -o flash.apng --json");
    place.answer("render ASSET --frames 0..4 --fps 25 --exposure-ms 40 -o flash.png --apng --json");
    assert!(place.bytes("flash.apng") == place.bytes("flash.png"));
    place.answer("render ASSET --frames 0..4 --fps 25 --exposure-ms 40 -o f#.png --json");
    let file = std::io::BufReader::new(std::fs::File::open(place.path("flash.apng")).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    assert_eq!(reader.info().animation_control().unwrap().num_frames, 4);
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    for frame in 0..4 {
        reader.next_frame(&mut bytes).unwrap();
        let control = reader.info().frame_control().unwrap();
        assert!((f64::from(control.delay_num) / f64::from(control.delay_den) - 0.04).abs() < 1e-4);
        let alone =
            std::io::BufReader::new(std::fs::File::open(place.path(&format!("f{frame}.png"))).unwrap());
        let mut alone = png::Decoder::new(alone).read_info().unwrap();
        let mut wanted = vec![0; alone.output_buffer_size().unwrap()];
        alone.next_frame(&mut wanted).unwrap();
        assert!(bytes == wanted, "frame {frame}");
    }
}

#[test]
fn layers_of_a_frame_are_what_they_are_called() {
    let place = Place::new();
    place.answer("render ASSET -o plain.exr --rate 40 --json");
    let all = "beauty,cloud,direct,streak-alpha,transmittance,depth,normal,ids";
    place.answer(&format!("render ASSET -o all.exr --rate 40 --layers {all} --json"));
    assert!(place.light("all.exr", None) == place.light("plain.exr", None));
    let share =
        |layer: &str| place.light("all.exr", Some(layer)).iter().map(|pixel| pixel[0]).collect::<Vec<f32>>();
    for layer in ["streak-alpha", "transmittance"] {
        let values = share(layer);
        assert!(values.iter().all(|value| (0.0..=1.0).contains(value)), "{layer}");
        // No streak of that view is long enough to be drawn; its medium is there.
        let seen = values.iter().any(|value| *value > 0.0 && *value < 1.0);
        assert!(seen || layer == "streak-alpha", "{layer}");
    }
    let (cloud, direct, beauty) = (
        place.light("all.exr", Some("cloud")),
        place.light("all.exr", Some("direct")),
        place.light("all.exr", None),
    );
    let sum = |pixels: &[[f32; 3]]| pixels.iter().flatten().map(|&value| f64::from(value)).sum::<f64>();
    assert!(sum(&cloud) > 0.0 && sum(&direct) >= 0.0 && sum(&beauty) > 0.0);
    // A frame of a sequence has them too, and without rain they say so.
    place.answer(
        "render ASSET --frames 0..1 --fps 10 --rate 0 -o s#.exr --layers streak-alpha,transmittance --json",
    );
    let of = |layer: &str| place.light("s0.exr", Some(layer));
    assert!(of("streak-alpha").iter().all(|pixel| *pixel == [0.0; 3]));
    assert!(of("transmittance").iter().all(|pixel| *pixel == [1.0; 3]));
}

#[test]
fn two_flashes_of_keys_add_and_colours_are_the_keys_own() {
    /// Single precision in sums of some lights.
    const ROUND_OFF: f32 = 1e-4;
    /// How much of its light a still's sky may differ by between nodes.
    const NODES: f32 = 0.02;
    let place = Place::new();
    let key = |time: f64, intensity: f64, color: &str| {
        format!("{{\"time_s\": {time}, \"stroke\": \"{}\", \"intensity\": {intensity}{color}}}", place.stroke)
    };
    let a = [key(0.0, 0.0, ""), key(0.1, 2.0, ""), key(0.2, 0.0, "")].join(",");
    let seed =
        format!("{{\"time_s\": 0.1, \"stroke\": \"{}\", \"seed\": 3, \"intensity\": 0.5}}", place.stroke);
    let blue = [key(0.0, 1.0, ", \"color\": [0, 0, 1]"), key(0.2, 1.0, ", \"color\": [0, 0, 1]")].join(",");
    for (name, keys) in [
        ("dark", String::new()),
        ("a", a.clone()),
        ("b", seed.clone()),
        ("both", format!("{a},{seed}")),
        ("blue", blue),
    ] {
        std::fs::write(place.path(&format!("{name}.json")), format!("[{keys}]")).unwrap();
        let words = format!(
            "render ASSET --frames 1..2 --fps 10 --exposure-ms 50 --rate 0 --flashes {name}.json -o {name}#.exr --json"
        );
        place.answer(&words);
    }
    let [dark, a, b, both, blue] =
        ["dark1.exr", "a1.exr", "b1.exr", "both1.exr", "blue1.exr"].map(|name| place.light(name, None));
    let mut lit = 0;
    for at in 0..dark.len() {
        for band in 0..3 {
            let sum = a[at][band] + b[at][band] - dark[at][band];
            assert!(
                (both[at][band] - sum).abs() <= ROUND_OFF * (1.0 + sum.abs()),
                "{at}: {} {sum}",
                both[at][band]
            );
            lit += usize::from(both[at][band] > 2.0 * dark[at][band]);
        }
        // A pixel between nodes may be worked out by itself where a flash sets it off from them: of its own red, a node's share.
        let allowed = (ROUND_OFF + NODES) * dark[at][0] + ROUND_OFF;
        let off = (blue[at][0] - dark[at][0]).abs();
        assert!(off <= allowed, "red of a blue flash: {off} of {}", dark[at][0]);
    }
    assert!(lit > 0, "no pixel is lit");
}

#[test]
fn return_strokes_and_thunder_are_data() {
    let place = Place::new();
    let answer =
        place.answer("render ASSET --frames 0..1 --fps 30 -o f#.png --flash-seed 5 --flash-at 0.25 --json");
    let flash = &answer["flashes"][0];
    assert_eq!(flash["return_strokes"][0]["time_s"], 0.25);
    let thunder = &flash["thunder"];
    let (delay, nearest) = (thunder["delay_s"].as_f64().unwrap(), thunder["nearest_m"].as_f64().unwrap());
    assert!((delay - nearest / 343.0).abs() < 1e-9 && thunder["farthest_m"].as_f64().unwrap() >= nearest);
}

#[test]
fn sequences_that_are_none_are_refused_in_words() {
    let place = Place::new();
    std::fs::write(place.path("one.json"), format!("[{{\"time_s\": 0, \"stroke\": \"{}\"}}]", place.stroke))
        .unwrap();
    std::fs::write(place.path("who.json"), "[{\"time_s\": 0, \"stroke\": \"nobody\", \"seed\": 1}]").unwrap();
    std::fs::write(place.path("typo.json"), "[{\"time\": 0, \"stroke\": \"a\"}]").unwrap();
    for (words, code, said) in [
        ("--frames 5..5 --fps 10 -o f#.png", 2, "A..B"),
        ("--frames 0..2 -o f#.png", 2, "--fps"),
        ("--frames 0..2 --fps 0 -o f#.png", 2, "above 0"),
        ("--fps 10 -o f.png", 2, "--frames"),
        ("--frames 0..2 --fps 10 -o f.png", 3, "####"),
        ("--frames 0..2 --fps 10 -o f#.jpg", 3, ".png or .exr"),
        ("--frames 0..2 --fps 10 -o f#.png --layers depth", 3, ".exr"),
        ("-o f.png --layers depth", 3, ".exr"),
        ("-o f.exr --layers depths", 2, "streak-alpha"),
        ("--frames 0..2 --fps 10 -o f#.png --flashes one.json", 3, "at least two"),
        ("--frames 0..2 --fps 10 -o f#.png --flashes who.json", 3, "nobody"),
        ("--frames 0..2 --fps 10 -o f#.png --flashes typo.json", 3, "time_s"),
        ("--frames 0..2 --fps 10 -o f#.png --exposure-ms 0", 2, "exposure"),
        ("--frames 0..2 --fps 10 -o f.png --apng --resume", 2, "cannot be used with"),
        ("--frames 0..2 --fps 10 -o f.apng --resume", 2, "an animated picture is one file"),
        ("--frames 0..2 --fps 10 -o f#.png --flashes one.json --flash-seed 2", 2, "cannot be used with"),
        ("--frames 0..2 --fps 10 -o f#.png --flashes one.json --flash-at 1", 2, "cannot be used with"),
        ("--frames 0..2 --fps 10 --apng -o f.exr", 3, ".png or .apng"),
        ("--frames 0..2 --fps 10 --apng -o f##.png", 3, "without #"),
        ("--frames 0..2 --fps 1e-6 -o f.apng", 3, "65535"),
    ] {
        let (found, _, text) = place.squall(&format!("render ASSET {words}"));
        assert!(found == code && text.contains(said), "{words}: {found}: {text}");
    }
}

#[test]
fn light_runs_up_the_channel_in_frames_of_a_microsecond() {
    let place = Place::new();
    let words = "--flash-at 0 --rate 0 --layers direct --json";
    place.answer(&format!("render ASSET --frames 0..4 --fps 1000000 --exposure-ms .001 {words} -o f#.exr"));
    let width = place.answer("render ASSET -o size.png --json")["size_px"][0].as_u64().unwrap() as usize;
    // Light, and the row that it stands in in the mean: rows count downwards.
    let seen: Vec<(f32, f32)> = (0..4)
        .map(|frame| {
            let light = place.light(&format!("f{frame}.exr"), Some("direct"));
            let (mut sum, mut moment) = (0.0, 0.0);
            for (i, pixel) in light.iter().enumerate() {
                sum += pixel[1];
                moment += pixel[1] * (i / width) as f32;
            }
            (sum, moment / sum)
        })
        .collect();
    println!("{seen:?}");
    assert!(seen.windows(2).all(|pair| pair[1].0 > pair[0].0), "more and more of it shines: {seen:?}");
    assert!(seen[1..].windows(2).all(|pair| pair[1].1 < pair[0].1), "higher and higher: {seen:?}");
}
