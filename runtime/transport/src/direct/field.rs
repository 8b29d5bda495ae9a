//! What a source's rays leave in every cell.

use super::Tally;
use crate::cloud::Cloud;
use crate::phase::PreparedHg;
use glam::DVec3;
use squall_formats::sphere::harmonics;

/// Cell sums of direct light: fluence, moments and light scattered towards given directions.
///
/// Values are ∫ … ds summed over rays, W·m; over the cell's volume they are means.
#[derive(Clone, Debug)]
pub struct DirectField<const M: usize> {
    /// Never scattered fluence rate times volume, W·m per cell.
    pub fluence: Vec<f32>,
    /// Harmonic moments ∫ Y_m L dΩ of light unscattered in the scaled medium, times volume, W·m.
    pub moments: Vec<[f32; M]>,
    /// Light scattered once towards each of the given directions, times volume: ∫ p L dΩ, W·m/sr, directions innermost.
    pub towards: Vec<f32>,
    directions: Vec<[f32; 3]>,
    phase: [PreparedHg; 2],
    basis: [f32; M],
    values: [Vec<f32>; 2],
}

impl<const M: usize> DirectField<M> {
    /// An empty field for `cloud`, which also collects light scattered towards `directions`: by the cloud's phase
    /// function where it was never scattered before, and by its convolution with itself (asymmetry g²) where the scaled
    /// medium only counts it as unscattered.
    pub fn new(cloud: &Cloud, directions: &[DVec3]) -> Self {
        let cells = cloud.shape.len();
        Self {
            fluence: vec![0.0; cells],
            moments: vec![[0.0; M]; cells],
            towards: vec![0.0; cells * directions.len()],
            directions: directions.iter().map(|d| d.as_vec3().to_array()).collect(),
            phase: [PreparedHg::new(cloud.g), PreparedHg::new(cloud.g * cloud.g)],
            basis: [0.0; M],
            values: [vec![0.0; directions.len()], vec![0.0; directions.len()]],
        }
    }

    /// Sets all sums to zero.
    pub fn clear(&mut self) {
        self.fluence.fill(0.0);
        self.moments.fill([0.0; M]);
        self.towards.fill(0.0);
    }
}

impl<const M: usize> Tally for DirectField<M> {
    #[inline]
    fn start(&mut self, direction: DVec3) {
        let all = harmonics(direction.to_array());
        self.basis = std::array::from_fn(|m| all[m] as f32);
        let d = direction.as_vec3();
        for (k, to) in self.directions.iter().enumerate() {
            let cos = d.x * to[0] + d.y * to[1] + d.z * to[2];
            self.values[0][k] = self.phase[0].value(cos);
            self.values[1][k] = self.phase[1].value(cos);
        }
    }

    #[inline(always)]
    fn chord(&mut self, cell: usize, unscattered: f32, scaled: f32) {
        self.fluence[cell] += unscattered;
        let moments = &mut self.moments[cell];
        for m in 0..M {
            moments[m] += scaled * self.basis[m];
        }
        let count = self.directions.len();
        if count > 0 {
            let forward = scaled - unscattered;
            let row = &mut self.towards[cell * count..(cell + 1) * count];
            for ((to, narrow), wide) in row.iter_mut().zip(&self.values[0]).zip(&self.values[1]) {
                *to += narrow * unscattered + wide * forward;
            }
        }
    }
}

/// Moments of direct light alone, for sweeps that scatter it.
#[derive(Clone, Debug)]
pub struct DirectMoments<const M: usize> {
    /// As [`DirectField::moments`], W·m.
    pub moments: Vec<[f32; M]>,
    basis: [f32; M],
}

impl<const M: usize> DirectMoments<M> {
    /// None of it yet, in so many cells.
    pub fn new(cells: usize) -> Self {
        Self { moments: vec![[0.0; M]; cells], basis: [0.0; M] }
    }

    /// Sets all sums to zero.
    pub fn clear(&mut self) {
        self.moments.fill([0.0; M]);
    }
}

impl<const M: usize> Tally for DirectMoments<M> {
    const UNSCATTERED: bool = false;

    #[inline]
    fn start(&mut self, direction: DVec3) {
        let all = harmonics(direction.to_array());
        self.basis = std::array::from_fn(|m| all[m] as f32);
    }

    #[inline(always)]
    fn chord(&mut self, cell: usize, _: f32, scaled: f32) {
        let moments = &mut self.moments[cell];
        for m in 0..M {
            moments[m] += scaled * self.basis[m];
        }
    }
}
