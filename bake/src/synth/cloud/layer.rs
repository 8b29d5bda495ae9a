//! A broken stratocumulus layer: a flat base, cells of about 500 m, water that grows with height.

use super::{CloudKind, SynthCloud};
use glam::Vec3;
use squall_formats::GridShape;
use squall_runtime::noise::Lattice;

/// Cell size, m.
const CELL: f64 = 50.0;
/// Extinction at density 1, 1/m: some .9 g/m³ of water in drops of 7 µm.
const KAPPA: f64 = 0.2;
/// Median vertical optical depth of the columns that hold cloud.
const MEDIAN_DEPTH: f64 = 20.0;
/// Share of columns without cloud.
const GAPS: f64 = 0.15;

pub fn synth(seed: u64, shape: GridShape) -> SynthCloud {
    let lattice = Lattice::new(squall_runtime::random::hash(&[seed, 0x1A7E]) as u32);
    let [nx, ny, nz] = shape.to_array();
    // How much cloud stands on a spot: open cells with round edges, torn by finer noise.
    let mut thickness: Vec<f32> = (0..nx * ny)
        .map(|column| {
            let p = Vec3::new((column % nx) as f32, (column / nx) as f32, 0.5) * CELL as f32;
            let warp = lattice.fractal(p / 400.0, 2, 0.5) * 120.0;
            let p = p + Vec3::new(warp, -warp, 0.0);
            let cells = 1.0 - lattice.cells(p / 520.0);
            let fine = lattice.fractal(p / 230.0 + Vec3::splat(9.5), 3, 0.6);
            cells + 0.45 * fine
        })
        .collect();
    let mut sorted = thickness.clone();
    sorted.sort_by(f32::total_cmp);
    let gap = sorted[((nx * ny) as f64 * GAPS) as usize];
    let full = sorted[nx * ny - 1];
    thickness.iter_mut().for_each(|t| *t = ((*t - gap) / (full - gap).max(1e-6)).max(0.0));

    let mut density: Vec<f32> = (0..shape.len())
        .map(|index| {
            let [x, y, z] = shape.cell(index);
            let tall = thickness[x + nx * y].sqrt();
            let (low, high) = (z as f32 / nz as f32, (z + 1) as f32 / nz as f32);
            let filled = ((tall - low) / (high - low)).clamp(0.0, 1.0);
            // Water grows linearly from the base up, as in rising saturated air; mixing at the base keeps some.
            let water = 0.25 + 0.75 * 0.5 * (low + high.min(tall.max(low)));
            filled * water * (0.35 + 0.65 * thickness[x + nx * y])
        })
        .collect();
    scale_to_median(&mut density, shape);
    let size = |count: usize| count as f64 * CELL;
    SynthCloud {
        kind: CloudKind::Layer,
        seed,
        shape,
        cell: [CELL; 3],
        origin: [-0.5 * size(nx), -0.5 * size(ny), 0.0],
        density,
        kappa: KAPPA,
        albedo: 0.999,
        asymmetry: 0.85,
    }
}

/// Brings the median over cloudy columns to [`MEDIAN_DEPTH`]; a cell above density 1 is cut there and the
/// rest scaled again until the median holds.
fn scale_to_median(density: &mut [f32], shape: GridShape) {
    let slab = shape.slab_stride();
    for _ in 0..40 {
        let mut depths: Vec<f64> = (0..slab)
            .map(|column| {
                let water: f64 = density[column..].iter().step_by(slab).map(|&d| f64::from(d)).sum();
                water * CELL * KAPPA
            })
            .filter(|&depth| depth > 0.0)
            .collect();
        depths.sort_by(f64::total_cmp);
        let Some(&median) = depths.get(depths.len() / 2) else { return };
        let factor = (MEDIAN_DEPTH / median) as f32;
        density.iter_mut().for_each(|d| *d = (*d * factor).min(1.0));
    }
}
