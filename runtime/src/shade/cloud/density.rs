//! Where a march reads density: cell by cell, as the solver saw it, or between cell centres with billows, as a picture shows it.

use super::lookup::CellCubes;
use crate::camera::Ray;
use crate::shade::detail::{Detail, ceilings};
use crate::transport::Cloud;
use crate::transport::direct::Tracer;

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
    /// Whether the cube of eight centres that starts at this cell holds any cloud.
    filled: Vec<bool>,
}

impl CloudShape {
    /// Prepares a cloud, once per asset.
    pub fn new(cloud: &Cloud) -> Self {
        let shape = cloud.shape;
        let [nx, ny, nz] = shape.to_array();
        let filled = (0..shape.len()).map(|index| {
            let [x, y, z] = shape.cell(index);
            (0..8).any(|corner: usize| {
                let near = |at: usize, bit: usize, count: usize| (at + (corner >> bit & 1)).min(count - 1);
                cloud.extinction[shape.index(near(x, 0, nx), near(y, 1, ny), near(z, 2, nz))] > 0.0
            })
        });
        Self { filled: filled.collect(), ceilings: ceilings(shape, &cloud.extinction) }
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
        // A direction without a component divides to ±∞, and to NaN on a face: min and max then skip it.
        let a = (cloud.origin_m.as_vec3() - from) / way;
        let b = (cloud.far_corner().as_vec3() - from) / way;
        let near = a.min(b).max_element().max(0.0);
        let far = a.max(b).min_element();
        if near.is_nan() || far.is_nan() || near >= far {
            return;
        }
        let fine = self.billow.map_or(f32::INFINITY, |size| size / STEPS_PER_BILLOW);
        // A step that is lost in the distance's last digits would not end.
        let fine = fine.min(shortest / STEPS_PER_CELL).max(4.0 * f32::EPSILON * far);
        let mut at = near;
        while at < far {
            let point = from + way * (at + 0.5 * fine);
            let cube = cubes.at(point);
            if !self.shape.filled[cube.index] {
                at += cubes.to_next_centres(point, way).max(fine);
                continue;
            }
            let (coarse, ceiling) = self.coarse(cloud, cubes.weights(&cube));
            let extinction = self.detail.modulate(point, coarse, ceiling);
            let mut step = fine;
            if extinction == coarse && coarse > 0.0 {
                step = step.max((INSIDE_DEPTH / coarse).min(shortest));
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

impl Billows<'_> {
    /// Extinction without billows, and the largest around, from the weights of a place's eight centres.
    #[inline]
    fn coarse(&self, cloud: &Cloud, (at, weights): ([usize; 8], [f32; 8])) -> (f32, f32) {
        let mix = |values: &[f32]| (0..8).fold(0.0, |sum, i| sum + values[at[i]] * weights[i]);
        (mix(&cloud.extinction), mix(&self.shape.ceilings))
    }
}
