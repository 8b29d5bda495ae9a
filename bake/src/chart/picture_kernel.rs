//! Streaks drawn from their pictures, without any fit: what frames of patterns are compared with.
//!
//! | symbol | name                                                   | unit   |
//! | u, v   | place in the picture, across and along                 | 0 to 1 |
//! | S      | light of the picture left of u and above v, in shares of its whole light | 1 |
//!
//! A picture's samples are even squares of light, so S is linear between their corners and the light of any
//! rectangle (u, v) is a sum of four values of S, exactly. A footprint is cut into small such rectangles in its
//! own frame, so many along a pixel's side at least, and each gives its light to the pixels that it lies on. The lights
//! of all rectangles add up to 1 by construction, at any size: a hundredth of a pixel wide or a hundred pixels.
//!
//! Error: a rectangle's light is spread evenly, and that of one that leans over an upright one of the same middle
//! and the same variances; light moves by less than a rectangle's side.

use crate::input::picture::Grey;
use crate::streak::body;
use squall_formats::section::streak::Body;
use squall_runtime::rain::{Clip, Footprint, Kernel, Span};

/// Rectangles across and along a whole picture at least, however small it is drawn.
const LEAST: f64 = 8.0;
/// What round-off may add to a whole number of rectangles.
const ROUND_OFF: f64 = 1e-9;
/// Spans are padded to whole blocks of this many pixels.
const BLOCK: usize = 4;
/// Longest side drawn, px; beyond it a footprint is not a streak.
const LONGEST_PX: f64 = 1e5;

/// Pictures ready to be drawn, one for each pattern.
#[derive(Clone, Debug)]
pub struct PictureSet {
    pictures: Vec<Light>,
    per_pixel: f64,
}

/// A picture's light, summed.
#[derive(Clone, Debug)]
struct Light {
    size: [usize; 2],
    body: Body,
    /// S at the corners of samples, u fastest, `size` + 1 each way.
    sums: Vec<f64>,
}

/// A row or column of corners and how far beyond it a place lies, 0 to 1.
type Place = (usize, f64);

/// Where a footprint's picture lies in the frame, and what it is cut into.
struct Pose<'a> {
    light: &'a Light,
    /// Unit vectors of u and v in the frame, and the frame's place of u = v = 0, px.
    axes: [[f64; 2]; 2],
    corner: [f64; 2],
    /// Rectangles along u and v, and their sides, px.
    counts: [usize; 2],
    sides: [f64; 2],
    /// Sides of the upright rectangle with a leaning one's variances along x and y, px.
    spread: [f64; 2],
}

impl PictureSet {
    /// Pictures in the order of the patterns that are fitted to them; each has some light and none below zero.
    /// Rectangles along a pixel's side: `per_pixel` at least, from 1.
    pub fn new(pictures: &[Grey], per_pixel: u32) -> Self {
        let pictures = pictures.iter().map(Light::new).collect();
        Self { pictures, per_pixel: per_pixel.max(1).into() }
    }
}

impl Light {
    fn new(picture: &Grey) -> Self {
        let [width, height] = [picture.width, picture.height];
        let stride = width + 1;
        let mut sums = vec![0.0; stride * (height + 1)];
        for y in 0..height {
            let mut row = 0.0;
            for x in 0..width {
                row += f64::from(picture.pixels[y * width + x]);
                sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + row;
            }
        }
        let total = sums[stride * (height + 1) - 1];
        sums.iter_mut().for_each(|sum| *sum /= total);
        Self { size: [width, height], body: body(picture), sums }
    }

    /// Where `share` in [0, 1] of a side lies among the corners.
    fn place(&self, axis: usize, share: f64) -> Place {
        let at = share * self.size[axis] as f64;
        let index = (at as usize).min(self.size[axis] - 1);
        (index, at - index as f64)
    }

    fn sum(&self, (x, right): Place, (y, below): Place) -> f64 {
        let stride = self.size[0] + 1;
        let [upper, lower] = [y, y + 1].map(|y| {
            let pair = &self.sums[y * stride + x..][..2];
            pair[0] + (pair[1] - pair[0]) * right
        });
        upper + (lower - upper) * below
    }
}

