//! The switch between the two servos of an axis, and the way out of a trip: each guard has a test that goes red without it.

use bus::sample::{
    AxisCommand, Cause, Feedback, Job, Mode, OperatorRequest, OperatorResponse, Order, Participant,
    Redundancy, Refused, Roster, WindowId,
};
use bytemuck::Zeroable;
use machine::{AfterLoss, AfterStandby, Machine, WithinPeriod};
use master::{Answers, Master, RunEnd};
use plant_sim::SimulatedDrives;
use plant_sim::plant_file::PlantFile;

/// One axis with two servos, the other with one.
struct Bench {
    side: Master<SimulatedDrives>,
    roster: Roster,
}

const A: usize = 1;
const B: usize = 2;
const OTHER_AXIS: usize = 3;

impl Bench {
    fn after(servo: AfterLoss) -> Bench {
        Self::after_losses(servo, AfterStandby::GoOn)
    }

    fn after_losses(servo: AfterLoss, standby: AfterStandby) -> Bench {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let mut machine = Machine::load(&folder).expect("the machine");
        machine.restart.servo = servo;
        machine.restart.standby = standby;
        machine.axes[0].standby = true;
        // Its axes move without a window: its servos are the kind whose positions nobody can hold against one.
        machine.interpolation.within_period = WithinPeriod::Linear;
        let plant = PlantFile::load(&folder).expect("the plant");
        let simulations = plant.simulations(&machine).expect("axes");
        let mut roster = Roster::zeroed();
        let places = [
            (Job::Planner, 0, 0),
            (Job::Servo, 0, 0),
            (Job::Servo, 0, 1),
            (Job::Servo, 1, 0),
        ];
        for (place, (job, axis, role)) in roster.participants.iter_mut().zip(places) {
            *place = Participant {
                job: job as u32,
                axis,
                role,
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
                RunEnd::AfterProgram,
            ),
            roster,
        }
    }

    fn new() -> Bench {
        Self::after(AfterLoss::Wait)
    }

