//! Whatever the text, the interpreter ends, without a panic, with a sound path or a refusal.

use crate::common::{at, mill};
use machine::Dialect;
use path::tool_centre::{RotaryLine, ToolCentre};
use program::{
    AxisSetup, Piece, Program, ProgramError, Progress, Reading, Setup, interpret, parse_tools,
};
use proptest::prelude::*;
use std::sync::Arc;

fn machines() -> [Setup; 3] {
    let mut five = mill(100.0);
    five.work_offset = at(&[1.5, -2.25, 0.1]);
    for letter in ['A', 'U'] {
        five.axes.push(AxisSetup {
            letter,
            travel_min: -400.0,
            travel_max: 400.0,
            rotary: letter == 'A',
            modulo: false,
        });
    }
    let fanuc = Setup {
        dialect: Dialect::Fanuc,
        answers_assumed: true,
        ..five.clone()
    };
    [mill(1e9), five, fanuc]
}

fn check(result: Result<Program, ProgramError>, setup: &Setup) -> Result<(), TestCaseError> {
    match result {
        Ok(program) => {
            prop_assert!(program.path.is_finite());
            prop_assert_eq!(program.path.first_break(), None);
            prop_assert!(
                program
                    .path
                    .elements
                    .iter()
                    .all(|element| element.length_mm > 0.0 || element.is_dwell())
            );
            if let Some((low, high)) = program.path.bounds() {
                for (axis, (low, high)) in setup.axes.iter().zip(low.iter().zip(high.iter())) {
                    prop_assert!(*low >= axis.travel_min - 2e-6 && *high <= axis.travel_max + 2e-6);
                }
            }
        }
        Err(error) => {
            prop_assert!(!error.problems.is_empty() && error.problems.len() <= 20);
            let lines: Vec<_> = error
                .problems
                .iter()
                .filter_map(|problem| problem.place)
                .collect();
            prop_assert!(lines.is_sorted_by_key(|place| place.0));
            prop_assert!(!error.to_string().is_empty());
        }
    }
    Ok(())
}

/// Words likely to mean something.
fn word() -> impl Strategy<Value = String> {
    let code = prop::sample::select(vec![
        "G0", "G1", "G2", "G3", "g4 P.1", "G17", "G18", "G19", "G20", "G21", "G40", "G49", "G54",
        "G61", "G64", "G80", "G90", "G91", "G90.1", "G91.1", "G94", "G81", "G82", "G83", "G98",
        "G99", "M3", "M4", "M5", "F500", "S100", "/", "(c)", "G5", "G5.1", "G5.2", "G5.3", "G33",
        "G33.1", "G73", "G74", "G76", "G84", "G85", "G86", "G87", "G88", "G89", "G93", "G95", "G7",
        "G8", "H2", "E1",
    ]);
    let value = prop_oneof![-40i32..40, Just(0), Just(10)];
    let letter = prop::sample::select(vec![
        "X", "Y", "Z", "A", "U", "I", "J", "K", "R", "P", "Q", "L",
    ]);
    prop_oneof![
        code.prop_map(str::to_owned),
        (letter, value).prop_map(|(letter, value)| format!("{letter}{value}"))
    ]
}

/// Lines of Fanuc's language that mostly mean something.
fn fanuc_line() -> impl Strategy<Value = String> {
    let small = || 0i32..6;
    let line = prop::sample::select(vec![
        "O1",
        "O2 (SUB)",
        ":3",
        "M98 P2 L2",
        "M98 P20002",
        "M99",
        "M99 P5",
        "M97 P5",
        "G65 P2 A1. X2. I3. I4.",
        "G66 P3 Z-1.",
        "G67",
        "N5",
        "N6 G1 X1. F100",
        "GOTO 5",
        "IF [#1 LT 3] GOTO 5",
        "IF[#2EQ#0]THEN#2=1",
        "WHILE [#1 LT 4] DO1",
        "DO2",
        "END1",
        "END2",
        "#1=#1+1",
        "#2=#0",
        "#3=#5001+ATAN[#1]/[2]",
        "#5221=#3",
        "#7001=1.5",
        "#3000=1 (A)",
        "#3006=1 (B)",
        "#2001=#2001+1",
        "G68 X1. Y2. R30.",
        "G69",
        "G54.1 P1",
        "G54",
        "G10 L20 P1 X1. Y2.",
        "G10 L2 P1 X1.",
        "G16",
        "G15",
        "G31 Z-2. F50",
        "G1 X5. ,R1. F100",
        "X5. Y5. ,C.5",
        "G0 Y3.",
        "G91",
        "G90",
        "G28 X0",
        "G0 G28 G91 Z0",
        "G81 Z-1. R1. K0 F100",
        "G83 Z-5. R1. Q1. X3.",
        "G84 Z-1. R1. S100",
        "G80",
        "G4 P10",
        "G2 X3. Y0 R4.",
        "G41 D1 X9.",
        "G40 X0",
        "G187 P1",
        "T1 M6",
        "G43 H1 Z9.",
        "G20",
        "G21",
        "M30",
        "%",
    ]);
    (line, small(), small()).prop_map(|(line, from, to)| match from {
        0 => line.replace(&to.to_string(), &format!("#{to}")),
        1 => line.replace(&to.to_string(), "["),
        _ => line.to_owned(),
    })
}

