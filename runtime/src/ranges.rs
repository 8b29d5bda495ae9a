//! An asset read piece by piece: header, heads and small sections first, of the cloud's response only the rows that a flash touches.
//!
//! [`Asset::open_range`] takes a [`ReadRanges`], which answers when it is asked: a file, an object store, HTTP. Where nothing may
//! wait, as in a page, [`Opening`] says which bytes it wants next, and a call that lacks rows fails with
//! [`RuntimeError::NotFetched`], which names them; [`Asset::give`] takes them in.

use crate::error::RuntimeError;
use crate::load::{Asset, Bytes, LONGEST_STREAM};
use squall_formats::container::{Directory, MAGIC};
use squall_formats::section::response::{ResponseSection, RowEntry};
use squall_formats::{Limits, ReadError};
use std::io::{Error, ErrorKind};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// First bytes that are asked for: header and section table of an asset with a hundred sections.
const FIRST_BYTES: u64 = 4 << 10;
/// Two wanted pieces that lie nearer to each other are asked for as one: a request costs more than so many bytes.
const WORTH_BRIDGING: u64 = 16 << 10;

/// What a reader answers.
pub enum Fetched {
    /// The bytes of the range, all of them but behind the end of the file.
    Part(Vec<u8>),
    /// The whole file, of a server that does not know ranges.
    Whole(Vec<u8>),
}

/// Reads pieces of a file that lies elsewhere.
pub trait ReadRanges: Send + Sync {
    /// The bytes of `range`, which may reach behind the end of the file.
    ///
    /// Errors: what the place says; the asset's call fails with it, and may be made again.
    fn read_range(&self, range: Range<u64>) -> std::io::Result<Fetched>;
}

impl<F: Fn(Range<u64>) -> std::io::Result<Fetched> + Send + Sync> ReadRanges for F {
    fn read_range(&self, range: Range<u64>) -> std::io::Result<Fetched> {
        self(range)
    }
}

/// An asset on its way: says which bytes it wants, and takes them.
///
/// ```
/// use squall_runtime::ranges::Opening;
/// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
/// # let file = std::fs::read(path)?;
/// let mut opening = Opening::new("golden.squall");
/// while let Some(range) = opening.wanted() {
///     // From anywhere: `file` stands for a request.
///     let end = range.end.min(file.len() as u64);
///     opening.give(range.start, &file[range.start as usize..end as usize])?;
/// }
/// let asset = opening.finish()?;
/// assert!(asset.fetched_bytes().unwrap() < file.len() as u64);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Opening {
    path: PathBuf,
    /// The asset's first bytes, until its length is known.
    start: Vec<u8>,
    /// All of its bytes, zero where none came yet.
    bytes: Option<Bytes>,
    /// Ranges that are still wanted, the next one last.
    wanted: Vec<Range<u64>>,
    fetched: u64,
}

