//! The master's judgement: commands, windows, modes. Each guard has a test that goes red without it.

use bus::sample::{
    AxisCommand, Cause, Driver, Feedback, Hand, Job, MAX_WINDOW_SETPOINTS, Mode, OperatorRequest,
    Order, Participant, PlannerStatus, ProgramState, Refused, Roster, Setpoint, WindowHeader,
    WindowId,
};
use bytemuck::Zeroable;
use loops::hand_course::HandCourse;
use machine::Machine;
use master::{Answers, Master, RunEnd};
use plant_sim::SimulatedDrives;
use plant_sim::plant_file::PlantFile;

const AXES: usize = 2;

struct Bench {
    side: Master<SimulatedDrives>,
    roster: Roster,
    /// What every servo says it holds as pending.
    pending: WindowId,
    watchdog_scans: u32,
}

impl Bench {
    fn new() -> Bench {
        Bench::of(RunEnd::AfterProgram)
    }

    /// Drives on from the first scan.
    fn of(run_end: RunEnd) -> Bench {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let machine = Machine::load(&folder).expect("the machine");
        let plant = PlantFile::load(&folder).expect("the plant");
        let simulations = plant.simulations(&machine).expect("axes");
        let mut roster = Roster::zeroed();
        roster.version = 1;
        let jobs = [(Job::Planner, 0), (Job::Servo, 0), (Job::Servo, 1)];
        for (place, (job, axis)) in roster.participants.iter_mut().zip(jobs) {
            *place = Participant {
                job: job as u32,
                axis,
                incarnation: 1,
                live: 1,
                ..Participant::zeroed()
            };
        }
        Bench {
            side: Master::new(
                &machine,
                SimulatedDrives::with_dead_time(simulations, 1),
                1,
                0,
                true,
                run_end,
            ),
            roster,
            pending: WindowId::NONE,
            watchdog_scans: machine.scan.watchdog_scans,
        }
    }

    /// A good command of each servo for this scan.
    fn good_answers(&self) -> Answers {
        let feedback = self.side.feedback();
        let mut answers = Answers::of_axes(bus::sample::MAX_AXES);
        for (axis, commands) in answers.commands.iter_mut().take(AXES).enumerate() {
            commands[0] = Some(AxisCommand {
                scan: feedback.scan,
                visible_from: feedback.scan + 1,
                position: feedback.axes[axis].command_position,
                stop_deceleration_mm_s2: 1000.0,
                axis: axis as u32,
                incarnation: 1,
                pending: self.pending,
                ..AxisCommand::zeroed()
            });
        }
        answers
    }

    /// One scan whose answers `change` may spoil; the feedback of the next.
    fn scan(&mut self, change: impl FnOnce(&mut Answers)) -> Feedback {
        let mut answers = self.good_answers();
        change(&mut answers);
        self.side.exchange();
        self.side.close_scan(&answers, &self.roster);
        self.side.feedback()
    }

    fn scans(&mut self, count: usize) -> Feedback {
        let mut feedback = self.side.feedback();
        for _ in 0..count {
            feedback = self.scan(|_| {});
        }
        feedback
    }

    /// Scans in which servos follow what is moved by hand, and axes that stand have settled.
    fn scans_by_hand(&mut self, count: usize) -> Feedback {
        let mut feedback = self.side.feedback();
        for _ in 0..count {
            feedback = self.scan(|answers| {
                for (axis, roles) in feedback.axes().iter().zip(&mut answers.commands) {
                    let course: HandCourse = bytemuck::cast(axis.hand);
                    let commands = roles.iter_mut().flatten();
                    for command in commands.filter(|_| axis.driver == Driver::Manual as u32) {
                        command.position = course.advanced().place();
                        command.ahead_scans = 5;
                        command.hand = match course.rests() {
                            true => Hand::Settled as u32,
                            false => Hand::Follows as u32,
                        };
                    }
                }
            });
        }
        feedback
    }

    /// Offers a window of `setpoints` setpoints at rest where the machine is.
    fn offer(
        &mut self,
        sequence: u32,
        first_scan: u64,
        setpoints: usize,
        predecessor: WindowId,
    ) -> WindowId {
        let feedback = self.side.feedback();
        let mut position = [0; bus::sample::PATH_AXES];
        for (value, axis) in position.iter_mut().zip(feedback.axes()) {
            *value = axis.command_position;
        }
        let setpoints = vec![
            Setpoint {
                position,
                ..Setpoint::zeroed()
            };
            setpoints
        ];
        let header = WindowHeader {
            id: WindowId {
                checksum: u64::from(sequence),
                sequence,
                incarnation: 1,
            },
            predecessor,
            first_scan,
            visible_from: feedback.scan,
            epoch: feedback.epoch,
            intended_setpoints: 1,
            setpoint_count: setpoints.len() as u32,
            ..WindowHeader::zeroed()
        };
        self.side.offer(&header, &setpoints, &self.roster);
        header.id
    }
}

fn mode(feedback: &Feedback) -> Mode {
    Mode::from_wire(feedback.mode).expect("a known mode")
}

fn cause(feedback: &Feedback) -> Cause {
    Cause::from_wire(feedback.cause).expect("a known cause")
}

