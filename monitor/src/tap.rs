//! A listener beside the log: what the recorder takes, it hands on.

use bus::member::Member;
use bus::sample::{AxisCommand, BusCycle, Feedback, Instruments, PlannerStatus, Roster};
use bus::signal_page::SignalPage;
use machine::Machine;

/// Is reported of every sample that the recorder takes, in the order of the log, and must not wait for anybody: the recorder
/// waits for it.
pub trait Tap {
    /// The recorder is in the cell; scans may begin.
    fn begins(&mut self, member: &Member, machine: &Machine);
    /// A roster.
    fn roster(&mut self, sample: &Roster);
    /// What the instruments saw.
    fn instruments(&mut self, sample: &Instruments);
    /// What the fieldbus did.
    fn bus_cycle(&mut self, sample: &BusCycle);
    /// A command of any servo.
    fn command(&mut self, sample: &AxisCommand);
    /// What the planner says.
    fn planner(&mut self, sample: &PlannerStatus);
    /// A feedback; whatever became visible by its scan came before it.
    fn feedback(&mut self, sample: &Feedback);
    /// The queues are empty; `failed` receptions were refused so far.
    fn look(&mut self, page: &SignalPage, failed: u64);
}
