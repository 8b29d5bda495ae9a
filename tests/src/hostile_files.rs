//! Whole files that mean harm: the golden assets, cut and flipped, through the runtime. Section by section, with memory
//! measured, the same is done in `formats/tests/hostile.rs`.

use crate::root;
use glam::DVec3;
use squall_formats::container::{Directory, OutSection, write};
use squall_formats::section::cloud::CloudSection;
use squall_formats::section::response::{ResponseSection, RowEntry};
use squall_formats::{Limits, Tag};
use squall_runtime::relight::{PointLight, RelightBuffers, RelightOptions, Relighter};
use squall_runtime::verify::verify;
use squall_runtime::{Asset, RuntimeError};

fn golden(name: &str) -> Vec<u8> {
    std::fs::read(root().join("data/golden/v1").join(name)).unwrap()
}

/// The golden asset's sections, to be written anew with changes.
fn sections(bytes: &[u8]) -> Vec<OutSection> {
    let directory = Directory::read(bytes, &Limits::default()).unwrap();
    let section = |entry: &squall_formats::container::Entry| OutSection {
        tag: entry.tag,
        version: entry.version,
        required: entry.required,
        head_length: entry.head_length,
        parts: vec![entry.bytes(bytes).unwrap().to_vec()],
    };
    directory.entries.iter().map(section).collect()
}

fn written(sections: &[OutSection]) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(&mut bytes, sections).unwrap();
    bytes
}

#[test]
fn file_cut_at_any_byte_is_refused() {
    for name in ["golden.squall", "paper.squall"] {
        let bytes = golden(name);
        assert!(Asset::from_bytes(&bytes).is_ok());
        for cut in 0..bytes.len() {
            assert!(Asset::from_bytes(&bytes[..cut]).is_err(), "{name} cut at {cut}");
        }
    }
    // Through a memory map, at places of every kind.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.squall");
    let bytes = golden("golden.squall");
    for cut in [0, 1, 8, 63, 64, 100, 4096, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..cut]).unwrap();
        let error = Asset::open(&path).err().unwrap().to_string();
        assert!(error.contains("cut.squall"), "{error}");
    }
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(Asset::open(&path).unwrap().bytes(), bytes);
}

#[test]
fn any_flipped_bit_in_what_opening_checks_is_refused() {
    for name in ["golden.squall", "paper.squall"] {
        let mut bytes = golden(name);
        let directory = Directory::read(&bytes, &Limits::default()).unwrap();
        let mut checked: Vec<usize> = (0..64 + 48 * directory.entries.len()).collect();
        for entry in &directory.entries {
            checked.extend(entry.offset as usize..(entry.offset + entry.head_length) as usize);
        }
        for at in checked {
            for bit in 0..8 {
                bytes[at] ^= 1u8 << bit;
                assert!(Asset::from_bytes(&bytes).is_err(), "{name} bit {bit} of byte {at}");
                bytes[at] ^= 1u8 << bit;
            }
        }
    }
}

#[test]
fn any_flipped_bit_in_bulk_data_is_noticed_by_verify() {
    let mut bytes = golden("golden.squall");
    let directory = Directory::read(&bytes, &Limits::default()).unwrap();
    for entry in directory.entries.iter().filter(|entry| entry.head_length < entry.length) {
        for at in (entry.head_length..entry.length).step_by(41).chain([entry.length - 1]) {
            let at = (entry.offset + at) as usize;
            bytes[at] ^= 1u8 << (at % 8);
            let asset = Asset::from_bytes(&bytes).unwrap();
            let error = verify(&asset).unwrap_err().to_string();
            assert!(error.contains(&format!("section {}", entry.tag)), "{error}");
            bytes[at] ^= 1u8 << (at % 8);
        }
    }
    assert!(verify(&Asset::from_bytes(&bytes).unwrap()).is_ok());
}

/// A lamp on the first virtual source, and one on the last.
fn lights(relighter: &Relighter) -> [PointLight; 2] {
    let (grid, _) = relighter.response().head.sources.light_grid().unwrap();
    grid.bounds().map(|corner| PointLight { position: DVec3::from_array(corner), intensity: 1.0 })
}

