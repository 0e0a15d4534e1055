//! Drilling cycles: where the tool goes, what stays from block to block, and how mistakes are reported.

use crate::common::{at, mill, on_mill, refusal, slide};
use path::geometry::{AxisVector, Element, Feed, Shape};
use program::{EventKind, Setup, interpret};

/// The moves of a program: `R` rapid, `F` feed and `W` wait, with where they end (X, Y, Z) or the seconds.
fn moves(text: &str) -> Vec<String> {
    let program = on_mill(text).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(program.path.first_break(), None);
    program.path.elements.iter().map(printed).collect()
}

fn printed(element: &Element) -> String {
    if let Shape::Dwell { seconds, .. } = element.shape {
        return format!("W {seconds}");
    }
    let end = element.end();
    let how = if element.feed == Feed::Rapid {
        "R"
    } else {
        "F"
    };
    let round = |mm: f64| (mm * 1e6).round() / 1e6;
    format!(
        "{how} {} {} {}",
        round(end[0]),
        round(end[1]),
        round(end[2])
    )
}

#[test]
fn g81_goes_over_the_hole_down_to_r_feeds_and_returns() {
    assert_eq!(
        moves("G0 Z20\nG99 G81 X10 Y5 Z-12 R2 F300\nM2"),
        [
            "R 0 0 20",
            "R 10 5 20",
            "R 10 5 2",
            "F 10 5 -12",
            "R 10 5 2"
        ]
    );
    let feed = on_mill("G81 X1 Z-1 R1 F300").unwrap().path.elements[2].feed;
    assert_eq!(feed, Feed::PathMmS(5.0));
}

#[test]
fn g98_returns_to_where_z_was_before_the_cycles_and_g99_to_r() {
    let holes = |how: &str| moves(&format!("F300 G0 Z20\n{how} G81 X1 Z-5 R2\nX2\nG80\nM2"));
    assert_eq!(
        holes("G98"),
        [
            "R 0 0 20", "R 1 0 20", "R 1 0 2", "F 1 0 -5", "R 1 0 20", "R 2 0 20", "R 2 0 2",
            "F 2 0 -5", "R 2 0 20"
        ]
    );
    assert_eq!(
        holes("G99"),
        [
            "R 0 0 20", "R 1 0 20", "R 1 0 2", "F 1 0 -5", "R 1 0 2", "R 2 0 2", "F 2 0 -5",
            "R 2 0 2"
        ]
    );
    // G98 is there from the start, and its level is that of the first cycle in a row.
    assert_eq!(holes(""), holes("G98"));
    let last = |text: &str| moves(text).pop().unwrap();
    assert_eq!(
        last("F300 G0 Z20\nG99 G81 X1 Z-5 R2\nG98 X2\nM2"),
        "R 2 0 20"
    );
    // Another motion ends the series: the level is read again.
    assert_eq!(
        last("F300 G0 Z20\nG99 G81 X1 Z-5 R2\nG0 Z7\nG98 G81 X2 Z-5 R2\nM2"),
        "R 2 0 7"
    );
}

#[test]
fn a_tool_below_r_first_rises_to_it_and_g98_returns_no_lower() {
    assert_eq!(
        moves("F300 G0 Z-3\nG98 G81 X1 Z-5 R2\nM2"),
        ["R 0 0 -3", "R 0 0 2", "R 1 0 2", "F 1 0 -5", "R 1 0 2"]
    );
}

#[test]
fn g82_waits_at_the_bottom() {
    assert_eq!(
        moves("F300 G0 Z10\nG99 G82 X1 Z-5 R2 P0.25\nX2\nM2")[1..],
        [
            "R 1 0 10", "R 1 0 2", "F 1 0 -5", "W 0.25", "R 1 0 2", "R 2 0 2", "F 2 0 -5",
            "W 0.25", "R 2 0 2"
        ]
    );
    assert!(
        !moves("F300 G99 G82 X1 Z-5 R2 P0\nM2")
            .iter()
            .any(|step| step.starts_with('W'))
    );
}

