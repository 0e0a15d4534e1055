//! One sample of a run, whichever channel it came on.

use bus::sample::{
    AxisCommand, BusCycle, Feedback, Instruments, PlannerStatus, Roster, Setpoint, Signals,
    WindowHeader,
};
use xxhash_rust::xxh3::Xxh3;

use super::run_info::Event;

/// What the log says of one window: header, intended setpoints, and a checksum of the setpoints that brake to rest.
#[derive(Debug, Clone, PartialEq)]
pub struct LoggedWindow {
    /// Its header.
    pub header: WindowHeader,
    /// Its intended setpoints.
    pub setpoints: Vec<Setpoint>,
    /// XXH3 over the bytes of the other setpoints, all axes.
    pub tail_checksum: u64,
}

/// One sample of a run, from the wire or from the log.
#[derive(Debug, Clone, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "the planner's status comes once a period: what comes every scan is in boxes already"
)]
pub enum Sample {
    /// What the master published.
    Feedback(Box<Feedback>),
    /// What the bench's instruments saw.
    Instruments(Box<Instruments>),
    /// What the fieldbus did.
    BusCycle(Box<BusCycle>),
    /// What named inputs and outputs showed.
    Signals(Box<Signals>),
    /// What a servo asked for.
    Command(Box<AxisCommand>),
    /// What the planner published.
    Window(LoggedWindow),
    /// How the planner stood.
    Planner(PlannerStatus),
    /// Who took part.
    Roster(Box<Roster>),
    /// What happened to the process group.
    Event(Event),
}

/// XXH3 over the setpoints of a window that brake to rest.
fn tail_checksum(header: &WindowHeader, setpoints: &[Setpoint]) -> u64 {
    let tail = setpoints
        .get(header.intended_setpoints as usize..)
        .unwrap_or(&[]);
    let mut hash = Xxh3::new();
    hash.update(bytemuck::cast_slice(tail));
    hash.digest()
}

/// One sample that is looked at where it is.
#[derive(Debug, Clone, Copy)]
pub enum SampleRef<'a> {
    /// What the master published.
    Feedback(&'a Feedback),
    /// What the bench's instruments saw.
    Instruments(&'a Instruments),
    /// What the fieldbus did.
    BusCycle(&'a BusCycle),
    /// What named inputs and outputs showed.
    Signals(&'a Signals),
    /// What a servo of the axis with this index asked for.
    Command(usize, &'a AxisCommand),
    /// What the planner published: header, intended setpoints, and a checksum of those that brake to rest.
    Window(&'a WindowHeader, &'a [Setpoint], u64),
    /// State of the planner.
    Planner(&'a PlannerStatus),
    /// Who takes part.
    Roster(&'a Roster),
    /// What happened to the process group.
    Event(&'a Event),
}

impl<'a> SampleRef<'a> {
    /// A window; `setpoints` are all its setpoints.
    pub fn window(header: &'a WindowHeader, setpoints: &'a [Setpoint]) -> Self {
        let intended = setpoints
            .get(..header.intended_setpoints as usize)
            .unwrap_or(setpoints);
        SampleRef::Window(header, intended, tail_checksum(header, setpoints))
    }

    /// Its bytes; none of what does not come scan by scan.
    pub(crate) fn bytes(&self) -> Option<&'a [u8]> {
        Some(match self {
            SampleRef::Feedback(sample) => bytemuck::bytes_of(*sample),
            SampleRef::Instruments(sample) => bytemuck::bytes_of(*sample),
            SampleRef::BusCycle(sample) => bytemuck::bytes_of(*sample),
            SampleRef::Signals(sample) => bytemuck::bytes_of(*sample),
            SampleRef::Command(_, sample) => bytemuck::bytes_of(*sample),
            SampleRef::Planner(sample) => bytemuck::bytes_of(*sample),
            SampleRef::Roster(_) | SampleRef::Window(..) | SampleRef::Event(_) => return None,
        })
    }

    /// The checksum that it was sent with, which stands for all that it says; none of what is sent without, or seldom.
    pub(crate) fn seal(&self) -> Option<u64> {
        Some(match self {
            SampleRef::Feedback(sample) => sample.checksum,
            SampleRef::Command(_, sample) => sample.checksum,
            SampleRef::Planner(sample) => sample.checksum,
            SampleRef::Instruments(_)
            | SampleRef::Roster(_)
            | SampleRef::BusCycle(_)
            | SampleRef::Signals(_)
            | SampleRef::Window(..)
            | SampleRef::Event(_) => return None,
        })
    }

    /// Scan that it belongs to in the log.
    pub fn scan(&self) -> u64 {
        match self {
            SampleRef::Feedback(sample) => sample.scan,
            SampleRef::Instruments(sample) => sample.scan,
            SampleRef::BusCycle(sample) => sample.scan,
            SampleRef::Signals(sample) => sample.scan,
            SampleRef::Command(_, sample) => sample.scan,
            SampleRef::Window(header, ..) => header.visible_from,
            SampleRef::Planner(sample) => sample.scan,
            SampleRef::Roster(sample) => sample.visible_from,
            SampleRef::Event(event) => event.scan,
        }
    }
}

impl Sample {
    /// The sample where it is; `axis` is the index of a command's axis.
    pub fn as_ref(&self, axis: usize) -> SampleRef<'_> {
        match self {
            Sample::Feedback(sample) => SampleRef::Feedback(sample),
            Sample::Instruments(sample) => SampleRef::Instruments(sample),
            Sample::BusCycle(sample) => SampleRef::BusCycle(sample),
            Sample::Signals(sample) => SampleRef::Signals(sample),
            Sample::Command(sample) => SampleRef::Command(axis, sample),
            Sample::Window(window) => {
                SampleRef::Window(&window.header, &window.setpoints, window.tail_checksum)
            }
            Sample::Planner(sample) => SampleRef::Planner(sample),
            Sample::Roster(sample) => SampleRef::Roster(sample),
            Sample::Event(event) => SampleRef::Event(event),
        }
    }
}
