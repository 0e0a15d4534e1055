//! A master over drives that are no simulation: they switch on slowly or never, fault, vanish, and have lost their reference.

use std::cell::RefCell;
use std::rc::Rc;

use bus::sample::{
    AxisCommand, Cause, Feedback, Job, Mode, OperatorRequest, Order, Participant, Refused, Roster,
};
use bytemuck::Zeroable;
use machine::{Machine, WithinPeriod};
use master::{
    Answers, DriveCommand, DriveFeedback, DriveState, Drives, InstrumentSample, Master, RunEnd,
    StateRefused,
};

const AXES: usize = 2;
/// Scans that a drive takes to switch on.
/// A master waits so long for drives that are being switched on, 5 s.
const PATIENCE_SCANS: u32 = 5000;
const SWITCH_ON_SCANS: u32 = 40;
const SPEED_MM_S: f64 = 50.0;
const SCAN_S: f64 = 1e-3;

/// One drive: it does at once what it is asked to, as its state lets it.
#[derive(Debug, Clone, Copy)]
struct Drive {
    shown: DriveFeedback,
    command: DriveCommand,
    /// Scans that it still takes to switch on; none: it never does.
    switches_on_in: Option<u32>,
}

impl Drive {
    fn ready() -> Drive {
        Drive {
            shown: DriveFeedback {
                referenced: true,
                ..DriveFeedback::default()
            },
            command: DriveCommand::Disabled,
            switches_on_in: Some(SWITCH_ON_SCANS),
        }
    }

    fn off() -> Drive {
        let mut drive = Drive::ready();
        drive.shown.state = DriveState::Off;
        drive
    }

    fn take(&mut self, command: DriveCommand) {
        self.command = command;
        if self.shown.state.is_lost() {
            // Nobody hears any more what it does.
            return;
        }
        let speed_mm_s = self.shown.velocity_mm_s;
        self.shown.velocity_mm_s = match (self.shown.state, command) {
            (DriveState::Ready, DriveCommand::Velocity { velocity_mm_s, .. }) => velocity_mm_s,
            (DriveState::Off, _) => 0.0,
            _ => (speed_mm_s - 1.0).max(0.0),
        };
        self.shown.motor_position_mm += self.shown.velocity_mm_s * SCAN_S;
        if self.shown.state == DriveState::Off && command == DriveCommand::SwitchOn {
            match &mut self.switches_on_in {
                Some(0) => self.shown.state = DriveState::Ready,
                Some(scans) => *scans -= 1,
                None => {}
            }
        }
    }
}

/// Drives that the test keeps a hand on.
#[derive(Debug, Clone)]
struct TestDrives(Rc<RefCell<Vec<Drive>>>);

impl Drives for TestDrives {
    fn count(&self) -> usize {
        self.0.borrow().len()
    }

    fn feedback(&self, axis: usize) -> DriveFeedback {
        self.0.borrow()[axis].shown
    }

    fn exchange(&mut self, commands: &[DriveCommand]) {
        for (drive, command) in self.0.borrow_mut().iter_mut().zip(commands) {
            drive.take(*command);
        }
    }

    fn instruments(&self, _axis: usize) -> &[InstrumentSample] {
        &[]
    }

    fn state_bytes(&self) -> usize {
        0
    }

    fn save(&self, _bytes: &mut [u8]) {}

    fn restore(&mut self, _bytes: &[u8]) -> Result<(), StateRefused> {
        Ok(())
    }
}

fn machine() -> Machine {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
    Machine::load(&folder).expect("the machine")
}

struct Bench {
    master: Master<TestDrives>,
    drives: TestDrives,
    roster: Roster,
}

impl Bench {
    /// A run of one program over these drives; drives on from the first scan if `enabled`.
    fn new(drives: [Drive; AXES], enabled: bool) -> Bench {
        Bench::of(machine(), drives, enabled)
    }

