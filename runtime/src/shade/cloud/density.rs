//! Where a march reads density: cell by cell, as the solver saw it, or between cell centres with billows, as a picture shows it.

use super::lookup::CellCubes;
use crate::camera::Ray;
use crate::shade::detail::{Detail, ceilings};
use crate::transport::Cloud;
use crate::transport::direct::Tracer;
use crate::transport::direct::distances;

/// A stretch of a ray along which density is even.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// Where it begins, m from the ray's origin.
    pub start: f64,
    /// Its length, m.
    pub length: f64,
    /// Extinction, 1/m.
    pub extinction: f64,
}

/// A cloud's density along rays.
pub trait Density {
    /// Calls `visit` for each stretch of `ray` that is in cloud, nearest first, until it returns false.
    fn stretches(&self, cloud: &Cloud, ray: &Ray, visit: impl FnMut(Stretch) -> bool);
}

/// Extinction of the cell that a place is in. A measurement with it sees what the solver saw.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cells;

impl Density for Cells {
    fn stretches(&self, cloud: &Cloud, ray: &Ray, mut visit: impl FnMut(Stretch) -> bool) {
        let tracer = Tracer::new(cloud, 1.0);
        let Some((start, stop)) = tracer.span(ray.origin, ray.direction) else { return };
        let mut at = start;
        tracer.walk(ray.origin, ray.direction, start, stop, |_, length, extinction| {
            let stretch = Stretch { start: at, length: f64::from(length), extinction: f64::from(extinction) };
            at += stretch.length;
            extinction == 0.0 || visit(stretch)
        });
    }
}

/// Steps per cell where billows are cut, along its shortest edge.
pub(crate) const STEPS_PER_CELL: f32 = 3.5;
/// Steps per billow.
pub(crate) const STEPS_PER_BILLOW: f32 = 10.0;
/// Optical depth of a step in the cloud's inside, where nothing is finer than a cell.
const INSIDE_DEPTH: f32 = 0.25;

/// The part of a cloud with billows that no light changes: where there is anything, and how much at most.
#[derive(Clone, Debug, Default)]
pub struct CloudShape {
    /// Largest extinction around each cell, 1/m.
    ceilings: Vec<f32>,
    /// How many cubes of eight centres away the nearest that holds any cloud is, from the one that starts at this cell: the largest of
    /// the steps along the three axes, 0 in a cube with cloud, at most 255.
    distances: Vec<u8>,
}

impl CloudShape {
    /// Prepares a cloud, once per asset.
    pub fn new(cloud: &Cloud) -> Self {
        let shape = cloud.shape;
        // Whether any of the eight centres from a cell on has cloud; at the grid's end fewer.
        let mut filled: Vec<bool> = cloud.extinction.iter().map(|&extinction| extinction > 0.0).collect();
        let mut before = filled.clone();
        for (count, stride) in shape.to_array().into_iter().zip([1, shape.row_stride(), shape.slab_stride()])
        {
            before.copy_from_slice(&filled);
            let lines = (count * stride).max(1);
            for (filled, before) in filled.chunks_exact_mut(lines).zip(before.chunks_exact(lines)) {
                filled.iter_mut().zip(&before[stride..]).for_each(|(own, next)| *own |= next);
            }
        }
        let filled = filled.into_iter();
        Self { distances: distances(shape, filled), ceilings: ceilings(shape, &cloud.extinction) }
    }

    /// Largest extinction around each cell, 1/m, x fastest.
    pub fn ceilings(&self) -> &[f32] {
        &self.ceilings
    }

    /// Steps to the nearest cube of eight centres with cloud in it, a cube, x fastest; all cubes closer than that are empty.
    pub fn distances(&self) -> &[u8] {
        &self.distances
    }
}

/// Extinction between cell centres, its edges cut into billows, so that a grid with cells of a hundred metres does not look like
/// one.
#[derive(Clone, Copy)]
pub struct Billows<'a> {
    /// What was prepared for the cloud.
    pub shape: &'a CloudShape,
    /// The billows' pattern.
    pub detail: &'a Detail,
    /// Their diameter, m, if there are any.
    pub billow: Option<f32>,
}

impl Density for Billows<'_> {
    fn stretches(&self, cloud: &Cloud, ray: &Ray, mut visit: impl FnMut(Stretch) -> bool) {
        let (from, way) = (ray.origin.as_vec3(), ray.direction.as_vec3());
        let cubes = CellCubes::new(cloud);
        let shortest = cloud.cell_m.into_iter().fold(f64::INFINITY, f64::min) as f32;
        let Some((near, far)) = cubes.span(cloud, from, way) else { return };
        let fine = self.billow.map_or(f32::INFINITY, |size| size / STEPS_PER_BILLOW);
        // A step that is lost in the distance's last digits would not end.
        let fine = fine.min(shortest / STEPS_PER_CELL).max(4.0 * f32::EPSILON * far);
        let mut at = near;
        while at < far {
            let point = from + way * (at + 0.5 * fine);
            let cube = cubes.at(point);
            let empty = self.shape.distances[cube.index];
            if empty > 0 {
                at += cubes.to_leave(point, way, empty).max(fine);
                continue;
            }
            let (coarse, ceiling) = self.coarse(cloud, cubes.weights(&cube));
            let extinction = self.detail.modulate(point, coarse, ceiling);
            let mut step = fine;
            if extinction == coarse && coarse > 0.0 {
                step = step_inside(coarse, fine, shortest);
            }
            step = step.min(far - at);
            if extinction > 0.0 {
                let [start, length, extinction] = [at, step, extinction].map(f64::from);
                if !visit(Stretch { start, length, extinction }) {
                    return;
                }
            }
            at += step;
        }
    }
}

