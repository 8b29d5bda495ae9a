//! Splatters on the surfaces near the camera: thin rings that drops leave as they burst, in shells over the surface. \[toyshop\] §3.4.
//!
//! A hit of [`super::splash`]'s own process throws a ring that grows as the square root of its age, as water does that spreads over a surface. In each further
//! shell, a little farther out along the normal, the ring is wider and thinner. A ring is a ridge of water: its slopes mirror
//! another part of the world than the surface does, and its fringe of droplets scatters.

use crate::error::RuntimeError;
use crate::wet::controls::controls;
use crate::wet::drop::eye::{Eye, Spot};
use crate::wet::drop::light::{DropLight, LightControls, LightMemory};
use crate::wet::drop::{self, lightning_bias, milky};
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::splash::hits::{Class, Columns, Fall, Hit};
use crate::wet::splash::splashes;
use glam::{Mat2, Vec2, Vec3};

controls! {
    /// How splatters look.
    pub struct SplatterControls {
        /// Farthest surface that has them.
        far_m: 6.0, 0.5..=50.0, "m", "";
        /// Factor on a ring's size.
        size: 1.0, 0.1..=10.0, "", "";
        /// Number of shells over a surface.
        shells: 3.0, 1.0..=6.0, "", "";
        /// How long a ring lives.
        life_s: 0.25, 0.02..=2.0, "s", "";
        /// Steepness of a ring's ridge.
        slope: 0.6, 0.0..=3.0, "", "";
        /// Opacity of the fringe of droplets.
        opacity: 0.5, 0.0..=1.0, "", "alpha";
        /// Depth of the film of water that drops fall on.
        film_mm: 0.2, 0.0..=10.0, "mm", "";
        /// Rings narrower than this fade out.
        smallest_px: 3.0, 1.0..=64.0, "px", "";
        /// Factor on light that droplets scatter from the sun, lamps overhead and lightning.
        back_light: 1.0, 0.0..=100.0, "", "";
        /// White in the water.
        milk: 0.2, 0.0..=1.0, "", "milk";
        /// How much brighter splatters are in lightning.
        contrast: 0.25, 0.0..=10.0, "", "k_c";
        /// Irradiance of lightning at its brightest, in the buffers' unit.
        flash: 10.0, 0.0..=1e6, "W/m2", "";
        /// Height of lamps overhead over the ground, by which the light map tells where they stand.
        lamp_height_m: 5.0, 0.5..=100.0, "m", "";
    }
}

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SplatterReport {
    /// Rings.
    pub rings: u64,
    /// Pixels that they touched, each as often as it was.
    pub pixels: u64,
}

/// Radius that a ring comes to, in crater radii.
const WIDEST: f32 = 2.4;
/// Distance of shells, in the ring's widest radius, and how much wider a ring is in the next.
const SHELL: f32 = 0.06;
const WIDER: f32 = 0.16;
/// Half the width of a ridge over the ring's widest radius.
const RIDGE: f32 = 0.09;

/// Splatters, with the memory that is kept from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Splatters {
    columns: Columns,
    light: LightMemory,
    found: Vec<(Hit, f32, f32)>,
}

impl Splatters {
    /// No memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Clears `out` and draws splatters on floors, and on walls that wind drives rain against. Needs depth and normals.
    ///
    /// # Errors
    ///
    /// Buffers of another size than the camera's, numbers of the frame outside what effects take, or controls out of their ranges.
    pub fn draw(
        &mut self,
        frame: &WetFrame<'_>,
        controls: &SplatterControls,
        out: &mut Layer,
    ) -> Result<SplatterReport, RuntimeError> {
        drop::check(frame)?;
        controls.check()?;
        out.clear(frame.buffer.size);
        let mut report = SplatterReport::default();
        let film = f64::from(controls.film_mm) * 1e-3;
        let mut classes = frame.flux.iter().enumerate();
        let any = classes.any(|(_, drop)| drop.impacts_per_m2_s > 0.0 && splashes(drop, film));
        if !any {
            return Ok(report);
        }
        let eye = Eye::new(frame.camera);
        self.columns.read(frame.buffer, &eye, controls.far_m, true);
        let fall = Fall::new(frame);
        self.found.clear();
        for (stream, drop) in frame.flux.iter().enumerate().filter(|(_, drop)| splashes(drop, film)) {
            let radius = WIDEST * controls.size * drop.crater_radius_m() as f32;
            let far_m = controls.far_m.min(2.0 * radius * eye.pixels_per_metre(1.0) / controls.smallest_px);
            let life_s = f64::from(controls.life_s);
            let class = Class { drop, stream: stream as u64, life_s, far_m, fall: &fall };
            let found = &mut self.found;
            self.columns.hits(frame, &eye, &class, |hit| {
                let fade = ((far_m - hit.spot.depth) / (0.5 * far_m)).clamp(0.0, 1.0);
                if fade > 0.0 {
                    found.push((hit.clone(), radius, fade));
                }
            });
        }
        self.found.sort_by(|a, b| b.0.spot.depth.total_cmp(&a.0.spot.depth));
        let lights =
            LightControls { flash: controls.flash, lamp_height_m: controls.lamp_height_m, paper: false };
        let mut light = self.light.prepare(frame, &eye, &lights);
        for (hit, radius, fade) in &mut self.found {
            let touched = ring(hit, *radius, *fade, (frame, &eye, controls), &mut light, out);
            report.pixels += touched;
            report.rings += u64::from(touched > 0);
        }
        Ok(report)
    }
}