/// A mill of five axes, C without an end.
fn five_axes() -> Setup {
    let mut setup = mill(400.0);
    for (letter, index) in [('A', 3), ('C', 4)] {
        setup.axes.push(AxisSetup {
            letter,
            travel_min: if index == 3 { -100.0 } else { -1e9 },
            travel_max: if index == 3 { 100.0 } else { 1e9 },
            rotary: true,
            modulo: index == 4,
        });
    }
    let line = |axis, direction| RotaryLine::new(axis, [5.0, -3.0, -80.0], direction).unwrap();
    let lines = vec![line(3, [-1.0, 0.0, 0.001]), line(4, [0.0, 0.002, -1.0])];
    setup.tool_centre = Some(Arc::new(ToolCentre::new([0, 1, 2], lines, vec![])));
    setup.tools = parse_tools("tools.tbl", "T1 P1 Z60 D6\nT2 P2 X1 Z85.5 D3\n").unwrap();
    setup.probe = true;
    setup.answers_assumed = true;
    setup
}

/// Lines for five axes that mostly mean something.
fn five_axis_line() -> impl Strategy<Value = String> {
    let number = || (-60i32..60).prop_map(f64::from);
    let word = prop::sample::select(vec![
        "G43.4 H1",
        "G43.4 H2",
        "G43 H1",
        "G43.1 Z5",
        "G49",
        "G53.1",
        "G69",
        "G80",
        "G90",
        "G91",
        "G61",
        "G61.1",
        "G64 P0.02",
        "G92 X1",
        "G92.1",
        "G55",
        "G54",
        "G20",
        "G21",
        "G7",
        "G8",
        "G93",
        "G94",
        "G95",
        "G96 S50",
        "G97 S900 M3",
        "M6 T1",
        "G28",
        "G4 P0.1",
        "G40",
        "M70",
        "M72",
        "G52 X0",
        "G10 L2 P1 R20",
        "G10 L2 P1 R0",
        "G10 L20 P1 X3",
        "G33 Z1 K1",
        "@5 ^30",
        "G18",
        "G19",
        "G17",
        "G0 G53 Z0",
    ]);
    prop_oneof![
        word.prop_map(str::to_owned),
        (number(), number(), number()).prop_map(|(x, a, c)| format!("G1 X{x} A{a} C{c} F500")),
        (number(), number()).prop_map(|(y, z)| format!("G1 Y{y} Z{z} F900")),
        (number(), number()).prop_map(|(a, c)| format!("G0 A{a} C{c}")),
        (number(), number()).prop_map(|(i, c)| format!("G17 G3 I{i} C{c} F700")),
        (number(), number()).prop_map(|(x, y)| format!("G17 G2 X{x} Y{y} R90 F700")),
        (number(), number(), number())
            .prop_map(|(i, j, k)| format!("G68.2 X{k} Z3 I{i} J{j} K{k}")),
        (number(), number()).prop_map(|(x, y)| format!("G98 G81 X{x} Y{y} Z-8 R3 F300")),
        (number(), number()).prop_map(|(x, y)| format!("G17 G5.1 X{x} Y{y} I3 J4 F300")),
    ]
}

/// Blocks that mostly run: arcs with consistent ends, in every plane.
fn good_block() -> impl Strategy<Value = String> {
    let number = || (-80i32..80).prop_map(|value| f64::from(value) / 2.0);
    prop_oneof![
        (number(), number(), number()).prop_map(|(x, y, z)| format!("G1 X{x} Y{y} Z{z}")),
        (number(), number()).prop_map(|(x, y)| format!("G0 X{x} U{y} A{x}")),
        (number(), number(), 1..4u32).prop_map(|(i, j, p)| format!("G17 G2 I{i} J{j} P{p}")),
        (number(), number()).prop_map(|(i, z)| format!(
            "G18 G91 G3 X{} Z{z} I{i} K{} G90",
            2.0 * i,
            z / 2.0
        )),
        (number(), number()).prop_map(|(y, z)| format!("G19 G3 Y{y} Z{z} R150")),
        (number(), number()).prop_map(|(y, z)| format!("G19 G2 Y{y} Z{z} R-70.25 X3")),
        (number(), number(), 1..4u32)
            .prop_map(|(x, z, l)| format!("G17 G99 G81 X{x} Z{} R{z} L{l}", z - 5.0)),
        (number(), 1..4u32)
            .prop_map(|(x, l)| format!("G17 G98 G91 G83 X{} Z-7 R-2 Q3 L{l} G90", x / 20.0)),
        Just("G4 P0.5".to_owned()),
        curve_or_thread(),
    ]
}

