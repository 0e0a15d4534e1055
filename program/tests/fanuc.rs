//! Programs in Fanuc's language: what a machinist would see of them.

use crate::common::{mill, slide};
use machine::Dialect;
use path::geometry::AxisVector;
use program::{
    EventKind, Piece, Program, ProgramEnd, ProgramError, Progress, Reading, Setup, Tool, interpret,
    load,
};
use std::sync::Arc;

fn fanuc(travel_mm: f64) -> Setup {
    Setup {
        dialect: Dialect::Fanuc,
        tools: (1..=3).map(tool).collect(),
        ..mill(travel_mm)
    }
}

/// A tool whose length is ten times its number.
fn tool(number: u32) -> Tool {
    let mut tool = Tool {
        number,
        pocket: number,
        diameter: 6.0,
        ..Tool::default()
    };
    tool.offset[2] = 10.0 * f64::from(number);
    tool
}

fn read(text: &str) -> Result<Program, ProgramError> {
    interpret("part.nc", text, &fanuc(500.0), AxisVector::zeros())
}

fn program(text: &str) -> Program {
    read(text).unwrap_or_else(|error| panic!("{error}"))
}

/// Where each move ends, X Y Z.
fn ends(text: &str) -> Vec<[f64; 3]> {
    let elements = program(text).path.elements;
    elements
        .iter()
        .filter(|element| !element.is_dwell())
        .map(|element| [0, 1, 2].map(|axis| (element.end()[axis] * 1e7).round() / 1e7 + 0.0))
        .collect()
}

fn xs(text: &str) -> Vec<f64> {
    ends(text).iter().map(|end| end[0]).collect()
}

/// The path of the same program in LinuxCNC's words.
fn same(fanuc: &str, linuxcnc: &str) {
    let setup = Setup {
        dialect: Dialect::LinuxCnc,
        ..self::fanuc(500.0)
    };
    let other = interpret("part.ngc", linuxcnc, &setup, AxisVector::zeros());
    let other = other.unwrap_or_else(|error| panic!("{error}"));
    let shapes = |program: &Program| {
        let elements = program.path.elements.iter();
        let each = elements.map(|element| format!("{:.6?} {:.6?}", element.shape, element.feed));
        each.collect::<Vec<_>>()
    };
    assert_eq!(shapes(&program(fanuc)), shapes(&other), "{fanuc}");
    let kinds = |program: &Program| {
        program
            .events
            .iter()
            .map(|event| event.kind)
            .collect::<Vec<_>>()
    };
    assert_eq!(kinds(&program(fanuc)), kinds(&other), "{fanuc}");
}

fn refused(text: &str, part: &str) {
    match read(text) {
        Ok(_) => panic!("{text} is not refused"),
        Err(error) => assert!(error.to_string().contains(part), "{error}"),
    }
}

fn noted(text: &str, part: &str) {
    let notes = program(text).notes;
    let found = notes.iter().any(|note| note.shown().contains(part));
    assert!(found, "{notes:?}");
}

#[test]
fn subprograms_are_called_by_number_with_counts_in_both_writings() {
    let subs = "O1000\nG91 G0 X1\nG90 M99\n%";
    let text = |call: &str| format!("%\nO0001 (PART)\nG90 G0 X0 Y0\n{call}\nM30\n{subs}");
    for call in [
        "M98 P1000 L3",
        "M98 P0031000",
        "M98 P31000",
        "M98 P[500*2] L3",
        "M98P1000L3",
    ] {
        assert_eq!(xs(&text(call)), [1.0, 2.0, 3.0], "{call}");
    }
    assert_eq!(xs(&text("X5 M98 P1000")), [5.0, 6.0]);
    assert_eq!(xs(":0001\nM98 P2\nM30\n:2\nG0 X4\nM99"), [4.0]);
    refused(
        &text("M98 P2000"),
        "part.nc:4:5: P2000: there is no program O2000",
    );
    refused(&text("M98"), "M98 without P");
    refused(&text("M98 P1.5"), "P1.5: a whole number");
    refused("O1\nM98 P2\nM30\nO2\nG0 X1\nO3\nM99", "O3 begins inside O2");
}

