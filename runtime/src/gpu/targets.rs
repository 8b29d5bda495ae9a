//! Pictures that passes hand on to each other, made once per picture size.

use super::Gpu;
use super::memory::Image;

/// What light is stored as: filtered, blended and written everywhere; in units of the frame's `unit`.
pub const LIGHT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// What distances are stored as, m.
pub const METRES: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;

/// The pictures of one size.
pub struct Targets {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Light of sky, sun and cloud at every pixel; the fourth number is the share of the sky that the cloud lets through.
    pub beyond: Image,
    /// The town's light times its cover, and its cover.
    pub town: Image,
    /// How far the town is, m.
    pub town_metres: Image,
    /// The whole picture, without the glow.
    pub picture: Image,
    /// Where a scene of the caller's stands: metres to the nearer of it and the town, and to itself.
    pub scene: Option<[Image; 2]>,
}

impl Targets {
    /// Makes them.
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        Self {
            size,
            beyond: gpu.target("beyond", size, LIGHT),
            town: gpu.target("town", size, LIGHT),
            town_metres: gpu.target("town's distance", size, METRES),
            picture: gpu.picture_target("picture", size),
            scene: None,
        }
    }

    /// Makes room for a scene of the caller's.
    pub fn with_scene(&mut self, gpu: &Gpu) {
        let target = |label: &str| gpu.target(label, self.size, METRES);
        self.scene.get_or_insert_with(|| ["what is nearest", "the scene's distance"].map(target));
    }

    /// Metres to what is seen, and to a scene of the caller's (to the town where there is none).
    pub fn metres(&self) -> [&wgpu::TextureView; 2] {
        self.scene
            .as_ref()
            .map_or([&self.town_metres.view; 2], |both| both.each_ref().map(|image| &image.view))
    }
}

impl Gpu {
    /// A picture that compute passes write and render passes blend over.
    pub(crate) fn picture_target(&self, label: &str, size: [u32; 2]) -> Image {
        let usage = wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::RENDER_ATTACHMENT;
        self.texture(label, [size[0], size[1], 1], (wgpu::TextureDimension::D2, LIGHT), usage)
    }
}
