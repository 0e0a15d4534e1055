//! A model as JSON: names end in units and stay what they are. What is in mm or µm of a slide
//! is in degrees or thousandths of a degree of a rotary axis, under names that say so.

use bus::messages::ProgramMessage;
use bus::sample::{
    ANALOG_OUTPUTS, Auxiliaries, Cause, FLOOD, MIST, Mode, ProgramState, Redundancy,
};
use bus::service::ROLES;
use serde::Serialize;

use super::axis::AxisView;
use super::dro::{self, Dro};
use super::events::Weight;
use super::fieldbus::slave_words;
use super::model::Model;
use super::words;

/// What `status --json` prints.
#[derive(Serialize)]
pub struct State<'a> {
    cell: &'a str,
    pace: Option<&'static str>,
    scan: Option<u64>,
    time_s: Option<f64>,
    mode: Option<&'static str>,
    state: String,
    next: String,
    hold: Option<bool>,
    at_rest: Option<bool>,
    override_percent: Option<u32>,
    rapid_override_percent: Option<u32>,
    jog_override_percent: Option<u32>,
    single_block: Option<bool>,
    cause: Option<CauseOf>,
    overrun_scans: Option<u32>,
    feedback_age_s: f64,
    program: ProgramOf<'a>,
    /// What it has said to its operator, the last few.
    messages: Vec<MessageOf<'a>>,
    auxiliary: Option<AuxiliaryOf>,
    /// Of a cell with a fieldbus, seen on the spot.
    #[serde(skip_serializing_if = "Option::is_none")]
    bus: Option<BusOf<'a>>,
    readout: ReadoutOf,
    axes: Vec<AxisOf<'a>>,
    processes: Vec<ProcessOf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    remote: Option<RemoteOf<'a>>,
}

#[derive(Serialize)]
struct MessageOf<'a> {
    number: u32,
    line: u32,
    text: &'a str,
}

/// Of a view from another machine.
#[derive(Serialize)]
struct RemoteOf<'a> {
    server: &'a str,
    data_age_s_max: Option<f64>,
    data_age_s_min: Option<f64>,
    round_trip_s: Option<f64>,
    link_lost: bool,
    silent_s: f64,
    snapshots: u64,
    snapshots_lost: u64,
    messages_refused: u64,
    messages_dropped: u64,
    events: u64,
    events_lost: u64,
}

#[derive(Serialize)]
struct CauseOf {
    code: u32,
    words: String,
    axis: Option<String>,
    scan: u64,
}

#[derive(Serialize)]
struct ProgramOf<'a> {
    /// none, loading, loaded, started, done.
    state: Option<&'static str>,
    /// Counts the programs started.
    run: Option<u32>,
    name: Option<&'a str>,
    line: Option<u32>,
    block: Option<&'a str>,
    element: Option<u32>,
    percent: Option<f64>,
    path_done_mm: Option<f64>,
    path_length_mm: Option<f64>,
}

/// The digital readout beside the axes; null is what cannot be known.
#[derive(Serialize)]
struct ReadoutOf {
    work_offset: Option<&'static str>,
    tool: Option<u32>,
    feed_mm_min: Option<f64>,
    programmed_feed_mm_min: Option<f64>,
    /// Where only rotary axes move, in place of both.
    #[serde(skip_serializing_if = "Option::is_none")]
    feed_deg_min: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    programmed_feed_deg_min: Option<f64>,
    rapid: Option<bool>,
    spindle_rpm: Option<f64>,
    programmed_spindle_rpm: Option<f64>,
    /// As the program has them, in its units.
    feed_word: Option<f64>,
    speed_word: Option<f64>,
    active_codes: Vec<String>,
    block_line: Option<u32>,
    block_text: Option<String>,
    /// An estimate: without what braking and stops take.
    time_left_s: Option<f64>,
    time_left_is_estimate: bool,
}

/// The fieldbus.
#[derive(Serialize)]
struct BusOf<'a> {
    /// starting, in operation, down.
    state: &'static str,
    owner_pid: Option<u32>,
    standby: bool,
    frames: u64,
    missed: u64,
    short: u64,
    late: u64,
    foreign: u64,
    repeated: u64,
    round_trip_us: Option<f64>,
    /// Null without distributed clocks.
    clock_offset_us: Option<f64>,
    slaves: Vec<SlaveOf<'a>>,
}

