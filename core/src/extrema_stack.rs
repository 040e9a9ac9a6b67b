//! The memory of a Preisach-type hysteresis: the alternating extrema of the input that still matter.
//!
//! # How it works
//! The stack holds the dominant maxima `M_1 > M_2 > ..` and the dominant minima `m_1 < m_2 < ..` of the
//! input, newest last. While the input rises both lists are equally long; while it falls there is one maximum
//! more. A new input
//!
//! 1. closes the running monotone section when the direction changes (the last value becomes an extremum),
//!    then
//! 2. wipes out every inner loop that the new value passes.
//!
//! The wiping-out follows the one-sided rule of the thesis (Ch. 4, 3.1): `m_0`, the lower limit of the input,
//! and the global maximum `M_1` are never wiped out. Passing `M_1` only moves it: the input is then on the
//! initial ascending curve, and no minimum remembers anything any more.
//!
//! The capacity is fixed. When it is full the smallest loop, the innermost one, is dropped, which is counted
//! and whose height is kept, so that a model can bound the error that this made
//! ([`ExtremaStack::dropped_loops`], [`ExtremaStack::largest_dropped_loop`]).
//!
//! A model that caches one partial sum per stored pair learns from [`ExtremaStack::update`] how many leading
//! pairs are untouched and recomputes only the rest.

use heapless::Vec;

/// One closed pair of the memory: a maximum and the minimum that followed it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair<T> {
    /// Dominant local maximum `M_k`.
    pub maximum: T,
    /// Dominant local minimum `m_k` that followed it.
    pub minimum: T,
}

/// Extrema memory of a one-sided hysteresis for inputs of type `T`, with room for `N` pairs.
///
/// `T` is an `f64` voltage in the plant models and an integer voltage code in the controller; the rule exists
/// only here. Values must be comparable (no NaN): callers check their input once, at the boundary.
#[derive(Clone, Debug)]
pub struct ExtremaStack<T, const N: usize> {
    pairs: Vec<Pair<T>, N>,
    /// `M_{n+1}`, present while the input falls; while it rises and no pair is closed, the moving `M_1` is
    /// `input`.
    open_maximum: Option<T>,
    lower_limit: T,
    input: T,
    dropped_loops: u32,
    largest_dropped_loop: T,
}

