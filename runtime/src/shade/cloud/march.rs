//! A cloud as a picture shows it: extinction and light between cell centres, three colours, billows below a cell.
//!
//! [`super::LitCloud`] follows the grid as the solver saw it, for measurements. Here density is interpolated and its edges
//! are cut into billows, so that a grid with cells of a hundred metres does not look like one.

use crate::camera::Ray;
use crate::math::exp_neg;
use crate::shade::detail::{Detail, ceilings};
use crate::transport::Cloud;
use glam::{Vec3, Vec4};

/// Light behind less than this share is not looked for.
const OPAQUE: f32 = 2e-3;
/// Steps per cell where billows are cut, along its shortest edge.
const STEPS_PER_CELL: f32 = 3.5;
/// Steps per billow.
const STEPS_PER_BILLOW: f32 = 10.0;
/// Optical depth of a step in the cloud's inside, where nothing is finer than a cell.
const INSIDE_DEPTH: f32 = 0.25;

/// What a ray meets in a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudView {
    /// Radiance towards the ray's origin, W/(m² sr) per channel.
    pub radiance: [f32; 3],
    /// Share of what is behind that comes through.
    pub transmittance: f32,
    /// Mean distance of what is seen, m; 0 where nothing is.
    pub distance: f32,
}

/// Clear sky.
const NOTHING: CloudView = CloudView { radiance: [0.0; 3], transmittance: 1.0, distance: 0.0 };

/// The part of a marched cloud that no light changes: where there is anything, and how much at most.
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

/// A cloud and its light towards one eye.
pub struct MarchedCloud<'a> {
    /// The grid.
    pub cloud: &'a Cloud,
    /// What was prepared for it.
    pub shape: &'a CloudShape,
    /// Per cell: J towards the eye in three channels, W/(m² sr), and extinction, 1/m.
    pub cells: &'a [Vec4],
    /// Billows.
    pub detail: &'a Detail,
    /// Their diameter, m, if there are any.
    pub billow: Option<f32>,
}

/// A place between centres.
struct Place {
    index: usize,
    share: Vec3,
}

