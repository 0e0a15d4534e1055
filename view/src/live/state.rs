//! The state of a cell, made of what an observer has seen of it: once a look, for all who show it.

use bus::sample::{Auxiliaries, Cause, FLOOD, Feedback, Job, MIST, Mode};
use console::output::joined;
use machine::Process;
use monitor::ended::Ended;
use remote::state::{
    AuxiliaryState, AxisState, BusState, CauseState, CellState, CircleState, Death, LastRun,
    MessageState, ProcessState, ProgramState, TimingState,
};

use super::axis::AxisView;
use super::dro;
use super::model::Model;
use super::words::{self, Says};

/// What is shown of a cell: made of what an observer on the spot has seen, or reported by one.
#[derive(Debug, Clone, Default)]
pub struct Shown {
    /// Its state.
    pub state: CellState,
    /// The circle that is travelled, or was last; none before the first arc.
    pub circle: Option<CircleState>,
    /// How evenly scans follow each other; none before the first period.
    pub timing: Option<TimingState>,
}

impl Shown {
    /// By an observer on the spot.
    pub fn of(model: &Model) -> Shown {
        Shown {
            state: of(model),
            circle: model.circle.state(),
            timing: model.timing.state(),
        }
    }
}

/// A number with so many digits behind the point.
pub fn rounded(value: f64, digits: i32) -> f64 {
    let scale = 10f64.powi(digits);
    (value * scale).round() / scale
}

/// The same of one that may not be known.
pub fn round(value: Option<f64>, digits: i32) -> Option<f64> {
    value.map(|value| rounded(value, digits))
}

/// What is known of the cell.
fn of(model: &Model) -> CellState {
    let feedback = model.feedback.as_ref();
    let inputs = feedback.map(|now| &now.inputs);
    let period_s = model.machine.scan_period_s();
    let mut axes = axes(model);
    let readout = dro::of(model, &mut axes);
    let mut says = model.says();
    if let Some(why) = blocks(model) {
        // No axis may be moved before.
        let then = says.next.split("; an axis may be moved").next();
        says.next = format!(
            "{why}: first see to that; then {}",
            then.unwrap_or_default()
        );
    }
    if let Some(scarce) = &model.scarce {
        // First, so that a narrow terminal does not cut it off.
        says.next = format!("{scarce}; {}", says.next);
    }
    let mut state = CellState {
        cell: model.cell.clone(),
        pace: model.pace.map(|pace| pace.word().into()),
        scan: feedback.map(|now| now.scan),
        time_s: feedback.map(|now| rounded(now.scan as f64 * period_s, 6)),
        mode: feedback.and_then(|now| Some(Mode::from_wire(now.mode)?.word().into())),
        hold: feedback.map(|now| now.hold == 1),
        at_rest: feedback.map(words::at_rest),
        override_percent: feedback.map(|now| now.override_percent),
        rapid_override_percent: inputs.map(|inputs| inputs.rapid_override_percent()),
        jog_override_percent: inputs.map(|inputs| inputs.jog_override_percent()),
        single_block: inputs.map(|inputs| inputs.single_block()),
        cause: feedback.and_then(|now| cause(model, now)),
        overrun_scans: feedback.map(|now| now.overrun_scans),
        feedback_age_s: rounded(model.feedback_age_s, 3),
        ended: model.ended,
        program: program(model),
        messages: messages(model),
        auxiliary: feedback.map(|now| auxiliary(&now.auxiliary)),
        bus: model.bus.clone().map(|bus| BusState {
            standby: model.has_bus_standby(),
            ..bus
        }),
        runs: model.runs.clone(),
        signals: model.signals.clone(),
        alarms: model.alarms.clone(),
        readout,
        axes,
        processes: processes(model),
        ..CellState::default()
    };
    tell(&mut state, says);
    state
}

/// Inputs that keep the machine from going on, by what the controller does with them; none where none does.
fn blocks(model: &Model) -> Option<String> {
    let off = |name: &str| {
        let signal = model.signals.iter().find(|signal| signal.name == name);
        signal.is_some_and(|signal| signal.kind == "bool" && signal.value == 0.0)
    };
    let named = model.machine.functions.named();
    let words = named
        .filter(|(_, name, _)| off(name))
        .filter_map(|(key, name, _)| {
            let what = match key[..] {
                ["emergency_stop"] => "the emergency-stop chain is open",
                ["drives_may"] => "drives may not be on",
                ["door"] => "a door is open",
                ["ready"] => "not ready for a program",
                _ => return None,
            };
            Some(format!("{what} (signal {name})"))
        });
    let words = joined(words, ", ");
    (!words.is_empty()).then_some(words)
}

