//! A splash from beginning to end, synthesised: a crown that opens, throws fingers and droplets and falls back, then a jet that sheds a drop. \[toyshop\] §3.3
//! films one; this one is made of some thousand balls of water, seen from three elevations.
//!
//! Lengths are in crater radii R, times in lives of a splash, [`super::life_s`]: so gravity is 25 in these units.

use crate::random::Random;
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

/// Pictures of a sequence.
pub(crate) const FRAMES: usize = 14;
/// Different splashes.
pub(crate) const VARIANTS: usize = 3;
/// Elevations of the view, degrees, and the sines between which they are mixed.
const ELEVATIONS: [f32; 3] = [8.0, 38.0, 72.0];
pub(crate) const VIEWS: usize = ELEVATIONS.len();
/// Pixels along the side of the finest picture; four levels, each half as wide as the one before.
pub(crate) const SIDE: usize = 64;
pub(crate) const LEVELS: usize = 5;
/// Width and height of a picture, R, and where its lower edge lies under the place of impact.
pub(crate) const WIDTH: f32 = 4.0;
pub(crate) const BELOW: f32 = 1.0;
/// Gravity in these units: life is 5 √(R/g).
const GRAVITY: f32 = 25.0;
const CLIP: usize = 64 * 64 + 32 * 32 + 16 * 16 + 8 * 8 + 4 * 4;

/// A ball of water.
#[derive(Clone, Copy, Debug)]
struct Blob {
    at: Vec3,
    radius: f32,
    /// Optical thickness of a diameter.
    thick: f32,
}

/// All pictures: normals (right, up) times coverage, and coverage, of each pixel, in bytes.
#[derive(Clone, Debug)]
pub(crate) struct Sequence {
    texels: Vec<[i8; 4]>,
    /// Mean coverage of each picture's area over a life, by elevation.
    means: [f32; VIEWS],
    /// Of each picture: what part of it has water, from its left, top, right and lower edge, 0 to 1.
    bounds: Vec<[f32; 4]>,
}

/// A picture of the sequence, at a level.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clip<'a> {
    texels: &'a [[i8; 4]],
    side: usize,
}

/// Which elevations a view lies between, and the share of the second.
/// Sines of the elevations that pictures are made from.
pub(crate) fn sines() -> [f32; VIEWS] {
    ELEVATIONS.map(|degrees| libm::sinf(degrees.to_radians()))
}

pub(crate) fn between_views(sine: f32) -> (usize, f32) {
    let sines = sines();
    let second = usize::from(sine > sines[1]);
    let share = (sine - sines[second]) / (sines[second + 1] - sines[second]);
    (second, share.clamp(0.0, 1.0))
}

impl Sequence {
    /// Makes all pictures.
    pub fn bake() -> Self {
        let mut texels = Vec::with_capacity(VARIANTS * VIEWS * FRAMES * CLIP);
        let (mut means, mut bounds) = ([0.0; VIEWS], Vec::new());
        for variant in 0..VARIANTS {
            for (view, degrees) in ELEVATIONS.iter().enumerate() {
                for frame in 0..FRAMES {
                    let time = (frame as f32 + 0.5) / FRAMES as f32;
                    let fine = picture(blobs(variant as u64, time), degrees.to_radians());
                    let covered: f32 = fine.iter().map(|texel| texel[2]).sum();
                    means[view] += covered / (SIDE * SIDE * FRAMES * VARIANTS) as f32;
                    bounds.push(bounds_of(&fine));
                    store(&fine, &mut texels);
                }
            }
        }
        Self { texels, means, bounds }
    }

    /// What part of a picture has water, by its edges, 0 to 1 from its left and from its top.
    pub fn bounds(&self, variant: usize, view: usize, time: f32) -> [f32; 4] {
        self.bounds[Self::picture(variant, view, time)]
    }

    fn picture(variant: usize, view: usize, time: f32) -> usize {
        let frame = ((time * FRAMES as f32) as usize).min(FRAMES - 1);
        (variant % VARIANTS * VIEWS + view) * FRAMES + frame
    }

