//! How motions by hand end before they are done: cut short by an order, whose answer says where the axis will stand; by the probe; or
//! not renewed.

use crate::common::{self, staying::Cell};
use crate::size;
use bus::sample::{Cause, MAX_AXES, Mode, OperatorRequest, OperatorResponse, Order, Refused};
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::rng::Rng;

const SESSION: u32 = 9;

fn ready(machine: Machine, plant: PlantFile) -> Cell {
    let mut cell = Cell::new(machine, plant);
    cell.ready_in_the_middle();
    cell
}

fn jog(axis: usize, way_mm: f64) -> OperatorRequest {
    common::axis_order(Order::Jog, axis, way_mm)
}

fn held(axis: usize, direction: f64, speed_mm_s: f64) -> OperatorRequest {
    OperatorRequest {
        axis: axis as u32,
        speed_mm_s,
        session: SESSION,
        deadline_scans: 1_000,
        ..common::order(Order::JogOn, direction)
    }
}

fn line(ways_mm: &[(usize, f64)]) -> OperatorRequest {
    let mut request = common::order(Order::Jog, 0.0);
    for (axis, way_mm) in ways_mm {
        request.line_mm[*axis] = *way_mm;
    }
    request
}

fn wheel(axis: usize, count: i32) -> OperatorRequest {
    OperatorRequest {
        axis: axis as u32,
        session: SESSION,
        count,
        ..common::order(Order::Wheel, -0.05)
    }
}

/// What cuts a motion short.
fn cutting(order: Order) -> OperatorRequest {
    OperatorRequest {
        session: SESSION,
        ..common::order(order, 0.0)
    }
}

fn taken(cell: &mut Cell, request: &OperatorRequest) -> OperatorResponse {
    let answer = cell.ask(request);
    assert_eq!(Refused::from_wire(answer.reason), Some(Refused::Not));
    answer
}

fn commands(cell: &Cell) -> [i64; MAX_AXES] {
    cell.now.axes.map(|axis| axis.command_position)
}

fn moves(cell: &Cell) -> bool {
    matches!(cell.mode(), Mode::Jogging | Mode::Stopping)
}

#[test]
fn the_answer_to_what_cuts_a_jog_short_names_where_the_axis_then_stands_to_the_increment() {
    let (mut jerky, of_jerky) = common::load("xy");
    let axes = jerky.axes.iter_mut();
    axes.for_each(|axis| axis.jerk_mm_s3 = Some(50_000.0));
    let (gantry, of_gantry) = common::new_machine(&[
        "X:travel=0..600,lead=10,motors=2",
        "Y:travel=0..300,lead=10",
    ]);
    let (xy, of_xy) = common::load("xy");
    let (fast, of_fast) = common::load("xy-fast");
    let cells = [
        ("xy", ready(xy, of_xy), 1),
        ("xy-fast", ready(fast, of_fast), 1),
        ("xy with jerk", ready(jerky, of_jerky), 1),
        ("gantry", ready(gantry, of_gantry), 1),
    ];
    let mut cuts = 0;
    for (name, cell, second) in cells {
        let asked = [
            vec![jog(0, 3.0)],
            vec![jog(0, 0.02), jog(0, 1.0), jog(0, -2.5)],
            vec![held(0, 1.0, 100.0)],
            vec![held(second, 1.0, 0.0), held(0, -1.0, 20.0)],
            vec![line(&[(0, 8.0), (second, -3.0)])],
            vec![wheel(0, 0), wheel(0, 30)],
            vec![jog(second, 1.0)],
        ];
        for (which, asked) in asked.iter().enumerate() {
            for order in [Order::Hold, Order::Stop, Order::JogRenew] {
                for seed in 0..size::number("SEEDS", 2, 6) {
                    let what = format!("{name}, jog {which}, {order:?}, seed {seed}");
                    let mut random = Rng::new(seed);
                    let mut cell = cell.clone();
                    for request in asked {
                        taken(&mut cell, request);
                        // The next one comes before the change to this one has, or long after.
                        let scans = random.below(if seed % 2 == 0 { 20 } else { 200 });
                        cell.scans(scans);
                    }
                    let scans = random.below(400);
                    cell.scans(scans);
                    let answer = cell.ask(&cutting(order));
                    if answer.accepted == 0 || answer.cut == 0 {
                        let stays = commands(&cell);
                        cell.scans(600);
                        // A line and increments of nobody end by no session.
                        let ended = commands(&cell) == stays || order == Order::JogRenew;
                        assert!(ended, "{what}: {stays:?} to {:?}", commands(&cell));
                        continue;
                    }
                    // A second one says the same.
                    if random.one_in(3) {
                        let scans = random.below(30);
                        cell.scans(scans);
                        let again = cell.ask(&cutting(Order::Hold));
                        let told = (again.cut == 0 || again.axis != answer.axis)
                            || again.rests == answer.rests;
                        assert!(told, "{what}: {} then {}", answer.rests, again.rests);
                    }
                    cell.scans(2);
                    assert!(cell.until(20_000, |of| !moves(of)), "{what}");
                    cell.scans(100);
                    let axis = answer.axis as usize;
                    assert_eq!(answer.rests, commands(&cell)[axis], "{what}, axis {axis}");
                    cuts += 1;
                }
            }
        }
    }
    println!("{cuts} cuts");
    assert!(cuts > 100, "{cuts}");
}

