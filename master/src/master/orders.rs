//! Orders of the operator: judged by the state they come in, latched, seen by everybody in the next feedback.
//!
//! The table of states and orders is docs/reference/orders.md.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::{Cause, Driver, Mode, OperatorRequest, OperatorResponse, Order, Refused};

use crate::drives::Drives;

use super::Master;
use super::axis_unit::AxisUnit;
use crate::window_arbiter::Dropped;

/// No jog is slower than this, in mm/s: below it, speeds are not told apart.
const JOG_MM_S_MIN: f64 = 0.001;
/// A jog may take this much longer than its way at its speed, in s: settling twice, lagging, speeding up.
const JOG_PATIENCE_S: f64 = 5.0;

/// Orders that a cell which is about to end takes no more: they would keep it from ending.
fn moves(order: Order) -> bool {
    match order {
        Order::Resume
        | Order::Disable
        | Order::Enable
        | Order::Jog
        | Order::JogOn
        | Order::JogRenew
        | Order::Home
        | Order::Load
        | Order::Start
        | Order::Reset => true,
        Order::Stop
        | Order::Hold
        | Order::Override
        | Order::Down
        | Order::OptionalStop
        | Order::SingleBlock
        | Order::RapidOverride
        | Order::EmergencyStop => false,
    }
}

/// The value of an order that is a count, a number or a set of bits.
pub(super) fn whole_number(value: f64) -> Result<u32, Refusal> {
    let is_whole = value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value);
    if is_whole {
        Ok(value as u32)
    } else {
        Err(Refused::BadValue.into())
    }
}

/// An order that was refused: why, and for a jog beyond the travel which distances are allowed, in mm; for one that is too fast,
/// which speeds, in mm/s.
#[derive(Debug, Clone, Copy)]
pub(super) struct Refusal {
    pub(super) reason: Refused,
    pub(super) allowed_mm: (f64, f64),
}

impl From<Refused> for Refusal {
    fn from(reason: Refused) -> Refusal {
        Refusal {
            reason,
            allowed_mm: (0.0, 0.0),
        }
    }
}

impl AxisUnit {
    /// Distances from its command position to the ends of its travel, in increments; from outside, to the far end and no farther
    /// out.
    /// Nobody knows where the travel of one that is not homed is: it may go as far as that is long.
    pub(super) fn room(&self) -> (i64, i64) {
        if !self.is_homed() {
            let travel_mm = self.settings.travel_max_mm - self.settings.travel_min_mm;
            let travel = self.increments(travel_mm);
            return (travel.saturating_neg(), travel);
        }
        let reach = self.guards.travel.from_place(self.command_position);
        let to = |end: i64| end.saturating_sub(self.command_position);
        (to(reach.min), to(reach.max))
    }

    /// Whether a program may move it.
    pub(super) fn is_within_travel(&self) -> bool {
        !self.is_homed() || self.settings.may_stand_at(self.command_position)
    }
}

impl<D: Drives> Master<D> {
    /// Judges an order; what is latched shows in the next feedback.
    pub fn order(&mut self, request: &OperatorRequest) -> OperatorResponse {
        let judged = match Order::from_wire(request.order) {
            Some(order) if self.ordered_to_end && moves(order) => Err(Refused::Ending.into()),
            Some(_) if request.latest_scan != 0 && self.scan > request.latest_scan => {
                Err(Refused::TooLate.into())
            }
            Some(Order::Stop) => self.order_stop(),
            Some(Order::Hold) => self.order_hold(),
            Some(Order::Resume) => self.order_resume(),
            Some(Order::Override) => self.order_override(request.value),
            Some(Order::Disable) => self.order_disable(),
            Some(Order::Enable) => self.order_enable(),
            Some(Order::Jog) => self.order_jog(request),
            Some(Order::JogOn) => self.order_jog_on(request),
            Some(Order::JogRenew) => self.order_jog_renew(request),
            Some(Order::EmergencyStop) => self.order_emergency_stop(),
            Some(Order::Home) => self.order_home(request.value),
            Some(Order::Load) => self.order_load(request.value, request.session != 0),
            Some(Order::Start) => self.order_start(request.session, request.value),
            Some(Order::OptionalStop) => self.order_optional_stop(request.value),
            Some(Order::RapidOverride) => self.order_rapid_override(request.value),
            Some(Order::Reset) => self.order_reset(),
            Some(Order::SingleBlock) => self.order_single_block(request.value),
            Some(Order::Down) => {
                self.end_after_stop();
                Ok(())
            }
            None => Err(Refused::UnknownOrder.into()),
        };
        let (reason, allowed_mm) = match judged {
            Ok(()) => (Refused::Not, (0.0, 0.0)),
            Err(refusal) => (refusal.reason, refusal.allowed_mm),
        };
        OperatorResponse {
            scan: self.scan,
            allowed_min_mm: allowed_mm.0,
            allowed_max_mm: allowed_mm.1,
            accepted: u32::from(reason == Refused::Not),
            mode: self.mode as u32,
            reason: reason as u32,
            hold: u32::from(self.hold),
            override_percent: self.override_percent,
            run: self.program.run,
        }
    }

