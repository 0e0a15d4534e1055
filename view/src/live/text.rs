//! One look at a cell, as text.

use std::fmt::Write;

use bus::sample::{ProgramState as Progress, Redundancy};
use machine::Machine;
use monitor::quantities;
use operator::{alarm_words, value_words};
use remote::state::{AxisState, CellState, Death, LinkState, ProcessState, ProgramState, Readout};
use report::auxiliary::{on_or_off, panel};

use super::axis::ABSOLUTE;

/// What `quadrant status` prints.
pub fn status(state: &CellState, machine: &Machine) -> String {
    let says = &state.says;
    let mut text = format!("{}  {}: {}", state.cell, says.state, says.detail);
    if let Some(scan) = state.scan {
        let percent = |percent: Option<u32>| percent.unwrap_or(100);
        let _ = write!(
            text,
            "\n  hold {}, override {} %, rapids {} %, jogs {} %, single block {}, scan {scan} ({:.1} s) {}, overrun scans {}",
            on_or_off(state.hold == Some(true)),
            percent(state.override_percent),
            percent(state.rapid_override_percent),
            percent(state.jog_override_percent),
            on_or_off(state.single_block == Some(true)),
            state.time_s.unwrap_or(0.0),
            state.pace.as_deref().unwrap_or_default(),
            state.overrun_scans.unwrap_or(0),
        );
    }
    let auxiliary = state.auxiliary.as_ref().and_then(|of| of.summary.as_ref());
    let bus = state.bus.as_ref().map(|bus| &bus.summary);
    for words in auxiliary.into_iter().chain(bus) {
        let _ = write!(text, "\n  {words}");
    }
    if let Some(runs) = &state.runs {
        let gb = |bytes: u64| bytes as f64 / 1e9;
        let (taken, most) = (gb(runs.bytes), gb(runs.bytes_max));
        let _ = write!(text, "\n  run directories {taken:.3} GB of {most:.3}");
        if let Some(alarm) = &runs.alarm {
            let _ = write!(text, "\n  ! {alarm}");
        }
    }
    wired(&mut text, state);
    for message in &state.messages {
        let _ = write!(text, "\n  says, line {}: {}", message.line, message.text);
    }
    if let Some(link) = &state.remote {
        let age = age_words(link);
        let _ = write!(text, "\n  from {}: {age}; read only", link.server);
    }
    let _ = write!(text, "\n  next: {}", state.next);
    if let Some(words) = progress(&state.program) {
        let _ = write!(text, "\n  {words}");
    }
    if let Some(last) = &state.program.last_run {
        let why = if last.why.is_empty() { "" } else { ": " };
        let (run, outcome) = (last.run, &last.outcome);
        let _ = write!(text, "\n  run {run} {outcome}{why}{}", last.why);
    }
    readout(&mut text, state, machine);
    axes(&mut text, state);
    for alarm in state.axes.iter().filter_map(|axis| axis.alarm.as_ref()) {
        let _ = write!(text, "\n  ! {alarm}");
    }
    if !state.processes.is_empty() {
        text.push_str("\n\n  process      does             pid  starts  state");
    }
    for process in &state.processes {
        let pid = process.pid.map_or("-".into(), |pid| pid.to_string());
        let _ = write!(
            text,
            "\n  {:<12} {:<12} {pid:>7}  {:>6}  {}",
            process.process,
            process.job,
            process.starts,
            state_of(process)
        );
    }
    text
}

/// Alarms of the machine, and signals that are not as their wires say.
fn wired(text: &mut String, state: &CellState) {
    for alarm in &state.alarms {
        let _ = write!(text, "\n  ! alarm {}", alarm_words(alarm));
    }
    for signal in state
        .signals
        .iter()
        .filter(|signal| signal.forced || signal.lost)
    {
        let (name, words) = (&signal.name, value_words(signal));
        let _ = write!(text, "\n  ! signal {name} is {words}");
    }
}

/// The age of what is shown, in words.
pub fn age_words(link: &LinkState) -> String {
    match link.data_age_s_max {
        Some(max_s) if max_s < 1.0 => format!("data ≤ {:.0} ms old", max_s * 1e3),
        Some(max_s) => format!("data ≤ {max_s:.1} s old"),
        None => "age of data not known yet".into(),
    }
}

/// What is switched that is not as usual, in words.
pub fn switched_words(state: &CellState) -> Option<String> {
    let [rapid, jog] = [state.rapid_override_percent, state.jog_override_percent];
    panel(state.single_block?, rapid?, jog?)
}

/// Skew of each gantry in words, where it is known.
pub fn skew_words(state: &CellState, machine: &Machine) -> Vec<String> {
    let name = |index| machine.axis_name(index);
    let words = machine.gantries().filter_map(|pair| {
        let skew_um = state.axes.get(pair.follower)?.skew_um?;
        let (leader, follower) = (name(pair.leader), name(pair.follower));
        let most_um = pair.skew_max_mm * 1e3;
        Some(format!(
            "skew of {leader} and {follower} {skew_um:+.1} µm, at most {most_um:.0}"
        ))
    });
    words.collect()
}

/// Unit of the deviations of an axis.
pub fn error_unit(axis: &AxisState) -> &'static str {
    match axis.unit.as_str() {
        "deg" => "mdeg",
        _ => "µm",
    }
}

