use super::*;
use proptest::prelude::*;

fn sample() -> Vec<u8> {
    let bulk = OutSection {
        tag: Tag(*b"BULK"),
        version: 3,
        required: true,
        head_length: 5,
        parts: vec![vec![1; 7], vec![2; 100]],
    };
    written(&[OutSection::small(Tag(*b"SMAL"), 1, false, vec![9; 13]), bulk])
}

fn written(sections: &[OutSection]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let length = write(&mut bytes, sections).unwrap();
    assert_eq!(length, bytes.len() as u64);
    bytes
}

fn directory(bytes: &[u8]) -> Result<Directory, ReadError> {
    Directory::read(bytes, &Limits::default())
}

fn check_all(bytes: &[u8]) -> Result<(), ReadError> {
    for entry in &directory(bytes)?.entries {
        entry.check_head(bytes)?;
        entry.check_whole(bytes)?;
    }
    Ok(())
}

/// Overwrites bytes of header or table and makes both checksums right again.
fn forged(mut bytes: Vec<u8>, at: usize, with: &[u8]) -> Vec<u8> {
    bytes[at..at + with.len()].copy_from_slice(with);
    let count = le_u32(&bytes, 12) as usize;
    if let Some(table) = bytes.get(HEADER_BYTES..HEADER_BYTES.saturating_add(count * ENTRY_BYTES)) {
        let sum = checksum(table);
        bytes[24..28].copy_from_slice(&sum.to_le_bytes());
    }
    let sum = checksum(&bytes[..60]);
    bytes[60..64].copy_from_slice(&sum.to_le_bytes());
    bytes
}

/// Field and message of the header error that `bytes` are refused with.
#[track_caller]
fn refusal(bytes: &[u8]) -> (&'static str, String) {
    match directory(bytes) {
        Err(ReadError::Header { field, wanted, found, .. }) => (field, format!("{wanted}; {found}")),
        other => panic!("{other:?}"),
    }
}

/// Sections of any tag, version, size and division into head and bulk.
fn sections() -> impl Strategy<Value = Vec<OutSection>> {
    let part = proptest::collection::vec(any::<u8>(), 0..200);
    // Four letters, and any version but 0.
    let letter = || any::<(bool, u8)>().prop_map(|(small, at)| if small { b'a' } else { b'A' } + at % 26);
    let tag = [letter(), letter(), letter(), letter()];
    let section = (tag, 1..=u16::MAX, any::<bool>(), 0.0..=1.0f64);
    let section = (section, proptest::collection::vec(part, 0..4)).prop_map(|(entry, parts)| {
        let (tag, version, required, head) = entry;
        let length: usize = parts.iter().map(Vec::len).sum();
        let head_length = (length as f64 * head) as u64;
        OutSection { tag: Tag(tag), version, required, head_length, parts }
    });
    proptest::collection::vec(section, 0..8).prop_map(|mut sections| {
        sections.sort_by_key(|section| section.tag);
        sections.dedup_by_key(|section| section.tag);
        sections
    })
}

proptest! {
    #[test]
    fn any_sections_read_back_as_they_were_written(sections in sections()) {
        let bytes = written(&sections);
        check_all(&bytes).unwrap();
        let read = directory(&bytes).unwrap();
        prop_assert_eq!(read.entries.len(), sections.len());
        for (entry, section) in read.entries.iter().zip(&sections) {
            prop_assert_eq!(entry.offset % ALIGNMENT, 0);
            prop_assert_eq!(
                (entry.tag, entry.version, entry.required, entry.length, entry.head_length),
                (section.tag, section.version, section.required, section.length(), section.head_length)
            );
            prop_assert_eq!(entry.bytes(&bytes).unwrap(), &section.to_bytes()[..]);
            let found = read.section(&bytes, section.tag, "something").unwrap();
            prop_assert_eq!(found, &section.to_bytes()[..]);
        }
    }

    #[test]
    fn any_cut_is_refused(sections in sections(), cut in 0.0..1.0f64) {
        let bytes = written(&sections);
        prop_assert!(directory(&bytes[..(bytes.len() as f64 * cut) as usize]).is_err());
    }

    #[test]
    fn any_flipped_bit_is_noticed_when_all_is_checked(sections in sections(), at: usize, bit in 0u8..8) {
        let mut bytes = written(&sections);
        let at = at % bytes.len();
        bytes[at] ^= 1u8 << bit;
        prop_assert!(check_all(&bytes).is_err(), "bit {} of byte {}", bit, at);
    }

    /// Header and table of any content under right checksums are refused or describe sections inside the file.
    #[test]
    fn no_forged_table_points_outside_the_file(at in 8usize..160, value: u64, width in 1usize..9) {
        let width = width.min(160 - at);
        let bytes = forged(sample(), at, &value.to_le_bytes()[..width]);
        if let Ok(read) = directory(&bytes) {
            for entry in &read.entries {
                prop_assert_eq!(entry.bytes(&bytes).unwrap().len() as u64, entry.length);
                prop_assert!(entry.head_length <= entry.length);
                let _ = entry.check_whole(&bytes);
            }
        }
    }
}

#[test]
fn sections_read_back_where_they_were_written_and_aligned() {
    let bytes = sample();
    let read = directory(&bytes).unwrap();
    check_all(&bytes).unwrap();
    assert!(read.entries.iter().all(|entry| entry.offset % ALIGNMENT == 0));
    let bulk = read.section(&bytes, Tag(*b"BULK"), "bulk").unwrap();
    assert_eq!((bulk[6], bulk[7], bulk.len()), (1, 2, 107));
    assert_eq!(read.find(Tag(*b"BULK")).unwrap().version, 3);
    let error = read.section(&bytes, Tag(*b"NONE"), "what is not there").unwrap_err().to_string();
    assert!(error.contains("NONE") && error.contains("what is not there"), "{error}");
}

