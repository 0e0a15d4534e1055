//! A machine whose swing arm B is in for Y: what comes out on the part, and what is refused before anything moves.

use std::fs;
use std::path::{Path, PathBuf};

use bus::sample::{Feedback, Mode, ProgramState};
use serde_json::Value;

use crate::support::{Bench, LiveCell, circle_program, number, quadrant, root, run, text};
use crate::up::{ask, down, is, obeyed};

const ARM_LENGTH_MM: f64 = 150.0;

fn shipped(program: &str) -> PathBuf {
    root().join("machines/xzb-pivot/programs").join(program)
}

/// Reversals on arcs in steady motion: (axis, largest protrusion or undercut in µm).
fn steady_reversals(report: &Value) -> Vec<(String, f64)> {
    let reversals = report["reversals"].as_array().expect("reversals");
    let steady = reversals.iter().filter(|r| r["steady"] == true);
    let worst = steady.map(|r| {
        let of = |key: &str| r[key].as_f64().expect("a protrusion");
        let axis = r["axis"].as_str().expect("an axis");
        (
            axis.to_string(),
            of("protrusion_um").max(-of("undercut_um")),
        )
    });
    worst.collect()
}

fn worst_um(report: &Value) -> f64 {
    let all = steady_reversals(report);
    assert!(all.len() >= 12, "{all:?}");
    all.iter().fold(0.0, |most, (_, um)| f64::max(most, *um))
}

/// The arm's joint carries 2.6 µm of the tool per thousandth of a degree; on the part that is as good as a slide.
#[test]
fn a_circle_on_the_part_is_as_round_as_that_of_two_slides() {
    let (xy, pivot) = (Bench::without_model("xy", &[]), Bench::of("xzb-pivot", &[]));
    for (radius, feed, centre) in [(20.0, 3000.0, (0.0, 0.0)), (33.0, 4200.0, (12.0, -55.0))] {
        let measure = |bench: &Bench| {
            let program = circle_program(radius, feed, centre, 40.0);
            let file = bench.file("circle.ngc", &program);
            run(bench.path(), file).good_report()
        };
        let (of_slides, of_arm) = (measure(&xy), measure(&pivot));
        let both = |what: fn(&Value) -> f64| (what(&of_arm), what(&of_slides));
        let (arm_um, slides_um) = both(worst_um);
        assert!(
            arm_um <= 1.5 * slides_um,
            "reversals R{radius} F{feed}: {arm_um} µm with the arm, {slides_um} µm with slides"
        );
        let rms = |report: &Value| number(report, "/contour_error_um/rms");
        let (arm_um, slides_um) = both(rms);
        assert!(
            arm_um <= 1.5 * slides_um,
            "contour R{radius} F{feed}: {arm_um} µm with the arm, {slides_um} µm with slides"
        );
    }
}

#[test]
fn arcs_are_measured_on_the_part_and_the_arm_is_named_where_it_reverses() {
    for (program, arcs) in [
        ("circle-r20-f3000.ngc", 2),
        ("circle-r20-y60-f3000.ngc", 2),
        ("helix.ngc", 1),
    ] {
        let report = run(root().join("machines/xzb-pivot"), shipped(program)).good_report();
        assert_eq!(text(&report, "/outcome/kind"), "completed", "{report}");
        let found = report["arcs"].as_array().expect("arcs");
        assert_eq!(found.len(), arcs, "{program}");
        for index in 0..arcs {
            let at = |key: &str| number(&report, &format!("/arcs/{index}/{key}"));
            assert_eq!(text(&report, &format!("/arcs/{index}/plane")), "XY");
            assert!((at("radius_mm") - 20.0).abs() < 1e-6);
            assert!(at("measured_deg") > 600.0);
            assert!(at("circular_deviation_um") < 15.0, "{program}");
        }
        let reversals = steady_reversals(&report);
        for axis in ["X", "B"] {
            let of_axis = reversals.iter().filter(|(of, _)| of == axis).count();
            assert!(of_axis >= 4, "{program}: {reversals:?}");
        }
    }
}

