//! The file around the sections: header, section table, alignment, checksums. Bytes: SPEC.md §1.
//!
//! `read` and `write` stand beside each other. Reading never allocates more than the section table and
//! never touches a section until it is asked for, so opening costs the same for any size of asset.

use crate::error::{Limits, MAGIC_FIELD, ReadError};
use crate::tag::Tag;
use std::io::Write;

/// First eight bytes of every asset. The first is no ASCII and the last is a line feed, so that a
/// transfer in text mode shows.
pub const MAGIC: [u8; 8] = *b"\x89SQUALL\n";
/// Version of the container layout that this build writes, and the newest that it reads.
pub const FORMAT_VERSION: u16 = 1;
/// Every section starts on a multiple of this many bytes: a cache line, and the widest SIMD load.
pub const ALIGNMENT: u64 = 64;

const HEADER_BYTES: usize = 64;
const ENTRY_BYTES: usize = 48;
const FLAG_REQUIRED: u16 = 1;

/// One line of the section table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// What kind of section.
    pub tag: Tag,
    /// Version of that section's layout.
    pub version: u16,
    /// A reader that does not know the tag must refuse the file.
    pub required: bool,
    /// Start in the file, a multiple of [`ALIGNMENT`].
    pub offset: u64,
    /// Length in bytes.
    pub length: u64,
    /// Length of the leading part that is checked whenever the section is opened.
    pub head_length: u64,
    /// CRC-32 of the whole section.
    pub checksum: u32,
    /// CRC-32 of the head.
    pub head_checksum: u32,
}

/// A section on its way into a file: bytes in parts, so that bulk rows need not be copied together.
#[derive(Clone, Debug)]
pub struct OutSection {
    /// What kind of section.
    pub tag: Tag,
    /// Version of that section's layout.
    pub version: u16,
    /// A reader that does not know the tag must refuse the file.
    pub required: bool,
    /// How many leading bytes are checked on open; the rest is bulk, checked on first touch.
    pub head_length: u64,
    /// The bytes, in order.
    pub parts: Vec<Vec<u8>>,
}

impl OutSection {
    /// A section that is all head: small, and checked whenever it is opened.
    pub fn small(tag: Tag, version: u16, required: bool, bytes: Vec<u8>) -> Self {
        Self { tag, version, required, head_length: bytes.len() as u64, parts: vec![bytes] }
    }

    /// Length in bytes.
    pub fn length(&self) -> u64 {
        self.parts.iter().map(|part| part.len() as u64).sum()
    }

    /// The bytes in one piece, for tests and for sections read back in memory.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.parts.concat()
    }

    fn checksums(&self) -> (u32, u32) {
        let (mut whole, mut head) = (crc32fast::Hasher::new(), crc32fast::Hasher::new());
        let mut head_left = self.head_length as usize;
        for part in &self.parts {
            whole.update(part);
            let taken = head_left.min(part.len());
            head.update(&part[..taken]);
            head_left -= taken;
        }
        (whole.finalize(), head.finalize())
    }
}

/// CRC-32 (IEEE 802.3, the one of zip and PNG) of `bytes`.
pub fn checksum(bytes: &[u8]) -> u32 {
    crc32fast::hash(bytes)
}

fn align(offset: u64) -> Option<u64> {
    offset.checked_next_multiple_of(ALIGNMENT)
}

/// Writes a whole asset, sections in the order given. The stream gets every byte once, front to back.
///
/// Errors: whatever `out` reports. Panics when a tag stands twice, which is a mistake of the caller.
///
/// ```
/// use squall_formats::container::{Directory, OutSection, write};
/// use squall_formats::{Limits, Tag};
///
/// let mut file = Vec::new();
/// write(&mut file, &[OutSection::small(Tag(*b"NOTE"), 1, false, b"hello".to_vec())])?;
///
/// let directory = Directory::read(&file, &Limits::default())?;
/// assert_eq!(directory.section(&file, Tag(*b"NOTE"), "a note")?, b"hello");
/// assert!(Directory::read(&file[..file.len() - 1], &Limits::default()).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write<W: Write>(out: &mut W, sections: &[OutSection]) -> std::io::Result<u64> {
    for (i, section) in sections.iter().enumerate() {
        assert!(sections[..i].iter().all(|s| s.tag != section.tag), "section {} twice", section.tag);
    }
    let aligned = |offset: u64| align(offset).unwrap_or_else(|| unreachable!("sections fit in memory"));
    let mut table = Vec::with_capacity(sections.len() * ENTRY_BYTES);
    let mut end = (HEADER_BYTES + sections.len() * ENTRY_BYTES) as u64;
    let mut offsets = Vec::with_capacity(sections.len());
    for section in sections {
        let offset = aligned(end);
        let (whole, head) = section.checksums();
        table.extend_from_slice(&section.tag.0);
        table.extend_from_slice(&section.version.to_le_bytes());
        table.extend_from_slice(&(if section.required { FLAG_REQUIRED } else { 0 }).to_le_bytes());
        table.extend_from_slice(&offset.to_le_bytes());
        table.extend_from_slice(&section.length().to_le_bytes());
        table.extend_from_slice(&section.head_length.to_le_bytes());
        table.extend_from_slice(&whole.to_le_bytes());
        table.extend_from_slice(&head.to_le_bytes());
        table.extend_from_slice(&[0; 8]);
        offsets.push(offset);
        end = offset + section.length();
    }
    let mut header = [0u8; HEADER_BYTES];
    header[..8].copy_from_slice(&MAGIC);
    header[8..10].copy_from_slice(&FORMAT_VERSION.to_le_bytes());
    header[12..16].copy_from_slice(&(sections.len() as u32).to_le_bytes());
    header[16..24].copy_from_slice(&end.to_le_bytes());
    header[24..28].copy_from_slice(&checksum(&table).to_le_bytes());
    let sum = checksum(&header[..60]);
    header[60..].copy_from_slice(&sum.to_le_bytes());

    out.write_all(&header)?;
    out.write_all(&table)?;
    let mut at = (HEADER_BYTES + table.len()) as u64;
    for (section, offset) in sections.iter().zip(offsets) {
        out.write_all(&[0; ALIGNMENT as usize][..(offset - at) as usize])?;
        for part in &section.parts {
            out.write_all(part)?;
        }
        at = offset + section.length();
    }
    Ok(end)
}

