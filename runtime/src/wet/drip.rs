//! Drops that drip from ledges, gutters and awnings, \[toyshop\] §3.2: as many as what drains over an edge makes.
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | R | rainfall intensity | m/s |
//! | A | `drains_m2` of an edge | m² |
//! | V | a drop's volume, πD³/6 | m³ |
//!
//! R A/V drops a second leave an edge, at spots that stand where water gathers: each has its own share, period and unrest. A drop swells, is let go and falls
//! against drag and with the wind, all of it closed forms of the time: the same time gives the same drops.

use crate::error::RuntimeError;
use crate::random::Random;
use crate::wet::controls::controls;
use crate::wet::drop::eye::Eye;
use crate::wet::drop::light::{DropLight, LightControls, LightMemory};
use crate::wet::drop::{self, Opacity, Paint, Stamp, distance_fade, fallen, last_speed, lightning_bias};
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::maps::DripEdge;
use glam::{DVec3, Vec2, Vec3};
use std::f64::consts::PI;

controls! {
    /// How water drips.
    pub struct DripControls {
        /// Diameter of drops that hang until they are too heavy.
        diameter_mm: 5.0, 0.5..=8.0, "mm", "";
        /// Factor on the drops that drain over an edge in a second.
        amount: 1.0, 0.0..=10.0, "", "";
        /// Mean distance of the spots of an edge that drip.
        spacing_m: 0.08, 0.01..=10.0, "m", "";
        /// Time that a shutter is open: drops are as long as they fall in it.
        exposure_ms: 8.0, 0.0..=1000.0, "ms", "";
        /// Above ½ water looks as the paper prints it, a baseline: rays are bent once and don't come out again, opacity grows with the distance.
        paper: 0.0, 0.0..=1.0, "", "";
        /// Opacity of the water.
        opacity: 1.0, 0.0..=1.0, "", "alpha";
        /// Opacity that reflecting edges add.
        edge_strength: 0.6, 0.0..=10.0, "", "e_s";
        /// Opacity where nothing is reflected.
        edge_bias: 0.9, 0.0..=10.0, "", "e_b";
        /// Distance at which half of a drop's opacity is left.
        half_distance_m: 40.0, 0.1..=1e5, "m", "d_p";
        /// Factor on light that drops scatter from the sun, lamps overhead and lightning.
        back_light: 1.0, 0.0..=100.0, "", "";
        /// White in the water.
        milk: 0.1, 0.0..=1.0, "", "milk";
        /// How much brighter and clearer drops are in lightning.
        contrast: 0.25, 0.0..=10.0, "", "k_c";
        /// How much a drop's velocity blurs what it shows.
        blur: 1.0, 0.0..=4.0, "", "";
        /// Irradiance of lightning at its brightest, in the buffers' unit.
        flash: 10.0, 0.0..=1e6, "W/m2", "";
        /// Height of lamps overhead over the ground, by which the light map tells where they stand.
        lamp_height_m: 5.0, 0.5..=100.0, "m", "";
    }
}

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DripReport {
    /// Drops in the air that lie in the picture.
    pub falling: u64,
    /// Drops that hang and swell.
    pub hanging: u64,
    /// Pixels that they touched, each as often as it was.
    pub pixels: u64,
}

/// Drops a second of one spot at most: beyond, water runs in a thread.
const SPOT_MOST: f64 = 60.0;
/// Spots of an edge at most.
const SPOTS_MOST: f64 = 4096.0;
/// Longest fall that is followed, s: 20 m.
const LONGEST_S: f64 = 2.4;
/// Longest time that a drop is seen to swell, s.
const SWELL_S: f64 = 0.3;
/// Drops narrower than this are left out, px.
const LEAST_PX: f32 = 0.25;

/// A drop at a time.
#[derive(Clone, Copy, Debug)]
struct Drop {
    place: DVec3,
    velocity: DVec3,
    radius_m: f64,
    /// Height over width.
    stretch: f32,
    hangs: bool,
}

/// Dripping, with the memory that is kept from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Drips {
    light: LightMemory,
    drops: Vec<(f32, Drop)>,
}

