//! M-codes that the machine itself does ([`machine::MachineCodes`]): signals show what is to be done until a switch says that it is.

use bus::sample::ProgramEvent;
use machine::Machine;

/// Numbers of calls of one run are apart by less than this.
const CALLS_OF_A_RUN: f64 = 2_097_152.0;

/// Which of them is to be done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Call {
    /// 100 to 199.
    pub code: u32,
    /// P of its block; -1 without it.
    pub p: f64,
    event: u32,
}

impl Call {
    /// Number of the call: unique in the cell, and the same after the death of a process.
    pub fn number(&self, run: u32) -> f64 {
        f64::from(run) * CALLS_OF_A_RUN + f64::from(self.event)
    }
}

/// Codes, and the one that is shown.
#[derive(Debug, Clone, Default)]
pub(super) struct MachineCodes {
    numbers: Vec<u32>,
    patience_scans: u64,
    /// The machine says that what is shown is done.
    done: bool,
    shown: Option<Call>,
}

impl MachineCodes {
    pub fn new(machine: &Machine) -> MachineCodes {
        let codes = machine.functions.m_codes.as_ref();
        let patience_s = codes.map_or(0.0, |codes| codes.patience_s);
        MachineCodes {
            numbers: machine.functions.machine_codes().to_vec(),
            patience_scans: libm::ceil(patience_s / machine.scan_period_s()) as u64,
            ..MachineCodes::default()
        }
    }

    pub fn take(&mut self, done: bool) {
        self.done = done;
    }

    /// The one that is to be done now.
    pub fn shown(&self) -> Option<Call> {
        self.shown
    }

    pub fn patience_scans(&self) -> u64 {
        self.patience_scans
    }

    /// Whether the event waits for the machine. A code is shown only after what was done before it is said no more.
    pub fn awaits(&mut self, event: &ProgramEvent) -> bool {
        if !self.numbers.contains(&event.index) {
            return false;
        }
        match (self.shown, self.done) {
            (Some(_), done) => !done,
            (None, true) => true,
            (None, false) => {
                self.shown = Some(Call {
                    code: event.index,
                    p: event.value,
                    event: event.number,
                });
                true
            }
        }
    }

    /// It is done, or will be asked for again.
    pub fn forget(&mut self) {
        self.shown = None;
    }
}
