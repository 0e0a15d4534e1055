//! Synthetic deaths: what is published of them is what the samples show.

use bus::sample::*;
use bytemuck::Zeroable;
use path::geometry::AxisVector;

use super::faults::{FaultResult, Faults, ProcessResult, Seen};
use crate::test_support::machine;

const SCANS: u64 = 1000;

/// A run that moves all the time until `change` says otherwise.
struct Bench {
    rosters: Vec<Roster>,
    /// Scans that the log does not have.
    missing: std::ops::Range<u64>,
}

/// A participant that lives and never died.
fn living(job: Job, axis: u32, role: u32) -> Participant {
    Participant {
        death_scan: u64::MAX,
        job: job as u32,
        axis,
        role,
        incarnation: 1,
        live: 1,
        ..Participant::default()
    }
}

/// The same, killed in a scan.
fn killed(participant: Participant, scan: u64) -> Participant {
    Participant {
        death_scan: scan,
        death_signal: 9,
        live: 0,
        ..participant
    }
}

/// Its successor.
fn restarted(participant: Participant) -> Participant {
    Participant {
        incarnation: participant.incarnation + 1,
        live: 1,
        ..participant
    }
}

fn roster(version: u64, visible_from: u64, participants: &[Participant]) -> Roster {
    let mut roster = Roster {
        version,
        visible_from,
        ..Roster::default()
    };
    roster.participants[..participants.len()].copy_from_slice(participants);
    roster
}

/// Rosters of one process: before, when it is dead, and with its successor. The machine moves before, between and after.
fn one_death(participant: Participant, others: &[Participant], scan: u64) -> Bench {
    let with = |participant| [&[participant], others].concat();
    let dead = killed(participant, scan);
    Bench {
        rosters: vec![
            roster(1, 0, &with(participant)),
            roster(2, scan + 1, &with(dead)),
            roster(3, scan + 40, &with(restarted(dead))),
        ],
        missing: 0..0,
    }
}

impl Bench {
    fn run(
        &self,
        change: impl Fn(u64, &mut Feedback, &mut Seen),
    ) -> (Vec<ProcessResult>, Vec<FaultResult>) {
        let mut faults = Faults::new(&machine(&["X", "Y"]));
        for roster in &self.rosters {
            faults.roster(roster);
            faults.roster(roster);
        }
        for scan in (0..SCANS).filter(|scan| !self.missing.contains(scan)) {
            let mut feedback = Feedback::zeroed();
            feedback.scan = scan;
            feedback.axis_count = 2;
            feedback.mode = Mode::Enabled as u32;
            feedback.incarnation = 1;
            feedback.window.sequence = 1;
            feedback.window.incarnation = 1;
            for axis in &mut feedback.axes {
                axis.taken_incarnation = 1;
            }
            let mut seen = Seen {
                contour_mm: 0.001,
                tool_mm: Some(AxisVector::zeros()),
                from_path_mm: Some(0.001),
            };
            change(scan, &mut feedback, &mut seen);
            faults.scan(&feedback, &seen);
        }
        faults.finish()
    }

    /// The only fault of the run.
    fn fault(&self, change: impl Fn(u64, &mut Feedback, &mut Seen)) -> FaultResult {
        let (_, faults) = self.run(change);
        let [fault] = &faults[..] else {
            panic!("{faults:?}");
        };
        fault.clone()
    }
}

#[test]
fn a_killed_planner_lets_the_machine_brake_on_the_path_until_its_successor_moves_it() {
    let bench = one_death(living(Job::Planner, 0, 0), &[], 100);
    let (processes, faults) = bench.run(|scan, feedback, seen| {
        feedback.at_rest = u32::from((140..180).contains(&scan));
        feedback.window.incarnation = if scan < 180 { 1 } else { 2 };
        seen.contour_mm = match scan {
            // Once before the death, once while it brakes, once long after motion went on.
            50 | 700 => 0.009,
            130 => 0.003,
            _ => 0.001,
        };
    });
    assert_eq!(processes[0].process, "planner");
    assert_eq!(processes[0].starts, 2);
    assert_eq!(processes[0].deaths, [(100, 9)]);
    let fault = &faults[0];
    assert_eq!(fault.reaction.to_string(), "braked to rest on the path");
    assert_eq!(fault.resumed_at_scan, Some(180));
    assert_eq!(fault.noticed_after_scans, Some(1));
    assert_eq!(fault.contour_error_mm, 0.003);
    assert_eq!((fault.brake_distance_mm, fault.deviation_mm), (None, None));
}