/// Says a state in words.
pub fn tell(state: &mut CellState, says: Says) {
    let Says { words, next } = says;
    state.state = format!("{}: {}", words.state.to_lowercase(), words.detail);
    (state.says, state.next) = (words, next);
}

fn cause(model: &Model, now: &Feedback) -> Option<CauseState> {
    let words = words::cause(now, &model.machine).into_iter();
    let words: Vec<String> = words.chain(model.given_up()).collect();
    let axis = now.cause_axis as usize;
    (now.cause != Cause::None as u32).then(|| CauseState {
        code: now.cause,
        words: words.join("; "),
        axis: (now.cause_axis != u32::MAX).then(|| model.machine.axis_name(axis).into()),
        scan: now.cause_scan,
    })
}

fn messages(model: &Model) -> Vec<MessageState> {
    let said = model.said.iter().map(|said| MessageState {
        number: said.number,
        line: said.line,
        text: said.text.to_string(),
    });
    said.collect()
}

fn program(model: &Model) -> ProgramState {
    let (line, block) = model.block().unzip();
    let feedback = model.feedback.as_ref();
    let on_path = feedback.filter(|feedback| !feedback.tag.is_off_path());
    let planner = model.planner.as_ref();
    ProgramState {
        state: model.program_state().map(|state| state.word().into()),
        run: feedback.map(|feedback| feedback.run),
        name: model.program_name().map(String::from),
        line,
        block: block.map(String::from),
        element: on_path.map(|feedback| feedback.tag.element),
        percent: round(model.share_done().map(|share| share * 100.0), 2),
        path_done_mm: round(planner.map(|status| status.path_done_mm), 4),
        path_length_mm: round(planner.map(|status| status.path_length_mm), 4),
        last_run: feedback
            .and_then(|now| Ended::told(&model.machine, now, now.ended.run))
            .map(|ended| LastRun {
                run: ended.run,
                outcome: ended.outcome.word().into(),
                scan: ended.scan,
                why: ended.text,
            }),
    }
}

/// Spindle, coolant, outputs, tool and stops.
fn auxiliary(now: &Auxiliaries) -> AuxiliaryState {
    let levels = &now.levels;
    AuxiliaryState {
        spindle: report::auxiliary::spindle(levels),
        spindle_command_rpm: round(Some(levels.spindle_rpm), 3),
        spindle_rpm: round(Some(now.spindle_rpm), 3),
        at_speed: now.at_speed == 1,
        mist: levels.coolant & MIST != 0,
        flood: levels.coolant & FLOOD != 0,
        tool: now.tool,
        tool_prepared: levels.tool_prepared,
        digital_outputs: report::auxiliary::digital_outputs(levels),
        analog_outputs: levels.analog.map(Some).to_vec(),
        waiting: monitor::words::waiting(now),
        start_line: (now.start_line != 0).then_some(now.start_line),
        events_done: now.events_done,
        optional_stop: now.optional_stop == 1,
        override_enabled: now.override_disabled == 0,
        summary: report::auxiliary::summary(now),
    }
}

fn axes(model: &Model) -> Vec<AxisState> {
    let each = model.axes.iter().enumerate();
    let each = each.map(|(index, axis)| AxisState {
        skew_um: round(model.skew_um(index), 3),
        alarm: model.standby_alarm(axis),
        ..axis.state()
    });
    each.collect()
}

/// The processes, in the order of the roster; empty before a roster was heard.
fn processes(model: &Model) -> Vec<ProcessState> {
    let participants = model.participants().iter().enumerate();
    let each = participants.filter_map(|(place, participant)| {
        let process = Process::of(participant)?;
        let job = process.job;
        let live = participant.live == 1;
        let axis = model.axes.get(participant.axis as usize);
        let axis = axis.filter(|_| job == Job::Servo);
        let drives = |axis: &&AxisView| axis.now.taken_role == participant.role;
        Some(ProcessState {
            process: process.name(&model.machine),
            job: job.word().into(),
            pid: model.pid_of(place, participant).filter(|_| live),
            starts: participant.incarnation,
            live,
            stalled: participant.stalled == 1,
            drives: (job == Job::Servo).then(|| live && axis.as_ref().is_some_and(drives)),
            standby: axis
                .filter(|axis| !drives(axis))
                .map(|axis| axis.redundancy().words().into()),
            age_scans: model.age_scans(place, job),
            last_death: (participant.death_scan != u64::MAX && participant.death_scan != 0)
                .then_some(Death {
                    scan: participant.death_scan,
                    signal: participant.death_signal,
                }),
        })
    });
    each.collect()
}
