//! Light straight from its source: exact transmittance along rays, cell means that conserve energy.
//!
//! The mean over a cell of e^{−τ}/r² is an integral over the solid angle that the cell fills, of the chord that each
//! ray cuts: (1/V) ∫ dΩ ∫ e^{−τ} ds. So rays leave the source, each with its share of the sphere, and every cell on the
//! way gets its chord's light. Nothing is singular at the source, and what the cells absorb plus what leaves the grid is
//! what the source gave. Rays aim at the faces by which light leaves the grid: a cell in between never sees fewer rays
//! than the square of the samples on the face behind it, because it looks larger from the source than that face does.

mod field;
mod rays;
mod skip;
mod steps;

use crate::cloud::{Boundary, Cloud};
pub use crate::light::Light;
use crate::math::exp_neg;
pub use field::{DirectField, DirectMoments};
use glam::DVec3;
pub use rays::fibonacci;
pub use skip::NearCloud;
pub use steps::distances;

/// Optical depth after scaling beyond which a ray is given up: e^−30 is lost in any sum in single precision.
const DARK: f32 = 30.0;
/// Path through a periodic grid, in grid widths, beyond which a ray is given up.
const MAX_WIDTHS: f64 = 4096.0;

/// A ray that carries a share of a source's power.
#[derive(Clone, Copy, Debug)]
pub struct PowerRay {
    /// Where the ray starts, m.
    pub origin: DVec3,
    /// Unit direction of travel.
    pub direction: DVec3,
    /// Power, W.
    pub power: f64,
}

/// Receives what rays leave in cells.
pub trait Tally {
    /// Whether light that was never scattered is asked for; what is handed over is 0 where it isn't and the tracer has a choice.
    const UNSCATTERED: bool = true;
    /// A new ray begins.
    fn start(&mut self, direction: DVec3);
    /// ∫ power · e^{−τ} ds along the ray's chord in `cell`, W·m: of light that was never scattered, and of light that
    /// the delta-scaled medium counts as unscattered.
    fn chord(&mut self, cell: usize, unscattered: f32, scaled: f32);
}

/// A cloud prepared for tracing: scaled and unscaled extinction along the same path.
///
/// ```
/// use glam::DVec3;
/// use squall_formats::GridShape;
/// use squall_transport::direct::{DirectField, PowerRay, Tracer};
/// use squall_transport::{Boundary, Cloud};
///
/// // 50 m of cloud along x, 0.02 a metre: an optical depth of 1.
/// let cloud = Cloud {
///     shape: GridShape::new(5, 1, 1),
///     cell_m: [10.0; 3],
///     origin_m: DVec3::ZERO,
///     extinction: vec![0.02; 5],
///     albedo: 1.0,
///     g: 0.0,
///     boundary: Boundary::Open,
/// };
/// let tracer = Tracer::new(&cloud, 1.0);
/// let mut field = DirectField::<4>::new(&cloud, &[]);
/// let ray = PowerRay { origin: DVec3::new(-7.0, 5.0, 5.0), direction: DVec3::X, power: 3.0 };
/// let (left, _) = tracer.trace(ray, &mut field);
/// // Beer and Lambert; and what does not leave is taken out in the cells.
/// assert!((left - 3.0 * libm::exp(-1.0)).abs() < 1e-6);
/// let taken: f32 = field.fluence.iter().map(|fluence| 0.02 * fluence).sum();
/// assert!((f64::from(taken) - (3.0 - left)).abs() < 1e-6);
/// // In the second cell, of light that was never scattered: the integral of e^-τ over its 10 m.
/// let exact = 3.0 * (libm::exp(-0.2) - libm::exp(-0.4)) / 0.02;
/// assert!((f64::from(field.fluence[1]) - exact).abs() < 1e-4);
/// ```
#[derive(Clone, Copy)]
pub struct Tracer<'a> {
    cloud: &'a Cloud,
    scale: f32,
    far: DVec3,
}

impl<'a> Tracer<'a> {
    /// For a cloud whose delta-scaled extinction is `extinction_scale` times its own.
    pub fn new(cloud: &'a Cloud, extinction_scale: f64) -> Self {
        Self { cloud, scale: extinction_scale as f32, far: cloud.far_corner() }
    }

    /// Where a ray enters and leaves the grid, in metres from its origin; `None` if it misses.
    pub fn span(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        let (mut near, mut far) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            if axis < 2 && self.cloud.boundary == Boundary::PeriodicXy {
                continue;
            }
            let (low, high) = (self.cloud.origin_m[axis] - origin[axis], self.far[axis] - origin[axis]);
            if direction[axis] == 0.0 {
                if low > 0.0 || high < 0.0 {
                    return None;
                }
                continue;
            }
            let (a, b) = (low / direction[axis], high / direction[axis]);
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        (near < far).then_some((near, far))
    }

