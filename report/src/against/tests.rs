//! Two synthetic runs held against each other.

use std::path::Path;

use super::*;
use crate::match_up::matched;
use crate::side_by_side::Compared;
use crate::test_support::Deviation;
use crate::tests::{DEVIATION, run_directory, run_directory_of};

fn compared(a: f64, b: f64) -> Compared {
    Compared::of(Some(a), Some(b))
}

/// Runs whose reversals protrude by 0.0052 … 0.0083 mm (A), and by twice that (B).
fn two_runs(folder: &Path) -> (PathBuf, PathBuf) {
    let (a, b) = (folder.join("after"), folder.join("before"));
    std::fs::create_dir_all(&a).unwrap();
    std::fs::create_dir_all(&b).unwrap();
    run_directory(&a);
    let worse = Deviation {
        bump_mm: DEVIATION.bump_mm.map(|mm| mm * 2.0),
        ..DEVIATION
    };
    run_directory_of(&b, worse, std::iter::empty());
    (a, b)
}

fn setting(a: Option<&str>) -> Setting {
    Setting {
        file: "machine.toml".into(),
        key: "axis X.reversal.<method>".into(),
        a: a.map(str::to_string),
        b: Some("\"pulse\"".repeat(40)),
    }
}

#[test]
fn a_difference_has_its_sign_and_its_share_of_b() {
    let down = compared(1.0, 4.0);
    assert_eq!((down.difference, down.per_cent), (Some(-3.0), Some(-75.0)));
    let undercut = compared(-1.0, -4.0);
    assert_eq!(
        (undercut.difference, undercut.per_cent),
        (Some(3.0), Some(75.0))
    );
    let from_nothing = compared(2.0, 0.0);
    assert_eq!(
        (from_nothing.difference, from_nothing.per_cent),
        (Some(2.0), None)
    );
    let alone = Compared::of(Some(2.0), None);
    assert_eq!((alone.difference, alone.per_cent), (None, None));
}

#[test]
fn the_same_things_are_matched_by_key_and_order_and_the_rest_stands_alone() {
    let (a, b) = ([1, 2, 1, 3], [1, 3, 3, 4]);
    let pairs = matched(&a, &b, |number| *number);
    let places: Vec<(Option<i32>, Option<i32>, usize)> = pairs
        .iter()
        .map(|pair| (pair.a.copied(), pair.b.copied(), pair.order))
        .collect();
    assert_eq!(
        places,
        [
            (Some(1), Some(1), 1),
            (Some(2), None, 1),
            (Some(1), None, 2),
            (Some(3), Some(3), 1),
            (None, Some(3), 2),
            (None, Some(4), 1),
        ]
    );
    // Each is the very one, not an equal one.
    assert!(std::ptr::eq(pairs[3].b.unwrap(), &b[1]));
}

#[test]
fn a_comparison_says_what_became_better_and_is_made_again_to_the_byte() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = two_runs(dir.path());
    let settings = vec![setting(None); 60];
    let written = make_against(&a, &b, settings.clone()).unwrap();
    assert_eq!(written.folder, a.join("against-before"));
    let names = [
        "report.txt",
        "report.html",
        "report.json",
        "tracking.svg",
        "circle-1.svg",
        "circle-3.svg",
    ];
    let read = |name: &str| std::fs::read_to_string(written.folder.join(name)).unwrap();
    let first = names.map(read);
    assert_eq!((&first[0], &first[2]), (&written.text, &written.json));
    make_against(&a, &b, settings).unwrap();
    assert!(names.map(read) == first, "not made again to the byte");
    assert!(!b.join("report.json").exists(), "nothing is written into B");

    let json: serde_json::Value = serde_json::from_str(&written.json).unwrap();
    let number = |pointer: &str| json.pointer(pointer).and_then(|v| v.as_f64()).unwrap();
    let worst = number("/protrusions_um/worst/a");
    assert!((worst - 8.3).abs() < 0.3, "{worst}");
    assert!((number("/protrusions_um/worst/b") - 2.0 * worst).abs() < 0.6);
    assert!((number("/protrusions_um/mean/per_cent") + 50.0).abs() < 3.0);
    for (index, reversal) in json["reversals"].as_array().unwrap().iter().enumerate() {
        let values = &reversal["protrusion_um"];
        let (of_a, of_b) = (values["a"].as_f64(), values["b"].as_f64());
        let (of_a, of_b) = (of_a.expect("in A"), of_b.expect("in B"));
        let difference = values["difference"].as_f64().unwrap();
        assert!((difference - (of_a - of_b)).abs() < 0.001, "{index}");
        assert!(difference < -4.0, "{index}: {difference}");
    }
    assert_eq!(json["arcs"].as_array().unwrap().len(), 3);
    assert!(number("/arcs/0/circular_deviation_um/difference") < -4.0);
    assert_eq!(number("/machine_time_s/difference"), 0.0);

    for line in written.text.lines() {
        assert!(line.chars().count() <= 88, "{line}");
    }
    assert!(written.text.contains("  … and 40 more in report.json"));
    assert!(written.text.contains("A  after, lockstep\n   COMPLETED"));
    let page = &first[1];
    assert!(!page.contains("<method>") && page.contains("&lt;method&gt;"));
    assert_eq!(page.matches("<svg ").count(), 1 + 3);
}

#[test]
fn runs_of_other_machines_or_programs_are_refused_with_what_differs() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = two_runs(dir.path());
    let refusal = || make_against(&a, &b, Vec::new()).err().unwrap().to_string();
    let same = make_against(&a, &a, Vec::new()).err().unwrap().to_string();
    assert!(same.contains("it is the same run"), "{same}");

    let machine = std::fs::read_to_string(b.join("machine.toml")).unwrap();
    let other = machine.replace("name = \"test\"", "name = \"other\"");
    std::fs::write(b.join("machine.toml"), &other).unwrap();
    let text = refusal();
    assert!(text.contains("their machines are test and other"), "{text}");
    assert!(!text.contains("programs,"), "{text}");
    std::fs::write(b.join("machine.toml"), &machine).unwrap();

    let program = std::fs::read_to_string(b.join("circle.ngc")).unwrap();
    std::fs::write(b.join("circle.ngc"), program.replace("F3000", "F2000")).unwrap();
    let text = refusal();
    assert!(
        text.contains("differ from line 4 on: \"G3 X25 Y0 I-25 J0 P2 F3000\" and \"G3 X25 Y0 I-25 J0 P2 F2000\""),
        "{text}"
    );
    assert!(!a.join("against-before").exists(), "nothing was written");
    // Ends of lines are no difference.
    std::fs::write(b.join("circle.ngc"), program.replace('\n', "\r\n")).unwrap();
    assert!(make_against(&a, &b, Vec::new()).is_ok());
}
