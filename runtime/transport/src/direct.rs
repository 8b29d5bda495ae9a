//! Light straight from its source: exact transmittance along rays, cell means that conserve energy.
//!
//! The mean over a cell of e^{−τ}/r² is an integral over the solid angle that the cell fills, of the chord that each
//! ray cuts: (1/V) ∫ dΩ ∫ e^{−τ} ds. So rays leave the source, each with its share of the sphere, and every cell on the
//! way gets its chord's light. Nothing is singular at the source, and what the cells absorb plus what leaves the grid is
//! what the source gave. Rays aim at the faces by which light leaves the grid: a cell in between never sees fewer rays
//! than the square of the samples on the face behind it, because it looks larger from the source than that face does.

use crate::cloud::{Boundary, Cloud};
pub use crate::light::Light;
use crate::math::exp_neg;
use crate::phase::PreparedHg;
use glam::DVec3;
use squall_formats::sphere::harmonics;

/// Optical depth after scaling beyond which a ray is given up: e^−30 is below single precision's reach of any sum.
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
    /// A new ray begins.
    fn start(&mut self, direction: DVec3);
    /// ∫ power · e^{−τ} ds along the ray's chord in `cell`, W·m: of light that was never scattered, and of light that
    /// the delta-scaled medium counts as unscattered.
    fn chord(&mut self, cell: usize, unscattered: f32, scaled: f32);
}

