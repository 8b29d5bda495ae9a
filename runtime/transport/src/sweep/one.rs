//! The sweep of a single light: directions side by side in a register, where [`super::sweep`] has lights.
//!
//! All directions of an octant visit the cells in the same order, so they share a register; octants that mirror each
//! other in x go along a row together, from both ends, so that while one waits for its cell the other works.

use super::faces::{CellCoefficients, FaceWeights, Faces, Leak};
use super::span::{Spans, octant_of};
use crate::lanes::{Lanes, SimdKernel};
use crate::quadrature::Ordinate;
use fearless_simd::Simd;
use squall_formats::GridShape;
use squall_formats::sphere::{MAX_HARMONICS, degree_of, harmonics};

/// Two bundles of directions that are each other's mirror image in x.
#[derive(Clone, Debug)]
pub(crate) struct Pair<D> {
    /// Whether light travels towards larger y and z.
    forward: [bool; 2],
    /// Towards larger x, and towards smaller x.
    bundles: [Bundle<D>; 2],
}

#[derive(Clone, Debug)]
struct Bundle<D> {
    /// |Ω|/h along x, y, z, 1/m.
    speed: [D; 3],
    basis: [D; MAX_HARMONICS],
    /// Per lane, the factor of each moment.
    tally: [[f32; MAX_HARMONICS]; 16],
    flow: [D; 3],
}

impl<D: Lanes> Bundle<D> {
    fn new(ordinates: &[Ordinate], cell_m: [f64; 3]) -> Self {
        // Lanes without a direction of their own repeat the first and count nothing.
        let of = |lane: usize| ordinates.get(lane).unwrap_or(&ordinates[0]);
        let weight = |lane: usize| {
            4.0 * std::f64::consts::PI * ordinates.get(lane).map_or(0.0, |ordinate| ordinate.weight)
        };
        let speed = |lane: usize, axis: usize| of(lane).direction[axis].abs();
        Self {
            speed: std::array::from_fn(|axis| D::from_fn(|lane| (speed(lane, axis) / cell_m[axis]) as f32)),
            basis: std::array::from_fn(|m| D::from_fn(|lane| harmonics(of(lane).direction)[m] as f32)),
            tally: std::array::from_fn(|lane| {
                harmonics(of(lane).direction).map(|y| (weight(lane) * y) as f32)
            }),
            flow: std::array::from_fn(|axis| D::from_fn(|lane| (weight(lane) * speed(lane, axis)) as f32)),
        }
    }
}

impl<D> Pair<D> {
    /// Which way the light of both bundles goes.
    fn octants(&self) -> [usize; 2] {
        let [up_y, up_z] = self.forward;
        [octant_of([true, up_y, up_z]), octant_of([false, up_y, up_z])]
    }

    /// Which of the four ways across x.
    pub(crate) fn way(&self) -> usize {
        octant_of([true, self.forward[0], self.forward[1]]) >> 1
    }
}

/// Makes dark what `pairs` visit and what is asked for.
fn clear<D, const O: usize>(spans: &Spans, pairs: &[Pair<D>], nx: usize, result: &mut [[f32; O]]) {
    let mut ways = [false; 4];
    pairs.iter().for_each(|pair| ways[pair.way()] = true);
    for (row, cells) in result.chunks_exact_mut(nx).enumerate() {
        let [mut first, mut end] = spans.wanted(row);
        for way in (0..4).filter(|&way| ways[way]) {
            // Steps are counted from both ends of the row.
            let [from, to] = spans.both([2 * way, 2 * way + 1], row);
            if from < to {
                (first, end) = (first.min(from).min(nx - to), end.max(to).max(nx - from));
            }
        }
        if first < end {
            cells[first..end].fill([0.0; O]);
        }
    }
}

