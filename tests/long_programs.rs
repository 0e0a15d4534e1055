//! Programs longer than anybody holds in memory: read as they are travelled, and gone on with from the place that was kept.

use std::fmt::Write;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::time::Instant;

use bus::sample::{Feedback, ProgramState};

use crate::support::{Bench, LiveCell, number, quadrant, run_with, send, text, traces_of};
use crate::up::obeyed;

/// Chords of 0.2 mm around and around, on a ring of changing width; each round is a call of a subroutine, within a loop.
fn rounds(rounds: u32) -> String {
    format!(
        "o1 sub\n#2 = 0\no2 while [#2 LT 600]\n#3 = [#2 * 0.6]\n\
         G1 X[[#1 + 12] * COS[#3] - 20] Y[[#1 + 12] * SIN[#3]]\n#2 = [#2 + 1]\no2 endwhile\no1 endsub\n\
         G21 G90 G17 F9000\nG0 X0 Y0\n#10 = 0\no3 while [#10 LT {rounds}]\n\
         o1 call [SIN[#10 * 20]]\n#10 = [#10 + 1]\no3 endwhile\nM2\n"
    )
}

/// Memory that a process holds, in MB.
fn memory_mb(pid: i32) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).expect("a process");
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    let kb = line.and_then(|line| line.split_whitespace().nth(1)?.parse().ok());
    kb.map_or(0.0, |kb: f64| kb / 1e3)
}

#[test]
fn a_killed_planner_goes_on_deep_in_a_long_program_and_the_run_is_the_same_again() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("rounds.ngc", &rounds(45));
    let kills: String = [8_000, 15_000, 22_123].map(kill_of_planner).concat();
    let faults = bench.file("faults.toml", &kills);
    let faults = ["--faults", faults.to_str().expect("a path")];
    let [first, second] = [(); 2].map(|()| {
        let report = run_with(bench.path(), &program, &faults).good_report();
        for fault in 0..3 {
            let of = |key: &str| number(&report, &format!("/faults/{fault}/{key}"));
            let moves_after = of("resumed_at_scan") - of("scan");
            assert!(
                moves_after <= 150.0,
                "moves again after {moves_after} scans"
            );
            assert!(
                of("contour_error_um_max") < 30.0,
                "{}",
                of("contour_error_um_max")
            );
        }
        text(&report, "/digest")
    });
    assert_eq!(first, second);
}

fn kill_of_planner(scan: u32) -> String {
    format!("[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"planner\"\ndo = \"kill\"\n\n")
}

#[test]
fn a_program_of_any_length_takes_no_memory() {
    let bench = Bench::of("xy", &[]);
    let mut blocks = String::from("G21 G90 F6000\n");
    for n in 0..400_000u32 {
        let at = f64::from(n) * 0.01;
        writeln!(
            blocks,
            "G1 X{:.4} Y{:.4}",
            20.0 * at.cos() - 20.0,
            20.0 * at.sin()
        )
        .expect("a string");
    }
    let program = bench.file("long.ngc", &(blocks + "M2\n"));
    let mut cell = LiveCell::start(bench.path(), &program, "lockstep");
    cell.wait_for_scan(100_000);
    for (pid, line) in cell.children() {
        let mb = memory_mb(pid);
        assert!(mb < 100.0, "{line}: {mb} MB");
    }
    cell.signal_launcher(libc::SIGTERM);
    let name = cell.cell.clone();
    cell.finish();
    assert_eq!(traces_of(&name), Vec::<String>::new());
}

#[test]
fn a_mistake_far_ahead_stops_the_run_before_its_block_at_rest() {
    let bench = Bench::of("xy", &[]);
    let mut blocks = String::from("G21 G90 F9000\n");
    // Farther ahead than a run looks before it begins: strokes of 100 mm there and back.
    for n in 0..130_000u32 {
        let along = n % 10_000;
        let step = along.min(10_000 - along);
        writeln!(blocks, "G1 X{:.2}", 0.02 * f64::from(step)).expect("a string");
    }
    let line = blocks.lines().count() + 1;
    let program = bench.file("wrong.ngc", &(blocks + "G1 X[SQRT[0 - 1]]\nM2\n"));
    let check = quadrant()
        .arg("check")
        .args([bench.path(), program.as_path()])
        .output()
        .expect("quadrant");
    let told = String::from_utf8_lossy(&check.stderr).into_owned();
    assert!(told.contains(&format!("wrong.ngc:{line}")), "{told}");
    let run = run_with(bench.path(), &program, &[]);
    assert_eq!(run.status(), 1, "{}", run.stderr());
    assert!(
        run.stderr().contains(&format!("wrong.ngc:{line}")),
        "{}",
        run.stderr()
    );
    let report = run.report();
    assert!(number(&report, "/contour_error_um/peak") < 30.0);
}