#[test]
fn a_command_that_is_not_a_number_trips_with_its_axis_and_never_reaches_the_drive() {
    for spoil in [
        (|c: &mut AxisCommand| c.velocity_mm_s = f64::NAN) as fn(&mut AxisCommand),
        |c| c.velocity_mm_s = f64::INFINITY,
        |c| c.torque_nm = f64::NAN,
        |c| c.torque_nm = 1000.0,
        |c| c.stop_deceleration_mm_s2 = f64::NAN,
        |c| c.cause = 4711,
    ] {
        let mut bench = Bench::new();
        bench.scans(3);
        let feedback = bench.scan(|answers| {
            if let Some(command) = &mut answers.commands[1][0] {
                spoil(command);
            }
        });
        assert_eq!(
            (mode(&feedback), cause(&feedback)),
            (Mode::Tripped, Cause::BadValue)
        );
        assert_eq!(feedback.cause_axis, 1);
        assert!(feedback.axes[1].velocity_command_mm_s == 0.0);
    }
}

#[test]
fn a_command_beyond_all_speed_trips() {
    let mut bench = Bench::new();
    let feedback = bench.scan(|answers| {
        if let Some(command) = &mut answers.commands[0][0] {
            command.velocity_mm_s = 1e6;
        }
    });
    assert_eq!(
        (mode(&feedback), cause(&feedback)),
        (Mode::Tripped, Cause::SpeedLimit)
    );
    assert_eq!(feedback.cause_axis, 0);
}

#[test]
fn a_command_of_another_scan_axis_role_or_incarnation_counts_as_missed() {
    for spoil in [
        (|c: &mut AxisCommand| c.scan += 1) as fn(&mut AxisCommand),
        |c| c.scan -= 1,
        |c| c.axis = 0,
        |c| c.role = 1,
        |c| c.incarnation = 7,
    ] {
        let mut bench = Bench::new();
        bench.scans(3);
        let feedback = bench.scan(|answers| {
            if let Some(command) = &mut answers.commands[1][0] {
                command.velocity_mm_s = 99.0;
                spoil(command);
            }
        });
        assert_eq!(mode(&feedback), Mode::Enabled);
        assert_eq!(feedback.axes[1].missed_scans, 1);
        assert_eq!(
            feedback.axes[1].velocity_command_mm_s, 0.0,
            "the last good command holds"
        );
        assert_eq!(feedback.axes[0].missed_scans, 0);
        let feedback = bench.scans(1);
        assert_eq!(feedback.axes[1].missed_in_a_row, 0);
    }
}

#[test]
fn the_watchdog_trips_after_its_scans_in_a_row_and_not_before() {
    let mut bench = Bench::new();
    bench.scans(3);
    let mut feedback = bench.side.feedback();
    let watchdog_scans = bench.watchdog_scans;
    for missed in 1..=watchdog_scans {
        feedback = bench.scan(|answers| answers.commands[0][0] = None);
        assert_eq!(feedback.axes[0].missed_in_a_row, missed);
        assert_eq!(mode(&feedback) == Mode::Tripped, missed == watchdog_scans);
    }
    assert_eq!(cause(&feedback), Cause::Watchdog);
}

#[test]
fn a_servo_that_left_the_roster_trips_with_its_axis() {
    let mut bench = Bench::new();
    bench.scans(3);
    bench.roster.participants[2].live = 0;
    let feedback = bench.scan(|answers| answers.commands[1][0] = None);
    assert_eq!(
        (mode(&feedback), cause(&feedback)),
        (Mode::Tripped, Cause::ServoLost)
    );
    assert_eq!(feedback.cause_axis, 1);
}

#[test]
fn a_planner_that_cannot_go_on_stops_the_machine_on_the_path() {
    let mut bench = Bench::new();
    let first = bench.offer(1, 8, 40, WindowId::NONE);
    bench.pending = first;
    bench.scans(10);
    let report = |incarnation| {
        move |answers: &mut Answers| {
            answers.planner = Some(PlannerStatus {
                cause: Cause::Planner as u32,
                incarnation,
                ..PlannerStatus::zeroed()
            });
        }
    };
    let feedback = bench.scan(report(9));
    assert_eq!(
        mode(&feedback),
        Mode::Enabled,
        "a stranger's word counts nothing"
    );
    let feedback = bench.scan(report(1));
    assert_eq!(
        (mode(&feedback), cause(&feedback)),
        (Mode::Stopping, Cause::Planner)
    );
    assert_eq!(
        feedback.window, first,
        "the window in force is executed to its end"
    );
    assert_eq!(mode(&bench.scans(60)), Mode::Stopped);
}

