//! The march of pictures: density with billows and light read together, in single precision.
//!
//! It takes the steps of [`super::march`] over [`super::density`]'s billows: a cell's light and extinction lie side by side, and a place
//! on a step of the shortest kind is looked up once for both.

use super::density::{Billows, STEPS_PER_BILLOW, STEPS_PER_CELL, step_inside};
use super::lookup::CellCubes;
use super::march::{CloudView, MarchQuality};
use crate::camera::Ray;
use crate::math::exp_neg;
use crate::transport::Cloud;
use glam::{Vec3, Vec4};

/// A ray's way into a cloud so far.
struct Way {
    radiance: Vec3,
    /// Share of light that still comes through.
    open: f32,
    /// Share that was taken out, and its distance times that.
    seen: f32,
    moment: f32,
}

impl Way {
    /// A step of even density in light `j`.
    #[inline(always)]
    fn step(&mut self, j: Vec3, (at, length): (f32, f32), (extinction, albedo): (f32, f32)) {
        let depth = extinction * length;
        let (gone, through) = if depth < 0.02 {
            // The difference from 1 would lose its digits.
            let gone = depth * (1.0 - depth * (0.5 - depth / 6.0));
            (gone, 1.0 - gone)
        } else {
            let through = exp_neg(depth);
            (1.0 - through, through)
        };
        let taken = self.open * gone;
        self.radiance += j * (taken * albedo);
        self.seen += taken;
        self.moment += taken * (at + 0.5 * length);
        self.open *= through;
    }
}

impl Billows<'_> {
    /// Follows `ray` through `cloud` until it leaves the grid or sees no further; `cells` hold J in three colours and the cell's
    /// extinction.
    pub(super) fn picture(&self, cloud: &Cloud, cells: &[Vec4], ray: &Ray) -> CloudView {
        let mut way = Way { radiance: Vec3::ZERO, open: 1.0, seen: 0.0, moment: 0.0 };
        let opaque = MarchQuality::PICTURE.opaque as f32;
        self.follow(cloud, cells, ray, |j, at, extinction| {
            way.step(j, at, (extinction, cloud.albedo as f32));
            way.open > opaque
        });
        let distance = if way.seen > 0.0 { way.moment / way.seen } else { 0.0 };
        let transmittance = if way.open > opaque { way.open } else { 0.0 };
        CloudView { radiance: way.radiance.to_array(), transmittance, distance }
    }

    /// Calls `visit` for each step of `ray` in cloud, nearest first, with light, place, length and extinction, until it returns false.
    #[inline(always)]
    fn follow(
        &self,
        cloud: &Cloud,
        cells: &[Vec4],
        ray: &Ray,
        mut visit: impl FnMut(Vec3, (f32, f32), f32) -> bool,
    ) {
        let (from, along) = (ray.origin.as_vec3(), ray.direction.as_vec3());
        let cubes = CellCubes::new(cloud);
        let Some((near, far)) = cubes.span(cloud, from, along) else { return };
        let shortest = cloud.cell_m.into_iter().fold(f64::INFINITY, f64::min) as f32;
        let fine = self.billow.map_or(f32::INFINITY, |size| size / STEPS_PER_BILLOW);
        // A step that is lost in the distance's last digits would not end.
        let fine = fine.min(shortest / STEPS_PER_CELL).max(4.0 * f32::EPSILON * far);
        let mut at = near;
        while at < far {
            let point = from + along * (at + 0.5 * fine);
            let cube = cubes.at(point);
            let empty = self.shape.distances()[cube.index];
            if empty > 0 {
                at += cubes.to_leave(point, along, empty).max(fine);
                continue;
            }
            let (corners, weights) = cubes.weights(&cube);
            let light = (0..8).fold(Vec4::ZERO, |sum, i| sum + cells[corners[i]] * weights[i]);
            if light.w <= 0.0 {
                at += fine;
                continue;
            }
            let ceiling = (0..8).fold(0.0, |sum, i| sum + self.shape.ceilings()[corners[i]] * weights[i]);
            let extinction = self.detail.modulate(point, light.w, ceiling);
            let is_inside = extinction == light.w && light.w > 0.0;
            let step = if is_inside { step_inside(light.w, fine, shortest) } else { fine };
            let step = step.min(far - at);
            if extinction > 0.0 {
                let j = match step == fine {
                    true => light.truncate(),
                    false => {
                        let middle = cubes.at(from + along * (at + 0.5 * step));
                        Vec3::from_array(cubes.mix_colours(&middle, cells))
                    }
                };
                if !visit(j, (at, step), extinction) {
                    return;
                }
            }
            at += step;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{CloudMarch, CloudShape, MarchQuality, WideRay};
    use super::*;
    use crate::random::Random;
    use crate::shade::detail::{Detail, DetailParameters};
    use crate::transport::Boundary;
    use glam::DVec3;
    use squall_formats::GridShape;

    #[test]
    fn light_and_density_read_together_are_those_read_apart_in_double_precision() {
        /// Single precision over some hundred steps, of the brightest.
        const ROUND_OFF: f32 = 1e-3;
        let shape = GridShape::new(17, 15, 12);
        let mut random = Random::new(12);
        let extinction: Vec<f32> = (0..shape.len())
            .map(|index| {
                let away = (DVec3::from_array(shape.cell(index).map(|at| at as f64)) - 6.0).length();
                if away < 5.5 { random.range(0.0, 0.03) as f32 } else { 0.0 }
            })
            .collect();
        let cells: Vec<Vec4> = extinction
            .iter()
            .map(|&e| Vec4::new(random.unit() as f32, 1.0, random.range(0.0, 3.0) as f32, e))
            .collect();
        let cloud = Cloud {
            shape,
            cell_m: [60.0, 50.0, 40.0],
            origin_m: DVec3::new(-100.0, 2_000.0, 500.0),
            extinction,
            albedo: 0.98,
            g: 0.85,
            boundary: Boundary::Open,
        };
        let (prepared, cubes) = (CloudShape::new(&cloud), CellCubes::new(&cloud));
        let middle = 0.5 * (cloud.origin_m + cloud.far_corner());
        let mut met = 0;
        for amplitude in [0.0, 0.9] {
            let detail = Detail::new(&DetailParameters { amplitude, ..DetailParameters::default() }).unwrap();
            let billow = (amplitude > 0.0).then_some(300.0);
            let billows = Billows { shape: &prepared, detail: &detail, billow };
            let march = CloudMarch::new(&cloud, billows, MarchQuality::PICTURE);
            for _ in 0..300 {
                let origin = middle + random.direction() * 900.0;
                let aim = middle + random.direction() * random.range(0.0, 300.0);
                let ray = Ray { origin, direction: (aim - origin).normalize() };
                let light = |point: DVec3| cubes.mix_colours(&cubes.at(point.as_vec3()), &cells);
                let wanted: CloudView = march.march(&WideRay::thin(ray), light);
                let found = billows.picture(&cloud, &cells, &ray);
                met += usize::from(wanted.transmittance < 0.9);
                assert!(
                    (found.transmittance - wanted.transmittance).abs() < ROUND_OFF,
                    "{found:?} {wanted:?}"
                );
                assert!((found.distance - wanted.distance).abs() < 1.0, "{found:?} {wanted:?}");
                let off = (0..3).map(|band| (found.radiance[band] - wanted.radiance[band]).abs());
                assert!(off.fold(0.0, f32::max) < 3.0 * ROUND_OFF, "{found:?} {wanted:?}");
            }
        }
        assert!(met > 200, "{met}");
    }
}