#[derive(Serialize)]
struct SlaveOf<'a> {
    place: usize,
    /// Whose drive it is; null of other devices.
    axis: Option<&'a str>,
    al_state: String,
    al_status_code: u16,
}

/// Spindle, coolant, outputs, tool and stops.
#[derive(Serialize)]
struct AuxiliaryOf {
    /// In words: stopped, a speed and a direction, or an angle.
    spindle: String,
    spindle_command_rpm: f64,
    spindle_rpm: f64,
    at_speed: bool,
    mist: bool,
    flood: bool,
    tool: u32,
    tool_prepared: u32,
    digital_outputs: Vec<u32>,
    analog_outputs: [f64; ANALOG_OUTPUTS],
    /// What is waited for, in words, and its line.
    waiting: Option<String>,
    /// The line that the program is to begin at, until the tool is there.
    start_line: Option<u32>,
    events_done: u32,
    optional_stop: bool,
    override_enabled: bool,
}

#[derive(Serialize)]
struct AxisOf<'a> {
    axis: &'a str,
    unit: &'static str,
    /// What a slide has in mm; null is what cannot be known.
    #[serde(flatten)]
    linear: Option<LinearOf>,
    /// What a rotary axis has in degrees.
    #[serde(flatten)]
    rotary: Option<RotaryOf>,
    torque_command_nm: Option<f64>,
    torque_nm: f64,
    torque_percent: f64,
    torque_limited: bool,
    winding_k: f64,
    friction_level: Option<f64>,
    friction_unexplained: Option<f64>,
    missed_scans: u32,
    servo: &'static str,
    standby: &'static str,
    standby_differences: u32,
    /// absolute, no reference, homed, not homed, homing.
    reference: &'static str,
    /// Of the second motor of a gantry: its position less that of the axis's first.
    #[serde(skip_serializing_if = "Option::is_none")]
    skew_um: Option<f64>,
    alarm: Option<String>,
}

#[derive(Serialize)]
struct LinearOf {
    command_mm: f64,
    feedback_mm: f64,
    work_mm: Option<f64>,
    machine_mm: f64,
    distance_to_go_mm: Option<f64>,
    tool_length_mm: Option<f64>,
    velocity_mm_s: f64,
    velocity_command_mm_s: Option<f64>,
    following_error_um: Option<f64>,
    following_error_peak_um: f64,
}

#[derive(Serialize)]
struct RotaryOf {
    command_deg: f64,
    feedback_deg: f64,
    work_deg: Option<f64>,
    machine_deg: f64,
    distance_to_go_deg: Option<f64>,
    tool_length_deg: Option<f64>,
    velocity_deg_s: f64,
    velocity_command_deg_s: Option<f64>,
    following_error_mdeg: Option<f64>,
    following_error_peak_mdeg: f64,
}

#[derive(Serialize)]
struct ProcessOf {
    process: String,
    job: String,
    pid: Option<u32>,
    starts: u32,
    live: bool,
    stalled: bool,
    drives: Option<bool>,
    standby: Option<&'static str>,
    age_scans: Option<u64>,
    last_death: Option<Death>,
}

#[derive(Serialize)]
struct Death {
    scan: u64,
    signal: i32,
}

/// One line of the monitor.
#[derive(Serialize)]
struct Line<'a> {
    #[serde(flatten)]
    state: State<'a>,
    circle: Option<CircleOf>,
    reversals: Vec<ReversalOf<'a>>,
    events: Vec<EventOf<'a>>,
    timing: Option<TimingOf>,
    scans_seen: u64,
    scans_not_seen: u64,
}

#[derive(Serialize)]
struct CircleOf {
    plane: String,
    line: u32,
    radius_mm: f64,
    feed_mm_min: Option<f64>,
    running: bool,
    radial_deviation_um: Option<Range>,
}

#[derive(Serialize)]
struct Range {
    min: f64,
    max: f64,
}

#[derive(Serialize)]
struct ReversalOf<'a> {
    axis: &'a str,
    new_direction: i32,
    scan: u64,
    height_um: Option<f64>,
    undercut_um: Option<f64>,
    #[serde(flatten)]
    error: ErrorPeak,
}

/// Following error of an axis around its reversal.
#[derive(Serialize)]
pub enum ErrorPeak {
    /// Of a slide.
    #[serde(rename = "following_error_peak_um")]
    Um(f64),
    /// Of a rotary axis.
    #[serde(rename = "following_error_peak_mdeg")]
    Mdeg(f64),
}

