//! Assets that mean something, made from any bytes: each number in its range, and now and then at an end of it.

use arbitrary::{Result, Unstructured};
use squall_formats::GridShape;
use squall_formats::basis::DirectionalBasis;
use squall_formats::container::{OutSection, write};
use squall_formats::light_grid::LightGrid;
use squall_formats::section::bolt::StrokeRecord;
use squall_formats::section::cloud::{CloudHead, CloudSection};
use squall_formats::section::response::{
    self, Codec, CoefficientBound, DirectTerm, DistantKind, DistantSource, NO_ROW, ResponseHead,
    ResponseRows, SolverRecord, SourceBasis, StreamWriter, SweepScheme, pack_seen,
};
use squall_formats::view_region::ViewRegion;
use squall_runtime::Asset;

/// A number in `low`…`high`: an end or the middle now and then, else anywhere.
pub fn number(u: &mut Unstructured<'_>, low: f64, high: f64) -> Result<f64> {
    Ok(match u.arbitrary::<u8>()? {
        0..8 => low,
        8..16 => high,
        16..20 => low + 1e-9 * (high - low),
        20..24 => 0.5 * (low + high),
        _ => low + (high - low) * f64::from(u.arbitrary::<u16>()?) / 65_535.0,
    })
}

/// Three of them.
pub fn numbers(u: &mut Unstructured<'_>, low: f64, high: f64) -> Result<[f64; 3]> {
    Ok([number(u, low, high)?, number(u, low, high)?, number(u, low, high)?])
}

fn axis(u: &mut Unstructured<'_>, low: f64, high: f64) -> Result<Vec<f64>> {
    let count = u.int_in_range(1..=4)?;
    let mut nodes: Vec<f64> = (0..count).map(|_| number(u, low, high)).collect::<Result<_>>()?;
    nodes.sort_by(f64::total_cmp);
    nodes.dedup();
    Ok(nodes)
}

/// A cloud grid of a few cells.
pub fn cloud(u: &mut Unstructured<'_>) -> Result<(CloudHead, Vec<f32>)> {
    let mut count = || u.int_in_range(1..=6u32);
    let shape = GridShape::new(count()?, count()?, count()?);
    let head = CloudHead {
        shape,
        cell_m: numbers(u, 0.5, 500.0)?,
        origin_m: numbers(u, -2000.0, 2000.0)?,
        albedo: number(u, 0.0, 1.0)?,
        g: number(u, -0.99, 0.99)?,
        periodic_xy: u.arbitrary()?,
    };
    let values = (0..shape.len()).map(|_| {
        let clear = u.ratio(1, 3)?;
        Ok(if clear { 0.0 } else { number(u, 0.0, 0.5)? as f32 })
    });
    Ok((head, values.collect::<Result<_>>()?))
}

/// A response of that grid, rows and all.
pub fn response(u: &mut Unstructured<'_>, cloud: &CloudHead) -> Result<OutSection> {
    let far: [f64; 3] =
        std::array::from_fn(|k| cloud.origin_m[k] + cloud.cell_m[k] * cloud.shape.to_array()[k] as f64);
    let mut side = |k: usize| axis(u, cloud.origin_m[k] - 300.0, far[k] + 100.0);
    let grid = LightGrid { x_m: side(0)?, y_m: side(1)?, z_m: side(2)? };
    let mut rows = Vec::new();
    let mut count = 0;
    for _ in 0..grid.len() {
        let has = u.ratio(9, 10)?;
        rows.push(if has { count } else { NO_ROW });
        count += u32::from(has);
    }
    let basis = match u.int_in_range(0..=2)? {
        0 => DirectionalBasis::Directions26,
        1 => DirectionalBasis::Harmonics { degree: u.int_in_range(0..=3)? },
        _ => DirectionalBasis::ViewRegion { degree: u.int_in_range(0..=2)? },
    };
    let needs_region = matches!(basis, DirectionalBasis::ViewRegion { .. });
    let view_region = if needs_region || u.ratio(1, 4)? {
        let (low, size) = (numbers(u, -5000.0, 5000.0)?, numbers(u, 0.0, 3000.0)?);
        Some(ViewRegion { low_m: low, high_m: std::array::from_fn(|k| low[k] + size[k]) })
    } else {
        None
    };
    let mut distant = Vec::new();
    for kind in
        [DistantKind::UpperSky, DistantKind::LowerSky, DistantKind::Beam { direction: [0.8, 0.0, -0.6] }]
    {
        if u.arbitrary()? {
            distant.push(DistantSource { kind, row: count });
            count += 1;
        }
    }
    let codec = *u.choose(&[Codec::Bytes, Codec::Paper, Codec::Entropy])?;
    let cells = cloud.shape.len();
    let head = ResponseHead {
        shape: cloud.shape,
        sources: SourceBasis::LightGrid { grid, rows },
        distant,
        basis,
        direct: if needs_region || u.arbitrary()? { DirectTerm::AtRunTime } else { DirectTerm::InRows },
        codec,
        solver: SolverRecord {
            refine: [1; 3],
            directions: [2, 8],
            scheme: SweepScheme::Weighted,
            extinction_scale: number(u, 0.01, 1.0)?,
            tolerance: 1e-3,
            worst_residual: 1e-3,
            most_sweeps: 9,
        },
        view_region,
        seen: if u.ratio(1, 3)? {
            let seen: Vec<bool> = (0..cells).map(|_| u.arbitrary()).collect::<Result<_>>()?;
            Some(pack_seen(&seen))
        } else {
            None
        },
        sun: None,
        entropy: None,
        stored: Default::default(),
        finer: Vec::new(),
    };
    let rows: Vec<Vec<u8>> =
        (0..count).map(|_| row(u, codec, basis.count(), cells)).collect::<Result<_>>()?;
    let bounds = vec![CoefficientBound { discarded: 0.5, quantised: 0.25 }; basis.count() * rows.len()];
    Ok(response::write(&head, ResponseRows { rows, bounds }))
}