/// Actual feed, the one that is programmed, and the unit of both.
pub fn feeds(readout: &Readout) -> (Option<f64>, Option<f64>, &'static str) {
    match readout.feed_deg_min {
        Some(feed) => (Some(feed), readout.programmed_feed_deg_min, "deg/min"),
        None => {
            let programmed = readout.programmed_feed_mm_min;
            (readout.feed_mm_min, programmed, "mm/min")
        }
    }
}

/// The readout: work and machine coordinates, the way to go, feed, codes, time left.
fn readout(text: &mut String, state: &CellState, machine: &Machine) {
    let readout = &state.readout;
    let number = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:+.4}"));
    let _ = write!(
        text,
        "\n\n  axis          work      machine  distance to go"
    );
    if let Some(offset) = &readout.work_offset {
        let _ = write!(text, "    work offset {offset}");
    }
    let named = state.axes.iter().zip(&machine.axes);
    for (axis, _) in named.filter(|(_, of)| !of.is_follower()) {
        let _ = write!(
            text,
            "\n  {:<2} {:<3} {:>10}  {:>+11.4}  {:>14}",
            axis.axis,
            axis.unit,
            number(axis.work_mm),
            axis.machine_mm,
            number(axis.distance_to_go_mm)
        );
    }
    for words in skew_words(state, machine) {
        let _ = write!(text, "\n  {words}");
    }
    if let (Some(feed), programmed, unit) = feeds(readout) {
        let programmed = match (readout.rapid, programmed) {
            (Some(true), _) => ", programmed rapid".into(),
            (_, Some(feed)) => format!(", programmed {feed:.0}"),
            _ => String::new(),
        };
        let _ = write!(text, "\n  feed {feed:.0} {unit}{programmed}");
    }
    if let Some(left_s) = readout.time_left_s {
        let _ = write!(text, ", about {left_s:.0} s left (estimate)");
    }
    if !readout.active_codes.is_empty() {
        let _ = write!(text, "\n  {}", readout.active_codes.join(" "));
    }
}

/// A line for each axis.
fn axes(text: &mut String, state: &CellState) {
    *text += "\n\n  axis      command     feedback  following error  torque";
    for one in &quantities::OF_AXIS {
        *text += "  ";
        *text += one.heading;
    }
    *text += "  friction  missed  servo";
    for axis in &state.axes {
        let error = axis.following_error_um.map_or("-".into(), |error_um| {
            format!("{error_um:+.1} {}", error_unit(axis))
        });
        let _ = write!(
            text,
            "\n  {:<2} {:<3} {:>+10.4}  {:>+11.4}  {error:>15}  {:>4.0} %",
            axis.axis, axis.unit, axis.command_mm, axis.feedback_mm, axis.torque_percent
        );
        for one in &quantities::OF_AXIS {
            let value = format!("{} {}", one.text(&axis.quantities), one.unit);
            let _ = write!(text, "  {value:>width$}", width = one.heading.len());
        }
        let _ = write!(
            text,
            "  {:>8}  {:>6}  {}",
            axis.friction, axis.missed_scans, axis.servo
        );
        if axis.reference != ABSOLUTE {
            let _ = write!(text, "  {}", axis.reference);
        }
    }
}

/// How far the program is, in words.
pub fn progress(program: &ProgramState) -> Option<String> {
    let is = |state: &Progress| program.state.as_deref() == Some(state.word());
    let name = program.name.as_deref().unwrap_or("program");
    match Progress::ALL.into_iter().find(is) {
        Some(Progress::Loading) => return Some(format!("{name}, being read")),
        Some(Progress::Loaded) => return Some(format!("{name}, loaded")),
        Some(Progress::Done) => return Some(format!("{name}, done")),
        Some(Progress::None) => return Some("no program is loaded".into()),
        _ => {}
    }
    let percent = program.percent;
    let share = percent.map_or(String::new(), |percent| format!(" {percent:.1} %"));
    match (program.line, program.block.as_deref().unwrap_or_default()) {
        (Some(line), "") => Some(format!("{name}{share}, line {line}")),
        (Some(line), text) => Some(format!("{name}{share}, line {line}: {text}")),
        (None, _) => percent.map(|_| format!("{name}{share}")),
    }
}

/// How a servo is whose commands are not taken.
pub fn standby_words(process: &ProcessState) -> &'static str {
    let is = |state: Redundancy| process.standby.as_deref() == Some(state.words());
    match is(Redundancy::Synchronised) {
        true => "stands by",
        false if is(Redundancy::CatchingUp) => "catches up",
        false => "lives",
    }
}

/// How a process is, in words.
pub fn state_of(process: &ProcessState) -> String {
    let mut words = match (process.live, process.stalled, process.drives) {
        (false, _, _) => "✖ dead".to_string(),
        (true, true, _) => "stopped".into(),
        (true, false, Some(false)) => standby_words(process).into(),
        (true, false, Some(true)) => "drives".into(),
        (true, false, None) => "lives".into(),
    };
    if let Some(Death { scan, signal }) = process.last_death {
        let _ = if signal == 0 {
            write!(words, ", last ended in scan {scan}")
        } else {
            write!(words, ", last killed (signal {signal}) in scan {scan}")
        };
    }
    words
}
