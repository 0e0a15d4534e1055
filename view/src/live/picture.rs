//! A model as messages for another machine, and a model filled from them. Pure.

use bus::member::Pace;
use bus::sample::{Auxiliaries, Feedback, Inputs, Job, Levels, PathTag, PlannerStatus, WindowId};
use bytemuck::Zeroable;
use remote::wire::{
    AuxiliaryState, AxisState, CIRCLE_BINS, CircleState, FORMAT, MachineState,
    OVERRIDE_MAX_PERCENT, ProcessState, ProgramState, REVERSALS_MAX, ReversalState, Snapshot,
    TimingState, plain_text, plausible,
};

use super::axis::AxisView;
use super::circle::{Bin, Circle};
use super::model::{Model, ReportedView};
use super::timing::Summary;

/// A model as a snapshot; sequence, clock and events' count are the server's.
pub fn snapshot(model: &Model, session: u64) -> Snapshot {
    let status = model.planner.as_ref();
    let block = model.block();
    Snapshot {
        format: FORMAT,
        session,
        sequence: 0,
        made_us: 0,
        feedback_age_us: (model.feedback_age_s * 1e6) as u64,
        pace: model.pace.map(|pace| pace.word().into()),
        ended: model.ended,
        machine: model
            .feedback
            .as_ref()
            .map(|feedback| machine_state(feedback, model.axes.len())),
        axes: model.axes.iter().map(axis_state).collect(),
        program: ProgramState {
            name: model.program_name().map(plain_text),
            line: block.map(|(line, _)| line),
            block: block.map(|(_, text)| plain_text(text)),
            path_done_mm: plausible(status.map(|status| status.path_done_mm)),
            path_length_mm: plausible(status.map(|status| status.path_length_mm)),
        },
        processes: model.processes().into_iter().map(process_state).collect(),
        reversals_count: model.reversals.count,
        reversals: {
            let last = &model.reversals.last;
            let skip = last.len().saturating_sub(REVERSALS_MAX);
            last.iter().skip(skip).map(reversal_state).collect()
        },
        angle_rad: plausible(model.circle.angle_rad),
        timing: model.timing.summary().map(|summary| TimingState {
            count: summary.count,
            p50_us: summary.p50_us,
            p99_us: summary.p99_us,
            max_us: summary.max_us,
            bars: model.timing.bars.to_vec(),
        }),
        events_count: 0,
        scans_seen: model.seen_scans.0,
        scans_not_seen: model.seen_scans.1,
    }
}

/// A word that makes no sense is made one that does: it must not keep the rest from being believed.
fn machine_state(feedback: &Feedback, axes: usize) -> MachineState {
    let cause_axis = feedback.cause_axis;
    let known = (cause_axis as usize) < axes;
    MachineState {
        scan: feedback.scan,
        mode: feedback.mode,
        cause: feedback.cause,
        cause_axis: if known { cause_axis } else { u32::MAX },
        cause_scan: feedback.cause_scan,
        override_percent: feedback.override_percent.min(OVERRIDE_MAX_PERCENT as u32),
        panel: feedback.inputs.panel,
        overrun_scans: feedback.overrun_scans,
        incarnation: feedback.incarnation,
        hold: feedback.hold == 1,
        at_rest: feedback.at_rest == 1,
        program: feedback.program,
        run: feedback.run,
        last: feedback.last == 1,
        window: !feedback.window.is_none(),
        element: feedback.tag.element,
        distance_mm: feedback.tag.distance_mm,
        dwell_remaining_scans: feedback.tag.dwell_remaining_scans,
        interrupted_at_element: feedback.interrupted_at.element,
        auxiliary: auxiliary_state(&feedback.auxiliary),
    }
}

fn auxiliary_state(now: &Auxiliaries) -> AuxiliaryState {
    let levels = &now.levels;
    AuxiliaryState {
        spindle_command_rpm: levels.spindle_rpm,
        orientation_deg: levels.orientation_deg,
        spindle_rpm: now.spindle_rpm,
        spindle: levels.spindle,
        coolant: levels.coolant,
        digital: levels.digital,
        analog: levels.analog.map(|value| plausible(Some(value))).to_vec(),
        tool_wanted: levels.tool,
        tool_prepared: levels.tool_prepared,
        tool: now.tool,
        events_done: now.events_done,
        waiting: now.waiting,
        line: now.line,
        coupled: now.coupled,
        at_speed: now.at_speed == 1,
        optional_stop: now.optional_stop == 1,
        override_disabled: now.override_disabled == 1,
    }
}