    /// The same of this machine.
    fn of(mut machine: Machine, drives: [Drive; AXES], enabled: bool) -> Bench {
        assert_eq!(machine.scan_period_s(), SCAN_S);
        // It moves its drives without a window: its servos are the kind whose positions nobody can hold against one.
        machine.interpolation.within_period = WithinPeriod::Linear;
        let drives = TestDrives(Rc::new(RefCell::new(drives.to_vec())));
        let mut roster = Roster::zeroed();
        roster.version = 1;
        let jobs = [(Job::Planner, 0), (Job::Servo, 0), (Job::Servo, 1)];
        for (slot, (job, axis)) in roster.participants.iter_mut().zip(jobs) {
            *slot = Participant {
                job: job as u32,
                axis,
                incarnation: 1,
                live: 1,
                ..Participant::zeroed()
            };
        }
        let end = RunEnd::AfterProgram;
        Bench {
            master: Master::new(&machine, drives.clone(), 1, 0, enabled, end),
            drives,
            roster,
        }
    }

    /// One scan in which every servo asks for this speed; the feedback of the next.
    fn scan_at(&mut self, speed_mm_s: f64) -> Feedback {
        let feedback = self.master.feedback();
        let increments = (speed_mm_s * SCAN_S * 1e6) as i64;
        let mut answers = Answers::of_axes(bus::sample::MAX_AXES);
        for (axis, commands) in answers.commands.iter_mut().take(AXES).enumerate() {
            commands[0] = Some(AxisCommand {
                scan: feedback.scan,
                visible_from: feedback.scan + 1,
                position: feedback.axes[axis].command_position + increments,
                velocity_mm_s: speed_mm_s,
                stop_deceleration_mm_s2: 1000.0,
                axis: axis as u32,
                incarnation: 1,
                ..AxisCommand::zeroed()
            });
        }
        self.master.exchange();
        self.master.close_scan(&answers, &self.roster);
        self.master.feedback()
    }

    fn scans(&mut self, count: u32) -> Feedback {
        let mut feedback = self.master.feedback();
        for _ in 0..count {
            feedback = self.scan_at(0.0);
        }
        feedback
    }

    /// Both axes at speed.
    fn moving() -> Bench {
        let mut bench = Bench::new([Drive::ready(); AXES], true);
        for _ in 0..20 {
            bench.scan_at(SPEED_MM_S);
        }
        assert_eq!(bench.drive(1).shown.velocity_mm_s, SPEED_MM_S);
        bench
    }

    fn order(&mut self, order: Order) -> Refused {
        let request = OperatorRequest {
            order: order as u32,
            ..OperatorRequest::zeroed()
        };
        Refused::from_wire(self.master.order(&request).reason).expect("a known reason")
    }

    fn drive(&self, axis: usize) -> Drive {
        self.drives.0.borrow()[axis]
    }

    fn set(&self, axis: usize, change: impl FnOnce(&mut Drive)) {
        change(&mut self.drives.0.borrow_mut()[axis]);
    }

    fn show(&self, axis: usize, state: DriveState) {
        self.set(axis, |drive| drive.shown.state = state);
    }
}

fn state(feedback: &Feedback) -> (Mode, Cause, u32) {
    (
        Mode::from_wire(feedback.mode).expect("a known mode"),
        Cause::from_wire(feedback.cause).expect("a known cause"),
        feedback.cause_axis,
    )
}

const NO_AXIS: u32 = u32::MAX;
const FAULT: DriveState = DriveState::Fault { code: 0x7305 };

#[test]
fn a_run_waits_for_drives_that_take_forty_scans_to_switch_on() {
    let mut bench = Bench::new([Drive::ready(), Drive::off()], true);
    for _ in 0..SWITCH_ON_SCANS {
        let feedback = bench.scans(1);
        assert_eq!(state(&feedback), (Mode::Disabled, Cause::None, NO_AXIS));
        for axis in 0..AXES {
            assert_eq!(bench.drive(axis).command, DriveCommand::SwitchOn);
        }
    }
    let feedback = bench.scans(1);
    assert_eq!(state(&feedback), (Mode::Enabled, Cause::None, NO_AXIS));
    assert_eq!(feedback.hold, 0, "nobody has held the program");
    bench.scan_at(SPEED_MM_S);
    bench.scan_at(SPEED_MM_S);
    assert_eq!(bench.drive(1).shown.velocity_mm_s, SPEED_MM_S);
}