#[test]
fn a_subprogram_returns_to_the_block_that_p_names() {
    let text = "O1\nG0 X1\nM98 P2\nX2\nN50 X3\nM30\nO2\nY1\nM99 P50";
    assert_eq!(ends(text), [[1., 0., 0.], [1., 1., 0.], [3., 1., 0.]]);
    refused("O1\nM98 P2\nM30\nO2\nM99 P7", "GOTO 7: there is no N7");
    let local = "O1\nG91\nM97 P100 L2\nG0 Y1\nM30\nN100 G0 X1\nM99";
    assert_eq!(ends(local), [[1., 0., 0.], [2., 0., 0.], [2., 1., 0.]]);
}

#[test]
fn files_of_subprograms_are_found_beside_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("main.nc", "%\nO1\nM98 P1000\nG65 P9010 X7.\nM30\n%\n");
    write("O1000.nc", "%\nO1000 (SUB)\nG0 X5\nM99\n%\n");
    write("o09010.tap", "O9010\nG0 X#24\nM99\n");
    let file = folder.path().join("main.nc");
    let program = load(&file, &fanuc(100.0), AxisVector::zeros()).unwrap();
    let xs: Vec<f64> = program
        .path
        .elements
        .iter()
        .map(|element| element.end()[0])
        .collect();
    assert_eq!(xs, [5.0, 7.0]);
    // A copy says in which language it is written, also to a machine whose programs are in another one.
    let mut copy = vec![];
    program::bundle_to(&file, &[], Dialect::Fanuc, Dialect::LinuxCnc, &mut copy).unwrap();
    write("copy.nc", std::str::from_utf8(&copy).unwrap());
    let copied = load(
        &folder.path().join("copy.nc"),
        &Setup {
            dialect: Dialect::LinuxCnc,
            ..fanuc(100.0)
        },
        AxisVector::zeros(),
    );
    let copied = copied.unwrap();
    assert_eq!(copied.path, program.path);
    assert_eq!(copied.blocks[0].line, 2);
}

#[test]
fn macros_have_local_variables_by_both_tables() {
    let text = "O1\n#1=9.\nG65 P9010 A1. B2. Z-3. I4. J5.\nG0 X#1\nM30\nO9010\nG0 X#1 Y#2 Z#26\nX#4 Y#5\nX#3\n#1=77.\nM99";
    assert_eq!(ends(text), [[1., 2., -3.], [4., 5., -3.], [9., 5., -3.]]);
    assert_eq!(
        xs("O1\nG91\nG65 P2 L3 X2.\nM30\nO2\nG0 X#24\n#24=50.\nM99"),
        [2., 52., 102.]
    );
    refused("G65 A1.", "G65 without P");
    refused(
        "O1\nG65 P2 N5\nM30\nO2\nM99",
        "the arguments of a macro are",
    );
    refused("O1\nG65 P1 A1.\nM30", "called 100 deep");
}

#[test]
fn a_modal_call_follows_each_motion_until_it_ends() {
    let text =
        "O1\nG90 G0\nG66 P2 Z-4.\nX1.\nX2. Y1.\nG67\nX3.\nM30\nO2\nG1 Z#26 F100.\nG0 Z1.\nM99";
    let expected = [
        [1., 0., 0.],
        [1., 0., -4.],
        [1., 0., 1.],
        [2., 1., 1.],
        [2., 1., -4.],
        [2., 1., 1.],
        [3., 1., 1.],
    ];
    assert_eq!(ends(text), expected);
    refused(
        "O1\nG66 P2\nG66 P2\nM30\nO2\nM99",
        "G66 while G66 is in force",
    );
}

