//! Each guard, by name, and how a stop is held.
#![allow(missing_docs)]

use crate::common::{Rig, machine, servo};
use bus::sample::{AxisCommand, Cause, Feedback, Mode};
use machine::Machine;

/// The command after two quiet scans and a third with this change.
fn after(machine: &Machine, change: impl FnOnce(&mut Feedback)) -> AxisCommand {
    let mut servo = servo(machine, 0);
    let mut rig = Rig::new(machine.clone());
    for _ in 0..2 {
        assert_eq!(servo.scan(&rig.feedback()).cause, Cause::None as u32);
        rig.scan += 1;
    }
    let mut feedback = rig.feedback();
    change(&mut feedback);
    servo.scan(&feedback)
}

fn stops_with(cause: Cause, change: impl FnOnce(&mut Feedback)) {
    let command = after(&machine("xy"), change);
    assert_eq!(Cause::from_wire(command.cause), Some(cause));
    assert_eq!((command.velocity_mm_s, command.torque_nm), (0.0, 0.0));
    assert!(command.following_error_mm.is_finite() && command.feed_forward_mm_s.is_finite());
}

#[test]
fn a_following_error_beyond_its_limit() {
    stops_with(Cause::FollowingError, |f| {
        f.axes[0].motor_position = 2_000_001
    });
    let command = after(&machine("xy"), |f| f.axes[0].motor_position = 2_000_000);
    assert_eq!(command.cause, Cause::None as u32);
    assert_eq!(command.velocity_mm_s, -100.0);
}

#[test]
fn a_command_outside_the_travel() {
    stops_with(Cause::SoftLimit, |f| {
        f.axes[0].command_position = 220_000_001;
        f.axes[0].motor_position = 220_000_000;
    });
}

#[test]
fn an_axis_outside_the_travel() {
    stops_with(Cause::SoftLimit, |f| {
        f.axes[0].command_position = -220_000_000;
        f.axes[0].motor_position = -220_500_001;
    });
}

#[test]
fn a_speed_command_beyond_the_limit() {
    let mut machine = machine("xy");
    machine.axes[0].following_error_limit_mm = 10.0;
    let command = after(&machine, |f| f.axes[0].motor_position = -6_100_000);
    assert_eq!(Cause::from_wire(command.cause), Some(Cause::SpeedLimit));
    assert_eq!(command.velocity_mm_s, 0.0);
}

#[test]
fn a_value_that_is_not_a_number() {
    stops_with(Cause::BadValue, |f| f.axes[0].velocity_mm_s = f64::NAN);
    stops_with(Cause::BadValue, |f| f.axes[0].torque_nm = f64::INFINITY);
    stops_with(Cause::BadValue, |f| {
        f.axes[0].velocity_command_mm_s = f64::NAN
    });
}

#[test]
fn positions_at_the_ends_of_their_type() {
    stops_with(Cause::FollowingError, |f| {
        f.axes[0].motor_position = i64::MIN
    });
    stops_with(Cause::FollowingError, |f| {
        f.axes[0].motor_position = i64::MIN;
        f.axes[0].command_position = i64::MAX;
    });
}

#[test]
fn a_feedback_that_makes_no_sense() {
    stops_with(Cause::BadFeedback, |f| f.scan = 2);
    stops_with(Cause::BadFeedback, |f| f.mode = 99);
    stops_with(Cause::BadFeedback, |f| f.axis_count = 3);
    stops_with(Cause::BadFeedback, |f| f.visible_from = f.scan + 1);
}

#[test]
fn a_row_the_window_does_not_have() {
    let mut rig = Rig::new(machine("xy"));
    rig.run_to(160);
    let mut feedback = rig.feedback();
    feedback.setpoint = rig.in_force.setpoint_count;
    assert_eq!(
        rig.servos[0].scan(&feedback).cause,
        Cause::BadFeedback as u32
    );
}

#[test]
fn torque_at_its_limit_for_too_long() {
    for name in ["xy", "xy-torque"] {
        let mut machine = machine(name);
        machine.axes[0].following_error_limit_mm = 90.0;
        let mut servo = servo(&machine, 0);
        let mut rig = Rig::new(machine);
        let mut scans = 0;
        let cause = loop {
            // Blocked 4 mm away (torque mode: 80 N·m wanted); the drive reports it in velocity mode.
            let mut feedback = rig.feedback();
            feedback.axes[0].motor_position = -4_000_000;
            feedback.axes[0].torque_limited = 1;
            let command = servo.scan(&feedback);
            assert!(command.torque_nm.abs() <= 32.0);
            if command.cause != 0 {
                break command.cause;
            }
            rig.scan += 1;
            scans += 1;
        };
        assert_eq!(Cause::from_wire(cause), Some(Cause::TorqueLimit));
        let limit_s = f64::from(scans) * rig.machine.scan_period_s();
        assert!((0.19..0.21).contains(&limit_s), "{name}: {limit_s}");
    }
}

#[test]
fn a_stop_is_held_until_the_master_has_taken_notice() {
    let mut servo = servo(&machine("xy"), 0);
    let mut rig = Rig::new(machine("xy"));
    servo.scan(&rig.feedback());
    rig.scan = 2;
    rig.position[0] = 3_000_000;
    assert_eq!(
        servo.scan(&rig.feedback()).cause,
        Cause::FollowingError as u32
    );
    rig.scan = 3;
    rig.position[0] = 0;
    let held = servo.scan(&rig.feedback());
    assert_eq!(
        (held.cause, held.velocity_mm_s),
        (Cause::FollowingError as u32, 0.0)
    );
    rig.scan = 4;
    rig.mode = Mode::Tripped;
    assert_eq!(servo.scan(&rig.feedback()).cause, Cause::None as u32);
}

#[test]
fn a_pushed_axis_is_followed_and_closing_the_loop_steps_by_nothing() {
    // docs/methods/overview.md §6. The command position in feedback follows the encoder while the loop is open.
    for name in ["xy", "xy-torque"] {
        let mut rig = Rig::new(machine(name));
        // Into the circle, so that every part of the state is something.
        rig.run_to(900);
        rig.window = bus::sample::WindowId::NONE;
        rig.pending = None;
        let mut servo = rig.servos[0].clone();
        rig.mode = Mode::Disabled;
        let mut position = rig.position[0];
        for push in 0..500 {
            position += (push * 7919) % 20_000 - 7_000;
            rig.position[0] = position;
            rig.command_position[0] = position;
            let command = servo.scan(&rig.feedback());
            assert_eq!(
                (command.position, command.velocity_mm_s, command.torque_nm),
                (position, 0.0, 0.0)
            );
            rig.scan += 1;
        }
        rig.mode = Mode::Stopped;
        for _ in 0..20 {
            let command = servo.scan(&rig.feedback());
            assert_eq!((command.cause, command.position), (0, position));
            assert_eq!((command.velocity_mm_s, command.torque_nm), (0.0, 0.0));
            rig.scan += 1;
        }
    }
}
