//! Settings files (`machine.toml`, `plant.toml`, `learned.toml`): read as a whole, checked as a whole, refused with file, line, axis,
//! key, value, unit and rule of everything that is wrong.
//!
//! A key is declared in one place: a field of a struct that derives `Deserialize` and `JsonSchema`.
//!
//! ```
//! use machine::settings_file::{self, Schema};
//!
//! #[derive(serde::Deserialize, schemars::JsonSchema)]
//! struct Spindle {
//!     /// Highest speed.
//!     #[schemars(extend("unit" = "1/min", "exclusiveMinimum" = 0, "maximum" = 60_000, "default" = 6000))]
//!     speed_per_min: f64,
//! }
//!
//! let spindle: Spindle = settings_file::load("spindle.toml", "", &[], |_, _| ()).unwrap();
//! assert_eq!(spindle.speed_per_min, 6000.0);
//!
//! let error = settings_file::load::<Spindle>("spindle.toml", "speed_per_min = -1", &[], |_, _| ()).err().unwrap();
//! let text = "spindle.toml:1: speed_per_min = -1 1/min: must be above 0 and at most 60000 1/min";
//! assert_eq!(error.to_string(), text);
//! ```
//!
//! The doc comment is the meaning, `unit` the unit, `minimum` or `exclusiveMinimum` and `maximum` the range, `default` the value where
//! the file has none; a key without a default must be there, and so must a table that holds one, unless it is an `Option`. These words
//! are those of JSON Schema, but for `unit`. From the [`Schema`] come the [check](load()), the defaults, the text of an error, the page in
//! the reference and the JSON Schema for editors. Rules that relate several keys are code: [`Rules`].

mod check;
mod document;
mod error;
mod load;
mod own_units;
mod problems;
mod range;
mod rules;
mod schema;
mod slides;
mod tables;
mod text;

pub use check::Renamed;
pub use error::SettingsFileError;
pub use load::{load, load_with, parse};
pub use own_units::{N_PER_NM, OwnUnit};
pub use range::From;
pub use rules::{At, Rules};
pub use schema::{KeySchema, Kind, Schema, Word};
pub use tables::{each_entry, number_of};
pub(crate) use text::read_text_within;
pub use text::{SETTINGS_FILE_BYTES_MAX, read_text};