#[test]
fn conditions_jumps_and_loops_go_where_they_say() {
    let text = "#1=1\nN1 IF [#1 GT 3] GOTO 9\nG0 X#1\n#1=#1+1\nGOTO 1\nN9 Y1\nM30";
    assert_eq!(xs(text), [1., 2., 3., 3.]);
    let loops = "#1=0\nWHILE [#1 LT 2] DO1\n#2=0\nWHILE[#2LT2]DO2\nG0 X[#1*10+#2]Y#1\n#2=[#2+1]\nEND2\n#1=[#1+1]\nEND1\nM30";
    assert_eq!(xs(loops), [1., 10., 11.]);
    assert_eq!(
        xs("IF [#1 EQ #0] THEN #2=5\nG0 X#2\nIF[1EQ2]THEN#2=1/0\nX[#2+1]\nM30"),
        [5., 6.]
    );
    assert_eq!(
        xs("DO1\n#1=[#1+1]\nG0 X#1\nIF [#1 EQ 2] GOTO 5\nEND1\nN5 M30"),
        [1., 2.]
    );
    refused("GOTO 5\nM30", "GOTO 5: there is no N5");
    refused("GOTO 5\nN5\nN5\nM30", "N5 is there twice");
    refused("GOTO 1.5", "GOTO 1.5: the number of a block");
    refused("WHILE [1 EQ 1] DO4\nEND4", "a loop without its number");
    refused("WHILE [1 EQ 1] DO1\nM30", "DO1 without END1");
    refused("END1\nM30", "END1 without DO1");
    refused("IF [#1 EQ 1]\nM30", "IF [#1 EQ 0] GOTO 10");
    refused("N1 GOTO 1", "blocks in a row without a motion");
    refused(
        "#1=0\nWHILE[#1EQ0]DO1\nEND1",
        "blocks in a row without a motion",
    );
    refused(
        "IF [1 EQ 1 AND 2 EQ 2] GOTO 1",
        "two comparisons in one bracket",
    );
}

#[test]
fn expressions_are_those_of_the_manual() {
    for (expression, value) in [
        ("FIX[-1.2]", -1.0),
        ("FUP[-1.2]", -2.0),
        ("RO[1.5]", 2.0),
        ("SQRT[16]", 4.0),
        ("ATAN[1]/[1]", 45.0),
        ("ATAN[1,-1]", 135.0),
        ("[7 MOD 4]", 3.0),
        ("[12 AND 10]", 8.0),
        ("1+12 AND 10", 9.0),
        ("[12 OR 3]", 15.0),
        ("[6 XOR 3]", 5.0),
        ("BCD[12]", 18.0),
        ("BIN[18]", 12.0),
        ("POW[2,3]", 8.0),
        ("[2+3*4]", 14.0),
        ("ABS[-SIN[30]]", 0.5),
        ("#33+#100", 0.0),
    ] {
        let text = format!("#1={expression}\nG0 X100\nX#1\nM30");
        assert_eq!(xs(&text)[1], value, "{expression}");
    }
    refused("#1=SQRT[-1]", "SQRT of -1");
    refused("#1=1/0", "a division by zero");
    refused("X[2**3]", "a number");
}

#[test]
fn a_vacant_variable_is_no_word_and_equal_to_nothing_but_another() {
    assert_eq!(ends("G0 X5\nX#1 Y2\nM30"), [[5., 0., 0.], [5., 2., 0.]]);
    let compare = |condition: &str| {
        xs(&format!(
            "IF [{condition}] GOTO 1\nG0 X1\nM30\nN1 G0 X2\nM30"
        ))
    };
    assert_eq!(compare("#1 EQ #0"), [2.0]);
    assert_eq!(compare("#1 EQ 0"), [1.0]);
    assert_eq!(compare("#1 NE 0"), [2.0]);
    assert_eq!(compare("#1 GE 0"), [2.0]);
    assert_eq!(
        xs("#1=5\n#1=#0\nIF [#1 EQ #0] GOTO 1\nG0 X1\nN1 G0 X2\nM30"),
        [2.0]
    );
}

#[test]
fn system_variables_tell_and_set_what_they_stand_for_and_no_other_is_read() {
    assert_eq!(xs("G0 X3 Y4 Z5\nX[#5001+#5002+#5043]\nM30"), [3., 12.]);
    assert_eq!(xs("#5221=10.\nG54\nG0 X1\nX#5021\nM30"), [11., 21.]);
    assert_eq!(xs("#5241=20.\nG55 G0 X#5241\nM30"), [40.]);
    assert_eq!(
        xs("G0 X#2002\nX#13001\n#2002=7.\nX#11002\nM30"),
        [20., 3., 7.]
    );
    assert_eq!(
        xs("G91 G17 G21\nG0 X#4003\nX#4002\nX#4006\nM30"),
        [91., 108., 129.]
    );
    assert_eq!(
        xs("G0 F300 S1200 T2\nX[#4109/10]\nX[#4119/10]\nX#4120\nM30"),
        [30., 120., 2.]
    );
    for number in [
        "34", "1000", "3001", "5201", "5999", "2201", "10001", "99999",
    ] {
        refused(&format!("#1=#{number}"), &format!("#{number}, which"));
        refused(&format!("#{number}=1"), &format!("#{number}, which"));
    }
    refused("#5001=1", "read-only");
    refused("#0=1", "#0 never has a value");
    refused("#1=#3000", "#3000, which has no value");
    refused("#1=#5004", "#5004, of axis 4: this machine has 3 axes");
    refused("#1=#2009", "tool 9, which the tool table does not have");
}

