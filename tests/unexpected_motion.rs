//! What must not move by itself: a machine after a stall, an axis outside its travel.

use bus::sample::{Cause, Feedback, Mode, ProgramState};

use crate::support::{Bench, LiveCell, send};
use crate::up::{down, is, obeyed, refused, up_on};

fn rests(feedback: &Feedback) -> bool {
    feedback
        .axes()
        .iter()
        .all(|axis| axis.velocity_mm_s.abs() < 0.5)
}

/// Stalled for twice its watchdog, which is a second here so that no busy PC does that by chance, the master finds drives that have braked by themselves.
#[test]
fn a_machine_that_was_frozen_in_an_arc_trips_and_goes_on_only_when_somebody_says_so() {
    let bench = Bench::patient("xy", &[]);
    let (_bench, mut cell, short, _) = up_on(bench, "realtime");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &short]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 10.0);
    let master = cell.pid_of("quadrant plant-sim");
    send(master, libc::SIGSTOP);
    std::thread::sleep(std::time::Duration::from_secs(2));
    send(master, libc::SIGCONT);
    let tripped = cell.wait_for(|f| f.mode == Mode::Tripped as u32);
    assert_eq!(Cause::from_wire(tripped.cause), Some(Cause::Stalled));
    let later = cell.wait_for_scan(tripped.scan + 500);
    assert_eq!(later.mode, Mode::Tripped as u32);
    assert!(rests(&later));
    refused(&cell, &["resume"], "tripped");
    obeyed(&cell, &["enable"]);
    let held = cell.wait_for(|f| f.mode == Mode::Enabled as u32);
    assert_eq!(held.hold, 1);
    let later = cell.wait_for_scan(held.scan + 300);
    assert!(rests(&later), "nothing moves before somebody resumes");
    obeyed(&cell, &["resume"]);
    cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Done));
    down(cell);
}

#[test]
fn an_axis_outside_its_travel_is_jogged_inwards_step_by_step_and_then_takes_its_program() {
    let bench = Bench::of("xy", &[("travel_min_mm = -220.0", "travel_min_mm = 1.0")]);
    let program = "G21 G17 G90 G94\nG1 X6 Y2 F3000\nM2\n";
    let program = bench.file("inside.ngc", program).display().to_string();
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &program]);
    refused(&cell, &["start"], "outside its travel: jog it inwards");
    refused(&cell, &["jog", "X", "-0.5"], "travel");
    for (distance, at_mm) in [("0.4", 0.4), ("1.6", 2.0)] {
        obeyed(&cell, &["jog", "X", distance, "--wait"]);
        let there = cell.wait_for(|f| f.mode == Mode::Ready as u32);
        let mm = there.axes[0].command_position as f64 * 1e-6;
        assert!((mm - at_mm).abs() < 0.05, "X {mm}: {at_mm}");
    }
    obeyed(&cell, &["start", "--wait"]);
    down(cell);
}

/// Lost motion that is found to lie on the other side puts the axis some µm beyond the end that it has moved to.
#[test]
fn from_both_ends_of_its_travel_an_axis_is_jogged_in_and_blocks_and_programs_go_on() {
    let bench = Bench::of("xyz-mill", &[]);
    let program = bench.file("inside.ngc", "G21 G90 G94\nG53 G1 X9 F6000\nM2\n");
    let program = program.display().to_string();
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    for (end, inwards) in [("0", "0.12"), ("500", "-0.12")] {
        obeyed(&cell, &["mdi", &format!("G90 G53 G0 X{end}")]);
        obeyed(&cell, &["jog", "X", inwards, "--wait"]);
        let back = inwards.parse::<f64>().expect("a way") / -2.0;
        obeyed(&cell, &["jog", "X", &back.to_string(), "--wait"]);
        obeyed(&cell, &["mdi", &format!("G91 G1 X{inwards} F600")]);
        obeyed(&cell, &["load", &program]);
        obeyed(&cell, &["start", "--wait"]);
    }
    down(cell);
}
