//! Light of lightning on the frame's surfaces, \[toyshop\] §6.1: key directions' baked light, mixed by two intensities L1 and L2, added to the diffuse light
//! before anything is shown.
//!
//! Where nothing was baked, a flash is an even light from above. Linear in both intensities.

use crate::error::RuntimeError;
use crate::parallel::prelude::*;
use crate::wet::controls::controls;
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::maps::{GroundMap, LightningVolume};
use crate::wet::reflect::view::View;
use crate::wet::surface::nodes::{Around, Nodes};
use glam::{DVec2, DVec3, Vec3};
use squall_formats::sphere::{degree_of, harmonics};
use std::f32::consts::{FRAC_1_PI, PI};

controls! {
    /// How lightning lights surfaces.
    pub struct LightningControls {
        /// Irradiance of lightning at its brightest, across its beam, in the buffers' unit: π of it on white ground shows as 1.
        flash: 10.0, 0.0..=1e6, "W/m2", "L1, L2";
        /// Red of its colour.
        red: 0.78, 0.0..=4.0, "", "";
        /// Green of its colour.
        green: 0.84, 0.0..=4.0, "", "";
        /// Blue of its colour.
        blue: 1.0, 0.0..=4.0, "", "";
        /// Albedo of surfaces whose file has none.
        albedo: 0.2, 0.0..=1.0, "", "";
        /// How far shadows reach over the height map; 0 is no shadows.
        shadows: 100.0, 0.0..=1e4, "m", "";
    }
}

/// Blocks of the height map, each four times as long as those before, whose highest points shadows' rays pass over in one step.
const LEVELS: usize = 4;
const FOUR: usize = 4;
/// Share of a cell by which a ray is put beyond the border of what it has left.
const BEYOND: f64 = 1e-4;
/// A light this close to straight above casts its shadows within a cell: the tangent of its angle.
const STRAIGHT: f64 = 1e-3;
/// What lies this far below the uppermost point of its cell, m, is under a roof to a light from straight above.
const UNDER_M: f64 = 0.3;

/// What was lit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightningReport {
    /// Pixels.
    pub pixels: usize,
}

/// Lightning of frames; keeps memory between them.
#[derive(Default)]
pub struct Lightning {
    blocks: Vec<f32>,
    nodes: Nodes<Lit>,
}

/// What a place has of both flashes.
#[derive(Clone, Copy, Debug, Default)]
struct Lit {
    /// What the scene sends on: harmonics, each degree with what a cosine keeps of it, and the irradiance on the node's own normal.
    sent_on: [[f32; 9]; 2],
    irradiance: [f32; 2],
    /// Whether the beams themselves come there.
    beam: [bool; 2],
}

/// Cosine between normals from which a node's irradiance is a pixel's.
const EVEN: f32 = 0.9998;

impl Lightning {
    /// Nothing kept yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Draws the light of both flashes; nothing where both are 0.
    ///
    /// Errors: buffers of another size than the camera's; intensities that are no numbers of 0 or more; a volume with other directions than the two.
    pub fn draw(
        &mut self,
        frame: &WetFrame<'_>,
        controls: &LightningControls,
        out: &mut Layer,
    ) -> Result<LightningReport, RuntimeError> {
        draw((&mut self.blocks, &mut self.nodes), frame, controls, out)
    }
}