#[test]
fn a_window_is_executed_only_when_every_axis_holds_it() {
    let mut bench = Bench::new();
    let id = bench.offer(1, 8, 4, WindowId::NONE);
    let feedback = bench.scans(8);
    assert!(feedback.window.is_none(), "no axis holds it");
    assert_eq!(feedback.voided, id);

    let id = bench.offer(2, 16, 4, WindowId::NONE);
    bench.pending = id;
    bench.scans(3);
    // In the last scan before its first, one axis lets go of it.
    bench.scans(4);
    let feedback = bench.scan(|answers| {
        if let Some(command) = &mut answers.commands[1][0] {
            command.pending = WindowId::NONE;
        }
    });
    assert!(feedback.window.is_none());
    assert_eq!(feedback.voided, id);

    let id = bench.offer(3, 24, 4, WindowId::NONE);
    bench.pending = id;
    let feedback = bench.scans(7);
    assert!(feedback.window.is_none());
    assert_eq!(feedback.armed, id);
    let feedback = bench.scans(1);
    assert_eq!((feedback.window, feedback.setpoint), (id, 0));
    assert_eq!(
        (bench.scans(2).setpoint, bench.scans(5).setpoint),
        (2, 3),
        "the last setpoint is held"
    );
    assert_eq!(bench.side.feedback().at_rest, 1);
}

/// A servo that had reported the next window and is lost before it begins holds it no more: the window in force is the last one.
#[test]
fn a_window_that_a_lost_servo_had_held_is_void() {
    let mut bench = Bench::new();
    bench.scans(8);
    let first = bench.offer(1, 16, 32, WindowId::NONE);
    bench.pending = first;
    let feedback = bench.scans(9);
    assert_eq!(feedback.window, first);
    let next = bench.offer(2, 24, 32, first);
    bench.pending = next;
    assert_eq!(bench.scans(2).armed, next);
    // Another process has the place of axis Y's servo, and knows of nothing.
    let lost = |answers: &mut Answers| answers.commands[1][0] = None;
    bench.roster.participants[2].live = 0;
    let mut feedback = bench.scan(lost);
    while feedback.scan <= 24 {
        assert_ne!(feedback.window, next, "scan {}", feedback.scan);
        feedback = bench.scan(lost);
    }
    assert_eq!((feedback.window, feedback.voided), (first, next));
}

#[test]
fn a_window_with_the_wrong_predecessor_epoch_planner_or_size_is_void() {
    let stranger = WindowId {
        checksum: 9,
        sequence: 9,
        incarnation: 1,
    };
    let mut bench = Bench::new();
    bench.pending = bench.offer(1, 8, 4, stranger);
    assert!(
        bench.scans(9).window.is_none(),
        "another predecessor than the one in force"
    );

    let mut bench = Bench::new();
    bench.roster.participants[0].incarnation = 2;
    bench.pending = bench.offer(1, 8, 4, WindowId::NONE);
    assert!(
        bench.scans(9).window.is_none(),
        "a planner that is not the live one"
    );

    let mut bench = Bench::new();
    bench.pending = bench.offer(1, 8, 0, WindowId::NONE);
    assert!(bench.scans(9).window.is_none(), "no setpoints");
}

#[test]
fn a_second_window_while_one_is_pending_is_void() {
    let mut bench = Bench::new();
    let first = bench.offer(1, 8, 4, WindowId::NONE);
    bench.pending = first;
    let second = bench.offer(2, 8, 4, WindowId::NONE);
    assert_eq!(bench.side.feedback().voided, second);
    assert_eq!(bench.scans(8).window, first);
}

#[test]
fn after_a_stop_no_window_is_admitted_and_the_run_ends_at_rest() {
    let mut bench = Bench::new();
    let first = bench.offer(1, 8, 40, WindowId::NONE);
    bench.pending = first;
    bench.scans(10);
    let answer = bench.side.order(&OperatorRequest {
        order: Order::Stop as u32,
        ..OperatorRequest::zeroed()
    });
    assert_eq!((answer.accepted, answer.mode), (1, Mode::Stopping as u32));
    bench.pending = bench.offer(2, 16, 40, first);
    let feedback = bench.scans(10);
    assert_eq!(
        feedback.window, first,
        "the window in force is executed to its end"
    );
    assert_eq!(mode(&feedback), Mode::Stopping);
    let feedback = bench.scans(40);
    assert_eq!(mode(&feedback), Mode::Stopped);
    let feedback = bench.scans(200);
    assert_eq!(feedback.last, 1);
}

#[test]
fn an_order_that_is_none_is_refused() {
    let mut bench = Bench::new();
    for (order, value) in [
        (0, 0.0),
        (99, 0.0),
        (Order::Override as u32, f64::NAN),
        (Order::Override as u32, 300.0),
    ] {
        let answer = bench.side.order(&OperatorRequest {
            order,
            value,
            ..OperatorRequest::zeroed()
        });
        assert_eq!(answer.accepted, 0, "order {order} with {value}");
    }
    assert_eq!(mode(&bench.side.feedback()), Mode::Enabled);
}

#[test]
fn while_tripped_the_command_position_follows_the_encoder() {
    let mut bench = Bench::new();
    for _ in 0..50 {
        bench.scan(|answers| {
            for commands in answers.commands.iter_mut().take(AXES) {
                if let Some(command) = &mut commands[0] {
                    command.velocity_mm_s = 20.0;
                }
            }
        });
    }
    bench.roster.participants[1].live = 0;
    let feedback = bench.scan(|answers| answers.commands[0][0] = None);
    assert_eq!(mode(&feedback), Mode::Tripped);
    let mut moved = false;
    for _ in 0..100 {
        let feedback = bench.scan(|_| {});
        for axis in feedback.axes() {
            moved |= axis.velocity_mm_s.abs() > 1.0;
            assert_eq!(axis.command_position, axis.motor_position);
        }
    }
    assert!(moved, "the axes braked for a while");
    let feedback = bench.side.feedback();
    assert!(
        feedback
            .axes()
            .iter()
            .all(|axis| axis.velocity_mm_s.abs() < 0.5),
        "and stand"
    );
}

