use super::*;
use crate::camera::Projection;
use crate::depth::DepthKind;
use crate::rain::kernel::Footprint;
use crate::rain::{Surroundings, pattern::tests::set};
use crate::random::Random;
use crate::shade::streak::{StreakSet, tests::fine_line};
use glam::DVec3;
use squall_formats::units::Radians;

const SIZE: [usize; 2] = [300, 150];

fn camera() -> Camera {
    let projection = Projection::Perspective { vertical_fov: Radians(1.0) };
    Camera::new(DVec3::Z * 2.0, DVec3::X, DVec3::Z, projection, SIZE.map(|side| side as u32)).unwrap()
}

/// Streaks of every lean, thin and wide, some beyond the picture.
fn streaks(count: usize) -> Vec<Streak> {
    let mut random = Random::new(21);
    let streak = |id: u64| {
        let [x, y] = [random.range(-20.0, 320.0), random.range(-20.0, 170.0)];
        let [dx, dy] = [random.range(-40.0, 40.0), random.range(-60.0, 60.0)];
        let width = libm::exp2(random.range(-4.0, 3.5)) as f32;
        Streak {
            id,
            ends: [[(x - dx) as f32, (y - dy) as f32], [(x + dx) as f32, (y + dy) as f32]],
            end_depths: [4.0, 6.0],
            depth: 5.0,
            diameter: 1.0,
            width,
            coverage: 30.0 * width,
            pattern: random.bits() as u32,
            class: 0,
            inside: true,
        }
    };
    (0..count as u64).map(streak).collect()
}

/// The picture and the mask of some streaks, so many drawn at a time.
fn drawn<K: Kernel>(kernel: &K, depth: Option<&[f32]>, part: usize) -> (Vec<[f32; 3]>, Vec<f32>) {
    let light = Surroundings { above: [1.0, 2.0, 3.0], below: [0.5; 3], ..Default::default() };
    let depth = depth.map(|m| DepthBuffer::new(m, SIZE[0], SIZE[1], DepthKind::Planar).unwrap());
    let scene = Scene { depth, kernel, light: &light, gain: 1.0 };
    let mut picture = Picture::new(SIZE[0], SIZE[1]).unwrap();
    picture.pixels.fill([0.25; 3]);
    let mut canvas = Canvas::default();
    let grid = [SIZE[0].div_ceil(TILE[0]), SIZE[1].div_ceil(TILE[1])];
    canvas.draw(&camera(), &scene, (&streaks(160), part), grid, &mut picture);
    (picture.pixels, canvas.mask)
}

#[test]
fn a_list_that_is_drawn_in_parts_gives_the_picture_of_one_that_is_drawn_at_once() {
    /// What lies over each other is added up in another order.
    const ROUND_OFF: f32 = 2e-6;
    let whole = drawn(&set(), None, usize::MAX);
    assert!(whole.1.iter().any(|alpha| *alpha > 0.2));
    for part in [1, 7, 100] {
        let parts = drawn(&set(), None, part);
        let values = parts.0.as_flattened().iter().chain(&parts.1);
        let wanted = whole.0.as_flattened().iter().chain(&whole.1);
        for (value, wanted) in values.zip(wanted) {
            assert!((value - wanted).abs() < ROUND_OFF, "{part} at a time: {value} {wanted}");
        }
    }
}

/// A kernel that hands on spans where the other may hand on ribbons.
struct Spans<'a, K>(&'a K);

impl<K: Kernel> Kernel for Spans<'_, K> {
    type Scratch = K::Scratch;
    type Placed = K::Placed;

    fn place(&self, footprint: &Footprint) -> Option<(Clip, K::Placed)> {
        self.0.place(footprint)
    }

    fn draw(
        &self,
        placed: &K::Placed,
        clip: Clip,
        scratch: &mut K::Scratch,
        put: &mut impl FnMut(crate::rain::Span),
    ) {
        self.0.draw(placed, clip, scratch, put);
    }
}

