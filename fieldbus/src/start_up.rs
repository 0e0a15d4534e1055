//! Starting a segment up: from power-on to drives in OP that take outputs, each step named when it fails.
//!
//! `ethercrab` finds the slaves, reads their memory (SII), reads and writes objects, maps process data and sets distributed clocks. What
//! every cycle needs is then read back from the slaves: where ethercrab put the process data is what their FMMUs say.

mod clocks;
mod configure;
mod driver;
mod error;
mod found;
mod objects;
mod operational;
mod scan;
mod segment;
mod wiring;

pub use error::StartUpError;
pub use found::{FoundPdo, FoundSlave, FoundSync, ObjectData, ObjectValue, Written};
pub use scan::{read_object, scan, write_object};
pub use segment::start_up;

use bus::member::Pace;
use machine::Fieldbus;

use crate::drive_file::Identity;
use crate::drives::{DriveSetup, TerminalSetup};

/// What messages call the file of a device, where the machine file names it, and the command that makes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FileWords {
    /// The device.
    pub device: &'static str,
    /// Its table in the machine file.
    pub table: &'static str,
    /// The command.
    pub command: &'static str,
}

/// Of a drive.
const DRIVE_FILE: FileWords = FileWords {
    device: "drive",
    table: "[axis.drive]",
    command: "quadrant bus drive-file",
};

/// Of a terminal.
const TERMINAL_FILE: FileWords = FileWords {
    device: "terminal",
    table: "[[bus.terminal]]",
    command: "quadrant bus io-file",
};

/// What a segment is to be.
#[derive(Debug, Clone)]
pub struct SegmentPlan {
    /// The fieldbus.
    pub bus: Fieldbus,
    /// Drives in the order of the axes; the spindle's drive is the last one.
    pub drives: Vec<DriveSetup>,
    /// The terminals.
    pub terminals: Vec<TerminalSetup>,
    /// What each drive moves: `axis X`, `spindle`.
    pub moved: Vec<String>,
    /// Scan period, in µs.
    pub period_us: u32,
    /// In lockstep drives wait for the PC as long as it takes: their watchdogs are off.
    pub pace: Pace,
}

impl SegmentPlan {
    /// The axes of the drive at a place on the cable.
    pub fn drives_at(&self, slave: usize) -> impl Iterator<Item = &DriveSetup> {
        self.drives.iter().filter(move |drive| drive.slave == slave)
    }

    /// Each drive once: its first axis that the machine has.
    pub fn drives_once(&self) -> impl Iterator<Item = &DriveSetup> {
        let drives = self.drives.iter();
        drives.filter(|drive| {
            let mut there = self.drives_at(drive.slave);
            there
                .next()
                .is_some_and(|first| std::ptr::eq(first, *drive))
        })
    }

    /// Whether watchdogs are to be off.
    fn is_without_watchdog(&self) -> bool {
        self.pace == Pace::Lockstep
    }

    /// How many slaves there are to be.
    pub fn slave_count(&self) -> usize {
        self.drives_once().count() + self.terminals.len() + self.bus.other_slaves.len()
    }

    /// The terminal at a place on the cable.
    pub fn terminal_at(&self, slave: usize) -> Option<&TerminalSetup> {
        self.terminals
            .iter()
            .find(|terminal| terminal.slave == slave)
    }

    /// The slaves that have a file: their places, who they are, and what their file is called.
    pub fn described(&self) -> impl Iterator<Item = (usize, &Identity, FileWords)> {
        let drives = self.drives_once();
        let drives = drives.map(|of| (of.slave, &of.drive.identity, DRIVE_FILE));
        let terminals = self.terminals.iter();
        drives.chain(terminals.map(|of| (of.slave, &of.terminal.identity, TERMINAL_FILE)))
    }

    /// A slave as messages name it.
    pub fn name(&self, slave: usize) -> String {
        let drives = self.drives.iter().zip(&self.moved);
        let moved = drives.filter(|(drive, _)| drive.slave == slave);
        let moved: Vec<&str> = moved.map(|(_, moved)| moved.as_str()).collect();
        match self.terminal_at(slave) {
            _ if !moved.is_empty() => {
                format!("{} (place {slave} on the cable)", moved.join(" and "))
            }
            Some(_) => format!("terminal {slave} (place {slave} on the cable)"),
            None => format!("place {slave} on the cable"),
        }
    }
}
