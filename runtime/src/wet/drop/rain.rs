//! Rain close to the lens: drops one by one, with the world in them. \[toyshop\] §3.1, in places of the world.
//!
//! Each class of drops falls with a velocity of its own and carries a lattice along, whose cells hold Poisson numbers of drops hashed by the cell: a drop is
//! where it is whatever the camera does. Farther than `far_m` rain is streaks, which others draw.

use super::eye::Eye;
use super::light::{DropLight, LightControls, LightMemory};
use super::look::{Opacity, distance_fade, lightning_bias};
use super::stamp::{Paint, Stamp, flatness, swing_rate, velocity_blur};
use crate::error::RuntimeError;
use crate::random::Random;
use crate::wet::controls::controls;
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::ripples::DropFlux;
use crate::wet::splash::hits::Fall;
use glam::{DVec3, Vec2, Vec3};

controls! {
    /// How drops close to the lens look.
    pub struct DropControls {
        /// Farthest drop that is drawn.
        far_m: 3.0, 0.2..=20.0, "m", "";
        /// Factor on a drop's size.
        size: 1.0, 0.1..=10.0, "", "";
        /// Time that a shutter is open: drops are as long as they fall in it.
        exposure_ms: 4.0, 0.0..=1000.0, "ms", "";
        /// How much drops swing about the shape that they fall with.
        swing: 0.1, 0.0..=0.5, "", "";
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
pub struct DropReport {
    /// Drops in the picture.
    pub drops: u64,
    /// Pixels that they touched, each as often as it was.
    pub pixels: u64,
}

/// Side of a lattice's cell, m.
const CELL_M: f64 = 0.4;
/// Drops narrower than this are left out, px.
const LEAST_PX: f32 = 0.5;
/// Share of the farthest distance over which drops fade in.
const FADE: f32 = 0.25;

/// Rain close to the lens, with the memory that is kept from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Drops {
    light: LightMemory,
    found: Vec<(f32, Close)>,
}

/// A drop to draw.
#[derive(Clone, Debug)]
struct Close {
    place: DVec3,
    velocity: DVec3,
    diameter_m: f64,
    random: Random,
}

impl Drops {
    /// No memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Clears `out` and draws the drops near the lens at the frame's time. Needs depth; under `maps.height_m` none falls.
    ///
    /// # Errors
    ///
    /// Buffers of another size than the camera's, numbers of the frame outside what effects take, or controls out of their ranges.
    pub fn draw(
        &mut self,
        frame: &WetFrame<'_>,
        controls: &DropControls,
        out: &mut Layer,
    ) -> Result<DropReport, RuntimeError> {
        super::check(frame)?;
        controls.check()?;
        out.clear(frame.buffer.size);
        let eye = Eye::new(frame.camera);
        self.found.clear();
        let fall = Fall::new(frame);
        for (class, drop) in frame.flux.iter().enumerate() {
            if drop.impacts_per_m2_s > 0.0 && drop.speed_m_per_s > 0.1 && drop.diameter_m > 0.0 {
                self.find(frame, &eye, controls, (class as u64, drop, &fall));
            }
        }
        let mut report = DropReport::default();
        if self.found.is_empty() {
            return Ok(report);
        }
        self.found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let lights = LightControls {
            flash: controls.flash,
            lamp_height_m: controls.lamp_height_m,
            paper: controls.paper > 0.5,
        };
        let mut light = self.light.prepare(frame, &eye, &lights);
        for (_, close) in &mut self.found {
            let touched = paint(close, frame, &eye, controls, &mut light, out);
            report.pixels += touched;
            report.drops += u64::from(touched > 0);
        }
        Ok(report)
    }

    fn find(
        &mut self,
        frame: &WetFrame<'_>,
        eye: &Eye,
        controls: &DropControls,
        (class, drop, fall): (u64, &DropFlux, &Fall<'_>),
    ) {
        let width = drop.diameter_m as f32 * controls.size;
        let far = controls.far_m.min(width * eye.pixels_per_metre(1.0) / LEAST_PX);
        let velocity = DVec3::new(frame.wind.x, frame.wind.y, -drop.speed_m_per_s);
        let carried = velocity * frame.time_s;
        // The box around what the lens sees up to there, in the lattice.
        let [w, h] = eye.size.map(|n| n as f32);
        let corners = [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]];
        let ends =
            corners.into_iter().flat_map(|[x, y]| [eye.at(x, y, super::eye::NEAREST), eye.at(x, y, far)]);
        let (low, high) =
            ends.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), end| (low.min(end), high.max(end)));
        let cell = |offset: Vec3| ((offset.as_dvec3() + eye.position - carried) / CELL_M).floor();
        let (low, high) = (cell(low), cell(high));
        let mean = drop.impacts_per_m2_s / drop.speed_m_per_s * CELL_M * CELL_M * CELL_M;
        let half = 0.87 * CELL_M as f32;
        for z in low.z as i64..=high.z as i64 {
            for y in low.y as i64..=high.y as i64 {
                for x in low.x as i64..=high.x as i64 {
                    let middle =
                        DVec3::new(x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5) * CELL_M + carried;
                    let depth = eye.offset(middle).dot(eye.forward);
                    if depth < -half || depth > far + half {
                        continue;
                    }
                    let mut random =
                        Random::from_parts(&[frame.seed, 0x434C_4F53, class, x as u64, y as u64, z as u64]);
                    for _ in 0..random.poisson(mean) {
                        let mut random = Random::new(random.bits());
                        let at = DVec3::new(random.unit(), random.unit(), random.unit()) - 0.5;
                        let place = middle + at * CELL_M;
                        let Some(spot) = eye.see(eye.offset(place)) else { continue };
                        let seen = spot.depth < far && spot.x > -0.2 * w && spot.x < 1.2 * w;
                        if !seen
                            || spot.y < -h
                            || spot.y > 2.0 * h
                            || fall.sheltered(place, drop.speed_m_per_s)
                        {
                            continue;
                        }
                        let diameter_m = drop.diameter_m * f64::from(controls.size);
                        self.found.push((spot.depth, Close { place, velocity, diameter_m, random }));
                    }
                }
            }
        }
    }
}