fn axis_state(axis: &AxisView) -> AxisState {
    AxisState {
        error_um: plausible(axis.now.error_um),
        error_peak_since_um: plausible(axis.look_peak_um),
        ..axis.now.clone()
    }
}

fn process_state(process: ProcessState) -> ProcessState {
    ProcessState {
        name: plain_text(&process.name),
        ..process
    }
}

fn reversal_state(reversal: &ReversalState) -> ReversalState {
    ReversalState {
        height_um: plausible(reversal.height_um),
        undercut_um: plausible(reversal.undercut_um),
        ..*reversal
    }
}

/// The circle of a model as a message; none before the first arc.
pub fn circle(model: &Model, session: u64) -> Option<CircleState> {
    let view = &model.circle;
    let shape = view.circle.as_ref()?;
    let nm = |um: f64| (um * 1e3).round() as i64;
    let bins = view.deviation.iter().map(|bin| {
        let message = |bin: &Bin| (nm(bin.mean_um), nm(bin.low_um), nm(bin.high_um));
        bin.as_ref().map(message)
    });
    let mut deviation_nm: Vec<_> = bins.collect();
    deviation_nm.resize(CIRCLE_BINS, None);
    Some(CircleState {
        format: FORMAT,
        session,
        plane: shape.plane.clone(),
        radius_mm: shape.radius_mm,
        feed_mm_s: plausible(shape.feed_mm_s),
        line: shape.line,
        running: view.running,
        deviation_nm,
    })
}

/// Fills a model with a snapshot; false if it is of another machine.
pub fn fill(model: &mut Model, message: &Snapshot) -> bool {
    if message.axes.len() != model.axes.len() {
        return false;
    }
    model.pace = message
        .pace
        .as_deref()
        .and_then(|pace| pace.parse::<Pace>().ok());
    model.ended = message.ended;
    model.feedback_age_s = message.feedback_age_us as f64 * 1e-6;
    model.seen_scans = (message.scans_seen, message.scans_not_seen);
    let axis_count = message.axes.len() as u32;
    model.feedback = message
        .machine
        .as_ref()
        .map(|state| feedback(state, axis_count));
    for (axis, state) in model.axes.iter_mut().zip(&message.axes) {
        axis.reported(state);
    }
    let program = &message.program;
    let lengths = program.path_done_mm.zip(program.path_length_mm);
    model.planner = lengths.map(|(path_done_mm, path_length_mm)| PlannerStatus {
        path_done_mm,
        path_length_mm,
        ..PlannerStatus::default()
    });
    model.reported = Some(ReportedView {
        program_name: program.name.clone(),
        block: program.line.zip(program.block.clone()),
        processes: message.processes.iter().map(process_view).collect(),
    });
    model.reversals.last = message.reversals.iter().copied().collect();
    model.reversals.count = message.reversals_count;
    model.circle.angle_rad = message.angle_rad;
    model.timing.reported = message.timing.as_ref().map(|timing| Summary {
        count: timing.count,
        p50_us: timing.p50_us,
        p99_us: timing.p99_us,
        max_us: timing.max_us,
    });
    let bars = message.timing.iter().flat_map(|timing| &timing.bars);
    for (to, from) in model.timing.bars.iter_mut().zip(bars) {
        *to = *from;
    }
    true
}