#[test]
fn a_damaged_row_is_refused_when_it_is_touched_and_not_before() {
    let mut bytes = golden("golden.squall");
    let directory = Directory::read(&bytes, &Limits::default()).unwrap();
    let entry = *directory.find(ResponseSection::TAG).unwrap();
    // The first row's first byte.
    bytes[(entry.offset + entry.head_length) as usize] ^= 1;
    let asset = Asset::from_bytes(&bytes).unwrap();
    let relighter = Relighter::new(&asset).unwrap();
    let mut buffers = RelightBuffers::default();
    let [first, last] = lights(&relighter);
    let relight = |light: PointLight, buffers: &mut RelightBuffers| -> Result<f32, RuntimeError> {
        relighter.relight(&[light], RelightOptions::default(), buffers).map(|relit| relit.planes[0])
    };
    let untouched = relight(last, &mut buffers).unwrap();
    for _ in 0..2 {
        let error = relight(first, &mut buffers).unwrap_err().to_string();
        assert!(error.contains("CLRT") && error.contains("row 0"), "{error}");
    }
    assert_eq!(relight(last, &mut buffers).unwrap(), untouched);
}

#[test]
fn a_damaged_cloud_grid_is_refused_when_it_is_used() {
    let mut bytes = golden("golden.squall");
    let directory = Directory::read(&bytes, &Limits::default()).unwrap();
    let entry = *directory.find(CloudSection::TAG).unwrap();
    // The lowest bit of a value: still a good number, and not the one that was baked.
    bytes[(entry.offset + entry.head_length) as usize + 4 * 7] ^= 1;
    let asset = Asset::from_bytes(&bytes).unwrap();
    let error = Relighter::new(&asset).err().unwrap().to_string();
    assert!(error.contains("CLDG") && error.contains("checksum"), "{error}");
}

#[test]
fn unknown_sections_are_skipped_when_optional_and_refused_by_name_when_required() {
    let mut sections = sections(&golden("golden.squall"));
    sections.insert(2, OutSection::small(Tag(*b"NEWS"), 9, false, vec![7; 77]));
    let asset = Asset::from_bytes(&written(&sections)).unwrap();
    assert_eq!(verify(&asset).unwrap().unknown, 1);
    assert!(Relighter::new(&asset).is_ok());
    sections[2].required = true;
    let error = Asset::from_bytes(&written(&sections)).err().unwrap().to_string();
    assert!(error.contains("NEWS") && error.contains("required"), "{error}");
}

#[test]
fn an_unknown_section_may_be_of_any_version_but_none() {
    let mut sections = sections(&golden("golden.squall"));
    sections.push(OutSection::small(Tag(*b"NEWS"), u16::MAX, false, vec![7; 77]));
    assert!(Asset::from_bytes(&written(&sections)).is_ok());
    for at in 0..sections.len() {
        let version = std::mem::replace(&mut sections[at].version, 0);
        let error = Asset::from_bytes(&written(&sections)).err().unwrap().to_string();
        assert!(error.contains("section version"), "{error}");
        sections[at].version = version;
    }
}

#[test]
fn a_known_section_marked_as_the_specification_does_not_is_refused_by_name() {
    let mut sections = sections(&golden("golden.squall"));
    for at in 0..sections.len() {
        sections[at].required = !sections[at].required;
        let error = Asset::from_bytes(&written(&sections)).err().unwrap().to_string();
        assert!(error.contains(&sections[at].tag.to_string()) && error.contains("required"), "{error}");
        sections[at].required = !sections[at].required;
    }
}

/// The golden asset with another cloud grid of `nx` cells along x: its response is then light on blocks of cells, or on none.
fn response_beside(nx: u32) -> Vec<u8> {
    let bytes = golden("golden.squall");
    let asset = Asset::from_bytes(&bytes).unwrap();
    let grid = asset.section(CloudSection::TAG, "the cloud grid", CloudSection::read).unwrap();
    let mut head = grid.head.clone();
    head.cell_m[0] *= f64::from(head.shape.nx) / f64::from(nx);
    let per_row = head.shape.nx as usize;
    head.shape.nx = nx;
    let row = |row: &[f32]| (0..nx as usize).map(|x| row[x * per_row / nx as usize]).collect::<Vec<f32>>();
    let cells: Vec<f32> = grid.extinction.values().chunks_exact(per_row).flat_map(row).collect();
    let mut sections = sections(&bytes);
    let at = sections.iter().position(|section| section.tag == CloudSection::TAG).unwrap();
    sections[at] = CloudSection::write_smallest(&head, &cells);
    written(&sections)
}

