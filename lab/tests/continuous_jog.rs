//! A continuous jog moves an axis as long as somebody renews its order, and no longer; the emergency stop ends it and everything else.

use std::path::Path;

use crate::common::kill;
use crate::size;
use bus::sample::{Cause, Feedback, Mode, OperatorRequest, OperatorResponse, Order, Refused};
use lab::cell::{InProcessCell, Script};
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::faults;

/// It waits for a second, long enough to be held.
const PROGRAM: &str = "G21 G90 G94\nG4 P1\nG1 X1 F600\nM2\n";
const DEADLINE: u32 = 200;
const SESSION: u32 = 7;
/// At rest in hold by then.
const HELD: u64 = 400;
/// What is looked ahead and settled before an axis moves, and after it has stopped, in scans.
const SETTLING: u64 = 600;
/// A command is a whole increment.
const NOISE_MM_S: f64 = 0.01;

fn load(name: &str) -> (Machine, PlantFile) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines");
    let folder = folder.join(name);
    let machine = Machine::load(&folder).expect("machine.toml");
    let plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    (machine, plant)
}

fn order(order: Order) -> OperatorRequest {
    OperatorRequest::of(order)
}

fn on(direction: f64, speed_mm_s: f64) -> OperatorRequest {
    OperatorRequest {
        value: direction,
        speed_mm_s,
        session: SESSION,
        deadline_scans: DEADLINE,
        ..order(Order::JogOn)
    }
}

fn renewed(session: u32) -> OperatorRequest {
    OperatorRequest {
        session,
        deadline_scans: DEADLINE,
        ..order(Order::JogRenew)
    }
}

/// A cell in which the program is held, and what it showed last.
struct Held {
    cell: InProcessCell,
    machine: Machine,
    now: Feedback,
    /// Fastest that axis X was commanded, in mm/s.
    fastest_mm_s: f64,
}

impl Held {
    fn of(name: &str, faults: &str) -> Held {
        let (machine, plant) = load(name);
        let script = Script {
            faults: Some(faults::parse("faults.toml", faults, &machine).expect("a script")),
            ..Script::default()
        };
        let program = ("wait.ngc", PROGRAM);
        let mut cell =
            InProcessCell::with_script(&machine, &plant, program, script).expect("a cell");
        let now = *cell.scan().expect("a scan").feedback;
        let mut held = Held {
            cell,
            machine,
            now,
            fastest_mm_s: 0.0,
        };
        assert_eq!(held.order(&order(Order::Hold)).accepted, 1);
        held.scan_to(HELD);
        held
    }

    fn order(&mut self, request: &OperatorRequest) -> OperatorResponse {
        self.cell.order(request)
    }

    /// False once the run has ended.
    fn scan(&mut self) -> bool {
        let before_mm = self.x_mm();
        let Some(published) = self.cell.scan() else {
            return false;
        };
        self.now = *published.feedback;
        let scan_s = self.machine.scan_period_s();
        let speed_mm_s = (self.x_mm() - before_mm).abs() / scan_s;
        if self.now.mode == Mode::Jogging as u32 {
            self.fastest_mm_s = self.fastest_mm_s.max(speed_mm_s);
        }
        true
    }

    fn scan_to(&mut self, scan: u64) {
        while self.now.scan < scan && self.scan() {}
    }

    /// Scans on, with the order renewed every 50 scans.
    fn renewed_for(&mut self, scans: u64) {
        let until = self.now.scan + scans;
        while self.now.scan < until && self.scan() {
            if self.now.scan.is_multiple_of(50) {
                self.order(&renewed(SESSION));
            }
        }
    }

    fn x_mm(&self) -> f64 {
        self.now.axes[0].command_position as f64 * self.machine.axes[0].increment_mm()
    }

    fn mode(&self) -> Mode {
        Mode::from_wire(self.now.mode).expect("a mode")
    }

    fn rests(&self) -> bool {
        self.now
            .axes()
            .iter()
            .all(|axis| axis.velocity_mm_s.abs() < 0.5)
    }

    /// The furthest that a sender which falls silent now may let the axis go, in mm.
    fn reach_mm(&self, speed_mm_s: f64) -> f64 {
        let axis = &self.machine.axes[0];
        let scan_s = self.machine.scan_period_s();
        // A jog uses a fifth of the acceleration, and brakes once what it looks ahead has passed.
        let braking_mm = speed_mm_s * speed_mm_s / (2.0 * 0.2 * axis.acceleration_mm_s2);
        speed_mm_s * f64::from(DEADLINE + 130) * scan_s + braking_mm + 0.01
    }
}

fn refused(answer: &OperatorResponse) -> Option<Refused> {
    Refused::from_wire(answer.reason)
}

