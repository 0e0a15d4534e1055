//! What each word does, and how each mistake is reported.

use std::f64::consts::PI;

use crate::common::{at, mill, on_mill, refusal, slide};
use path::geometry::{AxisVector, Element, Feed, Shape};
use program::{AxisSetup, EventKind, Program, ProgramEnd, Setup, interpret};

fn elements(text: &str) -> Vec<Element> {
    on_mill(text)
        .unwrap_or_else(|error| panic!("{error}"))
        .path
        .elements
}

fn end_of(text: &str) -> AxisVector {
    elements(text).last().unwrap().end()
}

/// (centre, radius, sweep) of an arc.
fn circle_of(element: &Element) -> (AxisVector, f64, f64) {
    match element.shape {
        Shape::Arc {
            centre,
            radius_mm,
            sweep_rad,
            ..
        } => (centre, radius_mm, sweep_rad),
        _ => panic!("{element:?} is no arc"),
    }
}

fn assert_near(found: f64, expected: f64) {
    assert!(
        (found - expected).abs() < 1e-9,
        "found {found}, expected {expected}"
    );
}

#[test]
fn lines_and_rapids_carry_their_line_and_feed() {
    let elements = elements("G0 X10\n\nG1 Y5 F600\n X0\nM2\n");
    let seen: Vec<_> = elements
        .iter()
        .map(|element| (element.line, element.feed))
        .collect();
    assert_eq!(
        seen,
        [
            (1, Feed::Rapid),
            (3, Feed::PathMmS(10.0)),
            (4, Feed::PathMmS(10.0))
        ]
    );
}

#[test]
fn inches_scale_slides_and_feed() {
    let elements = elements("G20\nG1 X1 F60\nM2");
    assert_eq!(elements[0].end(), at(&[25.4]));
    assert_eq!(elements[0].feed, Feed::PathMmS(25.4));
}

#[test]
fn a_feed_set_in_mm_keeps_its_speed_when_the_unit_changes() {
    assert_eq!(
        elements("F600\nG20\nG1 X1\nM2")[0].feed,
        Feed::PathMmS(10.0)
    );
}

#[test]
fn incremental_words_count_from_where_the_tool_is() {
    assert_eq!(
        end_of("G1 X10 Y10 F100\nG91 X5 Y-3\nX1\nG90 Y0\nM2"),
        at(&[16.0, 0.0])
    );
}

#[test]
fn the_work_offset_moves_absolute_words_and_centres_only() {
    let mut setup = mill(500.0);
    setup.work_offset = at(&[250.0, 200.0, -100.0]);
    let text = "G54 G90.1 G0 X10 Y0 Z5\nG3 X0 Y10 I0 J0 F100\nG91 G91.1\nG1 X1\nM2";
    let program = interpret("part", text, &setup, at(&[0.0, 0.0, 0.0])).unwrap();
    let path = program.path;
    assert_eq!(path.elements[0].end(), at(&[260.0, 200.0, -95.0]));
    assert_eq!(circle_of(&path.elements[1]).0, at(&[250.0, 200.0, -95.0]));
    assert_eq!(path.end(), Some(at(&[251.0, 210.0, -95.0])));
}

#[test]
fn a_dwell_is_in_seconds_and_comes_before_the_motion_of_its_block() {
    let elements = elements("G1 F100\nG4 P1.5 X5\nM2");
    assert!(matches!(
        elements[0].shape,
        Shape::Dwell { seconds: 1.5, .. }
    ));
    assert_eq!(elements[1].end(), at(&[5.0]));
}

#[test]
fn full_circles_and_turns_go_all_the_way_round() {
    let ccw = elements("G0 X25\nG3 I-25 F3000\nM2");
    assert_eq!(circle_of(&ccw[1]), (at(&[]), 25.0, 2.0 * PI));
    let cw = elements("G0 X25\nG2 X25 Y0 I-25 P3 F3000\nM2");
    assert_eq!(circle_of(&cw[1]).2, -6.0 * PI);
}

#[test]
fn a_quarter_ends_on_the_bits_of_its_words() {
    let elements = elements("G0 X10.1\nG3 X0 Y10.1 I-10.1 F100\nG1 X-3\nM2");
    assert_eq!(elements[1].end(), at(&[0.0, 10.1]));
    assert_near(circle_of(&elements[1]).2, PI / 2.0);
    assert_eq!(elements[2].start(), at(&[0.0, 10.1]));
}

