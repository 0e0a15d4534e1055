//! How a run ended is said by the master alone: for each way in which one can end, and also by a master that takes over afterwards.

use bus::sample::{
    Cause, DOWN_FOR_LOSS, Mode, OperatorRequest, Order, ProgramState, Refused, RunOutcome,
};

use crate::common::{self, staying::Cell};

const PROGRAM: &str = "G21 G90 G94\nG1 X10 F6000\nG1 X0\nM2\n";
const ABORTS: &str = "G21 G90 G94\nG1 X5 F6000\n(ABORT,enough)\nM2\n";

/// What is done to a run that is under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Done,
    Abort,
    StopAndReset,
    HoldAndReset,
    StopAndLoad,
    StopAndDown,
    DownForLoss,
    TripAndReset,
    EmergencyStopAndReset,
    TripAcknowledgedAndReset,
    TripAndDown,
    DeadMasterAndReset,
}

const ALL: [(End, RunOutcome, Cause, Option<Order>); 12] = [
    (End::Done, RunOutcome::Completed, Cause::None, None),
    (End::Abort, RunOutcome::Stopped, Cause::Abort, None),
    (
        End::StopAndReset,
        RunOutcome::Interrupted,
        Cause::None,
        Some(Order::Reset),
    ),
    (
        End::HoldAndReset,
        RunOutcome::Interrupted,
        Cause::None,
        Some(Order::Reset),
    ),
    (
        End::StopAndLoad,
        RunOutcome::Interrupted,
        Cause::None,
        Some(Order::Load),
    ),
    (
        End::StopAndDown,
        RunOutcome::Interrupted,
        Cause::None,
        Some(Order::Down),
    ),
    (
        End::DownForLoss,
        RunOutcome::Stopped,
        Cause::None,
        Some(Order::Down),
    ),
    (
        End::TripAndReset,
        RunOutcome::Stopped,
        Cause::FollowingError,
        Some(Order::Reset),
    ),
    (
        End::EmergencyStopAndReset,
        RunOutcome::Stopped,
        Cause::EmergencyStop,
        Some(Order::Reset),
    ),
    // Somebody has gone on since: it was he who gave it up.
    (
        End::TripAcknowledgedAndReset,
        RunOutcome::Interrupted,
        Cause::None,
        Some(Order::Reset),
    ),
    (
        End::TripAndDown,
        RunOutcome::Stopped,
        Cause::FollowingError,
        Some(Order::Down),
    ),
    (
        End::DeadMasterAndReset,
        RunOutcome::Stopped,
        Cause::MasterLost,
        Some(Order::Reset),
    ),
];

fn asks(cell: &mut Cell, order: Order, value: f64) {
    let request = OperatorRequest {
        order: order as u32,
        value,
        ..OperatorRequest::default()
    };
    let reason = cell.ask(&request).reason;
    assert_eq!(Refused::from_wire(reason), Some(Refused::Not), "{order:?}");
}

fn comes_to(cell: &mut Cell, mode: Mode) {
    assert!(cell.until(3_000, |of| of.mode() == mode), "not {mode:?}");
    cell.scans(300);
}

