//! Two products of tables, across × along: the light of a falling drop nearly is one.
//!
//! Alternating least squares: with the tables along held, those across follow from small normal equations,
//! and back. Tables are sampled at the middles of equal cells and read linearly.

use super::Grey;
use squall_formats::section::streak::SeparablePattern;

/// Products of tables: the second corrects what the first cannot.
const RANK: usize = 2;
/// Longest tables across and along: 192 bytes for two products in 8 bits.
const LONGEST: [usize; 2] = [32, 64];
const ROUNDS: usize = 12;
/// Keeps a table that no pixel touches at zero.
const RIDGE: f64 = 1e-9;

/// A sample's place between two neighbouring nodes: index of the first, and the share of the second.
type Place = (usize, f64);

fn places(samples: usize, nodes: usize) -> Vec<Place> {
    let place = |i: usize| {
        let x = ((i as f64 + 0.5) / samples as f64 * nodes as f64 - 0.5).clamp(0.0, (nodes - 1) as f64);
        let index = (x as usize).min(nodes.saturating_sub(2));
        (index, x - index as f64)
    };
    (0..samples).map(place).collect()
}

/// The best sum of two products of tables.
pub fn fit_tables(picture: &Grey) -> SeparablePattern {
    let sides = [picture.width, picture.height];
    let nodes = [0, 1].map(|axis| sides[axis].min(LONGEST[axis]));
    let places = [places(sides[0], nodes[0]), places(sides[1], nodes[1])];
    let read = |table: &[f64], place: Place| {
        table[place.0] + if place.1 > 0.0 { place.1 * (table[place.0 + 1] - table[place.0]) } else { 0.0 }
    };
    // A flat first table, and a second with one zero crossing, are not orthogonal to what is sought.
    let mut tables = [vec![], vec![]];
    tables[1] = vec![vec![1.0; nodes[1]], (0..nodes[1]).map(|i| i as f64 / nodes[1] as f64 - 0.5).collect()];
    for round in 0..2 * ROUNDS {
        let axis = round % 2;
        let held = 1 - axis;
        let held_values: Vec<Vec<f64>> = tables[held]
            .iter()
            .map(|table: &Vec<f64>| places[held].iter().map(|&p| read(table, p)).collect())
            .collect();
        tables[axis] = solve_axis(picture, axis, &held_values, &places[axis], nodes[axis]);
    }
    let [across, along] = tables;
    SeparablePattern { across, along }
}

/// Tables of `axis` that fit best beside the other axis' values, for all products at once.
fn solve_axis(
    picture: &Grey,
    axis: usize,
    held: &[Vec<f64>],
    places: &[Place],
    nodes: usize,
) -> Vec<Vec<f64>> {
    let n = nodes * RANK;
    let (mut matrix, mut right) = (vec![0.0; n * n], vec![0.0; n]);
    // Sums over the held axis do not depend on the place along this one.
    let mut products = [[0.0; RANK]; RANK];
    for (k, row) in products.iter_mut().enumerate() {
        for (l, out) in row.iter_mut().enumerate() {
            *out = held[k].iter().zip(&held[l]).map(|(a, b)| a * b).sum();
        }
    }
    for (i, &(node, share)) in places.iter().enumerate() {
        let ends = [(node, 1.0 - share), ((node + 1).min(nodes - 1), share)];
        for k in 0..RANK {
            let light = |j: usize| {
                let at = if axis == 0 { j * picture.width + i } else { i * picture.width + j };
                f64::from(picture.pixels[at])
            };
            let moment: f64 = held[k].iter().enumerate().map(|(j, value)| value * light(j)).sum();
            for (a, weight_a) in ends {
                right[k * nodes + a] += weight_a * moment;
                for l in 0..RANK {
                    for (b, weight_b) in ends {
                        matrix[(k * nodes + a) * n + l * nodes + b] += weight_a * weight_b * products[k][l];
                    }
                }
            }
        }
    }
    let largest = (0..n).map(|i| matrix[i * n + i]).fold(0.0, f64::max);
    for i in 0..n {
        matrix[i * n + i] += RIDGE * largest + f64::MIN_POSITIVE;
    }
    let solution = super::refine::solve_positive(&mut matrix, right).unwrap_or_else(|| vec![0.0; n]);
    solution.chunks_exact(nodes).map(<[f64]>::to_vec).collect()
}
