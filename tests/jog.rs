//! The sender of a continuous jog is killed, stopped or interrupted: the axis comes to rest, and nothing that it asked for acts later.

use std::process::{Child, Output, Stdio};

use bus::sample::{Cause, Feedback, Mode, ProgramState};

use crate::support::{LiveCell, quadrant, send};
use crate::up::{ask, is, obeyed, refused, up};

const SPEED_MM_S: f64 = 20.0;
/// 200 ms of scans, four until an order is looked at, and what is looked ahead before an axis brakes.
const SILENT_SCANS: f64 = 200.0 + 4.0 + 130.0;
/// A fifth of 5000 mm/s².
const BRAKING_MM_S2: f64 = 1000.0;

fn x_mm(feedback: &Feedback) -> f64 {
    feedback.axes[0].command_position as f64 * 1e-6
}

fn sender(cell: &LiveCell) -> Child {
    let speed = (SPEED_MM_S * 60.0).to_string();
    quadrant()
        .args(["jog", "X+", "--speed", &speed, "--cell", &cell.cell])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("a sender")
}

/// A sender whose axis moves. On a PC that gives it no time for 0.2 s its jog ends, as it is to: then there is another one.
fn moving(cell: &mut LiveCell) -> Child {
    loop {
        let mut sender = sender(cell);
        let from_mm = x_mm(&cell.wait_for(|_| true));
        let jogs = |f: &Feedback| f.mode == Mode::Jogging as u32;
        loop {
            let now = cell.wait_for(|_| true);
            if jogs(&now) && x_mm(&now) > from_mm + 0.2 {
                return sender;
            }
            if sender.try_wait().expect("the sender").is_some() {
                break;
            }
        }
    }
}

fn rest(cell: &mut LiveCell) -> Feedback {
    cell.wait_for(|f| is(f, Mode::Ready, ProgramState::None))
}

fn printed(sender: Child) -> (i32, String) {
    let Output {
        status,
        stdout,
        stderr,
    } = sender.wait_with_output().expect("its end");
    let text = String::from_utf8_lossy(&[stdout, stderr].concat()).into_owned();
    (status.code().unwrap_or(-1), text)
}

/// Nothing moves any more.
fn stays(cell: &mut LiveCell, rest: &Feedback) {
    let later = cell.wait_for_scan(rest.scan + 600);
    assert_eq!(x_mm(&later), x_mm(rest));
    assert!(is(&later, Mode::Ready, ProgramState::None));
}

#[test]
fn a_jog_whose_sender_is_killed_or_stopped_comes_to_rest_and_stays_there() {
    let (_bench, mut cell, ..) = up("realtime");
    obeyed(&cell, &["enable"]);
    for signal in [libc::SIGKILL, libc::SIGSTOP] {
        let jogging = moving(&mut cell);
        send(jogging.id() as i32, signal);
        let at = cell.wait_for(|_| true);
        let rest = rest(&mut cell);
        let braking_mm = SPEED_MM_S * SPEED_MM_S / (2.0 * BRAKING_MM_S2);
        let most_mm = SPEED_MM_S * 1e-3 * SILENT_SCANS + braking_mm + 0.01;
        let way_mm = x_mm(&rest) - x_mm(&at);
        assert!(
            way_mm <= most_mm,
            "{way_mm} mm after its death, of {most_mm}"
        );
        send(jogging.id() as i32, libc::SIGCONT);
        let (status, text) = printed(jogging);
        if signal == libc::SIGSTOP {
            assert_eq!(status, 1, "{text}");
            assert!(text.contains("not renewed in time"), "{text}");
        }
        stays(&mut cell, &rest);
    }
    obeyed(&cell, &["down"]);
}

#[test]
fn control_c_ends_a_jog_well_and_hold_ends_it_from_elsewhere() {
    let (_bench, mut cell, ..) = up("realtime");
    obeyed(&cell, &["enable"]);
    let jogging = moving(&mut cell);
    send(jogging.id() as i32, libc::SIGINT);
    let (_, text) = printed(jogging);
    assert!(text.contains("X is at rest at"), "{text}");
    let at = rest(&mut cell);
    stays(&mut cell, &at);

    let jogging = moving(&mut cell);
    obeyed(&cell, &["hold"]);
    let (status, text) = printed(jogging);
    assert_eq!(status, 1, "{text}");
    assert!(text.contains("X is at rest at"), "{text}");
    obeyed(&cell, &["resume"]);
    obeyed(&cell, &["down"]);
}

#[test]
fn a_jog_by_a_distance_has_a_speed_and_bad_ones_are_refused() {
    let (_bench, cell, ..) = up("lockstep");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["jog", "X", "3", "--speed", "3000", "--wait"]);
    refused(
        &cell,
        &["jog", "X", "3", "--speed", "20000"],
        "to 15000 mm/min",
    );
    for (words, why) in [
        (vec!["jog", "X"], "how far?"),
        (vec!["jog", "X+", "5"], "has no distance"),
        (vec!["jog", "Q+"], "it has X Y"),
        (vec!["jog", "X+", "--speed", "0"], "above 0 mm/min"),
        (vec!["jog", "X", "1", "--speed", "-5"], "above 0 mm/min"),
    ] {
        let printed = ask(&cell, &words);
        assert_eq!(printed.status, 2, "{words:?}: {}", printed.text);
        assert!(printed.text.contains(why), "{words:?}: {}", printed.text);
    }
    obeyed(&cell, &["down"]);
}

#[test]
fn an_emergency_stop_trips_a_running_program_and_enable_takes_it_back() {
    let (_bench, mut cell, _, long) = up("realtime");
    obeyed(&cell, &["estop"]);
    let off = cell.wait_for(|f| f.cause == Cause::EmergencyStop as u32);
    assert!(is(&off, Mode::Disabled, ProgramState::None));
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["estop"]);
    cell.wait_for(|f| is(f, Mode::Tripped, ProgramState::Loaded));
    refused(&cell, &["start"], "has tripped");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|f| f.axes[1].velocity_mm_s.abs() > 10.0);
    let printed = obeyed(&cell, &["estop"]);
    assert!(printed.contains("enable ends it"), "{printed}");
    let tripped = cell.wait_for(|f| f.mode == Mode::Tripped as u32);
    assert_eq!(tripped.cause, Cause::EmergencyStop as u32);
    refused(&cell, &["resume"], "has tripped");
    obeyed(&cell, &["estop"]);
    obeyed(&cell, &["enable"]);
    cell.wait_for(|f| is(f, Mode::Enabled, ProgramState::Running) && f.hold == 1);
    let status = ask(&cell, &["status"]);
    assert_eq!(status.status, 0, "{}", status.text);
    obeyed(&cell, &["down"]);
}
