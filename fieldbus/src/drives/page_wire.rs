//! The wire of a master: the drive page, at whose other end the fieldbus process is.

use std::time::{Duration, Instant};

use bus::drive_page::{BusState, DrivePage, Inputs, Outputs, Wiring};
use bus::member::Pace;
use bus::realtime::now_ns;

use super::cia402_drives::{Wire, WireAnswer};

/// The longest wait at the page without a look around.
const WAIT_STEP: Duration = Duration::from_millis(20);

/// A cycle that is open for so long may have lost its owner, with nobody to take the bus over.
const ORPHANED_NS: u64 = 200_000_000;

/// The wire of a master.
#[derive(Debug)]
pub struct PageWire {
    page: DrivePage,
    pace: Pace,
    /// Time for one exchange in realtime; period of a scan.
    period: Duration,
    /// In lockstep: how long a fieldbus process may take.
    answer_limit: Duration,
    wiring: Wiring,
    up: bool,
    cycle: u64,
}

impl PageWire {
    /// Over a page; cycles go on from those of a master before.
    pub fn new(page: DrivePage, pace: Pace, period: Duration, answer_limit: Duration) -> PageWire {
        let cycle = page.requested().map_or(0, |cycle| cycle.saturating_add(1));
        PageWire {
            wiring: page.wiring(),
            up: false,
            page,
            pace,
            period,
            answer_limit,
            cycle,
        }
    }

    /// Waits until the bus is in operation for the first time, at most so long: processes of a cell start side by side.
    pub fn await_start(&self, limit: Duration) {
        let started = Instant::now();
        while self.page.requested().is_none() && started.elapsed() < limit {
            let seen = self.page.answered_signal().count();
            if self.page.state() == BusState::Cycling {
                return;
            }
            self.page.answered_signal().wait(seen, WAIT_STEP);
        }
    }

    /// Whether cycles are exchanged. In lockstep time waits while the segment is started up.
    fn is_up(&mut self) -> bool {
        let started = Instant::now();
        loop {
            let seen = self.page.answered_signal().count();
            let state = self.page.state();
            let cycling = state == BusState::Cycling;
            if cycling && !self.up {
                self.wiring = self.page.wiring();
            }
            self.up = cycling;
            let waits = self.pace == Pace::Lockstep
                && state == BusState::Starting
                && started.elapsed() < self.answer_limit;
            if !waits {
                return cycling;
            }
            self.page.answered_signal().wait(seen, WAIT_STEP);
        }
    }

    /// Waits for the answer of a cycle.
    fn await_answer(&self, cycle: u64) -> WireAnswer {
        let until_ns = now_ns().saturating_add(match self.pace {
            // The rest of the scan is for the answers of the others.
            Pace::Realtime => self.period.as_nanos() as u64 / 2,
            Pace::Lockstep => self.answer_limit.as_nanos() as u64,
        });
        let look_ns = now_ns() + ORPHANED_NS;
        loop {
            let seen = self.page.answered_signal().count();
            if self.page.answered() == Some(cycle) {
                return WireAnswer::Answered;
            }
            if self.page.state() != BusState::Cycling {
                return WireAnswer::Down;
            }
            let now = now_ns();
            if now >= until_ns {
                return WireAnswer::OwnerSilent;
            }
            // Without a launcher nobody else reports its death.
            if now >= look_ns && self.page.owner().is_none() {
                return WireAnswer::Down;
            }
            let left = Duration::from_nanos(until_ns - now);
            self.page.answered_signal().wait(seen, left.min(WAIT_STEP));
        }
    }
}

impl Wire for PageWire {
    fn wiring(&self) -> &Wiring {
        &self.wiring
    }

    fn exchange(&mut self, outputs: &Outputs, inputs: &mut Inputs) -> WireAnswer {
        if !self.is_up() {
            return WireAnswer::Down;
        }
        let cycle = self.cycle;
        self.cycle = self.cycle.saturating_add(1);
        self.page.request(cycle, outputs);
        let answered = match self.await_answer(cycle) {
            WireAnswer::Answered => cycle,
            // An owner whose frames do not come back waits for each of them about as long as is waited for it here.
            WireAnswer::OwnerSilent if cycle > 0 && self.page.answered() == Some(cycle - 1) => {
                cycle - 1
            }
            other => return other,
        };
        self.page.inputs(answered, inputs);
        match inputs.answered == 1 {
            true if answered == cycle => WireAnswer::Answered,
            true => WireAnswer::OwnerSilent,
            false => WireAnswer::Missed,
        }
    }

    fn start_again(&mut self) {
        self.page.ask_to_start_again();
    }

    fn pause(&self) {
        if self.pace == Pace::Realtime {
            std::thread::sleep(self.period);
        }
    }
}