#[test]
fn g83_pecks_rises_to_r_after_each_and_comes_back_to_just_above_the_bottom() {
    assert_eq!(
        moves("F300 G0 Z10\nG98 G83 X1 Z-10 R2 Q5\nM2")[1..],
        [
            "R 1 0 10",
            "R 1 0 2",
            "F 1 0 -3",
            "R 1 0 2",
            "R 1 0 -2.746",
            "F 1 0 -8",
            "R 1 0 2",
            "R 1 0 -7.746",
            "F 1 0 -10",
            "R 1 0 10"
        ]
    );
    // A depth of whole pecks has no empty one at its end, however the sum rounds.
    let pecks = |text: &str| {
        moves(text)
            .iter()
            .filter(|step| step.starts_with('F'))
            .count()
    };
    assert_eq!(pecks("F300 G83 X1 Z-0.7 R0.2 Q0.1\nM2"), 9);
    assert_eq!(pecks("F300 G83 X1 Z-1 R0 Q5\nM2"), 1);
    // A peck smaller than the clearance comes back no higher than R.
    assert_eq!(
        moves("F300 G99 G83 X0 Z-0.2 R0 Q0.1\nM2"),
        ["F 0 0 -0.1", "R 0 0 0", "F 0 0 -0.2", "R 0 0 0"]
    );
}

#[test]
fn in_g91_l_steps_from_hole_to_hole_between_the_same_levels() {
    assert_eq!(
        moves("F300 G0 X10 Z5\nG91 G99 G81 X1 Y2 Z-4 R-3 L3\nM2")[1..],
        [
            "R 11 2 5",
            "R 11 2 2",
            "F 11 2 -2",
            "R 11 2 2",
            "R 12 4 2",
            "F 12 4 -2",
            "R 12 4 2",
            "R 13 6 2",
            "F 13 6 -2",
            "R 13 6 2"
        ]
    );
    // The next block of the row drills between them too, though Z is at R now.
    assert_eq!(
        moves("F300 G0 Z5\nG91 G99 G81 X1 Z-4 R-3\nX1\nM2")[4..],
        ["R 1 0 2", "R 2 0 2", "F 2 0 -2", "R 2 0 2"]
    );
    // In G90 the same hole is drilled again.
    let again = moves("F300 G99 G81 X1 Z-4 R3 L2\nM2");
    assert_eq!(again.iter().filter(|step| *step == "F 1 0 -4").count(), 2);
}

#[test]
fn values_stay_within_the_same_cycle_only() {
    assert!(refusal("F300 G81 X1 Z-5 R2\nG83 X2 Q1").starts_with("part.ngc:2:1: G83 without R"));
    assert!(refusal("F300 G81 X1 Z-5 R2\nG80\nG81 X2").contains("part.ngc:3:1: G81 without R"));
    let steps = moves("F300 G99 G81 X1 Z-5 R2\nG81 X2 Z-6\nX3 R1\nM2");
    assert!(
        steps.contains(&"F 2 0 -6".to_owned()) && steps.contains(&"R 3 0 1".to_owned()),
        "{steps:?}"
    );
}

#[test]
fn inches_and_work_offsets_reach_the_levels() {
    let mut setup = mill(200.0);
    setup.work_offset = at(&[10.0, 0.0, 50.0]);
    let start = at(&[0.0, 0.0, 100.0]);
    let program = interpret("part", "G20\nF10\nG83 X1 Z-1 R0.5 Q2\nM2", &setup, start).unwrap();
    let ends: Vec<AxisVector> = program.path.elements.iter().map(Element::end).collect();
    let expected = [
        at(&[35.4, 0.0, 100.0]),
        at(&[35.4, 0.0, 62.7]),
        at(&[35.4, 0.0, 24.6]),
        at(&[35.4, 0.0, 100.0]),
    ];
    assert_eq!(ends.len(), 4);
    for (end, expected) in ends.iter().zip(&expected) {
        assert!((end - expected).norm() < 1e-9, "{end} {expected}");
    }
}

#[test]
fn a_block_without_a_place_leaves_the_cycle_in_force() {
    let steps = moves("F300 G99 G81 X1 Z-5 R2\nF600\nG4 P0.5\nX2\nM2");
    assert_eq!(steps[4..], ["W 0.5", "R 2 0 2", "F 2 0 -5", "R 2 0 2"]);
}

