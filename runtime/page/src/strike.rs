//! Where a stroke stands that a pointer calls for.

use squall_runtime::camera::Ray;
use squall_runtime::glam::DVec3;
use squall_runtime::{Clouds, RuntimeError, Stroke};

/// A stroke, and how far it stands from where the pointer meant, m.
pub(crate) struct Found {
    pub stroke: Stroke,
    pub moved: f64,
}

/// Radiant intensity of a stroke, W/sr: the order of a return stroke's optical peak in the three bands. \[dobashi\] leaves it to the
/// user; recipes of ours take 1e6 to 1e7.
const INTENSITY: f64 = 2e6;
/// Colour of a stroke's light, nearly that of air at 30 000 K.
const COLOR: [f32; 3] = [0.8, 0.75, 1.28];
/// Metres of a stroke that are one point of light: the renderer's own.
const POINT_M: f64 = 50.0;
/// Steps along a ray through the cloud's box.
const STEPS: usize = 256;
/// How a stroke is tried that reaches less and less far down and sideways, as a share of the way to the ground.
const SHARES: [f64; 8] = [1.0, 0.8, 0.6, 0.4, 0.25, 0.15, 0.08, 0.03];
/// Shapes that are tried for each.
const SHAPES: u64 = 6;

/// A stroke where `ray` meets the cloud, as long as the asset's light allows.
///
/// Errors: nothing of the asset's cloud is lit.
pub(crate) fn at(clouds: &Clouds, ray: &Ray, seed: u64) -> Result<Found, RuntimeError> {
    let meant = meets(clouds, ray);
    let none = || RuntimeError::argument("asset", "one with rows of light for strokes", "none");
    let from = clouds.nearest_lit(meant).ok_or_else(none)?;
    let moved = from.distance(meant);
    let is_lit = |stroke: &Stroke| stroke.lights(POINT_M).iter().all(|light| clouds.is_lit(light.position));
    for share in SHARES {
        let down = from - DVec3::Z * from.z.max(0.0) * share;
        for to in [down, clouds.nearest_lit(down).unwrap_or(down)] {
            if to.distance(from) < 1.0 {
                continue;
            }
            for shape in 0..SHAPES {
                let stroke = Stroke::between(from, to, seed.wrapping_mul(SHAPES) + shape, INTENSITY)?;
                if is_lit(&stroke) {
                    return Ok(Found { stroke: stroke.colored(COLOR), moved });
                }
            }
        }
    }
    // A point has no shape that could leave the lit place.
    Ok(Found { stroke: Stroke::from_points(&[from], INTENSITY, COLOR)?, moved })
}

/// Where `ray` first meets cloud, one mean free path deep; where it meets none, the middle of its way through the cloud's box, or the
/// place on it that is nearest to the box's middle.
fn meets(clouds: &Clouds, ray: &Ray) -> DVec3 {
    let cloud = clouds.cloud();
    let (low, high) = (cloud.origin_m, cloud.far_corner());
    let at = |distance: f64| ray.origin + distance * ray.direction;
    let middle = 0.5 * (low + high);
    let Some([enters, leaves]) = through(low, high, ray) else {
        return at((middle - ray.origin).dot(ray.direction).max(0.0));
    };
    let step = (leaves - enters) / STEPS as f64;
    let mut depth = 0.0;
    for i in 0..STEPS {
        let distance = enters + (i as f64 + 0.5) * step;
        let cell = ((at(distance) - low) / DVec3::from_array(cloud.cell_m)).as_uvec3();
        let shape = cloud.shape.to_array();
        let cell: [usize; 3] =
            std::array::from_fn(|axis| (cell.to_array()[axis] as usize).min(shape[axis] - 1));
        depth += step * f64::from(cloud.extinction[cloud.shape.index(cell[0], cell[1], cell[2])]);
        if depth >= 1.0 {
            return at(distance);
        }
    }
    at(0.5 * (enters + leaves))
}

/// Where a ray enters and leaves a box, m along it.
fn through(low: DVec3, high: DVec3, ray: &Ray) -> Option<[f64; 2]> {
    let (mut enters, mut leaves) = (0.0f64, f64::INFINITY);
    for axis in 0..3 {
        let [a, b] = [low[axis], high[axis]].map(|face| (face - ray.origin[axis]) / ray.direction[axis]);
        // Beside a face and along it both quotients are infinite, of one sign outside of the box.
        if a.is_nan() || b.is_nan() {
            continue;
        }
        (enters, leaves) = (enters.max(a.min(b)), leaves.min(a.max(b)));
    }
    (enters < leaves && leaves.is_finite()).then_some([enters, leaves])
}
