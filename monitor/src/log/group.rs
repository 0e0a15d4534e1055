//! The samples of a stretch of scans in the order in which they became visible: in a log each channel has its own in one message.

use std::collections::VecDeque;

use super::codec::Content;
use super::columns::{Columns, ROWS_MAX};
use super::sample::LoggedWindow;

/// Messages that wait for feedbacks: a log has far fewer before they come. In a damaged one they may never come.
const WAITING_MAX: usize = 128;

/// Rows of one channel.
struct Rows {
    content: Content,
    /// Where its samples stand among those that become visible with them.
    rank: (u8, usize),
    bytes: Vec<u8>,
    row_bytes: usize,
    /// Where in a row the scan is in which it becomes visible.
    visible_from: usize,
    /// Where the next one begins.
    at: usize,
}

impl Rows {
    fn next(&self) -> Option<&[u8]> {
        self.bytes.get(self.at..self.at + self.row_bytes)
    }

    /// Scan in which the next one becomes visible.
    fn next_visible(&self) -> Option<u64> {
        let scan = self.next()?.get(self.visible_from..)?.first_chunk()?;
        Some(u64::from_le_bytes(*scan))
    }
}

/// What is next.
pub(super) enum Next<'a> {
    /// A sample that comes scan by scan.
    Row(Content, &'a [u8]),
    /// A window.
    Window(LoggedWindow),
}

/// What has been read and not been handed on. A stretch is whole once its feedbacks are there.
#[derive(Default)]
pub(super) struct Group {
    channels: Vec<Rows>,
    windows: VecDeque<LoggedWindow>,
    feedbacks: Option<Rows>,
    ended: bool,
}

impl Group {
    /// Takes the rows of a channel; `place` is that among the channels of the same content.
    pub(super) fn take(
        &mut self,
        (content, place): (Content, usize),
        columns: &Columns,
        bytes: Vec<u8>,
    ) {
        let order = match content {
            Content::BusCycle | Content::Signals => 0,
            Content::Instruments => 1,
            Content::Command => 2,
            _ => 3,
        };
        let rows = Rows {
            content,
            rank: (order, place),
            bytes,
            row_bytes: columns.row.bytes,
            // A feedback begins its scan, which is its first number.
            visible_from: match content {
                Content::Feedback => 0,
                _ => columns.visible_from,
            },
            at: 0,
        };
        if content == Content::Feedback {
            self.feedbacks = Some(rows);
        } else {
            let behind = self
                .channels
                .partition_point(|other| other.rank <= rows.rank);
            self.channels.insert(behind, rows);
        }
    }

    /// Takes a window.
    pub(super) fn window(&mut self, window: LoggedWindow) {
        self.windows.push_back(window);
    }

    /// Nothing comes behind what was taken.
    pub(super) fn end(&mut self) {
        self.ended = true;
    }

    /// What comes next: before a feedback stands all that is visible in its scan. None before the next feedbacks are there.
    pub(super) fn next(&mut self) -> Option<Next<'_>> {
        let feedback = self.feedbacks.as_ref().and_then(Rows::next_visible);
        if feedback.is_none() {
            self.channels.retain(|rows| rows.next().is_some());
            let waits = self.channels.len().max(self.windows.len() / ROWS_MAX);
            if !self.ended && waits <= WAITING_MAX {
                return None;
            }
        }
        let is_visible = |from: u64| feedback.is_none_or(|scan| from <= scan);
        let before = self
            .channels
            .iter_mut()
            .find(|rows| rows.next_visible().is_some_and(is_visible));
        if before.is_none() {
            let window = self.windows.front();
            if window.is_some_and(|window| is_visible(window.header.visible_from)) {
                return self.windows.pop_front().map(Next::Window);
            }
        }
        let rows = before.or(self.feedbacks.as_mut())?;
        rows.at += rows.row_bytes;
        let row = rows.bytes.get(rows.at - rows.row_bytes..rows.at)?;
        Some(Next::Row(rows.content, row))
    }
}

#[cfg(test)]
mod tests {
    use bus::sample::PlannerStatus;
    use machine::LogLevel;

    use super::super::codec::Codec;
    use super::super::layout::Extent;
    use super::*;

    #[test]
    fn a_log_without_feedbacks_is_handed_on_before_it_fills_the_memory() {
        let extent = Extent {
            axes: vec!["X".into()],
            subsamples: 1,
            signals: Vec::new(),
        };
        let codec = Codec::of_level(&extent, LogLevel::Control);
        let columns = Columns::of(codec.planner.clone());
        let mut row = Vec::new();
        let status = PlannerStatus::default();
        columns.row.encode(bytemuck::bytes_of(&status), &mut row);
        let mut group = Group::default();
        let mut handed_on = 0;
        for _ in 0..10 * WAITING_MAX {
            group.take((Content::Planner, 0), &columns, row.clone());
            while group.next().is_some() {
                handed_on += 1;
            }
            assert!(group.channels.len() <= WAITING_MAX + 1);
        }
        group.end();
        while group.next().is_some() {
            handed_on += 1;
        }
        assert_eq!(handed_on, 10 * WAITING_MAX);
    }
}
