//! The report of a real run says where its errors come from.

use std::fs;

use serde_json::Value;

use crate::support::{Bench, circle_program, number, quadrant, run};

/// Lost motion of the plant, gap and wind-up 2·F/k, in µm: docs/methods/physics.md §3.
const LOST_MOTION_UM: [(&str, f64); 2] = [("X", 8.3), ("Y", 12.3)];

fn of<'a>(causes: &'a Value, cause: &str, axis: &str) -> Vec<&'a Value> {
    let all = causes.as_array().expect("a list");
    let all = all.iter();
    all.filter(|one| one["cause"] == cause && one["axis"] == axis)
        .collect()
}

/// The lost motion that is built into the machine is the one that the report finds from circles, where nothing makes up for it.
#[test]
fn a_run_without_compensation_shows_the_lost_motion_of_the_plant_and_its_reversal_spikes() {
    let none = ("\"contact-force\"", "\"none\"");
    let no_friction = ("\nfriction = true", "\nfriction = false");
    let no_observer = ("bandwidth_rad_s = 200.0", "bandwidth_rad_s = 0.0");
    let no_adaptation = ("mode = \"on\"", "mode = \"off\"");
    let bench = Bench::of("xy-fast", &[none, no_friction, no_observer, no_adaptation]);
    let text = circle_program(25.0, 3_000.0, (0.0, 0.0), 45.0);
    let run = run(bench.path(), bench.file("circle.ngc", &text));
    let report = run.good_report();
    let bar = &report["ball_bar"][0];
    for (axis, size_um) in LOST_MOTION_UM {
        let lost = of(&bar["causes"], "lost-motion", axis);
        assert_eq!(lost.len(), 2, "both ends of {axis}: {bar}");
        for one in lost {
            let value_um = number(one, "/value");
            assert!((value_um - size_um).abs() < 1.0, "{axis}: {one}");
        }
        let spikes = of(&bar["causes"], "reversal-spike", axis);
        assert_eq!(spikes.len(), 2, "both ends of {axis}: {bar}");
        assert!(spikes.iter().all(|one| number(one, "/value") > 10.0));
    }
    assert!(number(bar, "/rest_rms_um") < 0.2 * number(bar, "/deviation_rms_um"));
    let both_um = number(bar, "/bidirectional_deviation_um");
    for way in ["counter_clockwise", "clockwise"] {
        let one_um = number(bar, &format!("/{way}/circular_deviation_um"));
        assert!((0.9 * both_um..=both_um + 0.5).contains(&one_um), "{bar}");
    }
    let parts = &report["contour_parts"]["parts"];
    // Lost motion and reversals of both axes come before everything else.
    for index in 0..4 {
        let cause = &parts[index]["cause"];
        assert!(cause == "reversal" || cause == "lost-motion", "{parts}");
    }

    // Made again, it is the same to the byte.
    let file = run.out.join("report.json");
    let before = fs::read(&file).expect("report.json");
    let output = quadrant().arg("report").arg(&run.out).output();
    assert!(output.expect("running quadrant").status.success());
    assert_eq!(fs::read(&file).expect("report.json"), before);
}
