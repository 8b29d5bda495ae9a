//! Bytes that mean harm: every section of the golden assets, cut, flipped, forged and lengthened, through its own reader.
//!
//! Whatever comes out is an error or a value in range; never a panic, and never more memory than a small multiple of
//! the bytes that were given.

use peak_alloc::PeakAlloc;
use proptest::prelude::*;
use squall_formats::container::{Directory, OutSection};
use squall_formats::section::bolt::{BoltSection, StrokeRecord};
use squall_formats::section::check::check;
use squall_formats::section::cloud::{CloudHead, CloudSection};
use squall_formats::section::response::{
    CoefficientBound, DirectTerm, DirectionalBasis, DistantKind, ResponseHead, ResponseRows, ResponseSection,
    SourceBasis, SunDirections, pack_seen, write, write_beside,
};
use squall_formats::section::streak::StreakSection;
use squall_formats::section::view::ViewSection;
use squall_formats::section::{KNOWN, is_known};
use squall_formats::view_region::ViewRegion;
use squall_formats::{GridShape, Limits, ReadError, Tag};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Memory is measured for the whole process, so tests take turns.
fn alone() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(|broken| broken.into_inner())
}

/// Bytes on a boundary fit for every array, as a memory map has them.
#[derive(Clone)]
struct Aligned(Vec<u64>, usize);

impl Aligned {
    fn new(bytes: &[u8]) -> Self {
        let mut words = vec![0; bytes.len().div_ceil(8)];
        bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
        Self(words, bytes.len())
    }

    fn bytes(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.0)[..self.1]
    }

    fn bytes_mut(&mut self) -> &mut [u8] {
        &mut bytemuck::cast_slice_mut(&mut self.0)[..self.1]
    }
}

struct Sample {
    tag: Tag,
    version: u16,
    head: usize,
    bytes: Aligned,
}

/// Every section of every golden asset.
fn samples() -> Vec<Sample> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden");
    let below = |folder: PathBuf| folder.read_dir().unwrap().map(|file| file.unwrap().path());
    let mut files: Vec<PathBuf> = below(folder).filter(|path| path.is_dir()).flat_map(below).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "squall"));
    files.sort();
    let mut samples = Vec::new();
    for file in files {
        let bytes = std::fs::read(file).unwrap();
        for entry in Directory::read(&bytes, &Limits::default()).unwrap().entries {
            let part = Aligned::new(entry.bytes(&bytes).unwrap());
            let (tag, version) = (entry.tag, entry.version);
            samples.push(Sample { tag, version, head: entry.head_length as usize, bytes: part });
        }
    }
    // Version 2 of the response, with all that it may hold.
    let old = samples.iter().rfind(|s| s.tag == ResponseSection::TAG && s.version == 1).unwrap();
    let section = newest_response(old.bytes.bytes(), |_| ());
    let (tag, version, head) = (ResponseSection::TAG, section.version, section.head_length as usize);
    samples.push(Sample { tag, version, head, bytes: Aligned::new(&section.to_bytes()) });
    samples
}

/// A response of version 1 as one of version 2, with a view region and cells hidden from it, and `spoil`ed.
fn newest_response(bytes: &[u8], spoil: fn(&mut ResponseHead)) -> OutSection {
    let old = ResponseSection::read(bytes, 1, &Limits::default()).unwrap();
    let mut head = old.head.clone();
    head.basis = DirectionalBasis::ViewRegion { degree: 1 };
    head.direct = DirectTerm::AtRunTime;
    head.view_region = Some(ViewRegion { low_m: [-10.0, -20.0, 0.0], high_m: [10.0, 20.0, 5.0] });
    head.seen = Some(pack_seen(&(0..head.shape.len()).map(|cell| cell % 3 > 0).collect::<Vec<bool>>()));
    spoil(&mut head);
    let coefficients = DirectionalBasis::ViewRegion { degree: 1 }.count();
    let row = [[0; 4], 0.5f32.to_le_bytes(), [0; 4]].concat().repeat(coefficients);
    let bounds = vec![CoefficientBound::default(); coefficients * old.row_count()];
    write(&head, ResponseRows { rows: vec![row; old.row_count()], bounds })
}

fn read(tag: Tag, bytes: &[u8]) -> Result<(), ReadError> {
    read_as(tag, 1, bytes)
}

fn read_as(tag: Tag, version: u16, bytes: &[u8]) -> Result<(), ReadError> {
    check(tag, bytes, version, &Limits::default()).map(|_| ())
}