impl ErrorPeak {
    /// Of an axis, rounded to so many digits.
    pub fn of(model: &Model, axis: u32, error_peak_um: f64, digits: i32) -> Self {
        let value = rounded(error_peak_um, digits);
        match model.machine.axes.get(axis as usize) {
            Some(axis) if dro::is_rotary(axis) => ErrorPeak::Mdeg(value),
            _ => ErrorPeak::Um(value),
        }
    }
}

#[derive(Serialize)]
struct EventOf<'a> {
    scan: u64,
    event: &'a str,
    warning: bool,
}

#[derive(Serialize)]
struct TimingOf {
    periods: u64,
    period_us: PeriodOf,
}

#[derive(Serialize)]
struct PeriodOf {
    p50: f64,
    p99: f64,
    max: f64,
}

/// How far a reader of lines is: what came before is not reported again.
#[derive(Debug, Default, Clone, Copy)]
pub struct Reported {
    reversals: u64,
    events: u64,
}

/// A number with so many digits behind the point.
pub fn rounded(value: f64, digits: i32) -> f64 {
    let scale = 10f64.powi(digits);
    (value * scale).round() / scale
}

/// What is known of the cell.
pub fn state(model: &Model) -> State<'_> {
    let feedback = model.feedback.as_ref();
    let says = model.says();
    let period_s = model.machine.scan_period_s();
    let cause = feedback.filter(|feedback| feedback.cause != Cause::None as u32);
    let dro = dro::of(model);
    State {
        cell: &model.cell,
        pace: model.pace.map(|pace| pace.word()),
        scan: feedback.map(|feedback| feedback.scan),
        time_s: feedback.map(|feedback| rounded(feedback.scan as f64 * period_s, 6)),
        mode: feedback.and_then(|feedback| Mode::from_wire(feedback.mode).map(Mode::word)),
        state: format!("{}: {}", says.state.to_lowercase(), says.detail),
        next: says.next,
        hold: feedback.map(|feedback| feedback.hold == 1),
        at_rest: feedback.map(words::at_rest),
        override_percent: feedback.map(|feedback| feedback.override_percent),
        rapid_override_percent: feedback.map(|now| now.inputs.rapid_override_percent()),
        jog_override_percent: feedback.map(|now| now.inputs.jog_override_percent()),
        single_block: feedback.map(|now| now.inputs.single_block()),
        cause: cause.map(|feedback| CauseOf {
            code: feedback.cause,
            words: words::cause(feedback, &model.machine)
                .into_iter()
                .chain(model.given_up())
                .collect::<Vec<_>>()
                .join("; "),
            axis: (feedback.cause_axis != u32::MAX).then(|| {
                model
                    .machine
                    .axis_name(feedback.cause_axis as usize)
                    .to_string()
            }),
            scan: feedback.cause_scan,
        }),
        overrun_scans: feedback.map(|feedback| feedback.overrun_scans),
        feedback_age_s: rounded(model.feedback_age_s, 3),
        program: program(model),
        messages: model.said.iter().map(message).collect(),
        auxiliary: feedback.map(|feedback| auxiliary(&feedback.auxiliary)),
        bus: fieldbus(model),
        axes: axes(model, &dro),
        readout: readout(model, dro),
        processes: processes(model),
        remote: remote(model),
    }
}

fn fieldbus(model: &Model) -> Option<BusOf<'_>> {
    let bus = model.bus.as_ref()?;
    let counts = bus.inputs.as_ref().map(|inputs| inputs.counts);
    let counts = counts.unwrap_or_default();
    let machine = &model.machine;
    let axis_at = |place: usize| {
        let mut axes = machine.axes.iter().enumerate();
        let found = axes.find(|(index, _)| machine.slave_of(*index) == place);
        found.map(|(_, axis)| axis.name.as_str())
    };
    let slaves = bus.slaves().iter().enumerate();
    Some(BusOf {
        state: bus.state.words(),
        owner_pid: bus.owner_pid,
        standby: model.has_bus_standby(),
        frames: counts.sent,
        missed: counts.missed,
        short: counts.short,
        late: counts.late,
        foreign: counts.foreign,
        repeated: counts.repeated,
        round_trip_us: bus.round_trip_us().map(|us| rounded(us, 3)),
        clock_offset_us: bus.clock_offset_us().map(|us| rounded(us, 3)),
        slaves: slaves
            .map(|(place, slave)| SlaveOf {
                place,
                axis: axis_at(place),
                al_state: slave_words(slave),
                al_status_code: slave.al_status_code,
            })
            .collect(),
    })
}

