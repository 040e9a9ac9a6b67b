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

/// Into how many parts work on some things of a kind is worth dividing, so that every core has some.
pub fn parts_of_each(things: usize) -> usize {
    cores().div_ceil(things.max(1))
}

#[cfg(feature = "threads")]
fn cores() -> usize {
    rayon::current_num_threads()
}

#[cfg(not(feature = "threads"))]
fn cores() -> usize {
    1
}
