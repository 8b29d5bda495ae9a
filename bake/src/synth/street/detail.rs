//! What surfaces look like close up: grain, joints, stains, by a material's name and by place alone, so that pictures from anywhere agree.

use glam::{DVec3, Vec3};
use squall_runtime::random::hash;

/// A surface where it is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Share of light that it reflects.
    pub base: [f32; 3],
    /// Perceptual roughness.
    pub roughness: f32,
    /// Unit normal.
    pub normal: Vec3,
}

fn unit(parts: &[u64]) -> f64 {
    (hash(parts) >> 11) as f64 / (1u64 << 53) as f64
}

fn cell(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.floor() as i64 as u64).collect()
}

/// Smooth noise from −1 to 1 with waves of about 1.
fn noise(place: DVec3, seed: u64) -> f64 {
    let low = place.floor();
    let share = place - low;
    let share = share * share * (3.0 - 2.0 * share);
    let [i, j, k] = low.to_array().map(|at| at as i64);
    let at = |corner: i64| {
        let (x, y, z) = (corner & 1, corner >> 1 & 1, corner >> 2);
        2.0 * unit(&[seed, (i + x) as u64, (j + y) as u64, (k + z) as u64]) - 1.0
    };
    let mix = |a: f64, b: f64, t: f64| a + t * (b - a);
    let row = |first: i64| mix(at(first), at(first + 1), share.x);
    let plane = |first: i64| mix(row(first), row(first + 2), share.y);
    mix(plane(0), plane(4), share.z)
}

/// Noise of several waves, each half as long and high as the one before.
fn rough(place: DVec3, waves: u32, seed: u64) -> f64 {
    (0..waves)
        .map(|wave| {
            let fine = f64::from(1u32 << wave);
            noise(place * fine, seed + u64::from(wave)) / fine
        })
        .sum()
}

fn scaled(base: [f32; 3], factor: f64) -> [f32; 3] {
    base.map(|band| (f64::from(band) * factor).clamp(0.0, 0.95) as f32)
}

/// A normal leaned by a gradient along the ground or the wall.
fn leaned(normal: Vec3, by: DVec3) -> Vec3 {
    let by = by.as_vec3();
    (normal - (by - normal * by.dot(normal))).normalize_or(normal)
}

/// The look of a material at a place. `footprint` is the side of what a sample stands for, m: what is finer is left out.
pub fn look(name: &str, place: DVec3, own: Look, footprint: f64) -> Look {
    let fine = |size: f64| (1.5 - footprint / size).clamp(0.0, 1.0);
    match name {
        "asphalt" => asphalt(place, own, fine),
        "road paint" => worn_paint(place, own, fine),
        "brick" | "brick dark" => brick(place, own, fine),
        "concrete slabs" | "granite kerb" | "stone" => {
            let stain = 1.0 + 0.22 * rough(place * 1.3, 3, 31) + 0.12 * fine(0.01) * noise(place * 160.0, 37);
            let lean = DVec3::new(noise(place * 60.0, 41), noise(place * 60.0, 43), 0.0) * 0.03 * fine(0.02);
            Look { base: scaled(own.base, stain), normal: leaned(own.normal, lean), ..own }
        }
        "plaster" | "plaster grey" => {
            // Streaks of dirt run down.
            let streaks = noise(DVec3::new(place.x * 5.0, place.y * 5.0, place.z * 0.35), 47);
            let stain = 1.0 + 0.12 * rough(place * 0.8, 4, 53) + 0.09 * streaks;
            let foot = (1.0 - (place.z - 0.2) * 0.5).clamp(0.0, 1.0);
            Look { base: scaled(own.base, stain * (1.0 - 0.35 * foot)), ..own }
        }
        "roof" | "steel dark" | "cast iron" | "awning red" | "awning white" | "awning green" => {
            let stain = 1.0 + 0.15 * rough(place * 2.0, 3, 59);
            Look { base: scaled(own.base, stain), ..own }
        }
        _ => own,
    }
}

