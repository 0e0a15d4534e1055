//! Parameters, program flow, coordinate systems, tools: what LinuxCNC's interpreter does with the same text, in mm.

use crate::common::{at, mill, on_mill, refusal};
use path::geometry::{AxisVector, Feed};
use program::{EventKind, Program, Setup, Tool, interpret};

fn program(text: &str) -> Program {
    on_mill(text).unwrap_or_else(|error| panic!("{error}"))
}

/// Where each move ends, X Y Z.
fn ends(text: &str) -> Vec<[f64; 3]> {
    let elements = program(text).path.elements;
    elements
        .iter()
        .map(|element| [0, 1, 2].map(|axis| (element.end()[axis] * 1e9).round() / 1e9))
        .collect()
}

fn xs(text: &str) -> Vec<f64> {
    ends(text).iter().map(|end| end[0]).collect()
}

#[test]
fn parameters_are_set_after_the_whole_block_is_read() {
    assert_eq!(
        ends("#1=4 #2=3\n#1=5 G0 X#1 Y#2\nX#1\nM2"),
        [[4.0, 3.0, 0.0], [5.0, 3.0, 0.0]]
    );
}

#[test]
fn names_are_local_to_a_subroutine_unless_they_begin_with_a_line() {
    let text = "#<a>=1 #<_deep>=2\no<s> sub\n#<a>=7\nG0 X#<a> Y#<_deep>\n#<_deep>=3\no<s> endsub\n\
                o<s> call\nG0 X#<a> Y#<_deep>\nM2";
    assert_eq!(ends(text), [[7.0, 2.0, 0.0], [1.0, 3.0, 0.0]]);
}

#[test]
fn subroutines_have_arguments_of_their_own_and_return_a_value() {
    let text = "#1=9\no100 sub\nG0 X#1 Y#2\no100 return [#1 + #2]\nG0 X99\no100 endsub\n\
                o100 call [1] [2]\nG0 Z#<_value>\nX#1\nM2";
    assert_eq!(
        ends(text),
        [[1.0, 2.0, 0.0], [1.0, 2.0, 3.0], [9.0, 2.0, 3.0]]
    );
}

#[test]
fn loops_count_break_and_continue() {
    let while_ = "#1=0\no1 while [#1 LT 3]\n#1=[#1+1]\no2 if [#1 EQ 2]\no1 continue\no2 endif\nG0 X#1\no1 endwhile\nM2";
    assert_eq!(xs(while_), [1.0, 3.0]);
    let do_ = "#1=0\no1 do\n#1=[#1+1]\nG0 X#1\no2 if [#1 EQ 4]\no1 break\no2 endif\no1 while [#1 LT 9]\nG0 Y1\nM2";
    assert_eq!(xs(do_), [1.0, 2.0, 3.0, 4.0, 4.0]);
    assert_eq!(
        xs("G91\no1 repeat [3]\nG0 X1\no1 endrepeat\no2 repeat [0]\nX9\no2 endrepeat\nM2"),
        [1.0, 2.0, 3.0]
    );
}

#[test]
fn the_first_branch_that_holds_is_done() {
    for (value, expected) in [(1, 1.0), (2, 2.0), (3, 3.0), (4, 4.0)] {
        let text = format!(
            "#1={value}\no1 if [#1 EQ 1]\nG0 X1\no1 elseif [#1 EQ 2]\nG0 X2\no1 elseif [#1 EQ 3]\nG0 X3\no1 else\nG0 X4\no1 endif\nM2"
        );
        assert_eq!(xs(&text), [expected], "{value}");
    }
}

#[test]
fn fanuc_subroutines_are_called_by_their_number() {
    let text = "%\nO1234\nG91 G0 X1\nM98 P2000 L2\nX1\nM30\nO2000\nX10\nM99\n%";
    assert_eq!(xs(text), [1.0, 11.0, 21.0, 22.0]);
}

#[test]
fn subroutines_of_other_files_follow_a_mark() {
    let text =
        "o<pocket> call [5]\nM2\n\u{1c}pocket.ngc\no<pocket> sub\nG0 X#1\no<pocket> endsub\nM2\n";
    assert_eq!(xs(text), [5.0]);
    let text =
        "o<pocket> call [5]\nM2\n\u{1c}pocket.ngc\n\no<pocket> sub\nG0 X500\no<pocket> endsub\n";
    let found = refusal(text);
    assert!(
        found.starts_with("pocket.ngc:3:4: axis X would reach 500"),
        "{found}"
    );
    assert!(
        found.contains("in O<pocket> sub, called in line 1"),
        "{found}"
    );
}

