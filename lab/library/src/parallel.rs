//! Work spread over the cores where the feature `threads` is on, one after the other where it is not.
//!
//! Results come in the order of the items, and every sum over them is taken in that order: the same input
//! gives the same output, bit for bit, whatever the number of threads.

#[cfg(feature = "threads")]
use std::sync::OnceLock;

/// What `f` makes of every item, in their order.
pub fn map<T: Sync, R: Send + Sync>(items: &[T], f: impl Fn(&T) -> R + Sync + Send) -> Vec<R> {
    map_indices(items.len(), |i| f(&items[i]))
}

/// What `f` makes of `0..count`, in that order.
#[cfg(feature = "threads")]
pub fn map_indices<R: Send + Sync>(count: usize, f: impl Fn(usize) -> R + Sync + Send) -> Vec<R> {
    let results: Vec<OnceLock<R>> = std::iter::repeat_with(OnceLock::new).take(count).collect();
    for_each_index(count, &|i| {
        // Every index comes once, so that its place is empty.
        let _ = results[i].set(f(i));
    });
    results
        .into_iter()
        .filter_map(OnceLock::into_inner)
        .collect()
}

/// Not generic, so that the thread pool's machinery is compiled once and not for every closure.
#[cfg(feature = "threads")]
fn for_each_index(count: usize, f: &(dyn Fn(usize) + Sync)) {
    use rayon::prelude::*;
    (0..count).into_par_iter().for_each(f);
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
