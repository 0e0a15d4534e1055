//! One look at a cell, as text.

use bus::sample::{ProgramState, Redundancy};
use std::fmt::Write;

use bus::service::ROLES;

use super::dro;
use super::model::Model;
use remote::wire::ProcessState;

/// What `quadrant status` prints.
pub fn status(model: &Model) -> String {
    let says = model.says();
    let mut text = format!("{}  {}: {}", model.cell, says.state, says.detail);
    if let Some(feedback) = &model.feedback {
        let time_s = feedback.scan as f64 * model.machine.scan_period_s();
        let pace = model.pace.map_or("", |pace| pace.word());
        let _ = write!(
            text,
            "\n  hold {}, override {} %, rapids {} %, jogs {} %, single block {}, scan {} ({time_s:.1} s) {pace}, overrun scans {}",
            on_or_off(feedback.hold == 1),
            feedback.override_percent,
            feedback.inputs.rapid_override_percent(),
            feedback.inputs.jog_override_percent(),
            on_or_off(feedback.inputs.single_block()),
            feedback.scan,
            feedback.overrun_scans,
        );
    }
    let auxiliary = model.feedback.as_ref().map(|feedback| feedback.auxiliary);
    if let Some(words) = auxiliary.and_then(|now| report::auxiliary::summary(&now)) {
        let _ = write!(text, "\n  {words}");
    }
    if let Some(bus) = &model.bus {
        let _ = write!(text, "\n  {}", bus.words());
    }
    for message in &model.said {
        let _ = write!(text, "\n  says, line {}: {}", message.line, message.text);
    }
    if let Some(link) = &model.link {
        let _ = write!(
            text,
            "\n  from {}: {}; read only",
            link.to,
            link.age_words()
        );
    }
    let _ = write!(text, "\n  next: {}", says.next);
    if let Some(words) = progress(model) {
        let _ = write!(text, "\n  {words}");
    }
    readout(&mut text, model);
    axes(&mut text, model);
    for alarm in model
        .axes
        .iter()
        .filter_map(|axis| model.standby_alarm(axis))
    {
        let _ = write!(text, "\n  ! {alarm}");
    }
    let processes = model.processes();
    if !processes.is_empty() {
        text.push_str("\n\n  process      does             pid  starts  state");
    }
    for process in &processes {
        let pid = process.pid.map_or("-".into(), |pid| pid.to_string());
        let _ = write!(
            text,
            "\n  {:<12} {:<12} {pid:>7}  {:>6}  {}",
            process.name,
            process.job,
            process.starts,
            state_of(process)
        );
    }
    text
}

fn on_or_off(on: bool) -> &'static str {
    if on { "on" } else { "off" }
}

/// The readout: work and machine coordinates, the way to go, feed, codes, time left.
fn readout(text: &mut String, model: &Model) {
    let dro = dro::of(model);
    let number = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:+.4}"));
    let _ = write!(
        text,
        "\n\n  axis          work      machine  distance to go"
    );
    if let Some(offset) = dro.work_offset {
        let _ = write!(text, "    work offset {offset}");
    }
    let named = model.machine.program_axes().len();
    for (index, axis) in model.axes.iter().enumerate().take(named) {
        let of = |values: &[Option<f64>]| number(values.get(index).copied().flatten());
        let _ = write!(
            text,
            "\n  {:<2} {:<3} {:>10}  {:>+11.4}  {:>14}",
            axis.name,
            axis.unit,
            of(&dro.work),
            axis.now.command_mm,
            of(&dro.distance_to_go)
        );
    }
    for words in model.skew_words() {
        let _ = write!(text, "\n  {words}");
    }
    if let Some(feed) = dro.feed_mm_min {
        let programmed = match (dro.rapid, dro.programmed_feed_mm_min) {
            (Some(true), _) => ", programmed rapid".into(),
            (_, Some(feed)) => format!(", programmed {feed:.0}"),
            _ => String::new(),
        };
        let _ = write!(text, "\n  feed {feed:.0} {}{programmed}", dro.feed_unit());
    }
    if let Some(left_s) = dro.time_left_s {
        let _ = write!(text, ", about {left_s:.0} s left (estimate)");
    }
    if !dro.active_codes.is_empty() {
        let _ = write!(text, "\n  {}", dro.active_codes.join(" "));
    }
}

/// A line for each axis.
fn axes(text: &mut String, model: &Model) {
    let _ = write!(
        text,
        "\n\n  axis      command     feedback  following error  torque  winding  friction  missed  servo"
    );
    for axis in &model.axes {
        let error = axis.now.error_um.map_or("-".into(), |error_um| {
            format!("{error_um:+.1} {}", axis.error_unit)
        });
        let _ = write!(
            text,
            "\n  {:<2} {:<3} {:>+10.4}  {:>+11.4}  {error:>15}  {:>4.0} %  {:>+5.1} K  {:>8}  {:>6}  {}",
            axis.name,
            axis.unit,
            axis.now.command_mm,
            axis.now.feedback_mm,
            axis.torque_share() * 100.0,
            axis.now.winding_k,
            axis.friction_words(),
            axis.now.missed_scans,
            ROLES.get(axis.now.role as usize).copied().unwrap_or("?"),
        );
        if let Some(words) = axis.homing_words() {
            let _ = write!(text, "  {words}");
        }
    }
}

/// How far the program is, in words.
pub fn progress(model: &Model) -> Option<String> {
    let named = model.program_name().unwrap_or("program");
    match model.program_state() {
        Some(ProgramState::None) => return Some("no program is loaded".into()),
        Some(ProgramState::Loading) => return Some(format!("{named}, being read")),
        Some(ProgramState::Loaded) => return Some(format!("{named}, loaded")),
        Some(ProgramState::Done) => return Some(format!("{named}, done")),
        Some(ProgramState::Running) | None => {}
    }
    let percent = model.share_done().map(|share| share * 100.0);
    let block = model.block();
    let name = model.program_name().unwrap_or("program");
    let share = percent.map_or(String::new(), |percent| format!(" {percent:.1} %"));
    match block {
        Some((line, "")) => Some(format!("{name}{share}, line {line}")),
        Some((line, text)) => Some(format!("{name}{share}, line {line}: {text}")),
        None => percent.map(|_| format!("{name}{share}")),
    }
}

/// How a servo is whose commands are not taken.
pub fn standby_words(process: &ProcessState) -> &'static str {
    match process.redundancy.and_then(Redundancy::from_wire) {
        Some(Redundancy::Synchronised) => "stands by",
        Some(Redundancy::CatchingUp) => "catches up",
        Some(Redundancy::Alone | Redundancy::Lost) | None => "lives",
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
    if let Some((scan, signal)) = process.death {
        let _ = if signal == 0 {
            write!(words, ", last ended in scan {scan}")
        } else {
            write!(words, ", last killed (signal {signal}) in scan {scan}")
        };
    }
    words
}
