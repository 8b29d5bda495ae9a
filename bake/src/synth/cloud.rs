//! Clouds from a seed: a thunderstorm and a broken layer, as a density grid with its scene file.
//!
//! The shapes are made, not simulated: they stand in for a simulation's or an artist's grid and look like what
//! they are named after. Density is cloud water relative to the densest cell, in [0, 1].

mod layer;
mod storm;

use crate::error::BakeError;
use crate::output::write_atomically;
use squall_formats::GridShape;
use std::path::{Path, PathBuf};

/// What kind of cloud.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CloudKind {
    /// A thunderstorm in 16.8 × 9.6 × 9.6 km: flat base, boiling towers, anvil, overshooting top.
    Storm,
    /// A broken stratocumulus layer in cells of 50 m, median vertical optical depth 20.
    Layer,
}

/// A density grid and the optics that go with it.
#[derive(Clone, Debug, PartialEq)]
pub struct SynthCloud {
    /// Kind and seed that made it.
    pub kind: CloudKind,
    /// Seed that made it.
    pub seed: u64,
    /// Cells along x, y, z.
    pub shape: GridShape,
    /// Size of a cell, m.
    pub cell: [f64; 3],
    /// Lowest corner of the grid, m.
    pub origin: [f64; 3],
    /// Cloud water relative to the densest, in [0, 1], x fastest.
    pub density: Vec<f32>,
    /// Extinction at density 1, 1/m.
    pub kappa: f64,
    /// Single-scattering albedo.
    pub albedo: f64,
    /// Mean cosine of scattering.
    pub asymmetry: f64,
}

/// Largest grid that is made: 2²⁷ cells, half a gigabyte.
const MOST_CELLS: usize = 1 << 27;

/// Makes a cloud of `kind` from `seed` in `cells` (the kind's own number when `None`).
///
/// Errors: more than 2²⁷ cells, a storm in fewer than 16 along any axis, a layer in fewer than 2 along z.
pub fn synth_cloud(kind: CloudKind, seed: u64, cells: Option<GridShape>) -> Result<SynthCloud, BakeError> {
    let (usual, least) = match kind {
        CloudKind::Storm => (GridShape::new(96, 64, 48), [16, 16, 16]),
        CloudKind::Layer => (GridShape::new(32, 32, 4), [4, 4, 2]),
    };
    let shape = cells.unwrap_or(usual);
    let fits = shape.checked_len().is_some_and(|count| count <= MOST_CELLS)
        && shape.to_array().iter().zip(least).all(|(&count, least)| count >= least);
    if !fits {
        return Err(BakeError::input(
            Path::new("synth cloud"),
            "cells",
            format!("at least {}x{}x{} and at most 2^27 in all", least[0], least[1], least[2]),
            format!("{}x{}x{}", shape.nx, shape.ny, shape.nz),
        ));
    }
    Ok(match kind {
        CloudKind::Storm => storm::synth(seed, shape),
        CloudKind::Layer => layer::synth(seed, shape),
    })
}

impl SynthCloud {
    /// The same cloud with the middle of its grid over (x, y), m.
    pub fn centred_on(mut self, [x, y]: [f64; 2]) -> Self {
        for (axis, centre) in [x, y].into_iter().enumerate() {
            self.origin[axis] = centre - 0.5 * self.cell[axis] * self.shape.to_array()[axis] as f64;
        }
        self
    }

    /// Optical depth of every column from top to bottom, x fastest.
    pub fn column_depths(&self) -> Vec<f64> {
        let slab = self.shape.slab_stride();
        (0..slab)
            .map(|column| {
                let sum: f64 = self.density[column..].iter().step_by(slab).map(|&d| f64::from(d)).sum();
                sum * self.cell[2] * self.kappa
            })
            .collect()
    }

    /// Writes `<out>.f32` and `<out>.json` (an `out` that ends in `.json` loses it first); returns the JSON's
    /// path. The scene file has no lights and cameras beyond one of each to try it with.
    pub fn write(&self, out: &Path) -> Result<PathBuf, BakeError> {
        let stem =
            if out.extension().is_some_and(|e| e == "json") { out.with_extension("") } else { out.into() };
        let with = |suffix: &str| {
            let mut name = stem.clone().into_os_string();
            name.push(suffix);
            PathBuf::from(name)
        };
        let (density, scene) = (with(".f32"), with(".json"));
        let Some(name) = density.file_name().and_then(|name| name.to_str()) else {
            return Err(BakeError::input(out, "output", "a file name in Unicode", out.display()));
        };
        let text = self.scene(name);
        write_atomically(&density, |file| {
            let mut bytes = Vec::with_capacity(self.density.len() * 4);
            self.density.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
            std::io::Write::write_all(file, &bytes)
        })?;
        write_atomically(&scene, |file| std::io::Write::write_all(file, text.as_bytes()))?;
        Ok(scene)
    }