#[test]
fn a_jog_goes_on_while_it_is_renewed_and_a_late_renewal_begins_it_no_more() {
    for speed_mm_s in [2.0, 25.0] {
        let mut held = Held::of("xy", "");
        assert_eq!(held.order(&on(1.0, speed_mm_s)).accepted, 1);
        held.renewed_for(3000);
        let way_mm = held.x_mm();
        assert!(
            way_mm > 1.5 * speed_mm_s,
            "{way_mm} mm at {speed_mm_s} mm/s"
        );
        assert!(
            held.fastest_mm_s < speed_mm_s + NOISE_MM_S,
            "{}",
            held.fastest_mm_s
        );
        assert_eq!(held.mode(), Mode::Jogging);
        // Of another sender, it renews nothing.
        let answer = held.order(&renewed(SESSION + 1));
        assert_eq!(refused(&answer), Some(Refused::JogOver));
        let silent = held.now.scan;
        held.scan_to(silent + u64::from(DEADLINE) + 2 * SETTLING);
        assert_eq!(held.mode(), Mode::Enabled, "as before the jog");
        let rest_mm = held.x_mm();
        assert!(
            rest_mm - way_mm <= held.reach_mm(speed_mm_s),
            "{way_mm} → {rest_mm}"
        );
        let answer = held.order(&renewed(SESSION));
        assert_eq!(refused(&answer), Some(Refused::JogOver));
        held.scan_to(silent + 4000);
        assert_eq!(held.x_mm(), rest_mm);
        assert!(held.rests());
    }
}

#[test]
fn an_order_that_comes_after_its_last_scan_moves_nothing() {
    let mut held = Held::of("xy", "");
    let late = OperatorRequest {
        latest_scan: held.now.scan - 1,
        ..on(1.0, 0.0)
    };
    assert_eq!(refused(&held.order(&late)), Some(Refused::TooLate));
    held.scan_to(1500);
    assert_eq!((held.mode(), held.x_mm()), (Mode::Enabled, 0.0));
}

#[test]
fn bad_directions_speeds_and_deadlines_are_refused() {
    let mut held = Held::of("xy", "");
    let right = on(1.0, 5.0);
    for (wrong, why) in [
        (
            OperatorRequest {
                value: 0.5,
                ..right
            },
            Refused::BadValue,
        ),
        (
            OperatorRequest {
                value: f64::NAN,
                ..right
            },
            Refused::BadValue,
        ),
        (
            OperatorRequest {
                session: 0,
                ..right
            },
            Refused::BadValue,
        ),
        (
            OperatorRequest {
                deadline_scans: 0,
                ..right
            },
            Refused::BadValue,
        ),
        (
            OperatorRequest {
                deadline_scans: 2001,
                ..right
            },
            Refused::BadValue,
        ),
        (
            OperatorRequest {
                speed_mm_s: -1.0,
                ..right
            },
            Refused::JogSpeed,
        ),
        (
            OperatorRequest {
                speed_mm_s: f64::NAN,
                ..right
            },
            Refused::JogSpeed,
        ),
        (
            OperatorRequest {
                speed_mm_s: 251.0,
                ..right
            },
            Refused::JogSpeed,
        ),
        (OperatorRequest { axis: 2, ..right }, Refused::UnknownAxis),
    ] {
        assert_eq!(refused(&held.order(&wrong)), Some(why), "{wrong:?}");
    }
    assert_eq!(held.order(&right).accepted, 1);
    assert_eq!(refused(&held.order(&right)), Some(Refused::Jogging));
}

#[test]
fn a_renewed_jog_comes_to_rest_at_the_end_of_the_travel() {
    for (name, direction, speed_mm_s) in [
        ("xy", 1.0, 240.0),
        ("xy", -1.0, 60.0),
        ("xy-fast", 1.0, 100.0),
    ] {
        let mut held = Held::of(name, "");
        assert_eq!(held.order(&on(direction, speed_mm_s)).accepted, 1);
        held.renewed_for(14_000);
        let axis = &held.machine.axes[0];
        let end_mm = if direction > 0.0 {
            axis.travel_max_mm
        } else {
            axis.travel_min_mm
        };
        let left_mm = (end_mm - held.x_mm()).abs();
        assert!(left_mm < 1e-9, "{name}: {left_mm} mm before {end_mm}");
        assert_eq!(held.mode(), Mode::Enabled, "{name}");
        // Once more the same way, it stays.
        held.order(&on(direction, speed_mm_s));
        held.renewed_for(3000);
        let still_mm = (end_mm - held.x_mm()).abs();
        assert!(still_mm < 1e-9, "{name}: {still_mm} mm");
        assert_eq!(
            held.order(&on(-direction, speed_mm_s)).accepted,
            1,
            "{name}"
        );
    }
}

#[test]
fn the_speed_may_change_while_the_axis_is_jogged() {
    let mut held = Held::of("xy", "");
    assert_eq!(held.order(&on(1.0, 5.0)).accepted, 1);
    held.renewed_for(1500);
    let faster = OperatorRequest {
        speed_mm_s: 40.0,
        ..renewed(SESSION)
    };
    assert_eq!(held.order(&faster).accepted, 1);
    held.renewed_for(1000);
    assert!(
        (39.0..40.0 + NOISE_MM_S).contains(&held.fastest_mm_s),
        "{}",
        held.fastest_mm_s
    );
    let slower = OperatorRequest {
        speed_mm_s: 1.0,
        ..renewed(SESSION)
    };
    assert_eq!(held.order(&slower).accepted, 1);
    held.renewed_for(500);
    held.fastest_mm_s = 0.0;
    held.renewed_for(500);
    assert!(
        (0.5..1.0 + NOISE_MM_S).contains(&held.fastest_mm_s),
        "{}",
        held.fastest_mm_s
    );
}

