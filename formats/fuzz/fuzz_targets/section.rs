//! Any bytes as a section of any kind, behind a right container: the section's own reader, and all of its bulk.

#![no_main]

use libfuzzer_sys::fuzz_target;
use squall_formats::Limits;
use squall_formats::section::check::check;
use squall_formats::section::response::ResponseSection;
use squall_formats_fuzz::{Aligned, kind_version_bytes, repair_rows, within_memory};

fuzz_target!(|data: &[u8]| {
    let Some((tag, version, bytes)) = kind_version_bytes(data) else { return };
    let mut bytes = bytes.to_vec();
    if tag == ResponseSection::TAG {
        repair_rows(&mut bytes);
    }
    let bytes = Aligned::new(&bytes);
    let _ = within_memory(bytes.bytes().len(), || check(tag, bytes.bytes(), version, &Limits::default()));
});
