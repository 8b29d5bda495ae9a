//! A frame that somebody's renderer made, and what is drawn over it.

use crate::camera::Camera;
use crate::error::RuntimeError;
use crate::wet::drop::Weather;
use crate::wet::maps::WetMaps;
use crate::wet::ripples::DropFlux;
use crate::world::WorldLight;
use glam::{DVec3, Vec3};

/// A renderer's buffers, row 0 on top. A buffer that is left out is done without; each effect says what it needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GBuffer {
    /// Width and height, px.
    pub size: [usize; 2],
    /// Light towards the camera, scene-linear, in any unit of radiance.
    pub colour: Vec<[f32; 3]>,
    /// Depth along the viewing axis, m: +∞ is sky, NaN a hole.
    pub depth_m: Vec<f32>,
    /// Unit normals in the world, z up; `[0.0; 3]` where there is none.
    pub normal: Vec<[f32; 3]>,
    /// Diffuse albedo, 0 to 1.
    pub albedo: Option<Vec<[f32; 3]>>,
    /// Perceptual roughness, 0 to 1.
    pub roughness: Option<Vec<f32>>,
    /// Light that surfaces emit of their own, which water doesn't darken; a part of `colour`.
    pub emission: Option<Vec<[f32; 3]>>,
    /// How much of the rain reaches a pixel's surface and stays, 0 (under a roof, or never wet) to 1: an artist's mask.
    pub wettable: Option<Vec<f32>>,
}

impl GBuffer {
    /// Pixels.
    pub fn pixels(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Checks that every buffer has the camera's size.
    ///
    /// Errors: a buffer of another length, by name.
    pub fn check(&self, camera: &Camera) -> Result<(), RuntimeError> {
        let size = [camera.width as usize, camera.height as usize];
        if self.size != size {
            let found = format!("{} × {}", self.size[0], self.size[1]);
            return Err(RuntimeError::argument(
                "G-buffer",
                format!("the camera's {} × {}", size[0], size[1]),
                found,
            ));
        }
        let rest = [
            ("albedo", self.albedo.as_ref().map(Vec::len)),
            ("roughness", self.roughness.as_ref().map(Vec::len)),
            ("emission", self.emission.as_ref().map(Vec::len)),
            ("wettable", self.wettable.as_ref().map(Vec::len)),
        ];
        let needed = [
            ("colour", Some(self.colour.len())),
            ("depth_m", Some(self.depth_m.len())),
            ("normal", Some(self.normal.len())),
        ];
        for (name, length) in needed.into_iter().chain(rest) {
            if length.is_some_and(|length| length != self.pixels()) {
                let wanted = format!("{} pixels", self.pixels());
                return Err(RuntimeError::argument(name, wanted, length.unwrap_or_default()));
            }
        }
        Ok(())
    }

    /// Place of the surface in a pixel, or `None` in the sky and in holes.
    pub fn place(&self, camera: &Camera, x: usize, y: usize) -> Option<DVec3> {
        let depth = f64::from(*self.depth_m.get(y * self.size[0] + x)?);
        if !(depth > 0.0 && depth.is_finite()) {
            return None;
        }
        let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
        let along = ray.direction.dot(camera.forward);
        (along > 0.0).then(|| ray.origin + ray.direction * (depth / along))
    }

    /// Unit normal of a pixel, or `None` where it has none: zero length and not-a-number count as none.
    pub fn unit_normal(&self, pixel: usize) -> Option<Vec3> {
        Vec3::from(*self.normal.get(pixel)?).try_normalize()
    }
}

/// What every effect is told of a frame.
#[derive(Clone, Copy, Debug)]
pub struct WetFrame<'a> {
    /// The renderer's buffers.
    pub buffer: &'a GBuffer,
    /// Light towards the camera as it is by now, in place of the buffers' own: theirs, and what was drawn over it before.
    pub colour: &'a [[f32; 3]],
    /// The camera that they were drawn with.
    pub camera: &'a Camera,
    /// What was baked from the scene's meshes; empty where nothing was.
    pub maps: &'a WetMaps,
    /// Light of the world around, in the buffers' unit of radiance.
    pub light: &'a WorldLight,
    /// Rainfall intensity, mm/h.
    pub rate_mm_per_h: f64,
    /// Drops that reach the ground, by size: Σ N v is their number a square metre and second.
    pub flux: &'a [DropFlux],
    /// Wind, m/s.
    pub wind: DVec3,
    /// Time, s, from any beginning: the same time gives the same frame.
    pub time_s: f64,
    /// Another seed is another rain.
    pub seed: u64,
    /// Intensities L1 and L2 of the two key directions of lightning, 1 at their brightest.
    pub lightning: [f32; 2],
}