    fn order_stop(&mut self) -> Result<(), Refusal> {
        if self.stop() || !self.ends() {
            return Ok(());
        }
        Err(Refused::Finished.into())
    }

    /// Comes to rest, on the path or where a jog is: no further window is admitted. False where there is nothing to
    /// stop. A machine without drives is at rest, one that has tripped will be; their run may end.
    pub fn stop(&mut self) -> bool {
        match self.mode {
            Mode::Enabled => {
                self.mode = if self.windows.has_window() {
                    Mode::Stopping
                } else {
                    Mode::Stopped
                };
                true
            }
            Mode::Jogging => {
                self.stop_jog();
                self.mode = Mode::Stopping;
                true
            }
            Mode::Disabled | Mode::Tripped => {
                self.switching_on = None;
                self.may_end = self.ends();
                // A servo that comes back must not set off what was ordered to stop.
                self.hold |= !self.ends();
                true
            }
            Mode::Stopping | Mode::Stopped | Mode::Ready => true,
            Mode::Finished => false,
        }
    }

    fn order_hold(&mut self) -> Result<(), Refusal> {
        match self.mode {
            Mode::Tripped => Err(Refused::Tripped.into()),
            Mode::Finished => Err(Refused::Finished.into()),
            Mode::Jogging => {
                self.stop_jog();
                self.hold = true;
                Ok(())
            }
            Mode::Disabled | Mode::Enabled | Mode::Stopping | Mode::Stopped | Mode::Ready => {
                self.hold = true;
                Ok(())
            }
        }
    }

    fn order_resume(&mut self) -> Result<(), Refusal> {
        let outside = !self.is_within_travel();
        match self.mode {
            Mode::Enabled | Mode::Ready | Mode::Stopped | Mode::Tripped if !self.is_homed() => {
                return Err(Refused::NotReferenced.into());
            }
            Mode::Enabled | Mode::Ready | Mode::Stopped | Mode::Tripped if outside => {
                return Err(Refused::OutsideTravel.into());
            }
            Mode::Enabled => {}
            Mode::Ready if !self.hold => return Err(Refused::NotRunning.into()),
            Mode::Ready => {}
            Mode::Stopped if self.cause != Cause::None => return Err(Refused::Faulted.into()),
            Mode::Stopped => self.mode = Mode::Enabled,
            Mode::Stopping => return Err(Refused::NotAtRest.into()),
            Mode::Jogging => return Err(Refused::Jogging.into()),
            Mode::Disabled => return Err(Refused::DrivesOff.into()),
            Mode::Tripped if self.waits_for_servo() => {
                self.acknowledge(false)?;
            }
            Mode::Tripped => return Err(Refused::Tripped.into()),
            Mode::Finished => return Err(Refused::Finished.into()),
        }
        self.hold = false;
        self.auxiliary.end_stop();
        Ok(())
    }

    fn order_optional_stop(&mut self, value: f64) -> Result<(), Refusal> {
        if value != 0.0 && value != 1.0 {
            return Err(Refused::BadValue.into());
        }
        self.auxiliary.latches.optional_stop = u32::from(value == 1.0);
        Ok(())
    }

    fn order_override(&mut self, percent: f64) -> Result<(), Refusal> {
        if !(0.0..=f64::from(self.override_max_percent)).contains(&percent) {
            return Err(Refused::BadValue.into());
        }
        self.override_percent = percent as u32;
        Ok(())
    }

