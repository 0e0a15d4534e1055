//! Bad input of every kind: refused before anything starts, with file, line, value, unit and rule; nothing left behind.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::support::{Bench, LiveCell, circle_program, quadrant, root, traces_of, unique_cell};

struct Refused {
    status: i32,
    stderr: String,
}

/// Runs what is to be refused, and checks that nothing was started or left.
fn refused(machine: &Path, program: &Path) -> Refused {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let cell = unique_cell();
    let output: Output = quadrant()
        .arg("run")
        .arg(machine)
        .arg(program)
        .args(["--pace", "lockstep", "--cell", &cell, "--out"])
        .arg(&out)
        .output()
        .expect("running quadrant");
    assert!(!out.exists(), "a run directory was made for refused input");
    assert!(traces_of(&cell).is_empty(), "{:?}", traces_of(&cell));
    Refused {
        status: output.status.code().unwrap_or(-1),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

fn refused_program(text: &[u8], expected: &[&str]) {
    let bench = Bench::of("xy", &[]);
    let program = bench.path().join("bad.ngc");
    fs::write(&program, text).expect("writing");
    let refused = refused(bench.path(), &program);
    assert_eq!(refused.status, 2, "{}", refused.stderr);
    for word in expected {
        assert!(
            refused.stderr.contains(word),
            "no {word:?} in: {}",
            refused.stderr
        );
    }
}

fn refused_machine(what: &str, by: &str, expected: &[&str]) {
    let bench = Bench::of("xy", &[(what, by)]);
    let program = root().join("machines/xy/programs/circle-r25-f3000.ngc");
    let refused = refused(bench.path(), &program);
    assert_eq!(refused.status, 2, "{}", refused.stderr);
    for word in expected {
        assert!(
            refused.stderr.contains(word),
            "no {word:?} in: {}",
            refused.stderr
        );
    }
}

#[test]
fn a_misspelt_key_in_the_machine_file_is_named_with_its_line() {
    refused_machine(
        "gain_per_s = 50.0",
        "gian_per_s = 50.0",
        &["machine.toml:", "gian_per_s"],
    );
}

#[test]
fn a_negative_gain_is_refused_with_unit_and_rule() {
    refused_machine(
        "gain_per_s = 50.0",
        "gain_per_s = -50.0",
        &[
            "machine.toml:",
            "axis X",
            "gain_per_s = -50 1/s",
            "must be above 0",
        ],
    );
}

#[test]
fn a_value_that_is_not_a_number_is_refused() {
    refused_machine(
        "rapid_mm_s = 250.0",
        "rapid_mm_s = nan",
        &["rapid_mm_s", "must be above 0"],
    );
}

#[test]
fn a_missing_axis_is_refused() {
    let bench = Bench::of("xy", &[]);
    let text = fs::read_to_string(bench.path().join("machine.toml")).expect("machine.toml");
    let second = text.rfind("[[axis]]").expect("two axes");
    fs::write(bench.path().join("machine.toml"), &text[..second]).expect("writing");
    let program = root().join("machines/xy/programs/circle-r25-f3000.ngc");
    let refused = refused(bench.path(), &program);
    assert_eq!(refused.status, 2, "{}", refused.stderr);
    assert!(refused.stderr.contains('Y'), "{}", refused.stderr);
}

#[test]
fn a_plant_value_out_of_range_is_refused_with_its_line() {
    let bench = Bench::of("xy", &[]);
    let plant = fs::read_to_string(bench.path().join("plant.toml")).expect("plant.toml");
    let line = plant
        .lines()
        .find(|l| l.starts_with("mass_kg"))
        .expect("a mass");
    fs::write(
        bench.path().join("plant.toml"),
        plant.replacen(line, "mass_kg = -1.0", 1),
    )
    .expect("writing");
    let refused = refused(
        bench.path(),
        &root().join("machines/xy/programs/circle-r25-f3000.ngc"),
    );
    assert_eq!(refused.status, 2, "{}", refused.stderr);
    assert!(
        refused.stderr.contains("plant.toml:") && refused.stderr.contains("mass_kg"),
        "{}",
        refused.stderr
    );
}

#[test]
fn an_unsupported_word_is_refused_with_line_column_and_what_is_supported() {
    refused_program(
        b"G21 G90\nG0 X10\nG1 X20 F500 Q7\nM2\n",
        &["bad.ngc:3:", "Q"],
    );
    refused_program(b"G21 G90\nG51 X2\nM2\n", &["bad.ngc:2:", "G51", "scaling"]);
}

#[test]
fn a_program_leaving_the_travel_is_refused_with_axis_and_limit() {
    refused_program(b"G21 G90\nG1 X500 F500\nM2\n", &["bad.ngc:2", "X", "220"]);
}

#[test]
fn an_arc_in_the_wrong_plane_is_refused() {
    refused_program(
        b"G21 G90 G18\nG0 X10 Y0\nG2 X20 I5 F500\nM2\n",
        &["bad.ngc:3"],
    );
    refused_program(
        b"G21 G90 G17\nG0 X10 Y0\nG2 X20 K5 F500\nM2\n",
        &["bad.ngc:3", "K"],
    );
}

#[test]
fn an_arc_with_an_inconsistent_radius_is_refused() {
    refused_program(
        b"G21 G90 G17\nG0 X10 Y0\nG2 X30 Y0 I5 J0 F500\nM2\n",
        &["bad.ngc:3", "radii", "0.028 mm"],
    );
}

#[test]
fn an_empty_file_a_binary_file_and_a_folder_are_refused() {
    refused_program(b"", &["bad.ngc"]);
    refused_program(&[0x7f, b'E', b'L', b'F', 0, 1, 2, 0xff, 0xfe], &["bad.ngc"]);
    let bench = Bench::of("xy", &[]);
    let refused = refused(bench.path(), bench.path());
    assert_eq!(refused.status, 2, "{}", refused.stderr);
}

#[test]
fn a_file_of_200_mb_is_refused_without_being_read() {
    let bench = Bench::of("xy", &[]);
    let program = bench.path().join("huge.ngc");
    let file = fs::File::create(&program).expect("a file");
    file.set_len(200 << 20).expect("a sparse file");
    let refused = refused(bench.path(), &program);
    assert_eq!(refused.status, 2, "{}", refused.stderr);
    assert!(refused.stderr.contains("huge.ngc"), "{}", refused.stderr);
}

#[test]
fn an_unreadable_file_and_one_that_is_not_there_are_refused() {
    let bench = Bench::of("xy", &[]);
    for machine in [bench.path().to_path_buf(), PathBuf::from("no/such/machine")] {
        let refused = refused(&machine, Path::new("no/such/program.ngc"));
        assert_eq!(refused.status, 2, "{}", refused.stderr);
        assert!(refused.stderr.contains("no/such/"), "{}", refused.stderr);
    }
    // A file that even root cannot read as text: its own memory map is refused by the kernel.
    let refused = refused(bench.path(), Path::new("/proc/self/mem"));
    assert_eq!(refused.status, 2, "{}", refused.stderr);
}

#[test]
fn an_output_folder_that_cannot_be_written_or_is_not_empty_is_refused_with_3() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(10.0, 6000.0, (0.0, 0.0), 0.0));
    for out in [Path::new("/proc/nothing/here"), bench.path()] {
        let cell = unique_cell();
        let output = quadrant()
            .arg("run")
            .arg(bench.path())
            .arg(&program)
            .args(["--pace", "lockstep", "--cell", &cell, "--out"])
            .arg(out)
            .output()
            .expect("running quadrant");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{stderr}");
        assert!(stderr.contains(&out.display().to_string()), "{stderr}");
        assert!(traces_of(&cell).is_empty(), "{:?}", traces_of(&cell));
    }
}

