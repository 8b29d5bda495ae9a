//! Pictures of streaks from a seed: an oscillating raindrop falls past the camera while the shutter is open.
//!
//! At many moments of the exposure rays are traced through the drop as it then is, into overcast sky, wet ground,
//! a skyline and lights; what each sees is spread along the way that the drop falls until the next moment. So
//! rims, highlights and the beat of the oscillations come from optics and surface tension, as in Garg and
//! Nayar's \[garg-nayar\] pictures, and none of them is drawn.
//!
//! Light is what the drop sends; the background is black. The drop is far away against its size: rays are
//! parallel.

mod optics;
pub mod scene;
mod shape;
mod surroundings;

use crate::error::BakeError;
use crate::input::picture::Grey;
use crate::input::streak_notes::StreakNotes;
use crate::output::write_atomically;
use crate::progress::Progress;
use crate::streak::preview::write_png16;
use glam::DVec3;
use rayon::prelude::*;
use scene::Scene;
use shape::{DropShape, Mode};
use squall_formats::drops::fall_speed;
use squall_formats::section::streak::{DropNotes, SceneNotes};
use squall_formats::units::Millimetres;
use squall_runtime::random::{Random, hash};
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};
use surroundings::{LightPlace, Surroundings};

/// Width of a picture, px, and of the drop in it.
const WIDTH: usize = 32;
const DIAMETER: f64 = 16.0;
/// Black rows above and below the drop's path.
const MARGIN: f64 = 6.0;
/// Rays per pixel along each axis, at each moment.
const RAYS: f64 = 3.0;
/// Outside of this share of the drop's radius they stand this many times closer along each axis.
const INNER: f64 = 0.8;
const FINER: usize = 2;
/// Way of the drop between two moments, px.
const STEP: f64 = 0.5;
/// Diameters of the drops, mm: where drops oscillate most, in step with the eddies of their wake \[beard-kubesh\].
const SMALLEST: f64 = 0.9;
const LARGEST: f64 = 2.4;
/// Most pictures of one run.
const MOST: usize = 10_000;

/// A drop and its exposure: everything that a picture shows but the light.
#[derive(Clone, Debug, PartialEq)]
pub struct FallingDrop {
    /// Shape and oscillation.
    shape: DropShape,
    /// Fall during the exposure, drop diameters.
    pub diameters: f64,
    /// Elevation of the line of sight, rad.
    pub pitch: f64,
}

impl FallingDrop {
    /// Diameter of the sphere of the same volume, mm.
    pub fn diameter_mm(&self) -> f64 {
        self.shape.diameter_mm
    }

    /// Exposure, s.
    pub fn exposure(&self) -> f64 {
        let diameter = self.diameter_mm();
        self.diameters * 1e-3 * diameter / fall_speed(Millimetres(diameter)).0
    }
}

/// A made picture.
#[derive(Clone, Debug, PartialEq)]
pub struct SynthStreak {
    /// What fell.
    pub drop: FallingDrop,
    /// How it was lit and looked at, in a set of one kind.
    pub notes: Option<SceneNotes>,
    /// The light, brightest pixel 1.
    pub picture: Grey,
}

/// Picture `index` of `seed`; the same whatever is made beside it.
///
/// Drops of 0.9 to 2.4 mm, 10 to 30 diameters of fall, as 32 × 184 to 32 × 504 pixels. Sizes, lengths and the light's
/// place follow a sequence that spreads evenly over few pictures as over many.
pub fn synth_streak(seed: u64, index: usize) -> SynthStreak {
    let (drop, surroundings) = plan(seed, index);
    let picture = expose(&drop, &|direction| surroundings.radiance(direction), surroundings.mean());
    SynthStreak { drop, notes: None, picture }
}

/// Shortest and longest fall of a drop in a set of one kind, diameters: from its image alone to a long exposure's.
const FALLS: [f64; 2] = [1.0, 30.0];

/// How far the drop of picture `index` falls, diameters: even in the logarithm over a set's pictures.
pub fn fall_of(scene: Scene, seed: u64, index: usize) -> f64 {
    if scene == Scene::Mixed {
        return plan(seed, index).0.diameters;
    }
    FALLS[0] * libm::pow(FALLS[1] / FALLS[0], spread(seed, index)[1])
}

