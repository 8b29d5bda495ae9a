use super::*;
use crate::section::response::head::Codec;
use crate::section::response::stream::{CoefficientPlane, RowCode, StreamWriter, coefficient_planes, walk};

const CELLS: usize = 40_000;
const PLANES: usize = 2;

/// Numbers that look drawn, the same each time.
struct Draw(u64);

impl Draw {
    fn below(&mut self, most: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % most
    }
}

/// Rows of codec `Bytes`: mostly small values near each other, some far, some large, some planes empty.
fn rows(count: usize, most_gap: u64) -> Vec<Vec<u8>> {
    let mut draw = Draw(3);
    let row = |row: usize, draw: &mut Draw| {
        let (mut heads, mut streams) = (Vec::new(), Vec::new());
        for plane in 0..PLANES {
            let mut writer = StreamWriter::default();
            let mut index = 0;
            // One plane in five of each holds nothing.
            let held = row % 5 != plane;
            loop {
                let gap = if draw.below(9) == 0 { draw.below(most_gap) } else { draw.below(3) };
                index += 1 + gap as usize;
                if !held || index >= CELLS / 4 {
                    break;
                }
                match draw.below(50) {
                    0 => writer.large(index, draw.below(1000) as f32 * 1e5 - 3e7),
                    1 => writer.small(index, [127, -127][draw.below(2) as usize]),
                    _ => writer.small(index, [1, -1, 2, -2, 3, -5][draw.below(6) as usize]),
                }
            }
            let stream = writer.take();
            heads.extend((row as f32).to_le_bytes());
            heads.extend(0.5f32.to_le_bytes());
            heads.extend((stream.len() as u32).to_le_bytes());
            streams.extend(stream);
        }
        heads.extend(streams);
        heads
    };
    (0..count).map(|at| row(at, &mut draw)).collect()
}

type Found = Vec<(f32, f32, Vec<(usize, u32)>)>;

/// Everything that a row holds.
fn held(row: &[u8], code: &RowCode, cells: usize) -> Found {
    let plane = |plane: &CoefficientPlane<'_>| {
        let mut list = Vec::new();
        let read = walk(plane, code, cells, |index, coefficient| {
            let value = match coefficient {
                Coefficient::Steps(steps) => f32::from(steps) * plane.step,
                Coefficient::Exact(value) => value,
            };
            // Codec `Bytes` moves on over wide gaps by values of 0.
            if value != 0.0 {
                list.push((index, value.to_bits()));
            }
        });
        read.unwrap();
        (plane.mean, plane.step, list)
    };
    coefficient_planes(row, PLANES).unwrap().iter().map(plane).collect()
}

fn code(record: &EntropyRecord, rows: &[Vec<u8>]) -> RowCode {
    let bytes = rows.iter().map(|row| row.len() as u64).sum();
    RowCode::new(Codec::Entropy, Some(record), CELLS, bytes).unwrap()
}

#[test]
fn every_row_comes_back_to_the_bit_and_is_shorter() {
    for (count, gap) in [(40, 60), (7, 2000), (60, 2)] {
        let given = rows(count, gap);
        let (record, coded) = transcoded(&given, &|_| CELLS, (CELLS, PLANES)).unwrap();
        let code = code(&record, &coded);
        for (given, coded) in given.iter().zip(&coded) {
            assert_eq!(held(given, &RowCode::plain(Codec::Bytes), CELLS), held(coded, &code, CELLS));
        }
        let length = |rows: &[Vec<u8>]| rows.iter().map(Vec::len).sum::<usize>();
        assert!(3 * length(&coded) < 2 * length(&given), "{} {}", length(&coded), length(&given));
    }
}

#[test]
fn values_take_as_many_bits_as_they_are_rare() {
    // Each place has 1, −1, 2 or −2, evenly: two bits, and the commonest gap.
    let mut draw = Draw(1);
    let mut writer = StreamWriter::default();
    (1..CELLS).for_each(|index| writer.small(index, [1, -1, 2, -2][draw.below(4) as usize]));
    let stream = writer.take();
    let mut row: Vec<u8> =
        [1.0f32.to_le_bytes(), 1.0f32.to_le_bytes(), (stream.len() as u32).to_le_bytes()].concat();
    row.extend(stream);
    let (_, coded) = transcoded(&[row], &|_| CELLS, (CELLS, 1)).unwrap();
    // Two bits each and the least that a gap takes, 12 bytes of head, 7 of count and state; shares of 4096 are right to a thousandth.
    let gap = -libm::log2(f64::from(LARGEST_GAP_SHARE) / f64::from(SHARES));
    let ideal = (CELLS - 1) as f64 * (2.0 + gap) / 8.0 + 19.0;
    assert!((coded[0].len() as f64 / ideal - 1.0).abs() < 1e-3, "{} {ideal}", coded[0].len());
}