#[test]
fn radius_arcs_take_the_short_way_and_negative_ones_the_long() {
    for (text, sweep, centre) in [
        ("G3 X0 Y10 R10", PI / 2.0, [0.0, 0.0]),
        ("G3 X0 Y10 R-10", 1.5 * PI, [10.0, 10.0]),
        ("G2 X0 Y10 R10", -PI / 2.0, [10.0, 10.0]),
        ("G2 X0 Y10 R-10", -1.5 * PI, [0.0, 0.0]),
        ("G2 X-10 Y0 R10", -PI, [0.0, 0.0]),
    ] {
        let elements = elements(&format!("G0 X10\nF100 {text}\nM2"));
        let (found_centre, radius_mm, found_sweep) = circle_of(&elements[1]);
        assert!(
            (found_centre - at(&centre)).norm() < 1e-9,
            "{text}: {found_centre}"
        );
        assert!(
            (found_sweep - sweep).abs() < 1e-9 && (radius_mm - 10.0).abs() < 1e-9,
            "{text}"
        );
    }
}

#[test]
fn planes_turn_counter_clockwise_from_their_first_axis() {
    // G18: from Z towards X. G19: from Y towards Z.
    let zx = elements("G0 Z10\nG18 G3 X10 Z0 K-10 F100\nM2");
    assert_near(circle_of(&zx[1]).2, PI / 2.0);
    let yz = elements("G0 Y10\nG19 G3 Y0 Z10 J-10 F100\nM2");
    assert_near(circle_of(&yz[1]).2, PI / 2.0);
}

#[test]
fn a_helix_rises_in_proportion_to_its_angle() {
    let elements = elements("G0 X10\nG3 X10 Y0 Z-6 I-10 P3 F100\nM2");
    let element = &elements[1];
    assert!((element.point(element.length_mm / 3.0) - at(&[10.0, 0.0, -2.0])).norm() < 1e-9);
    assert_eq!(element.end(), at(&[10.0, 0.0, -6.0]));
}

#[test]
fn rounded_ends_are_met_exactly_by_a_true_circle() {
    // Start and end differ by 1 µm in radius.
    let elements = elements("G0 X10\nG3 X0 Y10.001 I-10 F100\nG1 X-5\nM2");
    let (centre, radius_mm, _) = circle_of(&elements[1]);
    for end in [elements[1].start(), elements[1].end()] {
        assert_near((end - centre).norm(), radius_mm);
    }
    assert!(centre.norm() < 0.001);
    assert_eq!(elements[2].start(), at(&[0.0, 10.001]));
}

#[test]
fn a_nearly_full_turn_with_rounded_ends_stays_on_its_circle() {
    // The ends are 20 µm apart and 1.5 µm off in radius: one circle through both would lie 0.75 mm beside.
    let text = "G0 X10\nG3 X10.0015 Y-0.02 Z2 I-10 F100\nM2";
    let path = on_mill(text).unwrap().path;
    assert_eq!(path.elements.len(), 3);
    assert_eq!(path.first_break(), None);
    assert_eq!(path.end(), Some(at(&[10.0015, -0.02, 2.0])));
    let mut turned = 0.0;
    for element in &path.elements[1..] {
        turned += circle_of(element).2;
        for index in 0..=100 {
            let point = element.point(element.length_mm * f64::from(index) / 100.0);
            assert!((point[0].hypot(point[1]) - 10.0).abs() < 0.003, "{point}");
        }
    }
    assert!((turned - 2.0 * PI).abs() < 0.01, "{turned}");
}

#[test]
fn moves_of_no_length_make_no_element() {
    assert_eq!(elements("G1 X5 F100\nX5\nG0 X5 Y0\nM2").len(), 1);
}

#[test]
fn elements_meet_to_the_bit_in_machine_coordinates() {
    let mut setup = mill(500.0);
    setup.work_offset = at(&[0.1, 0.2, 0.3]);
    let text =
        "G91 G1 X0.1 F100\nX0.2\nG2 X1 Y1 R1\nG3 X-1 Y1 I-1\nX0.7 Y0.3 R5\nG90 X0 Y0 R20\nM2";
    let path = interpret("part", text, &setup, at(&[0.7, 0.0, 0.0]))
        .unwrap()
        .path;
    assert_eq!((path.elements.len(), path.first_break()), (6, None));
    assert_eq!(path.start(), Some(at(&[0.7])));
}

