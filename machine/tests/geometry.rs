//! Tables of errors, squareness and straightness: what is refused, and what copies of a machine file hold.

use std::fs;
use std::os::unix::fs::symlink;

use machine::Machine;

fn axis(name: &str, more: &str) -> String {
    format!(
        "[[axis]]\nname = \"{name}\"\nrapid_mm_s = 250.0\nacceleration_mm_s2 = 5000.0\nquick_stop_mm_s2 = 12000.0\n\
         following_error_limit_mm = 2.0\nlead_mm = 10.0\ntravel_min_mm = -100.0\ntravel_max_mm = 100.0\n\
         motor = {{ rated_torque_nm = 8.0, peak_torque_nm = 32.0 }}\nposition_loop = {{ gain_per_s = 50.0 }}\n\
         velocity_loop = {{ gain_n_s_per_m = 259400.0, integral_time_ms = 10.0, period_us = 250 }}\n\
         reversal.method = \"backlash\"\n{more}"
    )
}

const HEAD: &str = "name = \"m\"\n\n[scan]\nperiod_us = 1000\ninterpolation_period_scans = 8\n";

/// X with a table, and Y with what stands at the end of the file.
fn machine(of_x: &str, end: &str) -> String {
    format!("{HEAD}{}{}{end}", axis("X", of_x), axis("Y", ""))
}

fn refusal(text: &str) -> String {
    let parsed = Machine::parse("m.toml", text);
    parsed
        .map(|_| String::new())
        .unwrap_or_else(|error| error.to_string())
}

fn table(positions: &str, forward: &str, backward: &str) -> String {
    format!(
        "[axis.compensation]\npositions_mm = {positions}\nforward_um = {forward}\nbackward_um = {backward}\n"
    )
}

#[test]
fn every_bad_table_of_an_axis_is_refused_with_its_line_and_what_would_be_right() {
    let many: Vec<String> = (0..1001).map(|at| at.to_string()).collect();
    let many = format!("[{}]", many.join(", "));
    for (of_x, says) in [
        (
            table("[0, 50, 50]", "[0, 1, 2]", "[]"),
            "positions_mm must ascend: 50 comes after 50",
        ),
        (
            table("[0, 50, 20]", "[0, 1, 2]", "[]"),
            "positions_mm must ascend: 20 comes after 50",
        ),
        (table("[0, nan]", "[0, 1]", "[]"), "positions_mm"),
        (table("[0, 50]", "[0, nan]", "[]"), "forward_um"),
        (table("[0, 50]", "[0, inf]", "[]"), "forward_um"),
        (table("[0, 50_000]", "[0, 1001]", "[]"), "at most 1000"),
        (
            table("[0]", "[0]", "[]"),
            "positions_mm has 1 values: at least 2, or a `file`",
        ),
        (table("[]", "[]", "[]"), "positions_mm has 0 values"),
        (
            table("[0, 50]", "[0]", "[]"),
            "forward_um has 1 values: must be 2, as many as positions_mm",
        ),
        (
            table("[0, 50]", "[0, 1]", "[0]"),
            "backward_um has 1 values: must be 2",
        ),
        (
            table("[0, 50]", "[0, 51]", "[]"),
            "forward_um rises by 1.020 µm/mm from 0 to 50 mm: at most 1 µm/mm",
        ),
        (
            table("[0, 50]", "[0, 1]", "[0, -51]"),
            "backward_um rises by -1.020 µm/mm",
        ),
        (table(&many, &many, "[]"), "positions_mm"),
        (
            "[axis.compensation]\nfile = \"../x.csv\"\n".into(),
            "must be a path below the folder of this file",
        ),
        (
            "[axis.compensation]\nfile = \"x.csv\"\npositions_mm = [0, 1]\n".into(),
            "goes without positions_mm",
        ),
        (
            "[axis.compensation]\nforwards_um = [0, 1]\n".into(),
            "unknown field `forwards_um`",
        ),
    ] {
        let said = refusal(&machine(&of_x, ""));
        assert!(
            said.contains("axis X compensation") && said.contains(says),
            "{of_x}: {said}"
        );
    }
    assert_eq!(
        refusal(&machine(&table("[0, 50]", "[0, 50]", "[0, 50]"), "")),
        ""
    );
}

