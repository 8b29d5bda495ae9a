//! Light of lightning on the frame's surfaces, \[toyshop\] §6.1: key directions' baked light, mixed by two intensities L1 and L2, added to the diffuse light
//! before anything is shown.
//!
//! Where nothing was baked, a flash is an even light from above. Linear in both intensities.

use crate::error::RuntimeError;
use crate::parallel::prelude::*;
use crate::shade::sky::harmonics::irradiance_from;
use crate::wet::controls::controls;
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::maps::{GroundMap, LightningVolume};
use crate::wet::reflect::view::View;
use glam::{DVec3, Vec3};
use std::f32::consts::FRAC_1_PI;

controls! {
    /// How lightning lights surfaces.
    pub struct LightningControls {
        /// Irradiance of a flash at its brightest across its beam, in the buffers' unit of light: π of it on white ground shows as 1.
        strength: 20.0, 0.0..=1e9, "", "L1, L2";
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

/// Steps of a shadow's ray over the height map at most.
const SHADOW_STEPS: usize = 96;

/// What was lit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightningReport {
    /// Pixels.
    pub pixels: usize,
}

/// Draws the light of both flashes; nothing where both are 0.
///
/// Errors: buffers of another size than the camera's; intensities that are no numbers of 0 or more; a volume with other directions than the two.
pub fn draw(
    frame: &WetFrame<'_>,
    controls: &LightningControls,
    out: &mut Layer,
) -> Result<LightningReport, RuntimeError> {
    let buffer = frame.buffer;
    buffer.check(frame.camera)?;
    out.clear(buffer.size);
    if frame.lightning.iter().any(|value| !(*value >= 0.0 && value.is_finite())) {
        return Err(RuntimeError::argument(
            "lightning",
            "two numbers of 0 or more",
            format!("{:?}", frame.lightning),
        ));
    }
    if frame.lightning == [0.0; 2] || controls.strength == 0.0 {
        return Ok(LightningReport::default());
    }
    let light = Light::of(frame)?;
    let view = View::new(frame.camera);
    let colour =
        [controls.red, controls.green, controls.blue].map(|band| band * controls.strength * FRAC_1_PI);
    let width = buffer.size[0];
    let row = |(y, row): (usize, &mut [[f32; 3]])| {
        let mut lit = 0;
        for (x, pixel) in row.iter_mut().enumerate() {
            let at = y * width + x;
            let depth = buffer.depth_m[at];
            let Some(normal) = buffer.unit_normal(at).filter(|_| depth > 0.0 && depth.is_finite()) else {
                continue;
            };
            let place = view.eye + view.to_world(view.place(x, y, depth)).as_dvec3();
            let irradiance = light.irradiance(place, normal, controls.shadows);
            let albedo = buffer.albedo.as_ref().map_or([controls.albedo; 3], |albedo| albedo[at]);
            *pixel = std::array::from_fn(|band| albedo[band] * colour[band] * irradiance);
            lit += usize::from(irradiance > 0.0);
        }
        lit
    };
    let pixels = out.light.par_chunks_mut(width).enumerate().map(row).sum();
    Ok(LightningReport { pixels })
}

/// Both flashes, mixed.
struct Light<'a> {
    volume: Option<Mixed<'a>>,
    beams: Vec<(DVec3, f32)>,
    heights: Option<&'a GroundMap>,
    /// Of both, where nothing was baked.
    sum: f32,
}

/// A volume's harmonics with both intensities in them.
struct Mixed<'a> {
    of: &'a LightningVolume,
    nodes: Vec<[f32; 9]>,
}

