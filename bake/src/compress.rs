//! Which Haar coefficients of a source survive, and how they are written. \[dobashi\] §6.
//!
//! The threshold ξ is no number for the user to guess: it follows from how far a source's light may be off, relative to
//! its own norm over cells and coefficients. One threshold serves all planes of a source, because a coefficient left out costs
//! its square wherever it stands. Precision narrows here and nowhere before.

use squall_formats::section::response::{Codec, CoefficientBound, StreamWriter};

/// Width of a quantiser step as a share of ξ: values near ξ are coarse, but they are also what the budget already gives up. Where every value
/// takes two bytes a finer step costs nothing; where rare ones take more bits, steps as wide as ξ take 2.5 % fewer bytes for the same error
/// (the storm for flashes anywhere, error .2).
fn step_per_threshold(codec: Codec) -> f32 {
    match codec {
        Codec::Paper => 0.0,
        Codec::Bytes => 0.75,
        Codec::Entropy => 1.0,
    }
}

/// One source, compressed.
#[derive(Clone, Debug, PartialEq)]
pub struct CompressedRow {
    /// As it lies in section `CLRT`.
    pub bytes: Vec<u8>,
    /// One bound a plane.
    pub bounds: Vec<CoefficientBound>,
    /// Coefficients kept, means not counted.
    pub kept: usize,
    /// The threshold that came out.
    pub threshold: f32,
}

/// What an error in each plane of a row counts for: thresholds and steps are wider where it counts for less.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaneWeights(Vec<f32>);

impl PlaneWeights {
    /// All planes alike.
    pub fn even(planes: usize) -> Self {
        Self(vec![1.0; planes])
    }

    /// Those of light in harmonics of degree 1 that a gather scatters on: its error in degree 1 comes out multiplied by the phase
    /// function's first moment after delta scaling, (g − f) / (1 − f) with f = (1 − extinction scale) / albedo, relative to that of degree 0.
    ///
    /// ```
    /// use squall_bake::compress::PlaneWeights;
    /// // f = g² where light is solved for with sources of degree 1: g / (1 + g).
    /// let (g, albedo) = (0.85, 0.999);
    /// let weights = PlaneWeights::for_gathers(g, albedo, 1.0 - albedo * g * g);
    /// assert!((weights.of(1) - 0.85 / 1.85).abs() < 1e-6 && weights.of(0) == 1.0);
    /// ```
    pub fn for_gathers(g: f64, albedo: f64, extinction_scale: f64) -> Self {
        let forward = if albedo > 0.0 { (1.0 - extinction_scale) / albedo } else { 0.0 };
        let first = if forward < 1.0 { ((g - forward) / (1.0 - forward)).abs() } else { 1.0 };
        // What is scattered evenly passes no flux on; a viewer without gathers still reads it.
        let first = first.clamp(LEAST_WEIGHT, 1.0) as f32;
        Self(vec![1.0, first, first, first])
    }

    /// Weight of plane `plane`, above 0; 1 of planes that there is none for.
    pub fn of(&self, plane: usize) -> f32 {
        self.0.get(plane).copied().unwrap_or(1.0)
    }
}

/// Least weight of degree 1: below it a picture without a gather would lose its directions altogether.
const LEAST_WEIGHT: f64 = 0.1;

/// Bins of coefficient magnitude: sixteen to each power of two.
const BIN_SHIFT: u32 = 19;
const BINS: usize = 1 << (31 - BIN_SHIFT);

fn bin(value: f32) -> usize {
    (value.to_bits() & 0x7fff_ffff) as usize >> BIN_SHIFT
}

fn lower_edge(bin: usize) -> f32 {
    f32::from_bits((bin as u32) << BIN_SHIFT)
}

/// Compresses the planes of one source so that the root of all squared errors stays at or below `relative_error` times the
/// root of all squared values, each plane's multiplied by its weight.
///
/// Rows of codec `Entropy` come as `Bytes` has them: the section that they go into codes them over all rows.
/// `coefficients` holds `planes` planes from [`squall_formats::haar::Haar::forward`]. With codec `Paper` nothing is quantised.
/// `relative_error` 0 keeps every coefficient that is not zero.
pub fn compress_row(coefficients: &[f32], planes: usize, codec: Codec, relative_error: f64) -> CompressedRow {
    compress_weighted_row(coefficients, &PlaneWeights::even(planes), planes, codec, relative_error)
}

