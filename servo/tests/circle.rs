//! A servo on a circle: what it remembers, when its friction pulses start, how it would stop.
#![allow(missing_docs)]

use crate::common::{RADIUS_MM, Rig, SPEED_MM_S, machine, servo};
use bus::sample::{AxisCommand, Mode};
use bytemuck::{Zeroable, bytes_of};
use loops::reversal::{Announcement, ReversalState};
use machine::{Prediction, PulseShape, WithinPeriod};
use servo::ServoState;

fn reversal(command: &AxisCommand) -> ReversalState {
    ServoState::of(command).reversal
}

/// A command with what names its maker taken out.
fn anonymous(mut command: AxisCommand) -> AxisCommand {
    command.incarnation = 0;
    command.role = 0;
    command.refused = bus::sample::WindowId::NONE;
    command
}

#[test]
fn a_standby_that_is_given_the_state_goes_on_to_the_bit_from_any_scan() {
    let (exact, even) = (WithinPeriod::Exact, WithinPeriod::Linear);
    let ahead = Some(Prediction { m: 0.4 });
    for (name, shape, setpoints, prediction) in [
        ("xy", PulseShape::Decaying, exact, None),
        ("xy", PulseShape::Constant, exact, None),
        ("xy", PulseShape::Constant, even, ahead),
        ("xy-fast", PulseShape::Decaying, exact, None),
        ("xy-torque", PulseShape::Decaying, exact, ahead),
    ] {
        let mut machine = machine(name);
        machine.interpolation.within_period = setpoints;
        for axis in &mut machine.axes {
            axis.reversal.shape = shape;
            axis.prediction = prediction;
        }
        let mut rig = Rig::new(machine.clone());
        // Holds the windows and nothing else: its state is replaced before each scan.
        let mut standby = servo(&machine, 1);
        let revolution_s = 2.0 * std::f64::consts::PI * RADIUS_MM / SPEED_MM_S;
        let scans = (1.3 * revolution_s / machine.scan_period_s()) as u64;
        let (mut states, mut pulsing) = (0, 0);
        for _ in 0..scans {
            let before = rig.servos[1].state;
            let mut command = AxisCommand::zeroed();
            rig.step(|feedback, offered| {
                if let Some((header, setpoints)) = offered {
                    standby.offer(header, setpoints, feedback).expect("good");
                }
                standby.state = before;
                command = standby.scan(feedback);
            });
            assert!(
                bytes_of(&anonymous(command)) == bytes_of(&anonymous(rig.commands[1])),
                "{name} scan {}: {command:#?}\n{:#?}",
                rig.scan - 1,
                rig.commands[1]
            );
            let reversal = reversal(&command);
            states |= 1 << reversal.announcement;
            pulsing += u32::from(reversal.pulse_remaining_scans > 0);
        }
        // The comparison is worth something only if there was something to carry.
        assert!(reversal(&rig.commands[1]).pulses >= 2, "{name}");
        assert!(
            pulsing >= 10,
            "{name}: {pulsing} scans with a pulse running"
        );
        assert_eq!(
            states & 0b111,
            0b111,
            "{name}: announced and answered reversals were seen"
        );
    }
}

#[test]
fn a_standby_that_came_late_takes_the_window_in_force_and_goes_on_to_the_bit() {
    let machine = machine("xy");
    let mut rig = Rig::new(machine.clone());
    let mut late = servo(&machine, 0);
    for _ in 0..1200 {
        let before = rig.servos[0].state;
        let joined = rig.scan >= 304;
        let last = rig.last_window.clone();
        let mut command = AxisCommand::zeroed();
        rig.step(|feedback, offered| {
            if feedback.scan == 304 {
                // What the service keeps for those who come late: the window in force since this scan.
                assert_eq!(late.offer(&last.0, &last.1, feedback), Ok(()));
            }
            if let Some((header, setpoints)) = offered.as_ref().filter(|_| joined) {
                let _ = late.offer(header, setpoints, feedback);
            }
            late.state = before;
            command = late.scan(feedback);
        });
        if joined {
            assert!(
                bytes_of(&anonymous(command)) == bytes_of(&anonymous(rig.commands[0])),
                "scan {}",
                rig.scan - 1
            );
        }
    }
}

#[test]
fn each_pulse_starts_its_lead_before_the_setpoints_reverse() {
    for name in ["xy", "xy-fast"] {
        let machine = machine(name);
        let scan_s = machine.scan_period_s();
        let lead_s = machine.axes[0].reversal.lead_ms * 1e-3;
        let mut rig = Rig::new(machine);
        let mut started = Vec::new();
        let mut reversed = Vec::new();
        let scans = (2.0 / scan_s) as u64;
        for _ in 0..scans {
            let before = rig.commands;
            rig.step(|_, _| ());
            for (axis, (was, is)) in before.iter().zip(&rig.commands).enumerate() {
                let (was, is) = (ServoState::of(was), ServoState::of(is));
                if is.reversal.pulses > was.reversal.pulses {
                    started.push((axis, rig.scan - 1));
                }
                let (was, is) = (was.backlash.direction, is.backlash.direction);
                if was != 0 && is != was {
                    // The command reversed between the setpoint before and this one.
                    reversed.push((axis, rig.scan - 1));
                }
            }
        }
        assert!(reversed.len() >= 4, "{name}: {reversed:?}");
        for ((axis, pulse), (of, turn)) in started.iter().zip(&reversed) {
            assert_eq!(axis, of);
            let found_s = (*turn as f64 - 1.0 - *pulse as f64) * scan_s;
            assert!(
                found_s <= lead_s && found_s > lead_s - 3.0 * scan_s,
                "{name}: {found_s}"
            );
        }
    }
}

