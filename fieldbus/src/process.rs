//! The `fieldbus` process: it owns the network interface, starts the segment up and exchanges cycles as the master asks for them.
//!
//! It knows nothing of CiA 402 and keeps nothing that another one could not read in the drive page or from the cable: it may be killed.
//! A second one stands by where the machine file says so; it takes over without a word to the slaves, which notice nothing.

pub mod claim;
mod owner;
mod standby;

use std::time::Duration;

use bus::drive_page::DrivePage;
use bus::member::{Member, Slot};
use machine::Machine;

use crate::setups;
use crate::start_up::SegmentPlan;

use owner::Owner;
use standby::{Standby, Turn};

/// How a `fieldbus` process is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its slot in the cell.
    pub slot: Slot,
    /// In lockstep: how long an answer of the drives may take.
    pub answer_limit: Duration,
}

/// Takes part until the cell ends or the master has left.
///
/// # Errors
/// The machine file or a drive file cannot be used, the interface cannot, or the segment does not start up.
pub fn run(options: &Options) -> anyhow::Result<()> {
    let machine = Machine::load(&options.slot.machine)?;
    let setups = setups::load(&machine, &options.slot.machine)?;
    let (Some(setups), Some(bus)) = (setups, &machine.bus) else {
        anyhow::bail!("the machine file has no [bus]: its drives are simulated");
    };
    let axes = machine.axes.iter();
    let axes = axes.map(|axis| format!("axis {}", axis.name));
    let spindle = setups.spindle.iter().map(|_| "spindle".to_string());
    let plan = SegmentPlan {
        bus: bus.clone(),
        moved: axes.chain(spindle).collect(),
        drives: setups.drives.into_iter().chain(setups.spindle).collect(),
        terminals: setups.terminals,
        period_us: machine.scan.period_us,
        pace: options.slot.pace,
    };
    let member = Member::enter(options.slot.clone(), "fieldbus", &machine.shape())?;
    let page = DrivePage::open(&bus::cell::CellPaths::new(&options.slot.cell)?)?;
    let process = Process {
        member,
        page,
        plan,
        period_ns: u64::from(machine.scan.period_us) * 1000,
        watchdog_scans: machine.scan.watchdog_scans,
        hang_scans: machine.bus_hang_scans(),
        answer_limit: options.answer_limit,
    };
    let owner = match process.page.own(Duration::ZERO)? {
        Some(bus) => Owner::start(&process, bus)?,
        None => match Standby::new(&process).wait()? {
            Turn::Leave => return Ok(()),
            Turn::TakeOver(bus, cycle) => Owner::take_over(&process, bus, *cycle),
            Turn::Start(bus) => Owner::start(&process, bus)?,
        },
    };
    owner.run()
}

/// What owner and standby share.
#[derive(Debug)]
struct Process {
    member: Member,
    page: DrivePage,
    plan: SegmentPlan,
    period_ns: u64,
    watchdog_scans: u32,
    /// Scans without an answer after which an owner hangs.
    hang_scans: u32,
    answer_limit: Duration,
}

impl Process {
    /// Whether it is time to leave; a system call.
    fn leaves(&self) -> bool {
        self.page.has_left() || self.member.ending() || !self.member.launcher_lives()
    }
}
