//! Signs of neon: letters of strokes, bent of tubes.

use super::materials::Stuff;
use super::shape::Shape;
use glam::DVec3;

/// A letter's strokes as chains of points in a box one high and .6 wide, from its lower left corner.
fn strokes(letter: char) -> &'static [&'static [[f64; 2]]] {
    match letter {
        'A' => &[&[[0.0, 0.0], [0.3, 1.0], [0.6, 0.0]], &[[0.12, 0.4], [0.48, 0.4]]],
        'B' => &[
            &[[0.0, 0.0], [0.0, 1.0], [0.42, 1.0], [0.55, 0.86], [0.55, 0.66], [0.42, 0.54], [0.0, 0.54]],
            &[[0.42, 0.54], [0.6, 0.4], [0.6, 0.14], [0.44, 0.0], [0.0, 0.0]],
        ],
        'C' => &[&[
            [0.6, 0.82],
            [0.44, 1.0],
            [0.16, 1.0],
            [0.0, 0.82],
            [0.0, 0.18],
            [0.16, 0.0],
            [0.44, 0.0],
            [0.6, 0.18],
        ]],
        'D' => &[&[[0.0, 0.0], [0.0, 1.0], [0.4, 1.0], [0.6, 0.8], [0.6, 0.2], [0.4, 0.0], [0.0, 0.0]]],
        'E' => &[&[[0.58, 1.0], [0.0, 1.0], [0.0, 0.0], [0.58, 0.0]], &[[0.0, 0.52], [0.46, 0.52]]],
        'F' => &[&[[0.58, 1.0], [0.0, 1.0], [0.0, 0.0]], &[[0.0, 0.52], [0.46, 0.52]]],
        'H' => &[&[[0.0, 0.0], [0.0, 1.0]], &[[0.6, 0.0], [0.6, 1.0]], &[[0.0, 0.5], [0.6, 0.5]]],
        'L' => &[&[[0.0, 1.0], [0.0, 0.0], [0.55, 0.0]]],
        'N' => &[&[[0.0, 0.0], [0.0, 1.0], [0.6, 0.0], [0.6, 1.0]]],
        'O' => &[&[
            [0.16, 0.0],
            [0.0, 0.18],
            [0.0, 0.82],
            [0.16, 1.0],
            [0.44, 1.0],
            [0.6, 0.82],
            [0.6, 0.18],
            [0.44, 0.0],
            [0.16, 0.0],
        ]],
        'P' => &[&[[0.0, 0.0], [0.0, 1.0], [0.44, 1.0], [0.6, 0.86], [0.6, 0.6], [0.44, 0.46], [0.0, 0.46]]],
        'R' => &[
            &[[0.0, 0.0], [0.0, 1.0], [0.44, 1.0], [0.6, 0.86], [0.6, 0.6], [0.44, 0.46], [0.0, 0.46]],
            &[[0.3, 0.46], [0.6, 0.0]],
        ],
        'S' => &[&[
            [0.6, 0.85],
            [0.44, 1.0],
            [0.16, 1.0],
            [0.0, 0.85],
            [0.0, 0.66],
            [0.6, 0.36],
            [0.6, 0.15],
            [0.44, 0.0],
            [0.16, 0.0],
            [0.0, 0.15],
        ]],
        'T' => &[&[[0.0, 1.0], [0.6, 1.0]], &[[0.3, 1.0], [0.3, 0.0]]],
        _ => &[],
    }
}

/// Radius of a tube, m.
const TUBE: f64 = 0.022;

/// A word of tubes whose letters are `height` tall: its first letter's lower left corner is at `at`, `right` and `up` say which way it reads.
pub(super) fn word(
    shape: &mut Shape,
    stuff: Stuff,
    text: &str,
    at: DVec3,
    (right, up): (DVec3, DVec3),
    (height, advance): (f64, DVec3),
) {
    for (number, letter) in text.chars().enumerate() {
        let corner = at + advance * number as f64;
        for chain in strokes(letter) {
            for pair in chain.windows(2) {
                let point = |[x, y]: [f64; 2]| corner + height * (right * x + up * y);
                shape.tube(stuff, [point(pair[0]), point(pair[1])], [TUBE; 2], 4, [true; 2]);
            }
        }
    }
}

/// A frame of tube around a rectangle from `at`.
pub(super) fn frame(shape: &mut Shape, stuff: Stuff, at: DVec3, (width, height): (DVec3, DVec3)) {
    let corners = [at, at + width, at + width + height, at + height];
    for k in 0..4 {
        shape.tube(stuff, [corners[k], corners[(k + 1) % 4]], [TUBE * 0.8; 2], 4, [true; 2]);
    }
}
