//! A scene of the caller's that stands in the storm: its depth, and its light where that is to be seen.
//!
//! Pixel by pixel the nearer of it and the asset's town is seen; cloud and sky are behind either. Clear air, the rain's medium and
//! streaks lie before it, lamps and channels behind it are hidden. Mirrors and shadows know nothing of it.

use super::{Memory, StormRenderer};
use crate::camera::Camera;
use crate::depth::DepthKind;
use crate::error::RuntimeError;
use crate::parallel::prelude::*;
use crate::picture::Picture;
use glam::DVec3;
use std::sync::Arc;

/// A scene of the caller's, seen by the frame's own camera.
///
/// ```
/// use squall_runtime::{StormRenderer, depth::DepthKind, renderer::Foreground};
/// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
/// let mut renderer = StormRenderer::open(path)?;
/// let frame = renderer.frame().expect("the asset brings a view");
/// // A wall 12 m ahead in the left half of the picture, which sheds no light.
/// let metres = (0..64 * 36).map(|at| if at % 64 < 32 { 12.0 } else { f32::INFINITY }).collect();
/// renderer.set_foreground(Some(Foreground::pixels(None, metres, [64, 36], DepthKind::Planar)?));
/// renderer.render(&frame)?;
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
#[derive(Clone)]
pub struct Foreground(pub(super) Of);

/// Where it lies.
#[derive(Clone)]
pub(super) enum Of {
    Pixels(Arc<Pixels>),
    #[cfg(feature = "gpu")]
    Textures(Textures),
}

/// A scene in memory.
pub(super) struct Pixels {
    pub light: Option<Picture>,
    pub metres: Vec<f32>,
    pub size: [u32; 2],
    pub kind: DepthKind,
}

/// A scene on the card that draws.
#[cfg(feature = "gpu")]
#[derive(Clone)]
pub(super) struct Textures {
    pub light: Option<wgpu::TextureView>,
    pub metres: wgpu::TextureView,
    pub kind: DepthKind,
}

impl Foreground {
    /// A scene in memory, of either backend: metres to it, row 0 on top, and the radiance that leaves it, W/(m² sr); without light it is
    /// black. A pixel of +∞, and one without a depth (0, negative numbers, NaN), shows the storm.
    ///
    /// Errors: depth or light of another size.
    pub fn pixels(
        light: Option<Picture>,
        metres: Vec<f32>,
        size: [u32; 2],
        kind: DepthKind,
    ) -> Result<Self, RuntimeError> {
        let [width, height] = size.map(|side| side as usize);
        if width.checked_mul(height) != Some(metres.len()) || metres.is_empty() {
            return Err(RuntimeError::argument(
                "foreground's depth",
                format!("{width} × {height} numbers"),
                metres.len(),
            ));
        }
        if let Some(light) = light.as_ref().filter(|light| (light.width, light.height) != (width, height)) {
            let found = format!("{} × {}", light.width, light.height);
            return Err(RuntimeError::argument("foreground's light", format!("{width} × {height}"), found));
        }
        Ok(Self(Of::Pixels(Arc::new(Pixels { light, metres, size, kind }))))
    }

    /// A scene on the card that draws: textures of its device and of the frame's size, bound as they are. `metres` holds metres in its
    /// first channel (`r32float`), `light` radiance, W/(m² sr), in three (`rgba16float`, `rgba32float`); what they mean is as in
    /// [`Foreground::pixels`]. A z buffer is turned into metres first: near / z where z is reversed and without end.
    #[cfg(feature = "gpu")]
    #[must_use]
    pub fn textures(light: Option<wgpu::TextureView>, metres: wgpu::TextureView, kind: DepthKind) -> Self {
        Self(Of::Textures(Textures { light, metres, kind }))
    }

    /// Columns and rows.
    pub(super) fn size(&self) -> [u32; 2] {
        match &self.0 {
            Of::Pixels(pixels) => pixels.size,
            #[cfg(feature = "gpu")]
            Of::Textures(textures) => {
                let size = textures.metres.texture().size();
                [size.width, size.height]
            }
        }
    }

