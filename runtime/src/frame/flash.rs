//! Strokes that flash in a frame.

use crate::error::RuntimeError;
use crate::relight::BRIGHTEST;
use crate::stroke::Stroke;
use std::sync::Arc;

/// A stroke that flashes, and how brightly.
///
/// ```
/// use squall_runtime::{Flash, Stroke, glam::DVec3};
/// let named = Flash::named("root").brightness(0.35);
/// let spark = Stroke::from_points(&[DVec3::new(0.0, 0.0, 800.0)], 1e6, [1.0; 3])?;
/// let own = Flash::own(spark).colored([0.8, 0.75, 1.28]);
/// assert_eq!((named.brightness, own.brightness), (0.35, 1.0));
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Flash {
    /// Which stroke.
    pub stroke: FlashStroke,
    /// Factor on its intensity, averaged over the exposure; 0 to 1e12.
    pub brightness: f64,
    /// In place of the stroke's own colour: weights of the red, green and blue band.
    pub color: Option<[f32; 3]>,
}

/// Which stroke flashes.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum FlashStroke {
    /// One of the asset's, by name.
    Named(String),
    /// One's own. It's cheapest to hand over the same `Arc` in every frame of a sequence: its light is then known at a glance.
    Own(Arc<Stroke>),
}

impl Flash {
    /// The asset's stroke of this name, at its own brightness.
    #[must_use]
    pub fn named(name: impl Into<String>) -> Self {
        Self { stroke: FlashStroke::Named(name.into()), brightness: 1.0, color: None }
    }

    /// A stroke of one's own.
    #[must_use]
    pub fn own(stroke: impl Into<Arc<Stroke>>) -> Self {
        Self { stroke: FlashStroke::Own(stroke.into()), brightness: 1.0, color: None }
    }

    /// The same flash at another brightness, a factor on the stroke's intensity.
    #[must_use]
    pub fn brightness(self, brightness: f64) -> Self {
        Self { brightness, ..self }
    }

    /// The same flash in another colour.
    #[must_use]
    pub fn colored(self, color: [f32; 3]) -> Self {
        Self { color: Some(color), ..self }
    }

    /// Refuses a stroke of one's own and a colour that are none.
    pub(crate) fn check(&self) -> Result<(), RuntimeError> {
        if let FlashStroke::Own(stroke) = &self.stroke {
            stroke.check()?;
        }
        match self.color {
            Some(color) if !color.iter().all(|band| *band >= 0.0 && band.is_finite()) => {
                let wanted = "three finite numbers from 0";
                Err(RuntimeError::argument("flashes.color", wanted, format!("{color:?}")))
            }
            _ => Ok(()),
        }
    }

    /// Refuses light that single precision cannot hold, and brightness that is none.
    pub(crate) fn check_brightness(&self, stroke: &Stroke) -> Result<(), RuntimeError> {
        let brightest = self.color_of(stroke).into_iter().fold(1.0, f32::max);
        let most = stroke.intensity() * self.brightness * f64::from(brightest);
        if self.brightness >= 0.0 && most <= BRIGHTEST {
            return Ok(());
        }
        let found = format!("{} on {} W/sr", self.brightness, stroke.intensity());
        let wanted = format!("a number from 0, with the stroke at most {BRIGHTEST:e} W/sr");
        Err(RuntimeError::argument("flashes.brightness", wanted, found))
    }

    pub(crate) fn color_of(&self, stroke: &Stroke) -> [f32; 3] {
        self.color.unwrap_or(stroke.color)
    }

    /// Colour times brightness.
    pub(crate) fn scale_of(&self, stroke: &Stroke) -> [f32; 3] {
        self.color_of(stroke).map(|band| (f64::from(band) * self.brightness) as f32)
    }
}

impl From<&str> for Flash {
    fn from(name: &str) -> Self {
        Self::named(name)
    }
}

impl From<Stroke> for Flash {
    fn from(stroke: Stroke) -> Self {
        Self::own(stroke)
    }
}

impl From<Arc<Stroke>> for Flash {
    fn from(stroke: Arc<Stroke>) -> Self {
        Self::own(stroke)
    }
}