impl<T, const N: usize> ExtremaStack<T, N>
where
    T: Copy + PartialOrd + core::ops::Sub<Output = T> + Default,
{
    /// A virgin memory: the input stands at its lower limit `m_0` and has never been higher.
    #[must_use]
    pub fn virgin(lower_limit: T) -> Self {
        Self {
            pairs: Vec::new(),
            open_maximum: None,
            lower_limit,
            input: lower_limit,
            dropped_loops: 0,
            largest_dropped_loop: T::default(),
        }
    }

    /// Takes the next input, in at most `N` steps, and returns how many leading pairs are the same as before.
    ///
    /// An input below the lower limit is an extremum like any other: the surfaces are continued there.
    /// Whoever must not leave the limits (an amplifier) clamps before.
    pub fn update(&mut self, input: T) -> usize {
        let mut unchanged = self.pairs.len();
        if input > self.input {
            if let Some(maximum) = self.open_maximum.take() {
                unchanged = self.close(Pair {
                    maximum,
                    minimum: self.input,
                });
            }
            self.wipe_out(|pair| input < pair.maximum);
        } else if input < self.input {
            let outermost = self.wipe_out(|pair| input > pair.minimum);
            self.open_maximum = outermost.or(self.open_maximum).or(Some(self.input));
        }
        self.input = input;
        unchanged.min(self.pairs.len())
    }

    /// Removes the innermost pairs up to one that is `larger` than the input, and returns the maximum of the
    /// outermost that goes.
    #[inline(always)]
    fn wipe_out(&mut self, larger: impl Fn(&Pair<T>) -> bool) -> Option<T> {
        let (mut kept, mut outermost) = (self.pairs.len(), None);
        for pair in self.pairs.iter().rev() {
            if larger(pair) {
                break;
            }
            kept -= 1;
            outermost = Some(pair.maximum);
        }
        if outermost.is_some() {
            self.pairs.truncate(kept);
        }
        outermost
    }

    /// Replaces the present input by one that is equal to it, for a `T` that carries more than what it is
    /// compared by.
    #[inline]
    pub fn replace_input(&mut self, equal: T) {
        self.input = equal;
    }

    /// Stores a closed pair. Returns the pairs left untouched: all of them.
    ///
    /// Loops are nested, so the smallest one is always that which would be stored; without room it is the one
    /// to forget.
    fn close(&mut self, pair: Pair<T>) -> usize {
        let unchanged = self.pairs.len();
        if self.pairs.push(pair).is_err() {
            self.dropped_loops = self.dropped_loops.saturating_add(1);
            let height = pair.maximum - pair.minimum;
            if height > self.largest_dropped_loop {
                self.largest_dropped_loop = height;
            }
        }
        unchanged
    }

    /// Closed pairs `(M_k, m_k)`, outermost first.
    #[must_use]
    pub fn pairs(&self) -> &[Pair<T>] {
        &self.pairs
    }

    /// The maximum that the input is falling from, if it is falling.
    #[must_use]
    pub fn open_maximum(&self) -> Option<T> {
        self.open_maximum
    }

    /// Global maximum `M_1` of the input so far.
    #[must_use]
    pub fn global_maximum(&self) -> T {
        match (self.pairs.first(), self.open_maximum) {
            (Some(pair), _) => pair.maximum,
            (None, Some(maximum)) => maximum,
            (None, None) => self.input,
        }
    }

    /// True while the input moves along the initial ascending curve.
    #[must_use]
    pub fn on_initial_ascending_curve(&self) -> bool {
        self.pairs.is_empty() && self.open_maximum.is_none()
    }

    /// Present input.
    #[must_use]
    pub fn input(&self) -> T {
        self.input
    }

    /// Lower limit `m_0` of the input.
    #[must_use]
    pub fn lower_limit(&self) -> T {
        self.lower_limit
    }

    /// Number of loops that were dropped because the stack was full.
    #[must_use]
    pub fn dropped_loops(&self) -> u32 {
        self.dropped_loops
    }

    /// Height, in units of the input, of the largest loop that was dropped.
    #[must_use]
    pub fn largest_dropped_loop(&self) -> T {
        self.largest_dropped_loop
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec as StdVec;

    /// The rule of Ch. 4, 3.1 by definition: from the whole history, the alternating dominant extrema after
    /// the global maximum.
    fn dominant_extrema(history: &[i32]) -> StdVec<i32> {
        let mut extrema = StdVec::new();
        let mut from = 0;
        let mut want_maximum = true;
        while from < history.len() {
            let slice = &history[from..];
            let best = if want_maximum {
                *slice.iter().max().unwrap()
            } else {
                *slice.iter().min().unwrap()
            };
            let at = from + slice.iter().rposition(|v| *v == best).unwrap();
            extrema.push(best);
            want_maximum = !want_maximum;
            from = at + 1;
        }
        extrema
    }

    fn stored<const N: usize>(stack: &ExtremaStack<i32, N>) -> StdVec<i32> {
        let mut out = StdVec::new();
        for pair in stack.pairs() {
            out.push(pair.maximum);
            out.push(pair.minimum);
        }
        out.extend(stack.open_maximum());
        if out.last() != Some(&stack.input()) {
            out.push(stack.input());
        }
        out
    }

    #[test]
    fn the_example_of_chapter_4_figure_5() {
        let mut stack = ExtremaStack::<i32, 8>::virgin(0);
        for u in [10, 30, 60, 40, 20, 30, 45] {
            stack.update(u);
        }
        assert_eq!(
            stack.pairs(),
            &[Pair {
                maximum: 60,
                minimum: 20
            }]
        );
        stack.update(30);
        assert_eq!(stack.open_maximum(), Some(45));
        stack.update(61);
        assert!(stack.on_initial_ascending_curve());
        assert_eq!(stack.global_maximum(), 61);
    }

    proptest! {
        #[test]
        fn stored_extrema_are_the_dominant_ones(inputs in proptest::collection::vec(0i32..200, 1..60)) {
            let mut stack = ExtremaStack::<i32, 64>::virgin(0);
            let mut history = std::vec![0];
            for u in inputs {
                stack.update(u);
                history.push(u);
                prop_assert_eq!(stored(&stack), dominant_extrema(&history));
                prop_assert_eq!(stack.global_maximum(), *history.iter().max().unwrap());
            }
            prop_assert_eq!(stack.dropped_loops(), 0);
        }

        #[test]
        fn unchanged_pairs_are_reported_truly(inputs in proptest::collection::vec(0i32..500, 1..200)) {
            let mut stack = ExtremaStack::<i32, 4>::virgin(0);
            for u in inputs {
                let before: StdVec<_> = stack.pairs().to_vec();
                let unchanged = stack.update(u);
                prop_assert!(unchanged <= stack.pairs().len());
                prop_assert_eq!(&stack.pairs()[..unchanged], &before[..unchanged]);
            }
        }

        #[test]
        fn a_full_stack_stays_nested(inputs in proptest::collection::vec(0i32..1000, 1..300)) {
            let mut stack = ExtremaStack::<i32, 3>::virgin(0);
            let mut largest = 0;
            for u in inputs {
                stack.update(u);
                largest = largest.max(u);
                let values = stored(&stack);
                for window in values.windows(3) {
                    let (low, high) = (window[0].min(window[1]), window[0].max(window[1]));
                    prop_assert!(window[2] >= low && window[2] <= high);
                }
                prop_assert_eq!(stack.global_maximum(), largest);
            }
        }
    }
}
