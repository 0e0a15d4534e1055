//! When friction pulses start, what position command they start from, and what prediction of the feedback does, on the whole machine.

use serde_json::Value;

use crate::size;
use crate::support::{Bench, circle_program, number, run};

fn measure(bench: &Bench, radius: f64, feed: f64) -> Value {
    let program = bench.file(
        "circle.ngc",
        &circle_program(radius, feed, (0.0, 0.0), 45.0),
    );
    run(bench.path(), &program).good_report()
}

/// The reversals of a run that lie on its circles, in steady motion.
fn steady(report: &Value) -> Vec<&Value> {
    let reversals = report["reversals"].as_array().expect("reversals");
    let found: Vec<&Value> = reversals
        .iter()
        .filter(|r| r["radius_mm"].is_number() && r["steady"] == true)
        .collect();
    assert!(found.len() >= 12, "only {} reversals on arcs", found.len());
    found
}

fn leads_ms(report: &Value) -> Vec<f64> {
    let lead = |r: &&Value| {
        r["kick_lead_ms"]
            .as_f64()
            .expect("every reversal has a pulse")
    };
    steady(report).iter().map(lead).collect()
}

fn worst_um(report: &Value) -> f64 {
    let of = |r: &Value, key: &str| r[key].as_f64().expect("a number");
    steady(report)
        .iter()
        .map(|r| of(r, "protrusion_um").max(-of(r, "undercut_um")))
        .fold(0.0, f64::max)
}

/// `xy` with the source's constant pulse of the same area and another trigger.
fn with_trigger(trigger: &str) -> Bench {
    Bench::without_model(
        "xy",
        &[
            (
                "trigger = \"command-acceleration\"",
                &format!("trigger = \"{trigger}\""),
            ),
            ("shape = \"decaying\"", "shape = \"constant\""),
            ("presliding_um = 7.0", "presliding_um = 0.0"),
            ("presliding_um = 7.2", "presliding_um = 0.0"),
            ("pulse_ms = 10.0", "pulse_ms = 22.5"),
            ("pulse_mm_s = 3.48", "pulse_mm_s = 1.56"),
            ("pulse_mm_s = 4.1", "pulse_mm_s = 1.83"),
        ],
    )
}

#[test]
fn the_pulse_starts_its_lead_before_the_reversal_at_every_radius_and_feed() {
    let bench = Bench::without_model("xy", &[]);
    let (lead_ms, scan_ms) = (5.5, 1.0);
    let circles = [
        (10.0, 9_000.0),
        (140.0, 3_000.0),
        (5.0, 500.0),
        (25.0, 1_000.0),
        (60.0, 14_000.0),
    ];
    for (radius, feed) in size::one_in(2, circles) {
        let report = measure(&bench, radius, feed);
        assert_eq!(report["reversals"][0]["trigger"], "command-acceleration");
        // Rows a few increments apart: the report knows the instant of the reversal to half a scan.
        let acceleration_mm_s2 = (feed / 60.0) * (feed / 60.0) / radius;
        let rounding_ms = if acceleration_mm_s2 < 20.0 {
            0.51
        } else {
            0.05
        };
        for lead in leads_ms(&report) {
            assert!(
                lead > lead_ms - scan_ms - rounding_ms && lead <= lead_ms + rounding_ms,
                "R{radius} F{feed}: the pulse led by {lead} ms"
            );
        }
    }
}

#[test]
fn older_triggers_start_later_and_leave_more_on_fast_circles() {
    let of = |trigger: &str| {
        let report = measure(&with_trigger(trigger), 10.0, 10_000.0);
        assert_eq!(report["reversals"][0]["trigger"], trigger);
        let leads = leads_ms(&report);
        let mean = leads.iter().sum::<f64>() / leads.len() as f64;
        (mean, worst_um(&report))
    };
    let (error_ms, error_um) = of("position-error");
    let (forward_ms, forward_um) = of("feed-forward");
    let (command_ms, command_um) = of("velocity-command");
    let (own_ms, own_um) = of("command-acceleration");
    // The position error turns with the backlash step at the command's reversal; the feed-forward is taken 2.25 ms ahead,
    // of which one scan is its own smoothing.
    assert!((-1.5..0.5).contains(&error_ms), "{error_ms} ms");
    assert!((0.2..2.25).contains(&forward_ms), "{forward_ms} ms");
    assert!((0.5..4.5).contains(&command_ms), "{command_ms} ms");
    assert!((4.5..5.5).contains(&own_ms), "{own_ms} ms");
    for (older, worst) in [
        ("position-error", error_um),
        ("feed-forward", forward_um),
        ("velocity-command", command_um),
    ] {
        assert!(
            own_um < 0.8 * worst,
            "{older}: {worst} µm, command-acceleration {own_um} µm"
        );
    }
}