/// The section table of an asset's bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Directory {
    /// Sections in file order.
    pub entries: Vec<Entry>,
}

fn le_u16(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn le_u32(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn le_u64(bytes: &[u8], at: usize) -> u64 {
    u64::from(le_u32(bytes, at)) | u64::from(le_u32(bytes, at + 4)) << 32
}

fn header_error(offset: u64, field: &'static str, wanted: impl ToString, found: impl ToString) -> ReadError {
    ReadError::Header { offset, field, wanted: wanted.to_string(), found: found.to_string() }
}

/// Number of sections, from a header with everything in it checked.
fn read_header(bytes: &[u8], limits: &Limits) -> Result<u32, ReadError> {
    let total = bytes.len() as u64;
    let start = &bytes[..bytes.len().min(MAGIC.len())];
    if start != MAGIC {
        let kind = crate::magic::kind_of(&bytes[..bytes.len().min(crate::magic::LOOKED_AT)]);
        let found = kind.map_or_else(|| start.escape_ascii().to_string(), str::to_owned);
        return Err(header_error(0, MAGIC_FIELD, "\\x89SQUALL\\n (a .squall asset)", found));
    }
    if bytes.len() < HEADER_BYTES {
        return Err(header_error(8, "file length", "at least 64 bytes", format!("{total} bytes")));
    }
    let version = le_u16(bytes, 8);
    if version != FORMAT_VERSION {
        return Err(ReadError::Unsupported {
            what: "the asset's format".into(),
            found: version,
            newest: FORMAT_VERSION,
        });
    }
    if checksum(&bytes[..60]) != le_u32(bytes, 60) {
        let found = format!("{:08x}", checksum(&bytes[..60]));
        return Err(header_error(60, "header checksum", format!("{:08x}", le_u32(bytes, 60)), found));
    }
    if bytes[10..12].iter().chain(&bytes[28..60]).any(|&b| b != 0) {
        return Err(header_error(10, "reserved bytes", "zero", "something else"));
    }
    let count = le_u32(bytes, 12);
    if count > limits.sections {
        return Err(header_error(12, "section count", format!("at most {}", limits.sections), count));
    }
    if le_u64(bytes, 16) != total {
        let wanted = format!("{} bytes, as the header says", le_u64(bytes, 16));
        return Err(header_error(16, "file length", wanted, format!("{total} bytes")));
    }
    Ok(count)
}

/// A line of the section table, which stands at byte `at` of the file: what can be checked of it by itself.
fn read_entry(line: &[u8], at: u64) -> Result<Entry, ReadError> {
    let flags = le_u16(line, 6);
    let entry = Entry {
        tag: Tag([line[0], line[1], line[2], line[3]]),
        version: le_u16(line, 4),
        required: flags & FLAG_REQUIRED != 0,
        offset: le_u64(line, 8),
        length: le_u64(line, 16),
        head_length: le_u64(line, 24),
        checksum: le_u32(line, 32),
        head_checksum: le_u32(line, 36),
    };
    if flags & !FLAG_REQUIRED != 0 || line[40..].iter().any(|&b| b != 0) {
        return Err(header_error(at + 6, "section flags and reserved bytes", "zero", "something else"));
    }
    if !entry.tag.is_letters() {
        return Err(header_error(at, "section tag", "four ASCII letters", entry.tag));
    }
    if entry.version == 0 {
        return Err(header_error(at + 4, "section version", "1 or above", entry.version));
    }
    Ok(entry)
}

impl Directory {
    /// Where the section table of an asset of `sections` sections ends, bytes from the file's start.
    pub fn table_end(sections: u32) -> u64 {
        (HEADER_BYTES + sections as usize * ENTRY_BYTES) as u64
    }

    /// Checks header and table of a whole asset in memory (or mapped) and returns the table.
    ///
    /// Everything but the sections themselves is checked: magic, version, counts against `limits`,
    /// both checksums, tags and versions of sections, that the sections follow each other without gap or
    /// overlap, that reserved bytes and padding are zero and that the file ends where it says. Which sections
    /// there are is not: see [`crate::section::check_marks`]. Cost: the table and 64 bytes a section.
    pub fn read(bytes: &[u8], limits: &Limits) -> Result<Self, ReadError> {
        let count = read_header(bytes, limits)?;
        let total = bytes.len() as u64;
        let table_end = HEADER_BYTES + count as usize * ENTRY_BYTES;
        let Some(table) = bytes.get(HEADER_BYTES..table_end) else {
            return Err(header_error(
                12,
                "section table",
                format!("{table_end} bytes"),
                format!("{total} bytes"),
            ));
        };
        if checksum(table) != le_u32(bytes, 24) {
            let found = format!("{:08x}", checksum(table));
            return Err(header_error(24, "table checksum", format!("{:08x}", le_u32(bytes, 24)), found));
        }
        let mut entries: Vec<Entry> = Vec::with_capacity(count as usize);
        let mut end = table_end as u64;
        for (i, line) in table.chunks_exact(ENTRY_BYTES).enumerate() {
            let at = (HEADER_BYTES + i * ENTRY_BYTES) as u64;
            let entry = read_entry(line, at)?;
            if entries.iter().any(|e| e.tag == entry.tag) {
                return Err(header_error(at, "section tag", "each tag once", format!("{} again", entry.tag)));
            }
            if Some(entry.offset) != align(end) {
                return Err(header_error(at + 8, "section offset", "the next multiple of 64", entry.offset));
            }
            let Some(stop) = entry.offset.checked_add(entry.length).filter(|&stop| stop <= total) else {
                return Err(header_error(at + 16, "section length", "an end inside the file", entry.length));
            };
            if entry.head_length > entry.length {
                let wanted = format!("at most {}", entry.length);
                return Err(header_error(at + 24, "head length", wanted, entry.head_length));
            }
            if bytes[end as usize..entry.offset as usize].iter().any(|&b| b != 0) {
                return Err(header_error(end, "padding", "zero", "something else"));
            }
            end = stop;
            entries.push(entry);
        }
        if end != total {
            return Err(header_error(
                16,
                "file length",
                format!("{end} bytes, where the last section ends"),
                total,
            ));
        }
        Ok(Self { entries })
    }

    /// The table line of `tag`, if the asset has that section.
    pub fn find(&self, tag: Tag) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.tag == tag)
    }

    /// The bytes of section `tag` with its head checked; bulk behind the head is left to the section.
    ///
    /// `bytes` is the same asset that the directory was read from. `holds` says in words what the
    /// section is for and ends up in the message when it is missing.
    pub fn section<'a>(&self, bytes: &'a [u8], tag: Tag, holds: &'static str) -> Result<&'a [u8], ReadError> {
        let entry = self.find(tag).ok_or(ReadError::Missing { section: tag, holds })?;
        entry.check_head(bytes)?;
        entry.bytes(bytes)
    }
}