impl<'a> Pose<'a> {
    /// The body takes the drop's path and its width, as [`squall_runtime::shade::streak::StreakSet`] has it.
    fn new(set: &'a PictureSet, footprint: &Footprint) -> Option<Self> {
        let light = set.pictures.get(footprint.pattern.checked_rem(set.pictures.len() as u32)? as usize)?;
        let Footprint { centre, axis: [x, y], length, width, .. } = *footprint;
        let length = length + width;
        let norm = libm::sqrt(x * x + y * y);
        let drawable = |value: f64| value > 0.0 && value < LONGEST_PX;
        if !(norm > 0.0 && drawable(norm) && drawable(length) && drawable(width))
            || centre.iter().any(|place| !place.is_finite())
        {
            return None;
        }
        let along = [x / norm, y / norm];
        let axes = [[along[1], -along[0]], along];
        let body = &light.body;
        let size = [width / body.width(), length / body.length()];
        let middle = [0.5 * (body.u[0] + body.u[1]) * size[0], 0.5 * (body.v[0] + body.v[1]) * size[1]];
        let corner = [0, 1].map(|k| centre[k] - axes[0][k] * middle[0] - axes[1][k] * middle[1]);
        let counts = size.map(|size| (size * set.per_pixel - ROUND_OFF).ceil().max(LEAST) as usize);
        let sides = [0, 1].map(|k| size[k] / counts[k] as f64);
        let spread = [0, 1].map(|k| {
            let [across, along] = [sides[0] * axes[0][k], sides[1] * axes[1][k]];
            libm::sqrt(across * across + along * along)
        });
        Some(Self { light, axes, corner, counts, sides, spread })
    }

    fn at(&self, across: f64, along: f64) -> [f64; 2] {
        [0, 1].map(|k| self.corner[k] + self.axes[0][k] * across + self.axes[1][k] * along)
    }

    fn bounds(&self) -> Clip {
        let [width, length] = [0, 1].map(|k| self.sides[k] * self.counts[k] as f64);
        let corners = [self.at(0.0, 0.0), self.at(width, 0.0), self.at(0.0, length), self.at(width, length)];
        let low = |k: usize| corners.iter().fold(f64::INFINITY, |low, at| low.min(at[k])) - self.spread[k];
        let high =
            |k: usize| corners.iter().fold(-f64::INFINITY, |high, at| high.max(at[k])) + self.spread[k];
        let whole = |value: f64| value.clamp(-1e9, 1e9) as i32;
        Clip {
            left: whole(low(0).floor()),
            top: whole(low(1).floor()),
            right: whole(high(0).ceil()),
            bottom: whole(high(1).ceil()),
        }
    }

    /// Rectangles along v that can reach the clip, and some more.
    fn rows(&self, clip: Clip) -> std::ops::Range<usize> {
        let [x, y] = [[clip.left, clip.right], [clip.top, clip.bottom]].map(|ends| ends.map(f64::from));
        let (mut low, mut high) = (f64::INFINITY, -f64::INFINITY);
        for x in x {
            for y in y {
                let along = (x - self.corner[0]) * self.axes[1][0] + (y - self.corner[1]) * self.axes[1][1];
                low = low.min(along);
                high = high.max(along);
            }
        }
        self.range(1, low - 1.0, high + 1.0)
    }

    /// Rectangles along u of row `row` that can reach the clip, and some more.
    fn columns(&self, row: usize, clip: Clip) -> std::ops::Range<usize> {
        let start = self.at(0.0, (row as f64 + 0.5) * self.sides[1]);
        let (mut low, mut high) = (-f64::INFINITY, f64::INFINITY);
        for (k, ends) in [[clip.left, clip.right], [clip.top, clip.bottom]].into_iter().enumerate() {
            // A rectangle reaches less than a pixel beyond its middle.
            let [first, last] = [f64::from(ends[0]) - 1.0 - start[k], f64::from(ends[1]) + 1.0 - start[k]];
            let slope = self.axes[0][k];
            if slope.abs() < 1e-9 {
                if first > 0.0 || last < 0.0 {
                    return 0..0;
                }
                continue;
            }
            low = low.max((first / slope).min(last / slope));
            high = high.min((first / slope).max(last / slope));
        }
        self.range(0, low, high)
    }