impl Opening {
    /// An asset of this name, which errors call it by.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            start: Vec::new(),
            bytes: None,
            wanted: std::iter::once(0..FIRST_BYTES).collect(),
            fetched: 0,
        }
    }

    /// The bytes that are wanted next; `None` where all that opening takes is here.
    pub fn wanted(&self) -> Option<Range<u64>> {
        self.wanted.last().cloned()
    }

    /// Takes the bytes of the range that [`Opening::wanted`] named, from byte `at` of the file on; fewer where the file ends.
    ///
    /// Errors: bytes that were not asked for; too few of them; a header or section table that is no asset's.
    pub fn give(&mut self, at: u64, given: &[u8]) -> Result<(), RuntimeError> {
        // A caller may say any place.
        let end = at.saturating_add(given.len() as u64);
        let Some(wanted) = self.wanted.last().filter(|wanted| wanted.start == at && end <= wanted.end) else {
            let wanted = self.wanted.last().map_or("none".into(), |wanted| format!("bytes {wanted:?}"));
            return Err(RuntimeError::argument("range", wanted, format!("{at}..{end}")));
        };
        let whole = self.total().map_or(wanted.end, |total| wanted.end.min(total));
        let is_start = self.bytes.is_none();
        if !is_start && end < whole {
            let missing = format!("{} bytes fewer", whole - end);
            return Err(RuntimeError::argument("range", format!("bytes {at}..{whole}"), missing));
        }
        self.wanted.pop();
        self.fetched += given.len() as u64;
        if is_start {
            self.start.extend_from_slice(given);
            return self.read_start(end < whole);
        }
        if let Some(bytes) = &mut self.bytes {
            bytes.fill(at as usize, given);
        }
        Ok(())
    }

    /// Length of the file, where its header has come.
    fn total(&self) -> Option<u64> {
        self.bytes.as_ref().map(|bytes| bytes.as_slice().len() as u64)
    }

    /// Reads header and section table from the first bytes, which are the whole file where `ends`; asks for the rest of the table
    /// where it is longer.
    fn read_start(&mut self, ends: bool) -> Result<(), RuntimeError> {
        let header = |at: usize| self.start.get(at..at + 8)?.try_into().ok().map(u64::from_le_bytes);
        let total = header(16).filter(|_| self.start.starts_with(&MAGIC) && !ends);
        let total = total.unwrap_or(self.start.len() as u64);
        let length = usize::try_from(total).ok().filter(|&length| length <= LONGEST_STREAM);
        let Some(mut bytes) = length.and_then(Bytes::zeros) else {
            let source = Error::new(ErrorKind::FileTooLarge, format!("the header says {total} bytes"));
            return Err(RuntimeError::Io { path: self.path.clone(), source });
        };
        let known = self.start.len().min(bytes.as_slice().len());
        bytes.fill(0, &self.start[..known]);
        // The table's end, as the header's count of sections has it; what is wrong with the count is said by the reader.
        let count = header(8).map_or(0, |half| half >> 32);
        let table_end = Directory::table_end(count.min(u64::from(Limits::default().sections)) as u32);
        if table_end > known as u64 && !ends && table_end <= total {
            self.wanted.push(known as u64..table_end);
            return Ok(());
        }
        let wrap = |source| RuntimeError::Asset { path: self.path.clone(), source };
        let directory = Directory::read(bytes.as_slice(), &Limits::default()).map_err(wrap)?;
        let known = known as u64;
        for entry in &directory.entries {
            let length = match entry.tag == ResponseSection::TAG {
                true => entry.head_length,
                false => entry.length,
            };
            let range = entry.offset.max(known)..entry.offset + length;
            if !range.is_empty() {
                self.wanted.push(range);
            }
        }
        self.wanted.reverse();
        self.wanted = bridged(std::mem::take(&mut self.wanted));
        self.bytes = Some(bytes);
        Ok(())
    }

    /// The asset, whose rows are given to it when a call wants them ([`Asset::give`]).
    ///
    /// Errors: bytes are still wanted; a section is damaged.
    pub fn finish(self) -> Result<Asset, RuntimeError> {
        self.finish_with(None)
    }

    fn finish_with(self, reader: Option<Box<dyn ReadRanges>>) -> Result<Asset, RuntimeError> {
        let (Some(bytes), None) = (self.bytes, self.wanted.last()) else {
            let wanted = self.wanted.last().cloned().unwrap_or_default();
            return Err(RuntimeError::NotFetched { path: self.path, ranges: vec![wanted] });
        };
        let rows = RangeRows { reader, slots: OnceLock::new(), fetched: AtomicU64::new(self.fetched) };
        let asset = Asset::assemble(bytes, self.path, Some(rows))?;
        asset.check_heads()?;
        // What came whole is checked whole, as it comes.
        for entry in &asset.directory().entries {
            if entry.tag != ResponseSection::TAG {
                asset.check_bulk(entry.tag)?;
            }
        }
        Ok(asset)
    }
}

/// Joins ranges, the first last, that lie near each other.
fn bridged(wanted: Vec<Range<u64>>) -> Vec<Range<u64>> {
    let mut joined: Vec<Range<u64>> = Vec::with_capacity(wanted.len());
    for range in wanted {
        match joined.last_mut().filter(|later| later.start <= range.end + WORTH_BRIDGING) {
            Some(later) => later.start = range.start,
            None => joined.push(range),
        }
    }
    joined
}

/// Rows of the response that come when they are wanted.
pub(crate) struct RangeRows {
    reader: Option<Box<dyn ReadRanges>>,
    slots: OnceLock<Vec<OnceLock<Box<[u8]>>>>,
    fetched: AtomicU64,
}

impl RangeRows {
    fn slots(&self, count: usize) -> &[OnceLock<Box<[u8]>>] {
        self.slots.get_or_init(|| (0..count).map(|_| OnceLock::new()).collect())
    }

    /// Row `row` of `count`, if it has come.
    pub(crate) fn row(&self, row: usize, count: usize) -> Option<&[u8]> {
        Some(self.slots(count).get(row)?.get()?)
    }

    /// Keeps every row of `index` that lies whole in `bytes`, which begin at `at`; rows begin at `rows_at`. Checks each.
    fn keep(&self, index: &[RowEntry], rows_at: u64, at: u64, bytes: &[u8]) -> Result<(), ReadError> {
        let slots = self.slots(index.len());
        let first = index.partition_point(|entry| rows_at + entry.offset < at);
        for (row, entry) in index.iter().enumerate().skip(first) {
            let start = (rows_at + entry.offset - at) as usize;
            let Some(bytes) = bytes.get(start..start + entry.length as usize) else { break };
            ResponseSection::check_row(index, row, bytes)?;
            slots[row].get_or_init(|| bytes.into());
        }
        self.fetched.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        Ok(())
    }
}