#[test]
#[expect(clippy::too_many_lines, reason = "a table of mistakes")]
fn each_mistake_in_a_cycle_is_reported_with_its_place_and_what_would_be_right() {
    for (text, expected) in [
        (
            "G81 X1 Z-5 R2",
            "part.ngc:1:1: a feed motion without a feed",
        ),
        (
            "F1 G81 X1 R2",
            "part.ngc:1:4: G81 without Z: the bottom of the hole in the first block",
        ),
        (
            "F1 G81 X1 Z-5",
            "part.ngc:1:4: G81 without R: the level to feed from",
        ),
        (
            "F1 G82 X1 Z-5 R2",
            "part.ngc:1:4: G82 without P: the seconds to wait",
        ),
        (
            "F1 G82 X1 Z-5 R2 P-1",
            "part.ngc:1:18: P-1: a time is 0 to 100000 s; M0 waits for the operator",
        ),
        (
            "F1 G83 X1 Z-5 R2",
            "part.ngc:1:4: G83 without Q: the depth of one peck",
        ),
        (
            "F1 G83 X1 Z-5 R2 Q0",
            "part.ngc:1:18: Q0: a peck is above 0",
        ),
        (
            "F1 G83 X1 Z-150 R2 Q0.001",
            "part.ngc:1:20: Q0.001 with 152000 pecks a hole: at most 10000",
        ),
        (
            "F1 G81 X1 Z5 R2",
            "part.ngc:1:14: G81 with R at 2.0000 below Z at 5.0000: R lies above",
        ),
        ("F1 G81 R2", "part.ngc:1:8: R without an arc or a hole"),
        (
            "F1 G81",
            "part.ngc:1:4: G81 without a hole: say where: X, Y or Z",
        ),
        (
            "F1 G81 X1 Z-5 R2 L0",
            "part.ngc:1:18: L0: holes are a whole number from 1",
        ),
        (
            "F1 G81 X1 Z-5 R2 L1.5",
            "part.ngc:1:18: L1.5: holes are a whole number",
        ),
        ("F1 G81 X1 Z-5 R2 P1", "part.ngc:1:18: P1: P belongs to G4"),
        (
            "F1 G82 X1 Z-5 R2 Q1 P1",
            "part.ngc:1:18: Q1: Q belongs to G64 (tolerance), G83 (peck)",
        ),
        (
            "F1 G82 G4 P1 X1 Z-5 R2",
            "part.ngc:1:11: P1: only one of G4, G64, G2/G3, G82",
        ),
        (
            "F1 G83 G64 X1 Z-5 R2 Q1",
            "part.ngc:1:22: Q1: only one of G64 and G83",
        ),
        ("F1 G81 X1 Z-5 R2 I3", "part.ngc:1:18: I without an arc"),
        ("G0 X1 L2", "part.ngc:1:7: L2: L belongs to G81"),
        (
            "G18 F1 G81 X1 Z-5 R2",
            "part.ngc:1:8: G81 without Y: the bottom of the hole in the first block",
        ),
        (
            "G19 F1 G83 X3 Z-5 R2 Q1",
            "part.ngc:1:19: G83 with R at 2.0000 below X at 3.0000: R lies above",
        ),
        (
            "F1 G81 X1 Z-500 R2",
            "part.ngc:1:11: axis Z would reach -500.0000 mm",
        ),
        (
            "F1 G99 G83 X1 Z-150 R2 Q0.02 L10000",
            "part.ngc:1:8: holes that take the path beyond 4000000 elements",
        ),
        ("G79 X1", "part.ngc:1:1: G79: no such code is known"),
    ] {
        let found = refusal(text);
        assert!(found.starts_with(expected), "{text}: {found}");
    }
}

#[test]
fn a_machine_without_a_slide_z_and_words_of_other_axes_are_refused() {
    let plane = Setup {
        axes: vec![slide('X', -200.0, 200.0), slide('Y', -200.0, 200.0)],
        ..Setup::default()
    };
    let error = interpret("part.ngc", "F1 G81 X1 R2", &plane, at(&[])).unwrap_err();
    assert!(
        error.to_string().contains(
            "part.ngc:1:4: G81 in G17: a cycle runs along Z there: this machine has no slide Z"
        ),
        "{error}"
    );
    let mut five = mill(200.0);
    five.axes.push(slide('U', -200.0, 200.0));
    let error = interpret("part.ngc", "F1 G81 X1 U3 Z-1 R2", &five, at(&[])).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("part.ngc:1:11: U3 in G81: a cycle moves X, Y and Z"),
        "{error}"
    );
}

