//! The state of a cell in plain words, with what can be done next.

use bus::sample::{
    Auxiliaries, AxisFeedback, Cause, Driver, Feedback, HoldReason, Mode, ProgramState, Reference,
    Waiting,
};
use console::exit::Failure;
use console::output::joined;
use machine::Machine;
use monitor::words::StopCause;
use remote::state::StateWords;
pub use remote::state::Tone;

/// What can be done while it runs.
const WHILE_IT_RUNS: &str = "`quadrant hold`, `quadrant stop`";
/// What can be done in a hold.
const IN_HOLD: &str = "`quadrant resume` goes on";

/// A state, reported.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Says {
    /// Its words.
    pub words: StateWords,
    /// What can be done, or what comes by itself.
    pub next: String,
}

/// Why the machine stopped, with axis and scan; none if nothing did.
pub fn cause(feedback: &Feedback, machine: &Machine) -> Option<String> {
    let cause = StopCause::if_any(machine, feedback)?;
    Some(format!("{cause}, in scan {}", feedback.cause_scan))
}

/// Whether the command rests: that of the program, and what moves axes beside it.
pub fn at_rest(feedback: &Feedback) -> bool {
    let moved = feedback.axes().iter().any(is_moved_by_hand);
    (feedback.at_rest == 1 || feedback.window.is_none()) && !moved
}

/// Whether a controller beside the program moves this axis: in a jog, when homing, on the return to the path.
fn is_moved_by_hand(axis: &AxisFeedback) -> bool {
    match Driver::from_wire(axis.driver) {
        None | Some(Driver::Program) => false,
        Some(Driver::Manual) => !operator::course(axis).rests(),
        Some(_) => true,
    }
}

/// Whether axes are where a jog left them, or where a return to the path was stopped.
fn is_beside_path(feedback: &Feedback) -> bool {
    let by_program = |axis: &AxisFeedback| Driver::from_wire(axis.driver) == Some(Driver::Program);
    feedback.tag.is_off_path() || !feedback.axes().iter().all(by_program)
}

impl Says {
    /// In these words.
    pub fn new(symbol: &str, state: &str, tone: Tone, detail: &str, next: &str) -> Says {
        let words = StateWords {
            symbol: symbol.into(),
            state: state.into(),
            detail: detail.into(),
            tone,
        };
        let next = next.into();
        Says { words, next }
    }
}

/// What a command that cannot be obeyed says, in words.
pub fn failure_words(failure: &Failure) -> String {
    match failure {
        Failure::Stopped(error) | Failure::Input(error) | Failure::Environment(error) => {
            console::exit::words(error)
        }
        Failure::Interrupted => "interrupted".into(),
    }
}

/// The state of this feedback.
pub fn says(feedback: &Feedback, machine: &Machine) -> Says {
    let cause = cause(feedback, machine);
    let cause = cause.as_deref();
    let Some(mode) = Mode::from_wire(feedback.mode) else {
        let next = "the cell is of another version of quadrant";
        return Says::new("?", "UNKNOWN", Tone::Bad, "an unknown mode", next);
    };
    match mode {
        Mode::Enabled => enabled(feedback, machine),
        Mode::Stopping => {
            let detail = cause.unwrap_or("reported to stop");
            let next = "comes to rest on the path by itself";
            Says::new("■", "STOPPING", bad_with(cause), detail, next)
        }
        Mode::Stopped => stopped(feedback, cause),
        Mode::Tripped => {
            // Which of the two, the policy says; a fault script may have changed it.
            let next = if feedback.cause == Cause::ServoLost as u32 {
                "`quadrant resume`, or `enable` and then `resume`, as soon as the servo is back"
            } else {
                "the drives have braked; when all stands: `quadrant enable`, then `resume`"
            };
            let detail = cause.unwrap_or("a fault");
            Says::new("✖", "TRIPPED", Tone::Bad, detail, next)
        }
        Mode::Disabled => disabled(feedback, cause),
        Mode::Finished => {
            let detail = "program done, in position";
            let next = "nothing to do: it goes on by itself";
            Says::new("✔", "FINISHED", Tone::Good, detail, next)
        }
        Mode::Ready => {
            not_homed(feedback, machine, cause).unwrap_or_else(|| ready(feedback, cause))
        }
        Mode::Jogging => jogging(feedback, machine),
    }
}

