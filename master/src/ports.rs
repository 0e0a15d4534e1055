//! What a master sees of its cell.

use bus::sample::{
    BusCycle, Feedback, Instruments, OperatorRequest, OperatorResponse, Roster, Setpoint, Signals,
    WindowHeader,
};

use crate::answers::Answers;
use crate::drives::Drives;
use crate::saved::Latches;

/// What came of a scan's answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answered {
    /// [`answers`](MasterPorts::answers) has those that came in time.
    Scan {
        /// Scans that were overrun meanwhile.
        overrun_scans: u32,
    },
    /// The cell is to end at once.
    Leave,
}

/// Whether the cell goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flow {
    /// On to the next step.
    GoOn,
    /// It is time to leave.
    Leave,
}

/// What a master sees of its cell. Shared memory, queues and scripted decorators implement it.
pub trait MasterPorts {
    /// Why it cannot go on.
    type Error;

    /// Who takes part, as the launcher published it last.
    fn roster(&self) -> &Roster;

    /// Takes what the launcher has published since.
    fn read_roster(&mut self);

    /// Publishes the feedback of a scan and signals whoever is to answer it, the planner among them if `ask_planner`.
    fn begin_scan(&mut self, feedback: &Feedback, ask_planner: bool) -> Flow;

    /// Publishes what the bench instruments read.
    fn publish_instruments(&mut self, instruments: &Instruments);

    /// Publishes what the fieldbus did, where drives are on one.
    fn publish_bus_cycle(&mut self, _cycle: &BusCycle) {}

    /// Publishes what named inputs and outputs show.
    fn publish_signals(&mut self, _signals: &Signals) {}

    /// Keeps what must outlive the master.
    fn save(&mut self, latches: &Latches, drives: &impl Drives);

    /// Keeps what was latched since; the drives are as they were saved last.
    fn latch(&mut self, latches: &Latches);

    /// The exchange of this scan was so much too late for the drives' clock, in ns: the scans follow it, where they have a clock.
    fn follow_drives(&mut self, _late_ns: i64) {}

    /// Waits for the answers to a scan as the pace wants it.
    ///
    /// # Errors
    /// Somebody who takes part does not answer.
    fn await_answers(&mut self, scan: u64, ask_planner: bool) -> Result<Answered, Self::Error>;

    /// What was answered to the scan that was awaited last.
    fn answers(&self) -> &Answers;

    /// Hands the operator's orders of this scan to `judge`, one after the other. What was latched by an order outlives the master
    /// before the order is answered, so that the answer is true whoever is the master by the time it is read.
    fn serve_orders(
        &mut self,
        scan: u64,
        judge: impl FnMut(&OperatorRequest) -> (OperatorResponse, Latches),
    );

    /// Whether the launcher is still there; none if the cell is to end at once.
    fn launcher_lives(&mut self, scan: u64) -> Option<bool>;

    /// Hands every window that has become visible by `scan` to `offer`, in order.
    fn for_each_window(
        &mut self,
        scan: u64,
        offer: impl FnMut(&WindowHeader, &[Setpoint], &Roster),
    );

    /// The last feedback has been published: waits until it has been recorded.
    fn finish(&mut self, scan: u64);

    /// The master leaves: wakes whoever waits for it.
    fn leave(&mut self);
}