    /// A picture: which splash, which elevation, how far through its life (0 to 1), at a level.
    pub fn clip(&self, variant: usize, view: usize, time: f32, level: usize) -> Clip<'_> {
        let begin = Self::picture(variant, view, time) * CLIP;
        let level = level.min(LEVELS - 1);
        let skip: usize = (0..level).map(|k| (SIDE >> k) * (SIDE >> k)).sum();
        let side = SIDE >> level;
        Clip { texels: &self.texels[begin + skip..][..side * side], side }
    }

    /// Mean coverage of a picture's square over a life, seen at an elevation's sine.
    pub fn mean(&self, sine: f32) -> f32 {
        let (view, share) = between_views(sine);
        self.means[view] + share * (self.means[view + 1] - self.means[view])
    }
}

impl Clip<'_> {
    /// Normal times coverage, and coverage, at a place of the picture, 0 to 1 from its left and from its top; its edges are empty.
    pub fn at(&self, x: f32, y: f32) -> Vec3 {
        let most = (self.side - 1) as f32;
        let place = |at: f32| (at * self.side as f32 - 0.5).clamp(0.0, most);
        let (x, y) = (place(x), place(y));
        let (left, top) = ((x as usize).min(self.side - 2), (y as usize).min(self.side - 2));
        let (u, v) = (x - left as f32, y - top as f32);
        let texel = |texel: [i8; 4]| Vec3::new(f32::from(texel[0]), f32::from(texel[1]), f32::from(texel[2]));
        let corner = top * self.side + left;
        let high = &self.texels[corner..corner + 2];
        let low = &self.texels[corner + self.side..corner + self.side + 2];
        let high = texel(high[0]).lerp(texel(high[1]), u);
        let low = texel(low[0]).lerp(texel(low[1]), u);
        high.lerp(low, v) * (1.0 / 127.0)
    }
}

fn bounds_of(fine: &[[f32; 3]]) -> [f32; 4] {
    let mut bounds = [1.0f32, 1.0, 0.0, 0.0];
    for (k, _) in fine.iter().enumerate().filter(|(_, texel)| texel[2] > 0.004) {
        let [x, y] = [k % SIDE, k / SIDE].map(|at| at as f32 / SIDE as f32);
        let step = 1.0 / SIDE as f32;
        bounds = [bounds[0].min(x), bounds[1].min(y), bounds[2].max(x + step), bounds[3].max(y + step)];
    }
    bounds
}

/// The water of a splash at a time of its life.
fn blobs(variant: u64, time: f32) -> Vec<Blob> {
    let mut random = Random::from_parts(&[0x5350_4c41, variant]);
    let mut all = Vec::new();
    let fingers = 9 + 2 * variant as usize;
    let turn = random.unit() as f32;
    crown(&mut all, &mut random, fingers, turn, time);
    for finger in 0..fingers {
        let angle = (finger as f32 + turn + 0.3 * random.range(-1.0, 1.0) as f32) / fingers as f32 * TAU;
        for _ in 0..2 {
            let begin = random.range(0.06, 0.24) as f32;
            let up = random.range(4.5, 9.0) as f32;
            let out = random.range(0.7, 1.7) as f32;
            let radius = random.range(0.045, 0.12) as f32;
            let age = time - begin;
            let height = 0.5 + up * age - 0.5 * GRAVITY * age * age;
            let away = crown_radius(begin) + out * age;
            if age > 0.0 && height > 0.0 {
                all.push(Blob { at: around(angle, away, height), radius, thick: 3.0 });
            }
        }
    }
    jet(&mut all, &mut random, time);
    all
}

fn around(angle: f32, away: f32, height: f32) -> Vec3 {
    Vec3::new(away * libm::cosf(angle), away * libm::sinf(angle), height)
}

fn crown_radius(time: f32) -> f32 {
    0.3 + 0.7 * (time / 0.5).clamp(0.0, 1.0).sqrt()
}