#[test]
fn rotary_axes_are_fed_in_degrees_even_in_inches() {
    let mut setup = mill(200.0);
    setup.axes.push(AxisSetup {
        letter: 'A',
        travel_min: -720.0,
        travel_max: 720.0,
        rotary: true,
        modulo: false,
    });
    let path = interpret("part", "G20\nF60\nG1 A90\nA180 X1\nM2", &setup, at(&[]))
        .unwrap()
        .path;
    assert_eq!(
        (path.elements[0].length_mm, path.elements[0].feed),
        (90.0, Feed::PathMmS(1.0))
    );
    assert_eq!(
        (path.elements[1].length_mm, path.elements[1].feed),
        (25.4, Feed::PathMmS(25.4))
    );
}

/// Where each block leads an axis A that turns without end, from a place of it, with G54 at 30 degrees.
fn turned_to(start: f64, text: &str) -> Vec<f64> {
    let mut setup = mill(200.0);
    setup.axes.push(AxisSetup {
        letter: 'A',
        travel_min: -1e6,
        travel_max: 1e6,
        rotary: true,
        modulo: true,
    });
    setup.work_offset = at(&[0.0, 0.0, 0.0, 30.0]);
    let program = interpret("part", text, &setup, at(&[0.0, 0.0, 0.0, start]));
    let program = program.unwrap_or_else(|error| panic!("{error}"));
    let elements = program.path.elements.iter();
    elements.map(|element| element.end()[3]).collect()
}

#[test]
fn an_axis_that_turns_without_end_goes_to_absolute_places_on_the_shorter_way() {
    // The program's 350 is the machine's 380, or 20.
    assert_eq!(
        turned_to(10.0, "G0 A350\nA10\nA180\nA0\nM2"),
        [20.0, 40.0, 210.0, 390.0]
    );
    // Far from zero it is the same, and many turns in a word are none.
    assert_eq!(turned_to(7210.0, "G0 A350\nM2"), [7220.0]);
    assert_eq!(turned_to(10.0, "G0 A1070\nA-10\nM2"), [20.0]);
    // The block that needs more than straight motion goes the same way, and machine coordinates.
    assert_eq!(
        turned_to(10.0, "G1 X1 A350 F100\nG2 X2 R0.5 A10\nM2"),
        [20.0, 40.0]
    );
    assert_eq!(turned_to(-710.0, "G53 G0 A350\nM2"), [-730.0]);
    assert_eq!(turned_to(725.0, "G28\nM2"), [720.0]);
    // Where X and Y are turned as well.
    assert_eq!(turned_to(10.0, "G10 L2 P1 R45\nG0 X1 A350\nM2"), [20.0]);
}

/// The example of Fanuc's manual B-63534EN/02, 20.2.1: movements of -150, -30, -80, 380 and -840 degrees.
#[test]
fn an_axis_that_turns_without_end_moves_as_with_fanucs_roll_over() {
    let example =
        "G10 L2 P1 A0\nG90 G0 A-150.0\nG90 A540.0\nG90 A-620.0\nG91 A380.0\nG91 A-840.0\nM2";
    assert_eq!(
        turned_to(0.0, example),
        [-150.0, -180.0, -260.0, 120.0, -720.0]
    );
}

#[test]
fn in_incremental_mode_it_turns_as_many_turns_as_are_said() {
    assert_eq!(
        turned_to(10.0, "G91 G0 A720\nA-1080\nG90 A350\nM2"),
        [730.0, -350.0, -340.0]
    );
}

#[test]
fn spindle_words_are_kept_with_their_place() {
    let program = on_mill("S8000 M3\nG1 X1 F100\nM4 X2\nM5\nM2").unwrap();
    let seen: Vec<_> = program
        .events
        .iter()
        .map(|event| (event.before_element, event.kind))
        .collect();
    assert_eq!(
        seen,
        [
            (0, EventKind::SpindleSpeedRpm(8000.0)),
            (0, EventKind::SpindleClockwise),
            (1, EventKind::SpindleCounterClockwise),
            (2, EventKind::SpindleStop),
        ]
    );
}

/// Cutting speeds (m/min, limit, place of the spindle's axis) with their place among the moves.
fn surface_speeds(text: &str) -> Vec<(usize, f64, Option<f64>, f64)> {
    let program = on_mill(text).unwrap_or_else(|error| panic!("{error}"));
    let events = program.events.iter();
    let speeds = events.filter_map(|event| match event.kind {
        EventKind::SurfaceSpeed(of) => {
            Some((event.before_element, of.m_min, of.limit_rpm, of.centre_mm))
        }
        _ => None,
    });
    speeds.collect()
}