impl MarchedCloud<'_> {
    /// Follows `ray` until it leaves the grid or sees no further.
    pub fn look(&self, ray: &Ray) -> CloudView {
        let (from, way) = (ray.origin.as_vec3(), ray.direction.as_vec3());
        let origin = self.cloud.origin_m.as_vec3();
        let cell = Vec3::from_array(self.cloud.cell_m.map(|v| v as f32));
        let far_corner = self.cloud.far_corner().as_vec3();
        // A direction without a component divides to ±∞, and to NaN on a face: min and max then skip it.
        let (a, b) = ((origin - from) / way, (far_corner - from) / way);
        let near = a.min(b).max_element().max(0.0);
        let far = a.max(b).min_element();
        if near.is_nan() || far.is_nan() || near >= far {
            return NOTHING;
        }
        let fine = self.billow.map_or(f32::INFINITY, |size| size / STEPS_PER_BILLOW);
        // A step that is lost in the distance's last digits would not end.
        let fine = fine.min(cell.min_element() / STEPS_PER_CELL).max(4.0 * f32::EPSILON * far);
        let albedo = self.cloud.albedo as f32;
        let (mut light, mut open, mut mean, mut seen) = (Vec3::ZERO, 1.0f32, 0.0f32, 0.0f32);
        let mut at = near;
        while at < far {
            let point = from + way * (at + 0.5 * fine);
            let place = self.place((point - origin) / cell);
            if !self.shape.filled[place.index] {
                at += self.to_next_centres((point - origin) / cell, way / cell).max(fine);
                continue;
            }
            let value = self.between(&place);
            let coarse = value.w;
            let ceiling = self.ceiling(&place);
            let extinction = self.detail.modulate(point, coarse, ceiling);
            let mut step = fine;
            if extinction == coarse && coarse > 0.0 {
                step = step.max((INSIDE_DEPTH / coarse).min(cell.min_element()));
            }
            step = step.min(far - at);
            if extinction > 0.0 {
                let share = open * (1.0 - exp_neg(extinction * step));
                light += value.truncate() * (share * albedo);
                mean += share * (at + 0.5 * step);
                seen += share;
                open -= share;
                if open < OPAQUE {
                    break;
                }
            }
            at += step;
        }
        let distance = if seen > 0.0 { mean / seen } else { 0.0 };
        let open = if open < OPAQUE { 0.0 } else { open };
        CloudView { radiance: light.to_array(), transmittance: open, distance }
    }

    /// The cube of centres around a place given in cells, and the share of its upper sides.
    #[inline]
    fn place(&self, at: Vec3) -> Place {
        let counts = self.cloud.shape.to_array().map(|n| n as f32 - 1.0);
        let at = (at - 0.5).clamp(Vec3::ZERO, Vec3::from_array(counts));
        let low = at.floor();
        let shape = self.cloud.shape;
        let index =
            low.x as usize + low.y as usize * shape.row_stride() + low.z as usize * shape.slab_stride();
        Place { index, share: at - low }
    }

    /// Weights of the eight centres; those beyond the grid count for the nearest within.
    #[inline]
    fn corners(&self, place: &Place) -> ([usize; 8], [f32; 8]) {
        let shape = self.cloud.shape;
        // A share above 0 says that there is a centre above.
        let [u, v, w] = place.share.to_array();
        let right = usize::from(u > 0.0);
        let row = if v > 0.0 { shape.row_stride() } else { 0 };
        let slab = if w > 0.0 { shape.slab_stride() } else { 0 };
        let base = place.index;
        let at = [
            base,
            base + right,
            base + row,
            base + row + right,
            base + slab,
            base + slab + right,
            base + slab + row,
            base + slab + row + right,
        ];
        let (a, b, c) = (1.0 - u, 1.0 - v, 1.0 - w);
        (at, [a * b * c, u * b * c, a * v * c, u * v * c, a * b * w, u * b * w, a * v * w, u * v * w])
    }

    #[inline]
    fn between(&self, place: &Place) -> Vec4 {
        let (at, weights) = self.corners(place);
        (0..8).fold(Vec4::ZERO, |sum, i| sum + self.cells[at[i]] * weights[i])
    }

    #[inline]
    fn ceiling(&self, place: &Place) -> f32 {
        let (at, weights) = self.corners(place);
        (0..8).fold(0.0, |sum, i| sum + self.shape.ceilings[at[i]] * weights[i])
    }

    /// Metres from a place (in cells) to where its cube of centres ends along `way` (cells per metre).
    #[inline]
    fn to_next_centres(&self, at: Vec3, way: Vec3) -> f32 {
        let low = (at - 0.5).floor() + 0.5;
        let ahead = Vec3::select(way.cmpgt(Vec3::ZERO), low + 1.0 - at, low - at) / way;
        let ahead = Vec3::select(ahead.is_nan_mask(), Vec3::INFINITY, ahead);
        ahead.min_element()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shade::detail::DetailParameters;
    use crate::transport::Boundary;
    use glam::DVec3;
    use squall_formats::GridShape;

    fn uniform(extinction: f32, shape: GridShape) -> Cloud {
        Cloud {
            shape,
            cell_m: [20.0, 30.0, 40.0],
            origin_m: DVec3::new(-100.0, -90.0, 50.0),
            extinction: vec![extinction; shape.len()],
            albedo: 0.9,
            g: 0.85,
            boundary: Boundary::Open,
        }
    }

    fn look(cloud: &Cloud, ray: Ray) -> CloudView {
        let shape = CloudShape::new(cloud);
        let detail = Detail::new(&DetailParameters::default()).unwrap();
        let cells: Vec<Vec4> = cloud.extinction.iter().map(|&e| Vec4::new(1.0, 2.0, 3.0, e)).collect();
        MarchedCloud { cloud, shape: &shape, cells: &cells, detail: &detail, billow: None }.look(&ray)
    }

    /// Single precision over some hundred steps.
    const ROUND_OFF: f32 = 1e-4;

    #[test]
    fn a_uniform_cloud_in_uniform_light_shows_what_beer_and_lambert_say() {
        let cloud = uniform(0.004, GridShape::new(10, 6, 5));
        let ray = Ray { origin: DVec3::new(-500.0, 7.0, 141.0), direction: DVec3::X };
        let view = look(&cloud, ray);
        let through = libm::expf(-0.004 * 200.0);
        assert!((view.transmittance - through).abs() < ROUND_OFF);
        assert!((view.radiance[1] - 2.0 * 0.9 * (1.0 - through)).abs() < ROUND_OFF);
        assert!(view.distance > 400.0 && view.distance < 600.0);
    }

    #[test]
    fn a_single_cell_and_a_ray_along_a_face_are_no_trouble() {
        let cloud = uniform(0.01, GridShape::new(1, 1, 1));
        let inside = look(&cloud, Ray { origin: DVec3::new(-90.0, -75.0, 0.0), direction: DVec3::Z });
        assert!((inside.transmittance - libm::expf(-0.4)).abs() < ROUND_OFF);
        let along = look(&cloud, Ray { origin: DVec3::new(-100.0, -75.0, 0.0), direction: DVec3::Z });
        assert!(along.transmittance.is_finite() && along.radiance[0].is_finite());
        let beside = look(&cloud, Ray { origin: DVec3::new(0.0, 0.0, 0.0), direction: DVec3::Z });
        assert_eq!(beside, NOTHING);
    }

    #[test]
    fn empty_cubes_are_skipped_and_what_stands_behind_them_is_not() {
        let shape = GridShape::new(40, 5, 5);
        let mut cloud = uniform(0.0, shape);
        for index in 0..shape.len() {
            if shape.cell(index)[0] == 31 {
                cloud.extinction[index] = 0.01;
            }
        }
        let ray = Ray { origin: DVec3::new(-500.0, 0.0, 150.0), direction: DVec3::X };
        // Between centres the one layer is a tent two cells wide, with the same optical depth.
        let view = look(&cloud, ray);
        /// The midpoint rule on a tent with seven steps a side.
        const MARCHING: f32 = 0.01;
        assert!((view.transmittance - libm::expf(-0.2)).abs() < MARCHING, "{view:?}");
        assert!((view.distance - (400.0 + 31.5 * 20.0)).abs() < 20.0, "{view:?}");
    }
}