/// [`compress_row`] with a weight a plane. The bounds that come with the row are of the planes themselves.
pub fn compress_weighted_row(
    coefficients: &[f32],
    weights: &PlaneWeights,
    planes: usize,
    codec: Codec,
    relative_error: f64,
) -> CompressedRow {
    let cells = coefficients.len() / planes;
    let mut energy = vec![0.0f64; BINS];
    let mut count = vec![0usize; BINS];
    let mut total = 0.0;
    for (at, plane) in coefficients.chunks_exact(cells).enumerate() {
        let weight = weights.of(at);
        total += square(weight * plane[0]);
        for &value in &plane[1..] {
            let value = weight * value;
            total += square(value);
            energy[bin(value)] += square(value);
            count[bin(value)] += 1;
        }
    }
    let budget = relative_error * relative_error * total;
    let all: usize = count.iter().sum();
    // The highest bin edge whose estimated error fits; what follows measures it and steps down if the estimate was rosy.
    let (mut dropped, mut below, mut edge) = (0.0, 0usize, 0usize);
    for candidate in 0..BINS - 1 {
        dropped += energy[candidate];
        below += count[candidate];
        let quantised = match codec {
            Codec::Paper => 0.0,
            Codec::Bytes | Codec::Entropy => {
                let step = f64::from(lower_edge(candidate + 1) * step_per_threshold(codec));
                (all - below) as f64 * step * step / 12.0
            }
        };
        if dropped + quantised > budget {
            break;
        }
        edge = candidate + 1;
        // Nothing is left to leave out; the edges beyond end in infinities, which no step may be.
        if below == all {
            break;
        }
    }
    loop {
        let row = write_row(coefficients, weights, cells, codec, lower_edge(edge));
        let off = |(at, bound): (usize, &CoefficientBound)| {
            square(weights.of(at)) * (square(bound.discarded) + square(bound.quantised))
        };
        let error: f64 = row.bounds.iter().enumerate().map(off).sum();
        if error <= budget || edge == 0 {
            return row;
        }
        edge -= 1;
    }
}

/// The same with the threshold given: coefficients of that magnitude over their plane's weight and above are kept. A threshold of 0 keeps
/// all that are not zero.
pub fn compress_row_at(
    coefficients: &[f32],
    weights: &PlaneWeights,
    planes: usize,
    codec: Codec,
    threshold: f32,
) -> CompressedRow {
    write_row(coefficients, weights, coefficients.len() / planes, codec, threshold)
}

fn square(value: f32) -> f64 {
    f64::from(value) * f64::from(value)
}

/// Writes all planes with threshold ξ: coefficients of magnitude ξ over the plane's weight and above are kept.
fn write_row(
    coefficients: &[f32],
    weights: &PlaneWeights,
    cells: usize,
    codec: Codec,
    row_threshold: f32,
) -> CompressedRow {
    let (mut heads, mut streams) = (Vec::new(), Vec::new());
    let (mut bounds, mut kept) = (Vec::new(), 0);
    let mut writer = StreamWriter::default();
    for (at, plane) in coefficients.chunks_exact(cells).enumerate() {
        let threshold = row_threshold / weights.of(at);
        // A threshold of 0 keeps all that is not zero; the step then has to be something else.
        let step = threshold * step_per_threshold(codec);
        // A step whose largest multiple is no number is none: coefficients that large are kept as they are.
        let step = if (step * 127.0).is_finite() { step } else { 0.0 };
        let (mut discarded, mut quantised) = (0.0f64, 0.0f64);
        let mut paper = Vec::new();
        for (index, &value) in plane.iter().enumerate().skip(1) {
            if value == 0.0 || value.abs() < threshold {
                discarded += square(value);
                continue;
            }
            kept += 1;
            match codec {
                Codec::Paper => {
                    paper.extend_from_slice(&(index as u32).to_le_bytes());
                    paper.extend_from_slice(&value.to_le_bytes());
                }
                Codec::Bytes | Codec::Entropy => {
                    let steps = (value / step).round();
                    if step > 0.0 && steps.abs() <= 127.0 {
                        writer.small(index, steps as i8);
                        quantised += square(value - steps * step);
                    } else {
                        writer.large(index, value);
                    }
                }
            }
        }
        let stream = if codec == Codec::Paper { paper } else { writer.take() };
        heads.extend_from_slice(&plane[0].to_le_bytes());
        heads.extend_from_slice(&step.to_le_bytes());
        heads.extend_from_slice(&(stream.len() as u32).to_le_bytes());
        streams.extend_from_slice(&stream);
        bounds.push(CoefficientBound { discarded: round_up(discarded), quantised: round_up(quantised) });
    }
    heads.extend_from_slice(&streams);
    CompressedRow { bytes: heads, bounds, kept, threshold: row_threshold }
}