/// Runs `work`, which reads many variants of a section's bytes, and fails if any of them took much memory.
///
/// The metadata reader takes room for at most 1 MiB of elements of a list before it has seen them, and a record's longest
/// chain of nested lists is three; a value read takes no more than some ten times its bytes.
#[track_caller]
fn within_bounds(sample: &Sample, work: impl FnOnce(Aligned)) {
    let bytes = sample.bytes.clone();
    MEMORY.reset_peak_usage();
    let before = MEMORY.current_usage();
    work(bytes);
    let taken = MEMORY.peak_usage().saturating_sub(before);
    let bound = (4 << 20) + 32 * sample.bytes.1;
    assert!(taken <= bound, "{}: {taken} bytes taken, {bound} allowed", sample.tag);
}

#[test]
fn the_golden_assets_hold_every_kind_of_section_and_all_are_sound() {
    let _turn = alone();
    let samples = samples();
    for sample in &samples {
        assert!(is_known(sample.tag));
        read_as(sample.tag, sample.version, sample.bytes.bytes()).unwrap();
    }
    for &tag in KNOWN {
        assert!(samples.iter().any(|sample| sample.tag == tag), "no golden asset holds {tag}");
    }
}

#[test]
fn a_section_cut_or_lengthened_at_any_byte_is_refused() {
    let _turn = alone();
    for sample in samples() {
        within_bounds(&sample, |bytes| {
            for cut in 0..bytes.1 {
                assert!(
                    read_as(sample.tag, sample.version, &bytes.bytes()[..cut]).is_err(),
                    "{} cut at {cut}",
                    sample.tag
                );
            }
        });
        for more in [1, 4, 8, 64] {
            let longer = Aligned::new(&[sample.bytes.bytes(), &vec![0; more]].concat());
            assert!(
                read_as(sample.tag, sample.version, longer.bytes()).is_err(),
                "{} and {more} bytes",
                sample.tag
            );
        }
    }
}

#[test]
fn any_flipped_bit_of_a_head_is_an_error_or_a_value_and_takes_no_memory() {
    let _turn = alone();
    for sample in samples() {
        let (tag, head) = (sample.tag, sample.head);
        within_bounds(&sample, |mut spoilt| {
            for at in 0..head {
                for bit in 0..8 {
                    spoilt.bytes_mut()[at] ^= 1u8 << bit;
                    let _ = read_as(tag, sample.version, spoilt.bytes());
                    spoilt.bytes_mut()[at] ^= 1u8 << bit;
                }
            }
        });
        // Bulk rows carry checksums of their own.
        if tag == ResponseSection::TAG {
            let mut spoilt = sample.bytes.clone();
            for at in (head..spoilt.1).step_by(13) {
                spoilt.bytes_mut()[at] ^= 1u8 << (at % 8);
                assert!(read_as(tag, sample.version, spoilt.bytes()).is_err(), "byte {at}");
                spoilt.bytes_mut()[at] ^= 1u8 << (at % 8);
            }
        }
    }
}

#[test]
fn a_huge_count_anywhere_in_a_head_takes_no_memory() {
    let _turn = alone();
    const COUNTS: [u64; 6] = [u64::MAX, 1 << 63, 1 << 40, 1 << 32, u32::MAX as u64, 1 << 24];
    for sample in samples() {
        let (tag, head) = (sample.tag, sample.head);
        within_bounds(&sample, |mut spoilt| {
            for at in 0..head.saturating_sub(8) {
                let mut before = [0; 8];
                before.copy_from_slice(&spoilt.bytes()[at..at + 8]);
                for count in COUNTS {
                    spoilt.bytes_mut()[at..at + 8].copy_from_slice(&count.to_le_bytes());
                    let _ = read_as(tag, sample.version, spoilt.bytes());
                }
                spoilt.bytes_mut()[at..at + 8].copy_from_slice(&before);
            }
        });
    }
}