#[test]
fn two_runs_with_an_arm_are_the_same_to_the_bit() {
    let once = || {
        let report = run(root().join("machines/xzb-pivot"), shipped("helix.ngc")).good_report();
        (text(&report, "/digest"), text(&report, "/motion_digest"))
    };
    assert_eq!(once(), once());
}

/// Straight lines on the part by this test's own formula, for either carriage: rounding the axes to 1 nm and 1 µdeg moves
/// the tool by less than one increment of each.
#[test]
fn the_rows_of_the_axes_put_the_tool_on_the_programmed_line() {
    for (carries, sign) in [("arm", 1.0), ("work", -1.0)] {
        let edit = format!("carries = \"{carries}\" ");
        let bench = Bench::of("xzb-pivot", &[("carries = \"arm\" ", &edit)]);
        let csv = bench.path().join("rows.csv");
        let output = quadrant()
            .arg("plan")
            .arg(bench.path())
            .arg(shipped("line.ngc"))
            .arg("--csv")
            .arg(&csv)
            .output()
            .expect("plan");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{stderr}");
        let text = fs::read_to_string(&csv).expect("the rows");
        assert!(
            text.starts_with("scan,line,element,distance_mm,path_velocity_mm_s,x_mm,b_deg,z_mm")
        );
        // Line 7 goes along Y at X0, line 9 from (0, 100) to (-60, -100).
        let mut rows = [0; 2];
        for line in text.lines().skip(1) {
            let columns: Vec<f64> = line
                .split(',')
                .map(|c| c.parse().expect("a number"))
                .collect();
            let (slide_mm, angle) = (columns[5], columns[6].to_radians());
            let x = slide_mm - sign * ARM_LENGTH_MM * (1.0 - angle.cos());
            let y = ARM_LENGTH_MM * angle.sin();
            let off_mm = match columns[1] as u32 {
                7 => {
                    rows[0] += 1;
                    x
                }
                9 => {
                    rows[1] += 1;
                    let (dx, dy) = (-60.0f64, -200.0f64);
                    (x * dy - (y - 100.0) * dx) / dx.hypot(dy)
                }
                _ => continue,
            };
            // Half of 1 nm and of 1 µdeg at 150 mm.
            assert!(
                off_mm.abs() < 0.51 * 3.62e-6,
                "{carries}: {off_mm} mm off in {line}"
            );
        }
        assert!(rows[0] > 3000 && rows[1] > 3000, "{rows:?}");
    }
}

#[test]
fn a_slide_that_carries_the_work_runs_the_same_part() {
    let bench = Bench::of(
        "xzb-pivot",
        &[("carries = \"arm\" ", "carries = \"work\" ")],
    );
    let report = run(bench.path(), shipped("circle-r20-y60-f3000.ngc")).good_report();
    assert!(worst_um(&report) < 10.0);
}

fn refused(bench: &Bench, program: &Path, expected: &[&str]) {
    for command in ["check", "plan", "run"] {
        let output = quadrant()
            .arg(command)
            .arg(bench.path())
            .arg(program)
            .output()
            .expect("running quadrant");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{command}: {stderr}");
        for word in expected {
            assert!(stderr.contains(word), "{command}: no {word:?} in {stderr}");
        }
    }
}

#[test]
fn what_arm_or_slide_cannot_reach_is_refused_before_motion_with_its_line() {
    let bench = Bench::of("xzb-pivot", &[]);
    let head = "G21 G17 G90 G94\nG0 X0 Y100\n";
    for (block, expected) in [
        // 150·sin 60° = 129.9 mm.
        (
            "G1 Y130 F1000",
            vec![":3:4: axis Y would reach 130.0000 mm", "129.9038"],
        ),
        ("G3 X0 Y100 J20 F1000", vec![":3:", "axis Y", "140.0000"]),
        ("G1 Y200 F1000", vec![":3:4:", "axis Y"]),
        // The slide under X would be at 200 + 38.2 mm.
        ("G1 X200 F1000", vec![":3:", "the slide under X", "220"]),
        ("G1 B10 F1000", vec![":3:4", "B"]),
    ] {
        let program = bench.file("far.ngc", &format!("{head}{block}\nM2\n"));
        refused(&bench, &program, &expected);
    }
}