/// The state an order comes in.
#[derive(Debug, Clone, Copy, PartialEq)]
enum State {
    Moving,
    Held,
    Stopping,
    Stopped,
    Jogging,
    Disabled,
    Tripped,
    Finished,
}

fn order(bench: &mut Bench, order: Order, axis: u32, value: f64) -> Refused {
    let answer = bench.side.order(&OperatorRequest {
        order: order as u32,
        axis,
        value,
        ..OperatorRequest::zeroed()
    });
    let reason = Refused::from_wire(answer.reason).expect("a known reason");
    assert_eq!(answer.accepted == 1, reason == Refused::Not);
    reason
}

fn in_state(state: State) -> Bench {
    bring_into(Bench::new(), state)
}

/// From before the first window of its program.
fn bring_into(mut bench: Bench, state: State) -> Bench {
    let first_scan = bench.side.scan().next_multiple_of(8) + 8;
    let id = bench.offer(1, first_scan, 40, WindowId::NONE);
    bench.pending = id;
    bench.scans(if state == State::Moving || state == State::Stopping {
        20
    } else {
        200
    });
    let mut accepted =
        |o: Order, value: f64| assert_eq!(order(&mut bench, o, 0, value), Refused::Not);
    match state {
        State::Moving => {}
        State::Held => accepted(Order::Hold, 0.0),
        State::Stopping => accepted(Order::Stop, 0.0),
        State::Stopped => {
            accepted(Order::Stop, 0.0);
            bench.scans(2);
        }
        State::Jogging => {
            accepted(Order::Hold, 0.0);
            accepted(Order::Jog, 1.0);
        }
        State::Disabled => {
            accepted(Order::Hold, 0.0);
            accepted(Order::Disable, 0.0);
        }
        State::Tripped => {
            bench.roster.participants[1].live = 0;
            bench.scan(|answers| answers.commands[0][0] = None);
        }
        State::Finished => {
            bench.offer_end();
            bench.scans(60);
            assert_eq!(mode(&bench.side.feedback()), Mode::Finished);
        }
    }
    bench
}

impl Bench {
    /// A window that ends the program where the machine is.
    fn offer_end(&mut self) {
        let feedback = self.side.feedback();
        let mut setpoints = [Setpoint::zeroed(); 4];
        for setpoint in &mut setpoints {
            setpoint.position = feedback.path_positions();
        }
        let header = WindowHeader {
            id: WindowId {
                checksum: 7,
                sequence: 7,
                incarnation: 1,
            },
            predecessor: feedback.window,
            first_scan: (feedback.scan + 2).next_multiple_of(8),
            visible_from: feedback.scan,
            intended_setpoints: 1,
            setpoint_count: 4,
            ends_program: 1,
            ..WindowHeader::zeroed()
        };
        self.side.offer(&header, &setpoints, &self.roster);
        self.pending = header.id;
    }
}

/// The table of docs/reference/orders.md, as far as orders are refused.
#[test]
fn orders_are_refused_in_the_states_they_make_no_sense_in_and_nothing_is_latched() {
    use Refused::{DrivesOff, Finished, Jogging, Not, NotAtRest, NotHeld, NotReady, Tripped};
    let orders = [
        (Order::Hold, 0.0),
        (Order::Resume, 0.0),
        (Order::Stop, 0.0),
        (Order::Disable, 0.0),
        (Order::Enable, 0.0),
        (Order::Jog, 2.0),
    ];
    for (state, expected) in [
        (State::Moving, [Not, Not, Not, NotHeld, Not, NotHeld]),
        (State::Held, [Not, Not, Not, Not, Not, Not]),
        (
            State::Stopping,
            [Not, NotAtRest, Not, NotAtRest, Not, NotAtRest],
        ),
        (State::Stopped, [Not, Not, Not, Not, Not, Not]),
        (State::Jogging, [Not, Jogging, Not, Jogging, Not, Not]),
        (State::Disabled, [Not, DrivesOff, Not, Not, Not, DrivesOff]),
        // No servo follows these axes, so nobody can acknowledge the trip; a run that waits in it may be ended.
        (
            State::Tripped,
            [Tripped, Tripped, Not, Tripped, NotReady, Tripped],
        ),
        (State::Finished, [Finished; 6]),
    ] {
        for ((what, value), expected) in orders.into_iter().zip(expected) {
            let mut bench = in_state(state);
            let before = bench.side.feedback();
            let found = order(&mut bench, what, 0, value);
            assert_eq!(found, expected, "{} while {state:?}", what.word());
            if found != Not {
                assert_eq!(
                    bench.side.feedback(),
                    before,
                    "{} while {state:?}",
                    what.word()
                );
            }
        }
    }
}

