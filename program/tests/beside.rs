//! Cutter radius compensation, polar words and lathe cycles in programs. Expected values are those of LinuxCNC 2.9's interpreter.

use crate::common::{at, on_mill, refusal, slide};
use path::geometry::{AxisVector, Shape};
use program::{EventKind, Program, Setup, interpret};

/// Ends of the elements, X Y Z with four decimals; arcs with their radius.
fn written(program: &Program) -> Vec<String> {
    let place = |to: &AxisVector| format!("{:.4} {:.4} {:.4}", to[0], to[1], to[2]);
    let elements = program.path.elements.iter();
    elements
        .map(|element| match &element.shape {
            Shape::Line { to, .. } => format!("line {}", place(to)),
            Shape::Arc { to, radius_mm, .. } => format!("arc {} r{radius_mm:.4}", place(to)),
            Shape::Dwell { seconds, .. } => format!("dwell {seconds}"),
        })
        .collect()
}

fn lathe(text: &str) -> Program {
    let axes = ['X', 'Y', 'Z'].map(|letter| slide(letter, -200.0, 200.0));
    let setup = Setup {
        axes: axes.into(),
        ..Setup::default()
    };
    let start = at(&[20.0, 0.0, 5.0]);
    interpret("turned.ngc", text, &setup, start).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn a_contour_is_followed_beside_it_and_left_by_a_straight_move() {
    let program =
        on_mill("G21 G17 G90 F600\nG41.1 D4\nG1 X10 Y0\nY-10\nX20\nG4 P1\nG40\nG91 X5\nG90 Z5\nM2")
            .unwrap();
    let expected = [
        "line 10.0000 2.0000 0.0000",
        "arc 12.0000 0.0000 0.0000 r2.0000",
        "line 12.0000 -8.0000 0.0000",
        "line 20.0000 -8.0000 0.0000",
        "dwell 1",
        "line 25.0000 -10.0000 0.0000",
        "line 25.0000 -10.0000 5.0000",
    ];
    assert_eq!(written(&program), expected);
    assert!(program.path.is_finite());
    assert_eq!(program.path.elements[0].start(), program.start);
    let starts = program.path.elements.iter().skip(1);
    for (before, after) in program.path.elements.iter().zip(starts) {
        assert_eq!(before.end(), after.start());
    }
}

#[test]
fn what_happens_between_moves_stays_there() {
    let program =
        on_mill("G21 F600\nG42.1 D4\nG1 X10\nS100 M3\nX20\nM5\nY-20\nG40 G0 X0\nM2").unwrap();
    let places: Vec<(EventKind, usize)> = program
        .events
        .iter()
        .map(|event| (event.kind, event.before_element))
        .filter(|(kind, _)| matches!(kind, EventKind::SpindleClockwise | EventKind::SpindleStop))
        .collect();
    assert_eq!(
        places,
        [
            (EventKind::SpindleClockwise, 1),
            (EventKind::SpindleStop, 2)
        ]
    );
}

#[test]
fn a_program_may_end_beside_its_contour() {
    for end in ["M2", "M30", ""] {
        let program = on_mill(&format!("G21 F600\nG41.1 D4\nG1 X10\nX20\n{end}")).unwrap();
        assert_eq!(
            written(&program).last().unwrap(),
            "line 20.0000 2.0000 0.0000",
            "{end}"
        );
    }
}

#[test]
fn a_lead_in_arc_begins_where_the_tool_is() {
    let program = on_mill(
        "G21 F600\nG0 X50 Y50\nG41.1 D3\nG3 X70 Y50 I10 J0\nG3 I-20\nG3 X50 Y50 I-10\nG40\nG0 X50 Y50\nM2",
    )
    .unwrap();
    let expected = [
        "line 50.0000 50.0000 0.0000",
        "arc 68.5000 50.0000 0.0000 r9.2500",
        "arc 68.5000 50.0000 0.0000 r18.5000",
        "arc 51.5000 50.0000 0.0000 r8.5000",
        "line 50.0000 50.0000 0.0000",
    ];
    assert_eq!(written(&program), expected);
}

#[test]
fn a_helix_keeps_its_turns_and_another_plane_its_side() {
    let program = lathe("G21 G18 G90 F600\nG0 X0 Z0\nG42.1 D2 L3\nG1 Z-10 X10\nZ-20\nG40\nX30\nM2");
    let expected = ["line 0.0000 0.0000 0.0000", "line 11.7071 0.0000 -10.2929"];
    assert_eq!(written(&program)[..1], expected[..1]);
    assert_eq!(written(&program)[1], expected[1]);
    let helix =
        on_mill("G21 F600\nG41.1 D4\nG1 X10\nG3 X10 Y0 I0 J10 P3 Z9\nG40\nG1 X50\nM2").unwrap();
    let sweeps: Vec<f64> = helix
        .path
        .elements
        .iter()
        .filter_map(|element| match element.shape {
            Shape::Arc { sweep_rad, .. } => Some(sweep_rad / std::f64::consts::TAU),
            _ => None,
        })
        .collect();
    assert_eq!(sweeps.len(), 1);
    assert!((sweeps[0] - 3.0).abs() < 1e-9, "{sweeps:?}");
}

#[test]
fn what_the_tool_cannot_follow_is_refused_with_its_line() {
    for (text, expected) in [
        (
            "G21 F600\nG41.1 D12\nG1 X5\nM2",
            "3:1: a lead-in of 5 mm for a tool radius of 6 mm",
        ),
        (
            "G21 F600\nG41.1 D12\nG1 X20\nY20\nX10\nY0\nG40\nM2",
            "6:1: the tool radius 6 mm does not fit the inside corner before this block",
        ),
        (
            "G21 F600\nG41.1 D12\nG1 X20\nG3 Y10 J5\nM2",
            "4:1: the tool radius 6 mm does not fit inside an arc of radius 5 mm",
        ),
        (
            "G21 F600\nG41.1 D4\nG1 X20\nG40\nG3 X40 I10\nM2",
            "5:1: an arc behind the radius compensation",
        ),
        (
            "G21 F600\nG41.1 D4\nG1 X20\nG28\nM2",
            "4:1: G28 while the radius compensation is on",
        ),
        (
            "G21 F600\nG41.1 D4\nG1 X20\nG42.1 D4\nM2",
            "4:1: G42.1 while the radius compensation is on",
        ),
        (
            "G21 F600\nG41\nM2",
            "2:1: G41 with a tool whose radius nobody knows",
        ),
        ("G21 F600\nG41.1\nM2", "2:1: G41.1 without D"),
        ("G21 G19 F600\nG41.1 D4\nM2", "2:1: G41.1 in G19"),
    ] {
        let found = refusal(text);
        assert!(found.contains(expected), "{text}:\n{found}");
    }
}

#[test]
fn polar_words_are_places_about_the_zero_of_the_program() {
    let program = on_mill(
        "G21 F600\nG10 L2 P1 X10 Y20\nG0 @10 ^0\n^90 Z1\nG1 @5\nG91 @5 ^-90\nG90\nG81 ^180 Z-3 R2\nM2",
    )
    .unwrap();
    let expected = [
        "line 20.0000 20.0000 0.0000",
        "line 10.0000 30.0000 1.0000",
        "line 10.0000 25.0000 1.0000",
        "line 20.0000 20.0000 1.0000",
    ];
    assert_eq!(written(&program)[..4], expected);
    assert!(written(&program).contains(&"line 0.0000 20.0000 -3.0000".to_owned()));
    for (text, expected) in [
        ("G0 @5\nM2", "@ without ^ at X0 Y0"),
        ("G0 X1\nG91 @5 Y1\nM2", "Y beside a polar word"),
        ("G92 @5\nM2", "@ and ^ belong to motions"),
        ("G53 G0 @5 ^3\nM2", "a polar word with G53"),
    ] {
        let found = refusal(text);
        assert!(found.contains(expected), "{text}:\n{found}");
    }
}

const PROFILE: &str =
    "O100 sub\nG1 X5 Z0\nG1 X5 Z-10\nG1 X8 Z-12\nG1 Z-20\nG1 X15 Z-25\nO100 endsub\n";

#[test]
fn a_profile_is_roughed_and_finished() {
    let program = lathe(&format!(
        "G21 G18 G90 F400\n{PROFILE}G71 Q100 X20 Z5 D0 I3 R0.5\nX30\nM2"
    ));
    let expected = [
        "line 20.0000 0.0000 -25.0000",
        "line 20.5000 0.0000 -24.5000",
        "line 20.5000 0.0000 4.5000",
        "line 20.0000 0.0000 5.0000",
        "line 17.0000 0.0000 4.0000",
        "line 17.0000 0.0000 -25.0000",
    ];
    assert_eq!(written(&program)[..6], expected);
    assert_eq!(
        written(&program)[written(&program).len() - 2..],
        [
            "line 20.0000 0.0000 -25.0000",
            "line 30.0000 0.0000 -25.0000"
        ]
    );
    let finished = lathe(&format!(
        "G21 G18 G90 F400\n{PROFILE}G70 Q100 D1 E.5 P2\nM2"
    ));
    let expected = [
        "line 5.7500 0.0000 0.0000",
        "line 5.7500 0.0000 -9.5986",
        "line 8.4160 0.0000 -11.3760",
        "arc 8.7500 0.0000 -12.0000 r0.7500",
    ];
    assert_eq!(written(&finished)[..4], expected);
}

#[test]
fn a_finishing_pass_may_be_compensated() {
    let program = lathe(&format!(
        "G21 G18 G90 F400\nG0 X20 Z10\n{PROFILE}G42.1 D1\nG70 Q100 X20 Z5\nG40\nG0 X30\nM2"
    ));
    assert!(
        written(&program).contains(&"line 5.5000 0.0000 -9.7324".to_owned()),
        "{:#?}",
        written(&program)
    );
}

#[test]
fn what_is_wrong_with_a_cycle_is_told_at_its_place() {
    for (text, expected) in [
        (
            "G18 F400\nG71 Q7 I1\nM2",
            "2:5: Q7: there is no such subroutine",
        ),
        ("G18 F400\nG71 I1\nM2", "2:1: G71 without Q"),
        (
            &format!("G17 F400\n{PROFILE}G71 Q100\nM2"),
            "9:1: G71 outside G18",
        ),
        (
            &format!("G18 G91 F400\n{PROFILE}G71 Q100\nM2"),
            "9:1: G71 in G91",
        ),
        (
            "G18 F400\nO1 sub\nG1 X1\nM3\nO1 endsub\nG71 Q1\nM2",
            "4:1: M3 in a profile",
        ),
        (
            "G18 F400\nO1 sub\nG1 X5 Z0\nO2 call\nO1 endsub\nG71 Q1\nM2",
            "4:1: O2 call in a profile",
        ),
        (
            "G18 F400\nO1 sub\nG1 X5 Z0\nO2 while [1]\nG1 X6\nG1 X5\nO2 endwhile\nO1 endsub\nG71 Q1\nM2",
            "a profile of more than 10000 lines",
        ),
        (
            "G18 F400\nO1 sub\nG1 X5 Z0\nO2 repeat [3]\nG1 X6\nO1 endsub\nG71 Q1\nM2",
            "O2 repeat without O2 endrepeat",
        ),
        (
            &format!("G18 F400\n{PROFILE}G71 Q100 I0\nM2"),
            "a depth of cut I of 0 mm",
        ),
        ("G0 U5\nM2", "U5: this machine has the axes X Y Z"),
    ] {
        let found = refusal(text);
        assert!(found.contains(expected), "{text}:\n{found}");
    }
}

/// A cone and steps behind it, the steps by a loop and a condition or written out.
#[test]
fn a_profile_of_loops_and_conditions_is_the_one_that_they_lead_to() {
    let of = |lines: &str| {
        let text = format!(
            "G21 G18 G90 F400\nO100 sub\nG0 X4 Z2\nG1 Z0\nG1 X8 Z-4\n{lines}O100 endsub\nG0 X40 Z5\nG71 Q100 I2 D0.2\nG70 Q100\nM2\n"
        );
        let mut program = on_mill(&text).unwrap_or_else(|error| panic!("{error}"));
        for element in &mut program.path.elements {
            element.line = 0;
        }
        program.path
    };
    let looped = of(
        "#1 = 0\nO2 while [#1 LT 4]\n#1 = [#1 + 1]\nG1 X[8 + 3 * #1]\n\
         O3 if [#1 EQ 3]\nG1 Z-20\nO3 else\nG1 Z[-4 - 4 * #1]\nO3 endif\nO2 endwhile\n",
    );
    let written = of("G1 X11\nG1 Z-8\nG1 X14\nG1 Z-12\nG1 X17\nG1 Z-20\nG1 X20\nG1 Z-20\n");
    assert!(written.elements.len() > 20);
    assert_eq!(looped, written);
}
