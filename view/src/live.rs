//! A running cell, seen from outside: `quadrant status` and `quadrant monitor`.
//!
//! A reader descends so: [`feed`] takes samples from the cell into the [`model`], which knows no clock, port or screen;
//! `draw` puts a model on a screen, `json` and `text` into words; `terminal` and `lines` are the loops. Nothing here is
//! waited for by anybody in the cell: queues that are not emptied in time lose their oldest samples, here alone.

mod attach;
pub mod axis;
pub mod circle;
mod draw;
pub mod dro;
pub mod events;
pub mod feed;
mod fieldbus;
mod jog_mode;
pub(crate) mod json;
mod lines;
pub(crate) mod looks;
pub mod model;
mod override_steps;
mod palette;
#[cfg(any(feature = "remote", test))]
mod picture;
pub mod ports;
#[cfg(feature = "remote")]
mod remote_feed;
#[cfg(feature = "remote")]
pub mod remote_orders;
mod reversal;
#[cfg(feature = "remote")]
pub mod serve;
pub(crate) mod source;
pub(crate) mod state;
mod terminal;
#[cfg(test)]
pub(crate) mod test_support;
mod text;
pub mod timing;
mod track;
pub mod trail;
mod typed_line;
pub(crate) mod words;

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use crate::options::{MonitorOptions, StatusOptions};
use console::exit::Outcome;
use console::output::say;
use looks::{ONE_LOOK, SILENCE, heard};

/// Set in the environment of a live view in the terminal of a cell's launcher.
pub const OF_A_LAUNCHER: &str = "QUADRANT_VIEW_OF_LAUNCHER";

/// `quadrant status`.
pub fn status(options: &StatusOptions) -> Outcome {
    let mut feed = attach::of(&options.to)?;
    let started = Instant::now();
    loop {
        feed.look();
        let limit = if feed.model().shown.state.scan.is_some() {
            ONE_LOOK
        } else {
            SILENCE
        };
        if feed.is_whole() || started.elapsed() > limit || feed.has_ended() {
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    heard(feed.as_ref())?;
    if options.json {
        say(&json::status(feed.model()));
    } else {
        let model = feed.model();
        say(&text::status(&model.shown.state, &model.machine));
    }
    Ok(())
}

/// `quadrant monitor`.
pub fn monitor(options: &MonitorOptions) -> Outcome {
    let feed = attach::of(&options.to)?;
    match (options.once, options.json) {
        (true, json) => lines::once(feed, json),
        (false, false) if std::io::stdout().is_terminal() => terminal::run(feed),
        (false, _) => lines::run(feed),
    }
}
