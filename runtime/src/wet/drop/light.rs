//! Light on drops, splashes and mist: the picture around, the world beyond it, lamps overhead, lightning.

use super::ball::{Ball, BallMap, across};
use super::eye::{Eye, Spot};
use crate::medium::Phase;
use crate::phase::henyey_greenstein;
use crate::shade::sky::harmonics::Y0;
use crate::wet::frame::WetFrame;
use crate::wet::maps::{GroundMap, WetMaps};
use crate::wet::reflect::FresnelTable;
use crate::world::{InScattering, WorldLight};
use glam::{DVec3, Vec2, Vec3};

/// Pixels along the side of a block of the small picture that drops see.
const BLOCK: usize = 8;
/// Asymmetry of a drop's scattering at the efficiency of its disc, diffraction left out.
const DROP_ASYMMETRY: f64 = 0.77;
/// Asymmetry that leaves the world's radiance nearly sharp.
pub(super) const MIRROR_ASYMMETRY: f64 = 0.98;
/// Share of the picture at its edges over which what drops see of it gives way to the world's light.
const MARGIN: f32 = 0.06;

/// What stays from frame to frame while the world's light does.
#[derive(Clone, Debug, Default)]
pub(crate) struct LightMemory {
    known: Option<Box<(WorldLight, InScattering)>>,
    small: Vec<Vec3>,
    balls: BallMap,
    fresnel: FresnelTable,
}

/// The world as a drop sees it: this frame's picture made small, and the world's light outside it.
#[derive(Clone, Copy)]
pub(crate) struct Surroundings<'a> {
    eye: &'a Eye,
    small: &'a [Vec3],
    columns: usize,
    world: &'a InScattering,
}

/// Light of a frame.
pub(crate) struct DropLight<'a> {
    surroundings: Surroundings<'a>,
    balls: &'a mut BallMap,
    maps: &'a WetMaps,
    world: &'a WorldLight,
    /// Irradiance of each key direction's lightning now.
    flashes: [f32; 2],
    lamp_height_m: f32,
    /// Water's reflection.
    pub fresnel: &'a FresnelTable,
}

/// What an artist says of light, of every effect alike.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightControls {
    /// Irradiance of lightning at its brightest, in the buffers' unit.
    pub flash: f32,
    /// Height of lamps over the ground, m.
    pub lamp_height_m: f32,
    /// Whether rays through water are bent as the paper prints it.
    pub paper: bool,
}

impl LightMemory {
    /// Prepares a frame's light.
    pub fn prepare<'a>(
        &'a mut self,
        frame: &WetFrame<'a>,
        eye: &'a Eye,
        controls: &LightControls,
    ) -> DropLight<'a> {
        let Self { known, small, balls, fresnel } = self;
        let kept = known.take().filter(|kept| kept.0 == *frame.light);
        let (_, world) = &**known.insert(kept.unwrap_or_else(|| {
            let mirror = frame.light.in_scattering(&Phase::HenyeyGreenstein(MIRROR_ASYMMETRY));
            Box::new((frame.light.clone(), mirror))
        }));
        let columns = shrink(frame.colour, eye.size, small);
        balls.clear(controls.paper);
        DropLight {
            surroundings: Surroundings { eye, small, columns, world },
            balls,
            maps: frame.maps,
            world: frame.light,
            flashes: frame.lightning.map(|l| l.max(0.0) * controls.flash),
            lamp_height_m: controls.lamp_height_m,
            fresnel,
        }
    }
}

/// Means of blocks of a picture; numbers that are not finite count as dark. Returns blocks across.
fn shrink(colour: &[[f32; 3]], size: [usize; 2], small: &mut Vec<Vec3>) -> usize {
    let [columns, rows] = size.map(|n| n.div_ceil(BLOCK));
    small.clear();
    small.resize(columns * rows, Vec3::ZERO);
    for (y, line) in colour.chunks_exact(size[0]).enumerate() {
        let row = &mut small[y / BLOCK * columns..][..columns];
        for (sum, block) in row.iter_mut().zip(line.chunks(BLOCK)) {
            for value in block {
                let value = Vec3::from(*value);
                *sum += if value.is_finite() { value } else { Vec3::ZERO };
            }
        }
    }
    for (k, sum) in small.iter_mut().enumerate() {
        let [x, y] = [k % columns, k / columns].map(|n| n * BLOCK);
        *sum /= ((size[0] - x).min(BLOCK) * (size[1] - y).min(BLOCK)) as f32;
    }
    columns
}