#[test]
fn ribbons_lie_where_the_spans_of_the_same_streaks_do_with_a_scene_and_without() {
    /// Tiles that a streak is cut into see the same light along it to the round-off of its place.
    const ROUND_OFF: f32 = 1e-4;
    let depth: Vec<f32> = (0..SIZE[0] * SIZE[1]).map(|i| if i % 37 < 20 { 5.0 } else { 9.0 }).collect();
    let set = set();
    for depth in [None, Some(&depth[..])] {
        let (ribbons, mask) = drawn(&set, depth, 50);
        let (spans, span_mask) = drawn(&Spans(&set), depth, 50);
        let pixels = ribbons.as_flattened().iter().chain(&mask);
        let others = spans.as_flattened().iter().chain(&span_mask);
        assert!(mask.iter().any(|alpha| *alpha > 0.2));
        for (at, (a, b)) in pixels.zip(others).enumerate() {
            assert!((a - b).abs() < ROUND_OFF, "{at}: {a} {b}");
        }
    }
    let hidden = drawn(&set, Some(&vec![1.0; SIZE[0] * SIZE[1]]), 50);
    assert!(hidden.1.iter().all(|alpha| *alpha == 0.0));
}

#[test]
fn what_a_tile_shows_of_a_streak_is_what_its_pixels_do() {
    let streak = |depths: [f32; 2]| Streak { end_depths: depths, ..streaks(1)[0] };
    let metres = vec![8.0; SIZE[0] * SIZE[1]];
    let secants = camera().secants();
    let clip = Clip { left: 128, top: 64, right: 256, bottom: 128 };
    for kind in [DepthKind::Planar, DepthKind::Range] {
        let buffer = DepthBuffer::new(&metres, SIZE[0], SIZE[1], kind).unwrap();
        let reach = hidden::Reach::new(&buffer, &secants, clip);
        for depths in [[2.0, 3.0], [9.0, 8.5], [4.0, 20.0], [7.6, 7.7]] {
            let streak = streak(depths);
            let line = hidden::DepthLine::new(&streak, &streak.footprint());
            let pixels = (0..SIZE[0] * SIZE[1]).map(|i| (i % SIZE[0], i / SIZE[0]));
            let inside = pixels.filter(|(x, y)| (128..256).contains(x) && (64..128).contains(y));
            let hidden = inside.map(|(x, y)| line.hidden(&secants, &buffer, x, y));
            match reach.of(&streak) {
                Seen::Everywhere => assert!(!hidden.into_iter().any(|hidden| hidden), "{depths:?}"),
                Seen::Nowhere => assert!(hidden.into_iter().all(|hidden| hidden), "{depths:?}"),
                Seen::InPlaces => assert!(depths != [2.0, 3.0] && depths != [9.0, 8.5]),
            }
        }
    }
}

/// One streak of a drop `width` pixels wide, upright and 100 pixels long, its column's middle at x = 150.3.
fn upright(width: f32) -> Streak {
    Streak {
        ends: [[150.3, 25.0], [150.3, 125.0]],
        end_depths: [5.0, 5.0],
        width,
        // The disc's own, over the time that it takes.
        coverage: std::f32::consts::FRAC_PI_4 * width * width,
        ..streaks(1)[0]
    }
}

/// A white picture before one streak whose drop shows no light, or all that `light` says, and its mask.
fn one_streak<L: RainLight>(streak: Streak, light: &L) -> (Vec<[f32; 3]>, Vec<f32>) {
    let kernel = StreakSet::new(&fine_line());
    let scene = Scene { depth: None, kernel: &kernel, light, gain: 1.0 };
    let mut picture = Picture::new(SIZE[0], SIZE[1]).unwrap();
    picture.pixels.fill([1.0; 3]);
    let mut canvas = Canvas::default();
    let grid = [SIZE[0].div_ceil(TILE[0]), SIZE[1].div_ceil(TILE[1])];
    canvas.draw(&camera(), &scene, (&[streak], PART), grid, &mut picture);
    (picture.pixels, canvas.mask)
}