fn draw(
    (blocks, nodes): (&mut Vec<f32>, &mut Nodes<Lit>),
    frame: &WetFrame<'_>,
    controls: &LightningControls,
    out: &mut Layer,
) -> Result<LightningReport, RuntimeError> {
    let buffer = frame.buffer;
    frame.check()?;
    out.clear(buffer.size);
    if frame.lightning.iter().any(|value| !(*value >= 0.0 && value.is_finite())) {
        return Err(RuntimeError::argument(
            "lightning",
            "two numbers of 0 or more",
            format!("{:?}", frame.lightning),
        ));
    }
    if frame.lightning == [0.0; 2] || controls.flash == 0.0 {
        return Ok(LightningReport::default());
    }
    let light = Light::of(frame, blocks)?;
    let view = View::new(frame.camera);
    let colour = [controls.red, controls.green, controls.blue].map(|band| band * controls.flash * FRAC_1_PI);
    let width = buffer.size[0];
    let look = |_: [usize; 2], offset: Vec3, normal: Vec3| {
        light.look(view.eye + offset.as_dvec3(), normal, controls.shadows)
    };
    if light.volume.is_some() {
        nodes.fill(buffer, &view, look);
    }
    let nodes = &*nodes;
    let row = |(y, row): (usize, &mut [[f32; 3]])| {
        let mut lit = 0;
        for (x, pixel) in row.iter_mut().enumerate() {
            let at = y * width + x;
            let depth = buffer.depth_m[at];
            let Some(normal) = buffer.unit_normal(at).filter(|_| depth > 0.0 && depth.is_finite()) else {
                continue;
            };
            let irradiance = match light.volume {
                None => light.even(normal),
                Some(_) => {
                    let offset = view.to_world(view.place(x, y, depth));
                    let told = nodes.around([x, y], offset, normal);
                    let told = told.and_then(|around| light.between(&around, normal));
                    told.unwrap_or_else(|| light.of_look(&look([x, y], offset, normal), normal))
                }
            };
            let albedo = buffer.albedo.as_ref().map_or([controls.albedo; 3], |albedo| albedo[at]);
            *pixel = std::array::from_fn(|band| albedo[band] * colour[band] * irradiance);
            lit += usize::from(irradiance > 0.0);
        }
        lit
    };
    let pixels = out.light.par_chunks_mut(width).enumerate().map(row).sum();
    Ok(LightningReport { pixels })
}

/// Both flashes.
struct Light<'a> {
    volume: Option<&'a LightningVolume>,
    /// Those that shine: number, direction towards it, intensity.
    beams: [Option<(usize, DVec3, f32)>; 2],
    heights: Option<Heights<'a>>,
    /// Of both, where nothing was baked.
    sum: f32,
}

impl<'a> Light<'a> {
    fn of(frame: &WetFrame<'a>, blocks: &'a mut Vec<f32>) -> Result<Self, RuntimeError> {
        let sum = frame.lightning.iter().sum();
        let Some(volume) = &frame.maps.lightning else {
            return Ok(Self { volume: None, beams: [None; 2], heights: None, sum });
        };
        let count = volume.size.iter().product::<usize>();
        if volume.directions.len() != 2 || volume.harmonics.len() != 2 * count || count == 0 {
            let found = format!("{} directions, {} nodes", volume.directions.len(), volume.harmonics.len());
            let wanted = format!("two key directions of {count} nodes each");
            return Err(RuntimeError::argument("lightning volume", wanted, found));
        }
        let beams = std::array::from_fn(|key| {
            let intensity = frame.lightning[key];
            (intensity > 0.0).then(|| (key, volume.directions[key], intensity))
        });
        let heights = frame.maps.height_m.as_ref().map(|map| Heights::of(map, blocks));
        Ok(Self { volume: Some(volume), beams, heights, sum })
    }

    /// Irradiance where nothing was baked, over that of a beam of intensity 1: half of an even hemisphere is behind an upright wall.
    fn even(&self, normal: Vec3) -> f32 {
        self.sum * 0.5 * (1.0 + normal.z)
    }

    /// What a place has of the flashes that shine.
    fn look(&self, place: DVec3, normal: Vec3, shadows: f32) -> Lit {
        let mut lit = Lit::default();
        let Some(volume) = self.volume else { return lit };
        let around = place + normal.as_dvec3() * (0.5 * volume.cell_m);
        for (key, towards, _) in self.beams.iter().flatten() {
            if let Some(mut light) = volume.harmonics_at(*key, around) {
                // What a cosine lobe keeps of each degree, \[ramamoorthi\].
                let keeps = |index: usize| [PI, 2.0 * PI / 3.0, 0.25 * PI][degree_of(index)];
                light.iter_mut().enumerate().for_each(|(index, light)| *light *= keeps(index));
                lit.irradiance[*key] = on(&light, normal);
                lit.sent_on[*key] = light;
            }
            // A surface that a beam only grazes may be one whose neighbour it meets.
            let meets = normal.dot(towards.as_vec3()) > -0.2;
            let reach = f64::from(shadows);
            let shades = |heights: &Heights<'_>| heights.shade((place, normal), *towards, reach);
            lit.beam[*key] = meets && !self.heights.as_ref().is_some_and(shades);
        }
        lit
    }