#[test]
fn every_limit_is_kept() {
    let _turn = alone();
    let refused = |tag: &[u8; 4], limits: Limits| {
        let samples = samples();
        let sample = samples.iter().find(|sample| sample.tag == Tag(*tag)).unwrap();
        let error = check(sample.tag, sample.bytes.bytes(), 1, &limits).unwrap_err();
        assert!(error.is_damage() && error.to_string().contains(&sample.tag.to_string()), "{error}");
    };
    for &tag in KNOWN {
        refused(&tag.0, Limits { head_bytes: 8, ..Limits::default() });
    }
    refused(b"CLDG", Limits { cells: 287, ..Limits::default() });
    refused(b"CLRT", Limits { cells: 287, ..Limits::default() });
    refused(b"CLRT", Limits { sources: 7, ..Limits::default() });
    refused(b"BOLT", Limits { items: 1, ..Limits::default() });
}

#[test]
fn a_newer_version_of_any_section_is_refused_by_name() {
    let _turn = alone();
    for sample in samples() {
        let newest = match sample.tag {
            CloudSection::TAG => CloudSection::VERSION,
            ResponseSection::TAG => ResponseSection::VERSION,
            StreakSection::TAG => StreakSection::VERSION,
            ViewSection::TAG => ViewSection::VERSION,
            _ => 1,
        };
        for version in [0, newest + 1, u16::MAX] {
            let error = check(sample.tag, sample.bytes.bytes(), version, &Limits::default()).unwrap_err();
            let words = format!("section {}: version {version}", sample.tag);
            assert!(error.to_string().contains(&words), "{error}");
        }
    }
}

proptest! {
    #[test]
    fn noise_is_no_section(bytes in proptest::collection::vec(any::<u8>(), 0..400), kind in 0..KNOWN.len()) {
        let _turn = alone();
        prop_assert!(read(KNOWN[kind], Aligned::new(&bytes).bytes()).is_err());
    }

    #[test]
    fn bytes_copied_within_a_section_never_panic(
        kind: prop::sample::Index, from: prop::sample::Index, to: prop::sample::Index, length in 1usize..64,
    ) {
        let _turn = alone();
        let samples = samples();
        let sample = kind.get(&samples);
        let mut bytes = sample.bytes.clone();
        let end = sample.bytes.1.saturating_sub(length);
        let (from, to) = (from.index(end + 1), to.index(end + 1));
        let length = length.min(sample.bytes.1);
        bytes.bytes_mut().copy_within(from..from + length, to);
        let _ = read_as(sample.tag, sample.version, bytes.bytes());
    }
}

/// Bytes of the first golden section of kind `tag`.
fn sample(tag: Tag) -> Aligned {
    samples().into_iter().find(|sample| sample.tag == tag).unwrap().bytes
}

#[track_caller]
fn names(field: &str, result: Result<(), ReadError>) {
    match result {
        Err(ReadError::Invalid { field: found, .. } | ReadError::OverLimit { field: found, .. }) => {
            assert_eq!(found, field);
        }
        other => panic!("{field}: {other:?}"),
    }
}

#[test]
fn metadata_with_a_byte_left_over_is_refused() {
    let _turn = alone();
    for tag in [CloudSection::TAG, ResponseSection::TAG] {
        let bytes = sample(tag);
        let length = u64::from_le_bytes(bytes.bytes()[..8].try_into().unwrap());
        // The zero behind the metadata is counted in.
        let mut longer = bytes.clone();
        longer.bytes_mut()[..8].copy_from_slice(&(length + 1).to_le_bytes());
        assert!((length + 8) % 64 != 0, "there is a zero behind it");
        names("metadata", read(tag, longer.bytes()));
        // What pads the metadata is zero.
        let mut dirty = bytes.clone();
        dirty.bytes_mut()[length as usize + 8] = 1;
        names("padding behind the metadata", read(tag, dirty.bytes()));
    }
}

#[test]
fn each_damaged_field_of_a_cloud_grid_is_named() {
    let _turn = alone();
    type Spoil = fn(&mut CloudHead, &mut Vec<f32>);
    let damage: [(&str, Spoil); 11] = [
        ("shape", |head, _| head.shape.nx = 0),
        ("shape", |head, _| head.shape = GridShape::new(1 << 16, 1 << 16, 1)),
        ("cells", |head, _| head.shape = GridShape::new(1 << 15, 1 << 15, 1)),
        ("extinction", |head, _| head.shape.nz += 1),
        ("cell_m", |head, _| head.cell_m[1] = 0.0),
        ("cell_m", |head, _| head.cell_m[2] = f64::INFINITY),
        ("origin_m", |head, _| head.origin_m[0] = f64::NAN),
        ("albedo", |head, _| head.albedo = 1.0 + 1e-9),
        ("g", |head, _| head.g = -1.0),
        ("extinction", |_, values| values[7] = -1e-9),
        ("extinction", |_, values| values[7] = f32::INFINITY),
    ];
    let bytes = sample(CloudSection::TAG);
    let good = CloudSection::read(bytes.bytes(), 1, &Limits::default()).unwrap();
    for (field, spoil) in damage {
        let (mut head, mut values) = (good.head.clone(), good.extinction.values().into_owned());
        spoil(&mut head, &mut values);
        let bytes = Aligned::new(&CloudSection { head, extinction: (&values[..]).into() }.write().to_bytes());
        names(field, read(CloudSection::TAG, bytes.bytes()));
    }
}

