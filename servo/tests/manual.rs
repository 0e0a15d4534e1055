//! The second controller of an axis: jogs, switches, and another servo that goes on from its state.
#![allow(missing_docs)]

use crate::common::{Rig, machine, servo};
use bus::sample::{AxisCommand, Cause, Driver, Feedback, Hand, Mode};
use loops::hand_course::{Aim, HandCourse, fine};
use loops::jog::JogProfile;
use machine::Changeover;
use servo::{Servo, ServoState};

/// One axis that does what it is commanded, a scan later.
struct Axis {
    rig: Rig,
    servo: Servo,
    command: AxisCommand,
    driver: Driver,
    course: HandCourse,
    /// What the servo has not been told yet.
    aim: Option<i64>,
    blocked: bool,
}

impl Axis {
    fn new(changeover: Changeover) -> Axis {
        let mut machine = machine("xy");
        machine.axes[0].changeover = changeover;
        Axis {
            servo: servo(&machine, 0),
            rig: Rig::new(machine),
            command: AxisCommand::default(),
            driver: Driver::Program,
            course: HandCourse::at(0),
            aim: None,
            blocked: false,
        }
    }

    fn feedback(&self) -> Feedback {
        let mut feedback = self.rig.feedback();
        feedback.axes[0].driver = self.driver as u32;
        feedback.axes[0].hand = bytemuck::cast(self.course);
        feedback.axes[0].velocity_command_mm_s = self.command.velocity_mm_s;
        feedback
    }

    fn scan(&mut self) -> AxisCommand {
        let feedback = self.feedback();
        let before = self.command;
        self.command = self.servo.scan(&feedback);
        if self.driver == Driver::Manual {
            self.step_course();
        }
        self.rig.command_position[0] = self.command.position;
        if !self.blocked {
            self.rig.position[0] += libm::round(before.velocity_mm_s * 1e3) as i64;
        }
        self.rig.scan += 1;
        self.command
    }

    /// The course is stepped beside the servo, which must be where it is.
    fn step_course(&mut self) {
        self.course = self.course.advanced();
        assert_eq!(self.command.position, self.course.place());
        let follows = Hand::from_wire(self.command.hand) >= Hand::Follows;
        if let Some(goal) = self.aim.take_if(|_| follows) {
            let step_max = 10_000 * fine(1);
            let goal = fine(goal);
            let scans = self.command.ahead_scans + 1;
            self.course.change(Aim { goal, step_max }, scans);
        }
    }

    fn is_done(&self) -> bool {
        self.aim.is_none()
            && self.course.rests()
            && Hand::from_wire(self.command.hand) == Hand::Settled
    }

    /// What the motor stands from the table's place, in increments.
    fn compensation(&self) -> i64 {
        libm::round(self.command.compensation_mm * 1e6) as i64
    }

    fn jog(&mut self, distance: i64) {
        self.rig.mode = Mode::Jogging;
        self.driver = Driver::Manual;
        self.course = HandCourse::at(self.rig.command_position[0]);
        let limits = JogProfile::new(1, 400 * fine(1), None);
        self.course.limit(&limits);
        self.aim = Some(self.rig.command_position[0] + distance);
    }

    /// Command position less error is the encoder in every scan.
    fn until_done(&mut self) {
        for _ in 0..20_000 {
            let seen = self.rig.position[0];
            let command = self.scan();
            let state = ServoState::of(&command);
            assert_eq!(command.position - seen, state.program.error);
            if self.is_done() {
                self.driver = Driver::Program;
                self.rig.mode = Mode::Enabled;
                return;
            }
            assert_eq!(self.command.cause, 0, "scan {}", self.rig.scan);
        }
        panic!("the jog never ends");
    }
}

