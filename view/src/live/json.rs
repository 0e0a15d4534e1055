//! A model as JSON: names end in units and stay what they are. What is in mm or µm of a slide
//! is in degrees or thousandths of a degree of a rotary axis, under names that say so; null is what cannot be known.

use bus::messages::ProgramMessage;
use bus::sample::{Auxiliaries, Cause, FLOOD, MIST, Mode, ProgramState, Redundancy};
use bus::service::ROLES;
use remote::wire::ReversalState;
use serde_json::{Value, json};

use super::axis::AxisView;
use super::dro::{self, Dro};
use super::events::{Event, Weight};
use super::fieldbus::{BusView, slave_words};
use super::model::{LinkView, Model};
use super::words;

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

/// The same of one that may not be known.
pub fn round(value: Option<f64>, digits: i32) -> Option<f64> {
    value.map(|value| rounded(value, digits))
}

/// Takes what is not there out of an object, in which other nulls have their meaning.
pub fn without_missing(mut of: Value, names: &[&str]) -> Value {
    if let Value::Object(fields) = &mut of {
        fields.retain(|name, value| !value.is_null() || !names.contains(&name.as_str()));
    }
    of
}

/// What is known of the cell, as `status --json` prints it.
pub fn state(model: &Model) -> Value {
    let feedback = model.feedback.as_ref();
    let says = model.says();
    let period_s = model.machine.scan_period_s();
    let cause = feedback.filter(|feedback| feedback.cause != Cause::None as u32);
    let dro = dro::of(model);
    let state = json!({
        "cell": model.cell,
        "pace": model.pace.map(|pace| pace.word()),
        "scan": feedback.map(|now| now.scan),
        "time_s": feedback.map(|now| rounded(now.scan as f64 * period_s, 6)),
        "mode": feedback.and_then(|now| Mode::from_wire(now.mode).map(Mode::word)),
        "state": format!("{}: {}", says.state.to_lowercase(), says.detail),
        "next": says.next,
        "hold": feedback.map(|now| now.hold == 1),
        "at_rest": feedback.map(words::at_rest),
        "override_percent": feedback.map(|now| now.override_percent),
        "rapid_override_percent": feedback.map(|now| now.inputs.rapid_override_percent()),
        "jog_override_percent": feedback.map(|now| now.inputs.jog_override_percent()),
        "single_block": feedback.map(|now| now.inputs.single_block()),
        "cause": cause.map(|feedback| json!({
            "code": feedback.cause,
            "words": words::cause(feedback, &model.machine)
                .into_iter()
                .chain(model.given_up())
                .collect::<Vec<_>>()
                .join("; "),
            "axis": (feedback.cause_axis != u32::MAX)
                .then(|| model.machine.axis_name(feedback.cause_axis as usize)),
            "scan": feedback.cause_scan,
        })),
        "overrun_scans": feedback.map(|now| now.overrun_scans),
        "feedback_age_s": rounded(model.feedback_age_s, 3),
        "program": program(model),
        // What it has said to its operator, the last few.
        "messages": model.said.iter().map(message).collect::<Vec<_>>(),
        "auxiliary": feedback.map(|feedback| auxiliary(&feedback.auxiliary)),
        // Of a cell with a fieldbus, seen on the spot.
        "bus": model.bus.as_ref().map(|bus| fieldbus(model, bus)),
        "readout": readout(model, &dro),
        "axes": axes(model, &dro),
        "processes": processes(model),
        // Of a view from another machine.
        "remote": model.link.as_ref().map(|link| remote(model, link)),
    });
    without_missing(state, &["bus", "remote"])
}