#[test]
fn an_order_to_enable_waits_for_them_too_and_ends_in_hold() {
    let mut bench = Bench::new([Drive::off(), Drive::off()], false);
    let feedback = bench.scans(100);
    assert_eq!(state(&feedback), (Mode::Disabled, Cause::None, NO_AXIS));
    assert_eq!(bench.drive(0).command, DriveCommand::Disabled);

    assert_eq!(bench.order(Order::Enable), Refused::Not);
    let feedback = bench.scans(SWITCH_ON_SCANS);
    assert_eq!(state(&feedback).0, Mode::Disabled);
    assert_eq!(bench.order(Order::Disable), Refused::Not);
    bench.scans(1);
    assert_eq!(
        bench.drive(0).command,
        DriveCommand::Disabled,
        "taken back while they were being switched on"
    );

    assert_eq!(bench.order(Order::Enable), Refused::Not);
    let feedback = bench.scans(SWITCH_ON_SCANS);
    assert_eq!(state(&feedback), (Mode::Enabled, Cause::None, NO_AXIS));
    assert_eq!(feedback.hold, 1);
}

#[test]
fn a_drive_that_never_switches_on_ends_a_run_with_its_name_and_leaves_an_operator_the_next_try() {
    let never = Drive {
        switches_on_in: None,
        ..Drive::off()
    };
    let patience_scans = (5.0 / SCAN_S) as u32;

    let mut bench = Bench::new([Drive::ready(), never], true);
    let feedback = bench.scans(patience_scans - 1);
    assert_eq!(state(&feedback), (Mode::Disabled, Cause::None, NO_AXIS));
    let feedback = bench.scans(1);
    assert_eq!(state(&feedback), (Mode::Tripped, Cause::DriveOff, 1));
    assert_eq!(bench.scans(200).last, 1, "the run ends");

    let mut bench = Bench::new([Drive::ready(), never], false);
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    let feedback = bench.scans(patience_scans);
    assert_eq!(state(&feedback), (Mode::Disabled, Cause::DriveOff, 1));
    bench.scans(1);
    assert_eq!(bench.drive(1).command, DriveCommand::Disabled);
    bench.set(1, |drive| drive.switches_on_in = Some(0));
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    let feedback = bench.scans(3);
    assert_eq!(state(&feedback), (Mode::Enabled, Cause::None, NO_AXIS));
}

#[test]
fn a_stop_while_drives_are_being_switched_on_ends_the_run_with_drives_off() {
    let mut bench = Bench::new([Drive::off(), Drive::off()], true);
    bench.scans(10);
    assert_eq!(bench.order(Order::Stop), Refused::Not);
    let feedback = bench.scans(200);
    assert_eq!(state(&feedback).0, Mode::Disabled);
    assert_eq!(feedback.last, 1);
    assert_eq!(bench.drive(0).command, DriveCommand::Disabled);
}

#[test]
fn a_drive_fault_in_motion_stops_all_axes_with_its_code_and_only_enable_has_it_reset() {
    let mut bench = Bench::moving();
    bench.show(1, FAULT);
    let feedback = bench.scan_at(SPEED_MM_S);
    assert_eq!(state(&feedback), (Mode::Tripped, Cause::DriveFault, 1));
    assert_eq!(
        (feedback.axes[0].drive_code, feedback.axes[1].drive_code),
        (0, 0x7305)
    );
    bench.scans(1);
    for axis in 0..AXES {
        assert_eq!(
            bench.drive(axis).command,
            DriveCommand::Brake {
                deceleration_mm_s2: 1000.0
            }
        );
    }
    bench.scans(60);
    assert_eq!(bench.drive(0).shown.velocity_mm_s, 0.0, "it has braked");
    assert_eq!(bench.order(Order::Resume), Refused::Tripped);
    let feedback = bench.scans(1);
    assert_eq!(state(&feedback), (Mode::Tripped, Cause::DriveFault, 1));
    assert_eq!(
        bench.drive(1).command,
        DriveCommand::Brake {
            deceleration_mm_s2: 1000.0
        },
        "nobody has ordered a reset"
    );

    // A fault that cannot be reset is named again once the patience is over.
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    let feedback = bench.scans(1);
    assert_eq!(state(&feedback), (Mode::Disabled, Cause::None, NO_AXIS));
    assert_eq!(bench.drive(1).command, DriveCommand::SwitchOn);
    let feedback = bench.scans(PATIENCE_SCANS);
    assert_eq!(state(&feedback), (Mode::Disabled, Cause::DriveFault, 1));
    assert_eq!(feedback.axes[1].drive_code, 0x7305);

    // Reset on the way, it is off, and is switched on.
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    bench.scans(2);
    bench.show(1, DriveState::Off);
    let feedback = bench.scans(SWITCH_ON_SCANS);
    assert_eq!(state(&feedback), (Mode::Disabled, Cause::None, NO_AXIS));
    assert_eq!(feedback.axes[1].drive_code, 0);
    let feedback = bench.scans(1);
    assert_eq!(state(&feedback), (Mode::Enabled, Cause::None, NO_AXIS));
    assert_eq!(feedback.hold, 1);
    for (axis, shown) in feedback.axes().iter().enumerate() {
        assert_eq!(
            shown.command_position, shown.motor_position,
            "axis {axis} is commanded to be where it came to rest"
        );
    }
}

