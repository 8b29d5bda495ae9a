//! One pass of streaming through the grid: given the source in every cell, the light that leaves it in every
//! direction of the set, summed into moments.
//!
//! | symbol | name | unit |
//! | σ | `extinction`, after delta scaling | 1/m |
//! | ψ | angular flux in a direction, cell mean | W/(m² sr) per unit source |
//! | s | |Ω|/h along an axis | 1/m |
//! | A | face weight: ψ_out = A ψ − (A − 1) ψ_in | – |
//!
//! Balance in a cell, for direction Ω: Σ_axis s (ψ_out − ψ_in) + σψ = q. With A = 2 that is the diamond scheme (second
//! order; thick cells turn negative), with A = 1 the step scheme (first order, never negative). The weighted scheme takes
//! A = (σ + 6s)/(σ + 3s) for each cell and axis, which follows the exact ratio of a cell's outgoing to its mean flux to
//! second order in thin cells and goes to 1 in thick ones. Whatever A, what leaves a cell enters the next, so that energy
//! is conserved to round-off; and a source in cell i makes in cell j along Ω what one in j makes in i along −Ω, because
//! every face crossed counts A_i s A_j from either side: the operator is reciprocal, which [`super::solve`] relies on.

mod faces;
mod one;
mod parts;
mod span;

use crate::cloud::{Boundary, Cloud};
use crate::error::ArgumentError;
use crate::lanes::{F32x4, F32x8, F32x16, Lanes, SimdKernel, SimdLevel, run};
use crate::quadrature::{Ordinate, Quadrature};
pub use faces::{CellCoefficients, Leak};
use faces::{FaceWeights, Faces};
use fearless_simd::Simd;
use one::{Pair, SingleKernel, pairs};
pub use parts::SweepParts;
use span::{Spans, octant_of};
use squall_formats::GridShape;
use squall_formats::section::response::SweepScheme;
use squall_formats::sphere::{MAX_HARMONICS, degree_of, harmonics};

/// Directions of one octant that the kernel holds in registers together.
const GROUP: usize = 4;
/// Most passes around a periodic plane. Light that runs almost along a thin plane goes round very often; what does not settle
/// even so is missing from the energy balance.
const MAX_WRAPS: usize = 1024;
/// Change of a light's periodic inflow, relative to its largest value, that counts as settled.
const WRAP_TOLERANCE: f32 = 1e-6;

/// One direction of a group, with everything that does not depend on the cell.
#[derive(Clone, Copy, Debug, Default)]
struct Beam {
    /// |Ω|/h along x, y, z, 1/m.
    speed: [f32; 3],
    /// Harmonics in this direction.
    basis: [f32; MAX_HARMONICS],
    /// Harmonics times 4π times the direction's share of the sphere.
    tally: [f32; MAX_HARMONICS],
    /// 4π × share × |Ω| along x, y, z: what a unit of ψ carries through a unit of face.
    flow: [f64; 3],
}

/// Up to [`GROUP`] directions that travel through the grid in the same order.
#[derive(Clone, Debug)]
struct Group {
    /// Whether light travels towards larger x, y, z.
    forward: [bool; 3],
    beams: Vec<Beam>,
}

/// Sweeps for one grid, direction set and scheme.
#[derive(Clone, Debug)]
pub struct Sweeper {
    shape: GridShape,
    boundary: Boundary,
    groups: Vec<Group>,
    bundles: Bundles,
    weights: FaceWeights,
    face_area: [f64; 3],
    level: SimdLevel,
    /// What sweeps visit; everything where `None`.
    spans: Option<Spans>,
}

/// Buffers of a sweep, kept between calls so that nothing is allocated per sweep.
#[derive(Clone, Debug, Default)]
pub struct SweepBuffers<P> {
    lights: Faces<P>,
    four: Faces<F32x4>,
    eight: Faces<F32x8>,
    sixteen: Faces<F32x16>,
}

/// Directions of a single light's sweep, in registers as wide as the fullest octant needs.
#[derive(Clone, Debug)]
enum Bundles {
    Four(Vec<Pair<F32x4>>),
    Eight(Vec<Pair<F32x8>>),
    Sixteen(Vec<Pair<F32x16>>),
}

