//! Orders of the operator: judged by the state they come in, latched, seen by everybody in the next feedback.
//!
//! The table of states and orders is docs/reference/orders.md.

use bus::sample::{
    Cause, DOWN_FOR_LOSS, HoldReason, Mode, OperatorRequest, OperatorResponse, Order, Refused,
};

use crate::drives::Drives;

use super::Master;
use super::axis_unit::AxisUnit;
use crate::window_arbiter::Dropped;

/// Orders that a cell which is about to end takes no more: they would keep it from ending.
fn moves(order: Order) -> bool {
    match order {
        Order::Resume
        | Order::Disable
        | Order::Enable
        | Order::Jog
        | Order::JogOn
        | Order::JogRenew
        | Order::Wheel
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
        | Order::JogOverride
        | Order::Signal
        | Order::SignalForce
        | Order::SignalRelease
        | Order::Acknowledge
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
    pub(super) axis: u32,
}

impl From<Refused> for Refusal {
    fn from(reason: Refused) -> Refusal {
        Refusal {
            reason,
            allowed_mm: (0.0, 0.0),
            axis: 0,
        }
    }
}

impl AxisUnit {
    /// Whether a program may move it.
    pub(super) fn is_within_travel(&self) -> bool {
        !self.is_homed() || self.settings.may_stand_at(self.command_position())
    }
}

impl<D: Drives> Master<D> {
    /// Judges an order; what is latched shows in the next feedback.
    pub fn order(&mut self, request: &OperatorRequest) -> OperatorResponse {
        self.manual.begin_order();
        let judged = match Order::from_wire(request.order) {
            Some(order) if self.modes.is_ordered_to_end() && moves(order) => {
                Err(Refused::Ending.into())
            }
            Some(_) if request.latest_scan != 0 && self.scan > request.latest_scan => {
                Err(Refused::TooLate.into())
            }
            Some(Order::Stop) => self.order_stop(),
            Some(Order::Hold) => self.order_hold(),
            Some(Order::Resume) => self.order_resume(),
            Some(Order::Override) => self.order_override(request.value),
            Some(Order::Disable) => self.order_disable(),
            Some(Order::Enable) => self.order_enable(),
            Some(Order::Jog) if request.line_mm.iter().any(|way| *way != 0.0) => {
                self.order_jog_line(request)
            }
            Some(Order::Jog) => self.order_jog(request),
            Some(Order::JogOn) => self.order_jog_on(request),
            Some(Order::JogRenew) => self.order_jog_renew(request),
            Some(Order::Wheel) => self.order_wheel(request),
            Some(Order::EmergencyStop) => self.order_emergency_stop(),
            Some(Order::Home) => self.order_home(request.value),
            Some(Order::Load) => self.order_load(request),
            Some(Order::Start) => self.order_start(request.session, request.value),
            Some(Order::OptionalStop) => self.auxiliary.switch_optional_stop(request.value),
            Some(Order::RapidOverride) => self.auxiliary.override_rapids(request.value),
            Some(Order::JogOverride) => self.order_jog_override(request.value),
            Some(Order::Reset) => self.order_reset(),
            Some(Order::Signal) => self.signals.hold(request, false),
            Some(Order::SignalForce) => self.signals.hold(request, true),
            Some(Order::SignalRelease) => self.signals.let_go(request),
            Some(Order::Acknowledge) => self.order_acknowledge(request.value),
            Some(Order::SingleBlock) => self.auxiliary.switch_single_block(request.value),
            Some(Order::Down) => {
                self.end_after_stop(request.value == DOWN_FOR_LOSS);
                Ok(())
            }
            None => Err(Refused::UnknownOrder.into()),
        };
        let Refusal {
            reason,
            allowed_mm,
            axis,
        } = match judged {
            Ok(()) => Refused::Not.into(),
            Err(refusal) => refusal,
        };
        let by_order = self.manual.by_order();
        let cut = by_order.cut;
        OperatorResponse {
            scan: self.scan,
            jogged_mm: by_order.jogged_mm,
            rests: cut.map_or(0, |(_, place)| place),
            allowed_min_mm: allowed_mm.0,
            allowed_max_mm: allowed_mm.1,
            accepted: u32::from(reason == Refused::Not),
            mode: self.mode() as u32,
            reason: reason as u32,
            hold: u32::from(self.modes.is_held()),
            override_percent: self.modes.override_percent(),
            run: self.program.run(),
            axis: cut.map_or(axis, |(axis, _)| axis),
            counts: by_order.counts,
            cut: u32::from(cut.is_some()),
            reserved: 0,
        }
    }

    fn order_stop(&mut self) -> Result<(), Refusal> {
        if self.mode() == Mode::Ready {
            self.auxiliary.end_program();
            self.program.end_typed_blocks();
        }
        if self.stop() || !self.modes.ends() {
            return Ok(());
        }
        Err(Refused::Finished.into())
    }

    /// Comes to rest, on the path or where a jog is: no further window is admitted. False where there is nothing to
    /// stop. A machine without drives is at rest, one that has tripped will be; their run may end.
    pub fn stop(&mut self) -> bool {
        match self.mode() {
            Mode::Enabled => {
                self.modes.enter(if self.windows.has_window() {
                    Mode::Stopping
                } else {
                    Mode::Stopped
                });
                true
            }
            Mode::Jogging => {
                self.rest_all_by_hand();
                self.modes.enter(Mode::Stopping);
                true
            }
            Mode::Disabled | Mode::Tripped => {
                self.switching_on.cancel();
                // A servo that comes back must not set off what was ordered to stop.
                self.modes.stop_standing();
                true
            }
            Mode::Stopping | Mode::Stopped | Mode::Ready => true,
            Mode::Finished => false,
        }
    }

    fn order_hold(&mut self) -> Result<(), Refusal> {
        match self.mode() {
            Mode::Tripped => Err(Refused::Tripped.into()),
            Mode::Finished => Err(Refused::Finished.into()),
            Mode::Jogging => {
                self.rest_all_by_hand();
                self.modes.hold(HoldReason::Order);
                Ok(())
            }
            Mode::Disabled | Mode::Enabled | Mode::Stopping | Mode::Stopped | Mode::Ready => {
                self.modes.hold(HoldReason::Order);
                Ok(())
            }
        }
    }

    fn order_resume(&mut self) -> Result<(), Refusal> {
        let outside = !self.axes.are_within_travel();
        self.signals_allow(true)?;
        match self.mode() {
            Mode::Enabled | Mode::Ready | Mode::Stopped | Mode::Tripped
                if !self.axes.are_homed() =>
            {
                return Err(Refused::NotReferenced.into());
            }
            Mode::Enabled | Mode::Ready | Mode::Stopped | Mode::Tripped if outside => {
                return Err(Refused::OutsideTravel.into());
            }
            Mode::Enabled => {}
            Mode::Ready if !self.modes.is_held() => return Err(Refused::NotRunning.into()),
            Mode::Ready => {}
            Mode::Stopped if !matches!(self.modes.cause(), Cause::None | Cause::ProbeJogged) => {
                return Err(Refused::Faulted.into());
            }
            Mode::Stopped => self.modes.enter(Mode::Enabled),
            Mode::Stopping => return Err(Refused::NotAtRest.into()),
            Mode::Jogging => return Err(Refused::Jogging.into()),
            Mode::Disabled => return Err(Refused::DrivesOff.into()),
            Mode::Tripped if self.waits_for_servo() => {
                self.acknowledge(false)?;
            }
            Mode::Tripped => return Err(Refused::Tripped.into()),
            Mode::Finished => return Err(Refused::Finished.into()),
        }
        self.forget_cause_of_jog();
        self.modes.release();
        self.auxiliary.end_stop();
        Ok(())
    }

    fn order_override(&mut self, percent: f64) -> Result<(), Refusal> {
        if self.modes.set_override(percent) {
            Ok(())
        } else {
            Err(Refused::BadValue.into())
        }
    }

    /// At rest in hold, or stopped: what an operator may do to the axes is allowed now.
    pub(super) fn must_rest(&self) -> Result<(), Refusal> {
        match self.mode() {
            Mode::Enabled if !self.modes.is_held() => return Err(Refused::NotHeld.into()),
            Mode::Enabled | Mode::Stopped | Mode::Ready => {}
            Mode::Stopping => return Err(Refused::NotAtRest.into()),
            Mode::Jogging => return Err(Refused::Jogging.into()),
            Mode::Disabled => return Err(Refused::DrivesOff.into()),
            Mode::Tripped => return Err(Refused::Tripped.into()),
            Mode::Finished => return Err(Refused::Finished.into()),
        }
        if !self.modes.has_rested() {
            return Err(Refused::NotAtRest.into());
        }
        Ok(())
    }

    /// Whether nothing but the hand would move an axis.
    pub(super) fn is_idle(&self) -> bool {
        matches!(self.mode(), Mode::Stopped | Mode::Ready)
    }

    fn order_disable(&mut self) -> Result<(), Refusal> {
        if self.mode() == Mode::Disabled {
            self.switching_on.cancel();
            return Ok(());
        }
        self.must_rest()?;
        self.windows.drop_all(self.scan, Dropped::LeavesPath);
        self.modes.disable();
        self.axes.iter_mut().for_each(AxisUnit::open_loop);
        Ok(())
    }

    /// Drives on, in hold: nothing moves before somebody resumes.
    fn order_enable(&mut self) -> Result<(), Refusal> {
        if self.drives_may().is_err() {
            self.drives.want_back();
        }
        match self.mode() {
            Mode::Enabled | Mode::Stopping | Mode::Stopped | Mode::Jogging | Mode::Ready => {
                return Ok(());
            }
            Mode::Tripped => return self.acknowledge(true),
            Mode::Finished => return Err(Refused::Finished.into()),
            Mode::Disabled => {}
        }
        self.drives_may()?;
        self.must_be_referenced()?;
        self.modes.keep();
        self.switch_on(true);
        Ok(())
    }

    /// Every drive knows where its axis is, or the axis can be homed.
    fn must_be_referenced(&self) -> Result<(), Refusal> {
        if self.axes.iter().any(AxisUnit::is_displaced) {
            return Err(Refused::Displaced.into());
        }
        if !self.axes.iter().all(AxisUnit::may_be_driven) {
            return Err(Refused::NotReferenced.into());
        }
        Ok(())
    }

    /// Ends a trip, if the machine can be driven again; its run does not end then.
    pub(super) fn acknowledge(&mut self, hold: bool) -> Result<(), Refusal> {
        if self.modes.is_last() || self.modes.may_end() {
            return Err(Refused::Finished.into());
        }
        self.drives_may()?;
        if !self.axes.are_served_at_rest() {
            return Err(Refused::NotReady.into());
        }
        // Whoever enables resets faults of drives, and has lost ones started again.
        if !hold && !self.axes.drives_can_follow() {
            return Err(Refused::NotReady.into());
        }
        self.must_be_referenced()?;
        self.modes.acknowledge();
        self.switch_on(hold);
        Ok(())
    }
}