#[test]
fn a_planner_killed_in_real_time_deep_in_a_program_is_soon_back() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("rounds.ngc", &rounds(400));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for(|feedback| !feedback.tag.is_off_path() && feedback.tag.element > 2000);
    send(cell.pid_of("quadrant planner"), libc::SIGKILL);
    let comes = |cell: &LiveCell| {
        let mut lines = cell.children().into_iter().map(|(_, line)| line);
        lines.any(|line| line.contains("quadrant planner") && line.contains("--incarnation 2"))
    };
    while !comes(&cell) {
        cell.wait_for(|_| true);
    }
    // The window that the first one left has ended by then.
    let there = cell.wait_for(|_| true);
    cell.wait_for(|feedback| feedback.tag.element > there.tag.element + 100);
    cell.signal_launcher(libc::SIGTERM);
    cell.finish();
}

/// Writes chords of 0.2 mm around and around, so many blocks.
fn write_blocks(file: &Path, blocks: u32) {
    let mut out = BufWriter::new(File::create(file).expect("a file"));
    writeln!(out, "G21 G90 G17 F6000\nG0 X0 Y0").expect("written");
    for n in 0..blocks {
        let at = f64::from(n) * 0.01;
        let (x, y) = (20.0 * at.cos() - 20.0, 20.0 * at.sin());
        writeln!(out, "G1 X{x:.4} Y{y:.4}").expect("written");
    }
    writeln!(out, "M2").expect("written");
    out.flush().expect("written");
}

/// Scans from the first feedback of a started program to the first one with motion, and how long that took from the order.
fn first_motion(cell: &mut LiveCell) -> (u64, f64) {
    let (_bus, mut reader) = cell.feedback();
    let begun = Instant::now();
    let child = quadrant().args(["start", "--cell", &cell.cell]).spawn();
    let mut child = child.expect("quadrant");
    let moves = |feedback: &Feedback| {
        let mut axes = feedback.axes().iter();
        axes.any(|axis| axis.velocity_command_mm_s.abs() > 0.01)
    };
    let mut started = None;
    let moved = loop {
        if let Some(feedback) = reader.newest(u64::MAX)
            && feedback.program == ProgramState::Running as u32
        {
            let started = *started.get_or_insert(feedback.scan);
            if moves(&feedback) {
                break Some((feedback.scan - started, begun.elapsed().as_secs_f64()));
            }
        }
        if begun.elapsed().as_secs() >= 60 {
            break None;
        }
        std::thread::sleep(std::time::Duration::from_micros(200));
    };
    assert!(child.wait().expect("an end").success());
    moved.expect("motion within a minute")
}

#[test]
#[ignore = "a measurement: cargo test --release --test cell -- --ignored --nocapture first_motion"]
fn the_first_motion_after_start_takes_as_long_for_any_program() {
    let bench = Bench::patient("xy", &[]);
    let mut cell = LiveCell::up(bench.path(), "realtime");
    cell.wait_for_scan(100);
    obeyed(&cell, &["enable"]);
    // The longest is near the 64 MiB that `load` takes.
    for blocks in [10, 1_000_000, 2_600_000] {
        let program = bench.path().join("any.ngc");
        write_blocks(&program, blocks);
        let mb = std::fs::metadata(&program).expect("a file").len() as f64 / 1e6;
        let begun = Instant::now();
        obeyed(&cell, &["load", program.to_str().expect("a path")]);
        let loaded_s = begun.elapsed().as_secs_f64();
        let (scans, took_s) = first_motion(&mut cell);
        println!(
            "{blocks} blocks, {mb:.1} MB: loaded in {loaded_s:.2} s; motion {scans} scans after the start, {took_s:.3} s after \
             `quadrant start` was called"
        );
        obeyed(&cell, &["stop"]);
        cell.wait_for(|feedback| feedback.program == ProgramState::Done as u32);
    }
}
