//! G43.4: the tip of the tool keeps to the programmed path while rotary axes turn the work or the tool. Judged by what LinuxCNC has for two
//! machines (`trtfuncs.c`, table A under table C; `5axiskins.c`, head C with B), written out here by their formulas.

use std::sync::Arc;

use path::geometry::{AxisVector, Element, Feed, Shape};
use path::tool_centre::{RotaryLine, ToolCentre};
use program::{Program, Setup, interpret, parse_tools};
use proptest::prelude::*;

use crate::common::{at, slide};

/// Axes X Y Z and two rotary ones.
const TRUNNION: &str = "XYZAC";
const HEAD: &str = "XYZBC";
/// A point of both lines of the table: of A at 12 mm in Y and −30 in Z from that of C.
const TABLE_MM: [f64; 3] = [10.0, -20.0, -150.0];
const FROM_C_TO_A_MM: [f64; 2] = [12.0, -30.0];
/// From the nose of the spindle up to where the lines of the head meet.
const PIVOT_MM: f64 = 180.0;
const TOOL_MM: f64 = 70.0;

fn setup(letters: &str) -> Setup {
    let mut axes: Vec<_> = letters.chars().map(|of| slide(of, -1e4, 1e4)).collect();
    for axis in &mut axes {
        axis.rotary = "ABC".contains(axis.letter);
    }
    let [x, y, z] = TABLE_MM;
    let line = |axis, point, direction| RotaryLine::new(axis, point, direction).unwrap();
    let tool_centre = if letters == TRUNNION {
        let [dy, dz] = FROM_C_TO_A_MM;
        let a = line(3, [x - 44.0, y + dy, z + dz], [2.0, 0.0, 0.0]);
        let c = line(4, [x, y, 77.0], [0.0, 0.0, 1.0]);
        ToolCentre::new([0, 1, 2], vec![a, c], vec![])
    } else {
        let c = line(4, [0.0, 0.0, -5.0], [0.0, 0.0, 1.0]);
        let b = line(3, [0.0, 3.0, PIVOT_MM], [0.0, -0.5, 0.0]);
        ToolCentre::new([0, 1, 2], vec![], vec![c, b])
    };
    Setup {
        axes,
        tool_centre: Some(Arc::new(tool_centre)),
        tools: parse_tools("tools.tbl", &format!("T1 P1 Z{TOOL_MM} D6\n")).unwrap(),
        ..Setup::default()
    }
}

/// Where LinuxCNC has the tip, the length of the tool added, for a place of the axes.
fn tip(letters: &str, axes: &AxisVector) -> [f64; 3] {
    let (x, y, z) = (axes[0], axes[1], axes[2]);
    let (first, c) = (axes[3].to_radians(), axes[4].to_radians());
    let (sin_c, cos_c) = c.sin_cos();
    let (sin, cos) = first.sin_cos();
    if letters == TRUNNION {
        let [rx, ry, rz] = TABLE_MM;
        let [dy, dz] = [FROM_C_TO_A_MM[0], FROM_C_TO_A_MM[1] + TOOL_MM];
        let (x, y, z) = (x - rx, y - dy - ry, z - dz - rz);
        return [
            cos_c * x + sin_c * cos * y + sin_c * sin * z + sin_c * dy + rx,
            -sin_c * x + cos_c * cos * y + cos_c * sin * z + cos_c * dy + ry,
            -sin * y + cos * z + dz + rz,
        ];
    }
    let pivot = PIVOT_MM + TOOL_MM;
    [
        x + pivot * sin * cos_c,
        y + pivot * sin * sin_c,
        z - pivot * cos + pivot,
    ]
}

fn made(letters: &str, text: &str) -> Program {
    let text = format!("G21 G90 T1 M6\n{text}\nM2\n");
    interpret("part.ngc", &text, &setup(letters), AxisVector::zeros()).unwrap()
}

fn refused(text: &str) -> String {
    let text = format!("G21 G90 T1 M6 F600\n{text}\nM2\n");
    match interpret("part.ngc", &text, &setup(TRUNNION), AxisVector::zeros()) {
        Ok(_) => panic!("was not refused: {text}"),
        Err(error) => error.to_string(),
    }
}

