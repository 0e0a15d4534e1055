//! How often a live view looks, and when a cell counts as silent.

use std::time::Duration;

use anyhow::anyhow;
use console::exit::{Failure, Outcome};

use super::source::Source;

/// Time between two looks of a live view.
pub const FRAME: Duration = Duration::from_millis(100);
/// Share of a look that is spent at the signal of the scan, for the timing.
pub const LISTEN: Duration = Duration::from_millis(20);
/// A cell that has reported nothing by then is silent.
pub const SILENCE: Duration = Duration::from_secs(2);
/// So long `status` waits for what is reported only now and then (commands, roster), once there is a feedback.
pub const ONE_LOOK: Duration = Duration::from_millis(1500);

/// A cell of which nothing was heard has nothing to show.
pub fn heard(feed: &dyn Source) -> Outcome {
    if feed.model().shown.state.scan.is_some() {
        return Ok(());
    }
    Err(Failure::Stopped(anyhow!(
        "cell {:?} is there, but its master says nothing: it is being started, or lost",
        feed.model().cell
    )))
}
