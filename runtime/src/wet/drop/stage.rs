//! A small scene for tests: level ground at z = 0 and a box on it, before a grey sky.

use crate::camera::Camera;
use crate::wet::frame::{GBuffer, WetFrame};
use crate::wet::maps::{GroundMap, WetMaps};
use crate::wet::ripples::DropFlux;
use crate::world::WorldLight;
use glam::{DVec2, DVec3};
use squall_formats::units::Degrees;

/// What a frame borrows.
pub(crate) struct Stage {
    pub camera: Camera,
    pub buffer: GBuffer,
    pub maps: WetMaps,
    pub light: WorldLight,
    pub flux: Vec<DropFlux>,
    pub wind: DVec3,
}

/// The box, m.
pub(crate) const LOW: DVec3 = DVec3::new(-1.0, 4.0, 0.0);
pub(crate) const HIGH: DVec3 = DVec3::new(1.0, 6.0, 1.0);

/// Marshall and Palmer's rain at 25 mm/h in four classes.
pub(crate) fn rain() -> Vec<DropFlux> {
    let drop = |diameter_mm: f64, speed_m_per_s: f64, impacts_per_m2_s: f64| DropFlux {
        diameter_m: diameter_mm * 1e-3,
        speed_m_per_s,
        impacts_per_m2_s,
    };
    vec![drop(0.7, 2.9, 4200.0), drop(1.5, 5.4, 1000.0), drop(2.5, 7.4, 180.0), drop(3.5, 8.4, 25.0)]
}

impl Stage {
    pub fn new(eye: DVec3, target: DVec3, size: [u32; 2]) -> Self {
        let camera = Camera::look_at(eye, target, Degrees(60.0), size).unwrap();
        let pixels = (size[0] * size[1]) as usize;
        let mut buffer = GBuffer {
            size: size.map(|n| n as usize),
            colour: vec![[0.2, 0.22, 0.25]; pixels],
            depth_m: vec![f32::INFINITY; pixels],
            normal: vec![[0.0; 3]; pixels],
            ..GBuffer::default()
        };
        for y in 0..buffer.size[1] {
            for x in 0..buffer.size[0] {
                let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
                if let Some((distance, normal)) = strike(ray.origin, ray.direction) {
                    let pixel = y * buffer.size[0] + x;
                    buffer.depth_m[pixel] = (distance * ray.direction.dot(camera.forward)) as f32;
                    buffer.normal[pixel] = normal.as_vec3().into();
                    buffer.colour[pixel] = [0.05, 0.05, 0.06];
                }
            }
        }
        let light = WorldLight::from_radiance(&|d| if d.z > 0.0 { [0.3; 3] } else { [0.05; 3] }, None);
        Self { camera, buffer, maps: WetMaps::default(), light, flux: rain(), wind: DVec3::ZERO }
    }

    /// A height map that has a roof at `height` over x < `edge`, and the ground elsewhere.
    pub fn roof(&mut self, edge: f64, height: f32) {
        let (size, cell_m) = ([200, 200], 0.1);
        let value = |k: usize| if -10.0 + (k % 200) as f64 * cell_m < edge - 1e-9 { height } else { 0.0 };
        let values = (0..200 * 200).map(value).collect();
        self.maps.height_m = Some(GroundMap { origin_m: DVec2::new(-10.0, -2.0), cell_m, size, values });
    }

    pub fn frame(&self, time_s: f64) -> WetFrame<'_> {
        WetFrame {
            buffer: &self.buffer,
            colour: &self.buffer.colour,
            camera: &self.camera,
            maps: &self.maps,
            light: &self.light,
            rate_mm_per_h: 25.0,
            flux: &self.flux,
            wind: self.wind,
            time_s,
            seed: 3,
            lightning: [0.0; 2],
        }
    }
}

/// Where a ray meets the ground or the box, and the normal there.
fn strike(origin: DVec3, direction: DVec3) -> Option<(f64, DVec3)> {
    let mut near: Option<(f64, DVec3)> = None;
    let mut consider = |distance: f64, normal: DVec3| {
        if distance > 1e-6 && near.is_none_or(|known| distance < known.0) {
            near = Some((distance, normal));
        }
    };
    if direction.z < -1e-9 {
        consider(-origin.z / direction.z, DVec3::Z);
    }
    for axis in 0..3 {
        for (plane, sign) in [(LOW[axis], -1.0), (HIGH[axis], 1.0)] {
            if direction[axis] * sign >= 0.0 {
                continue;
            }
            let distance = (plane - origin[axis]) / direction[axis];
            let at = origin + direction * distance;
            if (0..3).all(|k| k == axis || (LOW[k]..=HIGH[k]).contains(&at[k])) {
                let mut normal = DVec3::ZERO;
                normal[axis] = sign;
                consider(distance, normal);
            }
        }
    }
    near
}