fn jogging(feedback: &Feedback, machine: &Machine) -> Says {
    let next = "h brings it to rest";
    match axes_that_are(Reference::Searching, feedback, machine) {
        Some(axes) => {
            let detail = format!("axis {axes} is being homed");
            Says::new("⌂", "HOMING", Tone::Waits, &detail, next)
        }
        None if feedback.inputs.jog_override_percent() == 0 => {
            let detail = "stands: the override of jogs is at 0 %";
            let next = "`quadrant jog-override 100` goes on; h ends it";
            Says::new("‖", "JOGGING", Tone::Waits, detail, next)
        }
        None => {
            let detail = "an axis is moved by hand";
            Says::new("↔", "JOGGING", Tone::Waits, detail, next)
        }
    }
}

/// The axes of which this is true, in words; none where it is true of none.
fn axes_that_are(state: Reference, feedback: &Feedback, machine: &Machine) -> Option<String> {
    let axes = feedback.axes().iter().zip(&machine.axes);
    let axes =
        axes.filter(|(axis, settings)| axis.reference == state as u32 && settings.homing.is_some());
    let names = joined(axes.map(|(_, settings)| &settings.name), " ");
    (!names.is_empty()).then_some(names)
}

/// A machine with its drives on that waits to be homed.
fn not_homed(feedback: &Feedback, machine: &Machine, cause: Option<&str>) -> Option<Says> {
    let axes = axes_that_are(Reference::Missing, feedback, machine)?;
    let detail = format!("not homed: {axes}");
    let next = format!("`quadrant home` homes all, `quadrant home {axes}` these");
    let detail = cause.map_or(detail.clone(), |cause| format!("{cause}; {detail}"));
    Some(Says::new("⌂", "NOT HOMED", bad_with(cause), &detail, &next))
}

/// The tone of a state that has a cause, or waits for somebody.
fn bad_with(cause: Option<&str>) -> Tone {
    if cause.is_some() {
        Tone::Bad
    } else {
        Tone::Waits
    }
}

fn stopped(feedback: &Feedback, cause: Option<&str>) -> Says {
    let detail = cause.unwrap_or(match is_beside_path(feedback) {
        true => "at rest beside the path, drives on",
        false => "at rest on the path, drives on",
    });
    let next = if cause.is_some() && feedback.load > 0 {
        "cannot go on: look into the cause, `quadrant reset`, then start again"
    } else if cause.is_some() {
        "cannot go on: end the run, look into the cause, start again"
    } else if feedback.load > 0 {
        "`quadrant resume` goes on; `load` gives the program up"
    } else {
        "`quadrant resume` goes on; a `quadrant run` ends 0.1 s after a stop"
    };
    Says::new("■", "STOPPED", bad_with(cause), detail, next)
}

fn disabled(feedback: &Feedback, cause: Option<&str>) -> Says {
    let detail = cause.unwrap_or("positions follow the axes");
    let next = match ProgramState::from_wire(feedback.program) {
        _ if feedback.has_axis(Reference::Displaced) => {
            "see where the axis is; `quadrant alarms acknowledge`, then `enable`"
        }
        Some(ProgramState::Running) => "`quadrant enable`, then `resume`",
        Some(ProgramState::None) => "`quadrant enable`; `quadrant load PROGRAM`; `quadrant start`",
        _ => "`quadrant enable`; `quadrant start`",
    };
    Says::new("○", "DRIVES OFF", bad_with(cause), detail, next)
}

fn ready(feedback: &Feedback, cause: Option<&str>) -> Says {
    let (detail, next) = match ProgramState::from_wire(feedback.program) {
        Some(ProgramState::Loading) => ("the planner reads the program", "wait a moment"),
        Some(ProgramState::Loaded) => ("a program is loaded", "`quadrant start` begins it"),
        Some(ProgramState::Done) => (
            "the program is done, in position",
            "`quadrant start` runs it again, `quadrant load` brings another",
        ),
        _ => ("no program is loaded", "`quadrant load PROGRAM`"),
    };
    Says::new("●", "READY", Tone::Good, cause.unwrap_or(detail), next)
}

