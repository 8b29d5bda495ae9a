use super::*;
use crate::camera::Projection;
use crate::depth::DepthKind;
use crate::rain::kernel::Footprint;
use crate::rain::{Surroundings, pattern::tests::set};
use crate::random::Random;
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
fn a_list_that_is_drawn_in_parts_gives_the_bytes_of_one_that_is_drawn_at_once() {
    let whole = drawn(&set(), None, usize::MAX);
    assert!(whole.1.iter().any(|alpha| *alpha > 0.2));
    for part in [1, 7, 100] {
        assert!(drawn(&set(), None, part) == whole, "{part} at a time");
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