#[test]
fn a_drive_that_switches_itself_off_in_motion_is_named_and_can_be_switched_on_again() {
    let mut bench = Bench::moving();
    bench.show(0, DriveState::Off);
    let feedback = bench.scan_at(SPEED_MM_S);
    assert_eq!(state(&feedback), (Mode::Tripped, Cause::DriveOff, 0));
    bench.scans(60);
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    let feedback = bench.scans(SWITCH_ON_SCANS + 1);
    assert_eq!(state(&feedback), (Mode::Enabled, Cause::None, NO_AXIS));
}

#[test]
fn a_fault_while_drives_are_being_switched_on_is_named_at_once() {
    let mut bench = Bench::new([Drive::off(), Drive::off()], false);
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    bench.scans(5);
    bench.show(0, FAULT);
    let feedback = bench.scans(1);
    assert_eq!(state(&feedback), (Mode::Disabled, Cause::DriveFault, 0));
    assert_eq!(feedback.axes[0].drive_code, 0x7305);
}

#[test]
fn a_drive_that_vanishes_in_motion_stops_the_others_and_the_run_ends_without_its_speed() {
    let mut bench = Bench::moving();
    bench.show(1, DriveState::Lost { code: 0 });
    let feedback = bench.scan_at(SPEED_MM_S);
    assert_eq!(state(&feedback), (Mode::Tripped, Cause::DriveLost, 1));
    assert_eq!(feedback.axes[1].drive_code, 0);
    let feedback = bench.scans(60);
    assert_eq!(bench.drive(0).shown.velocity_mm_s, 0.0, "it has braked");
    assert_eq!(
        feedback.axes[1].velocity_mm_s, SPEED_MM_S,
        "the last that anybody has seen of it"
    );
    assert_eq!(bench.scans(200).last, 1, "the run ends");
}

#[test]
fn a_drive_that_is_plugged_in_again_is_driven_by_an_order_and_not_before() {
    let mut bench = Bench::moving();
    bench.show(1, DriveState::Lost { code: 0x1B });
    bench.scans(60);
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    let feedback = bench.scans(10);
    assert_eq!(state(&feedback), (Mode::Disabled, Cause::None, NO_AXIS));
    // It does not come: that is named, with what the bus says of it.
    let feedback = bench.scans(PATIENCE_SCANS);
    assert_eq!(state(&feedback), (Mode::Disabled, Cause::DriveLost, 1));
    assert_eq!(feedback.axes[1].drive_code, 0x1B);
    bench.set(1, |drive| *drive = Drive::off());
    let feedback = bench.scans(10);
    assert_eq!(state(&feedback).0, Mode::Disabled);
    assert_eq!(bench.drive(1).command, DriveCommand::Disabled);
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    let feedback = bench.scans(SWITCH_ON_SCANS + 2);
    assert_eq!(state(&feedback), (Mode::Enabled, Cause::None, NO_AXIS));
}