/// A machine that waits for its operator because the program says so.
fn program_stop(auxiliary: &Auxiliaries) -> Option<Says> {
    let waiting = Waiting::from_wire(auxiliary.waiting).filter(|w| w.is_for_operator())?;
    let (state, next) = match waiting {
        Waiting::ToolByOperator => ("TOOL CHANGE", "put the tool in, then `quadrant resume`"),
        Waiting::PalletStop => ("PALLET CHANGE", "change the pallet, then `quadrant resume`"),
        Waiting::SingleBlock => (
            "BLOCK DONE",
            "`quadrant resume` runs the next block; `quadrant single-block off` before it: all",
        ),
        _ => ("PROGRAM STOP", IN_HOLD),
    };
    let detail = monitor::words::waiting(auxiliary).unwrap_or_default();
    let detail = format!("waits for {detail}");
    Some(Says::new("‖", state, Tone::Waits, &detail, next))
}

fn enabled(feedback: &Feedback, machine: &Machine) -> Says {
    let waiting = monitor::words::waiting(&feedback.auxiliary);
    if let Some(stop) = program_stop(&feedback.auxiliary).filter(|_| feedback.hold == 1) {
        return stop;
    }
    if let Some(waiting) = waiting.filter(|_| feedback.hold == 0 && at_rest(feedback)) {
        let detail = format!("for {waiting}");
        let next = "goes on by itself; `quadrant hold`, `quadrant stop`";
        return Says::new("…", "WAITS", Tone::Waits, &detail, next);
    }
    let homed_first = not_homed(feedback, machine, cause(feedback, machine).as_deref());
    if let Some(says) = homed_first.filter(|_| feedback.hold == 1) {
        return says;
    }
    let (symbol, state, tone, detail, next) = if feedback.hold == 1 && at_rest(feedback) {
        let reason = HoldReason::from_wire(feedback.hold_reason).unwrap_or_default();
        let detail = reason
            .words()
            .map_or("at rest".into(), |why| format!("at rest: {why}"));
        let next = match reason {
            HoldReason::Door => "once it is closed, `quadrant resume` goes on",
            HoldReason::Signal => "once it is on, `quadrant resume` goes on",
            HoldReason::Alarm => "`quadrant alarms` says what to do; then `quadrant resume`",
            _ => "`quadrant resume` goes on; an axis may be moved now (`jog X 5`)",
        };
        ("‖", "IN HOLD", Tone::Waits, detail, next)
    } else if feedback.hold == 1 {
        let detail = "comes to rest on the path".to_string();
        ("‖", "HOLDING", Tone::Waits, detail, IN_HOLD)
    } else if feedback.override_percent == 0 {
        let detail = "stands: the override is at 0 %".to_string();
        let next = "`quadrant override 100` goes on";
        ("‖", "STANDS", Tone::Waits, detail, next)
    } else if at_rest(feedback) && feedback.inputs.rapid_override_percent() == 0 {
        let detail = "stands before a rapid: their override is at 0 %".to_string();
        let next = "`quadrant rapid-override 100` goes on";
        ("‖", "STANDS", Tone::Waits, detail, next)
    } else if feedback.auxiliary.start_line != 0 && feedback.interrupted_at.is_off_path() {
        let detail = format!("looks for line {}", feedback.auxiliary.start_line);
        let next = "sets what stands before it, and goes there";
        ("…", "WAITS", Tone::Waits, detail, next)
    } else if feedback.window.is_none() || feedback.at_rest == 1 {
        let detail = "at rest: the planner has sent nothing to go on with".to_string();
        let next = "goes on by itself with the planner's next window";
        ("…", "WAITS", Tone::Waits, detail, next)
    } else if feedback.tag.is_off_path() && feedback.auxiliary.start_line != 0 {
        let line = feedback.auxiliary.start_line;
        let detail = format!("goes to where line {line} begins");
        ("▶", "APPROACHES", Tone::Good, detail, WHILE_IT_RUNS)
    } else if feedback.tag.is_off_path() {
        let detail = "returns to where the path was left".to_string();
        ("▶", "RETURNS", Tone::Good, detail, WHILE_IT_RUNS)
    } else if feedback.tag.dwell_remaining_scans > 0 {
        let left_s = f64::from(feedback.tag.dwell_remaining_scans) * machine.scan_period_s();
        let detail = format!("dwell (G4), {left_s:.1} s left");
        ("▶", "RUNS", Tone::Good, detail, WHILE_IT_RUNS)
    } else {
        let detail = "on the program's path".to_string();
        ("▶", "RUNS", Tone::Good, detail, WHILE_IT_RUNS)
    };
    Says::new(symbol, state, tone, &detail, next)
}