#[test]
fn what_cannot_end_is_stopped_with_its_place() {
    for (text, expected) in [
        (
            "o1 sub\no1 call\no1 endsub\no1 call\nM2",
            "part.ngc:2:1: subroutines called 100 deep",
        ),
        (
            "o1 while [1]\n#1=[#1+1]\no1 endwhile\nM2",
            "2000000 blocks in a row without a motion",
        ),
        (
            "o1 do\n(print, x)\no1 while [1]\nM2",
            "2000000 blocks in a row without a motion",
        ),
        (
            "o1 call\nM2",
            "part.ngc:1:1: O1 call: there is no such subroutine: O1 sub in the program, or a file 1.ngc",
        ),
        ("o1 if [0]\nM2", "O1 if without O1 endif"),
        ("o1 endwhile\nM2", "O1 endwhile without O1 while"),
        ("o1 break\nM2", "O1 break outside the loop"),
        ("o1 endsub\nM2", "O1 endsub outside a call"),
        (
            "o1 sub\nG0 X1\no1 endsub\no1 loop\nM2",
            "part.ngc:4:4: 'l': one of sub endsub",
        ),
        (
            "M98 P7\nM30",
            "part.ngc:1:5: M98 P7: there is no such subroutine",
        ),
    ] {
        let found = refusal(text);
        assert!(found.contains(expected), "{text}: {found}");
    }
}

#[test]
fn mistakes_show_their_block_and_where_they_are() {
    let found = refusal("G0 X1\n\tG1 X[2 +] F100\nM2");
    assert!(
        found.contains("2 | \tG1 X[2 +] F100\n   | \t        ^"),
        "{found}"
    );
}

#[test]
fn work_offsets_are_chosen_and_set() {
    let text = "G10 L2 P2 X100 Y50\nG55 G0 X1 Y1\nG54 X1\nG10 L20 P1 X11\nX0\nG59.3 X7\nM2";
    let expected = [[101.0, 51.0], [1.0, 51.0], [-10.0, 51.0], [7.0, 51.0]];
    assert_eq!(ends(text), expected.map(|[x, y]| [x, y, 0.0]));
}

#[test]
fn a_turned_work_offset_turns_lines_and_arcs() {
    let text = "G10 L2 P1 R90\nG0 X10\nG91 Y5\nG90 G3 X10 Y15 J5 F100\nM2";
    let program = program(text);
    let found: Vec<AxisVector> = program
        .path
        .elements
        .iter()
        .map(path::geometry::Element::end)
        .collect();
    for (found, expected) in found.iter().zip([[0.0, 10.0], [-5.0, 10.0], [-15.0, 10.0]]) {
        assert!(
            (found - at(&expected)).norm() < 1e-9,
            "{found} {expected:?}"
        );
    }
}

#[test]
fn an_arc_in_an_upright_plane_turns_with_the_work_offset() {
    let program = program("G10 L2 P1 R90\nG18 G3 X10 Z10 I10 F100\nM2");
    let element = &program.path.elements[0];
    let middle = element.point(element.length_mm / 2.0);
    // X of the program is Y of the machine.
    assert!(
        (element.end() - at(&[0.0, 10.0, 10.0])).norm() < 1e-9,
        "{}",
        element.end()
    );
    assert!((middle - at(&[0.0, 10.0, 0.0])).norm() > 1.0);
    assert!(
        ((middle - at(&[0.0, 10.0, 0.0])).norm() - 10.0).abs() < 1e-9,
        "{middle}"
    );
    assert!(middle[0].abs() < 1e-9);
}

#[test]
fn g92_and_g52_shift_until_they_are_taken_back() {
    let text = "G0 X10\nG92 X0\nX5\nG92.2\nX5\nG92.3\nX5\nG92.1\nX0\nG52 X3\nX1\nM2";
    assert_eq!(xs(text), [10.0, 15.0, 5.0, 15.0, 0.0, 4.0]);
}

#[test]
fn g53_is_in_machine_coordinates_once() {
    assert_eq!(xs("G10 L2 P1 X50\nG53 G0 X1\nX1\nM2"), [1.0, 51.0]);
}

