//! What stands on pavements: lamps, a traffic light, bollards, bins, a bench, a hydrant.

use super::ground::CROSSING;
use super::materials::Stuff;
use super::shape::Shape;
use super::{HALF_ROAD, KERB, Street};
use glam::DVec3;
use squall_scene::LampKind;
use std::f64::consts::PI;

/// Radiant intensity of a street lamp straight down, W/sr: some 1500 cd.
const LAMP: [f64; 3] = [2.9, 2.15, 1.2];
/// Height of a street lamp, m, and how far it hangs over the road.
const LAMP_HEIGHT: f64 = 6.4;
const LAMP_ARM: f64 = 1.7;

pub(super) fn build(street: &mut Street) {
    lamps(street);
    signals(street);
    let mut bollard = Shape::new();
    bollard.tube(Stuff::SteelDark, [DVec3::ZERO, DVec3::Z * 0.85], [0.07, 0.06], 8, [false, true]);
    bollard.tube(Stuff::Frame, [DVec3::Z * 0.66, DVec3::Z * 0.73], [0.066, 0.066], 8, [false; 2]);
    let posts = [-1.5, 0.0, 1.5].map(|dx| (DVec3::new(10.5 + dx, HALF_ROAD + 0.5, KERB), 0.0));
    street.add_at("bollard", &bollard, &posts);

    let mut bin = Shape::new();
    bin.tube(Stuff::Plastic, [DVec3::Z * 0.06, DVec3::Z * 0.9], [0.24, 0.28], 10, [true, false]);
    bin.tube(Stuff::SteelDark, [DVec3::Z * 0.9, DVec3::Z * 1.0], [0.29, 0.2], 10, [true, true]);
    let bins =
        [(-11.0, 1.0), (7.4, -1.0)].map(|(x, side)| (DVec3::new(x, side * (HALF_ROAD + 0.75), KERB), 0.0));
    street.add_at("bin", &bin, &bins);

    let mut bench = Shape::new();
    for slat in 0..3 {
        let y = -0.22 + 0.15 * slat as f64;
        bench.block(Stuff::ShopFloor, [-0.9, y, 0.43], [0.9, y + 0.12, 0.47]);
    }
    for slat in 0..2 {
        let z = 0.6 + 0.16 * slat as f64;
        bench.block(Stuff::ShopFloor, [-0.9, 0.24, z], [0.9, 0.28, z + 0.12]);
    }
    for x in [-0.75, 0.7] {
        bench.block(Stuff::SteelDark, [x, -0.22, 0.0], [x + 0.05, 0.24, 0.43]);
        bench.block(Stuff::SteelDark, [x, 0.24, 0.0], [x + 0.05, 0.29, 0.9]);
    }
    street.add_at("bench", &bench, &[(DVec3::new(-6.6, HALF_ROAD + 2.55, KERB + 0.045), 0.0)]);

    let mut hydrant = Shape::new();
    hydrant.tube(Stuff::GoodsRed, [DVec3::ZERO, DVec3::Z * 0.55], [0.12, 0.11], 8, [false, true]);
    hydrant.tube(Stuff::GoodsRed, [DVec3::Z * 0.55, DVec3::Z * 0.68], [0.13, 0.05], 8, [true, true]);
    hydrant.tube(
        Stuff::Steel,
        [DVec3::new(-0.18, 0.0, 0.42), DVec3::new(0.18, 0.0, 0.42)],
        [0.05; 2],
        6,
        [true; 2],
    );
    street.add_at("hydrant", &hydrant, &[(DVec3::new(-13.4, -(HALF_ROAD + 0.5), KERB), 0.6)]);
}

