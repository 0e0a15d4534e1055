//! Which windows a servo takes and which it refuses.
#![allow(missing_docs)]

use crate::common::{Rig, machine, refusal, seal, servo};
use bus::sample::{Cause, Setpoint, WindowHeader, WindowId};
use servo::Refusal;

/// A good first window and the rig it belongs to.
fn first() -> (Rig, WindowHeader, Vec<Setpoint>) {
    let mut rig = Rig::new(machine("xy"));
    let (header, setpoints) = rig.make(32);
    (rig, header, setpoints)
}

fn refused(change: impl FnOnce(&mut WindowHeader, &mut Vec<Setpoint>)) -> Refusal {
    let (rig, mut header, mut setpoints) = first();
    change(&mut header, &mut setpoints);
    seal(&mut header, &setpoints);
    refusal(&rig.machine, &header, &setpoints, &rig.feedback())
}

#[test]
fn a_good_window_is_pending_until_feedback_names_it() {
    let (mut rig, header, setpoints) = first();
    let mut servo = servo(&rig.machine, 0);
    assert_eq!(servo.offer(&header, &setpoints, &rig.feedback()), Ok(()));
    let command = servo.scan(&rig.feedback());
    assert_eq!((command.held, command.pending), (WindowId::NONE, header.id));
    rig.scan = 32;
    rig.window = header.id;
    rig.in_force = header;
    let command = servo.scan(&rig.feedback());
    assert_eq!((command.held, command.pending), (header.id, WindowId::NONE));
    assert_eq!(command.cause, Cause::None as u32);
}

#[test]
fn a_void_window_is_dropped() {
    let (mut rig, header, setpoints) = first();
    let mut servo = servo(&rig.machine, 0);
    servo
        .offer(&header, &setpoints, &rig.feedback())
        .expect("good");
    rig.scan = 2;
    let mut feedback = rig.feedback();
    feedback.voided = header.id;
    assert_eq!(servo.scan(&feedback).pending, WindowId::NONE);
}

#[test]
fn a_window_that_was_not_admitted_in_time_is_dropped() {
    let (mut rig, header, setpoints) = first();
    let mut servo = servo(&rig.machine, 0);
    servo
        .offer(&header, &setpoints, &rig.feedback())
        .expect("good");
    rig.scan = header.first_scan;
    assert_eq!(servo.scan(&rig.feedback()).pending, WindowId::NONE);
}

#[test]
fn the_same_window_twice_is_no_news() {
    let (rig, header, setpoints) = first();
    let mut servo = servo(&rig.machine, 0);
    let feedback = rig.feedback();
    assert_eq!(servo.offer(&header, &setpoints, &feedback), Ok(()));
    assert_eq!(servo.offer(&header, &setpoints, &feedback), Ok(()));
    assert_eq!(servo.scan(&feedback).refused, WindowId::NONE);
}

#[test]
fn a_changed_row_is_refused_by_its_checksum() {
    let (rig, header, mut setpoints) = first();
    setpoints[5].position[1] += 1;
    assert_eq!(
        refusal(&rig.machine, &header, &setpoints, &rig.feedback()),
        Refusal::Checksum
    );
}

#[test]
fn setpoint_counts_that_lie_are_refused() {
    assert_eq!(refused(|h, _| h.setpoint_count += 1), Refusal::RowCount);
    assert_eq!(
        refused(|h, _| h.intended_setpoints = h.setpoint_count + 1),
        Refusal::RowCount
    );
    assert_eq!(
        refused(|h, r| {
            r.truncate(1);
            h.setpoint_count = 1;
            h.intended_setpoints = 1
        }),
        Refusal::RowCount
    );
    let most = bus::sample::MAX_WINDOW_SETPOINTS + 1;
    assert_eq!(
        refused(|h, r| {
            r.resize(most, r[0]);
            h.setpoint_count = most as u32
        }),
        Refusal::RowCount
    );
}

#[test]
fn a_window_without_a_name_is_refused() {
    assert_eq!(refused(|h, _| h.id.sequence = 0), Refusal::Unnamed);
    assert_eq!(refused(|h, _| h.id.incarnation = 0), Refusal::Unnamed);
}

#[test]
fn a_window_that_should_have_started_is_refused() {
    let (mut rig, header, setpoints) = first();
    rig.scan = header.first_scan;
    assert_eq!(
        refusal(&rig.machine, &header, &setpoints, &rig.feedback()),
        Refusal::TooLate
    );
}

#[test]
fn a_window_between_period_boundaries_is_refused() {
    assert_eq!(refused(|h, _| h.first_scan += 1), Refusal::OffBoundary);
}

#[test]
fn a_second_pending_window_is_refused() {
    let (mut rig, header, setpoints) = first();
    let mut servo = servo(&rig.machine, 0);
    servo
        .offer(&header, &setpoints, &rig.feedback())
        .expect("good");
    let (other, setpoints) = rig.make(40);
    assert_eq!(
        servo.offer(&other, &setpoints, &rig.feedback()),
        Err(Refusal::OnePending)
    );
    assert_eq!(servo.scan(&rig.feedback()).pending, header.id);
}