/// Length of a step in the cloud's inside: of some optical depth, within a cell.
pub(super) fn step_inside(extinction: f32, fine: f32, shortest: f32) -> f32 {
    fine.max((INSIDE_DEPTH / extinction).min(shortest))
}

impl Billows<'_> {
    /// Extinction without billows, and the largest around, from the weights of a place's eight centres.
    #[inline]
    fn coarse(&self, cloud: &Cloud, (at, weights): ([usize; 8], [f32; 8])) -> (f32, f32) {
        let mix = |values: &[f32]| (0..8).fold(0.0, |sum, i| sum + values[at[i]] * weights[i]);
        (mix(&cloud.extinction), mix(&self.shape.ceilings))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::transport::Boundary;
    use glam::DVec3;
    use squall_formats::GridShape;

    fn sparse(shape: GridShape, seed: u64) -> Cloud {
        let mut random = Random::new(seed);
        let extinction = (0..shape.len()).map(|_| if random.unit() < 0.004 { 0.02 } else { 0.0 }).collect();
        let (cell_m, origin_m) = ([20.0, 30.0, 40.0], DVec3::new(-100.0, -90.0, 50.0));
        Cloud { shape, cell_m, origin_m, extinction, albedo: 0.9, g: 0.85, boundary: Boundary::Open }
    }

    #[test]
    fn distances_are_those_to_the_nearest_cube_with_cloud() {
        let cloud = sparse(GridShape::new(17, 12, 9), 3);
        let shape = CloudShape::new(&cloud);
        let cells: Vec<[usize; 3]> = (0..cloud.shape.len()).map(|cell| cloud.shape.cell(cell)).collect();
        let full: Vec<[usize; 3]> =
            cells.iter().zip(&shape.distances).filter(|(_, d)| **d == 0).map(|(cell, _)| *cell).collect();
        assert!(full.len() > 8 && full.len() < cells.len() / 2);
        for (cell, found) in cells.iter().zip(&shape.distances) {
            let away =
                |other: &[usize; 3]| (0..3).map(|axis| cell[axis].abs_diff(other[axis])).max().unwrap();
            assert_eq!(usize::from(*found), full.iter().map(away).min().unwrap(), "{cell:?}");
        }
        let none = Cloud { extinction: vec![0.0; cloud.shape.len()], ..cloud };
        assert!(CloudShape::new(&none).distances.iter().all(|&d| d == u8::MAX));
    }

    #[test]
    fn a_march_that_steps_over_empty_space_misses_no_cloud() {
        /// Steps of a third of a cell begin elsewhere, on cubes that a ray cuts at a corner.
        const STEPS: f64 = 0.05;
        let mut random = Random::new(8);
        let detail = Detail::new(&crate::shade::detail::DetailParameters::default()).unwrap();
        let (mut fast, mut slow, mut met) = (0.0, 0.0, 0);
        for seed in 0..40 {
            let cloud = sparse(GridShape::new(23, 14, 11), seed);
            let shape = CloudShape::new(&cloud);
            // One cube at a time.
            let near = CloudShape {
                distances: shape.distances.iter().map(|d| (*d).min(1)).collect(),
                ..shape.clone()
            };
            for _ in 0..20 {
                let middle = 0.5 * (cloud.origin_m + cloud.far_corner());
                let origin = middle + random.direction() * 700.0;
                let aim = middle + random.direction() * random.range(0.0, 150.0);
                let ray = Ray { origin, direction: (aim - origin).normalize() };
                let depth = |shape: &CloudShape| {
                    let mut sum = 0.0;
                    let billows = Billows { shape, detail: &detail, billow: None };
                    billows.stretches(&cloud, &ray, |s| {
                        sum += s.length * s.extinction;
                        true
                    });
                    sum
                };
                let both = [depth(&shape), depth(&near)];
                fast += both[0];
                slow += both[1];
                met += usize::from(both[1] > 0.0);
                assert!((both[0] - both[1]).abs() < STEPS * (1.0 + both[1]), "{both:?}");
            }
        }
        assert!(met > 200 && f64::abs(fast / slow - 1.0) < 0.2 * STEPS, "{met} {fast} {slow}");
    }
}
