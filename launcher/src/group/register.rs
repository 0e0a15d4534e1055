//! The roster of a cell, as the launcher keeps it and hands it to everybody.

use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use bus::port::Writer;
use bus::sample::{Participant, Roster};
use bus::signal_page::SignalPage;
use bytemuck::Zeroable;

/// Time between two rosters that say the same.
const REPEAT: Duration = Duration::from_secs(1);

/// The roster and its only writer.
#[derive(Debug)]
pub(super) struct Register {
    roster: Roster,
    writer: Writer<Roster>,
    told: Instant,
    newest_scan: u64,
}

impl Register {
    pub fn new(writer: Writer<Roster>) -> Register {
        Register {
            roster: Roster::zeroed(),
            writer,
            told: Instant::now(),
            newest_scan: 0,
        }
    }

    /// The newest scan that the launcher has seen: what it notices happened about then.
    pub fn newest_scan(&self) -> u64 {
        self.newest_scan
    }

    pub fn see(&mut self, scan: u64) {
        self.newest_scan = scan;
    }

    /// The first process of a place.
    pub fn enter(&mut self, place: usize, first: Participant) {
        if let Some(participant) = self.roster.participants.get_mut(place) {
            *participant = first;
        }
    }

    /// Another process has a place, and takes part.
    pub fn admit(&mut self, place: usize, incarnation: u32) {
        if let Some(participant) = self.roster.participants.get_mut(place) {
            participant.incarnation = incarnation;
            participant.live = 1;
            participant.stalled = 0;
        }
    }

    /// The process of a place has ended, in the newest scan.
    pub fn note_death(&mut self, place: usize, status: ExitStatus) {
        if let Some(participant) = self.roster.participants.get_mut(place) {
            participant.live = 0;
            participant.stalled = 0;
            participant.death_scan = self.newest_scan;
            participant.death_signal = status.signal().unwrap_or(0);
            participant.death_status = status.code().unwrap_or(0);
        }
    }

    /// The cell is not to wait for the process of a place, or is to again.
    pub fn note_stalled(&mut self, place: usize, stalled: bool) {
        if let Some(participant) = self.roster.participants.get_mut(place) {
            participant.stalled = u32::from(stalled);
        }
    }

    /// Tells everybody what has changed.
    pub fn publish(&mut self, page: &SignalPage) {
        self.roster.version += 1;
        self.roster.visible_from = self.newest_scan;
        self.tell(page);
    }

    /// Tells it again now and then, for a process that has dropped it because it was not what was sent.
    pub fn repeat(&mut self, page: &SignalPage) {
        if self.told.elapsed() > REPEAT {
            self.tell(page);
        }
    }

    /// Hands it to observers that have come meanwhile.
    pub fn connect_readers(&self) {
        self.writer.connect_readers();
    }

    fn tell(&mut self, page: &SignalPage) {
        self.told = Instant::now();
        self.writer.send(&self.roster);
        page.raise_all();
    }
}