/// Drops that leave an edge in a second.
pub fn drops_per_s(edge: &DripEdge, rate_mm_per_h: f64, controls: &DripControls) -> f64 {
    let diameter = f64::from(controls.diameter_mm) * 1e-3;
    let volume = PI / 6.0 * diameter * diameter * diameter;
    let water = rate_mm_per_h.max(0.0) * 1e-3 / 3600.0 * f64::from(edge.drains_m2).max(0.0);
    f64::from(controls.amount) * water / volume
}

impl Drips {
    /// No memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Clears `out` and draws what drips from `maps.drips` at the frame's time. Needs depth; what lies behind it is hidden.
    ///
    /// # Errors
    ///
    /// Buffers of another size than the camera's, numbers of the frame outside what effects take, controls out of their ranges, an edge that is nowhere.
    pub fn draw(
        &mut self,
        frame: &WetFrame<'_>,
        controls: &DripControls,
        out: &mut Layer,
    ) -> Result<DripReport, RuntimeError> {
        self.draw_from(&frame.maps.drips, frame, controls, out)
    }

    /// The same with an artist's own edges.
    ///
    /// # Errors
    ///
    /// As [`Self::draw`].
    pub fn draw_from(
        &mut self,
        edges: &[DripEdge],
        frame: &WetFrame<'_>,
        controls: &DripControls,
        out: &mut Layer,
    ) -> Result<DripReport, RuntimeError> {
        drop::check(frame)?;
        controls.check()?;
        check(edges)?;
        out.clear(frame.buffer.size);
        let mut report = DripReport::default();
        let eye = Eye::new(frame.camera);
        let width = controls.diameter_mm * 1e-3;
        self.drops.clear();
        for (index, edge) in edges.iter().enumerate() {
            let drops = &mut self.drops;
            each_drop(edge, index as u64, frame, controls, |one| {
                let spot = eye.see(eye.offset(one.place));
                if let Some(spot) = spot.filter(|spot| width * eye.pixels_per_metre(spot.depth) > LEAST_PX) {
                    drops.push((spot.depth, one));
                }
            });
        }
        if self.drops.is_empty() {
            return Ok(report);
        }
        self.drops.sort_by(|a, b| b.0.total_cmp(&a.0));
        let lights = LightControls {
            flash: controls.flash,
            lamp_height_m: controls.lamp_height_m,
            paper: controls.paper > 0.5,
        };
        let mut light = self.light.prepare(frame, &eye, &lights);
        for (_, one) in &self.drops {
            let touched = paint(one, frame, &eye, controls, &mut light, out);
            report.pixels += touched;
            if touched > 0 {
                report.hanging += u64::from(one.hangs);
                report.falling += u64::from(!one.hangs);
            }
        }
        Ok(report)
    }
}

fn check(edges: &[DripEdge]) -> Result<(), RuntimeError> {
    for edge in edges {
        if !(edge.ends_m.iter().all(|end| end.is_finite()) && edge.drains_m2.is_finite()) {
            let found = format!("{edge:?}");
            return Err(RuntimeError::argument("drips", "edges of finite numbers", found));
        }
    }
    Ok(())
}

