//! What a check examines, and when.

use crate::dataset::Dataset;
use crate::diagnosis::judgement::Judged;
use crate::diagnosis::study::Study;
use crate::identification::noise_floor::NoiseFloor;

/// What a check examines.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The data set.
    pub dataset: &'a Dataset,
    /// When.
    pub moment: Moment<'a>,
}

/// When checks run.
#[derive(Clone, Copy)]
pub enum Moment<'a> {
    /// Before anything is fitted.
    BeforeSearch,
    /// A prior model as it is.
    PriorModel(&'a Study<'a>, &'a Judged),
    /// The first fitted model.
    FirstFit(&'a Study<'a>, &'a Judged),
    /// The first model of a search that is the best with loops and a mode, far above the noise.
    LoopsAndMode(&'a Study<'a>, &'a Judged),
    /// After the search.
    End(&'a End<'a>),
}

/// What a search came to.
pub struct End<'a> {
    /// Fits other models to the same data.
    pub study: &'a Study<'a>,
    /// The noise.
    pub noise: &'a NoiseFloor,
    /// The model that the search started from.
    pub first: &'a Judged,
    /// The model at the end.
    pub last: &'a Judged,
    /// Effects that the search added.
    pub added: &'a [String],
}