/// Largest distance of the tip from the straight line of a block, and from where its rotary axes say that it should be on it.
fn off_mm(letters: &str, elements: &[Element], from: &AxisVector, to: &AxisVector) -> f64 {
    let turning = if from[3] == to[3] { 4 } else { 3 };
    let mut most_mm = 0.0f64;
    for element in elements {
        for step in 0..=8 {
            let place = element.shape.at_share(f64::from(step) / 8.0);
            let share = (place[turning] - from[turning]) / (to[turning] - from[turning]);
            let wanted = from + (to - from) * share;
            let here = tip(letters, &place);
            let apart: f64 = (0..3).map(|axis| (here[axis] - wanted[axis]).powi(2)).sum();
            most_mm = most_mm.max(apart.sqrt());
        }
    }
    most_mm
}

proptest! {
    #[test]
    fn the_tip_is_on_the_line_of_its_block_all_the_way_and_as_fast_as_its_feed(
        places in prop::collection::vec((prop::array::uniform3(-200.0..200.0f64), prop::array::uniform2(-110.0..110.0f64)), 2..6),
        trunnion in any::<bool>(),
        feed in 100.0..8000.0f64,
    ) {
        let letters = if trunnion { TRUNNION } else { HEAD };
        let turning = &letters[3..4];
        let mut text = format!("G61 F{feed}\nG43.4 H1\n");
        for ([x, y, z], [first, c]) in &places {
            text += &format!("G1 X{x} Y{y} Z{z} {turning}{first} C{c}\n");
        }
        let program = made(letters, &text);
        // What is told of the tip has the length of the tool in it.
        let mut from = at(&[0.0; 5]);
        let mut elements = program.path.elements.as_slice();
        for (line, ([x, y, z], [first, c])) in (4..).zip(&places) {
            let to = at(&[*x, *y, *z + TOOL_MM, *first, *c]);
            let count = elements.iter().filter(|element| element.line == line).count();
            let (block, behind) = elements.split_at(count);
            prop_assert!(off_mm(letters, block, &from, &to) < 0.000_26, "{text}");
            let seconds: f64 = block.iter().map(|element| match element.feed {
                Feed::PathMmS(speed) => element.length_mm / speed,
                Feed::Rapid => f64::NAN,
            }).sum();
            let way = (to - from).fixed_rows::<3>(0).norm();
            prop_assert!((seconds * feed / 60.0 - way).abs() < 1e-6 * way, "{seconds} s for {way} mm");
            (from, elements) = (to, behind);
        }
        prop_assert!(elements.is_empty());
        let mut pairs = program.path.elements.windows(2);
        prop_assert!(pairs.all(|pair| pair[0].end() == pair[1].start()));
    }
}

#[test]
fn a_turn_about_the_tip_alone_is_fed_in_degrees_and_leaves_the_tip_where_it_is() {
    let program = made(
        HEAD,
        "G61 F600\nG43.4 H1\nG1 X50 Y20 Z10\nG1 B60\nG4 P0.5\nG1 X0 Y0 Z0 B0\nG49",
    );
    let turning: Vec<_> = program
        .path
        .elements
        .iter()
        .filter(|of| of.line == 5)
        .collect();
    let seconds: f64 = turning
        .iter()
        .map(|element| match element.feed {
            Feed::PathMmS(speed) => element.length_mm / speed,
            Feed::Rapid => f64::NAN,
        })
        .sum();
    assert!(
        (seconds - 6.0).abs() < 1e-9,
        "60° at 600 °/min: {seconds} s"
    );
    for element in &turning {
        let here = tip(HEAD, &element.shape.at_share(0.4));
        for (is, wanted) in here.iter().zip([50.0, 20.0, 10.0 + TOOL_MM]) {
            assert!((is - wanted).abs() < 0.000_26, "{here:?}");
        }
    }
    let elements = &program.path.elements;
    let dwell = elements.iter().find(|of| of.is_dwell()).unwrap();
    assert_eq!(Some(dwell.start()), turning.last().map(|last| last.end()));
    // Back at 0 all is as if nothing had turned.
    let end = elements.last().unwrap().end();
    assert!((end - at(&[0.0, 0.0, TOOL_MM])).norm() < 1e-9, "{end:?}");
}

