//! The pictures' kernel against closed forms and what any kernel must keep.

use super::*;
use squall_runtime::random::Random;

const SIDE: i32 = 240;
const ALL: Clip = Clip { left: 0, top: 0, right: SIDE, bottom: SIDE };
/// Shares are rounded to single precision, and as many as a patch of a few thousand pixels has are added.
const ROUNDED: f64 = 1e-6;

/// A highlight off the middle and stripes, black around: nothing that mirroring or turning would hide.
fn uneven() -> Grey {
    let (width, height) = (24, 90);
    let light = |i: usize| {
        let (x, y) = (i % width, i / width);
        let inside = (5..17).contains(&x) && (8..80).contains(&y);
        let stripes = 1 + (x * x + 3 * y) % 7;
        if inside { stripes as f32 / 7.0 * (0.2 + 0.8 * (x as f32 - 5.0) / 12.0) } else { 0.0 }
    };
    Grey { width, height, pixels: (0..width * height).map(light).collect() }
}

fn even() -> Grey {
    Grey { width: 7, height: 13, pixels: vec![0.5; 7 * 13] }
}

fn footprint(random: &mut Random) -> Footprint {
    let angle = random.range(0.0, 7.0);
    Footprint {
        centre: [random.range(119.0, 121.0), random.range(119.0, 121.0)],
        axis: [libm::cos(angle), libm::sin(angle)],
        length: random.range(0.0, 120.0),
        width: libm::exp2(random.range(-6.0, 4.0)),
        pattern: random.bits() as u32,
        ..Footprint::default()
    }
}

/// What lands in the picture; each pixel may be put once, inside the clip, and padded.
fn pixels(set: &PictureSet, footprint: &Footprint, clip: Clip) -> Vec<f32> {
    let mut pixels = vec![f32::NAN; (SIDE * SIDE) as usize];
    set.draw(footprint, clip, &mut Default::default(), &mut |span| {
        assert!(span.count >= 1 && span.shares.len() % BLOCK == 0 && span.shares.len() >= span.count);
        assert!(span.x >= clip.left && span.x + span.count as i32 <= clip.right);
        assert!((clip.top..clip.bottom).contains(&span.y));
        for (i, &share) in span.shares[..span.count].iter().enumerate() {
            let pixel = &mut pixels[(span.y * SIDE + span.x) as usize + i];
            assert!(pixel.is_nan() && share >= 0.0);
            *pixel = share;
        }
    });
    pixels.into_iter().map(|share| if share.is_nan() { 0.0 } else { share }).collect()
}

#[test]
fn an_even_picture_is_a_rectangles_coverage_of_each_pixel() {
    let set = PictureSet::new(&[even()], 4);
    // Lengths of [low, high] ∩ [i, i + 1].
    let overlap = |low: f64, high: f64, i: i32| {
        let (first, end) = (f64::from(i), f64::from(i) + 1.0);
        (high.min(end) - low.max(first)).max(0.0)
    };
    for (length, width) in [(0.0, 0.3), (31.3, 0.04), (17.9, 2.3), (5.2, 40.1)] {
        for axis in [[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]] {
            let centre = [100.37, 119.81];
            let footprint = Footprint { centre, axis, length, width, pattern: 0, ..Footprint::default() };
            let drawn = pixels(&set, &footprint, ALL);
            let long = length + width;
            let size = if axis[0] == 0.0 { [width, long] } else { [long, width] };
            for (i, &share) in drawn.iter().enumerate() {
                let at = [i as i32 % SIDE, i as i32 / SIDE];
                let [across, down] = [0, 1]
                    .map(|k| overlap(centre[k] - 0.5 * size[k], centre[k] + 0.5 * size[k], at[k]) / size[k]);
                let wanted = across * down;
                assert!(
                    (f64::from(share) - wanted).abs() < ROUNDED,
                    "{footprint:?} {at:?}: {share} {wanted}"
                );
            }
        }
    }
}

#[test]
fn a_picture_drawn_upright_at_its_own_size_is_the_picture() {
    let picture = uneven();
    let set = PictureSet::new(std::slice::from_ref(&picture), 4);
    let body = body(&picture);
    assert_eq!(body, Body { u: [5.0 / 24.0, 17.0 / 24.0], v: [8.0 / 90.0, 80.0 / 90.0] });
    // u runs along x where the drop falls down the picture.
    let middle = [100.0 + 11.0, 100.0 + 44.0];
    let footprint = Footprint {
        centre: middle,
        axis: [0.0, 1.0],
        length: 60.0,
        width: 12.0,
        pattern: 3,
        ..Footprint::default()
    };
    let drawn = pixels(&set, &footprint, ALL);
    let total: f64 = picture.pixels.iter().map(|&light| f64::from(light)).sum();
    for (i, &light) in picture.pixels.iter().enumerate() {
        let at = (100 + i / 24) * SIDE as usize + 100 + i % 24;
        assert!((f64::from(drawn[at]) - f64::from(light) / total).abs() < ROUNDED, "{i}");
    }
}