    fn order_rapid_override(&mut self, percent: f64) -> Result<(), Refusal> {
        if !(0.0..=100.0).contains(&percent) {
            return Err(Refused::BadValue.into());
        }
        self.auxiliary.latches.rapid_override_percent = percent as u32;
        Ok(())
    }

    /// At rest in hold, or stopped: what an operator may do to the axes is allowed now.
    pub(super) fn must_rest(&self) -> Result<(), Refusal> {
        match self.mode {
            Mode::Enabled if !self.hold => return Err(Refused::NotHeld.into()),
            Mode::Enabled | Mode::Stopped | Mode::Ready => {}
            Mode::Stopping => return Err(Refused::NotAtRest.into()),
            Mode::Jogging => return Err(Refused::Jogging.into()),
            Mode::Disabled => return Err(Refused::DrivesOff.into()),
            Mode::Tripped => return Err(Refused::Tripped.into()),
            Mode::Finished => return Err(Refused::Finished.into()),
        }
        if self.rest_scans < self.rest_scans_min {
            return Err(Refused::NotAtRest.into());
        }
        Ok(())
    }

    fn order_disable(&mut self) -> Result<(), Refusal> {
        if self.mode == Mode::Disabled {
            self.switching_on = None;
            return Ok(());
        }
        self.must_rest()?;
        self.windows.drop_all(self.scan, Dropped::LeavesPath);
        self.mode = Mode::Disabled;
        self.may_end = false;
        for axis in &mut self.axes {
            axis.deviation = axis
                .command_position
                .saturating_sub(axis.feedback_position());
        }
        Ok(())
    }

    /// Drives on, in hold: nothing moves before somebody resumes.
    fn order_enable(&mut self) -> Result<(), Refusal> {
        match self.mode {
            Mode::Enabled | Mode::Stopping | Mode::Stopped | Mode::Jogging | Mode::Ready => {
                return Ok(());
            }
            Mode::Tripped => return self.acknowledge(true),
            Mode::Finished => return Err(Refused::Finished.into()),
            Mode::Disabled => {}
        }
        self.must_be_referenced()?;
        self.may_end = false;
        self.switch_on(true);
        Ok(())
    }

    /// Whether a program may move the axes: farther outside the travel only a jog does, inwards.
    pub(super) fn is_within_travel(&self) -> bool {
        self.axes.iter().all(AxisUnit::is_within_travel)
    }

    /// Every drive knows where its axis is, or the axis can be homed.
    fn must_be_referenced(&self) -> Result<(), Refusal> {
        if !self.axes.iter().all(AxisUnit::may_be_driven) {
            return Err(Refused::NotReferenced.into());
        }
        Ok(())
    }

    /// Ends a trip, if the machine can be driven again; its run does not end then.
    pub(super) fn acknowledge(&mut self, hold: bool) -> Result<(), Refusal> {
        if self.last || self.may_end {
            return Err(Refused::Finished.into());
        }
        if !self.is_served_at_rest() {
            return Err(Refused::NotReady.into());
        }
        // Whoever enables resets faults of drives, and has lost ones started again.
        if !hold && !self.drives_can_follow() {
            return Err(Refused::NotReady.into());
        }
        self.must_be_referenced()?;
        self.settled_scans = 0;
        self.switch_on(hold);
        Ok(())
    }

    fn order_jog(&mut self, request: &OperatorRequest) -> Result<(), Refusal> {
        let unit = self.unit_to_jog(request.axis)?;
        let increment_mm = unit.settings.increment_mm();
        // Beyond all machines a distance has no increments.
        let distance = libm::round(request.value / increment_mm);
        if !distance.is_finite() || distance == 0.0 {
            return Err(Refused::BadValue.into());
        }
        let (low, high) = unit.room();
        if !(low as f64..=high as f64).contains(&distance) {
            return Err(Refusal {
                reason: Refused::BeyondTravel,
                allowed_mm: (low as f64 * increment_mm, high as f64 * increment_mm),
            });
        }
        let speed_mm_s = self.jog_speed(request)?;
        self.begin_jog(request.axis as usize, distance as i64, speed_mm_s);
        Ok(())
    }