#[test]
fn a_cutting_speed_is_in_the_unit_of_the_program_and_counts_from_its_x0() {
    assert_eq!(
        surface_speeds("G96 D2500 S180 M3\nG0 X5\nG92 X3\nG0 X4\nS120\nG0 X5\nG97 S500\nS400\nM2"),
        [
            (0, 180.0, Some(2500.0), 0.0),
            (1, 180.0, Some(2500.0), 2.0),
            (2, 120.0, Some(2500.0), 2.0),
        ]
    );
    assert_eq!(surface_speeds("G20\nG96 S100\nM2"), [(0, 30.48, None, 0.0)]);
    let restored = "G96 S50\nM70\nG97 S300\nM72\nG0 X1\nM2";
    assert_eq!(
        surface_speeds(restored),
        [(0, 50.0, None, 0.0), (0, 50.0, None, 0.0)]
    );
}

#[test]
fn what_needs_one_speed_of_the_spindle_is_refused_in_g96() {
    for (text, expected) in [
        ("G96 D100", "part.ngc:1:1: G96 without S"),
        ("G96 S50\nG97", "part.ngc:2:1: G97 without S behind G96"),
        ("G96 S50 M3\nG33 Z-3 K1", "part.ngc:2:1: G33 in G96"),
        ("G96 S50 M3 F10\nG84 Z-3 R1", "part.ngc:2:1: G84 in G96"),
    ] {
        let found = refusal(text);
        assert!(found.starts_with(expected), "{text}: {found}");
    }
}

#[test]
fn in_g95_and_g96_the_feed_is_never_more_than_f_per_turn_and_a_tenth_less_at_most() {
    let rpm = |x_mm: f64| (60e3 / (std::f64::consts::TAU * x_mm.abs())).min(1500.0);
    for text in [
        "G0 X60\nG96 D1500 S60 M3\nG95 G1 X0 F.2\nM2",
        "G0 X60\nG96 D1500 S60 M3\nG95 G1 X-20 Y30 F.2\nM2",
        "G0 X30\nG96 D1500 S60 M3\nG95 G2 I-15 F.2\nM2",
        "G0 X30\nG96 D1500 S60 M3\nG95 G3 X-30 I-30 F.2\nM2",
        "G0 X40\nG96 D1500 S60 M3\nG95 G42.1 D4 F.2\nG1 X30 Y10\nX8\nY40\nG40 X60\nM2",
    ] {
        let program = on_mill(text).unwrap_or_else(|error| panic!("{text}: {error}"));
        assert_eq!(program.path.first_break(), None);
        let mut pieces = 0;
        for element in &program.path.elements {
            let Feed::PathMmS(mm_s) = element.feed else {
                continue;
            };
            pieces += 1;
            for share in 0..=50 {
                let x_mm = element.point(element.length_mm * f64::from(share) / 50.0)[0];
                let per_turn = mm_s * 60.0 / rpm(x_mm);
                assert!(
                    (0.178..0.2 + 1e-9).contains(&per_turn),
                    "{text}: {per_turn} at {x_mm}"
                );
            }
        }
        assert!((5..100).contains(&pieces), "{text}: {pieces} pieces");
    }
}

#[test]
fn the_angle_of_an_oriented_spindle_is_no_radius() {
    for before in [
        "",
        "G1 X1 F100\n",
        "F100\nG2 X2 I1\n",
        "F100\nG81 X1 Z-1 R1\n",
        "G80\n",
    ] {
        let program = on_mill(&format!("{before}M19 R90\nM2"));
        let program = program.unwrap_or_else(|error| panic!("{before}{error}"));
        let last = program.events.last().map(|event| event.kind);
        assert_eq!(last, Some(EventKind::SpindleOrient(90.0)), "{before}");
    }
}

