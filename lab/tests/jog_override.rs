//! The override of jogs: at once, exact, within what each axis may do.

use crate::common::{self, staying::Cell};
use bus::sample::{Cause, MAX_AXES, Mode, OperatorRequest, Order, Refused};
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::rng::Rng;

const SESSION: u32 = 5;

fn machines() -> Vec<(&'static str, Machine, PlantFile)> {
    let shipped = [
        "xy",
        "xy-fast",
        "xy-torque",
        "xyz-mill",
        "xz-lathe",
        "xzb-pivot",
    ];
    let mut all: Vec<_> = shipped
        .into_iter()
        .map(|name| {
            let (machine, plant) = common::load(name);
            (name, machine, plant)
        })
        .collect();
    let (mut machine, plant) = common::load("xy");
    for axis in &mut machine.axes {
        axis.jerk_mm_s3 = Some(50_000.0);
    }
    all.push(("xy, with jerk", machine, plant));
    let (machine, plant) = common::new_machine(&[
        "X:travel=0..1200,rack=2x20,ratio=10,mass=150,motors=2",
        "Y:travel=0..300,lead=10",
    ]);
    all.push(("gantry", machine, plant));
    all
}

/// Ready, homed, and in the middle of its travel.
fn ready(name: &str, machine: Machine, plant: PlantFile) -> Cell {
    let mut cell = Cell::new(machine, plant);
    cell.ready_and_homed();
    for axis in 0..2 {
        let settings = &cell.machine.axes[axis];
        let middle_mm = f64::midpoint(settings.travel_min_mm, settings.travel_max_mm);
        let at = cell.now.axes[axis].command_position as f64 * settings.increment_mm();
        if (middle_mm - at).abs() > 50.0 {
            let way = OperatorRequest {
                speed_mm_s: 50.0,
                ..common::axis_order(Order::Jog, axis, middle_mm - at)
            };
            assert_eq!(cell.ask(&way).reason, Refused::Not as u32, "{name}");
            cell.scans(2);
            assert!(cell.until(60_000, |of| of.mode() == Mode::Ready), "{name}");
        }
    }
    cell
}

fn set(cell: &mut Cell, percent: f64) {
    let answer = cell.ask(&common::axis_order(Order::JogOverride, 0, percent));
    assert_eq!(answer.reason, Refused::Not as u32);
}

fn places(cell: &Cell) -> [i64; MAX_AXES] {
    cell.now.axes.map(|axis| axis.command_position)
}

/// One scan; no axis goes faster than it may.
fn scan(cell: &mut Cell, name: &str) -> [i64; MAX_AXES] {
    let before = places(cell);
    cell.scan();
    assert_eq!(cell.cause(), Cause::None, "{name}");
    let now = places(cell);
    for (index, axis) in cell.machine.axes.iter().enumerate() {
        let most = axis.rapid_mm_s * cell.machine.scan_period_s() / axis.increment_mm();
        let step = (now[index] - before[index]).abs();
        assert!(step as f64 <= most + 1.0, "{name}: {step} of {most}");
    }
    std::array::from_fn(|index| now[index] - before[index])
}

#[test]
fn increments_are_exact_however_often_the_override_changes_under_them_also_at_0_and_back() {
    for (name, machine, plant) in machines() {
        let mut random = Rng::new(17);
        let mut cell = ready(name, machine, plant);
        let mut at = places(&cell);
        let mut taken = 0;
        for number in 1..=40 {
            let axis = random.below(2) as usize;
            let increment_mm = cell.machine.axes[axis].increment_mm();
            let way = (10f64.powf(random.between(-3.0, 0.7)) / increment_mm).round();
            let way = if random.one_in(2) { way } else { -way };
            let click = OperatorRequest {
                session: SESSION,
                deadline_scans: number,
                ..common::axis_order(Order::Jog, axis, way * increment_mm)
            };
            let answer = cell.ask(&click);
            if answer.reason == Refused::Not as u32 {
                taken += 1;
                at[axis] += (answer.jogged_mm / increment_mm).round() as i64;
                let second = cell.machine.gantries().find(|pair| pair.leader == axis);
                if let Some(pair) = second {
                    at[pair.follower] = at[axis];
                }
            }
            for _ in 0..4 {
                let percent = [0.0, 0.0, 3.0, 60.0, 100.0, 150.0, 200.0][random.below(7) as usize];
                set(&mut cell, percent);
                for _ in 0..random.below(150) {
                    scan(&mut cell, name);
                }
            }
        }
        set(&mut cell, 100.0);
        for _ in 0..60_000 {
            scan(&mut cell, name);
            if cell.mode() == Mode::Ready {
                break;
            }
        }
        assert!(taken > 15, "{name}: {taken} taken");
        assert_eq!(places(&cell), at, "{name}");
    }
}

