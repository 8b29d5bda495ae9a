//! The shape of a thunderstorm: bubbles on bubbles for the towers, a drawn profile for the anvil.
//!
//! A tower is a union of spheres in three generations, each sitting on the surface of the one before, as
//! cauliflower does; noise displaces the surface below the smallest sphere. The anvil is a lens that spreads
//! downwind (+x) from the tower's top, crisp and knuckled upwind, fibrous downwind, with pouches below.

use super::{CloudKind, SynthCloud};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use squall_formats::GridShape;
use squall_runtime::noise::{Lattice, smoothstep};
use squall_runtime::random::{Random, hash};

/// Size of the grid, m, whatever its cells.
const SIZE: [f64; 3] = [16_800.0, 9_600.0, 9_600.0];
/// Lowest corner, m above ground: x is downwind, y away from the usual viewer.
const ORIGIN: [f64; 3] = [-7_800.0, -4_800.0, 1_400.0];
/// The flat base, m above ground: where rising air saturates.
const BASE: f32 = 1_600.0;
/// The anvil's flat top: the tropopause, m above ground.
const LID: f32 = 9_500.0;
/// Nothing of the anvil hangs below this, m above ground.
const LOWEST_ANVIL: f32 = 5_900.0;
/// Where the main tower stands at the base, m.
const ROOT: [f32; 2] = [-2_700.0, 0.0];
/// How far the shear carries the tower downwind at the anvil, m.
const LEAN: f32 = 1_500.0;
/// Width of the edge, from clear air to full water, m.
const EDGE: f32 = 220.0;
/// Extinction at density 1, 1/m. A real core has ten times as much; this one lets a flash inside show.
const KAPPA: f64 = 0.012;

/// Noise and edge move a surface by less than this; farther from it the answer is known without noise, m.
const REACH: f32 = 620.0;

/// Samples per cell and axis; a cell's density is their mean.
const SAMPLES: usize = 2;
/// Side of the buckets that spheres are sorted into, m.
const BUCKET: f32 = 600.0;

#[derive(Clone, Copy)]
struct Bubble {
    centre: Vec3,
    radius: f32,
}

/// Spheres by the buckets that they reach into.
struct Bubbles {
    buckets: Vec<Vec<Bubble>>,
    counts: [usize; 3],
}

struct Storm {
    bubbles: Bubbles,
    lattice: Lattice,
}

pub fn synth(seed: u64, shape: GridShape) -> SynthCloud {
    let storm = Storm::new(seed);
    let counts = shape.to_array();
    let cell: [f64; 3] = std::array::from_fn(|axis| SIZE[axis] / counts[axis] as f64);
    let density = (0..shape.len())
        .into_par_iter()
        .map(|index| {
            let at = shape.cell(index);
            let centre: [f32; 3] =
                std::array::from_fn(|axis| (ORIGIN[axis] + (at[axis] as f64 + 0.5) * cell[axis]) as f32);
            let half = 0.5 * Vec3::from_array(cell.map(|c| c as f32)).length();
            if storm.is_clear(Vec3::from_array(centre), half) {
                return 0.0;
            }
            let mut sum = 0.0;
            for sample in 0..SAMPLES * SAMPLES * SAMPLES {
                let sub = [sample % SAMPLES, sample / SAMPLES % SAMPLES, sample / (SAMPLES * SAMPLES)];
                let point: [f32; 3] = std::array::from_fn(|axis| {
                    let inside = (sub[axis] as f64 + 0.5) / SAMPLES as f64;
                    (ORIGIN[axis] + (at[axis] as f64 + inside) * cell[axis]) as f32
                });
                sum += storm.density(Vec3::from_array(point));
            }
            let mean = sum / (SAMPLES * SAMPLES * SAMPLES) as f32;
            // Wisps below a hundredth scatter nothing that shows, and zeros cost nothing.
            if mean < 0.01 { 0.0 } else { mean.min(1.0) }
        })
        .collect();
    SynthCloud {
        kind: CloudKind::Storm,
        seed,
        shape,
        cell,
        origin: ORIGIN,
        density,
        kappa: KAPPA,
        albedo: 0.999,
        asymmetry: 0.85,
    }
}

/// Axis of the main tower at height `z`.
fn trunk(z: f32) -> Vec3 {
    let up = ((z - BASE) / (LID - BASE)).clamp(0.0, 1.2);
    Vec3::new(ROOT[0] + LEAN * up * up.sqrt(), ROOT[1], z)
}

impl Bubbles {
    fn new(bubbles: &[Bubble]) -> Self {
        let counts: [usize; 3] = std::array::from_fn(|axis| (SIZE[axis] as f32 / BUCKET).ceil() as usize);
        let mut buckets = vec![Vec::new(); counts.iter().product()];
        for bubble in bubbles {
            let reach = Vec3::splat(bubble.radius + REACH);
            let corner = Vec3::from_array(ORIGIN.map(|o| o as f32));
            let range = |axis: usize| {
                let low = ((bubble.centre - reach - corner)[axis] / BUCKET).max(0.0) as usize;
                let high = ((bubble.centre + reach - corner)[axis] / BUCKET).max(0.0) as usize;
                low..(high + 1).min(counts[axis])
            };
            for z in range(2) {
                for y in range(1) {
                    for x in range(0) {
                        buckets[x + counts[0] * (y + counts[1] * z)].push(*bubble);
                    }
                }
            }
        }
        Self { buckets, counts }
    }