#[test]
fn rows_of_windows_count_cells_and_rows_of_the_grid_count_places() {
    let mut given = rows(30, 40);
    given.push(rows(31, 40).pop().unwrap());
    let window = CELLS / 2;
    let cells = |row: usize| if row == 30 { window } else { CELLS };
    let (record, coded) = transcoded(&given, &cells, (CELLS, PLANES)).unwrap();
    assert!(record.places.is_some());
    let code = code(&record, &coded);
    for (row, (given, coded)) in given.iter().zip(&coded).enumerate() {
        let plain = RowCode::plain(Codec::Bytes);
        assert_eq!(held(given, &plain, cells(row)), held(coded, &code, cells(row)), "{row}");
    }
}

#[test]
fn nothing_is_coded_where_that_is_no_shorter() {
    // Tables take more than three coefficients.
    let mut writer = StreamWriter::default();
    (1..4).for_each(|index| writer.small(9 * index, index as i8));
    let stream = writer.take();
    let mut row: Vec<u8> =
        [1.0f32.to_le_bytes(), 1.0f32.to_le_bytes(), (stream.len() as u32).to_le_bytes()].concat();
    row.extend(stream);
    assert!(transcoded(&[row], &|_| CELLS, (CELLS, 1)).is_none());
}

#[test]
fn spoilt_streams_and_tables_end_in_an_answer() {
    let given = rows(12, 60);
    let (record, coded) = transcoded(&given, &|_| CELLS, (CELLS, PLANES)).unwrap();
    let sound = code(&record, &coded);
    let mut draw = Draw(9);
    let mut refused = 0;
    for _ in 0..2000 {
        let mut row = coded[1].clone();
        let at = 12 * PLANES + draw.below((row.len() - 12 * PLANES) as u64) as usize;
        row[at] ^= 1 << draw.below(8);
        for plane in coefficient_planes(&row, PLANES).unwrap() {
            refused += u32::from(walk(&plane, &sound, CELLS, |index, _| assert!(index < CELLS)).is_err());
        }
    }
    // The state at the end tells nearly every change but those within a number that is written as it is.
    assert!(refused > 1500, "{refused}");
    let spoilt = |change: &dyn Fn(&mut EntropyRecord)| {
        let mut record = record.clone();
        change(&mut record);
        RowCode::new(Codec::Entropy, Some(&record), CELLS, 1000).unwrap_err().to_string()
    };
    assert!(spoilt(&|record| record.gaps[0] -= 1).contains("4096"));
    assert!(spoilt(&|record| record.values[1] = vec![1; 300]).contains("300 symbols"));
    assert!(spoilt(&|record| record.places.as_mut().unwrap().truncate(9)).contains("cut off"));
    // A count beyond what rows can use is refused before anything is read.
    assert!(spoilt(&|record| record.places = Some(vec![0xff, 0xff, 0xff, 0xff, 0x7f])).contains("places"));
    let none = RowCode::new(Codec::Entropy, None, CELLS, 1000);
    assert!(none.unwrap_err().to_string().contains("codec"));
}

#[test]
fn rows_that_are_all_alike_stay_within_the_bound_of_coefficients_per_byte() {
    // A step of 1 in every cell: the commonest gap and value are the only ones.
    const CELLS: usize = 4097;
    let one = |mean: f32| {
        let mut writer = StreamWriter::default();
        (1..CELLS).for_each(|index| writer.small(index, 1));
        let stream = writer.take();
        let mut row = Vec::new();
        for _ in 0..PLANES {
            row.extend(mean.to_le_bytes());
            row.extend(1.0f32.to_le_bytes());
            row.extend((stream.len() as u32).to_le_bytes());
        }
        (0..PLANES).for_each(|_| row.extend(&stream));
        row
    };
    let rows: Vec<Vec<u8>> = (0..20).map(|at| one(at as f32)).collect();
    let Some((record, coded)) = transcoded(&rows, &|_| CELLS, (CELLS, PLANES)) else {
        panic!("rows that are all alike are shorter coded")
    };
    assert!(record.gaps.iter().all(|&share| share <= LARGEST_GAP_SHARE));
    let code = code(&record, &coded);
    for (plain, row) in rows.iter().zip(&coded) {
        assert_eq!(held(plain, &RowCode::plain(Codec::Bytes), CELLS), held(row, &code, CELLS));
    }
}

#[test]
fn a_stream_that_says_more_coefficients_than_its_bytes_can_hold_is_refused() {
    // One symbol with all shares takes no bits at all: eight bytes could say any count.
    let all = vec![SHARES as u16];
    let record = EntropyRecord {
        gaps: all.clone(),
        values: [all.clone(), all.clone(), all],
        ..EntropyRecord::default()
    };
    let cells = 1 << 28;
    let tables = EntropyTables::new(&record, cells, 1 << 20).unwrap();
    let mut stream = vec![0xff, 0xff, 0x7f];
    stream.extend(LEAST_STATE.to_le_bytes());
    let mut seen = 0;
    let read = tables.walk(&stream, cells, |_, _| {
        seen += 1;
        Ok(())
    });
    assert!(read.is_err() && seen == 0, "{seen}");
}
