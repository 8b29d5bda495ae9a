//! A parked car: a body lofted through sections, glass, wheels, lights.

use super::materials::Stuff;
use super::shape::Shape;
use super::{HALF_ROAD, Street};
use glam::DVec3;

/// A section across the car: place along it, half width, height of the sill, of the belt line and of the top, half width of the top. Front is +x.
const SECTIONS: [[f64; 6]; 14] = [
    [-2.24, 0.66, 0.40, 0.70, 0.74, 0.55],
    [-2.17, 0.80, 0.30, 0.84, 0.90, 0.64],
    [-1.90, 0.87, 0.22, 0.92, 0.99, 0.70],
    [-1.55, 0.89, 0.19, 0.94, 1.02, 0.68],
    [-1.42, 0.89, 0.18, 0.94, 1.06, 0.66],
    [-0.86, 0.89, 0.18, 0.94, 1.39, 0.56],
    [-0.30, 0.89, 0.18, 0.94, 1.46, 0.57],
    [0.15, 0.89, 0.18, 0.93, 1.45, 0.57],
    [0.48, 0.89, 0.18, 0.93, 1.38, 0.57],
    [1.08, 0.89, 0.18, 0.92, 1.00, 0.68],
    [1.30, 0.88, 0.19, 0.90, 0.96, 0.69],
    [1.80, 0.86, 0.21, 0.83, 0.88, 0.68],
    [2.12, 0.80, 0.28, 0.72, 0.77, 0.64],
    [2.22, 0.68, 0.36, 0.60, 0.64, 0.55],
];
/// Sections and points of the loft.
const ALONG: usize = 56;
const AROUND: usize = 25;

/// Section at a place along the car, smooth between those given (Catmull and Rom's cubic, by place).
fn section(x: f64) -> [f64; 6] {
    let next = SECTIONS.iter().position(|s| s[0] >= x).unwrap_or(SECTIONS.len() - 1).max(1);
    let at = |k: isize| SECTIONS[k.clamp(0, SECTIONS.len() as isize - 1) as usize];
    let [before, from, to, behind] = [-2, -1, 0, 1].map(|k| at(next as isize + k));
    let t = ((x - from[0]) / (to[0] - from[0])).clamp(0.0, 1.0);
    std::array::from_fn(|field| {
        let slope = |a: [f64; 6], b: [f64; 6]| {
            let run = b[0] - a[0];
            if run > 0.0 { (b[field] - a[field]) / run * (to[0] - from[0]) } else { 0.0 }
        };
        let (m0, m1) = (slope(before, to), slope(from, behind));
        // No smoother than keeps a windscreen from swinging over.
        let rise = to[field] - from[field];
        let tame = |m: f64| if m * rise <= 0.0 { 0.0 } else { m.signum() * m.abs().min(3.0 * rise.abs()) };
        let (m0, m1) = (tame(m0), tame(m1));
        let (t2, t3) = (t * t, t * t * t);
        from[field] * (2.0 * t3 - 3.0 * t2 + 1.0)
            + m0 * (t3 - 2.0 * t2 + t)
            + to[field] * (3.0 * t2 - 2.0 * t3)
            + m1 * (t3 - t2)
    })
}

/// A point of the outline of a section, `share` from 0, below on the left, over the top to 1.
fn outline([_, half, sill, belt, top, roof]: [f64; 6], share: f64) -> [f64; 2] {
    let (side, up) = if share <= 0.5 { (1.0, 2.0 * share) } else { (-1.0, 2.0 - 2.0 * share) };
    // From the floor's edge to the middle of the top.
    let corners = [
        [0.90 * half, sill],
        [0.99 * half, sill + 0.10],
        [half, sill + 0.45 * (belt - sill)],
        [0.985 * half, belt - 0.05],
        [0.955 * half, belt],
        [0.4 * (0.955 * half) + 0.6 * roof + 0.02, belt + 0.6 * (top - belt)],
        [roof, top - 0.15 * (top - belt).min(0.25)],
        [0.55 * roof, top - 0.004],
        [0.0, top + 0.012],
    ];
    let at = up.clamp(0.0, 1.0) * (corners.len() - 1) as f64;
    let k = (at as usize).min(corners.len() - 2);
    let t = at - k as f64;
    let mix = |axis: usize| corners[k][axis] + t * (corners[k + 1][axis] - corners[k][axis]);
    [side * mix(0), mix(1)]
}

