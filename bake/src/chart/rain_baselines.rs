//! What streaks are compared with in cost: \[weber\]'s Algorithm 1 as printed, and a plain particle system.
//!
//! Neither has drops that stand in the world, so neither can be held against a truth drop by drop: they have a cost alone. Both are
//! written as a careful programmer would: nothing is allocated per frame, single precision, what cannot touch a pixel is skipped.

use crate::input::picture::Grey;
use squall_formats::drops::{self, View as RainView, paper};
use squall_formats::section::streak::{CosinePattern, Pattern, StreakPattern, Window};
use squall_formats::units::{Degrees, Millimetres, MillimetresPerHour, Seconds};
use squall_runtime::picture::Picture;
use squall_runtime::random::{Random, mix};

/// Width of the windows of projected length, px.
const WINDOW_PX: f64 = 10.0;

/// A rain and its frame.
#[derive(Clone, Copy, Debug)]
pub struct Rainfall {
    /// mm/h.
    pub rate: f64,
    /// Vertical, degrees.
    pub fov: f64,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Shortest and longest streak, px.
    pub lengths_px: [f64; 2],
    /// Time that the shutter is open.
    pub exposure: Seconds,
}

impl Rainfall {
    fn view(&self, [min_px, max_px]: [f64; 2]) -> RainView {
        RainView {
            vertical_fov: Degrees(self.fov).into(),
            height_px: f64::from(self.size[1]),
            aspect: f64::from(self.size[0]) / f64::from(self.size[1]),
            exposure: self.exposure,
            min_px,
            max_px,
        }
    }
}

/// A pattern of Algorithm 1: f, g, amplitude, phase of its cosines, and its Gaussian window.
struct Waves {
    constant: f32,
    terms: Vec<[f32; 4]>,
    centre: [f32; 2],
    per_radius: [f32; 2],
}

impl Waves {
    fn new(pattern: &CosinePattern) -> Self {
        let (centre, radius) = match &pattern.window {
            Window::Power(window) => (window.centre, window.radius),
            _ => ([0.5; 2], [0.5; 2]),
        };
        let turn = std::f64::consts::TAU;
        let term = |t: &squall_formats::section::streak::Cosine| {
            [turn * t.across, turn * t.along, t.amplitude, t.phase].map(|value| value as f32)
        };
        Self {
            constant: pattern.constant as f32,
            terms: pattern.terms.iter().map(term).collect(),
            centre: centre.map(|value| value as f32),
            per_radius: radius.map(|value| (1.0 / value) as f32),
        }
    }

    fn value(&self, u: f32, v: f32) -> f32 {
        let mut sum = self.constant;
        for [f, g, amplitude, phase] in &self.terms {
            sum += amplitude * libm::cosf(f * u + g * v + phase);
        }
        let [a, b] = [(u - self.centre[0]) * self.per_radius[0], (v - self.centre[1]) * self.per_radius[1]];
        sum * libm::expf(-(a * a + b * b))
    }
}

/// One projected length of one size of drops: its grid.
struct Layer {
    /// Edge of a cell, px: a streak's length, the least that holds one.
    cell: f32,
    /// e^−(mean number of kernels of a cell).
    floor: f32,
    length: f32,
    width: f32,
    alpha: f32,
    seed: u64,
}

/// Algorithm 1: for each pixel, each projected length and each size of drops, the kernels of the pixel's own cell.
pub struct ScreenGrid {
    layers: Vec<Layer>,
    patterns: Vec<Waves>,
}

