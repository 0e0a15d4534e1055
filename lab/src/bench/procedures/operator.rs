//! An operator who does what the machine says, until it can be moved again.

use bus::sample::{MAX_WINDOW_SETPOINTS, Mode, OperatorRequest, Order, ProgramState, Refused};
use plant_sim::script::rng::Rng;

use super::interruptions::{Interruption, asked, order};
use super::run::{Prepared, Run};
use crate::staying::Cell;

mod proof;
mod remedies;

/// K: within so many scans each of these comes to its end, once nothing more happens: whatever moves is at rest, drives that are to be
/// on are, an order whose refusal says "wait" is taken. Drives may take 5 s of it.
pub const K_SCANS: u64 = 6_000;
/// A homing, and the rest of a program, take no longer.
const LONG_SCANS: u64 = 25_000;
/// From one order to the next of an operator who waits.
const WAIT_SCANS: u64 = 20;
/// Remedies, one after the other, after which an order that is still refused never comes.
const REMEDIES_MAX: usize = 12;
/// A trip must come so soon behind what it comes of: the loss of a servo waits until the window in force has come to its end.
const TRIPS_SCANS: u64 = MAX_WINDOW_SETPOINTS as u64 + 200;

/// Why an operator does not go on.
pub enum Stop {
    /// Something more has happened: he looks again.
    Interrupted,
    /// What must not be.
    Violation(String),
}

type Done<T = ()> = Result<T, Stop>;

impl From<String> for Stop {
    fn from(what: String) -> Stop {
        Stop::Violation(what)
    }
}

/// A run that was interrupted, and what he has seen.
pub struct Operator<'a> {
    pub run: Run,
    prepared: &'a Prepared,
    /// What is still to come, and how many scans after what came last.
    later: Vec<(u64, Interruption)>,
    /// Scan of what came last.
    interrupted: u64,
    /// A trip is explained up to this scan.
    may_trip_until: u64,
    is_to_end: bool,
    /// Another program was loaded.
    is_another: bool,
    /// The longest time from what came last to drives that are on, in scans.
    pub on_after: u64,
    /// Of a gantry that stands, the largest difference of the torques of its motors, and the most that one pulls against the other one, in
    /// percent of the rated torque.
    pub strain_percent: Option<[f64; 2]>,
    /// What was ordered, for people.
    pub told: Option<Vec<String>>,
}

