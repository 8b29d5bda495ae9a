//! What the town and its ground are made of, pixel by pixel: the layers that programs shade with.

use super::StormRenderer;
use crate::error::RuntimeError;
use crate::frame::Frame;
use crate::parallel::prelude::*;
use crate::shade::town::{Hit, Surface, Town};
use glam::Vec3;
use squall_formats::section::town::TownSection;

/// Roughness of walls and dry ground, of window glass, and of a closed film of water.
const ROUGH: f32 = 0.85;
const GLASS: f32 = 0.05;
const WATER: f32 = 0.08;
/// What stands higher above a spot than this keeps no rain off it, m.
const HIGHEST_M: f32 = 1e4;

/// A spot in a pixel's middle.
pub(super) struct Spot {
    surface: Surface,
    hit: Hit,
}

impl Spot {
    /// Perceptual roughness: that of its parts, by their shares.
    pub fn roughness(&self) -> f32 {
        let Surface { glass, wet, .. } = self.surface;
        let dry = ROUGH + (GLASS - ROUGH) * glass;
        dry + (WATER - dry) * wet
    }

    /// Diffuse albedo.
    pub fn albedo(&self) -> [f32; 3] {
        self.surface.albedo
    }

    /// Radiance that it sends by itself, W/(m² sr).
    pub fn emission(&self) -> [f32; 3] {
        self.surface.emission
    }

    /// Whether the town stands above it.
    pub fn is_covered(&self, town: &Town) -> bool {
        let off = self.hit.normal * (1e-3 * (1.0 + self.hit.distance * 1e-2));
        town.trace(self.hit.point + off, Vec3::Z, HIGHEST_M).is_some()
    }
}

impl StormRenderer {
    /// Takes all water off the town's ground, for good: pictures that other programs make wet. An asset without a town stays as it is.
    ///
    /// Errors: a damaged town.
    pub fn dry_ground(&mut self) -> Result<(), RuntimeError> {
        if self.scene.town.is_some() {
            let read = TownSection::read;
            let mut section = self.scene.asset.section(TownSection::TAG, "the town", read)?;
            (section.ground.wetness, section.ground.puddles) = (0.0, 0.0);
            self.scene.town = Some(Town::new(&section));
        }
        Ok(())
    }

    /// One value a pixel of what its middle shows of the town; `otherwise` where it shows none.
    pub(super) fn of_surfaces<T: Copy + Send + Sync>(
        &self,
        asked: &Frame,
        of: impl Fn(&Town, &Spot) -> T + Sync,
        otherwise: T,
    ) -> Vec<T> {
        let frame = self.scene.place.frame(asked);
        let camera = &frame.camera;
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut values = vec![otherwise; width * height];
        let Some(town) = &self.scene.town else { return values };
        let pixel = 1.0 / camera.pixels_per_metre() as f32;
        let row = |(y, row): (usize, &mut [T])| {
            for (x, value) in row.iter_mut().enumerate() {
                let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
                let direction = ray.direction.as_vec3();
                let Some(hit) = town.trace(ray.origin.as_vec3(), direction, f32::INFINITY) else { continue };
                // Ground that is looked at along itself is averaged over what a pixel covers of it.
                let facing = hit.normal.dot(-direction).max(0.02);
                let footprint = hit.distance * pixel / facing.sqrt();
                *value = of(town, &Spot { surface: town.surface(&hit, footprint), hit });
            }
        };
        values.par_chunks_mut(width).enumerate().for_each(row);
        values
    }
}
