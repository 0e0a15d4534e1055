//! What a machine waits for that does not go on by itself: the orders that bring it on, in the order they are to be given in.

use bus::sample::{Cause, Feedback, HoldReason, Mode, Order, ProgramState, Reference};
use console::output::joined;
use machine::{AfterLoss, Restart};

/// What to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hint {
    /// How the machine stands, where that alone does not show.
    state: Option<&'static str>,
    /// Why it does.
    why: Option<&'static str>,
    /// One after the other.
    pub orders: &'static [Order],
    /// What follows.
    then: Option<&'static str>,
}

const RETURNS: &str = "returns to the path and goes on";
const OFF: Option<&str> = Some("the drives are off");

fn hint(
    state: Option<&'static str>,
    orders: &'static [Order],
    then: Option<&'static str>,
) -> Option<Hint> {
    Some(Hint {
        state,
        why: None,
        orders,
        then,
    })
}

impl Hint {
    /// For people; `ends` where the cell is a run that Ctrl-C ends.
    pub fn words(&self, cell: &str, ends: bool) -> String {
        let command = |order: &Order| {
            let word = match order {
                Order::Acknowledge => "alarms acknowledge",
                order => order.word(),
            };
            format!("`quadrant {word} --cell {cell}`")
        };
        let why = self
            .why
            .map_or(String::new(), |why| format!(" since {why}"));
        let mut words = self
            .state
            .map_or(String::new(), |state| format!("{state}{why}: "));
        words += &joined(self.orders.iter().map(command), ", then ");
        if let Some(then) = self.then {
            words += " ";
            words += then;
        }
        if ends {
            words += "; Ctrl-C ends the run";
        }
        words
    }
}

/// Whether the machine tripped because a process was lost that another one may replace.
fn lost_a_servo(feedback: &Feedback) -> bool {
    let cause = Cause::from_wire(feedback.cause);
    matches!(cause, Some(Cause::ServoLost | Cause::Watchdog))
}

/// Whether every axis knows its place.
fn is_homed(feedback: &Feedback) -> bool {
    let mut axes = feedback.axes().iter();
    axes.all(|axis| axis.reference == Reference::Known as u32)
}

/// What a run waits for that does not go on by itself; none where it does, or ends.
pub fn waits_for(feedback: &Feedback, restart: &Restart) -> Option<Hint> {
    let mode = Mode::from_wire(feedback.mode)?;
    let waits = restart.servo == AfterLoss::Wait && lost_a_servo(feedback);
    match mode {
        Mode::Tripped if waits => hint(None, &[Order::Resume], Some(RETURNS)),
        Mode::Disabled if feedback.program != ProgramState::Running as u32 => {
            hint(OFF, &[Order::Enable], None)
        }
        Mode::Disabled if feedback.has_axis(Reference::Displaced) => hint(
            Some("an axis came back elsewhere than its drive was lost, see where it is"),
            &[Order::Acknowledge, Order::Enable, Order::Resume],
            Some(RETURNS),
        ),
        Mode::Disabled => hint(OFF, &[Order::Enable, Order::Resume], None),
        Mode::Enabled if feedback.hold == 1 && !is_homed(feedback) => {
            let homed_first = Some("the machine is not homed");
            let orders = &[Order::Home, Order::Resume];
            hint(homed_first, orders, Some("begins the program"))
        }
        Mode::Enabled if feedback.hold == 1 => {
            let reason = HoldReason::from_wire(feedback.hold_reason).unwrap_or_default();
            let held = match reason {
                HoldReason::Signal => "the machine is in hold (`quadrant signal`)",
                HoldReason::Alarm => "the machine is in hold (`quadrant alarms`)",
                _ => "the machine is in hold",
            };
            let resume = hint(Some(held), &[Order::Resume], Some("goes on"))?;
            Some(Hint {
                why: reason.words(),
                ..resume
            })
        }
        _ => None,
    }
}

