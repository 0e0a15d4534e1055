//! Homing that is interrupted: whatever comes, in whatever step of whichever homing, the machine can be enabled and homed again, or
//! ends. Master, servos and simulated drives are driven scan by scan, and copied where a run is to be interrupted.

use std::collections::BTreeSet;
use std::fmt;

use crate::common::{self, staying::Cell};
use crate::size;
use bus::sample::{Cause, Job, Mode, Order, ProgramState, Reference, Refused};
use machine::Machine;
use master::Drives;
use plant_sim::plant_file::PlantFile;

/// True places of the switches of the two motors, and of the indices behind them, in mm.
const SWITCHES_MM: [f64; 2] = [-190.0, -189.6];
const INDICES_MM: [f64; 2] = [-191.0, -191.3];

/// A machine as `quadrant new machine` writes it, whose X is homed: on one motor or two, with standbys or without.
fn machine(motors: u32, standby: bool) -> (Machine, PlantFile) {
    let axis = format!(
        "X:travel=-200..200,lead=10,mass=200,motors={motors},encoder=incremental,start=-188"
    );
    let (mut machine, mut plant) = common::new_machine(&[&axis]);
    for (index, axis) in machine.axes.iter_mut().enumerate() {
        axis.standby = standby;
        let homing = axis.homing.as_mut().expect("homing");
        homing.position_mm = INDICES_MM[index];
        (homing.search_mm_s, homing.latch_mm_s) = (40.0, 10.0);
    }
    for (index, axis) in plant.axes.iter_mut().enumerate() {
        let encoder = axis.encoder.as_mut().expect("an encoder");
        encoder.index_at_mm = INDICES_MM[index];
        encoder.shows_mm = [400.0, -77.7][index];
        let switch = axis.home_switch.as_mut().expect("a switch");
        switch.at_mm = SWITCHES_MM[index];
    }
    (machine, plant)
}

/// What makes one step of homing another than the one before.
fn step(cell: &Cell) -> impl PartialEq + fmt::Debug + use<> {
    let drives = cell.master.drives();
    let axes = 0..cell.machine.axes.len();
    let of_axis = |axis: usize| {
        let now = &cell.now.axes[axis];
        let finds = drives.feedback(axis).index_mm.is_some();
        (now.driver, now.reference, finds)
    };
    let of_axes: Vec<_> = axes.map(of_axis).collect();
    (cell.mode(), of_axes, drives.inputs().digital)
}

fn suffer(cell: &mut Cell, what: Interruption) {
    let ordered = match what {
        Interruption::Ordered(order) => cell.order(order),
        _ => Refused::Not,
    };
    let jogging = matches!(cell.mode(), Mode::Jogging | Mode::Stopping);
    match what {
        Interruption::Ordered(Order::Disable | Order::Reset) => {
            assert!(!jogging || ordered != Refused::Not, "{ordered:?}");
        }
        Interruption::Ordered(_) => assert_eq!(ordered, Refused::Not),
        Interruption::Trip(axis) => cell.trips = Some(axis),
        Interruption::Death(job, axis) => cell.dies(job, axis),
        Interruption::MasterDies => cell.replace_master(),
        Interruption::LauncherDies => cell.master.end_after_stop(false),
    }
}

/// What can come between.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Interruption {
    Ordered(Order),
    /// The servo of an axis breaks off.
    Trip(usize),
    Death(Job, usize),
    MasterDies,
    LauncherDies,
}

fn interruptions(axes: usize) -> Vec<Interruption> {
    let orders = [
        Order::EmergencyStop,
        Order::Hold,
        Order::Stop,
        Order::Disable,
        Order::Reset,
        Order::Down,
    ];
    let mut all: Vec<_> = orders.map(Interruption::Ordered).into();
    for axis in 0..axes {
        all.push(Interruption::Trip(axis));
        all.push(Interruption::Death(Job::Servo, axis));
    }
    all.push(Interruption::Death(Job::Planner, 0));
    all.extend([Interruption::MasterDies, Interruption::LauncherDies]);
    all
}