fn lamps(street: &mut Street) {
    // Stands at its foot; the arm points along +y.
    let mut lamp = Shape::new();
    lamp.tube(Stuff::SteelDark, [DVec3::ZERO, DVec3::Z * 0.9], [0.12, 0.09], 8, [false; 2]);
    lamp.tube(Stuff::SteelDark, [DVec3::Z * 0.9, DVec3::Z * LAMP_HEIGHT], [0.07, 0.045], 8, [false; 2]);
    let mut last = DVec3::Z * LAMP_HEIGHT;
    for step in 1..=4 {
        let along = step as f64 / 4.0;
        let next = DVec3::new(0.0, LAMP_ARM * along, LAMP_HEIGHT + 0.35 * libm::sin(along * 0.5 * PI));
        lamp.tube(Stuff::SteelDark, [last, next], [0.045 - 0.004 * step as f64; 2], 6, [false; 2]);
        last = next;
    }
    let head = last;
    let (low, high) = (head + DVec3::new(-0.13, -0.3, -0.03), head + DVec3::new(0.13, 0.3, 0.08));
    lamp.cuboid(Stuff::SteelDark, low, high, [false; 6]);
    let glow = [
        DVec3::new(low.x + 0.03, high.y - 0.05, low.z - 0.006),
        DVec3::new(high.x - 0.03, high.y - 0.05, low.z - 0.006),
        DVec3::new(high.x - 0.03, low.y + 0.12, low.z - 0.006),
        DVec3::new(low.x + 0.03, low.y + 0.12, low.z - 0.006),
    ];
    lamp.quad(Stuff::LampGlow, glow);
    let right = [-17.5, -1.0, 13.2].map(|x| (DVec3::new(x, -(HALF_ROAD + 0.42), KERB - 0.01), 0.0));
    let left = [-9.0, 6.5].map(|x| (DVec3::new(x, HALF_ROAD + 0.42, KERB - 0.01), PI));
    let places: Vec<(DVec3, f64)> = right.into_iter().chain(left).collect();
    street.add_at("street lamp", &lamp, &places);
    for (number, (at, yaw)) in places.iter().enumerate() {
        let out = if *yaw == 0.0 { 1.0 } else { -1.0 };
        let place = *at + DVec3::new(0.0, out * head.y, head.z - 0.1);
        let kind = LampKind::Spot { direction: DVec3::NEG_Z, cosines: [0.62, 0.12] };
        street.lamp(&format!("street lamp {number}"), place, LAMP, kind);
    }
}

fn signals(street: &mut Street) {
    let mut signal = Shape::new();
    signal.tube(Stuff::SteelDark, [DVec3::ZERO, DVec3::Z * 3.7], [0.07, 0.06], 8, [false, true]);
    signal.block(Stuff::SteelDark, [-0.32, -0.17, 2.6], [-0.07, 0.17, 3.62]);
    for (number, z) in [2.78, 3.11, 3.44].into_iter().enumerate() {
        let middle = DVec3::new(-0.325, 0.0, z);
        let stuff = if number == 2 { Stuff::SignalRed } else { Stuff::SignalOff };
        signal.disc(stuff, middle, DVec3::NEG_X, 0.11, 14);
        // A hood over each lens.
        for k in 0..5 {
            let angle = |k: usize| PI * (0.1 + 0.8 * k as f64 / 5.0);
            let rim = |k: usize, out: f64| {
                let (sin, cos) = libm::sincos(angle(k));
                middle + DVec3::new(-out, 0.135 * cos, 0.135 * sin)
            };
            signal.quad(Stuff::SteelDark, [rim(k, 0.0), rim(k, 0.2), rim(k + 1, 0.2), rim(k + 1, 0.0)]);
            signal.quad(Stuff::SteelDark, [rim(k + 1, 0.0), rim(k + 1, 0.2), rim(k, 0.2), rim(k, 0.0)]);
        }
    }
    let x = CROSSING[1] + 0.5;
    let places = [
        (DVec3::new(x, -(HALF_ROAD + 0.4), KERB - 0.08), 0.0),
        (DVec3::new(x, HALF_ROAD + 0.4, KERB - 0.08), 0.0),
    ];
    street.add_at("traffic light", &signal, &places);
}
