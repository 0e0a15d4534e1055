//! What lies between the processes: queues with the scan's rules, as bus/src/port.rs has them over shared memory.

use std::collections::VecDeque;
use std::sync::Arc;

use bus::port::Visibility;
use bus::sample::{AxisCommand, Setpoint, WindowHeader};
use bus::service::SCAN_DEPTH;

/// As over shared memory: nobody lags by more than a queue.
const HORIZON_SCANS: u64 = SCAN_DEPTH as u64 + 1;

/// A window that was sent.
#[derive(Debug)]
pub struct Window {
    /// Its header.
    pub header: WindowHeader,
    /// Its setpoints.
    pub setpoints: Vec<Setpoint>,
}

/// What can wait in a queue.
pub(crate) trait Sent {
    /// The first scan in which a reader may act on it.
    fn visible_from(&self) -> u64;
}

impl Sent for AxisCommand {
    fn visible_from(&self) -> u64 {
        self.visible_from
    }
}

impl Sent for Arc<Window> {
    fn visible_from(&self) -> u64 {
        self.header.visible_from
    }
}

/// A reader's queue: what is visible only later is set aside, what is too much drops the oldest.
#[derive(Debug)]
pub(crate) struct Queue<T> {
    waiting: VecDeque<T>,
    set_aside: Option<T>,
}

impl<T: Sent> Queue<T> {
    pub fn new() -> Queue<T> {
        Queue {
            waiting: VecDeque::with_capacity(SCAN_DEPTH + 1),
            set_aside: None,
        }
    }

    pub fn push(&mut self, sample: T) {
        if self.waiting.len() >= SCAN_DEPTH {
            self.waiting.pop_front();
        }
        self.waiting.push_back(sample);
    }

    /// The next one in order that may be acted on in `scan`.
    pub fn next(&mut self, scan: u64) -> Option<T> {
        loop {
            let sample = self.set_aside.take().or_else(|| self.waiting.pop_front())?;
            match Visibility::of(sample.visible_from(), scan, HORIZON_SCANS) {
                Visibility::Now => return Some(sample),
                Visibility::Later => {
                    self.set_aside = Some(sample);
                    return None;
                }
                Visibility::Never => {}
            }
        }
    }

    /// The newest one that may be acted on in `scan`; older ones are dropped.
    pub fn newest(&mut self, scan: u64) -> Option<T> {
        let mut newest = None;
        while let Some(sample) = self.next(scan) {
            newest = Some(sample);
        }
        newest
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn command(scan: u64) -> AxisCommand {
        AxisCommand {
            scan,
            visible_from: scan + 1,
            ..AxisCommand::zeroed()
        }
    }

    #[test]
    fn nothing_is_seen_in_the_scan_it_is_made_in() {
        let mut queue = Queue::new();
        queue.push(command(4));
        queue.push(command(5));
        assert_eq!(queue.newest(5).map(|c| c.scan), Some(4));
        assert_eq!(queue.newest(5).map(|c| c.scan), None);
        assert_eq!(queue.newest(6).map(|c| c.scan), Some(5));
    }

    #[test]
    fn a_full_queue_loses_the_oldest() {
        let mut queue = Queue::new();
        for scan in 0..20 {
            queue.push(command(scan));
        }
        let first = queue.next(100).expect("a command");
        assert_eq!(first.scan, 20 - SCAN_DEPTH as u64);
    }
}