/// After an interruption the cell has ended where it was to, or can be enabled and homed; why not.
fn recovers(cell: &mut Cell, what: Interruption) -> Result<(), String> {
    let still = |of: &Cell| !matches!(of.mode(), Mode::Jogging | Mode::Stopping);
    if !cell.until(5_000, |of| of.ended || still(of)) {
        return Err(format!("it moves on: {:?}", cell.mode()));
    }
    if matches!(
        what,
        Interruption::LauncherDies | Interruption::Ordered(Order::Down)
    ) {
        let refused = cell.order(Order::Home);
        let ends = cell.until(1_000, |of| of.ended);
        return match (refused, ends) {
            (Refused::Ending, true) => Ok(()),
            other => Err(format!("the cell does not end: {other:?}")),
        };
    }
    if cell.machine.axes[0].standby && matches!(what, Interruption::Death(..)) && !cell.is_homed() {
        return Err(format!("the standby has not homed it: {:?}", cell.cause()));
    }
    cell.scans(300);
    if matches!(cell.mode(), Mode::Tripped | Mode::Disabled) {
        let reason = cell.order(Order::Enable);
        if reason != Refused::Not {
            return Err(format!("enable is refused: {reason:?}"));
        }
    }
    let on = cell.until(1_000, |of| of.mode() == Mode::Ready);
    cell.scans(200);
    if !on || cell.mode() != Mode::Ready {
        let why = (cell.mode(), cell.cause());
        return Err(format!("it does not come on, or trips again: {why:?}"));
    }
    let reason = cell.order(Order::Home);
    if reason != Refused::Not {
        return Err(format!("home is refused: {reason:?}"));
    }
    cell.scans(2);
    let ends = cell.until(10_000, |of| of.mode() != Mode::Jogging);
    cell.scans(100);
    let found = (ends, cell.mode(), cell.is_homed(), cell.cause());
    if found != (true, Mode::Ready, true, Cause::None) {
        return Err(format!("it is not homed: {found:?}"));
    }
    let off_mm = (0..cell.machine.axes.len()).map(|axis| cell.off_mm(axis).abs());
    let off_mm = off_mm.fold(0.0, f64::max);
    if off_mm > 0.005 {
        return Err(format!("its zero is off by {off_mm} mm"));
    }
    match cell.held_share < 0.5 {
        true => Ok(()),
        false => Err(format!(
            "it held with {} of the rated torque",
            cell.held_share
        )),
    }
}

/// A step shorter than this has no middle.
const SHORT_SCANS: u64 = 20;

/// Scans of a homing in which it is to be interrupted: where a step begins, and in its middle.
fn moments(mut cell: Cell) -> BTreeSet<u64> {
    let mut begins = vec![0_u64];
    let mut at = step(&cell);
    let mut scan = 0;
    while scan < 2 || cell.mode() == Mode::Jogging {
        cell.scan();
        scan += 1;
        let now = step(&cell);
        if now != at {
            begins.push(scan);
            at = now;
        }
        assert!(scan < 20_000, "homing never ends");
    }
    assert!(cell.is_homed(), "{:?}", cell.cause());
    let steps = begins.windows(2).filter(|of| of[1] - of[0] > SHORT_SCANS);
    let middles: Vec<_> = steps.map(|of| of[0].midpoint(of[1])).collect();
    begins.into_iter().chain(middles).collect()
}

/// Each of these interruptions in each step of a homing that has just been ordered: how many, and which the machine did not recover from.
fn interrupted(name: &str, mut cell: Cell, all: &[Interruption]) -> (usize, Vec<String>) {
    let (mut count, mut wrong) = (0, Vec::new());
    let mut at = 0;
    let each = |moment: u64| all.iter().map(move |what| (moment, *what));
    let cases = moments(cell.clone()).into_iter().flat_map(each);
    // Each of what can come, in different steps.
    for (moment, what) in size::one_in(9, cases) {
        cell.scans(moment - at);
        at = moment;
        let mut cell = cell.clone();
        cell.held_share = 0.0;
        suffer(&mut cell, what);
        count += 1;
        if let Err(why) = recovers(&mut cell, what) {
            let step = cell.now.scan;
            wrong.push(format!(
                "{name}, {what:?} after {moment} scans: {why} in scan {step}"
            ));
        }
    }
    (count, wrong)
}

/// The first homing of a machine, and the second, each interrupted by what is asked for.
fn table(motors: u32, standby: bool, asked: impl Fn(&Interruption) -> bool) {
    let (machine, plant) = machine(motors, standby);
    let mut cell = Cell::new(machine, plant);
    cell.scans(5);
    assert_eq!(cell.order(Order::Load), Refused::Not);
    cell.scans(20);
    assert_eq!(cell.now.program, ProgramState::Loaded as u32);
    cell.ready();
    let mut all = interruptions(cell.machine.axes.len());
    all.retain(asked);
    let homings = ["first", "second"].map(|which| {
        cell.scans(300);
        assert_eq!(cell.order(Order::Home), Refused::Not, "{which}");
        let begun = cell.clone();
        cell.scans(2);
        assert!(cell.until(20_000, |of| of.mode() != Mode::Jogging));
        assert!(cell.is_homed(), "{which}");
        (format!("{which} homing of {motors} motors"), begun)
    });
    let (mut count, mut wrong) = (0, Vec::new());
    std::thread::scope(|scope| {
        let all = &all;
        let of = homings.map(|(name, cell)| scope.spawn(move || interrupted(&name, cell, all)));
        for (counted, found) in of.map(|thread| thread.join().expect("a homing")) {
            count += counted;
            wrong.extend(found);
        }
    });
    println!("{count} interruptions with {motors} motors, standby {standby}");
    let shown = wrong.iter().take(40).cloned().collect::<Vec<_>>();
    assert!(
        wrong.is_empty() && count > 20,
        "{} of {count}:\n{}",
        wrong.len(),
        shown.join("\n")
    );
}