#[cfg(test)]
mod tests {
    use bus::sample::PathTag;

    use super::*;
    use crate::live::test_support::{machine, running};

    #[test]
    fn every_mode_has_a_word_a_symbol_and_says_what_comes_next() {
        let machine = machine();
        let mut seen = Vec::new();
        for mode in 0..=8 {
            for hold in [0, 1] {
                let mut feedback = running(10);
                feedback.mode = mode;
                feedback.hold = hold;
                let says = says(&feedback, &machine);
                assert!(
                    !says.words.symbol.is_empty() && !says.words.detail.is_empty(),
                    "{says:?}"
                );
                assert!(!says.next.is_empty(), "{says:?}");
                seen.push(says.words.state.clone());
            }
        }
        let words = [
            "RUNS",
            "HOLDING",
            "STOPPED",
            "TRIPPED",
            "FINISHED",
            "DRIVES OFF",
        ];
        assert!(
            words
                .iter()
                .all(|word| seen.iter().any(|state| state == word)),
            "{seen:?}"
        );
    }

    #[test]
    fn a_stop_beside_the_path_and_an_axis_that_is_jogged_are_said_to_be_what_they_are() {
        let machine = machine();
        let mut feedback = running(10);
        feedback.mode = Mode::Stopped as u32;
        feedback.at_rest = 1;
        let detail = |feedback: &Feedback| says(feedback, &machine).words.detail;
        assert!(detail(&feedback).contains("at rest on the path"));
        let returning = Feedback {
            tag: PathTag::OFF_PATH,
            ..feedback
        };
        assert!(detail(&returning).contains("at rest beside the path"));
        assert!(at_rest(&feedback));
        feedback.axes[1].driver = Driver::Manual as u32;
        feedback.axes[1].hand.goal = 5;
        assert!(!at_rest(&feedback));
        feedback.axes[1].hand.goal = 0;
        assert!(at_rest(&feedback));
        assert!(detail(&feedback).contains("at rest beside the path"));
    }

    #[test]
    fn what_the_program_waits_for_is_said_with_its_line() {
        let machine = machine();
        let mut feedback = running(10);
        feedback.at_rest = 1;
        feedback.auxiliary.waiting = Waiting::SpindleSpeed as u32;
        feedback.auxiliary.line = 12;
        feedback.auxiliary.levels.spindle_rpm = 3000.0;
        feedback.auxiliary.spindle_rpm = 1200.0;
        let waits = says(&feedback, &machine);
        assert_eq!(waits.words.state, "WAITS");
        assert!(
            waits.words.detail.contains("1200 of 3000 rev/min, line 12"),
            "{waits:?}"
        );
        feedback.hold = 1;
        feedback.auxiliary.waiting = Waiting::ProgramStop as u32;
        let stop = says(&feedback, &machine);
        assert_eq!(
            (stop.words.state.as_str(), stop.next.as_str()),
            ("PROGRAM STOP", IN_HOLD)
        );
        feedback.auxiliary.waiting = Waiting::ToolByOperator as u32;
        feedback.auxiliary.levels.tool = 4;
        let tool = says(&feedback, &machine);
        assert!(tool.words.detail.contains("tool 4, line 12"), "{tool:?}");
    }

    #[test]
    fn a_trip_is_reported_with_its_axis_and_the_way_out_of_it() {
        let machine = machine();
        let mut feedback = running(10);
        feedback.mode = Mode::Tripped as u32;
        feedback.cause = Cause::ServoLost as u32;
        feedback.cause_axis = 1;
        assert!(
            says(&feedback, &machine)
                .next
                .starts_with("`quadrant resume`, or `enable`")
        );
        feedback.cause = Cause::FollowingError as u32;
        let message = says(&feedback, &machine);
        assert!(message.next.contains("quadrant enable"));
        assert!(message.words.detail.contains("axis Y: following error"));
    }
}
