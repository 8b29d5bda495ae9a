//! The one module with `unsafe`: the memory map, and memory that is asked for ahead. Each block says why it is sound.
#![allow(unsafe_code)]

#[cfg(all(feature = "mmap", not(target_family = "wasm")))]
/// Maps a file for reading.
pub(crate) fn map_file(file: &std::fs::File) -> std::io::Result<memmap2::Mmap> {
    // SAFETY: a map is undefined behaviour only if the file shrinks or changes under it. Assets are
    // written to a temporary name and renamed into place, never edited; a file that another program
    // truncates while it is mapped ends this process with SIGBUS, which is the caller's to avoid.
    unsafe { memmap2::Mmap::map(file) }
}

/// Asks for the line of the cache that holds `place`, and waits for nothing; nothing at all where a processor has no such instruction.
#[inline(always)]
pub(crate) fn prefetch<T>(place: &T) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: the instruction is a hint that reads nothing into the program and faults at no address; every x86-64 has it.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(place).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = place;
}
