//! A lock-free queue of one producer and one consumer with a length that the compiler knows.
//!
//! heapless' queue hides its length behind a pointer, and a remainder by a length that might be zero brings a
//! panic into the control interrupt; the check of the binary found it. Here the length is a power of two and
//! the remainder a mask.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicUsize, Ordering};

/// Room for `N` elements; `N` is a power of two.
pub struct Ring<T, const N: usize> {
    slots: [UnsafeCell<MaybeUninit<T>>; N],
    /// Elements ever written and read, wrapping.
    written: AtomicUsize,
    read: AtomicUsize,
}

// SAFETY: a slot belongs to the producer until `written` passes it and to the consumer until `read` does;
// there is one of each.
unsafe impl<T: Copy + Send, const N: usize> Sync for Ring<T, N> {}

impl<T: Copy, const N: usize> Ring<T, N> {
    const POWER_OF_TWO: () = assert!(N.is_power_of_two());

    /// Empty.
    pub const fn new() -> Self {
        let () = Self::POWER_OF_TWO;
        Self {
            slots: [const { UnsafeCell::new(MaybeUninit::uninit()) }; N],
            written: AtomicUsize::new(0),
            read: AtomicUsize::new(0),
        }
    }

    /// Its two ends.
    pub fn split(&'static mut self) -> (Producer<T, N>, Consumer<T, N>) {
        (Producer(self), Consumer(self))
    }
}

/// The end that writes.
pub struct Producer<T: 'static, const N: usize>(&'static Ring<T, N>);
/// The end that reads.
pub struct Consumer<T: 'static, const N: usize>(&'static Ring<T, N>);

impl<T: Copy, const N: usize> Producer<T, N> {
    /// Puts an element in; `false` if there is no room.
    #[inline(always)]
    pub fn enqueue(&mut self, element: T) -> bool {
        let (written, read) = (
            self.0.written.load(Ordering::Relaxed),
            self.0.read.load(Ordering::Acquire),
        );
        if written.wrapping_sub(read) >= N {
            return false;
        }
        // The index is below N.
        if let Some(slot) = self.0.slots.get(written & (N - 1)) {
            // SAFETY: the consumer does not look at this slot before `written` has passed it.
            unsafe { (*slot.get()).write(element) };
        }
        self.0
            .written
            .store(written.wrapping_add(1), Ordering::Release);
        true
    }

    /// Elements ever put in, wrapping: what [`Consumer::skip_to`] takes.
    pub fn position(&self) -> usize {
        self.0.written.load(Ordering::Relaxed)
    }

    /// Whether there is room for another element.
    pub fn has_room(&self) -> bool {
        self.position()
            .wrapping_sub(self.0.read.load(Ordering::Relaxed))
            < N
    }
}

impl<T: Copy, const N: usize> Consumer<T, N> {
    /// Takes the oldest element.
    #[inline(always)]
    pub fn dequeue(&mut self) -> Option<T> {
        let (written, read) = (
            self.0.written.load(Ordering::Acquire),
            self.0.read.load(Ordering::Relaxed),
        );
        if written == read {
            return None;
        }
        let slot = self.0.slots.get(read & (N - 1))?;
        // SAFETY: the producer wrote this slot before `written` passed it, and does not touch it before
        // `read` does.
        let element = unsafe { (*slot.get()).assume_init() };
        self.0.read.store(read.wrapping_add(1), Ordering::Release);
        Some(element)
    }

    /// Forgets the elements that were put in before the producer stood at `position`, and says how many they
    /// were.
    #[inline(always)]
    pub fn skip_to(&mut self, position: usize) -> usize {
        let skipped = position.wrapping_sub(self.0.read.load(Ordering::Relaxed));
        // What was read meanwhile is behind it.
        if skipped > N {
            return 0;
        }
        self.0.read.store(position, Ordering::Release);
        skipped
    }
}