/// Picture `index` of `seed` in the set `scene`; the same whatever is made beside it. Falls of 1 to 30 diameters, short ones as many
/// as long ones, so that short exposures and near drops find themselves too.
pub fn scene_streak(scene: Scene, seed: u64, index: usize) -> SynthStreak {
    if scene == Scene::Mixed {
        return synth_streak(seed, index);
    }
    let mut random = Random::from_parts(&[seed, index as u64, 0x0073_6365_6E65, scene as u64]);
    let spread = spread(seed, index);
    let shape = DropShape::new(SMALLEST * libm::pow(LARGEST / SMALLEST, spread[0]), modes(&mut random));
    let diameters = fall_of(scene, seed, index);
    let pitch_deg = scene.pitch_deg(&mut random);
    let drop = FallingDrop { shape, diameters, pitch: pitch_deg.to_radians() };
    let light = scene.light(&mut random, [spread[2], spread[3]], pitch_deg);
    let surroundings = Surroundings::new(&mut random, light.as_slice());
    let picture = expose(&drop, &|direction| surroundings.radiance(direction), surroundings.mean());
    SynthStreak { drop, notes: Some(scene::notes(pitch_deg, light.as_ref())), picture }
}

/// Four numbers in [0, 1) for picture `index`: Kronecker's sequence of the plastic number's four-dimensional kin spreads each run of
/// pictures.
fn spread(seed: u64, index: usize) -> [f64; 4] {
    const STEPS: [f64; 4] =
        [0.856_674_883_854_502_9, 0.733_891_856_627_126, 0.628_706_721_038_087, 0.538_597_257_224_361];
    std::array::from_fn(|axis| {
        let start = (hash(&[seed, axis as u64]) >> 11) as f64 / (1u64 << 53) as f64;
        (start + STEPS[axis] * index as f64).fract()
    })
}

/// What falls, and where.
fn plan(seed: u64, index: usize) -> (FallingDrop, Surroundings) {
    let mut random = Random::from_parts(&[seed, index as u64, 0x7374_7265_616B]);
    let spread = spread(seed, index);
    let between = |low: f64, high: f64, share: f64| low + (high - low) * share;
    // Small drops are many: even in the logarithm.
    let diameter = SMALLEST * libm::pow(LARGEST / SMALLEST, spread[0]);
    let drop = FallingDrop {
        shape: DropShape::new(diameter, modes(&mut random)),
        diameters: between(10.0, 30.0, spread[1]).round(),
        pitch: random.range(-12.0, 12.0).to_radians(),
    };
    let first = LightPlace {
        azimuth: between(-PI, PI, spread[2]),
        elevation: between(4.0, 62.0, spread[3]).to_radians(),
        ..light(&mut random, 1.2)
    };
    let others = random.below(3);
    let lights: Vec<LightPlace> =
        std::iter::once(first).chain((0..others).map(|_| light(&mut random, 0.4))).collect();
    (drop, Surroundings::new(&mut random, &lights))
}

/// A light anywhere: from a lamp of 3° to a gap in the clouds of 12°, up to `most` of the sky's irradiance.
fn light(random: &mut Random, most: f64) -> LightPlace {
    let mut even_in_logarithm = |low: f64, high: f64| low * libm::pow(high / low, random.unit());
    let (radius, strength) =
        (even_in_logarithm(3.0, 12.0).to_radians(), even_in_logarithm(0.08 * most, most));
    let (azimuth, elevation) = (random.range(-PI, PI), random.range(2.0, 50.0).to_radians());
    LightPlace { azimuth, elevation, radius, strength }
}

/// The oscillations that falling drops show \[garg-nayar\], \[beard-kubesh\]: degree 2 about the fall and degree 3
/// leaning are strong, the others weaker. An amplitude A of (2, 0) swings the axis ratio by ± 1.5 A.
fn modes(random: &mut Random) -> Vec<Mode> {
    [(2, 0, 0.15), (2, 1, 0.08), (2, 2, 0.08), (3, 0, 0.05), (3, 1, 0.12), (3, 2, 0.06)]
        .into_iter()
        .map(|(degree, order, most)| Mode {
            degree,
            order,
            azimuth: random.range(0.0, TAU),
            amplitude: most * random.range(0.4, 1.0),
            phase: random.range(0.0, TAU),
        })
        .collect()
}