/// Stones in tar: light and dark grains, patches, tracks polished by tyres, cracks.
fn asphalt(place: DVec3, own: Look, fine: impl Fn(f64) -> f64) -> Look {
    let grain = place * 110.0;
    let flat = DVec3::new(grain.x, grain.y, 0.0);
    let key = cell(&[flat.x, flat.y]);
    let stone = unit(&[61, key[0], key[1]]) - 0.5;
    let patches = rough(DVec3::new(place.x, place.y, 0.0) * 0.45, 4, 67);
    let track = |middle: f64| {
        let away = (place.y.abs() - middle) / 0.3;
        libm::exp(-away * away)
    };
    let worn =
        (track(1.15) + track(2.75)).min(1.0) * (0.75 + 0.3 * noise(DVec3::new(place.x * 0.2, 0.0, 0.0), 71));
    // Cracks where a noise passes through zero.
    let path = rough(DVec3::new(place.x, place.y, 0.0) * 0.7, 3, 73);
    let broken = (3.0 * noise(DVec3::new(place.x, place.y, 0.0) * 0.23, 75) - 0.6).clamp(0.0, 1.0);
    let crack = broken * (1.0 - path.abs() / 0.005).clamp(0.0, 1.0) * fine(0.02);
    let oil = (1.0 - place.y.abs().min((place.y.abs() - 1.95).abs()) / 0.35).clamp(0.0, 1.0) * 0.18;
    let tone =
        (1.0 + 0.3 * patches - 0.22 * worn - oil) * (1.0 + 0.75 * stone * fine(0.012)) * (1.0 - 0.5 * crack);
    let tilt = |seed: u64| unit(&[seed, key[0], key[1]]) - 0.5;
    let lean = DVec3::new(tilt(79), tilt(83), 0.0) * (0.5 * fine(0.012) * (1.0 - 0.6 * worn));
    Look {
        base: scaled(own.base, tone),
        roughness: own.roughness - 0.22 * worn as f32,
        normal: leaned(own.normal, lean),
    }
}

fn worn_paint(place: DVec3, own: Look, fine: impl Fn(f64) -> f64) -> Look {
    let worn =
        rough(DVec3::new(place.x, place.y, 0.0) * 3.0, 5, 89) + 0.25 * noise(place * 90.0, 91) * fine(0.02);
    let left = ((worn + 0.42) * 4.0).clamp(0.0, 1.0) as f32;
    let below = asphalt(place, Look { base: [0.085, 0.085, 0.09], roughness: 0.9, ..own }, fine);
    let mix = |a: f32, b: f32| a + left * (b - a);
    let base = std::array::from_fn(|band| mix(below.base[band], own.base[band]));
    Look { base, roughness: mix(below.roughness, own.roughness), normal: below.normal }
}

/// Bricks of 22 by 7 cm with joints of 1 cm, each row shifted by half.
fn brick(place: DVec3, own: Look, fine: impl Fn(f64) -> f64) -> Look {
    let along = if own.normal.y.abs() > own.normal.x.abs() { place.x } else { place.y };
    let row = (place.z / 0.075).floor();
    let shifted = along / 0.23 + 0.5 * (row - 2.0 * (0.5 * row).floor());
    let key = cell(&[shifted, row]);
    let within = [shifted - shifted.floor(), place.z / 0.075 - row];
    let joint = within[0] < 0.045 || within[1] < 0.14;
    let tint = 0.72 + 0.56 * unit(&[97, key[0], key[1]]);
    let stain = 1.0 + 0.2 * rough(place * 0.6, 4, 101) + 0.12 * noise(place * 45.0, 103) * fine(0.03);
    let foot = 1.0 - 0.3 * (1.0 - (place.z - 0.2) * 0.5).clamp(0.0, 1.0);
    let sharp = fine(0.03) as f32;
    let mortar = [0.24, 0.225, 0.2f32];
    let brick = scaled(own.base, tint);
    let shown = |band: usize| {
        let here = if joint { mortar[band] } else { brick[band] };
        let mean = 0.2 * mortar[band] + 0.8 * own.base[band];
        mean + sharp * (here - mean)
    };
    let tilt = |seed: u64| (unit(&[seed, key[0], key[1]]) - 0.5) * 0.06 * fine(0.05);
    let lean = if joint { DVec3::ZERO } else { DVec3::new(tilt(107), tilt(109), tilt(113)) };
    Look {
        base: scaled([shown(0), shown(1), shown(2)], stain * foot),
        normal: leaned(own.normal, lean),
        ..own
    }
}
