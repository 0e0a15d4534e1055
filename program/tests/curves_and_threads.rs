//! Splines and threads through the interpreter, against LinuxCNC 2.9's.

use crate::common::{at, mill, on_mill, refusal};
use path::geometry::{Feed, Shape};
use program::{EventKind, Program, interpret};

fn program(text: &str) -> Program {
    let program = on_mill(text).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(program.path.first_break(), None);
    program
}

/// How far a place is from the path, in mm.
fn distance_mm(program: &Program, place: &[f64]) -> f64 {
    let distance = |element: &path::geometry::Element| {
        let (along_mm, _) = element.closest_distance(&at(place));
        (element.point(along_mm) - at(place)).norm()
    };
    program
        .path
        .elements
        .iter()
        .map(distance)
        .fold(f64::INFINITY, f64::min)
}

#[test]
fn splines_pass_where_the_reference_interpreter_says() {
    for (text, points) in [
        (
            "F100 G5 X4 Y5 I1 J3 P-2 Q-3\nG5 X8 Y9 P-1 Q-1\nM2",
            [
                [0.660_171_296, 1.468_037_037],
                [3.250_962_963, 3.994_370_37],
                [5.557, 6.998],
                [7.849_875, 8.857],
            ],
        ),
        (
            "F100 G5.1 X4 Y0 I1 J20\nM2",
            [
                [0.246_913_58, 3.950_617_284],
                [1.283_950_617, 9.876_543_21],
                [2.765_432_099, 6.913_580_247],
                [4.0, 0.0],
            ],
        ),
        (
            "F100 G5.2 P1\nX0 Y1 P1\nX20 Y0 P1\nX15 Y-30 P2\nX40 Y10 P0.5\nX30 Y30 P3\nX-5 Y20 P1\nG5.3\nM2",
            [
                [2.743_764_172, 0.636_054_422],
                [16.681_645_351, -26.335_983_408],
                [31.707_317_073, 17.804_878_049],
                [20.597_826_087, 27.065_217_391],
            ],
        ),
        // In G91 control points count from the start of the curve.
        (
            "G0 X1 Y1\nF100 G91 G5.2 X1 Y1 P2\nX0 Y1 P1\nX2 Y2 P1\nG5.3\nM2",
            [
                [2.621_891, 2.805_97],
                [2.742_794, 2.869_18],
                [2.868_962, 2.933_926],
                [3.0, 3.0],
            ],
        ),
    ] {
        let program = program(text);
        for point in points {
            let found_mm = distance_mm(&program, &point);
            assert!(found_mm < 0.000_5 + 1e-6, "{text}: {point:?} {found_mm} mm");
        }
        assert_eq!(
            program.path.elements.last().unwrap().feed,
            Feed::PathMmS(100.0 / 60.0)
        );
    }
}

#[test]
fn a_spline_is_turned_with_the_work_offset_and_read_in_its_unit() {
    let inches = program("G20 F10 G5.1 X0.4 Y0 I0.1 J2\nM2");
    // Half way: a quarter of the start, half of the control point, a quarter of the end.
    let half = [(0.25 * 0.4 + 0.5 * 0.1) * 25.4, 25.4];
    assert!(distance_mm(&inches, &half) < 0.000_6);
    let turned = program("G10 L2 P1 R90\nF100 G5.1 X4 Y0 I1 J20\nM2");
    assert!(distance_mm(&turned, &[-9.876_543_21, 1.283_950_617]) < 0.000_6);
}

#[test]
fn what_no_spline_can_be_is_refused_with_its_place() {
    for (text, expected) in [
        ("F1 G5 X4 Y5 P1 Q1", "part.ngc:1:4: G5 without I and J"),
        ("F1 G5 X4 Y5 I1 P1 Q1", "part.ngc:1:4: I without J: both"),
        ("F1 G5 X4 Y5 I1 J1", "part.ngc:1:4: G5 without P and Q"),
        (
            "F1 G5 X1 I1 J1 P1 Q1\nG1 X2\nG5 X4 P1 Q1",
            "part.ngc:3:1: G5 without I and J",
        ),
        ("F1 G5 I1 J1 P1 Q1", "part.ngc:1:4: G5 without a place"),
        ("F1 G5.1 X4 Y5", "part.ngc:1:4: G5.1 without I and J"),
        (
            "F1 G18 G5.1 X4 Y5 I1 J1",
            "part.ngc:1:8: G5.1 in G18: splines lie",
        ),
        (
            "F1 G5.1 X4 Y5 I1 J1 Z2",
            "part.ngc:1:21: Z2 in G5.1: a spline moves X and Y",
        ),
        ("G5.1 X4 Y5 I1 J1", "part.ngc:1:1: a feed motion without"),
        (
            "F1 G5.2 X4 P1",
            "part.ngc:1:4: a control point of one coordinate",
        ),
        (
            "F1 G5.2 X4 Y1 P1\nX2 Y2",
            "part.ngc:2:1: a control point without P",
        ),
        (
            "F1 G5.2 X4 Y1 P1\nX2 Y2 P0",
            "part.ngc:2:7: P0: a weight is above 0",
        ),
        (
            "F1 G5.2 X4 Y1 P1\nG5.3",
            "part.ngc:2:1: a spline of 2 control points: at least",
        ),
        (
            "F1 G5.2 X4 Y1 P1\nG1 X3",
            "part.ngc:2:1: G1 in the spline that G5.2 began in line 1: end the spline with G5.3",
        ),
        ("F1 G5.3", "part.ngc:1:4: G5.3 without G5.2"),
    ] {
        let found = refusal(text);
        assert!(found.starts_with(expected), "{text}: {found}");
    }
    let open = program("F1 G5.2 X4 Y1 P1\n");
    assert!(
        open.notes.iter().any(|note| note.text.contains("no G5.3")),
        "{:?}",
        open.notes
    );
}

