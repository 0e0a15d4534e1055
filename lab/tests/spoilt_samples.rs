//! Every number of every sample, wrong in every way: no reader is kept from the samples that follow, nothing panics, and whoever is
//! stopped by it comes back.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use bus::cell::CellPaths;
use bus::layout::{Leaf, Wire, leaves};
use bus::port::{Reader, Writer};
use bus::sample::{
    AxisCommand, Cause, Feedback, Mode, OperatorRequest, Order, PlannerStatus, Roster, Setpoint,
    WindowHeader,
};
use bus::service::{Bus, SCAN_DEPTH, Sample, Shape};
use bytemuck::Zeroable;
use lab::cell::{InProcessCell, Window};
use lab::corruption::spoil_number;
use lab::invariants::{Course, Judge};
use machine::Machine;
use planner::{Planner, ProgramText};
use plant_sim::plant_file::PlantFile;
use plant_sim::script::faults::Spoil;
use servo::Servo;

const PROGRAM: &str = "G21 G17 G90 G94\nG1 X3 Y0 F3000\nG3 X3 Y4 I0 J2\nG4 P0.05\nG0 X1 Y7\nM2\n";

/// All the ways in which a number can be wrong.
fn ways(leaf: &Leaf) -> Vec<Spoil> {
    let bits = 8 * leaf.bytes as u8;
    let mut ways = vec![
        Spoil::AllBits,
        Spoil::Most,
        Spoil::Zero,
        Spoil::OneMore,
        Spoil::OneLess,
        Spoil::Bit(3),
        Spoil::Bit(bits / 2),
        Spoil::Bit(bits - 1),
    ];
    if leaf.number == "float64" {
        ways.push(Spoil::NotANumber);
    }
    ways
}

/// Hands `take` every wrong form of a sample, and what is wrong with it.
fn spoilt<T: Wire + bytemuck::Pod>(sample: &T, mut take: impl FnMut(T, String)) {
    for leaf in leaves::<T>() {
        for how in ways(&leaf) {
            let mut wrong = *sample;
            spoil_number(&mut wrong, &leaf, how);
            take(wrong, format!("{} of {}", how.word(), leaf.name));
        }
    }
}

fn machine() -> (Machine, PlantFile) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
    let machine = Machine::load(&folder).expect("machine.toml");
    let plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    (machine, plant)
}

/// Sends each wrong form of a sample and then the right one of the scan after: that is what the reader has then.
fn keeps_nobody_waiting<T: Sample + Wire + PartialEq>(
    writer: &mut Writer<T>,
    reader: &mut Reader<T>,
    of_scan: impl Fn(u64) -> T,
) {
    let mut scan = 1000;
    for leaf in leaves::<T>() {
        for how in ways(&leaf) {
            let mut wrong = of_scan(scan);
            spoil_number(&mut wrong, &leaf, how);
            writer.send(&wrong);
            let mut right = of_scan(scan + 1);
            writer.send(&right);
            right.seal();
            let newest = reader.newest(scan + 2);
            assert!(
                newest == Some(right),
                "{how:?} of {}: not the newest sample",
                leaf.name
            );
            scan += 2 * SCAN_DEPTH as u64;
        }
    }
}

#[test]
fn no_wrong_number_in_a_sample_keeps_a_reader_from_the_next_one() {
    let place = CellPaths::new(&format!("l{}-spoilt", std::process::id())).expect("a name");
    let owner = place.own(Duration::ZERO).expect("the cell");
    let shape = Shape {
        axes: vec!["X".into(), "Y".into()],
        period_scans: 4,
        has_bus: false,
        has_signals: false,
        has_logic: false,
    };
    let bus = Bus::enter(&place, &shape, "launcher", true).expect("shared memory");
    let _services = bus.create_all().expect("services");
    let horizon = SCAN_DEPTH as u64 + 1;
    keeps_nobody_waiting(
        &mut bus.command_writer(0, 0).expect("a writer"),
        &mut bus
            .command_reader(0, 0, SCAN_DEPTH)
            .expect("a reader")
            .with_horizon(horizon),
        |scan| AxisCommand {
            scan,
            visible_from: scan + 1,
            ..AxisCommand::zeroed()
        },
    );
    keeps_nobody_waiting(
        &mut bus.planner_writer().expect("a writer"),
        &mut bus
            .planner_reader(SCAN_DEPTH)
            .expect("a reader")
            .with_horizon(horizon),
        |scan| PlannerStatus {
            scan,
            visible_from: scan + 1,
            ..PlannerStatus::zeroed()
        },
    );
    keeps_nobody_waiting(
        &mut bus.roster_writer().expect("a writer"),
        &mut bus
            .roster_reader(SCAN_DEPTH)
            .expect("a reader")
            .with_horizon(horizon),
        |scan| Roster {
            version: scan,
            visible_from: scan,
            ..Roster::zeroed()
        },
    );
    drop(owner);
}