impl Asset {
    /// Opens an asset that lies elsewhere: reads header, heads and every section but the rows of the cloud's response, which are
    /// read when a flash wants them, neighbours in one piece. Where the reader answers with the whole file, that is kept.
    ///
    /// Errors: as [`Asset::open`]; what the reader says.
    ///
    /// ```
    /// use squall_runtime::{Asset, ranges::Fetched};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
    /// let file = std::fs::read(path)?;
    /// let length = file.len() as u64;
    /// let asset = Asset::open_range("golden.squall", move |range: std::ops::Range<u64>| {
    ///     Ok(Fetched::Part(file[range.start as usize..range.end.min(length) as usize].to_vec()))
    /// })?;
    /// assert!(asset.fetched_bytes() < Some(length));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn open_range(
        path: impl Into<PathBuf>,
        reader: impl ReadRanges + 'static,
    ) -> Result<Self, RuntimeError> {
        let mut opening = Opening::new(path);
        while let Some(range) = opening.wanted() {
            let at = range.start;
            let io = |source| RuntimeError::Io { path: opening.path.clone(), source };
            match reader.read_range(range.clone()).map_err(io)? {
                Fetched::Part(mut bytes) => {
                    bytes.truncate((range.end - at) as usize);
                    opening.give(at, &bytes)?;
                }
                Fetched::Whole(bytes) => {
                    let asset = Self::assemble(Bytes::copy(&bytes), opening.path, None)?;
                    asset.check_heads()?;
                    return Ok(asset);
                }
            }
        }
        opening.finish_with(Some(Box::new(reader)))
    }

    /// Bytes that came so far, of an asset that is read piece by piece; `None` of one that is here whole.
    pub fn fetched_bytes(&self) -> Option<u64> {
        self.range_rows().map(|rows| rows.fetched.load(Ordering::Relaxed))
    }

    /// Takes rows that [`RuntimeError::NotFetched`] named: the bytes of one of its ranges, from byte `at` of the file on.
    ///
    /// Errors: the asset is here whole; a row is damaged.
    pub fn give(&self, at: u64, bytes: &[u8]) -> Result<(), RuntimeError> {
        let Some(rows) = self.range_rows() else {
            return Err(RuntimeError::argument(
                "asset",
                "one that is read piece by piece",
                "one that is whole",
            ));
        };
        let section = self.section(ResponseSection::TAG, "the cloud's response", ResponseSection::read)?;
        rows.keep(section.index, self.rows_at(section.rows.len()), at, bytes)
            .map_err(|error| self.wrap(error))
    }

    /// Where the rows of the response begin, all of which are `length` bytes and its end.
    fn rows_at(&self, length: usize) -> u64 {
        let end = self.directory().find(ResponseSection::TAG).map_or(0, |entry| entry.offset + entry.length);
        end.saturating_sub(length as u64)
    }

    /// Has rows `wanted` of `index`, which are `length` bytes in all, in memory: reads those that have not come.
    pub(crate) fn fetch_rows(
        &self,
        (index, length): (&[RowEntry], usize),
        wanted: impl Iterator<Item = usize>,
    ) -> Result<(), RuntimeError> {
        let Some(rows) = self.range_rows() else { return Ok(()) };
        let rows_at = self.rows_at(length);
        let mut missing: Vec<usize> =
            wanted.filter(|&row| row < index.len() && rows.row(row, index.len()).is_none()).collect();
        missing.sort_unstable_by(|a, b| b.cmp(a));
        missing.dedup();
        let range = |row: &usize| {
            let start = rows_at + index[*row].offset;
            start..start + u64::from(index[*row].length)
        };
        let ranges = bridged(missing.iter().map(range).collect());
        if ranges.is_empty() {
            return Ok(());
        }
        let Some(reader) = &rows.reader else {
            return Err(RuntimeError::NotFetched { path: self.path().to_owned(), ranges });
        };
        for range in ranges.into_iter().rev() {
            let io = |source| RuntimeError::Io { path: self.path().to_owned(), source };
            let wanted = (range.end - range.start) as usize;
            let bytes = match reader.read_range(range.clone()).map_err(io)? {
                Fetched::Part(bytes) => bytes,
                Fetched::Whole(bytes) => {
                    bytes.get(range.start as usize..range.end as usize).unwrap_or_default().to_vec()
                }
            };
            let Some(bytes) = bytes.get(..wanted) else {
                let found = format!("{} bytes of {range:?}", bytes.len());
                return Err(io(Error::new(ErrorKind::UnexpectedEof, found)));
            };
            rows.keep(index, rows_at, range.start, bytes).map_err(|error| self.wrap(error))?;
        }
        Ok(())
    }
}