/// X and Z of the moves: `R`apid or `F`eed, and what the spindle does.
fn told(text: &str) -> Vec<String> {
    let program = interpret("part.ngc", text, &mill(200.0), at(&[]))
        .unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(program.path.first_break(), None);
    let round = |mm: f64| (mm * 1e6).round() / 1e6;
    let mut told = Vec::new();
    for index in 0..=program.path.elements.len() {
        for event in program
            .events
            .iter()
            .filter(|event| event.before_element == index)
        {
            told.push(match event.kind {
                EventKind::SpindleFollowed(mm) => format!("follow {}", round(mm)),
                EventKind::SpindleReleased => "release".into(),
                EventKind::SpindleCoupled(mm) => format!("couple {}", round(mm)),
                EventKind::SpindleUncoupled => "uncouple".into(),
                EventKind::SpindleClockwise => "cw".into(),
                EventKind::SpindleCounterClockwise => "ccw".into(),
                EventKind::SpindleSpeedRpm(rpm) => format!("S{rpm}"),
                other => format!("{other:?}"),
            });
        }
        if let Some(element) = program.path.elements.get(index) {
            let Shape::Line { to, .. } = &element.shape else {
                panic!("{:?}", element.shape);
            };
            let how = match element.feed {
                Feed::Rapid => "R".to_owned(),
                Feed::PathMmS(mm_s) => format!("F{}", round(mm_s)),
            };
            told.push(format!("{how} {} {}", round(to[0]), round(to[2])));
        }
    }
    told
}

#[test]
fn g76_cuts_the_passes_of_the_reference_interpreter() {
    let told_of =
        told("M3 S60 G18 G0 X20 Z2\nG76 P1.5 Z-20 I-2 J0.4 K1.3 Q29.5 H1 E1.5 L3 R1.5\nG0 X30\nM2");
    assert_eq!(
        told_of[3..13],
        [
            "R 20.9 1.773691",
            "follow 1.984943",
            "F1.984943 18.9 1.773691",
            "F1.984943 17.6 0.273691",
            "follow 1.5",
            "F1.5 17.6 -17.990804",
            "follow 1.984943",
            "F1.984943 18.9 -19.490804",
            "release",
            "R 20.9 -19.490804",
        ]
    );
    assert_eq!(told_of.last().unwrap(), "R 30 -20");
    // In G7, I, J and K are diameters.
    let diameters = told("M3 S60 G18 G7 G0 X20 Z2\nG76 P1.5 Z-20 I-2 J0.4 K1.3 E1 L1\nM2");
    assert_eq!(
        diameters[3..8],
        [
            "R 10.45 2",
            "follow 1.789029",
            "F1.789029 9.45 2",
            "F1.789029 8.8 1",
            "follow 1.5",
        ]
    );
}

#[test]
fn g33_follows_the_spindle_and_rigid_tapping_comes_back() {
    assert_eq!(
        told("M3 S120 G33 Z-5 K0.5\nX1 Z-7 K1\nM2"),
        [
            "S120",
            "cw",
            "follow 0.5",
            "F1 0 -5",
            "release",
            "follow 1",
            "F2 1 -7",
            "release"
        ]
    );
    assert_eq!(
        told("M3 S120 G33.1 Z-5 K0.5 I2\nG0 X1\nM2"),
        [
            "S120",
            "cw",
            "couple 0.5",
            "follow 0.5",
            "F1 0 -5",
            "release",
            "S240",
            "ccw",
            "follow 0.5",
            "F2 0 0",
            "release",
            "S120",
            "cw",
            "uncouple",
            "R 1 0"
        ]
    );
}

#[test]
fn what_no_thread_can_be_is_refused_with_its_place() {
    let on = "M3 S100 G18 G0 X20 Z2\n";
    for (text, expected) in [
        (
            "G33 Z-1 K1".into(),
            "part.ngc:1:1: G33 with a spindle that stands",
        ),
        ("M3 S100 G33 Z-1".into(), "part.ngc:1:9: G33 without K"),
        (
            "M3 S100 G33 Z-1 K0".into(),
            "part.ngc:1:17: a motion of 0 mm",
        ),
        (
            "M3 S100 G33.1 Z-1 K1 I0".into(),
            "part.ngc:1:22: I0: how many times",
        ),
        ("M3 S100 G33.1 K1".into(), "part.ngc:1:15: K"),
        (
            format!("{on}G76 P1.5 Z-20 I-2 J0.4"),
            "part.ngc:2:1: G76 without K: the full depth",
        ),
        (
            format!("{on}G76 P1.5 Z-20 I-2 J2 K1"),
            "part.ngc:2:19: a thread 1 deep whose first cut is 2",
        ),
        (
            format!("{on}G76 P1.5 Z-20 X3 I-2 J0.5 K1"),
            "part.ngc:2:15: X3 in G76: G76 cuts along Z",
        ),
        (
            format!("{on}G76 P1.5 Z-20 I-2 J0.5 K1 L4"),
            "part.ngc:2:27: L4: a whole number from 0 to 3",
        ),
        (
            format!("{on}G17 G76 P1.5 Z-20 I-2 J0.5 K1"),
            "part.ngc:2:5: G76 in G17: threads are cut in the plane ZX",
        ),
        (
            format!("{on}G76 P1.5 Z-20 I-2 J0.5 K1 H-1"),
            "part.ngc:2:27: H-1: the number",
        ),
    ] {
        let found = refusal(&text);
        assert!(found.starts_with(expected), "{text}: {found}");
    }
}