impl<'a> Light<'a> {
    fn of(frame: &WetFrame<'a>) -> Result<Self, RuntimeError> {
        let sum = frame.lightning.iter().sum();
        let heights = frame.maps.height_m.as_ref();
        let Some(volume) = &frame.maps.lightning else {
            return Ok(Self { volume: None, beams: Vec::new(), heights, sum });
        };
        let count = volume.size.iter().product::<usize>();
        if volume.directions.len() != 2 || volume.harmonics.len() != 2 * count || count == 0 {
            let found = format!("{} directions, {} nodes", volume.directions.len(), volume.harmonics.len());
            let wanted = format!("two key directions of {count} nodes each");
            return Err(RuntimeError::argument("lightning volume", wanted, found));
        }
        let nodes = (0..count).map(|node| {
            std::array::from_fn(|i| {
                let of = |key: usize| frame.lightning[key] * volume.harmonics[key * count + node][i];
                of(0) + of(1)
            })
        });
        let beams = volume.directions.iter().zip(frame.lightning);
        let beams =
            beams.filter(|(_, intensity)| *intensity > 0.0).map(|(towards, intensity)| (*towards, intensity));
        Ok(Self {
            volume: Some(Mixed { of: volume, nodes: nodes.collect() }),
            beams: beams.collect(),
            heights,
            sum,
        })
    }

    /// Irradiance at a place, over that of a beam of intensity 1.
    fn irradiance(&self, place: DVec3, normal: Vec3, shadows: f32) -> f32 {
        let Some(volume) = &self.volume else {
            // Half of an even hemisphere is behind an upright wall.
            return self.sum * 0.5 * (1.0 + normal.z);
        };
        let around = volume.at(place + normal.as_dvec3() * (0.5 * volume.of.cell_m));
        let harmonics = around.map(|value| [value; 3]);
        let mut sum = irradiance_from(&harmonics, normal)[0].max(0.0);
        for (towards, intensity) in &self.beams {
            let cosine = normal.dot(towards.as_vec3());
            if cosine > 0.0 && !self.is_shaded(place, *towards, shadows) {
                sum += intensity * cosine;
            }
        }
        sum
    }

    /// Whether the height map stands between a place and a light.
    fn is_shaded(&self, place: DVec3, towards: DVec3, reach: f32) -> bool {
        let Some(map) = self.heights.filter(|_| reach > 0.0) else { return false };
        let across = towards.truncate().length();
        let step = if across > 1e-3 { map.cell_m / across } else { return false };
        let steps = ((f64::from(reach) / step) as usize).min(SHADOW_STEPS);
        (1..=steps).any(|number| {
            let at = place + towards * (step * (number as f64 + 0.5));
            map.at(at.truncate()).is_some_and(|height| f64::from(height) > at.z)
        })
    }
}

impl Mixed<'_> {
    /// Between eight nodes; beyond the outer ones the nearest.
    fn at(&self, place: DVec3) -> [f32; 9] {
        let volume = self.of;
        let axis = |axis: usize| {
            let at = ((place[axis] - volume.origin_m[axis]) / volume.cell_m)
                .clamp(0.0, (volume.size[axis] - 1) as f64);
            let low = (at as usize).min(volume.size[axis].saturating_sub(2));
            (low, (low + 1).min(volume.size[axis] - 1), (at - low as f64) as f32)
        };
        let (x, y, z) = (axis(0), axis(1), axis(2));
        let mut sum = [0.0; 9];
        for (k, wz) in [(z.0, 1.0 - z.2), (z.1, z.2)] {
            for (j, wy) in [(y.0, 1.0 - y.2), (y.1, y.2)] {
                for (i, wx) in [(x.0, 1.0 - x.2), (x.1, x.2)] {
                    let node = &self.nodes[(k * volume.size[1] + j) * volume.size[0] + i];
                    let weight = wx * wy * wz;
                    sum.iter_mut().zip(node).for_each(|(sum, value)| *sum += weight * value);
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::wet::frame::GBuffer;
    use crate::wet::maps::WetMaps;
    use crate::world::WorldLight;
    use glam::DVec2;
    use squall_formats::units::Degrees;
    use std::f32::consts::PI;

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
        let controls = LightningControls { strength: 2.0, blue: 1.0, ..LightningControls::default() };
        let mut layer = Layer::default();
        draw(&frame, &controls, &mut layer).unwrap();
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
}
