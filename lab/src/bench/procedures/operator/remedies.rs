//! What the machine says is to be done, and that it works.

use bus::sample::{Cause, Mode, OperatorRequest, Order, Refused};
use machine::HomingMethod;

use super::{Done, K_SCANS, LONG_SCANS, Operator, Stop, state};
use crate::bench::procedures::interruptions::order;
use crate::bench::procedures::machines::Wire;
use crate::staying::Cell;

/// A zero that an index behind a switch has given is off by no more, in mm.
const ZERO_MM: f64 = 0.005;

impl Operator<'_> {
    /// Does what a refusal says.
    pub(super) fn remedy(&mut self, reason: Refused) -> Done {
        match reason {
            Refused::Jogging => {
                self.demand("hold", |_| order(Order::Hold))?;
                self.rests()
            }
            Refused::NotHeld => self.demand("hold", |_| order(Order::Hold)).map(drop),
            Refused::DrivesOff | Refused::Tripped => self.switches_on(),
            Refused::NotReferenced => self.homes(),
            Refused::Running | Refused::Faulted => self.gives_up(),
            Refused::OutsideTravel => self.comes_inside(),
            Refused::EmergencyStopOpen => self.closes(Wire::Chain),
            Refused::DoorOpen => self.closes(Wire::Door),
            Refused::SignalOff => self.closes(Wire::Air),
            Refused::InThread => self.demand("resume", |_| order(Order::Resume)).map(drop),
            other => {
                let words = other.words();
                Err(Stop::Violation(format!(
                    "nothing can be done about: {words}"
                )))
            }
        }
    }

    fn closes(&mut self, wire: Wire) -> Done {
        self.demand("signal", |_| wire.set(true)).map(drop)
    }

    pub(super) fn rests(&mut self) -> Done {
        let still =
            |of: &Cell| !matches!(of.mode(), Mode::Jogging | Mode::Stopping | Mode::Finished);
        self.until("rest", K_SCANS, still)
    }

    /// Drives on; a cause that is named while they come on is answered by another try.
    pub(super) fn switches_on(&mut self) -> Done {
        for _ in 0..3 {
            self.demand("enable", |_| order(Order::Enable))?;
            self.scan()?;
            let is_off = |of: &Cell| matches!(of.mode(), Mode::Disabled | Mode::Tripped);
            let of_drive = [Cause::DriveOff, Cause::DriveFault, Cause::DriveLost];
            let says_why =
                |of: &Cell| of.mode() == Mode::Disabled && of_drive.contains(&of.cause());
            self.until("power", K_SCANS, |of| !is_off(of) || says_why(of))?;
            if !is_off(&self.run.cell) {
                let after = self.run.cell.now.scan - self.interrupted;
                self.on_after = self.on_after.max(after);
                return Ok(());
            }
        }
        Err(Stop::Violation(format!(
            "it does not come on: {}",
            state(&self.run.cell)
        )))
    }

    pub(super) fn homes(&mut self) -> Done {
        self.demand("home", |_| order(Order::Home))?;
        self.scans(2)?;
        self.until("the end of homing", LONG_SCANS, |of| {
            of.mode() != Mode::Jogging
        })?;
        let cell = &self.run.cell;
        if cell.mode() == Mode::Tripped {
            // What has come is seen only now; a trip that comes of nothing has been told.
            return Err(Stop::Interrupted);
        }
        let of_homing = [Cause::HomeSwitch, Cause::HomeIndex, Cause::HomeDrive];
        if cell.is_homed() && !of_homing.contains(&cell.cause()) {
            return self.has_its_zero();
        }
        Err(Stop::Violation(format!("it is not homed: {}", state(cell))))
    }

    /// Where an index behind a switch says where an axis is, it truly is there.
    pub(super) fn has_its_zero(&self) -> Done {
        let cell = &self.run.cell;
        let axes = cell.machine.axes.iter().enumerate();
        let exact = axes.filter(|(_, of)| {
            let homing = of.homing.as_ref();
            homing.is_some_and(|of| of.method == HomingMethod::SwitchIndex)
        });
        let off_mm = exact.map(|(axis, _)| cell.off_mm(axis).abs());
        match off_mm.fold(0.0, f64::max) {
            off_mm if off_mm > ZERO_MM => Err(Stop::Violation(format!(
                "its zero is off by {off_mm} mm: {}",
                state(cell)
            ))),
            _ => Ok(()),
        }
    }

    /// What is left of the program.
    pub(super) fn gives_up(&mut self) -> Done {
        self.demand("stop", |_| order(Order::Stop))?;
        self.rests()?;
        self.demand("reset", |_| order(Order::Reset)).map(drop)
    }

    /// An axis is outside its travel.
    pub(super) fn comes_inside(&mut self) -> Done {
        for axis in 0..self.run.cell.machine.axes.len() {
            let (way_mm, travel_mm) = self.run.cell.to_the_middle(axis);
            let out_mm = way_mm.abs() - travel_mm / 2.0;
            if out_mm > 0.0 {
                let way_mm = (out_mm + 1.0).copysign(way_mm);
                self.jogs(axis, way_mm)?;
            }
        }
        Ok(())
    }

    /// One axis by hand, exactly so far.
    pub(super) fn jogs(&mut self, axis: usize, way_mm: f64) -> Done {
        // Before the order that is obeyed: while one is refused, an axis that was enabled just now may still follow its encoder.
        let mut from = 0;
        self.demand("jog", |cell| {
            from = cell.now.axes[axis].command_position;
            OperatorRequest {
                axis: axis as u32,
                value: way_mm,
                ..order(Order::Jog)
            }
        })?;
        self.scans(2)?;
        self.rests()?;
        self.ends_at("a jog", from, axis, way_mm)
    }

    pub(super) fn ends_at(&self, what: &str, from: i64, axis: usize, way_mm: f64) -> Done {
        let increment_mm = self.run.cell.machine.axes[axis].increment_mm();
        let went = self.run.cell.now.axes[axis].command_position - from;
        match went == (way_mm / increment_mm).round() as i64 {
            true => Ok(()),
            false => Err(Stop::Violation(format!(
                "{what} of {way_mm} mm has gone {} mm in axis {axis}: {}",
                went as f64 * increment_mm,
                state(&self.run.cell)
            ))),
        }
    }
}
