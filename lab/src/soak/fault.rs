//! What a soak does to the processes of its cell: which fault comes next, and whom it hits.

use std::time::Duration;

use bus::sample::{Job, Participant};
use plant_sim::script::rng::Rng;

use super::cell::Cell;

/// How long a process is stopped, in µs.
const STOP_US: (u64, u64) = (20_000, 300_000);
/// How long all processes are, in µs.
const STOP_ALL_US: u64 = 200_000;

/// What is done to whom.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    KillPlanner,
    KillDriving,
    KillStandby,
    KillBoth,
    KillMonitor,
    KillMaster,
    KillPlannerAndServo,
    StopOne,
    StopAll,
    KillBusOwner,
    KillBusStandby,
    KillBus,
    StopBus,
}

/// The faults, and how often each is to come among all of them.
const FAULTS: [(Fault, u64); 9] = [
    (Fault::KillPlanner, 30),
    (Fault::KillDriving, 20),
    (Fault::KillStandby, 8),
    (Fault::KillBoth, 6),
    (Fault::KillMonitor, 10),
    (Fault::KillMaster, 10),
    (Fault::KillPlannerAndServo, 6),
    (Fault::StopOne, 12),
    (Fault::StopAll, 4),
];

/// What is done besides where drives are on a bus.
const BUS_FAULTS: [(Fault, u64); 4] = [
    (Fault::KillBusOwner, 24),
    (Fault::KillBusStandby, 8),
    (Fault::KillBus, 4),
    (Fault::StopBus, 4),
];

fn draw(rng: &mut Rng, only: Option<&str>, on_bus: bool) -> Fault {
    let of_bus: &[_] = if on_bus { &BUS_FAULTS } else { &[] };
    match only {
        Some("fieldbus") => return pick(rng, &BUS_FAULTS),
        Some("planner") => return Fault::KillPlanner,
        Some("servo") => return Fault::KillDriving,
        Some("monitor") => return Fault::KillMonitor,
        Some("plant-sim") => return Fault::KillMaster,
        _ => {}
    }
    pick(rng, &[FAULTS.as_slice(), of_bus].concat())
}

/// One of these, each as often as its share says.
fn pick(rng: &mut Rng, faults: &[(Fault, u64)]) -> Fault {
    let all = faults.iter().map(|(_, share)| share).sum();
    let mut left = rng.below(all);
    for (fault, share) in faults {
        if left < *share {
            return *fault;
        }
        left -= share;
    }
    Fault::KillPlanner
}

/// A fault and the processes it hits.
pub struct Injection {
    /// The word for it.
    pub kind: &'static str,
    /// Slots of the roster.
    pub slots: Vec<usize>,
    /// How long they are stopped; none: killed.
    pub stopped: Option<Duration>,
    /// Drives on a bus may be left without frames until their own watchdogs act.
    pub leaves_drives: bool,
}

impl Injection {
    fn kill(kind: &'static str, slots: Vec<usize>) -> Injection {
        Injection {
            kind,
            slots,
            stopped: None,
            leaves_drives: false,
        }
    }

    fn stop(kind: &'static str, slots: Vec<usize>, time: Duration) -> Injection {
        Injection {
            stopped: Some(time),
            ..Injection::kill(kind, slots)
        }
    }

    fn leaving_drives(self) -> Injection {
        Injection {
            leaves_drives: true,
            ..self
        }
    }
}

/// Draws the next fault for the processes that are there; of one role only, if it is named.
pub fn next(rng: &mut Rng, cell: &Cell, only: Option<&str>) -> Injection {
    let on_bus = cell.bus_owner().is_some();
    let fault = draw(rng, only, on_bus);
    let targets = Targets::choose(rng, cell);
    let of = |job| targets.of(job);
    let master = if on_bus {
        "kill master"
    } else {
        "kill plant-sim"
    };
    match fault {
        Fault::KillBusOwner | Fault::KillBusStandby | Fault::KillBus | Fault::StopBus => {
            targets.bus(fault, rng, cell.bus_owner().flatten())
        }
        Fault::KillPlanner => Injection::kill("kill planner", of(Job::Planner)),
        Fault::KillStandby if targets.is_paired() => {
            let standby = targets.servo(Some(1 - targets.driving_role.min(1)));
            Injection::kill("kill standby", standby)
        }
        Fault::KillBoth if targets.is_paired() => {
            Injection::kill("kill both servos of an axis", targets.servo(None))
        }
        Fault::KillDriving | Fault::KillStandby | Fault::KillBoth => {
            let kind = if targets.is_paired() {
                "kill driving servo (standby)"
            } else {
                "kill servo (no standby)"
            };
            Injection::kill(kind, targets.servo(Some(targets.driving_role)))
        }
        Fault::KillMonitor => Injection::kill("kill monitor", of(Job::Monitor)),
        Fault::KillMaster => Injection::kill(master, of(Job::Master)),
        Fault::KillPlannerAndServo => {
            let kind = if targets.is_paired() {
                "kill planner and servo (standby)"
            } else {
                "kill planner and servo (alone)"
            };
            let servo = targets.servo(Some(targets.driving_role));
            Injection::kill(kind, [of(Job::Planner), servo].concat())
        }
        Fault::StopOne => targets.stop_one(rng),
        Fault::StopAll => {
            let all = targets.slots.iter().map(|(slot, _)| *slot).collect();
            let time = Duration::from_micros(STOP_ALL_US);
            Injection::stop("stop everybody 200 ms", all, time).leaving_drives()
        }
    }
}

