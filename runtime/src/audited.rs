//! The one module with `unsafe`: the memory map. Each block says why it is sound.
#![allow(unsafe_code)]

#[cfg(all(feature = "mmap", not(target_family = "wasm")))]
/// Maps a file for reading.
pub(crate) fn map_file(file: &std::fs::File) -> std::io::Result<memmap2::Mmap> {
    // SAFETY: a map is undefined behaviour only if the file shrinks or changes under it. Assets are
    // written to a temporary name and renamed into place, never edited; a file that another program
    // truncates while it is mapped ends this process with SIGBUS, which is the caller's to avoid.
    unsafe { memmap2::Mmap::map(file) }
}
