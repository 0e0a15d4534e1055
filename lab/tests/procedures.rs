//! Seeds of `quadrant-lab bench procedures`, a few in each run of the tests and the whole table in full; more with `SEEDS=15000 cargo test -p
//! lab --test all procedures::`, one and all of it with `FROM=17 SEEDS=1 VERBOSE=1`.

use std::path::PathBuf;

use bus::sample::{Cause, Mode, Order, Refused};
use lab::options::{ProceduresOptions, SeedOptions};
use lab::staying::Cell;

use crate::common::stock;
use crate::size;

#[test]
fn whatever_comes_in_whatever_step_of_a_procedure_the_machine_can_be_moved_as_it_says() {
    let seeds = size::number("SEEDS", 300, 0);
    let options = ProceduresOptions {
        machine: PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../machines/xyz-mill"),
        // In full as many as there are cells.
        seeds: (seeds > 0).then_some(seeds),
        of: SeedOptions {
            from: size::number("FROM", 1, 1),
            part: lab::bench::PartOf::WHOLE,
            lines: None,
            jobs: 2,
        },
        verbose: std::env::var_os("VERBOSE").is_some(),
    };
    let outcome = lab::bench::procedures(&options);
    assert!(outcome.is_ok(), "{outcome:?}");
}

#[test]
fn a_drive_with_a_fault_and_one_that_is_lost_trip_with_their_cause_and_come_back_with_enable() {
    let (machine, plant) = stock::homed_machine(1, false);
    let mut cell = Cell::new(machine, plant);
    cell.scans(5);
    cell.ready_and_homed();
    for (lost, cause, homed) in [
        (false, Cause::DriveFault, true),
        (true, Cause::DriveLost, false),
    ] {
        let drives = cell.master.drives();
        match lost {
            true => drives.lose(0),
            false => drives.fault(0),
        }
        cell.scans(300);
        assert_eq!((cell.mode(), cell.cause()), (Mode::Tripped, cause));
        assert_eq!(cell.order(Order::Enable), Refused::Not);
        assert!(cell.until(500, |of| of.mode() == Mode::Ready), "{cause:?}");
        assert_eq!(cell.is_homed(), homed, "{cause:?}");
    }
}

#[test]
fn drives_that_take_their_time_come_on_also_while_the_planner_refuses_the_program_that_is_loaded() {
    // The motors of a gantry that is not homed are let go first.
    let (machine, plant) = stock::homed_machine(2, false);
    let mut cell = Cell::new(machine, plant);
    cell.scans(5);
    let load = cell.load_of("G21\nG999\nM2\n");
    assert_eq!(cell.ask(&load).reason, Refused::Not as u32);
    cell.scans(100);
    assert_eq!(cell.cause(), Cause::Planner);
    assert_eq!(cell.order(Order::Enable), Refused::Not);
    assert!(cell.until(2_000, |of| of.mode() == Mode::Ready));
    // And one that comes while they are being switched on.
    assert_eq!(cell.order(Order::Disable), Refused::NotAtRest);
    cell.scans(200);
    assert_eq!(cell.order(Order::Disable), Refused::Not);
    cell.scans(5);
    assert_eq!(cell.order(Order::Enable), Refused::Not);
    let load = cell.load_of("G999\nM2\n");
    assert_eq!(cell.ask(&load).reason, Refused::Not as u32);
    assert!(cell.until(2_000, |of| of.mode() == Mode::Ready));
    cell.scans(100);
    assert_eq!(cell.cause(), Cause::Planner);
}