#[test]
fn a_drive_that_is_back_without_its_reference_is_not_driven_before_it_has_one() {
    let mut bench = Bench::moving();
    bench.show(1, DriveState::Lost { code: 0 });
    bench.scans(60);
    bench.set(1, |drive| {
        *drive = Drive::off();
        drive.shown.referenced = false;
    });
    bench.scans(1);
    assert_eq!(bench.order(Order::Enable), Refused::NotReferenced);
    bench.set(1, |drive| drive.shown.referenced = true);
    bench.scans(1);
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    let feedback = bench.scans(SWITCH_ON_SCANS + 1);
    assert_eq!(state(&feedback), (Mode::Enabled, Cause::None, NO_AXIS));
}

#[test]
fn an_axis_without_reference_is_not_moved() {
    let mut lost = Drive::ready();
    lost.shown.referenced = false;

    let mut bench = Bench::new([Drive::ready(), lost], false);
    bench.scans(3);
    assert_eq!(bench.order(Order::Enable), Refused::NotReferenced);
    bench.scans(100);
    assert_eq!(bench.drive(0).command, DriveCommand::Disabled);

    let mut bench = Bench::new([Drive::ready(), lost], true);
    let feedback = bench.scan_at(SPEED_MM_S);
    assert_eq!(state(&feedback), (Mode::Tripped, Cause::NotReferenced, 1));
    bench.scans(3);
    for axis in 0..AXES {
        assert_eq!(bench.drive(axis).shown.motor_position_mm, 0.0);
    }
    assert_eq!(bench.order(Order::Enable), Refused::NotReferenced);

    let mut bench = Bench::moving();
    bench.set(0, |drive| drive.shown.referenced = false);
    let feedback = bench.scan_at(SPEED_MM_S);
    assert_eq!(state(&feedback), (Mode::Tripped, Cause::NotReferenced, 0));
}

/// The machine of two slides, whose X has to be homed by a method.
fn homed_by(method: &str) -> Machine {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy/machine.toml");
    let text = std::fs::read_to_string(path).expect("machine.toml");
    let table = format!("[axis.homing]\nmethod = {method}\n\n[axis.motor]");
    let text = text.replacen("[axis.motor]", &table, 1);
    Machine::parse("machine.toml", &text).expect("a machine")
}

#[test]
fn a_homed_axis_is_homed_no_more_once_its_drive_has_been_away() {
    let drives = [Drive::ready(); AXES];
    let mut bench = Bench::of(homed_by("\"switch\"\nswitch_input = 0"), drives, true);
    assert_eq!(bench.master.feedback().axes[0].reference, 1);
    let mut latches = bench.master.latches();
    latches.homing.offset[0] = 7_000_000;
    latches.homing.homed = 1;
    bench.master.resume(&latches);
    let feedback = bench.master.feedback();
    assert_eq!(feedback.axes[0].reference, 0);
    assert_eq!(feedback.axes[0].motor_position, 7_000_000);
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    bench.scans(1);
    assert_eq!(bench.order(Order::Resume), Refused::Not);

    bench.show(0, DriveState::Lost { code: 0 });
    let feedback = bench.scans(1);
    assert_eq!(state(&feedback), (Mode::Tripped, Cause::DriveLost, 0));
    assert_eq!(feedback.axes[0].reference, 1);
    bench.show(0, DriveState::Ready);
    let feedback = bench.scans(20);
    let references = [0, 1].map(|axis| feedback.axes[axis].reference);
    assert_eq!(references, [1, 0], "it may be anywhere");
    assert_eq!(bench.master.latches().homing.homed, 0b10);
    // Its drive is driven, to home it; no program is.
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    bench.scans(1);
    assert_eq!(bench.order(Order::Resume), Refused::NotReferenced);
}

#[test]
fn an_axis_that_its_drive_homes_is_homed_as_long_as_the_drive_says_so() {
    let mut bench = Bench::of(homed_by("\"drive\""), [Drive::ready(); AXES], true);
    let feedback = bench.scans(1);
    assert_eq!((feedback.axes[0].reference, feedback.hold), (0, 0));
    bench.set(0, |drive| drive.shown.referenced = false);
    let feedback = bench.scans(1);
    assert_eq!(feedback.axes[0].reference, 1);
    assert_eq!(bench.order(Order::Hold), Refused::Not);
    bench.scans(100);
    assert_eq!(bench.order(Order::Home), Refused::Not);
    let feedback = bench.scans(3);
    assert_eq!(bench.drive(0).command, DriveCommand::Home);
    assert_eq!(feedback.axes[0].reference, 2);
    bench.set(0, |drive| {
        drive.shown.motor_position_mm = 250.0;
        drive.shown.referenced = true;
    });
    let feedback = bench.scans(20);
    assert_eq!(state(&feedback), (Mode::Enabled, Cause::None, NO_AXIS));
    assert_eq!(feedback.axes[0].reference, 0);
    assert_eq!(feedback.axes[0].command_position, 250_000_000);
}

