//! From a file or bytes to an open asset: checks, and views into the bytes; nothing is copied or decoded.

use crate::error::RuntimeError;
use crate::ranges::RangeRows;
use squall_formats::container::{Directory, MAGIC};
use squall_formats::section::response::ResponseSection;
use squall_formats::{Limits, ReadError, Tag};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[cfg(target_endian = "big")]
compile_error!(
    "assets hold little-endian arrays that are used as they lie; big-endian machines are not supported"
);

/// 64 bytes on a 64-byte boundary, so that bytes handed over in memory are aligned like mapped ones.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
pub(crate) struct Block([u8; 64]);

/// Most bytes that are read of a device or pipe, which need not have an end.
pub(crate) const LONGEST_STREAM: usize = 2 << 30;
/// Room to begin with for what has no length beforehand, bytes.
const FIRST_BLOCKS: usize = 1 << 16;

pub(crate) enum Bytes {
    Owned {
        blocks: Vec<Block>,
        length: usize,
    },
    #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
    Mapped(memmap2::Mmap),
}

impl Bytes {
    pub(crate) fn as_slice(&self) -> &[u8] {
        match self {
            Self::Owned { blocks, length } => &bytemuck::cast_slice(blocks)[..*length],
            #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
            Self::Mapped(map) => map,
        }
    }

    /// Reads a file to its end. Of a device or pipe whose first bytes are no asset's, those alone: it need not have an end.
    fn read(mut file: &File) -> std::io::Result<Self> {
        let metadata = file.metadata()?;
        let mut start = Vec::new();
        let length = if metadata.is_file() {
            metadata.len()
        } else {
            file.take(squall_formats::magic::LOOKED_AT as u64).read_to_end(&mut start)?;
            if !start.starts_with(&MAGIC) {
                return Ok(Self::copy(&start));
            }
            0
        };
        let wanted = usize::try_from(length).map_err(|_| std::io::ErrorKind::FileTooLarge)?.max(FIRST_BLOCKS);
        let mut blocks = Vec::new();
        let mut length = start.len();
        loop {
            // Room for one byte more than a regular file has, which shows its end.
            let more = if blocks.is_empty() { wanted / 64 + 1 } else { blocks.len() };
            if !metadata.is_file() && blocks.len() + more > LONGEST_STREAM / 64 {
                return Err(std::io::ErrorKind::FileTooLarge.into());
            }
            blocks.try_reserve_exact(more)?;
            blocks.resize(blocks.len() + more, Block([0; 64]));
            let room: &mut [u8] = bytemuck::cast_slice_mut(&mut blocks);
            room[..start.len()].copy_from_slice(&start);
            while length < room.len() {
                match file.read(&mut room[length..]) {
                    Ok(0) => {
                        blocks.truncate(length.div_ceil(64));
                        return Ok(Self::Owned { blocks, length });
                    }
                    Ok(count) => length += count,
                    Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                    Err(error) => return Err(error),
                }
            }
        }
    }

    /// So many zeros, of which the system takes no memory before they are written to; `None` where there is no room.
    pub(crate) fn zeros(length: usize) -> Option<Self> {
        let blocks = bytemuck::allocation::try_zeroed_vec(length.div_ceil(64)).ok()?;
        Some(Self::Owned { blocks, length })
    }

    /// Puts `bytes` at `at`. Panics where they reach behind the end, or of a file that is mapped.
    pub(crate) fn fill(&mut self, at: usize, bytes: &[u8]) {
        match self {
            Self::Owned { blocks, length } => {
                let room: &mut [u8] = &mut bytemuck::cast_slice_mut(blocks)[..*length];
                room[at..at + bytes.len()].copy_from_slice(bytes);
            }
            #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
            Self::Mapped(_) => unreachable!("a mapped file is not written to"),
        }
    }

    pub(crate) fn copy(bytes: &[u8]) -> Self {
        let mut blocks = vec![Block([0; 64]); bytes.len().div_ceil(64)];
        bytemuck::cast_slice_mut(&mut blocks)[..bytes.len()].copy_from_slice(bytes);
        Self::Owned { blocks, length: bytes.len() }
    }
}

/// An open `.squall` asset: a handle, whose clones share the file's bytes.
///
/// ```
/// use squall_runtime::Asset;
/// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
/// let asset = Asset::open(path)?;
/// assert_eq!(asset.clone().directory().entries.len(), 8);
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
///
/// Opening checks the header, the section table and the head of every section; bulk coefficients are
/// checked when they are first touched. It allocates the section table alone.
#[derive(Clone)]
pub struct Asset(Arc<Inner>);

struct Inner {
    bytes: Bytes,
    directory: Directory,
    limits: Limits,
    path: PathBuf,
    /// Rows that come when they are wanted, of an asset that is read piece by piece.
    rows: Option<RangeRows>,
}