#[test]
fn a_position_error_judged_in_full_moves_the_start_on_slow_circles_and_a_clamped_one_less() {
    // A feed-forward of 80 % leaves the position loop a fifth of the speed, which it lags behind by 1/Kp.
    let shift_ms = |part: &str| {
        let line = format!("lead_ms = 5.5\nposition_error_part = \"{part}\"");
        let bench = Bench::without_model(
            "xy",
            &[
                ("lead_ms = 5.5", &line),
                ("coefficient = 1.0", "coefficient = 0.8"),
            ],
        );
        let leads = leads_ms(&measure(&bench, 10.0, 500.0));
        // The middle of (lead − Tp, lead].
        let shifts = leads.iter().map(|lead| (lead - 5.0).abs());
        shifts.fold(0.0, f64::max)
    };
    let (none, clamped, full) = (shift_ms("none"), shift_ms("clamped"), shift_ms("full"));
    // Half a scan of quantisation, half a scan of the report's rounding; half the lead more where it is clamped.
    assert!(none <= 1.01, "{none} ms");
    assert!((1.01..1.01 + 2.75).contains(&clamped), "{clamped} ms");
    assert!(full > 1.01 + 2.75, "{full} ms");
}

#[test]
fn linear_interpolation_cost_the_sagitta_of_a_period_and_break_no_limit() {
    let even = [(
        "watchdog_scans = 50",
        "watchdog_scans = 50\n\n[interpolation]\nwithin_period = \"linear\"\n#",
    )];
    for (radius, feed) in [(10.0, 10_000.0), (25.0, 10_000.0)] {
        let exact = measure(&Bench::without_model("xy", &[]), radius, feed);
        let split = measure(&Bench::without_model("xy", &even), radius, feed);
        let chord_mm = feed / 60.0 * 8e-3;
        let sagitta_um = chord_mm * chord_mm / (8.0 * radius) * 1e3;
        assert!((8.5..22.5).contains(&sagitta_um));
        let radius_um = |report: &Value| number(report, "/arcs/0/radius_error_um");
        // A chord lies inside its arc by two thirds of the sagitta on average.
        let smaller = radius_um(&exact) - radius_um(&split);
        assert!(
            (0.75..1.1).contains(&(smaller / (sagitta_um * 2.0 / 3.0))),
            "R{radius} F{feed}: {smaller} µm smaller, sagitta {sagitta_um} µm"
        );
        for key in ["velocity", "acceleration", "travel"] {
            assert_eq!(number(&split, &format!("/limits/{key}_exceeded")), 0.0);
        }
        assert_eq!(split["samples_lost"], 0);
    }
}

#[test]
fn prediction_of_the_feedback_calms_a_stiff_loop_and_its_noise_is_reported() {
    let stiff = ("gain_per_s = 50.0", "gain_per_s = 260.0");
    let predicting = |m: &str| {
        let table = format!("[axis.prediction]\nm = {m}\n\n[axis.reversal]");
        Bench::without_model("xy", &[stiff, ("[axis.reversal]", &table)])
    };
    let without = measure(&Bench::without_model("xy", &[stiff]), 25.0, 3_000.0);
    let with = measure(&predicting("0.4"), 25.0, 3_000.0);
    let near = measure(&predicting("0.8"), 25.0, 3_000.0);
    assert!(without["axes"][0]["prediction"].is_null());
    let contour = |report: &Value| number(report, "/contour_error_um/peak");
    assert!(
        contour(&with) < 0.5 * contour(&without),
        "{} and {} µm",
        contour(&with),
        contour(&without)
    );
    let following = |report: &Value| number(report, "/axes/0/following_error_um/peak");
    assert!(following(&with) < 0.8 * following(&without));
    let of = |report: &Value, key: &str| number(report, &format!("/axes/0/prediction/{key}"));
    assert_eq!(of(&with, "horizon_ms"), 2.5);
    assert!(of(&with, "predicted_error_um") < 0.1 * of(&with, "unpredicted_error_um"));
    // Twice as far ahead is twice the noise added, here with what the calmer loop changes in the motion itself.
    let noise = of(&with, "added_noise_um") / of(&near, "added_noise_um");
    assert!((1.6..2.6).contains(&noise), "{noise}");
    let speed = of(&with, "added_noise_mm_s") / of(&with, "added_noise_um");
    assert!((speed / 0.26 - 1.0).abs() < 0.01, "{speed}");
}
