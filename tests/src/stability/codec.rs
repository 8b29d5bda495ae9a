//! Compression at the edges of its range: budgets, magnitudes, sizes.

use squall_bake::compress::compress_row;
use squall_formats::GridShape;
use squall_formats::haar::Haar;
use squall_formats::section::response::{Codec, RowCode, accumulate, coefficient_planes};
use squall_runtime::random::Random;

#[test]
fn coefficients_beyond_the_quantisers_range_are_kept_as_they_are() {
    const CELLS: usize = 600;
    println!("| largest over median | budget | kept | bytes | error over budget |");
    for largest in [1.0f32, 1e3, 1e9, 1e20, 1e30, 3e38] {
        for error in [0.0, 1e-6, 1e-3, 0.1, 0.5, 0.999_999, 1.0, 1e300] {
            let mut random = Random::new(9);
            let mut values: Vec<f32> = (0..2 * CELLS).map(|_| random.normal() as f32).collect();
            values[7] = largest;
            values[CELLS + 3] = -largest;
            values[CELLS + 9] = f32::MIN_POSITIVE * 1e-3;
            for codec in [Codec::Bytes, Codec::Paper] {
                let row = compress_row(&values, 2, codec, error);
                let mut back = vec![0.0; 2 * CELLS];
                for (channel, plane) in
                    coefficient_planes(&row.bytes, 2).unwrap().iter().zip(back.chunks_exact_mut(CELLS))
                {
                    accumulate(channel, &RowCode::plain(codec), 1.0, plane).unwrap();
                }
                let norm = |f: &dyn Fn(usize) -> f64| (0..2 * CELLS).map(|i| f(i) * f(i)).sum::<f64>().sqrt();
                let off = norm(&|i| f64::from(values[i]) - f64::from(back[i]));
                let all = norm(&|i| f64::from(values[i]));
                assert!(off <= error * all * (1.0 + 1e-6), "{largest} {error} {codec:?}: {off} of {all}");
                if codec == Codec::Bytes && largest >= 1e3 && (error - 1e-3).abs() < 1e-9 {
                    println!(
                        "| {largest:e} | {error} | {} | {} | {:.2} |",
                        row.kept,
                        row.bytes.len(),
                        off / (error * all)
                    );
                }
            }
        }
    }
}

#[test]
fn haar_of_any_size_gives_the_grid_back_and_keeps_its_energy() {
    println!("| size | largest error over largest value | energy − 1 |");
    let sizes = [
        [1, 1, 1],
        [2, 1, 1],
        [1, 3, 1],
        [1, 1, 7],
        [5, 3, 2],
        [31, 17, 3],
        [33, 65, 5],
        [127, 1, 2],
        [97, 89, 3],
        [1, 1, 4097],
    ];
    for size in sizes {
        let shape = GridShape::new(size[0], size[1], size[2]);
        let (haar, mut scratch, mut random) = (Haar::new(shape), Vec::new(), Random::new(3));
        let values: Vec<f32> = (0..shape.len()).map(|_| libm::exp(8.0 * random.normal()) as f32).collect();
        let mut turned = values.clone();
        haar.forward(&mut turned, &mut scratch);
        let energy = |values: &[f32]| values.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>();
        let ratio = energy(&turned) / energy(&values) - 1.0;
        let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / (shape.len() as f64).sqrt();
        assert!((f64::from(turned[0]) / mean - 1.0).abs() < 1e-5);
        haar.inverse(&mut turned, &mut scratch);
        let largest = values.iter().fold(0.0f32, |a, &b| a.max(b));
        let error = turned.iter().zip(&values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) / largest;
        println!("| {size:?} | {error:.1e} | {ratio:+.1e} |");
        // Some twenty rotations in single precision.
        assert!(error < 2e-6 && ratio.abs() < 2e-6, "{size:?}: {error} {ratio}");
    }
}