#[test]
fn a_jog_of_nothing_of_no_axis_or_beyond_the_travel_is_refused_with_what_is_allowed() {
    let mut bench = in_state(State::Held);
    for (axis, value, expected) in [
        (0, 0.0, Refused::BadValue),
        (0, f64::NAN, Refused::BadValue),
        (0, f64::INFINITY, Refused::BadValue),
        (0, 1e-7, Refused::BadValue),
        (2, 1.0, Refused::UnknownAxis),
        (u32::MAX, 1.0, Refused::UnknownAxis),
        (0, 220.001, Refused::BeyondTravel),
        (1, -1e300, Refused::BeyondTravel),
    ] {
        assert_eq!(
            order(&mut bench, Order::Jog, axis, value),
            expected,
            "{axis} {value}"
        );
    }
    let answer = bench.side.order(&OperatorRequest {
        order: Order::Jog as u32,
        axis: 1,
        value: 200.0,
        ..OperatorRequest::zeroed()
    });
    let command_mm = bench.side.feedback().axes[1].command_position as f64 * 1e-6;
    assert!((answer.allowed_min_mm - (-150.0 - command_mm)).abs() < 1e-9);
    assert!((answer.allowed_max_mm - (150.0 - command_mm)).abs() < 1e-9);
    assert_eq!(
        order(&mut bench, Order::Jog, 1, answer.allowed_max_mm),
        Refused::Not
    );
}

#[test]
fn a_jog_voids_the_windows_begins_an_epoch_keeps_the_place_and_ends_in_hold() {
    let mut bench = in_state(State::Held);
    let before = bench.side.feedback();
    assert_eq!(order(&mut bench, Order::Jog, 1, 2.0), Refused::Not);
    let feedback = bench.scans(1);
    assert_eq!(mode(&feedback), Mode::Jogging);
    assert!(feedback.window.is_none() && feedback.tag.is_off_path());
    assert_eq!(feedback.epoch, before.epoch + 1);
    assert_eq!(feedback.interrupted_at, before.tag);
    let target = before.axes[1].command_position + 2_000_000;
    let driver = |feedback: &Feedback| feedback.axes.map(|axis| axis.driver);
    assert_eq!((driver(&feedback)[0], driver(&feedback)[1]), (0, 1));
    let feedback = bench.scans_by_hand(500);
    assert_eq!(feedback.axes[1].command_position, target);
    assert_eq!((mode(&feedback), feedback.hold), (Mode::Enabled, 1));
    // In a hold the program's controllers drive again at once: the planner sends them windows.
    assert_eq!(driver(&feedback)[1], Driver::Program as u32);
}

#[test]
fn a_stop_in_a_jog_is_done_when_the_axis_rests_and_a_jog_that_never_ends_trips() {
    let mut bench = in_state(State::Jogging);
    assert_eq!(order(&mut bench, Order::Stop, 0, 0.0), Refused::Not);
    let feedback = bench.scans(50);
    assert_eq!(mode(&feedback), Mode::Stopping);
    let feedback = bench.scans_by_hand(5);
    assert_eq!(mode(&feedback), Mode::Stopped);

    let mut bench = in_state(State::Jogging);
    let feedback = bench.scans(6000);
    assert_eq!(
        (mode(&feedback), cause(&feedback)),
        (Mode::Tripped, Cause::NotInPosition)
    );
    assert_eq!(feedback.axes[0].driver, Driver::Program as u32);
}

#[test]
fn a_stop_without_drives_lets_the_run_end() {
    let mut bench = in_state(State::Disabled);
    assert_eq!(bench.scans(300).last, 0);
    assert_eq!(order(&mut bench, Order::Stop, 0, 0.0), Refused::Not);
    let feedback = bench.scans(200);
    assert_eq!((mode(&feedback), feedback.last), (Mode::Disabled, 1));
}

/// How far the program of a cell that stays up is, and what its machine does.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Stays {
    Ready(ProgramState),
    ReadyInHold,
    DrivesOff,
    JogsWithoutProgram,
    TrippedWithoutProgram,
    /// With a program that was started.
    Running(State),
    Ending,
}

impl Bench {
    /// What a planner says that has read the program of this number, or refuses it.
    fn planner_says(&mut self, load: u32, cause: Cause) {
        let scan = self.side.scan();
        self.scan(|answers| {
            answers.planner = Some(PlannerStatus {
                scan,
                visible_from: scan + 1,
                incarnation: 1,
                load,
                cause: cause as u32,
                ..PlannerStatus::zeroed()
            });
        });
    }

    fn load(&mut self, number: u32) {
        assert_eq!(order(self, Order::Load, 0, f64::from(number)), Refused::Not);
        self.planner_says(number, Cause::None);
    }

    fn program(&self) -> ProgramState {
        ProgramState::from_wire(self.side.feedback().program).expect("a known state")
    }
}