impl Asset {
    /// Opens an asset file: memory-mapped with feature `mmap`, else read whole.
    ///
    /// A mapped file must not be truncated in place while the asset is open: touching a byte that is gone ends the process with
    /// SIGBUS. Squall's own writers never write in place; they rename whole files over old ones, and an open asset keeps the bytes
    /// that it opened. Where other programs write, or a network folder may go away, take [`Asset::read`].
    ///
    /// Errors: the file cannot be read, is not an asset, is damaged in a part that opening checks, has a
    /// newer version or a required section that this build does not know.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, RuntimeError> {
        let asset = Self::open_directory(path)?;
        asset.check_heads()?;
        Ok(asset)
    }

    /// Reads an asset file into memory, 64 bytes aligned as a map is: whatever becomes of the file afterwards, the asset stays whole.
    /// Takes as much memory as the file has bytes, and the time to read them all.
    ///
    /// Errors: as [`Asset::open`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self, RuntimeError> {
        let asset = Self::read_directory(path)?;
        asset.check_heads()?;
        Ok(asset)
    }

    /// [`Asset::open_directory`] for a file that is read into memory as by [`Asset::read`].
    pub fn read_directory(path: impl AsRef<Path>) -> Result<Self, RuntimeError> {
        let path = path.as_ref();
        let bytes = File::open(path).and_then(|file| Bytes::read(&file));
        Self::new(
            bytes.map_err(|source| RuntimeError::Io { path: path.to_owned(), source })?,
            path.to_owned(),
        )
    }

    /// Like [`Asset::open`], but checks the header and the section table alone; each section's head is
    /// then checked when that section is read. For tools that want one section of a possibly damaged file.
    pub fn open_directory(path: impl AsRef<Path>) -> Result<Self, RuntimeError> {
        let path = path.as_ref();
        let io = |source| RuntimeError::Io { path: path.to_owned(), source };
        #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
        let bytes = {
            let file = File::open(path).map_err(io)?;
            let metadata = file.metadata().map_err(io)?;
            if metadata.is_file() && metadata.len() > 0 {
                Bytes::Mapped(crate::audited::map_file(&file).map_err(io)?)
            } else {
                Bytes::read(&file).map_err(io)?
            }
        };
        #[cfg(not(all(feature = "mmap", not(target_family = "wasm"))))]
        let bytes = File::open(path).and_then(|file| Bytes::read(&file)).map_err(io)?;
        Self::new(bytes, path.to_owned())
    }

    /// An asset from bytes in memory, which are copied once.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, RuntimeError> {
        let asset = Self::new(Bytes::copy(bytes), PathBuf::from("(memory)"))?;
        asset.check_heads()?;
        Ok(asset)
    }

    fn new(bytes: Bytes, path: PathBuf) -> Result<Self, RuntimeError> {
        Self::assemble(bytes, path, None)
    }

    /// An asset of bytes that are here, but for the rows that `rows` brings.
    pub(crate) fn assemble(
        bytes: Bytes,
        path: PathBuf,
        rows: Option<RangeRows>,
    ) -> Result<Self, RuntimeError> {
        let limits = Limits::default();
        let read = Directory::read(bytes.as_slice(), &limits);
        let wrap = |source| RuntimeError::Asset { path: path.clone(), source };
        let directory = read.map_err(wrap)?;
        squall_formats::section::check_marks(&directory).map_err(wrap)?;
        Ok(Self(Arc::new(Inner { bytes, directory, limits, path, rows })))
    }

    /// The rows of an asset that is read piece by piece.
    pub(crate) fn range_rows(&self) -> Option<&RangeRows> {
        self.0.rows.as_ref()
    }

    /// Checks the head of every section.
    pub(crate) fn check_heads(&self) -> Result<(), RuntimeError> {
        for entry in &self.0.directory.entries {
            entry.check_head(self.bytes()).map_err(|source| self.wrap(source))?;
        }
        Ok(())
    }

    /// Recomputes the checksum of section `tag` with its bulk, for those who are about to use it all.
    ///
    /// Errors: the section is damaged; it is the response of an asset that is read piece by piece. An asset without it passes.
    pub fn check_bulk(&self, tag: Tag) -> Result<(), RuntimeError> {
        let Some(entry) = self.0.directory.find(tag) else { return Ok(()) };
        if tag == ResponseSection::TAG {
            self.check_is_whole()?;
        }
        entry.check_whole(self.bytes()).map_err(|source| self.wrap(source))
    }

    /// Errors: this is an asset that is read piece by piece.
    pub(crate) fn check_is_whole(&self) -> Result<(), RuntimeError> {
        match self.0.rows {
            Some(_) => Err(RuntimeError::argument(
                "asset",
                "one that is here whole: Asset::open or Asset::read",
                "one that is read piece by piece",
            )),
            None => Ok(()),
        }
    }

    /// Bounds on what a file may ask for.
    pub fn limits(&self) -> &Limits {
        &self.0.limits
    }

    /// The asset's section table.
    pub fn directory(&self) -> &Directory {
        &self.0.directory
    }

    /// The file that was opened, or `(memory)`.
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// All bytes of the asset; of one that is read piece by piece ([`Asset::open_range`]), the rows of its response are zeros.
    pub fn bytes(&self) -> &[u8] {
        self.0.bytes.as_slice()
    }

    /// Reads section `tag` with `read`; `holds` says in words what it is for.
    pub fn section<'a, T>(
        &'a self,
        tag: Tag,
        holds: &'static str,
        read: impl FnOnce(&'a [u8], u16, &Limits) -> Result<T, ReadError>,
    ) -> Result<T, RuntimeError> {
        let bytes = self.0.directory.section(self.bytes(), tag, holds).map_err(|source| self.wrap(source))?;
        let version = self.0.directory.find(tag).map_or(0, |entry| entry.version);
        read(bytes, version, &self.0.limits).map_err(|source| self.wrap(source))
    }

    /// Names this asset's file in an error about its bytes.
    pub fn wrap(&self, source: ReadError) -> RuntimeError {
        RuntimeError::Asset { path: self.0.path.clone(), source }
    }
}

impl std::fmt::Debug for Asset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Inner { directory, path, .. } = &*self.0;
        f.debug_struct("Asset").field("path", path).field("sections", &directory.entries.len()).finish()
    }
}

impl From<&Asset> for Asset {
    fn from(asset: &Asset) -> Self {
        asset.clone()
    }
}

impl From<Arc<Asset>> for Asset {
    fn from(asset: Arc<Asset>) -> Self {
        (*asset).clone()
    }
}
