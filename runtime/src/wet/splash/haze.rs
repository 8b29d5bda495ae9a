//! The mean of splashes that are too far away to be drawn one by one.

use super::hits::Fall;
use super::{Brush, Kind, drawn, sequence};
use crate::random::mix;
use crate::wet::drop::eye::Spot;
use crate::wet::drop::light::DropLight;
use crate::wet::drop::milky;
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::reflect::view::View;
use crate::wet::surface::nodes::Nodes;
use glam::{DVec2, DVec3, Vec3};

impl Brush<'_, '_> {
    /// Optical thickness of splashes that are not drawn one by one, seen straight across, by pixels a metre: a table of octaves' eighths.
    fn thickness(&self, kinds: &[Kind], sine: f32) -> Vec<f32> {
        let spread = self.controls.size_spread;
        let mean = self.sequence.mean(sine) * (1.0 + spread * spread / 3.0);
        let of = |step: usize| {
            let per_metre = per_metre_of(step);
            let kind = |kind: &Kind| {
                let width = sequence::WIDTH * kind.radius;
                let alive = self.frame.flux[kind.class].impacts_per_m2_s * kind.life_s;
                alive as f32
                    * width
                    * width
                    * mean
                    * (1.0 - drawn(width * per_metre, self.controls.smallest_px))
            };
            kinds.iter().map(kind).sum::<f32>()
        };
        (0..STEPS).map(of).collect()
    }

    /// Lays the mean of far splashes over the surfaces that they stand on; returns pixels touched.
    pub(super) fn haze(
        &self,
        kinds: &[Kind],
        fall: &Fall<'_>,
        nodes: &mut Nodes<Far>,
        light: &mut DropLight<'_>,
        out: &mut Layer,
    ) -> u64 {
        let (eye, buffer, controls) = (self.eye, self.frame.buffer, self.controls);
        let tables: [Vec<f32>; 3] = sequence::sines().map(|sine| self.thickness(kinds, sine));
        let opacity = self.opacity();
        let own = opacity.of(controls.opacity, 0.066) * controls.haze;
        let mut shelter = Shelter::new(fall, mean_speed(self.frame, kinds));
        let view = View::new(self.frame.camera);
        nodes.fill_in_turn(buffer, &view, |[x, y], offset, normal| {
            (normal.z >= LEVEL).then(|| {
                let place = eye.position + offset.as_dvec3();
                let beams = light.beams(place, eye.towards(offset)) * controls.back_light;
                let spot = Spot { x: x as f32 + 0.5, y: y as f32 + 0.5, depth: offset.dot(eye.forward) };
                Far { open: shelter.open(place), shown: light.ball(&spot).mean() + beams }
            })
        });
        let mut touched = 0;
        for pixel in 0..eye.size[0] * eye.size[1] {
            let [x, y] = [pixel % eye.size[0], pixel / eye.size[0]];
            let Some((depth, normal)) = self.floor(pixel) else { continue };
            let offset = eye.at(x as f32 + 0.5, y as f32 + 0.5, depth);
            let direction = eye.towards(offset);
            let (view, share) = sequence::between_views((-direction.z).max(0.0));
            let place = table_place(eye.pixels_per_metre(depth));
            let [low, high] = [view, view + 1].map(|view| lookup(&tables[view], place));
            let thickness = low + share * (high - low);
            let steep = -normal.dot(direction);
            if thickness < 1e-5 || steep <= 0.0 {
                continue;
            }
            let mut far = Far::default();
            match nodes.around([x, y], offset, normal) {
                Some(around) => around.told().for_each(|(node, weight)| {
                    far.open += weight * node.value.open;
                    far.shown += weight * node.value.shown;
                }),
                None => {
                    let place = eye.position + offset.as_dvec3();
                    let beams = light.beams(place, direction) * controls.back_light;
                    let spot = Spot { x: x as f32 + 0.5, y: y as f32 + 0.5, depth };
                    far = Far { open: shelter.open(place), shown: light.ball(&spot).mean() + beams };
                }
            }
            let wettable = buffer.wettable.as_ref().map_or(1.0, |mask| mask[pixel].clamp(0.0, 1.0));
            let through = thickness * own * far.open * wettable * normal.z / steep.max(0.02);
            if through > 0.0 {
                let alpha = 1.0 - libm::expf(-through);
                let shown = far.shown * opacity.lightning_bias;
                out.over(pixel, (milky(shown, controls.milk) * alpha).into(), alpha);
                touched += 1;
            }
        }
        touched
    }

