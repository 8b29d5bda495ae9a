//! What the last picture is made of, layer by layer: for whoever puts pictures together, and for labels.

use super::draw::{Clouds, cloud_air};
use super::{Scene, StormRenderer, channel};
use crate::error::RuntimeError;
use crate::frame::Frame;
use crate::parallel::prelude::*;
use crate::picture::Picture;
use crate::rain::Streak;

/// A layer of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Layer {
    /// The picture itself: linear radiance.
    Beauty,
    /// Light that the cloud scatters towards the camera, through clear air, where the town does not cover it; before the rain.
    Cloud,
    /// Light that comes straight from the lightning's channels, through cloud and clear air; before the rain.
    Direct,
    /// Coverage α of the rain's streaks, in [0, 1].
    StreakAlpha,
    /// Transmittance of the rain's medium, in [0, 1].
    Transmittance,
    /// Planar depth of the town and its ground, m; +∞ where there is none.
    Depth,
    /// Normal of the town and its ground, a unit vector in the world; 0 where there is none.
    Normal,
    /// Diffuse albedo of the town and its ground, 0 to 1; 0 where there is none.
    Albedo,
    /// Perceptual roughness of the town and its ground, 0 to 1; 0 where there is none.
    Roughness,
    /// Radiance that the town's surfaces send by themselves (lit windows), W/(m² sr), before clear air; lamps are not among them.
    Emission,
    /// How much of the rain reaches the town and its ground: 1 under the open sky, 0 under what covers it and where there is none.
    Wettable,
    /// Name of the nearest drop whose streak crosses the pixel's middle, 64 bits; 0 where there is none.
    Ids,
}

/// A layer's pixels, row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub enum LayerPixels {
    /// Radiance per colour, or a vector.
    Three(Vec<[f32; 3]>),
    /// A share or metres.
    One(Vec<f32>),
    /// Names.
    Names(Vec<u64>),
}

impl Layer {
    /// Every layer.
    pub const ALL: [Self; 12] = [
        Self::Beauty,
        Self::Cloud,
        Self::Direct,
        Self::StreakAlpha,
        Self::Transmittance,
        Self::Depth,
        Self::Normal,
        Self::Albedo,
        Self::Roughness,
        Self::Emission,
        Self::Wettable,
        Self::Ids,
    ];

    /// Its name on a command line and in a file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Beauty => "beauty",
            Self::Cloud => "cloud",
            Self::Direct => "direct",
            Self::StreakAlpha => "streak-alpha",
            Self::Transmittance => "transmittance",
            Self::Depth => "depth",
            Self::Normal => "normal",
            Self::Albedo => "albedo",
            Self::Roughness => "roughness",
            Self::Emission => "emission",
            Self::Wettable => "wettable",
            Self::Ids => "ids",
        }
    }

    /// The layer of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layer| layer.name() == name)
    }
}

impl StormRenderer {
    /// A layer of the last picture; `frame` is the one that was rendered.
    ///
    /// Errors: as [`StormRenderer::render`]; another frame's size.
    pub fn layer(&self, frame: &Frame, layer: Layer) -> Result<LayerPixels, RuntimeError> {
        #[cfg(feature = "gpu")]
        if self.card.is_some() && layer != Layer::Beauty {
            let wanted = "beauty: the processor draws the other layers";
            return Err(RuntimeError::argument("layer", wanted, layer.name()));
        }
        let memory = &self.memory;
        let is_whole = matches!(layer, Layer::Beauty | Layer::StreakAlpha | Layer::Transmittance);
        if memory.foreground.is_some() && !is_whole {
            let wanted = "beauty, streak-alpha or transmittance where a foreground stands in the picture";
            return Err(RuntimeError::argument("layer", wanted, layer.name()));
        }
        let count = memory.picture.pixels.len();
        if (frame.camera.width as usize, frame.camera.height as usize)
            != (memory.picture.width, memory.picture.height)
        {
            let wanted = format!("the last picture's {} × {}", memory.picture.width, memory.picture.height);
            let found = format!("{} × {}", frame.camera.width, frame.camera.height);
            return Err(RuntimeError::argument("frame", wanted, found));
        }
        let dry = frame.weather.rate.0 == 0.0 || self.scene.rain.is_none();
        let town = || self.scene.town.is_some().then(|| memory.town.frame().pixels.as_slice());
        Ok(match layer {
            Layer::Beauty => LayerPixels::Three(memory.picture.pixels.clone()),
            Layer::Cloud => LayerPixels::Three(self.cloud_light(frame)),
            Layer::Direct => LayerPixels::Three(self.scene.channel_light(frame, memory.sky_of(frame))?),
            Layer::StreakAlpha if dry => LayerPixels::One(vec![0.0; count]),
            Layer::StreakAlpha => LayerPixels::One(memory.rain.mask().to_vec()),
            Layer::Transmittance if dry => LayerPixels::One(vec![1.0; count]),
            Layer::Transmittance => LayerPixels::One(memory.transmittance.clone()),
            Layer::Depth => LayerPixels::One(match town() {
                Some(pixels) => pixels.iter().map(|pixel| pixel.depth).collect(),
                None => vec![f32::INFINITY; count],
            }),
            Layer::Normal => LayerPixels::Three(match town() {
                Some(pixels) => pixels.iter().map(|pixel| pixel.normal.to_array()).collect(),
                None => vec![[0.0; 3]; count],
            }),
            Layer::Albedo => LayerPixels::Three(self.of_surfaces(frame, |_, spot| spot.albedo(), [0.0; 3])),
            Layer::Roughness => LayerPixels::One(self.of_surfaces(frame, |_, spot| spot.roughness(), 0.0)),
            Layer::Emission => {
                LayerPixels::Three(self.of_surfaces(frame, |_, spot| spot.emission(), [0.0; 3]))
            }
            Layer::Wettable => {
                let open =
                    |town: &_, spot: &super::surfaces::Spot| if spot.is_covered(town) { 0.0 } else { 1.0 };
                LayerPixels::One(self.of_surfaces(frame, open, 0.0))
            }
            Layer::Ids if dry => LayerPixels::Names(vec![0; count]),
            Layer::Ids => {
                let depth = |at: usize| town().map_or(f32::INFINITY, |pixels| pixels[at].depth);
                LayerPixels::Names(names(
                    memory.rain.streaks(),
                    [memory.picture.width, memory.picture.height],
                    depth,
                ))
            }
        })
    }