/// A machine whose screw of X is 50 µm/m too long, whose Y leans by 60 µm/m, and whose Y is homed by its drive.
fn with_errors() -> Machine {
    let text = include_str!("../../machines/xy/machine.toml");
    let homed = "name = \"Y\"\nhoming.method = \"drive\"\nhoming.rest_mm = 100";
    let text = text.replace("name = \"Y\"", homed).replace(
        "name = \"X\"",
        "name = \"X\"\ncompensation = { positions_mm = [-200, 200], forward_um = [-10, 10] }",
    );
    let lean = "\n[[squareness]]\nof = \"Y\"\nto = \"X\"\num_per_m = 60.0\n";
    Machine::parse("xy", &(text + lean)).expect("a machine")
}

fn at(position_mm: f64, referenced: bool) -> Drive {
    let mut drive = Drive::ready();
    drive.shown.motor_position_mm = position_mm;
    drive.shown.referenced = referenced;
    drive
}

#[test]
fn positions_are_shown_true_from_the_first_feedback_and_the_drive_is_so_much_slower() {
    let mut bench = Bench::of(with_errors(), [at(100.0, true), at(100.0, false)], true);
    let feedback = bench.master.feedback();
    let [x, y] = [0, 1].map(|axis| &feedback.axes[axis]);
    // Y does not know its place: it leans by nobody knows how much.
    assert_eq!(
        (x.motor_position, y.motor_position),
        (100_005_000, 100_000_000)
    );
    assert_eq!(x.command_position, x.motor_position);
    // Smoothed over 1/Kp, 20 scans.
    for _ in 0..400 {
        bench.scan_at(SPEED_MM_S);
    }
    let (motor_mm_s, slower_mm_s) = (bench.drive(0).shown.velocity_mm_s, SPEED_MM_S * 50e-6);
    assert!(
        (motor_mm_s - (SPEED_MM_S - slower_mm_s)).abs() < 1e-6,
        "{motor_mm_s}"
    );
    assert_eq!(bench.drive(1).shown.velocity_mm_s, SPEED_MM_S);
}

#[test]
fn an_axis_creeps_to_its_true_place_once_the_axis_that_leans_is_homed() {
    let mut bench = Bench::of(with_errors(), [at(0.0, true), at(-100.0, false)], false);
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    bench.scans(300);
    assert_eq!(bench.order(Order::Home), Refused::Not);
    bench.scans(20);
    bench.set(1, |drive| drive.shown.referenced = true);
    // Both slopes at the highest speed, twice.
    let most_mm = 2.0 * (50e-6 + 60e-6) * 250.0 * SCAN_S + 1e-6;
    let before = bench.master.feedback().axes[0];
    assert_eq!((before.motor_position, before.command_position), (0, 0));
    let mut creeps = 0;
    for _ in 0..500 {
        let from_mm = bench.drive(0).shown.motor_position_mm;
        let now = bench.scans(1).axes[0];
        let step_mm = bench.drive(0).shown.motor_position_mm - from_mm;
        assert!(
            (-1e-6..=most_mm).contains(&step_mm),
            "{step_mm} mm in a scan"
        );
        // What comes later than the correction, smoothed over 20 scans, is the loop's to make good; these servos have none.
        assert!(now.motor_position.abs() as f64 * 1e-6 <= 20.0 * most_mm);
        assert_eq!(now.command_position, 0);
        creeps += u32::from(step_mm > 0.0);
    }
    // 6 µm: where Y stands, 100 mm below its zero, X is so much less than its drive shows.
    let moved_mm = bench.drive(0).shown.motor_position_mm;
    assert!((moved_mm - 0.006).abs() < 1e-4, "{moved_mm}");
    assert!(creeps > 100, "{creeps}");
}