/// What a sweep starts from: with k = `root_moments[degree]` a cell's source in direction Ω is
/// q = √σ_s Σ_m k Y_m(Ω) source_m, which is how the symmetric solver keeps its vectors.
#[derive(Clone, Copy, Debug)]
pub struct Emission<'a, P, const M: usize> {
    /// The medium, one entry a cell.
    pub cells: &'a CellCoefficients,
    /// Root of each degree's share of light that is scattered.
    pub root_moments: [f32; 4],
    /// `M` values a cell and lane, x fastest.
    pub source: &'a [[P; M]],
}

impl Sweeper {
    /// Plans sweeps through `cloud`'s grid. Errors: a direction set outside its range.
    pub fn new(
        cloud: &Cloud,
        set: Quadrature,
        scheme: SweepScheme,
        level: SimdLevel,
    ) -> Result<Self, ArgumentError> {
        let mut groups = Vec::new();
        let ordinates = set.ordinates()?;
        for octant in 0..8 {
            let forward = [octant & 1 == 0, octant & 2 == 0, octant & 4 == 0];
            // A component of zero goes with the forward octants: it carries nothing either way.
            let belongs = |o: &&Ordinate| (0..3).all(|axis| (o.direction[axis] >= 0.0) == forward[axis]);
            let beams: Vec<Beam> =
                ordinates.iter().filter(belongs).map(|o| Beam::new(o, cloud.cell_m)).collect();
            groups.extend(beams.chunks(GROUP).map(|beams| Group { forward, beams: beams.to_vec() }));
        }
        let fullest = (0..8)
            .map(|octant| {
                let bit = |axis: usize| octant >> axis & 1 == 0;
                ordinates
                    .iter()
                    .filter(|o| (0..3).all(|axis| (o.direction[axis] >= 0.0) == bit(axis)))
                    .count()
            })
            .max();
        let bundles = match fullest.unwrap_or(0) {
            0..=4 => Bundles::Four(pairs(&ordinates, cloud.cell_m)),
            5..=8 => Bundles::Eight(pairs(&ordinates, cloud.cell_m)),
            _ => Bundles::Sixteen(pairs(&ordinates, cloud.cell_m)),
        };
        let [hx, hy, hz] = cloud.cell_m;
        Ok(Self {
            bundles,
            shape: cloud.shape,
            boundary: cloud.boundary,
            groups,
            weights: FaceWeights::new(scheme),
            face_area: [hy * hz, hx * hz, hx * hy],
            level,
            spans: None,
        })
    }

    /// The same sweeps where only the cells `wanted` are read, one a cell of `cloud`, whose sweeps they are: empty cells that no light on
    /// its way to one of those crosses are left out and stay dark. In wanted cells the same bytes come out. A grid that repeats, and a
    /// sweep that tallies what leaves, is swept whole.
    ///
    /// Panics when `wanted` is not one grid long.
    #[must_use]
    pub fn read_in(mut self, cloud: &Cloud, wanted: &[bool]) -> Self {
        assert!(wanted.len() == self.shape.len() && cloud.shape == self.shape);
        self.spans = (self.boundary == Boundary::Open).then(|| Spans::new(cloud, wanted));
        self
    }

    /// Share of all cells that a sweep visits, over all directions, 0 to 1.
    pub fn share_visited(&self) -> f64 {
        self.spans.as_ref().map_or(1.0, |spans| spans.share(self.shape))
    }