#[test]
fn coolant_tools_stops_and_outputs_are_kept_with_their_place() {
    let program =
        on_mill("T2 M6\nM8\nG1 X1 F100\nM0\nM62 P3\nG1 X2\nM1\nM9\nM19 R90\nM49\nM2").unwrap();
    let seen: Vec<_> = program
        .events
        .iter()
        .map(|event| (event.before_element, event.kind))
        .collect();
    let output = EventKind::DigitalOutput {
        index: 3,
        on: true,
        synchronised: true,
    };
    assert_eq!(
        seen,
        [
            (0, EventKind::ToolPrepare(2)),
            (0, EventKind::ToolChange(2)),
            (0, EventKind::Flood(true)),
            (1, EventKind::ProgramStop),
            (1, output),
            (2, EventKind::OptionalStop),
            (2, EventKind::Mist(false)),
            (2, EventKind::Flood(false)),
            (2, EventKind::SpindleOrient(90.0)),
            (2, EventKind::OverridesEnabled(false)),
        ]
    );
}

#[test]
fn what_follows_the_end_is_ignored() {
    assert_eq!(
        on_mill("G0 X1\nM2\nnonsense $$$").unwrap().end,
        ProgramEnd::M2(2)
    );
    assert_eq!(on_mill("G0 X1 M30\nX9999").unwrap().end, ProgramEnd::M30(1));
    assert_eq!(
        on_mill("(head)\n%\nG0 X1\n%\nnonsense").unwrap().end,
        ProgramEnd::Percent(4)
    );
    assert_eq!(on_mill("G0 X1\n%\n\n").unwrap().end, ProgramEnd::Percent(2));
}

#[test]
fn leniency_is_reported_in_notes() {
    let program = on_mill("/G0 X1\nG64\nG1 X2 F100\n").unwrap();
    let lines: Vec<_> = program.notes.iter().map(|note| note.line).collect();
    assert_eq!((lines, program.end), (vec![1, 2, 3], ProgramEnd::FileEnd));
}

#[test]
fn g64_says_how_far_the_path_may_be_left_and_g61_1_where_the_tool_rests() {
    let modes = |text: &str, tolerance_mm: f64| -> Vec<(f64, f64, bool)> {
        let mut setup = mill(200.0);
        setup.tolerance_mm = tolerance_mm;
        let text = format!("G21 F600\n{text}\nM2");
        let program = interpret("part", &text, &setup, at(&[])).unwrap();
        let elements = program.path.elements.iter();
        elements
            .map(|of| {
                (
                    of.tolerance.corner_mm,
                    of.tolerance.chord_mm,
                    of.rests_before,
                )
            })
            .collect()
    };
    let exact = (0.0, 0.0, false);
    assert_eq!(
        modes("G1 X1\nG64 P.01\nX2\nG61 X3", 0.0),
        [exact, (0.01, 0.01, false), exact]
    );
    assert_eq!(
        modes("G64 P.05 Q.02\nG1 X1\nG2 X2 I.5", 0.0),
        [(0.05, 0.02, false); 2]
    );
    assert_eq!(
        modes("G1 X1\nG64 P.05\nX2\nG64\nX3", 0.02),
        [
            (0.02, 0.02, false),
            (0.05, 0.05, false),
            (0.02, 0.02, false),
        ]
    );
    assert_eq!(
        modes("G20\nG64 P.001\nG1 X1", 0.0),
        [(0.0254, 0.0254, false)]
    );
    assert_eq!(
        modes("G64 P.01\nM70\nG61\nM72\nG1 X1", 0.0),
        [(0.01, 0.01, false)]
    );
    let stops = (0.0, 0.0, true);
    assert_eq!(
        modes("G1 X1\nG61.1\nX2\nY3\nG61\nX4\nX5", 0.0),
        [exact, stops, stops, stops, exact]
    );
    let refused = on_mill("G64 P-0.1\nM2").unwrap_err().to_string();
    assert!(refused.contains("a tolerance is 0 to 5 mm"), "{refused}");
}

#[test]
fn a_program_without_motion_has_an_empty_path() {
    let program = on_mill("G21 G17 G90 G94 G40 G49 G80\nM2").unwrap();
    assert!(program.path.elements.is_empty());
    assert_eq!(program.block_text(1), Some("G21 G17 G90 G94 G40 G49 G80"));
}

#[test]
fn the_hash_changes_with_text_machine_offset_and_start() {
    let text = "G0 X1\nM2";
    let hash = |text: &str, setup: &Setup, start: AxisVector| {
        interpret("part", text, setup, start).unwrap().source_hash
    };
    let mut moved = mill(200.0);
    moved.work_offset = at(&[1.0]);
    let hashes = [
        hash(text, &mill(200.0), at(&[])),
        hash("G0 X2\nM2", &mill(200.0), at(&[])),
        hash(text, &mill(201.0), at(&[])),
        hash(text, &moved, at(&[])),
        hash(text, &mill(200.0), at(&[3.0])),
    ];
    for (index, one) in hashes.iter().enumerate() {
        assert!(
            hashes.iter().skip(index + 1).all(|other| other != one),
            "{hashes:?}"
        );
    }
    assert_eq!(hashes[0], hash(text, &mill(200.0), at(&[])));
}