#[test]
fn a_planner_that_died_and_was_never_replaced_has_not_resumed() {
    let bench = one_death(living(Job::Planner, 0, 0), &[], 100);
    let fault = bench.fault(|scan, feedback, _| {
        feedback.at_rest = u32::from(scan >= 140);
        if scan >= 200 {
            feedback.mode = Mode::Stopped as u32;
        }
    });
    assert_eq!(fault.reaction.to_string(), "braked to rest on the path");
    assert_eq!(fault.resumed_at_scan, None);
}

#[test]
fn a_planner_that_dies_with_nothing_left_to_plan_or_is_replaced_in_time_stops_nothing() {
    let bench = one_death(living(Job::Planner, 0, 0), &[], 100);
    let fault = bench.fault(|scan, feedback, _| {
        feedback.at_rest = u32::from(scan >= 140);
        if scan >= 145 {
            feedback.mode = Mode::Finished as u32;
        }
    });
    assert_eq!(
        fault.reaction.to_string(),
        "none: the program had been planned to its end"
    );
    let fault = bench.fault(|scan, feedback, _| {
        feedback.window.incarnation = if scan < 120 { 1 } else { 2 };
        // What the operator does later is none of its doing.
        feedback.at_rest = u32::from(scan >= 500);
    });
    assert_eq!(
        fault.reaction.to_string(),
        "none: motion went on undisturbed"
    );
    assert_eq!(fault.resumed_at_scan, None);
}

#[test]
fn a_process_that_dies_while_the_machine_rests_has_stopped_nothing() {
    let bench = one_death(living(Job::Planner, 0, 0), &[], 100);
    let fault = bench.fault(|scan, feedback, _| feedback.at_rest = u32::from(scan < 300));
    assert_eq!(fault.reaction.to_string(), "none: the machine was at rest");
    assert_eq!(fault.resumed_at_scan, Some(300));
}

#[test]
fn a_standby_takes_over_in_the_scan_in_which_its_command_was_taken() {
    let others = [living(Job::Servo, 0, 1), living(Job::Servo, 1, 0)];
    let bench = one_death(living(Job::Servo, 0, 0), &others, 300);
    let (processes, faults) = bench.run(|scan, feedback, seen| {
        feedback.axes[0].taken_role = u32::from(scan >= 301);
        seen.contour_mm = if scan == 310 { 0.002 } else { 0.001 };
    });
    let of = |name: &str| processes.iter().find(|p| p.process == name).unwrap().starts;
    assert_eq!((of("servo-X"), of("servo-X-b"), of("servo-Y")), (2, 1, 1));
    assert_eq!(faults.len(), 1);
    assert_eq!(faults[0].reaction.to_string(), "standby took over");
    assert_eq!(faults[0].resumed_at_scan, Some(301));
    assert_eq!(faults[0].contour_error_mm, 0.002);
}

#[test]
fn a_takeover_before_the_launcher_noticed_the_death_is_one_also_at_rest() {
    let bench = one_death(living(Job::Servo, 0, 0), &[living(Job::Servo, 0, 1)], 300);
    for at_rest in [0, 1] {
        for takeover in [280, 301, 306] {
            let fault = bench.fault(|scan, feedback, _| {
                feedback.at_rest = at_rest;
                feedback.axes[0].taken_role = u32::from(scan >= takeover);
            });
            assert_eq!(
                fault.reaction.to_string(),
                "standby took over",
                "{takeover} {at_rest}"
            );
            assert_eq!(fault.resumed_at_scan, Some(takeover));
        }
    }
}

#[test]
fn a_standby_that_dies_itself_stops_nothing() {
    let bench = one_death(living(Job::Servo, 0, 1), &[living(Job::Servo, 0, 0)], 300);
    // Another process' stop later is none of its doing.
    let fault = bench.fault(|scan, feedback, _| feedback.at_rest = u32::from(scan >= 600));
    assert_eq!(
        fault.reaction.to_string(),
        "none: axis X has no standby until another one is there"
    );
    assert_eq!(fault.process, "servo-X-b");
    assert_eq!(fault.resumed_at_scan, None);
}

