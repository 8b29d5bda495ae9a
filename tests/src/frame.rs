//! Pictures from an asset alone: where their light comes from, and that they repeat.

use glam::DVec3;
use squall_bake::pipeline;
use squall_bake::progress::Quiet;
use squall_bake::recipe::Recipe;
use squall_formats::container::{self, OutSection};
use squall_formats::section::response::{self, COEFFICIENT_BYTES, ResponseRows, ResponseSection};
use squall_formats::section::view::{ViewFlash, ViewSection};
use squall_runtime::picture::Picture;
use squall_runtime::{Asset, Frame, StormRenderer};
use std::path::Path;
use std::sync::OnceLock;

const SIZE: [u32; 2] = [96, 64];

/// A small storm: a ball of cloud 3 km away, a stroke in it and one below, rain; baked once for all tests here.
pub(crate) fn sections() -> &'static [OutSection] {
    static BAKED: OnceLock<Vec<OutSection>> = OnceLock::new();
    BAKED.get_or_init(|| bake(RECIPE))
}

/// The same storm by another recipe.
pub(crate) fn bake(text: &str) -> Vec<OutSection> {
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path());
    let recipe = folder.path().join("small.toml");
    std::fs::write(&recipe, text).unwrap();
    pipeline::bake(&Recipe::read(&recipe).unwrap(), &Quiet).unwrap().sections
}

pub(crate) const RECIPE: &str = r#"
[clouds]
scene = "ball.json"
[clouds.lightning]
spacing_m = 300.0
prune = true
[clouds.response]
distant = ["upper-sky", "lower-sky"]
test_strokes = 0
[rain]
[[strokes]]
name = "inside"
seed = 3
from_m = [-200.0, 3000.0, 1000.0]
to_m = [300.0, 3100.0, 1300.0]
intensity_W_per_sr = 1e6
[[strokes]]
name = "ground"
seed = 4
from_m = [0.0, 2900.0, 800.0]
to_m = [100.0, 2700.0, 10.0]
intensity_W_per_sr = 1e6
[view]
position_m = [0.0, 0.0, 2.0]
heading_deg = 90.0
pitch_deg = 15.0
size_px = [96, 64]
flashes = ["inside"]
"#;

pub(crate) fn write_scene(folder: &Path) {
    const N: usize = 12;
    let mut density = vec![0.0f32; N * N * N];
    for (index, value) in density.iter_mut().enumerate() {
        let cell = DVec3::new((index % N) as f64, (index / N % N) as f64, (index / N / N) as f64);
        let away = (cell - 5.5).length();
        *value = (1.3 - away / 5.0).clamp(0.0, 1.0) as f32;
    }
    std::fs::write(folder.join("ball.f32"), bytemuck::cast_slice(&density)).unwrap();
    let scene = r#"{"dims_xyz": [12, 12, 12], "cell_m": 100.0, "origin_m": [-600.0, 2400.0, 500.0],
        "density_file": "ball.f32", "kappa_per_m": 0.02, "albedo": 0.999, "g": 0.85}"#;
    std::fs::write(folder.join("ball.json"), scene).unwrap();
}

pub(crate) fn asset(sections: &[OutSection]) -> Asset {
    let mut bytes = Vec::new();
    container::write(&mut bytes, sections).unwrap();
    Asset::from_bytes(&bytes).unwrap()
}

fn draw(asset: &Asset, change: impl Fn(&mut ViewSection)) -> Picture {
    let mut renderer = StormRenderer::new(asset).unwrap();
    let mut view = renderer.view().unwrap().clone();
    change(&mut view);
    renderer.render(&Frame::from(&view)).unwrap().clone()
}

fn sum(picture: &Picture) -> f64 {
    picture.pixels.iter().flatten().map(|&v| f64::from(v)).sum()
}

/// The same sections with every lamp's coefficients set to zero; rows of distant light stay.
fn with_dark_rows(whole: &Asset) -> Vec<OutSection> {
    let response = whole.section(ResponseSection::TAG, "response", ResponseSection::read).unwrap();
    let head = response.head.clone();
    let nothing = vec![0u8; head.basis.count() * COEFFICIENT_BYTES];
    let lamps = response.row_count() - head.distant.len();
    let row = |i: usize| if i < lamps { nothing.clone() } else { response.row(i).unwrap().to_vec() };
    let rows = (0..response.row_count()).map(row).collect();
    let bounds = (0..response.row_count()).flat_map(|i| response.bounds_of(i).to_vec()).collect();
    let dark = response::write(&head, ResponseRows { rows, bounds });
    let keep = |section: &OutSection| {
        if section.tag == ResponseSection::TAG { dark.clone() } else { section.clone() }
    };
    sections().iter().map(keep).collect()
}

#[test]
fn the_flash_in_the_picture_comes_from_the_assets_rows() {
    let whole = asset(sections());
    let dark = |view: &mut ViewSection| view.flashes.clear();
    let flash = sum(&draw(&whole, |_| ())) - sum(&draw(&whole, dark));
    let zeroed = asset(&with_dark_rows(&whole));
    let direct = sum(&draw(&zeroed, |_| ())) - sum(&draw(&zeroed, dark));
    // A stroke behind some ten mean free paths: what was scattered once is a small part of what comes out.
    assert!(direct > 0.0, "the direct term needs no rows: {direct}");
    assert!(direct < 0.5 * flash, "direct {direct} of {flash}");
}

