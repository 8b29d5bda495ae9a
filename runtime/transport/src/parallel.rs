//! Work spread over the caller's rayon pool with feature `rayon`, done in order without it, written once for both.
//!
//! [`prelude`] names the parallel methods of slices either way; [`map_chunks`] keeps the order of sums. The same bytes come out
//! with the feature, without it, and for any number of threads.

/// Parallel methods of slices: rayon's, or their namesakes that run in order.
pub mod prelude {
    #[cfg(not(feature = "rayon"))]
    pub use super::in_order::{IteratorInOrder, SliceInOrder};
    #[cfg(feature = "rayon")]
    pub use rayon::prelude::*;
}

#[cfg(not(feature = "rayon"))]
mod in_order {
    /// Rayon's names for the plain iterators of a slice.
    pub trait SliceInOrder<T> {
        /// `iter`.
        fn par_iter(&self) -> std::slice::Iter<'_, T>;
        /// `iter_mut`.
        fn par_iter_mut(&mut self) -> std::slice::IterMut<'_, T>;
        /// `chunks`.
        fn par_chunks(&self, size: usize) -> std::slice::Chunks<'_, T>;
        /// `chunks_mut`.
        fn par_chunks_mut(&mut self, size: usize) -> std::slice::ChunksMut<'_, T>;
    }

    impl<T> SliceInOrder<T> for [T] {
        fn par_iter(&self) -> std::slice::Iter<'_, T> {
            self.iter()
        }

        fn par_iter_mut(&mut self) -> std::slice::IterMut<'_, T> {
            self.iter_mut()
        }

        fn par_chunks(&self, size: usize) -> std::slice::Chunks<'_, T> {
            self.chunks(size)
        }

        fn par_chunks_mut(&mut self, size: usize) -> std::slice::ChunksMut<'_, T> {
            self.chunks_mut(size)
        }
    }

    /// Rayon's methods that say how work is divided.
    pub trait IteratorInOrder: Iterator + Sized {
        /// Nothing is divided.
        fn with_min_len(self, _: usize) -> Self {
            self
        }
    }

    impl<I: Iterator> IteratorInOrder for I {}
}

/// Results in flight at once in [`map_chunks`]: bounds memory, whatever the number of chunks.
#[cfg(feature = "rayon")]
const AT_ONCE: usize = 8;

/// Works out `work(number, chunk)` for every chunk of `size` values, some of them at a time, and hands the results to `take` one
/// after the other, in the order of the chunks: sums of floating-point numbers then do not depend on the threads.
///
/// Panics when `size` is 0.
pub fn map_chunks<T: Sync, R: Send>(
    values: &[T],
    size: usize,
    work: impl Fn(usize, &[T]) -> R + Sync,
    mut take: impl FnMut(R),
) {
    #[cfg(feature = "rayon")]
    for (group, values) in values.chunks(size * AT_ONCE).enumerate() {
        use rayon::prelude::*;
        let chunks = values.par_chunks(size).enumerate();
        let results: Vec<R> = chunks.map(|(at, chunk)| work(group * AT_ONCE + at, chunk)).collect();
        results.into_iter().for_each(&mut take);
    }
    #[cfg(not(feature = "rayon"))]
    for (number, chunk) in values.chunks(size).enumerate() {
        take(work(number, chunk));
    }
}

#[cfg(test)]
mod tests {
    use super::map_chunks;

    #[test]
    fn results_arrive_in_order_with_their_chunks_numbers() {
        let values: Vec<u32> = (0..1003).collect();
        let (mut seen, mut numbers) = (Vec::new(), Vec::new());
        map_chunks(
            &values,
            10,
            |number, chunk| (number, chunk.to_vec()),
            |(number, chunk)| {
                numbers.push(number);
                seen.extend(chunk);
            },
        );
        assert_eq!(seen, values);
        assert_eq!(numbers, (0..101).collect::<Vec<_>>());
        map_chunks(&[0u8; 0], 10, |_, _| (), |()| panic!("there is nothing to work on"));
    }
}
