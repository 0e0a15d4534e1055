//! The monitor process: records every sample.
//!
//! A reader descends so: [`log`] writes and reads `run.mcap`; [`black_box`] keeps what led to a fault; [`scope`] has the signals that
//! can be shown and triggered on, tracking and contour error among them. The crate `report` measures errors, arcs and reversals.
//!
//! **Invariant**: nothing here looks at a clock to decide a number. Only the recorder does, to flush once a second, and
//! the wall time of a run is handed in.

pub mod align;
pub mod auxiliary;
pub mod black_box;
pub mod contour;
pub mod deaths;
pub mod digest;
pub mod log;
mod logbook;
pub mod losses;
mod options;
mod run;
pub mod said;
pub mod scope;
mod sinks;
#[cfg(test)]
#[allow(dead_code, reason = "shared with the tests of the report")]
mod test_support;
pub mod turns;
pub mod words;
pub use logbook::{run_folder, run_number};
pub use options::{MonitorError, Options};
pub use run::run;