impl Surroundings<'_> {
    /// Radiance from a direction: the picture's where it shows that direction, the world's outside.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let world = || Vec3::from(self.world.diffuse(direction));
        let Some(at) = self.eye.far(direction) else { return world() };
        let [width, height] = self.eye.size.map(|n| n as f32);
        let edge = (at.x / width).min(1.0 - at.x / width).min(at.y / height).min(1.0 - at.y / height);
        if edge <= 0.0 {
            return world();
        }
        let seen = self.picture(at.x, at.y);
        if edge < MARGIN { world().lerp(seen, edge / MARGIN) } else { seen }
    }

    /// The small picture between its blocks' middles.
    pub fn picture(&self, x: f32, y: f32) -> Vec3 {
        let rows = self.small.len() / self.columns;
        let place = |at: f32, most: usize| (at / BLOCK as f32 - 0.5).clamp(0.0, (most - 1) as f32);
        let (x, y) = (place(x, self.columns), place(y, rows));
        let (left, top) = (x as usize, y as usize);
        let (right, under) = ((left + 1).min(self.columns - 1), (top + 1).min(rows - 1));
        let at = |x: usize, y: usize| self.small[y * self.columns + x];
        let high = at(left, top).lerp(at(right, top), x - left as f32);
        let low = at(left, under).lerp(at(right, under), x - left as f32);
        high.lerp(low, y - top as f32)
    }
}

impl DropLight<'_> {
    /// The world as drops see it.
    pub fn surroundings(&self) -> &Surroundings<'_> {
        &self.surroundings
    }

    /// What balls of water at a spot show, lamps and lightning left out.
    pub fn ball(&mut self, spot: &Spot) -> Ball<'_> {
        self.balls.at(self.surroundings.eye, &self.surroundings, spot.x, spot.y)
    }

    /// Radiance that water's discs have of beams: the sun, lamps overhead and lightning, scattered towards the eye from a place seen in a unit
    /// direction. Brightest where the light is behind.
    pub fn beams(&self, place: DVec3, direction: Vec3) -> Vec3 {
        self.beams_from(place, direction).0
    }

    /// The same, and where most of it comes from, in the picture: to the right and up, as long as the sine of its angle to the view; negative
    /// lengths stand for light from before.
    pub fn beams_from(&self, place: DVec3, direction: Vec3) -> (Vec3, Vec2) {
        let mut sum = Vec3::ZERO;
        let (mut most, mut from) = (0.0, Vec3::ZERO);
        if let Some(sun) = &self.world.sun {
            let light = Vec3::from(sun.irradiance) * scattered(direction, sun.towards);
            (sum, most, from) = (sum + light, light.element_sum(), sun.towards);
        }
        if let Some((towards, irradiance)) = self.overhead(place) {
            let light = irradiance * scattered(direction, towards);
            sum += light;
            if light.element_sum() > most {
                from = towards;
            }
        }
        for (k, &flash) in self.flashes.iter().enumerate().filter(|(_, flash)| **flash > 0.0) {
            sum += Vec3::splat(flash * self.flash(k, place, direction));
        }
        let [right, up] = across(self.surroundings.eye, direction);
        let side = if from.dot(direction) < 0.0 { -0.7 } else { 1.0 };
        (sum, Vec2::new(from.dot(right), from.dot(up)) * side)
    }

    /// Radiance of water for lightning of irradiance 1 from a key direction: its beam, and what the scene sends on.
    /// Without directions it comes from everywhere.
    fn flash(&self, key: usize, place: DVec3, direction: Vec3) -> f32 {
        let even = 1.0 / (4.0 * std::f32::consts::PI);
        let Some(volume) = &self.maps.lightning else { return even };
        let Some(towards) = volume.directions.get(key) else { return even };
        let sent_on = volume.harmonics_at(key, place).map_or(0.0, |harmonics| harmonics[0] * Y0);
        scattered(direction, towards.as_vec3()) + sent_on.max(0.0)
    }

    /// Where light from lamps overhead comes from, and its irradiance across its way: the map's own slope says where the lamp stands.
    fn overhead(&self, place: DVec3) -> Option<(Vec3, Vec3)> {
        let maps = self.maps.overhead.as_ref()?;
        let at = place.truncate();
        let value = |map: &GroundMap| map.between(at).filter(|value| *value > 0.0).unwrap_or(0.0);
        let here = Vec3::new(value(&maps[0]), value(&maps[1]), value(&maps[2]));
        if here.element_sum() <= 0.0 {
            return None;
        }
        // The brightest band alone tells where the lamp is.
        let map = &maps[(0..3).fold(0, |best, band| if here[band] > here[best] { band } else { best })];
        let beside = |x: f64, y: f64| {
            let step = glam::DVec2::new(x, y) * map.cell_m;
            map.between(at + step).filter(|value| *value > 0.0).unwrap_or(0.0)
        };
        let across = 2.0 * map.cell_m as f32 * here.max_element();
        let slopes =
            Vec3::new(beside(1.0, 0.0) - beside(-1.0, 0.0), beside(0.0, 1.0) - beside(0.0, -1.0), 0.0)
                / across;
        let uphill = slopes.normalize_or_zero();
        // Losses a little nearer to the lamp and a little farther off: a cell at least, as between its middles a map has no bend.
        let step = (UPHILL_M / map.cell_m).max(1.0);
        let [x, y] = [f64::from(uphill.x) * step, f64::from(uphill.y) * step];
        let [nearer, farther] = [beside(x, y), beside(-x, -y)];
        let most = here.max_element();
        let [nearer, farther] = [(nearer - most) / (nearer + most), (most - farther) / (most + farther)];
        let beyond = 4.0 * (nearer - farther) / (nearer.abs() + farther.abs()).max(1e-6);
        let lean = uphill * lamp_lean(slopes.length(), self.lamp_height_m, beyond.clamp(-1.0, 1.0));
        let towards = (lean + Vec3::Z).normalize();
        Some((towards, here / towards.z))
    }
}

