//! A circle driven by servos against axes that do what they are commanded: no friction, no mass, one scan of transport.
#![allow(dead_code, missing_docs)]

use std::path::Path;

use bus::sample::{AxisCommand, Feedback, Mode, Setpoint, WindowHeader, WindowId};
use bytemuck::Zeroable;
use machine::Machine;
use servo::{Refusal, Servo, ServoPorts};

pub const RADIUS_MM: f64 = 10.0;
pub const SPEED_MM_S: f64 = 50.0;
const RUN_IN_MM_S2: f64 = 1000.0;

/// A machine that comes with the product, its reversals with a friction pulse.
pub fn machine(name: &str) -> Machine {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../machines")
        .join(name);
    let mut machine = Machine::load(&folder).expect("a machine that comes with the product");
    machine.axes.truncate(2);
    for axis in &mut machine.axes {
        // A servo with a standby says its state in every command.
        axis.standby = true;
        axis.reversal.method = machine::ReversalMethod::FrictionPulse;
        axis.torque_feed_forward = machine::TorqueFeedForward {
            acceleration: false,
            viscous: false,
            friction: false,
            ..axis.torque_feed_forward
        };
    }
    machine
}

pub fn servo(machine: &Machine, axis: usize) -> Servo {
    Servo::new(machine, axis, 0, 1).expect("an axis of the machine")
}

/// Sets the checksum, so that only what the test broke is wrong.
pub fn seal(header: &mut WindowHeader, setpoints: &[Setpoint]) {
    header.id.checksum = bus::window::checksum(header, setpoints);
}

/// Ports of one scan.
struct ScanPorts<'a> {
    feedback: Option<&'a Feedback>,
    offered: &'a Option<(WindowHeader, Vec<Setpoint>)>,
    command: AxisCommand,
}

impl<'a> ServoPorts for ScanPorts<'a> {
    type Feedback = &'a Feedback;

    fn next_feedback(&mut self) -> Option<&'a Feedback> {
        self.feedback.take()
    }

    fn for_each_window(&mut self, _scan: u64, mut offer: impl FnMut(&WindowHeader, &[Setpoint])) {
        if let Some((header, setpoints)) = self.offered {
            offer(header, setpoints);
        }
    }

    fn peer_command(&mut self, _scan: u64) -> Option<AxisCommand> {
        None
    }

    fn publish(&mut self, command: &AxisCommand) {
        self.command = *command;
    }

    fn answered(&mut self, _scan: u64) {}
}

/// What a servo answers to a feedback and a window that was published before.
pub fn answer(
    servo: &mut Servo,
    feedback: &Feedback,
    offered: &Option<(WindowHeader, Vec<Setpoint>)>,
) -> AxisCommand {
    let mut ports = ScanPorts {
        feedback: Some(feedback),
        offered,
        command: AxisCommand::zeroed(),
    };
    assert!(servo::cycle(servo, &mut ports));
    ports.command
}

pub struct Rig {
    pub machine: Machine,
    pub servos: Vec<Servo>,
    pub scan: u64,
    pub start_scan: u64,
    /// Distance at which the path is to end, in mm: beyond, windows brake to there.
    pub window: WindowId,
    pub in_force: WindowHeader,
    pub pending: Option<WindowHeader>,
    pub sequence: u32,
    pub mode: Mode,
    pub position: [i64; 2],
    pub command_position: [i64; 2],
    pub commands: [AxisCommand; 2],
    pub publishing: bool,
    pub last_window: (WindowHeader, Vec<Setpoint>),
}

impl Rig {
    pub fn new(machine: Machine) -> Rig {
        let servos = (0..2).map(|i| servo(&machine, i)).collect();
        let period = u64::from(machine.scan.interpolation_period_scans);
        Rig {
            servos,
            scan: 1,
            start_scan: 4 * period + 3,
            machine,
            window: WindowId::NONE,
            in_force: WindowHeader::zeroed(),
            pending: None,
            sequence: 0,
            mode: Mode::Enabled,
            position: [0; 2],
            command_position: [0; 2],
            commands: [AxisCommand::zeroed(); 2],
            publishing: true,
            last_window: (WindowHeader::zeroed(), Vec::new()),
        }
    }

    pub fn period(&self) -> u64 {
        self.machine.scan.interpolation_period_scans.into()
    }

    /// Positions at a distance on a circle that starts at 60°.
    pub fn at(distance_mm: f64) -> [i64; 2] {
        let from = std::f64::consts::PI / 3.0;
        let angle = from + distance_mm / RADIUS_MM;
        let x = RADIUS_MM * (libm::cos(angle) - libm::cos(from));
        let y = RADIUS_MM * (libm::sin(angle) - libm::sin(from));
        [libm::round(x * 1e6) as i64, libm::round(y * 1e6) as i64]
    }