/// Splines, threads, and cycles that do something with the spindle.
fn curve_or_thread() -> impl Strategy<Value = String> {
    let number = || (-80i32..80).prop_map(|value| f64::from(value) / 2.0);
    let cycle = prop::sample::select(vec!["84", "85", "86", "87", "88", "89", "73"]);
    let cycle_block = (cycle, 17..20u32, number()).prop_map(|(cycle, plane, at)| {
        let extra = match cycle {
            "86" | "88" | "89" => "P0.1",
            "87" => "I1 J2 K3",
            "73" => "Q2",
            _ => "",
        };
        format!("M3 S100 G94 F600 G{plane} G98 G91 G{cycle} X-3 Y-4 Z-5 R1 {extra} L2 G90\nG80\nG0 X{at}")
    });
    prop_oneof![
        (number(), number(), number(), number()).prop_map(|(x, y, i, j)| format!(
            "G17 G5 X{x} Y{y} I{i} J{j} P{j} Q{i}\nG5 X{y} Y{x} P{x} Q{j}"
        )),
        (number(), number(), number())
            .prop_map(|(x, y, i)| format!("G17 G5.1 X{x} Y{y} I{i} J{x}")),
        (
            prop::collection::vec((number(), number(), 1..5u32), 4..9),
            3..5u32
        )
            .prop_map(|(points, order)| {
                let points = points.iter().map(|(x, y, p)| format!("X{x} Y{y} P{p}\n"));
                format!("G17 G5.2 P2 L{order}\n{}G5.3", points.collect::<String>())
            }),
        (number(), 1..4u32, number()).prop_map(|(z, taper, q)| format!(
            "M3 S100 G18 G0 X20 Z{z}\nG76 P1 Z{} I-2 J0.3 K1.1 R1.3 H1 Q{} E1 L{taper}\nG17",
            z - 20.0,
            q / 2.0
        )),
        (number(), number())
            .prop_map(|(x, z)| format!("M4 S200 G33 X{x} Z{z} K1.5\nG33.1 Z{x} K0.7 I2")),
        cycle_block,
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_words_never_break_the_interpreter(lines in prop::collection::vec(prop::collection::vec(word(), 0..6), 0..12)) {
        let text: String = lines.iter().map(|words| words.join(" ") + "\n").collect();
        for setup in machines() {
            check(interpret("fuzz", &text, &setup, at(&[0.5])), &setup)?;
        }
    }

    #[test]
    fn random_programs_of_five_axes_never_break_the_interpreter(lines in prop::collection::vec(five_axis_line(), 0..15)) {
        let setup = five_axes();
        let mut text = String::from("T1 M6\n");
        // What is refused is left out, so that what follows it is read.
        for line in lines {
            let longer = format!("{text}{line}\n");
            let result = interpret("fuzz", &longer, &setup, at(&[0.5]));
            if result.is_ok() {
                text = longer;
            }
            check(result, &setup)?;
        }
    }

    #[test]
    fn random_programs_of_fanuc_never_break_the_interpreter(lines in prop::collection::vec(fanuc_line(), 0..25)) {
        // Its loops may go on for ever: only some thousand blocks are read.
        let text = lines.join("\n");
        let setup = Arc::new(machines()[2].clone());
        let mut reading = Reading::of_text("fuzz", &text, &setup, at(&[0.5])).unwrap();
        let mut piece = Piece::default();
        let mut end = at(&[0.5]);
        for _ in 0..20 {
            let progress = reading.read(100, &mut piece);
            for element in piece.elements.drain(..) {
                prop_assert!(element.shape.is_finite());
                prop_assert!((element.start() - end).norm() < 1e-5, "{text}");
                end = element.end();
            }
            match progress {
                Ok(Progress::More) => {}
                Ok(_) => break,
                Err(error) => {
                    prop_assert!(!error.to_string().is_empty());
                    break;
                }
            }
        }
    }

    #[test]
    fn random_text_never_breaks_the_interpreter(text in "(?s).{0,200}") {
        for setup in machines() {
            check(interpret("fuzz", &text, &setup, at(&[0.5])), &setup)?;
        }
    }

    #[test]
    fn random_bytes_of_the_right_alphabet_never_break_the_interpreter(text in "[GMXYZAIJKRPFSNO0-9.+\\-/%();# \n\r]{0,200}") {
        for setup in machines() {
            check(interpret("fuzz", &text, &setup, at(&[0.5])), &setup)?;
        }
    }

    #[test]
    fn random_good_programs_make_unbroken_paths(blocks in prop::collection::vec(good_block(), 1..30)) {
        let text = format!("F600\n{}\nM2\n", blocks.join("\n"));
        for setup in machines() {
            if setup.axes.len() == 3 && text.contains('U') { continue; }
            check(interpret("fuzz", &text, &setup, at(&[0.5])), &setup)?;
        }
    }
}