#[test]
fn alarms_end_and_stops_wait_with_their_text() {
    let alarm = program("G0 X1\n#3000=5 (TOOL MISSING)\nX2\nM30");
    assert_eq!(alarm.end, ProgramEnd::Abort(2));
    assert_eq!(alarm.messages[0].text, "alarm 3005 TOOL MISSING");
    assert_eq!(alarm.path.elements.len(), 1);
    let stop = program("G0 X1\n#3006=1 (TURN THE PART)\nX2\nM30");
    assert_eq!(stop.messages[0].text, "TURN THE PART");
    assert_eq!(stop.events[0].kind, EventKind::ProgramStop);
    noted("#3003=1\nG0 X1\nM30", "#3003 and #3004 have no effect");
}

#[test]
fn more_work_offsets_are_set_and_chosen_by_every_name() {
    for (set, choose) in [
        ("G10 L20 P3 X10. Y5.", "G54.1 P3"),
        ("#7041=10.\n#7042=5.", "G154 P3"),
        ("G90 G10 L20 P3 X10. Y5.", "G112"),
        ("#14041=10. \n#14042=5.", "G54.1P3"),
    ] {
        let text = format!("{set}\n{choose}\nG0 X1. Y1.\nG54 X1.\nM30");
        assert_eq!(ends(&text), [[11., 6., 0.], [1., 6., 0.]], "{set} {choose}");
    }
    assert_eq!(xs("G54.1 P48\nG0 X#4130\nM30"), [48.0]);
    refused("G54.1 X1", "G54.1 without P");
    refused("G54.1 P301", "P301: the offsets of G54.1 are P1 to P300");
    refused("G91 G10 L2 P1 X1", "G10 in G91");
    refused("G10 L2 P0 X1", "G10 L2 P0");
    refused("G10 L11 P1 R1", "G10 L11 P1");
    assert_eq!(xs("G10 L10 P2 R33.\nG0 X#11002\nM30"), [33.0]);
}

#[test]
fn a_rotation_turns_places_about_its_centre() {
    assert_eq!(
        ends("G68 X10. Y0 R90.\nG0 X20. Y0\nG69\nG0 X20. Y0\nM30"),
        [[10., 10., 0.], [20., 0., 0.]]
    );
    assert_eq!(
        ends("G0 X10. Y5.\nG68 R180.\nG0 X11. Y5.\nM30")[1],
        [9., 5., 0.]
    );
    assert_eq!(
        ends("G52 X100.\nG68 X0 Y0 R90.\nG0 X5. Y0\nM30"),
        [[100., 5., 0.]]
    );
    same(
        "G90 G54 G68 X0 Y0 R30.\nG1 X10 F100\nG2 X20 I5 J0\nM30",
        "G10 L2 P1 R30\nG54 G1 X10 F100\nG2 X20 I5 J0\nM2",
    );
    refused("G68 X0 Y0", "G68 without R");
    refused("G18 G68 X0 R5.", "G68 in G18");
}