    /// Irradiance on a surface with what its place has, over that of a beam of intensity 1.
    fn of_look(&self, lit: &Lit, normal: Vec3) -> f32 {
        let beam = |(key, towards, intensity): &(usize, DVec3, f32)| {
            let straight = if lit.beam[*key] { normal.dot(towards.as_vec3()).max(0.0) } else { 0.0 };
            intensity * (lit.irradiance[*key] + straight)
        };
        self.beams.iter().flatten().map(beam).sum()
    }

    /// The same between nodes that agree on which beams come there.
    fn between(&self, around: &Around<'_, Lit>, normal: Vec3) -> Option<f32> {
        let beam = around.told().next()?.0.value.beam;
        if around.told().any(|(node, _)| node.value.beam != beam) {
            return None;
        }
        let mut lit = Lit { beam, ..Lit::default() };
        let even = around.told().all(|(node, _)| node.normal.dot(normal) > EVEN);
        for (key, ..) in self.beams.iter().flatten() {
            for (node, weight) in around.told() {
                let value = &node.value;
                lit.irradiance[*key] +=
                    weight * if even { value.irradiance[*key] } else { on(&value.sent_on[*key], normal) };
            }
        }
        Some(self.of_look(&lit, normal))
    }
}

/// Irradiance on a normal by harmonics that have a cosine's shares in them; at least 0.
fn on(light: &[f32; 9], normal: Vec3) -> f32 {
    let basis = harmonics(normal.to_array().map(f64::from));
    light.iter().zip(basis).map(|(light, basis)| light * basis as f32).sum::<f32>().max(0.0)
}

/// A height map that throws shadows, and the highest points of its blocks.
struct Heights<'a> {
    map: &'a GroundMap,
    /// Blocks along x of each level, and where the level begins.
    levels: [(usize, usize); LEVELS],
    blocks: &'a [f32],
    top: f64,
}

impl<'a> Heights<'a> {
    fn of(map: &'a GroundMap, blocks: &'a mut Vec<f32>) -> Self {
        blocks.clear();
        let mut levels = [(0, 0); LEVELS];
        let mut size = map.size;
        for (number, level) in levels.iter_mut().enumerate() {
            let from = blocks.len();
            let [width, height] = size;
            let coarse = size.map(|cells| cells.div_ceil(FOUR));
            *level = (coarse[0], from);
            blocks.resize(from + coarse[0] * coarse[1], f32::NEG_INFINITY);
            let (finer, coarser) = blocks.split_at_mut(from);
            let fine = if number == 0 { map.values.as_slice() } else { &finer[from - width * height..] };
            for (y, row) in fine.chunks(width.max(1)).take(height).enumerate() {
                for (cells, highest) in row.chunks(FOUR).zip(&mut coarser[y / FOUR * coarse[0]..]) {
                    *highest = cells.iter().copied().fold(*highest, f32::max);
                }
            }
            size = coarse;
        }
        let first = levels[1].1;
        let top = blocks[..first].iter().copied().fold(f32::NEG_INFINITY, f32::max);
        Self { map, levels, blocks, top: f64::from(top) }
    }

