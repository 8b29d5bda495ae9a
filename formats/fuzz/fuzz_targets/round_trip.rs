//! What a reader accepts, the writer writes so that it reads back the same.

#![no_main]

use libfuzzer_sys::fuzz_target;
use squall_formats::section::{
    bolt::BoltSection,
    cloud::CloudSection,
    density::DensitySection,
    provenance::ProvenanceSection,
    response::{ResponseRows, ResponseSection, write},
    streak::{Pattern, StreakSection},
    town::TownSection,
    view::ViewSection,
    wet_maps::WetMapsSection,
};
use squall_formats::{Limits, ReadError};
use squall_formats_fuzz::{Aligned, kind_version_bytes, repair_rows};

/// Reads `bytes`, writes what they say and reads that: the same value, and the same bytes when written once more.
fn again<T: PartialEq + std::fmt::Debug>(
    bytes: &[u8],
    read: impl Fn(&[u8], u16, &Limits) -> Result<T, ReadError>,
    write: impl Fn(&T) -> Vec<u8>,
) {
    let Ok(first) = read(bytes, 1, &Limits::default()) else { return };
    let written = write(&first);
    let second = read(&written, 1, &Limits::default()).expect("what was written reads");
    assert!(first == second, "{first:?}\n{second:?}");
    assert_eq!(written, write(&second));
}

/// Patterns may be stored in several ways, of which the writer takes one: the light is the same, and the next time the bytes.
fn streaks_again(bytes: &[u8]) {
    let Ok(first) = StreakSection::read(bytes, 1, &Limits::default()) else { return };
    let written = first.write();
    let second = StreakSection::read(&written, 1, &Limits::default()).expect("what was written reads");
    assert_eq!(written, second.write());
    for (a, b) in first.patterns.iter().zip(&second.patterns).take(4) {
        let scale = match &a.pattern {
            // A G of −2048 is written as −1024 in steps twice as coarse, to which the others are rounded.
            Pattern::Cosines(p)
                if p.terms.iter().any(|t| t.along < 0.0 && (-t.along).log2().fract() == 0.0) =>
            {
                continue;
            }
            Pattern::Cosines(p) => p.constant.abs() + p.terms.iter().map(|term| term.amplitude).sum::<f64>(),
            // Tables are rounded to 255 steps between ends that may be turned round.
            Pattern::Separable(_) => continue,
        };
        for (u, v) in [(0.5, 0.5), (0.11, 0.93), (0.77, 0.3)] {
            let (wanted, found) = (a.pattern.value(u, v), b.pattern.value(u, v));
            // Cosines of up to 2π × 8192 turns.
            assert!((wanted - found).abs() <= 1e-9 * (1.0 + scale), "{wanted} {found}\n{a:?}\n{b:?}");
        }
    }
}

fn response_again(bytes: &[u8], version: u16) {
    let Ok(first) = ResponseSection::read(bytes, version, &Limits::default()) else { return };
    let rows: Result<Vec<Vec<u8>>, ReadError> =
        (0..first.row_count()).map(|row| first.row_unchecked(row).map(<[u8]>::to_vec)).collect();
    let rows = rows.expect("rows of a section that reads lie in it");
    let section = write(&first.head, ResponseRows { rows, bounds: first.bounds.to_vec() });
    let written = Aligned::new(&section.to_bytes());
    let second = ResponseSection::read(written.bytes(), section.version, &Limits::default()).expect("reads");
    assert_eq!(first.rows, second.rows);
    // Figures may be no numbers, which equal nothing; their bytes still come back.
    let rows = (0..second.row_count()).map(|row| second.row_unchecked(row).map(<[u8]>::to_vec));
    let rows: Result<Vec<Vec<u8>>, ReadError> = rows.collect();
    let rows = rows.expect("rows of a section that reads lie in it");
    let again = write(&second.head, ResponseRows { rows, bounds: second.bounds.to_vec() });
    assert_eq!((again.version, again.to_bytes()), (section.version, section.to_bytes()));
}

fuzz_target!(|data: &[u8]| {
    let Some((tag, version, bytes)) = kind_version_bytes(data) else { return };
    match tag {
        BoltSection::TAG => again(bytes, BoltSection::read, |s| s.write().to_bytes()),
        DensitySection::TAG => again(bytes, DensitySection::read, DensitySection::write),
        ProvenanceSection::TAG => {
            // Figures may be no numbers, which equal nothing; their bytes still come back.
            let Ok(first) = ProvenanceSection::read(bytes, 1, &Limits::default()) else { return };
            assert_eq!(first.write().to_bytes(), bytes);
        }
        StreakSection::TAG => streaks_again(bytes),
        TownSection::TAG => again(bytes, TownSection::read, |s| s.write().to_bytes()),
        ViewSection::TAG => again(bytes, ViewSection::read, |s| s.write().to_bytes()),
        WetMapsSection::TAG => again(bytes, WetMapsSection::read, |s| s.write().to_bytes()),
        CloudSection::TAG => {
            let bytes = Aligned::new(bytes);
            for version in [1, 2] {
                let read = CloudSection::read(bytes.bytes(), version, &Limits::default());
                let Ok(first) = read else { continue };
                assert_eq!(first.write().to_bytes(), bytes.bytes());
            }
        }
        _ => {
            let mut bytes = bytes.to_vec();
            repair_rows(&mut bytes);
            response_again(Aligned::new(&bytes).bytes(), version);
        }
    }
});