#[test]
fn an_arm_that_stands_outside_its_range_is_refused() {
    let bench = Bench::of("xzb-pivot", &[]);
    let file = bench.path().join("plant.toml");
    let plant = fs::read_to_string(&file).expect("plant.toml");
    let turned = plant.replace("start_position_deg = 0.0", "start_position_deg = 61.0");
    assert_ne!(plant, turned);
    fs::write(&file, turned).expect("plant.toml");
    refused(
        &bench,
        &shipped("line.ngc"),
        &["plant.toml", "the arm is at 61.0000°", "-60 to 60°"],
    );
}

#[test]
fn settings_of_an_arm_that_make_no_sense_are_refused_with_line_and_rule() {
    let table = "[kinematics]";
    for (what, by, expected) in [
        ("arm_axis = \"B\"", "arm_axis = \"C\"", "kind = \"rotary\""),
        ("arm_axis = \"B\"", "arm_axis = \"Z\"", "kind = \"rotary\""),
        (
            "slide_axis = \"X\"",
            "slide_axis = \"B\"",
            "kind = \"linear\"",
        ),
        ("arm_length_mm = 150.0", "arm_length_mm = 0.0", "at least 1"),
        ("arm_max_deg = 60.0", "arm_max_deg = 90.0", "at most 62"),
        ("arm_max_deg = 60.0", "arm_max_deg = -60.0", "above -60"),
        ("name = \"Z\"", "name = \"Y\"", "no axis Y"),
        ("\nZ = -100.0", "\nB = 10.0", "name Y"),
        ("\nZ = -100.0", "\nY = 151.0", "at most 150"),
        (
            table,
            "[interpolation]\nstraight_lines = \"master-axis\"\n\n[kinematics]",
            "must be \"rounded\" with [kinematics]",
        ),
        (
            "carries = \"arm\" ",
            "carries = \"tool\" ",
            "expected `arm` or `work`",
        ),
        ("\"pivot-y\"", "\"pivot-x\"", "pivot-x"),
    ] {
        let bench = Bench::of("xzb-pivot", &[(what, by)]);
        refused(&bench, &shipped("line.ngc"), &["machine.toml:", expected]);
    }
}

/// An arm is told in degrees: its errors stand under other names than those of a slide.
#[test]
fn the_report_of_an_arm_has_its_errors_in_thousandths_of_a_degree() {
    let bench = Bench::of("xzb-pivot", &[]);
    let run = run(bench.path(), shipped("circle-r20-y60-f3000.ngc"));
    let report = run.good_report();
    let [x, b] = [&report["axes"][0], &report["axes"][1]];
    assert_eq!((&x["axis"], &b["axis"]), (&"X".into(), &"B".into()));
    assert!(x["following_error_um"]["peak"].is_f64() && x.get("following_error_mdeg").is_none());
    assert!(b["following_error_mdeg"]["peak"].is_f64() && b.get("following_error_um").is_none());
    let block = &report["blocks"][0];
    assert!(block["following_error_um_peak"]["X"].is_f64(), "{block}");
    assert!(block["following_error_mdeg_peak"]["B"].is_f64(), "{block}");
    assert!(
        block["following_error_um_peak"].get("B").is_none(),
        "{block}"
    );
    let text = fs::read_to_string(run.out.join("report.txt")).expect("report.txt");
    assert!(
        text.contains("Following error of rotary axes, peak"),
        "{text}"
    );
    let picture = fs::read_to_string(run.out.join("tracking.svg")).expect("tracking.svg");
    assert!(picture.contains("mdeg, rms"), "the panel of B");
    // The tool is in X, Y and Z.
    let path = fs::read_to_string(run.out.join("path.svg")).expect("path.svg");
    assert!(path.contains("Y mm"), "the path of the tool");
}