fn staying(state: Stays) -> Bench {
    let mut bench = Bench::of(RunEnd::WhenOrdered);
    bench.scans(50);
    match state {
        Stays::Ready(ProgramState::None) => {}
        Stays::Ready(ProgramState::Loading) => {
            assert_eq!(order(&mut bench, Order::Load, 0, 1.0), Refused::Not);
        }
        Stays::Ready(ProgramState::Done) => {
            bench.load(1);
            assert_eq!(order(&mut bench, Order::Start, 0, 0.0), Refused::Not);
            bench = bring_into(bench, State::Finished);
            bench.scans(200);
        }
        Stays::Ready(_) => bench.load(1),
        Stays::ReadyInHold => {
            bench.load(1);
            assert_eq!(order(&mut bench, Order::Hold, 0, 0.0), Refused::Not);
        }
        Stays::DrivesOff => assert_eq!(order(&mut bench, Order::Disable, 0, 0.0), Refused::Not),
        Stays::JogsWithoutProgram => {
            assert_eq!(order(&mut bench, Order::Jog, 0, 1.0), Refused::Not);
        }
        Stays::TrippedWithoutProgram => {
            bench.roster.participants[1].live = 0;
            bench.scan(|answers| answers.commands[0][0] = None);
        }
        Stays::Running(state) => {
            bench.load(1);
            assert_eq!(order(&mut bench, Order::Start, 0, 0.0), Refused::Not);
            bench = bring_into(bench, state);
        }
        Stays::Ending => {
            bench.load(1);
            assert_eq!(order(&mut bench, Order::Start, 0, 0.0), Refused::Not);
            bench = bring_into(bench, State::Moving);
            assert_eq!(order(&mut bench, Order::Down, 0, 0.0), Refused::Not);
        }
    }
    bench
}

/// The same table for a cell that stays up: every order in every state.
#[test]
#[expect(clippy::too_many_lines, reason = "a table of orders and states")]
fn in_a_cell_that_stays_every_order_is_judged_by_the_state_it_comes_in() {
    use Refused::{
        DrivesOff, Ending, Finished, Jogging, Loading, NoProgram, Not, NotAtRest, NotHeld,
        NotReady, NotRunning, Running, Tripped,
    };
    let orders = [
        (Order::Hold, 0.0),
        (Order::Resume, 0.0),
        (Order::Stop, 0.0),
        (Order::Override, 50.0),
        (Order::Disable, 0.0),
        (Order::Enable, 0.0),
        (Order::Jog, 2.0),
        (Order::Load, 2.0),
        (Order::Start, 0.0),
        (Order::Down, 0.0),
    ];
    let ready = |start| [Not, NotRunning, Not, Not, Not, Not, Not, Not, start, Not];
    let off = [
        Not, DrivesOff, Not, Not, Not, Not, DrivesOff, Not, DrivesOff, Not,
    ];
    let tripped = [
        Tripped, NotReady, Not, Not, Tripped, NotReady, Tripped, Tripped, Tripped, Not,
    ];
    let jogging = [
        Not, Jogging, Not, Not, Jogging, Not, Not, Jogging, Jogging, Not,
    ];
    let stopping = |load, start| {
        [
            Not, NotAtRest, Not, Not, NotAtRest, Not, NotAtRest, load, start, Not,
        ]
    };
    for (state, expected) in [
        (Stays::Ready(ProgramState::None), ready(NoProgram)),
        (Stays::Ready(ProgramState::Loading), ready(Loading)),
        (Stays::Ready(ProgramState::Loaded), ready(Not)),
        (Stays::Ready(ProgramState::Done), ready(Not)),
        (Stays::ReadyInHold, [Not; 10]),
        (Stays::DrivesOff, off),
        (Stays::JogsWithoutProgram, jogging),
        (Stays::TrippedWithoutProgram, tripped),
        (
            Stays::Running(State::Moving),
            [
                Not, Not, Not, Not, NotHeld, Not, NotHeld, Running, Running, Not,
            ],
        ),
        (
            Stays::Running(State::Held),
            [Not, Not, Not, Not, Not, Not, Not, Running, Running, Not],
        ),
        (
            Stays::Running(State::Stopping),
            stopping(NotAtRest, Running),
        ),
        (
            Stays::Running(State::Stopped),
            [Not, Not, Not, Not, Not, Not, Not, Not, Running, Not],
        ),
        (Stays::Running(State::Jogging), jogging),
        (Stays::Running(State::Disabled), off),
        (Stays::Running(State::Tripped), tripped),
        (
            Stays::Running(State::Finished),
            [
                Finished, Finished, Not, Not, Finished, Finished, Finished, NotAtRest, NotAtRest,
                Not,
            ],
        ),
        (
            Stays::Ending,
            [
                Not, Ending, Not, Not, Ending, Ending, Ending, Ending, Ending, Not,
            ],
        ),
    ] {
        for ((what, value), expected) in orders.into_iter().zip(expected) {
            let mut bench = staying(state);
            let before = bench.side.feedback();
            let found = order(&mut bench, what, 0, value);
            assert_eq!(found, expected, "{} while {state:?}", what.word());
            if found != Not {
                let now = bench.side.feedback();
                assert_eq!(now, before, "{} while {state:?}", what.word());
            }
        }
    }
}

#[test]
fn a_program_is_loaded_started_done_and_started_again() {
    let mut bench = staying(Stays::Ready(ProgramState::None));
    assert_eq!(bench.program(), ProgramState::None);
    bench.load(3);
    assert_eq!(bench.program(), ProgramState::Loaded);
    for run in 1..=2 {
        assert_eq!(order(&mut bench, Order::Start, 0, 0.0), Refused::Not);
        let started = bench.side.feedback();
        assert_eq!((started.run, started.load), (run, 3));
        assert_eq!(mode(&started), Mode::Enabled);
        assert!(started.interrupted_at.is_off_path() && started.window.is_none());
        bench = bring_into(bench, State::Finished);
        let after = bench.scans(200);
        assert_eq!(mode(&after), Mode::Ready);
        assert_eq!(bench.program(), ProgramState::Done);
        assert_eq!(after.last, 0, "the cell stays");
    }
}