/// The expected moves of these tests are those of LinuxCNC 2.9's interpreter; runs of them are split at ` | `.
fn list(moves: &str) -> Vec<String> {
    moves.split(" | ").map(str::to_owned).collect()
}

#[test]
fn in_g91_r_counts_from_the_level_before_the_series_and_z_from_r() {
    assert_eq!(
        moves("F300 G0 Z20\nG99 G91 G81 X1 Z-5 R-2\nX2\nX3 R-3\nX1 Z-7\nM2"),
        list(
            "R 0 0 20 | R 1 0 20 | R 1 0 18 | F 1 0 13 | R 1 0 18 | R 3 0 18 | F 3 0 13 | R 3 0 18 | R 6 0 18 | \
             R 6 0 17 | F 6 0 12 | R 6 0 17 | R 7 0 17 | F 7 0 10 | R 7 0 17"
        )
    );
}

#[test]
fn levels_of_g90_move_with_the_work_offset_and_that_of_g98_does_not() {
    assert_eq!(
        moves("F300 G0 Z10\nG98 G81 X1 Z-1 R2\nG10 L2 P1 Z3\nX2\nM2")[4..],
        list("R 1 0 10 | R 2 0 10 | R 2 0 5 | F 2 0 2 | R 2 0 10")
    );
    // A change to G91 leaves them where they are.
    assert_eq!(
        moves("F300 G0 Z10\nG98 G81 X1 Z-1 R2\nG91 X2\nM2")[5..],
        list("R 3 0 10 | R 3 0 2 | F 3 0 -1 | R 3 0 10")
    );
}

#[test]
fn in_g18_cycles_run_along_y_and_in_g19_along_x() {
    assert_eq!(
        moves("G18 F300 G0 Y10 Z3\nG98 G81 X1 Z2 Y-5 R2\nG99 X5\nM2"),
        list(
            "R 0 10 3 | R 1 10 2 | R 1 2 2 | F 1 -5 2 | R 1 10 2 | R 5 10 2 | R 5 2 2 | F 5 -5 2 | R 5 2 2"
        )
    );
    assert_eq!(
        moves("G19 F300 G0 X10 Z3\nG98 G83 Z1 Y2 X-5 R2 Q4\nG99 Y5\nM2"),
        list(
            "R 10 0 3 | R 10 2 1 | R 2 2 1 | F -2 2 1 | R 2 2 1 | R -1.746 2 1 | F -5 2 1 | R 10 2 1 | R 10 5 1 | \
             R 2 5 1 | F -2 5 1 | R 2 5 1 | R -1.746 5 1 | F -5 5 1 | R 2 5 1"
        )
    );
}

/// The moves with what happens between them.
fn told(text: &str) -> String {
    let program = on_mill(text).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(program.path.first_break(), None);
    let event = |kind: &EventKind| match kind {
        EventKind::SpindleClockwise => "cw".to_owned(),
        EventKind::SpindleCounterClockwise => "ccw".to_owned(),
        EventKind::SpindleStop => "stop".to_owned(),
        EventKind::SpindleOrient(angle) => format!("orient {angle}"),
        EventKind::ProgramStop => "M0".to_owned(),
        EventKind::OverridesEnabled(count) => format!("overrides {count}"),
        EventKind::SpindleFollowed(mm) => format!("follow {}", (mm * 1e6).round() / 1e6),
        EventKind::SpindleReleased => "release".to_owned(),
        EventKind::SpindleCoupled(mm) => format!("couple {}", (mm * 1e6).round() / 1e6),
        EventKind::SpindleUncoupled => "uncouple".to_owned(),
        EventKind::SpindleSpeedRpm(rpm) => format!("S{rpm}"),
        other => format!("{other:?}"),
    };
    let mut lines = Vec::new();
    for index in 0..=program.path.elements.len() {
        let here = program.events.iter();
        let here = here.filter(|event| event.before_element == index);
        lines.extend(here.map(|found| event(&found.kind)));
        lines.extend(program.path.elements.get(index).map(printed));
    }
    lines.join(" | ")
}