/// Tangent of the angle between the vertical and the lamp, from the share of its light that a flat ground loses a metre. A lamp of height h gives h/(h² + r²)^{3/2}, which
/// loses 3r/(h² + r²): more with the distance up to r = h, less beyond. `beyond` says which of both distances is meant, −1 the nearer, 1 the farther. No lamp loses
/// more than 1.5/h: where maps do, they have a step (a shadow, a roof's edge), which says nothing.
fn lamp_lean(loss: f32, height: f32, beyond: f32) -> f32 {
    let share = loss * height / 1.5;
    if share > 1.0 {
        return 1.0 / (share * share * share);
    }
    // r/h, in a form that keeps its digits where the loss is small.
    let near = share / (1.0 + (1.0 - share * share).sqrt());
    let far = (1.0 / near.max(1e-3)).min(FARTHEST_LAMP);
    // Where there is no loss there is no far lamp to be told from one overhead; it comes in by degrees, as a step would be seen.
    let told = ((share - 0.03) / 0.07).clamp(0.0, 1.0);
    let far = near + told * (far - near);
    0.5 * ((1.0 - beyond) * near + (1.0 + beyond) * far)
}

/// Farthest lamp, over its height, and how far uphill and downhill the light map is asked, m.
const FARTHEST_LAMP: f32 = 2.5;
pub(super) const UPHILL_M: f64 = 0.4;

/// Share a steradian of light from `towards` that water sends to an eye that looks along `direction`.
fn scattered(direction: Vec3, towards: Vec3) -> f32 {
    henyey_greenstein(DROP_ASYMMETRY, f64::from(direction.dot(towards))) as f32
}

/// How a beam's light lies over a ball's disc, its mean being 1: most where the ball images the lamp, which is away from it. `flat` is the normal, `from` where the
/// light comes from, both in the picture.
pub(crate) fn glint(flat: Vec2, from: Vec2) -> f32 {
    /// Share of light in the lamp's image, and the square of that image's radius.
    const IMAGE: f32 = 0.6;
    const WIDE: f32 = 0.08;
    let away = (flat + 0.75 * from).length_squared() / WIDE;
    1.0 - IMAGE + IMAGE / (WIDE * (1.0 + away) * (1.0 + away))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_light_of_a_lamp_says_where_it_stands() {
        for (height, away) in [(5.0f32, 0.0f32), (5.0, 2.0), (3.0, 2.9)] {
            let loss = 3.0 * away / (height * height + away * away);
            assert!((lamp_lean(loss, height, -1.0) - away / height).abs() < 2e-3, "{height} {away}");
        }
        let loss = 3.0 * 9.0 / (16.0 + 81.0);
        assert!((lamp_lean(loss, 4.0, 1.0) - 2.25).abs() < 2e-3);
        assert!(lamp_lean(100.0, 5.0, 1.0) < 1e-3, "a step is no lamp");
    }

    #[test]
    fn the_lean_of_a_lamp_has_no_step() {
        /// The steepest of its slopes, at the smallest share that tells a far lamp, times the step.
        const SLOPE: f32 = 80.0;
        for beyond in [-1.0, 0.0, 1.0] {
            for k in 0..2000 {
                let [one, next] = [k, k + 1].map(|k| lamp_lean(k as f32 * 1e-3 / 5.0, 5.0, beyond));
                assert!((one - next).abs() < SLOPE * 1e-3, "{beyond} {k} {one} {next}");
            }
        }
    }

    #[test]
    fn a_glint_gathers_light_and_makes_none() {
        /// A square grid over a disc; the image's foot reaches over its rim.
        const RIM: f32 = 0.1;
        for from in [Vec2::ZERO, Vec2::new(0.4, 0.0), Vec2::new(0.0, -0.7)] {
            let (mut sum, mut count) = (0.0, 0.0);
            for k in 0..10_000 {
                let flat = Vec2::new((k % 100) as f32 + 0.5, (k / 100) as f32 + 0.5) / 50.0 - 1.0;
                if flat.length_squared() < 1.0 {
                    (sum, count) = (sum + glint(flat, from), count + 1.0);
                }
            }
            assert!((sum / count - 1.0).abs() < RIM, "{from} {}", sum / count);
        }
    }
}