#[test]
fn a_window_that_continues_another_one_is_refused() {
    assert_eq!(
        refused(|h, _| h.predecessor.sequence = 7),
        Refusal::Predecessor
    );
}

/// A standby that was started in the middle of a motion: it drives nothing until it holds what is being executed.
#[test]
fn a_servo_that_came_late_takes_the_window_after_the_one_in_force_and_drives_nothing_until_then() {
    let (mut rig, _, _) = first();
    rig.window.sequence = 7;
    let (header, setpoints) = rig.make(32);
    let mut servo = servo(&rig.machine, 0);
    assert_eq!(servo.offer(&header, &setpoints, &rig.feedback()), Ok(()));
    let command = servo.scan(&rig.feedback());
    assert_eq!(command.pending, header.id);
    assert_eq!(command.cause, Cause::WindowMissing as u32);
    assert_eq!(command.velocity_mm_s, 0.0);
}

/// A standby that missed the first window of a new planner while it held the last one of the planner before.
#[test]
fn a_servo_that_holds_an_older_window_takes_the_window_after_the_one_in_force() {
    let (mut rig, header, setpoints) = first();
    let mut servo = servo(&rig.machine, 0);
    assert_eq!(servo.offer(&header, &setpoints, &rig.feedback()), Ok(()));
    rig.scan = 32;
    rig.window = header.id;
    rig.in_force = header;
    assert_eq!(servo.scan(&rig.feedback()).held, header.id);
    rig.window.incarnation += 1;
    let (next, setpoints) = rig.make(64);
    assert_eq!(servo.offer(&next, &setpoints, &rig.feedback()), Ok(()));
    assert_eq!(servo.scan(&rig.feedback()).pending, next.id);
}

#[test]
fn a_window_of_another_epoch_is_refused() {
    assert_eq!(refused(|h, _| h.epoch = 2), Refusal::Epoch);
}

#[test]
fn a_first_window_must_start_at_the_command_position_to_the_increment() {
    let (mut rig, header, setpoints) = first();
    rig.command_position[0] = 1;
    assert_eq!(
        refusal(&rig.machine, &header, &setpoints, &rig.feedback()),
        Refusal::Register
    );
}

#[test]
fn a_row_outside_the_travel_is_refused() {
    let far = |r: &mut Setpoint| r.position[0] = i64::MAX;
    assert_eq!(
        refused(|_, setpoints| far(&mut setpoints[9])),
        Refusal::Travel
    );
    assert_eq!(
        refused(|_, setpoints| setpoints[9].position[0] = -220_000_001),
        Refusal::Travel
    );
}

#[test]
fn a_row_that_jumps_is_refused_as_too_fast() {
    assert_eq!(
        refused(|_, setpoints| for setpoint in &mut setpoints[9..] {
            setpoint.position[0] += 300_000;
        }),
        Refusal::Speed
    );
}

#[test]
fn a_row_that_jerks_is_refused_as_too_much_acceleration() {
    // 5000 mm/s² is 5000 increments per scan².
    assert_eq!(
        refused(|_, setpoints| for setpoint in &mut setpoints[9..] {
            setpoint.position[0] += 6_000;
        }),
        Refusal::Acceleration
    );
    // At the command position, but leaving it with a jerk that the setpoints among themselves do not show.
    let way = |i: usize| [0, 6_000, 8_000][i.min(2)];
    let jerk = |setpoints: &mut Vec<Setpoint>| {
        for (i, setpoint) in setpoints.iter_mut().enumerate() {
            setpoint.position[0] += way(i);
        }
    };
    assert_eq!(
        refused(|_, setpoints| jerk(setpoints)),
        Refusal::Acceleration
    );
}

#[test]
fn a_window_that_does_not_end_at_rest_is_refused() {
    let accelerate = |setpoints: &mut Vec<Setpoint>| {
        for (i, setpoint) in setpoints.iter_mut().enumerate() {
            setpoint.position[0] = 2_000 * (i * i) as i64;
        }
    };
    assert_eq!(
        refused(|_, setpoints| accelerate(setpoints)),
        Refusal::NotAtRest
    );
}

#[test]
fn the_seam_with_the_predecessor_is_judged_for_speed_and_acceleration() {
    for (shift, expected) in [(6_000, Refusal::Acceleration), (300_000, Refusal::Speed)] {
        let mut rig = Rig::new(machine("xy"));
        rig.run_to(160);
        let feedback = rig.feedback();
        let (mut header, mut setpoints) = rig.make(168);
        for setpoint in &mut setpoints {
            setpoint.position[0] += shift;
        }
        seal(&mut header, &setpoints);
        assert_eq!(
            rig.servos[0].offer(&header, &setpoints, &feedback),
            Err(expected)
        );
    }
}

#[test]
fn a_servo_that_does_not_hold_the_named_window_drives_nothing_and_says_so() {
    let mut rig = Rig::new(machine("xy"));
    rig.run_to(160);
    let mut late = servo(&rig.machine, 0);
    let command = late.scan(&rig.feedback());
    assert_eq!(command.cause, Cause::WindowMissing as u32);
    assert_eq!((command.velocity_mm_s, command.torque_nm), (0.0, 0.0));
}