#[test]
fn a_cell_of_that_name_that_already_runs_is_refused_with_3_and_goes_on() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(10.0, 3000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(100);
    let output = quadrant()
        .arg("run")
        .arg(bench.path())
        .arg(&program)
        .args(["--cell", &cell.cell, "--out"])
        .arg(bench.path().join("second"))
        .output()
        .expect("running quadrant");
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{stderr}");
    assert!(
        stderr.contains("already running")
            && stderr.contains(&format!("launcher pid {}", cell.child.id()))
            && stderr.contains("--cell"),
        "{stderr}"
    );
    cell.finish().good_report();
}

#[test]
fn a_cell_name_that_is_none_is_refused() {
    for name in [
        "Upper",
        "under_score",
        "-hyphen",
        "a-name-that-is-much-too-long-for-a-socket",
        "../escape",
        "",
    ] {
        let output = quadrant()
            .args([
                "run",
                "machines/xy",
                "machines/xy/programs/circle-r25-f3000.ngc",
            ])
            .arg(format!("--cell={name}"))
            .output()
            .expect("running quadrant");
        assert_eq!(
            output.status.code(),
            Some(2),
            "{name:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
    }
}

#[test]
fn bad_usage_ends_with_2() {
    for arguments in [
        vec!["run"],
        vec!["no-such-command"],
        vec!["run", "machines/xy", "x.ngc", "--pace", "warp"],
    ] {
        let output = quadrant()
            .args(&arguments)
            .output()
            .expect("running quadrant");
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn a_program_with_the_name_of_a_file_of_the_run_directory_is_refused() {
    let bench = Bench::of("xy", &[]);
    for name in ["run.mcap", "report.json", "events.jsonl", "circle-1.svg"] {
        let program = bench.file(name, &circle_program(10.0, 6000.0, (0.0, 0.0), 0.0));
        let refused = refused(bench.path(), &program);
        assert_eq!(refused.status, 2, "{}", refused.stderr);
        assert!(
            refused.stderr.contains("rename the program"),
            "{}",
            refused.stderr
        );
    }
}

/// Anybody may write to /dev/shm: what is in the cell's place is not followed, taken or removed unless it is ours.
#[test]
fn a_link_in_the_place_of_the_cell_is_refused_and_what_it_points_to_stays() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(10.0, 6000.0, (0.0, 0.0), 0.0));
    let victim = tempfile::tempdir().expect("a folder");
    fs::write(victim.path().join("precious"), "kept").expect("a file");
    let cell = unique_cell();
    let place = format!("/dev/shm/quadrant-{cell}");
    std::os::unix::fs::symlink(victim.path(), &place).expect("a link");
    let output = quadrant()
        .arg("run")
        .arg(bench.path())
        .arg(&program)
        .args(["--cell", &cell, "--out"])
        .arg(bench.path().join("run"))
        .output()
        .expect("running quadrant");
    fs::remove_file(&place).expect("removing the link");
    assert_eq!(output.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&output.stderr).contains("is not a folder"));
    let left: Vec<_> = fs::read_dir(victim.path())
        .expect("the folder")
        .flatten()
        .collect();
    assert_eq!(left.len(), 1, "{left:?}");
}