/// Places of the tool, each as often as the cell was looked at, until it is as it is asked for.
fn tool_until(cell: &mut LiveCell, reached: impl Fn(&Feedback) -> bool) -> Vec<[f64; 3]> {
    let machine = machine::Machine::load(&root().join("machines/xzb-pivot")).expect("a machine");
    let mut places = Vec::new();
    loop {
        let now = cell.wait_for(|_| true);
        let tool = program::kinematics_of(&machine).tool(&program::commanded(&machine, &now));
        places.push([tool[0], tool[1], tool[2]]);
        if reached(&now) {
            return places;
        }
    }
}

#[test]
fn a_jog_along_y_that_an_arm_makes_moves_the_tool_along_y_and_nothing_else() {
    let bench = Bench::patient("xzb-pivot", &[]);
    let mut cell = LiveCell::up(bench.path(), "realtime");
    cell.wait_for(|_| true);
    crate::up::refused(&cell, &["jog", "Y", "1"], "jog refused: the drives are off");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["mdi", "G91 G20 G55", "G1 X0.5 F40"]);
    let ready = |f: &Feedback| is(f, Mode::Ready, ProgramState::None);
    let codes = |cell: &LiveCell| {
        let status = crate::readout::status(cell);
        ["active_codes", "feed_word", "work_offset"].map(|key| status["readout"][key].clone())
    };
    let (before, state) = (tool_until(&mut cell, ready), codes(&cell));
    let [x_mm, y_mm, z_mm] = before[before.len() - 1];
    let run = cell.wait_for(ready).run;
    let jog = std::thread::scope(|scope| {
        let name = cell.cell.clone();
        let jog = scope.spawn(move || {
            let words = ["jog", "Y", "20", "--speed", "900", "--cell", &name];
            quadrant().args(words).output().expect("an answer")
        });
        let done = |f: &Feedback| f.run > run && is(f, Mode::Ready, ProgramState::None);
        let way = tool_until(&mut cell, done);
        for place in &way {
            assert!((place[0] - x_mm).abs() < 2e-3, "{place:?}");
            assert!((place[2] - z_mm).abs() < 1e-5, "{place:?}");
        }
        let end = way[way.len() - 1];
        assert!((end[1] - y_mm - 20.0).abs() < 1e-4, "{end:?}");
        jog.join().expect("its end")
    });
    assert!(
        jog.status.success(),
        "{}",
        String::from_utf8_lossy(&jog.stderr)
    );
    assert_eq!(codes(&cell), state, "modes are as before");
    // In work coordinates, and beside another axis; of the machine; and the arm alone, as its joint.
    obeyed(&cell, &["mdi", "G54 G21"]);
    obeyed(&cell, &["jog", "Y", "-5", "Z", "3", "--to"]);
    let at = tool_until(&mut cell, ready);
    let at = at[at.len() - 1];
    assert!(
        (at[1] + 5.0).abs() < 1e-4 && (at[2] + 97.0).abs() < 1e-4,
        "{at:?}"
    );
    obeyed(&cell, &["jog", "X", "2", "--to"]);
    let at = tool_until(&mut cell, ready);
    assert!((at[at.len() - 1][0] - 2.0).abs() < 1e-4, "{at:?}");
    obeyed(&cell, &["jog", "Y", "8", "--to-machine"]);
    let at = tool_until(&mut cell, ready);
    assert!((at[at.len() - 1][1] - 8.0).abs() < 1e-4, "{at:?}");
    obeyed(&cell, &["jog", "B", "1", "--wait"]);
    let turned = tool_until(&mut cell, ready);
    assert!(
        (turned[turned.len() - 1][0] - 2.0).abs() > 1e-3,
        "the joint alone"
    );
    for (words, why) in [
        (&["jog", "Y", "500"][..], "Y"),
        (&["jog", "Y", "1", "B", "1"], "jogged alone"),
        (&["jog", "B", "1", "--to"], "jogged alone"),
        (&["jog", "Y+"], "by distances or to places alone"),
    ] {
        let said = ask(&cell, words);
        assert_eq!(said.status, 2, "{words:?}: {}", said.text);
        assert!(said.text.contains(why), "{words:?}: {}", said.text);
    }
    down(cell);
}