#[test]
fn the_roles_change_and_each_death_is_reported_for_itself() {
    // Role a dies, b drives; a's successor stands by and dies; b dies and the next of a takes over.
    let (a, b) = (living(Job::Servo, 0, 0), living(Job::Servo, 0, 1));
    let a1 = killed(a, 100);
    let a2 = restarted(a1);
    let a2_dead = killed(a2, 300);
    let a3 = restarted(a2_dead);
    let b_dead = killed(b, 500);
    let bench = Bench {
        rosters: vec![
            roster(1, 0, &[a, b]),
            roster(2, 101, &[a1, b]),
            roster(3, 140, &[a2, b]),
            roster(4, 301, &[a2_dead, b]),
            roster(5, 340, &[a3, b]),
            roster(6, 501, &[a3, b_dead]),
        ],
        missing: 0..0,
    };
    let (processes, faults) = bench.run(|scan, feedback, _| {
        let (role, incarnation) = match scan {
            0..=100 => (0, 1),
            101..=500 => (1, 1),
            _ => (0, 3),
        };
        feedback.axes[0].taken_role = role;
        feedback.axes[0].taken_incarnation = incarnation;
    });
    assert_eq!(processes[0].starts, 3);
    assert_eq!(processes[0].deaths, [(100, 9), (300, 9)]);
    let reported = faults.iter().map(|fault| {
        (
            fault.scan,
            fault.reaction.to_string(),
            fault.resumed_at_scan,
        )
    });
    let none = "none: axis X has no standby until another one is there";
    assert_eq!(
        reported.collect::<Vec<_>>(),
        [
            (100, "standby took over".to_string(), Some(101)),
            (300, none.to_string(), None),
            (500, "standby took over".to_string(), Some(501)),
        ]
    );
}

#[test]
fn an_axis_without_standby_quick_stops_all_and_resumes_when_the_tool_is_back_on_the_path() {
    let bench = one_death(living(Job::Servo, 1, 0), &[living(Job::Servo, 0, 0)], 300);
    let fault = bench.fault(|scan, feedback, seen| {
        feedback.cause_axis = u32::MAX;
        // 50 scans of braking from 0.2 mm a scan, linearly; then rest; off the path by up to 0.4 mm.
        let braked = scan.clamp(300, 350) - 300;
        let way_mm = 0.2 * braked as f64 * (1.0 - braked as f64 / 100.0);
        let before_mm = 0.2 * scan.min(300) as f64;
        seen.tool_mm = Some(AxisVector::from_fn(|axis, _| {
            if axis == 0 { before_mm + way_mm } else { 0.0 }
        }));
        seen.from_path_mm = Some(0.001 + 0.4 * braked as f64 / 50.0);
        match scan {
            301..600 => {
                feedback.mode = Mode::Tripped as u32;
                feedback.cause = Cause::ServoLost as u32;
                feedback.cause_axis = 1;
                feedback.window = WindowId::NONE;
            }
            // The way back is a window of its own, off the path.
            600..700 => {
                feedback.tag = PathTag::OFF_PATH;
                seen.from_path_mm = Some(0.9);
                seen.contour_mm = 0.0;
            }
            _ => {}
        }
    });
    assert_eq!(
        fault.reaction.to_string(),
        "all axes quick-stopped together"
    );
    assert_eq!(fault.resumed_at_scan, Some(700));
    // From the end of the scan before the trip: 0.2·50/2 mm less the first scan.
    let distance_mm = fault.brake_distance_mm.unwrap();
    assert!((distance_mm - 5.0).abs() < 0.21, "{distance_mm}");
    let deviation_mm = fault.deviation_mm.unwrap();
    assert!((deviation_mm - 0.401).abs() < 1e-9, "{deviation_mm}");
    assert_eq!(fault.contour_error_mm, deviation_mm);
}

#[test]
fn an_axis_that_the_master_brings_to_rest_on_the_path_is_said_to_be_there() {
    let bench = one_death(living(Job::Servo, 1, 0), &[living(Job::Servo, 0, 0)], 300);
    let fault = bench.fault(|scan, feedback, _| match scan {
        340 => feedback.at_rest = 1,
        341..600 => {
            feedback.mode = Mode::Tripped as u32;
            feedback.cause = Cause::ServoLost as u32;
            feedback.cause_axis = 1;
            feedback.window = WindowId::NONE;
        }
        _ => {}
    });
    assert_eq!(
        fault.reaction.to_string(),
        "master brought it to rest on the path"
    );
    assert_eq!(fault.resumed_at_scan, Some(600));
}