#[test]
fn light_on_equal_blocks_of_cells_is_read_and_on_others_refused_by_verify_and_runtime_alike() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("blocks.squall");
    std::fs::write(&path, response_beside(18)).unwrap();
    let asset = Asset::open(&path).unwrap();
    verify(&asset).unwrap();
    let mut renderer = squall_runtime::StormRenderer::new(&asset).unwrap();
    let frame = renderer.frame().unwrap();
    assert!(renderer.render(&frame).unwrap().pixels.iter().flatten().all(|value| value.is_finite()));
    std::fs::write(&path, response_beside(13)).unwrap();
    let asset = Asset::open(&path).unwrap();
    let verified = verify(&asset).unwrap_err().to_string();
    assert!(verified.contains("blocks.squall: section CLRT: shape: wanted the cloud grid's"), "{verified}");
    assert!(verified.contains("9 × 8 × 4 cells beside 13 × 8 × 4"), "{verified}");
    assert_eq!(Relighter::new(&asset).err().unwrap().to_string(), verified);
    assert_eq!(squall_runtime::StormRenderer::new(&asset).err().unwrap().to_string(), verified);
}

#[test]
fn a_view_whose_flash_no_stroke_answers_is_not_whole() {
    let mut sections = sections(&golden("golden.squall"));
    sections.retain(|section| section.tag != Tag(*b"BOLT"));
    let error = verify(&Asset::from_bytes(&written(&sections)).unwrap()).unwrap_err().to_string();
    assert!(error.contains("section VIEW: flashes.stroke") && error.contains("ground"), "{error}");
}

#[test]
fn a_newer_section_is_refused_by_name_when_it_is_read_and_leaves_the_others_alone() {
    let mut sections = sections(&golden("golden.squall"));
    for section in sections.iter_mut().filter(|section| section.tag == Tag(*b"DENS")) {
        section.version = 2;
    }
    let asset = Asset::from_bytes(&written(&sections)).unwrap();
    let error = squall_runtime::density::read_density(&asset).unwrap_err().to_string();
    assert!(error.contains("DENS") && error.contains("version 2"), "{error}");
    assert!(Relighter::new(&asset).is_ok());
}

#[test]
fn bytes_at_any_address_open_alike() {
    let bytes = golden("golden.squall");
    for shift in 0..8 {
        let moved = [&vec![0; shift][..], &bytes].concat();
        let asset = Asset::from_bytes(&moved[shift..]).unwrap();
        assert!(verify(&asset).is_ok() && Relighter::new(&asset).is_ok());
    }
}

#[test]
fn rows_that_overlap_or_leave_the_section_are_refused() {
    let bytes = golden("golden.squall");
    let directory = Directory::read(&bytes, &Limits::default()).unwrap();
    let entry = *directory.find(ResponseSection::TAG).unwrap();
    let asset = Asset::from_bytes(&bytes).unwrap();
    let relighter = Relighter::new(&asset).unwrap();
    let response = relighter.response();
    let index_at = entry.head_length as usize
        - (size_of_val(&response.index[..]) + size_of_val(&response.bounds[..])).next_multiple_of(64);
    let change = |row: usize, change: fn(&mut RowEntry)| {
        let mut sections = sections(&bytes);
        let clrt = sections.iter_mut().find(|section| section.tag == ResponseSection::TAG).unwrap();
        let at = index_at + row * size_of::<RowEntry>();
        let mut line = response.index[row];
        change(&mut line);
        clrt.parts[0][at..at + size_of::<RowEntry>()].copy_from_slice(bytemuck::bytes_of(&line));
        let asset = Asset::from_bytes(&written(&sections)).unwrap();
        Relighter::new(&asset).err().unwrap().to_string()
    };
    for error in [
        change(1, |line| line.offset = 0),
        change(1, |line| line.offset = u64::MAX),
        change(0, |line| line.length += 1),
        change(3, |line| line.length = u32::MAX),
    ] {
        assert!(error.contains("row offset"), "{error}");
    }
    let last = response.row_count() - 1;
    let error = change(last, |line| line.length -= 1);
    assert!(error.contains("rows: wanted as long as the index says"), "{error}");
}