    /// Refuses a frame of another size.
    pub(super) fn check(&self, camera: &Camera) -> Result<(), RuntimeError> {
        let wanted = [camera.width, camera.height];
        let found = self.size();
        if wanted == found {
            return Ok(());
        }
        let [wanted, found] = [wanted, found].map(|[width, height]| format!("{width} × {height}"));
        Err(RuntimeError::argument("foreground", format!("the frame's {wanted}"), found))
    }

    /// The scene in memory, for a processor that draws `camera`'s picture.
    ///
    /// Errors: it is of another size, or lies on a card.
    pub(super) fn for_processor(&self, camera: &Camera) -> Result<Arc<Pixels>, RuntimeError> {
        self.check(camera)?;
        match &self.0 {
            Of::Pixels(pixels) => Ok(pixels.clone()),
            #[cfg(feature = "gpu")]
            Of::Textures(_) => {
                let wanted = "pixels in memory: the processor draws (StormRenderer::set_backend)";
                Err(RuntimeError::argument("foreground", wanted, "textures of a card"))
            }
        }
    }
}

impl Pixels {
    /// Metres along the ray through a pixel's middle to the scene; +∞ where there is none.
    fn range(&self, camera: &Camera, x: usize, y: usize) -> f32 {
        let metres = self.metres[y * self.size[0] as usize + x];
        // Written so that NaN is no depth.
        if metres.partial_cmp(&0.0).is_none_or(|order| order.is_le()) {
            return f32::INFINITY;
        }
        match self.kind {
            DepthKind::Range => metres,
            DepthKind::Planar => metres * camera.secants().at(x as f64 + 0.5, y as f64 + 0.5) as f32,
        }
    }

    /// Lays the scene over `picture` where it is nearer than what `before` says stands there, m along the ray; `through` says what
    /// the clear air leaves of light from so many metres, and what it adds.
    pub fn compose(
        &self,
        camera: &Camera,
        before: &(dyn Fn(usize, usize) -> f32 + Sync),
        through: &(dyn Fn(f32) -> ([f32; 3], [f32; 3]) + Sync),
        picture: &mut Picture,
    ) {
        let width = picture.width;
        let row = |(y, row): (usize, &mut [[f32; 3]])| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let metres = self.range(camera, x, y);
                if metres < before(x, y) {
                    let light = self.light.as_ref().map_or([0.0; 3], |light| light.pixels[y * width + x]);
                    let (left, added) = through(metres);
                    *pixel = std::array::from_fn(|band| light[band] * left[band] + added[band]);
                }
            }
        };
        picture.pixels.par_chunks_mut(width).enumerate().for_each(row);
    }

    /// Shortens metres along rays to those of the scene where it is nearer.
    pub fn shorten(&self, camera: &Camera, metres: &mut [f32]) {
        let width = self.size[0] as usize;
        for (at, metres) in metres.iter_mut().enumerate() {
            let own = self.range(camera, at % width, at / width);
            if own < *metres {
                *metres = own;
            }
        }
    }

    /// Whether the scene stands before a point that the camera would see.
    pub fn hides(&self, camera: &Camera, point: DVec3) -> bool {
        let Some(place) = camera.project(point).filter(|place| place.depth > 0.0) else { return false };
        let pixel = place.pixel.floor();
        let inside = pixel.cmpge(glam::DVec2::ZERO).all()
            && pixel.x < f64::from(self.size[0])
            && pixel.y < f64::from(self.size[1]);
        inside
            && f64::from(self.range(camera, pixel.x as usize, pixel.y as usize))
                < camera.position.distance(point)
    }
}

impl Memory {
    /// The caller's scene, for a processor that draws `camera`'s picture.
    ///
    /// Errors: as [`Foreground::for_processor`].
    pub fn scene_before(&self, camera: &Camera) -> Result<Option<Arc<Pixels>>, RuntimeError> {
        self.foreground.as_ref().map(|foreground| foreground.for_processor(camera)).transpose()
    }
}

impl StormRenderer {
    /// Has a scene of the caller's stand in every picture from now on, until it is told another.
    pub fn set_foreground(&mut self, foreground: Option<Foreground>) {
        self.memory.foreground = foreground;
    }
}

#[cfg(test)]
mod tests;