    /// The axis that an order is to jog, where one may be jogged.
    pub(super) fn unit_to_jog(&self, axis: u32) -> Result<&AxisUnit, Refusal> {
        self.must_rest()?;
        if self.auxiliary.latches.coupled != 0 {
            return Err(Refused::InThread.into());
        }
        let unit = self.axes.get(axis as usize);
        let unit = unit.filter(|_| !self.is_follower(axis as usize));
        Ok(unit.ok_or(Refused::UnknownAxis)?)
    }

    /// Speed of a jog, in mm/s: none where the machine file has it.
    pub(super) fn jog_speed(&self, request: &OperatorRequest) -> Result<Option<f64>, Refusal> {
        let unit = self.axes.get(request.axis as usize);
        let unit = unit.ok_or(Refused::UnknownAxis)?;
        let most_mm_s = unit.settings.rapid_mm_s;
        match request.speed_mm_s {
            0.0 => Ok(None),
            speed if (JOG_MM_S_MIN..=most_mm_s).contains(&speed) => Ok(Some(speed)),
            _ => Err(Refusal {
                reason: Refused::JogSpeed,
                allowed_mm: (JOG_MM_S_MIN, most_mm_s),
            }),
        }
    }

    /// The manual controller takes the axis so many increments further, with both motors of a gantry.
    pub(super) fn begin_jog(&mut self, axis: usize, distance: i64, speed_mm_s: Option<f64>) {
        self.continuous_jog = None;
        self.set_jog_speed(axis, distance, speed_mm_s);
        if let Some(unit) = self.axes.get_mut(axis) {
            unit.jog_target = unit.command_position.saturating_add(distance);
            unit.driver = Driver::Manual;
        }
        self.follow_by_hand(axis);
        self.jog_from = self.mode;
        self.mode = Mode::Jogging;
        self.windows.drop_all(self.scan, Dropped::LeavesPath);
    }

    /// How fast a jog goes over so many increments, and how long it may take.
    pub(super) fn set_jog_speed(&mut self, axis: usize, distance: i64, speed_mm_s: Option<f64>) {
        let Some(unit) = self.axes.get(axis) else {
            return;
        };
        self.jog_um_s = speed_mm_s.map_or(0, |speed| libm::round(speed * 1e3).max(1.0) as u32);
        let speed_mm_s = speed_mm_s.unwrap_or(self.jog_mm_s);
        let speed_mm_s = speed_mm_s.min(unit.settings.rapid_mm_s);
        let speed_mm_s = match unit.settings.homing {
            Some(homing) if !unit.is_homed() => speed_mm_s.min(homing.search_mm_s),
            _ => speed_mm_s,
        };
        let distance_mm = distance.saturating_abs() as f64 * unit.settings.increment_mm();
        let patience_s = 1.5 * distance_mm / speed_mm_s + JOG_PATIENCE_S;
        self.jog_patience_scans = libm::ceil(patience_s / self.scan_period_s) as u64;
    }

    /// The second controllers come to rest where they can.
    pub(super) fn stop_jog(&mut self) {
        self.continuous_jog = None;
        for axis in &mut self.axes {
            if matches!(axis.driver, Driver::Manual | Driver::Search | Driver::Latch) {
                axis.driver = Driver::ManualStop;
            }
        }
        self.end_homing();
    }

    /// All second controllers are at rest: the program's drive again, in the mode the jog began in.
    pub(super) fn end_jog(&mut self) {
        self.continuous_jog = None;
        self.jog_um_s = 0;
        for axis in &mut self.axes {
            axis.driver = Driver::Program;
        }
        if self.mode == Mode::Jogging {
            self.mode = self.jog_from;
        }
        self.rest_scans = 0;
    }

    /// One scan of a jog; one that never ends trips.
    pub(super) fn await_jog(&mut self) {
        self.jog_patience_scans = self.jog_patience_scans.saturating_sub(1);
        if self.jog_patience_scans == 0 {
            let axis = self
                .axes
                .iter()
                .position(|axis| axis.driver != Driver::Program);
            self.trip(Cause::NotInPosition, axis.map_or(u32::MAX, |a| a as u32));
        }
    }
}