#[test]
fn shares_of_any_footprint_add_up_to_one() {
    let (set, mut random) = (PictureSet::new(&[uneven(), even()], 4), Random::new(3));
    for _ in 0..200 {
        let footprint = footprint(&mut random);
        let total: f64 = pixels(&set, &footprint, ALL).iter().map(|&share| f64::from(share)).sum();
        assert!((total - 1.0).abs() < ROUNDED, "{footprint:?}: {total}");
    }
}

#[test]
fn a_leaning_streak_is_its_picture_averaged_over_every_pixel() {
    /// Of the largest share: light moves by some tenths of a rectangle, of 1/4 and of 1/16 of a pixel; the latter
    /// is near to what 32 × 32 points a pixel are off themselves.
    const SPREAD: [f64; 2] = [0.1, 0.025];
    let (picture, mut random) = (uneven(), Random::new(6));
    let sets = [4, 16].map(|per_pixel| PictureSet::new(std::slice::from_ref(&picture), per_pixel));
    let body = body(&picture);
    let total: f64 = picture.pixels.iter().map(|&light| f64::from(light)).sum();
    for _ in 0..6 {
        let footprint = Footprint { width: random.range(2.0, 6.0), length: 40.0, ..footprint(&mut random) };
        let Footprint { centre, axis: [x, y], length, width, .. } = footprint;
        let scale = [24.0 * body.width() / width, 90.0 * body.length() / (length + width)];
        let middle = [12.0 * (body.u[0] + body.u[1]), 45.0 * (body.v[0] + body.v[1])];
        let point = |px: f64, py: f64| {
            let (dx, dy) = (px - centre[0], py - centre[1]);
            let column = (middle[0] + (dx * y - dy * x) * scale[0]).floor();
            let row = (middle[1] + (dx * x + dy * y) * scale[1]).floor();
            let inside = (0.0..24.0).contains(&column) && (0.0..90.0).contains(&row);
            if inside { f64::from(picture.pixels[row as usize * 24 + column as usize]) } else { 0.0 }
        };
        let drawn = sets.each_ref().map(|set| pixels(set, &footprint, ALL));
        let largest = f64::from(drawn[1].iter().copied().fold(0.0, f32::max));
        for i in 0..drawn[0].len() {
            let (left, top) = (f64::from(i as i32 % SIDE), f64::from(i as i32 / SIDE));
            if (left - centre[0]).abs() > 40.0 || (top - centre[1]).abs() > 40.0 {
                assert!(drawn[0][i] == 0.0 && drawn[1][i] == 0.0);
                continue;
            }
            let mut sum = 0.0;
            for s in 0..1024 {
                sum += point(left + (f64::from(s % 32) + 0.5) / 32.0, top + (f64::from(s / 32) + 0.5) / 32.0);
            }
            let wanted = sum / 1024.0 / total * scale[0] * scale[1];
            for (drawn, spread) in drawn.iter().zip(SPREAD) {
                let off = (f64::from(drawn[i]) - wanted).abs() / largest;
                assert!(off < spread, "{footprint:?} {i}: {} {wanted}, {off}", drawn[i]);
            }
        }
    }
}

#[test]
fn a_footprint_cut_into_clips_is_the_same_footprint_and_stays_within_its_bounds() {
    let (set, mut random) = (PictureSet::new(&[uneven(), even()], 4), Random::new(5));
    for _ in 0..30 {
        let footprint = footprint(&mut random);
        let whole = pixels(&set, &footprint, ALL);
        let [x, y] = [0, 1].map(|_| random.range(100.0, 140.0) as i32);
        let mut cut = vec![0.0; whole.len()];
        for [left, right] in [[0, x], [x, x + 3], [x + 3, SIDE]] {
            for [top, bottom] in [[0, y], [y, y + 1], [y + 1, SIDE]] {
                let part = pixels(&set, &footprint, Clip { left, top, right, bottom });
                cut.iter_mut().zip(part).for_each(|(sum, share)| *sum += share);
            }
        }
        assert!(whole == cut, "{footprint:?}");
        let bounds = set.place(&footprint).unwrap().0;
        for (i, _) in whole.iter().enumerate().filter(|(_, share)| **share > 0.0) {
            let (x, y) = (i as i32 % SIDE, i as i32 / SIDE);
            assert!(x >= bounds.left && x < bounds.right && y >= bounds.top && y < bounds.bottom);
        }
    }
}

#[test]
fn what_is_no_streak_draws_nothing() {
    let set = PictureSet::new(&[even()], 4);
    let streak = Footprint {
        centre: [9.0; 2],
        axis: [0.0, 1.0],
        length: 9.0,
        width: 1.0,
        pattern: 0,
        ..Footprint::default()
    };
    assert!(set.place(&streak).is_some() && PictureSet::new(&[], 4).place(&streak).is_none());
    for broken in [
        Footprint { width: 0.0, ..streak },
        Footprint { width: f64::NAN, ..streak },
        Footprint { length: f64::INFINITY, ..streak },
        Footprint { axis: [0.0; 2], ..streak },
        Footprint { centre: [f64::NAN, 0.0], ..streak },
    ] {
        assert_eq!(set.place(&broken), None, "{broken:?}");
        assert!(pixels(&set, &broken, ALL).iter().all(|&share| share == 0.0));
    }
}