/// Every drop of an edge that hangs or falls at the frame's time.
fn each_drop(
    edge: &DripEdge,
    index: u64,
    frame: &WetFrame<'_>,
    controls: &DripControls,
    mut each: impl FnMut(Drop),
) {
    let rate = drops_per_s(edge, frame.rate_mm_per_h, controls);
    if rate <= 0.0 {
        return;
    }
    let length = edge.ends_m[0].distance(edge.ends_m[1]);
    let spots = libm::ceil(length / f64::from(controls.spacing_m)).clamp(1.0, SPOTS_MOST) as u64;
    let stream = |spot: u64| Random::from_parts(&[frame.seed, 0x4452_4950, index, spot]);
    // Some spots gather much water and most little.
    let share = |own: &mut Random| own.exponential().min(2.5) + 0.1;
    let all: f64 = (0..spots).map(|spot| share(&mut stream(spot))).sum();
    let diameter = f64::from(controls.diameter_mm) * 1e-3;
    let last = last_speed(diameter);
    for spot in 0..spots {
        let mut own = stream(spot);
        let rate = (rate * share(&mut own) / all).min(SPOT_MOST);
        let along = (spot as f64 + own.unit()) / spots as f64;
        let from = edge.ends_m[0].lerp(edge.ends_m[1], along);
        let begun = frame.time_s * rate + own.unit();
        let ground = frame.maps.height_m.as_ref().and_then(|map| map.at(from.truncate()));
        let (first, last_one) =
            (libm::floor(begun - LONGEST_S * rate) as i64 - 1, libm::floor(begun) as i64 + 2);
        for number in first..=last_one {
            let mut this = Random::from_parts(&[frame.seed, 0x4452_4951, index, spot, number as u64]);
            let age = (begun - number as f64 - 0.6 * this.unit()) / rate;
            let swell = SWELL_S.min(0.5 / rate);
            if age < -swell || age > LONGEST_S {
                continue;
            }
            let size = diameter * this.range(0.85, 1.1);
            let mut one =
                Drop { place: from, velocity: DVec3::ZERO, radius_m: 0.5 * size, stretch: 1.0, hangs: false };
            if age < 0.0 {
                let grown = 1.0 + age / swell;
                one.radius_m *= libm::cbrt(grown.max(0.05));
                one.place.z -= one.radius_m * (0.3 + 0.7 * grown);
                one.stretch = 1.0 + 0.35 * (grown * grown) as f32;
                one.hangs = true;
            } else {
                let kick = DVec3::new(this.range(-0.06, 0.06), this.range(-0.06, 0.06), 0.0);
                let (fell, velocity) = fallen(age, last, frame.wind);
                one.place += fell + kick * age - DVec3::Z * one.radius_m;
                one.velocity = velocity + kick;
                // Let go, it swings between long and flat, at the lowest note of a ball of 5 mm.
                let swing = 0.35 * libm::exp(-age / 0.12) * libm::cos(2.0 * PI * 38.0 * age);
                one.stretch = drop::flatness(size) * (1.0 + swing as f32);
            }
            // A lid over the spot is the edge's own roof: only what lies below the edge ends a fall.
            if ground
                .is_none_or(|height| f64::from(height) > from.z - 0.05 || one.place.z > f64::from(height))
            {
                each(one);
            }
        }
    }
}

/// Draws one drop; returns pixels touched.
fn paint(
    one: &Drop,
    frame: &WetFrame<'_>,
    eye: &Eye,
    controls: &DripControls,
    light: &mut DropLight<'_>,
    out: &mut Layer,
) -> u64 {
    let offset = eye.offset(one.place);
    let half = (one.velocity * (0.5e-3 * f64::from(controls.exposure_ms))).as_vec3();
    let (Some(spot), Some(from), Some(to)) =
        (eye.see(offset), eye.see(offset - half), eye.see(offset + half))
    else {
        return 0;
    };
    let way = Vec2::new(to.x - from.x, from.y - to.y);
    let radius_px = one.radius_m as f32 * eye.pixels_per_metre(spot.depth);
    let reach = radius_px * 2.0 + way.length();
    let size = eye.size.map(|n| n as f32);
    if spot.x < -reach || spot.y < -reach || spot.x > size[0] + reach || spot.y > size[1] + reach {
        return 0;
    }
    let down = Vec2::new(-eye.right.z, -eye.up.z).normalize_or(Vec2::NEG_Y);
    let along = way.try_normalize().unwrap_or(down);
    let stamp = Stamp { spot, along, radius_px, stretch: one.stretch, way_px: way.length() };
    let direction = eye.towards(offset);
    let beams = light.beams_from(one.place, direction);
    let blur = controls.blur * drop::velocity_blur(stamp.way_px, radius_px);
    let opacity = Opacity {
        edge_strength: controls.edge_strength,
        edge_bias: controls.edge_bias,
        distance: distance_fade(Vec3::length(offset), controls.half_distance_m),
        lightning_bias: lightning_bias(controls.contrast, frame.lightning),
        paper_m: (controls.paper > 0.5).then(|| offset.length()),
    };
    let paint = Paint {
        ball: light.ball(&spot),
        beams: (beams.0 * controls.back_light, beams.1),
        opacity,
        alpha: controls.opacity,
        milk: controls.milk,
        blur,
    };
    stamp.draw(eye, frame.buffer, &paint, out)
}

#[cfg(test)]
mod tests;
