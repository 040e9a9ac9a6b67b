//! Self-contained pages: plots first, numbers beside, one file that opens offline.
//!
//! A caller fills a [`Page`] with sections, plots and tables and calls [`Page::to_html`]; `reproduce`,
//! `track` and `explain` all do:
//!
//! ```
//! use hysteron_report::{CurveRole, Page, PageBlock, Plot, Section, Series, Table};
//!
//! let t_s: Vec<f64> = (0..100).map(|k| f64::from(k) * 1e-3).collect();
//! let reference = t_s.iter().map(|t| (60.0 * t).sin()).collect();
//! let error = t_s.iter().map(|t| 2.0 * (60.0 * t).cos()).collect();
//! let page = Page {
//!     title: "Tracking 10 Hz".into(),
//!     lead_sentence: "The error stays below 2 nm.".into(),
//!     sections: vec![Section {
//!         heading: "Over time".into(),
//!         text: "Both plots share their time axis.".into(),
//!         blocks: vec![
//!             PageBlock::Plot(
//!                 Plot::new("Reference")
//!                     .x_axis("time", "s")
//!                     .y_axis("displacement", "um")
//!                     .link("time")
//!                     .with(Series::line("reference", CurveRole::Reference, t_s.clone(), reference)),
//!             ),
//!             PageBlock::Plot(
//!                 Plot::new("Error")
//!                     .x_axis("time", "s")
//!                     .y_axis("error", "nm")
//!                     .link("time")
//!                     .with(Series::line("error", CurveRole::Residual, t_s, error))
//!                     .level("goal", 2.0),
//!             ),
//!             PageBlock::Table(Table {
//!                 columns: vec!["Frequency, Hz".into(), "RMS, nm".into()],
//!                 rows: vec![vec!["10".into(), "1.4".into()]],
//!                 ..Table::default()
//!             }),
//!         ],
//!     }],
//!     ..Page::default()
//! };
//! assert!(page.to_html().contains("Tracking 10 Hz"));
//! ```
//!
//! The layers:
//!
//! - `page`: the parts of a page as plain data, with conditions that tie a series to a reader's choice;
//! - `decimate`: fewer points, the same picture (extremes of each stretch are kept);
//! - `encode`: numbers as compact columns inside the page, equal columns stored once;
//! - `html`: text, tables and figures' frames as HTML; the drawing itself is `assets/page.js`, which depends
//!   on nothing;
//! - `explain_report` and `explain_page`: what an explanation has to show, and how; `of_findings` fills the
//!   one from what the library found;
//! - `servo_plots` and `track_page`: a servo, its loop and its work; `survey_page`: many recordings; `stepping_page`:
//!   a stick-slip drive;
//! - `effects_page`: the library of effects as a page; `falling_error`: the growth of a model as a picture
//!   that moves.

mod axes_page;
mod decimate;
mod dynamics;
mod effects_page;
mod encode;
mod evidence;
mod explain_page;
mod explain_report;
mod falling_error;
mod html;
mod loops;
mod of_findings;
mod page;
mod rig_page;
mod servo_plots;
pub mod servo_words;
mod stepping_page;
mod survey_page;
mod text;
mod track_page;

pub use axes_page::axes_page;
pub use decimate::extreme_indices;
pub use effects_page::effects_page;
pub use explain_page::explain_page;
pub use explain_report::{
    CandidateReport, EvidenceReport, EvidenceTrace, ExperimentReport, ExplainReport,
    NoiseFloorReport, ParameterReport, RecordReport, StepReport,
};
pub use falling_error::falling_error_svg;
pub use of_findings::{comparison_report, explain_report};
pub use page::{
    Axis, Band, CurveRole, HeatMap, HeatMapLayer, Level, Notes, Page, PageBlock, Plot, Section,
    Selector, Series, Style, Table, Tone, Waterfall, WaterfallStep, When, Width,
};
pub use rig_page::rig_page;
pub use servo_plots::{learning, nyquist, sensitivity, trade_off};
pub use stepping_page::stepping_page;
pub use survey_page::survey_page;
pub use track_page::{TrackPage, step_section};