impl<'a> WetFrame<'a> {
    /// What falls in it, and when.
    pub(crate) const fn weather(&self) -> Weather<'a> {
        let &Self { flux, rate_mm_per_h, wind, time_s, seed, .. } = self;
        Weather { flux, rate_mm_per_h, wind, time_s, seed }
    }

    /// Checks that every buffer, and the light that stands for the buffers' own, has the camera's size.
    ///
    /// Errors: one of another length, by name.
    pub fn check(&self) -> Result<(), RuntimeError> {
        self.buffer.check(self.camera)?;
        if self.colour.len() != self.buffer.pixels() {
            let wanted = format!("{} pixels", self.buffer.pixels());
            return Err(RuntimeError::argument("colour", wanted, self.colour.len()));
        }
        Ok(())
    }
}

/// Something drawn over a frame: `out = light + (1 − alpha) × below`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layer {
    /// Width and height, px.
    pub size: [usize; 2],
    /// Light that the layer adds, in the buffers' unit of radiance.
    pub light: Vec<[f32; 3]>,
    /// Share of what is below that it hides, 0 to 1.
    pub alpha: Vec<f32>,
}

impl Layer {
    /// A layer that changes nothing; its memory is kept from the last one.
    pub fn clear(&mut self, size: [usize; 2]) {
        self.size = size;
        self.light.clear();
        self.light.resize(size[0] * size[1], [0.0; 3]);
        self.alpha.clear();
        self.alpha.resize(size[0] * size[1], 0.0);
    }

    /// Lays `light` with coverage `alpha` (0 to 1) over what the layer has in a pixel; `light` counts whole, not times `alpha`.
    pub fn over(&mut self, pixel: usize, light: [f32; 3], alpha: f32) {
        let left = 1.0 - alpha;
        for (have, add) in self.light[pixel].iter_mut().zip(light) {
            *have = add + left * *have;
        }
        self.alpha[pixel] = alpha + left * self.alpha[pixel];
    }

    /// Lays the layer over a picture of its size; how many pixels it touches. Pixels that it does not touch keep their bits.
    ///
    /// Errors: a picture of another length.
    pub fn onto(&self, below: &mut [[f32; 3]]) -> Result<usize, RuntimeError> {
        if below.len() != self.light.len() {
            let wanted = format!("{} pixels", self.light.len());
            return Err(RuntimeError::argument("picture", wanted, below.len()));
        }
        let mut touched = 0;
        for ((pixel, light), &alpha) in below.iter_mut().zip(&self.light).zip(&self.alpha) {
            if alpha == 0.0 && *light == [0.0; 3] {
                continue;
            }
            touched += 1;
            for band in 0..3 {
                pixel[band] = light[band] + (1.0 - alpha) * pixel[band];
            }
        }
        Ok(touched)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::units::Degrees;

    /// Single precision.
    const ROUND_OFF: f64 = 1e-5;

    #[test]
    fn a_pixels_place_projects_back_to_it_and_sky_has_none() {
        let camera =
            Camera::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 9.0, 1.0), Degrees(70.0), [8, 6])
                .unwrap();
        let mut buffer = GBuffer { size: [8, 6], depth_m: vec![7.5; 48], ..GBuffer::default() };
        let place = buffer.place(&camera, 6, 1).unwrap();
        let seen = camera.project(place).unwrap();
        assert!((seen.pixel.x - 6.5).abs() < ROUND_OFF && (seen.pixel.y - 1.5).abs() < ROUND_OFF);
        assert!((seen.depth - 7.5).abs() < ROUND_OFF);
        for none in [f32::INFINITY, f32::NAN, 0.0, -1.0] {
            buffer.depth_m[14] = none;
            assert_eq!(buffer.place(&camera, 6, 1), None);
        }
    }

    #[test]
    fn layers_lie_over_one_another_as_over_the_picture() {
        let below = [[0.2f32, 0.4, 0.8]];
        let mut both = Layer::default();
        both.clear([1, 1]);
        both.over(0, [0.1; 3], 0.25);
        both.over(0, [0.3, 0.0, 0.0], 0.5);
        let mut picture = below;
        both.onto(&mut picture).unwrap();
        for band in 0..3 {
            let first = 0.1 + 0.75 * below[0][band];
            let second = [0.3, 0.0, 0.0][band] + 0.5 * first;
            assert!((f64::from(picture[0][band] - second)).abs() < ROUND_OFF);
        }
        assert!(both.onto(&mut [[0.0; 3]; 2]).is_err());
    }
}
