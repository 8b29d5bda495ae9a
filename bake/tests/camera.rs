//! CAMERA.json and a view stand for one another wherever a command takes a camera.

use super::steps::Workplace;
use squall_bake::evaluate::relative_l2;
use squall_bake::input::picture::read_grey;

/// The camera of the recipe's own view, which looks along `way` with `up` at the picture's top.
fn camera(way: &str, up: &str) -> String {
    let from = r#""origin_m": [0, -400, 2]"#;
    format!(
        r#"{{{from}, "direction": {way}, "up": {up}, "vertical_fov_deg": 60, "width": 32, "height": 18}}"#
    )
}

/// A sine and cosine of the heading in place of a vector, which single precision sees here and there.
const SAME: f64 = 0.01;
/// What a picture rolled by an eighth of a turn is off by, at least.
const OTHER: f64 = 0.1;

#[test]
fn a_camera_file_draws_what_the_view_of_the_same_camera_draws_and_rolls_by_its_up() {
    let place = Workplace::new("test_strokes = 0");
    place.bake(&[]);
    std::fs::write(place.path("c.json"), camera("[0, 1, 0]", "[0, 0, 1]")).unwrap();
    std::fs::write(place.path("rolled.json"), camera("[0, 1, 0]", "[1, 0, 1]")).unwrap();
    // Up to the cloud, which lamps light.
    std::fs::write(place.path("up.json"), camera("[0, 1, 1]", "[0, 0, 1]")).unwrap();
    let view =
        "[view]\nposition_m = [0.0, -400.0, 2.0]\nheading_deg = 90.0\npitch_deg = 45.0\nsize_px = [32, 18]\n";
    std::fs::write(place.path("v.toml"), view).unwrap();
    let lamps = r#"[{"position_m": [0, 0, 600], "intensity_W_per_sr": 1000}]"#;
    std::fs::write(place.path("lamps.json"), lamps).unwrap();
    let drawn = |words: &[&str]| {
        let (code, _, said) = place.squall(&[words, &["-o", "p.exr"]].concat());
        assert_eq!(code, 0, "{words:?}: {said}");
        read_grey(&place.path("p.exr")).unwrap().pixels
    };
    let render = |camera: &[&str]| drawn(&[&["render", "r.squall"], camera].concat());
    let relight =
        |camera: &[&str]| drawn(&[&["relight", "r.squall", "--lamps", "lamps.json"], camera].concat());
    let own = render(&[]);
    let off = relative_l2(&render(&["--camera", "c.json"]), &own);
    assert!(off < SAME, "{off}");
    let off = relative_l2(&render(&["--camera", "rolled.json"]), &own);
    assert!(off > OTHER, "{off}");
    let small = render(&["--camera", "c.json", "--size", "16", "9"]);
    assert_eq!(small.len(), 16 * 9);
    let off = relative_l2(&relight(&["--view", "v.toml"]), &relight(&["--camera", "up.json"]));
    assert!(off < SAME, "{off}");
    for words in [&["--view", "v.toml", "--camera", "c.json"][..], &[]] {
        let all = [&["relight", "r.squall", "--lamps", "lamps.json", "-o", "p.png"], words].concat();
        assert_eq!(place.squall(&all).0, 2, "{words:?}");
    }
}