/// A cloud prepared for tracing: scaled and unscaled extinction along the same path.
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

    /// Calls `emit` for rays that together carry all of `light` that meets the grid, `samples`² through every cell face
    /// by which light can leave.
    pub fn rays(&self, light: Light, samples: u32, mut emit: impl FnMut(PowerRay)) {
        let cloud = self.cloud;
        let counts = cloud.shape.to_array();
        let periodic = cloud.boundary == Boundary::PeriodicXy;
        if let (true, Light::Point { position, intensity }) = (periodic, light) {
            // Seen from inside a grid without sides, there is no last face: even shares of the sphere instead.
            let count = (counts[0] * counts[1]).max(1024) * (samples * samples) as usize * 4;
            let power = intensity * 4.0 * std::f64::consts::PI / count as f64;
            for i in 0..count {
                emit(PowerRay { origin: position, direction: fibonacci(i, count), power });
            }
            return;
        }
        let pieces = samples as usize;
        for axis in if periodic { 2 } else { 0 }..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let step = [cloud.cell_m[u] / f64::from(samples), cloud.cell_m[v] / f64::from(samples)];
            let (rows, columns) = (counts[v] * pieces, counts[u] * pieces);
            for side in [-1.0, 1.0] {
                let plane = if side < 0.0 { cloud.origin_m[axis] } else { self.far[axis] };
                match light {
                    Light::Point { position, intensity } => {
                        // Light leaves by a face only if the source lies on its inner side.
                        let distance = (plane - position[axis]) * side;
                        if distance <= 0.0 {
                            continue;
                        }
                        // The light's coordinates within the plane are the origin.
                        let edge = |axis: usize, i: usize, step: f64| {
                            cloud.origin_m[axis] + i as f64 * step - position[axis]
                        };
                        let corner = |i, j| corner(edge(u, i, step[0]), edge(v, j, step[1]), distance);
                        let mut below: Vec<f64> = (0..=columns).map(|i| corner(i, 0)).collect();
                        for j in 0..rows {
                            let above: Vec<f64> = (0..=columns).map(|i| corner(i, j + 1)).collect();
                            for i in 0..columns {
                                let solid_angle = above[i + 1] - above[i] - below[i + 1] + below[i];
                                let window = Window {
                                    u: [edge(u, i, step[0]), edge(u, i + 1, step[0])],
                                    v: [edge(v, j, step[1]), edge(v, j + 1, step[1])],
                                    distance,
                                };
                                window.split(solid_angle, 0, &mut |window, solid_angle| {
                                    let mut direction = DVec3::ZERO;
                                    direction[axis] = distance * side;
                                    direction[u] = 0.5 * (window.u[0] + window.u[1]);
                                    direction[v] = 0.5 * (window.v[0] + window.v[1]);
                                    emit(PowerRay {
                                        origin: position,
                                        direction: direction.normalize(),
                                        power: intensity * solid_angle,
                                    });
                                });
                            }
                            below = above;
                        }
                    }
                    Light::Beam { direction, irradiance } => {
                        let through = direction[axis] * side;
                        if through <= 0.0 {
                            continue;
                        }
                        let power = irradiance * through * step[0] * step[1];
                        for j in 0..rows {
                            for i in 0..columns {
                                let mut target = DVec3::ZERO;
                                target[axis] = plane;
                                target[u] = cloud.origin_m[u] + (i as f64 + 0.5) * step[0];
                                target[v] = cloud.origin_m[v] + (j as f64 + 0.5) * step[1];
                                // Back along the beam to before the grid.
                                let height = (self.far - cloud.origin_m).length();
                                let back = if periodic {
                                    (self.far.z - cloud.origin_m.z) / direction.z.abs()
                                } else {
                                    2.0 * height
                                };
                                emit(PowerRay { origin: target - direction * back, direction, power });
                            }
                        }
                    }
                }
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

/// A rectangle in a plane `distance` from a source, with the source's foot as origin.
#[derive(Clone, Copy)]
struct Window {
    u: [f64; 2],
    v: [f64; 2],
    distance: f64,
}

/// Largest share of the sphere that one ray stands for, sr: a face right beside the source fills half the sphere, and a ray
/// through its middle would graze it.
const WIDEST: f64 = 0.02;
/// Halvings of a face at most.
const DEEPEST: u32 = 24;

/// Solid angle of the rectangle between the foot and corner (a, b).
fn corner(a: f64, b: f64, distance: f64) -> f64 {
    libm::atan(a * b / (distance * (a * a + b * b + distance * distance).sqrt()))
}

impl Window {
    fn solid_angle(&self) -> f64 {
        let corner = |i: usize, j: usize| corner(self.u[i], self.v[j], self.distance);
        corner(1, 1) - corner(0, 1) - corner(1, 0) + corner(0, 0)
    }

    /// Calls `emit` for parts of the window none of which looks wide from the source.
    fn split(self, solid_angle: f64, depth: u32, emit: &mut impl FnMut(Window, f64)) {
        if solid_angle <= WIDEST || depth == DEEPEST {
            if solid_angle > 0.0 {
                emit(self, solid_angle);
            }
            return;
        }
        let halves = |range: [f64; 2]| {
            let middle = 0.5 * (range[0] + range[1]);
            [[range[0], middle], [middle, range[1]]]
        };
        for v in halves(self.v) {
            for u in halves(self.u) {
                let part = Window { u, v, ..self };
                part.split(part.solid_angle(), depth + 1, emit);
            }
        }
    }
}

/// Point `index` of `count` on a golden-angle spiral: nearly even shares of the sphere.
pub fn fibonacci(index: usize, count: usize) -> DVec3 {
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    let z = 1.0 - (2.0 * index as f64 + 1.0) / count as f64;
    let (sin, cos) = libm::sincos(GOLDEN_ANGLE * index as f64);
    let rho = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(rho * cos, rho * sin, z)
}

/// Cell sums of direct light: fluence, moments and light scattered towards given directions.
///
/// Values are ∫ … ds summed over rays, W·m; over the cell's volume they are means.
#[derive(Clone, Debug)]
pub struct DirectField<const M: usize> {
    /// Never scattered fluence rate times volume, W·m per cell.
    pub fluence: Vec<f32>,
    /// Harmonic moments ∫ Y_m L dΩ of light unscattered in the scaled medium, times volume, W·m.
    pub moments: Vec<[f32; M]>,
    /// Light scattered once towards each of the given directions, times volume: ∫ p L dΩ, W·m/sr, directions innermost.
    pub towards: Vec<f32>,
    directions: Vec<[f32; 3]>,
    phase: [PreparedHg; 2],
    basis: [f32; M],
    values: [Vec<f32>; 2],
}

impl<const M: usize> DirectField<M> {
    /// An empty field for `cloud`, which also collects light scattered towards `directions`: by the cloud's phase
    /// function where it was never scattered before, and by its convolution with itself (asymmetry g²) where the scaled
    /// medium only counts it as unscattered.
    pub fn new(cloud: &Cloud, directions: &[DVec3]) -> Self {
        let cells = cloud.shape.len();
        Self {
            fluence: vec![0.0; cells],
            moments: vec![[0.0; M]; cells],
            towards: vec![0.0; cells * directions.len()],
            directions: directions.iter().map(|d| d.as_vec3().to_array()).collect(),
            phase: [PreparedHg::new(cloud.g), PreparedHg::new(cloud.g * cloud.g)],
            basis: [0.0; M],
            values: [vec![0.0; directions.len()], vec![0.0; directions.len()]],
        }
    }

    /// Sets all sums to zero.
    pub fn clear(&mut self) {
        self.fluence.fill(0.0);
        self.moments.fill([0.0; M]);
        self.towards.fill(0.0);
    }
}

impl<const M: usize> Tally for DirectField<M> {
    #[inline]
    fn start(&mut self, direction: DVec3) {
        let all = harmonics(direction.to_array());
        self.basis = std::array::from_fn(|m| all[m] as f32);
        let d = direction.as_vec3();
        for (k, to) in self.directions.iter().enumerate() {
            let cos = d.x * to[0] + d.y * to[1] + d.z * to[2];
            self.values[0][k] = self.phase[0].value(cos);
            self.values[1][k] = self.phase[1].value(cos);
        }
    }

    #[inline(always)]
    fn chord(&mut self, cell: usize, unscattered: f32, scaled: f32) {
        self.fluence[cell] += unscattered;
        let moments = &mut self.moments[cell];
        for m in 0..M {
            moments[m] += scaled * self.basis[m];
        }
        let count = self.directions.len();
        if count > 0 {
            let forward = scaled - unscattered;
            let row = &mut self.towards[cell * count..(cell + 1) * count];
            for ((to, narrow), wide) in row.iter_mut().zip(&self.values[0]).zip(&self.values[1]) {
                *to += narrow * unscattered + wide * forward;
            }
        }
    }
}