fn fieldbus(model: &Model, bus: &BusView) -> Value {
    let counts = bus.inputs.as_ref().map(|inputs| inputs.counts);
    let counts = counts.unwrap_or_default();
    let machine = &model.machine;
    // Whose drive it is; null of other devices.
    let axis_at = |place: usize| {
        let mut axes = machine.axes.iter().enumerate();
        let found = axes.find(|(index, _)| machine.slave_of(*index) == place);
        found.map(|(_, axis)| axis.name.as_str())
    };
    let slaves = bus.slaves().iter().enumerate().map(|(place, slave)| {
        json!({
            "place": place,
            "axis": axis_at(place),
            "al_state": slave_words(slave),
            "al_status_code": slave.al_status_code,
        })
    });
    json!({
        "state": bus.state.words(),
        "owner_pid": bus.owner_pid,
        "standby": model.has_bus_standby(),
        "frames": counts.sent,
        "missed": counts.missed,
        "short": counts.short,
        "late": counts.late,
        "foreign": counts.foreign,
        "repeated": counts.repeated,
        "round_trip_us": round(bus.round_trip_us(), 3),
        "clock_offset_us": round(bus.clock_offset_us(), 3),
        "slaves": slaves.collect::<Vec<_>>(),
    })
}

fn message(said: &ProgramMessage) -> Value {
    json!({ "number": said.number, "line": said.line, "text": said.text })
}

/// Spindle, coolant, outputs, tool and stops.
fn auxiliary(now: &Auxiliaries) -> Value {
    let levels = &now.levels;
    json!({
        // In words: stopped, a speed and a direction, or an angle.
        "spindle": report::auxiliary::spindle(levels),
        "spindle_command_rpm": rounded(levels.spindle_rpm, 3),
        "spindle_rpm": rounded(now.spindle_rpm, 3),
        "at_speed": now.at_speed == 1,
        "mist": levels.coolant & MIST != 0,
        "flood": levels.coolant & FLOOD != 0,
        "tool": now.tool,
        "tool_prepared": levels.tool_prepared,
        "digital_outputs": report::auxiliary::digital_outputs(levels),
        "analog_outputs": levels.analog,
        // What is waited for, in words, and its line.
        "waiting": monitor::words::waiting(now),
        // The line that the program is to begin at, until the tool is there.
        "start_line": (now.start_line != 0).then_some(now.start_line),
        "events_done": now.events_done,
        "optional_stop": now.optional_stop == 1,
        "override_enabled": now.override_disabled == 0,
    })
}

fn remote(model: &Model, link: &LinkView) -> Value {
    json!({
        "server": link.to,
        "data_age_s_max": link.age_s.map(|(_, max_s)| rounded(max_s, 4)),
        "data_age_s_min": link.age_s.map(|(min_s, _)| rounded(min_s, 4)),
        "round_trip_s": round(link.round_trip_s, 4),
        "link_lost": link.lost,
        "silent_s": rounded(link.silent_s, 3),
        "snapshots": link.snapshots,
        "snapshots_lost": link.snapshots_lost,
        "messages_refused": link.refused,
        "messages_dropped": link.dropped,
        "events": model.events.count,
        "events_lost": link.events_lost,
    })
}

fn program(model: &Model) -> Value {
    let block = model.block();
    let feedback = model.feedback.as_ref();
    let on_path = feedback.filter(|feedback| !feedback.tag.is_off_path());
    let planner = model.planner.as_ref();
    json!({
        "state": model.program_state().map(ProgramState::word),
        // Counts the programs started.
        "run": feedback.map(|feedback| feedback.run),
        "name": model.program_name(),
        "line": block.map(|(line, _)| line),
        "block": block.map(|(_, text)| text),
        "element": on_path.map(|feedback| feedback.tag.element),
        "percent": model.share_done().map(|share| rounded(share * 100.0, 2)),
        "path_done_mm": planner.map(|status| rounded(status.path_done_mm, 4)),
        "path_length_mm": planner.map(|status| rounded(status.path_length_mm, 4)),
    })
}