#[test]
fn corners_are_rounded_and_chamfered_between_two_lines() {
    same(
        "G1 F100 X10. ,R2.\nY10.\nM30",
        "G1 F100 X8\nG3 X10 Y2 R2\nG1 Y10\nM2",
    );
    same(
        "G1 F100 X10. ,C2.\nY10.\nM30",
        "G1 F100 X8\nX10 Y2\nY10\nM2",
    );
    same(
        "G91 G1 F100 X10. ,R2.\nY10. ,C1.\n(AND BACK)\nX-5.\nX-1. Y-1.\nM30",
        "G1 F100 X8\nG3 X10 Y2 R2\nG1 Y9\nX9 Y10\nX5\nX4 Y9\nM2",
    );
    refused(
        "G1 F100 X10. ,R20.\nY10.\nM30",
        "which takes 20.0000 mm off blocks of 10.0000 and 10.0000 mm",
    );
    refused(
        "G1 F100 X10. ,R2.\nG2 Y10. R5.\nM30",
        ",R2 before a block that is no G1 alone",
    );
    refused("G1 F100 X10. ,R2.\nM30", ",R2 before");
    refused("G1 F100 X10. ,R2.", ",R2 without a next block");
    refused("G0 X10. ,R2.\nY10.\nM30", ",R2 in a block that is no G1");
    refused("G1 F100 X10. ,A2.\nY10.\nM30", ",A: ,R rounds a corner");
    refused("G1 F100 X10. ,R-2.\nY10.\nM30", ",R-2");
}

#[test]
fn cycles_take_milliseconds_and_k_and_l0() {
    same(
        "G98 G82 X1. Y1. Z-5. R1. P500 F100\nG91 X2. K2\nG80\nM30",
        "G98 G82 X1 Y1 Z-5 R1 P0.5 F100\nG91 X2 L2\nG80\nM2",
    );
    same(
        "G0 Z5\nG99 G81 Z-5. R1. F100. L0\nX1.\nX2.\nG80\nM30",
        "G0 Z5\nG99 G81 X1 Z-5 R1 F100\nX2\nG80\nM2",
    );
    same(
        "G4 P500\nG0 X1\nG4 X1.5\nG4 P2.\nM30",
        "G4 P0.5\nG0 X1\nG4 P1.5\nG4 P2\nM2",
    );
    same(
        "M29 S500\nG84 Z-5. R1. F500.\nG80\nM30",
        "S500\nM3 G84 Z-5 R1 F500\nG80\nM2",
    );
    same(
        "T1 M6 G0\nG43 H1 D1 Z20.\nG1 G41 X10. F100.\nX20.\nG40 Y10.\nM30",
        "T1 M6 G0\nG43 H1\nZ20\nG1 G41 D1 X10 F100\nX20\nG40 Y10\nM2",
    );
    refused("G76 X1 Z-5 R1 Q1 F100", "G76: fine boring is not supported");
}

#[test]
fn polar_places_skip_and_reference_positions() {
    same(
        "G90 G17 G16\nG0 X10. Y90.\nY180.\nG15\nX1. Y1.\nM30",
        "G0 @10 ^90\n^180\nX1 Y1\nM2",
    );
    same("G0 G28 G91 Z0.\nG30 P2 Z0\nM30", "G91 G28 Z0\nG30 Z0\nM2");
    refused("G30 P3 Z0", "P3: G30 goes to the second reference position");
    let probing = Setup {
        answers_assumed: true,
        ..fanuc(100.0)
    };
    let text = "G1 X1. F100.\nG31 Z-5.\nX#5063\nM30";
    let skipped = interpret("part.nc", text, &probing, AxisVector::zeros()).unwrap();
    let end = skipped.path.elements.last().unwrap().end();
    assert_eq!((end[0], end[2]), (-5.0, -5.0));
}

