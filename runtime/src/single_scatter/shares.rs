//! A beam's direct light per cell before it is scattered, for those who scatter it themselves.

use super::{BEAM_PIECES, BEAM_SAMPLES};
use crate::parallel::map_chunks;
use crate::transport::Cloud;
use crate::transport::direct::{Light, Tally, Tracer};
use glam::DVec3;

/// Fluence of light never scattered, and of that with light scattered forward only.
struct Shares(Vec<[f32; 2]>);

impl Tally for Shares {
    #[inline]
    fn start(&mut self, _: DVec3) {}

    #[inline(always)]
    fn chord(&mut self, cell: usize, unscattered: f32, scaled: f32) {
        let [open, both] = self.0[cell];
        self.0[cell] = [open + unscattered, both + scaled];
    }
}

/// The rays of [`super::add_direct_beam`], their light per cell before the phase functions: never scattered, and that with what was
/// scattered forward only, W/m² per W/m² across the beam.
pub(crate) fn beam_shares(cloud: &Cloud, extinction_scale: f64, direction: DVec3) -> Vec<[f32; 2]> {
    let tracer = Tracer::new(cloud, extinction_scale);
    let share = 1.0 / cloud.cell_volume() as f32;
    let (mut rays, cells) = (Vec::new(), cloud.shape.len());
    tracer.rays(Light::Beam { direction, irradiance: 1.0 }, BEAM_SAMPLES, |ray| rays.push(ray));
    let mut sums = vec![[0.0f32; 2]; cells];
    let piece = |_: usize, rays: &[_]| -> Vec<[f32; 2]> {
        let mut tally = Shares(vec![[0.0; 2]; cells]);
        for &ray in rays {
            tracer.trace(ray, &mut tally);
        }
        tally.0
    };
    let add = |part: Vec<[f32; 2]>| {
        for (sum, [open, both]) in sums.iter_mut().zip(part) {
            *sum = [sum[0] + open * share, sum[1] + both * share];
        }
    };
    map_chunks(&rays, rays.len().div_ceil(BEAM_PIECES).max(1), piece, add);
    sums
}