    /// Depth and normal of a pixel that shows what splashes stand on.
    fn floor(&self, pixel: usize) -> Option<(f32, Vec3)> {
        let (depth, normal) = (self.frame.buffer.depth_m[pixel], Vec3::from(self.frame.buffer.normal[pixel]));
        (depth > 0.0 && depth.is_finite() && normal.z >= LEVEL).then_some((depth, normal))
    }
}

/// Least cosine to the vertical of what splashes stand on.
const LEVEL: f32 = 0.5;

/// What far splashes stand in: the share of open sky for the rain, and the light that water shows there.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Far {
    open: f32,
    shown: Vec3,
}

/// Share of open sky for the rain, between the middles of the height map's cells, so that no cell is seen; cells asked before are remembered.
struct Shelter<'a> {
    fall: &'a Fall<'a>,
    speed: f64,
    known: Vec<([i64; 3], bool)>,
}

/// Cells that are remembered, and the step of height between two that are told apart, m.
const REMEMBERED: usize = 1 << 13;
const HEIGHT_STEP_M: f64 = 0.05;

impl<'a> Shelter<'a> {
    fn new(fall: &'a Fall<'a>, speed: f64) -> Self {
        let room = if fall.map().is_some() { REMEMBERED } else { 0 };
        Self { fall, speed, known: vec![([i64::MIN; 3], false); room] }
    }

    fn open(&mut self, place: DVec3) -> f32 {
        let Some(map) = self.fall.map() else { return 1.0 };
        let at = (place.truncate() - map.origin_m) / map.cell_m - 0.5;
        let low = at.floor();
        let part = at - low;
        let mut sum = 0.0;
        for corner in 0..4i64 {
            let step = DVec2::new((corner & 1) as f64, (corner >> 1) as f64);
            let weights = DVec2::ONE - part + step * (2.0 * part - 1.0);
            let cell = low + step;
            let key = [cell.x as i64, cell.y as i64, libm::floor(place.z / HEIGHT_STEP_M) as i64];
            let middle = map.origin_m + (cell + 0.5) * map.cell_m;
            let height = (key[2] as f64 + 0.5) * HEIGHT_STEP_M;
            let mixed =
                mix(key[0] as u64 ^ (key[1] as u64).rotate_left(21) ^ (key[2] as u64).rotate_left(42));
            let entry = &mut self.known[mixed as usize & (REMEMBERED - 1)];
            if entry.0 != key {
                *entry = (key, !self.fall.sheltered(middle.extend(height), self.speed));
            }
            sum += if entry.1 { weights.x * weights.y } else { 0.0 };
        }
        sum as f32
    }
}

/// Entries of the table over pixels a metre: eight an octave from 1/16 px on.
const STEPS: usize = 8 * 18;

fn per_metre_of(step: usize) -> f32 {
    libm::exp2f(step as f32 / 8.0 - 4.0)
}

/// Where pixels a metre lie in the table.
fn table_place(per_metre: f32) -> f32 {
    ((libm::log2f(per_metre.max(1e-9)) + 4.0) * 8.0).clamp(0.0, (STEPS - 2) as f32)
}

fn lookup(table: &[f32], at: f32) -> f32 {
    let low = at as usize;
    table[low] + (at - low as f32) * (table[low + 1] - table[low])
}