/// While nothing turns, an arc stays one, in whichever way the table stands.
#[test]
fn an_arc_on_a_table_that_stands_askew_is_one_arc_whose_points_lie_on_the_work() {
    let program = made(
        TRUNNION,
        "G61 F600\nG0 A35 C-70\nG43.4 H1\nG0 X40 Y5 Z3\nG18 G2 X60 Z3 I10 K0\nG17 G3 X60 Y25 J10\nG49",
    );
    for (line, centre, radius) in [
        (6, [50.0, 5.0, 3.0 + TOOL_MM], 10.0),
        (7, [60.0, 15.0, 3.0 + TOOL_MM], 10.0),
    ] {
        let block: Vec<_> = program
            .path
            .elements
            .iter()
            .filter(|of| of.line == line)
            .collect();
        assert!(block.iter().all(|of| matches!(of.shape, Shape::Arc { .. })));
        assert!(block.len() <= 2, "{}", block.len());
        for element in block {
            for step in 0..=10 {
                let here = tip(TRUNNION, &element.shape.at_share(f64::from(step) / 10.0));
                let from_centre: f64 = (0..3).map(|axis| (here[axis] - centre[axis]).powi(2)).sum();
                let from_centre = from_centre.sqrt();
                assert!(
                    (from_centre - radius).abs() < 1e-9,
                    "line {line}: {from_centre}"
                );
            }
        }
    }
}

#[test]
fn with_a_tolerance_lines_rounding_and_rotary_axes_share_it() {
    let program = made(
        TRUNNION,
        "G64 P0.04 Q0.02 F600\nG43.4 H1\nG1 X100 A30 C90\nG1 X0 Y80 A0 C0",
    );
    let pieces = &program.path.elements;
    let exact = made(
        TRUNNION,
        "G61 F600\nG43.4 H1\nG1 X100 A30 C90\nG1 X0 Y80 A0 C0",
    );
    assert!(3 * pieces.len() < exact.path.elements.len() * 2);
    for piece in pieces {
        let tolerance = piece.tolerance;
        assert_eq!((tolerance.corner_mm, tolerance.chord_mm), (0.02, 0.01));
        // The tip is 100 to 400 mm away from both lines.
        assert!(
            (0.000_1..0.002).contains(&tolerance.rotary_deg),
            "{tolerance:?}"
        );
    }
}

#[test]
fn what_needs_places_of_the_axes_or_a_tool_along_z_is_refused_while_the_tip_is_controlled() {
    for (words, named) in [
        ("G28", "G28"),
        ("G0 G53 X0", "G53"),
        ("G41 D6", "G41"),
        ("T1 M6", "M6"),
        ("G81 X1 Y1 Z-5 R2", "cycle"),
        ("G38.2 Z-5", "probing"),
        ("G33 Z-5 K1", "thread"),
        ("G10 L10 P1 Z0", "G10"),
        ("G28.1", "G28.1"),
        ("G96 S100", "G96"),
    ] {
        let mut with_probe = setup(TRUNNION);
        with_probe.probe = true;
        let text = format!("G21 G90 T1 M6 F600\nG43.4 H1\n{words}\nM2\n");
        let error = interpret("part.ngc", &text, &with_probe, AxisVector::zeros());
        let error = error.expect_err(words).to_string();
        assert!(
            error.contains(named) && error.contains("G49"),
            "{words}: {error}"
        );
        assert!(error.contains(":3:"), "{words}: {error}");
    }
    for words in [
        "G10 L2 P1 X5",
        "G92 X3",
        "G52 X1",
        "G4 P1",
        "G2 X5 Y5 R5",
        "G5.1 X5 Y5 I3 J4",
        "M61 Q1",
    ] {
        made(TRUNNION, &format!("F600\nG43.4 H1\n{words}\nG1 A5 X7"));
    }
    // A cycle that is in force already.
    let error = refused("G81 X1 Y1 Z-5 R2\nG43.4 H1\nX5");
    assert!(error.contains("cycle"), "{error}");
    // A machine that does not say how it turns.
    let plain = Setup {
        tool_centre: None,
        ..setup(TRUNNION)
    };
    let error = interpret(
        "p.ngc",
        "T1 M6\nG43.4 H1\nM2\n",
        &plain,
        AxisVector::zeros(),
    );
    let error = error.expect_err("no lines").to_string();
    assert!(error.contains("[[rotary_line]]"), "{error}");
}