/// The drop's light over the exposure, scaled to a peak of 1: row 0 is where it is when the shutter opens.
/// `radiance` by direction away from the drop, and its `mean`.
fn expose(drop: &FallingDrop, radiance: &(impl Fn(DVec3) -> f64 + Sync), mean: f64) -> Grey {
    let (sin, cos) = libm::sincos(drop.pitch);
    let (forward, up) = (DVec3::new(0.0, cos, sin), DVec3::new(0.0, -sin, cos));
    // The fall as the camera sees it.
    let path = drop.diameters * DIAMETER * cos;
    let height = (drop.diameters * DIAMETER + DIAMETER * 0.75 + 2.0 * MARGIN).ceil() as usize;
    let top = 0.5 * (height as f64 - path);
    let moments = (path / STEP).ceil().max(1.0) as usize;
    let radius = 0.5 * DIAMETER;
    // Moments are traced side by side, and added in their order.
    let traced: Vec<Vec<Seen>> = (0..moments)
        .into_par_iter()
        .map(|moment| {
            let time = (moment as f64 + 0.5) / moments as f64 * drop.exposure();
            let surface = drop.shape.at(time);
            // Roberts' sequence shifts the grid of rays from moment to moment.
            let shift = [0.754_877_666_246_693, 0.569_840_290_998_053]
                .map(|step| (0.5 + step * moment as f64).fract());
            let reach = surface.bound() * radius;
            let side = (2.0 * reach * RAYS).ceil() as usize + 1;
            let place = |i: usize, shift: f64| (i as f64 + shift) / RAYS - reach - 0.5 / RAYS;
            let mut seen = Vec::new();
            let mut look = |x: f64, y: f64, share: f64| {
                let origin = (DVec3::X * x - up * y) / radius - forward * 4.0;
                if let Some(light) = optics::radiance(&surface, origin, forward, radiance, mean) {
                    seen.push(Seen { x, y, light: light * share });
                }
            };
            for ray in 0..side * side {
                let (x, y) = (place(ray % side, shift[0]), place(ray / side, shift[1]));
                // Toward the rim the surroundings crowd together.
                if x * x + y * y < INNER * INNER * radius * radius {
                    look(x, y, 1.0);
                    continue;
                }
                for part in 0..FINER * FINER {
                    let finer = |i: usize| ((i as f64 + 0.5) / FINER as f64 - 0.5) / RAYS;
                    look(x + finer(part % FINER), y + finer(part / FINER), 1.0 / (FINER * FINER) as f64);
                }
            }
            seen
        })
        .collect();
    let mut sums = vec![0.0; WIDTH * height];
    let way = path / moments as f64;
    for (moment, seen) in traced.iter().enumerate() {
        let centre = top + way * moment as f64;
        for &Seen { x, y, light } in seen {
            let column = (x + 0.5 * WIDTH as f64) as usize;
            // From here the ray's light is carried down to where the next moment begins.
            let (from, to) = (centre + y, centre + y + way);
            for row in from.max(0.0) as usize..=to.max(0.0) as usize {
                let overlap = to.min(row as f64 + 1.0) - from.max(row as f64);
                if column < WIDTH && row < height && overlap > 0.0 {
                    sums[row * WIDTH + column] += overlap * light;
                }
            }
        }
    }
    let peak = sums.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    Grey { width: WIDTH, height, pixels: sums.iter().map(|sum| (sum / peak) as f32).collect() }
}

/// What one ray sees, at its place from the drop's centre, px.
struct Seen {
    x: f64,
    y: f64,
    light: f64,
}