/// A ring's ridge at a distance from its own line, in half widths: how high it stands, and its slope; both 0 from 1 on.
fn ridge(at: f32) -> (f32, f32) {
    let rest = (1.0 - at * at).max(0.0);
    (rest * rest, -4.0 * at * rest)
}

/// A hit's rings, laid into the picture.
struct Rings {
    /// The surface's axes.
    axes: [Vec3; 2],
    /// From pixels to the surface, in the widest ring's radii.
    back: Mat2,
    /// The shells' middles, px.
    middles: [Vec2; 6],
    shells: usize,
    /// Radius of the first shell's ring over the widest's.
    grown: f32,
    /// Nearest and farthest place of any ring from the first shell's middle, in the widest ring's radii.
    span: [f32; 2],
    /// Half of what the rings cover across and down, px.
    across: [f32; 2],
}

impl Rings {
    /// `None` where they are seen from their side, as lines, or lie behind.
    fn new(hit: &Hit, spot: &Spot, eye: &Eye, (widest, grown, shells): (f32, f32, usize)) -> Option<Self> {
        let axes = axes(hit.normal);
        let flat = |spot: &Spot| Vec2::new(spot.x, spot.y);
        let side = |axis: Vec3| eye.see(hit.offset + axis * widest).map(|end| flat(&end) - flat(spot));
        let map = Mat2::from_cols(side(axes[0])?, side(axes[1])?);
        if map.determinant().abs() < 0.5 {
            return None;
        }
        let back = map.inverse();
        let lift = |shell: usize| {
            let offset = hit.offset + hit.normal * (shell as f32 * SHELL * widest);
            eye.see(offset).map_or(flat(spot), |spot| flat(&spot))
        };
        let middles: [Vec2; 6] = std::array::from_fn(lift);
        let rise = middles[0].distance(middles[shells - 1]);
        // How far shells' middles lie apart along the surface, as the eye sees it.
        let apart = (back * (middles[shells - 1] - middles[0])).length();
        let wider = grown * (1.0 + WIDER * (shells - 1) as f32) + RIDGE;
        let across = [0, 1].map(|k| wider * Vec2::new(map.x_axis[k], map.y_axis[k]).length() + rise);
        let span = [(grown - RIDGE - apart).max(0.0), wider + apart];
        Some(Self { axes, back, middles, shells, grown, span, across })
    }

    /// How high water stands at a place of the picture, 0 to 1 a shell, and its slope along the surface.
    fn at(&self, at: Vec2) -> Option<(f32, Vec3)> {
        let square = (self.back * (at - self.middles[0])).length_squared();
        if square < self.span[0] * self.span[0] || square > self.span[1] * self.span[1] {
            return None;
        }
        let (mut high, mut slope) = (0.0, Vec3::ZERO);
        for (shell, middle) in self.middles[..self.shells].iter().enumerate() {
            let place = self.back * (at - *middle);
            let away = place.length();
            let line = self.grown * (1.0 + WIDER * shell as f32);
            let (rise, tilt) = ridge((away - line) / RIDGE);
            if rise > 0.0 {
                let share = 1.0 / (1.0 + shell as f32);
                high += share * rise;
                let outwards = place / away.max(1e-4);
                slope += (self.axes[0] * outwards.x + self.axes[1] * outwards.y) * (share * tilt);
            }
        }
        (high > 0.0).then_some((high, slope))
    }
}