    /// Signed distance to the union's surface, negative inside, m; large where nothing is near.
    fn distance(&self, point: Vec3) -> f32 {
        let corner = Vec3::from_array(ORIGIN.map(|o| o as f32));
        let at = ((point - corner) / BUCKET).max(Vec3::ZERO);
        let [x, y, z] = [at.x as usize, at.y as usize, at.z as usize];
        let [x, y, z] = [x.min(self.counts[0] - 1), y.min(self.counts[1] - 1), z.min(self.counts[2] - 1)];
        self.buckets[x + self.counts[0] * (y + self.counts[1] * z)]
            .iter()
            .fold(f32::MAX, |nearest, bubble| nearest.min((point - bubble.centre).length() - bubble.radius))
    }
}

/// Spheres of the next generation on the surfaces of `parents`, outward and upward ones only.
fn sprout(random: &mut Random, parents: &[Bubble], count: usize, size: [f64; 2]) -> Vec<Bubble> {
    let mut children = Vec::new();
    for parent in parents {
        for _ in 0..count {
            let mut direction = random.direction();
            direction.z = direction.z.abs() * 1.1 - 0.45;
            let direction = direction.normalize_or(DVec3::Z).as_vec3();
            let radius = parent.radius * random.range(size[0], size[1]) as f32;
            let centre = parent.centre + direction * (parent.radius - 0.25 * radius);
            let buried =
                parents.iter().any(|other| (centre - other.centre).length() < other.radius - 0.8 * radius);
            if !buried {
                children.push(Bubble { centre, radius });
            }
        }
    }
    children
}

impl Storm {
    fn new(seed: u64) -> Self {
        let mut random = Random::from_parts(&[seed, 0x570_0001]);
        let mut first = Vec::new();
        let mut put = |centre: Vec3, radius: f32| first.push(Bubble { centre, radius });

        // The main tower: rings of large bubbles along a leaning axis, broad below, narrower in the middle.
        let mut z = BASE + 300.0;
        let mut turn = random.unit();
        while z < LID - 700.0 {
            let up = (z - BASE) / (LID - BASE);
            let ring = 1_500.0 - 950.0 * smoothstep(0.0, 0.5, up) + 450.0 * smoothstep(0.75, 1.0, up);
            for _ in 0..4 {
                turn += 0.25 + random.range(-0.06, 0.06);
                let (sin, cos) = libm::sincos(std::f64::consts::TAU * turn);
                let out = ring * random.range(0.75, 1.2) as f32;
                let radius = random.range(880.0, 1_280.0) as f32;
                let jitter = random.range(-250.0, 250.0) as f32;
                put(trunk(z) + Vec3::new(out * cos as f32, out * sin as f32, jitter), radius);
            }
            turn += 0.11;
            z += 900.0;
        }
        // The overshooting dome, above the lid.
        let top = trunk(LID);
        put(top + Vec3::new(-250.0, 0.0, -650.0), 1_300.0);
        put(top + Vec3::new(350.0, -300.0, -600.0), 1_050.0);

        // Younger towers upwind and on the near side, lower the further out: the flanking line.
        for (i, angle) in [172.0f64, 215.0, 250.0, 132.0, 300.0, 345.0, 30.0].into_iter().enumerate() {
            let angle = (angle + random.range(-9.0, 9.0)).to_radians();
            let out = [3_200.0, 2_900.0, 2_300.0, 2_900.0, 2_500.0, 2_600.0, 2_200.0][i]
                + random.range(-200.0, 200.0);
            let tall = [3_300.0, 4_400.0, 6_100.0, 5_000.0, 4_300.0, 3_200.0, 5_600.0][i]
                + random.range(-400.0, 400.0);
            let (sin, cos) = libm::sincos(angle);
            let (foot_x, foot_y) = (f64::from(ROOT[0]) + out * cos, f64::from(ROOT[1]) + out * sin);
            let mut z = f64::from(BASE) + 200.0;
            while z < tall {
                let up = (z - f64::from(BASE)) / (tall - f64::from(BASE));
                let radius = (900.0 - 300.0 * up) * random.range(0.85, 1.15);
                let drift = 500.0 * up;
                let (dx, dy) = (random.range(-260.0, 260.0), random.range(-260.0, 260.0));
                put(
                    DVec3::new(foot_x + drift + dx, foot_y + dy, z.min(tall - radius * 0.6)).as_vec3(),
                    radius as f32,
                );
                z += radius * 0.75;
            }
        }
        // Knuckles where the anvil pushes against the wind.
        for _ in 0..12 {
            let angle = random.range(100.0, 262.0).to_radians();
            let (sin, cos) = libm::sincos(angle);
            let out = random.range(2_000.0, 2_700.0);
            let height = f64::from(LID) - random.range(550.0, 900.0);
            let centre = trunk(LID).as_dvec3() + DVec3::new(out * cos, out * sin, 0.0);
            put(DVec3::new(centre.x, centre.y, height).as_vec3(), random.range(480.0, 700.0) as f32);
        }

        let second = sprout(&mut random, &first, 16, [0.34, 0.55]);
        let third = sprout(&mut random, &second, 7, [0.36, 0.55]);
        let all: Vec<Bubble> = first.into_iter().chain(second).chain(third).collect();
        Self { bubbles: Bubbles::new(&all), lattice: Lattice::new(hash(&[seed, 0x570_0002]) as u32) }
    }