#[test]
fn an_axis_that_the_turn_of_the_table_takes_out_of_its_travel_is_named_with_its_line() {
    let mut narrow = setup(TRUNNION);
    narrow.axes[1].travel_min = -150.0;
    let text = "T1 M6 F600\nG43.4 H1\nG1 X100 Y0 Z0\nG1 A90 C90\nM2\n";
    let error = interpret("part.ngc", text, &narrow, AxisVector::zeros());
    let error = error.expect_err("too far").to_string();
    assert!(
        error.contains(":4:") && error.contains("axis Y would reach"),
        "{error}"
    );
}

#[test]
fn g49_g43_and_another_length_end_the_control_where_the_axes_are() {
    for ending in ["G49", "G43 H1", "G43.1 Z10"] {
        let text = format!("G61 F600\nG43.4 H1\nG1 X30 Y10 A40 C10\n{ending}\nG91 G1 X1\n");
        let program = made(TRUNNION, &text);
        let elements = &program.path.elements;
        let last = elements.last().unwrap();
        let before = elements.get(elements.len() - 2).unwrap();
        let step = last.end() - before.end();
        assert!((step - at(&[1.0])).norm() < 1e-9, "{ending}: {step:?}");
    }
}

/// Row by row, by hand: I about Z, J about the new X, K about the new Z.
fn euler(i: f64, j: f64, k: f64) -> [[f64; 3]; 3] {
    let ((si, ci), (sj, cj), (sk, ck)) = (
        i.to_radians().sin_cos(),
        j.to_radians().sin_cos(),
        k.to_radians().sin_cos(),
    );
    [
        [ci * ck - si * cj * sk, -ci * sk - si * cj * ck, si * sj],
        [si * ck + ci * cj * sk, -si * sk + ci * cj * ck, -ci * sj],
        [sj * sk, sj * ck, cj],
    ]
}

/// Direction of the tool on the work, from the differences of two tips.
fn tool_direction(letters: &str, axes: &AxisVector) -> [f64; 3] {
    let (sin, cos) = axes[3].to_radians().sin_cos();
    let (sin_c, cos_c) = axes[4].to_radians().sin_cos();
    match letters {
        TRUNNION => [sin_c * sin, cos_c * sin, cos],
        _ => [-sin * cos_c, -sin * sin_c, cos],
    }
}

proptest! {
    #[test]
    fn in_a_tilted_plane_the_tool_stands_upright_on_it_and_drills_where_the_plane_says(
        origin in prop::array::uniform3(-40.0..40.0f64),
        angles in (-170.0..170.0f64, 0.0..80.0f64, -170.0..170.0f64),
        holes in prop::collection::vec(prop::array::uniform2(-30.0..30.0f64), 1..4),
        trunnion in any::<bool>(),
        keeps_tip in any::<bool>(),
    ) {
        let letters = if trunnion { TRUNNION } else { HEAD };
        let ([x, y, z], (i, j, k)) = (origin, angles);
        let plane = format!("G68.2 X{x} Y{y} Z{z} I{i} J{j} K{k}\n");
        let begin = if keeps_tip {
            format!("G43.4 H1\n{plane}G53.1\n")
        } else {
            format!("{plane}G53.1\nG43 H1\n")
        };
        let mut text = format!("G61 F600\n{begin}G0 Z20\n");
        for [x, y] in &holes {
            text += &format!("G98 G81 X{x} Y{y} Z-8 R3\n");
        }
        let program = made(letters, &format!("{text}G80\nG69\nG49\n"));
        let rows = euler(i, j, k);
        let normal = rows.map(|row| row[2]);
        let mut found = 0;
        let drilled = program.path.elements.iter().filter(|of| matches!(of.feed, Feed::PathMmS(_)));
        for (element, [u, v]) in drilled.zip(&holes) {
            let bottom = element.end();
            for (is, wanted) in tool_direction(letters, &bottom).iter().zip(normal) {
                prop_assert!((is - wanted).abs() < 1e-9, "{is} {wanted}");
            }
            let here = tip(letters, &bottom);
            for axis in 0..3 {
                let row = rows[axis];
                let length = if axis == 2 { TOOL_MM } else { 0.0 };
                let wanted = origin[axis] + length + row[0] * u + row[1] * v - row[2] * 8.0;
                prop_assert!((here[axis] - wanted).abs() < 1e-8, "{here:?} {wanted} {axis}");
            }
            found += 1;
        }
        prop_assert_eq!(found, holes.len());
        let mut pairs = program.path.elements.windows(2);
        prop_assert!(pairs.all(|pair| pair[0].end() == pair[1].start()));
    }
}