#[test]
fn an_announced_pulse_is_forgotten_when_the_windows_no_longer_reverse() {
    let mut rig = Rig::new(machine("xy"));
    // Until a reversal of either axis is announced, then the planner falls silent: the tail ends before the reversal.
    let announced = loop {
        rig.step(|_, _| ());
        assert!(rig.scan < 5_000);
        if let Some(axis) =
            (0..2).find(|a| reversal(&rig.commands[*a]).announcement() == Announcement::Ahead)
        {
            break axis;
        }
    };
    let pulses = reversal(&rig.commands[announced]).pulses;
    // The master drops the future: no window, the command position stays.
    rig.window = bus::sample::WindowId::NONE;
    rig.pending = None;
    rig.publishing = false;
    rig.mode = Mode::Stopped;
    for _ in 0..40 {
        rig.step(|_, _| ());
    }
    let state = reversal(&rig.commands[announced]);
    assert_eq!(
        (state.announcement(), state.pulses, state.pulse_mm_s),
        (Announcement::None, pulses, 0.0)
    );
    assert_eq!(rig.commands[announced].feed_forward_mm_s, 0.0);
}

#[test]
fn a_silent_planner_ends_in_rest_with_nothing_left_over() {
    let mut rig = Rig::new(machine("xy"));
    rig.run_to(700);
    rig.publishing = false;
    rig.run_to(2_000);
    for command in &rig.commands {
        assert_eq!(command.feed_forward_mm_s, 0.0);
        assert_eq!(command.friction_pulse_mm_s, 0.0);
        assert!(command.velocity_mm_s.abs() < 1e-3, "{command:?}");
    }
}

#[test]
fn the_axes_would_stop_together() {
    let mut machine = machine("xy");
    machine.axes[1].quick_stop_mm_s2 = 6000.0;
    let mut rig = Rig::new(machine);
    rig.run_to(500);
    for _ in 0..1_000 {
        let was = rig.feedback();
        let now = was.setpoint as usize;
        let setpoints = rig.last_window.1.clone();
        rig.step(|_, _| ());
        if rig.last_window.0.id != was.window || now + 1 >= setpoints.len() {
            continue;
        }
        let speed = |axis: usize| {
            (setpoints[now + 1].position[axis] - setpoints[now].position[axis]).abs() as f64 * 1e-3
        };
        let time = |axis: usize| speed(axis) / rig.commands[axis].stop_deceleration_mm_s2;
        if speed(0) > 0.0 && speed(1) > 0.0 {
            assert!((time(0) - time(1)).abs() < 1e-12);
            assert!(rig.commands[0].stop_deceleration_mm_s2 <= 12_000.0 + 1e-6);
            assert!(rig.commands[1].stop_deceleration_mm_s2 <= 6_000.0 + 1e-6);
        }
    }
}

#[test]
fn the_feed_forward_leaves_little_following_error_to_the_position_loop() {
    let mut machine = machine("xy");
    for axis in &mut machine.axes {
        // Axes without mass: transport, hold and centring only.
        axis.feed_forward.advance_ms = 2.5;
        axis.reversal.method = machine::ReversalMethod::None;
    }
    let mut rig = Rig::new(machine);
    rig.run_to(800);
    for _ in 0..800 {
        rig.step(|_, _| ());
        for command in &rig.commands {
            // Radius error of v²/R · 0.5 scan / Kp at most.
            assert!(
                command.following_error_mm.abs() < 0.06,
                "{}",
                command.following_error_mm
            );
        }
    }
}

#[test]
fn interpolated_setpoints_meet_the_windows_at_every_period_end_and_when_they_come_to_rest() {
    let mut machine = machine("xy");
    machine.interpolation.within_period = WithinPeriod::Linear;
    let mut rig = Rig::new(machine);
    let period = rig.period();
    let (mut ends, mut longest, mut windows) = (0, 0, Vec::new());
    for scan in 1..2_000 {
        rig.publishing = scan < 1_200;
        let was = rig.feedback();
        let before = rig.command_position[0];
        rig.step(|_, offered| windows.extend(offered.clone()));
        windows.retain(|(header, _)| header.id.sequence + 2 >= was.window.sequence);
        let Some((header, setpoints)) = windows.iter().find(|w| w.0.id == was.window) else {
            continue;
        };
        let setpoint = setpoints[was.setpoint as usize].position[0];
        let commanded = rig.commands[0].position;
        let at_rest = was.setpoint + 1 >= header.setpoint_count;
        if (was.scan + 1).is_multiple_of(period) || at_rest {
            ends += 1;
            assert_eq!(commanded, setpoint, "scan {}", was.scan);
        }
        if (300..1_200).contains(&scan) {
            longest = longest.max((commanded - setpoint).abs());
        }
        assert!((commanded - before).abs() <= rig.machine.axes[0].rapid_mm_s as i64 * 1_000);
    }
    assert!(ends > 100, "{ends}");
    // At feed: a chord of 0.4 mm on R10 has 2 µm of sagitta.
    assert!((1_500..2_100).contains(&longest), "{longest} nm");
}