    /// Distance and speed that many scans after the start.
    fn profile(&self, scan: u64) -> (f64, f64) {
        let t = scan.saturating_sub(self.start_scan) as f64 * self.machine.scan_period_s();
        let run_in_s = SPEED_MM_S / RUN_IN_MM_S2;
        if t < run_in_s {
            (0.5 * RUN_IN_MM_S2 * t * t, RUN_IN_MM_S2 * t)
        } else {
            (SPEED_MM_S * (t - run_in_s / 2.0), SPEED_MM_S)
        }
    }

    /// A whole window: intended setpoints on the circle, then braking along it.
    pub fn make(&mut self, first_scan: u64) -> (WindowHeader, Vec<Setpoint>) {
        let scan_s = self.machine.scan_period_s();
        let intended = u64::from(self.machine.intended_setpoints());
        let setpoint = |distance: f64| {
            let mut setpoint = Setpoint::zeroed();
            let [x, y] = Self::at(distance);
            setpoint.position[0] = x;
            setpoint.position[1] = y;
            setpoint.tag.distance_mm = distance;
            setpoint
        };
        let mut setpoints: Vec<_> = (0..intended)
            .map(|i| setpoint(self.profile(first_scan + i).0))
            .collect();
        let (mut distance, mut speed) = self.profile(first_scan + intended - 1);
        while speed > 0.0 {
            let less = speed.min(3000.0 * scan_s);
            distance += (speed - less / 2.0) * scan_s;
            speed -= less;
            setpoints.push(setpoint(distance));
        }
        setpoints.push(setpoint(distance));
        self.sequence += 1;
        let mut header = WindowHeader::zeroed();
        header.id.sequence = self.sequence;
        header.id.incarnation = 1;
        header.predecessor = self.window;
        header.first_scan = first_scan;
        header.visible_from = self.scan;
        header.epoch = 1;
        header.intended_setpoints = intended as u32;
        header.setpoint_count = setpoints.len() as u32;
        seal(&mut header, &setpoints);
        (header, setpoints)
    }

    pub fn feedback(&self) -> Feedback {
        let mut feedback = Feedback::zeroed();
        feedback.scan = self.scan;
        feedback.visible_from = self.scan;
        feedback.window = self.window;
        feedback.epoch = 1;
        feedback.mode = self.mode as u32;
        feedback.cause_axis = u32::MAX;
        feedback.axis_count = 2;
        if !self.window.is_none() {
            let setpoint = self.scan.saturating_sub(self.in_force.first_scan);
            feedback.setpoint = (setpoint as u32).min(self.in_force.setpoint_count - 1);
        }
        for (axis, out) in feedback.axes.iter_mut().take(2).enumerate() {
            out.motor_position = self.position[axis];
            out.scale_position = self.position[axis];
            out.command_position = self.command_position[axis];
        }
        feedback
    }

    /// What became visible in this scan, if the planner has something.
    pub fn offers(&mut self) -> Option<(WindowHeader, Vec<Setpoint>)> {
        if let Some(next) = self.pending
            && next.first_scan == self.scan
        {
            self.window = next.id;
            self.in_force = next;
            self.pending = None;
        }
        let boundary = self.scan.is_multiple_of(self.period());
        (boundary && self.publishing && self.pending.is_none()).then(|| {
            let made = self.make(self.scan + self.period());
            self.pending = Some(made.0);
            self.last_window = made.clone();
            made
        })
    }

    /// One scan; the feedback and window it saw are handed to `also` before the commands act.
    pub fn step(&mut self, also: impl FnOnce(&Feedback, &Option<(WindowHeader, Vec<Setpoint>)>)) {
        let offered = self.offers();
        let feedback = self.feedback();
        also(&feedback, &offered);
        let before = self.commands;
        for (axis, servo) in self.servos.iter_mut().enumerate() {
            self.commands[axis] = answer(servo, &feedback, &offered);
            let command = &self.commands[axis];
            let fine = (command.cause, command.refused) == (0, WindowId::NONE);
            assert!(fine, "scan {} axis {axis}", self.scan);
            self.command_position[axis] = self.commands[axis].position;
            // The command of the scan before acts now; in torque mode the axis gets that speed as well.
            let moved = before[axis].velocity_mm_s * self.machine.scan_period_s() * 1e6;
            self.position[axis] += libm::round(moved) as i64;
        }
        self.scan += 1;
    }

    pub fn run_to(&mut self, scan: u64) {
        while self.scan < scan {
            self.step(|_, _| ());
        }
    }
}

/// What a fresh servo of axis 0 says of a window, after `feedback`.
pub fn refusal(
    machine: &Machine,
    header: &WindowHeader,
    setpoints: &[Setpoint],
    feedback: &Feedback,
) -> Refusal {
    let mut servo = servo(machine, 0);
    let refusal = servo
        .offer(header, setpoints, feedback)
        .expect_err("the window should be refused");
    assert_eq!(servo.scan(feedback).refused, header.id);
    refusal
}
