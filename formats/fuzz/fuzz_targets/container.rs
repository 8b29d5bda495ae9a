//! Any bytes as an asset, with and without their checksums put right: header, table, marks, heads, sections.

#![no_main]

use libfuzzer_sys::fuzz_target;
use squall_formats::Limits;
use squall_formats::container::Directory;
use squall_formats::section::{check::check, check_marks};
use squall_formats_fuzz::{Aligned, repair_container, within_memory};

fn open(bytes: &[u8]) {
    let limits = Limits::default();
    let Ok(directory) = Directory::read(bytes, &limits) else { return };
    let _ = check_marks(&directory);
    for entry in &directory.entries {
        let _ = (entry.check_head(bytes), entry.check_whole(bytes));
        let part = entry.bytes(bytes).expect("a directory that was read lies in the file");
        let part = Aligned::new(part);
        let _ = check(entry.tag, part.bytes(), entry.version, &limits);
    }
}

fuzz_target!(|data: &[u8]| {
    within_memory(data.len(), || open(data));
    let mut repaired = data.to_vec();
    repair_container(&mut repaired);
    within_memory(repaired.len(), || open(&repaired));
});