fn message(said: &ProgramMessage) -> MessageOf<'_> {
    MessageOf {
        number: said.number,
        line: said.line,
        text: &said.text,
    }
}

fn auxiliary(now: &Auxiliaries) -> AuxiliaryOf {
    let levels = &now.levels;
    AuxiliaryOf {
        spindle: report::auxiliary::spindle(levels),
        spindle_command_rpm: rounded(levels.spindle_rpm, 3),
        spindle_rpm: rounded(now.spindle_rpm, 3),
        at_speed: now.at_speed == 1,
        mist: levels.coolant & MIST != 0,
        flood: levels.coolant & FLOOD != 0,
        tool: now.tool,
        tool_prepared: levels.tool_prepared,
        digital_outputs: report::auxiliary::digital_outputs(levels),
        analog_outputs: levels.analog,
        waiting: monitor::words::waiting(now),
        start_line: (now.start_line != 0).then_some(now.start_line),
        events_done: now.events_done,
        optional_stop: now.optional_stop == 1,
        override_enabled: now.override_disabled == 0,
    }
}

fn remote(model: &Model) -> Option<RemoteOf<'_>> {
    let link = model.link.as_ref()?;
    Some(RemoteOf {
        server: &link.to,
        data_age_s_max: link.age_s.map(|(_, max_s)| rounded(max_s, 4)),
        data_age_s_min: link.age_s.map(|(min_s, _)| rounded(min_s, 4)),
        round_trip_s: link.round_trip_s.map(|s| rounded(s, 4)),
        link_lost: link.lost,
        silent_s: rounded(link.silent_s, 3),
        snapshots: link.snapshots,
        snapshots_lost: link.snapshots_lost,
        messages_refused: link.refused,
        messages_dropped: link.dropped,
        events: model.events.count,
        events_lost: link.events_lost,
    })
}

fn program(model: &Model) -> ProgramOf<'_> {
    let block = model.block();
    let feedback = model.feedback.as_ref();
    let on_path = feedback.filter(|feedback| !feedback.tag.is_off_path());
    ProgramOf {
        state: feedback
            .and_then(|f| ProgramState::from_wire(f.program))
            .map(ProgramState::word),
        run: feedback.map(|feedback| feedback.run),
        name: model.program_name(),
        line: block.map(|(line, _)| line),
        block: block.map(|(_, text)| text),
        element: on_path.map(|feedback| feedback.tag.element),
        percent: model.share_done().map(|share| rounded(share * 100.0, 2)),
        path_done_mm: model.planner.map(|status| rounded(status.path_done_mm, 4)),
        path_length_mm: model
            .planner
            .map(|status| rounded(status.path_length_mm, 4)),
    }
}

fn readout(model: &Model, dro: Dro) -> ReadoutOf {
    let auxiliary = model.feedback.as_ref().map(|feedback| &feedback.auxiliary);
    let round = |value: Option<f64>, digits: i32| value.map(|value| rounded(value, digits));
    let block = model.block();
    let rotary = dro.is_feed_of_rotary;
    let feed = round(dro.feed_mm_min, 1);
    let programmed = round(dro.programmed_feed_mm_min, 3);
    ReadoutOf {
        work_offset: dro.work_offset,
        tool: auxiliary.map(|now| now.tool),
        feed_mm_min: feed.filter(|_| !rotary),
        programmed_feed_mm_min: programmed.filter(|_| !rotary),
        feed_deg_min: feed.filter(|_| rotary),
        programmed_feed_deg_min: programmed.filter(|_| rotary),
        rapid: dro.rapid,
        spindle_rpm: auxiliary.map(|now| rounded(now.spindle_rpm, 3)),
        programmed_spindle_rpm: auxiliary.map(|now| rounded(now.levels.spindle_rpm, 3)),
        feed_word: dro.feed_word,
        speed_word: dro.speed_word,
        active_codes: dro.active_codes,
        block_line: block.map(|(line, _)| line),
        block_text: block.map(|(_, text)| text.to_owned()),
        time_left_s: round(dro.time_left_s, 1),
        time_left_is_estimate: true,
    }
}