fn ends(cell: &mut Cell, how: End) {
    match how {
        End::Done | End::Abort => {
            let running = ProgramState::Running as u32;
            assert!(cell.until(9_000, |of| of.now.program != running));
        }
        End::StopAndReset | End::StopAndLoad | End::StopAndDown => {
            asks(cell, Order::Stop, 0.0);
            comes_to(cell, Mode::Stopped);
        }
        End::HoldAndReset => {
            asks(cell, Order::Hold, 0.0);
            assert!(cell.until(3_000, |of| of.now.rested == 1));
        }
        End::TripAndReset | End::TripAcknowledgedAndReset | End::TripAndDown => {
            cell.trips = Some(0);
            comes_to(cell, Mode::Tripped);
            if how == End::TripAcknowledgedAndReset {
                asks(cell, Order::Enable, 0.0);
                comes_to(cell, Mode::Enabled);
            }
        }
        End::EmergencyStopAndReset => {
            asks(cell, Order::EmergencyStop, 0.0);
            comes_to(cell, Mode::Tripped);
        }
        End::DeadMasterAndReset => {
            cell.replace_master();
            cell.scans(300);
        }
        End::DownForLoss => {}
    }
    match how {
        End::Done | End::Abort => {}
        End::StopAndLoad => {
            let number = cell.lay(PROGRAM);
            asks(cell, Order::Load, f64::from(number));
        }
        End::StopAndDown | End::TripAndDown => asks(cell, Order::Down, 0.0),
        End::DownForLoss => asks(cell, Order::Down, DOWN_FOR_LOSS),
        _ => asks(cell, Order::Reset, 0.0),
    }
}

#[test]
fn whatever_ends_a_run_the_feedback_says_which_one_how_and_in_which_scan() {
    for (how, outcome, cause, order) in ALL {
        let (machine, plant) = common::load("xy");
        let mut cell = Cell::new(machine, plant);
        cell.ready_and_homed();
        let text = if how == End::Abort { ABORTS } else { PROGRAM };
        let number = cell.lay(text);
        asks(&mut cell, Order::Load, f64::from(number));
        assert!(cell.until(100, |of| of.now.program == ProgramState::Loaded as u32));
        asks(&mut cell, Order::Start, 0.0);
        cell.scans(60);
        assert_eq!((cell.now.run, cell.now.ended.run), (1, 0), "{how:?}");
        ends(&mut cell, how);
        let before = cell.now.scan;
        let over = cell.until(3_000, |of| of.now.ended.run == 1 || of.ended);
        assert!(over, "{how:?}");
        let (said, ended) = cell.now.end_of(1).expect("the end of run 1");
        assert_eq!(said, outcome, "{how:?}");
        assert_eq!(Cause::from_wire(ended.cause), Some(cause), "{how:?}");
        assert_eq!(Order::from_wire(ended.order), order, "{how:?}");
        let is_last = cell.now.last == 1;
        assert!(!is_last || ended.scan == cell.now.scan, "{how:?}");
        let shown = cell.now.scan;
        assert!(ended.scan + 1 >= before && ended.scan <= shown, "{how:?}");
        if !is_last {
            let before = cell.now.ended;
            cell.scans(3);
            cell.replace_master();
            cell.scans(3);
            assert_eq!(cell.now.ended, before, "{how:?}, then the master died");
        }
    }
}

#[test]
fn typed_in_blocks_that_a_trip_has_ended_were_stopped_by_it_also_once_it_is_acknowledged() {
    let (machine, plant) = common::load("xy");
    let mut cell = Cell::new(machine, plant);
    cell.ready_and_homed();
    let number = cell.lay("G21 G91 G94\nG1 X10 F600\n");
    let request = OperatorRequest {
        order: Order::Load as u32,
        value: f64::from(number),
        session: cell.now.load + 1,
        ..OperatorRequest::default()
    };
    assert_eq!(cell.ask(&request).accepted, 1);
    assert!(cell.until(1_000, |of| of.now.run == 1));
    cell.scans(60);
    cell.trips = Some(0);
    assert!(cell.until(3_000, |of| of.mode() == Mode::Tripped));
    let acknowledged = cell.until(3_000, |of| {
        of.now.ended.run == 1 || of.clone().order(Order::Enable) == Refused::Not
    });
    assert!(acknowledged);
    assert_eq!(cell.order(Order::Enable), Refused::Not);
    assert!(cell.until(3_000, |of| of.now.ended.run == 1));
    let (outcome, ended) = cell.now.end_of(1).expect("its end");
    assert_eq!(outcome, RunOutcome::Stopped);
    assert_eq!(ended.cause, Cause::FollowingError as u32);
}