/// Makes pictures 0 to `count` − 1 of `seed` in the set `scene` and writes them into `folder` as `drop00.png`, `drop01.png`, … (of
/// other sets than the mixed one as `backlit00.png` and so on): 16-bit linear grey, with what fell as a text chunk, and with how it was
/// lit and looked at as another. Returns the files in order.
///
/// Errors: a count of 0 or above 10 000, a folder that cannot be made or written into, an interruption; whole
/// pictures made before it stay.
pub fn write_streaks(
    folder: &Path,
    scene: Scene,
    seed: u64,
    count: usize,
    progress: &dyn Progress,
) -> Result<Vec<PathBuf>, BakeError> {
    if !(1..=MOST).contains(&count) {
        return Err(BakeError::input(folder, "count", format!("1 to {MOST} pictures"), count));
    }
    if folder.exists() && !folder.is_dir() {
        return Err(BakeError::input(folder, "output", "a folder", "a file"));
    }
    std::fs::create_dir_all(folder).map_err(BakeError::io(folder, "make the folder"))?;
    progress.begin("streaks", count as u64);
    let mut files = Vec::with_capacity(count);
    for index in 0..count {
        progress.check()?;
        let streak = scene_streak(scene, seed, index);
        let set = if scene == Scene::Mixed { String::new() } else { format!(" --scene {}", scene.name()) };
        let text = format!(
            "Streak of a drop of {:.3} mm in {:.3} ms; squall synth streaks{set} --seed {seed}, picture {index}",
            streak.drop.diameter_mm(),
            1e3 * streak.drop.exposure()
        );
        let stem = if scene == Scene::Mixed { "drop" } else { scene.name() };
        let path = folder.join(format!("{stem}{index:02}.png"));
        let notes = streak.notes.map(|scene| {
            let drop = DropNotes {
                diameter_mm: streak.drop.diameter_mm(),
                exposure_ms: 1e3 * streak.drop.exposure(),
            };
            StreakNotes { drop, scene }.to_json()
        });
        write_atomically(&path, |out| write_png16(&streak.picture, &text, notes.as_deref(), out))?;
        files.push(path);
        progress.advance(1);
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn still(diameters: f64) -> FallingDrop {
        FallingDrop { shape: DropShape::new(0.0, vec![]), diameters, pitch: 0.0 }
    }

    #[test]
    fn a_still_sphere_in_uniform_surroundings_is_a_capsule_of_chords() {
        /// Of the middle column: what the grid of rays, shifted from moment to moment, leaves.
        const GRID: f64 = 0.01;
        let radius = 0.5 * DIAMETER;
        let picture = expose(&still(5.0), &|_| 1.0, 1.0);
        // Mean over a pixel's width of the time that it is covered, ∝ the chord 2√(r² − x²).
        let area = |x: f64| {
            let x = x.clamp(-radius, radius);
            x * libm::sqrt(radius * radius - x * x) + radius * radius * libm::asin(x / radius)
        };
        let wanted = |column: usize| {
            let x = column as f64 - 0.5 * WIDTH as f64;
            (area(x + 1.0) - area(x)) / (PI * radius * radius)
        };
        // Rows that the drop passes whole.
        let rows = 40..picture.height - 40;
        let row = |y: usize| &picture.pixels[y * WIDTH..][..WIDTH];
        let all: f64 = rows.clone().flat_map(row).map(|&v| f64::from(v)).sum();
        for column in 0..WIDTH {
            let found = rows.clone().map(|y| f64::from(row(y)[column])).sum::<f64>() / all;
            let miss = (found - wanted(column)) / wanted(WIDTH / 2);
            assert!(miss.abs() < GRID, "column {column}: {miss}");
        }
        // The light of all rows is that of as many full ones as the path has.
        let full = all / rows.len() as f64;
        let sum: f64 = picture.pixels.iter().map(|&v| f64::from(v)).sum();
        assert!((sum / (full * 5.0 * DIAMETER) - 1.0).abs() < GRID, "{sum}");
    }

    #[test]
    fn the_drop_shows_the_sky_below_and_the_ground_above() {
        // A short exposure freezes it: the picture of a lens is upside down.
        let mut drop = still(0.01);
        drop.diameters = 0.01;
        let picture = expose(&drop, &|direction| if direction.z > 0.0 { 1.0 } else { 0.1 }, 0.5);
        let at = |up: i32| {
            let row = (picture.height as i32 / 2 - up) as usize;
            f64::from(picture.pixels[row * WIDTH + WIDTH / 2])
        };
        assert!(at(-4) > 4.0 * at(4), "{} {}", at(-4), at(4));
    }

    #[test]
    fn threads_change_no_pixel() {
        let shape = DropShape::new(1.5, modes(&mut Random::new(3)));
        let drop = FallingDrop { shape, diameters: 1.5, pitch: 0.1 };
        let (_, surroundings) = plan(1, 2);
        let made = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| expose(&drop, &|direction| surroundings.radiance(direction), 0.4))
        };
        let one = made(1);
        assert_eq!(one.pixels.iter().copied().fold(0.0, f32::max), 1.0);
        assert!(one == made(2) && one == made(8));
    }

    #[test]
    fn a_dozen_drops_cover_sizes_and_lengths_evenly() {
        for seed in 0..20 {
            let drops: Vec<FallingDrop> = (0..12).map(|index| plan(seed, index).0).collect();
            let small =
                drops.iter().filter(|drop| drop.diameter_mm() < libm::sqrt(SMALLEST * LARGEST)).count();
            let short = drops.iter().filter(|drop| drop.diameters < 20.0).count();
            assert!((4..=8).contains(&small) && (4..=8).contains(&short), "seed {seed}: {small}, {short}");
            assert!(drops.iter().all(|drop| (SMALLEST..=LARGEST).contains(&drop.diameter_mm())));
            assert!(drops.iter().all(|drop| (10.0..=30.0).contains(&drop.diameters)));
            assert!(drops.iter().all(|drop| (1e-3..0.02).contains(&drop.exposure())));
        }
        assert_eq!(plan(5, 3), plan(5, 3));
        assert_ne!(plan(5, 3).0, plan(6, 3).0);
    }
}