#[test]
fn g28_goes_over_the_place_that_is_named() {
    let text = "G0 X1 Y2 Z3\nG28.1\nX9 Y9 Z9\nG91 G28 Z5\nG90 G28\nM2";
    let expected = [
        [1.0, 2.0, 3.0],
        [9.0, 9.0, 9.0],
        [9.0, 9.0, 14.0],
        [9.0, 9.0, 3.0],
        [1.0, 2.0, 3.0],
    ];
    assert_eq!(ends(text), expected);
}

fn with_tools() -> Setup {
    let tool = |number, length: f64| Tool {
        number,
        offset: [0.0, 0.0, length, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        diameter: 6.0,
        ..Tool::default()
    };
    Setup {
        tools: vec![tool(1, 10.0), tool(2, 20.0)],
        ..mill(200.0)
    }
}

#[test]
fn tools_come_with_their_length() {
    let text = "T1 M6\nG43 H1\nG0 Z5\nT2 M6 G43\nZ5\nG43.2 H1 Z5\nG49 Z5\nG43.1 Z1\nZ5\nG0 X#5400 Y#5410\nM2";
    let program = interpret("part", text, &with_tools(), at(&[])).unwrap();
    let ends: Vec<f64> = program
        .path
        .elements
        .iter()
        .map(|element| element.end()[2])
        .collect();
    assert_eq!(ends, [15.0, 25.0, 35.0, 5.0, 6.0, 6.0]);
    let last = program.path.elements.last().unwrap().end();
    assert_eq!((last[0], last[1]), (2.0, 6.0));
    let error = interpret("part", "T9 M6\nM2", &with_tools(), at(&[])).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("1:1: T9: the tool table has 1 2"),
        "{error}"
    );
}

#[test]
fn spindle_coolant_tools_stops_and_outputs_are_events_at_their_place() {
    let text = "T3 M6\nS500 M3\nM8\nG1 X1 F100\nM62 P2\nM1\nM67 E1 Q2.5\nX2\nM9\nM0\nM2";
    let program = program(text);
    let seen: Vec<(usize, EventKind)> = program
        .events
        .iter()
        .map(|event| (event.before_element, event.kind))
        .collect();
    let digital = EventKind::DigitalOutput {
        index: 2,
        on: true,
        synchronised: true,
    };
    let analog = EventKind::AnalogOutput {
        index: 1,
        value: 2.5,
        synchronised: true,
    };
    assert_eq!(
        seen,
        [
            (0, EventKind::ToolPrepare(3)),
            (0, EventKind::ToolChange(3)),
            (0, EventKind::SpindleSpeedRpm(500.0)),
            (0, EventKind::SpindleClockwise),
            (0, EventKind::Flood(true)),
            (1, digital),
            (1, EventKind::OptionalStop),
            (1, analog),
            (2, EventKind::Mist(false)),
            (2, EventKind::Flood(false)),
            (2, EventKind::ProgramStop),
        ]
    );
}

#[test]
fn comments_speak_with_the_values_of_parameters() {
    let program =
        program("#1=2.5 #<deep>=3\n(MSG, turn #1)\n(debug, #1 and #<deep>.)\n(LOG, x)\nG0 X1\nM2");
    let said: Vec<(&str, bool)> = program
        .messages
        .iter()
        .map(|message| (message.text.as_str(), message.log_only))
        .collect();
    assert_eq!(
        said,
        [
            ("turn #1", false),
            ("2.500000 and 3.000000.", false),
            ("x", true)
        ]
    );
}

#[test]
fn names_tell_of_the_state_and_those_without_a_value_are_shown_as_such() {
    let text = "G21 G92 X3\nG90.1 G0 X5\n(debug, #<_line> #<_ijk_absolute_mode> #<_abs_x> #<_x>)\n(debug, a #<not_there> b # c #[-[+0]])\nM2";
    let said: Vec<String> = program(text)
        .messages
        .into_iter()
        .map(|message| message.text)
        .collect();
    assert_eq!(
        said,
        [
            "3.000000 1.000000 2.000000 5.000000",
            "a ###### b # c #[-[+0]]"
        ]
    );
}

#[test]
fn values_have_the_decimals_of_the_format_before_them_as_in_linuxcnc() {
    let text = "#1=5.5\n(print, #1 %d#1 and #1 %.2f#1 %f#1 %x#1 100% #1)\n(print, #1)\nM2";
    let said = program(text).messages.into_iter();
    let said: Vec<String> = said.map(|message| message.text).collect();
    assert_eq!(
        said,
        [
            "5.500000 6 and 6 5.50 5.5000 %x5.5000 100% 5.5000",
            "5.500000"
        ]
    );
}