impl ScreenGrid {
    /// The layers of `rain`: Bentley's sizes, drop numbers and speeds as printed, and windows of 10 px.
    pub fn new(rain: &Rainfall, patterns: &[StreakPattern]) -> Self {
        let waves = patterns.iter().filter_map(|pattern| match &pattern.pattern {
            Pattern::Cosines(cosines) => Some(Waves::new(cosines)),
            Pattern::Separable(_) => None,
        });
        let [shortest, longest] = rain.lengths_px;
        let windows = ((longest - shortest) / WINDOW_PX).round().max(1.0) as usize;
        let mut layers = Vec::new();
        for (class, [from, to]) in paper::CLASSES_AS_PRINTED.into_iter().enumerate() {
            let per_volume = paper::drops_per_volume(from, to, MillimetresPerHour(rain.rate));
            let speed = paper::fall_speed(from);
            let length = drops::streak_length(from, speed, rain.exposure);
            for window in 0..windows {
                let ends = [window, window + 1]
                    .map(|step| shortest + (longest - shortest) * step as f64 / windows as f64);
                let count = per_volume * rain.view(ends).shell_volume(length);
                let px = 0.5 * (ends[0] + ends[1]);
                let pixels = f64::from(rain.size[0]) * f64::from(rain.size[1]);
                let width = px * from.0 * 1e-3 / length.0;
                layers.push(Layer {
                    cell: px as f32,
                    floor: libm::exp(-count * px * px / pixels) as f32,
                    length: px as f32,
                    width: width as f32,
                    alpha: (width / px).min(1.0) as f32,
                    seed: mix((class * windows + window) as u64 + 1),
                });
            }
        }
        Self { layers, patterns: waves.collect() }
    }

    /// Draws a frame over `picture`; answers how many kernels were summed, over all pixels.
    pub fn draw(&self, time: f32, picture: &mut Picture) -> u64 {
        let mut evaluated = 0;
        let (width, fallen) = (picture.width, time * 2000.0);
        for (i, pixel) in picture.pixels.iter_mut().enumerate() {
            let (x, y) = ((i % width) as f32 + 0.5, (i / width) as f32 + 0.5 - fallen);
            for layer in &self.layers {
                let [column, row] = [x / layer.cell, y / layer.cell].map(f32::floor);
                let place = (column as i64 as u64) ^ (row as i64 as u64).rotate_left(32);
                let mut state = mix(layer.seed ^ place);
                let mut next = || {
                    state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
                    mix(state)
                };
                let unit = |bits: u64| (bits >> 40) as f32 * (1.0 / (1u64 << 24) as f32);
                let mut arrival = unit(next());
                while arrival > layer.floor {
                    let bits = next();
                    arrival *= unit(bits);
                    let place = next();
                    let [left, top] =
                        [(column + unit(place)) * layer.cell, (row + unit(place << 24)) * layer.cell];
                    let (u, v) = ((x - left) / layer.width + 0.5, (y - top) / layer.length + 0.5);
                    if !(0.0..1.0).contains(&u) || !(0.0..1.0).contains(&v) {
                        continue;
                    }
                    evaluated += 1;
                    let Some(pattern) = self.patterns.get(bits as usize % self.patterns.len().max(1)) else {
                        continue;
                    };
                    let alpha = (layer.alpha * pattern.value(u, v)).clamp(0.0, 1.0);
                    pixel.iter_mut().for_each(|light| *light += alpha * (1.0 - *light));
                }
            }
        }
        evaluated
    }
}

/// A drop of the particle system, in camera space: right, up, forward.
#[derive(Clone, Copy)]
struct Particle {
    place: [f32; 3],
    speed: f32,
    diameter: f32,
    class: u32,
    texture: u32,
}

/// Drops in a box around the frustum, moved and drawn as textured rectangles.
pub struct ParticleSystem {
    rain: Rainfall,
    particles: Vec<Particle>,
    /// Half width, half height and depth of each class's box, m.
    boxes: Vec<[f32; 3]>,
    random: Random,
}

/// Classes of drops.
const CLASSES: usize = 16;

