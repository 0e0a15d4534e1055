//! A model as messages for another machine, and a model filled from them. Pure.

use remote::state::{CellState, LinkState};
use remote::wire::{CircleReport, FORMAT, OVERRIDE_MAX_PERCENT, REVERSALS_MAX, Snapshot};

use super::model::Model;
use super::state::tell;
use super::words::{Says, Tone};

/// A model as a snapshot; sequence, time and events' count are the server's.
pub fn snapshot(model: &Model, session: u64) -> Snapshot {
    let (state, last) = (&model.shown.state, &model.reversals.last);
    let skip = last.len().saturating_sub(REVERSALS_MAX);
    Snapshot {
        format: FORMAT,
        session,
        sequence: 0,
        heard_us: 0,
        state: CellState {
            // A word that makes no sense must not keep the rest from being believed.
            override_percent: state
                .override_percent
                .map(|of| of.min(OVERRIDE_MAX_PERCENT)),
            ..state.clone()
        },
        reversals_count: model.reversals.count,
        reversals: last.iter().skip(skip).copied().collect(),
        angle_rad: model.circle.angle_rad,
        timing: model.shown.timing.clone(),
        events_count: 0,
        scans_seen: model.seen_scans.0,
        scans_not_seen: model.seen_scans.1,
    }
}

/// The circle of a model as a message; none before the first arc.
pub fn circle(model: &Model, session: u64) -> Option<CircleReport> {
    let circle = model.shown.circle.clone()?;
    Some(CircleReport {
        format: FORMAT,
        session,
        circle,
    })
}

/// Fills a model with a snapshot; false if it is of another machine.
pub fn fill(model: &mut Model, message: Snapshot) -> bool {
    let of_axes = &message.state.axes;
    if of_axes.len() != model.axes.len() {
        return false;
    }
    for (axis, state) in model.axes.iter_mut().zip(of_axes) {
        if let Some(um) = state.following_error_look_um {
            axis.peaked(um);
        }
    }
    model.ended = message.state.ended;
    model.seen_scans = (message.scans_seen, message.scans_not_seen);
    model.reversals.last = message.reversals.into();
    model.reversals.count = message.reversals_count;
    if let Some(circle) = &mut model.shown.circle {
        circle.angle_rad = message.angle_rad;
    }
    model.shown.timing = message.timing;
    model.shown.state = message.state;
    true
}

/// Says of a state that is new where its orders are given.
pub fn from_afar(state: &mut CellState) {
    state.next = format!("on the controller PC: {}", state.next);
}