/// The processes of a cell, and the axis whose servos may be hit.
struct Targets {
    slots: Vec<(usize, Participant)>,
    axis: u32,
    driving_role: u32,
}

impl Targets {
    fn choose(rng: &mut Rng, cell: &Cell) -> Targets {
        let slots = cell.slots();
        let servos = slots.iter().filter(|(_, p)| p.job == Job::Servo as u32);
        let axes: Vec<u32> = servos.map(|(_, p)| p.axis).collect();
        let axis = rng.pick(&axes).copied().unwrap_or(0);
        let newest = cell.judge.newest();
        let feedback = newest.and_then(|f| f.axes().get(axis as usize));
        Targets {
            slots,
            axis,
            driving_role: feedback.map_or(0, |feedback| feedback.taken_role),
        }
    }

    fn of(&self, job: Job) -> Vec<usize> {
        let found = self.slots.iter().filter(|(_, p)| p.job == job as u32);
        found.map(|(slot, _)| *slot).collect()
    }

    /// Servos of the axis, of one role or all.
    fn servo(&self, role: Option<u32>) -> Vec<usize> {
        let found = self.slots.iter().filter(|(_, p)| {
            p.job == Job::Servo as u32
                && p.axis == self.axis
                && role.is_none_or(|role| p.role == role)
        });
        found.map(|(slot, _)| *slot).collect()
    }

    /// Whether the axis has a standby.
    fn is_paired(&self) -> bool {
        self.servo(None).len() > 1
    }

    /// A fault of the processes that send the frames of a bus, of which the one in slot `owner` does so now.
    fn bus(&self, fault: Fault, rng: &mut Rng, owner: Option<usize>) -> Injection {
        let all = self.of(Job::Fieldbus);
        let (now, others): (Vec<usize>, Vec<usize>) =
            all.iter().partition(|slot| Some(**slot) == owner);
        match fault {
            Fault::StopBus => {
                let kind = "stop the owner of the bus 20-300 ms";
                Injection::stop(kind, now, some_time(rng)).leaving_drives()
            }
            Fault::KillBusStandby if !others.is_empty() => {
                Injection::kill("kill standby of the bus", others)
            }
            Fault::KillBusOwner if !others.is_empty() => {
                Injection::kill("kill owner of the bus (standby)", now)
            }
            _ => {
                let kind = if others.is_empty() {
                    "kill owner of the bus (alone)"
                } else {
                    "kill both processes of the bus"
                };
                Injection::kill(kind, all).leaving_drives()
            }
        }
    }

    fn stop_one(&self, rng: &mut Rng) -> Injection {
        let one = rng.pick(&self.slots).copied();
        let kind = one.map_or("stop nobody", |(_, p)| match Job::from_wire(p.job) {
            Some(Job::Planner) => "stop planner 20-300 ms",
            Some(Job::Monitor) => "stop monitor 20-300 ms",
            Some(Job::Master) if !self.of(Job::Fieldbus).is_empty() => "stop master 20-300 ms",
            Some(Job::Master) => "stop plant-sim 20-300 ms",
            Some(Job::Fieldbus) => "stop a process of the bus 20-300 ms",
            _ => {
                let same = |(_, q): &&(usize, Participant)| q.job == p.job && q.axis == p.axis;
                if self.slots.iter().filter(same).count() > 1 {
                    "stop servo (paired) 20-300 ms"
                } else {
                    "stop servo (alone) 20-300 ms"
                }
            }
        });
        let slots = one.map(|(slot, _)| slot).into_iter().collect();
        let stop = Injection::stop(kind, slots, some_time(rng));
        match one.and_then(|(_, p)| Job::from_wire(p.job)) {
            Some(Job::Master | Job::Fieldbus) => stop.leaving_drives(),
            _ => stop,
        }
    }
}

fn some_time(rng: &mut Rng) -> Duration {
    let (low, high) = STOP_US;
    Duration::from_micros(low + rng.below(high - low))
}

/// Incarnations in slots: another process has a slot once its number is higher.
pub fn incarnations(cell: &Cell, of: &[usize]) -> Vec<(usize, u32)> {
    let slots = cell.slots();
    let of = slots.iter().filter(|(slot, _)| of.contains(slot));
    of.map(|(slot, p)| (*slot, p.incarnation)).collect()
}