pub(super) fn build(street: &mut Street) {
    let mut body = Shape::new();
    let [first, last] = [SECTIONS[0][0], SECTIONS[SECTIONS.len() - 1][0]];
    let along = |column: usize| first + (last - first) * column as f64 / (ALONG - 1) as f64;
    let mut places = Vec::new();
    for row in 0..AROUND {
        for column in 0..ALONG {
            let x = along(column);
            let [y, z] = outline(section(x), 1.0 - row as f64 / (AROUND - 1) as f64);
            places.push(DVec3::new(x, y, z));
        }
    }
    let stuff = |column: usize, row: usize| {
        let x = 0.5 * (along(column) + along(column + 1));
        let middle = (AROUND - 1) as f64 * 0.5;
        // 0 at the middle of the top, 1 at the floor's edge.
        let out = ((row as f64 + 0.5 - middle) / middle).abs();
        let pillar = (-0.32..-0.2).contains(&x);
        let side = (0.27..0.49).contains(&out) && (-1.02..0.66).contains(&x) && !pillar;
        let screen = out < 0.25 && ((0.5..1.04).contains(&x) || (-1.36..-0.9).contains(&x));
        Some(if side || screen { Stuff::CarGlass } else { Stuff::CarPaint })
    };
    body.grid(&places, ALONG, true, stuff);
    for (column, flip) in [(0, false), (ALONG - 1, true)] {
        let mut ring: Vec<DVec3> = (0..AROUND).map(|row| places[row * ALONG + column]).collect();
        if flip {
            ring.reverse();
        }
        body.polygon(Stuff::CarPaint, &ring);
    }
    fittings(&mut body);
    wheels(&mut body);
    let at = DVec3::new(-8.2, -(HALF_ROAD - 1.22), 0.02);
    street.add("car", &body.placed(at, 0.015));
}

fn fittings(body: &mut Shape) {
    for side in [-1.0, 1.0] {
        let mut pair = |stuff: Stuff, x: [f64; 2], y: [f64; 2], z: [f64; 2]| {
            let (a, b) = if side < 0.0 { (-y[1], -y[0]) } else { (y[0], y[1]) };
            body.block(stuff, [x[0], a, z[0]], [x[1], b, z[1]]);
        };
        pair(Stuff::TailLight, [-2.235, -2.12], [0.46, 0.80], [0.66, 0.80]);
        pair(Stuff::HeadLight, [2.08, 2.2], [0.44, 0.74], [0.56, 0.69]);
        pair(Stuff::CarPaint, [0.62, 0.8], [0.9, 1.04], [0.93, 1.05]);
        pair(Stuff::CarGlass, [0.612, 0.622], [0.92, 1.02], [0.95, 1.03]);
        pair(Stuff::Chrome, [-0.2, -0.05], [0.88, 0.905], [0.8, 0.825]);
        pair(Stuff::Chrome, [-1.05, -0.9], [0.88, 0.905], [0.8, 0.825]);
        // Sill and the shut line of the doors.
        pair(Stuff::Rubber, [-1.0, 1.05], [0.845, 0.875], [0.17, 0.24]);
        pair(Stuff::Rubber, [-0.265, -0.255], [0.88, 0.8925], [0.3, 0.92]);
        pair(Stuff::Rubber, [0.82, 0.83], [0.88, 0.8925], [0.3, 0.9]);
    }
    body.block(Stuff::Rubber, [-2.29, -0.72, 0.36], [-2.15, 0.72, 0.5]);
    body.block(Stuff::Rubber, [2.14, -0.7, 0.3], [2.27, 0.7, 0.44]);
    body.block(Stuff::Frame, [-2.3, -0.26, 0.52], [-2.22, 0.26, 0.63]);
    body.block(Stuff::Chrome, [-2.25, -0.44, 0.72], [-2.19, 0.44, 0.745]);
    body.block(Stuff::Rubber, [2.17, -0.42, 0.47], [2.235, 0.42, 0.56]);
    body.block(Stuff::Rubber, [-1.95, -0.62, 0.15], [1.95, 0.62, 0.32]);
}

fn wheels(body: &mut Shape) {
    for x in [-1.38, 1.36] {
        for side in [-1.0, 1.0] {
            let hub = DVec3::new(x, side * 0.76, 0.31);
            let out = DVec3::Y * side;
            // The arch is a dark disc a little outside the body.
            body.disc(Stuff::Rubber, hub + out * 0.137, out, 0.36, 22);
            body.tube(Stuff::Rubber, [hub - out * 0.1, hub + out * 0.135], [0.31, 0.31], 20, [false; 2]);
            body.tube(Stuff::Rubber, [hub + out * 0.135, hub + out * 0.155], [0.31, 0.28], 20, [false; 2]);
            body.disc(Stuff::Rubber, hub + out * 0.15, out, 0.285, 20);
            body.disc(Stuff::Chrome, hub + out * 0.153, out, 0.2, 16);
            for spoke in 0..5 {
                let (sin, cos) = libm::sincos(std::f64::consts::TAU * (spoke as f64 + 0.5) / 5.0);
                let gap = hub + out * 0.156 + DVec3::new(cos, 0.0, sin) * 0.12;
                body.disc(Stuff::Rubber, gap, out, 0.045, 8);
            }
        }
    }
}