#[test]
#[expect(clippy::too_many_lines, reason = "a table of mistakes")]
fn each_mistake_is_reported_with_its_place_and_what_would_be_right() {
    for (text, expected) in [
        (
            "G1 X5",
            "part.ngc:1:1: a feed motion without a feed: give an F word",
        ),
        (
            "G0 X5\nX6 T1.5",
            "part.ngc:2:4: T1.5: the number of a tool is a whole number",
        ),
        (
            "G0 X5\nT[10**300] M6",
            "part.ngc:2:1: T1e300: the number of a tool is a whole number from 0 to 99999",
        ),
        (
            "G43 H[10**5]",
            "part.ngc:1:5: H100000: the number of a tool is a whole number from 0 to 99999",
        ),
        (
            "M61 Q[10**10]",
            "part.ngc:1:5: Q10000000000: the number of a tool is a whole number from 0 to 99999",
        ),
        ("M6", "part.ngc:1:1: M6 without T: the tool, such as T1 M6"),
        ("G53 X1", "part.ngc:1:1: G53 without G0 or G1"),
        (
            "G91 G0 G53 X1",
            "part.ngc:1:8: G53 in G91: machine coordinates are absolute",
        ),
        ("G1.5 X1", "part.ngc:1:1: G1.5: no such code is known"),
        ("G-1 X1", "part.ngc:1:1: G-1: no such code is known"),
        ("M101", "part.ngc:1:1: M101: user M-codes run a program"),
        ("G0 A5", "part.ngc:1:4: A5: this machine has the axes X Y Z"),
        (
            "G0 G1 X5",
            "part.ngc:1:4: G0 and G1 in one block: these exclude each other",
        ),
        ("G0 X1 X2", "part.ngc:1:7: X twice in one block"),
        (
            "G90 G90.1 G91.1",
            "part.ngc:1:11: G90.1 and G91.1 in one block",
        ),
        ("G0 X1 N5", "part.ngc:1:7: N after other words"),
        ("N-1 G0", "part.ngc:1:1: N-1: a line number is 0 or more"),
        ("X5", "part.ngc:1:1: X without a motion mode"),
        ("G0 X1\nG80 X5", "part.ngc:2:1: X without a motion mode"),
        ("F-1", "part.ngc:1:1: F-1: a feed is 0 (none) or more"),
        (
            "F9
F0
G1 X5",
            "part.ngc:3:1: a feed motion without a feed",
        ),
        ("S-5", "part.ngc:1:1: S-5: a spindle speed is 0 or more"),
        ("G4", "part.ngc:1:1: G4 without P"),
        (
            "G4 P-1",
            "part.ngc:1:4: P-1: a time is 0 to 100000 s; M0 waits for the operator",
        ),
        (
            "G4 P100000000",
            "part.ngc:1:4: P100000000: a time is 0 to 100000 s; M0 waits for the operator",
        ),
        ("P5", "part.ngc:1:1: P5: P belongs to G4"),
        ("G0 X1 I5", "part.ngc:1:7: I without an arc"),
        (
            "F9\nG0 X10\nG2 X0 Y5 I-10",
            "part.ngc:3:1: an arc whose start is 10.0000 mm and whose end is 5.0000 mm from its centre: the radii may differ by at most 0.028 mm",
        ),
        (
            "F9 G2 X5 I2 K1",
            "part.ngc:1:13: K in an arc in G17: arcs in G17 take I and J",
        ),
        (
            "F9 G18 G2 X5 I2 J1",
            "J in an arc in G18: arcs in G18 take K and I",
        ),
        ("F9 G2 X5", "part.ngc:1:4: an arc without a centre"),
        ("F9 G2 X5 I0 J0", "an arc of radius zero"),
        ("F9 G2 X5 R0", "part.ngc:1:10: R0"),
        (
            "F9 G2 X5 R1",
            "R of 1.0000 mm for ends 5.0000 mm apart: R must be at least 2.5000 mm",
        ),
        ("F9 G2 X0 Y0 R1", "an R arc that ends where it starts"),
        ("F9 G2 X5 I2.5 R5", "R together with I, J or K"),
        (
            "F9 G2 X5 I2.5 P0",
            "part.ngc:1:15: P0: turns are a whole number",
        ),
        (
            "F9 G90.1\nG2 X5 I2.5",
            "an arc without J: in G90.1 both coordinates",
        ),
        (
            "G0 X201",
            "part.ngc:1:4: axis X would reach 201.0000 mm: the travel is -200 to 200 mm",
        ),
        (
            "G0 X190\nF9 G3 X170 I-10\nG3 X190 Y150\n",
            "part.ngc:3:1: an arc without a centre",
        ),
        (
            "G0 X0 Y190\nF9 G2 X40 I20",
            "part.ngc:2:4: axis Y would reach 210.0000 mm: the travel is",
        ),
        (
            "G1 X#<none>",
            "part.ngc:1:5: #<none> has no value: set it before it is used",
        ),
        ("O100 sub", "part.ngc:1:1: O100 sub without O100 endsub"),
        ("G0 X1\n%\nG0 X5", "part.ngc:2:1: % between blocks"),
        (
            "(ä) G0 X1 (open",
            "part.ngc:1:11: a comment that is not closed",
        ),
        ("\n\n", "part.ngc: has no blocks"),
    ] {
        let found = refusal(text);
        assert!(
            found.contains(expected),
            "{text:?}\n   found: {found}\nexpected: {expected}"
        );
    }
}

