//! A scene's depth buffer, as a renderer or a depth camera hands it over.

use crate::error::RuntimeError;
use squall_formats::units::Metres;
use std::borrow::Cow;
use std::ops::Range;

/// What the numbers of a depth buffer measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthKind {
    /// Along the viewing axis: z buffers and depth cameras.
    Planar,
    /// Along each pixel's own ray: ray tracers and laser scanners.
    Range,
}

/// What to make of pixels whose depth is unknown: 0, a negative number or NaN, as depth cameras leave them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum DepthHoles {
    /// The rain's medium leaves such a pixel's light as it is; streaks are drawn over it.
    #[default]
    LeaveAlone,
    /// The depth of the nearest pixel that has one; holes stay holes where no pixel does.
    FillFromNeighbours,
    /// This depth, of the buffer's own kind, from 0; +∞ is sky. A negative number or NaN says nothing, and holes are left alone.
    At(Metres),
}

/// Metres to the scene for every pixel, row 0 = top, x fastest. +∞ is sky; 0, negative numbers and NaN are holes.
///
/// ```
/// use squall_runtime::depth::{DepthBuffer, DepthHoles, DepthKind};
/// let metres = [4.0, 0.0, f32::NAN, 8.0];
/// let depth = DepthBuffer::new(&metres, 2, 2, DepthKind::Planar)?;
/// assert_eq!(depth.holes(), 2);
/// let filled = depth.with_holes(DepthHoles::FillFromNeighbours);
/// assert_eq!(filled.known(1, 0, || 1.0), Some(4.0));
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
#[derive(Clone, Debug)]
pub struct DepthBuffer<'a> {
    width: usize,
    height: usize,
    kind: DepthKind,
    /// In place of a hole's depth; NaN leaves it alone.
    unknown: f64,
    holes: usize,
    metres: Cow<'a, [f32]>,
}

fn is_hole(metres: f32) -> bool {
    // Written so that NaN is one too.
    metres.partial_cmp(&0.0).is_none_or(|order| order.is_le())
}

impl<'a> DepthBuffer<'a> {
    /// A buffer over `metres`, whose holes are left alone. Errors: not `width * height` numbers.
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
        let holes = metres.iter().filter(|&&value| is_hole(value)).count();
        Ok(Self { width, height, kind, unknown: f64::NAN, holes, metres: Cow::Borrowed(metres) })
    }

    /// The same buffer with another answer to its holes. [`DepthHoles::FillFromNeighbours`] copies the buffer, if it has any.
    #[must_use]
    pub fn with_holes(mut self, holes: DepthHoles) -> Self {
        self.unknown = match holes {
            DepthHoles::At(depth) if depth.0 >= 0.0 => depth.0,
            _ => f64::NAN,
        };
        if holes == DepthHoles::FillFromNeighbours && self.holes > 0 {
            self.metres = Cow::Owned(filled(&self.metres, self.width, self.height));
        }
        self
    }

    /// Pixels without a depth, whatever is made of them.
    pub fn holes(&self) -> usize {
        self.holes
    }

    /// Refuses a picture of another size.
    pub(crate) fn check_size(&self, width: usize, height: usize) -> Result<(), RuntimeError> {
        if (self.width, self.height) == (width, height) {
            return Ok(());
        }
        let found = format!("{} × {}", self.width, self.height);
        Err(RuntimeError::argument("depth buffer", format!("the picture's {width} × {height}"), found))
    }

    /// The numbers of row `y` as they came, holes and all.
    pub(crate) fn row(&self, y: usize) -> &[f32] {
        &self.metres[y * self.width..(y + 1) * self.width]
    }

    /// The least and the greatest number of a rectangle of pixels, in the buffer's own kind; holes that are left alone are as far as
    /// the sky.
    pub(crate) fn range(&self, columns: Range<usize>, rows: Range<usize>) -> [f32; 2] {
        let unknown = if self.unknown.is_nan() { f32::INFINITY } else { self.unknown as f32 };
        let mut ends = [f32::INFINITY, 0.0f32];
        for y in rows {
            for &metres in &self.row(y)[columns.clone()] {
                let metres = if metres > 0.0 { metres } else { unknown };
                ends[0] = if metres < ends[0] { metres } else { ends[0] };
                ends[1] = if metres > ends[1] { metres } else { ends[1] };
            }
        }
        ends
    }

    /// What they measure.
    pub(crate) fn kind(&self) -> DepthKind {
        self.kind
    }

    /// Planar depth of pixel (x, y) in metres, +∞ for sky, `None` for a hole that is left alone. `secant` is 1/cos of the angle
    /// between the pixel's ray and the viewing axis; only ranges ask for it.
    #[inline]
    pub fn known(&self, x: usize, y: usize, secant: impl FnOnce() -> f64) -> Option<f64> {
        let metres = self.metres[y * self.width + x];
        let metres = if is_hole(metres) { self.unknown } else { f64::from(metres) };
        match self.kind {
            _ if metres.is_nan() => None,
            DepthKind::Planar => Some(metres),
            DepthKind::Range => Some(metres / secant()),
        }
    }

    /// The same, with holes that are left alone as far as the sky.
    #[inline]
    pub fn planar(&self, x: usize, y: usize, secant: impl FnOnce() -> f64) -> f64 {
        self.known(x, y, secant).unwrap_or(f64::INFINITY)
    }
}