/// The crown: a thin wall that leans outward under a thicker rim, and its fingers.
fn crown(all: &mut Vec<Blob>, random: &mut Random, fingers: usize, turn: f32, time: f32) {
    const AROUND: usize = 84;
    const UP: usize = 9;
    let open = time / 0.52;
    if open >= 1.0 {
        return;
    }
    let height = 1.05 * 4.0 * open * (1.0 - open);
    let (foot, thin) = (crown_radius(time), 1.0 - 0.6 * open);
    let lengths: Vec<f32> = (0..fingers).map(|_| random.range(0.6, 1.4) as f32).collect();
    for k in 0..AROUND {
        let part = k as f32 / AROUND as f32;
        let wave = libm::cosf((part * fingers as f32 - turn) * TAU);
        let nearest = ((part * fingers as f32 - turn + fingers as f32 + 0.5) as usize) % fingers;
        let top = height * (0.85 + 0.15 * wave * lengths[nearest]);
        for up in 0..UP {
            let share = up as f32 / (UP - 1) as f32;
            let away = foot * (1.0 + 0.22 * share * share * height);
            let rim = share > 0.99;
            let radius = if rim { 0.085 } else { 0.05 + 0.02 * height / UP as f32 };
            let thick = if rim { 1.6 } else { 0.05 };
            all.push(Blob { at: around(part * TAU, away, share * top), radius, thick: thick * thin });
        }
        // Fingers rise from where the rim stands highest.
        if wave > 0.97 {
            let length = 0.8 * lengths[nearest] * open.min(0.6) * 1.6;
            for step in 0..6 {
                let share = step as f32 / 5.0;
                let away = foot * (1.0 + 0.22 * height) + 0.35 * share * length;
                let radius = if step == 5 { 0.11 } else { 0.08 - 0.03 * share };
                all.push(Blob {
                    at: around(part * TAU, away, top + share * length),
                    radius,
                    thick: 1.5 * thin,
                });
            }
        }
    }
}

/// The jet that rises where the crater closes, and the drop on its tip.
fn jet(all: &mut Vec<Blob>, random: &mut Random, time: f32) {
    let rising = (time - 0.4) / 0.6;
    if rising <= 0.0 {
        return;
    }
    let tall = random.range(1.2, 2.0) as f32;
    let height = tall * 4.0 * rising * (1.0 - rising);
    const STEPS: usize = 22;
    for step in 0..STEPS {
        let share = step as f32 / (STEPS - 1) as f32;
        let radius = 0.21 * (1.0 - 0.65 * share) * (1.0 - 0.4 * rising);
        all.push(Blob { at: Vec3::new(0.0, 0.0, share * height), radius, thick: 2.0 });
    }
    // The mound that it rises from.
    for step in 0..14 {
        let angle = step as f32 / 14.0 * TAU;
        let thick = 0.5 * (1.0 - rising);
        all.push(Blob { at: around(angle, 0.24, 0.03), radius: 0.14, thick });
    }
    let age = rising - 0.3;
    if age > 0.0 {
        let up = tall * 0.95 + 2.4 * age - 0.5 * GRAVITY * 0.36 * age * age;
        if up > 0.0 {
            all.push(Blob { at: Vec3::new(0.0, 0.0, up), radius: 0.17, thick: 3.0 });
        }
    }
}