    /// Follows a ray through the grid and returns the power that leaves it: never scattered, and scaled.
    #[inline]
    pub fn trace<T: Tally>(&self, ray: PowerRay, tally: &mut T) -> (f64, f64) {
        let Some((start, stop)) = self.span(ray.origin, ray.direction) else {
            return (ray.power, ray.power);
        };
        tally.start(ray.direction);
        let (power, scale) = (ray.power as f32, self.scale);
        let (mut open, mut scaled) = (1.0f32, 1.0f32);
        self.walk(ray.origin, ray.direction, start, stop, |cell, length, extinction| {
            let depth = extinction * length;
            let (open_sum, scaled_sum);
            (open_sum, open) = chord(open, depth, extinction, length);
            // Where nearly all scattering is forward the scaled depth is small in cells that are deep: its own branch.
            (scaled_sum, scaled) = chord(scaled, scale * depth, scale * extinction, length);
            tally.chord(cell, power * open_sum, power * scaled_sum);
            scaled > 1e-13
        });
        (ray.power * f64::from(open), ray.power * f64::from(scaled))
    }

    /// Optical depth (unscaled) between two points, piecewise constant extinction, zero outside the grid.
    pub fn optical_depth(&self, from: DVec3, to: DVec3) -> f32 {
        let offset = to - from;
        let distance = offset.length();
        if distance == 0.0 {
            return 0.0;
        }
        let direction = offset / distance;
        let Some((start, stop)) = self.span(from, direction) else { return 0.0 };
        let mut depth = 0.0f32;
        self.walk(from, direction, start, stop.min(distance), |_, length, extinction| {
            depth += extinction * length;
            depth * self.scale < DARK
        });
        depth
    }

    /// Calls `visit(cell, length, extinction)` for each cell on the ray between distances `start` and `stop`, in order,
    /// until it returns false.
    #[inline(always)]
    pub fn walk(
        &self,
        origin: DVec3,
        direction: DVec3,
        start: f64,
        stop: f64,
        mut visit: impl FnMut(usize, f32, f32) -> bool,
    ) {
        let shape = self.cloud.shape;
        let counts = shape.to_array();
        let periodic = self.cloud.boundary == Boundary::PeriodicXy;
        let strides = [1isize, shape.row_stride() as isize, shape.slab_stride() as isize];
        let mut index = 0isize;
        let mut next = [f64::INFINITY; 3];
        let mut delta = [f64::INFINITY; 3];
        let mut hop = [0isize; 3];
        // Cells left to the grid's side, along each axis.
        let mut left = [0usize; 3];
        for axis in 0..3 {
            let edge = self.cloud.cell_m[axis];
            let at = (origin[axis] + direction[axis] * start - self.cloud.origin_m[axis]) / edge;
            let forward = direction[axis] >= 0.0;
            let mut cell = at.floor() as i64;
            // A start exactly on a face belongs to the cell that the ray goes into.
            if !forward && at == at.floor() {
                cell -= 1;
            }
            if !(periodic && axis < 2) {
                cell = cell.clamp(0, counts[axis] as i64 - 1);
            }
            if direction[axis] != 0.0 {
                let face = self.cloud.origin_m[axis] + edge * (cell + i64::from(forward)) as f64;
                next[axis] = (face - origin[axis]) / direction[axis];
                delta[axis] = edge / direction[axis].abs();
            }
            let cell = cell.rem_euclid(counts[axis] as i64) as usize;
            index += cell as isize * strides[axis];
            hop[axis] = if forward { strides[axis] } else { -strides[axis] };
            left[axis] = if forward { counts[axis] - cell } else { cell + 1 };
        }
        let mut at = start;
        loop {
            let axis = if next[0] <= next[1] {
                if next[0] <= next[2] { 0 } else { 2 }
            } else if next[1] <= next[2] {
                1
            } else {
                2
            };
            let to = next[axis].min(stop);
            let length = (to - at) as f32;
            if length > 0.0 {
                let cell = index as usize;
                if !visit(cell, length, self.cloud.extinction[cell]) {
                    return;
                }
                at = to;
            }
            if to >= stop {
                return;
            }
            next[axis] += delta[axis];
            index += hop[axis];
            left[axis] -= 1;
            if left[axis] == 0 {
                let width = self.cloud.cell_m[0] * counts[0] as f64 + self.cloud.cell_m[1] * counts[1] as f64;
                if !(periodic && axis < 2) || at > start + MAX_WIDTHS * width {
                    return;
                }
                left[axis] = counts[axis];
                index -= hop[axis] * counts[axis] as isize;
            }
        }
    }
}

/// ∫ e^{−τ} ds along a chord of optical depth `depth` on which a share `share` of the light arrives, and the share that leaves.
#[inline(always)]
fn chord(share: f32, depth: f32, extinction: f32, length: f32) -> (f32, f32) {
    if depth > 0.02 {
        let left = share * exp_neg(depth);
        ((share - left) / extinction, left)
    } else {
        // (1 − e^−x)/x by its series: the difference above would lose its digits.
        let mean = 1.0 - depth * (0.5 - depth * (1.0 / 6.0 - depth / 24.0));
        let left = 1.0 - depth * (1.0 - depth * (0.5 - depth / 6.0));
        (share * length * mean, share * left)
    }
}