/// Who waits for a feedback takes the newest, whatever its scan: one of a scan far ahead would be the last it ever takes.
#[test]
fn a_feedback_whose_scan_is_wrong_is_taken_for_none() {
    let place = CellPaths::new(&format!("l{}-feedback", std::process::id())).expect("a name");
    let owner = place.own(Duration::ZERO).expect("the cell");
    let shape = Shape {
        axes: vec!["X".into(), "Y".into()],
        period_scans: 4,
        has_bus: false,
        has_signals: false,
        has_logic: false,
    };
    let bus = Bus::enter(&place, &shape, "launcher", true).expect("shared memory");
    let _services = bus.create_all().expect("services");
    let mut writer = bus.feedback_writer().expect("a writer");
    let mut reader = bus.feedback_reader(SCAN_DEPTH).expect("a reader");
    let of_scan = |scan| Feedback {
        scan,
        visible_from: scan,
        axis_count: 2,
        ..Feedback::zeroed()
    };
    let mut scan = 1;
    spoilt(&of_scan(0), |wrong, what| {
        let made = Feedback {
            scan: wrong.scan.wrapping_add(scan),
            ..wrong
        };
        let made = Feedback {
            visible_from: made.visible_from.wrapping_add(scan),
            ..made
        };
        writer.send(&made);
        let taken = reader.newest(u64::MAX);
        let taken = taken.is_none_or(|feedback| feedback.scan == scan);
        assert!(taken, "{what}: the scan of another one");
        scan += 1;
    });
    assert!(reader.failed() > 0);
    drop(owner);
}

/// Feedbacks and windows of a run, up to this scan.
fn recorded(
    machine: &Machine,
    plant: &PlantFile,
    scans: usize,
) -> Vec<(Feedback, Vec<Arc<Window>>)> {
    let mut cell = InProcessCell::new(machine, plant, "short.ngc", PROGRAM).expect("a cell");
    let mut recorded = Vec::new();
    while let Some(published) = cell.scan() {
        recorded.push((*published.feedback, published.windows.to_vec()));
        if recorded.len() > scans {
            break;
        }
    }
    recorded
}

fn offer(servo: &mut Servo, header: &WindowHeader, setpoints: &[Setpoint], feedback: &Feedback) {
    let _ = servo.offer(header, setpoints, feedback);
}

#[test]
fn a_servo_that_is_told_nonsense_stops_its_axis_and_comes_back_with_the_next_trip() {
    let (machine, plant) = machine();
    let run = recorded(&machine, &plant, 160);
    let mut servo = Servo::new(&machine, 0, 0, 1).expect("a servo");
    let mut before: &[Arc<Window>] = &[];
    for (feedback, windows) in run.iter().take(150) {
        for window in before {
            offer(&mut servo, &window.header, &window.setpoints, feedback);
        }
        servo.scan(feedback);
        before = windows;
    }
    let (feedback, _) = &run[150];
    spoilt(feedback, |wrong, what| {
        let mut servo = servo.clone();
        if wrong.is_sound() {
            let command = servo.scan(&wrong);
            assert!(command.velocity_mm_s.is_finite(), "{what}");
            assert!(command.torque_nm.is_finite(), "{what}");
        }
        for (after, _) in &run[151..155] {
            servo.scan(after);
        }
        let mut command = AxisCommand::zeroed();
        for (after, _) in &run[155..158] {
            command = servo.scan(&Feedback {
                mode: Mode::Tripped as u32,
                ..*after
            });
        }
        assert_eq!(
            command.cause,
            Cause::None as u32,
            "{what}: it never comes back"
        );
    });
}

#[test]
fn a_planner_that_is_told_nonsense_does_not_panic() {
    let (machine, plant) = machine();
    let run = recorded(&machine, &plant, 160);
    let period = u64::from(machine.scan.interpolation_period_scans);
    let boundaries: Vec<&Feedback> = run
        .iter()
        .map(|(feedback, _)| feedback)
        .filter(|feedback| feedback.scan.is_multiple_of(period))
        .collect();
    for leaf in leaves::<Feedback>() {
        // It reads the axes in use alone.
        if leaf.name.starts_with("axes.") && !leaf.name.starts_with("axes.0") {
            continue;
        }
        let program = ProgramText::Here("short.ngc".into(), PROGRAM.into());
        let mut planner = Planner::of(&machine, program, 1);
        for feedback in boundaries.iter().take(4) {
            planner.scan(feedback);
        }
        for how in ways(&leaf) {
            let mut wrong = *boundaries[4];
            spoil_number(&mut wrong, &leaf, how);
            let decision = planner.scan(&wrong);
            assert_eq!(decision.status.incarnation, 1, "{how:?} of {}", leaf.name);
        }
        planner.scan(boundaries[5]);
    }
}

#[test]
fn an_order_that_is_nonsense_is_refused_or_is_another_order_and_the_path_is_kept() {
    let (machine, plant) = machine();
    let course = Course::of(&machine, &plant, "short.ngc", PROGRAM).expect("a course");
    for order in Order::ALL {
        let mut cell = InProcessCell::new(&machine, &plant, "short.ngc", PROGRAM).expect("a cell");
        let mut judge = Judge::new(&machine, &course);
        let mut wrong = Vec::new();
        let right = OperatorRequest {
            order: order as u32,
            axis: 1,
            value: 1.0,
            ..OperatorRequest::default()
        };
        spoilt(&right, |request, what| wrong.push((request, what)));
        let mut next = 40;
        while let Some(published) = cell.scan() {
            let scan = published.feedback.scan;
            judge.take(&published, |_, _| false);
            if scan > 3000 {
                break;
            }
            if scan == next
                && let Some((request, what)) = wrong.pop()
            {
                next += 3;
                let answer = cell.order(&request);
                let known = Order::from_wire(request.order).is_some();
                assert!(known || answer.accepted == 0, "{order:?}, {what}");
            }
        }
        let (_, violations) = judge.end();
        assert_eq!(violations, [], "{order:?}");
    }
}
