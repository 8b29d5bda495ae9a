//! Road, kerbs and pavements.

use super::materials::Stuff;
use super::shape::Shape;
use super::{HALF_LENGTH, HALF_ROAD, HALF_STREET, KERB, Street};
use glam::DVec3;
use squall_runtime::random::{Random, hash};

/// Rise of the road from its gutters to its middle, m.
const CROWN: f64 = 0.085;
/// Middles of the ruts that tyres wear, m from the middle of the road, and their half width and depth, m.
const RUTS: [f64; 4] = [-2.75, -1.15, 1.15, 2.75];
const RUT: [f64; 2] = [0.24, 0.011];
/// Half the width of the line along the middle, m.
const LINE: f64 = 0.07;
/// Where the crossing for people on foot is, m along the street.
pub(super) const CROSSING: [f64; 2] = [15.0, 18.0];

/// A hollow of the road: middle, radii along and across, depth, m.
type Hollow = [f64; 5];

fn unit(parts: &[u64]) -> f64 {
    (hash(parts) >> 11) as f64 / (1u64 << 53) as f64
}

/// Smooth noise from −1 to 1 with waves of about 1.
pub(super) fn noise(x: f64, y: f64, seed: u64) -> f64 {
    let (i, j) = (x.floor(), y.floor());
    let ease = |t: f64| t * t * (3.0 - 2.0 * t);
    let (u, v) = (ease(x - i), ease(y - j));
    let at = |dx: i64, dy: i64| 2.0 * unit(&[seed, (i as i64 + dx) as u64, (j as i64 + dy) as u64]) - 1.0;
    let low = at(0, 0) + u * (at(1, 0) - at(0, 0));
    let high = at(0, 1) + u * (at(1, 1) - at(0, 1));
    low + v * (high - low)
}

fn hollows(seed: u64) -> Vec<Hollow> {
    let mut random = Random::from_parts(&[seed, 71]);
    let mut all = Vec::new();
    for k in 0..26 {
        let side = if k % 2 == 0 { 1.0 } else { -1.0 };
        // Most lie where wheels run and beside the gutters.
        let across = side * random.range(0.5, 3.9);
        let along = -HALF_LENGTH + 2.0 * HALF_LENGTH * (k as f64 + random.range(0.1, 0.9)) / 26.0;
        let size = random.range(0.5, 1.7);
        all.push([along, across, size * random.range(1.0, 2.1), size, random.range(0.018, 0.045)]);
    }
    all
}

/// Height of the road, m.
fn road_height(x: f64, y: f64, hollows: &[Hollow], seed: u64) -> f64 {
    let across = (y / HALF_ROAD).abs();
    let mut height = CROWN * (1.0 - across * across);
    for middle in RUTS {
        let away = (y - middle) / RUT[0];
        // Ruts come and go along the road.
        let worn = (0.65 + 0.6 * noise(0.11 * x, 3.7 * middle, seed ^ 5)).clamp(0.0, 1.2);
        height -= worn * RUT[1] * libm::exp(-away * away);
    }
    for [along, aside, long, wide, deep] in hollows {
        let squared =
            ((x - along) / long) * ((x - along) / long) + ((y - aside) / wide) * ((y - aside) / wide);
        let edge = 0.35 * noise(1.9 * x, 1.9 * y, seed ^ 9);
        height -= deep * libm::exp(-(squared * (1.0 + edge)).max(0.0) * 1.2);
    }
    // Between its gullies the gutter rises and falls, and a road is nowhere quite even.
    let gutter = ((across - 0.72) / 0.28).clamp(0.0, 1.0);
    height -= gutter * 0.008 * (1.0 + libm::cos(x * std::f64::consts::TAU / 12.0));
    height + 0.006 * noise(0.7 * x, 0.7 * y, seed ^ 11)
}

/// Lines across the road at which it has places: close where ruts, paint and gutters are.
fn lines() -> Vec<f64> {
    let mut lines = vec![0.0, LINE];
    let mut y = 0.25;
    while y < HALF_ROAD - 0.01 {
        lines.push(y);
        let near = RUTS.iter().any(|middle| (y - middle).abs() < 0.45);
        y += if near { 0.12 } else { 0.25 };
    }
    lines.push(HALF_ROAD);
    let left: Vec<f64> = lines[1..].iter().rev().map(|y| -y).collect();
    left.into_iter().chain(lines).collect()
}

pub(super) fn build(street: &mut Street, seed: u64) {
    let hollows = hollows(seed);
    let (across, step) = (lines(), 0.3);
    let along: Vec<f64> =
        (0..=(2.0 * HALF_LENGTH / step) as usize).map(|k| -HALF_LENGTH + step * k as f64).collect();
    let mut places = Vec::with_capacity(across.len() * along.len());
    for &y in &across {
        places.extend(along.iter().map(|&x| DVec3::new(x, y, road_height(x, y, &hollows, seed))));
    }
    let stuff = |column: usize, row: usize| {
        let x = along[column] + 0.5 * step;
        let y = 0.5 * (across[row] + across[row + 1]);
        let dash = (x + 240.0) % 6.0 < 3.0;
        let crossing = (CROSSING[0]..CROSSING[1]).contains(&x);
        let stripe = (y + 40.0) % 1.0 < 0.5;
        let stop = (CROSSING[0] - 1.2..CROSSING[0] - 0.8).contains(&x) && y < 0.0;
        let painted = (crossing && stripe && y.abs() < 3.6)
            || stop
            || (!crossing && dash && y.abs() < LINE && x < 13.0);
        Some(if painted { Stuff::Paint } else { Stuff::Asphalt })
    };
    let mut road = Shape::new();
    road.grid(&places, along.len(), true, stuff);
    // Manholes stand a little above the road around them.
    for (x, y) in [(-9.3, 1.9), (6.1, -2.0)] {
        let middle = DVec3::new(x, y, road_height(x, y, &hollows, seed) + 0.008);
        road.disc(Stuff::Iron, middle, DVec3::Z, 0.33, 20);
    }
    street.add("road", &road);
    for side in [-1.0, 1.0] {
        pavement(street, side);
    }
    far_end(street);
}