impl ParticleSystem {
    /// As many particles as drops fall in the boxes.
    pub fn new(rain: Rainfall) -> Self {
        let mut random = Random::new(1);
        let [from, to] = drops::DEFAULT_DIAMETERS;
        let view = rain.view(rain.lengths_px);
        let tangent = libm::tan(0.5 * view.vertical_fov.0);
        let (mut particles, mut boxes) = (Vec::new(), Vec::new());
        for (class, [low, high]) in drops::log_classes(from, to, CLASSES).into_iter().enumerate() {
            let length = drops::streak_length(high, drops::fall_speed(high), rain.exposure);
            let far = view.distance(length, rain.lengths_px[0]).0;
            let half = [far * tangent * view.aspect, far * tangent + length.0];
            boxes.push([half[0], half[1], far].map(|side| side as f32));
            let number = drops::drops_per_volume(low, high, MillimetresPerHour(rain.rate));
            let count = (number * 4.0 * half[0] * half[1] * far).round() as usize;
            for _ in 0..count {
                let diameter = random.range(low.0, high.0);
                let place = [
                    random.range(-half[0], half[0]),
                    random.range(-half[1], half[1]),
                    random.range(0.0, far),
                ];
                particles.push(Particle {
                    place: place.map(|value| value as f32),
                    speed: drops::fall_speed(Millimetres(diameter)).0 as f32,
                    diameter: diameter as f32,
                    class: class as u32,
                    texture: random.below(1 << 16) as u32,
                });
            }
        }
        Self { rain, particles, boxes, random }
    }

    /// Particles.
    pub fn len(&self) -> usize {
        self.particles.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.particles.is_empty()
    }

    /// Lets drops fall for `step` s; those that leave their box begin again on top, at another place.
    pub fn update(&mut self, step: f32) {
        for particle in &mut self.particles {
            particle.place[1] -= particle.speed * step;
            let [half, top, far] = self.boxes[particle.class as usize];
            if particle.place[1] < -top {
                // A long step may take a drop through its box more than once.
                let turns = ((-top - particle.place[1]) / (2.0 * top)).ceil();
                particle.place[1] += 2.0 * top * turns;
                particle.place[0] = half * (2.0 * self.random.unit() as f32 - 1.0);
                particle.place[2] = far * self.random.unit() as f32;
            }
        }
    }

