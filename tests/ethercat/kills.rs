//! Who owns the bus is killed, stopped, or loses its standby, in realtime, over drives that run by their own clock: they stay in
//! operation. Where both are killed the machine stops and `enable` has it go on.
//!
//! `QUADRANT_KILLS=50` does it so often, in each mode, with the watchdog that the machine ships with; without it a few times, and the
//! drives bear a PC that is busy with other tests.

use serde_json::Value;

use crate::live::{Up, has_stopped, status};
use crate::segment::Network;
use crate::start_ups::bus_processes;
use crate::support::send;

/// A way to disturb the processes of the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Disturbance {
    Owner,
    Standby,
    OwnerStopped,
    Both,
}

/// Process ids of owner and standby; none while there is no standby.
fn owner_and_standby(status: &Value) -> Option<[i32; 2]> {
    // Nobody answers at times.
    status["processes"].as_array()?;
    let owner = status["bus"]["owner_pid"].as_i64()?;
    let mut others = bus_processes(status).into_iter();
    let standby = others.find(|pid| *pid != owner)?;
    let ready = status["bus"]["standby"] == true;
    ready.then_some([owner as i32, standby as i32])
}

impl Up<'_> {
    /// Waits until both are there; their process ids.
    fn await_both(&self, what: &str) -> [i32; 2] {
        let mut both = None;
        self.await_status(what, |status| {
            both = owner_and_standby(status);
            both.is_some()
        });
        both.unwrap_or_default()
    }

    /// Disturbs the bus, and brings the machine on again where it stopped; whether it did.
    fn disturb(&self, disturbance: Disturbance, number: u64) -> bool {
        let what = format!("{disturbance:?} {number}");
        let [owner, standby] = self.await_both(&what);
        self.pause(number);
        match disturbance {
            Disturbance::Owner => send(owner, libc::SIGKILL),
            Disturbance::Standby => send(standby, libc::SIGKILL),
            Disturbance::OwnerStopped => send(owner, libc::SIGSTOP),
            Disturbance::Both => {
                // The standby first: it would have taken over.
                send(standby, libc::SIGKILL);
                send(owner, libc::SIGKILL);
            }
        }
        if disturbance == Disturbance::Both {
            self.await_status(&what, has_stopped);
        } else {
            self.await_status(&what, |status| {
                owner_and_standby(status).is_some_and(|now| now != [owner, standby])
            });
        }
        if !has_stopped(&status(self)) {
            return false;
        }
        println!(
            "{what}: {}",
            self.status().lines().next().unwrap_or_default()
        );
        self.enable(&what);
        self.await_mode(&what, "enabled");
        self.order(&["resume"]);
        true
    }
}

#[test]
fn drives_stay_in_operation_whoever_of_the_bus_is_killed_or_stopped_while_another_one_lives() {
    let kills = std::env::var("QUADRANT_KILLS").ok();
    let shipped = kills.is_some();
    let kills: u64 = kills.map_or(1, |kills| kills.parse().expect("a number"));
    let Some(network) = Network::new() else {
        return;
    };
    // What is held for so long is as far behind.
    let patience = [
        ("watchdog_ms = 10", "watchdog_ms = 250"),
        (
            "following_error_limit_mm = 2.0",
            "following_error_limit_mm = 20.0",
        ),
    ];
    let position = [
        ("drive_mode = \"velocity\"", "drive_mode = \"position\""),
        ("advance_ms = 3.5", "advance_ms = 1.0"),
    ];
    let torque = [("drive_mode = \"velocity\"", "drive_mode = \"torque\"")];
    for (mode, machine) in [("csv", &[][..]), ("csp", &position), ("cst", &torque)] {
        let operate = format!("operate = \"{mode}\"");
        let patient = if shipped { &[][..] } else { &patience };
        let up = Up::new(
            &network,
            &[machine, patient].concat(),
            &[("operate = \"csv\"", &operate)],
        );
        let undisturbed = up.undisturbed();
        let times = [
            (Disturbance::Owner, 4 * kills),
            (Disturbance::Standby, 2 * kills),
            (Disturbance::OwnerStopped, kills),
            (Disturbance::Both, kills),
        ];
        let (mut number, mut stops, mut short) = (0, 0, Value::Null);
        for (disturbance, times) in times {
            // The start-up after it counts anew.
            if disturbance == Disturbance::Both {
                short = status(&up)["bus"]["short"].clone();
            }
            let stopped = (0..times).filter(|_| {
                number += 1;
                up.disturb(disturbance, number)
            });
            let stopped = stopped.count() as u64;
            println!("{mode}: {disturbance:?} {times} times, stopped {stopped} times");
            let may_stop = disturbance == Disturbance::Both || shipped;
            assert!(
                stopped == 0 || may_stop,
                "{mode}: {disturbance:?}: {stopped} stops"
            );
            stops += stopped;
        }
        let bus = status(&up)["bus"].clone();
        let segment: Value = serde_json::from_str(&up.segment.order("status")).expect("JSON");
        let judged = up.end();
        println!("{mode}: undisturbed {undisturbed:?}, {number} disturbances {judged:?}");
        println!("{mode}: {bus}");
        let (frames, twice) = (&segment["output_frames"], &segment["duplicates"]);
        println!("{mode}: {frames} frames with outputs, {twice} of them twice");
        for drive in segment["drives"].as_array().expect("drives") {
            assert_eq!(drive["left_operation_enabled"], stops, "{mode}: {drive}");
        }
        assert_eq!(short, 0, "{mode}: answers that somebody took no part in");
    }
}
