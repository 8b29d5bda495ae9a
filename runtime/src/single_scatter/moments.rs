//! Direct light's moments per cell, for transport sweeps that scatter it.

use super::{DirectSettings, add_rays};
use crate::relight::PointLight;
use crate::transport::Cloud;
use crate::transport::direct::Tally;
use glam::DVec3;
use squall_formats::sphere::harmonics;

/// ∫ Y_m L dΩ up to degree 1 of light that the delta-scaled medium counts as unscattered.
struct Moments {
    sums: Vec<f32>,
    basis: [f32; 4],
}

impl Tally for Moments {
    #[inline]
    fn start(&mut self, direction: DVec3) {
        let all = harmonics(direction.to_array());
        self.basis = std::array::from_fn(|m| all[m] as f32);
    }

    #[inline(always)]
    fn chord(&mut self, cell: usize, _: f32, scaled: f32) {
        if let Some(sums) = self.sums.get_mut(4 * cell..4 * cell + 4) {
            for m in 0..4 {
                sums[m] += scaled * self.basis[m];
            }
        }
    }
}

/// The moments of `lights`' direct light, mean per cell, W/m²; in cells farther than one from any cloud nothing, `distances` being steps to
/// the nearest with cloud. The same bytes come out for any number of threads.
pub(crate) fn direct_moments(
    (cloud, extinction_scale, distances): (&Cloud, f64, &[u8]),
    lights: &[PointLight],
    settings: DirectSettings,
) -> Vec<[f32; 4]> {
    let mut sums = vec![[0.0f32; 4]; cloud.shape.len()];
    let tally = || Moments { sums: vec![0.0; 4 * cloud.shape.len()], basis: [0.0; 4] };
    let near = (cloud, extinction_scale, distances);
    add_rays(near, lights, settings, (&tally, &|tally: Moments| tally.sums), sums.as_flattened_mut());
    sums
}