/// Draws one hit's rings; returns pixels touched.
fn ring(
    hit: &mut Hit,
    radius: f32,
    fade: f32,
    (frame, eye, controls): (&WetFrame<'_>, &Eye, &SplatterControls),
    light: &mut DropLight<'_>,
    out: &mut Layer,
) -> u64 {
    let widest = radius * hit.random.range(0.7, 1.3) as f32;
    let age = (hit.age_s / f64::from(controls.life_s)) as f32;
    let strength = fade * (1.0 - age) * hit.random.range(0.6, 1.0) as f32;
    let spot = hit.spot;
    let size = (widest, age.sqrt(), controls.shells as usize);
    let Some(rings) = Rings::new(hit, &spot, eye, size) else { return 0 };
    let direction = eye.towards(hit.offset);
    let bias = lightning_bias(controls.contrast, frame.lightning);
    let beams = light.beams(hit.place, direction) * controls.back_light;
    let scattered = milky((light.ball(&spot).mean() + beams) * bias, controls.milk);
    let [_, columns] = eye.cover(&spot, rings.across[0]);
    let [rows, _] = eye.cover(&spot, rings.across[1]);
    let allowed = 4.0 * widest + 0.02 * spot.depth;
    let mut touched = 0;
    for y in rows {
        for x in columns.clone() {
            let pixel = y * eye.size[0] + x;
            let near = (spot.depth - allowed)..(spot.depth + allowed);
            if !near.contains(&frame.buffer.depth_m[pixel]) {
                continue;
            }
            let Some((high, slope)) = rings.at(Vec2::new(x as f32 + 0.5, y as f32 + 0.5)) else { continue };
            let cover = strength * high.min(1.0);
            if cover < 0.004 {
                continue;
            }
            let normal = (hit.normal - slope * controls.slope).normalize_or(hit.normal);
            let cosine = (-direction.dot(normal)).max(0.02);
            let mirrored = light.fresnel.at(cosine);
            let mirror = direction - 2.0 * direction.dot(normal) * normal;
            let shine = light.surroundings().radiance(mirror) * (mirrored * bias);
            let fringe = controls.opacity * cover;
            let alpha = fringe + (1.0 - fringe) * mirrored * cover;
            let colour = scattered * fringe + shine * ((1.0 - fringe) * cover);
            out.over(pixel, colour.into(), alpha.min(1.0));
            touched += 1;
        }
    }
    touched
}

/// Two axes along a surface.
fn axes(normal: Vec3) -> [Vec3; 2] {
    let other = if normal.z.abs() < 0.9 { Vec3::Z } else { Vec3::X };
    let first = normal.cross(other).normalize_or(Vec3::X);
    [first, normal.cross(first)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wet::drop::stage::Stage;
    use glam::DVec3;

    fn stage() -> Stage {
        Stage::new(DVec3::new(0.0, 2.0, 1.6), DVec3::new(0.0, 4.2, 0.7), [320, 240])
    }

    fn draw(stage: &Stage, time: f64) -> (Layer, SplatterReport) {
        let mut layer = Layer::default();
        let report =
            Splatters::new().draw(&stage.frame(time), &SplatterControls::default(), &mut layer).unwrap();
        (layer, report)
    }

    #[test]
    fn rings_lie_on_what_rain_strikes() {
        let mut stage = stage();
        let (layer, report) = draw(&stage, 1.0);
        assert!(report.rings > 50, "{report:?}");
        let upper = |pixel: usize| stage.buffer.normal[pixel][2] > 0.5;
        let (mut on, mut off) = (0, 0);
        for (pixel, &alpha) in layer.alpha.iter().enumerate().filter(|(_, alpha)| **alpha > 0.01) {
            let _ = alpha;
            if upper(pixel) { on += 1 } else { off += 1 }
        }
        // Shells stand over the surface: a few hang over its edge.
        assert!(off * 20 < on, "{on} {off}");
        // Wind drives rain against the box's near side.
        stage.wind = DVec3::new(0.0, 8.0, 0.0);
        let (layer, _) = draw(&stage, 1.0);
        let wall =
            (0..stage.buffer.pixels()).filter(|&k| stage.buffer.normal[k][1] < -0.5 && layer.alpha[k] > 0.01);
        assert!(wall.count() > 100);
    }

    #[test]
    fn rings_grow_and_are_thin() {
        let (top, slope) = ridge(0.0);
        assert_eq!((top, slope), (1.0, 0.0));
        assert_eq!(ridge(1.0), (0.0, 0.0));
        assert!(ridge(0.5).1 < 0.0 && ridge(-0.5).1 > 0.0);
    }

    #[test]
    fn no_rain_and_no_normals_leave_the_frame_its_bits() {
        let mut stage = stage();
        stage.flux.clear();
        assert_eq!(draw(&stage, 1.0).1, SplatterReport::default());
        let mut stage = super::tests::stage();
        stage.buffer.normal.fill([0.0; 3]);
        let (layer, _) = draw(&stage, 1.0);
        let mut picture = stage.buffer.colour.clone();
        layer.onto(&mut picture).unwrap();
        assert_eq!(picture, stage.buffer.colour);
    }

    #[test]
    fn controls_out_of_their_ranges_are_refused() {
        let (stage, mut layer) = (stage(), Layer::default());
        for shells in [0.0, 7.0, f32::NAN] {
            let controls = SplatterControls { shells, ..SplatterControls::default() };
            assert!(Splatters::new().draw(&stage.frame(1.0), &controls, &mut layer).is_err());
        }
    }

    #[test]
    fn the_same_time_gives_the_same_rings() {
        let stage = stage();
        assert_eq!(draw(&stage, 2.0), draw(&stage, 2.0));
        assert_ne!(draw(&stage, 2.0).0, draw(&stage, 2.1).0);
    }
}