#[test]
fn guideways_name_two_slides_of_the_machine_each_pair_once() {
    let square = |of: &str, to: &str| {
        format!("[[squareness]]\nof = \"{of}\"\nto = \"{to}\"\num_per_m = 45.0\n")
    };
    let straight = |of: &str, to: &str, positions: &str, errors: &str| {
        format!(
            "[[straightness]]\nof = \"{of}\"\nto = \"{to}\"\npositions_mm = {positions}\nerror_um = {errors}\n"
        )
    };
    for (end, says) in [
        (
            square("Y", "Z"),
            "squareness.1.to = \"Z\": must name a slide of this machine: X Y",
        ),
        (
            square("A", "X"),
            "squareness.1.of = \"A\": must name a slide",
        ),
        (square("Y", "Y"), "must be another axis than `of`"),
        (
            square("Y", "X") + &square("X", "Y"),
            "squareness.2.to is of X and Y again: their angle is one number",
        ),
        (
            square("Y", "X").replace("45.0", "1001.0"),
            "at most 1000 µm/m",
        ),
        (square("Y", "X").replace("45.0", "nan"), "um_per_m"),
        (
            square("Y", "X").repeat(17),
            "squareness is there 17 times: at most 16",
        ),
        (
            straight("Y", "Z", "[0, 9]", "[0, 1]"),
            "straightness.1.to = \"Z\": must name a slide",
        ),
        (
            straight("Y", "X", "[9, 0]", "[0, 1]"),
            "straightness.1.positions_mm must ascend: 0 comes after 9",
        ),
        (
            straight("Y", "X", "[0, 9]", "[0, 1, 2]"),
            "straightness.1.error_um has 3 values: must be 2",
        ),
        (
            straight("Y", "X", "[0, 9]", "[0, 10]"),
            "straightness.1.error_um rises by 1.111 µm/mm",
        ),
        (
            straight("Y", "X", "[0, 9]", "[0, 1]").repeat(2),
            "straightness.2.to is of Y towards X again",
        ),
    ] {
        let said = refusal(&machine("", &end));
        assert!(said.contains(says), "{end}: {said}");
    }
    let both = square("Y", "X")
        + &straight("Y", "X", "[0, 9]", "[0, 1]")
        + &straight("X", "Y", "[0, 9]", "[0, 1]");
    assert_eq!(refusal(&machine("", &both)), "");
}

#[test]
fn corrections_that_would_take_an_axis_beyond_its_limits_are_refused_together() {
    // A saw of ±20 µm every 40 mm: kinks of 2 µm/mm, at 250 mm/s twice 25 mm/s² behind a gain of 50/s.
    let saw = table("[-80, -40, 0, 40, 80]", "[-20, 20, -20, 20, -20]", "[]");
    let slow = axis("X", &saw).replace("= 5000.0", "= 500.0");
    let said = refusal(&format!("{HEAD}{slow}{}", axis("Y", "")));
    assert!(
        said.contains("axis X is corrected with up to 50.5 mm/s² (compensation, squareness and straightness together): at most 5 %"),
        "{said}"
    );
    let creeping = axis("X", "").replace("rapid_mm_s = 250.0", "rapid_mm_s = 20.0");
    let lean = "[[squareness]]\nof = \"Y\"\nto = \"X\"\num_per_m = 1000.0\n";
    let said = refusal(&format!("{HEAD}{creeping}{}{lean}", axis("Y", "")));
    assert!(
        said.contains("axis X is corrected at up to 0.25 mm/s"),
        "{said}"
    );
}

#[test]
fn second_motors_endless_axes_and_machines_with_kinematics_are_refused_by_name() {
    let second = axis(
        "X2",
        &format!(
            "gantry = {{ leader = \"X\", skew_max_mm = 0.2 }}\n{}",
            table("[0, 50]", "[0, 1]", "[]")
        ),
    );
    let said = refusal(&format!("{}{second}", machine("", "")));
    assert!(said.contains("axis X2 compensation is of a second motor: the table of its axis counts for both motors"), "{said}");

    let turns = "kind = \"rotary\"\nmodulo = true\n[axis.compensation]\npositions_deg = [0, 90]\nforward_mdeg = [0, 1]\n";
    let ends = "travel_min_mm = -100.0\ntravel_max_mm = 100.0\n";
    let endless = axis("C", turns).replace(ends, "");
    let said = refusal(&format!("{HEAD}{}{endless}", axis("X", "")));
    assert!(
        said.contains("axis C compensation is of an axis that turns without end"),
        "{said}"
    );
    let said = refusal(&format!(
        "{}[[squareness]]\nof = \"X\"\nto = \"A\"\num_per_m = 1.0\n",
        {
            let rotary = "kind = \"rotary\"\n[axis.compensation]\npositions_deg = [0, 90]\nforward_mdeg = [0, 1]\n";
            format!("{HEAD}{}{}", axis("X", ""), axis("A", rotary))
        }
    ));
    assert!(
        said.contains("squareness.1.to = \"A\": must name a slide of this machine: X")
            && !said.contains("compensation"),
        "{said}"
    );

    let pivot = include_str!("../../machines/xzb-pivot/machine.toml");
    let lean = format!(
        "{pivot}\n[axis.compensation]\npositions_mm = [0, 50]\nforward_um = [0, 1]\n[[squareness]]\nof = \"Z\"\nto = \"X\"\num_per_m = 45.0\n"
    );
    let said = refusal(&lean);
    assert!(
        said.contains("compensation goes without [kinematics]")
            && said.contains("squareness.1 goes without [kinematics]"),
        "{said}"
    );
}

