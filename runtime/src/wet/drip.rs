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
use crate::wet::drop::eye::{Eye, Spot};
use crate::wet::drop::light::{DropLight, LightControls, LightMemory};
use crate::wet::drop::{
    self, Opacity, Paint, Stamp, distance_fade, fall_time_s, fallen, last_speed, lightning_bias,
};
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
    /// Whether edges in view have more water, or more places to drip from, than is followed: then all of them drip less, by the same share.
    pub thinned: bool,
}

/// Drops a second of one spot at most: beyond, water runs in a thread.
const SPOT_MOST: f64 = 60.0;
/// Spots of an edge at most.
const SPOTS_MOST: f64 = 4096.0;
/// Spots of all edges in view at most, and drops of theirs that are followed at a time.
const ALL_SPOTS: f64 = 262_144.0;
const DROPS_MOST: f64 = 131_072.0;
/// Edges at most.
const EDGES_MOST: usize = 1 << 20;
/// Where neither ground nor the picture's end stops a fall it is followed this far, m.
const FALL_MOST_M: f64 = 400.0;
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
    spots: Vec<Spout>,
    drops: Vec<(f32, Drop)>,
}

/// A spot that drips.
#[derive(Clone, Debug)]
struct Spout {
    /// Of its edge, and on it.
    number: [u64; 2],
    from: DVec3,
    /// Drops a second.
    rate: f64,
    /// Part of a drop that was let go at time 0.
    begun: f64,
    /// Height of the ground below, m, if it is known.
    ground: Option<f64>,
    /// Time in which a drop comes to the ground or out of the picture, s.
    longest_s: f64,
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
        let eye = Eye::new(frame.camera);
        let mut report =
            DripReport { thinned: self.find(edges, frame, &eye, controls), ..DripReport::default() };
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

impl Drips {
    /// Finds the drops that lie in the picture; says whether they had to be thinned.
    fn find(&mut self, edges: &[DripEdge], frame: &WetFrame<'_>, eye: &Eye, controls: &DripControls) -> bool {
        self.drops.clear();
        let crowded = spouts(edges, frame, eye, controls, &mut self.spots);
        let followed = |spout: &Spout| spout.rate * (spout.longest_s + SWELL_S);
        let share = (DROPS_MOST / self.spots.iter().map(followed).sum::<f64>().max(1.0)).min(1.0);
        let width = controls.diameter_mm * 1e-3;
        for spout in &self.spots {
            each_drop(spout, share, frame, controls, |one| {
                let track = track(&one, eye, controls);
                let seen = |track: &Track| width * eye.pixels_per_metre(track.spot.depth) > LEAST_PX;
                if let Some(track) = track.filter(seen) {
                    self.drops.push((track.spot.depth, one));
                }
            });
        }
        crowded || share < 1.0
    }
}

fn check(edges: &[DripEdge]) -> Result<(), RuntimeError> {
    if edges.len() > EDGES_MOST {
        return Err(RuntimeError::argument("drips", format!("at most {EDGES_MOST} edges"), edges.len()));
    }
    for edge in edges {
        if !(edge.ends_m.iter().all(|end| end.is_finite()) && edge.drains_m2.is_finite()) {
            let found = format!("{edge:?}");
            return Err(RuntimeError::argument("drips", "edges of finite numbers", found));
        }
    }
    Ok(())
}

/// The spots of those edges whose drops the picture may show; says whether edges have fewer than they should.
fn spouts(
    edges: &[DripEdge],
    frame: &WetFrame<'_>,
    eye: &Eye,
    controls: &DripControls,
    out: &mut Vec<Spout>,
) -> bool {
    out.clear();
    let diameter = f64::from(controls.diameter_mm) * 1e-3;
    let last = last_speed(diameter);
    let far = eye.farthest(controls.diameter_mm * 1e-3, LEAST_PX);
    // Lower than the picture's farthest corner nothing is seen.
    let lowest = eye.position.z - f64::from(far) * f64::from(eye.longest());
    let bottom = |from: DVec3| lowest.max(from.z - FALL_MOST_M);
    // Whether the picture may show anything that falls from between two corners down to a height.
    let visible = |low: DVec3, high: DVec3, below: f64| {
        let seconds = fall_time_s(high.z - below, last);
        let drift = frame.wind.truncate().abs() * seconds + 0.1 * seconds;
        // A shutter's time more of its way, and a drop's own size.
        let blur = 1e-3 * f64::from(controls.exposure_ms) * (last + frame.wind.length()) + 0.1;
        let aside = drift.extend(0.0) + blur;
        !eye.misses(low.with_z(below) - aside, high + aside, far)
    };
    let wanted = |edge: &DripEdge| {
        let length = edge.ends_m[0].distance(edge.ends_m[1]);
        libm::ceil(length / f64::from(controls.spacing_m)).clamp(1.0, SPOTS_MOST)
    };
    let drips = |edge: &DripEdge| {
        let (low, high) = (edge.ends_m[0].min(edge.ends_m[1]), edge.ends_m[0].max(edge.ends_m[1]));
        drops_per_s(edge, frame.rate_mm_per_h, controls) > 0.0 && visible(low, high, bottom(high).min(low.z))
    };
    let all: f64 = edges.iter().filter(|edge| drips(edge)).map(wanted).sum();
    let share = (ALL_SPOTS / all.max(1.0)).min(1.0);
    for (index, edge) in edges.iter().enumerate().filter(|(_, edge)| drips(edge)) {
        let index = index as u64;
        // Of edges that should have less than one spot some have one.
        let rest =
            if share < 1.0 { Random::from_parts(&[frame.seed, 0x4452_4952, index]).unit() } else { 0.0 };
        let spots = (wanted(edge) * share + rest) as u64;
        let stream = |spot: u64| Random::from_parts(&[frame.seed, 0x4452_4950, index, spot]);
        // Some spots gather much water and most little.
        let own_share = |own: &mut Random| own.exponential().min(2.5) + 0.1;
        let sum: f64 = (0..spots).map(|spot| own_share(&mut stream(spot))).sum();
        let rate = drops_per_s(edge, frame.rate_mm_per_h, controls);
        for spot in 0..spots {
            let mut own = stream(spot);
            let rate = (rate * own_share(&mut own) / sum).min(SPOT_MOST);
            let along = (spot as f64 + own.unit()) / spots as f64;
            let from = edge.ends_m[0].lerp(edge.ends_m[1], along);
            // A lid over the spot is the edge's own roof: only what lies below the edge ends a fall.
            let ground = frame.maps.height_m.as_ref().and_then(|map| map.at(from.truncate()));
            let ground = ground.map(f64::from).filter(|height| *height <= from.z - 0.05);
            let end = ground.map_or(bottom(from), |height| height.max(bottom(from)));
            let longest_s = fall_time_s(from.z - end, last);
            if !visible(from, from, end.min(from.z)) {
                continue;
            }
            out.push(Spout { number: [index, spot], from, rate, begun: own.unit(), ground, longest_s });
        }
    }
    share < 1.0
}

/// Every drop of a spot that hangs or falls at the frame's time, where it drips this share of what it has.
fn each_drop(
    spout: &Spout,
    share: f64,
    frame: &WetFrame<'_>,
    controls: &DripControls,
    mut each: impl FnMut(Drop),
) {
    let diameter = f64::from(controls.diameter_mm) * 1e-3;
    let last = last_speed(diameter);
    let (rate, from) = (spout.rate * share, spout.from);
    if rate > 0.0 {
        let [index, spot] = spout.number;
        let begun = frame.time_s * rate + spout.begun;
        let first = libm::floor(begun - spout.longest_s * rate) as i64 - 1;
        let last_one = libm::floor(begun) as i64 + 2;
        for number in first..=last_one {
            let mut this = Random::from_parts(&[frame.seed, 0x4452_4951, index, spot, number as u64]);
            let age = (begun - number as f64 - 0.6 * this.unit()) / rate;
            let swell = SWELL_S.min(0.5 / rate);
            if age < -swell || age > spout.longest_s {
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
                // Let go, it swings between long and flat.
                let swing = 0.35 * libm::exp(-age / 0.12) * libm::cos(drop::swing_rate(size) * age);
                one.stretch = drop::flatness(size) * (1.0 + swing as f32);
            }
            if spout.ground.is_none_or(|height| one.place.z > height) {
                each(one);
            }
        }
    }
}

/// A drop's way through the picture while the shutter is open.
struct Track {
    spot: Spot,
    way: Vec2,
    radius_px: f32,
}

/// `None` where it lies outside the picture, or too near the lens.
fn track(one: &Drop, eye: &Eye, controls: &DripControls) -> Option<Track> {
    let offset = eye.offset(one.place);
    let half = (one.velocity * (0.5e-3 * f64::from(controls.exposure_ms))).as_vec3();
    let (spot, from, to) = (eye.see(offset)?, eye.see(offset - half)?, eye.see(offset + half)?);
    let way = Vec2::new(to.x - from.x, from.y - to.y);
    let radius_px = one.radius_m as f32 * eye.pixels_per_metre(spot.depth);
    let reach = radius_px * 2.0 + way.length();
    let inside = |at: f32, size: usize| (-reach..=size as f32 + reach).contains(&at);
    (inside(spot.x, eye.size[0]) && inside(spot.y, eye.size[1])).then_some(Track { spot, way, radius_px })
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
    let Some(Track { spot, way, radius_px }) = track(one, eye, controls) else { return 0 };
    let offset = eye.offset(one.place);
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