#[test]
fn a_tilted_plane_is_refused_where_it_cannot_be_what_it_says() {
    for (words, named) in [
        ("G53.1", "G68.2 before it"),
        ("G68.2 I30 J20\nG1 X5", "G43"),
        ("G68.2 I30 J20\nG43 H1\nG55", "G69"),
        ("G68.2 I30 J20\nG43 H1\nG92 X0", "G69"),
        ("G68.2 I30 J20\nG43.1 Z5", "G69"),
        ("G68.2 I30 J20\nG43 H1\nG81 X1 Y1 Z-3 R2", "G53.1"),
        ("G10 L2 P1 R30\nG68.2 I30 J20", "turned"),
        ("G68.2 I30 P1", "P"),
        ("G68.2 I30 J20\nG2 I5", "G43"),
    ] {
        let error = refused(words);
        assert!(error.contains(named), "{words}: {error}");
    }
    let mut narrow = setup(TRUNNION);
    (narrow.axes[3].travel_min, narrow.axes[3].travel_max) = (-10.0, 10.0);
    let text = "T1 M6\nG68.2 I30 J40\nG53.1\nM2\n";
    let error = interpret("p.ngc", text, &narrow, AxisVector::zeros());
    let error = error.expect_err("too far").to_string();
    assert!(error.contains("leave their travel"), "{error}");
}

/// M70 and M72, and M73 in a subroutine, give G43.4 back as it was.
#[test]
fn modes_that_are_restored_control_the_tip_or_not_as_they_did() {
    let begin = "G61 F600\nG43.4 H1\nG1 X50 Y20 Z10 A20\n";
    let plain = made(TRUNNION, &format!("{begin}G1 X60 A50"));
    for between in [
        "M70\nG49\nG91 G1 Z1\nG1 Z-1\nG90\nM72\n",
        "M70\nG43 H1\nM72\n",
    ] {
        let text = format!("{begin}{between}G1 X60 A50");
        let program = made(TRUNNION, &text);
        let ends = [&plain, &program].map(|of| of.path.elements.last().unwrap().end());
        assert!((ends[0] - ends[1]).norm() < 1e-9, "{between}");
    }
    // A subroutine that begins the control, and whose caller has none.
    let text = "G61 F600\nO1 sub\nM73\nG43.4 H1\nG1 X50 Y20 Z10 A20\nO1 endsub\nG43 H1\nO1 call\nG91 G1 X1";
    let program = made(TRUNNION, text);
    let [.., before, last] = program.path.elements.as_slice() else {
        panic!("two elements");
    };
    assert!((last.end() - before.end() - at(&[1.0])).norm() < 1e-9);
}

/// Q0 says that chords are as exact as corners, not that rotary axes may go anywhere.
#[test]
fn a_tolerance_of_chords_of_0_is_that_of_corners_for_rotary_axes_too() {
    let of = |mode: &str| {
        let text = format!("{mode} F600\nG43.4 H1\nG1 X100 A30 C90");
        let program = made(TRUNNION, &text);
        program.path.elements[0].tolerance.rotary_deg
    };
    let (q0, same) = (of("G64 P0.05 Q0"), of("G64 P0.05"));
    assert!(q0 > 0.0 && (q0 - same).abs() < 1e-12, "{q0} {same}");
}
