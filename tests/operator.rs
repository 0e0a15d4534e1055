//! Orders to a running cell: hold, jog, drives off and on, resume; refusals; what a script of them does to the bit.

use std::path::Path;
use std::process::Output;

use bus::sample::{AxisCommand, Driver, Feedback, Hand, Mode};
use loops::changeover::Phase;
use monitor::log::{Reader, Sample};

use crate::support::{
    Bench, LiveCell, Run, circles_each_way, long_program, number, quadrant, text,
};

/// Programmed end of the circles below, in increments of 1 nm.
const END: [i64; 2] = [25_000_000, 0];
/// Mid-arc: both axes move, the last reversal is 0.4 s ago and the next is 0.4 s ahead.
const MID_ARC: u64 = 1550;

fn bench(edits: &[(&str, &str)]) -> (Bench, std::path::PathBuf) {
    // A servo with a standby says its state in every command.
    let standby = "drive_mode = \"velocity\"\nstandby = true";
    let standby = [("drive_mode = \"velocity\"", standby)];
    let bench = Bench::of("xy", &[edits, &standby].concat());
    let program = bench.file(
        "circle.ngc",
        &circles_each_way(1, 25.0, 3000.0, (0.0, 0.0), 0.0),
    );
    (bench, program)
}

/// `scan order [axis] [value]` as a file of orders.
fn orders(bench: &Bench, list: &[(u64, &str, &str)]) -> String {
    let mut text = String::new();
    for (scan, order, more) in list {
        let more = more.replace(';', "\n");
        text.push_str(&format!(
            "[[order]]\nscan = {scan}\norder = \"{order}\"\n{more}\n"
        ));
    }
    bench.file("orders.toml", &text).display().to_string()
}

fn run_with(bench: &Bench, program: &Path, list: &[(u64, &str, &str)]) -> Run {
    let file = orders(bench, list);
    LiveCell::start_with(
        bench.path(),
        program,
        "lockstep",
        &["--orders", &file, "--log", "full"],
    )
    .finish()
}

const JOG: [(u64, &str, &str); 4] = [
    (MID_ARC, "hold", ""),
    (2000, "jog", "axis = \"X\"; value = 3.0"),
    (3200, "jog", "axis = \"Y\"; value = -2.0"),
    (4400, "resume", ""),
];

/// Feedback and commands of every scan, from the log.
fn log(run: &Run) -> (Vec<Feedback>, [Vec<AxisCommand>; 2]) {
    let (mut feedbacks, mut commands) = (Vec::new(), [Vec::new(), Vec::new()]);
    for sample in Reader::open(&run.out.join("run.mcap")).expect("the log") {
        match sample.expect("a sample") {
            Sample::Feedback(feedback) => feedbacks.push(*feedback),
            Sample::Command(command) if command.role == 0 => {
                commands[command.axis as usize].push(*command);
            }
            _ => {}
        }
    }
    (feedbacks, commands)
}

/// Who drives an axis in a scan: nobody, the program's controller or the manual one.
fn driving(feedback: &Feedback, axis: usize) -> u32 {
    match Mode::from_wire(feedback.mode) {
        Some(Mode::Disabled) => 0,
        _ if feedback.axes[axis].driver == Driver::Program as u32 => 1,
        _ => 2,
    }
}

/// Speed of the compensation of lost motion in a command, in mm/s.
fn crossing_mm_s(command: &AxisCommand, scan_s: f64) -> f64 {
    let state = servo::ServoState::of(command);
    let [now_mm, before_mm, ..] = state.model.inverse_dynamics.compensation_mm;
    (now_mm - before_mm) / scan_s
}