    /// One scan in which everybody who lives says the same; `change` may spoil it.
    fn scan(&mut self, change: impl FnOnce(&mut Answers)) -> Feedback {
        let feedback = self.side.feedback();
        let mut answers = Answers::of_axes(bus::sample::MAX_AXES);
        for place in self.roster.participants.iter().filter(|p| p.live == 1) {
            if place.job != Job::Servo as u32 {
                continue;
            }
            let axis = place.axis as usize;
            answers.commands[axis][place.role as usize] = Some(AxisCommand {
                scan: feedback.scan,
                visible_from: feedback.scan + 1,
                position: feedback.axes[axis].command_position,
                velocity_mm_s: 0.001 * feedback.scan as f64,
                stop_deceleration_mm_s2: 1000.0,
                axis: place.axis,
                role: place.role,
                incarnation: place.incarnation,
                ..AxisCommand::zeroed()
            });
        }
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

    fn order(&mut self, order: Order) -> Refused {
        let answer = self.side.order(&OperatorRequest::of(order));
        Refused::from_wire(answer.reason).expect("a known reason")
    }

    fn jog(&mut self, distance_mm: f64) -> OperatorResponse {
        self.side.order(&OperatorRequest {
            order: Order::Jog as u32,
            value: distance_mm,
            ..OperatorRequest::default()
        })
    }

    /// Both servos of the first axis are lost while it moves a little; ten scans later it stands.
    fn tripped(servo: AfterLoss) -> Bench {
        let mut bench = Bench::after(servo);
        bench.scans(20);
        bench.roster.participants[A].live = 0;
        bench.roster.participants[B].live = 0;
        let feedback = bench.scans(1);
        assert_eq!(feedback.mode, Mode::Tripped as u32);
        assert_eq!(feedback.cause, Cause::ServoLost as u32);
        assert_eq!(feedback.cause_axis, 0);
        bench.scans(30);
        bench
    }

    fn bring_back(&mut self, place: usize) {
        let participant = &mut self.roster.participants[place];
        participant.live = 1;
        participant.incarnation += 1;
    }
}

fn spoil(command: &mut Option<AxisCommand>, change: impl FnOnce(&mut AxisCommand)) {
    change(command.as_mut().expect("it lives"));
}

#[test]
fn a_standby_takes_over_in_the_scan_in_which_the_active_servo_is_silent_and_keeps_the_axis() {
    let mut bench = Bench::new();
    bench.scans(10);
    let feedback = bench.scan(|answers| answers.commands[0][0] = None);
    assert_eq!(feedback.axes[0].taken_role, 1);
    assert_eq!(feedback.axes[0].missed_scans, 0);
    assert_eq!(feedback.mode, Mode::Enabled as u32);
    assert_eq!(
        feedback.axes[0].command_scan + 1,
        feedback.scan,
        "the command of this very scan"
    );
    // The other is back: it stands by, and does not take the axis again.
    assert_eq!(bench.scans(5).axes[0].taken_role, 1);
    assert_eq!(
        bench.scan(|answers| answers.commands[0][1] = None).axes[0].taken_role,
        0
    );
}

#[test]
fn a_standby_takes_over_from_a_servo_that_died_or_says_what_no_drive_may_see() {
    let mut bench = Bench::new();
    bench.scans(10);
    let feedback = bench.scan(|answers| {
        spoil(&mut answers.commands[0][0], |c| c.velocity_mm_s = f64::NAN);
    });
    assert_eq!((feedback.axes[0].taken_role, feedback.cause), (1, 0));
    let mut bench = Bench::new();
    bench.scans(10);
    bench.roster.participants[A].live = 0;
    let feedback = bench.scans(1);
    assert_eq!((feedback.axes[0].taken_role, feedback.cause), (1, 0));
}

#[test]
fn a_standby_that_was_not_the_same_to_the_bit_for_two_scans_does_not_take_over() {
    for (same_scans, takes_over) in [(0, false), (1, false), (2, true), (3, true)] {
        let mut bench = Bench::new();
        bench.scans(10);
        bench.scan(|answers| {
            spoil(&mut answers.commands[0][1], |c| {
                c.state[95] = 1;
            });
        });
        bench.scans(same_scans);
        let feedback = bench.scan(|answers| answers.commands[0][0] = None);
        assert_eq!(
            feedback.axes[0].taken_role,
            u32::from(takes_over),
            "{same_scans} scans"
        );
        assert_eq!(
            feedback.axes[0].missed_scans,
            u32::from(!takes_over),
            "{same_scans} scans"
        );
    }
}

#[test]
fn a_standby_that_does_not_hold_the_window_in_force_does_not_take_over() {
    let mut bench = Bench::new();
    bench.scans(10);
    let other = WindowId {
        checksum: 1,
        sequence: 1,
        incarnation: 1,
    };
    let feedback = bench.scan(|answers| {
        answers.commands[0][0] = None;
        spoil(&mut answers.commands[0][1], |c| c.held = other);
    });
    assert_eq!(feedback.axes[0].missed_scans, 1);
    // Nor one that held another before, as long as it did.
    let mut bench = Bench::new();
    for _ in 0..10 {
        bench.scan(|answers| spoil(&mut answers.commands[0][1], |c| c.held = other));
    }
    let feedback = bench.scan(|answers| answers.commands[0][0] = None);
    assert_eq!(feedback.axes[0].missed_scans, 1);
}

#[test]
fn after_a_switch_the_next_one_needs_two_scans_again() {
    let mut bench = Bench::new();
    bench.scans(10);
    bench.scan(|answers| answers.commands[0][0] = None);
    let feedback = bench.scan(|answers| answers.commands[0][1] = None);
    assert_eq!(feedback.axes[0].taken_role, 1, "the drive holds its last");
    assert_eq!(feedback.axes[0].missed_scans, 1);
}

#[test]
fn a_standby_with_nonsense_of_its_own_disturbs_nobody_and_does_not_take_over() {
    let mut bench = Bench::new();
    for _ in 0..10 {
        let feedback = bench.scan(|answers| {
            spoil(&mut answers.commands[0][1], |c| c.torque_nm = f64::INFINITY);
        });
        assert_eq!((feedback.cause, feedback.axes[0].missed_scans), (0, 0));
    }
    let feedback = bench.scan(|answers| answers.commands[0][0] = None);
    assert_eq!(feedback.axes[0].missed_scans, 1);
}

#[test]
fn commands_of_another_scan_axis_role_or_incarnation_are_none() {
    let changes: [fn(&mut AxisCommand); 4] = [
        |c| c.scan -= 1,
        |c| c.axis += 1,
        |c| c.role = 1 - c.role,
        |c| c.incarnation += 1,
    ];
    for change in changes {
        let mut bench = Bench::new();
        bench.scans(10);
        let feedback = bench.scan(|answers| spoil(&mut answers.commands[1][0], change));
        assert_eq!(feedback.axes[1].missed_scans, 1);
        assert_eq!(feedback.axes[1].missed_in_a_row, 1);
    }
}

#[test]
fn without_a_servo_the_machine_waits_and_is_ready_again_only_with_one_on_every_axis() {
    let mut bench = Bench::tripped(AfterLoss::Wait);
    assert_eq!(bench.order(Order::Resume), Refused::NotReady);
    assert_eq!(bench.order(Order::Enable), Refused::NotReady);
    // The other axis alone is not enough, and a servo in the roster that says nothing is none.
    bench.bring_back(B);
    bench.scan(|answers| answers.commands[0][1] = None);
    assert_eq!(bench.order(Order::Resume), Refused::NotReady);
    // One that has something to complain of is none either.
    bench.scan(|answers| {
        spoil(&mut answers.commands[0][1], |c| {
            c.cause = Cause::FollowingError as u32;
        });
    });
    assert_eq!(bench.order(Order::Resume), Refused::NotReady);
    bench.scans(2);
    assert_eq!(bench.order(Order::Resume), Refused::Not);
    let feedback = bench.scans(1);
    assert_eq!(feedback.mode, Mode::Enabled as u32);
    assert_eq!((feedback.cause, feedback.cause_axis), (0, u32::MAX));
    assert_eq!(feedback.hold, 0);
    assert_eq!(feedback.last, 0);
    assert_eq!(bench.scans(200).last, 0, "the run goes on");
}

#[test]
fn enable_acknowledges_a_trip_into_hold() {
    let mut bench = Bench::tripped(AfterLoss::Wait);
    bench.bring_back(A);
    bench.scans(2);
    assert_eq!(bench.order(Order::Enable), Refused::Not);
    let feedback = bench.scans(1);
    assert_eq!((feedback.mode, feedback.hold), (Mode::Enabled as u32, 1));
}

#[test]
fn an_axis_that_still_moves_is_not_ready() {
    let mut bench = Bench::new();
    for _ in 0..100 {
        let axes = bench.side.feedback().axes;
        bench.scan(|answers| {
            for command in answers.commands.iter_mut().flatten().flatten() {
                command.position = axes[command.axis as usize].motor_position;
                command.velocity_mm_s = 100.0;
                command.stop_deceleration_mm_s2 = 2000.0;
            }
        });
    }
    bench.roster.participants[OTHER_AXIS].live = 0;
    bench.scans(1);
    bench.bring_back(OTHER_AXIS);
    bench.scans(2);
    assert_eq!(
        bench.order(Order::Resume),
        Refused::NotReady,
        "100 mm/s take 50 ms"
    );
    bench.scans(120);
    assert_eq!(bench.order(Order::Resume), Refused::Not);
}

#[test]
fn a_run_that_is_to_end_with_its_servo_ends_and_one_that_waits_ends_when_it_is_reported_to() {
    let ends_within = |bench: &mut Bench| (0..400).any(|_| bench.scans(1).last == 1);
    assert!(ends_within(&mut Bench::tripped(AfterLoss::End)));
    let mut waiting = Bench::tripped(AfterLoss::Wait);
    assert!(!ends_within(&mut waiting));
    assert_eq!(waiting.order(Order::Stop), Refused::Not);
    assert!(ends_within(&mut waiting));
    waiting.bring_back(A);
    assert_eq!(waiting.order(Order::Enable), Refused::Finished);
}

#[test]
fn a_run_that_ends_with_its_servo_is_not_resumed() {
    let mut bench = Bench::tripped(AfterLoss::End);
    bench.bring_back(A);
    bench.scans(2);
    assert_eq!(bench.order(Order::Resume), Refused::Tripped);
}

#[test]
fn where_the_machine_file_says_so_it_goes_on_by_itself_and_in_the_hold_it_was_in() {
    for held in [false, true] {
        let mut bench = Bench::tripped(AfterLoss::Resume);
        assert_eq!(bench.scans(5).mode, Mode::Tripped as u32);
        let mut bench = if held {
            let mut bench = Bench::after(AfterLoss::Resume);
            assert_eq!(bench.order(Order::Hold), Refused::Not);
            bench.roster.participants[A].live = 0;
            bench.roster.participants[B].live = 0;
            bench.scans(30);
            bench
        } else {
            bench
        };
        bench.bring_back(B);
        let feedback = bench.scans(3);
        assert_eq!(feedback.mode, Mode::Enabled as u32);
        assert_eq!(feedback.hold, u32::from(held));
    }
}

#[test]
fn a_trip_for_another_reason_does_not_go_on_by_itself() {
    let mut bench = Bench::after(AfterLoss::Resume);
    bench.scans(10);
    bench.scan(|answers| {
        for command in answers.commands[0].iter_mut() {
            spoil(command, |c| c.cause = Cause::FollowingError as u32);
        }
    });
    let feedback = bench.scans(50);
    assert_eq!(feedback.mode, Mode::Tripped as u32);
    assert_eq!(feedback.cause, Cause::FollowingError as u32);
    assert_eq!(bench.order(Order::Resume), Refused::Tripped);
}

#[test]
fn a_lost_planner_leaves_a_hold_only_where_it_is_to_wait() {
    for (after, held) in [
        (AfterLoss::Wait, 1),
        (AfterLoss::Resume, 0),
        (AfterLoss::End, 0),
    ] {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let mut machine = Machine::load(&folder).expect("the machine");
        machine.restart.planner = after;
        let plant = PlantFile::load(&folder).expect("the plant");
        let simulations = plant.simulations(&machine).expect("axes");
        let mut bench = Bench::new();
        bench.side = Master::new(
            &machine,
            SimulatedDrives::with_dead_time(simulations, 1),
            1,
            0,
            true,
            RunEnd::AfterProgram,
        );
        bench.scans(3);
        assert_eq!(bench.side.feedback().hold, 0);
        bench.roster.participants[0].live = 0;
        assert_eq!(bench.scans(1).hold, held, "{after:?}");
    }
}

#[test]
fn a_master_goes_on_from_what_another_one_left_with_its_drives_off() {
    let mut bench = Bench::new();
    bench.scans(10);
    bench.side.order(&OperatorRequest {
        order: Order::Override as u32,
        value: 40.0,
        ..OperatorRequest::default()
    });
    bench.side.skip(3);
    bench.side.exchange();
    let latches = bench.side.latches();
    let (high, low) = {
        let instruments = bench.side.exchange();
        (
            instruments.motion_digest_high,
            instruments.motion_digest_low,
        )
    };
    assert_eq!(latches.scan, 10);
    let mut next = Bench::new();
    next.side.resume(&latches);
    let feedback = next.side.feedback();
    assert_eq!(feedback.mode, Mode::Disabled as u32);
    assert_eq!(feedback.cause, Cause::MasterLost as u32);
    assert_eq!((feedback.override_percent, feedback.overrun_scans), (40, 3));
    assert_eq!(feedback.epoch, bench.side.feedback().epoch + 1);
    assert_ne!((high, low), (0, 0));
    assert_eq!(next.side.latches().digest, latches.digest);
    assert_eq!(next.order(Order::Enable), Refused::Not);
    let feedback = next.scans(1);
    assert_eq!((feedback.mode, feedback.hold), (Mode::Enabled as u32, 1));
    assert_eq!(feedback.cause, 0);

    // A stop that was asked for is not forgotten.
    bench.order(Order::Stop);
    let mut next = Bench::new();
    next.side.resume(&bench.side.latches());
    assert!((0..400).any(|_| next.scans(1).last == 1));
}

#[test]
fn an_axis_outside_its_travel_is_jogged_inwards_and_no_program_moves_it() {
    for (min_mm, max_mm, refused, inwards) in [
        (-10.0, 10.0, Refused::Not, None),
        (1.0, 10.0, Refused::OutsideTravel, Some(0.5)),
        (-10.0, -1.0, Refused::OutsideTravel, Some(-0.5)),
    ] {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let mut machine = Machine::load(&folder).expect("the machine");
        let axis = machine.axes.first_mut().expect("an axis");
        (axis.travel_min_mm, axis.travel_max_mm) = (min_mm, max_mm);
        let plant = PlantFile::load(&folder).expect("the plant");
        let simulations = plant.simulations(&machine).expect("axes");
        let mut bench = Bench::new();
        bench.side = Master::new(
            &machine,
            SimulatedDrives::with_dead_time(simulations, 1),
            1,
            0,
            false,
            RunEnd::AfterProgram,
        );
        bench.scans(2);
        let what = format!("{min_mm} to {max_mm} mm");
        assert_eq!(bench.order(Order::Enable), Refused::Not, "{what}");
        bench.scans(100);
        let Some(inwards_mm) = inwards else {
            assert_eq!(bench.order(Order::Resume), refused, "{what}");
            continue;
        };
        assert_eq!(bench.order(Order::Resume), refused, "{what}");
        let outwards = bench.jog(-inwards_mm);
        assert_eq!(outwards.reason, Refused::BeyondTravel as u32, "{what}");
        let room = (outwards.allowed_min_mm, outwards.allowed_max_mm);
        let allowed = if inwards_mm > 0.0 {
            (0.0, 10.0)
        } else {
            (-10.0, 0.0)
        };
        assert_eq!(room, allowed, "{what}");
        assert_eq!(bench.jog(inwards_mm).accepted, 1, "{what}");
    }
}

/// A master that was stopped for a while reads the newest roster alone: the one without the servo passed unseen.
#[test]
fn a_servo_that_was_replaced_unseen_is_lost_all_the_same() {
    let mut bench = Bench::new();
    bench.scans(10);
    bench.bring_back(OTHER_AXIS);
    let feedback = bench.scans(1);
    assert_eq!(feedback.mode, Mode::Tripped as u32);
    assert_eq!(feedback.cause, Cause::ServoLost as u32);
    assert_eq!(feedback.cause_axis, 1);
    // With a standby nothing stops.
    let mut bench = Bench::new();
    bench.scans(10);
    bench.bring_back(A);
    let feedback = bench.scans(1);
    assert_eq!(feedback.mode, Mode::Enabled as u32);
    assert_eq!(feedback.axes[0].taken_role, 1);
    // Once the loops are open the new one is as good as any.
    let mut bench = Bench::tripped(AfterLoss::Resume);
    bench.bring_back(A);
    bench.bring_back(B);
    assert_eq!(bench.scans(5).mode, Mode::Enabled as u32);
}

fn redundancy(feedback: &Feedback) -> (Redundancy, u32) {
    let axis = &feedback.axes[0];
    let state = Redundancy::from_wire(axis.redundancy).expect("a known state");
    (state, axis.unsynchronised_scans)
}

#[test]
fn how_the_standby_is_shows_in_every_scan() {
    let mut bench = Bench::new();
    assert_eq!(redundancy(&bench.scans(1)).0, Redundancy::CatchingUp);
    let feedback = bench.scans(5);
    assert_eq!(redundancy(&feedback), (Redundancy::Synchronised, 0));
    assert_eq!(feedback.axes[1].redundancy, Redundancy::Alone as u32);
    bench.roster.participants[B].live = 0;
    assert_eq!(redundancy(&bench.scans(7)), (Redundancy::Lost, 7));
    bench.bring_back(B);
    assert_eq!(redundancy(&bench.scans(1)), (Redundancy::CatchingUp, 8));
    assert_eq!(redundancy(&bench.scans(4)), (Redundancy::Synchronised, 0));
    // The one that drives dies: the other one has nobody behind it.
    bench.roster.participants[A].live = 0;
    assert_eq!(redundancy(&bench.scans(1)), (Redundancy::Lost, 1));
}

#[test]
fn a_standby_that_says_something_else_after_the_same_is_counted_once_until_it_says_the_same_again()
{
    let mut bench = Bench::new();
    bench.scans(5);
    let differ = |answers: &mut Answers| {
        spoil(&mut answers.commands[0][1], |command| {
            command.velocity_mm_s += 1e-9
        });
    };
    let mut feedback = bench.scan(differ);
    assert_eq!(feedback.axes[0].differences, 1);
    for _ in 0..3 {
        feedback = bench.scan(differ);
    }
    assert_eq!(feedback.axes[0].differences, 1);
    assert_eq!(redundancy(&feedback), (Redundancy::CatchingUp, 4));
    bench.scans(5);
    assert_eq!(bench.scan(differ).axes[0].differences, 2);
    assert_eq!(feedback.mode, Mode::Enabled as u32, "the machine goes on");
}

#[test]
fn where_the_machine_file_says_so_the_loss_of_a_standby_holds_once_and_may_be_resumed() {
    let mut bench = Bench::after_losses(AfterLoss::Wait, AfterStandby::Hold);
    assert_eq!(bench.scans(10).hold, 0);
    bench.roster.participants[B].live = 0;
    assert_eq!(bench.scans(1).hold, 1);
    assert_eq!(bench.order(Order::Resume), Refused::Not);
    assert_eq!(bench.scans(1200).hold, 0, "it has been said");
    // One that lives and never comes into step is no standby either, after a second.
    let mut bench = Bench::after_losses(AfterLoss::Wait, AfterStandby::Hold);
    bench.scans(10);
    let apart = |answers: &mut Answers| {
        spoil(&mut answers.commands[0][1], |command| {
            command.velocity_mm_s += 1e-9
        });
    };
    let held = (0..1100).position(|_| bench.scan(apart).hold == 1);
    assert!(matches!(held, Some(990..=1010)), "{held:?}");
    // By default the program goes on.
    let mut bench = Bench::new();
    bench.scans(10);
    bench.roster.participants[B].live = 0;
    assert_eq!(bench.scans(1200).hold, 0);
}
