//! `quadrant report A --against B`: before and after a change of the machine file.

use std::fs;

use serde_json::Value;

use crate::support::{Bench, circle_program, number, quadrant, run};

#[test]
#[expect(
    clippy::too_many_lines,
    reason = "one pair of runs for all that is compared"
)]
fn a_better_compensation_shows_in_the_report_of_one_run_against_the_other() {
    let (model, pulse) = (Bench::of("xy", &[]), Bench::without_model("xy", &[]));
    let text = circle_program(25.0, 3_000.0, (0.0, 0.0), 45.0);
    let after = run(model.path(), model.file("circle.ngc", &text));
    let before = run(pulse.path(), pulse.file("circle.ngc", &text));
    let (of_after, of_before) = (after.good_report(), before.good_report());
    for one in [&after, &before] {
        let page = fs::read_to_string(one.out.join("report.html")).expect("every run's page");
        assert!(page.contains("<b>Completed.</b>"), "{page:.2000}");
    }

    let report = |more: &[&str]| {
        let mut command = quadrant();
        command.arg("report").arg(&after.out).arg("--against");
        let output = command.arg(&before.out).args(more).output();
        output.expect("running quadrant")
    };
    let printed = report(&["--json"]);
    let complaint = String::from_utf8_lossy(&printed.stderr).into_owned();
    assert_eq!(printed.status.code(), Some(0), "{complaint}");
    let json: Value = serde_json::from_slice(&printed.stdout).expect("JSON");
    assert_eq!(json["same_motion"], false);
    // The numbers are those of the runs' own reports.
    for (there, here) in [
        (
            "/axes/0/following_error_um/peak",
            "/axes/0/following_error_um/peak",
        ),
        (
            "/axes/1/following_error_um/p99",
            "/axes/1/following_error_um/p99",
        ),
        ("/contour_error_um/peak", "/contour_error_um/peak"),
        (
            "/arcs/0/circular_deviation_um",
            "/arcs/0/circular_deviation_um",
        ),
    ] {
        assert_eq!(
            number(&json, &format!("{here}/a")),
            number(&of_after, there)
        );
        assert_eq!(
            number(&json, &format!("{here}/b")),
            number(&of_before, there)
        );
    }
    // Every reversal that both measured found its counterpart, and the model beats the friction pulse at each.
    let reversals = json["reversals"].as_array().expect("reversals");
    let measured = of_after["reversals"].as_array().expect("reversals");
    let measured = measured.iter().filter(|r| r["protrusion_um"].is_number());
    assert_eq!(reversals.len(), measured.count());
    assert!(reversals.len() >= 12, "only {}", reversals.len());
    for reversal in reversals {
        assert!(
            number(reversal, "/protrusion_um/difference") < 0.0,
            "{reversal}"
        );
    }
    let settings = json["settings"].as_array().expect("settings");
    let method = settings
        .iter()
        .find(|s| s["key"] == "axis X.reversal.method");
    assert_eq!(
        method.expect("the method differs")["b"],
        "\"friction-pulse\""
    );

    let printed = report(&[]);
    let text = String::from_utf8_lossy(&printed.stdout).into_owned();
    let title = "Protrusion of each reversal on an arc, in µm";
    assert!(text.contains(title), "{text}");
    let name = before.out.file_name().expect("a name").to_string_lossy();
    let folder = after.out.join(format!("against-{name}"));
    for file in [
        "report.txt",
        "report.html",
        "report.json",
        "tracking.svg",
        "circle-1.svg",
    ] {
        assert!(folder.join(file).exists(), "{file} is missing");
    }
    // Its own report can be made again with the comparison beside it.
    let again = quadrant()
        .arg("report")
        .arg(&after.out)
        .output()
        .expect("running quadrant");
    assert_eq!(again.status.code(), Some(0));

    let other = run(model.path(), model.file("circle.ngc", &text_of_other()));
    let mut command = quadrant();
    command.arg("report").arg(&after.out).arg("--against");
    let refused = command.arg(&other.out).output().expect("running quadrant");
    let complaint = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{complaint}");
    assert!(
        complaint.contains("their programs") && complaint.contains("F2000"),
        "{complaint}"
    );
}

fn text_of_other() -> String {
    circle_program(25.0, 2_000.0, (0.0, 0.0), 45.0)
}