fn row(u: &mut Unstructured<'_>, codec: Codec, coefficients: usize, cells: usize) -> Result<Vec<u8>> {
    let (mut heads, mut streams) = (Vec::new(), Vec::new());
    for _ in 0..coefficients {
        let mut stream = Vec::new();
        let mut writer = StreamWriter::default();
        for index in 1..cells {
            if u.ratio(3, 4)? {
                continue;
            }
            let value = number(u, -10.0, 10.0)? as f32;
            match codec {
                Codec::Paper => {
                    stream.extend((index as u32).to_le_bytes());
                    stream.extend(value.to_le_bytes());
                }
                Codec::Bytes | Codec::Entropy if u.ratio(1, 8)? => writer.large(index, value),
                Codec::Bytes | Codec::Entropy => writer.small(index, u.int_in_range(-127..=127)?),
            }
        }
        stream.extend(writer.take());
        heads.extend((number(u, -5.0, 50.0)? as f32).to_le_bytes());
        heads.extend((number(u, 0.0, 0.1)? as f32).to_le_bytes());
        heads.extend((stream.len() as u32).to_le_bytes());
        streams.extend(stream);
    }
    heads.extend(streams);
    Ok(heads)
}

/// A stroke near that cloud.
pub fn stroke(u: &mut Unstructured<'_>, name: &str, cloud: &CloudHead) -> Result<StrokeRecord> {
    let mut record = StrokeRecord::usual();
    record.name = name.into();
    record.seed = u.arbitrary()?;
    let point = |u: &mut Unstructured<'_>| -> Result<[f64; 3]> {
        let mut at = [0.0; 3];
        for (k, at) in at.iter_mut().enumerate() {
            let size = cloud.cell_m[k] * cloud.shape.to_array()[k] as f64;
            *at = number(u, cloud.origin_m[k] - 0.2 * size - 50.0, cloud.origin_m[k] + 1.2 * size)?;
        }
        Ok(at)
    };
    (record.from_m, record.to_m) = (point(u)?, point(u)?);
    record.segment_m = record.length() * number(u, 1.0 / 64.0, 1.0)?;
    record.wander = number(u, 0.0, 1.0)?;
    record.branching = number(u, 0.0, 0.5)?;
    record.max_order = u.int_in_range(0..=3)?;
    record.turn_rad = number(u, 0.0, 1.2)?;
    record.intensity_w_per_sr = number(u, 0.0, 1e9)?;
    Ok(record)
}

/// An asset of these sections. Panics when it does not open: the generators above keep to the specification.
pub fn asset(sections: &[OutSection]) -> Asset {
    let mut bytes = Vec::new();
    write(&mut bytes, sections).expect("memory takes what is written to it");
    Asset::from_bytes(&bytes).unwrap_or_else(|error| panic!("the generator made no asset: {error}"))
}

/// The section of a cloud.
pub fn cloud_section(head: &CloudHead, extinction: &[f32]) -> OutSection {
    CloudSection::write_smallest(head, extinction)
}