/// Every hole with the depth of the nearest known pixel, as two passes over the picture find it (Danielsson 1980): off by less
/// than a pixel's distance at most.
fn filled(metres: &[f32], width: usize, height: usize) -> Vec<f32> {
    const NOWHERE: [i32; 2] = [i32::MAX; 2];
    let far = |[x, y]: [i32; 2]| -> i64 {
        if x == i32::MAX { i64::MAX } else { i64::from(x) * i64::from(x) + i64::from(y) * i64::from(y) }
    };
    // From each pixel to the known one that it takes its depth from.
    let mut way: Vec<[i32; 2]> =
        metres.iter().map(|&value| if is_hole(value) { NOWHERE } else { [0; 2] }).collect();
    let mut look = |x: usize, y: usize, [dx, dy]: [i32; 2]| {
        let (nx, ny) = (x as i32 + dx, y as i32 + dy);
        if nx < 0 || ny < 0 || nx >= width as i32 || ny >= height as i32 {
            return;
        }
        let next = way[ny as usize * width + nx as usize];
        let own = &mut way[y * width + x];
        if next != NOWHERE && far([next[0] + dx, next[1] + dy]) < far(*own) {
            *own = [next[0] + dx, next[1] + dy];
        }
    };
    for y in 0..height {
        for x in 0..width {
            [[-1, 0], [-1, -1], [0, -1], [1, -1]].into_iter().for_each(|step| look(x, y, step));
        }
        (0..width).rev().for_each(|x| look(x, y, [1, 0]));
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            [[1, 0], [1, 1], [0, 1], [-1, 1]].into_iter().for_each(|step| look(x, y, step));
        }
        (0..width).for_each(|x| look(x, y, [-1, 0]));
    }
    let value = |(at, way): (usize, &[i32; 2])| match *way {
        NOWHERE => metres[at],
        [dx, dy] => metres[(at as i64 + i64::from(dx) + i64::from(dy) * width as i64) as usize],
    };
    way.iter().enumerate().map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const METRES: [f32; 6] = [0.0, -1.0, f32::NAN, f32::INFINITY, 8.0, 3.0];

    fn buffer() -> DepthBuffer<'static> {
        DepthBuffer::new(&METRES, 3, 2, DepthKind::Range).unwrap()
    }

    #[test]
    fn holes_are_counted_and_left_alone_unless_told_otherwise() {
        let buffer = buffer();
        assert_eq!(buffer.holes(), 3);
        for x in 0..3 {
            assert_eq!(buffer.known(x, 0, || 2.0), None);
            assert_eq!(buffer.planar(x, 0, || 2.0), f64::INFINITY);
        }
        assert_eq!(buffer.known(0, 1, || 2.0), Some(f64::INFINITY));
        assert_eq!(buffer.planar(1, 1, || 2.0), 4.0);
        let at = |depth| buffer.clone().with_holes(DepthHoles::At(Metres(depth))).known(2, 0, || 2.0);
        assert_eq!((at(6.0), at(f64::INFINITY), at(0.0)), (Some(3.0), Some(f64::INFINITY), Some(0.0)));
        assert_eq!((at(-1.0), at(f64::NAN)), (None, None));
        assert_eq!(buffer.range(0..3, 0..2), [3.0, f32::INFINITY]);
        assert_eq!(buffer.range(1..3, 1..2), [3.0, 8.0]);
        let filled = buffer.clone().with_holes(DepthHoles::At(Metres(2.0)));
        assert_eq!(filled.range(0..2, 0..1), [2.0; 2]);
        assert!(DepthBuffer::new(&METRES, 4, 2, DepthKind::Planar).is_err());
        assert!(buffer.check_size(2, 3).is_err());
    }

    #[test]
    fn filled_holes_take_the_nearest_known_depth() {
        let filled = buffer().with_holes(DepthHoles::FillFromNeighbours);
        assert_eq!(filled.holes(), 3);
        assert_eq!([0, 1, 2].map(|x| filled.planar(x, 0, || 1.0)), [f64::INFINITY, 8.0, 3.0]);
        // Against looking at every pixel, on a scatter of known ones.
        let (width, height) = (17, 13);
        let metres: Vec<f32> =
            (0..width * height).map(|i| if i * i % 23 == 3 { i as f32 + 1.0 } else { 0.0 }).collect();
        let found = super::filled(&metres, width, height);
        for at in 0..metres.len() {
            let distance = |other: usize| {
                let (dx, dy) = ((at % width).abs_diff(other % width), (at / width).abs_diff(other / width));
                ((dx * dx + dy * dy) as f64).sqrt()
            };
            let known = (0..metres.len()).filter(|&other| metres[other] > 0.0);
            let least = known.map(distance).fold(f64::INFINITY, f64::min);
            let taken = distance(found[at] as usize - 1);
            assert!(taken < least + 1.0, "{at}: {taken} {least}");
        }
        let none = super::filled(&[0.0, f32::NAN], 2, 1);
        assert!(none[0] == 0.0 && none[1].is_nan());
    }
}