#[test]
fn an_axis_can_be_homed_after_any_interruption_of_any_step_of_its_homing() {
    table(1, false, |_| true);
}

#[test]
fn a_gantry_can_be_homed_after_any_interruption_of_any_step_of_its_first_homing_and_its_second() {
    table(2, false, |_| true);
}

#[test]
fn deaths_in_any_step_of_the_homing_of_a_gantry_with_standbys_leave_one_that_can_be_homed() {
    let dies =
        |what: &Interruption| matches!(what, Interruption::Death(..) | Interruption::MasterDies);
    table(2, true, dies);
}

/// A gantry whose second index is not where the machine file says, by so much, ready to be homed.
fn wrongly_described(off_mm: f64) -> Cell {
    let (mut machine, plant) = machine(2, false);
    let second = machine.axes[1].homing.as_mut().expect("homing");
    second.position_mm += off_mm;
    let mut cell = Cell::new(machine, plant);
    cell.scans(5);
    cell.ready();
    cell
}

/// Torques of the two motors, in percent of the rated one.
fn torques_percent(cell: &Cell) -> [f64; 2] {
    let rated_nm = cell.machine.axes[0].motor.rated_torque_nm;
    [0, 1].map(|axis| 100.0 * cell.now.axes[axis].torque_nm / rated_nm)
}

#[test]
fn a_gantry_that_trips_while_it_homes_lets_its_bridge_go_and_is_driven_again_without_strain() {
    // Too skew by the limit, and within it: the bridge bears neither.
    for (off_mm, cause) in [(-0.3, Cause::Skew), (0.15, Cause::GantryTorque)] {
        let mut cell = wrongly_described(off_mm);
        for which in ["first", "second"] {
            let what = format!("{off_mm} mm off, {which} homing");
            assert_eq!(cell.order(Order::Home), Refused::Not, "{what}");
            assert!(
                cell.until(20_000, |of| of.mode() == Mode::Tripped),
                "{what}"
            );
            let words = cell.machine.cause_words(
                cell.cause(),
                cell.now.cause_axis as usize,
                cell.now.axes[1].drive_code,
            );
            println!("{what}: {words}, {:?} %", torques_percent(&cell));
            assert_eq!((cell.cause(), cell.now.cause_axis), (cause, 1), "{what}");
            assert!(words.contains("between X and X2"), "{words}");
            cell.scans(500);
            // Nobody holds a bridge askew in a trip.
            assert_eq!(cell.mode(), Mode::Tripped);
            assert_eq!(torques_percent(&cell), [0.0; 2], "{what}");
            assert_eq!(cell.order(Order::Enable), Refused::Not, "{what}");
            assert!(cell.until(1_000, |of| of.mode() == Mode::Ready), "{what}");
            let references = [0, 1].map(|axis| cell.now.axes[axis].reference);
            assert_eq!(references, [Reference::Missing as u32; 2], "{what}");
            for _ in 0..1_000 {
                cell.scan();
                let torques = torques_percent(&cell);
                assert!(
                    torques.iter().all(|of| of.abs() < 50.0),
                    "{what}: {torques:?}"
                );
            }
            assert_eq!((cell.mode(), cell.cause()), (Mode::Ready, Cause::None));
        }
    }
}

#[test]
fn motors_that_pull_against_each_other_are_let_go_after_any_trip() {
    // The emergency stop comes while the bridge is being squared in vain.
    for after in [5, 20, 40, 60] {
        let mut cell = wrongly_described(0.15);
        assert_eq!(cell.order(Order::Home), Refused::Not);
        assert!(cell.until(20_000, Cell::is_homed));
        cell.scans(after);
        assert_eq!(cell.order(Order::EmergencyStop), Refused::Not);
        cell.scans(1_000);
        assert_eq!(
            (cell.mode(), cell.cause()),
            (Mode::Tripped, Cause::EmergencyStop)
        );
        let torques = torques_percent(&cell);
        println!("stopped after {after} scans: {torques:?} %");
        let difference = (torques[1] - torques[0]).abs();
        assert!(difference < 100.0, "{torques:?}");
    }
}

#[test]
fn a_machine_file_says_which_difference_of_torques_is_too_much() {
    let usual = wrongly_described(0.15);
    let mut lenient = Machine::clone(&usual.machine);
    let gantry = lenient.axes[1].gantry.as_mut().expect("a gantry");
    assert_eq!(gantry.torque_difference_max_percent, 100.0);
    gantry.torque_difference_max_percent = 600.0;
    let mut cell = Cell::new(lenient, PlantFile::clone(&usual.plant));
    cell.scans(5);
    cell.ready();
    assert_eq!(cell.order(Order::Home), Refused::Not);
    assert!(cell.until(20_000, |of| of.mode() == Mode::Tripped));
    assert_eq!(cell.cause(), Cause::TorqueLimit);
}
