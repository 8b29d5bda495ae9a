//! A scene's depth buffer, as a renderer or a depth camera hands it over.

use crate::error::RuntimeError;
use squall_formats::units::Metres;

/// What the numbers of a depth buffer measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthKind {
    /// Along the viewing axis: z buffers and depth cameras.
    Planar,
    /// Along each pixel's own ray: ray tracers and laser scanners.
    Range,
}

/// Metres to the scene for every pixel, row 0 = top, x fastest.
///
/// +∞ is sky. Zero, negative numbers and NaN are unknown, as depth cameras leave holes; they count as sky
/// unless [`DepthBuffer::with_unknown`] says at what depth to assume them.
#[derive(Clone, Copy, Debug)]
pub struct DepthBuffer<'a> {
    width: usize,
    height: usize,
    kind: DepthKind,
    unknown: f64,
    metres: &'a [f32],
}

impl<'a> DepthBuffer<'a> {
    /// A buffer over `metres`. Errors: not `width * height` numbers.
    pub fn new(
        metres: &'a [f32],
        width: usize,
        height: usize,
        kind: DepthKind,
    ) -> Result<Self, RuntimeError> {
        if width.checked_mul(height) != Some(metres.len()) || metres.is_empty() {
            let wanted = format!("{width} × {height} numbers");
            return Err(RuntimeError::argument("depth buffer", wanted, metres.len()));
        }
        Ok(Self { width, height, kind, unknown: f64::INFINITY, metres })
    }

    /// The same buffer with holes at `depth` (of the buffer's own kind, from 0) in place of sky. A depth that is negative or no
    /// number says nothing, and holes stay sky.
    pub fn with_unknown(mut self, depth: Metres) -> Self {
        self.unknown = if depth.0 >= 0.0 { depth.0 } else { f64::INFINITY };
        self
    }

    /// Refuses a picture of another size.
    pub(crate) fn check_size(&self, width: usize, height: usize) -> Result<(), RuntimeError> {
        if (self.width, self.height) == (width, height) {
            return Ok(());
        }
        let found = format!("{} × {}", self.width, self.height);
        Err(RuntimeError::argument("depth buffer", format!("the picture's {width} × {height}"), found))
    }

    /// Planar depth of pixel (x, y) in metres, +∞ for sky. `secant` is 1/cos of the angle between the
    /// pixel's ray and the viewing axis; only ranges ask for it.
    #[inline]
    pub fn planar(&self, x: usize, y: usize, secant: impl FnOnce() -> f64) -> f64 {
        let metres = f64::from(self.metres[y * self.width + x]);
        let metres = if metres > 0.0 { metres } else { self.unknown };
        match self.kind {
            DepthKind::Planar => metres,
            DepthKind::Range => metres / secant(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_are_sky_unless_told_otherwise() {
        let metres = [0.0, -1.0, f32::NAN, f32::INFINITY, 8.0, 3.0];
        let buffer = DepthBuffer::new(&metres, 3, 2, DepthKind::Range).unwrap();
        for (x, y) in [(0, 0), (1, 0), (2, 0), (0, 1)] {
            assert_eq!(buffer.planar(x, y, || 2.0), f64::INFINITY);
        }
        assert_eq!(buffer.planar(1, 1, || 2.0), 4.0);
        assert_eq!(buffer.with_unknown(Metres(6.0)).planar(2, 0, || 2.0), 3.0);
        assert!(DepthBuffer::new(&metres, 4, 2, DepthKind::Planar).is_err());
        assert!(buffer.check_size(2, 3).is_err());
    }
}