    fn cloud_light(&self, asked: &Frame) -> Vec<[f32; 3]> {
        let memory = &self.memory;
        let frame = self.scene.place.frame(asked);
        let mut light = vec![[0.0; 3]; memory.picture.pixels.len()];
        let Some((_, detail)) = &memory.detail else { return light };
        let clouds = Clouds { scene: &self.scene, frame: &frame, detail };
        let Some(cloud) = clouds.marched(&memory.cells) else { return light };
        let Some(sky) = memory.sky_of(asked) else { return light };
        let (width, camera) = (memory.picture.width, &frame.camera);
        let has_town = self.scene.town.is_some();
        light.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let cover = if has_town { memory.town.frame().pixels[y * width + x].cover } else { 0.0 };
                if cover >= 1.0 {
                    continue;
                }
                let seen = cloud.march(&camera.ray(x as f64 + 0.5, y as f64 + 0.5));
                let air = cloud_air(sky, camera.position, f64::from(seen.distance));
                *pixel = std::array::from_fn(|band| seen.radiance[band] * air[band] * (1.0 - cover));
            }
        });
        light
    }
}

impl super::Memory {
    /// The sky of the last picture, where it was this frame's.
    fn sky_of(&self, frame: &Frame) -> Option<&crate::shade::sky::Sky> {
        self.sky.as_ref().filter(|(known, _)| *known == frame.sky).map(|(_, sky)| sky)
    }
}

impl Scene {
    fn channel_light(
        &self,
        asked: &Frame,
        sky: Option<&crate::shade::sky::Sky>,
    ) -> Result<Vec<[f32; 3]>, RuntimeError> {
        let frame = self.place.frame(asked);
        let mut picture = Picture::new(frame.camera.width as usize, frame.camera.height as usize)?;
        if let Some(sky) = sky {
            let flashes = self.lit_strokes(&frame, sky)?;
            let (camera, cloud, town) = (&frame.camera, self.cloud_grid(), self.town.as_ref());
            let channels = channel::Channels { flashes: &flashes, camera, sky, cloud, town, before: None };
            channels.draw(&|_| 1.0, &mut picture);
        }
        Ok(picture.pixels)
    }
}

/// The nearest drop's name for every pixel whose middle its streak's body covers and the scene does not hide.
fn names(streaks: &[Streak], [width, height]: [usize; 2], scene: impl Fn(usize) -> f32) -> Vec<u64> {
    let mut names = vec![0u64; width * height];
    let mut nearest = vec![f32::INFINITY; width * height];
    for streak in streaks {
        let [a, b] = streak.ends;
        let way = [b[0] - a[0], b[1] - a[1]];
        let squared = (way[0] * way[0] + way[1] * way[1]).max(1e-12);
        // A streak thinner than a pixel names the pixels that its line comes through.
        let half = (0.5 * streak.width).max(0.5);
        let range = |axis: usize, size: usize| {
            let (low, high) = (a[axis].min(b[axis]) - half, a[axis].max(b[axis]) + half);
            let low = (low - 0.5).ceil().clamp(0.0, size as f32) as usize;
            low..((high - 0.5).floor() + 1.0).clamp(0.0, size as f32) as usize
        };
        for y in range(1, height) {
            for x in range(0, width) {
                let from = [x as f32 + 0.5 - a[0], y as f32 + 0.5 - a[1]];
                let along = ((from[0] * way[0] + from[1] * way[1]) / squared).clamp(0.0, 1.0);
                let off = [from[0] - along * way[0], from[1] - along * way[1]];
                if off[0] * off[0] + off[1] * off[1] > half * half {
                    continue;
                }
                let [near, far] = streak.end_depths.map(|depth| 1.0 / depth);
                let depth = 1.0 / (near + (far - near) * along);
                let at = y * width + x;
                if depth < nearest[at] && depth <= scene(at) {
                    (nearest[at], names[at]) = (depth, streak.id);
                }
            }
        }
    }
    names
}
