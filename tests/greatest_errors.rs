//! The greatest contour errors of a run, each with the block that it was in.

use std::fs;

use crate::support::{Bench, number, run};

/// Corners of 90° that are rounded by 0.2 mm and by 0.05 mm, and one that is exact.
const PROGRAM: &str = "G21 G17 G90 G94
G0 X0 Y0
G64 P0.2
G1 X40 F3000 (first corner)
G1 Y40
G64 P0.05
G1 X0 (second corner)
G1 Y10
G61
G1 X-20
G1 Y30
M2
";

#[test]
fn the_greatest_contour_errors_stand_with_their_blocks_in_report_text_and_picture() {
    let bench = Bench::of("xy", &[]);
    let run = run(bench.path(), bench.file("corners.ngc", PROGRAM));
    let report = run.good_report();
    let peaks = report["contour_peaks"].as_array().expect("a list");
    assert!((2..=5).contains(&peaks.len()), "{peaks:?}");
    let greatest_um = number(&report, "/contour_error_um/peak");
    assert_eq!(number(&peaks[0], "/contour_error_um"), greatest_um);
    // Half of a rounded corner is in either block.
    let first = peaks[0]["text"].as_str().expect("a text");
    assert!(
        first == "G1 X40 F3000 (first corner)" || first == "G1 Y40",
        "{peaks:?}"
    );
    let place = &peaks[0]["position_mm"];
    let away_mm = (number(place, "/X") - 40.0).hypot(number(place, "/Y"));
    assert!(away_mm < 1.0, "{place}");
    for pair in peaks.windows(2) {
        assert!(number(&pair[0], "/contour_error_um") >= number(&pair[1], "/contour_error_um"));
    }
    let text = fs::read_to_string(run.out.join("report.txt")).expect("report.txt");
    assert!(
        text.contains("Greatest contour errors") && text.contains(first),
        "{text}"
    );
    assert!(text.contains("Picture path.svg"), "{text}");
    let picture = fs::read_to_string(run.out.join("path.svg")).expect("path.svg");
    let line = peaks[0]["block"].as_u64().expect("a line");
    assert!(
        picture.contains(&format!("line {line}: {first}")),
        "{picture}"
    );
}