    /// Moments of the angular flux that the sources make.
    ///
    /// `result` gets `O` moments ∫ Y_m ψ dΩ a cell and lane, overwritten. `leak`, if given, is added to: light leaving
    /// the grid, watts.
    ///
    /// Panics when an array is not one grid long.
    pub fn run<P: Lanes, const M: usize, const O: usize>(
        &self,
        emission: Emission<'_, P, M>,
        result: &mut [[P; O]],
        buffers: &mut SweepBuffers<P>,
        leak: Option<&mut Leak>,
    ) {
        let Emission { cells, root_moments, source } = emission;
        let count = self.shape.len();
        assert!(source.len() == count && result.len() == count && cells.extinction.len() == count);
        if P::COUNT == 1 && self.boundary == Boundary::Open {
            let emission = Emission { cells, root_moments, source: bytemuck::cast_slice(source) };
            let result = bytemuck::cast_slice_mut(result);
            let SweepBuffers { four, eight, sixteen, .. } = buffers;
            match &self.bundles {
                Bundles::Four(pairs) => self.single::<_, M, O>(pairs, emission, result, four, leak),
                Bundles::Eight(pairs) => self.single::<_, M, O>(pairs, emission, result, eight, leak),
                Bundles::Sixteen(pairs) => self.single::<_, M, O>(pairs, emission, result, sixteen, leak),
            }
            return;
        }
        let buffers = &mut buffers.lights;
        let spans = if leak.is_some() { None } else { self.spans.as_ref() };
        let kernel = SweepKernel { sweeper: self, cells, root_moments, source, result, buffers, leak, spans };
        run(self.level, kernel);
    }

    fn single<D: Lanes, const M: usize, const O: usize>(
        &self,
        pairs: &[Pair<D>],
        emission: Emission<'_, f32, M>,
        result: &mut [[f32; O]],
        faces: &mut Faces<D>,
        leak: Option<&mut Leak>,
    ) {
        let Emission { cells, root_moments, source } = emission;
        let kernel = SingleKernel {
            shape: self.shape,
            pairs,
            weights: self.weights,
            face_area: self.face_area,
            cells,
            root_moments,
            source,
            result,
            faces,
            spans: if leak.is_some() { None } else { self.spans.as_ref() },
            leak,
        };
        run(self.level, kernel);
    }
}

impl Beam {
    fn new(ordinate: &Ordinate, cell_m: [f64; 3]) -> Self {
        let sphere = 4.0 * std::f64::consts::PI * ordinate.weight;
        let basis = harmonics(ordinate.direction);
        let speed = ordinate.direction.map(f64::abs);
        Self {
            speed: std::array::from_fn(|axis| (speed[axis] / cell_m[axis]) as f32),
            basis: basis.map(|y| y as f32),
            tally: basis.map(|y| (sphere * y) as f32),
            flow: speed.map(|s| sphere * s),
        }
    }
}

struct SweepKernel<'a, P, const M: usize, const O: usize> {
    sweeper: &'a Sweeper,
    cells: &'a CellCoefficients,
    root_moments: [f32; 4],
    source: &'a [[P; M]],
    result: &'a mut [[P; O]],
    buffers: &'a mut Faces<P>,
    leak: Option<&'a mut Leak>,
    spans: Option<&'a Spans>,
}

/// The constants of one group, gathered for the inner loop.
struct Plane<'a, P, const M: usize> {
    sweeper: &'a Sweeper,
    cells: &'a CellCoefficients,
    source: &'a [[P; M]],
    /// Factor of each source moment.
    factors: [f32; M],
    group: &'a Group,
    z: usize,
    /// Where this group's faces across z begin.
    start: usize,
    /// What has to be visited; everything where `None`.
    spans: Option<&'a Spans>,
}

impl<P: Lanes, const M: usize, const O: usize> SimdKernel for SweepKernel<'_, P, M, O> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        let [nx, ny, nz] = self.sweeper.shape.to_array();
        let dark = P::splat(0.0);
        self.result.fill([dark; O]);
        let factors = std::array::from_fn(|m| self.root_moments[degree_of(m)]);
        // Light going up and light going down in turn, and all that goes the same way plane by plane: the plane's
        // sources and results then stay in the cache for all of them.
        for up in [true, false] {
            let groups = || self.sweeper.groups.iter().filter(|group| group.forward[2] == up);
            let total: usize = groups().map(|group| group.beams.len()).sum();
            reset(&mut self.buffers.z, nx * ny * total, dark);
            for step in 0..nz {
                let z = if up { step } else { nz - 1 - step };
                let mut start = 0;
                for group in groups() {
                    let width = group.beams.len();
                    let plane = Plane {
                        sweeper: self.sweeper,
                        cells: self.cells,
                        source: self.source,
                        factors,
                        group,
                        z,
                        start,
                        spans: self.spans,
                    };
                    start += nx * ny * width;
                    reset(&mut self.buffers.x, ny * width, dark);
                    reset(&mut self.buffers.y, nx * width, dark);
                    match self.sweeper.boundary {
                        Boundary::Open => {
                            plane.sweep::<S, O, true>(simd, self.buffers, self.result);
                            if let Some(leak) = self.leak.as_deref_mut() {
                                self.sweeper.tally_leak(group, 0, &self.buffers.x, leak);
                                self.sweeper.tally_leak(group, 1, &self.buffers.y, leak);
                            }
                        }
                        Boundary::PeriodicXy => plane.settle(simd, self.buffers, self.result),
                    }
                }
            }
            if let Some(leak) = self.leak.as_deref_mut() {
                let mut start = 0;
                for group in groups() {
                    let count = nx * ny * group.beams.len();
                    self.sweeper.tally_leak(group, 2, &self.buffers.z[start..start + count], leak);
                    start += count;
                }
            }
        }
    }
}