/// The digital readout beside the axes.
fn readout(model: &Model, dro: &Dro) -> Value {
    let auxiliary = model.feedback.as_ref().map(|feedback| &feedback.auxiliary);
    let block = model.block();
    let rotary = dro.is_feed_of_rotary;
    let feed = round(dro.feed_mm_min, 1);
    let programmed = round(dro.programmed_feed_mm_min, 3);
    let readout = json!({
        "work_offset": dro.work_offset,
        "tool": auxiliary.map(|now| now.tool),
        "feed_mm_min": feed.filter(|_| !rotary),
        "programmed_feed_mm_min": programmed.filter(|_| !rotary),
        // Where only rotary axes move, in place of both.
        "feed_deg_min": feed.filter(|_| rotary),
        "programmed_feed_deg_min": programmed.filter(|_| rotary),
        "rapid": dro.rapid,
        "spindle_rpm": auxiliary.map(|now| rounded(now.spindle_rpm, 3)),
        "programmed_spindle_rpm": auxiliary.map(|now| rounded(now.levels.spindle_rpm, 3)),
        // As the program has them, in its units.
        "feed_word": dro.feed_word,
        "speed_word": dro.speed_word,
        "active_codes": dro.active_codes,
        "block_line": block.map(|(line, _)| line),
        "block_text": block.map(|(_, text)| text),
        // An estimate: without what braking and stops take.
        "time_left_s": round(dro.time_left_s, 1),
        "time_left_is_estimate": true,
    });
    without_missing(readout, &["feed_deg_min", "programmed_feed_deg_min"])
}

/// What an axis has in mm or in degrees: a slide, or a rotary axis. Inside, a degree is what a mm is.
fn own_units(dro: &Dro, index: usize, axis: &AxisView) -> Value {
    let of = |values: &[Option<f64>]| round(values.get(index).copied().flatten(), 6);
    let length = dro.tool_length.as_ref().and_then(|all| all.get(index));
    let (mm, um) = (axis.unit, thousandth_of(axis.unit));
    json!({
        (format!("command_{mm}")): rounded(axis.now.command_mm, 6),
        (format!("feedback_{mm}")): rounded(axis.now.feedback_mm, 6),
        (format!("work_{mm}")): of(&dro.work),
        (format!("machine_{mm}")): rounded(axis.now.command_mm, 6),
        (format!("distance_to_go_{mm}")): of(&dro.distance_to_go),
        (format!("tool_length_{mm}")): round(length.copied(), 6),
        (format!("velocity_{mm}_s")): rounded(axis.now.velocity_mm_s, 4),
        (format!("velocity_command_{mm}_s")): axis.now.command.map(|c| rounded(c.velocity_mm_s, 4)),
        (format!("following_error_{um}")): round(axis.now.error_um, 3),
        (format!("following_error_peak_{um}")): rounded(axis.now.error_peak_um, 3),
    })
}

/// The unit of deviations in names, of axes whose positions have this one.
pub fn thousandth_of(unit: &str) -> &'static str {
    match unit {
        "deg" => "mdeg",
        _ => "um",
    }
}

fn axis(model: &Model, dro: &Dro, index: usize, axis: &AxisView) -> Value {
    let name = json!({ "axis": axis.name, "unit": axis.unit });
    let rest = json!({
        "torque_command_nm": axis.now.command.map(|c| rounded(c.torque_nm, 4)),
        "torque_nm": rounded(axis.now.torque_nm, 4),
        "torque_percent": rounded(axis.torque_share() * 100.0, 2),
        "torque_limited": axis.now.torque_limited,
        "winding_k": rounded(axis.now.winding_k, 3),
        "friction_level": axis.friction().map(|(level, _)| rounded(level, 4)),
        "friction_unexplained": axis.friction().map(|(_, part)| rounded(part, 4)),
        "missed_scans": axis.now.missed_scans,
        "servo": ROLES.get(axis.now.role as usize).copied().unwrap_or("?"),
        "standby": axis.redundancy().words(),
        "standby_differences": axis.now.differences,
        "reference": axis.reference_words(),
        // Of the second motor of a gantry: its position less that of the axis's first.
        "skew_um": round(model.skew_um(index), 3),
        "alarm": model.standby_alarm(axis),
    });
    let rest = without_missing(rest, &["skew_um"]);
    joined(joined(name, own_units(dro, index, axis)), rest)
}