/// At every switch the velocity command goes on as it was: by nothing at all onto a controller, by what little was asked
/// for to the drives being off. While no window is executed it never changes faster than a jog may accelerate, a fifth of
/// the axis's 5000 mm/s², and what the position loop corrects, less than a quarter of that; what crosses the gap of the screw, in some
/// ms at each reversal, is beside it. Returns the switches.
fn switches_without_a_step(run: &Run, scan_s: f64) -> usize {
    let (feedbacks, commands) = log(run);
    let mut switches = 0;
    for (axis, commands) in commands.iter().enumerate() {
        for pair in commands.windows(2) {
            let [before, now] = pair else { continue };
            let of = |command: &AxisCommand| &feedbacks[command.scan as usize];
            let (from, to) = (driving(of(before), axis), driving(of(now), axis));
            let step_mm_s = (now.velocity_mm_s - before.velocity_mm_s).abs();
            if from != to {
                switches += 1;
                let most_mm_s = if to == 0 { 0.05 } else { 1e-9 };
                assert!(
                    step_mm_s <= most_mm_s,
                    "axis {axis} scan {}: {from} → {to} steps by {step_mm_s} mm/s",
                    now.scan
                );
            }
            if of(now).tag.is_off_path() && of(now).window.is_none() {
                let crossing = |command: &AxisCommand| crossing_mm_s(command, scan_s);
                let crossing_mm_s = (crossing(now) - crossing(before)).abs();
                assert!(
                    step_mm_s <= 1.25 * 1000.0 * scan_s + crossing_mm_s,
                    "axis {axis} scan {}: {step_mm_s} mm/s in a scan",
                    now.scan
                );
            }
        }
    }
    switches
}

fn ends_at_the_programmed_point(run: &Run) {
    let (feedbacks, _) = log(run);
    let last = feedbacks.last().expect("a last feedback");
    assert_eq!(Mode::from_wire(last.mode), Some(Mode::Finished));
    for (axis, end) in last.axes().iter().zip(END) {
        assert_eq!(axis.command_position, end);
    }
}

fn contour_um(run: &Run) -> f64 {
    number(&run.good_report(), "/contour_error_um/peak")
}

/// The furthest that an axis was from its command while it was jogged, in µm.
fn jog_lags_um(run: &Run) -> f64 {
    let (_, commands) = log(run);
    let mut most_um = 0.0f64;
    for commands in &commands {
        for command in commands {
            if command.hand >= Hand::Follows as u32 {
                most_um = most_um.max(command.following_error_mm.abs() * 1e3);
            }
        }
    }
    most_um
}

#[test]
fn a_jog_lags_little_from_its_first_scan_on() {
    let mut lags_um = Vec::new();
    let jerk = "jerk_mm_s3 = 100000.0\nincrement_nm = 0.1\nacceleration_mm_s2 = 5000.0";
    for line in ["acceleration_mm_s2 = 5000.0", jerk] {
        let (bench, program) = bench(&[("acceleration_mm_s2 = 5000.0", line)]);
        let run = run_with(&bench, &program, &JOG);
        switches_without_a_step(&run, 1e-3);
        lags_um.push(jog_lags_um(&run));
    }
    // Where nothing was fed forward it was 10 mm/s over 50/s, 200 µm; without friction and lost motion 25 µm.
    assert!(lags_um.iter().all(|lag_um| *lag_um < 3.0), "{lags_um:?}");
}

#[test]
fn a_jog_in_mid_arc_is_undone_by_resume_and_the_program_ends_as_if_nothing_had_been() {
    let (undisturbed, program) = bench(&[]);
    let undisturbed_um = contour_um(&run_with(&undisturbed, &program, &[]));
    for changeover in ["settled-deviation", "return-to-stand"] {
        let line = format!("drive_mode = \"velocity\"\nchangeover = \"{changeover}\"");
        let (bench, program) = bench(&[("drive_mode = \"velocity\"", &line)]);
        let run = run_with(&bench, &program, &JOG);
        let report = run.good_report();
        ends_at_the_programmed_point(&run);
        let found_um = number(&report, "/contour_error_um/peak");
        assert!(
            found_um <= undisturbed_um + 1.0,
            "{changeover}: {found_um} µm, undisturbed {undisturbed_um} µm"
        );
        assert_eq!(switches_without_a_step(&run, 1e-3), 4, "{changeover}");
        for limit in ["velocity", "acceleration", "travel"] {
            assert_eq!(number(&report, &format!("/limits/{limit}_exceeded")), 0.0);
        }
        let again = run_with(&bench, &program, &JOG).good_report();
        for digest in ["/digest", "/motion_digest"] {
            assert_eq!(text(&report, digest), text(&again, digest), "{changeover}");
        }
    }
}

