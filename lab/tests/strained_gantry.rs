//! A gantry that cannot be squared, or trips while it is: its bridge is let go. What comes between in any step of a homing is in
//! `procedures.rs`.

use crate::common::{staying::Cell, stock};
use bus::sample::{Cause, Mode, Order, Reference, Refused};
use machine::Machine;
use plant_sim::plant_file::PlantFile;

/// A gantry whose second index is not where the machine file says, by so much, ready to be homed.
fn wrongly_described(off_mm: f64) -> Cell {
    let (mut machine, plant) = stock::homed_machine(2, false);
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