#[test]
fn a_renewal_that_is_refused_for_one_axis_changes_none() {
    let (mut machine, plant) = common::load("xy");
    machine.axes[1].rapid_mm_s = 50.0;
    let mut cell = ready(machine, plant);
    for axis in 0..2 {
        taken(&mut cell, &held(axis, 1.0, 10.0));
    }
    cell.scans(600);
    let renewed = OperatorRequest {
        speed_mm_s: 80.0,
        deadline_scans: 1_500,
        ..cutting(Order::JogRenew)
    };
    let answer = cell.ask(&renewed);
    let refused = (Refused::from_wire(answer.reason), answer.axis);
    assert_eq!(refused, (Some(Refused::JogSpeed), 1));
    for _ in 0..300 {
        let before = commands(&cell);
        cell.scan();
        for (axis, settings) in cell.machine.axes.iter().enumerate() {
            let step_mm = (commands(&cell)[axis] - before[axis]) as f64 * settings.increment_mm();
            let speed_mm_s = step_mm / cell.machine.scan_period_s();
            assert!(
                (9.9..10.1).contains(&speed_mm_s),
                "{axis}: {speed_mm_s} mm/s"
            );
        }
    }
    // Nor does it go on for longer.
    assert!(cell.until(400, |of| of.mode() != Mode::Jogging));
}

/// The mill with a probe above a plane, in mm of Z.
fn mill(surface_mm: f64) -> Cell {
    let (machine, mut plant) = common::load("xyz-mill");
    plant.probe = Some(common::stock::probe_above(surface_mm));
    ready(machine, plant)
}

fn z_mm(cell: &Cell) -> f64 {
    cell.now.axes[2].command_position as f64 * cell.machine.axes[2].increment_mm()
}

#[test]
fn the_probe_stops_every_motion_by_hand_and_says_so_and_jogs_lead_off_it() {
    const Z: usize = 2;
    let from_mm = z_mm(&mill(-1e3));
    // The ball touches 1 mm below.
    let cell = mill(from_mm - 3.0);
    assert_eq!(cell.now.inputs.contact, 0);
    for (what, asked) in [
        ("increment", vec![jog(Z, -20.0)]),
        ("held", vec![held(Z, -1.0, 0.0), held(0, 1.0, 0.0)]),
        ("line", vec![line(&[(Z, -20.0), (1, 7.0)])]),
        ("wheel", vec![wheel(Z, 0), wheel(Z, 30)]),
    ] {
        for stopped in [false, true] {
            let mut cell = cell.clone();
            if stopped {
                assert_eq!(cell.order(Order::Stop), Refused::Not);
                cell.scans(5);
            }
            for request in &asked {
                taken(&mut cell, request);
            }
            cell.scans(2);
            assert!(cell.until(5_000, |of| !moves(of)), "{what}");
            let at = commands(&cell);
            let way_mm = z_mm(&cell) - from_mm;
            println!("{what}: {way_mm:.3} mm");
            assert!((-1.4..=-1.0).contains(&way_mm), "{what}: {way_mm} mm");
            assert_eq!(cell.cause(), Cause::ProbeJogged, "{what}");
            assert!(cell.now.cause_axis == 2 || cell.now.cause_axis < 2 && what != "wheel");
            assert_eq!(cell.now.inputs.contact, 1, "{what}");
            cell.scans(300);
            assert_eq!(commands(&cell), at, "{what}");
            assert_eq!(cell.mode(), Mode::Ready, "{what}");
            // Off it; contact that stays stops nothing.
            taken(&mut cell, &jog(Z, 0.1));
            cell.scans(2);
            assert!(cell.until(5_000, |of| !moves(of)), "{what}");
            let off_mm = z_mm(&cell) - from_mm - way_mm;
            assert!((off_mm - 0.1).abs() < 1e-9, "{what}: {off_mm} mm");
            assert_eq!(cell.cause(), Cause::None, "{what}");
            taken(&mut cell, &jog(Z, 3.0));
            cell.scans(2);
            assert!(cell.until(5_000, |of| !moves(of)), "{what}");
            assert_eq!((cell.now.inputs.contact, cell.cause()), (0, Cause::None));
        }
    }
}