#[test]
fn a_held_jog_goes_at_its_share_stands_at_0_and_goes_on() {
    for (name, machine, plant) in machines() {
        let mut cell = ready(name, machine, plant);
        let scan_s = cell.machine.scan_period_s();
        let full = 4.0 * scan_s / cell.machine.axes[0].increment_mm();
        let on = OperatorRequest {
            speed_mm_s: 4.0,
            session: 3,
            deadline_scans: (0.2 / scan_s) as u32,
            ..common::axis_order(Order::JogOn, 0, 1.0)
        };
        assert_eq!(cell.ask(&on).reason, Refused::Not as u32, "{name}");
        let second = (1.0 / scan_s) as usize;
        for percent in [100.0, 50.0, 0.0, 200.0, 0.0, 100.0] {
            set(&mut cell, percent);
            for number in 0..second {
                if number % (second / 20) == 0 {
                    let renewed = OperatorRequest {
                        order: Order::JogRenew as u32,
                        speed_mm_s: 0.0,
                        ..on
                    };
                    assert_eq!(cell.ask(&renewed).reason, Refused::Not as u32, "{name}");
                }
                let steps = scan(&mut cell, name);
                assert_eq!(cell.mode(), Mode::Jogging, "{name}");
                if number > second * 3 / 4 {
                    let off = (steps[0] as f64 - full * percent / 100.0).abs();
                    assert!(off <= 1.0, "{name} at {percent} %: {} of {full}", steps[0]);
                }
            }
        }
        // At 0 % it ends where it stands, by its deadline.
        set(&mut cell, 0.0);
        assert!(
            cell.until(3 * second as u64, |of| of.mode() == Mode::Ready),
            "{name}"
        );
    }
}

#[test]
fn a_line_stays_straight_over_changes_of_the_override_and_ends_exactly() {
    for (name, machine, plant) in machines() {
        let mut random = Rng::new(23);
        let mut cell = ready(name, machine, plant);
        let from = places(&cell);
        let ways_mm = [14.0, -7.123_456];
        let mut line = common::axis_order(Order::Jog, 0, 0.0);
        let ways = [0, 1].map(|axis| {
            line.line_mm[axis] = ways_mm[axis];
            (ways_mm[axis] / cell.machine.axes[axis].increment_mm()).round()
        });
        assert_eq!(cell.ask(&line).reason, Refused::Not as u32, "{name}");
        let mut most = 0.0f64;
        let mut scans = 0;
        while scans < 10 || cell.mode() == Mode::Jogging {
            if scans % 100 == 50 {
                let percent = [0.0, 20.0, 100.0, 200.0][random.below(4) as usize];
                set(&mut cell, percent);
            }
            scan(&mut cell, name);
            let gone = [0, 1].map(|axis| (places(&cell)[axis] - from[axis]) as f64);
            most = most.max((gone[1] - gone[0] * ways[1] / ways[0]).abs());
            scans += 1;
            assert!(scans < 200_000, "{name}: it never ends");
        }
        println!("{name}: at most {most:.2} increments beside its line in {scans} scans");
        assert!(most <= 2.0, "{name}: {most} increments");
        for axis in [0, 1] {
            assert_eq!(
                (places(&cell)[axis] - from[axis]) as f64,
                ways[axis],
                "{name}"
            );
        }
    }
}

#[test]
fn before_an_axis_is_homed_no_override_makes_it_faster_than_its_search_and_homing_keeps_its_speed()
{
    let (machine, plant) =
        common::new_machine(&["X:travel=-200..200,lead=10,encoder=incremental,start=-100"]);
    let homing = machine.axes[0].homing.as_ref();
    let search_mm_s = homing.expect("it homes").search_mm_s;
    let mut cell = Cell::new(machine, plant);
    cell.scans(5);
    cell.ready();
    let homed = [100.0, 25.0].map(|percent| {
        let mut cell = cell.clone();
        set(&mut cell, percent);
        let began = cell.now.scan;
        assert_eq!(cell.order(Order::Home), Refused::Not);
        cell.scans(2);
        assert!(cell.until(60_000, |of| of.mode() == Mode::Ready));
        assert!(cell.is_homed(), "at {percent} %");
        cell.now.scan - began
    });
    assert_eq!(homed[0], homed[1]);
    set(&mut cell, 200.0);
    let jog = OperatorRequest {
        speed_mm_s: 0.9 * search_mm_s,
        ..common::axis_order(Order::Jog, 0, 10.0)
    };
    assert_eq!(cell.ask(&jog).reason, Refused::Not as u32);
    let most = search_mm_s * cell.machine.scan_period_s() / cell.machine.axes[0].increment_mm();
    let mut fastest = 0;
    cell.scans(2);
    while cell.mode() == Mode::Jogging {
        fastest = fastest.max(scan(&mut cell, "new")[0].abs());
    }
    assert!((fastest as f64 - most).abs() <= 1.0, "{fastest} of {most}");
}

#[test]
fn the_override_outlives_a_master_and_others_are_refused() {
    let (machine, plant) = common::load("xy");
    let mut cell = ready("xy", machine, plant);
    set(&mut cell, 40.0);
    cell.scans(2);
    assert_eq!(cell.now.inputs.jog_override_percent(), 40);
    cell.replace_master();
    cell.scans(2);
    assert_eq!(cell.now.inputs.jog_override_percent(), 40);
    for percent in [-1.0, 201.0, f64::NAN, f64::INFINITY] {
        let answer = cell.ask(&common::axis_order(Order::JogOverride, 0, percent));
        assert_eq!(answer.reason, Refused::BadValue as u32, "{percent}");
    }
}