#[test]
fn a_jog_moves_command_and_axis_by_its_distance_and_no_switch_steps() {
    for changeover in [Changeover::SettledDeviation, Changeover::ReturnToStand] {
        let mut axis = Axis::new(changeover);
        // The motor stands a little off its command, as friction lets it.
        axis.rig.position[0] = 40;
        axis.scan();
        for distance in [3_000_000, -1_234_567, 10, -3_000_000] {
            let command_position = axis.rig.command_position[0];
            let before = axis.command.velocity_mm_s;
            axis.jog(distance);
            assert!((axis.scan().velocity_mm_s - before).abs() < 1e-12);
            axis.until_done();
            let table = axis.rig.position[0] - axis.compensation();
            let commanded = axis.rig.command_position[0] - command_position;
            assert_eq!(commanded, distance);
            let off = table - axis.rig.command_position[0];
            assert!(off.abs() <= 100, "{distance}: {off}");
            let before = axis.command.velocity_mm_s;
            assert!((axis.scan().velocity_mm_s - before).abs() < 1e-12);
            for _ in 0..500 {
                axis.scan();
            }
        }
    }
}

#[test]
fn ordered_to_stop_it_comes_to_rest_on_the_way() {
    let mut axis = Axis::new(Changeover::SettledDeviation);
    axis.scan();
    axis.jog(50_000_000);
    for _ in 0..500 {
        axis.scan();
    }
    let scans = axis.command.ahead_scans + 1;
    axis.course.stop(scans);
    let target = axis.course.target();
    axis.until_done();
    let moved = axis.rig.position[0] - axis.compensation();
    assert!(moved > 1_000_000 && moved < 10_000_000, "{moved}");
    assert_eq!(axis.rig.command_position[0], target);
    assert!((target - moved).abs() <= 100, "{target} {moved}");
}

#[test]
fn another_servo_goes_on_from_its_state_to_the_bit() {
    for changeover in [Changeover::SettledDeviation, Changeover::ReturnToStand] {
        let mut axis = Axis::new(changeover);
        axis.rig.position[0] = 300;
        axis.scan();
        axis.jog(1_000_000);
        // Anywhere: settling, returning, moving, at rest, back at the program's controller.
        let mut seen = [0; 4];
        let mut done = 0;
        for scan in 0..2_000 {
            let mut other = servo(&axis.rig.machine, 0);
            other.state = axis.servo.state;
            let expected = other.scan(&axis.feedback());
            assert_eq!(axis.scan(), expected, "scan {scan}");
            seen[ServoState::of(&axis.command).manual.changeover.phase as usize] += 1;
            done += u32::from(axis.is_done());
            if done == 1 {
                axis.driver = Driver::Program;
                axis.rig.mode = Mode::Enabled;
            }
        }
        let returned = seen[2] > 0;
        assert_eq!(
            returned,
            changeover == Changeover::ReturnToStand,
            "{seen:?}"
        );
        assert!(seen[0] > 0 && seen[1] > 0 && seen[3] > 100, "{seen:?}");
    }
}

#[test]
fn a_blocked_axis_trips_by_the_manual_controllers_own_error() {
    let mut axis = Axis::new(Changeover::SettledDeviation);
    axis.scan();
    axis.blocked = true;
    axis.jog(10_000_000);
    for _ in 0..2_000 {
        if axis.scan().cause != 0 {
            break;
        }
    }
    assert_eq!(
        Cause::from_wire(axis.command.cause),
        Some(Cause::FollowingError)
    );
    assert_eq!(axis.command.velocity_mm_s, 0.0);
}

#[test]
fn a_driver_that_is_none_and_a_jog_while_a_window_is_executed_make_no_sense() {
    let mut rig = Rig::new(machine("xy"));
    rig.run_to(160);
    for (driver, window) in [(9, false), (Driver::Manual as u32, true)] {
        let mut feedback = rig.feedback();
        feedback.axes[0].driver = driver;
        if !window {
            feedback.window = bus::sample::WindowId::NONE;
        }
        let command = rig.servos[0].clone().scan(&feedback);
        assert_eq!(command.cause, Cause::BadFeedback as u32, "driver {driver}");
    }
}