#[test]
fn a_grid_of_few_cells_with_cloud_says_what_is_damaged_in_it() {
    let _turn = alone();
    let shape = GridShape::new(7, 5, 3);
    let head =
        CloudHead { shape, cell_m: [50.0; 3], origin_m: [0.0; 3], albedo: 1.0, g: 0.85, periodic_xy: false };
    let mut extinction = vec![0.0; shape.len()];
    for cell in [0, 9, 64, 104] {
        extinction[cell] = 0.01 + cell as f32;
    }
    let section = CloudSection::write_smallest(&head, &extinction);
    assert_eq!(section.version, 2);
    let good = Aligned::new(&section.to_bytes());
    let read = |bytes: &Aligned| {
        let section = CloudSection::read(bytes.bytes(), 2, &Limits::default())?;
        section.check_values()?;
        Ok(section.extinction.values().into_owned())
    };
    assert_eq!(read(&good).unwrap(), extinction);
    let bulk = section.head_length as usize;
    let bits = shape.len().div_ceil(32) * 4;
    type Spoil = fn(&mut Vec<u8>, usize, usize);
    let damage: [(&str, Spoil); 8] = [
        ("cells that are not empty", |bytes, bulk, _| bytes[bulk] ^= 2),
        // One bit gone, one beyond the last cell: as many as there are values.
        ("cells that are not empty", |bytes, bulk, bits| {
            bytes[bulk] ^= 1;
            bytes[bulk + bits - 1] ^= 0x80;
        }),
        ("extinction", |bytes, bulk, bits| bytes[bulk + bits..][..4].fill(0)),
        ("extinction", |bytes, bulk, bits| {
            bytes[bulk + bits..][..4].copy_from_slice(&f32::NAN.to_le_bytes())
        }),
        ("extinction", |bytes, bulk, bits| bytes[bulk + bits + 3] ^= 0x80),
        ("extinction", |bytes, _, _| bytes.truncate(bytes.len() - 4)),
        ("extinction", |bytes, _, _| bytes.extend([0; 4])),
        ("extinction", |bytes, bulk, _| bytes.truncate(bulk)),
    ];
    for (field, spoil) in damage {
        let mut bytes = good.bytes().to_vec();
        spoil(&mut bytes, bulk, bits);
        names(field, read(&Aligned::new(&bytes)).map(drop));
    }
}

#[test]
fn a_grid_takes_the_form_of_fewer_bytes() {
    let _turn = alone();
    let shape = GridShape::new(8, 8, 8);
    let head =
        CloudHead { shape, cell_m: [50.0; 3], origin_m: [0.0; 3], albedo: 1.0, g: 0.85, periodic_xy: false };
    // 64 bytes of bits are worth 16 empty cells.
    for (empty, version) in [(0, 1), (16, 1), (17, 2), (512, 2)] {
        let extinction: Vec<f32> = (0..512).map(|cell| if cell < empty { 0.0 } else { 0.5 }).collect();
        let section = CloudSection::write_smallest(&head, &extinction);
        assert_eq!(section.version, version, "{empty} empty cells");
        let bytes = Aligned::new(&section.to_bytes());
        let back = CloudSection::read(bytes.bytes(), version, &Limits::default()).unwrap();
        assert_eq!(back.extinction.values()[..], extinction[..]);
    }
}