/// Says what is known of the link; a lost one in place of the cell's state.
pub fn tell_link(state: &mut CellState, link: &LinkState) {
    state.remote = Some(link.clone());
    if link.link_lost {
        let detail = format!("link lost for {:.1} s: what is shown is old", link.silent_s);
        let next = "the machine goes on; this view comes back by itself";
        tell(state, Says::new("✖", "NO LINK", Tone::Bad, &detail, next));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::json::{self, Reported};
    use crate::live::test_support::{look, machine, running, take_spoilt};
    use crate::spoilt::{self, Spoiler};
    use bus::sample::{
        AxisCommand, Cause, FLOOD, Inputs, Job, Mode, Participant, PlannerStatus, Roster,
        SpindleCommand, Waiting,
    };
    use bytemuck::Zeroable;
    use remote::state::{CircleState, ReversalState};

    /// Spindle, coolant, outputs and tool, each with something to show.
    fn busy(auxiliary: &mut bus::sample::Auxiliaries) {
        let levels = &mut auxiliary.levels;
        levels.spindle = SpindleCommand::Turn as u32;
        levels.spindle_rpm = -3000.0;
        levels.coolant = FLOOD;
        levels.digital = 1 << 7 | 1 << 63;
        levels.analog[2] = 0.25;
        (levels.tool, levels.tool_prepared) = (4, 5);
        auxiliary.spindle_rpm = -1200.0;
        auxiliary.waiting = Waiting::SpindleSpeed as u32;
        auxiliary.line = 12;
        auxiliary.tool = 4;
        auxiliary.events_done = 9;
        auxiliary.optional_stop = 1;
        auxiliary.override_disabled = 1;
    }

    /// Two axes in motion, a servo of which has died.
    fn seen() -> Model {
        let mut model = Model::new("mill-3", machine());
        let mut roster = Roster::zeroed();
        for (place, job) in [Job::Servo, Job::Planner].into_iter().enumerate() {
            roster.participants[place] = Participant {
                death_scan: if place == 0 { 90 } else { u64::MAX },
                death_signal: if place == 0 { 9 } else { 0 },
                job: job as u32,
                incarnation: 2,
                live: place as u32,
                ..Participant::default()
            };
        }
        model.roster(&roster);
        for scan in 100..110u64 {
            let mut feedback = running(scan);
            feedback.axes[0].command_position = 1_250_000;
            feedback.axes[0].velocity_mm_s = 49.5;
            feedback.axes[1].torque_nm = 0.5;
            feedback.program = 3;
            feedback.run = 2;
            busy(&mut feedback.auxiliary);
            feedback.inputs.panel = Inputs::panel(true, (50, 150));
            if scan == 109 {
                feedback.mode = Mode::Tripped as u32;
                feedback.cause = Cause::FollowingError as u32;
                feedback.cause_axis = 1;
                feedback.cause_scan = 108;
            }
            model.feedback(&feedback);
            for axis in 0..2 {
                model.command(&AxisCommand {
                    scan,
                    axis,
                    velocity_mm_s: 50.0,
                    following_error_mm: if scan == 104 { -0.02 } else { 0.001 },
                    ..AxisCommand::zeroed()
                });
            }
        }
        model.planner = Some(PlannerStatus {
            path_done_mm: 1.0,
            path_length_mm: 4.0,
            ..PlannerStatus::default()
        });
        model.reversals.count = 40;
        model.reversals.last.push_back(ReversalState {
            axis: 1,
            direction: -1,
            scan: 105,
            height_um: Some(1.5),
            undercut_um: Some(-0.25),
            error_peak_um: 3.0,
        });
        model.timing.take(1_000_000);
        model.end_of_look();
        look(&mut model);
        model.shown.circle = Some(CircleState {
            plane: "XY".into(),
            radius_mm: 25.0,
            deviation_um: vec![Some([-0.5, 1.0, 2.25]); 360],
            ..CircleState::default()
        });
        model
    }

    #[test]
    fn the_picture_on_another_machine_says_the_same_as_on_the_spot() {
        let here = seen();
        let mut there = Model::new("mill-3", machine());
        let message = snapshot(&here, 5);
        let message = remote::wire::decode(&remote::wire::encode(&message).expect("message"));
        there.shown.circle = Some(circle(&here, 5).expect("one").circle);
        assert!(fill(&mut there, message.expect("believed")));
        there.end_of_look();
        assert_eq!(json::status(&there), json::status(&here));
        // Reversals and events come by their own numbers.
        let line = |model: &Model| -> serde_json::Value {
            let mut line: serde_json::Value =
                serde_json::from_str(&json::line(model, &mut Reported::default())).expect("JSON");
            line["events"] = serde_json::Value::Null;
            line
        };
        assert_eq!(line(&there), line(&here));
        let history = |model: &Model| model.axes[0].error_history_um.back().copied();
        let (seen_um, told_um) = (history(&here), history(&there));
        assert!((seen_um.expect("µm") - told_um.expect("µm")).abs() < 1e-3);
    }

    /// Values gone wild are what somebody wants to look at.
    #[test]
    fn a_machine_that_says_nonsense_can_still_be_seen() {
        let mut here = seen();
        let mut wild = running(111);
        wild.cause_axis = 77;
        wild.override_percent = 4_000_000_000;
        wild.tag.distance_mm = f64::NAN;
        wild.axes[0].torque_nm = 1e200;
        wild.axes[1].velocity_mm_s = f64::NEG_INFINITY;
        wild.auxiliary.levels.analog[0] = f64::INFINITY;
        wild.auxiliary.spindle_rpm = 1e300;
        here.feedback(&wild);
        here.axes[0].error_um = Some(1e40);
        here.planner.as_mut().expect("one").path_done_mm = f64::NAN;
        look(&mut here);
        let message = remote::wire::encode(&snapshot(&here, 5)).expect("it can be message");
        let message: Snapshot = remote::wire::decode(&message).expect("believed");
        assert!(message.state.axes[0].torque_nm.is_nan());
        assert_eq!(message.state.axes[0].following_error_um, None);
        assert_eq!(message.state.override_percent, Some(OVERRIDE_MAX_PERCENT));
    }

    /// SPOILT_SAMPLES=1000000 takes some 15 s.
    #[test]
    fn no_number_of_any_sample_keeps_a_machine_from_being_seen() {
        let (mut here, mut there) = (seen(), Model::new("mill-3", machine()));
        let mut spoiler = Spoiler::new();
        for number in 0..spoilt::count(20_000) {
            take_spoilt(&mut here, number, &mut spoiler);
            if number % 50 == 0 {
                here.end_of_look();
                look(&mut here);
                let message = remote::wire::encode(&snapshot(&here, 5)).expect("a message");
                // As it comes to another machine, where it is refused or shown.
                if let Ok(message) = remote::wire::decode(&message) {
                    fill(&mut there, message);
                    there.end_of_look();
                }
                for model in [&here, &there] {
                    let line = json::line(model, &mut Reported::default());
                    let shown: Result<serde_json::Value, _> = serde_json::from_str(&line);
                    assert!(shown.is_ok(), "{line}");
                }
            }
        }
    }

    #[test]
    fn a_snapshot_of_another_machine_changes_nothing() {
        let mut there = Model::new("mill-3", machine());
        let mut message = snapshot(&seen(), 5);
        message.state.axes.pop();
        assert!(!fill(&mut there, message));
        assert_eq!(there.shown.state.scan, None);
    }
}