impl<'a> Operator<'a> {
    /// Of a procedure that is about to be interrupted: what comes, and what later.
    pub fn new(
        prepared: &'a Prepared,
        run: Run,
        later: Vec<(u64, Interruption)>,
        tells: bool,
    ) -> Operator<'a> {
        Operator {
            run,
            prepared,
            later,
            interrupted: 0,
            may_trip_until: 0,
            is_to_end: false,
            is_another: false,
            on_after: 0,
            strain_percent: None,
            told: tells.then(Vec::new),
        }
    }

    fn tell(&mut self, what: impl Fn(&Cell) -> String) {
        if let Some(told) = &mut self.told {
            let cell = &self.run.cell;
            let (scan, mode) = (cell.now.scan, cell.mode());
            told.push(format!("scan {scan}, {mode:?}: {}", what(cell)));
        }
    }

    /// Something comes between.
    fn suffer(&mut self, what: Interruption) -> Done {
        self.tell(|_| format!("{what:?} comes"));
        what.happens(&mut self.run.cell)?;
        let is_first = self.interrupted == 0;
        self.interrupted = self.run.cell.now.scan;
        if what.may_trip(&self.run.cell.machine, is_first) {
            self.may_trip_until = self.interrupted + TRIPS_SCANS;
        }
        let ends = [
            Interruption::LauncherDies,
            Interruption::Ordered(Order::Down),
        ];
        self.is_to_end |= ends.contains(&what);
        self.is_another |= what == Interruption::Ordered(Order::Load);
        Ok(())
    }

    fn scan(&mut self) -> Done {
        let since = self.run.cell.now.scan.saturating_sub(self.interrupted);
        let comes = self.later.first().is_some_and(|of| of.0 <= since);
        if comes {
            let (_, what) = self.later.remove(0);
            self.suffer(what)?;
            return Err(Stop::Interrupted);
        }
        let cell = &mut self.run.cell;
        let was = cell.mode();
        cell.scan();
        if cell.mode() == Mode::Tripped && was != Mode::Tripped {
            let (scan, cause) = (cell.now.scan, cell.cause());
            self.tell(|of| format!("trips: {:?} of axis {}", of.cause(), of.now.cause_axis));
            if scan > self.may_trip_until {
                return Err(Stop::Violation(format!(
                    "it trips in scan {scan}: {cause:?}"
                )));
            }
        }
        Ok(())
    }

    fn scans(&mut self, count: u64) -> Done {
        (0..count).try_for_each(|_| self.scan())
    }

    /// Waits until it is so.
    fn until(&mut self, what: &str, scans: u64, is: impl Fn(&Cell) -> bool) -> Done {
        for _ in 0..scans {
            if is(&self.run.cell) {
                return Ok(());
            }
            self.scan()?;
        }
        let state = state(&self.run.cell);
        Err(Stop::Violation(format!(
            "{what} does not come within {scans} scans: {state}"
        )))
    }

    /// Gives an order, and does what its refusals say until it is taken; false where there is nothing left to order.
    fn demand(
        &mut self,
        what: &str,
        mut request: impl FnMut(&mut Cell) -> OperatorRequest,
    ) -> Done<bool> {
        let (mut remedies, mut waited) = (0, 0);
        loop {
            let asks = request(&mut self.run.cell);
            let reason = asked(&mut self.run.cell, &asks)?;
            self.tell(|_| format!("{what}: {reason:?}"));
            let waits = match reason {
                Refused::Not => return Ok(true),
                Refused::NotRunning | Refused::NoProgram if what != "typed-in blocks" => {
                    return Ok(false);
                }
                Refused::NotAtRest
                | Refused::Loading
                | Refused::NotReady
                | Refused::Backlog
                | Refused::Finished => true,
                _ => false,
            };
            let sees_to_it = reason == Refused::NotReady && what == "resume";
            if sees_to_it && self.run.cell.master.drives().are_troubled() {
                // `enable` resets a drive and starts the bus again.
                remedies += 1;
                self.switches_on()?;
            } else if waits {
                waited += WAIT_SCANS;
                self.scans(WAIT_SCANS)?;
            } else {
                remedies += 1;
                self.remedy(reason)?;
                // What he has ordered acts in the next scan.
                self.scans(1)?;
            }
            if waited > K_SCANS || remedies > REMEDIES_MAX {
                let state = state(&self.run.cell);
                let words = reason.words();
                return Err(Stop::Violation(format!(
                    "{what} is never taken: {words}; {state}"
                )));
            }
        }
    }

    /// Something comes, and the machine recovers.
    pub fn suffers_and_recovers(
        &mut self,
        what: Interruption,
        rng: &mut Rng,
        goes_on: bool,
        again: bool,
    ) -> Result<(), String> {
        match self.suffer(what) {
            Err(Stop::Violation(what)) => Err(what),
            _ => self.recovers(rng, goes_on, again),
        }
    }

    /// Brings the machine to where it can be moved, and moves it. `goes_on` where he has the program go on first; `again` where the
    /// procedure is to run once more.
    fn recovers(&mut self, rng: &mut Rng, goes_on: bool, again: bool) -> Result<(), String> {
        loop {
            match self.tries(rng, goes_on, again) {
                Err(Stop::Interrupted) => {}
                Err(Stop::Violation(what)) => return Err(what),
                Ok(()) => return Ok(()),
            }
        }
    }

    fn tries(&mut self, rng: &mut Rng, goes_on: bool, again: bool) -> Done {
        if self.is_to_end {
            return self.sees_it_end();
        }
        // He is not there at once.
        let later = rng.below(400);
        self.scans(later)?;
        self.takes_back_overrides()?;
        if goes_on {
            self.goes_on()?;
        }
        self.makes_ready()?;
        if self.prepared.procedure.homes && !again || !self.run.cell.is_homed() {
            self.homes()?;
        }
        self.moves()?;
        if again {
            self.repeats()?;
        }
        Ok(())
    }

    /// A cell that was ordered to end takes nothing more that moves, and ends.
    fn sees_it_end(&mut self) -> Done {
        let reason = asked(&mut self.run.cell, &order(Order::Home))?;
        if reason != Refused::Ending {
            return Err(Stop::Violation(format!(
                "it is to end and says {reason:?} to `home`"
            )));
        }
        self.until("the end", K_SCANS, |of| of.ended)
    }

    fn takes_back_overrides(&mut self) -> Done {
        for what in [Order::Override, Order::RapidOverride, Order::JogOverride] {
            self.demand(what.word(), |_| OperatorRequest {
                value: 100.0,
                ..order(what)
            })?;
        }
        self.demand("single-block", |_| order(Order::SingleBlock))
            .map(drop)
    }
}

/// Where a machine stands.
pub fn state(cell: &Cell) -> String {
    let now = &cell.now;
    let program = ProgramState::from_wire(now.program);
    format!(
        "scan {}, {:?}, {:?} of axis {}, hold {}, program {program:?}, rested {}, waiting {}, spindle {:.0} rev/min, element {}",
        now.scan,
        cell.mode(),
        cell.cause(),
        now.cause_axis as i32,
        now.hold,
        now.rested,
        now.auxiliary.waiting,
        now.auxiliary.spindle_rpm,
        now.tag.element
    )
}