#[test]
fn each_damaged_field_of_a_stroke_is_named() {
    let _turn = alone();
    let damage: [(&str, fn(&mut StrokeRecord)); 13] = [
        ("from_m, to_m", |s| s.from_m[2] = f64::NAN),
        ("from_m to to_m", |s| s.to_m = s.from_m),
        ("segment_m", |s| s.segment_m = 0.0),
        ("segment_m", |s| s.segment_m = 1e9),
        ("turn_rad", |s| s.turn_rad = 1.3),
        ("wander", |s| s.wander = -0.1),
        ("branching", |s| s.branching = 1.1),
        ("branch_rad", |s| s.branch_rad = f64::INFINITY),
        ("branch_length", |s| s.branch_length = 2.0),
        ("max_order", |s| s.max_order = 9),
        ("branch_intensity", |s| s.branch_intensity = f64::NAN),
        ("intensity_w_per_sr", |s| s.intensity_w_per_sr = -1.0),
        ("color", |s| s.color[1] = f32::NAN),
    ];
    let good = BoltSection::read(sample(BoltSection::TAG).bytes(), 1, &Limits::default()).unwrap();
    for (field, spoil) in damage {
        let mut section = good.clone();
        spoil(&mut section.strokes[1]);
        names(field, read(BoltSection::TAG, &section.write().to_bytes()));
    }
}

fn x_axis(head: &mut ResponseHead) -> &mut Vec<f64> {
    match &mut head.sources {
        SourceBasis::LightGrid { grid, .. } => &mut grid.x_m,
        other => panic!("{other:?}"),
    }
}

fn node_rows(head: &mut ResponseHead) -> &mut Vec<u32> {
    match &mut head.sources {
        SourceBasis::LightGrid { rows, .. } => rows,
        other => panic!("{other:?}"),
    }
}

#[test]
fn each_damaged_field_of_a_response_is_named() {
    let _turn = alone();
    type Spoil = fn(&mut ResponseHead, &mut ResponseRows);
    let damage: [(&str, Spoil); 20] = [
        ("extinction scale", |head, _| head.solver.extinction_scale = 0.0),
        ("extinction scale", |head, _| head.solver.extinction_scale = f64::NAN),
        ("shape", |head, _| head.shape.ny = 0),
        ("shape", |head, _| head.shape = GridShape::new(u32::MAX, 1, 1)),
        ("basis", |head, _| head.basis = DirectionalBasis::Harmonics { degree: 4 }),
        ("refine", |head, _| head.solver.refine[1] = 0),
        ("light grid axis", |head, _| x_axis(head)[1] = f64::NAN),
        ("light grid axis", |head, _| x_axis(head).swap(0, 1)),
        ("light grid axis", |head, _| x_axis(head).clear()),
        ("light grid rows", |head, _| x_axis(head).truncate(1)),
        ("rows of sources", |head, _| node_rows(head)[0] = 1),
        ("rows of sources", |head, _| node_rows(head)[0] = 1 << 20),
        ("rows of sources", |head, _| head.distant[0].row = head.distant[1].row),
        ("beam direction", |head, _| {
            head.distant[2].kind = DistantKind::Beam { direction: [0.0, 0.0, -1.1] };
        }),
        ("beam direction", |head, _| {
            head.distant[2].kind = DistantKind::Beam { direction: [f64::NAN, 0.0, 0.0] };
        }),
        ("error bounds", |_, rows| rows.bounds[3].discarded = -1.0),
        ("error bounds", |_, rows| rows.bounds[3].quantised = f32::NAN),
        ("mean and step of a plane", |_, rows| rows.rows[2][..4].copy_from_slice(&f32::NAN.to_le_bytes())),
        ("mean and step of a plane", |_, rows| rows.rows[2][4..8].copy_from_slice(&f32::MAX.to_le_bytes())),
        ("row", |_, rows| rows.rows[2].push(0)),
    ];
    let bytes =
        samples().into_iter().rfind(|s| s.tag == ResponseSection::TAG && s.version == 1).map(|s| s.bytes);
    let other = sample(ResponseSection::TAG);
    // Of the two goldens, the one with distant light.
    for bytes in [bytes.unwrap(), other] {
        let good = ResponseSection::read(bytes.bytes(), 1, &Limits::default()).unwrap();
        if good.head.distant.is_empty() {
            continue;
        }
        let rows = (0..good.row_count()).map(|row| good.row(row).unwrap().to_vec()).collect::<Vec<_>>();
        for (field, spoil) in damage {
            let mut head = good.head.clone();
            let mut rows = ResponseRows { rows: rows.clone(), bounds: good.bounds.to_vec() };
            spoil(&mut head, &mut rows);
            let section = write(&head, rows);
            let bytes = Aligned::new(&section.to_bytes());
            names(field, read_as(ResponseSection::TAG, section.version, bytes.bytes()));
        }
        return;
    }
    panic!("no golden asset has distant light");
}

