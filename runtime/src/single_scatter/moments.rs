//! Direct light's moments per cell, for transport sweeps that scatter it.

use super::{DirectSettings, POINTS_PER_PIECE, WantedCells, add_rays_in};
use crate::relight::PointLight;
use crate::transport::Cloud;
use crate::transport::direct::Tally;
use glam::DVec3;
use squall_formats::sphere::harmonics;

/// ∫ Y_m L dΩ up to degree 1 of light that the delta-scaled medium counts as unscattered.
struct Moments<'a> {
    /// Of each cell its place among those that are wanted.
    places: &'a [u32],
    sums: Vec<[f32; 4]>,
    basis: [f32; 4],
}

/// Most parts that a stroke's rays are summed in: every one of them holds all wanted cells.
const PARTS: usize = 4;

impl Tally for Moments<'_> {
    const UNSCATTERED: bool = false;

    #[inline]
    fn start(&mut self, direction: DVec3) {
        let all = harmonics(direction.to_array());
        self.basis = std::array::from_fn(|m| all[m] as f32);
    }

    #[inline(always)]
    fn chord(&mut self, cell: usize, _: f32, scaled: f32) {
        // Cells that are not wanted have no place, and no sums.
        if let Some(sums) = self.sums.get_mut(self.places[cell] as usize) {
            for m in 0..4 {
                sums[m] += scaled * self.basis[m];
            }
        }
    }
}

/// Adds the moments of `lights`' direct light, mean per cell, W/m², to those of `wanted` cells, which are all within a step of cloud. The
/// same bytes come out for any number of threads.
pub(crate) fn add_direct_moments(
    (cloud, extinction_scale, distances): (&Cloud, f64, &[u8]),
    wanted: &WantedCells,
    lights: &[PointLight],
    settings: DirectSettings,
    moments: &mut [[f32; 4]],
) {
    let count = wanted.cells.len();
    let tally = || Moments { places: &wanted.places, sums: vec![[0.0; 4]; count], basis: [0.0; 4] };
    let mut sums = vec![[0.0f32; 4]; count];
    let near = (cloud, extinction_scale, distances);
    let at_once = lights.len().div_ceil(PARTS).max(POINTS_PER_PIECE);
    let sums_of = |tally: Moments<'_>| tally.sums.into_flattened();
    add_rays_in(at_once, near, lights, settings, (&tally, &sums_of), sums.as_flattened_mut());
    for (&cell, sums) in wanted.cells.iter().zip(&sums) {
        moments[cell as usize].iter_mut().zip(sums).for_each(|(sum, value)| *sum += value);
    }
}