/// Balls seen from an elevation: normal (right, up) times coverage, and coverage.
fn picture(mut blobs: Vec<Blob>, elevation: f32) -> Vec<[f32; 3]> {
    /// Samples a pixel along each axis.
    const FINE: usize = 2;
    let (sine, cosine) = (libm::sinf(elevation), libm::cosf(elevation));
    let depth = |at: Vec3| at.y * cosine - at.z * sine;
    blobs.sort_by(|a, b| depth(b.at).total_cmp(&depth(a.at)));
    let side = SIDE * FINE;
    let per = side as f32 / WIDTH;
    let mut fine = vec![[0.0f32; 3]; side * side];
    for blob in blobs.iter().filter(|blob| blob.thick > 0.0) {
        let x = (blob.at.x + 0.5 * WIDTH) * per;
        let y = side as f32 - (blob.at.z * cosine + blob.at.y * sine + BELOW) * per;
        let reach = blob.radius * per;
        let span = |middle: f32| {
            (middle - reach).max(0.0) as usize..((middle + reach + 1.0).max(0.0) as usize).min(side)
        };
        for row in span(y) {
            for column in span(x) {
                let flat = Vec2::new(column as f32 + 0.5 - x, y - row as f32 - 0.5) / reach;
                let chord = 1.0 - flat.length_squared();
                if chord <= 0.0 {
                    continue;
                }
                let through = blob.thick * chord.sqrt();
                let covers = through / (0.5 + through);
                let value = &mut fine[row * side + column];
                let front = [flat.x * covers, flat.y * covers, covers];
                *value = std::array::from_fn(|k| front[k] + (1.0 - covers) * value[k]);
            }
        }
    }
    halve(&fine, side)
}

fn halve(fine: &[[f32; 3]], side: usize) -> Vec<[f32; 3]> {
    let half = side / 2;
    let of = |k: usize| {
        let corner = (k / half) * 2 * side + (k % half) * 2;
        let four = [corner, corner + 1, corner + side, corner + side + 1];
        std::array::from_fn(|band| four.iter().map(|&at| fine[at][band]).sum::<f32>() * 0.25)
    };
    (0..half * half).map(of).collect()
}

/// A picture and its coarser levels.
fn store(fine: &[[f32; 3]], texels: &mut Vec<[i8; 4]>) {
    let mut level = fine.to_vec();
    let mut side = SIDE;
    for _ in 0..LEVELS {
        texels.extend(level.iter().map(|texel| {
            let byte = |value: f32| libm::roundf(127.0 * value.clamp(-1.0, 1.0)) as i8;
            [byte(texel[0]), byte(texel[1]), byte(texel[2]), 0]
        }));
        level = halve(&level, side);
        side /= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes, and their rounding through the levels.
    const BYTE: f32 = 1.0 / 127.0;

    #[test]
    fn a_splash_opens_rises_and_is_gone() {
        let sequence = Sequence::bake();
        let covered = |frame: usize| {
            let clip = sequence.clip(0, 0, (frame as f32 + 0.5) / FRAMES as f32, 0);
            clip.texels.iter().map(|texel| f32::from(texel[2])).sum::<f32>()
        };
        let most = (0..FRAMES).map(covered).fold(0.0, f32::max);
        assert!(covered(0) < 0.7 * most && covered(FRAMES - 1) < 0.5 * most);
        // Nothing is cut off by the picture's left, right and upper edges.
        for frame in 0..FRAMES {
            let clip = sequence.clip(1, 1, (frame as f32 + 0.5) / FRAMES as f32, 0);
            let edge = (0..SIDE).map(|k| clip.texels[k][2].max(clip.texels[k * SIDE][2]));
            assert_eq!(edge.max(), Some(0), "picture {frame}");
        }
    }

    #[test]
    fn every_level_covers_as_much_as_the_finest() {
        let sequence = Sequence::bake();
        for view in 0..VIEWS {
            let mean = |level: usize| {
                let clip = sequence.clip(0, view, 0.3, level);
                clip.texels.iter().map(|texel| f32::from(texel[2])).sum::<f32>()
                    / clip.texels.len() as f32
                    / 127.0
            };
            assert!((0..LEVELS).all(|level| (mean(level) - mean(0)).abs() < BYTE));
        }
    }

    #[test]
    fn normals_are_no_longer_than_what_they_belong_to() {
        let sequence = Sequence::bake();
        for texel in &sequence.texels {
            let [x, y, a, _] = texel.map(f32::from);
            assert!(x * x + y * y <= (a + 2.0) * (a + 2.0));
        }
    }
}