/// What an axis has in mm or in degrees: a slide, or a rotary axis.
fn own_units(
    model: &Model,
    dro: &Dro,
    index: usize,
    axis: &AxisView,
) -> (Option<LinearOf>, Option<RotaryOf>) {
    let of = |values: &[Option<f64>]| values.get(index).copied().flatten();
    let round = |value: Option<f64>| value.map(|value| rounded(value, 6));
    let lengths = dro.tool_length.as_ref();
    let length = lengths.and_then(|lengths| lengths.get(index).copied());
    let linear = LinearOf {
        command_mm: rounded(axis.command_mm, 6),
        feedback_mm: rounded(axis.feedback_mm, 6),
        work_mm: round(of(&dro.work)),
        machine_mm: rounded(axis.command_mm, 6),
        distance_to_go_mm: round(of(&dro.distance_to_go)),
        tool_length_mm: round(length),
        velocity_mm_s: rounded(axis.velocity_mm_s, 4),
        velocity_command_mm_s: axis.commanded.map(|c| rounded(c.velocity_mm_s, 4)),
        following_error_um: axis.error_um.map(|error_um| rounded(error_um, 3)),
        following_error_peak_um: rounded(axis.error_peak_um, 3),
    };
    match model.machine.axes.get(index).is_some_and(dro::is_rotary) {
        true => (None, Some(linear.into())),
        false => (Some(linear), None),
    }
}

impl From<LinearOf> for RotaryOf {
    /// The same numbers: inside, a degree is what a mm is.
    fn from(of: LinearOf) -> Self {
        RotaryOf {
            command_deg: of.command_mm,
            feedback_deg: of.feedback_mm,
            work_deg: of.work_mm,
            machine_deg: of.machine_mm,
            distance_to_go_deg: of.distance_to_go_mm,
            tool_length_deg: of.tool_length_mm,
            velocity_deg_s: of.velocity_mm_s,
            velocity_command_deg_s: of.velocity_command_mm_s,
            following_error_mdeg: of.following_error_um,
            following_error_peak_mdeg: of.following_error_peak_um,
        }
    }
}

fn axes<'a>(model: &'a Model, dro: &Dro) -> Vec<AxisOf<'a>> {
    let each = model.axes.iter().enumerate();
    let each = each.map(|(index, axis)| {
        let readout = own_units(model, dro, index, axis);
        (axis, model.skew_um(index), readout)
    });
    each.map(|(axis, skew_um, (linear, rotary))| AxisOf {
        axis: &axis.name,
        skew_um: skew_um.map(|um| rounded(um, 3)),
        linear,
        rotary,
        unit: axis.unit,
        torque_command_nm: axis.commanded.map(|c| rounded(c.torque_nm, 4)),
        torque_nm: rounded(axis.torque_nm, 4),
        torque_percent: rounded(axis.torque_share * 100.0, 2),
        torque_limited: axis.torque_limited,
        winding_k: rounded(axis.winding_k, 3),
        friction_level: axis.friction().map(|(level, _)| rounded(level, 4)),
        friction_unexplained: axis.friction().map(|(_, part)| rounded(part, 4)),
        missed_scans: axis.missed_scans,
        servo: ROLES.get(axis.role as usize).copied().unwrap_or("?"),
        standby: axis.redundancy.words(),
        standby_differences: axis.differences,
        reference: axis.reference_words(),
        alarm: model.standby_alarm(axis),
    })
    .collect()
}

fn processes(model: &Model) -> Vec<ProcessOf> {
    let each = model.processes().into_iter();
    each.map(|process| ProcessOf {
        process: process.name,
        job: process.job,
        pid: process.pid,
        starts: process.starts,
        live: process.live,
        stalled: process.stalled,
        drives: process.drives,
        standby: process
            .redundancy
            .and_then(Redundancy::from_wire)
            .map(Redundancy::words),
        age_scans: process.age_scans,
        last_death: process.death.map(|(scan, signal)| Death { scan, signal }),
    })
    .collect()
}

fn written(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_else(|error| format!("{{\"error\":\"{error}\"}}"))
}

/// One look, over several lines.
pub fn status(model: &Model) -> String {
    serde_json::to_string_pretty(&state(model)).unwrap_or_else(|error| error.to_string())
}

