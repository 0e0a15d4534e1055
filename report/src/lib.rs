//! The report of a run: `report.json`, `report.txt`, `report.html` and plots, made from its log; and of one run against another.
//!
//! The log is measured (`evaluation`), the measurement becomes a typed report (`json`), the report a document (`contents`),
//! and the document a text (`text`) and a page (`html`). Making it again gives the same bytes; wall time and real-time factor
//! are the recorder's, and are in the log.

pub mod against;
mod align;
pub mod auxiliary;
mod axes;
mod cause_sections;
mod causes;
mod circle_plot;
pub mod command;
mod contents;
pub mod contour;
mod document;
mod error;
mod evaluation;
mod files;
mod gaps;
mod html;
mod json;
mod label_layout;
mod match_up;
pub mod measure;
pub mod options;
mod path_picture;
pub mod path_plot;
mod peaks;
pub mod plot;
mod ranking;
mod rounded;
pub mod runs;
mod said;
pub mod scope;
pub mod scope_picture;
mod settings_difference;
mod side_by_side;
mod skim;
mod text;
mod tracking_plot;
pub mod turns;

#[cfg(test)]
#[path = "../../monitor/src/test_support.rs"]
mod test_support;
#[cfg(test)]
mod tests;

use std::path::Path;

#[cfg(test)]
use monitor::log;

pub use axes::{AxisReport, BlockReport, PeakRmsPercentiles, PredictionReport};
pub use causes::{BallBarReport, CauseReport, ContourPartReport, ContourPartsReport, OneWayReport};
pub use error::ReportError;
pub use evaluation::{Evaluation, evaluate, run_path};
pub use json::{ArcReport, LogReport, OutcomeReport, PartReport, PeakRms, Report, ScanRange};
pub use peaks::PeakReport;
pub use rounded::MaxMin;

/// Measures the log in a run directory and writes `report.json`, `report.txt`, `report.html` and the plots there.
///
/// # Errors
/// The log, the machine file or the program in the directory cannot be read or do not fit together; or the report
/// cannot be written.
pub fn make_report(run_dir: &Path) -> Result<Report, ReportError> {
    let evaluation = evaluate(run_dir)?;
    let report = Report::new(&evaluation);
    let circles = circle_plot::draw_all(run_dir, &evaluation)?;
    tracking_plot::draw(run_dir, &[&evaluation], &[])?;
    let path = path_picture::draw(run_dir, &evaluation, &report)?;
    let document = contents::document(&report, &contents::Pictures { path, circles });
    files::write(run_dir, "report.txt", &text::render(&document))?;
    files::write(run_dir, "report.html", &html::render(&document, run_dir)?)?;
    files::write(run_dir, "report.json", &report.to_json())?;
    Ok(report)
}