/// Sorts directions into pairs of bundles of at most `D::COUNT`.
pub(crate) fn pairs<D: Lanes>(ordinates: &[Ordinate], cell_m: [f64; 3]) -> Vec<Pair<D>> {
    let mut pairs = Vec::new();
    for (up_y, up_z) in [(true, true), (false, true), (true, false), (false, false)] {
        let belongs = |o: &&Ordinate| (o.direction[1] >= 0.0) == up_y && (o.direction[2] >= 0.0) == up_z;
        let side = |up_x: bool| -> Vec<Ordinate> {
            let mine = |o: &&Ordinate| (o.direction[0] >= 0.0) == up_x;
            ordinates.iter().filter(belongs).filter(mine).copied().collect()
        };
        let (right, left) = (side(true), side(false));
        // Directions across x go with the right-hand side alone, which can then hold more bundles.
        let chunks = right.len().div_ceil(D::COUNT).max(left.len().div_ceil(D::COUNT));
        for chunk in 0..chunks {
            let part = |list: &[Ordinate]| -> Vec<Ordinate> {
                let silent = Ordinate { direction: [1.0, 0.0, 0.0], weight: 0.0 };
                let part: Vec<_> = list.iter().skip(chunk * D::COUNT).take(D::COUNT).copied().collect();
                if part.is_empty() { vec![silent] } else { part }
            };
            pairs.push(Pair {
                forward: [up_y, up_z],
                bundles: [part(&right), part(&left)].map(|list| Bundle::new(&list, cell_m)),
            });
        }
    }
    pairs
}

pub(crate) struct SingleKernel<'a, D, const M: usize, const O: usize> {
    pub shape: GridShape,
    pub pairs: &'a [Pair<D>],
    pub weights: FaceWeights,
    pub face_area: [f64; 3],
    pub cells: &'a CellCoefficients,
    pub root_moments: [f32; 4],
    pub source: &'a [[f32; M]],
    pub result: &'a mut [[f32; O]],
    pub faces: &'a mut Faces<D>,
    pub leak: Option<&'a mut Leak>,
    /// What has to be visited; everything where `None`.
    pub spans: Option<&'a Spans>,
}

impl<D: Lanes, const M: usize, const O: usize> SimdKernel for SingleKernel<'_, D, M, O> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        let [nx, ny, nz] = self.shape.to_array();
        let factors: [f32; M] = std::array::from_fn(|m| self.root_moments[degree_of(m)]);
        let dark = D::splat(0.0);
        match self.spans {
            None => self.result.fill([0.0; O]),
            Some(spans) => clear(spans, self.pairs, nx, self.result),
        }
        for pair in self.pairs {
            let octants = pair.octants();
            let Faces { x: x_faces, y: y_faces, z: z_faces, .. } = &mut *self.faces;
            z_faces.clear();
            z_faces.resize(2 * nx * ny, dark);
            let (z_faces, _) = z_faces.as_chunks_mut::<2>();
            for z_step in 0..nz {
                let z = if pair.forward[1] { z_step } else { nz - 1 - z_step };
                x_faces.clear();
                y_faces.clear();
                y_faces.resize(2 * nx, dark);
                let (y_faces, _) = y_faces.as_chunks_mut::<2>();
                for y_step in 0..ny {
                    let y = if pair.forward[0] { y_step } else { ny - 1 - y_step };
                    let row = self.shape.index(0, y, z);
                    let steps = match self.spans {
                        None => [0, nx],
                        Some(spans) => spans.both(octants, y + ny * z),
                    };
                    let cells = CellRow {
                        extinction: &self.cells.extinction[row..row + nx],
                        root: &self.cells.root_scattering[row..row + nx],
                        source: &self.source[row..row + nx],
                        factors,
                    };
                    let faces = RowFaces { y: &mut y_faces[..nx], z: &mut z_faces[y * nx..(y + 1) * nx] };
                    let result = &mut self.result[row..row + nx];
                    let along_x = cells.sweep(simd, self.weights, (&pair.bundles, steps), faces, result);
                    x_faces.extend(along_x);
                }
                if let Some(leak) = self.leak.as_deref_mut() {
                    let y_side = usize::from(pair.forward[0]);
                    for (side, bundle) in pair.bundles.iter().enumerate() {
                        leak[1 - side][0] += outflow(x_faces, side, bundle.flow[0]) * self.face_area[0];
                        leak[2 + y_side][0] +=
                            outflow(y_faces.as_flattened(), side, bundle.flow[1]) * self.face_area[1];
                    }
                }
            }
            if let Some(leak) = self.leak.as_deref_mut() {
                for (side, bundle) in pair.bundles.iter().enumerate() {
                    leak[4 + usize::from(pair.forward[1])][0] +=
                        outflow(z_faces.as_flattened(), side, bundle.flow[2]) * self.face_area[2];
                }
            }
        }
    }
}