/// Root of a sum of squares as an f32 that is not below it.
fn round_up(sum: f64) -> f32 {
    let root = libm::sqrt(sum);
    let narrow = root as f32;
    if f64::from(narrow) < root { narrow.next_up() } else { narrow }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use squall_formats::section::response::{RowCode, accumulate, coefficient_planes};

    fn decode(row: &CompressedRow, count: usize, cells: usize, codec: Codec) -> Vec<f32> {
        let mut out = vec![0.0; count * cells];
        for (coded, plane) in
            coefficient_planes(&row.bytes, count).unwrap().iter().zip(out.chunks_exact_mut(cells))
        {
            accumulate(coded, &RowCode::plain(codec), 1.0, plane).unwrap();
        }
        out
    }

    /// Values over many powers of two, as Haar coefficients have them.
    fn planes() -> impl Strategy<Value = Vec<f32>> {
        let value = (-1.0f32..1.0, -20i32..6).prop_map(|(m, e)| m * libm::exp2f(e as f32));
        proptest::collection::vec(value, 3 * 700)
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back_within_its_bounds_and_the_budget(
            values in planes(),
            error in prop_oneof![Just(0.0), 1e-5f64..0.5],
            codec in prop_oneof![Just(Codec::Paper), Just(Codec::Bytes)],
        ) {
            let row = compress_row(&values, 3, codec, error);
            let back = decode(&row, 3, 700, codec);
            let mut total_error = 0.0;
            for ((plane, read), bound) in values.chunks(700).zip(back.chunks(700)).zip(&row.bounds) {
                let squared: f64 = plane.iter().zip(read).map(|(a, b)| square(a - b)).sum();
                // Adding the read value to zero rounds nothing; the product with the step may, in its last bit.
                prop_assert!(libm::sqrt(squared) <= f64::from(bound.total()) * (1.0 + 1e-6));
                total_error += squared;
            }
            let total: f64 = values.iter().map(|&v| square(v)).sum();
            prop_assert!(total_error <= error * error * total * (1.0 + 1e-6));
        }
    }

    #[test]
    fn a_plane_that_counts_for_less_keeps_less_and_the_weighted_error_stays_within_the_budget() {
        const ERROR: f64 = 0.1;
        let plane: Vec<f32> =
            (0..512).map(|i| libm::expf(-(i as f32) * 0.02) * ((i * 37) % 11 + 1) as f32).collect();
        let planes: Vec<f32> = plane.repeat(4);
        let kept = |row: &CompressedRow, at: usize| {
            decode(row, 4, 512, Codec::Bytes)[512 * at..][..512].iter().filter(|value| **value != 0.0).count()
        };
        let even = compress_row(&planes, 4, Codec::Bytes, ERROR);
        let weights = PlaneWeights::for_gathers(0.85, 1.0, 1.0 - 0.85 * 0.85);
        let weighted = compress_weighted_row(&planes, &weights, 4, Codec::Bytes, ERROR);
        assert_eq!(kept(&even, 0), kept(&even, 1));
        assert!(kept(&weighted, 1) < kept(&weighted, 0), "{} {}", kept(&weighted, 1), kept(&weighted, 0));
        let read = decode(&weighted, 4, 512, Codec::Bytes);
        let (mut off, mut size) = (0.0, 0.0);
        for (at, (value, read)) in planes.iter().zip(&read).enumerate() {
            let weight = f64::from(weights.of(at / 512));
            let wrong = weight * f64::from(value - read);
            off += wrong * wrong;
            let whole = weight * f64::from(*value);
            size += whole * whole;
        }
        assert!(off <= ERROR * ERROR * size * (1.0 + 1e-6));
    }

    #[test]
    fn a_source_without_light_takes_no_stream() {
        for codec in [Codec::Paper, Codec::Bytes] {
            let row = compress_row(&[0.0; 64], 2, codec, 0.01);
            assert_eq!((row.kept, row.bytes.len()), (0, 2 * 12));
            assert_eq!(decode(&row, 2, 32, codec), vec![0.0; 64]);
        }
    }

    #[test]
    fn a_budget_of_all_the_light_leaves_the_means() {
        let values: Vec<f32> = (0..64).map(|i| (i % 32 + 1) as f32).collect();
        for codec in [Codec::Paper, Codec::Bytes] {
            for error in [1.0, 10.0] {
                let row = compress_row(&values, 2, codec, error);
                assert_eq!((row.kept, row.bytes.len()), (0, 2 * 12));
                let wanted: Vec<f32> = (0..64).map(|i| if i % 32 == 0 { 1.0 } else { 0.0 }).collect();
                assert_eq!(decode(&row, 2, 32, codec), wanted);
                // 2² + … + 32².
                assert_eq!(row.bounds[0], CoefficientBound { discarded: 11439f32.sqrt(), quantised: 0.0 });
            }
        }
    }

    #[test]
    fn a_larger_budget_never_takes_more_bytes() {
        let values: Vec<f32> =
            (0..4096).map(|i| libm::expf(-(i as f32) * 0.004) * ((i * 7919) % 13) as f32).collect();
        let size = |error| compress_row(&values, 1, Codec::Bytes, error).bytes.len();
        assert!(size(0.001) > size(0.01) && size(0.01) > size(0.1));
    }
}
