//! What bounds a streak: windows and tables at the scale of one kernel, averaged over pixels.

use super::Pose;
use super::edge::{Edge, EdgeTable, LANES};
use super::profile::ProfileRow;
use squall_formats::section::streak::EdgeWindow;

/// What multiplies the cosines at a pixel.
pub(super) trait Weigh {
    /// Weights of [`LANES`] pixels and their slopes across, per pixel. The first pixel's centre is `place`
    /// pixels across and along from the picture's corner, the others are further steps of `step`.
    fn weights(&self, place: [f32; 2], step: [f32; 2]) -> [[f32; LANES]; 2];
}

/// [`EdgeWindow`] at the scale of one streak.
pub(super) struct EdgeFrame<'a> {
    edges: [Edge<'a>; 4],
    /// Chebyshev coefficients of the sides as powers of y, pixels.
    sides: [[f32; 4]; 2],
    /// Coefficients of the ends, pixels.
    ends: [[f32; 3]; 2],
    /// y of a place along: y = place · factor − 1.
    y_per_pixel: f32,
    /// x of a place across: x = (place − middle) · factor.
    x_middle: f32,
    x_per_pixel: f32,
    /// Between these, pixels along, neither end is within its radius.
    inner: [f32; 2],
}

impl<'a> EdgeFrame<'a> {
    pub(super) fn new(table: &'a EdgeTable, window: &EdgeWindow, pose: &Pose) -> Self {
        let [x, y] = pose.along.map(f64::abs);
        let slope = (x.min(y) / x.max(y)) as f32;
        let [width, length] = pose.scale;
        let edge = |index: usize, scale: f64| table.edge(slope, (window.softness[index] * scale) as f32);
        let edges = [edge(0, width), edge(1, width), edge(2, length), edge(3, length)];
        let sides = window
            .sides
            .map(|[c0, c1, c2, c3]| [c0 - c2, c1 - 3.0 * c3, 2.0 * c2, 4.0 * c3].map(|c| (c * width) as f32));
        let ends = window.ends.map(|c| c.map(|c| (c * length) as f32));
        let (left, right) = (window.sides[0][0], window.sides[1][0]);
        let bend = |end: &[f32; 3]| end[1].abs() + end[2].abs();
        let inner =
            [ends[0][0] + bend(&ends[0]) + edges[2].radius, ends[1][0] - bend(&ends[1]) - edges[3].radius];
        Self {
            edges,
            sides,
            ends,
            y_per_pixel: (2.0 / length) as f32,
            x_middle: (0.5 * (left + right) * width) as f32,
            x_per_pixel: (2.0 / ((right - left) * width)) as f32,
            inner,
        }
    }
}

impl EdgeFrame<'_> {
    /// Places of the left and right side, pixels across, `along` pixels along.
    #[inline]
    fn sides_at(&self, along: f32) -> [f32; 2] {
        let y = (along * self.y_per_pixel - 1.0).clamp(-1.0, 1.0);
        self.sides.map(|[a, b, c, d]| a + y * (b + y * (c + y * d)))
    }
}

impl Weigh for EdgeFrame<'_> {
    #[inline]
    fn weights(&self, place: [f32; 2], step: [f32; 2]) -> [[f32; LANES]; 2] {
        let at = |axis: usize| -> [f32; LANES] {
            let (mut places, first, step) = ([0.0; LANES], place[axis], step[axis]);
            for lane in 0..LANES {
                places[lane] = first + step * lane as f32;
            }
            places
        };
        // Along eight pixels of a line, the sides are as good as straight.
        let far = place[1] + step[1] * (LANES - 1) as f32;
        let (near_sides, far_sides) = (self.sides_at(place[1]), self.sides_at(far));
        let across = at(0);
        let mut past = [across; 2];
        for side in 0..2 {
            let gain = (far_sides[side] - near_sides[side]) / (LANES - 1) as f32;
            for lane in 0..LANES {
                past[side][lane] -= near_sides[side] + gain * lane as f32;
            }
        }
        let (left, right) = (self.edges[0].at_all(&past[0]), self.edges[1].at_all(&past[1]));
        let mut weights = [[0.0; LANES]; 2];
        for lane in 0..LANES {
            weights[0][lane] = left[0][lane] - right[0][lane];
            weights[1][lane] = left[1][lane] - right[1][lane];
        }
        if place[1].min(far) > self.inner[0] && place[1].max(far) < self.inner[1] {
            return weights;
        }
        let mut ends = [at(1); 2];
        for lane in 0..LANES {
            let x = ((across[lane] - self.x_middle) * self.x_per_pixel).clamp(-1.0, 1.0);
            for (past, [a, b, c]) in ends.iter_mut().zip(self.ends) {
                past[lane] -= a + x * (b + x * c);
            }
        }
        let (top, bottom) = (self.edges[2].at_all(&ends[0])[0], self.edges[3].at_all(&ends[1])[0]);
        for lane in 0..LANES {
            let ends = top[lane] - bottom[lane];
            weights[0][lane] *= ends;
            weights[1][lane] *= ends;
        }
        weights
    }
}

/// Sums of products of rows.
pub(super) struct ProductFrame<'a> {
    /// Pairs of rows, across and along.
    pub rows: &'a [[ProfileRow; 2]],
}

impl Weigh for ProductFrame<'_> {
    #[inline]
    fn weights(&self, place: [f32; 2], step: [f32; 2]) -> [[f32; LANES]; 2] {
        let mut weights = [[0.0; LANES]; 2];
        for lane in 0..LANES {
            let [across, along] = [0, 1].map(|axis| place[axis] + step[axis] * lane as f32);
            for [a, b] in self.rows {
                let ([here, rise], there) = (a.at(across), b.at(along)[0]);
                weights[0][lane] += here * there;
                weights[1][lane] += rise * there;
            }
        }
        weights
    }
}