fn pavement(street: &mut Street, side: f64) {
    let mut shape = Shape::new();
    let face = side * HALF_ROAD;
    // Kerb stones of 1.2 m with a bevelled edge, each a little out of line.
    let stones = (2.0 * HALF_LENGTH / 1.2) as usize;
    for stone in 0..stones {
        let (x0, x1) = (-HALF_LENGTH + 1.2 * stone as f64, -HALF_LENGTH + 1.2 * (stone + 1) as f64 - 0.008);
        let tilt = street.random.range(-0.004, 0.004);
        // Lowered where people cross.
        let crossing = x0 > CROSSING[0] - 0.8 && x1 < CROSSING[1] + 0.8;
        let top = if crossing { 0.035 } else { KERB } + tilt;
        let profile = [(0.0, -0.06), (0.0, top - 0.02), (0.02, top), (0.2, top + 0.002)];
        for pair in profile.windows(2) {
            let at = |x: f64, (out, z): (f64, f64)| DVec3::new(x, face + side * out, z);
            let mut corners = [at(x0, pair[0]), at(x1, pair[0]), at(x1, pair[1]), at(x0, pair[1])];
            if side < 0.0 {
                corners.reverse();
            }
            shape.quad(Stuff::Kerb, corners);
        }
    }
    // Slabs, each lying a little differently, with a fall of 2 % to the kerb.
    let (columns, rows) = ((2.0 * HALF_LENGTH / 0.9) as usize, 5);
    let wide = (HALF_STREET - HALF_ROAD - 0.2) / rows as f64;
    for row in 0..rows {
        for column in 0..=columns {
            let shift = if row % 2 == 0 { 0.0 } else { 0.45 };
            let x0 = (-HALF_LENGTH - shift + 0.9 * column as f64).max(-HALF_LENGTH);
            let x1 = (-HALF_LENGTH - shift + 0.9 * (column + 1) as f64).min(HALF_LENGTH);
            if x1 - x0 < 0.02 {
                continue;
            }
            let out = [HALF_ROAD + 0.2 + wide * row as f64, HALF_ROAD + 0.2 + wide * (row + 1) as f64];
            let lift: [f64; 4] = std::array::from_fn(|_| street.random.range(-0.005, 0.003));
            let crossing = (CROSSING[0] - 0.8..CROSSING[1] + 0.8).contains(&(0.5 * (x0 + x1)));
            let rise = |out: f64| {
                let from_kerb = out - HALF_ROAD - 0.2;
                let low = if crossing { 0.085 * (1.0 - (from_kerb / 1.4).min(1.0)) } else { 0.0 };
                KERB - low + 0.02 * from_kerb
            };
            let at = |x: f64, out: f64, lift: f64| DVec3::new(x, side * out, rise(out) + lift);
            let mut corners = [
                at(x0, out[0], lift[0]),
                at(x1, out[0], lift[1]),
                at(x1, out[1], lift[2]),
                at(x0, out[1], lift[3]),
            ];
            if side < 0.0 {
                corners.reverse();
            }
            shape.quad(Stuff::Slab, corners);
        }
    }
    // What lies below the joints.
    let mut bed = [
        DVec3::new(-HALF_LENGTH, side * (HALF_ROAD + 0.1), KERB - 0.03),
        DVec3::new(HALF_LENGTH, side * (HALF_ROAD + 0.1), KERB - 0.03),
        DVec3::new(HALF_LENGTH, side * HALF_STREET, KERB + 0.03),
        DVec3::new(-HALF_LENGTH, side * HALF_STREET, KERB + 0.03),
    ];
    if side < 0.0 {
        bed.reverse();
    }
    shape.quad(Stuff::Slab, bed);
    street.add(if side < 0.0 { "pavement right" } else { "pavement left" }, &shape);
    // Gullies in the gutter: bars over a sump.
    let mut gully = Shape::new();
    gully.block(Stuff::SteelDark, [-0.25, -0.2, -0.05], [0.25, 0.2, -0.028]);
    for bar in 0..7 {
        let x = -0.22 + 0.07 * bar as f64;
        gully.block(Stuff::Iron, [x - 0.018, -0.2, -0.028], [x + 0.018, 0.2, 0.004]);
    }
    let places = [-18.0, -6.0, 6.0].map(|x| (DVec3::new(x, side * (HALF_ROAD - 0.21), -0.008), 0.0));
    street.add_at(if side < 0.0 { "gully right" } else { "gully left" }, &gully, &places);
}

/// The street that crosses at the far end.
fn far_end(street: &mut Street) {
    let mut shape = Shape::new();
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let wide = 26.0;
    let (near, far) = (HALF_LENGTH, HALF_LENGTH + 7.0);
    shape.quad(
        Stuff::Asphalt,
        [at(near, -wide, 0.01), at(far, -wide, 0.01), at(far, wide, 0.01), at(near, wide, 0.01)],
    );
    shape.block(Stuff::Slab, [far, -wide, -0.1], [far + 2.0, wide, KERB]);
    street.add("crossing street", &shape);
}
