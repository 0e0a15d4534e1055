//! The monitor process: records every sample, measures and shows.
//!
//! A reader descends so: [`log`] writes and reads `run.mcap`; [`measure`] turns the stream of samples into errors,
//! arcs and reversals, the same code whether the stream comes from the wire or from the log. What is made of them lies in the crate `report`.
//!
//! **Invariant**: nothing here looks at a clock to decide a number. Only the recorder does, to flush once a second, and
//! the wall time of a run is handed in.

pub mod auxiliary;
pub mod black_box;
pub mod deaths;
pub mod digest;
pub mod log;
mod logbook;
pub mod measure;
mod options;
mod run;
pub mod said;
pub mod scope;
mod sinks;
mod tap;
#[cfg(test)]
mod test_support;
pub mod turns;
pub mod words;
pub use logbook::{run_folder, run_number};
pub use options::{MonitorError, Options};
pub use run::run;
pub use tap::Tap;
