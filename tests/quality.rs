//! What the machine makes of a circle: protrusions without compensation, and how much of them it removes.

use serde_json::Value;

use crate::size;
use crate::support::{Bench, circle_program, number, run};

/// Largest protrusion or undercut of a run, in µm, on the table.
pub fn worst_um(report: &Value) -> f64 {
    let reversals = report["reversals"].as_array().expect("reversals");
    let on_arcs: Vec<&Value> = reversals
        .iter()
        .filter(|r| r["radius_mm"].is_number() && r["steady"] == true)
        .collect();
    assert!(
        on_arcs.len() >= 12,
        "only {} reversals on arcs: {report}",
        on_arcs.len()
    );
    on_arcs
        .iter()
        .map(|r| {
            let outward = r["protrusion_um"].as_f64().unwrap_or(f64::NAN);
            let inward = r["undercut_um"].as_f64().unwrap_or(f64::NAN);
            outward.max(-inward)
        })
        .fold(0.0, f64::max)
}

/// The reference machine without the torque that its model feeds forward, compensating by `method`.
fn by_method(method: &str) -> Bench {
    let method = format!("method = \"{method}\"");
    Bench::of(
        "xy",
        &[
            ("method = \"contact-force\"", &method),
            ("acceleration = true", "acceleration = false"),
            ("viscous = true", "viscous = false"),
            ("friction = true", "friction = false"),
            ("mode = \"on\"", "mode = \"off\""),
        ],
    )
}

pub fn measure(bench: &Bench, radius: f64, feed: f64, centre: (f64, f64), start_deg: f64) -> Value {
    let program = bench.file(
        "circle.ngc",
        &circle_program(radius, feed, centre, start_deg),
    );
    run(bench.path(), &program).good_report()
}

#[test]
fn without_compensation_the_reference_circle_shows_protrusions_of_20_to_35_um() {
    let bench = by_method("none");
    let worst = worst_um(&measure(&bench, 25.0, 3000.0, (0.0, 0.0), 0.0));
    assert!((20.0..=35.0).contains(&worst), "{worst} µm");
}

#[test]
fn backlash_acceleration_removes_60_percent_and_the_tuned_model_80_also_at_conditions_nobody_tuned_for()
 {
    let without = by_method("none");
    let with = by_method("friction-pulse");
    let shipped = Bench::of("xy", &[]);
    let circles = [
        (25.0, 3000.0, (0.0, 0.0), 0.0),
        (17.0, 2200.0, (31.0, -12.0), 0.0),
        (38.0, 4700.0, (-40.0, 20.0), 63.0),
        (60.0, 8000.0, (10.0, 5.0), 201.0),
    ];
    for (radius, feed, centre, start_deg) in size::one_in(2, circles) {
        let before = worst_um(&measure(&without, radius, feed, centre, start_deg));
        let after = worst_um(&measure(&with, radius, feed, centre, start_deg));
        assert!(
            after <= 0.4 * before,
            "R{radius} F{feed} around {centre:?} from {start_deg}°: {before:.1} µm without, {after:.1} µm with"
        );
        let modelled = worst_um(&measure(&shipped, radius, feed, centre, start_deg));
        assert!(
            modelled <= 0.2 * before,
            "R{radius} F{feed} around {centre:?} from {start_deg}°: {before:.1} µm without, {modelled:.1} µm with the model"
        );
    }
}

#[test]
fn radius_error_and_centre_are_reported_apart_from_protrusions() {
    let bench = Bench::of("xy", &[]);
    let report = measure(&bench, 10.0, 10_000.0, (5.0, 5.0), 30.0);
    let arcs = report["arcs"].as_array().expect("arcs");
    assert!(!arcs.is_empty());
    for index in 0..arcs.len() {
        assert!(number(&report, &format!("/arcs/{index}/radius_error_um")).is_finite());
        assert!(number(&report, &format!("/arcs/{index}/centre_offset_um/0")).is_finite());
        assert!(number(&report, &format!("/arcs/{index}/circular_deviation_um")) > 0.0);
        assert!((number(&report, &format!("/arcs/{index}/radius_mm")) - 10.0).abs() < 1e-3);
    }
}