#[test]
fn boring_and_tapping_say_what_the_spindle_does() {
    for (text, expected) in [
        (
            "M3 S100 F300 G0 Z10\nG98 G84 X1 Z-10 R2 P0.5\nM2",
            "S100 | cw | R 0 0 10 | R 1 0 10 | R 1 0 2 | overrides false | couple 3 | F 1 0 -10 | stop | ccw | W 0.5 | F 1 0 10 | \
             stop | cw | uncouple | overrides true",
        ),
        (
            "M4 S100 F300 G0 Z10\nG99 G74 X1 Z-10 R2\nX2\nM2",
            "S100 | ccw | R 0 0 10 | R 1 0 10 | R 1 0 2 | overrides false | couple 3 | F 1 0 -10 | stop | cw | F 1 0 2 | stop | \
             ccw | uncouple | overrides true | R 2 0 2 | overrides false | couple 3 | F 2 0 -10 | stop | cw | F 2 0 2 | stop | ccw | \
             uncouple | overrides true",
        ),
        (
            "M3 S100 F300 G0 Z10\nG98 G86 X1 Z-10 R2 P0.5\nM2",
            "S100 | cw | R 0 0 10 | R 1 0 10 | R 1 0 2 | F 1 0 -10 | W 0.5 | stop | R 1 0 10 | cw",
        ),
        (
            "M3 S100 F300 G0 Z10\nG98 G87 X1 Y2 Z-10 R2 I1 J-2 K-5\nM2",
            "S100 | cw | R 0 0 10 | R 1 2 10 | R 1 2 2 | R 2 0 2 | stop | orient 0 | R 2 0 -10 | R 1 2 -10 | cw | \
             F 1 2 -5 | F 1 2 -10 | stop | orient 0 | R 2 0 -10 | R 2 0 10 | R 1 2 10 | cw",
        ),
        (
            "M4 S100 F300 G0 Z10\nG98 G88 X1 Z-10 R2 P0.5\nM2",
            "S100 | ccw | R 0 0 10 | R 1 0 10 | R 1 0 2 | F 1 0 -10 | W 0.5 | stop | M0 | R 1 0 10 | ccw",
        ),
        (
            "F300 G0 Z10\nG98 G85 X1 Z-10 R2\nG99 G89 X2 Z-9 R2 P1\nG98 G73 X3 Z-6 R2 Q5\nM2",
            "R 0 0 10 | R 1 0 10 | R 1 0 2 | F 1 0 -10 | F 1 0 2 | R 1 0 10 | R 2 0 10 | R 2 0 2 | F 2 0 -9 | W 1 | \
             F 2 0 2 | R 3 0 2 | F 3 0 -3 | R 3 0 -2.746 | F 3 0 -6 | R 3 0 10",
        ),
    ] {
        assert_eq!(told(text), expected, "{text}");
    }
}

#[test]
fn back_boring_steps_aside_along_the_axes_of_its_plane() {
    assert_eq!(
        moves("M3 S1 G18 F300 G0 Y10\nG98 G87 X1 Z2 Y-5 R2 I1 J2 K-3\nM2")[1..],
        list(
            "R 1 10 2 | R 1 2 2 | R 2 2 -1 | R 2 -5 -1 | R 1 -5 2 | F 1 2 2 | F 1 -5 2 | R 2 -5 -1 | R 2 10 -1 | \
             R 1 10 2"
        )
    );
    assert_eq!(
        moves("M3 S1 G19 F300 G0 X10\nG98 G87 Z1 Y2 X-5 R2 I1 J2 K-3\nM2")[1..],
        list(
            "R 10 2 1 | R 2 2 1 | R 2 4 -2 | R -5 4 -2 | R -5 2 1 | F 1 2 1 | F -5 2 1 | R -5 4 -2 | R 10 4 -2 | \
             R 10 2 1"
        )
    );
    // In G91 K counts from the bottom, and I, J and K stay.
    let in_steps = moves("M3 S1 G91 F300 G0 Z10\nG98 G87 X1 Y2 Z-5 R-2 I1 J2 K3 L2\nX1 K1\nM2");
    let last = "R 3 4 10 | R 3 4 8 | R 4 6 8 | R 4 6 3 | R 3 4 3 | F 3 4 4 | F 3 4 3 | R 4 6 3 | R 4 6 10 | R 3 4 10";
    assert_eq!(in_steps[in_steps.len() - 10..], list(last));
}