#[test]
fn while_the_second_controller_drives_the_first_ones_command_position_is_true_to_the_increment() {
    let (bench, program) = bench(&[]);
    let run = run_with(&bench, &program, &JOG);
    let (feedbacks, commands) = log(&run);
    for (axis, (from, to, way_mm)) in [(2000, 3200, 3.0), (3200, 4400, -2.0)]
        .into_iter()
        .enumerate()
    {
        let mut followed = 0;
        for command in commands[axis]
            .iter()
            .filter(|c| c.scan > from && c.scan < to)
        {
            let feedback = &feedbacks[command.scan as usize].axes[axis];
            let state = servo::ServoState::of(command);
            if state.manual.changeover.phase() == Phase::Following {
                followed += 1;
                let error = command.position - feedback.motor_position;
                assert_eq!(error, state.program.error);
            }
        }
        assert!(followed > 200, "axis {axis}: {followed} scans");
        let command_position = |scan: u64| feedbacks[scan as usize].axes[axis].command_position;
        let moved = command_position(to) - command_position(from);
        assert_eq!(moved, (way_mm * 1e6) as i64, "axis {axis}");
    }
}

#[test]
fn drives_off_and_on_in_a_hold_lose_neither_the_position_nor_the_path() {
    let (bench, program) = bench(&[]);
    let undisturbed_um = contour_um(&run_with(&bench, &program, &[]));
    let off_and_on = [
        (MID_ARC, "hold", ""),
        (2000, "disable", ""),
        (2500, "enable", ""),
        (2800, "resume", ""),
    ];
    let run = run_with(&bench, &program, &off_and_on);
    let found_um = contour_um(&run);
    assert!(found_um <= undisturbed_um + 1.0, "{found_um} µm");
    ends_at_the_programmed_point(&run);
    assert_eq!(switches_without_a_step(&run, 1e-3), 4);
    let (feedbacks, _) = log(&run);
    // The axes relax when the torque goes: the command position goes with them, from the first scan on.
    for axis in 0..2 {
        let of = |scan: usize| {
            let axis = &feedbacks[scan].axes[axis];
            (axis.command_position, axis.motor_position)
        };
        let (command_position, encoder) = of(2001);
        for scan in 2001..=2500 {
            let now = of(scan);
            assert_eq!(now.0 - command_position, now.1 - encoder, "scan {scan}");
        }
        // The loop closes on the command position of scan 2500; what the axis moves from there on is position error.
        assert_eq!(of(2501).0, of(2500).0, "switched on");
    }
}

#[test]
fn a_hold_on_the_way_back_a_second_jog_and_a_jog_before_the_start_still_end_at_the_programmed_point()
 {
    let (bench, program) = bench(&[]);
    for list in [
        vec![
            (MID_ARC, "hold", ""),
            (2000, "jog", "axis = \"X\"; value = 30.0"),
            (6000, "resume", ""),
            (6500, "hold", ""),
            (7000, "jog", "axis = \"Y\"; value = 4.0"),
            (8500, "resume", ""),
        ],
        vec![
            (0, "hold", ""),
            (300, "jog", "axis = \"Y\"; value = 5.0"),
            (1500, "resume", ""),
        ],
        vec![
            (MID_ARC, "stop", ""),
            (1640, "jog", "axis = \"X\"; value = 0.5"),
            (1905, "resume", ""),
        ],
    ] {
        let run = run_with(&bench, &program, &list);
        assert_eq!(run.status(), 0, "{list:?}: {}", run.stderr());
        ends_at_the_programmed_point(&run);
        let refused = run.stderr().contains("refused");
        assert!(!refused, "{list:?}: {}", run.stderr());
        assert!(switches_without_a_step(&run, 1e-3) >= 2, "{list:?}");
    }
}

#[test]
fn in_torque_mode_jog_and_resume_work_the_same() {
    let standby = "drive_mode = \"torque\"\nstandby = true";
    let bench = Bench::of("xy-torque", &[("drive_mode = \"torque\"", standby)]);
    let program = bench.file(
        "circle.ngc",
        &circles_each_way(1, 25.0, 3000.0, (0.0, 0.0), 0.0),
    );
    let scans_per_ms = 4;
    let list: Vec<(u64, &str, &str)> = JOG
        .into_iter()
        .map(|(scan, order, more)| (scan * scans_per_ms, order, more))
        .collect();
    let run = run_with(&bench, &program, &list);
    assert_eq!(run.status(), 0, "{}", run.stderr());
    ends_at_the_programmed_point(&run);
    assert_eq!(switches_without_a_step(&run, 250e-6), 4);
}

#[test]
fn a_file_of_orders_that_is_none_is_refused_before_anything_starts() {
    let (bench, program) = bench(&[]);
    let run = run_with(&bench, &program, &[(1, "halt", "")]);
    assert_eq!(run.status(), 2);
    assert!(run.stderr().contains("must be one of"), "{}", run.stderr());
    assert!(!run.out.exists());
}

