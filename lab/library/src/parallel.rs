//! Work spread over the cores where the feature `threads` is on, one after the other where it is not.
//!
//! Results come in the order of the items, and every sum over them is taken in that order: the same input gives the same output, bit for
//! bit, whatever the number of threads.

/// What `f` makes of every item, in their order.
pub fn map<T: Sync, R: Send>(items: &[T], f: impl Fn(&T) -> R + Sync + Send) -> Vec<R> {
    map_indices(items.len(), |i| f(&items[i]))
}

/// What `f` makes of `0..count`, in that order.
#[cfg(feature = "threads")]
pub fn map_indices<R: Send>(count: usize, f: impl Fn(usize) -> R + Sync + Send) -> Vec<R> {
    use rayon::prelude::*;
    (0..count).into_par_iter().map(f).collect()
}

/// What `f` makes of `0..count`, in that order.
#[cfg(not(feature = "threads"))]
pub fn map_indices<R: Send>(count: usize, f: impl Fn(usize) -> R + Sync + Send) -> Vec<R> {
    (0..count).map(f).collect()
}
