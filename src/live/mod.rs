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
pub mod proc;
mod reversal;
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
use feed::Feed;

/// Time between two looks of a live view.
const FRAME: Duration = Duration::from_millis(100);
/// Share of a look that is spent at the bell of the scan, for the timing.
const LISTEN: Duration = Duration::from_millis(20);
/// A cell that has said nothing by then is silent.
const SILENCE: Duration = Duration::from_secs(2);
/// So long `status` waits for what is said only now and then (commands, roster), once there is a feedback.
const ONE_LOOK: Duration = Duration::from_millis(500);

/// `quadrant status`.
pub fn status(options: &StatusOptions) -> Outcome {
    let mut feed = Feed::attach(options.to.cell.as_deref())?;
    let started = Instant::now();
    loop {
        feed.look();
        let limit = if feed.model.feedback.is_some() {
            ONE_LOOK
        } else {
            SILENCE
        };
        if feed.model.is_whole() || started.elapsed() > limit || feed.has_ended() {
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    heard(&feed)?;
    if options.json {
        say(&json::status(&feed.model));
    } else {
        say(&text::status(&feed.model));
    }
    Ok(())
}

/// `quadrant monitor`.
pub fn monitor(options: &MonitorOptions) -> Outcome {
    let cell = options.to.cell.as_deref();
    match (options.once, options.json) {
        (true, json) => lines::once(Feed::attach(cell)?, json),
        (false, false) if std::io::stdout().is_terminal() => terminal::run(Feed::attach(cell)?),
        (false, _) => lines::run(Feed::attach(cell)?),
    }
}

/// A cell of which nothing was heard has nothing to show.
fn heard(feed: &Feed) -> Outcome {
    if feed.model.feedback.is_some() {
        return Ok(());
    }
    Err(Failure::Stopped(anyhow!(
        "cell {:?} is there, but its machine side says nothing: it is being started, or lost",
        feed.model.cell
    )))
}