/// One row of cells along x.
struct CellRow<'a, const M: usize> {
    extinction: &'a [f32],
    /// √ of the scattering coefficient.
    root: &'a [f32],
    source: &'a [[f32; M]],
    /// Factor of each source moment.
    factors: [f32; M],
}

/// Light on the row's faces across y and z.
struct RowFaces<'a, D> {
    y: &'a mut [[D; 2]],
    z: &'a mut [[D; 2]],
}

impl<const M: usize> CellRow<'_, M> {
    /// Sweeps these steps of the row from both ends; returns what leaves it by them.
    #[inline(always)]
    fn sweep<S: Simd, D: Lanes, const O: usize>(
        &self,
        simd: S,
        weights: FaceWeights,
        (bundles, [first, end]): (&[Bundle<D>; 2], [usize; 2]),
        faces: RowFaces<'_, D>,
        result: &mut [[f32; O]],
    ) -> [D; 2] {
        let FaceWeights { thickness, stiffness, tiny } = weights;
        let Self { extinction, root, source, factors } = *self;
        let RowFaces { y: y_faces, z: z_faces } = faces;
        let nx = extinction.len();
        // Said once here, so that no index below is checked again.
        let (root, source, result) = (&root[..nx], &source[..nx], &mut result[..nx]);
        let (y_faces, z_faces) = (&mut y_faces[..nx], &mut z_faces[..nx]);
        let dark = D::splat(0.0).load(simd);
        let mut along_x = [dark; 2];
        // A − 1 and A s for the three axes, and the inverse that follows: four divisions, which the parts of one cell of a
        // refined grid share.
        let (mut keep, mut coupling) = ([[dark; 3]; 2], [[dark; 3]; 2]);
        let (mut inverse, mut prepared) = ([dark; 2], [f32::NAN; 2]);
        for step in first..end.min(nx) {
            let at = [step, nx - 1 - step];
            for side in 0..2 {
                let (x, bundle) = (at[side], &bundles[side]);
                let from = |m: usize| source[x][m] * (root[x] * factors[m]);
                let mut q = bundle.basis[0].load(simd) * from(0);
                for m in 1..M {
                    q = q + bundle.basis[m].load(simd) * from(m);
                }
                if extinction[x] != prepared[side] {
                    let thick = D::splat(thickness * extinction[x] + tiny).load(simd);
                    let mut sum = D::splat(extinction[x]).load(simd);
                    for axis in 0..3 {
                        let speed = bundle.speed[axis].load(simd);
                        let stiff = speed * stiffness;
                        keep[side][axis] = stiff * D::reciprocal(simd, thick + stiff);
                        coupling[side][axis] = speed + speed * keep[side][axis];
                        sum = sum + coupling[side][axis];
                    }
                    inverse[side] = D::reciprocal(simd, sum);
                    prepared[side] = extinction[x];
                }
                let (keep, coupling, inverse) = (&keep[side], &coupling[side], inverse[side]);
                let along_y = y_faces[x][side].load(simd);
                let along_z = z_faces[x][side].load(simd);
                let q = q + along_y * coupling[1] + along_z * coupling[2];
                let psi = (q + along_x[side] * coupling[0]) * inverse;
                let made = inverse + inverse * keep[0];
                along_x[side] = q * made + along_x[side] * (made * coupling[0] - keep[0]);
                y_faces[x][side] = D::store(psi + (psi - along_y) * keep[1]);
                z_faces[x][side] = D::store(psi + (psi - along_z) * keep[2]);
                let psi = D::store(psi);
                let mut sums = result[x];
                for lane in 0..D::COUNT {
                    for m in 0..O {
                        sums[m] += psi.lane(lane) * bundle.tally[lane][m];
                    }
                }
                result[x] = sums;
            }
        }
        [D::store(along_x[0]), D::store(along_x[1])]
    }
}

/// Flow through faces that two bundles share in turns.
fn outflow<D: Lanes>(faces: &[D], side: usize, flow: D) -> f64 {
    let face = |face: &D| -> f64 {
        (0..D::COUNT).map(|lane| f64::from(face.lane(lane)) * f64::from(flow.lane(lane))).sum()
    };
    faces.iter().skip(side).step_by(2).map(face).sum()
}
