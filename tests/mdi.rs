//! Typed-in blocks: run, keep their modes, leave the program loaded, and are refused where they must be.

use bus::sample::{Feedback, Mode, ProgramState};

use crate::up::{ask, is, obeyed, refused, up};

fn x_nm(feedback: &Feedback) -> i64 {
    feedback.axes[0].command_position
}

#[test]
fn blocks_run_one_after_another_with_the_modes_of_those_before_and_the_program_stays_loaded() {
    let (_bench, mut cell, short, _) = up("lockstep");
    refused(&cell, &["mdi", "G0 X1"], "the drives are off");
    obeyed(&cell, &["enable"]);
    let from = x_nm(&cell.wait_for(|f| f.mode == Mode::Ready as u32));
    obeyed(&cell, &["mdi", "G91 G1 X2 F3000"]);
    let first = cell.wait_for(|f| f.mode == Mode::Ready as u32);
    assert_eq!(x_nm(&first) - from, 2_000_000);
    // Incremental, a line and its feed: all as before.
    obeyed(&cell, &["mdi", "X3"]);
    let second = cell.wait_for(|f| f.mode == Mode::Ready as u32);
    assert_eq!(x_nm(&second) - from, 5_000_000);
    obeyed(&cell, &["load", &short]);
    obeyed(&cell, &["mdi", "G20", "G90 G0 X1"]);
    let inch = cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Loaded));
    assert_eq!(x_nm(&inch), 25_400_000);
    obeyed(&cell, &["mdi", "X0"]);
    obeyed(&cell, &["start", "--wait"]);
    let status = ask(&cell, &["status"]);
    assert!(status.text.contains("short.ngc"), "{}", status.text);
    obeyed(&cell, &["down"]);
}

#[test]
fn a_wrong_block_moves_nothing_and_says_where_it_is_wrong() {
    let (_bench, mut cell, ..) = up("lockstep");
    obeyed(&cell, &["enable"]);
    let before = cell.wait_for(|f| f.mode == Mode::Ready as u32);
    for (blocks, why) in [
        (vec!["G0 X10", "G1 X5 F0 Q"], "mdi:2"),
        (vec!["G0 X9999"], "X"),
        (vec![" "], "no block"),
    ] {
        let mut words = vec!["mdi"];
        words.extend(&blocks);
        let printed = ask(&cell, &words);
        assert_eq!(printed.status, 2, "{blocks:?}: {}", printed.text);
        assert!(printed.text.contains(why), "{blocks:?}: {}", printed.text);
        assert!(!printed.text.contains("/dev/shm"), "{}", printed.text);
        assert!(!printed.text.contains("5 | "), "{}", printed.text);
    }
    let after = cell.wait_for(|f| f.scan > before.scan + 100);
    assert_eq!((x_nm(&after), after.run), (x_nm(&before), 0));
    obeyed(&cell, &["down"]);
}

#[test]
fn a_block_is_refused_beside_a_program_that_runs_or_is_held_and_can_be_held_itself() {
    let (_bench, mut cell, _, long) = up("realtime");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["start"]);
    refused(&cell, &["mdi", "G0 X1"], "a program is running");
    obeyed(&cell, &["stop"]);
    let stopped = cell.wait_for(|f| f.mode == Mode::Stopped as u32);
    refused(&cell, &["mdi", "G0 X1"], "a program is running");
    assert_eq!(cell.wait_for(|_| true).load, stopped.load);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["mdi", "--no-wait", "G4 P30"]);
    obeyed(&cell, &["hold"]);
    obeyed(&cell, &["resume"]);
    obeyed(&cell, &["stop"]);
    cell.wait_for(|f| f.mode == Mode::Stopped as u32);
    obeyed(&cell, &["down"]);
}