#[test]
fn a_picture_repeats_to_the_bit_and_from_used_memory() {
    let asset = asset(sections());
    let [mut fresh, mut used] = [0, 1].map(|_| StormRenderer::new(&asset).unwrap());
    let mut view = fresh.view().unwrap().clone();
    view.rain.rate_mm_per_h = 25.0;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let frame = Frame::from(&view);
    fresh.render(&frame).unwrap();
    view.camera.heading_rad += 0.3;
    view.rain.rate_mm_per_h = 2.0;
    view.sky.haze = 3.0;
    used.render(&Frame::from(&view)).unwrap();
    pool.install(|| used.render(&frame).map(|_| ())).unwrap();
    assert_eq!(fresh.picture(), used.picture());
}

#[test]
fn any_number_of_threads_draws_the_same_picture_at_both_qualities() {
    use squall_runtime::frame::FrameQuality;
    let asset = asset(sections());
    let mut view = StormRenderer::new(&asset).unwrap().view().unwrap().clone();
    view.rain.rate_mm_per_h = 25.0;
    for quality in [FrameQuality::STILL, FrameQuality::PREVIEW] {
        let frame = Frame::from(&view).quality(quality);
        let [one, two, three] = [1, 2, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut renderer = StormRenderer::new(&asset).unwrap();
            pool.install(|| renderer.render(&frame).unwrap().clone())
        });
        assert!(one == two && one == three, "{quality:?}");
    }
}

#[test]
fn a_later_frame_of_a_flash_is_the_one_that_a_renderer_draws_which_kept_nothing() {
    use squall_runtime::formats::units::Seconds;
    let asset = asset(sections());
    let [mut fresh, mut used] = [0, 1].map(|_| StormRenderer::new(&asset).unwrap());
    let mut view = fresh.view().unwrap().clone();
    view.rain.rate_mm_per_h = 25.0;
    view.rain.wind_m_per_s = [8.0, 3.0, 0.0];
    let first = Frame::from(&view);
    let mut later = first.clone().time(Seconds(0.2));
    later.flashes.iter_mut().for_each(|flash| flash.brightness *= 0.3);
    used.render(&first).unwrap();
    used.render(&later).unwrap();
    assert_eq!(fresh.render(&later).unwrap(), used.picture());
    assert!(!later.flashes.is_empty() && used.report().strokes_kept == later.flashes.len());
}

#[test]
fn twice_the_brightness_adds_twice_the_light() {
    let asset = asset(sections());
    let lit = |brightness: f64| {
        let picture = draw(&asset, |view| view.flashes[0].brightness = brightness);
        sum(&picture)
    };
    let dark = sum(&draw(&asset, |view| view.flashes.clear()));
    let (one, two) = (lit(1.0) - dark, lit(2.0) - dark);
    /// Single precision sums over pixels, and clamping of cells that codec noise makes negative.
    const ROUND_OFF: f64 = 1e-3;
    assert!((two / one - 2.0).abs() < ROUND_OFF, "{one} {two}");
}

#[test]
fn heavier_rain_leaves_less_to_be_seen() {
    let asset = asset(sections());
    // The ground stroke's channel stands 2.7 km away: what is left of it is what visibility means.
    let channel = |rate: f64| {
        let flash = |view: &mut ViewSection, on: bool| {
            view.rain.rate_mm_per_h = rate;
            view.flashes.clear();
            if on {
                view.flashes.push(ViewFlash { stroke: "ground".into(), brightness: 1.0 });
            }
        };
        let lit = draw(&asset, |view| flash(view, true));
        let dark = draw(&asset, |view| flash(view, false));
        let most = |picture: &Picture| picture.pixels.iter().map(|p| p[2]).fold(0.0f32, f32::max);
        most(&lit) - most(&dark)
    };
    let clear = channel(0.0);
    let seen: Vec<f32> = [2.0, 25.0, 75.0].map(channel).into_iter().map(|v| v / clear).collect();
    assert!(seen[0] < 1.0 && seen[1] < 0.5 * seen[0] && seen[2] < 0.5 * seen[1], "{seen:?}");
}

#[test]
fn a_view_that_cannot_be_drawn_is_refused_by_name() {
    let asset = asset(sections());
    let mut renderer = StormRenderer::new(&asset).unwrap();
    let mut refused = |change: &dyn Fn(&mut ViewSection), words: &str| {
        let mut view = renderer.view().unwrap().clone();
        change(&mut view);
        let text = renderer.render(&Frame::from(&view)).unwrap_err().to_string();
        assert!(text.contains(words), "{text}");
    };
    refused(&|v| v.flashes[0].stroke = "nobody".into(), "inside, ground");
    refused(&|v| v.rain.rate_mm_per_h = 300.0, "mm/h");
    refused(&|v| v.camera.size_px = [0, 3], "picture size");
    refused(&|v| v.camera.vertical_fov_rad = f64::NAN, "fov");
}

#[test]
fn an_eye_inside_the_cloud_sees_light_and_no_nonsense() {
    let asset = asset(sections());
    let picture = draw(&asset, |view| {
        view.camera.position_m = [10.0, 3010.0, 1110.0];
        view.rain.rate_mm_per_h = 10.0;
        view.detail.amplitude = 1.0;
    });
    assert_eq!([picture.width as u32, picture.height as u32], SIZE);
    assert!(picture.pixels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
    assert!(sum(&picture) > 0.0);
}