impl Entry {
    /// The section's bytes, unchecked.
    pub fn bytes<'a>(&self, asset: &'a [u8]) -> Result<&'a [u8], ReadError> {
        let stop = self.offset.saturating_add(self.length);
        asset.get(self.offset as usize..stop as usize).ok_or(ReadError::Truncated {
            section: self.tag,
            offset: asset.len() as u64,
            missing: stop.saturating_sub(asset.len() as u64),
        })
    }

    /// Recomputes the head's checksum.
    pub fn check_head(&self, asset: &[u8]) -> Result<(), ReadError> {
        let head = self.bytes(asset)?.get(..self.head_length as usize).unwrap_or_default();
        self.compare("head", self.head_checksum, checksum(head))
    }

    /// Recomputes the whole section's checksum: one pass over its bytes.
    pub fn check_whole(&self, asset: &[u8]) -> Result<(), ReadError> {
        self.compare("all bytes", self.checksum, checksum(self.bytes(asset)?))
    }

    fn compare(&self, part: &str, wanted: u32, found: u32) -> Result<(), ReadError> {
        if wanted == found {
            return Ok(());
        }
        Err(ReadError::Checksum { section: self.tag, part: part.into(), wanted, found })
    }
}

#[cfg(test)]
#[path = "container_tests.rs"]
mod tests;