/// Draws one drop; returns pixels touched.
fn paint(
    close: &mut Close,
    frame: &WetFrame<'_>,
    eye: &Eye,
    controls: &DropControls,
    light: &mut DropLight<'_>,
    out: &mut Layer,
) -> u64 {
    let offset = eye.offset(close.place);
    let half = (close.velocity * (0.5e-3 * f64::from(controls.exposure_ms))).as_vec3();
    let (Some(spot), Some(from), Some(to)) =
        (eye.see(offset), eye.see(offset - half), eye.see(offset + half))
    else {
        return 0;
    };
    let way = Vec2::new(to.x - from.x, from.y - to.y);
    let turn = close.random.range(0.0, std::f64::consts::TAU) + swing_rate(close.diameter_m) * frame.time_s;
    let stretch = flatness(close.diameter_m) * (1.0 + controls.swing * libm::sin(turn) as f32);
    // As much water as a ball of the same diameter.
    let radius_m = 0.5 * close.diameter_m as f32 / libm::cbrtf(stretch);
    let radius_px = radius_m * eye.pixels_per_metre(spot.depth);
    let far = controls.far_m.min(close.diameter_m as f32 * eye.pixels_per_metre(1.0) / LEAST_PX);
    let fade = ((far - spot.depth) / (FADE * far)).clamp(0.0, 1.0);
    let along = way.try_normalize().unwrap_or(Vec2::NEG_Y);
    let stamp = Stamp { spot, along, radius_px, stretch, way_px: way.length() };
    let beams = light.beams_from(close.place, eye.towards(offset));
    let opacity = Opacity {
        edge_strength: controls.edge_strength,
        edge_bias: controls.edge_bias,
        distance: distance_fade(offset.length(), controls.half_distance_m),
        lightning_bias: lightning_bias(controls.contrast, frame.lightning),
        paper_m: (controls.paper > 0.5).then(|| offset.length()),
    };
    let paint = Paint {
        ball: light.ball(&spot),
        beams: (beams.0 * controls.back_light, beams.1),
        opacity,
        alpha: controls.opacity * fade,
        milk: controls.milk,
        blur: controls.blur * velocity_blur(stamp.way_px, radius_px),
    };
    stamp.draw(eye, frame.buffer, &paint, out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wet::drop::stage::Stage;

    fn stage() -> Stage {
        Stage::new(DVec3::new(3.0, 0.0, 1.6), DVec3::new(3.0, 5.0, 1.6), [320, 240])
    }

    #[test]
    fn the_air_holds_flux_over_speed_drops_a_cubic_metre() {
        let mut stage = stage();
        stage.flux = vec![DropFlux { diameter_m: 5e-3, speed_m_per_s: 9.0, impacts_per_m2_s: 3000.0 }];
        let (eye, controls) =
            (Eye::new(&stage.camera), DropControls { far_m: 2.0, ..DropControls::default() });
        let mut drops = Drops::new();
        drops.find(&stage.frame(2.2), &eye, &controls, (0, &stage.flux[0], &Fall::new(&stage.frame(2.2))));
        let inside = |close: &&(f32, Close)| {
            eye.see(eye.offset(close.1.place))
                .is_some_and(|spot| spot.depth > 0.1 && eye.pixel(&spot).is_some())
        };
        let found = drops.found.iter().filter(inside).count() as f64;
        let half = stage.camera.half_extent();
        let expected = 3000.0 / 9.0 * 4.0 * half.x * half.y * (8.0 - 0.001) / 3.0;
        assert!((found - expected).abs() < 5.0 * expected.sqrt(), "{found} {expected}");
    }

    #[test]
    fn a_drop_falls_at_its_speed_and_keeps_its_place_as_the_camera_moves() {
        let stage = stage();
        let (eye, controls) =
            (Eye::new(&stage.camera), DropControls { size: 4.0, ..DropControls::default() });
        let places = |eye: &Eye, time: f64| {
            let mut drops = Drops::new();
            drops.find(
                &stage.frame(time),
                eye,
                &controls,
                (1, &stage.flux[1], &Fall::new(&stage.frame(time))),
            );
            drops.found.iter().map(|close| close.1.place).collect::<Vec<_>>()
        };
        let near = |places: &[DVec3], at: DVec3| places.iter().any(|place| place.distance(at) < 1e-6);
        let (now, later) = (places(&eye, 4.0), places(&eye, 4.01));
        let fall = DVec3::new(0.0, 0.0, -0.01 * stage.flux[1].speed_m_per_s);
        let kept = now.iter().filter(|place| near(&later, **place + fall)).count();
        assert!(kept * 10 > now.len() * 8 && now.len() > 100, "{kept} of {}", now.len());
        let moved = Stage::new(DVec3::new(3.1, 0.05, 1.5), DVec3::new(2.9, 5.0, 1.7), [320, 240]);
        let other = places(&Eye::new(&moved.camera), 4.0);
        let kept = now.iter().filter(|place| near(&other, **place)).count();
        assert!(kept * 10 > now.len() * 8, "{kept} of {}", now.len());
    }

    #[test]
    fn a_ball_shows_the_world_upside_down() {
        // The stage's sky is bright and its ground dark: a drop is bright below and dark above.
        let stage = stage();
        let eye = Eye::new(&stage.camera);
        let lights = LightControls { flash: 1.0, lamp_height_m: 5.0, paper: false };
        let mut memory = LightMemory::default();
        let frame = stage.frame(0.0);
        let mut light = memory.prepare(&frame, &eye, &lights);
        let spot = crate::wet::drop::eye::Spot { x: 160.0, y: 120.0, depth: 1.0 };
        let ball = light.ball(&spot);
        let [above, below] = [0.7, -0.7].map(|y| ball.radiance(Vec2::new(0.0, y), 0.0).y);
        assert!(below > 2.0 * above, "{below} {above}");
    }

    #[test]
    fn the_papers_drops_look_otherwise_and_controls_are_held_to_their_ranges() {
        let stage = stage();
        let draw = |controls: &DropControls| {
            let mut layer = Layer::default();
            Drops::new().draw(&stage.frame(1.0), controls, &mut layer).map(|_| layer)
        };
        let paper = draw(&DropControls { paper: 1.0, ..DropControls::default() }).unwrap();
        assert!(paper.alpha.iter().all(|alpha| (0.0..=1.0).contains(alpha)));
        assert_ne!(paper, draw(&DropControls::default()).unwrap());
        assert!(draw(&DropControls { far_m: f32::INFINITY, ..DropControls::default() }).is_err());
    }

    #[test]
    fn without_rain_or_under_a_roof_the_frame_keeps_its_bits() {
        let mut stage = stage();
        let mut layer = Layer::default();
        assert!(
            Drops::new().draw(&stage.frame(1.0), &DropControls::default(), &mut layer).unwrap().drops > 50
        );
        stage.roof(9.0, 5.0);
        assert_eq!(
            Drops::new().draw(&stage.frame(1.0), &DropControls::default(), &mut layer).unwrap().drops,
            0
        );
        stage.maps.height_m = None;
        stage.flux.clear();
        Drops::new().draw(&stage.frame(1.0), &DropControls::default(), &mut layer).unwrap();
        let mut picture = stage.buffer.colour.clone();
        layer.onto(&mut picture).unwrap();
        assert_eq!(picture, stage.buffer.colour);
    }
}