    /// Draws all particles over `picture`; answers how many had a streak.
    pub fn draw(&self, textures: &[Grey], picture: &mut Picture) -> usize {
        let view = self.rain.view(self.rain.lengths_px);
        let focal = view.focal_px() as f32;
        let size = [picture.width as f32, picture.height as f32];
        let exposure = self.rain.exposure.0 as f32;
        let mut drawn = 0;
        for particle in &self.particles {
            let [x, y, depth] = particle.place;
            let scale = focal / depth.max(1e-6);
            let metres = particle.diameter * 1e-3 + particle.speed * exposure;
            let length = metres * scale;
            if !(length >= view.min_px as f32 && length <= view.max_px as f32) {
                continue;
            }
            let width = particle.diameter * 1e-3 * scale;
            let middle = [0.5 * size[0] + x * scale, 0.5 * size[1] - y * scale];
            // A texture is two drops wide, as the pictures are, and no rectangle is narrower than a pixel.
            let half = [width.max(0.5), 0.5 * length];
            let alpha = (width / length) * (width / half[0]);
            let texture = &textures[particle.texture as usize % textures.len()];
            let ends = |axis: usize| {
                let low = (middle[axis] - half[axis]).max(0.0) as usize;
                low..(middle[axis] + half[axis]).clamp(0.0, size[axis]) as usize
            };
            drawn += 1;
            for row in ends(1) {
                let v = (row as f32 + 0.5 - middle[1]) / length + 0.5;
                let line = (v.clamp(0.0, 1.0) * (texture.height - 1) as f32) as usize * texture.width;
                for column in ends(0) {
                    let u = (column as f32 + 0.5 - middle[0]) / (2.0 * half[0]) + 0.5;
                    let texel = u.clamp(0.0, 1.0) * (texture.width - 1) as f32;
                    let (whole, share) = (texel as usize, texel.fract());
                    let next = (whole + 1).min(texture.width - 1);
                    let [a, b] = [whole, next].map(|at| texture.pixels[line + at]);
                    let alpha = (alpha * (a + (b - a) * share)).clamp(0.0, 1.0);
                    let pixel = &mut picture.pixels[row * picture.width + column];
                    pixel.iter_mut().for_each(|light| *light += alpha * (1.0 - *light));
                }
            }
        }
        drawn
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::section::streak::Cosine;

    const RAIN: Rainfall = Rainfall {
        rate: 25.0,
        fov: 90.0,
        size: [480, 270],
        lengths_px: [30.0, 200.0],
        exposure: Seconds(0.02),
    };

    fn flat() -> Vec<StreakPattern> {
        let window = squall_formats::section::streak::PowerWindow {
            centre: [0.5; 2],
            radius: [0.3; 2],
            exponent: [2.0; 2],
        };
        let terms = vec![Cosine { across: 1.0, along: 2.0, amplitude: 0.1, phase: 0.3 }];
        let pattern = Pattern::Cosines(CosinePattern { window: Window::Power(window), constant: 0.6, terms });
        let body = squall_formats::section::streak::Body::WHOLE;
        vec![StreakPattern {
            name: "flat".into(),
            method: squall_formats::section::streak::Method::Paper,
            size_px: [8, 64],
            body,
            mean: 0.3,
            psnr_db: 0.0,
            ssim: 0.0,
            notes: None,
            scene: None,
            pattern,
        }]
    }

    #[test]
    fn the_screen_grid_sums_as_many_kernels_as_its_layers_hold() {
        /// Poisson numbers of few large kernels.
        const SCATTER: f64 = 0.15;
        let grid = ScreenGrid::new(&RAIN, &flat());
        let mut picture = Picture::new(480, 270).unwrap();
        let found = grid.draw(0.0, &mut picture) as f64;
        // A kernel as long as its cell keeps three quarters of its length in it on average, and nearly all of its width.
        let wanted: f64 = grid
            .layers
            .iter()
            .map(|layer| {
                let per_cell = -libm::log(f64::from(layer.floor));
                let cells = 480.0 * 270.0 / f64::from(layer.cell * layer.cell);
                let across = 1.0 - 0.25 * f64::from(layer.width / layer.cell);
                per_cell * cells * f64::from(layer.width * layer.length) * across * 0.75
            })
            .sum();
        assert!((found / wanted - 1.0).abs() < SCATTER, "{found} for {wanted}");
        assert!(picture.pixels.iter().any(|pixel| pixel[0] > 0.0));
    }

    #[test]
    fn the_particle_system_shows_as_many_streaks_as_the_shells_hold_and_keeps_doing_so() {
        /// Standard deviations, and classes whose drops share a box.
        const SCATTER: f64 = 0.12;
        let mut system = ParticleSystem::new(RAIN);
        let textures = [Grey { width: 2, height: 2, pixels: vec![1.0; 4] }];
        let view = RAIN.view(RAIN.lengths_px);
        let [from, to] = drops::DEFAULT_DIAMETERS;
        let classes = drops::log_classes(from, to, 400);
        let wanted: f64 = classes
            .into_iter()
            .map(|[low, high]| {
                let number = drops::drops_per_volume(low, high, MillimetresPerHour(RAIN.rate));
                let middle = Millimetres(libm::sqrt(low.0 * high.0));
                number
                    * view.shell_volume(drops::streak_length(
                        middle,
                        drops::fall_speed(middle),
                        RAIN.exposure,
                    ))
            })
            .sum();
        for _ in 0..3 {
            let mut picture = Picture::new(480, 270).unwrap();
            let inside = system
                .particles
                .iter()
                .filter(|p| {
                    let scale = view.focal_px() as f32 / p.place[2];
                    let length = (p.diameter * 1e-3 + p.speed * 0.02) * scale;
                    (30.0..200.0).contains(&length)
                        && (p.place[0] * scale).abs() < 240.0
                        && (p.place[1] * scale).abs() < 135.0
                })
                .count() as f64;
            assert!((inside / wanted - 1.0).abs() < SCATTER, "{inside} for {wanted}");
            assert!(system.draw(&textures, &mut picture) >= inside as usize);
            system.update(0.3);
        }
    }
}