/// An object with the fields of another behind its own.
pub fn joined(mut first: Value, second: Value) -> Value {
    if let (Value::Object(fields), Value::Object(more)) = (&mut first, second) {
        fields.extend(more);
    }
    first
}

fn axes(model: &Model, dro: &Dro) -> Vec<Value> {
    let each = model.axes.iter().enumerate();
    each.map(|(index, of)| axis(model, dro, index, of))
        .collect()
}

fn processes(model: &Model) -> Vec<Value> {
    let each = model.processes().into_iter().map(|process| {
        let redundancy = process.redundancy.and_then(Redundancy::from_wire);
        json!({
            "process": process.name,
            "job": process.job,
            "pid": process.pid,
            "starts": process.starts,
            "live": process.live,
            "stalled": process.stalled,
            "drives": process.drives,
            "standby": redundancy.map(Redundancy::words),
            "age_scans": process.age_scans,
            "last_death": process
                .death
                .map(|(scan, signal)| json!({ "scan": scan, "signal": signal })),
        })
    });
    each.collect()
}

/// One look, over several lines.
pub fn status(model: &Model) -> String {
    format!("{:#}", state(model))
}

/// A reversal, rounded to so many digits.
pub fn reversal(model: &Model, reversal: &ReversalState, digits: i32) -> Value {
    let of = model.axes.get(reversal.axis as usize);
    let um = thousandth_of(of.map_or("mm", |axis| axis.unit));
    json!({
        "axis": model.machine.axis_name(reversal.axis as usize),
        "new_direction": reversal.direction,
        "scan": reversal.scan,
        "height_um": round(reversal.height_um, digits),
        "undercut_um": round(reversal.undercut_um, digits),
        (format!("following_error_peak_{um}")): rounded(reversal.error_peak_um, digits),
    })
}

/// An event.
pub fn event(event: &Event) -> Value {
    json!({
        "scan": event.scan,
        "event": event.text,
        "warning": event.weight == Weight::Warning,
    })
}

/// One line of the monitor, with the reversals and events since the line before.
pub fn line(model: &Model, reported: &mut Reported) -> String {
    let fresh = |count: u64, before: &mut u64, kept: usize| {
        let new = usize::try_from(count - std::mem::replace(before, count)).unwrap_or(kept);
        kept.saturating_sub(new)
    };
    let (reversals, events) = (&model.reversals, &model.events);
    let kept = reversals.last.len();
    let first = fresh(reversals.count, &mut reported.reversals, kept);
    let fresh_reversals = reversals.last.iter().skip(first);
    let first = fresh(events.count, &mut reported.events, events.last.len());
    let fresh_events = events.last.iter().skip(first);
    let circle = &model.circle;
    let rest = json!({
        "circle": circle.circle.as_ref().map(|shape| json!({
            "plane": shape.plane,
            "line": shape.line,
            "radius_mm": shape.radius_mm,
            "feed_mm_min": round(shape.feed_mm_s.map(|feed_mm_s| feed_mm_s * 60.0), 3),
            "running": circle.running,
            "radial_deviation_um": circle
                .range_um()
                .map(|(min, max)| json!({ "min": rounded(min, 3), "max": rounded(max, 3) })),
        })),
        "reversals": fresh_reversals.map(|of| reversal(model, of, 3)).collect::<Vec<_>>(),
        "events": fresh_events.map(event).collect::<Vec<_>>(),
        "timing": model.timing.summary().map(|summary| json!({
            "periods": summary.count,
            "period_us": {
                "p50": rounded(summary.p50_us, 1),
                "p99": rounded(summary.p99_us, 1),
                "max": rounded(summary.max_us, 1),
            },
        })),
        "scans_seen": model.seen_scans.0,
        "scans_not_seen": model.seen_scans.1,
    });
    joined(state(model), rest).to_string()
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
