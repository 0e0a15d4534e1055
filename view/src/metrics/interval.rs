//! How evenly scans follow each other: a thread listens at the scan's signal now and then, as `quadrant monitor` does.

use std::sync::Arc;
use std::time::Duration;

use bus::cell::CellPaths;
use bus::signal_page::SignalPage;

use super::numbers::Numbers;
use crate::live::timing::listen;

/// Listens so long …
const LISTEN: Duration = Duration::from_millis(20);
/// … and rests so long: a fifth of the scans is seen, and the thread costs a fifth of what it would.
const REST: Duration = Duration::from_millis(80);
const STACK_BYTES: usize = 256 << 10;

/// Listens in a thread of its own, as long as the process lives. Without it there are no intervals, and nothing else is missing.
pub fn start(place: &CellPaths, numbers: Arc<Numbers>) {
    let Ok(page) = SignalPage::open(place) else {
        return;
    };
    let thread = std::thread::Builder::new()
        .name("qd-intervals".into())
        .stack_size(STACK_BYTES);
    let _ = thread.spawn(move || {
        loop {
            if let Some(interval) = &numbers.scan_interval {
                listen(page.scan_signal(), LISTEN, |period_ns| {
                    interval.take(period_ns as f64 * 1e-9);
                });
            }
            std::thread::sleep(REST);
        }
    });
}