    fn scene(&self, density_file: &str) -> String {
        let size = |axis: usize| self.cell[axis] * self.shape.to_array()[axis] as f64;
        let centre: [f64; 3] = std::array::from_fn(|axis| self.origin[axis] + 0.5 * size(axis));
        let kind = match self.kind {
            CloudKind::Storm => "storm",
            CloudKind::Layer => "layer",
        };
        let scene = serde_json::json!({
            "name": format!("{kind}-{}", self.seed),
            "note": format!(
                "squall synth cloud --kind {kind} --seed {} --cells {}x{}x{} --centre {},{}",
                self.seed, self.shape.nx, self.shape.ny, self.shape.nz, centre[0], centre[1],
            ),
            "units": "metres; extinction in 1/m; intensity in W/sr; radiance in W/(m^2 sr)",
            "kappa_per_m": self.kappa,
            "albedo": self.albedo,
            "g": self.asymmetry,
            "density_file": density_file,
            "dims_xyz": self.shape.to_array(),
            "cell_m": self.cell,
            "origin_m": self.origin,
            "interpolation": "nearest (piecewise constant per cell), zero outside the grid",
            "index": "x + nx*(y + ny*z), x fastest, little-endian float32",
            "sigma_t_max_per_m": self.density.iter().fold(0.0f32, |a, &b| a.max(b)) as f64 * self.kappa,
            "lights": [{
                "name": "inside", "type": "point", "position_m": centre, "intensity_W_per_sr": 1.0,
            }],
            "cameras": [{
                "name": "side", "type": "perspective",
                "origin_m": [centre[0], self.origin[1] - 0.75 * size(0), 0.3 * self.origin[2]],
                "target_m": centre, "up": [0.0, 0.0, 1.0],
                "horizontal_fov_deg": 70.0, "width": 96, "height": 64,
            }],
        });
        format!("{scene:#}\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small(kind: CloudKind, seed: u64) -> SynthCloud {
        let cells = match kind {
            CloudKind::Storm => GridShape::new(32, 24, 48),
            CloudKind::Layer => GridShape::new(32, 32, 4),
        };
        synth_cloud(kind, seed, Some(cells)).unwrap()
    }

    #[test]
    fn the_same_seed_gives_the_same_bytes_on_one_thread_and_on_eight() {
        for kind in [CloudKind::Storm, CloudKind::Layer] {
            let on = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| small(kind, 3))
            };
            assert_eq!(on(1), on(8));
            assert_ne!(small(kind, 3).density, small(kind, 4).density);
        }
    }

    #[test]
    fn density_stays_in_its_range_and_reaches_its_top() {
        for kind in [CloudKind::Storm, CloudKind::Layer] {
            let cloud = small(kind, 1);
            assert!(cloud.density.iter().all(|d| (0.0..=1.0).contains(d)));
            assert!(cloud.density.iter().any(|&d| d > 0.8), "{kind:?}");
        }
    }

    #[test]
    fn a_grid_too_coarse_or_too_large_is_refused() {
        assert!(synth_cloud(CloudKind::Storm, 1, Some(GridShape::new(8, 64, 64))).is_err());
        assert!(synth_cloud(CloudKind::Layer, 1, Some(GridShape::new(1 << 14, 1 << 14, 4))).is_err());
        assert!(synth_cloud(CloudKind::Layer, 1, Some(GridShape::new(0, 32, 4))).is_err());
    }

    #[test]
    fn the_layers_median_cloudy_column_has_optical_depth_twenty() {
        /// The normalisation is exact; densities are single-precision.
        const ROUND_OFF: f64 = 1e-4;
        let mut depths = small(CloudKind::Layer, 5).column_depths();
        let clear = depths.iter().filter(|&&depth| depth == 0.0).count();
        assert!(clear > depths.len() / 50, "a broken layer has gaps: {clear}");
        depths.retain(|&depth| depth > 0.0);
        depths.sort_by(f64::total_cmp);
        let median = depths[depths.len() / 2];
        assert!((median / 20.0 - 1.0).abs() < ROUND_OFF, "{median}");
    }

    #[test]
    fn a_storm_is_wide_at_the_anvil_flat_at_the_base_and_empty_at_the_grids_edge() {
        let cloud = small(CloudKind::Storm, 1);
        let [nx, ny, nz] = cloud.shape.to_array();
        let width = |z: usize| {
            (0..nx).filter(|&x| (0..ny).any(|y| cloud.density[cloud.shape.index(x, y, z)] > 0.03)).count()
        };
        let level = |metres: f64| ((metres - cloud.origin[2]) / cloud.cell[2]) as usize;
        assert!(width(level(9_200.0)) as f64 * cloud.cell[0] > 10_000.0, "the anvil spreads");
        assert!(width(level(5_500.0)) < width(level(9_200.0)) * 3 / 4, "the tower is narrower");
        assert_eq!(width(0), 0, "air below the base");
        assert!(width(1) > nx / 5, "a broad base one cell up");
        assert_eq!(width(nz - 1), 0, "air above the top");
        for z in 0..nz {
            for y in 0..ny {
                assert_eq!(cloud.density[cloud.shape.index(0, y, z)], 0.0);
                assert_eq!(cloud.density[cloud.shape.index(nx - 1, y, z)], 0.0);
            }
        }
    }
}