#[test]
fn a_program_that_the_planner_refuses_is_not_loaded_and_another_one_can_be() {
    let mut bench = staying(Stays::Ready(ProgramState::Loading));
    bench.planner_says(7, Cause::Planner);
    assert_eq!(
        bench.program(),
        ProgramState::Loading,
        "published of another one"
    );
    bench.planner_says(1, Cause::Planner);
    assert_eq!(bench.program(), ProgramState::None);
    let refused = bench.side.feedback();
    assert_eq!(
        (mode(&refused), cause(&refused)),
        (Mode::Ready, Cause::Planner)
    );
    assert_eq!(order(&mut bench, Order::Start, 0, 0.0), Refused::NoProgram);
    assert_eq!(order(&mut bench, Order::Load, 0, 1.0), Refused::BadValue);
    bench.load(2);
    assert_eq!(bench.program(), ProgramState::Loaded);
    assert_eq!(cause(&bench.side.feedback()), Cause::None);
}

#[test]
fn a_program_that_was_stopped_is_given_up_for_another_and_nothing_of_its_path_is_left() {
    let mut bench = staying(Stays::Running(State::Stopped));
    assert!(!bench.side.feedback().interrupted_at.is_off_path());
    bench.load(2);
    let loaded = bench.side.feedback();
    assert_eq!(mode(&loaded), Mode::Ready);
    assert!(loaded.window.is_none() && loaded.interrupted_at.is_off_path());
    assert_eq!(loaded.program_hash, 0);
}

#[test]
fn a_trip_without_a_program_ends_in_readiness_and_one_in_a_program_in_hold() {
    for (state, expected, hold) in [
        (Stays::TrippedWithoutProgram, Mode::Ready, 0),
        (Stays::Running(State::Tripped), Mode::Enabled, 1),
    ] {
        let mut bench = staying(state);
        bench.roster.participants[1].live = 1;
        bench.scans(2000);
        assert_eq!(order(&mut bench, Order::Enable, 0, 0.0), Refused::Not);
        let feedback = bench.side.feedback();
        assert_eq!((mode(&feedback), feedback.hold), (expected, hold));
    }
}

#[test]
fn a_cell_that_is_ordered_to_end_comes_to_rest_first_in_every_state() {
    for state in [
        Stays::Ready(ProgramState::Loaded),
        Stays::DrivesOff,
        Stays::JogsWithoutProgram,
        Stays::TrippedWithoutProgram,
        Stays::Running(State::Moving),
        Stays::Running(State::Held),
        Stays::Running(State::Tripped),
        Stays::Running(State::Disabled),
        Stays::Running(State::Finished),
    ] {
        let mut bench = staying(state);
        assert_eq!(order(&mut bench, Order::Down, 0, 0.0), Refused::Not);
        let mut last = bench.side.feedback();
        for _ in 0..3000 {
            last = bench.scans_by_hand(1);
            if last.last == 1 {
                break;
            }
        }
        assert_eq!(last.last, 1, "{state:?} does not end");
        assert!(
            last.axes()
                .iter()
                .all(|axis| axis.velocity_mm_s.abs() < 0.5)
        );
    }
}

/// Whoever was ordered to end ends, whatever else dies, moves or is asked on the way to rest.
#[test]
fn a_cell_that_trips_on_its_way_to_the_end_ends_all_the_same() {
    let mut bench = staying(Stays::Ending);
    bench.roster.participants[1].live = 0;
    let trips = |_| mode(&bench.scan(|answers| answers.commands[0][0] = None)) == Mode::Tripped;
    assert!((0..MAX_WINDOW_SETPOINTS).any(trips));
    bench.roster.participants[1].live = 1;
    assert_eq!(order(&mut bench, Order::Enable, 0, 0.0), Refused::Ending);
    let ended = (0..5000).any(|_| bench.scan(|_| {}).last == 1);
    assert!(ended);
}

#[test]
fn a_stop_of_a_tripped_machine_is_not_forgotten_when_its_servo_comes_back() {
    let mut bench = staying(Stays::Running(State::Tripped));
    assert_eq!(order(&mut bench, Order::Stop, 0, 0.0), Refused::Not);
    assert_eq!(bench.side.feedback().hold, 1);
}

#[test]
fn a_planner_that_comes_back_and_refuses_what_was_loaded_leaves_nothing_to_start() {
    let mut bench = staying(Stays::Ready(ProgramState::Done));
    bench.planner_says(1, Cause::Planner);
    assert_eq!(bench.program(), ProgramState::None);
    assert_eq!(order(&mut bench, Order::Start, 0, 0.0), Refused::NoProgram);
}