#[test]
fn a_file_cut_at_any_byte_is_refused() {
    let bytes = sample();
    for cut in 0..bytes.len() {
        assert!(directory(&bytes[..cut]).is_err(), "cut at {cut}");
    }
    assert_eq!(refusal(&[&bytes[..], &[0]].concat()).0, "file length");
}

#[test]
fn any_flipped_bit_is_noticed_and_one_in_header_or_table_at_once() {
    let bytes = sample();
    let table_end = HEADER_BYTES + 2 * ENTRY_BYTES;
    for at in 0..bytes.len() {
        for bit in 0..8 {
            let mut bad = bytes.clone();
            bad[at] ^= 1 << bit;
            assert!(check_all(&bad).is_err(), "bit {bit} of byte {at}");
            assert!(at >= table_end || directory(&bad).is_err(), "bit {bit} of byte {at}");
        }
    }
}

#[test]
fn damage_in_the_bulk_is_left_to_those_who_touch_it() {
    let mut bytes = sample();
    *bytes.last_mut().unwrap() ^= 1;
    let read = directory(&bytes).unwrap();
    let bulk = read.find(Tag(*b"BULK")).unwrap();
    assert!(read.section(&bytes, bulk.tag, "bulk").is_ok());
    let error = bulk.check_whole(&bytes).unwrap_err();
    assert!(error.is_damage() && error.to_string().contains("BULK"), "{error}");
}

#[test]
fn a_newer_format_is_refused_by_name() {
    for version in [0u16, 2, 999] {
        let bytes = forged(sample(), 8, &version.to_le_bytes());
        let error = directory(&bytes).unwrap_err();
        assert!(matches!(error, ReadError::Unsupported { found, newest: 1, .. } if found == version));
        assert!(!error.is_damage() && !error.is_foreign());
        assert!(error.to_string().contains(&format!("version {version}")), "{error}");
    }
}

#[test]
fn what_does_not_start_as_an_asset_is_foreign_and_what_does_is_damaged() {
    let bytes = sample();
    for foreign in [&b""[..], b"\x89", b"\x89SQUALL", b"\x89SQUALL\r\n and more", &[0; 500]] {
        assert!(directory(foreign).unwrap_err().is_foreign());
    }
    for damaged in [&bytes[..8], &bytes[..63], &bytes[..64], &bytes[..100]] {
        let error = directory(damaged).unwrap_err();
        assert!(error.is_damage() && !error.is_foreign(), "{error}");
    }
}

#[test]
fn forged_fields_under_right_checksums_are_each_refused_by_name() {
    const FIRST: usize = HEADER_BYTES;
    const SECOND: usize = HEADER_BYTES + ENTRY_BYTES;
    let number = |value: u64| value.to_le_bytes().to_vec();
    let huge = u64::MAX.to_le_bytes().to_vec();
    let cases: [(&str, usize, Vec<u8>); 23] = [
        ("reserved bytes", 10, vec![1]),
        ("reserved bytes", 59, vec![1]),
        ("section count", 12, u32::MAX.to_le_bytes().to_vec()),
        ("section count", 12, 65u32.to_le_bytes().to_vec()),
        ("section table", 12, 60u32.to_le_bytes().to_vec()),
        ("section offset", 12, 1u32.to_le_bytes().to_vec()),
        ("file length", 16, number(64)),
        ("file length", 16, huge.clone()),
        ("section tag", SECOND, b"SMAL".to_vec()),
        ("section tag", SECOND, b"SMA1".to_vec()),
        ("section tag", SECOND, b"S AL".to_vec()),
        ("section tag", FIRST, vec![0xC3, 0xA4, b'A', b'A']),
        ("section version", SECOND + 4, vec![0, 0]),
        ("section flags and reserved bytes", FIRST + 6, vec![3]),
        ("section flags and reserved bytes", FIRST + 40, vec![1]),
        // The header itself, the section before, off the boundary, past the end, beyond all addresses.
        ("section offset", FIRST + 8, number(0)),
        ("section offset", SECOND + 8, number(192)),
        ("section offset", SECOND + 8, number(264)),
        ("section offset", SECOND + 8, number(320)),
        ("section offset", SECOND + 8, number(u64::MAX - 63)),
        ("section length", SECOND + 16, number(u64::MAX - 255)),
        ("section length", SECOND + 16, huge.clone()),
        ("head length", SECOND + 24, number(108)),
    ];
    for (field, at, value) in cases {
        let (found, message) = refusal(&forged(sample(), at, &value));
        assert_eq!(found, field, "byte {at}: {message}");
    }
    // A section that ends early leaves a gap before the next, or before the file's end.
    let lengths = [number(1), number(1)].concat();
    assert_eq!(refusal(&forged(sample(), FIRST + 16, &lengths)).0, "padding");
    assert_eq!(refusal(&forged(sample(), SECOND + 16, &number(100))).0, "file length");
    // Bytes between sections are zero.
    let mut bytes = sample();
    bytes[HEADER_BYTES + 2 * ENTRY_BYTES] = 1;
    assert_eq!(refusal(&bytes).0, "padding");
}

#[test]
fn an_asset_without_sections_is_whole() {
    assert!(directory(&written(&[])).unwrap().entries.is_empty());
}

#[test]
#[should_panic(expected = "SAME twice")]
fn a_tag_that_stands_twice_is_not_written() {
    let section = OutSection::small(Tag(*b"SAME"), 1, false, vec![]);
    let _ = write(&mut Vec::new(), &[section.clone(), section]);
}