#[test]
fn a_return_beside_a_rapid_takes_the_words_and_numbered_block_deletes_are_one() {
    let text = "G21 G90 G1 F100 X3 Z-4\nG0 G28 G91 Z0.\n/2 X1\n/9 N7 Y1\nM30";
    let program = program(text);
    let ends: Vec<_> = program.path.elements.iter().map(|of| of.end()).collect();
    // Z to its home from where it is, then X and Y on in G0 and G91.
    let expected = [
        [3.0, 0.0, -4.0],
        [3.0, 0.0, -4.0],
        [3.0, 0.0, 0.0],
        [4.0, 0.0, 0.0],
        [4.0, 1.0, 0.0],
    ];
    assert_eq!(
        ends[ends.len() - 3..],
        expected[2..].iter().map(|of| at(of)).collect::<Vec<_>>()
    );
    assert!(
        program
            .notes
            .iter()
            .any(|note| note.shown().contains("as on Fanuc's controls"))
    );
}

#[test]
fn what_files_of_others_have_is_read_as_linuxcnc_reads_it() {
    // A number that no parameter has, comments between arguments, and lines that end with two carriage returns.
    let text = "o<go> sub\r\r\nG0 X#1 Y#2\r\r\no<go> endsub\r\r\no<go> call [1+EXISTS[#99999]] (across) [2]\r\r\nM2\r\r\n";
    let elements = program(text).path.elements;
    assert_eq!(elements.last().unwrap().end(), at(&[1.0, 2.0]));
    // A cutter of a diameter below 0 is on the other side.
    let ends = |text: &str| {
        let elements = program(text).path.elements.into_iter();
        elements.map(|element| element.end()).collect::<Vec<_>>()
    };
    assert_eq!(
        ends("G21 F100\nG41.1 D-3\nG1 X10\nX20 Y5\nG40\nM2"),
        ends("G21 F100\nG42.1 D3\nG1 X10\nX20 Y5\nG40\nM2")
    );
}

#[test]
fn the_parameters_of_an_offset_take_force_with_it() {
    let other = "#5221=7\nG10 L2 P2 X1\nG0 X1\nG54 X2\nM2";
    assert_eq!(xs(other), [1.0, 9.0]);
    let same = "#5221=7\nG10 L2 P1 Y1\nG0 X1\nM2";
    assert_eq!(xs(same), [8.0]);
}

#[test]
fn feeds_follow_their_mode() {
    let text = "G93\nG1 X10 F2\nG94 F600\nX0\nS300 M3 G95 F0.1\nX5\nM2";
    let feeds: Vec<Feed> = program(text)
        .path
        .elements
        .iter()
        .map(|element| element.feed)
        .collect();
    assert_eq!(feeds, [10.0 * 2.0 / 60.0, 10.0, 0.5].map(Feed::PathMmS));
    assert!(refusal("G93\nG1 X10 F2\nX20\nM2").contains("3:1: a feed motion without a feed"));
}

#[test]
fn a_feed_in_the_block_that_changes_the_unit_is_read_in_the_unit_before() {
    let program = program("G20 F10 G1 X1\nM2");
    assert_eq!(program.path.elements[0].feed, Feed::PathMmS(10.0 / 60.0));
    assert!(
        program
            .notes
            .iter()
            .any(|note| note.text.contains("is read in mm"))
    );
}

#[test]
fn modes_are_saved_and_restored() {
    let text =
        "G21 G90\no1 sub\nM73\nG91 G20\nG0 X1\no1 endsub\no1 call\nX1\nM70\nG91\nX1\nM72\nX1\nM2";
    assert_eq!(xs(text), [25.4, 1.0, 2.0, 1.0]);
}

#[test]
fn m72_brings_back_whether_a_tool_length_counts() {
    let z = |text: &str| {
        let program = on_mill(text).unwrap_or_else(|error| panic!("{error}"));
        program.path.end().expect("a move")[2]
    };
    assert_eq!(z("M70\nG43.1 Z5\nM72\nG0 Z1\nM2"), 1.0);
    assert_eq!(z("G43.1 Z5\nM70\nG49\nM72\nG0 Z1\nM2"), 6.0);
    assert_eq!(z("G43.1 Z5\nM70\nG43.1 Z7\nM72\nG0 Z1\nM2"), 8.0);
}

#[test]
fn diameters_are_halved_for_lathes() {
    assert_eq!(xs("G7 G0 X10\nG91 X10\nG90 G8 X10\nM2"), [5.0, 10.0]);
}

