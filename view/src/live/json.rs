//! A model as JSON: names end in units and stay what they are. What is in mm or µm of a slide
//! is in degrees or thousandths of a degree of a rotary axis, under names that say so; null is what cannot be known.

use remote::state::{CellState, ReversalState};
use serde_json::{Value, json};

use super::events::{Event, Weight};
use super::model::Model;
use super::state::{round, rounded};

/// How far a reader of lines is: what came before is not reported again.
#[derive(Debug, Default, Clone, Copy)]
pub struct Reported {
    reversals: u64,
    events: u64,
}

/// What is known of the cell, as `status --json` prints it.
pub fn state(state: &CellState) -> Value {
    let mut value = json!(state);
    let axes = value.get_mut("axes").and_then(Value::as_array_mut);
    axes.into_iter().flatten().for_each(name_own_units);
    value
}

/// Inside, a degree is what a mm is; outside, names say what they are.
fn name_own_units(axis: &mut Value) {
    let Value::Object(fields) = axis else {
        return;
    };
    if fields.get("unit").and_then(Value::as_str) == Some("deg") {
        let named = std::mem::take(fields).into_iter().map(|(name, value)| {
            let own = match name.as_str() {
                "skew_um" => name,
                _ => name.replace("_mm", "_deg").replace("_um", "_mdeg"),
            };
            (own, value)
        });
        *fields = named.collect();
    }
}

/// The unit of deviations in names, of axes whose positions have this one.
pub fn thousandth_of(unit: &str) -> &'static str {
    match unit {
        "deg" => "mdeg",
        _ => "um",
    }
}

/// An object with the fields of another behind its own.
pub fn joined(mut first: Value, second: Value) -> Value {
    if let (Value::Object(fields), Value::Object(more)) = (&mut first, second) {
        fields.extend(more);
    }
    first
}

/// One look, over several lines.
pub fn status(model: &Model) -> String {
    format!("{:#}", state(&model.shown.state))
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
    let shown = &model.shown;
    let rest = json!({
        "circle": shown.circle.as_ref().map(|circle| json!({
            "plane": circle.plane,
            "line": circle.line,
            "radius_mm": circle.radius_mm,
            "feed_mm_min": circle.feed_mm_min,
            "running": circle.running,
            "radial_deviation_um": circle
                .range_um()
                .map(|(min, max)| json!({ "min": min, "max": max })),
        })),
        "reversals": fresh_reversals.map(|of| reversal(model, of, 3)).collect::<Vec<_>>(),
        "events": fresh_events.map(event).collect::<Vec<_>>(),
        "timing": shown.timing.as_ref().map(|timing| json!({
            "periods": timing.periods,
            "period_us": { "p50": timing.p50_us, "p99": timing.p99_us, "max": timing.max_us },
        })),
        "scans_seen": model.seen_scans.0,
        "scans_not_seen": model.seen_scans.1,
    });
    joined(state(&shown.state), rest).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::test_support::{look, machine, running};

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
        let value = |model: &mut Model| -> serde_json::Value {
            look(model);
            serde_json::from_str(&status(model)).expect("JSON")
        };
        assert_eq!(value(&mut model).get("bus"), None);
        model.bus = Some(crate::live::fieldbus::tests::example());
        let value = value(&mut model);
        let bus = &value["bus"];
        assert_eq!(bus["state"], "in operation in part");
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
        let mut model = Model::new("t", machine());
        look(&mut model);
        let value: serde_json::Value = serde_json::from_str(&status(&model)).expect("JSON");
        assert!(value["mode"].is_null());
        assert_eq!(value["axes"][1]["axis"], "Y");
    }
}
