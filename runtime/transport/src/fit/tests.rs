use super::*;

/// A ragged cloud in a grid of 8 × 6 × 4 blocks of eight cells.
fn cloud(boundary: Boundary) -> Cloud {
    let shape = GridShape::new(16, 12, 8);
    let dense = |index: usize| {
        let [x, y, z] = shape.cell(index);
        (2..13).contains(&x)
            && (3..11).contains(&y)
            && (1..7).contains(&z)
            && (x * 7 + y * 5 + z * 3) % 11 > 2
    };
    let extinction = (0..shape.len()).map(|i| if dense(i) { 0.004 + 1e-4 * (i % 37) as f32 } else { 0.0 });
    Cloud {
        shape,
        cell_m: [50.0, 60.0, 55.0],
        origin_m: DVec3::new(-500.0, 100.0, 900.0),
        extinction: extinction.collect(),
        albedo: 0.999,
        g: 0.85,
        boundary,
    }
}

fn off(fit: &HatFit, read: &[f32], wanted: &[f32]) -> f64 {
    let cells = fit.weights.iter().zip(read.iter().zip(wanted));
    let sum = cells.fold((0.0, 0.0), |(off, size), (&weight, (&x, &r))| {
        let weight = f64::from(weight);
        {
            let (error, value) = (f64::from(x - r), f64::from(r));
            (off + weight * error * error, size + weight * value * value)
        }
    });
    (sum.0 / sum.1).sqrt()
}

#[test]
fn what_large_cells_can_hold_comes_back_and_of_all_else_a_fit_is_nearer_than_means() {
    /// The least squares' residual, and the pull towards means.
    const HELD: f64 = 5e-2;
    for boundary in [Boundary::Open, Boundary::PeriodicXy] {
        let cloud = cloud(boundary);
        let fit = HatFit::new(&cloud, [2; 3], weights(&cloud, None)).unwrap();
        let large: Vec<f32> = (0..fit.coarse.len()).map(|i| 1.0 + 0.3 * ((i * 29) % 17) as f32).collect();
        let small = fit.read(&large, 1);
        assert!(off(&fit, &fit.read(&fit.fit(&small, 1), 1), &small) < HELD, "{boundary:?}");
        // Light that falls from a place within a cell.
        let lamp = cloud.centre([7, 6, 4]) + DVec3::new(9.0, -4.0, 7.0);
        let light: Vec<f32> = (0..cloud.shape.len())
            .map(|i| (1e4 / (cloud.centre(cloud.shape.cell(i)).distance_squared(lamp) + 900.0)) as f32)
            .collect();
        let means = crate::cloud::CoarseIndex::new(cloud.shape, [2; 3]).means(&light, 1);
        let [fitted, plain] =
            [fit.fit(&light, 1), means].map(|values| off(&fit, &fit.read(&values, 1), &light));
        assert!(fitted < 0.9 * plain, "{fitted} {plain}");
    }
}

#[test]
fn values_of_several_kinds_are_fitted_each_by_itself_and_linearly() {
    /// Two solves' residuals.
    const ROUND_OFF: f32 = 5e-3;
    let cloud = cloud(Boundary::Open);
    let fit = HatFit::new(&cloud, [2, 2, 2], weights(&cloud, None)).unwrap();
    let field = |seed: usize| -> Vec<f32> {
        (0..cloud.shape.len()).map(|i| ((i * seed) % 101) as f32 / 100.0).collect()
    };
    let (a, b) = (field(37), field(53));
    let both: Vec<f32> = a.iter().zip(&b).flat_map(|(&a, &b)| [a, b, 2.0 * a - b]).collect();
    let found = fit.fit(&both, 3);
    let (alone_a, alone_b) = (fit.fit(&a, 1), fit.fit(&b, 1));
    for (cell, row) in found.chunks_exact(3).enumerate() {
        let wanted = [alone_a[cell], alone_b[cell], 2.0 * alone_a[cell] - alone_b[cell]];
        for k in 0..3 {
            assert!((row[k] - wanted[k]).abs() < ROUND_OFF, "{cell}: {row:?} {wanted:?}");
        }
    }
}

#[test]
fn in_a_box_light_that_stays_inside_is_fitted_as_in_the_whole_grid() {
    /// What a fit of light 1 rings to beyond the box.
    const OUTSIDE: f32 = 0.05;
    /// Two solves' residuals.
    const ROUND_OFF: f32 = 2e-3;
    let cloud = cloud(Boundary::Open);
    let fit = HatFit::new(&cloud, [2; 3], weights(&cloud, None)).unwrap();
    let mut light = vec![0.0f32; cloud.shape.len()];
    for (x, y, z) in [(6, 5, 3), (7, 5, 3), (6, 6, 4), (7, 7, 4)] {
        light[cloud.shape.index(x, y, z)] = 1.0;
    }
    let whole = fit.fit(&light, 1);
    let (low, shape) = ([1, 1, 0], GridShape::new(6, 5, 4));
    let mut inside = Vec::new();
    for z in 0..8 {
        for y in 2..12 {
            let start = cloud.shape.index(2, y, z);
            inside.extend_from_slice(&light[start..start + 12]);
        }
    }
    let boxed = fit.within(low, shape).fit(&inside, 1);
    for (index, value) in boxed.iter().enumerate() {
        let [x, y, z] = shape.cell(index);
        let wanted = whole[fit.coarse.index(x + 1, y + 1, z)];
        assert!((value - wanted).abs() < OUTSIDE + ROUND_OFF, "{x} {y} {z}: {value} {wanted}");
    }
}

#[test]
fn the_mean_of_a_reading_is_the_mean_over_the_small_cells() {
    /// Single precision.
    const ROUND_OFF: f32 = 1e-5;
    for (boundary, factors) in [(Boundary::Open, [2, 2, 2]), (Boundary::PeriodicXy, [4, 3, 2])] {
        let fine = Cloud { extinction: vec![0.01; 16 * 12 * 8], ..cloud(boundary) };
        let fit = HatFit::new(&fine, factors, vec![1.0; fine.shape.len()]).unwrap();
        let large: Vec<f32> = (0..fit.coarse.len()).map(|i| ((i * 29) % 17) as f32).collect();
        let wanted = crate::cloud::CoarseIndex::new(fine.shape, factors).means(&fit.read(&large, 1), 1);
        let coarse = fine.coarsened(factors).unwrap();
        let found = mean_of_reading(&coarse, factors, &large, 1);
        let near = |(a, b): (&f32, &f32)| (a - b).abs() < ROUND_OFF * 17.0;
        assert!(found.iter().zip(&wanted).all(near), "{boundary:?}");
    }
}

#[test]
fn blocks_that_do_not_divide_the_grid_are_refused() {
    let cloud = cloud(Boundary::Open);
    let cells = cloud.shape.len();
    assert!(HatFit::new(&cloud, [3, 2, 2], vec![1.0; cells]).is_err());
    assert!(HatFit::new(&cloud, [2, 0, 2], vec![1.0; cells]).is_err());
}