/// One order from another terminal: its status and what it printed.
fn order(cell: &str, words: &[&str]) -> (i32, String) {
    let Output {
        status,
        stdout,
        stderr,
    } = quadrant()
        .args(words)
        .args(["--cell", cell])
        .output()
        .expect("quadrant");
    let printed = [stdout, stderr].concat();
    (
        status.code().unwrap_or(-1),
        String::from_utf8_lossy(&printed).into_owned(),
    )
}

#[test]
fn from_another_terminal_orders_are_obeyed_or_refused_with_the_reason() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for(|f| f.tag.element >= 2);
    let name = cell.cell.clone();
    let refused = |words: &[&str], why: &str| {
        let (status, printed) = order(&name, words);
        assert_eq!(status, 1, "{words:?}: {printed}");
        assert!(printed.contains(why), "{words:?}: {printed}");
    };
    let obeyed = |words: &[&str], what: &str| {
        let (status, printed) = order(&name, words);
        assert_eq!(
            (status, printed.contains(what)),
            (0, true),
            "{words:?}: {printed}"
        );
    };
    refused(&["jog", "X", "1"], "not in hold");
    refused(&["disable"], "not in hold");
    refused(&["override", "120"], "0 to 100 %");
    obeyed(&["override", "50"], "override 50 %");
    obeyed(&["enable"], "drives on");
    obeyed(&["hold"], "comes to rest on the path");
    cell.wait_for(|f| f.at_rest == 1);
    std::thread::sleep(std::time::Duration::from_millis(300));
    refused(&["jog", "X", "1000"], "a jog of X may be -");
    refused(&["jog", "Y", "0"], "any distance but 0");
    let (status, printed) = order(&name, &["jog", "Y", "NaN"]);
    assert_eq!(status, 2, "{printed}");
    let (status, printed) = order(&name, &["jog", "Q", "1"]);
    assert_eq!(status, 2, "{printed}");
    assert!(printed.contains("it has X Y"), "{printed}");
    // Long enough for the orders below, on a machine with other work too.
    obeyed(&["jog", "Y", "-60"], "jogging Y by -60 mm");
    refused(&["resume"], "being jogged");
    refused(&["disable"], "being jogged");
    refused(&["jog", "Y+"], "being jogged");
    obeyed(&["jog", "X", "0.5"], "jogging X by 0.5 mm");
    obeyed(&["hold"], "the jog comes to rest");
    cell.wait_for(|f| f.mode == Mode::Enabled as u32);
    std::thread::sleep(std::time::Duration::from_millis(300));
    obeyed(&["disable"], "drives off");
    refused(&["jog", "X", "1"], "drives are off");
    refused(&["resume"], "drives are off");
    obeyed(&["enable"], "in hold");
    obeyed(&["resume"], "resumed");
    cell.wait_for(|f| !f.tag.is_off_path() && !f.window.is_none());
    obeyed(&["stop"], "comes to rest");
    let run = cell.finish();
    assert_eq!(run.status(), 1, "{}", run.stderr());
    let (status, printed) = order(&name, &["hold"]);
    assert_eq!(status, 1);
    assert!(printed.contains("does not run"), "{printed}");
}

#[test]
fn ctrl_c_in_a_jog_and_with_the_drives_off_ends_in_order() {
    for disabled in [false, true] {
        let bench = Bench::patient("xy", &[]);
        let program = bench.file("long.ngc", &long_program());
        let mut cell = LiveCell::start(bench.path(), &program, "realtime");
        cell.wait_for_scan(500);
        assert_eq!(order(&cell.cell, &["hold"]).0, 0);
        cell.wait_for(|f| f.at_rest == 1);
        std::thread::sleep(std::time::Duration::from_millis(300));
        let words: &[&str] = if disabled {
            &["disable"]
        } else {
            &["jog", "X", "-50"]
        };
        let (status, printed) = order(&cell.cell, words);
        assert_eq!(status, 0, "{printed}");
        std::thread::sleep(std::time::Duration::from_millis(400));
        cell.signal_launcher(libc::SIGINT);
        let run = cell.finish();
        assert_eq!(run.status(), 130, "{}", run.stderr());
        assert_eq!(text(&run.report(), "/outcome/kind"), "interrupted");
        let (feedbacks, _) = log(&run);
        let last = feedbacks.last().expect("a feedback");
        assert!(
            last.axes()
                .iter()
                .all(|axis| axis.velocity_mm_s.abs() < 0.5)
        );
    }
}
