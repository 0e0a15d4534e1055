//! A running cell, seen from outside: `quadrant status` and `quadrant monitor`.
//!
//! A reader descends so: [`feed`] takes samples from the cell into the [`model`], which knows no clock, port or screen;
//! [`draw`] puts a model on a screen, [`json`] and [`text`] into words; [`terminal`] and [`lines`] are the loops. Nothing here is
//! waited for by anybody in the cell: queues that are not emptied in time lose their oldest samples, here alone.

pub mod axis;
mod circle;
mod draw;
pub mod events;
pub mod feed;
mod json;
mod lines;
pub mod model;
mod palette;
#[cfg(any(feature = "remote", test))]
mod picture;
pub mod ports;
pub mod proc;
#[cfg(feature = "remote")]
mod remote_feed;
mod reversal;
#[cfg(feature = "remote")]
pub mod serve;
mod source;
mod terminal;
#[cfg(test)]
mod test_support;
mod text;
pub mod timing;
mod track;
mod words;

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use anyhow::anyhow;

use crate::cli::{MonitorOptions, StatusOptions};
use crate::exit::{Failure, Outcome};
use crate::output::say;
use source::Source;

/// Time between two looks of a live view.
const FRAME: Duration = Duration::from_millis(100);
/// Share of a look that is spent at the bell of the scan, for the timing.
const LISTEN: Duration = Duration::from_millis(20);
/// A cell that has said nothing by then is silent.
const SILENCE: Duration = Duration::from_secs(2);
/// So long `status` waits for what is said only now and then (commands, roster), once there is a feedback.
const ONE_LOOK: Duration = Duration::from_millis(1500);

/// `quadrant status`.
pub fn status(options: &StatusOptions) -> Outcome {
    let mut feed = source::of(&options.to)?;
    let started = Instant::now();
    loop {
        feed.look();
        let limit = if feed.model().feedback.is_some() {
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
        say(&text::status(feed.model()));
    }
    Ok(())
}

/// `quadrant monitor`.
pub fn monitor(options: &MonitorOptions) -> Outcome {
    let feed = source::of(&options.to)?;
    match (options.once, options.json) {
        (true, json) => lines::once(feed, json),
        (false, false) if std::io::stdout().is_terminal() => terminal::run(feed),
        (false, _) => lines::run(feed),
    }
}

/// A cell of which nothing was heard has nothing to show.
fn heard(feed: &dyn Source) -> Outcome {
    if feed.model().feedback.is_some() {
        return Ok(());
    }
    Err(Failure::Stopped(anyhow!(
        "cell {:?} is there, but its machine side says nothing: it is being started, or lost",
        feed.model().cell
    )))
}
