//! The monitor process: records the samples of a run.
//!
//! A reader descends so: [`log`] writes and reads `run.mcap`; `black_box` keeps what led to a fault. The crate `report` measures
//! errors, arcs and reversals, and has the signals that can be shown and triggered on.
//!
//! **Invariant**: nothing here looks at a clock to decide a number. Only the recorder does, to flush once a second, and
//! the wall time of a run is handed in.

mod black_box;
pub mod deaths;
pub mod digest;
pub mod ended;
pub mod log;
mod logbook;
pub mod losses;
mod options;
pub mod quantities;
pub mod room;
mod run;
pub mod said;
mod sinks;
mod standbys;
#[cfg(test)]
#[allow(dead_code, reason = "shared with the tests of the report")]
mod test_support;
pub mod words;
pub use black_box::BLACK_BOX_PREFIX;
pub use logbook::{MARK_FILE, run_folder, run_number};
pub use options::{MonitorError, Options};
pub use run::run;
