//! A scene of the caller's on the card: its own textures, or ones that its pixels are brought to.

use super::super::foreground::{Foreground, Of, Pixels};
use super::Card;
use crate::camera::Camera;
use crate::depth::DepthKind;
use crate::error::RuntimeError;
use crate::gpu::Gpu;
use crate::gpu::compose::SceneViews;
use crate::gpu::memory::Image;
use crate::gpu::targets::METRES;
use std::sync::Arc;

/// What stands before sky and cloud.
pub struct Before {
    pub views: SceneViews,
    /// The pixels that were brought, and the textures that hold them.
    brought: Option<(Arc<Pixels>, Vec<Image>)>,
}

impl Before {
    fn brought(gpu: &Gpu, pixels: &Arc<Pixels>) -> Self {
        let size = [pixels.size[0], pixels.size[1], 1];
        let image = |label: &str, format| {
            gpu.texture(label, size, (wgpu::TextureDimension::D2, format), wgpu::TextureUsages::empty())
        };
        let metres = image("a scene's depth", METRES);
        gpu.fill(&metres, &pixels.metres);
        let light = pixels.light.as_ref().map(|light| {
            let held = image("a scene's light", wgpu::TextureFormat::Rgba32Float);
            let texels: Vec<[f32; 4]> = light.pixels.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
            gpu.fill(&held, &texels);
            held
        });
        let views = SceneViews {
            metres: metres.view.clone(),
            light: light.as_ref().map(|light| light.view.clone()),
            is_planar: pixels.kind == DepthKind::Planar,
        };
        Self { views, brought: Some((pixels.clone(), light.into_iter().chain([metres]).collect())) }
    }
}

impl Card {
    /// Has the caller's scene on the card, or none.
    ///
    /// Errors: a scene of another size than the camera's picture.
    pub(super) fn set_foreground(
        &mut self,
        foreground: Option<&Foreground>,
        camera: &Camera,
    ) -> Result<(), RuntimeError> {
        let Some(foreground) = foreground else {
            self.before = None;
            return Ok(());
        };
        foreground.check(camera)?;
        match &foreground.0 {
            Of::Pixels(pixels) => {
                let known = self.before.as_ref().and_then(|before| before.brought.as_ref());
                if !known.is_some_and(|(known, _)| Arc::ptr_eq(known, pixels)) {
                    self.before = Some(Before::brought(&self.gpu, pixels));
                }
            }
            Of::Textures(textures) => {
                let (metres, light) = (textures.metres.clone(), textures.light.clone());
                let is_planar = textures.kind == DepthKind::Planar;
                self.before = Some(Before { views: SceneViews { metres, light, is_planar }, brought: None });
            }
        }
        Ok(())
    }
}