    /// Rectangles between two distances from the corner, px.
    fn range(&self, axis: usize, low: f64, high: f64) -> std::ops::Range<usize> {
        let last = self.counts[axis] as f64;
        let whole = |distance: f64| (distance / self.sides[axis]).clamp(0.0, last);
        let (first, end) = (whole(low).floor() as usize, whole(high).ceil() as usize);
        first..end.max(first)
    }
}

/// The pixel where an interval of length `side` of 1 at most around `middle` begins, and the share of it that lies there;
/// the rest lies in the next one.
fn split(middle: f64, side: f64) -> (i32, f64) {
    let start = middle - 0.5 * side;
    let pixel = start.floor();
    let here = pixel + 1.0 - start;
    (pixel as i32, if here < side { here / side } else { 1.0 })
}

/// Footprint number `pattern` modulo the pictures' number, as patterns are drawn. The order in which a pixel's
/// light is added up does not depend on the clip, and so neither does a single bit of its share.
impl Kernel for PictureSet {
    /// A clip's shares.
    type Scratch = (Vec<f64>, Vec<f32>);

    type Placed = Footprint;

    fn place(&self, footprint: &Footprint) -> Option<(Clip, Footprint)> {
        Pose::new(self, footprint).map(|pose| (pose.bounds(), *footprint))
    }

    fn draw(
        &self,
        footprint: &Footprint,
        clip: Clip,
        (patch, line): &mut (Vec<f64>, Vec<f32>),
        put: &mut impl FnMut(Span),
    ) {
        let Some(pose) = Pose::new(self, footprint) else { return };
        let bounds = pose.bounds();
        let clip = Clip {
            left: clip.left.max(bounds.left),
            top: clip.top.max(bounds.top),
            right: clip.right.min(bounds.right),
            bottom: clip.bottom.min(bounds.bottom),
        };
        if clip.left >= clip.right || clip.top >= clip.bottom {
            return;
        }
        let width = (clip.right - clip.left) as usize;
        patch.clear();
        patch.resize(width * (clip.bottom - clip.top) as usize, 0.0);
        let mut add = |x: i32, y: i32, light: f64| {
            if x >= clip.left && x < clip.right && y >= clip.top && y < clip.bottom {
                patch[(y - clip.top) as usize * width + (x - clip.left) as usize] += light;
            }
        };
        let share = |axis: usize, index: usize| index as f64 / pose.counts[axis] as f64;
        for row in pose.rows(clip) {
            let columns = pose.columns(row, clip);
            let ends = [row, row + 1].map(|row| pose.light.place(1, share(1, row)));
            let left_of = |column: usize| {
                let place = pose.light.place(0, share(0, column));
                pose.light.sum(place, ends[1]) - pose.light.sum(place, ends[0])
            };
            let mut left = left_of(columns.start);
            for column in columns {
                let right = left_of(column + 1);
                let light = right - left;
                left = right;
                // Round-off of dark rectangles.
                if light <= 0.0 {
                    continue;
                }
                let [x, y] =
                    pose.at((column as f64 + 0.5) * pose.sides[0], (row as f64 + 0.5) * pose.sides[1]);
                let ((x, here), (y, above)) = (split(x, pose.spread[0]), split(y, pose.spread[1]));
                add(x, y, light * here * above);
                if here < 1.0 {
                    add(x + 1, y, light * (1.0 - here) * above);
                }
                if above < 1.0 {
                    add(x, y + 1, light * here * (1.0 - above));
                    if here < 1.0 {
                        add(x + 1, y + 1, light * (1.0 - here) * (1.0 - above));
                    }
                }
            }
        }
        for (shares, y) in patch.chunks(width).zip(clip.top..) {
            let lit = |share: &f64| *share > 0.0;
            let (Some(first), Some(last)) = (shares.iter().position(lit), shares.iter().rposition(lit))
            else {
                continue;
            };
            let count = last + 1 - first;
            line.clear();
            line.extend(shares[first..=last].iter().map(|&share| share as f32));
            line.resize(count.next_multiple_of(BLOCK), 0.0);
            put(Span { x: clip.left + first as i32, y, count, shares: line, covers: None });
        }
    }
}

#[cfg(test)]
mod tests;