#[test]
fn travel_is_reported_in_both_coordinates_when_they_differ() {
    let mut setup = mill(200.0);
    setup.work_offset = at(&[150.0]);
    let error = interpret("part", "G0 X60\nM2", &setup, at(&[]))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains(
            "axis X would reach 210.0000 mm in machine coordinates (60.0000 in the program's)"
        ),
        "{error}"
    );
}

#[test]
fn a_machine_outside_its_travel_may_move_back_in() {
    assert!(interpret("part", "G0 X0\nM2", &mill(200.0), at(&[205.0])).is_ok());
}

#[test]
fn the_travel_itself_may_be_reached_by_lines_and_arcs() {
    assert!(on_mill("G0 X200\nF100 G3 I-200\nM2").is_ok());
    assert!(on_mill("G0 X200\nF100 G3 I-200.001\nM2").is_err());
}

#[test]
fn arcs_need_both_slides_of_their_plane() {
    let setup = Setup {
        axes: vec![slide('X', -9.0, 9.0), slide('Y', -9.0, 9.0)],
        ..Setup::default()
    };
    let error = interpret("part", "F9 G18\nG2 X2 I1\nM2", &setup, at(&[]))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("part:2:1: an arc in the plane ZX (G18): this machine has no slide Z"),
        "{error}"
    );
}

#[test]
fn mistakes_are_reported_together_and_without_echoes() {
    let error = interpret(
        "part",
        "G1 X5\nT.5\nG2 X9\nG0 X1 X2\nM2\nT.5",
        &mill(9.0),
        at(&[]),
    )
    .unwrap_err();
    let lines: Vec<_> = error
        .problems
        .iter()
        .map(|problem| problem.place.unwrap().0)
        .collect();
    assert_eq!(lines, [1, 2, 4]);
}

#[test]
fn leaving_the_travel_is_reported_for_every_block() {
    let error = interpret("part", "G0 X10\nX0\nY-10 X10\nM2", &mill(9.0), at(&[])).unwrap_err();
    assert_eq!(error.problems.len(), 3);
}

#[test]
fn at_most_twenty_mistakes_are_reported() {
    let error = interpret("part", &"T.5\n".repeat(500), &mill(9.0), at(&[])).unwrap_err();
    assert_eq!((error.problems.len(), error.more), (20, true));
    let error = interpret("part", &"T.5\n".repeat(20), &mill(9.0), at(&[])).unwrap_err();
    assert_eq!((error.problems.len(), error.more), (20, false));
}

#[test]
fn a_program_of_a_hundred_thousand_blocks_is_read_whole() {
    let text: String = (0..100_000)
        .map(|index| format!("N{index} X{}.5\n", index % 7))
        .collect();
    let program: Program = on_mill(&format!("F600 G1\n{text}M2\n")).unwrap();
    assert_eq!(
        (program.path.elements.len(), program.blocks.len()),
        (100_000, 100_002)
    );
}