#[test]
fn lathes_have_tools_with_offsets_increments_and_feeds_of_their_own() {
    let lathe = Setup {
        axes: vec![slide('X', -200.0, 200.0), slide('Z', -200.0, 200.0)],
        ..fanuc(1.0)
    };
    let read = |text: &str| interpret("part.nc", text, &lathe, AxisVector::zeros());
    let ends = |text: &str| -> Vec<[f64; 2]> {
        let program = read(text).unwrap_or_else(|error| panic!("{error}"));
        let elements = program.path.elements.iter();
        elements
            .map(|element| [0, 1].map(|axis| element.end()[axis]))
            .collect()
    };
    assert_eq!(
        ends("G18\nG0 X10. Z5.\nU2. W-1.\nG91 U1.\nM30"),
        [[10., 5.], [12., 4.], [13., 4.]]
    );
    assert_eq!(
        ends("T0102\nG0 Z5.\nT0100\nZ5.\nM30"),
        [[0., 25.], [0., 5.]]
    );
    assert_eq!(ends("G0 X5. Z5.\nG28 U0 W0\nM30"), [[5., 5.], [0., 0.]]);
    let events = read("T0303\nG50 S2000\nG96 S100 M3\nG99 G1 X1. F.1\nM30")
        .unwrap()
        .events;
    assert!(
        events
            .iter()
            .any(|event| event.kind == EventKind::ToolChange(3))
    );
    for (text, part) in [
        ("T1", "T1: tool and offset in two digits each"),
        ("G71 U1. R1.", "G71"),
        ("G92 X1 Z1 F1", "single turning cycles"),
    ] {
        let error = read(text).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn words_without_effect_are_told_once_and_unknown_ones_refused_by_name() {
    noted("G187 P1\nG187 P2\nG0 X1\nM30", "G187 has no effect");
    noted(
        "G5.1 Q1\nG8 P1\nG0 X1\nM30",
        "have no effect: the planner always reads as far ahead",
    );
    noted("M41\nM10\nG0 X1\nM30", "have no effect");
    noted("DPRNT[X#1[42]]\nG0 X1\nM30", "no device is written to");
    assert_eq!(program("G187 P1\nG187 P2\nG0 X1\nM30").notes.len(), 1);
    refused("G51 X0 Y0 P2", "G51: scaling is not supported");
    refused("G43.5 H1", "G43.5: tool vectors");
    refused("G68.2 X0", "[[rotary_line]]");
    refused("G12 I5", "G12: circular pockets");
    refused("M77", "M77");
    refused("G0 X1 (open", "a comment that is not closed");
    refused("O1\nG0 X1\n@5", "'@'");
    same("G0 X1 (TOOL (1) IS IN)\nM30", "G0 X1\nM2");
}

#[test]
fn a_number_without_a_point_may_count_increments() {
    let setup = Setup {
        standard_decimal_point: true,
        ..fanuc(100.0)
    };
    let text = "G0 X10\nX10.\nG20 X100\n#1=5\nG21 X#1\nM30";
    let program = interpret("part.nc", text, &setup, AxisVector::zeros()).unwrap();
    let xs: Vec<f64> = program
        .path
        .elements
        .iter()
        .map(|element| (element.end()[0] * 1e9).round() / 1e9)
        .collect();
    assert_eq!(xs, [0.01, 10.0, 0.254, 5.0]);
}

#[test]
fn linuxcnc_words_mean_the_same_where_both_have_them() {
    same(
        "%\nO1\nG21 G90 G54 G17 G40 G49 G80\nT1 M6\nG0 G43 H1 Z50.\nG1 X10. F200.\nG3 X20. Y10. R10.\nG91 G28 Z0.\nM30\n%",
        "G21 G90 G54 G17 G40 G49 G80\nT1 M6\nG0 G43 H1 Z50\nG1 X10 F200\nG3 X20 Y10 R10\nG91 G28 Z0\nM2",
    );
    same(
        "T2 M6\nG43 H2 Z30. G0\nG43 H0\nZ30.\nM30",
        "T2 M6\nG0 G43 H2 Z30\nG49\nZ30\nM2",
    );
}

#[test]
fn a_replacement_goes_on_between_any_two_blocks() {
    let text = "%\nO1\n#100=0\nG54.1 P2\n#14021=3.\nG68 X1. Y1. R30.\nWHILE [#100 LT 3] DO1\nG91 G1 X5. ,R1. F100.\nY5.\n\
                #100=#100+1\nEND1\nG69\nG66 P2 Z-1.\nG91 G0 X1.\nY1.\nX1.\nG67\nG90 G16\nG1 X9. Y45.\nG15\nM97 P90 L2\nM98 P20003\nM30\nN90 G0 X#100\nM99\n\
                O2\nG90 G1 Z#26\n#26=#26-1\nZ[#26/2]\nM99\nO3\nG65 P4 A#1 I2. I3.\nM99\nO4\nG0 X#4 Y#7\nM99\n%";
    let setup = Arc::new(fanuc(500.0));
    let fresh = Reading::of_text("part.nc", text, &setup, AxisVector::zeros()).unwrap();
    let read = |cut: bool| {
        let (mut piece, mut reading) = (Piece::default(), fresh.clone());
        while let Progress::More = reading.read(1, &mut piece).unwrap() {
            if cut {
                let mut next = fresh.clone();
                next.resume(&reading.snapshot()).unwrap();
                reading = next;
            }
        }
        format!("{piece:?}")
    };
    let whole = read(false);
    assert!(whole.matches("Line {").count() > 12, "{whole}");
    assert_eq!(read(false), read(true));
}

#[test]
fn the_same_text_is_another_program_in_another_language() {
    let text = "G0 X1\nM30";
    let setup = fanuc(500.0);
    let linuxcnc = Setup {
        dialect: Dialect::LinuxCnc,
        ..setup.clone()
    };
    let hash = |text: &str, setup: &Setup| {
        interpret("part", text, setup, AxisVector::zeros())
            .unwrap()
            .source_hash
    };
    assert_ne!(hash(text, &setup), hash(text, &linuxcnc));
    let marked = format!("\u{1d}fanuc\u{1d}{text}");
    assert_eq!(hash(&marked, &linuxcnc), hash(text, &setup));
    let marked = format!("\u{1d}linuxcnc\u{1d}{text}");
    assert_eq!(hash(&marked, &setup), hash(text, &linuxcnc));
}

#[test]
fn what_a_second_reader_found_of_corners_rotations_and_modes() {
    // A lathe counts U and W from the corner, not from where its rounding ends.
    let lathe = Setup {
        axes: vec![slide('X', -500.0, 500.0), slide('Z', -500.0, 500.0)],
        ..fanuc(500.0)
    };
    let last = |text: &str| {
        let program = interpret("part.nc", text, &lathe, AxisVector::zeros());
        let program = program.unwrap_or_else(|error| panic!("{error}"));
        let end = program.path.elements.last().unwrap().end();
        [end[0], end[1]]
    };
    let ends =
        |from: [f64; 2], to: [f64; 2]| (0..2).all(|axis| (from[axis] - to[axis]).abs() < 1e-9);
    assert!(ends(
        last("G18 G1 X20. ,R2. F100\nW-20.\nM30"),
        [20.0, -20.0]
    ));
    let askew = last("G18 G1 X20. Z-5. ,C1. F100\nW-20.\nM30");
    assert!(ends(askew, [20.0, -25.0]), "{askew:?}");
    refused(
        "G16\nG1 X50. Y0 ,R5. F100\nY72.\nM30",
        ",R5 in polar coordinates",
    );
    // The centre of G68 is absolute, and that of a second one where the tool is.
    let twice = self::ends(
        "G91 G68 X0 Y0 R90.\nG90 G1 X10. Y0 F100\nG91 G68 X0 Y0 R90.\nG90 G1 X10. Y0\nM30",
    );
    assert_eq!(twice, [[0.0, 10.0, 0.0], [-10.0, 0.0, 0.0]]);
    let about_tool = self::ends("G68 X0 Y0 R90.\nG1 X10. Y0 F100\nG68 R180.\nG1 X0 Y11.\nM30");
    assert_eq!(about_tool[1], [0.0, 9.0, 0.0]);
    // Each pass of a subprogram gives the modes back.
    let passes = xs("M98 P100 L2\nG1 X3. F100\nM30\nO100\nM73\nG91\nG1 X5. F100\nM99");
    assert_eq!(passes, [5.0, 10.0, 3.0]);
    let restored = xs("G54.1 P3\nG10 L20 P3 X7.\nM70\nG55\nM72\nG0 X1.\nM30");
    assert_eq!(restored, [8.0]);
    refused(
        "G81 Z-3. R1. F100 X1.\nG31 Z-5.\nM30",
        "G31 while a cycle is in force",
    );
    let counted = Setup {
        standard_decimal_point: true,
        ..fanuc(500.0)
    };
    let text = "G91 G81 X10000 Z-5000 R-1000 K3 F100\nG80\nG1 X5000 ,R1000\nY4000\nM30";
    let program = interpret("part.nc", text, &counted, AxisVector::zeros());
    let program = program.unwrap_or_else(|error| panic!("{error}"));
    let end = program.path.elements.last().unwrap().end();
    assert_eq!((end[0], end[1]), (35.0, 4.0));
}