/// One line of the monitor, with the reversals and events since the line before.
pub fn line(model: &Model, reported: &mut Reported) -> String {
    let fresh = |count: u64, before: &mut u64, kept: usize| {
        let new = usize::try_from(count - std::mem::replace(before, count)).unwrap_or(kept);
        kept.saturating_sub(new)
    };
    let reversals = &model.reversals;
    let first = fresh(
        reversals.count,
        &mut reported.reversals,
        reversals.last.len(),
    );
    let fresh_reversals = reversals.last.iter().skip(first);
    let events = &model.events;
    let first = fresh(events.count, &mut reported.events, events.last.len());
    let fresh_events = events.last.iter().skip(first);
    let circle = &model.circle;
    written(&Line {
        state: state(model),
        circle: circle.circle.as_ref().map(|shape| CircleOf {
            plane: shape.plane.clone(),
            line: shape.line,
            radius_mm: shape.radius_mm,
            feed_mm_min: shape
                .feed_mm_s
                .map(|feed_mm_s| rounded(feed_mm_s * 60.0, 3)),
            running: circle.running,
            radial_deviation_um: circle.range_um().map(|(min, max)| Range {
                min: rounded(min, 3),
                max: rounded(max, 3),
            }),
        }),
        reversals: fresh_reversals
            .map(|reversal| ReversalOf {
                axis: model.machine.axis_name(reversal.axis as usize),
                new_direction: reversal.direction,
                scan: reversal.scan,
                height_um: reversal.height_um.map(|um| rounded(um, 3)),
                undercut_um: reversal.undercut_um.map(|um| rounded(um, 3)),
                error: ErrorPeak::of(model, reversal.axis, reversal.error_peak_um, 3),
            })
            .collect(),
        events: fresh_events
            .map(|event| EventOf {
                scan: event.scan,
                event: &event.text,
                warning: event.weight == Weight::Warning,
            })
            .collect(),
        timing: model.timing.summary().map(|summary| TimingOf {
            periods: summary.count,
            period_us: PeriodOf {
                p50: rounded(summary.p50_us, 1),
                p99: rounded(summary.p99_us, 1),
                max: rounded(summary.max_us, 1),
            },
        }),
        scans_seen: model.seen_scans.0,
        scans_not_seen: model.seen_scans.1,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::test_support::{machine, running};

    #[test]
    fn every_line_tells_only_what_is_new() {
        let mut model = Model::new("t", machine());
        let mut reported = Reported::default();
        model.feedback(&running(1));
        let mut held = running(2);
        held.hold = 1;
        model.feedback(&held);
        let events = |line: &str| -> usize {
            let value: serde_json::Value = serde_json::from_str(line).expect("JSON");
            value["events"].as_array().expect("events").len()
        };
        assert_eq!(events(&line(&model, &mut reported)), 1);
        assert_eq!(events(&line(&model, &mut reported)), 0);
        held.scan = 3;
        held.hold = 0;
        model.feedback(&held);
        assert_eq!(events(&line(&model, &mut reported)), 1);
    }

    #[test]
    fn a_bus_is_there_where_the_cell_has_one_with_its_slaves_by_axis() {
        let mut model = Model::new("t", machine());
        let value = |model: &Model| -> serde_json::Value {
            serde_json::from_str(&status(model)).expect("JSON")
        };
        assert_eq!(value(&model).get("bus"), None);
        model.bus = Some(crate::live::fieldbus::tests::example());
        let value = value(&model);
        let bus = &value["bus"];
        assert_eq!(bus["state"], "in operation");
        assert_eq!(bus["owner_pid"], 77);
        assert_eq!(bus["standby"], false);
        assert_eq!(bus["round_trip_us"], 84.6);
        assert_eq!(bus["clock_offset_us"], -1.25);
        let counts = ["frames", "missed", "short", "late", "foreign", "repeated"];
        assert_eq!(
            counts.map(|key| bus[key].as_u64()),
            [1000, 2, 3, 4, 5, 6].map(Some)
        );
        assert_eq!(bus["slaves"][1]["axis"], "Y");
        assert_eq!(bus["slaves"][1]["al_state"], "SAFE-OP with an error");
    }

    #[test]
    fn a_model_without_any_sample_is_json_all_the_same() {
        let model = Model::new("t", machine());
        let value: serde_json::Value = serde_json::from_str(&status(&model)).expect("JSON");
        assert!(value["mode"].is_null());
        assert_eq!(value["axes"][1]["axis"], "Y");
    }
}