    /// Whether a ball around `centre` surely holds no cloud.
    fn is_clear(&self, centre: Vec3, radius: f32) -> bool {
        centre.z + radius < BASE - 60.0
            || (centre.z + radius < LOWEST_ANVIL && self.bubbles.distance(centre) > REACH + radius)
    }

    fn density(&self, point: Vec3) -> f32 {
        let base = BASE + 60.0 * self.lattice.fractal(point.with_z(0.0) / 900.0, 2, 0.5);
        if point.z < base {
            return 0.0;
        }
        self.tower(point, base).max(self.anvil(point))
    }

    fn tower(&self, point: Vec3, base: f32) -> f32 {
        let rough = self.bubbles.distance(point);
        if rough > REACH {
            return 0.0;
        }
        let water = self.water(point.z, base);
        if rough < -REACH {
            return water;
        }
        let swirl = Vec3::new(
            self.lattice.fractal(point / 1_100.0, 2, 0.5),
            self.lattice.fractal(point / 1_100.0 + Vec3::splat(31.5), 2, 0.5),
            self.lattice.fractal(point / 1_100.0 + Vec3::splat(67.5), 2, 0.5),
        );
        let moved = point + 230.0 * swirl;
        let mut distance = self.bubbles.distance(moved);
        // Round bulges: the surface comes out near a feature point and goes in between two.
        distance += 150.0 * (self.lattice.cells(moved / 620.0) - 0.5);
        distance += 80.0 * (self.lattice.cells(moved / 310.0 + Vec3::splat(5.5)) - 0.5);
        smoothstep(0.35 * EDGE, -0.65 * EDGE, distance) * water
    }

    /// Water of rising saturated air: grows with height, falls out as ice near the top.
    fn water(&self, z: f32, base: f32) -> f32 {
        let up = ((z - base) / 5_500.0).clamp(0.0, 1.0);
        let ice = 1.0 - 0.55 * smoothstep(7_000.0, 9_200.0, z);
        (0.38 + 0.62 * up) * ice * smoothstep(0.0, 90.0, z - base)
    }

    fn anvil(&self, point: Vec3) -> f32 {
        if point.z < LOWEST_ANVIL || point.z > LID + 400.0 {
            return 0.0;
        }
        let centre = trunk(LID);
        // Drawn out along the wind: one metre across counts as much as 1.6 along.
        let (along, across) = (point.x - centre.x, 1.6 * (point.y - centre.y));
        let angle = libm::atan2f(across, along);
        let cos = libm::cosf(angle);
        // Reach in each direction: 2.7 km against the wind, 3.5 km across, 9 km with it.
        let downwind = 0.5 + 0.5 * cos;
        let reach = 2_700.0 + 6_300.0 * libm::powf(downwind, 1.1);
        let rim = Vec3::new(libm::cosf(angle), libm::sinf(angle), 0.0);
        let reach = reach * (1.0 + 0.14 * self.lattice.fractal(rim * 2.2, 3, 0.6));
        let out = (along * along + across * across).sqrt() / reach;
        if out > 1.4 {
            return 0.0;
        }
        // Fibres drawn out by the wind, finer with distance from the tower.
        let fibre = self.lattice.fractal(
            Vec3::new(along / 2_600.0, across / 420.0, point.z / 700.0 + along / 5_000.0),
            4,
            0.55,
        );
        let out = out - 0.22 * fibre * smoothstep(0.2, 0.9, out) * downwind;
        let lid = LID - 160.0 * out * out + 70.0 * self.lattice.fractal(point.with_z(0.0) / 1_300.0, 2, 0.5);
        let depth = 450.0 + 2_300.0 * libm::expf(-3.2 * out);
        // Pouches under the outer half: round and hanging, one every kilometre.
        let pouch = (0.66 - self.lattice.cells(point.with_z(0.0) / 950.0)).max(0.0);
        let hang = 1_150.0 * pouch * smoothstep(0.25, 0.45, out) * (1.0 - smoothstep(0.8, 1.0, out));
        let bottom = lid - (depth * (1.0 - smoothstep(0.5, 1.1, out))).max(380.0) - hang;
        let above = smoothstep(120.0, -60.0, point.z - lid);
        let below = smoothstep(-120.0, 120.0, point.z - bottom);
        let edge = 1.0 - smoothstep(0.86, 1.02, out);
        let thin = 0.34 - 0.22 * smoothstep(0.15, 1.0, out);
        above * below * edge * thin * (1.0 + 0.5 * fibre)
    }
}