fn reset<P: Copy>(faces: &mut Vec<P>, count: usize, value: P) {
    faces.clear();
    faces.resize(count, value);
}

impl<P: Lanes, const M: usize> Plane<'_, P, M> {
    /// A plane whose sides are joined: repeats the plane until what enters equals what leaves, then tallies.
    ///
    /// Every light settles on its own and then keeps its inflow.
    #[inline(always)]
    fn settle<S: Simd, const O: usize>(&self, simd: S, buffers: &mut Faces<P>, result: &mut [[P; O]]) {
        let faces = self.start..self.start + self.sweeper.shape.slab_stride() * self.group.beams.len();
        let entering = buffers.z[faces.clone()].to_vec();
        let mut settled = [false; 16];
        for _ in 0..MAX_WRAPS {
            buffers.inflow.clear();
            buffers.inflow.extend_from_slice(&buffers.x);
            buffers.inflow.extend_from_slice(&buffers.y);
            self.sweep::<S, O, false>(simd, buffers, result);
            buffers.z[faces.clone()].copy_from_slice(&entering);
            let (mut change, mut largest) = ([0.0f32; 16], [0.0f32; 16]);
            for (old, new) in buffers.inflow.iter().zip(buffers.x.iter().chain(&buffers.y)) {
                for lane in 0..P::COUNT {
                    change[lane] = change[lane].max((new.lane(lane) - old.lane(lane)).abs());
                    largest[lane] = largest[lane].max(new.lane(lane).abs());
                }
            }
            let leaving = buffers.x.iter_mut().chain(&mut buffers.y);
            for (old, new) in buffers.inflow.iter().zip(leaving) {
                for lane in (0..P::COUNT).filter(|&lane| settled[lane]) {
                    new.set_lane(lane, old.lane(lane));
                }
            }
            for lane in 0..P::COUNT {
                settled[lane] |= change[lane] <= WRAP_TOLERANCE * largest[lane];
            }
            if settled[..P::COUNT].iter().all(|&done| done) {
                break;
            }
        }
        self.sweep::<S, O, true>(simd, buffers, result);
    }

    /// Sweeps one plane of cells; with `TALLY` the moments go into `result`.
    #[inline(always)]
    fn sweep<S: Simd, const O: usize, const TALLY: bool>(
        &self,
        simd: S,
        buffers: &mut Faces<P>,
        result: &mut [[P; O]],
    ) {
        match self.group.beams.len() {
            1 => self.sweep_width::<S, O, 1, TALLY>(simd, buffers, result),
            2 => self.sweep_width::<S, O, 2, TALLY>(simd, buffers, result),
            3 => self.sweep_width::<S, O, 3, TALLY>(simd, buffers, result),
            _ => self.sweep_width::<S, O, GROUP, TALLY>(simd, buffers, result),
        }
    }

    #[inline(always)]
    fn sweep_width<S: Simd, const O: usize, const W: usize, const TALLY: bool>(
        &self,
        simd: S,
        buffers: &mut Faces<P>,
        result: &mut [[P; O]],
    ) {
        let [nx, ny, _] = self.sweeper.shape.to_array();
        let forward = self.group.forward;
        let octant = octant_of(forward);
        let FaceWeights { thickness, stiffness, tiny } = self.sweeper.weights;
        let Ok(beams) = <&[Beam; W]>::try_from(&self.group.beams[..]) else { return };
        let (x_faces, _) = buffers.x.as_chunks_mut::<W>();
        let (y_faces, _) = buffers.y.as_chunks_mut::<W>();
        let (z_faces, _) = buffers.z[self.start..].as_chunks_mut::<W>();
        let none = P::splat(0.0).load(simd);
        for y_step in 0..ny {
            let y = if forward[1] { y_step } else { ny - 1 - y_step };
            let [first, end] = match self.spans {
                None => [0, nx],
                Some(spans) => spans.stretch(octant, y + ny * self.z),
            };
            // Loops, not closures: only what is inlined for sure is compiled for the wide registers.
            let mut along_x = [none; W];
            for b in 0..W {
                along_x[b] = x_faces[y][b].load(simd);
            }
            let row = self.sweeper.shape.index(0, y, self.z);
            let extinction = &self.cells.extinction[row..row + nx];
            let root = &self.cells.root_scattering[row..row + nx];
            let source = &self.source[row..row + nx];
            let result = &mut result[row..row + nx];
            let y_faces = &mut y_faces[..nx];
            let z_faces = &mut z_faces[y * nx..(y + 1) * nx];
            for x_step in first..end.min(nx) {
                let x = if forward[0] { x_step } else { nx - 1 - x_step };
                let (y_face, z_face) = (&mut y_faces[x], &mut z_faces[x]);
                let (mut from, mut sums) = ([none; M], [none; O]);
                for m in 0..M {
                    from[m] = source[x][m].load(simd) * (root[x] * self.factors[m]);
                }
                for m in 0..O {
                    sums[m] = result[x][m].load(simd);
                }
                for b in 0..W {
                    let beam = &beams[b];
                    let mut q = from[0] * beam.basis[0];
                    for m in 1..M {
                        q = q + from[m] * beam.basis[m];
                    }
                    // A − 1 and A s for the three axes; the same for all lanes.
                    let thick = thickness * extinction[x] + tiny;
                    let (mut keep, mut coupling) = ([0.0f32; 3], [0.0f32; 3]);
                    for axis in 0..3 {
                        let stiff = stiffness * beam.speed[axis];
                        keep[axis] = stiff / (thick + stiff);
                        coupling[axis] = beam.speed[axis] * (1.0 + keep[axis]);
                    }
                    let (along_y, along_z) = (y_face[b].load(simd), z_face[b].load(simd));
                    let q = q + along_y * coupling[1] + along_z * coupling[2];
                    // Along x each cell waits for the one before: two operations of that chain, not five.
                    let inverse = 1.0 / (extinction[x] + coupling[0] + coupling[1] + coupling[2]);
                    let psi = (q + along_x[b] * coupling[0]) * inverse;
                    let made = (1.0 + keep[0]) * inverse;
                    along_x[b] = q * made + along_x[b] * (made * coupling[0] - keep[0]);
                    y_face[b] = P::store(psi * (1.0 + keep[1]) - along_y * keep[1]);
                    z_face[b] = P::store(psi * (1.0 + keep[2]) - along_z * keep[2]);
                    if TALLY {
                        for m in 0..O {
                            sums[m] = sums[m] + psi * beam.tally[m];
                        }
                    }
                }
                if TALLY {
                    for m in 0..O {
                        result[x][m] = P::store(sums[m]);
                    }
                }
            }
            for b in 0..W {
                x_faces[y][b] = P::store(along_x[b]);
            }
        }
    }
}

impl Sweeper {
    /// Adds what the faces of one axis carry out of the grid.
    fn tally_leak<P: Lanes>(&self, group: &Group, axis: usize, faces: &[P], leak: &mut Leak) {
        let side = 2 * axis + usize::from(group.forward[axis]);
        let width = group.beams.len();
        for lane in 0..P::COUNT {
            let mut sum = 0.0;
            for face in faces.chunks_exact(width) {
                for (value, beam) in face.iter().zip(&group.beams) {
                    sum += f64::from(value.lane(lane)) * beam.flow[axis];
                }
            }
            leak[side][lane] += sum * self.face_area[axis];
        }
    }
}
