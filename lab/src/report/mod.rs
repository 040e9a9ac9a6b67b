//! Self-contained pages: plots first, numbers beside, one file that opens offline.
//!
//! A caller fills a [`Page`] with sections, plots and tables and calls [`Page::write_html`]; `reproduce`, `track` and `explain` all do. The layers:
//!
//! - `page`: the parts of a page as plain data, with conditions that tie a series to a reader's choice;
//! - `decimate`: fewer points, the same picture (extremes of each stretch are kept);
//! - `encode`: numbers as compact columns inside the page, equal columns stored once;
//! - `html`: text, tables and figures' frames as HTML; the drawing itself is `assets/page.js`, which depends on nothing;
//! - `whole_file`: a file is written whole or not at all;
//! - `features`: where in the drive a residual lives; `spectrum`: at which frequencies;
//! - `explain_report` and `explain_page`: what an explanation has to show, and how.

mod decimate;
mod encode;
mod evidence;
mod explain_page;
mod explain_report;
mod features;
mod html;
mod page;
mod spectrum;
mod text;
mod whole_file;

pub use decimate::extreme_indices;
pub use explain_page::explain_page;
pub use explain_report::{
    CandidateReport, EvidenceReport, EvidenceTrace, ExperimentReport, ExplainReport, NoiseFloorReport, ParameterReport, RecordReport,
    StepReport,
};
pub use features::{DriveFeature, FeatureCell, drive_features, residual_by_feature};
pub use page::{
    Axis, Band, Block, HeatMap, HeatMapLayer, Level, Notes, Page, Plot, Role, Section, Selector, Series, Style, Table, Tone, Waterfall,
    WaterfallStep, When, Width,
};
pub use spectrum::{Spectrum, amplitude_density};
pub use whole_file::write_whole;