/// The same of a cell that stays up, where a process was lost; what an operator waits for he knows himself.
pub fn lost_in(feedback: &Feedback) -> Option<Hint> {
    let started = feedback.program == ProgramState::Running as u32;
    let (servo, master) = (
        lost_a_servo(feedback),
        feedback.cause == Cause::MasterLost as u32,
    );
    match Mode::from_wire(feedback.mode)? {
        Mode::Tripped if servo && started => hint(None, &[Order::Resume], Some(RETURNS)),
        Mode::Disabled if master && started => {
            hint(OFF, &[Order::Enable, Order::Resume], Some(RETURNS))
        }
        Mode::Tripped if servo => hint(None, &[Order::Enable], Some("makes it ready")),
        Mode::Disabled if master => hint(None, &[Order::Enable], Some("makes it ready")),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn feedback(mode: Mode, cause: Cause) -> Feedback {
        Feedback {
            mode: mode as u32,
            cause: cause as u32,
            program: ProgramState::Running as u32,
            ..Feedback::zeroed()
        }
    }

    fn restart(servo: AfterLoss) -> Restart {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let machine = machine::Machine::load(&folder).expect("machine.toml");
        Restart {
            servo,
            ..machine.restart
        }
    }

    #[test]
    fn a_run_that_waits_says_what_it_waits_for() {
        let waits = restart(AfterLoss::Wait);
        let words = |feedback: &Feedback| waits_for(feedback, &waits).map(|h| h.words("c", true));
        assert_eq!(
            words(&feedback(Mode::Tripped, Cause::ServoLost)).as_deref(),
            Some("`quadrant resume --cell c` returns to the path and goes on; Ctrl-C ends the run")
        );
        assert_eq!(
            words(&feedback(Mode::Disabled, Cause::MasterLost)).as_deref(),
            Some(
                "the drives are off: `quadrant enable --cell c`, then `quadrant resume --cell c`; Ctrl-C ends the run"
            )
        );
        let mut displaced = feedback(Mode::Disabled, Cause::Displaced);
        displaced.axis_count = 2;
        displaced.axes[1].reference = Reference::Displaced as u32;
        let hint = words(&displaced).expect("a hint");
        assert!(
            hint.contains("`quadrant alarms acknowledge --cell c`, then `quadrant enable"),
            "{hint}"
        );
        let held = Feedback {
            hold: 1,
            ..feedback(Mode::Enabled, Cause::None)
        };
        assert_eq!(
            words(&held).as_deref(),
            Some("the machine is in hold: `quadrant resume --cell c` goes on; Ctrl-C ends the run")
        );
        let mut not_homed = held;
        not_homed.axis_count = 2;
        not_homed.axes[1].reference = Reference::Missing as u32;
        assert_eq!(
            words(&not_homed).as_deref(),
            Some(
                "the machine is not homed: `quadrant home --cell c`, then `quadrant resume --cell c` begins the program; Ctrl-C ends the run"
            )
        );
        let after_master = feedback(Mode::Disabled, Cause::MasterLost);
        assert_eq!(
            lost_in(&after_master)
                .map(|h| h.words("c", false))
                .as_deref(),
            Some(
                "the drives are off: `quadrant enable --cell c`, then `quadrant resume --cell c` returns to the path and goes on"
            )
        );
    }

    /// Such a run ends: the master refuses to resume it.
    #[test]
    fn a_trip_that_nobody_can_resume_is_not_said_to_wait_for_it() {
        let waits = restart(AfterLoss::Wait);
        for cause in [Cause::FollowingError, Cause::BadValue, Cause::NotInPosition] {
            let tripped = feedback(Mode::Tripped, cause);
            assert_eq!(waits_for(&tripped, &waits), None, "{cause:?}");
        }
    }

    #[test]
    fn what_goes_on_by_itself_waits_for_nothing() {
        let lost = feedback(Mode::Tripped, Cause::ServoLost);
        assert_eq!(waits_for(&lost, &restart(AfterLoss::Resume)), None);
        let runs = feedback(Mode::Enabled, Cause::None);
        assert_eq!(waits_for(&runs, &restart(AfterLoss::Wait)), None);
    }
}