#[test]
fn hold_and_the_end_of_its_sender_stop_it_and_no_renewal_goes_on_with_it() {
    let off = OperatorRequest {
        deadline_scans: 0,
        ..renewed(SESSION)
    };
    for stops in [order(Order::Hold), off] {
        let mut held = Held::of("xy", "");
        assert_eq!(held.order(&on(-1.0, 10.0)).accepted, 1);
        held.renewed_for(1000);
        let at_mm = held.x_mm();
        assert_eq!(held.order(&stops).accepted, 1);
        assert_eq!(
            refused(&held.order(&renewed(SESSION))),
            Some(Refused::JogOver)
        );
        held.renewed_for(SETTLING + 400);
        assert!(held.rests() && held.mode() == Mode::Enabled);
        assert!((held.x_mm() - at_mm).abs() <= held.reach_mm(10.0));
    }
}

const RESTARTS: &str = "[restart]\nplanner = \"resume\"\nservo = \"wait\"\nmaster = \"wait\"\n";

/// Whoever is killed in whichever scan, the axis comes to rest, and the program can be gone on with to its end.
#[test]
fn whoever_is_killed_while_an_axis_is_jogged_it_comes_to_rest() {
    for who in ["servo-X", "servo-Y", "planner", "plant-sim"] {
        for scan in (HELD + 10..HELD + 900).step_by(size::number("APART", 97, 43) as usize) {
            let mut held = Held::of("xy", &format!("{RESTARTS}{}", kill(who, scan, 30)));
            assert_eq!(held.order(&on(1.0, 20.0)).accepted, 1);
            let begun = held.now.scan;
            let mut late_mm = None;
            while held.now.scan < begun + 2500 && held.scan() {
                // The sender lives on for a while: what it says late begins nothing.
                if held.now.scan < begun + 1500 && held.now.scan.is_multiple_of(50) {
                    held.order(&renewed(SESSION));
                }
                if held.now.scan == begun + 2300 {
                    late_mm = Some(held.x_mm());
                }
            }
            let what = format!("{who} killed in scan {scan}: {:?}", held.mode());
            assert!(held.rests(), "{what}");
            let late_mm = late_mm.unwrap_or_else(|| panic!("{what}: the run is over"));
            assert!((held.x_mm() - late_mm).abs() < 0.01, "{what}: {late_mm}");
            assert_ne!(held.mode(), Mode::Jogging, "{what}");
            assert!(held.x_mm() < 60.0, "{what}: {}", held.x_mm());
            if held.mode() != Mode::Enabled {
                assert_eq!(held.order(&order(Order::Enable)).accepted, 1, "{what}");
                held.scan_to(held.now.scan + 300);
            }
            assert_eq!(held.order(&order(Order::Resume)).accepted, 1, "{what}");
            held.scan_to(held.now.scan + 20_000);
            assert_eq!(held.mode(), Mode::Finished, "{what}");
        }
    }
}

#[test]
fn an_emergency_stop_brakes_a_jog_at_once_and_is_obeyed_in_every_state() {
    let stop = order(Order::EmergencyStop);
    let mut held = Held::of("xy", "");
    assert_eq!(held.order(&on(1.0, 100.0)).accepted, 1);
    held.renewed_for(1500);
    let at_mm = held.x_mm();
    assert_eq!(held.order(&stop).accepted, 1);
    held.scan();
    assert_eq!(
        (held.mode(), held.now.cause),
        (Mode::Tripped, Cause::EmergencyStop as u32)
    );
    assert_eq!(
        refused(&held.order(&renewed(SESSION))),
        Some(Refused::JogOver)
    );
    for _ in 0..100 {
        held.scan();
    }
    // 100 mm/s at the 5 m/s² of a trip, where a jog would take five times as far.
    assert!(
        held.rests() && (held.x_mm() - at_mm).abs() < 2.0,
        "{}",
        held.x_mm() - at_mm
    );

    // While the path is left on the way to rest, and once more after the trip.
    let mut held = Held::of("xy", "");
    for _ in 0..2 {
        assert_eq!(held.order(&stop).accepted, 1);
        held.scan();
        assert_eq!(
            (held.mode(), held.now.cause),
            (Mode::Tripped, Cause::EmergencyStop as u32)
        );
    }

    // With the drives off they stay off, until somebody enables them.
    let mut held = Held::of("xy", "");
    assert_eq!(held.order(&order(Order::Disable)).accepted, 1);
    held.scan_to(HELD + 50);
    assert_eq!(held.order(&stop).accepted, 1);
    held.scan();
    assert_eq!(
        (held.mode(), held.now.cause),
        (Mode::Disabled, Cause::EmergencyStop as u32)
    );
}