#[test]
fn each_damaged_field_of_view_region_and_seen_cells_is_named() {
    let _turn = alone();
    type Spoil = fn(&mut ResponseHead);
    let damage: [(&str, Spoil); 9] = [
        ("basis", |head| head.basis = DirectionalBasis::ViewRegion { degree: 3 }),
        ("basis", |head| head.view_region = None),
        ("basis", |head| head.direct = DirectTerm::InRows),
        ("view region", |head| head.view_region.as_mut().unwrap().low_m[1] = f64::NAN),
        ("view region", |head| head.view_region.as_mut().unwrap().low_m[1] = 20.5),
        ("view region", |head| head.view_region.as_mut().unwrap().high_m[2] = f64::INFINITY),
        ("seen cells", |head| head.seen.as_mut().unwrap().push(0)),
        ("seen cells", |head| head.seen = Some(Vec::new())),
        ("seen cells", |head| {
            head.shape.nz -= 1;
            head.shape.nx -= 1;
        }),
    ];
    let old = sample(ResponseSection::TAG);
    let good = newest_response(old.bytes(), |_| ());
    let (version, good) = (good.version, good.to_bytes());
    read_as(ResponseSection::TAG, version, Aligned::new(&good).bytes()).unwrap();
    for (field, spoil) in damage {
        let bytes = newest_response(old.bytes(), spoil).to_bytes();
        names(field, read_as(ResponseSection::TAG, version, Aligned::new(&bytes).bytes()));
    }
    // Version 1 has none of this: its basis cannot be that, and its record ends before.
    let bytes = Aligned::new(&good);
    assert!(read(ResponseSection::TAG, bytes.bytes()).is_err());
}

#[test]
fn each_damaged_field_of_the_sun_is_named() {
    let _turn = alone();
    type Spoil = fn(&mut ResponseHead);
    fn rings(head: &mut ResponseHead) -> (&mut Vec<f64>, &mut Vec<u32>) {
        match &mut head.sun {
            Some(SunDirections::Rings { elevations_rad, counts }) => (elevations_rad, counts),
            _ => panic!("no rings"),
        }
    }
    let damage: [(&str, Spoil); 8] = [
        ("distant light", |head| head.sun = None),
        ("sun's rings", |head| rings(head).0[1] = f64::NAN),
        ("sun's rings", |head| rings(head).0.swap(0, 1)),
        ("sun's rings", |head| rings(head).0.truncate(1)),
        ("sun's rings", |head| rings(head).1[0] += 1),
        ("sun's rings", |head| rings(head).1[0] = u32::MAX),
        ("sun's beams", |head| rings(head).0[0] -= 0.01),
        ("sun", |head| {
            for source in &mut head.distant {
                if let DistantKind::Sun { direction } = source.kind {
                    source.kind = DistantKind::Beam { direction };
                }
            }
        }),
    ];
    let sample = samples().into_iter().find(|s| s.tag == ResponseSection::TAG && s.version == 3).unwrap();
    let good = ResponseSection::read(sample.bytes.bytes(), 3, &Limits::default()).unwrap();
    let rows: Vec<Vec<u8>> = (0..good.row_count()).map(|row| good.row(row).unwrap().to_vec()).collect();
    for (field, spoil) in damage {
        let mut head = good.head.clone();
        spoil(&mut head);
        let rows = ResponseRows { rows: rows.clone(), bounds: good.bounds.to_vec() };
        // As if there were blocks: the version is then 3 whatever the head says.
        let bytes = write_beside(&head, rows, GridShape::new(1, 1, 1)).to_bytes();
        names(field, read_as(ResponseSection::TAG, 3, Aligned::new(&bytes).bytes()));
    }
}

#[test]
fn a_bit_a_cell_says_which_are_seen() {
    let old = sample(ResponseSection::TAG);
    let head = ResponseSection::read(old.bytes(), 1, &Limits::default()).unwrap().head;
    let seen: Vec<bool> = (0..head.shape.len()).map(|cell| cell % 5 == 2).collect();
    let packed = ResponseHead { seen: Some(pack_seen(&seen)), ..head.clone() };
    assert!((0..seen.len()).all(|cell| packed.sees(cell) == seen[cell] && head.sees(cell)));
    assert!(!packed.sees(8 * seen.len()), "no cell beyond the grid is seen");
}
