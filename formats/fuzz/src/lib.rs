//! What the fuzz targets share: aligned bytes, checksums put right, and a bound on memory.

use peak_alloc::PeakAlloc;
use squall_formats::section::KNOWN;
use squall_formats::{Limits, Tag};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

const HEADER: usize = 64;
const ENTRY: usize = 48;

/// Bytes on a boundary fit for every array, as a memory map has them.
pub struct Aligned(Vec<u64>, usize);

impl Aligned {
    /// A copy of `bytes`.
    pub fn new(bytes: &[u8]) -> Self {
        let mut words = vec![0; bytes.len().div_ceil(8)];
        bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
        Self(words, bytes.len())
    }

    /// The bytes.
    pub fn bytes(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.0)[..self.1]
    }
}

/// Fails when `work` on `given` bytes takes more than 64 MiB and 64 times those bytes.
pub fn within_memory<T>(given: usize, work: impl FnOnce() -> T) -> T {
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let out = work();
    let taken = MEMORY.peak_usage().saturating_sub(before);
    assert!(taken <= (64 << 20) + 64 * given, "{taken} bytes of memory for {given}");
    out
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from(u32_at(bytes, at)) | u64::from(u32_at(bytes, at + 4)) << 32
}

/// Puts magic, length and all checksums of an asset right, so that mutations reach what lies behind them.
pub fn repair_container(bytes: &mut [u8]) {
    if bytes.len() < HEADER {
        return;
    }
    let length = bytes.len() as u64;
    bytes[..8].copy_from_slice(b"\x89SQUALL\n");
    bytes[8..10].copy_from_slice(&1u16.to_le_bytes());
    bytes[16..24].copy_from_slice(&length.to_le_bytes());
    let count = u32_at(bytes, 12).min(64) as usize;
    let table = HEADER + count * ENTRY;
    for line in (HEADER..table).step_by(ENTRY) {
        if line + ENTRY > bytes.len() {
            break;
        }
        let (offset, length, head) =
            (u64_at(bytes, line + 8), u64_at(bytes, line + 16), u64_at(bytes, line + 24));
        let Some(part) = offset
            .checked_add(length)
            .filter(|&end| end <= bytes.len() as u64)
            .map(|end| &bytes[offset as usize..end as usize])
        else {
            continue;
        };
        let whole = crc32fast::hash(part);
        let head = crc32fast::hash(&part[..head.min(length) as usize]);
        bytes[line + 32..line + 36].copy_from_slice(&whole.to_le_bytes());
        bytes[line + 36..line + 40].copy_from_slice(&head.to_le_bytes());
    }
    if let Some(table) = bytes.get(HEADER..table) {
        let sum = crc32fast::hash(table);
        bytes[24..28].copy_from_slice(&sum.to_le_bytes());
    }
    let sum = crc32fast::hash(&bytes[..60]);
    bytes[60..64].copy_from_slice(&sum.to_le_bytes());
}

/// Puts offsets and checksums of a response's rows right, where its index is found behind `sources` rows at most.
pub fn repair_rows(section: &mut [u8]) {
    use squall_formats::section::response::ResponseSection;
    // The reader says where index and rows are; a section that it refuses is left as it is.
    let copy = Aligned::new(section);
    let Ok(response) = ResponseSection::read(copy.bytes(), 2, &Limits::default())
        .or_else(|_| ResponseSection::read(copy.bytes(), 1, &Limits::default()))
    else {
        return;
    };
    let rows_at = section.len() - response.rows.len();
    let tables = size_of_val(response.index) + size_of_val(response.bounds);
    let index_at = rows_at - tables.next_multiple_of(64);
    for (row, entry) in response.index.iter().enumerate() {
        let from = rows_at + entry.offset as usize;
        let sum = crc32fast::hash(&section[from..from + entry.length as usize]);
        section[index_at + 16 * row + 12..index_at + 16 * row + 16].copy_from_slice(&sum.to_le_bytes());
    }
}

/// Splits an input of the targets `section` and `round_trip`: which kind, which version, and the section's bytes.
pub fn kind_version_bytes(data: &[u8]) -> Option<(Tag, u16, &[u8])> {
    let [kind, version, bytes @ ..] = data else { return None };
    Some((KNOWN[usize::from(*kind) % KNOWN.len()], 1 + u16::from(version % 2), bytes))
}