#[test]
fn blocks_with_a_slash_are_left_out_when_that_is_switched_on() {
    let setup = Setup {
        block_delete: true,
        ..mill(200.0)
    };
    let program = interpret("part", "/G0 X1\nG0 X2\nM2", &setup, at(&[])).unwrap();
    assert_eq!(program.path.elements.len(), 1);
}

#[test]
fn a_probe_trips_at_its_end_where_that_is_assumed() {
    let setup = Setup {
        answers_assumed: true,
        ..mill(200.0)
    };
    let program = interpret(
        "part",
        "F100\nG38.2 Z-5\nG0 X#5063 Y#5070\nM2",
        &setup,
        at(&[]),
    )
    .unwrap();
    assert_eq!(program.path.elements[1].end(), at(&[-5.0, 1.0, -5.0]));
    assert!(refusal("F100\nG38.2 Z-5\nM2").contains("it has no probe"));
}

#[test]
fn the_parameters_of_the_state_are_told() {
    let text = "G20 G0 X1\n#1=#5420 #2=#<_x> #3=#<_imperial> #4=#5220 #5=#<_coord_system>\nG21 G0 X#1 Y[#2+#3] Z[#4+#5/100]\nM2";
    assert_eq!(ends(text)[1], [1.0, 2.0, 6.4]);
}

#[test]
fn inverse_functions_give_whole_degrees_where_there_are_some() {
    let text = "G0 X[FUP[ASIN[0.5]]] Y[FUP[ACOS[0.5]]] Z[FUP[ATAN[1]/[1]]]\nX[FIX[ACOS[0]]] Y[FUP[ACOS[-0.5]]]\nM2";
    assert_eq!(ends(text), [[30.0, 60.0, 45.0], [90.0, 120.0, 45.0]]);
}

#[test]
fn the_feed_is_told_as_it_was_written() {
    let said = |text: &str| program(text).messages.remove(0).text;
    assert_eq!(said("F100\nG20\n(debug, #<_feed>)\nM2"), "100.000000");
    assert_eq!(said("G20\nF5.5\n(debug, #<_feed>)\nM2"), "5.500000");
}

#[test]
fn the_overrides_of_feed_and_spindle_are_enabled_apart() {
    let told = |text: &str| {
        let text = format!("{text}\n(debug, #<_feed_override> #<_speed_override>)\nM2");
        let mut made = program(&text);
        let kinds: Vec<_> = made.events.iter().map(|event| event.kind).collect();
        (made.messages.remove(0).text, kinds)
    };
    let (said, kinds) = told("M51 P0");
    assert_eq!((said.as_str(), kinds), ("1.000000 0.000000", vec![]));
    let (said, kinds) = told("M50 P0");
    let off = EventKind::OverridesEnabled(false);
    assert_eq!((said.as_str(), kinds), ("0.000000 1.000000", vec![off]));
    let (said, _) = told("M49\nM51");
    assert_eq!(said, "0.000000 1.000000");
    let (said, _) = told("M51 P0\nM70\nM48\nM72");
    assert_eq!(said, "1.000000 0.000000");
}

#[test]
fn a_tool_change_stops_the_spindle() {
    let made = program("S100 M3\nT1 M6\nT1 M6\n(debug, #<_spindle_on>)\nM2");
    let kinds: Vec<_> = made.events.iter().map(|event| event.kind).collect();
    let change = [EventKind::ToolPrepare(1), EventKind::ToolChange(1)];
    let mut expected = vec![
        EventKind::SpindleSpeedRpm(100.0),
        EventKind::SpindleClockwise,
        change[0],
        EventKind::SpindleStop,
        change[1],
    ];
    expected.extend(change);
    assert_eq!(kinds, expected);
    assert_eq!(made.messages[0].text, "0.000000");
    let bored = refusal("F100 S100 M3\nT1 M6\nG86 X1 Z-1 R1 P0\nM2");
    assert!(bored.contains("G86 with"), "{bored}");
}

#[test]
fn a_place_is_taken_for_one_axis_of_a_turned_offset() {
    let text = "G0 X3 Y4\nG10 L2 P0 R30\nG10 L20 P0 Y2\n(debug, #5421)\nG0 X0\nM2";
    assert_eq!(program(text).messages[0].text, "2.000000");
    assert_eq!(
        ends(text)[1],
        [-0.982_050_808, 1.700_961_894, 0.0],
        "LinuxCNC goes there"
    );
}