#[test]
fn a_dark_drop_whose_light_would_be_a_fine_line_hides_all_of_its_band() {
    /// A parabola of the chord's variance stands for the chord: a twentieth of its peak, an eighth at its ends.
    const SHAPE: f64 = 0.06;
    /// Tables' and window's sums, and the light of single precision.
    const ENERGY: f64 = 5e-3;
    let area_left_of = |t: f64| {
        let t = t.clamp(-1.0, 1.0);
        0.5 + (t * (1.0 - t * t).sqrt() + libm::asin(t)) / std::f64::consts::PI
    };
    for width in [0.3f32, 0.9, 2.5, 3.8, 9.0] {
        let streak = upright(width);
        let (pixels, mask) = one_streak(streak, &|_: &crate::camera::Ray, _: f64| [0.0; 3]);
        let hidden: f64 = pixels.iter().map(|pixel| f64::from(1.0 - pixel[1])).sum();
        let covered: f64 = mask.iter().map(|alpha| f64::from(*alpha)).sum();
        let wanted = f64::from(streak.coverage);
        for found in [hidden, covered] {
            assert!((found / wanted - 1.0).abs() < ENERGY, "{width}: {found} of {wanted}");
        }
        // In the middle of its path, a pixel is covered as long as the disc's chords over it take to pass.
        let peak = wanted / 100.0 * 4.0 / (std::f64::consts::PI * f64::from(width.max(1.0)));
        for x in 140..161 {
            let side = |at: f64| area_left_of((at - 150.3) / (0.5 * f64::from(width)));
            let chords = wanted / 100.0 * (side(f64::from(x) + 1.0) - side(f64::from(x)));
            let found = f64::from(mask[75 * SIZE[0] + x as usize]);
            // A lattice's narrowest box spreads an edge by an eighth of a pixel.
            let slack = if f64::from(width) < 1.0 { 0.3 } else { 0.0 };
            assert!(
                (found - chords).abs() < (2.0 * SHAPE + slack) * peak,
                "{width}, {x}: {found} for {chords}"
            );
        }
    }
}

#[test]
fn a_bright_drop_shines_in_its_fine_line_and_still_hides_its_band() {
    let streak = upright(9.0);
    let (pixels, mask) = one_streak(streak, &|_: &crate::camera::Ray, _: f64| [3.0; 3]);
    let row = |x: usize| 75 * SIZE[0] + x;
    // Light that is added to what is left of the white behind.
    let shown = |x: usize| f64::from(pixels[row(x)][0] - (1.0 - mask[row(x)]));
    let all: f64 = (140..161).map(shown).sum();
    let line: f64 = (149..152).map(shown).sum();
    let column: f64 = (149..152).map(|x| f64::from(mask[row(x)])).sum();
    let covered: f64 = (140..161).map(|x| f64::from(mask[row(x)])).sum();
    assert!(line > 0.9 * all && column < 0.5 * covered, "{} {}", line / all, column / covered);
    assert!((all / (3.0 * covered) - 1.0).abs() < 0.1, "{all} {covered}");
}

/// Light of one radiance in a world of that radiance.
struct Even;

impl RainLight for Even {
    fn radiance(&self, _: &crate::camera::Ray, _: f64) -> [f32; 3] {
        [1.0; 3]
    }

    fn contrast(&self, _: &crate::camera::Ray, _: f64) -> f32 {
        crate::rain::light::contrast_of(1.0, 0.0, 0.0)
    }
}

#[test]
fn in_an_even_world_no_drop_can_be_seen_whatever_its_pattern() {
    for width in [0.3, 2.5, 9.0] {
        let (pixels, mask) = one_streak(upright(width), &Even);
        assert!(mask.iter().any(|alpha| *alpha > 1e-4));
        assert!(pixels.as_flattened().iter().all(|value| (value - 1.0).abs() < 1e-6), "{width}");
    }
}