/// How typed-in blocks end.
#[derive(Debug, Clone, Copy, PartialEq)]
enum TypedEnd {
    RefusedByPlanner,
    StoppedWhileRead,
    JoggedWhileRead,
    Done,
    Stopped,
    Disabled,
    Tripped,
    Reset,
    NewMaster,
}

const TYPED_ENDS: [TypedEnd; 9] = [
    TypedEnd::RefusedByPlanner,
    TypedEnd::StoppedWhileRead,
    TypedEnd::JoggedWhileRead,
    TypedEnd::Done,
    TypedEnd::Stopped,
    TypedEnd::Disabled,
    TypedEnd::Tripped,
    TypedEnd::Reset,
    TypedEnd::NewMaster,
];

/// Loads typed-in blocks as number 5, with the program from before as number 6.
fn type_in(bench: &mut Bench) -> Refused {
    let loaded = bench.side.feedback().load;
    let answer = bench.side.order(&OperatorRequest {
        order: Order::Load as u32,
        value: 5.0,
        session: loaded + 1,
        deadline_scans: 6,
        ..OperatorRequest::zeroed()
    });
    Refused::from_wire(answer.reason).expect("a known reason")
}

fn end_typed(mut bench: Bench, end: TypedEnd) -> Bench {
    let accepted = |bench: &mut Bench, what, value| {
        assert_eq!(order(bench, what, 0, value), Refused::Not, "{end:?}");
    };
    match end {
        TypedEnd::RefusedByPlanner => bench.planner_says(5, Cause::Planner),
        TypedEnd::StoppedWhileRead => accepted(&mut bench, Order::Stop, 0.0),
        TypedEnd::JoggedWhileRead => accepted(&mut bench, Order::Jog, 1.0),
        _ => {
            bench.planner_says(5, Cause::None);
            let begun = bench.side.feedback();
            assert_eq!((mode(&begun), begun.run), (Mode::Enabled, 1), "{end:?}");
        }
    }
    let state = match end {
        TypedEnd::Done => State::Finished,
        TypedEnd::Stopped => State::Stopped,
        TypedEnd::Disabled => State::Disabled,
        TypedEnd::Tripped => State::Tripped,
        TypedEnd::Reset | TypedEnd::NewMaster => State::Held,
        _ => {
            bench.scans(2);
            return bench;
        }
    };
    bench = bring_into(bench, state);
    if end == TypedEnd::Reset {
        bench.scans(100);
        assert_eq!(order(&mut bench, Order::Start, 0, 0.0), Refused::Running);
        accepted(&mut bench, Order::Reset, 0.0);
    }
    if end == TypedEnd::NewMaster {
        let latches = bench.side.latches();
        bench = Bench::of(RunEnd::WhenOrdered);
        bench.side.resume(&latches);
    }
    bench.scans(2000);
    bench
}

#[test]
fn however_typed_in_blocks_end_the_cell_goes_back_to_the_program_from_before_and_starts_no_other() {
    for end in TYPED_ENDS {
        for has_program in [true, false] {
            let before = match has_program {
                true => ProgramState::Loaded,
                false => ProgramState::None,
            };
            let mut bench = staying(Stays::Ready(before));
            assert_eq!(type_in(&mut bench), Refused::Not);
            assert_eq!(order(&mut bench, Order::Start, 0, 0.0), Refused::Loading);
            bench = end_typed(bench, end);
            let what = format!("{end:?}, a program before: {has_program}");
            assert_eq!(bench.side.feedback().hold, 0, "{what}");
            let run = bench.side.feedback().run;
            if !has_program {
                assert_eq!(bench.program(), ProgramState::None, "{what}");
                assert_ne!(order(&mut bench, Order::Start, 0, 0.0), Refused::Not);
                assert_eq!(bench.side.feedback().run, run, "{what}");
                continue;
            }
            let over = (bench.side.feedback().load, bench.program());
            assert_eq!(over, (6, ProgramState::Loading), "{what}");
            assert_ne!(order(&mut bench, Order::Start, 0, 0.0), Refused::Not);
            bench.planner_says(6, Cause::None);
            bench.scans(2);
            let over = (bench.side.feedback().load, bench.program());
            assert_eq!(over, (6, ProgramState::Loaded), "{what}");
            assert_eq!(bench.side.feedback().run, run, "{what}");
        }
    }
}

#[test]
fn typed_in_blocks_are_refused_beside_another_program_than_the_one_that_they_were_typed_behind() {
    let mut bench = staying(Stays::Ready(ProgramState::Loaded));
    let request = |session, deadline_scans| OperatorRequest {
        order: Order::Load as u32,
        value: 5.0,
        session,
        deadline_scans,
        ..OperatorRequest::zeroed()
    };
    for (session, before) in [(1, 6), (3, 6), (2, 5), (2, 4)] {
        let answer = bench.side.order(&request(session, before));
        assert_eq!(
            answer.reason,
            Refused::BadValue as u32,
            "{session} {before}"
        );
    }
    assert_eq!(type_in(&mut bench), Refused::Not);
    for state in [
        Stays::Ready(ProgramState::Loading),
        Stays::Running(State::Stopped),
        Stays::Running(State::Held),
        Stays::DrivesOff,
    ] {
        let mut bench = staying(state);
        assert_ne!(type_in(&mut bench), Refused::Not, "{state:?}");
    }
}