#[test]
fn a_stop_for_another_cause_is_reported_with_axis_and_cause() {
    let bench = one_death(living(Job::Servo, 1, 0), &[], 300);
    let fault = bench.fault(|scan, feedback, _| {
        if scan >= 305 {
            feedback.mode = Mode::Tripped as u32;
            feedback.cause = Cause::Watchdog as u32;
            feedback.cause_axis = 1;
        }
    });
    assert_eq!(
        fault.reaction.to_string(),
        "all axes quick-stopped together (axis Y: commands missing for too many scans)"
    );
    assert_eq!(fault.resumed_at_scan, None);
}

/// A master that dies in scan 400 at 100 mm/s and speaks again from scan 450 on, this far from where it was.
fn master(moved_mm: f64) -> FaultResult {
    let mut bench = one_death(living(Job::Master, 0, 0), &[], 400);
    bench.missing = 400..450;
    bench.fault(|scan, feedback, seen| {
        let at_mm = if scan < 400 {
            0.1 * scan as f64
        } else {
            39.9 + moved_mm
        };
        feedback.axes[0].velocity_mm_s = if scan < 400 { 100.0 } else { 0.0 };
        feedback.axes[0].motor_position = (at_mm * 1e6) as i64;
        seen.tool_mm = Some(AxisVector::from_fn(
            |axis, _| {
                if axis == 0 { at_mm } else { 0.0 }
            },
        ));
        if scan >= 400 {
            feedback.incarnation = 2;
            seen.from_path_mm = Some(0.2);
        }
        if (400..600).contains(&scan) {
            feedback.mode = Mode::Disabled as u32;
            feedback.window = WindowId::NONE;
        }
        if (600..650).contains(&scan) {
            feedback.tag = PathTag::OFF_PATH;
        }
    })
}

#[test]
fn a_master_that_comes_back_has_its_drives_off_and_its_positions() {
    let fault = master(1.2);
    assert_eq!(
        fault.reaction.to_string(),
        "drives braked, disabled; positions kept"
    );
    assert_eq!(fault.resumed_at_scan, Some(650));
    assert!((fault.brake_distance_mm.unwrap() - 1.2).abs() < 1e-9);
    assert_eq!(fault.deviation_mm, Some(0.2));
}

#[test]
fn a_master_that_lost_its_positions_is_found_out() {
    // At 100 mm/s a quick stop with 5000 mm/s² takes 1 mm; 3 scans nobody saw are 0.3 mm more.
    let fault = master(-39.9);
    assert!(
        fault
            .reaction
            .to_string()
            .starts_with("drives braked, disabled; axis X came back -39.900 mm from where it was"),
        "{}",
        fault.reaction
    );
}

#[test]
fn a_master_that_does_not_come_back_ends_the_cell() {
    let mut bench = one_death(living(Job::Master, 0, 0), &[], 400);
    bench.rosters.pop();
    bench.missing = 401..SCANS;
    let fault = bench.fault(|_, _, _| {});
    assert_eq!(fault.reaction.to_string(), "the cell ended");
    assert_eq!(fault.resumed_at_scan, None);
}

#[test]
fn a_killed_recorder_is_no_fault_of_the_machine_whatever_happens_later() {
    let mut bench = one_death(living(Job::Monitor, 0, 0), &[], 200);
    bench.missing = 180..230;
    let fault = bench.fault(|scan, feedback, _| feedback.at_rest = u32::from(scan > 235));
    assert_eq!(fault.reaction.to_string(), "none");
    assert_eq!(fault.resumed_at_scan, None);
    assert_eq!(fault.noticed_after_scans, Some(1));
}

#[test]
fn when_a_death_was_noticed_is_not_guessed_from_a_later_roster() {
    let mut bench = one_death(living(Job::Monitor, 0, 0), &[], 200);
    // The roster that reported it was published while nobody recorded.
    bench.rosters.remove(1);
    let fault = bench.fault(|_, _, _| {});
    assert_eq!(fault.noticed_after_scans, None);
}
