//! What a servo sees of its cell, and the same over the bus.

use std::ops::Deref;
use std::rc::Rc;

use bus::cell::CellError;
use bus::member::Member;
use bus::port::{Held, Reader, WindowReader, Writer};
use bus::sample::{AxisCommand, Feedback, Setpoint, WindowHeader};
use bus::service::{ROLES, SCAN_DEPTH};

/// A servo lags by its queue of feedbacks at most; what others make from the newest one is visible a scan later.
const HORIZON_SCANS: u64 = SCAN_DEPTH as u64 + 1;

/// What a servo sees of its cell. Shared memory, queues and faulty decorators implement it.
pub trait ServoPorts {
    /// A feedback where it lies.
    type Feedback: Deref<Target = Feedback>;

    /// Waits for the newest feedback after the one before; none when it is time to leave.
    fn next_feedback(&mut self) -> Option<Self::Feedback>;

    /// Hands every window that has become visible by `scan` to `offer`, in order.
    fn for_each_window(&mut self, scan: u64, offer: impl FnMut(&WindowHeader, &[Setpoint]));

    /// The newest command of the axis's other servo that is visible in `scan`.
    fn peer_command(&mut self, scan: u64) -> Option<AxisCommand>;

    /// Publishes the command of a scan.
    fn publish(&mut self, command: &AxisCommand);

    /// Reports that this servo is done with the scan.
    fn answered(&mut self, scan: u64);
}

/// The ports of a servo process: shared memory.
#[derive(Debug)]
pub struct BusPorts {
    member: Rc<Member>,
    feedback: Reader<Feedback>,
    windows: WindowReader,
    peer: Option<Reader<AxisCommand>>,
    command: Writer<AxisCommand>,
    last: Option<u64>,
}

impl BusPorts {
    /// Opens the ports of the servo of `axis` in `role`; `standby` where the axis has two.
    ///
    /// # Errors
    /// [`CellError::Transport`], also if the role has a servo already.
    pub fn open(
        member: Rc<Member>,
        axis: usize,
        role: usize,
        standby: bool,
    ) -> Result<BusPorts, CellError> {
        let bus = &member.bus;
        let peer = ROLES.len().saturating_sub(1 + role);
        let peer = standby.then(|| {
            let reader = bus.command_reader(axis, peer, SCAN_DEPTH)?;
            Ok(reader.with_horizon(HORIZON_SCANS))
        });
        Ok(BusPorts {
            feedback: bus.feedback_reader(SCAN_DEPTH)?,
            windows: bus.window_reader(SCAN_DEPTH)?.with_horizon(HORIZON_SCANS),
            command: bus.command_writer(axis, role)?,
            peer: peer.transpose()?,
            last: member.slot.after_scan,
            member,
        })
    }
}

impl ServoPorts for BusPorts {
    type Feedback = Held<Feedback>;

    fn next_feedback(&mut self) -> Option<Held<Feedback>> {
        let signal = self.member.page.scan_signal();
        let feedback = self
            .member
            .next_feedback(signal, &mut self.feedback, self.last)?;
        self.last = Some(feedback.scan);
        Some(feedback)
    }

    fn for_each_window(&mut self, scan: u64, offer: impl FnMut(&WindowHeader, &[Setpoint])) {
        self.windows.each(scan, offer);
    }

    fn peer_command(&mut self, scan: u64) -> Option<AxisCommand> {
        self.peer.as_mut()?.newest(scan)
    }

    fn publish(&mut self, command: &AxisCommand) {
        self.command.send(command);
    }

    fn answered(&mut self, scan: u64) {
        self.member.answered(scan);
    }
}