/// A machine whose X has a file, as it lies in a folder.
fn in_folder(csv: Option<&str>) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let text = machine("[axis.compensation]\nfile = \"x.csv\"\n", "");
    fs::write(folder.path().join("machine.toml"), text).expect("a machine");
    if let Some(csv) = csv {
        fs::write(folder.path().join("x.csv"), csv).expect("a table");
    }
    folder
}

#[test]
fn a_file_that_is_missing_no_file_or_no_table_is_refused_and_never_waited_for() {
    let said = |folder: &tempfile::TempDir| {
        let loaded = Machine::load(folder.path());
        loaded
            .map(|_| String::new())
            .unwrap_or_else(|error| error.to_string())
    };
    for (csv, says) in [
        (None, "x.csv"),
        (
            Some("at,error\n"),
            "x.csv:1: \"at,error\": must be the heading",
        ),
        (
            Some("position_mm,forward_um\n0,0\n"),
            "positions_mm has 1 values",
        ),
        (
            Some("position_mm,forward_um\n0,0\n0,1\n"),
            "positions_mm must ascend: 0 comes after 0",
        ),
        (
            Some("position_mm,forward_um\n0,0\n9000,2000\n"),
            "forward_um = 2000 µm: must be at least -1000 and at most 1000 µm",
        ),
        (
            Some("position_mm,forward_um\n0,0\n1,9\n"),
            "forward_um rises by 9.000 µm/mm",
        ),
    ] {
        let found = said(&in_folder(csv));
        assert!(found.contains(says), "{csv:?}: {found}");
    }
    let folder = in_folder(None);
    let table = folder.path().join("x.csv");
    symlink("/dev/zero", &table).expect("a link");
    assert!(said(&folder).contains("is not a file"));
    fs::remove_file(&table).expect("the link");
    let made = std::process::Command::new("mkfifo").arg(&table).status();
    assert!(made.expect("mkfifo").success());
    assert!(said(&folder).contains("is not a file"));
}

#[test]
fn a_copy_of_a_machine_file_holds_the_table_and_corrects_the_same() {
    let folder = in_folder(Some(
        "position_mm,forward_um,backward_um\n-50,1.5,2.5\n50,-3,4\n",
    ));
    let of_file = Machine::load(folder.path()).expect("the machine");
    let copy = machine::snapshot(folder.path()).expect("a copy");
    let of_copy = Machine::parse("copy.toml", &copy).expect("the copy");
    assert_eq!(of_file.geometry(), of_copy.geometry());
    assert_eq!(
        of_file.lost_motion_by_place(0),
        of_copy.lost_motion_by_place(0)
    );
    assert!(of_file.lost_motion_by_place(0).is_some() && !copy.contains("x.csv"));
    let elsewhere = tempfile::tempdir().expect("a folder");
    machine::copy_named_files(folder.path(), elsewhere.path()).expect("copied");
    assert!(elsewhere.path().join("x.csv").is_file());
}

#[test]
fn both_motors_of_a_gantry_are_corrected_as_their_axis_is() {
    let second = axis("X2", "gantry = { leader = \"X\", skew_max_mm = 0.2 }\n");
    let lean = "[[squareness]]\nof = \"Y\"\nto = \"X\"\num_per_m = 40.0\n";
    let text = format!(
        "{}{second}{lean}",
        machine(&table("[0, 50]", "[0, 5]", "[]"), "")
    );
    let machine = Machine::parse("m.toml", &text).expect("a gantry");
    let terms: Vec<[usize; 2]> = machine
        .geometry()
        .iter()
        .map(|term| [term.of, term.from])
        .collect();
    assert_eq!(terms, [[0, 0], [0, 1], [2, 2], [2, 1]]);
    for axis in [0, 2] {
        let lean = machine
            .geometry()
            .iter()
            .find(|term| (term.of, term.from) == (axis, 1))
            .map(|term| term.errors.at_mm(-50.0));
        assert!(
            lean.is_some_and(|lean_mm| (lean_mm + 0.002).abs() < 1e-12),
            "{lean:?}"
        );
    }
}