/// Whoever sends a program names its file: the terminal obeys nothing of that.
#[test]
fn no_name_of_a_program_is_obeyed_by_the_terminal() {
    let bench = Bench::of("xy", &[]);
    let good = bench.file("good\u{1b}[31m.ngc", "G21 G90 F100\nG1 X5\nM2\n");
    let bad = bench.file("bad\u{1b}]0;owned\u{7}.ngc", "G9999\nM2\n");
    let none = bench.path().join("none\u{1b}[2J.ngc");
    let out = bench.path().join("out");
    for (command, program) in [
        ("check", &good),
        ("check", &bad),
        ("check", &none),
        ("run", &good),
    ] {
        let mut quadrant = quadrant();
        quadrant.arg(command).arg(bench.path()).arg(program);
        if command == "run" {
            quadrant.args(["--pace", "lockstep", "--cell", &unique_cell(), "--out"]);
            quadrant.arg(&out);
        }
        let printed = quadrant.output().expect("a command");
        for bytes in [&printed.stdout, &printed.stderr] {
            let text = String::from_utf8_lossy(bytes);
            let obeyed = text.find(|c: char| c.is_control() && c != '\n' && c != '\t');
            assert!(
                obeyed.is_none(),
                "{command} {}: {text:?}",
                program.display()
            );
        }
    }
}

/// Nobody reads a number of 309 digits.
#[test]
fn no_number_is_shown_with_hundreds_of_digits() {
    let program = root().join("machines/xy/programs/circle-r25-f3000.ngc");
    let edits = ["rapid_mm_s = 1e308", "rapid_mm_s = -1e308"];
    let machines = edits.map(|by| Bench::of("xy", &[("rapid_mm_s = 250.0", by)]));
    let mut all: Vec<Refused> = machines
        .iter()
        .map(|bench| refused(bench.path(), &program))
        .collect();
    let bench = Bench::of("xy", &[]);
    for line in [
        "G1 X[10**300] F100",
        "G1 X[-1*10**300] F100",
        "G4 P[10**300]",
        "G64 P[10**300]",
        "G10 L2 P1 X[10**300]\nG1 X1 F100",
        "#[10**300] = 1",
        "G[10**300]",
        "M[10**300]",
        "O[10**300] CALL",
    ] {
        let program = bench.file("bad.ngc", &format!("G21 G90\n{line}\nM2\n"));
        let refused = refused(bench.path(), &program);
        all.push(refused);
    }
    fs::write(
        bench.path().join("offsets.toml"),
        "[G54]\nX = 1e308\nY = 1e-308\n",
    )
    .expect("offsets");
    all.push(refused(bench.path(), &program));
    for Refused { status, stderr } in all {
        assert_eq!(status, 2, "{stderr}");
        let mut digits = stderr.split(|c: char| !c.is_ascii_digit());
        assert!(digits.all(|run| run.len() <= 40), "{stderr}");
    }
}

/// What is too small for the command line was used up without a word: status 134.
#[test]
fn a_stack_that_is_too_small_is_refused_with_what_is_needed() {
    for kib in [64, 128, 1024] {
        let line = format!(
            "ulimit -s {kib}; exec {} --version",
            env!("CARGO_BIN_EXE_quadrant")
        );
        let output = std::process::Command::new("sh")
            .args(["-c", &line])
            .output()
            .expect("a shell");
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(3), "{kib}: {stderr}");
        let words = format!("{kib} KiB of stack are granted (`ulimit -s`");
        assert!(stderr.contains(&words), "{stderr}");
    }
}