#[test]
fn a_cycle_that_its_spindle_or_its_words_do_not_allow_is_refused() {
    for (text, expected) in [
        (
            "F1 G84 X1 Z-1 R1",
            "part.ngc:1:4: G84 with a spindle that stands: start it with M3",
        ),
        (
            "F1 M4 S1 G84 X1 Z-1 R1",
            "part.ngc:1:10: G84 with a spindle that turns counter-clockwise",
        ),
        (
            "F1 M3 S1 G74 X1 Z-1 R1",
            "part.ngc:1:10: G74 with a spindle that turns clockwise",
        ),
        (
            "F1 G86 X1 Z-1 R1 P1",
            "part.ngc:1:4: G86 with a spindle that stands",
        ),
        (
            "F1 M3 S1 G86 X1 Z-1 R1",
            "part.ngc:1:10: G86 without P: the seconds",
        ),
        (
            "F1 M3 S1 G87 X1 Z-1 R1 I1 K1",
            "part.ngc:1:10: G87 without J: the step aside",
        ),
        (
            "F1 M3 S1 G87 X1 Z-1 R1 I1 J1",
            "part.ngc:1:10: G87 without K: the level",
        ),
        ("F1 G85 X1 Z-1 R1 P1", "part.ngc:1:18: P1: P belongs to G4"),
        ("F1 G73 X1 Z-1 R1", "part.ngc:1:4: G73 without Q"),
        ("G93 F1 G81 X1 Z-1 R1", "part.ngc:1:8: G81 in G93"),
    ] {
        let found = refusal(text);
        assert!(found.starts_with(expected), "{text}: {found}");
    }
}

#[test]
fn a_program_that_says_neither_g98_nor_g99_is_told_which_it_gets() {
    let notes = |text: &str| {
        let notes = on_mill(text).unwrap().notes;
        notes
            .iter()
            .filter(|note| note.text.contains("neither G98 nor G99"))
            .count()
    };
    assert_eq!(notes("F300 G0 Z20\nG81 X1 Z-5 R2\nX3\nM2"), 1);
    assert_eq!(notes("F300 G0 Z20\nG98 G81 X1 Z-5 R2\nM2"), 0);
    // Both lead to the same level.
    assert_eq!(notes("F300 G0 Z2\nG81 X1 Z-5 R2\nM2"), 0);
}

#[test]
fn a_circle_of_holes_is_drilled_by_steps_of_an_angle() {
    let program = on_mill("G0 X30 Z5\nG91 G99 G81 ^60 R-3 Z-10 L6 F100\nM2").unwrap();
    let bottoms: Vec<[f64; 2]> = program
        .path
        .elements
        .iter()
        .filter(|element| element.feed != Feed::Rapid)
        .map(|element| [element.end()[0], element.end()[1]])
        .collect();
    assert_eq!(bottoms.len(), 6);
    for (index, [x, y]) in bottoms.into_iter().enumerate() {
        let angle = f64::to_radians(60.0 * (index as f64 + 1.0));
        let expected = [30.0 * angle.cos(), 30.0 * angle.sin()];
        assert!(
            (x - expected[0]).abs() < 1e-9 && (y - expected[1]).abs() < 1e-9,
            "{index}: {x} {y}"
        );
    }
}

#[test]
fn the_level_before_a_series_is_that_of_the_tip_when_the_length_of_the_tool_changes() {
    assert_eq!(
        moves("F300 G0 Z20\nG98 G81 X1 Z-5 R2\nG43.1 Z3\nX2\nG49\nX3\nM2"),
        [
            "R 0 0 20", "R 1 0 20", "R 1 0 2", "F 1 0 -5", "R 1 0 20", "R 2 0 20", "R 2 0 5",
            "F 2 0 -2", "R 2 0 23", "R 3 0 23", "R 3 0 2", "F 3 0 -5", "R 3 0 20"
        ]
    );
}
