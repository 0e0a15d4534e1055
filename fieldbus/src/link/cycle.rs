//! One cycle over the wire: sent once, answered once or not at all.

use std::rc::Rc;

use bus::drive_page::{Counts, Inputs, Wiring};
use bus::realtime::now_ns;
use bytemuck::Zeroable;

use super::frame::{CycleFrame, Received, Tag};
use super::socket::{FRAME_BYTES_MAX, Origin, Socket};

/// The longest wait for a frame without a look whether it is still worth it.
const WAIT_STEP_NS: u64 = 20_000_000;

/// Of frames in a row that are not answered, each of so many looks at the link.
const LINK_EVERY: u32 = 4;

/// The cycle of a segment.
#[derive(Debug)]
pub struct Cycle {
    /// The socket.
    pub socket: Rc<Socket>,
    frame: CycleFrame,
    buffer: [u8; FRAME_BYTES_MAX],
    /// What came back last.
    pub inputs: Inputs,
    expected: u32,
    period_ns: u64,
    sent_at_ns: u64,
    missed_in_a_row: u32,
    followed: Followed,
}

/// The newest frames that were seen of another sender.
#[derive(Debug, Clone, Copy, Default)]
struct Followed {
    sent: Option<Tag>,
    answered: Option<Tag>,
}

impl Cycle {
    /// For a segment that is wired so, whose SYNC0 has this period; what was counted goes on.
    pub fn new(socket: Rc<Socket>, wiring: &Wiring, period_ns: u64, counts: Counts) -> Cycle {
        let mut inputs = Inputs::zeroed();
        inputs.counts = counts;
        Cycle {
            socket,
            frame: CycleFrame::new(wiring),
            buffer: [0; FRAME_BYTES_MAX],
            inputs,
            expected: wiring.working_counter,
            period_ns,
            sent_at_ns: 0,
            missed_in_a_row: 0,
            followed: Followed::default(),
        }
    }

    /// What was counted.
    pub fn counts(&mut self) -> &mut Counts {
        &mut self.inputs.counts
    }

    /// Sends a frame; one that the interface refuses is one that is missed.
    pub fn send(&mut self, tag: Tag, image: &[u8]) {
        self.sent_at_ns = now_ns();
        self.inputs.sent_at_ns = self.sent_at_ns;
        let frame = self.frame.fill(tag, image);
        let _ = self.socket.send(frame);
        self.inputs.counts.sent += 1;
    }

    /// Awaits the answer to a frame that was sent, until this time of the monotonic clock or as long as `patient` says, which is asked
    /// now and then; what came.
    pub fn receive(
        &mut self,
        number: u64,
        until_ns: u64,
        mut patient: impl FnMut() -> bool,
    ) -> &Inputs {
        self.inputs.answered = 0;
        let mut now = now_ns();
        let mut look_ns = now + WAIT_STEP_NS;
        while !self.take_all(number) {
            if now >= until_ns || now >= look_ns && !patient() {
                self.inputs.counts.missed += 1;
                // The link is looked at now and then: the kernel may take its time for an interface that is gone.
                if self.missed_in_a_row.is_multiple_of(LINK_EVERY) {
                    self.inputs.no_link = u64::from(!self.socket.has_link());
                }
                self.missed_in_a_row = self.missed_in_a_row.wrapping_add(1);
                break;
            }
            if now >= look_ns {
                look_ns = now + WAIT_STEP_NS;
            }
            self.socket.wait(until_ns.min(look_ns).saturating_sub(now));
            now = now_ns();
        }
        &self.inputs
    }

    /// SYNC0 is at whole scans of the reference clock; a frame is to pass it as far from them as can be.
    fn late_ns(&self, clock_ns: u64) -> i64 {
        let phase_ns = clock_ns.checked_rem(self.period_ns).unwrap_or(0);
        phase_ns as i64 - (self.period_ns / 2) as i64
    }

    /// Takes whatever has come; whether the answer is among it.
    fn take_all(&mut self, number: u64) -> bool {
        while let Some((length, origin)) = self.socket.receive(&mut self.buffer) {
            if origin == Origin::Here {
                continue;
            }
            let frame = self.buffer.get(..length).unwrap_or(&self.buffer);
            match self.frame.take(frame, number, &mut self.inputs) {
                Received::Answer { clock_ns } => {
                    self.missed_in_a_row = 0;
                    self.inputs.no_link = 0;
                    self.inputs.round_trip_ns = now_ns().saturating_sub(self.sent_at_ns);
                    self.inputs.clock_late_ns = clock_ns.map_or(0, |clock| self.late_ns(clock));
                    if clock_ns.is_some() {
                        self.inputs.counts.clock(self.inputs.clock_late_ns);
                    }
                    let short = self.inputs.working_counter != self.expected;
                    self.inputs.counts.short += u64::from(short);
                    return true;
                }
                Received::Late => self.inputs.counts.late += 1,
                Received::Foreign => self.inputs.counts.foreign += 1,
            }
        }
        false
    }

    /// For a standby: takes what the owner of the bus has sent and got meanwhile, so that it knows, when the owner dies, how far its
    /// last frame came. The socket sees this PC's own frames.
    pub fn follow(&mut self) {
        while let Some((length, origin)) = self.socket.receive(&mut self.buffer) {
            let frame = self.buffer.get(..length).unwrap_or(&self.buffer);
            let Some(tag) = self.frame.tag_of(frame) else {
                continue;
            };
            let newer = |seen: Option<Tag>| seen.is_none_or(|seen| seen.frame < tag.frame);
            match origin {
                Origin::Here if newer(self.followed.sent) => self.followed.sent = Some(tag),
                Origin::Cable if newer(self.followed.answered) => {
                    let taken = self.frame.take(frame, tag.frame, &mut self.inputs);
                    if matches!(taken, Received::Answer { .. }) {
                        self.followed.answered = Some(tag);
                    }
                }
                Origin::Here | Origin::Cable => {}
            }
        }
    }

    /// How far a cycle of the master came whose sender died.
    pub fn found(&self, cycle: u64) -> Found {
        let of_it = |tag: &Tag| tag.cycle == cycle;
        if self.followed.answered.filter(of_it).is_some() {
            return Found::Answered;
        }
        let sent = self.followed.sent.filter(of_it);
        sent.map_or(Found::NotSent, |tag| Found::Sent { frame: tag.frame })
    }

    /// Number of the newest frame that was seen of another sender.
    pub fn newest_followed(&self) -> u64 {
        self.followed.sent.map_or(0, |tag| tag.frame)
    }
}

/// How far a cycle came whose sender died.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    /// It was never sent.
    NotSent,
    /// It is on its way.
    Sent {
        /// Number of its frame.
        frame: u64,
    },
    /// It is back.
    Answered,
}