    /// Whether the height map stands between a surface and a light, within `reach` m; 0 is no shadows. The ray begins where no cell that holds the
    /// surface itself lies over it, and ends above all that stands there.
    fn shade(&self, (place, normal): (DVec3, Vec3), towards: DVec3, reach: f64) -> bool {
        let map = self.map;
        if reach.partial_cmp(&0.0).is_none_or(|order| order.is_le()) {
            return false;
        }
        let from = place
            + normal.as_dvec3() * (map.cell_m * f64::from(normal.x.abs() + normal.y.abs()) * (1.0 + BEYOND));
        let across = towards.truncate().length();
        if across <= STRAIGHT * towards.z {
            return map.at(from.truncate()).is_some_and(|height| f64::from(height) > from.z + UNDER_M);
        }
        let size = DVec2::new(map.size[0] as f64, map.size[1] as f64) * map.cell_m;
        let Some([begin, end]) = within(from, towards, [map.origin_m, map.origin_m + size]) else {
            return false;
        };
        let (nudge, end) = (map.cell_m * BEYOND / across, end.min(reach));
        // Past the place's own cell: ground that slopes or is rough does not shade itself.
        let mut along = begin.max(map.cell_m / across);
        // Where the ray leaves a square of `side` cells that holds cell (x, y).
        let (inverse, cell_m) = (towards.truncate().recip(), map.cell_m);
        let leaves = |[x, y]: [usize; 2], side: usize| {
            let edge = |axis: usize, at: usize| {
                let far = at - at % side + if towards[axis] > 0.0 { side } else { 0 };
                let out = (map.origin_m[axis] + far as f64 * cell_m - from[axis]) * inverse[axis];
                if towards[axis] == 0.0 { f64::INFINITY } else { out }
            };
            edge(0, x).min(edge(1, y))
        };
        let mut level = LEVELS;
        while along < end {
            let z = from.z + towards.z * along;
            if z > self.top && towards.z >= 0.0 {
                return false;
            }
            let Some([x, y]) = map.cell(from.truncate() + towards.truncate() * along) else {
                along += nudge;
                continue;
            };
            if level == 0 {
                let out = leaves([x, y], 1).max(along);
                let middle = from.z + towards.z * 0.5 * (along + out);
                if map.values.get(y * map.size[0] + x).is_some_and(|height| f64::from(*height) > middle) {
                    return true;
                }
                (along, level) = (out + nudge, 1);
                continue;
            }
            let side = FOUR.pow(level as u32);
            let past = leaves([x, y], side).max(along);
            let lowest = z.min(from.z + towards.z * past);
            let (across, begins) = self.levels[level - 1];
            if f64::from(self.blocks[begins + y / side * across + x / side]) <= lowest {
                (along, level) = (past + nudge, (level + 1).min(LEVELS));
            } else {
                level -= 1;
            }
        }
        false
    }
}