fn feedback(state: &MachineState, axis_count: u32) -> Feedback {
    let mark = |set: bool| u32::from(set);
    Feedback {
        scan: state.scan,
        visible_from: state.scan,
        // Which one is not reported: only whether there is one.
        window: WindowId {
            sequence: mark(state.window),
            ..WindowId::NONE
        },
        tag: PathTag {
            distance_mm: state.distance_mm,
            element: state.element,
            dwell_remaining_scans: state.dwell_remaining_scans,
        },
        interrupted_at: PathTag {
            element: state.interrupted_at_element,
            ..PathTag::default()
        },
        cause_scan: state.cause_scan,
        at_rest: mark(state.at_rest),
        incarnation: state.incarnation,
        mode: state.mode,
        cause: state.cause,
        cause_axis: state.cause_axis,
        override_percent: state.override_percent,
        hold: mark(state.hold),
        program: state.program,
        run: state.run,
        last: mark(state.last),
        overrun_scans: state.overrun_scans,
        axis_count,
        auxiliary: auxiliaries(&state.auxiliary),
        inputs: Inputs {
            panel: state.panel,
            ..Inputs::default()
        },
        ..Feedback::zeroed()
    }
}

fn auxiliaries(state: &AuxiliaryState) -> Auxiliaries {
    let mut levels = Levels {
        spindle_rpm: state.spindle_command_rpm,
        orientation_deg: state.orientation_deg,
        digital: state.digital,
        spindle: state.spindle,
        coolant: state.coolant,
        tool: state.tool_wanted,
        tool_prepared: state.tool_prepared,
        ..Levels::default()
    };
    for (output, value) in levels.analog.iter_mut().zip(&state.analog) {
        *output = value.unwrap_or(f64::NAN);
    }
    Auxiliaries {
        levels,
        spindle_rpm: state.spindle_rpm,
        events_done: state.events_done,
        line: state.line,
        waiting: state.waiting,
        at_speed: u32::from(state.at_speed),
        optional_stop: u32::from(state.optional_stop),
        override_disabled: u32::from(state.override_disabled),
        tool: state.tool,
        coupled: state.coupled,
        ..Auxiliaries::default()
    }
}

fn process_view(message: &ProcessState) -> ProcessState {
    let mut view = message.clone();
    if !Job::ALL.iter().any(|job| job.word() == view.job) {
        view.job = "process".into();
    }
    view
}

/// Fills a model's circle.
pub fn fill_circle(model: &mut Model, message: &CircleState) {
    let um = |nm: i64| nm as f64 * 1e-3;
    let bins = message.deviation_nm.iter().map(|bin| {
        let seen = |(mean, low, high): (i64, i64, i64)| Bin::reported(um(mean), um(low), um(high));
        bin.map(seen)
    });
    model.circle.deviation = bins.collect();
    model.circle.running = message.running;
    model.circle.circle = Some(Circle::reported(
        &message.plane,
        message.radius_mm,
        message.feed_mm_s,
        message.line,
    ));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::json::{self, Reported};
    use crate::live::test_support::{machine, running};
    use bus::sample::{
        AxisCommand, Cause, FLOOD, Job, Mode, Participant, Roster, SpindleCommand, Waiting,
    };

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
        model.circle.circle = Some(Circle::reported("XY", 25.0, Some(50.0), 3));
        model.circle.deviation = vec![Some(Bin::reported(1.0, -0.5, 2.25)); CIRCLE_BINS];
        model.circle.running = true;
        model.circle.angle_rad = Some(0.5);
        model.end_of_look();
        model
    }

    #[test]
    fn the_picture_on_another_machine_says_the_same_as_on_the_spot() {
        let here = seen();
        let mut there = Model::new("mill-3", machine());
        let message = snapshot(&here, 5);
        let message = remote::wire::decode(&remote::wire::encode(&message).expect("message"));
        assert!(fill(&mut there, &message.expect("believed")));
        fill_circle(&mut there, &circle(&here, 5).expect("one"));
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
        assert_eq!(there.says(), here.says());
        assert_eq!(
            there.axes[0].error_history_um.back(),
            here.axes[0].error_history_um.back()
        );
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
        here.axes[0].now.error_um = Some(1e40);
        here.planner.as_mut().expect("one").path_done_mm = f64::NAN;
        remote::wire::encode(&snapshot(&here, 5)).expect("it can be message");
    }

    #[test]
    fn a_snapshot_of_another_machine_changes_nothing() {
        let mut there = Model::new("mill-3", machine());
        let mut message = snapshot(&seen(), 5);
        message.axes.pop();
        assert!(!fill(&mut there, &message));
        assert!(there.feedback.is_none());
    }
}