/// Speed of the drops that splash, the mean over their number, m/s.
fn mean_speed(frame: &WetFrame<'_>, kinds: &[Kind]) -> f64 {
    let sum = kinds.iter().map(|kind| &frame.flux[kind.class]).fold((0.0, 0.0), |sum, drop| {
        (sum.0 + drop.impacts_per_m2_s, sum.1 + drop.impacts_per_m2_s * drop.speed_m_per_s)
    });
    sum.1 / sum.0.max(1e-30)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wet::drop::stage::Stage;
    use crate::wet::splash::{SplashControls, Splashes};

    /// Even ground alone, from 10° to 70° under the horizon, under light that grades from side to side and from above: all of it haze.
    fn haze() -> (Stage, Layer) {
        let mut stage = Stage::new(DVec3::new(30.0, 0.0, 6.0), DVec3::new(30.0, 6.0, 1.0), [320, 240]);
        for (k, colour) in stage.buffer.colour.iter_mut().enumerate() {
            *colour = [0.2 + (k % 320) as f32 / 320.0, 0.2 + (k / 320) as f32 / 240.0, 0.3];
        }
        let controls = SplashControls { smallest_px: 64.0, milk: 0.0, ..SplashControls::default() };
        let mut layer = Layer::default();
        let report = Splashes::new().draw(&stage.frame(1.0), &controls, &mut layer).unwrap();
        assert!(report.splashes == 0 && report.haze_pixels > 320 * 150, "{report:?}");
        (stage, layer)
    }

    /// Largest step between neighbours, and the mean of all steps.
    fn steps(values: impl Iterator<Item = f32>) -> (f32, f32) {
        let values: Vec<f32> = values.collect();
        let steps: Vec<f32> = values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
        (steps.iter().copied().fold(0.0, f32::max), steps.iter().sum::<f32>() / steps.len() as f32)
    }

    #[test]
    fn haze_over_even_ground_has_no_step_in_its_light() {
        /// A picture's light has slopes some times its mean slope; a tile of a sixteenth of the picture would step by 20 of them.
        const STEEPEST: f32 = 6.0;
        let (_, layer) = haze();
        let colour = |x: usize, y: usize, band: usize| {
            let pixel = y * 320 + x;
            layer.light[pixel][band] / layer.alpha[pixel]
        };
        for y in [120, 150, 235] {
            let (most, mean) = steps((0..320).map(|x| colour(x, y, 0)));
            assert!(most < STEEPEST * mean, "row {y}: {most} {mean}");
        }
        for x in [3, 160, 301] {
            let (most, mean) = steps((90..240).map(|y| colour(x, y, 1)));
            assert!(most < STEEPEST * mean, "column {x}: {most} {mean}");
        }
    }

    #[test]
    fn haze_over_even_ground_has_no_step_in_its_thickness() {
        /// From row to row the look's elevation changes by less than half a degree.
        const ROW: f32 = 0.03;
        let (stage, layer) = haze();
        let eye = crate::wet::drop::eye::Eye::new(&stage.camera);
        let thickness =
            |y: usize| -libm::log1pf(-layer.alpha[y * 320 + 160]) * -eye.direction(160.5, y as f32 + 0.5).z;
        for y in 91..240 {
            let share = thickness(y) / thickness(y - 1);
            assert!((share - 1.0).abs() < ROW, "{y} {share}");
        }
    }

    #[test]
    fn shelter_fades_over_a_cell_of_the_map() {
        let mut stage = Stage::new(DVec3::new(3.0, -1.0, 3.0), DVec3::new(3.0, 1.5, 0.0), [16, 12]);
        stage.roof(3.0, 4.0);
        for wind in [DVec3::ZERO, DVec3::new(2.0, 1.0, 0.0)] {
            stage.wind = wind;
            let frame = stage.frame(0.0);
            let fall = Fall::new(&frame);
            let mut shelter = Shelter::new(&fall, 6.5);
            let open: Vec<f32> =
                (0..400).map(|k| shelter.open(DVec3::new(0.01 * f64::from(k) + 2.0, 1.5, 0.0))).collect();
            assert_eq!((open[0], open[399]), (0.0, 1.0));
            // Ten places a cell.
            assert!(open.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.11));
        }
    }
}
