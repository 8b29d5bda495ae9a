//! Rays that leave light in and around cloud alone, and step over the air between.

use super::{DirectField, DirectMoments, Light, PowerRay, Tally, Tracer, chord};
use crate::cloud::Boundary;

/// Share of a cell's edge that a ray goes on by at least, so that round-off never holds it.
const ONWARD: f64 = 1e-6;

/// Where rays leave light, and when they end.
#[derive(Clone, Copy, Debug)]
pub struct NearCloud<'a> {
    /// A cell, how many steps the nearest cell with cloud is away, of which the largest along an axis counts: see [`super::distances`].
    pub distances: &'a [u8],
    /// Cells farther from cloud than so many steps get no light: 0 is for light that is scattered, 1 for light that is read between the
    /// centres of cells.
    pub around: u8,
    /// A ray ends where less than this share of its scaled light is left.
    pub least: f32,
}

impl Tracer<'_> {
    /// Adds a light's moments, by `samples`² rays through every cell face by which it can leave. Compiled here, with this crate's optimisations, whoever calls it.
    pub fn add_moments(&self, light: Light, samples: u32, near: &NearCloud<'_>, sums: &mut DirectMoments<4>) {
        self.rays(light, samples, |ray| self.trace_near(ray, near, sums));
    }

    /// The same of all that a field holds.
    pub fn add_field(&self, light: Light, samples: u32, near: &NearCloud<'_>, sums: &mut DirectField<4>) {
        self.rays(light, samples, |ray| self.trace_near(ray, near, sums));
    }

    /// [`Tracer::trace`] in and around cloud: cells farther from it get nothing and cost nothing.
    pub fn trace_near<T: Tally>(&self, ray: PowerRay, near: &NearCloud<'_>, tally: &mut T) {
        let NearCloud { distances, around, least } = *near;
        let Some((mut at, stop)) = self.span(ray.origin, ray.direction) else { return };
        if self.cloud.boundary == Boundary::PeriodicXy {
            self.trace(ray, tally);
            return;
        }
        tally.start(ray.direction);
        let (power, scale) = (ray.power as f32, self.scale);
        let edge = self.cloud.cell_m.into_iter().fold(f64::INFINITY, f64::min);
        let (mut open, mut scaled) = (1.0f32, 1.0f32);
        while at < stop && scaled > least {
            let begin = at;
            let (cell, index) = self.cell_at(ray, at + ONWARD * edge);
            if distances[index] > around {
                at = self.leaves(ray, cell, distances[index] - around);
            } else {
                self.walk(ray.origin, ray.direction, at, stop, |cell, length, extinction| {
                    if distances[cell] > around {
                        return false;
                    }
                    at += f64::from(length);
                    let depth = extinction * length;
                    let (open_sum, scaled_sum);
                    (open_sum, open) =
                        if T::UNSCATTERED { chord(open, depth, extinction, length) } else { (0.0, open) };
                    (scaled_sum, scaled) = chord(scaled, scale * depth, scale * extinction, length);
                    tally.chord(cell, power * open_sum, power * scaled_sum);
                    scaled > least
                });
            }
            at = at.max(begin + ONWARD * edge);
        }
    }

    /// The cell that a ray is in after `at` metres, and its index.
    fn cell_at(&self, ray: PowerRay, at: f64) -> ([usize; 3], usize) {
        let (shape, point) = (self.cloud.shape, ray.origin + ray.direction * at);
        let counts = shape.to_array();
        let cell: [usize; 3] = std::array::from_fn(|axis| {
            let place = (point[axis] - self.cloud.origin_m[axis]) / self.cloud.cell_m[axis];
            // Below 0 becomes 0.
            (place as usize).min(counts[axis] - 1)
        });
        (cell, shape.index(cell[0], cell[1], cell[2]))
    }

    /// Metres at which a ray leaves `cell` and all around it that are fewer than `steps` away.
    fn leaves(&self, ray: PowerRay, cell: [usize; 3], steps: u8) -> f64 {
        let side = |axis: usize| {
            let way = ray.direction[axis];
            let beyond = if way > 0.0 { f64::from(steps) } else { 1.0 - f64::from(steps) };
            let face = self.cloud.origin_m[axis] + self.cloud.cell_m[axis] * (cell[axis] as f64 + beyond);
            if way == 0.0 { f64::INFINITY } else { (face - ray.origin[axis]) / way }
        };
        side(0).min(side(1)).min(side(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Cloud;
    use crate::direct::{distances as distances_of, fibonacci};
    use glam::DVec3;
    use squall_formats::GridShape;

    #[test]
    fn rays_that_step_over_air_leave_the_same_light_in_and_around_cloud() {
        /// Single precision, and light that is given up.
        const ROUND_OFF: f32 = 2e-4;
        let shape = GridShape::new(20, 16, 12);
        let cloud_at = |cell: usize| {
            let [x, y, z] = shape.cell(cell);
            matches!((x, y, z), (3..=6, 4..=8, 5..=7) | (14..=15, 11..=12, 2..=3))
        };
        let extinction: Vec<f32> = (0..shape.len()).map(|i| if cloud_at(i) { 0.03 } else { 0.0 }).collect();
        let cloudy: Vec<[usize; 3]> =
            (0..shape.len()).filter(|&i| cloud_at(i)).map(|i| shape.cell(i)).collect();
        let distance = |cell: [usize; 3]| {
            let away =
                |other: &[usize; 3]| (0..3).map(|axis| cell[axis].abs_diff(other[axis])).max().unwrap();
            cloudy.iter().map(away).min().unwrap() as u8
        };
        let distances: Vec<u8> = (0..shape.len()).map(|i| distance(shape.cell(i))).collect();
        let (cell_m, origin_m) = ([20.0, 25.0, 30.0], DVec3::new(-200.0, 100.0, 50.0));
        let cloud =
            Cloud { shape, cell_m, origin_m, extinction, albedo: 1.0, g: 0.8, boundary: Boundary::Open };
        let tracer = Tracer::new(&cloud, 0.6);
        assert_eq!(distances_of(shape, (0..shape.len()).map(cloud_at)), distances);
        for around in [0, 1] {
            let steps = NearCloud { distances: &distances, around, least: 1e-5 };
            let [mut all, mut near] = [0, 1].map(|_| DirectField::<4>::new(&cloud, &[]));
            let mut moments = DirectMoments::<4>::new(shape.len());
            for origin in [DVec3::new(-90.0, 260.0, 220.0), DVec3::new(-1000.0, 200.0, 150.0), origin_m] {
                for i in 0..3000 {
                    let ray = PowerRay { origin, direction: fibonacci(i, 3000), power: 1.0 };
                    tracer.trace(ray, &mut all);
                    tracer.trace_near(ray, &steps, &mut near);
                    tracer.trace_near(ray, &steps, &mut moments);
                }
            }
            let most = all.fluence.iter().copied().fold(0.0, f32::max);
            for (cell, distance) in distances.iter().enumerate() {
                let (all, near) = (all.fluence[cell], near.fluence[cell]);
                let wanted = if *distance > around { 0.0 } else { all };
                assert!(
                    (near - wanted).abs() <= ROUND_OFF * (wanted + 0.01 * most),
                    "{cell}: {near} {wanted}"
                );
            }
            // Moments without the light that was never scattered are those beside it.
            assert_eq!(moments.moments, near.moments);
        }
    }
}