/// Where along a line it comes into a rectangle of the ground and where it leaves it, from 0 on; `None` where it doesn't.
fn within(from: DVec3, towards: DVec3, [low, high]: [DVec2; 2]) -> Option<[f64; 2]> {
    let mut span = [0.0f64, f64::INFINITY];
    for axis in 0..2 {
        if towards[axis] == 0.0 {
            if from[axis] < low[axis] || from[axis] > high[axis] {
                return None;
            }
            continue;
        }
        let ends = [low[axis], high[axis]].map(|end| (end - from[axis]) / towards[axis]);
        span = [span[0].max(ends[0].min(ends[1])), span[1].min(ends[0].max(ends[1]))];
    }
    (span[0] <= span[1]).then_some(span)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::wet::frame::GBuffer;
    use crate::wet::maps::WetMaps;
    use crate::world::WorldLight;
    use squall_formats::units::Degrees;

    /// Single precision.
    const ROUND_OFF: f32 = 1e-5;

    /// One pixel that looks down on level ground of albedo ½ at the origin.
    fn lit(maps: &WetMaps, lightning: [f32; 2]) -> f32 {
        let camera = Camera::look_at(DVec3::new(0.0, -0.01, 5.0), DVec3::ZERO, Degrees(5.0), [1, 1]).unwrap();
        let buffer = GBuffer {
            size: [1, 1],
            colour: vec![[0.0; 3]],
            depth_m: vec![5.0],
            normal: vec![[0.0, 0.0, 1.0]],
            albedo: Some(vec![[0.5; 3]]),
            ..GBuffer::default()
        };
        let frame = WetFrame {
            buffer: &buffer,
            colour: &buffer.colour,
            camera: &camera,
            maps,
            light: &WorldLight::default(),
            rate_mm_per_h: 0.0,
            flux: &[],
            wind: DVec3::ZERO,
            time_s: 0.0,
            seed: 0,
            lightning,
        };
        let controls = LightningControls { flash: 2.0, blue: 1.0, ..LightningControls::default() };
        let mut layer = Layer::default();
        Lightning::new().draw(&frame, &controls, &mut layer).unwrap();
        layer.light[0][2]
    }

    fn volume() -> LightningVolume {
        // Even radiance 0.1 around of the first key direction, nothing of the second.
        let even = 0.1 / crate::shade::sky::harmonics::Y0;
        let node = |value: f32| std::array::from_fn(|i| if i == 0 { value } else { 0.0 });
        LightningVolume {
            origin_m: DVec3::splat(-1.0),
            cell_m: 2.0,
            size: [2, 2, 2],
            directions: vec![DVec3::Z, DVec3::new(0.6, 0.0, 0.8)],
            harmonics: [vec![node(even); 8], vec![node(0.0); 8]].concat(),
        }
    }

    #[test]
    fn a_key_directions_light_is_its_beam_and_what_was_baked_of_it() {
        let maps = WetMaps { lightning: Some(volume()), ..WetMaps::default() };
        // Straight above: 1 and π·0.1 on ground of albedo ½, over π, times the strength.
        let wanted = 0.5 * 2.0 * FRAC_1_PI * (1.0 + PI * 0.1);
        assert!((lit(&maps, [1.0, 0.0]) - wanted).abs() < ROUND_OFF, "{}", lit(&maps, [1.0, 0.0]));
        assert!((lit(&maps, [0.0, 1.0]) - 0.5 * 2.0 * FRAC_1_PI * 0.8).abs() < ROUND_OFF);
    }

    #[test]
    fn light_is_linear_in_both_intensities_and_nothing_without_them() {
        for maps in [WetMaps::default(), WetMaps { lightning: Some(volume()), ..WetMaps::default() }] {
            let (one, two) = (lit(&maps, [1.0, 0.0]), lit(&maps, [0.0, 1.0]));
            assert!((lit(&maps, [0.3, 1.7]) - 0.3 * one - 1.7 * two).abs() < ROUND_OFF);
            assert_eq!(lit(&maps, [0.0; 2]), 0.0);
        }
    }

    #[test]
    fn what_stands_between_a_place_and_the_flash_shades_it() {
        let heights =
            GroundMap { origin_m: DVec2::splat(-10.0), cell_m: 1.0, size: [20, 20], values: vec![0.0; 400] };
        let mut wall = heights.clone();
        (0..20).for_each(|y| wall.values[y * 20 + 12] = 6.0);
        let of = |heights: GroundMap| WetMaps {
            lightning: Some(volume()),
            height_m: Some(heights),
            ..WetMaps::default()
        };
        let open = lit(&of(heights), [0.0, 1.0]);
        let shaded = lit(&of(wall), [0.0, 1.0]);
        assert!(open > 0.2 && shaded == 0.0, "{open} {shaded}");
    }

    #[test]
    fn shadows_reach_as_far_as_is_asked_for_whatever_the_cells() {
        // A tower of 100 m, 60 m away, over cells of 10 cm: its shadow is 75 m long under a light at tangent 4/3.
        let mut map = GroundMap {
            origin_m: DVec2::new(-5.0, -1.0),
            cell_m: 0.1,
            size: [800, 20],
            values: vec![0.0; 16_000],
        };
        let tower = 650..652;
        (0..20).for_each(|y| map.values[y * 800..][tower.clone()].fill(100.0));
        let (low, mut blocks) = (DVec3::new(0.6, 0.0, 0.8), Vec::new());
        let heights = Heights::of(&map, &mut blocks);
        let shade = |x: f64, reach: f64| heights.shade((DVec3::new(x, 0.0, 0.0), Vec3::Z), low, reach);
        // The tower stands 60 m away: 100 m along the ray, and 80 m up.
        assert!(shade(0.0, 120.0) && !shade(0.0, 90.0) && !shade(0.0, 0.0));
        assert!(shade(30.0, 120.0) && !shade(61.0, 120.0));
        // Beside the tower's top light comes past it.
        assert!(!heights.shade((DVec3::new(0.0, 0.0, 21.0), Vec3::Z), low, 1e4));
        assert!(heights.shade((DVec3::new(0.0, 0.0, 19.0), Vec3::Z), low, 1e4));
        // From outside of the map a ray comes in.
        assert!(heights.shade((DVec3::new(-8.0, 0.0, 0.0), Vec3::Z), low, 1e4));
        // The tower's own side that faces the light is lit, though its cells are as high as its top.
        let side = (DVec3::new(60.2, 0.0, 5.0), Vec3::X);
        let before = (DVec3::new(59.0, 0.0, 5.0), Vec3::X);
        assert!(!heights.shade(side, low, 1e4) && heights.shade(before, low, 1e4));
    }
}
